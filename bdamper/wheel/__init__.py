"""Whole wheels with blades and dampers that differ: mistuning, harmonic balance, samples of wheels and their statistics.

In: a problem whose model has a sector-local basis.  Out: curves and peaks of every blade, and statistics of many wheels.
"""

from bdamper.wheel.mistuning import DamperVariation, Mistuning
from bdamper.wheel.results import WheelCurve, WheelPeak
from bdamper.wheel.wheel import Wheel

__all__ = ["DamperVariation", "Mistuning", "Wheel", "WheelCurve", "WheelPeak"]
