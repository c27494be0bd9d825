"""A tracking curve of a study: all branches that are found over a frequency interval at one preload.

From the end where it starts; from the other end if it does not lead through; from within what is then left; on demand from
solutions at other preloads, which may lie on branches apart.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.linear import linear_resonances
from bdamper.continuation.coverage import TWO_PI, LeftOut, Piece, ending, in_order
from bdamper.continuation.curve import Curve, passing
from bdamper.continuation.follower import ContinuationOptions, Path
from bdamper.continuation.mean_position import notes, why_no_solution
from bdamper.continuation.search import EVERY_VISIT, BranchSearch, Visits
from bdamper.continuation.start import NO_AIDS, NOT_CLIMBED, NOT_LET_IN, PROMISING, SUPPORTS, WALKS, Aids, first_point
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, CostMeter
from bdamper.util.errors import SettingError
from bdamper.util.progress import progress_bar

CLIMBS = 4
"""Times that harmonics may be let in one by one in vain before that is given up for a curve."""
LETTINGS_IN = 12
"""The same of the highest harmonic alone, from solutions without it."""
VISIT_PROMISING, VISIT_FEWER, VISIT_REST, VISIT_CLIMBING = 0, 1, 2, 2
"""Visits of a narrow gap, from 0, on which ways that take long are tried: longer paths of bodies let go from the supports
that promise most; the highest harmonic let in (where it is not, the next way already); longer paths from the others, and
one harmonic let in after the other.  The ends of the interval and wide gaps, which have one visit, get all at once."""


@one_thread
def track(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    from_high: bool = False,
    options: ContinuationOptions | None = None,
    progress: bool = False,
    search_branches: bool | Sequence[float] = False,
) -> Curve:
    """Tracking curve: the response over a frequency interval at one preload, with all branches on the way.

    Parameters
    ----------
    problem : Problem
    preload : float, N
        Radial load on the damper.
    frequency : (low, high), Hz
    from_high : bool
        Set off from the upper end.
    options : ContinuationOptions
    progress : bool
        Show a progress bar.
    search_branches : bool or sequence of float
        Look for branches apart from the one that is followed, with solutions at other preloads as starts: ratios to
        the preload, 0.9 and 1.2 by default.
    Returns
    -------
    Curve
        ``status`` is "complete" if its branches span the interval; otherwise ``reason`` says why not, and the points
        found so far are there.  A branch that does not reach the other end is complemented by one from there.
    """
    preload, frequency = problem.check_preload(preload), validate.interval("frequency", frequency)
    for name, value in (("from_high", from_high), ("progress", progress)):
        validate.flag(name, value)
    ratios: tuple[float, ...] = (0.9, 1.2) if search_branches is True else ()
    if not isinstance(search_branches, bool):
        ratios = tuple(validate.numbers("search_branches, ratios to the preload", search_branches, above=0.0).tolist())
    if options is not None:
        validate.instance("options", options, ContinuationOptions)
    return track_curve(
        problem, preload, frequency, from_high=from_high, options=options or ContinuationOptions(), progress=progress,
        ratios=ratios,
    )  # fmt: skip


@one_thread
def find_start(
    problem: Problem, preload: float, omega: float, options: ContinuationOptions, meter: CostMeter, aids: Aids = NO_AIDS
) -> tuple[NDArray | None, list[str]]:
    """A solution at one frequency (rad/s); see :func:`bdamper.continuation.start.first_point`.

    Returns
    -------
    (n_unknowns + 1,) float or None, and what was tried
    """
    state = problem.static(preload)
    if not state.converged:
        return None, [f"static state: {state.note}"]
    system = problem.system(preload)
    meter.watch(system)
    found, log, last = first_point(system, state, problem.stuck_springs(state), omega, options, meter, aids)
    why = why_no_solution(system, problem.coupling.model, problem.bases[0].coordinates, last) if found is None else ""
    return found, [*log, why] if why else log


def track_curve(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    from_high: bool,
    options: ContinuationOptions,
    progress: bool,
    ratios: Sequence[float],
    guesses: Callable[[float], list[NDArray]] | None = None,
) -> Curve:
    """The tracking curve under given settings; :meth:`bdamper.Study.track` explains the arguments.

    Parameters
    ----------
    ratios : sequence of float
        Of the other preloads, whose solutions are starts for branches apart, to this one.
    guesses : callable, optional
        Of solutions at a frequency (rad/s), (n_unknowns,) each.
    """
    state = problem.static(preload)
    if not state.converged:
        return _without_points(problem, preload, f"static state: {state.note}", options, state.cost)
    low, high = limits = TWO_PI * frequency[0], TWO_PI * frequency[1]
    system = problem.system(preload)
    system.watched = linear_resonances(system, (None, problem.stuck_springs(state)), low, high)
    search = BranchSearch(system, limits, options, CostMeter(time.perf_counter()))
    search.meter.watch(system)
    try:
        with progress_bar(progress, low, high) as search.on_point:
            for at_high in (from_high, not from_high):
                _from_end(problem, preload, search, high if at_high else low, guesses)
                search.leap()
                search.beyond_ends()
                if search.finished:
                    break
            several = len(problem.harmonic_numbers) > 1
            fewer = _Fewer(problem, preload, frequency, options, search.meter) if several else None
            search.fill(lambda omega, visits: _start(problem, preload, search, omega, guesses, fewer, visits))
            if ratios:
                for start in search.new_solutions(_other_starts(problem, preload, ratios, search)):
                    search.log.append(f"{start[-1] / TWO_PI:.6g} Hz: a solution apart from the branches so far")
                    search.both_ways(start)
    except KeyboardInterrupt:
        if not any(piece.path.status == "interrupted" for piece in search.pieces):
            search.pieces.append(Piece(Path((), "interrupted", "by the user", 0, 0), True))
    status, reason, left_out = ending(search.pieces, low, high)
    if status in ("incomplete", "no start"):
        if any(WALKS in line for line in search.log):
            reason += f"; bodies that were held and let go {WALKS}, constraint planes would hold them"
        if 0.0 < preload < 2.0 * problem.excitation.amplitude:
            ratio = preload / problem.excitation.amplitude
            reason += f"; at a preload of {ratio:.2g} times the excitation dampers are thrown about: raise it"
        if any(piece.path.points for piece in search.pieces):
            reason += "; study.settle(curve) marches in time where no solution was found"
    return _curve(problem, search, (status, reason, left_out), preload)


class _Fewer:
    """Solutions of a study without its highest harmonic, from a tracking curve that is followed when they are asked for.

    Where a curve runs into a tangle, that with one harmonic fewer often passes; it may have a tangle of its own elsewhere.
    The study has more than one harmonic.
    """

    def __init__(
        self,
        problem: Problem,
        preload: float,
        frequency: tuple[float, float],
        options: ContinuationOptions,
        meter: CostMeter,
    ) -> None:
        self._asked = problem, preload, frequency, replace(options, locate=False)
        self._meter = meter
        self._curve: Curve | None = None

    def __call__(self, omega: float) -> list[NDArray]:
        if self._curve is None:
            problem, preload, frequency, options = self._asked
            self._curve = track_curve(
                problem.with_(harmonics=problem.harmonic_numbers[:-1]), preload, frequency, from_high=False,
                options=options, progress=False,
                ratios=(),
            )  # fmt: skip
            self._meter.add(self._curve.cost)
            if self._curve.status == "interrupted":
                raise KeyboardInterrupt
        return passing(self._curve, omega)


def _start(
    problem: Problem,
    preload: float,
    search: BranchSearch,
    omega: float,
    guesses: Callable[[float], list[NDArray]] | None = None,
    fewer: _Fewer | None = None,
    visits: Visits = EVERY_VISIT,
) -> NDArray | None:
    """A solution at one frequency; ways that take minutes only on the visits that are meant for them."""
    climbed, let_in = (sum(vain in line for line in search.log) for vain in (NOT_CLIMBED, NOT_LET_IN))
    letting_in = fewer is not None and let_in < LETTINGS_IN
    visit_rest = VISIT_REST if letting_in else VISIT_FEWER
    aids = Aids(
        guesses,
        fewer if VISIT_FEWER in visits and letting_in else None,
        climbing=VISIT_CLIMBING in visits and climbed < CLIMBS,
        longer=[by for by in SUPPORTS if (VISIT_PROMISING if by in PROMISING else visit_rest) in visits],
        completing=search.limits[0] < omega < search.limits[1],
    )
    start, tried = find_start(problem, preload, omega, search.options, search.meter, aids)
    search.log += [f"{omega / TWO_PI:.6g} Hz: {line}" for line in tried]
    return start


def _from_end(
    problem: Problem,
    preload: float,
    search: BranchSearch,
    omega: float,
    guesses: Callable[[float], list[NDArray]] | None = None,
) -> None:
    """The branch through the solution that the chain finds at an end of the interval."""
    up = omega == search.limits[0]
    start = _start(problem, preload, search, omega, guesses)
    if start is None:
        search.pieces.append(Piece(Path((), "no start", search.log[-1], 0, 0), up))
    else:
        search.from_end(start, up)


def _other_starts(problem: Problem, preload: float, ratios: Sequence[float], search: BranchSearch) -> list[NDArray]:
    """Solutions at other preloads, spread over the frequency interval."""
    out: list[NDArray] = []
    for other in (ratio * preload for ratio in ratios):
        if not problem.static(other).converged:
            continue
        options = replace(search.options, locate=False)
        elsewhere = BranchSearch(problem.system(other), search.limits, options, search.meter)
        search.meter.watch(elsewhere.system)
        _from_end(problem, other, elsewhere, search.limits[0])
        points = [p for piece in elsewhere.pieces for p in piece.path.points]
        out += [p.y for p in points[:: max(1, len(points) // 40)]]
    return out


def _without_points(problem: Problem, preload: float, reason: str, options: ContinuationOptions, cost: Cost) -> Curve:
    """Where there is not even a static state."""
    return Curve(
        kind="tracking",
        frequency=np.zeros(0),
        harmonics=np.zeros((0, len(problem.bases)), complex),
        unknowns=np.zeros((0, problem.n_unknowns)),
        residual=np.zeros(0),
        shares=np.zeros((0, 3)),
        backward=np.zeros(0, bool),
        rank_deficiency=np.zeros(0, int),
        branch=np.zeros(0, int),
        point_kind=(),
        preload=preload,
        status="no start",
        reason=reason,
        cost=cost,
        settings=problem.record(options),
        model_hash=problem.model.hash,
        start_log=(reason,),
    )


def _curve(
    problem: Problem, search: BranchSearch, end: tuple[str, str, tuple[LeftOut, ...]], preload: float
) -> Curve:
    system, ordered = search.system, in_order(search.pieces)
    points = [p for p, _ in ordered]
    y = np.array([p.y for p in points]).reshape(len(points), system.n_unknowns + 1)
    onward = [p.tangent[-1] * (1.0 if way.up else -1.0) for p, way in ordered]
    backward = np.array([p.kind != "walk" and to < 0.0 for p, to in zip(points, onward)], bool)
    return Curve(
        kind="tracking",
        frequency=y[:, -1] / TWO_PI,
        harmonics=system.response(y[:, :-1]),
        unknowns=y[:, :-1],
        residual=np.array([p.residual for p in points]),
        shares=np.array([p.shares for p in points]).reshape(-1, 3),
        backward=backward,
        rank_deficiency=np.array([p.rank_deficiency for p in points], int),
        branch=np.array([way.branch for _, way in ordered], int),
        point_kind=tuple(p.kind for p in points),
        preload=preload,
        status=end[0],
        reason=end[1],
        left_out=end[2],
        cost=search.meter.read(time.perf_counter()),
        settings=problem.record(search.options),
        model_hash=problem.model.hash,
        start_log=tuple(search.log),
        notes=notes(system, problem.coupling.model, problem.bases[0].coordinates, points)
        + tuple(f"{name} is self-locking: its static normal load is not unique" for name in problem.self_locking),
    )


def check_curve(problem: Problem, curve: Curve) -> None:
    """Refuse a curve that is no tracking curve of this problem."""
    if curve.kind != "tracking" or curve.model_hash != problem.model.hash:
        raise SettingError("curve: expected a tracking curve of this model, found another")
    system = problem.system(curve.preload)
    n = system.n_unknowns
    if curve.unknowns.shape[1] != n:
        raise SettingError(f"curve: expected one of this study with {n} unknowns, found {curve.unknowns.shape[1]}")
    if not len(curve):
        return
    i = curve.peak.index
    r, _, _ = system.evaluate(curve.unknowns[i], 2.0 * np.pi * float(curve.frequency[i]))
    error = float(np.abs(r * system.row_scale).max())
    if error > max(1e-6, 100.0 * float(curve.residual[i])):
        raise SettingError(
            f"curve: expected one of this study, found one with other settings (residual {error:.2g} at its peak)"
        )
