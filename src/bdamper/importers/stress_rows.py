"""Stress sets of an imported blade, from its elements and the displacements of every vector that the model carries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bdamper.fem.contact_patches import Patches
from bdamper.importers.contact_faces import LaidContacts
from bdamper.importers.fe_body import ElementKind
from bdamper.importers.prepared_body import NodeSet, PreparedBody, Ring
from bdamper.model.structure import turn
from bdamper.util import validation
from bdamper.util.errors import needed

if TYPE_CHECKING:
    from bdamper.fem.element_stress import Solids
    from bdamper.fem.stress_rows import StressRows


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
    needed("skfem", "stress of an import", "fe")
    from bdamper.fem.stress_rows import StressRows, near_patches

    validation.require(
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
