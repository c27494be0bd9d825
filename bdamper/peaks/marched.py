"""What a march in time finds where an optimal curve has no steady response: mean and range of the amplitude."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import uninterrupted
from bdamper.continuation.path import ContinuationOptions
from bdamper.continuation.track import track
from bdamper.peaks.envelope import BUDGET
from bdamper.peaks.optimal_curve import Marched, OptimalCurve
from bdamper.problem.problem import Problem
from bdamper.stability.steady_state import FEWEST, settle
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.progress import LongWork, each


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
    highest solution and stays at its frequency (:func:`bdamper.stability.steady_state.settle`).

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
    validate.instance("curve", curve, OptimalCurve)
    if curve.model_hash != problem.model.hash:
        raise validate.unfit("curve", "an optimal curve of this study", "one of another model")
    if preload is None:
        low = curve.preload[curve.preload <= curve.no_steady_below]
        if not len(low):
            raise validate.unfit("preload", "some in N, as the curve has a steady response at each", None)
        preload = low[sorted({0, len(low) // 2, len(low) - 1})]
    periods = validate.whole("periods", periods, least=FEWEST)
    values = validate.numbers("preload", preload, above=0.0, unit="N")
    problem, found = problem.matching(curve.settings), {m.preload: m for m in curve.marched}
    with LongWork():
        for p in each([float(value) for value in values], progress, "marching", "preload"):
            options = ContinuationOptions(budget=BUDGET)
            tracked = uninterrupted(track(problem, p, curve.settings["frequency"], options=options))
            if not len(tracked):
                continue
            top = int(np.argmax(tracked.amplitude))
            settled = settle(problem, tracked, float(tracked.frequency[top]), periods=periods)
            found[p] = Marched(p, settled.frequency, settled.mean, *settled.range, settled.status)
    return replace(curve, marched=tuple(found[p] for p in sorted(found)))
