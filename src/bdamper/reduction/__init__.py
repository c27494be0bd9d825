"""Reduction of finite element bodies to modes and receptances at contact points.

In: nodes, stiffness and mass of a structure, the matching nodes of its sector faces, facets of its surface.  Out: the
bodies of a model (:class:`bdamper.model.model.Body`): modes for each nodal diameter of a cyclic sector, rigid-body and
elastic modes of a free body, static receptances, all at contact points that are means over patches of the faces;
and the local basis of a mistuned wheel.  Others use `CyclicSector`, `FreeBody`, `constrained_body`, `free_body`,
`local_basis`, `patches_on_faces` and `travelling_waves`.
"""

from bdamper.reduction.bodies import Wanted
from bdamper.reduction.local_coordinates import BladePart, LocalSizes, local_basis

__all__ = ["BladePart", "LocalSizes", "Wanted", "local_basis"]
