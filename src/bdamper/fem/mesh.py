r"""Hexahedral meshes of one sector and of the wedge damper, made of structured blocks.

Every block is a logical box of nodes ``(i, j, k)``: ``i`` across the sector (X), ``j`` outward (Y), ``k``
along the axis (Z).  Disk and platform use all columns, the shank the middle ones of ``i``, the airfoil the
middle ones of ``i`` and of ``k``; blocks share the layer of nodes on which they meet, so the mesh conforms.

Airfoil section at the height fraction :math:`\eta`, with :math:`\xi \in [-1, 1]` along the chord and
:math:`\zeta \in [-1, 1]` through the thickness,

.. math:: x = \kappa(\tfrac13 - \xi^2) + \tfrac12 \zeta\, t(\eta)(1 - \tfrac34 \xi^2),\qquad
          z = \tfrac12 \xi\, c(\eta),

turned about Y by :math:`\eta` times the twist; chord c, thickness t vary linearly.  Elements have straight
edges: midside nodes are the midpoints, so that the trilinear map of the eight corners is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skfem import MeshHex

from bdamper.fem.geometry import Geometry, turn
from bdamper.util import validation

# Local corners in the order in which scikit-fem numbers them.


@dataclass(frozen=True)
class MeshDensity:
    """Numbers of elements.

    Parameters
    ----------
    centre : int
        Through the thickness of shank and airfoil; even, so that a node lies on the mean line.
    contact, fillet : int
        Across each wing of the platform: under the contact face, and from there to the shank.
    chord : int
        Along the chord of the airfoil; even.  Disk, shank and platform have two more.
    disk, shank, platform, airfoil : int
        Along the radius.
    damper_face, damper_ridge, damper_height, damper_length : int
    """

    centre: int
    contact: int
    fillet: int
    chord: int
    disk: int
    shank: int
    platform: int
    airfoil: int
    damper_face: int
    damper_ridge: int
    damper_height: int
    damper_length: int

    @classmethod
    def preset(cls, name: str) -> MeshDensity:
        """The density called ``"coarse"`` or ``"reference"``."""
        presets = {"coarse": (2, 2, 1, 4, 2, 2, 1, 6, 3, 1, 2, 6), "reference": (2, 4, 1, 8, 5, 6, 3, 24, 5, 1, 4, 9)}
        return cls(*presets[validation.choice("mesh", name, presets)])


def join_blocks(blocks: list[NDArray]) -> MeshHex:
    """One mesh from structured blocks of node positions.

    Parameters
    ----------
    blocks : list of (ni, nj, nk, 3) float, m
        Positions that two blocks share must be equal to 1e-9 m.
    """
    points, cells, start = [], [], 0
    corners = ((1, 1, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0))
    for block in blocks:
        shape = block.shape[:3]
        number = start + np.arange(np.prod(shape)).reshape(shape)
        ends = [slice(c, n - 1 + c) for c in (0, 1) for n in shape]
        corner = [number[ends[3 * a], ends[3 * b + 1], ends[3 * c + 2]].ravel() for a, b, c in corners]
        cells.append(np.array(corner))
        points.append(block.reshape(-1, 3))
        start += number.size
    p, t = np.concatenate(points), np.concatenate(cells, axis=1)
    _, first, inverse = np.unique(np.round(p / 1e-9).astype(np.int64), axis=0, return_index=True, return_inverse=True)
    return MeshHex(np.ascontiguousarray(p[first].T), np.ascontiguousarray(inverse.reshape(-1)[t]))


def _layers(bottom: NDArray, top: NDArray, n: int) -> NDArray:
    """Straight interpolation in ``n`` steps between two sheets (ni, nk, 3): a block (ni, n + 1, nk, 3)."""
    w = np.linspace(0.0, 1.0, n + 1)[None, :, None, None]
    block = (1.0 - w) * bottom[:, None] + w * top[:, None]
    block[:, 0], block[:, -1] = bottom, top
    return block


def _airfoil_section(g: Geometry, zeta: NDArray, xi: NDArray, eta: float, root: float) -> NDArray:
    """Sheet (n_zeta, n_xi, 3) of the airfoil at the height fraction ``eta``, m."""
    zeta, xi = np.meshgrid(zeta, xi, indexing="ij")
    chord = g.root_chord + eta * (g.tip_chord - g.root_chord)
    thickness = g.root_thickness + eta * (g.tip_thickness - g.root_thickness)
    x = g.camber * (1.0 / 3.0 - xi**2) + 0.5 * zeta * thickness * (1.0 - 0.75 * xi**2)
    z = 0.5 * xi * chord
    c, s = np.cos(eta * g.twist), np.sin(eta * g.twist)
    return np.stack([c * x + s * z, np.full_like(x, root + eta * g.airfoil_height), c * z - s * x], axis=-1)


def sector_blocks(g: Geometry, n: MeshDensity) -> list[NDArray]:
    """Blocks of disk segment, shank, platform and airfoil of blade 0, in this order."""
    half = 0.5 * g.pitch
    xi = np.linspace(-1.0, 1.0, n.chord + 1)
    zeta = np.linspace(-1.0, 1.0, n.centre + 1)
    z = np.concatenate([[-0.5 * g.axial_length], 0.5 * g.root_chord * xi, [0.5 * g.axial_length]])
    nx, nz = n.centre + 1 + 2 * (n.contact + n.fillet), len(z)
    middle = slice(n.contact + n.fillet, n.contact + n.fillet + n.centre + 1)

    # Underside of the platform, from the left edge over the shank to the right edge.
    edge, shank = g.underside_range
    s = np.concatenate(
        [np.linspace(shank, g.face_length, n.fillet + 1)[:-1], np.linspace(g.face_length, edge, n.contact + 1)]
    )
    wing = g.underside_points(s)
    flat = np.stack([0.5 * g.shank_width * zeta[1:-1], np.full(n.centre - 1, wing[0, 1])], axis=-1)
    under = np.concatenate([wing[::-1] * [-1.0, 1.0], flat, wing])
    bottom = np.empty((nx, nz, 3))
    bottom[..., :2], bottom[..., 2] = under[:, None], z[None]

    # Top of the platform: the root of the airfoil in the middle, straight lines from there to the edges.
    corner = turn(half)[:2, :2] @ [-0.5 * g.platform_clearance, g.ridge_radius + g.platform_edge_thickness]
    top = np.empty_like(bottom)
    top[..., 1] = corner[1]
    root = _airfoil_section(g, zeta, xi, 0.0, corner[1])
    root = np.concatenate([root[:, :1], root, root[:, -1:]], axis=1)
    fraction = ((shank - s) / (shank - edge))[:, None]
    top[middle, :, 0] = root[..., 0]
    right, left = slice(middle.stop - 1, None), slice(0, middle.start + 1)
    top[right, :, 0] = (1.0 - fraction) * root[-1, :, 0] + fraction * corner[0]
    top[left, :, 0] = ((1.0 - fraction) * root[0, :, 0] - fraction * corner[0])[::-1]
    top[..., 2] = z

    # Disk: radial columns, spaced at the rim like the columns of the platform.
    shank_angle = 0.5 * g.shank_width / g.rim_radius
    wing_angle = shank_angle + fraction[:, 0] * (half - shank_angle)
    angle = np.concatenate([-wing_angle[::-1], shank_angle * zeta[1:-1], wing_angle])
    direction = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    rim, bore = np.empty_like(bottom), np.empty_like(bottom)
    for sheet, radius in ((rim, g.rim_radius), (bore, g.bore_radius)):
        sheet[..., :2], sheet[..., 2] = radius * direction[:, None], z[None]

    sections = [_airfoil_section(g, zeta, xi, eta, corner[1]) for eta in np.linspace(0.0, 1.0, n.airfoil + 1)]
    return [
        _layers(bore, rim, n.disk),
        _layers(rim[middle], bottom[middle], n.shank),
        _layers(bottom, top, n.platform),
        np.stack(sections, axis=1),
    ]


def sector_mesh(g: Geometry, n: MeshDensity) -> MeshHex:
    """Disk segment, shank, platform and airfoil of blade 0."""
    return join_blocks(sector_blocks(g, n))


def damper_mesh(g: Geometry, n: MeshDensity) -> MeshHex:
    """The damper of sector 0 at its place between blade 0 and blade 1, in the axes of blade 0."""
    left = g.face_points(np.linspace(g.face_length, 0.0, n.damper_face + 1))
    ridge = np.linspace(-0.5, 0.5, n.damper_ridge + 1)[1:-1] * g.ridge_width
    roof = np.concatenate([left, np.stack([ridge, np.full_like(ridge, g.ridge_radius)], axis=-1), left[::-1] * [-1.0, 1.0]])
    z = np.linspace(-0.5, 0.5, n.damper_length + 1) * g.face_width
    top = np.empty((len(roof), len(z), 3))
    top[..., :2], top[..., 2] = roof[:, None], z[None]
    bottom = top.copy()
    bottom[..., 1] = left[0, 1] - g.damper_body_height
    return join_blocks([_layers(bottom, top, n.damper_height) @ turn(0.5 * g.pitch).T])
