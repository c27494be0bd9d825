"""Stability of periodic solutions with friction: Floquet multipliers with sliders as state
variables, and time integration.

The force at a sticking point depends on the motion at which it began to stick, so the state of a
disturbed solution is ``(q, q', w)`` with the sliders ``w``.  Between two events (a change between
stick, slip and separation at any point) the linearised equations have constant coefficients,

    M q'' + C q' + K q + G^T B(G q, w) = 0,

with, for each point and direction, ``dT = kt (du - dw)`` in stick, ``dT = +-mu kn dv`` in slip,
zero in separation, and ``dN = kn dv`` in contact.  A matrix exponential gives the state at the next
event.  The forces are continuous there, so the state passes unchanged, except for the slider.
During slip and separation the slider is no state variable.  At the beginning of stick it is set to

    dw = du -+ (mu kn/kt) dv      at a slip-to-stick event after positive (negative) slip,
    dw = du - (u'/v') dv          at a closing, whose instant moves by -dv/v'.

The product over a period is the monodromy matrix.  If all multipliers are within the unit circle,
every small disturbance decays.  A slider that is not set within the period has a multiplier of
exactly 1 and is omitted, even if it rests at its friction limit: a disturbance moves it once, into
a neighbouring solution with another residual traction.

With one real basis for all harmonics (no cyclic symmetry) the multipliers cover all disturbances.

**Sign of det J.**  For a travelling wave the harmonics have different bases, so there is no such
state of one sector.  Coupled friction and cubic springs have no event sequence of this kind.  There
only the sign of the determinant of the Jacobian is examined.  It is negative if an odd number of
disturbances in the nodal diameters of the wave grows without oscillating, as between two folds.
Such a point is unstable in the equations of these harmonics, which have branches that do not exist
in time.  Otherwise the point is undecided: growth with oscillation, growth in pairs and other nodal
diameters are not examined.

**Time integration.** All this applies to the motion with the harmonics of the solution.  Only time
integration shows whether the actual motion is stable.  With ``with_stability(in_time=True)`` the
motion starts at the solution, perturbed in every nodal diameter, and
``bdamper.time_domain.transient.judged`` decides whether its amplitude is maintained.  An undamped
damper chatters at many points next to separated peaks, without any period; the criterion is the
resulting amplitude, averaged over many periods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from bdamper.contact.laws import (
    LAW_BONDED,
    LAW_CONSTANT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_CUBIC,
    refuse,
)
from bdamper.contact.preload_state import OPEN, SLIP_MINUS, SLIP_PLUS, STICK
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import SectorData, segments
from bdamper.model.kinematics import HarmonicBasis
from bdamper.response.continuation import TWO_PI
from bdamper.response.response_curve import check_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.time_domain.integration import AllSectors, IntegrationFailed, all_sectors
from bdamper.time_domain.time_response import compare_with_solution, disturbed
from bdamper.time_domain.transient import AGREES, CRITERIA, UNDECIDED, step_error
from bdamper.util import validation
from bdamper.util.progress import LongWork, one_thread, shows_progress, with_progress

# ---- stability by multipliers and by the sign of det J ----


NEUTRAL = 1e-6
"""Multipliers up to 1 + this count as within the unit circle: a neutral position is neither stable
nor unstable.
"""
SINGULAR = 1e-12
"""Singular value below which a Jacobian with rows of unit size has a neutral position, and a
determinant without sign.
"""


def real_basis(system: Equations[SectorData]) -> HarmonicBasis | None:
    """Return the real set of modes with mass that all harmonics share, so that they describe one
    motion from time integration.

    None if harmonics have different modes, complex modes, or coordinates without mass.
    """
    # harmonics without modes do not count
    first, *others = [basis for basis in system.structure.bases if len(basis.omega2)]
    if (system.structure.arrays["mass"] <= 0.0).any():
        return None
    G = np.asarray(first.G)
    rounding = 1e-12 * np.abs(G).max(initial=0.0)
    if np.abs(G.imag).max(initial=0.0) > rounding:
        return None
    for basis in others:
        if not np.array_equal(basis.omega2, first.omega2):
            return None
        if np.abs(basis.G - G).max(initial=0.0) > rounding:
            return None
    return first


_Part = tuple[float, float, int]
"""Begin and end angle of a segment of the cycle, and its contact state."""


# Kinds of stiffness; for stick and slip the tangential direction, 0 or 1, is added.
_NORMAL = 0
_STICK = 1
_SLIP = 3


class _Piece(NamedTuple):
    """Segment of the cycle with a stiffness of one kind (:func:`cycles`)."""

    point: int
    kind: int
    begin: float
    end: float
    weight: float


class _SliderEvent(NamedTuple):
    """Stick segment of the cycle whose slider is set at its beginning (:func:`cycles`)."""

    point: int
    axis: int
    begin: float
    length: float
    factor: float


def cycles(
    system: Equations[SectorData], x: NDArray
) -> tuple[tuple[NDArray, ...], tuple[NDArray, ...]]:
    """Return the contact states over the cycle.

    Returns
    -------
    pieces : point, kind, begin, end, weight (N/m)
        Segments with stiffness of one kind: 0 ``kn v v``; 1 and 2 ``kt u_d u_d``; 3 and 4
        ``mu kn u_d v``.
    events : point, axis, begin, length, factor
        Stick segments whose slider is set at their beginning.
    """
    pieces: list[_Piece] = []
    events: list[_SliderEvent] = []
    for point in range(system.n_points):
        parts = _parts_of_point(system, x, point)
        pieces += _normal_pieces(system, x, point, parts)
        pieces += _tangential_pieces(system, point, parts)
        events += _slider_events(system, x, point, parts)
    return _columns(pieces), _columns(events)


def _parts_of_point(system: Equations[SectorData], x: NDArray, point: int) -> list[list[_Part]]:
    """Return the segments of a point over the cycle in both tangential directions; none without
    friction.
    """
    p = system.structure.points
    law = int(p.law[point])
    mu = float(p.mu[point])
    if law == LAW_BONDED:
        whole_cycle = [(0.0, TWO_PI, STICK)]
        return [whole_cycle, whole_cycle]
    if not mu > 0.0:
        return [[], []]
    return segments(
        x[point],
        p.kt[point],
        float(p.kn[point]),
        mu,
        float(p.n0[point]),
        p.slider[point],
        law,
        "event_driven",
        float(system.structure.arrays["load"][point]),
    )


def _sliding_axes(system: Equations[SectorData], point: int) -> list[int]:
    """Return the tangential directions in which a point has stiffness."""
    kt = system.structure.points.kt[point]
    return [axis for axis in range(2) if kt[axis] > 0.0]


def _normal_pieces(
    system: Equations[SectorData], x: NDArray, point: int, parts: list[list[_Part]]
) -> list[_Piece]:
    """Return the segments in which the normal spring of a point acts."""
    p = system.structure.points
    kn = float(p.kn[point])
    if int(p.law[point]) in (LAW_BONDED, LAW_CONSTANT):
        return [_Piece(point, _NORMAL, begin=0.0, end=TWO_PI, weight=kn)]
    # both directions separate at the same instants
    with_friction = [parts[axis] for axis in _sliding_axes(system, point) if parts[axis]]
    seen: list[_Part] = []
    if with_friction:
        seen = with_friction[0]
    elif kn > 0.0:
        # without friction: separation from a slider with negligible friction
        kt = np.full(2, kn)
        n0 = float(p.n0[point])
        seen = segments(x[point], kt, kn, mu=1e-12, n0=n0, slider=np.zeros(2))[0]
    return [_Piece(point, _NORMAL, begin, end, kn) for begin, end, state in seen if state != OPEN]


def _limit_stiffness(system: Equations[SectorData], point: int) -> dict[int, float]:
    """Return dT/dv = +-mu kn of a point (N/m) in slip of either direction.

    A constant normal load does not change the friction limit.
    """
    p = system.structure.points
    stiffness = 0.0
    if int(p.law[point]) != LAW_CONSTANT:
        stiffness = float(p.mu[point]) * float(p.kn[point])
    return {SLIP_PLUS: stiffness, SLIP_MINUS: -stiffness}


def _tangential_pieces(
    system: Equations[SectorData], point: int, parts: list[list[_Part]]
) -> list[_Piece]:
    """Return the segments of a point in stick and in slip."""
    limit_stiffness = _limit_stiffness(system, point)
    pieces: list[_Piece] = []
    for axis in _sliding_axes(system, point):
        kt = float(system.structure.points.kt[point, axis])
        # there is one kind of stick and one of slip for each direction
        stick_along_axis = _STICK + axis
        slip_along_axis = _SLIP + axis
        for begin, end, state in parts[axis]:
            if state == STICK:
                pieces.append(_Piece(point, stick_along_axis, begin, end, kt))
            elif state in limit_stiffness:
                stiffness = limit_stiffness[state]
                pieces.append(_Piece(point, slip_along_axis, begin, end, stiffness))
    return pieces


def _slider_events(
    system: Equations[SectorData], x: NDArray, point: int, parts: list[list[_Part]]
) -> list[_SliderEvent]:
    """Return the segments of a point in stick whose slider is set at their beginning.

    The equations for ``dw`` at the beginning of this file define the factor of ``dv``.
    """
    limit_stiffness = _limit_stiffness(system, point)
    events: list[_SliderEvent] = []
    for axis in _sliding_axes(system, point):
        kt = float(system.structure.points.kt[point, axis])
        # permanent stick sets no slider
        if len(parts[axis]) == 1:
            continue
        for index, (begin, end, state) in enumerate(parts[axis]):
            if state != STICK:
                continue
            # the last segment of the period precedes the first one
            _, _, state_before = parts[axis][index - 1]
            if state_before in limit_stiffness:
                factor = -limit_stiffness[state_before] / kt
            else:
                factor = _closing_factor(x[point], axis, begin)
            events.append(_SliderEvent(point, axis, begin, end - begin, factor))
    return events


def _closing_factor(x: NDArray, axis: int, angle: float) -> float:
    """Return -u'/v' of a point at the angle of a closing; 0 if the surfaces do not approach.

    ``x`` (3, 2 H + 1) are the Fourier coefficients of the motion in two tangential directions and
    the normal one: mean, cosine 1, sine 1, cosine 2, sine 2, ...
    """
    cosine = x[:, 1::2]
    sine = x[:, 2::2]
    harmonic = np.arange(1, sine.shape[1] + 1)
    # derivatives of sine and cosine with respect to the angle
    from_sine = sine @ (harmonic * np.cos(harmonic * angle))
    from_cosine = cosine @ (harmonic * np.sin(harmonic * angle))
    velocity = from_sine - from_cosine
    normal_velocity = velocity[2]
    if normal_velocity == 0.0:
        return 0.0
    return float(-velocity[axis] / normal_velocity)


def _columns(rows: Sequence[_Piece | _SliderEvent]) -> tuple[NDArray, ...]:
    """Return the five columns of the segments, the first two as integers."""
    # without rows the columns are empty
    first, second, *others = np.array(rows, float).reshape(-1, 5).T
    return (first.astype(int), second.astype(int), *others)


def rests(system: Equations[SectorData], u: NDArray) -> bool:
    """Return whether no slider moves, no contact state changes, and all springs and dampers are
    passive.
    """
    arrays = system.structure.arrays
    # slip may lie between samples, and the stiffness of a cubic spring changes in each cycle even
    # without slip
    if not system.structure.exact or np.isin(arrays["law"], LAW_CUBIC).any():
        return False
    for name in ("kt", "kn", "damping"):
        if (arrays[name] < 0.0).any():
            return False
    # fractions (n_points, 5) of the cycle: stick and slip in the first tangential direction, the
    # same in the second, and open
    _, _, fractions = system.contact(np.asarray(u))
    slip = fractions[:, [1, 3]]
    is_open = fractions[:, 4]
    has_friction = (arrays["kt"] > 0.0) & (arrays["mu"] > 0.0)[:, None]  # (n_points, 2)
    slips = has_friction & (slip > 0.0)
    opens_and_closes = (is_open > 0.0) & (is_open < 1.0)
    return not (slips.any() or opens_and_closes.any())


def monodromy(system: Equations[SectorData], u: NDArray, omega: float) -> NDArray:
    """Return the monodromy matrix of (q, q', slider positions) over one period from angle 0.

    Parameters
    ----------
    system : Equations[SectorData]
        With one real basis, uncoupled law, event-driven contact forces.
    u : (n_unknowns,) float
    omega : float, rad/s

    Returns
    -------
    (2 n_modes + m, 2 n_modes + m) float
        m is the number of stick segments at the start of which the motion sets a slider position;
        these positions are state variables.
    """
    basis = real_basis(system)
    assert basis is not None
    G = np.asarray(basis.G).real
    n_modes = len(basis.omega2)
    displacements, _, _ = system.contact(np.asarray(u))
    # segments with a stiffness of one kind, and stick segments that begin with a new slider
    # position
    pieces, events = cycles(system, displacements)
    point, kind, piece_begin, piece_end, weight = pieces
    stick_point, axis, stick_begin, stick_length, factor = events

    # a segment adds a spring: its force along one direction is its weight times the motion along
    # another one.  The kinds are, with the tangential directions 0 and 1 and the normal 2:
    #                             normal  stick 0  stick 1  slip 0  slip 1
    force_direction = np.array([2, 0, 1, 0, 1])[kind]
    motion_direction = np.array([2, 0, 1, 2, 2])[kind]
    force = G[point, force_direction]
    motion = G[point, motion_direction]
    # force of a displaced slider of the stick segments whose slider is set
    kt = system.structure.points.kt[stick_point, axis, None]
    slider_force = kt * G[stick_point, axis]

    # the linearised equations have constant coefficients from one of these angles to the next
    changes = [piece_begin, piece_end, stick_begin, stick_begin + stick_length]
    instants = [angle % TWO_PI for angle in changes]
    angles = np.unique(np.concatenate([[0.0], *instants]))
    # events within rounding coincide
    differ = np.append(True, np.diff(angles) > 1e-13)
    angles = angles[differ]
    ends = np.append(angles[1:], TWO_PI)
    # each event sets its slider at the beginning of this interval
    interval_of_event = np.abs(angles[:, None] - stick_begin % TWO_PI).argmin(axis=0)

    # derivatives of the state (q, q', sliders) with respect to the state at angle 0
    displacement = slice(0, n_modes)
    velocity = slice(n_modes, 2 * n_modes)
    first_slider = 2 * n_modes
    derivative = np.eye(first_slider + len(stick_point))
    for interval, (theta, end) in enumerate(zip(angles, ends)):
        # a slip-to-stick event or a closing sets the slider from the motion at its instant:
        # dw = du + factor dv (equations at the beginning of this file)
        for event in np.flatnonzero(interval_of_event == interval):
            tangential = G[stick_point[event], axis[event]]
            normal = G[stick_point[event], 2]
            motion_of_slider = tangential + factor[event] * normal
            derivative[first_slider + event] = motion_of_slider @ derivative[displacement]

        # no state changes within the interval, so the states at its middle hold for all of it
        middle = 0.5 * (theta + end)
        acts = (middle - piece_begin) % TWO_PI < piece_end - piece_begin
        sticks = (middle - stick_begin) % TWO_PI < stick_length

        # rates of (q, q', sliders in stick); a slider in stick keeps its position
        contact_stiffness = (force[acts] * weight[acts, None]).T @ motion[acts]
        stiffness = np.diag(basis.omega2) + contact_stiffness
        size = first_slider + sticks.sum()
        rates = np.zeros((size, size))
        rates[displacement, velocity] = np.eye(n_modes)
        accelerations = np.hstack([-stiffness, -np.diag(basis.damping), slider_force[sticks].T])
        rates[velocity] = accelerations / basis.mass[:, None]

        active = np.append(np.arange(first_slider), first_slider + np.flatnonzero(sticks))
        duration = (end - theta) / omega
        derivative[active] = expm(rates * duration) @ derivative[active]

    # only sliders in stick at the end of the period are state variables
    derivative[first_slider + np.flatnonzero(~sticks)] = 0.0
    return derivative


def multipliers(system: Equations[SectorData], u: NDArray, omega: float) -> NDArray:
    """Return the Floquet multipliers in descending order of modulus; see :func:`monodromy`."""
    values = np.linalg.eigvals(monodromy(system, u, omega))
    descending = np.argsort(-np.abs(values))
    return np.asarray(values[descending])


def unstable_solutions(
    system: Equations[SectorData], unknowns: NDArray, omega: NDArray
) -> tuple[NDArray, str]:
    """Determine which of several solutions of one system are unstable.

    Parameters
    ----------
    system : Equations[SectorData]
    unknowns : (n, n_unknowns) float
    omega : (n,) float, rad/s

    Returns
    -------
    unstable : (n,) bool
    note : str
        Criterion and disturbances considered.
    """
    refuse(system.structure.points.own, "stability")
    laws = system.structure.arrays["law"]
    # cycles() describes neither coupled friction nor cubic springs
    has_other_laws = np.isin(laws, (LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_CUBIC)).any()
    if real_basis(system) is not None and not has_other_laws:
        grows = _multiplier_outside
        note = "all disturbances, multipliers of motion and sliders"
    else:
        grows = _negative_determinant
        note = (
            "sign of det J: negative if a disturbance grows without oscillating; "
            "the others are not examined; use with_stability(in_time=True)"
        )
    unstable = [grows(system, u, w) for u, w in zip(unknowns, omega)]
    return np.array(unstable, bool), note


def _multiplier_outside(system: Equations[SectorData], u: NDArray, omega: float) -> bool:
    """Return whether a disturbance grows from period to period."""
    largest = np.abs(multipliers(system, u, omega)).max(initial=0.0)
    return bool(largest > 1.0 + NEUTRAL)


def _negative_determinant(system: Equations[SectorData], u: NDArray, omega: float) -> bool:
    """Return whether the determinant of the Jacobian is negative; not if it is singular."""
    _, J, _ = system.evaluate(u, omega)
    row_size = np.maximum(np.abs(J).max(axis=1, keepdims=True), 1e-300)
    scaled = J / row_size
    sign, _ = np.linalg.slogdet(scaled)
    if not sign < 0.0:
        return False
    return bool(np.linalg.matrix_rank(scaled, tol=SINGULAR) == len(J))


# ---- stability by time integration ----


def judged_in_time(sectors: AllSectors, curve: ResponseCurve, progress: bool) -> ResponseCurve:
    """Determine the stability of a curve by time integration, and return the curve with the result.

    Points that time integration leaves undecided, and all points after Ctrl-C, retain their
    stability from harmonic balance.

    Parameters
    ----------
    sectors : AllSectors
        All sectors at the preload of the curve.
    curve : ResponseCurve
    progress : bool
    """
    unstable = np.array(curve.unstable, bool)
    n_judged = 0
    moving = np.array([not rests(sectors.system, u) for u in curve.unknowns], bool)
    # without slip and separation the structure is linear and passive, so the motion is stable
    unstable[~moving] = False
    ratios = np.where(moving, np.nan, 1.0)
    indices = np.flatnonzero(moving).tolist()
    with LongWork() as work:
        for i in with_progress(indices, progress, "motion in time", "point"):
            omega = TWO_PI * float(curve.frequency[i])
            verdict, ratio = judged_at(sectors, curve.unknowns[i], omega)
            n_judged += 1
            if verdict != UNDECIDED:
                unstable[i] = verdict != AGREES
                ratios[i] = ratio
    n_resting = int((~moving).sum())
    n_undecided = int(np.isnan(ratios).sum())
    note = (
        f"time integration, amplitude within {100.0 * CRITERIA.tolerance:g} %: {n_judged} of "
        f"{len(curve)} points integrated, {n_resting} without slip or separation, {n_undecided} undecided"
    )
    if work.interrupted:
        note += ", interrupted by the user"
    if n_undecided:
        note += f"; undecided points: {curve.stability_note}"
    return replace(curve, unstable=unstable, stability_note=note, in_time=ratios)


def judged_at(sectors: AllSectors, u: NDArray, omega: float) -> tuple[str, float]:
    """Return the verdict on a solution, and the ratio of the mean amplitude by time integration to
    the amplitude of the solution.
    """
    expected = sectors.system.response(u)
    expected_amplitude = abs(expected[1])
    if not expected_amplitude > 0.0:
        return UNDECIDED, np.nan
    try:
        transient = disturbed(sectors, u, omega, CRITERIA.steps)
        verdict, _ = compare_with_solution(transient, expected)
    except IntegrationFailed:
        return UNDECIDED, np.nan
    if step_error(transient):
        return UNDECIDED, np.nan
    mean = transient.amplitude[-verdict.periods :].mean()
    return verdict.verdict, float(mean / expected_amplitude)


@one_thread
def with_stability(
    problem: Problem,
    curve: ResponseCurve,
    in_time: bool = False,
    progress: bool | None = None,
) -> ResponseCurve:
    """See :meth:`bdamper.Study.with_stability`."""
    check_curve(problem, curve)
    system = problem.system(curve.preload)
    progress = shows_progress(progress)
    validation.flag("in_time", in_time)
    sectors = all_sectors(problem, curve.preload) if in_time else None
    unstable, note = unstable_solutions(system, curve.unknowns, TWO_PI * curve.frequency)
    judged = replace(curve, unstable=unstable, stability_note=note, in_time=None)
    if sectors is None:
        return judged
    return judged_in_time(sectors, judged, progress)
