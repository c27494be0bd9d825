"""Factorisation of sparse stiffness matrices.

SuperLU is a part of SciPy.  PARDISO of the Intel Math Kernel Library (extra ``bdamper[large]``)
takes less time and memory for large matrices.
"""

from __future__ import annotations

import ctypes
import importlib
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from bdamper.util.errors import warn

LARGE = 30_000
"""Equations above which PARDISO is used if it is installed."""

REAL_POSITIVE_DEFINITE = 2
"""Type of a matrix in PARDISO."""
PARDISO_SETTINGS = {1: 1, 2: 2, 18: 0, 56: 1}
"""Parameters by their number in the manual of PARDISO: own settings (1), nested dissection (2),
no count of entries (18), pivots are kept (56)."""


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


class PardisoFactors:
    """Factorisation by PARDISO of a real symmetric positive definite matrix.

    Parameters
    ----------
    pardiso : module
        Module ``pypardiso``.
    matrix : sparse

    Raises
    ------
    pypardiso.pardiso_wrapper.PyPardisoError
        If the matrix is not positive definite.
    """

    def __init__(self, pardiso: Any, matrix: sp.spmatrix) -> None:
        # a symmetric matrix is its upper triangle in sorted rows
        self._upper = sp.triu(matrix, format="csr")
        self._upper.sort_indices()
        self._solver = pardiso.PyPardisoSolver(mtype=REAL_POSITIVE_DEFINITE)
        for number, value in PARDISO_SETTINGS.items():
            self._solver.set_iparm(number, value)
        # the factors are outside the memory of Python
        weakref.finalize(self, self._solver.free_memory, everything=True)
        with self._one_thread():
            self._solver.factorize(self._upper)

    @contextmanager
    def _one_thread(self) -> Iterator[None]:
        """Let the Math Kernel Library compute on one thread, also inside of a sweep.

        The limit on the linear algebra of NumPy holds for libraries that were loaded before it
        (:func:`bdamper.util.progress.single_thread`), and this one is loaded later.  More threads
        would change the last digits.
        """
        set_threads = self._solver.libmkl.MKL_Set_Num_Threads_Local
        before = set_threads(1)
        try:
            yield
        finally:
            set_threads(before)

    def solve(self, force: NDArray) -> NDArray:
        """Return the displacements (n, ...) under real or complex forces (n, ...)."""
        return solve_by_parts(self._solve_real, force)

    def _solve_real(self, force: NDArray) -> NDArray:
        with self._one_thread():
            displacement = self._solver.solve(self._upper, force)
        return np.asarray(displacement.reshape(force.shape))

    @property
    def pivots(self) -> NDArray:
        """Pivots (n,), all of them positive."""
        pivots = np.zeros(self._upper.shape[0])
        diagonal = np.zeros_like(pivots)
        first_matrix = ctypes.c_int32(1)
        error = ctypes.c_int32(0)
        # pypardiso has no function for it, but the library beneath
        self._solver.libmkl.pardiso_getdiag(
            self._solver.pt.ctypes.data_as(ctypes.c_void_p),
            pivots.ctypes.data_as(ctypes.c_void_p),
            diagonal.ctypes.data_as(ctypes.c_void_p),
            ctypes.byref(first_matrix),
            ctypes.byref(error),
        )
        assert error.value == 0, f"PARDISO returns no pivots: error {error.value}"
        return pivots


def factorise(matrix: sp.spmatrix) -> Factors:
    """Factorise a sparse positive definite matrix, real symmetric or complex Hermitian.

    PARDISO factorises large real matrices if it is installed.

    Raises
    ------
    ValueError
        If the diagonal is not positive; SuperLU crashes on an empty row in its symmetric mode.
    """
    diagonal = matrix.diagonal().real
    if not (np.isfinite(matrix.data).all() and len(diagonal) and diagonal.min() > 0.0):
        raise ValueError(
            "a positive definite matrix has finite entries and a positive diagonal; this one "
            "does not"
        )
    if matrix.shape[0] <= LARGE or np.iscomplexobj(matrix):
        return SuperLUFactors(matrix)
    pardiso = _installed_pardiso(matrix.shape[0])
    if pardiso is None:
        return SuperLUFactors(matrix)
    try:
        return PardisoFactors(pardiso, matrix)
    except pardiso.pardiso_wrapper.PyPardisoError:
        # of an indefinite matrix SuperLU shows the negative pivots
        return SuperLUFactors(matrix)


def _installed_pardiso(n_equations: int) -> Any:
    """Return the module ``pypardiso``, or None with a warning that says what to install."""
    try:
        pardiso = importlib.import_module("pypardiso")
    except ImportError:
        # pypardiso also raises it where the Math Kernel Library is missing
        warn(
            f"{n_equations:,} equations take much time and memory with SuperLU: install the extra "
            "bdamper[large]"
        )
        return None
    return pardiso
