"""Response curve: all branches over a frequency interval at one preload, and its interpretation.

:func:`frequency_response` covers the interval (``bdamper.response.branches``): from its lower end;
from the upper end if the first path does not reach it; beyond both ends up to the free and stuck
resonances, where a branch may turn and return; and in the remaining gaps, within a budget of
evaluations.

**Mean position of the damper.**  The mean position of a free body may drift along a curve at
constant vibration, may be undetermined (then it has least norm), or may have no equilibrium;
:func:`notes` and :func:`why_no_solution` report it.

**Rattling.**  Under a low preload the damper separates for most of the cycle and lands at different
instants in each period. Harmonic balance then finds many periodic solutions, connected by folds,
and time integration from the highest finds no steady amplitude.  :func:`rattles` detects curves
with many folds and mostly open contacts.  It is an indication, not a proof, and appears at low
preloads only (measured.md, *Where a damper rattles*).  On 84 curves :func:`rattles` detects 11, and
time integration of none of these becomes steady within 250 periods.  It misses 18 other curves on
which it does not become steady.

**No preload.**  A damper that its load would press against its neighbours moves away from them.
With a mean position so far off that no contact point closes in a cycle, the free response satisfies
all equations exactly (:func:`free_of_contact`).

**Slow sweep of frequency.**  :func:`sweep_of` starts at one end of the interval on the lowest
stable solution and follows stable points.  Where the branch turns or loses stability the response
jumps to a stable solution at that frequency: the nearest lower one, or the nearest higher one if
there is none.  The motion during a jump is not computed, so among several stable solutions the
response may end on another one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED
from bdamper.harmonic_balance.checks import check_solution, warn_of_small_slip
from bdamper.harmonic_balance.equations import NOT_FINITE, STATUS_TEXT, Correction, Equations
from bdamper.harmonic_balance.problem import LoadCase, Problem
from bdamper.harmonic_balance.sector import Sector, reach
from bdamper.model.kinematics import Coordinate
from bdamper.model.structure import Model
from bdamper.response.branches import (
    Coverage,
    LeftOut,
    Piece,
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
    ResponseCurve,
    crossed,
    unstable_points,
)
from bdamper.util import validation
from bdamper.util.errors import COMPLETE, INCOMPLETE, NOT_FOUND, SettingError
from bdamper.util.progress import Cost, CostMeter, is_part_of_work, progress_bar, single_thread

# ---- mean position of free bodies ----


def _displacement(model: Model, coordinate: Coordinate, q: float) -> str:
    body = model.bodies.get(coordinate.body)  # None for residual modes
    if body is not None and body.mass is not None and coordinate.name in ("TX", "TY", "TZ"):
        return f"{q / np.sqrt(body.mass):.3g} m"
    return f"{q:.3g} kg^1/2 m"


def notes(
    system: Equations[Sector],
    model: Model,
    coordinates: Sequence[Coordinate],
    points: Sequence[Correction],
) -> tuple[str, ...]:
    """Describe where the mean position drifts, and mean positions that only least norm determines."""
    out = []
    stretches = (
        (kind, list(pairs))
        for kind, pairs in groupby(enumerate(points), key=lambda pair: pair[1].kind)
    )
    for stretch in (pairs for kind, pairs in stretches if kind == "drift"):
        (first, point), (_, last) = stretch[0], stretch[-1]
        a, b = points[max(first - 1, 0)].y, last.y
        k = int(np.argmax(np.abs((b - a)[: system.n_mean])))
        c = coordinates[k]
        out.append(
            f"{c.body} drifts along {c.name} at {point.y[-1] / TWO_PI:.6g} Hz, where its mean force vanishes: from "
            f"{_displacement(model, c, a[k])} to {_displacement(model, c, b[k])}"
        )
    free = [p for p in points if p.rank_deficiency > 0]
    if free:
        some = free[:: max(1, len(free) // 20)]
        names = sorted(
            {name for p in some for name in neutral_directions(system, coordinates, p.y)}
        )
        out.append(
            f"nothing determines the mean along {', '.join(names)} at {len(free)} points: held by least norm"
        )
    return tuple(out)


def neutral_directions(
    system: Equations[Sector], coordinates: Sequence[Coordinate], y: NDArray
) -> list[str]:
    """Return the names of the mean coordinates that no equation determines at a solution.

    They dominate the null space of the mean part of the Jacobian.
    """
    n = system.n_mean
    columns = system.evaluate_at(y)[1][:, :n]
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
    system: Equations[Sector], model: Model, coordinates: Sequence[Coordinate], y: NDArray
) -> str:
    """Describe the unbalanced mean force on a free body at the last Newton iterate, or return ""."""
    try:
        r, J, _ = system.evaluate(y[:-1], y[-1])
    except FloatingPointError:
        return ""
    _, _, share = system.contact(y[:-1])
    for k, c in enumerate(coordinates):
        body = model.bodies.get(c.body)  # None for residual modes
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
                "its mean position; it drifts until a constraint plane carries load, and none does"
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
curves are detected, and on one of them the amplitude in time is steady.
"""


def open_at_rest(case: LoadCase) -> float:
    """Return the fraction of the friction points that are open in the static state."""
    closed = case.static.force[case.problem.friction_points, 2] > 0.0
    return 1.0 - float(closed.mean()) if closed.any() else 0.0


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
    step = np.sign(np.diff(curve.frequency))[np.diff(curve.branch) == 0]
    folds = int(np.count_nonzero(np.diff(step[step != 0.0])))
    opened = float(curve.shares[curve.amplitude.argmax(), 2])
    if folds < FOLDS or opened - at_rest <= OPEN * (1.0 - at_rest):
        return ""
    return f"{folds} folds, and the contacts open for {100.0 * opened:.0f} % of the cycle at the highest response"


# ---- response curve without a preload ----


NOTE = "without a preload nothing holds the damper: this is the free response (study.free), with the damper off its seat"


def free_of_contact(
    problem: Problem, frequency: tuple[float, float], options: Any
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
    system, load = problem.system(0.0), problem.damper_load[0]
    rigid = problem.static_basis.omega2 == 0.0
    away = -np.where(rigid, load, 0.0)[: system.n_mean]
    opening = -(problem.static_basis.G.real[problem.friction_points, 2, : len(away)] @ away)
    if not (opening.size and opening.min() > 1e-6 * np.abs(opening).max() > 0.0):
        return None
    curve = free(problem, frequency)
    swing = 0.0
    for l in problem.settings.excited:
        G, amplitude = (
            problem.bases[l].G[problem.friction_points, 2],
            system.layout.amplitudes(curve.unknowns, l),
        )
        swing += np.abs(G @ amplitude.T).max(initial=0.0)
    overlap = max(0.0, -float(problem.point_gaps[problem.friction_points].min()))
    unknowns = curve.unknowns.copy()
    unknowns[:, : len(away)] += (2.0 * swing + overlap) / opening.min() * away
    residual = np.array(
        [system.error(y) for y in np.column_stack([unknowns, 2.0 * np.pi * curve.frequency])]
    )
    if not len(curve) or residual.max() > options.tolerance:
        return None
    reason = curve.reason.replace("linear", "the free response", 1)
    return replace(
        curve, kind="response", unknowns=unknowns, harmonics=system.response(unknowns), residual=residual,
        rank_deficiency=np.full(len(curve), int(rigid.sum())), reason=reason, notes=(NOTE,),
        settings=problem.record(options),
    )  # fmt: skip


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
    """Compute the response curve over a frequency interval at one preload, with all branches.

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
    options = (
        ContinuationOptions()
        if options is None
        else validation.instance("options", options, ContinuationOptions)
    )
    with single_thread():
        if not case.static.converged:
            reason = f"static state: {case.static.note}"
            return without_points(problem, case.preload, reason, options, case.static.cost)
        free = free_of_contact(problem, frequency, options) if case.preload == 0.0 else None
        if free is not None:
            return free
        search = _search(case, frequency, options)
        find_start = partial(_start, case, search)
        try:
            with progress_bar(progress, *search.limits, "response curve") as search.on_point:
                search.cover(find_start)
        except KeyboardInterrupt:
            if is_part_of_work():
                raise
            if not any(piece.path.status == "interrupted" for piece in search.pieces):
                search.pieces.append(Piece(Path((), "interrupted", "by the user", 0, 0), True))
        curve = as_curve(
            problem,
            search,
            ending(search.pieces, *search.limits),
            kind="response",
            preload=case.preload,
        )
        if len(curve):
            warn_of_small_slip(problem, search.system, curve.peak.y[:-1])
        locked = (f"{name} {LOCKED}" for name in self_locking(problem))
        reason, left_out = _reason(case, search, curve), (*curve.missing_ranges, *search.lost)
        return replace(curve, reason=reason, missing_ranges=left_out, notes=(*curve.notes, *locked))


def _search(
    case: LoadCase, frequency: tuple[float, float], options: ContinuationOptions
) -> Coverage:
    """Return the search for the branches, with its budget."""
    low, high = TWO_PI * frequency[0], TWO_PI * frequency[1]
    system = case.equations
    budget = options.budget or evaluation_budget(system)
    linear = case.sector.linear
    free, stuck = (
        linear.resonances((k,), ELASTIC * low, np.inf) for k in (None, case.stuck_springs())
    )
    watched = [there for there in (*free, *stuck) if low < there[0] < high]
    system = replace(system.within(budget), watched=watched)
    search = Coverage(system, (low, high), replace(options, budget=budget), CostMeter())
    search.reach = reach([w for w, *_ in free], [w for w, *_ in stuck], low, high)
    search.meter.watch(system)
    return search


def _start(case: LoadCase, search: Coverage, omega: float) -> NDArray | None:
    """Return a solution at one frequency (rad/s) or None, and log all attempts."""
    problem, why = case.problem, ""
    solution, attempts, last = first_point(
        search.system, case.static, case.stuck_springs(), omega, search.options, search.meter
    )
    if solution is None and not search.system.spent:
        why = why_no_solution(
            search.system, problem.coupling.model, problem.bases[0].coordinates, last
        )
    for line in [*attempts, why] if why else attempts:
        search.note(omega, line)
    return solution


def _reason(case: LoadCase, search: Coverage, curve: ResponseCurve) -> str:
    """Return the reason of a curve with the extent of the search, or with advice."""
    problem, reason = case.problem, curve.reason
    if curve.complete:
        bottom, top = (w / TWO_PI for w in search.outside)
        broken = ", where a path broke off (missing_ranges)" if search.lost else ""
        reason += (
            f"; folds looked for from {bottom:.4g} to {top:.4g} Hz{broken}, closed branches not"
        )
    if why := rattles(curve, open_at_rest(case)):
        reason += f"; {NO_STEADY} is expected at this preload: {why}"
    if curve.status not in (INCOMPLETE, NOT_FOUND) or curve.without_amplitude is not None:
        return reason
    if search.system.spent or any(piece.path.status == OUT_OF_BUDGET for piece in search.pieces):
        reason += (
            f"; the budget was {search.options.budget} evaluations (ContinuationOptions.budget)"
        )
    if problem.own_laws is not None and STATUS_TEXT[NOT_FINITE] in reason:
        reason += f"; forces of {problem.own_laws.names} may not be finite there, or not settle"
    force = problem.settings.excitation.amplitude
    if 0.0 < curve.preload < 2.0 * force:
        ratio = curve.preload / force
        reason += f"; a preload of {ratio:.2g} times the excitation does not keep the damper in its seat: raise it"
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
    problem: Problem, search: Coverage, ended: tuple[str, str, tuple[LeftOut, ...]], **more: Any
) -> ResponseCurve:
    """Assemble a response curve from the pieces of a search.

    Parameters
    ----------
    problem : Problem
    search : Coverage
    ended : tuple
        Status, reason and omissions.
    **own
        Kind, preload, and further fields.
    """
    system, ordered = search.system, in_order(search.pieces)
    points = [p for p, _ in ordered]
    y = np.array([p.y for p in points]).reshape(len(points), system.n_unknowns + 1)
    onward = [p.tangent[-1] * (1.0 if way.up else -1.0) for p, way in ordered]
    backward = np.array([p.kind != "drift" and to < 0.0 for p, to in zip(points, onward)], bool)
    branch = np.array([way.branch for _, way in ordered], int)
    status, reason, left_out = ended
    unresolved = unresolved_resonance(system, problem.bases[1], y, branch)
    if unresolved is not None:
        reason = unresolved.at_middle if status == COMPLETE else f"{unresolved.at_middle}; {reason}"
        status = INCOMPLETE if status == COMPLETE else status
        left_out = (*left_out, unresolved)
    return ResponseCurve(
        frequency=y[:, -1] / TWO_PI,
        harmonics=system.response(y[:, :-1]),
        unknowns=y[:, :-1],
        residual=np.array([p.residual for p in points]),
        shares=np.array([p.shares for p in points]).reshape(-1, 3),
        backward=backward,
        rank_deficiency=np.array([p.rank_deficiency for p in points], int),
        branch=branch,
        closed=tuple(
            sorted({piece.branch for piece in search.pieces if piece.path.status == "closed"})
        ),
        point_kind=tuple(p.kind for p in points),
        status=status,
        reason=reason,
        missing_ranges=left_out,
        cost=search.meter.read(),
        start_log=tuple(search.log),
        notes=()
        if "blades" in more
        else notes(system, problem.coupling.model, problem.bases[0].coordinates, points),
        **more,
        **problem.recorded(search.options),
    )


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
    """Return the bodies that friction alone can hold between their faces.

    Their static normal load is not unique: :meth:`Problem.wedge_friction` finds no upper bound.
    """
    try:
        bounds = problem.wedge_friction()
    except SettingError:  # no free body has a load, or nothing holds it
        return ()
    faces = [name for name, high in zip(bounds.interfaces, bounds.highest) if np.isinf(high)]
    holders = {problem.coupling.model.interfaces[name].body_a for name in faces}
    springs = {
        name for name, law in problem.settings.law_by_interface().items() if law == LAW_BONDED
    }
    holders -= {problem.coupling.model.interfaces[name].body_a for name in springs}
    return tuple(
        body.name
        for body in problem.model.bodies.values()
        if body.load is not None and body.name in holders
    )


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
        return f"jump at {self.frequency:.6g} Hz from {self.before:.4g} to {self.after:.4g} m"


@dataclass(frozen=True)
class SlowSweep:
    """Response in a slow sweep of frequency (:func:`sweep_of`).

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
        Change of the index along the sweep; 0 without a solution.
    """

    amplitude: float
    point: int
    way: int


class _Sweep:
    """Points of a response curve with a coordinate that increases along the sweep."""

    def __init__(self, sense: float, curve: ResponseCurve) -> None:
        self.x, self.amplitude, self.branch = sense * curve.frequency, curve.amplitude, curve.branch
        self.fold = np.array([kind == "fold" for kind in curve.point_kind], bool)
        self.held = ~unstable_points(curve) | self.fold  # the label of a fold depends on rounding
        joined = (self.branch[:-1] == self.branch[1:]) & self.held[:-1] & self.held[1:]
        self.joined = joined & ~(self.fold[:-1] & self.fold[1:])

    def landings(self, x: float) -> list[_Landing]:
        """Return the stable solutions at x from which the sweep can continue, ascending."""
        solutions: list[_Landing] = []
        # relative difference of amplitudes below which two solutions at one frequency are the same
        same = 1e-6
        points, heights = crossed(self.x, self.amplitude, x, self.joined)
        for i, height in zip(points.tolist(), heights.tolist()):
            way = 1 if self.x[i + 1] > self.x[i] else -1
            if max(self.x[i], self.x[i + 1]) > x and all(
                abs(height - s.amplitude) > same * height for s in solutions
            ):
                solutions.append(_Landing(height, i + 1 if way > 0 else i, way))
        return sorted(solutions)

    def onward(self, point: int, way: int) -> int | None:
        """Return the next point on the branch, None if the sweep cannot continue there."""
        new = point + way
        if not 0 <= new < len(self.x) or self.branch[new] != self.branch[point]:
            return None
        return new if self.held[new] and self.x[new] >= self.x[point] else None


def sweep_of(curve: ResponseCurve, direction: str) -> SlowSweep:
    """Compute the response of a slow sweep of frequency from a response curve.

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
    options = sweep.landings(float(sweep.x.min())) if len(sweep.x) else []
    if not options:
        none = np.zeros(0)
        return SlowSweep(none, none, (), none.astype(int))
    here, x = options[0], float(sweep.x.min())
    places, jumps = [(x, here.amplitude, here.point)], []
    while True:
        point: int | None = here.point
        while point is not None:
            last = point
            places.append((float(sweep.x[last]), float(sweep.amplitude[last]), last))
            point = sweep.onward(last, here.way)
        x, height, _ = places[-1]
        if x >= sweep.x.max():
            break
        options = sweep.landings(x)
        lower = [option for option in options if option.amplitude <= height]
        here = lower[-1] if lower else options[0] if options else _Landing(np.nan, 0, 0)
        jumps.append(Jump(sense * x, height, here.amplitude))
        if not options:
            break
        places.append((x, here.amplitude, here.point))
    passed, height_there = np.array([place[:2] for place in places]).T
    numbers = np.array([place[2] for place in places])
    return SlowSweep(sense * passed, height_there, tuple(jumps), numbers)
