"""Measured responses over frequency, and measured resonances over load.

A CSV file of resonances has a header with units and one row for each measurement.  The column ``load (N)`` is required;
``amplitude`` in any unit and ``frequency (Hz)`` may be given both or one of them.  A row with load 0 is the structure
without load on its dampers, the reference of a fit (:func:`bdamper.fit`).  Lines that start with ``#`` are comments.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bdamper.importers.fe_body import data_lines, parsing
from bdamper.model.fields import check, check_all
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import mismatch
from bdamper.util.formatting import short_repr
from bdamper.util.storage import Storable
from bdamper.util.tables import Column, Hertz, Radians, Tabular

LENGTHS = {
    "m": 1.0, "meter": 1.0, "metre": 1.0, "meters": 1.0, "metres": 1.0, "cm": 1e-2, "mm": 1e-3, "millimeter": 1e-3,
    "millimetre": 1e-3, "um": 1e-6, "micron": 1e-6, "microns": 1e-6, "nm": 1e-9, "in": 0.0254, "inch": 0.0254,
    "mil": 2.54e-5, "mils": 2.54e-5,
}  # fmt: skip
"""Units of length in metres."""
FORCES = {"N": 1.0, "kN": 1e3}
"""Units of force in newtons."""
HERTZ = {"Hz": 1.0, "kHz": 1e3}
"""Units of frequency in hertz."""
ANGLES = {"rad": 1.0, "deg": np.pi / 180.0, "°": np.pi / 180.0}
"""Units of phase in radians."""


@short_repr
@dataclass(frozen=True)
class Measurement(Plottable, Tabular, Storable, kind="bdamper-measurement"):
    """Measured response over frequency.

    ``plot`` draws the amplitude in metres as small open circles (:func:`bdamper.plot.plot_measurement`).

    Parameters
    ----------
    name : str
    frequency : (n,) float, Hz
    response : (n,) complex
        In the unit of the file; ``amplitude`` is its modulus.
    node, direction : int
        Where and along which axis (±1, ±2, ±3 for X, Y, Z).
    unit : str
        As the file has it; empty counts as metres.
    source : str
    """

    name: str
    frequency: Hertz
    response: NDArray
    node: int = 0
    direction: int = 0
    unit: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        item, n = self.source or self.name, len(self.frequency)
        if np.shape(self.response) != (n,) or n == 0:
            raise mismatch(item, "as many responses as frequencies, at least one", np.shape(self.response))
        for values in (np.asarray(self.frequency), np.asarray(self.response)):
            check_all(np.isfinite(values), values, "finite frequencies and responses", item)

    @property
    def amplitude(self) -> NDArray:
        """(n,) float."""
        return np.abs(self.response)

    @property
    def phase(self) -> Radians:
        """(n,) float."""
        return np.angle(self.response)

    def columns(self) -> dict[str, Column]:
        """A row for each frequency."""
        return super().columns() | {"amplitude": Column(self.amplitude, self.unit or "m")}

    @property
    def metres(self) -> float:
        """Length of the unit in metres.

        Raises
        ------
        SettingError
            If it is not a unit of length that is known.
        """
        unit = _plain(self.unit) or "m"
        expected = f"displacements in one of {tuple(LENGTHS)} or a scale to metres (scale=...)"
        validation.check(unit in LENGTHS, f"measurement '{self.name}'", expected, f"the unit '{self.unit}'")
        return LENGTHS[unit]

    def __str__(self) -> str:
        k = int(np.argmax(self.amplitude))
        return (
            f"{self.name}: {len(self.frequency)} points from {self.frequency.min():.6g} to {self.frequency.max():.6g} Hz, "
            f"largest {self.amplitude[k]:.6g} {self.unit} at {self.frequency[k]:.6g} Hz ({self.source})"
        )


COLUMNS: dict[str, Mapping[str, float] | None] = {"load": FORCES, "amplitude": None, "frequency": HERTZ}
"""Columns of resonances, with their units."""


@short_repr
@dataclass(frozen=True)
class Measured:
    """Measured resonances.

    Parameters
    ----------
    load : (n,) float
    amplitude, frequency : (n,) float
        NaN where not measured.
    source : str
    """

    load: NDArray
    amplitude: NDArray
    frequency: NDArray
    source: str = ""


def load_measured(path: str | PathLike[str]) -> Measured:
    """Read measured points from a CSV file (see this module's docstring).

    Raises
    ------
    BdamperError
        If a column or its unit is missing, a row is longer than the header, or a value is not a finite number of at
        least 0; the message names the line.
    """
    load, amplitude, frequency = COLUMNS
    sets = (load, amplitude, frequency), (load, amplitude), (load, frequency)
    found = read_columns(path, *sets, units=COLUMNS, signed=False, blank=(amplitude, frequency))
    values = {name: column for name, (column, _) in found.items()}
    return Measured(**{name: values.get(name, np.full(len(values[load]), np.nan)) for name in COLUMNS}, source=str(path))


def read_columns(
    path: str | PathLike[str],
    *sets: tuple[str, ...],
    units: Mapping[str, Mapping[str, float] | None],
    signed: bool = True,
    blank: tuple[str, ...] = (),
) -> dict[str, tuple[NDArray, str]]:
    """Read columns of a CSV file by name, with the unit in brackets after each name in the header.

    Names and units are read in lower case.  Lines that start with ``#``, empty lines and other columns are ignored.

    Parameters
    ----------
    path : path-like
    *sets : tuple of str
        Names of columns that belong together; the first set that the file contains is read.
    units : mapping of name to mapping of unit to factor, or None
        Factors by which the values of a column are multiplied.  None: any unit, and the values are not changed.
    signed : bool
        Whether numbers below 0 are allowed.
    blank : tuple of str
        Columns in which a value may be missing; it is NaN then.

    Returns
    -------
    dict of name to (values, unit)

    Raises
    ------
    BdamperError
        If no set is complete, a column has no unit or an unknown one, or a value is not a finite number; the message
        names the line.
    """
    check(not Path(path).is_dir(), str(path), "a CSV file", "a folder")
    try:
        lines = data_lines(Path(path).read_text(encoding="utf-8-sig"), "#")
    except UnicodeDecodeError as error:
        raise mismatch(str(path), "text in UTF-8", f"another encoding ({error})") from error
    check(bool(lines), str(path), "a header and rows of numbers", "nothing")
    (first, header), *lines = lines
    names = [name.strip().lower() for name in next(csv.reader([header]))]
    head: dict[str, tuple[int, str]] = {}
    for k, text in enumerate(names):
        if found := HEADER.fullmatch(text):
            head.setdefault(found[1], (k, (found[2] or "").strip()))
    there = next((each for each in sets if set(each) <= head.keys()), None)
    at = f"{path}, line {first}"
    if there is None:
        raise mismatch(at, f"the columns {'; or '.join(', '.join(each) for each in sets)}", names)
    factors = [check_unit(at, name, head[name][1], units[name]) for name in there]
    rows = []
    for k, line in lines:
        where, row = f"{path}, line {k}", next(csv.reader([line]))
        expected = f"{len(names)} values separated by commas, as the header has, with points in numbers"
        check(len(row) <= len(names), where, expected, f"{len(row)}: '{line[:60]}'")
        row += [""] * (len(names) - len(row))
        rows.append([_number(row[head[name][0]].strip(), where, name, signed, name in blank) for name in there])
    check(bool(rows), str(path), "rows of numbers after the header", "none")
    return {name: (factor * column, head[name][1]) for name, factor, column in zip(there, factors, np.array(rows).T)}


HEADER = re.compile(r"(.*?)\s*(?:[(\[](.*)[)\]])?")
"""Name of a column, and its unit in brackets."""


def check_unit(where: str, column: str, unit: str, known: Mapping[str, float] | None) -> float:
    """Return the factor of a column's unit, or raise an error that shows how the header states it.

    Parameters
    ----------
    where, column, unit : str
    known : mapping of unit to factor, optional
        None allows any unit and makes the factor 1.
    """
    shown = [name for name in known or LENGTHS if name]
    expected = f"its unit in the header, such as '{column} ({shown[0]})'" + (f", one of {shown}" if known else "")
    factors = {_plain(name): factor for name, factor in known.items()} if known else {_plain(unit): 1.0} if unit else {}
    check(_plain(unit) in factors, f"{where}, column '{column}'", expected, f"the unit '{unit}'" if unit else "no unit")
    return factors[_plain(unit)]


def _plain(unit: str) -> str:
    """Return a unit in lower case, with the letter u for micro."""
    return unit.strip().lower().replace("\u00b5", "u").replace("\u03bc", "u")


def _number(text: str, where: str, column: str, signed: bool, blank: bool) -> float:
    if blank and text.lower() in ("", "nan"):
        return np.nan
    with parsing(where, f"a finite number{'' if signed else ' of at least 0'} in column '{column}'", text):
        value = float(text)
        if not np.isfinite(value) or (value < 0.0 and not signed):
            raise ValueError
    return value


def read_response(path: str | PathLike[str], *, unit: str | None = None, name: str | None = None) -> Measurement:
    """Read a measured response over frequency from a CSV file.

    The header names the columns, with their units in brackets: ``frequency (Hz)``, and ``amplitude (mm)`` with or without
    ``phase (deg)``, or ``real (m)`` and ``imag (m)``.  Other columns and lines that start with ``#`` are ignored.
    Files of ``curve.to_csv`` can be read.

    Parameters
    ----------
    path : path-like
    unit : str, optional
        Unit of the amplitude, in place of the unit in the header.
    name : str, optional
        In legends; that of the file by default.

    Returns
    -------
    Measurement
        ``measurement.plot(ax=...)`` lays it over curves.

    Raises
    ------
    BdamperError
        If a column or its unit is missing, or a value is not a finite number; the message names the line.
    """
    sets = ("frequency", "real", "imag"), ("frequency", "amplitude", "phase"), ("frequency", "amplitude")
    sizes = dict.fromkeys(("amplitude", "real", "imag"), None if unit is None else dict.fromkeys(("", unit), 1.0))
    found = read_columns(path, *sets, units={"frequency": HERTZ, "phase": ANGLES, **sizes})
    frequency, size, *rest = (values for values, _ in found.values())
    _, own, *others = (text for _, text in found.values())
    if "imag" in found:
        check(others == [own], str(path), "real and imag in the same unit", f"'{own}' and '{others[0]}'")
    response = size.astype(complex)
    if "imag" in found:
        response = size + 1j * rest[0]
    elif rest:
        response = size * np.exp(1j * rest[0])
    own = own if unit is None else unit
    return Measurement(name or Path(path).stem, frequency, response, unit=own, source=str(path))
