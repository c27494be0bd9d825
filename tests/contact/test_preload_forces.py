"""Condensed static contact: certificate, closed forms of the rigid wedge; how the search for a static state gives up."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact import static_contact, static_state
from bdamper.contact.preload_state import OPEN
from bdamper.contact.static_contact import (
    StaticContactProblem,
    solve_static_contact,
    static_contact_problem,
)
from bdamper.model.kinematics import Coupling, retained_modes
from bdamper.util.errors import ModelError
from tests.certificate import certify, worst
from tests.each import each
from tests.models import wedge_model
from tests.plain import plain_study
from tests.printed import said


def coupling_of(model, engine_order):
    faces = tuple(name for name, face in model.interfaces.items() if face.kind == "friction")
    return Coupling(
        model, faces, retained_modes(model, 2, dict.fromkeys(model.bodies, 0)), engine_order
    )


@pytest.fixture(scope="module", params=(9, 24, 48))
def coupling(request):
    return coupling_of(bd.reference_model("bladed_disk", request.param), 5)


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.0, 0.05, 0.3, 0.6, 1.0, 1.8, 2.5])
def test_certificate_on_the_reference_model(coupling, mu):
    n = coupling.n_points
    problem = static_contact_problem(coupling, np.full(n, mu))
    assert worst(problem, solve_static_contact(problem)) < 1e-10


@pytest.mark.slow
def test_frictionless_force_is_that_of_statics(coupling):
    """Faces at 60 degrees from the radial axis: N = P/(2 sin 60) on each."""
    n = coupling.n_points
    solution = solve_static_contact(static_contact_problem(coupling))
    half = solution.force[: n // 2, 2].sum(), solution.force[n // 2 :, 2].sum()
    np.testing.assert_allclose(half, 1.0 / (2.0 * np.sin(np.pi / 3)), rtol=1e-10)


@pytest.mark.slow
@each("own", [0.02, 1.0, 5.0])
@each("mu", [0.0, 0.2, 0.5, 1.0, 2.0])
def test_random_wedges(mu, own):
    """A damper that deforms under its own load as one does (2 % of the synthetic one), and far more."""
    for seed in range(12):
        coupling = coupling_of(
            wedge_model(seed, n_points=6, alpha=0.6 + 0.1 * (seed % 6), beta=0.9), 2
        )
        n = coupling.n_points
        problem = static_contact_problem(coupling, np.full(n, mu))
        problem = replace(problem, offset=own * problem.offset)
        state = solve_static_contact(problem)
        assert worst(problem, state) < 1e-10
        motion = (
            problem.rigid @ state.rigid
            - problem.flexibility @ state.force.ravel()
            + problem.offset.ravel()
        )
        np.testing.assert_allclose(state.motion.ravel(), motion, atol=1e-12 * np.abs(motion).max())


def distinct_states(problem, starts=200):
    """Certified states by status, from no force and from random forces and motions, with sliders at rest."""
    rng = np.random.default_rng(0)
    solver, n, m = static_contact._Solver(problem), len(problem.friction), problem.rigid.shape[1]
    rest, found = np.zeros((n, 2)), {}
    for start in range(starts):
        F = np.zeros((n, 3)) if start == 0 else 10.0 * rng.standard_normal((n, 3))
        F[:, 2] = np.abs(F[:, 2])
        end, converged = solver.newton(F, np.zeros(m), rest, most=50)
        motion = solver.motion(end.force, end.eta)
        if converged and max(certify(problem, end.force, motion, rest).values()) < 1e-10:
            found[end.status[0, 0]] = end.force
    return found


def test_several_states_are_found():
    """Normal and tangential flexibility coupled, mu beyond a/|c|: apart, stuck and slipping are all states (Klarbring).

    Slip along +1: ``N = (x_v - g)/(b + c mu)``, and ``b + c mu < 0`` turns a surface that lifts off into a pressed one.
    """
    a, b, c, mu = 2.0, 1.0, -0.8, 2.0
    problem = StaticContactProblem(
        flexibility=np.array([[a, 0.0, c], [0.0, 1.0, 0.0], [c, 0.0, b]]),
        rigid=np.zeros((3, 0)),
        load=np.zeros(0),
        offset=np.array([[8.0, 0.0, -1.0]]),
        friction=np.array([mu]),
    )
    found = distinct_states(problem)
    assert sorted(found) == [0, 1, 3]
    np.testing.assert_allclose(
        found[1][0], [mu * -1.0 / (b + c * mu), 0.0, -1.0 / (b + c * mu)], rtol=1e-12
    )
    np.testing.assert_allclose(found[3], 0.0, atol=1e-15)
    stuck = np.linalg.solve([[a, c], [c, b]], [8.0, -1.0])
    np.testing.assert_allclose(found[0][0, [0, 2]], stuck, rtol=1e-12)
    # with little friction there is one
    assert len(distinct_states(replace(problem, friction=np.array([0.5])))) == 1


def test_no_state_without_equilibrium():
    """A flat wedge without friction on one face only is pushed away."""
    coupling = coupling_of(bd.reference_model("bladed_disk", 9), 5)
    problem = static_contact_problem(coupling, np.full(18, 0.3))
    solve_static_contact(problem)
    rows = np.arange(27)
    half = StaticContactProblem(
        problem.flexibility[np.ix_(rows, rows)], problem.rigid[rows], problem.load, problem.offset[:9],
        np.full(9, 0.3),
    )  # fmt: skip
    with pytest.raises(ModelError, match="the body slides away"):
        solve_static_contact(half)


def test_one_point_pressed_and_dragged():
    """A body with two rigid coordinates on one contact: N from equilibrium, slip where the drag exceeds mu N."""
    for drag, states in ((0.2, [0, 0]), (0.3 - 1e-9, [0, 0])):
        problem = StaticContactProblem(
            flexibility=np.diag([1e-8, 1e-8, 2e-8]),
            rigid=np.eye(3)[:, [0, 2]],
            load=np.array([drag, 1.0]),
            offset=np.zeros((1, 3)),
            friction=np.array([0.3]),
        )
        s = solve_static_contact(problem)
        np.testing.assert_allclose(s.force, [[drag, 0.0, 1.0]], atol=1e-13)
        np.testing.assert_allclose(s.motion[0], 0.0, atol=1e-19)
        assert s.status[0].tolist() == states
    # N = 1, T up to 0.3
    with pytest.raises(
        ModelError,
        match=r"that balance the load, found none, so that the body slides away; raise the friction",
    ):
        solve_static_contact(replace(problem, load=np.array([0.4, 1.0])))


def test_certificate_sees_each_violation(coupling):
    n = coupling.n_points
    problem = static_contact_problem(coupling, np.full(n, 0.3))
    s = solve_static_contact(problem)
    rest = np.zeros((n, 2))
    closed = int(np.argmax(s.force[:, 2]))
    open_ = int(np.flatnonzero(s.status[:, 0] == OPEN)[0])

    def broken(name, point, component, value, what="force"):
        force, motion = s.force.copy(), s.motion.copy()
        (force if what == "force" else motion)[point, component] = value
        assert certify(problem, force, motion, rest)[name] > 1e-3

    big, far = np.abs(s.force).max(), np.abs(s.motion).max()
    broken("tension", open_, 2, -0.1 * big)
    broken("equilibrium", closed, 2, 0.5 * s.force[closed, 2])
    broken("friction", closed, 0, 0.5 * s.force[closed, 2])
    broken("penetration", open_, 2, 0.1 * far, "motion")
    broken("separation", closed, 2, -0.5 * far, "motion")
    stuck = int(np.flatnonzero((s.status[:, 1] == 0) & (s.force[:, 2] > 0.05 * big))[0])
    broken("sticking", stuck, 1, 0.5 * far, "motion")
    slipping = np.argwhere((s.status == 1) | (s.status == 2))
    p, d = slipping[np.argmax(s.force[slipping[:, 0], 2])]
    broken("sense", p, d, -np.sign(s.force[p, d]) * far, "motion")


@pytest.mark.slow
def test_what_goes_round_in_circles_is_given_up(monkeypatch):
    """The states that are found are the same, with fewer factorisations; rounding decides which of them go round."""
    solved = {}
    solve = static_state._solve

    def counted(*a):
        solved[static_state.STALLS] += 1
        return solve(*a)

    monkeypatch.setattr(static_state, "_solve", counted)

    def state(seed, stalls):
        monkeypatch.setattr(static_state, "STALLS", stalls)
        solved.setdefault(stalls, 0)
        study = plain_study(
            wedge_model(seed, n_points=6),
            bd.Excitation("tip"),
            engine_order=2,
            friction_coefficient=0.5,
        )
        return study.static(100.0)

    usual, never = static_state.STALLS, 10**9
    for seed in (3, 22, 40):
        soon, late = state(seed, usual), state(seed, never)
        assert soon.ok and soon.residual < 1e-10
        assert np.array_equal(soon.status, late.status) and np.array_equal(soon.q, late.q)
    assert solved[usual] < 0.5 * solved[never]


def test_several_motions_at_once_are_each_alone():
    rng = np.random.default_rng(0)
    n, m = 5, 4
    stiffness, G = rng.uniform(1.0, 2.0, m), rng.normal(size=(n, 3, m))
    kt, kn, mu, n0 = (
        rng.uniform(1.0, 2.0, (n, 2)),
        rng.uniform(1.0, 2.0, n),
        np.full(n, 0.3),
        rng.normal(size=n),
    )
    bonded = np.arange(n) == 2
    force, shift = rng.normal(size=m), rng.normal(size=(n, 3))
    system = static_state.StaticSystem(
        stiffness, G, kt, kn, mu, n0, force, shift, np.zeros(m), bonded
    )
    x, w = rng.normal(size=(7, n, 3)), rng.normal(size=(n, 2))
    forces, states = static_state._forces(system, x, w)
    assert {
        static_state.OPEN,
        static_state.STICK,
        static_state.SLIP_PLUS,
        static_state.SLIP_MINUS,
    } <= set(np.unique(states))
    for one, f, s in zip(x, forces, states):
        alone = static_state._forces(system, one, w)
        assert np.array_equal(alone[0], f) and np.array_equal(alone[1], s)
        # closed form, point by point
        for p in range(n):
            level = n0[p] + kn[p] * one[p, 2]
            trial = kt[p] * (one[p, :2] - w[p])
            limit = np.inf if bonded[p] else 0.3 * max(level, 0.0)
            np.testing.assert_allclose(
                f[p, :2], np.clip(trial, -limit, limit), rtol=1e-14, atol=1e-15
            )
            assert f[p, 2] == pytest.approx(
                level if bonded[p] else max(level, 0.0), rel=1e-14, abs=1e-15
            )


def test_points_of_axial_stops_are_no_friction_points(tmp_path):
    """The blade has 18 points on its faces with friction and 8 on the axial stops, which are open at rest."""
    study = plain_study(
        bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, friction_coefficient=0.3
    )
    state = study.static(200.0)
    on_faces = [
        kind
        for kind, face in zip(state.state, state.interface)
        if study.model.interfaces[face].kind == "friction"
    ]
    counts = tuple(on_faces.count(name) for name in ("stick", "slip", "open"))
    assert len(on_faces) == 18 < len(state.state) == 26
    assert "18 friction points slip: static state under a preload of 200 N" in state._headline()
    assert "points stick {}, slip {}, open {}".format(*counts) in said(state)
    assert counts[2] == 0
    state.save(tmp_path / "state.h5")
    assert bd.load(tmp_path / "state.h5")._headline() == state._headline()
    found = bd.microslip(study, 200.0, [1.0, 5.0])
    np.testing.assert_array_equal(found.array("open"), 0.0)
