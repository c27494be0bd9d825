"""Chooses the number of harmonics for a given tolerance.

The whole answer is computed with 1, 3, 5, 9 and 13 harmonics until two in a row agree: amplitude and frequency of the
highest point (amplitude and preload of the optimum) differ by no more than the tolerance.  The answer with the more
harmonics of these two is the result.  If none agree, that with the most is, and says "not converged" with the last
difference.  Incomplete answers agree with nothing.  Where the model lacks the nodal diameters of more harmonics, or samples
are too few for them, the rule stops at the largest odd number that is possible.

Agreement is no proof: of 200 random scenes 189 converged, and 180 of these hold against nine harmonics (docs/accuracy.md).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.continuation.path import ContinuationOptions
from bdamper.continuation.track import track
from bdamper.peaks.newton import Peak
from bdamper.peaks.optimal import highest_peak, optimal_curve
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.problem.problem import Problem
from bdamper.stability.floquet import with_stability
from bdamper.util import validate
from bdamper.util.cost import CostMeter
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.estimates import percent

HARMONICS = (1, 3, 5, 9, 13)
"""Numbers of harmonics of the answers that are compared."""

Answer = TypeVar("Answer", Curve, Peak, OptimalCurve)


@dataclass(frozen=True)
class Rung:
    """Amplitude (m) and place of the answer with one number of harmonics.

    The place is a frequency in Hz, or the preload of an optimum in N, NaN where the preload does not matter; ``seconds``
    are processor time; ``incomplete`` says why the answer cannot be compared.
    """

    harmonics: int
    amplitude: float = float("nan")
    place: float = float("nan")
    seconds: float = 0.0
    incomplete: str = ""

    def difference(self, other: Rung) -> float:
        """The larger of the relative differences from another answer; infinite where one of them is incomplete."""
        if self.incomplete or other.incomplete:
            return float("inf")
        places = 0.0 if np.isnan(self.place) and np.isnan(other.place) else self.place / other.place - 1.0
        change = float(np.abs([self.amplitude / other.amplitude - 1.0, places]).max())
        return change if np.isfinite(change) else float("inf")


def _possible_numbers(problem: Problem) -> tuple[list[int], str]:
    """The numbers of harmonics to compare that the model and the evaluation allow, and what forbids more."""
    limit = ""
    for most in range(HARMONICS[-1], 1, -2):
        try:
            problem.with_(harmonics=most)
        except SettingError as error:
            limit = f"; no more than {most - 2} are possible ({error})"
        else:
            return [*(n for n in HARMONICS if n < most), most], limit
    return [1], limit


def converged_answer(
    problem: Problem,
    tolerance: float,
    answer: Callable[[Problem], Answer],
    read: Callable[[Answer], tuple[float, float, str]],
) -> Answer:
    """The answer with as many harmonics as a relative tolerance needs, whatever harmonics the problem itself has.

    ``read`` gives amplitude (m) and place of an answer, and why it cannot be compared ("" if it can).  The result holds in
    ``settings["chosen"]`` the ``tolerance``, the ``harmonics``, whether they have ``converged``, the last ``change`` (NaN
    without one), the ``rungs`` (a mapping for each :class:`Rung`) and a ``note`` that says the same in words.  Its ``cost``
    is that of all answers.

    Raises
    ------
    BdamperError
        If there is no answer with any number of harmonics: what the last of them has raised.
    """
    tolerance = validate.number("tolerance", tolerance, above=0.0, below=1.0)
    numbers, limit = _possible_numbers(problem)
    meter = CostMeter(time.perf_counter())
    rungs: list[Rung] = []
    best: Answer | None = None
    failure = BdamperError("no answer")
    for n in numbers:
        begin = time.process_time()
        try:
            result = answer(problem.with_(harmonics=n))
        except BdamperError as error:
            failure = error
            rungs.append(Rung(n, seconds=time.process_time() - begin, incomplete=str(error)))
            continue
        amplitude, place, incomplete = read(result)
        rungs.append(Rung(n, amplitude, place, time.process_time() - begin, incomplete))
        if result.cost is not None:
            meter.add(result.cost)
        interrupted = isinstance(result, Curve) and result.status == "interrupted"
        if interrupted or not incomplete or all(r.incomplete for r in rungs):
            best = result
        if interrupted or (len(rungs) > 1 and rungs[-1].difference(rungs[-2]) <= tolerance):
            break
    if best is None:
        raise failure
    chosen = {"harmonics": list(best.settings["harmonics"]), **_record(rungs, tolerance, limit)}
    return replace(best, settings=best.settings | {"chosen": chosen}, cost=meter.read(time.perf_counter()))


def _record(rungs: Sequence[Rung], tolerance: float, limit: str) -> dict[str, Any]:
    last = rungs[-1]
    change = last.difference(rungs[-2]) if len(rungs) > 1 else float("inf")
    missing = next((r for r in reversed(rungs[-2:]) if r.incomplete), None)
    note = f"{'converged' if change <= tolerance else 'not converged'} to {percent(tolerance)}: "
    if missing is not None:
        note += f"no whole answer with {missing.harmonics} harmonic{'s' * (missing.harmonics > 1)} ({missing.incomplete})"
    elif len(rungs) == 1:
        note += "one harmonic cannot be compared with more"
    else:
        note += f"{rungs[-2].harmonics} and {last.harmonics} harmonics differ by {percent(change)}"
    return {
        "tolerance": tolerance, "converged": change <= tolerance, "change": change if np.isfinite(change) else float("nan"),
        "rungs": [asdict(r) for r in rungs], "note": note + limit * (change > tolerance),
    }  # fmt: skip


def track_to_tolerance(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    tolerance: float,
    *,
    options: ContinuationOptions | None = None,
    stability: bool = False,
    **following: Any,
) -> Curve:
    """A tracking curve whose highest point agrees with that of fewer harmonics to a tolerance.

    ``stability`` judges the stability of every point; others are those of :func:`bdamper.continuation.track.track`.
    What :func:`converged_answer` says is among the notes.  A curve that was interrupted is returned as it is, one without a
    static state too.
    """
    tolerance = validate.number("tolerance", tolerance, above=0.0, below=1.0)
    if not problem.static(preload).converged:
        return track(problem, preload, frequency, options=options, **following)

    def read(curve: Curve) -> tuple[float, float, str]:
        if not curve.complete:
            return np.nan, np.nan, f"{curve.status}: {curve.reason}"
        return curve.peak.amplitude, curve.peak.frequency, ""

    curve = converged_answer(problem, tolerance, lambda p: track(p, preload, frequency, options=options, **following), read)
    curve = replace(curve, notes=(*curve.notes, curve.settings["chosen"]["note"]))
    judged = len(curve) and curve.status != "interrupted" and (stability or problem.stability)
    return with_stability(problem, curve) if judged else curve


def peak_to_tolerance(
    problem: Problem, preload: float, frequency: tuple[float, float] | None, tolerance: float, **searching: Any
) -> Peak:
    """The highest peak, in agreement with that of fewer harmonics to a tolerance on amplitude and frequency.

    Further arguments are those of :func:`bdamper.peaks.optimal.highest_peak`.
    """
    return converged_answer(
        problem, tolerance,
        lambda p: replace(highest_peak(p, preload, frequency, **searching), settings=p.record()),
        lambda peak: (peak.amplitude, peak.frequency, "" if peak.scan == "complete" else f"scan {peak.scan}"),
    )  # fmt: skip


def optimal_curve_to_tolerance(
    problem: Problem, preload: tuple[float, float] | Sequence[float] | NDArray, n: int, tolerance: float, **following: Any
) -> OptimalCurve:
    """The optimal curve whose optimum agrees with that of fewer harmonics to a tolerance on amplitude and preload.

    Further arguments are those of :func:`bdamper.peaks.optimal.optimal_curve`.
    """

    def read(curve: OptimalCurve) -> tuple[float, float, str]:
        best = curve.optimum
        why = "" if best.kind == "flat" or best.status == "converged" else f"optimum not converged: {best.status}"
        return best.amplitude, best.preload, why if curve.complete else "preloads without a peak"

    return converged_answer(problem, tolerance, lambda p: optimal_curve(p, preload, n, **following), read)
