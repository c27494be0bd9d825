"""The preload of the largest margin against fatigue: beside that of the least amplitude, and not always the same.

More preload changes where and how the blade bends, not only how much, and adds to the mean stress.  The margin at a preload
is that of the highest peak there.  Between the preloads of an optimal curve it is found by a golden section on peaks
followed from the neighbours, the least margin of them at each step, since the highest peak or the critical location may
change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdamper.continuation import track as tracking
from bdamper.fatigue.cycle import of
from bdamper.fatigue.margin import LeastMargin, MarginCurve, margin
from bdamper.fatigue.material import Material
from bdamper.peaks.newton import Peak, find_peak
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.errors import SettingError

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
STEPS = 8
"""Steps of the golden section: a 47th of the distance of the neighbours."""
AGREES = 0.02
"""Share by which the least margin of a whole tracking curve may lie below that of the highest peak."""


@one_thread
def best_margin(
    problem: Problem,
    curve: OptimalCurve,
    material: Material,
    *,
    criterion: str = "von_mises",
    line: str = "goodman",
    on: str = "amplitude",
    sets: str | Sequence[str] | None = None,
    speed: float | None = None,
    verify: bool = True,
) -> MarginCurve:
    """Margins along an optimal curve, and the preload of the largest, refined between those of the curve.

    Parameters
    ----------
    problem : Problem
    curve : OptimalCurve
        Of this problem.
    material, criterion, line, on, sets, speed
        As for :func:`bdamper.fatigue.margin.margin`.
    verify : bool
        Compare with the whole tracking curve at that preload.

    Returns
    -------
    MarginCurve
        ``best_value`` is the preload, ``best_status`` tells how far it is known.
    """
    validate.instance("curve", curve, OptimalCurve)
    validate.flag("verify", verify)
    found = margin(problem, curve, material, criterion=criterion, line=line, on=on, sets=sets, speed=speed)
    assert isinstance(found, MarginCurve)
    problem = of(problem, curve)
    named = sets if sets is None or isinstance(sets, str) else tuple(sets)
    judge = LeastMargin(material, criterion, line, on, named, speed)
    k = found.greatest
    best, value, status = float(found.values[k]), float(found.margin[k]), "at the end of the preloads with a value"
    if 0 < k < len(found) - 1 and np.isfinite(found.margin[[k - 1, k + 1]]).all():
        near = [_peak(problem, curve, i) for i in (k - 1, k, k + 1)]
        ends = np.log(found.values[[k - 1, k + 1]])
        best, value = _golden(problem, judge, near, ends, best, value)
        status = "refined between its neighbours"
    status += f", {_compared(problem, curve, judge, best, value)}" if verify else ", not verified: a peak may be lost there"
    return replace(found, best_value=best, best_margin=value, best_status=status)


def _peak(problem: Problem, curve: OptimalCurve, i: int) -> Peak:
    """The peak of an optimal curve again, with its tangent."""
    p = float(curve.preload[i])
    y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
    return find_peak(problem.system(p), y, parameter=p)


def _golden(
    problem: Problem, judge: LeastMargin, near: list[Peak], ends: np.ndarray, best: float, value: float
) -> tuple[float, float]:
    """Preload and value of the largest margin between two logarithms of preloads, by a golden section."""

    def at(x: float) -> float:
        p = float(np.exp(x))
        system = problem.system(p)
        peaks = [find_peak(system, peak.y, parameter=p) for peak in near]
        margins = [judge(problem, peak.y[:-1], float(peak.y[-1]), p) for peak in peaks if peak.converged]
        return min(margins, default=-np.inf)

    low, high = (float(x) for x in ends)
    a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_a, at_b = at(a), at(b)
    for _ in range(STEPS):
        for x, found in ((a, at_a), (b, at_b)):
            if found > value:
                best, value = float(np.exp(x)), found
        if at_a >= at_b:
            high, b, at_b = b, a, at_a
            a = high - GOLDEN * (high - low)
            at_a = at(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + GOLDEN * (high - low)
            at_b = at(b)
    return best, value


def _compared(problem: Problem, curve: OptimalCurve, judge: LeastMargin, preload: float, value: float) -> str:
    """What the whole tracking curve at a preload says of the margin there."""
    low, high = curve.settings["frequency"]
    whole = tracking.track(problem, preload, (low, high))
    if not whole.complete:
        return f"not verified: the tracking curve there is {whole.status}"
    try:
        margins = judge.along(problem, whole)
    except SettingError as error:
        return f"not verified: {error}"
    i = margins.least
    least, hertz = float(margins.margin[i]), float(whole.frequency[i])
    if least < (1.0 - AGREES) * value:
        return f"not verified: on the tracking curve there the margin is {least:.4g} at {hertz:.6g} Hz"
    return "verified"
