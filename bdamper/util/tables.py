"""Results as tables: CSV, pandas and xarray (extra ``bdamper[table]``).

The annotated types of fields and properties select the columns of a result that derives from
:class:`Tabular`, with unit, label and dimensions (:class:`Quantity`)::

    class ResponseCurve(Tabular, row="point"):
        frequency: Hertz
        harmonics: Annotated[NDArray, Quantity("m", dims=(ROW, "harmonic"))]

        @property
        def amplitude(self) -> Metres: ...

A table has a row for each point of the result; only xarray contains arrays with more dimensions.
Units are in the header of a CSV file, in ``frame.attrs["units"]`` of pandas and in the attributes
of each variable of xarray.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, TextIO

import numpy as np
from numpy.typing import NDArray

from bdamper.util.errors import COMPLETE, INTERRUPTED, BdamperError, import_extra
from bdamper.util.formatting import PREFIXES, counted, spaced, unit_prefix, without_rounding
from bdamper.util.records import to_json
from bdamper.util.storage import INSTALLED, FilePath, check_folder, file_errors, replacing
from bdamper.util.validation import declarations


class Column(NamedTuple):
    """Values of one quantity.

    Parameters
    ----------
    values : (n,) array, or (...) array if ``dims`` names its dimensions
    unit : str
    dims : tuple of str
        Names of the dimensions; empty for a column with one value in each row.
    """

    values: Any
    unit: str = ""
    dims: tuple[str, ...] = ()


SHOWN_IN_PER_CENT = frozenset(
    {
        "stick",
        "slip",
        "open",
        "damping_ratio",
        "error",
        "difference",
        "harmonic_change",
        "vector_change",
    }
)
"""Columns with fractions, which printed tables show in per cent."""
PRINTED_HEADS = {
    "counted": "used",
    "harmonic_change": "change by two more harmonics",
    "vector_change": "change by six more residual modes",
}
"""Columns whose printed head differs from their name."""
FEW_ROWS = 30
"""Largest number of rows that ``summary()`` prints."""
EXTREMES = ("smallest", "largest")
"""Head of a table that is reduced to the extremes of its columns."""
ROW = ""
"""Placeholder for the name of the dimension of the rows."""


@dataclass(frozen=True)
class Quantity:
    """Annotation that makes a field or property a column of the table.

    Parameters
    ----------
    unit : str
    label : str
        Label of an axis; the name by default.
    name : str
        Name of the column; by default the name of the field or property.
    dims : tuple of str
        Names of the dimensions of an array, with :data:`ROW` for the rows; empty for one value in
        each row.
    parts : tuple of str
        Names of the columns of an array of shape (n, number of parts).
    """

    unit: str = ""
    label: str = ""
    name: str = ""
    dims: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()


@dataclass(frozen=True)
class EachRow:
    """Annotation of an array that has an entry for each row but is not a column.

    Parameters
    ----------
    shape : tuple of int, optional
        Shape of an entry.
    """

    shape: tuple[int, ...] | None = None


PerRow = Annotated[NDArray, EachRow()]
Cycles = Annotated[float, Quantity("Hz")]
Metre = Annotated[float, Quantity("m")]
Newton = Annotated[float, Quantity("N")]
Second = Annotated[float, Quantity("s")]
Numbers = Annotated[NDArray, Quantity()]
Hertz = Annotated[NDArray, Quantity("Hz")]
Metres = Annotated[NDArray, Quantity("m")]
Amplitude = Annotated[NDArray, Quantity("m", "Response amplitude")]
Resonance = Annotated[NDArray, Quantity("m", "Resonance amplitude")]
Newtons = Annotated[NDArray, Quantity("N")]
SquareMetres = Annotated[NDArray, Quantity("m2")]
Pascals = Annotated[NDArray, Quantity("Pa")]
Radians = Annotated[NDArray, Quantity("rad")]
Seconds = Annotated[NDArray, Quantity("s")]
RadiansPerSecond = Annotated[NDArray, Quantity("rad/s")]
Shares = Annotated[NDArray, Quantity(parts=("stick", "slip", "open"))]
Places = Annotated[NDArray, Quantity("m", parts=("X", "Y", "Z"))]
Kinds = Annotated[tuple[str, ...], Quantity(name="kind")]


@cache
def quantities(cls: Any) -> dict[str, Quantity]:
    """Return the columns of a type: its first field, the properties, then the other fields."""
    of_fields: dict[str, Quantity] = {}
    hints = declarations(cls)
    for item in fields(cls):
        mark = hints[item.name].mark(Quantity)
        if mark is not None:
            of_fields[item.name] = mark

    of_properties: dict[str, Quantity] = {}
    for base in reversed(cls.__mro__):
        for name, member in vars(base).items():
            mark = _mark_of_property(member)
            if mark is not None:
                of_properties[name] = mark

    first_field = dict(list(of_fields.items())[:1])
    return first_field | of_properties | of_fields


def _mark_of_property(member: object) -> Quantity | None:
    """Return the annotation of the return type of a property; None for other members of a class."""
    getter: Any
    if isinstance(member, property):
        getter = member.fget
    elif isinstance(member, cached_property):
        getter = member.func
    else:
        return None
    returned = declarations(getter).get("return")
    return None if returned is None else returned.mark(Quantity)


def _columns_of(name: str, mark: Quantity, value: Any, row: str) -> dict[str, Column]:
    """Return the columns of a field or property; ``row`` is the dimension of the rows."""
    if mark.parts:
        values = np.atleast_2d(np.atleast_1d(value))
        return {part: Column(values[:, k], mark.unit) for k, part in enumerate(mark.parts)}
    dims = tuple(dim or row for dim in mark.dims)
    return {mark.name or name: Column(np.atleast_1d(value), mark.unit, dims)}


@contextmanager
def _text_file(path: FilePath) -> Iterator[TextIO]:
    """Open a text file that replaces an existing one at the end.

    A device or a pipe is written directly.
    """
    written = Path(path)
    with ExitStack() as stack:
        is_device_or_pipe = written.exists() and not written.is_file()
        if not is_device_or_pipe:
            written = stack.enter_context(replacing(path))
        with written.open("w", newline="", encoding="utf-8") as file:
            yield file


def _numbers_in(values: Sequence[Any]) -> list[float]:
    """Return the floats of a column that are not NaN."""
    return [value for value in values if isinstance(value, float) and not math.isnan(value)]


def _column_prefix(values: Sequence[Any], unit: str) -> str:
    """Return the prefix of the unit that fits the largest number of a column; " " for none."""
    largest = max((abs(number) for number in _numbers_in(values)), default=0.0)
    return unit_prefix(largest, unit) if largest < np.inf else " "


def _cell(value: Any, prefix: str, largest: float) -> str:
    """Return a value as text; an unknown number is empty, and a rounding error is 0.

    ``largest`` is the largest number of the column.
    """
    if isinstance(value, bool):
        text = "yes" if value else "no"
    elif isinstance(value, float):
        text = f"{without_rounding(value, largest) / PREFIXES[prefix]:.5g}"
    else:
        text = str(value)
    return "" if text == "nan" else text


def _per_cent(fraction: Any) -> str:
    """Return a fraction in per cent, three digits; an unknown number is empty."""
    text = _cell(fraction, " ", 1.0)
    return f"{100.0 * float(text):.3g}" if isinstance(fraction, float) and text else text


class Tabular:
    """Mixin of results that are tables.

    Parameters of the class
    -----------------------
    row : str
        Name of the items that the rows represent.
    """

    _row: ClassVar[str] = "point"

    def __init_subclass__(cls, *, row: str = "", **options: Any) -> None:
        super().__init_subclass__(**options)
        cls._row = row or cls._row

    def columns(self) -> dict[str, Column]:
        """Return the columns by name, without fields that are None.

        If the rows form a grid, its coordinates come first, and arrays over the grid are columns.
        """
        cls: Any = type(self)
        columns: dict[str, Column] = {}
        for name, mark in quantities(cls).items():
            value = getattr(self, name)
            if value is not None:
                columns |= _columns_of(name, mark, value, self._dimension())
        # positions and displacements of contact points remain lengths
        if is_strain(self) and self._dimension() != "contact_point":
            columns = {
                name: column._replace(unit="m/m") if column.unit == "m" else column
                for name, column in columns.items()
            }
        grid = self._grid()
        if not grid:
            return columns

        coordinates: dict[str, Column] = {}
        for name, values in zip(grid, np.meshgrid(*grid.values(), indexing="ij")):
            unit = columns[name].unit if name in columns else ""
            coordinates[name] = Column(values.ravel(), unit)
        flat = {
            name: column if column.dims else column._replace(values=column.values.ravel())
            for name, column in columns.items()
        }
        # coordinates come first and replace a column of the same name
        return coordinates | flat | coordinates

    def check_rows(self) -> None:
        """Raise ValueError if two fields differ in the size of a common dimension."""
        cls: Any = type(self)
        stored = {item.name for item in fields(cls)}
        marks = {name: mark for name, mark in quantities(cls).items() if name in stored}
        per_row: dict[str, EachRow] = {}
        for name, hint in declarations(cls).items():
            entry = hint.mark(EachRow)
            if entry is not None:
                per_row[name] = entry
                marks[name] = Quantity(dims=(ROW,))

        shapes: dict[str, tuple[int, ...]] = {}
        for name, mark in marks.items():
            value = getattr(self, name)
            if value is not None:
                shapes[name] = np.shape(value)
                self._check_width(name, shapes[name], mark, per_row.get(name))
        # the entry of a row may have any shape
        for name in shapes:
            if name in per_row:
                shapes[name] = shapes[name][:1]
        self._unroll_grid(shapes, marks)
        self._check_sizes(shapes, marks)

    def _unroll_grid(
        self, shapes: dict[str, tuple[int, ...]], marks: Mapping[str, Quantity]
    ) -> None:
        """Replace the shapes of columns over a grid of rows by the number of its points."""
        columns = [name for name, shape in shapes.items() if shape and not marks[name].dims]
        # the grid may depend on the columns
        grid = self._grid() if columns else {}
        if not grid:
            return
        n_points = int(np.prod([len(values) for values in grid.values()]))
        for name in columns:
            is_coordinate = name in grid
            shapes[name] = (n_points if is_coordinate else int(np.prod(shapes[name])),)

    def _check_sizes(
        self, shapes: Mapping[str, tuple[int, ...]], marks: Mapping[str, Quantity]
    ) -> None:
        """Raise ValueError if two fields differ in the size of a common dimension."""
        first_of_dimension: dict[str, tuple[int, str]] = {}
        for name, shape in shapes.items():
            mark = marks[name]
            dims = mark.dims or (ROW, *mark.parts[:1])[: len(shape)]
            if len(dims) < len(shape):
                raise ValueError(f"'{name}' has the shape {shape}, with more than {len(dims)} axes")
            # from the last dimension, because a single solution lacks the first one
            for dim, size in zip(dims[::-1], shape[::-1]):
                dimension = dim or self._dimension()
                other, first = first_of_dimension.setdefault(dimension, (size, name))
                if size != other:
                    raise ValueError(f"'{name}' has {size} values, '{first}' has {other}")

    @staticmethod
    def _check_width(
        name: str, shape: tuple[int, ...], mark: Quantity, entry: EachRow | None
    ) -> None:
        """Raise ValueError if the rows of a field do not have the width that its annotation says."""
        if mark.parts and shape[-1:] != (len(mark.parts),):
            raise ValueError(f"'{name}' needs {len(mark.parts)} columns, but has the shape {shape}")
        # mean and first harmonic
        if mark.dims[-1:] == ("harmonic",) and shape[-1] < 2:
            raise ValueError(
                f"the last axis of '{name}' needs at least the mean and the first harmonic, but has "
                f"the size {shape[-1]}"
            )
        if entry is not None and entry.shape is not None and shape[1:] != entry.shape:
            raise ValueError(
                f"each row of '{name}' needs the shape {entry.shape}, but has the shape {shape[1:]}"
            )

    def _dimension(self) -> str:
        """Return the name of the dimension of the rows."""
        return self._row

    def _grid(self) -> dict[str, Any]:
        """Return the coordinates of the grid of the rows, the fastest last.

        Empty if there is no grid.
        """
        return {}

    def _order(self) -> Sequence[int] | NDArray:
        """Return the indices of the rows in the order of their texts."""
        first_column = next(iter(self._flat().values()))
        return range(len(first_column.values))

    def _flat(self) -> dict[str, Column]:
        """Return the columns with one value in each row."""
        return {name: column for name, column in self.columns().items() if not column.dims}

    def as_rows(self) -> list[tuple[str, ...]]:
        """Return the header and the rows, formatted as strings.

        Tables with more than :data:`FEW_ROWS` rows are reduced to the smallest and the largest
        value of each column.
        """
        columns = {name: column for name, column in self._flat().items() if _is_shown(name, column)}
        values = {name: np.asarray(column.values).tolist() for name, column in columns.items()}
        n_rows = len(next(iter(values.values()), []))
        if n_rows == 0:
            return []

        heads: dict[str, str] = {}
        cells: dict[str, list[str]] = {}
        for name, column in columns.items():
            heads[name] = PRINTED_HEADS.get(name, spaced(name))
            if name in SHOWN_IN_PER_CENT and column.unit == "":
                heads[name] += " (%)"
                cells[name] = [_per_cent(value) for value in values[name]]
                continue
            prefix = _column_prefix(values[name], column.unit)
            if column.unit:
                heads[name] += f" ({prefix.strip()}{column.unit})"
            largest = max(map(abs, _numbers_in(values[name])), default=0.0)
            cells[name] = [_cell(value, prefix, largest) for value in values[name]]
        if n_rows <= FEW_ROWS:
            rows = list(zip(*cells.values()))
            return [tuple(heads.values()), *(rows[i] for i in self._order())]

        rows = [(counted(n_rows, spaced(self._dimension())), *EXTREMES)]
        for name, column_values in values.items():
            numbers = _numbers_in(column_values)
            if numbers:
                smallest = column_values.index(min(numbers))
                largest = column_values.index(max(numbers))
                rows.append((heads[name], cells[name][smallest], cells[name][largest]))
        return rows

    def _attributes(self) -> dict[str, Any]:
        """Return the metadata of the table: type of result, settings, model hash, version."""
        attributes: dict[str, Any] = {"result": type(self).__name__}
        for name in ("preload", "status", "model_hash"):
            value = getattr(self, name, None)
            if isinstance(value, str | float | int) and value != "":
                attributes[name] = value
        settings = getattr(self, "settings", None)
        if settings:
            attributes["settings"] = json.dumps(settings, default=to_json)
        attributes["bdamper"] = getattr(self, "made_with", INSTALLED).bdamper
        return attributes

    def to_csv(self, path: FilePath) -> None:
        """Write a CSV file with one row for each point.

        The header contains names and units.  Lines that begin with ``#`` contain the metadata;
        ``pandas.read_csv(path, comment="#")`` skips them.

        Raises
        ------
        BdamperError
            If the file cannot be written.
        """
        check_folder(path)
        # nobody may read a named pipe
        if Path(path).resolve().is_fifo():
            raise BdamperError(f"{path}: expected a regular file, found a pipe")
        columns = self._flat()
        head = [
            f"{name} ({column.unit})" if column.unit else name for name, column in columns.items()
        ]
        values = [np.asarray(column.values).tolist() for column in columns.values()]
        with file_errors(path), _text_file(path) as file:
            file.writelines(f"# {name}: {value}\n" for name, value in self._attributes().items())
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(head)
            writer.writerows(zip(*values))

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame with one row for each point.

        ``attrs["units"]`` contains the units.

        Raises
        ------
        BdamperError
            If pandas is not installed.
        """
        pandas = import_extra("pandas", "to_pandas", "table")
        columns = {name: column for name, column in self._flat().items() if _is_shown(name, column)}
        values = {name: np.asarray(column.values) for name, column in columns.items()}
        units = {name: column.unit for name, column in columns.items()}
        frame = pandas.DataFrame(values)
        frame.attrs = {**self._attributes(), "units": units}
        return frame

    def to_xarray(self) -> Any:
        """Return an xarray.Dataset, including arrays with more dimensions.

        Each variable has the attribute ``units``.

        Raises
        ------
        BdamperError
            If xarray is not installed, or a sweep contains the same value of a setting twice, which
            is not a valid coordinate.

        Notes
        -----
        The harmonics are complex, and netCDF has no complex type.  ``data.to_netcdf(path,
        engine="h5netcdf", invalid_netcdf=True)`` writes them as an HDF5 type that xarray and h5py
        read.
        """
        xarray = import_extra("xarray", "to_xarray", "table")
        row = self._dimension()
        grid = self._grid()
        grid_shape = tuple(len(values) for values in grid.values())
        variables = {}
        for name, column in self.columns().items():
            dims = column.dims or (row,)
            values = np.asarray(column.values)
            if name in grid:
                dims = (name,)
                values = np.asarray(grid[name])
            elif grid and dims[0] == row:
                dims = (*grid, *dims[1:])
                values = values.reshape(*grid_shape, *values.shape[1:])
            attributes = {"units": column.unit} if column.unit else {}
            variables[name] = (dims, values, attributes)
        data = xarray.Dataset(variables, attrs=self._attributes())
        return data.set_coords([name for name in data.variables if data[name].dims == (name,)])


def _is_shown(name: str, column: Column) -> bool:
    """Return whether a table shows a column: reasons for statuses only if a row has one."""
    if not name.endswith("reason"):
        return True
    return bool(np.any(np.asarray(column.values) != ""))


class FrequencySeries:
    """Mixin of solutions at several frequencies with the harmonics of their response."""

    frequency: Hertz
    harmonics: NDArray
    status: str

    def __len__(self) -> int:
        return len(self.frequency)

    @property
    def complete(self) -> bool:
        """Whether the solutions cover the requested interval.

        Gaps up to a thousandth of the interval are ignored.
        """
        return self.status == COMPLETE

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the computation."""
        return self.status == INTERRUPTED

    @property
    def amplitude(self) -> Amplitude:
        """Amplitude (n,) of the first harmonic of the response, m.

        This harmonic has the frequency of the excitation.
        """
        return np.abs(self.harmonics[:, 1])


def concatenate(tables: Sequence[Tabular]) -> dict[str, Column]:
    """Return the columns common to all tables, with their rows concatenated."""
    flat = [table._flat() for table in tables]
    joined: dict[str, Column] = {}
    for name, column in flat[0].items():
        if all(name in columns for columns in flat):
            values = np.concatenate([columns[name].values for columns in flat])
            joined[name] = column._replace(values=values)
    return joined


def is_strain(result: object) -> bool:
    """Return whether the response of a result is the strain of a gauge, m/m instead of m.

    Parameters
    ----------
    result : object
        Result with the settings of its study, or another object.
    """
    settings = getattr(result, "settings", None)
    response = settings.get("response") if isinstance(settings, Mapping) else None
    return response is not None and response.get("elastic") is not None


def columns_of_rows(rows: Sequence[Any]) -> dict[str, Column]:
    """Return a column for each field of numbers or texts of dataclasses, each of which is a row."""
    if not rows:
        return {}
    kind: Any = type(rows[0])
    marks = quantities(kind)
    columns = {}
    for item in fields(kind):
        values = [getattr(row, item.name) for row in rows]
        if all(isinstance(value, str | float | int | np.generic) for value in values):
            mark = marks.get(item.name, Quantity())
            columns[mark.name or item.name] = Column(np.array(values), mark.unit)
    return columns


def axis_label(of: Any, name: str, unit: str = "") -> str:
    """Return the axis label of a field or property of a type: its label or name, and its unit."""
    mark = quantities(of).get(name, Quantity())
    text = mark.label or spaced(mark.name or name).capitalize()
    shown_unit = unit or mark.unit
    return f"{text} ({shown_unit})" if shown_unit else text
