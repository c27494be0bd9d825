"""Tracking curve of a wheel: all its unknowns followed over frequency by arclength continuation.

As for one sector (:mod:`bdamper.continuation.follower`) steps are measured in scaled unknowns, and a step counts only if
Newton ends near its prediction.  Vibration and frequency count, each with its own unit; the mean does not, since dampers
that slip fully move along the axis at one frequency, one here and one there.  Directions are those of polynomials through
the last points instead of tangents, which would each cost a solution of the equations.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from math import tau
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost
from bdamper.util.status import NOT_FOUND
from bdamper.wheel.newton import TOLERANCE, Corrected, correct, plane_across, size_of, solved, walked
from bdamper.wheel.results import WheelCurve
from bdamper.wheel.solution import solution
from bdamper.wheel.system import PLAIN, Ease, WheelSystem
from bdamper.wheel.wheel_problem import WheelProblem

FIRST, SHORTEST = 0.05, 1e-6
"""First and shortest step, relative to the vibration."""
SHORT = 5e-3
"""Step below which a path tries whether a damper has come free."""


def start(system: WheelSystem, mean: NDArray, omega: float, ease: Ease) -> Corrected | None:
    """A solution at one frequency from the static state, or None."""
    X = np.zeros(system.shape)
    X[:, 0] = mean
    X[system.still] = 0.0
    found = correct(system, X, omega, ease=ease, tolerance=TOLERANCE, most=40, line_search=True)
    return found if found.converged else solution(system, X, omega, ease, TOLERANCE)


class Path:
    """State of one run along the curve."""

    def __init__(self, system: WheelSystem, limits: tuple[float, float], ease: Ease = PLAIN) -> None:
        self.system, self.limits, self.ease = system, limits, ease
        self.points: list[tuple[NDArray, float]] = []
        self.length: list[float] = []
        self.failed = 0

    def set_off(self, first: Corrected, up: bool) -> None:
        """First point, and one before it along the tangent."""
        inverse = first.at.inverse()
        aside, _, _ = solved(first.at, inverse, None, 1e-4, (-first.at.by_omega, 0.0))
        back = (-1e-3 if up else 1e-3) * (self.limits[1] - self.limits[0])
        self.points = [(first.X + back * aside, first.omega + back), (first.X, first.omega)]
        self.length = [0.0, self.distance(self.points[0], self.points[1], *self.scale())]

    def scale(self) -> tuple[float, float]:
        """Units of the vibration and of the frequency."""
        return max(size_of(self.points[-1][0]), 1e-300), 0.5 * (self.limits[1] - self.limits[0])

    def predicted(self, step: float, unit: float, unit_omega: float) -> tuple[NDArray, float, tuple[NDArray, float]]:
        """Point ahead by a polynomial through the last points, and the plane of the corrector."""
        last = self.points[-4:]
        s = np.array(self.length[-len(last) :])
        at = s[-1] + step
        weight = np.array([np.prod([(at - b) / (a - b) for b in s if b != a]) for a in s])
        X = np.einsum("i,i...->...", weight, np.array([p[0] for p in last]))
        omega = float(weight @ [p[1] for p in last])
        before, now = last[-2], last[-1]
        X[:, 0] = now[0][:, 0]
        # where the polynomial turns back, straight on
        chord, straight = (X - now[0], omega - now[1]), (now[0] - before[0], now[1] - before[1])
        if _along(chord, straight, unit, unit_omega) < 0.5 * step * self.distance(now, before, unit, unit_omega):
            ratio = step / (s[-1] - s[-2])
            X, omega, chord = now[0] + ratio * straight[0], now[1] + ratio * straight[1], straight
            X[:, 0] = now[0][:, 0]
        return X, omega, plane_across(chord, now[0], unit_omega, self.system)

    def distance(self, a: tuple[NDArray, float], b: tuple[NDArray, float], unit: float, unit_omega: float) -> float:
        """In scaled unknowns."""
        apart = a[0] - b[0], a[1] - b[1]
        return float(np.sqrt(_along(apart, apart, unit, unit_omega)))

    def add(self, X: NDArray, omega: float, unit: float, unit_omega: float) -> None:
        """One more point; earlier lengths count as they were."""
        self.length.append(self.length[-1] + self.distance((X, omega), self.points[-1], unit, unit_omega))
        self.points.append((X, omega))
        if len(self.points) > 4:
            del self.points[0], self.length[0]


def _along(a: tuple[NDArray, float], b: tuple[NDArray, float], unit: float, unit_omega: float) -> float:
    """Product of two directions in scaled unknowns."""
    return float((a[0][:, 1:] * b[0][:, 1:]).sum() / unit**2 + a[1] * b[1] / unit_omega**2)


@one_thread
def track(
    wheel: WheelProblem,
    preload: float,
    frequency: tuple[float, float],
    *,
    from_high: bool = False,
    max_points: int = 3000,
    max_step: float = 0.15,
    springs: float = 0.0,
) -> WheelCurve:
    """Response of all blades over a frequency interval at one preload.

    Parameters
    ----------
    wheel : Wheel
    preload : float, N
    frequency : (low, high), Hz
    from_high : bool
        Set off from the upper end.
    max_points : int
    max_step : float
        Largest step, relative to the vibration of the whole wheel.
    springs : float
        On the mean of dampers, relative to their stiffness when stuck, as peaks with dampers held have.

    Returns
    -------
    WheelCurve
        The branch from one end; ``status`` is "complete" if it leads to the other end.
    """
    watch = time.perf_counter(), time.process_time()
    frequency = validate.interval("frequency", frequency)
    validate.flag("from_high", from_high)
    max_points = validate.whole("max_points", max_points, least=2)
    max_step = validate.number("max_step", max_step, above=0.0, most=1.0)
    ease = Ease(springs=validate.number("springs", springs, least=0.0))
    system, mean = wheel.system(preload)
    before = system.evaluations, system.factorisations, system.iterations
    limits = tau * frequency[0], tau * frequency[1]
    records: list[tuple[Any, ...]] = []

    def keep(found: Corrected, kind: str) -> None:
        shares = wheel.damper_shares(found.at.shares)
        records.append((found.omega / tau, wheel.response(found.X), shares, found.residual, kind))

    first = start(system, mean, limits[1 if from_high else 0], ease)
    if first is None:
        status, reason, failed = NOT_FOUND, f"no solution found at {frequency[1 if from_high else 0]:.6g} Hz", 0
    else:
        keep(first, "end")
        path = Path(system, limits, ease)
        path.set_off(first, not from_high)
        status, reason = follow(path, keep, not from_high, max_points, max_step)
        failed = path.failed
    return WheelCurve(
        frequency=np.array([r[0] for r in records]),
        response=np.array([r[1] for r in records]).reshape(len(records), wheel.n_blades, system.n_harmonics + 1),
        shares=np.array([r[2] for r in records]).reshape(len(records), wheel.n_blades, 3),
        residual=np.array([r[3] for r in records]),
        point_kind=tuple(r[4] for r in records),
        preload=float(preload),
        springs=springs,
        status=status,
        reason=reason,
        deviation=wheel.mistuning.deviation.reshape(wheel.n_blades, -1),
        cost=cost_of(system, watch, before, failed),
        settings=wheel.settings(),
        model_hash=wheel.study.model.hash,
    )


def cost_of(system: WheelSystem, watch: tuple[float, float], before: tuple[int, int, int], failed: int = 0) -> Cost:
    """What was spent since a reading of clocks and counts."""
    return Cost(
        seconds=time.perf_counter() - watch[0],
        processor=time.process_time() - watch[1],
        evaluations=system.evaluations - before[0],
        factorisations=system.factorisations - before[1],
        iterations=system.iterations - before[2],
        failed_steps=failed,
    )


def follow(
    path: Path, keep: Callable[[Corrected, str], None], up: bool, max_points: int, max_step: float
) -> tuple[str, str]:
    """Follows the curve until it leaves the interval; returns status and reason."""
    system, (low, high) = path.system, path.limits
    step, rising, inverse = FIRST, up, None
    for _ in range(max_points):
        unit, unit_omega = path.scale()
        here = path.points[-1]
        X, omega, plane = path.predicted(step, unit, unit_omega)
        beyond = not low <= omega <= high
        if beyond:
            bound = high if omega > high else low
            share = (bound - here[1]) / (omega - here[1])
            end = correct(system, here[0] + share * (X - here[0]), bound, ease=path.ease, tolerance=TOLERANCE,
                          inverse=inverse)  # fmt: skip
            if end.converged and path.distance((end.X, end.omega), here, unit, unit_omega) < 2.0 * step:
                keep(end, "end")
                whole = (bound == high) == up
                where = f"{bound / tau:.6g} Hz"
                return ("complete", f"reached {where}") if whole else ("turned back", f"came back to {where}")
        new = None if beyond else correct(
            system, X, omega, plane, ease=path.ease, tolerance=TOLERANCE, least=1, most=12, inverse=inverse,
            longest=_reach(here, step),
        )  # fmt: skip
        off = np.inf
        if new is not None and new.converged:
            off = path.distance((new.X, new.omega), (X, omega), unit, unit_omega)
        if new is None or off > 0.5 * step:
            path.failed += 1
            step *= 0.5 if new is None or new.converged else 0.25
            inverse = None
            if step < SHORT and not path.ease.springs:
                new = _walk_on(path, max(step, SHORT))
                if new is not None:
                    path.add(new.X, new.omega, unit, unit_omega)
                    keep(new, "regular")
                    step = SHORT
                    continue
            if step < SHORTEST:
                return "stalled", f"at {here[1] / tau:.6g} Hz: no solution at the smallest step"
            continue
        inverse = new.inverse
        turned = (new.omega > here[1]) != rising
        rising = new.omega > here[1]
        path.add(new.X, new.omega, unit, unit_omega)
        keep(new, "fold" if turned else "regular")
        growth = min(2.0, np.sqrt(0.1 * step / max(off, 1e-12)), 2.0 * (5.0 / max(new.iterations, 1)) ** 1.5)
        step = min(max_step, step * max(0.5, growth))
    return "too many points", f"{max_points} points before the end of the interval"


def _walk_on(path: Path, step: float) -> Corrected | None:
    """A solution beyond a place at which a damper comes free: at fixed frequencies ahead, its position found anew."""
    unit, unit_omega = path.scale()
    here = path.points[-1]
    for ahead in (step, 4.0 * step):
        X, omega, _ = path.predicted(ahead, unit, unit_omega)
        if path.limits[0] < omega < path.limits[1]:
            new = walked(path.system, X, omega, tolerance=TOLERANCE, most=25)
            if new.converged and path.distance((new.X, new.omega), here, unit, unit_omega) < 3.0 * ahead:
                return new
    return None


def _reach(here: tuple[NDArray, float], step: float) -> float:
    """Longest Newton step on the vibration."""
    return float(max(2.0 * step, 0.05) * size_of(here[0]))
