"""Row 23: Jacobians against finite differences on random states of all laws; BDAMPER_HARD=10000 runs the full number.

Away from events the two agree; at an event the difference quotient to one side agrees with the Jacobian of that side
(semismoothness), so the error of J h against r(u + h) - r(u) is of higher order than h.
"""

import numpy as np
import pytest

from tests.hard.random_studies import number_of_cases, random_study

BATCH = 50


def random_state(seed):
    study, preload, interval = random_study(seed)
    rng = np.random.default_rng(seed)
    system = study.system(preload)
    omega = 2 * np.pi * rng.uniform(*interval)
    state = study.static(preload)
    springs = study._stuck_springs(state)
    u = system.pack(state.q, system.linear_response(omega, springs))
    size = np.abs(u).max()
    u = u + size * 10.0 ** rng.uniform(-3.0, -0.5) * rng.standard_normal(len(u)) / np.sqrt(len(u))
    return system, u, omega, rng


@pytest.mark.parametrize("batch", range(0, number_of_cases(), BATCH))
def test_case_23_jacobian_of_the_system(batch):
    checked = 0
    for seed in range(batch, batch + BATCH):
        system, u, omega, rng = random_state(seed)
        r, J, r_omega = system.evaluate(u, omega)
        direction = rng.standard_normal(len(u)) * np.abs(u).max()
        errors = []
        for h in (1e-5, 1e-6, 1e-7):
            moved, J_moved, _ = system.evaluate(u + h * direction, omega)
            change = moved - r
            scale = np.abs(J @ direction).max() * h
            # semismooth: with the Jacobian of the point that is reached
            errors.append(np.abs(change - h * (J_moved @ direction)).max() / scale)
        assert errors[-1] < 1e-3, (seed, errors)
        if errors[0] < 1e-3:
            back, _, _ = system.evaluate(u - 1e-6 * direction, omega)
            ahead, _, _ = system.evaluate(u + 1e-6 * direction, omega)
            quotient = (ahead - back) / 2e-6
            assert np.abs(quotient - J @ direction).max() < 2e-4 * np.abs(J @ direction).max(), seed
            checked += 1
        d = 1e-6 * omega
        quotient = (system.evaluate(u, omega + d)[0] - system.evaluate(u, omega - d)[0]) / (2 * d)
        assert np.abs(quotient - r_omega).max() <= 1e-6 * max(np.abs(r_omega).max(), np.abs(r).max() / omega), seed
        assert np.abs(J).max() > 0.0
    assert checked > 0.6 * BATCH  # the others have an event within the difference
