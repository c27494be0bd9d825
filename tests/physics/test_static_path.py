"""Friction at rest depends on the way of the loads, not on the number of load steps.

The reference solves for the rates: with a direction of loading it tries all states of the points and takes the consistent
one, then goes on along a straight line to the next change of state.
"""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import bdamper as bd
import bdamper.contact.static_state as static_module
from bdamper.contact.static_state import StaticSystem, static_state
from bdamper.mistuning import BladedDisk, DamperVariation
from tests.each import each
from tests.mistuning.lumped import lumped_study
from tests.physics.test_static_wedge import wedge

AT_REST = 1e-11


def one_point(gap, mu=2.0, constant=0.0):
    """Unit springs along the face and across it, with the same load along both, and a contact of unit stiffness."""
    return StaticSystem(
        stiffness=np.ones(2), G=np.array([[[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]]]), kt=np.array([[1.0, 0.0]]),
        kn=np.ones(1), mu=np.array([mu]), n0=np.array([-gap]), force=np.ones(2), shift=np.zeros((1, 3)),
        constant_force=np.full(2, constant),
    )  # fmt: skip


def through(system, load_per_preload, **options):
    """The last of the states under loads that follow each other."""
    state = None
    for load in load_per_preload:
        state = static_state(system, load, start=state, **options)
        assert state.ok, state.reason
    return state


class Rates:
    """Exact way of the contact forces along the first axis of each face, T and N, under loads that follow each other."""

    def __init__(self, system):
        self.s, self.n = system, len(system.kn)
        self.T, self.q, self.P = np.zeros(self.n), np.zeros(system.G.shape[2]), 0.0

    @property
    def level(self):
        return self.s.n0 + self.s.kn * (self.s.G[:, 2] @ self.q)

    def rate(self, sign, size):
        """Rates of q, T and level that all states allow, for loads that grow (1) or fall (-1)."""
        s, level, found = self.s, self.level, []
        for states in product(("open", "stick", 1.0, -1.0), repeat=self.n):
            K = np.diag(s.stiffness)
            for (t, _, normal), kt, kn, mu, state in zip(s.G, s.kt[:, 0], s.kn, s.mu, states):
                if state != "open":
                    T_rate = kt * t if state == "stick" else state * mu * kn * normal
                    K = K + np.outer(normal, kn * normal) + np.outer(t, T_rate)
            q = np.linalg.solve(K, sign * s.force)
            u, N = s.kt[:, 0] * (s.G[:, 0] @ q), s.kn * (s.G[:, 2] @ q)
            slip = [0.0 if isinstance(state, str) else state for state in states] * s.mu * N
            T = np.where([state == "stick" for state in states], u, slip)
            if all(map(self.fits, states, level / size, self.T / size, s.mu, u, N)):
                found.append((q, T, N))
        assert found, "no consistent rates: the motion jumps"
        assert all(np.allclose(other[0], found[0][0], atol=1e-9) for other in found), (
            "several consistent rates"
        )
        return found[0]

    @staticmethod
    def fits(state, level, T, mu, u, N):
        if abs(level) > AT_REST and (state == "open") != (level < 0.0):
            return False
        if abs(level) <= AT_REST and (N > 0.0 if state == "open" else N < 0.0):
            return False
        if state == "open":
            return True
        touching, room = level <= AT_REST, mu * level - abs(T)
        if state == "stick":
            senses = (1.0, -1.0) if touching else (np.sign(T),) if room <= AT_REST else ()
            return not any(sense * u > mu * N for sense in senses)
        at_limit = touching or (room <= AT_REST and state * T > 0.0)
        sliding = state * u - mu * N
        return at_limit and sliding >= 0.0

    def to(self, load, size):
        while load != self.P:
            sign = np.sign(load - self.P)
            q, T, N = self.rate(sign, size)
            level, mu = self.level, self.s.mu
            before = np.concatenate([level, -level, self.T - mu * level, -self.T - mu * level])
            slope = np.concatenate([N, -N, T - mu * N, -T - mu * N])
            ahead = (before < -AT_REST * size) & (slope > 1e-14)
            step = min(np.min(-before[ahead] / slope[ahead], initial=np.inf), abs(load - self.P))
            self.q, self.T = self.q + step * q, self.T + step * T
            self.T[self.level < AT_REST * size] = 0.0
            self.P = load if step == abs(load - self.P) else self.P + sign * step
        return np.column_stack([self.T, np.maximum(self.level, 0.0)])


def exact(system, load_per_preload, size):
    rates = Rates(system)
    return [rates.to(load, size) for load in load_per_preload][-1]


@pytest.mark.slow
@pytest.mark.parametrize("steps", [1, 8, 80, 800])
@pytest.mark.parametrize(("gap", "load"), [(0.9, 1.0), (0.5, 3.0)])
def test_friction_begins_where_a_gap_closes(gap, load, steps):
    """From there on half of the load goes through each spring: ``T = N = (P - gap)/2``."""
    state = through(one_point(gap), [load], steps=steps)
    np.testing.assert_allclose(state.force, [[(load - gap) / 2, 0.0, (load - gap) / 2]], rtol=1e-12)


@pytest.mark.parametrize("steps", [1, 8, 80])
def test_a_gap_closes_in_the_same_way_under_a_constant_load(steps):
    state = static_state(one_point(0.9, constant=1.0), 0.0, steps=steps)
    np.testing.assert_allclose(state.force, [[0.05, 0.0, 0.05]], rtol=1e-12)


@pytest.mark.parametrize("steps", [1, 8, 80])
def test_opening_and_closing_again(steps):
    """Slip on the way back, since N falls to zero; the second closing begins from rest, as the first one."""
    system = one_point(0.9, mu=0.8)
    ends = [
        through(system, loads, steps=steps).force[0, ::2]
        for loads in ((3.0,), (3.0, 0.0, 3.0), (3.0, 1.2))
    ]
    # closing with T/N = 1 wanted slips from the first contact on: u = P - T, T = 0.8 N, N = (P - 0.9)/2
    np.testing.assert_allclose(ends[0], [0.84, 1.05], rtol=1e-12)
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-12)
    # T and N fall at the same rate 1/2 while it sticks, from 0.84 and 1.05, until T = -0.8 N; then -0.8 N
    np.testing.assert_allclose(ends[2], [0.84 - 0.9, 0.15], rtol=1e-12)


def test_a_study_of_masses_with_a_gap():
    contact = bd.Contact(0, 1, kt=1.0, kn=1.0, mu=1.2, gap=0.9)
    study = bd.lumped(
        [1.0, 1.0],
        [0.01, 0.01],
        [1.0, 1.0],
        contacts=[contact],
        forces={0: 0.1},
        load_per_preload={0: 1.0, 1: 1.0},
    )
    np.testing.assert_allclose(study.static(1.0).force, [[0.05, 0.0, 0.05]], atol=1e-12)


def random(seed):
    rng = np.random.default_rng(seed)
    G = rng.standard_normal((2, 3, 3))
    G[:, 1] = 0.0
    return StaticSystem(
        stiffness=rng.uniform(0.3, 2.0, 3), G=G, kt=np.column_stack([rng.uniform(0.3, 2.0, 2), np.zeros(2)]),
        kn=rng.uniform(0.3, 2.0, 2), mu=rng.uniform(0.1, 0.6, 2), n0=-rng.uniform(0.05, 0.6, 2),
        force=rng.standard_normal(3), shift=np.zeros((2, 3)), constant_force=np.zeros(3),
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize(
    "load_per_preload", [(3.0,), (3.0, -2.0), (3.0, -2.0, 3.0), (3.0, 1.0, 2.5)]
)
def test_drawn_systems_against_rates(seed, load_per_preload):
    system = random(seed)
    expected = exact(system, load_per_preload, 1.0)
    for steps in (1, 8, 80):
        found = through(system, load_per_preload, steps=steps).force[:, ::2]
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8)


@pytest.mark.slow
@each("mu", [0.2, 0.4])
@each("load_per_preload", [(1000.0,), (1000.0, 100.0), (1000.0, 100.0, 1000.0)])
@each("gap", [0.0, 2e-5])
def test_a_wedge_with_a_gap_at_one_face(gap, mu, load_per_preload):
    """Held by weak springs until the second face closes; on unloading it sticks first and slips back later."""
    system = wedge(0.7, 0.9, mu, kt=1e7, kn=1e7)
    G = system.G.copy()
    G[:, 1] = 0.0
    kt = system.kt * [1.0, 0.0]
    system = replace(system, G=G, kt=kt, stiffness=np.full(2, 1e6), n0=np.array([0.0, -1e7 * gap]))
    expected = exact(system, load_per_preload, 1000.0)
    for steps in (1, 8, 80):
        found = through(system, load_per_preload, steps=steps).force[:, ::2]
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * 1000.0)


@pytest.mark.slow
def test_a_loose_wedge_lands_in_the_same_way_with_any_number_of_steps():
    """Gaps at all faces: the damper has no equilibrium until it touches, so its path jumps as the load begins.

    A bladed disk of six equal sectors is the second reference: it solves the equations of the whole disk.
    """
    study = lumped_study(6, 1, n_c=2, r=2)
    gap = {name: face.gap + 2e-7 for name, face in study.problem.coupling.model.interfaces.items()}
    apart = study.replace(gap=gap)
    system = apart.problem.static_system(0.0)
    found = [static_state(system, 300.0, steps=steps).q for steps in (1, 8, 80, 800)]
    for q in found[1:]:
        np.testing.assert_allclose(q, found[0], rtol=0.0, atol=1e-6 * np.abs(found[0]).max())
    ones = np.ones(6)
    whole = BladedDisk(
        study, dampers=DamperVariation(ones, ones, ones, 2e-7 * ones, ones < 0.0)
    ).system(300.0)
    expected = BladedDisk(apart).system(300.0).structure.at_rest
    np.testing.assert_allclose(
        whole.structure.at_rest, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max()
    )


def _elastic_face(seed, n_points, friction, kn):
    """A face whose tangential springs are far stiffer than its modes.

    The soft normal springs change the given normal forces little.
    """
    rng = np.random.default_rng(seed)
    along = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n_points), n_points - 1)
    directions = rng.normal(size=(n_points, 3, 3))
    modes = np.einsum("pk,kdc->pckd", along, directions).reshape(n_points, 3, -1)
    stiffness = np.repeat(1e5 * 10.0 ** (0.5 * np.arange(n_points)), 3)
    springs = 1e9 * 10.0 ** rng.uniform(-1.0, 1.0, (n_points, 2))
    normal = rng.uniform(0.5, 1.5, n_points) / n_points
    return StaticSystem(
        stiffness=stiffness,
        G=modes,
        kt=springs,
        kn=np.full(n_points, kn),
        mu=np.full(n_points, friction),
        n0=normal,
        force=np.zeros(len(stiffness)),
        shift=np.zeros((n_points, 3)),
        constant_force=np.zeros(len(stiffness)),
    )


@pytest.mark.parametrize("kn", [1e-4, 1e3])
@pytest.mark.parametrize(
    ("seed", "n_points", "friction"), [(3, 16, 0.1), (0, 16, 0.3), (2, 16, 0.3), (3, 24, 0.2)]
)
def test_a_face_on_soft_normal_springs_has_a_state(seed, n_points, friction, kn):
    """Under given normal forces a strictly convex energy has one state; soft springs change it little.

    The conditions are evaluated from the modal coordinates and the forces alone.
    """
    system = _elastic_face(seed, n_points, friction, kn)
    state = static_state(system, 0.0)
    assert state.ok, state.reason
    G = system.G.reshape(-1, system.G.shape[2])
    np.testing.assert_allclose(
        system.stiffness * state.q, -G.T @ state.force.ravel(), rtol=0.0, atol=1e-10
    )
    T = state.force[:, :2]
    normal = system.n0 + kn * (G @ state.q)[2::3]
    np.testing.assert_allclose(state.force[:, 2], normal, rtol=1e-9)
    limit = friction * state.force[:, 2:]
    assert np.all(np.abs(T) <= (1.0 + 1e-9) * limit)
    motion = (G @ state.q).reshape(-1, 3)[:, :2]
    slip = motion - T / system.kt
    sticks = np.abs(T) < (1.0 - 1e-9) * limit
    np.testing.assert_allclose(slip[sticks], 0.0, atol=1e-9 * np.abs(motion).max())
    assert sticks.any() and not sticks.all()
    assert np.all(slip[~sticks] * T[~sticks] > 0.0)


def test_an_edge_that_slides_is_in_equilibrium_from_the_first_step_on(monkeypatch):
    """A wedge with edge contact, whose damper slides until a further point sticks.

    With residuals relative to the final load, 2 of 24 directions of closed points stuck after the
    first short step, with an imbalance of 5e-9 of its load. No long step followed, and Newton
    iterations began 477 times.
    """
    arrays = np.load(Path(__file__).parents[1] / "golden" / "partial_contact.npz")
    system = StaticSystem(**arrays, constant_force=np.zeros(len(arrays["force"])))
    begun = []
    solve = static_module._LoadStep.solve
    monkeypatch.setattr(
        static_module._LoadStep,
        "solve",
        lambda step, status: begun.append(status) or solve(step, status),
    )
    load = 915.83
    state = static_state(system, load)
    assert state.ok, state.reason
    assert len(begun) < 100

    G = system.G.reshape(-1, system.G.shape[2])
    imbalance = system.stiffness * state.q + G.T @ state.force.ravel() - load * system.force
    assert np.abs(imbalance).max() < 1e-10 * load * np.abs(system.force).max()
    motion = (G @ state.q).reshape(-1, 3) + load * system.shift
    normal = np.maximum(system.n0 + system.kn * motion[:, 2], 0.0)
    np.testing.assert_allclose(state.force[:, 2], normal, atol=1e-9 * load)
    limit = system.mu[:, None] * normal[:, None]
    assert np.all(np.abs(state.force[:, :2]) <= limit + 1e-9 * load)
    # the preload presses both faces of the wedge with the same force
    left, right = state.force[:24, 2].sum(), state.force[24:48, 2].sum()
    assert left == pytest.approx(right, rel=0.01)
