"""Finite element models of a bladed disk with wedge dampers, built with scikit-fem (extra ``bdamper[fe]``).

`bladed_disk` returns the reference model; `SectorFE` keeps what does not depend on the contact points.
"""

try:
    import skfem as _skfem  # noqa: F401
except ImportError as error:
    raise ImportError("bdamper.fe needs scikit-fem: install the extra bdamper[fe]") from error

from bdamper.fe.blade_to_ground import blade_to_ground
from bdamper.fe.geometry import Geometry, Material
from bdamper.fe.mesh import MeshDensity
from bdamper.fe.reference import bladed_disk
from bdamper.fe.rig import rig
from bdamper.fe.sector import SectorFE

__all__ = ["Geometry", "Material", "MeshDensity", "SectorFE", "blade_to_ground", "bladed_disk", "rig"]
