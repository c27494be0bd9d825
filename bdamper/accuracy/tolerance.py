"""Settings chosen by themselves: a tracking curve whose highest peak is right to a tolerance.

1. A tracking curve with one harmonic.
2. Its highest point is carried into the richest study that the model allows, up to thirteen harmonics: one Newton step
   there says whether one harmonic is enough (:mod:`bdamper.effects.indicator`); if not, Newton goes on to the peak itself.
   This costs as much as a few points of a curve.
3. From the rich peak the one with 2, 3, ... harmonics follows in the same way, and the shortest series within the tolerance
   is known before a curve with it is there.
4. The curve is tracked with this series.  If its highest point is not the one expected, this is carried over in its turn.

Carried points need not be peaks: Newton holds the phase of the response, and only where the slope of the curve says that
the peak may be farther away than the tolerance allows is it looked for.  Where a series is too short for such a point by
less than another tolerance, the rich peak itself is found and the series asked again: this costs less than a longer one.
Where a peak comes to lie beyond the interval, its curve is compared at the end.  Where Newton loses the highest point of a
curve, the richer curve is looked for a little below it and a piece of it followed over its top.

What is spent on a decision is bound by what it could save: carrying points may in all take as much work
(:class:`bdamper.util.cost.Cost`) as one curve with the shortest series that is still in question, 1.4 of them with
what it takes to find the shortest series and to make sure of its curve.  Where this runs out, the longest series reached
must do, with what it differs from the one before as the error that may be left.  If this error alone keeps a curve from
being accepted, the point is carried to all harmonics after all, within the 1.4 curves.

Where the highest point cannot be followed to more harmonics, or what it becomes with all is not found with fewer, the next
first curve is one with 2, 4, 7, 13 harmonics; where points are lost and two of these, one with four or more, agree within a
third of the tolerance, the longer one is taken.

So the work is about at most that of all curves tracked and 1.4 of the shortest series that were in question: below three
times the work of the cheapest if that is the second curve and the first took less than 0.6 of it, or whatever was tracked
if it was less than 1.6 of it in all.  Where points cannot be followed, series can only be tried one after the other, and no
order of trials whose work adds up keeps a bound better than four times that of the first good enough, in general.

A highest point at an end of the interval is compared at its frequency, any other at the phase of its response.  Where the
damper walks, the mean position is free to move at one vibration and one frequency.  Such a highest point is a corner of the
curve and no maximum; it is compared in the middle of the walk, with the mean position held along it.

Contact forces are evaluated by exact events: samples would cost as much at lower accuracy.  (Coupled friction has no
closed form; it is sampled, 32 times for each harmonic at least.)  Contact points, modes and contact stiffness say what is
computed, not how accurately; they stay as they are in the study, and :meth:`bdamper.Study.estimate_errors` tells what more
of them would change.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.accuracy.estimate import finer_evaluation, missing_harmonics
from bdamper.balance.system import OK, HarmonicSystem
from bdamper.continuation.curve import Curve, uninterrupted
from bdamper.continuation.follower import ContinuationOptions, PathPoint, follow
from bdamper.continuation.track import track
from bdamper.effects.indicator import embed_between, estimate_change
from bdamper.peaks.carryover import phase_plane, solutions_near
from bdamper.peaks.newton import PeakOptions, find_peak, peak_scale, slope_along
from bdamper.problem.effects import Effects
from bdamper.problem.problem import Problem
from bdamper.stability.floquet import with_stability
from bdamper.util import validate
from bdamper.util.cost import CostMeter
from bdamper.util.estimates import percent

MOST_HARMONICS = 13
SHARE = 0.5
"""Share of the tolerance up to which a change, with twice what it may miss, is not looked into any further."""
RIVAL = 0.6
"""Share of the highest point from which on other maxima are looked at."""
ANOTHER = 0.5
"""Relative change of amplitude beyond which it is another peak."""
GROWTH = 1.75
"""How much longer the next first curve is at least, in harmonics: 1, 2, 4, 7, 13 of them."""
AGREEMENT = 1.0 / 3.0
"""Share of the tolerance within which two points are taken for one."""
ODD = 4
"""Shortest first curve whose agreement with the one before says something: friction acts on odd harmonics first."""
WALKING = 1e-6
"""Share of vibration and frequency in the tangent of a curve below which only the mean position moves."""
WORTH = 1.0
"""Work that carrying points to more harmonics may take in all, in curves with the shortest series still in question."""
WORTH_IN_ALL = 1.4
"""The same with what it takes to find the shortest series, and to make sure of a curve that waits to be accepted."""
CLOSE = 2.0
"""Times the tolerance within which a series that seems too short is asked again for the peak itself."""
FLAT = 4.0
"""How much farther a peak may be than where a resonance of one degree of freedom has it, from the slope of a curve."""
MAY_BE_LOST = 2
"""Series of harmonics at which a point carried may be lost before it is given up; at the first one it is at once."""
SAME = 1e-3
"""Relative difference of amplitude and frequency below which two points of one series are the same."""
NEARLY = PeakOptions(tolerance=1e-6, position_tolerance=1e-2)
"""How exactly a peak is found that decides for a series of harmonics."""
LOWER = (0.98, 0.95, 0.85)
"""Shares of the highest amplitude at which the curve with more harmonics is looked for where its peak is not found."""
PASSED = 0.97
"""Share of the highest amplitude at which a piece of a curve has passed it."""
PIECE = ContinuationOptions(
    tolerance=1e-6, step=0.1, max_step=0.3, max_turn=0.6, locate=True, locate_folds=False, locate_tolerance=0.05,
    max_points=40,
)  # fmt: skip
"""How it is followed."""
WAY = (3, 7, 9)
"""Series of harmonics by way of which a point is carried to more: most of the iterations are cheap ones then."""


def richest_study(problem: Problem) -> Problem:
    """The study with exact events, if its law has them, and all harmonics up to the thirteenth with modes in the model."""
    lacking = missing_harmonics(problem, MOST_HARMONICS)
    top = max(lacking[0] - 1 if lacking else MOST_HARMONICS, problem.harmonic_numbers[-1])
    rich = finer_evaluation(problem, top)
    _ = rich.self_locking  # of the bodies at rest: all series of harmonics share it
    return rich.with_effects(replace(Effects.of(rich), harmonics=top))


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
    """A tracking curve with settings such that its highest peak is right to a tolerance.

    Parameters
    ----------
    problem : Problem
        Its harmonics and its evaluation do not matter.
    preload : float, N
    frequency : (low, high), Hz
    tolerance : float
        Relative, on amplitude and frequency of the highest peak.
    options : ContinuationOptions
    stability : bool
        Judge the stability of every point.
    **following
        Further arguments of :func:`bdamper.continuation.track.track`.

    Returns
    -------
    Curve
        ``notes`` say what was chosen and why, ``settings["chosen"]`` holds it with the estimated rest.  ``cost`` is that
        of the choice and of all curves on the way.
    """
    preload, frequency = problem.check_preload(preload), validate.interval("frequency", frequency)
    tolerance = validate.number("tolerance", tolerance, above=0.0, below=1.0)
    if not problem.static(preload).converged:
        return track(problem, preload, frequency, options=options, **following)
    choice = _Choice(richest_study(problem), float(preload), frequency, tolerance, options, following)
    harmonics, rest = choice.run()
    curve = choice.curves[harmonics]
    chosen = choice.variant(harmonics)[0]
    how = "exact events" if chosen.evaluation == "exact" else f"{chosen.evaluation.n_time} samples"  # type: ignore[union-attr]
    names = " ".join(map(str, chosen.harmonic_numbers))
    head = f"chosen for {percent(tolerance)}: harmonics {names}, {how}"
    if rest == rest:
        head += f"; estimated rest {percent(rest)}"
    note = {
        "tolerance": tolerance, "harmonics": list(chosen.harmonic_numbers), "evaluation": how, "rest": rest,
        "curves": len(choice.curves), "reasons": choice.reasons,
    }  # fmt: skip
    curve = replace(
        curve,
        notes=(*curve.notes, head, *(f"  {line}" for line in choice.reasons)),
        settings={**curve.settings, "chosen": note},
        cost=choice.meter.read(time.perf_counter()),
    )
    return with_stability(problem, curve) if stability or problem.stability else curve


class _Passed(Exception):
    """A piece of a curve has passed its highest point."""


@dataclass(frozen=True)
class _Top:
    """A highest point: a solution with so many harmonics, or what a Newton step makes of it (``missed`` > 0)."""

    harmonics: int
    y: NDArray
    amplitude: float
    frequency: float
    width: float
    at_end: bool
    missed: float = 0.0
    walk: NDArray | None = None
    """Direction of the mean position in which nothing holds it, if the point is in the middle of a walk."""
    index: int = -1
    """Of the point on its curve, if it is one of a curve."""
    guessed: bool = False
    """Whether it stands in for one with all harmonics, which would have taken too much work."""

    def difference(self, other: _Top) -> float:
        """The larger of the relative differences of amplitude and frequency."""
        return max(abs(other.amplitude / self.amplitude - 1.0), abs(other.frequency / self.frequency - 1.0))


@dataclass
class _Choice:
    """The choice of a series of harmonics for one curve."""

    problem: Problem
    preload: float
    frequency: tuple[float, float]
    tolerance: float
    options: ContinuationOptions | None
    track: dict[str, Any]
    reasons: list[str] = field(default_factory=list)
    curves: dict[int, Curve] = field(default_factory=dict)
    variants: dict[int, tuple[Problem, HarmonicSystem]] = field(default_factory=dict)
    meter: CostMeter = field(default_factory=lambda: CostMeter(time.perf_counter()))

    least: int = 1
    """The shortest series that points carried to more harmonics leave in question."""
    too_short: int = 0
    """The longest series that any points carried have shown to be too short: not asked where that takes too much work."""
    limit: float = np.inf
    """Work of the meter at which carrying points ends."""
    lost: list[_Top] = field(default_factory=list)
    """Points that have not led to one with all harmonics."""

    def __post_init__(self) -> None:
        self.most = len(self.problem.harmonic_numbers)

    def run(self) -> tuple[int, float]:
        """Number of harmonics of the curve to return, and the estimated rest (NaN if there is no estimate)."""
        before: _Top | None = None
        target: _Top | None = None
        first = 0
        while first < self.most:
            first = min(max(self.least, math.ceil(GROWTH * max(self.curves, default=0.5))), self.most)
            tops = self.tops(first)
            if not tops:
                why = self.curves[first].reason or "no solutions"
                self.reasons.append(f"no highest point with harmonics 1 to {first}: {why}")
                continue
            target = self.target(tops)
            if target is not None and target.guessed:
                rest = target.difference(tops[0]) + target.missed
                if rest <= self.tolerance:
                    text = f"harmonics 1 to {target.harmonics} differ by {percent(rest)}, what more may change included"
                    self.reasons.append(f"{text}; 1 to {self.most} would take too much work")
                    return first, rest
            found = None if target is None else self.settled(first, target)
            if found is not None:
                return found
            if first == self.most:
                break
            if target is not None and not target.guessed:
                before = None
                self.reasons.append(f"{tops[0].frequency:.5g} Hz: not the peak that harmonics 1 to {self.most} have")
                continue
            if before is not None and first >= ODD and tops[0].difference(before) <= AGREEMENT * self.tolerance:
                rest = tops[0].difference(before)
                self.reasons.append(f"the series before agrees to {percent(rest)}")
                return first, rest
            before = tops[0]
            why = f"the highest point with harmonics 1 to {first} cannot be followed to {self.most}"
            self.reasons.append(f"{before.frequency:.5g} Hz: {why}")
        return self.all_of_them()

    def all_of_them(self) -> tuple[int, float]:
        self.curve(self.most)
        why = "the most tried" if self.most >= MOST_HARMONICS else "all that the model has modes for"
        self.reasons.append(f"harmonics 1 to {self.most} are {why}; what more would change is not estimated")
        return self.most, float("nan")

    def settled(self, first: int, target: _Top) -> tuple[int, float] | None:
        """A series whose curve has the highest point that is known with all harmonics; None if none is found."""
        harmonics, longer = first, first + 1  # a shorter series would do by coincidence only
        expected: _Top | None = None
        for _ in range(3):
            tops = self.tops(harmonics)
            if tops:
                if expected is not None and tops[0].difference(expected) > AGREEMENT * self.tolerance:
                    other = self.target(tops[:1])
                    if other is None and tops[0].amplitude > target.amplitude * (1.0 + self.tolerance):
                        break
                    missing = expected.amplitude > tops[0].amplitude * (1.0 + SAME)
                    if other is not None and (missing or other.amplitude > target.amplitude):
                        self.reasons.append(f"{tops[0].frequency:.5g} Hz: the curve is highest at another peak")
                        target = other
                    self.limit = self.end_of(harmonics, harmonics, WORTH_IN_ALL)
                    target = target if target.guessed else self.refined(target)
                self.limit = self.end_of(harmonics, harmonics, WORTH_IN_ALL)
                target = self.completed(target, tops[0]) if target.guessed else target
                target = target if target.guessed else self.exact(target, tops[0])
                rest = target.difference(tops[0])
                if rest + target.missed <= self.tolerance:
                    return harmonics, rest
            harmonics, expected, close = self.shortest(target, longer)
            if target.missed and close < harmonics:
                tracked = max(self.curves)
                saved = self.expected(tracked, harmonics) - self.expected(tracked, close)
                self.limit = min(self.limit, self.meter.work + saved)
                target = self.refined(target)
                harmonics, expected, _ = self.shortest(target, close)
            longer = harmonics + 1
            if expected is None:
                break
            text = f"harmonics 1 to {harmonics} leave {percent(target.difference(expected))} of the peak expected with 1 to"
            self.reasons.append(f"{text} {target.harmonics}")
        return None

    # ---- what there is ----

    def variant(self, harmonics: int) -> tuple[Problem, HarmonicSystem]:
        """The study with so many harmonics, and its equations."""
        if harmonics not in self.variants:
            problem = self.problem
            if harmonics != self.most:
                problem = problem.with_effects(replace(Effects.of(problem), harmonics=harmonics))
            system = problem.system(self.preload)
            self.meter.watch(system)
            self.variants[harmonics] = problem, system
        return self.variants[harmonics]

    def limited(self, harmonics: int) -> HarmonicSystem:
        """The equations with so many harmonics, for what is left of the work that carrying a point may take."""
        return self.variant(harmonics)[1].limited(self.limit - self.meter.work)

    def curve(self, harmonics: int) -> Curve:
        """Tracked once."""
        if harmonics not in self.curves:
            problem, _ = self.variant(harmonics)
            curve = uninterrupted(track(problem, self.preload, self.frequency, options=self.options, **self.track))
            self.meter.add(curve.cost)
            self.curves[harmonics] = curve
        return self.curves[harmonics]

    def tops(self, harmonics: int) -> list[_Top]:
        """The highest point of a complete curve and lower maxima that come near it, the highest first."""
        curve = self.curve(harmonics)
        if not len(curve) or not curve.complete:
            return []
        a = curve.amplitude
        out = []
        walks = _walks(curve)
        if curve.peak.index in walks:
            out.append(self.walk(harmonics, curve, *walks[curve.peak.index]))
        for i in range(len(curve)):
            if i in walks:
                continue
            inside = 0 < i < len(curve) - 1 and curve.branch[i - 1] == curve.branch[i] == curve.branch[i + 1]
            if i != curve.peak.index and not (inside and a[i - 1] < a[i] >= a[i + 1] and a[i] > RIVAL * a.max()):
                continue
            f = float(curve.frequency[i])
            y = np.append(curve.unknowns[i], 2.0 * np.pi * f)
            width = 0.01 * y[-1]
            if inside:  # unit of frequency: where the vibration has changed by its own size
                moved = [np.linalg.norm(curve.unknowns[j] - curve.unknowns[i]) for j in (i - 1, i + 1)]
                df = [abs(curve.frequency[j] - f) for j in (i - 1, i + 1)]
                width = 2.0 * np.pi * sum(df) * float(np.linalg.norm(curve.unknowns[i])) / max(sum(moved), 1e-300)
                width = float(np.clip(width, 1e-7 * y[-1], 0.2 * y[-1]))
            out.append(_Top(harmonics, y, float(a[i]), f, width, not inside, index=i))
        return sorted(out, key=lambda t: -t.amplitude)

    def walk(self, harmonics: int, curve: Curve, first: int, last: int) -> _Top:
        """The middle of a walk."""
        a, b = curve.unknowns[first], curve.unknowns[last]
        f = float(curve.frequency[first])
        y = np.append(0.5 * (a + b), 2.0 * np.pi * f)
        way = (b - a)[: self.variant(harmonics)[1].n_mean]
        return _Top(harmonics, y, float(curve.amplitude[first]), f, 0.01 * y[-1], False, walk=way)

    # ---- what other series would give ----

    def target(self, tops: list[_Top]) -> _Top | None:
        """What the highest of some points becomes with all harmonics; None if it cannot be followed.

        Where one that is lost was higher than what the others become, it may be the highest, and there is none.
        """
        tracked = tops[0].harmonics
        self.limit = self.end_of(tracked, max(self.least, tracked), WORTH)
        best = self.lifted(tops[0])
        if best is None or best.guessed:
            return best
        for top in tops[1:]:
            if top.amplitude > best.amplitude * (1.0 - self.tolerance):
                rival = self.lifted(top)
                if rival is None and top.amplitude > best.amplitude * (1.0 + self.tolerance):
                    return None
                if rival is not None and not rival.guessed and rival.amplitude > best.amplitude:
                    best = rival
        return best

    def end_of(self, tracked: int, harmonics: int, worth: float) -> float:
        """Work of the meter up to which points may be carried while so many harmonics are in question.

        All that has been spent on carrying counts, that is, all that no curve has taken.
        """
        curves = sum(curve.cost.work for curve in self.curves.values())
        return curves + worth * self.expected(tracked, harmonics)

    def expected(self, tracked: int, harmonics: int) -> float:
        """Work of a curve from that of one which is there: as many iterations at another size."""
        a, b = (float(self.variant(n)[1].work[:3].sum()) for n in (tracked, harmonics))
        return self.curves[tracked].cost.work * b / a

    def lifted(self, top: _Top) -> _Top | None:
        """A point as it is with all harmonics."""
        first = top
        least, last, lost = first.harmonics, np.inf, 0
        for harmonics in WAY:
            if not top.harmonics < harmonics < self.most:
                continue
            if harmonics == WAY[-1]:
                found = self.carried(top, self.most, quick=True)
                if found is not None:
                    return found
            found = self.carried(top, harmonics)
            if found is None and top is first:
                found = self.followed(top, harmonics)
            if found is None:
                lost = MAY_BE_LOST if top is first else lost + 1
                if lost == MAY_BE_LOST:
                    break
                continue
            for shorter in (first, top):
                if shorter.difference(found) > self.tolerance + found.missed:
                    least = max(least, shorter.harmonics + 1)
            last = top.difference(found) + found.missed
            top = found
            self.too_short = max(self.too_short, least - 1)
            self.limit = max(self.limit, self.end_of(first.harmonics, least, WORTH))
        again = any(t.harmonics == top.harmonics and t.difference(top) < SAME for t in self.lost)
        again = again or lost == MAY_BE_LOST
        starts = [top] if top is first else [top, first]
        for start in starts if first.harmonics >= WAY[1] else () if again else (top,):
            found = self.carried(start, self.most)
            if found is not None:
                return found
        if not self.limited(self.most).spent:
            self.lost.append(top)
        self.least = max(self.least, least)
        return self.stand_in(top, last)

    def stand_in(self, top: _Top, last: float) -> _Top | None:
        """The longest series reached, where the work ran out or no longer curve is left to ask; None if it still moves.

        What the first step to more harmonics changes says nothing of those left out: after it, nothing stands in.
        """
        asked = self.limited(self.most).spent or max(self.curves) >= WAY[1]
        known = top.harmonics > WAY[0] and last <= self.tolerance
        return replace(top, missed=last, guessed=True) if asked and known else None

    def completed(self, target: _Top, top: _Top) -> _Top:
        """What stands in for a point with all harmonics solved after all, where a curve waits for this to be accepted."""
        rest = target.difference(top)
        if not rest <= self.tolerance < rest + target.missed:
            return target
        found = self.carried(target, self.most)
        return target if found is None else replace(found, guessed=False)

    def shortest(self, target: _Top, least: int) -> tuple[int, _Top | None, int]:
        """The shortest series of so many harmonics at least, other than those with curves, that has the point; and this.

        The last is the shortest one that comes near it.
        """
        tracked = max(self.curves)
        lost, close = 0, self.most
        for harmonics in range(least, self.most):
            if harmonics in self.curves or lost == MAY_BE_LOST:
                continue
            self.limit = self.end_of(tracked, harmonics, WORTH_IN_ALL)
            if harmonics <= self.too_short and self.limited(harmonics).spent:
                continue
            found = self.carried(target, harmonics)
            if found is None:
                lost += 1
                continue
            found = self.exact(found, target)
            away = target.difference(found)
            if away <= CLOSE * self.tolerance:
                close = min(close, harmonics)
            if away + found.missed <= self.tolerance:
                return harmonics, found, close
        return self.most, None, close

    def exact(self, top: _Top, other: _Top) -> _Top:
        """The point itself instead of its estimate, where this could decide whether another is within the tolerance."""
        away = top.difference(other)
        return self.refined(top) if away - top.missed <= self.tolerance < away + top.missed else top

    def refined(self, top: _Top) -> _Top:
        """The peak near a point that need not be one, or the point if none is found."""
        system = self.limited(top.harmonics)
        if not top.missed or system.spent:
            return top
        peak = find_peak(system, top.y, options=NEARLY, drift=False)
        self.meter.iterations += peak.iterations
        if not peak.converged or abs(peak.amplitude / top.amplitude - 1.0) > ANOTHER or not self.inside(peak.frequency):
            return top
        return replace(top, y=peak.y, amplitude=peak.amplitude, frequency=peak.frequency, missed=0.0)

    def carried(self, top: _Top, harmonics: int, quick: bool = False) -> _Top | None:
        """A point as it is with another series, by one Newton step if that is enough, or by more; None if it is lost.

        With ``quick`` by one step or not at all.
        """
        if harmonics == top.harmonics:
            return top
        old, a = self.variant(top.harmonics)
        new, b = self.variant(harmonics)[0], self.limited(harmonics)
        y = embed_between(old, new, a, b, self.preload, top.y)
        if quick and (top.at_end or top.walk is not None):
            return None
        try:
            if top.walk is not None:
                found = self._on_walk(b, top, y, top.walk)
            else:
                found = self._at_frequency(b, top, y) if top.at_end else self._at_phase(b, top, y, quick)
            if found is not None and not self.inside(found.frequency):
                found = None if quick else self._at_end(b, found)
        except FloatingPointError:
            return None
        if found is None or abs(found.amplitude / top.amplitude - 1.0) > ANOTHER:
            return None
        return replace(found, harmonics=harmonics, index=-1)

    def followed(self, top: _Top, harmonics: int) -> _Top | None:
        """A point as it is with more harmonics, by a piece of their curve.

        It is begun at points some way down the curve there is, of which Newton makes some with more harmonics, and followed
        toward the highest one until it has passed it.
        """
        if top.index < 0 or self.limited(harmonics).spent:
            return None
        curve = self.curves[top.harmonics]
        height = curve.amplitude / top.amplitude
        for lower in LOWER:
            for step in (-1, 1):
                i = top.index
                while 0 <= i + step < len(curve) and curve.branch[i + step] == curve.branch[i] and height[i] > lower:
                    i += step
                if height[i] > lower:
                    continue
                up = bool(curve.frequency[i - step] > curve.frequency[i])
                found = self._piece(top, harmonics, np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i]), up)
                if found is not None and abs(found.amplitude / top.amplitude - 1.0) <= ANOTHER:
                    return found
        return None

    def _piece(self, top: _Top, harmonics: int, y: NDArray, up: bool) -> _Top | None:
        """The highest point of the curve with so many harmonics from near a point with fewer on."""
        old, a = self.variant(top.harmonics)
        new, b = self.variant(harmonics)[0], self.limited(harmonics)
        y = embed_between(old, new, a, b, self.preload, y)
        points: list[PathPoint] = []
        heights: list[float] = []

        def note(point: PathPoint) -> None:
            points.append(point)
            heights.append(float(abs(b.response(point.y[:-1])[1])))
            if heights[-1] < PASSED * max(heights):
                raise _Passed

        plane, scale = phase_plane(b, y, top.width)
        start = b.correct_at(y[:-1], float(y[-1]), scale, 1e-6, 12)
        self.meter.iterations += start.iterations
        if start.status != OK:
            start = b.correct(y, plane, scale, 1e-6, 12)
            self.meter.iterations += start.iterations
        if start.status != OK:
            return None
        with suppress(_Passed):
            limits = 2.0 * np.pi * self.frequency[0], 2.0 * np.pi * self.frequency[1]
            follow(b, start.y, limits, up=up, options=PIECE, on_point=note)
        if not heights:
            return None
        i = int(np.argmax(heights))
        inside = 0 < i < len(points) - 1
        if not inside and not (i > 0 and top.at_end and points[i].kind == "end"):
            return None
        point = points[i]
        return replace(
            top, harmonics=harmonics, y=point.y, amplitude=heights[i], frequency=float(point.y[-1] / (2.0 * np.pi)),
            at_end=not inside, index=-1,
        )  # fmt: skip

    def _at_frequency(self, b: HarmonicSystem, top: _Top, y: NDArray) -> _Top | None:
        for search in (False, True):
            c = b.correct_at(y[:-1], float(y[-1]), peak_scale(b, y, top.width), 1e-6, 25 if search else 15, search)
            self.meter.iterations += c.iterations
            if c.status == OK:
                return replace(top, y=c.y, amplitude=float(abs(b.response(c.y[:-1])[1])))
        return None

    def inside(self, frequency: float) -> bool:
        return self.frequency[0] <= frequency <= self.frequency[1]

    def _at_end(self, b: HarmonicSystem, top: _Top) -> _Top | None:
        """What a curve has at the end of the interval where its peak is beyond."""
        f = float(np.clip(top.frequency, *self.frequency))
        y = np.append(top.y[:-1], 2.0 * np.pi * f)
        return self._at_frequency(b, replace(top, frequency=f, at_end=True, missed=0.0), y)

    def _on_walk(self, b: HarmonicSystem, top: _Top, y: NDArray, way: NDArray) -> _Top | None:
        scale = peak_scale(b, y, top.width)
        plane = np.zeros(len(y))
        plane[: b.n_mean] = way / scale[: b.n_mean]
        plane /= np.linalg.norm(plane)
        for search in (False, True):
            c = b.correct(y, plane, scale, 1e-6, 40 if search else 15, search)
            self.meter.iterations += c.iterations
            if c.status == OK and np.linalg.norm(c.tangent[b.n_mean :]) < WALKING:
                amplitude, frequency = float(abs(b.response(c.y[:-1])[1])), float(c.y[-1] / (2.0 * np.pi))
                return replace(top, y=c.y, amplitude=amplitude, frequency=frequency, walk=way)
        return None

    def _at_phase(self, b: HarmonicSystem, top: _Top, y: NDArray, quick: bool) -> _Top | None:
        e = estimate_change(b, y)
        change = max(abs(e.amplitude), abs(e.frequency))
        if change + 2.0 * e.defect <= SHARE * self.tolerance:
            return replace(
                top, y=e.y, amplitude=top.amplitude * (1.0 + e.amplitude), frequency=top.frequency * (1.0 + e.frequency),
                missed=top.missed + e.defect,
            )  # fmt: skip
        return None if quick else self._solved(b, top, y, [e.y] if np.isfinite(e.size) and e.size < 0.3 else [])

    def _solved(self, b: HarmonicSystem, top: _Top, y: NDArray, guesses: list[NDArray]) -> _Top | None:
        """By Newton at the phase of the point; on to the peak only if the slope of the curve there calls for it."""
        for solution in solutions_near(b, guesses, y, top.width, quick=True):
            self.meter.iterations += solution.iterations
            z, scale = solution.y, peak_scale(b, y, top.width)
            slope = slope_along(b, z, solution.tangent, scale)
            away = FLAT * max(0.5 * slope**2, abs(slope * solution.tangent[-1] * scale[-1] / z[-1]))
            if away > SHARE * self.tolerance:
                peak = find_peak(b, z, options=NEARLY, drift=False)
                self.meter.iterations += peak.iterations
                if peak.converged:
                    return replace(top, y=peak.y, amplitude=peak.amplitude, frequency=peak.frequency, missed=0.0)
            if away <= SHARE * self.tolerance or b.spent:
                amplitude, frequency = float(abs(b.response(z[:-1])[1])), float(z[-1] / (2.0 * np.pi))
                return replace(top, y=z, amplitude=amplitude, frequency=frequency, missed=away)
        return None


def _walks(curve: Curve) -> dict[int, tuple[int, int]]:
    """For every point of a walk the first and the last of its points."""
    kind = curve.point_kind
    out: dict[int, tuple[int, int]] = {}
    i = 0
    while i < len(kind):
        last = i
        while last + 1 < len(kind) and kind[i] == kind[last + 1] == "walk" and curve.branch[i] == curve.branch[last + 1]:
            last += 1
        if last > i:
            out.update(dict.fromkeys(range(i, last + 1), (i, last)))
        i = last + 1
    return out
