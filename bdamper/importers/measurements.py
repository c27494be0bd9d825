"""Measured frequency responses, and measured resonances at several loads.

A CSV file of resonances has a header with units and one row per measurement.  The column ``load
(N)`` is required, with ``amplitude`` in any unit, ``frequency (Hz)``, or both.  A row with load 0
describes the structure without load on its dampers, which :func:`bdamper.fit` uses as the
reference.  Lines that start with ``#`` are comments.

Frequency response functions in universal files are data sets of type 58.

References
----------
Structural Dynamics Research Laboratory, University of Cincinnati, *Universal File Formats*, data
set 58.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bdamper.importers.fe_body import data_lines, parsing, reader
from bdamper.util import quantities, validation
from bdamper.util.display import Plottable
from bdamper.util.errors import check, check_sentence, import_extra, mismatch, warn
from bdamper.util.formatting import amount, counted, short_repr, span
from bdamper.util.records import check_all
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import Storable, existing
from bdamper.util.tables import Column, Hertz, Radians, Tabular

LENGTHS = {
    "m": 1.0,
    "meter": 1.0,
    "metre": 1.0,
    "meters": 1.0,
    "metres": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "millimeter": 1e-3,
    "millimetre": 1e-3,
    "um": 1e-6,
    "micron": 1e-6,
    "microns": 1e-6,
    "nm": 1e-9,
    "in": 0.0254,
    "inch": 0.0254,
    "mil": 2.54e-5,
    "mils": 2.54e-5,
}
"""Units of length in metres."""
VELOCITIES = {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6, "in/s": 0.0254}
"""Units of velocity in metres per second."""
ACCELERATIONS = {
    "m/s^2": 1.0,
    "m/s2": 1.0,
    "m/s²": 1.0,
    "mm/s^2": 1e-3,
    "mm/s2": 1e-3,
    "g": 9.80665,
    "in/s^2": 0.0254,
}
"""Units of acceleration in metres per second squared."""
STRAINS = {
    "m/m": 1.0,
    "strain": 1.0,
    "mm/m": 1e-3,
    "um/m": 1e-6,
    "microstrain": 1e-6,
    "ustrain": 1e-6,
    "ue": 1e-6,
    "u\u03b5": 1e-6,
    "1e-6": 1e-6,
}
"""Units of strain in metres per metre."""
FORCES = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "lbf": 4.4482216152605, "kip": 4448.2216152605}
"""Units of force in newtons."""
HERTZ = {"Hz": 1.0, "kHz": 1e3, "rad/s": 0.5 / np.pi}
"""Units of frequency in hertz."""
ANGLES = {"rad": 1.0, "deg": np.pi / 180.0, "°": np.pi / 180.0}
"""Units of phase in radians."""
OTHER_NAMES = {
    "freq": "frequency",
    "amp": "amplitude",
    "magnitude": "amplitude",
    "displacement": "amplitude",
    "disp": "amplitude",
    "velocity": "amplitude",
    "vel": "amplitude",
    "acceleration": "amplitude",
    "acc": "amplitude",
    "strain": "amplitude",
    "angle": "phase",
}
"""Names of columns that mean another name, unless the file has a column of that name."""
DECIBEL = re.compile(r"dB(?: re\.?)? ?(?:1 ?)?(.+)", re.IGNORECASE)
"""Unit of a level: decibel relative to 1 of a unit."""
EXCITATIONS = ("force", "base acceleration")
"""Optional columns of a response, with the excitation at each point."""
FREQUENCY = 18
_LINEAR_FUNCTIONS = {
    0: "",
    4: "frequency response function",
    5: "transmissibility",
    12: "spectrum",
}
"""Functions of data set 58 whose values are motions, or motions per excitation."""
_OTHER_FUNCTIONS = {
    1: "record over time",
    2: "auto-spectrum",
    3: "cross-spectrum",
    6: "coherence",
    7: "autocorrelation",
    8: "cross-correlation",
    9: "power spectral density",
    10: "energy spectral density",
}
"""Functions of data set 58 with squared quantities or without a frequency."""
"""Number of the data type "frequency" in universal files."""


@short_repr
@dataclass(frozen=True)
class Measurement(Plottable, Tabular, Storable, kind="bdamper-measurement"):
    """Measured frequency response.

    Parameters
    ----------
    name : str
    frequency : (n,) float, Hz
    response : (n,) complex
        Response in ``unit``: displacement, velocity, acceleration or strain.
    node, direction : int
        Measured node, and axis (±1, ±2, ±3 for X, Y, Z).
    unit : str
        Unit in the file; an empty text means metres.
    source : str
        File, for messages.
    force : (n,) float, N, optional
        Amplitude of the measured force at each point.
    base_acceleration : (n,) float, m/s2, optional
        Amplitude of the measured acceleration of the base at each point, instead of a force.

    Raises
    ------
    ModelError
        If the arrays are empty, differ in length, or contain values that are not finite.

    Notes
    -----
    ``plot`` draws the amplitude in metres as small open circles
    (:func:`bdamper.plot.plot_measurement`).
    """

    name: str
    frequency: Hertz
    response: NDArray
    node: int = 0
    direction: int = 0
    unit: str = ""
    source: str = ""
    force: NDArray | None = None
    base_acceleration: NDArray | None = None

    def __post_init__(self) -> None:
        item = self.source or self.name
        units = {"frequency": "Hz", "response": "", "force": "N", "base_acceleration": "m/s2"}
        for field, unit in units.items():
            validation.check_attributes(self, quantities.in_lists, field, unit=unit)
        n_points = len(self.frequency)
        frequency, response = np.asarray(self.frequency), np.asarray(self.response)
        if response.shape != (n_points,) or n_points == 0:
            expected = "as many responses as frequencies, at least one"
            raise mismatch(item, expected, response.shape)
        one = self.force is None or self.base_acceleration is None
        check_sentence(one, item, "give either force or base_acceleration, not both")
        if self.excitation is not None:
            excitation = np.asarray(self.excitation)
            complete = excitation.shape == (n_points,)
            what = "force" if self.base_acceleration is None else "acceleration of the base"
            check(complete, item, f"a {what} for each frequency", str(excitation.shape))
            check_all(excitation > 0.0, excitation, f"values of the {what} above 0", item)
        for values in (frequency, response):
            check_all(np.isfinite(values), values, "finite frequencies and responses", item)

    @property
    def excitation(self) -> NDArray | None:
        """Amplitude of the measured force (N) or base acceleration (m/s2) at each point; None if neither was measured."""
        return self.force if self.base_acceleration is None else self.base_acceleration

    @property
    def amplitude(self) -> NDArray:
        """Modulus of the response (n,), in ``unit``."""
        return np.abs(self.response)

    @property
    def is_strain(self) -> bool:
        """Whether the response is a strain."""
        return _plain(self.unit) in STRAINS

    @property
    def phase(self) -> Radians:
        """Phase of the response (n,), rad."""
        return np.angle(self.response)

    def columns(self) -> dict[str, Column]:
        """Return the columns of the table, with one row per frequency."""
        return super().columns() | {"amplitude": Column(self.amplitude, self.unit or "m")}

    @property
    def displacement(self) -> NDArray:
        """Complex displacement (n,), m, or strain, m/m; velocity and acceleration are divided by
        powers of ``i omega``.

        Raises
        ------
        SettingError
            If the unit is not a known unit of displacement, velocity, acceleration or strain.
        """
        if self.is_strain:
            return np.asarray(STRAINS[_plain(self.unit)] * self.response)
        factor, order = motion_unit(f"measurement '{self.name}'", self.unit or "m")
        derivative = (2j * np.pi * np.asarray(self.frequency)) ** order
        return np.asarray(factor * self.response / derivative)

    def _statement(self) -> Statement:
        top = int(np.argmax(self.amplitude))
        largest = f"{self.amplitude[top]:.6g} {self.unit}".rstrip()
        verdict = f"Largest value {largest} at {amount(self.frequency[top], 'Hz')}: {self.name}"
        band = span(self.frequency.min(), self.frequency.max(), "Hz")
        rows = [Row("Frequency", band, counted(len(self.frequency), "point"))]
        if self.source:
            rows.append(Row("Source", "", self.source))
        return Statement([verdict], rows)


def motion_unit(where: str, unit: str) -> tuple[float, int]:
    """Return the factor that converts a unit to SI, and the number of time derivatives.

    The number is 0 for displacement, 1 for velocity, 2 for acceleration.
    """
    kinds = (LENGTHS, VELOCITIES, ACCELERATIONS)
    for order, units in enumerate(kinds):
        if _plain(unit) in units:
            return units[_plain(unit)], order
    if _plain(unit) in STRAINS:
        expected = (
            "a displacement, velocity or acceleration, because the derivatives of a strain are "
            "not available"
        )
        raise validation.invalid(where, expected, f"the unit '{unit}'")
    known = [name for units in (*kinds, STRAINS) for name in units]
    expected = (
        f"a displacement, velocity, acceleration or strain in one of {known} "
        "or a scale to metres (scale=...)"
    )
    raise validation.invalid(where, expected, f"the unit '{unit}'")


COLUMNS: dict[str, Mapping[str, float] | None] = {
    "load": FORCES,
    "amplitude": None,
    "frequency": HERTZ,
}
"""Columns of measured resonances, with their units."""


@short_repr
@dataclass(frozen=True)
class Measured:
    """Measured resonances at several loads.

    Parameters
    ----------
    load : (n,) float
        Load on the damper, N.
    amplitude, frequency : (n,) float
        Amplitude in the unit of the file and frequency in Hz, NaN if not measured.
    source : str
        File, for messages.
    """

    load: NDArray
    amplitude: NDArray
    frequency: NDArray
    source: str = ""


@validation.check_arguments
def load_measured(path: str | PathLike[str]) -> Measured:
    """Read measured resonances at several loads from a CSV file (see the docstring of the module).

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Measured

    Raises
    ------
    BdamperError
        If a column or its unit is missing, a row is longer than the header, or a value is not a
        finite number of at least 0.  The message gives the line.
    """
    sets = (("load", "amplitude", "frequency"), ("load", "amplitude"), ("load", "frequency"))
    may_be_blank = ("amplitude", "frequency")
    columns = read_columns(path, *sets, units=COLUMNS, signed=False, blank=may_be_blank)
    load, _ = columns["load"]
    not_measured = (np.full(len(load), np.nan), "")
    amplitude, _ = columns.get("amplitude", not_measured)
    frequency, _ = columns.get("frequency", not_measured)
    return Measured(load, amplitude, frequency, source=str(path))


def read_columns(
    path: str | PathLike[str] | Mapping[str, Any],
    *sets: tuple[str, ...],
    units: Mapping[str, Mapping[str, float] | None],
    signed: bool = True,
    blank: tuple[str, ...] = (),
    optional: tuple[str, ...] = (),
    columns: Mapping[str, str] | None = None,
) -> dict[str, tuple[NDArray, str]]:
    """Read columns of a text file or table by name, with the unit in brackets after each name in
    the header.

    Names and units are compared in lower case.  Lines that start with ``#``, empty lines and other
    columns are ignored.  Values are separated by semicolons or tabs if the header contains them,
    otherwise by commas.  A comma in a number is a decimal comma.  The text is UTF-8, UTF-16 with a
    byte order mark, or Latin-1.

    Parameters
    ----------
    path : path-like, or mapping of header to values
        A pandas frame is also such a mapping.
    *sets : tuple of str
        Alternative groups of columns.  The first group that the file contains completely is read.
    units : mapping of name to mapping of unit to factor, or None
        Factors for the values of a column.  None accepts any unit and leaves the values unchanged.
    signed : bool
        Whether negative numbers are permitted.
    blank : tuple of str
        Columns in which a value may be missing; it becomes NaN.
    optional : tuple of str
        Columns that are read if the file has them.
    columns : mapping of name to name in the file, optional
        Names of columns in the file, without unit, if they differ from the names above.

    Returns
    -------
    dict of name to (values (n,), unit)

    Raises
    ------
    BdamperError
        If no group is complete, a unit is missing or unknown, or a value is not a finite number.
        The message gives the line.
    """
    cells = _cells(path)
    where = f"{cells.source}, line {cells.header_line}"
    head = _head(cells.header, columns or {})
    names = [name.lower() for name in cells.header]
    group = next((names_of_set for names_of_set in sets if head.keys() >= set(names_of_set)), None)
    if group is None:
        listed = "; or ".join(", ".join(names_of_set) for names_of_set in sets)
        raise mismatch(where, f"the columns {listed}", names)
    wanted = [*group, *(name for name in optional if name in head)]
    factors = [check_unit(where, name, head[name].unit, units[name]) for name in wanted]
    rows = []
    for line, texts in cells.rows:
        where = f"{cells.source}, line {line}"
        expected = (
            f"{len(names)} values separated by commas, as the header has, with points in numbers"
        )
        found = f"{len(texts)}: '{','.join(texts)[:60]}'"
        check(len(texts) <= len(names), where, expected, found)
        padded = texts + [""] * (len(names) - len(texts))
        row = []
        for name in wanted:
            text = padded[head[name].index].strip()
            row.append(_number(text, where, name, signed, name in blank))
        rows.append(row)
    check(bool(rows), cells.source, "rows of numbers after the header", "none")
    found_columns = {}
    for name, factor, values in zip(wanted, factors, np.array(rows).T):
        found_columns[name] = (factor * values, head[name].unit)
    return found_columns


@dataclass(frozen=True)
class _Head:
    """Index of a column, and its unit in the header."""

    index: int
    unit: str


def _head(header: list[str], columns: Mapping[str, str]) -> dict[str, _Head]:
    """Return the columns of a header by name; the first of equal names counts.

    Parameters
    ----------
    header : list of str
    columns : mapping of name to name in the file
        Names of the caller for columns with other names.
    """
    name_of = {in_file.strip().lower(): name for name, in_file in columns.items()}
    head: dict[str, _Head] = {}
    for index, text in enumerate(header):
        parts = HEADER.fullmatch(text)
        if parts is None or text in name_of:
            # the caller wrote this name with its unit
            head.setdefault(name_of[text], _Head(index, ""))
            continue
        name = parts[1].lower()
        unit = (parts[2] or "").strip()
        head.setdefault(name_of.get(name, name), _Head(index, unit))
    for name, meaning in OTHER_NAMES.items():
        if name in head:
            head.setdefault(meaning, head[name])
    return head


@dataclass(frozen=True)
class _Cells:
    """Texts of a file or table.

    Parameters
    ----------
    source : str
        Name of the file in messages.
    header_line : int
        Number of the line with the names.
    header : list of str
        Names of the columns, with their units.
    rows : list of (number of the line, list of str)
    """

    source: str
    header_line: int
    header: list[str]
    rows: list[tuple[int, list[str]]]


def _cells(path: Any) -> _Cells:
    """Return the texts of a CSV file, or of a mapping of header to values."""
    if hasattr(path, "keys"):
        names = list(path.keys())
        lengths = [len(path[name]) for name in names]
        check(len(set(lengths)) <= 1, "table", "columns of equal length", f"{lengths} values")
        # the header is line 1
        numbered = enumerate(zip(*(path[name] for name in names)), 2)
        rows = [(line, [str(value) for value in values]) for line, values in numbered]
        return _Cells("table", 1, [str(name).strip() for name in names], rows)
    check(not existing(path).is_dir(), str(path), "a CSV file", "a folder")
    lines = data_lines(_decoded(path), "#")
    check(bool(lines), str(path), "a header and rows of numbers", "an empty file")
    (header_line, header), *rest = lines
    separator = ","
    if "\t" in header:
        separator = "\t"
    if ";" in header:
        separator = ";"

    def split(number: int, line: str) -> list[str]:
        try:
            return next(csv.reader([line], delimiter=separator))
        except csv.Error as error:
            limit = csv.field_size_limit()
            expected = f"values separated by '{separator}' of at most {limit} characters"
            found = f"{error}: '{line[:60]}'"
            raise mismatch(f"{path}, line {number}", expected, found) from error

    rows = []
    for number, line in rest:
        cells = split(number, line)
        if separator != ",":
            cells = [cell.replace(",", ".") for cell in cells]
        rows.append((number, cells))
    names = [name.strip() for name in split(header_line, header)]
    return _Cells(str(path), header_line, names, rows)


def _decoded(path: Any) -> str:
    """Return the text of a file in UTF-16 with a byte order mark, UTF-8 or Latin-1."""
    raw = Path(path).read_bytes()
    encodings = ["utf-16"] if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else ["utf-8-sig", "latin-1"]
    for encoding in encodings[:-1]:
        try:
            return raw.decode(encoding)
        except UnicodeDecodeError:
            continue
    try:
        return raw.decode(encodings[-1])
    except UnicodeDecodeError as error:
        expected = "text in UTF-8, UTF-16 or Latin-1"
        raise mismatch(str(path), expected, f"a different encoding ({error})") from error


HEADER = re.compile(r"(.*?)\s*(?:[(\[](.*)[)\]])?")
"""Name of a column, and its unit in brackets."""


def check_unit(where: str, column: str, unit: str, known: Mapping[str, float] | None) -> float:
    """Return the factor of the unit of a column.

    Parameters
    ----------
    where : str
        File and line, for the message.
    column, unit : str
    known : mapping of unit to factor, optional
        Permitted units.  None accepts any unit, with the factor 1.

    Raises
    ------
    ModelError
        If the unit is missing or unknown.
    """
    shown = [name for name in known or LENGTHS if name]
    expected = f"its unit in the header, such as '{column} ({shown[0]})'"
    if known:
        expected += f", one of {shown}"
        factors = {_plain(name): factor for name, factor in known.items()}
    else:
        factors = {_plain(unit): 1.0} if unit else {}
    found = f"the unit '{unit}'" if unit else "no unit"
    check(_plain(unit) in factors, f"{where}, column '{column}'", expected, found)
    return factors[_plain(unit)]


def _plain(unit: str) -> str:
    """Return a unit in lower case, with the letter u for micro."""
    return unit.strip().lower().replace("\u00b5", "u").replace("\u03bc", "u")


def _number(text: str, where: str, column: str, signed: bool, blank: bool) -> float:
    """Return a finite number, or NaN for a blank text if ``blank`` permits it."""
    if blank and text.lower() in ("", "nan"):
        return np.nan
    limit = "" if signed else " of at least 0"
    with parsing(where, f"a finite number{limit} in column '{column}'", text):
        value = float(text)
        if not np.isfinite(value) or (value < 0.0 and not signed):
            raise ValueError
    return value


@validation.check_arguments
def read_response(
    path: str | PathLike[str] | Mapping[str, Any],
    *,
    unit: str | None = None,
    name: str | None = None,
    columns: Mapping[str, str] | None = None,
    phase_of: Literal["response", "displacement", "none"] = "response",
) -> Measurement:
    """Read a measured frequency response from a text file, a pandas frame or a mapping of header to
    values.

    The header names the columns with their units in brackets: ``frequency (Hz)``, and ``amplitude
    (mm)`` with or without ``phase (deg)``, or ``real (m)`` and ``imag (m)``. ``displacement``,
    ``velocity``, ``acceleration`` and ``strain`` are other names of the amplitude; its unit
    determines which of these it is, and ``dB re 1 mm/s`` is a level. A column ``force (N)``
    contains the force at each point, a column ``base acceleration (g)`` the acceleration of a
    shaken base. Rows with an empty value, other columns and lines that start with ``#`` are
    ignored. Separators, decimal commas and encodings are detected. Files of ``curve.to_csv`` can be
    read.

    Parameters
    ----------
    path : path-like, or mapping of header to values
    unit : str, optional
        Unit of the amplitude, which replaces the unit in the header.
    name : str, optional
        Name in legends; by default the name of the file.
    columns : mapping of name to name in the file, optional
        Columns with other names: ``{"amplitude": "Acc 3"}``.
    phase_of : {"response", "displacement", "none"}
        Motion to which the phase belongs: the motion in the amplitude column, or the displacement.
        "none" ignores phases.

    Returns
    -------
    Measurement
        ``measurement.plot(ax=...)`` adds it to a plot of response curves.

    Raises
    ------
    BdamperError
        If a column or its unit is missing, or a value is not a finite number.  The message gives
        the line.
    """
    return _responses(path, unit, name, columns, phase_of, None)[0]


@validation.check_arguments
def read_responses(
    path: str | PathLike[str] | Mapping[str, Any],
    by: str,
    *,
    unit: str | None = None,
    columns: Mapping[str, str] | None = None,
    phase_of: Literal["response", "displacement", "none"] = "response",
) -> tuple[Measurement, ...]:
    """Read several responses from one file, separated by the numbers in a column.

    Parameters
    ----------
    path, unit, columns, phase_of
        See :func:`read_response`.
    by : str
        Column with the number of the test.

    Returns
    -------
    tuple of Measurement
        One for each number in the column, in ascending order.

    Raises
    ------
    BdamperError
        See :func:`read_response`.
    """
    return _responses(path, unit, None, columns, phase_of, by.strip().lower())


def _responses(
    path: Any,
    unit: str | None,
    name: str | None,
    columns: Mapping[str, str] | None,
    phase_of: str,
    by: str | None,
) -> tuple[Measurement, ...]:
    """Return one measurement, or one for each number in the column ``by``."""
    sets: list[tuple[str, ...]] = [
        ("frequency", "real", "imag"),
        ("frequency", "amplitude", "phase"),
        ("frequency", "amplitude"),
    ]
    # the unit of the caller replaces the unit in the header, which may be missing
    sizes = None if unit is None else {"": 1.0, unit: 1.0}
    units: dict[str, Mapping[str, float] | None] = {
        "frequency": HERTZ,
        "phase": ANGLES,
        "force": FORCES,
        "base acceleration": ACCELERATIONS,
        "amplitude": sizes,
        "real": sizes,
        "imag": sizes,
    }
    if by is not None:
        sets = [(*names, by) for names in sets]
        units[by] = {"": 1.0, "-": 1.0}
    every = tuple(units)
    found = read_columns(
        path, *sets, units=units, blank=every, optional=EXCITATIONS, columns=columns
    )
    source = "table" if hasattr(path, "keys") else str(path)
    table = {name: values for name, (values, _) in found.items()}
    unit_of = {name: unit_in_header for name, (_, unit_in_header) in found.items()}
    complete = np.isfinite(np.array(list(table.values()))).all(axis=0)
    incomplete = "no row after the header is complete: each has an empty cell"
    check_sentence(bool(complete.any()), source, incomplete)
    table = {name: values[complete] for name, values in table.items()}
    if "imag" in found:
        response, stated = _from_parts(table, unit_of["real"], unit_of["imag"], unit, source)
    else:
        response, stated = _from_size(table, unit_of["amplitude"], unit)
    validation.choice("phase_of", phase_of, ("response", "displacement", "none"))
    if phase_of == "none":
        response = np.abs(response) + 0j
    if phase_of == "displacement" and _plain(stated) not in STRAINS:
        # the response is the displacement derived order times, each derivative turns it by 90 degrees
        _, order = motion_unit(source, stated or "m")
        response = response * 1j**order
    title = name or Path(source).stem
    frequency = table["frequency"]
    force, base = (table.get(name) for name in EXCITATIONS)
    whole = Measurement(
        title, frequency, response, unit=stated, source=source, force=force, base_acceleration=base
    )
    if by is None:
        return (whole,)
    measurements = []
    for value in np.unique(table[by]):
        rows = table[by] == value
        measurements.append(
            replace(
                whole,
                name=f"{title}, {by} {value:g}",
                frequency=frequency[rows],
                response=response[rows],
                force=None if force is None else force[rows],
                base_acceleration=None if base is None else base[rows],
            )
        )
    return tuple(measurements)


def _from_parts(
    table: Mapping[str, NDArray], real_unit: str, imag_unit: str, unit: str | None, source: str
) -> tuple[NDArray, str]:
    """Return response and unit from real and imaginary part."""
    found = f"'{real_unit}' and '{imag_unit}'"
    check(imag_unit == real_unit, source, "real and imag in the same unit", found)
    return table["real"] + 1j * table["imag"], real_unit if unit is None else unit


def _from_size(table: Mapping[str, NDArray], stated: str, unit: str | None) -> tuple[NDArray, str]:
    """Return response and unit from amplitude, or level in decibel, and phase if there is one."""
    size = table["amplitude"]
    amplitude_unit = stated if unit is None else unit
    level = DECIBEL.fullmatch(amplitude_unit)
    if level:
        size = 10.0 ** (size / 20.0)
        amplitude_unit = level[1].strip()
    return size * np.exp(1j * table.get("phase", 0.0)), amplitude_unit


@reader("a universal file", library=True)
def read_measurements(path: Path) -> tuple[Measurement, ...]:
    """Read the frequency response functions (data set 58) of a universal file (UNV, UFF).

    Transmissibilities and spectra are also read, with the type in their name.  Squared quantities such as
    auto-spectra, coherences, and records over time are not responses: a warning names them, or an
    error if the file has nothing else.  The package pyuff (extra ``bdamper[unv]``) is needed.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    tuple of Measurement
        One for each frequency response function.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has no frequency response function.
    """
    others: Counter[str] = Counter()
    file = import_extra("pyuff", "reading a universal file", "unv").UFF(str(path))
    measurements: list[Measurement] = []
    for k in np.flatnonzero(np.atleast_1d(file.get_set_types()) == 58):
        data = file.read_sets(int(k))
        function = int(data.get("func_type", 4))
        over_frequency = int(data.get("abscissa_spec_data_type", FREQUENCY)) == FREQUENCY
        if function not in _LINEAR_FUNCTIONS or not over_frequency:
            unknown = f"function of type {function}, not over frequency"
            others[_OTHER_FUNCTIONS.get(function, unknown)] += 1
            continue
        name = str(data.get("id1", "")).strip() or f"function {len(measurements) + 1}"
        if function in (5, 12):
            name = f"{name} ({_LINEAR_FUNCTIONS[function]})"
        unit = str(data.get("ordinate_axis_units_lab", "")).strip().replace("NONE", "")
        measurements.append(
            Measurement(
                name,
                np.asarray(data["x"], float),
                np.asarray(data["data"]).astype(complex),
                node=int(data.get("rsp_node", 0)),
                direction=int(data.get("rsp_dir", 0)),
                unit=unit,
                source=str(path),
            )
        )
    found = ", ".join(f"{name} ({count})" for name, count in others.items()) or "none"
    if _OTHER_FUNCTIONS[1] in others:
        found += "; read_ring_down reads the decay of a mode from a table over time"
    check(bool(measurements), str(path), "frequency response functions (data set 58)", found)
    if others:
        warn(f"{path}: only its responses are read, found also {found}")
    return tuple(measurements)
