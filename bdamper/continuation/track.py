"""A tracking curve of a study: all branches that are found over a frequency interval at one preload.

From the end where it starts; from the other end if it does not lead through; from within what is then left; on demand from
solutions at other preloads, which may lie on branches apart.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.linear import linear_resonances
from bdamper.continuation.coverage import TWO_PI, LeftOut, Piece, ending, in_order
from bdamper.continuation.curve import Curve, passing
from bdamper.continuation.follower import ContinuationOptions, Path
from bdamper.continuation.mean_position import notes
from bdamper.continuation.search import EVERY_VISIT, BranchSearch, Visits
from bdamper.continuation.start import NOT_CLIMBED, NOT_LET_IN, PROMISING, SUPPORTS, WALKS, Aids
from bdamper.util.cost import Cost, CostMeter
from bdamper.util.progress import progress_bar

if TYPE_CHECKING:
    from bdamper.study import Study

CLIMBS = 4
"""Times that harmonics may be let in one by one in vain before that is given up for a curve."""
LETTINGS_IN = 12
"""The same of the highest harmonic alone, from solutions without it."""
VISIT_PROMISING, VISIT_FEWER, VISIT_REST, VISIT_CLIMBING = 0, 1, 2, 2
"""Visits of a narrow gap, from 0, on which ways that take long are tried: longer paths of bodies let go from the supports
that promise most; the highest harmonic let in (where it is not, the next way already); longer paths from the others, and
one harmonic let in after the other.  The ends of the interval and wide gaps, which have one visit, get all at once."""


def track_curve(
    study: Study,
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
    state = study.static(preload)
    if not state.converged:
        return _without_points(study, preload, f"static state: {state.note}", options, state.cost)
    low, high = limits = TWO_PI * frequency[0], TWO_PI * frequency[1]
    system = study.system(preload)
    system.watched = linear_resonances(system, (None, study._stuck_springs(state)), low, high)
    search = BranchSearch(system, limits, options, CostMeter(time.perf_counter()))
    search.meter.watch(system)
    try:
        with progress_bar(progress, low, high) as search.on_point:
            for at_high in (from_high, not from_high):
                _from_end(study, preload, search, high if at_high else low, guesses)
                search.leap()
                search.beyond_ends()
                if search.finished:
                    break
            fewer = _Fewer(study, preload, frequency, options, search.meter) if len(study.harmonic_numbers) > 1 else None
            search.fill(lambda omega, visits: _start(study, preload, search, omega, guesses, fewer, visits))
            if ratios:
                for start in search.new_solutions(_other_starts(study, preload, ratios, search)):
                    search.log.append(f"{start[-1] / TWO_PI:.6g} Hz: a solution apart from the branches so far")
                    search.both_ways(start)
    except KeyboardInterrupt:
        if not any(piece.path.status == "interrupted" for piece in search.pieces):
            search.pieces.append(Piece(Path((), "interrupted", "by the user", 0, 0), True))
    status, reason, left_out = ending(search.pieces, low, high)
    if status in ("incomplete", "no start"):
        if any(WALKS in line for line in search.log):
            reason += f"; bodies that were held and let go {WALKS}, constraint planes would hold them"
        if 0.0 < preload < 2.0 * study.excitation.amplitude:
            ratio = preload / study.excitation.amplitude
            reason += f"; at a preload of {ratio:.2g} times the excitation dampers are thrown about: raise it"
        if any(piece.path.points for piece in search.pieces):
            reason += "; study.settle(curve) marches in time where no solution was found"
    return _curve(study, search, (status, reason, left_out), preload)


class _Fewer:
    """Solutions of a study without its highest harmonic, from a tracking curve that is followed when they are asked for.

    Where a curve runs into a tangle, that with one harmonic fewer often passes; it may have a tangle of its own elsewhere.
    The study has more than one harmonic.
    """

    def __init__(
        self, study: Study, preload: float, frequency: tuple[float, float], options: ContinuationOptions, meter: CostMeter
    ) -> None:
        self._asked = study, preload, frequency, replace(options, locate=False)
        self._meter = meter
        self._curve: Curve | None = None

    def __call__(self, omega: float) -> list[NDArray]:
        if self._curve is None:
            study, preload, frequency, options = self._asked
            self._curve = track_curve(
                study.without_highest_harmonic(), preload, frequency, from_high=False, options=options, progress=False,
                ratios=(),
            )  # fmt: skip
            self._meter.add(self._curve.cost)
            if self._curve.status == "interrupted":
                raise KeyboardInterrupt
        return passing(self._curve, omega)


def _start(
    study: Study,
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
    start, tried = study.find_start(preload, omega, search.options, search.meter, aids)
    search.log += [f"{omega / TWO_PI:.6g} Hz: {line}" for line in tried]
    return start


def _from_end(
    study: Study,
    preload: float,
    search: BranchSearch,
    omega: float,
    guesses: Callable[[float], list[NDArray]] | None = None,
) -> None:
    """The branch through the solution that the chain finds at an end of the interval."""
    up = omega == search.limits[0]
    start = _start(study, preload, search, omega, guesses)
    if start is None:
        search.pieces.append(Piece(Path((), "no start", search.log[-1], 0, 0), up))
    else:
        search.from_end(start, up)


def _other_starts(study: Study, preload: float, ratios: Sequence[float], search: BranchSearch) -> list[NDArray]:
    """Solutions at other preloads, spread over the frequency interval."""
    out: list[NDArray] = []
    for other in (ratio * preload for ratio in ratios):
        if not study.static(other).converged:
            continue
        options = replace(search.options, locate=False)
        elsewhere = BranchSearch(study.system(other), search.limits, options, search.meter)
        search.meter.watch(elsewhere.system)
        _from_end(study, other, elsewhere, search.limits[0])
        points = [p for piece in elsewhere.pieces for p in piece.path.points]
        out += [p.y for p in points[:: max(1, len(points) // 40)]]
    return out


def _without_points(study: Study, preload: float, reason: str, options: ContinuationOptions, cost: Cost) -> Curve:
    """Where there is not even a static state."""
    return Curve(
        kind="tracking",
        frequency=np.zeros(0),
        harmonics=np.zeros((0, len(study.bases)), complex),
        unknowns=np.zeros((0, study.n_unknowns)),
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
        settings=study._settings(options),
        model_hash=study.model.hash,
        start_log=(reason,),
    )


def _curve(
    study: Study, search: BranchSearch, end: tuple[str, str, tuple[LeftOut, ...]], preload: float
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
        settings=study._settings(search.options),
        model_hash=study.model.hash,
        start_log=tuple(search.log),
        notes=notes(system, study.coupling.model, study.bases[0].coordinates, points)
        + tuple(f"{name} is self-locking: its static normal load is not unique" for name in study.self_locking),
    )
