"""Groups, datasets and attributes of a model file, written and read with their units and checked as they are read."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from bdamper.io.reading import MOST_EXPANDED
from bdamper.model.checks import fits, require, shape_text

_TYPES = {
    "real": ("f", "real numbers"),
    "field": ("fc", "real or complex numbers"),
    "integer": ("iu", "integers"),
    "bool": ("b", "booleans"),
}


@dataclass(frozen=True)
class Data:
    """What a dataset holds: its units, the type of its numbers, and its shape where the format fixes it."""

    units: str
    kind: Literal["real", "field", "integer", "bool"] = "real"
    shape: tuple[int | None, ...] | None = None


DATASETS = {
    "omega2": Data("rad2/s2", shape=(None,)),
    "damping_ratio": Data("1"),
    "drag": Data("1/s"),
    "modes": Data("kg^-1/2", "field"),
    "locations": Data("kg^-1/2", "field"),
    "flexibility": Data("m/N", "field"),
    "mass": Data("kg", shape=()),
    "centre": Data("m"),
    "inertia": Data("kg m2"),
    "constant_force": Data("N kg^-1/2"),
    "direction": Data("1"),
    "generalised": Data("kg^-1/2"),
    "displacement": Data("m/N"),
    "points": Data("m"),
    "area": Data("m2", shape=(None,)),
    "frame": Data("1"),
    "gap": Data("m"),
    "position": Data("m"),
    "stiffness": Data("N/m"),
    "fallback": Data("1", "bool"),
    "force": Data("N"),
    "displacement_a": Data("m"),
    "displacement_b": Data("m"),
    "quads": Data("1", "integer"),
    "stiffness0": Data("rad2/s2", "field"),
    "stiffness2": Data("1", "field"),
    "coriolis": Data("1", "field"),
    "residual0": Data("m/N", "field"),
    "residual2": Data("m s2/N", "field"),
    "spin": Data("m s2"),
    "blade_stiffness": Data("rad2/s2"),
    "blade_mass": Data("1"),
    "disk_stiffness": Data("rad2/s2", "field"),
    "disk_mass": Data("1", "field"),
    "mode_stress": Data("Pa m^-1 kg^-1/2", "field"),
    "contact_stress": Data("Pa/N", "field"),
    "static_stress": Data("Pa s2"),
    "spread": Data("1"),
    "near_contact": Data("1", "bool"),
}
"""Every dataset by its name (by the name of its group for modes, locations, spin)."""

COMPRESS_FROM = 4096  # bytes; below this a dataset is stored plainly


@dataclass(frozen=True)
class Part:
    """What a group holds, by the names of the fields of its class.

    Parameters
    ----------
    kind : dataclass
    texts, integers, numbers : tuple of str
        Attributes; a number that is None is left out.
    arrays, optional : tuple of str
        Datasets that must, and that may be there.
    """

    kind: Callable[..., Any]
    texts: tuple[str, ...] = ()
    integers: tuple[str, ...] = ()
    numbers: tuple[str, ...] = ()
    arrays: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()


# -----------------------------------------------------------------------------------------------------------
# Writing


def write_part(group: h5py.Group, part: Part, record: Any) -> None:
    """Attributes and datasets of a record, in the order in which the part names them."""
    for key in part.texts:
        write_text(group, key, getattr(record, key))
    for key in part.integers:
        group.attrs[key] = int(getattr(record, key))
    for key in part.numbers:
        if getattr(record, key) is not None:
            group.attrs[key] = float(getattr(record, key))
    for key in (*part.arrays, *part.optional):
        if getattr(record, key) is not None:
            write_array(group, key, getattr(record, key))


def write_rows(
    group: h5py.Group, name: str, ports: Mapping[str, slice], contact: NDArray, locations: Mapping[str, NDArray],
    key: str = "",
) -> None:  # fmt: skip
    """Values at contact points, a dataset for each port (name and rows), and at locations; ``key`` as in `write_array`."""
    points, places = new_group(group, name), new_group(group, "locations")
    for port, rows in ports.items():
        write_array(points, port, contact[rows], key or name)
    for place_, values in locations.items():
        write_array(places, place_, values, key or "locations")


def new_group(parent: h5py.Group, name: str) -> h5py.Group:
    """A subgroup that remembers the order of its members, so that a model comes back in the order it had."""
    return parent.create_group(name, track_order=True)


def write_array(group: h5py.Group, name: str, array: NDArray, key: str = "") -> None:
    """A dataset with its units, those of ``key`` if its name is free."""
    options: dict[str, Any] = {}
    if array.nbytes > COMPRESS_FROM:
        options = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    dataset = group.create_dataset(name, data=array, **options)
    write_text(dataset, "units", DATASETS[key or name].units)


def write_text(owner: h5py.Group | h5py.Dataset, name: str, text: str) -> None:
    """A text attribute of fixed length: simple to read from C, Fortran or MATLAB.

    HDF5 keeps texts of variable length in a heap whose reader can run on forever if a byte of it is damaged.
    """
    encoded = text.encode()
    kind = h5py.string_dtype(length=max(len(encoded), 1))
    owner.attrs.create(name, np.array(encoded, dtype=kind), dtype=kind)


# -----------------------------------------------------------------------------------------------------------
# Reading


def place(parent: h5py.Group | h5py.Dataset, name: str = "") -> str:
    """How a message names something in a file: ``file: /path/in/the/file``."""
    path = f"{parent.name.rstrip('/')}/{name}" if name else parent.name
    return f"{parent.file.filename}: {path}"


def read_part(group: h5py.Group, part: Part) -> Any:
    """The record that :func:`write_part` has written."""
    check_members(group, part.arrays, part.optional)
    return part.kind(**read_fields(group, part))


def read_fields(group: h5py.Group, part: Part) -> dict[str, Any]:
    """The values of the fields of a part that are there."""
    named = any(field.name == "name" for field in fields(cast(Any, part.kind)))
    values: dict[str, Any] = {"name": group.name.rsplit("/", 1)[-1]} if named else {}
    values |= {key: read_text(group, key) for key in part.texts}
    values |= {key: read_integer(group, key) for key in part.integers}
    values |= {key: read_number(group, key) for key in part.numbers if key in group.attrs}
    return values | {key: read_array(group, key) for key in (*part.arrays, *part.optional) if key in group}


def read_rows(
    group: h5py.Group, name: str, ports: Mapping[str, int], rest: tuple[int, ...] = (), key: str = ""
) -> tuple[NDArray, dict[str, NDArray]]:
    """What :func:`write_rows` has written, of ports with so many contact points: (n_points, 3, ...), (3, ...) by name."""
    points = subgroup(group, name)
    check_members(points, ports, [])
    parts = [read_array(points, port, key or name, (n, 3, *rest)) for port, n in ports.items()]
    contact = np.concatenate(parts) if parts else np.zeros((0, 3, *rest))
    if "locations" not in group:
        return contact, {}
    places = subgroup(group, "locations")
    return contact, {place_: read_array(places, place_, key or "locations", (3, *rest)) for place_ in places}


def diameter_groups(group: h5py.Group) -> dict[int, str]:
    """Names of the members ``nd000``, ``nd001``, ... by nodal diameter."""
    return {int(name[2:]): name for name in group if re.fullmatch(r"nd\d{3,9}", name, re.ASCII)}


def check_members(group: h5py.Group, required: Iterable[str], optional: Iterable[str]) -> None:
    """Everything required is there, nothing unknown is, and nothing points elsewhere."""
    required = list(required)
    known = [*required, *optional]
    for name in required:
        require(name in group, place(group, name), "this group or dataset", "nothing")
    for name in group:
        require(name in known, place(group, name), f"no other names than {known}", "this one")
        check_link(group, name)


def check_link(group: h5py.Group, name: str) -> None:
    link = group.get(name, getlink=True)
    good = isinstance(link, h5py.HardLink)
    require(good, place(group, name), "a group or dataset in this place", f"a {type(link).__name__}")


def subgroup(group: h5py.Group, name: str) -> h5py.Group:
    check_link(group, name)
    member = group[name]
    require(isinstance(member, h5py.Group), place(group, name), "a group", f"a {type(member).__name__.lower()}")
    return member


def subgroups(file: h5py.Group, name: str) -> dict[str, h5py.Group]:
    """All groups inside a group; empty if that group is absent (only the optional ones can be)."""
    if name not in file:
        return {}
    parent = subgroup(file, name)
    return {key: subgroup(parent, key) for key in parent}


def read_array(group: h5py.Group, name: str, key: str = "", shape: tuple[int | None, ...] | None = None) -> NDArray:
    """A dataset as an array of native double precision (or int64, bool), of the type and units of ``key`` or its name."""
    check_link(group, name)
    dataset = group[name]
    item = place(group, name)
    require(isinstance(dataset, h5py.Dataset), item, "a dataset", f"a {type(dataset).__name__.lower()}")
    check_storage(dataset, item)
    data = DATASETS[key or name]
    letters, words = _TYPES[data.kind]
    require(dataset.dtype.kind in letters, item, words, f"data of type {dataset.dtype}")
    check_text(dataset, "units", data.units)
    shape = data.shape if shape is None else shape
    if shape is not None:
        require(fits(dataset.shape, shape), item, f"shape {shape_text(shape)}", f"{dataset.shape}")
    array = np.asarray(dataset[()])
    native = {"f": np.float64, "c": np.complex128, "i": np.int64, "u": np.int64, "b": np.bool_}
    return array.astype(native[array.dtype.kind], copy=False)


def check_storage(dataset: h5py.Dataset, item: str) -> None:
    """The numbers lie in this file, and there are no more of them than its bytes can hold."""
    elsewhere = dataset.is_virtual or dataset.external is not None
    require(not elsewhere, item, "numbers stored in this file", "a reference to other files")
    require(dataset.shape is not None, item, "numbers", "an empty dataset")
    stored = dataset.id.get_storage_size()
    wanted = dataset.size * dataset.dtype.itemsize
    within = wanted <= MOST_EXPANDED * stored
    require(within, item, f"{wanted} bytes for shape {dataset.shape}", f"{stored} bytes in the file")


def check_text(owner: h5py.Group | h5py.Dataset, name: str, expected: str) -> None:
    found = read_text(owner, name)
    require(found == expected, place(owner, f"@{name}"), f"'{expected}'", f"'{found}'")


def attribute(owner: h5py.Group | h5py.Dataset, name: str) -> Any:
    require(name in owner.attrs, place(owner, f"@{name}"), "this attribute", "nothing")
    return owner.attrs[name]


def read_text(owner: h5py.Group | h5py.Dataset, name: str) -> str:
    return as_text(attribute(owner, name), place(owner, f"@{name}"))


def as_text(value: Any, item: str) -> str:
    """A text, also if stored with fixed length or as an array of one element."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    require(isinstance(value, str), item, "a text", repr(value))
    return str(value)


def read_integer(owner: h5py.Group | h5py.Dataset, name: str) -> int:
    return int(_single(owner, name, "iu", "one integer"))


def read_number(owner: h5py.Group | h5py.Dataset, name: str) -> float:
    value = float(_single(owner, name, "fiu", "one finite number"))
    require(np.isfinite(value), place(owner, f"@{name}"), "one finite number", repr(attribute(owner, name)))
    return value


def _single(owner: h5py.Group | h5py.Dataset, name: str, letters: str, expected: str) -> Any:
    value = np.asarray(attribute(owner, name))
    good = value.dtype.kind in letters and value.size == 1
    require(good, place(owner, f"@{name}"), expected, repr(attribute(owner, name)))
    return value.reshape(-1)[0]
