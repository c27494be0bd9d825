"""Parts that the finite element models have in common: interfaces, locations, surfaces, provenance."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from typing import Literal

import numpy as np
import scipy
import skfem
from numpy.typing import NDArray

from bdamper.fem.assembly import Discretisation
from bdamper.fem.contact_patches import Patches
from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.geometry import Geometry
from bdamper.fem.reduced_bodies import PICTURED_MODES, picture_mesh
from bdamper.fem.sector_faces import no_faces
from bdamper.model.structure import Interface, Location, SurfaceMesh


def clamped_segment(body: Discretisation, g: Geometry, n_pitches: int) -> CyclicSector:
    """Disk segment of ``n_pitches`` pitches, clamped at the bore and at its two cut faces: an acyclic structure."""
    angle, radius = np.arctan2(body.nodes[:, 0], body.nodes[:, 1]), np.hypot(body.nodes[:, 0], body.nodes[:, 1])
    cut = (radius < g.rim_radius + 1e-8) & (np.abs(angle) > 0.5 * n_pitches * g.pitch - 1e-9)
    clamped = np.flatnonzero((radius < g.bore_radius + 1e-8) | cut)
    return CyclicSector(body, no_faces(), clamped, 0)


def surface_mesh(body: Discretisation, shapes: Mapping[int, NDArray] | None = None) -> SurfaceMesh:
    """Outer surface of a body as quadrilaterals of its corner nodes.

    Parameters
    ----------
    body : Discretisation
    shapes : mapping of nodal diameter to (3 n_nodes, n_modes), optional
        Mode shapes that are kept at the nodes of the surface.
    """
    kept = {d: columns.reshape(-1, 3, columns.shape[1])[..., : PICTURED_MODES] for d, columns in (shapes or {}).items()}
    return picture_mesh(body.surface, body.nodes, kept)


def interface(
    name: str, patches: Patches, body_a: str, body_b: str, *, sector_b: int = 0, clearance: float | None = None
) -> Interface:
    """Interface with a contact point in each patch: friction without gap, or an axial stop with a clearance (m)."""
    kind: Literal["friction", "constraint"] = "friction" if clearance is None else "constraint"
    gap = np.full(len(patches.size), clearance or 0.0)
    places = (patches.centre.copy(), patches.area, np.array(patches.frame))
    return Interface(name, kind, body_a, 0, body_b, sector_b, *places, gap)


def blade_nodes(body: Discretisation, g: Geometry) -> dict[str, int]:
    """Nodes of the blade at which it is excited and observed: "tip" and "platform" in the middle of the chord,
    "tip_trailing_edge" and "tip_leading_edge" at its ends (toward +Z and -Z), on the mean line of the airfoil.
    """
    top = g.ridge_radius + g.platform_edge_thickness
    c, s, x, z = np.cos(g.twist), np.sin(g.twist), -2.0 * g.camber / 3.0, 0.5 * g.tip_chord
    heights = {"tip": top + g.airfoil_height, "platform": top}
    places = {name: [g.camber / 3.0, y, 0.0] for name, y in heights.items()}
    for name, end in (("tip_trailing_edge", z), ("tip_leading_edge", -z)):
        places[name] = [c * x + s * end, heights["tip"], c * end - s * x]
    return {name: body.nearest_node(np.array(place)) for name, place in places.items()}


def locations(name: str, body: Discretisation, nodes: Mapping[str, int]) -> dict[str, Location]:
    """Named nodes of a body as locations."""
    return {place: Location(place, name, body.nodes[node].copy()) for place, node in nodes.items()}


def provenance(source: str, *bodies: Discretisation, over_speed: bool = False) -> dict[str, str]:
    """Origin of a model: function, programs, date and mesh."""
    elements = " + ".join(str(body.mesh.t.shape[1]) for body in bodies)
    return {
        "source": source,
        "programs": f"scikit-fem {skfem.__version__}, scipy {scipy.__version__}, numpy {np.__version__}",
        "date": datetime.date.today().isoformat(),
        "elements": f"{elements} 20-node hexahedra",
        "rotor speed": f"0 (stress stiffening and spin softening {'by squared speed' if over_speed else 'left out'})",
    }
