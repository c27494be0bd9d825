r"""Residual vectors: static shapes of forces and responses that complete the retained modes.

A force at a location deforms a body statically, and the retained modes represent a part of this
shape.  Let :math:`L` be the modes and static shapes of the model that are not retained (mass 1,
stiffness :math:`\Omega^2`), and :math:`c` the forces and responses of the study in these
coordinates.  The residual vectors are :math:`X = \Omega_L^{-2} c`.  Their Ritz vectors

.. math:: S = X V, \qquad V^H X^H \Omega_L^2 X V = \Lambda,\quad V^H X^H X V = 1

are additional coordinates of mass 1 and stiffness :math:`\Lambda`, orthogonal to the retained
modes.  The omitted coordinates are projected by :math:`T = 1 - S \Lambda^{-1} S^H \Omega_L^2`, so
that no force at a location has a static response in them.
:math:`T \Omega_L^{-2} T^H = \Omega_L^{-2} - S \Lambda^{-1} S^H` and its inertia are exact, so
residual flexibility, omitted modes and stress have the same formulas as without residual vectors.
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
    """Add the residual vectors of forces and responses to a model with static shapes.

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
    bodies = dict(model.bodies)
    retained = dict(modes)
    stress = dict(model.stress)
    for name, body in model.bodies.items():
        on_body = []
        for location, direction in places:
            if model.locations[location].body == name:
                on_body.append((location, direction))
        has_shapes = any(basis.static_shapes is not None for basis in body.bases.values())
        if not on_body or not has_shapes:
            continue
        n = len(modes[name])
        combinations = {d: _combinations(basis, n, on_body) for d, basis in body.bases.items()}
        # the same number at every nodal diameter
        count = min(columns.shape[1] for columns in combinations.values())
        if not count:
            continue

        bases = {}
        transformations = {}
        for d, basis in body.bases.items():
            columns = combinations[d][:, :count]
            bases[d], transformations[d] = _with_vectors(basis, n, columns)
        # static loads and constant forces act at nodal diameter 0
        bodies[name] = _transformed(body, bases, transformations[0])
        # the residual vectors follow all previous coordinates
        first = len(transformations[0])
        residual_vectors = np.arange(count) + first
        retained[name] = np.concatenate([modes[name], residual_vectors])
        for key, points in stress.items():
            if points.body == name:
                transformed = {d: s @ transformations[d] for d, s in points.modes.items()}
                stress[key] = replace(points, modes=transformed)
    return replace(model, bodies=bodies, stress=stress), retained


def _combinations(basis: ModalBasis, n: int, places: Sequence[Place]) -> NDArray:
    """Return orthonormal combinations (m, k) of ``Omega_L X``, with columns scaled to length 1.

    They are in descending order of their singular values, without those that count as zero.  The
    first n modes are retained.
    """
    # (n_places, n_modes); loads (n_omitted, n_places) on the omitted coordinates
    rows = np.array([direction @ basis.locations[location] for location, direction in places])
    loads = rows[:, n:].conj().T
    frequency = np.sqrt(basis.omega2[n:])
    scaled = loads / frequency[:, None]
    # a load that does not act on the omitted coordinates has no residual vector
    length = np.linalg.norm(scaled, axis=0)
    acts = length > 0.0
    unit_columns = scaled[:, acts] / length[acts]
    combinations, size, _ = np.linalg.svd(unit_columns, full_matrices=False)
    is_independent = size > PARALLEL * size.max(initial=0.0)
    count = int(is_independent.sum())
    return combinations[:, :count]


def _with_vectors(basis: ModalBasis, n: int, energies: NDArray) -> tuple[ModalBasis, NDArray]:
    """Append k residual vectors to a basis; return it and the matrix to the previous coordinates.

    ``energies`` (m, k) contains the combinations of :func:`_combinations`.
    """
    # static shapes (m, k) of unit strain energy, in the omitted coordinates
    frequency = np.sqrt(basis.omega2[n:])
    static_shapes = energies / frequency[:, None]
    # orthogonal and mass-normalised; eigenvalues ascend, and the longest shape has the lowest
    # frequency
    squared_length, V = np.linalg.eigh(static_shapes.conj().T @ static_shapes)
    omega2 = 1.0 / squared_length[::-1]
    normalised = static_shapes @ V / np.sqrt(squared_length)
    shapes = normalised[:, ::-1]

    # the largest component of the motion at the locations is positive
    at_locations = [rows[:, n:] @ shapes for rows in basis.locations.values()]
    # (3 n_locations, k)
    moved = np.concatenate(at_locations)
    row_of_largest = np.abs(moved).argmax(axis=0)
    largest = moved[row_of_largest, np.arange(moved.shape[1])]
    no_turn = np.ones_like(largest)
    turn = np.divide(np.abs(largest), largest, out=no_turn, where=largest != 0.0)
    shapes = shapes * turn

    # columns of T: the previous coordinates, less the part that the residual vectors replace, then
    # the residual vectors
    total = basis.n_modes
    count = len(omega2)
    T = np.eye(total, total + count, dtype=shapes.dtype)
    T[n:, n:total] -= (shapes / omega2) @ shapes.conj().T * basis.omega2[n:]
    T[n:, total:] = shapes

    # the omitted modes damp the residual vectors in proportion to their shares
    rate = basis.damping_ratio[n:] * frequency
    shares = np.abs(shapes) ** 2
    ratio = shares.T @ rate / np.sqrt(omega2)
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
    load = body.load
    if load is not None:
        load = replace(load, generalised=mean.real.T @ load.generalised)
    force = body.constant_force
    if force is not None:
        force = mean.real.T @ force
    return replace(body, bases=bases, load=load, constant_force=force)
