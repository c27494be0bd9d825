"""What more harmonics change: whole answers with two, four and six more, until the last three agree to a tolerance.

A curve or a peak to a tolerance is computed with the study's own harmonics, two and four more, side by side, then with two
more at a time, up to :data:`MOST_MORE` more, until amplitude and frequency of the last three rungs that are known differ by
no more than the tolerance.  The richest whole answer is the result; if the last three do not agree it says "not converged"
and their range.  Rungs that are incomplete are not known and agree with nothing; beyond the first three none is tried after
one of these (three in a row took 90 % of the time of a ladder to no avail).  An optimal curve
keeps the study's own harmonics; tracking curves with more say at its optimum and at some other preloads what these would
change.  Where the model lacks the nodal diameters of more harmonics, or samples are too few for them, the ladder ends there
and says so.

That two rungs agree proves nothing, three are better and no proof: 3, 5, 7 and 9 harmonics may give 0.0606, 0.0630, 0.0784
and 0.0683 mm (docs/measured.md, *How often the ladder and the estimates hold*).
"""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.continuation.track import track
from bdamper.effects.richer import Question, ask, whole_curve
from bdamper.peaks.highest import highest_peak
from bdamper.peaks.newton import Peak
from bdamper.peaks.optimal import search_file
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.problem.problem import Problem
from bdamper.stability.floquet import with_stability
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import CostMeter
from bdamper.util.errors import BdamperError
from bdamper.util.ladder import COMPARED, Ladder, Rung
from bdamper.util.progress import LongWork, counter, ended_by, passes_interrupts_on
from bdamper.util.warn import BdamperWarning

MOST_MORE = 10
"""Harmonics beyond the study's own with which a curve or a peak is computed at most."""
MORE_AT_OPTIMUM = 6
"""Harmonics beyond the study's own of the richest curve at an optimum."""
SPREAD = (1.0 / 6.0, 0.5, 5.0 / 6.0)
"""Where over the preloads of an optimal curve, in their order, two more harmonics are tried besides its optimum."""
APART = 1.2
"""Ratio of the preloads on both sides of the optimum to its own, at least: on a dense grid the next ones tell nothing more.
Those of 50 preloads from 10 to 10,000 N did not tell that five harmonics have a lower resonance at 132 N than at the
optimum of three, 104 N."""

Answer = TypeVar("Answer", Curve, Peak)


class _Rungs:
    """Answers with other harmonics on threads of their own, each timed by the processor time of its thread."""

    def __init__(self, threads: int | None = None) -> None:
        self.pool = ThreadPoolExecutor(threads or os.cpu_count() or 1)
        self.stop = Event()

    def __enter__(self) -> _Rungs:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop.set()  # ends those that are still at work, after Ctrl-C
        self.pool.shutdown(cancel_futures=True)

    def ask(self, problem: Problem, preload: float, answer: Question) -> Future[tuple[Any, Rung]]:
        """Begin an answer; what its problem shares with others is made before."""
        if problem.static(preload).converged:
            problem.system(preload)
        return self.pool.submit(ended_by(self.stop)(self.of), problem, preload, answer)

    def of(self, problem: Problem, preload: float, answer: Question) -> tuple[Any, Rung]:
        """An answer (None if there is none) and its rung."""
        found = ask(problem, answer)
        status = found.why or "complete"
        own = problem.harmonic_numbers[-1]
        rung = Rung(own, preload, found.amplitude, found.frequency, seconds=found.seconds, status=status)
        return found.result, rung


def _richer(problem: Problem, most: int) -> tuple[list[Problem], str]:
    """The problem with its own harmonics, two more, four more ..., and what forbids ``most`` more."""
    own = problem.harmonic_numbers[-1]
    problems = [problem]
    for more in range(2, most + 1, 2):
        try:
            with warnings.catch_warnings():  # of what would stand in for residual modes
                warnings.simplefilter("ignore", BdamperWarning)
                richer = problem.with_(harmonics=own + more)
            why = "" if richer.contact.note == problem.contact.note else richer.contact.note
        except BdamperError as error:
            why = str(error)
        if why:
            return problems, f"no {own + more} harmonics are possible with the same settings ({why})"
        problems.append(richer)
    return problems, ""


def _not_asked(problem: Problem) -> list[str]:
    """Sources of error that a ladder of harmonics says nothing of."""
    method = problem.stiffness_method
    diagonal = isinstance(method, str) and method in ("unit_traction", "eq4")
    return ["contact points", "modes", *(["residual flexibility"] if diagonal else [])]


def _with_changes(rungs: Sequence[Rung]) -> tuple[Rung, ...]:
    """Rungs at one preload, by rising harmonics, with the changes from one to the next that is known."""
    out: list[Rung] = []
    for rung in rungs:
        before = next((r for r in reversed(out) if r.known), None)
        change = rung.amplitude / before.amplitude - 1.0 if before is not None else float("nan")
        out.append(replace(rung, change=change))
    return tuple(out)


@one_thread
def converged_answer(problem: Problem, preload: float, tolerance: float, answer: Callable[[Problem], Answer]) -> Answer:
    """The answer with as many harmonics as a relative tolerance on amplitude and frequency needs, with its ladder.

    Its ``cost`` is that of all answers, its settings hold the ``tolerance``.  The problem's own answer is computed in the
    calling thread, two richer ones beside it.  Ctrl-C during the former interrupts that; later it ends the ladder.

    Raises
    ------
    BdamperError
        If there is no answer with any number of harmonics.
    """
    tolerance = validate.number("tolerance", tolerance, above=0.0, below=1.0)
    problems, limit = _richer(problem, MOST_MORE)
    meter = CostMeter(time.perf_counter())
    answers: list[Answer | None] = []
    rungs: list[Rung] = []

    def ladder() -> Ladder:
        known = [r.harmonics for r in rungs if r.known]
        own = (known or [r.harmonics for r, a in zip(rungs, answers) if a is not None] or [0])[-1]
        return Ladder(tolerance, preload, own, _with_changes(rungs), by_frequency=True, limit=limit)

    def take(found: tuple[Answer | None, Rung]) -> None:
        answers.append(found[0])
        rungs.append(found[1])
        if found[0] is not None and found[0].cost is not None:
            meter.add(found[0].cost)

    with _Rungs() as work:
        beside = [work.ask(p, preload, answer) for p in problems[1:COMPARED]]
        take(work.of(problem, preload, answer))
        interrupted = isinstance(answers[0], Curve) and answers[0].status == "interrupted"
        try:
            for future in [] if interrupted else beside:
                take(future.result())
            for richer in [] if interrupted else problems[COMPARED:]:
                if ladder().converged:
                    break
                take(work.ask(richer, preload, answer).result())
                if not rungs[-1].known:
                    limit = "no more were tried"
                    break
        except KeyboardInterrupt:
            if passes_interrupts_on():
                raise
            limit = "the ladder was interrupted by the user"
    made = ladder()
    best = next((a for a, r in zip(answers, rungs) if a is not None and r.harmonics == made.answer), None)
    if best is None:
        raise BdamperError(rungs[-1].status)
    cost = replace(meter.read(time.perf_counter()), processor=sum(r.seconds for r in rungs))
    best = replace(best, ladder=made, settings=best.settings | {"tolerance": tolerance}, cost=cost)
    return replace(best, error_estimates=made.estimates(_not_asked(problem))) if isinstance(best, Curve) else best


def track_to_tolerance(
    problem: Problem, preload: float, frequency: tuple[float, float], tolerance: float, stability: bool = False,
    **following: Any,
) -> Curve:  # fmt: skip
    """A tracking curve with as many harmonics as its highest point needs, and the ladder that says so.

    ``stability`` judges the stability of every point; others are those of :func:`bdamper.continuation.track.track`.  One
    that was interrupted is returned as it is, one without a static state too.
    """
    tolerance = validate.number("tolerance", tolerance, above=0.0, below=1.0)
    if not problem.static(preload).converged:
        return track(problem, preload, frequency, **following)
    frequency = validate.interval("frequency", frequency)
    curve: Curve = converged_answer(problem, preload, tolerance, lambda p: track(p, preload, frequency, **following))
    judged = len(curve) and curve.status != "interrupted" and (stability or problem.stability)
    return with_stability(problem, curve) if judged else curve


def peak_to_tolerance(
    problem: Problem, preload: float, frequency: tuple[float, float] | None, tolerance: float, **searching: Any
) -> Peak:
    """The highest peak with as many harmonics as it needs, and the ladder that says so.

    Further arguments are those of :func:`bdamper.peaks.highest.highest_peak`.
    """
    preload = problem.check_preload(preload)
    return converged_answer(problem, preload, tolerance, lambda p: highest_peak(p, preload, frequency, **searching))


# ---- the optimal curve ----


@one_thread
def with_ladder(
    problem: Problem,
    curve: OptimalCurve,
    tolerance: float,
    threads: int | None = None,
    *,
    progress: bool = False,
    resume: str | Path | None = None,
) -> OptimalCurve:
    """The optimal curve of a problem with what more harmonics would change of it.

    Tracking curves over its interval of frequency with two, four and six more harmonics at the preload of the optimum, and
    with two more at the preloads of the curve on both sides of it and at some others (:data:`SPREAD`).  Where one of these
    gives less than the optimum, the next preloads beside it follow.  Where the preload does
    not matter the middle of the curve stands for the optimum.  A curve without a least value is returned as it is.

    Parameters
    ----------
    problem : Problem
    curve : OptimalCurve
    tolerance : float
        Relative, on the amplitude of the optimum.
    threads : int, optional
        That work side by side; as many as there are processors by default.  Results do not depend on it.
    progress : bool
        Show a bar of the tracking curves.
    resume : path, optional
        File of the search for the curve (:func:`bdamper.peaks.optimal.optimal_curve`), which keeps the rungs too.
    """
    tolerance = validate.number("tolerance", tolerance, above=0.0, below=1.0)
    best = curve.optimum
    if not np.isfinite(best.amplitude):
        return curve
    preload = best.preload if np.isfinite(best.preload) else float(curve.preload[len(curve) // 2])
    problems, limit = _richer(problem, MORE_AT_OPTIMUM)
    own, frequency = problem.harmonic_numbers[-1], curve.settings["frequency"]
    places = [float(at) for at in curve.preload[_checked(curve.preload, preload)]]
    jobs = [(p, preload) for p in problems[:0:-1]] + [(p, at) for p in problems[1:2] for at in places]
    found: dict[tuple[int, float], Rung] = {}
    with ExitStack() as stack:
        work = stack.enter_context(_Rungs(threads))
        file = None if resume is None else search_file(resume, problem, frequency=frequency)
        if file is not None:
            stack.callback(file.close)
        kept = {} if file is None else file.records
        advance = stack.enter_context(counter(progress, len(jobs), 0, "ladder of harmonics", "curve"))
        stop = stack.enter_context(LongWork())
        while jobs:
            asked: dict[Future[tuple[Any, Rung]], str] = {}
            for p, at in jobs:
                name = f"{p.harmonic_numbers[-1]} harmonics at {at!r} N"
                if name in kept:
                    found[p.harmonic_numbers[-1], at] = Rung(**kept[name]["rung"])
                    advance()
                else:
                    asked[work.ask(p, at, partial(whole_curve, preload=at, frequency=frequency))] = name
            for future in as_completed(asked):
                rung = future.result()[1]
                found[rung.harmonics, rung.preload] = rung
                if file is not None:
                    file.append({"index": asked[future], "rung": asdict(rung)})
                advance()
            beyond = _beyond(curve.preload, preload, [r for (n, _), r in found.items() if n == own + 2])
            jobs = [(problems[1], at) for at in beyond]
    if stop.interrupted:
        limit = "the ladder was interrupted by the user"
    answer = Rung(own, preload, best.amplitude, best.frequency, seconds=curve.cost.processor)
    rungs = [answer, *(found[key] for key in sorted(found) if key[1] == preload)]
    others = [r for at in sorted(at for _, at in found if at != preload) for r in _pair(curve, own, found[own + 2, at])]
    made = Ladder(tolerance, preload, own, _with_changes(rungs), tuple(others), limit=limit)
    return replace(curve, ladder=made, error_estimates=made.estimates(_not_asked(problem)))


def _pair(curve: OptimalCurve, own: int, richer: Rung) -> tuple[Rung, ...]:
    """The value of an optimal curve at one of its preloads, with the harmonics that it has, and a richer one."""
    k = int(np.flatnonzero(curve.preload == richer.preload)[0])
    amplitude, frequency = float(curve.amplitude[k]), float(curve.frequency[k])
    status = "complete" if np.isfinite(amplitude) else curve.status[k]
    return _with_changes([Rung(own, richer.preload, amplitude, frequency, status=status), richer])


def _checked(grid: NDArray, preload: float) -> list[int]:
    """Which preloads of a curve are checked besides that of its optimum: the next apart on both sides, some over all."""
    below, above = np.flatnonzero(grid <= preload / APART)[-1:], np.flatnonzero(grid >= preload * APART)[:1]
    spread = [round(s * (len(grid) - 1)) for s in SPREAD]
    return sorted({int(k) for k in (*below, *above, *spread) if grid[k] != preload})


def _beyond(grid: NDArray, preload: float, rungs: Sequence[Rung]) -> list[float]:
    """Preloads of a curve beside the least of some rungs that are not among these; none where it is at the optimum's."""
    known = [r for r in rungs if r.known]
    least = min(known, key=lambda r: r.amplitude, default=None)
    if least is None or least.preload == preload or preload not in [r.preload for r in known]:
        return []
    k = int(np.flatnonzero(grid == least.preload)[0])
    asked = {r.preload for r in rungs}
    beside = [float(at) for at in grid[max(k - 1, 0) : k + 2]]
    between = sorted([preload, least.preload])
    return [at for at in beside if at not in asked and not between[0] < at < between[1]]
