"""The group ``wheel`` of a constrained body in a model file: its local basis."""

from __future__ import annotations

from collections.abc import Mapping

import h5py
import numpy as np

from bdamper.io.model_groups import (
    check_members,
    new_group,
    place,
    read_array,
    read_integer,
    read_text,
    subgroup,
    write_array,
    write_text,
)
from bdamper.model.local import LocalBasis
from bdamper.util.errors import mismatch

_ARRAYS = ("omega2", "damping_ratio", "blade_stiffness", "blade_mass", "disk_stiffness", "disk_mass")
_COUNTS = ("n_cantilever", "n_attachment", "n_interface")


def write_wheel(group: h5py.Group, local: LocalBasis, ports: Mapping[str, slice]) -> None:
    """Attributes ``region`` and the numbers of shapes, matrices, and shapes by ``ports`` (names and rows) and location."""
    write_text(group, "region", local.region)
    for key in _COUNTS:
        group.attrs[key] = int(getattr(local, key))
    for key in _ARRAYS:
        write_array(group, key, getattr(local, key))
    modes, locations = new_group(group, "modes"), new_group(group, "locations")
    for name, rows in ports.items():
        write_array(modes, name, local.contact_modes[rows], "modes")
    for name, shapes in local.locations.items():
        write_array(locations, name, shapes, "locations")
    if local.flexibility is not None:
        write_array(group, "flexibility", local.flexibility)


def read_wheel(group: h5py.Group, ports: Mapping[str, int]) -> LocalBasis:
    """The local basis that :func:`write_wheel` has written, of ``ports`` with so many contact points."""
    check_members(group, [*_ARRAYS, "modes"], ["locations", "flexibility"])
    counts = {key: read_integer(group, key) for key in _COUNTS}
    n, r = sum(counts.values()), counts["n_interface"]
    if min(counts.values()) < 0:
        raise mismatch(place(group), "numbers of shapes >= 0", counts)
    shapes = {
        "omega2": (counts["n_cantilever"],),
        "damping_ratio": (n,),
        "blade_stiffness": (n, n),
        "blade_mass": (n, n),
        "disk_stiffness": (None, r, r),
        "disk_mass": (None, r, r),
    }
    arrays = {key: read_array(group, key, shape=shape) for key, shape in shapes.items()}
    modes, locations = subgroup(group, "modes"), {}
    check_members(modes, ports, [])
    parts = [read_array(modes, name, "modes", (points, 3, n)) for name, points in ports.items()]
    if "locations" in group:
        parent = subgroup(group, "locations")
        locations = {name: read_array(parent, name, "locations", (3, n)) for name in parent}
    return LocalBasis(
        region=read_text(group, "region"),
        **arrays,
        contact_modes=np.concatenate(parts) if parts else np.zeros((0, 3, n)),
        locations=locations,
        flexibility=read_array(group, "flexibility") if "flexibility" in group else None,
    )
