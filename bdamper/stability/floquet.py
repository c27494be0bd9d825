"""Stability of periodic solutions with friction: Floquet multipliers of the state that friction has.

A contact point that sticks remembers where it began to, so the state of a disturbed solution is ``(q, q', w)`` with the
sliders ``w``.  Between two events (a change between stick, slip and separation at any point) the linearised equations
have constant coefficients,

    M q'' + C q' + K q + G^T B(G q, w) = 0,

with, for each point and direction: stick ``dT = kt (du - dw)``, slip ``dT = +-mu kn dv``, open nothing, and
``dN = kn dv`` in contact.  One matrix exponential takes the state from event to event; forces are continuous there, so
the state passes unchanged, except for the slider: while a point slips or is open its slider is slaved, and where it
begins to stick

    dw = du -+ (mu kn/kt) dv      after slip in the positive (negative) sense
    dw = du - (u'/v') dv          after a closing, whose instant moves by -dv/v'.

The product over a period is the monodromy matrix; multipliers within the unit circle mean that every small disturbance
dies out.  A slider that is never set within the period has a multiplier of exactly 1, which says nothing: it is left out.

**Which disturbances.**  With one real basis for all harmonics (a structure without cyclic symmetry) these are all
disturbances.  A travelling wave on a disk can also be disturbed by other waves, in which every sector differs, and the
harmonics have bases of their own: there no such state of one sector exists.  Their exponents are the roots of a determinant
with the memory of the sliders in it (:mod:`bdamper.stability.disturbances`), and those that grow are counted, whether they
oscillate or not: within the nodal diameters of the wave, up to one order above the harmonics of the motion.  Faster ones,
such as chatter of a damper without damping of its own on its contacts, are beyond what so many harmonics describe.  Along a
branch it is counted where it may change (:mod:`bdamper.stability.wave`), which still takes several times as long as the
curve.  The sign of ``det J`` at fixed frequency is negative if an odd number of disturbances of the wave grows without
oscillating, as between two folds.  It is all that is known under coupled friction.

**Sliders at rest at the end of their interval.**  A slider that never moves may rest at the very instant of slip.  A
disturbance then moves it once, into a neighbouring solution with another residual traction, and later ones do not: it is
left out like any slider at rest.  Differences of marched motions would not converge to a derivative there, so it is held
while they are taken.

**The motion itself.**  All this is said of the motion with the harmonics of the solution.  ``with_stability(in_time=True)``
asks the motion in time next to it (:mod:`bdamper.stability.in_time`).

Where a law has no event sequence of this kind (coupled friction, constant load), the state is marched through the period
in steps and the monodromy taken from differences: :func:`shooting_monodromy`.  Events fall between its steps, so it is of
first order in the step, while that along the events is exact for the motion given.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from bdamper.contact.laws import LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_CUBIC
from bdamper.contact.own_law import refuse
from bdamper.continuation.curve import Curve
from bdamper.continuation.track import check_curve
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.system import Sector
from bdamper.problem.problem import Problem
from bdamper.stability.disturbances import TWO_PI, cycles
from bdamper.stability.in_time import COUNTS, InTimeJudge
from bdamper.stability.march import AGREES, BOUNDS, UNDECIDED
from bdamper.stability.time_integration import STEPS, Motion, Ring
from bdamper.stability.wave import Judge, judged_along, rests
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Stopwatch
from bdamper.util.repr import brief

NEUTRAL = 1e-6
"""Multipliers up to 1 + this count as within the unit circle: a neutral position is neither stable nor unstable."""
EXACT = 1e-11
"""Residual of the contact forces in a march of which differences are taken."""


@brief
@dataclass(frozen=True)
class Stability:
    """Verdict on one solution or several.

    Parameters
    ----------
    stable : (n,) bool
    largest : (n,) float
        Largest modulus of a multiplier; NaN where it is not known.
    method : {"multipliers", "exponents", "determinant"}
    note : str
        Which disturbances are covered.
    seconds : float
    """

    stable: NDArray
    largest: NDArray
    method: str
    note: str
    seconds: float


def has_one_real_basis(system: Equations[Sector]) -> bool:
    """Whether all harmonics share one real set of modes with inertia, so that they describe one motion in time."""
    first = system.structure.bases[0]
    real = np.abs(np.imag(first.G)).max(initial=0.0) <= 1e-12 * np.abs(first.G).max(initial=0.0)
    one = real and _one_shape(system) and all(np.array_equal(b.omega2, first.omega2) for b in system.structure.bases)
    return bool(one and (np.asarray(system.structure.arrays["mass"]) > 0.0).all())


def _one_shape(system: Equations[Sector]) -> bool:
    """Whether all harmonics have the same shapes, as on a structure without cyclic symmetry."""
    first = np.asarray(system.structure.bases[0].G)
    size = 1e-12 * np.abs(first).max(initial=0.0)
    bases = system.structure.bases
    return all(np.shape(b.G) == first.shape and np.abs(b.G - first).max(initial=0.0) <= size for b in bases)


def monodromy(system: Equations[Sector], u: NDArray, omega: float) -> NDArray:
    """Monodromy matrix of (q, q', sliders that are set) over one period from the angle 0.

    Parameters
    ----------
    system : Equations[Sector]
        With one real basis, separable law, exact evaluation.
    u : (n_unknowns,) float
    omega : float, rad/s

    Returns
    -------
    (2 n + m, 2 n + m) float
        One slider for each of the m parts of the cycle in which one sticks that was set at their beginning.
    """
    basis, n = system.structure.bases[0], len(system.structure.bases[0].omega2)
    G = np.asarray(basis.G).real
    (point, kind, a, b, weight), (at, axis, begin, length, factor) = cycles(system, system.contact(np.asarray(u))[0])
    force, motion = (G[point, np.array(axes)[kind]] for axes in ((2, 0, 1, 0, 1), (2, 0, 1, 2, 2)))
    hold, m = system.structure.points.kt[at, axis, None] * G[at, axis], len(at)
    angles = np.unique(np.concatenate([[0.0], *(x % TWO_PI for x in (a, b, begin, begin + length))]))
    angles = angles[np.append(True, np.diff(angles) > 1e-13)]  # events that coincide to rounding are one
    first = np.abs(angles[:, None] - begin % TWO_PI).argmin(axis=0)
    M = np.eye(2 * n + m)
    for k, (theta, end) in enumerate(zip(angles, np.append(angles[1:], TWO_PI))):
        for j in np.flatnonzero(first == k):  # the slider is set
            M[2 * n + j] = (G[at[j], axis[j]] + factor[j] * G[at[j], 2]) @ M[:n]
        middle = 0.5 * (theta + end)
        now, sticks = (middle - a) % TWO_PI < b - a, (middle - begin) % TWO_PI < length
        K = np.diag(basis.omega2) + (force[now] * weight[now, None]).T @ motion[now]
        A = np.zeros((2 * n + sticks.sum(),) * 2)
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n] = np.hstack([-K, -np.diag(basis.damping), hold[sticks].T]) / basis.mass[:, None]
        keep = np.append(np.arange(2 * n), 2 * n + np.flatnonzero(sticks))
        M[keep] = expm(A * ((end - theta) / omega)) @ M[keep]
    M[2 * n + np.flatnonzero(~sticks)] = 0.0  # what does not stick at the end of the period is no part of the state
    return M


def multipliers(system: Equations[Sector], u: NDArray, omega: float) -> NDArray:
    """Floquet multipliers, largest modulus first; see :func:`monodromy`."""
    values = np.linalg.eigvals(monodromy(system, u, omega))
    return np.asarray(values[np.argsort(-np.abs(values))])


def shooting_monodromy(
    system: Equations[Sector], u: NDArray, omega: float, n_steps: int = 0, difference: float = 1e-6
) -> tuple[NDArray, NDArray]:
    """Monodromy of (q, q', w) by marching disturbed states through one period, for any law with a slider.

    Parameters
    ----------
    system : Equations[Sector]
        With one real basis.
    u : (n_unknowns,) float
    omega : float, rad/s
    n_steps : int
        Steps per period; by default such that the highest frequency of the closed contacts turns by 0.02 in each.
    difference : float
        Size of the disturbances relative to the vibration.

    Returns
    -------
    (n_state, n_state) monodromy matrix and (n_state,) change of the state over the undisturbed period.
        The state has the sliders that are set within the period; the others are held where the solution has them.
    """
    x, F, shares = system.contact(np.asarray(u))
    still = shares[:, [0, 2]] > 1.0 - 1e-12
    ring = Ring(system, 1, 0, still, radius=1.0)
    steps = n_steps or max(STEPS, math.ceil(TWO_PI / omega * ring.highest_frequency() / 0.02))
    start = ring.start(u, omega, steps)
    kt = np.where(still & (system.structure.points.kt > 0.0), system.structure.points.kt, 1.0)
    w = np.where(still, x[:, :2, 0] - F[:, :2, 0] / kt, start.w)
    free, moving = np.flatnonzero(np.append(np.ones_like(ring.real), ~ring.real)), np.flatnonzero(~still)
    # sliders count like coordinates, by the motion of contact points that a unit of these makes
    reach, n = max(float(np.abs(basis.G).max(initial=0.0)) for basis in system.structure.bases), len(free)

    def state(motion: Motion) -> NDArray:
        sliders = motion.w.reshape(*motion.q.shape[:-1], -1)[..., moving] / reach
        return np.concatenate([motion.q[..., free], motion.v[..., free] / omega, sliders], axis=-1)

    def after(z: NDArray) -> NDArray:
        q, v = np.zeros((2, len(z), start.q.size))
        q[:, free], v[:, free] = z[:, :n], z[:, n : 2 * n] * omega
        sliders = np.tile(w.ravel(), (len(z), 1))
        sliders[:, moving] = z[:, 2 * n :] * reach
        motion = Motion(q, v, sliders.reshape(len(z), *w.shape))
        return state(ring.march(motion, omega, steps, tolerance=EXACT).motion)

    z = state(start._replace(w=w))
    small = difference * np.abs(z).max()
    ahead, behind = np.split(after(np.vstack([z + small * np.eye(len(z)), z - small * np.eye(len(z))])), 2)
    return (ahead - behind).T / (2.0 * small), after(z[None])[0] - z


def stability_of_points(
    system: Equations[Sector],
    unknowns: NDArray,
    omega: NDArray,
    branch: NDArray | None = None,
) -> Stability:
    """Stability of several solutions of one system.

    Parameters
    ----------
    system : Equations[Sector]
    unknowns : (n, n_unknowns) float
    omega : (n,) float, rad/s
    branch : (n,) int, optional
        Points that follow each other with one value lie on one branch; those of a wave are then judged as
        :mod:`bdamper.stability.wave` describes.  By default each is judged by itself.
    """
    started = time.perf_counter()
    refuse(system.structure.points.own, "stability")
    n = len(omega)
    largest = np.full(n, np.nan)
    # events are those of the motion, however its forces were found
    exact_events = np.isin(system.structure.arrays["law"], (0, 1)).all()
    if has_one_real_basis(system):
        for i in range(n):
            if exact_events:
                values = multipliers(system, unknowns[i], omega[i])
            else:
                values = np.linalg.eigvals(shooting_monodromy(system, unknowns[i], omega[i])[0])
            largest[i] = np.abs(values).max(initial=0.0)
        return Stability(
            largest <= 1.0 + (NEUTRAL if exact_events else 1e-4),
            largest,
            "multipliers",
            "all disturbances, multipliers of motion and sliders" + ("" if exact_events else " by shooting"),
            time.perf_counter() - started,
        )
    massless = _one_shape(system) and (np.asarray(system.structure.arrays["mass"]) <= 0.0).any()
    without_events = np.isin(system.structure.arrays["law"], (LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_CUBIC)).any()
    if without_events or massless:
        stable = np.array([_positive_determinant(system, u, w) for u, w in zip(unknowns, omega)], bool).reshape(n)
        note = "sign of det J: disturbances of the wave itself that grow without oscillating"
        return Stability(stable, largest, "determinant", note, time.perf_counter() - started)
    judge = Judge(system, unknowns, omega, NEUTRAL / TWO_PI)
    moving = np.array([not rests(system, u) for u in unknowns], bool).reshape(n)
    grows, asked = judged_along(
        judge,
        lambda i: _positive_determinant(system, unknowns[i], omega[i]),
        moving,
        np.arange(n) if branch is None else np.asarray(branch),
    )
    stable = grows == 0
    for i in map(int, np.flatnonzero(grows < 0)):
        stable[i] = _positive_determinant(system, unknowns[i], omega[i]) and judge(i).count <= 0
    for i, verdict in judge.known.items():
        largest[i] = np.exp(TWO_PI * verdict.growth)
    highest = f"up to {system.n_harmonics + 1} times the frequency"
    note = f"disturbances in the nodal diameters of the wave, oscillating or not, {highest}"
    counted, between = int(asked.sum()), int((moving & ~asked).sum())
    note += f"; of {n} points {n - moving.sum()} rest, {counted} counted, {between} between points of one count"
    if unknown := int((grows < 0).sum()):
        note += f"; {unknown} could not be followed and were judged by the sign of det J"
    return Stability(stable, largest, "exponents", note, time.perf_counter() - started)


def _positive_determinant(system: Equations[Sector], u: NDArray, omega: float) -> bool:
    _, J, _ = system.evaluate(u, omega)
    size = np.maximum(np.abs(J).max(axis=1, keepdims=True), 1e-300)
    sign, _ = np.linalg.slogdet(J / size)
    return bool(sign >= 0.0)


@one_thread
def with_stability(
    problem: Problem,
    curve: Curve,
    in_time: bool = False,
    progress: bool = False,
) -> Curve:
    """The same tracking curve with the stability of every point; see :mod:`bdamper.stability.floquet` for what it
    covers.

    Parameters
    ----------
    problem : Problem
    curve : Curve
        Tracked with this problem.
    in_time : bool
        Ask the motion in time which solutions a blade keeps (:mod:`bdamper.stability.in_time`): a point is stable if the
        motion that starts there keeps its amplitude to 5 %.  Where it remains
        undecided, or after Ctrl-C, what the other settings find is kept, "as far as the harmonics tell" (``curve.labels``).
    progress : bool
        Show a bar of the points marched in time; mostly about half of them are.
    """
    validate.instance("curve", curve, Curve, "a tracking curve")
    check_curve(problem, curve)
    in_time = validate.flag("in_time", in_time)
    omega, system, judge = TWO_PI * curve.frequency, problem.system(curve.preload), None
    if in_time:
        judge = InTimeJudge(problem, curve, validate.flag("progress", progress))
    result = stability_of_points(system, curve.unknowns, omega, curve.branch)
    note = f"{result.note}; {result.seconds:.2f} s, {curve.cost.seconds:.2f} s for the curve"
    judged = replace(curve, stable=result.stable, stability_note=note, in_time=None)
    return _judged_in_time(judge, judged) if judge else judged


def _judged_in_time(judge: InTimeJudge, curve: Curve) -> Curve:
    """A curve with stability from the harmonics, judged by the motion in time as well."""
    watch, system = Stopwatch(), judge.system
    moving = np.array([not rests(system, u) for u in curve.unknowns], bool).reshape(len(curve))
    omega = TWO_PI * curve.frequency
    verdicts, _ = judged_along(
        judge, lambda i: _positive_determinant(system, curve.unknowns[i], omega[i]), moving, np.asarray(curve.branch)
    )
    assert curve.stable is not None
    open_ = verdicts == COUNTS[UNDECIDED]
    stable = np.where(open_, curve.stable, verdicts == COUNTS[AGREES])
    note = (
        f"motion in time, amplitude kept to {100.0 * BOUNDS.tolerance:g} %: {len(judge.known)} of {len(curve)} points "
        f"judged, {int((~moving).sum())} rest, {int(open_.sum())} undecided; {watch.read()['seconds']:.3g} s"
        + (", interrupted by the user" if judge.interrupted else "")
    )
    ratios = np.where(moving, judge.ratios(verdicts, curve.branch), 1.0)
    return replace(curve, stable=stable, stability_note=note, in_time=ratios)
