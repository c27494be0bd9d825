"""Derivatives of resonance peaks and response curves with respect to the preload and to settings.

Let ``B`` be ``[J r_omega; t^T]`` with the tangent ``t`` of the response curve.
For a parameter ``p``

    B z_p = (-r_p, 0),       B^T (lambda, nu) = (grad(A), 0),

    dA/dp = grad(A) . z_p = -lambda . r_p:

one adjoint solution serves all parameters.  The peak moves by ``z_p + s t`` with ``s = -(d phi
along (z_p, 1))/(grad(phi) . t)``, where ``phi`` is the slope of ln(amplitude) along the curve.  The
gradient of ``phi`` takes one more adjoint solution, nu, and differences of Jacobians along the
curve (``csrc/solver/newton.c``).  Along (z_p, 1) ``phi`` changes with the response and by ``-nu .
d[J r_omega] t``.

A point of a curve moves by ``z_p``, normal to the curve in scaled unknowns.  The bordered matrix is
regular at folds, where the derivative at a fixed frequency is infinite.

The unknowns are modal coordinates, and modes may depend on the parameter: the mass-normalised modes
of a damper are inversely proportional to the root of its mass.  The unknowns at a
perturbed parameter value are therefore rescaled to preserve the motion of the contact points.
Otherwise the differences would cross contact events, such as slip-to-stick, merely because the
modes change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import Correction, Equations, Fixed, Plane, norm2
from bdamper.harmonic_balance.parameters import (
    FACTORS,
    GAP,
    INERTIA,
    MASS,
    OF_LOAD,
    OF_MASS,
    setting_names,
    vary,
    with_aligned_modes,
)
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.subject import about
from bdamper.response.events import ContinuationOptions
from bdamper.response.peak import DIFFERENCE, Family, Peak, check_peak, slope_along, with_tangent
from bdamper.response.response_curve import check_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util import validation
from bdamper.util.display import Plottable, Result
from bdamper.util.errors import SettingError
from bdamper.util.formatting import (
    UNITS,
    amount,
    peak_text,
    percent,
    sentence,
    short_repr,
    spaced,
)
from bdamper.util.progress import one_thread
from bdamper.util.statement import Row, Statement

# ---- derivatives with respect to parameters of the equations ----


SIDES = 0.3
"""Largest relative difference of the one-sided derivatives.  At a flat peak they are 771 and 671 Hz
per unit, and differences of computed peaks confirm the mean, 720.6 Hz.
"""
NOISE = 1e-4
"""Difference of the relative one-sided derivatives that counts as curvature over the step, as at an
optimum."""


class NoDerivative(SettingError, ArithmeticError):
    """Error: a peak has no derivative with respect to a parameter, or it cannot be computed."""


@dataclass(frozen=True)
class PeakSensitivity:
    """Derivatives of a peak with respect to one parameter, per unit of it; NaN if unknown.

    Parameters
    ----------
    name : str
    value : float
        Value of the parameter at the peak.
    amplitude : float
        Derivative of the amplitude, m per unit of the parameter.
    frequency : float
        Derivative of the frequency, Hz per unit.
    y : (n_unknowns + 1,) float
        Derivatives of all unknowns and of the frequency in rad/s.
    reason : str
        Reason why the derivatives are unknown, or "".
    """

    name: str
    value: float
    amplitude: float
    frequency: float
    y: NDArray = field(repr=False)
    reason: str = ""


class Sensitivities(Result, Plottable, dict[str, PeakSensitivity]):
    """Derivatives of a peak by parameter.

    ``plot`` draws the change of the peak for a change of 1 % in each parameter
    (:func:`bdamper.plot.plot_sensitivities`).

    Parameters
    ----------
    found : mapping of name to PeakSensitivity
    amplitude, frequency : float, m, Hz
        Amplitude and frequency of the peak.
    """

    def __init__(
        self, found: Mapping[str, PeakSensitivity], amplitude: float, frequency: float
    ) -> None:
        super().__init__(found)
        self.amplitude = amplitude
        self.frequency = frequency

    def changes(self) -> dict[str, tuple[float, float]]:
        """Return the relative change of amplitude and frequency for a change of one per cent in
        each parameter.

        NaN if unknown.
        """
        per_cent_of_amplitude = 0.01 / self.amplitude
        per_cent_of_frequency = 0.01 / self.frequency
        changes = {}
        for name, derivative in self.items():
            amplitude = per_cent_of_amplitude * derivative.value * derivative.amplitude
            frequency = per_cent_of_frequency * derivative.value * derivative.frequency
            changes[name] = amplitude, frequency
        return changes

    def _statement(self) -> Statement:
        peak = peak_text(self.amplitude, self.frequency)
        unknown = [f"{spaced(name)}: {item.reason}" for name, item in self.items() if item.reason]
        remarks = [f"Unknown: {'; '.join(unknown)}"] if unknown else []
        verdict = f"Change for +1 %: peak {peak}"
        amplitude_changes = {name: amplitude for name, (amplitude, _) in self.changes().items()}
        known = [name for name, change in amplitude_changes.items() if np.isfinite(change)]
        if known:
            first = max(known, key=lambda name: abs(amplitude_changes[name]))
            change = percent(amplitude_changes[first], sign=True)
            verdict = (
                f"{sentence(spaced(first))} has the largest effect: {change} for +1 %, peak {peak}"
            )
        return Statement([verdict], remarks=remarks, table=self._rows())

    def _rows(self) -> list[tuple[str, ...]]:
        """Return header and rows, the largest change of the amplitude first, unknown ones last."""
        rows: list[tuple[str, ...]] = []
        rows.append(("parameter", "value", "amplitude for +1 %", "frequency for +1 %"))
        changes = self.changes()
        # an unknown change (NaN) is smaller than all others
        size = {}
        for name, (amplitude, _) in changes.items():
            size[name] = np.nan_to_num(abs(amplitude), nan=-1.0)
        for name in sorted(changes, key=lambda name: size[name], reverse=True):
            amplitude, frequency = changes[name]
            value = f"{self[name].value:.6g} {UNITS.get(name, '')}".rstrip()
            rows.append(
                (spaced(name), value, percent(amplitude, sign=True), percent(frequency, sign=True))
            )
        return rows

    def summary(self) -> str:
        """Return the table of all parameters."""
        return self._statement().text

    _states_all = True


@short_repr
@dataclass(frozen=True)
class CurveSensitivity:
    """Derivatives of a response curve with respect to one parameter, per unit of the parameter.

    A point moves normal to the curve.  Its frequency and response change together, and both changes
    are finite at folds.

    Parameters
    ----------
    name : str
    value : float
        Value of the parameter on the curve.
    frequency : (n,) float
        Derivative of the frequency, Hz per unit.
    response : (n,) complex
        Derivative of the first harmonic of the response, m per unit of the parameter.
    tangent : (n, 2) complex
        Change of frequency (Hz) and response (m) along the curve.
    """

    name: str
    value: float
    frequency: NDArray
    response: NDArray
    tangent: NDArray

    def __str__(self) -> str:
        """Return a few lines, with the changes for one per cent of the parameter."""
        per_cent = 0.01 * self.value
        frequency = np.abs(per_cent * self.frequency)
        response = np.abs(per_cent * self.response)
        largest = int(np.argmax(response))
        verdict = (
            f"Largest change for +1 % of {spaced(self.name)}: {amount(response[largest], 'm')}"
        )
        rows = [
            Row("Parameter", f"{self.value:.6g} {UNITS.get(self.name, '')}".rstrip()),
            Row("Response", amount(response[largest], "m"), f"largest, at point {largest}"),
            Row(
                "Frequency",
                amount(frequency.max(), "Hz"),
                f"largest, at point {frequency.argmax()}",
            ),
            Row("Points", str(len(frequency)), "counted from 0, in the order of the curve"),
        ]
        return Statement([verdict], rows, remarks=["Not covered: changes of the folds"]).text

    @property
    def at_frequency(self) -> NDArray:
        """Derivative (n,) of the response at fixed frequency, m per unit of the parameter.

        It is infinite at a fold.
        """
        onward = self.tangent[:, 0].real
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.response - self.tangent[:, 1] * self.frequency / onward


class CurveSensitivities(Result, dict[str, CurveSensitivity]):
    """Derivatives of a response curve by parameter; ``print`` shows the changes for 1 % of each.

    Parameters
    ----------
    found : mapping of name to CurveSensitivity
    curve : ResponseCurve
    """

    def __init__(self, found: Mapping[str, CurveSensitivity], curve: ResponseCurve) -> None:
        super().__init__(found)
        self.curve = curve

    def _changes_at_peak(self) -> dict[str, float]:
        """Return the relative change of the highest amplitude for +1 % of each parameter."""
        i = self.curve.peak_index
        response = self.curve.harmonics[i, 1]
        changes = {}
        for name, item in self.items():
            # along the curve the highest amplitude does not change
            moved = 0.01 * item.value * item.response[i]
            changes[name] = float((np.conj(response) * moved).real / abs(response) ** 2)
        return changes

    def _statement(self) -> Statement:
        if not len(self.curve) or not self:
            return Statement(["No derivatives: the curve has no points, or no parameter is given"])
        curve = self.curve
        i = curve.peak_index
        peak = peak_text(float(curve.amplitude[i]), float(curve.frequency[i]))
        table = [("Parameter", "Value", "Peak", "Largest change", "At")]
        at_peak = self._changes_at_peak()
        for name in sorted(self, key=lambda name: abs(at_peak[name]), reverse=True):
            item = self[name]
            change = np.abs(0.01 * item.value * item.response) / curve.amplitude[i]
            largest = int(np.argmax(change))
            value = f"{item.value:.6g} {UNITS.get(name, '')}".rstrip()
            frequency = amount(float(curve.frequency[largest]), "Hz")
            cells = (percent(at_peak[name], sign=True), percent(float(change[largest])), frequency)
            table.append((spaced(name), value, *cells))
        verdict = (
            f"Change for +1 % of a parameter: peak {peak}{about(curve.settings, curve.preload)}"
        )
        remarks = [
            "Largest change: of the response, relative to the peak; points move normal to the curve",
            "Not covered: new folds and branches",
        ]
        return Statement([verdict], remarks=remarks, table=table)

    def summary(self) -> str:
        """Return the table of all parameters."""
        return self._statement().text

    _states_all = True


def across(
    system: Equations,
    points: Sequence[Correction],
    scale: NDArray,
    families: Mapping[str, tuple[Family, float]],
    factors: NDArray | float = 1.0,
) -> dict[str, CurveSensitivity]:
    """Compute the derivatives of points of a response curve, with one bordered matrix for each
    point.

    Parameters
    ----------
    system : Equations
    points : sequence of Correction
        Solutions with the tangent of the curve.
    scale : (n, n_unknowns + 1) float
        Units in which each tangent has unit length.
    families : mapping of name to (family, value)
        Equations as a function of each parameter, and the value at which they are the equations of
        ``system``.
    factors : float or (n,) float
        Excitation at each point relative to the excitation of ``system``.  The residual is linear
        in the excitation.

    Raises
    ------
    SettingError
        If a family has no equations next to its value, or its unknowns change.
    """
    pairs = [_neighbours(family, value, system) for family, value in families.values()]
    excess = np.broadcast_to(factors, len(points)) - 1.0
    # per unit of each parameter: frequency (Hz) and response (m)
    frequency_moves = np.empty((len(pairs), len(points)))
    response_moves = np.empty((len(pairs), len(points)), complex)
    # along the curve: columns frequency (Hz) and response (m)
    tangent = np.empty((len(points), 2), complex)
    for i, (point, unit) in enumerate(zip(points, scale)):
        y = point.y
        response = system.rows.value(y)
        changes = _moves_across(system, point, unit, pairs, excess[i])
        for j, (pair, change) in enumerate(zip(pairs, changes)):
            # the row of the response may itself depend on the parameter
            explicit = pair.rate(pair.high.first(y), pair.low.first(y))
            # the last unknown is the frequency in rad/s
            frequency_moves[j, i] = change[-1] / (2.0 * np.pi)
            response_moves[j, i] = explicit + system.rows.value(y + change) - response
        along = point.tangent * unit
        tangent[i, 0] = along[-1] / (2.0 * np.pi)
        tangent[i, 1] = system.rows.value(y + along) - response
    derivatives = {}
    for j, (name, (_, value)) in enumerate(families.items()):
        derivatives[name] = CurveSensitivity(
            name,
            value,
            frequency=frequency_moves[j],
            response=response_moves[j],
            tangent=tangent,
        )
    return derivatives


def _moves_across(
    system: Equations, point: Correction, unit: NDArray, pairs: Sequence[_Pair], excess: float
) -> NDArray:
    """Return the change (n_parameters, n_unknowns + 1) of a point per unit of each parameter.

    The point moves normal to the curve.  Its excitation exceeds that of ``system`` by the relative
    amount ``excess``, and ``unit`` scales its unknowns.
    """
    y = point.y
    moves = np.zeros((len(pairs), len(y)))
    # the second pass is at the ends of the first, so that changing modes do not cross a contact
    # event
    for _ in range(2):
        rates = []
        for pair, move in zip(pairs, moves):
            residuals = []
            for neighbour in (pair.high, pair.low):
                moved = y + neighbour.step * move * unit
                residuals.append(neighbour.residual(moved) - excess * neighbour.load)
            rates.append(pair.rate(*residuals))
        # the last row of the bordered matrix keeps the point in the plane normal to the curve
        right = np.pad(-np.array(rates), ((0, 0), (0, 1)))
        moves = moves + system.solve_linear(y, point.tangent, unit, right)
    return moves * unit


def sensitivities(
    peak: Peak, families: dict[str, tuple[Family, float]]
) -> dict[str, PeakSensitivity]:
    """Compute the derivatives of amplitude and frequency of a peak.

    One adjoint solution serves the amplitude for all parameters.  The frequency needs the
    derivative of the solution with respect to each parameter.

    Parameters
    ----------
    peak : Peak
    families : mapping of name to (family, value)
        Equations as a function of each parameter, and the value at which they are the equations of
        the peak.

    Returns
    -------
    dict of name to PeakSensitivity
        NaN with a reason if the peak is flat, or if one-sided differences disagree.

    Raises
    ------
    SettingError
        If the peak is not converged, or is at a corner, where it has no derivative.
    """
    _check(peak)
    linear: _Linear | None = None
    by_name: dict[str, PeakSensitivity] = {}
    for name, (family, value) in families.items():
        reason = ""
        try:
            # the equations at the peak are the same for all parameters
            if linear is None:
                linear = _Linear(family(value), peak)
            derivatives = linear.derivatives(family, value)
        except (SettingError, ArithmeticError, np.linalg.LinAlgError) as error:
            derivatives = np.full(len(peak.y) + 1, np.nan)
            reason = str(error)
        # all unknowns, the frequency in rad/s and the amplitude
        *_, omega, amplitude = derivatives
        by_name[name] = PeakSensitivity(
            name,
            value,
            amplitude=float(amplitude),
            frequency=float(omega) / (2.0 * np.pi),
            y=derivatives[:-1],
            reason=reason,
        )
    return by_name


class _Linear:
    """Linearised equations at a peak, with the derivatives of its position and amplitude."""

    def __init__(self, system: Equations, peak: Peak) -> None:
        self.system = system
        self.peak = peak
        self.adjoint = _adjoint(system, peak)
        # gradient of the slope: a row in scaled unknowns, and the adjoint of the equations
        self.row, self.nu = system.slope_gradient(peak.y, peak.tangent, peak.scale, DIFFERENCE)
        self.curvature = float(self.row @ peak.tangent)
        if self.curvature == 0.0:
            raise NoDerivative(
                "sensitivities: expected a curved peak, found a flat one at "
                f"{amount(peak.frequency, 'Hz')}"
            )

    def move(self, r_p: NDArray) -> NDArray:
        """Return the derivative of the solution with respect to the parameter.

        It is in scaled unknowns and normal to the tangent.
        ``r_p`` (n_unknowns,) is the derivative of the residual with respect to the parameter.
        """
        peak = self.peak
        # the last row of the matrix is the tangent
        right = np.append(-r_p, 0.0)
        # one right-hand side, (1, n_unknowns + 1)
        (move,) = self.system.solve_linear(peak.y, peak.tangent, peak.scale, right[None])
        return np.asarray(move)

    def derivatives(self, family: Family, value: float) -> NDArray:
        """Return the derivatives of the unknowns, the frequency (rad/s) and the amplitude of the peak.

        The shape is (n_unknowns + 2,).

        Raises
        ------
        NoDerivative
            If they are not finite, or the one-sided derivatives differ.
        """
        pair = _neighbours(family, value, self.system)
        y = self.peak.y
        move = self.move(pair.rate(pair.high.residual(y), pair.low.residual(y)))
        derivatives = self.along(move, pair)
        _finite(float(derivatives.sum()), self.peak)
        # the step is 0 at the lower end of a range, with only one side to compare
        has_both_sides = pair.low.step < 0.0
        if has_both_sides:
            size = max(abs(value), pair.high.step)
            self._check_one_sided(move, pair, derivatives, size)
        return derivatives

    def _check_one_sided(
        self, move: NDArray, pair: _Pair, derivatives: NDArray, size: float
    ) -> None:
        """Raise NoDerivative if the derivatives from above and below differ.

        ``derivatives`` (n_unknowns + 2,) are the central ones, and ``size`` is the size of the
        parameter.
        """
        at_value = _unchanged(self.system)
        above = self.along(move, _Pair(high=pair.high, low=at_value))
        below = self.along(move, _Pair(high=at_value, low=pair.low))

        # the last two entries: frequency (rad/s) and amplitude
        difference = np.abs(above[-2:] - below[-2:])
        peak_values = np.array([self.peak.frequency * 2.0 * np.pi, self.peak.amplitude])
        # derivatives of a peak that is proportional to the parameter
        proportional = peak_values / size
        tolerance = SIDES * np.abs(derivatives[-2:]) + NOISE * proportional
        if not (difference > tolerance).any():
            return
        sides = []
        for side in (above, below):
            *_, omega, amplitude = side
            sides.append(f"{amplitude:.3g} m, {amount(omega / (2.0 * np.pi), 'Hz')}")
        found = " and ".join(sides)
        raise NoDerivative(
            f"sensitivities: expected equal derivatives from above and below, found {found} per "
            "unit"
        )

    def along(self, move: NDArray, pair: _Pair) -> NDArray:
        """Return the derivatives (n_unknowns + 2,) from differences along the moving solution.

        ``move`` (n_unknowns + 1,) is the derivative of the solution in scaled unknowns.  The two
        points move with the parameter, so the contact states of both are nearly the states at the
        peak.
        """
        peak = self.peak
        high, low = pair.high, pair.low
        y_high = peak.y + high.step * move * peak.scale
        y_low = peak.y + low.step * move * peak.scale
        # residual that remains on the first derivative of the solution
        r_p = pair.rate(high.residual(y_high), low.residual(y_low))
        rest = self.move(r_p)
        # change of the slope of ln(amplitude) along the curve, which vanishes at the peak
        tangent = peak.tangent * peak.scale
        turn = pair.rate(high.turn(y_high, tangent), low.turn(y_low, tangent))
        slope = pair.rate(high.slope(y_high, peak), low.slope(y_low, peak))
        slope_change = slope - float(self.nu @ turn) + float(self.row @ rest)
        # the peak shifts along the curve until the slope vanishes again
        shift = slope_change / self.curvature
        dy = (move + rest - shift * peak.tangent) * peak.scale
        dy += peak.y * pair.rate(high.factors, low.factors)
        explicit = pair.rate(high.amplitude(y_high), low.amplitude(y_low))
        return np.append(dy, explicit - float(self.adjoint @ r_p))


@dataclass(frozen=True)
class _Neighbour:
    """Equations at a neighbouring parameter value.

    The factors on the unknowns preserve the motion of the contact points.
    """

    system: Equations
    step: float
    factors: NDArray

    def residual(self, y: NDArray) -> NDArray:
        return self.system.residual(self.factors * y)

    @property
    def load(self) -> NDArray:
        """Negative residual of the excitation (n_unknowns,)."""
        force = np.array(self.system.structure.force)
        force[: self.system.n_mean] = 0.0
        return force

    def first(self, y: NDArray) -> complex:
        return complex(self.system.rows.value(self.factors * y))

    def amplitude(self, y: NDArray) -> float:
        return abs(self.first(y))

    def slope(self, y: NDArray, peak: Peak) -> float:
        return slope_along(self.system, self.factors * y, peak.tangent, self.factors * peak.scale)

    def turn(self, y: NDArray, direction: NDArray) -> NDArray:
        """Return the derivative of the residual along a direction (n_unknowns + 1,)."""
        _, J, r_omega = self.system.evaluate_at(self.factors * y)
        # the factor of the frequency, the last unknown, is 1
        along_motion = (self.factors * direction)[:-1]
        along_omega = direction[-1]
        change: NDArray = J @ along_motion + r_omega * along_omega
        return change


@dataclass(frozen=True)
class _Pair:
    """Equations above and below a parameter value."""

    high: _Neighbour
    low: _Neighbour

    def rate(self, above: NDArray | complex, below: NDArray | complex) -> Any:
        """Return the difference quotient of a quantity above and below."""
        return (above - below) / (self.high.step - self.low.step)


def _neighbours(family: Family, value: float, system: Equations) -> _Pair:
    """Return the equations above and below a value.

    ``system`` contains the equations at the value.  At the lower end of the range it is also the
    lower neighbour.
    """
    size = abs(value) if value != 0.0 else 1.0
    step = DIFFERENCE * size
    above = family(value + step)
    high = _Neighbour(above, step, _factors(above, system))
    try:
        below = family(value - step)
    # end of the range, as for a friction coefficient of zero
    except SettingError:
        return _Pair(high, low=_unchanged(system))
    return _Pair(high, low=_Neighbour(below, -step, _factors(below, system)))


def _unchanged(system: Equations) -> _Neighbour:
    """Return the equations at the parameter value itself, whose unknowns need no factors."""
    return _Neighbour(system, step=0.0, factors=np.ones(system.n_unknowns + 1))


def _factors(system: Equations, reference: Equations) -> NDArray:
    """Return factors (n_unknowns + 1,) that match modes with different normalisation.

    Raises
    ------
    NoDerivative
        If the equations have different unknowns.
    """
    same_modes = np.array_equal(system.layout.n_mode, reference.layout.n_mode)
    if not same_modes:
        raise NoDerivative(
            "sensitivities: the residual modes change near the peak, so that solutions on both "
            "sides of the change cannot be compared"
        )
    factors = np.ones(system.n_unknowns + 1)
    # largest 1 - cos^2 between the contact motions of two modes that count as the same
    parallel = 1e-8
    bases = zip(system.structure.bases, reference.structure.bases)
    for harmonic, (basis, reference_basis) in enumerate(bases):
        if not basis.n_modes:
            continue
        # contact motion of each mode, (3 n_points, n_modes)
        G = basis.G.reshape(-1, basis.n_modes)
        G_reference = reference_basis.G.reshape(-1, reference_basis.n_modes)
        norm = np.einsum("pm,pm->m", G.conj(), G).real
        reference_norm = np.einsum("pm,pm->m", G_reference.conj(), G_reference).real
        product = np.einsum("pm,pm->m", G.conj(), G_reference)
        moves = norm > 0.0
        same = moves & (np.abs(product) ** 2 > (1.0 - parallel) * norm * reference_norm)
        # ratio with which ratio * G is closest to G_reference; other modes keep their unknowns
        divisor = np.where(same, norm, 1.0)
        ratio = np.where(same, product.real / divisor, 1.0)
        cosine, sine = system.layout.slices(harmonic)
        factors[cosine] = ratio
        if harmonic > 0:
            factors[sine] = ratio
    return factors


def _adjoint(system: Equations, peak: Peak) -> NDArray:
    """Return the adjoint solution (n_unknowns,).

    It is minus the derivative of the amplitude at the peak with respect to each residual.
    """
    gradient, squared = system.rows.squared_gradient(peak.y)
    # gradient of the amplitude, from half the gradient of its square
    gradient /= np.sqrt(squared)
    right = gradient * peak.scale
    # one right-hand side, (1, n_unknowns + 1)
    (solution,) = system.solve_linear(
        peak.y, peak.tangent, peak.scale, right[None], transposed=True
    )
    # without the multiplier of the tangent row
    adjoint: NDArray = solution[:-1]
    return adjoint


def amplitude_sensitivity(peak: Peak, family: Family, value: float) -> float:
    """Compute the derivative of the amplitude of a peak with respect to a parameter.

    The derivative has the unit m per unit of the parameter.  It requires only one adjoint solution.

    Parameters
    ----------
    peak : Peak
    family : callable
        Equations as a function of the parameter.
    value : float
        Value of the parameter at the peak.

    Raises
    ------
    SettingError
        See :func:`sensitivities`.
    """
    _check(peak)
    system = family(value)
    y = peak.y
    pair = _neighbours(family, value, system)
    r_p = pair.rate(pair.high.residual(y), pair.low.residual(y))
    explicit = pair.rate(pair.high.amplitude(y), pair.low.amplitude(y))
    return _finite(explicit - float(_adjoint(system, peak) @ r_p), peak)


def _finite(value: float, peak: Peak) -> float:
    """Return the derivative; raise NoDerivative if it is not finite."""
    if not np.isfinite(value):
        raise NoDerivative(
            f"sensitivities: expected finite derivatives, found {value} at {peak.frequency:.6g} Hz"
        )
    return value


def _check(peak: Peak) -> None:
    validation.check(peak.ok, "sensitivities", "a converged peak", f"status '{peak.status}'")
    validation.check(
        not peak.corner,
        "sensitivities",
        "a smooth peak",
        "a peak at a corner of the response curve",
    )


# ---- derivatives with respect to the preload and to settings ----


PARAMETERS = (
    "preload",
    "friction_coefficient",
    "contact_stiffness_factor",
    "excitation.amplitude",
    INERTIA,
    "damping_factor",
)


@one_thread
def peak_sensitivities(
    problem: Problem, peak: Peak, parameters: Sequence[str] = PARAMETERS
) -> Sensitivities:
    """See :meth:`bdamper.Study.peak_sensitivities`."""
    check_peak(problem, peak)
    by_parameter = families(problem, parameters, peak.parameter)
    whole_peak = with_tangent(problem.system(peak.parameter), peak)
    derivatives = sensitivities(whole_peak, by_parameter)
    return Sensitivities(derivatives, peak.amplitude, peak.frequency)


@one_thread
def curve_sensitivities(
    problem: Problem, curve: ResponseCurve, parameters: Sequence[str] = PARAMETERS
) -> CurveSensitivities:
    """See :meth:`bdamper.Study.curve_sensitivities`."""
    check_curve(problem, validation.instance("curve", curve, ResponseCurve))
    system = problem.system(curve.preload)
    options = ContinuationOptions()
    y = np.column_stack([curve.unknowns, 2.0 * np.pi * curve.frequency])
    # unit of the frequency: half of the interval in rad/s
    width = 1.0
    if len(curve):
        width = max(float(np.pi * np.ptp(curve.frequency)), 1e-300)
    scale = np.array([system.units(point, width) for point in y]).reshape(y.shape)
    points = []
    # a stored curve has no tangents: Newton's method from each point gives them
    for i, (guess, unit) in enumerate(zip(y, scale)):
        border = _normal_plane(y, curve.branch, i, unit)
        points.append(system.solve(guess, border, unit, options.tolerance, options.max_iterations))
    found = across(system, points, scale, families(problem, parameters, curve.preload))
    return CurveSensitivities(found, curve)


def _normal_plane(y: NDArray, branch: NDArray, i: int, unit: NDArray) -> Plane | Fixed:
    """Return the plane normal to the chord of the neighbours of point ``i`` on its branch.

    The frequency is fixed if the branch has no other point.
    """
    before = after = i
    if i > 0 and branch[i - 1] == branch[i]:
        before = i - 1
    if i + 1 < len(y) and branch[i + 1] == branch[i]:
        after = i + 1
    chord = (y[after] - y[before]) / unit
    if not chord.any():
        return Fixed()
    return Plane(chord / norm2(chord))


def band(
    curve: ResponseCurve, found: Mapping[str, CurveSensitivity], deviations: Mapping[str, float]
) -> tuple[NDArray, NDArray, NDArray]:
    """Compute the standard deviation of a curve with independent random parameters, to first order.

    Parameters
    ----------
    curve : ResponseCurve
    found : mapping of name to CurveSensitivity
        Sensitivities of this curve.
    deviations : mapping of name to float
        Standard deviation of each parameter.

    Returns
    -------
    deviation : (n,) float
        Standard deviation normal to the curve, in ln(amplitude) and in ln(frequency) over the width
        at half the highest amplitude.  NaN at points at which only the mean drifts along the curve.
    frequency, amplitude : (n, 2) float, Hz and m
        Edges of the band at plus and minus two standard deviations.
    """
    for name, value in validation.mapping("deviations", deviations, found, "parameters").items():
        validation.number(f"deviation of {name}", value, least=0.0)
    frequency = curve.frequency
    response = curve.harmonics[:, 1]
    high = curve.amplitude >= 0.5 * curve.amplitude.max()
    width = max(float(np.ptp(np.log(frequency[high]))), 1e-6)
    # coordinates of the plane: ln(frequency) over the width, and ln(amplitude)
    moves = []
    for name, deviation_of_parameter in deviations.items():
        derivative = found[name]
        by_frequency = derivative.frequency / frequency / width
        by_amplitude = (derivative.response / response).real
        moves.append(deviation_of_parameter * np.array([by_frequency, by_amplitude]))
    # all parameters have the tangent of the curve
    tangent = next(iter(found.values())).tangent
    along_frequency = tangent[:, 0].real / frequency / width
    along_amplitude = (tangent[:, 1] / response).real
    normal = np.array([-along_amplitude, along_frequency])
    # there is no normal direction at points at which only the mean drifts
    with np.errstate(invalid="ignore"):
        normal /= np.hypot(*normal)
    deviation = np.sqrt(sum((normal * move).sum(axis=0) ** 2 for move in moves))
    # (2, n) displacements times (2,) sides: (2, n, 2)
    both_sides = 2.0 * np.array([-1.0, 1.0])
    log_frequency, log_amplitude = both_sides * (deviation * normal)[..., None]
    frequency_edges = frequency[:, None] * np.exp(width * log_frequency)
    amplitude_edges = curve.amplitude[:, None] * np.exp(log_amplitude)
    return deviation, frequency_edges, amplitude_edges


def families(
    problem: Problem, parameters: Sequence[str], preload: float
) -> dict[str, tuple[Family, float]]:
    """Return the equations at one preload as functions of each parameter, with its value.

    Parameters without effect are omitted.
    """
    contact_forces = problem.settings.contact_forces
    if contact_forces != "event_driven":
        raise SettingError(
            'sensitivities: expected contact_forces="event_driven", because sampled forces cause '
            f"ripples in the amplitude, found {contact_forces}"
        )
    any_free_body = any(body.is_free for body in problem.model.bodies.values())
    by_name: dict[str, tuple[Family, float]] = {}
    for name in validation.names("parameters", parameters, ("preload", *setting_names(problem))):
        if name == "preload":
            if preload > 0.0:
                by_name[name] = (problem.system, preload)
            continue
        if name == "contact_stiffness_factor" and problem.settings.holds_preload:
            continue
        if name.partition(".")[0] in OF_MASS and not any_free_body:
            continue
        by_name[name] = (setting_family(problem, name, preload), setting_value(problem, name))
    return by_name


def setting_value(problem: Problem, name: str) -> float:
    """Return the current value of a numeric setting; it is 1 for a factor."""
    head, _, part = name.partition(".")
    if head in FACTORS:
        return 1.0
    settings = problem.settings
    if name == "friction_coefficient":
        common_friction = _common_friction(problem)
        if common_friction is not None:
            return common_friction
    value: Any
    if part and head == "friction_coefficient":
        value = settings.friction_by_interface().get(part, 0.0)
    elif part and head in OF_LOAD:
        value = settings.given_loads(head).get(part, 0.0)
    elif part and head == GAP:
        given = settings.gap or {}
        value = given.get(part, problem.model.interfaces[part].gap)
        # the gap of the model is a value for each point
        if isinstance(value, np.ndarray) and np.ptp(value) == 0.0:
            value = float(value.flat[0])
    else:
        value = settings
        for attribute in name.split("."):
            # without a setting the response is at the location of the excitation
            if attribute == "response":
                attribute = "response_location"
            value = getattr(value, attribute)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SettingError(f"{name}: expected a scalar setting, found {value!r}")
    return float(value)


def _common_friction(problem: Problem) -> float | None:
    """Return the friction coefficient if all interfaces have the same; a stored study has each."""
    interfaces = problem.model.interfaces
    coefficients: dict[str, Any] = {}
    for name, coefficient in problem.settings.friction_by_interface().items():
        if interfaces[name].kind == "friction":
            # coefficients of single points are arrays, which only their texts compare
            coefficients[str(coefficient)] = coefficient
    if len(coefficients) != 1:
        return None
    (coefficient,) = coefficients.values()
    return float(coefficient) if np.ndim(coefficient) == 0 else None


def setting_family(problem: Problem, name: str, preload: float) -> Family:
    """Return the equations at one preload as a function of one numeric setting.

    Factors on masses that determine the preload also change the preload.
    """

    masses_of_load = [MASS]
    # at a rotor speed the preload is the load of the first body
    if problem.settings.speed is not None and problem.body_loads:
        first_body = next(iter(problem.body_loads))
        masses_of_load.append(f"{MASS}.{first_body}")

    def family(value: float) -> Equations:
        varied = with_aligned_modes(vary(problem, {name: value}), problem)
        # the value is a factor on the mass, and the centrifugal load is proportional to the mass
        if name in masses_of_load:
            return varied.system(value * preload)
        return varied.system(preload)

    return family
