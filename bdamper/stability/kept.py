"""What a blade keeps: a march in time that walks along the upper branch toward its tip until the motion falls.

A peak of the harmonic balance says where a periodic solution is highest, and not whether a motion stays there.  Where
contacts open, or where a fold is near, it often does not: motions beat, and fall to a lower level before the tip or beyond
it.  So a march starts beside the tip, where no lower solution exists at the same frequency, and goes toward it in quarters
of the half width of the resonance, each step from the motion before.  After each step the motion *stays* if the mean of its
last periods is nearer to this branch than to the next lower solution and does not drift.  Where it falls the last step is
halved twice.  The highest mean of the motions that stay is what a blade keeps; it is marched again in steps of half the
length, since coarse steps damp beats.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import takewhile
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_NORMAL
from bdamper.continuation.curve import Curve
from bdamper.continuation.track import check_curve
from bdamper.problem.problem import Problem, matching
from bdamper.stability.disturbances import TWO_PI
from bdamper.stability.march import March
from bdamper.stability.time_integration import STEPS, Motion, Ring, ring_of
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, Stopwatch
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.kept import Kept
from bdamper.util.progress import LongWork
from bdamper.util.status import COMPLETE, INCOMPLETE, INTERRUPTED, NOT_FOUND, because
from bdamper.util.text import amount


@dataclass(frozen=True)
class Rules:
    """What tells a motion that stays.

    Parameters
    ----------
    window : int
        Periods over which a mean is taken: beats leave 2 to 3 % of scatter in means of 20.
    fewest, most : int
        Periods at a frequency at which there is a lower solution to fall to, two windows elsewhere; and those after which a
        mean that still drifts is taken as it is.
    drift : float
        Relative change between two means above which a motion has not settled.
    lower : float
        Another solution below this part of the amplitude is another level, and no ripple of the branch.
    drop, grown : float
        Part of the amplitude that was expected below which a motion has fallen, be there a lower solution or none, and
        above which it has grown: 23 times where residual modes had masses of rounding.
    apart : float
        From the tip, relative to its frequency, at least, where a response so flat that it has no half width is begun with.
    near : float
        Relative distance from its branch within which a motion beyond the tip goes on along it.
    memory, stretch : float
        Periods in which a transient falls to 1/e from which on all numbers of periods grow with it, and how far at most:
        within a part of a transient no mean is one of the motion that is to come.
    """

    window: int = 40
    fewest: int = 120
    most: int = 400
    drift: float = 0.03
    lower: float = 0.9
    drop: float = 0.7
    grown: float = 4.0
    apart: float = 0.01
    near: float = 0.1
    memory: float = 100.0
    stretch: float = 4.0

    def stretched(self, memory: float) -> Rules:
        """With the periods that a memory takes."""
        factor = min(max(1.0, memory / self.memory), self.stretch)
        window, fewest, most = (2 * round(0.5 * factor * n) for n in (self.window, self.fewest, self.most))
        return replace(self, window=window, fewest=fewest, most=most)


RULES = Rules()


class Place(NamedTuple):
    """What was found at one frequency (Hz): amplitudes (m) of the last periods, whether the motion stays, where it is, and
    the relative change between its last two means."""

    frequency: float
    amplitude: NDArray
    stays: bool
    motion: Motion
    drift: float = 0.0

    @property
    def mean(self) -> float:
        return float(self.amplitude.mean())


def stay(march: March, own: float, limit: float, alone: bool = False, long: bool = False) -> Place:
    """March until a motion near the level ``own`` (m) stays or has fallen below a limit.

    Parameters
    ----------
    march : March
        At its start.
    own, limit : float, m
    alone : bool
        Whether it is known that there is no lower solution to fall to.
    long : bool
        Whether amplitudes are those of the last two windows, not of one.
    """
    rules, drift = RULES.stretched(march.memory), np.inf
    most = RULES.grown * own
    while True:
        march.run(len(march.harmonics) + rules.window // 2)
        n, amplitude = len(march.harmonics), march.amplitude
        if march.overflowed:
            break
        if n < 2 * rules.window:
            continue
        last, before = (
            float(amplitude[-rules.window :].mean()),
            float(amplitude[-2 * rules.window : -rules.window].mean()),
        )
        drift = last / before - 1.0
        gone = (last < limit and before < limit) or (last > most and before > most)
        if gone or n >= rules.most or ((n >= rules.fewest or alone) and abs(drift) <= rules.drift):
            break
    kept = amplitude[-(2 if long else 1) * rules.window :]
    return Place(march.omega / TWO_PI, kept, bool(limit <= kept.mean() <= most), march.motion, drift)


class Levels:
    """The amplitudes (m) of a tracking curve over frequency, branches that close on themselves aside."""

    def __init__(self, curve: Curve) -> None:
        points = np.flatnonzero(~np.isin(curve.branch, curve.closed))
        self.frequency, self.amplitude, self.branch, self.unknowns = (
            np.asarray(x)[points] for x in (curve.frequency, curve.amplitude, curve.branch, curve.unknowns)
        )
        self.top = int(np.argmax(self.amplitude))

    def at(self, frequency: float) -> NDArray:
        """All solutions at a frequency, the highest first."""
        f, a = self.frequency - frequency, self.amplitude
        across = np.flatnonzero((f[:-1] * f[1:] <= 0.0) & (f[:-1] != f[1:]) & (np.diff(self.branch) == 0))
        share = f[across] / (f[across] - f[across + 1])
        return np.sort(a[across] + share * (a[across + 1] - a[across]))[::-1]

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
    """

    def __init__(self, ring: Ring, levels: Levels, steps: int) -> None:
        self.ring, self.levels, self.steps = ring, levels, steps
        self.places: list[Place] = []
        self.fall = float("nan")
        self.astray = ""
        self.periods = 0

    def visit(self, frequency: float, start: NDArray | Motion, own: float, finer: int = 1) -> Place:
        """March at one frequency until a motion near the level ``own`` (m) stays or has fallen."""
        march = March(self.ring, TWO_PI * frequency, start, finer * self.steps)
        lower = self.levels.lower(frequency, own)
        place = stay(march, own, max(0.5 * (own + lower) if lower else 0.0, RULES.drop * own), not lower, finer > 1)
        self.periods += len(march.harmonics)
        return place

    def go(self, start: float, step: float) -> None:
        """From the solution at a frequency in steps (Hz) until the motion falls, or is past the tip and low."""
        own, tip, ends = self.levels.at(start)[0], self.levels.frequency[self.levels.top], self.levels.frequency
        here = self.visit(start, self.levels.start(start), own)
        if not here.stays:
            at, has = f"at {start:.6g} Hz, beside the peak,", f"where the balance has {amount(own, 'm')}"
            falls = f"{at} a blade comes to {amount(here.mean, 'm')} in time {has}: use more harmonics"
            to = f"to {amount(here.mean, 'm')}" if np.isfinite(here.mean) else "without bound"
            gains = f"{at} the march grows {to} {has}, an error of its steps and no motion: use more steps_per_period"
            self.astray = falls if here.mean <= RULES.grown * own else gains
        while here.stays:
            self.places.append(here)
            beyond = (here.frequency - tip) * np.sign(step) > 0.0
            highest, following = max(p.mean for p in self.places), here.frequency + step
            over = here.mean < RULES.lower * highest or (here.mean < highest and self.levels.alone(here, step))
            if (beyond and over) or not ends.min() <= following <= ends.max():
                return
            here = self.follow(here, following)
        self.fall = here.frequency
        for _ in range(2 * bool(self.places)):
            last = self.places[-1]
            here = self.follow(last, 0.5 * (last.frequency + self.fall))
            if here.stays:
                self.places.append(here)
            else:
                self.fall = here.frequency

    def follow(self, last: Place, frequency: float) -> Place:
        """From one place to the next, where the motion is expected to change as the curve does, by a quarter at most.

        The frequency goes there over one window: at once it would throw off a motion that a slow sweep keeps.
        """
        now, then = (float(max(self.levels.at(f), default=last.mean)) for f in (frequency, last.frequency))
        own = last.mean * float(np.clip(now / then, 0.8, 1.25))
        march = March(self.ring, TWO_PI * last.frequency, last.motion, self.steps)
        try:
            march.sweep((march.omega, TWO_PI * frequency), RULES.stretched(march.memory).window, lambda: None)
        except BdamperError:  # it grew without bound on the way
            return Place(float(frequency), np.array([np.nan]), False, march.motion, np.inf)
        self.periods += len(march.harmonics)
        return self.visit(frequency, march.motion, own)

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
                best = found
        if best is not None:
            at, way = best.frequency, self.places[-1].frequency - self.places[0].frequency
            self.fall = min((f for f in fallen if (f - at) * way > 0.0), key=lambda f: abs(f - at), default=self.fall)
        return best

    def open_end(self, best: Place) -> str:
        """What says that a higher motion may be kept; "" if nothing does."""
        if self.ring.unsolved:
            return self.ring.unsolved
        if abs(best.drift) > RULES.drift:
            return f"its mean still changes by {100.0 * best.drift:+.2g} % within {len(best.amplitude) // 2} periods"
        if self.fall != self.fall and best.frequency == self.places[-1].frequency:
            return "it is the last before the end of the curve; follow more of it"
        return ""


@one_thread
def kept(problem: Problem, curve: Curve, *, steps_per_period: int | None = None) -> Kept:
    """The highest amplitude that a blade keeps at the preload of a tracking curve.

    All sectors that the engine order tells apart are marched, with all nodal diameters that the model carries, whatever
    the harmonics of the study (:mod:`bdamper.stability.kept`).  Where contacts stay closed and no fold lies within a half
    width of the peak nothing is marched: the peak is kept.

    Parameters
    ----------
    problem : Problem
    curve : Curve
        Tracked with this problem, from one flank of the resonance to the other.
    steps_per_period : int, optional
        256 by default; what is kept is marched again with twice as many.

    Returns
    -------
    Kept
        After Ctrl-C the highest motion so far that stays; "not found" where none does; "incomplete" where its mean still
        drifts, contact forces were not found in some steps, the curve is so itself or ends before the motion falls.

    Raises
    ------
    SettingError
        If the curve has no peak, or the settings describe something else than a structure in time.
    """
    problem = matching(problem, validate.instance("curve", curve, Curve, "a tracking curve").settings)
    check_curve(problem, curve)
    if curve.peak_at_end:
        raise SettingError(f"kept: expected a curve with a peak, found its highest amplitude at its end, {curve.peak}")
    watch, levels, top = Stopwatch(), Levels(curve), curve.peak
    sides = [levels.side(sign) for sign in (1.0, -1.0)]
    width = max((abs(w) for w, _ in sides if np.isfinite(w)), default=np.inf)
    near = np.abs(curve.frequency - top.frequency) <= width
    found = Kept(
        *(top.amplitude,) * 3, top.frequency, curve.preload, top.amplitude, settings=problem.record(),
        model_hash=problem.model.hash,
    )  # fmt: skip
    part = "" if curve.complete else f"there may be a higher peak, as the curve is {curve.status}"
    if not _opens(problem, curve, near) and not any(near[f.index] for f in curve.folds):
        return replace(found, status=because(INCOMPLETE, part) if part else COMPLETE, cost=Cost(**watch.read()))
    none = replace(found, mean=np.nan, lowest=np.nan, highest=np.nan, frequency=np.nan)
    ways = [side for side in sides if np.isfinite(side[1])]
    if not ways:
        return replace(none, status=because(NOT_FOUND, "the branch is alone nowhere beside its tip; follow more of it"))
    step, start = min(ways, key=lambda side: abs(side[1] - top.frequency))
    ring = ring_of(problem, curve.preload)
    walk, best = Walk(ring, levels, STEPS if steps_per_period is None else steps_per_period), None
    with LongWork() as work:
        walk.go(start, -step / 4.0)
        best = walk.best()
    if work.interrupted and best is None:
        best = max(walk.places, key=lambda p: p.mean, default=None)
    carried, all_ = len(ring.nodal_diameters), ring.n // 2 + 1
    short = f"{carried} of {all_} nodal diameters were marched" if carried < all_ else ""
    left = (walk.open_end(best) or part) if best is not None else ring.unsolved or walk.astray
    cost = replace(ring.cost, **watch.read())
    none = replace(none, periods=walk.periods, diameters=ring.nodal_diameters, cost=cost)
    if best is None:
        why = left or "no motion stays in steps of half the length: use more steps_per_period"
        return replace(none, status=INTERRUPTED if work.interrupted else because(NOT_FOUND, why))
    return replace(
        none, mean=best.mean, lowest=float(best.amplitude.min()), highest=float(best.amplitude.max()), fall=walk.fall,
        frequency=best.frequency, direction="up" if step < 0.0 else "down",
        status=INTERRUPTED if work.interrupted else because(INCOMPLETE, left) if left else because(COMPLETE, short),
    )  # fmt: skip


def _opens(problem: Problem, curve: Curve, near: NDArray) -> bool:
    """Whether a contact is open for a part of the cycle at one of some points, one without friction, too."""
    if (np.asarray(curve.shares)[near, 2] > 0.0).any():
        return True
    system = problem.system(curve.preload)
    if not (np.asarray(system.points.law) == LAW_NORMAL).any():
        return False
    shares = (system.contact(u)[2][:, 4] for u in np.asarray(curve.unknowns)[near])
    return any(((open_ > 0.0) & (open_ < 1.0)).any() for open_ in shares)
