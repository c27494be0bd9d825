"""Time integration from a point of a response curve, and slow sweeps of frequency in time.

**From a solution.**  All sectors are integrated from the solution with a disturbance of every nodal diameter.  If the
response amplitudes of the periods become constant, the response is periodic; if they repeat after some periods, it is
subharmonic. Otherwise, as for a rattling damper, it is irregular, and mean and range describe it.  Both are taken from the
highest blade over the second half of the periods.  :func:`settle` integrates a given number of periods, for frequencies
without a solution or without a stable one.  :func:`verify` integrates until ``bdamper.time_domain.march.judged`` decides
whether the amplitude stays at the solution.  It does not detect growth that appears only after hundreds of periods.

**Slow sweep.**  The frequency of the excitation changes linearly in time from one end of an interval to the other, as on a
test rig.  Among several stable solutions the sweep follows its branch until it ends, and then jumps; it leaves unstable
solutions. A transient of the least damped mode, with half bandwidth ``b = zeta f``, falls to 1/e within ``1/(2 pi b)``.
The default rate moves the frequency by RATE half bandwidths in this time: ``rate = RATE b 2 pi b``.  The lag of a response
behind its steady value is proportional to the rate, so a sweep at twice the rate estimates the error.
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
from bdamper.time_domain.march import LIMITS, UNDECIDED, March, judged, repeats_after, second_half, to_come
from bdamper.time_domain.steady_amplitude import CRITERIA, of_blades
from bdamper.util import validation
from bdamper.util.display import Fact, Plottable
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, BdamperError, SettingError, with_reason
from bdamper.util.formatting import amount, peak_text, short_repr
from bdamper.util.progress import Cost, CostMeter, LongWork, one_thread, progress_counter
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import ROW, FrequencySeries, Hertz, Metres, Quantity, Tabular

# ---- time integration from a solution ----


FEWEST = LIMITS.look
"""Smallest number of periods of a mean and a range."""


def march_from(ring: Ring, u: NDArray, omega: float, steps: int | None = None) -> March:
    """Return a time integration from a solution (n_unknowns,) with a disturbance of every nodal diameter."""
    march = March(ring, omega, u, steps)
    return March(ring, omega, ring.seeded(march.motion, CRITERIA.seed, 0), march.steps)


def described(march: March, preload: float, status: str, **more: Any) -> TimeResponse:
    """Return the result of a time integration, with mean and range over the second half of its periods."""
    amplitude = second_half(march.amplitude)
    return TimeResponse(
        float(amplitude.mean()), float(amplitude.min()), float(amplitude.max()), march.omega / (2.0 * np.pi), preload,
        status=status, periods=len(march.harmonics), diameters=march.ring.nodal_diameters, harmonics=march.response,
        repeats_after=repeats_after(march.response), **of_blades(march, len(amplitude)), **{"balance": np.nan, **more},
    )  # fmt: skip


def settled(march: March, preload: float, periods: int = 200, progress: bool = False, **more: Any) -> TimeResponse:
    """Integrate whole periods of the excitation and return the result; ``more`` are further fields.

    Raises
    ------
    SettingError
        If there are too few periods.
    MarchFailed
        If the time integration fails.
    """
    watch = CostMeter()
    stopped = march.run(validation.integer("periods", periods, least=FEWEST), progress)
    if stopped and len(march.harmonics) < FEWEST:
        raise KeyboardInterrupt
    change = to_come(march.amplitude, march.memory)
    status, text = COMPLETE, f"estimated change of the mean still to come {100.0 * change:+.2g} %"
    if abs(change) > LIMITS.drift:
        longer = int(np.ceil(march.memory * np.log(abs(change) / LIMITS.drift) / 10.0)) * 10
        status = with_reason(INCOMPLETE, f"still moving, {text}; some {longer} more periods would settle it")
    status = INTERRUPTED if stopped else status
    return described(march, preload, status, cost=watch.read(march.ring.cost), **more)


def verified(
    march: March, expected: NDArray, preload: float = np.nan, tolerance: float = LIMITS.tolerance,
    periods: int = LIMITS.most, progress: bool = False, **more: Any,
) -> TimeResponse:  # fmt: skip
    """Integrate until it is decided whether the motion keeps the response ``expected`` (n_harmonics + 1,) complex, m.

    Raises
    ------
    MarchFailed
        If the time integration fails.
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
    """Integrate in time for a number of periods and return the resulting response.

    It applies to frequencies without a solution, or without a stable one.  A rattling damper may have no periodic response;
    mean and range of the amplitude describe it (:mod:`bdamper.time_domain.transients`).

    Parameters
    ----------
    problem : Problem
    start : ResponseCurve
        Response curve; the integration starts from the solution closest in frequency.
    frequency : float, Hz, optional
        Default: the middle of the widest gap of the curve.
    periods : int
        Periods of the excitation.  A transient of a mode with damping ratio ``zeta`` takes about ``1/(2 zeta)`` periods.
    steps_per_period : int, optional
        256 by default.
    progress : bool
        Show a progress bar.

    Returns
    -------
    TimeResponse
        "incomplete" while the mean changes.  After Ctrl-C the result of the periods so far, at least 16.

    Raises
    ------
    SettingError
        If no frequency is given for a curve without gap, or an argument is not valid.
    MarchFailed
        If the time integration fails.
    """
    if frequency is not None:
        frequency = validation.number("frequency", frequency, above=0.0, unit="Hz")
    check_curve(problem, start, "start")
    validation.check_value(len(start), "start", "a curve with points", f"no points ({start.status}: {start.reason})")
    if frequency is None:
        if start.gap is None:
            raise validation.invalid("frequency", "a value in Hz, since the curve has no gap to start in", None)
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
    tolerance: float = LIMITS.tolerance,
    periods: int = LIMITS.most,
    steps_per_period: int | None = None,
    progress: bool = False,
) -> TimeResponse:
    """Integrate in time from a point of a response curve and decide whether the motion agrees with it.

    All sectors are included, each with its contacts; there is no truncated Fourier series and no assumption of a travelling
    wave (:mod:`bdamper.time_domain.transients`).  The integration ends with the decision, usually after 48 to 200 periods.

    Parameters
    ----------
    problem : Problem
    curve : ResponseCurve
        Response curve of this problem.
    index : int, optional
        Index of the point; the largest response by default.
    tolerance : float
        Largest relative difference of the amplitude.
    periods : int
        Largest number of periods of the excitation.
    steps_per_period : int, optional
        1,024 by default.
    progress : bool
        Show a progress bar of the periods, with the remaining time.

    Returns
    -------
    TimeResponse
        ``verdict`` is "agrees", "does not agree" or "undecided".  After Ctrl-C the result of the periods so far.

    Raises
    ------
    SettingError, MarchFailed
        If the settings do not describe a structure in time or a number is not valid; if the time integration fails.
    """
    check_curve(problem, curve)
    i = curve.peak_index if index is None else validation.integer("index of a point", index, -len(curve), len(curve) - 1)
    system, u, omega = problem.system(curve.preload), curve.unknowns[i], 2.0 * np.pi * float(curve.frequency[i])
    steps = LIMITS.steps if steps_per_period is None else steps_per_period
    march = march_from(ring_of(problem, curve.preload), u, omega, steps)
    return verified(march, system.response(u), curve.preload, tolerance, periods, progress, **problem.recorded())


# ---- slow sweep of frequency ----


RATE = 0.1
"""Change of the frequency within the decay time of a transient, in half bandwidths of the least damped mode."""
SETTLING = np.ceil(-np.log(LIMITS.drift))
"""Decay times at the first frequency before the sweep, until a transient has settled."""
JUMP = 0.2
"""Relative change of the amplitude within one decay time that counts as a jump; a linear resonance changes by RATE/2."""
AFTER_JUMP = 4.0
"""Decay times after a jump until its transient has decayed."""
NEAR = 1e-4
"""Half the relative width of the interval of the first solution."""


@short_repr
@dataclass(frozen=True)
class TimeSweep(Plottable, FrequencySeries, Tabular, Recorded, Storable, kind="bdamper-time-sweep", row="turn"):
    """Response in a slow sweep of frequency in time, period by period.

    ``plot`` draws amplitude over frequency, also over response curves (:func:`bdamper.plot.plot_frequency_sweep`).

    Parameters
    ----------
    frequency : (n,) float, Hz
        In the middle of each period of the excitation, in the order of time.
    harmonics : (n, n_harmonics + 1) complex, m
        Response amplitudes of the highest blade in each period; the first column is the mean.
    preload : float, N
    rate : float, Hz/s
        Positive upward.
    memory : float, s
        Decay time to 1/e of a transient of the least damped mode.
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
        """Whether the frequency increases."""
        return self.rate > 0.0

    @property
    def mean(self) -> Metres:
        """(n,) float, m: mean position."""
        return self.harmonics[:, 0].real

    @property
    def highest(self) -> tuple[float, float]:
        """Frequency (Hz) and amplitude (m) of the largest response."""
        i = int(self.amplitude.argmax())
        return float(self.frequency[i]), float(self.amplitude[i])

    @property
    def jumps(self) -> tuple[Jump, ...]:
        """Changes of the amplitude by more than a fifth within the decay time of a transient that last, in the order of
        time.

        Amplitudes before and after are means over a decay time, the latter after the transient has decayed.  Scatter, as of
        a rattling damper, is no jump.
        """
        a, m, jumps = self.amplitude, self._turns(1.0), []
        log = np.log(np.maximum(a, 1e-300))
        fast = np.flatnonzero(np.abs(log[m:] - log[:-m]) > np.log1p(JUMP))
        for part in np.split(fast, np.flatnonzero(np.diff(fast) > m) + 1) if len(fast) else ():
            first = int(part[0])
            begins = first + int((np.abs(log[first:] - log[first]) > 0.5 * np.log1p(JUMP)).argmax())
            later = min(int(part[-1]) + m + self._turns(AFTER_JUMP), len(a) - m)
            before, after = (float(a[k : k + m].mean()) for k in (max(0, first - m + 1), later))
            if abs(np.log(after / before)) > np.log1p(JUMP):
                jumps.append(Jump(float(self.frequency[begins]), before, after))
        return tuple(jumps)

    def _turns(self, memories: float) -> int:
        return max(1, round(memories * self.memory * float(self.frequency.mean())))

    def _headline(self) -> str:
        f, a = self.highest
        way = f"from {amount(self.frequency[0], 'Hz')} to {amount(self.frequency[-1], 'Hz')}"
        jumps = f"; it jumps at {', '.join(amount(j.frequency, 'Hz') for j in self.jumps)}" if self.jumps else ""
        return f"Sweep in time {way}, preload {amount(self.preload, 'N')}: highest {peak_text(a, f)}{jumps}."

    def _facts(self) -> tuple[Fact, ...]:
        """Return rate and jumps."""
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
    """Integrate in time while the frequency of the excitation changes slowly over an interval.

    All sectors are included, each with its contacts; there is no truncated Fourier series and no assumption of a travelling
    wave.  The integration includes all nodal diameters of the model.  It starts at the lowest solution at the first
    frequency that is not between folds, and settles there before the sweep begins.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    frequency : (low, high), Hz
    up : bool
        Whether the frequency increases.
    rate : float, Hz/s, optional
        Default: a tenth of the half bandwidth of the least damped mode within the decay time of its transients.
    steps_per_period : int, optional
        256 by default.
    progress : bool
        Show a progress bar of the periods of the excitation.

    Returns
    -------
    TimeSweep
        After Ctrl-C the periods so far.

    Raises
    ------
    SettingError
        If a number is not valid, a mode has no damping, or the settings do not describe a structure in time.
    BdamperError
        If no solution is found at the first frequency, or the time integration fails.
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
    """Return the initial solution and its frequency (Hz)."""
    start = frequency_response(problem, preload, (first * (1.0 - NEAR), first * (1.0 + NEAR)))
    if not len(start):
        raise BdamperError(f"no solution to start from at {first:g} Hz ({start.status}: {start.reason})")
    i = int(np.where(start.backward, np.inf, start.amplitude).argmin())
    return start.unknowns[i], float(start.frequency[i])


def _marched(march: March, ends: tuple[float, float], settling: int, turns: int, progress: bool) -> NDArray:
    """Return the harmonics of the highest blade in each period of the sweep, after the motion has settled at its first
    frequency.
    """
    first, last = TWO_PI * ends[0], TWO_PI * ends[1]
    harmonics: list[NDArray] = []
    with LongWork(), progress_counter(progress, settling + turns, 0, "marching", "turn") as count:
        march.sweep((first, first), settling, count)
        sweep = March(march.ring, first, march.motion, march.steps)
        harmonics = sweep.harmonics
        sweep.sweep((first, last), turns, count)
    return np.array([x[np.abs(x[:, 1]).argmax()] for x in harmonics])
