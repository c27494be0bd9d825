"""Prescribed normal loads and gaps."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from tests.plain import plain_study


@pytest.fixture(scope="module")
def study():
    return plain_study(
        bd.reference_model("blade_to_ground"), friction_coefficient=0.4, excitation=bd.Excitation("tip", amplitude=1.0)
    )


def test_loads_at_rest_are_the_prescribed_ones(study):
    target = np.linspace(-5.0, 60.0, 24)
    pressed = bd.prescribe_preload(study, {"platform": target})
    state = pressed.static(0.0)
    assert state.converged and np.abs(state.q).max() > 0.0
    assert state.force[:, 2] == pytest.approx(np.maximum(target, 0.0), abs=1e-7)
    kn = pressed.stiffness["platform"].stiffness[:, 2]
    # negative loads are gaps of that size
    assert state.closing[target < 0.0] == pytest.approx((target / kn)[target < 0.0], rel=1e-6)
    friction = np.abs(state.force[:, :2]).max(axis=1)
    assert np.all(friction <= 0.4 * state.force[:, 2] * (1 + 1e-9) + 1e-9)


def test_unsettled_loads_are_those_of_a_structure_held_in_place(study):
    pressed = bd.prescribe_preload(study, {"platform": 40.0}, settled=False)
    kn = pressed.stiffness["platform"].stiffness[:, 2]
    assert -pressed.model.interfaces["platform"].gap * kn == pytest.approx(40.0)
    # the blade gives way
    assert pressed.static(0.0).force[:, 2].sum() < 0.99 * 24 * 40.0


def test_response_scales_with_load_and_excitation(study):
    """Only the ratio of preload and excitation matters."""
    one = bd.prescribe_preload(study, {"platform": 20.0}).track(0.0, (300.0, 380.0))
    ten = replace(study, excitation=bd.Excitation("tip", amplitude=10.0))
    ten = bd.prescribe_preload(ten, {"platform": 200.0}).track(0.0, (300.0, 380.0))
    assert one.complete and ten.complete
    assert ten.peak.amplitude == pytest.approx(10.0 * one.peak.amplitude, rel=1e-6)
    assert ten.peak.frequency == pytest.approx(one.peak.frequency, rel=1e-7)


def test_high_load_is_the_stuck_limit(study):
    pressed = bd.prescribe_preload(study, {"platform": 2000.0})
    curve, stuck = pressed.track(0.0, (340.0, 390.0)), pressed.stuck((340.0, 390.0))
    assert curve.peak.amplitude == pytest.approx(stuck.peak.amplitude, rel=1e-6)
    assert stuck.peak.frequency > 1.2 * study.free((250.0, 350.0)).peak.frequency


@pytest.mark.parametrize(
    ("loads", "message"),
    [
        ({"left": 1.0}, "expected interfaces out of"),
        ({"platform": [1.0, 2.0]}, "expected a number or 24 numbers"),
        ({"platform": np.nan}, "expected finite newtons"),
    ],
)
def test_bad_input_is_named(study, loads, message):
    with pytest.raises(bd.SettingError, match=message):
        bd.prescribe_preload(study, loads)


def test_free_bodies_need_a_load():
    study = plain_study(bd.reference_model(contact_points=9), engine_order=5, excitation=bd.Excitation("tip"))
    with pytest.raises(bd.SettingError, match="expected no free body"):
        bd.prescribe_preload(study, {"left": 1.0})


def test_a_point_without_normal_stiffness_is_refused(study, monkeypatch):
    monkeypatch.setattr(type(study), "point_stiffness", np.zeros((24, 3)))
    with pytest.raises(bd.SettingError, match="expected a positive normal stiffness at every point"):
        bd.prescribe_preload(study, {"platform": 1.0})
