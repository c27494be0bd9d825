"""Coverage of a frequency interval by the branches of a response curve, and its first point.

Paths start at both ends of the interval.  They are also followed beyond it, up to the resonances of
the modes, where a branch may turn and return.  Remaining gaps are searched from neighbouring
solutions and by the methods for the first point. A budget of evaluations limits the work
(:func:`evaluation_budget`).  A curve is complete if its branches leave no frequency without a
solution; all omissions are reported.

:func:`first_point` computes a solution at one frequency from the static state by, in this order,

1. Newton iteration from the static state (:mod:`bdamper.contact.static_state`) plus the linear
   response in stick,
2. Newton iteration with line search, and least norm for a rank-deficient Jacobian,
3. continuation in the level of the excitation from the static state, around folds,
4. fading supports: free bodies (all, if none is free) rest on springs and dampers that fade out as
   the excitation grows.

The log lists all attempts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.preload_state import PreloadState
from bdamper.harmonic_balance.equations import OK, STATUS_TEXT, Correction, Equations
from bdamper.harmonic_balance.sector import Sector, excitation_ramp, supported_by
from bdamper.response.continuation import DRIFTED_OFF, TWO_PI, Follower, follow
from bdamper.response.events import SIDE_POINTS, ContinuationOptions, Path
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, NOT_FOUND
from bdamper.util.formatting import counted
from bdamper.util.progress import CostMeter

# ---- coverage of a frequency interval ----


GAP = 1e-3
"""Widest gap of a complete curve, relative to the interval."""
NO_SOLUTION = "no solution found"
UNBOUNDED, NO_DIGITS = "unbounded", "no digits are left"
"""First words of the reason of a part without amplitudes."""
OPERATIONS = 1.5e6
"""Default budget in million operations (:attr:`bdamper.util.progress.Cost.work`), about half a
minute."""
FEWEST_EVALUATIONS, MOST_EVALUATIONS = 10_000, 60_000
"""Bounds of the default budget in evaluations."""
SHARE = 0.5
"""Fraction of the remaining budget for one path, so that a tangle of folds leaves evaluations for
other parts.

With 1 the widest gap of one of six curves with tangles grows from 5.3 to 11.6 Hz and the other five
do not change; none of 284 ordinary curves changes.
"""
OUTSIDE = 0.03
"""Minimum margin at each end for the search of folds outside the interval, relative to its
width."""
ARRIVED = ("complete", "turned back")
POSITIONS = (0.5, 0.2, 0.8)
"""Positions within a gap at which solutions are sought."""

FindStart = Callable[[float], NDArray | None]
"""Method for the first point as a function of the frequency (rad/s)."""


def evaluation_budget(system: Equations) -> int:
    """Return the default budget of a curve in evaluations.

    It corresponds to OPERATIONS for the size of the problem, between FEWEST_EVALUATIONS and
    MOST_EVALUATIONS.  An ordinary curve of some 100 points takes 300 to 700.
    """
    return int(
        min(max(OPERATIONS / float(system.work[:3].sum()), FEWEST_EVALUATIONS), MOST_EVALUATIONS)
    )


class LeftOut(NamedTuple):
    """Part of a curve that was not followed.

    Parameters
    ----------
    low, high : float, Hz
        Bounds of the part; equal if a path ended at a point.
    why : str
        Reason of the omission.
    """

    low: float
    high: float
    why: str

    def __str__(self) -> str:
        where = (
            f"{self.low:.6g} Hz"
            if self.high == self.low
            else f"{self.low:.6g} to {self.high:.6g} Hz"
        )
        return f"{where}: {self.why}"

    @property
    def amplitude(self) -> float:
        """Amplitude (m) of the resonance in a part that is unbounded or has no digits."""
        return float("inf") if self.why.startswith(UNBOUNDED) else float("nan")

    @property
    def at_middle(self) -> str:
        """Reason with the middle of the part, for example "unbounded at 30 Hz: no damping"."""
        what, _, cause = self.why.partition(": ")
        return f"{what} at {0.5 * (self.low + self.high):.6g} Hz: {cause}"


@dataclass(frozen=True, eq=False)
class Piece:
    """One path of a curve.

    Parameters
    ----------
    path : Path
    up : bool
        Whether forward along the path means increasing frequency.  This is its initial direction,
        except for a path that returns from a fold outside the interval.
    branch : int
        Number of the branch; several pieces may share it.
    inside : bool
        Whether the path started within the interval, not at an end.
    """

    path: Path
    up: bool
    branch: int = 0
    inside: bool = False


def in_order(pieces: Sequence[Piece]) -> list[tuple[Correction, Piece]]:
    """Return all points with their pieces, in the order along each branch.

    Two paths from one solution in opposite directions are joined.
    """
    out: list[tuple[Correction, Piece]] = []
    for before, piece in zip([None, *pieces], pieces):
        points = [(p, piece) for p in piece.path.points]
        if (
            before is None
            or not before.path.points
            or not piece.inside
            or before.branch != piece.branch
        ):
            out += points
            continue
        first = len(out) - len(before.path.points)
        out[first] = replace(out[first][0], kind="regular"), before
        out[first:first] = points[:0:-1]
    return out


def _gaps(pieces: Sequence[Piece], low: float, high: float) -> Iterator[tuple[float, float]]:
    reached = low
    paths = ([p.y[-1] for p in piece.path.points] for piece in pieces if piece.path.points)
    for a, b in sorted((min(omega), max(omega)) for omega in paths):
        if a > reached * (1.0 + 1e-12):
            yield reached, a
        reached = max(reached, b)
    if reached < high * (1.0 - 1e-12):
        yield reached, high


def uncovered(pieces: Sequence[Piece], low: float, high: float) -> list[tuple[float, float]]:
    """Return the gaps of the interval that are too wide for a complete curve."""
    return [gap for gap in _gaps(pieces, low, high) if gap[1] - gap[0] > GAP * (high - low)]


def ending(
    pieces: Sequence[Piece], low: float, high: float
) -> tuple[str, str, tuple[LeftOut, ...]]:
    """Return status and reason of a curve from its pieces, and its omissions.

    "complete" means solutions at every frequency of the interval, except for gaps below a
    thousandth of its width.  The omissions are these gaps, and paths that ended within the
    interval.
    """
    gaps = uncovered(pieces, low, high)
    left = _left_out(pieces, low, high)
    for piece in pieces:
        if piece.path.status == "interrupted":
            return INTERRUPTED, piece.path.reason, left
    reasons = "; ".join(
        dict.fromkeys(f"{piece.path.status} ({piece.path.reason})" for piece in pieces)
    )
    if not any(piece.path.points for piece in pieces):
        return NOT_FOUND, reasons, left
    if gaps:
        a, b = max(gaps, key=lambda gap: gap[1] - gap[0])
        return (
            INCOMPLETE,
            f"{NO_SOLUTION} from {a / TWO_PI:.6g} to {b / TWO_PI:.6g} Hz: {reasons}",
            left,
        )
    through = (
        piece.path.reason
        for piece in pieces
        if piece.path.status == "complete" and not piece.inside
    )
    return COMPLETE, next(through, "separate branches cover the interval"), left


def _left_out(pieces: Sequence[Piece], low: float, high: float) -> tuple[LeftOut, ...]:
    out = [
        LeftOut(float(a) / TWO_PI, float(b) / TWO_PI, NO_SOLUTION)
        for a, b in _gaps(pieces, low, high)
    ]
    for piece in pieces:
        path = piece.path
        if path.points and path.status not in ("complete", "turned back", "closed"):
            ends = path.tangle or (path.points[-1].y[-1],) * 2
            out.append(
                LeftOut(
                    float(ends[0]) / TWO_PI,
                    float(ends[1]) / TWO_PI,
                    f"{path.status}: {path.reason}",
                )
            )
    return tuple(sorted(set(out)))


@dataclass
class Coverage:
    """Search for all branches in an interval.

    Parameters
    ----------
    system : Equations
    limits : (low, high), rad/s
    options : ContinuationOptions
    meter : CostMeter
    on_point : callable, optional
        Called with every accepted point.
    reach : (low, high), rad/s, optional
        Interval in which branches may turn and return
        (:func:`bdamper.harmonic_balance.sector.reach`).
    pieces : list of Piece
        Paths computed so far.
    log : list of str
        Attempts to start paths.
    lost : list of LeftOut
        Ends of incomplete paths outside the interval.
    """

    system: Equations
    limits: tuple[float, float]
    options: ContinuationOptions
    meter: CostMeter
    on_point: Callable[[Correction], None] | None = None
    reach: tuple[float, float] | None = None
    pieces: list[Piece] = field(default_factory=list)
    log: list[str] = field(default_factory=list)
    lost: list[LeftOut] = field(default_factory=list)

    @property
    def finished(self) -> bool:
        """Whether a branch connects both ends and no gap is left."""
        through = any(piece.path.status == "complete" and not piece.inside for piece in self.pieces)
        return through and not uncovered(self.pieces, *self.limits)

    def note(self, omega: float, text: str) -> None:
        """Add a line about a frequency (rad/s) to the log."""
        self.log.append(f"{omega / TWO_PI:.6g} Hz: {text}")

    def cover(self, find_start: FindStart) -> None:
        """Follow the curve from the ends of the interval, beyond them, and within remaining gaps."""
        for up in (True, False):
            start = find_start(self.limits[0 if up else 1])
            if start is None:
                self.pieces.append(Piece(Path((), "no start", self.log[-1], 0, 0), up))
                continue
            self.follow(start, up)
            self.drop_repeated()
            self.outside_ends()
            if self.finished:
                break
        self.fill(find_start)

    def follow(
        self, start: NDArray, up: bool, branch: int | None = None, inside: bool = False
    ) -> Path:
        """Follow one branch and add it, even if interrupted."""
        stop, follower = (
            None,
            Follower(self.system.with_share(SHARE), self.limits, self.options, self.on_point),
        )
        try:
            path = follower.run(start, up)
        except KeyboardInterrupt as interrupt:
            stop, path = interrupt, follower.path("interrupted", "by the user")
        self.meter.count(path.iterations, path.failed_steps)
        number = max((p.branch for p in self.pieces), default=-1) + 1 if branch is None else branch
        self.pieces.append(Piece(path, up, number, inside))
        if stop is not None:
            raise stop
        return path

    def drop_repeated(self) -> None:
        """Remove pieces that start at the end of the last path, which contains the same branch."""
        last = self.pieces[-1]
        if last.path.status != "complete":
            return
        end = last.path.points[-1]
        for piece in self.pieces[:-1]:
            if piece.path.points and not piece.inside and _same(end.y, piece.path.points[0]):
                self.pieces.remove(piece)
                self.pieces[-1] = replace(last, branch=piece.branch)

    def both_ways(self, start: NDArray) -> None:
        """Add the branch through a solution within the interval, followed in both directions."""
        branch = max((p.branch for p in self.pieces), default=-1) + 1
        for up in (True, False):
            if self.follow(start, up, branch, True).status == "closed":
                return

    # ---- outside the interval ----

    @property
    def outside(self) -> tuple[float, float]:
        """Interval (rad/s) in which branches are followed to folds where they return."""
        low, high = self.limits
        margin = OUTSIDE * (high - low)
        bottom, top = self.reach or self.limits
        return min(bottom, max(low - margin, 0.5 * low)), max(top, high + margin)

    def outside_ends(self) -> None:
        """Follow branches beyond the interval to folds, and from there back into the interval.

        The search extends beyond the free and the stuck resonance (:attr:`outside`). With this
        range 2 of 100 narrow intervals lose their highest branch; with a margin of 3 % it was 14 of
        97 (``benchmarks/bench_narrow.py``). The cost is the same if the interval contains both
        resonances. Without the search 2 of 240 ordinary curves lose part of a branch; the search
        takes 9 % of their evaluations.
        """
        low, high = self.limits
        bottom, top = self.outside
        outside = replace(
            self.options, locate=False, max_points=SIDE_POINTS, step=0.5, max_step=1.0
        )
        seen: list[Correction] = []
        while not self.system.spent:
            paths = [piece.path.points for piece in self.pieces if piece.path.status in ARRIVED]
            ends = (p for points in paths for p in (points[0], points[-1]))
            end = next(
                (
                    p
                    for p in ends
                    if p.y[-1] in self.limits and not any(_same(p.y, q) for q in seen)
                ),
                None,
            )
            if end is None:
                return
            seen.append(end)
            up = end.y[-1] == high
            limits = (high, top) if up else (bottom, low)
            path = Follower(self.system.with_share(SHARE), limits, outside).run(end.y, up)
            self.meter.count(path.iterations, path.failed_steps)
            back = path.points[-1] if path.points else end
            if path.status not in ARRIVED:
                at = float(back.y[-1]) / TWO_PI
                self.lost.append(
                    LeftOut(at, at, f"outside the interval, {path.status}: {path.reason}")
                )
            if path.status != "turned back" or any(_same(back.y, q) for q in seen):
                continue
            seen.append(back)
            self.note(back.y[-1], "the branch turns outside the interval and comes back")
            forward = next(
                (p.tangent[-1] > 0.0) == q.up
                for q in self.pieces
                for p in q.path.points
                if p is end
            )
            self.follow(back.y, not up)
            self.pieces[-1] = replace(self.pieces[-1], up=up == forward)

    # ---- gaps ----

    def fill(self, find_start: FindStart) -> None:
        """Find solutions in gaps, the widest first, and follow them in both directions.

        Newton's method with line search starts from neighbouring solutions at several positions in
        the gap, then from the methods for the first point.  A gap without a solution remains.
        """
        if self.finished:
            return
        left: set[tuple[float, float]] = set()
        while not self.system.spent:
            gaps = [gap for gap in uncovered(self.pieces, *self.limits) if gap not in left]
            if not gaps:
                return
            gap = max(gaps, key=lambda g: g[1] - g[0])
            solution = self._within(gap, find_start)
            if solution is None:
                left.add(gap)
                continue
            self.note(solution[-1], "set off from a solution within a gap")
            self.both_ways(solution)

    def _within(self, gap: tuple[float, float], find_start: FindStart) -> NDArray | None:
        """Return a solution in a gap, or None."""
        a, b = gap
        points = [p for piece in self.pieces for p in piece.path.points]
        positions = [a + part * (b - a) for part in POSITIONS]
        for omega in positions:
            for point in sorted(points, key=lambda p: abs(p.y[-1] - omega))[:40:8]:
                c = self.system.correct_at(
                    point.y[:-1], omega, point.scale, self.options.tolerance, 30, True
                )
                self.meter.count(c.iterations)
                if c.status == OK:
                    return c.y
        return next((start for start in map(find_start, positions) if start is not None), None)


def _same(y: NDArray, point: Correction) -> bool:
    return y[-1] == point.y[-1] and bool(np.linalg.norm((y - point.y) / point.scale) < 1e-6)


# ---- first point of a curve ----


DRAG, SPRING = 10.0, 1.0
"""Support of free bodies: damping of the vibration, and stiffness of the mean.

Of 453 cases on the bladed disk (9 and 24 points, one to five harmonics, 20 to 200 N at 1 N) and on
random wedges with preloads below 20 times the excitation, Newton's method solves 197, the
excitation ramp 243 of the others, and this support 8 of the remaining 13.  None of nine other
supports solved more.  On one random model, whose shrouds just touch without preload, only a support
that also raises the excitation succeeded.
"""


def first_point(
    system: Equations[Sector],
    state: PreloadState,
    springs: NDArray,
    omega: float,
    options: ContinuationOptions,
    meter: CostMeter,
) -> tuple[NDArray | None, list[str], NDArray]:
    """Compute a solution at one frequency.

    Parameters
    ----------
    system : Equations[Sector]
    state : PreloadState
        Converged static state.
    springs : (n_points, 3) float, N/m
        Linear springs of the points in stick.
    omega : float, rad/s
    options : ContinuationOptions
    meter : CostMeter

    Returns
    -------
    solution : (n_unknowns + 1,) float or None
    log : list of str
        Attempts and their outcome.
    last : (n_unknowns + 1,) float
        Last Newton iterate.
    """
    log = [
        f"static state: converged in {state.iterations} iterations, residual {state.residual:.1e}"
    ]
    mean, stuck = state.q[: system.n_mean], system.structure.linear.response(omega, springs)
    start = system.layout.pack(mean, stuck)
    last = np.append(start, omega)
    scale = system.units(last, omega)
    for name, line_search, iterations in (
        ("Newton", False, 20),
        ("Newton with line search", True, 60),
    ):
        if system.spent:
            break
        c = system.correct_at(start, omega, scale, options.tolerance, iterations, line_search)
        meter.count(c.iterations)
        log.append(
            f"{name} from the stuck response: {STATUS_TEXT[c.status]}, {c.iterations} iterations"
        )
        last = c.y
        if c.status == OK:
            return c.y, log, last
    solution = (
        None if system.spent else _by_homotopy(system, omega, options, meter, log, mean, stuck)
    )
    if solution is None and system.spent:
        log.append("the budget of evaluations is used up")
    return solution, log, last


def _by_homotopy(
    system: Equations[Sector], omega: float, options: ContinuationOptions, meter: CostMeter, log: list[str],
    mean: NDArray, stuck: NDArray,
) -> NDArray | None:  # fmt: skip
    """Raise the excitation to its full level; if this fails, fade out a support of the free bodies.

    Free bodies on the support (all bodies, if none is free) neither bounce nor drift.
    """
    # initial level of the excitation for the support; a tenth of it for the ramp.  With the same
    # level the ramp fails on wedge dampers of eight sectors if the excitation equals the preload;
    # with a tenth of it the support fails on one of two random structures that need it
    first = 1e-2
    level = 0.1 * first
    start = np.append(system.layout.pack(mean, level * stuck), level)
    path = _homotopy(excitation_ramp(system, omega), start, options, meter)
    if path.status == "complete":
        log.append(f"excitation ramp: full level after {len(path.points)} steps")
        return np.append(path.points[-1].y[:-1], omega)
    reached = f"{100 * path.points[-1].y[-1]:.3g} %" if path.points else "no excitation"
    why = path.reason if path.reason == DRIFTED_OFF else path.status
    log.append(f"excitation ramp: stopped at {reached} ({why})")
    if system.spent:
        return None
    supported = supported_by(system, omega, DRAG, SPRING)
    u = system.layout.pack(mean, first * stuck)
    scale = np.full(len(u) + 1, max(float(np.linalg.norm(u)), 1e-300))
    c = supported.correct_at(u, first, scale, options.tolerance, 60, True)
    meter.count(c.iterations)
    if c.status != OK:
        log.append(f"fading supports: {STATUS_TEXT[c.status]} on the supports")
        return None
    path = _homotopy(supported, c.y, replace(options, patience=SIDE_POINTS), meter)
    if path.status == "complete":
        log.append(f"fading supports: removed after {counted(len(path.points), 'step')}")
        return np.append(path.points[-1].y[:-1], omega)
    why = "the bodies drift away" if path.status == "drifted off" else path.status
    log.append(
        f"fading supports: not removed after {len(path.points)} of {SIDE_POINTS} points ({why})"
    )
    return None


def _homotopy(
    system: Equations[Sector], start: NDArray, options: ContinuationOptions, meter: CostMeter
) -> Path:
    """Follow the curve in the last unknown, from its initial value to 1."""
    limits = 0.5 * float(start[-1]), 1.0
    path = follow(
        system, start, limits, options=replace(options, locate=False, max_points=SIDE_POINTS)
    )
    meter.count(path.iterations, path.failed_steps)
    return path
