"""Highest steady amplitude in time: time integration along the upper branch towards its tip, until the motion falls.

The peak of the harmonic balance is the highest periodic solution, but a motion need not stay there.  With separation, or
near a fold, it often does not: motions beat, and fall to a lower level before or beyond the tip.  The search therefore
starts next to the tip, at a frequency without a lower solution.  It steps towards the tip by a quarter of the half width of
the resonance, each time from the previous motion.  A motion *stays* if the mean of its last periods is closer to this
branch than to the next lower solution and does not drift.  Where it falls, the last step is bisected twice.  Around the
highest point the steps are bisected down to :attr:`SteadyCriteria.fine`.  If all points are lower than the tip, one
integration starts from the solution at the tip; its motion is the result if it stays higher.

**All blades.**  The amplitude is that of the highest blade.  The blades of a tuned wheel need not vibrate equally, and only
rounding would break the symmetry of a motion.  Waves of every nodal diameter are therefore added at the first point and at
the highest one (``Ring.seeded``), and the last integration continues while they grow.  Blades vibrate differently if the
same blades are high in both halves of it.

**Verification.**  The search uses n time steps per period, the highest motion 2n and then 4n, because contacts may chatter
only with shorter steps.  The highest point is also reached from the other side and, if requested, from other disturbances
and tractions.  If the amplitudes differ by more than :attr:`SteadyCriteria.settled`, the result is their range.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.problem import Problem
from bdamper.response.continuation import TWO_PI
from bdamper.response.response_curve import check_curve
from bdamper.response.response_curve_result import ResponseCurve, crossed
from bdamper.response.verification import TimeResponse
from bdamper.time_domain.integration import STEPS, MarchFailed, Motion, Ring, ring_of
from bdamper.time_domain.march import March, second_half, to_come
from bdamper.util import validation
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, NOT_FOUND, SettingError, with_reason
from bdamper.util.formatting import amount, peak_text, span
from bdamper.util.progress import CostMeter, LongWork, one_thread


@dataclass(frozen=True)
class SteadyCriteria:
    """Criteria for a steady motion.

    Parameters
    ----------
    window : int
        Periods of a mean; beats leave a scatter of 2 to 3 % in means of 20.
    brief : int
        Periods of the change between two frequencies, and of a brief integration.  An integration is brief if no blade
        scatters by more than ``scatter`` (standard deviation) or drifts by more than ``steady`` (this hides up to 3 %), or
        the motion has fallen.  A long one lasts until its transient is below ``scatter`` and blades do not part further.
    fewest, most : int
        Least periods of a long integration if a lower solution exists (otherwise two windows), and most periods.
    drift : float
        Largest relative change between two means of a settled motion.
    scatter, steady : float
        See ``brief``.
    lower : float
        Solutions below this fraction of the amplitude are another level, not a ripple of the branch.
    drop, grown : float
        Fractions of the expected amplitude below which a motion has fallen, and above which it has grown.
    apart, fine, near : float
        Distance of the start from a tip without half width, and spacing of points around the highest one (both relative to
        the frequency); distance from the branch up to which a motion beyond the tip follows it.
    settled : float
        Largest relative difference of verification runs.
    seed, grows, faint : float
        Relative amplitude of the added waves; growth between two windows with which an integration continues; fraction
        above rounding whose growth prevents a brief integration.
    memory, stretch : float
        Decay time in periods above which all numbers of periods increase in proportion, and the largest factor.
    """

    window: int = 40
    brief: int = 20
    fewest: int = 120
    most: int = 400
    drift: float = 0.03
    scatter: float = 0.01
    steady: float = 0.003
    lower: float = 0.9
    drop: float = 0.7
    grown: float = 4.0
    apart: float = 0.01
    fine: float = 1.2e-3
    settled: float = 0.05
    seed: float = 0.01
    grows: float = 1.1
    faint: float = 1e-6
    near: float = 0.1
    memory: float = 100.0
    stretch: float = 4.0

    def stretched(self, memory: float) -> SteadyCriteria:
        """Return the criteria with every number of periods scaled in proportion to the decay time ``memory`` (periods)."""
        factor = min(max(1.0, memory / self.memory), self.stretch)
        periods = ("window", "brief", "fewest", "most")
        return replace(self, **{name: 2 * round(0.5 * factor * getattr(self, name)) for name in periods})


CRITERIA = SteadyCriteria()


class SteadyPoint(NamedTuple):
    """Motion at one frequency.

    Parameters
    ----------
    frequency : float, Hz
    amplitude : (n_periods,) float, m
        Amplitude of the highest blade in the last periods.
    stays : bool
        Whether the motion stays at its level.
    motion : Motion
        Final state.
    drift : float
        Relative change between the last two means.
    march : March, optional
        Time integration with all periods.
    origin : float, Hz
        Frequency of the previous motion.
    """

    frequency: float
    amplitude: NDArray
    stays: bool
    motion: Motion
    drift: float = 0.0
    march: March | None = None
    origin: float = float("nan")

    @property
    def mean(self) -> float:
        return float(self.amplitude.mean())


def integrate_until_steady(
    march: March, expected: float, limit: float, alone: bool = False, long: bool = False
) -> SteadyPoint:
    """Integrate until a motion near the amplitude ``expected`` (m) is steady or has fallen below a limit.

    A long integration continues while disturbances grow.

    Parameters
    ----------
    march : March
    expected, limit : float, m
    alone : bool
        Whether there is no lower solution.
    long : bool
        Whether to use the mean of two windows, and to require a settled motion without growing differences of blades.

    Returns
    -------
    SteadyPoint
    """
    rules, drift = CRITERIA.stretched(march.memory), np.inf
    most, window = CRITERIA.grown * expected, rules.window
    fewest = 0 if alone else rules.fewest if long else 2 * window
    while True:
        march.run(len(march.harmonics) + rules.brief // 2)
        n, amplitude = len(march.harmonics), march.amplitude
        if n >= (2 if long else 1) * rules.brief and _brief(march, limit, rules, long):
            last, drift = amplitude[-rules.brief :], 0.0
            break
        if n < 2 * window:
            continue
        latest, before = float(amplitude[-window:].mean()), float(amplitude[-2 * window : -window].mean())
        drift = latest / before - 1.0
        gone = (latest < limit and before < limit) or (latest > most and before > most)
        enough = n >= fewest and abs(drift) <= rules.drift
        if gone or n >= rules.most or (enough and not (long and growth(march, window)[0] > rules.grows)):
            last = amplitude[-(2 if long else 1) * window :]
            break
    stays = bool(limit <= last.mean() <= most)
    return SteadyPoint(march.omega / TWO_PI, last, stays, march.motion, drift, march)


def _brief(march: March, limit: float, rules: SteadyCriteria, long: bool) -> bool:
    """Return whether a few periods show that a motion has settled or, in a brief integration, has fallen."""
    blades = np.abs(march.blades[-rules.brief :])
    before, last = (half.mean(axis=0) for half in np.array_split(blades, 2))
    if np.abs(last - before).max() > rules.steady * last.min() or blades.std(axis=0).max() > rules.scatter * last.min():
        return not long and float(blades.max()) < limit and float(last.max()) <= float(before.max())
    if not long:
        return True
    to_settle = abs(to_come(march.amplitude[-2 * rules.brief :], march.memory))
    return to_settle <= rules.scatter and growth(march, rules.brief // 2, rules.faint)[0] <= 1.0


def growth(march: March, window: int, least: float = 0.1 * CRITERIA.seed) -> tuple[float, float]:
    """Return the growth of the motion outside the wave of the excitation between two windows, and its last fraction.

    A fraction below ``least`` does not count as growing.
    """
    away = march.ring.departure(march.blades[-2 * window :])
    before, last = (float(np.sqrt((half**2).mean())) for half in np.array_split(away, 2))
    return (last / before if last > least and before > 0.0 else 0.0), last


class CurveAmplitudes:
    """Amplitudes (m) of a response curve over frequency, without closed branches and separate branches above its peak."""

    def __init__(self, curve: ResponseCurve) -> None:
        points = np.flatnonzero(~curve.out_of_reach)
        self.frequency, self.amplitude, self.branch, self.unknowns = (
            np.asarray(x)[points] for x in (curve.frequency, curve.amplitude, curve.branch, curve.unknowns)
        )
        self.top = int(np.argmax(self.amplitude))

    def at(self, frequency: float) -> NDArray:
        """Return the amplitudes of all solutions at a frequency, in descending order."""
        return np.sort(crossed(self.frequency, self.amplitude, frequency, np.diff(self.branch) == 0)[1])[::-1]

    def start(self, frequency: float) -> NDArray:
        """Return the unknowns of the highest solution closest to a frequency, of any solution in a gap of the curve."""
        high = np.flatnonzero(self.amplitude >= CRITERIA.lower * max(self.at(frequency), default=0.0))
        return np.asarray(self.unknowns[high[np.abs(self.frequency[high] - frequency).argmin()]])

    def lower(self, frequency: float, expected: float) -> float:
        """Return the next solution below an amplitude, 0 if there is none."""
        return float(max((a for a in self.at(frequency) if a < CRITERIA.lower * expected), default=0.0))

    def alone(self, here: SteadyPoint, step: float) -> bool:
        """Return whether a motion is on its branch without another solution, up to where the branch is a tenth lower."""
        expected = self.at(here.frequency)
        if len(expected) != 1 or abs(here.mean / expected[0] - 1.0) > CRITERIA.near:
            return False
        ahead = (self.at(f) for f in np.linspace(here.frequency, self.end(step), 100)[1:-1])
        high = takewhile(lambda there: max(there, default=0.0) > CRITERIA.lower * expected[0], ahead)
        return all(len(there) == 1 for there in high)

    def end(self, sign: float) -> float:
        """Return the last frequency (Hz) on one side."""
        return float(self.frequency.max() if sign > 0.0 else self.frequency.min())

    def side(self, sign: float) -> tuple[float, float]:
        """Return the signed half width (Hz) on one side of the tip, and the first frequency beyond half of it with one
        solution.

        It is NaN if the branch ends before.  If the response does not fall by this much, the width is twice the distance to
        that frequency.
        """
        tip, height = self.frequency[self.top], self.amplitude[self.top]
        end = self.end(sign)
        width, before = np.nan, height
        for f in np.linspace(tip, end, 400)[1:-1]:
            expected = float(max(self.at(f), default=0.0))
            if expected < CRITERIA.drop * before:
                return width, np.nan
            before = expected
            if expected <= height / np.sqrt(2.0):
                width = f - tip
                break
        apart = sign * CRITERIA.apart * tip if np.isnan(width) else 0.5 * width
        away = np.linspace(tip + apart, end, 400)[:-1] if abs(end - tip) > abs(apart) else np.zeros(0)
        alone = (x for x in away if len(self.at(x)) and not self.lower(x, self.at(x)[0]))
        start = float(next(alone, np.nan))
        return 2.0 * (start - tip) if np.isnan(width) else width, start


class TipSearch:
    """Time integration along a branch towards its tip and beyond until the motion falls.

    Parameters
    ----------
    ring : Ring
    balance : CurveAmplitudes
    steps : int
        Time steps per period.

    Attributes
    ----------
    places : list of SteadyPoint
        Steady motions.
    answers : dict of str to float, m
        Amplitudes of the verification runs.
    fall : float, Hz
        Frequency at which the last motion falls; NaN if it does not.
    below : float, m
        Highest mean before a higher motion was started at the tip, 0 without any; NaN without this motion.
    failure : str
        Reason if no motion stays at the first frequency.
    """

    def __init__(self, ring: Ring, balance: CurveAmplitudes, steps: int) -> None:
        self.ring, self.balance, self.steps = ring, balance, steps
        self.places: list[SteadyPoint] = []
        self.answers: dict[str, float] = {}
        self.fall = self.below = float("nan")
        self.failure = ""
        self.periods = 0

    def integrate_at(
        self, frequency: float, start: NDArray | Motion, expected: float, finer: int = 1, long: bool = False,
        limit: float = 0.0,
    ) -> SteadyPoint:  # fmt: skip
        """Integrate at a frequency until a motion near the amplitude ``expected`` (m) is steady or has fallen (below
        ``limit`` if given).
        """
        march = March(self.ring, TWO_PI * frequency, start, finer * self.steps)
        lower = self.balance.lower(frequency, expected)
        limit = limit or max(0.5 * (expected + lower) if lower else 0.0, CRITERIA.drop * expected)
        place = integrate_until_steady(march, expected, limit, not lower, long or finer > 1)
        self.periods += len(march.harmonics)
        return place

    def solution(self, frequency: float) -> Motion:
        """Return the highest solution closest to a frequency, with disturbances."""
        motion = self.ring.start(self.balance.start(frequency), TWO_PI * frequency, self.steps)
        return self.ring.seeded(motion, CRITERIA.seed, 0)

    def approach(self, start: float, step: float) -> None:
        """Integrate from the solution at a frequency in steps (Hz) until the motion falls, or is beyond the tip and low."""
        expected = self.balance.at(start)[0]
        here = self.integrate_at(start, self.solution(start), expected)
        if here.stays:
            self.follow_branch(here, step)
            return
        self.fall, solution = start, f"harmonic balance gives {amount(expected, 'm')}"
        at = f"at {start:.6g} Hz, next to the peak, {solution}"
        falls = f"{at}, but the amplitude in time becomes {amount(here.mean, 'm')}: use more harmonics"
        gains = f"{at}, but the time integration grows to {amount(here.mean, 'm')}, an error of its time steps"
        self.failure = falls if here.mean <= CRITERIA.grown * expected else f"{gains}: use more steps_per_period"

    def follow_branch(self, here: SteadyPoint, step: float) -> None:
        """Follow a steady motion in steps (Hz) until it falls, or is beyond the tip and low."""
        tip, ends = self.balance.frequency[self.balance.top], self.balance.frequency
        while here.stays:
            self.places.append(here)
            beyond = (here.frequency - tip) * np.sign(step) > 0.0
            highest, following = max(p.mean for p in self.places), here.frequency + step
            over = here.mean < CRITERIA.lower * highest or (here.mean < highest and self.balance.alone(here, step))
            if (beyond and over) or not ends.min() <= following <= ends.max():
                return
            here = self.follow(here, following)
        self.fall = here.frequency
        for _ in range(2):
            last = self.places[-1]
            here = self.follow(last, 0.5 * (last.frequency + self.fall))
            if here.stays:
                self.places.append(here)
            else:
                self.fall = here.frequency

    def from_tip(self, step: float) -> None:
        """Start from the solution at the tip if no motion is as high, and continue (step in Hz) if its motion stays higher.

        A motion that falls on the way to the tip does not prove that none stays there.
        """
        frequency, expected = (float(x[self.balance.top]) for x in (self.balance.frequency, self.balance.amplitude))
        highest = max((p.mean for p in self.places), default=0.0)
        if highest >= (1.0 - CRITERIA.settled) * expected:
            return
        limit = (1.0 + CRITERIA.drift) * highest
        march = March(self.ring, TWO_PI * frequency, self.solution(frequency), self.steps)
        march.run(CRITERIA.stretched(march.memory).brief)
        self.periods += len(march.harmonics)
        if second_half(march.amplitude).mean() <= limit:
            return
        here = self.integrate_at(frequency, march.motion, expected, limit=limit)
        if here.stays:
            self.below, self.fall, self.failure = highest, float("nan"), ""
            self.follow_branch(here, step)
            self.refine()

    def refine(self) -> None:
        """Add points around the highest one, between it and its neighbours, from its motion with disturbances."""
        fallen: list[float] = []
        motion: Motion | None = None
        first = self.places[0].frequency if self.places else 0.0
        while len(self.places) > 1:
            top = max(self.places, key=lambda p: p.mean)
            gaps = [f - top.frequency for f in self.neighbours(top.frequency) if f not in fallen]
            gap = max(gaps, key=abs, default=0.0)
            if abs(gap) <= 1.5 * CRITERIA.fine * top.frequency:
                break
            motion = self.ring.seeded(top.motion, CRITERIA.seed, 0) if motion is None else top.motion
            here = self.follow(top._replace(motion=motion), top.frequency + 0.5 * gap)
            if here.stays:
                self.places.append(here)
            else:
                fallen.append(top.frequency + gap)
            if here.drift and abs(here.mean / top.mean - 1.0) <= 2.0 * CRITERIA.scatter:
                break  # the scatter by beats exceeds the difference of neighbouring points
        self.places.sort(key=lambda p: abs(p.frequency - first))  # in the order of the search

    def neighbours(self, frequency: float) -> list[float]:
        """Return the frequencies (Hz) of the neighbouring points on both sides."""
        f = np.array([p.frequency for p in self.places])
        return [*map(float, (*np.sort(f[f > frequency])[:1], *np.sort(f[f < frequency])[-1:]))]

    def follow(self, last: SteadyPoint, frequency: float) -> SteadyPoint:
        """Continue from one point to the next; the expected change is that of the curve, at most a quarter.

        The frequency changes over a few periods.  A sudden change would disturb a motion that stays in a slow sweep.
        """
        now, then = (float(max(self.balance.at(f), default=last.mean)) for f in (frequency, last.frequency))
        expected = last.mean * float(np.clip(now / then, 0.8, 1.25))
        march = March(self.ring, TWO_PI * last.frequency, last.motion, self.steps)
        march.sweep((march.omega, TWO_PI * frequency), CRITERIA.stretched(march.memory).brief, lambda: None)
        self.periods += len(march.harmonics)
        return self.integrate_at(frequency, march.motion, expected)._replace(origin=last.frequency)

    def highest(self) -> SteadyPoint | None:
        """Return the highest motion that also stays with half the time step; set ``fall`` to the nearest frequency at which
        it does not.

        Points are repeated as long as they could be higher: next to a fall the shorter time steps reduced the first by 7 %.
        """
        fallen: list[float] = []
        best: SteadyPoint | None = None
        for place in sorted(self.places, key=lambda p: -p.mean):
            if best is not None and place.mean <= (1.0 + CRITERIA.drift) * best.mean:
                break
            refined = self.integrate_at(place.frequency, place.motion._replace(a=None), place.mean, finer=2)
            if not refined.stays:
                fallen.append(place.frequency)
            elif best is None or refined.mean > best.mean:
                best = refined._replace(origin=place.origin)
                self.answers = {f"{2 * self.steps} steps": best.mean}
        if best is not None:
            at, way = best.frequency, self.places[-1].frequency - self.places[0].frequency
            self.fall = min((f for f in fallen if (f - at) * way > 0.0), key=lambda f: abs(f - at), default=self.fall)
        return best

    def with_quarter_steps(self, best: SteadyPoint) -> float:
        """Return the mean amplitude (m) at a point with 4n time steps.

        It is the mean of a few periods if these scatter little and, with the remaining transient, differ from the mean with
        2n by less than the tolerance; otherwise the mean of two further windows.
        """
        march = March(self.ring, TWO_PI * best.frequency, best.motion._replace(a=None), 4 * self.steps)
        rules = CRITERIA.stretched(march.memory)
        march.run(rules.brief)
        before, last = (float(half.mean()) for half in np.array_split(march.amplitude, 2))
        mean, scatter = 0.5 * (before + last), float(march.amplitude.std())
        left = float(np.exp(-0.5 * rules.brief / march.memory))  # decay of a transient from one half to the next
        apart = abs(mean / best.mean - 1.0) + abs(last / before - 1.0) * left / (1.0 - left)
        if scatter > rules.scatter * mean or apart > rules.settled:
            march.run(rules.brief + 2 * rules.window)
            mean = float(march.amplitude[-2 * rules.window :].mean())
        self.periods += len(march.harmonics)
        return mean

    def verify(self, best: SteadyPoint, starts: int) -> None:
        """Compute verification runs at the highest point: with 4n time steps, from the other side, and from other
        initial states.
        """
        self.answers[f"{4 * self.steps} steps"] = self.with_quarter_steps(best)
        sides = [f for f in self.neighbours(best.frequency) if (f - best.frequency) * (best.origin - best.frequency) < 0.0]
        for side, last in ((p.frequency, p) for p in self.places if p.frequency in sides):
            here = self.follow(last, best.frequency)
            if here.stays and abs(here.mean / best.mean - 1.0) > 0.5 * CRITERIA.settled:  # may still be a transient
                here = self.integrate_at(best.frequency, here.motion, here.mean, long=True)
            if here.stays:
                self.answers[f"from {side:.5g} Hz"] = here.mean
        tractions = self.ring.tractions(best.motion)
        for k in range(1, starts):
            name = list(tractions)[(k - 1) % len(tractions)]
            motion = self.ring.seeded(best.motion._replace(w=tractions[name]), CRITERIA.seed, k)
            self.answers[f"start {k}, {name}"] = self.integrate_at(best.frequency, motion, best.mean, long=True).mean

    def open_question(self, best: SteadyPoint) -> str:
        """Return a reason why a higher motion may exist, or ""."""
        if abs(best.drift) > CRITERIA.drift:
            return f"its mean still changes by {100.0 * best.drift:+.2g} % within {len(best.amplitude) // 2} periods"
        if self.fall != self.fall and best.frequency == self.places[-1].frequency:
            return "the curve ends before the motion falls; widen the interval"
        return ""


@one_thread
def time_response(
    problem: Problem,
    curve: ResponseCurve,
    *,
    steps_per_period: int | None = None,
    blades: int | None = None,
    starts: int = 1,
) -> TimeResponse:
    """Compute the highest steady amplitude in time at the preload of a response curve.

    Amplitudes are those of the highest blade (:mod:`bdamper.time_domain.steady_amplitude`).

    Parameters
    ----------
    problem : Problem
    curve : ResponseCurve
        Response curve of this problem, from one flank of the resonance to the other.
    steps_per_period : int, optional
        256 by default; the highest motion is integrated again with twice and four times as many.
    blades : int, optional
        Number of blades of the ring; by default the number that the engine order distinguishes.  More blades have more
        nodal diameters and patterns.
    starts : int
        Number of initial states at the highest point.  Further ones have other disturbances (their numbers are the seeds of
        the phases) and friction without traction, or at its limit in either direction.

    Returns
    -------
    TimeResponse
        "not found" if no motion stays or the integration fails; "incomplete" if runs differ, the mean drifts, or the curve
        ends before the motion falls.  After Ctrl-C the highest steady motion so far.

    Raises
    ------
    SettingError
        If the curve has no peak, or the settings do not describe a structure in time.
    """
    starts = validation.integer("starts", starts, least=1)
    check_curve(problem, curve)
    if curve.peak_at_end:
        highest = peak_text(curve.peak.amplitude, curve.peak.frequency, 6)
        raise SettingError(f"curve: expected a curve with a peak, found its highest amplitude at its end, {highest}")
    watch, balance, top = CostMeter(), CurveAmplitudes(curve), curve.peak
    sides = [balance.side(sign) for sign in (1.0, -1.0)]
    response = TimeResponse(*(top.amplitude,) * 3, top.frequency, curve.preload, top.amplitude, **problem.recorded())
    part = "" if curve.complete else f"there may be a higher peak, as the curve is {curve.status}"
    none = replace(response, mean=np.nan, lowest=np.nan, highest=np.nan, frequency=np.nan)
    ways = [side for side in sides if np.isfinite(side[1])]
    if not ways:
        why = "next to the tip there are several solutions at all frequencies; widen the interval"
        return replace(none, status=with_reason(NOT_FOUND, why))
    step, start = min(ways, key=lambda side: abs(side[1] - top.frequency))
    ring = ring_of(problem, curve.preload, blades)
    search, best = TipSearch(ring, balance, STEPS if steps_per_period is None else steps_per_period), None
    with LongWork() as work:
        try:
            search.approach(start, -step / 4.0)
            search.refine()
            search.from_tip(-step / 4.0)
            best = search.highest()
            if best is not None:
                search.verify(best, starts)
        except MarchFailed as error:
            search.places, search.failure = [], str(error)
    if work.interrupted and best is None:
        best = max(search.places, key=lambda p: p.mean, default=None)
    none = replace(none, periods=search.periods, diameters=ring.nodal_diameters, cost=watch.read(ring.cost))
    none = replace(none, direction="up" if step < 0.0 else "down", fall=search.fall, answers=search.answers)
    return _found(none, search, best, part, work.interrupted)


def _found(none: TimeResponse, search: TipSearch, best: SteadyPoint | None, part: str, interrupted: bool) -> TimeResponse:
    """Return the result of a search from a result without amplitudes; ``part`` is the omission of the curve."""
    left = search.failure or (search.open_question(best) or part if best is not None else "")
    if best is None:
        why = left or "no motion stays in steps of half the length: use more steps_per_period"
        status = INTERRUPTED if interrupted else with_reason(NOT_FOUND, why)
        return replace(none, direction="", fall=np.nan, answers={}, status=status)
    around = best.amplitude
    if best.march is not None:  # all but the first periods of a brief integration
        rules = CRITERIA.stretched(best.march.memory)
        around = best.march.amplitude[rules.brief :][-2 * rules.window :]
    answers = np.array([*search.answers.values()])
    if len(answers) and np.ptp(answers) > CRITERIA.settled * answers.min():
        ends = span(float(answers.min()), float(answers.max()), "m")
        left = f"not settled: {ends}{f'; {left}' if left else ''}"
        around = np.append(around, answers)
    carried, all_ = len(search.ring.nodal_diameters), search.ring.n // 2 + 1
    short = f"{carried} of {all_} nodal diameters were marched" if carried < all_ else ""
    other = f"comes to {amount(search.below, 'm')}" if search.below else "falls"
    tip = f"started at the peak of the balance; along the curve the motion {other}" if best.mean > search.below else ""
    said = "; ".join(filter(None, (tip, short)))
    result = replace(
        none, mean=best.mean, lowest=float(around.min()), highest=float(around.max()), frequency=best.frequency,
        status=INTERRUPTED if interrupted else with_reason(INCOMPLETE, left) if left else with_reason(COMPLETE, said),
    )  # fmt: skip
    return result if best.march is None else replace(result, **of_blades(best.march, len(best.amplitude)))


def of_blades(march: March, periods: int) -> dict[str, Any]:
    """Return the fields of a result about all blades, from the last periods of a time integration."""
    blades, rules = march.blades[-periods:], CRITERIA.stretched(march.memory)
    window = min(rules.window, len(march.harmonics) // 2)
    ratio = growth(march, window)[0] if window >= rules.brief else 0.0
    return {
        "blade": march.blade, "blades": np.abs(blades), "waves": march.ring.waves(blades),
        "energy": tuple(float(x) for x in np.mean(march.energy[-periods:], axis=0)),
        "growth": float(np.log(ratio)) / window if ratio else float("nan"),
    }  # fmt: skip
