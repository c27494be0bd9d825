"""Node sets of the reference sector and damper: those that a user of another program would define by hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bdamper.fe.geometry import Geometry, turn
from bdamper.fe.sector import SectorFE


def _on_face_plane(nodes: NDArray, g: Geometry, side: str) -> NDArray:
    """Nodes (n,), given in the axes of blade 0, in the plane of the damper's left or right face."""
    own = nodes @ turn(-0.5 * g.pitch).T
    sign = 1.0 if side == "right" else -1.0
    normal = np.array([sign * np.cos(g.face_angle), np.sin(g.face_angle)])
    ridge = np.array([sign * 0.5 * g.ridge_width, g.ridge_radius])
    return np.flatnonzero(np.abs((own[:, :2] - ridge) @ normal) < 1e-9)


def blade_sets(fe: SectorFE) -> dict[str, NDArray]:
    """Node sets of the sector: BORE (clamped), LOW and HIGH (sector faces toward -X and +X), and the two undersides
    of the platform, of which RIGHT_UNDERSIDE touches the damper of this sector and LEFT_UNDERSIDE that of the one before.
    """
    ahead = fe.blade.nodes @ turn(fe.geometry.pitch).T
    return {
        "BORE": fe.clamped,
        "LOW": fe.left,
        "HIGH": fe.right,
        "RIGHT_UNDERSIDE": _on_face_plane(fe.blade.nodes, fe.geometry, "left"),
        "LEFT_UNDERSIDE": _on_face_plane(ahead, fe.geometry, "right"),
    }


def damper_sets(fe: SectorFE) -> dict[str, NDArray]:
    """Node sets of the damper: its contact faces LEFT and RIGHT, its end faces FRONT (+Z) and BACK."""
    nodes, half = fe.damper.body.nodes, 0.5 * fe.geometry.face_width
    return {
        "LEFT": _on_face_plane(nodes, fe.geometry, "left"),
        "RIGHT": _on_face_plane(nodes, fe.geometry, "right"),
        "FRONT": np.flatnonzero(nodes[:, 2] > half - 1e-9),
        "BACK": np.flatnonzero(nodes[:, 2] < -half + 1e-9),
    }
