"""Multipliers against brute force: disturbed states marched in time through one period."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.stability import monodromy, multipliers, shooting_monodromy, stability_of_points
from bdamper.system import LAW_COUPLED, HarmonicSystem
from bdamper.timedomain import verify_solution
from tests.hard.test_case_04_17_folds_and_peaks import STUCK, followed, two_oscillators
from tests.models import acyclic_model


@pytest.fixture(scope="module")
def path():
    return followed(two_oscillators(15), 1.0, 3.5, STUCK)


def brute_force(system, y):
    M, _ = shooting_monodromy(system, y[:-1], y[-1], 1500)
    values = np.linalg.eigvals(M)
    return np.sort(np.abs(values[np.abs(values - 1.0) > 1e-9]))[::-1]


def test_multipliers_against_time_integration(path):
    """Points with slip or separation, stable and not."""
    system = two_oscillators(15)
    points = [p for p in path.points if p.shares[0] < 0.45][::14]
    assert len(points) >= 4
    verdicts = set()
    for p in points:
        found = np.sort(np.abs(multipliers(system, p.y[:-1], p.y[-1])))[::-1]
        expected = brute_force(system, p.y)
        np.testing.assert_allclose(found[:3], expected[:3], atol=2e-2)
        if abs(found[0] - 1.0) > 0.05:
            assert (found[0] > 1.0) == (expected[0] > 1.0)
            verdicts.add(bool(found[0] > 1.0))
    assert verdicts == {True, False}


def test_a_multiplier_is_one_at_a_fold(path):
    system = two_oscillators(15)
    folds = [p for p in path.points if (p.kind == "fold" and p.shares[1] > 0.0) or (p.kind == "fold" and p.shares[2] > 0.1)]
    assert folds
    for p in folds:
        values = multipliers(system, p.y[:-1], p.y[-1])
        assert np.abs(values - 1.0).min() < 2e-2


def test_sign_of_the_determinant_agrees_with_the_multipliers(path):
    """det J < 0 means unstable: no point may be unstable by the sign and stable by its multipliers."""
    system = two_oscillators(15)
    for p in path.points[::4]:
        _, J, _ = system.evaluate(p.y[:-1], p.y[-1])
        largest = np.abs(multipliers(system, p.y[:-1], p.y[-1])).max()
        if abs(largest - 1.0) > 0.02:
            assert (np.linalg.slogdet(J)[0] > 0) == (largest < 1.0)


def test_stuck_sliders_are_left_out():
    system = two_oscillators(3)
    p = followed(system, 1.0, 1.05, STUCK).points[0]
    assert p.shares[0] == 0.5  # of two directions, one has no friction
    M = monodromy(system, p.y[:-1], p.y[-1])
    assert M.shape == (4, 4)
    # linear: the determinant is that of viscous damping alone
    np.testing.assert_allclose(np.linalg.det(M), np.exp(-2 * 0.05 * 2 * np.pi / p.y[-1]), rtol=1e-9)


def test_sampled_law_is_judged_by_shooting(path):
    exact, sampled = two_oscillators(15), two_oscillators(15, evaluation=bd.Sampled(512))
    for p in [q for q in path.points if q.shares[2] > 0.5][::12]:
        a = stability_of_points(exact, p.y[None, :-1], p.y[-1:])
        b = stability_of_points(sampled, p.y[None, :-1], p.y[-1:])
        assert "shooting" in b.note
        assert abs(a.largest[0] - b.largest[0]) < 0.03 * a.largest[0]
        if abs(a.largest[0] - 1.0) > 0.05:
            assert a.stable[0] == b.stable[0]


def test_coupled_law_is_judged_by_shooting_and_verified(path):
    """Motion along one tangential axis: the disk of the coupled law is the interval of the separable one."""
    exact, sampled = two_oscillators(15), two_oscillators(15, evaluation=bd.Sampled(512))
    points = replace(exact.points, law=np.array([LAW_COUPLED], np.intc))
    coupled = HarmonicSystem(exact.bases, points, exact.force, exact.response_rows, bd.Sampled(512))
    slipping = [q for q in path.points if q.shares[1] > 0.05][::10]
    assert len(slipping) >= 3
    for p in slipping:
        a = stability_of_points(sampled, p.y[None, :-1], p.y[-1:])
        b = stability_of_points(coupled, p.y[None, :-1], p.y[-1:])
        assert "shooting" in b.note
        np.testing.assert_allclose(b.largest, a.largest, rtol=1e-6)
    p = max((q for q in path.points), key=lambda q: abs(exact.response(q.y[:-1])[1]))
    assert verify_solution(coupled, p.y[:-1], p.y[-1], 1, 0, periods=30, steps_per_period=400).distance < 1e-2


def test_coupled_law_of_a_study():
    """Friction along both tangential axes: harmonic balance, verdict and time integration of one acyclic structure."""
    study = bd.Study(
        acyclic_model(1, n_points=4, n_blade_modes=2),
        engine_order=0,
        harmonics=3,
        contact_stiffness=2e6,
        friction_coefficient=0.3,
        friction_law="coupled",
        evaluation=bd.Sampled(64),
        damping_ratio=0.03,
        excitation=bd.Excitation("tip", "tangential", 100.0),
    )
    curve = study.track(50.0, (290.0, 320.0))
    assert curve.complete
    assert curve.shares[curve.peak.index, 1] > 0.02
    assert study.verify(curve, periods=5, steps_per_period=448).distance < 0.02
    i = curve.peak.index
    judged = stability_of_points(study.system(50.0), curve.unknowns[[i]], 2 * np.pi * curve.frequency[[i]])
    assert judged.stable.all()
    assert 0.1 < judged.largest[0] < 1.0


def test_curves_carry_stability(tmp_path):
    study = bd.Study(
        acyclic_model(1),
        engine_order=0,
        contact_stiffness="model",
        damping_ratio=0.02,
        excitation=bd.Excitation("tip", "tangential", 40.0),
    )
    curve = study.track(200.0, (250.0, 450.0), stability=True)
    assert curve.complete
    assert curve.stable.shape == (len(curve),)
    assert "all disturbances" in curve.stability_note
    assert "unstable" in str(curve)
    curve.save(tmp_path / "curve.h5")
    again = bd.load_curve(tmp_path / "curve.h5")
    np.testing.assert_array_equal(again.stable, curve.stable)
    assert again.notes == curve.notes
    assert again.stability_note == curve.stability_note


def test_cyclic_structures_by_the_determinant():
    study = bd.Study(
        bd.reference_model("bladed_disk", 9),
        engine_order=5,
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip", "tangential", 1.0),
    )
    curve = study.track(1000.0, (320.0, 380.0), stability=True)
    assert "keep the travelling wave" in curve.stability_note
    # between the two folds, and nowhere else
    folds = [fold.index for fold in curve.folds]
    assert len(folds) == 2
    unstable = np.flatnonzero(~curve.stable)
    assert unstable.min() >= folds[0]
    assert unstable.max() <= folds[1]
    assert len(unstable) >= folds[1] - folds[0] - 1
    other = bd.reference_model("bladed_disk", 24)
    with pytest.raises(bd.SettingError, match="curve"):
        bd.Study(other, engine_order=5, excitation=bd.Excitation("tip")).with_stability(curve)
