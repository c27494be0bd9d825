"""The reference models that are too large for the wheel, as `bdamper.reference_model` makes them on first use.

In: name and number of contact points.  Out: the model, the same as the stored one up to rounding
(``tools/make_reference_model.py --check``).
"""

from __future__ import annotations

from bdamper.fem.bladed_disk_model import bladed_disk
from bdamper.fem.geometry import Geometry, paper_geometry
from bdamper.fem.mesh import MeshDensity
from bdamper.fem.sector_matrices import SectorFE
from bdamper.model.structure import Model


def reference_disk(points: int, progress: bool = False) -> Model:
    """The disk of 65 blades with 24 or 48 contact points on each face."""
    fe = SectorFE(Geometry(), MeshDensity.preset("reference"), keep_factors=False)
    return bladed_disk(points, fe=fe, pictures=(5,), progress=progress)


def paper_disk(points: int, progress: bool = False) -> Model:
    """The body of the paper with 9, 24 or 48 contact points: 3, 4 and 4 rows along the slope, where the mesh has five."""
    rows, full = 3 if points == 9 else 4, points == 24  # the others have one harmonic only, for the size of their files
    return bladed_disk(
        (rows, points // rows),
        fe=SectorFE(paper_geometry(), MeshDensity.preset("coarse")),
        damping_ratio=0.0021,
        harmonics=7 if full else 1,
        n_modes=40 if full else 20,
        pictures=(5,),
        progress=progress,
    )


MAKERS = {"bladed_disk": reference_disk, "paper_disk": paper_disk}
