"""More harmonics at one peak, by Newton's method along the condition of a peak.

With ``H`` harmonics the peak solves ``r_H(u, omega) = 0`` and ``phi_H = 0``, the slope of the amplitude along the curve
(``bdamper.response.peak``).  It starts at the peak with fewer harmonics, in which the new ones are at rest: Newton's
method with line search at the frequency of that peak, then the search for the peak.  Both must keep the sign of det J,
which changes at every fold: otherwise the solution belongs to another part of the curve.  Where this fails, the number of
harmonics half way comes first.

Agreement proves nothing while harmonics come into resonance one by one: at its optimum the turbine blade has 75.3, 75.0,
75.0, 75.2 and 74.2 um with 3, 5, 7, 9 and 12 harmonics and 69.4 um with 16.  So more harmonics follow up to the highest
that was asked for, and end before only

* where the structure ends: above the highest mode that the equations hold of a reduced body nothing can resonate;
* where the model has no modes of a nodal diameter;
* where the last two changes are below a fifth of the tolerance and no harmonic still to come is near a stuck mode.

A harmonic ``l`` meets a mode where ``l omega`` is within 5 % of a frequency of the structure with stuck contacts at its
nodal diameter.

What accuracy costs: the cheapest combination of settings within a tolerance of the richest one.

The richest values of all settings together are computed first; every error is relative to that.  Then each setting goes
down from its richest value by itself, as long as it stays within the tolerance.  The cheapest values that do are combined,
and the combination is computed, too; where it misses the tolerance, the setting that is worst by itself takes its next
richer value.  The last steps of the ladders, from the second richest values to the richest, say how far these may be off.

Errors are relative differences of amplitude and frequency of the highest peak, times those of the processor.  What is timed
is the analysis; parts of a study that are made once (modes, contact stiffness, static state) are made before.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields, replace
from threading import Event
from typing import Any

import numpy as np

from bdamper.analyses.error_estimates import ask, embed, missing_harmonics, whole_curve, with_stand_ins
from bdamper.contact.laws import AFT
from bdamper.harmonic_balance.effects import MAX_HARMONIC
from bdamper.harmonic_balance.plausibility import check_question
from bdamper.harmonic_balance.problem import Problem, stuck_springs
from bdamper.harmonic_balance.result_checks import Asking, check_result, like, problem_of
from bdamper.response.highest_peak import NEAR as NEAR_HIGHEST
from bdamper.response.highest_peak import highest_peak
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak, PeakOptions, peak_interval, peak_of_sign, sign_of_jacobian
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import Convergence, HarmonicPeak, Meeting
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, NOT_FOUND, BdamperError, with_reason
from bdamper.util.formatting import peak_text, percent, short_repr, spaced
from bdamper.util.progress import CostMeter, LongWork, one_thread, stopped_by
from bdamper.util.storage import Storable
from bdamper.util.tables import Column, Cycles, Metre, Second, Tabular, columns_of_rows

# ---- More harmonics at one peak, by Newton's method along the condition of a peak ----


HARMONICS = (5, 7, 9, 12, 16, 20, 26)
"""Highest harmonics that are asked for by default."""
TOLERANCE = 0.05
"""Relative, on the amplitude, by default."""
NEAR_MODE = 0.05
"""Distance from a stuck mode within which a harmonic meets it: slip and separation move modes of the turbine blade by up to
3 %."""
OPTIONS = PeakOptions(tolerance=1e-8, position_tolerance=1e-4, max_trials=24)
"""How exactly the peaks are found."""


@one_thread
def harmonic_convergence(
    problem: Problem, peak: Peak, *, harmonics: Sequence[int] = HARMONICS, tolerance: float = TOLERANCE
) -> Convergence:
    """A peak with more and more harmonics.

    Parameters
    ----------
    problem : Problem
    peak : Peak
        A converged one of this study (:meth:`bdamper.Study.peak`).
    harmonics : sequence of int
        Highest harmonics to ask for, rising; all up to them take part, the odd ones alone where even ones vanish.
    tolerance : float
        Relative, on the amplitude: what counts as converged.

    Returns
    -------
    Convergence
        After Ctrl-C with what was known by then.

    Raises
    ------
    SettingError
        If the peak is none of this study, or has not converged.
    """
    validation.instance("peak", peak, Peak)
    validation.check(peak.converged, "peak", "a converged one", f"status '{peak.status}'")
    check_result(problem, peak, "peak")
    tolerance = validation.number("tolerance", tolerance, above=0.0, below=1.0)
    asked = [validation.integer("harmonics", n, 1, MAX_HARMONIC) for n in harmonics]
    validation.check(asked == sorted(set(asked)) and asked, "harmonics", "rising numbers", asked)
    own = problem.harmonic_numbers[-1]
    meter = CostMeter()
    most, limit = _most(problem, peak.frequency, max(own, asked[-1]))
    problems, limit = _richer(problem, sorted({min(n, most) for n in asked if n > own} - {own}), limit)
    found, status = [HarmonicPeak(own, peak.amplitude, peak.frequency)], COMPLETE
    internal_resonances: tuple[Meeting, ...] = ()
    with LongWork() as work:
        internal_resonances = tuple(_meetings(([problem] + problems)[-1], peak))
        at, sign = (problem, peak), sign_of_jacobian(problem.system(peak.parameter), peak.y)
        for richer in problems:
            begin, n = time.thread_time(), richer.harmonic_numbers[-1]
            new = _to(at, richer, sign, meter)
            if isinstance(new, str):
                status = with_reason(INCOMPLETE, f"with {n} harmonics no peak was found beside this one ({new})")
                break
            at, seconds = new, time.thread_time() - begin
            found.append(HarmonicPeak(n, at[1].amplitude, at[1].frequency, seconds))
            if (
                _still(found, tolerance)
                and richer is not problems[-1]
                and not any(m.harmonic > n for m in internal_resonances)
            ):
                limit = "no later harmonic meets a mode"
                break
    status = INTERRUPTED if work.interrupted else status
    return Convergence(
        peak.parameter, tolerance, tuple(found), internal_resonances, limit, status, meter.read()
    )  # fmt: skip


# ---- the optimal curve ----


def at_optimum(problem: Problem, curve: OptimalCurve) -> Convergence | None:
    """The peak at the optimum of an optimal curve with up to 16 harmonics; None where there is no optimum."""
    best, found, status = curve.optimum, None, INTERRUPTED
    if not np.isfinite(best.preload):
        return None
    with LongWork():
        try:
            peak = highest_peak(problem, best.preload, tuple(curve.settings["frequency"]))
            if not abs(peak.amplitude / best.amplitude - 1.0) <= NEAR_HIGHEST:
                raise BdamperError(f"the highest peak there is {peak_text(peak.amplitude, peak.frequency)}")
            found = harmonic_convergence(problem, peak, harmonics=[n for n in HARMONICS if n <= 16])
            found = replace(found, cost=found.cost if peak.cost is None else found.cost + peak.cost)
        except BdamperError as error:
            status = with_reason(NOT_FOUND, error)
    own = HarmonicPeak(problem.harmonic_numbers[-1], best.amplitude, best.frequency)
    return found or Convergence(best.preload, TOLERANCE, (own,), status=status)


def beside(problem: Problem, curve: OptimalCurve, work: Callable[[], OptimalCurve]) -> OptimalCurve:
    """What some work makes of an optimal curve; on a thread beside it, the peak at the optimum with more harmonics.

    The cost of the curve takes in both, with the seconds that they need side by side.
    """
    start, stop = time.perf_counter(), Event()
    with ThreadPoolExecutor(1) as pool:
        more = pool.submit(stopped_by(stop)(at_optimum), problem, curve)
        try:
            done = work()
            if any(k.status == INTERRUPTED for k in done.time_response):
                stop.set()
            found = more.result()
            whole = done.cost if found is None else done.cost + found.cost
            whole = replace(whole, seconds=curve.cost.seconds + time.perf_counter() - start)
            return replace(done, convergence=found, cost=whole)
        finally:
            stop.set()


# ---- which harmonics there are ----


def _still(found: Sequence[HarmonicPeak], tolerance: float) -> bool:
    """Whether the last two changes are below a fifth of the tolerance."""
    amplitude = [p.amplitude for p in found[-3:]]
    change = np.abs(np.diff(amplitude)) / amplitude[-1]
    return len(change) == 2 and bool(change.max() < 0.2 * tolerance)


def _richer(problem: Problem, numbers: Sequence[int], highest_harmonic: str) -> tuple[list[Problem], str]:
    """The problem with all harmonics up to each number, odd ones alone where even ones vanish, and what forbids more."""
    own, odd = problem.harmonic_numbers, not problem.settings.variable_normal_load
    found: list[Problem] = []
    for n in numbers:
        harmonics = tuple(l for l in range(1, n + 1) if l in own or l % 2 or not odd)
        try:
            richer = problem.replace(harmonics=harmonics)
            note = "" if richer.contact.note == problem.contact.note else richer.contact.note
        except BdamperError as error:
            note = str(error)
        if note:
            return found, f"no {n} harmonics are possible with the same settings ({note})"
        if richer.harmonic_numbers[-1] > (found or [problem])[-1].harmonic_numbers[-1]:
            found.append(richer)
    return found, highest_harmonic


def _most(problem: Problem, frequency: float, top: int) -> tuple[int, str]:
    """The highest harmonic up to ``top`` that the structure has a say in, and why there is none beyond."""
    own = problem.harmonic_numbers[-1]
    lacking = missing_harmonics(problem, top)
    for l in range(own + 1, top + 1):
        if l in lacking:
            d, _ = problem.model.folded_nodal_diameter(problem.engine_order * l)
            return l - 1, f"the model has no modes of harmonic {l}, nodal diameter {d}"
        end = _end(problem, l)
        if l * frequency > end:
            return l - 1, f"the structure ends at {1e-3 * end:.3g} kHz, harmonic {int(end / frequency)}"
    return top, ""


def _end(problem: Problem, harmonic: int) -> float:
    """Highest frequency (Hz) that the equations hold of a reduced body at the nodal diameter of a harmonic.

    Residual modes stand for all modes of the model; without them there are those that the study retains.
    """
    d, _ = problem.model.folded_nodal_diameter(
        problem.engine_order * (1 if problem.settings.fundamental_modes_only else harmonic)
    )
    ends = [np.inf]
    for name, body in problem.model.bodies.items():
        if body.kind == "constrained":
            omega2 = body.bases[d].omega2[: body.bases[d].n_natural]
            kept = omega2 if problem.contact.residual is not None else omega2[: problem.settings.blade_modes]
            ends.append(float(np.sqrt(kept.max())) / (2.0 * np.pi))
    return min(ends)


def _meetings(problem: Problem, peak: Peak) -> Iterator[Meeting]:
    """The harmonics of the problem that are near a mode with stuck contacts, each with the nearest one."""
    springs, linear = stuck_springs(problem, problem.static(peak.parameter)), problem.sector(peak.parameter).linear
    for l in problem.harmonic_numbers[1:]:
        modes = linear.modes(springs, l)[0] / (2.0 * np.pi)
        distance = l * peak.frequency / np.maximum(modes, 1e-300) - 1.0
        k = int(np.argmin(np.abs(distance)))
        if abs(distance[k]) <= NEAR_MODE:
            diameter = problem.bases[l].nodal_diameter if problem.model.n_blades > 1 else -1
            yield Meeting(l, k + 1, diameter, float(modes[k]), float(distance[k]))


# ---- the search ----


def _to(known: tuple[Problem, Peak], problem: Problem, sign: int, meter: CostMeter) -> tuple[Problem, Peak] | str:
    """A problem with more harmonics and its peak beside a known one, or why there is none.

    Where Newton's method fails, half of the new harmonics come first.
    """
    fewer, peak = known
    preload = peak.parameter
    system = problem.system(preload)
    meter.watch(system)
    guess = embed(fewer, problem, preload, peak.y)
    found, iterations = peak_of_sign(system, guess, sign, options=OPTIONS, parameter=preload)
    meter.count(iterations)
    if isinstance(found, Peak):
        return problem, found
    new = [l for l in problem.harmonic_numbers if l > fewer.harmonic_numbers[-1]]
    if len(new) == 1:
        return found
    some = tuple(l for l in problem.harmonic_numbers if l <= new[len(new) // 2 - 1])
    half = _to(known, problem.replace(harmonics=some), sign, meter)
    return half if isinstance(half, str) else _to(half, problem, sign, meter)


# ---- What accuracy costs ----


DEFAULT = ("harmonics", "contact_points", "blade_modes")
"""Settings that are varied by default."""
Solver = Callable[[Any, float, tuple[float, float]], ResponseCurve | Peak | tuple[float, float]]
"""Finds the highest peak of a study for a preload (N) and an interval of frequencies (Hz), or amplitude (m) and frequency
(Hz) of it, not finite if none was found, or raises a BdamperError."""
RICHEST, COMBINED = "richest", "combination"
"""What a run stands for, besides the name of the one setting in which it is poorer than the richest."""


@dataclass(frozen=True)
class Run:
    """Result and cost of one combination of settings.

    Parameters
    ----------
    part : str
        "richest"; the setting in which the run is poorer than that; or "combination".
    values : tuple of str
        Of each setting that is varied.
    amplitude, frequency : float, m, Hz
        NaN if there is no whole answer.
    error : float
        The larger relative difference of both from the richest run; NaN if that is not known.
    seconds : float
        Of the processor; NaN if the study has no such settings.
    reason : str
        Why there is no whole answer, as far as it is known.
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
class AccuracyCost(Plottable, Tabular, Storable, kind="bdamper-accuracy", version=3):
    """Errors and times of settings, one at a time and combined, against the richest that was run.

    ``plot`` draws error over time (:func:`bdamper.plot.plot_accuracy`).

    Parameters
    ----------
    quantity : str
    preload : float, N
    interval : (low, high), Hz
    tolerance : float
    varied : tuple of str
        Settings that are varied.
    runs : tuple of Run
        The richest one first.
    settings : mapping
        Of the study.
    interrupted : bool
        Whether the search was ended by Ctrl-C, before all combinations were run that it asks for.
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
        """A row for each run: its settings, its highest peak and its error against the richest run."""
        varied = {n: Column(np.array([r.values[i] for r in self.runs])) for i, n in enumerate(self.varied)}
        return varied | columns_of_rows(self.runs)

    @property
    def richest(self) -> Run:
        """The run that all others are measured by."""
        return self.runs[0]

    @property
    def recommended(self) -> Run:
        """The cheapest run within the tolerance; the richest only if there is no other."""
        good = [r for r in self.runs[1:] if r.error <= self.tolerance]
        return min(good, key=lambda r: r.seconds, default=self.richest)

    @property
    def last_steps(self) -> dict[str, float]:
        """Error of the second richest value of each setting (NaN if unknown), which indicates the error of the richest."""
        first = {r.part: r.error for r in reversed(self.runs)}
        return {name: first.get(name, float("nan")) for name in self.varied}

    @property
    def uncertainty(self) -> float:
        """Sum of the last steps, NaN where one is not known: how far the richest run itself may be off."""
        return float(sum(self.last_steps.values()))

    def _headline(self) -> str:
        best, tolerance = self.recommended, percent(self.tolerance)
        if best is self.richest:
            found = f"Nothing but the richest that was run is within {tolerance} of it."
        else:
            ratio = best.seconds / self.richest.seconds
            off = f"{percent(best.error)} from the richest in {ratio:.2g} of its time"
            found = f"For {tolerance}: {_text(self.varied, best.values)}, {off}."
        ended = " Interrupted: other runs may suffice." if self.interrupted else ""
        return f"{found} The richest itself is uncertain by its last steps, {percent(self.uncertainty)}.{ended}"


def _text(names: Iterable[str], values: Iterable[str]) -> str:
    return ", ".join(f"{spaced(n)} {v}" for n, v in zip(names, values))


# ---- what is varied ----


def ladder_values(problem: Problem, name: str) -> list[Any]:
    """Values of a setting from the cheapest to the richest, as far as the model allows."""
    if name == "harmonics":
        return [n for n in (1, 3, 5) if not missing_harmonics(problem, n)]
    if name == "contact_points":
        full = problem.settings.most_points
        return [n for n in (9, 24, 48) if n < full] + [full]
    validation.choice("vary, without values", name, DEFAULT)
    most = problem.settings.most_modes("constrained")
    return [n for n in (5, 10, 20) if n < most] + [min(most, 40)]


def make_ladders(problem: Problem, vary: Any) -> dict[str, dict[str, Any]]:
    """Values of each setting that is varied by their names, from the cheapest to the richest; see :func:`accuracy_cost`."""
    vary = DEFAULT if vary is None else (vary,) if isinstance(vary, str) else vary
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
    """The study with settings changed; more contact points than the model has are all that it has."""
    changes = dict(changes)
    if "harmonics" in changes:
        problem = with_stand_ins(problem, changes.pop("harmonics"))
    points = changes.get("contact_points")
    if points is not None and points >= problem.settings.most_points:
        changes["contact_points"] = None
    return problem.replace(**changes) if changes else problem


# ---- the search ----


@dataclass
class _Runs:
    """Combinations of values, each run once."""

    problem: Problem
    ladders: Mapping[str, Mapping[str, Any]]
    ask: Callable[[Problem], Any]
    preload: float
    done: list[Run] = field(default_factory=list)

    def at(self, part: str, place: Mapping[str, int]) -> Run:
        """The study with the values at these indices, computed unless it was before."""
        names = tuple(list(values)[place[name]] for name, values in self.ladders.items())
        same = next((r for r in self.done if r.values == names), None)
        if same is not None:
            return same
        try:
            study = varied(self.problem, {n: self.ladders[n][value] for n, value in zip(self.ladders, names)})
            if study.static(self.preload).converged:
                study.system(self.preload)
            amplitude, frequency, reason, seconds, _ = ask(study, self.ask)
        except BdamperError as failure:  # the other runs, those before it above all, are worth having without it
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
    """The cheapest combination of settings within a tolerance of the richest one, and what others cost.

    The richest combination takes most of the time, above all where a damper is nearly loose.

    Parameters
    ----------
    problem : Problem
        What is not varied is as it is there.
    preload : float, N
    frequency : (low, high), Hz, optional
        Interval of the peak; around the first mode by default.
    quantity : callable, optional
        A function of (study, preload, interval) that returns amplitude (m) and frequency (Hz), a peak or a response curve;
        by default the whole curve.
    vary : str, sequence of str or mapping, optional
        Settings and their values from the cheapest to the richest; for "harmonics", "contact_points" and "blade_modes",
        which are varied by default, the name is enough.
    tolerance : float
        Relative, on amplitude and frequency.

    Returns
    -------
    AccuracyCost
        After Ctrl-C with what was run by then.

    Raises
    ------
    SettingError
        If a setting or a quantity is not known.
    BdamperError
        If the richest combination has no whole answer.
    KeyboardInterrupt
        If that was interrupted.
    """
    validation.check_value(
        quantity is None or callable(quantity), "quantity", "a function of study, preload and interval", quantity
    )
    problem = problem_of(study)
    solve = whole_curve if quantity is None else lambda p, *place: quantity(like(study, p), *place)
    tolerance = validation.number("tolerance", tolerance, above=0.0, below=1.0)
    preload = problem.check_preload(preload)
    low, high = map(float, peak_interval(problem, frequency, preload))
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
    """The richest, each setting down by itself, then the cheapest sufficient values combined, richer until they suffice."""
    richest = runs.at(RICHEST, top)
    if not np.isfinite(richest.error):
        text = f"{_text(runs.ladders, richest.values)}, at {runs.preload:g} N"
        why = f" ({richest.reason})" if richest.reason else ""
        raise BdamperError(f"no whole answer with the richest settings, {text}{why}: give poorer ones in vary")
    place, error = dict(top), {}
    for name in top:
        error[name, top[name]] = 0.0
        for k in range(top[name] - 1, -1, -1):
            error[name, k] = runs.at(name, {**top, name: k}).error
            if not error[name, k] <= tolerance:
                break
            place[name] = k
    while place != top:
        if runs.at(COMBINED, place).error <= tolerance:
            return
        worst = max((name for name in top if place[name] < top[name]), key=lambda name: error[name, place[name]])
        place[worst] += 1
