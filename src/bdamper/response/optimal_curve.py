"""Optimal curve and frequency-shift curve: the highest point of the response over the preload, from free to stuck.

The whole response over frequency is followed at each preload, side by side on threads; its highest point is the value there
(:mod:`bdamper.response.highest_peak`).  More curves are followed between preloads where the tangents over the preload say
that the least value may lie (:mod:`bdamper.response.minimum_search`); on a smooth branch it is found by a root of the
adjoint derivative first.  Every value, that of the optimum too, is the highest point of a whole curve of its own.

The whole response at one preload as part of an optimal curve, and how a file keeps it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, suppress
from contextvars import copy_context
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.parameters import study_fingerprint
from bdamper.harmonic_balance.problem import Problem
from bdamper.response.events import ContinuationOptions
from bdamper.response.highest_peak import REACH, AtPreload, check_options, found_at, given_up
from bdamper.response.minimum_search import Place, agree, least
from bdamper.response.optimal_curve_result import OptimalCurve, OptimumPoint
from bdamper.response.peak import Family, Peak, PeakOptions, find_peak, linear_peak, peak_interval
from bdamper.response.response_curve import NO_STEADY, open_at_rest, rattles, without_points
from bdamper.response.sensitivity import amplitude_sensitivity
from bdamper.util import validation
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, NOT_FOUND, BdamperError, with_reason
from bdamper.util.progress import Cost, LongWork, executor_errors, one_thread, progress_stages, stopped_by
from bdamper.util.rootfinding import find_root
from bdamper.util.storage import INSTALLED, ResultsFile

# ---- The whole response at one preload as part of an optimal curve, and how a file keeps it ----


LOST = (ArithmeticError, np.linalg.LinAlgError)
"""What a solution raises that cannot be computed, as where numbers overflow: one preload is lost by it, no curve."""


@one_thread
def at_preload(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    options: PeakOptions | None = None,
    budget: int | None = None,
    stop: Event | None = None,
) -> AtPreload:
    """The response at a preload; another thread ends the work by setting ``stop``."""
    with stopped_by(stop or Event()):
        try:
            found = found_at(problem, preload, frequency, options=options, budget=budget)
        except LOST as error:
            why = f"failed: {type(error).__name__}: {error}"
            lost = without_points(problem, preload, why, ContinuationOptions(), Cost())
            found = AtPreload(preload, lost, None, np.nan, "", Cost())
    curve, slope, why = found.curve, np.nan, ""
    if found.top is not None:
        why = rattles(curve, open_at_rest(problem, preload))
        peak = found.top.peak
        with suppress(*LOST, BdamperError):  # none at a corner
            slope = amplitude_sensitivity(peak, problem.system, preload) * preload / peak.amplitude
    light = replace(curve, unknowns=np.zeros((len(curve), 0)), harmonics=curve.harmonics[:, :2], start_log=())
    return replace(found, curve=light, slope=slope, rattles=why)


# ---- Optimal curve and frequency-shift curve ----


BUDGET = 8000
"""Evaluations that a curve may take in the search, the default at an optimum.  Curves with many folds take some 4,000, one
in tens is lost in a tangle of them and takes all it gets, to no avail: 17 of 39 s of one optimal curve."""
FLAT = 1e-6
"""Relative range of the resonance amplitude over all preloads below which the curve has no optimum."""
IN_A_ROW = 2
"""Neighbouring preloads whose curves show that the damper rattles, below which no more are followed."""


@one_thread
def optimal_curve(
    problem: Problem,
    preload: tuple[float, float] | Sequence[float] | NDArray = (10.0, 25e3),
    n: int = 50,
    *,
    frequency: tuple[float, float] | None = None,
    mode: int = 1,
    options: PeakOptions | None = None,
    progress: bool = False,
    resume: str | Path | None = None,
    executor: Executor | None = None,
) -> OptimalCurve:
    """Resonance amplitude and frequency over the preload, and the preload of least amplitude.

    Parameters
    ----------
    problem : Problem
    preload : (low, high) or sequence of more than two values, N
        Two values: ``n`` preloads between them, equal ratios apart.
    n : int
    frequency : (low, high), Hz, optional
        Where to look for peaks; around the free and the stuck resonance of ``mode`` by default.
    mode : int
        Mode of the constrained bodies, 1 for the lowest.
    options : PeakOptions
    progress : bool
    resume : path, optional
        File for all finished curves: interrupted work continues from there and ends with the same result.
    executor : concurrent.futures.Executor, optional
        On which the curves are followed; threads, as many as there are cores, by default.

    Returns
    -------
    OptimalCurve
        After Ctrl-C, or the end of the executor, with what was known by then.

    Raises
    ------
    BdamperError
        If nothing was found at any of the preloads, the file is of another search, or the executor takes no task.
    KeyboardInterrupt
        If the search was interrupted before it found anything.
    """
    start = time.perf_counter()
    values = preload_values(preload, n)
    validation.flag("progress", progress)
    check_options(options)
    why = problem.why_no_load
    validation.check(problem.carries_load, "optimal_curve", "a model with a body that carries a load", f"that {why}")
    frequency = peak_interval(problem, frequency, float(values[-1]), mode)
    free = linear_peak(problem, frequency, float(values[-1]), stuck=False)
    stuck = linear_peak(problem, frequency, float(values[-1]), stuck=True)
    asked = {"preload": values, "options": options}
    with Curves(problem, frequency, options, executor, resume, progress, asked) as curves:
        optimum = _optimum(curves, values)
    known = curves.known
    if curves.interrupted:
        optimum = _least_so_far(curves)
    if not any(there.top for there in known.values()):
        if curves.interrupted:
            validation.check(not curves.work.reason, "executor", "one that takes tasks", curves.work.reason)
            raise KeyboardInterrupt
        ends = ", ".join(dict.fromkeys(there.status for there in known.values()))
        raise BdamperError(
            f"no peak found at any of {len(values)} preloads from {values[0]:g} to {values[-1]:g} N "
            f"between {frequency[0]:.6g} and {frequency[1]:.6g} Hz: {ends}"
        )
    edge = rattling_below(known)
    settings = problem.record(None) | {"frequency": [float(f) for f in frequency]}
    return OptimalCurve(
        **_columns(known, values, edge, problem.n_unknowns),
        curves=tuple(known[p].curve for p in sorted(known)), free=free, stuck=stuck, optimum=optimum,
        cost=curves.cost(start), settings=settings, model_hash=problem.model.hash, lowest_steady_preload=edge,
    )  # fmt: skip


@dataclass
class Curves:
    """Whole curves at some preloads, followed side by side; a context that an interruption ends quietly.

    Parameters
    ----------
    problem : Problem
    frequency : (low, high), Hz
    options : PeakOptions, optional
    executor : Executor, optional
        Threads of its own without one.
    resume : path, optional
    progress : bool
    asked : mapping
        What else tells the file from those of other searches.
    known : dict of float to AtPreload
        What is finished, by preload.
    """

    problem: Problem
    frequency: tuple[float, float]
    options: PeakOptions | None = None
    executor: Executor | None = None
    resume: str | Path | None = None
    progress: bool = False
    asked: dict[str, Any] = field(default_factory=dict)
    known: dict[float, AtPreload] = field(default_factory=dict)
    interrupted: bool = False

    def __enter__(self) -> Curves:
        self.stack, self.work = ExitStack(), LongWork()
        self.report: Callable[[str, int, int], None] | None = None
        self.file, self.stored = None, dict[int | str, dict[str, Any]]()
        if self.resume is not None:
            header = {"format": "bdamper-optimal-search", "version": 3, "study": study_fingerprint(self.problem)}
            header |= INSTALLED.attributes() | {"frequency": self.frequency} | self.asked
            self.file = ResultsFile(self.resume, header, "search for an optimal curve")
            self.stack.enter_context(closing(self.file))
            self.stored = self.file.records
        if self.executor is None:
            self.executor = self.stack.enter_context(ThreadPoolExecutor(os.cpu_count() or 1))
        if self.progress:
            self.report = self.stack.enter_context(progress_stages("optimal curve", "curve"))
        self.problem.system(0.0)  # what all preloads share is made before threads ask for it
        self.problem.static(1.0)
        self.work.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> bool:
        quiet = self.work.__exit__(kind, *error)
        self.interrupted = self.work.interrupted
        self.stack.close()
        return quiet

    def follow(self, preloads: Sequence[float], budget: int | None = None, row: int = 0) -> list[AtPreload]:
        """The curves at some preloads, in their order; with ``row`` up to so many that rattle one after another.

        An interruption keeps those that are finished.
        """
        assert self.executor is not None
        stop, running = Event(), dict[float, Future[AtPreload]]()
        out: list[AtPreload] = []
        try:
            for p in preloads:
                if p not in self.known and repr(p) in self.stored:
                    self.known[p] = AtPreload.of(self.stored[repr(p)])
                elif p not in self.known:
                    threads = isinstance(self.executor, ThreadPoolExecutor)
                    job = at_preload, self.problem, p, self.frequency, self.options, budget, stop if threads else None
                    with executor_errors(RuntimeError):  # as one that was shut down raises it
                        running[p] = self.executor.submit(*((copy_context().run, *job) if threads else job))
            for i, p in enumerate(preloads):
                if row and len(out) >= row and all(there.rattles for there in out[-row:]):
                    break
                if self.report is not None:
                    self.report(f"{p:.4g} N", len(self.known), len(self.known) + len(preloads) - i)
                if p in running:
                    with executor_errors():
                        there = running.pop(p).result()
                    self._keep(there)
                out.append(self.known[p])
        except BaseException:
            for p, future in running.items():
                if future.done() and not future.cancelled() and future.exception() is None:
                    self._keep(future.result())
            raise
        finally:
            stop.set()  # ends what is still at work
            for future in running.values():
                future.cancel()
        return out

    def _keep(self, there: AtPreload) -> None:
        self.known[there.preload] = there
        if self.file is not None:
            self.file.append(there.record())

    def cost(self, start: float) -> Cost:
        """Cost of all curves, on all threads, in the time since the start."""
        return replace(sum((there.cost for there in self.known.values()), Cost()), seconds=time.perf_counter() - start)


def _optimum(curves: Curves, values: NDArray) -> OptimumPoint:
    """The preload of the least value, after more curves where it may lie."""
    curves.follow([float(p) for p in values[::-1]], BUDGET, row=IN_A_ROW)
    known = curves.known
    edge = rattling_below(known)
    there = {float(np.log(p)): known[p] for p in known if p >= edge}  # the edge, too: the least may lie just above it
    found = [item for item in there.values() if np.isfinite(item.value) and item.preload > edge]
    if not found:
        return OptimumPoint(np.nan, np.nan, np.nan, "none", np.inf, with_reason(NOT_FOUND, "no preload has a value"))
    height = [item.value for item in found]
    if len(found) > 1 and max(height) - min(height) <= FLAT:
        peak = found[int(np.argmin(height))].top.peak  # type: ignore[union-attr]
        flat = with_reason(NOT_FOUND, "the preload does not matter")
        return OptimumPoint(np.nan, peak.amplitude, peak.frequency, "flat", np.inf, flat)

    def place(x: float) -> Place:
        steady = there[x].preload > rattling_below(known)
        return Place(x, there[x].value if steady else np.inf, there[x].slope)

    def ask(places: Sequence[float]) -> list[Place]:
        there.update(zip(places, curves.follow([float(np.exp(x)) for x in places])))
        return [place(x) for x in places if x in there]

    def settle(a: Place, b: Place, x: float) -> float | None:
        tops = [there[p.x].top for p in (a, b)]
        ends = [top.peak for top in tops if top is not None]
        return smooth_minimum(curves.problem.system, ends, a, b, curves.options)

    places, best = least([place(x) for x in there], ask, settle)
    at, edge, kind = there[places[best.index].x], rattling_below(known), best.kind
    assert at.top is not None
    if kind == "unknown" and not at.slope < 0.0 and there[places[best.index - 1].x].preload <= edge:
        kind = "edge"
    status = COMPLETE
    lower = [p for p in sorted(known) if p > edge and not known[p].known and not known[p].height >= at.top.peak.amplitude]
    if lower:
        status = with_reason(INCOMPLETE, f"{len(lower)} preloads without a value could be lower, first {lower[0]:.6g} N")
    elif best.open is not None:
        low, high = np.exp(best.open)
        status = with_reason(INCOMPLETE, f"the highest peak could be lower between {low:.6g} and {high:.6g} N")
    elif why := given_up(at.curve):
        status = with_reason(INCOMPLETE, f"{why}, where its peak could be higher")
    elif at.top.note:
        reason = f"the response is {at.top.note}; another resonance may be highest, widen frequency"
        status = with_reason(INCOMPLETE, reason)
    return OptimumPoint(at.preload, at.top.peak.amplitude, at.top.peak.frequency, kind, best.uncertainty, status)


def smooth_minimum(
    family: Family, ends: Sequence[Peak], a: Place, b: Place, options: PeakOptions | None = None
) -> float | None:
    """ln(parameter) of the least amplitude of the peak that two places share, by a root of its derivative."""
    near = dict(zip((a.x, b.x), ends))

    def slope(x: float) -> float:
        p, low, high = float(np.exp(x)), max(k for k in near if k <= x), min(k for k in near if k >= x)
        first, last = near[low], near[high]
        share = (x - low) / (high - low) if high > low else 0.0
        guess = first.y + share * (last.y - first.y)
        start = first if share < 0.5 else last
        found = find_peak(
            family(p), guess, tangent=start.tangent, scale=start.scale, curvature=start.curvature, options=options,
            parameter=p, reach=REACH,
        )  # fmt: skip
        if not found.converged or found.corner:
            raise ArithmeticError("the peak is lost")
        near[x] = found
        return amplitude_sensitivity(found, family, p) * p / found.amplitude

    optimum_tolerance = 1e-7  # relative, on the preload of a smooth optimum
    try:
        root = find_root(slope, (a.x, a.slope), (b.x, b.slope), optimum_tolerance)
    except (*LOST, BdamperError):
        return None
    return float(root.at)


def _least_so_far(curves: Curves) -> OptimumPoint:
    """The least value known at any preload when the search was interrupted."""
    edge = rattling_below(curves.known)
    found = [(at.value, p, at.top.peak) for p, at in curves.known.items() if p > edge and at.known and at.top]
    status = with_reason(INTERRUPTED, curves.work.reason or "by the user")
    if not found:
        return OptimumPoint(np.nan, np.nan, np.nan, "none", np.inf, status)
    _, p, peak = min(found, key=lambda item: item[0])
    return OptimumPoint(p, peak.amplitude, peak.frequency, "unknown", np.inf, status)


def rattling_below(known: dict[float, AtPreload]) -> float:
    """The highest preload (N) at and below which all curves show that the damper rattles; 0 if the lowest does not."""
    out = 0.0
    for p in sorted(known):
        if not known[p].rattles:
            break
        out = p
    return out


def _status(row: AtPreload | None, preload: float, edge: float, why: str) -> str:
    """What is known at a preload."""
    if preload <= edge:
        return with_reason(NOT_FOUND, f"{NO_STEADY} below {edge:.6g} N: {why}")
    return with_reason(NOT_FOUND, "no curve was followed") if row is None else row.status


def _columns(known: dict[float, AtPreload], values: NDArray, edge: float, n_unknowns: int) -> dict[str, Any]:
    """Fields of an optimal curve with one entry for each preload."""
    rows, why = [known.get(float(p)) for p in values], known[edge].rattles if edge else ""
    tops = [None if row is None or row.preload <= edge or not row.known else row.top for row in rows]

    def column(name: str, fill: Any) -> NDArray:
        return np.array([fill if top is None else getattr(top.peak, name) for top in tops])

    places = [Place(np.log(p), np.inf if row is None else row.value, np.nan if row is None else row.slope)
              for p, row in zip(values, rows)]  # fmt: skip
    onward = [bool(np.isfinite(a.value + b.value)) and agree(a, b) for a, b in zip(places, places[1:])]
    return {
        "preload": values,
        "amplitude": column("amplitude", np.nan),
        "lower_bound": np.array([np.nan if top or not row else row.height for row, top in zip(rows, tops)]),
        "frequency": column("frequency", np.nan),
        "shares": np.array([np.full(3, np.nan) if top is None else top.peak.shares for top in tops]),
        "residual": column("residual", np.nan),
        "unknowns": np.array([np.full(n_unknowns, np.nan) if top is None else top.peak.y[:-1] for top in tops]),
        "kind": tuple("" if top is None else top.kind for top in tops),
        "status": tuple(_status(row, p, edge, why) for row, p in zip(rows, values)),
        "goes_on": np.array([False, *onward]),
    }  # fmt: skip


def preload_values(preload: Any, n: int) -> NDArray:
    """Preloads of a curve: ``n`` between two given ones, equal ratios apart, or the longer sequence that is given.

    Raises
    ------
    SettingError
        If they are not positive and increasing.
    """
    validation.check_value(np.ndim(n) == 0, "n", "a whole number, and an interval by its name as frequency=(low, high)", n)
    values = validation.numbers("preload", preload, above=0.0, unit="N")
    if len(values) < 2 or np.any(np.diff(values) <= 0.0):
        raise validation.invalid("preload", "(low, high) or a longer sequence of increasing values", preload)
    n = validation.integer("n", n, least=2)
    return values if len(values) > 2 else np.geomspace(values[0], values[1], n)
