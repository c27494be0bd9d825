r"""Excitation at which closed contacts begin to slip.

With all closed points stuck, the contact forces of harmonic 1 are
:math:`\lambda (\hat T_d, \hat N)`, proportional to the factor :math:`\lambda` on the excitation.  No
point slips or opens within the cycle if mean forces exist with

.. math:: e\cdot\bar T + \lambda\, |e\cdot\hat T - \mu \hat N| \le \mu \bar N, \qquad \lambda |\hat N| \le \bar N

for the directions :math:`e` of friction, each with its opposite, and mean modal coordinates in equilibrium with them.  All
conditions are linear in :math:`\bar T`, the mean coordinates and :math:`\lambda`, so the largest
:math:`\lambda` is the solution of a linear programme.

The points that are closed in the static state stay closed, and the others stay open within the
cycle.  For :math:`\lambda = 0` the static state satisfies these conditions, and the vibration grows
from there.  A face that its load twists open could also be closed by friction altogether, with
another resonance, but nothing leads there.  On a shroud of a random sector one of nine points carries
24.6 kN.  By harmonic balance the shroud vibrates at the resonance of this point, 141 Hz.  With all
points closed it would have 405 Hz, and slip at a third of the excitation.

This is the condition of Melan for shakedown.  It is necessary, but with coupled normal and
tangential motion not sufficient: which mean forces remain depends on the start (Klarbring,
Ciavarella and Barber, Int. J. Solids Struct. 44, 2007).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from bdamper.contact.laws import (
    LAW_BONDED,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_CUBIC,
    LAW_USER,
    refuse,
)
from bdamper.contact.preload_state import STICK, PreloadState
from bdamper.harmonic_balance.problem import LoadCase, Problem, Residual
from bdamper.response.linear_limits import linear_peak, peak_interval, warn_of_shroud
from bdamper.util import validation
from bdamper.util.display import Summarised
from bdamper.util.errors import SettingError
from bdamper.util.formatting import amount, percent, short_repr
from bdamper.util.statement import Row, Statement

POLYGON = 16
"""Directions of the polygon inside the friction circle of coupled friction.

It is 2 % smaller than the circle across its sides, so that slip begins up to 2 % later than found.
"""
DROPPED = 1e-9
"""Weight of a condition, relative to the largest one, below which it does not limit."""
MOST_SLIP = 10.0
"""Excitation over first slip up to which curves start from the residual forces that allow most.

Far above first slip the vibration renews the friction forces.  A start from those at rest gives the
higher amplitude there: at 290 times first slip 1.35 instead of 0.75 µm on the shipped shroud.
"""
FEWEST_DIGITS = 1e-5
"""Largest rounding error of the residual forces of a shroud relative to their reference force."""
NO_GAP = 1e-9
"""Gap relative to the vibration below which faces that carry no load touch already."""


@short_repr
@dataclass(frozen=True)
class FirstSlip(Summarised):
    """Excitation at which the closed contacts of a resonance begin to slip.

    Parameters
    ----------
    preload : float, N
    excitation : float
        Amplitude of the excitation of the study, in ``unit``.
    unit : str
    factor : float
        Excitation of first slip in units of ``excitation``: above it closed points slip or open, or
        open ones touch.  Infinite if no contact force limits it.
    frequency : float, Hz
        Resonance with all closed points stuck.
    amplitude : float, m
        Amplitude of this resonance under ``excitation``, if nothing slips.
    limiting : mapping of interface name to float
        Contribution of each interface to the limit; the sum is 1.
    touching : float
        Excitation, in units of ``excitation``, at which points that are open at rest touch with
        their gap at rest; infinite if none does.  Below first slip other mean forces can hold them
        apart.
    closed : mapping of interface name to (int, int)
        Numbers of closed points at rest and of all points, for partly closed interfaces.
    """

    preload: float
    excitation: float
    unit: str
    factor: float
    frequency: float
    amplitude: float
    limiting: dict[str, float]
    touching: float
    closed: dict[str, tuple[int, int]]

    @property
    def force(self) -> float:
        """Excitation of first slip, in ``unit``."""
        return self.factor * self.excitation

    @property
    def amplitude_at_first_slip(self) -> float:
        """Amplitude (m) of the stuck resonance at first slip."""
        return self.factor * self.amplitude

    @property
    def locked(self) -> bool:
        """Whether nothing needs to slip under the excitation of the study."""
        return self.factor >= 1.0

    _states_all = True

    def _statement(self) -> Statement:
        own = amount(self.excitation, self.unit)
        subject = f"preload {amount(self.preload, 'N')}, stuck resonance {self.frequency:.4g} Hz"
        if np.isinf(self.factor):
            verdict = f"Friction can lock it under any excitation: {subject}"
        elif self.locked:
            verdict = f"Locked below {amount(self.force, self.unit)}: {subject}"
        else:
            verdict = f"Slips above {amount(self.force, self.unit)}: {subject}"
        rows = [
            Row("Locked amplitude", amount(self.amplitude, "m"), f"under {own}, if nothing slips")
        ]
        if np.isfinite(self.factor):
            rows.append(
                Row("Amplitude", amount(self.amplitude_at_first_slip, "m"), "at first slip")
            )
            rows.append(Row("Margin", f"{self.factor:.3g}", f"first slip over excitation ({own})"))
        if self.touching < self.factor:
            touching = amount(self.touching * self.excitation, self.unit)
            rows.append(Row("Touching", touching, "from here on points that are open at rest"))
        for name, (closed, points) in self.closed.items():
            rows.append(Row("Closed", f"{closed} of {points}", f"points of {name} at rest"))
        by_part = sorted(self.limiting.items(), key=lambda item: -item[1])
        for name, part in by_part:
            if part >= 0.01:
                rows.append(Row(f"Limit by {name}", percent(part)))
        remarks = [
            "Other residual forces give less: the limit is necessary, not sufficient, if normal and "
            "tangential motion are coupled; check with study.time_response",
        ]
        return Statement([verdict], rows, remarks=remarks)


def first_slip(
    case: LoadCase, frequency: tuple[float, float] | None = None, mode: int = 1
) -> FirstSlip:
    """See :meth:`bdamper.Study.first_slip`."""
    problem = case.problem
    refuse(problem.own_laws, "first slip")
    if not (problem.settings.separation and problem.settings.variable_normal_load):
        raise SettingError(
            "first_slip: expected contacts with separation and variable normal load, found a "
            "study without them"
        )
    interval = peak_interval(case, frequency, mode)
    warn_of_shroud(case, interval)
    peak = linear_peak(case, interval, stuck=True)
    validation.check(
        np.isfinite(peak.amplitude),
        "frequency",
        "an interval with a damped resonance of the stuck structure",
        f"{interval[0]:g} to {interval[1]:g} Hz without one",
    )
    programme = _at_resonance(case, peak.frequency)
    limit = programme.solve()
    factor = limit.factor
    weight = limit.weight

    names = np.array(problem.coupling.interface_of)
    total = max(float(weight.sum()), 1e-300)
    limiting = {}
    for name in dict.fromkeys(names.tolist()):
        part = float(weight[names == name].sum()) / total
        if part > 0.0:
            limiting[name] = part
    excitation = problem.settings.excitation
    return FirstSlip(
        preload=case.preload,
        excitation=float(excitation.amplitude),
        unit=problem.settings.unit_of(excitation),
        factor=factor,
        frequency=peak.frequency,
        amplitude=peak.amplitude,
        limiting=limiting,
        touching=programme.touching(),
        closed=programme.partly_closed(),
    )


def residual_state(case: LoadCase, frequency: tuple[float, float]) -> Residual | None:
    """Return the residual forces with which the stuck resonance slips last, if there are any.

    Parameters
    ----------
    case : LoadCase
    frequency : (low, high), Hz

    Returns
    -------
    Residual or None
        None if the excitation exceeds first slip by more than :data:`MOST_SLIP`, if rounding hides
        their forces, or if the faces are not those of a shroud with friction and separation.
    """
    problem = case.problem
    settings = problem.settings
    varies = settings.separation and settings.variable_normal_load and settings.bias
    one_force = set(settings.excited) == {1}
    with_law = np.isin(problem.point_laws, (LAW_USER, LAW_CUBIC)).any()
    if with_law or not (settings.constrained_faces and varies and one_force):
        return None
    peak = linear_peak(case, frequency, stuck=True)
    if not np.isfinite(peak.amplitude):
        return None
    programme = _at_resonance(case, peak.frequency)
    try:
        limit = programme.solve()
    except SettingError:
        return None
    if not 1.0 / MOST_SLIP <= limit.factor < np.inf:
        return None
    state = programme.state_at(limit)

    omega = 2.0 * np.pi * peak.frequency
    springs = case.stuck_springs(touching=True)
    linear = case.sector.linear
    vibration = np.abs(linear.matrix(omega, springs)) @ np.abs(linear.response(omega, springs))
    of_vibration = float(np.finfo(float).eps * vibration.max())
    rounding = (programme.rounding(state), of_vibration)
    scale = case.sector.force_scale
    if any(error > FEWEST_DIGITS * force for error, force in zip(rounding, scale)):
        return None
    return Residual(state, limit.factor, peak.amplitude, rounding, frequency)


def start_as(problem: Problem, other: Problem, preload: float) -> None:
    """Start another study of a structure from its own residual forces if a study starts from such."""
    own = problem.at(preload).residual
    case = other.at(preload)
    if own is not None and case.residual is None:
        other.start_from(preload, residual_state(case, own.interval))


def _at_resonance(case: LoadCase, frequency: float) -> _Programme:
    """Return the linear programme at a resonance (Hz) with all closed points stuck."""
    springs = case.stuck_springs(touching=True)
    q = case.sector.linear.response(2.0 * np.pi * frequency, springs)
    motion = np.einsum("pdm,m->pd", case.problem.bases[1].G, q)
    return _Programme(case, motion, springs)


class _Limit(NamedTuple):
    """Solution of the linear programme.

    Parameters
    ----------
    factor : float
        Largest factor on the excitation without slip; infinite if nothing limits it.
    weight : (n_points,) float
        Weight with which each point limits the factor.
    mean : (n_modes,) float
        Change of the mean modal coordinates from the static state.
    friction : (n_points, 2) float, N
        Change of the mean friction.
    """

    factor: float
    weight: NDArray
    mean: NDArray
    friction: NDArray


class _Programme:
    """Linear programme for mean forces without slip, as changes from the static state.

    The unknowns are the change of the mean coordinates (n_modes,), that of the mean friction
    (n_points, 2) and the factor on the excitation.

    Parameters
    ----------
    case : LoadCase
    motion : (n_points, 3) complex, m
        Motion of harmonic 1 under the excitation, with all closed points stuck.
    springs : (n_points, 3) float, N/m
        Springs of the stuck points, 0 at open ones.
    """

    def __init__(self, case: LoadCase, motion: NDArray, springs: NDArray) -> None:
        problem = case.problem
        self.problem = problem
        # the static state, also where residual forces replace it
        self.state = problem.static(case.preload)
        self.system = problem.static_system(case.preload)
        self.motion = motion
        law = problem.point_laws
        self.bonded = law == LAW_BONDED
        self.closed = (springs > 0.0).any(axis=1) & ~self.bonded
        self.apart = ~self.closed & ~self.bonded & ~problem.coupling.spring_points
        self.coupled = np.isin(law, (LAW_COUPLED, LAW_COUPLED_CONSTANT))
        # unit of force: the largest normal force at rest
        self.unit = max(float(self.state.force[:, 2].max(initial=0.0)), 1e-300)

    def _directions(self) -> list[tuple[NDArray, NDArray, NDArray]]:
        """Return points, direction (2,) and factor on the friction limit of each set of conditions.

        Friction acts along both axes, or within a polygon for coupled friction.
        """
        rubs = self.closed & (self.system.kt > 0.0).any(axis=1)
        along_axes = np.flatnonzero(rubs & ~self.coupled)
        within_circle = np.flatnonzero(rubs & self.coupled)
        sets = []
        for d in range(2):
            for sense in (1.0, -1.0):
                direction = np.zeros(2)
                direction[d] = sense
                sets.append((along_axes, direction, np.ones(1)))
        for angle in 2.0 * np.pi * np.arange(POLYGON) / POLYGON:
            direction = np.array([np.cos(angle), np.sin(angle)])
            sets.append((within_circle, direction, np.full(1, np.cos(np.pi / POLYGON))))
        return sets

    def solve(self) -> _Limit:
        """Return the largest factor, the points that limit it, and the mean forces."""
        system = self.system
        n_points, _, n_modes = system.G.shape
        unlimited = _Limit(np.inf, np.zeros(n_points), np.zeros(n_modes), np.zeros((n_points, 2)))
        static = self.state.force
        kn = np.where(self.closed, system.kn, 0.0)
        kt = np.where(self.closed[:, None], system.kt, 0.0)
        friction_amplitude = kt * self.motion[:, :2]
        normal_amplitude = kn * self.motion[:, 2]

        # coordinates with a stiffness of 1 if all points stick
        springs = np.concatenate([system.kt, system.kn[:, None]], axis=1)
        stuck = system.stiffness + np.einsum("pd,pdm->m", springs, system.G**2)
        coordinate_unit = 1.0 / np.sqrt(np.where(stuck > 0.0, stuck, 1.0))
        G = system.G * coordinate_unit
        # normal force (n_points, n_modes) of the mean coordinates
        normal = kn[:, None] * G[:, 2]

        # equilibrium of the changes: closed points have normal springs, bonded points all springs
        bonded = np.where(self.bonded[:, None], springs, 0.0)
        stiffness = np.diag(system.stiffness * coordinate_unit**2)
        stiffness = stiffness + G[:, 2].T @ normal
        stiffness = stiffness + np.einsum("pdm,pd,pdk->mk", G, bonded, G)
        free = self.closed[:, None] & (system.kt > 0.0)
        friction = (G[:, :2] * free[..., None]).reshape(2 * n_points, n_modes)
        equilibrium = np.hstack([stiffness, friction.T, np.zeros((n_modes, 1))])
        row_size = np.abs(equilibrium).max(axis=1)
        equilibrium = equilibrium / np.where(row_size > 0.0, row_size, 1.0)[:, None]

        rows, limits, points = [], [], []
        size = max(
            np.abs(friction_amplitude).max(initial=0.0), np.abs(normal_amplitude).max(initial=0.0)
        )
        if size == 0.0:
            return unlimited
        for chosen, direction, factor in self._directions():
            mu = factor * system.mu[chosen]
            swing = friction_amplitude[chosen] @ direction - mu * normal_amplitude[chosen]
            row = np.zeros((len(chosen), n_modes + 2 * n_points + 1))
            row[:, :n_modes] = -mu[:, None] * normal[chosen]
            for d in range(2):
                row[np.arange(len(chosen)), n_modes + 2 * chosen + d] = direction[d]
            row[:, -1] = np.abs(swing) / size
            rows.append(row)
            room = mu * static[chosen, 2] - static[chosen, :2] @ direction
            # a point at its limit exceeds it by rounding
            limits.append(np.maximum(room, 0.0) / self.unit)
            points.append(chosen)
        pressed = np.flatnonzero(self.closed)
        row = np.zeros((len(pressed), n_modes + 2 * n_points + 1))
        row[:, :n_modes] = -normal[pressed]
        row[:, -1] = np.abs(normal_amplitude[pressed]) / size
        rows.append(row)
        limits.append(static[pressed, 2] / self.unit)
        points.append(pressed)
        # open points stay open; their gap is negative closing, in units of force by their springs
        apart = np.flatnonzero(self.apart)
        row = np.zeros((len(apart), n_modes + 2 * n_points + 1))
        row[:, :n_modes] = system.kn[apart, None] * G[apart, 2]
        row[:, -1] = system.kn[apart] * np.abs(self.motion[apart, 2]) / size
        rows.append(row)
        gap = np.maximum(-self.state.closing[apart], 0.0)
        limits.append(system.kn[apart] * gap / self.unit)
        points.append(apart)

        cost = np.zeros(n_modes + 2 * n_points + 1)
        cost[-1] = -1.0
        bounds: list[tuple[float | None, float | None]] = [(None, None)] * n_modes
        bounds += [(None, None) if can_rub else (0.0, 0.0) for can_rub in free.ravel()]
        bounds += [(0.0, None)]
        solution = scipy.optimize.linprog(
            cost,
            A_ub=np.vstack(rows),
            b_ub=np.concatenate(limits),
            A_eq=equilibrium,
            b_eq=np.zeros(n_modes),
            bounds=bounds,
            method="highs",
        )
        unbounded = 3
        if solution.status == unbounded:
            return unlimited
        validation.check(
            solution.status == 0,
            "first_slip",
            "a solution of the linear programme",
            solution.message,
        )
        weight = np.zeros(n_points)
        np.add.at(weight, np.concatenate(points), -solution.ineqlin.marginals)
        weight[weight < DROPPED * weight.max(initial=0.0)] = 0.0
        factor = float(solution.x[-1]) * self.unit / size
        mean = solution.x[:n_modes] * coordinate_unit * self.unit
        friction_change = solution.x[n_modes:-1].reshape(n_points, 2) * self.unit
        return _Limit(factor, weight, mean, friction_change)

    def rounding(self, state: PreloadState) -> float:
        """Return a bound of the rounding error of the mean modal contact forces in a state.

        A spring force is the small difference of large displacements if faces move by far more than
        the springs are compressed.
        """
        system = self.system
        G = np.abs(system.G)
        displacement = G @ np.abs(state.q) + np.abs(system.shift_at(state.load))
        displacement[:, :2] += np.abs(state.slider)
        springs = np.concatenate([system.kt, system.kn[:, None]], axis=1)
        forces = springs * displacement * self.closed[:, None]
        modal = np.einsum("pdm,pd->m", G, forces)
        return float(np.finfo(float).eps * modal.max(initial=0.0))

    def state_at(self, limit: _Limit) -> PreloadState:
        """Return the state at rest with the mean forces of a solution, in which closed points stick."""
        system = self.system
        state = self.state
        moved = np.einsum("pdm,m->pd", system.G, limit.mean)
        closed = self.closed[:, None]
        force = state.force.copy()
        force[:, :2] += limit.friction
        force[:, 2] += np.where(self.closed, system.kn * moved[:, 2], 0.0)
        springs = np.concatenate([system.kt, system.kn[:, None]], axis=1)
        force += np.where(self.bonded[:, None], springs * moved, 0.0)
        # the sliders follow the motion, except for the change of the spring forces
        rubs = system.kt > 0.0
        stretched = limit.friction / np.where(rubs, system.kt, 1.0)
        slider = state.slider + moved[:, :2] - np.where(rubs, stretched, 0.0)
        return replace(
            state,
            q=state.q + limit.mean,
            slider=slider,
            force=force,
            closing=state.closing + moved[:, 2],
            status=np.where(closed, STICK, state.status),
        )

    def touching(self) -> float:
        """Return the factor at which a point touches with its gap at rest, or infinity."""
        gap = -self.state.closing[self.apart]
        swing = np.abs(self.motion[self.apart, 2])
        moves = gap > NO_GAP * np.abs(self.motion).max(initial=0.0)
        moves &= swing > 0.0
        return float(np.min(gap[moves] / swing[moves], initial=np.inf))

    def partly_closed(self) -> dict[str, tuple[int, int]]:
        """Return the numbers of closed points and of all points of partly closed interfaces."""
        numbers = {}
        for name in self.problem.coupling.friction_faces:
            closed = self.closed[self.problem.coupling.rows(name)]
            if closed.any() and not closed.all():
                numbers[name] = int(closed.sum()), len(closed)
        return numbers
