"""Elimination of a ring: equations in which every sector meets the one before and the one after.

    L_n x_(n-1) + D_n x_n + U_n x_(n+1) = b_n,    n counted modulo N.

The last sector is the border: the others are eliminated one after another, each with what it couples to the next one and to
the last.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Ring:
    """Factors of a ring of at least three sectors.

    Parameters
    ----------
    inverse : (N, s, s) float
        Of the diagonal block of every sector when its turn comes.
    lower, last : (N - 1, s, s) float
        Coupling of the next sector, and of the last one, to each.
    onward, fill : (N - 1, s, s) float
        Inverse times the coupling to the next sector, and to the last one.
    """

    inverse: NDArray
    lower: NDArray
    last: NDArray
    onward: NDArray
    fill: NDArray

    @classmethod
    def of(cls, lower: NDArray, diagonal: NDArray, upper: NDArray) -> Self:
        """Factors of the blocks L, D, U (N, s, s) of the module's docstring."""
        N, s, _ = diagonal.shape
        inverse, D = np.empty_like(diagonal), diagonal[0]
        V, W, end = upper[N - 1], lower[0], diagonal[N - 1]
        rows, last = np.zeros((N - 1, s, s)), np.empty((N - 1, s, s))
        onward, fill = np.zeros((N - 1, s, s)), np.empty((N - 1, s, s))
        for n in range(N - 1):
            if n == N - 2:
                V, W = V + lower[N - 1], W + upper[N - 2]
            inverse[n], last[n] = np.linalg.inv(D), V
            fill[n] = inverse[n] @ W
            end = end - V @ fill[n]
            if n < N - 2:
                onward[n], rows[n] = inverse[n] @ upper[n], lower[n + 1]
                D = diagonal[n + 1] - rows[n] @ onward[n]
                V, W = -V @ onward[n], -rows[n] @ fill[n]
        inverse[N - 1] = np.linalg.inv(end)
        return cls(inverse, rows, last, onward, fill)

    def solve(self, b: NDArray) -> NDArray:
        """x (N, s) of the right-hand sides b (N, s)."""
        N = len(self.inverse)
        x = b.copy()
        for n in range(N - 1):
            x[n] = self.inverse[n] @ x[n]
            if n < N - 2:
                x[n + 1] -= self.lower[n] @ x[n]
            x[N - 1] -= self.last[n] @ x[n]
        x[N - 1] = self.inverse[N - 1] @ x[N - 1]
        for n in range(N - 2, -1, -1):
            x[n] -= self.fill[n] @ x[N - 1]
            if n < N - 2:
                x[n] -= self.onward[n] @ x[n + 1]
        return x
