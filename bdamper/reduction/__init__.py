"""Reduction of finite element bodies to modes and receptances at contact points.

In: nodes, stiffness and mass of a structure, the matching nodes of its sector faces, facets of its surface.  Out: the
bodies of a model (:class:`bdamper.model.model.Body`): modes for each nodal diameter of a cyclic sector, rigid-body and
elastic modes of a free body, static receptances, all at contact points that are means over patches of the faces;
and the local basis of a wheel of unequal blades.  Others use `CyclicSector`, `FreeBody`, `constrained_body`, `free_body`,
`local_basis`, `patches_on_faces` and `travelling_waves`.
"""

from bdamper.reduction.bodies import Wanted, constrained_body, free_body, needed_nodal_diameters
from bdamper.reduction.cyclic import CyclicSector
from bdamper.reduction.free_body import FreeBody
from bdamper.reduction.local_coordinates import BladePart, LocalSizes, local_basis
from bdamper.reduction.patches import Patches, patches_on_faces, patches_on_rectangles
from bdamper.reduction.waves import travelling_waves

__all__ = [
    "BladePart",
    "CyclicSector",
    "FreeBody",
    "LocalSizes",
    "Patches",
    "Wanted",
    "constrained_body",
    "free_body",
    "local_basis",
    "needed_nodal_diameters",
    "patches_on_faces",
    "patches_on_rectangles",
    "travelling_waves",
]
