"""The stuck limit of interfaces that touch, against plain eigenproblems, and shares of stick from the springs."""

import warnings

import numpy as np
import pytest
import scipy.linalg

import bdamper as bd
from bdamper.response.linear_limits import resonance_interval
from bdamper.util.errors import BdamperWarning
from tests.plain import plain_study
from tests.printed import said

K0 = (2.0 * np.pi * 221.0) ** 2
"""Stiffness (N/m) of a blade of 1 kg."""
SHROUD = {"kt": 7.0 * K0, "kn": 11.0 * K0, "mu": 0.3}
TOUCHES = r"interface 'contact 1' touches without a normal load: its touching points count as stuck"


def blade(**shroud):
    """Blade and tip, which a shroud holds along two directions of the tip."""
    contact = bd.Contact({1: 0.8}, {1: 0.6}, **(SHROUD | shroud))
    K = np.array([[1.6 * K0, -0.6 * K0], [-0.6 * K0, 0.6 * K0]])
    return bd.lumped([1.0, 0.1], 1e-7 * K, K, contacts=[contact], forces={1: 1.0}), K


def poles(K, *springs):
    K = K + sum(k * np.outer(row, row) for k, row in springs)
    return np.sqrt(scipy.linalg.eigh(K, np.diag([1.0, 0.1]), eigvals_only=True)) / (2.0 * np.pi)


def test_a_shroud_that_touches_without_load_sticks():
    study, K = blade()
    with pytest.warns(BdamperWarning, match=TOUCHES):
        stuck = study.stuck((100.0, 600.0))
    held = poles(K, (SHROUD["kt"], [0.0, 0.8]), (SHROUD["kn"], [0.0, 0.6]))
    assert stuck.peak.frequency == pytest.approx(held[0], rel=1e-3)
    assert held[0] > 1.2 * poles(K)[0]
    assert np.all(stuck.shares == [1.0, 0.0, 0.0])
    free = study.free((100.0, 600.0))
    assert free.peak.frequency == pytest.approx(poles(K)[0], rel=1e-3)
    assert np.all(free.shares == [0.0, 0.0, 1.0])
    # a study warns once
    with warnings.catch_warnings():
        warnings.simplefilter("error", BdamperWarning)
        low, high = resonance_interval(study.problem.at(0.0))
    assert low < poles(K)[0] < held[0] < high


@pytest.mark.parametrize("shroud", [{"preload": 5.0}, {"gap": 1e-6}])
def test_a_shroud_with_a_load_or_a_gap_is_as_it_is_at_rest(shroud):
    study, K = blade(**shroud)
    with warnings.catch_warnings():
        warnings.simplefilter("error", BdamperWarning)
        stuck = study.stuck((100.0, 600.0))
    closed = "preload" in shroud
    springs = ((SHROUD["kt"], [0.0, 0.8]), (SHROUD["kn"], [0.0, 0.6])) if closed else ()
    assert stuck.peak.frequency == pytest.approx(poles(K, *springs)[0], rel=1e-3)
    assert np.all(stuck.shares == ([1.0, 0.0, 0.0] if closed else [0.0, 0.0, 1.0]))


def test_points_of_a_loaded_interface_keep_their_rule_and_shares_are_those_of_the_springs():
    """Half of the points are pressed: the others have a gap, no springs, and count as open."""
    study = plain_study(
        bd.reference_model("blade_to_ground"), bd.Excitation("tip"), friction_coefficient=0.4
    )
    study = study.replace(constant_loads={"platform": np.repeat([30.0, -30.0], 12)})
    closed = study.static(0.0).force[:, 2] > 0.0
    assert 0 < closed.sum() < 24
    assert study.stuck((250.0, 500.0)).shares[0] == pytest.approx(
        [closed.mean(), 0.0, 1.0 - closed.mean()]
    )


def test_faces_of_a_damper_keep_their_rule():
    """Without a preload nothing presses the damper: its faces are open, and nothing is said of them."""
    study = plain_study(
        bd.reference_model(contact_points=9), bd.Excitation("tip"), 5, friction_coefficient=0.3
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", BdamperWarning)
        curve = study.stuck((250.0, 400.0), preload=0.0)
    assert np.all(curve.shares == [0.0, 0.0, 1.0])
    assert curve.peak.amplitude == pytest.approx(
        study.free((250.0, 400.0)).peak.amplitude, rel=1e-9
    )


@pytest.mark.slow
def test_stuck_at_a_rotor_speed_has_the_preload_of_the_damper():
    study = bd.Study(
        bd.reference_model("turbine_blade"),
        bd.Excitation("tip"),
        5,
        friction_coefficient=0.3,
        harmonics=1,
    )
    at = study.at_speed(850.0)
    stuck = at.stuck((600.0, 700.0))
    assert stuck.preload == at.preload > 1000.0 and study.stuck((600.0, 700.0)).preload == 1.0
    np.testing.assert_array_equal(stuck.amplitude, at.stuck((600.0, 700.0), at.preload).amplitude)


@pytest.mark.slow
def test_a_limit_prints_no_preload():
    """The preload of the stuck limit closes the points; its size, by default 1 N, is not one of the response."""
    study = plain_study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, harmonics=1)
    band = resonance_interval(study.problem.at(200.0), 1)
    for name, limit in (
        ("with stuck contacts", study.stuck(band)),
        ("without contact", study.free(band)),
    ):
        for text in (
            str(limit),
            str(limit.peak),
            limit.summary(),
            limit._repr_html_(),
            limit.peak._headline(),
        ):
            assert "preload" not in text and f"Resonance peak {name} " in text
    peak = study.peak(200.0, band)
    assert ": preload 200 N," in said(peak) and "\n  preload" in peak.summary()


def test_limits_have_the_interval_of_a_peak_by_default():
    """It contains the free and the stuck resonance, so that both curves lie in one picture."""
    study, K = blade()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BdamperWarning)
        free, stuck = study.free(), study.stuck()
        low, high = study.peak(0.0).settings["frequency"]
        second = study.free(mode=2)
    held = poles(K, (SHROUD["kt"], [0.0, 0.8]), (SHROUD["kn"], [0.0, 0.6]))
    for curve in (free, stuck):
        assert curve.frequency[[0, -1]] == pytest.approx([low, high], rel=1e-12)
    assert low < poles(K)[0] < held[0] < high
    assert free.peak.frequency == pytest.approx(poles(K)[0], rel=1e-3)
    assert stuck.peak.frequency == pytest.approx(held[0], rel=1e-3)
    assert second.frequency[0] < poles(K)[1] < second.frequency[-1]


def test_a_free_blade_has_the_interval_of_its_loaded_damper():
    """Without a preload nothing touches, so that the stuck resonance would not be in the interval."""
    study = bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, harmonics=1)
    free, stuck = study.free(), study.stuck()
    np.testing.assert_array_equal(free.frequency[[0, -1]], stuck.frequency[[0, -1]])
    assert free.frequency[0] < free.peak.frequency < stuck.peak.frequency < free.frequency[-1]
