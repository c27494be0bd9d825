"""Format numbers, names and objects for printed results, figures and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

# ---- Numbers and names ----


def percent(value: float, sign: bool = False) -> str:
    """Return a ratio in per cent with two digits, or as a whole number from 100 % on."""
    if not np.isfinite(value):
        return "unknown"
    return f"{100.0 * value:{'+' if sign else ''}{'.0f' if 0.995 <= abs(value) < 1e4 else '.2g'}} %"


UNITS = {
    "preload": "N", "amplitude": "m", "half_range": "m", "frequency": "Hz", "optimum_preload": "N",
    "optimum_amplitude": "m", "optimum_frequency": "Hz", "free_amplitude": "m", "free_frequency": "Hz",
    "stuck_amplitude": "m", "stuck_frequency": "Hz", "tuned_amplitude": "m", "excitation.amplitude": "N",
    "excitation.phase": "rad", "load": "N", "linear_to": "m", "highest": "m", "scales_to": "N", "normal_force": "N",
    "speed": "rad/s", "fixed_speed": "rad/s", "fixed_speed_amplitude": "m", "amplitude_by_mass": "m",
    "speed_by_mass": "rad/s", "mass": "kg", "damper_drag": "N s/m", "residual_slip_std": "m",
    "force": "N", "displacement": "m", "by_interface": "J", "design_amplitude": "m",
}  # fmt: skip
"""Units of settings and results; a name that is not listed is a plain number or a text."""
FITTING = {
    "m": "nµm ",
    "N": "m kM",
    "N/m": " kM",
    "J": "nµm k",
    "Pa": " kMG",
    "s": "µm ",
    "g": "m k",
}
"""Allowed prefixes of each unit; kg is formatted in multiples of g."""
PREFIXES = {"n": 1e-9, "µ": 1e-6, "m": 1e-3, " ": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}


def amount(value: float, unit: str = "", digits: int = 3) -> str:
    """Return a number with its unit and the largest prefix that keeps it at least one.

    Parameters
    ----------
    value : float
    unit : str
        Unit without a prefix, except kg.  "" for a plain number, "%" for per cent; "per ..." may follow.
    digits : int
        Significant digits; all digits before the decimal point are shown.
    """
    base, per, rest = unit.partition(" per ")
    size, base = (1e3 * abs(value), "g") if base == "kg" else (abs(value), base)
    prefix = unit_prefix(size * (1.0 + 0.5 * 10.0**-digits), base)
    number = np.copysign(size / PREFIXES[prefix], value)
    whole = int(np.log10(np.clip(abs(number), 1.0, 1e9))) + 1 if np.isfinite(number) else 1
    return f"{number:.{max(digits, whole if whole < 7 else 0)}g} {prefix.strip()}{base}{per}{rest}".rstrip()


def span(low: float, high: float, unit: str, near: float | None = None) -> str:
    """Return a range in the unit prefix of ``high`` or of ``near``, for example "149 to 276 µm"."""
    size = high if near is None else near
    digits, name = amount(size, unit).split(" ", 1)
    scale = 10.0 ** round(np.log10(float(digits) / size)) if size else 1.0
    return f"{scale * low:.3g} to {scale * high:.3g} {name}"


def unit_prefix(size: float, unit: str) -> str:
    """Return the largest prefix that keeps a number of the given size at least one; " " for none."""
    reached = [prefix for prefix in FITTING.get(unit, " ") if size >= PREFIXES[prefix]]
    return reached[-1] if reached and np.isfinite(size) else " "


def peak_text(amplitude: float, frequency: float, digits: int = 3) -> str:
    """Return an amplitude (m) and its frequency (Hz) as text.

    Six digits distinguish points that lie close together.
    """
    return f"{amount(amplitude, 'm', digits)} at {amount(frequency, 'Hz', digits)}"


def spaced(name: str) -> str:
    """Return the name of a setting or field with spaces."""
    return name.replace("_", " ").replace(".", " ")


def counted(n: int, what: str) -> str:
    """Return a number of things, for example "1 point", "2 points" or "no point"."""
    return f"{n or 'no'} {what}{'s' * (n > 1)}"


def aligned(rows: Sequence[Sequence[str]], indent: str = "") -> list[str]:
    """Return the lines of a table, with each column but the last padded to its longest text."""
    if not rows:
        return []
    width = [max(len(row[i]) for row in rows) + 2 for i in range(len(rows[0]) - 1)]
    lines = ["".join(f"{text:<{w}}" for text, w in zip(row, width)) + row[-1] for row in rows]
    return [f"{indent}{line}".rstrip() for line in lines]


WIDEST = 118
"""Characters of a printed row; two more may be its indentation."""


def table_lines(rows: Sequence[Sequence[str]], indent: str = "", whole: bool = False) -> list[str]:
    """Return the lines of a table without empty columns, as wide as :data:`WIDEST` allows.

    The last line names the other columns. If ``whole``, they follow in further tables, each with the first column.
    """
    first, *columns = [column for column in zip(*rows) if any(column[1:])] or [()]
    lines: list[str] = []
    while (first and not lines) or (whole and columns):
        width = np.cumsum([max(map(len, column)) + 2 for column in (first, *columns)])
        n = max(int(np.count_nonzero(width <= WIDEST + 2)) - 1, min(len(columns), 1))
        lines += aligned([*zip(first, *columns[:n])], indent)
        columns = columns[n:]
    others = ", ".join(column[0] for column in columns)
    return lines + [truncate(f"{indent}also: {others}", WIDEST)] * bool(others)


def truncate(text: str, most: int) -> str:
    """Return a text with at most ``most`` characters."""
    return text if len(text) <= most else text[: most - 3] + "..."


def loads_text(load_per_preload: Mapping[str, float] | None) -> str:
    """Return the loads per newton of preload, for example "front 1, rear 0.6"; empty if all bodies carry the preload."""
    return ", ".join(f"{name} {load:.6g}" for name, load in (load_per_preload or {}).items())


def preload_text(preload: float, settings: Mapping[str, Any]) -> str:
    """Return a preload (N) as text, with the loads per newton if the settings contain them."""
    shares = loads_text(settings.get("load_per_preload"))
    return f"a preload of {amount(preload, 'N')}{f' ({shares})' if shares else ''}"


# ---- Short texts of objects ----


T = TypeVar("T", bound=type)


def short_repr(cls: T) -> T:
    """Decorate a dataclass with a ``repr`` of one line.

    It is the beginning of its headline or of ``str`` if the class defines one; otherwise it lists the fields, with arrays
    shown by their shapes.
    """
    prints_itself = any("__str__" in base.__dict__ for base in cls.__mro__[:-1])
    cls.__repr__ = _first_words if prints_itself else _as_items  # type: ignore[assignment]
    return cls


def _first_words(self: Any) -> str:
    headline, name = getattr(self, "_headline", str)(), type(self).__name__
    words = " ".join((headline or str(self)).split()).removeprefix(f"{name.lower()} ")
    return f"{name}: {truncate(words, 160)}"


def _as_items(self: Any) -> str:
    shown = [f for f in fields(self) if f.repr]
    return f"{type(self).__name__}({', '.join(f'{f.name}={short_text(getattr(self, f.name))}' for f in shown)})"


def text_of(value: object) -> str:
    """Return a text unchanged and any other value by :func:`short_text`."""
    return value if isinstance(value, str) else short_text(value)


def short_text(value: Any) -> str:
    """Return a short text of a value: arrays by shape, mappings by keys, long sequences by length."""
    if isinstance(value, np.ndarray):
        return (
            repr(value.item())
            if value.ndim == 0
            else f"<{' x '.join(map(str, value.shape))} {value.dtype}>"
        )
    longest = 60  # characters of one item
    if isinstance(value, Mapping):
        text = "{" + ", ".join(f"{key!r}: {short_text(item)}" for key, item in value.items()) + "}"
        return (
            text
            if len(text) <= longest
            else f"<{len(value)} by name: {truncate(', '.join(map(str, value)), longest)}>"
        )
    if isinstance(value, (list, tuple)):
        text = ("[{}]" if isinstance(value, list) else "({})").format(
            ", ".join(short_text(item) for item in value)
        )
        return text if len(text) <= longest else f"<{len(value)} items>"
    if is_dataclass(value) and not isinstance(value, type):
        text = repr(value)
        return text if len(text) <= longest and "\n" not in text else f"{type(value).__name__}(...)"
    return (
        truncate(repr(value), longest)
        if not isinstance(value, (int, float, complex, np.generic))
        else repr(value)
    )
