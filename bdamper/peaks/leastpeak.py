"""The value of a parameter at which a followed resonance peak is least: a root of its adjoint sensitivity."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bdamper.peaks.follower import PeakFollower
from bdamper.peaks.newton import Family, Peak, PeakOptions
from bdamper.peaks.sensitivity import amplitude_sensitivity
from bdamper.util.errors import SettingError, StaticError
from bdamper.util.repr import brief


@brief
@dataclass(frozen=True)
class Optimum:
    """The value of a parameter at which the peak is least.

    Parameters
    ----------
    parameter : float
    amplitude : float, m
    frequency : float, Hz
    kind : str
        "smooth" (zero derivative), "crossing" (two peaks equally high), "jump" (a higher peak vanishes here) or "end" (of
        the range).
    uncertainty : float
        Of the parameter, relative: the last bracket or step.
    peak : Peak
    status : str
    """

    parameter: float
    amplitude: float
    frequency: float
    kind: str
    uncertainty: float
    peak: Peak = field(repr=False)
    status: str = "converged"


def _log_slope(family: Family, peak: Peak, options: PeakOptions) -> float:
    """d ln(amplitude) / d ln(parameter)."""
    return amplitude_sensitivity(peak, family, peak.parameter, options) * peak.parameter / peak.amplitude


def least_peak(
    family: Family,
    start: Peak,
    bracket: tuple[float, float],
    *,
    tolerance: float = 1e-8,
    options: PeakOptions | None = None,
) -> Optimum:
    """The smooth minimum of one followed peak within a bracket: a root of its adjoint sensitivity.

    Parameters
    ----------
    family : callable
    start : Peak
        Of this branch, anywhere near the bracket.
    bracket : (low, high)
        Positive; the derivative is negative at the lower end and positive at the upper one.
    tolerance : float
        Relative, on the parameter.

    Returns
    -------
    Optimum
        ``kind`` is "end" if the derivative does not change sign.
    """
    options = options or PeakOptions()
    low, high = (float(b) for b in bracket)
    if not 0.0 < low < high:
        raise SettingError(f"bracket: expected 0 < low < high, found ({low}, {high})")

    nearest = {start.parameter: start}

    def at(value: float) -> tuple[Peak, float]:
        origin = min(nearest, key=lambda p: abs(np.log(p / value)))
        peak: Peak | None = nearest[origin]
        if origin != value:
            peak = PeakFollower(family, nearest[origin], options).go(value)
        if peak is None:
            raise ArithmeticError(f"the peak could not be followed to {value:.8g}")
        nearest[value] = peak
        return peak, _log_slope(family, peak, options)

    a, b = np.log(low), np.log(high)
    try:
        peak_a, f_a = at(low)
        peak_b, f_b = at(high)
        if f_a >= 0.0 or f_b <= 0.0:
            best = peak_a if f_a >= 0.0 else peak_b
            return Optimum(best.parameter, best.amplitude, best.frequency, "end", 0.0, best)
        x, side = a, 0
        for _ in range(60):
            last = x
            x = (a * f_b - b * f_a) / (f_b - f_a)
            if not a < x < b:
                x = 0.5 * (a + b)
            peak, f = at(float(np.exp(x)))
            if abs(x - last) <= tolerance or b - a <= tolerance or f == 0.0:
                break
            if f < 0.0:
                a, f_a = x, f
                f_b = 0.5 * f_b if side == -1 else f_b
                side = -1
            else:
                b, f_b = x, f
                f_a = 0.5 * f_a if side == 1 else f_a
                side = 1
        return Optimum(peak.parameter, peak.amplitude, peak.frequency, "smooth", min(abs(x - last), b - a), peak)
    except (ArithmeticError, SettingError, StaticError) as error:
        best = min(nearest.values(), key=lambda p: p.amplitude)
        return Optimum(best.parameter, best.amplitude, best.frequency, "smooth", np.inf, best, str(error))
