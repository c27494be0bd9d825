"""A resonance peak as the solution of its own equations.

On a response curve ``r(y) = 0``, ``y = (u, omega)``, with unit tangent ``t``, the squared amplitude of the response has a
maximum where its slope

    phi = grad(|X_1|^2/2) . t / |X_1|^2

falls through zero.  With the adjoint ``J^T lambda = grad(|X_1|^2/2)`` this is ``lambda^T r_omega = 0`` times the frequency
component of ``t``; in terms of ``t`` the condition stays regular where the curve turns, and a resonance that leans over
has its maximum just there.

From a near guess, Newton's method to the curve with a secant along it converges to the peak
(:class:`~bdamper.harmonic_balance.equations.Peak`).  If it fails, :func:`find_peak` takes the steps of a path
uphill (:mod:`bdamper.response.continuation`) until ``phi`` changes its sign, and locates the maximum of that step as a
path does. At a corner of the curve ``phi`` may jump through zero: then the search ends at the corner.

Where a resonance lies: the interval around that of a mode, and linear resonances without contact and all of it stuck.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.static_state import PreloadState
from bdamper.harmonic_balance import equations
from bdamper.harmonic_balance.equations import NOT_CONVERGED, OK, STATUS_TEXT, Correction, Equations, norm2
from bdamper.harmonic_balance.problem import Problem, stuck_springs
from bdamper.harmonic_balance.sector import around
from bdamper.response.continuation import Follower
from bdamper.response.events import AtLeastTwo, ContinuationOptions, Step
from bdamper.response.optimal_curve_result import Limit
from bdamper.response.response_curve_result import NOT_IN_TIME
from bdamper.util import validation
from bdamper.util.display import Comparable, Fact, Plottable
from bdamper.util.errors import COMPLETE, INCOMPLETE, NOT_FOUND, status_word, with_reason
from bdamper.util.formatting import peak_text, preload_text, short_repr
from bdamper.util.progress import Cost
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import Cycles, Metre, Quantity, Shares, Tabular

# ---- A resonance peak as the solution of its own equations ----


JUMP = 1e3
"""Curvature of ln(amplitude) along the curve, in scaled unknowns, beyond which its slope is said to jump: a corner."""
DIFFERENCE = 1e-5
"""Relative step of the central differences in sensitivities."""
FAR = "a peak far from its prediction"
ANOTHER = "a solution on another part of the curve, by the sign of det J"
AT_END = "highest at an end of the interval, without a maximum in it"
"""Reason of a highest point that is no maximum."""
LOOSEST = ContinuationOptions().tolerance
"""Residual at most that counts as rounding, as along curves."""

BelowTen = Annotated[float, validation.Limits(above=0.0, below=10.0)]
Family = Callable[[float], Equations]
"""The equations as a function of one scalar parameter."""


@validation.check_arguments
@dataclass(frozen=True)
class PeakOptions(validation.Checked):
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
    """

    tolerance: BelowTen = 1e-10
    position_tolerance: BelowTen = 1e-8
    max_step: BelowTen = 0.4
    max_iterations: AtLeastTwo = 12
    max_trials: AtLeastTwo = 60


@short_repr
@dataclass(frozen=True)
class Peak(Plottable, Comparable, Tabular, Recorded, Storable, kind="bdamper-peak"):
    """A maximum of the response amplitude along a response curve, or the place where the search for it ended.

    Drawn by :func:`bdamper.plot.plot_peak`.

    Parameters
    ----------
    parameter : float
        Value at which the equations were taken; NaN if they depend on none.
    frequency : float, Hz
    amplitude : float, m
        Of the first harmonic of the response.
    y, tangent, scale : (n_unknowns + 1,) float
        The tangent of the response curve has unit length in unknowns divided by ``scale``.
    slope, curvature : float
        First and second derivative of ln(amplitude) along the curve in scaled unknowns.
    shares : (3,) float
        Stick, slip and open.
    residual : float
    iterations, trials, rank_deficiency : int
    corner : bool
        The curve has a corner at the peak: slopes on both sides differ in sign but do not vanish.
    status : str
        "complete"; "incomplete: ..." for the end of an interval that holds no maximum, or if ``search_status`` is
        incomplete; "not found: ..." with the reason.
    cost : Cost, optional
    search_status : str
        How the curve ended on which it is the highest peak, if there is one: unless "complete", there may be a higher one.
    settings : mapping
        Of the problem; none of a peak on equations that stand by themselves (:func:`find_peak`).
    model_hash : str
    """

    parameter: Annotated[float, Quantity("N", name="preload")]
    frequency: Cycles
    amplitude: Metre
    y: NDArray
    tangent: NDArray
    scale: NDArray
    slope: float
    curvature: float
    shares: Shares
    residual: float
    iterations: int
    trials: int
    rank_deficiency: int
    corner: bool = False
    status: str = COMPLETE
    cost: Cost | None = None
    search_status: str = ""
    _summary_fields = ("parameter", "amplitude", "frequency", "shares", "search_status")

    @property
    def converged(self) -> bool:
        """Whether this is a maximum that solves the equations, even if an incomplete curve may have a higher one."""
        return self.status == COMPLETE or (status_word(self.status) == INCOMPLETE and AT_END not in self.status)

    def _facts(self) -> tuple[Fact, ...]:
        """The peak and how far it is to be trusted; nothing but the reason where none was found."""
        return super()._facts() if self.converged else (Fact("peak", self.status),)

    def _headline(self) -> str:
        if not self.converged:
            top = f" The highest response is {peak_text(self.amplitude, self.frequency)}."
            return f"No peak: {self.status}.{top if status_word(self.status) == INCOMPLETE else ''}"
        load = f" under {preload_text(self.parameter, self.settings)}" if np.isfinite(self.parameter) else ""
        open_ = (
            ""
            if self.search_status in ("", "complete")
            else f" There may be a higher one, the curve ended as: {self.search_status}."
        )
        return f"Resonance of {peak_text(self.amplitude, self.frequency)}{load}. {NOT_IN_TIME}{open_}"


def vibration_width(y: NDArray, tangent: NDArray, scale: NDArray, n_mean: int) -> float:
    """Change of frequency over which the vibration changes by its own size, within reason."""
    raw = tangent * scale
    change = max(norm2(raw[n_mean:-1]), 1e-300)
    width = abs(float(raw[-1])) * norm2(y[n_mean:-1]) / change
    return min(max(width, 1e-7 * float(y[-1])), 0.2 * float(y[-1]))


def amplitude_and_phase(system: Equations, u: NDArray) -> tuple[NDArray, NDArray, float]:
    """Gradients (n_unknowns,) of the amplitude and of amplitude times phase of the response, and the amplitude."""
    row = system.response_rows[1]
    x = system.layout.amplitudes(u, 1) @ row
    amplitude = float(abs(x))
    grow, turn = system.layout.parts(np.conj(x) * row / max(amplitude, 1e-300))
    return grow, turn, amplitude


def amplitude_at(system: Equations, y: NDArray) -> float:
    """Amplitude (m) of the first harmonic of the response."""
    return float(abs(system.rows.value(y)))


def slope_along(system: Equations, y: NDArray, tangent: NDArray, scale: NDArray) -> float:
    """Derivative of ln(amplitude) along a direction in scaled unknowns."""
    gradient, square = system.rows.squared_gradient(y)
    return float(gradient @ (tangent * scale)) / max(square, 1e-300)


class _Search:
    """The search for the maximum along one response curve, in units that it finds if it is given none."""

    def __init__(self, system: Equations, scale: NDArray, options: PeakOptions, reach: float) -> None:
        self.system = system
        self.scale = scale
        self.options = options
        self.reach = reach
        self.iterations = 0
        self.trials = 0
        self.reason = ""

    def solve(self, y: NDArray, condition: equations.Condition, tolerance: float = 0.0) -> Correction | None:
        """Newton's method, to the tolerance of the options or a larger one."""
        self.trials += 1
        options = self.options
        c = self.system.solve(y, condition, self.scale, max(options.tolerance, tolerance), options.max_iterations)
        self.iterations += c.iterations
        self.reason = STATUS_TEXT[c.status]
        return c if c.status == OK else None

    def vibration(self, difference: NDArray) -> float:
        """Size of a difference of two points without their mean positions, in scaled unknowns."""
        n = self.system.n_mean
        return norm2(difference[n:] / self.scale[n:])

    def newton(self, y: NDArray, tangent: NDArray, curvature: float) -> Correction | None:
        """The peak by Newton's method, which converges if the guess is near enough."""
        options = self.options
        peak = equations.Peak(tangent, curvature, options.position_tolerance, 0.5 * options.max_step)
        c = self.solve(y, peak)
        if c is None:
            return None
        moved = self.vibration(c.y - y)
        if moved > min(self.reach, options.max_step):
            self.reason = FAR
            return None
        # way to a peak, relative to the vibration, on which secants do not tell its curvature: off by 0.3**3 on the
        # reference disk from a guess that was 1e-7 away
        short = 1e-3
        if moved > short or c.curvature < -JUMP:
            return c
        row, _ = self.system.slope_gradient(c.y, c.tangent, self.scale, DIFFERENCE)
        c = replace(c, curvature=float(row @ c.tangent))
        if not c.curvature < 0.0:
            return None
        slope = slope_along(self.system, c.y, c.tangent, self.scale)
        near = abs(slope / c.curvature) <= options.position_tolerance
        return c if near else self.solve(c.y, replace(peak, tangent=c.tangent, curvature=c.curvature))

    def first(self, y: NDArray, tangent: NDArray | None) -> Correction | None:
        """The curve near a guess."""
        nearby = 1e-6  # residual with which a first point of the curve will do
        return self.solve(y, equations.Fixed() if tangent is None else equations.Plane(tangent), nearby)

    def in_own_units(self, c: Correction) -> Correction:
        """The same point with the unit of frequency that follows from the direction of the curve there."""
        raw = c.tangent * self.scale
        self.scale = self.system.units(c.y, vibration_width(c.y, c.tangent, self.scale, self.system.n_mean))
        t = raw / self.scale
        return replace(c, tangent=t / norm2(t), scale=self.scale)

    def uphill(self, start: Correction) -> Correction | None:
        """The first maximum along the curve uphill: steps of a path until the slope turns, and the maximum of that step."""
        options = self.options
        sense = float(np.copysign(1.0, slope_along(self.system, start.y, start.tangent, self.scale)))
        follower = Follower(
            self.system, (0.0, np.inf), ContinuationOptions(tolerance=options.tolerance, max_step=options.max_step)
        )
        follower.sign = int(sense) * start.orientation
        here, step = replace(start, tangent=sense * start.tangent), follower.options.step
        while self.trials < options.max_trials:
            self.trials += 1
            new, step, end, refused = follower.advance(here, step)
            if new is None:
                self.reason = refused
                return None
            self.iterations += new.iterations
            if self.vibration(new.y - start.y) > self.reach:
                self.reason = FAR
                return None
            if slope_along(self.system, new.y, new.tangent, self.scale) <= 0.0:
                top = follower.events.locate(Step(here, new, end), "maximum", options.position_tolerance)
                self.iterations += follower.events.iterations
                self.reason = "the maximum of a step could not be located"
                return top
            turn = float(np.arccos(np.clip(new.tangent @ here.tangent, -1.0, 1.0)))
            step = follower.longer(step, turn, new.iterations)
            here = new
        self.reason = f"not found within {options.max_trials} correctors"
        return None


def rounding(system: Equations, y: NDArray) -> float:
    """Residual, relative as tolerances are, that rounding of its terms can leave at a point."""
    J = system.evaluate(y[:-1], y[-1])[1]
    return float(np.finfo(float).eps * (np.abs(J) @ np.abs(y[:-1]) * system.row_scale).max())


def find_peak(
    system: Equations,
    guess: NDArray,
    *,
    tangent: NDArray | None = None,
    scale: NDArray | None = None,
    curvature: float = -1.0,
    options: PeakOptions | None = None,
    parameter: float = np.nan,
    reach: float = np.inf,
) -> Peak:
    """The maximum of the response amplitude that the curve reaches uphill from a point near it.

    Parameters
    ----------
    system : Equations
    guess : (n_unknowns + 1,) float
        Unknowns and frequency (rad/s) near the response curve.
    tangent : (n_unknowns + 1,) float, optional
        Estimate of the direction of the curve in scaled unknowns; the first corrector works in the plane normal to it, or
        at fixed frequency without it.
    scale : (n_unknowns + 1,) float, optional
        Units of the unknowns (``Equations.units``); found from the curve by default.
    curvature : float
        Estimate of the second derivative of ln(amplitude) along the curve in scaled unknowns.
    options : PeakOptions
    parameter : float
        Noted in the result.
    reach : float
        Largest distance along the curve, relative to the vibration.

    Returns
    -------
    Peak
        ``status`` is "complete", or says why there is none.
    """
    options = options or PeakOptions()
    guess = np.asarray(guess, float)
    search = _Search(system, system.units(guess, 0.01 * guess[-1]) if scale is None else scale, options, reach)
    top = start = None
    if tangent is not None and scale is not None and curvature < 0.0:
        top = search.newton(guess, tangent, curvature)
    # curvature of ln(amplitude) along the curve to begin with: about that of any resonance in its own units
    curved = -1.0
    if top is None:
        start = search.first(guess, tangent)
        if start is not None:
            start = search.in_own_units(start) if scale is None else start
            top = search.newton(start.y, start.tangent, min(curvature, curved)) or search.uphill(start)
        else:
            search.reason = f"no solution near the guess: {search.reason}"
    exact = top is None and start is not None and options.tolerance < LOOSEST
    if exact and start is not None and options.tolerance < (floor := min(rounding(system, start.y), LOOSEST)):
        return find_peak(
            system, guess, tangent=tangent, scale=scale, curvature=curvature, options=replace(options, tolerance=floor),
            parameter=parameter, reach=reach,
        )  # fmt: skip
    at = top or start or Correction(NOT_CONVERGED, guess, np.zeros(len(guess)), search.scale, 0, np.nan, 0)
    return Peak(
        parameter, float(at.y[-1] / (2.0 * np.pi)), amplitude_at(system, at.y), at.y, at.tangent, search.scale, at.slope,
        at.curvature, np.array(at.shares), at.residual, search.iterations, search.trials, at.rank_deficiency,
        top is not None and at.curvature < -JUMP, with_reason(NOT_FOUND, search.reason) if top is None else COMPLETE,
    )  # fmt: skip


def sign_of_jacobian(system: Equations, y: NDArray) -> int:
    """Sign of det J at a solution, which changes at every fold; 0 where it is not known."""
    return system.correct_at(y[:-1], float(y[-1]), system.units(y, y[-1]), LOOSEST, 2).orientation


def peak_of_sign(
    system: Equations, guess: NDArray, sign: int, *, options: PeakOptions, parameter: float = np.nan
) -> tuple[Peak | str, int]:
    """The peak to which Newton's method leads from a far guess, first at its frequency, or why it does not.

    Parameters
    ----------
    system, guess, options, parameter
        As for :func:`find_peak`.
    sign : int
        Of det J, at the solution at the frequency of the guess and at the peak.

    Returns
    -------
    Peak or str, and iterations
    """
    iterations = 0
    # of Newton's method with line search from a far guess: with more harmonics the turbine blade takes up to 37, the
    # bladed disk at 250 N is lost with 20
    most_iterations = 40
    for search in (2, 1):
        scale = system.units(guess, guess[-1])
        c = system.correct_at(guess[:-1], float(guess[-1]), scale, options.tolerance, most_iterations, search)
        iterations += c.iterations
        if c.status == OK and c.orientation == sign:
            peak = find_peak(system, c.y, options=options, parameter=parameter)
            iterations += peak.iterations
            if not peak.converged:
                return peak.status, iterations
            return (peak if sign_of_jacobian(system, peak.y) == sign else ANOTHER), iterations
    return (ANOTHER if c.status == OK else STATUS_TEXT[c.status]), iterations


def coarse_options() -> ContinuationOptions:
    """Settings with which a curve is followed only to learn which peaks it has.

    With its longer steps and wider turns, 0.5 and 0.6 in place of 0.15 and 0.45, it takes 2 to 32 % fewer evaluations, and
    has the same highest points to 1e-6 at 40 preloads of five studies; turns of 0.8 take up to 40 % more among many folds.
    """
    return ContinuationOptions(tolerance=1e-7, step=0.1, max_step=0.5, max_turn=0.6, locate_tolerance=0.05)


def same_peak(a: Peak, b: Peak) -> bool:
    """Whether two peaks of the same equations agree in frequency and amplitude."""
    return np.allclose((a.frequency, a.amplitude), (b.frequency, b.amplitude), rtol=1e-5, atol=0.0)


# ---- Where a resonance lies ----


def free_and_stuck(problem: Problem, state: PreloadState, modes: int) -> tuple[NDArray, NDArray]:
    """(modes,) resonances (Hz) of the constrained bodies without contact, and with all that are closed at rest stuck.

    A mode has the lowest stuck resonance above its own that no mode below it has.

    Raises
    ------
    SettingError
        If there are not so many modes.
    """
    sector = problem.sector(0.0)
    basis = sector.bases[1]
    modes_alone = np.array([c.is_mode for c in basis.coordinates], bool)
    elastic = np.sort(basis.omega2[(basis.omega2 > 0.0) & (basis.mass == 1.0) & modes_alone])
    if np.any(sector.springs):
        elastic = sector.linear.modes(None)[0] ** 2
    validation.check(1 <= modes <= len(elastic), "mode", f"1 to {len(elastic)}", modes)
    free = np.sqrt(elastic[:modes])
    poles = list(sector.linear.modes(stuck_springs(problem, state, touching=True))[0])
    stuck = []
    for w in free:
        poles = [p for p in poles if p >= w * (1.0 - 1e-9)]
        stuck.append(poles.pop(0) if poles else w)
    return free / (2.0 * np.pi), np.array(stuck) / (2.0 * np.pi)


def resonance_interval(problem: Problem, preload: float, mode: int = 1) -> tuple[float, float]:
    """Frequency interval (Hz) that spans the free and the stuck resonance of one mode of the constrained bodies.

    Parameters
    ----------
    problem : Problem
    preload : float, N
        Decides which points are closed.
    mode : int
        1 for the lowest.

    Raises
    ------
    SettingError
        If there is no such mode.
    StaticError
        If there is no static state at the preload.
    """
    free, stuck = (float(f[-1]) for f in free_and_stuck(problem, problem.equilibrium(preload), mode))
    margin = beyond(free, stuck)
    return max(0.1 * free, free - margin), stuck + margin


def beyond(free: float, stuck: float) -> float:
    """How far an interval goes beyond the free and the stuck resonance between which that of a mode lies."""
    return 0.1 * free + 0.3 * (stuck - free)


def linear_peak(problem: Problem, frequency: tuple[float, float], preload: float, *, stuck: bool) -> Limit:
    """The highest resonance of the free or of the stuck structure in an interval (Hz), NaN if there is none.

    NaN too for the stuck one at a preload without a static state.
    """
    if stuck and not problem.static(preload).converged:
        return Limit(np.nan, np.nan)
    sector = problem.sector(preload if stuck else 0.0)
    springs = stuck_springs(problem, problem.static(preload), touching=True) if stuck else None
    low, high = (2.0 * np.pi * f for f in frequency)
    poles = sector.linear.resonances((springs,), *around(low, high))
    tops = [sector.linear.maximum(sector.response_rows[1], springs, w, width) for w, width, _ in poles]
    within = [top for top in tops if low <= top[0] <= high]
    omega, amplitude = max(within, key=lambda top: top[1], default=(np.nan, np.nan))
    return Limit(omega / (2.0 * np.pi), amplitude)


def peak_interval(
    problem: Problem, frequency: tuple[float, float] | None, preload: float, mode: int = 1
) -> tuple[float, float]:
    """Return the given interval (Hz), or the one around the resonances of a mode at a preload (N)."""
    mode = validation.integer("mode", mode, least=1)
    if frequency is None:
        return resonance_interval(problem, preload, mode)
    return validation.interval("frequency", frequency)
