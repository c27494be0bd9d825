"""A resonance peak as the solution of its own equations.

On a response curve ``r(y) = 0``, ``y = (u, omega)``, with unit tangent ``t``, the squared amplitude of the response has a
maximum where its slope

    phi = grad(|X_1|^2/2) . t / |X_1|^2

falls through zero.  With the adjoint ``J^T lambda = grad(|X_1|^2/2)`` this is ``lambda^T r_omega = 0`` times the frequency
component of ``t``; in terms of ``t`` the condition stays regular where the curve turns, and a resonance that leans over
has its maximum just there.

From a near guess, Newton's method to the curve with a secant along it converges to the peak
(:class:`~bdamper.harmonic_balance.conditions.Peak`).  If it fails, :func:`find_peak` follows the curve uphill until ``phi``
changes its sign, and searches for the root of ``phi`` in between, one bordered Newton corrector for each trial.  At a
corner of the curve ``phi`` may jump through zero: then the search ends at the corner.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.path import ContinuationOptions, PathPoint
from bdamper.harmonic_balance import conditions
from bdamper.harmonic_balance.system import OK, STATUS_TEXT, HarmonicSystem, norm2
from bdamper.util import validate
from bdamper.util.cost import Cost
from bdamper.util.differences import Comparable
from bdamper.util.ladder import Ladder
from bdamper.util.plotting import Fact
from bdamper.util.repr import brief
from bdamper.util.rootfind import find_root
from bdamper.util.status import COMPLETE, NOT_FOUND, because

JUMP = 1e3
"""Curvature of ln(amplitude) along the curve, in scaled unknowns, beyond which its slope is said to jump: a corner."""
FAR = "a peak far from its prediction"
LOOSEST = ContinuationOptions().tolerance
"""Residual at most that counts as rounding, as along curves."""

Family = Callable[[float], HarmonicSystem]
"""The equations as a function of one scalar parameter."""


@dataclass(frozen=True)
class PeakOptions:
    """Settings of the search for a peak and of its continuation.

    Parameters
    ----------
    tolerance : float
        On the residual, relative to excitation and static load; where rounding keeps the residual above it, as stiff bonded
        faces do, that of :func:`rounding` up to 1e-9.
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
class Peak(Comparable):
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
        "complete", or "not found: " with what went wrong; such a peak is never used as a solution.
    cost : Cost, optional
        Of all that it took to find it, where that was metered.
    scan : str
        How the response curve ended on which it is the highest peak, where one was followed: unless "complete", there may
        be a higher one.
    settings : mapping
        Of the problem; none of a peak on equations that stand by themselves (:func:`find_peak`).
    model_hash : str
    ladder : Ladder, optional
        What more harmonics change, where a tolerance was given.
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
    status: str = COMPLETE
    cost: Cost | None = None
    scan: str = ""
    settings: dict[str, Any] = field(default_factory=dict, repr=False)
    model_hash: str = ""
    ladder: Ladder | None = None

    @property
    def converged(self) -> bool:
        return self.status == COMPLETE

    def facts(self) -> tuple[Fact, ...]:
        """The peak and how far it is to be trusted; nothing but the reason where none was found."""
        if not self.converged:
            return (Fact("peak", self.status),)
        shares = [(name, 100.0 * float(x)) for name, x in zip(("stick", "slip", "open"), self.shares)]
        return (
            *([Fact("preload", self.parameter, "N")] if np.isfinite(self.parameter) else []),
            Fact("peak amplitude", self.amplitude, "m"),
            Fact("at the frequency", self.frequency, "Hz"),
            *(Fact(f"{name} there", round(x, 1), "%") for name, x in shares if np.isfinite(x)),
            *([Fact("curve ended as", self.scan)] if self.scan not in ("", "complete") else []),
            *([] if self.ladder is None else [Fact("harmonics", self.ladder.note)]),
        )

    def __str__(self) -> str:
        if not self.converged:
            return f"peak {self.status}"
        return (
            f"peak {self.amplitude:.8g} m at {self.frequency:.8g} Hz{' (corner)' if self.corner else ''}, residual "
            f"{self.residual:.1e}, {self.trials} correctors, {self.iterations} iterations"
            + ("" if self.scan in ("", "complete") else f"\n  there may be a higher one, the curve ended as: {self.scan}")
            + ("" if self.ladder is None else f"\n  {self.ladder.note}")
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


def drifted(system: HarmonicSystem, y: NDArray, scale: NDArray) -> list[NDArray]:
    """Guesses that differ from a point in the mean position along the direction in which the contact is softest.

    Where every point slips or opens within the cycle in some direction, no contact force holds the mean position in this
    direction: a body drifts until a plane stops it, and back when friction holds it again.  The mean position then jumps
    with the preload while the vibration does not.  The guesses are: no displacement in this direction, and displacement
    to either side until the first open point touches.  Of 230 preloads on 24 optimal curves one has a peak that is found
    by these guesses alone.
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
    closing, rate = system.at(y[-1]).closing(y[:-1], v)
    touching = (closing < 0.0) & (np.abs(rate) > 1e-9 * max(float(np.abs(rate).max()), 1e-300))
    to_touch = -closing[touching] / rate[touching]
    ahead, behind = to_touch[to_touch > 0.0], to_touch[to_touch < 0.0]
    out = []
    nearest = [1.001 * float(side[np.abs(side).argmin()]) for side in (ahead, behind) if len(side)]
    for distance in (-float(v @ y[:n]), *nearest):
        moved = y.copy()
        moved[:n] += distance * v
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
    return system.squared_gradient(y)


def amplitude_and_phase(system: HarmonicSystem, u: NDArray) -> tuple[NDArray, NDArray, float]:
    """Gradients (n_unknowns,) of the amplitude and of amplitude times phase of the response, and the amplitude."""
    row = system.response_rows[1]
    x = system.amplitudes(u, 1) @ row
    amplitude = float(abs(x))
    z = np.conj(x) * row / max(amplitude, 1e-300)
    c, s = system.slices(1)
    grow, turn = np.zeros(len(u)), np.zeros(len(u))
    grow[c], grow[s] = z.real, z.imag
    turn[c], turn[s] = z.imag, -z.real
    return grow, turn, amplitude


def amplitude_at(system: HarmonicSystem, y: NDArray) -> float:
    """Amplitude (m) of the first harmonic of the response."""
    return float(abs(system.first_harmonic(y)))


def slope_along(system: HarmonicSystem, y: NDArray, tangent: NDArray, scale: NDArray) -> float:
    """Derivative of ln(amplitude) along a direction in scaled unknowns."""
    gradient, square = squared_gradient(system, y)
    return float(gradient @ (tangent * scale)) / max(square, 1e-300)


class _Search:
    """The search for the maximum along one response curve."""

    def __init__(self, system: HarmonicSystem, scale: NDArray, options: PeakOptions, reach: float) -> None:
        self.reach = reach
        self.system = system
        self.scale = scale
        self.options = options
        self.iterations = 0
        self.trials = 0
        self.reason = ""

    def correct(self, y: NDArray, normal: NDArray, loose: float = 0.0) -> _OnCurve | None:
        """The point of the curve in the plane through y, with a residual up to ``loose`` if that exceeds the tolerance."""
        self.trials += 1
        tolerance = max(self.options.tolerance, loose)
        c = self.system.correct(y, normal, self.scale, tolerance, self.options.max_iterations)
        self.iterations += c.iterations
        if c.status != OK:
            self.reason = STATUS_TEXT[c.status]
            return None
        slope = slope_along(self.system, c.y, c.tangent, self.scale)
        return _OnCurve(c.y, c.tangent, slope, c.residual, np.array(c.shares), c.rank_deficiency)

    def first(self, y: NDArray, normal: NDArray, drift: bool) -> _OnCurve | None:
        """The curve near a guess; if Newton fails there, also with the mean position moved to where it may be held."""
        found = self.correct(y, normal, 1e-6)
        if found is not None or not drift:
            return found
        for moved in drifted(self.system, y, self.scale):
            found = self.correct(moved, normal, 1e-6)
            if found is not None and self.vibration(found.y - moved) < 0.5:
                return found
        return None

    def vibration(self, difference: NDArray) -> float:
        """Size of a difference of two points without their mean positions, in scaled unknowns."""
        n = self.system.n_mean
        return norm2(difference[n:] / self.scale[n:])

    def in_own_units(self, point: _OnCurve) -> _OnCurve:
        """The same point with the unit of frequency that follows from the direction of the curve there."""
        raw = point.tangent * self.scale
        width = vibration_width(point.y, point.tangent, self.scale, self.system.n_mean)
        self.scale = peak_scale(self.system, point.y, width)
        t = raw / self.scale
        t /= norm2(t)
        return replace(point, tangent=t, slope=slope_along(self.system, point.y, t, self.scale))

    def step(self, a: _OnCurve, s: float) -> _OnCurve | None:
        """A point at a distance along the curve, which is halved while the corrector fails or ends far from its prediction.

        The residual is reduced only as far as a trial at this distance needs.
        """
        for _ in range(6):
            predicted = a.y + s * a.tangent * self.scale
            b = self.correct(predicted, a.tangent, min(1e-6, 1e-4 * abs(s)) if abs(s) > 3e-4 else 0.0)
            if b is not None:
                if norm2((b.y - predicted) / self.scale) <= max(0.5 * abs(s), 1e-6):
                    return b
                self.reason = "solution far from its prediction"
            s *= 0.5
        return None

    def run(self, start: _OnCurve, curvature: float) -> tuple[_OnCurve, float, bool]:
        """Root of the slope that is reached uphill: the point, the derivative of the slope, and success."""
        options, here = self.options, start
        while self.trials < options.max_trials:
            if here.slope == 0.0 or (curvature < 0.0 and abs(here.slope / curvature) <= options.position_tolerance):
                return self.exact(here, curvature)
            step = -here.slope / curvature if curvature < 0.0 else np.copysign(options.max_step, here.slope)
            new = self.step(here, float(np.clip(step, -options.max_step, options.max_step)))
            if new is None:
                return here, curvature, False
            if self.vibration(new.y - start.y) > self.reach:
                self.reason = FAR
                return new, curvature, False
            if new.slope * here.slope < 0.0:
                return self.between(*((here, new) if here.slope > 0.0 else (new, here)))
            moved = float(new.tangent @ ((new.y - here.y) / self.scale))
            if moved != 0.0 and new.slope != here.slope:
                curvature = (new.slope - here.slope) / moved
            here = new
        self.reason = f"not found within {options.max_trials} correctors"
        return here, curvature, False

    def between(self, rising: _OnCurve, falling: _OnCurve) -> tuple[_OnCurve, float, bool]:
        """Root of the slope between a point before the maximum and one behind it.

        Trials lie in planes normal to the chord, predicted by the cubic through both ends with their tangents.
        """
        a, b = rising, falling
        chord = (b.y - a.y) / self.scale
        length = norm2(chord)
        normal = chord / length
        points: list[_OnCurve] = [a, b]

        def slope(f: float) -> float:
            y = (
                (1.0 + 2.0 * f) * (1.0 - f) ** 2 * a.y
                + f**2 * (3.0 - 2.0 * f) * b.y
                + length * self.scale * (f * (1.0 - f) ** 2 * a.tangent - f**2 * (1.0 - f) * b.tangent)
            )
            y += (f - float(normal @ ((y - a.y) / self.scale)) / length) * (b.y - a.y)
            c = self.correct(y, normal)
            if c is None:
                raise ArithmeticError
            points.append(c)
            return c.slope

        left = max(self.options.max_trials - self.trials, 1)
        try:
            root = find_root(slope, (0.0, a.slope), (1.0, b.slope), self.options.position_tolerance / length, left)
        except ArithmeticError:
            return points[-1], np.nan, False
        here = points[-1]
        # the curvature is that between the last point and the nearest one on the other side of the maximum
        other = min((p for p in points if p.slope * here.slope < 0.0), key=lambda p: norm2((p.y - here.y) / self.scale),
                    default=a)  # fmt: skip
        apart = float(here.tangent @ ((here.y - other.y) / self.scale))
        curvature = (here.slope - other.slope) / apart if apart != 0.0 else np.nan
        found = root.step * length <= self.options.position_tolerance
        self.reason = "" if found else f"not found within {self.options.max_trials} correctors"
        return (*self.exact(here, curvature)[:2], found)

    def exact(self, point: _OnCurve, curvature: float) -> tuple[_OnCurve, float, bool]:
        """The same point with a residual within the tolerance."""
        if point.residual <= self.options.tolerance:
            return point, curvature, True
        found = self.correct(point.y, point.tangent)
        return (point, curvature, False) if found is None else (found, curvature, True)


def rounding(system: HarmonicSystem, y: NDArray) -> float:
    """Residual, relative as tolerances are, that rounding of its terms can leave at a point."""
    J = system.evaluate(y[:-1], y[-1])[1]
    return float(np.finfo(float).eps * (np.abs(J) @ np.abs(y[:-1]) * system.row_scale).max())


def find_peak(
    system: HarmonicSystem,
    guess: NDArray,
    *,
    tangent: NDArray | None = None,
    scale: NDArray | None = None,
    curvature: float = -1.0,
    options: PeakOptions | None = None,
    parameter: float = np.nan,
    drift: bool = True,
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
        Estimate of the direction of the curve in scaled unknowns; the first corrector works in the plane normal to it, or
        at fixed frequency without it.
    scale : (n_unknowns + 1,) float, optional
        Units of the unknowns (:func:`peak_scale`); found from the curve by default.
    curvature : float
        Estimate of the second derivative of ln(amplitude) along the curve in scaled unknowns.
    options : PeakOptions
    parameter : float
        Noted in the result.
    drift : bool
        If Newton fails at the guess, try also the mean positions of :func:`drifted`.
    reach : float
        Largest distance along the curve, relative to the vibration.
    thorough : bool
        Search along the curve if Newton's method to the peak fails.

    Returns
    -------
    Peak
        ``status`` is "complete", or says why there is none.
    """
    options = options or PeakOptions()
    guess = np.asarray(guess, float)
    asked: dict[str, Any] = {"tangent": tangent, "scale": scale, "curvature": curvature, "drift": drift, "reach": reach}
    if tangent is not None and scale is not None and curvature < 0.0:
        quick = _newton_to_peak(system, guess, tangent, scale, curvature, options, parameter, reach)
        if quick.converged or not thorough:
            return quick
    if tangent is None:
        tangent = np.zeros(len(guess))
        tangent[-1] = 1.0
    search = _Search(system, peak_scale(system, guess, 0.01 * guess[-1]) if scale is None else scale, options, reach)
    start = search.first(guess, tangent, drift)
    if start is None:
        return Peak(
            parameter, guess[-1] / (2 * np.pi), amplitude_at(system, guess), guess, tangent, search.scale, np.nan, np.nan,
            np.full(3, np.nan), np.nan, search.iterations, search.trials, 0, False,
            because(NOT_FOUND, f"no solution near the guess: {search.reason}"),
        )  # fmt: skip
    if scale is None:
        start = search.in_own_units(start)
    point, curvature, found = search.run(start, curvature)
    if not found and options.tolerance < (floor := min(rounding(system, point.y), LOOSEST)):
        options = replace(options, tolerance=floor)
        return find_peak(system, guess, options=options, parameter=parameter, **asked)
    return Peak(
        parameter, float(point.y[-1] / (2.0 * np.pi)), amplitude_at(system, point.y), point.y, point.tangent, search.scale,
        point.slope, curvature, point.shares, point.residual, search.iterations, search.trials, point.rank_deficiency,
        found and curvature < -JUMP, COMPLETE if found else because(NOT_FOUND, search.reason),
    )  # fmt: skip


def _newton_to_peak(
    system: HarmonicSystem,
    guess: NDArray,
    tangent: NDArray,
    scale: NDArray,
    curvature: float,
    options: PeakOptions,
    parameter: float,
    reach: float,
) -> Peak:
    """The peak by Newton's method, which converges if the guess is near enough."""
    peak = conditions.Peak(tangent, curvature, options.position_tolerance, 0.5 * options.max_step)
    c = system.solve(guess, peak, scale, options.tolerance, options.max_iterations)
    vibration = slice(system.n_mean, None)
    status = COMPLETE if c.status == OK else because(NOT_FOUND, STATUS_TEXT[c.status])
    if c.status == OK and norm2(((c.y - guess) / scale)[vibration]) > min(reach, options.max_step):
        status = because(NOT_FOUND, FAR)
    return Peak(
        parameter, float(c.y[-1] / (2.0 * np.pi)), amplitude_at(system, c.y), c.y, c.tangent, scale, c.slope, c.curvature,
        np.array(c.shares), c.residual, c.iterations, 1, c.rank_deficiency, False, status,
    )  # fmt: skip


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
