"""Crossings of a resonance with engine orders, over rotor speed and damper mass.

Crossing
    A crossing is the highest point of the response along the line of an engine order, as in a slow run-up; the preload
    depends on the speed. Each crossing is a point of a sweep over damper mass and engine order (:func:`bdamper.sweep`).
    :mod:`bdamper.analyses.engine_order_line` follows the line.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.engine_order_line import (
    AROUND,
    CLOSE,
    SpeedFamily,
    exact_at_fixed_speed,
    follow_mode,
    interpolated_at_fixed_speed,
    refined,
)
from bdamper.analyses.sweep import SweepResult, as_words, sweep
from bdamper.fatigue.margin import LeastMargin
from bdamper.fatigue.stress_cycle import chosen_sets
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.parameters import INERTIA, MASS
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.rotor_speed import (
    RPM,
    Conditions,
    Family,
    asked_speeds,
    preload_at,
)
from bdamper.response.continuation import TWO_PI
from bdamper.response.linear_limits import free_and_stuck
from bdamper.response.peak import Peak
from bdamper.response.sensitivity import sensitivities
from bdamper.util import validation
from bdamper.util.errors import COMPLETE, INCOMPLETE, NOT_FOUND, SettingError
from bdamper.util.formatting import amount, counted, peak_text, percent, short_repr
from bdamper.util.progress import CostMeter
from bdamper.util.records import named_fields, numbers_of, row_of

NUMBERS = (
    "amplitude", "speed", "frequency", "preload", "mass", "stick", "slip", "open", "fixed_speed", "fixed_speed_amplitude",
    "amplitude_by_mass", "speed_by_mass", "margin", "residual",
)  # fmt: skip
"""Numeric results of a crossing; NaN if there is none."""


def by_mass(family: SpeedFamily, equations: Equations[Family], top: Peak) -> dict[str, float]:
    """Return the derivatives of the highest point with respect to a factor on the mass of all free bodies.

    The factor acts on load and inertia. The result is empty if there is no derivative.
    """
    low, high = (1.0 - AROUND[-1]) * top.parameter, (1.0 + AROUND[-1]) * top.parameter
    try:
        derivative = sensitivities(
            top, {"mass": (lambda factor: family.along(low, high, 2, factor), 1.0)}
        )["mass"]
    except SettingError:
        return {}
    if derivative.reason:
        return {}
    order = equations.structure.engine_order
    return {
        "amplitude_by_mass": derivative.amplitude,
        "speed_by_mass": TWO_PI * derivative.frequency / order,
    }


@dataclass(frozen=True)
class CrossingTask:
    """Function of a sweep that computes the crossing of a mode with the engine order of a problem.

    Results are :data:`NUMBERS` in SI units, NaN without a crossing. ``mass`` is the mass of the loaded damper.
    ``fixed_speed`` and ``fixed_speed_amplitude`` describe the peak at fixed speed near the highest point.
    ``amplitude_by_mass`` and ``speed_by_mass`` are derivatives with respect to a factor on the mass. ``kind`` is
    "complete", "incomplete" if there may be a higher point (see ``warning``), "not found", or "none" if no resonance of the
    mode can cross the line.

    Parameters
    ----------
    speeds : (low, high), rad/s
        Search range.
    mode : int
    conditions : Conditions
    margin : LeastMargin, optional
        If given, margins against fatigue are computed.
    named : tuple
        Values of the functions among the conditions, which identify them in results files.
    """

    speeds: tuple[float, float]
    mode: int = 1
    conditions: Conditions = field(default_factory=Conditions)
    margin: LeastMargin | None = None
    named: tuple[Any, ...] = ()

    def __call__(self, problem: Problem, preload: float | None) -> dict[str, Any]:
        meter = CostMeter()
        results = self._results(problem, meter)
        neglected = problem.model.neglected_over_speed(problem.settings.needed_diameters)
        results["warning"] = "; ".join(
            [*results["warning"], *(f"neglected: {note}" for note in neglected)]
        )
        loaded = (
            b.mass for b in problem.model.bodies.values() if b.kind == "free" and b.load is not None
        )
        return (
            dict.fromkeys(NUMBERS, np.nan)
            | {"mass": next(loaded, np.nan)}
            | results
            | {"cost": meter.read()}
        )

    def _results(self, problem: Problem, meter: CostMeter) -> dict[str, Any]:
        """Return the results without NaN, and warnings as a list."""
        family = SpeedFamily(problem, self.conditions)
        found = follow_mode(family, self.speeds, self.mode, meter)
        highest = None if found is None else found[2]
        if found is None or highest is None:
            why = family.limits_text(*self.speeds, self.mode)
            return {"kind": "none" if found is None else NOT_FOUND, "warning": [why]}
        equations, curve, _ = found
        warnings = [f"curve {curve.status}: {curve.reason}"] if curve.status != COMPLETE else []
        warnings += [highest.note] if highest.note else []
        equations, top, solution, first, error = refined(family, equations, highest.peak, meter)
        if not error <= CLOSE:
            left = f"interpolation over speed leaves a residual of {error:.2g} times the excitation at the highest point"
            fixed = exact_at_fixed_speed(family, self.speeds, self.mode, top, meter)
            if isinstance(fixed, str):
                where = family.limits_text(*self.speeds, self.mode)
                return {"kind": NOT_FOUND, "warning": [*warnings, left, fixed, where]}
            solution = fixed
            doubt = "" if fixed.status == COMPLETE else f" ({fixed.status})"
            warnings.append(
                f"{left}; this is the peak at fixed speed, to {percent(AROUND[-1])} in speed{doubt}"
            )
        elif not first <= CLOSE:
            warnings.append(
                f"interpolation over the range leaves a residual of {first:.2g}; give a shorter one"
            )
        out: dict[str, Any] = {
            "kind": INCOMPLETE if warnings else COMPLETE, "speed": solution.parameter, "amplitude": solution.amplitude,
            "frequency": solution.frequency, "preload": family.preload(solution.parameter), "residual": solution.residual,
            **(by_mass(family, equations, top) if error <= CLOSE else {}),
            **{name: float(x) for name, x in zip(("stick", "slip", "open"), solution.shares)},
        }  # fmt: skip
        fixed = interpolated_at_fixed_speed(equations, top, meter) if error <= CLOSE else solution
        if isinstance(fixed, str):
            warnings.append(fixed)
        else:
            out |= {"fixed_speed": fixed.parameter, "fixed_speed_amplitude": fixed.amplitude}
        if self.margin is not None:
            at_speed, unknowns = family.problem(solution.parameter), solution.y[:-1]
            out["margin"] = self.margin(at_speed, unknowns, float(solution.y[-1]), out["preload"])
        edges = family.problem(solution.parameter).at(out["preload"]).static.edges
        warnings += [f"edge contact, more blade modes may change it: {edges}"] if edges else []
        return out | {"warning": warnings}


@short_repr
@dataclass(frozen=True)
class Crossings(SweepResult, kind="bdamper-crossings"):
    """Results of :class:`CrossingTask` over ``damper_mass_factor`` and ``engine_order``.

    :func:`bdamper.plot.plot_crossings` draws them.
    """

    def _headline(self) -> str:
        amplitude = numbers_of(self.values, "amplitude")
        if not np.isfinite(amplitude).any():
            reasons = [why for why in (*self.warnings, *self.status) if why not in ("", COMPLETE)]
            return f"No crossing: {'; '.join(dict.fromkeys(reasons))}."
        highest = self._highest_by_mass()
        if len(highest) > 1:
            best = min(highest, key=lambda mass: highest[mass])
            of_best = self.points[MASS] == best
            out = [f"Best damper mass factor: {best:g}.", *self._top(of_best)]
            others = [value for mass, value in highest.items() if mass != best]
            low, high = amount(min(others), "m"), amount(max(others), "m")
            reached = low if low == high else f"{low} to {high}"
            out.append(
                f"Highest {'crossings' if len(others) > 1 else 'crossing'} of the other masses: {reached}."
            )
        else:
            of_best = np.full(len(self), True)
            out = self._top(of_best)
        out += self._least_margin(of_best)
        out.append("Not checked in time or with more blade modes and contact points.")
        missing = np.flatnonzero(~np.isfinite(amplitude))
        if len(missing):
            first = missing[0]
            reason = self.warnings[first] or self.status[first]
            out.append(f"No crossing at {len(missing)} of {counted(len(self), 'point')}: {reason}.")
        return " ".join(out)

    def _highest_by_mass(self) -> dict[float, float]:
        """Return the highest amplitude (m) of each damper mass whose crossings are all known.

        Crossings that are known for no mass are ignored, and so are engine orders that meet no resonance.
        """
        amplitude, mass, order = (
            numbers_of(self.values, "amplitude"),
            self.points[MASS],
            self.points["engine_order"],
        )
        known = np.isfinite(amplitude)
        settled = known | np.array([kind == "none" for kind in self.values["kind"]])
        comparable = np.isin(order, order[settled])
        complete = [
            value
            for value in dict.fromkeys(mass.tolist())
            if settled[comparable & (mass == value)].all()
        ]
        return {
            value: float(amplitude[of].max())
            for value in complete
            if (of := known & (mass == value)).any()
        }

    def _top(self, among: NDArray) -> list[str]:
        """Return sentences about the highest of some crossings."""
        i = int(np.nanargmax(np.where(among, numbers_of(self.values, "amplitude"), np.nan)))
        top = row_of(self.values, i)
        peak = peak_text(top["amplitude"], top["frequency"])
        place = f"{top['speed']:.5g} rad/s ({top['speed'] * RPM:.0f} rpm), {as_words(row_of(self.points, i))}"
        out = [
            f"Highest crossing: {peak}, {place}, under a preload of {amount(top['preload'], 'N')}."
        ]
        if top["warning"]:
            doubt = "Note: " if top["kind"] == COMPLETE else "There may be a higher point: "
            out.append(f"{doubt}{top['warning']}.")
        return out

    def _least_margin(self, among: NDArray) -> list[str]:
        """Return a sentence about the least margin of some crossings; none without margins."""
        margins = np.where(among, numbers_of(self.values, "margin"), np.nan)
        if not np.isfinite(margins).any():
            return []
        k = int(np.nanargmin(margins))
        return [
            f"Least margin against fatigue {margins[k]:.3g} ({as_words(row_of(self.points, k))})."
        ]


def resonance_crossings(
    problem: Problem,
    /,
    speeds: tuple[float, float] | Sequence[float] | NDArray | None = None,
    engine_orders: Sequence[int] = (),
    *,
    rpm: tuple[float, float] | Sequence[float] | NDArray | None = None,
    damper_mass_factor: Sequence[float] = (1.0,),
    mode: int = 1,
    executor: Executor | None = None,
    resume: str | Path | None = None,
    progress: bool | None = None,
    margin: LeastMargin | None = None,
    conditions: Conditions,
) -> Crossings:
    """See :meth:`bdamper.Study.resonance_crossings`."""
    values = speed_values(asked_speeds(problem, speeds, rpm))
    orders = validation.integers("engine_orders", engine_orders, least=1)
    factors = validation.numbers(MASS, damper_mass_factor, above=0.0)
    mode = validation.integer("mode", mode, least=1)
    validation.check(orders, "engine_orders", "at least one", "none")
    preload = preload_at(problem, float(values[-1]))
    if not problem.carries_load:
        raise SettingError(
            f"crossings need a model with a body that carries a load; {problem.why_no_load}"
        )
    if mode > 1:
        free_and_stuck(problem.at(preload), mode)
    operating = conditions
    named = operating.values(
        values.tolist(), orders
    )  # raises an error if tables do not cover the speeds
    if margin is not None:
        validation.instance("margin", margin, LeastMargin)
        chosen_sets(problem)
    task = CrossingTask((float(values[0]), float(values[-1])), mode, operating, margin, named)
    # the points of the sweep have no speed yet; at each speed of a line the load follows from the mass
    over = {INERTIA: factors.tolist(), "engine_order": list(orders)}
    found = sweep(problem, over, task, executor=executor, resume=resume, progress=progress)
    points = named_fields(
        {MASS: found.points[INERTIA], "engine_order": found.points["engine_order"]}, len(found)
    )
    swept = {f.name: getattr(found, f.name) for f in fields(found)}
    return Crossings(**swept | {"names": (MASS, "engine_order"), "points": points})


def speed_values(speeds: Any, n: int = 13) -> NDArray:
    """Return speeds (n,) in rad/s: n values between two limits, or the given longer sequence.

    Raises
    ------
    SettingError
        If they are not positive and increasing.
    """
    values = validation.numbers("speeds", speeds, above=0.0, unit="rad/s")
    if len(values) < 2 or np.any(np.diff(values) <= 0.0):
        raise validation.invalid(
            "speeds", "(low, high) in rad/s, or a longer sequence of increasing values", speeds
        )
    return values if len(values) > 2 else np.linspace(values[0], values[1], n)
