"""A measured response, to lay over computed curves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bdamper.util.errors import SettingError, mismatch
from bdamper.util.hdf5 import Storable
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief

LENGTHS = {
    "": 1.0, "m": 1.0, "meter": 1.0, "metre": 1.0, "meters": 1.0, "metres": 1.0, "cm": 1e-2, "mm": 1e-3, "millimeter": 1e-3,
    "millimetre": 1e-3, "um": 1e-6, "micron": 1e-6, "microns": 1e-6, "nm": 1e-9, "in": 0.0254, "inch": 0.0254,
    "mil": 2.54e-5, "mils": 2.54e-5,
}  # fmt: skip
"""Units of length in metres."""


@brief
@dataclass(frozen=True)
class Measurement(Plottable, Storable, kind="bdamper-measurement"):
    """Amplitude over frequency, as measured.

    ``plot`` draws the amplitude in metres as small open circles (:func:`bdamper.plot.plot_measurement`).

    Parameters
    ----------
    name : str
    frequency : (n,) float, Hz
    response : (n,) complex
        In the unit of the file; ``amplitude`` is its modulus.
    node, direction : int
        Where and along which axis (±1, ±2, ±3 for X, Y, Z).
    unit : str
        As the file has it; empty counts as metres.
    source : str
    """

    name: str
    frequency: NDArray
    response: NDArray
    node: int = 0
    direction: int = 0
    unit: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        n = len(self.frequency)
        if np.shape(self.response) != (n,) or n == 0:
            raise mismatch(
                self.source or self.name, "as many responses as frequencies, at least one", np.shape(self.response)
            )
        if not (np.isfinite(self.frequency).all() and np.isfinite(self.response).all()):
            raise mismatch(self.source or self.name, "finite frequencies and responses", "others")

    @property
    def amplitude(self) -> NDArray:
        """(n,) float."""
        return np.abs(self.response)

    @property
    def metres(self) -> float:
        """Length of the unit in metres.

        Raises
        ------
        SettingError
            If it is not a unit of length that is known.
        """
        unit = self.unit.strip().lower().replace("\u00b5", "u").replace("\u03bc", "u")
        if unit not in LENGTHS:
            raise SettingError(
                f"measurement '{self.name}': expected displacements in one of {tuple(u for u in LENGTHS if u)} or a scale "
                f"to metres (scale=...), found the unit '{self.unit}'"
            )
        return LENGTHS[unit]

    def __str__(self) -> str:
        k = int(np.argmax(self.amplitude))
        return (
            f"{self.name}: {len(self.frequency)} points from {self.frequency.min():.6g} to {self.frequency.max():.6g} Hz, "
            f"largest {self.amplitude[k]:.6g} {self.unit} at {self.frequency[k]:.6g} Hz ({self.source})"
        )
