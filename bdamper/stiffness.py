"""Contact stiffness: the flexibility that the retained modes leave out, concentrated at the contact points.

Every method starts from the residual flexibility ``R_res`` of both sides of an interface (:mod:`bdamper.coupling`),
patch-averaged displacement for patch-averaged force, and looks for a positive diagonal.

``"unit_traction"``
    A uniform traction in one direction over the whole face, forces ``F_i = A_i``:  ``k_i = A_i/(R_res A)_i``.

``"eq4"``
    Paper, Eqs (1)-(11).  With the contact forces ``F`` of the static contact problem under the centrifugal load, the
    modal superposition misses ``R_res F`` of the displacement on each side (Eqs (2), (8)), so Eqs (4), (10) and (11) read
    ``1/k_i = (R_res F)_i / F_i``.  (The deformation of the damper by its own load, the last term of Eq (10), is not put
    into the stiffness: it enters the analysis as what it is, an initial distance of the surfaces.)
    The static contact forces come from the condensed contact problem on the full flexibility (below) or from the user's
    own finite element analysis.  Where ``|F_i|`` is below 5 % of the largest component in this direction over the face, or
    the quotient is not positive, the division says nothing; the value of ``"unit_traction"`` stands in, and the report
    counts it.

Condensed static contact on the full flexibility ``R`` (nodal diameter 0), with the rigid-body motion ``eta`` of free
bodies: displacement ``x = -R F + Psi eta + e_load``, equilibrium ``Psi^T F = f_load``, and at each point one of stick
(``x = 0`` in all directions), slip (``F_t = ± mu N``, ``x_n = 0``) and open (``F = 0``).  The states are iterated as in
the paper's section 3.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bdamper.coupling import Coupling
from bdamper.errors import ModelError, SettingError
from bdamper.model import ContactStiffness

Method = Literal["unit_traction", "eq4"]
METHODS = ("unit_traction", "eq4")
SMALL_FORCE = 0.05
"""Share of the largest force component below which Eqs (4), (10) are not divided by it."""


@dataclass(frozen=True)
class StiffnessReport:
    """How the stiffness of one interface came about.

    Parameters
    ----------
    interface, source : str
    n_points : int
    fallback : (3,) int
        Points, for t1, t2, n, at which the method's substitute was used.
    smallest, median, largest : (3,) float, N/m
    """

    interface: str
    source: str
    n_points: int
    fallback: NDArray
    smallest: NDArray
    median: NDArray
    largest: NDArray

    def __str__(self) -> str:
        parts = [
            f"{axis}: {median:.3g} ({low:.3g}..{high:.3g}), {count} of {self.n_points} fell back"
            for axis, median, low, high, count in zip(
                ("t1", "t2", "n"), self.median, self.smallest, self.largest, self.fallback
            )
        ]
        return f"{self.interface}, {self.source}, N/m: " + "; ".join(parts)


@dataclass(frozen=True)
class StaticForces:
    """Solution of the condensed static contact problem, per newton of load.

    Parameters
    ----------
    force : (n_points, 3) float
        T1, T2, N at the contact points, N positive in compression.
    status : (n_points, 2) int
        0 stick, 1 slip +, 2 slip -, 3 open, for the two tangential directions.
    complementarity, equilibrium : float
        Largest violation of the contact conditions and of equilibrium, relative to the load.
    iterations : int
    """

    force: NDArray
    status: NDArray
    complementarity: float
    equilibrium: float
    iterations: int


def report(interface: str, contact: ContactStiffness) -> StiffnessReport:
    """Summary of the stiffness of one interface."""
    k = contact.stiffness
    fallback = np.zeros(3, int) if contact.fallback is None else contact.fallback.sum(axis=0)
    return StiffnessReport(
        interface, contact.source, len(k), fallback, k.min(axis=0), np.median(k, axis=0), k.max(axis=0)
    )


def unit_traction(residual: NDArray, area: NDArray) -> ContactStiffness:
    """Stiffness of one face under a uniform traction in each direction.

    Parameters
    ----------
    residual : (3 n, 3 n) complex or float, m/N
        Residual flexibility between the points of the face.
    area : (n,) float, m2

    Raises
    ------
    ModelError
        If the flexibility is not positive under any uniform traction.
    """
    n = len(area)
    block = residual.real.reshape(n, 3, n, 3)
    stiffness = np.empty((n, 3))
    fallback = np.zeros((n, 3), bool)
    for axis in range(3):
        give = block[:, axis, :, axis] @ area
        ok = give > 0.0
        if not ok.any():
            raise ModelError(
                f"residual flexibility along axis {axis}: expected a positive displacement under a uniform traction, "
                f"found at most {give.max():.3g} m2 m/N; the retained modes are stiffer than the full model"
            )
        fallback[:, axis] = ~ok
        give[~ok] = np.median(give[ok] / area[ok]) * area[~ok]
        stiffness[:, axis] = area / give
    return ContactStiffness(stiffness, "unit_traction", fallback)


def paper_equations(displacement: NDArray, force: NDArray, substitute: ContactStiffness) -> ContactStiffness:
    """Eqs (4), (10), (11): stiffness from what the modes leave out of a static contact solution.

    Parameters
    ----------
    displacement : (n, 3) float
        Relative displacement that the retained modes leave out, positive along the force.
    force : (n, 3) float
    substitute : ContactStiffness
        Used where a force component is too small to divide by, or the quotient is not positive.
    """
    largest = np.abs(force).max(axis=0)
    usable = (np.abs(force) > SMALL_FORCE * largest) & (displacement * force > 0.0)
    quotient = np.divide(force, displacement, out=np.ones_like(force), where=usable)
    return ContactStiffness(np.where(usable, quotient, substitute.stiffness), "eq4", ~usable)


def static_forces(coupling: Coupling, friction: NDArray, max_iterations: int = 100) -> StaticForces:
    """Condensed static contact problem on the full flexibility at nodal diameter 0, for a load of 1 N.

    Parameters
    ----------
    coupling : Coupling
        Interfaces and bodies; every mode of the model is taken into account through the flexibility.
    friction : (n_points,) float

    Raises
    ------
    ModelError
        If there is no load, or the states of the points do not settle.
    """
    n = coupling.n_points
    bare = _without_elastic_modes(coupling)
    flexibility = bare.residual_flexibility(0).real
    rigid = bare.basis(0).G.real.reshape(3 * n, -1)
    load, offset = bare.load()
    if not np.any(load):
        raise ModelError("static contact: expected a load on a free body, the model has none")
    status = np.zeros((n, 2), int)
    seen: list[bytes] = []
    force = np.zeros((n, 3))
    for iteration in range(max_iterations):
        force, motion = _solve_states(flexibility, rigid, load, offset, status, friction)
        new = _next_states(force, motion, status, friction)
        if np.array_equal(new, status):
            balance = np.abs(rigid.T @ force.ravel() - load).max() / np.abs(load).max()
            return StaticForces(force, status, _violation(force, motion, status, friction), float(balance), iteration + 1)
        key = new.tobytes()
        # a cycle of states is left by changing only the point that violates its state most
        status = _one_change(force, motion, status, new, friction) if key in seen else new
        seen.append(key)
    raise ModelError(
        f"static contact: the contact states did not settle in {max_iterations} iterations; "
        "give the contact stiffness or the finite element contact forces instead"
    )


def _without_elastic_modes(coupling: Coupling) -> Coupling:
    """Only rigid-body modes retained, so that the residual flexibility is the full one."""
    modes = {}
    for body in coupling.model.bodies.values():
        if body.kind == "ground":
            continue
        modes[body.name] = np.arange(6) if body.kind == "free" else np.arange(0)
    return Coupling(coupling.model, coupling.interfaces, modes, coupling.engine_order, coupling.single_basis)


def _solve_states(
    flexibility: NDArray, rigid: NDArray, load: NDArray, offset: NDArray, status: NDArray, friction: NDArray
) -> tuple[NDArray, NDArray]:
    """Forces (n, 3) and relative motion (n, 3) for given states.

    ``F = S f`` with free components ``f`` (sticking tangential and closed normal ones; a slipping component follows its
    normal force), and ``x = 0`` is asked for exactly where a component is free.
    """
    n = len(status)
    closed = (status != 3).all(axis=1)
    free = np.concatenate([(status == 0) & closed[:, None], closed[:, None]], axis=1)
    index = np.flatnonzero(free.ravel())
    expand = np.zeros((3 * n, len(index)))
    expand[index, np.arange(len(index))] = 1.0
    column = np.full(3 * n, -1)
    column[index] = np.arange(len(index))
    for p in np.flatnonzero(closed):
        for d in range(2):
            if status[p, d] in (1, 2):
                expand[3 * p + d, column[3 * p + 2]] = friction[p] * (1.0 if status[p, d] == 1 else -1.0)
    m = rigid.shape[1]
    # x = offset + Psi eta - R F; forces oppose the motion, so F is the force that the interface puts up against x
    system = np.zeros((len(index) + m, len(index) + m))
    system[: len(index), : len(index)] = -(flexibility @ expand)[index]
    system[: len(index), len(index) :] = rigid[index]
    system[len(index) :, : len(index)] = rigid.T @ expand
    right = np.concatenate([-offset.ravel()[index], load])
    # forces and rigid-body coordinates differ by many orders: both get units in which the matrix is of order one
    unit = np.concatenate([np.full(len(index), 1.0), np.full(m, np.abs(flexibility).max() / np.abs(rigid).max())])
    rows = np.concatenate([np.full(len(index), np.abs(flexibility).max()), np.full(m, np.abs(rigid).max())])
    solution = unit * np.linalg.lstsq(system / rows[:, None] * unit, right / rows, rcond=1e-14)[0]
    force = expand @ solution[: len(index)]
    motion = offset.ravel() + rigid @ solution[len(index) :] - flexibility @ force
    return force.reshape(n, 3), motion.reshape(n, 3)


def _next_states(force: NDArray, motion: NDArray, status: NDArray, friction: NDArray) -> NDArray:
    new = status.copy()
    closed = (status != 3).all(axis=1)
    size = np.abs(force).max()
    reach = np.abs(motion).max()
    tensile = closed & (force[:, 2] < -1e-12 * size)
    closing = ~closed & (motion[:, 2] > 1e-12 * reach)
    limit = friction * np.maximum(force[:, 2], 0.0)
    for d in range(2):
        t, x = force[:, d], motion[:, d]
        stuck = closed & (status[:, d] == 0)
        new[stuck & (t > limit + 1e-12 * size), d] = 1
        new[stuck & (t < -limit - 1e-12 * size), d] = 2
        # friction must oppose the slip that it goes with
        new[closed & (status[:, d] == 1) & (x < -1e-12 * reach), d] = 0
        new[closed & (status[:, d] == 2) & (x > 1e-12 * reach), d] = 0
    new[tensile] = 3
    new[closing] = 0
    return new


def _violation(force: NDArray, motion: NDArray, status: NDArray, friction: NDArray) -> float:
    size, reach = np.abs(force).max(), max(float(np.abs(motion).max()), 1e-300)
    closed = (status != 3).all(axis=1)
    limit = friction * force[:, 2]
    worst = max(0.0, float(np.max(-force[closed, 2], initial=0.0)) / size)
    worst = max(worst, float(np.max(np.abs(force[:, :2]) - limit[:, None], initial=0.0, where=closed[:, None])) / size)
    worst = max(worst, float(np.max(motion[~closed, 2], initial=0.0)) / reach)
    return max(worst, float(np.max(np.abs(motion[closed, 2]), initial=0.0)) / reach)


def _one_change(force: NDArray, motion: NDArray, status: NDArray, new: NDArray, friction: NDArray) -> NDArray:
    changed = np.flatnonzero((new != status).any(axis=1))
    excess = np.abs(force[changed, :2]).max(axis=1) - friction[changed] * force[changed, 2]
    weight = np.maximum(excess / np.abs(force).max(), np.abs(motion[changed]).max(axis=1) / np.abs(motion).max())
    pick = changed[int(np.argmax(weight))]
    out = status.copy()
    out[pick] = new[pick]
    return out


def contact_stiffness(
    coupling: Coupling,
    method: Method | float | Mapping[str, NDArray],
    friction: NDArray,
    harmonic: int = 1,
) -> dict[str, ContactStiffness]:
    """Stiffness at the contact points of every interface of a coupling.

    Parameters
    ----------
    coupling : Coupling
    method : {"unit_traction", "eq4"}, float or mapping
        A number (N/m) for every point and direction, or for each interface an array that broadcasts to (n_points, 3).
    friction : (n_points,) float
        Friction coefficients, for the static contact solution of ``"eq4"``.
    harmonic : int
        Harmonic whose nodal diameter the residual flexibility is taken at.

    Raises
    ------
    SettingError
        If the method is not known, or values given by the user are not positive and finite.
    """
    if isinstance(method, str) and method not in METHODS:
        raise SettingError(f"contact_stiffness: expected one of {METHODS}, numbers or a mapping, found '{method}'")
    if not isinstance(method, str):
        return _from_user(coupling, method)
    residual = coupling.residual_flexibility(harmonic)
    out = {}
    forces = None
    for name in coupling.interfaces:
        rows = coupling.rows(name)
        block = slice(3 * rows.start, 3 * rows.stop)
        face = coupling.model.interfaces[name]
        out[name] = unit_traction(residual[block, block], face.area)
        if method == "eq4" and face.kind == "friction":
            if forces is None:
                forces = _forces_for_paper(coupling, friction)
                left_out = (residual.real @ forces.ravel()).reshape(-1, 3)
            out[name] = paper_equations(left_out[rows], forces[rows], out[name])
    return out


def _forces_for_paper(coupling: Coupling, friction: NDArray) -> NDArray:
    """Static contact forces as (T1, T2, N): the user's where the model has them, else the condensed problem's."""
    faces = [name for name in coupling.interfaces if _is_friction(coupling, name)]
    out = np.zeros((coupling.n_points, 3))
    if all(name in coupling.model.static for name in faces):
        for name in faces:
            # the file holds the force on body a; (T1, T2) act against u_b - u_a, hence along the force on a
            out[coupling.rows(name)] = coupling.model.static[name].force * np.array([1.0, 1.0, -1.0])
        return out
    only_faces = replace(coupling, interfaces=tuple(faces))
    rows = np.concatenate([np.arange(coupling.n_points)[coupling.rows(name)] for name in faces])
    out[rows] = static_forces(only_faces, friction[rows]).force
    return out


def _is_friction(coupling: Coupling, name: str) -> bool:
    return coupling.model.interfaces[name].kind == "friction"


def _from_user(coupling: Coupling, value: float | Mapping[str, NDArray]) -> dict[str, ContactStiffness]:
    if isinstance(value, Mapping):
        missing = [name for name in coupling.interfaces if name not in value]
        if missing:
            raise SettingError(f"contact_stiffness: expected values for interfaces {missing} as well")
    out = {}
    for name in coupling.interfaces:
        n = coupling.model.interfaces[name].n_points
        given = value[name] if isinstance(value, Mapping) else value
        try:
            k = np.array(np.broadcast_to(np.asarray(given, float), (n, 3)))
        except ValueError as error:
            raise SettingError(
                f"contact_stiffness['{name}']: expected a shape that broadcasts to {(n, 3)}, found {np.shape(given)}"
            ) from error
        if not np.isfinite(k).all() or (k < 0.0).any():
            raise SettingError(f"contact_stiffness['{name}']: expected finite non-negative N/m, found {k.min():.3g}")
        out[name] = ContactStiffness(k, "user")
    return out
