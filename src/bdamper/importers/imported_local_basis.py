"""The local basis of an imported sector, for mistuned wheels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.reduced_bodies import Wanted
from bdamper.fem.sector_local_basis import BladePart, LocalSizes, damper_motion, local_basis
from bdamper.importers.prepared_body import NodeSet, PreparedBody, Ring
from bdamper.model.structure import Body, Interface
from bdamper.util.errors import SettingError


def blade_part(
    body: PreparedBody, wanted: Wanted, ring: Ring, fixed: NDArray, blade: NodeSet,
    interfaces: Mapping[str, Interface],
) -> BladePart:  # fmt: skip
    """The blade within a sector.

    Parameters
    ----------
    body, wanted, ring, fixed
        As in :func:`bdamper.importers.bodies_from_matrices.constrained_from_matrices`.
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
