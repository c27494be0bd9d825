"""What any contact law of this kind must satisfy, whatever the numbers."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_array_equal

from bdamper import _core
from tests import oracle
from tests.cases import EXACT, SAMPLED, Point, evaluate, random_motion, random_point
from tests.compare import assert_near


def cases(seed, count=60, harmonics=(1, 2, 3, 5)):
    rng = default_rng(seed)
    for i in range(count):
        yield random_point(rng), random_motion(rng, harmonics[i % len(harmonics)])


def test_time_shift_of_the_motion_shifts_the_force():
    rng = default_rng(2)
    for point, x in cases(3, 80):
        result = evaluate(x, point)
        for delta in rng.uniform(0, 2 * np.pi, 3):
            shifted = evaluate(oracle.shift(x, delta), point)
            expected = oracle.shift(result.force, delta)
            assert_near(shifted.force, expected, 1e-13 * (1 + np.abs(expected).max()))
            assert_near(shifted.shares, result.shares, 1e-12)


@pytest.mark.parametrize("evaluation", [EXACT, SAMPLED])
def test_homogeneous_of_degree_one(evaluation):
    """Motion, preload and slider times s: the force times s, the tangent unchanged."""
    for point, x in cases(4):
        a = evaluate(x, point, evaluation, 128)
        for s in (1e-6, 0.37, 1e6):
            scaled = Point(point.kt, point.kn, point.mu, s * point.n0, s * point.w)
            b = evaluate(s * x, scaled, evaluation, 128)
            assert_near(b.force / s, a.force, 1e-12 * (1 + np.abs(a.force).max()))
            assert_near(b.tangent, a.tangent, 2e-9)


def test_slip_anywhere_makes_the_mean_neutral():
    """A cycle that slips forgets the offset: dT/du_bias vanishes, to rounding of the sums."""
    used = 0
    for point, x in cases(7, 80):
        result = evaluate(x, point)
        for d in range(2):
            if result.shares[2 * d + 1] > 0.0:
                moved = x.copy()
                moved[d, 0] += 0.7
                assert_near(evaluate(moved, point).force[d], result.force[d], 1e-13)
                assert np.abs(result.tangent[d, :, d, 0]).max() < 1e-14
                used += 1
    assert used > 40


def test_a_point_that_never_slips_keeps_its_slider():
    point = Point(np.array([2.0, 3.0]), 1.5, 0.5, 10.0, np.array([0.4, -0.3]))
    x = np.array([[0.1, 0.2, 0.3], [0.0, -0.1, 0.2], [0.0, 0.5, 0.5]])
    force = evaluate(x, point).force
    expected = point.kt[:, None] * x[:2]
    expected[:, 0] -= point.kt * point.w
    assert_near(force[:2], expected, 1e-15)
    # where the given slider would slip, it is carried to the nearest one that does not
    far = Point(point.kt, point.kn, point.mu, point.n0, np.array([50.0, -0.3]))
    carried = evaluate(x, far)
    bound = point.n0 + point.kn * (oracle.basis(np.linspace(0, 2 * np.pi, 100001), 1) @ x[2])
    hi = oracle.basis(np.linspace(0, 2 * np.pi, 100001), 1) @ x[0] + point.mu * bound / point.kt[0]
    assert carried.force[0, 0] == pytest.approx(point.kt[0] * (x[0, 0] - hi.min()), abs=1e-8)


def test_no_friction_and_no_stiffness():
    rng = default_rng(8)
    for _ in range(10):
        point, x = random_point(rng), random_motion(rng, 2)
        normal = evaluate(x, point).force[2]
        no_mu = evaluate(x, Point(point.kt, point.kn, 0.0, point.n0, point.w))
        by_law = evaluate(x, point, law=1)
        for other in (no_mu, by_law):
            assert_array_equal(other.force[2], normal)
            assert not other.force[:2].any()
            assert not other.tangent[:2].any()
        one = evaluate(
            x, Point(np.array([0.0, point.kt[1]]), point.kn, point.mu, point.n0, point.w)
        )
        assert not one.force[0].any()
        assert one.force[1].any() == evaluate(x, point).force[1].any()


@pytest.mark.parametrize("evaluation", [EXACT, SAMPLED])
def test_the_limits_of_contact(evaluation):
    x = np.zeros((3, 3))
    at_rest = Point(np.ones(2), 1.0, 0.5, 0.0, np.zeros(2))
    result = evaluate(
        x, at_rest, evaluation, 128
    )  # no preload, no motion: open, with a defined tangent
    assert not result.force.any()
    assert np.isfinite(result.tangent).all()
    grazing = x.copy()
    grazing[2, 1] = 1.0
    grazing[0, 2] = 1.0
    for n0 in (1.0, 1.0 - 1e-14, 1.0 + 1e-14, -1.0, -1.0 + 1e-14):
        result = evaluate(grazing, Point(np.ones(2), 1.0, 0.5, n0, np.zeros(2)), evaluation, 128)
        assert np.isfinite(result.force).all()
        assert np.isfinite(result.tangent).all()
        assert_near(result.force[2], max(n0, 0.0) * np.array([1.0, 1.0, 0.0]), 1e-10)


def test_shares_of_the_cycle_add_up():
    for point, x in cases(9):
        for evaluation in (EXACT, SAMPLED):
            s = evaluate(x, point, evaluation, 128).shares
            assert s[0] + s[1] + s[4] == pytest.approx(1.0, abs=1e-12)
            assert s[2] + s[3] + s[4] == pytest.approx(1.0, abs=1e-12)
            assert (s >= -1e-15).all()


def test_a_contact_shorter_than_the_bracketing_grid_is_caught():
    """A tenth of a cell of the grid of 16 H + 16 samples, at any place."""
    h = 3
    cell = 2 * np.pi / (16 * h + 16)
    for at in np.linspace(0.0, 2 * np.pi, 23):
        v = oracle.shift(np.array([0.0, 1.0, 0, 0, 0, 0.3, 0.0]), -at)
        top = np.cos(0.05 * cell) + 0.3 * np.cos(
            3 * 0.05 * cell
        )  # the level that is exceeded for a tenth of a cell
        x = np.zeros((3, 7))
        x[2] = v
        shares, _ = _core.evaluate_contact(
            x, np.ones(2), 1.0, 0.3, -top, np.zeros(2), np.empty((3, 7)), np.empty((3, 7, 3, 7))
        )
        assert 1.0 - shares[4] == pytest.approx(0.1 * cell / (2 * np.pi), rel=1e-6)
