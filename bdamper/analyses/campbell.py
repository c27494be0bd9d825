"""Campbell and interference diagrams, and the run-up along the line of an engine order.

An excitation of engine order EO is a travelling wave of nodal diameter ``d = EO mod N``, or ``N - d`` if that is less. It
excites modes of this nodal diameter only, with the frequency ``EO Omega/(2 pi)``. The Campbell diagram of an order shows
the modes of its nodal diameter over speed. The interference (SAFE) diagram shows all modes over nodal diameter at one
speed, with the line of the excitation folded at N/2.

The run-up is one response curve over rotor speed at the preload of each speed (:mod:`bdamper.analyses.engine_order_line`).
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
    interpolated_at_fixed_speed,
    interval,
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
from bdamper.util.display import Fact, Plottable, draw
from bdamper.util.errors import INCOMPLETE, BdamperError
from bdamper.util.formatting import amount, percent, short_repr
from bdamper.util.progress import CostMeter, one_thread, shows_progress, with_progress
from bdamper.util.storage import FilePath, Recorded, Storable
from bdamper.util.tables import Hertz, Numbers, RadiansPerSecond, Tabular


@short_repr
@dataclass(frozen=True)
class Campbell(Plottable, Tabular, Recorded, Storable, kind="bdamper-campbell"):
    """Natural frequencies over rotor speed.

    ``plot`` draws the Campbell diagram (:func:`bdamper.plot.plot_campbell`), ``plot_safe`` the interference diagram at one
    speed (:func:`bdamper.plot.plot_safe`).

    Parameters
    ----------
    speed : (n,) float, rad/s
    nodal_diameter : (k,) int
        Nodal diameters of the model.
    free, stuck : (k, n, modes) float, Hz
        Frequencies without contact, and with stuck contacts at all points that the preload at the speed closes.
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
        """Return a result of version 3 of the format with the present names of settings."""
        return replace(self, damped=tuple(result.with_present_names() for result in self.damped))

    def met_by(self, engine_order: int) -> int:
        """Return the nodal diameter that an engine order excites."""
        d = engine_order % self.n_blades
        return min(d, self.n_blades - d)

    def row(self, nodal_diameter: int) -> int:
        """Return the index of a nodal diameter.

        Raises
        ------
        SettingError
            If the diagram does not contain it.
        """
        known = self.nodal_diameter.tolist()
        validation.check(
            nodal_diameter in known, "nodal_diameter", f"one of {known}", nodal_diameter
        )
        return known.index(nodal_diameter)

    @property
    def met(self) -> NDArray:
        """Crossings (j, 4): order, mode, and speeds (rad/s) of the free and the stuck resonance on the line of the order.

        There is one row for each order and mode, more if a resonance crosses a line more than once; NaN without a crossing.
        """
        rows = []
        for order in self.engine_order.tolist():
            k = self.row(self.met_by(order))
            for m in range(self.free.shape[2]):
                lines = self.free[k, :, m], self.stuck[k, :, m]
                at = [
                    line_crossings(self.speed, line, order).tolist() or [np.nan] for line in lines
                ]
                rows += [(order, m + 1, *speeds) for speeds in zip_longest(*at, fillvalue=np.nan)]
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
        places = (
            (f"order {n:g}, mode {m:g}", f"free at {_place(a)}, stuck at {_place(b)}")
            for n, m, a, b in self.met
        )
        return tuple(Fact(*place) for place in places)

    def _headline(self) -> str:
        pairs = dict.fromkeys((n, m) for n, m, *speeds in self.met if np.isfinite(speeds).any())
        which = ", ".join(f"order {n:g} with mode {m:g}" for n, m in pairs) or "none"
        return f"Engine orders that cross modes from {_place(self.speed[0])} to {_place(self.speed[-1])}: {which}."


def _place(speed: float) -> str:
    return (
        f"{speed:.5g} rad/s ({speed * RPM:.0f} rpm)"
        if np.isfinite(speed)
        else "no speed of the range"
    )


def line_crossings(speed: NDArray, frequency: NDArray, engine_order: int) -> NDArray:
    """Return the speeds (k,) in rad/s at which a resonance crosses the line of an engine order.

    Squared frequencies are interpolated linearly over squared speeds, which is exact if mode shapes do not change.

    Parameters
    ----------
    speed : (n,) float, rad/s
    frequency : (n,) float, Hz
    engine_order : int
    """
    gap = (2.0 * np.pi * frequency) ** 2 - (engine_order * speed) ** 2
    i = np.flatnonzero((gap[:-1] == 0.0) | (gap[:-1] * gap[1:] < 0.0))
    part = np.where(
        gap[i] == 0.0, 0.0, gap[i] / np.where(gap[i] == gap[i + 1], 1.0, gap[i] - gap[i + 1])
    )
    crossings = np.sqrt(speed[i] ** 2 + part * (speed[i + 1] ** 2 - speed[i] ** 2))
    return np.append(crossings, speed[-1:][gap[-1:] == 0.0])


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
    shown = (damped,) if isinstance(damped, SweepResult) else tuple(damped or ())
    for result in shown:
        crossings = isinstance(result, SweepResult) and {"speed", "mass"} <= {*result.quantities}
        validation.check_value(
            crossings, "damped", "crossings, as Study.resonance_crossings returns them", result
        )
        same_model = result.model_hash == problem.model.hash
        validation.check(
            same_model, "damped", "crossings of this model", "crossings of another model"
        )
    operating, progress = conditions, shows_progress(progress)
    constrained = [body for body in problem.model.bodies.values() if body.kind == "constrained"]
    bases = [pair for body in constrained for pair in body.bases.items()]
    known = sorted({d for d, basis in bases if basis.speed is not None} or {d for d, _ in bases})
    own_diameter = problem.model.folded_nodal_diameter(int(problem.engine_order))[0]
    diameters = known or [own_diameter]
    free, stuck = np.full((2, len(diameters), len(values), modes), np.nan)
    n, resting = problem.model.n_blades, Conditions(operating.friction, operating.temperature)
    beyond = [
        order for order in orders if problem.model.folded_nodal_diameter(order)[0] not in diameters
    ]
    validation.check(
        not beyond, "engine_orders", f"orders that excite nodal diameters {diameters}", beyond
    )
    by_diameter = [
        SpeedFamily(problem.replace(engine_order=d or n, harmonics=1), resting) for d in diameters
    ]
    # all nodal diameters have the same static state
    mean = diameters.index(own_diameter) if own_diameter in diameters else 0
    for i, omega in enumerate(
        with_progress(values.tolist(), progress, "Campbell diagram", "speed")
    ):
        problems = [under(family.base, omega, resting) for family in by_diameter]
        preload = preload_at(problem, omega) if problem.carries_load else 0.0
        states = problems[mean].static_states
        for k, one in enumerate(problems):
            free[k, i], stuck[k, i] = free_and_stuck(
                one.given(static_states=states).at(preload), modes
            )
    return Campbell(
        speed=values,
        nodal_diameter=np.array(diameters, int),
        free=free,
        stuck=stuck,
        n_blades=n,
        engine_order=np.array(orders, int),
        damped=shown,
        notes=problem.model.neglected_over_speed(),
        **problem.recorded(),
    )


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
    operating = conditions
    limits = np.clip(operating.reach(int(problem.engine_order)), *WITHIN)
    narrow = speeds is not None or rpm is not None
    if narrow:
        limits = speed_values(asked_speeds(problem, speeds, rpm))
    mode = validation.integer("mode", mode, least=1)
    meter = CostMeter()
    family = SpeedFamily(problem, operating)
    low, high, progress = float(limits[0]), float(limits[-1]), shows_progress(progress)
    follow = follow_line if narrow and interval(family, low, high, mode) else follow_mode
    found = follow(family, (low, high), mode, meter, options, progress)
    highest = None if found is None else found[2]
    if found is None or highest is None:
        why = family.limits_text(low, high, mode) + (
            "" if found is None else f"; {found[1]._headline()}"
        )
        raise BdamperError(f"run-up: expected a maximum of mode {mode}, found none: {why}")
    equations, curve, _ = found
    near, _, top, error, last = refined(family, equations, highest.peak, meter)
    if error > CLOSE:
        why = f"interpolation over speed leaves a residual of {error:.2g} at the highest point"
        curve = replace(
            curve,
            status=INCOMPLETE,
            reason=f"{curve.reason}; {why}; give a shorter range of speeds",
        )
    fixed = interpolated_at_fixed_speed(equations, highest.peak, meter)
    out = _with_maximum(curve, highest.index, top, responses(near, top.y[None])[0])
    settled = (
        last <= CLOSE and out.peak_index == highest.index
    )  # no interpolated point is higher than the refined one
    left = f"a residual of {error:.2g} after interpolation over it; give a shorter one"
    validation.check(settled, "speeds", "a range in which the equations change smoothly", left)
    notes = (
        _comparison_text(top, fixed),
        f"interpolation over speed leaves a residual of {error:.1e} there",
    )
    return replace(out, notes=(*curve.notes, *notes), cost=meter.read())


def _with_maximum(curve: ResponseCurve, index: int, top: Peak, harmonics: NDArray) -> ResponseCurve:
    """Return the curve with the refined highest maximum, and without unknowns.

    Unknowns over speed cannot be used in a study at one speed, because their residual modes have other phases.
    """
    replaced = {
        "harmonics": harmonics, "frequency": top.frequency, "speed": top.parameter, "shares": top.shares,
        "residual": top.residual,
    }  # fmt: skip
    columns: dict[str, Any] = {name: np.array(getattr(curve, name)) for name in replaced}
    for name, value in replaced.items():
        columns[name][index] = value
    return replace(curve, **columns, unknowns=np.zeros((len(curve), 0)))


def _comparison_text(top: Peak, fixed: Peak | str) -> str:
    """Return a text about the highest maximum and the peak at fixed speed."""
    if isinstance(fixed, str):
        comparison = fixed
    else:
        above = percent(top.amplitude / fixed.amplitude - 1.0)
        reference = f"{amount(fixed.amplitude, 'm', 4)} at {fixed.parameter:.5g} rad/s"
        comparison = f"{above} above the peak at fixed speed, {reference}"
    return f"highest maximum {amount(top.amplitude, 'm', 4)} at {top.parameter:.5g} rad/s: {comparison}"
