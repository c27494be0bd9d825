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

**Disturbances.**  With one real basis for all harmonics (no cyclic symmetry) the multipliers cover all disturbances.  For a
travelling wave the harmonics have different bases, so there is no such state of one sector.  The exponents are then the
roots of a determinant that includes the memory of the sliders (:mod:`bdamper.time_domain.wave_exponents`).  Growing
disturbances are counted, oscillating or not, within the nodal diameters of the wave and up to one order above the harmonics
of the motion. Faster ones, such as chatter of an undamped damper on its contacts, are beyond the range of these harmonics.
If no slider moves and no contact state changes, the equations are linear with symmetric stiffness and nothing grows.

**Sign of det J.**  At fixed frequency it is negative if an odd number of disturbances of the wave grows without
oscillation, as between two folds.  It is the only criterion for coupled friction and cubic springs, which have no event
sequence of this kind. The equations of a few harmonics have branches that do not exist in time, so such points are labelled
by the sign, not as stable or unstable.

**Time integration.**  All this applies to the motion with the harmonics of the solution.  With
``with_stability(in_time=True)`` the motion starts at the solution with a disturbance of every nodal diameter, and
``bdamper.time_domain.march.judged`` decides whether it keeps its amplitude
(``bdamper.time_domain.transients.verified``). An undamped damper chatters at many points next to separated peaks,
without any period; the criterion is the resulting amplitude, averaged over many periods.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from bdamper.contact.laws import LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_CUBIC, refuse
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import Sector
from bdamper.response.continuation import TWO_PI
from bdamper.response.response_curve import check_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.time_domain.integration import MarchFailed, Ring, ring_of
from bdamper.time_domain.march import AGREES, LIMITS, UNDECIDED
from bdamper.time_domain.transients import march_from, verified
from bdamper.time_domain.wave_exponents import WaveDisturbances, cycles, rests
from bdamper.util import validation
from bdamper.util.progress import CostMeter, LongWork, one_thread, with_progress

# ---- stability by multipliers and exponents ----


NEUTRAL = 1e-6
"""Multipliers up to 1 + this count as within the unit circle: a neutral position is neither stable nor unstable."""
SINGULAR = 1e-12
"""Singular value below which a Jacobian with rows of unit size has a neutral position, and a determinant without sign."""


@dataclass(frozen=True)
class Stability:
    """Stability of one or several solutions.

    Parameters
    ----------
    stable : (n,) bool
    largest : (n,) float
        Largest modulus of a multiplier; NaN if unknown.
    method : {"multipliers", "exponents", "determinant"}
    note : str
        Disturbances considered.
    """

    stable: NDArray
    largest: NDArray
    method: str
    note: str


def has_one_real_basis(system: Equations[Sector]) -> bool:
    """Return whether all harmonics share one real set of modes with mass, so that they describe one motion in time."""
    first = system.structure.bases[0]
    real = np.abs(np.imag(first.G)).max(initial=0.0) <= 1e-12 * np.abs(first.G).max(initial=0.0)
    one = real and _one_shape(system) and all(np.array_equal(b.omega2, first.omega2) for b in system.structure.bases)
    return bool(one and (np.asarray(system.structure.arrays["mass"]) > 0.0).all())


def _one_shape(system: Equations[Sector]) -> bool:
    """Return whether all harmonics have the same mode shapes, as without cyclic symmetry."""
    first = np.asarray(system.structure.bases[0].G)
    size = 1e-12 * np.abs(first).max(initial=0.0)
    bases = system.structure.bases
    return all(np.shape(b.G) == first.shape and np.abs(b.G - first).max(initial=0.0) <= size for b in bases)


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
    basis, n = system.structure.bases[0], len(system.structure.bases[0].omega2)
    G = np.asarray(basis.G).real
    (point, kind, a, b, weight), (at, axis, begin, length, factor) = cycles(system, system.contact(np.asarray(u))[0])
    force, motion = (G[point, np.array(axes)[kind]] for axes in ((2, 0, 1, 0, 1), (2, 0, 1, 2, 2)))
    hold, m = system.structure.points.kt[at, axis, None] * G[at, axis], len(at)
    angles = np.unique(np.concatenate([[0.0], *(x % TWO_PI for x in (a, b, begin, begin + length))]))
    angles = angles[np.append(True, np.diff(angles) > 1e-13)]  # events within rounding coincide
    first = np.abs(angles[:, None] - begin % TWO_PI).argmin(axis=0)
    M = np.eye(2 * n + m)
    for k, (theta, end) in enumerate(zip(angles, np.append(angles[1:], TWO_PI))):
        for j in np.flatnonzero(first == k):  # slip-to-stick event or closing sets the slider
            M[2 * n + j] = (G[at[j], axis[j]] + factor[j] * G[at[j], 2]) @ M[:n]
        middle = 0.5 * (theta + end)
        now, sticks = (middle - a) % TWO_PI < b - a, (middle - begin) % TWO_PI < length
        K = np.diag(basis.omega2) + (force[now] * weight[now, None]).T @ motion[now]
        A = np.zeros((2 * n + sticks.sum(),) * 2)
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n] = np.hstack([-K, -np.diag(basis.damping), hold[sticks].T]) / basis.mass[:, None]
        keep = np.append(np.arange(2 * n), 2 * n + np.flatnonzero(sticks))
        M[keep] = expm(A * ((end - theta) / omega)) @ M[keep]
    M[2 * n + np.flatnonzero(~sticks)] = 0.0  # only sliders in stick at the end of the period are state variables
    return M


def multipliers(system: Equations[Sector], u: NDArray, omega: float) -> NDArray:
    """Return the Floquet multipliers in descending order of the modulus; see :func:`monodromy`."""
    values = np.linalg.eigvals(monodromy(system, u, omega))
    return np.asarray(values[np.argsort(-np.abs(values))])


def stability_of_points(system: Equations[Sector], unknowns: NDArray, omega: NDArray) -> Stability:
    """Compute the stability of several solutions of one system.

    Parameters
    ----------
    system : Equations[Sector]
    unknowns : (n, n_unknowns) float
    omega : (n,) float, rad/s

    Returns
    -------
    Stability
    """
    refuse(system.structure.points.own, "stability")
    n, solutions, largest = len(omega), list(zip(unknowns, omega)), np.full(len(omega), np.nan)
    without_events = np.isin(system.structure.arrays["law"], (LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_CUBIC)).any()
    massless = _one_shape(system) and (np.asarray(system.structure.arrays["mass"]) <= 0.0).any()
    if without_events or massless:
        method, note = "determinant", "sign of det J: disturbances of the wave itself that grow without oscillating"
        stable = np.array([_positive_determinant(system, u, w) for u, w in solutions], bool)
    elif has_one_real_basis(system):
        method, note = "multipliers", "all disturbances, multipliers of motion and sliders"
        largest = np.array([np.abs(multipliers(system, u, w)).max(initial=0.0) for u, w in solutions]).reshape(n)
        stable = largest <= 1.0 + NEUTRAL
    else:
        method, note = "exponents", "disturbances in the nodal diameters of the wave, oscillating or not"
        moving = [not rests(system, u) for u in unknowns]
        grows = np.array([_growing(system, u, w) if moves else 0 for (u, w), moves in zip(solutions, moving)], int)
        stable = grows == 0
        note += f", up to {system.n_harmonics + 1} times the frequency"
        note += f"; {sum(moving)} of {n} points counted, the others rest"
        unknown = np.flatnonzero(grows < 0)
        for i in unknown:
            stable[i] = _positive_determinant(system, *solutions[i])
        if len(unknown):
            note += f"; {len(unknown)} could not be followed and were judged by the sign of det J"
    return Stability(stable, largest, method, note)


def _growing(system: Equations[Sector], u: NDArray, omega: float) -> int:
    """Return the number of growing disturbances of a wave; -1 if they cannot be counted."""
    try:
        return WaveDisturbances(system, u, omega).growing(NEUTRAL / TWO_PI * omega, (system.n_harmonics + 1) * omega)
    except FloatingPointError:
        return -1


def _positive_determinant(system: Equations[Sector], u: NDArray, omega: float) -> bool:
    _, J, _ = system.evaluate(u, omega)
    size = np.maximum(np.abs(J).max(axis=1, keepdims=True), 1e-300)
    sign, _ = np.linalg.slogdet(J / size)
    return bool(sign >= 0.0 or np.linalg.matrix_rank(J / size, tol=SINGULAR) < len(J))


# ---- stability by time integration ----


def judged_in_time(ring: Ring, curve: ResponseCurve, progress: bool) -> ResponseCurve:
    """Return a curve with stability by time integration in addition to the harmonics.

    Undecided points, and all points after Ctrl-C, keep the stability by the harmonics.

    Parameters
    ----------
    ring : Ring
        All sectors at the preload of the curve.
    curve : ResponseCurve
    progress : bool
    """
    watch, stable, judged = CostMeter(), np.array(curve.stable, bool), 0
    moving = np.array([not rests(ring.system, u) for u in curve.unknowns], bool).reshape(len(curve))
    stable[~moving] = True
    ratios = np.where(moving, np.nan, 1.0)
    with LongWork() as work:
        for i in with_progress(np.flatnonzero(moving).tolist(), progress, "motion in time", "point"):
            verdict, ratio = judged_at(ring, curve.unknowns[i], TWO_PI * float(curve.frequency[i]))
            judged += 1
            if verdict != UNDECIDED:
                stable[i], ratios[i] = verdict == AGREES, ratio
    note = (
        f"motion in time, amplitude kept to {100.0 * LIMITS.tolerance:g} %: {judged} of {len(curve)} points judged, "
        f"{int((~moving).sum())} rest, {int(np.isnan(ratios).sum())} undecided; {watch.read().seconds:.3g} s"
        + (", interrupted by the user" if work.interrupted else "")
        + (f"; the undecided: {curve.stability_note}" if np.isnan(ratios).any() else "")
    )
    return replace(curve, stable=stable, stability_note=note, in_time=ratios)


def judged_at(ring: Ring, u: NDArray, omega: float) -> tuple[str, float]:
    """Return the verdict on a solution, and its mean amplitude in time over the amplitude of the solution."""
    expected = ring.system.response(u)
    if not abs(expected[1]) > 0.0:
        return UNDECIDED, np.nan
    try:
        response = verified(march_from(ring, u, omega, LIMITS.steps), expected)
    except MarchFailed:
        return UNDECIDED, np.nan
    return response.verdict, float(response.amplitude[-LIMITS.settled :].mean() / response.balance)


@one_thread
def with_stability(
    problem: Problem,
    curve: ResponseCurve,
    in_time: bool = False,
    progress: bool = False,
) -> ResponseCurve:
    """Return the response curve with the stability of every point (:mod:`bdamper.time_domain.floquet`).

    Parameters
    ----------
    problem : Problem
    curve : ResponseCurve
        Response curve of this problem.
    in_time : bool
        Whether to integrate in time from each point.  A point is stable if the motion keeps its amplitude to 5 %.
        Undecided points, and all points after Ctrl-C, keep the label "as far as the harmonics tell" (``curve.labels``).
    progress : bool
        Show a progress bar of the points integrated in time.

    Returns
    -------
    ResponseCurve
    """
    check_curve(problem, curve)
    system, progress = problem.system(curve.preload), validation.flag("progress", progress)
    ring = ring_of(problem, curve.preload) if validation.flag("in_time", in_time) else None
    watch = CostMeter()
    result = stability_of_points(system, curve.unknowns, TWO_PI * curve.frequency)
    note = f"{result.note}; {watch.read().seconds:.2f} s, {curve.cost.seconds:.2f} s for the curve"
    judged = replace(curve, stable=result.stable, stability_note=note, in_time=None)
    return judged if ring is None else judged_in_time(ring, judged, progress)
