"""Time integration of a system of equations without a study."""

import itertools
from typing import NamedTuple

import numpy as np

from bdamper.time_domain.integration import AllSectors
from bdamper.time_domain.time_response import compare_with_solution
from bdamper.time_domain.transient import Transient


def fails_after(monkeypatch, calls):
    """Let every integration of a ring after the first ones start so far away that it overflows."""
    own, done = AllSectors.integrate, itertools.count()

    def failing(ring, motion, omega, *given, **asked):
        if next(done) >= calls:
            motion = motion._replace(q=np.full_like(motion.q, 1e308))
        return own(ring, motion, omega, *given, **asked)

    monkeypatch.setattr(AllSectors, "integrate", failing)


def interrupted_at(monkeypatch, call):
    """Let one integration of a ring, counted from 0, be interrupted by Ctrl-C."""
    own, done = AllSectors.integrate, itertools.count()

    def stopped(ring, *given, **asked):
        if next(done) == call:
            raise KeyboardInterrupt
        return own(ring, *given, **asked)

    monkeypatch.setattr(AllSectors, "integrate", stopped)


def spent_at(monkeypatch, call):
    """Let the processor time be spent before one integration of a ring, counted from 0."""
    own, done = AllSectors.integrate, itertools.count()

    def limited(ring, *given, **asked):
        if next(done) == call:
            ring.limit.take(ring.limit.seconds)
        return own(ring, *given, **asked)

    monkeypatch.setattr(AllSectors, "integrate", limited)


class Compared(NamedTuple):
    """Verdict on a solution, the integration, and the relative distance of the last period from the solution."""

    verdict: str
    reason: str
    interrupted: bool
    transient: Transient
    distance: float


def compared(system, u, omega, n_blades, engine_order, steps, **asked):
    """Whether the motion stays at a solution."""
    transient = integrated(system, omega, n_blades, engine_order, u, 0, steps)
    expected = system.response(np.asarray(u))
    (verdict, reason, _), stopped = compare_with_solution(transient, expected, **asked)
    off = transient.response[-1] - expected
    return Compared(
        verdict,
        reason,
        stopped,
        transient,
        float(np.linalg.norm(off[1:]) / np.linalg.norm(expected[1:])),
    )


def integrated(system, omega, n_blades, engine_order, start, periods, steps):
    """The motion after some periods."""
    transient = Transient(AllSectors(system, n_blades, engine_order), omega, start, steps)
    transient.run(periods)
    return transient
