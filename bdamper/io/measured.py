"""Measured responses over frequency, and measured resonances over load with a figure of how well a prediction agrees.

A CSV file of resonances has a header and one row for each measurement.  The column ``load`` (newtons) is required;
``amplitude`` (any unit) and ``frequency`` (hertz) may be given both or one of them.  The comparison is dimensionless:
amplitude and frequency over those of a reference.  A row with load 0, the structure without load on its dampers, is this
reference; without one it is the row of least load.  Lines that start with ``#`` are comments.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bdamper.io.reading import parsing
from bdamper.model.checks import check_all, require
from bdamper.util import validate
from bdamper.util.errors import BdamperError, mismatch
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

    def normalised(self, quantity: str) -> tuple[NDArray, NDArray]:
        """Loads (m,) above zero and "amplitude" or "frequency" (m,) over that of the reference."""
        values = getattr(self, validate.choice("quantity", quantity, COLUMNS[1:]))
        there = np.isfinite(values)
        order = np.argsort(self.load[there])
        load, values = self.load[there][order], values[there][order]
        item = self.source or "measured points"
        require(len(load) > 0, item, f"a measured {quantity}", "none")
        require(values[0] > 0.0, item, f"a reference {quantity} above 0 at the least load, {load[0]:g}", f"{values[0]:g}")
        return load[load > 0.0], (values / values[0])[load > 0.0]


@dataclass(frozen=True)
class Fit:
    """How well a prediction agrees with measurements.

    Parameters
    ----------
    points : int
        Measured points inside the range of the prediction.
    outside : int
        Measured points outside of it, not counted.
    rms : float
        Root mean square of the relative deviation, prediction over measurement minus one.
    bias : float
        Mean of the relative deviation.
    largest : float
    r_squared : float
        One minus the squared deviations over the squared scatter of the measurements about their mean.
    """

    points: int
    outside: int
    rms: float
    bias: float
    largest: float
    r_squared: float

    def __str__(self) -> str:
        return (
            f"{self.points} points: rms {100 * self.rms:.1f} %, bias {100 * self.bias:+.1f} %, largest "
            f"{100 * self.largest:.1f} %, R2 {self.r_squared:.3f}" + (f"; {self.outside} outside" if self.outside else "")
        )


def load_measured(path: str | PathLike[str]) -> Measured:
    """Read measured points from a CSV file (see this module's docstring).

    Raises
    ------
    BdamperError
        If a column is missing, a row is longer than the header, or a value is not a finite number of at least 0; the
        message names the line.
    """
    lines, head = _lines(path)
    if "load" not in head or not {"amplitude", "frequency"} & set(head):
        raise mismatch(f"{path}, line {lines[0][0]}", f"the columns {COLUMNS} (one of the last two)", head)
    values: dict[str, list[float]] = {name: [] for name in COLUMNS}
    for number, row in _rows(path, lines, head):
        for name in COLUMNS:
            text = row[head.index(name)].strip() if name in head and head.index(name) < len(row) else ""
            with parsing(f"{path}, line {number}", f"a finite number of at least 0 in column '{name}'", text):
                value = float(text) if text and text.lower() != "nan" else np.nan
                if value < 0.0 or np.isinf(value) or (name == "load" and np.isnan(value)):
                    raise ValueError
            values[name].append(value)
    return Measured(**{name: np.array(column) for name, column in values.items()}, source=str(path))


def _lines(path: str | PathLike[str]) -> tuple[list[tuple[int, str]], list[str]]:
    """Numbered lines of a CSV file without comments and empty ones, and the names in the first of them in small letters."""
    require(not Path(path).is_dir(), str(path), "a CSV file", "a folder")
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            content = list(enumerate(file, 1))
    except UnicodeDecodeError as error:
        raise mismatch(str(path), "text in UTF-8", f"another encoding ({error})") from error
    lines = [(i, line) for i, line in content if line.strip() and not line.lstrip().startswith("#")]
    require(bool(lines), str(path), "a header and rows of numbers", "nothing")
    return lines, [name.strip().lower() for name in next(csv.reader([lines[0][1]]))]


def _rows(path: str | PathLike[str], lines: list[tuple[int, str]], head: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Numbers of lines and values of the rows after the header."""
    for number, line in lines[1:]:
        row = next(csv.reader([line]))
        expected = f"{len(head)} values separated by commas, as the header has, with points in numbers"
        require(len(row) <= len(head), f"{path}, line {number}", expected, f"{len(row)}: '{line.strip()[:60]}'")
        yield number, row
    require(len(lines) > 1, str(path), "rows of numbers after the header", "none")


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
    lines, head = _lines(path)
    units: dict[str, tuple[int, str]] = {}
    for k, text in enumerate(head):
        found = re.fullmatch(r"(\w+)\s*(?:[(\[](.*)[)\]])?", text)
        if found:
            units.setdefault(found[1], (k, (found[2] or "").strip()))
    first = "real" if {"real", "imag"} <= units.keys() else "amplitude"
    where = f"{path}, line {lines[0][0]}"
    if not {"frequency", first} <= units.keys():
        raise mismatch(where, "the columns frequency and amplitude, or frequency, real and imag", head)
    second = "imag" if first == "real" else "phase"
    columns = ["frequency", first, *([second] if second in units else [])]
    for column, known in (("frequency", ("", "hz")), ("phase", tuple(ANGLES))):
        if column in columns and units[column][1] not in known:
            raise mismatch(where, f"the {column} in one of {[u for u in known if u]}", f"'{units[column][1]}'")
    if second == "imag" and units["real"][1] != units["imag"][1]:
        raise mismatch(where, "real and imag in the same unit", f"'{units['real'][1]}' and '{units['imag'][1]}'")
    values = []
    for number, row in _rows(path, lines, head):
        texts = [row[units[column][0]] if units[column][0] < len(row) else "" for column in columns]
        values.append([_finite(text, f"{path}, line {number}", column) for text, column in zip(texts, columns)])
    frequency, size, *rest = np.array(values).T
    response = size.astype(complex)
    if rest and second == "phase":
        response = size * np.exp(1j * ANGLES[units["phase"][1]] * rest[0])
    elif rest:
        response = size + 1j * rest[0]
    own = unit if unit is not None else units[first][1]
    return Measurement(name or Path(path).stem, frequency, response, unit=own, source=str(path))


def _finite(text: str, where: str, column: str) -> float:
    with parsing(where, f"a finite number in column '{column}'", text):
        value = float(text)
        if not np.isfinite(value):
            raise ValueError
    return value


def goodness_of_fit(load: NDArray, predicted: NDArray, measured_load: NDArray, measured: NDArray) -> Fit:
    """Compare a predicted curve over load with measured points, by interpolation over the logarithm of the load.

    Parameters
    ----------
    load, predicted : (n,) float
    measured_load, measured : (m,) float
        Rows with NaN are left out.

    Raises
    ------
    BdamperError
        If no measured point lies inside the range of the prediction.
    """
    there = np.isfinite(measured) & np.isfinite(measured_load)
    good = np.isfinite(predicted)
    order = np.argsort(load[good])
    x, y = np.log(load[good][order]), predicted[good][order]
    at = np.log(measured_load[there])
    inside = (at >= x[0]) & (at <= x[-1])
    if not inside.any():
        raise BdamperError(f"goodness of fit: expected measured loads between {np.exp(x[0]):g} and {np.exp(x[-1]):g}")
    reference = measured[there][inside]
    value = np.interp(at[inside], x, y)
    deviation = value / reference - 1.0
    scatter = float(np.sum((reference - reference.mean()) ** 2))
    rms, largest = float(np.sqrt(np.mean(deviation**2))), float(np.abs(deviation).max())
    r_squared = 1.0 - float(np.sum((value - reference) ** 2)) / scatter if scatter > 0.0 else np.nan
    return Fit(int(inside.sum()), int((~inside).sum()), rms, float(deviation.mean()), largest, r_squared)
