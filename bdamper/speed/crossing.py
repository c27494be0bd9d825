"""One crossing: the highest point of the response along the line of an engine order (:mod:`bdamper.speed.line`)."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from bdamper.continuation.follower import TWO_PI
from bdamper.fatigue.margin import LeastMargin
from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.peaks.newton import Peak, find_peak
from bdamper.peaks.sensitivity import NoDerivative, sensitivities
from bdamper.problem.at_speed import Conditions
from bdamper.problem.problem import Problem
from bdamper.speed.family import SpeedFamily
from bdamper.speed.line import CLOSE, NODES, Line, at_fixed_speed, exact, follow_line, interval
from bdamper.util import validate
from bdamper.util.cost import CostMeter
from bdamper.util.errors import SettingError
from bdamper.util.status import COMPLETE, INCOMPLETE, NOT_FOUND

AROUND = (0.03, 0.01, 0.003)
"""Ranges, relative, around a highest point at which interpolation leaves too much, one after the other: tables over speed
have corners."""
MARGINS = 13
"""Points of a line, evenly spread, that get a margin, which each takes a problem of its own."""
BOTH = 1e-3
"""Relative difference from which the peak at fixed speed is told beside the highest point."""


def by_mass(family: SpeedFamily[Problem], line: Line) -> dict[str, float]:
    """How the highest point moves with the mass of all free bodies, load and inertia together, per unit of the factor.

    Empty where it has no derivative.
    """
    top = line.top
    assert top is not None
    low, high = (1.0 - AROUND[-1]) * top.parameter, (1.0 + AROUND[-1]) * top.parameter

    def heavier(factor: float) -> HarmonicSystem:
        return line.equations if factor == 1.0 else family.along(low, high, 2, factor)

    try:
        found = sensitivities(top, {"mass": (heavier, 1.0)})["mass"]
    except (NoDerivative, SettingError, ArithmeticError):
        return {}
    return {
        "amplitude_by_mass": found.amplitude,
        "speed_by_mass": TWO_PI * found.frequency / line.equations.engine_order,
    }


def refined(family: SpeedFamily[Problem], line: Line, meter: CostMeter) -> tuple[Line, Peak, float]:
    """The line with its highest point by the equations of its speed, from shorter ranges where interpolation leaves too
    much there, and what it leaves."""
    top, error = exact(family, line)
    for part in AROUND:
        if error <= CLOSE:
            break
        equations = family.along((1.0 - part) * top.parameter, (1.0 + part) * top.parameter, NODES)
        meter.watch(equations)
        peak = find_peak(equations, top.y, tangent=top.tangent, scale=top.scale)
        if not peak.converged:
            break
        peak = replace(peak, parameter=float(peak.y[-1]) / equations.engine_order)
        line = replace(line, equations=equations, top=peak, fixed=at_fixed_speed(equations, peak, meter))
        top, error = exact(family, line)
    return line, top, error


@dataclass(frozen=True)
class CrossingTask:
    """The crossing of a mode with the engine order of a problem, as a question of a sweep.

    Parameters
    ----------
    speeds : (low, high), rad/s
        In which it is looked for.
    mode : int
    conditions : Conditions
    margin : LeastMargin, optional
        With it margins against fatigue are found, too.
    named : tuple
        What tells the functions among the conditions from others in files of long work: their values.
    """

    speeds: tuple[float, float]
    mode: int = 1
    conditions: Conditions = field(default_factory=Conditions)
    margin: LeastMargin | None = None
    named: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        given = validate.numbers("speeds", self.speeds, above=0.0, unit="rad/s")
        validate.that(len(given) == 2 and given[1] > given[0], "speeds", "two increasing values", self.speeds)
        object.__setattr__(self, "speeds", tuple(given.tolist()))
        validate.fields(self, validate.whole, "mode", least=1)

    def __call__(self, problem: Problem, preload: float | None) -> dict[str, Any]:
        meter = CostMeter(time.perf_counter())
        family = SpeedFamily(problem, self.conditions)
        speeds = interval(family, *self.speeds, self.mode)
        if speeds is None:
            return {"kind": "none", "warning": "", "cost": meter.read(time.perf_counter())}
        line = follow_line(family, speeds, self.mode, meter)
        out: dict[str, Any] = {
            "line_speed": line.speed.tolist(), "line_amplitude": line.amplitude.tolist(),
            "line_margin": self._margins(family, line),
        }  # fmt: skip
        if line.top is None:
            why = (
                f"the response along the line has no maximum between {speeds[0]:.5g} and {speeds[1]:.5g} rad/s: does the "
                f"excitation move mode {self.mode}, and does the response location?"
            )
            return out | {"kind": NOT_FOUND, "warning": why, "cost": meter.read(time.perf_counter())}
        warnings = [f"curve {line.status}: {line.reason}"] if line.status != COMPLETE else []
        if line.cut:
            warnings.append("the response is higher at an end of the range of speeds")
        line, top, error = refined(family, line, meter)
        if not error <= CLOSE:
            warnings.append(f"interpolation over speed leaves a residual of {error:.2g} at the highest point")
        out |= {
            "kind": INCOMPLETE if warnings else COMPLETE, "speed": top.parameter, "amplitude": top.amplitude,
            "frequency": float(top.y[-1]) / TWO_PI, "preload": family.preload(top.parameter), "residual": top.residual,
            "margin": self._margin(family, top.parameter, top.y), **by_mass(family, line),
            **{name: float(x) for name, x in zip(("stick", "slip", "open"), top.shares)},
        }  # fmt: skip
        if line.fixed is not None:
            out |= {"fixed_speed": line.fixed.parameter, "fixed_speed_amplitude": line.fixed.amplitude}
        return out | {"warning": "; ".join(warnings), "cost": meter.read(time.perf_counter())}

    def _margins(self, family: SpeedFamily[Problem], line: Line) -> list[float]:
        """Margins of some points of a line, NaN at the others and if none is asked for."""
        out = np.full(len(line.y), np.nan)
        if self.margin is not None:
            for i in np.unique(np.linspace(0, len(out) - 1, MARGINS).round().astype(int)):
                out[i] = self._margin(family, float(line.speed[i]), line.y[i])
        return out.tolist()

    def _margin(self, family: SpeedFamily[Problem], speed: float, y: Any) -> float:
        """Margin of a solution, NaN if none is asked for."""
        if self.margin is None:
            return float("nan")
        return self.margin(family.problem(speed), y[:-1], float(y[-1]), family.preload(speed))
