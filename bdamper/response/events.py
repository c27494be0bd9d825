"""Events within a step along a curve: folds, maxima, corners and resonances; settings of a path.

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

from bdamper.harmonic_balance.equations import OK, Correction, Equations, Fold, Peak, Plane, norm2
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
        Initial, smallest and largest step in scaled unknowns (0.1: a tenth of the present
        vibration).
    max_turn : float, rad
        Largest angle between successive tangents of an accepted step.
    max_points : int
        Largest number of points of one path.
    patience : int
        Number of points without progress in frequency after which a path ends as a tangle of folds.
        Without this limit the widest gap grows on three of six curves with tangles (from 5.3 to 23,
        1.0 to 3.5 and 11.7 to 12.0 Hz) and shrinks on one (from 7.6 to 6.5 Hz); none of 284
        ordinary curves changes.
    budget : int or None
        Largest number of evaluations of the equations for a curve; None sets it from the size of
        the problem (``bdamper.response.branches.evaluation_budget``).
    max_iterations : int
        Largest number of Newton iterations in a step.
    locate : bool
        Whether to refine folds and maxima.
    locate_tolerance : float
        Tolerance of their position, relative to the step.
    corner_step : float
        Largest failed step that is searched for a corner; longer steps are shortened first.
    """

    tolerance: Annotated[float, validation.Limits(above=0.0, below=1e-2)] = 1e-9
    step: validation.Positive = 0.05
    min_step: validation.Positive = 1e-7
    max_step: validation.Positive = 0.15
    max_turn: Annotated[float, validation.Limits(above=0.0, most=np.pi)] = 0.45
    max_points: AtLeastTwo = 5000
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


StepPoint = tuple[float, NDArray, NDArray]
"""Point within a step: distance along the initial tangent, point and tangent."""
ITERATIONS_BEYOND = 3
"""Newton iterations for a trial after a plane has missed the curve.

With guesses on the tangent of the last point before it, a fold or maximum at a corner takes 70 to
92 evaluations instead of 123 to 187 (shipped disk, 500 N, five harmonics).
"""
LEVEL_RISE = 1e-9
"""Relative rise of the squared amplitude per unit step that counts as rounding."""


def turns_twice(first: float, last: float, rise: float, margin: float = 0.02) -> bool:
    """Return whether a Hermite cubic on (0, 1) has interior extrema; its end slopes have one sign.

    Its slope ``first + b t + c t**2`` must reverse by the fraction ``margin`` of the larger end
    slope.
    """
    if first * last <= 0.0:
        return False
    if first < 0.0:
        first, last, rise = -first, -last, -rise
    b, c = 6.0 * rise - 4.0 * first - 2.0 * last, 3.0 * (first + last) - 6.0 * rise
    if c <= 0.0 or not -2.0 * c < b < 0.0:
        return False
    return first - 0.25 * b * b / c < -margin * max(first, last)


def _on_cubic(near: StepPoint, far: StepPoint, s: float, a: Correction) -> NDArray:
    """Return a point of the cubic through two points of a step.

    If the far tangent turns away, it is a point of the near tangent.
    """
    h = far[0] - near[0]
    along = [float(tangent @ a.tangent) for _, _, tangent in (near, far)]
    if h <= 0.0 or min(along) < 0.5:
        ahead = near[2] / along[0] if along[0] > 0.5 else a.tangent
        return np.asarray(near[1] + (s - near[0]) * ahead * a.scale)
    t = (s - near[0]) / h
    first, last = (h * a.scale * point[2] / cosine for point, cosine in zip((near, far), along))
    rise = far[1] - near[1]
    return np.asarray(
        near[1]
        + t * (first + t * (3.0 * rise - 2.0 * first - last + t * (first + last - 2.0 * rise)))
    )


class Step(NamedTuple):
    """Accepted step along a curve.

    Parameters
    ----------
    a : Correction
        Start of the step.
    b : Correction
        End of the step.
    end : float
        Length along the tangent at a; 0 for a path that ends at its start.
    """

    a: Correction
    b: Correction
    end: float


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
        self.sense = 0.0  # last nonzero sign of the change of frequency
        self._tilt = np.random.default_rng(1).standard_normal(system.n_unknowns + 1)
        self._tilt *= 0.3 / norm2(self._tilt)

    # ---- unresolved events ----

    def over_resonance(self, a: NDArray, b: NDArray) -> bool:
        """Return whether the phase of a modal coordinate jumps at its linear resonance."""
        for omega, width, row in self.system.watched:
            if (a[-1] - omega) * (b[-1] - omega) < 0.0 and abs(b[-1] - a[-1]) > width:
                before = self.system.layout.amplitudes(a[:-1], 1) @ row
                after = self.system.layout.amplitudes(b[:-1], 1) @ row
                if (before.conjugate() * after).real < 0.5 * abs(before * after):
                    return True
        return False

    def over_pair(self, here: Correction, c: Correction) -> bool:
        """Return whether frequency or amplitude seems to have two extrema within a step.

        Without this check 3 of 240 ordinary curves lose a pair of folds; it takes half a per cent
        of the evaluations.
        """
        n, y, tangent, scale = self.system.n_mean, here.y, here.tangent, here.scale
        if is_drift(tangent, n) or is_drift(c.tangent, n):
            return False
        length = norm2((c.y - y) / scale)
        if turns_twice(length * tangent[-1], length * c.tangent[-1], (c.y[-1] - y[-1]) / scale[-1]):
            return True
        (g_before, before), (g_after, after) = (
            self.system.rows.squared_gradient(p) for p in (y, c.y)
        )
        first, last = (
            length * float(g @ (t * scale)) for g, t in ((g_before, tangent), (g_after, c.tangent))
        )
        return max(abs(first), abs(last)) > LEVEL_RISE * before and turns_twice(
            first, last, 0.5 * (after - before)
        )

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
        n, (a, b, end) = self.system.n_mean, step
        sense = 0.0 if is_drift(b.tangent, n) else float(np.sign(b.tangent[-1]))
        turned = sense * self.sense < 0.0
        self.sense = sense or self.sense
        if not self.options.locate or end == 0.0:
            return [], "regular"
        drift = is_drift(a.tangent, n)
        kinds, missed = [], "regular"
        if turned and not drift and a.tangent[-1] * b.tangent[-1] < 0.0:
            kinds.append("fold")
        elif turned:  # a drift has one frequency, so the fold is at its end
            missed = "fold"
        rises = [self._value("maximum", p.y, p.tangent, a.scale) for p in (a, b)]
        level = LEVEL_RISE * self.system.rows.squared_gradient(a.y)[1]
        if not drift and not is_drift(b.tangent, n) and rises[0] > level and rises[1] < -level:
            kinds.append("maximum")
        located = []
        for kind in kinds:
            at = self.locate(step, kind, self.options.locate_tolerance * end)
            if at is None:
                missed = kind
            else:
                located.append(replace(at, kind=kind))
        located.sort(key=lambda p: float(a.tangent @ ((p.y - a.y) / a.scale)))
        return located, missed

    def _value(self, kind: str, y: NDArray, tangent: NDArray, scale: NDArray) -> float:
        """Return the quantity that changes sign at a fold or a maximum."""
        return float(
            tangent[-1]
            if kind == "fold"
            else self.system.rows.squared_gradient(y)[0] @ (tangent * scale)
        )

    def locate(self, step: Step, kind: str, tolerance: float) -> Correction | None:
        """Locate a fold or maximum, by Newton's method on a smooth step, otherwise by bracketing.

        Parameters
        ----------
        step : Step
            Step with opposite signs, at its ends, of the quantity that vanishes at the event.
        kind : {"fold", "maximum"}
        tolerance : float
            Tolerance of the position, in scaled unknowns.

        Returns
        -------
        Correction or None
            Fold or maximum, with the slope and curvature of its condition; None if no corrector
            converges.
        """
        a, b, end = step
        values = (
            self._value(kind, a.y, a.tangent, a.scale),
            self._value(kind, b.y, b.tangent, a.scale),
        )
        chord, ahead = (b.y - a.y) / a.scale, a.tangent + b.tangent
        # difference of chord and mean tangent, relative to the difference of the tangents, below
        # which a step counts as smooth.  Of 129 folds and maxima of curves with friction, 47 of 73
        # smooth ones are below, and 9 of 56 at corners, where Newton's method fails
        even = 0.05
        bend = norm2(chord / norm2(chord) - ahead / max(norm2(ahead), even))
        if bend < even * norm2(b.tangent - a.tangent):
            part = values[0] / (values[0] - values[1])
            tangent = a.tangent + part * (b.tangent - a.tangent)
            condition, weight = (
                (Fold, 1.0) if kind == "fold" else (Peak, self.system.rows.squared_gradient(a.y)[1])
            )
            curvature = (values[1] - values[0]) / (end * weight)
            target = condition(tangent / norm2(tangent), curvature, tolerance, 0.5 * end)
            guess = _on_cubic((0.0, a.y, a.tangent), (end, b.y, b.tangent), part * end, a)
            c = self.system.solve(
                guess, target, a.scale, self.options.tolerance, self.options.max_iterations
            )
            self.iterations += c.iterations
            if c.status == OK and 0.0 <= float(a.tangent @ ((c.y - a.y) / a.scale)) <= end:
                return c
        return self._bracketed(step, values, kind, tolerance)

    def _bracketed(
        self, step: Step, values: tuple[float, float], kind: str, tolerance: float
    ) -> Correction | None:
        """Locate a fold or a maximum as the root of a function that changes sign over a step.

        A trial is the point of the curve in a plane normal to the tangent at the start of the step;
        Newton's method starts from the cubic through the adjacent points.  A plane without solution
        lies beyond a corner, and so beyond the event.
        """
        a, b, end = step
        around, last = [(0.0, values[0]), (end, values[1])], values[1]
        near, far = (0.0, a.y, a.tangent), (end, b.y, b.tangent)
        trials = root_trials(around[0], around[1], tolerance)
        event, most = None, self.options.max_iterations
        s = next(trials)
        try:
            while True:
                guess = _on_cubic(near, far, s, a)
                c = self.system.solve(
                    guess, Plane(a.tangent), a.scale, self.options.tolerance, most
                )
                self.iterations += c.iterations
                value = last
                if c.status == OK and norm2((c.y - a.y) / a.scale) <= 2.0 * s:
                    value = self._value(kind, c.y, c.tangent, a.scale)
                    beyond = value * last >= 0.0
                    across = around[not beyond]
                    weight = 1.0 if kind == "fold" else self.system.rows.squared_gradient(c.y)[1]
                    around[beyond] = s, value
                    near, far = (
                        (near, (s, c.y, c.tangent)) if beyond else ((s, c.y, c.tangent), far)
                    )
                    curvature = (value - across[1]) / (s - across[0])
                    event = replace(c, slope=value / weight, curvature=curvature / weight)
                else:  # beyond a corner: assume the curve as close to the last point as the plane
                    far, most = (s, near[1], -a.tangent), ITERATIONS_BEYOND
                s = trials.send(value)
        except StopIteration:
            return event

    # ---- corners ----

    def _direction(self, y: NDArray, scale: NDArray, border: NDArray, sign: int) -> NDArray | None:
        """Return the tangent from the Jacobian at y, also off the curve; None if singular."""
        any_residual = 1e300  # every point counts as converged
        c = self.system.solve(y, Plane(border), scale, any_residual, 1)
        if c.status != OK or not c.orientation:
            return None
        return c.orientation * sign * c.tangent if sign else c.tangent

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
        y, tangent, scale = here.y, here.tangent, here.scale
        border = tangent + self._tilt
        near, far = 0.0, step
        first, beyond = tangent, self._direction(y + far * tangent * scale, scale, border, sign)
        if beyond is None:
            return None
        total = norm2(beyond - tangent)
        if total < 0.2:
            return None
        bisections = 7
        for _ in range(bisections):
            middle = 0.5 * (near + far)
            t = self._direction(y + middle * tangent * scale, scale, border, sign)
            if t is None:
                return None
            if norm2(t - tangent) < 0.5 * total:
                near, first = middle, t
            else:
                far, beyond = middle, t
            if norm2(beyond - first) < 0.4 * total:
                return None  # curvature
        for sense in (1.0,) if sign else (1.0, -1.0):
            direction = sense * beyond
            for part in (0.5, 0.1, 0.01):
                guess = y + (far * tangent + part * step * direction) * scale
                c = self._solution_near(guess, direction, scale, 0.5 * part * step + far - near)
                if c is not None and self._continues(here, c, sign):
                    return c, part * step
        return None

    def _solution_near(
        self, guess: NDArray, direction: NDArray, scale: NDArray, reach: float
    ) -> Correction | None:
        """Return a solution near a guess, in the plane normal to a direction, or None.

        Its distance from the guess is at most ``reach``, and its tangent is close to the direction.
        """
        if not guess[-1] > 0.0:
            return None
        c = self.system.solve(
            guess,
            Plane(direction),
            scale,
            self.options.tolerance,
            self.options.max_iterations,
            reach=2.0 * reach,
        )
        self.iterations += c.iterations
        near = c.status == OK and norm2((c.y - guess) / scale) <= reach
        return c if near and float(c.tangent @ direction) >= np.cos(self.options.max_turn) else None

    def _continues(self, here: Correction, c: Correction, sign: int) -> bool:
        """Return whether a solution beyond a corner continues the path in its direction."""
        if sign and c.orientation == -sign:
            return False
        moved = (c.y - here.y) / here.scale
        if not sign and float(moved @ here.tangent) < -0.99 * norm2(moved):
            return False
        return not self.over_resonance(here.y, c.y)
