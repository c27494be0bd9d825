"""The preload of the largest margin against fatigue: beside that of the least amplitude, and not always the same.

More preload changes where and how the blade bends, not only how much, and adds to the mean stress.  The margin at a preload
is that of the highest point of the whole curve there.  Between the preloads of an optimal curve its largest value is found
as the least amplitude is (:mod:`bdamper.response.minimum_search`), with the slopes from the peak at preloads beside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from bdamper.fatigue.margin import LeastMargin, MarginCurve
from bdamper.fatigue.material import Material
from bdamper.harmonic_balance.problem import Problem
from bdamper.response import response_curve as tracking
from bdamper.response.minimum_search import Place, least
from bdamper.response.optimal_curve import Curves
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak, find_peak
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.status import COMPLETE, INCOMPLETE, INTERRUPTED, because
from bdamper.util.threading import one_thread

BESIDE = 1e-3
"""Relative distance of the preloads at which the slope of a margin is read: peaks to 1e-8 leave 1e-5 of it."""
AGREES = 0.02
"""Share by which the least margin of a whole response curve may lie below that of the highest peak."""
WHERE = {"end": "at the end of the preloads with a value", "unknown": "next to preloads where none is known"}
"""Of the largest margin, by the kind of place, if it was not refined."""


@one_thread
def best_margin(
    problem: Problem,
    /,
    curve: OptimalCurve,
    material: Material,
    **judged: Any,
) -> MarginCurve:
    """Margins along an optimal curve, and the preload of the largest, refined between those of the curve.

    Parameters
    ----------
    problem : Problem
    curve : OptimalCurve
        Of this problem.  Where it has the amplitude in time, ``in_time`` has the margin at that amplitude.
    material : Material
    **judged
        ``criterion``, ``line``, ``on``, ``sets`` and ``speed``, as :class:`bdamper.fatigue.margin.LeastMargin` has them.

    Returns
    -------
    MarginCurve
        ``best_value`` is the preload, ``best_status`` tells how far it is known.  After Ctrl-C the best at a
        preload of the curve.
    """
    validation.instance("curve", curve, OptimalCurve)
    judge = LeastMargin(material, **judged)
    found = judge.along(problem, curve)
    low, high = curve.settings["frequency"]

    def place(peak: Peak, p: float) -> Place:
        """Of ln(preload) and less ln(margin), which is no number where the margin is none."""
        system, beside = problem.system, (p * (1.0 - BESIDE), p * (1.0 + BESIDE))
        along: dict[str, Any] = {} if peak.corner else {"tangent": peak.tangent, "scale": peak.scale}
        near = [find_peak(system(q), peak.y, parameter=q, **along) for q in beside]
        here = _height(judge, problem, peak, p)
        ends = [_height(judge, problem, q, q.parameter) if q.converged else np.nan for q in near]
        return Place(float(np.log(p)), here, (ends[1] - ends[0]) / float(np.log(beside[1] / beside[0])))

    def ask(places: Sequence[float]) -> list[Place]:
        followed = curves.follow([float(np.exp(x)) for x in places])
        return [place(t.top.peak, t.preload) if t.known and t.top else Place(x, np.inf) for x, t in zip(places, followed)]

    with Curves(problem, (low, high)) as curves:
        rows = [(k, float(p), np.isfinite(a)) for k, (p, a) in enumerate(zip(curve.preload, curve.amplitude))]
        places = [place(_peak(problem, curve, k), p) if is_known else Place(np.log(p), np.inf) for k, p, is_known in rows]
        places, best = least(places, ask, lambda a, b, x: x)
        kept = {k.preload: k for k in curve.time_response if np.isfinite(k.mean)}
        peaks = [(p, there.top.peak) for p in kept for there in curves.follow([p]) if there.known and there.top]
        tops = [(p, top.y) for p, top in peaks if np.isclose(top.amplitude, kept[p].balance, rtol=1e-3, atol=0.0)]
    if curves.interrupted:
        i = found.greatest
        return replace(found, best_value=found.values[i], best_margin=found.margin[i], best_status=INTERRUPTED)
    at = places[best.index]
    preload, value = float(np.exp(at.x)), float(np.exp(-at.value))
    where = WHERE.get(best.kind, "refined between its neighbours")
    doubt = _doubt(problem, curve, judge, preload, value)
    status = because(INCOMPLETE, f"{where}, {doubt}") if doubt else because(COMPLETE, where)
    in_time = tuple(judge.margins(problem, y, p, kept[p]) for p, y in tops)
    return replace(found, best_value=preload, best_margin=value, best_status=status, in_time=in_time)


def _height(judge: LeastMargin, problem: Problem, peak: Peak, preload: float) -> float:
    value = judge(problem, peak.y[:-1], float(peak.y[-1]), preload)
    return float(-np.log(value)) if value > 0.0 else np.inf


def _peak(problem: Problem, curve: OptimalCurve, i: int) -> Peak:
    """The highest point of an optimal curve again, with its tangent where it has one."""
    p = float(curve.preload[i])
    y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
    return find_peak(problem.system(p), y, parameter=p)


def _doubt(problem: Problem, curve: OptimalCurve, judge: LeastMargin, preload: float, value: float) -> str:
    """What the whole response curve at a preload says against the margin there, empty where it agrees."""
    low, high = curve.settings["frequency"]
    whole = tracking.frequency_response(problem, preload, (low, high))
    if not whole.complete:
        return f"the response curve there is {whole.status}"
    try:
        margins = judge.along(problem, whole)
    except SettingError as error:
        return str(error)
    i = margins.least
    least, hertz = float(margins.margin[i]), float(whole.frequency[i])
    if least < (1.0 - AGREES) * value:
        return f"on the response curve there the margin is {least:.4g} at {hertz:.6g} Hz"
    return ""
