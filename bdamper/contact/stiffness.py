r"""Contact stiffness: the effect of the omitted modes as springs at the contact points.

Section 2.2 of the paper derives Eqs. (1) to (11).  Under the static load :math:`P` of the dampers,
a finite element contact analysis gives the contact forces :math:`F` and the displacements
:math:`U_B`, :math:`U_D` of blade and damper at each contact point.  Modal superposition gives

.. math::
    \tilde U_B &= -R_B F \quad (1), \qquad \tilde U_D = \tilde U_{DR} + \tilde U_{DE} \quad (5), \\
    \tilde U_{DR} &= \Psi \eta \quad (6), \qquad \tilde U_{DE} = R_{DC} F + R_{DP} P \quad (7),

with the receptances :math:`R_B, R_{DC}, R_{DP}` of the retained modes and the rigid-body modes
:math:`\Psi` of the damper.  The differences :math:`\Delta U_B = U_B - \tilde U_B` (2) and
:math:`\Delta U_D = U_D - \tilde U_D` (8) are assigned to springs, :math:`K_{cB}\,\Delta U_B = -F`
(3) and :math:`K_{cD}\,\Delta U_D = F` (9).  With diagonal matrices, substitution gives

.. math::
    K_{cB}^{-1} F &= -(R_B F + U_B) \qquad (4), \\
    K_{cD}^{-1} F &= U_D - (\Psi \eta + R_{DC} F + R_{DP} P) \qquad (10), \\
    K_c^{-1} &= K_{cB}^{-1} + K_{cD}^{-1} \qquad (11).

The right-hand sides follow from the linear model alone.  The residual flexibility :math:`R_{res}`
of both sides (:mod:`bdamper.model.kinematics`) gives :math:`1/k_i = (R_{res} F)_i / F_i` as the sum
of Eqs. (4) and (10) at each point and direction: :func:`paper_equations`.  The deformation of the
damper under its load, the last term of Eq. (10), is not part of this stiffness.  It enters the
analysis as an initial gap between the surfaces.  :func:`paper_contact` gives the forces and
displacements, from the condensed contact problem (:mod:`bdamper.contact.static_contact`) or from
the model file.

:func:`contact_stiffness` lists all methods.  A new method needs a name in :data:`METHODS`, a
function that returns ``ContactStiffness``, and a branch in :func:`contact_stiffness`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.residual_flexibility import ResidualModes, ResidualSet
from bdamper.contact.static_contact import solve_static_contact, static_contact_problem
from bdamper.model.kinematics import Coupling
from bdamper.model.structure import ContactStiffness, Interface
from bdamper.util import validation
from bdamper.util.errors import SettingError, check
from bdamper.util.formatting import amount, counted, short_repr
from bdamper.util.statement import Statement

DIRECTIONS = ("t1", "t2", "n")
"""Names of the local directions of a contact point."""
METHODS = ("residual_modes", "unit_traction", "cigeroglu2009")
FAR = 10.0
"""Largest ratio between a stiffness from Eqs. (4), (10) and from ``"unit_traction"``, in either
sense.
"""
SMALL_FORCE = 0.05
"""Smallest force component in Eqs. (4), (10), relative to the largest component of the face in this
direction.
"""
FROM_FILE = np.array([1.0, 1.0, -1.0])
"""Signs of (t1, t2, n) in a model file, where forces act on body a and motion is u_b - u_a.

T1 and T2 oppose u_b - u_a and thus act along the force on a.  N and the closing are positive in
compression.
"""


@validation.check_arguments
@dataclass(frozen=True)
class PerArea:
    """Contact stiffness per unit area.

    Parameters
    ----------
    stiffness : float or tuple of three float, N/m3
        One value for all directions, or one value each for t1, t2 and n.
    """

    stiffness: float | tuple[float, float, float]

    def __post_init__(self) -> None:
        if np.ndim(self.stiffness) == 0:
            validation.number("stiffness per area", self.stiffness, least=0.0, unit="N/m3")
        else:
            validation.numbers("stiffness per area", self.stiffness, 3, least=0.0, unit="N/m3")


@short_repr
@dataclass(frozen=True)
class ContactModel:
    """Contact stiffness of all interfaces and the residual modes that complete it.

    Parameters
    ----------
    stiffness : dict of interface name to ContactStiffness
    residual : ResidualSet, optional
    method : name, ResidualModes, float, PerArea or mapping
        Method or values from which the stiffness was computed.
    note : str
        Reason why a method other than the default was used, if the model determined the method.
    """

    stiffness: dict[str, ContactStiffness]
    residual: ResidualSet | None = None
    method: Any = None
    note: str = ""


def report(contacts: Mapping[str, ContactStiffness], note: str) -> Statement:
    """Return the stiffness of the interfaces: median and range in each direction, in MN/m.

    A fallback value replaces a point without a positive displacement.
    """
    table: list[tuple[str, ...]] = [
        ("Interface", "Points", *DIRECTIONS, "Fallback values", "Method")
    ]
    n_fallback = 0
    sources: list[str] = []
    for name, contact in contacts.items():
        if contact.fallback is not None:
            fallback = contact.fallback
        else:
            fallback = np.zeros(contact.stiffness.shape, bool)
        n_fallback += int(fallback.sum())
        values = [_median_and_range(k) for k in contact.stiffness.T]
        # fallback values in each direction
        counts = []
        for n, axis in zip(fallback.sum(axis=0), DIRECTIONS):
            if n:
                counts.append(f"{n} along {axis}")
        n_points = str(len(contact.stiffness))
        source = contact.source.replace("_", " ")
        sources.append(source)
        table.append((name, n_points, *values, ", ".join(counts), source))
    if not n_fallback:
        fallbacks = "no fallback values"
    else:
        fallbacks = counted(n_fallback, "fallback value")
    verdict = f"Contact stiffness (MN/m), median and range: {fallbacks}"
    if len(set(sources)) == 1:
        # one method for all interfaces needs no column
        verdict += f", method: {sources[0]}"
        table = [row[:-1] for row in table]
    return Statement([verdict], remarks=[note] if note else [], table=table)


def _median_and_range(stiffness: NDArray) -> str:
    """Return stiffnesses (N/m) in MN/m, for example "970 (708 to 1130)"."""
    values = 1e-6 * stiffness
    if np.ptp(values) <= 1e-6 * values.max():
        return amount(float(values.max()))
    median, low, high = (amount(float(f(values))) for f in (np.median, np.min, np.max))
    return f"{median} ({low} to {high})"


def contact_stiffness(
    coupling: Coupling,
    method: str | float | ResidualModes | PerArea | Mapping[str, NDArray],
    friction: NDArray,
) -> ContactModel:
    """Compute the contact stiffness at the points of every interface.

    Parameters
    ----------
    coupling : Coupling
    method : one of METHODS, ResidualModes, float, PerArea or mapping
        Method (see Notes) or user-supplied values: N/m for every point and direction, N/m3 as
        ``PerArea``, or for each interface name an array that broadcasts to (n_points, 3), N/m.
    friction : (n_points,) float
        Friction coefficients.

    Returns
    -------
    ContactModel

    Raises
    ------
    SettingError
        If the method is unknown, or a user-supplied value is negative or not finite.
    ModelError
        If a flexibility that the method needs is missing or not positive.

    Notes
    -----
    ``"cigeroglu2009"`` evaluates Eqs. (1) to (11), ``"unit_traction"`` applies a uniform traction
    in one direction to each face, and ``"residual_modes"`` or ``ResidualModes(...)`` combines a
    diagonal part of the residual flexibility with further modal coordinates
    (:mod:`bdamper.contact.residual_flexibility`).
    """
    check_method(method)
    if isinstance(method, str) and method == "residual_modes":
        method = ResidualModes()
    if isinstance(method, ResidualModes):
        return _with_residual_modes(coupling, method, friction)
    if not isinstance(method, str):
        return ContactModel(_user_values(coupling, method))
    stiffness = _unit_tractions(coupling)
    if method == "cigeroglu2009":
        force, displacement = paper_contact(coupling, friction)
        for name in coupling.friction_faces:
            rows = coupling.rows(name)
            stiffness[name] = paper_equations(
                displacement[rows], force[rows], substitute=stiffness[name], far=FAR
            )
    return ContactModel(stiffness)


def check_method(method: Any) -> None:
    """Raise SettingError unless ``method`` is a method or user-supplied values.

    A method is one of ``METHODS`` or settings of residual modes.
    """
    if isinstance(method, ResidualModes | PerArea | Mapping):
        return
    if isinstance(method, str) and method in METHODS:
        return
    if method is None or isinstance(method, str | bytes) or np.ndim(method) != 0:
        expected = (
            f"one of {(*METHODS, 'model')}, one number in N/m, PerArea(...), ResidualModes(...) "
            "or a mapping of interface names to values"
        )
        raise validation.invalid("contact_stiffness", expected, method)
    validation.number("contact_stiffness", method, least=0.0, unit="N/m")


# ---- Eqs. (1) to (11) ----


def paper_equations(
    displacement: NDArray, force: NDArray, substitute: ContactStiffness, far: float = np.inf
) -> ContactStiffness:
    """Evaluate Eqs. (4), (10) and (11): force per displacement that the retained modes omit.

    Parameters
    ----------
    displacement : (n, 3) float, m
        Relative displacement that the retained modes omit, positive along the force: the right-hand
        sides of Eqs. (4) and (10), added up.
    force : (n, 3) float, N
        Contact forces T1, T2, N.
    substitute : ContactStiffness
        Fallback if a force component is below :data:`SMALL_FORCE` times the largest one, or if the
        quotient is not positive or differs from the fallback by more than the factor ``far``.
        Under a wedge load the axial forces are almost zero and of either sign, so their quotients
        have no meaning.
    far : float

    Returns
    -------
    ContactStiffness
        ``fallback`` marks the points and directions with the value of ``substitute``.
    """
    # largest force of the face in each direction
    largest = np.abs(force).max(axis=0)
    large_enough = np.abs(force) > SMALL_FORCE * largest
    positive = displacement * force > 0.0
    usable = large_enough & positive
    quotient = np.divide(force, displacement, out=np.ones_like(force), where=usable)
    usable &= np.abs(np.log(quotient / substitute.stiffness)) < np.log(far)
    stiffness = np.where(usable, quotient, substitute.stiffness)
    return ContactStiffness(stiffness, source="cigeroglu2009", fallback=~usable)


def paper_contact(coupling: Coupling, friction: NDArray) -> tuple[NDArray, NDArray]:
    """Compute static contact forces and the displacement that the retained modes omit.

    Both are per newton of load.  The finite element analysis in the model is used if it covers
    every friction interface, otherwise the condensed contact problem.

    Returns
    -------
    force : (n_points, 3) float
        T1, T2, N.
    displacement : (n_points, 3) float, m/N
        Positive along the force; Eqs. (2) and (8) added up.
    """
    force = _static_contact_forces(coupling, friction)
    if _has_static_solution(coupling):
        return force, _omitted_displacement(coupling, force)
    displacement = coupling.residual_flexibility(1).real @ force.ravel()
    return force, displacement.reshape(-1, 3)


def _has_static_solution(coupling: Coupling) -> bool:
    return all(name in coupling.model.static for name in coupling.friction_faces)


def _static_contact_forces(coupling: Coupling, friction: NDArray) -> NDArray:
    """Return the static contact forces T1, T2, N (n_points, 3) per newton of load.

    A static solution of the model contains them; without it, the condensed problem is solved.
    """
    force = np.zeros((coupling.n_points, 3))
    if not _has_static_solution(coupling):
        with_friction = replace(coupling, interfaces=coupling.friction_faces)
        rows = coupling.friction_rows
        problem = static_contact_problem(with_friction, friction[rows])
        force[rows] = solve_static_contact(problem).force
        return force

    for name in coupling.friction_faces:
        force[coupling.rows(name)] = coupling.model.static[name].force * FROM_FILE
    problem = static_contact_problem(coupling)
    imbalance = np.abs(problem.rigid.T @ force.ravel() - problem.load).max()
    largest_load = max(float(np.abs(problem.load).max()), 1e-300)
    difference = float(imbalance / largest_load)
    limit = 0.02
    check(
        difference <= limit,
        "static contact forces of the model",
        f"equilibrium with a load of 1 N within {limit:.0%}",
        f"a difference of {difference:.3g} times the load",
    )
    return force


def _omitted_displacement(coupling: Coupling, force: NDArray) -> NDArray:
    """Evaluate Eqs. (2) and (8) with displacements of a finite element analysis.

    The rigid-body motion of Eq. (6) is fitted.
    """
    problem = static_contact_problem(coupling)
    rows = coupling.friction_rows
    # indices of the three components of these points in stacked vectors (3 n_points,)
    components = (3 * rows[:, None] + np.arange(3)).ravel()
    motion = np.zeros((coupling.n_points, 3))
    for name in coupling.friction_faces:
        static = coupling.model.static[name]
        relative = static.displacement_b - static.displacement_a
        motion[coupling.rows(name)] = relative * FROM_FILE

    # the motion of an elastic body plus a rigid-body motion
    deformation = problem.flexibility @ force.ravel()
    elastic = problem.offset.ravel() - deformation
    rigid_motion = motion.ravel() - elastic
    eta, *_ = np.linalg.lstsq(problem.rigid[components], rigid_motion[components], rcond=None)
    difference = rigid_motion - problem.rigid @ eta
    size = max(float(np.linalg.norm(deformation[components])), 1e-300)
    relative_difference = float(np.linalg.norm(difference[components]) / size)
    limit = 0.2
    check(
        relative_difference <= limit,
        "static contact displacements of the model",
        f"agreement with its static flexibility under its contact forces within {limit:.0%}",
        f"a difference of {relative_difference:.3g} times the deformation",
    )

    # flexibility of the retained modes
    R_modal = problem.flexibility - coupling.residual_flexibility(0).real
    # motion = offset + Psi eta - R_modal F - omitted displacement
    F = force.ravel()
    omitted = problem.offset.ravel() + problem.rigid @ eta - R_modal @ F - motion.ravel()
    displacement = np.zeros((coupling.n_points, 3))
    displacement[rows] = omitted.reshape(-1, 3)[rows]
    return displacement


# ---- Other methods ----


def unit_traction(residual: NDArray, area: NDArray) -> ContactStiffness:
    """Compute the stiffness ``k_i = A_i/(R A)_i`` of a face under a uniform traction.

    The traction acts in each direction by itself.

    Parameters
    ----------
    residual : (3 n, 3 n) complex or float, m/N
        Residual flexibility between the points of the face.
    area : (n,) float, m2

    Returns
    -------
    ContactStiffness
        Points with a displacement that is not positive have the median displacement per area of the
        others.

    Raises
    ------
    ModelError
        If a uniform traction gives no point a positive displacement.
    """
    # residual = full model - retained modes: negative if the retained modes are more flexible
    n = len(area)
    # point and direction of the displacement, then of the force
    blocks = residual.real.reshape(n, 3, n, 3)
    stiffness = np.empty((n, 3))
    fallback = np.zeros((n, 3), bool)
    for axis in range(3):
        # per traction of 1 N/m2 along the same direction, m3/N
        displacement = blocks[:, axis, :, axis] @ area
        positive = displacement > 0.0
        check(
            positive.any(),
            f"residual flexibility along {DIRECTIONS[axis]}",
            "a positive displacement under a uniform traction",
            f"at most {displacement.max():.3g} m³/N: the retained modes are more flexible than the "
            "full model",
        )
        per_area = np.median(displacement[positive] / area[positive])
        displacement[~positive] = per_area * area[~positive]
        stiffness[:, axis] = area / displacement
        fallback[:, axis] = ~positive
    return ContactStiffness(stiffness, "unit_traction", fallback)


def _unit_tractions(coupling: Coupling) -> dict[str, ContactStiffness]:
    """Apply :func:`unit_traction` to every interface at the fundamental harmonic."""
    residual = coupling.residual_flexibility(1)
    stiffness = {}
    for name in coupling.interfaces:
        rows = coupling.rows(name)
        # three components of each point
        block = slice(3 * rows.start, 3 * rows.stop)
        area = coupling.model.interfaces[name].area
        stiffness[name] = unit_traction(residual[block, block], area)
    return stiffness


def _with_residual_modes(
    coupling: Coupling, options: ResidualModes, friction: NDArray
) -> ContactModel:
    """Return residual modes, with the inverse of their diagonal as stiffness of the points."""
    bodies = coupling.model.bodies.values()
    has_load = any(body.load is not None and np.any(body.load.generalised) for body in bodies)
    # "all" needs no force vectors from statics
    static = None
    if has_load and options.n_vectors != "all":
        static = _static_contact_forces(coupling, friction)
    residual_set = ResidualSet.make(coupling, friction, options, static)

    # components without friction keep the stiffness under a uniform traction
    stiffness = {}
    for name, uniform in _unit_tractions(coupling).items():
        flexibility = residual_set.flexibility[coupling.rows(name)]
        has_friction = flexibility > 0.0
        k = np.divide(1.0, flexibility, out=uniform.stiffness.copy(), where=has_friction)
        stiffness[name] = ContactStiffness(k, "residual_modes")
    return ContactModel(stiffness, residual_set)


def _user_values(
    coupling: Coupling, value: float | PerArea | Mapping[str, NDArray]
) -> dict[str, ContactStiffness]:
    """Return the stiffness that a user has given, one value for all interfaces or one for each."""
    interfaces = coupling.model.interfaces
    if isinstance(value, Mapping):
        validation.mapping("contact_stiffness", value, interfaces, "interfaces")
        missing = [name for name in coupling.interfaces if name not in value]
        if missing:
            raise SettingError(
                f"contact_stiffness: expected values for interfaces {missing} as well"
            )
        of_interface: Mapping[str, Any] = value
    else:
        of_interface = dict.fromkeys(coupling.interfaces, value)
    stiffness = {}
    for name in coupling.interfaces:
        k = _checked_stiffness(interfaces[name], of_interface[name])
        stiffness[name] = ContactStiffness(k, "user")
    return stiffness


def _checked_stiffness(face: Interface, value: Any) -> NDArray:
    """Return the stiffness (n_points, 3) that a user has given for an interface."""
    setting = f"contact_stiffness['{face.name}']"
    shape = (face.n_points, 3)
    if isinstance(value, PerArea):
        # (n_points, 1) times one number or (3,)
        value = face.area[:, None] * np.asarray(value.stiffness, float)
    try:
        k = np.array(np.broadcast_to(np.asarray(value, float), shape))
    except (TypeError, ValueError) as error:
        expected = f"numbers in N/m, PerArea(...) or an array that broadcasts to {shape}"
        raise validation.invalid(setting, expected, value) from error
    # a cubic spring may soften
    allowed = (k >= 0.0) | (face.kind == "cubic")
    wrong = k[~(np.isfinite(k) & allowed)]
    if wrong.size:
        raise validation.invalid(setting, "finite numbers >= 0 N/m", wrong[0])
    return k
