r"""Residual friction forces with which a vibration of closed contacts slips last.

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

from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED, LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_CUBIC, LAW_USER
from bdamper.contact.preload_state import STICK, PreloadState
from bdamper.harmonic_balance.sector import UNDAMPED, SectorData
from bdamper.util import validation
from bdamper.util.errors import SettingError, quiet

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
ROUNDING = 1e-9
"""Rounding error of the forces of stiff joints relative to their reference force; the tolerance of
response curves.

Stiff faces that barely move carry forces far above the excitation: up to 2,000 times on a shroud of
a random sector, which moves by 1.3 m if it is pressed with 14.8 kN.
"""
NO_GAP = 1e-9
"""Gap relative to the vibration below which faces that carry no load touch already."""


class AtRest(Protocol):
    """Load case whose vibration starts from rest."""

    @property
    def problem(self) -> Any: ...

    @property
    def preload(self) -> float: ...

    @property
    def static(self) -> PreloadState: ...

    @property
    def sector(self) -> SectorData: ...

    def stuck_springs(self, *, touching: bool = False) -> NDArray:
        """Return the springs (n_points, 3) of stuck points, N/m."""


class Residual(NamedTuple):
    """Residual friction forces with which a vibration slips last, at one preload.

    Parameters
    ----------
    state : PreloadState
        State at rest with these forces.
    first_slip : float
        Excitation of first slip over that of the study.
    amplitude : float, m
        Response at the stuck resonance.
    rounding : (float, float), N kg^-1/2
        Rounding error of the modal forces of the mean, and of the vibration at this resonance.
    """

    state: PreloadState
    first_slip: float
    amplitude: float
    rounding: tuple[float, float]


def of_case(case: AtRest) -> Residual | None:
    """Return the residual forces from which the vibration of a load case starts, None from rest.

    A vibration of a shroud that slips at first changes the mean friction forces until it slips
    least or not at all.  The friction of other joints is known from the assembly, unless rounding
    hides it.  Then the forces of a vibration without slip take its place, if they exist.
    """
    settings = case.problem.settings
    if settings.residual_forces == "rest" or not can_have(case):
        return None
    most = settings.residual_forces == "most" or bool(settings.shrouds)
    # analyses of the stuck structure warn once of faces that only touch, and this is none
    told = case.problem.sizes.told
    told_before = frozenset(told)
    with quiet():
        try:
            return _of_stuck_resonance(case, most=most)
        finally:
            told.intersection_update(told_before)


def _of_stuck_resonance(case: AtRest, *, most: bool) -> Residual | None:
    """Return the residual forces of the highest stuck resonance.

    With ``most`` they apply in any case, otherwise only if rounding hides those at rest and nothing
    needs to slip.
    """
    resonance = _highest_stuck(case)
    if resonance is None:
        return None
    frequency, amplitude = resonance
    if not most:
        at_rest = _rounding(Programme.at(case, frequency), case.static, frequency)
        if not _exceeds(at_rest, ROUNDING, case):
            return None
    residual = at_resonance(case, frequency, amplitude)
    if residual is None or most:
        return residual
    return residual if residual.first_slip >= 1.0 else None


def _highest_stuck(case: AtRest) -> tuple[float, float] | None:
    """Return frequency (Hz) and amplitude (m) of the highest stuck resonance, None without one."""
    springs = case.stuck_springs(touching=True)
    linear = case.sector.linear
    row = case.sector.response_rows[1]
    highest = 0.0
    top: tuple[float, float] | None = None
    for omega, width, _ in linear.resonances((springs,), 0.0, np.inf):
        if width <= UNDAMPED * omega:
            continue
        amplitude = abs(linear.response(omega, springs) @ row)
        if amplitude > highest:
            highest = amplitude
            top = omega, width
    if top is None:
        return None
    place, amplitude = linear.maximum(row, springs, *top)
    return place / (2.0 * np.pi), amplitude


def can_have(case: AtRest) -> bool:
    """Return whether the contacts of a load case have mean friction forces that may change."""
    problem = case.problem
    settings = problem.settings
    varies = settings.separation and settings.variable_normal_load and settings.bias
    one_force = set(settings.excited) == {1}
    with_law = np.isin(problem.point_laws, (LAW_USER, LAW_CUBIC)).any()
    faces = settings.constrained_faces
    return bool(faces and varies and one_force and not with_law and case.static.ok)


def at_resonance(case: AtRest, frequency: float, amplitude: float) -> Residual | None:
    """Return the residual forces with which a stuck resonance slips last.

    Parameters
    ----------
    case : AtRest
    frequency : float, Hz
    amplitude : float, m

    Returns
    -------
    Residual or None
        None if the excitation exceeds first slip by more than :data:`MOST_SLIP`, or if rounding
        hides the forces.
    """
    programme = Programme.at(case, frequency)
    try:
        limit = programme.solve()
    except SettingError:
        return None
    if not 1.0 / MOST_SLIP <= limit.factor < np.inf:
        return None
    state = programme.state_at(limit)
    rounding = _rounding(programme, state, frequency)
    if _exceeds(rounding, FEWEST_DIGITS, case):
        return None
    return Residual(state, limit.factor, amplitude, rounding)


def _rounding(programme: Programme, state: PreloadState, frequency: float) -> tuple[float, float]:
    """Return the rounding errors of the modal forces of a state, and of a stuck resonance (Hz)."""
    case = programme.case
    omega = 2.0 * np.pi * frequency
    springs = case.stuck_springs(touching=True)
    linear = case.sector.linear
    vibration = np.abs(linear.matrix(omega, springs)) @ np.abs(linear.response(omega, springs))
    of_vibration = float(np.finfo(float).eps * vibration.max())
    return programme.rounding(state), of_vibration


def _exceeds(rounding: tuple[float, float], part: float, case: AtRest) -> bool:
    """Return whether a rounding error exceeds a part of the reference force of its equations."""
    return any(error > part * force for error, force in zip(rounding, case.sector.force_scale))


class Limit(NamedTuple):
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


class Programme:
    """Linear programme for mean forces without slip, as changes from the static state.

    The unknowns are the change of the mean coordinates (n_modes,), that of the mean friction
    (n_points, 2) and the factor on the excitation.

    Parameters
    ----------
    case : AtRest
    motion : (n_points, 3) complex, m
        Motion of harmonic 1 under the excitation, with all closed points stuck.
    springs : (n_points, 3) float, N/m
        Springs of the stuck points, 0 at open ones.
    """

    def __init__(self, case: AtRest, motion: NDArray, springs: NDArray) -> None:
        problem = case.problem
        self.case = case
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

    @classmethod
    def at(cls, case: AtRest, frequency: float) -> Programme:
        """Return the programme at a resonance (Hz) with all closed points stuck."""
        springs = case.stuck_springs(touching=True)
        q = case.sector.linear.response(2.0 * np.pi * frequency, springs)
        motion = np.einsum("pdm,m->pd", case.problem.bases[1].G, q)
        return cls(case, motion, springs)

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

    def solve(self) -> Limit:
        """Return the largest factor, the points that limit it, and the mean forces."""
        system = self.system
        n_points, _, n_modes = system.G.shape
        unlimited = Limit(np.inf, np.zeros(n_points), np.zeros(n_modes), np.zeros((n_points, 2)))
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
        return Limit(factor, weight, mean, friction_change)

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

    def state_at(self, limit: Limit) -> PreloadState:
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
