"""Stability from the motion in time: does a blade that starts at a solution stay there?

Harmonic balance gives a motion of ``H`` harmonics; the motion that the equations have next to it in time has a sequence of
stick, slip and separation of its own.  It is started at the solution with a disturbance of every nodal diameter and
marched until ``bdamper.stability.march.judged`` decides (``bdamper.stability.settled.verified``).  A damper without
damping of its own chatters at many points next to separated peaks, without any period; what counts there is the amplitude
to which this leads, averaged over many periods.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.problem.problem import Problem
from bdamper.stability.march import AGREES, BOUNDS, DIFFERS, UNDECIDED
from bdamper.stability.settled import march_from, verified
from bdamper.stability.time_integration import MarchFailed, ring_of
from bdamper.stability.wave import Verdict
from bdamper.util.progress import LongWork, each

COUNTS = {verdict: i for i, verdict in enumerate((AGREES, DIFFERS, UNDECIDED))}
"""Verdicts as numbers of growing disturbances."""


class InTimeJudge:
    """Verdicts on points of one curve for :func:`~bdamper.stability.wave.judged_along`.

    After Ctrl-C every further point is undecided, as is one at which a march fails.

    Attributes
    ----------
    known : dict of int to (str, float)
        Verdict and mean amplitude in time over that of the solution.

    Raises
    ------
    SettingError
        At once, if the settings describe something else than a structure in time.
    """

    def __init__(self, problem: Problem, curve: Curve, progress: bool) -> None:
        self.curve, self.ring, self.system = curve, ring_of(problem, curve.preload), problem.system(curve.preload)
        self.known: dict[int, tuple[str, float]] = {}
        self.interrupted = False
        self._bar = iter(each(range(len(curve)), progress, "motion in time", "point"))

    def __call__(self, i: int) -> Verdict:
        if i not in self.known:
            with LongWork() as work:
                if not self.interrupted:
                    self.known[i] = self._judged(i)
                    next(self._bar)
            self.interrupted |= work.interrupted
            if self.interrupted:
                self.known.pop(i, None)
                return Verdict(COUNTS[UNDECIDED], math.nan)
        verdict, ratio = self.known[i]
        return Verdict(COUNTS[verdict], abs(ratio - 1.0) - BOUNDS.tolerance)

    def _judged(self, i: int) -> tuple[str, float]:
        u, omega = self.curve.unknowns[i], 2.0 * np.pi * float(self.curve.frequency[i])
        expected = self.system.response(u)
        if not abs(expected[1]) > 0.0:
            return UNDECIDED, math.nan
        try:
            found = verified(march_from(self.ring, u, omega, BOUNDS.steps), expected)
        except MarchFailed:
            return UNDECIDED, math.nan
        return found.verdict, float(found.amplitude[-BOUNDS.settled :].mean() / found.balance)

    def ratios(self, verdicts: NDArray, branch: NDArray) -> NDArray:
        """(n,) amplitude in time over that of the solution; 1 where nothing slips or opens, by interpolation between stable
        points that were judged, NaN at other points that were not judged and at those that are undecided.
        """
        out = np.ones(len(verdicts))
        judged = np.array(sorted(self.known), int)
        ratio = np.array([self.known[int(i)][1] for i in judged])
        for b in np.unique(branch):
            own = branch[judged] == b
            inside = np.flatnonzero(branch == b)
            if own.any():
                inside = inside[(inside >= judged[own].min()) & (inside <= judged[own].max())]
                out[inside] = np.interp(inside, judged[own], ratio[own])
        out[verdicts != COUNTS[AGREES]] = np.nan
        out[judged] = np.where(verdicts[judged] == COUNTS[UNDECIDED], np.nan, ratio)
        return out
