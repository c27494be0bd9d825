"""Convergence of a peak with harmonics, and cost of accuracy over several settings.

Harmonic convergence
    With ``H`` harmonics a peak solves ``r_H(u, omega) = 0`` and ``phi_H = 0``, the derivative of
    the amplitude along the curve (``bdamper.response.peak``). Newton's method continues from the
    peak with fewer harmonics (:mod:`bdamper.response.richer_peak`), as for the error of every peak.
    At the new peak det J must have the same sign. This sign changes at every fold, so that a
    different sign indicates a different part of the curve. If this fails, half of the new harmonics
    are added first; if that fails too, the response curve with all of them is followed near the
    peak and its highest maximum is taken.

    A few equal results do not prove convergence, because a higher harmonic may be resonant. At its
    optimum the turbine blade has 75.3, 75.0, 75.0, 75.2 and 74.2 um with 3, 5, 7, 9 and 12
    harmonics, and 69.4 um with 16. The sequence therefore continues to the highest requested
    number. It stops earlier only

    * above the highest natural frequency in the equations of a reduced body; no resonance is
      possible there;
    * if the model has no modes of a nodal diameter;
    * if the last two changes are below a fifth of the tolerance and no later harmonic is near a
      stuck mode.

    At the optimum of a curve the peaks with more harmonics have all modes of the time integration,
    because the superharmonic resonances depend on them. At its optimum the turbine blade has 71.0
    um with 16 harmonics and all modes, and 69.4 um with 10 blade modes. Time integration with 1,024
    steps gives 70.8 to 72.0 um.

    A harmonic ``l`` is near a mode if ``l omega`` is within 5 % of a natural frequency with stuck
    contacts at its nodal diameter.

Cost of accuracy
    The most detailed combination of settings is the reference. It has an error itself, because it
    could be more detailed, and because other settings are not varied. For each source of error, a
    still more detailed study gives the change of the peak (:meth:`bdamper.Study.estimate_errors`).
    The sum of the changes is the uncertainty of the reference. If the model has no more detail, the
    last refinement of the setting replaces the change.

    Each setting is then reduced on its own, as long as its difference from the reference plus the
    uncertainty is within the tolerance. The cheapest of these values are combined. If the
    combination misses the tolerance, the setting with the largest individual difference is refined
    by one value.

    If the reference misses the tolerance, its settings are refined without computing: the source
    with the largest error takes the next step, until the sum is small enough. Each step leaves a
    fraction of the error (:data:`LEFT`), and the time grows with the square of the number of
    unknowns. On the turbine blade (200 N, friction coefficient 0.35) the reference has 107.0
    um, and the sum of the changes is 6.1 %. Twelve harmonics with all modes and 24 residual modes
    give 100.9 um.

    Amplitude and frequency of the highest peak are compared. Times are processor times of the
    analysis, without modes, contact stiffness and static state, which a study computes once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from threading import Event
from typing import Annotated, Any

import numpy as np

from bdamper.analyses.error_estimates import (
    READINGS,
    SOURCES,
    WIDER,
    PeakOutcome,
    evaluate_peak,
    examine,
    richer_study,
    whole_curve,
)
from bdamper.contact.laws import AFT
from bdamper.harmonic_balance.checks import check_question
from bdamper.harmonic_balance.effects import MAX_HARMONIC
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_boundary import StudyLike, in_type_of, problem_of
from bdamper.response.followed_peak import highest_peak
from bdamper.response.highest_peak import NEAR as NEAR_HIGHEST
from bdamper.response.highest_peak import found_at
from bdamper.response.linear_limits import peak_interval
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak, PeakOptions, check_peak
from bdamper.response.peak_error import HarmonicPeak
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.richer_peak import (
    missing_harmonics,
    nodal_diameter,
    richer_peaks,
    with_stand_ins,
)
from bdamper.response.verification import CONVERGED_SHARE, Convergence, Meeting
from bdamper.time_domain.time_response import structure_in_time
from bdamper.util import validation
from bdamper.util.display import Fact, Plottable, Result
from bdamper.util.errors import (
    INCOMPLETE,
    INTERRUPTED,
    NOT_FOUND,
    BdamperError,
    Ending,
    inside_user_code,
)
from bdamper.util.formatting import amount, peak_text, percent, short_repr, spaced
from bdamper.util.progress import (
    CostMeter,
    LongWork,
    is_part_of_work,
    one_thread,
    progress_stages,
    shows_progress,
    stopped_by,
)
from bdamper.util.statement import Statement
from bdamper.util.storage import FinishedParts, Storable
from bdamper.util.tables import Column, Cycles, Metre, Quantity, Second, Tabular, columns_of_rows
from bdamper.util.workers import on_threads

# ---- Harmonic convergence ----


HARMONICS = (5, 7, 9, 12, 16, 20, 26)
"""Highest harmonics of the default sequence."""
TOLERANCE = 0.05
"""Default relative tolerance of the amplitude."""
NEAR_MODE = 0.05
"""Relative distance within which a harmonic counts as near a stuck mode.

Slip and separation shift natural frequencies of the turbine blade by up to 3 %.
"""
NEARBY = 0.03
"""Relative half width of the interval in the search for a peak that Newton's method loses."""
NEARBY_BUDGET = 3000
"""Evaluations of a curve in this search."""
MOST_SEARCHES = 1
"""Such searches in the check of an optimum.

With 40 modes and 9 to 16 harmonics of the difficult disk each search takes longer than the optimal
curve.
"""
OPTIONS = PeakOptions(tolerance=1e-8, position_tolerance=1e-4, max_trials=24)
"""Tolerances of the peaks."""


@one_thread
def harmonic_convergence(
    problem: Problem,
    peak: Peak,
    *,
    harmonics: Sequence[int] = HARMONICS,
    tolerance: float = TOLERANCE,
    progress: bool | None = None,
) -> Convergence:
    """See :meth:`bdamper.Study.harmonic_convergence`."""
    check_peak(problem, peak)
    tolerance = validation.number("tolerance", tolerance, above=0.0, below=1.0)
    numbers = [validation.integer("harmonics", n, 1, MAX_HARMONIC) for n in harmonics]
    increasing = numbers == sorted(set(numbers))
    validation.check(increasing and numbers, "harmonics", "increasing numbers", numbers)
    return _converge(problem, peak, problem, numbers, tolerance, progress)


def _converge(
    problem: Problem,
    peak: Peak,
    structure: Problem,
    numbers: Sequence[int],
    tolerance: float,
    progress: bool | None,
    most_searches: int | None = None,
) -> Convergence:
    """Compute the peak of a problem, then those of a structure with increasing numbers of harmonics.

    ``structure`` is the problem itself, or the problem with more modes.  Where Newton's method does
    not reach a peak, it is searched on the response curve, in at most ``most_searches`` steps (None:
    in all).  Afterwards the step is left out, and the next one begins at the same peak.
    """
    highest = problem.harmonic_numbers[-1]
    meter = CostMeter()
    highest_useful, limit = _highest_useful(structure, peak.frequency, max(highest, numbers[-1]))
    new_numbers = {min(n, highest_useful) for n in numbers if n > highest} - {highest}
    problems, limit = _richer_problems(structure, sorted(new_numbers), limit)
    more_modes = bool(problems) and structure is not problem
    peaks = [HarmonicPeak(highest, peak.amplitude, peak.frequency)]
    end = Ending()
    n_searches = 0
    internal_resonances: tuple[Meeting, ...] = ()
    progress = shows_progress(progress)
    with LongWork() as work, progress_stages(progress, "harmonic convergence", "step") as report:
        richest = problems[-1] if problems else structure
        internal_resonances = tuple(_meetings(richest, peak))
        for i, richer in enumerate(problems):
            n = richer.harmonic_numbers[-1]
            report(f"{n} harmonics", i, len(problems))
            outcome = evaluate_peak(richer, partial(_by_newton, problem, peak, meter))
            if outcome.reason and (most_searches is None or n_searches < most_searches):
                n_searches += 1
                near = partial(_highest_near, peak, meter, outcome.reason)
                outcome = evaluate_peak(richer, near)
            if outcome.reason:
                end = Ending(
                    INCOMPLETE,
                    f"no peak was found near this one with {n} harmonics ({outcome.reason})",
                )
                if most_searches is None or len(peaks) == 1:
                    break
                continue
            # the next peak begins at this one
            end = Ending()
            problem = richer
            peak = outcome.result
            peaks.append(HarmonicPeak(n, outcome.amplitude, outcome.frequency, outcome.seconds))
            near_mode = any(m.harmonic > n for m in internal_resonances)
            if _converged(peaks, tolerance) and richer is not richest and not near_mode:
                limit = "no later harmonic is near a mode"
                break
    if work.interrupted:
        end = Ending(INTERRUPTED)
    return Convergence(
        preload=peak.parameter,
        tolerance=tolerance,
        peaks=tuple(peaks),
        internal_resonances=internal_resonances,
        highest_harmonic=limit,
        blade_modes=structure.settings.blade_modes if more_modes else 0,
        status=end.status,
        reason=end.reason,
        cost=meter.read(),
    )


def at_optimum(
    problem: Problem,
    curve: OptimalCurve,
    progress: bool = False,
    parts: FinishedParts | None = None,
) -> Convergence | None:
    """Compute the peak at the optimum of an optimal curve with up to 16 harmonics.

    The peaks with more harmonics have the modes of the time integration, or those of the study if
    none of them is found.  Return None without an optimum.
    """
    optimum = curve.optimum
    if not np.isfinite(optimum.preload):
        return None

    def converge() -> Convergence:
        peak = _peak_at_optimum(problem, curve)
        numbers = [n for n in HARMONICS if n <= 16]
        structure, _ = structure_in_time(problem, peak.frequency)
        convergence = _converge(
            problem, peak, structure, numbers, TOLERANCE, progress, MOST_SEARCHES
        )
        cost = convergence.cost
        none_found = convergence.status == INCOMPLETE and len(convergence.peaks) == 1
        if none_found and structure is not problem:
            # with the modes of the study the peak is nearer
            convergence = _converge(
                problem, peak, problem, numbers, TOLERANCE, progress, MOST_SEARCHES
            )
            cost = cost + convergence.cost
        if peak.cost is not None:
            cost = cost + peak.cost
        return replace(convergence, cost=cost)

    parts = parts or FinishedParts()
    end = Ending(INTERRUPTED)
    with LongWork():
        try:
            name = f"more harmonics at {optimum.preload!r} N"
            return parts.once(name, Convergence, converge)
        except BdamperError as error:
            end = Ending(NOT_FOUND, str(error))
    # without convergence, the peak of the optimal curve alone
    nominal = HarmonicPeak(problem.harmonic_numbers[-1], optimum.amplitude, optimum.frequency)
    return Convergence(optimum.preload, TOLERANCE, (nominal,), status=end.status, reason=end.reason)


def _peak_at_optimum(problem: Problem, curve: OptimalCurve) -> Peak:
    """Return the highest peak at the optimum of an optimal curve.

    It is searched only if the curve does not contain its unknowns.

    Raises
    ------
    BdamperError
        If it was not found, or its amplitude differs from the curve.
    """
    optimum = curve.optimum
    peak = curve.peak_at(optimum.preload)
    if peak is None:
        peak = highest_peak(problem, optimum.preload, tuple(curve.settings["frequency"]))
    if not peak.ok:
        raise BdamperError(f"the highest peak is {peak.status_text}")
    difference = abs(peak.amplitude / optimum.amplitude - 1.0)
    if not difference <= NEAR_HIGHEST:
        raise BdamperError(f"the highest peak there is {peak_text(peak.amplitude, peak.frequency)}")
    return peak


def with_convergence(
    problem: Problem,
    curve: OptimalCurve,
    work: Callable[[], OptimalCurve],
    progress: bool = False,
    parts: FinishedParts | None = None,
) -> OptimalCurve:
    """Process an optimal curve, and compute the convergence at its optimum at the same time.

    ``work`` returns the processed curve, and ``parts`` contain the convergence if it has ended.  The
    result is this curve with ``convergence``; its cost includes both, with their common elapsed
    time.
    """
    start = time.perf_counter()
    stop = Event()

    # a finished part survives an interrupt
    processed_curves: list[OptimalCurve] = []
    convergences: list[Convergence | None] = []

    def process_curve() -> None:
        processed = work()
        if processed.interrupted:
            stop.set()
        processed_curves.append(processed)

    def converge_at_optimum() -> None:
        with stopped_by(stop):
            convergences.append(at_optimum(problem, curve, progress, parts))

    was_interrupted = False
    try:
        on_threads([process_curve, converge_at_optimum])
    except KeyboardInterrupt:
        if not processed_curves or is_part_of_work():
            raise
        was_interrupted = True
    processed = processed_curves[0]
    if was_interrupted:
        # also if both parts had just ended
        processed = replace(processed, checks_interrupted=True)
    convergence = convergences[0] if convergences else None
    cost = processed.cost
    if convergence is not None:
        cost = cost + convergence.cost
    # both ran at the same time
    cost = replace(cost, seconds=curve.cost.seconds + time.perf_counter() - start)
    return replace(processed, convergence=convergence, cost=cost)


def _converged(peaks: Sequence[HarmonicPeak], tolerance: float) -> bool:
    """Return whether the last two changes are below a fifth of the tolerance.

    Fewer than three peaks have not converged.
    """
    if len(peaks) < 3:
        return False
    before, middle, last = (peak.amplitude for peak in peaks[-3:])
    limit = CONVERGED_SHARE * tolerance
    return abs(middle - before) / last < limit and abs(last - middle) / last < limit


def _richer_problems(
    problem: Problem, numbers: Sequence[int], limit: str
) -> tuple[list[Problem], str]:
    """Return the problem with all harmonics up to each number, and the reason why no more.

    Only odd harmonics are added if even harmonics vanish.  ``limit`` is the reason if all numbers
    are possible.
    """
    present = problem.harmonic_numbers
    # a constant normal load excites no even harmonics
    adds_even = problem.settings.variable_normal_load
    problems: list[Problem] = []
    highest = present[-1]
    for n in numbers:
        harmonics = []
        for l in range(1, n + 1):
            is_odd = l % 2 == 1
            if l in present or is_odd or adds_even:
                harmonics.append(l)
        obstacle = ""
        try:
            richer = problem.replace(harmonics=tuple(harmonics))
            # a new note says that contact forces are computed in another way
            if richer.contact.note != problem.contact.note:
                obstacle = richer.contact.note
        except BdamperError as error:
            obstacle = str(error)
        if obstacle:
            return problems, f"{n} harmonics are not possible with the same settings ({obstacle})"
        # an even number adds nothing to odd harmonics
        if richer.harmonic_numbers[-1] > highest:
            highest = richer.harmonic_numbers[-1]
            problems.append(richer)
    return problems, limit


def _highest_useful(problem: Problem, frequency: float, top: int) -> tuple[int, str]:
    """Return the highest useful harmonic up to ``top``, and the reason why no higher one is."""
    highest = problem.harmonic_numbers[-1]
    without_modes = missing_harmonics(problem, top)
    for l in range(highest + 1, top + 1):
        if l in without_modes:
            diameter = nodal_diameter(problem, l)
            return l - 1, f"the model has no modes of harmonic {l}, nodal diameter {diameter}"
        end = _highest_frequency(problem, l)
        if l * frequency > end:
            reached = f"{1e-3 * end:.3g} kHz, harmonic {int(end / frequency)}"
            return l - 1, f"the equations have no modes above {reached}"
    return top, ""


def _highest_frequency(problem: Problem, harmonic: int) -> float:
    """Return the highest frequency (Hz) in the equations of the reduced bodies for a harmonic.

    The harmonic determines the nodal diameter.  Without reduced bodies there is no limit.  With
    residual modes all modes of the model count, otherwise only the retained modes.
    """
    diameter = nodal_diameter(problem, harmonic)
    ends = [np.inf]
    for body in problem.model.bodies.values():
        if body.kind != "constrained":
            continue
        basis = body.bases[diameter]
        omega2 = basis.omega2[: basis.n_natural]
        if problem.contact.residual is None:
            omega2 = omega2[: problem.settings.blade_modes]
        ends.append(float(np.sqrt(omega2.max())) / (2.0 * np.pi))
    return min(ends)


def _meetings(problem: Problem, peak: Peak) -> Iterator[Meeting]:
    """Yield the harmonics near a mode with stuck contacts, each with the nearest mode."""
    case = problem.at(peak.parameter)
    springs = case.stuck_springs()
    # without the first harmonic, whose resonance is the peak
    for l in problem.harmonic_numbers[1:]:
        natural_omega, _ = case.sector.linear.modes(springs, l)
        frequency = natural_omega / (2.0 * np.pi)
        # the frequency of a rigid body mode is zero
        distance = l * peak.frequency / np.maximum(frequency, 1e-300) - 1.0
        nearest = int(np.argmin(np.abs(distance)))
        if abs(distance[nearest]) <= NEAR_MODE:
            diameter = problem.bases[l].nodal_diameter if problem.model.n_blades > 1 else -1
            yield Meeting(
                l,
                nearest + 1,  # modes are numbered from 1
                diameter,
                float(frequency[nearest]),
                float(distance[nearest]),
            )


def _highest_near(peak: Peak, meter: CostMeter, failure: str, problem: Problem) -> Peak:
    """Return the highest point of the response curve of a problem near a peak.

    ``failure`` is the reason for which Newton's method did not reach it.

    Raises
    ------
    BdamperError
        If the response curve there is not complete, with both reasons.
    """
    frequency = ((1.0 - NEARBY) * peak.frequency, (1.0 + NEARBY) * peak.frequency)
    highest = found_at(problem, peak.parameter, frequency, options=OPTIONS, budget=NEARBY_BUDGET)
    meter.count(highest.cost.iterations, highest.cost.failed_steps)
    end = highest.ending
    if highest.top is None or not end.ok:
        raise BdamperError(f"{failure}; the response curve near it is {end.status_text}")
    return highest.top.peak


def _by_newton(previous: Problem, peak: Peak, meter: CostMeter, problem: Problem) -> Peak:
    """Return the peak of a problem with more harmonics by Newton's method from a previous peak.

    Raises
    ------
    BdamperError
        If the method fails with all new harmonics, and with the first half of them.
    """
    preload = peak.parameter
    # without a static state there are no equations
    if problem.static(preload).ok:
        meter.watch(problem.system(preload))
    found = richer_peaks(previous, problem, preload, (peak,))
    meter.count(found.iterations)
    if found.peaks:
        return found.peaks[0]
    new = [l for l in problem.harmonic_numbers if l > previous.harmonic_numbers[-1]]
    if len(new) == 1:
        raise BdamperError(found.change.how)
    # half of the new harmonics first
    highest_of_half = new[len(new) // 2 - 1]
    harmonics = tuple(l for l in problem.harmonic_numbers if l <= highest_of_half)
    half = problem.replace(harmonics=harmonics)
    peak_of_half = _by_newton(previous, peak, meter, half)
    return _by_newton(half, peak_of_half, meter, problem)


# ---- Cost of accuracy ----


DEFAULT = ("harmonics", "contact_points", "blade_modes")
"""Settings that are varied by default."""
Solver = Callable[[Any, float, tuple[float, float]], ResponseCurve | Peak | tuple[float, float]]
"""Callable of study, preload (N) and frequency interval (Hz) that finds the highest peak.

It returns a response curve, a peak, or amplitude (m) and frequency (Hz), not finite if no peak was
found. It may raise a BdamperError.
"""
RICHEST = "most detailed"
"""Name of the most detailed run."""
COMBINED = "combination"
"""Name of runs in which several settings differ from the most detailed run.

All others have the name of the only setting that differs.
"""


SETTINGS_OF = {
    "harmonics": ("harmonics",),
    "contact_forces": ("contact_forces",),
    "contact points": ("contact_points",),
    "modes": ("blade_modes", "damper_modes"),
    "residual flexibility": ("contact_stiffness",),
}
"""Settings that control a source of error."""
LEFT = {
    "harmonics": 0.5,
    "contact_forces": 0.0,
    "contact points": 0.0,
    "modes": 0.125,
    "residual flexibility": 0.0,
}
"""Part of an error that a step to more detailed settings is assumed to leave.

Exact contact forces, all contact points of the model and all residual modes have no further step.
The error of modes decreases with the fourth power of a frequency, that of harmonics slowly where
contacts open.
"""


@dataclass(frozen=True)
class Run:
    """Result and cost of one combination of settings.

    Parameters
    ----------
    part : str
        "most detailed", "combination", or the name of the only setting that differs from the most
        detailed run.
    values : tuple of str
        Values of the varied settings.
    amplitude, frequency : float, m, Hz
        Amplitude and frequency of the highest peak; NaN if it was not found.
    difference : float
        Larger relative difference of amplitude and frequency from the most detailed run; NaN if
        unknown.
    seconds : float
        Processor time; NaN if the study does not allow these settings.
    reason : str
        Reason for a failure; empty otherwise.
    """

    part: Annotated[str, Quantity(name="reduced_setting")]
    values: tuple[str, ...]
    amplitude: Metre
    frequency: Cycles
    difference: float
    seconds: Second
    reason: str = ""


@dataclass(frozen=True)
class ReferenceError:
    """Error of the most detailed run due to one source, and the cost of reducing it.

    Parameters
    ----------
    source : str
        Member of ``SOURCES`` in ``bdamper/analyses/error_estimates.py``.
    size : float
        Relative change of the peak with still more detailed settings, as in
        :meth:`bdamper.Study.estimate_errors`; for a quantity of the user, plus the error that these
        settings are estimated to have (:data:`LEFT`).  NaN if unknown.
    seconds : float
        Processor time with these settings; NaN if they were not computed.
    against : str
        These settings, or the reason why they were not computed.
    needed : bool
        Whether an unknown size leaves the error of all runs unknown. It does not if the model has
        no more detail.
    """

    source: str
    size: float
    seconds: Second
    against: str
    needed: bool = True

    @property
    def known(self) -> bool:
        """Whether the size is known."""
        return bool(np.isfinite(self.size))


@dataclass(frozen=True)
class Forecast:
    """Settings expected to meet the tolerance, which were not computed.

    Parameters
    ----------
    settings : str
        Settings that differ from the most detailed run.
    error : float
        Estimated error.
    seconds : float
        Estimated processor time.
    """

    settings: str
    error: float
    seconds: Second


@short_repr
@dataclass(frozen=True)
class AccuracyCost(Result, Plottable, Tabular, Storable, kind="bdamper-accuracy"):
    """Errors and times of settings.

    The error of a run consists of its difference from the most detailed run and the uncertainty of
    that run. ``plot`` draws the error against the time (:func:`bdamper.plot.plot_accuracy`).

    Parameters
    ----------
    quantity : str
        Name of the solver; "curve" by default.
    preload : float, N
    interval : (low, high), Hz
    tolerance : float
    varied : tuple of str
        Names of the varied settings.
    runs : tuple of Run
        The most detailed run first.
    settings : mapping
        Settings of the study.
    interrupted : bool
        Whether Ctrl-C stopped the search before all required combinations were computed.
    sources : tuple of ReferenceError
        Errors of the most detailed run.
    forecast : Forecast, optional
        Settings that are expected to meet the tolerance if no run meets it; None if the model
        allows no such settings.
    """

    quantity: str
    preload: float
    interval: tuple[float, float]
    tolerance: float
    varied: tuple[str, ...]
    runs: tuple[Run, ...]
    settings: dict[str, Any] = field(default_factory=dict, compare=False)
    interrupted: bool = False
    sources: tuple[ReferenceError, ...] = ()
    forecast: Forecast | None = None

    def columns(self) -> dict[str, Column]:
        """Return one row for each run with its settings, highest peak, error and difference."""
        columns = {
            name: Column(np.array([run.values[i] for run in self.runs]))
            for i, name in enumerate(self.varied)
        }
        of_runs = columns_of_rows(self.runs)
        # the error and the time, which decide, come before the rest
        for name in ("reduced_setting", "amplitude"):
            columns[name] = of_runs.pop(name)
        columns["error"] = Column(np.array([self.error(run) for run in self.runs]))
        columns["seconds"] = of_runs.pop("seconds")
        return columns | of_runs

    def error(self, run: Run) -> float:
        """Return the relative error of a run; NaN if either of its two parts is unknown.

        It consists of its difference from the most detailed run and the uncertainty of that run.
        """
        return (1.0 + run.difference) * (1.0 + self.uncertainty) - 1.0

    @property
    def richest(self) -> Run:
        """Most detailed run, the reference of all differences."""
        return self.runs[0]

    @property
    def recommended(self) -> Run:
        """Cheapest run within the tolerance; the most detailed run if there is no other."""
        sufficient = [run for run in self.runs[1:] if self.error(run) <= self.tolerance]
        return min(sufficient, key=lambda run: run.seconds, default=self.richest)

    @property
    def reached(self) -> bool:
        """Whether the recommended run is within the tolerance."""
        return self.error(self.recommended) <= self.tolerance

    @property
    def last_steps(self) -> dict[str, float]:
        """For each setting, the change of the peak due to its last refinement; NaN if unknown."""
        return last_steps(self.varied, self.runs)

    @property
    def uncertainty(self) -> float:
        """Estimated error of the most detailed run, the sum over all sources; NaN if unknown.

        Sources that cannot be estimated because the model has no more detail are omitted. Without
        ``sources`` it is the sum of the last refinements.
        """
        if not self.sources:
            return float(sum(self.last_steps.values()))
        # a needed source of unknown size makes the sum NaN
        return float(sum(source.size for source in self.sources if source.known or source.needed))

    def _statement(self) -> Statement:
        remarks = [self._reference_text()]
        if np.isfinite(self.uncertainty):
            remarks.append(
                "Error of a reduced setting: this error plus its difference from the most detailed "
                "settings"
            )
        if not self.reached and np.isfinite(self.uncertainty):
            remarks.append(self._forecast_text())
        if self.interrupted:
            remarks.append("Interrupted: cheaper settings may suffice")
        table, further = self._few_rows()
        return Statement([self._answer_text()], remarks=[*further, *remarks], table=table)

    def _rows(self) -> list[tuple[str, ...]]:
        """Return the table, in which "none" is the reduced setting of the most detailed run."""
        return [
            tuple("none" if cell == RICHEST else cell for cell in row) for row in self.as_rows()
        ]

    def _answer_text(self) -> str:
        """Return a sentence on the cheapest settings within the tolerance."""
        best = self.recommended
        tolerance = percent(self.tolerance)
        if not np.isfinite(self.uncertainty):
            return f"Not known: the settings whose error is within {tolerance}"
        if not self.reached:
            return f"Not reached: no settings have an error within {tolerance}"
        if best is self.richest:
            return f"Only the most detailed settings have an error within {tolerance}"
        ratio = best.seconds / self.richest.seconds
        settings = _text(self.varied, best.values)
        error = percent(self.error(best))
        time = f"computing time is {ratio:.2g} times that of the most detailed settings"
        if ratio >= 1.0:
            return f"Nothing to save: with {settings} the error is {error}, but the {time}"
        return (
            f"Cheapest settings with an error below {tolerance}: {settings}; the error is {error}, the "
            f"{time}"
        )

    def _reference_text(self) -> str:
        """Return a sentence on the error of the most detailed settings, with its sources."""
        size = percent(self.uncertainty)
        parts = self._sources_text() if self.sources else "sum of the last refinements"
        bracket = f" ({parts})" if parts else ""
        return f"Estimated error of the most detailed settings: {size}{bracket}"

    def _sources_text(self) -> str:
        """Return the sources of error with their sizes, then those of unknown size."""
        estimated = sorted((s for s in self.sources if s.known), key=lambda s: -s.size)
        # small ones would hide those that count
        large = [s for s in estimated if s.size > 0.01 * self.uncertainty]
        unknown = [s for s in self.sources if not s.known]
        texts = []
        if large:
            texts.append(", ".join(f"{spaced(s.source)} {percent(s.size)}" for s in large))
        if unknown:
            texts.append("not estimated: " + ", ".join(spaced(s.source) for s in unknown))
        return "; ".join(texts)

    def _forecast_text(self) -> str:
        """Return what would reach a tolerance that was not reached."""
        if self.forecast is None:
            return "More detailed settings of this model are not expected to reach it either"
        seconds = amount(self.forecast.seconds, "s", 2)
        computed_seconds = amount(self.richest.seconds, "s", 2)
        return (
            f"Estimated error with {self.forecast.settings}: {percent(self.forecast.error)}, in "
            f"about {seconds} instead of {computed_seconds}"
        )

    def _facts(self) -> tuple[Fact, ...]:
        """Return a row for each source of error of the most detailed run."""
        return tuple(Fact(f"error of {spaced(s.source)}", _source_text(s)) for s in self.sources)

    def _table(self) -> list[tuple[str, ...]]:
        """Return the runs, because the first lines name the sources of error."""
        return self._rows()


def _source_text(source: ReferenceError) -> str:
    """Return size, origin and time of an error of the most detailed run."""
    size = percent(source.size) if source.known else "not estimated"
    if not source.against:
        return size
    seconds = f", {amount(source.seconds, 's')}" if np.isfinite(source.seconds) else ""
    return f"{size}: {source.against}{seconds}"


def last_steps(varied: Iterable[str], runs: Sequence[Run]) -> dict[str, float]:
    """For each setting, return the relative change of the peak due to its last refinement.

    The change is from the second most detailed to the most detailed value; NaN if unknown.
    """
    # of the runs of a setting, the first has its second most detailed value
    first_difference: dict[str, float] = {}
    for run in runs:
        first_difference.setdefault(run.part, run.difference)
    return {name: first_difference.get(name, float("nan")) for name in varied}


def _text(names: Iterable[str], values: Iterable[str]) -> str:
    """Return names with their values as text."""
    return ", ".join(f"{spaced(name)} = {value}" for name, value in zip(names, values))


def ladder_values(problem: Problem, name: str) -> list[Any]:
    """Return the default values of a setting, from the cheapest to the most detailed."""
    if name == "harmonics":
        return [n for n in (1, 3, 5) if not missing_harmonics(problem, n)]
    if name == "contact_points":
        all_points = problem.settings.most_points
        return [n for n in (9, 24, 48) if n < all_points] + [all_points]
    validation.choice("vary, without values", name, DEFAULT)
    all_modes = problem.settings.most_modes("constrained")
    return [n for n in (5, 10, 20) if n < all_modes] + [min(all_modes, 40)]


def make_ladders(problem: Problem, vary: Any) -> dict[str, dict[str, Any]]:
    """Return the values of each varied setting, from the least to the most detailed one.

    Each value has its printed name as key.

    Parameters
    ----------
    problem : Problem
    vary : str, sequence of str or mapping
        See :func:`accuracy_cost`.
    """
    names = _varied_names(problem, vary)
    if isinstance(names, Mapping):
        ladders = names
    else:
        ladders = {name: ladder_values(problem, name) for name in names}
    validation.check_value(ladders, "vary", "at least one setting of a study", names)
    settings = {f.name for f in fields(problem.settings)} - {"model"}
    ladders = validation.mapping("vary", ladders, settings, "settings of a study")
    for name, values in ladders.items():
        is_sequence = isinstance(values, Sequence | np.ndarray) and not isinstance(values, str)
        not_empty = is_sequence and len(values) > 0
        validation.check_value(not_empty, f"vary '{name}'", "a sequence of values", values)
    return {name: {_name(value): value for value in values} for name, values in ladders.items()}


def _varied_names(problem: Problem, vary: Any) -> Any:
    """Return the names of the varied settings, or the mapping of them to values."""
    if vary is None:
        # lumped masses have no modes to leave out
        reduced = problem.settings.most_modes("constrained") > 0
        return [name for name in DEFAULT if reduced or name != "blade_modes"]
    if isinstance(vary, str):
        return (vary,)
    validation.check_value(
        isinstance(vary, Iterable),
        "vary",
        "names of settings, or a mapping of them to values",
        vary,
    )
    return vary


def _name(value: Any) -> str:
    """Return the text of a value of a setting."""
    if isinstance(value, AFT):
        plain = "" if value.interpolate else ", plain"
        return f"{value.n_time} samples{plain}"
    if isinstance(value, tuple):
        return " ".join(map(str, value))
    return str(value)


def varied(problem: Problem, changes: Mapping[str, Any]) -> Problem:
    """Return the study with changed settings.

    Contact points are limited to the number in the model.
    """
    changes = dict(changes)
    if "harmonics" in changes:
        problem = with_stand_ins(problem, changes.pop("harmonics"))
    n_points = changes.get("contact_points")
    if n_points is not None and n_points >= problem.settings.most_points:
        changes["contact_points"] = None
    if not changes:
        return problem
    return problem.replace(**changes)


@dataclass
class _Runs:
    """Results of combinations of settings, each computed once."""

    problem: Problem
    ladders: Mapping[str, Mapping[str, Any]]
    solve: Callable[[Problem], Any]
    preload: float
    done: list[Run] = field(default_factory=list)
    # result of the solver with the most detailed settings, which are computed first
    reference_result: Any = None

    def at(self, part: str, indices: Mapping[str, int]) -> Run:
        """Return the run with the values at these indices."""
        names = tuple(list(values)[indices[name]] for name, values in self.ladders.items())
        for run in self.done:
            if run.values == names:
                return run
        try:
            outcome = self.evaluate(self.study(names), self.solve)
        except BdamperError as failure:  # the other runs are useful without this one
            outcome = PeakOutcome(
                amplitude=np.nan,
                frequency=np.nan,
                reason=str(failure),
                seconds=np.nan,
                result=None,
            )
        if not self.done:
            self.reference_result = outcome.result
        run = Run(
            part,
            names,
            outcome.amplitude,
            outcome.frequency,
            self.difference(outcome),
            outcome.seconds,
            outcome.reason,
        )
        self.done.append(run)
        return run

    def study(self, names: Sequence[str]) -> Problem:
        """Return the study with the values of these names."""
        changes = {
            setting: values[name] for (setting, values), name in zip(self.ladders.items(), names)
        }
        return varied(self.problem, changes)

    def evaluate(self, problem: Problem, solve: Callable[[Problem], Any]) -> PeakOutcome:
        """Solve for the highest peak, with its time.

        The time excludes the static state and the contact stiffness, which are computed before.
        """
        if problem.static(self.preload).ok:
            problem.system(self.preload)
        return evaluate_peak(problem, solve)

    def difference(self, outcome: PeakOutcome) -> float:
        """Return the larger relative difference of amplitude and frequency from the first run."""
        reference = self.done[0] if self.done else outcome
        amplitude = outcome.amplitude / reference.amplitude - 1.0
        frequency = outcome.frequency / reference.frequency - 1.0
        return float(max(abs(amplitude), abs(frequency)))

    def reference_error(
        self, source: str, solve: Callable[[Problem], Any]
    ) -> ReferenceError | None:
        """Return the change of the most detailed run by one step of a source.

        None if the source does not apply.
        """
        reference = self.done[0]
        own = self.study(reference.values)
        try:
            richer = richer_study(own, source, all_vectors=True)
        except BdamperError as limit:
            return ReferenceError(source, np.nan, np.nan, str(limit), needed=False)
        if richer is None:
            return None
        if isinstance(self.reference_result, ResponseCurve):
            (error,) = examine(own, self.reference_result, [source], how=READINGS).estimates.sources
            return ReferenceError(source, error.size, error.seconds, error.against)
        problem, text = richer
        try:
            outcome = self.evaluate(problem, solve)
        except BdamperError as failure:
            return ReferenceError(source, np.nan, np.nan, f"{text}: {failure}")
        if outcome.reason:
            return ReferenceError(source, np.nan, np.nan, f"{text}: {outcome.reason}")
        # relative to the better answer
        amplitude = reference.amplitude / outcome.amplitude - 1.0
        frequency = reference.frequency / outcome.frequency - 1.0
        step = max(abs(amplitude), abs(frequency))
        # a step of the user's quantity shows the part of the error that it does not leave
        size = step / (1.0 - LEFT[source])
        return ReferenceError(source, float(size), outcome.seconds, text)


@validation.check_arguments
@one_thread
def accuracy_cost(
    study: StudyLike | Problem,
    preload: float,
    frequency: tuple[float, float] | None = None,
    *,
    quantity: Solver | None = None,
    vary: str | Sequence[str] | Mapping[str, Any] | None = None,
    tolerance: float = 0.05,
    sources: Sequence[str] = SOURCES,
) -> AccuracyCost:
    """Find the cheapest combination of settings within a tolerance.

    The error of a combination is its difference from the most detailed combination plus the
    estimated error of the latter. If no combination meets the tolerance, the result names settings
    that are expected to meet it, with their time. Most of the time is spent on the most detailed
    combination and on the sources, especially if a damper is nearly loose.

    Parameters
    ----------
    problem : Problem
        Study with the settings that are not varied.
    preload : float, N
    frequency : (low, high), Hz, optional
        Interval of the peak; around the first mode by default.
    quantity : callable, optional
        Function of (study, preload, interval) that returns amplitude (m) and frequency (Hz), a peak
        or a response curve. By default the complete response curve is computed.
    vary : str, sequence of str or mapping, optional
        Settings with their values from the cheapest to the most detailed. "harmonics",
        "contact_points" and "blade_modes", the default, do not need values.
    tolerance : float
        Relative tolerance of amplitude and frequency.
    sources : sequence of str
        Sources for which the error of the most detailed combination is estimated; each requires a
        more detailed peak. If empty, the error is the sum of the last refinements.

    Returns
    -------
    AccuracyCost
        After Ctrl-C it contains the runs computed so far.

    Raises
    ------
    SettingError
        If a setting or a quantity is unknown.
    BdamperError
        If the most detailed combination has no peak.
    KeyboardInterrupt
        If the most detailed combination was interrupted.
    """
    validation.check_value(
        quantity is None or callable(quantity),
        "quantity",
        "a function of study, preload and interval",
        quantity,
    )
    problem = problem_of(study)
    tolerance = validation.number("tolerance", tolerance, above=0.0, below=1.0)
    sources = validation.names("sources", sources, SOURCES)
    preload = problem.check_preload(preload)
    low, high = map(float, peak_interval(problem.at(preload), frequency))
    ladders = make_ladders(problem, vary)
    check_question(problem, [preload], frequency)

    def solve(varied_problem: Problem) -> Any:
        if quantity is None:
            return whole_curve(varied_problem, preload, (low, high))
        with inside_user_code():
            return quantity(in_type_of(study, varied_problem), preload, (low, high))

    def solve_richer(richer: Problem) -> Any:
        if quantity is not None:
            return solve(richer)
        # the resonance may leave the interval
        return whole_curve(richer, preload, (low, high), wider=WIDER)

    runs = _Runs(problem, ladders, solve, preload)
    most_detailed = {name: len(values) - 1 for name, values in ladders.items()}
    errors: list[ReferenceError] = []
    n_evaluated = 0
    with LongWork() as work:
        _run_reference(runs, most_detailed)
        for source in sources:
            error = runs.reference_error(source, solve_richer)
            if error is not None:
                errors.append(_or_last_step(runs, most_detailed, error))
            n_evaluated += 1
        if sources:
            uncertainty = sum(error.size for error in errors if error.known)
        else:
            last_steps_of = [_one_step_cheaper(runs, most_detailed, name) for name in ladders]
            uncertainty = sum(run.difference for run in last_steps_of if run is not None)
        # if nothing is left for the settings, they are still compared with the reference
        allowed = (tolerance - uncertainty) / (1.0 + uncertainty)
        if not allowed > 0.0:
            allowed = tolerance
        _search(runs, most_detailed, allowed)
    if not runs.done:
        raise KeyboardInterrupt
    if work.interrupted:
        for source in sources[n_evaluated:]:
            errors.append(ReferenceError(source, np.nan, np.nan, INTERRUPTED))
    result = AccuracyCost(
        quantity="curve" if quantity is None else getattr(quantity, "__name__", "peak"),
        preload=preload,
        interval=(low, high),
        tolerance=tolerance,
        varied=tuple(ladders),
        runs=tuple(runs.done),
        settings=problem.record(None),
        interrupted=work.interrupted,
        sources=tuple(errors),
    )
    if result.reached or not errors:
        return result
    return replace(result, forecast=_forecast(runs.study(result.richest.values), result))


def _run_reference(runs: _Runs, most_detailed: Mapping[str, int]) -> None:
    """Run the most detailed settings.

    Raises
    ------
    BdamperError
        If they have no peak.
    """
    richest = runs.at(RICHEST, most_detailed)
    if np.isfinite(richest.difference):
        return
    text = f"{_text(runs.ladders, richest.values)}, at {runs.preload:g} N"
    reason = f" ({richest.reason})" if richest.reason else ""
    raise BdamperError(
        f"no peak with the most detailed settings, {text}{reason}: give less detailed ones in vary"
    )


def _one_step_cheaper(runs: _Runs, most_detailed: Mapping[str, int], name: str) -> Run | None:
    """Return the run with the second most detailed value of one setting, or None."""
    if most_detailed.get(name, 0) == 0:
        return None
    return runs.at(name, {**most_detailed, name: most_detailed[name] - 1})


def _or_last_step(
    runs: _Runs, most_detailed: Mapping[str, int], error: ReferenceError
) -> ReferenceError:
    """Return the last refinement of the settings of a source if no more detailed peak is known."""
    if error.known:
        return error
    cheaper_runs = [
        _one_step_cheaper(runs, most_detailed, name) for name in SETTINGS_OF[error.source]
    ]
    steps = [run for run in cheaper_runs if run is not None]
    if not steps:
        return error
    size = sum(step.difference for step in steps)
    if not np.isfinite(size):
        return error
    names = list(most_detailed)
    cheaper = ", ".join(
        f"{spaced(step.part)} {step.values[names.index(step.part)]}" for step in steps
    )
    return replace(error, size=size, against=f"{error.against}; last refinement, from {cheaper}")


def _search(runs: _Runs, most_detailed: Mapping[str, int], allowed: float) -> None:
    """Find the cheapest values whose difference from the reference is at most ``allowed``.

    Each setting is reduced alone, then the values are combined and refined.
    """
    indices = dict(most_detailed)
    difference: dict[tuple[str, int], float] = {}
    for name, last in most_detailed.items():
        difference[name, last] = 0.0
        for index in reversed(range(last)):
            difference[name, index] = runs.at(name, {**most_detailed, name: index}).difference
            if not difference[name, index] <= allowed:
                break
            indices[name] = index
    while indices != most_detailed:
        if runs.at(COMBINED, indices).difference <= allowed:
            return
        reduced = [name for name in most_detailed if indices[name] < most_detailed[name]]
        worst = max(reduced, key=lambda name: difference[name, indices[name]])
        indices[worst] += 1


def _forecast(problem: Problem, result: AccuracyCost) -> Forecast | None:
    """Refine the most detailed settings without computing them, until they meet the tolerance.

    Each step leaves the part :data:`LEFT` of the error of its source.
    """
    if not np.isfinite(result.uncertainty):
        return None
    size = {error.source: error.size for error in result.sources if error.known}
    seconds = result.richest.seconds
    settings: dict[str, str] = {}
    reducible = set(size)
    while sum(size.values()) > result.tolerance:
        if not reducible:
            return None
        worst = max(reducible, key=lambda source: size[source])
        try:
            richer = richer_study(problem, worst, all_vectors=True)
        except BdamperError:
            richer = None
        if richer is None:
            reducible.discard(worst)
            continue
        # Jacobians take most of the time, which grows with the square of the number of unknowns
        growth = richer.problem.n_unknowns / problem.n_unknowns
        seconds *= max(growth, 1.0) ** 2
        problem, settings[worst] = richer
        size[worst] *= LEFT[worst]
    return Forecast(", ".join(settings.values()), sum(size.values()), seconds)
