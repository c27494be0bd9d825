"""The reference sector and damper as another program would hand them over: numbers, sets and bare matrices."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from bdamper.fe.sector import SectorFE
from bdamper.io import FEBody

FIRST_NUMBER = 101
"""Node numbers start here, so that an index taken for a number shows."""


def corners_first(elements):
    """Elements with the corners in the common order, then the nodes between them."""
    from bdamper.fe.calculix import local_order

    return elements[:, local_order()]


def sector_and_damper(fe: SectorFE) -> tuple[FEBody, FEBody]:
    """Both bodies with the sets that a user would define."""
    g = fe.geometry
    out = []
    for disc in (fe.blade, fe.damper.body):
        numbers = FIRST_NUMBER + np.arange(len(disc.nodes))
        out.append(
            FEBody(
                numbers=numbers,
                nodes=disc.nodes.copy(),
                stiffness=sp.csr_matrix(disc.stiffness),
                mass=sp.csr_matrix(disc.mass),
                elements=(numbers[corners_first(disc.elements)],),
                source="test",
            )
        )
    blade, damper = out
    half = np.array([[np.cos(0.5 * g.pitch), -np.sin(0.5 * g.pitch), 0], [np.sin(0.5 * g.pitch), np.cos(0.5 * g.pitch), 0], [0, 0, 1]])

    def on_plane(nodes, side):
        """Nodes in the plane of a face of the damper; for the blade, below the edge of its platform."""
        p = nodes @ half.T  # axes of the damper between blade 0 and blade 1
        sign = 1.0 if side == "right" else -1.0
        n = np.array([sign * np.cos(g.face_angle), np.sin(g.face_angle)])
        start = np.array([sign * 0.5 * g.ridge_width, g.ridge_radius])
        return np.abs((p[:, :2] - start) @ n) < 1e-9

    blade.node_sets.update(
        bore=blade.numbers[fe.clamped],
        low=blade.numbers[fe.left],
        high=blade.numbers[fe.right],
        right_underside=blade.numbers[on_plane(blade.nodes, "left")],
    )
    turned = blade.nodes @ np.linalg.matrix_power(half.T @ np.eye(3), 1)  # one pitch on: half a pitch twice
    turned = blade.nodes @ (half.T @ half.T).T
    blade.node_sets["left_underside"] = blade.numbers[on_plane(turned, "right")]
    for side in ("left", "right"):
        damper.node_sets[side] = damper.numbers[on_plane(damper.nodes, side)]
    z = damper.nodes[:, 2]
    damper.node_sets["front"] = damper.numbers[z > 0.5 * g.face_width - 1e-9]
    damper.node_sets["back"] = damper.numbers[z < -0.5 * g.face_width + 1e-9]
    return blade, damper
