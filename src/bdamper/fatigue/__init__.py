"""Stress over a cycle and margins against fatigue.

In: a solution of a problem whose model carries stress rows (:class:`bdamper.model.structure.StressSet`) and a
`Material`. Out: the stress at every point of these sets over the cycle, with all harmonics and the mean, its amplitude and
mean by one of several definitions, and the factor by which it could grow before the limit of the material: infinite life,
not a number of cycles.
"""

from bdamper.fatigue.criteria import AISI_1050, CRITERIA, LINES, Material
from bdamper.fatigue.margin import MarginCurve, Margins
from bdamper.fatigue.stress_cycle import StressCycle

__all__ = ["AISI_1050", "CRITERIA", "LINES", "MarginCurve", "Margins", "Material", "StressCycle"]
