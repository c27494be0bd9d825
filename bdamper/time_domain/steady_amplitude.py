"""Search for the highest steady amplitude in time near a resonance.

The peak of the harmonic balance is the highest periodic solution of its equations, but a motion need not stay there, and
another may be higher.  The search therefore follows motions in time, from two places:

* **from the flank**, at a frequency next to the resonance with one solution, in a slow sweep towards the tip and beyond;
* **from the tip**, with the solution of the harmonic balance.  Its motion settles, unless it leaves the tip at once.  If it
  is more than 5 % higher than the sweep there, it is also followed by sweeps in both directions.

A sweep is continuous: the frequency changes by the half width of the resonance in a given number of periods.  The motion is
stored at equal numbers of periods (:class:`Place`).  A sweep ends if the amplitude remains below a fraction of its highest
value, for example after a jump.  The criteria are
in :class:`bdamper.time_domain.transient.SteadyCriteria`.

**Settled points.**  The stored motion of highest amplitude is disturbed by waves of every nodal diameter, because the
amplitudes of the blades have no time to diverge in a sweep, and settles at its frequency
(``bdamper.time_domain.transient.settle``).  If its amplitude falls to another level, an earlier motion of the sweep is
tried, in growing steps.  From the settled motion the frequency changes slowly to other points, until the highest one is
known: if the motion falls on one side, the interval is halved; between two lower points a parabola through three points
gives the maximum.  The highest motion continues until the amplitudes of the blades do not diverge further.
"""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.response.continuation import TWO_PI
from bdamper.response.response_curve_result import ResponseCurve, crossed
from bdamper.time_domain.integration import Motion, Ring, transfer
from bdamper.time_domain.transient import CRITERIA, SteadyPoint, Transient, settle
from bdamper.util.formatting import amount

APART = 0.01
"""Smallest distance of the flank from the tip, relative to the frequency, if the half width is unknown."""


class BalanceCurve:
    """Amplitudes (m) of a response curve over frequency, without closed branches and separate branches above its peak."""

    def __init__(self, curve: ResponseCurve) -> None:
        points = np.flatnonzero(~curve.out_of_reach)
        self.frequency, self.amplitude, self.branch, self.unknowns = (
            np.asarray(x)[points]
            for x in (curve.frequency, curve.amplitude, curve.branch, curve.unknowns)
        )
        self.top = int(np.argmax(self.amplitude))
        self.sides = {sign: self._side(sign) for sign in (1.0, -1.0)}

    @property
    def tip(self) -> float:
        """Frequency of the highest point, Hz."""
        return float(self.frequency[self.top])

    def at(self, frequency: float) -> NDArray:
        """Return the amplitudes of all solutions at a frequency, in descending order."""
        return np.sort(
            crossed(self.frequency, self.amplitude, frequency, np.diff(self.branch) == 0)[1]
        )[::-1]

    def solution(self, frequency: float) -> NDArray:
        """Return the unknowns of the highest solution closest to a frequency, of any solution in a gap of the curve."""
        high = np.flatnonzero(self.amplitude >= CRITERIA.low * max(self.at(frequency), default=0.0))
        return np.asarray(self.unknowns[high[np.abs(self.frequency[high] - frequency).argmin()]])

    @property
    def half_width(self) -> float:
        """Half width of the resonance, Hz: the smaller one of the two sides."""
        return float(np.nanmin(np.abs([width for width, _ in self.sides.values()])))

    @property
    def flank(self) -> float:
        """Frequency (Hz) nearest to the tip, beyond half of the half width, with one solution; NaN if there is none."""
        flanks = [flank for _, flank in self.sides.values() if np.isfinite(flank)]
        return min(flanks, key=lambda f: abs(f - self.tip), default=float("nan"))

    def _side(self, sign: float) -> tuple[float, float]:
        """Return the signed half width (Hz) on one side of the tip, and the first frequency beyond half of it with one
        solution.

        A value is NaN if the branch ends before it.  If the response does not decrease to half its power, the width is
        twice the distance to that frequency.
        """
        tip, height = self.tip, self.amplitude[self.top]
        end = float(self.frequency.max() if sign > 0.0 else self.frequency.min())
        width, before = np.nan, height
        for f in np.linspace(tip, end, 400)[1:-1]:
            expected = float(max(self.at(f), default=0.0))
            if expected < CRITERIA.jump * before:
                return width, np.nan
            before = expected
            if expected <= height / np.sqrt(2.0):
                width = f - tip
                break
        apart = sign * APART * tip if np.isnan(width) else 0.5 * width
        away = (
            np.linspace(tip + apart, end, 400)[:-1] if abs(end - tip) > abs(apart) else np.zeros(0)
        )
        alone = (x for x in away if len(a := self.at(x)) and a[-1] >= CRITERIA.low * a[0])
        start = float(next(alone, np.nan))
        return 2.0 * (start - tip) if np.isnan(width) else width, start


class Place(NamedTuple):
    """Motion at one instant of a sweep: frequency (Hz), mean amplitude (m) of the last periods, and state."""

    frequency: float
    mean: float
    motion: Motion


def _top(places: list[Place]) -> int:
    """Return the index of the place with the highest amplitude."""
    return int(np.argmax([p.mean for p in places]))


class SteadySearch:
    """Search for the highest steady amplitude in time (:mod:`bdamper.time_domain.steady_amplitude`).

    Parameters
    ----------
    ring : Ring
        All sectors of the structure in time.
    source : Ring
        All sectors of the structure of the response curve.
    balance : BalanceCurve
    steps : int
        Time steps per period.

    Attributes
    ----------
    points : list of SteadyPoint
        Steady motions.
    fell : list of float, Hz
        Frequencies at which a motion did not stay near the expected amplitude.
    below : float, m
        Highest amplitude of the sweep from the flank if the sweep from the tip is higher, otherwise NaN.
    periods : int
        Total number of periods.
    failure : str
        Reason if no motion stays.
    on_frequency : callable
        Called with every frequency (Hz) of a motion.
    """

    def __init__(self, ring: Ring, source: Ring, balance: BalanceCurve, steps: int) -> None:
        self.ring, self.source, self.balance, self.steps = ring, source, balance, steps
        self.points: list[SteadyPoint] = []
        self.fell: list[float] = []
        self.below = float("nan")
        self.periods = 0
        self._counting = Lock()
        self.failure = ""
        self.on_frequency: Callable[[float], None] = lambda frequency: None
        self.pace = balance.half_width / CRITERIA.pace  # Hz in a period
        self.ends = float(balance.frequency.min()), float(balance.frequency.max())

    @property
    def best(self) -> SteadyPoint | None:
        """Highest steady motion so far."""
        return max(self.points, key=lambda p: p.mean, default=None)

    @property
    def fall(self) -> float:
        """Frequency (Hz) closest to the highest motion at which it does not stay; NaN if there is none.

        Frequencies beyond a motion of a lower level do not count.
        """
        best = self.best
        if best is None:
            return min(self.fell, key=lambda f: abs(f - self.balance.tip), default=float("nan"))
        other = [
            f for f in self.fell if any(p.mean < CRITERIA.low * best.mean for p in self.between(f))
        ]
        return min(
            set(self.fell) - set(other), key=lambda f: abs(f - best.frequency), default=float("nan")
        )

    def between(self, fall: float) -> list[SteadyPoint]:
        """Return the steady motions at frequencies between the highest motion and ``fall`` (Hz), excluding ``fall``."""
        best = self.best
        side = (
            p
            for p in self.points
            if best is not None and (p.frequency - fall) * (best.frequency - p.frequency) > 0.0
        )
        return [p for p in side if abs(p.frequency - fall) > CRITERIA.fine * fall]

    def run(self) -> None:
        """Search from the flank and from the tip."""
        flank, tip = self.balance.flank, self.balance.tip
        way = float(np.sign(tip - flank))
        sweeps = [self.sweep(self.start(flank), flank, way)]
        if _top(sweeps[0]) <= 1:  # the motion is higher on the other side
            sweeps.append(self.sweep(sweeps[0][0].motion, flank, -way))
        along = max(place.mean for places in sweeps for place in places)
        nearest = min(
            (place for places in sweeps for place in places),
            key=lambda place: abs(place.frequency - tip),
        )
        here = Transient(self.ring, TWO_PI * tip, self.start(tip), self.steps)
        here.advance(CRITERIA.fewest)
        self.periods += CRITERIA.fewest
        start = Place(tip, float(here.amplitude[-CRITERIA.stride :].mean()), here.motion)
        higher = 1.0 + CRITERIA.tolerance
        from_tip = [
            self.sweep(start.motion, tip, sign)
            for sign in (1.0, -1.0)
            if start.mean > higher * nearest.mean
        ]
        ordered = sorted((*sweeps, *from_tip), key=lambda places: -places[_top(places)].mean)
        for parting in (
            False,
            True,
        ):  # if no steady motion lasts, the second time each has to last at once
            for places in ordered:
                best = self.best
                if best is None or places[_top(places)].mean > higher * best.mean:
                    self.settle_back(places, parting)
                    if self.best is not best:
                        self.below = along if any(places is way for way in from_tip) else np.nan
            self._settle_tip(start, along, way, parting)
            parted: list[SteadyPoint] = []
            while (best := self.best) is not None and best not in parted:
                self.points.remove(best)
                parted.append(
                    self.settle(best.frequency, best.transient.motion, best.mean, parting=True)
                )
            if self.points:
                return

    def _settle_tip(self, start: Place, along: float, way: float, parting: bool) -> None:
        """Settle the motion from the tip, and search around it if it is the highest one.

        ``along`` is the highest amplitude (m) of the sweep from the flank.  A sweep at a distance of up to the tolerance
        of 5 % below the tip would otherwise hide a motion that is higher than the stated range.
        """
        best = self.best
        if best is not None and start.mean < CRITERIA.jump * best.mean:
            return  # the motion has left the tip within the first periods
        motion = self.ring.seeded(start.motion, CRITERIA.seed, 0)
        point = self.settle_apart(self.ring, start.frequency, motion, start.mean, parting=parting)
        # the tip may belong to another level than the sweep, so its fall says nothing about the motion of the sweep
        if not point.stays or (best is not None and point.mean <= best.mean):
            return
        self.points.append(point)
        self.failure = ""
        if point.mean > (1.0 + CRITERIA.drift) * along:
            self.below = along
        self.look_around(point, way or 1.0)

    def start(self, frequency: float) -> Motion:
        """Return the highest solution of the balance closest to a frequency, with disturbances of all blades."""
        motion = self.source.start(self.balance.solution(frequency), TWO_PI * frequency, self.steps)
        return self.ring.seeded(transfer(self.source, motion, self.ring), CRITERIA.seed, 0)

    def sweep(self, motion: Motion, frequency: float, way: float) -> list[Place]:
        """Sweep slowly from a frequency (Hz), upward if ``way`` is 1 or downward if it is -1; return the stored motions."""
        here = Transient(self.ring, TWO_PI * frequency, motion, self.steps)
        here.advance(CRITERIA.fewest)
        places = [Place(frequency, float(here.amplitude[-CRITERIA.stride :].mean()), here.motion)]
        while True:
            self.on_frequency(frequency)
            frequency += way * CRITERIA.stride * self.pace
            latest, top = places[-CRITERIA.low_places :], max(p.mean for p in places)
            if (
                all(p.mean < CRITERIA.low * top for p in latest)
                or not self.ends[0] <= frequency <= self.ends[1]
            ):
                self.periods += CRITERIA.fewest + CRITERIA.stride * (len(places) - 1)
                return places
            here = Transient(self.ring, here.omega, here.motion, self.steps)
            here.sweep(TWO_PI * frequency, CRITERIA.stride)
            places.append(Place(frequency, float(here.amplitude.mean()), here.motion))

    def settle_back(self, places: list[Place], parting: bool = False) -> None:
        """Settle at the highest place of a sweep, or at an earlier place if the motion does not stay; search around it.

        ``parting`` is passed to :func:`bdamper.time_domain.transient.settle`.
        """
        k, back = _top(places), 1
        if not self.points:
            self.fell.clear()  # they belong to another motion
        while k >= 0:
            place = places[k]
            motion = self.ring.seeded(place.motion, CRITERIA.seed, 0)
            point = self.settle(place.frequency, motion, place.mean, parting=parting)
            if point.stays:
                self.failure = ""
                self.look_around(
                    point, float(np.sign(places[-1].frequency - places[0].frequency)) or 1.0
                )
                return
            k, back = (k - back if k > back else k - 1), 2 * back
        if not self.points:
            solution = amount(max(self.balance.at(place.frequency), default=np.nan), "m")
            self.failure = (
                f"at {place.frequency:.6g} Hz, near the peak, harmonic balance gives {solution}, but the amplitude in time "
                f"becomes {amount(point.mean, 'm')}"
            )

    def settle(
        self, frequency: float, motion: Motion, expected: float, parting: bool = False
    ) -> SteadyPoint:
        """Integrate a motion at a frequency (Hz) until it settles near the amplitude ``expected`` (m), or falls.

        The result is added to ``points``, or its frequency to ``fell``.
        """
        point = self.settle_apart(self.ring, frequency, motion, expected, parting=parting)
        if point.stays:
            self.points.append(point)
        else:
            self.fell.append(frequency)
        return point

    def settle_apart(
        self,
        ring: Ring,
        frequency: float,
        motion: Motion,
        expected: float,
        step_factor: int = 1,
        parting: bool = False,
    ) -> SteadyPoint:
        """Integrate as :meth:`settle` does, in any structure and with more time steps, without keeping the result."""
        self.on_frequency(frequency)
        transient = Transient(ring, TWO_PI * frequency, motion, step_factor * self.steps)
        point = settle(transient, expected, parting)
        # refinements settle on several threads
        with self._counting:
            self.periods += len(transient.harmonics)
        return point

    def at_end(self, point: SteadyPoint) -> bool:
        """Return whether a point is at an end of the curve, and the motion stays up to there."""
        near = min(abs(end - point.frequency) for end in self.ends)
        return self.fall != self.fall and near < 0.25 * self.balance.half_width

    def follow(self, point: SteadyPoint, frequency: float) -> SteadyPoint:
        """Change the frequency of a steady motion slowly, and settle there."""
        moving = Transient(self.ring, point.transient.omega, point.transient.motion, self.steps)
        periods = max(CRITERIA.stride, round(abs(frequency - point.frequency) / self.pace))
        moving.sweep(TWO_PI * frequency, periods)
        self.periods += periods
        return self.settle(frequency, moving.motion, point.mean)

    def look_around(self, best: SteadyPoint, way: float) -> None:
        """Settle around a steady motion until the highest one is known, beginning on the side ``way`` (1 or -1)."""
        for _ in range(CRITERIA.most_points):
            frequency = self._next(best, way)
            if frequency is None:
                return
            self.follow(best, frequency)
            best = max(self.points, key=lambda p: p.mean)

    def _next(self, best: SteadyPoint, way: float) -> float | None:
        """Return the next frequency (Hz) to settle at, or None if the highest motion is known."""
        f, step, near = (
            best.frequency,
            0.25 * self.balance.half_width,
            CRITERIA.fine * best.frequency,
        )
        sides: list[SteadyPoint] = []
        for sign in (way, -way):
            steady = min(
                (p for p in self.points if (p.frequency - f) * sign > 0.0),
                key=lambda p: abs(p.frequency - f),
                default=None,
            )
            gap = abs(steady.frequency - f) if steady else np.inf
            fall = min((abs(x - f) for x in self.fell if (x - f) * sign > 0.0), default=np.inf)
            if fall < gap:
                if fall > near:
                    return f + 0.5 * sign * fall
            elif steady is not None:
                sides.append(steady)
            elif self.ends[0] <= f + sign * step <= self.ends[1]:
                return f + sign * step
        if len(sides) < 2:
            return None
        (a, b), (ma, mb) = (p.frequency - f for p in sides), (p.mean - best.mean for p in sides)
        curvature, slope, _ = np.polyfit([a, 0.0, b], [ma, 0.0, mb], 2)
        at = -0.5 * float(slope / curvature) if curvature < 0.0 else 0.0
        rises = slope * at + curvature * at * at > max(CRITERIA.drift, abs(best.change)) * best.mean
        return f + at if rises and abs(at) > 0.5 * min(near, step) else None
