"""A solution at one frequency by way of fewer harmonics.

With its highest harmonic held fast the equations are those without it.  The support, a drag and a mass times ``1/s - 1``,
fades along a path from ``s = 0``, at a solution with fewer harmonics, to ``s = 1``.  Such paths have no loose ends: one
that does not arrive comes back to ``s = 0`` at another solution with fewer harmonics, and with another support a path
leads on from there.  Where solutions are bounded their number is odd (at low excitation there is one), so under every
support at least one leads to more harmonics; it need not be one that is known already.

Which paths are short is not known beforehand, so all get few points before any gets more, and of equal ones those with more
harmonics come first.
"""

from __future__ import annotations

from dataclasses import replace
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.system import OK, HarmonicSystem
from bdamper.continuation.follower import ContinuationOptions, follow
from bdamper.util.cost import CostMeter

SUPPORTS = ((0.2, 0.0), (0.0, 1.0), (2.0, 0.0), (1.0, 1.0), (0.0, 10.0), (20.0, 0.0))
"""Drag and mass by which the highest harmonic is held."""
HELD = 2e-4
"""Where paths set off and come back to."""
POINTS = 300
"""Of each path at first; a path that takes more gets MORE times as many when its turn comes again."""
MORE = 4
MOST_POINTS = 100_000
"""Of all paths."""
SAME = 1e-5
"""Relative distance of two solutions that are one."""


class Ladder:
    """Solutions with more and more harmonics, and the paths between them that are still to be followed.

    Parameters
    ----------
    system : HarmonicSystem
        With all harmonics.
    omega : float, rad/s
    options : ContinuationOptions
    meter : CostMeter
    """

    def __init__(self, system: HarmonicSystem, omega: float, options: ContinuationOptions, meter: CostMeter) -> None:
        self.omega, self.meter = omega, meter
        self.options = replace(options, locate=False)
        rungs = [l for l in range(1, system.n_harmonics + 1) if len(system.bases[l].omega2)]
        self.systems = [*(system.with_harmonics(l) for l in rungs[:-1]), system]
        for few in self.systems[:-1]:
            meter.watch(few)
        self.held = [[many.letting_in(omega, *by) for by in SUPPORTS] for many in self.systems[1:]]
        self.solutions: list[list[NDArray]] = [[] for _ in self.systems]
        self.points = self.paths = 0
        self._waiting: list[tuple[int, int, int, int]] = []
        self._came_back: set[tuple[int, int, int]] = set()

    def add(self, rung: int, u: NDArray) -> int:
        """Number of a solution among those with so many harmonics."""
        n = self.systems[rung].n_mean
        for k, known in enumerate(self.solutions[rung]):
            if np.linalg.norm(known - u) < SAME * np.linalg.norm(u[n:]):
                return k
        self.solutions[rung].append(u)
        k = len(self.solutions[rung]) - 1
        if rung + 1 < len(self.systems):
            for by in range(len(SUPPORTS)):
                heappush(self._waiting, (POINTS, -rung, by, k))
        return k

    def add_near(self, rung: int, guess: NDArray) -> int | None:
        """The same of the solution that Newton's method leads to from a guess, if there is one."""
        system = self.systems[rung]
        c = system.correct_at(guess, self.omega, self._scale(system, guess, self.omega), self.options.tolerance, 60, True)
        self.meter.iterations += c.iterations
        return self.add(rung, c.y[:-1]) if c.status == OK else None

    def climb(self, most: int | None = None) -> NDArray | None:
        """A solution with all harmonics, if a path leads to one before they have taken so many points (MOST_POINTS)."""
        while self._waiting and self.points < (most or MOST_POINTS) and not self.solutions[-1]:
            points, below, by, k = heappop(self._waiting)
            if (-below, by, k) not in self._came_back:
                self._path(points, -below, by, k)
        return self.solutions[-1][0] if self.solutions[-1] else None

    def _path(self, points: int, rung: int, by: int, k: int) -> None:
        """Follows the path from one solution under one support."""
        few, held = self.systems[rung], self.held[rung][by]
        u = np.zeros(held.n_unknowns)
        u[: few.n_unknowns] = self.solutions[rung][k]
        start = held.correct_at(u, HELD, self._scale(few, u, HELD), self.options.tolerance, 60, True)
        self.meter.iterations += start.iterations
        if start.status != OK:
            return
        options = replace(self.options, max_points=points, patience=points)
        path = follow(held, start.y, (0.5 * HELD, 1.0), options=options)
        self.meter.iterations += path.iterations
        self.meter.failed_steps += path.failed_steps
        self.points += len(path.points)
        self.paths += 1
        if path.status == "complete":
            self.add(rung + 1, path.points[-1].y[:-1])
        elif path.status == "turned back":
            back = self.add_near(rung, path.points[-1].y[: few.n_unknowns])
            if back is not None:
                self._came_back.add((rung, by, back))
        elif path.status in ("too many points", "tangle"):
            heappush(self._waiting, (MORE * points, -rung, by, k))

    def _scale(self, system: HarmonicSystem, u: NDArray, last: float) -> NDArray:
        scale = np.full(len(u) + 1, max(float(np.linalg.norm(u[system.n_mean :])), 1e-300))
        scale[-1] = last
        return scale
