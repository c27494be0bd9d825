"""The highest peak of a wheel as a result."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.model.structure import Model
from bdamper.util.cost import Cost
from bdamper.util.display import Plottable, draw
from bdamper.util.formatting import amount, height
from bdamper.util.short_repr import brief
from bdamper.util.status import COMPLETE, HELD
from bdamper.util.storage import Recorded, Storable


@brief
@dataclass(frozen=True)
class WheelPeak(Plottable, Recorded, Storable, kind="bdamper-wheel-peak"):
    """The highest amplitude of any blade of a wheel at one preload.

    ``plot`` draws bars over the blades (:func:`bdamper.plot.plot_wheel_peak`).

    Parameters
    ----------
    preload : float, N
    frequency : float, Hz
    amplitude : float, m
        Of the first harmonic; NaN if no peak was found.
    blade : int
        The highest one, -1 if no peak was found.
    tuned_amplitude : float, m
        Of the highest peak of the tuned wheel at the same preload and engine order.
    response : (n_blades, n_harmonics + 1) complex, m
        Of all blades there, the mean first.
    climbs : (n, 5) float
        Of every peak found by a local search: blade, frequency (Hz) and amplitude (m) with the mean of dampers held as in
        the sweep; the weakest springs with which it was found, and its amplitude (m) then.
    sweep_frequency : (n,) float, Hz
        Of the coarse sweep's solutions.
    status, reason : str
        "complete"; "held" if the peak was found only with springs on the mean of dampers or on the reduced wheel;
        "incomplete", a lower bound, if the sweep leaves out a part of its band or no blade is as high as those of the tuned
        wheel, as the reason says; or "not found".
    residual : float
    unknowns : (n_blades, n_coefficients, n_sector) float
    springs : float
        On the mean of dampers, relative to their stiffness when stuck; 0 where dampers are free.
    error : float
        Estimate of how much higher the highest peak with free dampers may be, relative: from what weaker springs have
        changed, what the reduced wheel of the search is off the whole one, and what local searches may have missed; 0 where
        dampers are free and all maxima of the sweep were examined.
    interval : (low, high), Hz
        Band of the sweep.
    cost : Cost
    settings : mapping
        Of the tuned study, with the frequency deviations of the blades.
    model_hash : str
    """

    preload: float
    frequency: float
    amplitude: float
    blade: int
    tuned_amplitude: float
    response: NDArray
    climbs: NDArray
    sweep_frequency: NDArray
    status: str
    reason: str
    residual: float
    unknowns: NDArray
    springs: float = 0.0
    error: float = 0.0
    interval: tuple[float, float] = (np.nan, np.nan)
    cost: Cost = field(default_factory=Cost)
    _summary_fields = ("status", "amplitude", "frequency", "blade", "amplification", "error", "springs")

    @property
    def converged(self) -> bool:
        """With dampers free."""
        return self.status == COMPLETE

    @property
    def found(self) -> bool:
        """Complete or held."""
        return self.status in (COMPLETE, HELD)

    @property
    def amplification(self) -> float:
        """Amplitude over that of the tuned wheel's peak."""
        return self.amplitude / self.tuned_amplitude

    @property
    def amplitudes(self) -> NDArray:
        """(n_blades,) float, m: of all blades at the peak."""
        return np.abs(self.response[:, 1])

    @property
    def nodal_diameters(self) -> NDArray:
        """(n_blades,) float, m: amplitudes of the waves of 0 to N - 1 nodal diameters in the first harmonic."""
        return np.asarray(np.abs(np.fft.fft(self.response[:, 1])) / len(self.response))

    def plot_wheel(self, model: Model, *arguments: Any, **options: Any) -> Any:
        """Draw the wheel from the front, blades coloured by their amplitude (:func:`bdamper.plot.plot_wheel`)."""
        return draw(self, "plot_wheel", model, *arguments, **options)

    def _headline(self) -> str:
        if not np.isfinite(self.amplitude):
            return f"No peak of the wheel at a preload of {amount(self.preload, 'N')}: {self.reason}."
        top = height(self.amplitude, self.frequency)
        tuned = f"{self.amplification:.3g} times the tuned wheel ({amount(self.tuned_amplitude, 'm')})"
        open_ = "" if self.converged else f" {self.status.capitalize()}: {self.reason}."
        head = f"Highest of {len(self.response)} blades at a preload of {amount(self.preload, 'N')}"
        return f"{head}: number {self.blade}, {top}, {tuned}.{open_}"
