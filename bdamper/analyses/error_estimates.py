"""Comparison of a peak with the peak of another study, and error estimates by source.

A study with different settings is compared in one of three ways.

Complete curve
    The response curve of the other study is computed, and its highest point is used
    (:func:`whole_curve`). If the response is highest at an end of the interval and the first curve
    is not, the resonance has left the interval. The interval is then widened there by up to 39 % of
    the frequency.

Newton iteration
    Newton's method continues from the converged peak, and from lower maxima that could become the
    highest, in the other study (:mod:`bdamper.response.richer_peak`).  At an end of the interval it
    continues at the same frequency.  If it has no answer, the complete curve is computed.

Adjoint estimate
    A converged solution ``y = (u, omega)`` is embedded in the other system: common modes and
    harmonics keep their amplitudes, others are zero, and the mean keeps its distance from the
    static state. The residual ``R`` of the other system is not zero there. The amplitude ``A`` is
    stationary along the curve at a peak, so any nearby point of the other curve may be compared.
    The phase of the response is held, because it follows a resonance that shifts:

        B = [ J  R_omega ; grad(phase)  0 ],      B^T lambda = (grad A, 0),      B^T mu = (0, 1),
        dA = -lambda . R,                          domega = -mu . R.

    One Jacobian and one factorisation of the other system give both. A second evaluation of ``R``
    at ``y - B^-1 R`` with the same weights gives the *defect*, the error of the linear estimate. An
    estimate with its defect is an order of magnitude that identifies small changes. On a test rig
    (five harmonics, without separation) the estimated change of amplitude is +5.6 %, its defect 3.7
    % and the true change +1.3 %.

Error estimates by source compare the peak with a more detailed study in one respect. If the model
has no more detail, or the curve cannot be computed, the source is not estimated and the reason is
given.

``harmonics``
    Two more harmonics, and another two; modes of the fundamental replace modes of a nodal diameter
    that the model lacks. The three peaks show whether they approach each other. If they do not, or
    have no solution, more harmonics do not give a limit, and only time integration can determine
    the amplitude.
``contact_forces``
    Sampled contact forces are compared with exact events.
``contact points``
    Merged contact patches are compared with the patches of the model. If the study has them all, it
    is compared with a coarser set of at least half of them. The error of ``n`` points is then
    assumed to fall as ``1/n``: between 48 and 24 points, and 24 and 12, the change of a peak of the
    reference disk falls to a quarter, so that the assumption is cautious. The coarser set keeps
    three rows along t1 and two along t2 if the face has them, because a wedge on fewer rows rolls
    too easily.
``modes``
    If the study has residual modes, the number of modes is doubled, at least to the default number
    of blade modes: the error decreases with the fourth power of the frequency of the first omitted
    mode. Otherwise all modes of the model are used, because convergence is slow.
``residual flexibility``
    A diagonal contact stiffness is compared with residual modes, which contain the complete
    flexibility for stuck modes. Residual modes are compared with six more, the softest ones.
    Complete curves compare them with one for every force on the mesh, at most 72. Both studies have
    at least three harmonics, because only the diagonal represents contact forces above the highest
    harmonic, and more vectors make it smaller.
``time``
    Time integration near the peak (:mod:`bdamper.time_domain.time_response`), only on request,
    because it takes longer than all other sources. The error is the difference from the farther end
    of the range of amplitudes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import AFT
from bdamper.contact.residual_flexibility import ResidualModes, ResidualSet
from bdamper.harmonic_balance.effects import BLADE_MODES
from bdamper.harmonic_balance.equations import OK, Equations
from bdamper.harmonic_balance.problem import Problem
from bdamper.model.contact_points import ROWS, rows_of_points, unite_face
from bdamper.response.highest_peak import highest_of_curve, maxima
from bdamper.response.peak import (
    Peak,
    amplitude_and_phase,
    check_peak,
    phase_row,
    same_peak,
)
from bdamper.response.peak_error import HarmonicPeak, SourceError
from bdamper.response.response_curve import check_curve, frequency_response
from bdamper.response.response_curve_result import ResponseCurve, uninterrupted
from bdamper.response.richer_peak import (
    NEARLY_HIGHEST,
    SOFT_VECTORS,
    Change,
    embed,
    missing_harmonics,
    richer_peaks,
    with_more_harmonics,
    with_soft_vectors,
    with_stand_ins,
)
from bdamper.response.verification import ErrorEstimates
from bdamper.time_domain import time_response
from bdamper.util import validation
from bdamper.util.errors import COMPLETE, BdamperError, SettingError, with_reason
from bdamper.util.formatting import listed, short_text
from bdamper.util.progress import CostMeter, one_thread


def estimate_change(system: Equations, y: NDArray) -> Change:
    """Estimate by one adjoint solution how a peak changes if more detailed equations replace its own.

    Parameters
    ----------
    system : Equations
        More detailed equations.
    y : (n_unknowns + 1,) float
        Peak in the unknowns of ``system``, which it does not solve.

    Returns
    -------
    Change
        Unknown if the equations are singular or not finite.
    """
    n = system.n_unknowns
    unknown = Change(how="no estimate")
    residual = np.empty(n)
    if system.core.evaluate(np.ascontiguousarray(y), residual) != OK:
        return unknown
    gradient, _, amplitude = amplitude_and_phase(system, y[:-1])
    border, scale = phase_row(system, y)
    # derivatives of ln(amplitude) and of ln(frequency) with respect to the scaled unknowns, of
    # which the frequency is the last
    weights = np.zeros((2, n + 1))
    of_amplitude, of_frequency = weights
    of_amplitude[:n] = gradient / max(amplitude, 1e-300) * scale[:n]
    of_frequency[n] = 1.0
    # the residual, and zero in the condition for the phase
    right = np.append(-residual, 0.0)
    try:
        dual = system.solve_linear(y, border, scale, weights, transposed=True)[:, :n]
        (step,) = system.solve_linear(y, border, scale, right[None])
    except FloatingPointError:
        return unknown
    amplitude_change, frequency_change = -(dual @ residual)
    # the residual after a step of Newton's method is the defect of the linear estimate
    after_step = y + step * scale
    remaining = np.empty(n)
    if not after_step[-1] > 0.0 or system.core.evaluate(after_step, remaining) != OK:
        return unknown
    defect = dual @ remaining
    return Change(
        amplitude=float(amplitude_change),
        frequency=float(frequency_change),
        uncertainty=float(np.abs(defect).max()),
        how="estimated",
    )


WIDER = 1.05, 1.1, 1.2
"""Successive factors on the interval if the resonance has left it: 39 % in total."""


class PeakOutcome(NamedTuple):
    """Highest peak of a study with its cost, or the reason for a failure.

    Parameters
    ----------
    amplitude, frequency : float, m, Hz
        NaN if unknown.
    reason : str
        Reason for a failure; otherwise "".
    seconds : float
        Processor time.
    result : ResponseCurve, Peak or tuple of float, or None
        Result of the solver.
    """

    amplitude: float
    frequency: float
    reason: str
    seconds: float
    result: Any


def evaluate_peak(problem: Problem, solve: Callable[[Problem], Any]) -> PeakOutcome:
    """Find the highest peak of a problem in this thread; a failure becomes a reason.

    Parameters
    ----------
    problem : Problem
    solve : callable
        Function of the problem that returns a response curve, a peak, or amplitude (m) and
        frequency (Hz).

    Returns
    -------
    PeakOutcome
    """
    start = time.thread_time()
    result = None
    try:
        result = solve(problem)
        amplitude, frequency, reason = _read(problem, result)
    except (BdamperError, ArithmeticError, np.linalg.LinAlgError) as error:
        amplitude = frequency = np.nan
        reason = str(error)
    seconds = time.thread_time() - start
    return PeakOutcome(float(amplitude), float(frequency), reason, seconds, result)


def _read(problem: Problem, result: Any) -> tuple[float, float, str]:
    """Return amplitude (m) and frequency (Hz) of the highest peak, NaN after a failure, and the
    reason of a failure, otherwise ""."""
    if isinstance(result, Peak):
        if result.ok and result.search_status in ("", COMPLETE):
            return result.amplitude, result.frequency, ""
        search = with_reason(result.search_status, result.search_reason)
        return np.nan, np.nan, f"status '{result.status_text}', search {search}"
    if isinstance(result, ResponseCurve):
        if not result.complete:
            return np.nan, np.nan, result.status_text
        if result.peak_at_end:
            # an end counts only if there is no maximum
            peak = highest_of_curve(problem.system(result.preload), result).peak
        else:
            peak = result.peak
        return peak.amplitude, peak.frequency, ""
    # the result of a solver of the user
    try:
        amplitude, frequency = (float(value) for value in result)
    except (TypeError, ValueError):
        expected = "a ResponseCurve, a Peak, or amplitude (m) and frequency (Hz)"
        raise SettingError(f"answer: expected {expected}, found {short_text(result)}") from None
    return amplitude, frequency, ""


def whole_curve(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    at_end: bool = False,
    wider: tuple | None = None,
) -> ResponseCurve:
    """Compute a response curve that contains a maximum.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    frequency : (low, high), Hz
    at_end : bool
        Accept a response that is highest at an end of the interval.
    wider : tuple of float, optional
        Successive factors that widen the interval at the end with the highest response. If given,
        an end that is higher than every maximum is an error.

    Raises
    ------
    BdamperError
        If the curve has no point, or no maximum within the interval.
    """
    curve = uninterrupted(frequency_response(problem, preload, frequency))
    reason = ""
    if not len(curve):
        reason = curve.reason
    if not reason and curve.peak_at_end and not at_end:
        if wider:
            factor, *further = wider
            low, high = frequency
            highest_at_upper_end = 2.0 * curve.peak.frequency > low + high
            if highest_at_upper_end:
                frequency = low, high * factor
            else:
                frequency = low / factor, high
            return whole_curve(problem, preload, frequency, wider=tuple(further))
        # an empty tuple, unlike None: the interval was widened without success
        widened_in_vain = wider is not None
        if widened_in_vain or highest_of_curve(problem.system(preload), curve).kind == "end":
            reason = "the response is highest at an end of the interval"
    if reason:
        raise BdamperError(
            f"no peak at {preload:g} N between {frequency[0]:.6g} and {frequency[1]:.6g} Hz: "
            f"{reason}"
        )
    return curve


@dataclass(frozen=True)
class Tops:
    """Highest peak of a study at one preload, and lower peaks that may become the highest.

    Parameters
    ----------
    peaks : tuple of Peak
        The highest first.
    interval : (low, high), Hz, or None
        Interval of their response curve.
    at_end : bool
        Whether the highest point is an end of the interval.
    follow : bool
        Whether to widen the interval if the peak leaves it. This is wrong if an end is already
        higher, on the flank of another resonance.
    """

    peaks: tuple[Peak, ...]
    interval: tuple[float, float] | None = None
    at_end: bool = False
    follow: bool = False

    @classmethod
    def of(cls, problem: Problem, curve: ResponseCurve) -> Tops:
        """Refine the highest point of a response curve and the peaks that are almost as high."""
        system = problem.system(curve.preload)
        highest = highest_of_curve(system, curve)
        lower = [
            peak
            for peak in maxima(system, curve, NEARLY_HIGHEST)
            if not same_peak(peak, highest.peak)
        ]
        return cls(
            peaks=(highest.peak, *lower),
            interval=(float(curve.frequency.min()), float(curve.frequency.max())),
            at_end=highest.kind == "end",
        )

    def curve_with(self, problem: Problem, preload: float) -> ResponseCurve:
        """Compute the complete response curve of another study around the highest peak."""
        return whole_curve(
            problem,
            preload,
            self.search_interval,
            at_end=self.at_end,
            wider=WIDER if self.follow else None,
        )

    @property
    def search_interval(self) -> tuple[float, float]:
        """Interval (low, high) of a curve of another study, Hz."""
        if self.interval is not None:
            return self.interval
        frequency = self.peaks[0].frequency
        return 0.85 * frequency, 1.2 * frequency


class Solution(NamedTuple):
    """Peaks of another study, and the change of the highest peak relative to the first study.

    Parameters
    ----------
    change : Change
    tops : Tops or None
        Peaks of the other study; None if they are unknown, or if the highest point is an end of
        the interval.
    """

    change: Change
    tops: Tops | None = None


LARGEST_SHIFT = 0.05
"""Relative change of the frequency beyond which the complete curve follows Newton's method.

Without the modes beyond the second one the peak of a wedge moved by -17 % to a lower resonance,
and its amplitude changed by -5 instead of -53 %.  With more modes another one moved by 71 %, out of
the interval of the search.
"""


def compare(
    problem: Problem, other: Problem, preload: float, tops: Tops, by_newton: bool = False
) -> Change:
    """Compute the change of the highest peak from one problem to another (:func:`solve_other`)."""
    return solve_other(problem, other, preload, tops, by_newton).change


def solve_other(
    problem: Problem,
    other: Problem,
    preload: float,
    tops: Tops,
    by_newton: bool = False,
    readings: bool = False,
) -> Solution:
    """Compute the highest peak of another problem.

    Parameters
    ----------
    problem, other : Problem
    preload : float, N
    tops : Tops
        Highest peaks of the first problem.
    by_newton : bool
        Whether to try Newton's method from these peaks before the complete curve.
    readings : bool
        Whether a point without convergence, from which the change was read, is an answer.  It has
        no peak.

    Returns
    -------
    Solution
    """
    state = other.static(preload)
    if not state.ok:
        return Solution(Change(how=f"no static state: {state.reason}"))
    peak = tops.peaks[0]  # the highest
    if by_newton and tops.at_end:
        system = other.system(preload)
        embedded = [embed(problem, other, preload, top.y) for top in tops.peaks]
        change = _at_frequency(system, embedded, peak)
        if change is not None:
            return Solution(change)
    elif by_newton:
        found = richer_peaks(problem, other, preload, tops.peaks)
        # another resonance may be the highest after a large shift
        is_near = abs(found.change.frequency) <= LARGEST_SHIFT
        if found.peaks and is_near:
            return Solution(found.change, Tops(found.peaks, tops.interval))
        if readings and found.change.known and is_near:
            return Solution(found.change)
    outcome = evaluate_peak(other, lambda study: tops.curve_with(study, preload))
    if outcome.reason:
        return Solution(Change(how=f"no complete response curve: {outcome.reason}"))
    low, high = tops.search_interval
    outside = "" if low <= outcome.frequency <= high else ", outside the interval"
    how = f"computed by a complete response curve{outside}"
    return Solution(Change.between(peak, outcome, how), Tops.of(other, outcome.result))


def _at_frequency(system: Equations, embedded: list[NDArray], peak: Peak) -> Change | None:
    """Return the change of a highest point at an end of the interval, at the same frequency.

    The result is None if Newton's method fails, or if another peak may become the highest.
    """
    if len(embedded) > 1:
        return None
    (y,) = embedded
    unknowns = y[:-1]
    omega = float(y[-1])
    scale = system.units(y, omega)
    # without line search first, because it rarely needs one
    for max_iterations, line_search in ((20, 0), (60, 1)):
        solution = system.correct_at(
            unknowns,
            omega,
            scale,
            tolerance=1e-9,
            max_iterations=max_iterations,
            line_search=line_search,
        )
        if solution.status == OK:
            first_harmonic = system.response(solution.y[:-1])[1]
            return Change(
                amplitude=float(abs(first_harmonic)) / peak.amplitude - 1.0,
                frequency=0.0,
                uncertainty=0.0,
                how="amplitude recomputed at the end of the interval",
            )
    return None


SOURCES = ("harmonics", "contact_forces", "contact points", "modes", "residual flexibility")
"""Sources of error that a setting of the study reduces."""
TIME = "time"
"""Source of error that only time integration shows."""
HARMONIC_STEPS = 2
"""Number of steps of two harmonics each: the second shows whether the peaks approach each other."""


class Richer(NamedTuple):
    """Study that is more detailed in one respect, and a description."""

    problem: Problem
    text: str


class Enriched(NamedTuple):
    """Study that is more detailed in one respect, with its highest peaks.

    ``tops`` is None if these peaks are unknown, or if the highest point is an end of the interval.
    """

    problem: Problem
    text: str
    tops: Tops | None


class How(NamedTuple):
    """How the peak of a more detailed study is found.

    Parameters
    ----------
    by_newton : bool
        Newton's method first.  Otherwise complete response curves only, and all residual modes
        instead of six more.
    readings : bool
        Whether an error may be read from a point without convergence, which has no peak.
    """

    by_newton: bool = True
    readings: bool = False


NEWTON_FIRST = How()
"""Newton's method first, then a complete curve; each estimate has a peak."""


READINGS = How(readings=True)
"""Newton's method first; a point without convergence near a solution is an answer."""


class Examination(NamedTuple):
    """Errors of a peak, and the more detailed study of each source that has one."""

    estimates: ErrorEstimates
    enriched: dict[str, Enriched]


@one_thread
def estimate_errors(
    problem: Problem,
    result: ResponseCurve | Peak,
    *,
    sources: Sequence[str] = SOURCES,
    complete: bool = False,
) -> ErrorEstimates:
    """See :meth:`bdamper.Study.estimate_errors`."""
    complete = validation.flag("complete", complete)
    how = How(by_newton=False) if complete else READINGS
    return examine(problem, result, sources, how=how).estimates


def examine(
    problem: Problem,
    result: ResponseCurve | Peak,
    sources: Sequence[str],
    meter: CostMeter | None = None,
    how: How = NEWTON_FIRST,
) -> Examination:
    """Estimate the errors of a peak, and keep the more detailed studies and their peaks.

    If ``meter`` is given, it contains the cost even after an interrupt.

    Raises
    ------
    SettingError
        If the result has not converged or belongs to another study.
    """
    sources = validation.names("sources", sources, (*SOURCES, TIME))
    validation.instance(
        "result", result, (ResponseCurve, Peak), "a ResponseCurve or a Peak of this study"
    )
    if meter is None:
        meter = CostMeter()
    if isinstance(result, ResponseCurve):
        check_curve(problem, result)
        preload = result.preload
        tops = replace(Tops.of(problem, result), follow=not result.peak_at_end)
    else:
        check_peak(problem, result)
        preload = result.parameter
        tops = Tops((result,))
    errors: list[SourceError] = []
    error: SourceError | None
    enriched_by: dict[str, Enriched] = {}
    harmonic_peaks: tuple[HarmonicPeak, ...] = ()
    for source in sources:
        if source == TIME:
            errors.append(_of_time(problem, result, tops.peaks[0], meter))
            continue
        start = time.thread_time()
        if source == "harmonics":
            error, enriched, harmonic_peaks = _of_harmonics(problem, preload, tops, meter, how)
        else:
            error, enriched = _of_source(problem, source, preload, tops, meter, how)
        if error is not None:
            errors.append(replace(error, seconds=time.thread_time() - start))
        if enriched is not None:
            enriched_by[source] = enriched
    highest = tops.peaks[0]
    estimates = ErrorEstimates(
        preload,
        highest.frequency,
        highest.amplitude,
        tuple(errors),
        harmonic_peaks,
        meter.read(),
    )
    return Examination(estimates, enriched_by)


def _of_harmonics(
    problem: Problem, preload: float, tops: Tops, meter: CostMeter, how: How
) -> tuple[SourceError, Enriched | None, tuple[HarmonicPeak, ...]]:
    """Return the error of a peak by two steps of two more harmonics, the study of the last step, and
    the peaks with all numbers of harmonics.

    The error is the largest change of all steps, as that which comes with a peak, and may thus belong
    to another step than the study.  It is NaN if a step has no peak.  At an end of the interval
    there are no peaks.
    """
    own = tops.peaks[0]
    peaks = [HarmonicPeak(problem.harmonic_numbers[-1], own.amplitude, own.frequency)]
    error = SourceError("harmonics", np.nan, np.nan, np.inf, "")
    enriched = None
    here = problem
    here_tops = tops
    for _ in range(HARMONIC_STEPS):
        try:
            richer = _more_harmonics(here)
        except BdamperError as reason:
            if enriched is None:
                error = replace(error, against=str(reason))
            break
        solution = _watched_solution(here, richer.problem, preload, here_tops, meter, how)
        change = solution.change
        number = richer.problem.harmonic_numbers[-1]
        enriched = Enriched(*richer, solution.tops)
        if not change.known:
            peaks.append(HarmonicPeak(number, np.nan, np.nan))
            error = SourceError("harmonics", np.nan, np.nan, np.inf, change.how)
            break
        # relative to the peak of the study, not to the step before
        amplitude = (1.0 + change.amplitude) * peaks[-1].amplitude
        frequency = (1.0 + change.frequency) * peaks[-1].frequency
        peaks.append(HarmonicPeak(number, amplitude, frequency))
        latest = SourceError(
            "harmonics",
            amplitude=amplitude / own.amplitude - 1.0,
            frequency=frequency / own.frequency - 1.0,
            uncertainty=change.uncertainty,
            against=f"{richer.text}; {change.how}",
        )
        # a later step may return to the peak of the study although an earlier one left it
        if len(peaks) == 2 or abs(latest.amplitude) > abs(error.amplitude):
            error = latest
        if solution.tops is None:
            break
        here = richer.problem
        here_tops = solution.tops
    return error, enriched, () if tops.at_end or len(peaks) == 1 else tuple(peaks)


def _of_source(
    problem: Problem, source: str, preload: float, tops: Tops, meter: CostMeter, how: How
) -> tuple[SourceError | None, Enriched | None]:
    """Return the error of a peak from one source, and the study that shows it.

    Both are None if the source does not apply.
    """
    enriched = None
    try:
        if source == "residual flexibility":
            problem, tops = _with_three_harmonics(problem, preload, tops, meter, how)
        richer = richer_study(problem, source, all_vectors=not how.by_newton)
        if richer is None:
            return None, None
        # at an end of the interval another resonance may come in
        by_newton = how.by_newton and not tops.at_end
        way = How(by_newton, how.readings)
        solution = _watched_solution(problem, richer.problem, preload, tops, meter, way)
        change = solution.change
        text = f"{richer.text}; {change.how}" if change.known else change.how
        enriched = Enriched(*richer, solution.tops)
    except BdamperError as error:
        change = Change(how=str(error))
        text = change.how
        if source == "contact points":
            change, text = _of_fewer_points(problem, preload, tops, meter, text, how)
    error_of_source = SourceError(
        source, change.amplitude, change.frequency, change.uncertainty, text
    )
    return error_of_source, enriched


def _watched_solution(
    problem: Problem, other: Problem, preload: float, tops: Tops, meter: CostMeter, how: How
) -> Solution:
    """Compute the highest peak of another problem, and count its work."""
    if other.static(preload).ok:
        meter.watch(other.system(preload))
    return solve_other(problem, other, preload, tops, how.by_newton, how.readings)


def _of_fewer_points(
    problem: Problem, preload: float, tops: Tops, meter: CostMeter, no_finer: str, how: How
) -> tuple[Change, str]:
    """Return the error of all contact points of the model from a coarser set, and its origin.

    ``no_finer`` is the reason why there is no finer set.
    """
    n_present = problem.settings.most_points
    n_coarse = _fewer_points(problem)
    if n_coarse is None:
        return Change(how=no_finer), no_finer
    coarser = problem.replace(contact_points=n_coarse)
    change = _watched_solution(problem, coarser, preload, tops, meter, how).change
    if not change.known:
        text = f"{no_finer}; with {n_coarse}: {change.how}"
        return change, text
    # if n points have the error C/n, that of the coarser set is larger by this multiple of it
    growth = n_present / n_coarse - 1.0
    text = f"extrapolated from {n_coarse} and {n_present} contact points on a face"
    extrapolated = Change(
        amplitude=-change.amplitude / growth,
        frequency=-change.frequency / growth,
        uncertainty=change.uncertainty / growth,
        how=text,
    )
    return extrapolated, text


def _fewer_points(problem: Problem) -> int | None:
    """Return a smaller number of contact points, at least half; None if there is none.

    It keeps three rows along t1 and two along t2 if the face has them.
    """
    n_present = problem.settings.most_points
    if n_present <= ROWS:
        return None
    face = max(problem.settings.friction_faces, key=lambda face: face.n_points)
    needed = np.minimum(rows_of_points(face), (ROWS, 2))
    for n_coarse in range((n_present + 1) // 2, n_present):
        coarser = unite_face(face, n_coarse)
        if coarser.n_points == n_coarse and np.all(rows_of_points(coarser) >= needed):
            return n_coarse
    return None


def _of_time(
    problem: Problem, result: ResponseCurve | Peak, highest: Peak, meter: CostMeter
) -> SourceError:
    """Return the difference of a peak from time integration."""

    def unknown(reason: str) -> SourceError:
        return SourceError(
            TIME, amplitude=np.nan, frequency=np.nan, uncertainty=np.inf, against=reason
        )

    try:
        response = time_response.time_response(problem, result, progress=False)
    except BdamperError as error:
        return unknown(str(error))
    meter.add(response.cost)
    if not response.ok:
        return unknown(response.status_text)
    # relative changes; of the amplitude the larger one of both ends of its range
    lowest = response.lowest / highest.amplitude - 1.0
    highest_in_time = response.highest / highest.amplitude - 1.0
    amplitude = max(lowest, highest_in_time, key=abs)
    frequency = response.frequency / highest.frequency - 1.0
    how = f"time integration, {response.text}"
    return SourceError(TIME, amplitude, frequency, uncertainty=0.0, against=how)


def _with_three_harmonics(
    problem: Problem, preload: float, tops: Tops, meter: CostMeter, how: How
) -> tuple[Problem, Tops]:
    """Return a study with at least three harmonics, and its highest peaks."""
    if problem.harmonic_numbers[-1] >= 3 or not isinstance(problem.contact.residual, ResidualSet):
        return problem, tops
    richer = with_stand_ins(problem, 3)
    needs_peaks = how._replace(readings=False)
    solution = _watched_solution(problem, richer, preload, tops, meter, needs_peaks)
    if solution.tops is None:
        raise BdamperError(f"no peak with three harmonics: {solution.change.how}")
    return richer, replace(solution.tops, follow=tops.follow)


def richer_study(problem: Problem, source: str, all_vectors: bool = False) -> Richer | None:
    """Return a study that is more detailed in one respect; None if the source does not apply.

    With ``all_vectors`` it has all residual modes, instead of six more.

    Raises
    ------
    BdamperError
        If there is no such study; the message contains the reason.
    """
    more_detailed: dict[str, Callable[[Problem], Richer | None]] = {
        "harmonics": _more_harmonics,
        "contact_forces": _exact_events,
        "contact points": _more_points,
        "modes": _more_modes,
        "residual flexibility": _all_residual_modes if all_vectors else _more_residual_modes,
    }
    return more_detailed[source](problem)


def _more_harmonics(problem: Problem) -> Richer:
    """Return the study with two more harmonics."""
    richer = with_more_harmonics(problem)
    numbers = richer.harmonic_numbers
    has_no_gap = len(numbers) == numbers[-1]
    text = f"{numbers[-1]} harmonics" if has_no_gap else f"harmonics {listed(map(str, numbers))}"
    missing = missing_harmonics(problem, numbers[-1])
    if missing:
        text += f", with the modes of harmonic 1 for harmonic {missing[0]} and above"
    return Richer(richer, text)


def _exact_events(problem: Problem) -> Richer | None:
    """Return the study with exact contact forces, or more samples; None if they are exact."""
    sampling = problem.settings.contact_forces
    if not isinstance(sampling, AFT):
        return None
    try:
        return Richer(problem.replace(contact_forces="event_driven"), "exact events")
    except SettingError:  # coupled friction has no event-driven evaluation
        n_time = 4 * sampling.n_time
        return Richer(problem.replace(contact_forces=AFT(n_time)), f"{n_time} samples")


def _more_points(problem: Problem) -> Richer:
    """Return the study with all contact points of the model."""
    n_points = problem.settings.contact_points
    all_points = problem.settings.most_points
    if n_points is None or n_points >= all_points:
        raise BdamperError("the model has no more contact points")
    text = f"{all_points} contact points on a face"
    return Richer(problem.replace(contact_points=None), text)


def _more_modes(problem: Problem) -> Richer:
    """Return the study with all modes, or with residual modes with twice the modes."""
    settings = problem.settings
    blade_modes = settings.most_modes("constrained")
    present = settings.by_body("damper_modes")
    damper_modes = {name: problem.model.bodies[name].n_elastic for name in present}
    stiffness = settings.contact_stiffness
    if isinstance(stiffness, ResidualModes) or stiffness == "residual_modes":
        # residual modes represent the others already
        blade_modes = min(blade_modes, max(BLADE_MODES, 2 * settings.blade_modes))
        for name, most in damper_modes.items():
            damper_modes[name] = min(most, max(BLADE_MODES, 2 * present[name]))
    if blade_modes <= settings.blade_modes and damper_modes == present:
        raise BdamperError("the model has no more modes")
    text = f"{blade_modes} modes"
    counts = sorted(set(damper_modes.values()) - {0})
    if counts:
        text += f", {' and '.join(map(str, counts))} elastic modes of the damper"
    # one number is enough if all dampers have the same number
    several = len(set(damper_modes.values())) > 1
    replaced = problem.replace(
        blade_modes=max(blade_modes, settings.blade_modes),
        damper_modes=damper_modes if several else max(damper_modes.values(), default=0),
    )
    return Richer(replaced, text)


MOST_VECTORS = 72
"""Largest number of residual modes of a reference: those of three faces of eight points."""


def _more_residual_modes(problem: Problem) -> Richer | None:
    """Return the study with residual modes, or with six more of them; None if it has enough."""
    method = problem.stiffness_method
    if isinstance(method, str) and method in ("unit_traction", "cigeroglu2009"):
        return Richer(problem.replace(contact_stiffness="residual_modes"), "residual modes")
    has_number = isinstance(method, ResidualModes) and method.n_vectors != "all"
    if has_number and method.n_vectors + method.n_soft >= MOST_VECTORS:
        return None
    richer = with_soft_vectors(problem)
    if richer is None:
        return None
    has_all = richer.stiffness_method.n_vectors == "all"
    return Richer(
        richer, "all residual modes" if has_all else f"{SOFT_VECTORS} more residual modes"
    )


def _all_residual_modes(problem: Problem) -> Richer | None:
    """Return the study with residual modes, or with a mode for every contact force up to 72 of them;
    None if it has enough.
    """
    method = problem.stiffness_method
    if isinstance(method, str) and method == "residual_modes":
        method = ResidualModes()
    if not isinstance(method, ResidualModes):
        return _more_residual_modes(problem)
    if method.n_vectors == "all" or method.n_vectors + method.n_soft >= MOST_VECTORS:
        return None
    assert problem.contact.residual is not None
    n_forces = int(problem.contact.residual.active.sum())
    if n_forces <= MOST_VECTORS:
        richer = replace(method, n_vectors="all", n_soft=0)
        text = "all residual modes"
    else:
        n_soft = MOST_VECTORS - method.n_vectors
        richer = replace(method, n_soft=n_soft, partial_contact=False)
        text = f"{MOST_VECTORS} residual modes"
    return Richer(problem.replace(contact_stiffness=richer), text)
