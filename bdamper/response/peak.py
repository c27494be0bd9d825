"""Resonance peak as the solution of its equations.

On a response curve ``r(y) = 0``, ``y = (u, omega)``, with unit tangent ``t``, the squared amplitude
of the response has a maximum where its slope

    phi = grad(|X_1|^2/2) . t / |X_1|^2

changes from positive to negative.  With the adjoint ``J^T lambda = grad(|X_1|^2/2)`` the slope is
``-lambda^T r_omega`` times the frequency component of ``t``.  In terms of ``t`` the condition
remains regular at folds.

From a close guess Newton's method on the curve, with a secant along it, converges to the peak
(:class:`~bdamper.harmonic_balance.equations.Maximum`).  If it fails, :func:`find_peak` follows the
curve uphill (:mod:`bdamper.response.continuation`) until ``phi`` changes sign, and locates the
maximum within this step.  At a corner of the curve ``phi`` may jump through zero; the search then
ends at the corner.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance import equations
from bdamper.harmonic_balance.checks import check_result, check_solution
from bdamper.harmonic_balance.equations import (
    NOT_CONVERGED,
    OK,
    STATUS_TEXT,
    Correction,
    Equations,
    norm2,
)
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.subject import about, not_covered
from bdamper.response.branches import UNBOUNDED
from bdamper.response.continuation import Follower
from bdamper.response.events import AtLeastTwo, ContinuationOptions, Step
from bdamper.response.expected_time import expected_text, seconds_in_time, seconds_of_evaluation
from bdamper.response.motion_range import exceeds
from bdamper.response.peak_error import (
    HarmonicPeak,
    SourceError,
    amplitude_error,
    changes_by_source,
    error_rows,
    error_text,
)
from bdamper.util import validation
from bdamper.util.display import Fact, InContact, Result
from bdamper.util.errors import COMPLETE, NOT_FOUND, with_reason
from bdamper.util.formatting import amount, extent, peak_text, sentence, short_repr
from bdamper.util.progress import Cost
from bdamper.util.records import Data, Reason
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import Cycles, Metre, Quantity, Shares, Tabular

# ---- equations of a peak ----


JUMP = 1e3
"""Curvature of ln(amplitude) along the curve in scaled unknowns above which its slope counts as
discontinuous: a corner."""
DIFFERENCE = 1e-5
"""Relative step of the central differences in sensitivities."""
FAR = "a peak far from its prediction"
AT_END = "highest at an end of the interval"
"""Reason of a highest point that is no maximum."""
IN_TIME = "Time integration"
"""Name of the check of a highest point by time integration."""
LOOSEST = ContinuationOptions().tolerance
"""Largest residual that counts as rounding, as along curves."""

LOWEST_SHARE = 0.3
"""Share of a preload from which its check by lower preloads begins.  Of 40 random studies one had a
branch that detached at 0.6 times the preload, and a curve without folds.
"""
BELOW_ROUNDING = 10.0
"""Ratio of the tolerance to the estimated rounding below which rounding may prevent convergence: at
fixed rotor speed residuals of 1.3 and 2.1 times the estimate remain."""

BelowTen = Annotated[float, validation.Limits(above=0.0, below=10.0)]
Family = Callable[[float], Equations]
"""Equations as a function of one scalar parameter."""


@validation.check_arguments
@dataclass(frozen=True)
class PeakOptions(validation.Checked):
    """Settings of the search for a peak.

    Parameters
    ----------
    tolerance : float
        Tolerance of the residual, relative to the excitation and the static load.  If rounding
        errors exceed it, for example with stiff bonded faces, they are estimated
        (:func:`rounding`) and become the tolerance, at most 1e-9.  If the search fails again, the
        tolerance is 1e-9.
    position_tolerance : float
        Tolerance of the position of the peak along the curve, relative to the vibration.
    max_step : float
        Largest step along the curve, relative to the vibration.
    max_iterations : int
        Maximum number of Newton iterations in one corrector.
    max_trials : int
        Maximum number of correctors for one peak.
    """

    tolerance: BelowTen = 1e-10
    position_tolerance: BelowTen = 1e-8
    max_step: BelowTen = 0.4
    max_iterations: AtLeastTwo = 12
    max_trials: AtLeastTwo = 60


@short_repr
@dataclass(frozen=True)
class Peak(Result, InContact, Tabular, Recorded, Storable, kind="bdamper-peak"):
    """Maximum of the amplitude along a response curve, or the last point of a search without a
    maximum.

    :func:`bdamper.plot.plot_peak` draws it.

    Parameters
    ----------
    parameter : float
        Preload (N) of the equations; NaN if they do not depend on a preload.
    frequency : float, Hz
        Frequency of the peak, or of ``lower_bound``.
    amplitude : float, m
        Amplitude of the first harmonic of the response; NaN for the highest peak of an incomplete
        search, infinite if unbounded.
    y, tangent, scale : (n_unknowns + 1,) float
        Point, tangent and units; the tangent has unit length in unknowns divided by ``scale``, and
        is zero if unknown.
    slope, curvature : float
        First and second derivative of ln(amplitude) along the curve in scaled unknowns; NaN if
        unknown.
    shares : (3,) float
        Fractions of the cycle in stick, slip and separation.
    residual : float
    iterations, trials, rank_deficiency : int
    corner : bool
        Whether the peak is not a smooth maximum: at a corner the slopes on either side differ in
        sign but do not vanish.
    status : str
        "complete"; "incomplete" at the end of an interval without a maximum, if a higher response
        is known, or if ``search_status`` is incomplete; "not found".
    reason : str
        Reason for the status, "" if it is complete.
    cost : Cost, optional
    search_status, search_reason : str
        Status of the curve whose highest peak this is, and its reason; if the status is not
        "complete", there may be a higher peak.
    settings : mapping
        Settings of the problem; empty for :func:`find_peak`.
    model_hash : str
    lower_bound : float, m
        Highest amplitude that an incomplete search knows; NaN if ``amplitude`` is known.
    half_range : float, m
        Half of the largest peak-to-peak response on the response curve, with all harmonics; NaN if
        the amplitude is NaN, and for peaks of :func:`find_peak`.
    notes : tuple of str
        Self-locking bodies, whose static normal load is not unique.
    errors : tuple of SourceError
        Errors by harmonics and, with residual modes, by six more of them; empty if they were left
        out (``errors=False``) and in files of earlier versions.
    harmonic_peaks : tuple of HarmonicPeak
        Peaks with two more harmonics at each step, after a large change with the next two.
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
    reason: Reason = ""
    cost: Cost | None = None
    search_status: str = ""
    search_reason: Reason = ""
    lower_bound: Annotated[Metre, Data(derived=True)] = float("nan")
    half_range: Annotated[float, Quantity("m"), Data(derived=True)] = float("nan")
    notes: Annotated[tuple[str, ...], Data(derived=True)] = ()
    errors: Annotated[tuple[SourceError, ...], Data(derived=True)] = ()
    harmonic_peaks: Annotated[tuple[HarmonicPeak, ...], Data(derived=True)] = ()
    _called = "peak"
    _summary_fields = (
        "parameter",
        "amplitude",
        "lower_bound",
        "frequency",
        "error",
        "shares",
        "search_status",
    )

    @property
    def error(self) -> float:
        """Relative error of the amplitude, the sum of ``errors``; NaN if one of them is unknown, or
        without them.
        """
        return amplitude_error(self.errors)

    def with_present_names(self) -> Self:
        """Return a peak of an earlier version with the present meaning of its amplitude.

        Version 0.10 stored the amplitude of the highest computed point of an incomplete search as
        the amplitude of the peak.
        """
        is_complete = self.search_status in ("", COMPLETE)
        if is_complete or not np.isfinite(self.amplitude):
            return self
        return replace(self, amplitude=float("nan"), lower_bound=self.amplitude)

    def _facts(self) -> tuple[Fact, ...]:
        """Return the most important values of the peak, or the reason why there is none."""
        if not self.ok:
            return (Fact("peak", self.status_text),)
        facts = super()._facts()
        if exceeds(self.half_range, self.amplitude):
            return (*facts, Fact("half of the range", self.half_range, "m"))
        return facts

    def _unprinted(self) -> tuple[str, ...]:
        """Return the names of fields that are not printed."""
        names = super()._unprinted()
        # the preload of a linear limit only closes contact points
        if "limit" in self.settings:
            return (*names, "parameter")
        return names

    def _statement(self) -> Statement:
        remarks = [sentence(note) for note in self.notes]
        if not self.ok:
            rows = []
            if np.isfinite(self.lower_bound):
                rows.append(lower_bound_row(self.lower_bound, self.frequency))
            rows += interval_rows(self.settings, "not searched completely")
            subject = about(self.settings, self.parameter)
            if self.reason.startswith(UNBOUNDED):
                return Statement([f"Response {self.reason}{subject}"], rows, remarks=remarks)
            verdict = f"No peak: {self.status_text}{subject}"
            return Statement([verdict], rows, remarks=remarks)
        limit = self.settings.get("limit", "")
        preload = np.nan if limit else self.parameter
        kind = RESONANCES[limit]
        peak = peak_text(self.amplitude, self.frequency)
        peak += first_harmonic_text(self.half_range, self.amplitude)
        if self.errors:
            peak += f", {error_text(self.errors)}"
        verdict = f"{kind} {peak}{about(self.settings, preload)}"
        if self.search_status not in ("", COMPLETE):
            search = with_reason(self.search_status, self.search_reason)
            remarks.insert(0, f"There may be a higher peak: {search}")
        rows = half_range_rows(self.half_range, self.amplitude)
        if limit:
            return Statement([verdict], rows, remarks=remarks)
        rows += error_rows(self.errors, self.amplitude, self.harmonic_peaks)
        rows += contact_rows(self.shares, "the peak")
        is_searched = self.search_status in ("", COMPLETE)
        found = "complete: no higher branch found" if is_searched else "not searched completely"
        rows += interval_rows(self.settings, found)
        remarks.append(not_covered(self.settings, ["more blade modes"]))
        checks = unchecked("peak", preload, bool(self.errors))
        times = prices(checks, self.cost, float(self.shares[2]), self.settings)
        return Statement([verdict], rows, checks, remarks, times=times, further=self._calls)

    @property
    def _calls(self) -> list[str]:
        """The call for a peak with the harmonics that it needs, if more change it much."""
        changes = changes_by_source(self.errors)
        if not abs(changes["harmonic_change"]) > CHANGED_MUCH or "harmonics" not in self.settings:
            return []
        return ['with more harmonics: study.refine(peak, sources=["harmonics"])']


RESONANCES = {
    "": "Resonance peak",
    "free": "Resonance peak without contact",
    "stuck": "Resonance peak with stuck contacts",
}
"""Name of a peak by its linear limit."""
CHANGED_MUCH = 0.05
"""Relative change by more harmonics above which a peak names the call that computes with them."""


def lower_bound_row(amplitude: float, frequency: float) -> Row:
    """Return the row of a computed amplitude (m) below the unknown peak."""
    at = f"the highest response is at least this high, at {amount(frequency, 'Hz')}"
    return Row("Lower bound", amount(amplitude, "m"), at)


def first_harmonic_text(half_range: float, amplitude: float) -> str:
    """Return the remark on an amplitude (m) that is exceeded by half of the peak-to-peak motion
    (m).
    """
    return " in the first harmonic" if exceeds(half_range, amplitude) else ""


def half_range_rows(half_range: float, amplitude: float) -> list[Row]:
    """Return the row with half of the peak-to-peak motion (m) if it exceeds the amplitude (m)."""
    return [half_range_row(half_range)] if exceeds(half_range, amplitude) else []


def half_range_row(half_range: float) -> Row:
    """Return the row with half of the peak-to-peak motion (m)."""
    value = amount(half_range, "m")
    return Row("Half peak to peak", value, "all harmonics; the amplitude is of the first")


def contact_rows(shares: NDArray, place: str) -> list[Row]:
    """Return the row with the fractions of the cycle in stick, slip and separation at a place such
    as "the peak", if known.
    """
    if not np.isfinite(shares).all():
        return []
    # a share that rounds to zero has no sign
    per_cent = (100.0 * np.asarray(shares)).round(1) + 0.0
    states = zip(("stick", "slip", "open"), per_cent)
    value = ", ".join(f"{state} {share:.3g} %" for state, share in states)
    return [Row("Contact states", f"{value} of the period at {place}")]


def interval_rows(settings: Mapping[str, Any], finding: str) -> list[Row]:
    """Return the row with the interval of a search for the highest peak, if it is recorded."""
    if "frequency" not in settings:
        return []
    low, high = settings["frequency"]
    return [Row("Search interval", extent(low, high, "Hz"), finding)]


def unchecked(name: str, preload: float, has_errors: bool = False) -> list[Row]:
    """Return the checks that are not part of a peak or curve by harmonic balance.

    An error by harmonics replaces the check of more harmonics.  Branches that detached at lower
    preloads show only where peaks are followed from there.
    """
    rows = [Row(IN_TIME, "not run", f"study.time_response({name})")]
    if preload > 0.0:
        lowest = LOWEST_SHARE * preload
        low, high = (f"{float(f'{value:.3g}'):g}" for value in (lowest, preload))
        rows.append(Row("Lower preloads", "not run", f"study.optimal_curve(({low}, {high}))"))
    if not has_errors:
        rows.append(Row("More harmonics", "not run", f"study.harmonic_convergence({name})"))
    return rows


def prices(
    checks: Sequence[Row], cost: Cost | None, open_share: float, settings: Mapping[str, Any]
) -> list[str]:
    """Return the time that each check would take as text, "" if unknown.

    ``cost`` belongs to the peak or curve, and ``open_share`` is the share of the period in which its
    contacts are open at the peak.
    """
    expected = seconds_in_time(seconds_of_evaluation([cost]), open_share, settings)
    return [
        expected_text(expected) if check[:2] == (IN_TIME, "not run") else "" for check in checks
    ]


def vibration_width(y: NDArray, tangent: NDArray, scale: NDArray, n_mean: int) -> float:
    """Return the change of frequency (rad/s) over which the vibration changes by its size.

    It is limited to 1e-7 and 0.2 of the frequency.  ``n_mean`` is the number of unknowns of the
    mean, which are first; the last unknown is the frequency.
    """
    direction = tangent * scale
    change_of_vibration = max(norm2(direction[n_mean:-1]), 1e-300)
    vibration = norm2(y[n_mean:-1])
    change_of_omega = abs(float(direction[-1]))
    width = change_of_omega * vibration / change_of_vibration
    omega = float(y[-1])
    return min(max(width, 1e-7 * omega), 0.2 * omega)


def amplitude_and_phase(system: Equations, u: NDArray) -> tuple[NDArray, NDArray, float]:
    """Return the gradients (n_unknowns,) of amplitude and of amplitude times phase.

    The third value is the amplitude (m) of the first harmonic of the response.
    """
    row = system.response_rows[1]
    x = system.layout.amplitudes(u, harmonic=1) @ row
    amplitude = float(abs(x))
    # a change dx of the response changes |x| + i |x| phase(x) by conj(x) dx / |x|
    by_modes = np.conj(x) * row / max(amplitude, 1e-300)
    amplitude_gradient, phase_gradient = system.layout.parts(by_modes)
    return amplitude_gradient, phase_gradient, amplitude


def amplitude_at(system: Equations, y: NDArray) -> float:
    """Return the amplitude (m) of the first harmonic of the response."""
    return float(abs(system.rows.value(y)))


def slope_along(system: Equations, y: NDArray, tangent: NDArray, scale: NDArray) -> float:
    """Return the derivative of ln(amplitude) along a direction in scaled unknowns."""
    gradient, squared = system.rows.squared_gradient(y)
    return float(gradient @ (tangent * scale)) / max(squared, 1e-300)


class _Search:
    """Search for the maximum along one response curve."""

    def __init__(
        self, system: Equations, scale: NDArray, options: PeakOptions, reach: float
    ) -> None:
        self.system = system
        self.scale = scale
        self.options = options
        self.reach = reach
        self.iterations = 0
        self.trials = 0
        self.reason = ""

    def solve(
        self, y: NDArray, condition: equations.Condition, tolerance: float = 0.0
    ) -> Correction | None:
        """Run Newton's method to the tolerance of the options or a larger one; None if it fails."""
        self.trials += 1
        tolerance = max(self.options.tolerance, tolerance)
        solution = self.system.solve(
            y, condition, self.scale, tolerance, self.options.max_iterations
        )
        self.iterations += solution.iterations
        self.reason = STATUS_TEXT[solution.status]
        return solution if solution.status == OK else None

    def vibration(self, difference: NDArray) -> float:
        """Return the norm of a difference of two points in scaled unknowns without the mean."""
        n_mean = self.system.n_mean
        return norm2(difference[n_mean:] / self.scale[n_mean:])

    def newton(self, y: NDArray, tangent: NDArray, curvature: float) -> Correction | None:
        """Return the peak by Newton's method from a close guess, or None."""
        options = self.options
        condition = equations.Maximum(
            tangent,
            curvature,
            tolerance=options.position_tolerance,
            max_step=0.5 * options.max_step,
        )
        top = self.solve(y, condition)
        if top is None:
            return None
        moved = self.vibration(top.y - y)
        if moved > min(self.reach, options.max_step):
            self.reason = FAR
            return None
        # distance to a peak, relative to the vibration, below which secants do not give its
        # curvature: an error of 0.3**3 on the reference disk from a guess at a distance of 1e-7
        short = 1e-3
        at_corner = top.curvature < -JUMP
        if moved > short or at_corner:
            return top
        slope_gradient, _ = self.system.slope_gradient(top.y, top.tangent, self.scale, DIFFERENCE)
        top = replace(top, curvature=float(slope_gradient @ top.tangent))
        # a minimum, or NaN
        if not top.curvature < 0.0:
            return None
        slope = slope_along(self.system, top.y, top.tangent, self.scale)
        distance = abs(slope / top.curvature)
        if distance <= options.position_tolerance:
            return top
        with_curvature = replace(condition, tangent=top.tangent, curvature=top.curvature)
        return self.solve(top.y, with_curvature)

    def first(self, y: NDArray, tangent: NDArray | None) -> Correction | None:
        """Return a point of the curve near a guess, or None.

        It is in the plane normal to ``tangent``, or at the frequency of the guess.
        """
        condition: equations.Condition = equations.Fixed()
        if tangent is not None:
            condition = equations.Plane(tangent)
        # a starting point needs no smaller residual
        return self.solve(y, condition, tolerance=1e-6)

    def in_local_units(self, point: Correction) -> Correction:
        """Return the same point with the unit of frequency from the direction of the curve."""
        direction = point.tangent * self.scale
        width = vibration_width(point.y, point.tangent, self.scale, self.system.n_mean)
        self.scale = self.system.units(point.y, width)
        tangent = direction / self.scale
        return replace(point, tangent=tangent / norm2(tangent), scale=self.scale)

    def uphill(self, start: Correction) -> Correction | None:
        """Follow the curve uphill until the slope changes sign, and locate the maximum there.

        Return None with ``reason`` if there is none.
        """
        options = self.options
        slope = slope_along(self.system, start.y, start.tangent, self.scale)
        sense = float(np.copysign(1.0, slope))
        along_curve = ContinuationOptions(tolerance=options.tolerance, max_step=options.max_step)
        any_frequency = (0.0, np.inf)
        follower = Follower(self.system, any_frequency, along_curve)
        # sign of det [J; tangent] for the tangent that points uphill
        follower.sign = int(sense) * start.orientation
        here = replace(start, tangent=sense * start.tangent)
        step = along_curve.step
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
                last_step = Step(here, new, end)
                top = follower.events.locate(last_step, "maximum", options.position_tolerance)
                self.iterations += follower.events.iterations
                # only read if the result is None
                self.reason = "the maximum of a step could not be located"
                return top
            # angle between the unit tangents
            turn = float(np.arccos(np.clip(new.tangent @ here.tangent, -1.0, 1.0)))
            step = follower.longer(step, turn, new.iterations)
            here = new
        self.reason = f"not found within {options.max_trials} correctors"
        return None


def rounding(system: Equations, y: NDArray) -> float:
    """Return the relative residual attributable to round-off in its terms at a point."""
    u = y[:-1]
    omega = y[-1]
    _, J, _ = system.evaluate(u, omega)
    # size of the terms of each equation, relative to the excitation
    terms = np.abs(J) @ np.abs(u) * system.row_scale
    return float(np.finfo(float).eps * terms.max())


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
    """Compute the maximum of the amplitude that the curve reaches uphill from a nearby point.

    Parameters
    ----------
    system : Equations
    guess : (n_unknowns + 1,) float
        Unknowns and frequency (rad/s) near the response curve.
    tangent : (n_unknowns + 1,) float, optional
        Estimated direction of the curve in scaled unknowns.  The first corrector is normal to it,
        or at fixed frequency.
    scale : (n_unknowns + 1,) float, optional
        Scale of each unknown (``Equations.units``); from the curve by default.
    curvature : float
        Estimated second derivative of ln(amplitude) along the curve in scaled unknowns.
    options : PeakOptions
    parameter : float
        Value of the parameter of the equations, stored in the result.
    reach : float
        Largest distance along the curve, relative to the vibration.

    Returns
    -------
    Peak
        With status "not found" and a reason if no maximum was found; it is then the last point of
        the curve, or the guess.
    """
    options = options or PeakOptions()
    guess = np.asarray(guess, float)
    units = scale
    if units is None:
        # until the direction of the curve is known, the unit of frequency is 1 %
        omega = guess[-1]
        units = system.units(guess, width=0.01 * omega)
    search = _Search(system, units, options, reach)
    top: Correction | None = None
    start: Correction | None = None
    if tangent is not None and scale is not None and curvature < 0.0:
        top = search.newton(guess, tangent, curvature)
    if top is None:
        start = search.first(guess, tangent)
        if start is None:
            search.reason = f"no solution near the guess: {search.reason}"
        else:
            if scale is None:
                start = search.in_local_units(start)
            # curvature of ln(amplitude) along the curve, typical of a resonance in scaled unknowns
            typical = -1.0
            top = search.newton(start.y, start.tangent, min(curvature, typical))
            if top is None:
                top = search.uphill(start)
    if top is None and start is not None and options.tolerance < LOOSEST:
        # rounding may be the cause: the residual that remains is some times its estimate; search
        # with the estimate as tolerance, and with the loosest tolerance if that has failed too
        estimate = min(rounding(system, start.y), LOOSEST)
        looser = estimate if options.tolerance < estimate else LOOSEST
        if options.tolerance < BELOW_ROUNDING * estimate:
            return find_peak(
                system,
                guess,
                tangent=tangent,
                scale=scale,
                curvature=curvature,
                options=replace(options, tolerance=looser),
                parameter=parameter,
                reach=reach,
            )
    last = top or start
    if last is None:
        last = Correction(
            status=NOT_CONVERGED,
            y=guess,
            tangent=np.zeros(len(guess)),
            scale=search.scale,
            iterations=0,
            residual=np.nan,
            rank_deficiency=0,
        )
    omega = last.parameter
    return Peak(
        parameter=parameter,
        frequency=float(omega / (2.0 * np.pi)),
        amplitude=amplitude_at(system, last.y),
        y=last.y,
        tangent=last.tangent,
        scale=search.scale,
        slope=last.slope,
        curvature=last.curvature,
        shares=np.array(last.shares),
        residual=last.residual,
        iterations=search.iterations,
        trials=search.trials,
        rank_deficiency=last.rank_deficiency,
        corner=top is not None and last.curvature < -JUMP,
        status=NOT_FOUND if top is None else COMPLETE,
        reason=search.reason if top is None else "",
    )


def with_tangent(system: Equations, peak: Peak) -> Peak:
    """Return a smooth peak with its tangent, to the tolerances of :class:`PeakOptions`.

    The peak of a response curve does not contain its tangent; Newton's method from its point takes
    about five evaluations.
    """
    if peak.tangent.any() or peak.corner:
        return peak
    return find_peak(system, peak.y, parameter=peak.parameter)


def check_peak(problem: Problem, peak: Peak, name: str = "peak") -> None:
    """Raise SettingError unless the argument is a converged peak of this problem."""
    validation.instance(
        name, peak, Peak, "a Peak, as Study.peak returns it or ResponseCurve.peak is"
    )
    validation.check(peak.ok, name, "a converged one", f"status '{peak.status_text}'")
    if peak.model_hash:
        check_result(problem, peak, name)
    check_solution(problem, peak.parameter, peak.y, peak.residual, name)


def sign_of_jacobian(system: Equations, y: NDArray) -> int:
    """Return the sign of det J at a solution, which changes at every fold; 0 if unknown."""
    u = y[:-1]
    omega = y[-1]
    scale = system.units(y, width=omega)
    # the point is a solution already; the core returns the sign with it
    solution = system.correct_at(u, float(omega), scale, tolerance=LOOSEST, max_iterations=2)
    return solution.orientation


def phase_row(system: Equations, y: NDArray) -> tuple[NDArray, NDArray]:
    """Return the normalised gradient (n_unknowns + 1,) of the phase, and the unit of each unknown.

    A correction in these units leaves the phase unchanged if its product with the gradient is zero.
    """
    u = y[:-1]
    omega = y[-1]
    scale = system.units(y, width=omega)
    _, phase_gradient, _ = amplitude_and_phase(system, u)
    # the frequency does not change the phase at constant unknowns
    row = np.append(phase_gradient, 0.0) * scale
    return row / max(norm2(row), 1e-300), scale


def coarse_options() -> ContinuationOptions:
    """Return settings of the continuation for the search of peaks.

    With ``max_step`` 0.5 instead of 0.15 and ``max_turn`` 0.6 instead of 0.45 rad, a curve takes 2
    to 32 % fewer evaluations and has the same highest points to 1e-6 at 40 preloads of five
    studies.  With a ``max_turn`` of 0.8 rad, curves with many folds take up to 40 % more
    evaluations.
    """
    return ContinuationOptions(
        tolerance=1e-7, step=0.1, max_step=0.5, max_turn=0.6, locate_tolerance=0.05
    )


def same_peak(a: Peak, b: Peak) -> bool:
    """Return whether two peaks of the same equations agree in frequency and amplitude."""
    first = a.frequency, a.amplitude
    second = b.frequency, b.amplitude
    return np.allclose(first, second, rtol=1e-5, atol=0.0)
