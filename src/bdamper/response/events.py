"""Where a curve does something between two of its points: folds, maxima, corners, resonances.

Where the frequency component of the tangent changes sign there is a fold, where the derivative of the response amplitude
does, a maximum.  Newton's method on the equations and on this condition finds it from the cubic through both ends of the
step; where that fails, as at corners, the root along the step is bracketed (:func:`bdamper.util.rootfinding.root_trials`)
with a corrector for each trial.  Two events in one step leave the signs as they were: there the cubic turns within.

The Jacobian is only piecewise continuous: where a contact starts or ceases to slip or to separate, the curve may have a
corner.  The Jacobian along a step that fails tells where: its null vector jumps there.

What a path along a curve is: its settings, its points, how it ended.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import OK, Correction, Equations, Fold, Peak, Plane, norm2
from bdamper.util import validation
from bdamper.util.formatting import short_repr
from bdamper.util.rootfinding import root_trials

# ---- What a path along a curve is ----


AtLeastTwo = Annotated[int, partial(validation.integer, least=2)]
SIDE_POINTS = 1000
"""Points of a path that is no part of a curve: outside of its interval, or along which an excitation is raised or a support
fades.  Outside, with 150, one more of 100 narrow bands (``benchmarks/bench_narrow.py``) loses its highest branch."""


@validation.check_arguments
@dataclass(frozen=True)
class ContinuationOptions:
    """Settings of the continuation.

    Parameters
    ----------
    tolerance : float
        On the largest residual, relative to excitation and static load.
    step, min_step, max_step : float
        First, smallest and largest step in scaled unknowns (0.1: a tenth of the present vibration).
    max_turn : float, rad
        Largest angle between successive tangents of an accepted step.
    max_points : int
        Of one path.
    patience : int
        Points without getting any further in frequency, to either side of where it set off, after which a path is left as a
        tangle of folds.  Without this limit the widest gap grows on three of six curves with tangles (from 5.3 to 23, 1.0
        to 3.5 and 11.7 to 12.0 Hz) and shrinks on one (from 7.6 to 6.5 Hz); none of 284 ordinary curves changes.
    budget : int or None
        Evaluations of the equations after which a curve ends with what it has; None sets it from the sizes of the problem
        (``bdamper.response.branches.evaluation_budget``).
    max_iterations : int
        Newton iterations in a step.
    locate : bool
        Refine folds and amplitude maxima.
    locate_tolerance : float
        On folds and maxima, relative to the step in which they lie.
    corner_step : float
        Longest failed step that is searched for a corner of the curve; longer ones are shortened first.
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
        validation.check_value(sorted(steps) == list(steps), "steps", "0 < min_step <= step <= max_step", steps)


@short_repr
@dataclass(frozen=True)
class Path:
    """Points of a path and how it ended.

    Parameters
    ----------
    points : tuple of Correction
    status : str
        "complete", "turned back" (to the bound away from which it set off), "closed" (on itself), "many folds" (too many
        without progress), "drifted off" (a free body that nothing stops), "stalled", "too many points", "out of budget" or
        "interrupted".
    reason : str
    iterations, failed_steps : int
    tangle : (low, high), rad/s, or None
        Of the folds in which the path was left.
    """

    points: tuple[Correction, ...]
    status: str
    reason: str
    iterations: int
    failed_steps: int
    tangle: tuple[float, float] | None = None


def is_drift(tangent: NDArray, n_mean: int) -> bool:
    """Whether a path moves the mean position alone: same vibration, same frequency."""
    return norm2(tangent[n_mean:]) < 1e-6


# ---- Where a curve does something between two of its points ----


Place = tuple[float, NDArray, NDArray]
"""Of a step: distance along the tangent where it sets off, point and tangent there."""
MISSED = 3
"""Newton steps to a point of the curve once a plane has missed it.  With these, and guesses on the tangent of the last
point before it, a fold or maximum at a corner takes 70 to 92 evaluations in place of 123 to 187 (shipped disk, 500 N, five
harmonics)."""
LEVEL_RISE = 1e-9
"""Rise of the squared amplitude over a unit of the way, relative to itself, that counts as rounding."""


def turns_twice(first: float, last: float, rise: float, margin: float = 0.02) -> bool:
    """Whether the Hermite cubic on (0, 1) with end slopes of equal sign and this rise has an interior extremum.

    Its slope is ``first + b t + c t**2``, which must reverse by the fraction ``margin`` of the larger end slope.
    """
    if first * last <= 0.0:
        return False
    if first < 0.0:
        first, last, rise = -first, -last, -rise
    b, c = 6.0 * rise - 4.0 * first - 2.0 * last, 3.0 * (first + last) - 6.0 * rise
    if c <= 0.0 or not -2.0 * c < b < 0.0:
        return False
    return first - 0.25 * b * b / c < -margin * max(first, last)


def _on_cubic(near: Place, far: Place, s: float, a: Correction) -> NDArray:
    """Point of the cubic through two places of a step, with their tangents; on that of the near one where the far one turns
    away.
    """
    h = far[0] - near[0]
    along = [float(tangent @ a.tangent) for _, _, tangent in (near, far)]
    if h <= 0.0 or min(along) < 0.5:
        ahead = near[2] / along[0] if along[0] > 0.5 else a.tangent
        return np.asarray(near[1] + (s - near[0]) * ahead * a.scale)
    t = (s - near[0]) / h
    first, last = (h * a.scale * place[2] / cosine for place, cosine in zip((near, far), along))
    rise = far[1] - near[1]
    return np.asarray(near[1] + t * (first + t * (3.0 * rise - 2.0 * first - last + t * (first + last - 2.0 * rise))))


class Step(NamedTuple):
    """An accepted step along a curve.

    Parameters
    ----------
    a : Correction
        Where it sets off.
    b : Correction
        Where it ends.
    end : float
        How far it reaches along the tangent at a; 0 where a path ends at once, on the limit it set off from.
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
        self.sense = 0.0
        """Of travel in frequency, the last that was not zero."""
        self._tilt = np.random.default_rng(1).standard_normal(system.n_unknowns + 1)
        self._tilt *= 0.3 / norm2(self._tilt)

    # ---- what a step may hide ----

    def over_resonance(self, a: NDArray, b: NDArray) -> bool:
        """Whether a linear resonance in a step is not resolved: the phase of its modal coordinate jumps."""
        for omega, width, row in self.system.watched:
            if (a[-1] - omega) * (b[-1] - omega) < 0.0 and abs(b[-1] - a[-1]) > width:
                before = self.system.layout.amplitudes(a[:-1], 1) @ row
                after = self.system.layout.amplitudes(b[:-1], 1) @ row
                if (before.conjugate() * after).real < 0.5 * abs(before * after):
                    return True
        return False

    def over_pair(self, here: Correction, c: Correction) -> bool:
        """Whether frequency or amplitude seems to turn twice within a step from a point, which its ends do not show.

        Without this question 3 of 240 ordinary curves lose a pair of folds; it costs half a per cent of the evaluations.
        """
        n, y, tangent, scale = self.system.n_mean, here.y, here.tangent, here.scale
        if is_drift(tangent, n) or is_drift(c.tangent, n):
            return False
        length = norm2((c.y - y) / scale)
        if turns_twice(length * tangent[-1], length * c.tangent[-1], (c.y[-1] - y[-1]) / scale[-1]):
            return True
        (g_before, before), (g_after, after) = (self.system.rows.squared_gradient(p) for p in (y, c.y))
        first, last = (length * float(g @ (t * scale)) for g, t in ((g_before, tangent), (g_after, c.tangent)))
        return max(abs(first), abs(last)) > LEVEL_RISE * before and turns_twice(first, last, 0.5 * (after - before))

    # ---- folds and maxima ----

    def between(self, step: Step) -> tuple[list[Correction], str]:
        """Events of a step, located.

        Returns
        -------
        list of Correction, in the order of the path, and the kind of its end: that of an event which could not be located
        """
        n, (a, b, end) = self.system.n_mean, step
        sense = 0.0 if is_drift(b.tangent, n) else float(np.sign(b.tangent[-1]))
        turned = sense * self.sense < 0.0
        self.sense = sense or self.sense
        if not self.options.locate or end == 0.0:
            return [], "regular"
        drift = is_drift(a.tangent, n)
        found, missed = [], "regular"
        if turned and not drift and a.tangent[-1] * b.tangent[-1] < 0.0:
            found.append("fold")
        elif turned:  # a drift is one point in frequency, and so is the fold at its end
            missed = "fold"
        rises = [self._value("maximum", p.y, p.tangent, a.scale) for p in (a, b)]
        level = LEVEL_RISE * self.system.rows.squared_gradient(a.y)[1]
        if not drift and not is_drift(b.tangent, n) and rises[0] > level and rises[1] < -level:
            found.append("maximum")
        located = []
        for kind in found:
            at = self.locate(step, kind, self.options.locate_tolerance * end)
            if at is None:
                missed = kind
            else:
                located.append(replace(at, kind=kind))
        located.sort(key=lambda p: float(a.tangent @ ((p.y - a.y) / a.scale)))
        return located, missed

    def _value(self, kind: str, y: NDArray, tangent: NDArray, scale: NDArray) -> float:
        """What changes its sign at a fold or a maximum."""
        return float(tangent[-1] if kind == "fold" else self.system.rows.squared_gradient(y)[0] @ (tangent * scale))

    def locate(self, step: Step, kind: str, tolerance: float) -> Correction | None:
        """A fold or maximum within a step: by Newton's method where the step bends evenly, otherwise bracketed.

        Parameters
        ----------
        step : Step
            What vanishes at the event has another sign at its end than where it sets off.
        kind : {"fold", "maximum"}
        tolerance : float
            On the place, in scaled unknowns.

        Returns
        -------
        Correction or None
            With slope and curvature as those of the condition; None where no corrector converges.
        """
        a, b, end = step
        values = self._value(kind, a.y, a.tangent, a.scale), self._value(kind, b.y, b.tangent, a.scale)
        chord, ahead = (b.y - a.y) / a.scale, a.tangent + b.tangent
        # difference of the chord of a step from the mean of its tangents, relative to theirs, below which it bends
        # evenly. Of 129 folds and maxima of curves with friction, 47 of 73 smooth ones are below and 9 of 56 at
        # corners, where Newton's method is in vain
        even = 0.05
        bend = norm2(chord / norm2(chord) - ahead / max(norm2(ahead), even))
        if bend < even * norm2(b.tangent - a.tangent):
            part = values[0] / (values[0] - values[1])
            tangent = a.tangent + part * (b.tangent - a.tangent)
            condition, weight = (Fold, 1.0) if kind == "fold" else (Peak, self.system.rows.squared_gradient(a.y)[1])
            curvature = (values[1] - values[0]) / (end * weight)
            asked = condition(tangent / norm2(tangent), curvature, tolerance, 0.5 * end)
            guess = _on_cubic((0.0, a.y, a.tangent), (end, b.y, b.tangent), part * end, a)
            c = self.system.solve(guess, asked, a.scale, self.options.tolerance, self.options.max_iterations)
            self.iterations += c.iterations
            if c.status == OK and 0.0 <= float(a.tangent @ ((c.y - a.y) / a.scale)) <= end:
                return c
        return self._bracketed(step, values, kind, tolerance)

    def _bracketed(self, step: Step, values: tuple[float, float], kind: str, tolerance: float) -> Correction | None:
        """The same at a distance along the tangent at a, from the values at both ends.

        Points lie in planes normal to the tangent; where such a plane misses the curve it lies beyond a corner, and beyond
        the event.  A corrector begins at the cubic through the points around, with their tangents.
        """
        a, b, end = step
        around, last = [(0.0, values[0]), (end, values[1])], values[1]
        near, far = (0.0, a.y, a.tangent), (end, b.y, b.tangent)
        trials = root_trials(around[0], around[1], tolerance)
        found, most = None, self.options.max_iterations
        s = next(trials)
        try:
            while True:
                guess = _on_cubic(near, far, s, a)
                c = self.system.solve(guess, Plane(a.tangent), a.scale, self.options.tolerance, most)
                self.iterations += c.iterations
                value = last
                if c.status == OK and norm2((c.y - a.y) / a.scale) <= 2.0 * s:
                    value = self._value(kind, c.y, c.tangent, a.scale)
                    beyond = value * last >= 0.0
                    across = around[not beyond]
                    weight = 1.0 if kind == "fold" else self.system.rows.squared_gradient(c.y)[1]
                    around[beyond] = s, value
                    near, far = (near, (s, c.y, c.tangent)) if beyond else ((s, c.y, c.tangent), far)
                    curvature = (value - across[1]) / (s - across[0])
                    found = replace(c, slope=value / weight, curvature=curvature / weight)
                else:  # beyond a corner: the curve lies as near the last point as the plane does
                    far, most = (s, near[1], -a.tangent), MISSED
                s = trials.send(value)
        except StopIteration:
            return found

    # ---- corners ----

    def _direction(self, y: NDArray, scale: NDArray, border: NDArray, sign: int) -> NDArray | None:
        """Direction of travel that the Jacobian at y gives, on the curve or off it."""
        any_residual = 1e300  # tolerance that every point meets
        c = self.system.solve(y, Plane(border), scale, any_residual, 1)
        if c.status != OK or not c.orientation:
            return None
        return c.orientation * sign * c.tangent if sign else c.tangent

    def around_corner(self, here: Correction, step: float, sign: int) -> tuple[Correction, float] | None:
        """The first point beyond a corner within a step from a point, and the length of the part beyond the corner.

        Bisection between where the null vector of the Jacobian is the tangent and where it is another.  A curve without a
        corner shows no such jump, and is left alone as soon as the vectors on both sides are nearer to each other than 0.4
        of their first distance: on an optimal curve that is half of the trials in smooth bends, and one of 109 corners is
        found in the next step only.  Without this search 8 of 240 ordinary curves are incomplete, 8 more
        are found in pieces or without some of their folds, and all 240 together take 3.2 times the evaluations.

        Parameters
        ----------
        here : Correction
        step : float
        sign : int
            Of det [J; tangent] along the path, 0 where it is not known.
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
        bisections = 7  # of a step that is searched for a corner
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
                if c is not None and self._goes_on(here, c, sign):
                    return c, part * step
        return None

    def _solution_near(self, guess: NDArray, direction: NDArray, scale: NDArray, reach: float) -> Correction | None:
        """A solution within reach of a guess, in the plane normal to a direction, from which the curve goes on that way."""
        if not guess[-1] > 0.0:
            return None
        c = self.system.solve(
            guess, Plane(direction), scale, self.options.tolerance, self.options.max_iterations, reach=2.0 * reach
        )
        self.iterations += c.iterations
        near = c.status == OK and norm2((c.y - guess) / scale) <= reach
        return c if near and float(c.tangent @ direction) >= np.cos(self.options.max_turn) else None

    def _goes_on(self, here: Correction, c: Correction, sign: int) -> bool:
        """Whether a path goes on from a point to a solution beyond a corner, and not back along itself."""
        if sign and c.orientation == -sign:
            return False
        moved = (c.y - here.y) / here.scale
        if not sign and float(moved @ here.tangent) < -0.99 * norm2(moved):
            return False
        return not self.over_resonance(here.y, c.y)
