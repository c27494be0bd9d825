"""Search for the highest steady amplitude by time integration near a resonance.

The harmonic-balance peak is the highest periodic solution of the harmonic balance equations, but a
motion need not stay there, and another motion may be higher.  The search follows motions by time
integration from two places:

* **from the peak**, starting with the harmonic-balance solution.  The motion settles, unless it
  leaves the peak at once, and the search continues at frequencies next to the peak.
* **from the flank**, a frequency next to the resonance at which there is only one solution, in a
  slow sweep through the frequency of the peak and beyond.  If the motion from the peak is more than
  5 % higher than the sweep at this frequency, it is also followed by sweeps in both directions.

Sweeps follow if the motion from the peak does not stay or settles far below the peak.  They also
follow if the curve has several solutions near its peak, because another branch may be higher.  On
three imported sectors without such solutions they found no motion that is higher by
more than 0.6 %, and took nine tenths of the time.

A sweep is continuous: the frequency changes by the half-width of the resonance in the number of
periods in which a transient decays to 1/e, or a given number if that is larger.  The motion is
stored at equal numbers of periods (:class:`Place`).  A sweep ends if the amplitude remains below a
fraction of its highest value, for example after a jump.  The criteria are in
:class:`bdamper.time_domain.transient.SteadyCriteria`.

**Settled points.**  The stored motion of highest amplitude is disturbed by waves of every nodal
diameter, because the amplitudes of the blades have no time to diverge in a sweep, and settles at
its frequency (``bdamper.time_domain.transient.settle``).  If its amplitude falls to another level,
an earlier motion of the sweep is tried, in growing steps.  From the settled motion the frequency
changes slowly to other points, until the highest one is known: if the motion falls on one side, the
interval is halved; between two lower points a parabola through three points gives the maximum.  The
highest motion continues until the amplitudes of the blades do not diverge further.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.response.continuation import TWO_PI
from bdamper.response.response_curve_result import ResponseCurve, crossed
from bdamper.time_domain.integration import AllSectors, Motion, TimeSpent, extended
from bdamper.time_domain.transient import (
    CRITERIA,
    SteadyPoint,
    Transient,
    second_half,
    settle,
    unsettled,
)
from bdamper.util.formatting import amount

APART = 0.01
"""Smallest distance of the flank from the peak, relative to the frequency, if the half-width is
unknown.
"""


class BalanceCurve:
    """Amplitudes (m) of a response curve as a function of frequency, without closed branches and
    without separate branches above its peak.
    """

    def __init__(self, curve: ResponseCurve) -> None:
        points = np.flatnonzero(~curve.out_of_reach)
        self.frequency = np.asarray(curve.frequency)[points]
        self.amplitude = np.asarray(curve.amplitude)[points]
        self.branch = np.asarray(curve.branch)[points]
        self.unknowns = np.asarray(curve.unknowns)[points]
        self.top = int(np.argmax(self.amplitude))
        self.sides = {sign: self._side(sign) for sign in (1.0, -1.0)}

    @property
    def tip(self) -> float:
        """Frequency of the peak, Hz."""
        return float(self.frequency[self.top])

    def at(self, frequency: float) -> NDArray:
        """Return the amplitudes of all solutions at a frequency, in descending order."""
        same_branch = np.diff(self.branch) == 0
        _, amplitudes = crossed(self.frequency, self.amplitude, frequency, same_branch)
        return np.sort(amplitudes)[::-1]

    def branches_near_tip(self) -> bool:
        """Return whether there are several solutions at a frequency near the peak.

        Near is within :attr:`SteadyCriteria.near` half-widths.  Solutions of nearly the same
        amplitude count as one.
        """
        reach = CRITERIA.near * self.half_width
        for frequency in np.linspace(self.tip - reach, self.tip + reach, 201):
            descending = self.at(frequency)
            if len(descending) > 1 and descending[-1] < CRITERIA.low * descending[0]:
                return True
        return False

    def solution(self, frequency: float) -> NDArray:
        """Return the unknowns of the highest solution at the point closest to a frequency (Hz).

        In a gap of the curve, it is the closest solution of any amplitude.
        """
        # in a gap of the curve the level is 0, so that all points count
        highest = max(self.at(frequency), default=0.0)
        high_points = np.flatnonzero(self.amplitude >= CRITERIA.low * highest)
        distance = np.abs(self.frequency[high_points] - frequency)
        return np.asarray(self.unknowns[high_points[distance.argmin()]])

    @property
    def half_width(self) -> float:
        """Half-width of the resonance at half power, Hz: the smaller of the two sides."""
        # a width is NaN if the branch ends on its side
        signed_widths = [width for width, _ in self.sides.values()]
        return float(np.nanmin(np.abs(signed_widths)))

    @property
    def flank(self) -> float:
        """Frequency (Hz) with only one solution, more than half a half-width away from the peak."""
        flanks = [flank for _, flank in self.sides.values() if np.isfinite(flank)]
        return min(flanks, key=lambda f: abs(f - self.tip), default=float("nan"))

    def _side(self, sign: float) -> tuple[float, float]:
        """Return the signed half-width (Hz) on one side of the peak, and a frequency there.

        The frequency is the first one, beyond half of this width, at which there is only one
        solution.  If the response does not decrease to half its power, the width is twice the
        distance from the peak to this frequency.  Both values are NaN if the branch ends earlier.
        """
        tip = self.tip
        height = self.amplitude[self.top]
        end = float(self.frequency.max() if sign > 0.0 else self.frequency.min())
        width = np.nan
        amplitude_before = height
        between = np.linspace(tip, end, 400)[1:-1]
        for frequency in between:
            amplitude = float(max(self.at(frequency), default=0.0))
            # a fold: the branch of the tip has ended, and the solution is another one
            if amplitude < CRITERIA.jump * amplitude_before:
                return width, np.nan
            amplitude_before = amplitude
            if amplitude <= height / np.sqrt(2.0):
                width = frequency - tip
                break
        has_half_power = not np.isnan(width)
        apart = 0.5 * width if has_half_power else sign * APART * tip
        if abs(end - tip) <= abs(apart):
            # the curve ends before the frequency with one solution
            return width, np.nan
        alone = self._first_alone(tip + apart, end)
        if not has_half_power:
            width = 2.0 * (alone - tip)
        return width, alone

    def _first_alone(self, nearest: float, end: float) -> float:
        """Return the first frequency (Hz) from ``nearest`` towards ``end`` with one solution, or
        NaN.
        """
        for frequency in np.linspace(nearest, end, 400)[:-1]:
            descending = self.at(frequency)
            if not len(descending):
                continue
            # solutions of nearly the same amplitude count as one
            highest = descending[0]
            lowest = descending[-1]
            if lowest >= CRITERIA.low * highest:
                return float(frequency)
        return float("nan")


class Place(NamedTuple):
    """Motion at one instant of a sweep: frequency (Hz), mean amplitude (m) of the last periods, and
    state.
    """

    frequency: float
    mean: float
    motion: Motion


def _latest_place(frequency: float, transient: Transient) -> Place:
    """Return the last motion at a constant frequency (Hz), with the mean of the last periods."""
    latest = transient.amplitude[-CRITERIA.stride :]
    return Place(frequency, float(latest.mean()), transient.motion)


def _top(places: list[Place]) -> int:
    """Return the index of the place with the highest amplitude."""
    return int(np.argmax([place.mean for place in places]))


def _highest(places: list[Place]) -> float:
    """Return the highest amplitude (m) of a sweep."""
    return places[_top(places)].mean


class SteadySearch:
    """Search for the highest steady amplitude by time integration
    (:mod:`bdamper.time_domain.steady_amplitude`).

    Parameters
    ----------
    sectors : AllSectors
        All sectors of the structure in time.
    source : AllSectors
        All sectors of the structure of the response curve.
    balance : BalanceCurve
    steps : int
        Time steps per period.

    Attributes
    ----------
    points : list of SteadyPoint
        Steady motions.
    parted : list of SteadyPoint
        Steady motions in which the amplitudes of the blades no longer diverge.
    fell : list of float, Hz
        Frequencies at which a motion did not stay near the expected amplitude.
    unsettled : SteadyPoint or None
        Motion that was interrupted before it settled, if no other motion is known.
    below : float, m
        Highest amplitude of the sweep from the flank if the sweep from the peak is higher,
        otherwise NaN.
    periods : int
        Total number of periods.
    failure : str
        Reason why no motion stays.
    on_frequency : callable
        Called with every frequency (Hz) of a motion.
    """

    def __init__(
        self, sectors: AllSectors, source: AllSectors, balance: BalanceCurve, steps: int
    ) -> None:
        self.sectors = sectors
        self.source = source
        self.balance = balance
        self.steps = steps
        self.points: list[SteadyPoint] = []
        self.parted: list[SteadyPoint] = []
        self.fell: list[float] = []
        self.unsettled: SteadyPoint | None = None
        self.below = float("nan")
        self.periods = 0
        self._counting = Lock()
        self.failure = ""
        self.on_frequency: Callable[[float], None] = lambda frequency: None
        # largest change of the frequency, Hz per period
        self.pace = balance.half_width / CRITERIA.pace
        # lowest and highest frequency of the curve, Hz
        self.ends = float(balance.frequency.min()), float(balance.frequency.max())

    @property
    def best(self) -> SteadyPoint | None:
        """Highest steady motion so far; of those whose blades had time to diverge, if there are
        any.

        Without a steady motion it is the one that was interrupted before it settled, or None.
        """
        steady = self.parted or self.points
        return max(steady, key=lambda point: point.mean, default=self.unsettled)

    @property
    def seconds_per_period(self) -> float:
        """Mean processor time (s) of a period so far; 0 before the first one."""
        if self.periods == 0:
            return 0.0
        return self.sectors.cost.time_integration / self.periods

    @staticmethod
    def blades_part(point: SteadyPoint) -> bool:
        """Return whether the blades of a motion differ by more than the tolerance."""
        of_blades = np.abs(second_half(point.transient.blades)).mean(axis=0)
        return bool(of_blades.max() > (1.0 + CRITERIA.tolerance) * of_blades.min())

    @property
    def fall(self) -> float:
        """Frequency (Hz) closest to the highest motion at which the motion jumps to another level.

        It is NaN if there is none.  Frequencies beyond a motion of a lower level do not count.
        """
        best = self.best
        if best is None:
            return min(self.fell, key=lambda f: abs(f - self.balance.tip), default=float("nan"))
        beyond_lower_level = set()
        for frequency in self.fell:
            amplitudes = [point.mean for point in self.between(frequency)]
            if any(amplitude < CRITERIA.low * best.mean for amplitude in amplitudes):
                beyond_lower_level.add(frequency)
        own_falls = set(self.fell) - beyond_lower_level
        return min(own_falls, key=lambda f: abs(f - best.frequency), default=float("nan"))

    def between(self, fall: float) -> list[SteadyPoint]:
        """Return the steady motions between the frequency of the highest motion and ``fall`` (Hz).

        Motions at ``fall`` itself are excluded.
        """
        best = self.best
        if best is None:
            return []
        enclosed = []
        for point in self.points:
            # both differences have the same sign if the point lies between fall and best
            is_between = (point.frequency - fall) * (best.frequency - point.frequency) > 0.0
            apart = abs(point.frequency - fall) > CRITERIA.fine * fall
            if is_between and apart:
                enclosed.append(point)
        return enclosed

    def run(self) -> None:
        """Follow motions that start at the harmonic-balance peak, and on the flank if they can matter."""
        tip = self.balance.tip
        if self._contacts_chatter(tip):
            self.steps *= 2
        start = self._place_at_tip(tip)
        # otherwise the motion has left the peak within the first periods
        stays_at_first = start.mean >= CRITERIA.jump * self._height
        if stays_at_first:
            self._settle_tip(start)
            self._let_blades_diverge()
        if self.best is None or self._sweeps_can_matter(self.best):
            self._sweep_and_settle(start, tip_is_settled=stays_at_first)

    @property
    def _height(self) -> float:
        """Amplitude (m) of the harmonic-balance peak."""
        return float(max(self.balance.at(self.balance.tip)))

    def _sweeps_can_matter(self, from_tip: SteadyPoint) -> bool:
        """Return whether sweeps may find a motion that is higher than the one from the peak."""
        is_low = from_tip.mean < CRITERIA.confirmed * self._height
        return is_low or self.balance.branches_near_tip()

    def _sweep_and_settle(self, start: Place, tip_is_settled: bool) -> None:
        """Follow motions in sweeps from the flank, and from the tip if they are clearly higher there.

        ``start`` is the motion at the tip, with which the search has begun if ``tip_is_settled``.
        """
        # frequencies (Hz) with only one solution, and of the peak
        flank = self.balance.flank
        tip = self.balance.tip
        way = float(np.sign(tip - flank))  # 1 upward, -1 downward
        towards_tip = self.sweep(self.start(flank), flank, way)
        from_flank = [towards_tip]
        # highest at its start: the motion is higher on the other side of the flank
        if _top(towards_tip) <= 1:
            from_flank.append(self.sweep(towards_tip[0].motion, flank, -way))
        highest_from_flank = max(_highest(places) for places in from_flank)

        # sweeps from the peak, if the motion there is clearly higher than the sweep from the flank
        swept = list(itertools.chain(*from_flank))
        nearest = min(swept, key=lambda place: abs(place.frequency - tip))
        higher = 1.0 + CRITERIA.tolerance
        from_tip = []
        if start.mean > higher * nearest.mean:
            from_tip = [self.sweep(start.motion, tip, sign) for sign in (1.0, -1.0)]

        settled = self.best
        if settled is not None and settled.mean > (1.0 + CRITERIA.drift) * highest_from_flank:
            self.below = highest_from_flank
        highest_first = sorted([*from_flank, *from_tip], key=lambda places: -_highest(places))
        # if no steady motion lasts, the second time each has to last at once
        for parting in (False, True):
            for places in highest_first:
                best = self.best
                may_be_higher = best is None or _highest(places) > higher * best.mean
                if not may_be_higher:
                    continue
                self.settle_back(places, parting)
                if self.best is not best:
                    began_at_tip = any(places is sweep for sweep in from_tip)
                    self.below = highest_from_flank if began_at_tip else np.nan
            if parting or not tip_is_settled:
                self._settle_tip(start, highest_from_flank, parting)
            self._let_blades_diverge()
            if self.points:
                return

    def _contacts_chatter(self, tip: float) -> bool:
        """Return whether a time step near the tip (Hz) needs many evaluations of the contact
        forces.

        Many points then change their state in each step.  Shorter steps need fewer evaluations, and
        the chatter ends earlier: imported sectors with light dampers took up to three times as long
        for a period with 256 steps as with 512.
        """
        transient = Transient(self.sectors, TWO_PI * tip, self.start(tip), self.steps)
        # the forces at the start belong to the model of the response curve
        transient.advance()
        before = self.sectors.effort
        transient.advance()
        steps, evaluations = self.sectors.effort - before
        self.periods += 2
        return bool(evaluations > CRITERIA.chatter * steps)

    def _place_at_tip(self, tip: float) -> Place:
        """Return the motion some periods after the solution at the tip (Hz)."""
        transient = Transient(self.sectors, TWO_PI * tip, self.start(tip), self.steps)
        transient.advance(CRITERIA.fewest)
        self.periods += CRITERIA.fewest
        return _latest_place(tip, transient)

    def _let_blades_diverge(self) -> None:
        """Continue the highest motion until the amplitudes of the blades do not diverge further.

        A motion that is higher afterwards by more than :attr:`SteadyCriteria.drift`, to which the
        means are known, continues in the same way.
        """
        while True:
            others = [point for point in self.points if point not in self.parted]
            highest = max(others, key=lambda point: point.mean, default=None)
            highest_parted = max((point.mean for point in self.parted), default=0.0)
            if highest is None or highest.mean <= (1.0 + CRITERIA.drift) * highest_parted:
                return
            motion = highest.transient.motion
            point = self.settle(highest.frequency, motion, highest.mean, parting=True)
            # after an interruption it remains the result so far
            self.points.remove(highest)
            if point.stays:
                self.parted.append(point)

    def _settle_tip(self, start: Place, along: float = float("nan"), parting: bool = False) -> None:
        """Settle the motion from the tip, and search around it if it is the highest one.

        ``along`` is the highest amplitude (m) of the sweep from the flank, NaN without one.  A sweep
        at a distance of up to the tolerance of 5 % below the tip would otherwise hide a motion that
        is higher than the stated range.
        """
        best = self.best
        # the motion has left the tip within the first periods
        if best is not None and start.mean < CRITERIA.jump * best.mean:
            return
        motion = self.sectors.seeded(start.motion, CRITERIA.seed, seed=0)
        point = self.settle_apart(
            self.sectors, start.frequency, motion, start.mean, parting=parting
        )
        # the tip may belong to another level than the sweep, so its fall says nothing about the
        # motion of the sweep
        if not point.stays:
            return
        if best is not None and point.mean <= best.mean:
            return
        self.points.append(point)
        self.failure = ""
        if point.mean > (1.0 + CRITERIA.drift) * along:
            self.below = along
        # begin in the direction from the flank; upward if the flank is the tip
        way = float(np.sign(self.balance.tip - self.balance.flank))
        self.look_around(point, way or 1.0)

    def start(self, frequency: float) -> Motion:
        """Return the highest solution of the balance closest to a frequency, with disturbances of
        all blades.
        """
        solution = self.balance.solution(frequency)
        solution = extended(self.source, solution, self.sectors)
        motion = self.sectors.start(solution, TWO_PI * frequency, self.steps)
        return self.sectors.seeded(motion, CRITERIA.seed, seed=0)

    def sweep(self, motion: Motion, frequency: float, way: float) -> list[Place]:
        """Sweep slowly from a frequency (Hz), upward if ``way`` is 1 or downward if it is -1;
        return the stored motions.
        """
        low, high = self.ends
        transient = Transient(self.sectors, TWO_PI * frequency, motion, self.steps)
        # a faster sweep would carry its past along
        periods_of_half_width = min(max(CRITERIA.pace, transient.memory), CRITERIA.most)
        pace = self.pace * CRITERIA.pace / periods_of_half_width
        transient.advance(CRITERIA.fewest)
        places = [_latest_place(frequency, transient)]
        while True:
            self.on_frequency(frequency)
            frequency += way * CRITERIA.stride * pace
            low_amplitude = CRITERIA.low * _highest(places)
            latest = places[-CRITERIA.low_places :]
            stays_low = all(place.mean < low_amplitude for place in latest)
            if stays_low or not low <= frequency <= high:
                self.periods += CRITERIA.fewest + CRITERIA.stride * (len(places) - 1)
                return places
            # a new integration has only the amplitudes of this part of the sweep
            transient = Transient(self.sectors, transient.omega, transient.motion, self.steps)
            transient.sweep(TWO_PI * frequency, CRITERIA.stride)
            places.append(Place(frequency, float(transient.amplitude.mean()), transient.motion))

    def settle_back(self, places: list[Place], parting: bool = False) -> None:
        """Settle at the highest place of a sweep, or at an earlier place if the motion does not
        stay; search around it.

        ``parting`` is passed to :func:`bdamper.time_domain.transient.settle`.
        """
        # earlier falls belong to another motion
        if not self.points:
            self.fell.clear()
        swept = places[-1].frequency - places[0].frequency
        # a sweep of one place has no direction: begin upward
        way = float(np.sign(swept)) or 1.0
        index = _top(places)
        back = 1
        while index >= 0:
            place = places[index]
            motion = self.sectors.seeded(place.motion, CRITERIA.seed, seed=0)
            point = self.settle(place.frequency, motion, place.mean, parting=parting)
            if point.stays:
                self.failure = ""
                self.look_around(point, way)
                return
            # in growing steps, or one by one where a step would pass the first place
            index -= back if index > back else 1
            back = 2 * back
        if not self.points:
            balance_amplitude = max(self.balance.at(place.frequency), default=np.nan)
            self.failure = (
                f"at {place.frequency:.6g} Hz, near the peak, harmonic balance gives "
                f"{amount(balance_amplitude, 'm')}, but the amplitude by time integration "
                f"becomes {amount(point.mean, 'm')}"
            )

    def settle(
        self, frequency: float, motion: Motion, expected: float, parting: bool = False
    ) -> SteadyPoint:
        """Integrate a motion at a frequency (Hz) until it settles near the amplitude ``expected``
        (m), or falls.

        The result is added to ``points``, or its frequency to ``fell``.
        """
        point = self.settle_apart(self.sectors, frequency, motion, expected, parting=parting)
        if point.stays:
            self.points.append(point)
        else:
            self.fell.append(frequency)
        return point

    def settle_apart(
        self,
        sectors: AllSectors,
        frequency: float,
        motion: Motion,
        expected: float,
        step_factor: int = 1,
        parting: bool = False,
    ) -> SteadyPoint:
        """Integrate as :meth:`settle` does, in any structure and with more time steps, without
        keeping the result.
        """
        self.on_frequency(frequency)
        transient = Transient(sectors, TWO_PI * frequency, motion, step_factor * self.steps)
        try:
            return settle(transient, expected, parting)
        except (TimeSpent, KeyboardInterrupt):
            if self.best is None:
                self.unsettled = unsettled(transient)
            raise
        finally:
            # refinements settle on several threads
            with self._counting:
                self.periods += len(transient.harmonics)

    def at_end(self, point: SteadyPoint) -> bool:
        """Return whether a point is at an end of the curve and the motion persists up to this end."""
        to_end = min(abs(end - point.frequency) for end in self.ends)
        no_fall = bool(np.isnan(self.fall))
        return no_fall and to_end < 0.25 * self.balance.half_width

    def follow(self, point: SteadyPoint, frequency: float) -> SteadyPoint:
        """Change the frequency of a steady motion slowly, and integrate there until the motion
        settles.
        """
        moving = Transient(self.sectors, point.transient.omega, point.transient.motion, self.steps)
        periods = max(CRITERIA.stride, round(abs(frequency - point.frequency) / self.pace))
        moving.sweep(TWO_PI * frequency, periods)
        self.periods += periods
        return self.settle(frequency, moving.motion, point.mean)

    def look_around(self, best: SteadyPoint, way: float) -> None:
        """Find steady motions at frequencies on both sides of the highest motion, until it is bounded.

        ``best`` is the first highest motion; a higher one that is found takes its place.  The
        search begins on the side ``way`` (1 or -1).
        """
        for _ in range(CRITERIA.most_points):
            frequency = self._next(best, way)
            if frequency is None:
                return
            self.follow(best, frequency)
            best = max(self.points, key=lambda point: point.mean)

    def _next(self, best: SteadyPoint, way: float) -> float | None:
        """Return the next frequency (Hz) to settle at, or None if the highest motion is known.

        A side of the highest motion is finished if a lower steady motion, a close fall or an end of
        the curve bounds it.  The side ``way`` (1 or -1) comes first.
        """
        low, high = self.ends
        step = 0.25 * self.balance.half_width
        smallest = CRITERIA.fine * best.frequency
        neighbours: list[SteadyPoint] = []
        for sign in (way, -way):
            neighbour = self._nearest_steady(best.frequency, sign)
            to_neighbour = abs(neighbour.frequency - best.frequency) if neighbour else np.inf
            to_fall = self._nearest_fall(best.frequency, sign)
            one_step_away = best.frequency + sign * step
            if to_fall < to_neighbour:
                # halve the interval in which the motion falls
                if to_fall > smallest:
                    return best.frequency + 0.5 * sign * to_fall
            elif neighbour is not None:
                neighbours.append(neighbour)
            elif low <= one_step_away <= high:
                return one_step_away
        # a jump to a lower amplitude, or an end of the curve, on one side
        if len(neighbours) < 2:
            return None
        first, second = neighbours
        return self._vertex(best, first, second, smallest=0.5 * min(smallest, step))

    def _nearest_steady(self, frequency: float, sign: float) -> SteadyPoint | None:
        """Return the steady motion nearest to a frequency (Hz) on one side of it."""
        on_side = [point for point in self.points if (point.frequency - frequency) * sign > 0.0]
        return min(on_side, key=lambda point: abs(point.frequency - frequency), default=None)

    def _nearest_fall(self, frequency: float, sign: float) -> float:
        """Return the distance (Hz) from a frequency to the nearest fall on one side, or
        infinity.
        """
        on_side = [fall for fall in self.fell if (fall - frequency) * sign > 0.0]
        return min((abs(fall - frequency) for fall in on_side), default=np.inf)

    def _vertex(
        self, best: SteadyPoint, first: SteadyPoint, second: SteadyPoint, smallest: float
    ) -> float | None:
        """Return the frequency (Hz) of the maximum of a parabola through three motions.

        None if it is within ``smallest`` (Hz) of the highest motion, or not higher than that motion
        by more than the uncertainty of the amplitudes.
        """
        # relative to the highest motion
        offsets = [first.frequency - best.frequency, 0.0, second.frequency - best.frequency]
        heights = [first.mean - best.mean, 0.0, second.mean - best.mean]
        curvature, slope, _ = np.polyfit(offsets, heights, 2)
        offset = -0.5 * float(slope / curvature) if curvature < 0.0 else 0.0
        rise = slope * offset + curvature * offset * offset
        uncertainty = max(CRITERIA.drift, abs(best.change)) * best.mean
        if rise > uncertainty and abs(offset) > smallest:
            return best.frequency + offset
        return None
