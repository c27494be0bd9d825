"""Optimal curve and frequency-shift curve: the highest response over the preload, free to stuck.

The optimum is chosen in these steps:

1. the complete response curve is computed at each preload, concurrently; its highest point is the
   value at this preload (``bdamper.response.highest_peak``), and an adjoint solution gives its
   slope d ln(amplitude)/d ln(preload);
2. :func:`bdamper.response.scalar_search.find_minimum` chooses further preloads at which the value
   may be smaller;
3. on a smooth branch of peaks :func:`smooth_minimum` first solves for the preload of zero slope.

Every value, including the optimum, is the highest point of a complete curve at its preload.
:class:`Curves` stores finished curves in a file and resumes from it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
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
from bdamper.harmonic_balance.rolling import rolling_dampers
from bdamper.model.kinematics import centrifugal_load
from bdamper.response.events import ContinuationOptions
from bdamper.response.followed_peak import with_lower_preloads, without_lost_peaks
from bdamper.response.headline import NEAR_BEST
from bdamper.response.highest_peak import REACH, AtPreload, check_options, found_at
from bdamper.response.linear_limits import linear_peak, peak_interval
from bdamper.response.optimal_curve_result import OptimalCurve, OptimumPoint
from bdamper.response.peak import Family, Peak, PeakOptions, find_peak
from bdamper.response.response_curve import open_at_rest, rattles, without_points
from bdamper.response.response_curve_result import NO_STEADY, ResponseCurve
from bdamper.response.scalar_search import Sample, find_minimum, find_root, on_one_branch
from bdamper.response.sensitivity import amplitude_sensitivity
from bdamper.util import validation
from bdamper.util.errors import (
    COMPLETE,
    INCOMPLETE,
    INTERRUPTED,
    NOT_FOUND,
    BdamperError,
    SettingError,
    StaticError,
    with_reason,
)
from bdamper.util.formatting import counted
from bdamper.util.progress import (
    Cost,
    LongWork,
    executor_errors,
    one_thread,
    progress_stages,
    stopped_by,
)
from bdamper.util.storage import INSTALLED, ResultsFile, json_line
from bdamper.util.workers import workers

# ---- response at one preload ----


LOST = (ArithmeticError, ValueError, MemoryError)
"""Errors of a computation that fails at one preload, for example by overflow; they do not end the
optimal curve.

ValueError is what SciPy raises for matrices with infinite entries; LinAlgError and SettingError are
ValueErrors too.
"""
BUDGET = 8000
"""First budget of a curve in evaluations.

Curves with many folds take some 4,000, with contacts 20 times too stiff up to 10,000.  A curve that
needs more is followed again with the default budget, unless the damper rattles: such curves do not
count.  With the default budget for all curves a search on the reference disk (from 10 N, three
harmonics) takes 23 instead of 11 s, with 24 points 105 instead of 35 s.
"""


@one_thread
def at_preload(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    options: PeakOptions | None = None,
    budget: int | None = None,
    stop: Event | None = None,
) -> AtPreload:
    """Compute the response at a preload; another thread stops it by setting ``stop``.

    A curve that uses up ``budget`` is followed again with the default budget, unless the damper
    rattles.
    """
    cost, slope = Cost(), np.nan
    for most in dict.fromkeys((budget, None)):
        with stopped_by(stop or Event()):
            try:
                response = found_at(problem, preload, frequency, options=options, budget=most)
                why = (
                    rattles(response.curve, open_at_rest(problem.at(preload)))
                    if response.top
                    else ""
                )
            # InterruptedCurve is a KeyboardInterrupt, which ends the search with its results
            except (*LOST, BdamperError) as error:
                failure, why = f"failed: {type(error).__name__}: {error}", ""
                lost = without_points(problem, preload, failure, ContinuationOptions(), Cost())
                response = AtPreload(preload, lost, None, np.nan, "", Cost())
        curve, cost = response.curve, cost + response.cost
        if response.known or why or (most and curve.cost.evaluations < most):
            break
    if response.top is not None:
        peak = response.top.peak
        with suppress(*LOST, BdamperError):  # a corner has no slope
            slope = amplitude_sensitivity(peak, problem.system, preload) * preload / peak.amplitude
    return replace(response, curve=_light(curve), slope=slope, rattles=why, cost=cost)


def _light(curve: ResponseCurve) -> ResponseCurve:
    """Return a response curve without its unknowns, higher harmonics and log."""
    return replace(
        curve, unknowns=np.zeros((len(curve), 0)), harmonics=curve.harmonics[:, :2], start_log=()
    )


NOT_FOLLOWED = "no curve was followed"


def _without_curve(problem: Problem, preload: float) -> ResponseCurve:
    """Return an empty response curve at a preload to which the search did not come."""
    return _light(without_points(problem, preload, NOT_FOLLOWED, ContinuationOptions(), Cost()))


# ---- optimal curve ----


FLAT = 1e-6
"""Relative range of the amplitude over all preloads below which there is no optimum."""
MAX_RATTLING = 2
"""Number of consecutive preloads with a rattling damper after which no lower ones are followed."""


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
    """Compute resonance amplitude and frequency over the preload, and the optimum preload.

    Parameters
    ----------
    problem : Problem
    preload : (low, high) or sequence of more than two values, N
        Two limits give ``n`` preloads in geometric progression.
    n : int
    frequency : (low, high), Hz, optional
        Interval of the peaks; around the free and the stuck resonance of ``mode`` by default.
    mode : int
        Mode of the constrained bodies, 1 for the lowest.
    options : PeakOptions
    progress : bool
    resume : path, optional
        File for all finished curves.  Interrupted work continues from it with the same result.
    executor : concurrent.futures.Executor, optional
        Executor of the curves; by default threads, see :func:`bdamper.set_workers`.

    Returns
    -------
    OptimalCurve
        Table of the requested preloads and the preloads of the search, with the optimum.  After
        Ctrl-C, or the end of the executor, it contains the part computed so far.

    Raises
    ------
    BdamperError
        If nothing was found at any of the preloads, the file belongs to another search, or the
        executor accepts no task.
    KeyboardInterrupt
        If the search was interrupted before it found anything.
    """
    start = time.perf_counter()
    values = preload_values(preload, n)
    validation.flag("progress", progress)
    check_options(options)
    why = problem.why_no_load
    validation.check(
        problem.carries_load,
        "optimal_curve",
        "a model with a body that carries a load",
        f"that {why}",
    )
    highest = problem.at(float(values[-1]))
    frequency = curve_interval(problem, values, frequency, mode)
    free, stuck = (linear_peak(highest, frequency, stuck=stuck) for stuck in (False, True))
    asked = {"preload": values, "options": options}
    with Curves(problem, frequency, options, executor, resume, progress, asked) as curves:
        optimum = _optimum(curves, values)
    known = curves.known
    if curves.interrupted:
        optimum = _interrupted_optimum(curves)
    if not any(there.top for there in known.values()):
        if curves.interrupted:
            validation.check(
                not curves.work.reason, "executor", "one that takes tasks", curves.work.reason
            )
            raise KeyboardInterrupt
        ends = ", ".join(dict.fromkeys(there.status for there in known.values()))
        raise BdamperError(
            f"no peak found at any of {len(values)} preloads from {values[0]:g} to {values[-1]:g} N "
            f"between {frequency[0]:.6g} and {frequency[1]:.6g} Hz: {ends}"
        )
    edge = rattling_below(known)
    arm = float("nan")
    with suppress(SettingError):  # a body on the axis, or without a mass
        arm = centrifugal_load(problem.model) if problem.settings.engine_order else arm
    settings = problem.record(None) | {"frequency": [float(f) for f in frequency]}
    return OptimalCurve(
        **_columns(problem, known, values, edge), free=free, stuck=stuck, optimum=optimum, cost=curves.cost(start),
        settings=settings, model_hash=problem.model.hash, lowest_steady_preload=edge, mass_radius=arm,
        model_doubts=rolling_dampers(problem),
    )  # fmt: skip


def curve_interval(
    problem: Problem, preloads: NDArray, frequency: tuple[float, float] | None, mode: int = 1
) -> tuple[float, float]:
    """Return the given interval (Hz), or that of the resonances of a mode.

    Without an interval the highest preload with a static state decides.

    Raises
    ------
    StaticError
        If no preload has a static state.
    """
    lost: StaticError | None = None
    for preload in preloads[::-1]:
        try:
            return peak_interval(problem.at(float(preload)), frequency, mode)
        except StaticError as error:
            lost = lost or error
    assert lost is not None
    raise lost


@dataclass
class Curves:
    """Response curves at several preloads, computed concurrently.

    The context manager handles interruptions.

    Parameters
    ----------
    problem : Problem
    frequency : (low, high), Hz
    options : PeakOptions, optional
    executor : Executor, optional
        Threads by default.
    resume : path, optional
    progress : bool
    asked : mapping
        Further data that identify the search in the file.
    known : dict of float to AtPreload
        Finished curves by preload.
    checked_below : set of float
        Preloads (N) whose peaks were followed from preloads below the range.
    """

    problem: Problem
    frequency: tuple[float, float]
    options: PeakOptions | None = None
    executor: Executor | None = None
    resume: str | Path | None = None
    progress: bool = False
    asked: dict[str, Any] = field(default_factory=dict)
    known: dict[float, AtPreload] = field(default_factory=dict)
    checked_below: set[float] = field(default_factory=set)
    interrupted: bool = False

    def __enter__(self) -> Curves:
        self.stack, self.work = ExitStack(), LongWork()
        self.file, self.stored = None, dict[int | str, dict[str, Any]]()
        if self.resume is not None:
            header = {
                "format": "bdamper-optimal-search",
                "version": 3,
                "study": study_fingerprint(self.problem),
            }
            header |= INSTALLED.attributes() | {"frequency": self.frequency} | self.asked
            self.file = ResultsFile(self.resume, header, "search for an optimal curve")
            self.stack.enter_context(closing(self.file))
            self.stored = {record["index"]: record for record in self.file.finished()}
        if self.executor is None:
            self.executor = self.stack.enter_context(ThreadPoolExecutor(workers()))
        self.report = self.stack.enter_context(
            progress_stages(self.progress, "optimal curve", "curve")
        )
        _ = self.problem.at(0.0).equations  # shared quantities, before the threads start
        self.work.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> bool:
        quiet = self.work.__exit__(kind, *error)
        self.interrupted = self.work.interrupted
        self.stack.close()
        return quiet

    def follow(
        self, preloads: Sequence[float], budget: int | None = None, row: int = 0
    ) -> list[AtPreload]:
        """Compute the response curves at preloads (N) concurrently; return them in this order.

        If ``row`` is not 0, the computation stops after this number of consecutive preloads at
        which the damper rattles. Finished curves are stored, also before an interruption.
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
                    job = (
                        at_preload,
                        self.problem,
                        p,
                        self.frequency,
                        self.options,
                        budget,
                        stop if threads else None,
                    )
                    with executor_errors(RuntimeError):  # raised by an executor that was shut down
                        running[p] = self.executor.submit(
                            *((copy_context().run, *job) if threads else job)
                        )
            for i, p in enumerate(preloads):
                if row and len(out) >= row and all(there.rattles for there in out[-row:]):
                    break
                self.report(f"{p:.4g} N", len(self.known), len(self.known) + len(preloads) - i)
                if p in running:
                    with executor_errors():
                        there = running.pop(p).result()
                    self._store(there)
                out.append(self.known[p])
        except BaseException:
            for p, future in running.items():
                if future.done() and not future.cancelled() and future.exception() is None:
                    self._store(future.result())
            raise
        finally:
            stop.set()  # ends running curves
            for future in running.values():
                future.cancel()
        self._follow_drops()
        return [self.known[there.preload] for there in out]

    def _follow_drops(self) -> None:
        """Replace the highest points above which a peak of the next lower preload still exists.

        The file keeps what each curve gave, because the neighbours of a preload may change.
        """
        lowest = min(self.known)
        if lowest not in self.checked_below:
            self.checked_below.add(lowest)
            self.known[lowest] = with_lower_preloads(
                self.problem, self.known[lowest], self.frequency, self.options
            )
        self.known |= without_lost_peaks(self.problem, self.known, self.options)

    def _store(self, there: AtPreload) -> None:
        self.known[there.preload] = there
        if self.file is not None:
            self.file.append(json_line(there.record()))

    def cost(self, start: float) -> Cost:
        """Return the cost of all curves on all threads, with the elapsed time since the start."""
        return replace(
            sum((there.cost for there in self.known.values()), Cost()),
            seconds=time.perf_counter() - start,
        )


def _optimum(curves: Curves, values: NDArray) -> OptimumPoint:
    """Find the preload of minimum amplitude; compute curves near which it may lie."""
    curves.follow([float(p) for p in values[::-1]], BUDGET, row=MAX_RATTLING)
    known = curves.known
    edge = rattling_below(known)
    by_log = {
        float(np.log(p)): known[p] for p in known if p >= edge
    }  # with the edge: the minimum may lie just above it
    with_value = [
        item for item in by_log.values() if np.isfinite(item.value) and item.preload > edge
    ]
    if not with_value:
        reason = "no preload has a value"
        noted = [item for item in by_log.values() if item.top is not None and item.top.note]
        if any(item.followed for item in noted):
            reason += f"; it is {noted[0].top.note}" if noted[0].top is not None else ""
        elif noted:
            reason += "; another resonance is higher, widen frequency"
        return OptimumPoint(np.nan, np.nan, np.nan, "none", np.inf, with_reason(NOT_FOUND, reason))
    height = [item.value for item in with_value]
    if len(with_value) > 1 and max(height) - min(height) <= FLAT:
        peak = with_value[int(np.argmin(height))].top.peak  # type: ignore[union-attr]
        flat = with_reason(NOT_FOUND, "the preload does not matter")
        return OptimumPoint(
            np.nan, peak.amplitude, peak.frequency, "flat", np.inf, flat, peak.half_range
        )

    def sample(x: float) -> Sample:
        steady = by_log[x].preload > rattling_below(known)
        return Sample(x, by_log[x].value if steady else np.inf, by_log[x].slope)

    def evaluate(logs: Sequence[float]) -> list[Sample]:
        by_log.update(zip(logs, curves.follow([float(np.exp(x)) for x in logs])))
        return [sample(x) for x in logs if x in by_log]

    def refine(a: Sample, b: Sample, x: float) -> float | None:
        tops = [by_log[p.x].top for p in (a, b)]
        ends = [top.peak for top in tops if top is not None]
        return smooth_minimum(curves.problem.system, ends, a, b, curves.options)

    samples, best = find_minimum([sample(x) for x in by_log], evaluate, refine)
    if best.kind not in (
        "end",
        "unknown",
    ):  # the ends of the range of acceptable preloads are computed
        evaluate(_near_best(samples, best.index))
    at, edge, kind = by_log[samples[best.index].x], rattling_below(known), best.kind
    assert at.top is not None
    if (
        kind == "unknown"
        and not at.slope < 0.0
        and by_log[samples[best.index - 1].x].preload <= edge
    ):
        kind = "edge"
    status = COMPLETE
    lower = [
        p
        for p in sorted(known)
        if p > edge and not known[p].known and not known[p].height >= at.top.peak.amplitude
    ]
    if lower:
        unknown = counted(len(lower), "preload")
        status = with_reason(
            INCOMPLETE, f"{unknown} without a value could be lower, first {lower[0]:.6g} N"
        )
    elif best.open is not None:
        low, high = np.exp(best.open)
        status = with_reason(
            INCOMPLETE, f"the highest peak could be lower between {low:.6g} and {high:.6g} N"
        )
    peak = at.top.peak
    return OptimumPoint(
        at.preload, peak.amplitude, peak.frequency, kind, best.uncertainty, status, peak.half_range
    )


def _near_best(samples: Sequence[Sample], best: int) -> list[float]:
    """Return ln(preload) on both sides of the best sample where the amplitude is NEAR_BEST times."""
    limit, ends = samples[best].value + np.log(NEAR_BEST), []
    for side in (samples[best::-1], samples[best:]):
        for a, b in zip(side, side[1:]):
            if not b.value <= limit:
                ends += [a.x + (b.x - a.x) * (limit - a.value) / (b.value - a.value)] * bool(
                    np.isfinite(b.value)
                )
                break
    return ends


def smooth_minimum(
    family: Family, ends: Sequence[Peak], a: Sample, b: Sample, options: PeakOptions | None = None
) -> float | None:
    """Return ln(parameter) of the minimum amplitude of a peak between two samples of it, or None.

    The minimum is found as a root of the derivative of the amplitude with respect to the parameter.
    """
    near = dict(zip((a.x, b.x), ends))

    def slope(x: float) -> float:
        p, low, high = (
            float(np.exp(x)),
            max(k for k in near if k <= x),
            min(k for k in near if k >= x),
        )
        first, last = near[low], near[high]
        share = (x - low) / (high - low) if high > low else 0.0
        guess = first.y + share * (last.y - first.y)
        start = first if share < 0.5 else last
        peak = find_peak(
            family(p), guess, tangent=start.tangent, scale=start.scale, curvature=start.curvature, options=options,
            parameter=p, reach=REACH,
        )  # fmt: skip
        if not peak.converged or peak.corner:
            raise ArithmeticError("the peak is lost")
        near[x] = peak
        return amplitude_sensitivity(peak, family, p) * p / peak.amplitude

    optimum_tolerance = 1e-7  # relative tolerance of the preload
    try:
        root = find_root(slope, (a.x, a.slope), (b.x, b.slope), optimum_tolerance)
    except (*LOST, BdamperError):
        return None
    return float(root.at)


def _interrupted_optimum(curves: Curves) -> OptimumPoint:
    """Return the smallest value known when the search was interrupted."""
    edge = rattling_below(curves.known)
    with_value = [
        (at.value, p, at.top.peak)
        for p, at in curves.known.items()
        if p > edge and at.known and at.top
    ]
    status = with_reason(INTERRUPTED, curves.work.reason or "by the user")
    if not with_value:
        return OptimumPoint(np.nan, np.nan, np.nan, "none", np.inf, status)
    _, p, peak = min(with_value, key=lambda item: item[0])
    return OptimumPoint(
        p, peak.amplitude, peak.frequency, "unknown", np.inf, status, peak.half_range
    )


def rattling_below(known: dict[float, AtPreload]) -> float:
    """Return the preload (N) up to which all curves show a rattling damper, or 0."""
    out = 0.0
    for p in sorted(known):
        if not known[p].rattles:
            break
        out = p
    return out


def _status(row: AtPreload | None, preload: float, edge: float, why: str) -> str:
    """Return the status of a preload; the damper rattles up to ``edge`` (N), because of ``why``."""
    if preload <= edge:
        return with_reason(NOT_FOUND, f"{NO_STEADY} up to {edge:.6g} N: {why}")
    return with_reason(NOT_FOUND, NOT_FOLLOWED) if row is None else row.status


def _columns(
    problem: Problem, known: dict[float, AtPreload], values: NDArray, edge: float
) -> dict[str, Any]:
    """Return the fields of an optimal curve with one entry for each preload."""
    preloads = np.array(sorted({*values.tolist(), *known}))
    rows, why = [known.get(float(p)) for p in preloads], known[edge].rattles if edge else ""
    tops = [
        None if row is None or row.preload <= edge or not row.known else row.top for row in rows
    ]

    def column(name: str, fill: Any) -> NDArray:
        return np.array([fill if top is None else getattr(top.peak, name) for top in tops])

    samples = [Sample(np.log(p), np.inf if row is None else row.value, np.nan if row is None else row.slope)
               for p, row in zip(preloads, rows)]  # fmt: skip
    onward = [
        bool(np.isfinite(a.value + b.value)) and on_one_branch(a, b)
        for a, b in zip(samples, samples[1:])
    ]
    return {
        "preload": preloads,
        "requested": np.isin(preloads, values),
        "curves": tuple(_without_curve(problem, p) if row is None else row.curve for row, p in zip(rows, preloads)),
        "amplitude": column("amplitude", np.nan),
        "lower_bound": np.array([np.nan if top or not row else row.height for row, top in zip(rows, tops)]),
        "half_range": column("half_range", np.nan),
        "frequency": column("frequency", np.nan),
        "shares": np.array([np.full(3, np.nan) if top is None else top.peak.shares for top in tops]),
        "residual": column("residual", np.nan),
        "unknowns": np.array([np.full(problem.n_unknowns, np.nan) if top is None else top.peak.y[:-1] for top in tops]),
        "kind": tuple("" if top is None else top.kind for top in tops),
        "status": tuple(_status(row, p, edge, why) for row, p in zip(rows, preloads)),
        "goes_on": np.array([False, *onward]),
    }  # fmt: skip


def preload_values(preload: Any, n: int) -> NDArray:
    """Return the preloads of a curve.

    They are ``n`` in geometric progression between two values, or the longer sequence as given.

    Raises
    ------
    SettingError
        If the preloads are not positive and increasing.
    """
    validation.check_value(
        np.ndim(n) == 0,
        "n",
        "a whole number, and an interval by its name as frequency=(low, high)",
        n,
    )
    values = validation.numbers("preload", preload, above=0.0, unit="N")
    if len(values) < 2 or np.any(np.diff(values) <= 0.0):
        raise validation.invalid(
            "preload", "(low, high) or a longer sequence of increasing values", preload
        )
    n = validation.integer("n", n, least=2)
    return values if len(values) > 2 else np.geomspace(values[0], values[1], n)
