r"""Contact points as averages over patches of a plane face.

A rectangular contact face is divided into patches, each of which is one contact point.  Displacement and
force of patch i with area :math:`A_i` are exchanged by

.. math:: B_i = \frac{1}{A_i}\int_{A_i} N\,dA, \qquad u_i = B_i u, \qquad f = \textstyle\sum_i B_i^T F_i ,

so a force is spread evenly over its patch and works on the mean displacement.  Receptances between single
nodes diverge when the mesh is refined, those between patches converge, and patches need not match the mesh.

The face of a 20-node element in the plane is a quadrilateral with 8 nodes.  Each is cut to the patch
(Sutherland-Hodgman), the polygon is split into triangles, and each triangle integrated with seven points; the
map from the element's square :math:`(\xi, \eta)` is bilinear and is inverted by Newton's method.  The weights
of a patch are divided by their sum, so a rigid motion is averaged to its value at the patch's centre up to
rounding.

Contact axes, with a the angle of a face from the radial axis, in the axes of the damper (rows t1, t2, n)::

    left   (sin a, cos a, 0)    (0, 0, -1)   (-cos a, sin a, 0)
    right  (sin a, -cos a, 0)   (0, 0, -1)   ( cos a, sin a, 0)
    front  (1, 0, 0)            (0, 1, 0)    (0, 0, 1)
    back   (1, 0, 0)            (0, -1, 0)   (0, 0, -1)

so t1 lies in the cross-section, n is the outward normal of the damper, and t1, t2, n is right-handed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fe.assemble import Discretisation
from bdamper.fe.geometry import Geometry, turn

# Seven points on a triangle, exact for degree 5: barycentric coordinates and weights (sum 1).
_A, _B = (6.0 - np.sqrt(15.0)) / 21.0, (6.0 + np.sqrt(15.0)) / 21.0
_BARYCENTRIC = np.array(
    [[1 / 3, 1 / 3, 1 / 3]]
    + [
        [c if i == j else a for j in range(3)]
        for a, c in ((_A, 1 - 2 * _A), (_B, 1 - 2 * _B))
        for i in range(3)
    ]
)
_WEIGHTS = np.array([0.225] + 3 * [(155 - np.sqrt(15)) / 1200] + 3 * [(155 + np.sqrt(15)) / 1200])

_SIGNS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)


@dataclass(frozen=True)
class Patches:
    """Rectangular patches in planes, all of one interface.

    Parameters
    ----------
    centre : (n, 3) float, m
    frame : (n, 3, 3) float
        Rows t1, t2, n.
    size : (n, 2) float, m
        Edges along t1 and t2.
    """

    centre: NDArray
    frame: NDArray
    size: NDArray

    @property
    def area(self) -> NDArray:
        """Areas (n,), m2."""
        return self.size.prod(axis=1)

    def turned(self, rotation: NDArray) -> Patches:
        """The patches after a rotation (3, 3)."""
        return Patches(self.centre @ rotation.T, self.frame @ rotation.T, self.size)


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


def patch_grid(points: int | tuple[int, int], length: float, width: float) -> tuple[int, int]:
    """Number of patches along the slope and along the axis.

    A plain number is split into two factors so that the patches come as close to squares as they can.
    """
    if not isinstance(points, (int, np.integer)):
        return int(points[0]), int(points[1])
    if points < 1:
        raise ValueError(f"points must be at least 1, not {points}")
    factors = [n for n in range(1, points + 1) if points % n == 0]
    n_s = min(factors, key=lambda n: (abs(np.log(length / n / (width / (points // n)))), n))
    # Nine points are meant as three by three, although longer patches would be closer to squares then.
    root = round(np.sqrt(points))
    return (root, root) if root * root == points else (n_s, points // n_s)


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


def _face_elements(body: Discretisation, centre: NDArray, frame: NDArray) -> tuple[NDArray, NDArray]:
    """Boundary quadrilaterals in the plane through ``centre``: nodes (n, 8), corners (n, 4, 2) along t1, t2.

    The corners run around the square in the order of ``_SIGNS``; node 4 + c lies between corners c and c + 1.
    """
    mesh = body.mesh
    local = (body.nodes - centre) @ frame.T
    facets = mesh.facets[:, mesh.boundary_facets()].T
    facets = facets[np.abs(local[facets, 2]).max(axis=1) < 1e-8]
    corner = local[facets, :2]
    mean = corner.mean(axis=1, keepdims=True)
    angle = np.arctan2(corner[..., 1] - mean[..., 1], corner[..., 0] - mean[..., 0])
    order = np.argsort(angle, axis=1)
    facets, corner = np.take_along_axis(facets, order, 1), np.take_along_axis(corner, order[..., None], 1)
    n = len(mesh.p[0])
    edge = {pair: n + e for e, pair in enumerate(map(tuple, np.sort(mesh.edges, axis=0).T.tolist()))}
    middle = [[edge[tuple(sorted((q[c], q[(c + 1) % 4])))] for c in range(4)] for q in facets.tolist()]
    return np.concatenate([facets, np.array(middle, int).reshape(-1, 4)], axis=1), corner


def _clip_to_rectangle(polygon: NDArray, half: NDArray) -> NDArray:
    """Part (m, 2) of a convex polygon with ``|x| <= half[0]`` and ``|y| <= half[1]``."""
    for axis in (0, 1):
        for sign in (1.0, -1.0):
            out = []
            d = half[axis] - sign * polygon[:, axis]
            for k in range(len(polygon)):
                a, b, da, db = polygon[k - 1], polygon[k], d[k - 1], d[k]
                if da * db < 0.0:
                    out.append(a + (b - a) * da / (da - db))
                if db >= 0.0:
                    out.append(b)
            if len(out) < 3:
                return np.empty((0, 2))
            polygon = np.array(out)
    return polygon


def _quadrature(polygon: NDArray) -> tuple[NDArray, NDArray]:
    """Points (m, 2) and weights (m,) on a convex polygon."""
    triangles = np.stack([np.broadcast_to(polygon[0], polygon[2:].shape), polygon[1:-1], polygon[2:]], axis=1)
    d1, d2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = 0.5 * np.abs(d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0])
    return (_BARYCENTRIC @ triangles).reshape(-1, 2), np.outer(area, _WEIGHTS).ravel()


def _inverse_map(corner: NDArray, x: NDArray) -> NDArray:
    """Coordinates (m, 2) on the square of points ``x`` (m, 2) in the quadrilateral ``corner`` (4, 2)."""
    xi = np.zeros_like(x)
    for _ in range(20):
        shape = 0.25 * (1 + xi[:, :1] * _SIGNS[:, 0]) * (1 + xi[:, 1:] * _SIGNS[:, 1])
        d_xi = 0.25 * _SIGNS[:, 0] * (1 + xi[:, 1:] * _SIGNS[:, 1]) @ corner
        d_eta = 0.25 * _SIGNS[:, 1] * (1 + xi[:, :1] * _SIGNS[:, 0]) @ corner
        r = x - shape @ corner
        det = d_xi[:, 0] * d_eta[:, 1] - d_xi[:, 1] * d_eta[:, 0]
        step = np.stack(
            [
                (r[:, 0] * d_eta[:, 1] - r[:, 1] * d_eta[:, 0]) / det,
                (d_xi[:, 0] * r[:, 1] - d_xi[:, 1] * r[:, 0]) / det,
            ],
            axis=-1,
        )
        xi += step
        if np.abs(step).max() < 1e-14:
            break
    return xi


def _serendipity(xi: NDArray) -> NDArray:
    """Shape functions (m, 8) of the quadrilateral: corners as in ``_SIGNS``, then middles of the edges."""
    a, b = xi[:, :1], xi[:, 1:]
    sa, sb = _SIGNS[:, 0], _SIGNS[:, 1]
    corners = 0.25 * (1 + a * sa) * (1 + b * sb) * (a * sa + b * sb - 1)
    bottom, top = 0.5 * (1 - a**2) * (1 - b), 0.5 * (1 - a**2) * (1 + b)
    right, left = 0.5 * (1 + a) * (1 - b**2), 0.5 * (1 - a) * (1 - b**2)
    return np.hstack([corners, bottom, right, top, left])


def averaging_matrix(body: Discretisation, patches: Patches) -> sp.csr_matrix:
    """Matrix (3 n_patches, 3 n_nodes) from nodal displacements to patch means along t1, t2, n.

    Raises
    ------
    ValueError
        If the surface of ``body`` does not cover a patch.
    """
    row: list[int] = []
    column: list[int] = []
    data: list[float] = []
    origin, axes = patches.centre[0], patches.frame[0]
    nodes, corners = _face_elements(body, origin, axes)
    for i, (centre, frame, size) in enumerate(zip(patches.centre, patches.frame, patches.size)):
        # Patches of one face share the plane of the first: its elements are looked up once.
        if abs((centre - origin) @ axes[2]) > 1e-9 or not np.allclose(axes, frame):
            origin, axes = centre, frame
            nodes, corners = _face_elements(body, origin, axes)
        local = corners - (frame[:2] @ (centre - origin))
        near = np.all((local.min(axis=1) < 0.5 * size) & (local.max(axis=1) > -0.5 * size), axis=1)
        weight: dict[int, float] = {}
        total = 0.0
        for quad, corner in zip(nodes[near], local[near]):
            polygon = _clip_to_rectangle(corner, 0.5 * size)
            if len(polygon) < 3:
                continue
            x, w = _quadrature(polygon)
            for node, value in zip(quad.tolist(), w @ _serendipity(_inverse_map(corner, x))):
                weight[node] = weight.get(node, 0.0) + value
            total += w.sum()
        if abs(total - size.prod()) > 1e-6 * size.prod():
            raise ValueError(
                f"patch {i} at {centre} m has an area of {size.prod():.6g} m2, "
                f"but the surface of the body covers {total:.6g} m2 of it"
            )
        for node, value in weight.items():
            for c in range(3):
                row += [3 * i + c] * 3
                column += [3 * node, 3 * node + 1, 3 * node + 2]
                data += (frame[c] * value / total).tolist()
    return sp.csr_matrix((data, (row, column)), shape=(3 * len(patches.size), body.n_dof))
