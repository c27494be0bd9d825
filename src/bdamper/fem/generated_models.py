"""The reference models that are too large for the wheel, as `bdamper.reference_model` makes them on first use.

In: name and number of contact points.  Out: the model, the same as the stored one up to rounding
(``tools/make_reference_model.py --check``).

The reference model (paper, section 4.1): a bladed disk of 65 sectors with wedge dampers, from finite element meshes.

The blade (with its disk segment) touches two dampers, the damper two blades:

=========  ===============  ==================  ==========================
interface  body a (normal)  body b              kind
=========  ===============  ==================  ==========================
left       damper 0         blade 0             friction
right      damper 0         blade 1             friction
front      damper 0         ground (axial stop) constraint, with clearance
back       damper 0         ground (axial stop) constraint, with clearance
=========  ===============  ==================  ==========================

Positions and axes of an interface are those of its place on the damper of sector 0.  The modes and
receptances of the blade at "right" belong to blade 0's own left underside, with the axes turned back by one
pitch; the phase of the neighbouring sector enters where the interface is put together.

One sector of the reference disk and its wedge damper as finite element bodies.

`SectorFE` holds the meshes, matrices, factorisations and modes, none of which depends on the contact points: one
object serves several grids of contact points and the full finite element solution that they are compared with.

Blade-to-ground damper (paper, section 4.2): one blade that rubs on the ground, with separation and many points.

The blade of the reference sector with its disk segment, held at the bore and at the two cut faces of the
segment as in a test block, touches a rigid ground with the right underside of its platform:

=========  =====================  =======  ========
interface  body a (normal)        body b   kind
=========  =====================  =======  ========
platform   blade                  ground   friction
=========  =====================  =======  ========

The structure is acyclic (``n_blades = 1``), so that one basis of real modes serves every harmonic.  There is no
free body and no load: normal loads and gaps are settings of a study (``constant_loads``, ``gap``).

Contact points and contact axes of the reference model (paper, Figs. 1 and 3): rectangular patches of its plane faces.

Contact axes, with a the angle of a face from the radial axis, in the axes of the damper (rows t1, t2, n)::

    left   (sin a, cos a, 0)    (0, 0, -1)   (-cos a, sin a, 0)
    right  (sin a, -cos a, 0)   (0, 0, -1)   ( cos a, sin a, 0)
    front  (1, 0, 0)            (0, 1, 0)    (0, 0, 1)
    back   (1, 0, 0)            (0, -1, 0)   (0, 0, -1)

so t1 lies in the cross-section, n is the outward normal of the damper, and t1, t2, n is right-handed.

Stress of the reference blade at the points that ship with its model; see :mod:`bdamper.fem.element_stress`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bdamper.fem.contact_patches import Patches, patch_grid, patches_on_rectangles
from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.element_stress import Solids, StressRows, near_patches
from bdamper.fem.local_basis import BladePart, LocalSizes, damper_motion, local_basis
from bdamper.fem.meshes import (
    Discretisation,
    Geometry,
    Material,
    MeshDensity,
    blade_nodes,
    clamped_segment,
    damper_mesh,
    discretise,
    interface,
    join_blocks,
    local_order,
    locations,
    paper_geometry,
    provenance,
    sector_blocks,
    sector_mesh,
    stiffness_per_squared_speed,
    surface_mesh,
)
from bdamper.fem.reduced_bodies import FreeBody, Wanted, constrained_body, free_body, needed_nodal_diameters
from bdamper.fem.rotation import Rotation
from bdamper.fem.sector_faces import match_faces
from bdamper.model.modal_basis import LocalBasis
from bdamper.model.structure import Body, Interface, Model, StressSet, turn
from bdamper.util import validation
from bdamper.util.progress import with_progress

# ---- Contact points and contact axes of the reference model (paper, Figs ----


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


# ---- One sector of the reference disk and its wedge damper as finite element bodies ----


@dataclass
class SectorFE:
    """Sector and damper as finite element bodies.

    Parameters
    ----------
    geometry : Geometry
    density : MeshDensity
    material : Material
    keep_factors : bool
        Keep the factorisations of all nodal diameters, instead of that of the latest alone (half a gigabyte each on the
        reference mesh).
    """

    geometry: Geometry = field(default_factory=Geometry)
    density: MeshDensity = field(default_factory=lambda: MeshDensity.preset("coarse"))
    material: Material = field(default_factory=Material)
    keep_factors: bool = True

    def __post_init__(self) -> None:
        g = self.geometry
        self.blade: Discretisation = discretise(sector_mesh(g, self.density), self.material)
        self.damper: FreeBody[Discretisation] = FreeBody(
            discretise(damper_mesh(g, self.density), self.material), turn(0.5 * g.pitch).T
        )
        nodes = self.blade.nodes
        angle, radius = np.arctan2(nodes[:, 0], nodes[:, 1]), np.hypot(nodes[:, 0], nodes[:, 1])
        on_disk = radius < g.rim_radius + 1e-8
        left = np.flatnonzero(on_disk & (np.abs(angle + 0.5 * g.pitch) < 1e-9))
        right = np.flatnonzero(on_disk & (np.abs(angle - 0.5 * g.pitch) < 1e-9))
        self.faces = match_faces(nodes, left, right, g.n_blades)
        # Midpoints of straight edges along the bore lie slightly inside its radius, all others outside.
        self.clamped: NDArray = np.flatnonzero(radius < g.bore_radius + 1e-8)
        self._cyclic: dict[int, CyclicSector] = {}

    def cyclic(self, nodal_diameter: int) -> CyclicSector:
        """The sector at one nodal diameter, 0 to ``n_blades // 2``."""
        validation.integer("nodal diameter", nodal_diameter, most=self.geometry.n_blades // 2)
        if not self.keep_factors:
            for d, other in self._cyclic.items():
                if d != nodal_diameter:
                    other.forget_factors()
        if nodal_diameter not in self._cyclic:
            self._cyclic[nodal_diameter] = CyclicSector(self.blade, self.faces, self.clamped, nodal_diameter)
        return self._cyclic[nodal_diameter]

    def rotation(self, check_at: float | None = None) -> Rotation:
        """How the stiffness of the sector changes with rotor speed.

        Parameters
        ----------
        check_at : float, rad/s, optional
            Speed at which frequencies are compared with those of the full matrices.
        """
        return Rotation(stiffness_per_squared_speed(self.blade, self.cyclic(0)), 0.0, check_at, "bdamper.fem")

    def blade_part(self) -> BladePart:
        """Shank, platform and airfoil, the blade of a wheel; it meets the disk at the rim, under the shank."""
        blocks = sector_blocks(self.geometry, self.density)[1:]  # without the disk
        part = discretise(join_blocks(blocks), self.material)
        nodes = cKDTree(self.blade.nodes).query(part.nodes)[1]
        dofs = self.blade.dofs(nodes)
        entries = part.stiffness.tocoo()
        shape = self.blade.stiffness.shape
        stiffness = sp.csr_matrix((entries.data, (dofs[entries.row], dofs[entries.col])), shape=shape)
        fixed = np.zeros((len(self.blade.nodes), 3), bool)
        fixed[self.clamped] = True
        return BladePart(self.blade, nodes, fixed, stiffness)

    def local_basis(self, wanted: Wanted, interfaces: Mapping[str, Interface], sizes: LocalSizes) -> LocalBasis:
        """Coordinates of blade and disk for mistuned wheels; see :func:`bdamper.fem.local_basis`."""
        dampers = damper_motion(wanted.ports, interfaces)
        return local_basis(self.blade_part(), self.cyclic, wanted, dampers, sizes, "shank, platform and airfoil")

    def blade_contact(self, left: Patches, right: Patches) -> sp.csr_matrix:
        """Averaging matrix of blade 0 for its ports at the interfaces "left" and "right", in this order.

        At "right" the blade stands in sector +1, so what blade 0 carries is its own left underside: the
        patches turned back by one pitch.
        """
        back = right.turned(turn(-self.geometry.pitch))
        return sp.vstack([averaging_matrix(self.blade, left), averaging_matrix(self.blade, back)], format="csr")

    def damper_contact(self, *patches: Patches) -> sp.csr_matrix:
        """Averaging matrix of the damper over patches of its faces, one below the other."""
        return sp.vstack([averaging_matrix(self.damper.body, p) for p in patches], format="csr")


# ---- Stress of the reference blade at the points that ship with its model; see  ----


def solids_of(body: Discretisation) -> tuple[Solids, ...]:
    """The elements of a body."""
    m = body.material
    return (Solids("C3D20", body.elements[:, local_order()], m.youngs_modulus, m.poisson_ratio),)


def blade_stress(
    fe: SectorFE, contact: sp.spmatrix, faces: tuple[Patches, Patches], nodal_diameters: Iterable[int], n_modes: int
) -> dict[str, StressSet]:
    """The set "blade" of the reference sector, at :func:`blade_points`, in single precision.

    Parameters
    ----------
    fe : SectorFE
    contact : (3 n_points, 3 n_nodes) sparse
    faces : the patches "left" and "right" of the damper of sector 0
    nodal_diameters : iterable of int
    n_modes : int
    """
    at = blade_points(fe.blade, fe.geometry)
    near = near_patches(fe.blade.nodes[at], faces[0], faces[1].turned(turn(-fe.geometry.pitch)))
    rows = StressRows("blade", solids_of(fe.blade), fe.blade.nodes, at, near)
    for d in sorted({0, *nodal_diameters}):
        rows.add(fe.cyclic(d), contact, *fe.cyclic(d).modes(n_modes))
    return {"blade": rows.set("blade", "bdamper.fem.generated_models, mean over elements at nodes")}


def blade_points(body: Discretisation, g: Geometry) -> NDArray:
    """Nodes of the shipped points: around the airfoil a sixth of its height above the root, and around the shank halfway.

    Leading and trailing edge and the middle of either side; the four edges of the shank and the middle of either side.
    """
    root = g.ridge_radius + g.platform_edge_thickness
    # height of the shipped points above the root of the airfoil, of its whole height; the root itself is a sharp edge
    above_root = 1.0 / 6.0
    y = root + above_root * g.airfoil_height
    chord = g.root_chord + above_root * (g.tip_chord - g.root_chord)
    thickness = g.root_thickness + above_root * (g.tip_thickness - g.root_thickness)
    c, s = np.cos(above_root * g.twist), np.sin(above_root * g.twist)
    section = [(-2.0 * g.camber / 3.0, sense * 0.5 * chord) for sense in (-1.0, 1.0)]
    section += [(g.camber / 3.0 + sense * 0.5 * thickness, 0.0) for sense in (-1.0, 1.0)]
    places = [[c * x + s * z, y, c * z - s * x] for x, z in section]
    underside = float(g.underside_points(np.array([g.underside_range[1]]))[0, 1])  # where it meets the shank
    middle = 0.5 * (np.sqrt(g.rim_radius**2 - 0.25 * g.shank_width**2) + underside)
    places += [[sx * 0.5 * g.shank_width, middle, sz * 0.5 * g.axial_length] for sx in (-1, 1) for sz in (-1, 0, 1)]
    return np.array([body.nearest_node(np.array(place)) for place in places])


# ---- The reference model (paper, section 4 ----


BLADE_PORTS = (("left", "b"), ("right", "b"))
DAMPER_PORTS = (("left", "a"), ("right", "a"), ("front", "a"), ("back", "a"))
GROUND = Body("ground", "ground", (("front", "b"), ("back", "b")))


def _interfaces(left: Patches, right: Patches, front: Patches, back: Patches, end_gap: float) -> dict[str, Interface]:
    faces = (
        interface("left", left, "damper", "blade"),
        interface("right", right, "damper", "blade", sector_b=1),
        interface("front", front, "damper", "ground", clearance=end_gap),
        interface("back", back, "damper", "ground", clearance=end_gap),
    )
    return {face.name: face for face in faces}


def bladed_disk(
    points: int | tuple[int, int] = 24,
    mesh: str = "coarse",
    n_modes: int = 40,
    n_damper_modes: int = 16,
    engine_order: int = 5,
    harmonics: int = 7,
    damping_ratio: float = 0.002,
    nodal_diameters: tuple[int, ...] | None = None,
    pictures: tuple[int, ...] = (),
    rotation: Rotation | float | None = None,
    fe: SectorFE | None = None,
    wheel: LocalSizes | None = None,
    stress: bool = False,
    progress: bool = False,
) -> Model:
    """Build the reference model.

    Parameters
    ----------
    points : int or (int, int)
        Contact points on each face, or their number along slope and axis; more than the mesh has nodes on the face make
        the static receptance singular.
    mesh : {"coarse", "reference"}, ignored if ``fe`` is given
    n_modes : int
        Modes of the blade at each nodal diameter.
    n_damper_modes : int
        Modes of the damper, the six rigid ones included.
    engine_order, harmonics : int
        Decide which nodal diameters are stored, unless ``nodal_diameters`` is given.
    damping_ratio : float, of all elastic modes
    nodal_diameters : tuple of int, optional
        0 to N/2; 0 is always added, for the bias.
    pictures : tuple of int
        Nodal diameters whose mode shapes are kept on the surface of the blade.
    rotation : Rotation or float, optional
        For a model over rotor speed: what :meth:`SectorFE.rotation` says, or the speed (rad/s) at which it is checked.
    fe : SectorFE, optional
        Finite element objects to use again; only the parts that depend on the contact points are computed.
    wheel : LocalSizes, optional
        Numbers of shapes of a local basis, for mistuned wheels; none by default.
    stress, progress : bool
        Whether to add the stress set "blade" (:func:`blade_points`) at all nodal diameters; whether to show a progress bar.

    Returns
    -------
    Model
        Without contact stiffness (``contact`` is empty).  The rigid translations of the damper are along its own
        tangential, radial and axial direction; everything else is in the axes of blade 0.
    """
    fe = fe or SectorFE(density=MeshDensity.preset(mesh))
    g = fe.geometry
    of_order = needed_nodal_diameters(g.n_blades, engine_order, harmonics)
    diameters = tuple(sorted({0, *(of_order if nodal_diameters is None else nodal_diameters)}))
    left, right = (wedge_patches(g, side, points) for side in ("left", "right"))
    front, back = (end_patches(g, side) for side in ("front", "back"))
    faces = _interfaces(left, right, front, back, g.end_gap)
    contact = fe.blade_contact(left, right)
    nodes, damper_nodes = blade_nodes(fe.blade, g), {"damper": fe.damper.body.nearest_node(fe.damper.centre)}
    rotation = fe.rotation(rotation) if isinstance(rotation, int | float) else rotation
    turns = with_progress(diameters, progress, "finite element model", "nodal diameter")
    wanted = Wanted(BLADE_PORTS, contact, nodes, n_modes, damping_ratio)
    blade = constrained_body("blade", wanted, fe.cyclic, turns, rotation)
    local = None if wheel is None else fe.local_basis(wanted, faces, wheel)
    on_damper = fe.damper_contact(left, right, front, back)
    own = Wanted(DAMPER_PORTS, on_damper, damper_nodes, n_damper_modes, damping_ratio)
    damper = free_body("damper", own, fe.damper, turn(0.5 * g.pitch)[:, 1])
    return Model(
        n_blades=g.n_blades,
        bodies={"blade": replace(blade, local=local), "damper": damper, "ground": GROUND},
        interfaces=faces,
        locations=locations("blade", fe.blade, nodes) | locations("damper", fe.damper.body, damper_nodes),
        meshes={
            "blade": surface_mesh(fe.blade, {d: fe.cyclic(d).modes(n_modes)[1] for d in pictures}),
            "damper": surface_mesh(fe.damper.body),
        },
        provenance=provenance("bdamper.fem.generated_models", fe.blade, fe.damper.body, over_speed=rotation is not None),
        stress={} if not stress else blade_stress(fe, contact, (left, right), diameters, n_modes),
    )


# ---- The reference models that are too large for the wheel, as `bdamper ----


def reference_disk(points: int, progress: bool = False) -> Model:
    """The disk of 65 blades with 24 or 48 contact points on each face."""
    fe = SectorFE(Geometry(), MeshDensity.preset("reference"), keep_factors=False)
    return bladed_disk(points, fe=fe, pictures=(5,), progress=progress)


def paper_disk(points: int, progress: bool = False) -> Model:
    """The body of the paper with 9, 24 or 48 contact points: 3, 4 and 4 rows along the slope, where the mesh has five."""
    rows, full = 3 if points == 9 else 4, points == 24  # the others have one harmonic only, for the size of their files
    return bladed_disk(
        (rows, points // rows),
        fe=SectorFE(paper_geometry(), MeshDensity.preset("coarse")),
        damping_ratio=0.0021,
        harmonics=7 if full else 1,
        n_modes=40 if full else 20,
        pictures=(5,),
        progress=progress,
    )


MAKERS = {"bladed_disk": reference_disk, "paper_disk": paper_disk}


# ---- Blade-to-ground damper (paper, section 4 ----


def blade_structure(g: Geometry, density: MeshDensity, material: Material) -> tuple[Discretisation, CyclicSector]:
    """The sector of one blade, held at the bore and at its cut faces: an acyclic structure."""
    body = discretise(sector_mesh(g, density), material)
    return body, clamped_segment(body, g, 1)


def blade_to_ground(
    points: int | tuple[int, int] = 24,
    mesh: str = "coarse",
    n_modes: int = 40,
    damping_ratio: float = 0.002,
    geometry: Geometry | None = None,
    material: Material | None = None,
) -> Model:
    """Build the model of a blade that rubs on the ground.

    Parameters
    ----------
    points : int or (int, int)
        Contact points, or their number along slope and axis.
    mesh : {"coarse", "reference"}
    n_modes : int
    damping_ratio : float
        Of all modes.
    geometry, material : optional
    """
    g = geometry or Geometry()
    body, structure = blade_structure(g, MeshDensity.preset(mesh), material or Material())

    # the underside as the blade has it: t1 up the slope like the damper's, the normal toward the ground
    face = wedge_patches(g, "left", points)
    patches = Patches(face.centre, face.frame * np.array([1.0, -1.0, -1.0])[:, None], face.size)
    nodes, contact = blade_nodes(body, g), averaging_matrix(body, patches)
    wanted = Wanted((("platform", "a"),), contact, nodes, n_modes, damping_ratio)
    blade = constrained_body("blade", wanted, lambda _: structure, (0,))
    return Model(
        n_blades=1,
        bodies={"blade": blade, "ground": Body("ground", "ground", (("platform", "b"),))},
        interfaces={"platform": interface("platform", patches, "blade", "ground")},
        locations=locations("blade", body, nodes),
        meshes={"blade": surface_mesh(body, {0: structure.modes(n_modes)[1]})},
        provenance=provenance("bdamper.fem.generated_models.blade_to_ground", body),
    )
