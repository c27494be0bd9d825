"""The run-up along the line of an engine order: one continuation in rotor speed, at the preload of each speed.

With the excitation frequency ``omega = EO Omega`` as the unknown beside ``u`` the equations are those of a response curve,

    R(u, omega; K(Omega), G(Omega), k(Omega), P(Omega), ...) = 0,

and everything that follows such curves follows this one.  Its derivative has, beside that at fixed speed, what changes with
speed: modal stiffness and damping, modes at the contact points, contact stiffness, friction coefficient, sliders and
displacement of the static state, static load and excitation,

    dR/domega = R_omega + (1/EO) sum_a R_a da/dOmega .

Each of these arrays ``a`` is interpolated over the squared speed by one polynomial through a few Chebyshev points, at which
the problem is made; the derivative is exactly that of the polynomials.  How far interpolated equations are from those made
at a speed in between is measured and told.

A run-up passes every maximum that responses at fixed speed have, each where it meets the line, and a little above it, since
amplitude changes along the line with preload and modes (:func:`bdamper.speed.crossing.excess`).  The highest of them need
not be the crossing of the highest peak: where faces open, responses have a second maximum at the end of a plateau, which
meets the line at a higher speed, under more load.  The peak at fixed speed with which the highest point of a run-up is
compared is therefore found from that point: along the response at its speed to the nearest maximum, and by a secant to the
line.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.continuation.follower import follow
from bdamper.continuation.path import ContinuationOptions, Path, PathPoint
from bdamper.harmonic_balance.conditions import Condition, Fixed, Plane
from bdamper.harmonic_balance.system import DIVERGED, NOT_CONVERGED, NOT_FINITE, OK, Correction, HarmonicSystem, norm2
from bdamper.peaks.newton import Peak, amplitude_at, refine_maxima
from bdamper.problem.at_speed import Conditions
from bdamper.problem.problem import Problem
from bdamper.speed.crossing import TWO_PI, Search, derivatives, excess, half_bandwidth
from bdamper.speed.crossings import RPM, OverSpeed, speed_values
from bdamper.speed.family import SpeedFamily
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, CostMeter
from bdamper.util.differences import Comparable
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.hdf5 import Storable
from bdamper.util.plotting import Fact, Plottable
from bdamper.util.repr import brief
from bdamper.util.tables import Column, Tabular

NODES = 6
"""Speeds at which the problem is made for one run-up.  Over 10 % to both sides of a crossing of the shipped disk the
residual of solutions in between is then below 1e-6."""
AROUND = 0.1
"""Range of speeds to both sides of a crossing by default, relative; second maxima of the shipped disk lie up to 9 % up."""
BETWEEN = 20
"""Places for each point of a response curve at which it is read, linear in between."""
WITHIN = (50.0, 2000.0)
"""Speeds (rad/s) between which a crossing is looked for if none are given."""
CLOSE = 1e-3
"""Largest residual, relative to the excitation, that the interpolation may leave at a solution."""
FOLLOWING = ContinuationOptions(step=0.1, max_step=0.3, max_turn=0.6, locate_tolerance=1e-4)
"""Settings of the path by default; its highest point is refined afterwards."""
PARTS = {
    "stiffness": "stiffness", "mass": "stiffness", "damping": "damping", "G": "modes", "kt": "contact", "kn": "contact",
    "mu": "friction", "n0": "contact", "w": "static", "shift": "static", "force": "force", "load": "contact",
}  # fmt: skip
"""Arrays of the equations that change with speed, and the term of the derivative to which each belongs."""
TERMS = tuple(dict.fromkeys(PARTS.values()))
INTERPOLATED = tuple(PARTS)


class RunUpSystem(HarmonicSystem):
    """Equations along the line of an engine order, of which the frequency decides the speed.

    Parameters
    ----------
    family : SpeedFamily
        Of the engine order of its problem.
    speeds : (low, high), rad/s
    nodes : int
    """

    def __init__(self, family: SpeedFamily[Any], speeds: tuple[float, float], nodes: int = NODES) -> None:
        self.order = int(family.whole.engine_order)
        squares = np.square(speeds)
        self.at = 0.5 * (squares.sum() + np.diff(squares)[0] * np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes))
        made = [family.system(float(omega)) for omega in np.sqrt(self.at)]
        middle = made[nodes // 2]
        self.__dict__.update(middle.__dict__)
        if any(np.any(s.arrays["law"] != middle.arrays["law"]) for s in made):
            raise SettingError("run-up: expected the same contact laws at all speeds")
        self.shapes = {name: middle.arrays[name].shape for name in INTERPOLATED}
        rows = [np.concatenate(s.response_rows) for s in made]
        self.values = np.array([self._flat(s.arrays, row) for s, row in zip(made, rows)])
        self.weights = np.array([1.0 / np.prod(a - np.delete(self.at, i)) for i, a in enumerate(self.at)])

    @staticmethod
    def _flat(arrays: Mapping[str, Any], row: NDArray) -> NDArray:
        return np.concatenate([*(np.asarray(arrays[name], complex).ravel() for name in INTERPOLATED), row])

    def _split(self, flat: NDArray) -> tuple[dict[str, NDArray], list[NDArray]]:
        out, n = {}, 0
        for name, shape in self.shapes.items():
            size = int(np.prod(shape))
            part = flat[n : n + size].reshape(shape)
            out[name] = part if name == "G" else np.ascontiguousarray(part.real)
            n += size
        ends = np.cumsum([len(row) for row in self.response_rows])[:-1]
        return out, np.split(flat[n:], ends)

    def made_at(self, omega: float) -> tuple[HarmonicSystem, dict[str, NDArray]]:
        """Equations at a speed, and the derivatives of their arrays by it; response rows are those of the speed."""
        away = omega**2 - self.at
        nodes = range(len(away))
        basis = self.weights * [np.prod(np.delete(away, i)) for i in nodes]
        slope = self.weights * [sum(np.prod(np.delete(away, [i, k])) for k in nodes if k != i) for i in nodes]
        arrays, rows = self._split(basis @ self.values)
        rates, _ = self._split(2.0 * omega * (slope @ self.values))
        out = self._with(**arrays)
        out.__class__ = HarmonicSystem
        out.force, out.response_rows = arrays["force"], rows
        out.__dict__.pop("response_parts", None)
        return out, rates

    def speed_rate(self, u: NDArray, omega: float, terms: Collection[str] = TERMS) -> NDArray:
        """(n_unknowns,) derivative of the residual by the rotor speed (rad/s) at fixed frequency, or some of its terms."""
        return self._speed_rate(*self.made_at(omega), u, omega, terms)

    def _speed_rate(
        self, system: HarmonicSystem, rate: Mapping[str, NDArray], u: NDArray, speed: float, terms: Collection[str]
    ) -> NDArray:
        part = {name: rate[name] if term in terms else np.zeros_like(rate[name]) for name, term in PARTS.items()}
        out = -part["force"]
        starts = np.concatenate([[0], np.cumsum(self.n_mode)])
        modes = [slice(a, b) for a, b in zip(starts[:-1], starts[1:])]
        G, dG = (
            [whole[3 * self.n_points * m.start : 3 * self.n_points * m.stop].reshape(3 * self.n_points, -1) for m in modes]
            for whole in (system.arrays["G"], part["G"])
        )
        motion = np.zeros((self.n_points, 3, 2 * self.n_harmonics + 1))
        for l, m in enumerate(modes):
            q, w = self.amplitudes(u, l), l * self.order * speed
            self._put(out, l, (part["stiffness"][m] - w**2 * part["mass"][m] + 1j * w * part["damping"][m]) * q)
            x = (dG[l] @ q).reshape(-1, 3)
            motion[..., max(2 * l - 1, 0)] = x.real
            if l > 0:
                motion[..., 2 * l] = -x.imag
        motion[..., 0] += part["shift"]
        F, change = system.contact_rate(u, motion, part)
        for l in range(len(modes)):
            self._put(out, l, G[l].conj().T @ _amplitude(change, l).ravel() + dG[l].conj().T @ _amplitude(F, l).ravel())
        return out

    def _put(self, out: NDArray, harmonic: int, value: NDArray) -> None:
        """Add complex amplitudes of one harmonic in the layout of the unknowns."""
        c, s = self.slices(harmonic)
        out[c] += value.real
        out[s] -= value.imag[: s.stop - s.start]

    # ---- what continuation and search for a peak ask of equations ----

    def evaluate_at(self, y: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Residual, Jacobian and derivative along the line with respect to the frequency omega = EO Omega."""
        speed = float(y[-1]) / self.order
        system, rate = self.made_at(speed)
        r, J, r_omega = system.evaluate_at(y)
        return r, J, r_omega + self._speed_rate(system, rate, y[:-1], speed, TERMS) / self.order

    def residual(self, y: NDArray) -> NDArray:
        """Residual alone at a point."""
        return self.made_at(float(y[-1]) / self.order)[0].residual(y)

    def amplitude(self, y: NDArray) -> float:
        """Amplitude (m) of the first harmonic, with the modes of its speed at the place of the response."""
        system = self.made_at(float(y[-1]) / self.order)[0]
        return float(abs(system.response(y[:-1])[1]))

    def solve(
        self,
        y: NDArray,
        condition: Condition,
        scale: NDArray,
        tolerance: float,
        max_iterations: int,
        line_search: bool = False,
        reach: float = 0.0,
    ) -> Correction:
        """Newton to the curve within a plane; no search of its own for a fold or the highest point."""
        if not isinstance(condition, Plane | Fixed):
            return Correction(NOT_CONVERGED, np.array(y, float), np.zeros(len(y)), 0, np.nan, 0.0, 0)
        normal = condition.normal if isinstance(condition, Plane) else np.append(np.zeros(len(y) - 1), 1.0)
        start, y, n = y, np.array(y, float), self.n_unknowns
        border = np.append(np.zeros(n), 1.0)
        residual, status = np.nan, NOT_CONVERGED
        tangent, orientation, rank = np.zeros(n + 1), 0, n + 1
        low, high = self.order * np.sqrt([self.at.min(), self.at.max()])
        for iteration in range(1, max_iterations + 1):
            if not 0.9 * low < y[-1] < 1.1 * high:  # beyond the range of the polynomials
                return Correction(DIVERGED, y, tangent, iteration, residual, 0.0, 0)
            try:
                r, J, r_omega = self.evaluate_at(y)
            except FloatingPointError:
                return Correction(NOT_FINITE, y, tangent, iteration, residual, 0.0, 0)
            residual = float(np.abs(r * self.row_scale).max())
            B = np.vstack([np.column_stack([J * scale[:n], r_omega * scale[n]]), normal])
            rows = 1.0 / np.maximum(np.abs(B).max(axis=1), 1e-300)
            B *= rows[:, None]
            sides = np.column_stack([border, np.append(-r, normal @ ((start - y) / scale))])
            solution, rank = _solve(B, sides * rows[:, None])
            tangent = solution[:, 0] / norm2(solution[:, 0])
            orientation = int(np.linalg.slogdet(B)[0])
            if residual <= tolerance:
                status = OK
                break
            if reach > 0.0 and norm2(solution[:, 1]) > reach:
                return Correction(DIVERGED, y, tangent, iteration, residual, 0.0, 0)
            y = y + solution[:, 1] * scale
        if status != OK:
            return Correction(status, y, tangent, max_iterations, residual, 0.0, 0)
        return Correction(OK, y, tangent, iteration, residual, 1.0, n + 1 - rank, self._shares(y), orientation)

    def _shares(self, y: NDArray) -> tuple[float, float, float]:
        """Shares of the cycle at a point."""
        system = self.made_at(float(y[-1]) / self.order)[0]
        return HarmonicSystem.correct_at(system, y[:-1], float(y[-1]), np.ones(len(y)), 1e300, 1).shares


def _amplitude(force: NDArray, harmonic: int) -> NDArray:
    """Complex amplitude of one harmonic of contact forces (n_points, 3, n_coef)."""
    if harmonic == 0:
        return force[..., 0].astype(complex)
    return np.asarray(force[..., 2 * harmonic - 1] - 1j * force[..., 2 * harmonic])


def _solve(B: NDArray, right: NDArray) -> tuple[NDArray, int]:
    """Solution, of least norm where the matrix is singular, and its rank."""
    lapack = scipy.linalg.lapack
    factors, pivot, info = lapack.dgetrf(B)
    if info == 0 and lapack.dgecon(factors, np.abs(B).sum(axis=0).max())[0] > 1e-13:
        return lapack.dgetrs(factors, pivot, right)[0], len(B)
    solution, _, rank, _ = scipy.linalg.lstsq(B, right, cond=1e-12)
    return solution, int(rank)


@brief
@dataclass(frozen=True)
class RunUp(OverSpeed, Plottable, Comparable, Tabular, Storable, kind="bdamper-run-up"):
    """Response along the line of an engine order.

    ``plot`` draws amplitude over speed (:func:`bdamper.plot.plot_run_up`).

    Parameters
    ----------
    engine_order : int
    speed : (n,) float, rad/s
        In the order of the path, through folds.
    amplitude : (n,) float, m
    shares : (n, 3) float
        Stick, slip and open.
    residual : (n,) float
    point_kind : tuple of str
        "maximum", "fold" and others as of a tracking curve.
    crossing_speed, crossing_amplitude : float, rad/s and m
        The peak at fixed speed on the line.
    peak_speed, peak_amplitude : float, rad/s and m
        The highest maximum along the line.
    passed_speed, passed_amplitude : float, rad/s and m
        The peak at fixed speed that is passed there, where this maximum of responses meets the line; mostly the crossing.
    excess : float
        Estimate of the relative difference of these two amplitudes: that of a round peak (:mod:`bdamper.speed.crossing`),
        or where it is more, that of the response curve at the speed of the peak, which may have a shoulder.
    interpolation : float
        Residual that interpolation over speed leaves at the crossing and at the highest point, relative to the excitation:
        both are solutions of the equations at their speeds.
    status : str
        "complete" if the path reached both ends of the range, otherwise how it ended.
    cost : Cost
    settings : mapping
    model_hash : str
    """

    engine_order: int
    speed: NDArray
    amplitude: NDArray
    shares: NDArray
    residual: NDArray
    point_kind: tuple[str, ...]
    crossing_speed: float
    crossing_amplitude: float
    peak_speed: float
    peak_amplitude: float
    passed_speed: float
    passed_amplitude: float
    excess: float
    interpolation: float
    status: str
    cost: Cost
    settings: dict[str, Any] = field(default_factory=dict)
    model_hash: str = ""

    @property
    def difference(self) -> float:
        """Amplitude of the highest maximum over that of the crossing, less one."""
        return self.peak_amplitude / self.crossing_amplitude - 1.0

    @property
    def agrees(self) -> bool:
        """Whether the highest maximum is the peak at fixed speed that it passes: not lower, to 0.1 %, and not higher than
        by that or by the estimate."""
        above = self.peak_amplitude / self.passed_amplitude - 1.0
        return -1e-3 <= above <= max(1e-3, float(np.nan_to_num(self.excess)))

    @property
    def cut(self) -> bool:
        """Whether the response is higher at an end of the range than at any maximum in it."""
        return bool(max(self.amplitude[[0, -1]]) > self.peak_amplitude)

    def facts(self) -> tuple[Fact, ...]:
        """The highest point, and the crossing beside it."""
        return (
            Fact("engine order", self.engine_order),
            Fact("run-up", f"{self.status}, {len(self)} points"),
            Fact("highest amplitude", self.peak_amplitude, "m"),
            Fact("at the speed", self.peak_speed, "rad/s"),
            Fact("peak at fixed speed", self.crossing_amplitude, "m"),
            Fact("at the speed of the crossing", self.crossing_speed, "rad/s"),
        )

    def columns(self) -> dict[str, Column]:
        """A row for each point of the path."""
        shares = {name: Column(self.shares[:, k]) for k, name in enumerate(("stick", "slip", "open"))}
        frequency = Column(self.engine_order * self.speed / TWO_PI, "Hz")
        return {"speed": Column(self.speed, "rad/s"), "frequency": frequency, "amplitude": Column(self.amplitude, "m"),
        **shares}

    def __str__(self) -> str:
        agrees = "agrees with" if self.agrees else "differs by more than estimated from"
        above = self.peak_amplitude / self.passed_amplitude - 1.0
        lines = [
            f"run-up along engine order {self.engine_order}: {self.status}, {len(self)} points",
            f"  highest {self.peak_amplitude:.6g} m at {self.peak_speed:.6g} rad/s ({self.peak_speed * RPM:.0f} rpm)",
            f"  {agrees} the peak at fixed speed, {self.passed_amplitude:.6g} m at {self.passed_speed:.6g} rad/s: "
            f"difference {100.0 * above:.3g} %, estimated {100.0 * self.excess:.3g} %",
        ]
        if abs(self.passed_speed / self.crossing_speed - 1.0) > 1e-6:
            lines.append(
                f"  another maximum than that of the crossing, {self.crossing_amplitude:.6g} m at "
                f"{self.crossing_speed:.6g} rad/s, and {100.0 * self.difference:.3g} % above it"
            )
        if self.cut:
            lines.append("  the response is higher still at an end of the range: give a wider one")
        return "\n".join([*lines, f"  residual of the interpolation over speed {self.interpolation:.1e}; {self.cost}"])


@one_thread
def run_up(
    problem: Problem,
    speeds: tuple[float, float] | None = None,
    *,
    mode: int = 1,
    within: tuple[float, float] | None = None,
    options: ContinuationOptions | None = None,
    **conditions: Any,
) -> RunUp:
    """The response along the line of the study's engine order, through its crossing with a mode.

    Parameters
    ----------
    problem : Problem
        Of that engine order; its model has bases over speed.
    speeds : (low, high), rad/s, optional
        Range of the run-up, which holds the crossing; 10 % to both sides of it by default.
    mode : int
    within : (low, high), rad/s, optional
        Where the crossing is looked for if no range is given, and what the range does not leave; 50 to 2000 rad/s by
        default, as far as tables over speed reach.
    options : ContinuationOptions
        ``FOLLOWING`` by default.
    **conditions
        As for :meth:`bdamper.Study.crossings`.

    Raises
    ------
    SettingError
        If a setting does not fit, or polynomials over speed do not describe the equations well enough: a shorter range.
    BdamperError
        If there is no crossing in the range.
    """
    validate.instance("study", problem, Problem, "a Study")
    given = Conditions.of(conditions)
    reach = given.reach(int(problem.engine_order))
    asked = speed_values(speeds or within or np.clip(reach, *WITHIN).tolist(), 5)
    meter = CostMeter(time.perf_counter())
    family = SpeedFamily(problem, given)
    search = Search(family, tuple(asked.tolist()), validate.whole("mode", mode, least=1), meter)
    peak = _crossing(search)
    speed = peak.parameter
    low, high = float(asked[0]), float(asked[-1])
    if not speeds:
        low, high = max(low, (1.0 - AROUND) * speed), min(high, (1.0 + AROUND) * speed)
    system = RunUpSystem(family, (low, high))
    error = float(np.abs(system.residual(peak.y) * system.row_scale).max())
    if not error <= CLOSE:
        raise SettingError(
            f"speeds: expected a range in which the equations change smoothly, found a residual of {error:.2g} after "
            f"interpolation between {low:.6g} and {high:.6g} rad/s; give a shorter one"
        )
    options = options or FOLLOWING
    paths, points = _both_ways(system, peak.y, (system.order * low, system.order * high), options)
    top = max([p.y for p in refine_maxima(system, points)] or [p.y for p in points], key=system.amplitude)
    there = family.system(float(top[-1]) / system.order)
    error = max(error, float(np.abs(there.residual(top) * there.row_scale).max()))
    passed, beside = _passed(search, peak, there, top, (low, high), options)
    meter.count(sum(p.iterations for p in (*paths, *beside)), sum(p.failed_steps for p in (*paths, *beside)))
    amplitude = system.amplitude(top)
    return RunUp(
        engine_order=system.order,
        speed=np.array([p.y[-1] for p in points]) / system.order,
        amplitude=np.array([system.amplitude(p.y) for p in points]),
        shares=np.array([p.shares for p in points]),
        residual=np.array([p.residual for p in points]),
        point_kind=tuple(p.kind for p in points),
        crossing_speed=speed,
        crossing_amplitude=peak.amplitude,
        peak_speed=float(top[-1]) / system.order,
        peak_amplitude=amplitude,
        passed_speed=passed.parameter,
        passed_amplitude=passed.amplitude,
        excess=_estimate(search, passed, amplitude / passed.amplitude - 1.0, (low, high), options),
        interpolation=error,
        status=_ending(paths),
        cost=meter.read(time.perf_counter()),
        settings=problem.record(None),
        model_hash=problem.model.hash,
    )


def _crossing(search: Search) -> Peak:
    """The peak of a mode on the line of the engine order, an error where there is none."""
    peak, (low, high) = search.run()
    if peak is None:
        jumps = f"; the highest peak jumps over the line between {low:.6g} and {high:.6g} rad/s" if np.isfinite(low) else ""
        raise BdamperError(
            f"run-up: expected a crossing of mode {search.mode} with engine order {search.order} between "
            f"{search.speeds[0]:.6g} and {search.speeds[-1]:.6g} rad/s, found none{jumps}"
        )
    return peak


def _passed(
    search: Search, crossing: Peak, there: HarmonicSystem, top: NDArray, speeds: tuple[float, float],
    options: ContinuationOptions,
) -> tuple[Peak, list[Path]]:  # fmt: skip
    """The peak at fixed speed that a run-up passes at its highest point, and the paths at its speed to the nearest one.

    The crossing where no other is found.
    """
    paths, curve = _both_ways(there, top, (search.order * speeds[0], search.order * speeds[1]), options)
    maxima = refine_maxima(there, curve, parameter=float(top[-1]) / search.order)
    nearest = min(maxima, key=lambda p: abs(p.y[-1] - top[-1]), default=crossing)
    return search.secant(nearest)[0] or crossing, paths


def _estimate(
    search: Search, passed: Peak, above: float, speeds: tuple[float, float], options: ContinuationOptions
) -> float:
    """Estimate of how much higher than a peak at fixed speed the run-up is: that of a round peak, and where it is higher by
    more, that of the whole response curve at this speed, which may have a shoulder.

    A curve that keeps its shape and moves with the peak has at a speed ``Omega`` on the line the point of frequency ratio
    ``rho = (Omega/Omega*)^(1 - p)`` to the peak, ``rho^(s/(1 - p))`` times as high.
    """
    move = derivatives(search.family, passed)
    slope, frequency_slope = move.get("slope", np.nan), move.get("frequency_slope", np.nan)
    estimate = float(excess(slope, frequency_slope, half_bandwidth(passed)))
    if not above > max(1e-3, estimate):
        return estimate
    system = search.family.system(passed.parameter)
    _, curve = _both_ways(system, passed.y, (search.order * speeds[0], search.order * speeds[1]), options)
    along = np.linspace(0.0, len(curve) - 1.0, BETWEEN * len(curve))  # points of the curve are far apart on a plateau
    ratio, height = (
        np.interp(along, np.arange(len(curve)), values)
        for values in (
            np.array([p.y[-1] for p in curve]) / passed.y[-1],
            np.array([amplitude_at(system, p.y) for p in curve]) / passed.amplitude,
        )
    )
    low, high = (np.array(speeds) / passed.parameter) ** (1.0 - frequency_slope)
    risen = height * ratio ** (slope / (1.0 - frequency_slope))
    return float(np.fmax(estimate, risen[(ratio >= low) & (ratio <= high)].max(initial=1.0) - 1.0))


def _both_ways(
    system: HarmonicSystem, y: NDArray, limits: tuple[float, float], options: ContinuationOptions
) -> tuple[list[Path], list[PathPoint]]:
    """The paths from a point to lower and to higher frequencies (rad/s), and their points in order."""
    paths = [follow(system, y, limits, up=up, options=options) for up in (False, True)]
    return paths, [*paths[0].points[::-1], *paths[1].points[1:]]


def _ending(paths: list[Path]) -> str:
    """How the paths to lower and to higher speeds ended."""
    named = zip(("down", "up"), paths)
    ends = [f"{where} {path.status} ({path.reason})" for where, path in named if path.status != "complete"]
    return "; ".join(ends) or "complete"
