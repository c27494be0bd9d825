r"""Bodies of an imported model from stiffness and mass matrices, with the checks that only the reduction can make.

Bodies of an imported model from modes, where the matrices are not known.

Modes are turned into waves toward +X and rescaled to unit modal mass by the modal masses of the file or the user.  Static
receptances do not follow from a few modes, so that contact stiffness must be given as numbers; a damper is rigid.

A sector at two rotor speeds: its matrices or its modes, as the data over speed of a model.

Matrices at two speeds give the stiffness per squared speed by a difference.  Where a program gives only modes, those of the
second speed are combinations of those of the first: with the polar factor A of their overlap, unitary,

.. math:: K(\Omega_1) = \omega_1^2, \qquad K(\Omega_2) = A\,\omega_2^2 A^H

on the modes of the first speed.  To pair modes by their order instead fails where frequencies veer.

The local basis of an imported sector, for mistuned wheels.

Stress sets of an imported blade, from its elements and the displacements of every vector that the model carries.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg
from numpy.typing import NDArray
from scipy.linalg import polar, svdvals

from bdamper.fem.contact_patches import Patches
from bdamper.fem.cyclic_symmetry import CyclicSector, Waves, travelling_waves
from bdamper.fem.local_basis import BladePart, LocalSizes, damper_motion, local_basis
from bdamper.fem.reduced_bodies import FreeBody, Wanted, constrained_body, free_body, nodes_of
from bdamper.fem.rotation import IN_PLANE, Rotation
from bdamper.importers.contact_faces import LaidContacts
from bdamper.importers.fe_body import BOUNDS, ElementKind, FEBody, Modes
from bdamper.importers.plausibility import check_rigid_motion, compare_frequencies
from bdamper.importers.prepared_body import NodeSet, PreparedBody, Ring
from bdamper.model.fields import check
from bdamper.model.modal_basis import fix_phase, rigid_motions
from bdamper.model.structure import Body, BodyLoad, Interface, ModalBasis, turn
from bdamper.util import validation
from bdamper.util.errors import SettingError, import_extra

if TYPE_CHECKING:
    from bdamper.fem.element_stress import Solids, StressRows


# ---- A sector at two rotor speeds ----


def over_speed(bodies: Mapping[float, FEBody]) -> FEBody:
    """One body from the same body at two rotor speeds (rad/s), with matrices or with modes of each.

    Parameters
    ----------
    bodies : mapping of rotor speed (rad/s) to FEBody
        ``{0.0: read_calculix("standstill"), 600.0: read_calculix("running")}``.  The modes of the model are those of the
        lower speed.

    Returns
    -------
    FEBody
        For :func:`bdamper.importers.build_model`.

    Raises
    ------
    SettingError, ModelError
        If there are not two speeds, or the bodies are not the same nodes with the same kind of data.
    """
    if not isinstance(bodies, Mapping) or len(bodies) != 2:
        raise validation.invalid("over_speed", "a mapping of two rotor speeds to FEBody", bodies)
    made = []
    for key, value in bodies.items():
        omega = validation.number("rotor speed", key, least=0.0, unit="rad/s")
        body = validation.instance(f"body at {omega:g} rad/s", value, FEBody)
        made.append(replace(body, rotor_speed=omega, faster=None))
    slower, faster = sorted(made, key=lambda body: body.rotor_speed)
    alike, item = np.array_equal(slower.numbers, faster.numbers), f"{faster.source} at {faster.rotor_speed:g} rad/s"
    check(alike, item, f"the nodes of {slower.source}", "other numbers")
    if (slower.stiffness is None) != (faster.stiffness is None):
        raise SettingError("over_speed: expected matrices at both speeds, or modes at both speeds, found one of each")
    return replace(slower, faster=faster)


def rotation_of(body: PreparedBody) -> Rotation | None:
    """How the stiffness of a body with matrices changes with speed; None where only one speed is given.

    Raises
    ------
    ModelError
        If the mass changes with speed.
    """
    if (other := body.faster) is None:
        return None
    first, last = body.given.rotor_speed, other.given.rotor_speed
    norm, mass = scipy.sparse.linalg.norm, body.structure.mass
    same = norm(other.structure.mass - mass) <= 1e-6 * norm(mass)
    body.require(same, f"mass matrix at {last:g} rad/s", "that of the other speed", "another")
    per_squared_speed = ((other.structure.stiffness - body.structure.stiffness) / (last**2 - first**2)).tocsr()
    softening = _spin_softening(body, per_squared_speed)
    if softening < 0.5:
        body.missing.append(
            f"spin softening of the {body.name}: the matrices at {last:g} rad/s take {100 * softening:.3g} % of its mass "
            "in the plane of rotation from the stiffness; frequencies of bending in this plane come out too high"
        )
    body.checks.append(f"{body.name}: stiffness at {first:g} and {last:g} rad/s, spin softening {100 * softening:.4g} %")
    return Rotation(per_squared_speed, first, last, body.given.source)


def _spin_softening(body: PreparedBody, per_squared_speed: NDArray) -> float:
    """Share of the mass in the plane of rotation that is missing from the stiffness, by a translation of inner nodes.

    A translation takes no force from elastic and geometric stiffness.
    """
    structure = body.structure
    held = np.repeat(body.fixed(None).any(axis=1), 3)
    inner = ~held & (np.abs(structure.stiffness) @ held.astype(float) == 0.0)
    translations = np.tile(IN_PLANE[:, :2], (len(structure.nodes), 1))
    inertia = inner[:, None] * (structure.mass @ translations)
    mass = float(np.square(inertia).sum())
    return -float((inertia * (per_squared_speed @ translations)).sum()) / mass if mass else 1.0


def basis_from_modes(
    body: PreparedBody, d: int, basis: ModalBasis, shapes: NDArray, omega2: NDArray, moved: NDArray
) -> ModalBasis:
    """A basis with its data over speed from modes at a higher speed.

    Parameters
    ----------
    body : PreparedBody
    d : int
        Nodal diameter.
    basis : ModalBasis
    shapes : (3 n_nodes, n_modes)
        Mass-normalised modes of the basis, NaN in unknown rows.
    omega2, moved : (n_modes,), (3 n_nodes, n_modes)
        Squared frequencies and mass-normalised modes at the higher speed.

    Raises
    ------
    ModelError
        If the modes of the higher speed are not combinations of those of the basis.
    """
    assert body.given.faster is not None
    first, omega = body.given.rotor_speed, body.given.faster.rotor_speed
    item = f"modes of nodal diameter {d} at {omega:g} rad/s"
    body.require(moved.shape[1] == basis.n_modes, item, f"{basis.n_modes} modes as at {first:g} rad/s", moved.shape[1])
    known = ~(np.isnan(shapes).any(axis=1) | np.isnan(moved).any(axis=1))
    overlap = np.linalg.lstsq(shapes[known], moved[known], rcond=None)[0]
    sizes = svdvals(overlap)
    expected = f"combinations of the modes at {first:g} rad/s (singular values of the overlap within 1 % of 1)"
    overlaps = f"{sizes[-1]:.4g} to {sizes[0]:.4g}; use fewer modes, or speeds nearer together"
    body.require(np.abs(sizes - 1.0).max() <= BOUNDS.agreement, item, expected, overlaps)
    turning = polar(overlap)[0]
    stiffness2 = ((turning * omega2) @ turning.conj().T - np.diag(basis.omega2)) / (omega**2 - first**2)
    body.checks.append(f"{body.name}, nodal diameter {d}: overlap of modes over speed at least {sizes[-1]:.5g}")
    return basis.with_speed(0.5 * (stiffness2 + stiffness2.conj().T), omega_ref=first, source=body.given.source)


# ---- Bodies of an imported model from modes, where the matrices are not known ----


NO_RECEPTANCE = (
    "static receptances of the {} (no matrices): contact stiffness cannot be derived; give it as numbers "
    "(ContactFaces(stiffness=...), or Study(contact_stiffness=...))"
)


def _waves(body: PreparedBody, modes: Modes, ring: Ring) -> Waves:
    """Waves of one nodal diameter on all nodes of the body, NaN at nodes without values; noted among the checks."""
    d = modes.nodal_diameter
    item = f"modes of nodal diameter {d} ({modes.source or 'given'})"
    shapes = body.shapes(np.asarray(modes.numbers), np.asarray(modes.shapes), item)
    if ring.faces.n_sectors == 1:
        waves = Waves(np.arange(shapes.shape[1]), shapes.real, np.zeros(shapes.shape[1]), 0, 0)
    else:
        known = ~np.isnan(shapes[:, 0].real).reshape(-1, 3).any(axis=1)
        faces = ring.faces.among(known)
        body.require(len(faces.dependent), item, "values at matching nodes of the two sector faces", "none")
        with body.refusing(item, "travelling waves"):
            waves = travelling_waves(np.asarray(modes.frequency, float), np.nan_to_num(shapes), faces, d)
        waves = replace(waves, shapes=np.where(np.repeat(known, 3)[:, None], waves.shapes, np.nan))
    text = f"{body.name}, nodal diameter {d}: {len(waves.index)} modes are waves of it within {waves.mismatch.max():.1g}"
    if waves.turned:
        text += f"; {waves.turned} of them went the other way and were turned"
    if waves.combined:
        text += f"; {waves.combined} were made of pairs of real shapes"
    body.checks.append(text)
    return waves


def compare_known(body: PreparedBody, d: int, omega2: NDArray, ring: Ring) -> None:
    """Compare modes at a nodal diameter with what is known of them.

    With frequencies that the user expects; with modes of a file beside the matrices, and whether these are waves.
    """
    found, item = np.sqrt(np.maximum(omega2, 0.0)) / (2.0 * np.pi), f"{body.name}, nodal diameter {d}"
    known = [(np.asarray(body.expected[d], float), "expected_frequencies")] if d in body.expected else []
    for modes in body.given.modes if body.has_matrices else ():
        if modes.nodal_diameter == d:
            with body.compared():
                index = _waves(body, modes, ring).index
                known.append((np.asarray(modes.frequency, float)[index], modes.source or "the modes"))
    for expected, source in known:
        with body.compared():
            error = compare_frequencies(found, expected, item, source)
            body.checks.append(f"{item}: frequencies agree with {source} to {100 * error:.2g} %")


def check_reached(body: PreparedBody, wanted: Wanted, absent: NDArray, what: str) -> None:
    """Refuse contact faces and locations at nodes (n,) for which something is absent."""
    places = {"contact faces": wanted.contact.indices // 3}
    places |= {f"location '{name}'": nodes_of(place) for name, place in wanted.locations.items()}
    for item, nodes in places.items():
        wrong = body.given.numbers[np.intersect1d(nodes, absent)]
        body.require(not len(wrong), item, f"nodes with {what}", f"none at {', '.join(map(str, wrong[:5]))}")


def _normalised(body: PreparedBody, d: int, ring: Ring, n_modes: int) -> tuple[NDArray, NDArray]:
    """Lowest modes of a nodal diameter: squared frequencies (n,) and mass-normalised shapes (3 n_nodes, n)."""
    item, given = f"modes of nodal diameter {d}", [modes for modes in body.given.modes if modes.nodal_diameter == d]
    known = [modes.nodal_diameter for modes in body.given.modes]
    body.require(len(given) == 1, "modes", f"modes of nodal diameter {d} once", f"those of {known}")
    modes, waves = given[0], _waves(body, given[0], ring)
    expected = "modal masses (or matrices) to rescale the modes to unit modal mass over one sector"
    body.require(modes.modal_mass is not None, item, expected, "neither")
    mass = body.place.units.mass * np.asarray(modes.modal_mass, float)[waves.index]
    frequency = np.asarray(modes.frequency, float)[waves.index]
    body.require((frequency > 0.0).all(), item, "frequencies > 0 of a held sector", frequency.min(initial=np.inf))
    order = np.argsort(frequency, kind="stable")[:n_modes]
    shapes = fix_phase((waves.shapes / np.sqrt(mass))[:, order], sp.identity(len(waves.shapes), format="csr"))
    return (2.0 * np.pi * frequency[order]) ** 2, shapes


def constrained_from_modes(body: PreparedBody, wanted: Wanted, ring: Ring) -> Body:
    """A sector from its modes at each nodal diameter.

    Raises
    ------
    ModelError
        If modes of a nodal diameter are missing, are no waves of it, or cannot be rescaled.
    """
    bases, faster = {}, body.faster
    for d in ring.diameters:
        omega2, shapes = _normalised(body, d, ring, wanted.n_modes)
        compare_known(body, d, omega2, ring)
        unknown = np.isnan(shapes).reshape(len(body.nodes), -1).any(axis=1)
        check_reached(body, wanted, np.flatnonzero(unknown), "values of the modes")
        if d in ring.pictured:
            body.keep_pictures(d, shapes)
        bases[d] = wanted.basis(omega2, shapes)
        if faster is not None:
            bases[d] = basis_from_modes(body, d, bases[d], shapes, *_normalised(faster, d, ring, len(omega2)))
    body.checks.append(f"{body.name}: modes rescaled, modal mass from the file or the user (not checked)")
    body.missing.append(NO_RECEPTANCE.format(body.name))
    return Body(body.name, "constrained", wanted.ports, bases)


def free_from_modes(body: PreparedBody, wanted: Wanted) -> Body:
    """A rigid damper from mass, centre and inertia.

    Raises
    ------
    ModelError
        If the mass properties are missing or unphysical.
    """
    given, units, q = body.given.rigid, body.place.units, body.place.rotation
    if given is None:
        raise body.error("free body", "matrices, or mass, centre and inertia (MassProperties)", "neither")
    item, expected = "mass properties", "a mass > 0, a centre (3,) and an inertia (3, 3)"
    with body.refusing(item, expected):
        mass = units.mass * float(given.mass)
        centre = units.length * q @ (np.reshape(given.centre, 3) - body.place.origin)
        inertia = units.mass * units.length**2 * q @ given.inertia @ q.T
        moments, principal = np.linalg.eigh(inertia)
    expected += " with principal moments > 0, none larger than the sum of the others"
    solid = moments[0] > 0 and moments[2] <= (moments[0] + moments[1]) * (1 + 1e-6)
    good = mass > 0 and solid and np.isfinite(centre).all()
    body.require(good, item, expected, f"{mass} kg, {moments} kg m2")
    axes = body.damper_axes(centre)
    shapes = rigid_motions(body.nodes, centre, axes, principal.T) / np.sqrt([*3 * [mass], *moments])
    basis = wanted.basis(np.zeros(6), shapes)
    body.missing += [NO_RECEPTANCE.format(body.name), f"elastic deformation of the {body.name} (no matrices)"]
    load = BodyLoad(axes[1], np.eye(6)[1] / np.sqrt(mass), np.zeros((wanted.contact.shape[0] // 3, 3)))
    return Body(body.name, "free", wanted.ports, {0: basis}, mass=mass, centre=centre, inertia=inertia, load=load)


# ---- Bodies of an imported model from stiffness and mass matrices, with the checks that only th ----


def held_components(body: PreparedBody, wanted: Wanted, fixed: NodeSet | None, ring: Ring) -> NDArray:
    """Mask (n_nodes, 3) of the components that are held, those at images of held nodes on the other sector face included.

    Other programs want only one face held: their tie of the faces holds the other.

    Raises
    ------
    ModelError
        If a contact face or location has no rows in the matrices.
    """
    held = None if fixed is None else body.node_set(fixed, "fixed")
    without = np.flatnonzero(body.fixed(None).all(axis=1))
    check_reached(body, wanted, without if held is None else np.setdiff1d(without, held), "rows in the matrices")
    mask = body.fixed(held)
    out = np.stack([ring.faces.images(component) for component in mask.T], axis=1)
    if added := int((out & ~mask).any(axis=1).sum()):
        body.checks.append(f"{body.name}: {added} nodes of a sector face held as images of held nodes of the other one")
    return out


def cyclic_sectors(
    body: PreparedBody, ring: Ring, mask: NDArray, kept: Collection[int] = ()
) -> Callable[[int], CyclicSector]:
    """The sector from matrices as a function of the nodal diameter; modes of those in ``kept`` are kept."""
    made: dict[int, CyclicSector] = {}

    def sector(d: int) -> CyclicSector:
        if d in made:
            return made[d]
        body.step(f"nodal diameter {d}")
        for other in made.values():
            other.forget_factors()
        with body.refusing(f"nodal diameter {d}", "a sector whose fixed components both sector faces can have"):
            out = CyclicSector(body.structure, ring.faces, mask, d)
        if d == 0 or ring.faces.n_sectors == 1:  # elsewhere the frequencies tell
            _check_held(body, out, bool(mask.any()))
        if d in kept:
            made[d] = out
        return out

    return sector


def constrained_from_matrices(
    body: PreparedBody, wanted: Wanted, ring: Ring, sector: Callable[[int], CyclicSector], mask: NDArray,
    stress: Iterable[StressRows] = (),
) -> Body:  # fmt: skip
    """A sector from its matrices at each nodal diameter; ``stress`` collects that of its vectors.

    Raises
    ------
    ModelError
        If the sector is not held, or a matrix is not positive definite.
    """
    free = int((~mask).sum())
    n_modes = min(wanted.n_modes, max(1, (free - 3 * len(ring.faces.dependent)) // 2))

    def seen(made: CyclicSector, omega2: NDArray, shapes: NDArray) -> None:
        d = made.nodal_diameter
        compare_known(body, d, made.modes(n_modes)[0], ring)
        if d in ring.pictured:
            body.keep_pictures(d, made.modes(n_modes)[1])
        for rows in stress:
            rows.add(made, wanted.contact, omega2, shapes)

    expected = "a positive definite stiffness (fixed nodes?) and a positive definite mass matrix"
    with body.refusing("matrices", expected):
        fewer = replace(wanted, n_modes=n_modes)
        built = constrained_body(body.name, fewer, sector, ring.diameters, rotation_of(body), seen)
    for d, basis in built.bases.items():  # a body that is not held has six squared frequencies that are rounding
        low, high = basis.omega2[[0, -1]]
        expected, found = "a sector that is held (fixed nodes)", f"squared frequencies {low:.3g} to {high:.3g} rad2/s2"
        body.require(low > max(1e-10 * high, 0.0), f"nodal diameter {d}", expected, found)
    body.checks.append("stiffness symmetric and positive definite at every nodal diameter, mass symmetric")
    if n_modes < wanted.n_modes:
        body.checks.append(f"{n_modes} modes instead of {wanted.n_modes}: the matrices have too few rows for more")
    return built


def _check_held(body: PreparedBody, sector: CyclicSector, held: bool) -> None:
    """The pivots of the factorisation show a stiffness that is indefinite, or a body that is not held."""
    item = f"stiffness matrix, nodal diameter {sector.nodal_diameter}"
    factor = sector.solver
    pivots = factor.U.diagonal().real
    least = 1e-13 * np.median(np.abs(sector.stiffness.diagonal())) if held else 1e-9 * np.median(np.abs(pivots))
    expected = "a body that is held: fixed=(a set of nodes), or components without rows in the matrices"
    found = f"{'fixed components' if held else 'neither'}, and still some motion costs no force"
    body.require(np.abs(pivots).min() >= least, item, expected, found)
    negative = int((pivots <= 0.0).sum()) if np.array_equal(factor.perm_r, factor.perm_c) else 0
    body.require(not negative, item, "a positive definite matrix", f"{negative} negative eigenvalues")


def free_from_matrices(body: PreparedBody, wanted: Wanted) -> Body:
    """A damper from its matrices, under the centrifugal load of its own mass.

    Raises
    ------
    ModelError
        If the matrices hold the body somewhere, or it has other motions without force than the six rigid ones.
    """
    wrong = body.given.numbers[body.fixed(None).any(axis=1)]
    found = f"some missing at node {', '.join(map(str, wrong[:1]))} and {len(wrong)} such in all"
    body.require(not len(wrong), "matrices", "rows for all three components of every node of a free body", found)
    body.step(body.name)
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
    body.require((omega2[6:] > 0.0).all(), "stiffness matrix", "six rigid-body motions and no others", found)
    body.checks.append(f"{body.name}: six rigid-body motions without force")
    return built


# ---- The local basis of an imported sector, for mistuned wheels ----


def blade_part(
    body: PreparedBody, wanted: Wanted, ring: Ring, fixed: NDArray, blade: NodeSet,
    interfaces: Mapping[str, Interface],
) -> BladePart:  # fmt: skip
    """The blade within a sector.

    Parameters
    ----------
    body, wanted, ring, fixed
        As in :func:`bdamper.importers.bodies.constrained_from_matrices`.
    blade : NodeSet
        Its nodes, those included at which it meets the disk.
    interfaces : mapping of name to Interface

    Raises
    ------
    ModelError, SettingError
        If there are no matrices or no sectors, or the set is not a blade with all contact points and locations on it.
    """
    if ring.faces.n_sectors == 1:
        raise SettingError("wheel: expected a sector of a cyclic structure with its matrices, found an acyclic structure")
    touching = [name for name, face in interfaces.items() if face.body_a == face.body_b == body.name]
    if touching:
        raise SettingError(f"wheel: expected blades that touch dampers, found '{touching[0]}', where they touch each other")
    nodes = body.node_set(blade, "wheel")
    with body.refusing("wheel", "the nodes of a blade from root to tip, with all its contact faces and locations"):
        part = BladePart(body.structure, nodes, fixed, step=body.step)
        part.check_wanted(wanted, ring.faces)
    return part


def with_local_basis(
    made: Body, body: PreparedBody, wanted: Wanted, sector: Callable[[int], CyclicSector],
    interfaces: Mapping[str, Interface], part: BladePart, sizes: LocalSizes,
) -> Body:  # fmt: skip
    """The sector ``made`` with a local basis from its matrices.

    Raises
    ------
    ModelError
        If the matrices of the blade clamped at its root are not positive definite.
    """
    with body.refusing("wheel", "a blade that its root holds"):
        local = local_basis(part, sector, wanted, damper_motion(wanted.ports, interfaces), sizes, "set of nodes")
    clamped = ", ".join(f"{f:.5g}" for f in np.sqrt(local.omega2[:3]) / (2.0 * np.pi))
    worst = max(np.sqrt(local.nodal_diameter(d).omega2[0] / basis.omega2[0]) - 1.0 for d, basis in made.bases.items())
    body.checks += [
        f"wheel: blade of {len(part.nodes)} nodes, {len(part.root)} of them at its root; clamped there {clamped} ... Hz; "
        f"{local.n_cantilever} such modes, {local.n_attachment} attachments, {local.n_interface} shapes of the root",
        f"wheel: the lowest frequency of each nodal diameter at most {100.0 * worst:.2g} % too high",
    ]
    return replace(made, local=local)


# ---- Stress sets of an imported blade, from its elements and the displacements of every vector  ----


def stress_rows(
    body: PreparedBody, given: NodeSet | Mapping[str, NodeSet] | None, elasticity: Sequence[float] | None,
    laid: LaidContacts, ring: Ring,
) -> list[StressRows]:  # fmt: skip
    """Rows that recover the stress at sets of nodes of a blade.

    Parameters
    ----------
    body : PreparedBody
    given : str, node numbers, or mapping of name to either, optional
        A name alone is that of the node set and of the stress set.
    elasticity : (Young's modulus, Poisson's ratio), optional
        In the units of the file, for elements whose file has none.
    laid : LaidContacts
    ring : Ring

    Raises
    ------
    ModelError, SettingError
        If a set does not exist, or an element at its nodes has no elastic constants.
    BdamperError
        Without scikit-fem.
    """
    if given is None:
        return []
    import_extra("skfem", "stress of an import", "fe")
    from bdamper.fem.element_stress import StressRows, near_patches

    validation.check(
        body.has_matrices, "stress", "a blade with its matrices", "modes alone; give StressSet arrays instead"
    )
    sets = given if isinstance(given, Mapping) else {given if isinstance(given, str) else "stress": given}
    faces = [
        Patches(face.points @ back.T, face.frame @ back.T, np.sqrt(face.area)[:, None] * [1.0, 1.0])
        for face, side in ((laid.interfaces[name], side) for name, side in laid.ports[body.name])
        for back in [turn(-2.0 * np.pi / ring.faces.n_sectors * (face.sector_a if side == "a" else face.sector_b))]
    ]
    out = []
    for name, members in sets.items():
        item = f"stress '{name}'"
        nodes = _away_from_cuts(body, body.node_set(members, item), ring, item)
        solids = _solids(body, nodes, elasticity, item)
        near = near_patches(body.nodes[nodes], *faces) | np.isin(nodes, laid.rows[body.name].indices // 3)
        with body.refusing(item, "elements with volume and all nodes between corners"):
            out.append(StressRows(name, solids, body.nodes, nodes, near))
        body.checks.append(f"{item}: {len(nodes)} nodes, {int(near.sum())} of them next to a contact face")
    return out


def _away_from_cuts(body: PreparedBody, nodes: NDArray, ring: Ring, item: str) -> NDArray:
    """The nodes that have all their elements in the sector."""
    kept = nodes[~np.isin(nodes, ring.faces.nodes)]
    body.require(len(kept) > 0, item, "nodes away from the faces at which the sector repeats", "none")
    if len(kept) < len(nodes):
        body.missing.append(f"{item}: {len(nodes) - len(kept)} nodes on the sector faces are left out")
    loose = np.setdiff1d(kept, body.used if body.elements else np.empty(0, int))
    if len(loose):
        raise body.error(item, "nodes of solid elements", f"node {body.given.numbers[loose[0]]} without any")
    return kept


def _solids(body: PreparedBody, nodes: NDArray, elasticity: Sequence[float] | None, item: str) -> tuple[Solids, ...]:
    """The elements at nodes, with their elastic constants in SI units."""
    from bdamper.fem.element_stress import Solids

    constants = None if elasticity is None else validation.numbers("elasticity", elasticity, 2)
    kinds = body.given.element_kinds or tuple(ElementKind(f"C3D{e.shape[1]}") for e in body.elements)
    n = len(body.elements)
    body.require(len(kinds) == n, "element_kinds", f"one for each of {n} arrays", len(kinds))
    modulus, out = body.place.units.mass / body.place.units.length, []
    for kind, elements in zip(kinds, body.elements):
        if not np.isin(elements, nodes).any():
            continue
        own = constants if constants is not None else (kind.youngs_modulus, kind.poisson_ratio)
        if own[0] is None or own[1] is None:
            expected = "elastic constants in the file, or elasticity=(Young's modulus, Poisson's ratio) in its units"
            raise body.error(f"{item}, elements {kind.name}", expected, "neither")
        if not (own[0] > 0.0 and -1.0 < own[1] < 0.5):
            raise body.error(f"{item}, elasticity", "a modulus > 0 and a Poisson's ratio above -1 and below 0.5", own)
        out.append(Solids(kind.name, elements, modulus * float(own[0]), float(own[1])))
    return tuple(out)
