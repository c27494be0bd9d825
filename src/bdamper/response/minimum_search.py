"""Search for the optimum: the minimum of an expensive, piecewise smooth function of one variable, given with its slope.

The function is ln(peak amplitude) over ln(preload).  It is smooth on a branch of peaks and jumps if another peak becomes
the highest.  Values and slopes are known at some samples.  Between two neighbouring samples (:func:`lower_bound`):

- if the tangents match one smooth branch, the Hermite cubic through both ends has a minimum or none;
- otherwise one branch may continue along its tangent and end, or two branches cross where their tangents meet.

:func:`find_minimum` evaluates the function where it may be lowest, until no bound is below the smallest known value.  A
bracketing search (Brent) between the neighbours of the smallest value misses minima elsewhere and does not use slopes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

GAIN = 2e-3
"""Smallest improvement that continues the search; in ln(amplitude) a fifth of the tolerated error of an optimum."""
LEVEL_SLOPE = 1e-4
"""Largest slope at a refined smooth minimum.  With a larger slope another branch is the highest there."""
MISMATCH = 0.2
"""Largest mismatch of values and tangents on one smooth branch, relative to the larger change along either tangent."""
MAX_DISTANCE = 0.6
"""Largest distance of samples for which matching or crossing tangents prove anything.  Without this limit the optimum from
four preloads between 60 N and 20 kN (residual modes, one harmonic) is 17 % too high.
"""
CORNER = 0.02
"""Distance to which a sample without a slope (corner or drift), or the end of a decreasing range of known values, is
enclosed by bisection.  Without it one of 15 random optima is 4 % too high.
"""
MAX_EVALUATIONS = 12
"""Largest number of further evaluations."""


class Sample(NamedTuple):
    """Abscissa with the value and the slope of the function; NaN without a slope, infinite without a value."""

    x: float
    value: float
    slope: float = np.nan


class LowerBound(NamedTuple):
    """Lower bound of the function between two samples, its position, and whether both are on one smooth branch."""

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
    """Return the lower bound of the function between two neighbours from their tangents; None if it is not below both."""
    h = b.x - a.x
    fall, rise = -min(a.slope, 0.0), max(b.slope, 0.0)
    if np.isfinite(a.value) != np.isfinite(b.value):  # the known branch may decrease further
        drop = h * (fall if np.isfinite(a.value) else rise)
        drop = drop if np.isfinite(drop) else 2.0 * GAIN
        return LowerBound(min(a.value, b.value) - drop, a.x + 0.5 * h, False) if drop > 0.0 and h > CORNER else None
    narrow = 1e-3  # smallest distance worth searching: at a slope of 1 the gain is half of GAIN
    if not (np.isfinite(a.value + b.value) and h > narrow):
        return None
    if not np.isfinite(fall + rise):
        return LowerBound(min(a.value, b.value) - 2.0 * GAIN, a.x + 0.5 * h, False) if h > CORNER else None
    if h <= MAX_DISTANCE and on_one_branch(a, b):
        if not fall * rise > 0.0:
            return None
        rise_between = b.value - a.value
        t = _minimum_of_cubic(h * a.slope, h * b.slope, rise_between)
        bend = t * (1.0 - t) * h * ((1.0 - t) * a.slope - t * b.slope)
        return LowerBound(a.value + bend + t * t * (3.0 - 2.0 * t) * rise_between, a.x + t * h, True)
    if fall * rise > 0.0 and h <= MAX_DISTANCE:  # two branches may cross
        t = (a.value - b.value + rise * h) / ((fall + rise) * h)
        if 0.0 < t < 1.0:
            return LowerBound(a.value - fall * t * h, a.x + float(np.clip(t, 0.1, 0.9)) * h, False)
    lowest = min(a.value - fall * h, b.value - rise * h)
    return LowerBound(lowest, a.x + 0.5 * h, False) if lowest < min(a.value, b.value) else None


def _minimum_of_cubic(first: float, last: float, rise: float) -> float:
    """Return the abscissa of the minimum of the Hermite cubic on (0, 1) that decreases at 0 and increases at 1."""
    b, c = 6.0 * rise - 4.0 * first - 2.0 * last, 3.0 * (first + last) - 6.0 * rise
    root = np.sqrt(max(b * b - 4.0 * c * first, 0.0))
    return float(np.clip(-2.0 * first / (b + root) if b + root > 0.0 else 0.5, 0.01, 0.99))


Candidate = tuple[tuple[Sample, Sample], LowerBound]
"""Two neighbouring samples and the lower bound between them."""
Evaluate = Callable[[Sequence[float]], Sequence[Sample]]
"""Callable that evaluates the function at several abscissae."""
Refine = Callable[[Sample, Sample, float], float | None]
"""Callable that returns the minimum of the smooth branch between two samples from a guess; None if it fails."""


def find_minimum(known: Sequence[Sample], evaluate: Evaluate, refine: Refine) -> tuple[list[Sample], Minimum]:
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
    # two concurrent evaluations use two cores; the number is fixed so that the result does not depend on the machine
    at_once = 2
    while len(samples) < len(known) + MAX_EVALUATIONS and (candidates := _candidates(samples, tried)):
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
    """Return neighbours between which the function may be lower by GAIN than all known values, the lowest bound first.

    Next to the smallest value any lower bound counts, until its slope is below LEVEL_SLOPE or the minimum was refined
    (``tried``): a refinement may fail from samples far apart and succeed from closer ones.
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


def _classified(samples: Sequence[Sample], refined: set[float], candidates: Sequence[Candidate]) -> Minimum:
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
    reached = other.value + other.slope * (here.x - other.x)  # branch of the neighbour, extrapolated
    meets = other.slope * here.slope < 0.0 and abs(reached - here.value) <= GAIN
    return Minimum(k, "crossing" if meets else "jump", width, where)
