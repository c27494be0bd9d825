"""Displacements from assembly at which friction has no force."""

import numpy as np
import pytest

import bdamper as bd

OFFSET = 1e-2


def study(**settings):
    """A mass on a spring and on friction with a limit that is not met: ``(k + kt) x = F + kt w``."""
    contact = bd.Contact(0, kt=2.0, mu=1.0, preload=5.0)
    return bd.lumped(
        1.0, 0.01, 3.0, contacts=[contact], forces={0: 1e-3}, load_per_preload={0: 1.0}, **settings
    )


def test_the_static_state_starts_from_it():
    for seed in range(3):
        one = study(residual_slip_std=OFFSET, residual_slip_seed=seed)
        w = OFFSET * np.random.default_rng(seed).standard_normal((1, 2))[0, 0]
        state = one.static(0.4)
        assert state.ok and abs(w) > 1e-4
        assert state.slider[0, 0] == pytest.approx(w, rel=1e-12)
        assert float(one.problem.response_rows[0] @ state.q) == pytest.approx(
            (0.4 + 2.0 * w) / 5.0, rel=1e-9
        )
        assert state.force[0, 0] == pytest.approx(2.0 * ((0.4 + 2.0 * w) / 5.0 - w), rel=1e-9)
    assert float(study().problem.response_rows[0] @ study().static(0.4).q) == pytest.approx(
        0.08, rel=1e-12
    )


def test_what_slips_forgets_it():
    """Beyond the limit of friction the offset is gone."""
    at = [
        study(residual_slip_std=OFFSET, residual_slip_seed=seed).static(30.0) for seed in range(2)
    ]
    for state in at:
        assert state.force[0, 0] == pytest.approx(5.0, rel=1e-9)
    assert at[0].slider[0, 0] == pytest.approx(at[1].slider[0, 0], rel=1e-9)


def test_draws_bring_offsets_of_their_own():
    drawn = bd.sample({"residual_slip_std": 2e-7}, 4, seed=1)
    assert drawn["residual_slip_std"].tolist() == [2e-7] * 4
    again, other = (
        bd.sample({"residual_slip_std": 2e-7}, 4, seed=1),
        bd.sample({"residual_slip_std": 2e-7}, 4, seed=2),
    )
    assert drawn["residual_slip_seed"].tolist() == again["residual_slip_seed"].tolist()
    assert not set(drawn["residual_slip_seed"]) & set(other["residual_slip_seed"])
    with pytest.raises(bd.SettingError, match="residual_slip_std"):
        bd.sample({"residual_slip_std": -1.0}, 4)
    with pytest.raises(bd.SettingError, match="residual_slip_std"):
        study(residual_slip_std=-1e-6)


def test_a_curve_of_a_sample_takes_them():
    """A wedge of two masses: every draw is another static state, and its mode does not scale with the preload."""
    s = c = np.sqrt(0.5)
    face = bd.Contact({0: -s, 1: c}, {0: c, 1: s}, kt=2.0, kn=2.0, mu=2.0)
    half = bd.lumped(
        [1.0, 0.01],
        [0.01, 0.0],
        [1.0, 0.0],
        contacts=[face],
        forces={0: 0.1},
        load_per_preload={1: 1.0},
        harmonics=1,
    )
    drawn = bd.sample({"residual_slip_std": 0.05}, 2)
    curve = bd.optimal_curve_uncertainty(half, drawn, (0.5, 1.0), 2, frequency=(0.1, 0.4))
    assert curve.complete and set(curve.samples) == {"residual_slip_std", "residual_slip_seed"}
    states = [
        half.replace(residual_slip_std=a, residual_slip_seed=k).static(0.5).force[0, 0]
        for a, k in zip(drawn["residual_slip_std"], drawn["residual_slip_seed"])
    ]
    assert len({round(float(force), 6) for force in (*states, half.static(0.5).force[0, 0])}) == 3
    assert half.nonlinear_mode(0.5, 1, (1e-3, 1e-2)).scales_to == np.inf
    assert (
        half.replace(residual_slip_std=0.05).nonlinear_mode(0.5, 1, (1e-3, 1e-2)).scales_to == 0.0
    )
