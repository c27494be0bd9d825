r"""Residual vectors: static shapes of forces and responses that complete the retained modes.

A force at a location deforms a body statically, and the retained modes represent a part of this shape.  Let :math:`L` be
the modes and static shapes of the model that are not retained (mass 1, stiffness :math:`\Omega^2`), and :math:`c` the
forces and responses of the study in these coordinates.  The residual vectors are :math:`X = \Omega_L^{-2} c`.  Their Ritz
vectors

.. math:: S = X V, \qquad V^H X^H \Omega_L^2 X V = \Lambda,\quad V^H X^H X V = 1

are additional coordinates of mass 1 and stiffness :math:`\Lambda`, orthogonal to the retained modes.  The omitted
coordinates are projected by :math:`T = 1 - S \Lambda^{-1} S^H \Omega_L^2`, so that no force at a location has a static
response in them.  :math:`T \Omega_L^{-2} T^H = \Omega_L^{-2} - S \Lambda^{-1} S^H` and its inertia are exact, so residual
flexibility, omitted modes and stress have the same formulas as without residual vectors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.model.kinematics import retained_modes
from bdamper.model.modal_basis import ModalBasis
from bdamper.model.structure import Body, Model

PARALLEL = 1e-6
"""Relative size of a residual vector, perpendicular to the others, that counts as zero."""

Place = tuple[str, NDArray]
"""Location and direction (3,) of a force or a response."""


def completed(
    model: Model,
    places: Sequence[Place],
    blade_modes: int,
    damper_modes: Mapping[str, int],
    rigid: Sequence[str],
) -> tuple[Model, dict[str, NDArray]]:
    """Add the residual vectors of forces and responses to a model and to its retained modes, if it has static shapes.

    Parameters
    ----------
    model : Model
    places : sequence of (location, direction (3,))
    blade_modes, damper_modes, rigid : int, mapping of body name to int, sequence of str
        See :func:`bdamper.model.kinematics.retained_modes`.

    Returns
    -------
    model : Model
        Residual vectors are the last coordinates of each basis.
    modes : mapping of body name to (n,) int
        Retained modes and residual vectors, the same number at every nodal diameter.
    """
    modes = retained_modes(model, blade_modes, damper_modes, rigid)
    bodies, retained, stress = dict(model.bodies), dict(modes), dict(model.stress)
    for name, body in model.bodies.items():
        on_body = [
            (location, direction)
            for location, direction in places
            if model.locations[location].body == name
        ]
        if not on_body or all(basis.static_shapes is None for basis in body.bases.values()):
            continue
        n = len(modes[name])
        parts = {d: _energies(basis, n, on_body) for d, basis in body.bases.items()}
        count = min(
            int((size > PARALLEL * size.max(initial=0.0)).sum()) for _, size in parts.values()
        )
        if not count:
            continue
        complete = {
            d: _with_vectors(basis, n, parts[d][0][:, :count]) for d, basis in body.bases.items()
        }
        bodies[name] = _transformed(
            body, {d: basis for d, (basis, _) in complete.items()}, complete[0][1]
        )
        retained[name] = np.concatenate([modes[name], np.arange(count) + len(complete[0][1])])
        for key, rows in stress.items():
            if rows.body == name:
                stress[key] = replace(
                    rows, modes={d: s @ complete[d][1] for d, s in rows.modes.items()}
                )
    return replace(model, bodies=bodies, stress=stress), retained


def _energies(basis: ModalBasis, n: int, places: Sequence[Place]) -> tuple[NDArray, NDArray]:
    """Return orthonormal combinations (m, k) of ``Omega_L X``, with columns scaled to length 1, and singular values."""
    loads = (
        np.array([direction @ basis.locations[location] for location, direction in places])[:, n:]
        .conj()
        .T
    )
    scaled = loads / np.sqrt(basis.omega2[n:])[:, None]
    length = np.linalg.norm(scaled, axis=0)
    return np.linalg.svd(scaled[:, length > 0.0] / length[length > 0.0], full_matrices=False)[:2]


def _with_vectors(basis: ModalBasis, n: int, energies: NDArray) -> tuple[ModalBasis, NDArray]:
    """Append k residual vectors to a basis; return it and the matrix to the previous coordinates."""
    root = np.sqrt(basis.omega2[n:])[:, None]
    shapes = energies / root
    square, V = np.linalg.eigh(shapes.conj().T @ shapes)
    omega2, shapes = 1.0 / square[::-1], (shapes @ V / np.sqrt(square))[:, ::-1]
    total, count = basis.n_modes, len(omega2)
    moved = np.concatenate([rows[:, n:] @ shapes for rows in basis.locations.values()])
    largest = np.take_along_axis(moved, np.abs(moved).argmax(axis=0)[None], axis=0)[0]
    shapes = shapes * np.divide(
        np.abs(largest), largest, out=np.ones_like(largest), where=largest != 0.0
    )
    T = np.eye(total, total + count, dtype=shapes.dtype)
    T[n:, n:total] -= (shapes / omega2) @ shapes.conj().T * basis.omega2[n:]
    T[n:, total:] = shapes
    ratio = (np.abs(shapes) ** 2).T @ (basis.damping_ratio[n:] * root[:, 0]) / np.sqrt(omega2)
    complete = replace(
        basis,
        omega2=np.concatenate([basis.omega2, omega2]),
        damping_ratio=np.concatenate([basis.damping_ratio, ratio]),
        contact_modes=basis.contact_modes @ T,
        locations={name: rows @ T for name, rows in basis.locations.items()},
        speed=None,
        static_shapes=count,
    )
    return complete, T


def _transformed(body: Body, bases: dict[int, ModalBasis], mean: NDArray) -> Body:
    """Return the body with new bases; ``mean`` is the transformation at nodal diameter 0."""
    load = body.load and replace(body.load, generalised=mean.real.T @ body.load.generalised)
    force = None if body.constant_force is None else mean.real.T @ body.constant_force
    return replace(body, bases=bases, load=load, constant_force=force)
