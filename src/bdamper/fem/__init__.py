"""Finite element structures reduced to modes and static flexibility, and generated models.

`CyclicSector` and `FreeBody` reduce the matrices of one body to modes and to receptances at contact points, which are
means over patches of the contact faces.  `reduced_bodies` makes the bodies of a model from them
(:class:`bdamper.model.structure.Body`), and `local_basis` the sector-local basis of a mistuned disk.  `bladed_disk` and
`blade_to_ground` generate complete models from dimensions; they need scikit-fem (extra ``bdamper[fe]``), imported at first
use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bdamper.fem.reduced_bodies import Wanted
from bdamper.fem.sector_local_basis import BladePart, LocalSizes, local_basis

if TYPE_CHECKING:
    from bdamper.fem.blade_to_ground_model import blade_to_ground
    from bdamper.fem.bladed_disk_model import bladed_disk
    from bdamper.fem.geometry import Geometry, Material
    from bdamper.fem.mesh import MeshDensity
    from bdamper.fem.sector_matrices import SectorFE

__all__ = [
    "BladePart", "Geometry", "LocalSizes", "Material", "MeshDensity", "SectorFE", "Wanted", "blade_to_ground",
    "bladed_disk",
    "local_basis",
]  # fmt: skip

_GENERATORS = {
    "Geometry": "geometry", "Material": "geometry", "MeshDensity": "mesh", "SectorFE": "sector_matrices",
    "blade_to_ground": "blade_to_ground_model", "bladed_disk": "bladed_disk_model",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _GENERATORS:
        try:
            return getattr(import_module(f"bdamper.fem.{_GENERATORS[name]}"), name)
        except ModuleNotFoundError as error:
            raise ImportError(f"bdamper.fem.{name} needs scikit-fem: install the extra bdamper[fe]") from error
    raise AttributeError(f"module 'bdamper.fem' has no attribute {name!r}")
