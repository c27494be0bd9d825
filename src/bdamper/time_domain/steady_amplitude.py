"""The highest amplitude in time: a march along the upper branch toward its tip until the motion falls.

A peak of the harmonic balance says where a periodic solution is highest, and not whether a motion stays there.  Where
contacts open, or where a fold is near, it often does not: motions beat, and fall to a lower level before the tip or beyond
it.  So a march starts beside the tip, where no lower solution exists at the same frequency, and goes toward it in quarters
of the half width of the resonance, each step from the motion before.  After each step the motion *stays* if the mean of its
last periods is nearer to this branch than to the next lower solution and does not drift.  Where it falls the last step is
halved twice, and around the highest place the steps are halved down to :attr:`Rules.fine`.  If all places remain lower than
the tip, one march starts from the solution there; its motion is the answer if it stays higher.

**All blades.**  An amplitude is that of the highest blade.  Blades of a tuned wheel need not vibrate alike, and a symmetric
motion would part from rounding alone: waves of every nodal diameter are added at the first place and once more at the
highest one (``Ring.seeded``), and the last march goes on while they grow.  Blades have parted where the same ones are high
in both halves of it.

**Several answers.**  Places are marched with n steps, the highest motion with 2n and from there with 4n, since contacts may
chatter in shorter steps alone.  Its place is reached from the other side, and if asked for, from other disturbances and
tractions.  Where these amplitudes differ by more than :attr:`Rules.settled` the answer is their range.
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
from bdamper.util.formatting import amount, span
from bdamper.util.progress import CostMeter, LongWork, one_thread


@dataclass(frozen=True)
class Rules:
    """What tells a motion that stays.

    Parameters
    ----------
    window : int
        Periods over which a mean is taken: beats leave 2 to 3 % of scatter in means of 20.
    brief : int
        Periods of a sweep between two places, and of a visit in which no blade scatters by more than ``scatter`` (standard
        deviation) or drifts by more than ``steady``, or the motion has fallen; a drift that small hides up to 3 %.  A long
        visit takes twice as many or more, until its transient leaves less than ``scatter`` and its blades part no further.
    fewest, most : int
        Periods of a long visit where there is a lower solution to fall to, two windows elsewhere; and after which a mean
        may still drift.
    drift : float
        Relative change between two means above which a motion has not settled.
    lower : float
        Another solution below this part of the amplitude is another level, and no ripple of the branch.
    drop, grown : float
        Part of the amplitude that was expected below which a motion has fallen, and above which it has grown.
    apart, fine, near : float
        Least distance from a tip without half width where the march begins, distance of places around the highest one (both
        relative to the frequency), and distance from its branch within which a motion beyond the tip goes on along it.
    settled : float
        Relative difference of two answers above which none of them is one.
    seed, grows, faint : float
        Size of the waves that are added, relative to the amplitude; growth of what is not the excited wave between two
        windows from which on a march goes on; and share of it above rounding whose growth keeps a visit from being brief.
    memory, stretch : float
        Periods in which a transient falls to 1/e from which on all numbers of periods grow with it, and how far at most.
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

    def stretched(self, memory: float) -> Rules:
        """With the periods that a memory takes."""
        factor = min(max(1.0, memory / self.memory), self.stretch)
        periods = ("window", "brief", "fewest", "most")
        return replace(self, **{name: 2 * round(0.5 * factor * getattr(self, name)) for name in periods})


RULES = Rules()


class Place(NamedTuple):
    """What was found at one frequency.

    Parameters
    ----------
    frequency : float, Hz
    amplitude : (n_periods,) float, m
        Of the highest blade in the last periods.
    stays : bool
        Whether the motion stays at its level.
    motion : Motion
        At the end.
    drift : float
        Relative change between the last two means.
    march : March, optional
        With all periods.
    origin : float, Hz
        Where the motion came from.
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


def stay(march: March, own: float, limit: float, alone: bool = False, long: bool = False) -> Place:
    """March until a motion near the level ``own`` (m) stays or has fallen below a limit.

    Disturbances that grow make a long march go on.

    Parameters
    ----------
    march : March
        At its start.
    own, limit : float, m
    alone : bool
        Whether it is known that there is no lower solution to fall to.
    long : bool
        Whether amplitudes are those of two windows, not of one, and what is brief has settled and does not part.
    """
    rules, drift = RULES.stretched(march.memory), np.inf
    most, window = RULES.grown * own, rules.window
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
    return Place(
        march.omega / TWO_PI, last, bool(limit <= last.mean() <= most), march.motion, drift, march
    )


def _brief(march: March, limit: float, rules: Rules, long: bool) -> bool:
    """Whether a few periods show that a motion has settled, or in a visit that is not long has fallen for good."""
    blades = np.abs(march.blades[-rules.brief :])
    before, last = (half.mean(axis=0) for half in np.array_split(blades, 2))
    if np.abs(last - before).max() > rules.steady * last.min() or blades.std(axis=0).max() > rules.scatter * last.min():
        return not long and float(blades.max()) < limit and float(last.max()) <= float(before.max())
    if not long:
        return True
    to_settle = abs(to_come(march.amplitude[-2 * rules.brief :], march.memory))
    return to_settle <= rules.scatter and growth(march, rules.brief // 2, rules.faint)[0] <= 1.0


def growth(march: March, window: int, least: float = 0.1 * RULES.seed) -> tuple[float, float]:
    """What does not belong to the wave of the excitation: its growth between two windows, and its share in the last.

    A share below the ``least`` one does not count as growing.
    """
    away = march.ring.departure(march.blades[-2 * window :])
    before, last = (float(np.sqrt((half**2).mean())) for half in np.array_split(away, 2))
    return (last / before if last > least and before > 0.0 else 0.0), last


class Levels:
    """The amplitudes (m) of a response curve over frequency, without closed branches and separate ones above its peak."""

    def __init__(self, curve: ResponseCurve) -> None:
        points = np.flatnonzero(~curve.out_of_reach)
        self.frequency, self.amplitude, self.branch, self.unknowns = (
            np.asarray(x)[points] for x in (curve.frequency, curve.amplitude, curve.branch, curve.unknowns)
        )
        self.top = int(np.argmax(self.amplitude))

    def at(self, frequency: float) -> NDArray:
        """All solutions at a frequency, the highest first."""
        return np.sort(crossed(self.frequency, self.amplitude, frequency, np.diff(self.branch) == 0)[1])[::-1]

    def start(self, frequency: float) -> NDArray:
        """Unknowns of the point of the highest level next to a frequency, of any level where the curve has a gap."""
        high = np.flatnonzero(self.amplitude >= RULES.lower * max(self.at(frequency), default=0.0))
        return np.asarray(self.unknowns[high[np.abs(self.frequency[high] - frequency).argmin()]])

    def lower(self, frequency: float, own: float) -> float:
        """The next solution below a level, 0 without one."""
        return float(max((a for a in self.at(frequency) if a < RULES.lower * own), default=0.0))

    def alone(self, here: Place, step: float) -> bool:
        """Whether a motion is on its branch and has no other solution beside it, up to where that is a tenth lower."""
        own = self.at(here.frequency)
        if len(own) != 1 or abs(here.mean / own[0] - 1.0) > RULES.near:
            return False
        ahead = (self.at(f) for f in np.linspace(here.frequency, self.end(step), 100)[1:-1])
        high = takewhile(lambda there: max(there, default=0.0) > RULES.lower * own[0], ahead)
        return all(len(there) == 1 for there in high)

    def end(self, sign: float) -> float:
        """Last frequency (Hz) on one side."""
        return float(self.frequency.max() if sign > 0.0 else self.frequency.min())

    def side(self, sign: float) -> tuple[float, float]:
        """Half width (Hz, with its sign) on one side of the tip, and the first frequency half of it away where the branch
        is alone; NaN where it ends before.  A response that does not fall by that much has twice the way to that place."""
        tip, height = self.frequency[self.top], self.amplitude[self.top]
        end = self.end(sign)
        width, before = np.nan, height
        for f in np.linspace(tip, end, 400)[1:-1]:
            own = float(max(self.at(f), default=0.0))
            if own < RULES.drop * before:
                return width, np.nan
            before = own
            if own <= height / np.sqrt(2.0):
                width = f - tip
                break
        apart = sign * RULES.apart * tip if np.isnan(width) else 0.5 * width
        away = np.linspace(tip + apart, end, 400)[:-1] if abs(end - tip) > abs(apart) else np.zeros(0)
        alone = (x for x in away if len(self.at(x)) and not self.lower(x, self.at(x)[0]))
        start = float(next(alone, np.nan))
        return 2.0 * (start - tip) if np.isnan(width) else width, start


class Walk:
    """A march along a branch toward its tip and on until the motion falls; the places that were found.

    Parameters
    ----------
    ring : Ring
    levels : Levels
    steps : int
        Of a period.

    Attributes
    ----------
    fall : float, Hz
        Where the motion of the last place falls; NaN if it does not.
    below : float, m
        Highest mean of the places before a higher motion was started at the tip, 0 without any; NaN without this motion.
    """

    def __init__(self, ring: Ring, levels: Levels, steps: int) -> None:
        self.ring, self.levels, self.steps = ring, levels, steps
        self.places: list[Place] = []
        self.answers: dict[str, float] = {}
        self.fall = self.below = float("nan")
        self.astray = ""
        self.periods = 0

    def visit(
        self, frequency: float, start: NDArray | Motion, own: float, finer: int = 1, long: bool = False, limit: float = 0.0
    ) -> Place:
        """March at a frequency until a motion near the level ``own`` (m) stays or has fallen, below ``limit`` if given."""
        march = March(self.ring, TWO_PI * frequency, start, finer * self.steps)
        lower = self.levels.lower(frequency, own)
        limit = limit or max(0.5 * (own + lower) if lower else 0.0, RULES.drop * own)
        place = stay(march, own, limit, not lower, long or finer > 1)
        self.periods += len(march.harmonics)
        return place

    def solution(self, frequency: float) -> Motion:
        """Return the solution of the highest level next to a frequency, with disturbances."""
        motion = self.ring.start(self.levels.start(frequency), TWO_PI * frequency, self.steps)
        return self.ring.seeded(motion, RULES.seed, 0)

    def go(self, start: float, step: float) -> None:
        """March from the solution at a frequency in steps (Hz) until the motion falls, or is past the tip and low."""
        own = self.levels.at(start)[0]
        here = self.visit(start, self.solution(start), own)
        if here.stays:
            self.on(here, step)
            return
        self.fall, at, has = start, f"at {start:.6g} Hz, beside the peak,", f"where the balance has {amount(own, 'm')}"
        falls = f"{at} a blade comes to {amount(here.mean, 'm')} in time {has}: use more harmonics"
        gains = f"{at} the march grows to {amount(here.mean, 'm')} {has}, an error of its steps and no motion"
        self.astray = falls if here.mean <= RULES.grown * own else f"{gains}: use more steps_per_period"

    def on(self, here: Place, step: float) -> None:
        """Follow a motion that stays in steps (Hz) until it falls, or is past the tip and low."""
        tip, ends = self.levels.frequency[self.levels.top], self.levels.frequency
        while here.stays:
            self.places.append(here)
            beyond = (here.frequency - tip) * np.sign(step) > 0.0
            highest, following = max(p.mean for p in self.places), here.frequency + step
            over = here.mean < RULES.lower * highest or (here.mean < highest and self.levels.alone(here, step))
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
        """Start from the solution at the tip if no place is as high, and go on (step in Hz) if its motion stays higher.

        A motion that falls on the way to the tip does not show that none stays there.
        """
        frequency, own = (float(x[self.levels.top]) for x in (self.levels.frequency, self.levels.amplitude))
        highest = max((p.mean for p in self.places), default=0.0)
        if highest >= (1.0 - RULES.settled) * own:
            return
        limit = (1.0 + RULES.drift) * highest
        march = March(self.ring, TWO_PI * frequency, self.solution(frequency), self.steps)
        march.run(RULES.stretched(march.memory).brief)
        self.periods += len(march.harmonics)
        if second_half(march.amplitude).mean() <= limit:
            return
        here = self.visit(frequency, march.motion, own, limit=limit)
        if here.stays:
            self.below, self.fall, self.astray = highest, float("nan"), ""
            self.on(here, step)
            self.refine()

    def refine(self) -> None:
        """Add places around the highest one, between it and its neighbours, from its motion with disturbances."""
        fallen: list[float] = []
        motion: Motion | None = None
        first = self.places[0].frequency if self.places else 0.0
        while len(self.places) > 1:
            top = max(self.places, key=lambda p: p.mean)
            gaps = [f - top.frequency for f in self.beside(top.frequency) if f not in fallen]
            gap = max(gaps, key=abs, default=0.0)
            if abs(gap) <= 1.5 * RULES.fine * top.frequency:
                break
            motion = self.ring.seeded(top.motion, RULES.seed, 0) if motion is None else top.motion
            here = self.follow(top._replace(motion=motion), top.frequency + 0.5 * gap)
            if here.stays:
                self.places.append(here)
            else:
                fallen.append(top.frequency + gap)
            if here.drift and abs(here.mean / top.mean - 1.0) <= 2.0 * RULES.scatter:
                break  # it beats, by more than places so near differ
        self.places.sort(key=lambda p: abs(p.frequency - first))  # along the way

    def beside(self, frequency: float) -> list[float]:
        """The next places to both sides of a frequency (Hz), as far as there are any."""
        f = np.array([p.frequency for p in self.places])
        return [*map(float, (*np.sort(f[f > frequency])[:1], *np.sort(f[f < frequency])[-1:]))]

    def follow(self, last: Place, frequency: float) -> Place:
        """From one place to the next, where the motion is expected to change as the curve does, by a quarter at most.

        The frequency goes there over a few periods: at once it would throw off a motion that a slow sweep keeps.
        """
        now, then = (float(max(self.levels.at(f), default=last.mean)) for f in (frequency, last.frequency))
        own = last.mean * float(np.clip(now / then, 0.8, 1.25))
        march = March(self.ring, TWO_PI * last.frequency, last.motion, self.steps)
        march.sweep((march.omega, TWO_PI * frequency), RULES.stretched(march.memory).brief, lambda: None)
        self.periods += len(march.harmonics)
        return self.visit(frequency, march.motion, own)._replace(origin=last.frequency)

    def best(self) -> Place | None:
        """The highest motion that stays in steps of half the length, too; it falls where the next one does not.

        Places are marched again as long as they could be higher: beside a fall the shorter steps took 7 % off the first.
        """
        fallen: list[float] = []
        best: Place | None = None
        for place in sorted(self.places, key=lambda p: -p.mean):
            if best is not None and place.mean <= (1.0 + RULES.drift) * best.mean:
                break
            found = self.visit(place.frequency, place.motion._replace(a=None), place.mean, finer=2)
            if not found.stays:
                fallen.append(place.frequency)
            elif best is None or found.mean > best.mean:
                best = found._replace(origin=place.origin)
                self.answers = {f"{2 * self.steps} steps": best.mean}
        if best is not None:
            at, way = best.frequency, self.places[-1].frequency - self.places[0].frequency
            self.fall = min((f for f in fallen if (f - at) * way > 0.0), key=lambda f: abs(f - at), default=self.fall)
        return best

    def finer(self, best: Place) -> float:
        """Mean amplitude (m) at a place with 4n steps.

        It is that of a few periods if these scatter little and, with all that a transient may still change, differ from
        that with 2n by less than answers may; otherwise that of two windows after them.
        """
        march = March(self.ring, TWO_PI * best.frequency, best.motion._replace(a=None), 4 * self.steps)
        rules = RULES.stretched(march.memory)
        march.run(rules.brief)
        before, last = (float(half.mean()) for half in np.array_split(march.amplitude, 2))
        mean, scatter = 0.5 * (before + last), float(march.amplitude.std())
        left = float(np.exp(-0.5 * rules.brief / march.memory))  # of a transient, from one half to the next
        apart = abs(mean / best.mean - 1.0) + abs(last / before - 1.0) * left / (1.0 - left)
        if scatter > rules.scatter * mean or apart > rules.settled:
            march.run(rules.brief + 2 * rules.window)
            mean = float(march.amplitude[-2 * rules.window :].mean())
        self.periods += len(march.harmonics)
        return mean

    def others(self, best: Place, starts: int) -> None:
        """Answers at the highest place with 4n steps, from its neighbour on the other side, and from other starts."""
        self.answers[f"{4 * self.steps} steps"] = self.finer(best)
        sides = [f for f in self.beside(best.frequency) if (f - best.frequency) * (best.origin - best.frequency) < 0.0]
        for side, last in ((p.frequency, p) for p in self.places if p.frequency in sides):
            here = self.follow(last, best.frequency)
            if here.stays and abs(here.mean / best.mean - 1.0) > 0.5 * RULES.settled:  # it may still be on its way
                here = self.visit(best.frequency, here.motion, here.mean, long=True)
            if here.stays:
                self.answers[f"from {side:.5g} Hz"] = here.mean
        tractions = self.ring.tractions(best.motion)
        for k in range(1, starts):
            name = list(tractions)[(k - 1) % len(tractions)]
            motion = self.ring.seeded(best.motion._replace(w=tractions[name]), RULES.seed, k)
            self.answers[f"start {k}, {name}"] = self.visit(best.frequency, motion, best.mean, long=True).mean

    def open_end(self, best: Place) -> str:
        """What says that a higher motion may be kept; "" if nothing does."""
        if abs(best.drift) > RULES.drift:
            return f"its mean still changes by {100.0 * best.drift:+.2g} % within {len(best.amplitude) // 2} periods"
        if self.fall != self.fall and best.frequency == self.places[-1].frequency:
            return "it is the last before the end of the curve; follow more of it"
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
    """The highest amplitude in time at the preload of a response curve.

    Amplitudes are those of the highest blade (:mod:`bdamper.time_domain.steady_amplitude`).

    Parameters
    ----------
    problem : Problem
    curve : ResponseCurve
        Tracked with this problem, from one flank of the resonance to the other.
    steps_per_period : int, optional
        256 by default; the highest motion is marched again with twice as many.
    blades : int, optional
        Of the ring: by default as many as the engine order tells apart.  More have more nodal diameters and patterns.
    starts : int
        Motions from which the highest one is marched: its own, and others with disturbances of their own (their numbers are
        the seeds of the phases) and friction that begins without traction, or at its limit either way.

    Returns
    -------
    TimeResponse
        "not found" where no motion stays or a march fails; "incomplete" where answers differ, the mean still drifts or the
        curve ends before the motion falls; after Ctrl-C the highest motion so far that stays.

    Raises
    ------
    SettingError
        If the curve has no peak, or the settings describe something else than a structure in time.
    """
    starts = validation.integer("starts", starts, least=1)
    check_curve(problem, curve)
    if curve.peak_at_end:
        raise SettingError(f"march: expected a curve with a peak, found its highest amplitude at its end, {curve.peak}")
    watch, levels, top = CostMeter(), Levels(curve), curve.peak
    sides = [levels.side(sign) for sign in (1.0, -1.0)]
    found = TimeResponse(*(top.amplitude,) * 3, top.frequency, curve.preload, top.amplitude, **problem.recorded())
    part = "" if curve.complete else f"there may be a higher peak, as the curve is {curve.status}"
    none = replace(found, mean=np.nan, lowest=np.nan, highest=np.nan, frequency=np.nan)
    ways = [side for side in sides if np.isfinite(side[1])]
    if not ways:
        return replace(none, status=with_reason(NOT_FOUND, "the branch is alone nowhere beside its tip; follow more of it"))
    step, start = min(ways, key=lambda side: abs(side[1] - top.frequency))
    ring = ring_of(problem, curve.preload, blades)
    walk, best = Walk(ring, levels, STEPS if steps_per_period is None else steps_per_period), None
    with LongWork() as work:
        try:
            walk.go(start, -step / 4.0)
            walk.refine()
            walk.from_tip(-step / 4.0)
            best = walk.best()
            if best is not None:
                walk.others(best, starts)
        except MarchFailed as error:
            walk.places, walk.astray = [], str(error)
    if work.interrupted and best is None:
        best = max(walk.places, key=lambda p: p.mean, default=None)
    none = replace(none, periods=walk.periods, diameters=ring.nodal_diameters, cost=watch.read(ring.cost))
    none = replace(none, direction="up" if step < 0.0 else "down", fall=walk.fall, answers=walk.answers)
    return _found(none, walk, best, part, work.interrupted)


def _found(none: TimeResponse, walk: Walk, best: Place | None, part: str, interrupted: bool) -> TimeResponse:
    """The result of a walk, from one without amplitudes; ``part`` says what the curve leaves open."""
    left = walk.astray or (walk.open_end(best) or part if best is not None else "")
    if best is None:
        why = left or "no motion stays in steps of half the length: use more steps_per_period"
        status = INTERRUPTED if interrupted else with_reason(NOT_FOUND, why)
        return replace(none, direction="", fall=np.nan, answers={}, status=status)
    around = best.amplitude
    if best.march is not None:  # of a brief visit all but its first periods
        rules = RULES.stretched(best.march.memory)
        around = best.march.amplitude[rules.brief :][-2 * rules.window :]
    answers = np.array([*walk.answers.values()])
    if len(answers) and np.ptp(answers) > RULES.settled * answers.min():
        ends = span(float(answers.min()), float(answers.max()), "m")
        left = f"not settled: {ends}{f'; {left}' if left else ''}"
        around = np.append(around, answers)
    carried, all_ = len(walk.ring.nodal_diameters), walk.ring.n // 2 + 1
    short = f"{carried} of {all_} nodal diameters were marched" if carried < all_ else ""
    other = f"comes to {amount(walk.below, 'm')}" if walk.below else "falls"
    tip = f"started at the peak of the balance; along the curve the motion {other}" if best.mean > walk.below else ""
    said = "; ".join(filter(None, (tip, short)))
    found = replace(
        none, mean=best.mean, lowest=float(around.min()), highest=float(around.max()), frequency=best.frequency,
        status=INTERRUPTED if interrupted else with_reason(INCOMPLETE, left) if left else with_reason(COMPLETE, said),
    )  # fmt: skip
    return found if best.march is None else replace(found, **of_blades(best.march, len(best.amplitude)))


def of_blades(march: March, periods: int) -> dict[str, Any]:
    """What a result says of all blades in the last periods of a march."""
    blades, rules = march.blades[-periods:], RULES.stretched(march.memory)
    window = min(rules.window, len(march.harmonics) // 2)
    ratio = growth(march, window)[0] if window >= rules.brief else 0.0
    return {
        "blade": march.blade, "blades": np.abs(blades), "waves": march.ring.waves(blades),
        "energy": tuple(float(x) for x in np.mean(march.energy[-periods:], axis=0)),
        "growth": float(np.log(ratio)) / window if ratio else float("nan"),
    }  # fmt: skip
