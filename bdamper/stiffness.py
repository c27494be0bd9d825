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
    The static contact forces come from the condensed contact problem (:mod:`bdamper.staticcontact`) or from the user's
    own finite element analysis.  Where ``|F_i|`` is below 5 % of the largest component in this direction over the face, or
    the quotient is not positive, the division says nothing; the value of ``"unit_traction"`` stands in, and the report
    counts it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.coupling import Coupling
from bdamper.errors import ModelError, SettingError
from bdamper.model import ContactStiffness
from bdamper.residual import ResidualModes, ResidualSet
from bdamper.staticcontact import solve_static_contact, static_contact_problem

METHODS = ("residual_modes", "unit_traction", "eq4")
CERTIFIED = 1e-10
"""Largest violation of the contact conditions in a static solution that is used."""
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
class PerArea:
    """Contact stiffness per area, N/m3: one number, or three for t1, t2 and n."""

    stiffness: float | tuple[float, float, float]


@dataclass(frozen=True)
class Contact:
    """Stiffness of all interfaces, with the residual coordinates that belong to it.

    Parameters
    ----------
    stiffness : dict of interface name to ContactStiffness
    residual : ResidualSet, optional
    """

    stiffness: dict[str, ContactStiffness]
    residual: ResidualSet | None = None


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


def contact_stiffness(
    coupling: Coupling,
    method: str | float | ResidualModes | PerArea | Mapping[str, NDArray],
    friction: NDArray,
) -> Contact:
    """Stiffness at the contact points of every interface of a coupling.

    Parameters
    ----------
    coupling : Coupling
    method : one of METHODS, ResidualModes, float, PerArea or mapping
        A name; residual modes with other settings than the default; or what the user gives: N/m for every point and
        direction, N/m3 for every direction, or for each interface an array that broadcasts to (n_points, 3).
    friction : (n_points,) float
        Friction coefficients.

    Raises
    ------
    SettingError
        If the method is not known, or values given by the user are not finite and non-negative.
    ModelError
        If a flexibility that the method needs is missing or not positive.
    """
    if isinstance(method, str) and method not in METHODS:
        raise SettingError(f"contact_stiffness: expected one of {METHODS}, numbers or a mapping, found '{method}'")
    if method == "residual_modes":
        method = ResidualModes()
    if isinstance(method, ResidualModes):
        return _with_residual_modes(coupling, method, friction)
    if not isinstance(method, str):
        return Contact(_from_user(coupling, method))
    residual = coupling.residual_flexibility(1)
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
    return Contact(out)


def _with_residual_modes(coupling: Coupling, options: ResidualModes, friction: NDArray) -> Contact:
    has_load = any(body.load is not None and np.any(body.load.generalised) for body in coupling.model.bodies.values())
    static = _forces_for_paper(coupling, friction) if has_load and options.patterns != "all" else None
    residual_set = ResidualSet.make(coupling, friction, options, static)
    D = residual_set.flexibility
    residual = coupling.residual_flexibility(1)
    out = {}
    for name in coupling.interfaces:
        rows = coupling.rows(name)
        block = slice(3 * rows.start, 3 * rows.stop)
        rest = unit_traction(residual[block, block], coupling.model.interfaces[name].area).stiffness
        here = D[rows]
        k = np.divide(1.0, here, out=rest.copy(), where=here > 0.0)
        out[name] = ContactStiffness(k, "residual_modes")
    return Contact(out, residual_set)


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
    problem = static_contact_problem(only_faces, friction[rows], np.zeros(len(rows)))
    solution = solve_static_contact(problem)[0]
    if solution.certificate.worst > CERTIFIED:
        raise ModelError(f"static contact: expected violations below {CERTIFIED:g}, found {solution.certificate}")
    out[rows] = solution.force
    return out


def _is_friction(coupling: Coupling, name: str) -> bool:
    return coupling.model.interfaces[name].kind == "friction"


def _from_user(coupling: Coupling, value: float | PerArea | Mapping[str, NDArray]) -> dict[str, ContactStiffness]:
    if isinstance(value, Mapping):
        missing = [name for name in coupling.interfaces if name not in value]
        if missing:
            raise SettingError(f"contact_stiffness: expected values for interfaces {missing} as well")
    out = {}
    for name in coupling.interfaces:
        n = coupling.model.interfaces[name].n_points
        given: Any = value[name] if isinstance(value, Mapping) else value
        if isinstance(given, PerArea):
            given = coupling.model.interfaces[name].area[:, None] * np.asarray(given.stiffness, float)
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
