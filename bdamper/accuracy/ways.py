"""Ways to find the highest peak: tracking curves, and the search for peaks.

Each is a function of a problem, a preload (N) and an interval (Hz) that returns amplitude (m) and frequency (Hz).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bdamper.continuation.curve import uninterrupted
from bdamper.continuation.track import track
from bdamper.peaks.optimal import highest_peak
from bdamper.problem.problem import Problem
from bdamper.util.errors import BdamperError

Answer = tuple[float, float]
"""Amplitude (m) and frequency (Hz) of the highest peak; not finite if none was found."""
Solver = Callable[[Problem, float, tuple[float, float]], Answer]
"""Finds the answer for a study, a preload and an interval of frequencies."""


def by_tracking(problem: Problem, preload: float, interval: tuple[float, float]) -> Answer:
    """The highest point of a tracking curve that is complete."""
    curve = uninterrupted(track(problem, preload, interval))
    return (curve.peak.amplitude, curve.peak.frequency) if curve.complete else (np.nan, np.nan)


def by_peak(problem: Problem, preload: float, interval: tuple[float, float]) -> Answer:
    """A scan that is complete, and the peak condition (:meth:`bdamper.Study.peak`)."""
    try:
        peak = highest_peak(problem, preload, interval)
    except BdamperError:
        return np.nan, np.nan
    return (peak.amplitude, peak.frequency) if peak.converged and peak.scan == "complete" else (np.nan, np.nan)


QUANTITIES: dict[str, Solver] = {"curve": by_tracking, "peak": by_peak}
