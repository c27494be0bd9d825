"""What a motion comes to that starts at a point of a response curve: where it settles, and whether it stays there.

All sectors are marched from the solution (:mod:`bdamper.time_domain.steady_amplitude`) with a disturbance of every nodal
diameter.  If the response amplitudes of the periods stay the same the response is periodic; if they repeat after some
periods it is subharmonic; otherwise, as for a damper that rattles in its seat, it is irregular and is described by a mean
and a range. Both are those of the highest blade over the second half of the periods.

:func:`settle` marches a number of periods, for frequencies at which harmonic balance has no solution or none that is
stable.  :func:`verify` marches until ``bdamper.time_domain.march.judged`` says whether the amplitude stays that of
the solution; a growth that shows only after hundreds of periods is beyond it, as it is beyond a test.

Slow sweeps of frequency, marched in time: what a test rig would see.

The equations of all sectors (:mod:`bdamper.time_domain.integration`) are marched while the frequency of the excitation
goes linearly in time from one end of an interval to the other.  Each turn of the excitation has response amplitudes of its
own (:mod:`bdamper.time_domain.steady_amplitude`).  Where several stable solutions exist,
the sweep stays on the one on which
it is until that ends, and then jumps; what is unstable it leaves.

A transient of the least damped mode, whose half bandwidth is ``b = zeta f``, falls to 1/e within ``1/(2 pi b)``.  The rate
says how far the frequency goes meanwhile: ``rate = RATE b 2 pi b``.  A sweep at twice the rate shows the
error: it differs by about as much, as the lag of a response behind its steady value grows in proportion to the rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.problem import Problem
from bdamper.response.continuation import TWO_PI
from bdamper.response.response_curve import Jump, check_curve, frequency_response
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import TimeResponse
from bdamper.time_domain.integration import Ring, ring_of
from bdamper.time_domain.march import BOUNDS, UNDECIDED, March, judged, repeats_after, second_half, to_come
from bdamper.time_domain.steady_amplitude import RULES, of_blades
from bdamper.util import validation
from bdamper.util.display import Fact, Plottable
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, BdamperError, SettingError, with_reason
from bdamper.util.formatting import amount, peak_text, short_repr
from bdamper.util.progress import Cost, CostMeter, LongWork, one_thread, progress_counter
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import ROW, FrequencySeries, Hertz, Metres, Quantity, Tabular

# ---- What a motion comes to that starts at a point of a response curve ----


FEWEST = BOUNDS.look
"""Least number of periods from which a mean and a range are taken."""


def march_from(ring: Ring, u: NDArray, omega: float, steps: int | None = None) -> March:
    """A march from a solution (n_unknowns,) with a disturbance of every nodal diameter."""
    march = March(ring, omega, u, steps)
    return March(ring, omega, ring.seeded(march.motion, RULES.seed, 0), march.steps)


def described(march: March, preload: float, status: str, **more: Any) -> TimeResponse:
    """The result of a march, with mean and range over the second half of its periods."""
    amplitude = second_half(march.amplitude)
    return TimeResponse(
        float(amplitude.mean()), float(amplitude.min()), float(amplitude.max()), march.omega / (2.0 * np.pi), preload,
        status=status, periods=len(march.harmonics), diameters=march.ring.nodal_diameters, harmonics=march.response,
        repeats_after=repeats_after(march.response), **of_blades(march, len(amplitude)), **{"balance": np.nan, **more},
    )  # fmt: skip


def settled(march: March, preload: float, periods: int = 200, progress: bool = False, **more: Any) -> TimeResponse:
    """What a march over whole periods of the excitation comes to; ``more`` are fields of the result.

    Raises
    ------
    SettingError
        If there are too few periods to judge.
    MarchFailed
        If the march fails.
    """
    watch = CostMeter()
    stopped = march.run(validation.integer("periods", periods, least=FEWEST), progress)
    if stopped and len(march.harmonics) < FEWEST:
        raise KeyboardInterrupt
    change = to_come(march.amplitude, march.memory)
    status, text = COMPLETE, f"estimated change of the mean still to come {100.0 * change:+.2g} %"
    if abs(change) > BOUNDS.drift:
        longer = int(np.ceil(march.memory * np.log(abs(change) / BOUNDS.drift) / 10.0)) * 10
        status = with_reason(INCOMPLETE, f"still moving, {text}; some {longer} more periods would settle it")
    status = INTERRUPTED if stopped else status
    return described(march, preload, status, cost=watch.read(march.ring.cost), **more)


def verified(
    march: March, expected: NDArray, preload: float = np.nan, tolerance: float = BOUNDS.tolerance,
    periods: int = BOUNDS.most, progress: bool = False, **more: Any,
) -> TimeResponse:  # fmt: skip
    """March until it is clear whether the motion keeps to a response (n_harmonics + 1,) complex, m.

    Raises
    ------
    MarchFailed
        If the march fails.
    """
    periods = validation.integer("periods", periods, least=1)
    tolerance = validation.number("tolerance", tolerance, above=0.0, most=1.0)
    watch, size = CostMeter(), float(abs(expected[1]))

    def verdict_so_far() -> tuple[str, str]:
        return judged(march.amplitude, size, tolerance, march.memory)

    stopped = march.run(periods, progress, lambda: verdict_so_far()[0] != UNDECIDED)
    if not march.harmonics:
        raise KeyboardInterrupt
    verdict, reason = verdict_so_far()
    distance = np.linalg.norm((march.response[-1] - expected)[1:]) / max(float(np.linalg.norm(expected[1:])), 1e-300)
    status = INTERRUPTED if stopped else with_reason(INCOMPLETE, "undecided") if verdict == UNDECIDED else COMPLETE
    return described(
        march, preload, status, balance=size, verdict=verdict, reason=reason, distance=float(distance),
        cost=watch.read(march.ring.cost), **more,
    )  # fmt: skip


@one_thread
def settle(
    problem: Problem,
    start: ResponseCurve,
    frequency: float | None = None,
    *,
    periods: int = 200,
    steps_per_period: int | None = None,
    progress: bool = False,
) -> TimeResponse:
    """March in time for a number of periods, and say what the response comes to.

    This is for frequencies at which no solution was found, or none that is stable: a damper that rattles may have no
    periodic response at all, and is described by a mean amplitude and a range (:mod:`bdamper.time_domain.transients`).

    Parameters
    ----------
    problem : Problem
    start : ResponseCurve
        A response curve, from whose solution nearest in frequency the march starts.
    frequency : float, Hz, optional
        By default the middle of the widest part of the curve without solutions.
    periods : int
        Of the excitation.  A transient of a mode with the damping ratio ``zeta`` takes about ``1/(2 zeta)`` of them.
    steps_per_period : int, optional
        256 by default.
    progress : bool
        Show a progress bar.

    Returns
    -------
    TimeResponse
        "incomplete" while the mean still moves; after Ctrl-C that of the periods marched by then, if these are 16.

    Raises
    ------
    SettingError, MarchFailed
        If the curve has a solution at every frequency and none is given, or an argument does not fit; if the march fails.
    """
    if frequency is not None:
        frequency = validation.number("frequency", frequency, above=0.0, unit="Hz")
    check_curve(problem, start, "start")
    validation.check_value(len(start), "start", "a curve with points", f"one without ({start.status}: {start.reason})")
    if frequency is None:
        if start.gap is None:
            raise validation.invalid("frequency", "one in Hz, as the curve has a solution at each", None)
        frequency = float(np.mean(start.gap))
    u = start.unknowns[int(np.abs(start.frequency - frequency).argmin())]
    march = march_from(ring_of(problem, start.preload), u, 2.0 * np.pi * frequency, steps_per_period)
    return settled(march, start.preload, periods, progress, **problem.recorded())


@one_thread
def verify(
    problem: Problem,
    curve: ResponseCurve,
    index: int | None = None,
    *,
    tolerance: float = BOUNDS.tolerance,
    periods: int = BOUNDS.most,
    steps_per_period: int | None = None,
    progress: bool = False,
) -> TimeResponse:
    """March in time from a point of a response curve and say whether the motion agrees with it.

    All sectors take part, each with its own contacts; no Fourier series is cut off, no travelling wave assumed
    (:mod:`bdamper.time_domain.transients`).  The march ends as soon as it is decided, most often after 48 to 200 periods.

    Parameters
    ----------
    problem : Problem
    curve : ResponseCurve
        Tracked with this problem.
    index : int, optional
        Of the point; the largest response by default.
    tolerance : float
        Difference of the amplitude, as a share of it, up to which the motion agrees.
    periods : int
        Periods of the excitation, at most.
    steps_per_period : int, optional
        1,024 by default.
    progress : bool
        Show a bar of the periods, with the time left.

    Returns
    -------
    TimeResponse
        With the ``verdict`` "agrees", "does not agree" or "undecided"; after Ctrl-C that of the periods marched by then.

    Raises
    ------
    SettingError, MarchFailed
        If the settings describe something else than a structure in time, or a number does not fit; if the march fails.
    """
    check_curve(problem, curve)
    i = curve.peak.index if index is None else validation.integer("index of a point", index, -len(curve), len(curve) - 1)
    system, u, omega = problem.system(curve.preload), curve.unknowns[i], 2.0 * np.pi * float(curve.frequency[i])
    steps = BOUNDS.steps if steps_per_period is None else steps_per_period
    march = march_from(ring_of(problem, curve.preload), u, omega, steps)
    return verified(march, system.response(u), curve.preload, tolerance, periods, progress, **problem.recorded())


# ---- Slow sweeps of frequency, marched in time ----


RATE = 0.1
"""Half bandwidths of the least damped mode that the frequency goes within the memory of its transients."""
SETTLING = np.ceil(-np.log(BOUNDS.drift))
"""Memories that are marched at the first frequency before the sweep begins, until a transient has settled."""
JUMP = 0.2
"""Relative change of the amplitude within one memory that counts as a jump; without one a linear resonance makes RATE/2."""
AFTER_JUMP = 4.0
"""Memories after a jump within which its transient has died out."""
NEAR = 1e-4
"""Half the relative width of the interval in which the first solution is sought."""


@short_repr
@dataclass(frozen=True)
class TimeSweep(Plottable, FrequencySeries, Tabular, Recorded, Storable, kind="bdamper-time-sweep", row="turn"):
    """The response while the frequency goes slowly from one end of an interval to the other, turn by turn.

    ``plot`` draws amplitude over frequency, also over response curves (:func:`bdamper.plot.plot_frequency_sweep`).

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
        log = np.log(np.maximum(a, 1e-300))
        fast = np.flatnonzero(np.abs(log[m:] - log[:-m]) > np.log1p(JUMP))
        for part in np.split(fast, np.flatnonzero(np.diff(fast) > m) + 1) if len(fast) else ():
            first = int(part[0])
            begins = first + int((np.abs(log[first:] - log[first]) > 0.5 * np.log1p(JUMP)).argmax())
            later = min(int(part[-1]) + m + self._turns(AFTER_JUMP), len(a) - m)
            before, after = (float(a[k : k + m].mean()) for k in (max(0, first - m + 1), later))
            if abs(np.log(after / before)) > np.log1p(JUMP):
                found.append(Jump(float(self.frequency[begins]), before, after))
        return tuple(found)

    def _turns(self, memories: float) -> int:
        return max(1, round(memories * self.memory * float(self.frequency.mean())))

    def _headline(self) -> str:
        f, a = self.highest
        way = f"from {amount(self.frequency[0], 'Hz')} to {amount(self.frequency[-1], 'Hz')}"
        jumps = f"; it jumps at {', '.join(amount(j.frequency, 'Hz') for j in self.jumps)}" if self.jumps else ""
        return f"Sweep in time {way}, preload {amount(self.preload, 'N')}: highest {peak_text(a, f)}{jumps}."

    def _facts(self) -> tuple[Fact, ...]:
        """Rate and jumps."""
        return (Fact("rate", abs(self.rate), "Hz/s"), *(Fact("jump", str(jump)) for jump in self.jumps))


@validation.check_arguments
@one_thread
def frequency_sweep(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    up: bool = True,
    rate: float | None = None,
    steps_per_period: int | None = None,
    progress: bool = False,
) -> TimeSweep:
    """March in time while the frequency of the excitation goes slowly over an interval.

    All sectors take part, each with its own contacts; no Fourier series is cut off, no travelling wave assumed.  The nodal
    diameters are all that the model carries.  The march begins at the lowest solution between folds that is found at the
    first frequency, and settles there before the sweep begins.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    frequency : (low, high), Hz
    up : bool
        From the low end to the high one, or back.
    rate : float, Hz/s, optional
        By default a tenth of the half bandwidth of the least damped mode within the memory of its transients.
    steps_per_period : int, optional
        256 by default.
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
    preload, (low, high) = problem.check_preload(preload), validation.interval("frequency", frequency)
    for name, value in (("up", up), ("progress", progress)):
        validation.flag(name, value)
    rate = None if rate is None else validation.number("rate", rate, above=0.0, unit="Hz/s")
    watch = CostMeter()
    ends = (low, high) if up else (high, low)
    u, begin = _start(problem, preload, ends[0])
    ring = ring_of(problem, preload)
    march = March(ring, TWO_PI * begin, u, steps_per_period)
    least = ring.least_damping
    if not 0.0 < least < np.inf:
        raise SettingError("frequency_sweep: expected damping in every mode of the structure, found a mode without")
    memory, usual = 2.0 / least, RATE * least**2 / (8.0 * np.pi)
    rate = usual if rate is None else rate
    turns = max(1, round(0.5 * (low + high) * (high - low) / rate))
    settling = max(1, round(SETTLING * memory * ends[0]))
    harmonics = _marched(march, ends, settling, turns, progress)
    done = len(harmonics)
    if not done:
        raise KeyboardInterrupt
    along = (np.arange(done) + 0.5) / turns
    return TimeSweep(
        frequency=np.sqrt(ends[0] ** 2 + (ends[1] ** 2 - ends[0] ** 2) * along), harmonics=harmonics, preload=preload,
        rate=rate if up else -rate, memory=memory, steps_per_period=march.steps, sectors=ring.n,
        status=COMPLETE if done == turns else INTERRUPTED,
        reason="" if done == turns else f"by the user after {done} of {turns} turns",
        cost=watch.read(ring.cost), settings=problem.record(), model_hash=problem.model.hash,
    )  # fmt: skip


def _start(problem: Problem, preload: float, first: float) -> tuple[NDArray, float]:
    """Solution and its frequency (Hz) from which the march starts."""
    start = frequency_response(problem, preload, (first * (1.0 - NEAR), first * (1.0 + NEAR)))
    if not len(start):
        raise BdamperError(f"no solution to start from at {first:g} Hz ({start.status}: {start.reason})")
    i = int(np.where(start.backward, np.inf, start.amplitude).argmin())
    return start.unknowns[i], float(start.frequency[i])


def _marched(march: March, ends: tuple[float, float], settling: int, turns: int, progress: bool) -> NDArray:
    """Harmonics of the highest blade in each turn of the sweep, from the motion that has settled at the beginning."""
    first, last = TWO_PI * ends[0], TWO_PI * ends[1]
    found: list[NDArray] = []
    with LongWork(), progress_counter(progress, settling + turns, 0, "marching", "turn") as count:
        march.sweep((first, first), settling, count)
        sweep = March(march.ring, first, march.motion, march.steps)
        found = sweep.harmonics
        sweep.sweep((first, last), turns, count)
    return np.array([x[np.abs(x[:, 1]).argmax()] for x in found])
