"""Stress of an imported blade at node sets: nodes, elements and elastic constants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bdamper.fem.contact_patches import Patches
from bdamper.importers.contact_faces import LaidContacts
from bdamper.importers.options import Sector
from bdamper.importers.prepared_body import CyclicStructure, PreparedBody
from bdamper.model.structure import turn
from bdamper.util import validation
from bdamper.util.errors import import_extra, warn_implausible

if TYPE_CHECKING:
    from bdamper.fem.element_stress import Solids, StressRows


def stress_rows(
    body: PreparedBody, sector: Sector, laid: LaidContacts, ring: CyclicStructure
) -> list[StressRows]:
    """Return the rows that recover the stress at sets of nodes of a blade.

    Parameters
    ----------
    body : PreparedBody
    sector : Sector
        Contains the node sets; a single name is also the name of the stress set.
    laid : LaidContacts
        Contact points; stress near them is marked.
    ring : CyclicStructure
        Sector faces.

    Returns
    -------
    list of StressRows

    Raises
    ------
    ModelError, SettingError
        If a set does not exist, the body has no matrices, or an element has no elastic constants.
    BdamperError
        If scikit-fem is not installed.
    """
    sets = sector.stress
    if sets is None:
        return []
    import_extra("skfem", "stress of an import", "fe")
    from bdamper.fem.element_stress import StressRows, near_patches

    expected = "a blade with its matrices"
    found = "only modes; use StressSet arrays instead"
    validation.check(body.has_matrices, "stress", expected, found)
    if isinstance(sets, str):
        sets = {sets: sets}
    elif not isinstance(sets, Mapping):
        sets = {"stress": sets}
    faces = _contact_patches(body, laid, ring)
    nodes_with_points = laid.rows[body.name].indices // 3
    out = []
    for name, members in sets.items():
        item = f"stress '{name}'"
        nodes = _away_from_cuts(body, body.node_set(members, item), ring, item)
        solids = _solids(body, nodes, sector.elasticity, item)
        near = near_patches(body.nodes[nodes], *faces) | np.isin(nodes, nodes_with_points)
        with body.refusing(item, "elements with a volume and all midside nodes"):
            out.append(StressRows(name, solids, body.nodes, nodes, near))
        body.passed(f"{item}: {len(nodes)} nodes, {int(near.sum())} of them next to a contact face")
    return out


def check_surface(body: PreparedBody, name: str, largest: int) -> None:
    """Warn if the largest stress of a set is at a node inside the body, node index ``largest``.

    The stress inside is as accurate as at the surface, but a set whose largest stress is inside
    does not contain the surface where the stress is larger.  A section through the body may
    contain nodes inside.
    """
    if largest in body.boundary.nodes:
        return
    item = f"stress '{name}'"
    found = f"node {body.raw.numbers[largest]} inside the body"
    remedy = "the set lacks the surface near it, where the stress is larger; add its nodes"
    body.report.missing.append(f"{item}: the largest stress is at {found}; {remedy}")
    warn_implausible(item, "the largest stress at a surface node", f"{found}; {remedy}")


def _contact_patches(
    body: PreparedBody, laid: LaidContacts, ring: CyclicStructure
) -> list[Patches]:
    """Return the contact patches on a blade, turned to its own sector."""
    patches = []
    for name, side in laid.ports[body.name]:
        face = laid.interfaces[name]
        sector = face.sector_a if side == "a" else face.sector_b
        back = turn(-2.0 * np.pi / ring.faces.n_sectors * sector)
        # squares with the areas of the points: sides (n_points, 2) along t1 and t2
        sides = np.sqrt(face.area)[:, None] * [1.0, 1.0]
        patches.append(Patches(centre=face.points @ back.T, frame=face.frame @ back.T, size=sides))
    return patches


def _away_from_cuts(
    body: PreparedBody, nodes: NDArray, ring: CyclicStructure, item: str
) -> NDArray:
    """Return the nodes that are not on the sector faces, where elements of other sectors contribute
    to the stress.
    """
    inner = nodes[~np.isin(nodes, ring.faces.nodes)]
    on_faces = "all nodes lie on the sector faces"
    body.require_sentence(len(inner) > 0, item, on_faces)
    n_left_out = len(nodes) - len(inner)
    if n_left_out:
        body.report.missing.append(f"{item}: {n_left_out} nodes on the sector faces are omitted")
    nodes_of_elements = body.used if body.elements else np.empty(0, int)
    loose = np.setdiff1d(inner, nodes_of_elements)
    if len(loose):
        body.require_sentence(
            False, item, f"node {body.raw.numbers[loose[0]]} belongs to no solid element"
        )
    return inner


def _solids(
    body: PreparedBody, nodes: NDArray, constants: Sequence[float] | None, item: str
) -> tuple[Solids, ...]:
    """Return the elements at nodes, with elastic constants in SI units."""
    from bdamper.fem.element_stress import Solids

    units = body.placement.units
    pascals = units.mass / units.length
    solids = []
    for kind, elements in zip(body.kinds, body.elements):
        if not np.isin(elements, nodes).any():
            continue
        young, poisson = kind.youngs_modulus, kind.poisson_ratio
        if constants is not None:
            young, poisson = constants
        if young is None or poisson is None:
            expected = (
                "elastic constants in the file, "
                "or Sector(elasticity=(modulus, Poisson's ratio)) in its units"
            )
            raise body.error(f"{item}, elements {kind.name}", expected, "neither")
        if not (young > 0.0 and -1.0 < poisson < 0.5):
            expected = "a modulus > 0 and a Poisson's ratio above -1 and below 0.5"
            raise body.error(f"{item}, elasticity", expected, f"{young:g}, {poisson:g}")
        solids.append(Solids(kind.name, elements, pascals * float(young), float(poisson)))
    return tuple(solids)
