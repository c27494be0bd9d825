"""Resonance peaks as solutions of their own equations, and their continuation in any scalar parameter.

On a response curve ``r(y) = 0``, ``y = (u, omega)``, with unit tangent ``t``, the squared amplitude of the response has a
maximum where its slope

    phi = grad(|X_1|^2/2) . t / |X_1|^2

falls through zero.  With the adjoint ``J^T lambda = grad(|X_1|^2/2)`` this is ``lambda^T r_omega = 0`` times the frequency
component of ``t``; in terms of ``t`` the condition stays regular where the curve turns, and a resonance that leans over
has its maximum just there.  :func:`find_peak` finds the root of ``phi`` along the curve by a safeguarded secant, one
bordered Newton corrector for each trial.  Where the curve has a corner ``phi`` may jump through zero: then the bracket
shrinks onto the corner.

Sensitivities.  Let ``B`` be ``[J r_omega; t^T]``.  With a parameter ``p``

    B z_p = (-r_p, 0),       dA/dp = grad(A) . z_p = -lambda . r_p,      B^T (lambda, nu) = (grad(A), 0):

one adjoint solution serves all parameters.  The peak itself moves by ``z_p + s t`` with
``s = -(d phi along (z_p, 1)) / (d phi along t)``; these two directional derivatives are central differences of the exact
slope, the second derivatives of the contact law never being formed.

A peak that is followed in a parameter is predicted by a polynomial through the latest peaks (through the latest one and
its sensitivity at the start).  If it is not found where it was predicted the step in the parameter is halved; a peak that
cannot be found at the smallest step has met a minimum and vanished with it, or the solver lost it: the result says at
which value.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from bdamper.continuation import ContinuationOptions, PathPoint
from bdamper.errors import SettingError
from bdamper.system import OK, STATUS_TEXT, Cost, HarmonicSystem

Family = Callable[[float], HarmonicSystem]
"""The equations as a function of one scalar parameter."""


@dataclass(frozen=True)
class PeakOptions:
    """Settings of the search for a peak and of its continuation.

    Parameters
    ----------
    tolerance : float
        On the residual, relative to excitation and static load.
    position_tolerance : float
        On the place of the peak along the curve, relative to the vibration.
    max_step : float
        Largest step along the curve, relative to the vibration.
    max_iterations : int
        Newton iterations in one corrector.
    max_trials : int
        Correctors spent on one peak.
    max_distance : float
        Largest distance, relative to the vibration, of a peak from its prediction in the parameter.
    max_halvings : int
        Halvings of a step in the parameter before the peak counts as vanished.
    difference : float
        Relative step of the central differences in sensitivities.
    """

    tolerance: float = 1e-10
    position_tolerance: float = 1e-8
    max_step: float = 0.4
    max_iterations: int = 12
    max_trials: int = 40
    max_distance: float = 0.3
    max_halvings: int = 6
    difference: float = 1e-5

    def __post_init__(self) -> None:
        for name in ("tolerance", "position_tolerance", "max_step", "max_distance", "difference"):
            value = getattr(self, name)
            if not 0.0 < value < 10.0:
                raise SettingError(f"{name}: expected a positive number below 10, found {value}")
        if min(self.max_iterations, self.max_trials) < 2 or self.max_halvings < 0:
            raise SettingError("max_iterations, max_trials, max_halvings: expected at least 2, 2 and 0")


@dataclass(frozen=True)
class Peak:
    """A maximum of the response amplitude along a response curve, or the place where the search for it ended.

    Parameters
    ----------
    parameter : float
        Value at which the equations were taken; NaN if they depend on none.
    frequency : float, Hz
    amplitude : float, m
        Of the first harmonic of the response.
    y : (n_unknowns + 1,) float
    tangent : (n_unknowns + 1,) float
        Of the response curve, unit length in unknowns divided by ``scale``.
    scale : (n_unknowns + 1,) float
    slope, curvature : float
        First and second derivative of ln(amplitude) along the curve in scaled unknowns.
    shares : (3,) float
        Stick, slip and open.
    residual : float
    iterations, trials : int
    rank_deficiency : int
    corner : bool
        The curve has a corner at the peak: slopes on both sides differ in sign but do not vanish.
    status : str
        "converged" or what went wrong; an unconverged peak is never used as a solution.
    cost : Cost, optional
        Of all that it took to find it, where that was metered.
    scan : str
        How the response curve ended on which it is the highest peak, where one was followed: unless "complete", there may
        be a higher one.
    """

    parameter: float
    frequency: float
    amplitude: float
    y: NDArray
    tangent: NDArray
    scale: NDArray
    slope: float
    curvature: float
    shares: NDArray
    residual: float
    iterations: int
    trials: int
    rank_deficiency: int
    corner: bool = False
    status: str = "converged"
    cost: Cost | None = None
    scan: str = ""

    @property
    def converged(self) -> bool:
        return self.status == "converged"

    def __str__(self) -> str:
        if not self.converged:
            return f"no peak found: {self.status}"
        return (
            f"peak {self.amplitude:.8g} m at {self.frequency:.8g} Hz{' (corner)' if self.corner else ''}, residual "
            f"{self.residual:.1e}, {self.trials} correctors, {self.iterations} iterations"
            + ("" if self.scan in ("", "complete") else f"\n  there may be a higher one, the curve ended as: {self.scan}")
            + ("" if self.cost is None else f"\n  {self.cost}")
        )


@dataclass(frozen=True)
class _OnCurve:
    """A converged point of the response curve; ``slope`` is that of ln(amplitude)."""

    y: NDArray
    tangent: NDArray
    slope: float
    residual: float
    shares: NDArray
    rank_deficiency: int


def peak_scale(system: HarmonicSystem, y: NDArray, width: float) -> NDArray:
    """Units of the mean, of the vibration and of the frequency (``width``, rad/s) at a point."""
    n = system.n_mean
    vibration = max(float(np.linalg.norm(y[n:-1])), 1e-300)
    scale = np.empty(len(y))
    scale[:n] = max(float(np.linalg.norm(y[:n])), vibration)
    scale[n:-1] = vibration
    scale[-1] = width
    return scale


def walked(system: HarmonicSystem, y: NDArray, scale: NDArray) -> list[NDArray]:
    """Guesses that differ from a point in the mean position that the contact holds least.

    Where every point slips or opens within the cycle in some direction, nothing holds the mean in this direction: a body
    walks until a plane stops it, and back when friction holds it again.  The mean position then jumps with the preload
    while the vibration does not.  The guesses are: not displaced at all in this direction, and displaced either way until
    the first open point touches.
    """
    n = system.n_mean
    if n == 0:
        return []
    try:
        _, J, _ = system.evaluate(y[:-1], y[-1])
    except FloatingPointError:
        return []
    v = np.linalg.svd(J[:n, :n] * scale[:n])[2][-1] * scale[:n]
    v /= np.linalg.norm(v)
    X, F, _ = system.contact(y[:-1])
    theta = np.linspace(0.0, 2.0 * np.pi, 64 * system.n_harmonics, endpoint=False)
    l = np.arange(1, system.n_harmonics + 1)
    wave = np.stack([np.cos(np.outer(l, theta)), np.sin(np.outer(l, theta))], axis=1).reshape(-1, len(theta))
    closing = (X[:, 2, :1] + X[:, 2, 1:] @ wave).max(axis=1)
    kn = system.points.kn
    rate = system.bases[0].G[:, 2].real @ v
    touching = (F[:, 2, 0] == 0.0) & (kn > 0.0) & (np.abs(rate) > 1e-9 * max(float(np.abs(rate).max()), 1e-300))
    way = -(closing + system.points.n0 / np.where(kn > 0.0, kn, 1.0))[touching] / rate[touching]
    ways = [-float(v @ y[:n])]
    if np.any(way > 0.0):
        ways.append(1.001 * float(way[way > 0.0].min()))
    if np.any(way < 0.0):
        ways.append(1.001 * float(way[way < 0.0].max()))
    out = []
    for w in ways:
        moved = y.copy()
        moved[:n] += w * v
        out.append(moved)
    return out


def _width(y: NDArray, tangent: NDArray, scale: NDArray, n_mean: int) -> float:
    """Change of frequency over which the vibration changes by its own size, within reason."""
    raw = tangent * scale
    change = max(float(np.linalg.norm(raw[n_mean:-1])), 1e-300)
    width = abs(float(raw[-1])) * float(np.linalg.norm(y[n_mean:-1])) / change
    return float(np.clip(width, 1e-7 * y[-1], 0.2 * y[-1]))


def _gradient(system: HarmonicSystem, y: NDArray) -> tuple[NDArray, float]:
    """Gradient of half the squared amplitude with respect to y, and the squared amplitude."""
    row = system.response_rows[1]
    x = system.amplitudes(y[:-1], 1) @ row
    c, s = system.slices(1)
    g = np.zeros(len(y))
    conjugate = np.conj(x) * row
    g[c], g[s] = conjugate.real, conjugate.imag
    return g, float(abs(x) ** 2)


def _slope(system: HarmonicSystem, y: NDArray, tangent: NDArray, scale: NDArray) -> float:
    g, square = _gradient(system, y)
    return float((g * scale) @ tangent) / max(square, 1e-300)


class _Search:
    """The search along one response curve."""

    def __init__(self, system: HarmonicSystem, scale: NDArray, options: PeakOptions, reach: float) -> None:
        self.reach = reach
        self.system = system
        self.scale = scale
        self.options = options
        self.iterations = 0
        self.trials = 0
        self.reason = ""

    def correct(self, y: NDArray, normal: NDArray, loose: float = 0.0) -> _OnCurve | None:
        self.trials += 1
        tolerance = max(self.options.tolerance, loose)
        c = self.system.correct(y, normal, self.scale, tolerance, self.options.max_iterations)
        self.iterations += c.iterations
        if c.status != OK:
            self.reason = STATUS_TEXT[c.status]
            return None
        return _OnCurve(
            c.y, c.tangent, _slope(self.system, c.y, c.tangent, self.scale), c.residual, np.array(c.shares),
            c.rank_deficiency,
        )  # fmt: skip

    def first(self, y: NDArray, normal: NDArray, walk: bool) -> _OnCurve | None:
        """The curve near a guess; if Newton fails there, also with the mean moved to where it may be held."""
        found = self.correct(y, normal, 1e-6)
        if found is not None or not walk:
            return found
        for moved in walked(self.system, y, self.scale):
            found = self.correct(moved, normal, 1e-6)
            vibration = slice(self.system.n_mean, None)
            if found is not None and np.linalg.norm((found.y - moved)[vibration] / self.scale[vibration]) < 0.5:
                return found
        return None

    def step(self, a: _OnCurve, s: float) -> _OnCurve | None:
        """A point at a distance along the curve, halving the distance if the corrector fails or goes astray.

        The residual is brought down only as far as a trial at this distance needs.
        """
        for _ in range(6):
            predicted = a.y + s * a.tangent * self.scale
            if predicted[-1] > 0.0:
                b = self.correct(predicted, a.tangent, min(1e-6, 1e-4 * abs(s)) if abs(s) > 3e-4 else 0.0)
                if b is not None:
                    if float(np.linalg.norm((b.y - predicted) / self.scale)) <= max(0.5 * abs(s), 1e-6):
                        return b
                    self.reason = "solution far from its prediction"
            s *= 0.5
        return None

    def between(self, a: _OnCurve, b: _OnCurve, fraction: float) -> _OnCurve | None:
        """A point between two points of the curve, predicted by a cubic through both with their tangents."""
        chord = (b.y - a.y) / self.scale
        length = float(np.linalg.norm(chord))
        if length == 0.0:
            return None
        f = fraction
        cubic = (
            (1.0 + 2.0 * f) * (1.0 - f) ** 2 * a.y
            + f**2 * (3.0 - 2.0 * f) * b.y
            + length * self.scale * (f * (1.0 - f) ** 2 * a.tangent - f**2 * (1.0 - f) * b.tangent)
        )
        for guess in (cubic, a.y + f * (b.y - a.y)):
            c = self.correct(guess, chord / length)
            if c is not None and float(np.linalg.norm((c.y - guess) / self.scale)) <= length:
                return c
        return None

    def run(self, start: _OnCurve, curvature: float) -> tuple[_OnCurve, float, bool, bool]:
        """Root of the slope: the point, the derivative of the slope, success, and whether it lies at a corner."""
        point, curvature, found, corner = self.search(start, curvature)
        if found and point.residual > self.options.tolerance:
            exact = self.correct(point.y, point.tangent)
            if exact is None:
                return point, curvature, False, corner
            point = exact
        return point, curvature, found, corner

    def search(self, start: _OnCurve, curvature: float) -> tuple[_OnCurve, float, bool, bool]:
        """The same with a residual that may still be too large."""
        options = self.options
        here = start
        before: _OnCurve | None = None
        rising: _OnCurve | None = None  # slope > 0: before the maximum
        falling: _OnCurve | None = None
        stalls = 0
        moved = 0.0
        while self.trials < options.max_trials:
            if here.slope > 0.0:
                rising = here
            else:
                falling = here
            if before is not None:
                moved = float(here.tangent @ ((here.y - before.y) / self.scale))
                if moved != 0.0:
                    estimate = (here.slope - before.slope) / moved
                    if np.isfinite(estimate) and estimate != 0.0:
                        curvature = estimate
                stalls = stalls + 1 if abs(here.slope) > 0.5 * abs(before.slope) else 0
                if np.linalg.norm((here.y - start.y)[self.system.n_mean :] / self.scale[self.system.n_mean :]) > self.reach:
                    self.reason = "a peak far from its prediction"
                    return here, curvature, False, False
            if here.slope == 0.0:
                return here, curvature, True, False
            # no maximum in sight: uphill
            step = -here.slope / curvature if curvature < 0.0 else options.max_step * float(np.sign(here.slope))
            if curvature < 0.0 and abs(step) <= options.position_tolerance:
                return here, curvature, True, False
            limit = options.max_step if before is None else min(options.max_step, max(8.0 * abs(moved), 0.02))
            step = float(np.clip(step, -limit, limit))
            new: _OnCurve | None
            if rising is not None and falling is not None:
                length = float(np.linalg.norm((falling.y - rising.y) / self.scale))
                if length <= options.position_tolerance:
                    return here, curvature, True, True
                inside = abs(step) < length and (step > 0.0) == (here is rising)
                if inside and stalls < 2:
                    new = self.step(here, step)
                else:
                    fraction = rising.slope / (rising.slope - falling.slope)
                    new = self.between(rising, falling, 0.5 if stalls >= 2 else min(max(fraction, 0.05), 0.95))
                    stalls = 0
            else:
                new = self.step(here, step)
            if new is None:
                return here, curvature, False, False
            before, here = here, new
        self.reason = f"not found within {options.max_trials} correctors"
        return here, curvature, False, False


def find_peak(
    system: HarmonicSystem,
    guess: NDArray,
    *,
    tangent: NDArray | None = None,
    scale: NDArray | None = None,
    width: float | None = None,
    curvature: float = -1.0,
    options: PeakOptions | None = None,
    parameter: float = np.nan,
    walk: bool = True,
    reach: float = np.inf,
) -> Peak:
    """The maximum of the response amplitude that the curve reaches uphill from a point near it.

    Parameters
    ----------
    system : HarmonicSystem
    guess : (n_unknowns + 1,) float
        Unknowns and frequency (rad/s) near the response curve.
    tangent : (n_unknowns + 1,) float, optional
        Estimate of the direction of the curve in scaled unknowns; the first corrector works in the plane normal to it, at
        fixed frequency without it.
    scale : (n_unknowns + 1,) float, optional
    width : float, rad/s, optional
        Unit of frequency, of the order of the half-width of the resonance; found from the curve by default.
    curvature : float
        Estimate of the second derivative of ln(amplitude) along the curve in scaled unknowns.
    options : PeakOptions
    parameter : float
        Noted in the result.
    walk : bool
        If Newton fails at the guess, try also mean positions to which a body may have walked.
    reach : float
        How far to go along the curve, relative to the vibration.

    Returns
    -------
    Peak
        ``status`` is "converged", or says why there is none.
    """
    options = options or PeakOptions()
    guess = np.asarray(guess, float)
    given = width is not None or scale is not None
    if scale is None:
        scale = peak_scale(system, guess, width or 0.01 * guess[-1])
    if tangent is None:
        tangent = np.zeros(len(guess))
        tangent[-1] = 1.0
    search = _Search(system, scale, options, reach)
    start = search.first(guess, tangent, walk)
    if start is not None and not given:
        raw = start.tangent * scale
        width = _width(start.y, start.tangent, scale, system.n_mean)
        search.scale = scale = peak_scale(system, start.y, width)
        t = raw / scale
        t /= np.linalg.norm(t)
        start = replace(start, tangent=t, slope=_slope(system, start.y, t, scale))
    if start is None:
        _, square = _gradient(system, guess)
        return Peak(
            parameter, guess[-1] / (2 * np.pi), np.sqrt(square), guess, tangent, scale, np.nan, np.nan, np.full(3, np.nan),
            np.nan, search.iterations, search.trials, 0, False, f"no solution near the guess: {search.reason}",
        )  # fmt: skip
    point, curvature, found, corner = search.run(start, curvature)
    _, square = _gradient(system, point.y)
    return Peak(
        parameter,
        float(point.y[-1] / (2.0 * np.pi)),
        float(np.sqrt(square)),
        point.y,
        point.tangent,
        search.scale,
        point.slope,
        curvature,
        point.shares,
        point.residual,
        search.iterations,
        search.trials,
        point.rank_deficiency,
        corner,
        "converged" if found else search.reason,
    )


def coarse_options(tolerance: float = 1e-7) -> ContinuationOptions:
    """Settings with which a curve is followed only to learn which peaks it has."""
    return ContinuationOptions(tolerance=tolerance, step=0.1, locate_tolerance=0.05)


def refine_maxima(
    system: HarmonicSystem,
    points: Sequence[PathPoint],
    *,
    options: PeakOptions | None = None,
    parameter: float = np.nan,
) -> tuple[Peak, ...]:
    """Peaks from the points of a followed path that are marked as maxima, each found once, the highest first."""
    peaks: list[Peak] = []
    for point in points:
        if point.kind != "maximum":
            continue
        width = _width(point.y, point.tangent, point.scale, system.n_mean)
        scale = peak_scale(system, point.y, width)
        tangent = point.tangent * point.scale / scale
        tangent /= np.linalg.norm(tangent)
        peak = find_peak(system, point.y, tangent=tangent, scale=scale, options=options, parameter=parameter)
        if peak.converged and not any(same_peak(peak, other) for other in peaks):
            peaks.append(peak)
    return tuple(sorted(peaks, key=lambda p: -p.amplitude))


def same_peak(a: Peak, b: Peak, tolerance: float = 1e-5) -> bool:
    """Whether two peaks of the same equations agree in frequency and amplitude."""
    return (
        abs(a.frequency - b.frequency) <= tolerance * b.frequency
        and abs(a.amplitude - b.amplitude) <= tolerance * max(a.amplitude, b.amplitude)
    )  # fmt: skip


# ---- sensitivities ----


class _Bordered:
    """``B = [J r_omega; t^T]`` in scaled unknowns, factorised; least norm if it is singular."""

    def __init__(self, J: NDArray, r_omega: NDArray, tangent: NDArray, scale: NDArray) -> None:
        n = len(r_omega)
        B = np.empty((n + 1, n + 1))
        B[:n, :n] = J * scale[:n]
        B[:n, n] = r_omega * scale[n]
        B[n] = tangent
        self.row = 1.0 / np.maximum(np.abs(B).max(axis=1), 1e-300)
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


def _slope_at(system: HarmonicSystem, y: NDArray, reference: NDArray, scale: NDArray) -> float:
    """Slope of ln(amplitude) along the curve through any point (on which the residual need not vanish)."""
    _, J, r_omega = system.evaluate(y[:-1], y[-1])
    b = np.zeros(len(y))
    b[-1] = 1.0
    t = _Bordered(J, r_omega, reference, scale).solve(b)
    return _slope(system, y, t / np.linalg.norm(t), scale)


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
        If the peak is not converged or lies at a corner, where it has no derivative.
    """
    options = options or PeakOptions()
    if not peak.converged:
        raise SettingError(f"sensitivities: expected a converged peak, found status '{peak.status}'")
    if peak.corner:
        raise SettingError("sensitivities: expected a smooth peak, found one at a corner of the response curve")
    out: dict[str, PeakSensitivity] = {}
    y, scale, t = peak.y, peak.scale, peak.tangent
    bordered: _Bordered | None = None
    h = options.difference
    for name, (family, value) in families.items():
        if bordered is None:
            system = family(value)
            _, J, r_omega = system.evaluate(y[:-1], y[-1])
            bordered = _Bordered(J, r_omega, t, scale)
            g, square = _gradient(system, y)
            adjoint = bordered.solve_transposed(g * scale / np.sqrt(square))[:-1]
            along = (_slope_at(system, y + h * t * scale, t, scale) - _slope_at(system, y - h * t * scale, t, scale)) / (
                2.0 * h
            )
        dp = h * (abs(value) if value != 0.0 else 1.0)
        low, high = family(value - dp), family(value + dp)
        r_p = (high.evaluate(y[:-1], y[-1])[0] - low.evaluate(y[:-1], y[-1])[0]) / (2.0 * dp)
        z_p = bordered.solve(np.append(-r_p, 0.0))
        direction = z_p * scale
        across = (
            _slope_at(high, y + dp * direction, t, scale) - _slope_at(low, y - dp * direction, t, scale)
        ) / (2.0 * dp)  # fmt: skip
        dy = (z_p - across / along * t) * scale
        # amplitude: explicit change of the response row (a parameter may scale the modes), then of the solution
        explicit = (_amplitude(high, y) - _amplitude(low, y)) / (2.0 * dp)
        out[name] = PeakSensitivity(
            name, value, explicit - float(adjoint @ r_p), float(dy[-1]) / (2.0 * np.pi), dy
        )  # fmt: skip
    return out


def _amplitude(system: HarmonicSystem, y: NDArray) -> float:
    return float(np.sqrt(_gradient(system, y)[1]))


# ---- continuation in a parameter ----


@dataclass(frozen=True)
class PeakBranch:
    """One peak followed over a parameter.

    Parameters
    ----------
    peaks : tuple of Peak
        At the values asked for, as far as the peak exists.
    ended : float
        Value up to which it was followed.
    status : str
        "complete", "vanished" or "left the interval".
    reason : str
    iterations : int
    trials : int
        Correctors in all.
    """

    peaks: tuple[Peak, ...]
    ended: float
    status: str
    reason: str
    iterations: int
    trials: int


class PeakFollower:
    """Follows one peak from value to value of a parameter.

    Parameters
    ----------
    family : callable
        The equations at a value of the parameter.
    start : Peak or sequence of Peak
        Converged, with ``parameter`` set; of several, the last is the start and the others serve the prediction.
    options : PeakOptions
    limits : (low, high), Hz
        Frequencies outside of which the peak is no longer wanted.
    """

    def __init__(
        self,
        family: Family,
        start: Peak | Sequence[Peak],
        options: PeakOptions | None = None,
        limits: tuple[float, float] = (0.0, np.inf),
    ) -> None:
        known = [start] if isinstance(start, Peak) else list(start)
        for peak in known:
            if not peak.converged:
                raise SettingError(f"peak to follow: expected a converged one, found status '{peak.status}'")
        self.family = family
        self.options = options or PeakOptions()
        self.limits = limits
        self.known: list[Peak] = known[-4:]
        self.iterations = 0
        self.trials = 0
        self.logarithmic = all(peak.parameter > 0.0 for peak in known)
        self.n_mean = 0
        self.first_slope: NDArray | None = None
        self.errors = np.array([1.0, 1.0, 1.0])
        self.reason = ""
        self.status = "complete"

    def _place(self, value: float) -> float:
        return float(np.log(value)) if self.logarithmic else value

    def _predictions(self, value: float) -> list[NDArray]:
        """Polynomials of first to third order through the latest peaks, as far as there are enough."""
        x = self._place(value)
        known = self.known[-4:]
        xs = [self._place(p.parameter) for p in known]
        if len(known) == 1:
            if self.first_slope is None:
                self.first_slope = self._start_slope(known[0])
            return [known[0].y + (x - xs[0]) * self.first_slope]
        out = []
        for order in range(1, len(known)):
            nodes, peaks = xs[-order - 1 :], known[-order - 1 :]
            y = np.zeros_like(known[0].y)
            for i, a in enumerate(nodes):
                weight = 1.0
                for j, b in enumerate(nodes):
                    if j != i:
                        weight *= (x - b) / (a - b)
                y += weight * peaks[i].y
            out.append(y)
        return out

    def _start_slope(self, peak: Peak) -> NDArray:
        """Derivative of the unknowns with respect to the place of the parameter."""
        if peak.corner:
            return np.zeros_like(peak.y)
        factor = peak.parameter if self.logarithmic else 1.0
        found = sensitivities(peak, {"parameter": (self.family, peak.parameter)}, self.options)["parameter"]
        return found.y * factor

    def _attempt(self, value: float, walk: bool) -> Peak | None:
        last = self.known[-1]
        predictions = self._predictions(value)
        order = int(np.argmin(self.errors[: len(predictions)]))
        guess = predictions[order]
        if not guess[-1] > 0.0:
            self.reason = "frequency not positive"
            return None
        system = self.family(value)
        self.n_mean = system.n_mean
        width = _width(last.y, last.tangent, last.scale, system.n_mean)
        scale = peak_scale(system, guess, width)
        tangent = last.tangent * last.scale / scale
        size = float(np.linalg.norm(tangent))
        curvature = last.curvature / size**2 if last.curvature < 0.0 else -1.0
        peak = find_peak(
            system, guess, tangent=tangent / size, scale=scale, curvature=curvature, options=self.options,
            parameter=value, walk=walk, reach=1.5 * self.options.max_distance,
        )  # fmt: skip
        self.iterations += peak.iterations
        self.trials += peak.trials
        if not peak.converged:
            self.reason = peak.status
            return None
        n = system.n_mean

        def distance(y: NDArray) -> float:
            return float(np.linalg.norm((peak.y - y)[n:-1] / scale[n:-1]))

        if distance(guess) > self.options.max_distance:
            self.reason = "a peak far from its prediction"
            return None
        if len(self.known) > 1:
            errors = [distance(p) for p in predictions]
            self.errors[: len(errors)] = errors
            self.errors[len(errors) :] = errors[-1]
        return peak

    def _remember(self, peak: Peak) -> None:
        last, n = self.known[-1], len(peak.y) - 1
        mean = (peak.y - last.y)[: self.n_mean]
        if len(self.known) > 1 and np.linalg.norm(mean) > 0.5 * np.linalg.norm(peak.y[self.n_mean : n]):
            # the mean has jumped: what was before says nothing of how it goes on
            before = [replace(p, y=np.concatenate([p.y[: self.n_mean] * 0.0 + peak.y[: self.n_mean], p.y[self.n_mean :]]))
                      for p in self.known]  # fmt: skip
            self.known = before
        self.known = [*self.known[-4:], peak]

    def go(self, value: float) -> Peak | None:
        """The peak at a value of the parameter, in smaller steps if need be; None if it does not get there."""
        step = 1.0  # of the whole way
        start, end = self._place(self.known[-1].parameter), self._place(value)
        if start == end:
            return self.known[-1]
        done, successes = 0.0, 1
        smallest = 0.5**self.options.max_halvings
        while done < 1.0:
            now = min(1.0, done + step)
            at = start + now * (end - start)
            peak = self._attempt(value if now == 1.0 else (float(np.exp(at)) if self.logarithmic else at), step <= 0.25)
            if peak is None:
                step *= 0.5
                successes = 0
                if step < smallest:
                    self.status = "vanished"
                    return None
                continue
            self._remember(peak)
            if not self.limits[0] <= peak.frequency <= self.limits[1]:
                self.status, self.reason = "left the interval", f"at {peak.frequency:.6g} Hz"
                return None
            done = now
            successes += 1
            if successes > 1:
                step *= 2.0
        return self.known[-1]


def follow_peak(
    family: Family,
    start: Peak,
    values: Sequence[float] | NDArray,
    *,
    options: PeakOptions | None = None,
    limits: tuple[float, float] = (0.0, np.inf),
) -> PeakBranch:
    """Follow a peak through values of a parameter, in the order given.

    Parameters
    ----------
    family : callable
        Gives the equations for a value of the parameter.
    start : Peak
        Converged, at ``start.parameter``.
    values : sequence of float
    options : PeakOptions
    limits : (low, high), Hz

    Returns
    -------
    PeakBranch
    """
    follower = PeakFollower(family, start, options, limits)
    peaks = []
    for value in values:
        peak = follower.go(float(value))
        if peak is None:
            break
        peaks.append(peak)
    return PeakBranch(
        tuple(peaks),
        follower.known[-1].parameter,
        follower.status,
        follower.reason if follower.status != "complete" else "",
        follower.iterations,
        follower.trials,
    )


# ---- least peak ----


@dataclass(frozen=True)
class Optimum:
    """The value of a parameter at which the peak is least.

    Parameters
    ----------
    parameter : float
    amplitude : float, m
    frequency : float, Hz
    kind : str
        "smooth" (zero derivative), "crossing" (two peaks equally high), "jump" (a higher peak vanishes here) or "end" (of
        the range).
    uncertainty : float
        Of the parameter, relative: the last bracket or step.
    peak : Peak
    status : str
    """

    parameter: float
    amplitude: float
    frequency: float
    kind: str
    uncertainty: float
    peak: Peak = field(repr=False)
    status: str = "converged"


def _log_slope(family: Family, peak: Peak, options: PeakOptions) -> float:
    """d ln(amplitude) / d ln(parameter)."""
    found = sensitivities(peak, {"parameter": (family, peak.parameter)}, options)["parameter"]
    return found.amplitude * peak.parameter / peak.amplitude


def least_peak(
    family: Family,
    start: Peak,
    bracket: tuple[float, float],
    *,
    tolerance: float = 1e-8,
    options: PeakOptions | None = None,
) -> Optimum:
    """The smooth minimum of one followed peak within a bracket: a root of its adjoint sensitivity.

    Parameters
    ----------
    family : callable
    start : Peak
        Of this branch, anywhere near the bracket.
    bracket : (low, high)
        Positive; the derivative is negative at the lower end and positive at the upper one.
    tolerance : float
        Relative, on the parameter.

    Returns
    -------
    Optimum
        ``kind`` is "end" if the derivative does not change sign.
    """
    options = options or PeakOptions()
    low, high = (float(b) for b in bracket)
    if not 0.0 < low < high:
        raise SettingError(f"bracket: expected 0 < low < high, found ({low}, {high})")

    nearest = {start.parameter: start}

    def at(value: float) -> tuple[Peak, float]:
        origin = min(nearest, key=lambda p: abs(np.log(p / value)))
        peak: Peak | None = nearest[origin]
        if origin != value:
            peak = PeakFollower(family, nearest[origin], options).go(value)
        if peak is None:
            raise ArithmeticError(f"the peak could not be followed to {value:.8g}")
        nearest[value] = peak
        return peak, _log_slope(family, peak, options)

    a, b = np.log(low), np.log(high)
    try:
        peak_a, f_a = at(low)
        peak_b, f_b = at(high)
        if f_a >= 0.0 or f_b <= 0.0:
            best = peak_a if f_a >= 0.0 else peak_b
            return Optimum(best.parameter, best.amplitude, best.frequency, "end", 0.0, best)
        x, side = a, 0
        for _ in range(60):
            last = x
            x = (a * f_b - b * f_a) / (f_b - f_a)
            if not a < x < b:
                x = 0.5 * (a + b)
            peak, f = at(float(np.exp(x)))
            if abs(x - last) <= tolerance or b - a <= tolerance or f == 0.0:
                break
            if f < 0.0:
                a, f_a = x, f
                f_b = 0.5 * f_b if side == -1 else f_b
                side = -1
            else:
                b, f_b = x, f
                f_a = 0.5 * f_a if side == 1 else f_a
                side = 1
        return Optimum(peak.parameter, peak.amplitude, peak.frequency, "smooth", min(abs(x - last), b - a), peak)
    except (ArithmeticError, SettingError) as error:
        best = min(nearest.values(), key=lambda p: p.amplitude)
        return Optimum(best.parameter, best.amplitude, best.frequency, "smooth", np.inf, best, str(error))
