"""Format numbers, names and objects for printed results, figures and tables."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

# ---- Numbers and names ----


SMALLEST_SHOWN = 1e-12
"""Relative size of a number that is printed as zero, because it is a rounding error."""


def without_rounding(value: float, scale: float) -> float:
    """Return 0 for a rounding error of numbers as large as ``scale``, otherwise the value."""
    return 0.0 if abs(value) < SMALLEST_SHOWN * abs(scale) else value


def percent(value: float, sign: bool = False) -> str:
    """Return a ratio in per cent with two digits, or as a whole number if it is 100 % or more.

    A rounding error is 0 %, without a sign.
    """
    if not np.isfinite(value):
        return "unknown"
    if abs(value) < 1e-9:
        return "0 %"
    digits = ".0f" if 0.995 <= abs(value) < 1e4 else ".2g"
    plus = "+" if sign else ""
    return f"{100.0 * value:{plus}{digits}} %"


UNITS = {
    "preload": "N",
    "amplitude": "m",
    "constant_loads": "N",
    "gap": "m",
    "shroud_force": "N",
    "interference": "m",
    "static_slip": "m",
    "locked_amplitude": "m",
    "half_range": "m",
    "lower_bound": "m",
    "frequency": "Hz",
    "optimum_preload": "N",
    "optimum_amplitude": "m",
    "optimum_frequency": "Hz",
    "free_amplitude": "m",
    "free_frequency": "Hz",
    "stuck_amplitude": "m",
    "stuck_frequency": "Hz",
    "tuned_amplitude": "m",
    "excitation.amplitude": "N",
    "excitation.phase": "rad",
    "load": "N",
    "linear_to": "m",
    "highest": "m",
    "scales_to": "N",
    "normal_force": "N",
    "speed": "rad/s",
    "fixed_speed": "rad/s",
    "fixed_speed_amplitude": "m",
    "amplitude_by_mass": "m",
    "speed_by_mass": "rad/s",
    "mass": "kg",
    "damper_drag": "N s/m",
    "residual_slip_std": "m",
    "force": "N",
    "displacement": "m",
    "by_interface": "J",
    "design_amplitude": "m",
}
"""Units of settings and results; a name that is not listed is a plain number or a text."""


def unit_of(name: str) -> str:
    """Return the unit of a setting or result, also of a part such as "gap.shroud", or ""."""
    head, _, _ = name.partition(".")
    return UNITS.get(name, UNITS.get(head, ""))


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
DIGITS = {"Hz": 5}
"""Significant digits of units in which small changes matter; other units have three."""
PREFIXES = {"n": 1e-9, "µ": 1e-6, "m": 1e-3, " ": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}


def amount(value: float, unit: str = "", digits: int | None = None) -> str:
    """Return a number with its unit and the largest prefix that keeps it at least one.

    Parameters
    ----------
    value : float
    unit : str
        Unit without a prefix, except kg.  "" for a plain number, "%" for per cent; "per ..." may
        follow.
    digits : int, optional
        Significant digits, by default five for Hz and three for other units; all digits before
        the decimal point are shown.
    """
    base, per, rest = unit.partition(" per ")
    if digits is None:
        digits = DIGITS.get(base, 3)
    size = abs(value)
    # the prefixes apply to the gram
    if base == "kg":
        size = 1e3 * abs(value)
        base = "g"
    # a number that is rounded up to one has the larger prefix
    prefix = unit_prefix(size * (1.0 + 0.5 * 10.0**-digits), base)
    number = np.copysign(size / PREFIXES[prefix], value)
    digits_before_point = 1
    if np.isfinite(number):
        digits_before_point = int(np.log10(np.clip(abs(number), 1.0, 1e9))) + 1
    # larger numbers have a power of ten
    if digits_before_point < 7:
        digits = max(digits, digits_before_point)
    return f"{number:.{digits}g} {prefix.strip()}{base}{per}{rest}".rstrip()


_AMOUNT = re.compile(r"([+-]?)(\d+(?:\.\d+)?) (\S+)")
"""Sign, number without an exponent, and unit, as :func:`amount` and :func:`percent` return them."""


def same_digits(texts: Sequence[str]) -> list[str]:
    """Return amounts of one unit with equally many significant digits: 2.50 m if another is 2.53 m.

    Other texts remain unchanged, and all texts do if the amounts have several units.
    """
    found = [_AMOUNT.fullmatch(text) for text in texts]
    matches = [match for match in found if match]
    # prefixes of the unit may differ
    if len({match[3][-1] for match in matches}) != 1:
        return list(texts)
    most = max(_significant(match[2]) for match in matches)
    padded = []
    for text, match in zip(texts, found):
        if match and _significant(match[2]):
            sign, number, unit = match.groups()
            before_point = len(number.partition(".")[0].lstrip("0"))
            shown = f"{float(number):#.{max(most, before_point)}g}".rstrip(".")
            text = f"{sign}{shown} {unit}"
        padded.append(text)
    return padded


def _significant(number: str) -> int:
    """Return the number of digits without leading zeros, and without final zeros before the point."""
    digits = number if "." in number else number.rstrip("0")
    return len(digits.replace(".", "").lstrip("0"))


def span(low: float, high: float, unit: str, near: float | None = None) -> str:
    """Return a range in the unit prefix of ``high`` or of ``near``, for example "149 to 276 µm"."""
    reference = high if near is None else near
    number, prefixed_unit = amount(reference, unit).split(" ", 1)
    scale = 1.0
    if reference:
        scale = 10.0 ** round(np.log10(float(number) / reference))
    digits = DIGITS.get(unit)
    return (
        f"{amount(scale * low, '', digits)} to {amount(scale * high, '', digits)} {prefixed_unit}"
    )


def area_text(area: float) -> str:
    """Return an area (m2) in mm², cm² or m²."""
    for size, unit in ((1.0, "m²"), (1e-4, "cm²")):
        if area >= 10.0 * size or (unit == "m²" and area >= 0.1):
            return f"{area / size:.3g} {unit}"
    return f"{area / 1e-6:.3g} mm²"


def extent(low: float, high: float, unit: str) -> str:
    """Return a range, or one value if both ends have the same digits."""
    if amount(low, unit) == amount(high, unit):
        return amount(high, unit)
    return span(low, high, unit)


def unit_prefix(size: float, unit: str) -> str:
    """Return the largest prefix that keeps a number of the given size at least one.

    It is " " if there is no prefix.
    """
    if not np.isfinite(size):
        return " "
    reached = [prefix for prefix in FITTING.get(unit, " ") if size >= PREFIXES[prefix]]
    return reached[-1] if reached else " "


def peak_text(amplitude: float, frequency: float, digits: int = 3) -> str:
    """Return an amplitude (m), with the given digits, and its frequency (Hz) as text."""
    return f"{amount(amplitude, 'm', digits)} at {amount(frequency, 'Hz')}"


def spaced(name: str) -> str:
    """Return the name of a setting or field with spaces."""
    return name.replace("_", " ").replace(".", " ")


def counted(n: int, what: str) -> str:
    """Return a number of things, for example "1 point", "2 masses" or "no frequency"."""
    return f"{n or 'no'} {_plural(what) if n > 1 else what}"


def ordinal(value: float) -> str:
    """Return a number as an ordinal, for example "95th", "91st" or "97.5th"."""
    text = f"{value:g}"
    is_teen = text[-2:] in ("11", "12", "13")
    endings = {} if is_teen or "." in text else {"1": "st", "2": "nd", "3": "rd"}
    return text + endings.get(text[-1], "th")


def listed(texts: Iterable[str]) -> str:
    """Return texts as a list in a sentence, for example "1, 3 and 5"."""
    *others, last = texts
    return f"{', '.join(others)} and {last}" if others else last


def _plural(noun: str) -> str:
    if noun.endswith(("s", "ch")):
        return f"{noun}es"
    if noun.endswith("cy"):
        return f"{noun[:-1]}ies"
    return f"{noun}s"


def aligned(rows: Sequence[Sequence[str]], indent: str = "") -> list[str]:
    """Return the lines of a table, with each column but the last padded to its longest text."""
    if not rows:
        return []
    n_padded = len(rows[0]) - 1
    widths = [max(len(row[i]) for row in rows) + 2 for i in range(n_padded)]
    lines = []
    for row in rows:
        padded = [f"{text:<{width}}" for text, width in zip(row, widths)]
        lines.append(f"{indent}{''.join(padded)}{row[-1]}".rstrip())
    return lines


WIDEST = 118
"""Characters of a printed row; two more may be its indentation."""


FEW_RECORDS = 3
"""A table with at most this many rows below its head is turned if it is too wide."""


def table_lines(rows: Sequence[Sequence[str]], indent: str = "", width: int = WIDEST) -> list[str]:
    """Return the lines of a table without empty columns, with at most ``width`` characters.

    A table of few rows that is too wide is turned: its columns become rows.  Otherwise the columns
    that do not fit follow in further tables, each with the first column.
    """
    # a column without texts below its head is empty
    columns = [column for column in zip(*rows) if any(column[1:])]
    if not columns:
        return []
    fits = _width(columns) <= width
    if not fits and len(rows) <= FEW_RECORDS + 1 and _width(rows) <= width:
        return aligned(columns, indent)
    first = columns[0]
    remaining = columns[1:]
    lines: list[str] = []
    while not lines or remaining:
        widths = [max(map(len, column)) + 2 for column in (first, *remaining)]
        n_fitting = int(np.count_nonzero(np.cumsum(widths) <= width + 2)) - 1
        # at least one column after the first
        n_shown = max(n_fitting, min(len(remaining), 1))
        lines += aligned([*zip(first, *remaining[:n_shown])], indent)
        remaining = remaining[n_shown:]
    return lines


def _width(columns: Sequence[Sequence[str]]) -> int:
    """Return the characters of a printed row of a table with these columns."""
    return sum(max(map(len, column)) + 2 for column in columns) - 2


def beyond(end: str) -> str:
    """Return the side on which values lie beyond the lower or upper end of a range."""
    return "below" if end == "lower" else "above"


def sentence(text: str) -> str:
    """Return a text that begins with a capital letter."""
    return f"{text[:1].upper()}{text[1:]}"


def truncate(text: str, most: int) -> str:
    """Return a text with at most ``most`` characters."""
    return text if len(text) <= most else text[: most - 3] + "..."


def loads_text(load_per_preload: Mapping[str, float] | None) -> str:
    """Return the loads per newton of preload, for example "front 1, rear 0.6".

    The text is empty if all bodies carry the preload.
    """
    if load_per_preload is None:
        return ""
    return ", ".join(f"{name} {load:.6g}" for name, load in load_per_preload.items())


# ---- Short texts of objects ----


T = TypeVar("T", bound=type)


def short_repr(cls: T) -> T:
    """Decorate a dataclass with a ``repr`` of one line.

    It is the beginning of its headline or of ``str`` if the class defines one; otherwise it lists
    the fields, with arrays shown by their shapes.
    """
    prints_itself = any("__str__" in base.__dict__ for base in cls.__mro__[:-1])
    cls.__repr__ = _first_words if prints_itself else _as_items  # type: ignore[assignment]
    return cls


def _first_words(self: Any) -> str:
    name = type(self).__name__
    headline = self._headline() if hasattr(self, "_headline") else ""
    words = " ".join((headline or str(self)).split())
    return f"{name}: {truncate(words.removeprefix(f'{name.lower()} '), 160)}"


def _as_items(self: Any) -> str:
    items = [f"{f.name}={short_text(getattr(self, f.name))}" for f in fields(self) if f.repr]
    return f"{type(self).__name__}({', '.join(items)})"


def text_of(value: object) -> str:
    """Return a text unchanged and any other value by :func:`short_text`."""
    return value if isinstance(value, str) else short_text(value)


def short_text(value: Any) -> str:
    """Return a short text: arrays by shape, mappings by keys, long sequences by length."""
    longest = 60  # characters of one item
    if isinstance(value, np.ndarray):
        if value.ndim == 0:
            return repr(value.item())
        return f"<{' x '.join(map(str, value.shape))} {value.dtype}>"
    if isinstance(value, Mapping):
        items = [f"{key!r}: {short_text(item)}" for key, item in value.items()]
        text = "{" + ", ".join(items) + "}"
        if len(text) <= longest:
            return text
        return f"<{len(value)} by name: {truncate(', '.join(map(str, value)), longest)}>"
    if isinstance(value, (list, tuple)):
        text = ", ".join(short_text(item) for item in value)
        text = f"[{text}]" if isinstance(value, list) else f"({text})"
        return text if len(text) <= longest else f"<{len(value)} items>"
    if is_dataclass(value) and not isinstance(value, type):
        text = repr(value)
        return text if len(text) <= longest and "\n" not in text else f"{type(value).__name__}(...)"
    if isinstance(value, (int, float, complex, np.generic)):
        return repr(value)
    return truncate(repr(value), longest)
