"""Convex problems of a load step against closed forms and against a general minimiser."""

import numpy as np
import pytest
import scipy.optimize

from bdamper.contact.friction_step import _FixedLimits, _FixedOpening, _minimum, approximations
from bdamper.contact.static_state import StaticSystem


def drawn(seed, n_points=4, n_modes=9):
    rng = np.random.default_rng(seed)
    return StaticSystem(
        stiffness=rng.uniform(0.5, 2.0, n_modes),
        G=rng.standard_normal((n_points, 3, n_modes)),
        kt=rng.uniform(1.0, 3.0, (n_points, 2)),
        kn=rng.uniform(1.0, 3.0, n_points),
        mu=rng.uniform(0.1, 0.6, n_points),
        n0=rng.uniform(-0.2, 1.0, n_points),
        force=rng.standard_normal(n_modes),
        shift=np.zeros((n_points, 3)),
        constant_force=np.zeros(n_modes),
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("law_of", [_FixedLimits, _FixedOpening])
def test_the_derivative_is_that_of_the_forces_and_symmetric(law_of, seed):
    system = drawn(seed)
    rng = np.random.default_rng(100 + seed)
    law = law_of(system, 0.1 * rng.standard_normal((4, 2)))
    x, held = rng.standard_normal((4, 3)), rng.uniform(0.1, 0.5, 4)
    _, derivative = law.forces(x, held)
    assert np.abs(derivative).max() > 0.5
    h = 1e-7
    for d in range(3):
        step = np.zeros(3)
        step[d] = h
        after, before = (law.forces(x + sign * step, held)[0] for sign in (1.0, -1.0))
        np.testing.assert_allclose(derivative[:, :, d], (after - before) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(derivative, derivative.transpose(0, 2, 1), atol=1e-14)


@pytest.mark.parametrize("seed", range(4))
def test_the_forces_at_a_fixed_opening_are_the_nearest_on_the_pyramid(seed):
    """Against a general minimiser of the distance in the metric of the springs."""
    system = drawn(seed)
    rng = np.random.default_rng(200 + seed)
    x, opening = rng.standard_normal((4, 3)), rng.uniform(0.0, 0.3, 4)
    force, _ = _FixedOpening(system, np.zeros((4, 2))).forces(x, opening)
    for i in range(4):
        mu = system.mu[i]
        spring = np.append(system.kt[i], system.kn[i])
        trial = spring * x[i] + [0.0, 0.0, system.n0[i] - system.kn[i] * opening[i]]
        limits = [
            {"type": "ineq", "fun": lambda F, d=d, sign=sign: mu * F[2] - sign * F[d]}
            for d in range(2)
            for sign in (1.0, -1.0)
        ]
        nearest = scipy.optimize.minimize(
            lambda F: np.sum((F - trial) ** 2 / spring),
            [0.0, 0.0, 1.0],
            constraints=limits,
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 300},
        )
        np.testing.assert_allclose(force[i], nearest.x, atol=2e-6)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("law_of", [_FixedLimits, _FixedOpening])
def test_the_minimum_is_in_equilibrium_with_its_forces(law_of, seed):
    system = drawn(seed)
    law, held = law_of(system, np.zeros((4, 2))), np.full(4, 0.2)
    q = _minimum(system, law, held, system.force, system.shift, np.full(9, 3.0))
    force, _ = law.forces(np.einsum("pdm,m->pd", system.G, q), held)
    contact = np.einsum("pdm,pd->m", system.G, force)
    np.testing.assert_allclose(system.stiffness * q + contact, system.force, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_last_approximation_obeys_the_law_of_friction(seed):
    """The fixed point of the limits is an equilibrium of friction that follows the normal force."""
    system = drawn(seed)
    q = list(approximations(system, system.force, system.shift, np.zeros((4, 2)), np.zeros(9)))[24]
    x = np.einsum("pdm,m->pd", system.G, q)
    normal = np.maximum(system.n0 + system.kn * x[:, 2], 0.0)
    limit = (system.mu * normal)[:, None]
    force = np.hstack([np.clip(system.kt * x[:, :2], -limit, limit), normal[:, None]])
    contact = np.einsum("pdm,pd->m", system.G, force)
    np.testing.assert_allclose(system.stiffness * q + contact, system.force, atol=1e-6)
