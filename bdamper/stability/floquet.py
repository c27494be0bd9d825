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
oscillate or not: within the nodal diameters of the wave, and within others where they are given, up to one order above the
harmonics of the motion.  Faster ones, such as chatter of a damper without damping of its own on its contacts, are beyond
what so many harmonics describe.  Along a branch it is counted where it may change (:mod:`bdamper.stability.wave`), which
still takes several times as long as the curve.  The sign of ``det J`` at fixed frequency costs next to nothing: it is
negative if an odd number of disturbances of the wave grows without oscillating, as between two folds.  It is all that is
known under coupled friction.

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

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from bdamper.contact.laws import LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_CUBIC
from bdamper.continuation.curve import Curve
from bdamper.continuation.track import check_curve
from bdamper.harmonic_balance.system import HarmonicSystem, segments
from bdamper.model.coupling import HarmonicBasis
from bdamper.problem.problem import Problem
from bdamper.stability.disturbances import SLIP_MINUS, SLIP_PLUS, STICK, TWO_PI, slope_at
from bdamper.stability.in_time import STABLE, TOLERANCE, UNDECIDED, InTimeJudge
from bdamper.stability.time_integration import Motion, Ring
from bdamper.stability.wave import Judge, judged_along, rests
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Stopwatch
from bdamper.util.errors import SettingError
from bdamper.util.repr import brief

NEUTRAL = 1e-6
"""Multipliers up to 1 + this count as within the unit circle: a neutral position is neither stable nor unstable."""


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


def has_one_real_basis(system: HarmonicSystem) -> bool:
    """Whether all harmonics share one real set of modes with inertia, so that they describe one motion in time."""
    first = system.bases[0]
    if (np.asarray(system.arrays["mass"]) <= 0.0).any():
        return False
    for basis in system.bases:
        G = np.asarray(basis.G)
        if G.shape != np.asarray(first.G).shape or len(basis.omega2) != len(first.omega2):
            return False
        size = np.abs(G).max(initial=0.0)
        if np.abs(G.imag).max(initial=0.0) > 1e-12 * size or np.abs(G - first.G).max(initial=0.0) > 1e-12 * size:
            return False
        if not np.array_equal(basis.omega2, first.omega2):
            return False
    return True


@dataclass(frozen=True)
class _Direction:
    """The cycle of one slider: states by segment, as functions of the angle."""

    point: int
    axis: int
    starts: NDArray
    states: NDArray

    def state_at(self, theta: float) -> int:
        i = int(np.searchsorted(self.starts, theta % TWO_PI, side="right")) - 1
        return int(self.states[i])


def _directions(system: HarmonicSystem, x: NDArray) -> tuple[list[_Direction], list[NDArray]]:
    """Cycles of all directions with friction, and for each point the angles and states of the normal contact."""
    p = system.points
    out, normal = [], []
    for i in range(system.n_points):
        parts = segments(x[i], p.kt[i], float(p.kn[i]), float(p.mu[i]), float(p.n0[i]), p.slider[i], int(p.law[i]))
        for axis in range(2):
            if p.mu[i] > 0.0 and p.kt[i, axis] > 0.0 and parts[axis]:
                out.append(_Direction(i, axis, *_unrolled(parts[axis])))
        normal.append(_contact_changes(x[i, 2], float(p.kn[i]), float(p.n0[i])))
    return out, normal


def _unrolled(parts: list[tuple[float, float, int]]) -> tuple[NDArray, NDArray]:
    """Starts in [0, 2 pi), ascending and beginning with 0, and the state that follows each."""
    starts = np.array([a % TWO_PI for a, _, _ in parts])
    states = np.array([s for *_, s in parts])
    order = np.argsort(starts, kind="stable")
    starts, states = starts[order], states[order]
    if starts[0] > 0.0:
        starts, states = np.append(0.0, starts), np.append(states[-1], states)
    return starts, states


def _contact_changes(v: NDArray, kn: float, n0: float) -> NDArray:
    """Angles at which n0 + kn v changes its sign."""
    g = kn * v
    g[0] += n0
    h = len(g) // 2
    if g[0] >= np.hypot(g[1::2], g[2::2]).sum() or g[0] <= -np.hypot(g[1::2], g[2::2]).sum():
        return np.zeros(0)
    z = np.zeros(2 * h + 1, complex)
    z[h] = g[0]
    l = np.arange(1, h + 1)
    z[h + l] = 0.5 * (g[1::2] - 1j * g[2::2])
    z[h - l] = z[h + l].conj()
    r = np.roots(np.trim_zeros(z[::-1], "f"))
    theta = np.sort(np.angle(r[np.abs(np.abs(r) - 1.0) < 1e-7]) % TWO_PI)
    return theta


def _basis(theta: float, h: int) -> NDArray:
    l = np.arange(1, h + 1)
    out = np.ones(2 * h + 1)
    out[1::2], out[2::2] = np.cos(l * theta), np.sin(l * theta)
    return out


def monodromy(system: HarmonicSystem, u: NDArray, omega: float) -> NDArray:
    """Monodromy matrix of (q, q', moving sliders) over one period from the angle 0.

    Parameters
    ----------
    system : HarmonicSystem
        With one real basis, separable law, exact evaluation.
    u : (n_unknowns,) float
    omega : float, rad/s

    Returns
    -------
    (2 n + m, 2 n + m) float
        m sliders that are set within the period, in the order of points and directions.
    """
    p = system.points
    n = len(system.bases[0].omega2)
    x, _, _ = system.contact(np.asarray(u))
    G = np.asarray(system.bases[0].G).real
    directions, lifts = _directions(system, x)
    moving = [d for d in directions if (d.states != STICK).any()]
    fixed = [d for d in directions if (d.states == STICK).all()]
    m = len(moving)
    events = np.unique(np.concatenate([d.starts for d in moving] + list(lifts) + [np.zeros(1)]))
    # events that coincide to rounding are one
    events = events[np.append(True, np.diff(events) > 1e-13)]
    mass = system.bases[0].mass
    linear = np.diag(system.bases[0].omega2)
    for d in fixed:
        linear = linear + p.kt[d.point, d.axis] * np.outer(G[d.point, d.axis], G[d.point, d.axis])
    at_zero = _basis(0.0, system.n_harmonics)
    for i, lift in enumerate(lifts):
        if len(lift) or p.n0[i] + p.kn[i] * (x[i, 2] @ at_zero) <= 0.0:
            continue
        linear = linear + p.kn[i] * np.outer(G[i, 2], G[i, 2])

    M = np.eye(2 * n + m)
    before = [d.state_at(-1e-14 + TWO_PI) for d in moving]
    for k, theta in enumerate(events):
        end = events[k + 1] if k + 1 < len(events) else TWO_PI
        middle = 0.5 * (theta + end)
        A = np.zeros((2 * n + m, 2 * n + m))
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n, n : 2 * n] = -np.diag(system.bases[0].damping)
        stiffness = linear.copy()
        b = _basis(middle, system.n_harmonics)
        for i, lift in enumerate(lifts):
            if len(lift) and p.n0[i] + p.kn[i] * (x[i, 2] @ b) > 0.0:
                stiffness += p.kn[i] * np.outer(G[i, 2], G[i, 2])
        for j, d in enumerate(moving):
            g, kt = G[d.point, d.axis], p.kt[d.point, d.axis]
            r = p.mu[d.point] * p.kn[d.point] / kt
            now = d.state_at(middle)
            if now == STICK and before[j] != STICK:  # the slider is set
                factor = {SLIP_PLUS: -r, SLIP_MINUS: r}.get(before[j])
                if factor is None:
                    slope = slope_at(x[d.point], theta)
                    factor = -slope[d.axis] / slope[2] if slope[2] != 0.0 else 0.0
                row = np.zeros(2 * n + m)
                row[:n] = g + factor * G[d.point, 2]
                M[2 * n + j] = row @ M
            if now == STICK:
                stiffness += kt * np.outer(g, g)
                A[n : 2 * n, 2 * n + j] = kt * g
            elif now in (SLIP_PLUS, SLIP_MINUS):
                sign = 1.0 if now == SLIP_PLUS else -1.0
                stiffness += sign * p.mu[d.point] * p.kn[d.point] * np.outer(g, G[d.point, 2])
            before[j] = now
        A[n : 2 * n, :n] = -stiffness
        A[n : 2 * n] /= mass[:, None]
        active = [int(j) for j in range(m) if before[j] == STICK]
        keep = np.concatenate([np.arange(2 * n), 2 * n + np.array(active, int)])
        step = expm(A[np.ix_(keep, keep)] * ((end - theta) / omega))
        M[keep] = step @ M[keep]
    # a slider that does not stick at the end of the period is no part of the state
    for j, state in enumerate(before):
        if state != STICK:
            M[2 * n + j] = 0.0
    return M


def multipliers(system: HarmonicSystem, u: NDArray, omega: float) -> NDArray:
    """Floquet multipliers, largest modulus first; see :func:`monodromy`."""
    values = np.linalg.eigvals(monodromy(system, u, omega))
    return np.asarray(values[np.argsort(-np.abs(values))])


def shooting_monodromy(
    system: HarmonicSystem, u: NDArray, omega: float, n_steps: int = 0, difference: float = 1e-6
) -> tuple[NDArray, NDArray]:
    """Monodromy of (q, q', w) by marching disturbed states through one period, for any law with a slider.

    Parameters
    ----------
    system : HarmonicSystem
        With one real basis.
    u : (n_unknowns,) float
    omega : float, rad/s
    n_steps : int
        Steps per period; by default as many as the stiffest contact needs.
    difference : float
        Size of the disturbances relative to the vibration.

    Returns
    -------
    (n_state, n_state) monodromy matrix and (n_state,) change of the state over the undisturbed period.
        The state has the sliders that are set within the period; the others are held where the solution has them.
    """
    x, F, shares = system.contact(np.asarray(u))
    rests = shares[:, [0, 2]] > 1.0 - 1e-12
    ring = Ring(system, 1, 0, rests, u)
    n = ring.n_coordinates
    n_steps = n_steps or max(256, ring.steps_for(omega, 0.05))
    q, v = ring.state(u, omega, 0.0)
    kt = np.where(rests, system.points.kt, 1.0)
    w = np.where(rests, x[:, :2, 0] - F[:, :2, 0] / np.where(kt > 0.0, kt, 1.0), ring.initial_slider(u, omega, n_steps))
    size = difference * max(float(np.abs(q).max()), 1e-300)
    state = np.append(np.full(2 * n, True), ~rests.ravel())  # of all that is marched
    scale = np.concatenate([np.full(n, size), np.full(n, size * omega), np.full(w.size, size)])
    scale[2 * n :] *= np.abs(system.bases[0].G).max()
    total = int(state.sum())
    moved = np.diag(scale)[state]
    start = np.concatenate([q[:n], v[:n], w.ravel()]) + np.vstack([np.zeros((1, len(scale))), moved, -moved])
    zero = np.zeros((len(start), n))
    given = np.hstack([start[:, :n], zero]), np.hstack([start[:, n : 2 * n], zero]), start[:, 2 * n :].reshape(-1, *w.shape)
    marched = ring.march(Motion(*given), omega, n_steps).motion
    end = np.hstack([marched.q[:, :n], marched.v[:, :n], marched.w.reshape(len(start), -1)])[:, state]
    differences = (end[1 : total + 1] - end[total + 1 :]) / (2.0 * scale[state, None])
    return differences.T, end[0] - start[0, state]


def stability_of_points(
    system: HarmonicSystem,
    unknowns: NDArray,
    omega: NDArray,
    others: Mapping[int, Mapping[int, HarmonicBasis]] | None = None,
    oscillating: bool = True,
    branch: NDArray | None = None,
) -> Stability:
    """Stability of several solutions of one system.

    Parameters
    ----------
    system : HarmonicSystem
    unknowns : (n, n_unknowns) float
    omega : (n,) float, rad/s
    others : mapping of d to mapping of l to HarmonicBasis, optional
        Modes of further disturbances of a travelling wave, those of nodal diameters ``d + l EO``.
    oscillating : bool
        Whether disturbances of a travelling wave that oscillate while they grow are counted; otherwise the sign of
        ``det J`` is taken.  Multipliers cover them in any case.
    branch : (n,) int, optional
        Points that follow each other with one value lie on one branch; those of a wave are then judged as
        :mod:`bdamper.stability.wave` describes.  By default each is judged by itself.
    """
    started = time.perf_counter()
    n = len(omega)
    largest = np.full(n, np.nan)
    exact_events = np.isin(system.arrays["law"], (0, 1)).all()  # those of the motion, however its forces were found
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
    without_events = np.isin(system.arrays["law"], (LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_CUBIC)).any()
    if not oscillating or without_events or _one_shape(system):
        stable = np.array([_positive_determinant(system, u, w) for u, w in zip(unknowns, omega)], bool).reshape(n)
        note = "sign of det J: disturbances of the wave itself that grow without oscillating"
        return Stability(stable, largest, "determinant", note, time.perf_counter() - started)
    classes: list[Mapping[int, HarmonicBasis] | None] = [None, *(others or {}).values()]
    judge = Judge(system, unknowns, omega, classes, NEUTRAL / TWO_PI)
    moving = np.array([not rests(system, u) for u in unknowns], bool).reshape(n)
    grows, asked = judged_along(
        judge,
        lambda i: _positive_determinant(system, unknowns[i], omega[i]),
        moving,
        np.arange(n) if branch is None else np.asarray(branch),
    )
    stable = grows == 0
    for i in map(int, np.flatnonzero(grows < 0)):
        stable[i] = _positive_determinant(system, unknowns[i], omega[i]) and max(judge(i).counts) <= 0
    for i, verdict in judge.known.items():
        largest[i] = np.exp(TWO_PI * verdict.growth)
    beside = f" and beside it by {', '.join(map(str, others))}" if others else ""
    highest = f"up to {system.n_harmonics + 1} times the frequency"
    note = f"disturbances in the nodal diameters of the wave{beside}, oscillating or not, {highest}"
    counted, between = int(asked.sum()), int((moving & ~asked).sum())
    note += f"; of {n} points {n - moving.sum()} rest, {counted} counted, {between} between points of one count"
    if unknown := int((grows < 0).sum()):
        note += f"; {unknown} could not be followed and were judged by the sign of det J"
    return Stability(stable, largest, "exponents", note, time.perf_counter() - started)


def _one_shape(system: HarmonicSystem) -> bool:
    """Whether all harmonics have the same shapes, as on a structure without cyclic symmetry, but some without inertia."""
    first = np.asarray(system.bases[0].G)
    same = all(np.asarray(b.G).shape == first.shape and np.allclose(b.G, first, rtol=1e-12, atol=0.0) for b in system.bases)
    return same and bool((np.asarray(system.arrays["mass"]) <= 0.0).any())


def _positive_determinant(system: HarmonicSystem, u: NDArray, omega: float) -> bool:
    _, J, _ = system.evaluate(u, omega)
    size = np.maximum(np.abs(J).max(axis=1, keepdims=True), 1e-300)
    sign, _ = np.linalg.slogdet(J / size)
    return bool(sign >= 0.0)


@one_thread
def with_stability(
    problem: Problem,
    curve: Curve,
    nodal_diameters: Sequence[int] = (),
    oscillating: bool = False,
    every_point: bool = False,
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
    nodal_diameters : sequence of int
        Further disturbances of a travelling wave: by how many nodal diameters they differ from it.  The model must have
        the modes of these nodal diameters; those of their harmonics are used where it has them.
    oscillating : bool
        Whether disturbances of a travelling wave that oscillate while they grow are judged as well, which takes some
        times as long as the curve; implied by ``nodal_diameters``.  Without cyclic symmetry they always are if all
        harmonics from the mean on are there, up to the highest (neither ``bias=False`` nor ``harmonics=(1, 3)``), with
        the same modes and without residual modes: all disturbances are judged then.  The note of the curve says which
        were.
    every_point : bool
        Count oscillating growth at every point, instead of only where :mod:`bdamper.stability.wave` asks for it; with
        ``in_time`` march from every point.
    in_time : bool
        Ask the motion in time which solutions a blade keeps (:mod:`bdamper.stability.in_time`): a point is stable if the
        motion that starts there keeps its amplitude to 5 %.  Some seconds for each point that is judged.  Where it remains
        undecided, or after Ctrl-C, what the other settings find is kept, "as far as the harmonics tell" (``curve.labels``).
    progress : bool
        Show a bar of the points marched in time; mostly about half of them are.
    """
    problem = problem.matching(validate.instance("curve", curve, Curve, "a tracking curve").settings)
    check_curve(problem, curve)
    oscillating, every_point = validate.flag("oscillating", oscillating), validate.flag("every_point", every_point)
    in_time = validate.flag("in_time", in_time)
    others = {int(d): bases_beside(problem, int(d)) for d in validate.wholes("nodal_diameters", nodal_diameters)}
    omega, system, judge = TWO_PI * curve.frequency, problem.system(curve.preload), None
    if in_time:
        ring = problem.model.n_blades, int(problem.engine_order)
        judge = InTimeJudge(system, curve.unknowns, omega, *ring, validate.flag("progress", progress))
    result = stability_of_points(
        system,
        curve.unknowns,
        omega,
        others,
        oscillating or bool(others),
        None if every_point else curve.branch,
    )
    note = f"{result.note}; {result.seconds:.2f} s, {curve.cost.seconds:.2f} s for the curve"
    judged = replace(curve, stable=result.stable, stability_note=note, in_time=None)
    return _judged_in_time(judge, judged, every_point) if judge else judged


def _judged_in_time(judge: InTimeJudge, curve: Curve, every_point: bool) -> Curve:
    """A curve with stability from the harmonics, judged by the motion in time as well."""
    watch, system = Stopwatch(), judge.system
    moving = np.array([not rests(system, u) for u in curve.unknowns], bool).reshape(len(curve))
    branch = np.arange(len(curve)) if every_point else np.asarray(curve.branch)
    verdicts, _ = judged_along(
        judge, lambda i: _positive_determinant(system, curve.unknowns[i], judge.omega[i]), moving, branch
    )
    assert curve.stable is not None
    stable = np.where(verdicts == UNDECIDED, curve.stable, verdicts == STABLE)
    note = (
        f"motion in time, amplitude kept to {100.0 * TOLERANCE:g} %: {len(judge.known)} of {len(curve)} points judged, "
        f"{int((~moving).sum())} rest, {int((verdicts == UNDECIDED).sum())} undecided; {watch.read()['seconds']:.3g} s"
        + (", interrupted by the user" if judge.interrupted else "")
    )
    ratios = np.where(moving, judge.ratios(verdicts, curve.branch), 1.0)
    return replace(curve, stable=stable, stability_note=note, in_time=ratios)


def bases_beside(problem: Problem, d: int, highest: int | None = None) -> dict[int, HarmonicBasis]:
    """Modes of the nodal diameters ``d + l EO`` that the model has, by l up to the highest harmonic."""
    for setting, beside in (
        ('contact_stiffness="residual_modes"', problem.contact.residual is not None),
        (f'friction_axes="{problem.friction_axes}"', problem.friction_axes != "contact"),
        ("single_basis=True", problem.single_basis),
        ("separation=False", not problem.separation),
        ("variable_normal_load=False", not problem.variable_normal_load),
    ):
        if beside:
            raise SettingError(f"nodal_diameters cannot be combined with {setting}")
    waves = replace(problem.coupling, engine_order=1)
    have = set.intersection(*(set(b.bases) for b in problem.model.bodies.values() if b.kind == "constrained"))
    out = {}
    highest = problem.harmonic_numbers[-1] if highest is None else highest
    for l in range(-highest, highest + 1):
        order = (d + l * int(problem.engine_order)) % problem.model.n_blades
        if problem.model.folded_nodal_diameter(order)[0] in have:
            out[l] = problem.damped(waves.basis(order))
    if 0 not in out:
        raise SettingError(f"nodal_diameters: expected those whose modes the model has, {sorted(have)}, found {d}")
    return out
