"""Fields of nodal forces, such as those of a pressure that a blade meets, in SI units and the axes of the model."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.importers.array_files import as_integers, number_table
from bdamper.importers.prepared_body import PreparedBody
from bdamper.util import validation

EXPECTED = "(node numbers (n,), forces (n, 3)), or a CSV file of rows: node, Re x, Im x, Re y, Im y, Re z, Im z"


def force_fields(given: Mapping[str, object] | None, body: PreparedBody) -> dict[str, NDArray]:
    """(n_nodes, 3) complex forces (N) of each field by name.

    Parameters
    ----------
    given : mapping of name to (numbers, forces) or path, optional
        Node numbers (n,) and complex forces (n, 3) in the axes and units of the file, or a CSV file with both; comments
        start with ``#``.  Forces on the same node add up.
    body : PreparedBody
        On whose nodes they act.

    Raises
    ------
    SettingError, ModelError
        If one is no field, or has none but zeros, or a node is not known; the message names the field.
    """
    out = {}
    for name, value in ({} if given is None else validation.instance("forces", given, Mapping, "a mapping")).items():
        numbers, forces = _table(f"forces '{name}'", value)
        units, out[name] = body.place.units, np.zeros((len(body.nodes), 3), complex)
        in_si = units.mass * units.length * forces @ body.place.rotation.T
        np.add.at(out[name], body.index(numbers, f"forces '{name}'"), in_si)
        validation.require(out[name].any(), f"forces '{name}'", "forces other than 0", "zeros alone")
    return out


def _table(item: str, value: Any) -> tuple[NDArray, NDArray]:
    """Node numbers and forces as they were given."""
    if isinstance(value, str | os.PathLike):
        table = number_table(Path(value), 7)
        return as_integers(table[:, 0], item), table[:, 1::2] + 1j * table[:, 2::2]
    validation.that(isinstance(value, tuple) and len(value) == 2, item, EXPECTED, value)
    try:
        numbers, forces = np.asarray(value[0]), np.asarray(value[1], complex)
    except (ValueError, TypeError) as error:
        raise validation.unfit(item, EXPECTED, value) from error
    good = numbers.ndim == 1 and len(numbers) and forces.shape == (len(numbers), 3) and np.isfinite(forces).all()
    validation.that(good, item, EXPECTED, value)
    return numbers, forces
