"""Resonance crossings in a range of rotor speeds, for several damper masses.

A crossing is the highest response on the line of an engine order, as in a slow run-up. Each point
of the line has its own speed and therefore its own preload. :func:`resonance_crossings` computes a
crossing for each damper mass and engine order, in a sweep (:func:`bdamper.sweep`).
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
    highest_at_speed,
    peak_at_fixed_speed,
    refined,
)
from bdamper.analyses.sweep import SEPARATOR, SweepResult, as_words, sweep
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
from bdamper.response.highest_peak import FOLLOWED
from bdamper.response.linear_limits import free_and_stuck
from bdamper.response.peak import Peak
from bdamper.response.peak_error import changes_by_source
from bdamper.response.response_curve_result import NO_STEADY, ResponseCurve
from bdamper.response.richer_peak import peak_errors
from bdamper.response.sensitivity import sensitivities
from bdamper.util import validation
from bdamper.util.errors import (
    COMPLETE,
    FAILURES_AT_ONE_PRELOAD,
    INCOMPLETE,
    NOT_FOUND,
    Ending,
    SettingError,
)
from bdamper.util.formatting import (
    amount,
    beyond,
    counted,
    extent,
    peak_text,
    percent,
    short_repr,
)
from bdamper.util.progress import Cost, CostMeter
from bdamper.util.records import named_fields, numbers_of, row_of
from bdamper.util.statement import Row, Statement

NUMBERS = (
    "amplitude",
    "speed",
    "frequency",
    "preload",
    "mass",
    "stick",
    "slip",
    "open",
    "fixed_speed",
    "fixed_speed_amplitude",
    "amplitude_by_mass",
    "speed_by_mass",
    "margin",
    "harmonic_change",
    "vector_change",
    "error",
    "residual",
)
"""Numeric results of a crossing; NaN if there is none."""


def by_mass(family: SpeedFamily, equations: Equations[Family], top: Peak) -> dict[str, float]:
    """Return the derivatives of the highest point with respect to a factor on the damper mass.

    The factor acts on load and inertia of all free bodies. The result is empty if there is no
    derivative.
    """
    low = (1.0 - AROUND[-1]) * top.parameter
    high = (1.0 + AROUND[-1]) * top.parameter

    def with_factor(factor: float) -> Equations[Family]:
        return family.along(low, high, 2, factor)

    try:
        derivative = sensitivities(top, {"mass": (with_factor, 1.0)})["mass"]
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

    Results are :data:`NUMBERS` in SI units, NaN without a crossing. ``mass`` is the mass of the
    loaded damper. ``fixed_speed`` and ``fixed_speed_amplitude`` describe the peak at fixed speed
    near the highest point. ``amplitude_by_mass`` and ``speed_by_mass`` are derivatives with respect
    to a factor on the mass. ``kind`` is "complete", "incomplete" if there may be a higher point
    (see ``warning``), "not found", or "none" if no resonance of the mode can cross the line.

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
    errors : bool
        Estimate the errors by harmonics and residual modes: "harmonic_change", "vector_change", and
        their sum "error", relative to the amplitude, from the peak at fixed speed.
    """

    speeds: tuple[float, float]
    mode: int = 1
    conditions: Conditions = field(default_factory=Conditions)
    margin: LeastMargin | None = None
    named: tuple[Any, ...] = ()
    errors: bool = True

    def __call__(self, problem: Problem, preload: float | None) -> dict[str, Any]:
        meter = CostMeter()
        results: dict[str, Any] = dict.fromkeys(NUMBERS, np.nan)
        # mass of the loaded damper
        for body in problem.model.bodies.values():
            if body.is_free and body.load is not None:
                results["mass"] = body.mass
                break
        results |= self._results(problem, meter)
        neglected = problem.model.neglected_over_speed(problem.settings.needed_diameters)
        warnings = results["warning"] + [f"neglected: {note}" for note in neglected]
        results["warning"] = SEPARATOR.join(warnings)
        results["cost"] = meter.read()
        return results

    def _results(self, problem: Problem, meter: CostMeter) -> dict[str, Any]:
        """Return the results without NaN, and warnings as a list."""
        family = SpeedFamily(problem, self.conditions)
        line = follow_mode(family, self.speeds, self.mode, meter)
        highest = None if line is None else line[2]
        if line is None or highest is None:
            reason = family.limits_text(*self.speeds, self.mode)
            return {"kind": "none" if line is None else NOT_FOUND, "warning": [reason]}
        equations, curve, _ = line
        warnings = []
        if curve.status != COMPLETE:
            warnings.append(f"curve {curve.status}: {curve.reason}")
        if highest.note:
            warnings.append(highest.note)
        equations, top, solution, first, error = refined(family, equations, highest.peak, meter)
        exact_equations = error <= CLOSE
        if not exact_equations:
            residual = (
                f"interpolation in speed leaves a residual of {error:.2g} times the excitation at "
                "the highest point"
            )
            fixed = exact_at_fixed_speed(family, self.speeds, self.mode, top, meter)
            if isinstance(fixed, str):
                reason = family.limits_text(*self.speeds, self.mode)
                return {"kind": NOT_FOUND, "warning": [*warnings, residual, fixed, reason]}
            solution = fixed
            doubt = "" if fixed.ok else f" ({fixed.status_text})"
            warnings.append(
                f"{residual}; the result is the peak at fixed speed, with its speed accurate to "
                f"{percent(AROUND[-1])}{doubt}"
            )
        elif not first <= CLOSE:
            warnings.append(
                f"interpolation over the range leaves a residual of {first:.2g}; use a shorter "
                "range"
            )
        preload = family.preload(solution.parameter)
        stick, slip, open_share = solution.shares
        results: dict[str, Any] = {
            "kind": INCOMPLETE if warnings else COMPLETE,
            "speed": solution.parameter,
            "amplitude": solution.amplitude,
            "frequency": solution.frequency,
            "preload": preload,
            "residual": solution.residual,
            "stick": float(stick),
            "slip": float(slip),
            "open": float(open_share),
        }
        if exact_equations:
            results |= by_mass(family, equations, top)
            fixed = peak_at_fixed_speed(family, equations, self.speeds, self.mode, top, meter)
        else:
            fixed = solution
        if isinstance(fixed, str):
            warnings.append(fixed)
        else:
            results["fixed_speed"] = fixed.parameter
            results["fixed_speed_amplitude"] = fixed.amplitude
            if self.errors:
                results |= self._errors(family, fixed, meter)
        at_fixed_speed = self._verdict_at_speed(family, curve, solution.parameter, meter)
        if at_fixed_speed.status == NOT_FOUND:
            return {"kind": NOT_FOUND, "warning": [*warnings, at_fixed_speed.reason]}
        if not at_fixed_speed.ok:
            results["kind"] = INCOMPLETE
            warnings.append(at_fixed_speed.reason)
        at_speed = family.problem(solution.parameter)
        if self.margin is not None:
            unknowns = solution.y[:-1]
            results["margin"] = self.margin(at_speed, unknowns, float(solution.y[-1]), preload)
        edges = at_speed.at(preload).static.edges
        if edges:
            warnings.append(f"edge contact, more blade modes may change it: {edges}")
        results["warning"] = warnings
        return results

    def _verdict_at_speed(
        self, family: SpeedFamily, curve: ResponseCurve, speed: float, meter: CostMeter
    ) -> Ending:
        """Return the verdict on a crossing that the response at its speed (rad/s) gives.

        It is "not found" if no steady periodic response is expected there, and "incomplete" if a
        peak of a lower preload is higher.  A line without folds loses no branch.
        """
        if not len(curve.folds):
            return Ending()
        try:
            peak = highest_at_speed(family, speed, self.mode)
        except FAILURES_AT_ONE_PRELOAD:
            return Ending()
        meter.add(peak.cost or Cost())
        if peak.reason.startswith((NO_STEADY, FOLLOWED)):
            return Ending(peak.status, f"at fixed speed: {peak.reason}")
        return Ending()

    @staticmethod
    def _errors(family: SpeedFamily, fixed: Peak, meter: CostMeter) -> dict[str, float]:
        """Return the relative errors of a peak at fixed speed."""
        try:
            problem = family.problem(fixed.parameter)
            preload = family.preload(fixed.parameter)
            found = peak_errors(problem, preload, (fixed,), meter)
        except FAILURES_AT_ONE_PRELOAD:
            return {}
        return changes_by_source(found.errors)


@short_repr
@dataclass(frozen=True)
class Crossings(SweepResult, kind="bdamper-crossings"):
    """Results of :class:`CrossingTask` over ``damper_mass_factor`` and ``engine_order``.

    :func:`bdamper.plot.plot_crossings` draws them.
    """

    def _statement(self) -> Statement:
        amplitude = numbers_of(self.values, "amplitude")
        if not np.isfinite(amplitude).any():
            reasons = [
                text for text in (*self.warnings, *self.status_text) if text not in ("", COMPLETE)
            ]
            return Statement([f"No crossing: {'; '.join(dict.fromkeys(reasons))}"])
        highest = self._highest_by_mass()
        best = "Highest crossing"
        end = ""
        among = np.full(len(self), True)
        rows = []
        if len(highest) > 1:
            mass = min(highest, key=lambda mass: highest[mass])
            among = self.points[MASS] == mass
            masses = np.unique(self.points[MASS])
            if mass == masses[0]:
                end = "lower"
            elif mass == masses[-1]:
                end = "upper"
            best = f"Lowest crossing peak with {mass:g} times the damper mass"
            best += f", at the {end} end of the range:" if end else ":"
            others = [value for other, value in highest.items() if other != mass]
            reached = extent(min(others), max(others), "m")
            rows.append(Row("Other masses", reached, "highest crossing peak of each"))
        i = int(np.nanargmax(np.where(among, amplitude, np.nan)))
        top = row_of(self.values, i)
        peak = peak_text(top["amplitude"], top["frequency"])
        # files of earlier versions have no errors
        if np.isfinite(top.get("error", np.nan)):
            peak += f", error about {percent(top['error'])}"
        point = dict(row_of(self.points, i))
        if len(highest) > 1:
            del point[MASS]
        verdict = f"{best} {peak}, {as_words(point)}"
        speed = Row("Speed", f"{top['speed'] * RPM:.0f} rpm", f"{top['speed']:.5g} rad/s")
        rows = [speed, Row("Preload", amount(top["preload"], "N")), *rows]
        rows += self._margin_rows(among)
        remarks = [f"Remedy: include {MASS} {beyond(end)} {mass:g}"] if end else []
        if top["warning"]:
            doubt = "Note" if top["kind"] == COMPLETE else "There may be a higher point"
            remarks.append(f"{doubt}: {top['warning']}")
        missing = np.flatnonzero(~np.isfinite(amplitude))
        if len(missing):
            reason = self.warnings[missing[0]] or self.status_text[missing[0]]
            points = counted(len(self), "point")
            remarks.append(f"No crossing at {len(missing)} of {points}: {reason}")
        remarks.append("Not covered: mistuning, wear, more blade modes and contact points")
        in_time = Row("Time integration", "not run", "study.at_speed, then time_response")
        return Statement([verdict], rows, [in_time], remarks, self._crossing_table())

    def _crossing_table(self) -> list[tuple[str, ...]]:
        """Return one row for each damper mass and engine order."""
        names = ("Mass factor", "Order", "Speed", "Preload", "Frequency", "Peak", "Remark")
        table: list[tuple[str, ...]] = [names]
        for i in range(len(self)):
            point, value = row_of(self.points, i), row_of(self.values, i)
            found = ("", "", "", "")
            if np.isfinite(value["amplitude"]):
                found = (
                    f"{value['speed'] * RPM:.0f} rpm",
                    amount(value["preload"], "N"),
                    amount(value["frequency"], "Hz"),
                    amount(value["amplitude"], "m"),
                )
            # a point that failed has no values
            kind = str(value["kind"] or self.status[i])
            remark = {COMPLETE: "", "none": "no crossing"}.get(kind, kind)
            table.append((f"{point[MASS]:g}", f"{point['engine_order']}", *found, remark))
        return table

    def _highest_by_mass(self) -> dict[float, float]:
        """Return the highest amplitude (m) of each damper mass whose crossings are all known.

        Crossings that are known for no mass are ignored, and so are engine orders that meet no
        resonance.
        """
        amplitude = numbers_of(self.values, "amplitude")
        mass = self.points[MASS]
        order = self.points["engine_order"]
        has_amplitude = np.isfinite(amplitude)
        meets_nothing = np.array([kind == "none" for kind in self.values["kind"]])
        settled = has_amplitude | meets_nothing
        comparable = np.isin(order, order[settled])
        highest = {}
        for value in dict.fromkeys(mass.tolist()):
            of_mass = mass == value
            rows = has_amplitude & of_mass
            if settled[comparable & of_mass].all() and rows.any():
                highest[value] = float(amplitude[rows].max())
        return highest

    def _margin_rows(self, among: NDArray) -> list[Row]:
        """Return the row of the smallest margin of some crossings; none without margins."""
        margins = np.where(among, numbers_of(self.values, "margin"), np.nan)
        if not np.isfinite(margins).any():
            return []
        i = int(np.nanargmin(margins))
        place = as_words(row_of(self.points, i))
        return [Row("Margin", f"{margins[i]:.3g}", f"smallest against fatigue, {place}")]


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
    errors: bool = True,
    conditions: Conditions,
) -> Crossings:
    """See :meth:`bdamper.Study.resonance_crossings`."""
    values = speed_values(asked_speeds(problem, speeds, rpm))
    orders = validation.integers("engine_orders", engine_orders, least=1)
    factors = validation.numbers(MASS, damper_mass_factor, above=0.0)
    mode = validation.integer("mode", mode, least=1)
    validation.check_sentence(orders, "engine_orders", "give at least one engine order")
    preload = preload_at(problem, float(values[-1]))
    if not problem.carries_load:
        raise SettingError(
            f"crossings need a model with a body that carries a load; {problem.why_no_load}"
        )
    # raises an error if there is no such mode
    if mode > 1:
        free_and_stuck(problem.at(preload), mode)
    # raises an error if tables do not cover the speeds
    named = conditions.values(values.tolist(), orders)
    if margin is not None:
        validation.instance("margin", margin, LeastMargin)
        chosen_sets(problem)
    errors = validation.flag("errors", errors)
    speed_range = (float(values[0]), float(values[-1]))
    task = CrossingTask(speed_range, mode, conditions, margin, named, errors)
    # the points of the sweep have no speed yet; at each speed of a line the load follows from the
    # mass
    over = {INERTIA: factors.tolist(), "engine_order": list(orders)}
    swept = sweep(problem, over, task, executor=executor, resume=resume, progress=progress)
    points = {MASS: swept.points[INERTIA], "engine_order": swept.points["engine_order"]}
    columns = {f.name: getattr(swept, f.name) for f in fields(swept)}
    columns["names"] = (MASS, "engine_order")
    columns["points"] = named_fields(points, len(swept))
    return Crossings(**columns)


def speed_values(speeds: Any, n: int = 13) -> NDArray:
    """Return speeds (n,) in rad/s: n values between two limits, or the given sequence if longer.

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
    if len(values) > 2:
        return values
    return np.linspace(values[0], values[1], n)
