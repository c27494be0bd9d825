"""What the C core does for all sectors of a wheel at once: contact points, and the elimination of its equations."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bdamper import _core
from bdamper.contact.laws import Sampled
from bdamper.contact.points import PointArrays
from bdamper.harmonic_balance.system import evaluation_code
from bdamper.util.repr import brief

PAIRS = ((0, 0), (1, 1), (0, 2), (1, 2), (0, 1), (1, 0), (2, 2))
"""Components of force and motion of the blocks of a tangent; the fifth and sixth are of coupled laws alone."""


@brief
@dataclass(frozen=True)
class ManyPoints:
    """Contact points with their law and evaluation.

    Parameters
    ----------
    points : PointArrays
        ``shift`` is not read.
    n_harmonics : int
    evaluation : {"exact"} or Sampled
    """

    points: PointArrays
    n_harmonics: int
    evaluation: str | Sampled = "exact"
    _arrays: tuple[NDArray, ...] = field(init=False, repr=False)
    _code: tuple[int, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        code = evaluation_code(self.evaluation, self.n_harmonics, self.points.law)
        p = self.points
        load = p.n0 if p.load is None else p.load
        arrays = [np.ascontiguousarray(a, float) for a in (p.kt, p.kn, p.mu, p.n0, p.slider, load)]
        object.__setattr__(self, "_arrays", (*arrays, np.ascontiguousarray(p.law, np.intc)))
        object.__setattr__(self, "_code", code)

    def forces(self, x: NDArray, tangent: bool = True) -> tuple[NDArray, NDArray, NDArray | None]:
        """Forces, shares of the cycle and tangents at motions x (n_points, 3, n_coefficients).

        Returns
        -------
        force : (n_points, 3, n_coefficients) float
        shares : (n_points, 5) float
            Stick and slip of both tangential directions, open.
        tangent : (n_points, 7, n_coefficients, n_coefficients) float, or None
            Blocks in the order of ``PAIRS``.
        """
        n, _, m = x.shape
        kt, kn, mu, n0, slider, load, law = self._arrays
        F, share = np.empty_like(x), np.empty((n, 5))
        T = np.empty((n, 7, m, m)) if tangent else None
        _core.evaluate_points(x, kt, kn, mu, n0, slider, load, law, F, share, T, *self._code)
        return F, share, T


Elimination = _core.Wheel
"""The core's elimination of a wheel (csrc/bd_wheel.h): ``factor`` and ``solve``."""
