"""What stands beside an optimal curve at some preloads.

Where it has no steady response, mean and range of the amplitude of a march in time.  Where several solutions are stable,
the curve shows the highest; a slow sweep of frequency up meets another one than a sweep down, below it or on it.
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
from bdamper.peaks.optimal import BUDGET
from bdamper.peaks.optimal_curve import Marched, OptimalCurve, Swept
from bdamper.problem.problem import Problem, matching
from bdamper.stability.floquet import with_stability
from bdamper.stability.kept import kept
from bdamper.stability.steady_state import FEWEST, settle
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.errors import BdamperError
from bdamper.util.kept import Kept
from bdamper.util.progress import LongWork, each
from bdamper.util.status import NOT_FOUND, because


@one_thread
def with_marched(
    problem: Problem,
    curve: OptimalCurve,
    preload: Sequence[float] | NDArray | None = None,
    *,
    periods: int = 200,
    progress: bool = False,
) -> OptimalCurve:
    """The optimal curve with mean and range of the amplitude that a march in time finds at some preloads.

    At each preload a tracking curve is followed over the frequencies of the optimal curve, and the march starts from its
    highest solution and stays at its frequency (:meth:`bdamper.Study.settle`).

    Parameters
    ----------
    problem : Problem
    curve : OptimalCurve
        Of this study.
    preload : sequence of float, N, optional
        By default the lowest, the middle and the highest of the curve's preloads without a steady response.
    periods : int
        Of the excitation at each preload; mean and range are those of the second half.
    progress : bool
        Show a bar of the preloads.

    Returns
    -------
    OptimalCurve
        With the new values in ``marched``, besides those at other preloads that it had; after Ctrl-C of the preloads
        that were finished.  A preload at which no solution was found has none.

    Raises
    ------
    SettingError
        If the curve is of another model, if it has a steady response at each preload and none is given, or the settings
        describe something else than a structure in time.
    """
    problem = _matching(problem, curve)
    if preload is None:
        low = curve.preload[curve.preload <= curve.no_steady_below]
        if not len(low):
            raise validate.unfit("preload", "some in N, as the curve has a steady response at each", None)
        preload = low[sorted({0, len(low) // 2, len(low) - 1})]
    periods = validate.whole("periods", periods, least=FEWEST)
    values = validate.numbers("preload", preload, above=0.0, unit="N")
    found = {m.preload: m for m in curve.marched}
    with LongWork():
        for p in each([float(value) for value in values], progress, "marching", "preload"):
            tracked = _tracked(problem, curve, p)
            if not len(tracked):
                continue
            top = int(np.argmax(tracked.amplitude))
            settled = settle(problem, tracked, float(tracked.frequency[top]), periods=periods)
            found[p] = Marched(p, settled.frequency, settled.mean, *settled.range, settled.status)
    return replace(curve, marched=tuple(found[p] for p in sorted(found)))


@one_thread
def with_kept(problem: Problem, curve: OptimalCurve, *, neighbours: bool = False, progress: bool = False) -> OptimalCurve:
    """The optimal curve with the amplitude that a blade keeps at its optimum, by a march in time.

    Parameters
    ----------
    problem : Problem
    curve : OptimalCurve
        Of this study.
    neighbours : bool
        Also at preloads a factor of 1.2 below and above.
    progress : bool
        Show a bar of the preloads.

    Returns
    -------
    OptimalCurve
        With :class:`~bdamper.util.kept.Kept` in ``kept``, by rising preload; one that says why where nothing can be
        marched, none where the curve has no optimum.  After Ctrl-C those of the preloads that were finished.

    Raises
    ------
    SettingError
        If the curve is of another model.
    """
    problem = _matching(problem, curve)
    best, found = curve.optimum.preload, {k.preload: k for k in curve.kept}
    places = [best * factor for factor in ((1.0 / 1.2, 1.0, 1.2) if neighbours else (1.0,)) if np.isfinite(best)]
    with LongWork():
        for p in each(places, progress, "marching in time", "preload"):
            tracked = _tracked(problem, curve, p)
            try:
                found[p] = kept(problem, tracked)
            except BdamperError as error:
                top = tracked.peak.amplitude if len(tracked) else np.nan
                found[p] = Kept(*(np.nan,) * 4, p, top, status=because(NOT_FOUND, error))
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
