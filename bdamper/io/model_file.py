"""The model file: a :class:`~bdamper.model.model.Model` in HDF5.

The layout follows the classes one to one and is described in ``docs/model-file.md``, with an example of how to write such
a file with h5py alone.  The reader checks the container: which groups and datasets there must be, of which type, in which
units.  The numbers are checked by :func:`~bdamper.model.validation.check_model`, for files and for models built in memory
alike.

A file holds all its data: links to other files, external storage and virtual datasets are refused, and so is every name
that is not part of the format, since a misspelt optional dataset would otherwise go unnoticed.  Additional attributes are
ignored.
"""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from bdamper.model.checks import fits, shape_text
from bdamper.model.model import (
    Body,
    BodyLoad,
    ContactStiffness,
    Interface,
    Location,
    ModalBasis,
    Model,
    Port,
    StaticContact,
    SurfaceMesh,
)
from bdamper.model.validation import check_model
from bdamper.util import validate
from bdamper.util.errors import ModelError, SettingError, mismatch
from bdamper.util.hdf5 import check_folder, enter_reader

FORMAT = "bdamper-model"
VERSION = 1
AXIS = (0.0, 0.0, 1.0)
TIME_CONVENTION = "exp(+i omega t)"
PHASE_CONVENTION = "u(k+1) = Rz(-2 pi/N) u(k) exp(+i 2 pi d/N), k toward +X"

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
}
"""Units of every dataset, by its name (by the name of its group for modes and locations)."""

_COMPRESS_FROM = 4096  # bytes; below this a dataset is stored plainly
_LARGEST_EXPANSION = 1100  # deflate cannot compress by more than a factor of 1032
_LONGEST_ATTRIBUTE = 60000  # bytes; HDF5 has room for 64 KiB

_TYPES = {
    "real": ("f", "real numbers"),
    "field": ("fc", "real or complex numbers"),
    "integer": ("iu", "integers"),
    "bool": ("b", "booleans"),
}
_TYPE_OF = {"modes": "field", "locations": "field", "flexibility": "field", "quads": "integer", "fallback": "bool"}
_SHAPE_OF: dict[str, tuple[int | None, ...]] = {"omega2": (None,), "area": (None,), "mass": ()}


@dataclass(frozen=True)
class _Part:
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


_LOAD = _Part(BodyLoad, arrays=("direction", "generalised", "displacement"))
_PARTS = {
    "interfaces": _Part(
        Interface, ("kind", "body_a", "body_b"), ("sector_a", "sector_b"), ("points", "area", "frame", "gap")
    ),
    "locations": _Part(Location, texts=("body",), arrays=("position",)),
    "contact": _Part(ContactStiffness, texts=("source",), arrays=("stiffness",), optional=("fallback",)),
    "static": _Part(StaticContact, arrays=("force", "displacement_a", "displacement_b")),
}
"""Groups of the file and fields of the model whose members are written alike."""


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
        If the model does not pass :func:`~bdamper.model.validation.check_model`.
    BdamperError
        If its directory does not exist.
    OSError
        If the file cannot be written; an existing file is then unchanged.
    """
    check_model(model)
    _check_attribute_lengths(model)
    check_folder(path)
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(6)}.tmp")
    try:
        with h5py.File(temporary, "x", track_order=True) as file:
            _write_model(file, model)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def _check_attribute_lengths(model: Model) -> None:
    for key, value in model.provenance.items():
        if len(key.encode()) + len(value.encode()) > _LONGEST_ATTRIBUTE:
            found = f"{len(value.encode())} bytes in '{key[:40]}'"
            raise mismatch("model: /provenance", f"texts of at most {_LONGEST_ATTRIBUTE} bytes", found)


def _write_model(file: h5py.File, model: Model) -> None:
    _write_text(file, "format", FORMAT)
    file.attrs["version"] = VERSION
    file.attrs["n_blades"] = int(model.n_blades)
    file.attrs["axis"] = np.array(AXIS)
    _write_text(file, "time_convention", TIME_CONVENTION)
    _write_text(file, "phase_convention", PHASE_CONVENTION)
    bodies = _new_group(file, "bodies")
    for name, body in model.bodies.items():
        _write_body(_new_group(bodies, name), model, body)
    for key, part in _PARTS.items():
        parent = _new_group(file, key)
        for name, record in getattr(model, key).items():
            _write_part(_new_group(parent, name), part, record)
    meshes = _new_group(file, "mesh")
    for name, mesh in model.meshes.items():
        _write_mesh(_new_group(meshes, name), mesh)
    provenance = file.create_group("provenance")
    for key, value in model.provenance.items():
        _write_text(provenance, key, value)


def _write_part(group: h5py.Group, part: _Part, record: Any) -> None:
    for key in part.texts:
        _write_text(group, key, getattr(record, key))
    for key in part.integers:
        group.attrs[key] = int(getattr(record, key))
    for key in (*part.arrays, *part.optional):
        if getattr(record, key) is not None:
            _write(group, key, getattr(record, key))


def _write_mesh(group: h5py.Group, mesh: SurfaceMesh) -> None:
    _write(group, "points", mesh.points)
    _write(group, "quads", mesh.quads)
    if mesh.modes:
        modes = _new_group(group, "modes")
        for diameter, shapes in mesh.modes.items():
            single = np.complex64 if shapes.dtype.kind == "c" else np.float32  # enough for pictures
            _write(modes, f"nd{diameter:03d}", shapes.astype(single), "modes")


def _write_body(group: h5py.Group, model: Model, body: Body) -> None:
    _write_text(group, "kind", body.kind)
    ports = [f"{interface}.{side}".encode() for interface, side in body.ports]
    longest = max((len(port) for port in ports), default=1)
    group.attrs.create("ports", np.array(ports, dtype=f"S{longest}"), dtype=h5py.string_dtype(length=longest))
    for key in ("mass", "centre", "inertia", "constant_force"):
        value = getattr(body, key)
        if value is not None:
            _write(group, key, np.asarray(value, dtype=float))
    for d, basis in body.bases.items():
        _write_basis(_new_group(group, f"nd{d:03d}"), model, body, basis)
    if body.load is not None:
        _write_part(_new_group(group, "load"), _LOAD, body.load)


def _write_basis(group: h5py.Group, model: Model, body: Body, basis: ModalBasis) -> None:
    _write(group, "omega2", basis.omega2)
    _write(group, "damping_ratio", basis.damping_ratio)
    modes = _new_group(group, "modes")
    for port in body.ports:
        rows = model.port_slice(body.name, port)
        _write(modes, f"{port[0]}.{port[1]}", basis.contact_modes[rows], "modes")
    locations = _new_group(group, "locations")
    for name, values in basis.locations.items():
        _write(locations, name, values, "locations")
    if basis.flexibility is not None:
        _write(group, "flexibility", basis.flexibility)
    if basis.drag is not None:
        _write(group, "drag", basis.drag)


def _new_group(parent: h5py.Group, name: str) -> h5py.Group:
    """A subgroup that remembers the order of its members, so that a model comes back in the order it had."""
    return parent.create_group(name, track_order=True)


def _write(group: h5py.Group, name: str, array: NDArray, key: str = "") -> None:
    """A dataset with its units, those of ``key`` if its name is free."""
    options: dict[str, Any] = {}
    if array.nbytes > _COMPRESS_FROM:
        options = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    dataset = group.create_dataset(name, data=array, **options)
    _write_text(dataset, "units", UNITS[key or name])


def _write_text(owner: h5py.Group | h5py.Dataset, name: str, text: str) -> None:
    """A text attribute of fixed length: simple to read from C, Fortran or MATLAB.

    HDF5 keeps texts of variable length in a heap whose reader can run on forever if a byte of it is damaged.
    """
    encoded = text.encode()
    kind = h5py.string_dtype(length=max(len(encoded), 1))
    owner.attrs.create(name, np.array(encoded, dtype=kind), dtype=kind)


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
        :func:`~bdamper.model.validation.check_model`.
    """
    source = Path(path)
    if not source.exists():
        raise FileNotFoundError(f"there is no model file '{source}'")
    if source.is_dir():
        raise mismatch(str(source), "a model file", "a folder")
    try:
        with h5py.File(source, "r") as file:
            model = _read_model(file)
    except ModelError:
        raise
    except Exception as error:  # a damaged file can make HDF5 and h5py raise almost anything
        raise mismatch(str(source), "a readable HDF5 file", str(error) or type(error).__name__) from error
    check_model(model, where=str(source))
    return model


enter_reader(FORMAT, load_model)


def _item(parent: h5py.Group | h5py.Dataset, name: str = "") -> str:
    """How a message names something in a file: ``file: /path/in/the/file``."""
    path = f"{parent.name.rstrip('/')}/{name}" if name else parent.name
    return f"{parent.file.filename}: {path}"


def _read_model(file: h5py.File) -> Model:
    _check_root(file)
    n_blades = _read_integer(file, "n_blades")
    parts: dict[str, Any] = {
        key: {name: _read_part(group, part) for name, group in _subgroups(file, key).items()}
        for key, part in _PARTS.items()
    }
    return Model(
        n_blades=n_blades,
        bodies={n: _read_body(g, parts["interfaces"]) for n, g in _subgroups(file, "bodies").items()},
        **parts,
        meshes={n: _read_mesh(g) for n, g in _subgroups(file, "mesh").items()},
        provenance=_read_provenance(file),
    )


def _check_root(file: h5py.File) -> None:
    """Format, version and conventions; nothing else is looked at before these fit."""
    found = _read_text(file, "format")
    if found != FORMAT:
        other = f"'{found}': bd.load reads results" if found.startswith("bdamper-") else f"'{found}'"
        raise mismatch(_item(file, "@format"), f"'{FORMAT}'", other)
    version = _read_integer(file, "version")
    if version != VERSION:
        raise mismatch(_item(file, "@version"), f"{VERSION}", f"{version}")
    _check_text(file, "time_convention", TIME_CONVENTION)
    _check_text(file, "phase_convention", PHASE_CONVENTION)
    axis = np.asarray(_attribute(file, "axis"))
    if axis.dtype.kind not in "fiu" or axis.shape != (3,) or not np.array_equal(axis, AXIS):
        raise mismatch(_item(file, "@axis"), f"{list(AXIS)}", f"{axis.tolist()!r}")
    _check_members(file, ["bodies", "interfaces"], ["locations", "contact", "static", "mesh", "provenance"])


def _read_body(group: h5py.Group, interfaces: Mapping[str, Interface]) -> Body:
    bases = {}
    others = []
    for name in group:
        match = re.fullmatch(r"nd(\d{3,9})", name, re.ASCII)
        if match is None:
            others.append(name)
        else:
            bases[int(match[1])] = name
    _check_members(group, [], [*bases.values(), "mass", "centre", "inertia", "load", "constant_force"])
    ports = _read_ports(group, interfaces)
    return Body(
        name=_own_name(group),
        kind=cast(Any, _read_text(group, "kind")),
        ports=ports,
        bases={d: _read_basis(_subgroup(group, n), ports, interfaces) for d, n in bases.items()},
        mass=float(_read(group, "mass")) if "mass" in others else None,
        centre=_read(group, "centre") if "centre" in others else None,
        inertia=_read(group, "inertia") if "inertia" in others else None,
        load=_read_part(_subgroup(group, "load"), _LOAD) if "load" in others else None,
        constant_force=_read(group, "constant_force") if "constant_force" in others else None,
    )


def _read_ports(group: h5py.Group, interfaces: Mapping[str, Interface]) -> tuple[Port, ...]:
    if "ports" not in group.attrs:
        return ()
    texts = np.atleast_1d(_attribute(group, "ports"))
    ports = []
    for text in (_as_text(t, _item(group, "@ports")) for t in texts.ravel()):
        interface, dot, side = text.rpartition(".")
        if not dot or side not in ("a", "b"):
            raise mismatch(_item(group, "@ports"), "texts like 'interface.a' or 'interface.b'", f"'{text}'")
        if interface not in interfaces:
            raise mismatch(_item(group, "@ports"), f"an interface of {list(interfaces)}", f"'{interface}'")
        ports.append((interface, side))
    return tuple(ports)


def _read_basis(
    group: h5py.Group, ports: tuple[Port, ...], interfaces: Mapping[str, Interface]
) -> ModalBasis:
    _check_members(group, ["omega2", "damping_ratio", "modes"], ["locations", "flexibility", "drag"])
    omega2 = _read(group, "omega2")
    n_modes = len(omega2)
    modes = _subgroup(group, "modes")
    names = [f"{interface}.{side}" for interface, side in ports]
    _check_members(modes, names, [])
    parts = [
        _read(modes, name, "modes", (interfaces[port[0]].n_points, 3, n_modes))
        for name, port in zip(names, ports)
    ]
    locations = {}
    if "locations" in group:
        parent = _subgroup(group, "locations")
        locations = {n: _read(parent, n, "locations", (3, n_modes)) for n in parent}
    return ModalBasis(
        omega2=omega2,
        damping_ratio=_read(group, "damping_ratio"),
        contact_modes=np.concatenate(parts) if parts else np.zeros((0, 3, n_modes)),
        locations=locations,
        flexibility=_read(group, "flexibility") if "flexibility" in group else None,
        drag=_read(group, "drag") if "drag" in group else None,
    )


def _read_part(group: h5py.Group, part: _Part) -> Any:
    _check_members(group, part.arrays, part.optional)
    named = any(field.name == "name" for field in fields(cast(Any, part.kind)))
    values: dict[str, Any] = {"name": _own_name(group)} if named else {}
    values |= {key: _read_text(group, key) for key in part.texts}
    values |= {key: _read_integer(group, key) for key in part.integers}
    values |= {key: _read(group, key) for key in (*part.arrays, *part.optional) if key in group}
    return part.kind(**values)


def _read_mesh(group: h5py.Group) -> SurfaceMesh:
    _check_members(group, ["points", "quads"], ["modes"])
    points, shapes = _read(group, "points", shape=(None, 3)), {}
    if "modes" in group:
        modes = _subgroup(group, "modes")
        for name in modes:
            if not re.fullmatch(r"nd\d{3,9}", name, re.ASCII):
                raise mismatch(_item(modes, name), "a name nd000, nd001, ...", f"'{name}'")
            shapes[int(name[2:])] = _read(modes, name, "modes", (len(points), 3, None))
        _check_members(modes, list(modes), [])
    return SurfaceMesh(points, _read(group, "quads"), shapes)


def _read_provenance(file: h5py.File) -> dict[str, str]:
    if "provenance" not in file:
        return {}
    group = _subgroup(file, "provenance")
    _check_members(group, [], [])
    return {key: _read_text(group, key) for key in group.attrs}


# -----------------------------------------------------------------------------------------------------------
# Groups, datasets and attributes


def _own_name(group: h5py.Group) -> str:
    return cast(str, group.name).rsplit("/", 1)[-1]


def _check_members(group: h5py.Group, required: Iterable[str], optional: Iterable[str]) -> None:
    """Everything required is there, nothing unknown is, and nothing points elsewhere."""
    required = list(required)
    known = [*required, *optional]
    for name in required:
        if name not in group:
            raise mismatch(_item(group, name), "this group or dataset", "nothing")
    for name in group:
        if name not in known:
            raise mismatch(_item(group, name), f"no other names than {known}", "this one")
        _check_link(group, name)


def _check_link(group: h5py.Group, name: str) -> None:
    link = group.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink):
        raise mismatch(_item(group, name), "a group or dataset in this place", f"a {type(link).__name__}")


def _subgroup(group: h5py.Group, name: str) -> h5py.Group:
    _check_link(group, name)
    member = group[name]
    if not isinstance(member, h5py.Group):
        raise mismatch(_item(group, name), "a group", f"a {type(member).__name__.lower()}")
    return member


def _subgroups(file: h5py.File, name: str) -> dict[str, h5py.Group]:
    """All groups inside a group; empty if that group is absent (only the optional ones can be)."""
    if name not in file:
        return {}
    parent = _subgroup(file, name)
    return {key: _subgroup(parent, key) for key in parent}


def _read(group: h5py.Group, name: str, key: str = "", shape: tuple[int | None, ...] | None = None) -> NDArray:
    """A dataset as an array of native double precision (or int64, bool), of the type and units of ``key`` or its name."""
    _check_link(group, name)
    dataset = group[name]
    item = _item(group, name)
    if not isinstance(dataset, h5py.Dataset):
        raise mismatch(item, "a dataset", f"a {type(dataset).__name__.lower()}")
    _check_storage(dataset, item)
    letters, words = _TYPES[_TYPE_OF.get(key or name, "real")]
    if dataset.dtype.kind not in letters:
        raise mismatch(item, words, f"data of type {dataset.dtype}")
    _check_text(dataset, "units", UNITS[key or name])
    shape = shape or _SHAPE_OF.get(name)
    if shape is not None and not fits(dataset.shape, shape):
        raise mismatch(item, f"shape {shape_text(shape)}", f"{dataset.shape}")
    array = np.asarray(dataset[()])
    native = {"f": np.float64, "c": np.complex128, "i": np.int64, "u": np.int64, "b": np.bool_}
    return array.astype(native[array.dtype.kind], copy=False)


def _check_storage(dataset: h5py.Dataset, item: str) -> None:
    """The numbers lie in this file, and there are no more of them than its bytes can hold."""
    if dataset.is_virtual or dataset.external is not None:
        raise mismatch(item, "numbers stored in this file", "a reference to other files")
    if dataset.shape is None:
        raise mismatch(item, "numbers", "an empty dataset")
    stored = dataset.id.get_storage_size()
    wanted = dataset.size * dataset.dtype.itemsize
    if wanted > _LARGEST_EXPANSION * stored:
        raise mismatch(item, f"{wanted} bytes for shape {dataset.shape}", f"{stored} bytes in the file")


def _check_text(owner: h5py.Group | h5py.Dataset, name: str, expected: str) -> None:
    found = _read_text(owner, name)
    if found != expected:
        raise mismatch(_item(owner, f"@{name}"), f"'{expected}'", f"'{found}'")


def _attribute(owner: h5py.Group | h5py.Dataset, name: str) -> Any:
    if name not in owner.attrs:
        raise mismatch(_item(owner, f"@{name}"), "this attribute", "nothing")
    return owner.attrs[name]


def _read_text(owner: h5py.Group | h5py.Dataset, name: str) -> str:
    return _as_text(_attribute(owner, name), _item(owner, f"@{name}"))


def _as_text(value: Any, item: str) -> str:
    """A text, also if stored with fixed length or as an array of one element."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    if not isinstance(value, str):
        raise mismatch(item, "a text", repr(value))
    return str(value)


def _read_integer(owner: h5py.Group | h5py.Dataset, name: str) -> int:
    value = np.asarray(_attribute(owner, name))
    if value.dtype.kind not in "iu" or value.size != 1:
        raise mismatch(_item(owner, f"@{name}"), "one integer", repr(_attribute(owner, name)))
    return int(value.reshape(-1)[0])


# -----------------------------------------------------------------------------------------------------------
# Models that come with the package

CONTACT_POINTS = {"bladed_disk": (9, 24, 48), "paper_disk": (24, 9, 48), "blade_to_ground": (24,), "test_rig": (24,)}


def reference_model(name: str = "bladed_disk", contact_points: int | None = None) -> Model:
    """A model shipped with the package, made by ``tools/make_reference_model.py`` from :mod:`bdamper.fe`.

    Parameters
    ----------
    name : str
        "bladed_disk": 65 blades with wedge dampers, modes at the nodal diameters of engine order 5 up to its seventh
        harmonic; mode shapes for pictures are those of nodal diameter 5.
        "paper_disk": another such disk, on which the method of the paper (:data:`bdamper.PAPER`, friction coefficient 0.46,
        driven at "tip_trailing_edge") finds the numbers of the paper's Figs 8 and 9.  Its 9, 24 and 48 points are 3, 4 and
        4 rows along the slope; with 9 and 48 it has the modes of one harmonic only.
        "blade_to_ground": one blade that rubs on the ground with one side of its platform; normal loads and gaps are
        prescribed (:func:`bdamper.prescribe_preload`).
        "test_rig": one test blade with two dampers between dummy blades, an acyclic structure.
    contact_points : int, optional
        Contact points on each face: 9 (default), 24 or 48 for "bladed_disk", 24 (default), 9 or 48 for "paper_disk", 24 for
        the others.

    Raises
    ------
    SettingError
        If there is no such model.
    """
    validate.choice("reference model", name, sorted(CONTACT_POINTS))
    contact_points = CONTACT_POINTS[name][0] if contact_points is None else contact_points
    if contact_points not in CONTACT_POINTS[name]:
        raise SettingError(f"contact_points of '{name}': expected one of {CONTACT_POINTS[name]}, found {contact_points}")
    with resources.as_file(resources.files("bdamper") / "data" / f"{name}_{contact_points}.h5") as path:
        return load_model(path)
