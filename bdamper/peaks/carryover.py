"""A peak of a system found from that of a simpler one.

Newton's method, at the phase of the simpler response, which follows a resonance that moves, or at its frequency, leads to a
solution near the top, from which the maximum is sought uphill.  The curve through it may have a higher one close by, over
folds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.system import OK, Correction, HarmonicSystem
from bdamper.continuation.follower import follow
from bdamper.continuation.path import ContinuationOptions, PathPoint
from bdamper.peaks.newton import Peak, PeakOptions, amplitude_and_phase, find_peak, peak_scale

STAYS_UP = 0.87
"""Share of the amplitude of a peak down to which the curve through it is followed to both sides."""
LOOSE = PeakOptions(tolerance=1e-8, position_tolerance=1e-3)
ROUGH = ContinuationOptions(tolerance=1e-6, step=0.1, max_step=0.3, max_turn=0.6, locate=False)
AROUND = replace(ROUGH, locate=True, locate_folds=False, locate_tolerance=0.05, corner_step=0.1)
"""How a curve is followed to both sides of a peak, or where only its maxima matter."""
BOTH_WAYS = (True, False)
"""Up and down in frequency, as a curve sets off."""
ITSELF = 1e-4
"""Relative differences in frequency and amplitude up to which a maximum of the curve through a peak is that peak."""


class _Downhill(Exception):
    """A curve has left the neighbourhood of its top."""


def solutions_near(
    system: HarmonicSystem, guesses: list[NDArray], start: NDArray, width: float, quick: bool = False
) -> Iterator[Correction]:
    """Solutions of a system near that of a simpler one, ``start``.

    Newton is tried at the phase of the simpler one, which follows a resonance that moves, from each guess and then with
    line search; then, unless ``quick``, at its frequency.
    """
    phase, scale = phase_plane(system, start, width)
    fixed = np.zeros(len(start))
    fixed[-1] = 1.0
    tries = [(guess, phase, False) for guess in guesses]
    tries += [(start, phase, True)] if quick else [(start, phase, True), (start, fixed, False), (start, fixed, True)]
    for guess, plane, search in tries:
        c = system.correct(guess, plane, scale, 1e-6, 25 if search else LOOSE.max_iterations, search)
        if c.status == OK and _near(c.y, start, scale):
            yield c


def phase_plane(system: HarmonicSystem, y: NDArray, width: float) -> tuple[NDArray, NDArray]:
    """Normal of the plane in which the phase of the response is that of a point, and the units that it is in."""
    _, normal, _ = amplitude_and_phase(system, y[:-1])
    scale = peak_scale(system, y, width)
    phase = np.append(normal, 0.0) * scale
    return phase / np.linalg.norm(phase), scale


def carried_over(
    system: HarmonicSystem, guesses: list[NDArray], start: NDArray, width: float, quick: bool = False
) -> Peak | None:
    """The peak of a system that one of the solutions near that of a simpler one leads to (:func:`solutions_near`)."""
    for solution in solutions_near(system, guesses, start, width, quick):
        peak = find_peak(system, solution.y, options=LOOSE, drift=False)
        if peak.converged:
            return peak
    return None


def higher_nearby(
    system: HarmonicSystem,
    peak: Peak,
    share: float = STAYS_UP,
    most: int = 200,
    on_path: Callable[[list[PathPoint]], None] | None = None,
    ways: Sequence[bool] = BOTH_WAYS,
) -> Peak:
    """The highest maximum of the curve through a peak, over folds, as far as it stays above a share of the highest.

    Parameters
    ----------
    system : HarmonicSystem
    peak : Peak
    share : float
    most : int
        Points to each side.
    on_path : callable
        Called with the points to each side.
    ways : sequence of bool
        Which to follow: True is up in frequency, as the curve sets off.
    """
    best = peak
    for up in ways:
        points, heights = _downhill(system, peak, up, share * best.amplitude, most)
        if on_path is not None:
            on_path(points)
        for i in range(1, len(heights) - 1):
            if max(abs(points[i].y[-1] / peak.y[-1] - 1.0), abs(heights[i] / peak.amplitude - 1.0)) < ITSELF:
                continue
            if heights[i - 1] < heights[i] >= heights[i + 1] and heights[i] > 0.98 * best.amplitude:
                found = find_peak(system, points[i].y, options=LOOSE, drift=False)
                if not found.converged and points[i].kind == "maximum":
                    found = as_located(found, points[i].y, heights[i], points[i].residual)
                if found.converged and found.amplitude > best.amplitude:
                    best = found
    return best


def _downhill(
    system: HarmonicSystem, peak: Peak, up: bool, lowest: float, most: int
) -> tuple[list[PathPoint], list[float]]:
    """Points of the curve to one side of a peak down to an amplitude, and their amplitudes."""
    row = system.response_rows[1]
    points: list[PathPoint] = []
    heights: list[float] = []

    def note(point: PathPoint) -> None:
        points.append(point)
        heights.append(float(abs(system.amplitudes(point.y[:-1], 1) @ row)))
        if heights[-1] < lowest:
            raise _Downhill

    limits = 0.7 * peak.y[-1], 1.4 * peak.y[-1]
    with suppress(_Downhill):
        follow(system, peak.y, limits, up=up, options=replace(AROUND, max_points=most), on_point=note)
    return points, heights


def _near(y: NDArray, start: NDArray, scale: NDArray) -> bool:
    return abs(y[-1] / start[-1] - 1.0) < 0.2 and float(np.linalg.norm((y - start)[:-1] / scale[:-1])) < 2.0


def as_located(peak: Peak, y: NDArray, amplitude: float, residual: float) -> Peak:
    """The peak that a search did not find to the last digit, as it was located on a curve."""
    return replace(
        peak, y=y, frequency=float(y[-1] / (2.0 * np.pi)), amplitude=amplitude, residual=residual, status="converged"
    )
