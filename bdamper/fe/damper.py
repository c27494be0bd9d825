"""The free body: see :mod:`bdamper.reduction.free_body`."""

from bdamper.reduction.free_body import FreeBody, isostatic_dofs, rigid_motions

__all__ = ["FreeBody", "isostatic_dofs", "rigid_motions"]
