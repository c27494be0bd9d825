"""One mass with a friction element of constant normal load: equations, and closed-form answers by scalar solvers."""

from __future__ import annotations

import numpy as np

from bdamper.coupling import HarmonicBasis
from bdamper.system import LAW_SEPARABLE, HarmonicSystem, PointArrays


def oscillator(
    *,
    mass: float = 1.0,
    stiffness: float = 1.0,
    damping: float = 0.02,
    contact: float = 1.0,
    slip_limit: float = 1.0,
    force: float = 1.0,
    harmonics: int = 1,
) -> HarmonicSystem:
    """``m x'' + c x' + k x + T(x) = F cos(omega t)``, T a spring of stiffness ``contact`` that slips at ``slip_limit``."""
    omega2 = np.array([stiffness / mass])
    ratio = np.array([damping / (2.0 * np.sqrt(stiffness * mass))])
    G = np.zeros((1, 3, 1), complex)
    G[0, 0, 0] = 1.0 / np.sqrt(mass)
    bases = [HarmonicBasis((), omega2, ratio, G, 0, np.ones(1)) for _ in range(harmonics + 1)]
    points = PointArrays(
        kt=np.array([[contact, 0.0]]),
        kn=np.array([0.0]),
        mu=np.array([slip_limit]),
        n0=np.array([1.0]),
        slider=np.zeros((1, 2)),
        law=np.array([LAW_SEPARABLE]),
        shift=np.zeros((1, 3)),
    )
    u = np.zeros(2 * harmonics + 1)
    u[1] = force / np.sqrt(mass)
    row = np.array([1.0 / np.sqrt(mass)])
    return HarmonicSystem(bases, points, u, [row] * (harmonics + 1), "exact", (force, force))
