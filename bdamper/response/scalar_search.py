"""Minimum and root of an expensive, piecewise smooth function of one variable.

The optimum is the minimum of ln(peak amplitude) as a function of ln(preload); its slope is also
known.  This function is smooth on a branch of peaks and jumps if another peak becomes the highest.
Values and slopes are known at some samples.  Between two neighbouring samples
(:func:`lower_bound`):

- if the tangents match a single smooth branch, the Hermite cubic through both ends gives the
  minimum, if there is one;
- otherwise one branch may continue along its tangent and end, or two branches cross where their
  tangents meet.

:func:`find_minimum` evaluates the function where it may be lowest, until no bound is below the
smallest known value.  A bracketing search (Brent) between the neighbours of the smallest value
misses minima elsewhere and does not use slopes.

:func:`find_root` finds the root in an interval over which the sign changes.  The next trial is the
zero of the inverse interpolation polynomial through the last points, four at most.  If their values
are not monotonic, or the zero lies outside the bracket, the trial is the secant through the ends of
the bracket.  The value at an end that remains twice is then reduced, so that both ends of the
bracket move [1]_.  If a trial is not below half the value that it replaces, the next trial is the
midpoint.  If the function jumps through zero, the root is the jump.

The search stops if the secant step through the last two trials on one side is within the tolerance,
regardless of the width of the bracket.  A secant across the root would mistake a jump for a root
nearby.

References
----------
.. [1] N. Anderson, A. Bjoerck, BIT 13 (1973), 253-264.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

GAIN = 2e-3
"""Smallest improvement that continues the search; in ln(amplitude) a fifth of the tolerated error
of an optimum."""
LEVEL_SLOPE = 1e-4
"""Largest slope at a refined smooth minimum.  With a larger slope another branch is the highest
there."""
MISMATCH = 0.2
"""Largest mismatch of values and tangents on one smooth branch, relative to the larger change along
either tangent."""
MAX_DISTANCE = 0.6
"""Largest distance of samples for which matching or crossing tangents prove anything.  Without this
limit the optimum from four preloads between 60 N and 20 kN (residual modes, one harmonic) is 17 %
too high.
"""
CORNER = 0.02
"""Distance to which a sample without a slope (corner or drift), or the end of a decreasing range of
known values, is enclosed by bisection.  Without it one of 15 random optima is 4 % too high.
"""
MAX_EVALUATIONS = 12
"""Largest number of further evaluations."""


class Sample(NamedTuple):
    """Abscissa with the value and the slope of the function.

    The slope is NaN if unknown, and the value infinite.
    """

    x: float
    value: float
    slope: float = np.nan


class LowerBound(NamedTuple):
    """Lower bound between two samples, its position, and whether both are on one smooth branch."""

    value: float
    x: float
    smooth: bool


@dataclass(frozen=True)
class Minimum:
    """Minimum of the samples, and its kind.

    Parameters
    ----------
    index : int
        Index of the sample, in ascending order.
    kind : {"smooth", "crossing", "jump", "end", "unknown"}
    uncertainty : float
        Uncertainty of the position.
    open : (low, high), optional
        Interval in which the function may be lower.
    """

    index: int
    kind: str
    uncertainty: float
    open: tuple[float, float] | None = None


def on_one_branch(left: Sample, right: Sample) -> bool:
    """Return whether values and tangents of two samples match one smooth branch."""
    distance = right.x - left.x
    change = distance * max(abs(left.slope), abs(right.slope), abs(right.slope - left.slope))
    # the trapezoidal rule gives the rise along one branch
    mismatch = abs(right.value - left.value - 0.5 * distance * (left.slope + right.slope))
    return bool(mismatch <= MISMATCH * change + 1e-6)


def lower_bound(left: Sample, right: Sample) -> LowerBound | None:
    """Return the lower bound between two neighbours from their tangents; None if not below both."""
    distance = right.x - left.x
    middle = left.x + 0.5 * distance
    smaller = min(left.value, right.value)
    left_known = bool(np.isfinite(left.value))
    right_known = bool(np.isfinite(right.value))
    # slopes towards lower values inside, zero or positive; a sample without a slope has NaN
    fall = -min(left.slope, 0.0)
    rise = max(right.slope, 0.0)
    # only one value is known: its branch may decrease further
    if left_known != right_known:
        drop = distance * (fall if left_known else rise)
        if not np.isfinite(drop):
            drop = 2.0 * GAIN
        if drop > 0.0 and distance > CORNER:
            return LowerBound(smaller - drop, middle, smooth=False)
        return None
    # smallest distance worth searching: at a slope of 1 the gain is half of GAIN
    narrow = 1e-3
    both_known = left_known and right_known
    if not both_known or not distance > narrow:
        return None
    # without a slope nothing is known about values inside
    if not np.isfinite(fall + rise):
        if distance > CORNER:
            return LowerBound(smaller - 2.0 * GAIN, middle, smooth=False)
        return None
    encloses_minimum = fall * rise > 0.0
    if distance <= MAX_DISTANCE and on_one_branch(left, right):
        return _bound_of_cubic(left, right) if encloses_minimum else None
    # two branches may cross where the tangents meet
    if distance <= MAX_DISTANCE and encloses_minimum:
        # left.value - fall part distance = right.value - rise (1 - part) distance
        part = (left.value - right.value + rise * distance) / ((fall + rise) * distance)
        if 0.0 < part < 1.0:
            # the next sample keeps a distance from both
            inside = float(np.clip(part, 0.1, 0.9))
            return LowerBound(
                left.value - fall * part * distance, left.x + inside * distance, smooth=False
            )
    # one branch may continue along its tangent
    lowest = min(left.value - fall * distance, right.value - rise * distance)
    if lowest < smaller:
        return LowerBound(lowest, middle, smooth=False)
    return None


def _bound_of_cubic(left: Sample, right: Sample) -> LowerBound:
    """Return the minimum of the Hermite cubic through two samples that enclose it."""
    distance = right.x - left.x
    rise = right.value - left.value
    t = _minimum_of_cubic(distance * left.slope, distance * right.slope, rise)
    # Hermite basis: parts of the end slopes and of the rise
    of_slopes = t * (1.0 - t) * distance * ((1.0 - t) * left.slope - t * right.slope)
    of_rise = t * t * (3.0 - 2.0 * t) * rise
    value = left.value + of_slopes + of_rise
    return LowerBound(value, left.x + t * distance, smooth=True)


def _minimum_of_cubic(first: float, last: float, rise: float) -> float:
    """Return the position t of the minimum of a cubic on (0, 1), within 0.01 and 0.99.

    The cubic has the slopes ``first`` < 0 and ``last`` > 0 at its ends and the difference ``rise``
    between them.
    """
    # the slope is first + b t + c t^2
    b = 6.0 * rise - 4.0 * first - 2.0 * last
    c = 3.0 * (first + last) - 6.0 * rise
    root = np.sqrt(max(b * b - 4.0 * c * first, 0.0))
    # the zero at which the slope increases, in the form without cancellation
    t = -2.0 * first / (b + root) if b + root > 0.0 else 0.5
    return float(np.clip(t, 0.01, 0.99))


class Candidate(NamedTuple):
    """Two neighbouring samples and the lower bound between them."""

    left: Sample
    right: Sample
    bound: LowerBound

    @property
    def ends(self) -> tuple[float, float]:
        """Abscissae of both samples."""
        return self.left.x, self.right.x


Evaluate = Callable[[Sequence[float]], Sequence[Sample]]
"""Callable that evaluates the function at several abscissae."""
Refine = Callable[[Sample, Sample, float], float | None]
"""Callable that returns the minimum of the smooth branch between two samples from a guess; None if
it fails."""


def find_minimum(
    known: Sequence[Sample], evaluate: Evaluate, refine: Refine
) -> tuple[list[Sample], Minimum]:
    """Find the minimum from known samples and further evaluations.

    The optimal curve calls it with ln(amplitude) as a function of ln(preload).

    Parameters
    ----------
    known : sequence of Sample
        Known samples, of which at least one has a value.
    evaluate : callable
        Evaluates the function at several abscissae.
    refine : callable
        Refines the minimum of a smooth branch between two samples.

    Returns
    -------
    list of Sample
        All samples in ascending order of the abscissa.
    Minimum
        Minimum of the samples.
    """
    samples = sorted(known)
    # abscissae of refined minima, and neighbours between which a refinement was tried
    refined: set[float] = set()
    tried: set[tuple[float, float]] = set()
    # two concurrent evaluations use two cores; the number is fixed so that the result does not
    # depend on the machine
    at_once = 2
    most_samples = len(known) + MAX_EVALUATIONS
    while len(samples) < most_samples:
        candidates = _candidates(samples, tried)
        if not candidates:
            break
        new_x = []
        lowest = min(sample.value for sample in samples)
        for candidate in candidates[:at_once]:
            left, right, bound = candidate
            minimum: float | None = None
            if left.slope < 0.0 < right.slope and candidate.ends not in tried:
                tried.add(candidate.ends)
                minimum = refine(left, right, bound.x)
            if minimum is not None and left.x < minimum < right.x:
                new_x.append(minimum)
                refined.add(minimum)
                # the branch between the two is known
                tried.add((left.x, minimum))
                tried.add((minimum, right.x))
            elif bound.smooth or bound.value < lowest - GAIN:
                new_x.append(bound.x)
        if new_x:
            new = evaluate(new_x)
            interrupted = not new
            if interrupted:
                break
            samples = sorted([*samples, *new])
    return samples, _classified(samples, refined, _candidates(samples, tried))


def _candidates(samples: Sequence[Sample], tried: set[tuple[float, float]]) -> list[Candidate]:
    """Return neighbours between which the function may be lower by GAIN, lowest bound first.

    Next to the smallest value any lower bound counts, until its slope is below LEVEL_SLOPE or the
    minimum was refined (``tried``): a refinement may fail from samples far apart and succeed from
    closer ones.
    """
    smallest = min(samples, key=lambda sample: sample.value)
    candidates = []
    for left, right in zip(samples, samples[1:]):
        bound = lower_bound(left, right)
        if bound is None:
            continue
        candidate = Candidate(left, right, bound)
        encloses_minimum = left.slope < 0.0 < right.slope
        next_to_smallest = smallest in (left, right) and abs(smallest.slope) > LEVEL_SLOPE
        to_refine = encloses_minimum and next_to_smallest and candidate.ends not in tried
        needed_gain = 0.0 if to_refine else GAIN
        if bound.value < smallest.value - needed_gain:
            candidates.append(candidate)
    return sorted(candidates, key=lambda candidate: candidate.bound.value)


def _classified(
    samples: Sequence[Sample], refined: set[float], candidates: Sequence[Candidate]
) -> Minimum:
    """Classify the smallest sample and estimate its uncertainty."""
    index = min(range(len(samples)), key=lambda i: samples[i].value)
    best = samples[index]
    # candidates remain if the search ended early
    open_interval = candidates[0].ends if candidates else None
    if best.x in refined and abs(best.slope) <= LEVEL_SLOPE:
        return Minimum(index, "smooth", uncertainty=0.0, open=open_interval)
    # the neighbour in the direction of lower values
    downhill = index + 1 if best.slope < 0.0 else index - 1
    if not 0 <= downhill < len(samples):
        return Minimum(index, "end", uncertainty=0.0, open=open_interval)
    other = samples[downhill]
    width = abs(other.x - best.x)
    if not np.isfinite(other.value):
        return Minimum(index, "unknown", width, open_interval)
    if not np.isfinite(best.slope):
        # without a slope both neighbours limit the position; at an end there is only one
        neighbours = [*samples[max(index - 1, 0) : index], *samples[index + 1 : index + 2]]
        width = max(abs(neighbour.x - best.x) for neighbour in neighbours)
        largest_rise = max(neighbour.value - best.value for neighbour in neighbours)
        if width > CORNER:
            kind = "unknown"
        elif largest_rise > 2.0 * width:
            kind = "jump"
        else:
            kind = "crossing"
        return Minimum(index, kind, width, open_interval)
    # branch of the neighbour, extrapolated
    extrapolated = other.value + other.slope * (best.x - other.x)
    crosses = other.slope * best.slope < 0.0 and abs(extrapolated - best.value) <= GAIN
    return Minimum(index, "crossing" if crosses else "jump", width, open_interval)


class Root(NamedTuple):
    """Result of a root search.

    Parameters
    ----------
    at, value : float
        Last trial and the function there.
    step : float
        Estimated error of ``at``: secant step through the last two trials on one side, at most the
        width of the bracket.
    trials : int
        Number of function evaluations.
    """

    at: float
    value: float
    step: float
    trials: int


def find_root(
    function: Callable[[float], float],
    low: tuple[float, float],
    high: tuple[float, float],
    tolerance: float,
    most_trials: int = 80,
) -> Root:
    """Find the root of a function within a bracket.

    Parameters
    ----------
    function : callable
        Scalar function, which may jump; it is evaluated at least once.
    low, high : (x, value)
        Ends of the bracket in ascending order, with values of different signs.
    tolerance : float
        Absolute tolerance of the root.
    most_trials : int

    Returns
    -------
    Root

    Raises
    ------
    ValueError
        If the values at the ends have the same sign.
    """
    trials = root_trials(low, high, tolerance, most_trials)
    x = next(trials)
    while True:
        value = function(x)
        try:
            x = trials.send(value)
        except StopIteration as end:
            root: Root = end.value
            return root


def root_trials(
    low: tuple[float, float], high: tuple[float, float], tolerance: float, most_trials: int = 80
) -> Generator[float, float, Root]:
    """Yield the trials of :func:`find_root` and receive the function values by ``send``.

    The caller evaluates the function, so that the search calls nothing.
    """
    a, f_a = low
    b, f_b = high
    if f_a * f_b > 0.0:
        raise ValueError(
            f"a bracket needs values of different signs at its ends, found {f_a:g} and {f_b:g}"
        )
    # sign * f increases from a to b
    sign = 1.0 if f_b > f_a else -1.0
    # f_a and f_b may be reduced for the secant, these are the values of the function
    true_a = f_a
    true_b = f_b
    # end of the bracket that did not move in the previous trial
    fixed = ""
    points = [low, high]
    next_x = _secant(a, f_a, b, f_b)
    for trials in range(1, most_trials + 1):
        x = next_x
        f = yield x
        points.append((x, f))
        # the trial replaces the end of the bracket on its side of the root
        before_root = sign * f < 0.0
        if before_root:
            moved = x - a
            replaced = true_a
            if fixed == "b":
                f_b *= _weight(f, true_a)
            a = x
            f_a = true_a = f
            fixed = "b"
        else:
            moved = b - x
            replaced = true_b
            if fixed == "a":
                f_a *= _weight(f, true_b)
            b = x
            f_b = true_b = f
            fixed = "a"
        # secant through the last two trials on this side of the root
        secant_step = abs(f * moved / (replaced - f)) if f != replaced else np.inf
        step = min(secant_step, b - a)
        if step <= tolerance or f == 0.0:
            break
        slow = abs(f) > 0.5 * abs(replaced)
        if slow:
            next_x = 0.5 * (a + b)
            continue
        next_x = _zero_of_inverse(sorted(points[-4:]))
        # also for NaN
        if not a < next_x < b:
            next_x = _secant(a, f_a, b, f_b)
    return Root(at=x, value=f, step=step, trials=trials)


def _weight(new: float, old: float) -> float:
    """Return the factor by which Anderson and Bjoerck reduce the value at the end that remains.

    ``old`` and ``new`` are the values at the other end before and after a trial.
    """
    if abs(new) < abs(old):
        return 1.0 - new / old
    return 0.5


def _secant(a: float, f_a: float, b: float, f_b: float) -> float:
    """Return the root of the line through two points; the midpoint if it is outside."""
    middle = 0.5 * (a + b)
    if f_b == f_a:
        return middle
    x = (a * f_b - b * f_a) / (f_b - f_a)
    return x if a < x < b else middle


def _zero_of_inverse(points: list[tuple[float, float]]) -> float:
    """Return x at f = 0 on the polynomial x(f) through points (x, f), by Neville's scheme.

    NaN if the values are not monotonic.
    """
    x = [position for position, _ in points]
    f = np.array([value for _, value in points])
    rises = np.diff(f)
    monotonic = (rises > 0.0).all() or (rises < 0.0).all()
    if not monotonic:
        return np.nan
    # x[i] is the value at f = 0 of the polynomial through points i to i + width - 1; each pass
    # joins two neighbours to the polynomial through one more point
    for width in range(1, len(x)):
        joined = []
        for i in range(len(x) - 1):
            left, right = f[i], f[i + width]
            joined.append((right * x[i] - left * x[i + 1]) / (right - left))
        x = joined
    return float(x[0])
