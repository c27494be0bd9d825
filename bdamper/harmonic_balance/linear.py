"""Linear limits of a response: no contact at all, or every closed point stuck.

With springs K_c in place of the contact the first harmonic solves Z(omega) q = f, Z = K + K_c + i omega D - omega^2 M.  Its
poles give the resonances.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from bdamper.harmonic_balance.system import HarmonicSystem

UNDAMPED = 1e-9
"""Ratio of half-width to frequency of a resonance without damping."""
NEAREST = 1e-4
"""Distance, relative to its frequency, at which the response beside a resonance without damping is still solved for."""


def linear_resonances(
    system: HarmonicSystem, springs: Sequence[NDArray | None], low: float, high: float
) -> list[tuple[float, float, NDArray]]:
    """Resonances of the structure without contact and with every closed point stuck.

    Frequency and half-width (damping ratio times frequency) in rad/s, and the row that gives the modal coordinate.
    """
    out = []
    basis = system.bases[1]
    for k in springs:
        frequencies, vectors = system.linear_modes(k)
        for omega, vector in zip(frequencies, vectors.T):
            if low < omega < high:
                width = max(0.5 * float(np.abs(vector) ** 2 @ basis.damping), UNDAMPED * float(omega))
                out.append((float(omega), width, vector.conj() * basis.mass))
    return out


BEYOND = 0.03
"""Part of its frequency by which a branch may turn beyond the resonance without contact or with stuck contact."""


def reach(free: Sequence[float], stuck: Sequence[float], low: float, high: float) -> tuple[float, float]:
    """Interval in which branches that pass through (low, high) may turn, in the unit of the arguments.

    As contact slips and opens, the resonance of a mode and its folds shift from the stuck to the free frequency.  An end
    between the two of one mode is moved just beyond the outer one; other ends stay.  Modes are paired in their order.

    Parameters
    ----------
    free, stuck : sequence of float
        Resonances without contact (rigid motions left out) and with stuck contact, ascending.
    low, high : float
    """
    spans = [((1.0 - BEYOND) * min(pair), (1.0 + BEYOND) * max(pair)) for pair in zip(free, stuck)]
    bottom = min((a for a, b in spans if a < low < b), default=low)
    top = max((b for a, b in spans if a < high < b), default=high)
    return bottom, top


def around(low: float, high: float) -> tuple[float, float]:
    """Interval in which a pole may lie of which the maximum is in (low, high)."""
    return 0.8 * low, 1.25 * high


def linear_maximum(system: HarmonicSystem, springs: NDArray | None, omega: float, width: float) -> tuple[float, float]:
    """Frequency (rad/s) and amplitude (m) of the maximum at a resonance of so many rad/s and half-width.

    Without damping the response is unbounded, and the amplitude infinite.
    """
    if width <= UNDAMPED * omega:
        return omega, np.inf

    def negative(w: float) -> float:
        return -abs(system.linear_response(w, springs) @ system.response_rows[1])

    ends = (omega - 3.0 * width, omega + 3.0 * width)
    found = minimize_scalar(negative, bounds=ends, method="bounded", options={"xatol": 1e-9 * omega, "maxiter": 200})
    return float(found.x), -float(found.fun)
