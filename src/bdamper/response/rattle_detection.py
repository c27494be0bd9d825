"""A sign that a damper rattles in its seat: hardly closed contacts on a response curve of many folds.

A preload that hardly holds the damper lets it fly for most of the cycle and come down at other instants from one period to
the next.  Harmonic balance then finds many periodic solutions, which the curve connects by folds, and a march in time from
the highest of them finds no steady amplitude.

It is a sign, no proof, and it comes late (docs/measured.md, *Where a damper rattles*): on none of the 11 curves of 84 that
show it does the marched amplitude become steady within 250 periods, and on 18 of the others neither.
"""

from __future__ import annotations

import numpy as np

from bdamper.harmonic_balance.problem import Problem
from bdamper.response.curve import ResponseCurve

NO_STEADY = "no steady periodic response"
FOLDS = 14
"""Turning points of a curve in frequency from which on it is a tangle.  With 12 the same 11 of 84 curves show the sign, but
an optimal curve ends at 49 N instead of 42 N, and a march at 50 N comes to rest."""
OPEN = 0.5
"""Share of the cycle that the contacts are open at the highest response, mean over the friction points that are closed at
rest: over rotor speed the faces of most points may part before anything vibrates.  Without this
limit three more of the 84 curves show the sign, and on one of them the marched amplitude is steady."""


def open_at_rest(problem: Problem, preload: float) -> float:
    """Share of the friction points that are open in the static state of a preload."""
    closed = problem.static(preload).force[problem.friction_points, 2] > 0.0
    return 1.0 - float(closed.mean()) if closed.any() else 0.0


def rattles(curve: ResponseCurve, at_rest: float = 0.0) -> str:
    """Why no steady periodic response is expected at the preload of a curve; "" without the sign.

    Parameters
    ----------
    curve : ResponseCurve
        Points of different branches are not connected.
    at_rest : float
        Share that is open without vibration (:func:`open_at_rest`).
    """
    if len(curve) < FOLDS:
        return ""
    step = np.sign(np.diff(curve.frequency))[np.diff(curve.branch) == 0]
    folds = int(np.count_nonzero(np.diff(step[step != 0.0])))
    opened = float(curve.shares[curve.amplitude.argmax(), 2])
    if folds < FOLDS or opened - at_rest <= OPEN * (1.0 - at_rest):
        return ""
    return f"{folds} folds, and the contacts open for {100.0 * opened:.0f} % of the cycle at the highest response"
