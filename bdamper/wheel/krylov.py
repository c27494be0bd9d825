"""Iterative solution of linear equations whose matrix is near the identity: GMRES."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Operator = Callable[[NDArray], NDArray]


def gmres(product: Operator, b: NDArray, tolerance: float, most: int = 60) -> tuple[NDArray, int, float]:
    """Solve ``A x = b``.

    Parameters
    ----------
    product : callable
        ``A x``, linear.
    b : (n,) float
    tolerance : float
        On the norm of ``b - A x``, relative to that of ``b``.
    most : int
        Iterations.

    Returns
    -------
    x : (n,) float
    iterations : int
    residual : float
        Relative; above ``tolerance`` where the iterations were used up.
    """
    norm = float(np.sqrt(b @ b))
    if norm == 0.0:
        return np.zeros_like(b), 0, 0.0
    V = np.empty((most + 1, len(b)))
    H = np.zeros((most + 1, most))
    cosine, sine, g = np.zeros(most), np.zeros(most), np.zeros(most + 1)
    V[0], g[0], k = b / norm, norm, 0
    while k < most:
        w = product(V[k])
        for _ in range(2):  # orthogonal to rounding
            h = V[: k + 1] @ w
            w -= h @ V[: k + 1]
            H[: k + 1, k] += h
        size = float(np.sqrt(w @ w))
        for i in range(k):
            a, c = H[i, k], H[i + 1, k]
            H[i, k], H[i + 1, k] = cosine[i] * a + sine[i] * c, cosine[i] * c - sine[i] * a
        r = float(np.hypot(H[k, k], size))
        if r == 0.0:
            break
        cosine[k], sine[k] = H[k, k] / r, size / r
        H[k, k], g[k + 1], g[k] = r, -sine[k] * g[k], cosine[k] * g[k]
        k += 1
        if abs(g[k]) <= tolerance * norm or size <= 1e-15 * norm:
            break
        V[k] = w / size
    y = np.linalg.solve(np.triu(H[:k, :k]), g[:k]) if k else np.zeros(0)
    return y @ V[:k], k, abs(float(g[k])) / norm
