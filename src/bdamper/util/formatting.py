"""Numbers and names in the texts of results, of pictures and of tables.

Short texts of objects that hold arrays: what a console or a notebook shows of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

# ---- Numbers and names in the texts of results, of pictures and of tables ----


def percent(value: float, sign: bool = False) -> str:
    """A relative number with two digits; from 100 % on in whole per cent."""
    if not np.isfinite(value):
        return "unknown"
    return f"{100.0 * value:{'+' if sign else ''}{'.0f' if 0.995 <= abs(value) < 1e4 else '.2g'}} %"


UNITS = {
    "preload": "N", "amplitude": "m", "frequency": "Hz", "optimum_preload": "N", "optimum_amplitude": "m",
    "optimum_frequency": "Hz", "free_amplitude": "m", "free_frequency": "Hz", "stuck_amplitude": "m",
    "stuck_frequency": "Hz", "tuned_amplitude": "m", "excitation.amplitude": "N",
    "excitation.phase": "rad", "load": "N", "linear_to": "m", "highest": "m", "scales_to": "N", "normal_force": "N",
    "speed": "rad/s", "fixed_speed": "rad/s", "fixed_speed_amplitude": "m", "amplitude_by_mass": "m",
    "speed_by_mass": "rad/s", "mass": "kg", "damper_drag": "N s/m", "residual_slip_std": "m",
    "force": "N", "displacement": "m", "by_interface": "J",
}  # fmt: skip
"""Units of settings and answers; what is not listed is a plain number or a name."""
FITTING = {"m": "nµm ", "N": "m kM", "N/m": " kM", "J": "nµm k", "Pa": " kMG", "s": "µm ", "g": "m k"}
"""Prefixes that the number of a unit may take; a kilogram counts as a thousand grams."""
PREFIXES = {"n": 1e-9, "µ": 1e-6, "m": 1e-3, " ": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}


def amount(value: float, unit: str = "", digits: int = 3) -> str:
    """A number with its unit: so many digits, but no fewer than stand before the point, and the prefix that fits.

    Parameters
    ----------
    value : float
    unit : str
        Without a prefix, besides kg; "" for a mere number, "%" for per cent, with "per ..." behind it where needed.
    digits : int
    """
    base, per, rest = unit.partition(" per ")
    size, base = (1e3 * abs(value), "g") if base == "kg" else (abs(value), base)
    prefix = unit_prefix(size * (1.0 + 0.5 * 10.0**-digits), base)
    number = np.copysign(size / PREFIXES[prefix], value)
    whole = int(np.log10(np.clip(abs(number), 1.0, 1e9))) + 1 if np.isfinite(number) else 1
    return f"{number:.{max(digits, whole if whole < 7 else 0)}g} {prefix.strip()}{base}{per}{rest}".rstrip()


def span(low: float, high: float, unit: str, near: float | None = None) -> str:
    """Two numbers in one unit that fits the second, or another number: "149 to 276 µm"."""
    size = high if near is None else near
    digits, name = amount(size, unit).split(" ", 1)
    scale = 10.0 ** round(np.log10(float(digits) / size)) if size else 1.0
    return f"{scale * low:.3g} to {scale * high:.3g} {name}"


def unit_prefix(size: float, unit: str) -> str:
    """The prefix that makes a number of this size, in this unit, at least one; " " for none."""
    reached = [prefix for prefix in FITTING.get(unit, " ") if size >= PREFIXES[prefix]]
    return reached[-1] if reached and np.isfinite(size) else " "


def peak_text(amplitude: float, frequency: float, digits: int = 3) -> str:
    """How high a response is (m), and where (Hz); in six digits, places that lie close together are told apart."""
    return f"{amount(amplitude, 'm', digits)} at {amount(frequency, 'Hz', digits)}"


def spaced(name: str) -> str:
    """The name of a setting or field in words."""
    return name.replace("_", " ").replace(".", " ")


def aligned(rows: Sequence[Sequence[str]], indent: str = "") -> list[str]:
    """Lines of a table, each column but the last as wide as its longest text and two spaces."""
    if not rows:
        return []
    width = [max(len(row[i]) for row in rows) + 2 for i in range(len(rows[0]) - 1)]
    lines = ["".join(f"{text:<{w}}" for text, w in zip(row, width)) + row[-1] for row in rows]
    return [f"{indent}{line}".rstrip() for line in lines]


def truncate(text: str, most: int) -> str:
    """The text in at most so many characters."""
    return text if len(text) <= most else text[: most - 3] + "..."


def loads_text(load_per_preload: Mapping[str, float] | None) -> str:
    """Loads per newton of preload: "front 1, rear 0.6"; empty where every loaded body has the preload."""
    return ", ".join(f"{name} {load:.6g}" for name, load in (load_per_preload or {}).items())


def preload_text(preload: float, settings: Mapping[str, Any]) -> str:
    """A preload (N) in words, with what it loads where the settings of a result say so."""
    shares = loads_text(settings.get("load_per_preload"))
    return f"a preload of {amount(preload, 'N')}{f' ({shares})' if shares else ''}"


# ---- Short texts of objects that hold arrays ----


T = TypeVar("T", bound=type)


def short_repr(cls: T) -> T:
    """Class decorator: the representation of a dataclass is its ``str``, or its items with arrays by their shapes alone."""
    prints_itself = any("__str__" in base.__dict__ for base in cls.__mro__[:-1])
    cls.__repr__ = cls.__str__ if prints_itself else _as_items  # type: ignore[assignment]
    return cls


def _as_items(self: Any) -> str:
    shown = [f for f in fields(self) if f.repr]
    return f"{type(self).__name__}({', '.join(f'{f.name}={short_text(getattr(self, f.name))}' for f in shown)})"


def text_of(value: object) -> str:
    """A text as it is, anything else by :func:`short_text`."""
    return value if isinstance(value, str) else short_text(value)


def short_text(value: Any) -> str:
    """One item: an array by its shape, a mapping by its names, a longer sequence by its length."""
    if isinstance(value, np.ndarray):
        return repr(value.item()) if value.ndim == 0 else f"<{' x '.join(map(str, value.shape))} {value.dtype}>"
    longest = 60  # characters of one item
    if isinstance(value, Mapping):
        text = "{" + ", ".join(f"{key!r}: {short_text(item)}" for key, item in value.items()) + "}"
        return text if len(text) <= longest else f"<{len(value)} by name: {truncate(', '.join(map(str, value)), longest)}>"
    if isinstance(value, (list, tuple)):
        text = ("[{}]" if isinstance(value, list) else "({})").format(", ".join(short_text(item) for item in value))
        return text if len(text) <= longest else f"<{len(value)} items>"
    if is_dataclass(value) and not isinstance(value, type):
        text = repr(value)
        return text if len(text) <= longest and "\n" not in text else f"{type(value).__name__}(...)"
    return truncate(repr(value), longest) if not isinstance(value, (int, float, complex, np.generic)) else repr(value)
