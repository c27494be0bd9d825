"""Tracking curve of a wheel: its branches over frequency, followed as those of a sector are."""

from __future__ import annotations

import time
from dataclasses import replace
from math import tau

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.coverage import Coverage, ending, evaluation_budget, in_order
from bdamper.continuation.path import ContinuationOptions
from bdamper.harmonic_balance.conditions import Fixed
from bdamper.harmonic_balance.equations import OK
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import CostMeter
from bdamper.wheel.results import WheelCurve
from bdamper.wheel.system import WheelSystem
from bdamper.wheel.wheel_problem import WheelProblem


def first_point(system: WheelSystem, omega: float) -> NDArray | None:
    """A solution at one frequency (rad/s) from the static state, or by way of dampers held by springs, or None."""
    # springs on the mean of dampers with which a first point is looked for, each solution from the one before
    easing = (1.0, 0.1, 0.01, 0.0)
    for way in (easing[-1:], easing):
        y = np.append(system.structure.at_rest, omega)
        for held in way:
            eased = system.structure.held(held) if held else system
            c = eased.solve(y, Fixed(), eased.structure.units_about(y, omega), 1e-9, 60, 2)
            y = c.y
        if c.status == OK:
            return np.asarray(y)
    return None


def _turns(omega: NDArray, branch: NDArray) -> NDArray:
    """(n,) bool: the first points beyond folds."""
    out = np.zeros(len(omega), bool)
    step = np.diff(omega)
    out[2:] = (step[1:] * step[:-1] < 0.0) & (branch[2:] == branch[:-2])
    return out


@validate.spelt
@one_thread
def track(
    wheel: WheelProblem,
    preload: float,
    frequency: tuple[float, float],
    *,
    options: ContinuationOptions | None = None,
) -> WheelCurve:
    """Response of all blades over a frequency interval at one preload.

    Parameters
    ----------
    wheel : Wheel
    preload : float, N
    frequency : (low, high), Hz
    options : ContinuationOptions

    Returns
    -------
    WheelCurve
        From one end, and from the other where that branch does not lead through; outside of the interval, where a branch
        may turn and come back; and from solutions within what is left.  ``status`` is "complete" if there are solutions at
        every frequency, otherwise ``left_out`` says what is missing and why.
    """
    meter = CostMeter(time.perf_counter())
    low, high = (tau * f for f in validate.interval("frequency", frequency))
    if options is not None:
        validate.instance("options", options, ContinuationOptions)
    whole = wheel.system(preload)
    options = options or ContinuationOptions(locate=False)
    options = replace(options, budget=options.budget or evaluation_budget(whole))
    assert options.budget is not None
    system = whole.within(options.budget)
    search = Coverage(system, (low, high), options, meter)
    meter.watch(system)

    def find_start(omega: float) -> NDArray | None:
        found = first_point(whole, omega)
        search.note(omega, "no solution from the static state" if found is None else "from the static state")
        return found

    search.cover(find_start)
    status, reason, left_out = ending(search.pieces, low, high)
    ordered = in_order(search.pieces)
    at, branch = np.array([p.y[-1] for p, _ in ordered]), np.array([piece.branch for _, piece in ordered], int)
    return WheelCurve(
        frequency=at / tau,
        response=np.array([whole.structure.responses(p.y[:-1]) for p, _ in ordered]).reshape(
            len(ordered), wheel.n_blades, whole.n_harmonics + 1
        ),
        residual=np.array([p.residual for p, _ in ordered]),
        point_kind=tuple("fold" if turn else p.kind for turn, (p, _) in zip(_turns(at, branch), ordered)),
        branch=branch,
        preload=float(preload),
        status=status,
        reason=reason,
        left_out=tuple(str(part) for part in (*left_out, *search.lost)),
        cost=meter.read(time.perf_counter()),
        **wheel.record(),
    )
