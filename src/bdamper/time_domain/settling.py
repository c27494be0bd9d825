"""What a motion comes to that starts at a point of a response curve: where it settles, and whether it stays there.

All sectors are marched from the solution (:mod:`bdamper.time_domain.steady_amplitude`) with a disturbance of every nodal
diameter.  If the response amplitudes of the periods stay the same the response is periodic; if they repeat after some
periods it is subharmonic; otherwise, as for a damper that rattles in its seat, it is irregular and is described by a mean
and a range. Both are those of the highest blade over the second half of the periods.

:func:`settle` marches a number of periods, for frequencies at which harmonic balance has no solution or none that is
stable.  :func:`verify` marches until ``bdamper.time_domain.march.judged`` says whether the amplitude stays that of
the solution; a growth that shows only after hundreds of periods is beyond it, as it is beyond a test.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.problem import Problem
from bdamper.response.curve import ResponseCurve
from bdamper.response.march_result import TimeResponse
from bdamper.response.response_curve import check_curve
from bdamper.time_domain.integration import Ring, ring_of
from bdamper.time_domain.march import BOUNDS, UNDECIDED, March, judged, repeats_after, second_half, to_come
from bdamper.time_domain.steady_amplitude import RULES, of_blades
from bdamper.util import validation
from bdamper.util.cost import CostMeter
from bdamper.util.status import COMPLETE, INCOMPLETE, INTERRUPTED, because
from bdamper.util.threading import one_thread

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
    stopped = march.run(validation.whole("periods", periods, least=FEWEST), progress)
    if stopped and len(march.harmonics) < FEWEST:
        raise KeyboardInterrupt
    change = to_come(march.amplitude, march.memory)
    status, text = COMPLETE, f"estimated change of the mean still to come {100.0 * change:+.2g} %"
    if abs(change) > BOUNDS.drift:
        longer = int(np.ceil(march.memory * np.log(abs(change) / BOUNDS.drift) / 10.0)) * 10
        status = because(INCOMPLETE, f"still moving, {text}; some {longer} more periods would settle it")
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
    periods = validation.whole("periods", periods, least=1)
    tolerance = validation.number("tolerance", tolerance, above=0.0, most=1.0)
    watch, size = CostMeter(), float(abs(expected[1]))

    def verdict_so_far() -> tuple[str, str]:
        return judged(march.amplitude, size, tolerance, march.memory)

    stopped = march.run(periods, progress, lambda: verdict_so_far()[0] != UNDECIDED)
    if not march.harmonics:
        raise KeyboardInterrupt
    verdict, reason = verdict_so_far()
    distance = np.linalg.norm((march.response[-1] - expected)[1:]) / max(float(np.linalg.norm(expected[1:])), 1e-300)
    status = INTERRUPTED if stopped else because(INCOMPLETE, "undecided") if verdict == UNDECIDED else COMPLETE
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
    periodic response at all, and is described by a mean amplitude and a range (:mod:`bdamper.time_domain.settling`).

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
    validation.that(len(start), "start", "a curve with points", f"one without ({start.status}: {start.reason})")
    if frequency is None:
        if start.gap is None:
            raise validation.unfit("frequency", "one in Hz, as the curve has a solution at each", None)
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
    (:mod:`bdamper.time_domain.settling`).  The march ends as soon as it is decided, most often after 48 to 200 periods.

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
    i = curve.peak.index if index is None else validation.whole("index of a point", index, -len(curve), len(curve) - 1)
    system, u, omega = problem.system(curve.preload), curve.unknowns[i], 2.0 * np.pi * float(curve.frequency[i])
    steps = BOUNDS.steps if steps_per_period is None else steps_per_period
    march = march_from(ring_of(problem, curve.preload), u, omega, steps)
    return verified(march, system.response(u), curve.preload, tolerance, periods, progress, **problem.recorded())
