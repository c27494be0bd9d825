"""Checks of the optimum of an optimal curve, which :meth:`bdamper.Study.optimal_curve` runs after the curve.

1. Time integration gives the amplitude at the optimum, and at other preloads if it does not
   confirm the optimum or on request.  A second thread computes the peak at the
   optimum with more harmonics.
2. The peaks with less and more friction follow, and the range of friction in which the amplitude at most doubles.
3. The fatigue margins are computed along the curve.

Ctrl-C ends a check; the remaining checks are omitted.  With a results file, each preload of the time
integration, the peaks with more harmonics and each peak with other friction are stored when they
have ended.
"""

from __future__ import annotations

from dataclasses import replace

from bdamper.analyses import accuracy, robust_optimum
from bdamper.fatigue.criteria import Material
from bdamper.fatigue.margin import LeastMargin
from bdamper.harmonic_balance.problem import Problem
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.time_domain import time_response
from bdamper.util.progress import is_part_of_work
from bdamper.util.storage import FinishedParts


def preloads_in_time(curve: OptimalCurve, check: str) -> list[float] | None:
    """Return the preloads (N) for the time integration; None for its default."""
    best = curve.optimum.preload
    without_optimum = not best > 0.0
    if check == "time" or without_optimum:
        return None
    preloads = {best, best * time_response.NEIGHBOUR}
    if check == "neighbours":
        preloads.add(best / time_response.NEIGHBOUR)
    else:
        preloads.update(curve.near_best)
    return sorted(preloads)


def check_optimum(
    problem: Problem,
    curve: OptimalCurve,
    check: str | bool = "time",
    material: Material | None = None,
    progress: bool = False,
    seconds: float = time_response.SECONDS,
    parts: FinishedParts | None = None,
) -> OptimalCurve:
    """Return an optimal curve with the checks of its optimum.

    Parameters
    ----------
    problem : Problem
    curve : OptimalCurve
        Curve of this problem without checks.
    check : {"time", "harmonics", "neighbours", "range", False}
        Preloads of the time integration, see :meth:`bdamper.Study.optimal_curve`; "harmonics" omits
        it.  If False, only the margins are computed.
    material : Material, optional
        Fatigue strength; without it there are no margins.
    progress : bool
        Show a progress bar.
    seconds : float, s
        Most processor time of the time integration at one preload.
    parts : FinishedParts, optional
        Finished parts of the checks.
    """
    parts = parts or FinishedParts()
    try:
        if check and not curve.interrupted:
            curve = _with_time_and_harmonics(problem, curve, str(check), progress, seconds, parts)
        # the friction is changed at the better of the preloads that were integrated in time
        if check and not curve.interrupted:
            curve = robust_optimum.with_other_friction(problem, curve, progress, parts)
        if material is not None and not curve.interrupted:
            margins = robust_optimum.best_margin(problem, curve, LeastMargin(material))
            curve = replace(curve, margins=(margins,))
    except KeyboardInterrupt:
        # keep the checks that have ended
        if is_part_of_work():
            raise
        curve = replace(curve, checks_interrupted=True)
    return curve


def _with_time_and_harmonics(
    problem: Problem,
    curve: OptimalCurve,
    check: str,
    progress: bool,
    seconds: float,
    parts: FinishedParts,
) -> OptimalCurve:
    """Integrate in time while the peak at the optimum is computed with more harmonics."""
    preloads = preloads_in_time(curve, check)

    def integrate() -> OptimalCurve:
        if check == "harmonics":
            return curve
        return time_response.with_time_response(
            problem, curve, preloads, seconds=seconds, progress=progress, parts=parts
        )

    return accuracy.with_convergence(problem, curve, integrate, progress, parts)
