"""All resonance peaks over a range of preloads.

The peak is followed down from the highest preload, where the contact is nearly stuck and the response nearly linear.
Several peaks can exist at one preload, and a followed one need not stay the highest.  So the response over frequency is
followed (:mod:`bdamper.peaks.scan`) at both ends of the range, next to where a peak has ended, and wherever the highest
peak does not come from that at the neighbouring preload; every peak that such a scan finds is followed both ways.

A scan takes the whole tracking curve, which :func:`bdamper.continuation.track.track` gives by default.  Following the curve
coarsely from a known peak first, with the whole one where that does not lead to both ends of the interval, gave the same
values of 27 random studies (``benchmarks.optimal_scenes``) for 0.99 times the evaluations, of two finer ones for 1.15: in a
tangle of folds a coarse curve takes as long and gets lost more often.

Where a scan shows that the damper rattles (:mod:`bdamper.continuation.rattle`), and none at a lower preload says otherwise,
the range ends: nothing is scanned or followed further down.

A preload has a value if a scan there was complete, or if the nearest scans on both sides were: the highest peak is then
the value of the optimal curve.  What an incomplete scan finds is a lower bound: branches are followed from it, but nothing
is concluded from it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.path import ContinuationOptions
from bdamper.continuation.rattle import OPEN
from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.peaks.branch import Branch
from bdamper.peaks.follower import LOST, PeakFollower
from bdamper.peaks.newton import Peak, PeakOptions, same_peak
from bdamper.peaks.scan import COMPLETE, Scan, scan
from bdamper.problem.problem import Problem
from bdamper.util.cost import Cost, CostMeter
from bdamper.util.errors import BdamperError
from bdamper.util.results_file import ResultsFile

SIGNIFICANT = 0.5
"""Peaks below this share of the highest one at the same preload are not followed; a branch ends below half of it.  With
0.25 and 0.75 two curves of the shipped disk (9 points, one harmonic, 12 preloads from 60 N, engine orders 5 and 10) stay
the same, with evaluations within 1 %."""
FOLLOWED = 4
"""Peaks of one scan that are followed at most, the highest ones.  On the same two curves 2 give the same values with 10 and
14 branches instead of 13 and 19 and 1.5 % fewer evaluations, no limit with 1.4 % more at most."""
HIGH = 0.8
"""Share of the highest peak from which on a peak that ends asks for a scan at the next preload: it may have been lost there
and be the highest.  If only the highest peak did, and only where the one that is left is lower, 2 of 180 values of ten
random studies would be too low by 8 and 12 %."""
BUDGET = 8000
"""Evaluations that a tracking curve may take in the search; curves of which some path ends by it are taken again with the
default where an optimum rests on them.  Curves with many folds take some 4,000, one in tens is lost in a tangle of them and
takes all it gets, to no avail: 17 of 39 s of one optimal curve."""
KEPT = 64
"""Equations of different preloads that are kept, more than most curves have preloads; a limit for the memory they take."""
SAME_PRELOAD = 1e-4
"""Relative difference up to which a curve at one preload stands for the other."""


@dataclass(frozen=True)
class Scanned:
    """What the last scan over frequency at one preload has told.

    Parameters
    ----------
    ending : str
        "complete" or why not.
    whole : bool
        The whole tracking curve was taken, and what it may take by default was enough for it.
    bound : float, m
        The highest response where it was not that of a peak, NaN otherwise.
    isolated : frozenset of int
        Numbers of the branches whose peak does not lie on the response curve that a sweep of frequency follows.
    rattles : str
        Why no steady periodic response is expected, if the curve shows the sign.
    """

    ending: str
    whole: bool = False
    bound: float = np.nan
    isolated: frozenset[int] = frozenset()
    rattles: str = ""


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
    * ``scanned``: what the scans have told, by the preload (N).

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
        self.scanned: dict[float, Scanned] = {}
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
        return next(((b, q) for b, q in self.at(k) if not self.isolated(b, k) and self.within(q)), None)

    def scan_at(self, k: int) -> Scanned | None:
        """What the scan at a preload has told, if one was made."""
        return self.scanned.get(float(self.preload[k]))

    @property
    def no_steady_below(self) -> float:
        """The highest preload (N) at and below which all scans show that the damper rattles; 0 if the lowest does not."""
        out = 0.0
        for p in sorted(self.scanned):
            if not self.scanned[p].rattles:
                break
            out = p
        return out

    @property
    def first(self) -> int:
        """Index of the lowest preload above those at which the damper rattles."""
        return int(np.searchsorted(self.preload, self.no_steady_below, side="right"))

    def isolated(self, branch: Branch, k: int) -> bool:
        """Whether the peak of a branch is known to lie off the response curve that a sweep of frequency follows."""
        there = self.scan_at(k)
        return there is not None and branch.number in there.isolated

    def value(self, k: int) -> tuple[Branch, Peak] | None:
        """The highest peak at a preload, if it is known that there is no higher one."""
        return self.highest(k) if self.trusted(k) else None

    def trusted(self, k: int) -> bool:
        """Whether the scan at a preload was complete, or the nearest ones on both sides were and no other is called for."""
        there, p = self.scan_at(k), self.preload[k]
        if k < self.first:
            return False
        if there is not None or not self.finished:
            return there is not None and there.ending == COMPLETE
        below = max((q for q in self.scanned if q < p), default=None)
        above = min((q for q in self.scanned if q > p), default=None)
        return all(q is not None and self.scanned[q].ending == COMPLETE for q in (below, above))

    def lower_bound(self, k: int) -> float:
        """Highest response found at a preload (m), NaN if none was."""
        top, there = self.highest(k), self.scan_at(k)
        return float(np.fmax(np.nan if there is None else there.bound, np.nan if top is None else top[1].amplitude))

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
            n_branches, n_events = len(self.branches), len(self.events)
            begin = self.meter.read(time.perf_counter())
            try:
                told = self._scan(k, whole)
            except KeyboardInterrupt:
                del self.branches[n_branches:], self.events[n_events:]
                raise
            self.scanned[float(self.preload[k])] = told
            if self.file is not None:
                spent = asdict(self.meter.read(time.perf_counter()) - begin)
                self.file.append(
                    {
                        "index": self.scans, "preload": self.preload[k], "asked_whole": whole, "scanned": told.ending,
                        "whole": told.whole, "bound": told.bound, "isolated": sorted(told.isolated),
                        "events": self.events[n_events:], "branches": [b.record() for b in self.branches[n_branches:]],
                        "rattles": told.rattles, "cost": spent,
                    }
                )  # fmt: skip
        self.scans += 1

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
        bound = np.nan if record["bound"] is None else record["bound"]
        self.scanned[float(self.preload[k])] = Scanned(
            record["scanned"], record["whole"], bound, frozenset(record["isolated"]),
            record["rattles"],
        )
        self.events += record["events"]
        self.branches += [Branch.of(item) for item in record["branches"]]
        self.meter.take_over(Cost(**record["cost"]))
        return True

    def tell(self, stage: str) -> None:
        """Report what is being done, with the scans made and those that are known to be made yet."""
        if self.report is None:
            return
        n = len(self.preload)
        ends = {min(self.first, n - 1), n - 1}
        todo = {k for k in ends if self.scan_at(k) is None}.union(() if self.finished else self.suspicious())
        self.report(stage, self.scans, self.scans + max(1, len(todo)))

    def _scan(self, k: int, whole: bool) -> Scanned:
        """The work of :meth:`scan`, which adds new branches and events and changes nothing else."""
        p = float(self.preload[k])
        state = self.problem.static(p)
        if not state.converged:
            self.events.append(f"{p:.6g} N: static state: {state.note}")
            return Scanned(f"not made: static state: {state.note}")
        try:
            found, told = self.peaks_over_frequency(k, whole)
        except LOST as error:
            told = Scanned(f"failed: {type(error).__name__}: {error}")
            self.events.append(f"{p:.6g} N: scan over frequency {told.ending}")
            return told
        peaks, above = found.peaks, found.above
        if above is not None and above.corner is not None and found.ending == COMPLETE:
            # no maximum of a smooth curve that could be followed, but the highest response there is
            self.branches.append(Branch(len(self.branches), {k: above.corner}, down=above.what, up=above.what))
            self.events.append(f"{p:.6g} N: {above}")
            above = None
        if above is not None:
            told = replace(told, ending=f"{found.ending}, {above}", bound=above.amplitude)
        known = [(b, q) for b, q in self.at(k) if not q.corner or q.curvature > -np.inf]
        missed = [(b, q) for b, q in known if not any(same_peak(q, other) for other in peaks)]
        isolated = {b.number for b, _ in missed if self.isolated(b, k)}
        new = [q for q in peaks if not any(same_peak(q, other) for _, other in known)]
        if found.ending == COMPLETE:
            for b, q in missed:
                if not found.passes(q, self.family(p).n_mean):
                    isolated.add(b.number)
                    self.events.append(
                        f"{p:.6g} N: peak of branch {b.number}, {q.amplitude:.6g} m at {q.frequency:.6g} Hz, is not "
                        "connected to the response curve that a sweep of frequency follows"
                    )
        self.events.append(
            f"{p:.6g} N: scan over frequency ({told.ending}) found {len(peaks)} peaks, {len(new)} of them new"
        )
        told = replace(told, isolated=frozenset(isolated), rattles=found.rattles)
        lowest = bool(told.rattles) and all(self.scanned[q].rattles for q in self.scanned if q < p)
        top = max([q.amplitude for q in peaks], default=0.0)
        for q in new[:FOLLOWED]:
            if q.amplitude < SIGNIFICANT * top:
                continue
            branch = Branch(len(self.branches), {k: q})
            self.branches.append(branch)
            if not lowest:
                self.follow(branch, k, -1)
            self.follow(branch, k, +1)
        return told

    def peaks_over_frequency(self, k: int, whole: bool) -> tuple[Scan, Scanned]:
        """The response over frequency at a preload."""
        curve = ContinuationOptions(budget=None if whole else BUDGET)
        found = scan(
            self.problem, float(self.preload[k]), self.frequency, options=self.options, continuation=curve, meter=self.meter
        )  # fmt: skip
        return found, Scanned(found.ending, whole=whole or not found.limited)

    def follow(self, branch: Branch, k: int, step: int, last: int | None = None) -> None:
        """Follow a branch from preload to preload until it ends or meets another one, or to the ``last`` alone."""
        follower = PeakFollower(self.family, branch.peaks[k], self.options, self.limits)
        ended = ""
        while True:
            k += step
            if not self.first <= k < len(self.preload) or (last is not None and k == last + step):
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
        todo = next((k for k in first if self.scan_at(k) is None and k >= self.first), None)
        if todo is None:
            todo = self.without_peak()
        if todo is None:
            todo = self.low_end()
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
        for b in self.branches:
            b.peaks = {moved(j): q for j, q in b.peaks.items()}
            b.joined = {moved(j): number for j, number in b.joined.items()}
        try:
            for b in self.branches:
                for step in (1, -1):
                    if k - step in b.peaks and k not in b.peaks:
                        self.follow(b, k - step, step, k)
        except KeyboardInterrupt:  # the highest peak there may be of a branch that was not followed yet
            for b in self.branches:
                b.peaks.pop(k, None)
            raise
        return k

    def goes_on(self, k: int) -> bool:
        """Whether the highest peaks at a preload and at the next one are one peak, also where a branch joins another."""
        a, b = self.highest(k), self.highest(k + 1)
        if a is None or b is None:
            return False
        return a[0] is b[0] or a[0].joined.get(k + 1) == b[0].number or b[0].joined.get(k) == a[0].number

    def note_change(self, k: int) -> None:
        """Note an event if the highest peaks at a preload and at the next one are different peaks."""
        a, b = self.highest(k), self.highest(k + 1)
        if a is None or b is None or self.goes_on(k):
            return
        smooth = k + 1 in a[0].peaks and k in b[0].peaks
        what = "another peak becomes the highest" if smooth else "jump to another peak"
        self.events.append(
            f"between {self.preload[k]:.6g} and {self.preload[k + 1]:.6g} N: {what}, from {a[1].amplitude:.6g} m at "
            f"{a[1].frequency:.6g} Hz to {b[1].amplitude:.6g} m at {b[1].frequency:.6g} Hz"
        )

    def without_peak(self) -> int | None:
        """The highest preload without a peak.

        The one beside it is taken first, and the low end of the range, which is scanned in any case: a branch found there
        may reach up to it.  The low end is left for later if the contacts are open most of the time
        beside the preload, since the range may end between the two.
        """
        low = self.first
        for k in reversed(range(low, len(self.preload))):
            if self.highest(k) is None and self.scan_at(k) is None:
                beside = [j for j in (k + 1, k - 1) if low <= j < len(self.preload) and self.highest(j) is not None]
                near = [self.highest(j) for j in beside]
                seated = not any(item is not None and item[1].shares[2] > OPEN for item in near)
                first = [*beside, 0] if seated and low == 0 and self.highest(0) is None else beside
                return next((j for j in first if self.scan_at(j) is None), k)
        return None

    def low_end(self) -> int | None:
        """The low end of the range, or halfway between preloads at which the damper rattles and the lowest scan above."""
        k = self.first
        if k == 0 or k == len(self.preload) or self.scan_at(k) is not None:
            return 0 if k == 0 and self.scan_at(0) is None else None
        above = next(j for j in range(k, len(self.preload)) if self.scan_at(j) is not None)
        return (k - 1 + above) // 2

    def beside_incomplete(self) -> int | None:
        """A preload beside one without a complete scan, so that every value lies between complete ones."""
        for k in reversed(range(self.first, len(self.preload))):
            there = self.scan_at(k)
            if there is not None and there.ending != COMPLETE:
                beside = [j for j in (k + 1, k - 1) if self.first <= j < len(self.preload) and self.scan_at(j) is None]
                if beside:
                    return beside[0]
        return None

    def suspicious(self) -> Iterator[int]:
        """Preloads to which a high peak of a neighbour does not reach, or beside one where the highest is isolated."""
        n = len(self.preload)
        for i, j in [pair for k in range(self.first, n - 1) for pair in ((k, k + 1), (k + 1, k))]:
            top = self.highest(i)
            if top is None:
                continue
            if self.isolated(top[0], j) and self.scan_at(i) is None:
                yield i
            if self.scan_at(j) is None and any(
                self.ends_between(b, q, i, j) for b, q in self.at(i)
                if q.amplitude >= HIGH * top[1].amplitude and not self.isolated(b, i)
            ):  # fmt: skip
                yield j

    def ends_between(self, branch: Branch, peak: Peak, i: int, j: int) -> bool:
        """Whether a peak within the interval at one preload is not known at the next one."""
        if not self.within(peak):
            return False
        if j in branch.peaks:
            return not self.within(branch.peaks[j])
        onward = j in branch.joined or any(b.joined.get(i) == branch.number and j in b.peaks for b in self.branches)
        return not onward
