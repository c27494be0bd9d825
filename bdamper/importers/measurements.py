"""Measured responses over frequency, and measured resonances over load.

A CSV file of resonances has a header with units and one row per measurement.  The column ``load (N)`` is required, with
``amplitude`` in any unit, ``frequency (Hz)``, or both.  A row with load 0 is the structure without load on its dampers,
which :func:`bdamper.fit` uses as the reference.  Lines that start with ``#`` are comments.

Functions over frequency in universal files are data sets of type 58.

References
----------
Structural Dynamics Research Laboratory, University of Cincinnati, *Universal File Formats*, data set 58.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bdamper.importers.fe_body import data_lines, parsing, reader
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import check, import_extra, mismatch
from bdamper.util.formatting import short_repr
from bdamper.util.records import check_all
from bdamper.util.storage import Storable, existing
from bdamper.util.tables import Column, Hertz, Radians, Tabular

LENGTHS = {
    "m": 1.0, "meter": 1.0, "metre": 1.0, "meters": 1.0, "metres": 1.0, "cm": 1e-2, "mm": 1e-3, "millimeter": 1e-3,
    "millimetre": 1e-3, "um": 1e-6, "micron": 1e-6, "microns": 1e-6, "nm": 1e-9, "in": 0.0254, "inch": 0.0254,
    "mil": 2.54e-5, "mils": 2.54e-5,
}  # fmt: skip
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
FORCES = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "lbf": 4.4482216152605, "kip": 4448.2216152605}
"""Units of force in newtons."""
HERTZ = {"Hz": 1.0, "kHz": 1e3, "rad/s": 0.5 / np.pi}
"""Units of frequency in hertz."""
ANGLES = {"rad": 1.0, "deg": np.pi / 180.0, "°": np.pi / 180.0}
"""Units of phase in radians."""
OTHER_NAMES = {
    "freq": "frequency", "amp": "amplitude", "magnitude": "amplitude", "displacement": "amplitude", "disp": "amplitude",
    "velocity": "amplitude", "vel": "amplitude", "acceleration": "amplitude", "acc": "amplitude", "angle": "phase",
}  # fmt: skip
"""Names of columns that mean another name, unless the file has a column of that name."""
DECIBEL = re.compile(r"dB(?: re\.?)? ?(?:1 ?)?(.+)", re.IGNORECASE)
"""Unit of a level: decibel relative to 1 of a unit."""
FREQUENCY = 18
"""Number of the data type "frequency" in universal files."""


@short_repr
@dataclass(frozen=True)
class Measurement(Plottable, Tabular, Storable, kind="bdamper-measurement"):
    """Measured response over frequency.

    Parameters
    ----------
    name : str
    frequency : (n,) float, Hz
    response : (n,) complex
        Response in ``unit``: displacement, velocity or acceleration.
    node, direction : int
        Measured node, and axis (±1, ±2, ±3 for X, Y, Z).
    unit : str
        Unit in the file; an empty text means metres.
    source : str
        File, for messages.
    force : (n,) float, N, optional
        Amplitude of the measured force at each point.

    Raises
    ------
    ModelError
        If the arrays are empty, differ in length, or contain values that are not finite.

    Notes
    -----
    ``plot`` draws the amplitude in metres as small open circles (:func:`bdamper.plot.plot_measurement`).
    """

    name: str
    frequency: Hertz
    response: NDArray
    node: int = 0
    direction: int = 0
    unit: str = ""
    source: str = ""
    force: NDArray | None = None

    def __post_init__(self) -> None:
        item, n = self.source or self.name, len(self.frequency)
        if np.shape(self.response) != (n,) or n == 0:
            raise mismatch(
                item, "as many responses as frequencies, at least one", np.shape(self.response)
            )
        if self.force is not None:
            check(
                np.shape(self.force) == (n,),
                item,
                "a force for each frequency",
                str(np.shape(self.force)),
            )
            check_all(np.asarray(self.force) > 0.0, np.asarray(self.force), "forces above 0", item)
        for values in (np.asarray(self.frequency), np.asarray(self.response)):
            check_all(np.isfinite(values), values, "finite frequencies and responses", item)

    @property
    def amplitude(self) -> NDArray:
        """Modulus of the response (n,), in ``unit``."""
        return np.abs(self.response)

    @property
    def phase(self) -> Radians:
        """Phase of the response (n,), rad."""
        return np.angle(self.response)

    def columns(self) -> dict[str, Column]:
        """Return the columns of the table, with one row per frequency."""
        return super().columns() | {"amplitude": Column(self.amplitude, self.unit or "m")}

    @property
    def displacement(self) -> NDArray:
        """Complex displacement (n,), m; velocity and acceleration are divided by powers of ``i omega``.

        Raises
        ------
        SettingError
            If the unit is not a known unit of displacement, velocity or acceleration.
        """
        factor, order = motion_unit(f"measurement '{self.name}'", self.unit or "m")
        return np.asarray(
            factor * self.response / (2j * np.pi * np.asarray(self.frequency)) ** order
        )

    def __str__(self) -> str:
        k = int(np.argmax(self.amplitude))
        return (
            f"{self.name}: {len(self.frequency)} points from {self.frequency.min():.6g} to {self.frequency.max():.6g} Hz, "
            f"largest {self.amplitude[k]:.6g} {self.unit} at {self.frequency[k]:.6g} Hz ({self.source})"
        )


def motion_unit(where: str, unit: str) -> tuple[float, int]:
    """Return the factor of a unit to SI, and its order: 0 for displacement, 1 for velocity, 2 for acceleration."""
    kinds = LENGTHS, VELOCITIES, ACCELERATIONS
    order = next((k for k, units in enumerate(kinds) if _plain(unit) in units), None)
    shown = [name for units in kinds for name in units]
    expected = f"a displacement, velocity or acceleration in one of {shown} or a scale to metres (scale=...)"
    if order is None:
        raise validation.invalid(where, expected, f"the unit '{unit}'")
    return kinds[order][_plain(unit)], order


COLUMNS: dict[str, Mapping[str, float] | None] = {
    "load": FORCES,
    "amplitude": None,
    "frequency": HERTZ,
}
"""Columns of measured resonances, with their units."""


@short_repr
@dataclass(frozen=True)
class Measured:
    """Measured resonances over load.

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
    """Read measured resonances over load from a CSV file (see the docstring of the module).

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Measured

    Raises
    ------
    BdamperError
        If a column or its unit is missing, a row is longer than the header, or a value is not a finite number
        of at least 0.  The message names the line.
    """
    load, amplitude, frequency = COLUMNS
    sets = (load, amplitude, frequency), (load, amplitude), (load, frequency)
    found = read_columns(path, *sets, units=COLUMNS, signed=False, blank=(amplitude, frequency))
    values = {name: column for name, (column, _) in found.items()}
    return Measured(
        **{name: values.get(name, np.full(len(values[load]), np.nan)) for name in COLUMNS},
        source=str(path),
    )


def read_columns(
    path: str | PathLike[str] | Mapping[str, Any],
    *sets: tuple[str, ...],
    units: Mapping[str, Mapping[str, float] | None],
    signed: bool = True,
    blank: tuple[str, ...] = (),
    optional: tuple[str, ...] = (),
    columns: Mapping[str, str] | None = None,
) -> dict[str, tuple[NDArray, str]]:
    """Read columns of a text file or table by name, with the unit in brackets after each name in the header.

    Names and units are compared in lower case.  Lines that start with ``#``, empty lines and other columns are ignored.
    Values are separated by semicolons or tabs if the header contains them, otherwise by commas.  A comma in a number is a
    decimal comma.  The text is UTF-8, UTF-16 with a byte order mark, or Latin-1.

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
        If no group is complete, a unit is missing or unknown, or a value is not a finite number.  The message
        names the line.
    """
    path, first, names, lines = _cells(path)
    renamed = {there.strip().lower(): name for name, there in (columns or {}).items()}
    head: dict[str, tuple[int, str]] = {}
    for k, text in enumerate(names):
        if (found := HEADER.fullmatch(text)) and (text not in renamed):
            head.setdefault(
                renamed.get(found[1].lower(), found[1].lower()), (k, (found[2] or "").strip())
            )
        else:
            head.setdefault(renamed[text], (k, ""))
    for name, meaning in OTHER_NAMES.items():
        if name in head:
            head.setdefault(meaning, head[name])
    names = [name.lower() for name in names]
    group = next((each for each in sets if set(each) <= head.keys()), None)
    at = f"{path}, line {first}"
    if group is None:
        raise mismatch(at, f"the columns {'; or '.join(', '.join(each) for each in sets)}", names)
    group = (*group, *(name for name in optional if name in head))
    factors = [check_unit(at, name, head[name][1], units[name]) for name in group]
    rows = []
    for k, row in lines:
        where = f"{path}, line {k}"
        expected = (
            f"{len(names)} values separated by commas, as the header has, with points in numbers"
        )
        check(len(row) <= len(names), where, expected, f"{len(row)}: '{','.join(row)[:60]}'")
        row = row + [""] * (len(names) - len(row))
        rows.append(
            [
                _number(row[head[name][0]].strip(), where, name, signed, name in blank)
                for name in group
            ]
        )
    check(bool(rows), str(path), "rows of numbers after the header", "none")
    return {
        name: (factor * column, head[name][1])
        for name, factor, column in zip(group, factors, np.array(rows).T)
    }


def _cells(path: Any) -> tuple[str, int, list[str], list[tuple[int, list[str]]]]:
    """Return name, number of the header line, header, and numbered rows of texts of a file or table."""
    if hasattr(path, "keys"):
        names = list(path.keys())
        table = [
            (k, [str(value) for value in row])
            for k, row in enumerate(zip(*(path[n] for n in names)), 2)
        ]
        return "table", 1, [str(name).strip() for name in names], table
    check(not existing(path).is_dir(), str(path), "a CSV file", "a folder")
    raw = Path(path).read_bytes()
    encodings = ["utf-16"] if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else ["utf-8-sig", "latin-1"]
    for encoding in encodings:
        try:
            text = raw.decode(encoding)
            break
        except UnicodeDecodeError as error:
            if encoding == encodings[-1]:
                raise mismatch(
                    str(path), "text in UTF-8, UTF-16 or Latin-1", f"another encoding ({error})"
                ) from error
    lines = data_lines(text, "#")
    check(bool(lines), str(path), "a header and rows of numbers", "nothing")
    (first, header), *rest = lines
    mark = next((mark for mark in ";\t" if mark in header), ",")

    def cells(k: int, line: str) -> list[str]:
        try:
            return next(csv.reader([line], delimiter=mark))
        except csv.Error as error:
            expected = (
                f"values separated by '{mark}' of at most {csv.field_size_limit()} characters"
            )
            raise mismatch(f"{path}, line {k}", expected, f"{error}: '{line[:60]}'") from error

    rows = [(k, cells(k, line)) for k, line in rest]
    if mark != ",":
        rows = [(k, [cell.replace(",", ".") for cell in row]) for k, row in rows]
    return str(path), first, [name.strip() for name in cells(first, header)], rows


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
    expected = f"its unit in the header, such as '{column} ({shown[0]})'" + (
        f", one of {shown}" if known else ""
    )
    factors = (
        {_plain(name): factor for name, factor in known.items()}
        if known
        else {_plain(unit): 1.0}
        if unit
        else {}
    )
    check(
        _plain(unit) in factors,
        f"{where}, column '{column}'",
        expected,
        f"the unit '{unit}'" if unit else "no unit",
    )
    return factors[_plain(unit)]


def _plain(unit: str) -> str:
    """Return a unit in lower case, with the letter u for micro."""
    return unit.strip().lower().replace("\u00b5", "u").replace("\u03bc", "u")


def _number(text: str, where: str, column: str, signed: bool, blank: bool) -> float:
    if blank and text.lower() in ("", "nan"):
        return np.nan
    with parsing(
        where, f"a finite number{'' if signed else ' of at least 0'} in column '{column}'", text
    ):
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
    """Read a measured response over frequency from a text file, a pandas frame or a mapping of header to values.

    The header names the columns with their units in brackets: ``frequency (Hz)``, and ``amplitude (mm)`` with or without
    ``phase (deg)``, or ``real (m)`` and ``imag (m)``.  ``displacement``, ``velocity`` and ``acceleration`` are other names
    of the amplitude; its unit determines which of these it is, and ``dB re 1 mm/s`` is a level.  A column ``force (N)``
    contains the force at each point.  Rows with an empty value, other columns and lines that start with ``#`` are ignored.
    Separators, decimal commas and encodings are detected.  Files of ``curve.to_csv`` can be read.

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
        Motion to which the phase belongs: the motion in the amplitude column, or the displacement.  "none" ignores phases.

    Returns
    -------
    Measurement
        ``measurement.plot(ax=...)`` adds it to a plot of response curves.

    Raises
    ------
    BdamperError
        If a column or its unit is missing, or a value is not a finite number.  The message names the line.
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
    sets: Any = (
        ("frequency", "real", "imag"),
        ("frequency", "amplitude", "phase"),
        ("frequency", "amplitude"),
    )
    sets = sets if by is None else tuple((*each, by) for each in sets)
    sizes = dict.fromkeys(
        ("amplitude", "real", "imag"), None if unit is None else dict.fromkeys(("", unit), 1.0)
    )
    units: dict[str, Any] = {"frequency": HERTZ, "phase": ANGLES, "force": FORCES, **sizes}
    units |= {} if by is None else {by: {"": 1.0, "-": 1.0}}
    every = tuple(units)
    found = read_columns(
        path, *sets, units=units, blank=every, optional=("force",), columns=columns
    )
    table = {column: values for column, (values, _) in found.items()}
    source = "table" if hasattr(path, "keys") else str(path)
    whole = np.isfinite(np.array(list(table.values()))).all(axis=0)
    check(
        bool(whole.any()), source, "rows of numbers after the header", "none without an empty value"
    )
    table = {column: values[whole] for column, values in table.items()}
    stated = found["real" if "imag" in found else "amplitude"][1]
    if "imag" in found:
        other = found["imag"][1]
        check(
            other == stated, source, "real and imag in the same unit", f"'{stated}' and '{other}'"
        )
        response: NDArray = table["real"] + 1j * table["imag"]
    else:
        level = DECIBEL.fullmatch(stated if unit is None else unit)
        size = 10.0 ** (table["amplitude"] / 20.0) if level else table["amplitude"]
        response = size * np.exp(1j * table.get("phase", 0.0))
        stated, unit = (level[1].strip(), None) if level else (stated, unit)
    stated = stated if unit is None else unit
    validation.choice("phase_of", phase_of, ("response", "displacement", "none"))
    if phase_of == "none":
        response = np.abs(response) + 0j
    if phase_of == "displacement":
        response = response * 1j ** motion_unit(source, stated or "m")[1]
    title = name or Path(source).stem
    force = table.get("force")
    if by is None:
        return (
            Measurement(
                title, table["frequency"], response, unit=stated, source=source, force=force
            ),
        )
    parts = [(value, table[by] == value) for value in np.unique(table[by])]
    return tuple(
        Measurement(
            f"{title}, {by} {value:g}", table["frequency"][rows], response[rows], unit=stated, source=source,
            force=None if force is None else force[rows],
        )
        for value, rows in parts
    )  # fmt: skip


@reader("a universal file", library=True)
def read_measurements(path: Path) -> tuple[Measurement, ...]:
    """Read the functions over frequency (data set 58) of a universal file (UNV, UFF).

    The package pyuff (extra ``bdamper[unv]``) is needed.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    tuple of Measurement
        One for each function over frequency.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has no function over frequency.
    """
    file = import_extra("pyuff", "reading a universal file", "unv").UFF(str(path))
    out: list[Measurement] = []
    for k in np.flatnonzero(np.atleast_1d(file.get_set_types()) == 58):
        data = file.read_sets(int(k))
        if int(data.get("abscissa_spec_data_type", FREQUENCY)) != FREQUENCY:
            continue
        name = str(data.get("id1", "")).strip() or f"function {len(out) + 1}"
        frequency, response = np.asarray(data["x"], float), np.asarray(data["data"]).astype(complex)
        node, direction = (int(data.get(key, 0)) for key in ("rsp_node", "rsp_dir"))
        unit = str(data.get("ordinate_axis_units_lab", "")).strip().replace("NONE", "")
        out.append(Measurement(name, frequency, response, node, direction, unit, str(path)))
    check(bool(out), str(path), "functions over frequency (data set 58)", "none")
    return tuple(out)
