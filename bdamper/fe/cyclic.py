"""One sector at one nodal diameter: see :mod:`bdamper.reduction.cyclic`."""

from bdamper.reduction.cyclic import CyclicSector, cyclic_transformation, match_faces

__all__ = ["CyclicSector", "cyclic_transformation", "match_faces"]
