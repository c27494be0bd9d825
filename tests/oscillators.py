"""Small oscillators with physical degrees of freedom on one contact point, as systems of the package."""

from __future__ import annotations

import numpy as np

from bdamper.contact.laws import PointArrays
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.sector import SectorData
from bdamper.model.kinematics import Coordinate, HarmonicBasis


def oscillator(
    mass,
    damping,
    stiffness,
    contact,
    force,
    response,
    n_harm,
    *,
    kt,
    kn,
    mu,
    n0,
    mean=True,
    contact_forces="event_driven",
) -> Equations[SectorData]:
    """``m x'' + c x' + K x + contact force = force cos(omega t) + contact^T (0, 0, n0)``, m and c numbers.

    Parameters
    ----------
    contact : (3, n) float
        Rows give (u1, u2, v) from x.  The preload is balanced: at rest x = 0.
    response : (n,) float
    mean : bool
        Whether the mean of the motion is free to move.
    """
    k, modes = np.linalg.eigh(np.atleast_2d(np.asarray(stiffness, float)) / mass)
    modes = modes / np.sqrt(mass)
    n = len(k)
    contact = np.asarray(contact, float).reshape(3, n)

    def basis(l):
        keep = n if l or mean else 0
        return HarmonicBasis(
            coordinates=tuple(Coordinate("mass", i, f"mode {i + 1}") for i in range(keep)),
            omega2=k[:keep],
            damping_ratio=(damping / mass / (2 * np.sqrt(k)))[:keep],
            G=(contact @ modes)[None, :, :keep].astype(complex),
            nodal_diameter=0,
            mass=np.ones(keep),
        )

    bases = [basis(l) for l in range(n_harm + 1)]
    excitation = modes.T @ np.asarray(force, float).reshape(n)
    static = (modes.T @ contact[2] * n0) if mean else np.zeros(0)
    forces = np.concatenate([static, excitation, np.zeros(n * (2 * n_harm - 1))])
    points = PointArrays(
        kt=np.array([[kt, 0.0]]),
        kn=np.array([float(kn)]),
        mu=np.array([float(mu)]),
        n0=np.array([float(n0)]),
        slider=np.zeros((1, 2)),
        law=np.zeros(1, int),
        shift=np.zeros((1, 3)),
    )
    rows = [np.asarray(response, float) @ modes[:, : len(b.omega2)] for b in bases]
    size = float(np.abs(excitation).max())
    return SectorData(bases, points, forces, rows, contact_forces, (size, size)).equations
