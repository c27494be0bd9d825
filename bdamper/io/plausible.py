"""Plausibility of sizes, densities, wave speeds and frequencies: values that no machine has point to mistaken units."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bdamper.io.bounds import BOUNDS
from bdamper.io.fe_body import UNITS
from bdamper.io.prepare import PreparedBody
from bdamper.model.checks import require
from bdamper.model.model import Body
from bdamper.reduction.facets import N_CORNER, twisted
from bdamper.reduction.free_body import rigid_motions
from bdamper.reduction.structure import Structure
from bdamper.util.errors import mismatch

OVERRIDE = "pass check_units=False if they are right"


def ratio_in_words(ratio: float) -> str | None:
    """Mistake that explains a ratio of two frequencies that should be equal; None if there is none."""
    candidates = {
        "2 pi: hertz against radians per second": 2.0 * np.pi,
        "1/(2 pi): radians per second against hertz": 0.5 / np.pi,
    }
    for k in (k for k in range(-12, 13) if k != 0):
        power = f"10^{k // 2}" if k % 2 == 0 else f"10^({k}/2)"
        candidates[f"{power}: units of length, mass or force (mm and m, t and kg)"] = 10.0 ** (0.5 * k)
    return next((words for words, value in candidates.items() if abs(ratio / value - 1.0) < 0.02), None)


def compare_frequencies(found: NDArray, expected: NDArray, item: str, source: str) -> float:
    """Largest relative difference of the frequencies that both have.

    Raises
    ------
    ModelError
        If they do not agree; the message names a mistaken unit that explains the ratio.
    """
    n = min(len(found), len(expected))
    require(n > 0, item, f"frequencies to compare with {source}", "none")
    found, expected = np.sort(found)[:n], np.sort(expected)[:n]
    ratio = found / np.maximum(expected, 1e-300)
    error = float(np.abs(ratio - 1.0).max())
    if error <= BOUNDS.agreement:
        return error
    middle = float(np.median(ratio))
    shown = ", ".join(f"{f:.6g}" for f in found[:3])
    wanted = ", ".join(f"{f:.6g}" for f in expected[:3])
    words = ratio_in_words(middle) if np.abs(ratio / middle - 1.0).max() < 0.02 else None
    suspicion = f"; the ratio {middle:.6g} is {words}" if words else f"; ratios {ratio.min():.4g} to {ratio.max():.4g}"
    raise mismatch(item, f"the frequencies of {source}, {wanted}, ... Hz", f"{shown}, ... Hz{suspicion}")


def check_rigid_motion(body: PreparedBody, structure: Structure) -> None:
    """Check that the stiffness matrix of a free body resists no rigid motion of its nodes.

    Energies are compared with those of three stretches about the same centre, so the measure is a strain: positions that
    are one per cent too long show as 0.01, positions rounded to six digits as some 1e-4.
    """
    centre = 0.5 * (structure.nodes.min(axis=0) + structure.nodes.max(axis=0))
    arm = structure.nodes - centre
    motion = rigid_motions(structure.nodes, centre, np.eye(3))
    motion[:, :3] *= body.size
    stretch = np.stack([(arm * np.eye(3)[k]).ravel() for k in range(3)], axis=1)
    energy, scale = (np.einsum("ij,ij->j", u, structure.stiffness @ u) for u in (motion, stretch))
    body.require(scale.max() > 0.0, "stiffness matrix", "a body that resists being stretched", "no force at all")
    strain = np.sqrt(np.abs(energy) / scale.max())
    worst = int(np.argmax(strain))
    if not strain[worst] <= BOUNDS.rigid_strain:
        if not strain[:3].max() <= BOUNDS.rigid_strain:
            worst = int(np.argmax(strain[:3]))
            hint = "fixed nodes, springs to the ground, or a table of nodes and components that does not belong to it"
        else:
            hint = "positions that do not belong to it (order, units, axes), or nodes with axes of their own"
        kind = "translation along" if worst < 3 else "rotation about"
        found = f"a strain of {strain[worst]:.2g} of its size under a {kind} {'XYZ'[worst % 3]}: {hint}"
        raise body.error("stiffness matrix", "a free body, which no rigid motion strains", found)
    body.checks.append(f"{body.name}: rigid motions strain it by {strain.max():.1g} of a stretch of equal size")


def check_table(body: PreparedBody) -> None:
    """Refuse a sector whose matrices do not belong to its nodes in the order of the table of nodes and components.

    A rigid motion of all nodes costs no force at a node that neither is held nor has a held neighbour: the rows of its
    three components sum to nothing over all components that they couple.  With rows in another order (all x, then all y,
    then all z, instead of node by node) there are forces of the size of the stiffness itself at nearly every node.
    """
    structure, away = body.structure, np.zeros(len(body.nodes), bool)
    away[body.used] = True
    held = np.asarray(body.fixed(None).any(axis=1))
    away &= ~held
    for elements in body.elements:
        away[elements[held[elements].any(axis=1)]] = False
    if not away.any():
        body.checks.append(f"{body.name}: order of the rows not checked, every node is a neighbour of a held one")
        return
    motion = rigid_motions(structure.nodes, 0.5 * (structure.nodes.min(axis=0) + structure.nodes.max(axis=0)), np.eye(3))
    motion[:, :3] *= body.size
    pairs = (structure.stiffness, motion), (abs(structure.stiffness), np.abs(motion))
    force, parts = (np.linalg.norm((k @ u).reshape(-1, 3, 6), axis=1)[away] for k, u in pairs)
    share = float((force > BOUNDS.rigid_force * parts).any(axis=1).mean())
    if share > BOUNDS.odd_ones:
        where = f"forces on {100 * share:.3g} % of the nodes away from held ones when the body moves as a rigid one"
        hint = "rows in another order than the table (or than x, y, z of node after node), or positions of other nodes"
        expected = "rows in the order of the table of nodes and components"
        raise body.error("stiffness matrix", expected, f"{where}: {hint}")
    where = "no force on any node" if share == 0.0 else f"a force on {100 * share:.2g} % of the nodes only"
    body.checks.append(f"{body.name}: away from held nodes rigid motions cost {where}, so rows are those of the table")


def check_corners(body: PreparedBody) -> None:
    """Refuse elements whose corners stand in another order than that from which faces are read."""
    n_checked = 0
    for elements, given in zip(body.elements, body.given.elements):
        n = N_CORNER.get(elements.shape[1], 0)
        if n not in (6, 8):
            continue
        wrong = np.flatnonzero(twisted(elements[:, :n], body.nodes))
        n_checked += len(elements)
        if len(wrong) > BOUNDS.odd_ones * len(elements):
            item = f"elements, that of nodes {np.asarray(given)[wrong[0], :n].tolist()}"
            expected = f"{n // 2} corners in turn around one face, then the {n // 2} opposite ones in the same turn"
            raise body.error(item, expected, f"another order in {len(wrong)} of {len(elements)}")
    if n_checked:
        body.checks.append(f"{body.name}: corners of {n_checked} hexahedra and wedges stand in the agreed order")


def check_one_scale(blade: PreparedBody, damper: PreparedBody) -> None:
    """Check that both bodies come in the same unit of length: a damper is not a thousand times smaller than the sector."""
    ratio = damper.size / max(blade.size, 1e-300)
    good, item = BOUNDS.damper_size[0] <= ratio <= BOUNDS.damper_size[1], f"{blade.where} and {damper.where}: positions"
    found = f"extents of {blade.size:.4g} m and {damper.size:.4g} m, a ratio of {ratio:.3g}: millimetres beside metres "
    require(good, item, "bodies in the same unit of length", f"{found}suspected; {OVERRIDE}")


def check_radial(body: PreparedBody, n_blades: int) -> None:
    """Check that a sector narrower than a half circle stands where ``radial`` points."""
    pitch = 360.0 / n_blades
    limit = max(pitch, BOUNDS.radial_angle)
    nodes = body.nodes[body.used]
    x, y, _ = 0.5 * (nodes.min(axis=0) + nodes.max(axis=0))
    if limit >= 180.0 or np.hypot(x, y) < 0.05 * body.size:
        return
    angle = np.rad2deg(np.arctan2(x, y))
    if abs(angle) > limit:
        middle, given = body.place.rotation.T @ [x, y, 0.0] / np.hypot(x, y), body.place.radial
        middle_text, given_text = (f"({', '.join(f'{a:.3g}' for a in axis)})" for axis in (middle, given))
        expected = f"the direction from the axis to the blade, within {limit:.3g} degrees of the middle of the sector, "
        expected += f"{middle_text} in the axes of the file"
        raise body.error("radial", expected, f"{given_text}, {abs(angle):.3g} degrees off")
    body.checks.append(f"{body.name}: the middle of the sector stands {abs(angle):.2g} degrees from radial")


def check_not_swapped(body: PreparedBody) -> None:
    """Tell the matrices apart: a mass matrix resists any translation of all nodes, a stiffness matrix where it is held."""
    along = np.tile(np.eye(3), (len(body.nodes), 1))
    stiffness, mass = (
        float(np.einsum("ik,ik->", along, matrix @ along)) / max(float(matrix.diagonal().sum()), 1e-300)
        for matrix in (body.structure.stiffness, body.structure.mass)
    )
    found = "one that resists translations as a mass does, then one that does not: they came swapped"
    body.require(mass >= 0.1 or stiffness <= 0.5, "matrices", "a stiffness matrix, then a mass matrix", found)


def wave_speed(body: PreparedBody) -> float:
    """Speed (m/s) of longitudinal waves in the material: the energy of a uniform stretch against the mass.

    ``u^T K u = (lambda + 2 mu) V`` for the displacements ``u`` of a unit strain along one axis, ``1^T M 1 = rho V``.  It
    is the least over the axes, about the middle of the nodes without rows, since material that they hold is strained
    more.
    """
    structure = body.structure
    held = body.fixed(None).any(axis=1)
    centre = body.nodes[held].mean(axis=0) if held.any() else body.nodes.mean(axis=0)
    arm = body.nodes - centre
    speeds = []
    for axis in np.eye(3):
        stretch, along = (arm * axis).ravel(), np.tile(axis, len(arm))
        mass = float(along @ (structure.mass @ along))
        speeds.append(float(stretch @ (structure.stiffness @ stretch)) / mass if mass > 0.0 else np.inf)
    return float(np.sqrt(max(min(speeds), 0.0)))


def _check_within(
    body: PreparedBody, item: str, what: str, limits: tuple[float, float], value: float, unit: str, hint: str,
    digits: int = 4,
) -> None:  # fmt: skip
    """Refuse a quantity beyond its limits, with the mistaken unit that explains it."""
    given = next((name for name, u in UNITS.items() if u == body.place.units), "the given units")
    found = f"{value:.{digits}g} {unit} with units='{given}': {hint}; {OVERRIDE}"
    body.require(limits[0] <= value <= limits[1], item, f"{what} {limits[0]:g} to {limits[1]:g} {unit}", found)


def check_sizes(body: PreparedBody) -> None:
    """Refuse sizes, densities and wave speeds far from anything built."""
    hint = f"{'millimetres' if body.size > BOUNDS.size[1] else 'another unit of length'} suspected"
    _check_within(body, "positions", "an extent of", BOUNDS.size, body.size, "m", hint)
    texts = [f"{body.name}: extent {body.size:.4g} m"]
    if body.volume is not None and body.has_matrices:
        along = np.tile([0.0, 0.0, 1.0], len(body.nodes))
        mass = float(along @ (body.structure.mass @ along))
        density = mass / body.volume if body.volume > 0 else np.inf
        u = body.place.units
        raw = density / u.mass * u.length**3
        fitting = [k for k, v in UNITS.items() if BOUNDS.density[0] <= raw * v.mass / v.length**3 <= BOUNDS.density[1]]
        hint = f"units='{fitting[0]}' would fit" if fitting else "the mass matrix is in other units"
        _check_within(body, "mass matrix", "a density of", BOUNDS.density, density, "kg/m3", hint)
        texts.append(f"{body.name}: mass {mass:.6g} kg on free nodes, volume {body.volume:.6g} m3, {density:.4g} kg/m3")
    if body.has_matrices:
        speed, what = wave_speed(body), "a material in which longitudinal waves travel at"
        low, high = BOUNDS.wave_speed  # what holds a body is strained, too, so only the lower bound counts there
        limits = low, np.inf if body.fixed(None).any() else high
        hint = f"a stiffness over density about {(speed / 6000.0) ** 2:.1g} times that of a metal (some 6000 m/s), other "
        hint += "units of the stiffness or the mass matrix suspected"
        _check_within(body, "stiffness and mass matrix", what, limits, speed, "m/s", hint, digits=3)
        texts.append(f"{body.name}: longitudinal waves travel at {speed:.4g} m/s in its material")
    body.checks += texts


def check_lowest(body: PreparedBody, made: Body) -> None:
    """Compare lowest frequencies with what is built."""
    for d, basis in made.bases.items():
        elastic = basis.omega2[basis.omega2 > 0.0]
        if len(elastic):
            lowest = float(np.sqrt(elastic.min()) / (2.0 * np.pi))
            hint = "units of mass or stiffness off by powers of 10 suspected"
            with body.compared():
                _check_within(body, f"nodal diameter {d}", "a lowest frequency of", BOUNDS.frequency, lowest, "Hz", hint)
