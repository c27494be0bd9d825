"""Coverage of a frequency interval by the branches of a response curve, and its first point.

Paths start at both ends of the interval.  They are also followed beyond it, up to the resonances of
the modes, where a branch may turn and return.  Remaining gaps are searched from neighbouring
solutions and by the methods for the first point. A budget of evaluations limits the work
(:func:`evaluation_budget`).  A curve is complete if its branches leave no frequency without a
solution; all omissions are reported.

:func:`first_point` computes a solution at one frequency from the static state by, in this order,

1. Newton iteration from the static state (:mod:`bdamper.contact.static_state`) plus the linear
   response in stick,
2. Newton iteration with line search, and a minimum-norm step for a rank-deficient Jacobian,
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
from bdamper.harmonic_balance.sector import SectorData, excitation_ramp, supported_by
from bdamper.response.continuation import DRIFTED_OFF, TWO_PI, Follower, follow
from bdamper.response.events import SIDE_POINTS, ContinuationOptions, Path
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, NOT_FOUND
from bdamper.util.formatting import amount, counted
from bdamper.util.progress import CostMeter

# ---- coverage of a frequency interval ----


GAP = 1e-3
"""Widest gap of a complete curve, relative to the interval."""
NO_SOLUTION = "no solution found"
UNBOUNDED, NO_DIGITS = "unbounded", "no significant digits remain"
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
    operations_per_evaluation = float(system.work[:3].sum())
    budget = max(OPERATIONS / operations_per_evaluation, FEWEST_EVALUATIONS)
    return int(min(budget, MOST_EVALUATIONS))


class LeftOut(NamedTuple):
    """Part of a curve that was not followed.

    Parameters
    ----------
    low, high : float, Hz
        Bounds of the part; equal if a path ended at a point.
    why : str
        Reason for the omission.
    """

    low: float
    high: float
    why: str

    def __str__(self) -> str:
        if self.high == self.low:
            return f"{self.low:.6g} Hz: {self.why}"
        return f"{self.low:.6g} to {self.high:.6g} Hz: {self.why}"

    @property
    def amplitude(self) -> float:
        """Amplitude (m) of the resonance in an omitted part: infinite if unbounded, NaN if it
        cannot be resolved.
        """
        return float("inf") if self.why.startswith(UNBOUNDED) else float("nan")

    @property
    def at_middle(self) -> str:
        """Reason and middle frequency of the part, for example "unbounded at 30 Hz: no damping"."""
        kind, _, cause = self.why.partition(": ")
        middle = 0.5 * (self.low + self.high)
        return f"{kind} at {amount(middle, 'Hz')}: {cause}"


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
    ordered: list[tuple[Correction, Piece]] = []
    before: Piece | None = None
    for piece in pieces:
        points = [(point, piece) for point in piece.path.points]
        if before is not None and _other_way(before, piece):
            # the shared starting point occurs once and is not an end of the joined branch
            index_of_start = len(ordered) - len(before.path.points)
            start, _ = ordered[index_of_start]
            ordered[index_of_start] = replace(start, kind="regular"), before
            # the points of this path in reverse, without the start, before the other path
            leading_to_start = points[:0:-1]
            ordered[index_of_start:index_of_start] = leading_to_start
        else:
            ordered += points
        before = piece
    return ordered


def _other_way(before: Piece, piece: Piece) -> bool:
    """Return whether a path is the other way from the solution at which the one before starts."""
    return bool(before.path.points) and piece.inside and before.branch == piece.branch


def _gaps(pieces: Sequence[Piece], low: float, high: float) -> Iterator[tuple[float, float]]:
    """Yield all parts of the interval without a solution, also narrow ones (rad/s)."""
    covered = []
    for piece in pieces:
        if piece.path.points:
            frequencies = [point.parameter for point in piece.path.points]
            covered.append((min(frequencies), max(frequencies)))
    # all frequencies from low up to this one are covered or have been yielded
    reached = low
    rounding = 1e-12
    for bottom, top in sorted(covered):
        if bottom > reached * (1.0 + rounding):
            yield reached, bottom
        reached = max(reached, top)
    if reached < high * (1.0 - rounding):
        yield reached, high


def uncovered(pieces: Sequence[Piece], low: float, high: float) -> list[tuple[float, float]]:
    """Return the gaps of the interval that are too wide for a complete curve."""
    widest = GAP * (high - low)
    return [gap for gap in _gaps(pieces, low, high) if _width(gap) > widest]


def _width(gap: tuple[float, float]) -> float:
    low, high = gap
    return high - low


@dataclass(frozen=True)
class SearchEnd:
    """How a search for a curve ended.

    Parameters
    ----------
    status, reason : str
    missing_ranges : tuple of LeftOut
        Ranges without a solution.
    """

    status: str
    reason: str
    missing_ranges: tuple[LeftOut, ...]


def ending(pieces: Sequence[Piece], low: float, high: float) -> SearchEnd:
    """Determine from the pieces of a curve how the search over an interval (rad/s) ended.

    The status is "complete" if there are solutions at every frequency of the interval, except for
    gaps narrower than a thousandth of the interval.  The missing ranges are these gaps, and the
    ends of paths that stopped within the interval.
    """
    missing_ranges = _left_out(pieces, low, high)
    for piece in pieces:
        if piece.path.status == "interrupted":
            return SearchEnd(INTERRUPTED, piece.path.reason, missing_ranges)
    of_paths = [f"{piece.path.status} ({piece.path.reason})" for piece in pieces]
    reasons = "; ".join(dict.fromkeys(of_paths))
    if not any(piece.path.points for piece in pieces):
        return SearchEnd(NOT_FOUND, reasons, missing_ranges)
    gaps = uncovered(pieces, low, high)
    if gaps:
        bottom, top = max(gaps, key=_width)
        gap = f"{NO_SOLUTION} from {bottom / TWO_PI:.6g} to {top / TWO_PI:.6g} Hz"
        return SearchEnd(INCOMPLETE, f"{gap}: {reasons}", missing_ranges)
    for piece in pieces:
        if _connects_both_ends(piece):
            return SearchEnd(COMPLETE, piece.path.reason, missing_ranges)
    return SearchEnd(COMPLETE, "separate branches cover the interval", missing_ranges)


def _connects_both_ends(piece: Piece) -> bool:
    return piece.path.status == "complete" and not piece.inside


def _left_out(pieces: Sequence[Piece], low: float, high: float) -> tuple[LeftOut, ...]:
    """Return all gaps of the interval, and the ends of paths that broke off."""
    omissions = set()
    for bottom, top in _gaps(pieces, low, high):
        omissions.add(LeftOut(float(bottom) / TWO_PI, float(top) / TWO_PI, NO_SOLUTION))
    for piece in pieces:
        path = piece.path
        if not path.points or path.status in ("complete", "turned back", "closed"):
            continue
        if path.tangle:
            bottom, top = path.tangle
        else:
            bottom = top = path.points[-1].parameter
        why = f"{path.status}: {path.reason}"
        omissions.add(LeftOut(float(bottom) / TWO_PI, float(top) / TWO_PI, why))
    return tuple(sorted(omissions))


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
        connected = any(_connects_both_ends(piece) for piece in self.pieces)
        return connected and not uncovered(self.pieces, *self.limits)

    @property
    def new_branch(self) -> int:
        """Number of the next branch."""
        return max((piece.branch for piece in self.pieces), default=-1) + 1

    def note(self, omega: float, text: str) -> None:
        """Add a line about a frequency (rad/s) to the log."""
        self.log.append(f"{omega / TWO_PI:.6g} Hz: {text}")

    def cover(self, find_start: FindStart) -> None:
        """Follow the curve from the ends of the interval, beyond them, and within gaps."""
        low, high = self.limits
        for up in (True, False):
            start = find_start(low if up else high)
            if start is None:
                no_path = Path(
                    points=(), status="no start", reason=self.log[-1], iterations=0, failed_steps=0
                )
                self.pieces.append(Piece(no_path, up))
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
        """Follow one branch and add it, even if interrupted.

        Parameters
        ----------
        start : (n_unknowns + 1,) float
        up : bool
            Whether to start towards higher frequencies.
        branch : int, optional
            Number of the branch; a new one by default.
        inside : bool
            Whether the start is within the interval, not at an end.
        """
        system = self.system.with_share(SHARE)
        follower = Follower(system, self.limits, self.options, self.on_point)
        interruption: KeyboardInterrupt | None = None
        try:
            path = follower.run(start, up)
        except KeyboardInterrupt as error:
            interruption = error
            path = follower.path("interrupted", "by the user")
        self.meter.count(path.iterations, path.failed_steps)
        number = self.new_branch if branch is None else branch
        self.pieces.append(Piece(path, up, number, inside))
        if interruption is not None:
            raise interruption
        return path

    def drop_repeated(self) -> None:
        """Remove pieces that start at the end of the last path, which contains the same branch."""
        last = self.pieces[-1]
        if last.path.status != "complete":
            return
        end = last.path.points[-1]
        for piece in self.pieces[:-1]:
            from_an_end = piece.path.points and not piece.inside
            if from_an_end and _same(end.y, piece.path.points[0]):
                self.pieces.remove(piece)
                self.pieces[-1] = replace(last, branch=piece.branch)

    def both_ways(self, start: NDArray) -> None:
        """Add the branch through a solution within the interval, followed in both directions."""
        branch = self.new_branch
        for up in (True, False):
            path = self.follow(start, up, branch, inside=True)
            # a closed branch has no other way
            if path.status == "closed":
                return

    # ---- outside the interval ----

    @property
    def outside(self) -> tuple[float, float]:
        """Interval (rad/s) in which branches are followed to folds where they return."""
        low, high = self.limits
        margin = OUTSIDE * (high - low)
        lowest_resonance, highest_resonance = self.reach or self.limits
        # a wide margin may not lead to negative frequencies
        bottom = min(lowest_resonance, max(low - margin, 0.5 * low))
        top = max(highest_resonance, high + margin)
        return bottom, top

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
        # coarse steps find the folds, and these points are not part of the curve
        outside = replace(
            self.options, locate=False, max_points=SIDE_POINTS, step=0.5, max_step=1.0
        )
        examined: list[Correction] = []
        while not self.system.spent:
            end = self._end_at_bound(examined)
            if end is None:
                return
            examined.append(end)
            up = end.parameter == high
            limits = (high, top) if up else (bottom, low)
            follower = Follower(self.system.with_share(SHARE), limits, outside)
            path = follower.run(end.y, up)
            self.meter.count(path.iterations, path.failed_steps)
            last = path.points[-1] if path.points else end
            if path.status not in ARRIVED:
                frequency = float(last.parameter) / TWO_PI
                why = f"outside the interval, {path.status}: {path.reason}"
                self.lost.append(LeftOut(frequency, frequency, why))
            if path.status != "turned back" or _is_among(last.y, examined):
                continue
            examined.append(last)
            self.note(last.parameter, "the branch turns outside the interval and comes back")
            leaves_forward = self._leaves_forward(end)
            self.follow(last.y, not up)
            # the flag refers to the direction of the branch, and an end may be its first point
            of_branch = up if leaves_forward else not up
            self.pieces[-1] = replace(self.pieces[-1], up=of_branch)

    def _end_at_bound(self, examined: Sequence[Correction]) -> Correction | None:
        """Return an end of a path at a bound of the interval that was not examined yet."""
        for piece in self.pieces:
            if piece.path.status not in ARRIVED:
                continue
            for end in (piece.path.points[0], piece.path.points[-1]):
                if end.parameter in self.limits and not _is_among(end.y, examined):
                    return end
        return None

    def _leaves_forward(self, end: Correction) -> bool:
        """Return whether the tangent at an end of a path points in the direction of its piece."""
        tangent_points_up = bool(end.tangent[-1] > 0.0)
        for piece in self.pieces:
            if any(point is end for point in piece.path.points):
                return tangent_points_up == piece.up
        raise AssertionError("the end is a point of a path")

    # ---- gaps ----

    def fill(self, find_start: FindStart) -> None:
        """Find solutions in gaps, the widest first, and follow them in both directions.

        Newton's method with line search starts from neighbouring solutions at several positions in
        the gap, then from the methods for the first point.  A gap without a solution remains.
        """
        if self.finished:
            return
        without_solution: set[tuple[float, float]] = set()
        while not self.system.spent:
            gaps = uncovered(self.pieces, *self.limits)
            to_search = [gap for gap in gaps if gap not in without_solution]
            if not to_search:
                return
            widest = max(to_search, key=_width)
            solution = self._within(widest, find_start)
            if solution is None:
                without_solution.add(widest)
                continue
            self.note(solution[-1], "started from a solution within a gap")
            self.both_ways(solution)

    def _within(self, gap: tuple[float, float], find_start: FindStart) -> NDArray | None:
        """Return a solution in a gap, or None."""
        low, high = gap
        points = [point for piece in self.pieces for point in piece.path.points]
        positions = [low + part * (high - low) for part in POSITIONS]
        for omega in positions:
            nearest_first = sorted(points, key=lambda point: abs(point.parameter - omega))
            # every eighth of the 40 nearest, because neighbours lead to the same solution
            for point in nearest_first[:40:8]:
                solution = self.system.correct_at(
                    point.y[:-1],
                    omega,
                    point.scale,
                    self.options.tolerance,
                    max_iterations=30,
                    line_search=1,
                )
                self.meter.count(solution.iterations)
                if solution.status == OK:
                    return solution.y
        for omega in positions:
            start = find_start(omega)
            if start is not None:
                return start
        return None


def _same(y: NDArray, point: Correction) -> bool:
    """Return whether a point at the same frequency differs by no more than rounding."""
    if y[-1] != point.parameter:
        return False
    return bool(np.linalg.norm((y - point.y) / point.scale) < 1e-6)


def _is_among(y: NDArray, points: Sequence[Correction]) -> bool:
    return any(_same(y, point) for point in points)


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
    system: Equations[SectorData],
    state: PreloadState,
    springs: NDArray,
    omega: float,
    options: ContinuationOptions,
    meter: CostMeter,
) -> tuple[NDArray | None, list[str], NDArray]:
    """Compute a solution at one frequency.

    Parameters
    ----------
    system : Equations[SectorData]
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
    mean = state.q[: system.n_mean]
    stuck = system.structure.linear.response(omega, springs)
    start = system.layout.pack(mean, stuck)
    last = np.append(start, omega)
    scale = system.units(last, width=omega)
    for name, line_search, max_iterations in (
        ("Newton", 0, 20),
        ("Newton with line search", 1, 60),
    ):
        if system.spent:
            break
        trial = system.correct_at(
            start, omega, scale, options.tolerance, max_iterations, line_search
        )
        meter.count(trial.iterations)
        outcome = f"{STATUS_TEXT[trial.status]}, {trial.iterations} iterations"
        log.append(f"{name} from the stuck response: {outcome}")
        last = trial.y
        if trial.status == OK:
            return trial.y, log, last
    solution: NDArray | None = None
    if not system.spent:
        solution = _by_homotopy(system, omega, options, meter, log, mean, stuck)
    if solution is None and system.spent:
        log.append("the budget of evaluations is used up")
    return solution, log, last


def _by_homotopy(
    system: Equations[SectorData],
    omega: float,
    options: ContinuationOptions,
    meter: CostMeter,
    log: list[str],
    mean: NDArray,
    stuck: NDArray,
) -> NDArray | None:
    """Raise the excitation to its full level; if this fails, fade out a support of the free bodies.

    Free bodies on the support (all bodies, if none is free) neither bounce nor drift.  ``mean`` and
    ``stuck`` are the modal coordinates of the static state and of the first harmonic in stick at
    full excitation.  Return the solution (n_unknowns + 1,), or None.
    """
    # initial level of the excitation for the support; a tenth of it for the ramp.  With the same
    # level the ramp fails on wedge dampers of eight sectors if the excitation equals the preload;
    # with a tenth of it the support fails on one of two random structures that need it
    support_level = 1e-2
    ramp_level = 0.1 * support_level
    # in both homotopies the parameter, the last unknown, is the level instead of the frequency
    start = np.append(system.layout.pack(mean, ramp_level * stuck), ramp_level)
    path = _homotopy(excitation_ramp(system, omega), start, options, meter)
    if path.status == "complete":
        log.append(f"excitation ramp: full level after {len(path.points)} steps")
        at_full_level = path.points[-1].y[:-1]
        return np.append(at_full_level, omega)
    reached = "no excitation"
    if path.points:
        level = path.points[-1].parameter
        reached = f"{100 * level:.3g} %"
    why = path.reason if path.reason == DRIFTED_OFF else path.status
    log.append(f"excitation ramp: stopped at {reached} ({why})")
    if system.spent:
        return None
    supported = supported_by(system, omega, DRAG, SPRING)
    u = system.layout.pack(mean, support_level * stuck)
    scale = np.full(len(u) + 1, max(float(np.linalg.norm(u)), 1e-300))
    on_support = supported.correct_at(
        u, support_level, scale, options.tolerance, max_iterations=60, line_search=1
    )
    meter.count(on_support.iterations)
    if on_support.status != OK:
        log.append(f"fading supports: {STATUS_TEXT[on_support.status]} on the supports")
        return None
    path = _homotopy(supported, on_support.y, replace(options, patience=SIDE_POINTS), meter)
    if path.status == "complete":
        log.append(f"fading supports: removed after {counted(len(path.points), 'step')}")
        without_support = path.points[-1].y[:-1]
        return np.append(without_support, omega)
    why = "the bodies drift away" if path.status == "drifted off" else path.status
    log.append(
        f"fading supports: not removed after {len(path.points)} of {SIDE_POINTS} points ({why})"
    )
    return None


def _homotopy(
    system: Equations[SectorData], start: NDArray, options: ContinuationOptions, meter: CostMeter
) -> Path:
    """Follow the curve in the last unknown, from its initial value to 1."""
    level = float(start[-1])
    without_events = replace(options, locate=False, max_points=SIDE_POINTS)
    path = follow(system, start, (0.5 * level, 1.0), options=without_events)
    meter.count(path.iterations, path.failed_steps)
    return path
