"""Slow sweep of the excitation frequency by time integration.

The frequency changes linearly with time from one end of an interval to the other, as on a test rig.
Among several stable solutions the sweep follows its branch until it ends, and then jumps; it leaves
unstable solutions.  A transient of the least damped mode, with the half-bandwidth ``b = zeta f``,
decays to 1/e within ``1/(2 pi b)``.  The default rate changes the frequency by RATE half-bandwidths
in this time: ``rate = RATE b 2 pi b``.  The lag of a response behind its steady value is
proportional to the rate, so a sweep at twice the rate estimates the error.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.problem import Problem
from bdamper.response.continuation import TWO_PI
from bdamper.response.response_curve import Jump, frequency_response
from bdamper.time_domain.integration import TimeLimit, TimeSpent, all_sectors
from bdamper.time_domain.transient import CRITERIA, Transient, energy_error
from bdamper.util import validation
from bdamper.util.display import Fact, Plottable, Result
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, BdamperError, SettingError
from bdamper.util.formatting import amount, peak_text, percent, short_repr
from bdamper.util.progress import (
    Cost,
    CostMeter,
    LongWork,
    one_thread,
    progress_counter,
    shows_progress,
)
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import ROW, FrequencySeries, Hertz, Metres, Quantity, Tabular

RATE = 0.1
"""Change of the frequency within the decay time of a transient, in half bandwidths of the least
damped mode.
"""
SETTLING = np.ceil(-np.log(CRITERIA.drift))
"""Decay times at the first frequency before the sweep, until a transient has settled."""
JUMP = 0.2
"""Relative change of the amplitude within one decay time that counts as a jump; a linear resonance
changes by RATE/2.
"""
AFTER_JUMP = 4.0
"""Decay times after a jump until its transient has decayed."""
SWEEP_SECONDS = 3600.0
"""Processor time of a sweep, whose length is known before it begins; a sweep at the default rate
over a wide interval takes long.
"""
NEAR = 1e-4
"""Half the relative width of the interval of the first solution."""


@short_repr
@dataclass(frozen=True)
class TimeSweep(
    Result,
    Plottable,
    FrequencySeries,
    Tabular,
    Recorded,
    Storable,
    kind="bdamper-time-sweep",
    row="turn",
):
    """Response in a slow frequency sweep by time integration, period by period.

    ``plot`` draws the amplitude against frequency, optionally on top of response curves
    (:func:`bdamper.plot.plot_frequency_sweep`).

    Parameters
    ----------
    frequency : (n,) float, Hz
        Frequency in the middle of each excitation period, in chronological order.
    harmonics : (n, n_harmonics + 1) complex, m
        Response amplitudes of the blade with the largest amplitude in each period; the first column
        is the mean.
    preload : float, N
    rate : float, Hz/s
        Positive upward.
    memory : float, s
        Decay time to 1/e of a transient of the least damped mode.
    steps_per_period, sectors : int
    status : {"complete", "incomplete", "interrupted"}
        "incomplete" if the time steps are too long for the energy to balance, or the processor time
        is used up.
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
    # without a default, unlike that of the base class
    status: str = field()
    reason: str = field()
    cost: Cost

    @property
    def up(self) -> bool:
        """Whether the frequency increases."""
        return self.rate > 0.0

    @property
    def mean(self) -> Metres:
        """Mean position (n,), m."""
        return self.harmonics[:, 0].real

    @property
    def highest(self) -> tuple[float, float]:
        """Frequency (Hz) and amplitude (m) of the largest response."""
        i = int(self.amplitude.argmax())
        return float(self.frequency[i]), float(self.amplitude[i])

    @property
    def jumps(self) -> tuple[Jump, ...]:
        """Jumps in the order of time: lasting changes of the amplitude by more than a fifth within
        the decay time.

        The amplitudes before and after a jump are means over a decay time; the second mean begins
        when the transient has decayed.  Scatter, for example of a rattling damper, does not count
        as a jump.
        """
        amplitude = self.amplitude
        log_amplitude = np.log(np.maximum(amplitude, 1e-300))
        threshold = np.log1p(JUMP)
        # a window contains the periods of one decay time; the index of its first period names it
        window = self._turns(1.0)
        change_in_window = np.abs(log_amplitude[window:] - log_amplitude[:-window])
        fast_windows = np.flatnonzero(change_in_window > threshold)
        if not len(fast_windows):
            return ()

        # windows with a gap between them belong to different jumps
        gaps = np.flatnonzero(np.diff(fast_windows) > window) + 1
        jumps = []
        for windows_of_jump in np.split(fast_windows, gaps):
            start = int(windows_of_jump[0])
            end = int(windows_of_jump[-1]) + window
            # the jump is where the amplitude has changed by half the threshold since the start
            change_since_start = np.abs(log_amplitude[start:] - log_amplitude[start])
            begin = start + int((change_since_start > 0.5 * threshold).argmax())

            # means over a decay time: up to the start, and after the transient has decayed
            before_from = max(0, start - window + 1)
            after_from = min(end + self._turns(AFTER_JUMP), len(amplitude) - window)
            before = float(amplitude[before_from : before_from + window].mean())
            after = float(amplitude[after_from : after_from + window].mean())
            if abs(np.log(after / before)) > threshold:
                frequency = float(self.frequency[begin])
                jumps.append(Jump(frequency=frequency, before=before, after=after))
        return tuple(jumps)

    def _turns(self, memories: float) -> int:
        """Return the number of periods in a number of decay times, at least one."""
        mean_frequency = float(self.frequency.mean())
        return max(1, round(memories * self.memory * mean_frequency))

    def _statement(self) -> Statement:
        frequency, amplitude = self.highest
        first = amount(float(self.frequency[0]), "Hz")
        last = amount(float(self.frequency[-1]), "Hz")
        verdict = f"Highest amplitude {peak_text(amplitude, frequency)}: sweep by time integration"
        rows = [Row("Sweep", f"{first} to {last}", f"at {amount(abs(self.rate), 'Hz/s')}")]
        rows += [
            Row(
                "Jump",
                amount(jump.frequency, "Hz"),
                f"{amount(jump.before, 'm')} to {amount(jump.after, 'm')}",
            )
            for jump in self.jumps
        ]
        return Statement([f"{verdict}, preload {amount(self.preload, 'N')}"], rows)

    def _facts(self) -> tuple[Fact, ...]:
        """Return rate and jumps."""
        rate = Fact("rate", abs(self.rate), "Hz/s")
        jumps = [Fact("jump", str(jump)) for jump in self.jumps]
        return (rate, *jumps)


@one_thread
def frequency_sweep(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    up: bool = True,
    rate: float | None = None,
    steps_per_period: int | None = None,
    seconds: float = SWEEP_SECONDS,
    progress: bool | None = None,
) -> TimeSweep:
    """See :meth:`bdamper.Study.frequency_sweep`."""
    preload = problem.check_preload(preload)
    low, high = validation.interval("frequency", frequency)
    progress = shows_progress(progress)
    validation.flag("up", up)
    if rate is not None:
        rate = validation.number("rate", rate, above=0.0, unit="Hz/s")
    limit = TimeLimit(validation.number("seconds", seconds, above=0.0, unit="s"))
    watch = CostMeter()
    first, last = (low, high) if up else (high, low)
    solution, solution_frequency = _start(problem, preload, first)
    sectors = all_sectors(problem, preload, limit=limit)
    transient = Transient(sectors, TWO_PI * solution_frequency, solution, steps_per_period)

    # twice the decay rate, 1/s, of the least damped mode: 4 pi b with the half bandwidth b (Hz)
    damping = sectors.least_damping
    if not 0.0 < damping < np.inf:
        raise SettingError(
            "frequency_sweep: every mode of the structure needs damping, and one is undamped"
        )
    # time (s) after which the least damped mode has forgotten its start by a factor of e
    memory = 2.0 / damping
    if rate is None:
        # RATE half bandwidths b in the time 1/(2 pi b): RATE b 2 pi b with b = damping/(4 pi)
        rate = RATE * damping**2 / (8.0 * np.pi)
    mean_frequency = 0.5 * (low + high)
    # periods in the time of the sweep, and before it until the start has been forgotten
    turns = max(1, round(mean_frequency * (high - low) / rate))
    settling = max(1, round(SETTLING * memory * first))
    sweep, spent = _integrated(transient, (first, last), settling, turns, progress)
    done = len(sweep.harmonics)
    if not done:
        # without a single period there is no result to keep
        if spent:
            raise TimeSpent(f"{spent} before the sweep began; {limit.remedy}")
        raise KeyboardInterrupt

    # of each period the blade with the largest first harmonic
    of_highest_blade = []
    for harmonics in sweep.harmonics:  # (n_blades, n_harmonics + 1)
        highest_blade = np.abs(harmonics[:, 1]).argmax()
        of_highest_blade.append(harmonics[highest_blade])
    missing = f"{spent} after {done} of {turns} turns; {limit.remedy}" if spent else ""
    status, reason = _status(sweep, turns, missing)
    # the square of the frequency is linear in the number of periods; in the middle of each period
    along = (np.arange(done) + 0.5) / turns
    squared_frequency = first**2 + (last**2 - first**2) * along
    return TimeSweep(
        frequency=np.sqrt(squared_frequency),
        harmonics=np.array(of_highest_blade),
        preload=preload,
        rate=rate if up else -rate,
        memory=memory,
        steps_per_period=transient.steps,
        sectors=sectors.n,
        status=status,
        reason=reason,
        cost=watch.read(sectors.cost),
        settings=problem.record(),
        model_hash=problem.model.hash,
    )


def _status(sweep: Transient, turns: int, missing: str) -> tuple[str, str]:
    """Return the status of a sweep that was to have a number of periods, and its reason.

    ``missing`` gives the turns that the limit of the processor time has left out, or is empty.
    """
    done = len(sweep.harmonics)
    if done < turns and not missing:
        return INTERRUPTED, f"by the user after {done} of {turns} turns"
    error = energy_error(sweep, done)
    # an error that is no number does not pass either
    if not error <= CRITERIA.energy:
        remedy = f"use steps_per_period={4 * sweep.steps}"
        wrong_energy = f"the time steps change its energy by {percent(error)}; {remedy}"
        return INCOMPLETE, "; ".join(filter(None, [missing, wrong_energy]))
    return (INCOMPLETE, missing) if missing else (COMPLETE, "")


def _start(problem: Problem, preload: float, first: float) -> tuple[NDArray, float]:
    """Return the initial solution and its frequency (Hz)."""
    around_first = (first * (1.0 - NEAR), first * (1.0 + NEAR))
    start = frequency_response(problem, preload, around_first)
    if not len(start):
        raise BdamperError(
            f"frequency sweep: no initial solution at {first:g} Hz ({start.status}: {start.reason})"
        )
    # the lowest solution; backward stretches of a curve are unstable
    forward_amplitude = np.where(start.backward, np.inf, start.amplitude)
    lowest = int(forward_amplitude.argmin())
    return start.unknowns[lowest], float(start.frequency[lowest])


def _integrated(
    transient: Transient, ends: tuple[float, float], settling: int, turns: int, progress: bool
) -> tuple[Transient, str]:
    """Let the motion settle at the first frequency, then sweep.

    Returns
    -------
    sweep : Transient
    spent : str
        That the processor time is used up, or "".
    """
    first = TWO_PI * ends[0]
    last = TWO_PI * ends[1]
    periods = settling + turns
    # without periods, if the user interrupts while the motion settles
    sweep = Transient(transient.sectors, first, transient.motion, transient.steps)
    with (
        LongWork(),
        progress_counter(progress, periods, 0, "time integration", "period") as count,
    ):
        transient.omega = first
        try:
            transient.sweep(first, settling, count)
            sweep = Transient(transient.sectors, first, transient.motion, transient.steps)
            sweep.sweep(last, turns, count)
        except TimeSpent as spent:
            return sweep, str(spent)
    return sweep, ""
