"""A sign that a damper rattles in its seat: hardly closed contacts on a response curve of many folds.

A preload that hardly holds the damper lets it fly for most of the cycle and come down at other instants from one period to
the next.  Harmonic balance then finds many periodic solutions, which the curve connects by folds, and a march in time from
the highest of them finds no steady amplitude.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

NO_STEADY = "no steady periodic response"
FOLDS = 12
"""Turning points of a curve in frequency from which on it is a tangle."""
OPEN = 0.5
"""Share of the cycle that the contacts are open at the highest response, mean over the friction points."""


def rattles(frequency: ArrayLike, amplitude: ArrayLike, share_open: ArrayLike, branch: ArrayLike | None = None) -> str:
    """Why no steady periodic response is expected at the preload of a curve; "" without the sign.

    Parameters
    ----------
    frequency, amplitude, share_open : (n,) float
        Of the points in the order of their paths.
    branch : (n,) int, optional
        Points of different branches are not connected.
    """
    omega, height = np.asarray(frequency, float), np.asarray(amplitude, float)
    if len(omega) < FOLDS:
        return ""
    step = np.sign(np.diff(omega))
    step = step[(step != 0.0) & (True if branch is None else np.diff(branch) == 0)]
    folds, opened = int(np.count_nonzero(np.diff(step))), float(np.asarray(share_open)[height.argmax()])
    if folds < FOLDS or opened <= OPEN:
        return ""
    return f"{folds} folds, and the contacts open for {100.0 * opened:.0f} % of the cycle at the highest response"
