"""Range of the friction coefficient in which the amplitude is less than twice the nominal one.

Friction coefficients of turbine dampers are known to a factor of about 1.5. With less friction the
amplitude at the optimal preload rises steeply, with more friction slowly. Two peaks, at 0.7 and 1.3
times the friction, do not show whether the steep rise lies within this factor: it can begin at
0.69. :func:`find_range` therefore continues to the factor 1.5 in both directions.  If the amplitude
doubles there, it bisects the interval.  Beyond this factor nothing is computed, because the
amplitude there does not change the check.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from bdamper.response.verification import FRICTION_SPREAD, FrictionPeak, FrictionRange
from bdamper.util.workers import on_threads

AWAY = (0.7, 1.0 / FRICTION_SPREAD), (1.3, FRICTION_SPREAD)
"""Factors on the friction coefficients in both directions, up to the spread of typical ones.

The first ones are those of the check of an optimum.
"""
NARROW = 1.15
"""Ratio of the two factors between which the amplitude doubles at the end of the bisection."""


def find_range(peak_with: Callable[[float], FrictionPeak]) -> FrictionRange:
    """Find the range of friction in which the amplitude is less than twice the nominal one.

    The range is given as factors on the friction coefficients, and ends at the spread of typical
    coefficients.  The search takes 5 to 7 peaks.  Both directions are searched side by side.

    Parameters
    ----------
    peak_with : callable
        Function that returns the highest peak for a factor on the friction coefficients.

    Returns
    -------
    FrictionRange
    """
    nominal = peak_with(1.0)
    peaks = {1.0: nominal}
    if not np.isfinite(nominal.amplitude):
        return FrictionRange((nominal,))

    def low_with(factor: float) -> bool:
        """Return whether the amplitude is known and less than twice the nominal one."""
        peaks[factor] = peak_with(factor)
        return peaks[factor].compared_with(nominal) == "low"

    def search(factors: Sequence[float]) -> None:
        """Search in one direction, at factors of increasing distance from 1."""
        inside = 1.0
        outside: float | None = None
        for factor in factors:
            if not low_with(factor):
                outside = factor
                break
            inside = factor
        # the amplitude doubles between both factors
        while outside is not None and max(inside / outside, outside / inside) > NARROW:
            middle = float(np.sqrt(inside * outside))
            if low_with(middle):
                inside = middle
            else:
                outside = middle

    on_threads([partial(search, factors) for factors in AWAY])
    return FrictionRange(tuple(peaks[factor] for factor in sorted(peaks)))


def tolerates_friction(peak_with: Callable[[float], FrictionPeak]) -> bool:
    """Return whether the amplitude is known, and less than doubled, at both ends of the spread."""
    nominal = peak_with(1.0)
    if not np.isfinite(nominal.amplitude):
        return False
    ends = (1.0 / FRICTION_SPREAD, FRICTION_SPREAD)
    return all(peak_with(factor).compared_with(nominal) == "low" for factor in ends)
