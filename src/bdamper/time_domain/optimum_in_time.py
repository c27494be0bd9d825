"""Marches in time beside an optimal curve: the highest amplitude in time at some of its preloads."""

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
    """The highest amplitude in time at the preload of a response curve or of a peak
    (``bdamper.time_domain.steady_amplitude``).

    Parameters
    ----------
    problem : Problem
    result : ResponseCurve or Peak
        Of this study.  For a peak the curve is tracked over the interval in which it was searched.
    steps_per_period : int, optional
        256 by default; the steady-state motion is integrated again with twice as many.
    blades, starts : int
        Size of the ring that is marched, and motions to begin from (``bdamper.time_domain.steady_amplitude``).

    Returns
    -------
    TimeResponse

    Raises
    ------
    SettingError
        If it is of another study, is not a peak, or the settings describe something else than a structure in time.
    """
    if isinstance(result, Peak):
        if not result.converged or "frequency" not in result.settings:
            raise validation.invalid("result", "a peak at a preload", result.status)
        found, what = result, "the highest peak of this study at its preload"
        if found.model_hash != problem.model.hash:
            raise validation.invalid("result", what, "one of another model")
        result = frequency_response(problem, found.parameter, tuple(found.settings["frequency"]))
        if not (len(result) and np.isclose(result.peak.amplitude, found.amplitude, rtol=1e-3, atol=0.0)):
            raise validation.invalid("result", what, f"{amount(found.amplitude, 'm')} at {found.frequency:.6g} Hz")
    return in_time.time_response(problem, result, steps_per_period=steps_per_period, blades=blades, starts=starts)


@validation.check_arguments
@one_thread
def with_time_response(
    problem: Problem, curve: OptimalCurve, preload: Sequence[float] | NDArray | None = None, *, progress: bool = False
) -> OptimalCurve:
    """The optimal curve with the steady-state amplitude in time at some preloads.

    Parameters
    ----------
    problem : Problem
    curve : OptimalCurve
        Of this study.
    preload : sequence of float, N, optional
        Its optimum by default.
    progress : bool
        Show a bar of the preloads.

    Returns
    -------
    OptimalCurve
        With a ``bdamper.response.verification.TimeResponse`` for each in ``time_response``, by rising preload, besides
        those that it had; one that says why where nothing can be marched, none where the curve has no optimum.  After
        Ctrl-C those at the preloads that were not finished say "interrupted".

    Raises
    ------
    SettingError
        If the curve is of another model.
    """
    validation.instance("curve", curve, OptimalCurve)
    if curve.model_hash != problem.model.hash:
        raise validation.invalid("curve", "an optimal curve of this study", "one of another model")
    options = ContinuationOptions(budget=BUDGET)
    if preload is None:
        places = [p for p in (curve.optimum.preload,) if np.isfinite(p)]
    else:
        places = [float(p) for p in validation.numbers("preload", preload, above=0.0, unit="N")]
    none = {p: TimeResponse(*(np.nan,) * 4, p, np.nan, status=INTERRUPTED) for p in places}
    found, cost = none | {k.preload: k for k in curve.time_response}, curve.cost
    with LongWork():
        for p in with_progress(places, progress, "marching in time", "preload"):
            try:
                tracked = uninterrupted(frequency_response(problem, p, curve.settings["frequency"], options=options))
                cost += tracked.cost
                found[p] = in_time.time_response(problem, tracked)
                cost += found[p].cost
            except BdamperError as error:
                found[p] = replace(none[p], status=with_reason(NOT_FOUND, error))
    return replace(curve, time_response=tuple(found[p] for p in sorted(found)), cost=cost)
