"""How a resonance peak, and a whole response curve, move with parameters.

Let ``B`` be ``[J r_omega; t^T]`` with the tangent ``t`` of the response curve.  With a parameter ``p``

    B z_p = (-r_p, 0),       dA/dp = grad(A) . z_p = -lambda . r_p,      B^T (lambda, nu) = (grad(A), 0):

one adjoint solution serves all parameters.  The peak itself moves by ``z_p + s t`` with
``s = -(d phi along (z_p, 1))/(grad(phi) . t)``, ``phi`` the slope of ln(amplitude) along the curve.  Its gradient takes
one more adjoint solution, nu, and differences of Jacobians along the curve (``csrc/bd_solver.c``); along (z_p, 1) ``phi``
changes with the response and by ``-nu . d[J r_omega] t``.

A point of a curve moves by ``z_p``, across the curve in scaled unknowns: the bordered matrix is regular at folds, where the
derivative at a fixed frequency is infinite.

Unknowns are coordinates of modes, which may change with the parameter: mass-normalised modes of a damper shrink with its
mass.  Equations at another value are therefore evaluated with factors on the unknowns that keep the motion of the contact
points; without them differences would be taken across the events of a damper that is moved by the change of its modes.

Derivatives of peaks and curves with respect to the preload and to settings; equations as functions of one setting.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import Correction, Equations, Fixed, Plane, norm2
from bdamper.harmonic_balance.parameters import FACTORS, OF_LOAD, like, setting_names, vary
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.result_checks import check_result
from bdamper.response.events import ContinuationOptions
from bdamper.response.peak import DIFFERENCE, Family, Peak, slope_along
from bdamper.response.response_curve import check_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.progress import one_thread

# ---- How a resonance peak, and a whole response curve, move with parameters ----


SIDES = 0.3
"""Relative difference of the derivatives from above and from below up to which there is one: at a flat peak of 771 and
671 Hz, of which whole peaks confirm the mean, 720.6."""
NOISE = 1e-4
"""Difference of the two relative derivatives that counts as curvature over the step, as at an optimum."""


class NoDerivative(SettingError, ArithmeticError):
    """A peak has no derivative with respect to a parameter, or none that can be computed."""


@dataclass(frozen=True)
class PeakSensitivity:
    """Derivatives of a peak with respect to one parameter, per unit of the parameter; NaN where they are not known.

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
    reason : str
        Why the derivatives are not known, empty if they are.
    """

    name: str
    value: float
    amplitude: float
    frequency: float
    y: NDArray = field(repr=False)
    reason: str = ""


@dataclass(frozen=True)
class CurveSensitivity:
    """Derivatives of a response curve with respect to one parameter, per unit of the parameter.

    A point moves across the curve, by a change of its frequency and of its response together, which is finite at folds.

    Parameters
    ----------
    name : str
    value : float
        Of the parameter on the curve.
    frequency : (n,) float
        Hz per unit.
    response : (n,) complex
        m per unit, of the first harmonic.
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
        """(n,) complex, m per unit: change of the response at a fixed frequency, without bound toward a fold."""
        onward = self.tangent[:, 0].real
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.response - self.tangent[:, 1] * self.frequency / onward


def across(
    system: Equations, points: Sequence[Correction], scale: NDArray, families: Mapping[str, tuple[Family, float]]
) -> dict[str, CurveSensitivity]:
    """How points of a response curve move with parameters, by one bordered matrix for each point.

    Parameters
    ----------
    system : Equations
    points : sequence of Correction
        Solutions with the tangent of the curve.
    scale : (n, n_unknowns + 1) float
        Units in which each tangent has unit length.
    families : mapping of name to (family, value)
        All families give the equations of ``system`` at their values.

    Raises
    ------
    SettingError
        If a family has no equations beside its value, or the same unknowns no longer.
    """
    sides = [_beside(family, value, system) for family, value in families.values()]
    moves = np.empty((len(sides), len(points), 2), complex)
    tangent = np.empty((len(points), 2), complex)
    for i, (point, unit) in enumerate(zip(points, scale)):
        y, first = point.y, system.rows.value(point.y)
        dy = np.zeros((len(sides), len(y)))
        for _ in range(2):  # the second time at the ends of the first move: modes that change do not go past an event
            ends = [(y + high.step * d * unit, y + low.step * d * unit) for (high, low), d in zip(sides, dy)]
            right = [_rate(h, l, h.residual(a), l.residual(b)) for (h, l), (a, b) in zip(sides, ends)]
            dy = dy + system.solve_linear(y, point.tangent, unit, np.pad(-np.array(right), ((0, 0), (0, 1))))
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


def sensitivities(peak: Peak, families: dict[str, tuple[Family, float]]) -> dict[str, PeakSensitivity]:
    """How a peak moves with parameters: amplitude by one adjoint solution, frequency by one direction for each.

    Parameters
    ----------
    peak : Peak
    families : mapping of name to (family, value)
        All families give the same equations at their values: those that the peak solves.

    Returns
    -------
    dict of name to PeakSensitivity
        With NaN and a reason where the peak is flat, or differences to both sides of the value disagree.

    Raises
    ------
    SettingError
        If the peak is not converged or lies at a corner, where it has no derivative.
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
        out[name] = PeakSensitivity(name, value, float(y[-1]), float(y[-2]) / (2.0 * np.pi), y[:-1], reason)
    return out


class _Linear:
    """The equations around a peak, and how its place and its height change with them."""

    def __init__(self, system: Equations, peak: Peak) -> None:
        self.system, self.peak = system, peak
        self.adjoint = _adjoint(system, peak)
        self.row, self.nu = system.slope_gradient(peak.y, peak.tangent, peak.scale, DIFFERENCE)
        self.curvature = float(self.row @ peak.tangent)
        if self.curvature == 0.0:
            raise NoDerivative(f"sensitivities: expected a curved peak, found a flat one at {peak.frequency:.6g} Hz")

    def move(self, r_p: NDArray) -> NDArray:
        """Change of the solution with a change of the residual, across the tangent, in scaled unknowns."""
        peak = self.peak
        return self.system.solve_linear(peak.y, peak.tangent, peak.scale, np.append(-r_p, 0.0)[None])[0]

    def derivatives(self, family: Family, value: float) -> NDArray:
        """(n_unknowns + 2,) derivatives of the place and of the amplitude of the peak.

        Raises
        ------
        NoDerivative
            If they are not finite, or differ from one side of the value to the other.
        """
        high, low = _beside(family, value, self.system)
        y = self.peak.y
        move = self.move(_rate(high, low, high.residual(y), low.residual(y)))
        whole = self.along(move, high, low)
        _finite(float(whole.sum()), self.peak)
        if low.step < 0.0:
            here = _Beside(self.system, 0.0, np.ones_like(y))
            sizes = np.array([self.peak.frequency * 2.0 * np.pi, self.peak.amplitude]) / max(abs(value), high.step)
            sides = [self.along(move, *ends)[-2:] for ends in ((high, here), (here, low))]
            if (np.abs(sides[0] - sides[1]) > SIDES * np.abs(whole[-2:]) + NOISE * sizes).any():
                found = " and ".join(f"{a:.3g} m, {w / (2.0 * np.pi):.3g} Hz" for w, a in sides)
                raise NoDerivative(f"sensitivities: expected the same from above and below, found {found} per unit")
        return whole

    def along(self, move: NDArray, high: _Beside, low: _Beside) -> NDArray:
        """The derivatives by differences at ends of the move, where a change of the modes does not go past an event."""
        peak, t = self.peak, self.peak.tangent * self.peak.scale
        ends = [peak.y + side.step * move * peak.scale for side in (high, low)]

        def rate(of: Callable[[_Beside, NDArray], NDArray | float]) -> Any:
            return _rate(high, low, *(of(side, end) for side, end in zip((high, low), ends)))

        r_p = rate(_Beside.residual)
        rest = self.move(r_p)
        turn = rate(lambda side, end: side.turn(end, t))
        slope = rate(lambda side, end: side.slope(end, peak))
        across = slope - float(self.nu @ turn) + float(self.row @ rest)
        dy = (move + rest - across / self.curvature * peak.tangent) * peak.scale
        dy += peak.y * rate(lambda side, end: side.factors)
        return np.append(dy, rate(_Beside.amplitude) - float(self.adjoint @ r_p))


@dataclass(frozen=True)
class _Beside:
    """The equations a step of the parameter away, with the factors on unknowns that keep the motion of contact points."""

    system: Equations
    step: float
    factors: NDArray

    def residual(self, y: NDArray) -> NDArray:
        return self.system.residual(self.factors * y)

    def first(self, y: NDArray) -> complex:
        return complex(self.system.rows.value(self.factors * y))

    def amplitude(self, y: NDArray) -> float:
        return abs(self.first(y))

    def slope(self, y: NDArray, peak: Peak) -> float:
        return slope_along(self.system, self.factors * y, peak.tangent, self.factors * peak.scale)

    def turn(self, y: NDArray, direction: NDArray) -> NDArray:
        """Change of the residual along a direction."""
        _, J, C = self.system.evaluate_at(self.factors * y)
        out: NDArray = J @ (self.factors * direction)[:-1] + C * direction[-1]
        return out


def _beside(family: Family, value: float, system: Equations) -> tuple[_Beside, _Beside]:
    """The equations at both sides of a value; at the value itself in place of a side where there are no values."""
    step = DIFFERENCE * (abs(value) if value != 0.0 else 1.0)
    above = family(value + step)
    high = _Beside(above, step, _factors(above, system))
    try:
        below = family(value - step)
    except SettingError:  # values end here, as a coefficient of friction does at zero
        return high, _Beside(system, 0.0, np.ones(system.n_unknowns + 1))
    return high, _Beside(below, -step, _factors(below, system))


def _rate(high: _Beside, low: _Beside, above: NDArray | complex, below: NDArray | complex) -> Any:
    """Derivative of what has these values at both sides."""
    return (above - below) / (high.step - low.step)


def _factors(system: Equations, reference: Equations) -> NDArray:
    """(n_unknowns + 1,) on unknowns of other equations that they move contact points by the same modes alike.

    Raises
    ------
    NoDerivative
        If the equations do not have the same unknowns.
    """
    if not np.array_equal(system.layout.n_mode, reference.layout.n_mode):
        raise NoDerivative("sensitivities: expected the same unknowns beside the peak, found other residual modes")
    out = np.ones(system.n_unknowns + 1)
    parallel = 1e-8  # one less squared cosine of two modes at the contact points up to which they are the same mode
    for l, (basis, other) in enumerate(zip(system.structure.bases, reference.structure.bases)):
        if not basis.n_modes:
            continue
        G, G_0 = (b.G.reshape(-1, b.n_modes) for b in (basis, other))
        own, shared, all_ = (np.einsum("pm,pm->m", a.conj(), b) for a, b in ((G, G), (G, G_0), (G_0, G_0)))
        same = (np.abs(shared) ** 2 > (1.0 - parallel) * own.real * all_.real) & (own.real > 0.0)
        for places in system.layout.slices(l)[: 1 + (l > 0)]:
            out[places] = np.where(same, shared.real / np.where(same, own.real, 1.0), 1.0)
    return out


def _adjoint(system: Equations, peak: Peak) -> NDArray:
    """(n_unknowns,) change of the amplitude at the peak with each of the residuals, for the other sign."""
    gradient, square = system.rows.squared_gradient(peak.y)
    gradient /= np.sqrt(square)
    return system.solve_linear(peak.y, peak.tangent, peak.scale, (gradient * peak.scale)[None], transposed=True)[0, :-1]


def amplitude_sensitivity(peak: Peak, family: Family, value: float) -> float:
    """Derivative of a peak's amplitude (m per unit of the parameter), by the adjoint solution alone.

    Parameters
    ----------
    peak : Peak
    family : callable
        The equations as a function of the parameter.
    value : float
        Of the parameter, at which the peak solves them.

    Raises
    ------
    SettingError
        As :func:`sensitivities`.
    """
    _check(peak)
    system, y = family(value), peak.y
    high, low = _beside(family, value, system)
    r_p = _rate(high, low, high.residual(y), low.residual(y))
    explicit = _rate(high, low, high.amplitude(y), low.amplitude(y))
    return _finite(explicit - float(_adjoint(system, peak) @ r_p), peak)


def _finite(value: float, peak: Peak) -> float:
    """A derivative that is finite."""
    if not np.isfinite(value):
        raise NoDerivative(f"sensitivities: expected finite ones, found {value} at {peak.frequency:.6g} Hz")
    return value


def _check(peak: Peak) -> None:
    validation.check(peak.converged, "sensitivities", "a converged peak", f"status '{peak.status}'")
    validation.check(not peak.corner, "sensitivities", "a smooth peak", "one at a corner of the response curve")


# ---- Derivatives of peaks and curves with respect to the preload and to settings; equations as  ----


PARAMETERS = (
    "preload", "friction_coefficient", "contact_stiffness_factor", "excitation.amplitude", "damper_mass_factor",
    "damping_factor",
)  # fmt: skip


@one_thread
def peak_sensitivities(problem: Problem, peak: Peak, parameters: Sequence[str] = PARAMETERS) -> dict[str, PeakSensitivity]:
    """Derivatives of a peak's amplitude and frequency with respect to the preload and to settings.

    Parameters
    ----------
    problem : Problem
    peak : Peak
        Of this problem, at a preload of ``peak.parameter`` newtons.
    parameters : sequence of str
        "preload" or any setting with a number (see :mod:`bdamper.harmonic_balance.parameters`); factors are taken at 1.
        "damper_mass" is the mass of the free bodies with the preload that goes with it at a fixed rotor speed, as a factor;
        "damper_mass_factor" is their inertia alone; "damper_mass.rear" and "damper_mass_factor.rear" are those of one.

    Returns
    -------
    dict of name to PeakSensitivity
        Derivatives that are not known are NaN, with a ``reason``.

    Raises
    ------
    SettingError
        If the peak is not converged or lies at a corner, or the evaluation is sampled: events between samples make the
        amplitude a rippled function of frequency, whose maxima move from ripple to ripple.
    """
    validation.instance("peak", peak, Peak, "a Peak, as Study.peak returns it")
    if peak.model_hash:
        check_result(problem, peak, "peak")
    return sensitivities(peak, families(problem, parameters, peak.parameter))


@one_thread
def curve_sensitivities(
    problem: Problem, curve: ResponseCurve, parameters: Sequence[str] = PARAMETERS
) -> dict[str, CurveSensitivity]:
    """Derivatives of a whole response curve with respect to the preload and to settings, finite at its folds.

    Parameters
    ----------
    problem : Problem
    curve : ResponseCurve
        A response curve of this problem.
    parameters : sequence of str
        As for :func:`peak_sensitivities`.

    Returns
    -------
    dict of name to CurveSensitivity
        ``bdamper.plot.plot_band`` draws with them what uncertain settings make of the curve.

    Raises
    ------
    SettingError
        If the curve is another one, or the evaluation is sampled.
    """
    check_curve(problem, validation.instance("curve", curve, ResponseCurve))
    system, n = problem.system(curve.preload), len(curve)
    y = np.column_stack([curve.unknowns, 2.0 * np.pi * curve.frequency])
    width = max(float(np.pi * np.ptp(curve.frequency)), 1e-300) if n else 1.0
    scale = np.array([system.units(p, width) for p in y]).reshape(y.shape)
    points = []
    for i, (p, unit) in enumerate(zip(y, scale)):
        beside = [k for k in (i - 1, i + 1) if 0 <= k < n and curve.branch[k] == curve.branch[i]]
        chord = (y[beside[-1]] - y[beside[0] if len(beside) > 1 else i]) / unit if beside else np.zeros(len(p))
        chord = chord * (-1.0 if beside == [i - 1] else 1.0)
        border = Plane(chord / norm2(chord)) if chord.any() else Fixed()
        points.append(system.solve(p, border, unit, ContinuationOptions().tolerance, ContinuationOptions().max_iterations))
    return across(system, points, scale, families(problem, parameters, curve.preload))


def band(
    curve: ResponseCurve, found: Mapping[str, CurveSensitivity], deviations: Mapping[str, float]
) -> tuple[NDArray, NDArray, NDArray]:
    """Standard deviation of a curve whose parameters scatter independently, to first order.

    Parameters
    ----------
    curve : ResponseCurve
    found : mapping of name to CurveSensitivity
        Of this curve.
    deviations : mapping of name to float
        Standard deviation of each parameter.

    Returns
    -------
    deviation : (n,) float
        Of each point across the curve, in ln(amplitude) and in ln(frequency) over the width at half the highest amplitude;
        NaN where the mean alone drifts along the curve.
    frequency, amplitude : (n, 2) float, Hz and m
        Edges of the band two standard deviations to both sides.
    """
    for name, value in validation.mapping("deviations", deviations, found, "parameters").items():
        validation.number(f"deviation of {name}", value, least=0.0)
    f, response = curve.frequency, curve.harmonics[:, 1]
    high = curve.amplitude >= 0.5 * curve.amplitude.max()
    width = max(float(np.ptp(np.log(f[high]))), 1e-6)
    own = [(found[name], value) for name, value in deviations.items()]
    moves = [d * np.array([s.frequency / f / width, (s.response / response).real]) for s, d in own]
    along = next(iter(found.values())).tangent
    normal = np.array([-(along[:, 1] / response).real, along[:, 0].real / f / width])
    with np.errstate(invalid="ignore"):  # where the mean alone drifts along the curve nothing is across it
        normal /= np.hypot(*normal)
    deviation = np.sqrt(sum((normal * move).sum(axis=0) ** 2 for move in moves))
    way = 2.0 * np.array([-1.0, 1.0]) * (deviation * normal)[..., None]
    return deviation, f[:, None] * np.exp(width * way[0]), curve.amplitude[:, None] * np.exp(way[1])


def families(problem: Problem, parameters: Sequence[str], preload: float) -> dict[str, tuple[Family, float]]:
    """The equations at one preload as functions of each parameter with its value; those that mean nothing are left out."""
    if (given := problem.settings.contact_forces) != "event_driven":
        raise SettingError(f'sensitivities: expected contact_forces="event_driven", found {given}: the peak has ripples')
    out: dict[str, tuple[Family, float]] = {}
    for name in validation.names("parameters", parameters, ("preload", *setting_names(problem))):
        if name == "preload":
            if preload > 0.0:
                out[name] = (problem.system, preload)
            continue
        if name == "contact_stiffness_factor" and problem.settings.holds_preload:
            continue
        if name.startswith("damper_mass") and not any(b.kind == "free" for b in problem.model.bodies.values()):
            continue
        out[name] = (setting_family(problem, name, preload), setting_value(problem, name))
    return out


def setting_value(problem: Problem, name: str) -> float:
    """Present value of a numeric setting, 1 for a factor."""
    head, _, part = name.partition(".")
    if head in FACTORS:
        return 1.0
    value: Any = problem.settings
    if of_part := part and head in ("friction_coefficient", *OF_LOAD):
        of_face = head == "friction_coefficient"
        value = (value.friction_by_interface() if of_face else value.given_loads(head)).get(part, 0.0)
    for part in () if of_part else name.split("."):
        value = getattr(value, part if part != "response" else "response_location")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SettingError(f"{name}: expected a setting that is one number, found {value!r}")
    return float(value)


def setting_family(problem: Problem, name: str, preload: float) -> Family:
    """The equations at one preload as a function of one numeric setting."""

    # at a rotor speed the preload is the load of the first body
    turning = problem.settings.speed is not None
    on_first = ("damper_mass", *(f"damper_mass.{body}" for body in list(problem.body_loads or ())[:1] if turning))

    def family(value: float) -> Equations:
        varied = like(vary(problem, {name: value}), problem)
        return varied.system(value * preload if name in on_first else preload)

    return family
