"""Where and along which direction a structure is excited, and its response read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.formatting import text_of


def direction_vector(value: str | Sequence[float], what: str) -> NDArray:
    """Unit vector along a direction by name or components; ``what`` names it in errors."""
    directions = {"tangential": (1.0, 0.0, 0.0), "radial": (0.0, 1.0, 0.0), "axial": (0.0, 0.0, 1.0)}
    if isinstance(value, str):
        if value not in directions:
            near = validation.suggest_name(value, directions)
            raise SettingError(f"{what}: expected one of {tuple(directions)} or three numbers, found '{value}'{near}")
        return np.array(directions[value])
    vector = validation.numbers(what, value, 3)
    validation.check_value(np.any(vector), what, "3 finite numbers, not all zero", value)
    return vector / np.linalg.norm(vector)


def _direction(name: str, value: str | Sequence[float]) -> str | Sequence[float]:
    direction_vector(value, name)
    return value


def _phase(name: str, value: float) -> float:
    expected = "a phase in radians from -2 pi to 2 pi; np.deg2rad(90) is 90 degrees"
    phase = validation.number(name, value)
    validation.check_value(abs(phase) <= 2.0 * np.pi, name, expected, value)
    return phase


def _excitations(name: str, value: Sequence[Excitation]) -> tuple[Excitation, ...]:
    for part in value:
        validation.instance(name, part, Excitation)
        validation.check_value(not part.beside, name, "forces without others beside them", part)
    return tuple(value)


FIELD = np.array([1.0, -1.0j, 0.0])
"""Along which the rows of a field of forces, its real and its imaginary part, make the modal force."""
Direction = Annotated[str | tuple[float, float, float], _direction]
Location = Annotated[str, partial(validation.instance, kind=str, words="the name of a location")]


@validation.check_arguments
@dataclass(frozen=True)
class Excitation:
    """A travelling-wave force of engine-order type on every blade; sums of them act together: ``one + other``.

    Parameters
    ----------
    location : str
        Of the model, or a field of nodal forces of the model by its name (``forces`` of
        :func:`bdamper.importers.build_model`), or "mode 1", "mode 2", ... for a force on one mode of the constrained body
        alone.
    direction : {"tangential", "radial", "axial"} or three floats
        Of a force at a location; fields and modes have none.
    amplitude : float, N
        Factor on a field; modal force in N kg^-1/2 on a mode.
    phase : float, rad
        Phase of the force on the reference blade, ``amplitude cos(omega t + phase)``, from -2 pi to 2 pi.
    engine_order : int, optional
        A multiple of that of the study, by default the same: a force of order ``h`` times that of the study acts on its
        harmonic ``h``.
    beside : tuple of Excitation
        Forces that act together with this one; a change of ``amplitude`` leaves them.
    """

    location: Location
    direction: Direction = "tangential"
    amplitude: validation.Force = 1.0
    phase: Annotated[float, _phase] = 0.0
    engine_order: validation.Natural | None = None
    beside: Annotated[tuple[Excitation, ...], _excitations] = ()

    def __post_init__(self) -> None:
        validation.check_fields(self, "excitation ")

    def __add__(self, other: Excitation) -> Excitation:
        return replace(self, beside=(*self.beside, replace(other, beside=()), *other.beside))

    @property
    def force(self) -> complex:
        """Complex amplitude, N."""
        return complex(self.amplitude * np.exp(1j * self.phase))

    @property
    def shown(self) -> str:
        """Location, direction and phase as a print shows them."""
        phase = f", phase {np.rad2deg(self.phase):.6g} degrees" if self.phase else ""
        return f"at {self.location} {text_of(self.direction)}{phase}"


@validation.check_arguments
@dataclass(frozen=True)
class Response:
    """Location and direction of the response.

    Parameters
    ----------
    location : str
    direction : {"tangential", "radial", "axial"} or three floats
    """

    location: Location
    direction: Direction = "tangential"

    def __post_init__(self) -> None:
        validation.check_fields(self, "response ")


@validation.check_arguments
def influence_coefficients(given: Mapping[int, complex], n_blades: int) -> dict[int, complex]:
    """Aerodynamic damping of every nodal diameter from what the motion of one blade does to its neighbours.

    Parameters
    ----------
    given : mapping of int to complex
        Influence coefficient of the blade so many sectors further on (0 its own, 1 and -1 its neighbours): real part a
        relative shift of the frequency, imaginary part a damping ratio.
    n_blades : int

    Returns
    -------
    dict of nodal diameter (0 to n_blades - 1, backward waves beyond half) to complex
        ``sum_k z_k exp(2 pi i k d / n_blades)``, for the setting ``aerodynamic_damping``.

    Raises
    ------
    SettingError
    """
    n = validation.integer("n_blades", n_blades, 1)
    for k, z in validation.instance("influence coefficients", given, Mapping, "a mapping of blades to numbers").items():
        validation.integer(f"blade of coefficient {k}", k, -n)
        validation.check_value(np.isfinite(z), f"influence coefficient of blade {k}", "a finite number", z)
    return {d: complex(sum(z * np.exp(2j * np.pi * k * d / n) for k, z in given.items())) for d in range(n)}
