"""Monodromy matrix against disturbed motions, each integrated through one period with its own events."""

import numpy as np
import pytest

from bdamper.time_domain.floquet import multipliers
from tests.hard.test_case_04_17_folds_and_peaks import STUCK, followed, two_oscillators
from tests.hard.test_stability import prepared


@pytest.mark.slow
@pytest.mark.parametrize("slips", [1, 2])
def test_multipliers_of_a_point_that_sticks_for_a_part_of_the_period(slips):
    system = two_oscillators(15)
    path = followed(system, 1.0, 1.9, STUCK)
    partial = [p for p in path.points if 0.05 < p.shares[0] < 0.45]
    p = partial[len(partial) * slips // 3]
    integrator, *start = prepared(system, p.y)
    expected = integrator.multipliers(*start)
    for value in multipliers(system, p.y[:-1], p.y[-1])[:4]:
        assert np.abs(expected - value).min() < 1e-3
