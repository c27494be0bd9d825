"""The groups ``speed`` and ``spin`` of a model file: how a basis changes with rotor speed, and displacement by rotation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import h5py
import numpy as np

from bdamper.io.model_groups import (
    attribute,
    check_members,
    new_group,
    place,
    read_array,
    read_text,
    subgroup,
    write_array,
    write_text,
)
from bdamper.model.basis import ModalBasis
from bdamper.model.spin import SpinStatic
from bdamper.util.errors import mismatch

_FOLLOWING = ("stiffness0", "residual0")  # from the basis and the matrices per squared speed
_OPTIONAL = (*_FOLLOWING, "residual2", "coriolis")
_SIZES = ("checked_at", "error")


def write_speed(group: h5py.Group, basis: ModalBasis) -> None:
    """Matrices per squared speed; those of standstill only where they do not follow from the basis."""
    speed = basis.speed
    assert speed is not None
    follows = basis.with_speed(speed.stiffness2, speed.residual2, speed.omega_ref).speed
    for key in ("omega_ref", *_SIZES):
        if getattr(speed, key) is not None:
            group.attrs[key] = float(getattr(speed, key))
    write_text(group, "source", speed.source)
    for key in ("stiffness2", *_OPTIONAL):
        value = getattr(speed, key)
        if value is not None and not (key in _FOLLOWING and np.array_equal(value, getattr(follows, key))):
            write_array(group, key, value)


def read_speed(group: h5py.Group, basis: ModalBasis) -> ModalBasis:
    """The basis with what :func:`write_speed` has written."""
    check_members(group, ["stiffness2"], _OPTIONAL)
    n, m = basis.n_modes, 3 * len(basis.contact_modes)
    shapes = {key: (m, m) if key.startswith("residual") else (n, n) for key in ("stiffness2", *_OPTIONAL)}
    given = {key: read_array(group, key, shape=shape) for key, shape in shapes.items() if key in group}
    if "residual0" in given and "residual2" not in given:
        raise mismatch(place(group, "residual2"), "this dataset beside residual0", "nothing")
    if "residual2" in given and basis.flexibility is None and "residual0" not in given:
        raise mismatch(place(group, "residual0"), "this dataset where the basis has no flexibility", "nothing")
    if basis.flexibility is not None and basis.flexibility.shape != (m, m):
        raise mismatch(place(group.parent, "flexibility"), f"shape ({m}, {m})", basis.flexibility.shape)
    sizes = {key: _number(group, key) for key in _SIZES if key in group.attrs}
    made = basis.with_speed(
        given.pop("stiffness2"), given.pop("residual2", None), _number(group, "omega_ref"),
        coriolis=given.pop("coriolis", None), source=read_text(group, "source"), **sizes,
    )  # fmt: skip
    assert made.speed is not None
    return replace(made, speed=replace(made.speed, **cast(Any, given)))


def write_spin(group: h5py.Group, spin: SpinStatic, ports: Mapping[str, slice]) -> None:
    """Displacement per squared speed by ``ports`` (names and rows) and location."""
    write_text(group, "theory", spin.theory)
    group.attrs["omega"] = float(spin.omega)
    contact, locations = new_group(group, "contact"), new_group(group, "locations")
    for name, rows in ports.items():
        write_array(contact, name, spin.contact[rows], "spin")
    for name, values in spin.locations.items():
        write_array(locations, name, values, "spin")


def read_spin(group: h5py.Group, ports: Mapping[str, int]) -> SpinStatic:
    """What :func:`write_spin` has written, of ``ports`` with so many contact points."""
    check_members(group, ["contact"], ["locations"])
    contact, locations = subgroup(group, "contact"), {}
    check_members(contact, ports, [])
    parts = [read_array(contact, name, "spin", (points, 3)) for name, points in ports.items()]
    if "locations" in group:
        parent = subgroup(group, "locations")
        locations = {name: read_array(parent, name, "spin", (3,)) for name in parent}
    theory = cast(Any, read_text(group, "theory"))
    return SpinStatic(np.concatenate(parts) if parts else np.zeros((0, 3)), locations, theory, _number(group, "omega"))


def _number(group: h5py.Group, name: str) -> float:
    value = np.asarray(attribute(group, name))
    if value.dtype.kind not in "fiu" or value.size != 1 or not np.isfinite(value).all():
        raise mismatch(place(group, f"@{name}"), "one finite number", repr(attribute(group, name)))
    return float(value.reshape(-1)[0])
