r"""Test rig (paper, section 4.3): one test blade with two wedge dampers between dummy blades, an acyclic structure.

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
from numpy.typing import NDArray
from skfem import MeshHex

from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.generated_models import averaging_matrix, damper_body, damper_patches
from bdamper.fem.meshes import (
    Discretisation,
    ElasticMaterial,
    Geometry,
    MeshDensity,
    blade_nodes,
    clamped_segment,
    damper_mesh,
    discretise,
    interface,
    join_blocks,
    locations,
    provenance,
    sector_blocks,
    surface_mesh,
)
from bdamper.fem.reduced_bodies import FreeBody, Wanted, constrained_body
from bdamper.model.structure import Body, Model, turn

FACES = {
    "left": ("left_outer", "left_inner", "left_front", "left_back"),
    "right": ("right_inner", "right_outer", "right_front", "right_back"),
}
"""Interfaces at the left, right, front and back face of each damper."""


def rig_mesh(g: Geometry, n: MeshDensity) -> MeshHex:
    """Blade 0 between two neighbours without airfoil, on a disk segment of three pitches."""
    blocks = sector_blocks(g, n)
    for side in (-1, 1):
        blocks += [block @ turn(side * g.pitch).T for block in blocks[:3]]
    return join_blocks(blocks)


def rig_structure(
    g: Geometry, density: MeshDensity, material: ElasticMaterial
) -> tuple[Discretisation, CyclicSector]:
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
    material: ElasticMaterial | None = None,
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
    g, steel, density = (
        geometry or Geometry(),
        material or ElasticMaterial(),
        MeshDensity.preset(mesh),
    )
    blades, structure = rig_structure(g, density, steel)
    # The damper at the right stands between sector 0 and 1; the one at the left is the same, a pitch back.
    damper = FreeBody(discretise(damper_mesh(g, density), steel), turn(0.5 * g.pitch).T)
    places = {"left": turn(-g.pitch), "right": np.eye(3)}
    patches = damper_patches(g, points)

    interfaces, touching = {}, []
    for side, rotation in places.items():
        there = [p.turned(rotation) for p in patches]
        touching += there[:2]
        for name, p in zip(FACES[side][:2], there[:2]):
            interfaces[name] = interface(name, p, f"damper_{side}", "blades")
        for name, p in zip(FACES[side][2:], there[2:]):
            interfaces[name] = interface(name, p, f"damper_{side}", "ground", clearance=g.end_gap)
    ports = {
        kind: tuple((name, "b") for name, face in interfaces.items() if face.kind == kind)
        for kind in ("friction", "constraint")
    }

    nodes = blade_nodes(blades, g)
    wanted = Wanted(
        ports["friction"], averaging_matrix(blades, *touching), nodes, n_modes, damping_ratio
    )
    held = constrained_body("blades", wanted, lambda _: structure, (0,))
    bodies = {"blades": held}
    meshes = {"blades": surface_mesh(blades, {0: structure.modes(n_modes)[1]})}
    one = damper_body(damper, patches, {}, n_damper_modes, damping_ratio, g)
    surface = surface_mesh(damper.body)
    for side, rotation in places.items():
        body = _placed(one, side, rotation)
        bodies[body.name] = body
        meshes[body.name] = replace(surface, points=surface.points @ rotation.T)
    bodies["ground"] = Body("ground", "ground", ports["constraint"])
    return Model(
        n_blades=1,
        bodies=bodies,
        interfaces=interfaces,
        locations=locations("blades", blades, nodes),
        meshes=meshes,
        provenance=provenance("tools.rig", blades, damper.body),
    )


def _placed(damper: Body, side: str, rotation: NDArray) -> Body:
    """The damper of one side: only positions and directions turn."""
    assert damper.centre is not None and damper.inertia is not None and damper.load is not None
    return replace(
        damper,
        name=f"damper_{side}",
        ports=tuple((name, "a") for name in FACES[side]),
        centre=rotation @ damper.centre,
        inertia=rotation @ damper.inertia @ rotation.T,
        load=replace(damper.load, direction=rotation @ damper.load.direction),
    )
