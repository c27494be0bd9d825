"""A peak followed through given values of a parameter, plainly: on the line through the last two, in halves."""

from typing import NamedTuple

import numpy as np

from bdamper.peaks.newton import find_peak
from bdamper.peaks.sensitivity import sensitivities
from bdamper.util.errors import SettingError

NEAR = 0.2
"""Distance of a peak from its prediction, relative to the vibration."""


class Followed(NamedTuple):
    """Peaks at the values, as far as they exist, the last value up to which the peak was followed, and how it ended."""

    peaks: tuple
    ended: float
    status: str
    reason: str


def _next(family, known, value):
    """The peak at a value, predicted from the last two; None if it is not near."""
    last, before = known[-1], known[-2] if len(known) > 1 else None
    if before is not None and before.parameter != last.parameter:
        slope = (last.y - before.y) / (last.parameter - before.parameter)
    else:
        try:
            slope = sensitivities(last, {"p": (family, last.parameter)})["p"].y
        except (SettingError, ArithmeticError):
            slope = np.zeros_like(last.y)
    system, guess = family(value), last.y + (value - last.parameter) * slope
    found = find_peak(system, guess, tangent=last.tangent, scale=last.scale, curvature=last.curvature, parameter=value,
                      reach=0.5)  # fmt: skip
    n = system.n_mean
    near = np.linalg.norm((found.y - guess)[n:-1]) < NEAR * np.linalg.norm(last.y[n:-1])
    return (found if found.converged and near else None), found.status


def follow_peak(family, start, values):
    known, peaks = [start], []
    for value in map(float, values):
        way = [value]
        while way:
            if way[-1] == known[-1].parameter:
                found, reason = known[-1], ""
            else:
                found, reason = _next(family, known, way[-1])
            if found is None:
                way.append(0.5 * (known[-1].parameter + way[-1]))
                if len(way) > 14:
                    return Followed(tuple(peaks), known[-1].parameter, "vanished", reason or "far")
                continue
            known = [*known[-1:], found]
            way.pop()
        peaks.append(known[-1])
    return Followed(tuple(peaks), known[-1].parameter, "complete", "")
