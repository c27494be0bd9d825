"""Minimum and root of an expensive, piecewise smooth function of one variable.

The optimum is the minimum of ln(peak amplitude) over ln(preload), given with its slope.  This
function is smooth on a branch of peaks and jumps if another peak becomes the highest.  Values and
slopes are known at some samples.  Between two neighbouring samples (:func:`lower_bound`):

- if the tangents match one smooth branch, the Hermite cubic through both ends has a minimum or
  none;
- otherwise one branch may continue along its tangent and end, or two branches cross where their
  tangents meet.

:func:`find_minimum` evaluates the function where it may be lowest, until no bound is below the
smallest known value.  A bracketing search (Brent) between the neighbours of the smallest value
misses minima elsewhere and does not use slopes.

:func:`find_root` finds the root between a change of sign.  The next trial is the zero of the
inverse interpolation polynomial through the last four points at most.  If their values are not
monotonic, or the zero lies outside the bracket, the trial is the secant through the ends of the
bracket.  The value at an end that remains twice is then reduced, so that both ends of the bracket
move [1]_.  If a trial is not below half the value that it replaces, the next trial is the midpoint.
If the function jumps through zero, the root is the jump.

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


def on_one_branch(a: Sample, b: Sample) -> bool:
    """Return whether values and tangents of two samples match one smooth branch."""
    h = b.x - a.x
    change = h * max(abs(a.slope), abs(b.slope), abs(b.slope - a.slope))
    return bool(abs(b.value - a.value - 0.5 * h * (a.slope + b.slope)) <= MISMATCH * change + 1e-6)


def lower_bound(a: Sample, b: Sample) -> LowerBound | None:
    """Return the lower bound between two neighbours from their tangents; None if not below both."""
    h = b.x - a.x
    fall, rise = -min(a.slope, 0.0), max(b.slope, 0.0)
    if np.isfinite(a.value) != np.isfinite(b.value):  # the known branch may decrease further
        drop = h * (fall if np.isfinite(a.value) else rise)
        drop = drop if np.isfinite(drop) else 2.0 * GAIN
        return (
            LowerBound(min(a.value, b.value) - drop, a.x + 0.5 * h, False)
            if drop > 0.0 and h > CORNER
            else None
        )
    narrow = 1e-3  # smallest distance worth searching: at a slope of 1 the gain is half of GAIN
    if not (np.isfinite(a.value + b.value) and h > narrow):
        return None
    if not np.isfinite(fall + rise):
        return (
            LowerBound(min(a.value, b.value) - 2.0 * GAIN, a.x + 0.5 * h, False)
            if h > CORNER
            else None
        )
    if h <= MAX_DISTANCE and on_one_branch(a, b):
        if not fall * rise > 0.0:
            return None
        rise_between = b.value - a.value
        t = _minimum_of_cubic(h * a.slope, h * b.slope, rise_between)
        bend = t * (1.0 - t) * h * ((1.0 - t) * a.slope - t * b.slope)
        return LowerBound(
            a.value + bend + t * t * (3.0 - 2.0 * t) * rise_between, a.x + t * h, True
        )
    if fall * rise > 0.0 and h <= MAX_DISTANCE:  # two branches may cross
        t = (a.value - b.value + rise * h) / ((fall + rise) * h)
        if 0.0 < t < 1.0:
            return LowerBound(a.value - fall * t * h, a.x + float(np.clip(t, 0.1, 0.9)) * h, False)
    lowest = min(a.value - fall * h, b.value - rise * h)
    return LowerBound(lowest, a.x + 0.5 * h, False) if lowest < min(a.value, b.value) else None


def _minimum_of_cubic(first: float, last: float, rise: float) -> float:
    """Return the minimum of the Hermite cubic on (0, 1) that decreases at 0 and increases at 1."""
    b, c = 6.0 * rise - 4.0 * first - 2.0 * last, 3.0 * (first + last) - 6.0 * rise
    root = np.sqrt(max(b * b - 4.0 * c * first, 0.0))
    return float(np.clip(-2.0 * first / (b + root) if b + root > 0.0 else 0.5, 0.01, 0.99))


Candidate = tuple[tuple[Sample, Sample], LowerBound]
"""Two neighbouring samples and the lower bound between them."""
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
    samples, refined, tried = sorted(known), set[float](), set[tuple[float, float]]()
    # two concurrent evaluations use two cores; the number is fixed so that the result does not
    # depend on the machine
    at_once = 2
    while len(samples) < len(known) + MAX_EVALUATIONS and (
        candidates := _candidates(samples, tried)
    ):
        new_x, lowest = [], min(p.value for p in samples)
        for (a, b), bound in candidates[:at_once]:
            minimum = None
            if a.slope < 0.0 < b.slope and (a.x, b.x) not in tried:
                tried.add((a.x, b.x))
                minimum = refine(a, b, bound.x)
            if minimum is not None and a.x < minimum < b.x:
                new_x.append(minimum)
                refined.add(minimum)
                tried |= {(a.x, minimum), (minimum, b.x)}  # the branch between the two is known
            elif bound.smooth or bound.value < lowest - GAIN:
                new_x.append(bound.x)
        new = evaluate(new_x) if new_x else ()
        if new_x and not new:  # interrupted
            break
        samples = sorted([*samples, *new])
    return samples, _classified(samples, refined, _candidates(samples, tried))


def _candidates(samples: Sequence[Sample], tried: set[tuple[float, float]]) -> list[Candidate]:
    """Return neighbours between which the function may be lower by GAIN, lowest bound first.

    Next to the smallest value any lower bound counts, until its slope is below LEVEL_SLOPE or the
    minimum was refined (``tried``): a refinement may fail from samples far apart and succeed from
    closer ones.
    """
    smallest = min(samples, key=lambda p: p.value)
    lowest = smallest.value
    out = []
    for a, b in zip(samples, samples[1:]):
        bound = lower_bound(a, b)
        if bound is None:
            continue
        around = a.slope < 0.0 < b.slope and smallest in (a, b) and (a.x, b.x) not in tried
        around = around and abs(smallest.slope) > LEVEL_SLOPE
        if bound.value < lowest - GAIN or (around and bound.value < lowest):
            out.append(((a, b), bound))
    return sorted(out, key=lambda item: item[1].value)


def _classified(
    samples: Sequence[Sample], refined: set[float], candidates: Sequence[Candidate]
) -> Minimum:
    """Classify the smallest sample and estimate its uncertainty."""
    k = min(range(len(samples)), key=lambda i: samples[i].value)
    here = samples[k]
    where = None if not candidates else (candidates[0][0][0].x, candidates[0][0][1].x)
    if here.x in refined and abs(here.slope) <= LEVEL_SLOPE:
        return Minimum(k, "smooth", 0.0, where)
    toward = k + (1 if here.slope < 0.0 else -1)
    if not 0 <= toward < len(samples):
        return Minimum(k, "end", 0.0, where)
    other = samples[toward]
    width = abs(other.x - here.x)
    if not np.isfinite(other.value):
        return Minimum(k, "unknown", width, where)
    if not np.isfinite(here.slope):
        neighbours = [samples[j] for j in (k - 1, k + 1) if 0 <= j < len(samples)]
        width = max(abs(p.x - here.x) for p in neighbours)
        kind = "jump" if max(p.value - here.value for p in neighbours) > 2.0 * width else "crossing"
        return Minimum(k, kind if width <= CORNER else "unknown", width, where)
    reached = other.value + other.slope * (
        here.x - other.x
    )  # branch of the neighbour, extrapolated
    meets = other.slope * here.slope < 0.0 and abs(reached - here.value) <= GAIN
    return Minimum(k, "crossing" if meets else "jump", width, where)


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
    function: Callable[[float], float], low: tuple[float, float], high: tuple[float, float], tolerance: float,
    most_trials: int = 80,
) -> Root:  # fmt: skip
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
    at = next(trials)
    while True:
        try:
            at = trials.send(function(at))
        except StopIteration as found:
            root: Root = found.value
            return root


def root_trials(
    low: tuple[float, float], high: tuple[float, float], tolerance: float, most_trials: int = 80
) -> Generator[float, float, Root]:
    """Yield the trials of :func:`find_root` and receive the function values by ``send``.

    The caller evaluates the function, so that the search calls nothing.
    """
    (a, f_a), (b, f_b) = low, high
    if f_a * f_b > 0.0:
        raise ValueError(
            f"a bracket needs values of different signs at its ends, found {f_a:g} and {f_b:g}"
        )
    sign = 1.0 if f_b > f_a else -1.0
    true_a, true_b = f_a, f_b  # f_a and f_b may be reduced for the secant
    fixed = ""  # end of the bracket that did not move in the previous trial
    known = [low, high]
    x = _secant(a, f_a, b, f_b)
    for trials in range(1, most_trials + 1):
        at, f = x, (yield x)
        known.append((at, f))
        if sign * f < 0.0:
            moved, before = at - a, true_a
            f_b *= _weight(f, true_a) if fixed == "b" else 1.0
            a, f_a, true_a, fixed = at, f, f, "b"
        else:
            moved, before = b - at, true_b
            f_a *= _weight(f, true_b) if fixed == "a" else 1.0
            b, f_b, true_b, fixed = at, f, f, "a"
        step = min(abs(f * moved / (before - f)) if f != before else np.inf, b - a)
        if step <= tolerance or f == 0.0:
            break
        x = 0.5 * (a + b)
        if abs(f) <= 0.5 * abs(before):
            x = _zero_of_inverse(sorted(known[-4:]))
            x = x if a < x < b else _secant(a, f_a, b, f_b)
    return Root(at, f, step, trials)


def _weight(new: float, old: float) -> float:
    """Return the factor for the value at the end that remains."""
    return 1.0 - new / old if abs(new) < abs(old) else 0.5


def _secant(a: float, f_a: float, b: float, f_b: float) -> float:
    """Return the root of the line through two points; the midpoint if it is outside."""
    x = (a * f_b - b * f_a) / (f_b - f_a) if f_b != f_a else a
    return x if a < x < b else 0.5 * (a + b)


def _zero_of_inverse(known: list[tuple[float, float]]) -> float:
    """Return the zero of the inverse interpolation polynomial (Neville); NaN if not monotonic."""
    x, f = [at for at, _ in known], np.array([value for _, value in known])
    rises = np.diff(f)
    if not ((rises > 0.0).all() or (rises < 0.0).all()):
        return np.nan
    for width in range(1, len(x)):
        x = [
            (f[i + width] * x[i] - f[i] * x[i + 1]) / (f[i + width] - f[i])
            for i in range(len(x) - 1)
        ]
    return float(x[0])
