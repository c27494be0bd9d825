"""Peaks on the response curve at one preload, by following it over a frequency interval.

A curve is followed from the ends of the interval (:func:`bdamper.continuation.track.track`), or both ways from a peak that
is known already at this preload.  It is followed coarsely, since its peaks are refined afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.coverage import SHARE, Coverage, Piece
from bdamper.continuation.curve import Curve, uninterrupted
from bdamper.continuation.path import ContinuationOptions, PathPoint
from bdamper.continuation.rattle import open_at_rest, rattles
from bdamper.continuation.track import track
from bdamper.harmonic_balance.linear import linear_resonances
from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.peaks.newton import Peak, PeakOptions, coarse_options, peak_scale, refine_maxima
from bdamper.problem.problem import Problem
from bdamper.util.cost import CostMeter
from bdamper.util.repr import brief

FROM_WITHIN = ContinuationOptions(
    tolerance=1e-4,
    step=0.1,
    max_step=0.2,
    max_turn=0.6,
    patience=45,
    locate_tolerance=0.1,
    corner_step=0.1,
    locate_folds=False,
)
"""Settings with which a curve is followed from a known solution.  With those of curves from the ends two curves of the
shipped disk (9 points, one harmonic, 12 preloads) keep their values, for 4 % fewer and 0.4 % more evaluations."""
PASSED = 0.1
"""Distance, relative to its vibration, at which a curve passes a peak.  With 0.03 and 0.3 the same two curves keep their
values."""
COMPLETE = "complete"
"""Ending of a curve that was followed from end to end of the interval."""
CORNERS = {"drift": "where the mean position drifts", "maximum": "at a maximum without a smooth peak"}
"""Kinds of points that may be the highest of a curve without a slope that vanishes, in words."""
HIGHER = 3e-3
"""Relative, by which a point of a curve has to exceed the peaks found on it: a curve followed coarsely is off by less."""

LEVEL = 1e-6
"""Relative change of the amplitude up to which points of a curve count as one: the mean position alone moves there."""


class Above(NamedTuple):
    """A point of a response curve that is higher than the peaks found on it.

    Parameters
    ----------
    frequency : float, Hz
    amplitude : float, m
    what : str
    corner : Peak, optional
        The point, if the mean position of the damper drifts there or a maximum was located: the curve has a corner there.
    """

    frequency: float
    amplitude: float
    what: str
    corner: Peak | None = None

    def __str__(self) -> str:
        return f"higher {self.what}, {self.amplitude:.6g} m at {self.frequency:.6g} Hz"


@brief
@dataclass(frozen=True)
class Scan:
    """Peaks found on a response curve.

    Parameters
    ----------
    peaks : tuple of Peak
        The highest first.
    ending : str
        "complete" if the curve was followed from end to end of the interval, otherwise how it ended.
    points : (n, n_unknowns + 1) float
        Of the curve, in order.
    above : Above, optional
        The highest point within the interval, if it is higher than all peaks.
    limited : bool
        A path may have ended since the budget of evaluations that was asked for was used up.
    rattles : str
        Why no steady periodic response is expected, if the curve shows the sign (:mod:`bdamper.continuation.rattle`).
    """

    peaks: tuple[Peak, ...]
    ending: str
    points: NDArray
    above: Above | None = None
    limited: bool = False
    rattles: str = ""

    @property
    def whole(self) -> bool:
        """Whether the curve was followed from end to end and its highest peak is the highest point within the interval."""
        return self.ending == COMPLETE and self.above is None

    def passes(self, peak: Peak, n_mean: int) -> bool:
        """Whether the curve passes a peak, even if no point is marked as a maximum: a step may have passed over it."""
        vibration = self.points[:, n_mean:-1]
        a, chord = vibration[:-1], np.diff(vibration, axis=0)
        offset = peak.y[n_mean:-1] - a
        square = np.maximum(np.einsum("pi,pi->p", chord, chord), 1e-300)
        part = np.clip(np.einsum("pi,pi->p", offset, chord) / square, 0.0, 1.0)
        distance = np.linalg.norm(offset - part[:, None] * chord, axis=1)
        frequency = self.points[:, -1]
        between = frequency[:-1] + part * np.diff(frequency)
        near = np.abs(between - peak.y[-1]) < np.abs(np.diff(frequency)) + 1e-3 * peak.y[-1]
        return bool(np.any(near & (distance < PASSED * np.linalg.norm(peak.y[n_mean:-1]))))


def scan(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    options: PeakOptions | None = None,
    continuation: ContinuationOptions | None = None,
    meter: CostMeter | None = None,
) -> Scan:
    """All peaks on the response curve at one preload, which is followed from the ends of the interval.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    frequency : (low, high), Hz
    options : PeakOptions
    continuation : ContinuationOptions
        Coarse by default, since peaks are refined afterwards.
    meter : CostMeter
    """
    curve = uninterrupted(track(problem, preload, frequency, options=continuation or coarse_options()))
    if meter is not None:
        meter.add(curve.cost)
    if not len(curve):
        nothing = np.zeros((0, curve.unknowns.shape[1] + 1))
        return Scan((), f"{curve.status} ({curve.reason})", nothing, limited=_limited(curve, continuation))
    system = problem.system(preload)
    if meter is not None:
        meter.watch(system)
    peaks = refine_maxima(system, _maxima(system, curve), options=options, parameter=preload)
    points = np.column_stack([curve.unknowns, 2.0 * np.pi * curve.frequency])
    i, above = _above(peaks, curve.frequency, curve.amplitude, curve.point_kind) or (0, None)
    if above is not None and curve.point_kind[i] in CORNERS:
        above = above._replace(corner=_corner(curve, points, preload, i))
    ending = COMPLETE if curve.complete else f"{curve.status} ({curve.reason})"
    why = rattles(curve.frequency, curve.amplitude, curve.shares[:, 2], curve.branch, open_at_rest(problem, preload))
    return Scan(peaks, ending, points, above, _limited(curve, continuation), why)


def _limited(curve: Curve, continuation: ContinuationOptions | None) -> bool:
    """Whether a path of a curve may have used up its share of a budget that was asked for."""
    budget = None if continuation is None else continuation.budget
    return budget is not None and curve.cost.evaluations >= SHARE * budget


def _above(peaks: Sequence[Peak], frequency: NDArray, amplitude: NDArray, kinds: Sequence[str]) -> tuple[int, Above] | None:
    """The highest point between two lower ones of a curve, with its index, if it is higher than the peaks on the curve.

    The ends of the interval may be higher still, on the flank of a resonance beyond.
    """
    change = np.abs(np.diff(amplitude)) > LEVEL * amplitude[1:]
    places = np.flatnonzero(np.append(True, change)) if len(amplitude) else np.zeros(0, int)
    height = amplitude[places]
    tops = places[1:-1][(height[1:-1] > height[:-2]) & (height[1:-1] > height[2:])]
    inner = [int(i) for i in tops if kinds[int(i)] != "end"]
    i = max(inner, key=lambda k: float(amplitude[k]), default=0)
    if not inner or amplitude[i] <= (1.0 + HIGHER) * max((q.amplitude for q in peaks), default=0.0):
        return None
    return i, Above(float(frequency[i]), float(amplitude[i]), CORNERS.get(kinds[i], "where no maximum was located"))


def _corner(curve: Curve, points: NDArray, preload: float, i: int) -> Peak:
    """A point of a curve as a peak at a corner, which has no slope."""
    n = points.shape[1]
    return Peak(
        preload, float(curve.frequency[i]), float(curve.amplitude[i]), points[i], np.zeros(n), np.ones(n), 0.0, -np.inf,
        curve.shares[i], float(curve.residual[i]), 0, 0, int(curve.rank_deficiency[i]), True,
    )  # fmt: skip


def scan_from(
    problem: Problem,
    system: HarmonicSystem,
    start: NDArray,
    frequency: tuple[float, float],
    *,
    preload: float,
    options: PeakOptions,
    meter: CostMeter,
    share: float = 0.0,
) -> Scan:
    """Peaks on the curve through a solution, followed both ways.

    Parameters
    ----------
    problem : Problem
    system : HarmonicSystem
        Of the study at the preload.
    start : (n_unknowns + 1,) float
        Near the curve.
    frequency : (low, high), Hz
    preload : float, N
    options : PeakOptions
    meter : CostMeter
    share : float
        Maxima below this share of the highest are left out.

    Returns
    -------
    Scan
        Not complete if a path ended in a tangle of folds, on itself, or at the end of the interval that the other reached.
    """
    low, high = (2.0 * np.pi * f for f in frequency)
    system.watched = linear_resonances(system, (None, problem.stuck_springs(problem.static(preload))), low, high)
    search = Coverage(system, (low, high), FROM_WITHIN, meter)
    search.both_ways(start)
    pieces = search.pieces
    points = [p for i, piece in enumerate(pieces) for p in (piece.path.points if i else piece.path.points[::-1])]
    ends = {_end(piece) for piece in pieces}
    height = np.array([float(np.hypot(*(row @ p.y[:-1] for row in system.response_parts))) for p in points])
    least = share * float(height.max(initial=0.0))
    kept = [p for p, h in zip(points, height) if h >= least]
    peaks = refine_maxima(system, kept, options=options, parameter=preload)
    if ends >= {"low", "high"}:
        ending = COMPLETE
    else:
        ending = f"incomplete ({'; '.join(f'{piece.path.status}: {piece.path.reason}' for piece in pieces)})"
    y = np.array([p.y for p in points]).reshape(-1, len(start))
    found = _above(peaks, y[:, -1] / (2.0 * np.pi), height, [p.kind for p in points])
    why = rattles(y[:, -1], height, [p.shares[2] for p in points], None, open_at_rest(problem, preload))
    return Scan(peaks, ending, y, found and found[1], rattles=why)


def _end(piece: Piece) -> str:
    """End of the interval that a path reached."""
    if piece.path.status not in ("complete", "turned back"):
        return ""
    return "high" if (piece.path.status == "complete") == piece.up else "low"


def _maxima(system: HarmonicSystem, curve: Any) -> list[Any]:
    """Points marked as maxima, with the direction of the curve from the neighbouring points."""
    out = []
    for i, kind in enumerate(curve.point_kind):
        if kind != "maximum":
            continue
        y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
        j, k = max(i - 1, 0), min(i + 1, len(curve) - 1)
        chord = np.append(curve.unknowns[k] - curve.unknowns[j], 2.0 * np.pi * (curve.frequency[k] - curve.frequency[j]))
        n = system.n_mean
        scale = peak_scale(system, y, max(abs(float(chord[-1])), 1e-6 * y[-1]))
        chord = chord / scale
        chord[:n] = 0.0
        size = float(np.linalg.norm(chord))
        if not size > 0.0:
            continue
        out.append(
            PathPoint(y, chord / size, scale, curve.shares[i], float(curve.residual[i]), 0, int(curve.rank_deficiency[i]),
                      "maximum")
        )  # fmt: skip
    return out
