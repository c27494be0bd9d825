r"""The reduced wheel: blades that move in one shape of their family and in those of the contacts' flexibility.

With :math:`\phi_{dj}` the free modes of the tuned wheel at every nodal diameter d, j the family of the peak, and
:math:`\omega_0` the frequency of the tuned peak,

.. math::
    W = \frac1N \sum_d \sum_{i \ne j} \frac{\phi_{di} \phi_{di}^H}{\omega_{di}^2 - \omega_0^2} , \qquad
    \sqrt{k} B W B^T \sqrt{k} = U S U^T ,

with the motion B of the contact points by the blade and their stiffness k, the shapes are :math:`W B^T \sqrt{k} U` of the
largest S, and the one shape that all :math:`\phi_{dj}` have in common.  Blades move in them about the static state of the
whole wheel; dampers and contact points are those of the whole wheel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.mistuning.loaded_wheel import Loaded
from bdamper.mistuning.structure import Structure

SHAPES = 12
"""Of the contacts' flexibility.  On the shipped disk (9 points, 54 rows of motion) the stuck frequency of five nodal
diameters is off by 47, 3.5, 1.1, 0.3 and 0.1 Hz with 1, 4, 8, 10 and 12."""

CLOSE = 2e-3
"""Relative change of the free and the stuck frequency up to which shapes serve.  With 65 real blades it is 2e-4 and 7e-5.
Of lumped wheels with fourteen random attachments the stuck one changes by 5e-2, and peaks came out a quarter as high."""


def close(structure: Structure, shapes: NDArray, omega: float) -> bool:
    """Whether the wave of the engine order has the same frequencies near one (rad/s) in shapes, dampers free and stuck."""
    d = int(structure.tuned.engine_order) % structure.n_blades
    for share in (0.0, 1.0):
        springs = share * structure.tuned.point_stiffness
        one, other = (np.sqrt(np.abs(s.wave(d, springs)[0])) for s in (structure, structure.reduced(shapes)))
        nearest = one[np.argmin(np.abs(one - omega))]
        if np.abs(other - nearest).min() > CLOSE * nearest:
            return False
    return True


def family_shapes(structure: Structure, omega: float) -> NDArray:
    """(n, m) shapes of the blades about a frequency (rad/s), of mass one: ever more flexible ones, the family's own last.

    Parameters
    ----------
    structure : Structure
    omega : float, rad/s
        Of the tuned peak; the family is that of the free mode below it at the engine order.
    """
    tuned, local, N = structure.tuned, structure.local, structure.n_blades
    modes = [local.modes(d) for d in range(N // 2 + 1)]
    e = int(tuned.engine_order) % N
    family = max(int(np.searchsorted(np.sqrt(modes[min(e, N - e)][0]), 1.001 * omega)) - 1, 0)
    W, own = np.zeros((structure.n, structure.n)), []
    for d, (squares, phi) in enumerate(modes):
        weight = (1.0 if 2 * d % N == 0 else 2.0) / N
        apart = squares - omega**2
        apart[family] = np.inf
        W += weight * ((phi / apart) @ phi.conj().T).real
        own += [phi[:, family].real, phi[:, family].imag]
    inside = (structure.n - structure.n_root, 0)
    M = structure.mass + np.pad(structure.disk_mass.mean(axis=0).real, inside)
    L = np.linalg.cholesky(M)
    common = np.linalg.solve(L.T, np.linalg.svd(L.T @ np.array(own).T, full_matrices=False)[0][:, 0])
    seen = np.sqrt(tuned.point_stiffness).reshape(-1, 1) * structure.rows[..., : structure.n].reshape(-1, structure.n)
    _, V = np.linalg.eigh(seen @ W @ seen.T)
    found = np.column_stack([W @ seen.T @ V[:, -SHAPES:], common])
    return np.asarray(found / np.sqrt(np.einsum("ij,ik,kj->j", found, M, found)))


def reduced_state(structure: Structure, state: Loaded, shapes: NDArray) -> Loaded:
    """The static state as that from which blades move in their shapes, with the forces that remain there."""
    n = structure.n
    at, load = state.mean[:, :n], state.load
    moved = structure.motion(np.pad(at, ((0, 0), (0, structure.n_damper)))).reshape(-1, 3)
    left = (load[:, :n] - structure.elastic_forces(at)) @ shapes
    still = np.zeros((len(at), shapes.shape[1]))
    return replace(
        state, points=replace(state.points, shift=state.points.shift + moved), load=np.hstack([left, load[:, n:]]),
        mean=np.hstack([still, state.mean[:, n:]]),
    )  # fmt: skip
