"""Rigid motions of points, and shapes with a definite phase."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray


def rigid_motions(points: NDArray, centre: NDArray, axes: NDArray, turning: NDArray | None = None) -> NDArray:
    """Unit translations along the rows of ``axes`` (3, 3) and rotations about those of ``turning``: (3 n_points, 6).

    Parameters
    ----------
    points : (n_points, 3) float, m
    centre : (3,) float, m
        On the axes of rotation.
    axes, turning : (3, 3) float
        Rotations are about ``axes``, too, by default.
    """
    turned = np.cross((axes if turning is None else turning)[:, None], points - centre).transpose(1, 2, 0)
    return np.ascontiguousarray(np.concatenate([np.broadcast_to(axes.T, turned.shape), turned], axis=2)).reshape(-1, 6)


def fix_phase(vectors: NDArray, mass: NDArray | sp.spmatrix) -> NDArray:
    """Give each column a definite phase: ``u^T M u`` real and positive, the largest component positive.

    Rows in which vectors are unknown (NaN) decide nothing.

    The first makes the mode as real as it can be, and unlike a rule on one component it cannot jump when two
    components are about equally large; the second decides the remaining sign.
    """
    known = np.nan_to_num(vectors)
    if np.iscomplexobj(vectors):
        square = np.einsum("ij,ij->j", known, mass @ known)
        turn_back = np.exp(-0.5j * np.angle(square))
        vectors, known = vectors * turn_back, known * turn_back
    # In a symmetric body several components are equally large up to rounding: take the first of them.
    size = np.abs(known)
    first = (size > (1.0 - 1e-6) * size.max(axis=0)).argmax(axis=0)
    largest = np.take_along_axis(known, first[None], axis=0)[0]
    return vectors * np.where(largest.real < 0.0, -1.0, 1.0)
