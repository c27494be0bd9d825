"""Bodies, meshes and stress sets of a model file: which groups and datasets they have, written and read."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import h5py
import numpy as np

from bdamper.io.model_groups import (
    Part,
    as_text,
    attribute,
    check_members,
    diameter_groups,
    new_group,
    place,
    read_array,
    read_fields,
    read_number,
    read_part,
    read_rows,
    read_text,
    subgroup,
    write_array,
    write_part,
    write_rows,
    write_text,
)
from bdamper.model.checks import require
from bdamper.model.local import LocalBasis
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
from bdamper.model.spin import SpeedBasis, SpinStatic
from bdamper.model.stress import StressSet
from bdamper.util.errors import mismatch

PARTS = {
    "interfaces": Part(
        Interface, ("kind", "body_a", "body_b"), ("sector_a", "sector_b"), arrays=("points", "area", "frame", "gap")
    ),
    "locations": Part(Location, texts=("body",), arrays=("position",)),
    "contact": Part(ContactStiffness, texts=("source",), arrays=("stiffness",), optional=("fallback",)),
    "static": Part(StaticContact, arrays=("force", "displacement_a", "displacement_b")),
}
"""Groups of the file and fields of the model whose members are written alike."""

_LOAD = Part(BodyLoad, arrays=("direction", "generalised", "displacement"))
_BODY = Part(Body, ("kind",), optional=("mass", "centre", "inertia", "constant_force"))
_BASIS = Part(ModalBasis, arrays=("omega2", "damping_ratio"), optional=("flexibility", "drag"))
_SPEED = Part(
    SpeedBasis, ("source",), numbers=("omega_ref", "checked_at", "error"), arrays=("stiffness2",),
    optional=("stiffness0", "residual0", "residual2", "coriolis"),
)  # fmt: skip
_SPIN = Part(SpinStatic, ("theory",), numbers=("omega",))
_WHEEL = Part(
    LocalBasis, ("region",), ("n_cantilever", "n_attachment", "n_interface"), optional=("flexibility",),
    arrays=("omega2", "damping_ratio", "blade_stiffness", "blade_mass", "disk_stiffness", "disk_mass"),
)  # fmt: skip
_STRESS = Part(StressSet, ("body", "source"), arrays=("points",), optional=("spread", "near_contact"))


# -----------------------------------------------------------------------------------------------------------
# Writing


def write_body(group: h5py.Group, model: Model, body: Body) -> None:
    """One body with its bases and, where it has them, its load, displacement by rotation and local basis."""
    names = {port: f"{port[0]}.{port[1]}" for port in body.ports}
    ports = np.array([name.encode() for name in names.values()], dtype="S")
    kind = h5py.string_dtype(length=max(ports.dtype.itemsize, 1))
    write_text(group, "kind", body.kind)
    group.attrs.create("ports", ports, dtype=kind)
    for key in _BODY.optional:
        if getattr(body, key) is not None:
            write_array(group, key, np.asarray(getattr(body, key), dtype=float))
    rows = {name: model.port_slice(body.name, port) for port, name in names.items()}
    for d, basis in body.bases.items():
        _write_basis(new_group(group, f"nd{d:03d}"), basis, rows)
    if body.load is not None:
        write_part(new_group(group, "load"), _LOAD, body.load)
    if body.spin is not None:
        own = new_group(group, "spin")
        write_part(own, _SPIN, body.spin)
        write_rows(own, "contact", rows, body.spin.contact, body.spin.locations, "spin")
    if body.local is not None:
        own = new_group(group, "wheel")
        write_part(own, _WHEEL, body.local)
        write_rows(own, "modes", rows, body.local.contact_modes, body.local.locations)


def _write_basis(group: h5py.Group, basis: ModalBasis, rows: Mapping[str, slice]) -> None:
    write_part(group, _BASIS, basis)
    write_rows(group, "modes", rows, basis.contact_modes, basis.locations)
    speed = basis.speed
    if speed is None:
        return
    # Matrices of standstill are written only where they do not follow from the basis.
    follows = cast(SpeedBasis, basis.with_speed(speed.stiffness2, speed.residual2, speed.omega_ref).speed)
    known = [key for key in ("stiffness0", "residual0") if np.array_equal(getattr(speed, key), getattr(follows, key))]
    part = replace(_SPEED, optional=tuple(key for key in _SPEED.optional if key not in known))
    write_part(new_group(group, "speed"), part, speed)


def write_mesh(group: h5py.Group, mesh: SurfaceMesh) -> None:
    """Points, quadrilaterals and mode shapes of a surface."""
    write_array(group, "points", mesh.points)
    write_array(group, "quads", mesh.quads)
    if mesh.modes:
        modes = new_group(group, "modes")
        for diameter, shapes in mesh.modes.items():
            single = np.complex64 if shapes.dtype.kind == "c" else np.float32  # enough for pictures
            write_array(modes, f"nd{diameter:03d}", shapes.astype(single), "modes")


def write_stress(group: h5py.Group, stress: StressSet) -> None:
    """One set: attributes ``body`` and ``source``, points, and a group of rows for each nodal diameter."""
    write_part(group, _STRESS, stress)
    if stress.static is not None:
        write_array(group, "static_stress", stress.static)
    for d, rows in stress.modes.items():
        own = new_group(group, f"nd{d:03d}")
        write_array(own, "mode_stress", rows)
        if d in stress.contact:
            write_array(own, "contact_stress", stress.contact[d])


# -----------------------------------------------------------------------------------------------------------
# Reading


def read_body(group: h5py.Group, interfaces: Mapping[str, Interface]) -> Body:
    """What :func:`write_body` has written."""
    bases = diameter_groups(group)
    check_members(group, [], [*bases.values(), *_BODY.optional, "load", "spin", "wheel"])
    ports = _read_ports(group, interfaces)
    points = {f"{interface}.{side}": interfaces[interface].n_points for interface, side in ports}
    given = read_fields(group, _BODY)
    mass = given.pop("mass", None)
    return Body(
        ports=ports,
        bases={d: _read_basis(subgroup(group, name), points) for d, name in bases.items()},
        mass=None if mass is None else float(mass),
        load=read_part(subgroup(group, "load"), _LOAD) if "load" in group else None,
        spin=_read_spin(subgroup(group, "spin"), points) if "spin" in group else None,
        local=_read_wheel(subgroup(group, "wheel"), points) if "wheel" in group else None,
        **given,
    )


def _read_ports(group: h5py.Group, interfaces: Mapping[str, Interface]) -> tuple[Port, ...]:
    if "ports" not in group.attrs:
        return ()
    item, ports = place(group, "@ports"), []
    for text in (as_text(t, item) for t in np.atleast_1d(attribute(group, "ports")).ravel()):
        interface, dot, side = text.rpartition(".")
        require(bool(dot) and side in ("a", "b"), item, "texts like 'interface.a' or 'interface.b'", f"'{text}'")
        require(interface in interfaces, item, f"an interface of {list(interfaces)}", f"'{interface}'")
        ports.append((interface, side))
    return tuple(ports)


def _read_basis(group: h5py.Group, points: Mapping[str, int]) -> ModalBasis:
    check_members(group, [*_BASIS.arrays, "modes"], ["locations", *_BASIS.optional, "speed"])
    given = read_fields(group, _BASIS)
    contact, locations = read_rows(group, "modes", points, (len(given["omega2"]),))
    basis = ModalBasis(contact_modes=contact, locations=locations, **given)
    return _read_speed(subgroup(group, "speed"), basis) if "speed" in group else basis


def _read_speed(group: h5py.Group, basis: ModalBasis) -> ModalBasis:
    """The basis with its data over speed."""
    check_members(group, _SPEED.arrays, _SPEED.optional)
    n, m = basis.n_modes, 3 * len(basis.contact_modes)
    shapes = {key: (m, m) if key.startswith("residual") else (n, n) for key in (*_SPEED.arrays, *_SPEED.optional)}
    given = {key: read_array(group, key, shape=shape) for key, shape in shapes.items() if key in group}
    if "residual0" in given and "residual2" not in given:
        raise mismatch(place(group, "residual2"), "this dataset beside residual0", "nothing")
    if "residual2" in given and basis.flexibility is None and "residual0" not in given:
        raise mismatch(place(group, "residual0"), "this dataset where the basis has no flexibility", "nothing")
    if basis.flexibility is not None and basis.flexibility.shape != (m, m):
        raise mismatch(place(group.parent, "flexibility"), f"shape ({m}, {m})", basis.flexibility.shape)
    sizes = {key: read_number(group, key) for key in ("checked_at", "error") if key in group.attrs}
    made = basis.with_speed(
        given.pop("stiffness2"), given.pop("residual2", None), read_number(group, "omega_ref"),
        coriolis=given.pop("coriolis", None), source=read_text(group, "source"), **sizes,
    )  # fmt: skip
    return replace(made, speed=replace(cast(SpeedBasis, made.speed), **cast(Any, given)))


def _read_spin(group: h5py.Group, points: Mapping[str, int]) -> SpinStatic:
    check_members(group, ["contact"], ["locations"])
    contact, locations = read_rows(group, "contact", points, key="spin")
    return SpinStatic(contact, locations, cast(Any, read_text(group, "theory")), read_number(group, "omega"))


def _read_wheel(group: h5py.Group, points: Mapping[str, int]) -> LocalBasis:
    check_members(group, [*_WHEEL.arrays, "modes"], ["locations", *_WHEEL.optional])
    given = read_fields(group, replace(_WHEEL, arrays=()))
    counts = {key: given.pop(key) for key in _WHEEL.integers}
    require(min(counts.values()) >= 0, place(group), "numbers of shapes >= 0", counts)
    n, r = sum(counts.values()), counts["n_interface"]
    shapes = [(counts["n_cantilever"],), (n,), (n, n), (n, n), (None, r, r), (None, r, r)]
    given |= {key: read_array(group, key, shape=shape) for key, shape in zip(_WHEEL.arrays, shapes)}
    contact, locations = read_rows(group, "modes", points, (n,))
    return LocalBasis(contact_modes=contact, locations=locations, **given)


def read_mesh(group: h5py.Group) -> SurfaceMesh:
    """What :func:`write_mesh` has written."""
    check_members(group, ["points", "quads"], ["modes"])
    points, shapes = read_array(group, "points", shape=(None, 3)), {}
    if "modes" in group:
        modes = subgroup(group, "modes")
        for name in modes:
            good = re.fullmatch(r"nd\d{3,9}", name, re.ASCII)
            require(bool(good), place(modes, name), "a name nd000, nd001, ...", f"'{name}'")
            shapes[int(name[2:])] = read_array(modes, name, "modes", (len(points), 3, None))
        check_members(modes, list(modes), [])
    return SurfaceMesh(points, read_array(group, "quads"), shapes)


def read_stress(group: h5py.Group) -> StressSet:
    """The set that :func:`write_stress` has written."""
    diameters = diameter_groups(group)
    check_members(group, _STRESS.arrays, ["static_stress", *_STRESS.optional, *diameters.values()])
    require(len(diameters) > 0, place(group), "a group nd000, nd001, ... for each nodal diameter", "none")
    given = read_fields(group, _STRESS)
    points = read_array(group, "points", shape=(None, 3))
    modes, contact = {}, {}
    for d, name in diameters.items():
        own = subgroup(group, name)
        check_members(own, ["mode_stress"], ["contact_stress"])
        modes[d] = read_array(own, "mode_stress", shape=(len(points), 6, None))
        if "contact_stress" in own:
            contact[d] = read_array(own, "contact_stress", shape=(len(points), 6, None))
    static = read_array(group, "static_stress") if "static_stress" in group else None
    return StressSet(modes=modes, contact=contact, static=static, **given)
