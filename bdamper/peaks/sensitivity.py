"""How a resonance peak moves with parameters.

Let ``B`` be ``[J r_omega; t^T]`` with the tangent ``t`` of the response curve.  With a parameter ``p``

    B z_p = (-r_p, 0),       dA/dp = grad(A) . z_p = -lambda . r_p,      B^T (lambda, nu) = (grad(A), 0):

one adjoint solution serves all parameters.  The peak itself moves by ``z_p + s t`` with
``s = -(d phi along (z_p, 1)) / (d phi along t)``, ``phi`` the slope of ln(amplitude) along the curve; these two directional
derivatives are central differences of the exact slope, the second derivatives of the contact law never being formed.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.peaks.newton import Family, Peak, PeakOptions, amplitude_at, slope_along, squared_gradient
from bdamper.util.errors import SettingError

NOTHING = 1e-14
"""Rows of the Jacobian below this share of the largest are those of coordinates on which no force depends."""


class NoDerivative(SettingError, ArithmeticError):
    """A peak has no derivative with respect to a parameter, or none that can be computed."""


class _Bordered:
    """``B = [J r_omega; t^T]`` in scaled unknowns, factorised; least norm if it is singular.

    Coordinates on which no force depends are held: ``idle``, those of another ``B`` if they are given.
    """

    def __init__(
        self, J: NDArray, r_omega: NDArray, tangent: NDArray, scale: NDArray, idle: NDArray | None = None
    ) -> None:
        n = len(r_omega)
        B = np.empty((n + 1, n + 1))
        B[:n, :n] = J * scale[:n]
        B[:n, n] = r_omega * scale[n]
        B[n] = tangent
        size = np.abs(B).max(axis=1)
        self.idle = size <= NOTHING * size.max() if idle is None else idle
        B[self.idle] = 0.0
        B[:, self.idle] = 0.0
        self.row = np.where(self.idle, 0.0, 1.0 / np.where(self.idle, 1.0, size))
        B *= self.row[:, None]
        getrf, self.getrs, gecon = get_lapack_funcs(("getrf", "getrs", "gecon"), (B,))
        self.lu, self.pivot, info = getrf(B)
        condition = gecon(self.lu, float(np.abs(B).sum(axis=0).max()))[0] if info == 0 else 0.0
        self.inverse = np.linalg.pinv(B, rcond=1e-12) if condition < 1e-14 else None

    def solve(self, b: NDArray) -> NDArray:
        b = b * self.row
        return self.inverse @ b if self.inverse is not None else self.getrs(self.lu, self.pivot, b)[0]

    def solve_transposed(self, b: NDArray) -> NDArray:
        x = self.inverse.T @ b if self.inverse is not None else self.getrs(self.lu, self.pivot, b, trans=1)[0]
        return x * self.row


def _slope_at(system: HarmonicSystem, y: NDArray, reference: NDArray, scale: NDArray, idle: NDArray) -> float:
    """Slope of ln(amplitude) along the curve through any point (on which the residual need not vanish)."""
    _, J, r_omega = system.evaluate(y[:-1], y[-1])
    b = np.zeros(len(y))
    b[-1] = 1.0
    t = _Bordered(J, r_omega, reference, scale, idle).solve(b)
    return slope_along(system, y, t / np.linalg.norm(t), scale)


@dataclass(frozen=True)
class PeakSensitivity:
    """Derivatives of a peak with respect to one parameter, per unit of the parameter.

    Parameters
    ----------
    name : str
    value : float
        Of the parameter at the peak.
    amplitude : float
        m per unit.
    frequency : float
        Hz per unit.
    y : (n_unknowns + 1,) float
        Of all unknowns and the frequency in rad/s.
    """

    name: str
    value: float
    amplitude: float
    frequency: float
    y: NDArray = field(repr=False)


def sensitivities(
    peak: Peak, families: dict[str, tuple[Family, float]], options: PeakOptions | None = None
) -> dict[str, PeakSensitivity]:
    """How a peak moves with parameters: amplitude by one adjoint solution, frequency by one direction for each.

    Parameters
    ----------
    peak : Peak
    families : mapping of name to (family, value)
        All families give the same equations at their values: those that the peak solves.
    options : PeakOptions

    Raises
    ------
    SettingError
        If the peak is not converged or lies at a corner, where it has no derivative; NoDerivative if none can be computed.
    """
    options = options or PeakOptions()
    _check(peak)
    out: dict[str, PeakSensitivity] = {}
    y, scale, t = peak.y, peak.scale, peak.tangent
    bordered: _Bordered | None = None
    h = options.difference
    for name, (family, value) in families.items():
        if bordered is None:
            system = family(value)
            _, J, r_omega = system.evaluate(y[:-1], y[-1])
            bordered = _Bordered(J, r_omega, t, scale)
            g, square = squared_gradient(system, y)
            adjoint = bordered.solve_transposed(g * scale / np.sqrt(square))[:-1]
            idle = bordered.idle
            ahead, behind = (_slope_at(system, y + a * t * scale, t, scale, idle) for a in (h, -h))
            along = (ahead - behind) / (2.0 * h)
        dp = h * (abs(value) if value != 0.0 else 1.0)
        high = family(value + dp)
        try:
            low, back = family(value - dp), dp
        except SettingError:  # values end here, as a coefficient of friction does at zero: derivative to the right
            low, back = system, 0.0
        r_p = (high.evaluate(y[:-1], y[-1])[0] - low.evaluate(y[:-1], y[-1])[0]) / (dp + back)
        z_p = bordered.solve(np.append(-r_p, 0.0))
        direction = z_p * scale
        across = (
            _slope_at(high, y + dp * direction, t, scale, idle) - _slope_at(low, y - back * direction, t, scale, idle)
        ) / (dp + back)  # fmt: skip
        if along == 0.0:
            raise NoDerivative(f"sensitivities: expected a curved peak, found a flat one at {peak.frequency:.6g} Hz")
        dy = (z_p - across / along * t) * scale
        # amplitude: explicit change of the response row (a parameter may scale the modes), then of the solution
        explicit = (amplitude_at(high, y) - amplitude_at(low, y)) / (dp + back)
        amplitude = _finite(explicit - float(adjoint @ r_p) + 0.0 * float(dy.sum()), peak)
        out[name] = PeakSensitivity(name, value, amplitude, float(dy[-1]) / (2.0 * np.pi), dy)
    return out


def amplitude_sensitivity(peak: Peak, family: Family, value: float, options: PeakOptions | None = None) -> float:
    """Derivative of a peak's amplitude (m per unit of the parameter), by the adjoint solution alone.

    Parameters
    ----------
    peak : Peak
    family : callable
        The equations as a function of the parameter.
    value : float
        Of the parameter, at which the peak solves them.
    options : PeakOptions

    Raises
    ------
    SettingError
        As :func:`sensitivities`.
    """
    _check(peak)
    y = peak.y
    system = family(value)
    _, J, r_omega = system.evaluate(y[:-1], y[-1])
    g, square = squared_gradient(system, y)
    adjoint = _Bordered(J, r_omega, peak.tangent, peak.scale).solve_transposed(g * peak.scale / np.sqrt(square))[:-1]
    dp = (options or PeakOptions()).difference * (abs(value) if value != 0.0 else 1.0)
    low, high = family(value - dp), family(value + dp)
    r_p = (high.residual(y) - low.residual(y)) / (2.0 * dp)
    explicit = (amplitude_at(high, y) - amplitude_at(low, y)) / (2.0 * dp)
    return _finite(explicit - float(adjoint @ r_p), peak)


def _finite(value: float, peak: Peak) -> float:
    """A derivative that is finite."""
    if not np.isfinite(value):
        raise NoDerivative(f"sensitivities: expected finite ones, found {value} at {peak.frequency:.6g} Hz")
    return value


def _check(peak: Peak) -> None:
    if not peak.converged:
        raise SettingError(f"sensitivities: expected a converged peak, found status '{peak.status}'")
    if peak.corner:
        raise SettingError("sensitivities: expected a smooth peak, found one at a corner of the response curve")
