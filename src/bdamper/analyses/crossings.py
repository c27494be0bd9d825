"""Crossings of a resonance with engine orders, for one or several masses of the damper.

A crossing is the highest point of the response along the line of an engine order
(:mod:`bdamper.analyses.engine_order_line`), at the preload of each speed, as a slow run-up passes it.  Each is a point of
a sweep over damper mass and engine order (:func:`bdamper.sweep`), so progress, interruption, files, executors and the
table are those of sweeps.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.engine_order_line import CLOSE, NODES, at_fixed_speed, exact, follow_line, interval
from bdamper.analyses.speed_family import SpeedFamily
from bdamper.analyses.sweep import SweepResult, sweep
from bdamper.fatigue.margin import LeastMargin
from bdamper.fatigue.stress_cycle import chosen_sets
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.rotor_speed import Conditions, asked_speeds, preload_at
from bdamper.harmonic_balance.speed_family import Family
from bdamper.response.continuation import TWO_PI
from bdamper.response.peak import Peak, find_peak
from bdamper.response.sensitivity import sensitivities
from bdamper.util import validation
from bdamper.util.cost import CostMeter
from bdamper.util.errors import SettingError
from bdamper.util.status import COMPLETE, INCOMPLETE, NOT_FOUND

AROUND = (0.03, 0.01, 0.003)
"""Ranges, relative, around a highest point at which interpolation leaves too much, one after the other: tables over speed
have corners."""
NUMBERS = (
    "amplitude", "speed", "frequency", "preload", "mass", "stick", "slip", "open", "fixed_speed", "fixed_speed_amplitude",
    "amplitude_by_mass", "speed_by_mass", "margin", "residual",
)  # fmt: skip
"""Answers of a crossing, NaN where there is none."""


def by_mass(family: SpeedFamily, equations: Equations[Family], top: Peak) -> dict[str, float]:
    """How the highest point moves with the mass of all free bodies, load and inertia together, per unit of the factor.

    Empty where it has no derivative.
    """
    low, high = (1.0 - AROUND[-1]) * top.parameter, (1.0 + AROUND[-1]) * top.parameter
    try:
        found = sensitivities(top, {"mass": (lambda factor: family.along(low, high, 2, factor), 1.0)})["mass"]
    except SettingError:
        return {}
    if found.reason:
        return {}
    order = equations.structure.engine_order
    return {"amplitude_by_mass": found.amplitude, "speed_by_mass": TWO_PI * found.frequency / order}


def refined(
    family: SpeedFamily, equations: Equations[Family], top: Peak, meter: CostMeter
) -> tuple[Equations[Family], Peak, Peak, float]:
    """Equations and highest point, from shorter ranges where interpolation leaves too much there.

    Beside them that point by the equations of its speed, and the residual that interpolation leaves.
    """
    own, error = exact(family, top)
    for part in AROUND:
        if error <= CLOSE:
            break
        shorter = family.along((1.0 - part) * own.parameter, (1.0 + part) * own.parameter, NODES)
        meter.watch(shorter)
        peak = find_peak(shorter, own.y, tangent=own.tangent, scale=own.scale)
        if not peak.converged:
            break
        equations, top = shorter, replace(peak, parameter=float(peak.y[-1]) / shorter.structure.engine_order)
        own, error = exact(family, top)
    return equations, top, own, error


@dataclass(frozen=True)
class CrossingTask:
    """The crossing of a mode with the engine order of a problem, as a question of a sweep.

    Answers are :data:`NUMBERS` in SI units, NaN where there is no crossing: ``mass`` is that of the loaded damper,
    ``fixed_speed`` and ``fixed_speed_amplitude`` are those of the peak at fixed speed beside the highest point,
    ``amplitude_by_mass`` and ``speed_by_mass`` derivatives per unit of the factor on the mass.  ``kind`` is "complete",
    "incomplete" where there may be a higher point, as ``warning`` says, "not found", or "none" where no resonance of the
    mode can meet the line.

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

    def __call__(self, problem: Problem, preload: float | None) -> dict[str, Any]:
        meter = CostMeter()
        found = self._found(problem, meter)
        neglected = problem.model.neglected_over_speed(problem.settings.needed_diameters)
        found["warning"] = "; ".join([*found["warning"], *(f"neglected: {note}" for note in neglected)])
        mass = next(b.mass for b in problem.model.bodies.values() if b.kind == "free" and b.load is not None)
        return dict.fromkeys(NUMBERS, np.nan) | {"mass": mass} | found | {"cost": meter.read()}

    def _found(self, problem: Problem, meter: CostMeter) -> dict[str, Any]:
        """The answers without those that are NaN, and warnings as a list."""
        family = SpeedFamily(problem, self.conditions)
        where = "mode {} between {:.6g} and {:.6g} rad/s".format(self.mode, *self.speeds)
        speeds = interval(family, *self.speeds, self.mode)
        if speeds is None:
            return {"kind": "none", "warning": [f"engine order {problem.engine_order} meets no resonance of {where}"]}
        equations, curve, highest = follow_line(family, speeds, self.mode, meter)
        if highest is None:
            why = f"the response along the line has no maximum of {where}: does the excitation move it, and the response?"
            return {"kind": NOT_FOUND, "warning": [why]}
        warnings = [f"curve {curve.status}: {curve.reason}"] if curve.status != COMPLETE else []
        warnings += [highest.note] if highest.note else []
        equations, top, own, error = refined(family, equations, highest.peak, meter)
        if not error <= CLOSE:
            warnings.append(f"interpolation over speed leaves a residual of {error:.2g} at the highest point")
        out: dict[str, Any] = {
            "kind": INCOMPLETE if warnings else COMPLETE, "speed": own.parameter, "amplitude": own.amplitude,
            "frequency": own.frequency, "preload": family.preload(own.parameter), "residual": own.residual,
            **by_mass(family, equations, top),
            **{name: float(x) for name, x in zip(("stick", "slip", "open"), own.shares)},
        }  # fmt: skip
        fixed = at_fixed_speed(equations, top, meter)
        if fixed is not None:
            out |= {"fixed_speed": fixed.parameter, "fixed_speed_amplitude": fixed.amplitude}
        if self.margin is not None:
            out["margin"] = self.margin(family.problem(own.parameter), own.y[:-1], float(own.y[-1]), out["preload"])
        return out | {"warning": warnings}


@partial(validation.spelt, also=Conditions.__dataclass_fields__)
def resonance_crossings(
    problem: Problem,
    /,
    speeds: tuple[float, float] | Sequence[float] | NDArray | None = None,
    engine_orders: Sequence[int] = (),
    *,
    rpm: tuple[float, float] | Sequence[float] | NDArray | None = None,
    damper_mass: Sequence[float] = (1.0,),
    mode: int = 1,
    executor: Executor | None = None,
    resume: str | Path | None = None,
    progress: bool = False,
    margin: LeastMargin | None = None,
    **conditions: Any,
) -> SweepResult:
    """Crossings of a mode with engine orders, for several masses of the damper.

    Parameters
    ----------
    speeds, rpm : (low, high) or sequence of more than two values, rad/s or revolutions per minute
        Range in which crossings are looked for, one of the two.
    engine_orders : sequence of int
    damper_mass : sequence of float
        Factors on the mass of the free bodies, each with its centrifugal load and its inertia.
    mode : int
        Mode of the constrained bodies, 1 for the lowest.
    executor, resume, progress
        As of :func:`bdamper.sweep`.
    margin : LeastMargin, optional
        With it the margin against fatigue of each crossing, for a model with stress sets.
    **conditions
        ``friction``, ``temperature``, ``excitation``: fields of :class:`bdamper.harmonic_balance.rotor_speed.Conditions`.

    Returns
    -------
    SweepResult
        Over ``damper_mass`` and ``engine_order``, with the answers of :class:`CrossingTask`;
        :func:`bdamper.plot.plot_crossings` draws it.

    Raises
    ------
    SettingError
        If speeds, orders or factors are none, or no free body carries a load.
    """
    values = speed_values(asked_speeds(problem, speeds, rpm))
    orders = validation.wholes("engine_orders", engine_orders, least=1)
    factors = validation.numbers("damper_mass", damper_mass, above=0.0)
    mode = validation.whole("mode", mode, least=1)
    validation.require(orders, "engine_orders", "at least one", "none")
    preload_at(problem, float(values[-1]))
    if not problem.carries_load:
        raise SettingError(f"crossings: expected a model with a body that carries a load, found that {problem.why_no_load}")
    given = Conditions(**conditions)
    named = given.values(values.tolist(), orders)  # what tables do not reach is told before any work
    if margin is not None:
        validation.instance("margin", margin, LeastMargin)
        chosen_sets(problem)
    task = CrossingTask((float(values[0]), float(values[-1])), mode, given, margin, named)
    over = {"damper_mass": factors.tolist(), "engine_order": list(orders)}
    return sweep(problem, over, task, executor=executor, resume=resume, progress=progress)


def speed_values(speeds: Any, n: int = 13) -> NDArray:
    """(n,) speeds (rad/s): that many between two ends, or the longer sequence that is given.

    Raises
    ------
    SettingError
        If they are not positive and increasing.
    """
    values = validation.numbers("speeds", speeds, above=0.0, unit="rad/s")
    if len(values) < 2 or np.any(np.diff(values) <= 0.0):
        raise validation.unfit("speeds", "(low, high) in rad/s, or a longer sequence of increasing values", speeds)
    return values if len(values) > 2 else np.linspace(values[0], values[1], n)
