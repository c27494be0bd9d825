r"""Blade-to-ground damper (paper, section 4.2): one blade that rubs on the ground, with separation and many points.

The blade of the reference sector with its disk segment, held at the bore and at the two cut faces of the
segment as in a test block, touches a rigid ground with the right underside of its platform:

=========  =====================  =======  ========
interface  body a (normal)        body b   kind
=========  =====================  =======  ========
platform   blade                  ground   friction
=========  =====================  =======  ========

The structure is acyclic (``n_blades = 1``), so that one basis of real modes serves every harmonic.  There is no
free body and no load: normal loads and gaps are settings of a study (``constant_loads``, ``gap``).
"""

from __future__ import annotations

import numpy as np

from bdamper.fem.assembly import Discretisation, discretise
from bdamper.fem.contact_patches import Patches
from bdamper.fem.contact_points import averaging_matrix, wedge_patches
from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.geometry import Geometry, Material
from bdamper.fem.mesh import MeshDensity, sector_mesh
from bdamper.fem.model_parts import blade_nodes, clamped_segment, interface, locations, provenance, surface_mesh
from bdamper.fem.reduced_bodies import Wanted, constrained_body
from bdamper.model.structure import Body, Model


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
        provenance=provenance("bdamper.fem.blade_to_ground_model.blade_to_ground", body),
    )
