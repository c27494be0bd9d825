"""Crossings of a resonance with engine orders, for one or several masses of the damper.

A crossing is the highest point of the response along the line of an engine order
(:mod:`bdamper.analyses.crossings`), at the preload of each speed, as a slow run-up passes it.  Each is a point of
a sweep over damper mass and engine order (:func:`bdamper.sweep`), so progress, interruption, files, executors and the
table are those of sweeps.

The response along the line of an engine order, and its highest point.

With the excitation frequency ``omega = EO Omega`` as the unknown beside ``u`` a run-up is a response curve like any other,
of equations in which everything changes with the speed (:class:`~bdamper.harmonic_balance.speed_family.Family`).  It is
followed from both ends of an interval of speeds in which the resonance of a mode can lie: between those at which its free
and its stuck resonance meet the line, and some way beyond.  The highest point is that of
:mod:`bdamper.response.highest_peak`.

At a fixed speed the frequency changes alone.  The peak at fixed speed that lies on the line is lower than the highest
point, by little where it is round and sharp, by percents where the response has a shoulder or the end of a plateau.

The equations are made at a few speeds and interpolated; what that leaves is measured at the highest point, by the equations
made there, and the point is one of these.

One problem over rotor speed, as a family of equations.

At every speed the problem is made anew: modes, contact stiffness, preload, static state.  So that unknowns at two speeds
can be compared, those of a speed are turned onto those of the nearest speed that is known
(:mod:`bdamper.harmonic_balance.parameters`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.sweep import SweepResult, sweep
from bdamper.fatigue.margin import LeastMargin
from bdamper.fatigue.stress_cycle import chosen_sets
from bdamper.harmonic_balance.equations import OK, Equations
from bdamper.harmonic_balance.parameters import like, vary
from bdamper.harmonic_balance.problem import Problem, stuck_springs
from bdamper.harmonic_balance.rotor_speed import Conditions, asked_speeds, preload_at, under
from bdamper.harmonic_balance.sector import Sector
from bdamper.harmonic_balance.speed_family import Family, family_equations, node_speeds, responses
from bdamper.model.validation import as_checked
from bdamper.response.branches import Coverage, ending, evaluation_budget, first_point
from bdamper.response.continuation import TWO_PI
from bdamper.response.events import ContinuationOptions
from bdamper.response.highest_peak import Highest, highest_of_curve
from bdamper.response.peak import (
    LOOSEST,
    Peak,
    PeakOptions,
    amplitude_at,
    beyond,
    coarse_options,
    find_peak,
    free_and_stuck,
)
from bdamper.response.response_curve import as_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.sensitivity import sensitivities
from bdamper.util import validation
from bdamper.util.errors import COMPLETE, INCOMPLETE, NOT_FOUND, BdamperError, SettingError
from bdamper.util.progress import CostMeter

# ---- One problem over rotor speed, as a family of equations ----


T = TypeVar("T")


def with_needed_bases(problem: Problem) -> Problem:
    """The same problem with those nodal diameters alone that its harmonics need, which is faster to make at a speed."""
    model = problem.model

    def needed(by_diameter: Mapping[int, T]) -> dict[int, T]:
        return {d: item for d, item in by_diameter.items() if d in problem.settings.needed_diameters}

    bodies = {n: b if b.kind == "free" else replace(b, bases=needed(b.bases)) for n, b in model.bodies.items()}
    stress = {n: replace(rows, modes=needed(rows.modes), contact=needed(rows.contact)) for n, rows in model.stress.items()}
    return problem.replace(model=as_checked(replace(model, bodies=bodies, stress=stress)))


class SpeedFamily:
    """A problem over rotor speed.

    Parameters
    ----------
    problem : Problem
        At any speed, or at none.
    conditions : Conditions
    """

    def __init__(self, problem: Problem, conditions: Conditions) -> None:
        self.whole = problem
        self.base = with_needed_bases(problem)
        self.conditions = conditions
        self._made: dict[float, Problem] = {}

    def problem(self, omega: float) -> Problem:
        """The problem at a speed (rad/s), its unknowns comparable with those at other speeds."""
        if omega not in self._made:
            made = under(self.base, omega, self.conditions)
            known = min(self._made, key=lambda other: abs(other - omega), default=None)
            self._made[omega] = made if known is None else like(made, self._made[known])
        return self._made[omega]

    def preload(self, omega: float) -> float:
        """Preload (N) at a speed."""
        return preload_at(self.whole, omega)

    def system(self, omega: float, mass: float = 1.0) -> Equations[Sector]:
        """The equations at a speed with a factor on the mass of the free bodies, load and inertia together."""
        problem = self.problem(omega)
        if mass != 1.0:
            problem = like(vary(problem, {"damper_mass": mass}), problem)
        return problem.system(mass * self.preload(omega))

    def along(self, low: float, high: float, nodes: int, mass: float = 1.0) -> Equations[Family]:
        """The equations along the line of the engine order between two speeds, made at so many of them.

        With a factor on the mass of the free bodies, load and inertia together.
        """
        speeds = node_speeds(low, high, nodes)
        systems = [self.system(float(omega), mass) for omega in speeds]
        return family_equations(systems, speeds, int(self.whole.engine_order))

    def resonances(self, low: float, high: float, mode: int) -> tuple[float, float]:
        """Speeds (rad/s) at which the free and the stuck resonance of a mode meet the line of the engine order.

        From those at two speeds, since squared frequencies are all but linear in the squared speed; 0 where a resonance
        meets no line.
        """
        squares, order = np.square([low, high]), float(self.whole.engine_order)
        found = []
        for column in np.transpose([self._linear(omega, mode) for omega in (low, high)]):
            slope = float(np.diff(column**2)[0] / np.diff(squares)[0])
            square = (column[0] ** 2 - slope * squares[0]) / (order**2 - slope) if order**2 > slope else 0.0
            found.append(float(np.sqrt(max(square, 0.0))))
        return min(found), max(found)

    def _linear(self, omega: float, mode: int) -> NDArray:
        """(2,) free and stuck resonance (rad/s) of a mode of the constrained bodies at a speed."""
        problem = self.problem(omega)
        both = free_and_stuck(problem, problem.equilibrium(self.preload(omega)), mode)
        return 2.0 * np.pi * np.array(both)[:, mode - 1]


# ---- The response along the line of an engine order, and its highest point ----


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


# ---- Crossings of a resonance with engine orders, for one or several masses of the damper ----


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


@partial(validation.check_arguments, also=Conditions.__dataclass_fields__)
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
    orders = validation.integers("engine_orders", engine_orders, least=1)
    factors = validation.numbers("damper_mass", damper_mass, above=0.0)
    mode = validation.integer("mode", mode, least=1)
    validation.check(orders, "engine_orders", "at least one", "none")
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
        raise validation.invalid("speeds", "(low, high) in rad/s, or a longer sequence of increasing values", speeds)
    return values if len(values) > 2 else np.linspace(values[0], values[1], n)
