"""All resonance peaks over a range of preloads, followed from one preload to the next.

The peak is followed down from the highest preload, where the contact is nearly stuck and the response nearly linear.
Several peaks can exist at one preload, and a followed one need not stay the highest.  So the response over frequency is
followed (:mod:`bdamper.peaks.scan`) at both ends of the range, next to where a peak has ended, and wherever the highest
peak does not come from that at the neighbouring preload; every peak that such a scan finds is followed both ways.  A scan
sets off from the highest peak that is known there, or from points of the neighbouring curve, and from the ends of the
interval where neither leads through.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.system import HarmonicSystem
from bdamper.continuation.track import find_start
from bdamper.peaks.follower import PeakFollower
from bdamper.peaks.newton import Peak, PeakOptions, same_peak
from bdamper.peaks.scan import FROM_ENDS, Scan, scan, scan_from, solution_near
from bdamper.problem.problem import Problem
from bdamper.util.cost import CostMeter

SIGNIFICANT = 0.5
"""Peaks below this share of the highest one at the same preload are not followed."""
FOLLOWED = 4
"""Peaks of one scan that are followed at most, the highest ones."""
KEPT = 64
"""Equations of different preloads that are kept."""


@dataclass
class Branch:
    """Peaks of one branch by index of the preload, and the branches that it joins."""

    number: int
    peaks: dict[int, Peak]
    detached: set[int] = field(default_factory=set)
    joined: dict[int, int] = field(default_factory=dict)
    first_slope: NDArray | None = None
    down: str = ""
    up: str = ""


class PeakSet:
    """All peaks known at each preload, by branches that are continuous in the preload.

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
        self.points: dict[int, NDArray] = {}
        self.events: list[str] = []
        self.systems: dict[float, HarmonicSystem] = {}

    def family(self, preload: float) -> HarmonicSystem:
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

    def leader(self, k: int) -> tuple[Branch, Peak] | None:
        """The highest peak of the interval that is not known to be detached from the curve a sweep of frequency follows."""
        return next(((b, q) for b, q in self.at(k) if k not in b.detached and self.within(q)), None)

    def within(self, peak: Peak) -> bool:
        """Whether a peak counts; a branch is followed beyond the interval, from where it may come back."""
        return self.frequency[0] <= peak.frequency <= self.frequency[1]

    def scan(self, k: int) -> None:
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
        self.scanned[k], self.points[k] = ending, found.some
        known = self.at(k)
        new = [q for q in peaks if not any(same_peak(q, other) for _, other in known)]
        if ending == "complete":
            for b, q in known:
                if not any(same_peak(q, other) for other in peaks) and not found.passes(q, self.family(p).n_mean):
                    b.detached.add(k)
                    self.events.append(
                        f"{p:.6g} N: peak of branch {b.number}, {q.amplitude:.6g} m at {q.frequency:.6g} Hz, is detached "
                        "from the response curve that a sweep follows"
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
            self.pursue(branch, k, -1)
            self.pursue(branch, k, +1)

    def look(self, k: int, preload: float) -> Scan:
        """The response over frequency, from a solution that is known already if there is one."""
        system = self.family(preload)
        item = self.leader(k)
        start = None if item is None else item[1].y
        if start is None and self.points:
            nearest = min(self.points, key=lambda j: abs(j - k))
            start = solution_near(system, self.points[nearest], self.options, self.meter)
        if start is None:
            low = 2.0 * np.pi * self.frequency[0]
            start, _ = find_start(self.problem, preload, low, FROM_ENDS, self.meter)
        if start is not None:
            found = scan_from(
                self.problem, system, start, self.frequency, preload=preload, options=self.options, meter=self.meter,
                share=0.5 * SIGNIFICANT,
            )  # fmt: skip
            if found.ending == "complete" or "tangle" in found.ending:
                return found
        return scan(
            self.problem, preload, self.frequency, options=self.options, continuation=FROM_ENDS, meter=self.meter
        )

    def pursue(self, branch: Branch, k: int, step: int) -> None:
        """Follow a branch from preload to preload until it ends or meets another one."""
        history = [branch.peaks[i] for i in range(k - 3 * step, k + step, step) if i in branch.peaks]
        follower = PeakFollower(self.family, history, self.options, self.limits)
        follower.first_slope = branch.first_slope if len(history) == 1 else None
        ended = ""
        low = 0
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
            highest = self.leader(k)
            top = highest[1].amplitude if highest is not None else peak.amplitude
            low = low + 1 if peak.amplitude < SIGNIFICANT * top else 0
            if low >= 3 or peak.amplitude < 0.5 * SIGNIFICANT * top:
                ended = "no longer significant"
                break
        self.meter.iterations += follower.iterations
        if len(history) == 1:
            branch.first_slope = follower.first_slope
        if step < 0:
            branch.down = ended
        else:
            branch.up = ended

    def run(self, checks: int) -> None:
        n = len(self.preload)
        for k in [n - 1, *(int(i) for i in np.round(np.linspace(0, n - 1, checks + 2))[1:-1])]:
            self.scan(k)
        for _ in range(2 * n):
            todo = self.without_peak()
            if todo is None and 0 not in self.scanned:
                todo = 0
            if todo is None:
                todo = self.beside_tangle()
            if todo is None:
                todo = self.suspicious()
            if todo is None:
                break
            self.scan(todo)
        for k in range(n - 1):
            a, b = self.leader(k), self.leader(k + 1)
            if a is None or b is None or a[0] is b[0]:
                continue
            if a[0].joined.get(k + 1) == b[0].number or b[0].joined.get(k) == a[0].number:
                continue
            smooth = k + 1 in a[0].peaks and k in b[0].peaks
            what = "another peak becomes the highest" if smooth else "jump to another peak"
            self.events.append(
                f"between {self.preload[k]:.6g} and {self.preload[k + 1]:.6g} N: {what}, from {a[1].amplitude:.6g} m at "
                f"{a[1].frequency:.6g} Hz to {b[1].amplitude:.6g} m at {b[1].frequency:.6g} Hz"
            )

    def without_peak(self) -> int | None:
        """A preload without a peak, the highest.

        Before it the one next to it, from where a scan is cheap, and the low end of the range, which is scanned anyway:
        what is found there may reach up to it.
        """
        for k in reversed(range(len(self.preload))):
            if self.leader(k) is None and k not in self.scanned:
                beside = [j for j in (k + 1, k - 1) if 0 <= j < len(self.preload) and self.leader(j) is not None]
                first = [*beside, 0] if self.leader(0) is None else beside
                return next((j for j in first if j not in self.scanned), k)
        return None

    def beside_tangle(self) -> int | None:
        """A preload next to one whose scan was left in a tangle of folds: there the curve may be simpler."""
        for k, ending in self.scanned.items():
            beside = [j for j in (k + 1, k - 1) if 0 <= j < len(self.preload)]
            if "tangle" in ending and not any(j in self.scanned for j in beside):
                return beside[0]
        return None

    def suspicious(self) -> int | None:
        """A preload to which the highest peak of its neighbour does not reach, unless the highest there is still higher."""
        for k in range(len(self.preload) - 1):
            a, b = self.leader(k), self.leader(k + 1)
            for i, j, item in ((k, k + 1, a), (k + 1, k, b)):
                if item is not None and j in item[0].detached and i not in self.scanned:
                    return i
            if a is None or b is None or a[0] is b[0]:
                continue
            for j, one, other in ((k + 1, a, b), (k, b, a)):
                there = one[0].peaks.get(j)
                ended = (there is None or not self.within(there)) and one[1].amplitude >= other[1].amplitude
                if ended and j not in self.scanned:
                    return j
        return None
