r"""Lowest modes of sparse matrices by Lanczos' method in blocks.

The flexibility :math:`x \mapsto K^{-1} M x` has the largest eigenvalues :math:`1 / \omega^2` in the
lowest modes.  A Krylov space grows by one block of vectors at a time until it contains them: the
solution for six right-hand sides takes much less time than six solutions.

Frequencies have the relative error of the strain energy in double precision, some 1e-10 for the
lowest mode of a slender blade, because the terms of :math:`u^H K u` are up to 1e6 times their sum.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import eigh

from bdamper.fem.surface import hermitian
from bdamper.util.progress import Report, no_report

Solve = Callable[[NDArray], NDArray]
"""Displacements (n, k) under forces (n, k)."""

BLOCK = 6
"""Vectors in a block."""
CONVERGED = 1e-12
"""Residual of a converged mode relative to its eigenvalue."""


def lowest_modes(
    stiffness: sp.spmatrix,
    mass: sp.spmatrix,
    solve: Solve,
    n_modes: int,
    n_rigid: int = 0,
    report: Report = no_report,
) -> tuple[NDArray, NDArray]:
    """Compute the lowest modes of ``stiffness x = omega2 mass x``.

    ``solve`` applies the inverse of the stiffness, apart from ``n_rigid`` motions without force.
    ``report`` receives the number of modes that have converged.

    Returns
    -------
    omega2 : (n_modes,) float, ascending
    shapes : (n, n_modes)
        Mass-normalised.
    """
    n = mass.shape[0]
    if n <= 2 * n_modes + 20:  # too small for a Krylov space
        omega2, shapes = eigh(hermitian(stiffness.toarray()), hermitian(mass.toarray()))
        # without rigid motions
        elastic = np.flatnonzero(omega2 > 1e-12 * np.abs(omega2).max())
        lowest = elastic[elastic >= n_rigid][:n_modes]
        return omega2[lowest], shapes[:, lowest]
    vectors = _most_flexible(mass, solve, n_modes, report)
    # one Rayleigh-Ritz step with the stiffness itself
    adjoint = vectors.conj().T
    reduced_stiffness = hermitian(adjoint @ (stiffness @ vectors))
    reduced_mass = hermitian(adjoint @ (mass @ vectors))
    omega2, combination = eigh(reduced_stiffness, reduced_mass)
    return omega2, vectors @ combination


def _most_flexible(mass: sp.spmatrix, solve: Solve, n_modes: int, report: Report) -> NDArray:
    """Return the vectors (n, n_modes) of the largest eigenvalues of the flexibility."""
    space = _KrylovSpace(mass, solve)
    while True:
        space.grow()
        values, combination = np.linalg.eigh(hermitian(space.flexibility))
        # by size, because an indefinite stiffness has negative ones
        largest = np.argsort(-np.abs(values))[:n_modes]
        highest = combination[:, largest]
        residual = space.residual(highest)
        converged = residual < CONVERGED * np.abs(values[largest])
        large_enough = len(values) >= n_modes + BLOCK
        if space.exhausted or (large_enough and converged.all()):
            report("modes", n_modes, n_modes)
            return np.asarray(space.vectors @ highest)
        # the space may still be too small although all of its modes have converged
        report("modes", min(int(converged.sum()), n_modes - 1), n_modes)


class _KrylovSpace:
    """Mass-orthonormal vectors (n, size) and their flexibility (size, size).

    With 100,000 equations products with the mass take half as long as solutions, and the vectors
    240 MB.  The momentum of the next block is therefore kept, and no conjugate of the vectors is
    formed.
    """

    def __init__(self, mass: sp.spmatrix, solve: Solve) -> None:
        n = mass.shape[0]
        self.mass = mass
        self.solve = solve
        self.vectors: NDArray = np.empty((n, 0), mass.dtype)
        self.flexibility: NDArray = np.empty((0, 0), mass.dtype)
        # a fixed start makes the result reproducible
        start = np.random.default_rng(0).standard_normal((n, BLOCK)).astype(mass.dtype)
        self._next, self._momentum_of_next, _ = _orthonormal(solve(mass @ start), mass)
        self._outside: NDArray = np.empty((0, 0), mass.dtype)

    @property
    def exhausted(self) -> bool:
        """Whether the flexibility does not lead out of the space."""
        return self._next.shape[1] == 0

    def grow(self) -> None:
        """Add a block to the space and compute the next one."""
        block = self._next
        rest = self.solve(self._momentum_of_next)
        self.vectors = np.hstack([self.vectors, block])
        inside = np.zeros((self.vectors.shape[1], block.shape[1]), self.mass.dtype)
        outside = np.eye(block.shape[1])
        # a second time, because rounding disturbs the first projection
        for _ in range(2):
            momentum = self.mass @ rest
            part = (momentum.conj().T @ self.vectors).conj().T
            inside = inside + part @ outside
            rest, momentum_of_rest, factor = _orthonormal(rest - self.vectors @ part, self.mass)
            outside = factor @ outside
        self._border(inside)
        self._next = rest
        self._momentum_of_next = momentum_of_rest
        self._outside = outside

    def _border(self, columns: NDArray) -> None:
        """Extend the flexibility by ``columns`` (size, width) of the latest block."""
        size, width = columns.shape
        flexibility = np.zeros((size, size), columns.dtype)
        flexibility[:-width, :-width] = self.flexibility
        flexibility[:, -width:] = columns
        flexibility[-width:, :] = columns.conj().T
        self.flexibility = flexibility

    def residual(self, combination: NDArray) -> NDArray:
        """Return the part (k,) of the flexible motion of combinations (size, k) outside the
        space."""
        # of all blocks only the latest leads out of the space
        of_latest = combination[-self._outside.shape[1] :]
        return np.linalg.norm(self._outside @ of_latest, axis=0)


def _orthonormal(block: NDArray, mass: sp.spmatrix) -> tuple[NDArray, NDArray, NDArray]:
    """Return mass-orthonormal columns, their momentum, and the factor: block = columns @ factor.

    Dependent columns are dropped.
    """
    momentum = mass @ block
    gram = hermitian(block.conj().T @ momentum)
    square, directions = np.linalg.eigh(gram)
    kept = square > 1e-14 * square.max(initial=0.0)
    size = np.sqrt(square[kept])
    directions = directions[:, kept]
    to_columns = directions / size
    factor = size[:, None] * directions.conj().T
    return block @ to_columns, momentum @ to_columns, factor
