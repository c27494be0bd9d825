r"""A sector at two or more rotor speeds: its matrices or its modes, as the data over speed of a model.

Matrices at two speeds give the stiffness per squared speed by a difference.  Where a program gives only modes, those of the
second speed are combinations of those of the first: with the polar factor A of their overlap, unitary,

.. math:: K(\Omega_1) = \omega_1^2, \qquad K(\Omega_2) = A\,\omega_2^2 A^H

on the modes of the first speed.  To pair modes by their order instead fails where frequencies veer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.sparse.linalg
from numpy.typing import NDArray

from bdamper.io.bounds import BOUNDS
from bdamper.io.fe_body import FEBody
from bdamper.io.prepare import PreparedBody
from bdamper.model.model import ModalBasis
from bdamper.reduction.spin import IN_PLANE, Rotation
from bdamper.util import validate
from bdamper.util.errors import ModelError, SettingError


def over_speed(bodies: Mapping[float, FEBody]) -> FEBody:
    """One body from the same body at two or more rotor speeds (rad/s), with matrices or with modes of each.

    Parameters
    ----------
    bodies : mapping of rotor speed (rad/s) to FEBody
        ``{0.0: read_calculix("standstill"), 600.0: read_calculix("running")}``.  The modes of the model are those of the
        lowest speed, and the highest one gives the change; those between are compared with it.

    Returns
    -------
    FEBody
        For :func:`bdamper.io.build_model`.

    Raises
    ------
    SettingError, ModelError
        If there are fewer than two speeds, or the bodies are not the same nodes with the same kind of data.
    """
    if not isinstance(bodies, Mapping) or len(bodies) < 2:
        raise validate.unfit("over_speed", "a mapping of two or more rotor speeds to FEBody", bodies)
    made = []
    for key, value in bodies.items():
        omega = validate.number("rotor speed", key, least=0.0, unit="rad/s")
        body = validate.instance(f"body at {omega:g} rad/s", value, FEBody)
        made.append(replace(body, rotor_speed=omega, other_speeds=()))
    first, *others = sorted(made, key=lambda body: body.rotor_speed)
    for other in others:
        item = f"{other.source} at {other.rotor_speed:g} rad/s"
        if not np.array_equal(first.numbers, other.numbers):
            raise ModelError(f"{item}: expected the nodes of {first.source}, found other numbers")
        if (first.stiffness is None) != (other.stiffness is None):
            raise SettingError("over_speed: expected matrices at every speed, or modes at every speed, found both")
    return replace(first, other_speeds=tuple(others))


def rotation_of(body: PreparedBody) -> Rotation | None:
    """How the stiffness of a body with matrices changes with speed; None where only one speed is given.

    Raises
    ------
    ModelError
        If the mass changes with speed, or the stiffness at a third speed is not on the line.
    """
    others = [PreparedBody(body.name, other, body.place) for other in body.given.other_speeds]
    if not others:
        return None
    low, first = body.structure, body.given.rotor_speed
    high, last = others[-1].structure, others[-1].given.rotor_speed
    change = (high.stiffness - low.stiffness).tocsr()
    per_squared_speed = (change / (last**2 - first**2)).tocsr()
    norm = scipy.sparse.linalg.norm
    for other in others:
        omega, structure = other.given.rotor_speed, other.structure
        if norm(structure.mass - low.mass) > 1e-6 * norm(low.mass):
            raise body.error(f"mass matrix at {omega:g} rad/s", "that of the other speed", "another")
        share = (omega**2 - first**2) / (last**2 - first**2)
        apart = norm(structure.stiffness - low.stiffness - share * change) / norm(change)
        if not apart <= BOUNDS.on_line:
            expected = f"a stiffness on the line between {first:g} and {last:g} rad/s in the squared speed"
            raise body.error(f"matrices at {omega:g} rad/s", expected, f"{100 * apart:.3g} % of the change beside it")
    softening = _spin_softening(body, per_squared_speed)
    if softening < 0.5:
        body.missing.append(
            f"spin softening of the {body.name}: the matrices at {last:g} rad/s take {100 * softening:.3g} % of its mass "
            "in the plane of rotation from the stiffness; frequencies of bending in this plane come out too high"
        )
    body.checks.append(f"{body.name}: stiffness at {first:g} and {last:g} rad/s, spin softening {100 * softening:.4g} %")
    return Rotation(per_squared_speed, first, last, None, body.given.source)


def _spin_softening(body: PreparedBody, per_squared_speed: NDArray) -> float:
    """Share of the mass in the plane of rotation that is missing from the stiffness, by a translation of inner nodes.

    A translation takes no force from elastic and geometric stiffness.
    """
    structure = body.structure
    held = body.fixed(None).any(axis=1)
    touched = np.repeat(held, 3) | (np.abs(structure.stiffness) @ np.repeat(held, 3).astype(float) > 0.0)
    pushed = mass = 0.0
    for axis in IN_PLANE[:2]:
        translation = np.tile(axis, len(structure.nodes))
        inertia = np.where(touched, 0.0, structure.mass @ translation)
        pushed -= float(inertia @ (per_squared_speed @ translation))
        mass += float(inertia @ inertia)
    return pushed / mass if mass else 1.0


def basis_from_modes(
    body: PreparedBody, d: int, basis: ModalBasis, shapes: NDArray, others: list[tuple[float, NDArray, NDArray]]
) -> ModalBasis:
    """A basis with its data over speed from modes at other speeds.

    Parameters
    ----------
    body : PreparedBody
    d : int
        Nodal diameter.
    basis : ModalBasis
    shapes : (3 n_nodes, n_modes)
        Mass-normalised modes of the basis, NaN in unknown rows.
    others : list of (speed in rad/s, omega2 (n_modes,), shapes (3 n_nodes, n_modes)), ascending

    Raises
    ------
    ModelError
        If the modes of the highest speed are not combinations of those of the basis.
    """
    first = body.given.rotor_speed
    omega, omega2, moved = others[-1]
    item = f"modes of nodal diameter {d} at {omega:g} rad/s"
    body.require(moved.shape[1] == basis.n_modes, item, f"{basis.n_modes} modes as at {first:g} rad/s", moved.shape[1])
    known = ~(np.isnan(shapes).any(axis=1) | np.isnan(moved).any(axis=1))
    overlap = np.linalg.lstsq(shapes[known], moved[known], rcond=None)[0]
    left, sizes, right = np.linalg.svd(overlap)
    expected = f"combinations of the modes at {first:g} rad/s (singular values of the overlap within 1 % of 1)"
    overlaps = f"{sizes[-1]:.4g} to {sizes[0]:.4g}; use fewer modes, or speeds nearer together"
    body.require(np.abs(sizes - 1.0).max() <= BOUNDS.agreement, item, expected, overlaps)
    turning = left @ right
    stiffness2 = ((turning * omega2) @ turning.conj().T - np.diag(basis.omega2)) / (omega**2 - first**2)
    stiffness2 = 0.5 * (stiffness2 + stiffness2.conj().T)
    residual2 = None if basis.flexibility is None else np.zeros_like(basis.flexibility)
    out = basis.with_speed(stiffness2, residual2, first, source=body.given.source)
    body.checks.append(f"{body.name}, nodal diameter {d}: overlap of modes over speed at least {sizes[-1]:.5g}")
    for middle, found, _ in others[:-1]:
        assert out.speed is not None
        reduced = np.linalg.eigvalsh(out.speed.stiffness(middle))
        n = max(1, min(len(reduced), len(found)) // 2)
        error = float(np.abs(np.sqrt(reduced[:n] / np.sort(found)[:n]) - 1.0).max())
        out = replace(out, speed=replace(out.speed, checked_at=middle, error=error))
    return out
