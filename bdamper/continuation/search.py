"""Following the branches of a response curve from wherever one can start.

From an end of the interval; beyond a tangle of folds; a little outside the interval, where a branch may turn and come
back; from within what is left without solutions; from solutions that lie on none of the branches.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.system import OK, Correction, HarmonicSystem
from bdamper.continuation.coverage import TWO_PI, Piece, finished, uncovered
from bdamper.continuation.follower import ContinuationOptions, Interrupted, Path, PathPoint, follow
from bdamper.util.cost import CostMeter

BEYOND = 0.03
"""Part of the interval at each end, outside of it, in which folds are looked for."""
LOOK = 60
"""Points that are spent on it."""
ENTRIES = 4
"""Times a curve may enter the interval."""
ARRIVED = ("complete", "turned back")
PLACES = ((0.5, 0.2, 0.8, 0.05, 0.95), (0.35, 0.65, 0.12), (0.88, 0.27, 0.73))
"""Where in a gap solutions are looked for, visit by visit."""
ASKED = 3
"""Of the places of a visit, those at which the chain of the first point is asked; Newton's method is tried at all."""
EVERY_VISIT = frozenset(range(len(PLACES)))
CLOSE = 0.05
"""A place nearer than this part of the gap to one that was asked in vain on the same visit is not asked again."""
WIDE = 0.1
"""Part of the interval above which a gap in which nothing was found is not visited again."""

Visits = frozenset[int]
FindStart = Callable[[float, Visits], NDArray | None]
"""The chain of the first point, by frequency (rad/s) and the visits that a call stands for."""


@dataclass
class BranchSearch:
    """What is followed, how, and the pieces found so far.

    Parameters
    ----------
    system : HarmonicSystem
    limits : (low, high), rad/s
    options : ContinuationOptions
    meter : CostMeter
    on_point : callable, optional
        Called with every accepted point.
    pieces : list of Piece
    log : list of str
        From where paths set off besides the ends.
    """

    system: HarmonicSystem
    limits: tuple[float, float]
    options: ContinuationOptions
    meter: CostMeter
    on_point: Callable[[PathPoint], None] | None = None
    pieces: list[Piece] = field(default_factory=list)
    log: list[str] = field(default_factory=list)

    @property
    def finished(self) -> bool:
        """Whether nothing is left to be followed."""
        return finished(self.pieces, *self.limits)

    @property
    def _width(self) -> float:
        return self.limits[1] - self.limits[0]

    def _next_branch(self) -> int:
        return max((p.branch for p in self.pieces), default=-1) + 1

    def _note(self, omega: float, text: str) -> None:
        self.log.append(f"{omega / TWO_PI:.6g} Hz: {text}")

    def _solve(self, guess: NDArray, omega: float, scale: NDArray, iterations: int, line_search: bool) -> Correction:
        c = self.system.correct_at(guess, omega, scale, self.options.tolerance, iterations, line_search)
        self.meter.iterations += c.iterations
        return c

    def _path(
        self, start: NDArray, limits: tuple[float, float], up: bool, options: ContinuationOptions, watched: bool
    ) -> Path:
        path = follow(self.system, start, limits, up=up, options=options, on_point=self.on_point if watched else None)
        self.meter.iterations += path.iterations
        self.meter.failed_steps += path.failed_steps
        return path

    def _follow(self, start: NDArray, up: bool, branch: int | None = None, inside: bool = False) -> Path:
        """Adds one path, also if Ctrl-C ends it."""
        stop = None
        try:
            path = self._path(start, self.limits, up, self.options, True)
        except Interrupted as interrupted:
            stop, path = interrupted, interrupted.path
            self.meter.iterations += path.iterations
            self.meter.failed_steps += path.failed_steps
        self.pieces.append(Piece(path, up, self._next_branch() if branch is None else branch, inside))
        if stop is not None:
            raise stop
        return path

    # ---- from a solution ----

    def from_end(self, start: NDArray, up: bool) -> None:
        """Adds the path from an end of the interval.

        A path that arrives at the start of an earlier one replaces it: it is the same branch, followed further.
        """
        path = self._follow(start, up)
        if path.status == "complete" and path.points:
            last = path.points[-1]
            for piece in self.pieces[:-1]:
                first = piece.path.points[0] if piece.path.points else None
                if first is not None and not piece.inside and np.linalg.norm((first.y - last.y) / last.scale) < 1e-6:
                    self.pieces.remove(piece)
            del self.pieces[-1]
            self.pieces.append(Piece(path, up, self._next_branch()))

    def both_ways(self, start: NDArray) -> None:
        """Adds the branch through a solution within the interval, followed both ways."""
        branch = self._next_branch()
        for up in (True, False):
            if self._follow(start, up, branch, True).status == "closed":
                return

    # ---- where paths end ----

    def leap(self) -> None:
        """Goes on beyond a tangle of folds that the last path was left in: from its farthest point, a little further on."""
        for _ in range(4):
            last = self.pieces[-1]
            if last.path.status != "tangle" or last.inside:
                return
            sense = 1.0 if last.up else -1.0
            front = max(last.path.points, key=lambda p: sense * p.y[-1])
            for distance in (2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2):
                omega = front.y[-1] + sense * distance * self._width
                if not self.limits[0] < omega < self.limits[1]:
                    return
                c = self._solve(front.y[:-1], omega, front.scale, 60, True)
                if c.status == OK:
                    break
            else:
                return
            self._note(omega, "set off again beyond a tangle of folds")
            path = self._follow(c.y, last.up)
            if path.status == "tangle" and (path.points[-1].y[-1] - front.y[-1]) * sense <= 0.0:
                reach = max(sense * p.y[-1] for p in path.points)
                if reach <= sense * front.y[-1] + 1e-3 * self._width:
                    return

    def beyond_ends(self) -> None:
        """Looks for folds a little outside the interval, from which a branch comes back into it, and follows it there."""
        low, high = self.limits
        margin = BEYOND * self._width
        look = replace(self.options, locate=False, max_points=LOOK, patience=LOOK, step=0.5, max_step=1.0)
        seen: list[PathPoint] = []
        while len(seen) < 2 * ENTRIES:
            paths = [piece.path.points for piece in self.pieces if piece.path.status in ARRIVED]
            ends = (p for points in paths for p in (points[0], points[-1]))
            end = next((p for p in ends if p.y[-1] in self.limits and not any(_same(p.y, q) for q in seen)), None)
            if end is None:
                return
            seen.append(end)
            up = end.y[-1] == high
            path = self._path(end.y, (high, high + margin) if up else (max(low - margin, 0.5 * low), low), up, look, False)
            back = path.points[-1] if path.points else end
            if path.status != "turned back" or any(_same(back.y, q) for q in seen):
                continue
            seen.append(back)
            self._note(back.y[-1], "the branch turns outside the interval and comes back")
            self._follow(back.y, not up)

    # ---- what is left without solutions ----

    def fill(self, find_start: FindStart) -> None:
        """Looks for solutions in what is left without and follows them both ways.

        At a few frequencies in the widest gap: Newton with line search from solutions on both sides, then the chain that
        finds the first point of a curve.  A narrow gap in which nothing is found is visited again, at other frequencies,
        after the others; a wide one is left.  All are left once the chain was called ``searches`` times, or after as many
        visits.  The chain is told which visits a call stands for (all at once, in a wide gap), as each has ways of its own
        that take long; what they were asked in vain they are not asked again.
        """
        if self.finished:
            return
        vain: list[tuple[float, Visits]] = []
        visits: Counter[tuple[float, float]] = Counter()
        tries = iter(range(self.options.searches))
        for _ in range(self.options.searches):
            gaps = [g for g in uncovered(self.pieces, *self.limits) if visits[g] < (1 if self._wide(g) else len(PLACES))]
            if not gaps:
                return
            gap = min(gaps, key=lambda g: (visits[g], g[0] - g[1]))
            found = self._within(gap, visits[gap], find_start, tries, vain)
            if found is None:
                visits[gap] += 1
                continue
            self._note(found[-1], "set off from a solution within a gap")
            self.both_ways(found)

    def _wide(self, gap: tuple[float, float]) -> bool:
        return gap[1] - gap[0] > WIDE * self._width

    def _within(
        self,
        gap: tuple[float, float],
        visit: int,
        find_start: FindStart,
        tries: Iterator[int],
        vain: list[tuple[float, Visits]],
    ) -> NDArray | None:
        """A solution in a gap; where the chain does not find one is added to what was vain."""
        a, b = gap
        points = [p for piece in self.pieces for p in piece.path.points]
        frequencies = [a + part * (b - a) for part in PLACES[visit]]
        wide = self._wide(gap)
        for omega in frequencies:
            for point in sorted(points, key=lambda p: abs(p.y[-1] - omega))[:40:8]:
                c = self._solve(point.y[:-1], omega, point.scale, 30, True)
                if c.status == OK:
                    return c.y
        visits = EVERY_VISIT if wide else frozenset((visit,))

        def new(omega: float) -> bool:
            return not any(abs(omega - w) < CLOSE * (b - a) and visits <= before for w, before in vain)

        for omega, _ in zip(filter(new, frequencies if wide else frequencies[:ASKED]), tries):
            start = find_start(omega, visits)
            if start is not None:
                return start
            vain.append((omega, visits))
        return None

    # ---- other branches ----

    def new_solutions(self, starts: Sequence[NDArray]) -> Iterator[NDArray]:
        """Solutions near the starts, at their frequencies, that lie on none of the pieces (which may grow meanwhile)."""
        n = self.system.n_mean
        for start in starts:
            vibration = max(float(np.linalg.norm(start[n:-1])), 1e-300)
            scale = np.full(len(start), vibration)
            scale[:n] = max(vibration, float(np.linalg.norm(start[:n])))
            scale[-1] = start[-1]
            c = self.system.correct_at(start[:-1], start[-1], scale, self.options.tolerance, 20)
            if c.status == OK and not self._known(c.y):
                yield c.y

    def _known(self, y: NDArray) -> bool:
        """Whether a solution lies on a path: Newton from where the path crosses its frequency leads to it."""
        n = self.system.n_mean
        size = max(float(np.linalg.norm(y[n:-1])), 1e-300)
        for piece in self.pieces:
            points = piece.path.points
            for a, b in zip(points, points[1:]):
                if (a.y[-1] - y[-1]) * (b.y[-1] - y[-1]) > 0.0:
                    continue
                width = b.y[-1] - a.y[-1]
                part = (y[-1] - a.y[-1]) / width if width else 0.5
                between = a.y + part * (b.y - a.y)
                reach = float(np.linalg.norm((b.y - a.y)[n:-1])) + 1e-6 * size
                if np.linalg.norm((between - y)[n:-1]) > 10.0 * reach:
                    continue
                for guess in (between, a.y, b.y):
                    c = self.system.correct_at(guess[:-1], y[-1], a.scale, self.options.tolerance, 60, True)
                    if c.status == OK and np.linalg.norm((c.y - y)[n:-1]) < 1e-5 * size:
                        return True
        return False


def _same(y: NDArray, point: PathPoint) -> bool:
    return y[-1] == point.y[-1] and bool(np.linalg.norm((y - point.y) / point.scale) < 1e-6)
