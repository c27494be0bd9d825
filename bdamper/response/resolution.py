"""Resonances that are unbounded, or sharper than double precision resolves.

Without damping, friction limits the response only up to a certain excitation: a Jenkins element
with the slip force S up to 4 S/pi (Caughey 1960).  Above it the curve rises until the rounding of
the frequency changes the forces by more than the tolerance of the equations.  Its highest point
then depends on rounding, as it does with very small damping.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.sector import UNDAMPED
from bdamper.model.kinematics import HarmonicBasis
from bdamper.response.branches import NO_DIGITS, UNBOUNDED, LeftOut
from bdamper.response.peak import LOOSEST

EXCEEDS_FRICTION = f"{UNBOUNDED}: no damping, and the excitation exceeds the friction"
TOO_SHARP = (
    f"{NO_DIGITS}: rounding of the frequency exceeds the tolerance of the equations, add damping"
)


def unresolved_resonance(
    system: Equations, basis: HarmonicBasis, y: NDArray, branch: NDArray
) -> LeftOut | None:
    """Return the range around the highest point if the amplitude there is unbounded or unresolved.

    Parameters
    ----------
    system : Equations
    basis : HarmonicBasis
        Modes of the first harmonic.
    y : (n, n_unknowns + 1) float
        Points of the curve; points of one branch are in order.
    branch : (n,) int
    """
    if not len(y):
        return None
    top = int(np.argmax(np.abs(system.rows.value(y))))
    # modes of the static residual flexibility have no mass
    mass_or_one = np.where(basis.mass > 0.0, basis.mass, 1.0)
    damping_ratio = basis.damping / (2.0 * y[top, -1] * mass_or_one)
    why = why_unresolved(system, y[top], float(damping_ratio.max()))
    if not why:
        return None
    neighbours = range(max(top - 1, 0), min(top + 2, len(y)))
    of_branch = [i for i in neighbours if branch[i] == branch[top]]
    frequency = y[of_branch, -1] / (2.0 * np.pi)
    return LeftOut(float(frequency.min()), float(frequency.max()), why)


def why_unresolved(system: Equations, y: NDArray, damping_ratio: float) -> str:
    """Return the reason why the amplitude of a resonance is unbounded or cannot be resolved, or "".

    Parameters
    ----------
    system : Equations
    y : (n_unknowns + 1,) float
        Highest point of the resonance.
    damping_ratio : float
    """
    if frequency_rounding(system, y) <= LOOSEST:
        return ""
    return EXCEEDS_FRICTION if damping_ratio <= UNDAMPED else TOO_SHARP


def frequency_rounding(system: Equations, y: NDArray) -> float:
    """Return the change of the relative residual due to rounding of the frequency at one point.

    With the quality factor Q of a resonance it is about 2 Q times the machine epsilon.  Stiff
    contacts do not change it.
    """
    step = 1e-3
    above = y.copy()
    above[-1] *= 1.0 + step
    below = y.copy()
    below[-1] *= 1.0 - step
    # exact but for the rotor speed: the inertia forces are quadratic in the frequency
    change = (system.residual(above) - system.residual(below)) / (2.0 * step)
    return float(np.finfo(float).eps * (np.abs(change) * system.row_scale).max())
