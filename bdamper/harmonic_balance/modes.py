"""Equations of nonlinear modes: a sector without excitation, its frequency and its damping unknown (``csrc/bd_modes.c``).

A point ``y = (Q_0, P, omega, zeta, ln(A/A_0))`` has the mean, the vibration ``P`` scaled to the amplitude ``A_0`` of the
response, frequency, modal damping ratio, and the amplitude ``A`` of the response.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bdamper import _core
from bdamper.harmonic_balance.system import HarmonicSystem, norm2


class ModeSystem(HarmonicSystem):
    """Periodic motions that a force in proportion to mass times velocity keeps up.

    The amplitude is that of the first harmonic of the response, its phase is zero: two linear equations.

    Parameters
    ----------
    system : HarmonicSystem
        Equations of one structure at one preload; of its forces the static ones count.
    omega : float, rad/s
        About the frequency of the mode.
    shape : (n_modes,) complex
        About its motion in the first harmonic, in modal coordinates.
    reference : float, m
        Amplitude A_0 of the response, below all that are asked for, so that the parameter stays positive.
    """

    SHIFT, DAMPING = 0.05, 0.1
    """Change of frequency, relative, and of the damping ratio that count as much as one of the whole vibration."""

    def __init__(self, system: HarmonicSystem, omega: float, shape: NDArray, reference: float) -> None:
        super().__init__(
            system.bases, system.points, system.force, system.response_rows, system.evaluation, system.force_scale
        )
        self.spring_bases, self.springs = system.spring_bases, system.springs
        self.driven = system
        self.reference = float(reference)
        self.stuck = np.asarray(shape) * (reference / (self.response_rows[1] @ shape))
        sector, (re, im) = self.core, self._parts(np.asarray(self.response_rows[1]) / reference)
        assert isinstance(sector, _core.Sector)
        weight = omega**2 * norm2(np.abs(self.stuck))
        self.row_scale = np.append(self.row_scale, [1.0 / weight, 1.0 / weight])
        self.row_scale[self.n_mean : -2] = 1.0 / weight
        self.core = _core.Modes(sector, re, im, weight, self.row_scale)
        self.n_unknowns += 2
        zeta = np.zeros(self.n_unknowns)
        zeta[-1] = 1.0
        self.response_parts = zeta, np.zeros(self.n_unknowns)  # what has maxima along a branch: the damping

    def start(self, mean: NDArray, omega: float, amplitude: float) -> NDArray:
        """The linear mode at an amplitude (m) of the response, a guess."""
        size = np.abs(self.stuck) ** 2
        zeta = float(size @ self.bases[1].damping / (size @ self.bases[1].mass)) / (2.0 * omega)
        self.n_unknowns -= 2
        u = self.pack(mean[: self.n_mean], self.stuck)
        self.n_unknowns += 2
        return np.append(u, [omega, zeta, np.log(amplitude / self.reference)])

    def point(self, u: NDArray, omega: float, zeta: float) -> NDArray:
        """The point of a motion (n_unknowns of the driven equations) of which the response has the phase zero."""
        ratio = float(abs(self.driven.response(u)[1])) / self.reference
        y = np.append(u, [omega, zeta, np.log(ratio)])
        y[self.n_mean : -3] /= ratio
        return y

    def motion(self, y: NDArray) -> NDArray:
        """(..., n_unknowns of the driven equations) modal coordinates of points, in their units."""
        u = np.array(y[..., :-3])
        u[..., self.n_mean :] *= np.exp(y[..., -1:])
        return u

    def vibration(self, y: NDArray) -> float:
        """Size of the vibration at a point."""
        return norm2(y[self.n_mean : -3]) * float(np.exp(y[-1]))

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """Units of the mean, the vibration, frequency, damping and the logarithm of the amplitude at a point."""
        scale = np.ones(len(y))
        scale[: self.n_mean] = max(norm2(y[: self.n_mean]), vibration)
        scale[self.n_mean : -3] = vibration * float(np.exp(-y[-1]))
        scale[-3], scale[-2] = self.SHIFT * y[-3], self.DAMPING
        return scale

    def place(self, parameter: float) -> str:
        """An amplitude of the response in words."""
        return f"{self.reference * np.exp(parameter):.6g} m"
