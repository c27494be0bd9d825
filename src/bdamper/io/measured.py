"""Measured responses over frequency, and measured resonances over load.

A CSV file of resonances has a header and one row for each measurement.  The column ``load`` (newtons) is required;
``amplitude`` (any unit) and ``frequency`` (hertz) may be given both or one of them.  A row with load 0 is the structure
without load on its dampers, the reference of a fit (:func:`bdamper.fit`).  Lines that start with ``#`` are comments.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bdamper.io.reading import data_lines, parsing
from bdamper.model.checks import check_all, require
from bdamper.util import validate
from bdamper.util.errors import mismatch
from bdamper.util.hdf5 import Storable
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief
from bdamper.util.tables import Column, Hertz, Radians, Tabular

LENGTHS = {
    "": 1.0, "m": 1.0, "meter": 1.0, "metre": 1.0, "meters": 1.0, "metres": 1.0, "cm": 1e-2, "mm": 1e-3, "millimeter": 1e-3,
    "millimetre": 1e-3, "um": 1e-6, "micron": 1e-6, "microns": 1e-6, "nm": 1e-9, "in": 0.0254, "inch": 0.0254,
    "mil": 2.54e-5, "mils": 2.54e-5,
}  # fmt: skip
"""Units of length in metres."""


@brief
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
        unit = self.unit.strip().lower().replace("\u00b5", "u").replace("\u03bc", "u")
        expected = f"displacements in one of {tuple(u for u in LENGTHS if u)} or a scale to metres (scale=...)"
        validate.require(unit in LENGTHS, f"measurement '{self.name}'", expected, f"the unit '{self.unit}'")
        return LENGTHS[unit]

    def __str__(self) -> str:
        k = int(np.argmax(self.amplitude))
        return (
            f"{self.name}: {len(self.frequency)} points from {self.frequency.min():.6g} to {self.frequency.max():.6g} Hz, "
            f"largest {self.amplitude[k]:.6g} {self.unit} at {self.frequency[k]:.6g} Hz ({self.source})"
        )


COLUMNS = ("load", "amplitude", "frequency")


@brief
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
        If a column is missing, a row is longer than the header, or a value is not a finite number of at least 0; the
        message names the line.
    """
    sets = COLUMNS, COLUMNS[:2], (COLUMNS[0], COLUMNS[2])
    found = read_columns(path, *sets, signed=False, blank=COLUMNS[1:])
    values = {name: column for name, (column, _) in found.items()}
    return Measured(**{name: values.get(name, np.full(len(values["load"]), np.nan)) for name in COLUMNS}, source=str(path))


def read_columns(
    path: str | PathLike[str], *sets: tuple[str, ...], signed: bool = True, blank: tuple[str, ...] = ()
) -> dict[str, tuple[NDArray, str]]:
    """Columns of a CSV file by name, each with the unit that stands in brackets behind the name.

    Names and units are read in small letters.  Lines that start with ``#``, empty lines and other columns are left alone.

    Parameters
    ----------
    path : path-like
    *sets : tuple of str
        Names that belong together; those of the first set which the file has are read.
    signed : bool
        Whether numbers below 0 are allowed.
    blank : tuple of str
        Columns in which a value may be missing; it is NaN then.

    Raises
    ------
    BdamperError
        If no set is complete, or a value is not a finite number; the message names the line.
    """
    require(not Path(path).is_dir(), str(path), "a CSV file", "a folder")
    try:
        lines = data_lines(Path(path).read_text(encoding="utf-8-sig"), "#")
    except UnicodeDecodeError as error:
        raise mismatch(str(path), "text in UTF-8", f"another encoding ({error})") from error
    require(bool(lines), str(path), "a header and rows of numbers", "nothing")
    (first, header), *lines = lines
    names = [name.strip().lower() for name in next(csv.reader([header]))]
    head: dict[str, tuple[int, str]] = {}
    for k, text in enumerate(names):
        if found := re.fullmatch(r"(\w+)\s*(?:[(\[](.*)[)\]])?", text):
            head.setdefault(found[1], (k, (found[2] or "").strip()))
    there = next((each for each in sets if set(each) <= head.keys()), None)
    if there is None:
        raise mismatch(f"{path}, line {first}", f"the columns {'; or '.join(', '.join(each) for each in sets)}", names)
    rows = []
    for k, line in lines:
        where, row = f"{path}, line {k}", next(csv.reader([line]))
        expected = f"{len(names)} values separated by commas, as the header has, with points in numbers"
        require(len(row) <= len(names), where, expected, f"{len(row)}: '{line[:60]}'")
        row += [""] * (len(names) - len(row))
        rows.append([_number(row[head[name][0]].strip(), where, name, signed, name in blank) for name in there])
    require(bool(rows), str(path), "rows of numbers after the header", "none")
    return {name: (column, head[name][1]) for name, column in zip(there, np.array(rows).T)}


def _number(text: str, where: str, column: str, signed: bool, blank: bool) -> float:
    if blank and text.lower() in ("", "nan"):
        return np.nan
    with parsing(where, f"a finite number{'' if signed else ' of at least 0'} in column '{column}'", text):
        value = float(text)
        if not np.isfinite(value) or (value < 0.0 and not signed):
            raise ValueError
    return value


ANGLES = {"": 1.0, "rad": 1.0, "deg": np.pi / 180.0, "°": np.pi / 180.0}
"""Units of phase in radians."""


def read_response(path: str | PathLike[str], *, unit: str | None = None, name: str | None = None) -> Measurement:
    """Read a measured response over frequency from a CSV file.

    The header names the columns, with their units in brackets: ``frequency (Hz)``, and ``amplitude (mm)`` with or without
    ``phase (deg)``, or ``real (m)`` and ``imag (m)``.  Other columns are left alone and lines that start with ``#`` are
    comments, so that what ``curve.to_csv`` has written is read, too.

    Parameters
    ----------
    path : path-like
    unit : str, optional
        Of the amplitude, where the header names none.
    name : str, optional
        In legends; that of the file by default.

    Returns
    -------
    Measurement
        ``measurement.plot(ax=...)`` lays it over curves.

    Raises
    ------
    BdamperError
        If a column is missing, or a value is not a finite number; the message names the line.
    """
    sets = ("frequency", "real", "imag"), ("frequency", "amplitude", "phase"), ("frequency", "amplitude")
    found = read_columns(path, *sets)
    for column, known in (("frequency", ("", "hz")), ("phase", tuple(ANGLES))):
        if column in found and found[column][1] not in known:
            raise mismatch(str(path), f"the {column} in one of {[u for u in known if u]}", f"'{found[column][1]}'")
    frequency, size, *rest = (values for values, _ in found.values())
    _, own, *others = (text for _, text in found.values())
    if "imag" in found:
        require(others == [own], str(path), "real and imag in the same unit", f"'{own}' and '{others[0]}'")
    response = size.astype(complex)
    if "imag" in found:
        response = size + 1j * rest[0]
    elif rest:
        response = size * np.exp(1j * ANGLES[others[0]] * rest[0])
    own = own if unit is None else unit
    return Measurement(name or Path(path).stem, frequency, response, unit=own, source=str(path))
