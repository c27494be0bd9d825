"""What stands beside an optimal curve at some preloads.

What a blade keeps of its values, by a march in time.  Where several solutions are stable, the curve shows the highest; a
slow sweep of frequency up meets another one than a sweep down, below it or on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve, uninterrupted
from bdamper.continuation.path import ContinuationOptions
from bdamper.continuation.slow_sweep import SlowSweep
from bdamper.continuation.track import track
from bdamper.peaks.newton import Peak
from bdamper.peaks.optimal import BUDGET
from bdamper.peaks.optimal_curve import OptimalCurve, Swept
from bdamper.problem.problem import Problem, matching
from bdamper.stability import kept as in_time
from bdamper.stability.floquet import with_stability
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.errors import BdamperError
from bdamper.util.kept import Kept
from bdamper.util.progress import LongWork, each
from bdamper.util.status import INTERRUPTED, NOT_FOUND, because
from bdamper.util.text import amount


def kept(problem: Problem, result: Curve | Peak, *, steps_per_period: int | None = None) -> Kept:
    """What a blade keeps at the preload of a tracking curve or of a peak (``bdamper.stability.kept``).

    Parameters
    ----------
    problem : Problem
    result : Curve or Peak
        Of this study.  For a peak the curve is tracked over the interval in which it was searched.
    steps_per_period : int, optional
        256 by default; what is kept is marched again with twice as many.

    Returns
    -------
    Kept

    Raises
    ------
    SettingError
        If it is of another study, is no peak, or the settings describe something else than a structure in time.
    """
    if isinstance(result, Peak):
        if not result.converged or "frequency" not in result.settings:
            raise validate.unfit("result", "a peak at a preload", result.status)
        found, what = result, "the highest peak of this study at its preload"
        if found.model_hash != problem.model.hash:
            raise validate.unfit("result", what, "one of another model")
        problem = matching(problem, found.settings)
        result = track(problem, found.parameter, tuple(found.settings["frequency"]))
        if not (len(result) and np.isclose(result.peak.amplitude, found.amplitude, rtol=1e-3, atol=0.0)):
            raise validate.unfit("result", what, f"{amount(found.amplitude, 'm')} at {found.frequency:.6g} Hz")
    return in_time.kept(problem, result, steps_per_period=steps_per_period)


@one_thread
def with_kept(
    problem: Problem, curve: OptimalCurve, preload: Sequence[float] | NDArray | None = None, *, progress: bool = False
) -> OptimalCurve:
    """The optimal curve with the amplitude that a blade keeps at some preloads, by a march in time.

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
        With a ``bdamper.util.kept.Kept`` for each in ``kept``, by rising preload, besides those that it had; one that
        says why where nothing can be marched, none where the curve has no optimum.  After Ctrl-C those at the preloads
        that were not finished say "interrupted".

    Raises
    ------
    SettingError
        If the curve is of another model.
    """
    problem = _matching(problem, curve)
    if preload is None:
        places = [p for p in (curve.optimum.preload,) if np.isfinite(p)]
    else:
        places = [float(p) for p in validate.numbers("preload", preload, above=0.0, unit="N")]
    none = {p: Kept(*(np.nan,) * 4, p, np.nan, status=INTERRUPTED) for p in places}
    found = none | {k.preload: k for k in curve.kept}
    with LongWork():
        for p in each(places, progress, "marching in time", "preload"):
            try:
                found[p] = in_time.kept(problem, _tracked(problem, curve, p))
            except BdamperError as error:
                found[p] = replace(none[p], status=because(NOT_FOUND, error))
    return replace(curve, kept=tuple(found[p] for p in sorted(found)))


@one_thread
def with_sweeps(
    problem: Problem,
    curve: OptimalCurve,
    preload: Sequence[float] | NDArray | None = None,
    *,
    progress: bool = False,
) -> OptimalCurve:
    """The optimal curve with the highest amplitudes that slow sweeps of frequency, up and down, meet at some preloads.

    The curve itself has the highest solution at each preload, whether a sweep meets it or not.  At each preload here a
    tracking curve is followed over the frequencies of the optimal curve, and the sweeps go along its stable branches
    (:meth:`bdamper.continuation.curve.Curve.sweep`); stable are points between folds, or those judged
    so where the study has ``stability=True``.

    Parameters
    ----------
    problem : Problem
    curve : OptimalCurve
        Of this study.
    preload : sequence of float, N, optional
        By default those with a value, and the optimum.
    progress : bool
        Show a bar of the preloads.

    Returns
    -------
    OptimalCurve
        With the new values in ``swept``, besides those at other preloads that it had; after Ctrl-C of the preloads that
        were finished.

    Raises
    ------
    SettingError
        If the curve is of another model.
    """
    problem = _matching(problem, curve)
    if preload is None:
        known = np.append(curve.preload[np.isfinite(curve.amplitude)], curve.optimum.preload)
        preload = np.unique(known[np.isfinite(known)])
    values = validate.numbers("preload", preload, above=0.0, unit="N")
    found = {s.preload: s for s in curve.swept}
    with LongWork():
        for p in each([float(value) for value in values], progress, "slow sweeps", "preload"):
            tracked = _tracked(problem, curve, p)
            if problem.stability and len(tracked):
                tracked = with_stability(problem, tracked)
            up, down = (_highest(tracked.sweep(way)) for way in ("up", "down"))
            found[p] = Swept(p, *up, *down, tracked.status)
    return replace(curve, swept=tuple(found[p] for p in sorted(found)))


def _highest(sweep: SlowSweep) -> tuple[float, float]:
    """Amplitude and frequency."""
    if not len(sweep.amplitude):
        return np.nan, np.nan
    i = int(np.argmax(sweep.amplitude))
    return float(sweep.amplitude[i]), float(sweep.frequency[i])


def _matching(problem: Problem, curve: OptimalCurve) -> Problem:
    validate.instance("curve", curve, OptimalCurve)
    if curve.model_hash != problem.model.hash:
        raise validate.unfit("curve", "an optimal curve of this study", "one of another model")
    return matching(problem, curve.settings)


def _tracked(problem: Problem, curve: OptimalCurve, preload: float) -> Curve:
    options = ContinuationOptions(budget=BUDGET)
    return uninterrupted(track(problem, preload, curve.settings["frequency"], options=options))
