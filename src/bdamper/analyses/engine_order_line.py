"""The response along the line of an engine order, and its highest point.

With the excitation frequency ``omega = EO Omega`` as the unknown beside ``u`` a run-up is a response curve like any other,
of equations in which everything changes with the speed (:class:`~bdamper.harmonic_balance.speed_family.Family`).  It is
followed from both ends of an interval of speeds in which the resonance of a mode can lie: between those at which its free
and its stuck resonance meet the line, and some way beyond.  The highest point is that of
:mod:`bdamper.response.highest_peak`.

At a fixed speed the frequency changes alone.  The peak at fixed speed that lies on the line is lower than the highest
point, by little where it is round and sharp, by percents where the response has a shoulder or the end of a plateau.

The equations are made at a few speeds and interpolated; what that leaves is measured at the highest point, by the equations
made there, and the point is one of these.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.speed_family import SpeedFamily
from bdamper.harmonic_balance.equations import OK, Equations
from bdamper.harmonic_balance.problem import Problem, stuck_springs
from bdamper.harmonic_balance.speed_family import Family, responses
from bdamper.response.branches import Coverage, ending, evaluation_budget
from bdamper.response.continuation import TWO_PI
from bdamper.response.continuation_options import ContinuationOptions
from bdamper.response.curve import ResponseCurve
from bdamper.response.highest_peak import Highest, highest_of_curve
from bdamper.response.initial_solution import first_point
from bdamper.response.peak import LOOSEST, Peak, PeakOptions, amplitude_at, coarse_options, find_peak
from bdamper.response.resonance_interval import beyond
from bdamper.response.response_curve import as_curve
from bdamper.util.cost import CostMeter
from bdamper.util.errors import BdamperError

NODES = 6
"""Speeds at which the problem is made for one line."""
CLOSE = 1e-3
"""Largest residual, relative to the excitation, that the interpolation may leave at the highest point."""


def interval(family: SpeedFamily, low: float, high: float, mode: int) -> tuple[float, float] | None:
    """Speeds (rad/s) within a range between which the resonance of a mode can meet the line, None where it cannot.

    Half as far beyond the free and the stuck resonance as a curve over frequency goes: with all of it 10 % more evaluations
    on four crossings, and the same highest points to 1e-8.
    """
    free, stuck = family.resonances(low, high, mode)
    margin = 0.5 * beyond(free, stuck)
    if free - margin > high or stuck + margin < low:
        return None
    return max(low, free - margin), min(high, stuck + margin)


def follow_line(
    family: SpeedFamily,
    speeds: tuple[float, float],
    mode: int,
    meter: CostMeter,
    options: ContinuationOptions | None = None,
) -> tuple[Equations[Family], ResponseCurve, Highest | None]:
    """Equations along the line, the response between two speeds (rad/s), and its highest maximum where it has one.

    The parameter of the latter is its speed.
    """
    low, high = speeds
    wide, reach = 0.05 * (high - low), family.conditions.reach(int(family.whole.engine_order))
    # a branch may turn beyond the ends and come back, as far as tables over speed reach
    equations = family.along(max(low - wide, 0.5 * low, reach[0]), min(high + wide, reach[1]), NODES)
    meter.watch(equations)
    options = options or coarse_options()
    budget = options.budget or evaluation_budget(equations)
    order = equations.structure.engine_order
    system = replace(equations.within(budget), watched=_watched(family, equations, mode))
    search = Coverage(system, (order * low, order * high), replace(options, budget=budget), meter)

    def find_start(omega: float) -> NDArray | None:
        problem, preload = _nearest(family, equations, omega / order)
        state, here = problem.equilibrium(preload), equations.structure.at(omega)
        meter.watch(here)
        found, tried, _ = first_point(here, state, stuck_springs(problem, state), omega, options, meter)
        for line in tried:
            search.note(omega, line)
        return found

    search.cover(find_start)
    status, reason, left = ending(search.pieces, *search.limits)
    there, _ = _nearest(family, equations, low)
    curve = as_curve(there, search, (status, reason, (*left, *search.lost)), kind="run-up", preload=np.nan)
    harmonics = responses(equations, np.column_stack([curve.unknowns, TWO_PI * curve.frequency]))
    speed = TWO_PI * curve.frequency / order
    curve = replace(curve, harmonics=harmonics, speed=speed, **family.whole.recorded(search.options))
    try:
        top = highest_of_curve(equations, curve)
    except BdamperError:  # no point of it is on a branch that counts
        return equations, curve, None
    meter.count(top.peak.iterations)
    found = None if top.kind == "end" else replace(top, peak=replace(top.peak, parameter=float(top.peak.y[-1]) / order))
    return equations, curve, found


def _nearest(family: SpeedFamily, equations: Equations[Family], speed: float) -> tuple[Problem, float]:
    """Problem and preload at the nearest speed at which the equations were made."""
    nearest = float(min(equations.structure.speeds, key=lambda other: abs(other - speed)))
    return family.problem(nearest), family.preload(nearest)


def _watched(family: SpeedFamily, equations: Equations[Family], mode: int) -> list[tuple[float, float, NDArray]]:
    """Free and stuck resonance of the mode where they meet the line, with the modal rows of the nearest node."""
    ends = float(equations.structure.speeds.min()), float(equations.structure.speeds.max())
    out = []
    for stuck, speed in enumerate(family.resonances(*ends, mode)):
        problem, preload = _nearest(family, equations, speed)
        springs = stuck_springs(problem, problem.equilibrium(preload)) if stuck else None
        omega = equations.structure.engine_order * speed
        if not ends[0] < speed < ends[1]:
            continue
        found = equations.structure.at(omega).structure.linear.resonances((springs,), 0.9 * omega, 1.1 * omega)
        out += [(omega, width, row) for _, width, row in sorted(found, key=lambda one: abs(one[0] - omega))[:1]]
    return out


def at_fixed_speed(equations: Equations[Family], top: Peak, meter: CostMeter) -> Peak | None:
    """The peak at fixed speed that lies on the line, by secants from the highest point along it.

    Steps after which no peak is found are halved: from a shoulder of the response to the peak they are percents long.
    """
    order, speeds = equations.structure.engine_order, equations.structure.speeds
    low, high = order * speeds.min(), order * speeds.max()
    omega, guess = float(top.y[-1]), top.y
    before: tuple[float, float] | None = None
    options = PeakOptions()
    for _ in range(options.max_iterations):
        system = equations.structure.at(omega)
        meter.watch(system)
        peak = find_peak(system, guess, parameter=omega / order)
        meter.count(peak.iterations)
        if not peak.converged:
            if before is None:
                return None
            omega = 0.5 * (omega + before[0])
            continue
        off = float(peak.y[-1]) - omega
        if abs(off) <= options.position_tolerance * omega:
            return peak
        slope = -1.0 if before is None or before[0] == omega else (off - before[1]) / (omega - before[0])
        before, guess = (omega, off), peak.y
        omega = omega - off / (slope if slope < -0.2 else -1.0)
        if not low <= omega <= high:
            return None
    return None


def exact(family: SpeedFamily, top: Peak) -> tuple[Peak, float]:
    """The highest point as a solution of the equations made at its speed, and the residual that interpolation leaves there,
    relative to the excitation."""
    system = family.system(top.parameter)
    error = system.error(top.y)
    options = PeakOptions()
    c = system.correct_at(top.y[:-1], float(top.y[-1]), top.scale, max(options.tolerance, LOOSEST), options.max_iterations)
    if c.status != OK:
        return top, error
    return replace(top, y=c.y, amplitude=amplitude_at(system, c.y), shares=np.array(c.shares), residual=c.residual), error
