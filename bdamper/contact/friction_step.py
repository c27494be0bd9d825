r"""Convex problems whose solutions lead to static equilibrium with friction.

Friction that follows the normal force, :math:`|T_d| \le \mu N`, is not associated, so equilibrium is
no minimum of an energy, and a Newton iteration may cycle between contact states.  Two problems with
one quantity held constant are convex (:class:`_FixedLimits`, :class:`_FixedOpening`):

* with fixed friction limits :math:`g = \mu N` the springs have the energy of one-sided normal
  springs and of Coulomb sliders,
* with a fixed opening :math:`s = \mu (|w_1| + |w_2|)` by the slip :math:`w_d` of the step the forces
  are the projection of the spring forces on the pyramid :math:`|T_d| \le \mu N`, in the metric of
  the springs (Acary, Cadoux, Lemarechal and Malick, ZAMM 91, 2011).

A fixed point of :math:`g` or :math:`s` is an equilibrium.  :func:`approximations` iterates on both,
and the Newton iteration of a load step starts from each motion that it yields.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

MOST_OUTER = 25
"""Largest number of values of the limits or openings."""
MOST_INNER = 30
"""Largest number of Newton iterations for one of them; 1 to 10 are usual."""


class Springs(Protocol):
    """Properties of a :class:`bdamper.contact.static_state.StaticSystem` that the problems use.

    That module imports this one, so that this one names no class of it.
    """

    @property
    def stiffness(self) -> NDArray:
        """Modal stiffness (n_modes,)."""

    @property
    def G(self) -> NDArray:
        """Motion (n_points, 3, n_modes) of the points."""

    @property
    def kt(self) -> NDArray:
        """Tangential stiffness (n_points, 2), N/m."""

    @property
    def kn(self) -> NDArray:
        """Normal stiffness (n_points,), N/m."""

    @property
    def mu(self) -> NDArray:
        """Friction coefficient (n_points,)."""

    @property
    def n0(self) -> NDArray:
        """Normal force at zero motion (n_points,), N."""

    @property
    def bonded(self) -> NDArray | bool:
        """Whether a point is bonded, (n_points,)."""


class _ConvexLaw(Protocol):
    """Contact law with one quantity (n_points,) held constant, which makes it a potential."""

    def forces(self, x: NDArray, held: NDArray) -> tuple[NDArray, NDArray]:
        """Return forces (n_points, 3) and derivatives (n_points, 3, 3) at motions x (n_points, 3)."""

    def consistent(self, x: NDArray, force: NDArray) -> NDArray:
        """Return the held quantity (n_points,) that belongs to a motion and its forces."""


class _FixedLimits:
    """Friction limits (N) held constant.

    Parameters
    ----------
    system : Springs
    slider : (n_points, 2) float, m
    """

    def __init__(self, system: Springs, slider: NDArray) -> None:
        self.system = system
        self.slider = slider
        self.bonded = np.broadcast_to(system.bonded, len(system.kn))

    def forces(self, x: NDArray, held: NDArray) -> tuple[NDArray, NDArray]:
        """See :class:`_ConvexLaw`."""
        system = self.system
        level = system.n0 + system.kn * x[:, 2]
        trial = system.kt * (x[:, :2] - self.slider)
        limit = np.where(self.bonded, np.inf, held)[:, None]
        is_closed = (level > 0.0) | self.bonded
        sticks = np.abs(trial) < limit
        force = np.empty((len(level), 3))
        force[:, :2] = np.clip(trial, -limit, limit)
        force[:, 2] = np.where(is_closed, level, 0.0)
        derivative = np.zeros((len(level), 3, 3))
        for d in range(2):
            derivative[:, d, d] = np.where(sticks[:, d], system.kt[:, d], 0.0)
        derivative[:, 2, 2] = np.where(is_closed, system.kn, 0.0)
        return force, derivative

    def consistent(self, x: NDArray, force: NDArray) -> NDArray:
        """Return the friction limits of the normal forces."""
        return np.asarray(self.system.mu * force[:, 2])


class _FixedOpening:
    """Opening (m) by dilatancy held constant.

    Parameters
    ----------
    system : Springs
    slider : (n_points, 2) float, m
    """

    def __init__(self, system: Springs, slider: NDArray) -> None:
        self.system = system
        self.slider = slider
        self.bonded = np.broadcast_to(system.bonded, len(system.kn))
        # directions that can slip, and flexibilities of their springs, (n_points, 2)
        has_spring = system.kt > 0.0
        self.rubs = (system.mu > 0.0)[:, None] & has_spring & ~self.bonded[:, None]
        self.tangential_flexibility = np.where(
            has_spring, 1.0 / np.where(has_spring, system.kt, 1.0), 0.0
        )
        # a point without normal spring has no normal force
        self.normal_flexibility = 1.0 / np.maximum(system.kn, 1e-300)

    def forces(self, x: NDArray, held: NDArray) -> tuple[NDArray, NDArray]:
        """See :class:`_ConvexLaw`."""
        system = self.system
        mu = system.mu
        level = system.n0 + system.kn * (x[:, 2] - held)
        trial = system.kt * (x[:, :2] - self.slider)
        normal = self._normal_force(level, np.abs(trial))
        normal = np.where(self.bonded, system.n0 + system.kn * x[:, 2], normal)

        limit = np.where(self.bonded, np.inf, mu * normal)[:, None]
        force = np.empty((len(level), 3))
        force[:, :2] = np.clip(trial, -limit, limit)
        force[:, 2] = normal

        # the normal force follows the slipping springs: 1 / (1/kn + sum mu^2 / kt)
        is_closed = (normal > 0.0) | self.bonded
        slips = (np.abs(trial) > limit) & self.rubs & is_closed[:, None]
        sense = np.where(slips, np.sign(trial), 0.0)
        by_slip = mu**2 * (slips * self.tangential_flexibility).sum(axis=1)
        stiffness = np.where(is_closed, 1.0 / (self.normal_flexibility + by_slip), 0.0)
        along = np.concatenate([mu[:, None] * sense, np.ones((len(mu), 1))], axis=1)
        derivative = stiffness[:, None, None] * along[:, :, None] * along[:, None, :]
        for d in range(2):
            sticks = is_closed & ~slips[:, d]
            derivative[sticks, d, d] += system.kt[sticks, d]
        return force, derivative

    def _normal_force(self, level: NDArray, trial: NDArray) -> NDArray:
        """Return the normal forces (n_points,) of the projection.

        ``level`` (n_points,) and ``trial`` (n_points, 2), of absolute value, are the forces of the
        springs.
        """
        mu = self.system.mu
        normal = np.zeros(len(level))
        found = np.zeros(len(level), bool)
        # no direction slips, one of them, or both
        for combination in ((False, False), (True, False), (False, True), (True, True)):
            assumed = np.array(combination) & self.rubs
            pull = mu * (assumed * trial * self.tangential_flexibility).sum(axis=1)
            by_slip = mu**2 * (assumed * self.tangential_flexibility).sum(axis=1)
            candidate = level * self.normal_flexibility + pull
            candidate /= self.normal_flexibility + by_slip
            slips = (trial > (mu * candidate)[:, None]) & self.rubs
            fits = (candidate > 0.0) & (slips == assumed).all(axis=1) & ~found
            normal[fits] = candidate[fits]
            found |= fits
        return normal

    def consistent(self, x: NDArray, force: NDArray) -> NDArray:
        """Return the openings of the slip between the slider and the motion."""
        slip = x[:, :2] - self.slider - force[:, :2] * self.tangential_flexibility
        return np.asarray(self.system.mu * np.abs(slip * self.rubs).sum(axis=1))


def approximations(
    system: Springs, force: NDArray, shift: NDArray, slider: NDArray, start: NDArray
) -> Iterator[NDArray]:
    """Yield modal coordinates (n_modes,) that approach equilibrium.

    Parameters
    ----------
    system : Springs
        Without compiled laws and cubic springs.
    force : (n_modes,) float
        Modal load.
    shift : (n_points, 3) float, m
        Motion of the points without modes.
    slider : (n_points, 2) float, m
        Sliders before the step.
    start : (n_modes,) float
    """
    n_points, _, n_modes = system.G.shape
    rows = system.G.reshape(-1, n_modes)
    laws: tuple[_ConvexLaw, ...] = (_FixedLimits(system, slider), _FixedOpening(system, slider))
    for law in laws:
        held = np.zeros(n_points)
        relaxation = 1.0
        size_before = np.inf
        q = start
        for _ in range(MOST_OUTER):
            q = _minimum(system, law, held, force, shift, q)
            yield q
            x = (rows @ q).reshape(-1, 3) + shift
            contact, _ = law.forces(x, held)
            change = law.consistent(x, contact) - held
            size = float(np.abs(change).max(initial=0.0))
            # the iteration alternates if it overshoots
            if size > 0.7 * size_before:
                relaxation = max(0.7 * relaxation, 0.1)
            size_before = size
            held = held + relaxation * change


def _minimum(
    system: Springs,
    law: _ConvexLaw,
    held: NDArray,
    force: NDArray,
    shift: NDArray,
    q: NDArray,
) -> NDArray:
    """Return the coordinates (n_modes,) of least energy, by Newton iteration with line search."""
    rows = system.G.reshape(-1, len(q))
    springs = np.concatenate([system.kt, system.kn[:, None]], axis=1).reshape(-1, 1)
    # stiffness of each coordinate with all points in stick, the unit of its equation
    stuck = system.stiffness + (springs * rows**2).sum(axis=0)
    scale = 1.0 / np.sqrt(np.where(stuck > 0.0, stuck, 1.0))
    for _ in range(MOST_INNER):
        x = (rows @ q).reshape(-1, 3) + shift
        contact, derivative = law.forces(x, held)
        spring_force = system.stiffness * q
        residual = spring_force + rows.T @ contact.ravel() - force
        terms = np.abs(spring_force) + np.abs(rows).T @ np.abs(contact).ravel() + np.abs(force)
        if np.all(np.abs(residual) <= 1e-13 * terms):
            break
        jacobian = np.diag(system.stiffness) + rows.T @ (derivative @ system.G).reshape(rows.shape)
        # a little of the stuck stiffness holds motions that no spring holds
        scaled = jacobian * scale[:, None] * scale + 1e-10 * np.eye(len(q))
        try:
            dq = -scale * scipy.linalg.solve(scaled, scale * residual, assume_a="pos")
        except np.linalg.LinAlgError:
            break
        step = _line_minimum(system, law, held, force, x, q, dq)
        if step == 0.0:
            break
        q = q + step * dq
    return q


def _line_minimum(
    system: Springs,
    law: _ConvexLaw,
    held: NDArray,
    force: NDArray,
    x: NDArray,
    q: NDArray,
    dq: NDArray,
) -> float:
    """Return the fraction of the step ``dq`` with the least energy; x is the motion at its start."""
    dx = (system.G @ dq).reshape(-1, 3)

    def slope(step: float) -> float:
        """Return the derivative of the energy, which increases along the line."""
        contact, _ = law.forces(x + step * dx, held)
        by_modes = (system.stiffness * (q + step * dq) - force) @ dq
        return float(by_modes + np.sum(contact * dx))

    at_start = slope(0.0)
    if at_start >= 0.0:
        return 0.0
    far = 1.0
    at_far = slope(far)
    if abs(at_far) <= 1e-9 * abs(at_start):
        return far
    while at_far < 0.0:
        if far > 1e6:
            return far
        far *= 4.0
        at_far = slope(far)
    # with a tolerance of 1e-3 dampers under 16 mN, next to a shroud under 235 N, have no state
    return float(scipy.optimize.brentq(slope, 0.0, far, xtol=1e-12 * far, disp=False))
