"""Response curve of a wheel: its branches over frequency, followed as those of a sector are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.closing_conditions import Fixed
from bdamper.harmonic_balance.equations import OK
from bdamper.mistuning.wheel_equations import WheelSystem
from bdamper.mistuning.wheel_problem import WheelProblem
from bdamper.response.branches import Coverage, ending, evaluation_budget, in_order
from bdamper.response.continuation import TWO_PI
from bdamper.response.continuation_options import ContinuationOptions
from bdamper.response.curve import ResponseCurve
from bdamper.response.response_curve import as_curve
from bdamper.util import validation
from bdamper.util.cost import CostMeter
from bdamper.util.threading import one_thread


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


@validation.spelt
@one_thread
def frequency_response(
    wheel: WheelProblem,
    preload: float,
    frequency: tuple[float, float],
    *,
    options: ContinuationOptions | None = None,
) -> ResponseCurve:
    """Response of all blades over a frequency interval at one preload.

    Parameters
    ----------
    wheel : BladedDisk
    preload : float, N
    frequency : (low, high), Hz
    options : ContinuationOptions

    Returns
    -------
    ResponseCurve
        Of the highest blade, with the response of all in ``blades`` and without unknowns: from one end, and from the other
        where that branch does not lead through; outside of the interval, where a branch may turn and come back; and from
        solutions within what is left.
    """
    low, high = (TWO_PI * f for f in validation.interval("frequency", frequency))
    options = validation.instance("options", options or ContinuationOptions(locate=False), ContinuationOptions)
    whole = wheel.system(preload)
    budget = options.budget or evaluation_budget(whole)
    options = replace(options, budget=budget)
    search = Coverage(whole.within(budget), (low, high), options, CostMeter())
    search.meter.watch(search.system)

    def find_start(omega: float) -> NDArray | None:
        found = first_point(whole, omega)
        search.note(omega, "no solution from the static state" if found is None else "from the static state")
        return found

    search.cover(find_start)
    status, reason, left_out = ending(search.pieces, low, high)
    blades = np.array([whole.structure.responses(p.y[:-1]) for p, _ in in_order(search.pieces)])
    blades = blades.reshape(-1, wheel.n_blades, whole.n_harmonics + 1)
    ended = status, reason, (*left_out, *search.lost)
    curve = as_curve(wheel.structure.tuned, search, ended, kind="tracking", preload=float(preload), blades=blades)
    return replace(curve, harmonics=highest_blade(blades), unknowns=np.zeros((len(curve), 0)), **wheel.record())


def highest_blade(blades: NDArray) -> NDArray:
    """(n, n_harmonics + 1) response of the highest blade at each point, of those of all blades."""
    return np.asarray(blades[np.arange(len(blades)), np.abs(blades[..., 1]).argmax(axis=1)])
