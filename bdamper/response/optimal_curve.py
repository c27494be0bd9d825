"""Optimal curve and frequency-shift curve: the highest response as a function of the preload, from
free to stuck.

The optimum is chosen in these steps:

1. the complete response curve is computed at each preload, concurrently; its highest point is the
   value at this preload (``bdamper.response.highest_peak``), and an adjoint solution gives its
   slope d ln(amplitude)/d ln(preload);
2. :func:`bdamper.response.scalar_search.find_minimum` chooses further preloads at which the value
   may be smaller;
3. on a smooth branch of peaks :func:`smooth_minimum` first solves for the preload of zero slope.

Every value, including the optimum, is the highest point of a complete curve at its preload.
:class:`Curves` stores finished curves in a file and resumes from it; the checks of the optimum are
stored in the same file (:func:`finished_parts`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager, suppress
from contextvars import copy_context
from dataclasses import dataclass, field, replace
from functools import partial
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
from bdamper.response.followed_peak import LOWER, with_lower_preloads, without_lost_peaks
from bdamper.response.highest_peak import (
    BUDGET,
    REACH,
    AtPreload,
    Highest,
    check_options,
    with_errors,
    within_budget,
)
from bdamper.response.linear_limits import linear_peak, peak_interval, warn_of_shroud
from bdamper.response.optimal_curve_result import OptimalCurve, OptimumPoint
from bdamper.response.optimum_checks import NEAR_BEST
from bdamper.response.peak import Family, Peak, PeakOptions, find_peak
from bdamper.response.peak_error import HARMONICS, VECTORS
from bdamper.response.response_curve import self_locking, without_points
from bdamper.response.response_curve_result import LOCKED, NO_STEADY, ResponseCurve
from bdamper.response.scalar_search import (
    Minimum,
    Sample,
    find_minimum,
    find_root,
    on_one_branch,
)
from bdamper.response.sensitivity import amplitude_sensitivity
from bdamper.util import validation
from bdamper.util.errors import (
    FAILURES_AT_ONE_PRELOAD,
    INCOMPLETE,
    INTERRUPTED,
    NOT_FOUND,
    BdamperError,
    Ending,
    SettingError,
    StaticError,
    warn,
)
from bdamper.util.formatting import counted
from bdamper.util.progress import (
    Cost,
    LongWork,
    executor_errors,
    one_thread,
    progress_stages,
    raise_if_stopped,
    stopped_by,
)
from bdamper.util.storage import INSTALLED, FinishedParts, ResultsFile
from bdamper.util.workers import workers

# ---- response at one preload ----


@one_thread
def at_preload(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    options: PeakOptions | None = None,
    budget: int | None = None,
    stop: Event | None = None,
    errors: bool = False,
) -> AtPreload:
    """Compute the response at a preload; another thread stops it by setting ``stop``.

    A curve that uses up ``budget`` is followed again with the default budget, unless the damper
    rattles.  With ``errors`` the errors of the highest point by harmonics and residual modes
    follow.
    """
    with stopped_by(stop or Event()):
        try:
            response = within_budget(problem, preload, frequency, options=options, budget=budget)
        # InterruptedCurve is a KeyboardInterrupt, which ends the search with its results
        except FAILURES_AT_ONE_PRELOAD as error:
            failure = f"failed: {type(error).__name__}: {error}"
            empty = without_points(problem, preload, failure, ContinuationOptions(), Cost())
            response = AtPreload(
                preload=preload, curve=empty, top=None, slope=np.nan, rattles="", cost=Cost()
            )
    if errors:
        with stopped_by(stop or Event()), suppress(*FAILURES_AT_ONE_PRELOAD):
            response = with_errors(problem, response)
    slope = np.nan
    if response.top is not None:
        peak = response.top.peak
        # a corner has no slope
        with suppress(*FAILURES_AT_ONE_PRELOAD):
            by_preload = amplitude_sensitivity(peak, problem.system, preload)
            slope = by_preload * preload / peak.amplitude
    return replace(response, curve=_light(response.curve), slope=slope)


def _light(curve: ResponseCurve) -> ResponseCurve:
    """Return a response curve without its unknowns, higher harmonics and log."""
    no_unknowns = np.zeros((len(curve), 0))
    mean_and_first = curve.harmonics[:, :2]
    return replace(curve, unknowns=no_unknowns, harmonics=mean_and_first, start_log=())


NOT_FOLLOWED = "no curve was followed"


def _without_curve(problem: Problem, preload: float) -> ResponseCurve:
    """Return an empty response curve at a preload to which the search did not come."""
    return _light(without_points(problem, preload, NOT_FOLLOWED, ContinuationOptions(), Cost()))


# ---- optimal curve ----


FLAT = 1e-6
"""Relative range of the amplitude over all preloads below which there is no optimum."""
MAX_RATTLING = 2
"""Number of consecutive preloads with a rattling damper after which no lower ones are followed."""
Resume = str | Path | FinishedParts | None
"""File of finished parts, or parts whose file is open; None without a file."""


@contextmanager
def finished_parts(
    problem: Problem,
    preloads: NDArray,
    frequency: tuple[float, float] | None,
    options: PeakOptions | None,
    errors: bool,
    resume: Resume,
) -> Iterator[FinishedParts]:
    """Open the file of the finished curves of a search, and of the checks of its optimum.

    See :func:`optimal_curve`.  The file of open parts stays open.
    """
    if resume is None:
        yield FinishedParts()
    elif isinstance(resume, FinishedParts):
        yield resume
    else:
        header = {
            "format": "bdamper-optimal-search",
            "version": 3,
            "study": study_fingerprint(problem),
            **INSTALLED.attributes(),
            "frequency": frequency,
            "preload": preloads,
            "options": options,
            "errors": errors,
        }
        with closing(ResultsFile(resume, header, "search for an optimal curve")) as file:
            yield FinishedParts(file)


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
    resume: Resume = None,
    executor: Executor | None = None,
    errors: bool = False,
) -> OptimalCurve:
    """Compute resonance amplitude and frequency as functions of the preload, and the optimal
    preload.

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
    resume : path or FinishedParts, optional
        File for all finished curves.  Interrupted work continues from it with the same result.
    executor : concurrent.futures.Executor, optional
        Executor of the curves; by default threads, see :func:`bdamper.set_workers`.
    errors : bool
        Estimate the errors of each amplitude by harmonics and residual modes.

    Returns
    -------
    OptimalCurve
        Table of the requested preloads and the preloads of the search, with the optimum.  After
        Ctrl-C, or shutdown of the executor, it contains the part computed so far.

    Raises
    ------
    BdamperError
        If nothing was found at any of the preloads, the file belongs to another search, or the
        executor accepts no task.
    KeyboardInterrupt
        If the search was interrupted before it found anything.
    """
    start = time.perf_counter()
    values = preload_values(preload, n, call="optimal_curve")
    validation.flag("progress", progress)
    check_options(options)
    validation.check(
        problem.carries_load,
        "optimal_curve",
        "a model with a body that carries a load",
        f"that {problem.why_no_load}",
    )
    highest = problem.at(float(values[-1]))
    frequency = curve_interval(problem, values, frequency, mode)
    free = linear_peak(highest, frequency, stuck=False)
    stuck = linear_peak(highest, frequency, stuck=True)
    # before the search, so that an interrupt after it meets little work
    mass_radius = float("nan")
    if problem.settings.engine_order:
        # unknown for a body on the axis, or without a mass
        with suppress(SettingError):
            mass_radius = centrifugal_load(problem.model)
    settings = problem.record(None) | {"frequency": [float(f) for f in frequency]}
    with (
        finished_parts(problem, values, frequency, options, errors, resume) as parts,
        Curves(problem, frequency, options, executor, parts, progress, errors) as curves,
    ):
        optimum = _optimum(curves, values)
    known = curves.known
    if curves.interrupted:
        optimum = _interrupted_optimum(curves)
    if not any(response.top for response in known.values()):
        # the reason of an interruption by the executor is an error, Ctrl-C has none
        if curves.interrupted:
            validation.check(
                not curves.work.reason, "executor", "one that takes tasks", curves.work.reason
            )
            raise KeyboardInterrupt
        low, high = frequency
        reasons = ", ".join(
            dict.fromkeys(response.ending.status_text for response in known.values())
        )
        raise BdamperError(
            f"no peak found at any of {len(values)} preloads from {values[0]:g} to "
            f"{values[-1]:g} N between {low:.6g} and {high:.6g} Hz: {reasons}"
        )
    edge = rattling_below(known)
    return OptimalCurve(
        **_columns(problem, known, values, edge),
        free=free,
        stuck=stuck,
        optimum=optimum,
        cost=curves.cost(start),
        settings=settings,
        model_hash=problem.model.hash,
        lowest_steady_preload=edge,
        mass_radius=mass_radius,
        model_doubts=rolling_dampers(problem),
        neglected=problem.model.neglected_over_speed(problem.settings.needed_diameters),
    )


def warn_of_model(problem: Problem, preload: float, frequency: tuple[float, float]) -> None:
    """Warn of properties of the model that make amplitudes doubtful, before a curve is computed.

    A study warns once of each of them.

    Parameters
    ----------
    problem : Problem
    preload : float, N
        Highest preload of the search, where faces are compared with their area.
    frequency : (low, high), Hz
    """
    doubts = [
        f"{doubt}; amplitudes may be wrong by several times; use more rows of contact points along t1"
        for doubt in rolling_dampers(problem)
    ]
    doubts += [
        f"{name} {LOCKED}; it follows from the history of the loads, or use a larger face angle"
        for name in self_locking(problem)
    ]
    told = problem.sizes.told
    for doubt in doubts:
        if doubt not in told:
            told.add(doubt)
            warn(doubt)
    problem.sizes.check_faces(preload)
    warn_of_shroud(problem.at(preload), frequency)


def curve_interval(
    problem: Problem, preloads: NDArray, frequency: tuple[float, float] | None, mode: int = 1
) -> tuple[float, float]:
    """Return the given interval (Hz), or the interval around the resonances of a mode.

    Without an interval the highest preload with a static state determines the resonances.

    Raises
    ------
    StaticError
        If no preload has a static state.
    """
    first_error: StaticError | None = None
    for preload in preloads[::-1]:
        try:
            return peak_interval(problem.at(float(preload)), frequency, mode)
        except StaticError as error:
            if first_error is None:
                first_error = error
    assert first_error is not None
    raise first_error


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
    parts : FinishedParts
        Curves of the file.  New ones are stored there too.
    progress : bool
    errors : bool
        Estimate the errors of each highest point.
    known : dict of float to AtPreload
        Finished curves by preload.
    checked_below : set of float
        Preloads (N) at which peaks were followed from preloads that are not part of the curve.
    compared : set of (lower, higher)
        Preloads (N) between which a followed peak showed nothing higher.
    """

    problem: Problem
    frequency: tuple[float, float]
    options: PeakOptions | None = None
    executor: Executor | None = None
    parts: FinishedParts = field(default_factory=FinishedParts)
    progress: bool = False
    errors: bool = False
    known: dict[float, AtPreload] = field(default_factory=dict)
    checked_below: set[float] = field(default_factory=set)
    compared: set[tuple[float, float]] = field(default_factory=set)
    interrupted: bool = False

    def __enter__(self) -> Curves:
        self.stack = ExitStack()
        self.work = LongWork()
        if self.executor is None:
            self.executor = self.stack.enter_context(ThreadPoolExecutor(workers()))
        self.report = self.stack.enter_context(
            progress_stages(self.progress, "optimal curve", "curve")
        )
        # shared quantities, before the threads start
        _ = self.problem.linear, self.problem.static_system(1.0)
        self.work.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> bool:
        quiet = self.work.__exit__(kind, *error)
        self.interrupted = self.work.interrupted
        self.stack.close()
        return quiet

    def follow(
        self, preloads: Sequence[float], budget: int | None = None, most_rattling: int = 0
    ) -> list[AtPreload]:
        """Compute the response curves at preloads (N) concurrently; return them in this order.

        If ``most_rattling`` is not 0, the computation stops after this number of consecutive
        preloads at which the damper rattles, and the result is shorter. Finished curves are stored,
        also before an interruption.
        """
        stop = Event()
        running: dict[float, Future[AtPreload]] = {}
        in_order: list[AtPreload] = []
        try:
            for preload in preloads:
                if preload in self.known:
                    continue
                stored = self.parts.records.get(repr(preload))
                if stored is not None:
                    self.known[preload] = AtPreload.of(stored)
                else:
                    running[preload] = self._submit(preload, budget, stop)
            for i, preload in enumerate(preloads):
                if most_rattling and len(in_order) >= most_rattling:
                    last = in_order[-most_rattling:]
                    if all(response.rattles for response in last):
                        break
                raise_if_stopped()
                n_left = len(preloads) - i
                self.report(f"{preload:.4g} N", len(self.known), len(self.known) + n_left)
                if preload in running:
                    with executor_errors():
                        response = running.pop(preload).result()
                    self._store(response)
                in_order.append(self.known[preload])
        except BaseException:
            for future in running.values():
                if future.done() and not future.cancelled() and future.exception() is None:
                    self._store(future.result())
            raise
        finally:
            # ends running curves
            stop.set()
            for future in running.values():
                future.cancel()
        # this may replace responses
        self._follow_drops()
        return [self.known[response.preload] for response in in_order]

    def _submit(self, preload: float, budget: int | None, stop: Event) -> Future[AtPreload]:
        """Start the computation at a preload; an event stops it only in a thread."""
        assert self.executor is not None
        in_thread = isinstance(self.executor, ThreadPoolExecutor)
        job = partial(
            at_preload,
            self.problem,
            preload,
            self.frequency,
            self.options,
            budget,
            stop if in_thread else None,
            self.errors,
        )
        # an executor that was shut down raises RuntimeError
        with executor_errors(RuntimeError):
            if in_thread:
                return self.executor.submit(copy_context().run, job)
            return self.executor.submit(job)

    def _follow_drops(self) -> None:
        """Replace the highest points above which a peak of a lower preload still exists.

        A preload without a close lower neighbour is treated like a single one.  The file keeps what
        each curve gave, because the neighbours of a preload may change.
        """
        ascending = sorted(self.known)
        below = 0.0
        for preload in ascending:
            isolated = below < LOWER[-1] * preload
            if isolated and preload not in self.checked_below:
                self.checked_below.add(preload)
                self.known[preload] = with_lower_preloads(
                    self.problem, self.known[preload], self.frequency, self.options
                )
            below = preload
        self.known |= without_lost_peaks(self.problem, self.known, self.options, self.compared)

    def _store(self, response: AtPreload) -> None:
        self.known[response.preload] = response
        self.parts.store(response.record())

    def cost(self, start: float) -> Cost:
        """Return the cost of all curves on all threads, with the elapsed time since the start."""
        total = sum((response.cost for response in self.known.values()), Cost())
        return replace(total, seconds=time.perf_counter() - start)


def _optimum(curves: Curves, values: NDArray) -> OptimumPoint:
    """Find the preload of minimum amplitude; compute curves near which it may lie."""
    # the highest preload first, because dampers rattle at low ones
    descending = [float(preload) for preload in values[::-1]]
    curves.follow(descending, BUDGET, most_rattling=MAX_RATTLING)
    known = curves.known
    edge = rattling_below(known)
    # responses by ln(preload); with the edge, because the minimum may lie just above it
    by_log = {float(np.log(preload)): known[preload] for preload in known if preload >= edge}
    with_value = [
        response
        for response in by_log.values()
        if np.isfinite(response.value) and response.preload > edge
    ]
    if not with_value:
        return _no_optimum(Ending(NOT_FOUND, _why_no_value(list(by_log.values()))))
    log_amplitudes = [response.value for response in with_value]
    if len(with_value) > 1 and max(log_amplitudes) - min(log_amplitudes) <= FLAT:
        flat = Ending(NOT_FOUND, "the preload does not matter")
        lowest = with_value[int(np.argmin(log_amplitudes))]
        assert lowest.top is not None
        return _optimum_at(np.nan, lowest.top.peak, kind="flat", uncertainty=np.inf, end=flat)

    # find_minimum minimises ln(amplitude) over x = ln(preload)

    def sample(x: float) -> Sample:
        response = by_log[x]
        # the edge of rattling rises if a new preload rattles
        steady = response.preload > rattling_below(known)
        value = response.value if steady else np.inf
        return Sample(x, value, response.slope)

    def evaluate(logs: Sequence[float]) -> list[Sample]:
        responses = curves.follow([float(np.exp(x)) for x in logs])
        by_log.update(zip(logs, responses))
        return [sample(x) for x in logs if x in by_log]

    def refine(left: Sample, right: Sample, x: float) -> float | None:
        """Return the minimum between two samples; the guess ``x`` is not needed."""
        tops = [by_log[left.x].top, by_log[right.x].top]
        ends = [top.peak for top in tops if top is not None]
        return smooth_minimum(curves.problem.system, ends, left, right, curves.options)

    samples, best = find_minimum([sample(x) for x in by_log], evaluate, refine)
    # the ends of the range of acceptable preloads are computed, not only interpolated
    if best.kind not in ("end", "unknown"):
        evaluate(_near_best(samples, best.index))
    optimum = by_log[samples[best.index].x]
    assert optimum.top is not None
    peak = optimum.top.peak
    edge = rattling_below(known)
    kind = best.kind
    # the next lower preload has no steady response, and the amplitude falls towards it or has no
    # slope
    if kind == "unknown" and not optimum.slope < 0.0:
        below = by_log[samples[best.index - 1].x]
        if below.preload <= edge:
            kind = "edge"
    end = _ending_of_optimum(known, edge, peak.amplitude, best)
    return _optimum_at(optimum.preload, peak, kind, best.uncertainty, end)


def _optimum_at(
    preload: float, peak: Peak, kind: str, uncertainty: float, end: Ending
) -> OptimumPoint:
    return OptimumPoint(
        preload=preload,
        amplitude=peak.amplitude,
        frequency=peak.frequency,
        kind=kind,
        uncertainty=uncertainty,
        status=end.status,
        reason=end.reason,
        half_range=peak.half_range,
    )


def _no_optimum(end: Ending) -> OptimumPoint:
    return OptimumPoint(
        preload=np.nan,
        amplitude=np.nan,
        frequency=np.nan,
        kind="none",
        uncertainty=np.inf,
        status=end.status,
        reason=end.reason,
    )


def _why_no_value(responses: Sequence[AtPreload]) -> str:
    """Return the reason why no preload has a value, from the notes on the highest points."""
    reason = "no preload has a value"
    with_note = [item for item in responses if item.top is not None and item.top.note]
    if not with_note:
        return reason
    if any(item.followed for item in with_note):
        first = with_note[0].top
        assert first is not None
        return f"{reason}; the amplitude there is {first.note}"
    return f"{reason}; a different resonance is higher: widen the frequency interval"


def _ending_of_optimum(
    known: dict[float, AtPreload], edge: float, amplitude: float, best: Minimum
) -> Ending:
    """Return "complete" unless the amplitude may be lower than the optimum at another preload."""
    may_be_lower = []
    for preload in sorted(known):
        response = known[preload]
        # the amplitude of an incomplete search is a lower bound, or NaN
        is_higher = response.amplitude >= amplitude
        if preload > edge and not response.known and not is_higher:
            may_be_lower.append(preload)
    if may_be_lower:
        unknown = counted(len(may_be_lower), "preload")
        first = f"{may_be_lower[0]:.6g} N"
        reason = f"the amplitude could be lower at {unknown} without a result, the first at {first}"
        return Ending(INCOMPLETE, reason)
    if best.open is not None:
        low, high = np.exp(best.open)
        reason = f"the highest peak could be lower between {low:.6g} and {high:.6g} N"
        return Ending(INCOMPLETE, reason)
    return Ending()


def _near_best(samples: Sequence[Sample], best: int) -> list[float]:
    """Return ln(preload) on both sides of the best sample at NEAR_BEST times its amplitude.

    ``best`` is its index.  A side on which the amplitude does not reach the limit has no value.
    """
    limit = samples[best].value + np.log(NEAR_BEST)
    ends = []
    # outward from the best sample, to lower and to higher preloads
    to_lower = samples[best::-1]
    to_higher = samples[best:]
    for side in (to_lower, to_higher):
        for inner, outer in zip(side, side[1:]):
            if outer.value <= limit:
                continue
            # no interpolation towards an infinite or unknown amplitude
            if np.isfinite(outer.value):
                rise = outer.value - inner.value
                ends.append(inner.x + (outer.x - inner.x) * (limit - inner.value) / rise)
            break
    return ends


def smooth_minimum(
    family: Family,
    ends: Sequence[Peak],
    left: Sample,
    right: Sample,
    options: PeakOptions | None = None,
) -> float | None:
    """Return ln(parameter) of the minimum amplitude of a peak between two samples of it, or None.

    The minimum is found as a root of the derivative of the amplitude with respect to the parameter.
    ``ends`` are the peaks of the samples ``left`` and ``right``.
    """
    # peaks of this branch by ln(parameter)
    peaks = dict(zip((left.x, right.x), ends))

    def slope(x: float) -> float:
        """Return d ln(amplitude)/d ln(parameter) of the peak, found between its neighbours."""
        parameter = float(np.exp(x))
        low = max(other for other in peaks if other <= x)
        high = min(other for other in peaks if other >= x)
        share = (x - low) / (high - low) if high > low else 0.0
        first = peaks[low]
        last = peaks[high]
        guess = first.y + share * (last.y - first.y)
        nearest = first if share < 0.5 else last
        peak = find_peak(
            family(parameter),
            guess,
            tangent=nearest.tangent,
            scale=nearest.scale,
            curvature=nearest.curvature,
            options=options,
            parameter=parameter,
            reach=REACH,
        )
        if not peak.ok or peak.corner:
            raise ArithmeticError("the peak is lost")
        peaks[x] = peak
        by_parameter = amplitude_sensitivity(peak, family, parameter)
        return by_parameter * parameter / peak.amplitude

    # relative tolerance of the preload
    optimum_tolerance = 1e-7
    try:
        root = find_root(slope, (left.x, left.slope), (right.x, right.slope), optimum_tolerance)
    except FAILURES_AT_ONE_PRELOAD:
        return None
    return float(root.at)


def _interrupted_optimum(curves: Curves) -> OptimumPoint:
    """Return the smallest value known when the search was interrupted."""
    edge = rattling_below(curves.known)
    end = Ending(INTERRUPTED, curves.work.reason or "by the user")
    lowest: AtPreload | None = None
    for preload, response in curves.known.items():
        if preload <= edge or not np.isfinite(response.value) or response.top is None:
            continue
        if lowest is None or response.value < lowest.value:
            lowest = response
    if lowest is None or lowest.top is None:
        return _no_optimum(end)
    return _optimum_at(lowest.preload, lowest.top.peak, "unknown", np.inf, end)


def rattling_below(known: dict[float, AtPreload]) -> float:
    """Return the preload (N) up to which all curves show a rattling damper, or 0."""
    edge = 0.0
    for preload in sorted(known):
        if not known[preload].rattles:
            break
        edge = preload
    return edge


def _ending(response: AtPreload | None, preload: float, edge: float, why: str) -> Ending:
    """Return status and reason of the response at a preload.

    Up to ``edge`` (N) the damper rattles, for the reason ``why``.
    """
    if preload <= edge:
        return Ending(NOT_FOUND, f"{NO_STEADY} up to {edge:.6g} N: {why}")
    if response is None:
        return Ending(NOT_FOUND, NOT_FOLLOWED)
    return response.ending


def _known_peak(response: AtPreload | None, edge: float) -> Highest | None:
    """Return the highest point at a preload if its amplitude counts."""
    if response is None or response.preload <= edge:
        return None
    if not response.known or response.rattles:
        return None
    return response.top


def _columns(
    problem: Problem, known: dict[float, AtPreload], values: NDArray, edge: float
) -> dict[str, Any]:
    """Return the fields of an optimal curve with one entry for each preload."""
    # requested preloads and preloads of the search
    preloads = np.array(sorted({*values.tolist(), *known}))
    why_rattling = known[edge].rattles if edge else ""
    curves = []
    lower_bounds = []
    endings = []
    tops = []
    samples = []
    for preload in preloads:
        response = known.get(float(preload))
        top = _known_peak(response, edge)
        if response is None:
            curves.append(_without_curve(problem, preload))
            lower_bounds.append(np.nan)
            samples.append(Sample(np.log(preload), np.inf, np.nan))
        else:
            curves.append(response.curve)
            lower_bounds.append(response.lower_bound[0] if top is None else np.nan)
            samples.append(Sample(np.log(preload), response.value, response.slope))
        tops.append(top)
        endings.append(_ending(response, preload, edge, why_rattling))
    # whether each preload continues the branch of the preload before
    goes_on = [False]
    for before, sample in zip(samples, samples[1:]):
        both_known = bool(np.isfinite(before.value + sample.value))
        goes_on.append(both_known and on_one_branch(before, sample))

    def of_peaks(name: str, size: int | None = None) -> NDArray:
        """Return a field of all peaks; NaN without a peak, for an array of ``size`` numbers."""
        unknown = np.nan if size is None else np.full(size, np.nan)
        return np.array([unknown if top is None else getattr(top.peak, name) for top in tops])

    def changes(source: str) -> NDArray | None:
        """Return the relative changes of all amplitudes by a source; None without estimates."""
        by_preload = []
        for top in tops:
            of_top = () if top is None else top.peak.errors
            known = [item.amplitude for item in of_top if item.source == source and item.known]
            by_preload.append(known[0] if known else np.nan)
        sources = {item.source for top in tops if top is not None for item in top.peak.errors}
        return np.array(by_preload) if source in sources else None

    no_unknowns = np.full(problem.n_unknowns, np.nan)
    unknowns = [no_unknowns if top is None else top.peak.y[:-1] for top in tops]
    return {
        "preload": preloads,
        "requested": np.isin(preloads, values),
        "curves": tuple(curves),
        "amplitude": of_peaks("amplitude"),
        "lower_bound": np.array(lower_bounds),
        "half_range": of_peaks("half_range"),
        "frequency": of_peaks("frequency"),
        "shares": of_peaks("shares", size=3),
        "residual": of_peaks("residual"),
        "unknowns": np.array(unknowns),
        "kind": tuple("" if top is None else top.kind for top in tops),
        "status": tuple(ending.status for ending in endings),
        "reason": tuple(ending.reason for ending in endings),
        "goes_on": np.array(goes_on),
        "harmonic_change": changes(HARMONICS),
        "vector_change": changes(VECTORS),
    }


def preload_values(
    preload: Any, n: int, name: str = "preload", unit: str = "N", call: str = ""
) -> NDArray:
    """Return the preloads of a curve, or the values of another parameter with a name and a unit.

    They are ``n`` in geometric progression between two values, or the given sequence if longer.
    ``call`` is the name of the method that an error message shows with a valid range.

    Raises
    ------
    SettingError
        If the values are not positive and increasing.
    """
    validation.check_value(
        np.ndim(n) == 0,
        "n",
        "a whole number, and an interval by its name as frequency=(low, high)",
        n,
    )
    expected = "(low, high) or a longer sequence of increasing values"
    if np.ndim(preload) == 0 and isinstance(preload, int | float):
        # the second of two numbers without parentheses arrives as n
        high = n if n > preload else 10.0 * preload
        example = f"{call}(({preload:g}, {high:g}))" if call else f"({preload:g}, {high:g})"
        raise validation.invalid(name, f"{expected}, for example {example}", preload)
    values = validation.numbers(name, preload, above=0.0, unit=unit)
    if len(values) < 2 or np.any(np.diff(values) <= 0.0):
        raise validation.invalid(name, expected, preload)
    n = validation.integer("n", n, least=2)
    if len(values) > 2:
        return values
    return np.geomspace(values[0], values[1], n)
