"""Slow sweep of the excitation frequency in time.

The frequency changes linearly in time from one end of an interval to the other, as on a test rig.  Among several stable
solutions the sweep follows its branch until it ends, and then jumps; it leaves unstable solutions.  A transient of the
least damped mode, with half bandwidth ``b = zeta f``, falls to 1/e within ``1/(2 pi b)``.  The default rate moves the
frequency by RATE half bandwidths in this time: ``rate = RATE b 2 pi b``.  The lag of a response behind its steady value is
proportional to the rate, so a sweep at twice the rate estimates the error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.problem import Problem
from bdamper.response.continuation import TWO_PI
from bdamper.response.response_curve import Jump, frequency_response
from bdamper.time_domain.integration import ring_of
from bdamper.time_domain.transient import CRITERIA, Transient, energy_error
from bdamper.util import validation
from bdamper.util.display import Fact, Plottable
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
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import ROW, FrequencySeries, Hertz, Metres, Quantity, Tabular

RATE = 0.1
"""Change of the frequency within the decay time of a transient, in half bandwidths of the least damped mode."""
SETTLING = np.ceil(-np.log(CRITERIA.drift))
"""Decay times at the first frequency before the sweep, until a transient has settled."""
JUMP = 0.2
"""Relative change of the amplitude within one decay time that counts as a jump; a linear resonance changes by RATE/2."""
AFTER_JUMP = 4.0
"""Decay times after a jump until its transient has decayed."""
NEAR = 1e-4
"""Half the relative width of the interval of the first solution."""


@short_repr
@dataclass(frozen=True)
class TimeSweep(
    Plottable, FrequencySeries, Tabular, Recorded, Storable, kind="bdamper-time-sweep", row="turn"
):
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
    status : {"complete", "incomplete", "interrupted"}
        "incomplete" if the time steps are too long for the energy to balance.
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
        """Mean position (n,), m."""
        return self.harmonics[:, 0].real

    @property
    def highest(self) -> tuple[float, float]:
        """Frequency (Hz) and amplitude (m) of the largest response."""
        i = int(self.amplitude.argmax())
        return float(self.frequency[i]), float(self.amplitude[i])

    @property
    def jumps(self) -> tuple[Jump, ...]:
        """Jumps in the order of time: lasting changes of the amplitude by more than a fifth within the decay time.

        The amplitudes before and after a jump are means over a decay time; the second mean begins when the transient has
        decayed.  Scatter, for example of a rattling damper, does not count as a jump.
        """
        amplitude = self.amplitude
        memory = self._turns(1.0)
        threshold = np.log1p(JUMP)
        log = np.log(np.maximum(amplitude, 1e-300))
        fast = np.flatnonzero(np.abs(log[memory:] - log[:-memory]) > threshold)
        if not len(fast):
            return ()

        # fast changes that are further apart than the decay time belong to different jumps
        separations = np.flatnonzero(np.diff(fast) > memory) + 1
        jumps = []
        for part in np.split(fast, separations):
            first, last = int(part[0]), int(part[-1])
            change = np.abs(log[first:] - log[first])
            begins = first + int((change > 0.5 * threshold).argmax())

            earlier = max(0, first - memory + 1)
            later = min(last + memory + self._turns(AFTER_JUMP), len(amplitude) - memory)
            before = float(amplitude[earlier : earlier + memory].mean())
            after = float(amplitude[later : later + memory].mean())
            if abs(np.log(after / before)) > threshold:
                jumps.append(Jump(float(self.frequency[begins]), before, after))
        return tuple(jumps)

    def _turns(self, memories: float) -> int:
        return max(1, round(memories * self.memory * float(self.frequency.mean())))

    def _headline(self) -> str:
        f, a = self.highest
        way = f"from {amount(self.frequency[0], 'Hz')} to {amount(self.frequency[-1], 'Hz')}"
        jumps = (
            f"; it jumps at {', '.join(amount(j.frequency, 'Hz') for j in self.jumps)}"
            if self.jumps
            else ""
        )
        return f"Sweep in time {way}, preload {amount(self.preload, 'N')}: highest {peak_text(a, f)}{jumps}."

    def _facts(self) -> tuple[Fact, ...]:
        """Return rate and jumps."""
        return (
            Fact("rate", abs(self.rate), "Hz/s"),
            *(Fact("jump", str(jump)) for jump in self.jumps),
        )


@one_thread
def frequency_sweep(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    up: bool = True,
    rate: float | None = None,
    steps_per_period: int | None = None,
    progress: bool | None = None,
) -> TimeSweep:
    """See :meth:`bdamper.Study.frequency_sweep`."""
    preload = problem.check_preload(preload)
    low, high = validation.interval("frequency", frequency)
    progress = shows_progress(progress)
    validation.flag("up", up)
    rate = None if rate is None else validation.number("rate", rate, above=0.0, unit="Hz/s")
    watch = CostMeter()
    ends = (low, high) if up else (high, low)
    u, begin = _start(problem, preload, ends[0])
    ring = ring_of(problem, preload)
    transient = Transient(ring, TWO_PI * begin, u, steps_per_period)
    least = ring.least_damping
    if not 0.0 < least < np.inf:
        raise SettingError(
            "frequency_sweep: expected damping in every mode of the structure, found a mode without"
        )
    memory = 2.0 / least
    if rate is None:
        rate = RATE * least**2 / (8.0 * np.pi)
    turns = max(1, round(0.5 * (low + high) * (high - low) / rate))
    settling = max(1, round(SETTLING * memory * ends[0]))
    sweep = _integrated(transient, ends, settling, turns, progress)
    harmonics = np.array([x[np.abs(x[:, 1]).argmax()] for x in sweep.harmonics])
    done = len(harmonics)
    if not done:
        raise KeyboardInterrupt
    status, reason = COMPLETE, ""
    if not (error := energy_error(sweep, done)) <= CRITERIA.energy:
        status = INCOMPLETE
        reason = f"the time steps change its energy by {percent(error)}; use steps_per_period={4 * sweep.steps}"
    if done < turns:
        status, reason = INTERRUPTED, f"by the user after {done} of {turns} turns"
    along = (np.arange(done) + 0.5) / turns
    return TimeSweep(
        frequency=np.sqrt(ends[0] ** 2 + (ends[1] ** 2 - ends[0] ** 2) * along), harmonics=harmonics, preload=preload,
        rate=rate if up else -rate, memory=memory, steps_per_period=transient.steps, sectors=ring.n,
        status=status, reason=reason, cost=watch.read(ring.cost), settings=problem.record(), model_hash=problem.model.hash,
    )  # fmt: skip


def _start(problem: Problem, preload: float, first: float) -> tuple[NDArray, float]:
    """Return the initial solution and its frequency (Hz)."""
    start = frequency_response(problem, preload, (first * (1.0 - NEAR), first * (1.0 + NEAR)))
    if not len(start):
        raise BdamperError(
            f"no solution to start from at {first:g} Hz ({start.status}: {start.reason})"
        )
    i = int(np.where(start.backward, np.inf, start.amplitude).argmin())
    return start.unknowns[i], float(start.frequency[i])


def _integrated(
    transient: Transient, ends: tuple[float, float], settling: int, turns: int, progress: bool
) -> Transient:
    """Let the motion settle at the first frequency, then sweep; return the sweep."""
    first, last = TWO_PI * ends[0], TWO_PI * ends[1]
    sweep = Transient(transient.ring, first, transient.motion, transient.steps)
    with (
        LongWork(),
        progress_counter(progress, settling + turns, 0, "time integration", "period") as count,
    ):
        transient.omega = first
        transient.sweep(first, settling, count)
        sweep = Transient(transient.ring, first, transient.motion, transient.steps)
        sweep.sweep(last, turns, count)
    return sweep
