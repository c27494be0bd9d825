"""Range of the friction coefficient in which the amplitude is less than twice the nominal one.

Friction coefficients of turbine dampers are known to a factor of about 1.5. With less friction the
amplitude at the optimal preload rises steeply, with more friction slowly. Two peaks, at 0.7 and 1.3
times the friction, do not show how close the steep rise is: it can begin at 0.69.
:func:`find_range` therefore searches outward from the friction coefficient of the study in both
directions, and bisects the interval in which the amplitude doubles.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bdamper.response.verification import FRICTION_SPREAD, FrictionPeak, FrictionRange

AWAY = (0.7, 1.0 / FRICTION_SPREAD, 0.4, 0.25), (1.3, FRICTION_SPREAD, 2.5, 4.0)
"""Factors on the friction coefficients in both directions.

The first ones are those of the check of an optimum.
"""
NARROW = 1.15
"""Ratio of the two factors between which the amplitude doubles at the end of the bisection."""


def find_range(peak_with: Callable[[float], FrictionPeak]) -> FrictionRange:
    """Find the range of friction in which the amplitude is less than twice the nominal one.

    The range is given as factors on the friction coefficients.  The search takes 6 to 13 peaks.

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

    for factors in AWAY:
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
    return FrictionRange(tuple(peaks[factor] for factor in sorted(peaks)))


def tolerates_friction(peak_with: Callable[[float], FrictionPeak]) -> bool:
    """Return whether the amplitude is known, and less than doubled, at both ends of the spread."""
    nominal = peak_with(1.0)
    if not np.isfinite(nominal.amplitude):
        return False
    ends = (1.0 / FRICTION_SPREAD, FRICTION_SPREAD)
    return all(peak_with(factor).compared_with(nominal) == "low" for factor in ends)
