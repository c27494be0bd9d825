"""Plausibility of an import: order of rows, corners and matrices, sizes, densities, wave speeds and frequencies.

Values outside :data:`bdamper.importers.fe_body.BOUNDS` indicate mistaken units.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bdamper.fem.surface import N_CORNER, enclosed_volume, twisted
from bdamper.importers.fe_body import BOUNDS, UNITS
from bdamper.importers.prepared_body import PreparedBody
from bdamper.model.modal_basis import rigid_motions
from bdamper.model.structure import Body
from bdamper.util.errors import check


def ratio_in_words(ratio: float) -> str | None:
    """Return the mistake that explains a ratio of two frequencies, or None."""
    candidates = {
        "2 pi: hertz against radians per second": 2.0 * np.pi,
        "1/(2 pi): radians per second against hertz": 0.5 / np.pi,
    }
    for k in (k for k in range(-12, 13) if k != 0):
        power = f"10^{k // 2}" if k % 2 == 0 else f"10^({k}/2)"
        candidates[f"{power}: units of length, mass or force (mm and m, t and kg)"] = 10.0 ** (
            0.5 * k
        )
    return next(
        (words for words, value in candidates.items() if abs(ratio / value - 1.0) < 0.02), None
    )


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
        If the difference exceeds ``BOUNDS.agreement``.  The message names a mistaken unit that explains the ratio.
    """
    n = min(len(computed), len(expected))
    check(n > 0, item, f"frequencies to compare with {source}", "none")
    computed, expected = np.sort(computed)[:n], np.sort(expected)[:n]
    ratio = computed / np.maximum(expected, 1e-300)
    middle, error = float(np.median(ratio)), float(np.abs(ratio - 1.0).max())
    words = ratio_in_words(middle) if np.abs(ratio / middle - 1.0).max() < 0.02 else None
    suspicion = (
        f"the ratio {middle:.6g} is {words}"
        if words
        else f"ratios {ratio.min():.4g} to {ratio.max():.4g}"
    )
    shown, wanted = (", ".join(f"{f:.6g}" for f in values[:3]) for values in (computed, expected))
    check(
        error <= BOUNDS.agreement,
        item,
        f"the frequencies of {source}, {wanted}, ... Hz",
        f"{shown}, ... Hz; {suspicion}",
    )
    return error


def _rigid_motions(body: PreparedBody) -> tuple[NDArray, NDArray]:
    """Return positions relative to the middle of a body, and its rigid motions (3 n_nodes, 6), scaled to its size."""
    centre = 0.5 * (body.nodes.min(axis=0) + body.nodes.max(axis=0))
    motion = rigid_motions(body.nodes, centre, np.eye(3))
    motion[:, :3] *= body.size
    return body.nodes - centre, motion


def check_rigid_motion(body: PreparedBody) -> None:
    """Check that a rigid motion of a free body causes no force.

    The measure is a strain: the root of the energy of a rigid motion, divided by the energy of a stretch about the same
    centre.  Positions that are 1 % too long give 0.01; positions rounded to six digits give about 1e-4.

    Raises
    ------
    ModelError
        If the strain exceeds ``BOUNDS.rigid_strain``.
    """
    arm, motion = _rigid_motions(body)
    stretch = np.stack([(arm * axis).ravel() for axis in np.eye(3)], axis=1)
    energy, scale = (
        np.einsum("ij,ij->j", u, body.structure.stiffness @ u) for u in (motion, stretch)
    )
    body.require(
        scale.max() > 0.0, "stiffness matrix", "a body that resists stretching", "no force"
    )
    strain = np.sqrt(np.abs(energy) / scale.max())
    for kind, part, hint in (
        (
            "translation along",
            strain[:3],
            "fixed nodes, springs to the ground, or a table of nodes of another body",
        ),
        ("rotation about", strain[3:], "positions that do not belong to it (order, units, axes)"),
    ):
        found = f"a strain of {part.max():.2g} of its size under a {kind} {'XYZ'[part.argmax()]}: {hint}"
        good = part.max() <= BOUNDS.rigid_strain
        body.require(good, "stiffness matrix", "a free body, which no rigid motion strains", found)
    body.passed(
        f"{body.name}: rigid motions strain it by {strain.max():.1g} of a stretch of equal size"
    )


def _away_from_held(body: PreparedBody) -> NDArray:
    """Return whether each node (n_nodes,) belongs to elements and is neither held nor a neighbour of a held node."""
    held = np.asarray(body.fixed(None).any(axis=1))
    away = np.isin(np.arange(len(held)), body.used) & ~held
    for elements in body.elements:
        away[elements[held[elements].any(axis=1)]] = False
    return away


def check_table(body: PreparedBody) -> None:
    """Check that the rows of the stiffness matrix are in the order of the table of nodes and components.

    A rigid motion of all nodes causes no force at a node that is neither fixed nor a neighbour of a fixed node.  If the
    rows are in another order (all x, then all y, then all z), large forces arise at nearly every node.

    Raises
    ------
    ModelError
        If forces arise at more than the fraction ``BOUNDS.odd_ones`` of the nodes.
    """
    away = _away_from_held(body)
    if not away.any():
        body.passed(
            f"{body.name}: order of the rows not checked, every node is a neighbour of a held one"
        )
        return
    stiffness, (_, motion) = body.structure.stiffness, _rigid_motions(body)
    pairs = (stiffness, motion), (abs(stiffness), np.abs(motion))
    force, parts = (np.linalg.norm((k @ u).reshape(-1, 3, 6), axis=1)[away] for k, u in pairs)
    share = 100.0 * float((force > BOUNDS.rigid_force * parts).any(axis=1).mean())
    found = f"forces on {share:.3g} % of the nodes away from held ones when the body moves as a rigid one: rows in another "
    found += (
        "order than the table (or than x, y, z of node after node), or positions of other nodes"
    )
    expected = "rows in the order of the table of nodes and components"
    body.require(share <= 100.0 * BOUNDS.odd_ones, "stiffness matrix", expected, found)
    body.passed(
        f"{body.name}: rigid motions cost forces on {share:.2g} % of the nodes away from held ones"
    )


def check_corners(body: PreparedBody) -> None:
    """Raise ModelError if the corners of many wedges or hexahedra are not in the order of :class:`FEBody`."""
    for elements, numbers in zip(body.elements, body.raw.elements):
        n = N_CORNER.get(elements.shape[1], 0)
        if n not in (6, 8):
            continue
        wrong = np.flatnonzero(twisted(elements[:, :n], body.nodes))
        if len(wrong) > BOUNDS.odd_ones * len(elements):
            item = (
                f"elements, such as the one with nodes {np.asarray(numbers)[wrong[0], :n].tolist()}"
            )
            expected = f"{n // 2} corners in turn around one face, then the {n // 2} opposite ones in the same turn"
            raise body.error(item, expected, f"another order in {len(wrong)} of {len(elements)}")


def check_radial(body: PreparedBody, n_blades: int) -> None:
    """Check that a sector narrower than a half circle lies in the direction ``radial``."""
    pitch = 360.0 / n_blades
    limit = max(pitch, BOUNDS.radial_angle)
    nodes = body.nodes[body.used]
    x, y, _ = 0.5 * (nodes.min(axis=0) + nodes.max(axis=0))
    if limit >= 180.0 or np.hypot(x, y) < 0.05 * body.size:
        return
    angle = np.rad2deg(np.arctan2(x, y))
    middle, given = body.placement.rotation.T @ [x, y, 0.0] / np.hypot(x, y), body.placement.radial
    middle_text, given_text = (
        f"({', '.join(f'{a:.3g}' for a in axis)})" for axis in (middle, given)
    )
    expected = f"the direction from the axis to the blade, within {limit:.3g} degrees of the middle of the sector, "
    expected += f"{middle_text} in the axes of the file"
    body.require(
        abs(angle) <= limit, "radial", expected, f"{given_text}, {abs(angle):.3g} degrees off"
    )
    body.passed(f"{body.name}: the middle of the sector is {abs(angle):.2g} degrees from radial")


def check_not_swapped(body: PreparedBody) -> None:
    """Check that the stiffness and mass matrices are not exchanged.

    A mass matrix resists a translation of all nodes, while a stiffness matrix resists it near fixed nodes only.
    """
    along = np.tile(np.eye(3), (len(body.nodes), 1))
    stiffness, mass = (
        float(np.einsum("ik,ik->", along, matrix @ along))
        / max(float(matrix.diagonal().sum()), 1e-300)
        for matrix in (body.structure.stiffness, body.structure.mass)
    )
    found = "a matrix that resists translations as a mass does, then one that does not: exchange the swapped matrices"
    body.require(
        mass >= 0.1 or stiffness <= 0.5, "matrices", "a stiffness matrix, then a mass matrix", found
    )


def wave_speed(body: PreparedBody) -> float:
    r"""Return the speed (m/s) of longitudinal waves in the material.

    A uniform strain along an axis, with displacements u of unit gradient, and a unit translation 1 give

    .. math:: u^T K u = (\lambda + 2 \mu) V, \qquad 1^T M 1 = \rho V.

    The result is the lowest of the three axes.  The strain is centred at the fixed nodes, since their surroundings are
    strained more.
    """
    structure, held = body.structure, body.fixed(None).any(axis=1)
    centre = body.nodes[held].mean(axis=0) if held.any() else body.nodes.mean(axis=0)
    speeds = []
    for axis in np.eye(3):
        stretch, along = ((body.nodes - centre) * axis).ravel(), np.tile(axis, len(body.nodes))
        mass = float(along @ (structure.mass @ along))
        speeds.append(
            float(stretch @ (structure.stiffness @ stretch)) / mass if mass > 0.0 else np.inf
        )
    return float(np.sqrt(max(min(speeds), 0.0)))


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
    given = next(
        (name for name, u in UNITS.items() if u == body.placement.units), "the given units"
    )
    right = "pass checks=Checks(check_units=False) if they are right"
    found = f"{value:.4g} {unit} with Placement(units='{given}'): {hint}; {right}"
    body.require(
        limits[0] <= value <= limits[1],
        item,
        f"{what} {limits[0]:g} to {limits[1]:g} {unit}",
        found,
    )


def check_sizes(body: PreparedBody) -> None:
    """Check size, density and wave speed of a body."""
    hint = f"{'millimetres' if body.size > BOUNDS.size[1] else 'another unit of length'} suspected"
    _check_within(body, "positions", "an extent of", BOUNDS.size, body.size, "m", hint)
    body.passed(f"{body.name}: extent {body.size:.4g} m")
    if not body.has_matrices:
        return
    if body.elements:
        along = np.tile([0.0, 0.0, 1.0], len(body.nodes))
        mass, volume = (
            float(along @ (body.structure.mass @ along)),
            enclosed_volume(body.boundary, body.nodes),
        )
        density = mass / volume if volume > 0.0 else np.inf
        in_file, (low, high) = (
            density / body.placement.units.mass * body.placement.units.length**3,
            BOUNDS.density,
        )
        fitting = [
            name for name, u in UNITS.items() if low <= in_file * u.mass / u.length**3 <= high
        ]
        hint = f"units='{fitting[0]}' would fit" if fitting else "the mass matrix is in other units"
        _check_within(body, "mass matrix", "a density of", BOUNDS.density, density, "kg/m3", hint)
        body.passed(f"{body.name}: mass {mass:.6g} kg on free nodes")
    speed, (low, high) = wave_speed(body), BOUNDS.wave_speed
    if body.fixed(None).any():
        high = np.inf  # the material at fixed nodes is strained as well
    hint = f"a stiffness over density about {(speed / 6000.0) ** 2:.1g} times that of a metal (some 6000 m/s), other "
    hint += "units of the stiffness or the mass matrix suspected"
    what = "a material in which longitudinal waves travel at"
    _check_within(body, "stiffness and mass matrix", what, (low, high), speed, "m/s", hint)
    body.passed(f"{body.name}: longitudinal waves travel at {speed:.4g} m/s in its material")


@np.errstate(all="ignore")  # constants that are unknown or impossible
def check_material(body: PreparedBody, elasticity: Sequence[float] | None) -> None:
    r"""Compare density and Young's modulus of the elements with the matrices, at nodes away from held ones.

    A translation along an axis and a uniform strain along it cause the nodal forces

    .. math:: M 1 = \sum_e \rho_e \int N\,dV, \qquad K u = \sum_e \int \sigma_e \nabla N\,dV.

    The densities are compared by the sums of all nodes, the moduli by the median of the nodes, since springs act on few.  A
    difference is a failed comparison.
    """
    try:
        from bdamper.fem.element_stress import lame_constants, nodal_integrals
    except ImportError:
        body.report.missing.append(
            f"{body.name}: comparison of the material of elements and matrices (extra bdamper[fe])"
        )
        return
    n, eye, units, inner = len(body.nodes), np.eye(3), body.placement.units, _away_from_held(body)
    factors = np.array([units.mass / units.length, 1.0, units.mass / units.length**3])
    force = (body.structure.stiffness @ (body.nodes[:, :, None] * eye).reshape(3 * n, 3)).reshape(
        n, 9
    )
    inertia = (
        np.trace((body.structure.mass @ np.tile(eye, (n, 1))).reshape(n, 3, 3), axis1=1, axis2=2)
        / 3.0
    )
    volume, mass, load, groups = np.zeros(n), np.zeros(n), np.zeros((n, 9)), []
    for kind, elements in zip(body.kinds, body.elements):
        with body.refusing(f"elements {kind.name}", "all nodes between corners"):
            nodes, share, normal = nodal_integrals(elements, body.nodes)
        given = (kind.youngs_modulus, kind.poisson_ratio) if elasticity is None else elasticity
        young, poisson, density = factors * np.array([*given, kind.density], float)
        lame, shear = lame_constants(young, poisson)
        stress = normal[..., None] * (lame + 2.0 * shear * eye)
        for total, part in (
            (volume, share),
            (mass, density * share),
            (load, stress.reshape(*share.shape, 9)),
        ):
            np.add.at(total, nodes, part)
        modulus = f"Young's modulus with Poisson's ratio {poisson:g}"
        groups.append((kind.name, np.isin(np.arange(n), nodes) & inner, density, modulus, young))
    size, stiffer = (load**2).sum(axis=1), (load * force).sum(axis=1)
    for name, rows, density, modulus, young in groups:
        loaded = rows & (size > 1e-4 * size[rows].max(initial=0.0))
        found = [("density", "kg/m3", density, inertia[rows].sum() / mass[rows].sum())]
        if loaded.any():
            found.append((modulus, "Pa", young, np.median(stiffer[loaded] / size[loaded])))
        for item, unit, value, ratio in found:
            with body.report.comparison():
                words = f"{ratio * value:.4g} {unit} in the matrices: files of different models suspected"
                good = not abs(ratio - 1.0) > BOUNDS.material  # unknown constants are not compared
                body.require(good, item, f"{value:.4g} {unit} of the elements {name}", words)
    body.passed(
        f"{body.name}: density of the matrices {inertia[inner].sum() / volume[inner].sum():.4g} kg/m3"
    )


def check_lowest(body: PreparedBody, reduced: Body) -> None:
    """Check the lowest natural frequency at each nodal diameter; a failure is a failed comparison."""
    for d, basis in reduced.bases.items():
        lowest = float(
            np.sqrt(basis.omega2[basis.omega2 > 0.0].min(initial=np.inf)) / (2.0 * np.pi)
        )
        hint = "units of mass or stiffness off by powers of 10 suspected"
        if np.isfinite(lowest):
            with body.report.comparison():
                _check_within(
                    body,
                    f"nodal diameter {d}",
                    "a lowest frequency of",
                    BOUNDS.frequency,
                    lowest,
                    "Hz",
                    hint,
                )


def check_bodies(
    bodies: Mapping[str, PreparedBody],
    n_blades: int,
    check_units: bool,
    elasticity: Sequence[float] | None,
) -> None:
    """Check the bodies of an import before their reduction; if ``check_units``, also their sizes and units."""
    check_radial(bodies["blade"], n_blades)
    for body in bodies.values():
        body.check_repeated()
        if body.has_matrices:
            check_not_swapped(body)
            if body.name == "blade":  # check_rigid_motion checks a free body
                check_table(body)
        check_corners(body)
        if check_units:
            check_sizes(body)
        if body.has_matrices and body.elements:
            check_material(body, elasticity if body.name == "blade" else None)
