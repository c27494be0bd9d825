r"""A solution of a wheel at one frequency, wherever Newton's method starts.

Near its peaks Newton's method fails from afar: with the contacts stuck the blades answer so strongly that the next step has
them all slip, and dampers that slip fully are free along their axis and go anywhere.  Both are mended by equations that are
easier (:class:`~bdamper.wheel.system.Ease`), whose solution leads to that of the wheel itself: first with damping

.. math:: C + \delta \omega M, \qquad \delta = 0.03 \text{ or } 0.3,

that widens the resonances, taken back step by step, then without the springs on the mean of dampers.  A step that fails is
made smaller.

On 13 blades of the shipped disk, 2 % deviation, one harmonic, 61 frequencies across the band, Newton's method with
shortened steps finds no solution at 45 of them (500 N); with springs of a tenth at none (500 N, 1 kN) and 15 (3 kN); with
damping as well at none and 3.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.wheel.newton import Corrected, correct
from bdamper.wheel.system import PLAIN, Ease, WheelSystem

SPRINGS = 1.0
"""Springs on the mean of dampers in eased equations.  With 0.1 one of 16 frequencies across the band (65 blades, 500 N) has
no solution, with 0.3 and 1 all have; the highest amplitudes of both differ by 0.3 %."""
DAMPING = 0.03, 0.3
"""Damping from which to set off."""
LEAST = {"damping": 2e-4, "springs": 1e-7}
"""Below this the next step is to none."""
EASY = 1e-2
"""Residual of solutions on the way."""


class Solver:
    """Solutions at one frequency after another.

    Parameters
    ----------
    system : WheelSystem
    ease : Ease
        Of the equations to solve, without damping.
    """

    def __init__(self, system: WheelSystem, ease: Ease = PLAIN) -> None:
        self.system, self.ease = system, ease
        self.damped: NDArray | None = None

    def at(self, omega: float, X: NDArray, tolerance: float, content: float = 0.0) -> Corrected | None:
        """The solution at a frequency (rad/s) to which a start leads, or None if none was found.

        Parameters
        ----------
        omega : float, rad/s
        X : start
        tolerance, content : float
            Of :func:`~bdamper.wheel.newton.correct`.
        """
        system, ease = self.system, self.ease
        found = correct(system, X, omega, ease=ease, tolerance=tolerance, most=4, line_search=True, content=content)
        if found.converged:
            return found
        still = np.zeros_like(X)
        still[:, 0, system.structure.n :] = system.home
        for damping in DAMPING:
            eased = Ease(damping, max(ease.springs, SPRINGS))
            for start in (self.damped, X, still):
                if start is None:
                    continue
                found = near(system, start, omega, eased, EASY)
                if not found.converged:
                    continue
                if damping == DAMPING[0]:
                    self.damped = found.X
                undamped, left = relaxed(system, found, eased, "damping", 0.0, tolerance)
                if left > 0.0 or ease.springs >= eased.springs:
                    return undamped if left == 0.0 else None
                freed, left = relaxed(system, undamped, Ease(0.0, eased.springs), "springs", ease.springs, tolerance)
                return freed if left == ease.springs else None
        return None


def relaxed(
    system: WheelSystem, found: Corrected, ease: Ease, name: str, target: float, tolerance: float
) -> tuple[Corrected, float]:
    """The solution to which that of eased equations leads as one of the aids is taken back, and what is left of the aid."""
    level, ratio = float(getattr(ease, name)), 0.3
    while level > target and ratio < 0.9:
        lower = max(level * ratio, target)
        lower = lower if lower > LEAST[name] else target
        new = near(system, found.X, found.omega, replace(ease, **{name: lower}), tolerance if lower == target else EASY)
        if new.converged:
            found, level, ratio = new, lower, max(ratio**1.5, 0.05)
        else:
            ratio = ratio**0.4
    return found, level


def near(system: WheelSystem, X: NDArray, omega: float, ease: Ease, tolerance: float) -> Corrected:
    """Newton's method with steps shortened."""
    return correct(system, X, omega, ease=ease, tolerance=tolerance, most=20, line_search=True)
