"""Campbell and interference diagrams, and the run-up along the line of an engine order.

An excitation of engine order EO is a travelling wave of nodal diameter ``d = EO mod N``, or ``N -
d`` if that is less. It excites modes of this nodal diameter only, with the frequency ``EO Omega/(2
pi)``. The Campbell diagram of an engine order shows the natural frequencies of its nodal diameter
against rotor speed. The interference (SAFE) diagram shows the natural frequencies of all modes
against nodal diameter at one speed, with the line of the excitation folded at N/2.

The run-up is a single response curve, with the preload that belongs to each rotor speed
(:mod:`bdamper.analyses.engine_order_line`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.crossings import speed_values
from bdamper.analyses.engine_order_line import (
    CLOSE,
    SpeedFamily,
    follow_line,
    follow_mode,
    interval,
    peak_at_fixed_speed,
    refined,
)
from bdamper.analyses.sweep import SweepResult
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.rotor_speed import (
    RPM,
    Conditions,
    asked_speeds,
    preload_at,
    responses,
    under,
)
from bdamper.response.events import ContinuationOptions
from bdamper.response.linear_limits import free_and_stuck
from bdamper.response.peak import Peak
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util import validation
from bdamper.util.display import Fact, Plottable, Result, draw
from bdamper.util.errors import INCOMPLETE, BdamperError
from bdamper.util.formatting import amount, counted, listed, percent, sentence, short_repr
from bdamper.util.progress import CostMeter, one_thread, shows_progress, with_progress
from bdamper.util.statement import Statement
from bdamper.util.storage import FilePath, Recorded, Storable
from bdamper.util.tables import Hertz, Numbers, RadiansPerSecond, Tabular


@short_repr
@dataclass(frozen=True)
class Campbell(Result, Plottable, Tabular, Recorded, Storable, kind="bdamper-campbell"):
    """Natural frequencies as functions of rotor speed.

    ``plot`` draws the Campbell diagram (:func:`bdamper.plot.plot_campbell`), ``plot_safe`` the
    interference diagram at one speed (:func:`bdamper.plot.plot_safe`).

    Parameters
    ----------
    speed : (n,) float, rad/s
    nodal_diameter : (k,) int
        Nodal diameters of the model.
    free, stuck : (k, n, modes) float, Hz
        Frequencies without contact, and with stuck contacts at all points that the preload at the
        speed closes.
    n_blades : int
    engine_order : (m,) int
        Requested engine orders.
    damped : tuple of SweepResult
        Damped crossings.
    notes : tuple of str
        Effects of speed that the model neglects.
    settings : mapping
    model_hash : str
    """

    speed: RadiansPerSecond
    nodal_diameter: Numbers
    free: Hertz
    stuck: Hertz
    n_blades: int
    engine_order: NDArray
    damped: tuple[SweepResult, ...] = ()
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.speed)

    def with_present_names(self) -> Self:
        """Return a result of an earlier version with the present names of settings."""
        return replace(self, damped=tuple(result.with_present_names() for result in self.damped))

    def met_by(self, engine_order: int) -> int:
        """Return the nodal diameter that an engine order excites."""
        # waves d and n_blades - d are the same nodal diameter in opposite directions
        wave = engine_order % self.n_blades
        return min(wave, self.n_blades - wave)

    def row(self, nodal_diameter: int) -> int:
        """Return the index of a nodal diameter.

        Raises
        ------
        SettingError
            If the diagram does not contain it.
        """
        diameters = self.nodal_diameter.tolist()
        validation.check(
            nodal_diameter in diameters, "nodal_diameter", f"one of {diameters}", nodal_diameter
        )
        return diameters.index(nodal_diameter)

    @property
    def met(self) -> NDArray:
        """Crossings (j, 4) of engine orders and modes.

        The columns are order, mode, and speeds (rad/s) of the free and the stuck resonance on the
        line of the order. There is one row for each order and mode, more if a resonance crosses a
        line more than once; NaN without a crossing.
        """
        _, _, n_modes = self.free.shape
        rows = []
        for order in self.engine_order.tolist():
            diameter = self.row(self.met_by(order))
            for mode in range(n_modes):
                free_hertz = self.free[diameter, :, mode]
                stuck_hertz = self.stuck[diameter, :, mode]
                free = line_crossings(self.speed, free_hertz, order).tolist()
                stuck = line_crossings(self.speed, stuck_hertz, order).tolist()
                # a row without crossings too
                pairs = zip_longest(free or [np.nan], stuck or [np.nan], fillvalue=np.nan)
                for free_speed, stuck_speed in pairs:
                    rows.append((order, mode + 1, free_speed, stuck_speed))
        # also without any engine order
        return np.array(rows, float).reshape(-1, 4)

    def plot_safe(
        self, speed: float | None = None, path: FilePath | None = None, **options: Any
    ) -> Any:
        """Draw the interference diagram at a speed in rad/s (:func:`bdamper.plot.plot_safe`)."""
        return draw(self, "figure", "plot_safe", path, speed, **options)

    def _grid(self) -> dict[str, Any]:
        return {
            "nodal_diameter": self.nodal_diameter,
            "speed": self.speed,
            "mode": np.arange(1, self.free.shape[2] + 1),
        }

    def _facts(self) -> tuple[Fact, ...]:
        """Return the crossings of orders and modes."""
        return tuple(
            Fact(
                f"order {order:g}, mode {mode:g}",
                f"free {_place(free, order)}, stuck {_place(stuck, order)}",
            )
            for order, mode, free, stuck in self.met
        )

    def _statement(self) -> Statement:
        table: list[tuple[str, ...]] = [("Order and mode", "Without contact", "Stuck")]
        for order, mode, free, stuck in self.met:
            if np.isfinite([free, stuck]).any():
                places = (_place(speed, order) for speed in (free, stuck))
                table.append((f"{order:g}, mode {mode:g}", *places))
        low, high = self.speed[0], self.speed[-1]
        interval = f"between {low * RPM:.0f} and {high * RPM:.0f} rpm"
        orders = listed(map(str, self.engine_order))
        n_crossings = len(table) - 1
        if len(self.engine_order) == 1:
            verdict = f"Engine order {orders} meets {counted(n_crossings, 'mode')} {interval}"
        else:
            crossings = sentence(counted(n_crossings, "crossing"))
            verdict = f"{crossings} of modes with engine orders {orders} {interval}"
        remark = "Not covered: amplitudes (study.resonance_crossings), Coriolis forces"
        return Statement([verdict], remarks=[remark], table=table if n_crossings else ())


def _place(speed: float, engine_order: float) -> str:
    """Return the speed (rad/s) and the frequency of a crossing as text."""
    if not np.isfinite(speed):
        return "no crossing"
    frequency = amount(engine_order * speed / (2.0 * np.pi), "Hz")
    return f"{speed * RPM:.0f} rpm, {frequency}"


def line_crossings(speed: NDArray, frequency: NDArray, engine_order: int) -> NDArray:
    """Return the speeds (k,) in rad/s at which a resonance crosses the line of an engine order.

    Squared frequencies are interpolated linearly over squared speeds, which is exact if mode shapes
    do not change.

    Parameters
    ----------
    speed : (n,) float, rad/s
    frequency : (n,) float, Hz
    engine_order : int
    """
    # difference of squared angular frequencies of resonance and excitation, zero at a crossing
    gap = (2.0 * np.pi * frequency) ** 2 - (engine_order * speed) ** 2
    # each crossing is at speed i or between it and the next one
    i = np.flatnonzero((gap[:-1] == 0.0) | (gap[:-1] * gap[1:] < 0.0))
    before = gap[i]
    after = gap[i + 1]
    # the gap may be zero at both ends of a step
    step = np.where(before == after, 1.0, before - after)
    share = np.where(before == 0.0, 0.0, before / step)
    crossings = np.sqrt(speed[i] ** 2 + share * (speed[i + 1] ** 2 - speed[i] ** 2))
    # no interval begins at the last speed; empty unless the resonance is there
    at_last_speed = speed[-1:][gap[-1:] == 0.0]
    return np.append(crossings, at_last_speed)


@one_thread
def campbell(
    problem: Problem,
    /,
    speeds: tuple[float, float] | Sequence[float] | NDArray | None = None,
    engine_orders: Sequence[int] = (),
    *,
    rpm: tuple[float, float] | Sequence[float] | NDArray | None = None,
    modes: int = 3,
    damped: SweepResult | Sequence[SweepResult] | None = None,
    progress: bool | None = None,
    conditions: Conditions,
) -> Campbell:
    """See :meth:`bdamper.Study.campbell`."""
    values = speed_values(asked_speeds(problem, speeds, rpm))
    orders = validation.integers("engine_orders", engine_orders, least=1)
    modes = validation.integer("modes", modes, least=1)
    if isinstance(damped, SweepResult):
        damped = (damped,)
    crossings = tuple(damped or ())
    for result in crossings:
        _check_damped(problem, result)
    model = problem.model
    own_diameter = model.folded_nodal_diameter(int(problem.engine_order))[0]
    diameters = _diameters(problem) or [own_diameter]
    outside = [order for order in orders if model.folded_nodal_diameter(order)[0] not in diameters]
    validation.check(
        not outside,
        "engine_orders",
        f"orders that excite nodal diameters {diameters}",
        outside,
    )
    # natural frequencies do not depend on a variation of the excitation with speed
    without_excitation = Conditions(conditions.friction, conditions.temperature)
    families = []
    for diameter in diameters:
        # the engine order n_blades excites nodal diameter 0
        order = diameter or model.n_blades
        of_diameter = problem.replace(engine_order=order, harmonics=1)
        families.append(SpeedFamily(of_diameter, without_excitation))
    # all nodal diameters have the same static state: it is computed with one of them
    with_statics = diameters.index(own_diameter) if own_diameter in diameters else 0
    free = np.full((len(diameters), len(values), modes), np.nan)
    stuck = np.full((len(diameters), len(values), modes), np.nan)
    steps = with_progress(values.tolist(), shows_progress(progress), "Campbell diagram", "speed")
    for i, speed in enumerate(steps):
        problems = [under(family.base, speed, without_excitation) for family in families]
        preload = preload_at(problem, speed) if problem.carries_load else 0.0
        states = problems[with_statics].static_states
        for row, at_speed in enumerate(problems):
            case = at_speed.given(static_states=states).at(preload)
            free[row, i], stuck[row, i] = free_and_stuck(case, modes)
    return Campbell(
        speed=values,
        nodal_diameter=np.array(diameters, int),
        free=free,
        stuck=stuck,
        n_blades=model.n_blades,
        engine_order=np.array(orders, int),
        damped=crossings,
        notes=model.neglected_over_speed(),
        **problem.recorded(),
    )


def _check_damped(problem: Problem, result: Any) -> None:
    """Raise SettingError unless a result has crossings of the model of a problem."""
    # other sweeps have other quantities
    are_crossings = isinstance(result, SweepResult) and {"speed", "mass"} <= {*result.quantities}
    validation.check_value(
        are_crossings, "damped", "crossings, as Study.resonance_crossings returns them", result
    )
    same_model = result.model_hash == problem.model.hash
    validation.check(same_model, "damped", "crossings of this model", "crossings of another model")


def _diameters(problem: Problem) -> list[int]:
    """Return the nodal diameters of the constrained bodies.

    If some of them have speed-dependent modes, only these count.
    """
    with_modes = set()
    with_speed = set()
    for body in problem.model.bodies.values():
        if body.kind != "constrained":
            continue
        for diameter, basis in body.bases.items():
            with_modes.add(diameter)
            if basis.speed is not None:
                with_speed.add(diameter)
    return sorted(with_speed or with_modes)


# ---- Run-up ----


WITHIN = (50.0, 2000.0)
"""Limits of the speed (rad/s) for a crossing without given speeds."""


@one_thread
def run_up(
    problem: Problem,
    /,
    speeds: tuple[float, float] | None = None,
    *,
    rpm: tuple[float, float] | None = None,
    mode: int = 1,
    options: ContinuationOptions | None = None,
    progress: bool | None = None,
    conditions: Conditions,
) -> ResponseCurve:
    """See :meth:`bdamper.Study.run_up`."""
    mode = validation.integer("mode", mode, least=1)
    has_range = speeds is not None or rpm is not None
    if has_range:
        limits = speed_values(asked_speeds(problem, speeds, rpm))
    else:
        limits = np.clip(conditions.reach(int(problem.engine_order)), *WITHIN)
    low = float(limits[0])
    high = float(limits[-1])
    meter = CostMeter()
    family = SpeedFamily(problem, conditions)
    # a given range is followed as a whole
    whole_range = has_range and interval(family, low, high, mode) is not None
    follow = follow_line if whole_range else follow_mode

    def no_maximum(remark: str = "") -> BdamperError:
        limits = family.limits_text(low, high, mode)
        return BdamperError(f"run-up: mode {mode} has no maximum: {limits}{remark}")

    line = follow(family, (low, high), mode, meter, options, shows_progress(progress))
    if line is None:
        raise no_maximum()
    equations, curve, highest = line
    if highest is None:
        raise no_maximum(f"; {curve._headline()}")
    # ``top`` solves equations assembled at its speed; ``near`` interpolates around this speed
    near, _, top, error, last_error = refined(family, equations, highest.peak, meter)
    if error > CLOSE:
        doubt = f"interpolation in speed leaves a residual of {error:.2g} at the highest point"
        curve = replace(
            curve,
            status=INCOMPLETE,
            reason=f"{curve.reason}; {doubt}; use a shorter range of speeds",
        )
    fixed = peak_at_fixed_speed(family, equations, (low, high), mode, highest.peak, meter)
    # one point: its unknowns (1, n_unknowns + 1), its harmonics (1, n_harmonics + 1)
    (harmonics,) = responses(near, top.y[None])
    result = _with_maximum(curve, highest.index, top, harmonics)
    # no interpolated point is higher than the refined one
    refined_is_highest = result.peak_index == highest.index
    validation.check(
        last_error <= CLOSE and refined_is_highest,
        "speeds",
        "a speed range in which the equations change smoothly",
        f"a residual of {error:.2g} after interpolation over this range; use a shorter range",
    )
    notes = (
        _comparison_text(top, fixed),
        f"interpolation in speed leaves a residual of {error:.1e} there",
    )
    return replace(result, notes=(*curve.notes, *notes), cost=meter.read())


def _with_maximum(curve: ResponseCurve, index: int, top: Peak, harmonics: NDArray) -> ResponseCurve:
    """Return the curve with the refined highest maximum, and without unknowns.

    ``top`` replaces the point with the given ``index``; ``harmonics`` (n_harmonics + 1,) are its
    response (m).  Unknowns of a run-up cannot be used in a study at one speed, because their residual modes have
    other phases.
    """
    values: dict[str, Any] = {
        "harmonics": harmonics,
        "frequency": top.frequency,
        "speed": top.parameter,
        "shares": top.shares,
        "residual": top.residual,
    }
    columns: dict[str, Any] = {}
    for name, value in values.items():
        columns[name] = np.array(getattr(curve, name))
        columns[name][index] = value
    return replace(curve, **columns, unknowns=np.zeros((len(curve), 0)))


def _comparison_text(top: Peak, fixed: Peak | str) -> str:
    """Return a text about the highest maximum and the peak at fixed speed."""
    if isinstance(fixed, str):
        comparison = fixed
    else:
        above = percent(top.amplitude / fixed.amplitude - 1.0)
        peak = f"{amount(fixed.amplitude, 'm', 4)} at {fixed.parameter:.5g} rad/s"
        comparison = f"{above} above the peak at fixed speed, {peak}"
    maximum = f"{amount(top.amplitude, 'm', 4)} at {top.parameter:.5g} rad/s"
    return f"highest maximum {maximum}: {comparison}"
