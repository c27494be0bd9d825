"""The run-up along the line of an engine order: one curve over rotor speed, at the preload of each speed."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.crossings import speed_values
from bdamper.analyses.engine_order_line import CLOSE, at_fixed_speed, exact, follow_line, interval
from bdamper.analyses.speed_family import SpeedFamily
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.rotor_speed import Conditions, asked_speeds
from bdamper.harmonic_balance.speed_family import responses
from bdamper.response.continuation_options import ContinuationOptions
from bdamper.response.curve import ResponseCurve
from bdamper.response.peak import Peak
from bdamper.util import validation
from bdamper.util.cost import CostMeter
from bdamper.util.errors import BdamperError
from bdamper.util.formatting import amount, percent
from bdamper.util.threading import one_thread

WITHIN = (50.0, 2000.0)
"""Speeds (rad/s) between which a crossing is looked for if none are given."""


@partial(validation.spelt, also=Conditions.__dataclass_fields__)
@one_thread
def run_up(
    problem: Problem,
    /,
    speeds: tuple[float, float] | None = None,
    *,
    rpm: tuple[float, float] | None = None,
    mode: int = 1,
    options: ContinuationOptions | None = None,
    **conditions: Any,
) -> ResponseCurve:
    """The response along the line of the study's engine order, through its crossing with a mode.

    Parameters
    ----------
    speeds : (low, high), rad/s, optional
        Range of the run-up, which holds the crossing; by default the speeds at which the free and the stuck resonance of
        the mode meet the line, and some way beyond, from 50 to 2000 rad/s as far as tables over speed reach.
    rpm : (low, high), revolutions per minute
        Instead of ``speeds``.
    mode : int
    options : ContinuationOptions
        Coarse by default; the highest point is refined.
    **conditions
        As for :meth:`bdamper.Study.crossings`.

    Returns
    -------
    ResponseCurve
        Of the kind "run-up"; its highest maximum solves the equations made at its own speed, and ``notes`` name the peak
        at fixed speed beside it.

    Raises
    ------
    SettingError
        If a setting does not fit, or polynomials over speed do not describe the equations well enough: a shorter range.
    BdamperError
        If there is no crossing in the range.
    """
    given = Conditions(**conditions)
    asked = np.clip(given.reach(int(problem.engine_order)), *WITHIN)
    narrow = speeds is not None or rpm is not None
    if narrow:
        asked = speed_values(asked_speeds(problem, speeds, rpm))
    mode = validation.whole("mode", mode, least=1)
    meter = CostMeter()
    family = SpeedFamily(problem, given)
    low, high = float(asked[0]), float(asked[-1])
    holds = interval(family, low, high, mode)
    why = ""
    if holds is not None:
        equations, curve, found = follow_line(family, (low, high) if narrow else holds, mode, meter, options)
        why = "" if found is not None else f": {curve._headline()}"
    if holds is None or found is None:
        raise BdamperError(
            f"run-up: expected a crossing of mode {mode} with engine order {problem.engine_order} between {low:.6g} and "
            f"{high:.6g} rad/s, found none{why}"
        )
    top, error = exact(family, found.peak)
    left = f"a residual of {error:.2g} after interpolation over it; give a shorter one"
    validation.require(error <= CLOSE, "speeds", "a range in which the equations change smoothly", left)
    fixed = at_fixed_speed(equations, found.peak, meter)
    out = _with_maximum(curve, found.index, top, responses(equations, top.y[None])[0])
    notes = _beside(top, fixed), f"interpolation over speed leaves a residual of {error:.1e} there"
    return replace(out, notes=(*curve.notes, *notes), cost=meter.read())


def _with_maximum(curve: ResponseCurve, index: int, top: Peak, harmonics: NDArray) -> ResponseCurve:
    """The curve with one of its points replaced by its highest maximum, and without unknowns.

    They would be taken for those of the study at a speed, whose residual modes have other phases.
    """
    own = {
        "harmonics": harmonics, "frequency": top.frequency, "speed": top.parameter, "shares": top.shares,
        "residual": top.residual,
    }  # fmt: skip
    columns: dict[str, Any] = {name: np.array(getattr(curve, name)) for name in own}
    for name, value in own.items():
        columns[name][index] = value
    return replace(curve, **columns, unknowns=np.zeros((len(curve), 0)))


def _beside(top: Peak, fixed: Peak | None) -> str:
    """The highest maximum, and the peak at fixed speed beside it."""
    beside = "no peak at fixed speed beside it lies on the line"
    if fixed is not None:
        above = percent(top.amplitude / fixed.amplitude - 1.0)
        beside = f"{above} above the peak at fixed speed, {amount(fixed.amplitude, 'm', 4)} at {fixed.parameter:.5g} rad/s"
    return f"highest maximum {amount(top.amplitude, 'm', 4)} at {top.parameter:.5g} rad/s: {beside}"
