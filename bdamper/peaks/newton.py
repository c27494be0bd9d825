"""A resonance peak as the solution of its own equations.

On a response curve ``r(y) = 0``, ``y = (u, omega)``, with unit tangent ``t``, the squared amplitude of the response has a
maximum where its slope

    phi = grad(|X_1|^2/2) . t / |X_1|^2

falls through zero.  With the adjoint ``J^T lambda = grad(|X_1|^2/2)`` this is ``lambda^T r_omega = 0`` times the frequency
component of ``t``; in terms of ``t`` the condition stays regular where the curve turns, and a resonance that leans over
has its maximum just there.

From near by, Newton's method to the curve and a secant along it lead there at once (:meth:`HarmonicSystem.peak`).  Where
that fails :func:`find_peak` looks for the root of ``phi`` along the curve by a safeguarded secant, one bordered Newton
corrector for each trial.  Where the curve has a corner ``phi`` may jump through zero: then the bracket shrinks onto the
corner.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.system import OK, STATUS_TEXT, HarmonicSystem, norm2
from bdamper.continuation.follower import ContinuationOptions, PathPoint
from bdamper.util import validate
from bdamper.util.cost import Cost
from bdamper.util.repr import brief

JUMP = 1e3
"""Curvature of ln(amplitude) along the curve, in its own units, from which on the slope counts as jumping."""
HALVINGS = 6
"""Of a bracket on end, where the secant stalls."""

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
    max_trials: int = 60
    max_distance: float = 0.3
    max_halvings: int = 6
    difference: float = 1e-5

    def __post_init__(self) -> None:
        positive = ("tolerance", "position_tolerance", "max_step", "max_distance", "difference")
        validate.fields(self, validate.number, *positive, above=0.0, below=10.0)
        validate.fields(self, validate.whole, "max_iterations", "max_trials", least=2)
        validate.fields(self, validate.whole, "max_halvings")


@brief
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
    settings : mapping
        Of the problem and how its harmonics were chosen, where a tolerance chose them.
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
    settings: dict[str, Any] = field(default_factory=dict, repr=False)

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
            + (f"\n  {self.settings['chosen']['note']}" if "chosen" in self.settings else "")
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
    vibration = max(norm2(y[n:-1]), 1e-300)
    scale = np.empty(len(y))
    scale[:n] = max(norm2(y[:n]), vibration)
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
    v /= norm2(v)
    closing, rate = system.closing(y[:-1], v)
    touching = (closing < 0.0) & (np.abs(rate) > 1e-9 * max(float(np.abs(rate).max()), 1e-300))
    way = -closing[touching] / rate[touching]
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


def vibration_width(y: NDArray, tangent: NDArray, scale: NDArray, n_mean: int) -> float:
    """Change of frequency over which the vibration changes by its own size, within reason."""
    raw = tangent * scale
    change = max(norm2(raw[n_mean:-1]), 1e-300)
    width = abs(float(raw[-1])) * norm2(y[n_mean:-1]) / change
    return min(max(width, 1e-7 * float(y[-1])), 0.2 * float(y[-1]))


def squared_gradient(system: HarmonicSystem, y: NDArray) -> tuple[NDArray, float]:
    """Gradient of half the squared amplitude with respect to y, and the squared amplitude."""
    re, im = system.response_parts
    a, b = float(re @ y[:-1]), float(im @ y[:-1])
    return np.append(a * re + b * im, 0.0), a * a + b * b


def amplitude_at(system: HarmonicSystem, y: NDArray) -> float:
    """Amplitude of the first harmonic of the response."""
    re, im = system.response_parts
    return float(np.hypot(re @ y[:-1], im @ y[:-1]))


def slope_along(system: HarmonicSystem, y: NDArray, tangent: NDArray, scale: NDArray) -> float:
    re, im = system.response_parts
    direction = (tangent * scale)[:-1]
    a, b = float(re @ y[:-1]), float(im @ y[:-1])
    return (a * float(re @ direction) + b * float(im @ direction)) / max(a * a + b * b, 1e-300)


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
            c.y, c.tangent, slope_along(self.system, c.y, c.tangent, self.scale), c.residual, np.array(c.shares),
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
            if found is not None and norm2((found.y - moved)[vibration] / self.scale[vibration]) < 0.5:
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
                    if norm2((b.y - predicted) / self.scale) <= max(0.5 * abs(s), 1e-6):
                        return b
                    self.reason = "solution far from its prediction"
            s *= 0.5
        return None

    def between(self, a: _OnCurve, b: _OnCurve, fraction: float) -> _OnCurve | None:
        """A point between two points of the curve, predicted by a cubic through both with their tangents."""
        chord = (b.y - a.y) / self.scale
        length = norm2(chord)
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
            if c is not None and norm2((c.y - guess) / self.scale) <= length:
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
        lengths = [np.inf, np.inf, np.inf]  # of the bracket
        halvings = 0  # still to be done: where the slope jumps a secant does not shrink the bracket
        slopes = [start.slope, start.slope]  # of the last two trials
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
                if norm2((here.y - start.y)[self.system.n_mean :] / self.scale[self.system.n_mean :]) > self.reach:
                    self.reason = "a peak far from its prediction"
                    return here, curvature, False, False
            if here.slope == 0.0:
                return here, curvature, True, False
            # no maximum in sight: uphill
            step = -here.slope / curvature if curvature < 0.0 else options.max_step * float(np.sign(here.slope))
            if curvature < 0.0 and abs(step) <= options.position_tolerance:
                return here, curvature, True, curvature < -JUMP
            limit = options.max_step if before is None else min(options.max_step, max(8.0 * abs(moved), 0.02))
            step = float(np.clip(step, -limit, limit))
            new: _OnCurve | None
            if rising is not None and falling is not None:
                length = norm2((falling.y - rising.y) / self.scale)
                if length <= options.position_tolerance:
                    return here, curvature, True, True
                inside = abs(step) < length and (step > 0.0) == (here is rising)
                lengths = [*lengths[1:], length]
                if not halvings and length > 0.25 * lengths[0] and abs(here.slope) > 0.1 * abs(slopes[0]):
                    halvings = HALVINGS
                if halvings:
                    new = self.between(rising, falling, 0.5)
                    halvings -= 1
                elif inside:
                    new = self.step(here, step)
                else:
                    fraction = rising.slope / (rising.slope - falling.slope)
                    new = self.between(rising, falling, min(max(fraction, 0.05), 0.95))
            else:
                new = self.step(here, step)
            if new is None:
                return here, curvature, False, False
            slopes = [slopes[1], new.slope]
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
    thorough: bool = True,
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
    thorough : bool
        Look for the peak along the curve where Newton's method alone does not lead to it.

    Returns
    -------
    Peak
        ``status`` is "converged", or says why there is none.
    """
    options = options or PeakOptions()
    guess = np.asarray(guess, float)
    given = width is not None or scale is not None
    if tangent is not None and scale is not None and curvature < 0.0:
        quick = _near(system, guess, tangent, scale, curvature, options, parameter, reach)
        if quick.converged or not thorough:
            return quick
    if scale is None:
        scale = peak_scale(system, guess, width or 0.01 * guess[-1])
    if tangent is None:
        tangent = np.zeros(len(guess))
        tangent[-1] = 1.0
    search = _Search(system, scale, options, reach)
    start = search.first(guess, tangent, walk)
    if start is not None and not given:
        raw = start.tangent * scale
        width = vibration_width(start.y, start.tangent, scale, system.n_mean)
        search.scale = scale = peak_scale(system, start.y, width)
        t = raw / scale
        t /= norm2(t)
        start = replace(start, tangent=t, slope=slope_along(system, start.y, t, scale))
    if start is None:
        _, square = squared_gradient(system, guess)
        return Peak(
            parameter, guess[-1] / (2 * np.pi), np.sqrt(square), guess, tangent, scale, np.nan, np.nan, np.full(3, np.nan),
            np.nan, search.iterations, search.trials, 0, False, f"no solution near the guess: {search.reason}",
        )  # fmt: skip
    point, curvature, found, corner = search.run(start, curvature)
    _, square = squared_gradient(system, point.y)
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


def _near(
    system: HarmonicSystem,
    guess: NDArray,
    tangent: NDArray,
    scale: NDArray,
    curvature: float,
    options: PeakOptions,
    parameter: float,
    reach: float,
) -> Peak:
    """The peak by Newton's method, where the guess is near enough for that."""
    c, slope, curvature = system.peak(
        guess, tangent, scale, curvature, options.tolerance, options.position_tolerance, options.max_iterations,
        0.5 * options.max_step,
    )  # fmt: skip
    vibration = slice(system.n_mean, None)
    status = STATUS_TEXT[c.status]
    if c.status == OK and norm2(((c.y - guess) / scale)[vibration]) > min(reach, options.max_step):
        status = "a peak far from its prediction"
    return Peak(
        parameter, float(c.y[-1] / (2.0 * np.pi)), amplitude_at(system, c.y), c.y, c.tangent, scale, slope, curvature,
        np.array(c.shares), c.residual, c.iterations, 1, c.rank_deficiency, False, status,
    )  # fmt: skip


def coarse_options(tolerance: float = 1e-7) -> ContinuationOptions:
    """Settings with which a curve is followed only to learn which peaks it has."""
    return ContinuationOptions(tolerance=tolerance, step=0.1, locate_tolerance=0.05, searches=4)


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
        width = vibration_width(point.y, point.tangent, point.scale, system.n_mean)
        scale = peak_scale(system, point.y, width)
        tangent = point.tangent * point.scale / scale
        tangent /= norm2(tangent)
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
