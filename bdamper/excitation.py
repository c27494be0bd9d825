"""Where and along which direction a structure is excited, and its response read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bdamper.errors import SettingError

DIRECTIONS = {"tangential": (1.0, 0.0, 0.0), "radial": (0.0, 1.0, 0.0), "axial": (0.0, 0.0, 1.0)}


def direction_vector(value: str | Sequence[float], what: str) -> NDArray:
    """Unit vector along a direction by name or components; ``what`` names it in errors."""
    if isinstance(value, str):
        if value not in DIRECTIONS:
            raise SettingError(f"{what}: expected one of {tuple(DIRECTIONS)} or three numbers, found '{value}'")
        return np.array(DIRECTIONS[value])
    vector = np.asarray(value, float)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not np.any(vector):
        raise SettingError(f"{what}: expected three finite numbers, not all zero, found {value!r}")
    return vector / np.linalg.norm(vector)


@dataclass(frozen=True)
class Excitation:
    """A travelling-wave force of engine-order type on every blade.

    Parameters
    ----------
    location : str
    direction : {"tangential", "radial", "axial"} or three floats
    amplitude : float, N
    phase : float, rad
        Of the force on the reference blade, ``amplitude cos(omega t + phase)``.
    """

    location: str
    direction: str | tuple[float, float, float] = "tangential"
    amplitude: float = 1.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        direction_vector(self.direction, "excitation direction")
        if not np.isfinite(self.amplitude) or self.amplitude < 0.0 or not np.isfinite(self.phase):
            raise SettingError(
                f"excitation: expected a finite amplitude >= 0 and phase, found {self.amplitude}, {self.phase}"
            )


@dataclass(frozen=True)
class Response:
    """Where and along which direction the response is read.

    Parameters
    ----------
    location : str
    direction : {"tangential", "radial", "axial"} or three floats
    """

    location: str
    direction: str | tuple[float, float, float] = "tangential"

    def __post_init__(self) -> None:
        direction_vector(self.direction, "response direction")
