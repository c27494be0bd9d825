"""Peaks followed upward in preload from amplitudes that fall.

The search at one preload follows the branches that connect with an end of the frequency interval.
If the preload rises, the branch of the highest peak can detach and become closed. The highest peak
of the remaining branches is then much lower. The amplitude seems to jump down to a minimum. A
damper that is run up under increasing load stays on the detached branch, and time integration finds
its amplitude: about 70 µm on the difficult disk (friction 0.432, engine order 10, 91.9 N), where
the remaining branch has 40 µm.

Therefore :func:`followed_peaks` follows the peak of a preload upward if the amplitude falls.
If it remains higher than the amplitude at a preload, this amplitude is not known, and the followed
peak is its lower bound.  The decrease from one preload to the next is
no criterion, because it depends on their distance.

A single preload and the lowest one of a range have no lower neighbour.  If its curve has folds,
:func:`with_lower_preloads` computes the response at lower preloads as well: a branch detaches at
folds, and they remain on both parts.  A branch that detached far below shows only in a range.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from bdamper.harmonic_balance.problem import Problem
from bdamper.response.events import ContinuationOptions
from bdamper.response.highest_peak import (
    FOLLOWED,
    HIGHER_AT_END,
    NEAR,
    REACH,
    AtPreload,
    Highest,
    as_peak,
    check_options,
    found_at,
    highest_of_curve,
    of_curve,
    with_errors,
)
from bdamper.response.linear_limits import peak_interval
from bdamper.response.peak import Peak, PeakOptions, coarse_options, find_peak
from bdamper.response.response_curve import frequency_response
from bdamper.response.response_curve_result import ResponseCurve, uninterrupted
from bdamper.response.richer_peak import MOST_STEPS
from bdamper.util.errors import FAILURES_AT_ONE_PRELOAD, INCOMPLETE, INTERRUPTED
from bdamper.util.formatting import amount, peak_text
from bdamper.util.progress import CostMeter, LongWork, one_thread, single_thread

HIGHER = 0.05
"""Relative height of a followed peak above the highest point of the curve from which the amplitude
is not known.  Smaller differences are within the tolerance of an amplitude.
"""
STEPS = 1e-4, 0.01, 0.1
"""Smallest, first, and largest relative step of the preload. On the difficult disk the steps are
between 0.05 and 3 %."""
CHANGE = 0.3
"""Largest change of ln(amplitude) in a step; a larger one is a jump to another peak."""

LOWER = 0.9, 0.6
"""Lower preloads, relative to a single preload, from which its peak is followed.

The peak of 0.9 times the preload can be followed on the difficult disk at 91.9 N, the peak of 0.8
times cannot.  Of random wedges that lost a branch, most had lost it at 0.9 times the preload as
well, but not at 0.6 times.
"""


def follow_upward(
    problem: Problem,
    peak: Peak,
    preload: float,
    *,
    above: float = 0.0,
    options: PeakOptions | None = None,
) -> Peak | None:
    """Follow a smooth peak from its preload to a higher preload.

    Parameters
    ----------
    problem : Problem
    peak : Peak
        Smooth maximum at a lower preload.
    preload : float, N
    above : float, m
        Amplitude at which the path ends.
    options : PeakOptions

    Returns
    -------
    Peak or None
        None if the peak vanishes, is a corner, falls to the amplitude ``above``, or if a preload in
        between has no solution, for example no static state.
    """
    # steps are in ln(preload)
    smallest, step, largest = STEPS
    # the parameter of a peak is its preload
    here = peak
    before: Peak | None = None
    rounding = 1e-12
    while here.parameter < preload * (1.0 - rounding):
        if here.corner or step < smallest:
            return None
        next_preload = min(here.parameter * np.exp(step), preload)
        guess = here.y
        if before is not None:
            # secant through the last two peaks
            last_step = np.log(here.parameter / before.parameter)
            next_step = np.log(next_preload / here.parameter)
            guess = here.y + (here.y - before.y) * next_step / last_step
        # direction of the curve; without it the search starts from the point alone
        shape: dict[str, Any] = {}
        if here.tangent.any():
            shape = {
                "tangent": here.tangent,
                "scale": here.scale,
                "curvature": here.curvature,
            }
        new: Peak | None = None
        with suppress(*FAILURES_AT_ONE_PRELOAD):
            system = problem.system(next_preload)
            new = find_peak(
                system, guess, options=options, parameter=next_preload, reach=REACH, **shape
            )
        # a large change of the amplitude is a jump to another peak
        if new is None or not new.ok or abs(np.log(new.amplitude / here.amplitude)) >= CHANGE:
            step *= 0.5
            continue
        if new.amplitude <= above:
            return None
        before = here
        here = new
        step = min(1.5 * step, largest)
    return here


class Followed(NamedTuple):
    """Peak at a preload that was followed from a lower preload ``start`` (N)."""

    peak: Peak
    start: float

    @property
    def note(self) -> str:
        """Reason why the highest point of the response curve is not the highest response."""
        height = peak_text(self.peak.amplitude, self.peak.frequency, 4)
        where = "not on a branch from an end of the interval"
        return f"{FOLLOWED} {amount(self.start, 'N')}: {height}; {where}"


def followed_peaks(
    problem: Problem,
    heights: Mapping[float, float],
    known: Callable[[float], bool],
    peak_at: Callable[[float], Peak | None],
    before: Mapping[float, Followed] | None = None,
    options: PeakOptions | None = None,
    compared: set[tuple[float, float]] | None = None,
) -> dict[float, Followed]:
    """Follow peaks to higher preloads to find amplitudes above the highest point found.

    If the amplitude decreases from one preload to the next, the peak is followed.  It is followed
    further until it vanishes or is no longer the highest.  The result contains each followed peak
    that is higher than the highest point found by more than :data:`HIGHER`.

    Parameters
    ----------
    problem : Problem
    heights : mapping of preload to float, m
        Amplitude of the highest point found at each preload, even if a higher one may exist.
    known : callable
        Whether the amplitude at a preload is known and needs a check.
    peak_at : callable
        Returns the highest point at a preload if it is a smooth maximum, otherwise None.
    before : mapping of preload to Followed, optional
        Followed peaks from earlier calls.
    options : PeakOptions
    compared : set of (lower, higher), optional
        Neighbouring preloads between which the followed peak vanishes or stays the highest.  They
        are not compared again; the set is extended.

    Returns
    -------
    dict of preload to Followed
        Followed peaks at each preload, including those of ``before``.
    """
    found = dict(before or {})
    if compared is None:
        compared = set()
    finite = [preload for preload in sorted(heights) if np.isfinite(heights[preload])]
    # the peak that is followed, at the lower preload; None if it is to be found there
    here: Peak | None = None
    for below, preload in pairwise(finite):
        height = heights[preload]
        if below in found:
            here = found[below].peak
        # a lost branch is followed to its end, also where neighbouring amplitudes are similar again
        falls = height < (heights[below] if here is None else here.amplitude)
        if preload in found or (below, preload) in compared or not falls:
            here = None
            continue
        if here is None:
            here = peak_at(below)
        if here is not None:
            lowest = (1.0 - NEAR) * height
            here = follow_upward(problem, here, preload, above=lowest, options=options)
        if here is None or here.amplitude < (1.0 + NEAR) * height:
            compared.add((below, preload))
        elif known(preload) and here.amplitude > (1.0 + HIGHER) * height:
            found[preload] = Followed(here, below)
    return found


def without_lost_peaks(
    problem: Problem,
    known: Mapping[float, AtPreload],
    options: PeakOptions | None = None,
    compared: set[tuple[float, float]] | None = None,
) -> dict[float, AtPreload]:
    """Return the preloads at which a peak followed from a lower preload is higher.

    Their highest point is the followed peak, with a note, so that their amplitude counts as
    unknown.  ``compared`` is as in :func:`followed_peaks`.
    """

    def peak_at(preload: float) -> Peak | None:
        top = known[preload].top
        return top.peak if top is not None and top.kind == "peak" else None

    def needs_check(preload: float) -> bool:
        there = known[preload]
        return there.known and not there.rattles

    before = {
        preload: Followed(there.top.peak, preload)
        for preload, there in known.items()
        if there.followed and there.top is not None
    }
    # include preloads at which the damper rattles, because their peaks may lead to a preload at
    # which it does not
    amplitudes = {preload: there.amplitude for preload, there in known.items()}
    found = followed_peaks(problem, amplitudes, needs_check, peak_at, before, options, compared)
    changed: dict[float, AtPreload] = {}
    for preload, followed in found.items():
        if preload not in before:
            # it is no point of the curve, so it has no index
            top = Highest(followed.peak, kind="peak", index=-1, note=followed.note)
            changed[preload] = replace(known[preload], top=top, slope=np.nan)
    return changed


@one_thread
def highest_peak(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float] | None = None,
    *,
    mode: int = 1,
    options: PeakOptions | None = None,
    progress: bool = False,
    errors: bool = False,
) -> Peak:
    """Compute the highest point of the response at one preload
    (:mod:`bdamper.response.highest_peak`).

    Parameters
    ----------
    problem : Problem
    preload : float, N
    frequency : (low, high), Hz, optional
        Around the free and the stuck resonance of ``mode`` by default.
    mode : int
        Mode of the constrained bodies, 1 for the lowest.
    options : PeakOptions
    progress : bool
    errors : bool
        Estimate the errors of the peak by harmonics and residual modes.

    Returns
    -------
    Peak
        ``corner`` is set unless it is a smooth maximum.  The status is "incomplete" if the curve is
        incomplete, has no maximum in the interval, or has a branch that was stopped among many
        folds.  It is also "incomplete" if the response is higher at an end, on a separate branch,
        or at a peak followed from a lower preload.  The amplitude is then NaN, and ``lower_bound``
        contains the highest computed maximum, or the end.  The amplitude of an unbounded resonance
        is infinite.  The status is "not found" with the reason, and there are no unknowns, if no
        response was found in the interval or if no steady periodic response is expected.  Up to two
        more curves are computed if the curve has folds and the damper does not rattle; the cost
        includes them.
    """
    frequency = peak_interval(problem.at(preload), frequency, mode)
    check_options(options)
    response = found_at(problem, preload, frequency, options=options, progress=progress)
    response = with_lower_preloads(problem, response, frequency, options)
    if errors:
        response = with_errors(problem, response, MOST_STEPS)
    return as_peak(problem, response, frequency)


def response_curve(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    options: ContinuationOptions | None = None,
    progress: bool = False,
) -> ResponseCurve:
    """Compute the response curve at one preload, with the verdict on its highest point.

    See :func:`bdamper.response.response_curve.frequency_response` and :func:`with_verdict`.
    """
    curve = frequency_response(problem, preload, frequency, options=options, progress=progress)
    return with_verdict(problem, curve, frequency)


def with_verdict(
    problem: Problem, curve: ResponseCurve, frequency: tuple[float, float]
) -> ResponseCurve:
    """Return a response curve that is incomplete if its highest point is no answer.

    Branches may cover the interval (Hz) although a higher response is known, or although no steady
    periodic response is expected.  The reason is then that of :attr:`AtPreload.ending`.  A curve
    that is highest at an end of the interval remains complete, but its peak is incomplete.  After
    Ctrl-C the curve is interrupted.
    """
    if not len(curve) or curve.interrupted:
        return curve
    with LongWork() as work, single_thread():
        response = of_curve(problem, curve, frequency)
        response = with_lower_preloads(problem, response, frequency)
    if work.interrupted:
        reason = "by the user, before peaks of lower preloads were followed"
        return replace(curve, status=INTERRUPTED, reason=reason)
    if len(curve.folds):
        curve = replace(curve, cost=curve.cost + response.cost)
    end = response.ending
    if end.ok or _highest_at_end(curve, response):
        return curve
    return replace(curve, status=INCOMPLETE, reason=end.reason)


def _highest_at_end(curve: ResponseCurve, response: AtPreload) -> bool:
    """Return whether an end of the interval is the only doubt about a complete curve."""
    if response.top is None or response.rattles or not curve.complete:
        return False
    if response.top.kind == "end":
        return True
    # a lower maximum inside the interval changes nothing, unless another branch is higher as well
    at_end = response.top.note.startswith(HIGHER_AT_END)
    return at_end and not curve.higher(response.top.peak.amplitude)


def with_lower_preloads(
    problem: Problem,
    response: AtPreload,
    frequency: tuple[float, float],
    options: PeakOptions | None = None,
) -> AtPreload:
    """Return the response with a peak followed from a lower preload if this is higher.

    Nothing is computed if the highest point is not known, the curve has no folds, or the damper
    rattles.
    """
    if not response.known or not len(response.curve.folds) or response.rattles:
        return response
    for share in LOWER:
        # a speed-dependent model may end above the lower preload
        try:
            lower = _coarse_at(problem, share * response.preload, frequency, options)
        except FAILURES_AT_ONE_PRELOAD:
            continue
        response = replace(response, cost=response.cost + lower.cost)
        pair = {lower.preload: lower, response.preload: response}
        changed = without_lost_peaks(problem, pair, options)
        if response.preload in changed:
            return changed[response.preload]
    return response


def _coarse_at(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    options: PeakOptions | None,
) -> AtPreload:
    """Return the highest point of one coarse curve, from which a peak can be followed."""
    meter = CostMeter()
    case = problem.at(preload)
    if case.static.ok:
        meter.watch(case.equations)
    coarse = coarse_options()
    curve = uninterrupted(frequency_response(problem, preload, frequency, options=coarse))
    # a locked joint starts from other residual forces than the search began with
    case = problem.at(preload)
    top: Highest | None = None
    if len(curve):
        # a curve of closed branches alone has no highest point, and no peak is followed from it
        with suppress(*FAILURES_AT_ONE_PRELOAD):
            top = highest_of_curve(case.equations, curve, options=options)
    return AtPreload(
        preload=preload, curve=curve, top=top, slope=np.nan, rattles="", cost=meter.read()
    )
