"""A response curve: all branches that are found over a frequency interval at one preload.

From the end where it starts; from the other end if it does not lead through; beyond both ends as far as the free and the
stuck resonance, where a branch may turn and come back; from within what is then left, within a budget of evaluations.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.law_codes import LAW_BONDED
from bdamper.harmonic_balance.equations import NOT_FINITE, STATUS_TEXT
from bdamper.harmonic_balance.linear_limits import reach
from bdamper.harmonic_balance.problem import Problem, stuck_springs
from bdamper.response.branches import Coverage, LeftOut, Piece, ending, evaluation_budget, in_order
from bdamper.response.continuation import OUT_OF_BUDGET, TWO_PI
from bdamper.response.continuation_options import ContinuationOptions, Path
from bdamper.response.curve import ResponseCurve
from bdamper.response.initial_solution import first_point
from bdamper.response.mean_position import notes, why_no_solution
from bdamper.response.rattle_detection import NO_STEADY, open_at_rest, rattles
from bdamper.response.zero_preload import free_of_contact
from bdamper.util import validation
from bdamper.util.cost import Cost, CostMeter
from bdamper.util.errors import SettingError
from bdamper.util.progress import passes_interrupts_on, progress_bar
from bdamper.util.status import INCOMPLETE, NOT_FOUND
from bdamper.util.threading import single_thread

ELASTIC = 1e-3
"""Of the lowest frequency of a curve: resonances below it are rigid motions, or too far away."""


def frequency_response(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    options: ContinuationOptions | None = None,
    progress: bool = False,
) -> ResponseCurve:
    """Response curve: the response over a frequency interval at one preload, with all branches on the way.

    Parameters
    ----------
    problem : Problem
    preload : float, N
        Radial load on the damper; without one the curve is the free response wherever nothing else holds the damper.
    frequency : (low, high), Hz
    options : ContinuationOptions
    progress : bool
        Show a progress bar.

    Returns
    -------
    ResponseCurve
        ``status`` is "complete" if its branches span the interval; otherwise ``reason`` says why not, and the points
        found so far are there, and in any case what was looked for.  A branch that does not reach the other end is
        complemented by one from there.
    """
    preload, frequency = problem.check_preload(preload), validation.interval("frequency", frequency)
    validation.flag("progress", progress)
    options = ContinuationOptions() if options is None else validation.instance("options", options, ContinuationOptions)
    with single_thread():
        state = problem.static(preload)
        if not state.converged:
            reason = f"static state: {state.note}"
            return without_points(problem, preload, reason, options, state.cost)
        free = free_of_contact(problem, frequency, options) if preload == 0.0 else None
        if free is not None:
            return free
        search = _search(problem, preload, frequency, options)
        find_start = partial(_start, problem, preload, search)
        try:
            with progress_bar(progress, *search.limits) as search.on_point:
                search.cover(find_start)
        except KeyboardInterrupt:
            if passes_interrupts_on():
                raise
            if not any(piece.path.status == "interrupted" for piece in search.pieces):
                search.pieces.append(Piece(Path((), "interrupted", "by the user", 0, 0), True))
        curve = as_curve(problem, search, ending(search.pieces, *search.limits), kind="tracking", preload=preload)
        if problem.own_laws is not None and len(curve):
            problem.own_laws.warn_below(search.system.contact(curve.unknowns[curve.peak.index])[0])
        locked = (f"{name} is self-locking: its static normal load is not unique" for name in self_locking(problem))
        reason, left_out = _explained(problem, search, curve), (*curve.missing_ranges, *search.lost)
        return replace(curve, reason=reason, missing_ranges=left_out, notes=(*curve.notes, *locked))


def _search(problem: Problem, preload: float, frequency: tuple[float, float], options: ContinuationOptions) -> Coverage:
    """What is to be followed, with its budget."""
    low, high = TWO_PI * frequency[0], TWO_PI * frequency[1]
    system = problem.system(preload)
    budget = options.budget or evaluation_budget(system)
    springs = None, stuck_springs(problem, problem.static(preload))
    free, stuck = (system.structure.linear.resonances((k,), ELASTIC * low, np.inf) for k in springs)
    watched = [there for there in (*free, *stuck) if low < there[0] < high]
    system = replace(system.within(budget), watched=watched)
    search = Coverage(system, (low, high), replace(options, budget=budget), CostMeter())
    search.reach = reach([w for w, *_ in free], [w for w, *_ in stuck], low, high)
    search.meter.watch(system)
    return search


def _start(problem: Problem, preload: float, search: Coverage, omega: float) -> NDArray | None:
    """A solution at one frequency (rad/s); the log of the search says how."""
    state = problem.static(preload)
    found, tried, last = first_point(
        search.system, state, stuck_springs(problem, state), omega, search.options, search.meter
    )
    why = ""
    if found is None and not search.system.spent:
        why = why_no_solution(search.system, problem.coupling.model, problem.bases[0].coordinates, last)
    for line in [*tried, why] if why else tried:
        search.note(omega, line)
    return found


def _explained(problem: Problem, search: Coverage, curve: ResponseCurve) -> str:
    """The reason of a curve with what was looked for, and advice where it is not complete."""
    reason = curve.reason
    if curve.complete:
        bottom, top = (w / TWO_PI for w in search.outside)
        broken = ", where a path broke off (left_out)" if search.lost else ""
        reason += f"; folds looked for from {bottom:.4g} to {top:.4g} Hz{broken}, closed branches not"
    if why := rattles(curve, open_at_rest(problem, curve.preload)):
        reason += f"; {NO_STEADY} is expected at this preload: {why}"
    if curve.status not in (INCOMPLETE, NOT_FOUND):
        return reason
    if search.system.spent or any(piece.path.status == OUT_OF_BUDGET for piece in search.pieces):
        reason += f"; the budget was {search.options.budget} evaluations (ContinuationOptions.budget)"
    if problem.own_laws is not None and STATUS_TEXT[NOT_FINITE] in reason:
        reason += f"; forces of {problem.own_laws.names} may not be finite there, or not settle"
    force = problem.settings.excitation.amplitude
    if 0.0 < curve.preload < 2.0 * force:
        ratio = curve.preload / force
        reason += f"; a preload of {ratio:.2g} times the excitation does not keep the damper in its seat: raise it"
    return f"{reason}; study.settle marches in time where no solution was found"


def without_points(
    problem: Problem, preload: float, reason: str, options: ContinuationOptions, cost: Cost
) -> ResponseCurve:
    """An empty curve, for preloads without static equilibrium."""
    return ResponseCurve(
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
        status=NOT_FOUND,
        reason=reason,
        cost=cost,
        **problem.recorded(options),
        start_log=(reason,),
    )


def as_curve(problem: Problem, search: Coverage, ended: tuple[str, str, tuple[LeftOut, ...]], **own: Any) -> ResponseCurve:
    """The curve of what was followed.

    Parameters
    ----------
    problem : Problem
    search : Coverage
    ended : tuple
        Status, reason, and what was left out.
    **own
        Kind, preload, and fields that other curves leave out.
    """
    system, ordered = search.system, in_order(search.pieces)
    points = [p for p, _ in ordered]
    y = np.array([p.y for p in points]).reshape(len(points), system.n_unknowns + 1)
    onward = [p.tangent[-1] * (1.0 if way.up else -1.0) for p, way in ordered]
    backward = np.array([p.kind != "drift" and to < 0.0 for p, to in zip(points, onward)], bool)
    return ResponseCurve(
        frequency=y[:, -1] / TWO_PI,
        harmonics=system.response(y[:, :-1]),
        unknowns=y[:, :-1],
        residual=np.array([p.residual for p in points]),
        shares=np.array([p.shares for p in points]).reshape(-1, 3),
        backward=backward,
        rank_deficiency=np.array([p.rank_deficiency for p in points], int),
        branch=np.array([way.branch for _, way in ordered], int),
        closed=tuple(sorted({piece.branch for piece in search.pieces if piece.path.status == "closed"})),
        point_kind=tuple(p.kind for p in points),
        status=ended[0],
        reason=ended[1],
        missing_ranges=ended[2],
        cost=search.meter.read(),
        start_log=tuple(search.log),
        notes=() if "blades" in own else notes(system, problem.coupling.model, problem.bases[0].coordinates, points),
        **own,
        **problem.recorded(search.options),
    )


def check_curve(problem: Problem, curve: ResponseCurve, name: str = "curve") -> None:
    """Refuse what is no response curve of this problem."""
    validation.instance(name, curve, ResponseCurve, "a response curve")
    validation.require(curve.kind == "tracking", name, "a response curve (study.frequency_response)",
        f"a {curve.kind} curve")
    validation.require(curve.model_hash == problem.model.hash, name, "one of this model", "one of another")
    system = problem.system(curve.preload)
    n = system.n_unknowns
    validation.require(curve.unknowns.shape[1] == n, name, f"one of this study with {n} unknowns", curve.unknowns.shape[1])
    if not len(curve):
        return
    i = curve.peak.index
    error = system.error(np.append(curve.unknowns[i], TWO_PI * curve.frequency[i]))
    found = f"one with other settings (residual {error:.2g} at its peak)"
    validation.require(error <= max(1e-6, 100.0 * float(curve.residual[i])), name, "one of this study", found)


def self_locking(problem: Problem) -> tuple[str, ...]:
    """Bodies that friction alone holds between their faces, so that their static normal load is not unique.

    Those for which :meth:`Problem.wedge_friction` finds no upper bound of the normal force.
    """
    try:
        found = problem.wedge_friction()
    except SettingError:  # no free body has a load, or nothing holds it
        return ()
    faces = [name for name, high in zip(found.interfaces, found.highest) if np.isinf(high)]
    holders = {problem.coupling.model.interfaces[name].body_a for name in faces}
    springs = {name for name, law in problem.settings.law_by_interface().items() if law == LAW_BONDED}
    holders -= {problem.coupling.model.interfaces[name].body_a for name in springs}
    return tuple(body.name for body in problem.model.bodies.values() if body.load is not None and body.name in holders)
