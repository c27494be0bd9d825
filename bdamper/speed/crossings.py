"""Crossings of a resonance with engine orders, for one or several masses of the damper: the table and how it is made.

Each crossing is a point of a sweep over damper mass and engine order (:func:`bdamper.sweep`), so progress,
interruption, files and executors are those of sweeps.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.follower import TWO_PI
from bdamper.design.sweep import SweepResult, sweep
from bdamper.fatigue.cycle import chosen_sets
from bdamper.fatigue.margin import LeastMargin
from bdamper.problem.at_speed import RPM, Conditions, asked_speeds, preload_at
from bdamper.problem.problem import Problem
from bdamper.speed.crossing import BOTH, CrossingTask
from bdamper.util import validate
from bdamper.util.cost import Cost
from bdamper.util.differences import Comparable
from bdamper.util.errors import SettingError
from bdamper.util.hdf5 import Formerly, Recorded, Storable
from bdamper.util.plotting import Fact, Plottable
from bdamper.util.repr import brief
from bdamper.util.status import FAILED, NOT_RUN, Translated, word
from bdamper.util.tables import Hertz, Metres, Newtons, Numbers, Quantity, RadiansPerSecond, Shares, Tabular
from bdamper.util.text import amount


class OverSpeed:
    """What results over rotor speed have in common."""

    speed: NDArray

    def __len__(self) -> int:
        return len(self.speed)

    @property
    def rpm(self) -> NDArray:
        """(n,) float: speeds in revolutions per minute."""
        return self.speed * RPM


@brief
@dataclass(frozen=True)
class SpeedLine:
    """The response along the line of one engine order with one mass of the damper, at the preload of each speed.

    Parameters
    ----------
    engine_order : int
    mass_factor : float
    speed : (n,) float, rad/s
    frequency, amplitude : (n,) float, Hz and m
    margin : (n,) float
        NaN where it was not asked for; some of the points have one.
    """

    engine_order: int
    mass_factor: float
    speed: NDArray
    frequency: NDArray
    amplitude: NDArray
    margin: NDArray


@brief
@dataclass(frozen=True)
class Crossings(OverSpeed, Plottable, Comparable, Tabular, Recorded, Storable, kind="bdamper-crossings", row="crossing"):
    """Where the highest resonance of a mode lies on the lines of engine orders.

    A crossing is the highest point of the response along the line, as a slow run-up passes it; the peak at fixed speed
    beside it, of changes of the excitation frequency alone, may be lower.  Drawn by :func:`bdamper.plot.plot_crossings`.

    Parameters
    ----------
    engine_order : (n,) int
    mass_factor, mass : (n,) float, 1 and kg
        On the mass of the free bodies, load and inertia together; mass of the first of them that is loaded.
    kind : tuple of str
        "complete"; "incomplete" where there may be a higher point, as ``warnings`` say; "none" where no resonance of the
        mode can meet the line in the range; "not found"; otherwise "failed: " or "not run" as of a sweep.
    speed, frequency, amplitude, preload : (n,) float, rad/s, Hz, m and N
        NaN without a crossing.
    fixed_speed, fixed_speed_amplitude : (n,) float, rad/s and m
        The peak at fixed speed beside the highest point, where it lies on the line; NaN if there is none.
    shares, residual : (n, 3) and (n,) float
        Stick, slip and open at the highest point, and its residual.
    amplitude_by_mass, speed_by_mass : (n,) float, m and rad/s per unit of the factor on the mass
        Load and inertia together; NaN at a corner of the response curve.
    margin : (n,) float
        Of fatigue, least over the locations; NaN where it was not asked for.
    lines : tuple of SpeedLine
    warnings : tuple of str
        What the search for each crossing leaves open, empty where nothing.
    range, mode, cost
        What was asked for, rad/s, and the cost of each crossing.
    notes, settings, model_hash : tuple of str, mapping and str
        What the model neglects over speed; settings and model of the study.
    """

    engine_order: Numbers
    mass_factor: Numbers
    mass: Annotated[NDArray, Quantity("kg")]
    kind: Annotated[tuple[str, ...], Quantity(), Translated("")]
    speed: RadiansPerSecond
    frequency: Hertz
    amplitude: Metres
    preload: Newtons
    fixed_speed: Annotated[NDArray, Quantity("rad/s"), Formerly("speed")]
    fixed_speed_amplitude: Annotated[NDArray, Quantity("m"), Formerly("amplitude")]
    shares: Shares
    residual: Numbers
    amplitude_by_mass: Metres
    speed_by_mass: RadiansPerSecond
    margin: Numbers
    lines_: dict[str, NDArray]
    warnings: Annotated[tuple[str, ...], Quantity(name="warning")]
    range: tuple[float, float]
    mode: int
    cost: tuple[Cost, ...]
    notes: tuple[str, ...] = ()

    @property
    def found(self) -> NDArray:
        """(n,) bool: whether there is a crossing."""
        return np.isfinite(self.speed)

    @property
    def complete(self) -> bool:
        """Whether the search for every crossing came to an end, be it that there is none."""
        return not any(k.startswith(("failed", "not")) for k in self.kind)

    @property
    def lines(self) -> tuple[SpeedLine, ...]:
        """The response along the lines, in the order of the crossings."""
        n, out = 0, []
        for order, factor, count in zip(self.engine_order, self.mass_factor, self.lines_["count"]):
            part = {name: self.lines_[name][n : n + int(count)] for name in ("speed", "frequency", "amplitude", "margin")}
            out.append(SpeedLine(int(order), float(factor), **part))
            n += int(count)
        return tuple(out)

    def of(self, engine_order: int | None = None, mass_factor: float | None = None) -> NDArray:
        """(k,) int: the crossings of an engine order, of a mass of the damper, or of both."""
        keep = np.ones(len(self), bool)
        if engine_order is not None:
            keep &= self.engine_order == engine_order
        if mass_factor is not None:
            keep &= np.isclose(self.mass_factor, mass_factor)
        return np.flatnonzero(keep)

    def facts(self) -> tuple[Fact, ...]:
        """How many crossings there are, and the highest of them."""
        low, high = self.range
        head = (
            Fact("crossings", f"{int(self.found.sum())} of {len(self)} that were looked for"),
            Fact("speeds", f"{low:.5g} to {high:.5g} rad/s ({low * RPM:.0f} to {high * RPM:.0f} rpm)"),
        )
        if not self.found.any():
            return head
        i = int(np.nanargmax(np.where(self.found, self.amplitude, np.nan)))
        fixed = float(self.fixed_speed_amplitude[i])
        differs = abs(fixed / self.amplitude[i] - 1.0) > BOTH
        return (
            *head,
            Fact("highest amplitude", float(self.amplitude[i]), "m"),
            *((Fact("peak at fixed speed", fixed, "m"),) if differs else ()),
            Fact("there: engine order", int(self.engine_order[i])),
            Fact("there: damper mass", float(self.mass[i]), "kg"),
            Fact("there: speed", float(self.speed[i]), "rad/s"),
        )

    def bottom_line(self) -> str:
        low, high = (f"{speed * RPM:.0f}" for speed in self.range)
        if not self.found.any():
            reasons = dict.fromkeys(filter(None, self.warnings))
            why = f": {next(iter(reasons))}" if reasons else "."
            return f"No crossing of mode {self.mode} from {low} to {high} rpm with any of {len(self)} lines{why}"
        i = int(np.nanargmax(np.where(self.found, self.amplitude, np.nan)))
        place = f"{self.rpm[i]:.0f} rpm ({amount(self.frequency[i], 'Hz')}) by engine order {self.engine_order[i]}"
        load = f"damper of {amount(self.mass[i], 'kg')}, preload {amount(self.preload[i], 'N')}"
        return (
            f"Highest response from {low} to {high} rpm: {amount(self.amplitude[i], 'm')} at {place}, {load}. "
            f"{int(self.found.sum())} of {len(self)} crossings found."
        )


def speed_values(speeds: Any, n: int = 13) -> NDArray:
    """(n,) speeds (rad/s): that many between two ends, or the longer sequence that is given.

    Raises
    ------
    SettingError
        If they are not positive and increasing.
    """
    values = validate.numbers("speeds", speeds, above=0.0, unit="rad/s")
    if len(values) < 2 or np.any(np.diff(values) <= 0.0):
        raise validate.unfit("speeds", "(low, high) in rad/s, or a longer sequence of increasing values", speeds)
    return values if len(values) > 2 else np.linspace(values[0], values[1], n)


def crossings(
    problem: Problem,
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
) -> Crossings:
    """Crossings of a mode with engine orders, for several masses of the damper.

    Parameters
    ----------
    problem : Problem
        Of any engine order; its model has bases over speed.
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
        With it the margin against fatigue of each crossing and of some points of its line, for a model with stress sets.
    **conditions
        ``friction``, ``temperature``, ``excitation``: fields of :class:`bdamper.problem.at_speed.Conditions`.

    Returns
    -------
    Crossings
        After Ctrl-C with those that were finished; the others are "not run".

    Raises
    ------
    SettingError
        If speeds, orders or factors are none, or no free body carries a load.
    """
    validate.instance("study", problem, Problem, "a Study")
    values = speed_values(asked_speeds(problem, speeds, rpm))
    orders = validate.wholes("engine_orders", engine_orders, least=1)
    factors = validate.numbers("damper_mass", damper_mass, above=0.0)
    validate.require(orders, "engine_orders", "at least one", "none")
    preload_at(problem, float(values[-1]))
    if not problem.carries_load:
        raise SettingError(f"crossings: expected a model with a body that carries a load, found that {problem.why_no_load}")
    given = Conditions.of(conditions)
    named = given.values(values.tolist(), orders)  # what tables do not reach is told before any work
    over = {"damper_mass": factors.tolist(), "engine_order": list(orders)}
    if margin is not None:
        validate.instance("margin", margin, LeastMargin)
        chosen_sets(problem)
    task = CrossingTask((float(values[0]), float(values[-1])), mode, given, margin, named)
    answers = sweep(problem, over, task, executor=executor, resume=resume, progress=progress)
    return _table(problem, answers, values, mode)


def _table(problem: Problem, answers: SweepResult, values: NDArray, mode: int) -> Crossings:
    """The table from the answers of the sweep."""

    def column(name: str) -> NDArray:
        return np.array([value.get(name, np.nan) for value in answers.values], float)

    factors = np.array([p["damper_mass"] for p in answers.points])
    loaded = next(b for b in problem.model.bodies.values() if b.kind == "free" and b.load is not None)
    order = np.array([p["engine_order"] for p in answers.points], int)
    parts = {name: [value.get(f"line_{name}", []) for value in answers.values] for name in ("speed", "amplitude", "margin")}
    lines = {name: np.array([x for part in of for x in part]) for name, of in parts.items()}
    lines["count"] = np.array([len(part) for part in parts["speed"]])
    lines["frequency"] = np.repeat(order, lines["count"]) * lines["speed"] / TWO_PI
    names = (
        "speed", "frequency", "amplitude", "preload", "fixed_speed", "fixed_speed_amplitude", "residual",
        "amplitude_by_mass", "speed_by_mass", "margin",
    )  # fmt: skip
    columns: dict[str, Any] = {name: column(name) for name in names}
    kind = tuple(str(value.get("kind", status)) for value, status in zip(answers.values, answers.status))
    made = {int(o) for o, what in zip(order, kind) if word(what) not in (FAILED, NOT_RUN)}  # others may miss modes
    needed = {d for o in made for d in problem.with_(engine_order=o).needed_diameters}
    return Crossings(
        engine_order=order,
        mass_factor=factors,
        mass=factors * float(loaded.mass or np.nan),
        kind=kind,
        **columns,
        shares=np.column_stack([column(name) for name in ("stick", "slip", "open")]),
        lines_=lines,
        warnings=answers.warnings,
        range=(float(values[0]), float(values[-1])),
        mode=mode,
        cost=answers.cost,
        notes=problem.model.neglected_over_speed(needed),
        settings=answers.settings,
        model_hash=answers.model_hash,
    )
