"""Conversion of pint quantities to plain numbers in the units of the package.

pint treats the radian as a plain number: it converts 1 rad/s to 1 Hz.  Here, frequencies and rotor
speeds are converted to revolutions first, so that 1 Hz, 1 turn/s, 60 rpm and 6.28 rad/s are equal.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Protocol, TypeGuard

import numpy as np

from bdamper.util import plausible_ranges
from bdamper.util.errors import SettingError, one_line
from bdamper.util.plausible_ranges import Names, Range

TURN = 2.0 * np.pi
PHYSICAL = ("N", "m", "rad", "rad/s", "Hz", "Pa", "kg", "N/m", "N/m3", "kg/m3", "N s/m", "%")
"""Units of ranges that are no words such as "times the mass of the damper"."""
UNITS_WITHOUT_RANGE: dict[str, str] = {
    "preload": "N",
    "frequency": "Hz",
    "rate": "Hz/s",
    "speed": "rad/s",
    "speeds": "rad/s",
    "omega": "rad/s",
    "rpm": "rpm",
    "phase": "rad",
    "face_angle": "rad",
    "twist": "rad",
    "angle": "rad",
    "axial_angle": "rad",
    "microslip.forces": "N",
    "max_turn": "rad",
    "gauge_stress.gauge": "m",
    "Response.location": "m",
    "PerArea.stiffness": "N/m3",
    "Checks.expected_frequencies": "Hz",
}
"""Units of parameters without a range, of all functions or of the one before the name."""


class Quantity(Protocol):
    """Attributes and methods of a :class:`pint.Quantity`."""

    magnitude: Any

    def to(self, unit: str) -> Quantity: ...

    def to_root_units(self) -> Quantity: ...

    def unit_items(self) -> Iterable[tuple[str, float]]: ...


def is_quantity(value: object) -> TypeGuard[Quantity]:
    """Return whether a value is a pint quantity."""
    return hasattr(value, "magnitude") and hasattr(value, "to_root_units")


def unit_of(owner: str, name: str) -> str | tuple[str, ...] | None:
    """Return the unit of a parameter of a function or class, or of each of its numbers.

    The unit is empty for plain numbers, and None for an unknown parameter.
    """
    class_name = owner.partition(".")[0]
    parameter = name.partition(".")[0]
    for key in (f"{owner}.{name}", f"{class_name}.{name}", name):
        if key in UNITS_WITHOUT_RANGE:
            return UNITS_WITHOUT_RANGE[key]
    limits = plausible_ranges.entry(owner, name) or plausible_ranges.entry(owner, parameter)
    if isinstance(limits, tuple):
        return tuple(_unit_of_range(part) for part in limits)
    if isinstance(limits, Range):
        return _unit_of_range(limits)
    return None if limits is None else ""


def _unit_of_range(limits: Range) -> str:
    return limits.unit if limits.unit in PHYSICAL else ""


def in_unit(name: str, value: Quantity, unit: str) -> Any:
    """Return the magnitude of a quantity in a unit.

    Raises
    ------
    SettingError
        If the quantity has a different dimension, or if its unit may mean revolutions or radians.
    """
    try:
        return _converted(value, unit)
    # each reason has another class of error
    except Exception as error:
        expected = unit or "a plain number"
        raise SettingError(f"{name}: expected {expected}, found {one_line(value)}") from error


def _converted(value: Quantity, unit: str) -> Any:
    # power of the radian in the quantity
    radians = dict(value.to_root_units().unit_items()).get("radian", 0)
    if unit in ("Hz", "Hz/s"):
        return value.to(unit).magnitude / TURN**radians
    if unit in ("rad/s", "rpm"):
        in_hertz = any(name.endswith("hertz") for name, _ in value.unit_items())
        if not (radians or in_hertz):
            raise ValueError("1/s may mean revolutions or radians per second")
        turns = value.to("rad/s").magnitude / (TURN if radians else 1.0)
        return turns * (TURN if unit == "rad/s" else 60.0)
    if radians and unit != "rad":
        raise ValueError("an angle instead of a plain number")
    name_in_pint = "percent" if unit == "%" else unit.replace("m3", "m**3")
    return value.to(name_in_pint).magnitude


def plain(owner: str, name: str, value: object) -> Any:
    """Return an argument with its quantities converted, in lists, tuples and mappings as well.

    Parameters
    ----------
    owner, name : str
        Function or class, and its parameter.
    value : object
    """
    limits = plausible_ranges.entry(owner, name)
    if isinstance(limits, Names):
        return _settings(limits.of, value)
    unit = unit_of(owner, name)
    if unit is None:
        return value
    if isinstance(unit, str):
        return in_lists(name, value, unit)
    if isinstance(value, list | tuple) and len(value) == len(unit):
        return tuple(in_lists(name, part, part_unit) for part, part_unit in zip(value, unit))
    return value


def _settings(of: str, value: object) -> Any:
    """Convert the values of a mapping of settings, or of a mapping of such mappings."""
    if not isinstance(value, Mapping):
        return value
    converted = {}
    for key, inner in value.items():
        is_setting = unit_of(of, str(key)) is not None
        converted[key] = plain(of, str(key), inner) if is_setting else _settings(of, inner)
    return converted


def in_lists(name: str, value: object, unit: str) -> Any:
    """Convert the quantities of a value, also in lists, tuples and mappings, to a unit."""
    if is_quantity(value):
        return in_unit(name, value, unit)
    if type(value) is list:
        return [in_lists(name, part, unit) for part in value]
    if type(value) is tuple:
        return tuple(in_lists(name, part, unit) for part in value)
    if type(value) is dict:
        return {key: in_lists(name, part, unit) for key, part in value.items()}
    return value
