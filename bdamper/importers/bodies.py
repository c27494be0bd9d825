r"""Bodies of an imported model, from matrices or from modes, with data over rotor speed and local basis.

**Modes.**  Modes of a file become travelling waves toward +X with unit modal mass.  Their modal masses come from the file
or the user.  Static receptances do not follow from a few modes.  Without matrices the user therefore gives the contact
stiffness, and a damper is rigid.

**Rotor speed.**  Matrices at two speeds give the stiffness per squared speed as a difference quotient.  If a program gives
modes only, the modes of the second speed are combinations of the modes of the first.  With the unitary polar factor A of
their overlap,

.. math:: K(\Omega_1) = \omega_1^2, \qquad K(\Omega_2) = A\,\omega_2^2 A^H

on the modes of the first speed.  Pairing the modes in the order of their frequencies would fail at veerings.

References
----------
K. Fan, A. J. Hoffman, "Some metric inequalities in the space of matrices", *Proceedings of the American Mathematical
Society* 6 (1955): the polar factor is the nearest unitary matrix.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg
from numpy.typing import NDArray
from scipy.linalg import polar, svdvals

from bdamper.fem.cyclic_symmetry import CyclicSector, Sectors, Waves, travelling_waves
from bdamper.fem.local_basis import BladePart, LocalSizes, damper_motion, local_basis, sampled_waves
from bdamper.fem.reduced_bodies import (
    PICTURED_MODES,
    FreeBody,
    Wanted,
    constrained_body,
    free_body,
    nodes_of,
)
from bdamper.fem.rotation import IN_PLANE, Rotation
from bdamper.importers.fe_body import BOUNDS, FEBody, Modes
from bdamper.importers.options import NodeSet, Sector
from bdamper.importers.plausibility import check_rigid_motion, compare_frequencies
from bdamper.importers.prepared_body import PreparedBody, Ring
from bdamper.model.modal_basis import fix_phase, rigid_motions
from bdamper.model.structure import Body, BodyLoad, Interface, ModalBasis
from bdamper.util import validation
from bdamper.util.errors import SettingError, check

if TYPE_CHECKING:
    from bdamper.fem.element_stress import StressRows


# ---- Two rotor speeds ----


def over_speed(bodies: Mapping[float, FEBody]) -> FEBody:
    """Combine the same body at two rotor speeds, with matrices or modes at each speed.

    Parameters
    ----------
    bodies : mapping of rotor speed (rad/s) to FEBody
        For example ``{0.0: read_calculix("standstill"), 600.0: read_calculix("running")}``.  The modes of the model are the
        modes of the lower speed.

    Returns
    -------
    FEBody
        Body for :func:`bdamper.importers.build_model`.

    Raises
    ------
    SettingError, ModelError
        If there are not two speeds, the nodes differ, or one speed has matrices and the other has modes only.
    """
    if not isinstance(bodies, Mapping) or len(bodies) != 2:
        raise validation.invalid("over_speed", "a mapping of two rotor speeds to FEBody", bodies)
    checked = []
    for key, value in bodies.items():
        omega = validation.number("rotor speed", key, least=0.0, unit="rad/s")
        body = validation.instance(f"body at {omega:g} rad/s", value, FEBody)
        checked.append(replace(body, rotor_speed=omega, faster=None))
    slower, faster = sorted(checked, key=lambda body: body.rotor_speed)
    same, item = (
        np.array_equal(slower.numbers, faster.numbers),
        f"{faster.source} at {faster.rotor_speed:g} rad/s",
    )
    check(same, item, f"the nodes of {slower.source}", "other numbers")
    if (slower.stiffness is None) != (faster.stiffness is None):
        raise SettingError(
            "over_speed: expected matrices at both speeds, or modes at both speeds, found one of each"
        )
    return replace(slower, faster=faster)


def rotation_of(body: PreparedBody) -> Rotation | None:
    """Return the change of stiffness with rotor speed of a body with matrices, or None for a single speed.

    Raises
    ------
    ModelError
        If the mass matrix changes with speed.
    """
    if (other := body.faster) is None:
        return None
    first, last = body.raw.rotor_speed, other.raw.rotor_speed
    norm, mass = scipy.sparse.linalg.norm, body.structure.mass
    same = norm(other.structure.mass - mass) <= 1e-6 * norm(mass)
    body.require(
        same, f"mass matrix at {last:g} rad/s", "the mass matrix of the other speed", "another one"
    )
    per_squared_speed = (
        (other.structure.stiffness - body.structure.stiffness) / (last**2 - first**2)
    ).tocsr()
    softening = _spin_softening(body, per_squared_speed)
    if softening < 0.5:
        body.report.missing.append(
            f"spin softening of the {body.name}: the matrices at {last:g} rad/s take {100 * softening:.3g} % of its mass "
            "in the plane of rotation from the stiffness; frequencies of bending in this plane come out too high"
        )
    body.passed(
        f"{body.name}: stiffness at {first:g} and {last:g} rad/s, spin softening {100 * softening:.4g} %"
    )
    return Rotation(per_squared_speed, first, last, body.raw.source)


def _spin_softening(body: PreparedBody, per_squared_speed: NDArray) -> float:
    """Return the fraction of the mass in the plane of rotation that is missing from the stiffness.

    A translation in this plane causes no force of the elastic and geometric stiffness on inner nodes.  Nodes next to a held
    node are not inner, with or without held components in the matrices.
    """
    structure = body.structure
    translations = np.tile(IN_PLANE[:, :2], (len(structure.nodes), 1))
    standstill = structure.stiffness - body.raw.rotor_speed**2 * per_squared_speed
    most = np.abs(standstill).sum(axis=1).A1
    moved = (np.abs(standstill @ translations).max(axis=1) > 1e-6 * most).reshape(-1, 3).any(axis=1)
    inner = np.repeat(~(moved | body.fixed(None).any(axis=1)), 3)
    inertia = inner[:, None] * (structure.mass @ translations)
    mass = float(np.square(inertia).sum())
    return -float((inertia * (per_squared_speed @ translations)).sum()) / mass if mass else 1.0


def basis_from_modes(
    body: PreparedBody, d: int, basis: ModalBasis, shapes: NDArray, omega2: NDArray, moved: NDArray,
) -> ModalBasis:  # fmt: skip
    """Add data over rotor speed to a basis of a nodal diameter d.

    Parameters
    ----------
    shapes : (3 n_nodes, n_modes)
        Mass-normalised modes of the basis, NaN at nodes without values.
    omega2, moved : (n_modes,), (3 n_nodes, n_modes)
        Squared natural frequencies (rad2/s2) and mass-normalised modes at the higher speed.

    Raises
    ------
    ModelError
        If the modes of the higher speed are not combinations of the modes of the basis.
    """
    assert body.raw.faster is not None
    first, omega = body.raw.rotor_speed, body.raw.faster.rotor_speed
    item = f"modes of nodal diameter {d} at {omega:g} rad/s"
    body.require(
        moved.shape[1] == basis.n_modes,
        item,
        f"{basis.n_modes} modes as at {first:g} rad/s",
        moved.shape[1],
    )
    known = ~(np.isnan(shapes).any(axis=1) | np.isnan(moved).any(axis=1))
    overlap = np.linalg.lstsq(shapes[known], moved[known], rcond=None)[0]
    sizes = svdvals(overlap)
    expected = f"combinations of the modes at {first:g} rad/s (singular values of the overlap within 1 % of 1)"
    overlaps = f"{sizes[-1]:.4g} to {sizes[0]:.4g}; use fewer modes, or speeds nearer together"
    body.require(np.abs(sizes - 1.0).max() <= BOUNDS.agreement, item, expected, overlaps)
    turning = polar(overlap)[0]
    stiffness2 = ((turning * omega2) @ turning.conj().T - np.diag(basis.omega2)) / (
        omega**2 - first**2
    )
    body.passed(
        f"{body.name}, nodal diameter {d}: overlap of modes over speed at least {sizes[-1]:.5g}"
    )
    return basis.with_speed(
        0.5 * (stiffness2 + stiffness2.conj().T), omega_ref=first, source=body.raw.source
    )


# ---- Bodies from modes ----


NO_RECEPTANCE = (
    "static receptances of the {} (no matrices): contact stiffness cannot be derived; give it as numbers "
    "(ContactFaces(stiffness=...), or Study(contact_stiffness=...))"
)


def _pictures(body: PreparedBody, d: int, shapes: NDArray) -> dict[int, NDArray]:
    """Return the first shapes (n_nodes, 3, n) of (3 n_nodes, n_modes) by nodal diameter, if elements can show them."""
    pictured = shapes.reshape(-1, 3, shapes.shape[1])[..., :PICTURED_MODES].copy()
    return {d: pictured} if body.elements and np.isfinite(pictured[body.used]).all() else {}


def _waves(body: PreparedBody, modes: Modes, ring: Ring) -> Waves:
    """Return travelling waves of one nodal diameter on all nodes, NaN at nodes without values."""
    d = modes.nodal_diameter
    item = f"modes of nodal diameter {d} ({modes.source or 'given'})"
    shapes = body.shapes(np.asarray(modes.numbers), np.asarray(modes.shapes), item)
    if ring.faces.n_sectors == 1:
        waves = Waves(np.arange(shapes.shape[1]), shapes.real, np.zeros(shapes.shape[1]), 0, 0)
    else:
        known = ~np.isnan(shapes[:, 0].real).reshape(-1, 3).any(axis=1)
        faces = ring.faces.among(known)
        body.require(
            len(faces.dependent), item, "values at matching nodes of the two sector faces", "none"
        )
        with body.refusing(item, "travelling waves"):
            waves = travelling_waves(
                np.asarray(modes.frequency, float), np.nan_to_num(shapes), faces, d
            )
        waves = replace(waves, shapes=np.where(np.repeat(known, 3)[:, None], waves.shapes, np.nan))
    text = f"{body.name}, nodal diameter {d}: {len(waves.index)} modes are waves of it within {waves.mismatch.max():.1g}"
    if waves.turned:
        text += f"; {waves.turned} of them travelled the other way and were reversed"
    if waves.combined:
        text += f"; {waves.combined} were combined from pairs of real shapes"
    body.passed(text)
    return waves


def compare_known(body: PreparedBody, d: int, omega2: NDArray, ring: Ring) -> None:
    """Compare modes at a nodal diameter d with expected frequencies and with the modes of a file.

    The squared natural frequencies ``omega2`` (n_modes,) are in rad2/s2.
    """
    computed, item = (
        np.sqrt(np.maximum(omega2, 0.0)) / (2.0 * np.pi),
        f"{body.name}, nodal diameter {d}",
    )
    known = (
        [(np.asarray(ring.expected[d], float), "expected_frequencies")]
        if d in ring.expected
        else []
    )
    for modes in body.raw.modes if body.has_matrices else ():
        if modes.nodal_diameter == d:
            with body.report.comparison():
                index = _waves(body, modes, ring).index
                known.append(
                    (np.asarray(modes.frequency, float)[index], modes.source or "the modes")
                )
    for expected, source in known:
        with body.report.comparison():
            error = compare_frequencies(computed, expected, item, source)
            body.passed(f"{item}: frequencies agree with {source} to {100 * error:.2g} %")


def check_reached(body: PreparedBody, wanted: Wanted, absent: NDArray, content: str) -> None:
    """Raise ModelError if a contact face or location includes nodes (n,) that lack ``content``."""
    parts = {"contact faces": wanted.contact.indices // 3}
    parts |= {
        f"location '{name}'": nodes_of(location) for name, location in wanted.locations.items()
    }
    for item, nodes in parts.items():
        wrong = body.raw.numbers[np.intersect1d(nodes, absent)]
        body.require(
            not len(wrong),
            item,
            f"nodes with {content}",
            f"none at {', '.join(map(str, wrong[:5]))}",
        )


def _normalised(body: PreparedBody, d: int, ring: Ring, n_modes: int) -> tuple[NDArray, NDArray]:
    """Return squared frequencies (n,) and mass-normalised shapes (3 n_nodes, n) of the lowest modes."""
    item, listed = (
        f"modes of nodal diameter {d}",
        [modes for modes in body.raw.modes if modes.nodal_diameter == d],
    )
    known = [modes.nodal_diameter for modes in body.raw.modes]
    body.require(
        len(listed) == 1, "modes", f"modes of nodal diameter {d} once", f"modes of {known}"
    )
    modes, waves = listed[0], _waves(body, listed[0], ring)
    expected = "modal masses (or matrices) to rescale the modes to unit modal mass over one sector"
    body.require(modes.modal_mass is not None, item, expected, "neither")
    mass = body.placement.units.mass * np.asarray(modes.modal_mass, float)[waves.index]
    frequency = np.asarray(modes.frequency, float)[waves.index]
    body.require(
        (frequency > 0.0).all(),
        item,
        "frequencies > 0 of a held sector",
        frequency.min(initial=np.inf),
    )
    order = np.argsort(frequency, kind="stable")[:n_modes]
    shapes = fix_phase(
        (waves.shapes / np.sqrt(mass))[:, order], sp.identity(len(waves.shapes), format="csr")
    )
    return (2.0 * np.pi * frequency[order]) ** 2, shapes


def constrained_from_modes(
    body: PreparedBody, wanted: Wanted, ring: Ring
) -> tuple[Body, dict[int, NDArray]]:
    """Make a sector from its modes at each nodal diameter.

    Returns
    -------
    body : Body
    pictures : dict of nodal diameter to (n_nodes, 3, n)
        First mode shapes, for pictures.

    Raises
    ------
    ModelError
        If modes of a nodal diameter are missing, are not travelling waves, or have no modal mass.
    """
    bases, pictures, faster = {}, dict[int, NDArray](), body.faster
    for d in ring.diameters:
        omega2, shapes = _normalised(body, d, ring, wanted.n_modes)
        compare_known(body, d, omega2, ring)
        unknown = np.isnan(shapes).reshape(len(body.nodes), -1).any(axis=1)
        check_reached(body, wanted, np.flatnonzero(unknown), "values of the modes")
        if d in ring.pictured:
            pictures |= _pictures(body, d, shapes)
        bases[d] = wanted.basis(omega2, shapes)
        if faster is not None:
            moved = _normalised(faster, d, ring, len(omega2))
            bases[d] = basis_from_modes(body, d, bases[d], shapes, *moved)
    body.passed(f"{body.name}: modes rescaled, modal mass from the file or the user (not checked)")
    body.report.missing.append(NO_RECEPTANCE.format(body.name))
    return Body(body.name, "constrained", wanted.ports, bases), pictures


def free_from_modes(body: PreparedBody, wanted: Wanted) -> Body:
    """Make a rigid free body from mass, centre of mass and inertia.

    Raises
    ------
    ModelError
        If the mass properties are missing or unphysical.
    """
    rigid, units, q = body.raw.rigid, body.placement.units, body.placement.rotation
    if rigid is None:
        raise body.error(
            "free body", "matrices, or mass, centre and inertia (MassProperties)", "neither"
        )
    item, expected = "mass properties", "a mass > 0, a centre (3,) and an inertia (3, 3)"
    with body.refusing(item, expected):
        mass = units.mass * float(rigid.mass)
        centre = units.length * q @ (np.reshape(rigid.centre, 3) - body.placement.origin)
        inertia = units.mass * units.length**2 * q @ rigid.inertia @ q.T
        moments, principal = np.linalg.eigh(inertia)
    expected += " with principal moments > 0, none larger than the sum of the others"
    solid = moments[0] > 0 and moments[2] <= (moments[0] + moments[1]) * (1 + 1e-6)
    good = mass > 0 and solid and np.isfinite(centre).all()
    body.require(good, item, expected, f"{mass} kg, {moments} kg m2")
    axes = body.damper_axes(centre)
    shapes = rigid_motions(body.nodes, centre, axes, principal.T) / np.sqrt([*3 * [mass], *moments])
    basis = wanted.basis(np.zeros(6), shapes)
    body.report.missing += [
        NO_RECEPTANCE.format(body.name),
        f"elastic deformation of the {body.name} (no matrices)",
    ]
    load = BodyLoad(
        axes[1], np.eye(6)[1] / np.sqrt(mass), np.zeros((wanted.contact.shape[0] // 3, 3))
    )
    return Body(
        body.name,
        "free",
        wanted.ports,
        {0: basis},
        mass=mass,
        centre=centre,
        inertia=inertia,
        load=load,
    )


# ---- Bodies from matrices ----


def held_components(
    body: PreparedBody, wanted: Wanted, fixed: NodeSet | None, ring: Ring
) -> NDArray:
    """Return the mask (n_nodes, 3) of fixed components.

    Images of fixed nodes on the other sector face are included.  Other programs fix one face only, since their cyclic
    constraint holds the other.

    Raises
    ------
    ModelError
        If a contact face or location has no rows in the matrices.
    """
    held = None if fixed is None else body.node_set(fixed, "fixed")
    without = np.flatnonzero(body.fixed(None).all(axis=1))
    check_reached(
        body,
        wanted,
        without if held is None else np.setdiff1d(without, held),
        "rows in the matrices",
    )
    mask = body.fixed(held)
    out = np.stack([ring.faces.images(component) for component in mask.T], axis=1)
    if added := int((out & ~mask).any(axis=1).sum()):
        body.passed(
            f"{body.name}: {added} nodes of a sector face held as images of held nodes of the other face"
        )
    return out


def cyclic_sectors(body: PreparedBody, ring: Ring, mask: NDArray, kept: Collection[int]) -> Sectors:
    """Return the sector from matrices as a function of the nodal diameter.

    Sectors of the nodal diameters ``kept`` are cached, with their modes.
    """
    made: dict[int, CyclicSector] = {}

    def sector(d: int) -> CyclicSector:
        if d in made:
            return made[d]
        body.report.step(f"nodal diameter {d}")
        for other in made.values():
            other.forget_factors()
        with body.refusing(
            f"nodal diameter {d}", "a sector whose fixed components both sector faces can have"
        ):
            out = CyclicSector(body.structure, ring.faces, mask, d)
        if d == 0 or ring.faces.n_sectors == 1:  # the frequencies show it at other nodal diameters
            _check_held(body, out, bool(mask.any()))
        if d in kept:
            made[d] = out
        return out

    return sector


def constrained_from_matrices(
    body: PreparedBody, wanted: Wanted, ring: Ring, sector: Sector, sizes: LocalSizes,
    interfaces: Mapping[str, Interface], stress: Iterable[StressRows],
) -> tuple[Body, dict[int, NDArray]]:  # fmt: skip
    """Make a sector from its matrices at each nodal diameter, with a local basis if the sector names its blade.

    The stress of each mode and static shape is added to the objects ``stress``.

    Returns
    -------
    body : Body
    pictures : dict of nodal diameter to (n_nodes, 3, n)
        First mode shapes, for pictures.

    Raises
    ------
    ModelError
        If the sector is not fixed, or a matrix is not positive definite.
    """
    mask, part = held_components(body, wanted, sector.fixed, ring), None
    if sector.blade_nodes is not None:
        part = blade_part(body, wanted, ring, mask, sector.blade_nodes, interfaces)
    cached = [0] if body.raw.faster else []  # for the displacement by rotation
    cached += [] if part is None else sampled_waves(ring.faces.n_sectors)
    at_diameter = cyclic_sectors(body, ring, mask, cached)
    free, pictures = int((~mask).sum()), dict[int, NDArray]()
    n_modes = min(wanted.n_modes, max(1, (free - 3 * len(ring.faces.dependent)) // 2))

    def seen(made: CyclicSector, omega2: NDArray, shapes: NDArray) -> None:
        d = made.nodal_diameter
        compare_known(body, d, made.modes(n_modes)[0], ring)
        if d in ring.pictured:
            pictures.update(_pictures(body, d, made.modes(n_modes)[1]))
        for rows in stress:
            rows.add(made, wanted.contact, omega2, shapes)

    expected = "a positive definite stiffness (fixed nodes?) and a positive definite mass matrix"
    with body.refusing("matrices", expected):
        fewer = replace(wanted, n_modes=n_modes)
        built = constrained_body(
            body.name, fewer, at_diameter, ring.diameters, rotation_of(body), seen
        )
    for (
        d,
        basis,
    ) in (
        built.bases.items()
    ):  # six squared frequencies of a body that is not held are rounding errors
        low, high = basis.omega2[[0, -1]]
        expected, found = (
            "a sector that is held (fixed nodes)",
            f"squared frequencies {low:.3g} to {high:.3g} rad2/s2",
        )
        body.require(low > max(1e-10 * high, 0.0), f"nodal diameter {d}", expected, found)
    body.passed("stiffness symmetric and positive definite at every nodal diameter, mass symmetric")
    if n_modes < wanted.n_modes:
        body.passed(
            f"{n_modes} modes instead of {wanted.n_modes}: the matrices have too few rows for more"
        )
    if part is not None:
        built = with_local_basis(built, body, wanted, at_diameter, interfaces, part, sizes)
    return built, pictures


def _check_held(body: PreparedBody, sector: CyclicSector, held: bool) -> None:
    """Raise ModelError if the factorisation shows an indefinite stiffness or a body that is not fixed."""
    item = f"stiffness matrix, nodal diameter {sector.nodal_diameter}"
    factor = sector.solver
    pivots = factor.U.diagonal().real
    least = (
        1e-13 * np.median(np.abs(sector.stiffness.diagonal()))
        if held
        else 1e-9 * np.median(np.abs(pivots))
    )
    expected = "a body that is held: Sector(fixed=a set of nodes), or components without rows in the matrices"
    found = f"{'fixed components' if held else 'neither'}, and a motion without force"
    body.require(np.abs(pivots).min() >= least, item, expected, found)
    negative = int((pivots <= 0.0).sum()) if np.array_equal(factor.perm_r, factor.perm_c) else 0
    body.require(
        not negative, item, "a positive definite matrix", f"{negative} negative eigenvalues"
    )


def free_from_matrices(body: PreparedBody, wanted: Wanted) -> Body:
    """Make a damper from its matrices, with the centrifugal load of its mass.

    Raises
    ------
    ModelError
        If the stiffness fixes the body somewhere, or it has motions without force other than the six rigid ones.
    """
    wrong = body.raw.numbers[body.fixed(None).any(axis=1)]
    found = f"rows missing at {len(wrong)} nodes, such as node {', '.join(map(str, wrong[:1]))}"
    body.require(
        not len(wrong),
        "matrices",
        "rows for all three components of every node of a free body",
        found,
    )
    body.report.step(body.name)
    structure = body.structure
    check_rigid_motion(body)
    with body.refusing("mass matrix", "a positive definite matrix"):
        free = FreeBody(structure, np.eye(3))
    axes = body.damper_axes(free.centre)
    free = FreeBody(structure, axes)
    wanted = replace(wanted, n_modes=min(wanted.n_modes, max(6, structure.n_dof // 2)))
    with body.refusing("matrices", "a stiffness matrix with six rigid-body motions and no others"):
        built = free_body(body.name, wanted, free, axes[1])
    omega2 = built.bases[0].omega2
    found = f"omega2 = {omega2[6:].min(initial=np.inf):.3g}"
    body.require(
        (omega2[6:] > 0.0).all(), "stiffness matrix", "six rigid-body motions and no others", found
    )
    body.passed(f"{body.name}: six rigid-body motions without force")
    return built


# ---- Local basis for mistuned bladed disks ----


def blade_part(
    body: PreparedBody, wanted: Wanted, ring: Ring, fixed: NDArray, blade: NodeSet,
    interfaces: Mapping[str, Interface],
) -> BladePart:  # fmt: skip
    """Return the blade within a sector, for mistuned bladed disks.

    Parameters
    ----------
    fixed : (n_nodes, 3) bool
        Fixed components.
    blade : NodeSet
        Nodes of the blade, including the nodes shared with the disk.

    Raises
    ------
    ModelError, SettingError
        If there is no cyclic sector with matrices, blades touch each other, or the set lacks contact points or locations.
    """
    if ring.faces.n_sectors == 1:
        raise SettingError(
            "blade_nodes: expected a sector of a cyclic structure, found an acyclic structure"
        )
    touching = [
        name for name, face in interfaces.items() if face.body_a == face.body_b == body.name
    ]
    if touching:
        raise SettingError(
            f"blade_nodes: expected blades that touch dampers, found '{touching[0]}', where blades touch"
        )
    nodes = body.node_set(blade, "blade_nodes")
    with body.refusing(
        "blade_nodes",
        "the nodes of a blade from root to tip, with all its contact faces and locations",
    ):
        part = BladePart(body.structure, nodes, fixed, step=body.report.step)
        part.check_wanted(wanted, ring.faces)
    return part


def with_local_basis(
    made: Body, body: PreparedBody, wanted: Wanted, sector: Sectors,
    interfaces: Mapping[str, Interface], part: BladePart, sizes: LocalSizes,
) -> Body:  # fmt: skip
    """Return the sector ``made`` with a local basis, for mistuned bladed disks.

    Raises
    ------
    ModelError
        If the matrices of the blade clamped at its root are not positive definite.
    """
    with body.refusing("blade_nodes", "a blade that its root holds"):
        local = local_basis(
            part, sector, wanted, damper_motion(wanted.ports, interfaces), sizes, "set of nodes"
        )
    clamped = ", ".join(f"{f:.5g}" for f in np.sqrt(local.omega2[:3]) / (2.0 * np.pi))
    worst = max(
        np.sqrt(local.nodal_diameter(d).omega2[0] / basis.omega2[0]) - 1.0
        for d, basis in made.bases.items()
    )
    body.report.checks += [
        f"wheel: blade of {len(part.nodes)} nodes, {len(part.root)} of them at its root; clamped there {clamped} ... Hz; "
        f"{local.n_cantilever} such modes, {local.n_attachment} attachments, {local.n_interface} shapes of the root",
        f"wheel: the lowest frequency of each nodal diameter at most {100.0 * worst:.2g} % too high",
    ]
    return replace(made, local=local)
