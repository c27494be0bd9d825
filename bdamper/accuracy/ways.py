"""Ways to find the highest peak: the search for peaks, tracking curves, sweeps of frequencies.

Each is a function of a problem, a preload (N) and an interval (Hz) that returns amplitude (m) and frequency (Hz).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bdamper.continuation.curve import uninterrupted
from bdamper.continuation.path import ContinuationOptions
from bdamper.continuation.track import track
from bdamper.harmonic_balance.system import OK
from bdamper.peaks.optimal import highest_peak
from bdamper.problem.problem import Problem
from bdamper.util.errors import BdamperError

Answer = tuple[float, float]
"""Amplitude (m) and frequency (Hz) of the highest peak; not finite if none was found."""
Solver = Callable[[Problem, float, tuple[float, float]], Answer]
"""Finds the answer for a study, a preload and an interval of frequencies."""


def by_peak(problem: Problem, preload: float, interval: tuple[float, float]) -> Answer:
    """A coarse scan and the peak condition (:meth:`bdamper.Study.peak`)."""
    try:
        peak = highest_peak(problem, preload, interval)
    except BdamperError:
        return np.nan, np.nan
    return (peak.amplitude, peak.frequency) if peak.converged else (np.nan, np.nan)


def by_tracking(problem: Problem, preload: float, interval: tuple[float, float]) -> Answer:
    """The highest point of a tracking curve."""
    return _top_of_curve(problem, preload, interval, None)


def by_tracking_with(options: ContinuationOptions) -> Solver:
    """The highest point of a tracking curve with given options."""

    def solve(problem: Problem, preload: float, interval: tuple[float, float]) -> Answer:
        return _top_of_curve(problem, preload, interval, options)

    return solve


def _top_of_curve(
    problem: Problem, preload: float, interval: tuple[float, float], options: ContinuationOptions | None
) -> Answer:
    curve = uninterrupted(track(problem, preload, interval, options=options))
    return (curve.peak.amplitude, curve.peak.frequency) if curve.complete else (np.nan, np.nan)


def by_sweep(n: int) -> Solver:
    """The largest of n responses at fixed frequencies, equally spaced, each started from the one before, up and down."""

    def solve(problem: Problem, preload: float, interval: tuple[float, float]) -> Answer:
        return sweep_peak(problem, preload, interval, n)

    return solve


def sweep_peak(problem: Problem, preload: float, interval: tuple[float, float], n: int) -> Answer:
    """Largest response on a grid of frequencies, swept upward and downward by Newton at fixed frequency.

    Points at which Newton fails from the point before and from the stuck response are left out.
    """
    system = problem.system(preload)
    state = problem.equilibrium(preload)
    springs = problem.stuck_springs(state)
    omegas = 2.0 * np.pi * np.linspace(*interval, n)
    best = (np.nan, np.nan)
    for sweep in (omegas, omegas[::-1]):
        y = None
        for omega in sweep:
            stuck = system.pack(state.q[: system.n_mean], system.linear_response(omega, springs))
            scale = np.ones(system.n_unknowns + 1)
            scale[: system.n_mean] = max(float(np.linalg.norm(state.q)), 1e-300)
            scale[system.n_mean : -1] = max(float(np.linalg.norm(stuck[system.n_mean :])), 1e-300)
            scale[-1] = omega
            for guess, search, iterations in ((y, False, 12), (stuck, True, 40)):
                if guess is None:
                    continue
                c = system.correct_at(guess, omega, scale, 1e-9, iterations, search)
                if c.status == OK:
                    y = c.y[:-1]
                    amplitude = float(abs(system.response(y)[1]))
                    if not best[0] >= amplitude:
                        best = amplitude, float(omega / (2.0 * np.pi))
                    break
            else:
                y = None
    return best


QUANTITIES: dict[str, Solver] = {"peak": by_peak, "curve": by_tracking}
