"""Cubic springs of the core against the NumPy oracle and finite differences."""

import numpy as np
import pytest

from bdamper import _core
from tests import oracle
from tests.cases import (
    EXACT,
    SAMPLED,
    difference,
    evaluate,
    evaluate_system,
    for_oracle,
    random_arrays,
    random_motion,
    random_point,
)
from tests.compare import assert_close, assert_near

CUBIC = 6


@pytest.mark.parametrize("evaluation", [EXACT, SAMPLED])
@pytest.mark.parametrize("n_harm", [1, 2, 5])
def test_force_and_tangent_of_a_point(n_harm, evaluation):
    rng = np.random.default_rng(n_harm)
    point, x = random_point(rng), random_motion(rng, n_harm)
    point.kt[1] *= -1.0  # a spring that softens
    found = evaluate(x, point, evaluation, 64, CUBIC)
    assert_near(found.force, oracle.cubic(x, point.kt), 1e-13 * np.abs(found.force).max())
    expected = difference(lambda x: evaluate(x, point, evaluation, 64, CUBIC).force, x)
    assert_close(found.tangent, expected, 1e-9)
    assert (found.shares == 0.0).all()
    assert np.abs(found.force[:2]).min(axis=1).max() > 0.0


def test_springs_beside_contacts():
    """Every other point a spring, more points than one batch holds."""
    rng = np.random.default_rng(1)
    arrays = random_arrays(rng, [3, 3, 2], 11)
    arrays["law"][1::2] = CUBIC
    arrays["mu"][1::2] = 99.0  # tells the oracle which they are; the core does not read it
    system = _core.SectorEquations(**arrays, evaluation=EXACT, n_time=0)
    u = rng.normal(size=system.n_unknown)
    r, J, _ = evaluate_system(system, u, 0.8)

    def law(x, kt, kn, mu, n0, w):
        return oracle.cubic(x, kt) if mu == 99.0 else oracle.contact(x, kt, kn, mu, n0, w)

    assert_near(r, oracle.residual(u, 0.8, for_oracle(arrays), law), 1e-11 * np.abs(r).max())
    expected = difference(lambda u: evaluate_system(system, u, 0.8)[0], u)
    assert_near(J, expected, 1e-8 * np.abs(J).max())
