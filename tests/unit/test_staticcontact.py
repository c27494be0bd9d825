"""Condensed static contact: certificate, closed forms of the rigid wedge, unloading."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.coupling import Coupling, retained_modes
from bdamper.errors import ModelError
from bdamper.staticcontact import (
    OPEN,
    StaticContactProblem,
    certify,
    solve_static_contact,
    static_contact_problem,
)
from tests.models import wedge_model


def coupling_of(model, engine_order):
    faces = tuple(name for name, face in model.interfaces.items() if face.kind == "friction")
    return Coupling(model, faces, retained_modes(model, 2, 0), engine_order)


@pytest.fixture(scope="module", params=(9, 24, 48))
def coupling(request):
    return coupling_of(bd.reference_model("bladed_disk", request.param), 5)


@pytest.mark.parametrize("mu", [0.0, 0.05, 0.3, 0.6, 1.0, 1.8, 2.5])
def test_certificate_on_the_reference_model(coupling, mu):
    n = coupling.n_points
    solution = solve_static_contact(static_contact_problem(coupling, np.full(n, mu), np.zeros(n)))[0]
    assert solution.certificate.worst < 1e-10


def test_frictionless_force_is_that_of_statics(coupling):
    """Faces at 60 degrees from the radial axis: N = P/(2 sin 60) on each."""
    n = coupling.n_points
    solution = solve_static_contact(static_contact_problem(coupling, np.zeros(n), np.zeros(n)))[0]
    half = solution.force[: n // 2, 2].sum(), solution.force[n // 2 :, 2].sum()
    np.testing.assert_allclose(half, 1.0 / (2.0 * np.sin(np.pi / 3)), rtol=1e-10)


def test_state_is_proportional_to_the_load(coupling):
    n = coupling.n_points
    problem = static_contact_problem(coupling, np.full(n, 0.3), np.zeros(n))
    one = solve_static_contact(problem)[0]
    many = solve_static_contact(problem, (7.0, 50.0, 400.0), steps=3)[-1]
    np.testing.assert_allclose(many.force, 400.0 * one.force, atol=1e-9 * np.abs(many.force).max())


def test_unloading_remembers(coupling):
    n = coupling.n_points
    problem = static_contact_problem(coupling, np.full(n, 0.3), np.zeros(n))
    up, down, again = solve_static_contact(problem, (1.0, 0.4, 1.0))
    for state in (up, down, again):
        assert state.certificate.worst < 1e-10
    assert np.abs(down.force - 0.4 * up.force).max() > 0.01 * np.abs(up.force).max()
    # the wedge is held back by friction on its way out: more normal force than on the way in
    assert down.force[:, 2].sum() > 0.4 * up.force[:, 2].sum()


def test_gaps_close_under_load():
    coupling = coupling_of(bd.reference_model("bladed_disk", 9), 5)
    gap = 1e-6 * np.random.default_rng(0).random(18)
    states = solve_static_contact(static_contact_problem(coupling, np.full(18, 0.3), gap), (100.0, 1000.0, 200.0, 1500.0))
    for state in states:
        assert state.certificate.worst < 1e-10
    contacts = [(state.status[:, 0] != OPEN).sum() for state in states]
    assert contacts[0] < contacts[-1]


@pytest.mark.parametrize("seed", range(6))
def test_random_wedges(seed):
    coupling = coupling_of(wedge_model(seed, n_points=6, alpha=0.6 + 0.1 * seed, beta=0.9), 2)
    n = coupling.n_points
    problem = static_contact_problem(coupling, np.full(n, 0.2), np.zeros(n))
    # a damper that deforms under its own load as one does: its displacement is of the size of that by the contact
    problem = replace(problem, offset=0.02 * problem.offset)
    assert solve_static_contact(problem)[0].certificate.worst < 1e-10


def test_one_point_pressed_and_dragged():
    """A body with two rigid coordinates on one contact: N from equilibrium, slip where the drag exceeds mu N."""
    for drag, states in ((0.2, [0, 0]), (0.3 - 1e-9, [0, 0])):
        problem = StaticContactProblem(
            flexibility=np.diag([1e-8, 1e-8, 2e-8]),
            rigid=np.eye(3)[:, [0, 2]],
            load=np.array([drag, 1.0]),
            offset=np.zeros((1, 3)),
            friction=np.array([0.3]),
            gap=np.array([1e-6]),
        )
        s = solve_static_contact(problem, (10.0,))[0]
        np.testing.assert_allclose(s.force, [[10.0 * drag, 0.0, 10.0]], atol=1e-12)
        np.testing.assert_allclose(s.motion[0], [0.0, 0.0, 1e-6], atol=1e-18)
        assert s.status[0].tolist() == states
    with pytest.raises(ModelError, match="did not settle"):
        solve_static_contact(
            StaticContactProblem(
                problem.flexibility, problem.rigid, np.array([0.4, 1.0]), problem.offset, problem.friction, problem.gap
            ),
            (10.0,),
        )


def test_certificate_sees_each_violation(coupling):
    n = coupling.n_points
    problem = static_contact_problem(coupling, np.full(n, 0.3), np.zeros(n))
    s = solve_static_contact(problem)[0]
    rest = np.zeros((n, 2))
    closed = int(np.argmax(s.force[:, 2]))
    open_ = int(np.flatnonzero(s.status[:, 0] == OPEN)[0])

    def broken(name, point, component, value, what="force"):
        force, motion = s.force.copy(), s.motion.copy()
        (force if what == "force" else motion)[point, component] = value
        assert getattr(certify(problem, 1.0, force, motion, rest), name) > 1e-3

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
