"""Response along an engine order line, as a function of rotor speed.

Response along the line
    With the excitation frequency ``omega = EO Omega`` as an unknown, a run-up is a response curve
    of equations that depend on the speed (:class:`~bdamper.harmonic_balance.rotor_speed.Family`).
    The curve is followed from both ends of an interval of speeds that contains the free and the
    stuck resonance on the line, with a margin. :mod:`bdamper.response.highest_peak` locates the
    highest point.

    At a fixed speed only the frequency changes. The peak at fixed speed that lies on the line is
    lower than the highest point. The difference is small for a sharp, round peak, and some per cent
    if the response has a shoulder or ends a plateau.

Equations as functions of speed
    At every node speed the problem is assembled: modes, contact stiffness, preload and static
    state. Its unknowns are transformed to the basis of the nearest known speed, so that they are
    comparable (:mod:`bdamper.harmonic_balance.parameters`). The equations are interpolated between
    the nodes. At the highest point the exact equations are assembled; they measure the
    interpolation error and give the final solution.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import OK, Equations
from bdamper.harmonic_balance.parameters import MASS, vary, with_aligned_modes
from bdamper.harmonic_balance.problem import LoadCase, Problem
from bdamper.harmonic_balance.rotor_speed import (
    RPM,
    Conditions,
    Family,
    family_equations,
    node_speeds,
    preload_at,
    responses,
    under,
)
from bdamper.harmonic_balance.sector import SectorData
from bdamper.model.validation import as_checked
from bdamper.response.branches import Coverage, ending, evaluation_budget, first_point
from bdamper.response.continuation import TWO_PI
from bdamper.response.events import ContinuationOptions
from bdamper.response.followed_peak import highest_peak
from bdamper.response.highest_peak import Highest, highest_of_curve
from bdamper.response.linear_limits import beyond, free_and_stuck, resonance_interval
from bdamper.response.peak import (
    LOOSEST,
    Peak,
    PeakOptions,
    amplitude_at,
    coarse_options,
    find_peak,
)
from bdamper.response.response_curve import as_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util.errors import NOT_FOUND, BdamperError, SettingError
from bdamper.util.progress import Cost, CostMeter, progress_bar

# ---- Equations as functions of speed ----


T = TypeVar("T")


def with_needed_bases(problem: Problem) -> Problem:
    """Remove the nodal diameters that no harmonic uses from the model.

    The assembly at a speed is then faster.
    """
    model = problem.model
    diameters = problem.settings.needed_diameters

    def needed(by_diameter: Mapping[int, T]) -> dict[int, T]:
        return {d: item for d, item in by_diameter.items() if d in diameters}

    bodies = {}
    for name, body in model.bodies.items():
        # free bodies have the same modes at all diameters
        if body.kind != "free":
            body = replace(body, bases=needed(body.bases))
        bodies[name] = body
    stress = {
        name: replace(rows, modes=needed(rows.modes), contact=needed(rows.contact))
        for name, rows in model.stress.items()
    }
    return problem.replace(model=as_checked(replace(model, bodies=bodies, stress=stress)))


class SpeedFamily:
    """Problem as a function of rotor speed.

    Parameters
    ----------
    problem : Problem
        Problem at an arbitrary speed, or with no speed specified.
    conditions : Conditions
    """

    def __init__(self, problem: Problem, conditions: Conditions) -> None:
        self.whole = problem
        self.base = with_needed_bases(problem)
        self.conditions = conditions
        self._by_speed: dict[float, Problem] = {}

    def problem(self, omega: float) -> Problem:
        """Return the problem at a speed (rad/s); its unknowns at different speeds are comparable."""
        if omega not in self._by_speed:
            problem = under(self.base, omega, self.conditions)
            if self._by_speed:
                nearest = min(self._by_speed, key=lambda other: abs(other - omega))
                problem = with_aligned_modes(problem, self._by_speed[nearest])
            self._by_speed[omega] = problem
        return self._by_speed[omega]

    def preload(self, omega: float) -> float:
        """Return the preload (N) at a speed (rad/s)."""
        return preload_at(self.whole, omega)

    def system(self, omega: float, mass: float = 1.0) -> Equations[SectorData]:
        """Return the equations at a speed (rad/s).

        ``mass`` multiplies load and inertia of the free bodies.
        """
        problem = self.problem(omega)
        if mass != 1.0:
            problem = with_aligned_modes(vary(problem, {MASS: mass}), problem)
        return problem.system(mass * self.preload(omega))

    def along(self, low: float, high: float, nodes: int, mass: float = 1.0) -> Equations[Family]:
        """Return the equations along the engine order line, interpolated between node speeds.

        Parameters
        ----------
        low, high : float, rad/s
            Range of speeds.
        nodes : int
            Number of speeds at which the equations are assembled.
        mass : float
            Factor on load and inertia of the free bodies.
        """
        speeds = node_speeds(low, high, nodes)
        systems = [self.system(float(omega), mass) for omega in speeds]
        return family_equations(systems, speeds, int(self.whole.engine_order))

    def resonances(self, low: float, high: float, mode: int) -> tuple[float, float]:
        """Return the speeds (rad/s) at which resonances of a mode cross the engine order line.

        They are the lower and the higher one of the free and the stuck resonance. They follow from
        the resonances at two speeds, because squared frequencies are nearly linear in the squared
        speed. The result is 0 if a resonance does not cross the line.
        """
        at_low = self._linear(low, mode)
        at_high = self._linear(high, mode)
        squared_order = float(self.whole.engine_order) ** 2
        squared_low, squared_high = np.square([low, high])
        slopes = (at_high**2 - at_low**2) / (squared_high - squared_low)
        crossings = []
        for frequency, slope in zip(at_low, slopes.tolist()):
            squared_speed = 0.0
            if squared_order > slope:
                squared_speed = (frequency**2 - slope * squared_low) / (squared_order - slope)
            crossings.append(float(np.sqrt(max(squared_speed, 0.0))))
        return min(crossings), max(crossings)

    def limits_text(self, low: float, high: float, mode: int) -> str:
        """Return where the resonances cross the line, and what to do if no maximum is found."""
        crossings = {
            name: speed
            for name, speed in zip(("free", "stuck"), self.resonances(low, high, mode))
            if speed
        }
        order = f"engine order {self.whole.engine_order}"
        if not crossings:
            never = f"{order} does not cross mode {mode} at any speed"
            return f"{never}; choose a different engine order or mode"
        speeds = " and ".join(
            f"at {speed * RPM:.5g} rpm with {name} contacts" for name, speed in crossings.items()
        )
        remedy = f"give a range wider than {low * RPM:.5g} to {high * RPM:.5g} rpm"
        if any(low <= speed <= high for speed in crossings.values()):
            remedy += ", or check that excitation and response act on the mode"
        return f"{order} crosses mode {mode} {speeds}; {remedy}"

    def following(self, omega: float, mode: int) -> float:
        """Return the free resonance (rad/s) of the next mode at a speed (rad/s), or infinity."""
        try:
            return float(self._linear(omega, mode + 1)[0])
        except SettingError:  # no such mode
            return np.inf

    def _linear(self, omega: float, mode: int) -> NDArray:
        """Return the free and the stuck resonance (2,), rad/s, of a mode at a speed (rad/s)."""
        case = self.problem(omega).at(self.preload(omega))
        free_and_stuck_modes = np.array(free_and_stuck(case, mode))
        return 2.0 * np.pi * free_and_stuck_modes[:, mode - 1]


# ---- Response along the line ----


NODES = 6
"""Number of speeds at which the equations of a line are assembled."""
CLOSE = 1e-3
"""Largest residual of the interpolation at the highest point, relative to the excitation."""
AROUND = (0.03, 0.01, 0.003)
"""Successive relative half-widths of the range around a highest point with too large an
interpolation error.

The error is large if a speed-dependent table has a corner in the range.
"""


def interval(family: SpeedFamily, low: float, high: float, mode: int) -> tuple[float, float] | None:
    """Return the speeds (rad/s) in a range between which a resonance can cross the line.

    None if it cannot. The margin beyond free and stuck resonance is half the margin of a curve over
    frequency. The full margin takes 10 % more evaluations on four crossings and gives the same
    highest points to 1e-8.
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
    progress: bool = False,
) -> tuple[Equations[Family], ResponseCurve, Highest | None]:
    """Compute the response curve of a run-up, with excitation along the engine order line.

    Parameters
    ----------
    family : SpeedFamily
    speeds : (low, high), rad/s
        Range of rotor speeds.
    mode : int
        Mode of the constrained bodies, 1 for the lowest. Steps are short near its resonances.
    meter : CostMeter
        Counts the cost.
    options : ContinuationOptions, optional
        Step sizes and tolerances; by default the options of a coarse curve.
    progress : bool
        Show a progress bar.

    Returns
    -------
    equations : Equations
        Equations interpolated in speed, with the excitation frequency as the parameter.
    curve : ResponseCurve
    highest : Highest or None
        Highest maximum, with the speed (rad/s) as its parameter; None if the highest point is an
        end of the curve.
    """
    low, high = speeds
    # a branch may leave the interval and return; tables against speed limit the range
    margin = 0.05 * (high - low)
    lowest, highest = family.conditions.reach(int(family.whole.engine_order))
    equations = family.along(
        max(low - margin, 0.5 * low, lowest), min(high + margin, highest), NODES
    )
    meter.watch(equations)
    options = options or coarse_options()
    budget = options.budget or evaluation_budget(equations)
    order = equations.structure.engine_order
    system = replace(equations.within(budget), watched=_watched(family, equations, mode))
    search = Coverage(system, (order * low, order * high), replace(options, budget=budget), meter)

    def find_start(omega: float) -> NDArray | None:
        case = _nearest(family, equations, omega / order)
        at_speed = equations.structure.at(omega)
        meter.watch(at_speed)
        start, tried, _ = first_point(
            at_speed, case.equilibrium, case.stuck_springs(), omega, options, meter
        )
        for line in tried:
            search.note(omega, line)
        return start

    with progress_bar(progress, *search.limits, "run-up") as search.on_point:
        search.cover(find_start)
    end = ending(search.pieces, *search.limits)
    end = replace(end, missing_ranges=(*end.missing_ranges, *search.lost))
    problem = _nearest(family, equations, low).problem
    curve = as_curve(problem, search, end, kind="run-up", preload=np.nan)
    # the response depends on the speed
    y = np.column_stack([curve.unknowns, TWO_PI * curve.frequency])
    curve = replace(
        curve,
        harmonics=responses(equations, y),
        speed=TWO_PI * curve.frequency / order,
        **family.whole.recorded(search.options),
    )
    try:
        top = highest_of_curve(equations, curve)
    except BdamperError:  # no point on a connected branch
        return equations, curve, None
    meter.count(top.peak.iterations)
    if top.kind == "end":
        return equations, curve, None
    peak = replace(top.peak, parameter=float(top.peak.y[-1]) / order)
    return equations, curve, replace(top, peak=peak)


def _nearest(family: SpeedFamily, equations: Equations[Family], speed: float) -> LoadCase:
    """Return the problem under its preload at the node speed nearest to a speed (rad/s)."""
    nearest = float(min(equations.structure.speeds, key=lambda other: abs(other - speed)))
    return family.problem(nearest).at(family.preload(nearest))


def _watched(
    family: SpeedFamily, equations: Equations[Family], mode: int
) -> list[tuple[float, float, NDArray]]:
    """Return the free and the stuck resonance on the engine order line, near which steps are short.

    Each has frequency, half-width (rad/s) and modal row.
    """
    structure = equations.structure
    low = float(structure.speeds.min())
    high = float(structure.speeds.max())
    free, stuck = family.resonances(low, high, mode)
    watched = []
    for speed, is_stuck in ((free, False), (stuck, True)):
        if not low < speed < high:
            continue
        springs = None
        if is_stuck:
            springs = _nearest(family, equations, speed).stuck_springs()
        omega = structure.engine_order * speed
        linear = structure.at(omega).structure.linear
        resonances = linear.resonances((springs,), 0.9 * omega, 1.1 * omega)
        if resonances:
            _, width, row = min(resonances, key=lambda one: abs(one[0] - omega))
            watched.append((omega, width, row))
    return watched


def at_fixed_speed(
    peak_at: Callable[[float, NDArray], Peak],
    order: float,
    speeds: NDArray,
    top: Peak,
    tolerance: float,
) -> Peak | str:
    """Find the peak at fixed speed that lies on the line.

    If there is no such peak, return the reason as text.

    The search takes secant steps from a point on the line. Steps are halved if no peak is found.
    From a shoulder of the response to the peak they amount to some per cent.

    Parameters
    ----------
    peak_at : callable
        Function of a speed (rad/s) and a solution near the peak, which returns the peak.
    order : float
        Engine order.
    speeds : (n,) float, rad/s
        Range of speeds.
    top : Peak
        First point.
    tolerance : float
        Relative distance from the line.
    """
    low = order * speeds.min()
    high = order * speeds.max()
    omega = float(top.y[-1])
    guess = top.y
    # frequency of the line, and distance of the peak from it
    before: tuple[float, float] | None = None
    n_steps = PeakOptions().max_iterations
    for _ in range(n_steps):
        peak = peak_at(omega / order, guess)
        if not peak.ok:
            if before is None:
                return (
                    "no peak found at fixed speed, starting from the highest point on the line: "
                    f"{peak.status_text}"
                )
            omega = 0.5 * (omega + before[0])
            continue
        distance = float(peak.y[-1]) - omega
        if abs(distance) <= tolerance * omega:
            return peak
        # a resonance that does not depend on the speed
        slope = -1.0
        if before is not None and before[0] != omega:
            slope = (distance - before[1]) / (omega - before[0])
            # a flat or rising secant is no guide
            if not slope < -0.2:
                slope = -1.0
        before = omega, distance
        guess = peak.y
        omega = min(max(low, omega - distance / slope), high)
        if omega == before[0]:
            return (
                f"no peak found at fixed speed within the range of {speeds.min():.5g} to "
                f"{speeds.max():.5g} rad/s"
            )
    return f"no peak found at fixed speed on the line after {n_steps} steps"


def interpolated_at_fixed_speed(
    equations: Equations[Family], top: Peak, meter: CostMeter
) -> Peak | str:
    """Find the peak at fixed speed that lies on the line, from equations interpolated in speed.

    If there is no such peak, return the reason as text.
    """
    structure = equations.structure
    order = structure.engine_order

    def peak_at(speed: float, guess: NDArray) -> Peak:
        system = structure.at(order * speed)
        meter.watch(system)
        peak = find_peak(system, guess, parameter=speed)
        meter.count(peak.iterations)
        return peak

    return at_fixed_speed(peak_at, order, structure.speeds, top, PeakOptions().position_tolerance)


def highest_at_speed(family: SpeedFamily, speed: float, mode: int) -> Peak:
    """Return the highest peak at a rotor speed (rad/s), with the verdict on it.

    The search goes beyond the engine order line, up to the next mode, because vibration may raise
    the resonance above the stuck one.
    """
    order = float(family.whole.engine_order)
    beyond_line = 1.1
    problem = family.problem(speed)
    preload = family.preload(speed)
    low, high = resonance_interval(problem.at(preload), mode)
    limit = min(beyond_line * order * speed, family.following(speed, mode)) / TWO_PI
    return highest_peak(problem, preload, (low, max(high, limit)), mode=mode)


def exact_at_fixed_speed(
    family: SpeedFamily, speeds: tuple[float, float], mode: int, top: Peak, meter: CostMeter
) -> Peak | str:
    """Find the peak at fixed speed that lies on the line.

    If there is no such peak, return the reason as text.

    At each speed the highest peak is sought (:func:`highest_at_speed`).
    """
    order = float(family.whole.engine_order)

    def peak_at(speed: float, _: NDArray) -> Peak:
        try:
            peak = highest_at_speed(family, speed, mode)
        except BdamperError as error:
            return replace(top, parameter=speed, status=NOT_FOUND, reason=str(error))
        meter.add(peak.cost or Cost())
        return replace(peak, parameter=speed)

    return at_fixed_speed(peak_at, order, np.array(speeds), top, AROUND[-1])


def peak_at_fixed_speed(
    family: SpeedFamily,
    equations: Equations[Family],
    speeds: tuple[float, float],
    mode: int,
    top: Peak,
    meter: CostMeter,
) -> Peak | str:
    """Find the peak at fixed speed that lies on the line.

    If there is no such peak, return the reason as text.

    If Newton's method on the interpolated equations fails, as at a corner of the curve, the
    complete search of the exact equations follows.
    """
    peak = interpolated_at_fixed_speed(equations, top, meter)
    if isinstance(peak, str):
        return exact_at_fixed_speed(family, speeds, mode, top, meter)
    return peak


def exact(family: SpeedFamily, top: Peak) -> tuple[Peak, float]:
    """Solve the highest point with the equations assembled at its speed.

    Returns
    -------
    peak : Peak
    error : float
        Residual of the interpolated solution, relative to the excitation.
    """
    system = family.system(top.parameter)
    error = system.error(top.y)
    options = PeakOptions()
    tolerance = max(options.tolerance, LOOSEST)
    solution = system.correct_at(
        top.y[:-1], float(top.y[-1]), top.scale, tolerance, options.max_iterations
    )
    if solution.status != OK:
        return top, error
    peak = replace(
        top,
        y=solution.y,
        amplitude=amplitude_at(system, solution.y),
        shares=np.array(solution.shares),
        residual=solution.residual,
    )
    return peak, error


def follow_mode(
    family: SpeedFamily, within: tuple[float, float], mode: int, meter: CostMeter, *args: Any
) -> tuple[Equations[Family], ResponseCurve, Highest | None] | None:
    """Compute the response curve of a run-up across the resonance of a mode.

    Vibration may close contacts that are open at rest, so that the resonance lies above the stuck
    resonance. If the curve is highest at its upper end, compute it again up to the next mode or the
    end of the range. Return None if the mode does not cross the engine order in the range.

    Parameters
    ----------
    within : (low, high), rad/s
        Range of rotor speeds.
    *args
        Options and progress, see :func:`follow_line`.
    """
    speeds = interval(family, *within, mode)
    if speeds is None:
        return None
    low, high = speeds
    run_up = follow_line(family, speeds, mode, meter, *args)
    curve = run_up[1]
    order = float(family.whole.engine_order)
    if not curve.peak_at_end or TWO_PI * curve.peak.frequency < order * np.mean(speeds):
        return run_up
    next_mode = min(within[1], family.following(high, mode) / order)
    if not next_mode > high:
        return run_up
    wider = follow_line(family, (low, next_mode), mode, meter, *args)
    has_maximum = wider[2] is not None
    return wider if has_maximum else run_up


def refined(
    family: SpeedFamily, equations: Equations[Family], top: Peak, meter: CostMeter
) -> tuple[Equations[Family], Peak, Peak, float, float]:
    """Repeat the interpolation on shorter ranges until its error at the highest point is small.

    Returns
    -------
    equations : Equations
    top : Peak
        Highest point of the interpolated equations.
    solution : Peak
        Highest point of the equations assembled at its speed.
    first, last : float
        Residuals of the interpolation over the whole and over the last range.
    """
    solution, error = exact(family, top)
    first = error
    for part in AROUND:
        if error <= CLOSE:
            break
        low = (1.0 - part) * solution.parameter
        high = (1.0 + part) * solution.parameter
        shorter = family.along(low, high, NODES)
        meter.watch(shorter)
        peak = find_peak(shorter, solution.y, tangent=solution.tangent, scale=solution.scale)
        if not peak.ok:
            break
        equations = shorter
        top = replace(peak, parameter=float(peak.y[-1]) / shorter.structure.engine_order)
        solution, error = exact(family, top)
    return equations, top, solution, first, error
