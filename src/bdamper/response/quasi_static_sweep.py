"""What a slow sweep of frequency shows of a response curve: the branch that is kept until it folds or loses its stability.

The sweep begins at one end of the interval, on the lowest stable solution there, and moves along stable points.  Where the
frequency turns or stability is lost the response jumps to a stable solution at that frequency: the nearest lower one, or
the nearest higher one if none is lower.  The motion during a jump is not computed, so among several stable solutions the
response may end on another one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.response.curve import ResponseCurve, crossed
from bdamper.util import validation


class Jump(NamedTuple):
    """Where a sweep leaves one branch for another.

    Parameters
    ----------
    frequency : float, Hz
    before, after : float, m
        Amplitudes; the latter is NaN where no stable solution is known, and the sweep ends.
    """

    frequency: float
    before: float
    after: float

    def __str__(self) -> str:
        return f"jump at {self.frequency:.6g} Hz from {self.before:.4g} to {self.after:.4g} m"


@dataclass(frozen=True)
class SlowSweep:
    """Response along a slow sweep of frequency, by :func:`sweep_of`.

    Parameters
    ----------
    frequency : (n,) float, Hz
        In the order of the sweep; twice the same at a jump.
    amplitude : (n,) float, m
        Of the harmonic of the excitation.
    jumps : tuple of Jump
    point : (n,) int
        Of the curve; where a jump ends between two points, that of the two which the sweep has not come to yet.
    """

    frequency: NDArray
    amplitude: NDArray
    jumps: tuple[Jump, ...]
    point: NDArray


class _Landing(NamedTuple):
    """A stable solution between two points of a curve, the next point in the direction of the sweep, and the way there."""

    amplitude: float
    point: int
    way: int


class _Sweep:
    """The points of a curve, by a coordinate that rises along the sweep."""

    def __init__(self, sense: float, curve: ResponseCurve) -> None:
        self.x, self.amplitude, self.branch = sense * curve.frequency, curve.amplitude, curve.branch
        stable = ~curve.backward if curve.stable is None else np.asarray(curve.stable, bool)
        self.fold = np.array([kind == "fold" for kind in curve.point_kind], bool)
        self.held = stable | self.fold  # at a fold itself rounding decides
        joined = (self.branch[:-1] == self.branch[1:]) & self.held[:-1] & self.held[1:]
        self.joined = joined & ~(self.fold[:-1] & self.fold[1:])

    def landings(self, x: float) -> list[_Landing]:
        """Stable solutions from which the sweep can go on, the lowest first: a branch that ends at x is none."""
        found: list[_Landing] = []
        # relative difference of amplitudes below which two places of a curve at one frequency are one solution
        same = 1e-6
        points, heights = crossed(self.x, self.amplitude, x, self.joined)
        for i, height in zip(points.tolist(), heights.tolist()):
            way = 1 if self.x[i + 1] > self.x[i] else -1
            if max(self.x[i], self.x[i + 1]) > x and all(abs(height - other.amplitude) > same * height for other in found):
                found.append(_Landing(height, i + 1 if way > 0 else i, way))
        return sorted(found)

    def onward(self, point: int, way: int) -> int | None:
        """The next point on the branch, if the sweep can go there."""
        new = point + way
        if not 0 <= new < len(self.x) or self.branch[new] != self.branch[point]:
            return None
        return new if self.held[new] and self.x[new] >= self.x[point] else None


def sweep_of(curve: ResponseCurve, direction: str) -> SlowSweep:
    """The response that a slow sweep of frequency shows of a response curve.

    Points count as stable by ``curve.stable``, or by the sign between folds where that has not been determined.

    Parameters
    ----------
    curve : ResponseCurve
    direction : {"up", "down"}

    Returns
    -------
    SlowSweep
        Without points where no stable solution is known at the end from which the sweep sets off.
    """
    validation.choice("direction", direction, ("up", "down"))
    sense = 1.0 if direction == "up" else -1.0
    sweep = _Sweep(sense, curve)
    options = sweep.landings(float(sweep.x.min())) if len(sweep.x) else []
    if not options:
        none = np.zeros(0)
        return SlowSweep(none, none, (), none.astype(int))
    here, x = options[0], float(sweep.x.min())
    places, jumps = [(x, here.amplitude, here.point)], []
    while True:
        point: int | None = here.point
        while point is not None:
            last = point
            places.append((float(sweep.x[last]), float(sweep.amplitude[last]), last))
            point = sweep.onward(last, here.way)
        x, height, _ = places[-1]
        if x >= sweep.x.max():
            break
        options = sweep.landings(x)
        lower = [option for option in options if option.amplitude <= height]
        here = lower[-1] if lower else options[0] if options else _Landing(np.nan, 0, 0)
        jumps.append(Jump(sense * x, height, here.amplitude))
        if not options:
            break
        places.append((x, here.amplitude, here.point))
    passed, height_there = np.array([place[:2] for place in places]).T
    numbers = np.array([place[2] for place in places])
    return SlowSweep(sense * passed, height_there, tuple(jumps), numbers)
