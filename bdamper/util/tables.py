"""Results as tables: CSV, pandas and xarray (extra ``bdamper[table]``).

The annotated types of fields and properties select the columns of a result that derives from :class:`Tabular`, with unit,
label and dimensions (:class:`Quantity`)::

    class ResponseCurve(Tabular, row="point"):
        frequency: Hertz
        harmonics: Annotated[NDArray, Quantity("m", dims=(ROW, "harmonic"))]

        @property
        def amplitude(self) -> Metres: ...

A table has a row for each point of the result; only xarray contains arrays with more dimensions.  Units are in the header
of a CSV file, in ``frame.attrs["units"]`` of pandas and in the attributes of each variable of xarray.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, TextIO

import numpy as np
from numpy.typing import NDArray

from bdamper.util.errors import COMPLETE, INTERRUPTED, BdamperError, import_extra
from bdamper.util.formatting import PREFIXES, spaced, unit_prefix
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


FEW_ROWS = 30
"""Largest number of rows that ``summary()`` prints."""
ROW = ""
"""Placeholder for the name of the dimension of the rows."""


@dataclass(frozen=True)
class Quantity:
    """Mark in an annotated type that makes a field or property a column of the table.

    Parameters
    ----------
    unit : str
    label : str
        Label of an axis; the name by default.
    name : str
        Name of the column; by default the name of the field or property.
    dims : tuple of str
        Names of the dimensions of an array, with :data:`ROW` for the rows; empty for one value in each row.
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
    """Mark of an array that has an entry for each row but is not a column.

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
    """Return the columns of a type by name: its first field, the properties, then the other fields."""
    own = declarations(cls)
    of_fields = {
        f.name: mark for f in fields(cls) if (mark := own[f.name].mark(Quantity)) is not None
    }
    derived: dict[str, Quantity] = {}
    for name, item in (pair for base in reversed(cls.__mro__) for pair in vars(base).items()):
        getter = (
            item.fget
            if isinstance(item, property)
            else item.func
            if isinstance(item, cached_property)
            else None
        )
        returned = None if getter is None else declarations(getter).get("return")
        if returned is not None and (mark := returned.mark(Quantity)) is not None:
            derived[name] = mark
    first = next(iter(of_fields), "")
    return {name: of_fields[name] for name in (first,) if name} | derived | of_fields


def _columns_of(name: str, mark: Quantity, value: Any, row: str) -> Iterator[tuple[str, Column]]:
    values = np.atleast_1d(value)
    if mark.parts:
        yield from (
            (part, Column(np.atleast_2d(values)[:, k], mark.unit))
            for k, part in enumerate(mark.parts)
        )
    else:
        yield mark.name or name, Column(values, mark.unit, tuple(dim or row for dim in mark.dims))


@contextmanager
def _text_file(path: FilePath) -> Iterator[TextIO]:
    """Open a text file that replaces an existing one at the end; a device or a pipe is written directly."""
    written = Path(path)
    with ExitStack() as stack:
        if not written.exists() or written.is_file():
            written = stack.enter_context(replacing(path))
        with written.open("w", newline="", encoding="utf-8") as file:
            yield file


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
        """Return the columns by name, including arrays with more dimensions and without fields that are None.

        If the rows form a grid, its coordinates come first, and arrays over the grid are columns.
        """
        cls: Any = type(self)
        found = ((name, mark, getattr(self, name)) for name, mark in quantities(cls).items())
        row, grid = self._dimension(), self._grid()
        out = dict(
            c
            for name, mark, value in found
            if value is not None
            for c in _columns_of(name, mark, value, row)
        )
        if not grid:
            return out
        places = zip(grid, np.meshgrid(*grid.values(), indexing="ij"))
        across = {
            name: Column(values.ravel(), out[name].unit if name in out else "")
            for name, values in places
        }
        flat = {
            name: c if c.dims else c._replace(values=c.values.ravel()) for name, c in out.items()
        }
        return across | flat | across

    def check_rows(self) -> None:
        """Raise ValueError if two fields differ in the size of a common dimension."""
        cls: Any = type(self)
        names, found = {f.name for f in fields(cls)}, dict[str, tuple[int, str]]()
        entries = {
            name: mark for name, own in declarations(cls).items() if (mark := own.mark(EachRow))
        }
        per_row = set(entries)
        marked = {name: mark for name, mark in quantities(cls).items() if name in names}
        marked |= dict.fromkeys(per_row, Quantity(dims=(ROW,)))
        shapes = {
            name: np.shape(value) for name in marked if (value := getattr(self, name)) is not None
        }
        for name, shape in shapes.items():
            self._check_width(name, shape, marked[name], entries.get(name))
        shapes |= {name: shape[:1] for name, shape in shapes.items() if name in per_row}
        flat = [name for name, shape in shapes.items() if shape and not marked[name].dims]
        if grid := self._grid() if flat else {}:
            n = int(np.prod([len(values) for values in grid.values()]))
            shapes |= {name: (int(np.prod(shapes[name])),) for name in flat if name not in grid}
            shapes |= {name: (n,) for name in flat if name in grid}
        for name, shape in shapes.items():
            dims = marked[name].dims or (ROW, *marked[name].parts[:1])[: len(shape)]
            if len(dims) < len(shape):
                raise ValueError(f"'{name}' has the shape {shape}")
            for dim, size in zip(
                dims[::-1], shape[::-1]
            ):  # a single solution lacks the first dimension
                other, first = found.setdefault(dim or self._dimension(), (size, name))
                if size != other:
                    raise ValueError(f"'{name}' has {size} values, '{first}' has {other}")

    @staticmethod
    def _check_width(
        name: str, shape: tuple[int, ...], mark: Quantity, entry: EachRow | None
    ) -> None:
        """Raise ValueError if each row of a field has another number of values than its mark says."""
        if mark.parts and shape[-1:] != (len(mark.parts),):
            raise ValueError(f"'{name}' has the shape {shape}, without {len(mark.parts)} columns")
        # mean and first harmonic
        if mark.dims[-1:] == ("harmonic",) and shape[-1] < 2:
            raise ValueError(f"'{name}' has the shape {shape}, without two harmonics or more")
        if entry is not None and entry.shape is not None and shape[1:] != entry.shape:
            raise ValueError(
                f"'{name}' has the shape {shape}, without {entry.shape} values in each row"
            )

    def _dimension(self) -> str:
        """Return the name of the dimension of the rows."""
        return self._row

    def _grid(self) -> dict[str, Any]:
        """Return the coordinates of the grid of the rows, the fastest last; empty if there is no grid."""
        return {}

    def _order(self) -> Sequence[int] | NDArray:
        """Return the indices of the rows in the order of their texts."""
        return range(len(next(iter(self._flat().values())).values))

    def _flat(self) -> dict[str, Column]:
        return {name: column for name, column in self.columns().items() if not column.dims}

    def as_rows(self) -> list[tuple[str, ...]]:
        """Return the header and the rows as texts.

        Tables with more than :data:`FEW_ROWS` rows are reduced to the smallest and the largest value of each column.
        """
        table = self._flat()
        values = [np.asarray(column.values).tolist() for column in table.values()]
        if not values or not values[0]:
            return []
        largest = [
            max((abs(v) for v in column if isinstance(v, float) and v == v), default=0.0)
            for column in values
        ]
        scale = [
            unit_prefix(most, column.unit) if most < np.inf else " "
            for most, column in zip(largest, table.values())
        ]
        texts = {"nan": ""}  # not found
        cells = [
            [f"{v / PREFIXES[s]:.5g}" if isinstance(v, float) else str(v) for v in c]
            for c, s in zip(values, scale)
        ]
        cells = [[texts.get(text, text) for text in column] for column in cells]
        head = [
            f"{spaced(n)} ({s.strip()}{c.unit})" if c.unit else spaced(n)
            for (n, c), s in zip(table.items(), scale)
        ]
        if len(values[0]) <= FEW_ROWS:
            rows = list(zip(*cells))
            return [tuple(head), *(rows[i] for i in self._order())]
        known = [[v for v in column if isinstance(v, float) and v == v] for column in values]
        ends = [
            (h, v.index(min(k)), v.index(max(k)), c)
            for h, v, k, c in zip(head, values, known, cells)
            if k
        ]
        first = f"{spaced(self._dimension())}: {len(values[0])}", "least", "largest"
        return [first, *((h, c[i], c[j]) for h, i, j, c in ends)]

    def _attributes(self) -> dict[str, Any]:
        """Return the metadata of the table: type of result, settings, model hash, version."""
        found = {
            name: getattr(self, name, None)
            for name in ("preload", "status", "model_hash", "settings")
        }
        texts = {
            name: value
            for name, value in found.items()
            if isinstance(value, str | float | int) and value != ""
        }
        settings = (
            {"settings": json.dumps(found["settings"], default=to_json)}
            if found["settings"]
            else {}
        )
        version = getattr(self, "made_with", INSTALLED).bdamper
        return {"result": type(self).__name__, **texts, **settings, "bdamper": version}

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
        table = self._flat()
        head = [
            f"{name} ({column.unit})" if column.unit else name for name, column in table.items()
        ]
        with file_errors(path), _text_file(path) as file:
            file.writelines(f"# {name}: {value}\n" for name, value in self._attributes().items())
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(head)
            writer.writerows(
                zip(*(np.asarray(column.values).tolist() for column in table.values()))
            )

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame with one row for each point; ``attrs["units"]`` contains the units.

        Raises
        ------
        BdamperError
            If pandas is not installed.
        """
        pandas = import_extra("pandas", "to_pandas", "table")
        table = self._flat()
        frame = pandas.DataFrame(
            {name: np.asarray(column.values) for name, column in table.items()}
        )
        frame.attrs = {
            **self._attributes(),
            "units": {name: column.unit for name, column in table.items()},
        }
        return frame

    def to_xarray(self) -> Any:
        """Return an xarray.Dataset, including arrays with more dimensions; each variable has the attribute ``units``.

        Raises
        ------
        BdamperError
            If xarray is not installed, or a sweep contains the same value of a setting twice, which is not a valid
            coordinate.

        Notes
        -----
        The harmonics are complex, and netCDF has no complex type.  ``data.to_netcdf(path, engine="h5netcdf",
        invalid_netcdf=True)`` writes them as an HDF5 type that xarray and h5py read.
        """
        xarray = import_extra("xarray", "to_xarray", "table")
        own, grid = self._dimension(), self._grid()
        shape, variables = tuple(len(values) for values in grid.values()), {}
        for name, column in self.columns().items():
            dims, values = column.dims or (own,), np.asarray(column.values)
            if name in grid:
                dims, values = (name,), np.asarray(grid[name])
            elif grid and dims[0] == own:
                dims, values = (*grid, *dims[1:]), values.reshape(*shape, *values.shape[1:])
            variables[name] = (dims, values, {"units": column.unit} if column.unit else {})
        data = xarray.Dataset(variables, attrs=self._attributes())
        return data.set_coords([name for name in data.variables if data[name].dims == (name,)])


class FrequencySeries:
    """Mixin of solutions over frequency with the harmonics of their response."""

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
        """Amplitude (n,) of the first harmonic of the response, m; the excitation has its frequency."""
        return np.abs(self.harmonics[:, 1])


def concatenate(tables: Sequence[Tabular]) -> dict[str, Column]:
    """Return the columns common to all tables, with their rows concatenated."""
    flat = [table._flat() for table in tables]
    return {
        name: column._replace(values=np.concatenate([one[name].values for one in flat]))
        for name, column in flat[0].items()
        if all(name in one for one in flat)
    }


def columns_of_rows(rows: Sequence[Any]) -> dict[str, Column]:
    """Return columns from dataclasses of one type, one for each row, by their fields of numbers or texts."""
    out = {}
    kind: Any = type(rows[0]) if rows else None
    for name in (f.name for f in fields(kind)) if rows else ():
        values = [getattr(row, name) for row in rows]
        if all(isinstance(value, str | float | int | np.generic) for value in values):
            out[name] = Column(np.array(values), quantities(kind).get(name, Quantity()).unit)
    return out


def axis_label(of: Any, name: str, unit: str = "") -> str:
    """Return the axis label of a field or property of a type: its label or name, and its unit."""
    mark = quantities(of).get(name, Quantity())
    text, unit = mark.label or spaced(mark.name or name).capitalize(), unit or mark.unit
    return f"{text} ({unit})" if unit else text
