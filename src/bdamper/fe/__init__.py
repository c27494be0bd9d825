"""Finite element models of a bladed disk with wedge dampers, and of a blade on the ground.

In: dimensions, material and mesh density.  Out: a :class:`bdamper.model.model.Model` from `bladed_disk` or
`blade_to_ground`.  `SectorFE` keeps the matrices, factorisations and modes that do not depend on the contact points.  The
room needs scikit-fem (extra ``bdamper[fe]``).
"""

try:
    import skfem as _skfem  # noqa: F401
except ImportError as error:
    raise ImportError("bdamper.fe needs scikit-fem: install the extra bdamper[fe]") from error

from bdamper.fe.blade_to_ground import blade_to_ground
from bdamper.fe.geometry import Geometry, Material
from bdamper.fe.mesh import MeshDensity
from bdamper.fe.reference import bladed_disk
from bdamper.fe.sector import SectorFE

__all__ = ["Geometry", "Material", "MeshDensity", "SectorFE", "blade_to_ground", "bladed_disk"]
