"""Whole wheels with blades and dampers that differ: mistuning, harmonic balance, samples of wheels and their statistics.

In: a problem whose model has a sector-local basis.  Out: curves and peaks of every blade, and statistics of many wheels.
"""

from bdamper.wheel.mistuning import DamperVariation, Mistuning

__all__ = ["DamperVariation", "Mistuning"]
