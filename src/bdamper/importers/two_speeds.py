r"""A sector at two rotor speeds: its matrices or its modes, as the data over speed of a model.

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
from scipy.linalg import polar, svdvals

from bdamper.fem.rotation import IN_PLANE, Rotation
from bdamper.importers.fe_body import FEBody
from bdamper.importers.import_tolerances import BOUNDS
from bdamper.importers.prepared_body import PreparedBody
from bdamper.model.fields import require
from bdamper.model.structure import ModalBasis
from bdamper.util import validation
from bdamper.util.errors import SettingError


def over_speed(bodies: Mapping[float, FEBody]) -> FEBody:
    """One body from the same body at two rotor speeds (rad/s), with matrices or with modes of each.

    Parameters
    ----------
    bodies : mapping of rotor speed (rad/s) to FEBody
        ``{0.0: read_calculix("standstill"), 600.0: read_calculix("running")}``.  The modes of the model are those of the
        lower speed.

    Returns
    -------
    FEBody
        For :func:`bdamper.importers.build_model`.

    Raises
    ------
    SettingError, ModelError
        If there are not two speeds, or the bodies are not the same nodes with the same kind of data.
    """
    if not isinstance(bodies, Mapping) or len(bodies) != 2:
        raise validation.unfit("over_speed", "a mapping of two rotor speeds to FEBody", bodies)
    made = []
    for key, value in bodies.items():
        omega = validation.number("rotor speed", key, least=0.0, unit="rad/s")
        body = validation.instance(f"body at {omega:g} rad/s", value, FEBody)
        made.append(replace(body, rotor_speed=omega, faster=None))
    slower, faster = sorted(made, key=lambda body: body.rotor_speed)
    alike, item = np.array_equal(slower.numbers, faster.numbers), f"{faster.source} at {faster.rotor_speed:g} rad/s"
    require(alike, item, f"the nodes of {slower.source}", "other numbers")
    if (slower.stiffness is None) != (faster.stiffness is None):
        raise SettingError("over_speed: expected matrices at both speeds, or modes at both speeds, found one of each")
    return replace(slower, faster=faster)


def rotation_of(body: PreparedBody) -> Rotation | None:
    """How the stiffness of a body with matrices changes with speed; None where only one speed is given.

    Raises
    ------
    ModelError
        If the mass changes with speed.
    """
    if (other := body.faster) is None:
        return None
    first, last = body.given.rotor_speed, other.given.rotor_speed
    norm, mass = scipy.sparse.linalg.norm, body.structure.mass
    same = norm(other.structure.mass - mass) <= 1e-6 * norm(mass)
    body.require(same, f"mass matrix at {last:g} rad/s", "that of the other speed", "another")
    per_squared_speed = ((other.structure.stiffness - body.structure.stiffness) / (last**2 - first**2)).tocsr()
    softening = _spin_softening(body, per_squared_speed)
    if softening < 0.5:
        body.missing.append(
            f"spin softening of the {body.name}: the matrices at {last:g} rad/s take {100 * softening:.3g} % of its mass "
            "in the plane of rotation from the stiffness; frequencies of bending in this plane come out too high"
        )
    body.checks.append(f"{body.name}: stiffness at {first:g} and {last:g} rad/s, spin softening {100 * softening:.4g} %")
    return Rotation(per_squared_speed, first, last, body.given.source)


def _spin_softening(body: PreparedBody, per_squared_speed: NDArray) -> float:
    """Share of the mass in the plane of rotation that is missing from the stiffness, by a translation of inner nodes.

    A translation takes no force from elastic and geometric stiffness.
    """
    structure = body.structure
    held = np.repeat(body.fixed(None).any(axis=1), 3)
    inner = ~held & (np.abs(structure.stiffness) @ held.astype(float) == 0.0)
    translations = np.tile(IN_PLANE[:, :2], (len(structure.nodes), 1))
    inertia = inner[:, None] * (structure.mass @ translations)
    mass = float(np.square(inertia).sum())
    return -float((inertia * (per_squared_speed @ translations)).sum()) / mass if mass else 1.0


def basis_from_modes(
    body: PreparedBody, d: int, basis: ModalBasis, shapes: NDArray, omega2: NDArray, moved: NDArray
) -> ModalBasis:
    """A basis with its data over speed from modes at a higher speed.

    Parameters
    ----------
    body : PreparedBody
    d : int
        Nodal diameter.
    basis : ModalBasis
    shapes : (3 n_nodes, n_modes)
        Mass-normalised modes of the basis, NaN in unknown rows.
    omega2, moved : (n_modes,), (3 n_nodes, n_modes)
        Squared frequencies and mass-normalised modes at the higher speed.

    Raises
    ------
    ModelError
        If the modes of the higher speed are not combinations of those of the basis.
    """
    assert body.given.faster is not None
    first, omega = body.given.rotor_speed, body.given.faster.rotor_speed
    item = f"modes of nodal diameter {d} at {omega:g} rad/s"
    body.require(moved.shape[1] == basis.n_modes, item, f"{basis.n_modes} modes as at {first:g} rad/s", moved.shape[1])
    known = ~(np.isnan(shapes).any(axis=1) | np.isnan(moved).any(axis=1))
    overlap = np.linalg.lstsq(shapes[known], moved[known], rcond=None)[0]
    sizes = svdvals(overlap)
    expected = f"combinations of the modes at {first:g} rad/s (singular values of the overlap within 1 % of 1)"
    overlaps = f"{sizes[-1]:.4g} to {sizes[0]:.4g}; use fewer modes, or speeds nearer together"
    body.require(np.abs(sizes - 1.0).max() <= BOUNDS.agreement, item, expected, overlaps)
    turning = polar(overlap)[0]
    stiffness2 = ((turning * omega2) @ turning.conj().T - np.diag(basis.omega2)) / (omega**2 - first**2)
    body.checks.append(f"{body.name}, nodal diameter {d}: overlap of modes over speed at least {sizes[-1]:.5g}")
    return basis.with_speed(0.5 * (stiffness2 + stiffness2.conj().T), omega_ref=first, source=body.given.source)
