"""Whether the rows of the matrices stand in the order that the table of nodes and components says.

A rigid motion of all nodes costs no force at a node that neither is held nor has a held neighbour: the rows of its three
components sum to nothing over all components that they couple.  Rows in another order than the table's (all x, then all y,
then all z, instead of node by node) have forces of the size of the stiffness itself at nearly every node.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.io.bounds import BOUNDS
from bdamper.io.prepare import PreparedBody
from bdamper.reduction.free_body import rigid_motions


def strained_share(body: PreparedBody) -> float | None:
    """Share of the nodes away from held ones on which a rigid motion of all nodes has a force; None without such nodes."""
    structure, used = body.structure, np.zeros(len(body.nodes), bool)
    used[body.used] = True
    near: NDArray = np.asarray(body.fixed(None).any(axis=1))
    for elements in body.elements:
        near[elements[near[elements].any(axis=1)]] = True
    away = used & ~near
    if not away.any():
        return None
    centre = 0.5 * (structure.nodes.min(axis=0) + structure.nodes.max(axis=0))
    motion = rigid_motions(structure.nodes, centre, np.eye(3))
    motion[:, :3] *= body.size

    def size(force: NDArray) -> NDArray:
        return np.linalg.norm(force.reshape(-1, 3, 6), axis=1)[away]

    parts = size(abs(structure.stiffness) @ np.abs(motion))
    ratio = size(structure.stiffness @ motion) / np.maximum(parts, 1e-300)
    return float((ratio.max(axis=1) > BOUNDS.rigid_force).mean())


def _order_that_fits(body: PreparedBody) -> str | None:
    """Another order of the rows in which rigid motions cost no force, in words."""
    default = np.stack([np.repeat(body.given.numbers, 3), np.tile([1, 2, 3], len(body.nodes))], axis=1)
    listed = default if body.given.dofs is None else np.asarray(body.given.dofs)
    place = body.index(listed[:, 0], "table of nodes and components")
    orders = {
        "component by component (all x, then all y, then all z)": np.lexsort((place, listed[:, 1])),
        "node by node (x, y, z of each)": np.lexsort((listed[:, 1], place)),
    }
    for words, order in orders.items():
        if np.array_equal(order, np.arange(len(order))):
            continue
        other = PreparedBody(body.name, replace(body.given, dofs=listed[order]), body.place)
        share = strained_share(other)
        if share is not None and share <= BOUNDS.odd_ones:
            return words
    return None


def check_row_order(body: PreparedBody) -> None:
    """Refuse matrices whose rows do not belong to the nodes and components of the table.

    Without elements nothing tells which nodes are neighbours of held ones: what another order explains is refused then,
    and nothing else.

    Raises
    ------
    ModelError
        It names the order that fits, if one does.
    """
    share = strained_share(body)
    if share is None:
        body.checks.append(f"{body.name}: order of the rows not checked, every node is a neighbour of a held one")
        return
    if share <= BOUNDS.odd_ones:
        where = "no force on any node" if share == 0.0 else f"a force on {100 * share:.2g} % of the nodes only"
        body.checks.append(f"{body.name}: away from held nodes rigid motions cost {where}, so rows are those of the table")
        return
    order = _order_that_fits(body)
    if order is None and (not body.elements or body.name != "blade"):
        return
    hint = "positions that do not belong to the nodes, or a table in another order than the rows"
    if order is not None:
        hint = f"none if the rows come {order}: give dofs=(node, component) of each row in that order"
    item, expected = "stiffness matrix", "rows x, y, z of one node after the other"
    if body.given.dofs is not None:
        item, expected = "stiffness matrix and table of nodes and components", "rows in the order of the table"
    where = f"forces on {100 * share:.3g} % of the nodes away from held ones when the body moves as a rigid one"
    raise body.error(item, expected, f"{where}; {hint}")
