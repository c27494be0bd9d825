"""A shroud and two dampers: loads of the assembly, what dampers leave of them, optimum over the load of the shroud."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.response.response_curve_result import NO_STEADY
from tests.printed import said

EXCITATION = bd.Excitation("tip", amplitude=1.0)


@pytest.fixture(scope="module")
def model():
    return bd.reference_model("shrouded_blade")


@pytest.mark.slow
def test_a_drift_that_ends_in_a_turn_is_no_fold_within_a_step(model):
    """Both tangents of the step point backward: the search for a fold between them had no bracket."""
    study = bd.Study(
        model, bd.Excitation("tip"), engine_order=4, harmonics=1, load_per_preload={"shroud": 1.0}
    )
    # the verdict counts the folds of the curve that this search interrupted
    assert study.peak(1.0).reason.startswith(NO_STEADY)


def study_of(model, **settings):
    return bd.Study(model, EXCITATION, 4, harmonics=1, **settings)


def normal(study, preload, name):
    return study.static(preload).normal_force[name]


@pytest.mark.parametrize(
    "settings",
    [
        {}, {"contact_stiffness": "unit_traction"}, {"blade_modes": 6}, {"contact_stiffness_factor": 0.5},
        {"friction_coefficient": 0.1}, {"harmonics": 3, "contact_stiffness": "cigeroglu2009"},
    ],
)  # fmt: skip
def test_the_load_of_a_shroud_is_that_of_the_assembly(model, settings):
    study = bd.Study(
        model, EXCITATION, 4, **({"harmonics": 1} | settings), constant_loads={"shroud": 30.0}
    )
    assert normal(study, 0.0, "shroud") == pytest.approx(30.0, rel=1e-7)


def test_dampers_take_load_off_the_shroud_and_the_state_says_so(model):
    study = study_of(
        model, load_per_preload={"front": 1.0, "rear": 0.6}, constant_loads={"shroud": 500.0}
    )
    state = study.static(1000.0)
    total = state.normal_force
    assert state.ok and set(total) == set(study.problem.coupling.interfaces)
    # flat strips under the platforms: what they carry is their load, within the friction of faces that are almost level
    assert total["front_left"] + total["front_right"] == pytest.approx(1000.0, rel=0.03)
    assert total["rear_left"] + total["rear_right"] == pytest.approx(600.0, rel=0.03)
    assert 0.0 < total["shroud"] < 500.0 - 1.0
    assert f"{bd.util.formatting.amount(total['shroud'], 'N')} shroud" in said(state)


def test_a_state_is_the_same_whatever_was_asked_before(model):
    """One of 1 N too, from which those of other preloads follow where nothing is pressed at assembly."""
    fresh, asked = (
        study_of(model, load_per_preload={"front": 1.0}, constant_loads={"shroud": 5.0})
        for _ in range(2)
    )
    _ = asked.static(3.0)
    np.testing.assert_array_equal(asked.static(1.0).force, fresh.static(1.0).force)
    assert set(asked.static(1.0).normal_force) == set(model.interfaces)


def test_a_body_without_a_share_is_not_loaded(model):
    study = study_of(model, load_per_preload={"front": 1.0})
    total = study.static(100.0).normal_force
    assert (
        total["rear_left"] + total["rear_right"] < 1.0 < total["front_left"] + total["front_right"]
    )


@pytest.mark.slow
def test_optimum_over_the_load_of_the_shroud(model):
    study = study_of(
        model, load_per_preload={"shroud": 1.0}, constant_loads={"front": 50.0, "rear": 30.0}
    )
    peaks = [study.peak(load, (200.0, 3000.0)) for load in (1.0, 2.0, 8.0)]
    assert all(p.ok for p in peaks), [p.status for p in peaks]
    assert "preload 2 N (shroud 1)" in peaks[1]._headline()
    best = study.optimal_curve([1.0, 2.0, 4.0, 8.0], frequency=(200.0, 3000.0), check=False)
    assert np.isfinite(best.amplitude).all() and "loads per newton: shroud 1" in str(best)
