"""The model file: a :class:`~bdamper.model.structure.Model` in HDF5.

The layout follows the classes one to one, by their annotated types (:class:`bdamper.model.fields.Data`), and is described
in ``docs/model-file.md``, with an example of how to write such a file with h5py alone.  The reader checks the container:
which groups and datasets there must be, of which type, in which units.  The numbers are checked by
``bdamper.model.validation.check_model``, for files and for models built in memory alike.

A file holds all its data: links to other files, external storage and virtual datasets are refused, and so is every name
that is not part of the format, since a misspelt optional dataset would otherwise go unnoticed.  Additional attributes are
ignored.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from bdamper.model.fields import layout, require
from bdamper.model.hdf5_records import (
    attribute,
    check_members,
    check_text,
    new_group,
    place,
    read_number,
    read_ports,
    read_record,
    read_text,
    subgroup,
    write_record,
    write_text,
)
from bdamper.model.structure import Body, Model
from bdamper.model.validation import as_checked, check_model
from bdamper.util.errors import ModelError
from bdamper.util.storage import enter_reader, opened, written

FORMAT = "bdamper-model"
VERSION = 1
RECORDS = [group for group in layout(Model) if group.is_record]
AXIS = (0.0, 0.0, 1.0)
TIME_CONVENTION = "exp(+i omega t)"
PHASE_CONVENTION = "u(k+1) = Rz(-2 pi/N) u(k) exp(+i 2 pi d/N), k toward +X"


# -----------------------------------------------------------------------------------------------------------
# Writing


def save_model(model: Model, path: str | os.PathLike[str]) -> None:
    """Write a model to an HDF5 file, replacing an existing one in a single step.

    Parameters
    ----------
    model : Model
        It is checked first; an inconsistent model is not written.
    path : path-like
        The file; its directory must exist.

    Raises
    ------
    ModelError
        If the model does not pass ``bdamper.model.validation.check_model``.
    BdamperError
        If the file cannot be written; an existing file is then unchanged.
    """
    check_model(model)
    with written(path, track_order=True) as file:
        write_model(file, model)


def write_model(file: h5py.Group, model: Model) -> None:
    """Write a checked model into a file or a group of one."""
    write_text(file, "format", FORMAT)
    file.attrs["version"] = VERSION
    file.attrs["n_blades"] = int(model.n_blades)
    file.attrs["axis"] = np.array(AXIS)
    write_text(file, "time_convention", TIME_CONVENTION)
    write_text(file, "phase_convention", PHASE_CONVENTION)
    for group in RECORDS:
        members = new_group(file, group.place())
        for name, record in getattr(model, group.name).items():
            ports = record.ports if isinstance(record, Body) else ()
            rows = {".".join(port): model.port_slice(name, port) for port in ports}
            write_record(new_group(members, name), record, rows)
    provenance = file.create_group("provenance")
    for key, value in model.provenance.items():
        write_text(provenance, key, value)


# -----------------------------------------------------------------------------------------------------------
# Reading


def load_model(path: str | os.PathLike[str]) -> Model:
    """Read a model from an HDF5 file and check it.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Model
        With all numbers in double precision, whatever the precision in the file.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ModelError
        If the file cannot be read as a model, or the model in it does not pass
        ``bdamper.model.validation.check_model``.
    """
    if not Path(path).exists():
        raise FileNotFoundError(f"there is no model file '{path}'")
    require(not Path(path).is_dir(), str(path), "a model file", "a folder")
    with opened(path, "a readable HDF5 file", ModelError) as file:
        model = read_model(file)
    check_model(model, where=str(path))
    return as_checked(model)


enter_reader(FORMAT, load_model)


def read_model(file: h5py.Group) -> Model:
    """A model, not checked yet, from a file or a group of one."""
    _check_root(file)
    parts: dict[str, Any] = {}
    for own in sorted(RECORDS, key=lambda own: own.kind is Body):  # the modes of a body are at points of interfaces
        members = subgroup(file, own.place()) if own.place() in file else {}
        parts[own.name] = {name: _read_member(subgroup(members, name), own.kind, parts) for name in members}
    return Model(n_blades=read_number(file, "n_blades", int), provenance=_read_provenance(file), **parts)


def _read_member(group: h5py.Group, kind: Any, parts: Mapping[str, Any]) -> Any:
    if kind is not Body:
        return read_record(group, kind)
    ports, interfaces = read_ports(group, "ports") if "ports" in group.attrs else (), parts["interfaces"]
    for name, _ in ports:
        require(name in interfaces, place(group, "@ports"), f"an interface of {list(interfaces)}", f"'{name}'")
    points = {".".join(port): interfaces[port[0]].n_points for port in ports}
    n = sum(points.values())
    return read_record(group, Body, {"n_points": n, "n_forces": 3 * n}, points)


def _check_root(file: h5py.Group) -> None:
    """Format, version and conventions; nothing else is looked at before these fit."""
    found = read_text(file, "format")
    other = f"'{found}': bd.load reads results" if found.startswith("bdamper-") else f"'{found}'"
    require(found == FORMAT, place(file, "@format"), f"'{FORMAT}'", other)
    version = read_number(file, "version", int)
    require(version == VERSION, place(file, "@version"), f"{VERSION}", f"{version}")
    check_text(file, "time_convention", TIME_CONVENTION)
    check_text(file, "phase_convention", PHASE_CONVENTION)
    axis = np.asarray(attribute(file, "axis"))
    good = axis.dtype.kind in "fiu" and np.array_equal(axis, AXIS)
    require(good, place(file, "@axis"), f"{list(AXIS)}", f"{axis.tolist()!r}")
    needed = [group.place() for group in RECORDS if group.required]
    check_members(file, needed, [*(group.place() for group in RECORDS), "provenance"])


def _read_provenance(file: h5py.Group) -> dict[str, str]:
    if "provenance" not in file:
        return {}
    group = subgroup(file, "provenance")
    check_members(group, [], [])
    return {key: read_text(group, key) for key in group.attrs}
