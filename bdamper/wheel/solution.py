r"""A solution of a wheel at one frequency, wherever Newton's method starts.

Near its peaks Newton's method fails from afar: with the contacts stuck the blades answer so strongly that the next step has
them all slip, and dampers that slip fully are free along their axis and go anywhere.  Both are mended by equations that are
easier (``bdamper.wheel.system.Ease``), whose solution leads to that of the wheel itself: with springs on the mean of
dampers, and where that is not enough with damping

.. math:: C + \delta \omega M, \qquad \delta = 0.03 \text{ or } 0.3,

that widens the resonances, taken back step by step.  A step that fails is made smaller.

On 13 blades of the shipped disk, 2 % deviation, one harmonic, 61 frequencies across the band, Newton's method with
shortened steps finds no solution at 45 of them (500 N); with springs of a tenth at none (500 N, 1 kN) and 15 (3 kN); with
damping as well at none and 3.  With the springs of the sweep it needs damping at 9 of 720 frequencies (18 wheels of 13
blades and 6 of 65, 500 N to 2 kN) and takes 4 to 6 factorisations a frequency with 13 blades, 8 to 9 with 65.  Damping
wherever it is not there after four took a third more.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.wheel.newton import Corrected, correct
from bdamper.wheel.system import Ease, WheelSystem

SPRINGS = 1.0
"""Springs on the mean of dampers for a sweep.  With 0.1 one of 16 frequencies across the band (65 blades, 500 N) has
no solution, with 0.3 and 1 all have; the highest amplitudes of both differ by 0.3 %."""
DAMPING = 0.03, 0.3
"""Damping from which to set off."""
SLIGHT = 2e-4
"""Damping below which the next step is to none."""
EASY = 0.2
"""Newton step, relative to the vibration, with which solutions on the way are content."""


def solution(
    system: WheelSystem, X: NDArray, omega: float, ease: Ease, tolerance: float, content: float = 0.0
) -> Corrected | None:
    """The solution at one frequency to which a start leads, or None if none was found.

    Parameters
    ----------
    system : WheelSystem
    X : start
    omega : float, rad/s
    ease : Ease
        Of the equations to solve, without damping.
    tolerance, content : float
        Of :func:`~bdamper.wheel.newton.correct`.
    """
    found = near(system, X, omega, ease, tolerance, content)
    if found.converged:
        return found
    still = np.zeros_like(X)
    still[:, 0, system.structure.n :] = system.home
    still[system.still] = 0.0
    for damping in DAMPING:
        for start in (X, still):
            found = near(system, start, omega, replace(ease, damping=damping), tolerance, EASY)
            if found.converged:
                return _undamped(system, found, damping, ease, tolerance, content)
    return None


def _undamped(
    system: WheelSystem, found: Corrected, damping: float, ease: Ease, tolerance: float, content: float
) -> Corrected | None:
    """The solution to which that with damping leads as the damping is taken back."""
    ratio = 0.3
    while damping > 0.0:
        lower = damping * ratio if damping * ratio > SLIGHT else 0.0
        eased = replace(ease, damping=lower)
        new = near(system, found.X, found.omega, eased, tolerance, EASY if lower else content)
        if new.converged:
            found, damping, ratio = new, lower, max(ratio**1.5, 0.05)
        else:
            ratio = ratio**0.4
            if ratio > 0.9:
                return None
    return found


def near(system: WheelSystem, X: NDArray, omega: float, ease: Ease, tolerance: float, content: float) -> Corrected:
    """Newton's method with steps shortened."""
    return correct(system, X, omega, ease=ease, tolerance=tolerance, most=20, line_search=True, content=content)
