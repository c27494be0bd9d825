"""Finite element structures reduced to modes and static flexibility, and generated models.

A contact point represents a patch of a contact face by the mean motion of the patch.
`CyclicSector` and `FreeBody` reduce the matrices of one body to modes, and to receptances between
contact points.  `reduced_bodies` converts them to bodies of a model
(:class:`bdamper.model.structure.Body`), and `local_basis` computes the basis of blade and disk for
mistuned bladed disks.  `bladed_disk` and `blade_to_ground` generate complete models from
dimensions; they need scikit-fem (extra ``bdamper[fe]``).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bdamper.fem.local_basis import BladePart, LocalSizes, local_basis
from bdamper.fem.reduced_bodies import Wanted

if TYPE_CHECKING:
    from bdamper.fem.generated_models import SectorFE, blade_to_ground, bladed_disk
    from bdamper.fem.meshes import ElasticMaterial, Geometry, MeshDensity

__all__ = [
    "BladePart", "ElasticMaterial", "Geometry", "LocalSizes", "MeshDensity", "SectorFE", "Wanted", "blade_to_ground",
    "bladed_disk", "local_basis",
]  # fmt: skip

_GENERATORS = {
    "ElasticMaterial": "meshes", "Geometry": "meshes", "MeshDensity": "meshes", "SectorFE": "generated_models",
    "blade_to_ground": "generated_models", "bladed_disk": "generated_models",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _GENERATORS:
        try:
            return getattr(import_module(f"bdamper.fem.{_GENERATORS[name]}"), name)
        except ModuleNotFoundError as error:
            raise ImportError(
                f"bdamper.fem.{name} needs scikit-fem: install the extra bdamper[fe]"
            ) from error
    if name == "Material":
        raise AttributeError(
            "bdamper.fem: Material is now ElasticMaterial; bdamper.fatigue.Material has strength data"
        )
    raise AttributeError(f"module 'bdamper.fem' has no attribute {name!r}")
