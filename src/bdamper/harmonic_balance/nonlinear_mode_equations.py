"""Equations of nonlinear modes: a sector with unknown frequency and damping (``csrc/balance/nonlinear_mode.c``).

A point ``y = (Q_0, P, omega, zeta, ln(A/A_0))`` has the mean, the vibration ``P`` scaled to the amplitude ``A_0`` of the
response, frequency, modal damping ratio, and the amplitude ``A`` of the response.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bdamper import _core
from bdamper.harmonic_balance.equations import Equations, Rows, norm2
from bdamper.harmonic_balance.sector import Sector
from bdamper.model.kinematics import HarmonicBasis


@dataclass(frozen=True)
class InAmplitude:
    """Units where frequency and damping are unknown and the logarithm of the amplitude is the parameter.

    Parameters
    ----------
    n_mean : int
    reference : float, m
        Amplitude of the response at the parameter 0.
    """

    n_mean: int
    reference: float

    SHIFT, DAMPING = 0.05, 0.1
    """Change of frequency, relative, and of the damping ratio that count as much as one of the whole vibration."""

    def vibration(self, y: NDArray) -> float:
        """Norm of the harmonics."""
        return norm2(y[self.n_mean : -3]) * float(np.exp(y[-1]))

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """Units of the mean, the vibration, frequency, damping and the logarithm of the amplitude."""
        scale = np.ones(len(y))
        scale[: self.n_mean] = max(norm2(y[: self.n_mean]), vibration)
        scale[self.n_mean : -3] = vibration * float(np.exp(-y[-1]))
        scale[-3], scale[-2] = self.SHIFT * y[-3], self.DAMPING
        return scale

    def place(self, parameter: float) -> str:
        """The amplitude of the response."""
        return f"{self.reference * np.exp(parameter):.6g} m"


@dataclass(frozen=True, eq=False)
class Mode:
    """Periodic motions that a force in proportion to mass times velocity keeps up.

    The amplitude is that of the first harmonic of the response, its phase is zero: two linear equations.

    Parameters
    ----------
    driven : Equations
        Of one structure at one preload; of its forces the static ones count.
    stuck : (n_modes,) complex
        About the motion of the mode in the first harmonic, in modal coordinates, at the reference.
    reference : float, m
        Amplitude A_0 of the response, below all that are asked for, so that the parameter stays positive.
    """

    driven: Equations[Sector]
    stuck: NDArray
    reference: float

    @property
    def basis(self) -> HarmonicBasis:
        """Modes of the first harmonic."""
        return self.driven.structure.bases[1]

    def start(self, mean: NDArray, omega: float, amplitude: float) -> NDArray:
        """The linear mode at an amplitude (m) of the response, a guess."""
        size = np.abs(self.stuck) ** 2
        zeta = float(size @ self.basis.damping / (size @ self.basis.mass)) / (2.0 * omega)
        u = self.driven.layout.pack(mean[: self.driven.n_mean], self.stuck)
        return np.append(u, [omega, zeta, np.log(amplitude / self.reference)])

    def point(self, u: NDArray, omega: float, zeta: float) -> NDArray:
        """The point of a motion (n_unknowns of the driven equations) of which the response has the phase zero."""
        ratio = float(abs(self.driven.response(u)[1])) / self.reference
        y = np.append(u, [omega, zeta, np.log(ratio)])
        y[self.driven.n_mean : -3] /= ratio
        return y

    def motion(self, y: NDArray) -> NDArray:
        """(..., n_unknowns of the driven equations) modal coordinates of points, in their units."""
        u = np.array(y[..., :-3])
        u[..., self.driven.n_mean :] *= np.exp(y[..., -1:])
        return u


def mode_equations(driven: Equations[Sector], omega: float, shape: NDArray, reference: float) -> Equations[Mode]:
    """Equations of a mode of about a frequency (rad/s) and a shape (n_modes,), from a reference amplitude (m) on."""
    sector, n_mean = driven.core, driven.n_mean
    assert isinstance(sector, _core.Sector)
    row = np.asarray(driven.response_rows[1])
    stuck = np.asarray(shape) * (reference / (row @ shape))
    re, im = driven.layout.parts(row / reference)
    weight = omega**2 * norm2(np.abs(stuck))
    scale = np.append(driven.row_scale, [1.0 / weight, 1.0 / weight])
    scale[n_mean:-2] = 1.0 / weight
    damping = np.zeros((1, 2, len(scale)))
    damping[0, 0, -1] = 1.0  # what has maxima along a branch
    return Equations(
        _core.Modes(sector, re, im, weight, scale), Mode(driven, stuck, float(reference)), driven.layout,
        driven.response_rows, Rows(damping), InAmplitude(n_mean, float(reference)), scale, driven.n_points, driven.work,
    )  # fmt: skip
