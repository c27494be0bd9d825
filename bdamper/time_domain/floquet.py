"""Stability of periodic solutions with friction: Floquet multipliers with sliders as state variables, and time integration.

A contact point in stick has a memory of the beginning of stick, so the state of a disturbed solution is ``(q, q', w)`` with
the sliders ``w``.  Between two events (a change between stick, slip and separation at any point) the linearised equations
have constant coefficients,

    M q'' + C q' + K q + G^T B(G q, w) = 0,

with, for each point and direction, ``dT = kt (du - dw)`` in stick, ``dT = +-mu kn dv`` in slip, zero in separation, and
``dN = kn dv`` in contact.  A matrix exponential gives the state at the next event.  The forces are continuous there, so the
state passes unchanged, except for the slider.  During slip and separation the slider is no state variable.  At the
beginning of stick it is set to

    dw = du -+ (mu kn/kt) dv      at a slip-to-stick event after positive (negative) slip,
    dw = du - (u'/v') dv          at a closing, whose instant moves by -dv/v'.

The product over a period is the monodromy matrix.  If all multipliers are within the unit circle, every small disturbance
decays.  A slider that is not set within the period has a multiplier of exactly 1 and is left out, also if it rests at its
friction limit: a disturbance moves it once, into a neighbouring solution with another residual traction.

With one real basis for all harmonics (no cyclic symmetry) the multipliers cover all disturbances.

**Sign of det J.**  For a travelling wave the harmonics have different bases, so there is no such state of one sector.
Coupled friction and cubic springs have no event sequence of this kind.  There only the sign of the determinant of the
Jacobian is examined.  It is negative if an odd number of disturbances in the nodal diameters of the wave grows without
oscillating, as between two folds.  Such a point is unstable in the equations of these harmonics, which have branches that
do not exist in time.  Otherwise the point is undecided: growth with oscillation, growth in pairs and other nodal diameters
are not examined.

**Time integration.**  All this applies to the motion with the harmonics of the solution, so time integration decides.  With
``with_stability(in_time=True)`` the motion starts at the solution with a disturbance of every nodal diameter, and
``bdamper.time_domain.transient.judged`` decides whether it keeps its amplitude.  An undamped damper chatters at many points
next to separated peaks, without any period; the criterion is the resulting amplitude, averaged over many periods.
"""

from __future__ import annotations

from dataclasses import replace

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
from bdamper.harmonic_balance.sector import Sector, segments
from bdamper.model.kinematics import HarmonicBasis
from bdamper.response.continuation import TWO_PI
from bdamper.response.response_curve import check_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.time_domain.integration import IntegrationFailed, Ring, ring_of
from bdamper.time_domain.time_response import compare_with_solution, disturbed
from bdamper.time_domain.transient import AGREES, CRITERIA, UNDECIDED, step_error
from bdamper.util import validation
from bdamper.util.progress import CostMeter, LongWork, one_thread, shows_progress, with_progress

# ---- stability by multipliers and by the sign of det J ----


NEUTRAL = 1e-6
"""Multipliers up to 1 + this count as within the unit circle: a neutral position is neither stable nor unstable."""
SINGULAR = 1e-12
"""Singular value below which a Jacobian with rows of unit size has a neutral position, and a determinant without sign."""


def real_basis(system: Equations[Sector]) -> HarmonicBasis | None:
    """Return the real set of modes with mass that all harmonics share, so that they describe one motion in time."""
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


def cycles(
    system: Equations[Sector], x: NDArray
) -> tuple[tuple[NDArray, ...], tuple[NDArray, ...]]:
    """Return the contact states over the cycle.

    Returns
    -------
    pieces : point, kind, begin, end, weight (N/m)
        Segments with stiffness of one kind: 0 ``kn v v``; 1 and 2 ``kt u_d u_d``; 3 and 4 ``mu kn u_d v``.
    events : point, axis, begin, length, factor
        Stick segments whose slider is set at their beginning.
    """
    p, load = system.structure.points, system.structure.arrays["load"]
    pieces: list[tuple[int, int, float, float, float]] = []
    events: list[tuple[int, int, float, float, float]] = []
    l = np.arange(1, x.shape[-1] // 2 + 1)
    for i in range(system.n_points):
        law, mu, kn, n0 = int(p.law[i]), float(p.mu[i]), float(p.kn[i]), float(p.n0[i])
        parts: list[list[tuple[float, float, int]]] = [[], []]
        if law == LAW_BONDED:
            parts = [[(0.0, TWO_PI, STICK)]] * 2
        elif mu > 0.0:
            parts = segments(
                x[i], p.kt[i], kn, mu, n0, p.slider[i], law, "event_driven", float(load[i])
            )
        axes = [d for d in range(2) if p.kt[i, d] > 0.0]
        if law in (LAW_BONDED, LAW_CONSTANT):
            pieces.append((i, 0, 0.0, TWO_PI, kn))
        else:
            seen = next((parts[d] for d in axes if parts[d]), [])
            if (
                not seen and kn > 0.0
            ):  # without friction: separation from a slider with negligible friction
                seen = segments(x[i], np.full(2, kn), kn, 1e-12, n0, np.zeros(2))[0]
            pieces += [(i, 0, a, b, kn) for a, b, state in seen if state != OPEN]
        reach = 0.0 if law == LAW_CONSTANT else mu * kn
        slip = {SLIP_PLUS: reach, SLIP_MINUS: -reach}
        for d in axes:
            kt = float(p.kt[i, d])
            for k, (a, b, state) in enumerate(parts[d]):
                if state in slip:
                    pieces.append((i, 3 + d, a, b, slip[state]))
                elif state == STICK:
                    pieces.append((i, 1 + d, a, b, kt))
                    if len(parts[d]) == 1:  # permanent stick sets no slider
                        continue
                    if (before := parts[d][k - 1][2]) in slip:
                        factor = -slip[before] / kt
                    else:
                        slope = x[i, :, 2::2] @ (l * np.cos(l * a)) - x[i, :, 1::2] @ (
                            l * np.sin(l * a)
                        )
                        factor = -slope[d] / slope[2] if slope[2] != 0.0 else 0.0
                    events.append((i, d, a, b - a, factor))
    return _columns(pieces), _columns(events)


def _columns(rows: list[tuple[int, int, float, float, float]]) -> tuple[NDArray, ...]:
    table = np.array(rows, float).reshape(-1, 5).T
    return (table[0].astype(int), table[1].astype(int), *table[2:])


def rests(system: Equations[Sector], u: NDArray) -> bool:
    """Return whether no slider moves, no contact state changes, and all springs and dampers are passive."""
    a = system.structure.arrays
    if not system.structure.exact or np.isin(a["law"], LAW_CUBIC).any():
        return False
    if any((a[name] < 0.0).any() for name in ("kt", "kn", "damping")):
        return False
    _, _, shares = system.contact(np.asarray(u))
    slips = (a["kt"] > 0.0) & (a["mu"] > 0.0)[:, None] & (shares[:, [1, 3]] > 0.0)
    changes = (shares[:, 4] > 0.0) & (shares[:, 4] < 1.0)
    return not (slips.any() or changes.any())


def monodromy(system: Equations[Sector], u: NDArray, omega: float) -> NDArray:
    """Return the monodromy matrix of (q, q', sliders that are set) over one period from angle 0.

    Parameters
    ----------
    system : Equations[Sector]
        With one real basis, uncoupled law, event-driven contact forces.
    u : (n_unknowns,) float
    omega : float, rad/s

    Returns
    -------
    (2 n + m, 2 n + m) float
        One slider for each of the m stick segments at whose beginning it is set.
    """
    basis = real_basis(system)
    assert basis is not None
    G = np.asarray(basis.G).real
    n = len(basis.omega2)
    displacements, _, _ = system.contact(np.asarray(u))
    pieces, events = cycles(system, displacements)
    point, kind, a, b, weight = pieces
    at, axis, begin, length, factor = events

    # direction of the force of each kind of segment, and of the motion that causes it (2 is normal)
    force = G[point, np.array([2, 0, 1, 0, 1])[kind]]
    motion = G[point, np.array([2, 0, 1, 2, 2])[kind]]
    slider_force = system.structure.points.kt[at, axis, None] * G[at, axis]

    # the linearised equations have constant coefficients from one of these angles to the next
    instants = [x % TWO_PI for x in (a, b, begin, begin + length)]
    angles = np.unique(np.concatenate([[0.0], *instants]))
    angles = angles[np.append(True, np.diff(angles) > 1e-13)]  # events within rounding coincide
    ends = np.append(angles[1:], TWO_PI)
    interval_of_event = np.abs(angles[:, None] - begin % TWO_PI).argmin(axis=0)

    M = np.eye(2 * n + len(at))
    for i, (theta, end) in enumerate(zip(angles, ends)):
        # a slip-to-stick event or a closing sets the slider from the motion at its instant
        for j in np.flatnonzero(interval_of_event == i):
            M[2 * n + j] = (G[at[j], axis[j]] + factor[j] * G[at[j], 2]) @ M[:n]

        # no state changes within the interval, so the states at its middle hold for all of it
        middle = 0.5 * (theta + end)
        acts = (middle - a) % TWO_PI < b - a
        sticks = (middle - begin) % TWO_PI < length

        # rates of (q, q', sliders in stick); a slider in stick keeps its position
        K = np.diag(basis.omega2) + (force[acts] * weight[acts, None]).T @ motion[acts]
        size = 2 * n + sticks.sum()
        A = np.zeros((size, size))
        A[:n, n : 2 * n] = np.eye(n)
        accelerations = np.hstack([-K, -np.diag(basis.damping), slider_force[sticks].T])
        A[n : 2 * n] = accelerations / basis.mass[:, None]

        state = np.append(np.arange(2 * n), 2 * n + np.flatnonzero(sticks))
        M[state] = expm(A * ((end - theta) / omega)) @ M[state]

    # only sliders in stick at the end of the period are state variables
    M[2 * n + np.flatnonzero(~sticks)] = 0.0
    return M


def multipliers(system: Equations[Sector], u: NDArray, omega: float) -> NDArray:
    """Return the Floquet multipliers in descending order of the modulus; see :func:`monodromy`."""
    values = np.linalg.eigvals(monodromy(system, u, omega))
    return np.asarray(values[np.argsort(-np.abs(values))])


def unstable_solutions(
    system: Equations[Sector], unknowns: NDArray, omega: NDArray
) -> tuple[NDArray, str]:
    """Determine which of several solutions of one system are unstable.

    Parameters
    ----------
    system : Equations[Sector]
    unknowns : (n, n_unknowns) float
    omega : (n,) float, rad/s

    Returns
    -------
    unstable : (n,) bool
    note : str
        Criterion and disturbances considered.
    """
    refuse(system.structure.points.own, "stability")
    without_events = np.isin(
        system.structure.arrays["law"], (LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_CUBIC)
    ).any()
    if real_basis(system) is not None and not without_events:
        grows = _multiplier_outside
        note = "all disturbances, multipliers of motion and sliders"
    else:
        grows = _negative_determinant
        note = (
            "sign of det J: negative if a disturbance grows without oscillating; "
            "the others are not examined, with_stability(in_time=True) decides"
        )
    unstable = [grows(system, u, w) for u, w in zip(unknowns, omega)]
    return np.array(unstable, bool), note


def _multiplier_outside(system: Equations[Sector], u: NDArray, omega: float) -> bool:
    return bool(np.abs(multipliers(system, u, omega)).max(initial=0.0) > 1.0 + NEUTRAL)


def _negative_determinant(system: Equations[Sector], u: NDArray, omega: float) -> bool:
    _, J, _ = system.evaluate(u, omega)
    size = np.maximum(np.abs(J).max(axis=1, keepdims=True), 1e-300)
    sign, _ = np.linalg.slogdet(J / size)
    return bool(sign < 0.0 and np.linalg.matrix_rank(J / size, tol=SINGULAR) == len(J))


# ---- stability by time integration ----


def judged_in_time(ring: Ring, curve: ResponseCurve, progress: bool) -> ResponseCurve:
    """Return a curve with stability by time integration in addition to the stability by the harmonics.

    Undecided points, and all points after Ctrl-C, keep the stability by the harmonics.

    Parameters
    ----------
    ring : Ring
        All sectors at the preload of the curve.
    curve : ResponseCurve
    progress : bool
    """
    watch, unstable, judged = CostMeter(), np.array(curve.unstable, bool), 0
    moving = np.array([not rests(ring.system, u) for u in curve.unknowns], bool).reshape(len(curve))
    unstable[~moving] = False
    ratios = np.where(moving, np.nan, 1.0)
    with LongWork() as work:
        for i in with_progress(
            np.flatnonzero(moving).tolist(), progress, "motion in time", "point"
        ):
            verdict, ratio = judged_at(ring, curve.unknowns[i], TWO_PI * float(curve.frequency[i]))
            judged += 1
            if verdict != UNDECIDED:
                unstable[i], ratios[i] = verdict != AGREES, ratio
    note = (
        f"motion in time, amplitude kept to {100.0 * CRITERIA.tolerance:g} %: {judged} of {len(curve)} points judged, "
        f"{int((~moving).sum())} rest, {int(np.isnan(ratios).sum())} undecided; {watch.read().seconds:.3g} s"
        + (", interrupted by the user" if work.interrupted else "")
        + (f"; the undecided: {curve.stability_note}" if np.isnan(ratios).any() else "")
    )
    return replace(curve, unstable=unstable, stability_note=note, in_time=ratios)


def judged_at(ring: Ring, u: NDArray, omega: float) -> tuple[str, float]:
    """Return the verdict on a solution, and the ratio of the mean amplitude in time to the amplitude of the solution."""
    expected = ring.system.response(u)
    if not abs(expected[1]) > 0.0:
        return UNDECIDED, np.nan
    try:
        transient = disturbed(ring, u, omega, CRITERIA.steps)
        verdict, _ = compare_with_solution(transient, expected)
    except IntegrationFailed:
        return UNDECIDED, np.nan
    if step_error(transient):
        return UNDECIDED, np.nan
    return verdict.verdict, float(transient.amplitude[-verdict.periods :].mean() / abs(expected[1]))


@one_thread
def with_stability(
    problem: Problem,
    curve: ResponseCurve,
    in_time: bool = False,
    progress: bool | None = None,
) -> ResponseCurve:
    """See :meth:`bdamper.Study.with_stability`."""
    check_curve(problem, curve)
    system, progress = problem.system(curve.preload), shows_progress(progress)
    ring = ring_of(problem, curve.preload) if validation.flag("in_time", in_time) else None
    watch = CostMeter()
    unstable, note = unstable_solutions(system, curve.unknowns, TWO_PI * curve.frequency)
    note = f"{note}; {watch.read().seconds:.2f} s, {curve.cost.seconds:.2f} s for the curve"
    judged = replace(curve, unstable=unstable, stability_note=note, in_time=None)
    return judged if ring is None else judged_in_time(ring, judged, progress)
