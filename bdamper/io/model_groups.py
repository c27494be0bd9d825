"""Groups, datasets and attributes of a model file, written and read with their units and checked as they are read."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from typing import Any, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from bdamper.model.checks import fits, shape_text
from bdamper.util.errors import mismatch

UNITS = {
    "omega2": "rad2/s2",
    "damping_ratio": "1",
    "drag": "1/s",
    "modes": "kg^-1/2",
    "locations": "kg^-1/2",
    "flexibility": "m/N",
    "mass": "kg",
    "centre": "m",
    "inertia": "kg m2",
    "constant_force": "N kg^-1/2",
    "direction": "1",
    "generalised": "kg^-1/2",
    "displacement": "m/N",
    "points": "m",
    "area": "m2",
    "frame": "1",
    "gap": "m",
    "position": "m",
    "stiffness": "N/m",
    "fallback": "1",
    "force": "N",
    "displacement_a": "m",
    "displacement_b": "m",
    "quads": "1",
    "stiffness0": "rad2/s2",
    "stiffness2": "1",
    "coriolis": "1",
    "residual0": "m/N",
    "residual2": "m s2/N",
    "spin": "m s2",
    "blade_stiffness": "rad2/s2",
    "blade_mass": "1",
    "disk_stiffness": "rad2/s2",
    "disk_mass": "1",
    "mode_stress": "Pa m^-1 kg^-1/2",
    "contact_stress": "Pa/N",
    "static_stress": "Pa s2",
    "spread": "1",
    "near_contact": "1",
}
"""Units of every dataset, by its name (by the name of its group for modes, locations, spin)."""

COMPRESS_FROM = 4096  # bytes; below this a dataset is stored plainly
LARGEST_EXPANSION = 1100  # deflate cannot compress by more than a factor of 1032

_TYPES = {
    "real": ("f", "real numbers"),
    "field": ("fc", "real or complex numbers"),
    "integer": ("iu", "integers"),
    "bool": ("b", "booleans"),
}
_TYPE_OF = {"modes": "field", "locations": "field", "flexibility": "field", "quads": "integer", "fallback": "bool"} | {
    "mode_stress": "field", "contact_stress": "field", "near_contact": "bool",
    "stiffness0": "field", "stiffness2": "field", "coriolis": "field", "residual0": "field", "residual2": "field",
    "disk_stiffness": "field", "disk_mass": "field",
}  # fmt: skip
_SHAPE_OF: dict[str, tuple[int | None, ...]] = {"omega2": (None,), "area": (None,), "mass": ()}


@dataclass(frozen=True)
class Part:
    """What a group holds, by the names of the fields of its class.

    Parameters
    ----------
    kind : dataclass
    texts, integers : tuple of str
        Attributes.
    arrays, optional : tuple of str
        Datasets that must, and that may be there.
    """

    kind: Callable[..., Any]
    texts: tuple[str, ...] = ()
    integers: tuple[str, ...] = ()
    arrays: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()


# -----------------------------------------------------------------------------------------------------------
# Writing


def write_part(group: h5py.Group, part: Part, record: Any) -> None:
    for key in part.texts:
        write_text(group, key, getattr(record, key))
    for key in part.integers:
        group.attrs[key] = int(getattr(record, key))
    for key in (*part.arrays, *part.optional):
        if getattr(record, key) is not None:
            write_array(group, key, getattr(record, key))


def new_group(parent: h5py.Group, name: str) -> h5py.Group:
    """A subgroup that remembers the order of its members, so that a model comes back in the order it had."""
    return parent.create_group(name, track_order=True)


def write_array(group: h5py.Group, name: str, array: NDArray, key: str = "") -> None:
    """A dataset with its units, those of ``key`` if its name is free."""
    options: dict[str, Any] = {}
    if array.nbytes > COMPRESS_FROM:
        options = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    dataset = group.create_dataset(name, data=array, **options)
    write_text(dataset, "units", UNITS[key or name])


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
    check_members(group, part.arrays, part.optional)
    named = any(field.name == "name" for field in fields(cast(Any, part.kind)))
    values: dict[str, Any] = {"name": own_name(group)} if named else {}
    values |= {key: read_text(group, key) for key in part.texts}
    values |= {key: read_integer(group, key) for key in part.integers}
    values |= {key: read_array(group, key) for key in (*part.arrays, *part.optional) if key in group}
    return part.kind(**values)


def own_name(group: h5py.Group) -> str:
    return cast(str, group.name).rsplit("/", 1)[-1]


def check_members(group: h5py.Group, required: Iterable[str], optional: Iterable[str]) -> None:
    """Everything required is there, nothing unknown is, and nothing points elsewhere."""
    required = list(required)
    known = [*required, *optional]
    for name in required:
        if name not in group:
            raise mismatch(place(group, name), "this group or dataset", "nothing")
    for name in group:
        if name not in known:
            raise mismatch(place(group, name), f"no other names than {known}", "this one")
        check_link(group, name)


def check_link(group: h5py.Group, name: str) -> None:
    link = group.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink):
        raise mismatch(place(group, name), "a group or dataset in this place", f"a {type(link).__name__}")


def subgroup(group: h5py.Group, name: str) -> h5py.Group:
    check_link(group, name)
    member = group[name]
    if not isinstance(member, h5py.Group):
        raise mismatch(place(group, name), "a group", f"a {type(member).__name__.lower()}")
    return member


def subgroups(file: h5py.File, name: str) -> dict[str, h5py.Group]:
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
    if not isinstance(dataset, h5py.Dataset):
        raise mismatch(item, "a dataset", f"a {type(dataset).__name__.lower()}")
    check_storage(dataset, item)
    letters, words = _TYPES[_TYPE_OF.get(key or name, "real")]
    if dataset.dtype.kind not in letters:
        raise mismatch(item, words, f"data of type {dataset.dtype}")
    check_text(dataset, "units", UNITS[key or name])
    shape = shape or _SHAPE_OF.get(name)
    if shape is not None and not fits(dataset.shape, shape):
        raise mismatch(item, f"shape {shape_text(shape)}", f"{dataset.shape}")
    array = np.asarray(dataset[()])
    native = {"f": np.float64, "c": np.complex128, "i": np.int64, "u": np.int64, "b": np.bool_}
    return array.astype(native[array.dtype.kind], copy=False)


def check_storage(dataset: h5py.Dataset, item: str) -> None:
    """The numbers lie in this file, and there are no more of them than its bytes can hold."""
    if dataset.is_virtual or dataset.external is not None:
        raise mismatch(item, "numbers stored in this file", "a reference to other files")
    if dataset.shape is None:
        raise mismatch(item, "numbers", "an empty dataset")
    stored = dataset.id.get_storage_size()
    wanted = dataset.size * dataset.dtype.itemsize
    if wanted > LARGEST_EXPANSION * stored:
        raise mismatch(item, f"{wanted} bytes for shape {dataset.shape}", f"{stored} bytes in the file")


def check_text(owner: h5py.Group | h5py.Dataset, name: str, expected: str) -> None:
    found = read_text(owner, name)
    if found != expected:
        raise mismatch(place(owner, f"@{name}"), f"'{expected}'", f"'{found}'")


def attribute(owner: h5py.Group | h5py.Dataset, name: str) -> Any:
    if name not in owner.attrs:
        raise mismatch(place(owner, f"@{name}"), "this attribute", "nothing")
    return owner.attrs[name]


def read_text(owner: h5py.Group | h5py.Dataset, name: str) -> str:
    return as_text(attribute(owner, name), place(owner, f"@{name}"))


def as_text(value: Any, item: str) -> str:
    """A text, also if stored with fixed length or as an array of one element."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    if not isinstance(value, str):
        raise mismatch(item, "a text", repr(value))
    return str(value)


def read_integer(owner: h5py.Group | h5py.Dataset, name: str) -> int:
    value = np.asarray(attribute(owner, name))
    if value.dtype.kind not in "iu" or value.size != 1:
        raise mismatch(place(owner, f"@{name}"), "one integer", repr(attribute(owner, name)))
    return int(value.reshape(-1)[0])
