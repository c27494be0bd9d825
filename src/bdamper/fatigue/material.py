r"""Limits of a material under vibration, and the factor between a cycle and these limits.

With amplitude a, mean m, :math:`m_+ = \max(m, 0)`, endurance limit :math:`S_e`, ultimate strength :math:`S_u` and yield
strength :math:`S_y`:

==========  =====================================================  ====================================
line        factor n on amplitude and mean together                factor on the amplitude alone
==========  =====================================================  ====================================
Goodman     :math:`1/n = a/S_e + m_+/S_u`                          :math:`S_e (1 - m_+/S_u)/a`
Soderberg   :math:`1/n = a/S_e + m_+/S_y`                          :math:`S_e (1 - m_+/S_y)/a`
Gerber      :math:`n a/S_e + (n m_+/S_u)^2 = 1`                    :math:`S_e (1 - (m_+/S_u)^2)/a`
==========  =====================================================  ====================================

Compression neither helps nor hurts.  On the amplitude alone is what counts for a blade: the speed of rotation fixes the
mean, the excitation may grow.  There a mean beyond its limit leaves nothing, a factor 0.  On both together the factor goes
through 1 where the mean alone meets its limit and stays positive: both may be divided by it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bdamper.util import validation

LINES = ("goodman", "gerber", "soderberg")
ON = ("amplitude", "both")


@validation.spelt
@dataclass(frozen=True)
class Material(validation.Checked):
    """Strength of a material, as the user knows it for this part.

    Parameters
    ----------
    endurance_limit : float, Pa
        Amplitude of fully reversed stress that is endured without end, at the survival, surface, size and temperature that
        the part is judged by.
    ultimate_strength, yield_strength : float, Pa
        At the same temperature.
    findley_k : float
        Weight of the normal stress in Findley's criterion, typically 0.2 to 0.3 for ductile metals; from two endurance
        limits where they are known.
    name, source : str

    Raises
    ------
    SettingError
        If a number is not positive, the yield strength exceeds the ultimate one, or the endurance limit that too.
    """

    endurance_limit: validation.Positive
    ultimate_strength: validation.Positive
    yield_strength: validation.Positive
    findley_k: validation.Positive = 0.3
    name: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("yield_strength", "endurance_limit"):
            expected = f"at most the ultimate strength, {self.ultimate_strength:g} Pa"
            validation.require(not getattr(self, name) > self.ultimate_strength, name, expected, f"{getattr(self, name):g}")

    def limit(self, line: str) -> float:
        """Mean stress (Pa) that leaves no amplitude."""
        return float(self.yield_strength if line == "soderberg" else self.ultimate_strength)

    def allowed(self, mean: NDArray | float, line: str = "goodman") -> NDArray:
        """(...) amplitude (Pa) that is endured at a mean stress (Pa)."""
        share = np.maximum(np.asarray(mean, float), 0.0) / self.limit(line)
        left = 1.0 - (share**2 if line == "gerber" else share)
        return np.asarray(self.endurance_limit * np.maximum(left, 0.0))

    def factor(
        self, amplitude: NDArray | float, mean: NDArray | float, line: str = "goodman", on: str = "amplitude"
    ) -> NDArray:
        """(...) factor on the amplitude, or on amplitude and mean together, before the line is met.

        Parameters
        ----------
        amplitude, mean : (...) float, Pa
        line : {"goodman", "gerber", "soderberg"}
        on : {"amplitude", "both"}
        """
        validation.choice("line", line, LINES)
        validation.choice("on", on, ON)
        amplitude, mean = np.broadcast_arrays(np.asarray(amplitude, float), np.asarray(mean, float))
        with np.errstate(divide="ignore", invalid="ignore"):
            if on == "amplitude":
                allowed = self.allowed(mean, line)
                return np.where(amplitude > 0.0, allowed / amplitude, np.where(allowed > 0.0, np.inf, 0.0))
            b, share = amplitude / self.endurance_limit, np.maximum(mean, 0.0) / self.limit(line)
            if line == "gerber":  # the positive root, without the difference of nearly equal numbers
                return np.asarray(2.0 / (b + np.sqrt(b**2 + 4.0 * share**2)))
            return np.asarray(1.0 / (b + share))

    @property
    def findley_limit(self) -> float:
        """Findley's ``tau_a + k sigma_max`` at the endurance limit (Pa), by its closed form for uniaxial stress."""
        return 0.5 * self.endurance_limit * (self.findley_k + np.sqrt(1.0 + self.findley_k**2))


AISI_1050 = Material(
    endurance_limit=224e6,
    ultimate_strength=690e6,
    yield_strength=580e6,
    name="AISI 1050, cold drawn, machined, 99 % survival",
    source="Shigley's Mechanical Engineering Design: Table A-20 (690 and 580 MPa); endurance limit 0.5 Su times "
    "4.51 Su^-0.265 (machined surface, Su in MPa) times 0.814 (99 % survival)",
)
"""An example of how a material is stated; not one for blades."""
