"""How a resonance peak moves with parameters.

Let ``B`` be ``[J r_omega; t^T]`` with the tangent ``t`` of the response curve.  With a parameter ``p``

    B z_p = (-r_p, 0),       dA/dp = grad(A) . z_p = -lambda . r_p,      B^T (lambda, nu) = (grad(A), 0):

one adjoint solution serves all parameters.  The peak itself moves by ``z_p + s t`` with
``s = -(d phi along (z_p, 1))/(grad(phi) . t)``, ``phi`` the slope of ln(amplitude) along the curve.  Its gradient takes
one more adjoint solution, nu, and differences of Jacobians along the curve (``csrc/bd_solver.c``); along (z_p, 1) ``phi``
changes with the response and by ``-nu . d[J r_omega] t``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.peaks.newton import Family, Peak, PeakOptions, amplitude_at, slope_along
from bdamper.util import validate
from bdamper.util.errors import SettingError


class NoDerivative(SettingError, ArithmeticError):
    """A peak has no derivative with respect to a parameter, or none that can be computed."""


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
    h = (options or PeakOptions()).difference
    _check(peak)
    y, scale, t = peak.y, peak.scale, peak.tangent
    out: dict[str, PeakSensitivity] = {}
    system: HarmonicSystem | None = None
    for name, (family, value) in families.items():
        if system is None:
            system = family(value)
            adjoint = _adjoint(system, peak)
            row, nu = system.slope_gradient(y, t, scale, h)
        change = _Change(family, value, h, system)
        r_p = change.of(change.high.residual(y), change.low.residual(y))
        move = system.solve_linear(y, t, scale, np.append(-r_p, 0.0)[None])[0]
        ends = [y + part * move * scale for part in (change.ahead, -change.back)]
        pairs = tuple(zip((change.high, change.low), ends))
        # what is left along the move: at a fixed point a parameter that scales the modes may go past an event
        (r_high, *J_high), (r_low, *J_low) = (equations.evaluate_at(end) for equations, end in pairs)
        r_p = change.of(r_high, r_low)
        rest = system.solve_linear(y, t, scale, np.append(-r_p, 0.0)[None])[0]
        turn = change.of(*(J @ (t * scale)[:-1] + C * (t * scale)[-1] for J, C in (J_high, J_low)))
        across = change.of(*(slope_along(*pair, t, scale) for pair in pairs)) - float(nu @ turn) + float(row @ rest)
        curvature = float(row @ t)
        if curvature == 0.0:
            raise NoDerivative(f"sensitivities: expected a curved peak, found a flat one at {peak.frequency:.6g} Hz")
        dy = (move + rest - across / curvature * t) * scale
        amplitude = change.of(*(amplitude_at(*pair) for pair in pairs)) - float(adjoint @ r_p)
        amplitude = _finite(amplitude + 0.0 * float(dy.sum()), peak)
        out[name] = PeakSensitivity(name, value, amplitude, float(dy[-1]) / (2.0 * np.pi), dy)
    return out


class _Change:
    """Central differences over a parameter, to the right where the values of the parameter begin."""

    def __init__(self, family: Family, value: float, difference: float, system: HarmonicSystem) -> None:
        self.ahead = self.back = difference * (abs(value) if value != 0.0 else 1.0)
        self.high = family(value + self.ahead)
        try:
            self.low = family(value - self.back)
        except SettingError:  # values end here, as a coefficient of friction does at zero
            self.low, self.back = system, 0.0

    def of(self, high: NDArray | float, low: NDArray | float) -> Any:
        """Derivative of what has these values."""
        return (high - low) / (self.ahead + self.back)


def _adjoint(system: HarmonicSystem, peak: Peak) -> NDArray:
    """(n_unknowns,) change of the amplitude at the peak with each of the residuals, for the other sign."""
    gradient, square = system.squared_gradient(peak.y)
    gradient /= np.sqrt(square)
    return system.solve_linear(peak.y, peak.tangent, peak.scale, (gradient * peak.scale)[None], transposed=True)[0, :-1]


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
    system = family(value)
    adjoint = _adjoint(system, peak)
    change = _Change(family, value, (options or PeakOptions()).difference, system)
    r_p = change.of(change.high.residual(peak.y), change.low.residual(peak.y))
    explicit = change.of(amplitude_at(change.high, peak.y), amplitude_at(change.low, peak.y))
    return _finite(explicit - float(adjoint @ r_p), peak)


def _finite(value: float, peak: Peak) -> float:
    """A derivative that is finite."""
    if not np.isfinite(value):
        raise NoDerivative(f"sensitivities: expected finite ones, found {value} at {peak.frequency:.6g} Hz")
    return value


def _check(peak: Peak) -> None:
    validate.require(peak.converged, "sensitivities", "a converged peak", f"status '{peak.status}'")
    validate.require(not peak.corner, "sensitivities", "a smooth peak", "one at a corner of the response curve")
