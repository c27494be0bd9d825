"""Factorisation of sparse stiffness matrices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu


class Factors(Protocol):
    """Factorisation of a positive definite matrix."""

    def solve(self, force: NDArray) -> NDArray:
        """Return the displacements (n, ...) under real or complex forces (n, ...)."""

    @property
    def pivots(self) -> NDArray:
        """Pivots (n,).  If a program knows their signs, these are the signs of the eigenvalues."""


def solve_by_parts(solve: Callable[[NDArray], NDArray], force: NDArray) -> NDArray:
    """Apply the ``solve`` of a real matrix to real or complex forces (n, ...)."""
    if not np.iscomplexobj(force):
        return solve(np.ascontiguousarray(force))
    columns = force.reshape(len(force), -1)
    n_columns = columns.shape[1]
    parts = solve(np.hstack([columns.real, columns.imag]))
    displacement = parts[:, :n_columns] + 1j * parts[:, n_columns:]
    return np.asarray(displacement.reshape(force.shape))


class SuperLUFactors:
    """Factorisation by SuperLU of a real symmetric or complex Hermitian matrix."""

    def __init__(self, matrix: sp.spmatrix) -> None:
        self._is_complex = np.iscomplexobj(matrix)
        self._factors = splu(
            matrix.tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    def solve(self, force: NDArray) -> NDArray:
        """Return the displacements (n, ...) under real or complex forces (n, ...)."""
        if self._is_complex:
            return self._factors.solve(np.ascontiguousarray(force, complex))
        return solve_by_parts(self._factors.solve, force)

    @property
    def pivots(self) -> NDArray:
        """Pivots (n,); positive ones if their signs are unknown."""
        pivots = self._factors.U.diagonal().real
        # only with equal permutations of rows and columns have pivots the signs of the eigenvalues
        if not np.array_equal(self._factors.perm_r, self._factors.perm_c):
            pivots = np.abs(pivots)
        return np.asarray(pivots)


def factorise(matrix: sp.spmatrix) -> Factors:
    """Factorise a sparse positive definite matrix, real symmetric or complex Hermitian.

    Raises
    ------
    ValueError
        If the diagonal is not positive; SuperLU crashes on an empty row in its symmetric mode.
    """
    diagonal = matrix.diagonal().real
    if not (np.isfinite(matrix.data).all() and len(diagonal) and diagonal.min() > 0.0):
        raise ValueError(
            "a positive definite matrix has finite entries and a positive diagonal, "
            "and this one has not"
        )
    return SuperLUFactors(matrix)
