"""Convergence of a peak with harmonics, and cost of accuracy over several settings.

Harmonic convergence
    With ``H`` harmonics a peak solves ``r_H(u, omega) = 0`` and ``phi_H = 0``, the derivative of the amplitude along the
    curve (``bdamper.response.peak``). The initial guess is the peak with fewer harmonics; new harmonics are zero. Newton's
    method with line search solves at the phase of that peak, or at its frequency, then the peak is located. It must have
    the sign of det J of that peak. This sign changes at every fold: another sign is another part of the curve.
    If this fails, half of the new harmonics are added first; if that fails too, the response curve with all of them is
    followed near the peak and its highest maximum is taken.

    A few equal results do not prove convergence, since a higher harmonic may be resonant. At its optimum the turbine blade
    has 75.3, 75.0, 75.0, 75.2 and 74.2 um with 3, 5, 7, 9 and 12 harmonics, and 69.4 um with 16. The sequence therefore
    continues to the highest requested number. It stops earlier only

    * above the highest natural frequency in the equations of a reduced body, since no resonance is possible there;
    * if the model has no modes of a nodal diameter;
    * if the last two changes are below a fifth of the tolerance and no later harmonic is near a stuck mode.

    A harmonic ``l`` is near a mode if ``l omega`` is within 5 % of a natural frequency with stuck contacts at its nodal
    diameter.

Cost of accuracy
    The most detailed combination of settings is the reference. It has an error itself, because the settings end
    somewhere, and because others are not varied. For each source of error a study that is still more detailed gives the
    change of the peak (:meth:`bdamper.Study.estimate_errors`). The sum of the changes is the uncertainty of the
    reference. Where the model has no more detail, the last refinement of the setting replaces the change.

    Each setting alone is then reduced as long as its difference from the reference, together with the uncertainty, is
    within the tolerance. The cheapest of these values are combined. If the combination misses the tolerance, the setting
    with the largest individual difference is refined by one value.

    If the reference misses the tolerance, its settings are refined without computing: the source with the largest error
    takes the next step, until the sum is small enough. A step leaves a part of the error (:data:`LEFT`), and the time
    grows by the factor of the computed step. On the turbine blade (200 N, friction coefficient 0.35) the reference has
    107.0 um, and the sum of the changes is 6.1 %. Twelve harmonics with all modes and 24 residual modes give 100.9 um.

    Amplitude and frequency of the highest peak are compared. Times are processor times of the
    analysis, without modes, contact stiffness and static state, which a study computes once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields, replace
from functools import partial
from threading import Event
from typing import Any

import numpy as np

from bdamper.analyses.error_estimates import (
    SOURCES,
    WIDER,
    PeakOutcome,
    embed,
    evaluate_peak,
    missing_harmonics,
    nodal_diameter,
    richer_study,
    whole_curve,
    with_stand_ins,
)
from bdamper.contact.laws import AFT
from bdamper.harmonic_balance.checks import Asking, check_question, like, problem_of
from bdamper.harmonic_balance.effects import MAX_HARMONIC
from bdamper.harmonic_balance.problem import Problem
from bdamper.response.highest_peak import NEAR as NEAR_HIGHEST
from bdamper.response.highest_peak import found_at, highest_peak
from bdamper.response.linear_limits import peak_interval
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak, PeakOptions, check_peak, peak_of_sign, sign_of_jacobian
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import Convergence, HarmonicPeak, Meeting
from bdamper.util import validation
from bdamper.util.display import Fact, Plottable
from bdamper.util.errors import (
    COMPLETE,
    INCOMPLETE,
    INTERRUPTED,
    NOT_FOUND,
    BdamperError,
    inside_user_code,
    with_reason,
)
from bdamper.util.formatting import amount, peak_text, percent, short_repr, spaced
from bdamper.util.progress import (
    CostMeter,
    LongWork,
    one_thread,
    progress_stages,
    shows_progress,
    stopped_by,
)
from bdamper.util.storage import Storable
from bdamper.util.tables import Column, Cycles, Metre, Second, Tabular, columns_of_rows

# ---- Harmonic convergence ----


HARMONICS = (5, 7, 9, 12, 16, 20, 26)
"""Highest harmonics of the default sequence."""
TOLERANCE = 0.05
"""Default relative tolerance of the amplitude."""
NEAR_MODE = 0.05
"""Relative distance within which a harmonic counts as near a stuck mode.

Slip and separation shift natural frequencies of the turbine blade by up to 3 %.
"""
NEARBY, NEARBY_BUDGET = 0.03, 3000
"""Relative half width of the interval, and evaluations of a curve, in the search for a peak that Newton's method loses."""
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
    validation.check(
        numbers == sorted(set(numbers)) and numbers, "harmonics", "increasing numbers", numbers
    )
    highest = problem.harmonic_numbers[-1]
    meter = CostMeter()
    most, limit = _most(problem, peak.frequency, max(highest, numbers[-1]))
    problems, limit = _richer(
        problem, sorted({min(n, most) for n in numbers if n > highest} - {highest}), limit
    )
    peaks, status = [HarmonicPeak(highest, peak.amplitude, peak.frequency)], COMPLETE
    internal_resonances: tuple[Meeting, ...] = ()
    progress = shows_progress(progress)
    with LongWork() as work, progress_stages(progress, "harmonic convergence", "step") as report:
        internal_resonances = tuple(_meetings(([problem] + problems)[-1], peak))
        for i, richer in enumerate(problems):
            n = richer.harmonic_numbers[-1]
            report(f"{n} harmonics", i, len(problems))
            outcome = evaluate_peak(richer, partial(_near_or_highest, problem, peak, meter))
            if outcome.reason:
                status = with_reason(
                    INCOMPLETE,
                    f"no peak was found near this one with {n} harmonics ({outcome.reason})",
                )
                break
            problem, peak = richer, outcome.result
            peaks.append(HarmonicPeak(n, outcome.amplitude, outcome.frequency, outcome.seconds))
            near_mode = any(m.harmonic > n for m in internal_resonances)
            if _converged(peaks, tolerance) and richer is not problems[-1] and not near_mode:
                limit = "no later harmonic is near a mode"
                break
    status = INTERRUPTED if work.interrupted else status
    return Convergence(
        peak.parameter, tolerance, tuple(peaks), internal_resonances, limit, status, meter.read()
    )


def at_optimum(problem: Problem, curve: OptimalCurve, progress: bool = False) -> Convergence | None:
    """Compute the peak at the optimum of an optimal curve with up to 16 harmonics; return None without an optimum."""
    best, convergence, status = curve.optimum, None, INTERRUPTED
    if not np.isfinite(best.preload):
        return None
    with LongWork():
        try:
            peak = highest_peak(problem, best.preload, tuple(curve.settings["frequency"]))
            if not peak.converged:
                raise BdamperError(f"the highest peak is {peak.status}")
            if not abs(peak.amplitude / best.amplitude - 1.0) <= NEAR_HIGHEST:
                raise BdamperError(
                    f"the highest peak there is {peak_text(peak.amplitude, peak.frequency)}"
                )
            numbers = [n for n in HARMONICS if n <= 16]
            convergence = harmonic_convergence(problem, peak, harmonics=numbers, progress=progress)
            convergence = replace(
                convergence,
                cost=convergence.cost if peak.cost is None else convergence.cost + peak.cost,
            )
        except BdamperError as error:
            status = with_reason(NOT_FOUND, error)
    known = HarmonicPeak(problem.harmonic_numbers[-1], best.amplitude, best.frequency)
    return convergence or Convergence(best.preload, TOLERANCE, (known,), status=status)


def with_convergence(
    problem: Problem, curve: OptimalCurve, work: Callable[[], OptimalCurve], progress: bool = False
) -> OptimalCurve:
    """Run work on an optimal curve and, on a second thread, the harmonic convergence at its optimum.

    ``work`` returns the processed curve.  The result is this curve with ``convergence``; its cost includes both, with their
    common elapsed time.
    """
    start, stop = time.perf_counter(), Event()
    with ThreadPoolExecutor(1) as pool:
        more = pool.submit(stopped_by(stop)(at_optimum), problem, curve, progress)
        try:
            processed = work()
            if any(k.status == INTERRUPTED for k in processed.time_response):
                stop.set()
            convergence = more.result()
            whole = processed.cost if convergence is None else processed.cost + convergence.cost
            whole = replace(whole, seconds=curve.cost.seconds + time.perf_counter() - start)
            return replace(processed, convergence=convergence, cost=whole)
        finally:
            stop.set()


def _converged(peaks: Sequence[HarmonicPeak], tolerance: float) -> bool:
    """Return whether the last two changes are below a fifth of the tolerance."""
    amplitude = [p.amplitude for p in peaks[-3:]]
    change = np.abs(np.diff(amplitude)) / amplitude[-1]
    return len(change) == 2 and bool(change.max() < 0.2 * tolerance)


def _richer(
    problem: Problem, numbers: Sequence[int], highest_harmonic: str
) -> tuple[list[Problem], str]:
    """Return the problem with all harmonics up to each number, and the reason why there are no more.

    Only odd harmonics are added if even harmonics vanish.
    """
    known, odd = problem.harmonic_numbers, not problem.settings.variable_normal_load
    problems: list[Problem] = []
    for n in numbers:
        harmonics = tuple(l for l in range(1, n + 1) if l in known or l % 2 or not odd)
        try:
            richer = problem.replace(harmonics=harmonics)
            note = "" if richer.contact.note == problem.contact.note else richer.contact.note
        except BdamperError as error:
            note = str(error)
        if note:
            return problems, f"{n} harmonics are not possible with the same settings ({note})"
        if richer.harmonic_numbers[-1] > (problems or [problem])[-1].harmonic_numbers[-1]:
            problems.append(richer)
    return problems, highest_harmonic


def _most(problem: Problem, frequency: float, top: int) -> tuple[int, str]:
    """Return the highest useful harmonic up to ``top``, and the reason why no higher one is useful."""
    highest = problem.harmonic_numbers[-1]
    lacking = missing_harmonics(problem, top)
    for l in range(highest + 1, top + 1):
        if l in lacking:
            return (
                l - 1,
                f"the model has no modes of harmonic {l}, nodal diameter {nodal_diameter(problem, l)}",
            )
        end = _end(problem, l)
        if l * frequency > end:
            return (
                l - 1,
                f"the equations have no modes above {1e-3 * end:.3g} kHz, harmonic {int(end / frequency)}",
            )
    return top, ""


def _end(problem: Problem, harmonic: int) -> float:
    """Return the highest frequency (Hz) in the equations of the reduced bodies at the nodal diameter of a harmonic.

    With residual modes all modes of the model count, otherwise only the retained modes.
    """
    d, ends = nodal_diameter(problem, harmonic), [np.inf]
    for name, body in problem.model.bodies.items():
        if body.kind == "constrained":
            omega2 = body.bases[d].omega2[: body.bases[d].n_natural]
            retained = (
                omega2
                if problem.contact.residual is not None
                else omega2[: problem.settings.blade_modes]
            )
            ends.append(float(np.sqrt(retained.max())) / (2.0 * np.pi))
    return min(ends)


def _meetings(problem: Problem, peak: Peak) -> Iterator[Meeting]:
    """Yield the harmonics of the problem near a mode with stuck contacts, each with the nearest mode."""
    case = problem.at(peak.parameter)
    springs = case.stuck_springs()
    for l in problem.harmonic_numbers[1:]:
        modes = case.sector.linear.modes(springs, l)[0] / (2.0 * np.pi)
        distance = l * peak.frequency / np.maximum(modes, 1e-300) - 1.0
        k = int(np.argmin(np.abs(distance)))
        if abs(distance[k]) <= NEAR_MODE:
            diameter = problem.bases[l].nodal_diameter if problem.model.n_blades > 1 else -1
            yield Meeting(l, k + 1, diameter, float(modes[k]), float(distance[k]))


def _near_or_highest(known: Problem, peak: Peak, meter: CostMeter, problem: Problem) -> Peak:
    """Return the peak of a problem with more harmonics by Newton's method, or the highest of its curve near the known one.

    Raises
    ------
    BdamperError
        If both fail, with the reason of the first.
    """
    try:
        return _richer_peak(
            known, peak, sign_of_jacobian(known.system(peak.parameter), peak.y), meter, problem
        )
    except BdamperError as error:
        frequency = ((1.0 - NEARBY) * peak.frequency, (1.0 + NEARBY) * peak.frequency)
        highest = found_at(
            problem, peak.parameter, frequency, options=OPTIONS, budget=NEARBY_BUDGET
        )
        meter.count(highest.cost.iterations, highest.cost.failed_steps)
        if highest.top is None or highest.status != COMPLETE:
            raise BdamperError(f"{error}; near it the response curve is {highest.status}") from None
        return highest.top.peak


def _richer_peak(known: Problem, peak: Peak, sign: int, meter: CostMeter, problem: Problem) -> Peak:
    """Return the peak of a problem with more harmonics, from a known peak.

    Raises
    ------
    BdamperError
        If Newton's method fails with all new harmonics, and with the first half of them.
    """
    preload = peak.parameter
    system = problem.system(preload)
    meter.watch(system)
    guess = embed(known, problem, preload, peak.y)
    solution, iterations = peak_of_sign(system, guess, sign, options=OPTIONS, parameter=preload)
    meter.count(iterations)
    if isinstance(solution, Peak):
        return solution
    new = [l for l in problem.harmonic_numbers if l > known.harmonic_numbers[-1]]
    if len(new) == 1:
        raise BdamperError(solution)
    half = problem.replace(
        harmonics=tuple(l for l in problem.harmonic_numbers if l <= new[len(new) // 2 - 1])
    )
    return _richer_peak(half, _richer_peak(known, peak, sign, meter, half), sign, meter, problem)


# ---- Cost of accuracy ----


DEFAULT = ("harmonics", "contact_points", "blade_modes")
"""Settings that are varied by default."""
Solver = Callable[[Any, float, tuple[float, float]], ResponseCurve | Peak | tuple[float, float]]
"""Callable of study, preload (N) and frequency interval (Hz) that finds the highest peak.

It returns a response curve, a peak, or amplitude (m) and frequency (Hz), not finite if no peak was found. It may raise a
BdamperError.
"""
RICHEST, COMBINED = "richest", "combination"
"""Kinds of runs; all others are named after the only setting that differs from the most detailed run."""


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

Exact contact forces, all contact points of the model and all residual modes have no further step. The error of modes
decreases with the fourth power of a frequency, that of harmonics slowly where contacts open.
"""


@dataclass(frozen=True)
class Run:
    """Result and cost of one combination of settings.

    Parameters
    ----------
    part : str
        "richest", "combination", or the name of the only setting that differs from the most detailed run.
    values : tuple of str
        Values of the varied settings.
    amplitude, frequency : float, m, Hz
        Highest peak; NaN if it was not found.
    difference : float
        Larger relative difference of amplitude and frequency from the most detailed run; NaN if unknown.
    seconds : float
        Processor time; NaN if the study does not allow these settings.
    reason : str
        Reason of a failure; empty otherwise.
    """

    part: str
    values: tuple[str, ...]
    amplitude: Metre
    frequency: Cycles
    difference: float
    seconds: Second
    reason: str = ""


@dataclass(frozen=True)
class ReferenceError:
    """Error of the most detailed run from one source, and the cost of its reduction.

    Parameters
    ----------
    source : str
        Member of ``SOURCES`` in ``bdamper/analyses/error_estimates.py``.
    size : float
        Difference from the peak with settings that are still more detailed, with the part that they leave
        (:data:`LEFT`); NaN if unknown.
    seconds : float
        Processor time with these settings; NaN if they were not computed.
    against : str
        These settings, or the reason why they were not computed.
    needed : bool
        Whether an unknown size leaves the error of all runs unknown. It does not if the model has no more detail.
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
        Changes from the most detailed run.
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
class AccuracyCost(Plottable, Tabular, Storable, kind="bdamper-accuracy"):
    """Errors and times of settings.

    The error of a run consists of its difference from the most detailed run and the uncertainty of that run. ``plot`` draws
    error over time (:func:`bdamper.plot.plot_accuracy`).

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
        Settings that are expected to meet the tolerance if no run meets it; None if no settings of the model are.
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
        """Return one row for each run with its settings, its highest peak, its error and its difference."""
        values = {
            name: Column(np.array([run.values[i] for run in self.runs]))
            for i, name in enumerate(self.varied)
        }
        out = values | columns_of_rows(self.runs)
        errors = Column(np.array([self.error(run) for run in self.runs]))
        # the error first, because it counts
        last = {name: out.pop(name) for name in ("difference", "seconds", "reason")}
        return out | {"error": errors} | last

    def error(self, run: Run) -> float:
        """Return the error of a run: its difference from the most detailed run and the uncertainty of the latter."""
        return (1.0 + run.difference) * (1.0 + self.uncertainty) - 1.0

    @property
    def richest(self) -> Run:
        """Most detailed run, the reference of all differences."""
        return self.runs[0]

    @property
    def recommended(self) -> Run:
        """Cheapest run within the tolerance; the most detailed run if there is no other."""
        good = [r for r in self.runs[1:] if self.error(r) <= self.tolerance]
        return min(good, key=lambda r: r.seconds, default=self.richest)

    @property
    def reached(self) -> bool:
        """Whether the recommended run is within the tolerance."""
        return self.error(self.recommended) <= self.tolerance

    @property
    def last_steps(self) -> dict[str, float]:
        """Difference of the second most detailed value of each setting; NaN if unknown."""
        return last_steps(self.varied, self.runs)

    @property
    def uncertainty(self) -> float:
        """Estimated error of the most detailed run: the sum over all sources; NaN if the size of one is unknown.

        Sources that cannot be estimated because the model has no more detail are omitted. Without ``sources`` it is the sum
        of the last refinements.
        """
        if not self.sources:
            return float(sum(self.last_steps.values()))
        return float(sum(source.size for source in self.sources if source.known or source.needed))

    def _headline(self) -> str:
        best, richest, tolerance = self.recommended, self.richest, percent(self.tolerance)
        if not np.isfinite(self.uncertainty):
            head = f"It is not known which settings meet {tolerance}."
        elif not self.reached:
            head = f"Not reached: {tolerance}."
        elif best is richest:
            head = f"Only the most detailed settings meet {tolerance}."
        else:
            ratio = best.seconds / richest.seconds
            cost = f"error {percent(self.error(best))} in {ratio:.2g} of the time of the most detailed settings"
            head = f"For {tolerance}: {_text(self.varied, best.values)}, {cost}."
        ended = " Interrupted: other runs may suffice." if self.interrupted else ""
        return f"{head} {self._reference_text()}{self._forecast_text()}{ended}"

    def _reference_text(self) -> str:
        """Return a sentence on the error of the most detailed settings, with its sources."""
        if self.sources:
            known = sorted((s for s in self.sources if s.known), key=lambda s: -s.size)
            named = ", ".join(
                f"{spaced(s.source)} {percent(s.size)}"
                for s in known
                if s.size > 0.01 * self.uncertainty
            )
            unknown = ", ".join(spaced(s.source) for s in self.sources if not s.known)
            parts = "; ".join(
                text for text in (named, f"not estimated: {unknown}" if unknown else "") if text
            )
        else:
            parts = "sum of the last refinements"
        amount_of_error = percent(self.uncertainty)
        return f"Estimated error of the most detailed settings: {amount_of_error}{f' ({parts})' if parts else ''}."

    def _forecast_text(self) -> str:
        """Return what would reach a tolerance that was not reached."""
        if self.reached or not np.isfinite(self.uncertainty):
            return ""
        if self.forecast is None:
            return " No more detailed settings of this model are expected to reach it."
        settings = self.forecast.settings[:1].upper() + self.forecast.settings[1:]
        times = f"{amount(self.forecast.seconds, 's', 2)} instead of {amount(self.richest.seconds, 's', 2)}"
        return f" {settings} would leave an estimated {percent(self.forecast.error)}, in about {times}."

    def _facts(self) -> tuple[Fact, ...]:
        """Return a row for each source of error of the most detailed run."""
        return tuple(Fact(f"error of {spaced(s.source)}", _source_text(s)) for s in self.sources)

    def _table(self) -> list[tuple[str, ...]]:
        """Return the runs, because the first lines name the sources of error."""
        return self._rows()


def _source_text(source: ReferenceError) -> str:
    """Return size, origin and time of an error of the most detailed run."""
    size = percent(source.size) if source.known else "not estimated"
    seconds = f", {amount(source.seconds, 's')}" if np.isfinite(source.seconds) else ""
    return f"{size}: {source.against}{seconds}" if source.against else size


def last_steps(varied: Iterable[str], runs: Sequence[Run]) -> dict[str, float]:
    """Return the difference of the second most detailed value of each setting from the reference; NaN if unknown."""
    first = {run.part: run.difference for run in reversed(runs)}
    return {name: first.get(name, float("nan")) for name in varied}


def _text(names: Iterable[str], values: Iterable[str]) -> str:
    return ", ".join(f"{spaced(n)} {v}" for n, v in zip(names, values))


def ladder_values(problem: Problem, name: str) -> list[Any]:
    """Return the default values of a setting from the cheapest to the most detailed that the model allows."""
    if name == "harmonics":
        return [n for n in (1, 3, 5) if not missing_harmonics(problem, n)]
    if name == "contact_points":
        full = problem.settings.most_points
        return [n for n in (9, 24, 48) if n < full] + [full]
    validation.choice("vary, without values", name, DEFAULT)
    most = problem.settings.most_modes("constrained")
    return [n for n in (5, 10, 20) if n < most] + [min(most, 40)]


def make_ladders(problem: Problem, vary: Any) -> dict[str, dict[str, Any]]:
    """Return the values of each varied setting by their names, from the cheapest to the most detailed.

    Parameters
    ----------
    problem : Problem
    vary : str, sequence of str or mapping
        See :func:`accuracy_cost`.
    """
    reduced = (
        problem.settings.most_modes("constrained") > 0
    )  # lumped masses have no modes to leave out
    default = [name for name in DEFAULT if reduced or name != "blade_modes"]
    vary = default if vary is None else (vary,) if isinstance(vary, str) else vary
    validation.check_value(
        isinstance(vary, Iterable),
        "vary",
        "names of settings, or a mapping of them to values",
        vary,
    )
    named = (
        vary if isinstance(vary, Mapping) else {name: ladder_values(problem, name) for name in vary}
    )
    validation.check_value(named, "vary", "at least one setting of a study", vary)
    known = {f.name for f in fields(problem.settings)} - {"model"}
    for name, values in validation.mapping("vary", named, known, "settings of a study").items():
        several = (
            isinstance(values, Sequence | np.ndarray)
            and not isinstance(values, str)
            and len(values)
        )
        validation.check_value(several, f"vary '{name}'", "a sequence of values", values)
    return {name: {_name(value): value for value in values} for name, values in named.items()}


def _name(value: Any) -> str:
    if isinstance(value, AFT):
        return f"{value.n_time} samples" + ("" if value.interpolate else ", plain")
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def varied(problem: Problem, changes: Mapping[str, Any]) -> Problem:
    """Return the study with changed settings; contact points are limited to the number in the model."""
    changes = dict(changes)
    if "harmonics" in changes:
        problem = with_stand_ins(problem, changes.pop("harmonics"))
    points = changes.get("contact_points")
    if points is not None and points >= problem.settings.most_points:
        changes["contact_points"] = None
    return problem.replace(**changes) if changes else problem


@dataclass
class _Runs:
    """Results of combinations of settings, each computed once."""

    problem: Problem
    ladders: Mapping[str, Mapping[str, Any]]
    solve: Callable[[Problem], Any]
    preload: float
    done: list[Run] = field(default_factory=list)

    def at(self, part: str, indices: Mapping[str, int]) -> Run:
        """Return the run with the values at these indices."""
        names = tuple(list(values)[indices[name]] for name, values in self.ladders.items())
        same = next((r for r in self.done if r.values == names), None)
        if same is not None:
            return same
        try:
            outcome = self.evaluate(self.study(names), self.solve)
        except BdamperError as failure:  # the other runs are useful without this one
            outcome = PeakOutcome(np.nan, np.nan, str(failure), np.nan, None)
        difference = self.difference(outcome)
        run = Run(
            part,
            names,
            outcome.amplitude,
            outcome.frequency,
            difference,
            outcome.seconds,
            outcome.reason,
        )
        self.done.append(run)
        return run

    def study(self, names: Sequence[str]) -> Problem:
        """Return the study with the values of these names."""
        values = {
            setting: known[name] for (setting, known), name in zip(self.ladders.items(), names)
        }
        return varied(self.problem, values)

    def evaluate(self, problem: Problem, solve: Callable[[Problem], Any]) -> PeakOutcome:
        """Solve for the highest peak, without the time of the static state and the contact stiffness."""
        if problem.static(self.preload).converged:
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
        """Return the change of the most detailed run by one step of a source; None if the source does not apply."""
        try:
            richer = richer_study(self.study(self.done[0].values), source)
        except BdamperError as limit:
            return ReferenceError(source, np.nan, np.nan, str(limit), needed=False)
        if richer is None:
            return None
        problem, text = richer
        try:
            outcome = self.evaluate(problem, solve)
        except BdamperError as failure:
            return ReferenceError(source, np.nan, np.nan, f"{text}: {failure}")
        if outcome.reason:
            return ReferenceError(source, np.nan, np.nan, f"{text}: {outcome.reason}")
        # relative to the better answer
        amplitude = self.done[0].amplitude / outcome.amplitude - 1.0
        frequency = self.done[0].frequency / outcome.frequency - 1.0
        step = max(abs(amplitude), abs(frequency))
        # a step shows the part of the error that it does not leave
        size = step / (1.0 - LEFT[source])
        return ReferenceError(source, float(size), outcome.seconds, text)


@validation.check_arguments
@one_thread
def accuracy_cost(
    study: Asking | Problem,
    preload: float,
    frequency: tuple[float, float] | None = None,
    *,
    quantity: Solver | None = None,
    vary: str | Sequence[str] | Mapping[str, Any] | None = None,
    tolerance: float = 0.05,
    sources: Sequence[str] = SOURCES,
) -> AccuracyCost:
    """Find the cheapest combination of settings within a tolerance.

    The error of a combination is its difference from the most detailed combination plus the error of the latter, by
    ``sources``. If no combination meets the tolerance, the result names settings that are expected to meet it, with their
    time. The most detailed combination and the sources take most of the time, especially if a damper is nearly loose.

    Parameters
    ----------
    problem : Problem
        Study with the settings that are not varied.
    preload : float, N
    frequency : (low, high), Hz, optional
        Interval of the peak; around the first mode by default.
    quantity : callable, optional
        Function of (study, preload, interval) that returns amplitude (m) and frequency (Hz), a peak or a response curve. By
        default the complete response curve is computed.
    vary : str, sequence of str or mapping, optional
        Settings with their values from the cheapest to the most detailed. "harmonics", "contact_points" and "blade_modes",
        the default, do not need values.
    tolerance : float
        Relative tolerance of amplitude and frequency.
    sources : sequence of str
        Sources of the error of the most detailed combination, each the cost of a more detailed peak. If empty, the last
        refinements take their place.

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

    def solve(varied_problem: Problem, *place: Any) -> Any:
        if quantity is None:
            return whole_curve(varied_problem, *place)
        with inside_user_code():
            return quantity(like(study, varied_problem), *place)

    tolerance = validation.number("tolerance", tolerance, above=0.0, below=1.0)
    sources = validation.names("sources", sources, SOURCES)
    preload = problem.check_preload(preload)
    low, high = map(float, peak_interval(problem.at(preload), frequency))
    ladders = make_ladders(problem, vary)
    check_question(problem, [preload], frequency)
    runs = _Runs(problem, ladders, lambda p: solve(p, preload, (low, high)), preload)

    def solve_richer(richer: Problem) -> Any:
        if quantity is not None:
            return runs.solve(richer)
        # the resonance may leave the interval
        return whole_curve(richer, preload, (low, high), wider=WIDER)

    top = {name: len(values) - 1 for name, values in ladders.items()}
    asked: list[str] = []
    of_reference: list[ReferenceError] = []
    with LongWork() as work:
        _reference(runs, top)
        for source in sources:
            error = runs.reference_error(source, solve_richer)
            if error is not None:
                of_reference.append(_or_last_step(runs, top, error))
            asked.append(source)
        if sources:
            uncertainty = sum(error.size for error in of_reference if error.known)
        else:
            uncertainty = sum(
                runs.at(name, {**top, name: k - 1}).difference for name, k in top.items() if k > 0
            )
        # if nothing is left for the settings, they are still compared with the reference
        left = (tolerance - uncertainty) / (1.0 + uncertainty)
        _search(runs, top, left if left > 0.0 else tolerance)
    if not runs.done:
        raise KeyboardInterrupt
    if work.interrupted and sources:
        not_run = sources[len(asked) :]
        of_reference += [ReferenceError(source, np.nan, np.nan, INTERRUPTED) for source in not_run]
    result = AccuracyCost(
        "curve" if quantity is None else getattr(quantity, "__name__", "peak"), preload, (low, high), tolerance,
        tuple(ladders), tuple(runs.done), problem.record(None), work.interrupted, tuple(of_reference),
    )  # fmt: skip
    if result.reached or not of_reference:
        return result
    return replace(result, forecast=_forecast(runs.study(result.richest.values), result))


def _reference(runs: _Runs, top: Mapping[str, int]) -> None:
    """Run the most detailed settings.

    Raises
    ------
    BdamperError
        If they have no peak.
    """
    richest = runs.at(RICHEST, top)
    if not np.isfinite(richest.difference):
        text = f"{_text(runs.ladders, richest.values)}, at {runs.preload:g} N"
        why = f" ({richest.reason})" if richest.reason else ""
        raise BdamperError(
            f"no peak with the most detailed settings, {text}{why}: give less detailed ones in vary"
        )


def _or_last_step(runs: _Runs, top: Mapping[str, int], error: ReferenceError) -> ReferenceError:
    """Return the last refinement of the settings of a source if no more detailed peak is known."""
    names = [name for name in SETTINGS_OF[error.source] if top.get(name, 0) > 0]
    if error.known or not names:
        return error
    steps = [runs.at(name, {**top, name: top[name] - 1}) for name in names]
    cheaper = ", ".join(
        f"{spaced(step.part)} {step.values[list(top).index(step.part)]}" for step in steps
    )
    size = sum(step.difference for step in steps)
    if not np.isfinite(size):
        return error
    return replace(error, size=size, against=f"{error.against}; last refinement, from {cheaper}")


def _search(runs: _Runs, top: Mapping[str, int], allowed: float) -> None:
    """Reduce each setting alone, then combine and refine the values until their difference is at most ``allowed``."""
    indices, difference = dict(top), {}
    for name in top:
        difference[name, top[name]] = 0.0
        for k in range(top[name] - 1, -1, -1):
            difference[name, k] = runs.at(name, {**top, name: k}).difference
            if not difference[name, k] <= allowed:
                break
            indices[name] = k
    while indices != top:
        if runs.at(COMBINED, indices).difference <= allowed:
            return
        worst = max(
            (name for name in top if indices[name] < top[name]),
            key=lambda name: difference[name, indices[name]],
        )
        indices[worst] += 1


def _forecast(problem: Problem, result: AccuracyCost) -> Forecast | None:
    """Refine the most detailed settings without computing them, until their estimated error meets the tolerance.

    Each step leaves the part :data:`LEFT` of the error of its source, and multiplies the time as the computed step did.
    """
    if not np.isfinite(result.uncertainty):
        return None
    size = {error.source: error.size for error in result.sources if error.known}
    # a source without a computed step cannot be refined
    ratio = {
        e.source: e.seconds / result.richest.seconds
        for e in result.sources
        if np.isfinite(e.seconds)
    }
    seconds, settings = result.richest.seconds, dict[str, str]()
    while sum(size.values()) > result.tolerance:
        if not ratio:
            return None
        worst = max(ratio, key=lambda source: size[source])
        try:
            richer = richer_study(problem, worst)
        except BdamperError:
            richer = None
        if richer is None:
            del ratio[worst]
            continue
        problem, settings[worst] = richer
        size[worst] *= LEFT[worst]
        # a step that is faster by chance does not make the next one faster
        seconds *= max(ratio[worst], 1.0)
    return Forecast(", ".join(settings.values()), sum(size.values()), seconds)
