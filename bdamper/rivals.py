"""Places of a cheap curve at which a richer study may respond higher than at the peak that the cheap one leads to.

Another maximum may become the highest, the top of the same hill may lie elsewhere, and where the response rises beyond the
peak (towards an end of the interval, or while a body walks) it may have a maximum.  So the maxima of the cheap curve that
come near its highest and all its points near the top are embedded in the richer study as well: with the estimate ``e`` of
:mod:`bdamper.indicator` and what it may miss ``d``, the richer response at a place of amplitude ``a`` lies between
``a (1 + e - d)`` and ``a (1 + e + d)``.

* A maximum may overtake the peak if the most it may have is above the least that the peak has.
* A point may if it may have more than the peak is expected to have, by the tolerance.
* Where the cheap response rises beyond the peak, the richer one may have a maximum between two points of which the higher
  need not stay the higher one, or at a summit that is no maximum, if the richer study changes anything there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.indicator import Estimate
from bdamper.peaks import Peak

if TYPE_CHECKING:
    from bdamper.response import Curve

NEAR = 0.7
"""Share of the highest amplitude from which on points of a curve are near its top."""
LEVEL = 1e-6
"""Relative difference of amplitude below which a curve does not rise or fall."""

Ask = Callable[[NDArray], Estimate]
"""What the richer study makes of a point of the cheap one, from unknowns and frequency (rad/s)."""


@dataclass(frozen=True)
class Place:
    """A point of a cheap curve and what a richer study makes of it.

    Parameters
    ----------
    y : (n_unknowns + 1,) float
        Of the cheap study.
    frequency, amplitude : float, Hz, m
        Of the cheap study.
    estimate : Estimate
    """

    y: NDArray
    frequency: float
    amplitude: float
    estimate: Estimate

    @property
    def expected(self) -> float:
        """Amplitude of the richer response, m; that of the cheap one where nothing is known."""
        return self.amplitude * (1.0 + (self.estimate.amplitude if np.isfinite(self.estimate.amplitude) else 0.0))

    @property
    def most(self) -> float:
        """Amplitude that the richer response may have, m."""
        e = self.estimate
        return self.amplitude * (1.0 + e.amplitude + e.defect) if np.isfinite(e.size) else np.inf

    @property
    def least(self) -> float:
        """Amplitude that it has at least, m."""
        e = self.estimate
        return max(self.amplitude * (1.0 + e.amplitude - e.defect), 0.0) if np.isfinite(e.size) else 0.0


class Rival(NamedTuple):
    """A place that may overtake the highest peak, and by how much the estimate of the peak misses that.

    Parameters
    ----------
    place : Place
    may_miss : float
        Relative change of amplitude or frequency beyond the estimate, if the response there is the most it may be.
    misses : float
        The same as far as it can be expected: as much for a maximum, 0 at a point whose own estimate cannot be relied on.
    """

    place: Place
    may_miss: float
    misses: float


def place_of_peak(peak: Peak, ask: Ask) -> Place:
    return Place(peak.y, peak.frequency, peak.amplitude, ask(peak.y))


def place_on_curve(curve: Curve, index: int, ask: Ask) -> Place:
    y = np.append(curve.unknowns[index], 2.0 * np.pi * curve.frequency[index])
    return Place(y, float(curve.frequency[index]), float(curve.amplitude[index]), ask(y))


def near_top(curve: Curve, amplitude: float, share: float = NEAR) -> NDArray:
    """Indices of the points of a curve that come near an amplitude or exceed it."""
    return np.flatnonzero(curve.amplitude >= share * amplitude)


def rivals(curve: Curve, peaks: list[Peak], ask: Ask, top: Place, tolerance: float) -> Iterator[Rival]:
    """Places of a curve that may overtake its highest peak in a richer study.

    Parameters
    ----------
    curve : Curve
    peaks : list of Peak
        Of the curve, the highest first.
    ask : callable
    top : Place
        The highest peak.
    tolerance : float
        Relative.
    """
    for peak in peaks[1:]:
        place = place_of_peak(peak, ask)
        if peak.amplitude >= NEAR * top.amplitude and place.most > top.least:
            yield _rival(place, top)
    places = {int(i): place_on_curve(curve, i, ask) for i in near_top(curve, top.amplitude)}
    above = top.amplitude * (1.0 + LEVEL)
    limit = top.expected * (1.0 + tolerance)
    for place in places.values():
        if place.amplitude <= above and place.most > limit:
            sure = place.expected > limit and place.estimate.reliability(tolerance) != "must be on"
            yield _rival(place, top)._replace(misses=_beyond(place, place.expected, top) if sure else 0.0)
    for i, j in pairwise(places):
        a, b = sorted((places[i], places[j]), key=lambda p: p.amplitude)
        follows = j == i + 1 and curve.branch[i] == curve.branch[j]
        if follows and a.amplitude > above and b.amplitude > a.amplitude * (1.0 + LEVEL) and a.most >= b.least:
            yield _rival(a, top)
    for i in summits(curve):
        if i in places and places[i].amplitude > above and places[i].estimate.size > LEVEL:
            yield _rival(places[i], top)


def _rival(place: Place, top: Place) -> Rival:
    miss = _beyond(place, place.most, top)
    return Rival(place, miss, miss)


def _beyond(place: Place, amplitude: float, top: Place) -> float:
    """What the estimate of the peak misses if the response at a place becomes the highest, with an amplitude."""
    moved = place.estimate.frequency if np.isfinite(place.estimate.frequency) else 0.0
    of_amplitude = amplitude / top.amplitude - 1.0 - top.estimate.amplitude
    of_frequency = place.frequency * (1.0 + moved) / top.frequency - 1.0 - top.estimate.frequency
    return max(abs(of_amplitude), abs(of_frequency))


def summits(curve: Curve) -> list[int]:
    """Points of a curve from which it falls to both sides along its branch."""
    a = curve.amplitude
    out = []
    for branch in np.unique(curve.branch):
        at = np.flatnonzero(curve.branch == branch)
        step = np.diff(a[at])
        step[np.abs(step) < LEVEL * a.max()] = 0.0
        moving = np.flatnonzero(step)
        out += [int(at[j + 1]) for j, k in zip(moving, moving[1:]) if step[j] > 0.0 > step[k]]
    return out
