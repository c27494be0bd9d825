r"""A friction damping rig: one test blade with two wedge dampers between dummy blades, as an acyclic structure.

A disk segment of three pitches carries the test blade in the middle and a dummy blade, that is shank and
platform without airfoil, at each side.  The segment is held at the bore and at its two cut faces.  The
three blades are one constrained body; the two dampers are free and each is pulled by the same load, as by
wires, along its own radial direction:

==============  =============  =======================  ===========================
interface       body a         body b                   kind
==============  =============  =======================  ===========================
left_outer      damper_left    blades (dummy at -X)     friction
left_inner      damper_left    blades (test blade)      friction
right_inner     damper_right   blades (test blade)      friction
right_outer     damper_right   blades (dummy at +X)     friction
left_front ...  damper_...     ground (axial stops)     constraint, with clearance
==============  =============  =======================  ===========================

The load of the dampers is that of a centrifugal field, scaled to a resultant of 1 N on each of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from bdamper.fe.assemble import Discretisation, discretise
from bdamper.fe.contact_points import averaging_matrix, end_patches, wedge_patches
from bdamper.fe.geometry import Geometry, Material, turn
from bdamper.fe.mesh import MeshDensity, damper_mesh, rig_mesh
from bdamper.fe.parts import clamped_segment, friction_face, locations, provenance, surface_mesh
from bdamper.model.model import Body, Interface, Model
from bdamper.reduction.bodies import constrained_body, free_body
from bdamper.reduction.cyclic import CyclicSector
from bdamper.reduction.free_body import FreeBody
from bdamper.reduction.patches import Patches


def rig_structure(g: Geometry, density: MeshDensity, material: Material) -> tuple[Discretisation, CyclicSector]:
    """The test blade between its dummies, held at the bore and at the cut faces of the segment."""
    body = discretise(rig_mesh(g, density), material)
    return body, clamped_segment(body, g, 3)


def rig(
    points: int | tuple[int, int] = 24,
    mesh: str = "coarse",
    n_modes: int = 40,
    n_damper_modes: int = 10,
    damping_ratio: float = 0.002,
    geometry: Geometry | None = None,
    material: Material | None = None,
) -> Model:
    """Build the model of the test rig.

    Parameters
    ----------
    points : int or (int, int)
        Contact points on each face of a damper, or their number along slope and axis.
    mesh : {"coarse", "reference"}
    n_modes : int
        Of the three blades together.
    n_damper_modes : int
        Of each damper, the six rigid ones included.
    damping_ratio : float
        Of all elastic modes.
    geometry, material : optional
    """
    g, steel, density = geometry or Geometry(), material or Material(), MeshDensity.preset(mesh)
    blades, structure = rig_structure(g, density, steel)
    # The damper at the right stands between sector 0 and 1; the one at the left is the same, a pitch back.
    damper = FreeBody(discretise(damper_mesh(g, density), steel), turn(0.5 * g.pitch).T)
    faces = {side: wedge_patches(g, side, points) for side in ("left", "right")}
    ends = {side: end_patches(g, side) for side in ("front", "back")}
    back = turn(-g.pitch)

    interfaces: dict[str, Interface] = {}
    ports: dict[str, tuple[tuple[str, str], ...]] = {}
    touching: list[Patches] = []
    for side, rotation, names in (
        ("left", back, ("left_outer", "left_inner")),
        ("right", np.eye(3), ("right_inner", "right_outer")),
    ):
        for name, patches in zip(names, (faces["left"], faces["right"])):
            there = patches.turned(rotation)
            touching.append(there)
            interfaces[name] = friction_face(name, there, f"damper_{side}", "blades")
        for end, patches in ends.items():
            face = friction_face(f"{side}_{end}", patches.turned(rotation), f"damper_{side}", "ground")
            interfaces[face.name] = replace(face, kind="constraint", gap=np.full(len(face.gap), g.end_gap))
        ports[side] = tuple((name, "a") for name in (*names, f"{side}_front", f"{side}_back"))
    friction = [name for name, face in interfaces.items() if face.kind == "friction"]

    top = g.ridge_radius + g.platform_edge_thickness
    places = {
        "tip": blades.nearest_node(np.array([g.camber / 3.0, top + g.airfoil_height, 0.0])),
        "platform": blades.nearest_node(np.array([g.camber / 3.0, top, 0.0])),
    }
    contact = sp.vstack([averaging_matrix(blades, patches) for patches in touching], format="csr")
    bodies = {
        "blades": constrained_body(
            "blades",
            tuple((name, "b") for name in friction),
            lambda _: structure,
            contact,
            places,
            (0,),
            n_modes,
            damping_ratio,
            (0,),
        )
    }
    meshes = {"blades": surface_mesh(blades, {0: structure.modes(n_modes)[1]})}

    # In its own contact axes a damper is the same at both places: only positions and directions turn.
    own = sp.vstack([averaging_matrix(damper.body, p) for p in (*faces.values(), *ends.values())], format="csr")
    radial = turn(0.5 * g.pitch) @ [0.0, 1.0, 0.0]
    one = free_body("damper", ports["right"], damper, own, {}, n_damper_modes, damping_ratio, radial)
    assert one.centre is not None and one.inertia is not None and one.load is not None
    surface = surface_mesh(damper.body)
    for side, rotation in (("left", back), ("right", np.eye(3))):
        name = f"damper_{side}"
        bodies[name] = replace(
            one,
            name=name,
            ports=ports[side],
            centre=rotation @ one.centre,
            inertia=rotation @ one.inertia @ rotation.T,
            load=replace(one.load, direction=rotation @ radial),
        )
        meshes[name] = replace(surface, points=surface.points @ rotation.T)
    constraints = [name for name, face in interfaces.items() if face.kind == "constraint"]
    bodies["ground"] = Body("ground", "ground", tuple((name, "b") for name in constraints))
    return Model(
        n_blades=1,
        bodies=bodies,
        interfaces=interfaces,
        locations=locations("blades", blades, places),
        meshes=meshes,
        provenance=provenance("bdamper.fe.rig.rig", blades, damper.body),
    )
