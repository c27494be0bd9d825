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


def test_multipliers_of_a_mass_that_sticks_and_slips_twice_a_period():
    """Free vibrations with and without the spring of the slider, which is set where stick begins.

    The motion a cos(theta - 0.7) turns, sticks for arccos(1 - 2 mu N/(kt a)), and slips to its
    other end.
    """
    mass, own, kt, limit, a, omega = 2.0, 1.0, 0.6, 0.4 * 0.5, 1.0, 1.1
    system = oscillator(
        mass, 0.0, own, [1.0, 0.0, 0.0], 0.1, [1.0], 1, kt=kt, kn=6.0, mu=0.4, n0=0.5
    )
    motion = np.sqrt(mass) * a * np.array([0.0, np.cos(0.7), np.sin(0.7)])
    found = multipliers(system, motion, omega)

    stick = np.arccos(1.0 - 2.0 * limit / (kt * a))
    free = np.sqrt(own / mass)
    held = np.sqrt((own + kt) / mass)
    # displacement and velocity after stick; the slider has moved as the mass at its beginning
    angle = held * stick / omega
    kept = kt / (own + kt)
    turn = np.array([[np.cos(angle), np.sin(angle) / held], [-held * np.sin(angle), np.cos(angle)]])
    after_stick = np.array([[kept, 0.0], [0.0, 0.0]]) + turn @ np.diag([1.0 - kept, 1.0])
    angle = free * (np.pi - stick) / omega
    after_slip = np.array(
        [[np.cos(angle), np.sin(angle) / free], [-free * np.sin(angle), np.cos(angle)]]
    )
    expected = np.linalg.eigvals(after_slip @ after_stick) ** 2
    assert abs(expected[0].imag) > 0.1, "a pair"
    moving = found[:2][np.argsort(found[:2].imag)]
    np.testing.assert_allclose(moving, expected[np.argsort(expected.imag)], rtol=1e-9)
    np.testing.assert_allclose(found[2:], 0.0, atol=1e-9)


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
