"""Steady response by time integration, where harmonic balance has no solution or an unstable one.

The equations of all sectors (:mod:`bdamper.stability.time_integration`) are marched from a state, and each period ``k`` of
the excitation has response amplitudes of its own,

    X_l(k) = 2/T int_kT^(k+1)T x(t) exp(-i l omega t) dt        (half of that for l = 0).

If they stay the same the response is periodic; if they repeat after some periods it is subharmonic; otherwise, as for a
damper that rattles in its seat, it is irregular and is described by a mean and a range.  Both are those of the second half
of the periods.  If the means of the last two quarters differ by ``d``, a transient is left: one that falls by a factor
``p`` from one quarter to the next still changes the mean by ``d p/(1 - p)``, with the ``p`` of the slowest mode.

:func:`settle` takes a problem and a curve; :func:`march_until_settled` takes the equations and a state.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.continuation.track import check_curve
from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.problem.problem import Problem
from bdamper.stability.time_integration import TWO_PI, Motion, Ring, ring_and_steps
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, Stopwatch
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.plotting import Plottable, draw
from bdamper.util.progress import each, passes_interrupts_on
from bdamper.util.repr import brief
from bdamper.util.tables import Column, Tabular

ACCURACY = 0.5
"""Step times the highest frequency of the closed contacts; a fifth of it changes amplitudes on the shipped disk (20 periods
at 500 N) by 1 %."""
REPEATS = 1e-3
"""Largest relative change of the amplitudes up to which they count as repeated."""
MOST_REPEATED = 4
"""Largest number of periods after which a repetition is looked for."""
STILL = 0.01
"""Relative change still to come below which a response has settled."""
FEWEST = 16
"""Least number of periods from which a mean and a range are taken."""


@brief
@dataclass(frozen=True)
class SettledResponse(Plottable, Tabular):
    """The response of the marched structure, period by period.

    ``plot`` draws the amplitude of each period, with mean and range of those that count
    (:func:`bdamper.plot.plot_settled`).

    Parameters
    ----------
    frequency, preload : float, Hz, N
    harmonics : (n_periods, n_harmonics + 1) complex, m
        Response amplitudes of each period; the first column is the mean.
    memory : float
        Periods in which a transient of the least damped mode falls to 1/e.
    steps_per_period, sectors : int
    status : {"settled", "still moving", "interrupted", "undecided"}
        The last where the contact condition of coordinates without mass was not met at some instant.
    reason : str
    motion : Motion
        At the end, from which :meth:`bdamper.Study.settle` goes on.
    cost : Cost
    model_hash : str
    """

    frequency: float
    preload: float
    harmonics: NDArray
    memory: float
    steps_per_period: int
    sectors: int
    status: str
    reason: str
    motion: Motion
    cost: Cost
    model_hash: str = ""

    def _dimension(self) -> str:
        return "period"

    def columns(self) -> dict[str, Column]:
        """A row for each period; the harmonics of the response for xarray."""
        return {
            "period": Column(np.arange(len(self.harmonics))),
            "amplitude": Column(self.amplitude, "m"),
            "mean": Column(self.harmonics[:, 0].real, "m"),
            "harmonics": Column(self.harmonics, "m", ("period", "harmonic")),
        }

    @property
    def amplitude(self) -> NDArray:
        """(n_periods,) amplitude of the harmonic of the excitation, m."""
        return np.abs(self.harmonics[:, 1])

    @property
    def mean(self) -> float:
        """Amplitude of the harmonic of the excitation, m, mean over the second half of the periods."""
        return float(_second_half(self.amplitude).mean())

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest of these amplitudes, m."""
        last = _second_half(self.amplitude)
        return float(last.min()), float(last.max())

    @property
    def to_come(self) -> float:
        """Estimated relative change of the mean amplitude that is still to come."""
        return to_come(self.amplitude, self.memory)

    @property
    def repeats_after(self) -> int | None:
        """Periods of the excitation after which the response repeats: 1 if it is periodic, None if it is irregular."""
        return repeats_after(self.harmonics)

    @property
    def seconds(self) -> float:
        """Wall-clock time in all."""
        return self.cost.seconds

    def __str__(self) -> str:
        low, high = self.range
        n = len(self.harmonics)
        kind = f"{KINDS[self.repeats_after]} response"
        return (
            f"time integration at {self.frequency:.6g} Hz, preload {self.preload:g} N: {kind}\n"
            f"  |X1| {self.mean:.4g} m on average, {low:.4g} to {high:.4g} m over the last {n - n // 2} of {n} periods\n"
            f"  {self.status}: {self.reason}\n  {self.cost}"
        )

    def mark(self, ax: Any) -> Any:
        """Draw mean and range as one point with a bar over response curves (:func:`bdamper.plot.mark_settled`)."""
        return draw(self, "mark", ax)


KINDS = {None: "irregular", 1: "periodic"} | {n: f"{n}-periodic" for n in range(2, MOST_REPEATED + 1)}


def memory_of(ring: Ring, omega: float) -> float:
    """Periods in which a transient of the least damped mode falls to 1/e; of free bodies contacts take energy alone."""
    rates = ring.damping[ring.omega2 > 0.0]
    return float(omega / (np.pi * max(rates.min(initial=np.inf), 1e-9 * omega)))


def _second_half(x: NDArray) -> NDArray:
    return x[len(x) // 2 :]


def to_come(amplitude: NDArray, memory: float) -> float:
    """Relative change still to come: the last two quarters differ by a transient that falls to 1/e in so many periods."""
    before, last = np.array_split(_second_half(amplitude), 2)
    change = float((last.mean() - before.mean()) / max(float(last.mean()), 1e-300))
    left = np.exp(-len(last) / memory)
    return change * left / (1.0 - left)


def repeats_after(harmonics: NDArray) -> int | None:
    """Least number of periods after which the amplitudes (n_periods, n_harmonics + 1) repeat, over the last quarter."""
    x = harmonics[:, 1:]
    last = np.arange(len(x) - max(1, len(x) // 4), len(x))
    size = max(float(np.linalg.norm(x[last], axis=1).max()), 1e-300)
    for n in range(1, MOST_REPEATED + 1):
        if last[0] >= n and np.linalg.norm(x[last] - x[last - n], axis=1).max() <= REPEATS * size:
            return n
    return None


def march_until_settled(
    system: HarmonicSystem,
    omega: float,
    n_blades: int,
    engine_order: int,
    start: NDArray | Motion,
    *,
    preload: float,
    periods: int = 200,
    steps_per_period: int | None = None,
    progress: bool = False,
    model_hash: str = "",
) -> SettledResponse:
    """March whole periods of the excitation from a state.

    Parameters
    ----------
    system : HarmonicSystem
    omega : float, rad/s
    n_blades, engine_order : int
    start : (n_unknowns,) float or Motion
        A harmonic-balance solution, of whatever frequency, or the motion at the end of an earlier response.
    preload : float, N
        For the record.
    periods : int
    steps_per_period : int, optional
        By default such that the step resolves the stiffest contact.
    progress : bool
        Show a bar of the periods.
    model_hash : str
        For the record.

    Raises
    ------
    SettingError
        If the steps are too long to be stable, there are too few periods to judge, the state is one of another study, or
        the settings describe something else than a structure in time.
    BdamperError
        If the march overflows.
    """
    periods = validate.whole("periods", periods, least=FEWEST)
    watch = Stopwatch()
    ring, n = ring_and_steps(system, omega, n_blades, engine_order, steps_per_period, ACCURACY,
        None if isinstance(start, Motion) else start)
    motion = _fitting(ring, start) if isinstance(start, Motion) else ring.start(start, omega, n)
    found: list[NDArray] = []
    stopped = False
    try:
        for _ in each(range(periods), progress, "marching", "period"):
            motion, amplitudes, *_ = ring.march(motion, omega, n)
            found.append(amplitudes[0])
            if not np.isfinite(motion.q).all():
                raise BdamperError(f"the march overflows in period {len(found)}: raise steps_per_period")
    except KeyboardInterrupt:
        if len(found) < FEWEST or passes_interrupts_on():
            raise
        stopped = True
    harmonics = np.array(found)
    memory = memory_of(ring, omega)
    change = to_come(np.abs(harmonics[:, 1]), memory)
    return SettledResponse(
        frequency=omega / TWO_PI,
        preload=preload,
        harmonics=harmonics,
        memory=memory,
        steps_per_period=n,
        sectors=ring.n,
        status=_status(ring, stopped, change),
        reason=ring.unsolved or _reason(change, memory),
        motion=motion,
        cost=replace(ring.cost, **watch.read()),
        model_hash=model_hash,
    )


def _status(ring: Ring, stopped: bool, change: float) -> str:
    if stopped or ring.unsolved:
        return "interrupted" if stopped else "undecided"
    return "settled" if abs(change) <= STILL else "still moving"


def _reason(change: float, memory: float) -> str:
    """What is still to come, and the periods until that is little."""
    text = f"estimated change of the mean still to come {100.0 * change:+.2g} %, memory {memory:.3g} periods"
    if abs(change) <= STILL:
        return text
    return f"{text}; some {int(np.ceil(memory * np.log(abs(change) / STILL) / 10.0)) * 10} more would settle it"


def _fitting(ring: Ring, motion: Motion) -> Motion:
    """The motion itself, if it is one of this structure."""
    shapes = (2 * ring.n_coordinates,), (ring.n, ring.system.n_points, 2)
    if (motion.q.shape, motion.w.shape) != shapes:
        raise SettingError(
            f"start: expected a motion of this study, {shapes[0]} coordinates and {shapes[1]} sliders, found "
            f"{motion.q.shape} and {motion.w.shape}"
        )
    return motion


@one_thread
def settle(
    problem: Problem,
    start: Curve | SettledResponse,
    frequency: float | None = None,
    *,
    periods: int = 200,
    steps_per_period: int | None = None,
    progress: bool = False,
) -> SettledResponse:
    """March in time until the response has settled, and describe it period by period.

    This is for frequencies at which no solution was found, or none that is stable: a damper that rattles in its seat may
    have no periodic response at all, and is then described by a mean amplitude and a range.  All sectors are included,
    each with its own contacts (:mod:`bdamper.stability.steady_state`).

    Parameters
    ----------
    problem : Problem
    start : Curve or SettledResponse
        A tracking curve of this study, from whose solution nearest in frequency the march starts; or an earlier response,
        to continue it at the same or another frequency.
    frequency : float, Hz, optional
        By default the middle of the widest part of the curve without solutions; or that of the earlier response.
    periods : int
        Of the excitation.  A transient of a mode with the damping ratio ``zeta`` takes about ``1/(2 zeta)`` of them.
    steps_per_period : int, optional
        By default what the stiffest contact asks for.
    progress : bool
        Show a progress bar.

    Returns
    -------
    SettledResponse
        Of the periods that were computed, if Ctrl-C ends the march after the first 16.

    Raises
    ------
    SettingError
        If the curve has a solution at every frequency and none is given, if the settings describe something else than a
        structure in time, or a number does not fit.
    """
    validate.instance("start", start, (Curve, SettledResponse))
    if isinstance(start, Curve):
        problem = problem.matching(start.settings)
    if frequency is not None:
        frequency = validate.number("frequency", frequency, above=0.0, unit="Hz")
    if isinstance(start, Curve):
        check_curve(problem, start)
        if not len(start):
            raise validate.unfit("start", "a curve with points", f"one without ({start.status}: {start.reason})")
        if frequency is None:
            if start.gap is None:
                raise validate.unfit("frequency", "one in Hz, as the curve has a solution at each", None)
            frequency = float(np.mean(start.gap))
        state: NDArray | Motion = start.unknowns[int(np.abs(start.frequency - frequency).argmin())]
    else:
        if start.model_hash != problem.model.hash:
            raise validate.unfit("start", "a response of this study", "one of another model")
        frequency = start.frequency if frequency is None else frequency
        state = start.motion
    return march_until_settled(
        problem.system(start.preload),
        2.0 * np.pi * frequency,
        problem.model.n_blades,
        int(problem.engine_order),
        state,
        preload=start.preload,
        periods=periods,
        steps_per_period=steps_per_period,
        progress=progress,
        model_hash=problem.model.hash,
    )
