"""Plausibility of an import: order of rows, corners and matrices, sizes, densities, wave speeds and
frequencies.

Values outside :data:`bdamper.importers.fe_body.BOUNDS` indicate mistaken units.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fem.surface import N_CORNER, enclosed_volume, twisted
from bdamper.importers.fe_body import BOUNDS, UNITS
from bdamper.importers.prepared_body import PreparedBody
from bdamper.model.modal_basis import rigid_motions
from bdamper.model.structure import Body
from bdamper.util.errors import check


def ratio_in_words(ratio: float) -> str | None:
    """Return the mistake that explains a ratio of two frequencies, or None."""
    mistakes = {
        "2 pi: hertz against radians per second": 2.0 * np.pi,
        "1/(2 pi): radians per second against hertz": 0.5 / np.pi,
    }
    # frequencies change with the root of a unit of mass, length or force
    for k in range(-12, 13):
        if k == 0:
            continue
        power = f"10^{k // 2}" if k % 2 == 0 else f"10^({k}/2)"
        words = f"{power}: units of length, mass or force (mm and m, t and kg)"
        mistakes[words] = 10.0 ** (0.5 * k)
    for words, value in mistakes.items():
        if abs(ratio / value - 1.0) < 0.02:
            return words
    return None


def compare_frequencies(computed: NDArray, expected: NDArray, item: str, source: str) -> float:
    """Return the largest relative difference between two sets of natural frequencies.

    Parameters
    ----------
    computed, expected : (n,), (m,) float
        Frequencies, Hz.  The lowest ``min(n, m)`` are compared.
    item, source : str
        Names of the computed and of the expected frequencies in the message.

    Raises
    ------
    ModelError
        If the difference exceeds ``BOUNDS.agreement``.  The message gives a mistaken unit that
        explains the ratio.
    """
    n = min(len(computed), len(expected))
    check(n > 0, item, f"frequencies to compare with {source}", "none")
    computed = np.sort(computed)[:n]
    expected = np.sort(expected)[:n]
    ratio = computed / np.maximum(expected, 1e-300)
    middle = float(np.median(ratio))
    error = float(np.abs(ratio - 1.0).max())
    # a mistaken unit changes all frequencies by the same factor
    same_factor = np.abs(ratio / middle - 1.0).max() < 0.02
    words = ratio_in_words(middle) if same_factor else None
    if words:
        suspicion = f"the ratio {middle:.6g} is {words}"
    else:
        suspicion = f"ratios {ratio.min():.4g} to {ratio.max():.4g}"
    computed_text = ", ".join(f"{hertz:.6g}" for hertz in computed[:3])
    expected_text = ", ".join(f"{hertz:.6g}" for hertz in expected[:3])
    check(
        error <= BOUNDS.agreement,
        item,
        f"the frequencies of {source}, {expected_text}, ... Hz",
        f"{computed_text}, ... Hz; {suspicion}",
    )
    return error


def _rigid_motions(body: PreparedBody) -> tuple[NDArray, NDArray]:
    """Return positions relative to the middle of a body, and its rigid motions (3 n_nodes, 6),
    scaled to its size.
    """
    centre = 0.5 * (body.nodes.min(axis=0) + body.nodes.max(axis=0))
    motion = rigid_motions(body.nodes, centre, np.eye(3))
    motion[:, :3] *= body.size
    return body.nodes - centre, motion


def check_rigid_motion(body: PreparedBody) -> None:
    """Check that a rigid motion of a free body causes no force.

    The measure is a strain: the root of the energy of a rigid motion, divided by the energy of a
    stretch about the same centre.  Positions that are 1 % too long give 0.01; positions rounded to
    six digits give about 1e-4.

    Raises
    ------
    ModelError
        If the strain exceeds ``BOUNDS.rigid_strain``.
    """
    arm, motion = _rigid_motions(body)
    stretch = np.stack([(arm * axis).ravel() for axis in np.eye(3)], axis=1)
    stiffness = body.structure.stiffness
    motion_energy = np.einsum("ij,ij->j", motion, stiffness @ motion)
    stretch_energy = np.einsum("ij,ij->j", stretch, stiffness @ stretch).max()
    item = "stiffness matrix"
    body.require(stretch_energy > 0.0, item, "a body that resists stretching", "no force")
    strain = np.sqrt(np.abs(motion_energy) / stretch_energy)
    _check_strain(
        body,
        strain[:3],
        "translation along",
        "fixed nodes, springs to the ground, or a table of nodes of another body",
    )
    _check_strain(
        body,
        strain[3:],
        "rotation about",
        "positions that do not belong to it (order, units, axes)",
    )
    body.passed(
        f"{body.name}: strain by rigid-body motion {strain.max():.1g} times that of an equal "
        "stretch"
    )


def _check_strain(body: PreparedBody, strain: NDArray, motion: str, hint: str) -> None:
    """Raise ModelError if a rigid motion along or about X, Y or Z strains a free body."""
    axis = "XYZ"[strain.argmax()]
    found = (
        f"a strain of {strain.max():.2g} times that of an equal stretch under a {motion} {axis}: "
        f"{hint}"
    )
    rigid = strain.max() <= BOUNDS.rigid_strain
    expected = "a free body (rigid-body motion must not strain it)"
    body.require(rigid, "stiffness matrix", expected, found)


def _away_from_held(body: PreparedBody) -> NDArray:
    """Return whether each node (n_nodes,) belongs to elements and is neither held nor a neighbour
    of a held node.
    """
    held = np.asarray(body.fixed(held=None).any(axis=1))
    in_elements = np.isin(np.arange(len(held)), body.used)
    away = in_elements & ~held
    for elements in body.elements:
        with_held_nodes = elements[held[elements].any(axis=1)]
        away[with_held_nodes] = False
    return away


def check_table(body: PreparedBody) -> None:
    """Check that the rows of the stiffness matrix are in the order of the table of nodes and
    components.

    A rigid motion of all nodes causes no force at a node that is neither fixed nor a neighbour of a
    fixed node.  If the rows are in another order (all x, then all y, then all z), large forces
    arise at nearly every node.

    Raises
    ------
    ModelError
        If forces arise at more than the fraction ``BOUNDS.odd_ones`` of the nodes.
    """
    away = _away_from_held(body)
    if not away.any():
        body.passed(
            f"{body.name}: the order of the rows is not checked, because every node is adjacent "
            "to a fixed one"
        )
        return
    stiffness = body.structure.stiffness
    _, motion = _rigid_motions(body)
    force = _norms_at_nodes(stiffness @ motion)[away]
    # the parts of a force cancel; the sum of their sizes is the reference
    parts = _norms_at_nodes(abs(stiffness) @ np.abs(motion))[away]
    loaded = (force > BOUNDS.rigid_force * parts).any(axis=1)
    share = 100.0 * float(loaded.mean())
    found = (
        f"forces on {share:.3g} % of the nodes away from fixed nodes under rigid-body motion: "
        "rows in an order different from the table (or from x, y, z of successive nodes), or "
        "positions of other nodes"
    )
    expected = "rows in the order of the table of nodes and components"
    body.require(share <= 100.0 * BOUNDS.odd_ones, "stiffness matrix", expected, found)
    body.passed(
        f"{body.name}: rigid-body motion causes forces at {share:.2g} % of the nodes away from "
        "fixed ones"
    )


def _norms_at_nodes(forces: NDArray) -> NDArray:
    """Return the sizes (n_nodes, 6) of the nodal forces (3 n_nodes, 6) of six motions."""
    return np.linalg.norm(forces.reshape(-1, 3, 6), axis=1)


def check_corners(body: PreparedBody) -> None:
    """Raise ModelError if the corners of many wedges or hexahedra are not in the order of
    :class:`FEBody`.
    """
    for elements, numbers in zip(body.elements, body.raw.elements):
        n = N_CORNER.get(elements.shape[1], 0)
        # the corners of a tetrahedron can have any order
        if n not in (6, 8):
            continue
        wrong = np.flatnonzero(twisted(elements[:, :n], body.nodes))
        if len(wrong) <= BOUNDS.odd_ones * len(elements):
            continue
        corners = np.asarray(numbers)[wrong[0], :n].tolist()
        expected = (
            f"{n // 2} corners in turn around one face, "
            f"then the {n // 2} opposite ones in the same turn"
        )
        found = f"a different order in {len(wrong)} of {len(elements)}"
        raise body.error(f"elements, such as the one with nodes {corners}", expected, found)


def check_radial(body: PreparedBody, n_blades: int) -> None:
    """Check that a sector narrower than a half circle lies in the direction ``radial``.

    The middle is the centre of the box around the nodes of its elements, along the axes of the
    model.
    """
    pitch = 360.0 / n_blades
    limit = max(pitch, BOUNDS.radial_angle)
    nodes = body.nodes[body.used]
    x, y, _ = 0.5 * (nodes.min(axis=0) + nodes.max(axis=0))
    radius = np.hypot(x, y)
    if limit >= 180.0 or radius < 0.05 * body.size:
        return
    # measured from Y, which is the direction "radial"
    angle = np.rad2deg(np.arctan2(x, y))
    middle = body.placement.rotation.T @ [x, y, 0.0] / radius
    middle_text = ", ".join(f"{component:.3g}" for component in middle)
    radial_text = ", ".join(f"{component:.3g}" for component in body.placement.radial)
    expected = (
        f"the direction from the axis to the blade, within {limit:.3g} degrees of ({middle_text}) "
        "in the axes of the file, the middle of the box around all elements of the sector"
    )
    found = f"({radial_text}), {abs(angle):.3g} degrees off"
    body.require(abs(angle) <= limit, "radial", expected, found)
    body.passed(
        f"{body.name}: the middle of the box around all elements is {abs(angle):.2g} degrees from "
        "radial"
    )


def check_not_swapped(body: PreparedBody) -> None:
    """Check that the stiffness and mass matrices are not exchanged.

    A mass matrix resists a translation of all nodes, while a stiffness matrix resists it near fixed
    nodes only.
    """
    stiffness = _resistance(body.structure.stiffness)
    mass = _resistance(body.structure.mass)
    found = (
        "a matrix that resists translation like a mass, then one that does not: the matrices are "
        "swapped"
    )
    good = mass >= 0.1 or stiffness <= 0.5
    body.require(good, "matrices", "a stiffness matrix, then a mass matrix", found)


def _resistance(matrix: sp.csr_matrix) -> float:
    """Return the product with translations along the three axes, divided by the trace."""
    translations = np.tile(np.eye(3), (matrix.shape[0] // 3, 1))
    product = float(np.einsum("ik,ik->", translations, matrix @ translations))
    return product / max(float(matrix.diagonal().sum()), 1e-300)


def wave_speed(body: PreparedBody) -> float:
    r"""Return the speed (m/s) of longitudinal waves in the material.

    A uniform strain along an axis, with displacements u of unit gradient, and a unit translation 1
    give

    .. math:: u^T K u = (\lambda + 2 \mu) V, \qquad 1^T M 1 = \rho V.

    The result is the lowest of the three axes.  The strain is centred at the fixed nodes, because
    their surroundings are strained more.
    """
    structure = body.structure
    held = body.fixed(held=None).any(axis=1)
    centre = body.nodes[held].mean(axis=0) if held.any() else body.nodes.mean(axis=0)
    squared_speeds = []
    for axis in np.eye(3):
        stretch = ((body.nodes - centre) * axis).ravel()
        translation = np.tile(axis, len(body.nodes))
        mass = float(translation @ (structure.mass @ translation))
        energy = float(stretch @ (structure.stiffness @ stretch))
        squared_speeds.append(energy / mass if mass > 0.0 else np.inf)
    return float(np.sqrt(max(min(squared_speeds), 0.0)))


def _check_within(
    body: PreparedBody,
    item: str,
    what: str,
    limits: tuple[float, float],
    value: float,
    unit: str,
    hint: str,
) -> None:
    """Raise ModelError for a quantity outside its limits, with the unit that explains it."""
    low, high = limits
    units = "the given units"
    for name, system in UNITS.items():
        if system == body.placement.units:
            units = name
            break
    found = (
        f"{value:.4g} {unit} with Placement(units='{units}'): {hint}; "
        "pass checks=Checks(check_units=False) if they are right"
    )
    body.require(low <= value <= high, item, f"{what} {low:g} to {high:g} {unit}", found)


def check_sizes(body: PreparedBody) -> None:
    """Check size, density and wave speed of a body."""
    unit = "millimetres" if body.size > BOUNDS.size[1] else "another unit of length"
    hint = f"possibly given in {unit}"
    _check_within(body, "positions", "an extent of", BOUNDS.size, body.size, "m", hint)
    body.passed(f"{body.name}: extent {body.size:.4g} m")
    if not body.has_matrices:
        return
    if body.elements:
        _check_density(body)
    speed = wave_speed(body)
    low, high = BOUNDS.wave_speed
    if body.fixed(held=None).any():
        high = np.inf  # the material at fixed nodes is strained as well
    ratio = (speed / 6000.0) ** 2
    hint = (
        f"a stiffness over density about {ratio:.1g} times that of a metal (some 6000 m/s), "
        "possibly different units of the stiffness and mass matrices"
    )
    what = "a material in which longitudinal waves travel at"
    _check_within(body, "stiffness and mass matrix", what, (low, high), speed, "m/s", hint)
    body.passed(f"{body.name}: longitudinal waves travel at {speed:.4g} m/s in its material")


def _check_density(body: PreparedBody) -> None:
    """Check mass over volume, and name the system of units that would fit."""
    along_z = np.tile([0.0, 0.0, 1.0], len(body.nodes))
    mass = float(along_z @ (body.structure.mass @ along_z))
    volume = enclosed_volume(body.boundary, body.nodes)
    density = mass / volume if volume > 0.0 else np.inf
    units = body.placement.units
    in_file = density / units.mass * units.length**3
    low, high = BOUNDS.density
    hint = "the mass matrix is in other units"
    for name, system in UNITS.items():
        if low <= in_file * system.mass / system.length**3 <= high:
            hint = f"units='{name}' would fit"
            break
    _check_within(body, "mass matrix", "a density of", BOUNDS.density, density, "kg/m3", hint)
    body.passed(f"{body.name}: mass {mass:.6g} kg on free nodes")


@np.errstate(all="ignore")  # constants that are unknown or impossible
def check_material(body: PreparedBody, elasticity: Sequence[float] | None) -> None:
    r"""Compare density and Young's modulus of the elements with the matrices, at nodes away from
    fixed nodes.

    A translation along an axis and a uniform strain along it cause the nodal forces

    .. math:: M 1 = \sum_e \rho_e \int N\,dV, \qquad K u = \sum_e \int \sigma_e \nabla N\,dV.

    The densities are compared by the sums of all nodes, the moduli by the median of the nodes,
    because springs act on few.  A difference is a failed comparison.
    """
    try:
        from bdamper.fem.element_stress import lame_constants, nodal_integrals
    except ImportError:
        body.report.missing.append(
            f"{body.name}: comparison of the material of elements and matrices (extra bdamper[fe])"
        )
        return
    n = len(body.nodes)
    eye = np.eye(3)
    inner = _away_from_held(body)
    units = body.placement.units
    # of modulus, Poisson's ratio and density
    to_si = np.array([units.mass / units.length, 1.0, units.mass / units.length**3])

    # forces of the matrices for strains and translations along the three axes
    strains = (body.nodes[:, :, None] * eye).reshape(3 * n, 3)
    force = (body.structure.stiffness @ strains).reshape(n, 9)
    translations = np.tile(eye, (n, 1))
    inertia_forces = (body.structure.mass @ translations).reshape(n, 3, 3)
    inertia = np.trace(inertia_forces, axis1=1, axis2=2) / 3.0

    # the same sums of the elements
    volume = np.zeros(n)
    mass = np.zeros(n)
    load = np.zeros((n, 9))
    materials = []
    for kind, elements in zip(body.kinds, body.elements):
        with body.refusing(f"elements {kind.name}", "all nodes between corners"):
            nodes, share, normal = nodal_integrals(elements, body.nodes)
        constants = [kind.youngs_modulus, kind.poisson_ratio, kind.density]
        if elasticity is not None:
            constants = [*elasticity, kind.density]
        # an unknown constant becomes NaN
        young, poisson, density = to_si * np.array(constants, float)
        lame, shear = lame_constants(young, poisson)
        stress = normal[..., None] * (lame + 2.0 * shear * eye)
        np.add.at(volume, nodes, share)
        np.add.at(mass, nodes, density * share)
        np.add.at(load, nodes, stress.reshape(*share.shape, 9))
        rows = np.isin(np.arange(n), nodes) & inner
        materials.append((kind.name, rows, young, poisson, density))

    squared_load = (load**2).sum(axis=1)
    product = (load * force).sum(axis=1)
    for name, rows, young, poisson, density in materials:
        ratio = inertia[rows].sum() / mass[rows].sum()
        _compare_constant(
            body,
            "density",
            f"{density:.4g} kg/m3 of the elements {name}",
            ratio,
            f"{ratio * density:.4g} kg/m3",
        )
        loaded = rows & (squared_load > 1e-4 * squared_load[rows].max(initial=0.0))
        if loaded.any():
            ratio = np.median(product[loaded] / squared_load[loaded])
            item = f"Young's modulus with Poisson's ratio {poisson:g}"
            _compare_constant(
                body,
                item,
                f"{young:.4g} Pa of the elements {name}",
                ratio,
                f"{ratio * young:.4g} Pa",
            )
    mean_density = inertia[inner].sum() / volume[inner].sum()
    body.passed(f"{body.name}: density of the matrices {mean_density:.4g} kg/m3")


def _compare_constant(
    body: PreparedBody, item: str, expected: str, ratio: float, in_matrices: str
) -> None:
    """Record a failed comparison if matrices and elements have different material constants."""
    # an unknown constant gives NaN and is not compared
    differs = abs(ratio - 1.0) > BOUNDS.material
    found = f"{in_matrices} in the matrices: possibly files of different models"
    with body.report.comparison():
        body.require(not differs, item, expected, found)


def check_lowest(body: PreparedBody, reduced: Body) -> None:
    """Check that the lowest frequency at each nodal diameter is plausible.

    An implausible frequency is recorded as a failed comparison.
    """
    hint = "possibly units of mass or stiffness that differ by powers of 10"
    for d, basis in reduced.bases.items():
        positive = basis.omega2[basis.omega2 > 0.0]
        lowest = float(np.sqrt(positive.min(initial=np.inf)) / (2.0 * np.pi))
        if not np.isfinite(lowest):
            continue
        item = f"nodal diameter {d}"
        what = "a lowest frequency of"
        with body.report.comparison():
            _check_within(body, item, what, BOUNDS.frequency, lowest, "Hz", hint)


def check_bodies(
    bodies: Mapping[str, PreparedBody],
    n_blades: int,
    check_units: bool,
    elasticity: Sequence[float] | None,
) -> None:
    """Check the bodies of an import before their reduction; if ``check_units``, also their sizes
    and units.
    """
    check_radial(bodies["blade"], n_blades)
    for name, body in bodies.items():
        body.check_repeated()
        if body.has_matrices:
            check_not_swapped(body)
            if name == "blade":  # check_rigid_motion checks a free body
                check_table(body)
        check_corners(body)
        if check_units:
            check_sizes(body)
        if body.has_matrices and body.elements:
            check_material(body, elasticity if name == "blade" else None)
