"""Whether the corners of solid elements stand in the order that the faces are read from.

Hexahedra: four corners in turn around one face, then the four opposite ones in the same turn, so that corner 5 is joined to
corner 1; wedges alike with three.  Either sense of rotation will do.  Nodes between corners may come in any order.

The normals at the four corners of a face then look to one side; in any other order some face crosses itself or is bent by a
right angle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bdamper.io.bounds import BOUNDS
from bdamper.io.prepare import PreparedBody
from bdamper.reduction.facets import FACES, N_CORNER

_QUADRILATERALS = {n: np.array([face for face in FACES[n] if len(face) == 4]) for n in (6, 8)}
"""Corners of the faces with four of them, in turn."""
_OTHERS = {8: {"in rows, as (0,0,0), (1,0,0), (0,1,0), (1,1,0), (0,0,1) ...": [0, 1, 3, 2, 4, 5, 7, 6]}, 6: {}}


def twisted(corners: NDArray, nodes: NDArray) -> NDArray:
    """Whether some face of each element has corners whose normals look to opposite sides.

    Parameters
    ----------
    corners : (n, 6 | 8) int
    nodes : (n_nodes, 3) float

    Returns
    -------
    (n,) bool
    """
    x = nodes[corners][:, _QUADRILATERALS[corners.shape[1]]]  # (n, faces, 4, 3)
    normal = np.cross(np.roll(x, -1, axis=2) - x, np.roll(x, 1, axis=2) - x)
    length = np.linalg.norm(normal, axis=-1)
    size = np.ptp(x, axis=(1, 2)).max(axis=1)[:, None, None] ** 2
    flat = np.where(length > BOUNDS.same_place * size, length, np.inf)[..., None]  # a collapsed corner has no normal
    cosine = np.einsum("efic,efjc->efij", normal / flat, normal / flat)
    known = np.isfinite(flat) & np.isfinite(flat).swapaxes(-1, -2)
    return np.asarray((known & (cosine < BOUNDS.corner_cosine)).any(axis=(1, 2, 3)))


def check_corner_order(body: PreparedBody) -> None:
    """Refuse elements whose corners stand in another order.

    Raises
    ------
    ModelError
        Naming the first such element, and the order that fits it if it is a known one.
    """
    n_checked = 0
    for elements, given in zip(body.elements, body.given.elements):
        n = N_CORNER.get(elements.shape[1], 0)
        if n not in _QUADRILATERALS:
            continue
        corners = elements[:, :n]
        wrong = np.flatnonzero(twisted(corners, body.nodes))
        n_checked += len(elements)
        if not len(wrong):
            continue
        fits = [name for name, order in _OTHERS[n].items() if not twisted(corners[wrong][:, order], body.nodes).any()]
        if fits or len(wrong) > BOUNDS.odd_ones * len(elements):
            item = f"elements, that of nodes {np.asarray(given)[wrong[0], :n].tolist()}"
            expected = f"{n // 2} corners in turn around one face, then the {n // 2} opposite ones in the same turn"
            found = f"another order in {len(wrong)} of {len(elements)}" + (f": corners come {fits[0]}" if fits else "")
            raise body.error(item, expected, found)
    if n_checked:
        body.checks.append(f"{body.name}: corners of {n_checked} hexahedra and wedges stand in the agreed order")
