"""Marches of equations from a state, beside those of studies."""

import numpy as np

from bdamper.stability.march import March
from bdamper.stability.steady_state import settled
from bdamper.stability.time_integration import Ring
from bdamper.stability.verification import verified


def verify_solution(system, u, omega, n_blades, engine_order, steps_per_period=None, **asked):
    """Whether the motion keeps to a solution."""
    march = March(Ring(system, n_blades, engine_order), omega, u, steps_per_period)
    return verified(march, system.response(np.asarray(u)), **asked)


def march_until_settled(system, omega, n_blades, engine_order, start, preload, steps_per_period=None, **asked):
    """What the motion comes to."""
    return settled(March(Ring(system, n_blades, engine_order), omega, start, steps_per_period), preload, **asked)
