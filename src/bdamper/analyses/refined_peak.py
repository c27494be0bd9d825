"""One question, asked of a problem and of a richer or leaner one: value, change, cost and status.

A *question* is a function that asks a problem for its highest point: a response curve (:func:`whole_curve`), a peak, or
amplitude and frequency.  :func:`ask` says what comes of it.  :func:`compare` says what another problem changes of an answer
that is known: where Newton's method leads from the peak to that of the other problem without changing it much, that is its
answer; otherwise its whole curve is followed.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.change_estimate import Change, embed
from bdamper.harmonic_balance.equations import OK, Equations
from bdamper.harmonic_balance.problem import Problem
from bdamper.response.curve import ResponseCurve, uninterrupted
from bdamper.response.highest_peak import highest_of_curve, maxima
from bdamper.response.peak import Peak, find_peak, same_peak
from bdamper.response.response_curve import frequency_response
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.short_repr import short
from bdamper.util.status import COMPLETE, word

Question = Callable[[Problem], Any]
NEARLY_HIGHEST = 0.7
"""Height over that of the highest peak, from which on a lower one is carried over with it.

A peak that changes by more than the rest, 30 %, may leave the top to one that is not carried over, so then a whole curve is
taken.  In the scenes of ``benchmarks.estimate_scenes`` the changes that Newton's method finds are at most 6 %, and those of
whole curves to 1e-4.
"""
WIDER = 1.05, 1.1, 1.2
"""By how much an interval is widened, one after the other, where the resonance has left it: 39 % in all."""


class Answer(NamedTuple):
    """What a question came to.

    Parameters
    ----------
    amplitude, frequency : float, m, Hz
        NaN if they are not known.
    why : str
        Why not; "" if they are.
    seconds : float
        Of the processor.
    result : ResponseCurve, Peak or tuple of float, or None
    """

    amplitude: float
    frequency: float
    why: str
    seconds: float
    result: Any


def ask(problem: Problem, question: Question) -> Answer:
    """The answer of a problem, in this thread; a failure is an answer, too."""
    begin, result = time.thread_time(), None
    try:
        result = question(problem)
        amplitude, frequency, why = _read(problem, result)
    except (BdamperError, ArithmeticError, np.linalg.LinAlgError) as error:
        amplitude, frequency, why = np.nan, np.nan, str(error)
    return Answer(float(amplitude), float(frequency), why, time.thread_time() - begin, result)


def _read(problem: Problem, result: Any) -> tuple[float, float, str]:
    """Amplitude, frequency, and why they are not known."""
    if not isinstance(result, ResponseCurve | Peak):
        try:
            amplitude, frequency = (float(value) for value in result)
        except (TypeError, ValueError):
            what = "a ResponseCurve, a Peak, or amplitude (m) and frequency (Hz)"
            raise SettingError(f"answer: expected {what}, found {short(result)}") from None
        return amplitude, frequency, ""
    if isinstance(result, Peak):
        known, why = (
            result.converged and word(result.search_status) == COMPLETE,
            f"status '{result.status}', scan {result.search_status}",
        )
    else:
        known, why = result.complete, f"{result.status}: {result.reason}"
    if not known:
        return np.nan, np.nan, why
    if isinstance(result, ResponseCurve):
        result = highest_of_curve(problem.system(result.preload), result).peak if result.peak_at_end else result.peak
    return result.amplitude, result.frequency, ""


def whole_curve(
    problem: Problem, preload: float, frequency: tuple[float, float], at_end: bool = False, wider: tuple | None = None
) -> ResponseCurve:
    """A response curve; an error where it has no point or, unless ``at_end``, no maximum within the interval.

    With factors ``wider`` it is an error, too, if an end is higher than every maximum.  The interval is first widened by
    them, one after the other, at the end at which the response is highest.
    """
    curve = uninterrupted(frequency_response(problem, preload, frequency))
    why = "" if len(curve) else curve.reason
    if not why and not at_end and curve.peak_at_end:
        if wider:
            low, high = frequency
            upward = 2.0 * curve.peak.frequency > low + high
            frequency = (low, high * wider[0]) if upward else (low / wider[0], high)
            return whole_curve(problem, preload, frequency, wider=wider[1:])
        if wider is not None or highest_of_curve(problem.system(preload), curve).kind == "end":
            why = "the response is highest at an end"
    if why:
        raise BdamperError(f"no peak at {preload:g} N between {frequency[0]:.6g} and {frequency[1]:.6g} Hz: {why}")
    return curve


@dataclass(frozen=True)
class Tops:
    """The highest peak of a study under one preload, and what else may become the highest.

    Parameters
    ----------
    peaks : tuple of Peak
        The highest first.
    interval : (low, high), Hz, or None
        Of the curve that they are from.
    at_end : bool
        Whether the highest is an end of the interval, which is no maximum.
    follow : bool
        Whether the interval is widened where the peak leaves it: not if an end is already higher, on the flank of another.
    """

    peaks: tuple[Peak, ...]
    interval: tuple[float, float] | None = None
    at_end: bool = False
    follow: bool = False

    @classmethod
    def of(cls, problem: Problem, curve: ResponseCurve) -> Tops:
        """The highest point of a response curve and the peaks nearly as high, refined."""
        system = problem.system(curve.preload)
        top = highest_of_curve(system, curve)
        lower = (p for p in maxima(system, curve, NEARLY_HIGHEST) if not same_peak(p, top.peak))
        return cls((top.peak, *lower), (float(curve.frequency.min()), float(curve.frequency.max())), top.kind == "end")


def compare(problem: Problem, other: Problem, preload: float, tops: Tops, by_newton: bool = False) -> Change:
    """How the highest peak changes from one problem to another under one preload (N).

    Parameters
    ----------
    problem, other : Problem
    preload : float, N
    tops : Tops
        Of the first problem.
    by_newton : bool
        Whether Newton's method is tried from its peaks before the whole curve of the other problem is followed.
    """
    state, peak = other.static(preload), tops.peaks[0]
    if not state.converged:
        return Change(np.nan, np.nan, np.inf, f"no static state: {state.note}")
    if by_newton:
        system = other.system(preload)
        embedded = [embed(problem, other, preload, top.y) for top in tops.peaks]
        found = _at_frequency(system, embedded, peak) if tops.at_end else _solved(system, embedded, tops)
        if found is not None:
            return found
    interval = tops.interval or (0.85 * peak.frequency, 1.2 * peak.frequency)
    answer = ask(other, lambda p: whole_curve(p, preload, interval, tops.at_end, WIDER if tops.follow else None))
    beyond = "" if interval[0] <= answer.frequency <= interval[1] else ", beyond the interval"
    return _change(peak, answer, f"no whole curve: {answer.why}" if answer.why else f"found anew by a whole curve{beyond}")


def _change(before: Peak, after: Answer | Peak, how: str) -> Change:
    a, f = after.amplitude / before.amplitude - 1.0, after.frequency / before.frequency - 1.0
    return Change(a, f, 0.0 if np.isfinite(a) else np.inf, how)


def _solved(system: Equations, embedded: list[NDArray], tops: Tops) -> Change | None:
    """The highest of the peaks to which Newton's method leads from each; None if it fails, or leads to another one."""
    found = []
    for y, peak in zip(embedded, tops.peaks):
        found.append(find_peak(system, y))
        change = _change(peak, found[-1], "")
        if not found[-1].converged or max(abs(change.amplitude), abs(change.frequency)) > 1.0 - NEARLY_HIGHEST:
            return None
    return _change(tops.peaks[0], max(found, key=lambda p: p.amplitude), "solved")


def _at_frequency(system: Equations, embedded: list[NDArray], peak: Peak) -> Change | None:
    """To the response of another system at the frequency of a point, if nothing else may become the highest."""
    y = embedded[0]
    for search in (False, True) if len(embedded) == 1 else ():
        c = system.correct_at(y[:-1], float(y[-1]), system.units(y, y[-1]), 1e-9, 60 if search else 20, search)
        if c.status == OK:
            change = float(abs(system.response(c.y[:-1])[1])) / peak.amplitude - 1.0
            return Change(change, 0.0, how="solved at the end of the interval")
    return None
