r"""Travelling waves from modes of other programs, whose phase convention is not known.

Programs differ in the sign of the phase, in the direction in which they count sectors, and in how they split a wave into
real shapes.  The faces of the sector decide: at their matching nodes, :math:`x_R = R x_L`, a wave of nodal diameter d
toward +X satisfies (paper, Eq. (17))

.. math:: u(x_R) = e^{+ 2\pi i d/N} R\,u(x_L) .

A complex shape that satisfies it with the other sign is replaced by its conjugate.  A pair of real shapes a, b of one
frequency is combined to :math:`a + c\,b` with the c of least squares,

.. math:: c = - \frac{\langle \delta b, \delta a\rangle}{\langle \delta b, \delta b\rangle},\qquad
          \delta u = u(x_R) - e^{2\pi i d/N} R\,u(x_L) .

For d = 0 and d = N/2 every shape is real up to a factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bdamper.fem.fe_matrices import check
from bdamper.fem.sector_faces import SectorFaces

PAIR_TOLERANCE, PHASE_TOLERANCE = 1e-4, 1e-3
"""Relative difference of frequencies up to which two real shapes can be one wave; violation of the phase condition over
the size of the shape on the faces."""


@dataclass(frozen=True)
class Waves:
    """Travelling waves toward +X.

    Parameters
    ----------
    index : (n,) int
        Of the (first) shape of the file that each wave was made of.
    shapes : (3 n_nodes, n) complex, or float for d = 0 and N/2
        With the length that the file gave them.
    mismatch : (n,) float
        Largest violation of the phase condition, relative to the size on the faces.
    turned : int
        Waves that went the other way in the file.
    combined : int
        Waves made of two real shapes.
    """

    index: NDArray
    shapes: NDArray
    mismatch: NDArray
    turned: int
    combined: int


def _difference(shapes: NDArray, faces: SectorFaces, d: int) -> NDArray:
    """(k, n) violation of the phase condition on the faces."""
    u = shapes.reshape(-1, 3, shapes.shape[1])
    phase, rotation = faces.tie(d)
    own = (faces.weights @ u[faces.independent].reshape(len(faces.independent), -1)).reshape(-1, *u.shape[1:])
    return np.asarray(u[faces.dependent] - phase * np.einsum("ij,njm->nim", rotation, own)).reshape(-1, shapes.shape[1])


def travelling_waves(frequency: NDArray, shapes: NDArray, faces: SectorFaces, nodal_diameter: int) -> Waves:
    """Waves toward +X from the shapes of a file.

    Parameters
    ----------
    frequency : (m,) float, Hz
    shapes : (3 n_nodes, m) float or complex
        In the axes of a model.
    faces : SectorFaces
    nodal_diameter : int

    Raises
    ------
    ValueError
        If a shape, or a pair of shapes, is no wave of this nodal diameter.
    """
    d, n = nodal_diameter, faces.n_sectors
    check(0 <= d <= n // 2, f"nodal diameter {d}: expected 0 to {n // 2} with {n} sectors")
    size = np.linalg.norm(shapes.reshape(-1, 3, len(frequency))[faces.nodes], axis=(0, 1))
    whole = np.linalg.norm(shapes, axis=0)
    # A mode that leaves the faces at rest does not determine the phase; its size elsewhere is the scale then.
    size = np.maximum(size, 1e-6 * whole)
    if 2 * d % n == 0:
        return _standing(frequency, shapes, faces, d, size)
    forward = _difference(shapes, faces, d)
    if np.iscomplexobj(shapes) and np.abs(shapes.imag).max() > 1e-9 * np.abs(shapes).max():
        ahead = np.linalg.norm(forward, axis=0) / size
        behind = np.linalg.norm(_difference(shapes.conj(), faces, d), axis=0) / size
        error = np.minimum(ahead, behind)
        _refuse(error, frequency, d, "")
        other = behind < ahead
        return Waves(np.arange(len(frequency)), np.where(other, shapes.conj(), shapes), error, int(other.sum()), 0)
    real = shapes.real
    index: list[int] = []
    waves, errors = [], []
    for k in range(0, len(frequency), 2):
        if k + 1 == len(frequency) or abs(frequency[k + 1] - frequency[k]) > PAIR_TOLERANCE * frequency[k]:
            if k + 1 == len(frequency) and index:  # the partner of the last shape was not written
                break
            alone = "no partner of the same frequency, and a real shape alone is no travelling wave"
            raise ValueError(f"nodal diameter {d}: the shape of {frequency[k]:.6g} Hz has {alone}")
        a, b = forward[:, k], forward[:, k + 1]
        c = -np.vdot(b, a) / max(np.vdot(b, b).real, 1e-300)
        error = float(np.linalg.norm(a + c * b) / np.hypot(size[k], abs(c) * size[k + 1]))
        index.append(k)
        waves.append(real[:, k] + c * real[:, k + 1])
        errors.append(error)
    found = np.array(errors)
    _refuse(found, frequency[np.array(index, int)], d, "the pair of shapes ")
    return Waves(np.array(index, int), np.array(waves).T, found, 0, len(index))


def _standing(frequency: NDArray, shapes: NDArray, faces: SectorFaces, d: int, size: NDArray) -> Waves:
    """Nodal diameters 0 and N/2: remove the common phase of each shape, and check the faces."""
    if np.iscomplexobj(shapes):
        square = np.einsum("ij,ij->j", shapes, shapes)
        shapes = shapes * np.exp(-0.5j * np.angle(square))
        rest = np.linalg.norm(shapes.imag, axis=0) / np.maximum(np.linalg.norm(shapes, axis=0), 1e-300)
        _refuse(rest, frequency, d, "the imaginary part of ")
        shapes = shapes.real
    error = np.linalg.norm(_difference(shapes, faces, d), axis=0) / size
    _refuse(error, frequency, d, "")
    return Waves(np.arange(len(frequency)), np.array(shapes), error, 0, 0)


def _refuse(error: NDArray, frequency: NDArray, d: int, what: str) -> None:
    if len(error) and not error.max() <= PHASE_TOLERANCE:
        k = int(np.argmax(error))
        why = "does not repeat from one sector face to the other with the phase of a wave of this nodal diameter"
        off = f"in either direction (off by {100.0 * error[k]:.3g} %)"
        raise ValueError(f"nodal diameter {d}: {what}{frequency[k]:.6g} Hz {why}, {off}")
