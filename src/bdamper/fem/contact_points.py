"""Contact points and contact axes of the reference model (paper, Figs. 1 and 3): rectangular patches of its plane faces.

Contact axes, with a the angle of a face from the radial axis, in the axes of the damper (rows t1, t2, n)::

    left   (sin a, cos a, 0)    (0, 0, -1)   (-cos a, sin a, 0)
    right  (sin a, -cos a, 0)   (0, 0, -1)   ( cos a, sin a, 0)
    front  (1, 0, 0)            (0, 1, 0)    (0, 0, 1)
    back   (1, 0, 0)            (0, -1, 0)   (0, 0, -1)

so t1 lies in the cross-section, n is the outward normal of the damper, and t1, t2, n is right-handed.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fem.assembly import Discretisation
from bdamper.fem.contact_patches import Patches, patch_grid, patches_on_rectangles
from bdamper.fem.geometry import Geometry, turn


def face_frame(name: str, face_angle: float) -> NDArray:
    """Rows t1, t2, n (3, 3) of a face of the damper ("left", "right", "front", "back") in its own axes."""
    s, c = np.sin(face_angle), np.cos(face_angle)
    frames = {
        "left": [[s, c, 0], [0, 0, -1], [-c, s, 0]],
        "right": [[s, -c, 0], [0, 0, -1], [c, s, 0]],
        "front": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "back": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    }
    return np.array(frames[name], float)


def wedge_patches(g: Geometry, side: str, points: int | tuple[int, int]) -> Patches:
    """Patches of the damper's ``"left"`` or ``"right"`` face, at its place, in the axes of blade 0."""
    n_s, n_z = patch_grid(points, g.face_length, g.face_width)
    s = (np.arange(n_s) + 0.5) * g.face_length / n_s
    z = ((np.arange(n_z) + 0.5) / n_z - 0.5) * g.face_width
    plane = g.face_points(s) * ([1.0, 1.0] if side == "left" else [-1.0, 1.0])
    centre = np.empty((n_s, n_z, 3))
    centre[..., :2], centre[..., 2] = plane[:, None], z
    n = n_s * n_z
    frame = np.broadcast_to(face_frame(side, g.face_angle), (n, 3, 3))
    size = np.broadcast_to([g.face_length / n_s, g.face_width / n_z], (n, 2))
    return Patches(centre.reshape(-1, 3), frame, size).turned(turn(0.5 * g.pitch))


def end_patches(g: Geometry, side: str) -> Patches:
    """Four small patches near the corners of the damper's ``"front"`` (+Z) or ``"back"`` (-Z) end face."""
    eaves = g.ridge_radius - g.face_length * np.cos(g.face_angle)
    width = 0.5 * g.ridge_width + g.face_length * np.sin(g.face_angle)
    z = (0.5 if side == "front" else -0.5) * g.face_width
    low, high = eaves - 0.78 * g.damper_body_height, eaves
    centre = np.array([[sx * f * width, y, z] for y, f in ((low, 0.78), (high, 0.5)) for sx in (-1.0, 1.0)])
    frame = np.broadcast_to(face_frame(side, g.face_angle), (4, 3, 3))
    edge = 0.35 * min(width, g.damper_body_height)
    return Patches(centre, frame, np.full((4, 2), edge)).turned(turn(0.5 * g.pitch))


def averaging_matrix(body: Discretisation, patches: Patches) -> sp.csr_matrix:
    """Matrix (3 n_patches, 3 n_nodes) from nodal displacements to patch means along t1, t2, n.

    Raises
    ------
    ValueError
        If the surface of ``body`` does not cover a patch.
    """
    return patches_on_rectangles(patches, body.nodes, body.surface).matrix_a
