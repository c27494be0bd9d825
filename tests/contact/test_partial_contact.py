"""Bonded parts of the faces: the linear test of residual modes against a dense reduction, and vectors of parts."""

from dataclasses import replace
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
import scipy.linalg

import bdamper as bd
from bdamper.contact.partial_contact import (
    PART_LIMIT,
    WHOLE,
    bonded_parts,
    coupling_of_default,
    partial_contact,
)
from bdamper.contact.residual_flexibility import ResidualModes, ResidualSet, joined, parts_of_faces

MODELS = ("turbine_blade", "bladed_disk", "paper_disk")
PARTS = ("outer third", "inner third", "front third", "rear third")


def coupling(name, order=5):
    return coupling_of_default(bd.reference_model(name, 9), order)


@pytest.mark.parametrize("name", MODELS)
def test_parts_are_at_the_ends_of_every_face(name):
    made = coupling(name)
    found = parts_of_faces(made)
    for face in made.friction_faces:
        rows = np.arange(made.n_points)[made.rows(face)]
        points = made.model.interfaces[face].points
        radius = np.hypot(points[:, 0], points[:, 1])
        inner, outer = (radius[np.isin(rows, found[part])] for part in ("inner", "outer"))
        assert len(inner) == len(outer) == 3
        assert inner.max() < outer.min()
        front, rear = (points[np.isin(rows, found[part])] for part in ("front", "rear"))
        assert len(front) == len(rear) == 3
        # t2 is along the axis or against it
        assert np.abs(front[:, 2].mean() - rear[:, 2].mean()) > 0.6 * np.ptp(points[:, 2])


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_vectors_of_parts_are_exact_for_parts(name):
    """Six vectors of stuck modes are up to 7 % off; points keep 0.19 of their flexibility."""
    made = coupling(name)
    six = partial_contact(made, ResidualModes())
    own = partial_contact(made, ResidualModes(partial_contact=True))
    assert abs(own.errors[WHOLE]) < 1e-6
    assert max(abs(six.errors[part]) for part in PARTS) > 0.035
    assert max(abs(own.errors[part]) for part in PARTS) < 0.04
    assert np.mean([abs(own.errors[part]) for part in PARTS]) < 0.012
    friction = np.full(made.n_points, 0.3)
    assert ResidualSet.make(made, friction, ResidualModes(partial_contact=True)).share > 0.19


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_all_vectors_are_exact_for_every_part(name):
    found = partial_contact(coupling(name), ResidualModes("all"))
    assert max(map(abs, found.errors.values())) < 2e-3


def test_shift_is_that_of_the_coordinates_with_springs():
    """Modes, residual coordinates and springs at the bonded points, without the mass of the damper."""
    made = coupling("bladed_disk")
    options = ResidualModes(inertia=False)
    found = partial_contact(made, options)
    residual = ResidualSet.make(made, np.full(made.n_points, 0.3), options)
    whole = joined(made.basis(1), residual.basis(1))
    mass = np.where(whole.omega2 > 0.0, whole.mass, 0.0)
    free = np.sqrt(whole.omega2[whole.omega2 > 0.0].min())
    R = ResidualSet.make(made, np.full(made.n_points, 0.3), ResidualModes("all", inertia=False))
    exact = joined(made.basis(1), R.basis(1))

    def shift(basis, flexibility, points):
        active = residual.active[points]
        G = basis.G[points][active]
        springs = 1.0 / flexibility[points][active]
        stiffness = np.diag(basis.omega2) + G.conj().T @ (springs[:, None] * G)
        # a part may leave the damper free to move
        stiffness[np.diag_indices_from(stiffness)] += np.where(basis.omega2 > 0.0, 0.0, 1.0)
        masses = np.where(basis.omega2 > 0.0, basis.mass, 0.0)
        return scipy.linalg.eigh(np.diag(masses), stiffness, eigvals_only=True)[-1] ** -0.5 - free

    assert mass.any()
    for part, points in bonded_parts(made).items():
        expected = shift(whole, residual.flexibility, points) / shift(exact, R.flexibility, points)
        assert found.errors[part] == pytest.approx(expected - 1.0, abs=2e-3)


@pytest.mark.slow
def test_shifts_of_several_modes_are_those_of_the_stuck_damper():
    """Interlaced frequencies of the coordinates with springs at all points, for each of the lowest modes."""
    made = coupling("bladed_disk")
    found = partial_contact(made, ResidualModes())
    residual = ResidualSet.make(made, np.full(made.n_points, 0.3), ResidualModes("all"))
    whole = joined(made.basis(1), residual.basis(1))
    springs = np.where(residual.active, 1.0 / residual.flexibility, 0.0).ravel()
    rows = whole.G.reshape(len(springs), -1)
    stiffness = np.diag(whole.omega2) + rows.conj().T @ (springs[:, None] * rows)
    basis = made.basis(1)
    # neither the damper nor residual coordinates have mass here
    has_mass = np.arange(whole.n_modes) < basis.n_modes
    has_mass[: basis.n_modes] &= basis.omega2 > 0.0
    masses = np.diag(np.where(has_mass, 1.0, 0.0))
    mu = scipy.linalg.eigh(masses, stiffness, eigvals_only=True)[::-1]
    free = np.sqrt(np.sort(basis.omega2[basis.omega2 > 0.0]))
    expected = mu[: len(found.shifts)] ** -0.5 / free[: len(found.shifts)] - 1.0
    assert len(found.shifts) == 6
    np.testing.assert_allclose(found.shifts, expected, atol=2e-3)


def test_worst_part_and_limits():
    found = partial_contact(coupling("turbine_blade"), ResidualModes())
    assert found.worst_part == "outer front corner"
    assert abs(found.errors[found.worst_part]) > PART_LIMIT and not found.accurate
    assert partial_contact(coupling("bladed_disk"), ResidualModes(partial_contact=True)).accurate


def test_static_forces_remain_complete():
    """Sliders of points that stick keep the static forces: the represented displacement is that of R."""
    study = bd.Study(
        bd.reference_model("bladed_disk"),
        bd.Excitation("tip"),
        engine_order=5,
        friction_coefficient=0.4,
        contact_stiffness=ResidualModes(partial_contact=True),
    )
    residual = study.problem.contact.residual
    force = residual.static.ravel()
    modes = residual.basis(0)
    columns = modes.G.reshape(len(force), -1).real
    represented = (
        residual.flexibility.ravel() * force + columns @ (columns.T @ force) / modes.omega2[0]
    )
    active = residual.active.ravel()
    complete = study.problem.coupling.residual_flexibility(0).real @ force
    np.testing.assert_allclose(
        represented[active], complete[active], atol=1e-9 * np.abs(complete).max()
    )


def test_parts_that_do_not_shift_the_mode_have_no_error():
    """Faces at nodes of mode 1: both shifts are rounding, and their ratio would be any number."""
    made = coupling("bladed_disk")
    basis = made.basis(1)
    apart = replace(basis, G=np.zeros_like(basis.G))
    with mock.patch.object(type(made), "basis", return_value=apart):
        found = partial_contact(made, ResidualModes())
    assert abs(found.shift) < 1e-6 and found.errors == {} and found.worst_part == "whole faces"


@pytest.mark.slow
def test_as_many_vectors_as_asked_for():
    """Ten blade modes and six motions of the damper have sixteen stuck modes."""
    made = coupling("bladed_disk")
    friction = np.full(made.n_points, 0.3)
    for n in (6, 16, 24, 40):
        assert ResidualSet.make(made, friction, ResidualModes(n)).basis(1).n_modes == n
    errors = [partial_contact(made, ResidualModes(n)).errors for n in (16, 40)]
    sixteen, forty = (np.mean([abs(found[part]) for part in PARTS]) for found in errors)
    assert forty < sixteen


@pytest.mark.nightly
@pytest.mark.slow
def test_peaks_of_the_difficult_disk_agree_with_those_of_all_vectors():
    """At the optimum six vectors are 6.8 % too low; 61.0 um with 72 vectors of a harmonic."""
    study = bd.Study(
        bd.reference_model("bladed_disk"),
        bd.Excitation("tip"),
        engine_order=5,
        friction_coefficient=0.4,
    )
    own = study.replace(contact_stiffness=ResidualModes(partial_contact=True)).peak(103.67)
    exact = study.replace(contact_stiffness=ResidualModes("all")).peak(103.67)
    assert own.amplitude == pytest.approx(exact.amplitude, rel=0.015)
    assert study.peak(103.67).amplitude < 0.95 * exact.amplitude


def test_rounding_does_not_choose_a_part_of_a_single_row_of_points():
    """A row along the axis has no extent along t1: all its points are inner and outer ones."""
    points = np.array([[0.3, 0.0, z] for z in (-0.015, -0.005, 0.005, 0.015)])
    points[:, 1] = [0.0, 1e-9, -2e-9, 1e-9]
    frame = np.tile([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], (4, 1, 1))
    row = SimpleNamespace(points=points, frame=frame)
    model = SimpleNamespace(interfaces={"row": row})
    made = SimpleNamespace(
        friction_faces=("row",), model=model, n_points=4, rows=lambda name: slice(0, 4)
    )
    found = {part: rows.tolist() for part, rows in parts_of_faces(made).items()}
    assert found == {"outer": [0, 1, 2, 3], "inner": [0, 1, 2, 3], "front": [0, 1], "rear": [2, 3]}


@pytest.mark.parametrize("name", ["turbine_blade", "bladed_disk"])
def test_every_harmonic_has_as_many_vectors(name):
    """Six of stuck modes and four of parts: stiff combinations fade out and are not left out."""
    made = coupling(name)
    friction = np.full(made.n_points, 0.3)
    residual = ResidualSet.make(made, friction, ResidualModes(partial_contact=True))
    assert [residual.basis(harmonic).n_modes for harmonic in range(4)] == [10, 10, 10, 10]


@pytest.mark.slow
def test_equations_with_vectors_of_parts_change_smoothly_over_speed():
    """A run-up interpolates over speed, and has the highest point of all vectors to 2 %."""
    given = ResidualModes(partial_contact=True)
    study = bd.Study(
        bd.reference_model("turbine_blade"),
        bd.Excitation("tip", amplitude=30.0),
        engine_order=5,
        friction_coefficient=0.3,
        contact_stiffness=given,
    )
    own = study.run_up()
    assert own.complete
    exact = study.replace(contact_stiffness=ResidualModes("all")).run_up()
    assert own.peak.amplitude == pytest.approx(exact.peak.amplitude, rel=0.02)


@pytest.mark.slow
def test_a_model_that_needs_vectors_of_parts_has_them_by_default(tmp_path):
    """The choice belongs to the model: files keep it, and it changes the fingerprint."""
    model = bd.reference_model("turbine_blade", 9)
    needs = replace(model, partial_contact=True)
    assert needs.hash != model.hash and "partial_contact=True" in str(needs)
    bd.save_model(needs, tmp_path / "model.h5")
    loaded = bd.load_model(tmp_path / "model.h5")
    assert loaded.partial_contact and loaded.hash == needs.hash

    def flexibility(model, **options):
        study = bd.Study(model, bd.Excitation("tip"), 5, friction_coefficient=0.3, **options)
        return study.problem.stiffness_method, study.problem.contact.residual.basis(1)

    own, basis = flexibility(loaded)
    asked, expected = flexibility(model, contact_stiffness=ResidualModes(partial_contact=True))
    assert own == asked
    np.testing.assert_array_equal(basis.omega2, expected.omega2)
    bonded, basis_of_bonded = flexibility(model)
    assert bonded == "residual_modes" and basis_of_bonded.n_modes < basis.n_modes
