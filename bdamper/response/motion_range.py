"""Half of the peak-to-peak displacement of a motion with several harmonics.

At a superharmonic resonance, for example at a third of the natural frequency, higher harmonics
increase the displacement by half of the first harmonic.  Amplitudes of results belong to the first
harmonic, so a result also gives half of the range if its ratio to the amplitude exceeds
:data:`NAMED`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NAMED = 1.1
"""Half of the range over the amplitude of the first harmonic above which results name it."""
SAMPLES = 64
"""Samples in a period of the highest harmonic.  A parabola through the three highest samples gives
the extremum, with an error of at most 2e-6 of the amplitude of this harmonic.
"""


def half_range(harmonics: NDArray) -> NDArray:
    """Return half of the difference (...,) of highest and lowest displacement over a period.

    Parameters
    ----------
    harmonics : (..., n_harmonics + 1) complex
        Complex amplitudes; the first column is the mean.
    """
    orders = np.arange(1, harmonics.shape[-1])
    if len(orders) == 1:
        return np.asarray(np.abs(harmonics[..., 1]))
    theta = np.linspace(0.0, 2.0 * np.pi, SAMPLES * len(orders), endpoint=False)
    # samples (..., n_samples) of the motion without the mean
    waves = np.exp(1j * np.outer(orders, theta))
    x = (harmonics[..., 1:] @ waves).real
    # the maximum of -x is minus the minimum of x
    return np.asarray(0.5 * (_highest(x) + _highest(-x)))


def _highest(x: NDArray) -> NDArray:
    """Return the maxima (...,) of periodic samples (..., n).

    Each is the vertex of the parabola through the highest sample and its two neighbours.
    """
    n = x.shape[-1]
    # index of the highest sample, (..., 1)
    top = x.argmax(axis=-1, keepdims=True)
    before = np.take_along_axis(x, (top - 1) % n, axis=-1)[..., 0]
    highest = np.take_along_axis(x, top, axis=-1)[..., 0]
    after = np.take_along_axis(x, (top + 1) % n, axis=-1)[..., 0]
    bend = before - 2.0 * highest + after
    # three equal samples have no vertex
    flat = bend == 0.0
    bend_or_one = np.where(flat, 1.0, bend)
    # the vertex is above the highest sample, because bend is negative
    vertex_offset = (after - before) ** 2 / (8.0 * bend_or_one)
    return np.asarray(highest - np.where(flat, 0.0, vertex_offset))


def exceeds(half: float, amplitude: float) -> bool:
    """Return whether half of the range (m) exceeds the amplitude (m) enough to be named."""
    return bool(half > NAMED * amplitude)
