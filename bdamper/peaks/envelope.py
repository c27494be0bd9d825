"""All resonance peaks over a range of preloads, and the preload at which the highest of them is least.

The peak is followed down from the highest preload, where the contact is nearly stuck and the response nearly linear.
Several peaks can exist at one preload, and a followed one need not stay the highest.  So the response over frequency is
followed (:mod:`bdamper.peaks.scan`) at both ends of the range, next to where a peak has ended, and wherever the highest
peak does not come from that at the neighbouring preload; every peak that such a scan finds is followed both ways.  A scan
starts at the highest peak that is known there, or at the ends of the interval.

The highest peak over the preload is the envelope of all branches of peaks.  Its least value (:func:`least_peak`) is a root
of the adjoint sensitivity where the envelope is smooth there, the point of equal height where two peaks cross, or the
place of the jump where a higher peak vanishes; the preload is found to a relative 1e-7.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.track import find_start
from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.peaks.follower import PeakFollower
from bdamper.peaks.newton import Peak, PeakOptions, same_peak
from bdamper.peaks.optimal_curve import OptimumPoint
from bdamper.peaks.scan import FROM_ENDS, Scan, scan, scan_from
from bdamper.peaks.sensitivity import amplitude_sensitivity
from bdamper.problem.problem import Problem
from bdamper.util.cost import CostMeter
from bdamper.util.errors import BdamperError, SettingError, StaticError
from bdamper.util.rootfind import find_root

SIGNIFICANT = 0.5
"""Peaks below this share of the highest one at the same preload are not followed; a branch ends below half of it."""
FOLLOWED = 4
"""Peaks of one scan that are followed at most, the highest ones."""
KEPT = 64
"""Equations of different preloads that are kept."""
OPTIMUM_TOLERANCE = 1e-7
"""Relative, on the preload of the optimum."""
FLAT = 1e-6
"""Relative range of the resonance amplitude over all preloads below which the curve has no optimum."""
NEAR = 0.95
"""Branches below this share of the highest peak at both ends of a bracket are evaluated only once, at the optimum found."""


@dataclass
class Branch:
    """Peaks of one branch, continuous in the preload.

    Parameters
    ----------
    number : int
    peaks : dict of int to Peak
        By the index of the preload.
    isolated : set of int
        Indices at which the peak does not lie on the response curve that a sweep of frequency follows.
    joined : dict of int to int
        Number of the branch that this one joins, by the index where it does.
    down, up : str
        How the branch ended toward lower and higher preloads.
    """

    number: int
    peaks: dict[int, Peak]
    isolated: set[int] = field(default_factory=set)
    joined: dict[int, int] = field(default_factory=dict)
    down: str = ""
    up: str = ""


class PeakEnvelope:
    """All peaks known at each preload, by branches.

    Parameters
    ----------
    problem : Problem
    preload : (n,) float, N
        Increasing.
    frequency : (low, high), Hz
        Where to look for peaks.
    options : PeakOptions
    meter : CostMeter
    """

    def __init__(
        self, problem: Problem, preload: NDArray, frequency: tuple[float, float], options: PeakOptions, meter: CostMeter
    ) -> None:
        self.problem = problem
        self.preload = preload
        self.frequency = frequency
        # beyond the interval, so that a peak that leaves it and comes back is not lost
        self.limits = (0.5 * frequency[0], 1.5 * frequency[1])
        self.options = options
        self.meter = meter
        self.branches: list[Branch] = []
        self.scanned: dict[int, str] = {}
        self.events: list[str] = []
        self.systems: dict[float, HarmonicSystem] = {}

    def family(self, preload: float) -> HarmonicSystem:
        """The equations at a preload."""
        system = self.systems.get(preload)
        if system is None:
            system = self.problem.system(preload)
            self.meter.watch(system)
            if len(self.systems) > KEPT:
                self.systems.pop(next(iter(self.systems)))
            self.systems[preload] = system
        return system

    def at(self, k: int) -> list[tuple[Branch, Peak]]:
        """Peaks known at a preload, highest first."""
        found = [(b, b.peaks[k]) for b in self.branches if k in b.peaks]
        return sorted(found, key=lambda item: -item[1].amplitude)

    def highest(self, k: int) -> tuple[Branch, Peak] | None:
        """The highest peak within the interval that is not known to be isolated, and its branch."""
        return next(((b, q) for b, q in self.at(k) if k not in b.isolated and self.within(q)), None)

    def within(self, peak: Peak) -> bool:
        """Whether a peak lies in the interval of frequency; a branch is followed beyond it, since it may come back."""
        return self.frequency[0] <= peak.frequency <= self.frequency[1]

    def scan(self, k: int) -> None:
        """Follow the response over frequency at a preload, and every new peak that is found to both sides."""
        if k in self.scanned:
            return
        p = float(self.preload[k])
        state = self.problem.static(p)
        if not state.converged:
            self.scanned[k] = f"not made: static state: {state.note}"
            self.events.append(f"{p:.6g} N: static state: {state.note}")
            return
        found = self.look(k, p)
        peaks, ending = found.peaks, found.ending
        self.scanned[k] = ending
        known = self.at(k)
        new = [q for q in peaks if not any(same_peak(q, other) for _, other in known)]
        if ending == "complete":
            for b, q in known:
                if not any(same_peak(q, other) for other in peaks) and not found.passes(q, self.family(p).n_mean):
                    b.isolated.add(k)
                    self.events.append(
                        f"{p:.6g} N: peak of branch {b.number}, {q.amplitude:.6g} m at {q.frequency:.6g} Hz, is not "
                        "connected to the response curve that a sweep of frequency follows"
                    )
        self.events.append(
            f"{p:.6g} N: scan over frequency ({ending}) found {len(peaks)} peaks, {len(new)} of them new"
        )
        top = max([q.amplitude for q in peaks], default=0.0)
        for q in new[:FOLLOWED]:
            if q.amplitude < SIGNIFICANT * top:
                continue
            branch = Branch(len(self.branches), {k: q})
            self.branches.append(branch)
            self.follow(branch, k, -1)
            self.follow(branch, k, +1)

    def look(self, k: int, preload: float) -> Scan:
        """The response over frequency, from the highest peak known at this preload if there is one."""
        system = self.family(preload)
        item = self.highest(k)
        start = None if item is None else item[1].y
        if start is None:
            low = 2.0 * np.pi * self.frequency[0]
            start, _ = find_start(self.problem, preload, low, FROM_ENDS, self.meter)
        if start is not None:
            found = scan_from(
                self.problem, system, start, self.frequency, preload=preload, options=self.options, meter=self.meter,
                share=0.5 * SIGNIFICANT,
            )  # fmt: skip
            if found.ending == "complete":
                return found
        return scan(
            self.problem, preload, self.frequency, options=self.options, continuation=FROM_ENDS, meter=self.meter
        )

    def follow(self, branch: Branch, k: int, step: int) -> None:
        """Follow a branch from preload to preload until it ends or meets another one."""
        follower = PeakFollower(self.family, branch.peaks[k], self.options, self.limits)
        ended = ""
        while True:
            k += step
            if not 0 <= k < len(self.preload):
                break
            peak = follower.go(float(self.preload[k]))
            if peak is None:
                at = follower.known[-1]
                ended = f"{follower.status} at {at.parameter:.6g} N, {at.frequency:.6g} Hz ({follower.reason})"
                self.events.append(f"peak branch {branch.number} {ended}")
                break
            met = next((b for b, q in self.at(k) if b is not branch and same_peak(q, peak)), None)
            if met is not None:
                ended = f"joins branch {met.number} at {self.preload[k]:.6g} N"
                branch.joined[k] = met.number
                break
            branch.peaks[k] = peak
            highest = self.highest(k)
            top = highest[1].amplitude if highest is not None else peak.amplitude
            if peak.amplitude < 0.5 * SIGNIFICANT * top:
                ended = "no longer significant"
                break
        self.meter.iterations += follower.iterations
        if step < 0:
            branch.down = ended
        else:
            branch.up = ended

    def find_all(self, checks: int) -> None:
        """Find peaks at all preloads, with scans at the ends of the range, at some preloads between, and where needed."""
        n = len(self.preload)
        for k in [n - 1, *(int(i) for i in np.round(np.linspace(0, n - 1, checks + 2))[1:-1])]:
            self.scan(k)
        for _ in range(2 * n):
            todo = self.without_peak()
            if todo is None:
                todo = 0 if 0 not in self.scanned else self.beside_tangle()
            if todo is None:
                todo = self.suspicious()
            if todo is None:
                break
            self.scan(todo)
        for k in range(n - 1):
            self.note_change(k)

    def note_change(self, k: int) -> None:
        """Note an event if the highest peaks at a preload and at the next one are of different branches."""
        a, b = self.highest(k), self.highest(k + 1)
        if a is None or b is None or a[0] is b[0]:
            return
        if a[0].joined.get(k + 1) == b[0].number or b[0].joined.get(k) == a[0].number:
            return
        smooth = k + 1 in a[0].peaks and k in b[0].peaks
        what = "another peak becomes the highest" if smooth else "jump to another peak"
        self.events.append(
            f"between {self.preload[k]:.6g} and {self.preload[k + 1]:.6g} N: {what}, from {a[1].amplitude:.6g} m at "
            f"{a[1].frequency:.6g} Hz to {b[1].amplitude:.6g} m at {b[1].frequency:.6g} Hz"
        )

    def without_peak(self) -> int | None:
        """The highest preload without a peak.

        The one beside it is taken first, where a scan is cheap, and the low end of the range, which is scanned in any case:
        a branch found there may reach up to it.
        """
        for k in reversed(range(len(self.preload))):
            if self.highest(k) is None and k not in self.scanned:
                beside = [j for j in (k + 1, k - 1) if 0 <= j < len(self.preload) and self.highest(j) is not None]
                first = [*beside, 0] if self.highest(0) is None else beside
                return next((j for j in first if j not in self.scanned), k)
        return None

    def beside_tangle(self) -> int | None:
        """A preload beside one whose scan ended in a tangle of folds: the curve may be simpler there."""
        for k, ending in self.scanned.items():
            beside = [j for j in (k + 1, k - 1) if 0 <= j < len(self.preload)]
            if "tangle" in ending and not any(j in self.scanned for j in beside):
                return beside[0]
        return None

    def suspicious(self) -> int | None:
        """A preload to which the highest peak of its neighbour does not reach, unless the highest there is still higher."""
        for k in range(len(self.preload) - 1):
            a, b = self.highest(k), self.highest(k + 1)
            for i, j, item in ((k, k + 1, a), (k + 1, k, b)):
                if item is not None and j in item[0].isolated and i not in self.scanned:
                    return i
            if a is None or b is None or a[0] is b[0]:
                continue
            for j, one, other in ((k + 1, a, b), (k, b, a)):
                there = one[0].peaks.get(j)
                ended = (there is None or not self.within(there)) and one[1].amplitude >= other[1].amplitude
                if ended and j not in self.scanned:
                    return j
        return None


class _Place(NamedTuple):
    """Highest peak at one preload: ln(preload), number of the branch, the peak and d ln(amplitude)/d ln(preload)."""

    x: float
    branch: int
    peak: Peak
    slope: float


class _Minimum:
    """The search for the least value of the envelope."""

    def __init__(self, known: PeakEnvelope) -> None:
        self.known = known
        self.options = replace(known.options, position_tolerance=min(known.options.position_tolerance, 1e-8))
        self.cache: dict[float, list[tuple[int, Peak]]] = {}

    def at(self, x: float, every: bool = False) -> _Place:
        """Highest peak at a preload of exp(x) newtons, with ``every`` also of branches that are low at both neighbours."""
        p = float(np.exp(x))
        if every or x not in self.cache:
            grid = np.log(self.known.preload)
            k = int(np.clip(np.searchsorted(grid, x), 1, len(grid) - 1))
            places = next(((i,) for i in (k - 1, k) if abs(grid[i] - x) < 1e-13), (k - 1, k))
            found = []
            for branch in self.known.branches:
                if branch.isolated.intersection(places):
                    continue
                near = [branch.peaks[i] for i in places if i in branch.peaks]
                near += [q for list_ in self.cache.values() for number, q in list_ if number == branch.number]
                if not near or not (every or self.is_high(branch, places)):
                    continue
                near.sort(key=lambda q: -abs(np.log(q.parameter) - x))
                exact = abs(np.log(near[-1].parameter) - x) < 1e-13
                peak = near[-1] if exact else self.followed(near, p)
                if peak is not None and self.known.within(peak):
                    found.append((branch.number, peak))
            if not found:
                raise ArithmeticError(f"no peak found at {p:.8g} N")
            self.cache[x] = sorted(found, key=lambda item: -item[1].amplitude)
        number, peak = self.cache[x][0]
        slope = amplitude_sensitivity(peak, self.known.family, p, self.options) * p / peak.amplitude
        return _Place(x, number, peak, slope)

    def is_high(self, branch: Branch, places: tuple[int, ...]) -> bool:
        """Whether a branch comes near the highest peak at one of two neighbouring preloads."""
        for k in places:
            top = self.known.highest(k)
            if k in branch.peaks and top is not None and branch.peaks[k].amplitude >= NEAR * top[1].amplitude:
                return True
        return False

    def followed(self, near: list[Peak], p: float) -> Peak | None:
        """The peak of a branch at a preload, followed from the nearest ones known; None if it does not get there."""
        distinct = {q.parameter: q for q in near}
        follower = PeakFollower(self.known.family, list(distinct.values())[-3:], self.options, self.known.limits)
        peak = follower.go(p)
        self.known.meter.iterations += follower.iterations
        return peak

    def continues(self, near: _Place, far: _Place) -> bool:
        """Whether two places have the same peak on top, which branches of different scans may both hold."""
        there = self.cache[far.x]
        return any(number == near.branch and same_peak(peak, far.peak) for number, peak in there)

    def between(self, near: _Place, far: _Place) -> OptimumPoint:
        """Least value of the envelope between two places: it falls from ``near`` toward ``far``, which is not lower."""
        sense = np.sign(far.x - near.x)
        start, length = near.x, abs(far.x - near.x)

        def slope(t: float) -> float:
            nonlocal near, far
            place = self.at(start + sense * t)
            falls = place.slope * sense < 0.0 and place.peak.amplitude <= near.peak.amplitude * (1.0 + 1e-12)
            if falls:
                near = place
            else:
                far = place
            return -abs(place.slope) if falls else abs(place.slope)

        ends = (0.0, -abs(near.slope)), (length, abs(far.slope))
        root = find_root(slope, *ends, OPTIMUM_TOLERANCE)
        meeting = far.slope * sense >= 0.0  # the envelope also falls from far toward near
        kind = "jump" if not meeting else ("smooth" if self.continues(near, far) else "crossing")
        best = near
        if kind == "smooth":
            best = min(near, far, key=lambda place: abs(place.slope))
        elif far.peak.amplitude < near.peak.amplitude:
            best = far
        if kind != "jump" and self.at(best.x, every=True).peak.amplitude > best.peak.amplitude * (1.0 + 1e-9):
            raise ArithmeticError("another peak is higher there")
        ok = "converged" if root.step <= 10.0 * OPTIMUM_TOLERANCE else "bracket not narrowed further"
        return OptimumPoint(best.peak.parameter, best.peak.amplitude, best.peak.frequency, kind, root.step, ok)


def least_peak(known: PeakEnvelope) -> OptimumPoint:
    """The preload at which the highest peak is least.

    Parameters
    ----------
    known : PeakEnvelope
        Peaks at all its preloads.

    Raises
    ------
    BdamperError
        If there is no peak at any preload.
    """
    n = len(known.preload)
    highest = [known.highest(k) for k in range(n)]
    height = np.array([item[1].amplitude if item else np.inf for item in highest])
    found = height[np.isfinite(height)]
    if not len(found):
        low, high = known.frequency
        endings = ", ".join(dict.fromkeys(known.scanned.values())) or "not made"
        raise BdamperError(
            f"no peak found at any of {n} preloads from {known.preload[0]:g} to {known.preload[-1]:g} N "
            f"between {low:.6g} and {high:.6g} Hz; scans over frequency: {endings}"
        )
    k = int(np.argmin(height))
    best = highest[k][1]  # type: ignore[index]
    if len(found) > 1 and found.max() <= (1.0 + FLAT) * found.min():
        return OptimumPoint(np.nan, best.amplitude, best.frequency, "flat", np.inf, "the preload does not matter")
    x = np.log(known.preload)
    search = _Minimum(known)
    try:
        near = search.at(float(x[k]))
        side = -1 if near.slope > 0.0 else 1
        if not 0 <= k + side < n:
            return OptimumPoint(best.parameter, best.amplitude, best.frequency, "end", 0.0)
        if not np.isfinite(height[k + side]):
            width = float(abs(x[k + side] - x[k]))
            why = f"the amplitude falls toward {known.preload[k + side]:.6g} N, where no peak was found"
            return OptimumPoint(best.parameter, best.amplitude, best.frequency, "end", width, why)
        return search.between(near, search.at(float(x[k + side])))
    except (ArithmeticError, SettingError, StaticError) as error:
        width = float(np.max(np.abs(np.diff(x))))
        return OptimumPoint(best.parameter, best.amplitude, best.frequency, "smooth", width, str(error))
