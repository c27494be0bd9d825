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
    The most detailed combination of settings is the reference; all errors are relative to it. Each setting alone is then
    reduced as long as the error is within the tolerance. The cheapest of these values are combined. If the combination
    misses the tolerance, the setting with the largest individual error is refined by one value. The errors of the second
    most detailed values indicate the error of the reference.

    Errors are relative differences of amplitude and frequency of the highest peak. Times are processor times of the
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
    embed,
    evaluate_peak,
    missing_harmonics,
    nodal_diameter,
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
from bdamper.util.display import Plottable
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, NOT_FOUND, BdamperError, inside_user_code, with_reason
from bdamper.util.formatting import peak_text, percent, short_repr, spaced
from bdamper.util.progress import CostMeter, LongWork, one_thread, progress_stages, shows_progress, stopped_by
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
    problem: Problem, peak: Peak, *, harmonics: Sequence[int] = HARMONICS, tolerance: float = TOLERANCE,
    progress: bool | None = None,
) -> Convergence:
    """Compute a peak with an increasing number of harmonics.

    Parameters
    ----------
    problem : Problem
    peak : Peak
        Converged peak of this study (:meth:`bdamper.Study.peak`).
    harmonics : sequence of int
        Increasing numbers of the highest harmonic. All lower harmonics are included, or only odd harmonics if even
        harmonics vanish.
    tolerance : float
        Relative change of the amplitude up to which the sequence counts as converged.
    progress : bool, optional
        Show a progress bar; by default in a terminal and a notebook.

    Returns
    -------
    Convergence
        After Ctrl-C it contains the results computed so far.

    Raises
    ------
    SettingError
        If the peak has not converged or belongs to another study.
    """
    check_peak(problem, peak)
    tolerance = validation.number("tolerance", tolerance, above=0.0, below=1.0)
    numbers = [validation.integer("harmonics", n, 1, MAX_HARMONIC) for n in harmonics]
    validation.check(numbers == sorted(set(numbers)) and numbers, "harmonics", "increasing numbers", numbers)
    highest = problem.harmonic_numbers[-1]
    meter = CostMeter()
    most, limit = _most(problem, peak.frequency, max(highest, numbers[-1]))
    problems, limit = _richer(problem, sorted({min(n, most) for n in numbers if n > highest} - {highest}), limit)
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
                status = with_reason(INCOMPLETE, f"no peak was found near this one with {n} harmonics ({outcome.reason})")
                break
            problem, peak = richer, outcome.result
            peaks.append(HarmonicPeak(n, outcome.amplitude, outcome.frequency, outcome.seconds))
            near_mode = any(m.harmonic > n for m in internal_resonances)
            if _converged(peaks, tolerance) and richer is not problems[-1] and not near_mode:
                limit = "no later harmonic is near a mode"
                break
    status = INTERRUPTED if work.interrupted else status
    return Convergence(peak.parameter, tolerance, tuple(peaks), internal_resonances, limit, status, meter.read())


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
                raise BdamperError(f"the highest peak there is {peak_text(peak.amplitude, peak.frequency)}")
            numbers = [n for n in HARMONICS if n <= 16]
            convergence = harmonic_convergence(problem, peak, harmonics=numbers, progress=progress)
            convergence = replace(convergence, cost=convergence.cost if peak.cost is None else convergence.cost + peak.cost)
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


def _richer(problem: Problem, numbers: Sequence[int], highest_harmonic: str) -> tuple[list[Problem], str]:
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
            return l - 1, f"the model has no modes of harmonic {l}, nodal diameter {nodal_diameter(problem, l)}"
        end = _end(problem, l)
        if l * frequency > end:
            return l - 1, f"the equations have no modes above {1e-3 * end:.3g} kHz, harmonic {int(end / frequency)}"
    return top, ""


def _end(problem: Problem, harmonic: int) -> float:
    """Return the highest frequency (Hz) in the equations of the reduced bodies at the nodal diameter of a harmonic.

    With residual modes all modes of the model count, otherwise only the retained modes.
    """
    d, ends = nodal_diameter(problem, harmonic), [np.inf]
    for name, body in problem.model.bodies.items():
        if body.kind == "constrained":
            omega2 = body.bases[d].omega2[: body.bases[d].n_natural]
            retained = omega2 if problem.contact.residual is not None else omega2[: problem.settings.blade_modes]
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
        return _richer_peak(known, peak, sign_of_jacobian(known.system(peak.parameter), peak.y), meter, problem)
    except BdamperError as error:
        frequency = ((1.0 - NEARBY) * peak.frequency, (1.0 + NEARBY) * peak.frequency)
        highest = found_at(problem, peak.parameter, frequency, options=OPTIONS, budget=NEARBY_BUDGET)
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
    half = problem.replace(harmonics=tuple(l for l in problem.harmonic_numbers if l <= new[len(new) // 2 - 1]))
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
    error : float
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
    error: float
    seconds: Second
    reason: str = ""


@short_repr
@dataclass(frozen=True)
class AccuracyCost(Plottable, Tabular, Storable, kind="bdamper-accuracy"):
    """Errors and times of settings relative to the most detailed run.

    ``plot`` draws error over time (:func:`bdamper.plot.plot_accuracy`).

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
    """

    quantity: str
    preload: float
    interval: tuple[float, float]
    tolerance: float
    varied: tuple[str, ...]
    runs: tuple[Run, ...]
    settings: dict[str, Any] = field(default_factory=dict, compare=False)
    interrupted: bool = False

    def columns(self) -> dict[str, Column]:
        """Return one row for each run with its settings, its highest peak and its error."""
        varied = {n: Column(np.array([r.values[i] for r in self.runs])) for i, n in enumerate(self.varied)}
        return varied | columns_of_rows(self.runs)

    @property
    def richest(self) -> Run:
        """Most detailed run, the reference of all errors."""
        return self.runs[0]

    @property
    def recommended(self) -> Run:
        """Cheapest run within the tolerance; the most detailed run if there is no other."""
        good = [r for r in self.runs[1:] if r.error <= self.tolerance]
        return min(good, key=lambda r: r.seconds, default=self.richest)

    @property
    def last_steps(self) -> dict[str, float]:
        """Error of the second most detailed value of each setting (NaN if unknown), an indicator of the error of the
        reference.
        """
        first = {r.part: r.error for r in reversed(self.runs)}
        return {name: first.get(name, float("nan")) for name in self.varied}

    @property
    def uncertainty(self) -> float:
        """Sum of ``last_steps``, an estimate of the error of the most detailed run; NaN if one of them is unknown."""
        return float(sum(self.last_steps.values()))

    def _headline(self) -> str:
        best, tolerance = self.recommended, percent(self.tolerance)
        if best is self.richest:
            head = f"Only the most detailed settings meet {tolerance}."
        else:
            ratio = best.seconds / self.richest.seconds
            cost = f"error {percent(best.error)} in {ratio:.2g} of the time of the most detailed settings"
            head = f"For {tolerance}: {_text(self.varied, best.values)}, {cost}."
        ended = " Interrupted: other runs may suffice." if self.interrupted else ""
        error = f"Estimated error of the most detailed settings: {percent(self.uncertainty)} (sum of the last refinements)."
        return f"{head} {error}{ended}"


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
    reduced = problem.settings.most_modes("constrained") > 0  # lumped masses have no modes to leave out
    default = [name for name in DEFAULT if reduced or name != "blade_modes"]
    vary = default if vary is None else (vary,) if isinstance(vary, str) else vary
    validation.check_value(isinstance(vary, Iterable), "vary", "names of settings, or a mapping of them to values", vary)
    named = vary if isinstance(vary, Mapping) else {name: ladder_values(problem, name) for name in vary}
    validation.check_value(named, "vary", "at least one setting of a study", vary)
    known = {f.name for f in fields(problem.settings)} - {"model"}
    for name, values in validation.mapping("vary", named, known, "settings of a study").items():
        several = isinstance(values, Sequence | np.ndarray) and not isinstance(values, str) and len(values)
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
            study = varied(self.problem, {n: self.ladders[n][value] for n, value in zip(self.ladders, names)})
            if study.static(self.preload).converged:
                study.system(self.preload)
            amplitude, frequency, reason, seconds, _ = evaluate_peak(study, self.solve)
        except BdamperError as failure:  # the other runs are useful without this one
            amplitude, frequency, reason, seconds = np.nan, np.nan, str(failure), np.nan
        a, f = (self.done[0].amplitude, self.done[0].frequency) if self.done else (amplitude, frequency)
        error = float(max(abs(amplitude / a - 1.0), abs(frequency / f - 1.0)))
        self.done.append(Run(part, names, amplitude, frequency, error, seconds, reason))
        return self.done[-1]


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
) -> AccuracyCost:
    """Find the cheapest combination of settings within a tolerance of the most detailed one.

    The most detailed combination takes most of the time, especially if a damper is nearly loose.

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
        quantity is None or callable(quantity), "quantity", "a function of study, preload and interval", quantity
    )
    problem = problem_of(study)

    def solve(varied_problem: Problem, *place: Any) -> Any:
        if quantity is None:
            return whole_curve(varied_problem, *place)
        with inside_user_code():
            return quantity(like(study, varied_problem), *place)

    tolerance = validation.number("tolerance", tolerance, above=0.0, below=1.0)
    preload = problem.check_preload(preload)
    low, high = map(float, peak_interval(problem.at(preload), frequency))
    ladders = make_ladders(problem, vary)
    check_question(problem, [preload], frequency)
    runs = _Runs(problem, ladders, lambda p: solve(p, preload, (low, high)), preload)
    top = {name: len(values) - 1 for name, values in ladders.items()}
    with LongWork() as work:
        _search(runs, top, tolerance)
    if not runs.done:
        raise KeyboardInterrupt
    return AccuracyCost(
        "curve" if quantity is None else getattr(quantity, "__name__", "peak"), preload, (low, high), tolerance,
        tuple(ladders), tuple(runs.done), problem.record(None), work.interrupted,
    )  # fmt: skip


def _search(runs: _Runs, top: Mapping[str, int], tolerance: float) -> None:
    """Run the reference, reduce each setting alone, then combine and refine the values until they meet the tolerance."""
    richest = runs.at(RICHEST, top)
    if not np.isfinite(richest.error):
        text = f"{_text(runs.ladders, richest.values)}, at {runs.preload:g} N"
        why = f" ({richest.reason})" if richest.reason else ""
        raise BdamperError(f"no peak with the most detailed settings, {text}{why}: give less detailed ones in vary")
    indices, error = dict(top), {}
    for name in top:
        error[name, top[name]] = 0.0
        for k in range(top[name] - 1, -1, -1):
            error[name, k] = runs.at(name, {**top, name: k}).error
            if not error[name, k] <= tolerance:
                break
            indices[name] = k
    while indices != top:
        if runs.at(COMBINED, indices).error <= tolerance:
            return
        worst = max((name for name in top if indices[name] < top[name]), key=lambda name: error[name, indices[name]])
        indices[worst] += 1
