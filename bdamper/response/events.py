"""Events within a step along a curve: folds, maxima, corners and resonances.

The module also defines the settings of a path.

At a fold the frequency component of the tangent changes sign; at a maximum the derivative of the
response amplitude does. Newton's method on the equations and this condition starts from the cubic
through both ends of the step.  If it fails, as at corners, the root along the step is bracketed
(:func:`bdamper.response.scalar_search.root_trials`), with one corrector for each trial.  Two events
in one step leave the signs unchanged; then the cubic has an interior extremum.

The Jacobian is only piecewise continuous: at the onset or end of slip or separation the curve may
have a corner.  Bisection with the null vector of the Jacobian along a failed step finds it, because
the vector jumps there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import (
    OK,
    Correction,
    Equations,
    Fold,
    Maximum,
    Plane,
    norm2,
)
from bdamper.response.scalar_search import root_trials
from bdamper.util import validation
from bdamper.util.formatting import short_repr

# ---- settings and result of a path ----


AtLeastTwo = Annotated[int, partial(validation.integer, least=2)]
SIDE_POINTS = 1000
"""Largest number of points of an auxiliary path: outside the interval, or of a homotopy.

Outside, with 150, one more of 100 narrow intervals (``benchmarks/bench_narrow.py``) loses its
highest branch.
"""


@validation.check_arguments
@dataclass(frozen=True)
class ContinuationOptions:
    """Settings of the continuation.

    Parameters
    ----------
    tolerance : float
        Tolerance of the largest residual, relative to the excitation and the static load.
    step, min_step, max_step : float
        Initial, smallest and largest step in scaled unknowns (0.1 means a tenth of the vibration at
        the current point).
    max_turn : float, rad
        Largest angle between successive tangents of an accepted step.
    max_points : int
        Maximum number of points of one path.
    patience : int
        Number of points without progress in frequency after which the path is abandoned as a tangle
        of folds.
    budget : int or None
        Maximum number of evaluations of the equations for a curve; if None, it follows from the
        size of the problem (``bdamper.response.branches.evaluation_budget``).
    max_iterations : int
        Maximum number of Newton iterations in a step.
    locate : bool
        Whether to refine folds and maxima.
    locate_tolerance : float
        Tolerance of the positions of folds and maxima, relative to the step.
    corner_step : float
        Largest failed step within which a corner is searched for; longer steps are shortened first.
    """

    tolerance: Annotated[float, validation.Limits(above=0.0, below=1e-2)] = 1e-9
    step: validation.Positive = 0.05
    min_step: validation.Positive = 1e-7
    max_step: validation.Positive = 0.15
    max_turn: Annotated[float, validation.Limits(above=0.0, most=np.pi)] = 0.45
    max_points: AtLeastTwo = 5000
    # Without this limit the widest gap grows on three of six curves with tangles (from 5.3 to 23, 1.0
    # to 3.5 and 11.7 to 12.0 Hz) and shrinks on one (from 7.6 to 6.5 Hz); none of 284 ordinary
    # curves changes.
    patience: AtLeastTwo = 400
    budget: validation.Count | None = None
    max_iterations: AtLeastTwo = 8
    locate: bool = True
    locate_tolerance: Annotated[float, validation.Limits(above=0.0, below=1.0)] = 1e-8
    corner_step: validation.Positive = 0.3

    def __post_init__(self) -> None:
        validation.check_fields(self)
        steps = self.min_step, self.step, self.max_step
        validation.check_value(
            sorted(steps) == list(steps), "steps", "0 < min_step <= step <= max_step", steps
        )


@short_repr
@dataclass(frozen=True)
class Path:
    """Points of a path and how it ended.

    Parameters
    ----------
    points : tuple of Correction
    status : str
        "complete", "turned back" (to the bound from which it started), "closed" (on itself), "many
        folds" (without progress), "drifted off" (mean position of a free body unbounded),
        "stalled", "too many points", "out of budget" or "interrupted".
    reason : str
    iterations, failed_steps : int
    tangle : (low, high), rad/s, or None
        Range of the folds at which the path was stopped.
    """

    points: tuple[Correction, ...]
    status: str
    reason: str
    iterations: int
    failed_steps: int
    tangle: tuple[float, float] | None = None


def is_drift(tangent: NDArray, n_mean: int) -> bool:
    """Return whether only the mean position moves, at constant vibration and frequency."""
    return norm2(tangent[n_mean:]) < 1e-6


# ---- events within a step ----


ITERATIONS_BEYOND = 3
"""Newton iterations for a trial after a plane has missed the curve.

With guesses on the tangent of the last point before it, a fold or maximum at a corner takes 70 to
92 evaluations instead of 123 to 187 (shipped disk, 500 N, five harmonics).
"""
LEVEL_RISE = 1e-9
"""Relative rise of the squared amplitude per unit step that counts as rounding."""


def turns_twice(first: float, last: float, rise: float, margin: float = 0.02) -> bool:
    """Return whether a cubic on (0, 1) whose end slopes have one sign has interior extrema.

    The cubic has the slopes ``first`` and ``last`` at its ends and the difference ``rise`` between
    them.  Its slope must reverse by the fraction ``margin`` of the larger end slope.
    """
    if first * last <= 0.0:
        return False
    # make both end slopes positive
    if first < 0.0:
        first = -first
        last = -last
        rise = -rise
    # slope at t: first + b t + c t**2, with the integral rise
    b = 6.0 * rise - 4.0 * first - 2.0 * last
    c = 3.0 * (first + last) - 6.0 * rise
    # the smallest slope is at -b/(2 c), which must lie within the step
    has_smallest_within = c > 0.0 and -2.0 * c < b < 0.0
    if not has_smallest_within:
        return False
    smallest_slope = first - 0.25 * b * b / c
    return smallest_slope < -margin * max(first, last)


class StepPoint(NamedTuple):
    """Point within a step.

    Parameters
    ----------
    s : float
        Distance along the initial tangent.
    y, tangent : (n_unknowns + 1,) float
    """

    s: float
    y: NDArray
    tangent: NDArray


def _on_cubic(near: StepPoint, far: StepPoint, position: float, start: Correction) -> NDArray:
    """Return the point (n_unknowns + 1,) at a position on the cubic through two points of a step.

    Distances are along the tangent at the ``start`` of the step.  If a tangent at one of the
    points turns away from it by more than 60 degrees, extrapolate along the near one.
    """
    length = far.s - near.s
    near_cosine = float(near.tangent @ start.tangent)
    far_cosine = float(far.tangent @ start.tangent)
    if length <= 0.0 or min(near_cosine, far_cosine) < 0.5:
        # change of the scaled unknowns per unit of s
        slope = near.tangent / near_cosine if near_cosine > 0.5 else start.tangent
        return np.asarray(near.y + (position - near.s) * slope * start.scale)
    # position in the unit interval from near to far, with slopes and rise over this interval
    t = (position - near.s) / length
    first = length * start.scale * near.tangent / near_cosine
    last = length * start.scale * far.tangent / far_cosine
    rise = far.y - near.y
    quadratic = 3.0 * rise - 2.0 * first - last
    cubic = first + last - 2.0 * rise
    return np.asarray(near.y + t * (first + t * (quadratic + t * cubic)))


class Step(NamedTuple):
    """Accepted step along a curve.

    Parameters
    ----------
    start, end : Correction
    length : float
        Length along the tangent at the start; 0 for a path that ends at its start.
    """

    start: Correction
    end: Correction
    length: float


def _distance(start: Correction, y: NDArray) -> float:
    """Return the distance of a point along the tangent at the start of a step."""
    return float(start.tangent @ ((y - start.y) / start.scale))


class Events:
    """Events of the steps along one curve.

    Parameters
    ----------
    system : Equations
    options : ContinuationOptions
    """

    def __init__(self, system: Equations, options: ContinuationOptions) -> None:
        self.system = system
        self.options = options
        self.iterations = 0
        # last nonzero sign of the change of frequency
        self.sense = 0.0
        # a tilted border is not by chance normal to the null vector at a corner
        self._tilt = np.random.default_rng(1).standard_normal(system.n_unknowns + 1)
        self._tilt *= 0.3 / norm2(self._tilt)

    # ---- unresolved events ----

    def over_resonance(self, start: NDArray, end: NDArray) -> bool:
        """Return whether the phase of a modal coordinate jumps at its linear resonance.

        ``start`` and ``end`` (n_unknowns + 1,) are successive points of a path.
        """
        # frequencies, the last unknowns
        omega_before = start[-1]
        omega_after = end[-1]
        for resonance, half_width, row in self.system.watched:
            crosses = (omega_before - resonance) * (omega_after - resonance) < 0.0
            if not crosses or not abs(omega_after - omega_before) > half_width:
                continue
            # complex amplitude of the mode
            before = self.system.layout.amplitudes(start[:-1], harmonic=1) @ row
            after = self.system.layout.amplitudes(end[:-1], harmonic=1) @ row
            # the cosine of the change of phase is below 0.5: more than 60 degrees
            if (before.conjugate() * after).real < 0.5 * abs(before * after):
                return True
        return False

    def over_pair(self, here: Correction, new: Correction) -> bool:
        """Return whether frequency or amplitude seems to have two extrema within a step.

        Without this check 3 of 240 ordinary curves lose a pair of folds; it takes half a per cent
        of the evaluations.
        """
        n = self.system.n_mean
        if is_drift(here.tangent, n) or is_drift(new.tangent, n):
            return False
        scale = here.scale
        length = norm2((new.y - here.y) / scale)
        # frequency, the last unknown, in its unit
        frequency_slope_before = length * here.tangent[-1]
        frequency_slope_after = length * new.tangent[-1]
        frequency_rise = (new.parameter - here.parameter) / scale[-1]
        if turns_twice(frequency_slope_before, frequency_slope_after, frequency_rise):
            return True
        # half the squared amplitude; on a level stretch the sign of its slope is rounding
        gradient_before, squared_before = self.system.rows.squared_gradient(here.y)
        gradient_after, squared_after = self.system.rows.squared_gradient(new.y)
        slope_before = length * float(gradient_before @ (here.tangent * scale))
        slope_after = length * float(gradient_after @ (new.tangent * scale))
        if max(abs(slope_before), abs(slope_after)) <= LEVEL_RISE * squared_before:
            return False
        return turns_twice(slope_before, slope_after, 0.5 * (squared_after - squared_before))

    # ---- folds and maxima ----

    def between(self, step: Step) -> tuple[list[Correction], str]:
        """Locate the events of a step.

        Returns
        -------
        list of Correction
            Events in the order of the path.
        str
            Kind of the end of the step: the kind of an event that could not be located.
        """
        start, end, length = step
        starts_with_drift = is_drift(start.tangent, self.system.n_mean)
        ends_with_drift = is_drift(end.tangent, self.system.n_mean)
        # the frequency is constant along a drift
        sense = 0.0 if ends_with_drift else float(np.sign(end.tangent[-1]))
        # relative to the last step with a change of frequency
        turned = sense * self.sense < 0.0
        if sense != 0.0:
            self.sense = sense
        if not self.options.locate or length == 0.0:
            return [], "regular"
        kinds = []
        missed = "regular"
        turned_in_step = start.tangent[-1] * end.tangent[-1] < 0.0
        if turned and turned_in_step and not starts_with_drift:
            kinds.append("fold")
        elif turned:
            # the frequency turned over a drift, so the end of the drift is the fold
            missed = "fold"
        if not starts_with_drift and not ends_with_drift:
            slope_at_start = self._value("maximum", start.y, start.tangent, start.scale)
            slope_at_end = self._value("maximum", end.y, end.tangent, start.scale)
            _, squared = self.system.rows.squared_gradient(start.y)
            rounding = LEVEL_RISE * squared
            if slope_at_start > rounding and slope_at_end < -rounding:
                kinds.append("maximum")
        located = []
        for kind in kinds:
            event = self.locate(step, kind, self.options.locate_tolerance * length)
            if event is None:
                missed = kind
            else:
                located.append(replace(event, kind=kind))
        located.sort(key=lambda event: _distance(start, event.y))
        return located, missed

    def _value(self, kind: str, y: NDArray, tangent: NDArray, scale: NDArray) -> float:
        """Return the quantity that changes sign: the change of frequency, or of the amplitude.

        It is the frequency component of the tangent for a "fold", and the slope of half the squared
        amplitude for a "maximum".
        """
        if kind == "fold":
            return float(tangent[-1])
        gradient, _ = self.system.rows.squared_gradient(y)
        return float(gradient @ (tangent * scale))

    def locate(self, step: Step, kind: str, tolerance: float) -> Correction | None:
        """Locate a fold or maximum, by Newton's method on a smooth step, otherwise by bracketing.

        Parameters
        ----------
        step : Step
            Step at whose ends the quantity that vanishes at the event has opposite signs.
        kind : {"fold", "maximum"}
        tolerance : float
            Tolerance of the position, in scaled unknowns.

        Returns
        -------
        Correction or None
            Fold or maximum, with the slope and curvature of its condition; None if no corrector
            converges.
        """
        start, end, length = step
        first = self._value(kind, start.y, start.tangent, start.scale)
        last = self._value(kind, end.y, end.tangent, start.scale)
        # a circular arc has a chord along its mean tangent
        chord = (end.y - start.y) / start.scale
        sum_of_tangents = start.tangent + end.tangent
        # difference of chord and mean tangent, relative to the difference of the tangents, below
        # which a step counts as smooth.  Of 129 folds and maxima of curves with friction, 47 of 73
        # smooth ones are below, and 9 of 56 at corners, where Newton's method fails
        even = 0.05
        unit_chord = chord / norm2(chord)
        mean_tangent = sum_of_tangents / max(norm2(sum_of_tangents), even)
        is_smooth = norm2(unit_chord - mean_tangent) < even * norm2(end.tangent - start.tangent)
        if is_smooth:
            # the quantity changes about linearly over the step: its zero, as part of the step
            part = first / (first - last)
            tangent = start.tangent + part * (end.tangent - start.tangent)
            condition = Fold if kind == "fold" else Maximum
            target = condition(
                tangent=tangent / norm2(tangent),
                curvature=(last - first) / (length * self._weight(kind, start.y)),
                tolerance=tolerance,
                max_step=0.5 * length,
            )
            near = StepPoint(0.0, start.y, start.tangent)
            far = StepPoint(length, end.y, end.tangent)
            guess = _on_cubic(near, far, part * length, start)
            event = self.system.solve(
                guess, target, start.scale, self.options.tolerance, self.options.max_iterations
            )
            self.iterations += event.iterations
            if event.status == OK and 0.0 <= _distance(start, event.y) <= length:
                return event
        return self._bracketed(step, first, last, kind, tolerance)

    def _weight(self, kind: str, y: NDArray) -> float:
        """Return the divisor of :meth:`_value` for the slope and curvature of a result.

        For a maximum it makes the slope of half the squared amplitude that of ln(amplitude).
        """
        if kind == "fold":
            return 1.0
        _, squared = self.system.rows.squared_gradient(y)
        return squared

    def _bracketed(
        self, step: Step, first: float, last: float, kind: str, tolerance: float
    ) -> Correction | None:
        """Locate a fold or a maximum as the root of a function that changes sign over a step.

        A trial is the point of the curve in a plane normal to the tangent at the start of the step;
        Newton's method starts from the cubic through the adjacent points.  A plane without solution
        lies beyond a corner, and so beyond the event.
        """
        start, end, length = step
        # position and value on both sides of the event
        before = 0.0, first
        after = length, last
        # points that the cubic connects
        near = StepPoint(0.0, start.y, start.tangent)
        far = StepPoint(length, end.y, end.tangent)
        event: Correction | None = None
        max_iterations = self.options.max_iterations
        trials = root_trials(before, after, tolerance)
        position = next(trials)
        while True:
            guess = _on_cubic(near, far, position, start)
            solution = self.system.solve(
                guess, Plane(start.tangent), start.scale, self.options.tolerance, max_iterations
            )
            self.iterations += solution.iterations
            # a solution far away belongs to another part of the curve
            if (
                solution.status == OK
                and norm2((solution.y - start.y) / start.scale) <= 2.0 * position
            ):
                value = self._value(kind, solution.y, solution.tangent, start.scale)
                point = StepPoint(position, solution.y, solution.tangent)
                beyond_event = value * last >= 0.0
                if beyond_event:
                    other_position, other_value = before
                    after = position, value
                    far = point
                else:
                    other_position, other_value = after
                    before = position, value
                    near = point
                # difference quotient across the event
                curvature = (value - other_value) / (position - other_position)
                weight = self._weight(kind, solution.y)
                event = replace(solution, slope=value / weight, curvature=curvature / weight)
            else:
                # beyond a corner; the reversed tangent makes the next guess an extrapolation from
                # the near point
                value = last
                far = StepPoint(position, near.y, -start.tangent)
                max_iterations = ITERATIONS_BEYOND
            try:
                position = trials.send(value)
            except StopIteration:
                return event

    # ---- corners ----

    def _direction(self, y: NDArray, scale: NDArray, border: NDArray, sign: int) -> NDArray | None:
        """Return the null vector of the Jacobian at y, also off the curve; None if singular.

        Its sense agrees with ``sign``, the sign of det [J; tangent] along the path, unless that is
        0 (unknown).
        """
        # every point counts as converged
        any_residual = 1e300
        solution = self.system.solve(
            y, Plane(border), scale, tolerance=any_residual, max_iterations=1
        )
        if solution.status != OK or not solution.orientation:
            return None
        if not sign:
            return solution.tangent
        # reversed if the signs differ
        return solution.orientation * sign * solution.tangent

    def around_corner(
        self, here: Correction, step: float, sign: int
    ) -> tuple[Correction, float] | None:
        """Return the first point beyond a corner within a step, and the length beyond the corner.

        Bisection finds the jump of the null vector of the Jacobian.  On a smooth curve the vectors
        at both ends of the interval approach each other; the search ends when they are within 0.4
        of their initial distance.  On an optimal curve this saves half of the trials in smooth
        bends, and one of 109 corners is found one step later.  Without this search 8 of 240
        ordinary curves are incomplete, 8 more consist of pieces or lack folds, and all 240 together
        take 3.2 times the evaluations.

        Parameters
        ----------
        here : Correction
        step : float
        sign : int
            Sign of det [J; tangent] along the path, 0 if unknown.
        """
        y = here.y
        tangent = here.tangent
        scale = here.scale
        border = tangent + self._tilt
        # the corner is between these distances along the tangent
        near = 0.0
        far = step
        near_direction = tangent
        far_direction = self._direction(y + far * tangent * scale, scale, border, sign)
        if far_direction is None:
            return None
        jump = norm2(far_direction - tangent)
        if jump < 0.2:
            return None
        bisections = 7
        for _ in range(bisections):
            middle = 0.5 * (near + far)
            direction = self._direction(y + middle * tangent * scale, scale, border, sign)
            if direction is None:
                return None
            before_corner = norm2(direction - tangent) < 0.5 * jump
            if before_corner:
                near = middle
                near_direction = direction
            else:
                far = middle
                far_direction = direction
            smooth = norm2(far_direction - near_direction) < 0.4 * jump
            if smooth:
                return None
        # without a sign the sense of the null vector is unknown
        senses = (1.0,) if sign else (1.0, -1.0)
        for sense in senses:
            direction = sense * far_direction
            for part in (0.5, 0.1, 0.01):
                beyond_corner = part * step
                guess = y + (far * tangent + beyond_corner * direction) * scale
                # the corner is known within far - near
                reach = 0.5 * beyond_corner + far - near
                solution = self._solution_near(guess, direction, scale, reach)
                if solution is not None and self._continues(here, solution, sign):
                    return solution, beyond_corner
        return None

    def _solution_near(
        self, guess: NDArray, direction: NDArray, scale: NDArray, reach: float
    ) -> Correction | None:
        """Return a solution near a guess, in the plane normal to a direction, or None.

        Its distance from the guess is at most ``reach``, and its tangent is close to the direction.
        """
        if not guess[-1] > 0.0:
            return None
        solution = self.system.solve(
            guess,
            Plane(direction),
            scale,
            self.options.tolerance,
            self.options.max_iterations,
            reach=2.0 * reach,
        )
        self.iterations += solution.iterations
        if solution.status != OK or not norm2((solution.y - guess) / scale) <= reach:
            return None
        if not float(solution.tangent @ direction) >= np.cos(self.options.max_turn):
            return None
        return solution

    def _continues(self, here: Correction, solution: Correction, sign: int) -> bool:
        """Return whether a solution beyond a corner continues the path in its direction.

        ``sign`` is the sign of det [J; tangent] along the path, 0 if unknown.
        """
        if sign and solution.orientation == -sign:
            return False
        # without a sign the path must not return almost exactly the way it came
        moved = (solution.y - here.y) / here.scale
        if not sign and float(moved @ here.tangent) < -0.99 * norm2(moved):
            return False
        return not self.over_resonance(here.y, solution.y)
