"""What accuracy costs: ladders of settings against a reference solution of their own, errors beside times.

A *ladder* is a study with one thing varied: a setting of :class:`bdamper.Study`, the options of the continuation, or the
way in which the peak is found.  Each ladder has a reference, the same study with the varied setting richer than on any
rung, and the error of the reference itself is estimated (:mod:`bdamper.accuracy.estimate`).  Errors are relative
differences of the amplitude and the frequency of the highest peak.

Times are those of the processor, medians of repeats within one run, all rungs of all ladders taking turns, so that whatever
else the machine does meets them alike.  What is timed is the analysis; parts of a study that are made once (modes, contact
stiffness, static state) are made before.

A rung is on the Pareto front of its ladder if none is at once cheaper and at least as accurate.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from bdamper.accuracy.estimate import estimate_errors, missing_harmonics, points_on_a_face, with_stand_ins
from bdamper.accuracy.ways import QUANTITIES, Answer, Solver
from bdamper.contact.laws import Sampled
from bdamper.continuation.linear_curve import stuck
from bdamper.peaks.optimal import highest_peak, peak_interval
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.estimates import percent
from bdamper.util.hdf5 import Storable
from bdamper.util.plotting import Plottable
from bdamper.util.progress import each
from bdamper.util.repr import brief

SOURCE_OF = {
    "harmonics": "harmonics",
    "evaluation": "evaluation",
    "contact_points": "contact points",
    "blade_modes": "modes",
}
"""Source of error that a setting controls."""


@dataclass(frozen=True)
class Setting:
    """One rung of a ladder.

    Parameters
    ----------
    ladder, name : str
    changes : mapping of str to value
        Settings of the study that differ.
    solver : callable, optional
        How the peak is found; by the quantity of :func:`accuracy_cost` by default.
    """

    ladder: str
    name: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    solver: Solver | None = None


@dataclass(frozen=True)
class Rung:
    """What one setting gave and cost.

    Parameters
    ----------
    ladder, name : str
    amplitude, frequency : float, m, Hz
        NaN if the setting found no peak.
    amplitude_error, frequency_error : float
        Relative to the reference of the ladder, with sign.
    seconds : float
        Of the processor, median.
    ratio : float
        Of the time to that of the cheapest rung of the ladder.
    pareto : bool
    """

    ladder: str
    name: str
    amplitude: float
    frequency: float
    amplitude_error: float
    frequency_error: float
    seconds: float
    ratio: float
    pareto: bool

    @property
    def error(self) -> float:
        """The larger of both relative errors; infinite if there is no peak."""
        size = max(abs(self.amplitude_error), abs(self.frequency_error))
        return size if np.isfinite(size) else float("inf")


@dataclass(frozen=True)
class Reference:
    """The solution that a ladder is measured by.

    Parameters
    ----------
    ladder, name : str
    amplitude, frequency : float, m, Hz
    error : float
        Estimated relative error of its own, of the source that the ladder varies; NaN if not known.
    against : str
        How this was estimated.
    seconds : float
    """

    ladder: str
    name: str
    amplitude: float
    frequency: float
    error: float
    against: str
    seconds: float


@brief
@dataclass(frozen=True)
class AccuracyCost(Plottable, Storable, kind="bdamper-accuracy"):
    """Errors and times of ladders of settings.

    ``plot`` draws error over time with the Pareto fronts (:func:`bdamper.plot.plot_accuracy`).

    Parameters
    ----------
    quantity : str
    preload : float, N
    interval : (low, high), Hz
    tolerance : float
        For the recommendation.
    rungs : tuple of Rung
    references : tuple of Reference
        One for each ladder.
    repeats : int
    settings : mapping
        Of the study whose settings were varied.
    """

    quantity: str
    preload: float
    interval: tuple[float, float]
    tolerance: float
    rungs: tuple[Rung, ...]
    references: tuple[Reference, ...]
    repeats: int
    settings: dict[str, Any] = field(default_factory=dict, compare=False)

    @property
    def ladders(self) -> tuple[str, ...]:
        """Names of the ladders."""
        return tuple(r.ladder for r in self.references)

    def ladder(self, name: str) -> tuple[Rung, ...]:
        """Rungs of one ladder, in the order given."""
        if name not in self.ladders:
            raise SettingError(f"ladder: expected one of {self.ladders}, found '{name}'")
        return tuple(r for r in self.rungs if r.ladder == name)

    def reference(self, ladder: str) -> Reference:
        """Reference of one ladder."""
        return next(r for r in self.references if r.ladder == ladder)

    def pareto(self, ladder: str | None = None) -> tuple[Rung, ...]:
        """Rungs of a ladder (the first by default) that none other beats in both time and error, cheapest first."""
        return tuple(sorted((r for r in self.ladder(ladder or self.ladders[0]) if r.pareto), key=lambda r: r.seconds))

    def recommended(self, tolerance: float | None = None, ladder: str | None = None) -> Rung | None:
        """The cheapest rung of a ladder (the first by default) within a tolerance; None if there is none."""
        tolerance = self.tolerance if tolerance is None else tolerance
        good = [r for r in self.ladder(ladder or self.ladders[0]) if r.error <= tolerance]
        return min(good, key=lambda r: r.seconds, default=None)

    def __str__(self) -> str:
        lines = [
            f"{self.quantity}, preload {self.preload:g} N, {self.interval[0]:.5g} to {self.interval[1]:.5g} Hz; times are "
            f"medians of {self.repeats}"
        ]
        width = max([len(r.name) for r in self.rungs] + [len("setting")])
        for ladder in self.ladders:
            ref = self.reference(ladder)
            own = f"itself good to {percent(ref.error)} ({ref.against})" if np.isfinite(ref.error) else ref.against
            lines += [
                f"{ladder}: reference {ref.name}, {ref.amplitude:.6g} m at {ref.frequency:.6g} Hz, {own}",
                f"  {'setting':<{width}}{'amplitude':>12}{'frequency':>12}{'time':>12}{'ratio':>8}",
            ]
            best = self.recommended(ladder=ladder)
            for r in self.ladder(ladder):
                marks = ("  Pareto" if r.pareto else "") + (f", for {percent(self.tolerance)}" if r is best else "")
                lines.append(
                    f"  {r.name:<{width}}{_error(r.amplitude_error):>12}{_error(r.frequency_error):>12}"
                    f"{1e3 * r.seconds:>9.1f} ms{r.ratio:>8.2f}{marks}"
                )
            if best is None:
                lines.append(f"  no setting is within {percent(self.tolerance)}")
        return "\n".join(lines)

    def markdown(self, ladder: str) -> str:
        """Table of one ladder for documents."""
        ref = self.reference(ladder)
        own = f"own error {_error(ref.error, False)}" if np.isfinite(ref.error) else ref.against
        lines = [
            f"Reference: {ref.name}, {own}.",
            "",
            "| setting | error of amplitude | error of frequency | time (ms) | ratio | Pareto |",
            "|---|---|---|---|---|---|",
        ]
        for r in self.ladder(ladder):
            lines.append(
                f"| {r.name} | {_error(r.amplitude_error)} | {_error(r.frequency_error)} | {1e3 * r.seconds:.3g} | "
                f"{r.ratio:.2f} | {'yes' if r.pareto else ''} |"
            )
        return "\n".join(lines)


def _error(value: float, sign: bool = True) -> str:
    return (f"{value:+.1e}" if sign else f"{value:.1e}") if np.isfinite(value) else "none"


# ---- ladders ----


def ladder_values(problem: Problem, name: str) -> list[Any]:
    """Values that a ladder of a setting takes by default, as far as the model allows."""
    if name == "harmonics":
        return [n for n in (1, 2, 3, 5, 7, 9) if not missing_harmonics(problem, n)]
    if name == "evaluation":
        least = 4 * problem.harmonic_numbers[-1] + 4
        return [*(Sampled(n) for n in (32, 64, 128, 256, 512, 1024) if n >= least), "exact"]
    if name == "contact_points":
        full = points_on_a_face(problem)
        return [n for n in (1, 4, 9, 16, 24, 48, 96) if n < full] + [full]
    if name == "blade_modes":
        return [n for n in (2, 3, 5, 10, 15, 20) if n < _most_modes(problem, "constrained")]
    if name == "damper_modes":
        return [n for n in (0, 1, 2, 4, 6) if n <= _most_modes(problem, "free") - 6]
    raise SettingError(
        f"vary: expected a mapping of settings to values, or some of {(*SOURCE_OF, 'damper_modes')}, found '{name}'"
    )


def _most_modes(problem: Problem, kind: str) -> int:
    bodies = [body for body in problem.model.bodies.values() if body.kind == kind]
    return min((basis.n_modes for body in bodies for basis in body.bases.values()), default=0)


def _name(setting: str, value: Any) -> str:
    if isinstance(value, Sampled):
        return f"{value.n_time} samples" + ("" if value.interpolate else ", plain")
    if setting == "evaluation":
        return "exact events"
    text = " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
    return f"{setting.replace('_', ' ')} {text}"


def make_ladders(
    problem: Problem, vary: str | Sequence[str] | Mapping[str, Sequence[Any]] | None, combine: bool = False
) -> list[Setting]:
    """Rungs of ladders from what is to be varied; see :func:`accuracy_cost`."""
    if vary is None:
        vary = ("harmonics", "evaluation", "contact_points", "blade_modes")
    if isinstance(vary, str):
        vary = (vary,)
    if not isinstance(vary, Iterable):
        raise validate.unfit("vary", "names of settings, or a mapping of them to values", vary)
    values = dict(vary) if isinstance(vary, Mapping) else {name: ladder_values(problem, name) for name in vary}
    if not values:
        raise validate.unfit("vary", "at least one setting of a study", vary)
    known = {f.name for f in fields(problem) if f.init} - {"model"}
    for name in values:
        if name not in known:
            raise SettingError(f"vary: expected settings of a study, out of {sorted(known)}, found '{name}'")
        if not isinstance(values[name], Sequence | np.ndarray) or isinstance(values[name], str) or not len(values[name]):
            raise validate.unfit(f"vary '{name}'", "a sequence of one or more values", values[name])
    if not combine:
        return [Setting(name, _name(name, v), {name: v}) for name, given in values.items() for v in given]
    ladder = " x ".join(values)
    out = []
    for chosen in itertools.product(*values.values()):
        changes = dict(zip(values, chosen))
        out.append(Setting(ladder, ", ".join(_name(n, v) for n, v in changes.items()), changes))
    return out


def varied(problem: Problem, changes: Mapping[str, Any]) -> Problem:
    """The study with settings changed; more contact points than the model has are all that it has."""
    changes = dict(changes)
    if "harmonics" in changes:
        problem = with_stand_ins(problem, changes.pop("harmonics"))
    points = changes.get("contact_points")
    if points is not None and points >= points_on_a_face(problem):
        changes["contact_points"] = None
    return replace(problem, **changes) if changes else problem


def richest(problem: Problem, settings: Sequence[Setting]) -> tuple[dict[str, Any], str]:
    """Changes that are richer than those of all rungs of a ladder, in every setting that they vary."""
    names = dict.fromkeys(name for s in settings for name in s.changes)
    out: dict[str, Any] = {}
    for name in names:
        given = [s.changes[name] for s in settings if name in s.changes]
        if name == "harmonics":
            top = max(max(v) if isinstance(v, tuple) else v for v in given)
            out[name] = min(top + max(3, top // 2), 64)
        elif name == "evaluation":
            out[name] = "exact"
        elif name == "contact_points":
            out[name] = points_on_a_face(problem)
        elif name == "blade_modes":
            out[name] = _most_modes(problem, "constrained")
        elif name == "damper_modes":
            out[name] = max(_most_modes(problem, "free") - 6, 0)
        elif name in ("bias", "variable_normal_load", "separation", "constraints"):
            out[name] = True
        elif name == "single_basis":
            out[name] = False
        else:
            out[name] = given[-1]
    return out, ", ".join(_name(n, v) for n, v in out.items()) or "the same study"


def accuracy_cost(
    problem: Problem,
    preload: float | None = None,
    frequency: tuple[float, float] | None = None,
    *,
    quantity: str | Solver = "peak",
    vary: str | Sequence[str] | Mapping[str, Sequence[Any]] | Sequence[Setting] | None = None,
    combine: bool = False,
    reference: Mapping[str, Any] | None = None,
    reference_quantity: bool = False,
    tolerance: float = 0.01,
    repeats: int = 3,
    progress: bool = False,
) -> AccuracyCost:
    """What more or less accurate settings of a study cost in time.

    Parameters
    ----------
    problem : Problem
        Any; what is not varied is as it is there.
    preload : float, N, optional
        By default one at which the contact slips in part (:func:`slipping_preload`); 0 where no body carries a load.
    frequency : (low, high), Hz, optional
        Interval of the peak; around the first mode by default.
    quantity : {"peak", "curve"} or callable
        Found by the search for the peak, read off a tracking curve, or by a function of (study, preload, interval) that
        returns amplitude (m) and frequency (Hz).
    vary : str, sequence of str, mapping of str to values, or sequence of Setting
        Settings of the study and the values that they take; for "harmonics", "evaluation", "contact_points",
        "blade_modes" and "damper_modes" the name is enough.  The first four by default.
    combine : bool
        One ladder of all combinations instead of one for each setting.
    reference : mapping, optional
        Settings of the reference solution; richer than all rungs of the ladder by default.
    reference_quantity : bool
        Find the reference by the quantity too, where it is not the highest peak; its own error is still that of the peak.
    tolerance : float
        For the recommendation.
    repeats : int
        Of each timing.
    progress : bool
        Show a progress bar.

    Returns
    -------
    AccuracyCost

    Raises
    ------
    SettingError
        If a setting or a quantity is not known.
    BdamperError
        If the reference has no peak.
    """
    if not callable(quantity):
        validate.choice("quantity", quantity, tuple(QUANTITIES))
    repeats = validate.whole("repeats", repeats, least=1)
    tolerance = validate.number("tolerance", tolerance, above=0.0, below=1.0)
    if reference is not None:
        validate.instance("reference", reference, Mapping, "a mapping of settings to values")
    solver = QUANTITIES[quantity] if isinstance(quantity, str) else quantity
    interval = peak_interval(validate.instance("study", problem, Problem, "a Study"), frequency)
    preload = slipping_preload(problem, interval) if preload is None else problem.check_preload(preload)
    settings: list[Setting]
    if not isinstance(vary, (str, Mapping)) and vary is not None and any(isinstance(v, Setting) for v in vary):
        settings = list(vary)  # type: ignore[arg-type]
    else:
        settings = make_ladders(problem, vary, combine)  # type: ignore[arg-type]
    ladders: dict[str, list[Setting]] = {}
    for s in settings:
        ladders.setdefault(s.ladder, []).append(s)
    own = solver if reference_quantity else None
    references = [_reference(problem, name, rungs, preload, interval, reference, own) for name, rungs in ladders.items()]
    answers, seconds = _timed(problem, settings, solver, preload, interval, repeats, progress)
    rungs = [rung for ref in references for rung in _rungs(ref, settings, answers, seconds)]
    return AccuracyCost(
        quantity if isinstance(quantity, str) else getattr(quantity, "__name__", "peak"),
        preload, (float(interval[0]), float(interval[1])), tolerance, tuple(rungs), tuple(references), repeats,
        problem.record(None),
    )  # fmt: skip


def _rungs(
    reference: Reference, settings: Sequence[Setting], answers: Sequence[Answer], seconds: Sequence[float]
) -> list[Rung]:
    """The settings of one ladder beside its reference."""
    own = [i for i, s in enumerate(settings) if s.ladder == reference.ladder]
    cheapest = min(seconds[i] for i in own)
    rows = []
    for i in own:
        amplitude, at = answers[i]
        errors = amplitude / reference.amplitude - 1.0, at / reference.frequency - 1.0
        rows.append(
            Rung(reference.ladder, settings[i].name, amplitude, at, *errors, seconds[i], seconds[i] / cheapest, False)
        )
    return [replace(r, pareto=_on_front(r, rows)) for r in rows]


def slipping_preload(problem: Problem, frequency: tuple[float, float], share: float = 0.3) -> float:
    """A preload (N) under which part of the contact slips at resonance; 0 where no body carries a load.

    Friction can then carry a share of the tangential forces of the stuck response at its largest.

    Parameters
    ----------
    problem : Problem
    frequency : (low, high), Hz
        Interval of the peak.
    share : float
        Of the tangential forces, summed over all points.

    Raises
    ------
    BdamperError
        If there is no static state, or no friction.
    """
    if not problem.carries_load:
        return 0.0
    state = problem.static(1.0)
    capacity = float(problem.friction @ np.abs(state.force[:, 2])) if state.converged else 0.0
    if not capacity > 0.0:
        raise BdamperError("preload: expected one to be given, since nothing slips in this study, found none")
    response = stuck(problem, frequency)
    c, s = problem.system(1.0).slices(1)
    u = response.unknowns[int(np.argmax(response.amplitude))]
    motion = np.abs(problem.bases[1].G[:, :2] @ (u[c] - 1j * u[s]))
    return share * float((problem.stuck_springs(state)[:, :2] * motion).sum()) / capacity


def _on_front(rung: Rung, others: Sequence[Rung]) -> bool:
    beaten = any(
        (o.seconds < rung.seconds and o.error <= rung.error) or (o.seconds <= rung.seconds and o.error < rung.error)
        for o in others
    )
    return bool(np.isfinite(rung.error)) and not beaten


def _reference(
    problem: Problem,
    ladder: str,
    rungs: Sequence[Setting],
    preload: float,
    interval: tuple[float, float],
    given: Mapping[str, Any] | None,
    solver: Solver | None,
) -> Reference:
    """The solution of the richest settings, its peak refined, and its own error."""
    begin = time.perf_counter()
    names = dict.fromkeys(name for s in rungs for name in s.changes)
    if given is None:
        changes, text = richest(problem, rungs)
    else:
        changes = dict(given)
        text = ", ".join(_name(n, v) for n, v in changes.items()) or "the same study"
    best = varied(problem, changes)
    try:
        peak = highest_peak(best, preload, interval)
    except BdamperError as why:
        raise BdamperError(f"reference of the ladder '{ladder}' ({text}): {why}") from why
    sources = list(dict.fromkeys(SOURCE_OF[n] for n in names if n in SOURCE_OF)) or ["solver"]
    own = estimate_errors(best, peak, preload, sources=sources)
    known = [s for s in own.sources if s.known]
    error = float(sum(s.size for s in known)) if len(known) == len(own.sources) else float("nan")
    against = "; ".join(s.against for s in own.sources)
    if "damper_modes" in names:
        error, against = float("nan"), "own error not known: all elastic modes that the model has"
    if solver is not None:
        amplitude, at = solver(best, preload, interval)
        return Reference(ladder, text, float(amplitude), float(at), error, against, time.perf_counter() - begin)
    return Reference(ladder, text, peak.amplitude, peak.frequency, error, against, time.perf_counter() - begin)


def _timed(
    problem: Problem,
    settings: Sequence[Setting],
    solver: Solver,
    preload: float,
    interval: tuple[float, float],
    repeats: int,
    progress: bool,
) -> tuple[list[Answer], list[float]]:
    """Answers and median times, the settings taking turns."""
    studies = [varied(problem, s.changes) for s in settings]
    for s in studies:
        s.static(preload)
        s.system(preload)
    times = np.empty((repeats, len(settings)))
    answers: list[Answer] = [(np.nan, np.nan)] * len(settings)
    turns = [(k, i) for k in range(repeats) for i in range(len(settings))]
    for k, i in each(turns, progress, "settings", "setting"):
        begin = time.process_time()
        amplitude, at = (settings[i].solver or solver)(studies[i], preload, interval)
        times[k, i] = time.process_time() - begin
        answers[i] = float(amplitude), float(at)
    return answers, [float(t) for t in np.median(times, axis=0)]
