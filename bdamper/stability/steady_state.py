"""Steady response by time integration, where harmonic balance has no solution or an unstable one.

The equations of all sectors are marched from a state (:mod:`bdamper.stability.march`).  If the response amplitudes of the
periods stay the same the response is periodic; if they repeat after some periods it is subharmonic; otherwise, as for a
damper that rattles in its seat, it is irregular and is described by a mean and a range.  Both are those of the second half
of the periods.

:func:`settle` takes a problem and a curve; :func:`settled` takes a march.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.continuation.track import check_curve
from bdamper.problem.problem import Problem, matching
from bdamper.stability.disturbances import TWO_PI
from bdamper.stability.march import BOUNDS, UNDECIDED, March, repeats_after, second_half, to_come
from bdamper.stability.time_integration import Motion, ring_of
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, Stopwatch
from bdamper.util.errors import BdamperError
from bdamper.util.plotting import Plottable, draw
from bdamper.util.repr import brief
from bdamper.util.tables import ROW, Amplitude, Numbers, Quantity, Tabular
from bdamper.util.text import amount

FEWEST = BOUNDS.look
"""Least number of periods from which a mean and a range are taken."""


@brief
@dataclass(frozen=True)
class SettledResponse(Plottable, Tabular, row="period"):
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
        The last where contact forces were not found in some step.
    reason : str
    motion : Motion
        At the end, from which :meth:`bdamper.Study.settle` goes on.
    cost : Cost
    model_hash : str
    """

    frequency: float
    preload: float
    harmonics: Annotated[NDArray, Quantity("m", dims=(ROW, "harmonic"))]
    memory: float
    steps_per_period: int
    sectors: int
    status: str
    reason: str
    motion: Motion
    cost: Cost
    model_hash: str = ""

    @property
    def period(self) -> Numbers:
        """(n_periods,) int."""
        return np.arange(len(self.harmonics))

    @property
    def mean_position(self) -> Annotated[NDArray, Quantity("m", name="mean")]:
        """(n_periods,) float, m."""
        return self.harmonics[:, 0].real

    @property
    def amplitude(self) -> Amplitude:
        """(n_periods,) amplitude of the harmonic of the excitation, m."""
        return np.abs(self.harmonics[:, 1])

    @property
    def mean(self) -> float:
        """Amplitude of the harmonic of the excitation, m, mean over the second half of the periods."""
        return float(second_half(self.amplitude).mean())

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest of these amplitudes, m."""
        last = second_half(self.amplitude)
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

    def bottom_line(self) -> str:
        low, high = self.range
        kind = {None: "irregular", 1: "periodic"}.get(self.repeats_after, f"{self.repeats_after}-periodic")
        reach = f"{amount(low, 'm')} to {amount(high, 'm')}"
        at = f"{amount(self.frequency, 'Hz')}, preload {amount(self.preload, 'N')}"
        return (
            f"In time the response comes to {amount(self.mean, 'm')} on average ({reach}, {kind}) at {at}; {self.status}."
        )

    def mark(self, ax: Any) -> Any:
        """Draw mean and range as one point with a bar over response curves (:func:`bdamper.plot.mark_settled`)."""
        return draw(self, "mark", ax)


def settled(
    march: March, preload: float, periods: int = 200, progress: bool = False, model_hash: str = ""
) -> SettledResponse:
    """What a march over whole periods of the excitation comes to.

    Parameters
    ----------
    march : March
        At its start.
    preload : float, N
        For the record.
    periods : int
    progress : bool
        Show a bar of the periods.
    model_hash : str
        For the record.

    Raises
    ------
    SettingError
        If there are too few periods to judge.
    BdamperError
        If the march overflows.
    """
    watch = Stopwatch()
    stopped = march.run(validate.whole("periods", periods, least=FEWEST), progress)
    if march.overflowed:
        raise BdamperError(f"the march overflows in period {len(march.harmonics)}: raise steps_per_period")
    if stopped and len(march.harmonics) < FEWEST:
        raise KeyboardInterrupt
    change, ring = to_come(march.amplitude, march.memory), march.ring
    status = "interrupted" if stopped else UNDECIDED if ring.unsolved else _status(change)
    return SettledResponse(
        frequency=march.omega / TWO_PI,
        preload=preload,
        harmonics=np.array(march.harmonics),
        memory=march.memory,
        steps_per_period=march.steps,
        sectors=ring.n,
        status=status,
        reason=ring.unsolved or _reason(change, march.memory),
        motion=march.motion,
        cost=replace(ring.cost, **watch.read()),
        model_hash=model_hash,
    )


def _status(change: float) -> str:
    return "settled" if abs(change) <= BOUNDS.drift else "still moving"


def _reason(change: float, memory: float) -> str:
    """What is still to come, and the periods until that is little."""
    text = f"estimated change of the mean still to come {100.0 * change:+.2g} %, memory {memory:.3g} periods"
    if abs(change) <= BOUNDS.drift:
        return text
    return f"{text}; some {int(np.ceil(memory * np.log(abs(change) / BOUNDS.drift) / 10.0)) * 10} more would settle it"


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
        256 by default.
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
        problem = matching(problem, start.settings)
    if frequency is not None:
        frequency = validate.number("frequency", frequency, above=0.0, unit="Hz")
    if isinstance(start, Curve):
        check_curve(problem, start)
        validate.that(len(start), "start", "a curve with points", f"one without ({start.status}: {start.reason})")
        if frequency is None:
            if start.gap is None:
                raise validate.unfit("frequency", "one in Hz, as the curve has a solution at each", None)
            frequency = float(np.mean(start.gap))
        state: NDArray | Motion = start.unknowns[int(np.abs(start.frequency - frequency).argmin())]
    else:
        validate.that(start.model_hash == problem.model.hash, "start", "a response of this study", "one of another model")
        frequency = start.frequency if frequency is None else frequency
        state = start.motion
    march = March(ring_of(problem, start.preload), TWO_PI * frequency, state, steps_per_period)
    return settled(march, start.preload, periods, progress, problem.model.hash)
