"""Linear limits of a response: no contact at all, or every closed point stuck.

With springs K_c in place of the contact the first harmonic solves Z(omega) q = f, Z = K + K_c + i omega D - omega^2 M.  Its
poles give the resonances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from bdamper.harmonic_balance.equations import Layout
from bdamper.model.kinematics import HarmonicBasis

UNDAMPED = 1e-9
"""Ratio of half-width to frequency of a resonance without damping."""
NEAREST = 1e-4
"""Distance, relative to its frequency, at which the response beside a resonance without damping is still solved for."""


@dataclass(frozen=True, eq=False)
class Linear:
    """A structure with linear springs in place of the contact.

    Parameters
    ----------
    bases : sequence of HarmonicBasis
        One for each harmonic, with the points and axes to which springs are given.
    springs : (n_points, 3) float
        Those that are a part of the bodies.
    layout : Layout
    force : (n_unknowns,) float
    """

    bases: Sequence[HarmonicBasis]
    springs: NDArray | float
    layout: Layout
    force: NDArray

    def matrix(self, omega: float, contact: NDArray | None, harmonic: int = 1) -> NDArray:
        """Complex dynamic stiffness of one harmonic with linear springs (n_points, 3) at the contact points."""
        b = self.bases[harmonic]
        w = harmonic * omega
        Z = np.diag(b.omega2 - w**2 * b.mass + 1j * w * b.damping).astype(complex)
        if contact is not None or np.any(self.springs):
            G = b.G.reshape(-1, 3, len(b.omega2))
            k = np.broadcast_to(self.springs + (0.0 if contact is None else contact), G.shape[:2])
            Z += G.reshape(-1, len(b.omega2)).conj().T @ (k[..., None] * G).reshape(-1, len(b.omega2))
        return Z

    def modes(self, contact: NDArray | None, harmonic: int = 1) -> tuple[NDArray, NDArray]:
        """Undamped frequencies (rad/s), ascending, and mass-normalised modes under linear springs (n_points, 3).

        Modal coordinates without mass follow the others statically and add no frequency.
        """
        K = self.matrix(0.0, contact, harmonic)
        shift = max(float(np.abs(np.diag(K)).max()) * 1e-6, 1.0)  # free rigid-body modes have no stiffness
        M = np.diag(self.bases[harmonic].mass)
        inverse, vectors = scipy.linalg.eigh(M, 0.5 * (K + K.conj().T) + shift * M)
        keep = np.flatnonzero(inverse > 1e-12 * inverse[-1])[::-1]
        pole = np.maximum(1.0 / inverse[keep] - shift, 0.0)
        return np.sqrt(pole), vectors[:, keep] / np.sqrt(inverse[keep])

    def response(self, omega: float, contact: NDArray | None, harmonic: int = 1) -> NDArray:
        """Complex modal amplitudes of one harmonic under linear contact; rigid modes without any contact stay at rest."""
        e = self.layout.amplitudes(self.force, harmonic)
        return np.linalg.lstsq(self.matrix(omega, contact, harmonic), e, rcond=1e-14)[0]

    def resonances(self, springs: Sequence[NDArray | None], low: float, high: float) -> list[tuple[float, float, NDArray]]:
        """Resonances with some springs (none without contact, those of every closed point where it sticks).

        Frequency and half-width (damping ratio times frequency) in rad/s, and the row that gives the modal coordinate.
        """
        out = []
        basis = self.bases[1]
        for k in springs:
            frequencies, vectors = self.modes(k)
            for omega, vector in zip(frequencies, vectors.T):
                if low < omega < high:
                    width = max(0.5 * float(np.abs(vector) ** 2 @ basis.damping), UNDAMPED * float(omega))
                    out.append((float(omega), width, vector.conj() * basis.mass))
        return out

    def maximum(self, row: NDArray, springs: NDArray | None, omega: float, width: float) -> tuple[float, float]:
        """Frequency (rad/s) and amplitude (m) of the maximum at a resonance of so many rad/s and half-width.

        ``row`` (n_modes,) gives the response.  Without damping the response is unbounded, and the amplitude infinite.
        """
        if width <= UNDAMPED * omega:
            return omega, np.inf

        def negative(w: float) -> float:
            return -abs(self.response(w, springs) @ row)

        ends = (omega - 3.0 * width, omega + 3.0 * width)
        options = {"xatol": 1e-9 * omega, "maxiter": 200}
        found = minimize_scalar(negative, bounds=ends, method="bounded", options=options)
        return float(found.x), -float(found.fun)




def reach(free: Sequence[float], stuck: Sequence[float], low: float, high: float) -> tuple[float, float]:
    """Interval in which branches that pass through (low, high) may turn, in the unit of the arguments.

    As contact slips and opens, the resonance of a mode and its folds shift from the stuck to the free frequency.  An end
    between the two of one mode is moved just beyond the outer one; other ends stay.  Modes are paired in their order.

    Parameters
    ----------
    free, stuck : sequence of float
        Resonances without contact (rigid motions left out) and with stuck contact, ascending.
    low, high : float
    """
    # part of its frequency by which a branch may turn beyond the resonance without contact or with stuck contact
    beyond = 0.03
    spans = [((1.0 - beyond) * min(pair), (1.0 + beyond) * max(pair)) for pair in zip(free, stuck)]
    bottom = min((a for a, b in spans if a < low < b), default=low)
    top = max((b for a, b in spans if a < high < b), default=high)
    return bottom, top


def around(low: float, high: float) -> tuple[float, float]:
    """Interval in which a pole may lie of which the maximum is in (low, high)."""
    return 0.8 * low, 1.25 * high
