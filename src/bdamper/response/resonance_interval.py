"""Where a resonance lies: the interval around that of a mode, and linear resonances without contact and all of it stuck."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.static_state import PreloadState
from bdamper.harmonic_balance.linear_limits import around
from bdamper.harmonic_balance.problem import Problem, stuck_springs
from bdamper.response.optimal_curve_result import Limit
from bdamper.util import validation


def free_and_stuck(problem: Problem, state: PreloadState, modes: int) -> tuple[NDArray, NDArray]:
    """(modes,) resonances (Hz) of the constrained bodies without contact, and with all that are closed at rest stuck.

    A mode has the lowest stuck resonance above its own that no mode below it has.

    Raises
    ------
    SettingError
        If there are not so many modes.
    """
    sector = problem.sector(0.0)
    basis = sector.bases[1]
    modes_alone = np.array([c.is_mode for c in basis.coordinates], bool)
    elastic = np.sort(basis.omega2[(basis.omega2 > 0.0) & (basis.mass == 1.0) & modes_alone])
    if np.any(sector.springs):
        elastic = sector.linear.modes(None)[0] ** 2
    validation.require(1 <= modes <= len(elastic), "mode", f"1 to {len(elastic)}", modes)
    free = np.sqrt(elastic[:modes])
    poles = list(sector.linear.modes(stuck_springs(problem, state, touching=True))[0])
    stuck = []
    for w in free:
        poles = [p for p in poles if p >= w * (1.0 - 1e-9)]
        stuck.append(poles.pop(0) if poles else w)
    return free / (2.0 * np.pi), np.array(stuck) / (2.0 * np.pi)


def resonance_interval(problem: Problem, preload: float, mode: int = 1) -> tuple[float, float]:
    """Frequency interval (Hz) that spans the free and the stuck resonance of one mode of the constrained bodies.

    Parameters
    ----------
    problem : Problem
    preload : float, N
        Decides which points are closed.
    mode : int
        1 for the lowest.

    Raises
    ------
    SettingError
        If there is no such mode.
    StaticError
        If there is no static state at the preload.
    """
    free, stuck = (float(f[-1]) for f in free_and_stuck(problem, problem.equilibrium(preload), mode))
    margin = beyond(free, stuck)
    return max(0.1 * free, free - margin), stuck + margin


def beyond(free: float, stuck: float) -> float:
    """How far an interval goes beyond the free and the stuck resonance between which that of a mode lies."""
    return 0.1 * free + 0.3 * (stuck - free)


def linear_peak(problem: Problem, frequency: tuple[float, float], preload: float, *, stuck: bool) -> Limit:
    """The highest resonance of the free or of the stuck structure in an interval (Hz), NaN if there is none.

    NaN too for the stuck one at a preload without a static state.
    """
    if stuck and not problem.static(preload).converged:
        return Limit(np.nan, np.nan)
    sector = problem.sector(preload if stuck else 0.0)
    springs = stuck_springs(problem, problem.static(preload), touching=True) if stuck else None
    low, high = (2.0 * np.pi * f for f in frequency)
    poles = sector.linear.resonances((springs,), *around(low, high))
    tops = [sector.linear.maximum(sector.response_rows[1], springs, w, width) for w, width, _ in poles]
    within = [top for top in tops if low <= top[0] <= high]
    omega, amplitude = max(within, key=lambda top: top[1], default=(np.nan, np.nan))
    return Limit(omega / (2.0 * np.pi), amplitude)


def peak_interval(
    problem: Problem, frequency: tuple[float, float] | None, preload: float, mode: int = 1
) -> tuple[float, float]:
    """Return the given interval (Hz), or the one around the resonances of a mode at a preload (N)."""
    mode = validation.whole("mode", mode, least=1)
    if frequency is None:
        return resonance_interval(problem, preload, mode)
    return validation.interval("frequency", frequency)
