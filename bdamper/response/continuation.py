"""Pseudo-arclength continuation of a response curve.

A point is ``y = (u, omega)``.  Steps are measured in scaled unknowns ``z = y/scale``.  Mean,
vibration and frequency each have a unit, updated at every step: a step of 0.1 changes the vibration
by about a tenth.  The predictor is the tangent. The corrector is Newton's method in the plane
through the prediction, normal to the tangent.

A step is accepted if Newton's method converges, the solution is within half the step length of its
prediction, and the tangent turns by less than a set angle.  These conditions prevent steps across a
sharp resonance, where the phase of the response changes by pi, or to another branch.  The Newton
iteration ends as soon as one of its steps exceeds the step along the curve.  This rule rejects
three of 2690 steps on an optimal curve that are accepted without it, and reduces the evaluations of
failed steps to 40 %.  A failed step is shortened and searched for a corner of the curve
(:mod:`bdamper.response.events`).

The mean position of the damper is part of the unknowns.  Along some curves it moves at constant
vibration and frequency; these points have the kind "drift".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import (
    NOT_CONVERGED,
    OK,
    STATUS_TEXT,
    Correction,
    Equations,
    Plane,
    norm2,
)
from bdamper.response.events import ContinuationOptions, Events, Path, Step, is_drift

DRIFTED_OFF = (
    "no periodic solution after this point: the mean position of a free body moves without bound, "
    "because a mean force drives it and no constraint plane carries load"
)
MANY_FOLDS, OUT_OF_BUDGET = "many folds", "out of budget"
TWO_PI = 2.0 * np.pi


class Follower:
    """Continuation along one curve.

    Parameters
    ----------
    system : Equations
    limits : (low, high)
        Interval of the parameter (rad/s if it is the frequency).
    options : ContinuationOptions
    on_point : callable, optional
        Called with every accepted point.
    """

    def __init__(
        self,
        system: Equations,
        limits: tuple[float, float],
        options: ContinuationOptions,
        on_point: Callable[[Correction], None] | None = None,
    ) -> None:
        self.system = system
        self.place = system.measure.place
        self.low, self.high = limits
        self.options = options
        self.on_point = on_point
        self.events = Events(system, options)
        self.points: list[Correction] = []
        self.iterations = 0
        self.failed = 0
        self.largest = 0.0
        # sign of det [J; tangent] along the path, 0 if unknown
        self.sign = 0
        self.tangle: tuple[float, float] | None = None

    # ---- units and records ----

    def scale_at(self, y: NDArray) -> NDArray:
        """Return the units of mean, vibration and parameter at a point."""
        measure = self.system.measure
        vibration = measure.vibration(y)
        self.largest = max(self.largest, vibration)
        # the vibration may vanish at an antiresonance
        least = max(1e-9 * self.largest, 1e-300)
        half_interval = 0.5 * (self.high - self.low)
        return measure.units(y, max(vibration, least), half_interval)

    def drifts(self, tangent: NDArray) -> bool:
        """Return whether only the mean position of the damper moves along a tangent."""
        return is_drift(tangent, self.system.n_mean)

    def record(self, point: Correction) -> Correction:
        """Add a point to the path."""
        if point.kind == "regular" and self.drifts(point.tangent):
            point = replace(point, kind="drift")
        self.points.append(point)
        if self.on_point is not None:
            self.on_point(point)
        return point

    def path(self, status: str, reason: str) -> Path:
        """Return the path computed so far."""
        return Path(
            points=tuple(self.points),
            status=status,
            reason=reason,
            iterations=self.iterations + self.events.iterations,
            failed_steps=self.failed,
            tangle=self.tangle,
        )

    # ---- steps ----

    def try_step(self, here: Correction, step: float) -> tuple[Correction, str]:
        """Return the result of one predictor and corrector step, and the reason why it is rejected,
        or "".
        """
        y = here.y
        tangent = here.tangent
        scale = here.scale
        predicted = y + step * tangent * scale
        # the last unknown
        predicted_frequency = predicted[-1]
        if not predicted_frequency > 0.0:
            no_solution = Correction(
                status=NOT_CONVERGED,
                y=predicted,
                tangent=tangent,
                scale=scale,
                iterations=0,
                residual=np.inf,
                rank_deficiency=0,
            )
            return no_solution, "frequency not positive"
        options = self.options
        new = self.system.solve(
            predicted, Plane(tangent), scale, options.tolerance, options.max_iterations, reach=step
        )
        self.iterations += new.iterations
        if new.status != OK:
            return new, STATUS_TEXT[new.status]
        if norm2((new.y - predicted) / scale) > 0.5 * step:
            return new, "solution far from its prediction"
        # below a step of 1e-3 a large turn is a corner, not curvature
        if step > 1e-3 and float(new.tangent @ tangent) < np.cos(self.options.max_turn):
            return new, "tangent turned too much"
        # a part of the curve with the opposite direction; at the smallest steps a bifurcation was
        # passed, and the new direction is right
        if step > 1e-5 and self.sign and new.orientation == -self.sign:
            return new, "orientation of the curve changed"
        if self.events.over_resonance(y, new.y):
            return new, "a resonance of the linear structure lies within the step"
        if self.options.locate and step > 0.02 and self.events.over_pair(here, new):
            return new, "two folds or extrema lie within the step"
        return new, ""

    def advance(self, here: Correction, step: float) -> tuple[Correction | None, float, float, str]:
        """Step along the curve, with shorter steps until one is accepted.

        Returns
        -------
        new : Correction or None
            New point, None if no step is possible.
        step : float
            Length of the step; at a corner, of its part beyond the corner.
        reach : float
            Length of the step along the tangent at ``here``.
        refused : str
            Reason for the last rejection; empty after an accepted step.
        """
        refused = "step too short"
        while step >= self.options.min_step and not self.system.spent:
            new, refused = self.try_step(here, step)
            if not refused:
                return new, step, step, ""
            self.failed += 1
            if step <= self.options.corner_step:
                corner = self.events.around_corner(here, step, self.sign)
                if corner is not None:
                    beyond_corner, length = corner
                    return beyond_corner, length, step, ""
            # Newton's method without convergence needs a much shorter step than a rejected solution
            step *= 0.5 if new.status == OK else 0.25
        return None, step, step, refused

    def longer(self, step: float, turn: float, iterations: int) -> float:
        """Return the length of the next step from the last step.

        ``turn`` (rad) is the angle between the tangents at its ends, and ``iterations`` the number
        of Newton iterations.
        """
        # a turn is proportional to the step: aim at 0.6 of the allowed turn
        by_turn = 0.6 * self.options.max_turn / max(turn, 1e-9)
        # twice the step after three iterations
        by_iterations = 2.0 * (3.0 / max(iterations, 1)) ** 1.5
        growth = min(2.0, by_turn, by_iterations)
        return min(self.options.max_step, step * max(0.5, growth))

    def end_at(self, last: Correction, beyond: NDArray, omega: float) -> Correction | None:
        """Return the end of the path at a bound ``omega`` that a step crosses, or None.

        ``last`` and ``beyond`` are the points on both sides of the bound.
        """
        share = (omega - last.parameter) / (beyond[-1] - last.parameter)
        guess = last.y + share * (beyond - last.y)
        scale = last.scale
        end = self.system.correct_at(
            guess[:-1],
            omega,
            scale,
            self.options.tolerance,
            max_iterations=2 * self.options.max_iterations,
        )
        self.iterations += end.iterations
        if end.status != OK or norm2((end.y - guess) / scale) >= 1.0:
            return None
        # the tangent of a solution at fixed frequency points to higher frequency; turn it along
        # the path
        chord = (end.y - last.y) / scale
        sense = np.copysign(1.0, end.tangent @ chord)
        return replace(end, tangent=sense * end.tangent)

    # ---- end of a path ----

    def _far(self, y: NDArray, start: NDArray, ratio: float) -> bool:
        """Return whether the mean exceeds the vibration and its initial value by a ratio."""
        n_mean = self.system.n_mean
        mean = norm2(y[:n_mean])
        initial_mean = norm2(start[:n_mean])
        return mean > ratio * max(self.largest, initial_mean)

    def _closes(self, y: NDArray, new: Correction) -> bool:
        """Return whether a step passes through the first point of the path as at the start."""
        first = self.points[0]
        chord = (new.y - y) / first.scale
        to_first = (first.y - y) / first.scale
        length = norm2(chord)
        # the first point in coordinates along the step and normal to it
        along = float(to_first @ chord) / length
        if not 0.0 <= along <= length:
            return False
        same_direction = float(chord @ first.tangent) >= 0.8 * length
        if not same_direction:
            return False
        distance = norm2(to_first - along * chord / length)
        return distance < 0.05 * length

    def _tangled(self, since: int) -> Path:
        """Return the path if its last points, from a number on, are a tangle of folds."""
        frequencies = [float(point.parameter) for point in self.points[since:]]
        low = min(frequencies)
        high = max(frequencies)
        self.tangle = low, high
        folds = f"points of folds from {self.place(low)} to {self.place(high)}"
        return self.path(MANY_FOLDS, f"{self.options.patience} {folds} without progress")

    def _stopped(self, y: NDArray, tangent: NDArray, start: NDArray, refused: str) -> Path:
        """Return the path if no step is possible."""
        if self.system.spent:
            place = self.place(y[-1])
            return self.path(OUT_OF_BUDGET, f"its share of the evaluations is used up at {place}")
        if self.drifts(tangent) and self._far(y, start, ratio=1e3):
            return self.path("drifted off", DRIFTED_OFF)
        return self.path("stalled", f"at {self.place(y[-1])}: {refused} at the smallest step")

    def _arrived(self, bound: float, up: bool, start: float) -> Path:
        """Return the path at a bound; ``start`` is its first frequency."""
        at_far_end = (bound == self.high) == up
        if at_far_end:
            return self.path("complete", f"reached {self.place(bound)}")
        started = ", where it started" if start == bound else ""
        return self.path("turned back", f"returned to {self.place(bound)}{started}")

    # ---- the run ----

    def run(self, start: NDArray, up: bool) -> Path:
        """Follow the curve from a point near it; see :func:`follow`."""
        options = self.options
        scale = self.scale_at(start)
        start_omega = start[-1]
        first = self.system.correct_at(
            start[:-1],
            start_omega,
            scale,
            options.tolerance,
            max_iterations=4 * options.max_iterations,
        )
        self.iterations += first.iterations
        if first.status != OK:
            return self.path("stalled", f"no solution at the start: {STATUS_TEXT[first.status]}")
        self.sign = first.orientation if up else -first.orientation
        self.events.sense = 1.0 if up else -1.0
        direction = first.tangent if up else -first.tangent
        point = self.record(replace(first, tangent=direction, kind="end"))
        step = options.step
        # range of the frequencies passed, and number of points when it last became wider
        lowest = highest = float(start_omega)
        progress_at = 1
        while len(self.points) < options.max_points:
            y = point.y
            omega = point.parameter
            # distance outside of the range
            beyond = max(lowest - omega, omega - highest)
            if beyond > 1e-4 * (self.high - self.low):
                lowest = min(lowest, omega)
                highest = max(highest, omega)
                progress_at = len(self.points)
            elif len(self.points) - progress_at > options.patience:
                return self._tangled(progress_at)
            # the same direction, of unit length in new units
            scale = self.scale_at(y)
            tangent = point.tangent * point.scale / scale
            tangent /= norm2(tangent)
            here = replace(point, tangent=tangent, scale=scale)
            failed_before = self.failed
            new, step, reach, refused = self.advance(here, step)
            if new is None:
                return self._stopped(y, tangent, start, refused)
            new_omega = new.parameter
            if not self.low <= new_omega <= self.high:
                bound = self.high if new_omega > self.high else self.low
                end = self.end_at(here, new.y, bound)
                if end is not None:
                    last_step = Step(here, end, norm2((end.y - y) / scale))
                    located, _ = self.events.between(last_step)
                    for event in located:
                        self.record(event)
                    self.record(replace(end, kind="end"))
                    return self._arrived(bound, up, start_omega)
                # no solution at the bound: approach it with shorter steps
                step *= 0.5
                self.failed += 1
                if step < options.min_step:
                    return self.path("stalled", f"no solution at {self.place(bound)}")
                continue
            # at a singular Jacobian the sign is unknown
            if new.orientation:
                self.sign = new.orientation
            if len(self.points) > 10 and self._closes(y, new):
                place = self.place(new_omega)
                return self.path("closed", f"the branch closes on itself at {place}")
            located, kind = self.events.between(Step(here, new, reach))
            for event in located:
                self.record(event)
            point = self.record(replace(new, kind=kind))
            drifting = self.drifts(new.tangent) and self.drifts(tangent)
            if self.system.supported and self._far(new.y, start, ratio=1e2):
                return self.path("drifted off", DRIFTED_OFF)
            if drifting and self._far(new.y, start, ratio=1e6):
                return self.path("drifted off", DRIFTED_OFF)
            if drifting:
                # straight and at constant frequency: long steps until a step fails near the next
                # contact
                if self.failed == failed_before:
                    step = min(4.0 * step, 2.0)
            else:
                # angle between the unit tangents
                turn = float(np.arccos(np.clip(new.tangent @ tangent, -1.0, 1.0)))
                step = self.longer(step, turn, new.iterations)
        return self.path(
            "too many points", f"{options.max_points} points before the end of the interval"
        )


def follow(
    system: Equations,
    start: NDArray,
    limits: tuple[float, float],
    *,
    up: bool = True,
    options: ContinuationOptions | None = None,
    on_point: Callable[[Correction], None] | None = None,
) -> Path:
    """Follow the response from a point near the curve until it leaves the frequency interval.

    Parameters
    ----------
    system : Equations
    start : (n_unknowns + 1,) float
        Point from which Newton's method converges at its frequency.
    limits : (low, high), rad/s
    up : bool
        Whether to start towards higher frequency.
    options : ContinuationOptions
    on_point : callable, optional
        Called with every accepted point.

    Returns
    -------
    Path
        Converged points; ``status`` and ``reason`` describe how the path ended.
    """
    follower = Follower(system, limits, options or ContinuationOptions(), on_point)
    return follower.run(start, up)
