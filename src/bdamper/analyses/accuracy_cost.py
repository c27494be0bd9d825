"""What accuracy costs: the cheapest combination of settings within a tolerance of the richest one.

The richest values of all settings together are computed first; every error is relative to that.  Then each setting goes
down from its richest value by itself, as long as it stays within the tolerance.  The cheapest values that do are combined,
and the combination is computed, too; where it misses the tolerance, the setting that is worst by itself takes its next
richer value.  The last steps of the ladders, from the second richest values to the richest, say how far these may be off.

Errors are relative differences of amplitude and frequency of the highest peak, times those of the processor.  What is timed
is the analysis; parts of a study that are made once (modes, contact stiffness, static state) are made before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from bdamper.analyses.error_estimates import missing_harmonics, with_stand_ins
from bdamper.analyses.refined_peak import ask, whole_curve
from bdamper.contact.law_codes import AFT
from bdamper.harmonic_balance.plausibility import check_question
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_dispatch import Asking, like, problem_of
from bdamper.response.curve import ResponseCurve
from bdamper.response.peak import Peak
from bdamper.response.resonance_interval import peak_interval
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import BdamperError
from bdamper.util.formatting import percent, spaced
from bdamper.util.progress import LongWork
from bdamper.util.short_repr import brief
from bdamper.util.storage import Storable
from bdamper.util.tables import Column, Cycles, Metre, Second, Tabular, from_rows
from bdamper.util.threading import one_thread

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


@brief
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
        return varied | from_rows(self.runs)

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
    validation.that(isinstance(vary, Iterable), "vary", "names of settings, or a mapping of them to values", vary)
    named = vary if isinstance(vary, Mapping) else {name: ladder_values(problem, name) for name in vary}
    validation.that(named, "vary", "at least one setting of a study", vary)
    known = {f.name for f in fields(problem.settings)} - {"model"}
    for name, values in validation.mapping("vary", named, known, "settings of a study").items():
        several = isinstance(values, Sequence | np.ndarray) and not isinstance(values, str) and len(values)
        validation.that(several, f"vary '{name}'", "a sequence of values", values)
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


@validation.spelt
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
    validation.that(
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
