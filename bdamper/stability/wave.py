"""Growing disturbances along a curve of travelling waves: which points are judged, and which follow from their neighbours.

The number of growing disturbances (:mod:`bdamper.stability.disturbances`) changes along a branch only where an exponent
crosses the imaginary axis.  So it is not counted everywhere:

- where no slider moves and no contact changes, the equations are linear with symmetric stiffness and nothing grows;
- elsewhere every fourth point is judged, and then the middle between two judged ones until they are neighbours or until
  nothing hints at a crossing between them.  Hints are another count, a sign of ``det J`` between them that is not that of
  both, and a fastest growth (real part of the rightmost exponent) that changes by more than twice the smaller of the two
  sizes or is not known.

What lies between two judged points takes their common verdict.  A stretch of other stability that is shorter than the
distance of judged points, that does not change the sign of ``det J`` and does not show in the growth beside it is passed
over; points that are all given a branch of their own are all judged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.system import Sector
from bdamper.stability.disturbances import WaveDisturbances

STRIDE = 4
FACTOR = 2.0
"""Change of the fastest growth, beside the smaller of both, from which on the middle is judged."""


@dataclass
class Verdict:
    """What is known at one point.

    Parameters
    ----------
    count : int
        Growing disturbances; -1 where they could not be counted.
    growth : float, 1/rad
        Largest real part of an exponent over omega; NaN where it is not known.
    """

    count: int
    growth: float


def rests(system: Equations[Sector], u: NDArray) -> bool:
    """Whether no slider moves and every contact is closed or open all through the cycle, on springs that only resist."""
    if not system.structure.exact:
        return False
    a = system.structure.arrays
    if min(a["kt"].min(initial=0.0), a["kn"].min(initial=0.0), a["damping"].min(initial=0.0)) < 0.0:
        return False
    _, _, shares = system.contact(np.asarray(u))
    slips = (a["kt"] > 0.0) & (a["mu"] > 0.0)[:, None] & (shares[:, [1, 3]] > 0.0)
    changes = (shares[:, 4] > 0.0) & (shares[:, 4] < 1.0)
    return not (slips.any() or changes.any())


class Judge:
    """Counts growing disturbances at points of one system, each with the exponents of the nearest point as a start.

    Parameters
    ----------
    system : Equations[Sector]
    unknowns : (n, n_unknowns) float
    omega : (n,) float, rad/s
    neutral : float, 1/rad
        Growth that counts as none.
    """

    def __init__(self, system: Equations[Sector], unknowns: NDArray, omega: NDArray, neutral: float) -> None:
        self.system, self.unknowns, self.omega, self.neutral = system, unknowns, omega, neutral
        self.known: dict[int, Verdict] = {}
        self._roots: dict[int, NDArray] = {}

    def __call__(self, i: int) -> Verdict:
        if i not in self.known:
            near = min(self._roots, key=lambda j: abs(j - i), default=-1)
            omega = float(self.omega[i])
            rate, band = self.neutral * omega, (self.system.n_harmonics + 1) * omega
            disturbed = WaveDisturbances(self.system, self.unknowns[i], omega)
            try:
                count, roots = disturbed.growing(rate, band, self._roots.get(near))
            except FloatingPointError:
                return self.known.setdefault(i, Verdict(-1, np.nan))
            known = count == disturbed.right(roots, rate, band)
            self._roots[i] = roots
            self.known[i] = Verdict(count, disturbed.fastest(roots, band) / omega if known else np.nan)
        return self.known[i]


def judged_along(
    judge: Callable[[int], Verdict], positive: Callable[[int], bool], moving: NDArray, branch: NDArray
) -> tuple[NDArray, NDArray]:
    """Counts of the points that move, judged or taken from both neighbours.

    Parameters
    ----------
    judge : callable
        Verdict on point i.
    positive : callable
        Whether det J is positive at point i.
    moving : (n,) bool
        Points to judge.
    branch : (n,) int
        Points that follow each other with one value lie on one branch.

    Returns
    -------
    grows : (n,) int
        Growing disturbances in all; -1 where they could not be counted.
    asked : (n,) bool
        Points that were judged.
    """
    n = len(moving)
    grows, asked = np.zeros(n, int), np.zeros(n, bool)

    @cache
    def sign(i: int) -> bool:
        return positive(i)

    start = 0
    while start < n:
        end = start
        while end + 1 < n and branch[end + 1] == branch[start] and moving[end + 1] == moving[start]:
            end += 1
        if moving[start]:
            places = sorted({*range(start, end, STRIDE), end})
            stack = list(zip(places, places[1:]))[::-1]
            for i in places:
                grows[i], asked[i] = judge(i).count, True
            while stack:
                a, b = stack.pop()
                if b - a < 2:
                    continue
                if _doubtful(judge(a), judge(b), b - a) or len({sign(i) for i in range(a, b + 1)}) > 1:
                    middle = (a + b) // 2
                    grows[middle], asked[middle] = judge(middle).count, True
                    stack += [(middle, b), (a, middle)]
                else:
                    grows[a + 1 : b] = grows[a]
        start = end + 1
    return grows, asked


def _doubtful(a: Verdict, b: Verdict, apart: int) -> bool:
    """Whether the count may change and change back between two verdicts so many points apart."""
    if a.count != b.count or a.count < 0:
        return True
    change, least = abs(a.growth - b.growth), min(abs(a.growth), abs(b.growth))
    return change > FACTOR * least if np.isfinite(change) else apart > 2
