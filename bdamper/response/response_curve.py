"""Response curve: all branches in a frequency interval at one preload, and its interpretation.

:func:`frequency_response` covers the interval (``bdamper.response.branches``): from its lower end;
from the upper end if the first path does not reach it; beyond both ends up to the free and stuck
resonances, where a branch may turn and return; and in the remaining gaps, within a budget of
evaluations.

**Mean position of the damper.**  The mean position of a free body may drift along a curve at
constant vibration, may be undetermined (the solution then has minimum norm), or may have no
equilibrium; :func:`notes` and :func:`why_no_solution` report it.

**Rattling.**  Under a low preload the damper separates for most of the cycle and lands at different
instants in each period. Harmonic balance then finds many periodic solutions, connected by folds,
and time integration from the highest finds no steady amplitude.  :func:`rattles` detects curves
with many folds and mostly open contacts.  It is an indication, not a proof, and occurs at low
preloads only (docs/evidence/measured-curves.md, *Where a damper rattles*).  It detects 11 of 84 curves; on
none of these, time integration becomes steady within 250 periods.  It misses 18 others on which
time integration does not become steady either.

**No preload.**  A damper that its load would press against its neighbours moves away from them.
With a mean position so far off that no contact point closes in a cycle, the free response satisfies
all equations exactly (:func:`free_of_contact`).

**Slow frequency sweep.**  :func:`sweep_of` starts at one end of the interval on the lowest stable
solution and follows stable points.  Where the branch turns or loses stability the response jumps to
a stable solution at that frequency: the nearest lower one, or the nearest higher one if there is
none.  The motion during a jump is not computed, so among several stable solutions the response may
end on another one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED
from bdamper.harmonic_balance.checks import check_solution, warn_of_small_slip
from bdamper.harmonic_balance.equations import NOT_FINITE, STATUS_TEXT, Correction, Equations
from bdamper.harmonic_balance.problem import LoadCase, Problem
from bdamper.harmonic_balance.sector import SectorData, reach
from bdamper.model.kinematics import Coordinate
from bdamper.model.structure import Interface, Model
from bdamper.response import first_slip
from bdamper.response.branches import (
    Coverage,
    Piece,
    SearchEnd,
    ending,
    evaluation_budget,
    first_point,
    in_order,
)
from bdamper.response.continuation import OUT_OF_BUDGET, TWO_PI
from bdamper.response.events import ContinuationOptions, Path
from bdamper.response.linear_limits import free
from bdamper.response.resolution import unresolved_resonance
from bdamper.response.response_curve_result import (
    LOCKED,
    NO_STEADY,
    SLIPS,
    STICKS,
    ResponseCurve,
    crossed,
    unstable_points,
)
from bdamper.response.shroud_contact import changes_of_contact
from bdamper.util import validation
from bdamper.util.errors import COMPLETE, INCOMPLETE, NOT_FOUND, SettingError
from bdamper.util.formatting import amount, listed, span
from bdamper.util.progress import Cost, CostMeter, is_part_of_work, progress_bar, single_thread

# ---- mean position of free bodies ----


def _displacement(model: Model, coordinate: Coordinate, q: float) -> str:
    """Return the text of a mean coordinate, in metres for a translation of a rigid body."""
    # residual modes belong to no body
    body = model.bodies.get(coordinate.body)
    if body is not None and body.mass is not None and coordinate.name in ("TX", "TY", "TZ"):
        return f"{q / np.sqrt(body.mass):.3g} m"
    return f"{q:.3g} kg^1/2 m"


def _drift_ranges(points: Sequence[Correction]) -> list[tuple[int, int]]:
    """Return first and last index of each run of points at which the mean drifts."""
    ranges: list[tuple[int, int]] = []
    first: int | None = None
    for i, point in enumerate(points):
        is_drift = point.kind == "drift"
        if is_drift and first is None:
            first = i
        if not is_drift and first is not None:
            ranges.append((first, i - 1))
            first = None
    if first is not None:
        ranges.append((first, len(points) - 1))
    return ranges


def notes(
    system: Equations[SectorData],
    model: Model,
    coordinates: Sequence[Coordinate],
    points: Sequence[Correction],
) -> tuple[str, ...]:
    """Describe where the mean position drifts, and where only the minimum norm determines it."""
    texts = []
    for first, last in _drift_ranges(points):
        before = points[max(first - 1, 0)].y
        after = points[last].y
        # the unknowns of the mean are first
        moved = np.abs((after - before)[: system.n_mean])
        largest = int(np.argmax(moved))
        coordinate = coordinates[largest]
        frequency = points[first].parameter / TWO_PI
        start = _displacement(model, coordinate, before[largest])
        end = _displacement(model, coordinate, after[largest])
        texts.append(
            f"{coordinate.body} drifts along {coordinate.name} from {start} to {end} at "
            f"{frequency:.6g} Hz, because the mean force on it is zero there"
        )
    undetermined = [point for point in points if point.rank_deficiency > 0]
    if undetermined:
        # about twenty points show all directions
        step = max(1, len(undetermined) // 20)
        names: set[str] = set()
        for point in undetermined[::step]:
            names.update(neutral_directions(system, coordinates, point.y))
        texts.append(
            f"the mean position along {', '.join(sorted(names))} is not unique at "
            f"{len(undetermined)} points: the one of minimum norm is used"
        )
    return tuple(texts)


def neutral_directions(
    system: Equations[SectorData], coordinates: Sequence[Coordinate], y: NDArray
) -> list[str]:
    """Return the names of the mean coordinates that no equation determines at a solution.

    They dominate the null space of the mean part of the Jacobian.
    """
    n = system.n_mean
    _, J, _ = system.evaluate_at(y)
    # derivatives (n_unknowns, n) with respect to the mean, scaled to columns of size 1
    columns = J[:, :n]
    size = np.abs(columns).max(axis=0)
    # a column of rounding errors must not become one of size 1
    scale = np.where(size > 1e-13 * size.max(), size, size.max())
    _, singular_values, vectors = np.linalg.svd(columns / scale)
    # one value for each of the n right singular vectors (rows)
    singular_values = np.concatenate([singular_values, np.zeros(n - len(singular_values))])
    largest = max(singular_values[0], 1e-300)
    in_null_space = singular_values < 1e-11 * largest
    names = []
    for vector in vectors[in_null_space]:
        motion = vector / scale
        dominant = coordinates[int(np.argmax(np.abs(motion)))]
        names.append(f"{dominant.name} of {dominant.body}")
    return names


def why_no_solution(
    system: Equations[SectorData], model: Model, coordinates: Sequence[Coordinate], y: NDArray
) -> str:
    """Describe the unbalanced mean force on a free body at the last iterate, or return "".

    ``coordinates`` are the coordinates of the mean, which are the first rows of the equations.
    """
    u = y[:-1]
    omega = y[-1]
    try:
        residual, jacobian, _ = system.evaluate(u, omega)
    except FloatingPointError:
        return ""
    _, _, shares = system.contact(u)

    for row, coordinate in enumerate(coordinates):
        # residual modes belong to no body
        body = model.bodies.get(coordinate.body)
        if body is None or body.kind != "free" or body.mass is None:
            continue
        if not coordinate.name.startswith("T"):
            continue
        # a force that no unknown changes cannot be balanced
        unbalanced = abs(residual[row]) * system.row_scale[row] > 1e-6
        stiffness = float(np.abs(jacobian[row]).max())
        without_stiffness = stiffness < 1e-9 * float(np.abs(jacobian).max())
        if not (unbalanced and without_stiffness):
            continue
        # the mode of a translation is 1/sqrt(mass)
        force = float(residual[row]) * np.sqrt(body.mass)
        # the last of the five states is separation
        always_open = shares[:, 4].min() >= 1.0
        if always_open:
            return (
                f"no periodic solution: all contacts of {coordinate.body} are open throughout "
                f"the cycle and a static load of {abs(force):.3g} N acts along {coordinate.name}"
            )
        return (
            f"no periodic solution near here: a mean force of {force:.3g} N along "
            f"{coordinate.name} drives {coordinate.body}, whatever its mean position; it drifts "
            "until a constraint plane carries load, and none does"
        )
    return ""


# ---- rattling damper ----


FOLDS = 14
"""Smallest number of folds of a rattling damper.  With 12 the same 11 of 84 curves are detected,
but an optimal curve ends at 49 N instead of 42 N, and a time integration at 50 N becomes steady.
"""
OPEN = 0.5
"""Smallest fraction of the cycle in separation at the highest response, mean over the friction
points that are closed at rest.

At a rotor speed most points may be open without vibration.  Without this limit three more of the 84
curves are detected, and on one of them the amplitude by time integration is steady.
"""


def open_at_rest(case: LoadCase) -> float:
    """Return the fraction of the friction points that are open in the static state."""
    closed = case.static.force[case.problem.friction_points, 2] > 0.0
    if not closed.any():
        return 0.0
    return 1.0 - float(closed.mean())


def rattles(curve: ResponseCurve, at_rest: float = 0.0) -> str:
    """Return the reason why no steady periodic response is expected at a preload, or "".

    Parameters
    ----------
    curve : ResponseCurve
        Points of different branches are not connected.
    at_rest : float
        Fraction of open points without vibration (:func:`open_at_rest`).
    """
    if len(curve) < FOLDS:
        return ""
    same_branch = np.diff(curve.branch) == 0
    sense = np.sign(np.diff(curve.frequency))[same_branch]
    # the frequency is constant along a drift
    sense = sense[sense != 0.0]
    folds = int(np.count_nonzero(np.diff(sense)))
    # shares are stick, slip, separation
    top = curve.amplitude.argmax()
    opened = float(curve.shares[top, 2])
    # relative to the points that are closed at rest
    mostly_closed = opened - at_rest <= OPEN * (1.0 - at_rest)
    if folds < FOLDS or mostly_closed:
        return ""
    per_cent = f"{100.0 * opened:.0f} %"
    return (
        f"{folds} folds, and the contacts open for {per_cent} of the cycle at the highest response"
    )


# ---- response curve without a preload ----


NOTE = (
    "without a preload nothing holds the damper: this is the free response (study.free), with the "
    "damper off its seat"
)


def free_of_contact(
    problem: Problem, frequency: tuple[float, float], options: ContinuationOptions
) -> ResponseCurve | None:
    """Return the free response as a response curve at zero preload, dampers out of contact.

    Parameters
    ----------
    problem : Problem
    frequency : (low, high), Hz
    options : ContinuationOptions

    Returns
    -------
    ResponseCurve or None
        None if it does not satisfy the equations: a structure without a loaded damper, surfaces
        under pressure without a load, springs of a bonded contact, or a fixed mean.
    """
    system = problem.system(0.0)
    points = problem.friction_points
    # direction (n_mean,) in which rigid bodies move away against their load
    load, _ = problem.damper_load
    rigid = problem.static_basis.omega2 == 0.0
    away = -np.where(rigid, load, 0.0)[: system.n_mean]
    # every contact has to open; the normal motion, component 2 of G, is positive if surfaces
    # approach
    G_normal = problem.static_basis.G.real[points, 2, : len(away)]
    opening = -(G_normal @ away)
    if not opening.size:
        return None
    largest = np.abs(opening).max()
    if not (largest > 0.0 and opening.min() > 1e-6 * largest):
        return None
    curve = free(problem, frequency)
    # bound of the normal motion, and initial overlap of the surfaces
    swing = 0.0
    for harmonic in problem.settings.excited:
        G = problem.bases[harmonic].G[points, 2]
        # (n_curve, n_modes)
        amplitude = system.layout.amplitudes(curve.unknowns, harmonic)
        swing += np.abs(G @ amplitude.T).max(initial=0.0)
    overlap = max(0.0, -float(problem.point_gaps[points].min()))
    # move away until the contact that opens least stays open with the double swing
    distance = (2.0 * swing + overlap) / opening.min()
    unknowns = curve.unknowns.copy()
    unknowns[:, : len(away)] += distance * away
    solutions = np.column_stack([unknowns, 2.0 * np.pi * curve.frequency])
    residual = np.array([system.error(y) for y in solutions])
    if not len(curve) or residual.max() > options.tolerance:
        return None
    return replace(
        curve,
        kind="response",
        unknowns=unknowns,
        harmonics=system.response(unknowns),
        residual=residual,
        rank_deficiency=np.full(len(curve), int(rigid.sum())),
        reason=curve.reason.replace("linear", "the free response", 1),
        notes=(NOTE,),
        settings=problem.record(options),
    )


# ---- response curve ----


ELASTIC = 1e-3
"""Frequency over the lowest frequency of a curve, below which resonances are rigid-body motions or
too distant."""


def frequency_response(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    options: ContinuationOptions | None = None,
    progress: bool = False,
) -> ResponseCurve:
    """Compute the response curve in a frequency interval at one preload, with all branches.

    Parameters
    ----------
    problem : Problem
    preload : float, N
        Radial load on the damper.  At zero preload it is the free response if nothing else holds
        the damper.
    frequency : (low, high), Hz
    options : ContinuationOptions
    progress : bool
        Show a progress bar.

    Returns
    -------
    ResponseCurve
        ``status`` is "complete" if its branches cover the interval.  Otherwise ``reason`` gives the
        cause, and the curve contains the points found so far.  A branch that does not reach the
        other end is complemented by one from there.
    """
    case = problem.at(preload)
    frequency = validation.interval("frequency", frequency)
    validation.flag("progress", progress)
    if options is None:
        options = ContinuationOptions()
    validation.instance("options", options, ContinuationOptions)
    with single_thread():
        if not case.static.ok:
            reason = f"static state: {case.static.reason}"
            return without_points(problem, case.preload, reason, options, case.static.cost)
        if case.preload == 0.0:
            free_response = free_of_contact(problem, frequency, options)
            if free_response is not None:
                return free_response
        curve = _covered(case, frequency, options, progress)
        return replace(curve, reason=curve.reason + _sticks_instead(case, curve, frequency))


def _covered(
    case: LoadCase, frequency: tuple[float, float], options: ContinuationOptions, progress: bool
) -> ResponseCurve:
    """Return the curve of all branches that start at the static state of a load case or at residual forces."""
    problem = case.problem
    search = _search(case, frequency, options)
    find_start = partial(_start, case, search)
    try:
        with progress_bar(progress, *search.limits, "response curve") as search.on_point:
            search.cover(find_start)
    except KeyboardInterrupt:
        if is_part_of_work():
            raise
        # Ctrl-C before or between paths
        if not any(piece.path.status == "interrupted" for piece in search.pieces):
            no_path = Path(
                points=(),
                status="interrupted",
                reason="by the user",
                iterations=0,
                failed_steps=0,
            )
            search.pieces.append(Piece(no_path, up=True))
    end = ending(search.pieces, *search.limits)
    curve = as_curve(problem, search, end, kind="response", preload=case.preload)
    if len(curve):
        warn_of_small_slip(problem, search.system, curve.peak.y[:-1])
    remarks = [f"{name} {LOCKED}" for name in self_locking(problem)]
    if case.residual is not None:
        factor = case.residual.first_slip
        remarks.append((STICKS if factor >= 1.0 else SLIPS).format(factor))
    if len(curve):
        changes = changes_of_contact(case, frequency, curve.peak.y)
        remarks += [changes] if changes else []
    return replace(
        curve,
        reason=_reason(case, search, curve),
        missing_ranges=(*curve.missing_ranges, *search.lost),
        notes=(*curve.notes, *remarks),
    )


def _sticks_instead(case: LoadCase, curve: ResponseCurve, frequency: tuple[float, float]) -> str:
    """Return the remedy for a curve from rest with gaps, of a joint that needs not slip, or "".

    The vibration reduces the friction that is left for the mean.  From the static state the mean
    position may then move far, and no path passes the resonance.
    """
    # narrow gaps of a complete curve may contain its peak
    has_gaps = curve.status == NOT_FOUND or curve.gap is not None
    no_answer = curve.interrupted or curve.without_amplitude is not None
    if case.residual is not None or no_answer or not has_gaps:
        return ""
    stuck = first_slip.residual_state(case, frequency)
    if stuck is None or stuck.first_slip < 1.0:
        return ""
    return (
        f"; no contact needs to slip, first slip at {stuck.first_slip:.3g} times the excitation: "
        'study.replace(residual_forces="most") starts from the friction forces of this limit'
    )


def _search(
    case: LoadCase, frequency: tuple[float, float], options: ContinuationOptions
) -> Coverage:
    """Return the search for the branches, with its budget."""
    low = TWO_PI * frequency[0]
    high = TWO_PI * frequency[1]
    system = case.equations
    budget = options.budget or evaluation_budget(system)
    linear = case.sector.linear
    # resonances (omega, half-width, modal row) without contact springs, and in stick
    free = linear.resonances((None,), ELASTIC * low, np.inf)
    stuck = linear.resonances((case.stuck_springs(),), ELASTIC * low, np.inf)
    # steps must not pass over a resonance within the interval
    watched = []
    for omega, half_width, row in (*free, *stuck):
        if low < omega < high:
            watched.append((omega, half_width, row))
    system = replace(system.within(budget), watched=watched)
    search = Coverage(system, (low, high), replace(options, budget=budget), CostMeter())
    free_frequencies = [omega for omega, *_ in free]
    stuck_frequencies = [omega for omega, *_ in stuck]
    search.reach = reach(free_frequencies, stuck_frequencies, low, high)
    search.meter.watch(system)
    return search


def _start(case: LoadCase, search: Coverage, omega: float) -> NDArray | None:
    """Return a solution at one frequency (rad/s) or None, and log all attempts."""
    problem = case.problem
    solution, attempts, last = first_point(
        search.system, case.static, case.stuck_springs(), omega, search.options, search.meter
    )
    if solution is None and not search.system.spent:
        why = why_no_solution(
            search.system, problem.coupling.model, problem.bases[0].coordinates, last
        )
        if why:
            attempts = [*attempts, why]
    for line in attempts:
        search.note(omega, line)
    return solution


def _reason(case: LoadCase, search: Coverage, curve: ResponseCurve) -> str:
    """Return the reason of a curve with the extent of the search, or with advice."""
    problem = case.problem
    reason = curve.reason
    if curve.complete:
        bottom, top = search.outside
        searched = f"from {span(bottom / TWO_PI, top / TWO_PI, 'Hz')}"
        broken = ", where a path broke off (missing_ranges)" if search.lost else ""
        reason += f"; folds looked for {searched}{broken}, closed branches not"
    why_rattling = rattles(curve, open_at_rest(case))
    if why_rattling:
        reason += f"; {NO_STEADY} is expected at this preload: {why_rattling}"
    if curve.status not in (INCOMPLETE, NOT_FOUND) or curve.without_amplitude is not None:
        return reason
    out_of_budget = any(piece.path.status == OUT_OF_BUDGET for piece in search.pieces)
    if search.system.spent or out_of_budget:
        budget = f"{search.options.budget} evaluations (ContinuationOptions.budget)"
        reason += f"; the budget was {budget}"
    if problem.own_laws is not None and STATUS_TEXT[NOT_FINITE] in reason:
        reason += f"; forces of {problem.own_laws.names} may not be finite there, or not settle"
    force = problem.settings.excitation.amplitude
    if 0.0 < curve.preload < 2.0 * force:
        ratio = curve.preload / force
        reason += (
            f"; a preload of {ratio:.2g} times the excitation does not keep the damper in its "
            "seat: raise it"
        )
    return f"{reason}; study.motion_in_time integrates where no solution was found"


def without_points(
    problem: Problem, preload: float, reason: str, options: ContinuationOptions, cost: Cost
) -> ResponseCurve:
    """Return an empty curve, for preloads without static equilibrium."""
    return ResponseCurve(
        kind="response",
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


def as_curve(
    problem: Problem,
    search: Coverage,
    end: SearchEnd,
    *,
    kind: str,
    preload: float,
    blades: NDArray | None = None,
) -> ResponseCurve:
    """Assemble a response curve from the pieces of a search.

    Parameters
    ----------
    problem : Problem
    search : Coverage
    end : SearchEnd
    kind : str
    preload : float, N
    blades : array, optional
        Response of every blade of a mistuned disk.
    """
    system = search.system
    ordered = in_order(search.pieces)
    points = [point for point, _ in ordered]
    y = np.array([point.y for point in points]).reshape(len(points), system.n_unknowns + 1)
    branch = np.array([piece.branch for _, piece in ordered], int)
    backward = np.array([_runs_backward(point, piece) for point, piece in ordered], bool)
    closed = {piece.branch for piece in search.pieces if piece.path.status == "closed"}
    status, reason, missing_ranges = end.status, end.reason, end.missing_ranges
    unresolved = unresolved_resonance(system, problem.bases[1], y, branch)
    if unresolved is not None:
        missing_ranges = (*missing_ranges, unresolved)
        if status == COMPLETE:
            status = INCOMPLETE
            reason = unresolved.at_middle
        else:
            reason = f"{unresolved.at_middle}; {reason}"
    mean_notes: tuple[str, ...] = ()
    # the coordinates of one sector do not describe a mistuned bladed disk
    if blades is None:
        coordinates = problem.bases[0].coordinates
        mean_notes = notes(system, problem.coupling.model, coordinates, points)
    return ResponseCurve(
        kind=kind,
        preload=preload,
        frequency=y[:, -1] / TWO_PI,
        harmonics=system.response(y[:, :-1]),
        unknowns=y[:, :-1],
        residual=np.array([point.residual for point in points]),
        shares=np.array([point.shares for point in points]).reshape(-1, 3),
        backward=backward,
        rank_deficiency=np.array([point.rank_deficiency for point in points], int),
        branch=branch,
        closed=tuple(sorted(closed)),
        point_kind=tuple(point.kind for point in points),
        status=status,
        reason=reason,
        missing_ranges=missing_ranges,
        cost=search.meter.read(),
        start_log=tuple(search.log),
        notes=mean_notes,
        blades=blades,
        **problem.recorded(search.options),
    )


def _runs_backward(point: Correction, piece: Piece) -> bool:
    """Return whether the frequency decreases along the branch at a point of one of its pieces."""
    # where only the mean drifts the sign of the change is rounding
    if point.kind == "drift":
        return False
    frequency_change = point.tangent[-1]
    return bool(frequency_change < 0.0 if piece.up else frequency_change > 0.0)


def check_curve(problem: Problem, curve: ResponseCurve, name: str = "curve") -> None:
    """Raise SettingError unless the argument is a response curve of this problem."""
    validation.instance(name, curve, ResponseCurve, "a response curve")
    expected = "a response curve (study.frequency_response)"
    validation.check(curve.kind == "response", name, expected, f"a {curve.kind} curve")
    validation.check(
        curve.model_hash == problem.model.hash,
        name,
        "a curve of this model",
        "a curve of another model",
    )
    if len(curve):
        check_solution(problem, curve.preload, curve.peak.y, curve.peak.residual, name)


def self_locking(problem: Problem) -> tuple[str, ...]:
    """Return the bodies that friction alone can hold between their faces; masses by their contacts.

    Their static normal load is not unique: :meth:`Problem.wedge_friction` finds no upper bound.
    """
    try:
        bounds = problem.wedge_friction()
    # no free body has a load, or nothing holds it
    except SettingError:
        return ()
    interfaces = problem.coupling.model.interfaces
    # faces that hold each body
    locked: dict[str, list[str]] = {}
    for name, highest_force in zip(bounds.interfaces, bounds.highest):
        if np.isinf(highest_force):
            locked.setdefault(_held_body(interfaces[name]), []).append(name)
    # springs of a bonded face hold the body with a known force
    for name, law in problem.settings.law_by_interface().items():
        if law == LAW_BONDED:
            locked.pop(_held_body(interfaces[name]), None)
    subjects = []
    for body in problem.model.bodies.values():
        if body.load is None or body.name not in locked:
            continue
        if body.kind == "lumped":
            # all masses are one body
            subjects.append(f"the mass at {listed(locked[body.name])}")
        else:
            subjects.append(body.name)
    return tuple(subjects)


def _held_body(interface: Interface) -> str:
    """Return body a, or the lumped masses on the ground, which are body b."""
    return interface.body_b if interface.body_a == "ground" else interface.body_a


# ---- slow sweep of frequency ----


class Jump(NamedTuple):
    """Jump of a sweep from one branch to another.

    Parameters
    ----------
    frequency : float, Hz
    before, after : float, m
        Amplitudes; ``after`` is NaN if no stable solution is known, and the sweep ends.
    """

    frequency: float
    before: float
    after: float

    def __str__(self) -> str:
        return (
            f"jump at {amount(self.frequency, 'Hz')} from {self.before:.4g} to {self.after:.4g} m"
        )


@dataclass(frozen=True)
class SlowSweep:
    """Response in a slow frequency sweep (:func:`sweep_of`).

    Parameters
    ----------
    frequency : (n,) float, Hz
        Frequencies in the order of the sweep; a jump has two entries.
    amplitude : (n,) float, m
        Amplitude of the first harmonic.
    jumps : tuple of Jump
    point : (n,) int
        Index of the point of the curve; for the end of a jump between two points the next one along
        the sweep.
    """

    frequency: NDArray
    amplitude: NDArray
    jumps: tuple[Jump, ...]
    point: NDArray


class _Landing(NamedTuple):
    """Stable solution at which a jump of a slow sweep may end.

    Parameters
    ----------
    amplitude : float, m
        Amplitude, interpolated between two points of the curve.
    point : int
        Index of the next point along the sweep.
    way : {1, -1}
        Change of the index along the sweep.
    """

    amplitude: float
    point: int
    way: int


class _Sweep:
    """Points of a response curve with a coordinate that increases along the sweep."""

    def __init__(self, sense: float, curve: ResponseCurve) -> None:
        self.x = sense * curve.frequency
        self.amplitude = curve.amplitude
        self.branch = curve.branch
        fold = np.array([kind == "fold" for kind in curve.point_kind], bool)
        # whether a fold counts as stable would depend on rounding
        self.held = ~unstable_points(curve) | fold
        same_branch = self.branch[:-1] == self.branch[1:]
        both_held = self.held[:-1] & self.held[1:]
        # between two folds the branch is unstable
        both_folds = fold[:-1] & fold[1:]
        self.joined = same_branch & both_held & ~both_folds

    def landings(self, x: float) -> list[_Landing]:
        """Return the stable solutions at x from which the sweep can continue, ascending."""
        solutions: list[_Landing] = []
        # relative difference of amplitudes below which two solutions at one frequency are the same
        same = 1e-6
        points, heights = crossed(self.x, self.amplitude, x, self.joined)
        for i, height in zip(points.tolist(), heights.tolist()):
            # the sweep continues to the end of the segment with the larger x
            rises = self.x[i + 1] > self.x[i]
            onward = i + 1 if rises else i
            if not self.x[onward] > x:
                continue
            if all(abs(height - other.amplitude) > same * height for other in solutions):
                way = 1 if rises else -1
                solutions.append(_Landing(amplitude=height, point=onward, way=way))
        # by amplitude, the first member
        return sorted(solutions)

    def onward(self, point: int, way: int) -> int | None:
        """Return the next point on the branch, None if the sweep cannot continue there."""
        new = point + way
        if not 0 <= new < len(self.x) or self.branch[new] != self.branch[point]:
            return None
        if not self.held[new] or self.x[new] < self.x[point]:
            return None
        return new


def sweep_of(curve: ResponseCurve, direction: str) -> SlowSweep:
    """Compute the response in a slow frequency sweep from a response curve.

    Unstable points are ``curve.unstable`` if examined, otherwise branches between folds that run
    backward.  All other points count as stable.

    Parameters
    ----------
    curve : ResponseCurve
    direction : {"up", "down"}

    Returns
    -------
    SlowSweep
        Empty if no stable solution is known at the first frequency.
    """
    validation.choice("direction", direction, ("up", "down"))
    sense = 1.0 if direction == "up" else -1.0
    sweep = _Sweep(sense, curve)
    start: _Landing | None = None
    if len(sweep.x):
        x = float(sweep.x.min())
        start = next(iter(sweep.landings(x)), None)
    if start is None:
        none = np.zeros(0)
        return SlowSweep(frequency=none, amplitude=none, jumps=(), point=np.zeros(0, int))
    # entries of the result, with sense * frequency
    passed = [x]
    amplitudes = [start.amplitude]
    numbers = [start.point]
    jumps: list[Jump] = []
    while True:
        # along the branch to its end, to a fold or to an unstable point
        point: int | None = start.point
        while point is not None:
            passed.append(float(sweep.x[point]))
            amplitudes.append(float(sweep.amplitude[point]))
            numbers.append(point)
            point = sweep.onward(point, start.way)
        x = passed[-1]
        amplitude = amplitudes[-1]
        if x >= sweep.x.max():
            break
        landings = sweep.landings(x)
        if not landings:
            jumps.append(Jump(frequency=sense * x, before=amplitude, after=np.nan))
            break
        # the nearest lower solution, otherwise the nearest higher one
        lower = [landing for landing in landings if landing.amplitude <= amplitude]
        start = lower[-1] if lower else landings[0]
        jumps.append(Jump(frequency=sense * x, before=amplitude, after=start.amplitude))
        passed.append(x)
        amplitudes.append(start.amplitude)
        numbers.append(start.point)
    return SlowSweep(
        frequency=sense * np.array(passed),
        amplitude=np.array(amplitudes),
        jumps=tuple(jumps),
        point=np.array(numbers),
    )
