"""Quasi-static contact analysis: normal load, gap and slider of every contact point.

It follows section 3.1 of the paper.  The mean position ``q`` of the structure without vibration
satisfies harmonic 0 of the equations of motion::

    K q + G^T F(x) = P f + f_0,      x = G q + P s + s_0 = (u1, u2, v),
    N = max(n0 + kn v, 0),     T_d = kt_d (u_d - w_d),   |T_d| <= mu N.

Interference and the constant loads ``f_0``, ``s_0`` are applied first, together and in proportion;
then P increases from zero.  If a free body has no equilibrium without P, or if none follows from
there, all of them increase together.

Each point has a state for each tangential direction: stick, slip in either sense, or separation.
Between changes of state the motion is linear in the load.  A load step solves for the states at its
end, with the sliders of the previous step.  It is exact if the forces are linear along the straight
line between both motions (:func:`linear_range`), and otherwise ends at the first change of state.
The result thus depends on the loading history, but not on the number of steps.

Bonded points always stick, with springs in tension and compression.  Points with compiled laws
(``bdamper.contact.laws``) count as separated without stiffness, as sticking at the stiffness of
their springs, and as slipping between.

Friction acts independently along both tangential directions, as in the paper, also if the vibration
analysis uses a coupled law: the equations are linear between changes of state.  With slip in both
directions friction may exceed ``mu N`` by up to the square root of two; the coupled law then moves
the slider (``csrc/contact/coupled_friction.c``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from bdamper.contact.complementarity import possible_states
from bdamper.contact.friction_step import approximations
from bdamper.contact.laws import OwnLaws, PointArrays
from bdamper.contact.preload_state import OPEN, SLIP_MINUS, SLIP_PLUS, STICK, PreloadState
from bdamper.util.formatting import percent, short_repr

_getrf, _getrs, _gecon = get_lapack_funcs(("getrf", "getrs", "gecon"), dtype=float)


@short_repr
@dataclass(frozen=True)
class StaticSystem:
    """Arrays of the static contact problem.

    Parameters
    ----------
    stiffness : (n_modes,) float
        Modal stiffness, zero for rigid-body modes.
    G : (n_points, 3, n_modes) float
        Relative motion (u1, u2, v) for unit modal coordinates.
    kt, kn, mu, n0 : (n_points, 2), (n_points,), (n_points,), (n_points,) float
        Contact stiffness (N/m), friction coefficient, normal load at zero closing (N).
    force : (n_modes,) float
        Modal force per newton of load.
    shift : (n_points, 3) float
        Part of (u1, u2, v), per newton of load, that the modes do not represent.
    constant_force : (n_modes,) float
        Modal force independent of the load.
    bonded : (n_points,) bool, optional
        Points with linear springs, ``T_d = kt_d u_d`` and ``N = n0 + kn v`` of either sign; none by
        default.
    cubic : (n_points, 2) float, N/m3, optional
        Springs ``k u^3`` along both tangential directions.
    constant_shift : (n_points, 3) float, optional
        Part of (u1, u2, v) independent of the load; zero by default.
    own : OwnLaws, optional
        Compiled laws.
    body : (n_modes,) int, optional
        Number of the body of each mode; each body has its unit of force.  Residual modes have one
        number each.  By default all modes belong to one body.
    """

    stiffness: NDArray
    G: NDArray
    kt: NDArray
    kn: NDArray
    mu: NDArray
    n0: NDArray
    force: NDArray
    shift: NDArray
    constant_force: NDArray
    bonded: NDArray | bool = False
    cubic: NDArray | float = 0.0
    constant_shift: NDArray | float = 0.0
    own: OwnLaws | None = None
    body: NDArray | None = None

    def shift_at(self, load: float) -> NDArray:
        """Return the motion (n_points, 3) outside the modes, under a load (N)."""
        return load * self.shift + self.constant_shift

    @property
    def scales(self) -> bool:
        """Whether states are proportional to the load, except for gaps: nothing else acts."""
        normal_at_rest = self.n0 + self.kn * self.shift_at(0.0)[:, 2]
        pressed = np.any(normal_at_rest > 0.0)
        return not (pressed or np.any(self.constant_force) or np.any(self.constant_shift))


EQUILIBRIUM = 1e-10
"""Largest residual of modal equilibrium relative to the forces on the same body."""
ROUNDING_OF_FORCES = 16.0 * float(np.finfo(float).eps)
"""Relative rounding error of a residual whose terms cancel."""
VISIBLE = 1e-6
"""Largest rounding error of a residual relative to the forces on the same body.

Rounding that is larger hides the load of the body.  The state is then not accepted.
"""
AT_LIMIT = 1e-12
"""Force difference that counts as zero at a limit of friction or contact, relative to the largest
spring force.
"""
SHORTEST = 1e-7
"""Load step, relative to the total change of load, below which a change of state is a jump (a loose
body makes contact).
"""
MOST_SHORTENED = 20
"""Number of load steps without equilibrium that are shortened; each further one is a jump.

Without the limit a shrouded blade under 8 mN beside 49 N on its shroud took 7,000 short steps.
"""
FULL_FRICTION = 1e-12
"""Relative distance from the limit of friction within which a point slips."""
LIMITS_TRIED = 5
"""Largest number of fixed friction limits that are tried, each from the normal forces before it."""
STALLS = 6
"""Consecutive steps without reduction of the residual after which an iteration stops.  Only one of
1478 iterations that converge has more than 4.
"""


def limited_forces(level: NDArray, trial: NDArray, mu: NDArray) -> tuple[NDArray, NDArray]:
    """Limit tangential spring forces by Coulomb friction along each axis.

    Parameters
    ----------
    level : (..., n_points) float, N
        Force of the normal springs; negative if separated.
    trial : (..., n_points, 2) float, N
        Force of the tangential springs without limit.
    mu : (n_points,) float

    Returns
    -------
    force : (..., n_points, 3) float, N
        T1, T2, N.
    status : (..., n_points, 2) int
    """
    force = np.empty((*level.shape, 3))
    normal = np.maximum(level, 0.0, out=force[..., 2])
    # the same limit for both directions, (..., n_points, 1)
    limit = (mu * normal)[..., None]
    np.minimum(np.maximum(trial, -limit), limit, out=force[..., :2])
    status = np.full(trial.shape, STICK)
    status[trial > limit] = SLIP_PLUS
    status[trial < -limit] = SLIP_MINUS
    status[level <= 0.0] = OPEN
    return force, status


def law_tangent(kt: NDArray, kn: NDArray, mu: NDArray, status: NDArray) -> NDArray:
    """Return the derivative (n_points, 3, 3) of the contact forces with respect to the motion.

    ``status`` (n_points, 2) contains the states of the points.
    """
    tangent = np.zeros((len(status), 3, 3))
    closed = ~(status == OPEN).any(axis=1)
    tangent[closed, 2, 2] = kn[closed]
    for d in range(2):
        stick = closed & (status[:, d] == STICK)
        tangent[stick, d, d] = kt[stick, d]
        # friction at its limit follows the normal force
        for sign, state in ((1.0, SLIP_PLUS), (-1.0, SLIP_MINUS)):
            slip = closed & (status[:, d] == state)
            tangent[slip, d, 2] = sign * mu[slip] * kn[slip]
    return tangent


def _forces(system: StaticSystem, x: NDArray, w: NDArray) -> tuple[NDArray, NDArray]:
    """Return forces (..., n_points, 3) and states (..., n_points, 2) of the points.

    Parameters
    ----------
    x : (..., n_points, 3) float, m
        Motions along t1, t2 and n.
    w : (n_points, 2 or more) float
        Sliders (m), and the memory of compiled laws, before the step.
    """
    tangential = x[..., :2]
    normal = x[..., 2]
    slider = w[:, :2]
    memory = w[:, 2:]
    # spring forces without limits; a negative normal force means separation
    level = system.n0 + system.kn * normal
    trial = system.kt * (tangential - slider)
    force, status = limited_forces(level, trial, system.mu)

    # bonded points have springs without limit
    bonded = np.broadcast_to(system.bonded, len(system.kn))
    force[..., bonded, :2] = trial[..., bonded, :]
    force[..., bonded, 2] = level[..., bonded]
    status[..., bonded, :] = STICK

    if np.any(system.cubic):
        force[..., :2] += system.cubic * tangential**3

    if system.own is not None:
        # points with a compiled law
        compiled = system.own.compiled
        # one motion (n_points, 3) at a time
        for i in np.ndindex(x.shape[:-2]):
            law_force, derivative, _ = system.own.step(x[i], memory)
            force[i][compiled] = law_force[compiled]
            status[i][compiled] = _compiled_states(system, derivative)[compiled]
    return force, status


def _compiled_states(system: StaticSystem, derivative: NDArray) -> NDArray:
    """Return the states (n_points, 2) of compiled laws from their derivatives (n_points, 3, 3)."""
    # a law sticks while it has the stiffness of its springs
    tangential = derivative[:, [0, 1], [0, 1]]
    slips = np.abs(tangential - system.kt) > 1e-9 * system.kt
    # a law without stiffness counts as separated
    stiffness = np.abs(derivative).max(axis=(1, 2))
    closed = stiffness > 1e-12 * np.maximum(system.kt.max(axis=1), system.kn)
    # the state does not tell the sense of slip
    of_closed = np.where(slips, SLIP_PLUS, STICK)
    return np.where(closed[:, None], of_closed, OPEN)


@dataclass(frozen=True)
class _Contacts:
    """Forces and states of the contact points after a step.

    Parameters
    ----------
    force : (n_points, 3) float, N
    status : (n_points, 2) int
    slider : (n_points, 2) float, m
    memory : (n_points, width) float, optional
        Motion and state of compiled laws; None if there are none.
    closing : (n_points,) float, m
    """

    force: NDArray
    status: NDArray
    slider: NDArray
    memory: NDArray | None
    closing: NDArray

    @property
    def slider_memory(self) -> NDArray:
        """Sliders and memory (n_points, 2 or more), from which the next step begins."""
        if self.memory is None:
            return self.slider
        return np.hstack([self.slider, self.memory])


def _contacts(system: StaticSystem, x: NDArray, w: NDArray) -> _Contacts:
    """Evaluate the contact points after a step to the motion x; w is the slider memory before."""
    force, status = _forces(system, x, w)
    tangential = x[:, :2]
    slider_before = w[:, :2]
    memory_before = w[:, 2:]

    # a slider is where the tangential spring has its force; without spring it follows the surface
    has_spring = system.kt > 0.0
    kt = np.where(has_spring, system.kt, 1.0)
    slider = np.where(has_spring, tangential - force[:, :2] / kt, tangential)
    bonded = np.broadcast_to(system.bonded, len(slider))
    slider = np.where(bonded[:, None], slider_before, slider)

    memory = None
    if system.own is not None:
        _, _, memory = system.own.step(x, memory_before)

    # compression of the normal springs, negative for a gap; 0 without spring
    level = system.n0 + system.kn * x[:, 2]
    has_normal_spring = system.kn > 0.0
    kn = np.where(has_normal_spring, system.kn, 1.0)
    closing = np.where(has_normal_spring, level / kn, 0.0)
    return _Contacts(force, status, slider, memory, closing)


def _jacobian(
    system: StaticSystem,
    G: NDArray,
    status: NDArray,
    x: NDArray | None = None,
    w: NDArray | None = None,
) -> NDArray:
    """Return the derivative (n_modes, n_modes) of modal equilibrium; G is (3 n_points, n_modes).

    At a motion x (n_points, 3) with sliders and memory w, cubic springs and compiled laws
    contribute their tangents.  Without x, cubic springs contribute nothing and compiled laws the
    springs of stick.
    """
    # derivatives of the forces of each point, (n_points, 3, 3)
    tangent = law_tangent(system.kt, system.kn, system.mu, status)
    if x is not None:
        # the diagonal entries of both tangential directions
        tangent[:, [0, 1], [0, 1]] += 3.0 * system.cubic * x[:, :2] ** 2
    if system.own is not None and x is not None and w is not None:
        compiled = system.own.compiled
        _, derivative, _ = system.own.step(x, w[:, 2:])
        tangent[compiled] = derivative[compiled]
    by_coordinates = (tangent @ system.G).reshape(len(G), -1)
    return np.diag(system.stiffness) + G.T @ by_coordinates


def _solve(J: NDArray, r: NDArray) -> NDArray:
    """Solve J dq = r, by least norm if the contact does not determine a rigid-body motion."""
    diagonal = np.abs(np.diag(J))
    if not diagonal.any():  # no contact and no constraint
        return np.zeros(len(r))

    # rows and columns scaled to a unit diagonal
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-12 * diagonal.max()))
    scaled_J = J * scale[:, None] * scale
    factors, pivot, info = _getrf(scaled_J)
    is_regular = info == 0
    if is_regular:
        norm = float(np.abs(scaled_J).sum(axis=0).max())
        reciprocal_condition, _ = _gecon(factors, norm)
        if reciprocal_condition > 1e-12:
            scaled_dq, _ = _getrs(factors, pivot, scale * r)
            return np.asarray(scale * scaled_dq)
    scaled_dq, *_ = np.linalg.lstsq(scaled_J, scale * r, rcond=1e-12)
    return np.asarray(scale * scaled_dq)


def _largest_of_body(system: StaticSystem, rows: NDArray) -> NDArray:
    """Return for each mode (n_modes,) the largest value of all modes of its body."""
    if system.body is None:
        return np.full(len(rows), rows.max(initial=0.0))
    largest = np.zeros(int(system.body.max(initial=0)) + 1)
    np.maximum.at(largest, system.body, rows)
    return largest[system.body]


class _Units:
    """Units of force of the residuals of modal equilibrium, one for each mode.

    The unit of a body is the largest modal force of its loads.  A body without load, or a residual
    mode, has the contact forces as its unit.

    With one unit for all bodies, a body with a small load counts as in equilibrium although it is
    not.  No longer load step leads on from there: 16 of 40 random loads of a stage with wedges and
    shrouds have no state.

    Parameters
    ----------
    system : StaticSystem
    loads : (2,) tuple of float, N
        Loads at the begin and the end of a load step; the larger one counts.
    """

    def __init__(self, system: StaticSystem, loads: tuple[float, float]) -> None:
        self.system = system
        _, _, n_modes = system.G.shape
        # (3 n_points, n_modes)
        self.size_of_G = np.abs(system.G.reshape(-1, n_modes))
        by_load = max(np.abs(loads)) * np.abs(system.force)
        modal_load = np.maximum(by_load, np.abs(system.constant_force))
        self.load = _largest_of_body(system, modal_load)
        shift = np.maximum(*(np.abs(system.shift_at(load)) for load in loads))
        self.shift = np.broadcast_to(shift, (len(system.kn), 3))

    def at(self, contact_force: NDArray) -> NDArray:
        """Return the units (n_modes,) for contact forces (n_points, 3)."""
        modal_contact = self.size_of_G.T @ np.abs(contact_force).ravel()
        unit = np.where(self.load > 0.0, self.load, _largest_of_body(self.system, modal_contact))
        # a body without any force has the unit of the others
        return np.where(unit > 0.0, unit, max(float(unit.max(initial=0.0)), 1e-300))

    def with_rounding(self, q: NDArray, contact_force: NDArray, w: NDArray) -> NDArray:
        """Return the units (n_modes,), increased where rounding exceeds the limit of residuals.

        ``q`` (n_modes,) are the modal coordinates, and ``w`` the sliders before the step.
        """
        system = self.system
        unit = self.at(contact_force)
        # sums of the absolute terms that cancel in contact forces and in equilibrium
        distance = (self.size_of_G @ np.abs(q)).reshape(-1, 3) + self.shift
        distance[:, :2] += np.abs(w[:, :2])
        terms = np.abs(contact_force)
        terms[:, :2] += system.kt * distance[:, :2]
        terms[:, 2] += np.abs(system.n0) + system.kn * distance[:, 2]
        rounding = ROUNDING_OF_FORCES * (
            system.stiffness * np.abs(q) + self.size_of_G.T @ terms.ravel()
        )
        return np.maximum(unit, np.minimum(rounding, VISIBLE * unit) / EQUILIBRIUM)


@dataclass(frozen=True)
class _Equilibrium:
    """Result of a load step: modal coordinates, states of the points, and iterations.

    ``residual`` is the largest residual of modal equilibrium relative to its unit.
    """

    q: NDArray
    status: NDArray
    iterations: int
    residual: float

    @property
    def ok(self) -> bool:
        """Whether the residual is small enough; not if it is NaN."""
        return self.residual <= EQUILIBRIUM


class _LoadStep:
    """Modal equilibrium at the end of a load step.

    Parameters
    ----------
    system : StaticSystem
    load, load_before : float, N
        Loads at the end and at the beginning.
    w : (n_points, 2 or more) float
        Sliders and memory at the beginning.
    """

    def __init__(self, system: StaticSystem, load: float, w: NDArray, load_before: float) -> None:
        self.system = system
        self.w = w
        self.units = _Units(system, (load_before, load))
        # modal forces (n_modes,), and motion (n_points, 3) of the points without the modes
        self.force = load * system.force + system.constant_force
        self.shift = system.shift_at(load)
        # (n_points, 3, n_modes) as a matrix (3 n_points, n_modes)
        _, _, n_modes = system.G.shape
        self.G = system.G.reshape(-1, n_modes)

    def motion(self, q: NDArray) -> NDArray:
        """Return the motion (n_points, 3) at the modal coordinates q."""
        return (self.G @ q).reshape(-1, 3) + self.shift

    def residuals(self, *coordinates: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return residuals (n, n_modes), states, and contact forces (n, n_points, 3), of n vectors
        of modal coordinates.

        The vectors are evaluated one by one, because a product with all of them rounds differently.
        Rounding determines the state of a point at its friction limit.
        """
        products = np.array([self.G @ q for q in coordinates])
        x = products.reshape(len(coordinates), -1, 3) + self.shift
        forces, status = _forces(self.system, x, self.w)
        residuals = []
        for q, contact in zip(coordinates, forces):
            inner = self.system.stiffness * q + self.G.T @ contact.ravel()
            residuals.append(inner - self.force)
        return np.array(residuals), status, forces

    def linear_solution(self, status: NDArray) -> NDArray:
        """Return the modal coordinates (n_modes,) at which the points remain in the given states."""
        system = self.system
        level = system.n0 + system.kn * self.shift[:, 2]
        slider = self.w[:, :2]
        stretch = self.shift[:, :2] - slider
        # contact forces at q = 0: the tangential motion acts through kt, and the normal force,
        # which is known, with the factor 1 instead of kn
        per_unit = law_tangent(system.kt, np.ones(len(level)), system.mu, status)
        # columns (n_points, 3, 1)
        known = np.concatenate([stretch, level[:, None]], axis=1)[..., None]
        contact = per_unit @ known
        jacobian = _jacobian(system, self.G, status)
        return _solve(jacobian, self.force - self.G.T @ contact.ravel())

    def at_fixed_limits(self, status: NDArray) -> NDArray | None:
        """Return the states at which friction has the limits of fixed normal forces.

        These are first the normal forces in stick, and then those of the states that were found.

        ``status`` tells which points are closed.  With fixed limits the tangential forces minimise
        a convex energy, so they exist for any number of points.  Returns None if normal springs
        alone do not hold the structure, or for laws without such limits.
        """
        system = self.system
        has_other_laws = system.own is not None or np.any(system.cubic) or np.any(system.bonded)
        if has_other_laws:
            return None
        closed = ~(status == OPEN).any(axis=1)
        states = np.where(closed[:, None], np.full_like(status, STICK), OPEN)
        # until the states have the normal forces whose limits they obey
        for _ in range(LIMITS_TRIED):
            improved = self._at_normal_forces_of(states)
            if improved is None or np.array_equal(improved, states):
                return improved
            states = improved
        return states

    def _at_normal_forces_of(self, states: NDArray) -> NDArray | None:
        """Return the states under the limits that the normal forces in the given states have."""
        system = self.system
        motion = self.motion(self.linear_solution(states))
        level = system.n0 + system.kn * motion[:, 2]
        closed = ~(states == OPEN).any(axis=1) & (level > 0.0)
        has_friction = (system.mu > 0.0) & (system.kt > 0.0).all(axis=1)
        rubs = np.flatnonzero(closed & has_friction)
        if not len(rubs):
            return None
        # both directions of a point have its limit
        limit = np.repeat(system.mu[rubs] * level[rubs], 2)
        try:
            C, x_0 = self._tangential_flexibility(closed, rubs)
            share = _shares_of_limits(C, x_0, limit).reshape(-1, 2)
        except np.linalg.LinAlgError:
            return None

        improved = np.where(closed[:, None], np.full_like(states, STICK), OPEN)
        slip = np.where(share > 0.0, SLIP_PLUS, SLIP_MINUS)
        is_below_limit = np.abs(share) < 1.0 - FULL_FRICTION
        improved[rubs] = np.where(is_below_limit, STICK, slip)
        return improved

    def _tangential_flexibility(self, closed: NDArray, rubs: NDArray) -> tuple[NDArray, NDArray]:
        """Return C (n, n) and x_0 (n,) of the tangential motion ``x = x_0 - C T`` of points.

        ``rubs`` has their indices.  The normal springs of the ``closed`` points act on the
        structure, and C includes the tangential springs.

        Raises
        ------
        LinAlgError
            If the normal springs do not hold the structure.
        """
        system = self.system
        # normal motion (n_points, n_modes)
        kn = np.where(closed, system.kn, 0.0)
        Gn = system.G[:, 2]
        stiffness = np.diag(system.stiffness) + Gn.T @ (kn[:, None] * Gn)
        factors = scipy.linalg.cho_factor(stiffness)
        # normal forces without motion of the modes
        normal_at_rest = np.where(closed, system.n0, 0.0) + kn * self.shift[:, 2]
        q_frictionless = scipy.linalg.cho_solve(factors, self.force - Gn.T @ normal_at_rest)

        # tangential motion (2 n_rubs, n_modes), and stretch of the springs without it
        Gt = system.G[rubs, :2].reshape(-1, len(stiffness))
        stretch = (self.shift[rubs, :2] - self.w[rubs, :2]).ravel()
        of_springs = np.diag(1.0 / system.kt[rubs].ravel())
        C = Gt @ scipy.linalg.cho_solve(factors, Gt.T) + of_springs
        return C, Gt @ q_frictionless + stretch

    def solve(self, status: NDArray) -> _Equilibrium:
        """Solve for the states by Newton iteration with line search from the given states."""
        # the slip of compiled laws is unknown: start from stick
        if self.system.own is not None:
            closed = self.system.own.compiled[:, None] & (status != OPEN)
            status = np.where(closed, STICK, status)
        return self.solve_near(self.linear_solution(status))

    def solve_near(self, q: NDArray, most_iterations: int = 60) -> _Equilibrium:
        """Solve by Newton iteration with line search from modal coordinates (n_modes,)."""
        # residual (n_modes,), states and contact forces of one vector of coordinates
        (residual,), (status,), (force,) = self.residuals(q)
        stalls = 0
        for iteration in range(1, most_iterations + 1):
            unit = self.units.at(force)
            norm = float(np.abs(residual / unit).max())
            if norm <= EQUILIBRIUM or stalls == STALLS:
                break
            # rounding may exceed the limit: the iteration ends as soon as it makes no progress
            if stalls > 0 and self.relative(residual, q, force) <= EQUILIBRIUM:
                break
            jacobian = _jacobian(self.system, self.G, status, self.motion(q), self.w)
            dq = _solve(jacobian, -residual)
            q, residual, status, force, reduced = self.line_search(q, dq, norm, unit)
            # steps in succession without reduction
            stalls = 0 if reduced else stalls + 1
        return _Equilibrium(q, status, iteration, self.relative(residual, q, force))

    def relative(self, residual: NDArray, q: NDArray, contact_force: NDArray) -> float:
        """Return the largest residual (n_modes,) in units of force."""
        unit = self.units.with_rounding(q, contact_force, self.w)
        return float(np.abs(residual / unit).max(initial=0.0))

    def solve_far(self) -> _Equilibrium:
        """Solve from motions of convex problems, and then from the states of Lemke's method.

        The result is the first equilibrium, or the attempt with the least residual.
        """
        best = self._solve_convex()
        if best.ok:
            return best
        iterations = best.iterations
        for states in possible_states(self.system, self.force, self.shift, self.w[:, :2]):
            end = self.solve(states)
            iterations += end.iterations
            if end.residual < best.residual:
                best = end
            if end.ok:
                break
        return replace(best, iterations=iterations)

    def _solve_convex(self) -> _Equilibrium:
        """Solve from the motions of convex problems that approach equilibrium.

        The result is the first equilibrium, or the last attempt.
        """
        stuck = np.full((len(self.system.kn), 2), STICK)
        start = self.linear_solution(stuck)
        slider = self.w[:, :2]
        iterations = 0
        for q in approximations(self.system, self.force, self.shift, slider, start):
            end = self.solve_near(q, most_iterations=12)
            iterations += end.iterations
            if end.ok:
                break
        return replace(end, iterations=iterations)

    def line_search(
        self, q: NDArray, dq: NDArray, norm: float, unit: NDArray
    ) -> tuple[NDArray, NDArray, NDArray, NDArray, bool]:
        """Return coordinates, residual, states and contact forces after a step along ``dq``.

        The last value tells whether the residual, in units (n_modes,), decreases enough from
        ``norm``.
        """
        # smallest relative decrease for a full step; less for shorter ones
        decrease = 1e-3
        full = q + dq
        (r_full,), (status_full,), (force_full,) = self.residuals(full)
        norm_full = float(np.abs(r_full / unit).max())
        if norm_full < (1.0 - decrease) * norm:
            return full, r_full, status_full, force_full, True

        # one row for each of the shorter steps, longest first
        fractions = 0.5 ** np.arange(1, 10)
        shorter = q + fractions[:, None] * dq
        residuals, states, forces = self.residuals(*shorter)
        norms = np.abs(residuals / unit).max(axis=1)
        # the best of the steps up to the first with sufficient decrease
        sufficient = np.flatnonzero(norms < (1.0 - decrease * fractions) * norm)
        reduced = len(sufficient) > 0
        if reduced:
            norms = norms[: sufficient[0] + 1]
        best = int(np.argmin(norms))
        if norm_full <= norms[best]:
            return full, r_full, status_full, force_full, reduced
        return shorter[best], residuals[best], states[best], forces[best], reduced


def _shares_of_limits(C: NDArray, x_0: NDArray, limit: NDArray) -> NDArray:
    """Return the tangential forces (n,) in fractions of their limits, from -1 to 1.

    They minimise the energy ``T C T / 2 - T x_0``, which is strictly convex.
    """
    # with T = limit s and L L^T = limit C limit the energy is |L^T s - L^-1 limit x_0|^2 / 2, up to
    # a constant
    L = np.linalg.cholesky(C * limit[:, None] * limit)
    right = scipy.linalg.solve_triangular(L, limit * x_0, lower=True)
    # the tolerances of the solver are absolute
    unit = max(float(np.linalg.norm(right)), 1e-300)
    minimum = scipy.optimize.lsq_linear(
        L.T / unit, right / unit, bounds=(-1.0, 1.0), method="bvls", tol=1e-14
    )
    return np.asarray(minimum.x)


def _creep(system: StaticSystem, load: float, state: PreloadState) -> tuple[_Equilibrium, NDArray]:
    """Follow the overdamped motion ``D q' = -r(q)`` to equilibrium at one load.

    Used for load steps without convergence of the Newton iteration, with compiled laws or cubic
    springs.  Sliders follow slip.  ``D`` is
    the stiffness with every point in stick, so time has the unit of the time constant.  The
    implicit time steps grow while Newton iterations converge fast.

    Returns the equilibrium, and sliders with memory at its end.
    """
    w = _slider_memory(system, state)
    step = _LoadStep(system, load, w, state.load)
    # motion (3 n_points, n_modes) of the points, and the spring of each row (3 n_points, 1)
    G = step.G
    springs = np.concatenate([system.kt, system.kn[:, None]], axis=1).reshape(-1, 1)
    damping = np.diag(system.stiffness) + G.T @ (springs * G)
    q = state.q.copy()
    status = state.status
    dt = 0.1
    iterations = 0
    residual = np.inf
    most_time_steps = 400
    most_newton_steps = 12
    for _ in range(most_time_steps):
        trial = q.copy()
        for newton_steps in range(most_newton_steps):
            motion = step.motion(trial)
            contacts = _contacts(system, motion, w)
            static_residual = system.stiffness * trial + G.T @ contacts.force.ravel() - step.force
            # implicit Euler method: the velocity is the change over the time step
            residual_in_motion = static_residual + damping @ (trial - q) / dt
            iterations += 1
            if step.relative(residual_in_motion, trial, contacts.force) <= 0.1 * EQUILIBRIUM:
                break
            jacobian = _jacobian(system, G, contacts.status, motion, w) + damping / dt
            trial = trial + _solve(jacobian, -residual_in_motion)
        else:
            # no convergence: a shorter time step from the same motion
            dt *= 0.25
            if dt < 1e-8:
                break
            continue

        q = trial
        status = contacts.status
        w = contacts.slider_memory
        residual = step.relative(static_residual, trial, contacts.force)
        # at rest nothing moves, and the static equations hold
        if residual <= EQUILIBRIUM:
            break
        converged_fast = newton_steps < most_newton_steps // 2
        if converged_fast:
            dt *= 2.0
    return _Equilibrium(q, status, iterations, residual), w


def _slider_memory(system: StaticSystem, state: PreloadState) -> NDArray:
    """Return sliders and the memory of compiled laws, (n_points, 2 or more)."""
    if system.own is None:
        return state.slider.copy()
    memory = state.memory
    if memory is None:
        memory = np.zeros((len(state.slider), system.own.width))
    return np.hstack([state.slider, memory])


def _before_loading(system: StaticSystem) -> PreloadState:
    """Return the unloaded state: points in contact stick, others are separated."""
    n_points, _, n_modes = system.G.shape
    level = system.n0 + system.kn * system.shift_at(0.0)[:, 2]
    is_apart = (level < 0.0) & np.logical_not(system.bonded)
    status = np.full((n_points, 2), STICK)
    # without any contact the first linear solution needs closed surfaces
    if not is_apart.all():
        status[is_apart] = OPEN
    return PreloadState(
        load=0.0,
        q=np.zeros(n_modes),
        slider=np.zeros((n_points, 2)),
        force=np.zeros((n_points, 3)),
        closing=np.zeros(n_points),
        status=status,
        residual=0.0,
        steps=0,
        iterations=0,
        ok=True,
    )


def _together(system: StaticSystem, load: float) -> StaticSystem:
    """Return a system whose load of 0 to 1 scales all loads together.

    These are constant loads, interference and the given load (N).
    """
    pressed = (system.n0 > 0.0) & (system.kn > 0.0)
    if system.own is not None:  # compiled laws include the interference
        pressed &= ~system.own.compiled

    # interference as a displacement, which the load scales
    constant_shift = np.array(np.broadcast_to(system.constant_shift, (len(pressed), 3)))
    constant_shift[pressed, 2] += system.n0[pressed] / system.kn[pressed]
    return replace(
        system,
        n0=np.where(pressed, 0.0, system.n0),
        force=load * system.force + system.constant_force,
        shift=load * system.shift + constant_shift,
        constant_force=np.zeros_like(system.force),
        constant_shift=0.0,
    )


def linear_range(
    points: StaticSystem | PointArrays, x0: NDArray, x1: NDArray, w: NDArray, close: float
) -> tuple[float, float]:
    """Find the first change of state on the straight line from motion ``x0`` to ``x1``.

    Parameters
    ----------
    points : StaticSystem or PointArrays
        Only ``kt``, ``kn``, ``mu`` and ``n0`` are used.
    x0, x1 : (n_points, 3) float, m
        Motions in equilibrium, with the sliders ``w`` (n_points, 2) at ``x0``.
    close : float, N
        A force this close to a limit counts as at the limit, so that rounding causes no change of
        state.

    Returns
    -------
    within, beyond : float
        Position of the first change of state up to ``x1`` and after ``x1``: 0 at ``x0``, 1 at
        ``x1``, infinite if none.
    """
    # at both ends of the line, (2, n_points, 3)
    motion = np.array([x0, x1])
    level = points.n0 + points.kn * motion[..., 2]
    trial = points.kt * (motion[..., :2] - w)
    limit = (points.mu * level)[..., None]
    # each is negative before a change of state: closing, separation, slip in both senses;
    # (2, n_points, 6), because slip has two directions
    indicators = [level[..., None], -level[..., None], trial - limit, -trial - limit]
    before, after = np.concatenate(indicators, axis=2)

    # only an indicator that rises from clearly below zero reaches it; the motion is linear
    rising = (before < -close) & (after > before)
    before = before[rising]
    after = after[rising]
    position = before / (before - after)
    within = position[after > close].min(initial=np.inf)
    beyond = position[after < -close].min(initial=np.inf)
    return within, beyond


def static_state(
    system: StaticSystem,
    load: float,
    *,
    steps: int = 8,
    start: PreloadState | None = None,
    offset: NDArray | None = None,
) -> PreloadState:
    """Compute the contact state after the load has changed to ``load``.

    Parameters
    ----------
    system : StaticSystem
    load : float, N
    steps : int
        Minimum number of load steps; only relevant for cubic springs and compiled laws.
    start : PreloadState, optional
        Initial state for loading or unloading.  By default the structure is unloaded; constant
        loads act first, then the load.
    offset : (n_points, 2) float, m, optional
        Slider positions before any load; zero by default.

    Returns
    -------
    PreloadState
        If a load step has no solution, the last solved state with ``ok`` False and a reason.
    """
    if start is not None:
        return _loaded(system, load, start, steps)

    assembly = system if system.scales else _together(system, 0.0)
    unloaded = _before_loading(assembly)
    if offset is not None:
        unloaded = replace(unloaded, slider=offset)
    if system.scales:
        if load == 0.0:
            return _at_rest(system, unloaded)
        return _loaded(system, load, unloaded, steps)

    # a load of 1 applies all loads of _together() completely
    assembled = replace(_loaded(assembly, 1.0, unloaded, steps, together=True), load=0.0)
    found = assembled
    if assembled.ok:
        found = _loaded(system, load, assembled, steps)
    if found.ok or load <= 0.0:
        return found
    # a free body has no equilibrium under the constant loads alone, or is locked there by friction
    all_loads = _together(system, load)
    return replace(_loaded(all_loads, 1.0, unloaded, steps, together=True), load=load)


def _at_rest(system: StaticSystem, unloaded: PreloadState) -> PreloadState:
    """Return the state without motion, with the forces that the sliders of ``unloaded`` cause."""
    at_rest = np.zeros((len(system.kn), 3))
    contacts = _contacts(system, at_rest, _slider_memory(system, unloaded))
    return replace(
        unloaded,
        force=contacts.force,
        status=contacts.status,
        slider=contacts.slider,
        closing=contacts.closing,
        memory=contacts.memory,
    )


def _loaded(
    system: StaticSystem, load: float, state: PreloadState, steps: int, *, together: bool = False
) -> PreloadState:
    """Change the load to ``load``, from one change of state to the next.

    If all loads act ``together``, it is a factor on all of them.
    """
    change = load - state.load
    if not change:
        return state
    path = _LoadPath(system, state, change, load, 1.0 / steps, together=together)
    while path.left and not path.lost:
        path.advance()
    return path.state


class _LoadPath:
    """Change of the load from the latest ``state`` to ``load`` (N).

    Steps are fractions of the complete ``change`` (N), at most ``longest``.  ``left`` is the
    fraction that remains, and ``lost`` tells that no equilibrium follows the latest state.
    If all loads act ``together``, the load is a factor on all of them (:func:`_together`).
    """

    def __init__(
        self,
        system: StaticSystem,
        state: PreloadState,
        change: float,
        load: float,
        longest: float,
        *,
        together: bool,
    ) -> None:
        self.system = system
        self.state = state
        self.change = change
        self.load = load
        self.longest = longest
        self.together = together
        self.left = 1.0
        self.lost = False
        self.step = longest
        self.least = SHORTEST
        self.shortened = 0

        # bonded points and compiled laws have no changes of state on a straight line
        free = np.logical_not(system.bonded)
        if system.own is not None:
            free = free & ~system.own.compiled
        self.frictional = replace(
            system, kt=system.kt * free[..., None], kn=system.kn * free, n0=system.n0 * free
        )
        self.springs = np.concatenate([self.frictional.kt, self.frictional.kn[:, None]], axis=1)
        first_shift = system.shift_at(state.load)
        self.displaced = np.abs(first_shift) + np.abs(system.shift_at(load))
        self.x = system.G @ state.q + first_shift
        # change of the motion per step in the latest linear range; None after a jump
        self.slope: NDArray | None = None

    def advance(self) -> None:
        """Make a load step, or shorten the next one if this one is too long.

        Without equilibrium ``state`` has ``ok`` False and a reason.
        """
        step = min(self.step, self.longest)
        if step > self.left - SHORTEST:
            step = self.left
        load = self._load_after(step)
        before = _slider_memory(self.system, self.state)
        end = self._solve(load, step, before)

        if not end.ok:
            if step > self.least and self.shortened < MOST_SHORTENED:
                self.shortened += 1
                self.step = max(1e-3 * step, self.least)
                return
            # the equilibrium is lost: the motion jumps; without it: 135 random loads fail, not 11
            self._jump(step)
            return

        x = self.system.G @ end.q + self.system.shift_at(load)
        within, beyond = self._change_of_state(x, before)
        if within < 1.0 and step > self.least:
            self.step = max(0.1 * within * step, self.least)
            return
        self._accept(end, load, step, x, before, jumped=within < 1.0, beyond=beyond)

    def _load_after(self, step: float) -> float:
        return self.load - (self.left - step) * self.change

    def _solve(self, load: float, step: float, before: NDArray) -> _Equilibrium:
        """Solve for the states at a load, from different initial states until one converges.

        They are extrapolated, the latest, all points in contact sticking, and all points sticking.
        Without it: the deck of a shroud with two strips finds another state without the first, wide
        random studies 121 and 151 depend on the number of steps without the second, study 20
        without the third; without the fourth its force changes by 16 %.  Last are the states at
        fixed limits: without them 41 loads on faces of nine random shrouds have no state.
        """
        status = self.state.status
        closing = self.state.closing
        # open points that nearly touch count as in contact
        apart = closing < -1e-9 * np.abs(closing).max(initial=0.0)
        stuck = np.where((status == OPEN) & apart[:, None], OPEN, STICK)
        initial = [status, stuck, np.full_like(stuck, STICK)]
        if self.slope is not None:
            _, extrapolated = _forces(self.system, self.x + step * self.slope, before)
            initial.insert(0, extrapolated)

        load_step = _LoadStep(self.system, load, before, self.state.load)
        # equal ones are tried once
        distinct = {states.tobytes(): states for states in initial}
        iterations = 0
        for states in distinct.values():
            end = load_step.solve(states)
            iterations += end.iterations
            if end.ok:
                return replace(end, iterations=iterations)
        # from rest many points begin to slip at once, and the Newton iteration may cycle
        from_rest = self.left == 1.0
        limited = load_step.at_fixed_limits(stuck) if from_rest else None
        if limited is not None:
            from_limits = load_step.solve(limited)
            iterations += from_limits.iterations
            if from_limits.ok:
                end = from_limits
        return replace(end, iterations=iterations)

    def _change_of_state(self, x: NDArray, before: NDArray) -> tuple[float, float]:
        """Find changes of state up to the motion x and beyond it (:func:`linear_range`)."""
        distance = self.displaced + np.abs(self.x) + np.abs(x)
        close = AT_LIMIT * float((self.springs * distance).max(initial=0.0))
        return linear_range(self.frictional, self.x, x, before[:, :2], close)

    def _jump(self, step: float) -> None:
        """Find an equilibrium that does not follow from the latest state.

        Convex problems or Lemke's method lead to it; with compiled laws or cubic springs, an
        overdamped motion.
        """
        # a long step first: a body that slides would need a jump in each of many short steps, and
        # rounding hides the load of a short first step; a body may also have to cross a gap
        tried = (min(self.longest, self.left), step)
        for step in tried:
            load = self._load_after(step)
            end, reached = self._far_equilibrium(load)
            if end.ok:
                break
        if not end.ok:
            above = f"a load of {self.state.load:.6g} N"
            if self.together:
                above = f"{percent(self.state.load)} of loads and interference"
            note = f"static contact has no equilibrium above {above} (residual {end.residual:.2g})"
            self.state = replace(self.state, ok=False, reason=note)
            self.lost = True
            return
        x = self.system.G @ end.q + self.system.shift_at(load)
        self._accept(end, load, step, x, reached, jumped=True, beyond=np.inf)

    def _far_equilibrium(self, load: float) -> tuple[_Equilibrium, NDArray]:
        """Return an equilibrium at a load, and the sliders with memory from which it is reached."""
        system = self.system
        if system.own is not None or np.any(system.cubic):
            return _creep(system, load, self.state)
        before = _slider_memory(system, self.state)
        return _LoadStep(system, load, before, self.state.load).solve_far(), before

    def _accept(
        self,
        end: _Equilibrium,
        load: float,
        step: float,
        x: NDArray,
        before: NDArray,
        *,
        jumped: bool,
        beyond: float,
    ) -> None:
        """Continue from the end of a step; its next change of state is ``beyond`` times as far."""
        if step <= self.least:
            self.least *= 2.0  # limits the number of steps after many jumps
        # no extrapolation from before a jump
        self.slope = None if jumped else (x - self.x) / step
        self.x = x
        contacts = _contacts(self.system, x, before)
        self.state = PreloadState(
            load=load,
            q=end.q,
            slider=contacts.slider,
            force=contacts.force,
            closing=contacts.closing,
            status=contacts.status,
            residual=end.residual,
            steps=self.state.steps + 1,
            iterations=self.state.iterations + end.iterations,
            ok=True,
            memory=contacts.memory,
        )
        self.left = self.left - step
        self.step = self.least if jumped else max(step * (beyond - 1.0), self.least)


def scaled_state(system: StaticSystem, state: PreloadState, load: float) -> PreloadState | None:
    """Return the state at another load by proportionality, or None if it does not apply.

    Without initial gaps the state after loading from zero is proportional to the load.  Points with
    a gap have no effect if they remain open up to the larger load.

    Parameters
    ----------
    system : StaticSystem
    state : PreloadState
    load : float, N
    """
    if not (state.ok and state.load > 0.0 and load > 0.0):
        return None
    # forces of cubic springs and of compiled laws are not proportional to the motion
    is_nonlinear = np.any(system.cubic) or system.own is not None
    if is_nonlinear or not system.scales:
        return None

    ratio = load / state.load
    motion = system.G @ state.q + state.load * system.shift
    x = ratio * motion
    gapped = system.n0 < 0.0
    level = system.n0 + system.kn * x[:, 2]
    was_closed = np.any(state.status[gapped] != OPEN)
    becomes_closed = np.any(level[gapped] >= 0.0)
    if was_closed or becomes_closed:
        return None

    # the scaled state must be in equilibrium; rounding of the states may prevent it
    q = ratio * state.q
    slider = ratio * state.slider
    contacts = _contacts(system, x, slider)
    G = system.G.reshape(-1, len(q))
    imbalance = system.stiffness * q + G.T @ contacts.force.ravel() - load * system.force
    unit = _Units(system, (0.0, load)).with_rounding(q, contacts.force, slider)
    residual = float(np.abs(imbalance / unit).max(initial=0.0))
    if not residual <= EQUILIBRIUM:
        return None

    # without tangential force a slider is at the surface.  The forces above do not depend on it:
    # the friction limit is zero at an open contact, as is the force without spring
    follows_surface = (state.status == OPEN) | (system.kt == 0.0)
    slider_at_load = np.where(follows_surface, x[:, :2], slider)
    return replace(
        state,
        load=load,
        q=q,
        slider=slider_at_load,
        force=contacts.force,
        closing=contacts.closing,
        residual=residual,
        steps=0,
        iterations=0,
    )
