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
of a damper are inversely proportional to the root of its mass.  Factors on the unknowns at another
parameter value therefore preserve the motion of the contact points.  Without them the differences
would cross contact events, such as slip-to-stick, only because modes change.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import Correction, Equations, Fixed, Plane, norm2
from bdamper.harmonic_balance.parameters import (
    FACTORS,
    INERTIA,
    MASS,
    OF_LOAD,
    OF_MASS,
    like,
    setting_names,
    vary,
)
from bdamper.harmonic_balance.problem import Problem
from bdamper.response.events import ContinuationOptions
from bdamper.response.peak import DIFFERENCE, Family, Peak, check_peak, slope_along, with_tangent
from bdamper.response.response_curve import check_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import SettingError
from bdamper.util.formatting import peak_text, percent, spaced, table_lines
from bdamper.util.progress import one_thread

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
        Derivative of the amplitude, m per unit.
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


class Sensitivities(Plottable, dict[str, PeakSensitivity]):
    """Derivatives of a peak by parameter.

    ``plot`` draws the change for one per cent of each (:func:`bdamper.plot.plot_sensitivities`).

    Parameters
    ----------
    found : mapping of name to PeakSensitivity
    amplitude, frequency : float, m, Hz
        The peak.
    """

    def __init__(
        self, found: Mapping[str, PeakSensitivity], amplitude: float, frequency: float
    ) -> None:
        super().__init__(found)
        self.amplitude, self.frequency = amplitude, frequency

    def changes(self) -> dict[str, tuple[float, float]]:
        """Return the relative change of amplitude and frequency for one per cent of each parameter.

        NaN if unknown.
        """
        a, f = 0.01 / self.amplitude, 0.01 / self.frequency
        return {
            name: (a * s.value * s.amplitude, f * s.value * s.frequency) for name, s in self.items()
        }

    def _headline(self) -> str:
        known = {name: a for name, (a, _) in self.changes().items() if np.isfinite(a)}
        order = sorted(known, key=lambda name: -abs(known[name]))
        most = (
            ", ".join(f"{spaced(name)} {percent(known[name], True)}" for name in order[:3])
            or "none is known"
        )
        lost = "; ".join(f"{spaced(name)}: {s.reason}" for name, s in self.items() if s.reason)
        unknown = f" Unknown: {lost}." if lost else ""
        top = peak_text(self.amplitude, self.frequency)
        return f"Change of the peak of {top} for +1 % of a parameter: {most}.{unknown}"

    def _rows(self) -> list[tuple[str, ...]]:
        changes = self.changes().items()
        rows = [
            (spaced(n), f"{self[n].value:.6g}", percent(a, True), percent(f, True))
            for n, (a, f) in changes
        ]
        return [("parameter", "value", "amplitude for +1 %", "frequency for +1 %"), *rows]

    def summary(self) -> str:
        """Return the headline and a table of all parameters."""
        return "\n".join([self._headline(), *table_lines(self._rows(), "  ", whole=True)])


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
        Derivative of the first harmonic of the response, m per unit.
    tangent : (n, 2) complex
        Change of frequency (Hz) and response (m) along the curve.
    """

    name: str
    value: float
    frequency: NDArray
    response: NDArray
    tangent: NDArray

    @property
    def at_frequency(self) -> NDArray:
        """Derivative (n,) of the response at fixed frequency, m per unit; infinite at a fold."""
        onward = self.tangent[:, 0].real
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.response - self.tangent[:, 1] * self.frequency / onward


def across(
    system: Equations,
    points: Sequence[Correction],
    scale: NDArray,
    families: Mapping[str, tuple[Family, float]],
    factors: NDArray | float = 1.0,
) -> dict[str, CurveSensitivity]:
    """Compute the derivatives of points of a response curve, with one bordered matrix each.

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
    sides = [_neighbours(family, value, system) for family, value in families.values()]
    moves = np.empty((len(sides), len(points), 2), complex)
    tangent = np.empty((len(points), 2), complex)
    loads = [tuple(side.load for side in ends) for ends in sides]
    excess = np.broadcast_to(factors, len(points)) - 1.0
    for i, (point, unit) in enumerate(zip(points, scale)):
        y, first = point.y, system.rows.value(point.y)
        dy = np.zeros((len(sides), len(y)))
        for _ in range(
            2
        ):  # the second pass at the ends of the first: changing modes do not cross a contact event
            ends = [
                (y + high.step * d * unit, y + low.step * d * unit)
                for (high, low), d in zip(sides, dy)
            ]
            right = [
                _rate(h, l, h.residual(a) - excess[i] * up, l.residual(b) - excess[i] * down)
                for (h, l), (a, b), (up, down) in zip(sides, ends, loads)
            ]
            dy = dy + system.solve_linear(
                y, point.tangent, unit, np.pad(-np.array(right), ((0, 0), (0, 1)))
            )
        for j, ((high, low), d) in enumerate(zip(sides, dy * unit)):
            explicit = _rate(high, low, high.first(y), low.first(y))
            moves[j, i] = d[-1] / (2.0 * np.pi), explicit + system.rows.value(y + d) - first
        along = point.tangent * unit
        tangent[i] = along[-1] / (2.0 * np.pi), system.rows.value(y + along) - first
    values = [value for _, value in families.values()]
    return {
        name: CurveSensitivity(name, value, move[:, 0].real, move[:, 1], tangent)
        for name, value, move in zip(families, values, moves)
    }


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
    out: dict[str, PeakSensitivity] = {}
    for name, (family, value) in families.items():
        try:
            linear = linear or _Linear(family(value), peak)
            y, reason = linear.derivatives(family, value), ""
        except (SettingError, ArithmeticError, np.linalg.LinAlgError) as error:
            y, reason = np.full(len(peak.y) + 1, np.nan), str(error)
        out[name] = PeakSensitivity(
            name, value, float(y[-1]), float(y[-2]) / (2.0 * np.pi), y[:-1], reason
        )
    return out


class _Linear:
    """Linearised equations at a peak, with the derivatives of its position and amplitude."""

    def __init__(self, system: Equations, peak: Peak) -> None:
        self.system, self.peak = system, peak
        self.adjoint = _adjoint(system, peak)
        self.row, self.nu = system.slope_gradient(peak.y, peak.tangent, peak.scale, DIFFERENCE)
        self.curvature = float(self.row @ peak.tangent)
        if self.curvature == 0.0:
            raise NoDerivative(
                f"sensitivities: expected a curved peak, found a flat one at {peak.frequency:.6g} Hz"
            )

    def move(self, r_p: NDArray) -> NDArray:
        """Return the derivative of the solution with respect to the parameter.

        It is in scaled unknowns and normal to the tangent.
        ``r_p`` (n_unknowns,) is the derivative of the residual with respect to the parameter.
        """
        peak = self.peak
        return self.system.solve_linear(
            peak.y, peak.tangent, peak.scale, np.append(-r_p, 0.0)[None]
        )[0]

    def derivatives(self, family: Family, value: float) -> NDArray:
        """Return the derivatives (n_unknowns + 2,) of position and amplitude of the peak.

        Raises
        ------
        NoDerivative
            If they are not finite, or the one-sided derivatives differ.
        """
        high, low = _neighbours(family, value, self.system)
        y = self.peak.y
        move = self.move(_rate(high, low, high.residual(y), low.residual(y)))
        whole = self.along(move, high, low)
        _finite(float(whole.sum()), self.peak)
        if low.step < 0.0:
            here = _Neighbour(self.system, 0.0, np.ones_like(y))
            sizes = np.array([self.peak.frequency * 2.0 * np.pi, self.peak.amplitude]) / max(
                abs(value), high.step
            )
            sides = [self.along(move, *ends)[-2:] for ends in ((high, here), (here, low))]
            if (np.abs(sides[0] - sides[1]) > SIDES * np.abs(whole[-2:]) + NOISE * sizes).any():
                found = " and ".join(f"{a:.3g} m, {w / (2.0 * np.pi):.3g} Hz" for w, a in sides)
                raise NoDerivative(
                    f"sensitivities: expected the same from above and below, found {found} per unit"
                )
        return whole

    def along(self, move: NDArray, high: _Neighbour, low: _Neighbour) -> NDArray:
        """Return the derivatives from differences along the derivative of the solution.

        The two points move with the parameter, so the contact states of both are nearly the states
        at the peak.
        """
        peak, t = self.peak, self.peak.tangent * self.peak.scale
        ends = [peak.y + side.step * move * peak.scale for side in (high, low)]

        def rate(of: Callable[[_Neighbour, NDArray], NDArray | float]) -> Any:
            return _rate(high, low, *(of(side, end) for side, end in zip((high, low), ends)))

        r_p = rate(_Neighbour.residual)
        rest = self.move(r_p)
        turn = rate(lambda side, end: side.turn(end, t))
        slope = rate(lambda side, end: side.slope(end, peak))
        across = slope - float(self.nu @ turn) + float(self.row @ rest)
        dy = (move + rest - across / self.curvature * peak.tangent) * peak.scale
        dy += peak.y * rate(lambda side, end: side.factors)
        return np.append(dy, rate(_Neighbour.amplitude) - float(self.adjoint @ r_p))


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
        _, J, C = self.system.evaluate_at(self.factors * y)
        out: NDArray = J @ (self.factors * direction)[:-1] + C * direction[-1]
        return out


def _neighbours(family: Family, value: float, system: Equations) -> tuple[_Neighbour, _Neighbour]:
    """Return the equations above and below a value.

    At the lower end of its range those at the value replace those below.
    """
    step = DIFFERENCE * (abs(value) if value != 0.0 else 1.0)
    above = family(value + step)
    high = _Neighbour(above, step, _factors(above, system))
    try:
        below = family(value - step)
    except SettingError:  # end of the range, as for a friction coefficient of zero
        return high, _Neighbour(system, 0.0, np.ones(system.n_unknowns + 1))
    return high, _Neighbour(below, -step, _factors(below, system))


def _rate(
    high: _Neighbour, low: _Neighbour, above: NDArray | complex, below: NDArray | complex
) -> Any:
    """Return the difference quotient of two values."""
    return (above - below) / (high.step - low.step)


def _factors(system: Equations, reference: Equations) -> NDArray:
    """Return factors (n_unknowns + 1,) that match modes with different normalisation.

    Raises
    ------
    NoDerivative
        If the equations have different unknowns.
    """
    if not np.array_equal(system.layout.n_mode, reference.layout.n_mode):
        raise NoDerivative(
            "sensitivities: the residual modes change next to the peak, so its unknowns cannot be compared"
        )
    out = np.ones(system.n_unknowns + 1)
    parallel = (
        1e-8  # largest 1 - cos^2 between the contact motions of two modes that count as the same
    )
    for l, (basis, other) in enumerate(zip(system.structure.bases, reference.structure.bases)):
        if not basis.n_modes:
            continue
        G, G_0 = (b.G.reshape(-1, b.n_modes) for b in (basis, other))
        norm, shared, reference_norm = (
            np.einsum("pm,pm->m", a.conj(), b) for a, b in ((G, G), (G, G_0), (G_0, G_0))
        )
        same = (np.abs(shared) ** 2 > (1.0 - parallel) * norm.real * reference_norm.real) & (
            norm.real > 0.0
        )
        for places in system.layout.slices(l)[: 1 + (l > 0)]:
            out[places] = np.where(same, shared.real / np.where(same, norm.real, 1.0), 1.0)
    return out


def _adjoint(system: Equations, peak: Peak) -> NDArray:
    """Return the adjoint solution (n_unknowns,).

    It is minus the derivative of the amplitude at the peak with respect to each residual.
    """
    gradient, square = system.rows.squared_gradient(peak.y)
    gradient /= np.sqrt(square)
    return system.solve_linear(
        peak.y, peak.tangent, peak.scale, (gradient * peak.scale)[None], transposed=True
    )[0, :-1]


def amplitude_sensitivity(peak: Peak, family: Family, value: float) -> float:
    """Compute the derivative of a peak's amplitude (m per unit) by the adjoint solution alone.

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
    system, y = family(value), peak.y
    high, low = _neighbours(family, value, system)
    r_p = _rate(high, low, high.residual(y), low.residual(y))
    explicit = _rate(high, low, high.amplitude(y), low.amplitude(y))
    return _finite(explicit - float(_adjoint(system, peak) @ r_p), peak)


def _finite(value: float, peak: Peak) -> float:
    """Return the derivative; raise NoDerivative if it is not finite."""
    if not np.isfinite(value):
        raise NoDerivative(
            f"sensitivities: expected finite ones, found {value} at {peak.frequency:.6g} Hz"
        )
    return value


def _check(peak: Peak) -> None:
    validation.check(peak.converged, "sensitivities", "a converged peak", f"status '{peak.status}'")
    validation.check(
        not peak.corner,
        "sensitivities",
        "a smooth peak",
        "a peak at a corner of the response curve",
    )


# ---- derivatives with respect to the preload and to settings ----


PARAMETERS = (
    "preload", "friction_coefficient", "contact_stiffness_factor", "excitation.amplitude", INERTIA,
    "damping_factor",
)  # fmt: skip


@one_thread
def peak_sensitivities(
    problem: Problem, peak: Peak, parameters: Sequence[str] = PARAMETERS
) -> Sensitivities:
    """See :meth:`bdamper.Study.peak_sensitivities`."""
    check_peak(problem, peak)
    found = families(problem, parameters, peak.parameter)
    derivatives = sensitivities(with_tangent(problem.system(peak.parameter), peak), found)
    return Sensitivities(derivatives, peak.amplitude, peak.frequency)


@one_thread
def curve_sensitivities(
    problem: Problem, curve: ResponseCurve, parameters: Sequence[str] = PARAMETERS
) -> dict[str, CurveSensitivity]:
    """See :meth:`bdamper.Study.curve_sensitivities`."""
    check_curve(problem, validation.instance("curve", curve, ResponseCurve))
    system, n = problem.system(curve.preload), len(curve)
    y = np.column_stack([curve.unknowns, 2.0 * np.pi * curve.frequency])
    width = max(float(np.pi * np.ptp(curve.frequency)), 1e-300) if n else 1.0
    scale = np.array([system.units(p, width) for p in y]).reshape(y.shape)
    points = []
    for i, (p, unit) in enumerate(zip(y, scale)):
        adjacent = [k for k in (i - 1, i + 1) if 0 <= k < n and curve.branch[k] == curve.branch[i]]
        chord = (
            (y[adjacent[-1]] - y[adjacent[0] if len(adjacent) > 1 else i]) / unit
            if adjacent
            else np.zeros(len(p))
        )
        chord = chord * (-1.0 if adjacent == [i - 1] else 1.0)
        border = Plane(chord / norm2(chord)) if chord.any() else Fixed()
        points.append(
            system.solve(
                p,
                border,
                unit,
                ContinuationOptions().tolerance,
                ContinuationOptions().max_iterations,
            )
        )
    return across(system, points, scale, families(problem, parameters, curve.preload))


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
        at half the highest amplitude.  NaN where only the mean drifts along the curve.
    frequency, amplitude : (n, 2) float, Hz and m
        Edges of the band at plus and minus two standard deviations.
    """
    for name, value in validation.mapping("deviations", deviations, found, "parameters").items():
        validation.number(f"deviation of {name}", value, least=0.0)
    f, response = curve.frequency, curve.harmonics[:, 1]
    high = curve.amplitude >= 0.5 * curve.amplitude.max()
    width = max(float(np.ptp(np.log(f[high]))), 1e-6)
    sensitivities = [(found[name], value) for name, value in deviations.items()]
    moves = [
        d * np.array([s.frequency / f / width, (s.response / response).real])
        for s, d in sensitivities
    ]
    along = next(iter(found.values())).tangent
    normal = np.array([-(along[:, 1] / response).real, along[:, 0].real / f / width])
    with np.errstate(invalid="ignore"):  # no normal direction exists where only the mean drifts
        normal /= np.hypot(*normal)
    deviation = np.sqrt(sum((normal * move).sum(axis=0) ** 2 for move in moves))
    way = 2.0 * np.array([-1.0, 1.0]) * (deviation * normal)[..., None]
    return deviation, f[:, None] * np.exp(width * way[0]), curve.amplitude[:, None] * np.exp(way[1])


def families(
    problem: Problem, parameters: Sequence[str], preload: float
) -> dict[str, tuple[Family, float]]:
    """Return the equations at one preload as functions of each parameter, with its value.

    Parameters without effect are omitted.
    """
    if (given := problem.settings.contact_forces) != "event_driven":
        raise SettingError(
            f'sensitivities: expected contact_forces="event_driven", found {given}: the peak has ripples'
        )
    out: dict[str, tuple[Family, float]] = {}
    for name in validation.names("parameters", parameters, ("preload", *setting_names(problem))):
        if name == "preload":
            if preload > 0.0:
                out[name] = (problem.system, preload)
            continue
        if name == "contact_stiffness_factor" and problem.settings.holds_preload:
            continue
        if name.partition(".")[0] in OF_MASS and not any(
            b.kind == "free" for b in problem.model.bodies.values()
        ):
            continue
        out[name] = (setting_family(problem, name, preload), setting_value(problem, name))
    return out


def setting_value(problem: Problem, name: str) -> float:
    """Return the present value of a numeric setting, 1 for a factor."""
    head, _, part = name.partition(".")
    if head in FACTORS:
        return 1.0
    value: Any = problem.settings
    if name == "friction_coefficient":  # a stored study has it by interface
        interfaces = problem.model.interfaces
        own = {
            str(mu): mu
            for face, mu in value.friction_by_interface().items()
            if interfaces[face].kind == "friction"
        }
        if len(own) == 1 and np.ndim(mu := own.popitem()[1]) == 0:
            return float(mu)
    if of_part := part and head in ("friction_coefficient", *OF_LOAD):
        of_face = head == "friction_coefficient"
        value = (value.friction_by_interface() if of_face else value.given_loads(head)).get(
            part, 0.0
        )
    for part in () if of_part else name.split("."):
        value = getattr(value, part if part != "response" else "response_location")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SettingError(f"{name}: expected a setting that is one number, found {value!r}")
    return float(value)


def setting_family(problem: Problem, name: str, preload: float) -> Family:
    """Return the equations at one preload as a function of one numeric setting."""

    # at a rotor speed the preload is the load of the first body
    turning = problem.settings.speed is not None
    on_first = (MASS, *(f"{MASS}.{body}" for body in list(problem.body_loads or ())[:1] if turning))

    def family(value: float) -> Equations:
        varied = like(vary(problem, {name: value}), problem)
        return varied.system(value * preload if name in on_first else preload)

    return family
