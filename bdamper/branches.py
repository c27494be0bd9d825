"""Branches of a response curve: following them from wherever one can start, and what they show taken together.

A curve may be in several pieces: one from each end of the interval that turns back, one that was entered from within and
followed both ways, a closed one apart from the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation import ContinuationOptions, Interrupted, Path, PathPoint, follow
from bdamper.coupling import Coordinate
from bdamper.model import Model
from bdamper.system import OK, CostMeter, HarmonicSystem

TWO_PI = 2.0 * np.pi
BEYOND = 0.03
"""Part of the interval at each end, outside of it, in which folds are looked for."""
LOOK = 60
"""Points that are spent on it."""
ENTRIES = 4
"""Times a curve may enter the interval."""
ARRIVED = ("complete", "turned back")
GAP = 1e-3
"""Widest part of the interval, relative to all of it, that may be left without solutions in a complete curve."""


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


def _next_branch(pieces: Sequence[Piece]) -> int:
    return max((p.branch for p in pieces), default=-1) + 1


def follow_one(
    system: HarmonicSystem,
    start: NDArray,
    limits: tuple[float, float],
    up: bool,
    options: ContinuationOptions,
    meter: CostMeter,
    on_point: Callable[[PathPoint], None] | None,
    pieces: list[Piece],
) -> None:
    """Adds the path from an end of the interval.

    A path that arrives at the start of an earlier one replaces it: it is the same branch, followed further.
    """
    path = _follow(system, start, limits, up, options, meter, on_point, pieces)
    if path.status == "complete" and path.points:
        last = path.points[-1]
        for piece in pieces[:-1]:
            first = piece.path.points[0] if piece.path.points else None
            if first is not None and not piece.inside and np.linalg.norm((first.y - last.y) / last.scale) < 1e-6:
                pieces.remove(piece)
        pieces[-1] = Piece(path, up, _next_branch(pieces[:-1]))


def follow_both(
    system: HarmonicSystem,
    start: NDArray,
    limits: tuple[float, float],
    options: ContinuationOptions,
    meter: CostMeter,
    on_point: Callable[[PathPoint], None] | None,
    pieces: list[Piece],
) -> None:
    """Adds the branch through a solution within the interval, followed both ways."""
    branch = _next_branch(pieces)
    for up in (True, False):
        path = _follow(system, start, limits, up, options, meter, on_point, pieces, branch, True)
        if path.status == "closed":
            return


def _follow(
    system: HarmonicSystem,
    start: NDArray,
    limits: tuple[float, float],
    up: bool,
    options: ContinuationOptions,
    meter: CostMeter,
    on_point: Callable[[PathPoint], None] | None,
    pieces: list[Piece],
    branch: int | None = None,
    inside: bool = False,
) -> Path:
    """Adds one path, also if Ctrl-C ends it."""
    stop = None
    try:
        path = follow(system, start, limits, up=up, options=options, on_point=on_point)
    except Interrupted as interrupted:
        stop, path = interrupted, interrupted.path
    meter.iterations += path.iterations
    meter.failed_steps += path.failed_steps
    pieces.append(Piece(path, up, _next_branch(pieces) if branch is None else branch, inside))
    if stop is not None:
        raise stop
    return path


def leap(
    system: HarmonicSystem,
    limits: tuple[float, float],
    options: ContinuationOptions,
    meter: CostMeter,
    on_point: Callable[[PathPoint], None] | None,
    pieces: list[Piece],
    log: list[str],
) -> None:
    """Goes on beyond a tangle of folds that the last path was left in: from its farthest point, a little further on."""
    for _ in range(4):
        last = pieces[-1]
        if last.path.status != "tangle" or last.inside:
            return
        sense = 1.0 if last.up else -1.0
        front = max(last.path.points, key=lambda p: sense * p.y[-1])
        for distance in (2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2):
            omega = front.y[-1] + sense * distance * (limits[1] - limits[0])
            if not limits[0] < omega < limits[1]:
                return
            c = system.correct_at(front.y[:-1], omega, front.scale, options.tolerance, 60, True)
            meter.iterations += c.iterations
            if c.status == OK:
                break
        else:
            return
        log.append(f"{omega / TWO_PI:.6g} Hz: set off again beyond a tangle of folds")
        path = _follow(system, c.y, limits, last.up, options, meter, on_point, pieces)
        if path.status == "tangle" and (path.points[-1].y[-1] - front.y[-1]) * sense <= 0.0:
            reach = max(sense * p.y[-1] for p in path.points)
            if reach <= sense * front.y[-1] + 1e-3 * (limits[1] - limits[0]):
                return


def beyond_ends(
    system: HarmonicSystem,
    limits: tuple[float, float],
    options: ContinuationOptions,
    meter: CostMeter,
    on_point: Callable[[PathPoint], None] | None,
    pieces: list[Piece],
    log: list[str],
) -> None:
    """Looks for folds a little outside the interval, from which a branch comes back into it, and follows it there."""
    margin = BEYOND * (limits[1] - limits[0])
    look = replace(options, locate=False, max_points=LOOK, patience=LOOK, step=0.5, max_step=1.0)
    seen: list[PathPoint] = []
    while len(seen) < 2 * ENTRIES:
        paths = [piece.path.points for piece in pieces if piece.path.status in ARRIVED]
        ends = (p for points in paths for p in (points[0], points[-1]))
        end = next((p for p in ends if p.y[-1] in limits and not any(_same(p.y, q) for q in seen)), None)
        if end is None:
            return
        seen.append(end)
        up = end.y[-1] == limits[1]
        outside = (limits[1], limits[1] + margin) if up else (max(limits[0] - margin, 0.5 * limits[0]), limits[0])
        path = follow(system, end.y, outside, up=up, options=look)
        meter.iterations += path.iterations
        meter.failed_steps += path.failed_steps
        back = path.points[-1] if path.points else end
        if path.status != "turned back" or any(_same(back.y, q) for q in seen):
            continue
        seen.append(back)
        log.append(f"{back.y[-1] / TWO_PI:.6g} Hz: the branch turns outside the interval and comes back")
        _follow(system, back.y, limits, not up, options, meter, on_point, pieces)


def _same(y: NDArray, point: PathPoint) -> bool:
    return y[-1] == point.y[-1] and bool(np.linalg.norm((y - point.y) / point.scale) < 1e-6)


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


def fill(
    system: HarmonicSystem,
    limits: tuple[float, float],
    options: ContinuationOptions,
    meter: CostMeter,
    on_point: Callable[[PathPoint], None] | None,
    pieces: list[Piece],
    log: list[str],
    find_start: Callable[[float], NDArray | None],
) -> None:
    """Looks for solutions in what is left without and follows them both ways.

    At a few frequencies in the widest gap: Newton with line search from solutions on both sides, then the chain that finds
    the first point of a curve.  A gap in which nothing is found is left; so are all once the chain was called ``searches``
    times.
    """
    if finished(pieces, *limits):
        return
    hopeless: set[tuple[float, float]] = set()
    tries = iter(range(options.searches))
    for _ in range(options.searches):
        gaps = [gap for gap in uncovered(pieces, *limits) if gap not in hopeless]
        if not gaps:
            return
        a, b = max(gaps, key=lambda gap: gap[1] - gap[0])
        found = _within(system, limits, a, b, options, meter, pieces, find_start, tries)
        if found is None:
            hopeless.add((a, b))
            continue
        log.append(f"{found[-1] / TWO_PI:.6g} Hz: set off from a solution within a gap")
        follow_both(system, found, limits, options, meter, on_point, pieces)


def _within(
    system: HarmonicSystem,
    limits: tuple[float, float],
    a: float,
    b: float,
    options: ContinuationOptions,
    meter: CostMeter,
    pieces: Sequence[Piece],
    find_start: Callable[[float], NDArray | None],
    tries: Iterator[int],
) -> NDArray | None:
    """A solution in a gap."""
    points = [p for piece in pieces for p in piece.path.points]
    frequencies = [a + part * (b - a) for part in (0.5, 0.2, 0.8, 0.05, 0.95)]
    for omega in frequencies:
        for point in sorted(points, key=lambda p: abs(p.y[-1] - omega))[:40:8]:
            c = system.correct_at(point.y[:-1], omega, point.scale, options.tolerance, 30, True)
            meter.iterations += c.iterations
            if c.status == OK:
                return c.y
    wide = b - a > 0.1 * (limits[1] - limits[0])
    for omega, _ in zip(frequencies if wide else frequencies[:3], tries):
        start = find_start(omega)
        if start is not None:
            return start
    return None


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
        return "incomplete", f"no solution found from {a / TWO_PI:.6g} to {b / TWO_PI:.6g} Hz: {reasons}", left
    through = [piece for piece in pieces if piece.path.status == "complete" and not piece.inside]
    extra = len({piece.branch for piece in pieces if piece.path.points}) - 1
    if through:
        reason = through[0].path.reason + (f"; {extra} further branches" if extra else "")
    else:
        reason = f"{extra + 1} separate branches cover the interval"
    return "complete", reason, left


def _left_out(pieces: Sequence[Piece], low: float, high: float) -> tuple[LeftOut, ...]:
    out = [LeftOut(float(a) / TWO_PI, float(b) / TWO_PI, "no solution found") for a, b in _gaps(pieces, low, high)]
    for piece in pieces:
        path = piece.path
        if path.points and path.status not in ("complete", "turned back", "closed"):
            ends = path.tangle or (path.points[-1].y[-1],) * 2
            out.append(LeftOut(float(ends[0]) / TWO_PI, float(ends[1]) / TWO_PI, f"{path.status}: {path.reason}"))
    return tuple(sorted(set(out)))


# ---- other branches ----


def new_solutions(
    system: HarmonicSystem, pieces: list[Piece], starts: Sequence[NDArray], options: ContinuationOptions
) -> Iterator[NDArray]:
    """Solutions near the starts, at their frequencies, that lie on none of the pieces (which may grow meanwhile)."""
    for start in starts:
        vibration = max(float(np.linalg.norm(start[system.n_mean : -1])), 1e-300)
        scale = np.full(len(start), vibration)
        scale[: system.n_mean] = max(vibration, float(np.linalg.norm(start[: system.n_mean])))
        scale[-1] = start[-1]
        c = system.correct_at(start[:-1], start[-1], scale, options.tolerance, 20)
        if c.status == OK and not _known(system, pieces, c.y, options):
            yield c.y


def _known(system: HarmonicSystem, pieces: Sequence[Piece], y: NDArray, options: ContinuationOptions) -> bool:
    """Whether a solution lies on a path: Newton from where the path crosses its frequency leads to it."""
    n = system.n_mean
    size = max(float(np.linalg.norm(y[n:-1])), 1e-300)
    for piece in pieces:
        points = piece.path.points
        for a, b in zip(points, points[1:]):
            if (a.y[-1] - y[-1]) * (b.y[-1] - y[-1]) > 0.0:
                continue
            width = b.y[-1] - a.y[-1]
            part = (y[-1] - a.y[-1]) / width if width else 0.5
            between = a.y + part * (b.y - a.y)
            reach = float(np.linalg.norm((b.y - a.y)[n:-1])) + 1e-6 * size
            if np.linalg.norm((between - y)[n:-1]) > 10.0 * reach:
                continue
            for guess in (between, a.y, b.y):
                c = system.correct_at(guess[:-1], y[-1], a.scale, options.tolerance, 60, True)
                if c.status == OK and np.linalg.norm((c.y - y)[n:-1]) < 1e-5 * size:
                    return True
    return False


# ---- what the points show ----


def _displacement(model: Model, coordinate: Coordinate, q: float) -> str:
    body = model.bodies.get(coordinate.body)  # residual modes belong to none
    if body is not None and body.mass is not None and coordinate.name in ("TX", "TY", "TZ"):
        return f"{q / np.sqrt(body.mass):.3g} m"
    return f"{q:.3g} kg^1/2 m"


def notes(
    system: HarmonicSystem, model: Model, coordinates: Sequence[Coordinate], points: Sequence[PathPoint]
) -> tuple[str, ...]:
    """Where the mean position moves on its own, and which mean positions are held by least norm only."""
    out = []
    n = system.n_mean
    i = 0
    while i < len(points):
        if points[i].kind != "walk":
            i += 1
            continue
        j = i
        while j + 1 < len(points) and points[j + 1].kind == "walk":
            j += 1
        a, b = points[max(i - 1, 0)].y, points[j].y
        k = int(np.argmax(np.abs((b - a)[:n])))
        c = coordinates[k]
        out.append(
            f"{c.body} walks along {c.name} at {points[i].y[-1] / TWO_PI:.6g} Hz, where its mean force vanishes: from "
            f"{_displacement(model, c, a[k])} to {_displacement(model, c, b[k])}"
        )
        i = j + 1
    free = [p for p in points if p.rank_deficiency > 0]
    if free:
        some = free[:: max(1, len(free) // 20)]
        names = sorted({name for p in some for name in neutral_directions(system, coordinates, p.y)})
        out.append(f"nothing determines the mean along {', '.join(names)} at {len(free)} points: held by least norm")
    return tuple(out)


def neutral_directions(system: HarmonicSystem, coordinates: Sequence[Coordinate], y: NDArray) -> list[str]:
    """Names of the mean coordinates that dominate the null space of the mean part of the Jacobian."""
    n = system.n_mean
    J, _ = system.derivatives(y)
    columns = J[:, :n]
    size = np.abs(columns).max(axis=0)
    size = np.where(size > 1e-13 * size.max(), size, size.max())
    _, s, vt = np.linalg.svd(columns / size)
    s = np.concatenate([s, np.zeros(n - len(s))])
    names = []
    for row in vt[s < 1e-11 * max(s[0], 1e-300)]:
        k = int(np.argmax(np.abs(row / size)))
        names.append(f"{coordinates[k].name} of {coordinates[k].body}")
    return names


def why_no_solution(
    system: HarmonicSystem, model: Model, coordinates: Sequence[Coordinate], y: NDArray
) -> str:
    """If a free body cannot be in equilibrium where Newton ended: which mean force is left, and what that means."""
    try:
        r, J, _ = system.evaluate(y[:-1], y[-1])
    except FloatingPointError:
        return ""
    _, _, share = system.contact(y[:-1])
    for k, c in enumerate(coordinates):
        body = model.bodies.get(c.body)  # residual modes belong to none
        if body is None or body.kind != "free" or not c.name.startswith("T") or body.mass is None:
            continue
        force = float(r[k]) * np.sqrt(body.mass)
        stiff = float(np.abs(J[k]).max())
        if abs(r[k]) * system.row_scale[k] > 1e-6 and stiff < 1e-9 * float(np.abs(J).max()):
            if share[:, 4].min() >= 1.0:
                return (
                    f"no periodic solution: all contacts of {c.body} are open through the cycle and a static load of "
                    f"{abs(force):.3g} N acts along {c.name}"
                )
            return (
                f"no periodic solution near here: a mean force of {force:.3g} N along {c.name} drives {c.body}, whatever "
                "its mean position; it walks until a constraint plane carries load, and none does"
            )
    return ""
