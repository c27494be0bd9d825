r"""Meshes and matrices of the generated models: dimensions, blocks of hexahedra, stiffness, mass,
geometric stiffness.

**Axes.**  X is tangential (toward the next sector), Y radial, Z along the axis of rotation.  One
pitch is :math:`\gamma = 2\pi/N`.  The rotation

.. math:: R = R_z(-\gamma) = \begin{bmatrix}\cos\gamma & \sin\gamma & 0\\ -\sin\gamma & \cos\gamma & 0\\
          0 & 0 & 1\end{bmatrix}

from +Y toward +X maps sector k onto sector k+1.  The axes of the damper are the axes of the blade
rotated by half a pitch, :math:`Q = R_z(-\gamma/2)`, so the damper is between blade 0 and blade 1.

**Damper** (paper, Figs 2 and 3).  Cross-section in its axes (x, y), with ``r`` the radius of the
ridge, ``w`` its width, ``l`` the length of a face, ``a`` the angle of the faces from the radial
axis, ``h`` the height of the body::

            (-w/2, r) ____ (w/2, r)
                     /    \        left face: p(s) = (-w/2 - s sin a, r - s cos a), 0 <= s <= l
                    /      \       right face: its mirror image
    p(l) on the left        p(l) on the right
                   |        |
                   |________|  h below the eaves

The underside of the platform of blade 0 is in the plane of the left face.  It extends from the edge
of the platform at ``x = -c/2``, with the clearance ``c`` between two platforms, to the shank.

**Blocks** are boxes of nodes ``(i, j, k)`` along X, Y and Z.  Disk and platform have all columns,
the shank the middle ones of ``i``, the airfoil the middle ones of ``i`` and ``k``.  Adjacent blocks
share a layer of nodes, so the mesh conforms.

**Airfoil** section at the height fraction :math:`\eta`, with :math:`\xi \in [-1, 1]` along the
chord and :math:`\zeta \in [-1, 1]` through the thickness, rotated about Y by :math:`\eta` times the
twist:

.. math:: x = \kappa(\tfrac13 - \xi^2) + \tfrac12 \zeta\, t(\eta)(1 - \tfrac34 \xi^2),\qquad
          z = \tfrac12 \xi\, c(\eta).

Chord c and thickness t are linear in :math:`\eta`.  Elements have straight edges with midside nodes
at the midpoints.

**Matrices** of 20-node hexahedra, with shape functions :math:`N_a`, gradients
:math:`g_a = \nabla N_a`, the Lamé constants and 3 x 3 x 3 Gauss points; the geometric stiffness
contains the stress :math:`\sigma` under the centrifugal load:

.. math:: K_{ai,bj} &= \int \lambda g_{ai} g_{bj} + \mu g_{aj} g_{bi} + \mu \delta_{ij}\, g_a\cdot g_b\,dV, \\
          M_{ai,bj} &= \delta_{ij} \int \rho N_a N_b\,dV, \qquad
          K_{\sigma, ai,bj} = \delta_{ij} \int g_a \cdot \sigma\, g_b\,dV .

Shape functions and numbering follow the scalar element of scikit-fem: first the corners of the
mesh, then the midpoints of its edges.  Node ``a`` has the degrees of freedom ``3 a``, ``3 a + 1``,
``3 a + 2``.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
import scipy
import scipy.sparse as sp
import skfem
from numpy.typing import ArrayLike, NDArray
from skfem import Basis, ElementHexS2, MeshHex

from bdamper.fem.contact_patches import SQUARE, Patches
from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.element_stress import lame_constants
from bdamper.fem.reduced_bodies import PICTURED_MODES, picture_mesh
from bdamper.fem.rotation import spin_displacement, spin_softening
from bdamper.fem.sector_faces import no_faces
from bdamper.fem.surface import Facets, Structure, boundary_facets
from bdamper.model.structure import Interface, Location, SurfaceMesh, turn
from bdamper.util import validation

# ---- Dimensions and contact planes ----


@validation.check_arguments
@dataclass(frozen=True)
class ElasticMaterial(validation.Checked):
    """Isotropic linear elastic material.

    Parameters
    ----------
    youngs_modulus : float, Pa
    poisson_ratio : float
    density : float, kg/m3
    """

    youngs_modulus: validation.Positive = 2.1e11
    poisson_ratio: Annotated[float, validation.Limits(least=0.0, below=0.5)] = 0.3
    density: validation.Positive = 7850.0


@validation.check_arguments
@dataclass(frozen=True)
class Geometry(validation.Checked):
    """Dimensions of one sector and of the damper; lengths in m, angles in rad.

    Parameters
    ----------
    n_blades : int
    bore_radius, rim_radius, axial_length : float
        Disk segment; shank and platform have the same axial length.
    shank_width : float
    face_angle : float
        Angle of the contact faces from the radial axis (alpha = beta).
    face_length, face_width : float
        Contact face of the damper along the slope and along the axis.
    ridge_radius, ridge_width : float
    damper_body_height : float
        Height from the eaves to the flat bottom of the damper.
    platform_clearance, platform_edge_thickness : float
    airfoil_height, root_chord, tip_chord, root_thickness, tip_thickness, camber, twist : float
        The chord is axial at the root and rotated by ``twist`` about Y at the tip.
    end_gap : float
        Clearance between each end face of the damper and its axial stop.
    """

    n_blades: validation.Count = 65
    bore_radius: validation.Positive = 0.300
    rim_radius: validation.Positive = 0.400
    axial_length: validation.Positive = 0.040
    shank_width: validation.Positive = 0.011
    face_angle: Annotated[float, validation.Limits(above=0.0, below=0.5 * np.pi, unit="rad")] = (
        np.pi / 3
    )
    face_length: validation.Positive = 0.012
    face_width: validation.Positive = 0.036
    ridge_radius: validation.Positive = 0.4415
    ridge_width: validation.Positive = 0.001
    damper_body_height: validation.Positive = 0.00807
    platform_clearance: validation.Positive = 0.001
    platform_edge_thickness: validation.Positive = 0.003
    airfoil_height: validation.Positive = 0.175
    root_chord: validation.Positive = 0.034
    tip_chord: validation.Positive = 0.028
    root_thickness: validation.Positive = 0.013
    tip_thickness: validation.Positive = 0.0048
    camber: Annotated[float, validation.Limits(least=0.0)] = 0.004
    twist: Annotated[float, validation.Limits(least=-0.5 * np.pi, most=0.5 * np.pi, unit="rad")] = (
        np.pi / 6
    )
    end_gap: validation.Positive = 2.0e-4

    def __post_init__(self) -> None:
        super().__post_init__()
        clearance = self.platform_clearance
        validation.check(
            self.ridge_width >= clearance,
            "ridge_width",
            f"at least the platform_clearance ({clearance} m)",
            f"{self.ridge_width} m; otherwise the contact face does not reach under the platform",
        )
        validation.check(
            self.bore_radius < self.rim_radius < self.ridge_radius,
            "radii",
            "bore_radius < rim_radius < ridge_radius",
            (self.bore_radius, self.rim_radius, self.ridge_radius),
        )

    @property
    def pitch(self) -> float:
        """Angle of one sector, rad."""
        return 2.0 * np.pi / self.n_blades

    def face_points(self, s: NDArray) -> NDArray:
        """Return points (n, 2) of the left face plane in damper axes.

        They lie at distances ``s`` (n,), m, below the ridge.
        """
        below_ridge = np.asarray(s, float)
        x = -0.5 * self.ridge_width - below_ridge * np.sin(self.face_angle)
        y = self.ridge_radius - below_ridge * np.cos(self.face_angle)
        return np.stack([x, y], axis=-1)

    def underside_points(self, s: NDArray) -> NDArray:
        """Return points (n, 2) on the right underside in blade axes, at distances ``s`` (n,) below
        the ridge, m."""
        return self.face_points(s) @ turn(0.5 * self.pitch)[:2, :2].T

    @property
    def underside_range(self) -> tuple[float, float]:
        """Distances from the ridge to the platform edge and to the shank, measured along the
        underside, m.
        """
        edge = 0.5 * (self.platform_clearance - self.ridge_width) / np.sin(self.face_angle)
        # along the slope x is linear in s, so one linear equation gives the corner of the shank
        x0, x1 = self.underside_points(np.array([0.0, 1.0]))[:, 0]
        shank = (0.5 * self.shank_width - x0) / (x1 - x0)
        return float(edge), float(shank)


def paper_geometry() -> Geometry:
    """Return a sector for which the method of the paper reproduces its results in sections 4.1.1
    and 4.1.3.

    A stiff shank, a thick blade with little twist and a small damper give the frequency shifts of
    its Figs 8 and 9.  With more twist, mode 2 would separate the contacts.  The scale of all
    lengths gives a first frequency of 263 Hz without dampers: in Fig. 16 the resonance at 5 kN is
    at 308.3 Hz, a shift of 17.2 %.
    """
    # millimetres before scaling
    lengths: dict[str, Any] = {
        "bore_radius": 262.144,
        "rim_radius": 400.0,
        "axial_length": 35.319,
        "shank_width": 9.446,
        "face_length": 10.047,
        "face_width": 33.705,
        "ridge_radius": 414.784,
        "ridge_width": 3.0,
        "damper_body_height": 4.0,
        "platform_clearance": 1.0,
        "platform_edge_thickness": 4.727,
        "airfoil_height": 170.404,
        "root_chord": 33.553,
        "tip_chord": 29.038,
        "root_thickness": 17.036,
        "tip_thickness": 9.449,
        "camber": 1.0,
        "end_gap": 0.2,
    }
    scale = 1.369e-3
    scaled = {name: scale * length for name, length in lengths.items()}
    return Geometry(face_angle=0.872094, twist=0.06, **scaled)


# ---- Structured meshes ----


@dataclass(frozen=True)
class MeshDensity:
    """Numbers of elements.

    Parameters
    ----------
    centre : int
        Through the thickness of shank and airfoil; even, so that the mean line has nodes.
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
        """Return the density ``"coarse"`` or ``"reference"``."""
        # in the order of the fields
        presets = {
            "coarse": (2, 2, 1, 4, 2, 2, 1, 6, 3, 1, 2, 6),
            "reference": (2, 4, 1, 8, 5, 6, 3, 24, 5, 1, 4, 9),
        }
        return cls(*presets[validation.choice("mesh", name, presets)])


# nodes of an element in a block, in the order of scikit-fem
HEXAHEDRON = (
    (1, 1, 1),
    (1, 1, 0),
    (1, 0, 1),
    (0, 1, 1),
    (1, 0, 0),
    (0, 1, 0),
    (0, 0, 1),
    (0, 0, 0),
)


def join_blocks(blocks: list[NDArray]) -> MeshHex:
    """Join structured blocks of node positions to one mesh of hexahedra.

    Parameters
    ----------
    blocks : list of (ni, nj, nk, 3) float, m
        Common positions of two blocks must be equal to 1e-9 m.
    """
    points, cells = [], []
    n_nodes = 0
    # an element begins at every node but the last along an edge, and ends at every node but the
    # first
    begin_and_end = (slice(None, -1), slice(1, None))
    for block in blocks:
        shape = block.shape[:3]
        node_number = n_nodes + np.arange(np.prod(shape)).reshape(shape)
        corners = []
        for at_i, at_j, at_k in HEXAHEDRON:
            corner = node_number[begin_and_end[at_i], begin_and_end[at_j], begin_and_end[at_k]]
            corners.append(corner.ravel())
        cells.append(np.array(corners))  # (8, n_elements)
        points.append(block.reshape(-1, 3))
        n_nodes += node_number.size
    nodes = np.concatenate(points)
    elements = np.concatenate(cells, axis=1)
    # nodes of adjacent blocks at the same position become one
    rounded = np.round(nodes / 1e-9).astype(np.int64)
    _, first, joined_number = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    joined_elements = joined_number.reshape(-1)[elements]
    # scikit-fem has a column for each node and each element
    return MeshHex(np.ascontiguousarray(nodes[first].T), np.ascontiguousarray(joined_elements))


def _layers(bottom: NDArray, top: NDArray, n: int) -> NDArray:
    """Interpolate linearly in ``n`` steps between two sheets (ni, nk, 3) to a block
    (ni, n + 1, nk, 3)."""
    # along the second axis of the block
    height = np.linspace(0.0, 1.0, n + 1)[None, :, None, None]
    block = (1.0 - height) * bottom[:, None] + height * top[:, None]
    # exactly the sheets, which adjacent blocks share
    block[:, 0] = bottom
    block[:, -1] = top
    return block


def airfoil_points(g: Geometry, zeta: ArrayLike, xi: ArrayLike, eta: float, root: float) -> NDArray:
    """Return points (..., 3) of the airfoil in m.

    The height above ``root`` (m) is the fraction ``eta`` of the airfoil height.  The coordinates
    ``zeta`` and ``xi`` are broadcast.
    """
    zeta, xi = np.broadcast_arrays(zeta, xi)
    chord = g.root_chord + eta * (g.tip_chord - g.root_chord)
    thickness = g.root_thickness + eta * (g.tip_thickness - g.root_thickness)
    x = g.camber * (1.0 / 3.0 - xi**2) + 0.5 * zeta * thickness * (1.0 - 0.75 * xi**2)
    y = np.full_like(x, root + eta * g.airfoil_height)
    z = 0.5 * xi * chord
    c = np.cos(eta * g.twist)
    s = np.sin(eta * g.twist)
    return np.stack([c * x + s * z, y, c * z - s * x], axis=-1)


def _sheet(section: NDArray, z: NDArray) -> NDArray:
    """Return the nodes (n, n_z, 3) with positions (n, 2) in the cross-section and ``z`` (n_z,)."""
    sheet = np.empty((len(section), len(z), 3))
    sheet[..., :2] = section[:, None]
    sheet[..., 2] = z[None]
    return sheet


def sector_blocks(g: Geometry, n: MeshDensity) -> list[NDArray]:
    """Return the blocks of disk segment, shank, platform and airfoil of blade 0, in this order.

    Each block (ni, nj, nk, 3) has its nodes (m) along X, along Y (radially) and along Z (axially).
    Adjacent blocks share the nodes of a sheet (ni, nk, 3).
    """
    half = 0.5 * g.pitch
    # across the thickness and along the chord of the airfoil
    zeta = np.linspace(-1.0, 1.0, n.centre + 1)
    xi = np.linspace(-1.0, 1.0, n.chord + 1)
    # the platform is longer than the chord at both ends
    z = np.concatenate([[-0.5 * g.axial_length], 0.5 * g.root_chord * xi, [0.5 * g.axial_length]])
    # the columns of the shank, between those of both wings of the platform
    n_wing = n.contact + n.fillet
    middle = slice(n_wing, n_wing + n.centre + 1)

    # underside of the platform, from the left edge over the shank to the right edge
    edge, shank = g.underside_range
    under_fillet = np.linspace(shank, g.face_length, n.fillet + 1)
    under_contact = np.linspace(g.face_length, edge, n.contact + 1)
    s = np.concatenate([under_fillet[:-1], under_contact])
    right_wing = g.underside_points(s)  # x and y, from the shank to the edge
    left_wing = right_wing[::-1] * [-1.0, 1.0]
    # the ends of the shank belong to the wings
    flat_x = 0.5 * g.shank_width * zeta[1:-1]
    flat_y = np.full(n.centre - 1, right_wing[0, 1])
    flat = np.stack([flat_x, flat_y], axis=-1)
    bottom = _sheet(np.concatenate([left_wing, flat, right_wing]), z)

    # top of the platform: the root of the airfoil in the middle, straight lines from there to the
    # edges
    edge_radius = g.ridge_radius + g.platform_edge_thickness
    edge_x, edge_y = turn(half)[:2, :2] @ [-0.5 * g.platform_clearance, edge_radius]
    root_x = airfoil_points(g, zeta[:, None], xi, eta=0.0, root=edge_y)[..., 0]
    # beyond the chord, x stays that of the leading and trailing edge
    root_x = np.concatenate([root_x[:, :1], root_x, root_x[:, -1:]], axis=1)
    # from 0 at the shank to 1 at the edge
    fraction = ((shank - s) / (shank - edge))[:, None]
    left = slice(0, middle.start + 1)
    right = slice(middle.stop - 1, None)
    top = np.empty_like(bottom)
    top[middle, :, 0] = root_x
    top[right, :, 0] = (1.0 - fraction) * root_x[-1] + fraction * edge_x
    from_shank_to_left_edge = (1.0 - fraction) * root_x[0] - fraction * edge_x
    top[left, :, 0] = from_shank_to_left_edge[::-1]
    top[..., 1] = edge_y
    top[..., 2] = z

    # disk: radial columns, spaced at the rim like the columns of the platform
    shank_angle = 0.5 * g.shank_width / g.rim_radius
    wing_angle = shank_angle + fraction[:, 0] * (half - shank_angle)
    angle = np.concatenate([-wing_angle[::-1], shank_angle * zeta[1:-1], wing_angle])
    direction = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    rim = _sheet(g.rim_radius * direction, z)
    bore = _sheet(g.bore_radius * direction, z)

    heights = np.linspace(0.0, 1.0, n.airfoil + 1)
    sections = [airfoil_points(g, zeta[:, None], xi, eta, edge_y) for eta in heights]
    return [
        _layers(bore, rim, n.disk),
        _layers(rim[middle], bottom[middle], n.shank),
        _layers(bottom, top, n.platform),
        np.stack(sections, axis=1),
    ]


def sector_mesh(g: Geometry, n: MeshDensity) -> MeshHex:
    """Return the mesh of disk segment, shank, platform and airfoil of blade 0."""
    return join_blocks(sector_blocks(g, n))


def damper_mesh(g: Geometry, n: MeshDensity) -> MeshHex:
    """Return the mesh of the damper between blades 0 and 1, in the axes of blade 0."""
    left = g.face_points(np.linspace(g.face_length, 0.0, n.damper_face + 1))
    ridge_x = np.linspace(-0.5, 0.5, n.damper_ridge + 1)[1:-1] * g.ridge_width
    ridge = np.stack([ridge_x, np.full_like(ridge_x, g.ridge_radius)], axis=-1)
    right = left[::-1] * [-1.0, 1.0]
    roof = np.concatenate([left, ridge, right])
    z = np.linspace(-0.5, 0.5, n.damper_length + 1) * g.face_width
    top = _sheet(roof, z)
    bottom = top.copy()
    bottom[..., 1] = left[0, 1] - g.damper_body_height
    in_damper_axes = _layers(bottom, top, n.damper_height)
    return join_blocks([in_damper_axes @ turn(0.5 * g.pitch).T])


# ---- Stiffness and mass of 20-node hexahedra ----


def local_order() -> NDArray:
    """Return the numbers in scikit-fem of the 20 nodes in the order of CalculiX and Abaqus."""
    # positions on the cube from -1 to 1; scikit-fem has the cube from 0 to 1
    in_scikit_fem = 2.0 * ElementHexS2().doflocs - 1.0
    middles = 0.5 * (SQUARE + np.roll(SQUARE, -1, axis=0))
    # corners below and above, middles of their edges, middles of the upright edges
    layers = ((SQUARE, -1.0), (SQUARE, 1.0), (middles, -1.0), (middles, 1.0), (SQUARE, 0.0))
    in_abaqus = np.concatenate([np.column_stack([xy, np.full(4, z)]) for xy, z in layers])
    distance = np.abs(in_abaqus[:, None] - in_scikit_fem[None]).max(axis=2)
    return distance.argmin(axis=1)


@dataclass(frozen=True)
class Discretisation(Structure):
    """Meshed body with its matrices.

    Parameters
    ----------
    mesh : MeshHex
    elements : (n_elements, 20) int
        Nodes of each element in the local order of scikit-fem.
    material : ElasticMaterial
    """

    mesh: MeshHex
    elements: NDArray
    material: ElasticMaterial

    @cached_property
    def surface(self) -> Facets:
        """Outer faces of all elements."""
        return boundary_facets((self.elements[:, local_order()],), self.nodes)


def _assembled(blocks: NDArray, rows: NDArray, n: int) -> sp.coo_matrix:
    """Assemble the matrix (n, n) from element matrices (n_elements, ...) and their degrees of
    freedom (n_elements, m)."""
    # every pair of degrees of freedom of each element
    m = rows.shape[1]
    line = np.repeat(rows, m, axis=1).ravel()
    column = np.tile(rows, (1, m)).ravel()
    return sp.coo_matrix((blocks.ravel(), (line, column)), shape=(n, n))


def discretise(mesh: MeshHex, material: ElasticMaterial) -> Discretisation:
    """Assemble stiffness and mass of ``mesh`` with hexahedra of 20 nodes."""
    basis = Basis(mesh, ElementHexS2(), intorder=5)
    n_elements = mesh.t.shape[1]
    # gradients of the shape functions: (3, 20, n_elements, n_points)
    gradient = np.stack([field.grad for (field,) in basis.basis], axis=1)
    lame, shear = lame_constants(material.youngs_modulus, material.poisson_ratio)

    # h_iajb, the integral of the gradients of shape functions a along i and b along j:
    # (n_elements, 3, 20, 3, 20)
    weighted = (gradient * basis.dx).transpose(2, 0, 1, 3).reshape(n_elements, 60, -1)
    plain = gradient.transpose(2, 0, 1, 3).reshape(n_elements, 60, -1)
    h = (weighted @ plain.transpose(0, 2, 1)).reshape(-1, 3, 20, 3, 20)
    # isotropic elasticity: lame h_iajb + shear h_jaib + shear delta_ij sum_l h_lalb
    element_stiffness = lame * h + shear * h.transpose(0, 3, 2, 1, 4)
    trace = shear * np.einsum("eiaib->eab", h)
    for i in range(3):
        element_stiffness[:, i, :, i, :] += trace
    # by node, component, node, component
    element_stiffness = element_stiffness.transpose(0, 2, 1, 4, 3)

    # shape functions at the integration points: (n_elements, 20, n_points)
    values = np.stack([np.broadcast_to(field, basis.dx.shape) for (field,) in basis.basis])
    values = values.transpose(1, 0, 2)
    # the mass of one component of displacement, the same for all three
    weighted_values = material.density * (values * basis.dx[:, None])
    element_mass = weighted_values @ values.transpose(0, 2, 1)

    elements = basis.element_dofs.T
    n_nodes = basis.N
    dof = (3 * elements[:, :, None] + np.arange(3)).reshape(len(elements), 60)
    stiffness = _assembled(element_stiffness, dof, 3 * n_nodes).tocsr()
    mass = sp.kron(_assembled(element_mass, elements, n_nodes), sp.identity(3), format="csr")
    # the Hermitian solvers need exact symmetry, which rounding disturbs
    stiffness = (0.5 * (stiffness + stiffness.T)).tocsr()
    return Discretisation(
        basis.doflocs.T.copy(), stiffness, mass, mesh=mesh, elements=elements, material=material
    )


# ---- Common parts of the generated models ----


def clamped_segment(body: Discretisation, g: Geometry, n_pitches: int) -> CyclicSector:
    """Return a disk segment clamped at the bore and at its cut faces: an acyclic structure."""
    x = body.nodes[:, 0]
    y = body.nodes[:, 1]
    angle = np.arctan2(x, y)
    radius = np.hypot(x, y)
    in_disk = radius < g.rim_radius + 1e-8
    at_cut_face = in_disk & (np.abs(angle) > 0.5 * n_pitches * g.pitch - 1e-9)
    at_bore = radius < g.bore_radius + 1e-8
    return CyclicSector(body, no_faces(), np.flatnonzero(at_bore | at_cut_face), nodal_diameter=0)


def surface_mesh(body: Discretisation, shapes: Mapping[int, NDArray] | None = None) -> SurfaceMesh:
    """Return the outer surface of a body as quadrilaterals of its corner nodes.

    Parameters
    ----------
    body : Discretisation
    shapes : mapping of nodal diameter to (3 n_nodes, n_modes), optional
        Mode shapes to store at the nodes of the surface.
    """
    modes = {}
    for d, columns in (shapes or {}).items():
        by_node = columns.reshape(-1, 3, columns.shape[1])
        modes[d] = by_node[..., :PICTURED_MODES]
    return picture_mesh(body.surface, body.nodes, modes)


def interface(
    name: str,
    patches: Patches,
    body_a: str,
    body_b: str,
    *,
    sector_b: int = 0,
    clearance: float | None = None,
) -> Interface:
    """Return an interface with one contact point per patch: friction without gap, or an axial stop
    with clearance (m)."""
    kind: Literal["friction", "constraint"] = "friction" if clearance is None else "constraint"
    gap = np.full(len(patches.size), clearance or 0.0)
    points = patches.centre.copy()
    frame = np.array(patches.frame)
    return Interface(
        name=name,
        kind=kind,
        body_a=body_a,
        sector_a=0,
        body_b=body_b,
        sector_b=sector_b,
        points=points,
        area=patches.area,
        frame=frame,
        gap=gap,
    )


def blade_nodes(body: Discretisation, g: Geometry) -> dict[str, int]:
    """Return the nodes for excitation and response.

    All of them lie on the mean line of the airfoil: "tip" and "platform" in the middle of the
    chord, "tip_trailing_edge" and "tip_leading_edge" at its ends (toward +Z and -Z).
    """
    root = g.ridge_radius + g.platform_edge_thickness
    places = {
        "tip": (0.0, 1.0),
        "platform": (0.0, 0.0),
        "tip_trailing_edge": (1.0, 1.0),
        "tip_leading_edge": (-1.0, 1.0),
    }
    nodes = {}
    for name, (along_chord, height) in places.items():
        point = airfoil_points(g, zeta=0.0, xi=along_chord, eta=height, root=root)
        nodes[name] = body.nearest_node(point)
    return nodes


def locations(name: str, body: Discretisation, nodes: Mapping[str, int]) -> dict[str, Location]:
    """Return named nodes of a body as locations."""
    return {place: Location(place, name, body.nodes[node].copy()) for place, node in nodes.items()}


def provenance(source: str, *bodies: Discretisation, over_speed: bool = False) -> dict[str, str]:
    """Return the origin of a model: function, programs, date and mesh."""
    elements = " + ".join(str(body.mesh.t.shape[1]) for body in bodies)
    stiffening = "by squared speed" if over_speed else "left out"
    return {
        "source": source,
        "programs": (
            f"scikit-fem {skfem.__version__}, scipy {scipy.__version__}, numpy {np.__version__}"
        ),
        "date": datetime.date.today().isoformat(),
        "elements": f"{elements} 20-node hexahedra",
        "rotor speed": f"0 (stress stiffening and spin softening {stiffening})",
    }


# ---- Geometric stiffness ----


def geometric_stiffness(body: Discretisation, displacement: NDArray) -> sp.csr_matrix:
    """Return the symmetric matrix (3 n_nodes, 3 n_nodes) for the stress of a displacement
    (3 n_nodes,), linear in it."""
    basis = Basis(body.mesh, ElementHexS2(), intorder=5)
    # gradients of the shape functions: (20, 3, n_elements, n_points)
    gradient = np.stack([field.grad for (field,) in basis.basis])
    # displacements of the nodes of each element: (n_elements, 20, 3)
    moved = displacement.reshape(-1, 3)[body.elements]
    # e element, p integration point, a and b nodes, i and j coordinates
    slope = np.einsum("eai,ajep->ijep", moved, gradient, optimize=True)
    strain = 0.5 * (slope + slope.swapaxes(0, 1))
    lame, shear = lame_constants(body.material.youngs_modulus, body.material.poisson_ratio)
    dilation = np.einsum("iiep->ep", strain)
    identity = np.eye(3)[:, :, None, None]
    stress = 2.0 * shear * strain + lame * dilation * identity
    # the integral of gradient_a . stress . gradient_b, the same for all components of displacement
    pulled = np.einsum("ijep,bjep->biep", stress * basis.dx, gradient, optimize=True)
    of_elements = np.einsum("aiep,biep->eab", gradient, pulled, optimize=True)
    matrix = _assembled(of_elements, body.elements, len(body.nodes))
    # exact symmetry, which rounding disturbs
    matrix = 0.5 * (matrix + matrix.T)
    return sp.kron(matrix, sp.identity(3), format="csr")


def stiffness_per_squared_speed(body: Discretisation, standstill: CyclicSector) -> sp.csr_matrix:
    """Return geometric stiffness minus spin softening (3 n_nodes, 3 n_nodes), kg, of a sector with
    ``body``.

    Parameters
    ----------
    body : Discretisation
    standstill : CyclicSector
        At nodal diameter 0 with the stiffness at standstill, for the centrifugal stress.
    """
    stiffening = geometric_stiffness(body, spin_displacement(standstill))
    return (stiffening - spin_softening(body)).tocsr()
