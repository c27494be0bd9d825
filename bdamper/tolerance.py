"""Settings chosen by themselves: a tracking curve whose highest peak is right to a tolerance.

1. A coarse tracking curve with one harmonic finds the maxima that come near the highest.
2. Each is embedded in the richest study that the model allows, up to thirteen harmonics; the indicator
   (:mod:`bdamper.indicator`) says which harmonics make up the change, these are switched on, and so on until the rest is
   below half of the tolerance (the steps are those of :mod:`bdamper.adaptive`).  A shorter
   series of harmonics is taken if the indicator, asked the other way round, finds that it does as well.
3. The curve is tracked with the harmonics that the highest of them calls for.  If its peak is not the one that they were
   chosen for, or the estimated rest there is above the tolerance, what it calls for is added, and it is tracked again.

Where a peak cannot be followed to more harmonics, longer and longer series are tracked until two of them agree within a
third of the tolerance.

Contact forces are evaluated by exact events: samples would cost as much at lower accuracy.  (Coupled friction has no
closed form; it is sampled, 32 times for each harmonic at least.)  Contact points, modes and contact stiffness say what is
computed, not how accurately; they stay as they are in the study, and :meth:`bdamper.Study.estimate_errors` tells what more
of them would change.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bdamper.adaptive import _check_tolerance, _Lost, _Search
from bdamper.continuation import ContinuationOptions
from bdamper.effects import Effects
from bdamper.estimates import percent
from bdamper.estimation import finer_evaluation, missing_harmonics
from bdamper.indicator import Estimate, embed_between, estimate_change, highest_peaks
from bdamper.peaks import Peak
from bdamper.response import Curve

if TYPE_CHECKING:
    from bdamper.study import Study

MOST_HARMONICS = 13
SHARE = 0.9
"""Share of the tolerance that a choice may use up by its estimate."""


def richest_study(study: Study) -> Study:
    """The study with exact events, if its law has them, and all harmonics up to the thirteenth with modes in the model."""
    lacking = missing_harmonics(study, MOST_HARMONICS)
    top = max(lacking[0] - 1 if lacking else MOST_HARMONICS, study.harmonic_numbers[-1])
    rich = finer_evaluation(study, top)
    return rich.with_effects(replace(Effects.of(rich), harmonics=top))


def track_to_tolerance(
    study: Study,
    preload: float,
    frequency: tuple[float, float],
    tolerance: float,
    *,
    options: ContinuationOptions | None = None,
    **track: Any,
) -> Curve:
    """A tracking curve with settings such that its highest peak is right to a tolerance.

    Parameters
    ----------
    study : Study
        Its harmonics and its evaluation do not matter.
    preload : float, N
    frequency : (low, high), Hz
    tolerance : float
        Relative, on amplitude and frequency of the highest peak.
    options : ContinuationOptions
    **track
        Further arguments of :meth:`bdamper.Study.track`.

    Returns
    -------
    Curve
        ``notes`` say what was chosen and why, ``settings["chosen"]`` holds it with the estimated rest.
    """
    _check_tolerance(tolerance)
    begin = time.perf_counter()
    search = _Search(richest_study(study), float(preload), frequency, tolerance)
    everything = search.own.harmonic_numbers
    choice = _harmonics_called_for(search)
    on, rest, reasons = choice.harmonics, choice.rest, list(choice.reasons)
    climb = [] if np.isfinite(choice.amplitude) else [l for l in (1, 3, 6) if l < everything[-1]]
    if climb:
        on = tuple(range(1, climb.pop(0) + 1))
    before: tuple[float, float] | None = None
    while True:
        chosen, system = search.variant(on)
        curve = chosen.track(preload, frequency, options=options, **track)
        if on == everything or not len(curve):
            break
        top = curve.peak
        if not np.isfinite(choice.amplitude):  # no expectation: longer series until two of them agree
            if before is not None and curve.complete:
                rest = max(abs(before[0] / top.amplitude - 1.0), abs(before[1] / top.frequency - 1.0))
                if rest <= tolerance / 3.0:
                    reasons.append(f"the series before agrees to {percent(rest)}")
                    break
            before = (top.amplitude, top.frequency) if curve.complete else None
            on = tuple(range(1, climb.pop(0) + 1)) if climb else everything
            continue
        expected = max(abs(choice.amplitude / top.amplitude - 1.0), abs(choice.frequency / top.frequency - 1.0))
        if expected <= tolerance:
            rest = expected
            break
        peaks = highest_peaks(system, curve, share=0.99)
        left = search.missing(peaks[0], on) if peaks else None
        if left is not None and left.size <= tolerance:
            rest = left.size
            break
        longer = next((l for l in everything if l not in on), everything[-1])
        if len(on) == longer - 1 and expected <= 3.0 * tolerance:  # a series, and nearly long enough
            wanted = tuple(range(1, min(longer + 1, everything[-1]) + 1))
            why = f"the peak of the curve is {percent(expected)} from the one expected"
        elif left is None or not left.size < 0.3:
            wanted, why = everything, "the peak of the curve is not the one expected"
        else:
            wanted, why = search.called_for(left, on), f"the peak of the curve would still change: {_change(left)}"
        reasons.append(f"{why}: harmonics {_names(wanted)}")
        on = wanted
    if on == everything:
        rest = float("nan")
        why = "the most tried" if len(everything) >= MOST_HARMONICS else "all that the model has modes for"
        reasons.append(f"harmonics {_names(on)} are {why}; what more would change is not estimated")
    how = "exact events" if chosen.evaluation == "exact" else f"{chosen.evaluation.n_time} samples"  # type: ignore[union-attr]
    head = f"chosen for {percent(tolerance)}: harmonics {_names(on)}, {how}"
    if rest == rest:
        head += f"; estimated rest {percent(rest)}"
    note = {"tolerance": tolerance, "harmonics": list(on), "evaluation": how, "rest": rest, "reasons": reasons}
    return replace(
        curve,
        notes=(*curve.notes, head, *(f"  {line}" for line in reasons)),
        settings={**curve.settings, "chosen": note},
        cost=replace(curve.cost, seconds=time.perf_counter() - begin),
    )


@dataclass(frozen=True)
class _Choice:
    """Harmonics that the highest peak calls for, the estimated rest, why, and the peak expected with all harmonics."""

    harmonics: tuple[int, ...]
    rest: float
    reasons: tuple[str, ...]
    amplitude: float = np.nan
    frequency: float = np.nan


def _harmonics_called_for(search: _Search) -> _Choice:
    everything = search.own.harmonic_numbers
    peaks, reason = search.tracked((1,))
    if not peaks or not search.curve.complete:
        why = f"no peak with one harmonic ({reason or search.curve.reason}): longer and longer series are tried"
        return _Choice(everything, np.nan, (why,))
    best: tuple[Peak, tuple[int, ...], Estimate | None] | None = None
    try:
        for peak in peaks:
            lifted = search.lift(peak, (1,))
            if best is None or lifted[0].amplitude > best[0].amplitude:
                best = lifted
    except _Lost as lost:
        return _Choice(everything, np.nan, (f"{lost}: longer and longer series are tried",))
    assert best is not None
    peak, on, estimate = best
    reasons = [line for line in search.log if "estimated change" in line]
    to_come = (0.0, 0.0, 0.0) if estimate is None else (estimate.amplitude, estimate.frequency, estimate.defect)
    rest = max(abs(to_come[0]), abs(to_come[1])) + to_come[2]
    if estimate is not None:
        reasons.append(f"with harmonics {_names(on)} the rest is estimated at {percent(rest)}")
    fewer = _thinned(search, peak, on, to_come)
    if fewer is not None:
        on, rest = fewer
        reasons.append(f"harmonics {_names(on)} are enough: they leave {percent(rest)}")
    return _Choice(
        on, rest, tuple(reasons), peak.amplitude * (1.0 + to_come[0]), peak.frequency * (1.0 + to_come[1])
    )  # fmt: skip


def _thinned(
    search: _Search, peak: Peak, on: tuple[int, ...], to_come: tuple[float, float, float]
) -> tuple[tuple[int, ...], float] | None:
    """The shortest series of harmonics within the tolerance of the peak to come, if it is shorter than what is on."""
    rich, system = search.variant(on)
    for top in range(1, len(on)):
        series = tuple(range(1, top + 1))
        study, poorer = search.variant(series)
        e = estimate_change(poorer, embed_between(rich, study, system, poorer, search.preload, peak.y))
        away = max(abs(e.amplitude - to_come[0]), abs(e.frequency - to_come[1])) + to_come[2]
        # what the estimate misses is found out on the curve itself
        if away <= SHARE * search.tolerance and e.defect <= search.tolerance:
            return series, float(away)
    return None


def _change(estimate: Estimate) -> str:
    return f"amplitude {percent(estimate.amplitude, True)}, frequency {percent(estimate.frequency, True)}"


def _names(harmonics: tuple[int, ...]) -> str:
    return " ".join(map(str, harmonics))
