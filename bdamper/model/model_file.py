"""Model file: :class:`~bdamper.model.structure.Model` in HDF5.

The groups and datasets follow the annotated types of the classes (:mod:`bdamper.util.records`).
``docs/specification/model-file.md`` describes the format, with an example of a file written by h5py
alone.  The reader checks names, types and units.  ``bdamper.model.validation.check_model`` checks
shapes and numbers, for files and models in memory.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from bdamper.model.modal_basis import SpeedBasis
from bdamper.model.structure import ModalBasis, Model
from bdamper.model.validation import as_checked, check_model
from bdamper.util import validation
from bdamper.util.errors import ModelError, check, check_sentence
from bdamper.util.records import (
    Sizes,
    check_record,
    check_text,
    place,
    read_attribute,
    read_record,
    write_record,
    write_text,
)
from bdamper.util.storage import as_path, read_hdf5, register_reader, write_hdf5

FORMAT = "bdamper-model"
VERSION = 2
AXIS = (0.0, 0.0, 1.0)
TIME_CONVENTION = "exp(+i omega t)"
PHASE_CONVENTION = "u(k+1) = Rz(-2 pi/N) u(k) exp(+i 2 pi d/N), k toward +X"


@validation.check_arguments
def save_model(model: Model, path: str | os.PathLike[str]) -> None:
    """Write a model to an HDF5 file, replacing an existing one in a single step.

    Parameters
    ----------
    model : Model
        Checked before it is written.
    path : path-like
        File in an existing directory.

    Raises
    ------
    ModelError
        If the model does not pass ``bdamper.model.validation.check_model``.
    BdamperError
        If the file cannot be written; an existing file is then unchanged.
    """
    check_model(model)
    with write_hdf5(path) as file:
        write_model(file, model)


def write_model(file: h5py.Group, model: Model) -> None:
    """Write a checked model into a file or a group."""
    write_text(file, "format", FORMAT)
    file.attrs["version"] = VERSION
    file.attrs["axis"] = np.array(AXIS)
    write_text(file, "time_convention", TIME_CONVENTION)
    write_text(file, "phase_convention", PHASE_CONVENTION)
    write_record(file, _with_bases(model, lambda _, basis: _without_derived(basis)))


@validation.check_arguments
def load_model(path: str | os.PathLike[str]) -> Model:
    """Read a model from an HDF5 file and check it.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Model
        All numbers in double precision.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    ModelError
        If the file is not a model file, or the model does not pass
        ``bdamper.model.validation.check_model``.
    """
    if not as_path(path).exists():
        raise FileNotFoundError(f"there is no model file '{path}'")
    check(not Path(path).is_dir(), str(path), "a model file", "a folder")
    with read_hdf5(path, "a readable HDF5 file", ModelError) as file:
        model = read_model(file)
    check_model(model, where=str(path))
    return as_checked(model)


register_reader(FORMAT, load_model)


def read_model(file: h5py.Group) -> Model:
    """Read a model from a file or a group without checking its numbers."""
    stored = read_attribute(file, "format")
    found = f"'{stored}'"
    if stored.startswith("bdamper-"):
        found += ": bd.load reads results"
    check(stored == FORMAT, place(file, "@format"), f"'{FORMAT}'", found)
    version = read_attribute(file, "version", int)
    found = f"{version}; create the model again"
    check(version == VERSION, place(file, "@version"), f"{VERSION}", found)
    check_text(file, "time_convention", TIME_CONVENTION)
    check_text(file, "phase_convention", PHASE_CONVENTION)
    axis = np.asarray(file.attrs.get("axis", "nothing"))
    is_z = axis.dtype.kind in "fiu" and np.array_equal(axis, AXIS)
    check(is_z, place(file, "@axis"), f"{list(AXIS)}", f"{axis.tolist()!r}")
    model = read_record(file, Model)
    return _with_bases(model, lambda path, basis: _with_derived(basis, place(file, path)))


# ---- Speed-dependent data that follow from the basis ----


def _with_bases(model: Model, change: Callable[[str, ModalBasis], ModalBasis]) -> Model:
    """Return the model with each basis replaced by ``change(path, basis)``.

    ``path`` is the path of the basis in the file.
    """
    bodies = dict(model.bodies)
    for name, body in bodies.items():
        bases = {d: change(f"bodies/{name}/nd{d:03d}", basis) for d, basis in body.bases.items()}
        bodies[name] = replace(body, bases=bases)
    return replace(model, bodies=bodies)


def _derived_speed(basis: ModalBasis, speed: Any) -> Any:
    """Return the speed dependence with the matrices at standstill that follow from the others."""
    with_speed = basis.with_speed(
        speed.stiffness2,
        speed.residual2,
        speed.omega_ref,
        stiffness4=speed.stiffness4,
        middle=speed.middle,
        residual_above=speed.residual_above,
    )
    return with_speed.speed


def _without_derived(basis: ModalBasis) -> ModalBasis:
    """Return the basis without matrices at standstill that :func:`_with_derived` can compute.

    Only matrices that it computes exactly are omitted.
    """
    speed: Any = basis.speed
    if speed is None:
        return basis
    derived = _derived_speed(basis, speed)
    if np.array_equal(speed.stiffness0, derived.stiffness0):
        speed = replace(speed, stiffness0=None)
    if np.array_equal(speed.residual0, derived.residual0):
        speed = replace(speed, residual0=None)
    return replace(basis, speed=speed)


def _with_derived(basis: ModalBasis, path: str) -> ModalBasis:
    """Return the basis with the missing matrices at standstill.

    They follow from the change with speed and the speed of the basis.
    """
    speed: Any = basis.speed
    if speed is None:
        return basis
    # an array without axes has no points, and its shape is wrong
    n_points = sum(np.shape(basis.contact_modes)[:1])
    sizes = Sizes(n_forces=3 * n_points)
    check_record(basis, ModalBasis, path, sizes)

    item = f"{path}/speed/residual2"
    paired = speed.residual2 is not None or speed.residual0 is None
    check_sentence(paired, item, "the dataset is missing, although residual0 exists")
    item = f"{path}/speed/residual0"
    derivable = speed.residual2 is None or speed.residual0 is not None
    derivable = derivable or basis.flexibility is not None
    check_sentence(derivable, item, "the dataset is missing, and the basis has no flexibility")

    # before products: the shapes of the stored matrices
    stored = replace(speed, stiffness0=speed.stiffness2, residual0=speed.residual2)
    check_record(stored, SpeedBasis, f"{path}/speed", {**sizes, "n_modes": basis.n_modes})
    derived = _derived_speed(basis, speed)
    if speed.stiffness0 is None:
        speed = replace(speed, stiffness0=derived.stiffness0)
    if speed.residual0 is None:
        speed = replace(speed, residual0=derived.residual0)
    return replace(basis, speed=speed)
