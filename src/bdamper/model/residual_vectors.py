r"""Static residual vectors of forces and responses beside the modes that a study retains.

A force f at a location moves a body by its static shape, of which the retained modes carry a part.  With the coordinates of
all modes and static shapes that the model stores (mass 1, stiffness :math:`\Omega^2`), :math:`L` those left out and
:math:`c` the forces and responses of the study on them, the residual vectors are :math:`X = \Omega_L^{-2} c`.  Their Ritz
vectors

.. math:: S = X V, \qquad V^H X^H \Omega_L^2 X V = \Lambda,\quad V^H X^H X V = 1

are further coordinates of mass 1 and stiffness :math:`\Lambda`, orthogonal to the modes.  What is left out then answers
other forces as :math:`T = 1 - S \Lambda^{-1} S^H \Omega_L^2` leaves it, which moves no location statically: both
:math:`T \Omega_L^{-2} T^H = \Omega_L^{-2} - S \Lambda^{-1} S^H` and its inertia are exact, so that residual flexibility,
left-out modes and stress keep their formulas.
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
"""Size of a residual vector beside the others, of length 1, below which it is a combination of them."""

Place = tuple[str, NDArray]
"""A location and a direction (3,) of a force or a response."""


def completed(
    model: Model, places: Sequence[Place], blade_modes: int, damper_modes: Mapping[str, int], rigid: Sequence[str]
) -> tuple[Model, dict[str, NDArray]]:
    """The model and the retained modes of its bodies with the residual vectors of places, where it stores static shapes.

    Parameters
    ----------
    model : Model
    places : sequence of (location, direction (3,))
    blade_modes, damper_modes, rigid : int, mapping of body name to int, sequence of str
        As in :func:`bdamper.model.kinematics.retained_modes`.

    Returns
    -------
    model : Model
        Residual vectors come after everything that a basis has.
    modes : mapping of body name to (n,) int
        With the residual vectors, as many at every nodal diameter.
    """
    modes = retained_modes(model, blade_modes, damper_modes, rigid)
    bodies, retained, stress = dict(model.bodies), dict(modes), dict(model.stress)
    for name, body in model.bodies.items():
        own = [(place, along) for place, along in places if model.locations[place].body == name]
        if not own or all(basis.static_shapes is None for basis in body.bases.values()):
            continue
        n = len(modes[name])
        parts = {d: _energies(basis, n, own) for d, basis in body.bases.items()}
        count = min(int((size > PARALLEL * size.max(initial=0.0)).sum()) for _, size in parts.values())
        if not count:
            continue
        made = {d: _turned(basis, n, parts[d][0][:, :count]) for d, basis in body.bases.items()}
        bodies[name] = _of_body(body, {d: basis for d, (basis, _) in made.items()}, made[0][1])
        retained[name] = np.concatenate([modes[name], np.arange(count) + len(made[0][1])])
        for key, rows in stress.items():
            if rows.body == name:
                stress[key] = replace(rows, modes={d: s @ made[d][1] for d, s in rows.modes.items()})
    return replace(model, bodies=bodies, stress=stress), retained


def _energies(basis: ModalBasis, n: int, places: Sequence[Place]) -> tuple[NDArray, NDArray]:
    """Orthonormal combinations (m, k) of the residual vectors times ``Omega_L``, each of length 1 before, and sizes."""
    loads = np.array([along @ basis.locations[place] for place, along in places])[:, n:].conj().T
    scaled = loads / np.sqrt(basis.omega2[n:])[:, None]
    length = np.linalg.norm(scaled, axis=0)
    return np.linalg.svd(scaled[:, length > 0.0] / length[length > 0.0], full_matrices=False)[:2]


def _turned(basis: ModalBasis, n: int, energies: NDArray) -> tuple[ModalBasis, NDArray]:
    """The basis with residual vectors at its end, and all its coordinates in the former ones (n_modes, n_modes + k)."""
    root = np.sqrt(basis.omega2[n:])[:, None]
    shapes = energies / root
    square, V = np.linalg.eigh(shapes.conj().T @ shapes)
    omega2, shapes = 1.0 / square[::-1], (shapes @ V / np.sqrt(square))[:, ::-1]
    total, count = basis.n_modes, len(omega2)
    moved = np.concatenate([rows[:, n:] @ shapes for rows in basis.locations.values()])
    largest = np.take_along_axis(moved, np.abs(moved).argmax(axis=0)[None], axis=0)[0]
    shapes = shapes * np.divide(np.abs(largest), largest, out=np.ones_like(largest), where=largest != 0.0)
    T = np.eye(total, total + count, dtype=shapes.dtype)
    T[n:, n:total] -= (shapes / omega2) @ shapes.conj().T * basis.omega2[n:]
    T[n:, total:] = shapes
    ratio = (np.abs(shapes) ** 2).T @ (basis.damping_ratio[n:] * root[:, 0]) / np.sqrt(omega2)
    made = replace(
        basis,
        omega2=np.concatenate([basis.omega2, omega2]),
        damping_ratio=np.concatenate([basis.damping_ratio, ratio]),
        contact_modes=basis.contact_modes @ T,
        locations={name: rows @ T for name, rows in basis.locations.items()},
        speed=None,
        static_shapes=count,
    )
    return made, T


def _of_body(body: Body, bases: dict[int, ModalBasis], mean: NDArray) -> Body:
    """The body with other coordinates; ``mean`` gives those of nodal diameter 0 in the former ones."""
    load = body.load and replace(body.load, generalised=mean.real.T @ body.load.generalised)
    force = None if body.constant_force is None else mean.real.T @ body.constant_force
    return replace(body, bases=bases, load=load, constant_force=force)
