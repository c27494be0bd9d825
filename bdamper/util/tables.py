"""Results as tables: CSV, pandas and xarray (extra ``bdamper[table]``).

A result that derives from :class:`Tabular` names its columns, one row for each of its points, and arrays of more
dimensions that only xarray takes.  Units stand in the header of a CSV file, in ``frame.attrs["units"]`` and in the
attributes of each variable.
"""

from __future__ import annotations

import csv
import importlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bdamper.util.errors import BdamperError
from bdamper.util.hdf5 import FilePath, check_folder, plain
from bdamper.util.versions import HERE


class Column(NamedTuple):
    """Values of one quantity.

    Parameters
    ----------
    values : (n,) array, or (...) array with names of its dimensions
    unit : str
    dims : tuple of str
        Names of the dimensions of an array; empty for a column with one value for each row.
    """

    values: Any
    unit: str = ""
    dims: tuple[str, ...] = ()


class Tabular:
    """A result that is a table as well; a mixin."""

    def columns(self) -> Mapping[str, Column]:
        """Columns by name, one value for each row, and arrays of more dimensions."""
        raise NotImplementedError

    def _dimension(self) -> str:
        """What the rows of the table are."""
        return "point"

    def _grid(self) -> dict[str, Any]:
        """Coordinates of the grid that the rows lie on, the last one fastest; empty if they are a mere sequence."""
        return {}

    def _flat(self) -> dict[str, Column]:
        return {name: column for name, column in self.columns().items() if not column.dims}

    def _attributes(self) -> dict[str, Any]:
        """What the table is of: kind of result, settings, model, version."""
        found = {name: getattr(self, name, None) for name in ("preload", "status", "model_hash", "settings")}
        texts = {name: value for name, value in found.items() if isinstance(value, str | float | int) and value != ""}
        settings = {"settings": json.dumps(found["settings"], default=plain)} if found["settings"] else {}
        return {"result": type(self).__name__, **texts, **settings, "bdamper": getattr(self, "made_with", HERE).bdamper}

    def to_csv(self, path: FilePath) -> None:
        """Write one row for each point; the header has names and units, lines that begin with ``#`` what it is of.

        ``pandas.read_csv(path, comment="#")`` reads it.

        Raises
        ------
        BdamperError
            If no file can be written there.
        """
        check_folder(path)
        table = self._flat()
        head = [f"{name} ({column.unit})" if column.unit else name for name, column in table.items()]
        try:
            with Path(path).open("w", newline="", encoding="utf-8") as file:
                file.writelines(f"# {name}: {value}\n" for name, value in self._attributes().items())
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(head)
                writer.writerows(zip(*(np.asarray(column.values).tolist() for column in table.values())))
        except OSError as error:
            raise BdamperError(f"{path}: expected a file that can be written, found {error}") from error

    def to_pandas(self) -> Any:
        """A pandas.DataFrame, one row for each point; ``attrs["units"]`` has the units.

        Raises
        ------
        BdamperError
            If pandas is not installed.
        """
        pandas = _optional("pandas", "to_pandas")
        table = self._flat()
        frame = pandas.DataFrame({name: np.asarray(column.values) for name, column in table.items()})
        frame.attrs = {**self._attributes(), "units": {name: column.unit for name, column in table.items()}}
        return frame

    def to_xarray(self) -> Any:
        """An xarray.Dataset with units in the attributes of its variables, arrays of more dimensions included.

        Harmonics are complex, which netCDF has no type for: ``data.to_netcdf(path, engine="h5netcdf",
        invalid_netcdf=True)`` writes them as HDF5 does, and xarray and h5py read them.

        Raises
        ------
        BdamperError
            If xarray is not installed, or a sweep has the same value of a setting twice, which is no coordinate.
        """
        xarray = _optional("xarray", "to_xarray")
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


def _optional(module: str, asked: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise BdamperError(f"{asked} needs {module}: install the extra bdamper[table]") from error


def joined(tables: Sequence[Tabular]) -> dict[str, Column]:
    """The rows of several tables one below the other, by the columns that all of them have."""
    flat = [table._flat() for table in tables]
    return {
        name: column._replace(values=np.concatenate([one[name].values for one in flat]))
        for name, column in flat[0].items()
        if all(name in one for one in flat)
    }


def from_rows(rows: Sequence[Any], units: Mapping[str, str]) -> dict[str, Column]:
    """Columns from small dataclasses of one type, one for each row, by the fields that are numbers or texts."""
    out = {}
    for name in (f.name for f in fields(rows[0])) if rows else ():
        values = [getattr(row, name) for row in rows]
        if all(isinstance(value, str | float | int | np.generic) for value in values):
            out[name] = Column(np.array(values), units.get(name, ""))
    return out
