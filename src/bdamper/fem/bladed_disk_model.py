"""The reference model (paper, section 4.1): a bladed disk of 65 sectors with wedge dampers, from finite element meshes.

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
"""

from __future__ import annotations

from dataclasses import replace

from bdamper.fem.blade_stress import blade_stress
from bdamper.fem.contact_patches import Patches
from bdamper.fem.contact_points import end_patches, wedge_patches
from bdamper.fem.mesh import MeshDensity
from bdamper.fem.model_parts import blade_nodes, interface, locations, provenance, surface_mesh
from bdamper.fem.reduced_bodies import Wanted, constrained_body, free_body, needed_nodal_diameters
from bdamper.fem.rotation import Rotation
from bdamper.fem.sector_local_basis import LocalSizes
from bdamper.fem.sector_matrices import SectorFE
from bdamper.model.structure import Body, Interface, Model, turn
from bdamper.util.progress import each

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
        Also the stress set "blade" (:func:`bdamper.fem.blade_stress.blade_points`), at all the nodal diameters; a bar over
        these.

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
    turns = each(diameters, progress, "finite element model", "nodal diameter")
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
        provenance=provenance("bdamper.fem.bladed_disk_model", fe.blade, fe.damper.body, over_speed=rotation is not None),
        stress={} if not stress else blade_stress(fe, contact, (left, right), diameters, n_modes),
    )
