"""Contact stiffness from the flexibility that the modes leave out."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.stiffness import SMALL_FORCE, paper_contact, paper_equations, unit_traction
from bdamper.model.structure import ContactStiffness
from bdamper.util.errors import ModelError
from bdamper.util.formatting import counted
from tests.models import wedge_model
from tests.plain import plain_study


def study(method, **settings):
    return plain_study(
        wedge_model(n_points=4, alpha=0.8, beta=0.7),
        bd.Excitation("tip"),
        engine_order=2,
        friction_coefficient=0.3,
        contact_stiffness=method,
        constraint_planes=False,
        **settings,
    )


def test_unit_traction_is_exact_for_a_diagonal_flexibility():
    rng = np.random.default_rng(0)
    give = rng.uniform(1e-9, 1e-7, (7, 3))
    contact = unit_traction(np.diag(give.ravel()), rng.uniform(0.5, 2.0, 7))
    np.testing.assert_allclose(contact.stiffness, 1 / give, rtol=1e-13)
    assert contact.source == "unit_traction"
    assert not contact.fallback.any()


def test_unit_traction_reproduces_the_displacement_under_a_uniform_traction():
    """k_i = A_i/(R A)_i: springs and full flexibility give way alike under that load."""
    rng = np.random.default_rng(1)
    a = rng.normal(size=(12, 30)) + 1j * rng.normal(size=(12, 30))
    flexibility = a @ a.conj().T * 1e-9
    area = rng.uniform(0.5, 2.0, 4)
    contact = unit_traction(flexibility, area)
    for axis in range(3):
        load = np.zeros((4, 3))
        load[:, axis] = area
        give = (flexibility.real @ load.ravel()).reshape(4, 3)[:, axis]
        for i in np.flatnonzero(~contact.fallback[:, axis]):
            assert area[i] / contact.stiffness[i, axis] == pytest.approx(give[i], rel=1e-12)
    assert (contact.stiffness > 0).all()


def test_unit_traction_of_what_is_not_flexible_is_an_error():
    with pytest.raises(ModelError, match="along t1: expected a positive displacement"):
        unit_traction(-np.eye(6), np.ones(2))


def test_a_point_that_gives_way_backwards_gets_the_median():
    give = np.diag(np.repeat([1.0, 2.0, 4.0], 3))
    give[0, 3] = give[3, 0] = -3.0  # along t1 point 0 moves against its traction, point 1 as well
    contact = unit_traction(give, np.ones(3))
    np.testing.assert_array_equal(contact.fallback[:, 0], [True, True, False])
    assert not contact.fallback[:, 1:].any()
    np.testing.assert_allclose(contact.stiffness[:, 0], 0.25)


class TestPaperEquations:
    def test_quotient_and_fallback(self):
        force = np.array(
            [[10.0, 5.0, 100.0], [-8.0, 0.02, 80.0], [0.4, -6.0, 3.0], [9.0, 4.0, -90.0]]
        )
        displacement = np.array(
            [[1e-6, 2e-6, 1e-5], [-2e-6, 1e-6, 4e-6], [1e-6, 3e-6, 1e-6], [3e-6, 1e-6, -1e-5]]
        )
        substitute = ContactStiffness(np.full((4, 3), 7.0), "unit_traction")
        contact = paper_equations(displacement, force, substitute)
        small = np.abs(force) <= SMALL_FORCE * np.abs(force).max(axis=0)
        against = displacement * force <= 0.0
        np.testing.assert_array_equal(contact.fallback, small | against)
        assert contact.fallback.tolist() == [
            [False, False, False],
            [False, True, False],
            [True, True, True],
            [False, False, False],
        ]
        np.testing.assert_array_equal(contact.stiffness[contact.fallback], 7.0)
        keep = ~contact.fallback
        np.testing.assert_allclose(
            contact.stiffness[keep], (force / np.where(keep, displacement, 1.0))[keep]
        )
        assert contact.source == "cigeroglu2009"

    def test_a_diagonal_flexibility_is_found_again(self):
        """(R F)_i/F_i is the diagonal, whatever the forces."""
        rng = np.random.default_rng(2)
        give, force = rng.uniform(1e-9, 1e-7, (5, 3)), rng.uniform(1.0, 2.0, (5, 3))
        contact = paper_equations(give * force, force, ContactStiffness(np.ones((5, 3)), "user"))
        assert not contact.fallback.any()
        np.testing.assert_allclose(contact.stiffness, 1 / give, rtol=1e-13)

    def test_quotients_far_from_unit_tractions_are_not_taken(self):
        """A force that has hardly an effect, or hardly a cause: quotients beyond a factor of ten are no stiffness."""
        by_force, by_traction = (
            plain_study(
                wedge_model(4),
                bd.Excitation("tip"),
                2,
                blade_modes=5,
                contact_stiffness=m,
                friction_coefficient=0.3,
            ).problem
            for m in ("cigeroglu2009", "unit_traction")
        )
        coupling = by_force.coupling
        force, left_out = paper_contact(coupling, np.full(coupling.n_points, 0.3))
        n_far = 0
        for name in ("left", "right"):
            rows = coupling.rows(name)
            found, other = by_force.stiffness[name], by_traction.stiffness[name].stiffness
            quotient = force[rows] / left_out[rows]
            far = (quotient > 10.0 * other) | (quotient < 0.1 * other)
            enough = np.abs(force[rows]) > SMALL_FORCE * np.abs(force[rows]).max(axis=0)
            n_far += (far & enough & (quotient > 0.0)).sum()
            np.testing.assert_array_equal(found.fallback, far | ~enough)
            np.testing.assert_allclose(
                found.stiffness, np.where(far | ~enough, other, quotient), rtol=1e-12
            )
        assert n_far >= 1


def test_stiffness_of_a_study():
    s = study("unit_traction")
    for name, contact in s.problem.stiffness.items():
        assert contact.stiffness.shape == (4, 3), name
        assert np.isfinite(contact.stiffness).all()
        assert (contact.stiffness > 0).all()
        assert contact.source == "unit_traction"
    n_fallback = sum(contact.fallback.sum() for contact in s.problem.stiffness.values())
    report = s.stiffness_report
    assert report.startswith(
        f"Contact stiffness (MN/m), median and range: "
        f"{counted(int(n_fallback), 'fallback value') if n_fallback else 'no fallback values'}"
    )
    for name, contact in s.problem.stiffness.items():
        (line,) = [line for line in report.splitlines() if line.startswith(f"{name} ")]
        for stiffness in contact.stiffness.T:
            assert f"{1e-6 * np.median(stiffness):.3g}" in line


def test_retaining_every_mode_leaves_less_flexibility():
    """More modes, stiffer contact: the residual flexibility only shrinks."""
    few, many = (
        study("unit_traction", blade_modes=n).problem.coupling.residual_flexibility(1)
        for n in (1, 5)
    )
    assert np.linalg.eigvalsh(few - many).min() > -1e-12 * np.abs(few).max()
    np.testing.assert_allclose(few, few.conj().T, rtol=0, atol=1e-20)


def test_user_values():
    s = study(3.5e6)
    for contact in s.problem.stiffness.values():
        assert (contact.stiffness == 3.5e6).all()
        assert contact.source == "user"
    given = {"left": np.array([1e6, 2e6, 3e6]), "right": np.full((4, 3), 5e6)}
    s = study(given)
    np.testing.assert_array_equal(
        s.problem.stiffness["left"].stiffness, np.tile([1e6, 2e6, 3e6], (4, 1))
    )
    with pytest.raises(bd.SettingError, match=r"contact_stiffness.*\['right'\]"):
        _ = study({"left": 1e6}).problem.stiffness
    with pytest.raises(
        bd.SettingError, match=r"contact_stiffness\['left'\]: expected finite numbers >= 0"
    ):
        _ = study({"left": -1.0, "right": 1.0}).problem.stiffness
    with pytest.raises(bd.SettingError, match="contact_stiffness: expected one of"):
        _ = study("eq5").problem.stiffness
