"""Stress over a vibration cycle and safety factors against high-cycle fatigue.

Input is a solution of a problem whose model has stress sets
(:class:`bdamper.model.structure.StressSet`) and a `Material`.  The package computes the stress at
every point of these sets with all harmonics and the mean. It derives stress amplitude and mean
stress, and the safety factor for infinite life. It does not compute a number of cycles.
"""

from bdamper.fatigue.criteria import AISI_1050, CRITERIA, LINES, Material
from bdamper.fatigue.haigh_table import HaighTable
from bdamper.fatigue.margin import MarginCurve, Margins
from bdamper.fatigue.stress_cycle import StressCycle

__all__ = [
    "AISI_1050",
    "CRITERIA",
    "LINES",
    "HaighTable",
    "MarginCurve",
    "Margins",
    "Material",
    "StressCycle",
]
