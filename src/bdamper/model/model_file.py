"""The model file: a :class:`~bdamper.model.structure.Model` in HDF5.

The layout follows the classes one to one, by their annotated types (:class:`bdamper.model.fields.Data`), and is described
in ``docs/model-file.md``, with an example of how to write such a file with h5py alone.  The reader checks the container:
which groups and datasets there must be, of which type, in which units.  The numbers are checked by
``bdamper.model.validation.check_model``, for files and for models built in memory alike.

A file holds all its data: links to other files, external storage and virtual datasets are refused, and so is every name
that is not part of the format, since a misspelt optional dataset would otherwise go unnoticed.  Additional attributes are
ignored.

Records of a model in groups of an HDF5 file, written and read by the annotated types of their classes.

Where each field stands, in which units and of which shape, says :class:`bdamper.model.fields.Data`; units, types and what
there must be are checked as a file is read.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, get_origin

import h5py
import numpy as np
from numpy.typing import NDArray

from bdamper.model.fields import (
    TYPES,
    Data,
    Item,
    Kind,
    Sizes,
    by_rank,
    check,
    fits,
    known_shape,
    layout,
    learn,
    member,
    shape_text,
)
from bdamper.model.modal_basis import LocalBasis
from bdamper.model.rotation import SpeedBasis
from bdamper.model.structure import Body, ModalBasis, Model
from bdamper.model.validation import as_checked, check_model
from bdamper.util.errors import ModelError
from bdamper.util.storage import MOST_EXPANDED, read_hdf5, register_reader, write_hdf5
from bdamper.util.validation import declarations

# ---- Records of a model in groups of an HDF5 file, written and read by the annotated types of t ----


COMPRESS_FROM = 4096  # bytes; below this a dataset is stored plainly
LOCAL_SIZES = ("n_cantilever", "n_attachment", "n_interface")
_SINGLE = {"f": np.float32, "c": np.complex64}
_NATIVE = {"f": np.float64, "c": np.complex128, "i": np.int64, "u": np.int64, "b": np.bool_}


# -----------------------------------------------------------------------------------------------------------
# Writing


def write_record(group: h5py.Group, record: object, ports: Mapping[str, slice] | None = None) -> None:
    """Write the fields of a record into a group.

    Parameters
    ----------
    group : h5py.Group
    record : dataclass
    ports : mapping of name to slice, optional
        Rows of the contact points of each port of the body.
    """
    if isinstance(record, ModalBasis) and record.speed is not None:
        record = replace(record, speed=_without_derived(record, record.speed))
    if isinstance(record, LocalBasis):
        group.attrs.update({name: getattr(record, name) for name in LOCAL_SIZES})
    kind: Kind = type(record)
    for item in layout(kind):
        value = getattr(record, item.name)
        if value is None:
            continue
        if item.is_attribute:
            _write_attribute(group, item, value)
            continue
        head, star, tail = item.file.rpartition("*") if "*" in item.file else ("", "", item.file)
        own = new_group(group, head[:-1]) if head else group
        parts = value if item.keys else {name: value[rows] for name, rows in (ports or {}).items()} if star else {"": value}
        for key, part in parts.items():
            name = member(key) + tail
            if item.is_record:
                write_record(new_group(own, name), part, ports)
            else:
                write_array(own, name, np.asarray(part), item.data)


def _without_derived(basis: ModalBasis, speed: SpeedBasis) -> SpeedBasis:
    """Data over speed without the matrices of standstill that follow from the basis."""
    follows: Any = basis.with_speed(speed.stiffness2, speed.residual2, speed.omega_ref).speed
    known = [key for key in ("stiffness0", "residual0") if np.array_equal(getattr(speed, key), getattr(follows, key))]
    return replace(speed, **dict.fromkeys(known))  # type: ignore[arg-type]


def new_group(parent: h5py.Group, name: str) -> h5py.Group:
    """A subgroup that remembers the order of its members, so that a model comes back in the order it had."""
    return parent.create_group(name, track_order=True)


def write_array(group: h5py.Group, name: str, array: NDArray, data: Data) -> None:
    """A dataset with its units."""
    array = array.astype(_SINGLE[array.dtype.kind]) if data.kind == "picture" else array
    large = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    dataset = group.create_dataset(name, data=array, **large if array.nbytes > COMPRESS_FROM else {})
    write_text(dataset, "units", data.units)


def _write_attribute(group: h5py.Group, item: Item, value: Any) -> None:
    """A text or a number; the ports of a body are texts."""
    if get_origin(item.kind) is tuple:
        write_text(group, item.file, [".".join(port) for port in value])
    elif item.kind in (int, float):
        group.attrs[item.file] = item.kind(value)
    else:
        write_text(group, item.file, value)


def write_text(owner: h5py.Group | h5py.Dataset, name: str, text: str | list[str]) -> None:
    """A text attribute, or one of several texts, of fixed length: simple to read from C, Fortran or MATLAB.

    HDF5 keeps texts of variable length in a heap whose reader can run on forever if a byte of it is damaged.
    """
    encoded = np.array(text.encode() if isinstance(text, str) else [part.encode() for part in text], dtype="S")
    owner.attrs.create(name, encoded, dtype=h5py.string_dtype(length=encoded.dtype.itemsize or 1))


# -----------------------------------------------------------------------------------------------------------
# Reading


def place(parent: h5py.Group | h5py.Dataset, name: str = "") -> str:
    """How a message names something in a file: ``file: /path/in/the/file``."""
    path = f"{parent.name.rstrip('/')}/{name}" if name else parent.name
    return f"{parent.file.filename}: {path}"


def read_record(group: h5py.Group, kind: Kind, sizes: Sizes | None = None, ports: Mapping[str, int] | None = None) -> Any:
    """The record that :func:`write_record` has written.

    Parameters
    ----------
    group : h5py.Group
    kind : dataclass
    sizes : dict of str to int, optional
        Sizes that are known.
    ports : mapping of name to int, optional
        Contact points of each port of the body.
    """
    sizes = dict(sizes or {})
    if kind is LocalBasis:
        counts = {name: read_number(group, name, int) for name in LOCAL_SIZES}
        check(min(counts.values()) >= 0, place(group), "numbers of shapes >= 0", counts)
        sizes |= {**counts, "n": sum(counts.values()), "n_diameters": None}
    _check_names(group, layout(kind))
    values: dict[str, Any] = {"name": group.name.rsplit("/", 1)[-1]} if "name" in declarations(kind) else {}
    for item in by_rank(kind):
        if item.is_attribute:
            if item.required or item.file in group.attrs:
                values[item.name] = read_attribute(group, item)
        elif (found := _read_item(group, item, sizes, ports or {})) is not None:
            values[item.name] = found
    if kind is SpeedBasis:
        return values
    speed = values.pop("speed", None)
    return kind(**values) if speed is None else _with_speed(group, kind(**values), speed)


def _check_names(group: h5py.Group, items: Iterable[Item]) -> None:
    """Everything that must be in a group of a record is there, and nothing else."""
    diameters = diameter_groups(group).values()
    stored = [(item.required, *item.file.partition("/")[::2]) for item in items if not item.is_attribute]
    names = [name for _, head, _ in stored for name in (diameters if head == "*" else [head])]
    check_members(group, [head for needed, head, _ in stored if needed and head != "*"], names)
    rows = {tail: needed for needed, head, tail in stored if head == "*" and tail}
    check(diameters or not rows, place(group), "a group nd000, nd001, ... for each nodal diameter", "none")
    for name in diameters if rows else ():
        check_members(subgroup(group, name), [tail for tail, needed in rows.items() if needed], rows)


def _read_item(group: h5py.Group, item: Item, sizes: Sizes, ports: Mapping[str, int]) -> Any:
    """The value of a field; None if the file has none."""
    if "*" not in item.file:
        return _read_value(group, item.file, item, sizes, ports) if item.file in group else None
    head, _, tail = item.file.partition("*")
    if head and head[:-1] not in group:
        return None
    own = subgroup(group, head[:-1]) if head else group
    if item.keys is None:
        check_members(own, ports, [])
        shape = known_shape(item.data.shape[1:], sizes)
        parts = [_read_value(own, name, item, sizes | {"n_points": n}, ports) for name, n in ports.items()]
        return np.concatenate([np.zeros((0, *(n or 0 for n in shape))), *parts])
    names = diameter_groups(own) if item.keys is int else {name: name for name in own}
    if head:
        check_members(own, [], names.values())
    return {key: _read_value(own, n + tail, item, sizes, ports) for key, n in names.items() if n + tail in own}


def _read_value(group: h5py.Group, name: str, item: Item, sizes: Sizes, ports: Mapping[str, int]) -> Any:
    if item.is_record:
        return read_record(subgroup(group, name), item.kind, sizes, ports)
    head, _, leaf = name.rpartition("/")
    array = read_array(subgroup(group, head) if head else group, leaf, item.data, sizes)
    return array if item.kind is np.ndarray else item.kind(array)


def _with_speed(group: h5py.Group, basis: ModalBasis, speed: dict[str, Any]) -> ModalBasis:
    """The basis with its data over speed; those of standstill follow from it."""
    one, other = place(group, "speed/residual2"), place(group, "speed/residual0")
    check("residual2" in speed or "residual0" not in speed, one, "this dataset beside residual0", "nothing")
    follows = "residual2" not in speed or "residual0" in speed or basis.flexibility is not None
    check(follows, other, "this dataset where the basis has no flexibility", "nothing")
    made: Any = basis.with_speed(speed["stiffness2"], speed.get("residual2"), speed["omega_ref"])
    return replace(basis, speed=replace(made.speed, **speed))


def diameter_groups(group: h5py.Group) -> dict[int, str]:
    """Names of the members ``nd000``, ``nd001``, ... by nodal diameter."""
    return {int(name[2:]): name for name in group if re.fullmatch(r"nd\d{3,9}", name, re.ASCII)}


def check_members(group: h5py.Group, required: Iterable[str], optional: Iterable[str]) -> None:
    """Everything required is there, nothing unknown is, and nothing points elsewhere."""
    required = list(required)
    known = list(dict.fromkeys([*required, *optional]))
    for name in required:
        check(name in group, place(group, name), "this group or dataset", "nothing")
    for name in group:
        check(name in known, place(group, name), f"no other names than {known}", "this one")
        check_link(group, name)


def check_link(group: h5py.Group, name: str) -> None:
    link = group.get(name, getlink=True)
    good = isinstance(link, h5py.HardLink)
    check(good, place(group, name), "a group or dataset in this place", f"a {type(link).__name__}")


def subgroup(group: h5py.Group, name: str) -> h5py.Group:
    check_link(group, name)
    member = group[name]
    check(isinstance(member, h5py.Group), place(group, name), "a group", f"a {type(member).__name__.lower()}")
    return member


def read_array(group: h5py.Group, name: str, data: Data, sizes: Sizes) -> NDArray:
    """A dataset as an array of native double precision (or int64, bool)."""
    check_link(group, name)
    dataset = group[name]
    item = place(group, name)
    check(isinstance(dataset, h5py.Dataset), item, "a dataset", f"a {type(dataset).__name__.lower()}")
    check_storage(dataset, item)
    letters, words = TYPES[data.kind]
    check(dataset.dtype.kind in letters, item, words, f"data of type {dataset.dtype}")
    check_text(dataset, "units", data.units)
    shape = known_shape(data.shape, sizes)
    check(fits(dataset.shape, shape), item, f"shape {shape_text(shape)}", f"{dataset.shape}")
    learn(data.shape, dataset.shape, sizes)
    array = np.asarray(dataset[()])
    return array.astype(_NATIVE[array.dtype.kind], copy=False)


def read_attribute(group: h5py.Group, item: Item) -> Any:
    """A text or a number; the ports of a body as pairs of texts."""
    if item.kind in (int, float):
        return read_number(group, item.file, item.kind)
    return (read_ports if get_origin(item.kind) is tuple else read_text)(group, item.file)


def read_ports(group: h5py.Group, name: str) -> tuple[tuple[str, ...], ...]:
    item = place(group, f"@{name}")
    ports = [as_text(text, item).rpartition(".") for text in np.atleast_1d(attribute(group, name)).ravel()]
    for interface, dot, side in ports:
        good = bool(dot) and side in ("a", "b")
        check(good, item, "texts like 'interface.a' or 'interface.b'", f"'{interface}{dot}{side}'")
    return tuple((interface, side) for interface, _, side in ports)


def check_storage(dataset: h5py.Dataset, item: str) -> None:
    """The numbers lie in this file, and there are no more of them than its bytes can hold."""
    elsewhere = dataset.is_virtual or dataset.external is not None
    check(not elsewhere, item, "numbers stored in this file", "a reference to other files")
    check(dataset.shape is not None, item, "numbers", "an empty dataset")
    stored = dataset.id.get_storage_size()
    wanted = dataset.size * dataset.dtype.itemsize
    within = wanted <= MOST_EXPANDED * stored
    check(within, item, f"{wanted} bytes for shape {dataset.shape}", f"{stored} bytes in the file")


def check_text(owner: h5py.Group | h5py.Dataset, name: str, expected: str) -> None:
    found = read_text(owner, name)
    check(found == expected, place(owner, f"@{name}"), f"'{expected}'", f"'{found}'")


def attribute(owner: h5py.Group | h5py.Dataset, name: str) -> Any:
    check(name in owner.attrs, place(owner, f"@{name}"), "this attribute", "nothing")
    return owner.attrs[name]


def read_text(owner: h5py.Group | h5py.Dataset, name: str) -> str:
    return as_text(attribute(owner, name), place(owner, f"@{name}"))


def as_text(value: Any, item: str) -> str:
    """A text, also if stored with fixed length or as an array of one element."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    check(isinstance(value, str), item, "a text", repr(value))
    return str(value)


def read_number(owner: h5py.Group | h5py.Dataset, name: str, kind: type[float] = float) -> Any:
    """One finite number, or one integer."""
    letters, expected = ("iu", "one integer") if kind is int else ("fiu", "one finite number")
    given = attribute(owner, name)
    value = np.asarray(given)
    good = value.dtype.kind in letters and value.size == 1 and np.isfinite(value).all()
    check(good, place(owner, f"@{name}"), expected, repr(given))
    return kind(value.item())


# ---- The model file ----


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
    with write_hdf5(path, track_order=True) as file:
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
    check(not Path(path).is_dir(), str(path), "a model file", "a folder")
    with read_hdf5(path, "a readable HDF5 file", ModelError) as file:
        model = read_model(file)
    check_model(model, where=str(path))
    return as_checked(model)


register_reader(FORMAT, load_model)


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
        check(name in interfaces, place(group, "@ports"), f"an interface of {list(interfaces)}", f"'{name}'")
    points = {".".join(port): interfaces[port[0]].n_points for port in ports}
    n = sum(points.values())
    return read_record(group, Body, {"n_points": n, "n_forces": 3 * n}, points)


def _check_root(file: h5py.Group) -> None:
    """Format, version and conventions; nothing else is looked at before these fit."""
    found = read_text(file, "format")
    other = f"'{found}': bd.load reads results" if found.startswith("bdamper-") else f"'{found}'"
    check(found == FORMAT, place(file, "@format"), f"'{FORMAT}'", other)
    version = read_number(file, "version", int)
    check(version == VERSION, place(file, "@version"), f"{VERSION}", f"{version}")
    check_text(file, "time_convention", TIME_CONVENTION)
    check_text(file, "phase_convention", PHASE_CONVENTION)
    axis = np.asarray(attribute(file, "axis"))
    good = axis.dtype.kind in "fiu" and np.array_equal(axis, AXIS)
    check(good, place(file, "@axis"), f"{list(AXIS)}", f"{axis.tolist()!r}")
    needed = [group.place() for group in RECORDS if group.required]
    check_members(file, needed, [*(group.place() for group in RECORDS), "provenance"])


def _read_provenance(file: h5py.Group) -> dict[str, str]:
    if "provenance" not in file:
        return {}
    group = subgroup(file, "provenance")
    check_members(group, [], [])
    return {key: read_text(group, key) for key in group.attrs}
