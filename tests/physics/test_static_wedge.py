"""Static preload of a wedge between rigid platforms against closed forms.

Angles from the radial axis, radial load P.  Frictionless: ``N_R = P cos(alpha)/sin(alpha + beta)``,
``N_L = P cos(beta)/sin(alpha + beta)``.  Sliding outward on both faces: the same with both angles increased by
``rho = atan(mu)``, times ``cos(rho)``.  Symmetric and elastic, still stuck:
``N = P kn sin(alpha)/(2 (kn sin^2 + kt cos^2))``; it slips if ``tan(alpha) < kt/(mu kn)``.
"""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.preload_state import OPEN, SLIP_MINUS, SLIP_PLUS, STICK
from bdamper.contact.static_state import StaticSystem, static_state
from tests.each import each
from tests.models import wedge_frames, wedge_model
from tests.plain import plain_study

LOAD = 1000.0


def wedge(alpha, beta, mu, kt=1e7, kn=1e7):
    """Two translations of the wedge, one point on each face, left then right; the platforms do not move."""
    frames = wedge_frames(alpha, beta)
    G = -np.array([frames["left"][:, :2], frames["right"][:, :2]])
    G[:, 2] *= -1.0
    return StaticSystem(
        stiffness=np.zeros(2),
        G=G,
        kt=np.full((2, 2), kt),
        kn=np.full(2, kn),
        mu=np.full(2, mu),
        n0=np.zeros(2),
        force=np.array([0.0, 1.0]),
        shift=np.zeros((2, 3)),
        constant_force=np.zeros(2),
    )


def solved(system, load=LOAD, **options):
    state = static_state(system, load, **options)
    assert state.ok, state.reason
    # equilibrium and the friction cone, from the forces alone
    np.testing.assert_allclose(
        np.einsum("pam,pa->m", system.G, state.force), load * system.force, rtol=0, atol=1e-8 * LOAD
    )
    assert (
        np.abs(state.force[:, :2]) <= system.mu[:, None] * state.force[:, 2:] + 1e-9 * LOAD
    ).all()
    return state


ANGLES = [(np.pi / 4, np.pi / 4), (0.7, 0.9), (1.0, 0.4), (0.3, 1.1)]


@pytest.mark.parametrize(("alpha", "beta"), ANGLES)
def test_without_friction(alpha, beta):
    state = solved(wedge(alpha, beta, 0.0, kt=0.0))
    expected = LOAD * np.array([np.cos(beta), np.cos(alpha)]) / np.sin(alpha + beta)
    np.testing.assert_allclose(state.force[:, 2], expected, rtol=1e-9)
    assert not state.force[:, :2].any()


@pytest.mark.parametrize(("alpha", "beta"), ANGLES)
@pytest.mark.parametrize("mu", [0.1, 0.25])
def test_sliding_outward(alpha, beta, mu):
    """Stiff tangential springs: both faces slide from the first load on."""
    state = solved(wedge(alpha, beta, mu, kt=1e10, kn=1e7))
    rho = np.arctan(mu)
    expected = (
        LOAD
        * np.cos(rho)
        * np.array([np.cos(beta + rho), np.cos(alpha + rho)])
        / np.sin(alpha + beta + 2 * rho)
    )
    np.testing.assert_allclose(state.force[:, 2], expected, rtol=1e-8)
    np.testing.assert_allclose(np.abs(state.force[:, 0]), mu * expected, rtol=1e-8)
    assert np.isin(state.status[:, 0], (SLIP_PLUS, SLIP_MINUS)).all()
    assert (state.status[:, 1] == STICK).all()  # nothing moves along the axis


@pytest.mark.parametrize("alpha", [0.3, np.pi / 4, 1.1])
def test_symmetric_sliding(alpha):
    state = solved(wedge(alpha, alpha, 0.2, kt=1e10))
    expected = LOAD / (2 * (np.sin(alpha) + 0.2 * np.cos(alpha)))
    np.testing.assert_allclose(state.force[:, 2], expected, rtol=1e-8)


def test_symmetric_elastic_number():
    """alpha = 45 degrees, kt = kn, mu = 0.3: 0.543928 P."""
    state = solved(wedge(np.pi / 4, np.pi / 4, 0.3))
    np.testing.assert_allclose(state.force[:, 2] / LOAD, 0.543928, rtol=0, atol=6e-7)


@each("alpha", [0.4, 0.8, 1.2])
@each("ratio", [0.2, 1.0, 4.0])
@each("mu", [0.1, 0.6, 3.0])
def test_symmetric_elastic(alpha, ratio, mu):
    """Stuck or slipping, as the criterion says."""
    kn = 1e7
    kt = ratio * kn
    state = solved(wedge(alpha, alpha, mu, kt=kt, kn=kn))
    slips = np.tan(alpha) < kt / (mu * kn)
    assert np.isin(state.status[:, 0], (SLIP_PLUS, SLIP_MINUS)).all() == slips
    stuck = kn * np.sin(alpha) / (2 * (kn * np.sin(alpha) ** 2 + kt * np.cos(alpha) ** 2))
    sliding = 1 / (2 * (np.sin(alpha) + mu * np.cos(alpha)))
    np.testing.assert_allclose(state.force[:, 2] / LOAD, sliding if slips else stuck, rtol=1e-8)


def test_unloading_shows_self_locking():
    """With tan(alpha) < mu the wedge stays jammed without any load; with less friction it comes free."""
    for alpha, locked in ((0.2, True), (0.9, False)):
        system = wedge(alpha, alpha, 0.5, kt=1e8)
        loaded = solved(system)
        back = static_state(system, 1e-3 * LOAD, start=loaded)
        assert back.ok
        left = back.force[:, 2] / LOAD
        if locked:
            assert (left > 0.05).all()
        else:
            direct = solved(system, 1e-3 * LOAD).force[:, 2] / LOAD
            assert (left < 3 * direct.max()).all()
        # normal load is not unique: it depends on the history
        half, unloaded = solved(system, 0.5 * LOAD), static_state(system, 0.5 * LOAD, start=loaded)
        assert abs(half.force[0, 2] - unloaded.force[0, 2]) > 1.0


@pytest.mark.parametrize("steps", [1, 3, 8, 40])
def test_the_number_of_load_steps_does_not_matter_without_gaps(steps):
    a, b = solved(wedge(0.7, 0.9, 0.3), steps=8), solved(wedge(0.7, 0.9, 0.3), steps=steps)
    np.testing.assert_allclose(b.force, a.force, rtol=0, atol=1e-7 * LOAD)


def test_homogeneous_in_the_load():
    system = wedge(0.7, 0.9, 0.3)
    a = solved(system, 1.0)
    for load in (1e-4, 50.0, 1e6):
        b = static_state(system, load)
        assert b.ok
        np.testing.assert_allclose(b.force / load, a.force, rtol=0, atol=1e-8)
        np.testing.assert_array_equal(b.status, a.status)


def test_an_initial_gap_closes_first():
    system = wedge(np.pi / 4, np.pi / 4, 0.0, kt=0.0)
    gap = 2e-5
    state = solved(replace(system, n0=np.full(2, -system.kn[0] * gap)))
    np.testing.assert_allclose(state.force[:, 2], LOAD / np.sqrt(2), rtol=1e-9)
    np.testing.assert_allclose(
        state.q, [0.0, (gap + LOAD / np.sqrt(2) / 1e7) * np.sqrt(2)], rtol=0, atol=1e-12
    )


def test_without_load_nothing_happens():
    state = static_state(wedge(0.7, 0.9, 0.3), 0.0)
    assert state.ok
    assert not state.force.any()
    assert not state.q.any()
    assert (state.status == OPEN).all()


@pytest.mark.parametrize(("alpha", "beta"), [(0.8, 0.8), (0.8, 0.6)])
def test_a_frictionless_damper_on_elastic_blades_is_statically_determinate(alpha, beta):
    """The resultants of both faces follow from equilibrium alone, however the blades give way."""
    study = plain_study(
        wedge_model(n_points=4, alpha=alpha, beta=beta),
        bd.Excitation("tip"),
        engine_order=2,
        friction_coefficient=0.0,
        contact_stiffness="model",
        constraint_planes=False,
    )
    state = study.static(LOAD)
    assert state.ok, state.reason
    left, right = (
        state.force[study.problem.coupling.rows(name), 2].sum() for name in ("left", "right")
    )
    assert left == pytest.approx(LOAD * np.cos(beta) / np.sin(alpha + beta), rel=1e-7)
    assert right == pytest.approx(LOAD * np.cos(alpha) / np.sin(alpha + beta), rel=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_the_static_state_of_a_study_is_in_equilibrium(seed):
    """Seed 0 slips at every point in both directions: the states of one load step are no start for the next."""
    study = plain_study(
        wedge_model(seed, n_points=4),
        bd.Excitation("tip"),
        engine_order=2,
        friction_coefficient=0.3,
        contact_stiffness="model",
    )
    for load in (1.0, 1000.0):
        state = study.static(load)
        assert state.ok
        frames = np.concatenate(
            [study.model.interfaces[name].frame for name in study.problem.coupling.interfaces]
        )
        # (T1, T2) pull the damper along t1, t2; N pushes it against its normal
        local = state.force * [1.0, 1.0, -1.0]
        total = np.einsum("pa,pai->i", local, frames)
        np.testing.assert_allclose(total, [0.0, -load, 0.0], rtol=0, atol=1e-7 * load)
        mu = study.problem.friction[:, None]
        assert (np.abs(state.force[:, :2]) <= mu * state.force[:, 2:] + 1e-9 * load).all()
        # the sliders reproduce the friction forces
        x = (
            np.einsum("pam,m->pa", study.problem.bases[0].G.real, state.q)
            + load * study.problem.coupling.load()[1]
        )
        closed = state.force[:, 2] > 0
        trial = study.problem.tangential_stiffness * (x[:, :2] - state.slider)
        np.testing.assert_allclose(trial[closed], state.force[closed, :2], rtol=0, atol=1e-8 * load)
