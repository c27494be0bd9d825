"""Branches of a response curve: the paths that were followed, and what they make taken together.

A curve may be in several pieces: one from each end of the interval that turns back, one that was entered from within and
followed both ways, a closed one apart from the others.  It is complete if they leave no frequency without a solution.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bdamper.continuation.follower import Path, PathPoint

TWO_PI = 2.0 * np.pi
GAP = 1e-3
"""Widest part of the interval, relative to all of it, that may be left without solutions in a complete curve."""
NO_SOLUTION = "no solution found"


class LeftOut(NamedTuple):
    """A part of a curve that was not followed.

    Parameters
    ----------
    low, high : float, Hz
        Between which it lies, or sets off: the same where a path breaks off at a point.
    why : str
    """

    low: float
    high: float
    why: str

    def __str__(self) -> str:
        where = f"{self.low:.6g} Hz" if self.high == self.low else f"{self.low:.6g} to {self.high:.6g} Hz"
        return f"{where}: {self.why}"


@dataclass(frozen=True)
class Piece:
    """One path.

    Parameters
    ----------
    path : Path
    up : bool
        It set off toward higher frequency.
    branch : int
        Pieces of one branch share its number.
    inside : bool
        It started within the interval, not at one of its ends.
    """

    path: Path
    up: bool
    branch: int = 0
    inside: bool = False

    @property
    def span(self) -> tuple[float, float] | None:
        omega = [p.y[-1] for p in self.path.points]
        return (min(omega), max(omega)) if omega else None


def in_order(pieces: Sequence[Piece]) -> list[tuple[PathPoint, Piece]]:
    """Points of all pieces, each with its own; the two ways from a solution within follow each other as one path."""
    out: list[tuple[PathPoint, Piece]] = []
    for before, piece in zip([None, *pieces], pieces):
        points = [(p, piece) for p in piece.path.points]
        if before is None or not before.path.points or not piece.inside or before.branch != piece.branch:
            out += points
            continue
        first = len(out) - len(before.path.points)
        out[first] = replace(out[first][0], kind="regular"), before
        out[first:first] = points[:0:-1]
    return out


def finished(pieces: Sequence[Piece], low: float, high: float) -> bool:
    """Whether nothing is left to be followed: branches lead through from end to end."""
    through = any(piece.path.status == "complete" and not piece.inside for piece in pieces)
    return through and not uncovered(pieces, low, high)


def _gaps(pieces: Sequence[Piece], low: float, high: float) -> Iterator[tuple[float, float]]:
    reached = low
    for a, b in sorted(span for span in (piece.span for piece in pieces) if span):
        if a > reached * (1.0 + 1e-12):
            yield reached, a
        reached = max(reached, b)
    if reached < high * (1.0 - 1e-12):
        yield reached, high


def uncovered(pieces: Sequence[Piece], low: float, high: float) -> list[tuple[float, float]]:
    """Parts of the interval without a solution that are too wide for a complete curve."""
    return [gap for gap in _gaps(pieces, low, high) if gap[1] - gap[0] > GAP * (high - low)]


def ending(pieces: Sequence[Piece], low: float, high: float) -> tuple[str, str, tuple[LeftOut, ...]]:
    """Status and reason of a curve from those of its pieces, and what was not followed.

    "complete" says that there are solutions at every frequency of the interval, gaps below a thousandth of its width aside.
    Such gaps, and paths that ended where a curve cannot end, are what is left out.
    """
    gaps = uncovered(pieces, low, high)
    left = _left_out(pieces, low, high)
    for piece in pieces:
        if piece.path.status == "interrupted":
            return "interrupted", piece.path.reason, left
    reasons = "; ".join(dict.fromkeys(f"{piece.path.status} ({piece.path.reason})" for piece in pieces))
    if not any(piece.path.points for piece in pieces):
        return "no start", reasons, left
    if gaps:
        a, b = max(gaps, key=lambda gap: gap[1] - gap[0])
        return "incomplete", f"{NO_SOLUTION} from {a / TWO_PI:.6g} to {b / TWO_PI:.6g} Hz: {reasons}", left
    through = [piece for piece in pieces if piece.path.status == "complete" and not piece.inside]
    extra = len({piece.branch for piece in pieces if piece.path.points}) - 1
    if through:
        reason = through[0].path.reason + (f"; {extra} further branches" if extra else "")
    else:
        reason = f"{extra + 1} separate branches cover the interval"
    return "complete", reason, left


def _left_out(pieces: Sequence[Piece], low: float, high: float) -> tuple[LeftOut, ...]:
    out = [LeftOut(float(a) / TWO_PI, float(b) / TWO_PI, NO_SOLUTION) for a, b in _gaps(pieces, low, high)]
    for piece in pieces:
        path = piece.path
        if path.points and path.status not in ("complete", "turned back", "closed"):
            ends = path.tangle or (path.points[-1].y[-1],) * 2
            out.append(LeftOut(float(ends[0]) / TWO_PI, float(ends[1]) / TWO_PI, f"{path.status}: {path.reason}"))
    return tuple(sorted(set(out)))
