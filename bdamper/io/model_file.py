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
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np

from bdamper.io.model_groups import (
    Part,
    as_text,
    attribute,
    check_members,
    check_text,
    new_group,
    own_name,
    place,
    read_array,
    read_integer,
    read_part,
    read_text,
    subgroup,
    subgroups,
    write_array,
    write_part,
    write_text,
)
from bdamper.io.model_speed import read_speed, read_spin, write_speed, write_spin
from bdamper.io.model_stress import read_stress, write_stress
from bdamper.io.model_wheel import read_wheel, write_wheel
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
from bdamper.util.errors import ModelError, mismatch
from bdamper.util.hdf5 import check_folder, enter_reader, written

FORMAT = "bdamper-model"
VERSION = 1
_LONGEST_ATTRIBUTE = 60000  # bytes; HDF5 has room for 64 KiB
AXIS = (0.0, 0.0, 1.0)
TIME_CONVENTION = "exp(+i omega t)"
PHASE_CONVENTION = "u(k+1) = Rz(-2 pi/N) u(k) exp(+i 2 pi d/N), k toward +X"

_LOAD = Part(BodyLoad, arrays=("direction", "generalised", "displacement"))
_PARTS = {
    "interfaces": Part(
        Interface, ("kind", "body_a", "body_b"), ("sector_a", "sector_b"), ("points", "area", "frame", "gap")
    ),
    "locations": Part(Location, texts=("body",), arrays=("position",)),
    "contact": Part(ContactStiffness, texts=("source",), arrays=("stiffness",), optional=("fallback",)),
    "static": Part(StaticContact, arrays=("force", "displacement_a", "displacement_b")),
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
    with written(path, track_order=True) as file:
        _write_model(file, model)


def _check_attribute_lengths(model: Model) -> None:
    for key, value in model.provenance.items():
        if len(key.encode()) + len(value.encode()) > _LONGEST_ATTRIBUTE:
            found = f"{len(value.encode())} bytes in '{key[:40]}'"
            raise mismatch("model: /provenance", f"texts of at most {_LONGEST_ATTRIBUTE} bytes", found)


def _write_model(file: h5py.File, model: Model) -> None:
    write_text(file, "format", FORMAT)
    file.attrs["version"] = VERSION
    file.attrs["n_blades"] = int(model.n_blades)
    file.attrs["axis"] = np.array(AXIS)
    write_text(file, "time_convention", TIME_CONVENTION)
    write_text(file, "phase_convention", PHASE_CONVENTION)
    bodies = new_group(file, "bodies")
    for name, body in model.bodies.items():
        _write_body(new_group(bodies, name), model, body)
    for key, part in _PARTS.items():
        parent = new_group(file, key)
        for name, record in getattr(model, key).items():
            write_part(new_group(parent, name), part, record)
    meshes = new_group(file, "mesh")
    for name, mesh in model.meshes.items():
        _write_mesh(new_group(meshes, name), mesh)
    if model.stress:
        sets = new_group(file, "stress")
        for name, stress in model.stress.items():
            write_stress(new_group(sets, name), stress)
    provenance = file.create_group("provenance")
    for key, value in model.provenance.items():
        write_text(provenance, key, value)


def _write_mesh(group: h5py.Group, mesh: SurfaceMesh) -> None:
    write_array(group, "points", mesh.points)
    write_array(group, "quads", mesh.quads)
    if mesh.modes:
        modes = new_group(group, "modes")
        for diameter, shapes in mesh.modes.items():
            single = np.complex64 if shapes.dtype.kind == "c" else np.float32  # enough for pictures
            write_array(modes, f"nd{diameter:03d}", shapes.astype(single), "modes")


def _write_body(group: h5py.Group, model: Model, body: Body) -> None:
    write_text(group, "kind", body.kind)
    ports = [f"{interface}.{side}".encode() for interface, side in body.ports]
    longest = max((len(port) for port in ports), default=1)
    group.attrs.create("ports", np.array(ports, dtype=f"S{longest}"), dtype=h5py.string_dtype(length=longest))
    for key in ("mass", "centre", "inertia", "constant_force"):
        value = getattr(body, key)
        if value is not None:
            write_array(group, key, np.asarray(value, dtype=float))
    for d, basis in body.bases.items():
        _write_basis(new_group(group, f"nd{d:03d}"), model, body, basis)
    if body.load is not None:
        write_part(new_group(group, "load"), _LOAD, body.load)
    rows = {f"{interface}.{side}": model.port_slice(body.name, (interface, side)) for interface, side in body.ports}
    if body.spin is not None:
        write_spin(new_group(group, "spin"), body.spin, rows)
    if body.local is not None:
        write_wheel(new_group(group, "wheel"), body.local, rows)


def _write_basis(group: h5py.Group, model: Model, body: Body, basis: ModalBasis) -> None:
    write_array(group, "omega2", basis.omega2)
    write_array(group, "damping_ratio", basis.damping_ratio)
    modes = new_group(group, "modes")
    for port in body.ports:
        rows = model.port_slice(body.name, port)
        write_array(modes, f"{port[0]}.{port[1]}", basis.contact_modes[rows], "modes")
    locations = new_group(group, "locations")
    for name, values in basis.locations.items():
        write_array(locations, name, values, "locations")
    if basis.flexibility is not None:
        write_array(group, "flexibility", basis.flexibility)
    if basis.drag is not None:
        write_array(group, "drag", basis.drag)
    if basis.speed is not None:
        write_speed(new_group(group, "speed"), basis)


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


def _read_model(file: h5py.File) -> Model:
    _check_root(file)
    n_blades = read_integer(file, "n_blades")
    parts: dict[str, Any] = {
        key: {name: read_part(group, part) for name, group in subgroups(file, key).items()} for key, part in _PARTS.items()
    }
    return Model(
        n_blades=n_blades,
        bodies={n: _read_body(g, parts["interfaces"]) for n, g in subgroups(file, "bodies").items()},
        **parts,
        meshes={n: _read_mesh(g) for n, g in subgroups(file, "mesh").items()},
        provenance=_read_provenance(file),
        stress={n: read_stress(g) for n, g in subgroups(file, "stress").items()},
    )


def _check_root(file: h5py.File) -> None:
    """Format, version and conventions; nothing else is looked at before these fit."""
    found = read_text(file, "format")
    if found != FORMAT:
        other = f"'{found}': bd.load reads results" if found.startswith("bdamper-") else f"'{found}'"
        raise mismatch(place(file, "@format"), f"'{FORMAT}'", other)
    version = read_integer(file, "version")
    if version != VERSION:
        raise mismatch(place(file, "@version"), f"{VERSION}", f"{version}")
    check_text(file, "time_convention", TIME_CONVENTION)
    check_text(file, "phase_convention", PHASE_CONVENTION)
    axis = np.asarray(attribute(file, "axis"))
    if axis.dtype.kind not in "fiu" or axis.shape != (3,) or not np.array_equal(axis, AXIS):
        raise mismatch(place(file, "@axis"), f"{list(AXIS)}", f"{axis.tolist()!r}")
    check_members(file, ["bodies", "interfaces"], ["locations", "contact", "static", "mesh", "stress", "provenance"])


def _read_body(group: h5py.Group, interfaces: Mapping[str, Interface]) -> Body:
    bases = {}
    others = []
    for name in group:
        match = re.fullmatch(r"nd(\d{3,9})", name, re.ASCII)
        if match is None:
            others.append(name)
        else:
            bases[int(match[1])] = name
    check_members(group, [], [*bases.values(), "mass", "centre", "inertia", "load", "constant_force", "spin", "wheel"])
    ports = _read_ports(group, interfaces)
    points = {f"{interface}.{side}": interfaces[interface].n_points for interface, side in ports}
    return Body(
        name=own_name(group),
        kind=cast(Any, read_text(group, "kind")),
        ports=ports,
        bases={d: _read_basis(subgroup(group, n), ports, interfaces) for d, n in bases.items()},
        mass=float(read_array(group, "mass")) if "mass" in others else None,
        centre=read_array(group, "centre") if "centre" in others else None,
        inertia=read_array(group, "inertia") if "inertia" in others else None,
        load=read_part(subgroup(group, "load"), _LOAD) if "load" in others else None,
        constant_force=read_array(group, "constant_force") if "constant_force" in others else None,
        spin=read_spin(subgroup(group, "spin"), points) if "spin" in others else None,
        local=read_wheel(subgroup(group, "wheel"), points) if "wheel" in others else None,
    )


def _read_ports(group: h5py.Group, interfaces: Mapping[str, Interface]) -> tuple[Port, ...]:
    if "ports" not in group.attrs:
        return ()
    texts = np.atleast_1d(attribute(group, "ports"))
    ports = []
    for text in (as_text(t, place(group, "@ports")) for t in texts.ravel()):
        interface, dot, side = text.rpartition(".")
        if not dot or side not in ("a", "b"):
            raise mismatch(place(group, "@ports"), "texts like 'interface.a' or 'interface.b'", f"'{text}'")
        if interface not in interfaces:
            raise mismatch(place(group, "@ports"), f"an interface of {list(interfaces)}", f"'{interface}'")
        ports.append((interface, side))
    return tuple(ports)


def _read_basis(group: h5py.Group, ports: tuple[Port, ...], interfaces: Mapping[str, Interface]) -> ModalBasis:
    check_members(group, ["omega2", "damping_ratio", "modes"], ["locations", "flexibility", "drag", "speed"])
    omega2 = read_array(group, "omega2")
    n_modes = len(omega2)
    modes = subgroup(group, "modes")
    names = [f"{interface}.{side}" for interface, side in ports]
    check_members(modes, names, [])
    parts = [
        read_array(modes, name, "modes", (interfaces[port[0]].n_points, 3, n_modes)) for name, port in zip(names, ports)
    ]
    locations = {}
    if "locations" in group:
        parent = subgroup(group, "locations")
        locations = {n: read_array(parent, n, "locations", (3, n_modes)) for n in parent}
    basis = ModalBasis(
        omega2=omega2,
        damping_ratio=read_array(group, "damping_ratio"),
        contact_modes=np.concatenate(parts) if parts else np.zeros((0, 3, n_modes)),
        locations=locations,
        flexibility=read_array(group, "flexibility") if "flexibility" in group else None,
        drag=read_array(group, "drag") if "drag" in group else None,
    )
    return read_speed(subgroup(group, "speed"), basis) if "speed" in group else basis


def _read_mesh(group: h5py.Group) -> SurfaceMesh:
    check_members(group, ["points", "quads"], ["modes"])
    points, shapes = read_array(group, "points", shape=(None, 3)), {}
    if "modes" in group:
        modes = subgroup(group, "modes")
        for name in modes:
            if not re.fullmatch(r"nd\d{3,9}", name, re.ASCII):
                raise mismatch(place(modes, name), "a name nd000, nd001, ...", f"'{name}'")
            shapes[int(name[2:])] = read_array(modes, name, "modes", (len(points), 3, None))
        check_members(modes, list(modes), [])
    return SurfaceMesh(points, read_array(group, "quads"), shapes)


def _read_provenance(file: h5py.File) -> dict[str, str]:
    if "provenance" not in file:
        return {}
    group = subgroup(file, "provenance")
    check_members(group, [], [])
    return {key: read_text(group, key) for key in group.attrs}
