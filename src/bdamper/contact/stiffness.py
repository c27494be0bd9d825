"""Contact stiffness (paper, section 2.2): the flexibility that the retained modes leave out, at the contact points.

Every method starts from the residual flexibility ``R_res`` of both sides of an interface
(:mod:`bdamper.model.kinematics`), patch-averaged displacement for patch-averaged force, and looks for a positive
diagonal.

``"unit_traction"``
    A uniform traction in one direction over the whole face, forces ``F_i = A_i``:  ``k_i = A_i/(R_res A)_i``.

``"cigeroglu2009"``
    Paper, Eqs (1)-(11).  With the contact forces ``F`` of the static contact problem under the centrifugal load, the
    modal superposition misses ``R_res F`` of the displacement on each side (Eqs (2), (8)), so Eqs (4), (10) and (11) read
    ``1/k_i = (R_res F)_i / F_i``.  (The deformation of the damper by its own load, the last term of Eq (10), is not put
    into the stiffness: it enters the analysis as an initial distance of the surfaces.)
    The static contact forces come from the condensed contact problem (:mod:`bdamper.contact.static_contact`) or from
    the user's own finite element analysis.  Where ``|F_i|`` is below 5 % of the largest component in this direction over
    the face, or the quotient is not positive or more than ten times that of ``"unit_traction"`` or less than a tenth of it,
    the quotient has no meaning; the value of ``"unit_traction"`` replaces it, and the report counts the point.

``"residual_modes"``
    A positive diagonal, a share of the point flexibility, and the rest in a few more modal coordinates
    (:mod:`bdamper.contact.residual_flexibility`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.residual_flexibility import ResidualModes, ResidualSet
from bdamper.contact.static_contact import solve_static_contact, static_contact_problem
from bdamper.model.fields import check
from bdamper.model.kinematics import Coupling
from bdamper.model.structure import ContactStiffness
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.formatting import short_repr

METHODS = ("residual_modes", "unit_traction", "cigeroglu2009")
FAR = 10.0
"""Factor from the value of ``"unit_traction"`` beyond which the quotient of Eqs (4), (10) is not used."""
SMALL_FORCE = 0.05
"""Share of the largest force component below which Eqs (4), (10) are not divided by it."""


@dataclass(frozen=True)
class PerArea:
    """Contact stiffness per area, N/m3: one number, or three for t1, t2 and n."""

    stiffness: float | tuple[float, float, float]

    def __post_init__(self) -> None:
        if np.ndim(self.stiffness) == 0:
            validation.number("stiffness per area", self.stiffness, least=0.0, unit="N/m3")
        else:
            validation.numbers("stiffness per area", self.stiffness, 3, least=0.0, unit="N/m3")


@short_repr
@dataclass(frozen=True)
class Contact:
    """Stiffness of all interfaces, with the residual coordinates that belong to it.

    Parameters
    ----------
    stiffness : dict of interface name to ContactStiffness
    residual : ResidualSet, optional
    method : name, ResidualModes, float, PerArea or mapping
        What it was made by.
    note : str
        Why that is not the default method, if the choice was left to the model.
    """

    stiffness: dict[str, ContactStiffness]
    residual: ResidualSet | None = None
    method: Any = None
    note: str = ""


def report(interface: str, contact: ContactStiffness) -> str:
    """Range of the stiffness of one interface, and at how many points the method's substitute was used."""
    k = contact.stiffness
    fallback = np.zeros(3, int) if contact.fallback is None else contact.fallback.sum(axis=0)
    parts = [
        f"{name}: {np.median(values):.3g} ({values.min():.3g}..{values.max():.3g}), {n} of {len(k)} fell back"
        for name, values, n in zip(("t1", "t2", "n"), k.T, fallback)
    ]
    return f"{interface}, {contact.source}, N/m: " + "; ".join(parts)


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
        item, expected = f"residual flexibility along axis {axis}", "a positive displacement under a uniform traction"
        found = f"at most {give.max():.3g} m2 m/N; the retained modes are stiffer than the full model"
        check(ok.any(), item, expected, found)
        fallback[:, axis] = ~ok
        give[~ok] = np.median(give[ok] / area[ok]) * area[~ok]
        stiffness[:, axis] = area / give
    return ContactStiffness(stiffness, "unit_traction", fallback)


def paper_equations(
    displacement: NDArray, force: NDArray, substitute: ContactStiffness, far: float = np.inf
) -> ContactStiffness:
    """Eqs (4), (10), (11): stiffness from what the modes leave out of a static contact solution.

    Parameters
    ----------
    displacement : (n, 3) float
        Relative displacement that the retained modes leave out, positive along the force.
    force : (n, 3) float
    substitute : ContactStiffness
        Used where a force component is too small to divide by, or the quotient is not positive or far from this one.
    far : float
        Factor beyond which it is.
    """
    largest = np.abs(force).max(axis=0)
    usable = (np.abs(force) > SMALL_FORCE * largest) & (displacement * force > 0.0)
    quotient = np.divide(force, displacement, out=np.ones_like(force), where=usable)
    usable &= np.abs(np.log(quotient / substitute.stiffness)) < np.log(far)
    return ContactStiffness(np.where(usable, quotient, substitute.stiffness), "cigeroglu2009", ~usable)


def contact_stiffness(
    coupling: Coupling, method: str | float | ResidualModes | PerArea | Mapping[str, NDArray], friction: NDArray
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

    Returns
    -------
    Contact

    Raises
    ------
    SettingError
        If the method is not known, or values given by the user are not finite and non-negative.
    ModelError
        If a flexibility that the method needs is missing or not positive.
    """
    check_method(method)
    if isinstance(method, str) and method == "residual_modes":
        method = ResidualModes()
    if isinstance(method, ResidualModes):
        return _with_residual_modes(coupling, method, friction)
    if not isinstance(method, str):
        return Contact(_from_user(coupling, method))
    out = _unit_tractions(coupling)
    if method == "cigeroglu2009":
        forces, left_out = paper_contact(coupling, friction)
        for name in coupling.friction_faces:
            rows = coupling.rows(name)
            out[name] = paper_equations(left_out[rows], forces[rows], out[name], FAR)
    return Contact(out)


def check_method(method: Any) -> None:
    """Refuse what is neither a method nor the user's own values."""
    if isinstance(method, ResidualModes | PerArea | Mapping) or (isinstance(method, str) and method in METHODS):
        return
    if method is None or isinstance(method, str | bytes) or np.ndim(method) != 0:
        expected = f"one of {(*METHODS, 'model')}, one number in N/m, PerArea(...), ResidualModes(...) or a mapping"
        raise validation.invalid("contact_stiffness", f"{expected} of interface names to values", method)
    validation.number("contact_stiffness", method, least=0.0, unit="N/m")


def _with_residual_modes(coupling: Coupling, options: ResidualModes, friction: NDArray) -> Contact:
    has_load = any(body.load is not None and np.any(body.load.generalised) for body in coupling.model.bodies.values())
    static = _forces_for_paper(coupling, friction) if has_load and options.n_vectors != "all" else None
    residual_set = ResidualSet.make(coupling, friction, options, static)
    out = {}
    for name, rest in _unit_tractions(coupling).items():
        here = residual_set.flexibility[coupling.rows(name)]
        k = np.divide(1.0, here, out=rest.stiffness.copy(), where=here > 0.0)
        out[name] = ContactStiffness(k, "residual_modes")
    return Contact(out, residual_set)


def _unit_tractions(coupling: Coupling) -> dict[str, ContactStiffness]:
    """Stiffness of every interface under a uniform traction, with the residual flexibility of the fundamental."""
    residual = coupling.residual_flexibility(1)
    out = {}
    for name in coupling.interfaces:
        rows = coupling.rows(name)
        block = slice(3 * rows.start, 3 * rows.stop)
        out[name] = unit_traction(residual[block, block], coupling.model.interfaces[name].area)
    return out


def paper_contact(coupling: Coupling, friction: NDArray) -> tuple[NDArray, NDArray]:
    """Static contact forces (T1, T2, N) per newton and the displacement along them that the retained modes leave out.

    Both are (n_points, 3).  Of the user's finite element analysis where the model has it for every friction interface,
    else of the condensed problem.
    """
    forces = _forces_for_paper(coupling, friction)
    if _has_static(coupling):
        return forces, _left_out_of_finite_elements(coupling, forces)
    return forces, (coupling.residual_flexibility(1).real @ forces.ravel()).reshape(-1, 3)


def _has_static(coupling: Coupling) -> bool:
    return all(name in coupling.model.static for name in coupling.friction_faces)


def _forces_for_paper(coupling: Coupling, friction: NDArray) -> NDArray:
    """Static contact forces as (T1, T2, N): the user's where the model has them, else the condensed problem's."""
    faces = coupling.friction_faces
    out = np.zeros((coupling.n_points, 3))
    out_of_balance = 0.02  # largest difference, relative to the load, between the user's contact forces and equilibrium
    if _has_static(coupling):
        for name in faces:
            # the file holds the force on body a; (T1, T2) act against u_b - u_a, hence along the force on a
            out[coupling.rows(name)] = coupling.model.static[name].force * np.array([1.0, 1.0, -1.0])
        problem = static_contact_problem(coupling)
        given, load = problem.rigid.T @ out.ravel(), problem.load
        worst = float(np.abs(given - load).max() / max(float(np.abs(load).max()), 1e-300))
        expected = f"equilibrium with a load of 1 N within {out_of_balance:.0%}"
        found = f"a difference of {worst:.3g} times the load"
        check(worst <= out_of_balance, "static contact forces of the model", expected, found)
        return out
    only_faces = replace(coupling, interfaces=faces)
    rows = coupling.friction_rows
    problem = static_contact_problem(only_faces, friction[rows])
    out[rows] = solve_static_contact(problem).force
    return out


def _left_out_of_finite_elements(coupling: Coupling, force: NDArray) -> NDArray:
    """Eqs (2), (8) with the displacements of the user's analysis; the rigid-body motion is fitted to the full model."""
    full = static_contact_problem(coupling)
    rows = coupling.friction_rows
    given = np.zeros((coupling.n_points, 3))
    for name in coupling.friction_faces:
        static = coupling.model.static[name]
        given[coupling.rows(name)] = (static.displacement_b - static.displacement_a) * np.array([1.0, 1.0, -1.0])
    elastic = full.offset.ravel() - full.flexibility @ force.ravel()
    at = (3 * rows[:, None] + np.arange(3)).ravel()
    eta = np.linalg.lstsq(full.rigid[at], (given.ravel() - elastic)[at], rcond=None)[0]
    rest = given.ravel() - elastic - full.rigid @ eta
    worst = float(np.linalg.norm(rest[at]) / max(float(np.linalg.norm((full.flexibility @ force.ravel())[at])), 1e-300))
    other_model = 0.2  # largest difference of the user's displacements from the model's, relative to the deformation
    expected = f"those of its static flexibility under its contact forces within {other_model:.0%}"
    found = f"a difference of {worst:.3g} times the deformation"
    check(worst <= other_model, "static contact displacements of the model", expected, found)
    modal = full.flexibility - coupling.residual_flexibility(0).real
    # x = offset + Psi eta - R_modal F - (what is left out)
    left_out = full.offset.ravel() + full.rigid @ eta - modal @ force.ravel() - given.ravel()
    out = np.zeros((coupling.n_points, 3))
    out[rows] = left_out.reshape(-1, 3)[rows]
    return out


def _from_user(coupling: Coupling, value: float | PerArea | Mapping[str, NDArray]) -> dict[str, ContactStiffness]:
    if isinstance(value, Mapping):
        validation.mapping("contact_stiffness", value, coupling.model.interfaces, "interfaces")
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
        except (TypeError, ValueError) as error:
            expected = f"numbers in N/m, PerArea(...) or an array that broadcasts to {(n, 3)}"
            raise validation.invalid(f"contact_stiffness['{name}']", expected, given) from error
        softens = coupling.model.interfaces[name].kind == "cubic"
        wrong = k[~(np.isfinite(k) & ((k >= 0.0) | softens))]
        if wrong.size:
            raise validation.invalid(f"contact_stiffness['{name}']", "finite numbers >= 0 N/m", wrong[0])
        out[name] = ContactStiffness(k, "user")
    return out
