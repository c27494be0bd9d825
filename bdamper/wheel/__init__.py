"""Whole wheels with blades and dampers that differ: mistuning, harmonic balance, samples of wheels and their statistics.

In: a problem whose model has a sector-local basis.  Out: curves and peaks of every blade, and statistics of many wheels.
"""

from bdamper.wheel.mistuning import DamperVariation, Mistuning
from bdamper.wheel.peak import WheelPeakOptions
from bdamper.wheel.results import WheelPeak
from bdamper.wheel.sample import audit_wheels, mistuned_sample
from bdamper.wheel.sample_result import Audit, BestPreload, MistunedSample
from bdamper.wheel.wheel import Wheel

__all__ = [
    "Audit",
    "BestPreload",
    "DamperVariation",
    "MistunedSample",
    "Mistuning",
    "Wheel",
    "WheelPeak",
    "WheelPeakOptions",
    "audit_wheels",
    "mistuned_sample",
]
