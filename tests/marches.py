"""Marches of equations from a state, beside those of studies."""

import itertools

import numpy as np

from bdamper.time_domain.integration import Ring
from bdamper.time_domain.march import March
from bdamper.time_domain.transients import settled, verified


def fails_after(monkeypatch, calls):
    """Let every march of a ring after the first ones start so far away that it overflows."""
    march, done = Ring.integrate, itertools.count()

    def failing(ring, motion, omega, *given, **asked):
        if next(done) >= calls:
            motion = motion._replace(q=np.full_like(motion.q, 1e308))
        return march(ring, motion, omega, *given, **asked)

    monkeypatch.setattr(Ring, "integrate", failing)


def verify_solution(system, u, omega, n_blades, engine_order, steps_per_period=None, **asked):
    """Whether the motion keeps to a solution."""
    march = March(Ring(system, n_blades, engine_order), omega, u, steps_per_period)
    return verified(march, system.response(np.asarray(u)), **asked)


def march_until_settled(system, omega, n_blades, engine_order, start, preload, steps_per_period=None, **asked):
    """What the motion comes to."""
    return settled(March(Ring(system, n_blades, engine_order), omega, start, steps_per_period), preload, **asked)
