"""Where and along which direction a structure is excited, and its response read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bdamper.util import validate
from bdamper.util.errors import SettingError

DIRECTIONS = {"tangential": (1.0, 0.0, 0.0), "radial": (0.0, 1.0, 0.0), "axial": (0.0, 0.0, 1.0)}


def direction_vector(value: str | Sequence[float], what: str) -> NDArray:
    """Unit vector along a direction by name or components; ``what`` names it in errors."""
    if isinstance(value, str):
        if value not in DIRECTIONS:
            near = validate.meant(value, DIRECTIONS)
            raise SettingError(f"{what}: expected one of {tuple(DIRECTIONS)} or three numbers, found '{value}'{near}")
        return np.array(DIRECTIONS[value])
    vector = validate.numbers(what, value, 3)
    validate.that(np.any(vector), what, "3 finite numbers, not all zero", value)
    return vector / np.linalg.norm(vector)


def _check_place(place: Excitation | Response, what: str) -> None:
    validate.instance(f"{what} location", place.location, str, "the name of a location")
    direction_vector(place.direction, f"{what} direction")


@validate.spelt
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
        _check_place(self, "excitation")
        object.__setattr__(self, "amplitude", validate.number("excitation amplitude", self.amplitude, least=0.0, unit="N"))
        object.__setattr__(self, "phase", validate.number("excitation phase", self.phase, unit="rad"))


@validate.spelt
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
        _check_place(self, "response")
