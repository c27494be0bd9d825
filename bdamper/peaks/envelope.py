"""All resonance peaks over a range of preloads.

The peak is followed down from the highest preload, where the contact is nearly stuck and the response nearly linear.
Several peaks can exist at one preload, and a followed one need not stay the highest.  So the response over frequency is
followed (:mod:`bdamper.peaks.scan`) at both ends of the range, next to where a peak has ended, and wherever the highest
peak does not come from that at the neighbouring preload; every peak that such a scan finds is followed both ways.

A scan starts at the highest peak that is known there and follows the curve coarsely.  If this does not lead to both ends
of the interval, or did not at a preload beside it, the whole tracking curve is taken, which
:func:`bdamper.continuation.track.track` gives by default: in a tangle of folds a coarse curve takes as long and gets lost
more often.

A preload has a value if a scan there was complete, or if the nearest scans on both sides were: the highest peak is then
the value of the optimal curve.  What an incomplete scan finds is a lower bound: branches are followed from it, but nothing
is concluded from it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.path import ContinuationOptions
from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.peaks.branch import Branch
from bdamper.peaks.follower import LOST, PeakFollower
from bdamper.peaks.newton import Peak, PeakOptions, same_peak
from bdamper.peaks.scan import COMPLETE, Scan, scan, scan_from
from bdamper.problem.problem import Problem
from bdamper.util.cost import Cost, CostMeter
from bdamper.util.errors import BdamperError
from bdamper.util.results_file import ResultsFile

SIGNIFICANT = 0.5
"""Peaks below this share of the highest one at the same preload are not followed; a branch ends below half of it."""
FOLLOWED = 4
"""Peaks of one scan that are followed at most, the highest ones."""
HIGH = 0.8
"""Share of the highest peak from which on a peak that ends asks for a scan at the next preload: it may have been lost there
and be the highest.  If only the highest peak did, and only where the one that is left is lower, 2 of 180 values of ten
random studies would be too low by 8 and 12 %."""
BUDGET = 8000
"""Evaluations that a tracking curve may take in the search; curves of which some path ends by it are taken again with the
default where an optimum rests on them.  Curves with many folds take some 4,000, one in tens is lost in a tangle of them and
takes all it gets, to no avail: 17 of 39 s of one optimal curve."""
KEPT = 64
"""Equations of different preloads that are kept."""

SAME_PRELOAD = 1e-4
"""Relative difference up to which a curve at one preload stands for the other."""


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
    file : ResultsFile, optional
        That keeps every scan with what was followed from it; those that it holds are repeated from it.

    What is known so far, between any two scans, is held by

    * ``preload``, to which those are added at which curves check an optimum, and ``asked``, which tells the others,
    * ``branches`` and ``events``,
    * ``scanned``: "complete" or why not, by the index of the preload,
    * ``quick``: where following the curve coarsely from a peak was enough,
    * ``whole``: where the whole tracking curve was taken, and what it may take by default was enough for it,
    * ``bound``: the highest response (m) where a scan found no peak there.

    With these set, :meth:`find_all` goes on where it was.  ``finished`` tells whether it has ended since.
    """

    def __init__(
        self,
        problem: Problem,
        preload: NDArray,
        frequency: tuple[float, float],
        options: PeakOptions,
        meter: CostMeter,
        file: ResultsFile | None = None,
    ) -> None:
        self.problem = problem
        self.preload = preload
        self.frequency = frequency
        # beyond the interval, so that a peak that leaves it and comes back is not lost
        self.limits = (0.5 * frequency[0], 1.5 * frequency[1])
        self.options = options
        self.meter = meter
        self.branches: list[Branch] = []
        self.asked = np.ones(len(preload), bool)
        self.scanned: dict[int, str] = {}
        self.quick: set[int] = set()
        self.whole: set[int] = set()
        self.bound: dict[int, float] = {}
        self.events: list[str] = []
        self.systems: dict[float, HarmonicSystem] = {}
        self.file = file
        self.scans = 0
        self.finished = True
        self.report: Callable[[str, int, int], None] | None = None

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

    def value(self, k: int) -> tuple[Branch, Peak] | None:
        """The highest peak at a preload, if it is known that there is no higher one."""
        return self.highest(k) if self.trusted(k) else None

    def trusted(self, k: int) -> bool:
        """Whether the scan at a preload was complete, or the nearest ones on both sides were and no other is called for."""
        if k in self.scanned or not self.finished:
            return self.scanned.get(k) == COMPLETE
        below = max((j for j in self.scanned if j < k), default=-1)
        above = min((j for j in self.scanned if j > k), default=-1)
        return self.scanned.get(below) == COMPLETE and self.scanned.get(above) == COMPLETE

    def lower_bound(self, k: int) -> float:
        """Highest response found at a preload (m), NaN if none was."""
        top = self.highest(k)
        return float(np.fmax(self.bound.get(k, np.nan), np.nan if top is None else top[1].amplitude))

    def within(self, peak: Peak) -> bool:
        """Whether a peak lies in the interval of frequency; a branch is followed beyond it, since it may come back."""
        return self.frequency[0] <= peak.frequency <= self.frequency[1]

    def scan(self, k: int, whole: bool = False) -> None:
        """Follow the response over frequency at a preload, and every new peak that is found to both sides.

        An interruption undoes it.

        Parameters
        ----------
        k : int
        whole : bool
            Take the whole tracking curve, with all that it may take by default.

        Raises
        ------
        BdamperError
            If the file holds the scan of another preload at this place.
        """
        self.tell(f"scan at {self.preload[k]:.4g} N")
        if not self._repeat(k, whole):
            n_branches, n_events, before = len(self.branches), len(self.events), self.scanned.get(k)
            begin = self.meter.read(time.perf_counter())
            try:
                self._scan(k, whole)
            except KeyboardInterrupt:
                del self.branches[n_branches:], self.events[n_events:]
                self.scanned.pop(k, None)
                self.scanned |= {} if before is None else {k: before}
                raise
            if self.file is not None:
                spent = asdict(self.meter.read(time.perf_counter()) - begin)
                self.file.append(self._record(k, whole, n_branches, n_events) | {"cost": spent})
        self.scans += 1

    def _record(self, k: int, whole: bool, n_branches: int, n_events: int) -> dict[str, Any]:
        """What a scan has changed, as :meth:`_repeat` takes it."""
        return {
            "index": self.scans, "preload": self.preload[k], "asked_whole": whole, "scanned": self.scanned[k],
            "quick": k in self.quick, "whole": k in self.whole, "bound": self.bound.get(k),
            "events": self.events[n_events:],
            "isolated": [b.number for b in self.branches[:n_branches] if k in b.isolated],
            "branches": [b.record() for b in self.branches[n_branches:]],
        }  # fmt: skip

    def _repeat(self, k: int, whole: bool) -> bool:
        """Take a scan from the file; False if it does not hold it yet."""
        record = None if self.file is None else self.file.records.get(self.scans)
        if record is None:
            return False
        assert self.file is not None
        if (record["preload"], record["asked_whole"]) != (self.preload[k], whole):
            raise BdamperError(
                f"{self.file.path}: expected a scan at {self.preload[k]:.6g} N next, found one at "
                f"{record['preload']:.6g} N, as where numbers are rounded otherwise: start with a new file"
            )
        self.scanned[k] = record["scanned"]
        for name in ("quick", "whole"):
            (getattr(self, name).add if record[name] else getattr(self, name).discard)(k)
        if record["bound"] is not None:
            self.bound[k] = record["bound"]
        self.events += record["events"]
        for b in self.branches:
            (b.isolated.add if b.number in record["isolated"] else b.isolated.discard)(k)
        self.branches += [Branch.of(item) for item in record["branches"]]
        self.meter.take_over(Cost(**record["cost"]))
        return True

    def tell(self, stage: str) -> None:
        """Report what is being done, with the scans made and those that are known to be made yet."""
        if self.report is None:
            return
        n = len(self.preload)
        todo = {k for k in (0, n - 1) if k not in self.scanned}.union(() if self.finished else self.suspicious())
        self.report(stage, self.scans, self.scans + max(1, len(todo)))

    def _scan(self, k: int, whole: bool) -> None:
        """The work of :meth:`scan`."""
        p = float(self.preload[k])
        state = self.problem.static(p)
        if not state.converged:
            self.scanned[k] = f"not made: static state: {state.note}"
            self.events.append(f"{p:.6g} N: static state: {state.note}")
            return
        try:
            found = self.look(k, p, whole)
        except LOST as error:
            self.scanned[k] = f"failed: {type(error).__name__}: {error}"
            self.events.append(f"{p:.6g} N: scan over frequency {self.scanned[k]}")
            return
        peaks, above = found.peaks, found.above
        if above is not None and above.corner is not None and found.ending == COMPLETE:
            # no maximum of a smooth curve that could be followed, but the highest response there is
            self.branches.append(Branch(len(self.branches), {k: above.corner}, down=above.what, up=above.what))
            self.events.append(f"{p:.6g} N: {above}")
            above = None
        self.scanned[k] = found.ending if above is None else f"{found.ending}, {above}"
        if above is not None:
            self.bound[k] = above.amplitude
        known = [(b, q) for b, q in self.at(k) if not q.corner or q.curvature > -np.inf]
        for b, q in known:
            if any(same_peak(q, other) for other in peaks):
                b.isolated.discard(k)
        new = [q for q in peaks if not any(same_peak(q, other) for _, other in known)]
        if found.ending == COMPLETE:
            for b, q in known:
                if not any(same_peak(q, other) for other in peaks) and not found.passes(q, self.family(p).n_mean):
                    b.isolated.add(k)
                    self.events.append(
                        f"{p:.6g} N: peak of branch {b.number}, {q.amplitude:.6g} m at {q.frequency:.6g} Hz, is not "
                        "connected to the response curve that a sweep of frequency follows"
                    )
        self.events.append(
            f"{p:.6g} N: scan over frequency ({self.scanned[k]}) found {len(peaks)} peaks, {len(new)} of them new"
        )
        top = max([q.amplitude for q in peaks], default=0.0)
        for q in new[:FOLLOWED]:
            if q.amplitude < SIGNIFICANT * top:
                continue
            branch = Branch(len(self.branches), {k: q})
            self.branches.append(branch)
            self.follow(branch, k, -1)
            self.follow(branch, k, +1)

    def look(self, k: int, preload: float, whole: bool) -> Scan:
        """The response over frequency: from the highest peak known at a preload, if that will do, else the whole curve."""
        item = self.highest(k)
        slow = any(j in self.scanned and j not in self.quick for j in (k - 1, k + 1))
        if not whole and item is not None and not slow:
            found = scan_from(
                self.problem, self.family(preload), item[1].y, self.frequency, preload=preload, options=self.options,
                meter=self.meter, share=0.5 * SIGNIFICANT,
            )  # fmt: skip
            if found.whole:
                self.quick.add(k)
                return found
        curve = ContinuationOptions(budget=None if whole else BUDGET)
        found = scan(self.problem, preload, self.frequency, options=self.options, continuation=curve, meter=self.meter)
        if whole or not found.limited:
            self.whole.add(k)
        return found

    def follow(self, branch: Branch, k: int, step: int, last: int | None = None) -> None:
        """Follow a branch from preload to preload until it ends or meets another one, or to the ``last`` alone."""
        follower = PeakFollower(self.family, branch.peaks[k], self.options, self.limits)
        ended = ""
        while True:
            k += step
            if not 0 <= k < len(self.preload) or (last is not None and k == last + step):
                break
            self.tell(f"peak followed to {self.preload[k]:.4g} N")
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
        if last is not None:
            return
        if step < 0:
            branch.down = ended
        else:
            branch.up = ended

    def find_all(self, checks: int = 0) -> None:
        """Find peaks at all preloads, by one scan after another until :meth:`next_scan` asks for none."""
        self.finished = False
        while (k := self.next_scan(checks)) is not None:
            self.scan(k)
        self.finished = True

    def next_scan(self, checks: int) -> int | None:
        """The preload that is to be scanned next: ends of the range, some between, and where what is known asks for it."""
        n = len(self.preload)
        first = [n - 1, *(int(i) for i in np.round(np.linspace(0, n - 1, checks + 2))[1:-1])]
        todo = next((k for k in first if k not in self.scanned), None)
        if todo is None:
            todo = self.without_peak()
        if todo is None and 0 not in self.scanned:
            return 0
        if todo is None:
            todo = next(self.suspicious(), None)
        return self.beside_incomplete() if todo is None else todo

    def insert(self, preload: float) -> int:
        """Index of a preload, which is added if it is none of those so far, with the peaks that can be followed there."""
        k = int(np.searchsorted(self.preload, preload))
        for j in (k - 1, k):
            if 0 <= j < len(self.preload) and abs(np.log(self.preload[j] / preload)) < SAME_PRELOAD:
                return j

        def moved(j: int) -> int:
            return j + (j >= k)

        self.preload = np.insert(self.preload, k, preload)
        self.asked = np.insert(self.asked, k, False)
        self.scanned = {moved(j): ending for j, ending in self.scanned.items()}
        self.quick, self.whole = {moved(j) for j in self.quick}, {moved(j) for j in self.whole}
        self.bound = {moved(j): amplitude for j, amplitude in self.bound.items()}
        for b in self.branches:
            b.peaks = {moved(j): q for j, q in b.peaks.items()}
            b.isolated = {moved(j) for j in b.isolated}
            b.joined = {moved(j): number for j, number in b.joined.items()}
        for b in self.branches:
            for step in (1, -1):
                if k - step in b.peaks and k not in b.peaks:
                    self.follow(b, k - step, step, k)
        return k

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

    def beside_incomplete(self) -> int | None:
        """A preload beside one without a complete scan, so that every value lies between complete ones."""
        for k, ending in sorted(self.scanned.items(), reverse=True):
            if ending != COMPLETE:
                beside = [j for j in (k + 1, k - 1) if 0 <= j < len(self.preload) and j not in self.scanned]
                if beside:
                    return beside[0]
        return None

    def suspicious(self) -> Iterator[int]:
        """Preloads to which a high peak of a neighbour does not reach, or beside one where the highest is isolated."""
        n = len(self.preload)
        for i, j in [pair for k in range(n - 1) for pair in ((k, k + 1), (k + 1, k))]:
            top = self.highest(i)
            if top is None:
                continue
            if j in top[0].isolated and i not in self.scanned:
                yield i
            if j not in self.scanned and any(self.ends_between(b, q, i, j) for b, q in self.at(i) if
                                             q.amplitude >= HIGH * top[1].amplitude and i not in b.isolated):  # fmt: skip
                yield j

    def ends_between(self, branch: Branch, peak: Peak, i: int, j: int) -> bool:
        """Whether a peak within the interval at one preload is not known at the next one."""
        if not self.within(peak):
            return False
        if j in branch.peaks:
            return not self.within(branch.peaks[j])
        onward = j in branch.joined or any(b.joined.get(i) == branch.number and j in b.peaks for b in self.branches)
        return not onward
