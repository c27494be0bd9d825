"""Slow sweeps of frequency, marched in time: what a test rig would see.

The equations of all sectors (:mod:`bdamper.stability.time_integration`) are marched while the frequency of the excitation
goes linearly in time from one end of an interval to the other.  Each turn of the excitation has response amplitudes of its
own (:mod:`bdamper.stability.march`).  Where several stable solutions exist, the sweep stays on the one on which
it is until that ends, and then jumps; what is unstable it leaves.

A transient of the least damped mode, whose half bandwidth is ``b = zeta f``, falls to 1/e within ``1/(2 pi b)``.  The rate
says how far the frequency goes meanwhile: ``rate = RATE b 2 pi b``.  A sweep at twice the rate goes beside it, and the
difference of the two is the error that is stated; it is about that of the slower sweep, as the lag of a response behind
its steady value grows in proportion to the rate.  Where the response jumps two sweeps are far apart for a moment, and the
frequencies of their jumps are compared instead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.continuation.track import check_curve, track
from bdamper.problem.problem import Problem
from bdamper.stability.disturbances import TWO_PI
from bdamper.stability.kept import Levels
from bdamper.stability.march import BOUNDS, March
from bdamper.stability.time_integration import ring_of
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, Stopwatch
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.hdf5 import Recorded, Storable
from bdamper.util.plotting import Fact, Plottable
from bdamper.util.progress import LongWork, counter
from bdamper.util.repr import brief
from bdamper.util.status import COMPLETE, INTERRUPTED
from bdamper.util.tables import ROW, Followed, Hertz, Metres, Quantity, Tabular
from bdamper.util.text import amount, height, percent

RATE = 0.1
"""Half bandwidths of the least damped mode that the frequency goes within the memory of its transients."""
SETTLING = np.ceil(-np.log(BOUNDS.drift))
"""Memories that are marched at the first frequency before the sweep begins, until a transient has settled."""
JUMP = 0.2
"""Relative change of the amplitude within one memory that counts as a jump; without one a linear resonance makes RATE/2."""
AFTER_JUMP = 4.0
"""Memories after a jump within which amplitudes are not compared."""
NEAR = 1e-4
"""Half the relative width of the interval in which the first solution is sought."""


class Jump(NamedTuple):
    """Where the amplitude changes faster than the frequency could make it.

    Parameters
    ----------
    frequency : float, Hz
        Where it begins.
    before, after : float, m
        Amplitudes where it begins, and when the transient has died out.
    """

    frequency: float
    before: float
    after: float

    def __str__(self) -> str:
        return f"jump at {self.frequency:.6g} Hz from {self.before:.4g} to {self.after:.4g} m"


@brief
@dataclass(frozen=True)
class TimeSweep(Plottable, Followed, Tabular, Recorded, Storable, kind="bdamper-time-sweep", row="turn"):
    """The response while the frequency goes slowly from one end of an interval to the other, turn by turn.

    ``plot`` draws amplitude over frequency, also over tracking curves (:func:`bdamper.plot.plot_time_sweep`).

    Parameters
    ----------
    frequency : (n,) float, Hz
        In the middle of each turn of the excitation, in the order of time.
    harmonics : (n, n_harmonics + 1) complex, m
        Response amplitudes of each turn, those of the blade that is highest in it; the first column is the mean.
    preload : float, N
    rate : float, Hz/s
        Positive upward.
    memory : float, s
        In which a transient of the least damped mode falls to 1/e.
    steps_per_period, sectors : int
    status : {"complete", "interrupted"}
    reason : str
    cost : Cost
        That of the sweep at twice the rate included.
    beside : tuple of TimeSweep
        The same sweep at twice the rate, after Ctrl-C so far as it got; empty if there is none.
    settings : mapping
    model_hash : str
    """

    frequency: Hertz
    harmonics: Annotated[NDArray, Quantity("m", dims=(ROW, "harmonic"))]
    preload: float
    rate: float
    memory: float
    steps_per_period: int
    sectors: int
    status: str
    reason: str
    cost: Cost
    beside: tuple[TimeSweep, ...] = ()

    @property
    def up(self) -> bool:
        """Whether the frequency rises."""
        return self.rate > 0.0

    @property
    def mean(self) -> Metres:
        """(n,) mean position, m."""
        return self.harmonics[:, 0].real

    @property
    def highest(self) -> tuple[float, float]:
        """Frequency (Hz) and amplitude (m) of the largest response."""
        i = int(self.amplitude.argmax())
        return float(self.frequency[i]), float(self.amplitude[i])

    @property
    def jumps(self) -> tuple[Jump, ...]:
        """Where the amplitude changes by more than a fifth within the memory of a transient and stays there, in time.

        Amplitudes before and after are means over a memory, the latter once the transient has died out: what only scatters,
        as the motion of a damper that rattles, is no jump.
        """
        a, m, found = self.amplitude, self._turns(1.0), []
        for first, i, j in self._jumping():
            later = min(j + self._turns(AFTER_JUMP), len(a) - m)
            before, after = (float(a[k : k + m].mean()) for k in (max(0, first - m + 1), later))
            if abs(np.log(after / before)) > np.log1p(JUMP):
                found.append(Jump(float(self.frequency[i]), before, after))
        return tuple(found)

    @property
    def faster(self) -> TimeSweep | None:
        """The sweep at twice the rate."""
        return self.beside[0] if self.beside else None

    @property
    def error(self) -> float:
        """Largest relative difference from the sweep at twice the rate at the same frequency, fast changes aside.

        Relative to the larger of the two, of amplitudes averaged over one memory, as those of irregular motion scatter; nan
        where there is no such sweep, where it is shorter than a memory, and where all of it changes that fast.
        """
        if self.faster is None or len(self.faster) <= self._turns(1.0):
            return float("nan")
        f, other = self.faster.frequency, self.faster._averaged()
        way = slice(None, None, 1 if self.up else -1)
        own = np.interp(f, self.frequency[way], self._averaged()[way])
        aside = np.zeros(len(f), bool)
        ours, theirs = self._settling(), self.faster._settling()
        if len(ours) == len(theirs):  # between the jump of the one and that of the other they are on two branches
            ours = theirs = [np.concatenate(pair) for pair in zip(ours, theirs)]
        for stretch in (*ours, *theirs):
            aside |= (f >= min(stretch)) & (f <= max(stretch))
        away = np.abs(own - other) / np.maximum(np.maximum(own, other), 1e-300)
        return float("nan") if aside.all() else float(away[~aside].max())

    def _turns(self, memories: float) -> int:
        return max(1, round(memories * self.memory * float(self.frequency.mean())))

    def _averaged(self) -> NDArray:
        """Amplitude averaged over the memory around each turn."""
        window = np.ones(min(self._turns(1.0), len(self)))
        return np.convolve(self.amplitude, window, "same") / np.convolve(np.ones(len(self)), window, "same")

    def _jumping(self) -> list[tuple[int, int, int]]:
        """Of each fast change a turn at most one memory before it, the turn at which it begins, and one after it."""
        log, m = np.log(np.maximum(self.amplitude, 1e-300)), self._turns(1.0)
        if len(log) <= m:
            return []
        fast = np.flatnonzero(np.abs(log[m:] - log[:-m]) > np.log1p(JUMP))
        parts = np.split(fast, np.flatnonzero(np.diff(fast) > m) + 1) if len(fast) else []
        stretches = []
        for part in parts:
            changed = np.abs(log[part[0] :] - log[part[0]]) > 0.5 * np.log1p(JUMP)
            stretches.append((int(part[0]), int(part[0] + changed.argmax()), int(part[-1] + m)))
        return stretches

    def _settling(self) -> list[NDArray]:
        """Frequencies between which the amplitude changes fast, until that has died out."""
        after, last = self._turns(AFTER_JUMP), len(self) - 1
        return [self.frequency[[i, min(j + after, last)]] for i, _, j in self._jumping()]

    @property
    def seconds(self) -> float:
        """Wall-clock time in all."""
        return self.cost.seconds

    def bottom_line(self) -> str:
        f, a = self.highest
        way = f"from {amount(self.frequency[0], 'Hz')} to {amount(self.frequency[-1], 'Hz')}"
        jumps = f"; it jumps at {', '.join(amount(j.frequency, 'Hz') for j in self.jumps)}" if self.jumps else ""
        return f"Sweep in time {way}, preload {amount(self.preload, 'N')}: highest {height(a, f)}{jumps}."

    def facts(self) -> tuple[Fact, ...]:
        """Rate, jumps, and what the sweep at twice the rate says of them."""
        out = [Fact("rate", abs(self.rate), "Hz/s"), *(Fact("jump", str(jump)) for jump in self.jumps)]
        if self.faster is None:
            return (*out, Fact("error of the rate", "not known: no sweep at twice the rate"))
        f, a = self.faster.highest
        there = ", ".join(f"{jump.frequency:.6g}" for jump in self.faster.jumps)
        error = percent(self.error) if np.isfinite(self.error) else "too fast to compare amplitudes"
        out += [Fact("highest at twice the rate", height(a, f)), Fact("jumps at twice the rate", there and f"{there} Hz")]
        return (*out, Fact("error of the rate", error))


@one_thread
def sweep_in_time(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    up: bool = True,
    rate: float | None = None,
    start: Curve | None = None,
    index: int | None = None,
    steps_per_period: int | None = None,
    check: bool = True,
    progress: bool = False,
) -> TimeSweep:
    """March in time while the frequency of the excitation goes slowly over an interval.

    All sectors take part, each with its own contacts; no Fourier series is cut off, no travelling wave assumed.  The nodal
    diameters are all that the model carries.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    frequency : (low, high), Hz
    up : bool
        From the low end to the high one, or back.
    rate : float, Hz/s, optional
        By default a tenth of the half bandwidth of the least damped mode within the memory of its transients.
    start : Curve, optional
        A tracking curve of this study at this preload, from one of whose solutions the march starts.  By default the
        lowest solution between folds that is found at the first frequency, as by :meth:`Curve.sweep`.
    index : int, optional
        Of the point of that curve; by default the highest solution at the first frequency, or next to it in a gap,
        branches that close on themselves aside.  The march settles at the first frequency before the sweep begins.
    steps_per_period : int, optional
        256 by default.
    check : bool
        March a second time at twice the rate, for the error; costs half as much again.
    progress : bool
        Show a bar of the turns of the excitation.

    Returns
    -------
    TimeSweep
        After Ctrl-C the turns marched by then.

    Raises
    ------
    SettingError
        If a number does not fit, no rate is given where nothing is damped, or the settings describe something else than a
        structure in time.
    BdamperError
        If no solution is found at the first frequency, or the march fails.
    """
    preload, (low, high) = problem.check_preload(preload), validate.interval("frequency", frequency)
    for name, value in (("up", up), ("check", check), ("progress", progress)):
        validate.flag(name, value)
    rate = None if rate is None else validate.number("rate", rate, above=0.0, unit="Hz/s")
    watch = Stopwatch()
    ends = (low, high) if up else (high, low)
    problem, u, begin = _start(problem, preload, ends[0], start, index)
    ring = ring_of(problem, preload)
    march = March(ring, TWO_PI * begin, u, steps_per_period)
    least = ring.least_damping
    if not 0.0 < least < np.inf:
        raise SettingError("sweep_in_time: expected damping in every mode of the structure, found a mode without")
    memory, usual = 2.0 / least, RATE * least**2 / (8.0 * np.pi)
    rate = usual if rate is None else rate
    empty = TimeSweep(
        frequency=np.zeros(0), harmonics=np.zeros(0), preload=preload, rate=rate if up else -rate, memory=memory,
        steps_per_period=march.steps, sectors=ring.n, status=COMPLETE, reason="", cost=Cost(), settings=problem.record(),
        model_hash=problem.model.hash,
    )  # fmt: skip
    plans = [max(1, round(0.5 * (low + high) * (high - low) / (rate * factor))) for factor in (1, 2)[: 1 + check]]
    settling = max(1, round(SETTLING * memory * ends[0]))
    parts = _marched(march, ends, settling, plans, progress)
    if not parts:
        raise KeyboardInterrupt
    them = zip((1, 2), parts, plans)
    sweep, *beside = (_filled(empty, factor, part, planned, ends) for factor, part, planned in them)
    return replace(sweep, beside=tuple(beside), cost=replace(ring.cost, **watch.read()))


def _start(
    problem: Problem, preload: float, first: float, start: Curve | None, index: int | None
) -> tuple[Problem, NDArray, float]:
    """Problem, solution and its frequency (Hz) from which the march starts."""
    sought = start is None
    if start is None:
        if index is not None:
            raise validate.unfit("index", "a point of a curve that is given (start)", index)
        start = track(problem, preload, (first * (1.0 - NEAR), first * (1.0 + NEAR)))
    else:
        validate.instance("start", start, Curve, "a tracking curve")
        check_curve(problem, start)
        if start.preload != preload:
            raise validate.unfit("start", f"a curve at {preload:g} N", start.preload)
    if not len(start):
        raise BdamperError(f"no solution to start from at {first:g} Hz ({start.status}: {start.reason})")
    if sought:
        i = int(np.where(start.backward, np.inf, start.amplitude).argmin())
    elif index is None:
        levels = Levels(start)
        first = min(max(first, levels.end(-1.0)), levels.end(1.0))
        return problem, levels.start(first), first
    else:
        i = validate.whole("index", index, -len(start), len(start) - 1)
    return problem, start.unknowns[i], float(start.frequency[i])


def _marched(march: March, ends: tuple[float, float], settling: int, plans: list[int], progress: bool) -> list[NDArray]:
    """Harmonics of the highest blade in the turns of each sweep, from the motion that has settled at the beginning."""
    first, last = TWO_PI * ends[0], TWO_PI * ends[1]
    sweeps: list[March] = []
    with LongWork(), counter(progress, settling + sum(plans), 0, "marching", "turn") as count:
        march.sweep((first, first), settling, count)
        for planned in plans:
            sweeps.append(March(march.ring, first, march.motion, march.steps))
            sweeps[-1].sweep((first, last), planned, count)
    found = [np.array(sweep.harmonics) for sweep in sweeps if sweep.harmonics]
    return [x[np.arange(len(x)), np.abs(x[:, :, 1]).argmax(axis=1)] for x in found]


def _filled(empty: TimeSweep, factor: int, harmonics: NDArray, turns: int, ends: tuple[float, float]) -> TimeSweep:
    """The result of the turns that were marched out of those that were meant to be."""
    done = len(harmonics)
    along = (np.arange(done) + 0.5) / turns
    out = replace(
        empty,
        frequency=np.sqrt(ends[0] ** 2 + (ends[1] ** 2 - ends[0] ** 2) * along),
        harmonics=harmonics,
        rate=factor * empty.rate,
    )
    if done == turns:
        return out
    return replace(out, status=INTERRUPTED, reason=f"by the user after {done} of {turns} turns")
