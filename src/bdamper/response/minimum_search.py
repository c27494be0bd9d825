"""The least of a function of one variable that is costly, smooth in parts and jumps between them: a peak over the preload.

Values are known at some places with their slopes.  Between two of them the tangents tell how low the function may be: where
they agree it is one smooth branch, whose cubic has a minimum or has none; otherwise one branch may run on along its tangent
and end, or two cross where their tangents meet.  New places are taken where the function may be lowest, until nothing known
says that it is lower anywhere.  A bounded search (Brent's) between the neighbours of the least value alone misses minima
elsewhere, and takes no notice of slopes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

GAIN = 2e-3
"""By which the function may be lower for the search to go on: in ln(amplitude) a fifth of what an optimum may be off by."""
LEVEL_SLOPE = 1e-4
"""Slope at most at a minimum that was settled: where it is larger another branch is the highest there."""
AGREE = 0.2
"""Share of the larger change along either tangent by which the tangents of one smooth branch may miss the values."""
WIDE = 0.6
"""Distance of two places beyond which tangents that agree or meet prove nothing: with four preloads from 60 N to 20 kN
(residual modes, one harmonic) the optimum is 17 % too high without it."""
CORNER = 0.02
"""Distance of two places down to which one without a slope, a corner or a drift, is enclosed by halving; and the end of
those with a value, where the function falls toward it: without that one of 15 random optima is 4 % too high."""
MOST = 12
"""Places that are asked at most, besides those known."""


class Place(NamedTuple):
    """A place with the value and the slope of the function, NaN where it has none; an infinite value is not known."""

    x: float
    value: float
    slope: float = np.nan


class Promise(NamedTuple):
    """How low the function may be between two places, where, and whether they lie on one smooth branch."""

    value: float
    x: float
    smooth: bool


@dataclass(frozen=True)
class Least:
    """The least value found.

    Parameters
    ----------
    index : int
        Of the place, among all places in order.
    kind : {"smooth", "crossing", "jump", "end", "unknown"}
    uncertainty : float
        Of the place.
    open : (low, high), optional
        Between which the function may be lower.
    """

    index: int
    kind: str
    uncertainty: float
    open: tuple[float, float] | None = None


def agree(a: Place, b: Place) -> bool:
    """Whether the tangents of two places fit their values as those of one smooth branch do."""
    h = b.x - a.x
    change = h * max(abs(a.slope), abs(b.slope), abs(b.slope - a.slope))
    return bool(abs(b.value - a.value - 0.5 * h * (a.slope + b.slope)) <= AGREE * change + 1e-6)


def promise(a: Place, b: Place) -> Promise | None:
    """Lower bound of the function between two neighbours, from their tangents; None if it is not lower than both."""
    h = b.x - a.x
    fall, rise = -min(a.slope, 0.0), max(b.slope, 0.0)
    if np.isfinite(a.value) != np.isfinite(b.value):  # the branch at the one that is known may fall on toward the other
        drop = h * (fall if np.isfinite(a.value) else rise)
        drop = drop if np.isfinite(drop) else 2.0 * GAIN
        return Promise(min(a.value, b.value) - drop, a.x + 0.5 * h, False) if drop > 0.0 and h > CORNER else None
    narrow = 1e-3  # distance of two places below which nothing is looked for between them: at a slope of one half of GAIN
    if not (np.isfinite(a.value + b.value) and h > narrow):
        return None
    if not np.isfinite(fall + rise):
        return Promise(min(a.value, b.value) - 2.0 * GAIN, a.x + 0.5 * h, False) if h > CORNER else None
    if h <= WIDE and agree(a, b):
        if not fall * rise > 0.0:
            return None
        rise_between = b.value - a.value
        t = _least_of_cubic(h * a.slope, h * b.slope, rise_between)
        bend = t * (1.0 - t) * h * ((1.0 - t) * a.slope - t * b.slope)
        return Promise(a.value + bend + t * t * (3.0 - 2.0 * t) * rise_between, a.x + t * h, True)
    if fall * rise > 0.0 and h <= WIDE:  # two branches that cross, if they reach so far
        t = (a.value - b.value + rise * h) / ((fall + rise) * h)
        if 0.0 < t < 1.0:
            return Promise(a.value - fall * t * h, a.x + float(np.clip(t, 0.1, 0.9)) * h, False)
    lowest = min(a.value - fall * h, b.value - rise * h)
    return Promise(lowest, a.x + 0.5 * h, False) if lowest < min(a.value, b.value) else None


def _least_of_cubic(first: float, last: float, rise: float) -> float:
    """Abscissa of the minimum of the Hermite cubic on (0, 1) that decreases at 0 and increases at 1."""
    b, c = 6.0 * rise - 4.0 * first - 2.0 * last, 3.0 * (first + last) - 6.0 * rise
    root = np.sqrt(max(b * b - 4.0 * c * first, 0.0))
    return float(np.clip(-2.0 * first / (b + root) if b + root > 0.0 else 0.5, 0.01, 0.99))


Open = tuple[tuple[Place, Place], Promise]
"""Two neighbouring places and the lower bound between them."""
Ask = Callable[[Sequence[float]], Sequence[Place]]
"""Evaluates the function at several abscissae."""
Settle = Callable[[Place, Place, float], float | None]
"""Minimum of the smooth branch between two places, from a guess; None if not found."""


def least(known: Sequence[Place], ask: Ask, settle: Settle) -> tuple[list[Place], Least]:
    """The least value, from known places and further evaluations where it may be lower.

    Parameters
    ----------
    known : sequence of Place
        One or more with a value.
    ask, settle : callable

    Returns
    -------
    list of Place, in order, and Least
    """
    places, settled, tried = sorted(known), set[float](), set[tuple[float, float]]()
    # places that are asked side by side, so that two cores are busy and the answer does not depend on how many there
    # are
    at_once = 2
    while len(places) < len(known) + MOST and (open_ := _open(places, tried)):
        wanted, lowest = [], min(p.value for p in places)
        for (a, b), there in open_[:at_once]:
            found = None
            if a.slope < 0.0 < b.slope and (a.x, b.x) not in tried:
                tried.add((a.x, b.x))
                found = settle(a, b, there.x)
            if found is not None and a.x < found < b.x:
                wanted.append(found)
                settled.add(found)
                tried |= {(a.x, found), (found, b.x)}  # the branch between the two is known now
            elif there.smooth or there.value < lowest - GAIN:
                wanted.append(there.x)
        new = ask(wanted) if wanted else ()
        if wanted and not new:  # nobody answers any more
            break
        places = sorted([*places, *new])
    return places, _judged(places, settled, _open(places, tried))


def _open(places: Sequence[Place], tried: set[tuple[float, float]]) -> list[Open]:
    """Neighbours between which the function may be lower by GAIN than anywhere known, the lowest bound first.

    Beside the least place the smallest bound counts, until its slope is LEVEL_SLOPE or the minimum was refined (``tried``):
    from neighbours a third apart the search for it may fail, and succeed from nearer ones.
    """
    least_ = min(places, key=lambda p: p.value)
    lowest = least_.value
    out = []
    for a, b in zip(places, places[1:]):
        there = promise(a, b)
        if there is None:
            continue
        beside = a.slope < 0.0 < b.slope and least_ in (a, b) and abs(least_.slope) > LEVEL_SLOPE and (a.x,
            b.x) not in tried
        if there.value < lowest - GAIN or (beside and there.value < lowest):
            out.append(((a, b), there))
    return sorted(out, key=lambda item: item[1].value)


def _judged(places: Sequence[Place], settled: set[float], open_: Sequence[Open]) -> Least:
    """What kind of least value was found, and how closely."""
    k = min(range(len(places)), key=lambda i: places[i].value)
    here = places[k]
    where = None if not open_ else (open_[0][0][0].x, open_[0][0][1].x)
    if here.x in settled and abs(here.slope) <= LEVEL_SLOPE:
        return Least(k, "smooth", 0.0, where)
    toward = k + (1 if here.slope < 0.0 else -1)
    if not 0 <= toward < len(places):
        return Least(k, "end", 0.0, where)
    other = places[toward]
    width = abs(other.x - here.x)
    if not np.isfinite(other.value):
        return Least(k, "unknown", width, where)
    if not np.isfinite(here.slope):
        beside = [places[j] for j in (k - 1, k + 1) if 0 <= j < len(places)]
        width = max(abs(p.x - here.x) for p in beside)
        kind = "jump" if max(p.value - here.value for p in beside) > 2.0 * width else "crossing"
        return Least(k, kind if width <= CORNER else "unknown", width, where)
    reached = other.value + other.slope * (here.x - other.x)  # by the branch on the other side, which falls toward here
    meets = other.slope * here.slope < 0.0 and abs(reached - here.value) <= GAIN
    return Least(k, "crossing" if meets else "jump", width, where)
