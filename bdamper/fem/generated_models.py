"""Generated models: the reference disk (paper, section 4.1) and the blade-to-ground damper
(paper, section 4.2).

**Reference disk.**  The bladed disk has wedge dampers between neighbouring blades, so a blade has
contact with two dampers and a damper with two blades:

=========  ===============  ==================  ==========================
interface  body a (normal)  body b              kind
=========  ===============  ==================  ==========================
left       damper 0         blade 0             friction
right      damper 0         blade 1             friction
front      damper 0         ground (axial stop) constraint, with clearance
back       damper 0         ground (axial stop) constraint, with clearance
=========  ===============  ==================  ==========================

Positions and axes of an interface belong to the damper of sector 0.  Modes and receptances of the
blade at "right" belong to the left platform underside of blade 0, with axes rotated back by one
pitch; :mod:`bdamper.model.kinematics` adds the phase.

Contact points are the centres of rectangular patches of the plane faces (paper, Figs 1 and 3).
With the angle a of a face from the radial axis, the contact axes t1, t2, n in the axes of the
damper are::

    left   (sin a, cos a, 0)    (0, 0, -1)   (-cos a, sin a, 0)
    right  (sin a, -cos a, 0)   (0, 0, -1)   ( cos a, sin a, 0)
    front  (1, 0, 0)            (0, 1, 0)    (0, 0, 1)
    back   (1, 0, 0)            (0, -1, 0)   (0, 0, -1)

so t1 is in the cross-section, n is the outward normal of the damper, and t1, t2, n are
right-handed.

:class:`SectorFE` contains meshes, matrices, factorisations and modes, which do not depend on the
contact points.  One object is thus sufficient for several grids of contact points and for reference
solutions of the full finite element model.

**Blade-to-ground damper.**  The blade with its disk segment is clamped at the bore and at the two
cut faces, as in a test block.  The right underside of its platform has friction contact with the
rigid ground (interface "platform", body a the blade).  The structure is acyclic (``n_blades = 1``),
with one basis of real modes for every harmonic.  There is no free body and no load: normal loads
and gaps are settings of a study (``constant_loads``, ``gap``).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bdamper.fem.contact_patches import Patches, patch_grid, patches_on_rectangles
from bdamper.fem.cyclic_symmetry import CyclicSector, sector_inside
from bdamper.fem.element_stress import Solids, StressRows, near_patches
from bdamper.fem.local_basis import BladePart, LocalSizes, damper_motion, local_basis
from bdamper.fem.meshes import (
    Discretisation,
    ElasticMaterial,
    Geometry,
    MeshDensity,
    airfoil_points,
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
from bdamper.fem.reduced_bodies import (
    FreeBody,
    Wanted,
    constrained_body,
    free_body,
    needed_nodal_diameters,
)
from bdamper.fem.rotation import Rotation
from bdamper.fem.sector_faces import match_faces
from bdamper.fem.sector_inside import SectorInside
from bdamper.model.modal_basis import LocalBasis
from bdamper.model.structure import Body, Interface, Model, StressSet, turn
from bdamper.util import validation
from bdamper.util.progress import with_progress

# ---- Contact points and axes ----


def face_frame(name: str, face_angle: float) -> NDArray:
    """Return the rows t1, t2, n (3, 3) of a damper face in the axes of the damper.

    ``name`` is "left", "right", "front" or "back".
    """
    s = np.sin(face_angle)
    c = np.cos(face_angle)
    frames = {
        "left": [[s, c, 0], [0, 0, -1], [-c, s, 0]],
        "right": [[s, -c, 0], [0, 0, -1], [c, s, 0]],
        "front": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "back": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    }
    return np.array(frames[name], float)


def wedge_patches(g: Geometry, side: str, points: int | tuple[int, int]) -> Patches:
    """Return the patches of the left or right face of the damper of sector 0.

    They are in the axes of blade 0.
    """
    n_s, n_z = patch_grid(points, g.face_length, g.face_width)
    # centres of the patches: distances s down the slope from the ridge, z along the axis
    s = (np.arange(n_s) + 0.5) * g.face_length / n_s
    z = ((np.arange(n_z) + 0.5) / n_z - 0.5) * g.face_width
    # left and right face are mirror images
    mirror = [1.0, 1.0] if side == "left" else [-1.0, 1.0]
    in_section = g.face_points(s) * mirror  # x and y: (n_s, 2)
    centre = np.empty((n_s, n_z, 3))
    centre[..., :2] = in_section[:, None]
    centre[..., 2] = z
    n = n_s * n_z
    frame = np.broadcast_to(face_frame(side, g.face_angle), (n, 3, 3))
    size = np.broadcast_to([g.face_length / n_s, g.face_width / n_z], (n, 2))
    return Patches(centre.reshape(-1, 3), frame, size).turned(turn(0.5 * g.pitch))


def end_patches(g: Geometry, side: str) -> Patches:
    """Return four small patches near the corners of an end face of the damper.

    ``side`` is "front" (+Z) or "back" (-Z).
    """
    eaves = g.ridge_radius - g.face_length * np.cos(g.face_angle)
    width = 0.5 * g.ridge_width + g.face_length * np.sin(g.face_angle)
    z = (0.5 if side == "front" else -0.5) * g.face_width
    y_low = eaves - 0.78 * g.damper_body_height
    y_high = eaves
    x_low = 0.78 * width
    x_high = 0.5 * width
    centre = np.array(
        [[-x_low, y_low, z], [x_low, y_low, z], [-x_high, y_high, z], [x_high, y_high, z]]
    )
    frame = np.broadcast_to(face_frame(side, g.face_angle), (4, 3, 3))
    edge = 0.35 * min(width, g.damper_body_height)
    return Patches(centre, frame, np.full((4, 2), edge)).turned(turn(0.5 * g.pitch))


def damper_patches(g: Geometry, points: int | tuple[int, int]) -> list[Patches]:
    """Return the patches of the left, right, front and back face of the damper of sector 0."""
    slopes = [wedge_patches(g, side, points) for side in ("left", "right")]
    return slopes + [end_patches(g, side) for side in ("front", "back")]


def averaging_matrix(body: Discretisation, *faces: Patches) -> sp.csr_matrix:
    """Return the matrix (3 n_patches, 3 n_nodes) from nodal displacements to patch means along t1,
    t2, n of all faces.

    Raises
    ------
    ValueError
        If the surface of ``body`` does not cover a patch.
    """
    means = [patches_on_rectangles(patches, body.nodes, body.surface) for patches in faces]
    return sp.vstack([mean.matrix_a for mean in means], format="csr")


def damper_body(
    damper: FreeBody[Discretisation],
    faces: Sequence[Patches],
    nodes: Mapping[str, int],
    n_modes: int,
    damping_ratio: float,
    g: Geometry,
) -> Body:
    """Return the damper of sector 0 with the patches of its faces and locations at ``nodes``."""
    wanted = Wanted(
        ports=DAMPER_PORTS,
        contact=averaging_matrix(damper.body, *faces),
        locations=nodes,
        n_modes=n_modes,
        damping_ratio=damping_ratio,
    )
    # blade 0 is along Y, and the damper half a pitch from it
    radial = turn(0.5 * g.pitch)[:, 1]
    return free_body("damper", wanted, damper, radial)


# ---- Finite element bodies ----


@dataclass
class SectorFE:
    """Sector and damper as finite element bodies.

    Parameters
    ----------
    geometry : Geometry
    density : MeshDensity
    material : ElasticMaterial
    keep_factors : bool
        Keep the matrices of all nodal diameters instead of only the last one used; all of them
        share one factorisation.
    """

    geometry: Geometry = field(default_factory=Geometry)
    density: MeshDensity = field(default_factory=lambda: MeshDensity.preset("coarse"))
    material: ElasticMaterial = field(default_factory=ElasticMaterial)
    keep_factors: bool = True

    def __post_init__(self) -> None:
        g = self.geometry
        self.blade: Discretisation = discretise(sector_mesh(g, self.density), self.material)
        damper = discretise(damper_mesh(g, self.density), self.material)
        # the damper lies between blades 0 and 1, half a pitch from blade 0.  The columns of the
        # rotation matrix are the turned axes (tangential, radial, axial); FreeBody takes rows
        damper_axes = turn(0.5 * g.pitch).T
        self.damper: FreeBody[Discretisation] = FreeBody(damper, damper_axes)
        nodes = self.blade.nodes
        # from +Y, the radial direction of blade 0, toward +X as in turn()
        angle = np.arctan2(nodes[:, 0], nodes[:, 1])
        radius = np.hypot(nodes[:, 0], nodes[:, 1])
        on_disk = radius < g.rim_radius + 1e-8
        left = np.flatnonzero(on_disk & (np.abs(angle + 0.5 * g.pitch) < 1e-9))
        right = np.flatnonzero(on_disk & (np.abs(angle - 0.5 * g.pitch) < 1e-9))
        self.faces = match_faces(nodes, left, right, g.n_blades)
        # midpoints of straight edges along the bore lie slightly inside its radius, all others
        # outside
        self.clamped: NDArray = np.flatnonzero(radius < g.bore_radius + 1e-8)
        self._cyclic: dict[int, CyclicSector] = {}

    @cached_property
    def _inside(self) -> SectorInside:
        return sector_inside(self.blade, self.faces, self.clamped)

    def cyclic(self, nodal_diameter: int) -> CyclicSector:
        """Return the sector at one nodal diameter, 0 to ``n_blades // 2``."""
        validation.integer("nodal diameter", nodal_diameter, most=self.geometry.n_blades // 2)
        if not self.keep_factors:
            for d, other in self._cyclic.items():
                if d != nodal_diameter:
                    other.forget_matrices()
        if nodal_diameter not in self._cyclic:
            self._cyclic[nodal_diameter] = CyclicSector(
                self.blade, self.faces, self.clamped, nodal_diameter, self._inside
            )
        return self._cyclic[nodal_diameter]

    def rotation(self, check_at: float | None = None) -> Rotation:
        """Return the change of the stiffness of the sector with rotor speed.

        Parameters
        ----------
        check_at : float, rad/s, optional
            Speed for a comparison with the frequencies of the full matrices.
        """
        per_squared_speed = stiffness_per_squared_speed(self.blade, self.cyclic(0))
        return Rotation(per_squared_speed, omega_ref=0.0, check_at=check_at, source="bdamper.fem")

    def blade_part(self) -> BladePart:
        """Return shank, platform and airfoil as the blade of a mistuned bladed disk; its root is at
        the rim."""
        _disk, *blade_blocks = sector_blocks(self.geometry, self.density)
        part = discretise(join_blocks(blade_blocks), self.material)
        # the same nodes in the numbering of the sector
        _, nodes = cKDTree(self.blade.nodes).query(part.nodes)
        dofs = self.blade.dofs(nodes)
        entries = part.stiffness.tocoo()
        shape = self.blade.stiffness.shape
        stiffness = sp.csr_matrix(
            (entries.data, (dofs[entries.row], dofs[entries.col])), shape=shape
        )
        fixed = np.zeros((len(self.blade.nodes), 3), bool)
        fixed[self.clamped] = True
        return BladePart(self.blade, nodes, fixed, stiffness)

    def local_basis(
        self, wanted: Wanted, interfaces: Mapping[str, Interface], sizes: LocalSizes
    ) -> LocalBasis:
        """Compute the local basis of blade and disk for mistuned bladed disks; see
        :func:`bdamper.fem.local_basis`."""
        dampers = damper_motion(wanted.ports, interfaces)
        return local_basis(
            self.blade_part(), self.cyclic, wanted, dampers, sizes, "shank, platform and airfoil"
        )

    def blade_contact(self, left: Patches, right: Patches) -> sp.csr_matrix:
        """Return the averaging matrix of blade 0 for its ports at the interfaces "left" and
        "right", in this order.

        At "right" the blade is in sector +1.  The corresponding face of blade 0 is its left
        underside: the patches rotated back by one pitch.
        """
        return averaging_matrix(self.blade, left, right.turned(turn(-self.geometry.pitch)))


# ---- Stress of the blade ----


def solids_of(body: Discretisation) -> tuple[Solids, ...]:
    """Return the elements of a body with their material."""
    material = body.material
    nodes = body.elements[:, local_order()]
    return (Solids("C3D20", nodes, material.youngs_modulus, material.poisson_ratio),)


def blade_stress(
    fe: SectorFE,
    contact: sp.spmatrix,
    faces: tuple[Patches, Patches],
    nodal_diameters: Iterable[int],
    n_modes: int,
) -> dict[str, StressSet]:
    """Compute the stress set "blade" of the reference sector at :func:`blade_points`, in single
    precision.

    Parameters
    ----------
    fe : SectorFE
    contact : (3 n_points, 3 n_nodes) sparse
    faces : Patches of the damper faces "left" and "right"
    nodal_diameters : iterable of int
    n_modes : int
    """
    nodes = blade_points(fe.blade, fe.geometry)
    left, right = faces
    # the right face presses on blade 1; the same place of blade 0 is one pitch back
    right_on_blade = right.turned(turn(-fe.geometry.pitch))
    near = near_patches(fe.blade.nodes[nodes], left, right_on_blade)
    rows = StressRows("blade", solids_of(fe.blade), fe.blade.nodes, nodes, near)
    for d in sorted({0, *nodal_diameters}):
        sector = fe.cyclic(d)
        omega2, shapes = sector.modes(n_modes)
        rows.add(sector, contact, omega2, shapes)
    return {"blade": rows.set("blade", "bdamper.fem.generated_models, mean over elements at nodes")}


def blade_points(body: Discretisation, g: Geometry) -> NDArray:
    """Return nodes around the airfoil at a sixth of its height, and around the shank at half of it.

    Around the airfoil these are leading edge, trailing edge and the middle of either side; around
    the shank its four edges and the middle of either side.
    """
    root = g.ridge_radius + g.platform_edge_thickness
    # the root itself is a sharp edge
    around_airfoil = airfoil_points(
        g, [0.0, 0.0, -1.0, 1.0], [-1.0, 1.0, 0.0, 0.0], 1.0 / 6.0, root
    )
    at_shank = np.array([g.underside_range[1]])
    underside = float(g.underside_points(at_shank)[0, 1])
    rim = np.sqrt(g.rim_radius**2 - 0.25 * g.shank_width**2)
    middle = 0.5 * (rim + underside)
    places = [*around_airfoil]
    for side in (-1, 1):
        for end in (-1, 0, 1):
            x = side * 0.5 * g.shank_width
            z = end * 0.5 * g.axial_length
            places.append(np.array([x, middle, z]))
    return np.array([body.nearest_node(place) for place in places])


# ---- Bladed disk (paper, section 4.1) ----


BLADE_PORTS = (("left", "b"), ("right", "b"))
DAMPER_PORTS = (("left", "a"), ("right", "a"), ("front", "a"), ("back", "a"))
GROUND = Body("ground", "ground", (("front", "b"), ("back", "b")))


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
    """Generate the reference disk.

    Parameters
    ----------
    points : int or (int, int)
        Number of contact points on each face, or numbers along slope and axis.  With more points
        than nodes on the face the static receptance is singular.
    mesh : {"coarse", "reference"}
        Density of the mesh; ignored if ``fe`` is given.
    n_modes, n_damper_modes : int
        Modes of the blade at each nodal diameter, and modes of the damper including six rigid-body
        modes.
    engine_order, harmonics : int
        Determine the nodal diameters, unless ``nodal_diameters`` is given.
    damping_ratio : float
        Damping ratio of all elastic modes.
    nodal_diameters : tuple of int, optional
        0 to N/2; 0 is always added for the mean position.
    pictures : tuple of int
        Nodal diameters with mode shapes on the surface of the blade.
    rotation : Rotation or float, optional
        For a model with speed-dependent data: result of :meth:`SectorFE.rotation`, or the speed
        (rad/s) of its check.
    fe : SectorFE, optional
        Existing finite element bodies; only the parts that depend on the contact points are
        computed.
    wheel : LocalSizes, optional
        Sizes of a local basis for mistuned bladed disks; none by default.
    stress, progress : bool
        Add the stress set "blade" (:func:`blade_points`) at all nodal diameters; show a progress
        bar.

    Returns
    -------
    Model
        Without contact stiffness (``contact`` is empty).  Rigid translations of the damper are
        along its tangential, radial and axial direction; all other data are in the axes of blade 0.
    """
    if fe is None:
        fe = SectorFE(density=MeshDensity.preset(mesh))
    g = fe.geometry
    if nodal_diameters is None:
        nodal_diameters = needed_nodal_diameters(g.n_blades, engine_order, harmonics)
    diameters = tuple(sorted({0, *nodal_diameters}))
    patches = damper_patches(g, points)
    left, right, front, back = patches
    interfaces = {
        "left": interface("left", left, "damper", "blade"),
        "right": interface("right", right, "damper", "blade", sector_b=1),
        "front": interface("front", front, "damper", "ground", clearance=g.end_gap),
        "back": interface("back", back, "damper", "ground", clearance=g.end_gap),
    }
    contact = fe.blade_contact(left, right)
    nodes = blade_nodes(fe.blade, g)
    if isinstance(rotation, int | float):
        rotation = fe.rotation(rotation)
    reported = with_progress(diameters, progress, "finite element model", "nodal diameter")
    wanted = Wanted(
        ports=BLADE_PORTS,
        contact=contact,
        locations=nodes,
        n_modes=n_modes,
        damping_ratio=damping_ratio,
    )
    blade = constrained_body("blade", wanted, fe.cyclic, reported, rotation)
    if wheel is not None:
        blade = replace(blade, local=fe.local_basis(wanted, interfaces, wheel))
    centre = {"damper": fe.damper.body.nearest_node(fe.damper.centre)}
    damper = damper_body(fe.damper, patches, centre, n_damper_modes, damping_ratio, g)
    pictured = {}
    for d in pictures:
        _, shapes = fe.cyclic(d).modes(n_modes)
        pictured[d] = shapes
    stress_sets = {}
    if stress:
        stress_sets = blade_stress(fe, contact, (left, right), diameters, n_modes)
    return Model(
        n_blades=g.n_blades,
        bodies={"blade": blade, "damper": damper, "ground": GROUND},
        interfaces=interfaces,
        locations=locations("blade", fe.blade, nodes) | locations("damper", fe.damper.body, centre),
        meshes={
            "blade": surface_mesh(fe.blade, pictured),
            "damper": surface_mesh(fe.damper.body),
        },
        provenance=provenance(
            "bdamper.fem.generated_models",
            fe.blade,
            fe.damper.body,
            over_speed=rotation is not None,
        ),
        stress=stress_sets,
    )


# ---- Large reference models, made by `bdamper.reference_model` on first use ----


def reference_disk(points: int, progress: bool = False) -> Model:
    """Generate the disk of 65 blades with 24 or 48 contact points on each face."""
    fe = SectorFE(Geometry(), MeshDensity.preset("reference"), keep_factors=False)
    return bladed_disk(points, fe=fe, pictures=(5,), progress=progress)


def paper_disk(points: int, progress: bool = False) -> Model:
    """Generate the disk of the paper with 9, 24 or 48 contact points.

    They lie in 3, 4 and 4 rows along the slope.
    """
    n_rows = 3 if points == 9 else 4
    # the others are small files with one harmonic
    is_full = points == 24
    return bladed_disk(
        (n_rows, points // n_rows),
        fe=SectorFE(paper_geometry(), MeshDensity.preset("coarse")),
        damping_ratio=0.0021,
        harmonics=7 if is_full else 1,
        n_modes=40 if is_full else 20,
        pictures=(5,),
        progress=progress,
    )


MAKERS = {"bladed_disk": reference_disk, "paper_disk": paper_disk}


# ---- Blade-to-ground damper (paper, section 4.2) ----


def blade_structure(
    g: Geometry, density: MeshDensity, material: ElasticMaterial
) -> tuple[Discretisation, CyclicSector]:
    """Return the sector of one blade, clamped at the bore and at its cut faces, as an acyclic
    structure."""
    body = discretise(sector_mesh(g, density), material)
    return body, clamped_segment(body, g, n_pitches=1)


def blade_to_ground(
    points: int | tuple[int, int] = 24,
    mesh: str = "coarse",
    n_modes: int = 40,
    damping_ratio: float = 0.002,
    geometry: Geometry | None = None,
    material: ElasticMaterial | None = None,
) -> Model:
    """Generate the model of a blade in friction contact with the ground.

    Parameters
    ----------
    points : int or (int, int)
        Number of contact points, or numbers along slope and axis.
    mesh : {"coarse", "reference"}
    n_modes : int
    damping_ratio : float
        Damping ratio of all modes.
    geometry : Geometry, optional
    material : ElasticMaterial, optional

    Returns
    -------
    Model
        Bodies "blade" and "ground" with the interface "platform" between them.
    """
    g = geometry or Geometry()
    body, structure = blade_structure(g, MeshDensity.preset(mesh), material or ElasticMaterial())

    # the blade touches with the face opposite the damper: t1 stays, t2 and the normal are reversed
    damper_face = wedge_patches(g, "left", points)
    reverse_t2_and_normal = np.array([1.0, -1.0, -1.0])[:, None]
    frame = damper_face.frame * reverse_t2_and_normal  # rows t1, t2, n
    patches = Patches(damper_face.centre, frame, damper_face.size)
    nodes = blade_nodes(body, g)
    wanted = Wanted(
        ports=(("platform", "a"),),
        contact=averaging_matrix(body, patches),
        locations=nodes,
        n_modes=n_modes,
        damping_ratio=damping_ratio,
    )

    # a single blade has the same structure at any nodal diameter
    def structure_at(nodal_diameter: int) -> CyclicSector:
        return structure

    blade = constrained_body("blade", wanted, sector=structure_at, nodal_diameters=(0,))
    _, shapes = structure.modes(n_modes)
    return Model(
        n_blades=1,
        bodies={"blade": blade, "ground": Body("ground", "ground", (("platform", "b"),))},
        interfaces={"platform": interface("platform", patches, "blade", "ground")},
        locations=locations("blade", body, nodes),
        meshes={"blade": surface_mesh(body, {0: shapes})},
        provenance=provenance("bdamper.fem.generated_models.blade_to_ground", body),
    )
