"""Contact points of a wheel under a load that grows slowly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED
from bdamper.contact.points import PointArrays
from bdamper.contact.preload import law_tangent, limited_forces
from bdamper.harmonic_balance.many_points import PAIRS


@dataclass(frozen=True, eq=False)
class StaticPoints:
    """Contact points under a slowly growing load: the mean alone moves.

    Parameters
    ----------
    points : PointArrays
        ``slider`` is that of the step before.
    """

    points: PointArrays

    def forces(self, x: NDArray, tangent: bool = True) -> tuple[NDArray, NDArray, NDArray | None]:
        """As :meth:`bdamper.harmonic_balance.many_points.ManyPoints.forces`; no shares."""
        p, u = self.points, x[..., 0]
        trial = p.kt * (u[:, :2] - p.slider)
        level = p.n0 + p.kn * u[:, 2]
        force, status = limited_forces(level, trial, p.mu)
        bonded = p.law == LAW_BONDED
        force[bonded, :2], force[bonded, 2], status[bonded] = trial[bonded], level[bonded], 0
        F, share = np.zeros_like(x), np.zeros((len(x), 5))
        F[..., 0] = force
        if not tangent:
            return F, share, None
        T = np.zeros((len(x), len(PAIRS), x.shape[2], x.shape[2]))
        B = law_tangent(p.kt, p.kn, p.mu, status)
        for k, (a, b) in enumerate(PAIRS):
            T[:, k, 0, 0] = B[:, a, b]
        return F, share, T
