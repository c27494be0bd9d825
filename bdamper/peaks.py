"""Resonance peaks: finding one, its sensitivities, following it over a parameter, the least of those on the way.

See :mod:`bdamper.peaksearch`, :mod:`bdamper.peaksensitivity`, :mod:`bdamper.peakbranch` and :mod:`bdamper.leastpeak`.
"""

from bdamper.leastpeak import Optimum, least_peak
from bdamper.peakbranch import PeakBranch, PeakFollower, follow_peak
from bdamper.peaksearch import (
    Family,
    Peak,
    PeakOptions,
    coarse_options,
    find_peak,
    peak_scale,
    refine_maxima,
    same_peak,
    walked,
)
from bdamper.peaksensitivity import PeakSensitivity, sensitivities

__all__ = [
    "Family",
    "Optimum",
    "Peak",
    "PeakBranch",
    "PeakFollower",
    "PeakOptions",
    "PeakSensitivity",
    "coarse_options",
    "find_peak",
    "follow_peak",
    "least_peak",
    "peak_scale",
    "refine_maxima",
    "same_peak",
    "sensitivities",
    "walked",
]
