"""The group ``stress`` of a model file: rows that give the stress at chosen points of a body."""

from __future__ import annotations

import re

import h5py

from bdamper.io.model_groups import (
    check_members,
    new_group,
    own_name,
    place,
    read_array,
    read_text,
    subgroup,
    write_array,
    write_text,
)
from bdamper.model.stress import StressSet
from bdamper.util.errors import mismatch

_OPTIONAL = ("spread", "near_contact")


def write_stress(group: h5py.Group, stress: StressSet) -> None:
    """One set: attributes ``body`` and ``source``, points, and a group of rows for each nodal diameter."""
    write_text(group, "body", stress.body)
    write_text(group, "source", stress.source)
    write_array(group, "points", stress.points)
    if stress.static is not None:
        write_array(group, "static_stress", stress.static)
    for key in _OPTIONAL:
        if getattr(stress, key) is not None:
            write_array(group, key, getattr(stress, key))
    for d, rows in stress.modes.items():
        own = new_group(group, f"nd{d:03d}")
        write_array(own, "mode_stress", rows)
        if d in stress.contact:
            write_array(own, "contact_stress", stress.contact[d])


def read_stress(group: h5py.Group) -> StressSet:
    """The set that :func:`write_stress` has written."""
    diameters = [name for name in group if re.fullmatch(r"nd\d{3,9}", name, re.ASCII)]
    check_members(group, ["points"], ["static_stress", *_OPTIONAL, *diameters])
    points = read_array(group, "points", shape=(None, 3))
    modes, contact = {}, {}
    for name in diameters:
        own, d = subgroup(group, name), int(name[2:])
        check_members(own, ["mode_stress"], ["contact_stress"])
        modes[d] = read_array(own, "mode_stress", shape=(len(points), 6, None))
        if "contact_stress" in own:
            contact[d] = read_array(own, "contact_stress", shape=(len(points), 6, None))
    if not modes:
        raise mismatch(place(group), "a group nd000, nd001, ... for each nodal diameter", "none")
    return StressSet(
        name=own_name(group),
        body=read_text(group, "body"),
        points=points,
        modes=modes,
        contact=contact,
        static=read_array(group, "static_stress") if "static_stress" in group else None,
        source=read_text(group, "source"),
        **{key: read_array(group, key) if key in group else None for key in _OPTIONAL},
    )
