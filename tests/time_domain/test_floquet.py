"""Monodromy matrix against disturbed motions, each integrated through one period with its own events."""

import numpy as np
import pytest

from bdamper.time_domain.floquet import multipliers
from tests.hard.test_case_04_17_folds_and_peaks import STUCK, followed, two_oscillators
from tests.hard.test_stability import prepared
from tests.oscillators import oscillator


def test_multipliers_of_a_sticking_point_with_two_modes():
    """exp(lambda T) with the eigenvalues of two masses on the springs of the point."""
    mass, damping, kt, kn = 2.0, 0.05, 0.6, 6.0
    stiffness = np.array([[1.0, 0.3], [0.3, 2.0]])
    along = [[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]]
    system = oscillator(
        mass, damping, stiffness, along, [0.1, 0.12], [0.0, 1.0], 1, kt=kt, kn=kn, mu=0.4, n0=10.0
    )
    found = multipliers(system, np.zeros(system.layout.n_unknowns), 1.3)

    held = stiffness + np.diag([kt, kn])
    rates = np.block([[np.zeros((2, 2)), np.eye(2)], [-held / mass, -damping / mass * np.eye(2)]])
    expected = np.exp(np.linalg.eigvals(rates) * 2.0 * np.pi / 1.3)
    order = np.lexsort((expected.imag, expected.real))
    np.testing.assert_allclose(found[np.lexsort((found.imag, found.real))], expected[order])


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
