"""Steady amplitude in time at preloads of an optimal curve, by time integration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.problem import Problem
from bdamper.response.events import ContinuationOptions
from bdamper.response.optimal_curve import BUDGET
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak
from bdamper.response.response_curve import frequency_response
from bdamper.response.response_curve_result import ResponseCurve, uninterrupted
from bdamper.response.verification import TimeResponse
from bdamper.time_domain import steady_amplitude as in_time
from bdamper.util import validation
from bdamper.util.errors import INTERRUPTED, NOT_FOUND, BdamperError, with_reason
from bdamper.util.formatting import amount
from bdamper.util.progress import LongWork, one_thread, with_progress


def time_response(
    problem: Problem, result: ResponseCurve | Peak, *, steps_per_period: int | None = None, blades: int | None = None,
    starts: int = 1,
) -> TimeResponse:  # fmt: skip
    """Compute the highest steady amplitude in time at the preload of a response curve or of a peak.

    Parameters
    ----------
    problem : Problem
    result : ResponseCurve or Peak
        Result of this study.  For a peak the response curve is computed in its interval.
    steps_per_period : int, optional
        256 by default; the steady motion is integrated again with twice and four times as many.
    blades, starts : int
        Number of blades of the ring, and of initial states (``bdamper.time_domain.steady_amplitude``).

    Returns
    -------
    TimeResponse

    Raises
    ------
    SettingError
        If the result belongs to another study or is no peak, or the settings do not describe a structure in time.
    """
    if isinstance(result, Peak):
        if not result.converged or "frequency" not in result.settings:
            raise validation.invalid("result", "a peak at a preload", result.status)
        peak, what = result, "the highest peak of this study at its preload"
        if peak.model_hash != problem.model.hash:
            raise validation.invalid("result", what, "a peak of another model")
        result = frequency_response(problem, peak.parameter, tuple(peak.settings["frequency"]))
        if not (len(result) and np.isclose(result.peak.amplitude, peak.amplitude, rtol=1e-3, atol=0.0)):
            raise validation.invalid("result", what, f"{amount(peak.amplitude, 'm')} at {peak.frequency:.6g} Hz")
    return in_time.time_response(problem, result, steps_per_period=steps_per_period, blades=blades, starts=starts)


@validation.check_arguments
@one_thread
def with_time_response(
    problem: Problem, curve: OptimalCurve, preload: Sequence[float] | NDArray | None = None, *, progress: bool = False
) -> OptimalCurve:
    """Return the optimal curve with the steady-state amplitude in time at some preloads.

    Parameters
    ----------
    problem : Problem
    curve : OptimalCurve
        Optimal curve of this study.
    preload : sequence of float, N, optional
        The optimum by default.
    progress : bool
        Show a progress bar of the preloads.

    Returns
    -------
    OptimalCurve
        ``time_response`` has a further ``bdamper.response.verification.TimeResponse`` for each preload, in ascending
        order; it gives the reason if no time integration is possible, and is empty without an optimum.  After Ctrl-C
        unfinished preloads have the status "interrupted".

    Raises
    ------
    SettingError
        If the curve belongs to another model.
    """
    validation.instance("curve", curve, OptimalCurve)
    if curve.model_hash != problem.model.hash:
        raise validation.invalid("curve", "an optimal curve of this study", "a curve of another model")
    options = ContinuationOptions(budget=BUDGET)
    if preload is None:
        preloads = [p for p in (curve.optimum.preload,) if np.isfinite(p)]
    else:
        preloads = [float(p) for p in validation.numbers("preload", preload, above=0.0, unit="N")]
    none = {p: TimeResponse(*(np.nan,) * 4, p, np.nan, status=INTERRUPTED) for p in preloads}
    responses, cost = none | {k.preload: k for k in curve.time_response}, curve.cost
    with LongWork():
        for p in with_progress(preloads, progress, "marching in time", "preload"):
            try:
                tracked = uninterrupted(frequency_response(problem, p, curve.settings["frequency"], options=options))
                cost += tracked.cost
                responses[p] = in_time.time_response(problem, tracked)
                cost += responses[p].cost
            except BdamperError as error:
                responses[p] = replace(none[p], status=with_reason(NOT_FOUND, error))
    return replace(curve, time_response=tuple(responses[p] for p in sorted(responses)), cost=cost)
