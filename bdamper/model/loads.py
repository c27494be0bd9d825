"""Location and direction of excitation and response, and aerodynamic influence coefficients."""

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

AXES = ("tangential", "radial", "axial")
"""Names of the directions along X, Y and Z."""


def direction_vector(value: str | Sequence[float], what: str) -> NDArray:
    """Return the unit vector along a named direction or along three components.

    ``what`` is its name in errors.
    """
    directions = dict(zip(AXES, np.eye(3)))
    if isinstance(value, str):
        if value not in directions:
            suggestion = validation.suggest_name(value, directions)
            raise SettingError(
                f"{what}: expected one of {tuple(directions)} or three numbers, "
                f"found '{value}'{suggestion}"
            )
        return directions[value]
    vector = validation.numbers(what, value, 3)
    validation.check_value(np.any(vector), what, "3 finite numbers, not all zero", value)
    return vector / np.linalg.norm(vector)


def _direction(name: str, value: str | Sequence[float]) -> str | Sequence[float]:
    direction_vector(value, name)
    return value


def _phase(name: str, value: float) -> float:
    phase = validation.number(name, value)
    if abs(phase) > 2.0 * np.pi:
        error = validation.invalid(name, "a phase in radians from -2 pi to 2 pi", value)
        raise SettingError(f"{error}; possibly given in degrees: use np.deg2rad({phase:g})")
    return phase


def _place(name: str, value: str | Sequence[float]) -> str | tuple[float, ...]:
    if isinstance(value, str):
        return value
    expected = "the name of a location"
    value = validation.instance(name, value, (tuple, list, np.ndarray), expected)
    return tuple(validation.numbers(name, value, 3).tolist())


def _elastic(name: str, value: Sequence[float]) -> tuple[float, ...]:
    return tuple(
        validation.numbers(f"{name}, Young's modulus and Poisson's ratio", value, 2).tolist()
    )


def _excitations(name: str, value: Sequence[Excitation]) -> tuple[Excitation, ...]:
    for part in validation.instance(name, value, (tuple, list), "a sequence of Excitation"):
        validation.instance(name, part, Excitation)
        validation.check_value(not part.beside, name, "single forces, not sums", part)
    return tuple(value)


BASE = "base"
"""Location of the held nodes, whose acceleration is an excitation."""
FIELD = np.array([1.0, -1.0j, 0.0])
"""Direction for a field of forces: its rows are the real and the imaginary part."""
Direction = Annotated[str | tuple[float, float, float], _direction]
Location = Annotated[str, partial(validation.instance, kind=str, words="the name of a location")]


@validation.check_arguments
@dataclass(frozen=True)
class Excitation:
    """Travelling-wave (engine order) excitation of every blade.

    The sum ``one + other`` applies both excitations.

    Parameters
    ----------
    location : str
        Location of the model, name of a field of nodal forces (``forces`` of
        :func:`bdamper.importers.build_model`), "mode 1", "mode 2", ... for a modal force on one
        mode of the constrained body, or "base" for an acceleration of the fixed nodes (``base`` of
        :func:`bdamper.importers.build_model` and of :func:`bdamper.lumped`).
    direction : {"tangential", "radial", "axial"} or three floats
        Direction of a force at a location, or of the base acceleration; it has no effect on force
        fields and modal forces.
    amplitude : float, N
        Amplitude of the force. It is a factor for a force field, in N kg^-1/2 for a modal force,
        and in m/s2 for the base.
    phase : float, rad
        Phase of the force on the reference blade, ``amplitude cos(omega t + phase)``, from -2 pi to
        2 pi.
    engine_order : int, optional
        Engine order of the force, a multiple of the engine order of the study; by default the same.
        A force with ``h`` times the engine order of the study acts on harmonic ``h``.
    beside : tuple of Excitation
        Other forces of a sum; ``amplitude`` does not scale them.
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
        """Description of location, direction and phase."""
        phase = f", phase {np.rad2deg(self.phase):.6g} degrees" if self.phase else ""
        return f"at {self.location}, {text_of(self.direction)}{phase}"


@validation.check_arguments
@dataclass(frozen=True)
class Response:
    """Location and direction of the response, or a strain gauge.

    Parameters
    ----------
    location : str or (3,) float, m
        Location of the model.  For a gauge: a point of a stress set or coordinates near one, as in
        :meth:`bdamper.Study.gauge_stress`.
    direction : {"tangential", "radial", "axial"} or three floats
    absolute : bool
        Whether the response to base excitation is the absolute motion; by default it is relative to
        the base.
    elastic : (Young's modulus in Pa, Poisson's ratio), optional
        If given, the response is the strain that a gauge along ``direction`` measures on this
        material.
    """

    location: Annotated[str | tuple[float, float, float], _place]
    direction: Direction = "tangential"
    absolute: bool = False
    elastic: Annotated[tuple[float, float], _elastic] | None = None

    def __post_init__(self) -> None:
        validation.check_fields(self, "response ")
        is_place = isinstance(self.location, str) or self.elastic is not None
        expected = "the name of a location, or elastic=(modulus, ratio) for a strain gauge there"
        validation.check(is_place, "response location", expected, self.location)
        one = not (self.absolute and self.elastic is not None)
        cannot = "absolute=True cannot be combined with a strain gauge"
        validation.check_sentence(one, "response", cannot)

    @property
    def shown(self) -> str:
        """Description of location and direction."""
        kind = ", absolute" if self.absolute else ""
        kind = kind if self.elastic is None else ", strain"
        return f"{text_of(self.location)}, {text_of(self.direction)}{kind}"

    @property
    def unit(self) -> str:
        """Unit of the response: m, or m/m at a strain gauge."""
        return "m" if self.elastic is None else "m/m"


@validation.check_arguments
def influence_coefficients(given: Mapping[int, complex], n_blades: int) -> dict[int, complex]:
    """Convert influence coefficients to the aerodynamic damping of every nodal diameter.

    Parameters
    ----------
    given : mapping of int to complex
        Influence coefficient of the blade at each sector offset (0 the blade itself, 1 and -1 its
        neighbours).  The real part is a relative frequency shift, the imaginary part a damping
        ratio.
    n_blades : int

    Returns
    -------
    dict of nodal diameter (0 to n_blades - 1, backward waves above n_blades/2) to complex
        ``sum_k z_k exp(2 pi i k d / n_blades)``, for the setting ``aerodynamic_damping``.

    Raises
    ------
    SettingError
        If an offset is not an integer or a coefficient is not finite.
    """
    n = validation.integer("n_blades", n_blades, 1)
    expected = "a mapping of blades to numbers"
    coefficients = validation.instance("influence coefficients", given, Mapping, expected)
    for k, z in coefficients.items():
        validation.integer(f"blade of coefficient {k}", k, -n)
        name = f"influence coefficient of blade {k}"
        validation.check_value(np.isfinite(z), name, "a finite number", z)

    damping = {}
    for d in range(n):
        terms = [z * np.exp(2j * np.pi * k * d / n) for k, z in coefficients.items()]
        damping[d] = complex(sum(terms))
    return damping
