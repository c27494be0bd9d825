"""Following a response curve by pseudo-arclength continuation.

A point is ``y = (u, omega)``; steps are measured in scaled unknowns ``z = y/scale``, where each group (mean, vibration,
frequency) has its own unit, renewed at every step: a step of 0.1 changes the vibration by about a tenth of itself.  The
predictor is the tangent, the corrector Newton in the plane through the prediction normal to the tangent.

The Jacobian is only piecewise continuous: where a contact starts or ceases to slip or to separate, the curve may have a
corner.  A step that fails is halved; once it is too short for the failure to be a matter of curvature, the curve must
have turned: the tangent is then taken from beyond the corner, and both senses are tried.

A step is accepted only if Newton converged *and* the solution is where it was predicted, within half the length of the
step, and the tangent has not turned by more than a set angle.  That keeps the path from jumping over a sharp resonance
(the response turns by pi there) or to another branch.

Where the frequency component of the tangent changes sign there is a fold, where the derivative of the response amplitude
does, an extremum; both are located by a bracketing secant on the length of the step, with a Newton corrector for each
trial.  Two of them in one step leave the signs as they were: there the cubic through both ends of the step, with their
slopes, turns within, and the step is halved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from bdamper.balance.system import OK, STATUS_TEXT, Correction, HarmonicSystem, norm2
from bdamper.util import validate
from bdamper.util.errors import SettingError
from bdamper.util.repr import brief


@dataclass(frozen=True)
class ContinuationOptions:
    """Settings of the path following.

    Parameters
    ----------
    tolerance : float
        On the largest residual, relative to excitation and static load.
    step, min_step, max_step : float
        First, smallest and largest step in scaled unknowns (0.1: a tenth of the present vibration).
    max_turn : float, rad
        Largest angle between successive tangents of an accepted step.
    max_points : int
    patience : int
        Points without getting any further in frequency, to either side of where it set off, after which a path is left as a
        tangle of folds.
    searches : int
        Frequencies in gaps of a curve at which solutions are looked for.  A narrow gap takes up to three on each of three
        visits, and harmonics are let in on the second and third; all gaps have their first before any has its second.
    max_iterations : int
        Newton iterations in a step.
    locate : bool
        Refine folds and amplitude maxima.
    locate_folds : bool
        False: the point beyond a fold is marked as the fold.
    locate_tolerance : float
        On folds and maxima, relative to the step in which they lie.
    corner_step : float
        Longest failed step that is searched for a corner of the curve; longer ones are shortened first.
    to_planes : bool
        Where the mean position walks while vibration and frequency stay, go straight to where an open point touches:
        fewer points on the walk.
    """

    tolerance: float = 1e-9
    step: float = 0.05
    min_step: float = 1e-7
    max_step: float = 0.15
    max_turn: float = 0.45
    max_points: int = 5000
    patience: int = 400
    searches: int = 30
    max_iterations: int = 8
    locate: bool = True
    locate_folds: bool = True
    locate_tolerance: float = 1e-8
    corner_step: float = 0.3
    to_planes: bool = False

    def __post_init__(self) -> None:
        validate.fields(self, validate.number, "tolerance", above=0.0, below=1e-2)
        validate.fields(self, validate.number, "step", "min_step", "max_step", "corner_step", above=0.0)
        validate.fields(self, validate.number, "max_turn", above=0.0, most=np.pi)
        validate.fields(self, validate.number, "locate_tolerance", above=0.0, below=1.0)
        validate.fields(self, validate.whole, "max_points", "patience", "max_iterations", least=2)
        validate.fields(self, validate.whole, "searches")
        validate.fields(self, validate.flag, "locate", "locate_folds", "to_planes")
        if not 0.0 < self.min_step <= self.step <= self.max_step:
            raise SettingError(
                f"steps: expected 0 < min_step <= step <= max_step, found {self.min_step}, {self.step}, {self.max_step}"
            )


@brief
@dataclass(frozen=True)
class PathPoint:
    """One solution on the path.

    Parameters
    ----------
    y, tangent : (n_unknowns + 1,) float
        Point and direction of travel, the latter of unit length in the units of the step.
    scale : (n_unknowns + 1,) float
    shares : (3,) float
        Stick, slip and open shares of the cycle, mean over friction points.
    residual : float
    iterations : int
    rank_deficiency : int
    kind : str
        "regular", "fold", "maximum", "end", or "walk": the mean position moves while vibration and frequency stay.
    """

    y: NDArray
    tangent: NDArray
    scale: NDArray
    shares: NDArray
    residual: float
    iterations: int
    rank_deficiency: int
    kind: str = "regular"


@brief
@dataclass(frozen=True)
class Path:
    """Points of a path and how it ended.

    Parameters
    ----------
    points : tuple of PathPoint
    status : str
        "complete", "turned back" (to the bound away from which it set off), "closed" (on itself), "tangle" (too many folds
        without progress), "walked off" (a free body that nothing stops), "stalled", "too many points" or "interrupted".
    reason : str
    iterations, failed_steps : int
    tangle : (low, high), rad/s, or None
        Of the folds in which the path was left.
    """

    points: tuple[PathPoint, ...]
    status: str
    reason: str
    iterations: int
    failed_steps: int
    tangle: tuple[float, float] | None = None


WALKED_OFF = (
    "no periodic solution beyond: the mean position of a free body moves without bound, a mean force drives it and no "
    "constraint plane takes load"
)


def turns_twice(first: float, last: float, rise: float, margin: float = 0.02) -> bool:
    """Whether the cubic on (0, 1) with these slopes at its ends, which agree in sign, and this rise turns within.

    Its slope is ``first + b t + c t**2``; by how much of the larger slope it must run the other way is ``margin``.
    """
    if first * last <= 0.0:
        return False
    if first < 0.0:
        first, last, rise = -first, -last, -rise
    b, c = 6.0 * rise - 4.0 * first - 2.0 * last, 3.0 * (first + last) - 6.0 * rise
    if c <= 0.0 or not -2.0 * c < b < 0.0:
        return False
    return first - 0.25 * b * b / c < -margin * max(first, last)


class _Follower:
    """State of one run."""

    def __init__(
        self,
        system: HarmonicSystem,
        limits: tuple[float, float],
        options: ContinuationOptions,
        on_point: Callable[[PathPoint], None] | None,
    ) -> None:
        self.system = system
        self.low, self.high = limits
        self.options = options
        self.on_point = on_point
        self.points: list[PathPoint] = []
        self.iterations = 0
        self.failed = 0
        self.largest = 0.0
        self.sign = 0  # of det [J; tangent] along the path, 0 where it is not known
        self.sense = 0.0  # of travel in frequency, the last that was not zero
        self.tangle: tuple[float, float] | None = None
        self.tilt = np.random.default_rng(1).standard_normal(system.n_unknowns + 1)
        self.tilt *= 0.3 / norm2(self.tilt)

    # ---- units and records ----

    def scale_at(self, y: NDArray) -> NDArray:
        n = self.system.n_mean
        vibration = norm2(y[n:-1])
        self.largest = max(self.largest, vibration)
        vibration = max(vibration, 1e-9 * self.largest, 1e-300)
        scale = np.empty(len(y))
        scale[:n] = max(norm2(y[:n]), vibration)
        scale[n:-1] = vibration
        scale[-1] = 0.5 * (self.high - self.low)
        return scale

    def walks(self, tangent: NDArray) -> bool:
        """Whether the path moves the mean position alone: same vibration, same frequency."""
        return norm2(tangent[self.system.n_mean :]) < 1e-6

    def way_to_touch(self, y: NDArray, direction: NDArray) -> float:
        """Step along a direction of the mean at the end of which a point that is open all the cycle touches."""
        direction = direction / norm2(direction / self.scale_at(y))
        try:
            closing, rate = self.system.closing(y[:-1], direction[: self.system.n_mean])
        except FloatingPointError:
            return np.inf
        ahead = (closing < 0.0) & (rate > 1e-9 * max(float(np.abs(rate).max(initial=0.0)), 1e-300))
        return float((-closing[ahead] / rate[ahead]).min(initial=np.inf))

    def record(self, c: Correction, scale: NDArray, kind: str = "regular") -> PathPoint:
        if kind == "regular" and self.walks(c.tangent):
            kind = "walk"
        point = PathPoint(
            c.y, c.tangent, scale, np.array(c.shares), c.residual, c.iterations, c.rank_deficiency, kind
        )
        self.points.append(point)
        if self.on_point is not None:
            self.on_point(point)
        return point

    # ---- steps ----

    def correct(self, y: NDArray, normal: NDArray, scale: NDArray) -> Correction:
        c = self.system.correct(y, normal, scale, self.options.tolerance, self.options.max_iterations)
        self.iterations += c.iterations
        return c

    def try_step(self, y: NDArray, tangent: NDArray, scale: NDArray, step: float) -> tuple[Correction, str]:
        """One predictor and corrector; the text says why it is refused, if it is."""
        predicted = y + step * tangent * scale
        if not predicted[-1] > 0.0:
            return Correction(1, predicted, tangent, 0, np.inf, 0.0, 0), "frequency not positive"
        c = self.correct(predicted, tangent, scale)
        if c.status != OK:
            return c, STATUS_TEXT[c.status]
        if norm2((c.y - predicted) / scale) > 0.5 * step:
            return c, "solution far from its prediction"
        # below a step of 1e-3 a large turn is a corner, not curvature
        if step > 1e-3 and float(c.tangent @ tangent) < np.cos(self.options.max_turn):
            return c, "tangent turned too much"
        # on a part of the curve that runs the other way, unless this is a bifurcation passed straight on
        if step > 1e-5 and self.sign and c.orientation == -self.sign:
            return c, "orientation of the curve changed"
        if self._over_resonance(y, c.y):
            return c, "a resonance of the linear structure lies within the step"
        if self.options.locate and step > 0.02 and self._over_pair(y, tangent, scale, c):
            return c, "two folds or extrema lie within the step"
        return c, ""

    def _over_pair(self, y: NDArray, tangent: NDArray, scale: NDArray, c: Correction) -> bool:
        """Whether frequency or amplitude seems to turn twice within a step, which its ends do not show.

        The cubic through both ends, with their slopes, turns within.
        """
        if self.walks(tangent) or self.walks(c.tangent):
            return False
        length = norm2((c.y - y) / scale)
        if turns_twice(length * tangent[-1], length * c.tangent[-1], (c.y[-1] - y[-1]) / scale[-1]):
            return True
        before, after = (abs(self.system.amplitudes(p[:-1], 1) @ self.system.response_rows[1]) ** 2 for p in (y, c.y))
        first, last = (length * self.amplitude_slope(p, t, scale) for p, t in ((y, tangent), (c.y, c.tangent)))
        return turns_twice(first, last, 0.5 * (after - before))

    def _over_resonance(self, a: NDArray, b: NDArray) -> bool:
        """Whether a linear resonance in a step is not resolved: the phase of its modal coordinate jumps."""
        for omega, width, row in self.system.watched:
            if (a[-1] - omega) * (b[-1] - omega) < 0.0 and abs(b[-1] - a[-1]) > width:
                before = self.system.amplitudes(a[:-1], 1) @ row
                after = self.system.amplitudes(b[:-1], 1) @ row
                if (before.conjugate() * after).real < 0.5 * abs(before * after):
                    return True
        return False

    def probe(self, y: NDArray, scale: NDArray, border: NDArray) -> NDArray | None:
        """Direction of travel that the Jacobian at y gives, on the curve or off it."""
        n = len(y) - 1
        try:
            J, r_omega = self.system.derivatives(y)
        except FloatingPointError:
            return None
        A = np.empty((n + 1, n + 1))
        A[:n, :n] = J * scale[:n]
        A[:n, n] = r_omega * scale[n]
        A[:n] /= np.maximum(np.abs(A[:n]).max(axis=1, keepdims=True), 1e-300)
        A[n] = border
        factors, pivots, _ = dgetrf(A)
        diagonal = np.diag(factors)
        if not (np.abs(diagonal) > 1e-15).all():
            return None
        right = np.zeros(n + 1)
        right[n] = 1.0
        x, _ = dgetrs(factors, pivots, right)
        if not np.isfinite(x).all():
            return None
        sign = int(np.prod(np.sign(diagonal)) * (-1.0) ** np.count_nonzero(pivots != np.arange(n + 1)))
        x *= (sign * self.sign if self.sign else 1.0) / norm2(x)
        return np.asarray(x)

    def around_corner(
        self, y: NDArray, tangent: NDArray, scale: NDArray, step: float, desperate: bool = False
    ) -> tuple[Correction, float] | None:
        """The first point beyond a corner within a step, and the length of the part beyond the corner.

        The Jacobian along the prediction tells where the corner is: bisection between where its null vector is the
        tangent and where it is another.  A curve without a corner shows no such jump, and is left alone.
        """
        border = tangent + self.tilt
        near, far = 0.0, step
        first, beyond = tangent, self.probe(y + far * tangent * scale, scale, border)
        if beyond is None:
            return None
        total = norm2(beyond - tangent)
        if total < 0.2 and not desperate:
            return None
        for _ in range(7):
            middle = 0.5 * (near + far)
            t = self.probe(y + middle * tangent * scale, scale, border)
            if t is None:
                return None
            if norm2(t - tangent) < 0.5 * total:
                near, first = middle, t
            else:
                far, beyond = middle, t
        if norm2(beyond - first) < 0.4 * total and not desperate:
            return None  # curvature
        signs = (1.0,) if self.sign else (1.0, -1.0)
        for sense in signs:
            direction = sense * beyond
            for part in (0.5, 0.1, 0.01):
                c = self._beyond_corner(y, tangent, scale, far, direction, part * step, far - near)
                if c is not None:
                    return c, part * step
        return None

    def _beyond_corner(
        self, y: NDArray, tangent: NDArray, scale: NDArray, at: float, direction: NDArray, step: float, slack: float
    ) -> Correction | None:
        predicted = y + (at * tangent + step * direction) * scale
        if not predicted[-1] > 0.0:
            return None
        c = self.correct(predicted, direction, scale)
        if c.status != OK or norm2((c.y - predicted) / scale) > 0.5 * step + slack:
            return None
        if float(c.tangent @ direction) < np.cos(self.options.max_turn):
            return None
        if self.sign and c.orientation == -self.sign:
            return None  # on the way back
        moved = (c.y - y) / scale
        if not self.sign and float(moved @ tangent) < -0.99 * norm2(moved):
            return None
        return None if self._over_resonance(y, c.y) else c

    # ---- events ----

    def locate(
        self, a: PathPoint, b: Correction, end: float, event: Callable[[NDArray, NDArray], float], kind: str
    ) -> PathPoint | None:
        """Point between a and b at which the event function changes sign.

        Points in planes normal to the tangent at a, up to the distance ``end``; where such a plane misses the curve it
        lies beyond a corner, and beyond the event.
        """
        low, high = 0.0, end
        f_low, f_high = event(a.y, a.tangent), event(b.y, b.tangent)
        best: Correction | None = None
        side = 0
        for _ in range(60):
            s = (low * f_high - high * f_low) / (f_high - f_low) if f_high != f_low else 0.5 * (low + high)
            if not low + 1e-3 * (high - low) < s < high - 1e-3 * (high - low):
                s = 0.5 * (low + high)
            c = self.correct(a.y + s * a.tangent * a.scale, a.tangent, a.scale)
            reached = c.status == OK and norm2((c.y - a.y) / a.scale) <= 2.0 * s
            f = event(c.y, c.tangent) if reached else f_high
            if reached:
                best = c
            if f == 0.0:
                break
            if reached and (f < 0.0) == (f_low < 0.0):
                low, f_low = s, f
                if side == 1:
                    f_high *= 0.5  # Illinois: keeps the bracket shrinking from both sides
                side = 1
            else:
                high, f_high = s, f
                if side == -1:
                    f_low *= 0.5
                side = -1
            if high - low <= self.options.locate_tolerance * end:
                break
        if best is None:
            return None
        return self.record(best, a.scale, kind)

    def amplitude_slope(self, y: NDArray, tangent: NDArray, scale: NDArray) -> float:
        """Derivative along the path of half the squared amplitude of the first response harmonic."""
        x = self.system.amplitudes(y[:-1], 1) @ self.system.response_rows[1]
        dx = self.system.amplitudes((tangent * scale)[:-1], 1) @ self.system.response_rows[1]
        return float((x.conjugate() * dx).real)

    def events_between(self, a: PathPoint, b: Correction, end: float) -> str:
        """Records the events of a step; one that could not be located is the returned kind of point b."""
        sense = 0.0 if self.walks(b.tangent) else float(np.sign(b.tangent[-1]))
        turned = sense * self.sense < 0.0
        self.sense = sense or self.sense
        if not self.options.locate:
            return "regular"
        found: list[tuple[Callable[[NDArray, NDArray], float], str]] = []
        missed = "regular"
        if turned and self.walks(a.tangent):
            missed = "fold"  # at the end of a walk, which is a point in frequency
        elif turned and self.options.locate_folds:
            found.append((lambda y, t: float(t[-1]), "fold"))
        elif turned:
            missed = "fold"

        def slope(y: NDArray, t: NDArray) -> float:
            return self.amplitude_slope(y, t, a.scale)

        walking = self.walks(a.tangent) or self.walks(b.tangent)
        if not walking and slope(a.y, a.tangent) > 0.0 > slope(b.y, b.tangent):
            found.append((slope, "maximum"))
        located = []
        for event, kind in found:
            point = self.locate(a, b, end, event, kind)
            if point is None:
                missed = kind
            else:
                located.append(self.points.pop())
        # both in one step: keep the order along the path
        located.sort(key=lambda p: float(a.tangent @ ((p.y - a.y) / a.scale)))
        self.points.extend(located)
        return missed

    def finish_at(self, last: PathPoint, beyond: NDArray, omega: float) -> bool:
        """Records the end of the path where a step leaves the interval, and the events on the way there."""
        guess = last.y + (omega - last.y[-1]) / (beyond[-1] - last.y[-1]) * (beyond - last.y)
        scale = last.scale
        c = self.system.correct_at(guess[:-1], omega, scale, self.options.tolerance, 2 * self.options.max_iterations)
        self.iterations += c.iterations
        if c.status != OK or norm2((c.y - guess) / scale) >= 1.0:
            return False
        chord = (c.y - last.y) / scale
        c = replace(c, tangent=np.copysign(1.0, c.tangent @ chord) * c.tangent)  # along the path, not along frequency
        self.events_between(last, c, norm2(chord))
        self.record(c, scale, "end")
        return True

    # ---- the run ----

    def advance(
        self, y: NDArray, tangent: NDArray, scale: NDArray, step: float
    ) -> tuple[Correction | None, float, float, str]:
        """One accepted step: the new point, its length, how far it reaches along the tangent; or why there is none."""
        refused = "step too short"
        while step >= self.options.min_step:
            new, refused = self.try_step(y, tangent, scale, step)
            if not refused:
                return new, step, step, ""
            self.failed += 1
            if step <= self.options.corner_step:
                corner = self.around_corner(y, tangent, scale, step)
                if corner is not None:
                    return corner[0], corner[1], step, ""
            step *= 0.5 if new.status == OK else 0.25
        for overshoot in (1e-6, 1e-5, 1e-4, 1e-3):
            corner = self.around_corner(y, tangent, scale, overshoot, desperate=True)
            if corner is not None:
                return corner[0], corner[1], overshoot, ""
        return None, step, step, refused

    def _far(self, y: NDArray, start: NDArray, ratio: float) -> bool:
        """Whether the mean position is out of all proportion to the vibration and to where it began."""
        n = self.system.n_mean
        return norm2(y[:n]) > ratio * max(self.largest, norm2(start[:n]))

    def _closes(self, y: NDArray, new: Correction) -> bool:
        """Whether a step passes through the first point of the path in the sense in which the path set off."""
        first = self.points[0]
        chord = (new.y - y) / first.scale
        offset = (first.y - y) / first.scale
        length = norm2(chord)
        along = float(offset @ chord) / length
        if not 0.0 <= along <= length or float(chord @ first.tangent) < 0.8 * length:
            return False
        return norm2(offset - along * chord / length) < 0.05 * length

    def run(self, start: NDArray, up: bool) -> tuple[str, str]:
        options = self.options
        scale = self.scale_at(start)
        c = self.system.correct_at(start[:-1], start[-1], scale, options.tolerance, 4 * options.max_iterations)
        self.iterations += c.iterations
        if c.status != OK:
            return "stalled", f"no solution at the start: {STATUS_TEXT[c.status]}"
        tangent = c.tangent if up else -c.tangent
        self.sign = c.orientation if up else -c.orientation
        self.sense = 1.0 if up else -1.0
        point = self.record(replace(c, tangent=tangent), scale, "end")
        step = options.step
        lowest = highest = float(start[-1])
        front_at = 1
        while len(self.points) < options.max_points:
            y = point.y
            if max(lowest - y[-1], y[-1] - highest) > 1e-4 * (self.high - self.low):
                lowest, highest, front_at = min(lowest, y[-1]), max(highest, y[-1]), len(self.points)
            elif len(self.points) - front_at > options.patience:
                omega = [float(p.y[-1]) for p in self.points[front_at:]]
                self.tangle = min(omega), max(omega)
                low, high = (w / (2 * np.pi) for w in self.tangle)
                return "tangle", f"{options.patience} points of folds between {low:.6g} and {high:.6g} Hz without progress"
            scale = self.scale_at(y)
            tangent = point.tangent * point.scale / scale
            tangent /= norm2(tangent)
            here = PathPoint(y, tangent, scale, point.shares, point.residual, point.iterations, point.rank_deficiency)
            failed = self.failed
            new, step, reach, refused = self.advance(y, tangent, scale, step)
            if new is None:
                if self.walks(tangent) and self._far(y, start, 1e3):
                    return "walked off", WALKED_OFF
                return "stalled", f"at {y[-1] / (2 * np.pi):.6g} Hz: {refused} at the smallest step"
            omega = new.y[-1]
            if not self.low <= omega <= self.high:
                bound = self.high if omega > self.high else self.low
                if self.finish_at(here, new.y, bound):
                    if (bound == self.high) == up:
                        return "complete", f"reached {bound / (2 * np.pi):.6g} Hz"
                    started = ", where it started" if start[-1] == bound else ""
                    return "turned back", f"came back to {bound / (2 * np.pi):.6g} Hz{started}"
                step *= 0.5
                self.failed += 1
                if step < options.min_step:
                    return "stalled", f"no solution at {bound / (2 * np.pi):.6g} Hz"
                continue
            if new.orientation:
                self.sign = new.orientation
            if len(self.points) > 10 and self._closes(y, new):
                return "closed", f"the branch closes on itself at {omega / (2 * np.pi):.6g} Hz"
            kind = self.events_between(here, new, reach)
            point = self.record(new, scale, kind)
            turn = float(np.arccos(np.clip(new.tangent @ tangent, -1.0, 1.0)))
            if self.system.lets_go and self._far(new.y, start, 1e2):
                return "walked off", WALKED_OFF
            if self.walks(new.tangent) and self.walks(tangent):
                if self._far(new.y, start, 1e6):
                    return "walked off", WALKED_OFF
                # straight and at one frequency: nothing to miss before the body meets a plane
                step = min(step if self.options.to_planes and self.failed > failed else 4.0 * step, 2.0)
                if self.options.to_planes:
                    way = self.way_to_touch(new.y, new.tangent * scale)
                    if way < 2.0 * step:
                        step = way - 0.02 if way > 0.04 else way + 0.02
                continue
            growth = min(2.0, 0.6 * options.max_turn / max(turn, 1e-9), 2.0 * (3.0 / max(new.iterations, 1)) ** 1.5)
            step = min(options.max_step, step * max(0.5, growth))
        return "too many points", f"{options.max_points} points before the end of the interval"


class Interrupted(KeyboardInterrupt):
    """Ctrl-C while a path was followed, which is kept."""

    def __init__(self, path: Path) -> None:
        super().__init__("by the user")
        self.path = path


def follow(
    system: HarmonicSystem,
    start: NDArray,
    limits: tuple[float, float],
    *,
    up: bool = True,
    options: ContinuationOptions | None = None,
    on_point: Callable[[PathPoint], None] | None = None,
) -> Path:
    """Follow the response from a start near the curve until it leaves the frequency interval.

    Parameters
    ----------
    system : HarmonicSystem
    start : (n_unknowns + 1,) float
        A point close enough for Newton at its frequency.
    limits : (low, high), rad/s
    up : bool
        Set off toward higher frequency.
    options : ContinuationOptions
    on_point : callable
        Called with every accepted point.

    Returns
    -------
    Path
        Every point of it is converged; ``status`` and ``reason`` say how it ended.

    Raises
    ------
    Interrupted
        On Ctrl-C, with the path so far.
    """
    follower = _Follower(system, limits, options or ContinuationOptions(), on_point)

    def path(status: str, reason: str) -> Path:
        return Path(tuple(follower.points), status, reason, follower.iterations, follower.failed, follower.tangle)

    try:
        ending = follower.run(start, up)
    except KeyboardInterrupt as stop:
        raise Interrupted(path("interrupted", "by the user")) from stop
    return path(*ending)
