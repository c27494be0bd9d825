"""Lemke's method against enumeration, and its problem against known equilibria."""

import itertools

import numpy as np
import pytest

from bdamper.contact.complementarity import possible_states, solution_basis
from bdamper.contact.static_state import _LoadStep
from tests.contact.test_friction_step import drawn


def by_enumeration(M, b):
    """The only set of positive unknowns of a problem whose matrix has positive principal minors."""
    n = len(b)
    for chosen in itertools.product([False, True], repeat=n):
        acts = np.array(chosen)
        z = np.zeros(n)
        z[acts] = np.linalg.solve(M[np.ix_(acts, acts)], -b[acts])
        w = M @ z + b
        if z.min() >= 0.0 and w[~acts].min(initial=0.0) >= -1e-12:
            return acts
    return None


@pytest.mark.parametrize("seed", range(8))
def test_the_positive_unknowns_are_those_of_enumeration(seed):
    """The symmetric part is definite, so that the solution is unique; the other part is not small."""
    rng = np.random.default_rng(seed)
    n = 6
    A, B = rng.standard_normal((2, n, n))
    M = A @ A.T + 0.1 * np.eye(n) + B - B.T
    b = rng.standard_normal(n)
    for direction in (np.ones(n), rng.uniform(0.5, 2.0, n)):
        np.testing.assert_array_equal(solution_basis(M, b, direction), by_enumeration(M, b))


def test_a_path_to_infinity_has_no_solution():
    """With w = -z - 1 no z >= 0 gives w >= 0."""
    assert solution_basis(-np.eye(2), -np.ones(2), np.ones(2)) is None


def check_equilibrium(system, q):
    """From the motion alone: sliders were at zero, so the springs have forces up to their limits."""
    x = np.einsum("pdm,m->pd", system.G, q)
    normal = np.maximum(system.n0 + system.kn * x[:, 2], 0.0)
    limit = (system.mu * normal)[:, None]
    force = np.hstack([np.clip(system.kt * x[:, :2], -limit, limit), normal[:, None]])
    contact = np.einsum("pdm,pd->m", system.G, force)
    np.testing.assert_allclose(system.stiffness * q + contact, system.force, atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_the_states_are_those_of_an_equilibrium(seed):
    """Stick, slip and opening at four points."""
    system = drawn(seed)
    step = _LoadStep(system, 1.0, np.zeros((4, 2)), 0.0)
    states = next(possible_states(system, system.force, step.shift, step.w))
    check_equilibrium(system, step.linear_solution(states))


def test_a_load_step_ends_where_convex_problems_lead_nowhere(monkeypatch):
    """As on a stage with a wedge that a shroud of 0.4 mm interference squeezes."""
    system = drawn(0)
    nowhere = np.full(9, 1e3)
    monkeypatch.setattr(_LoadStep, "_solve_convex", lambda step: step.solve_near(nowhere, 1))
    step = _LoadStep(system, 1.0, np.zeros((4, 2)), 0.0)
    assert not step._solve_convex().ok
    end = step.solve_far()
    assert end.ok
    check_equilibrium(system, end.q)
