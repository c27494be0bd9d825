"""A problem makes its parts once, and a study asks one for responses."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.parameters import aligned, vary
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.settings import Settings
from bdamper.response.response_curve import frequency_response
from tests.plain import PLAIN, plain_study

SETTINGS = {"engine_order": 5, "friction_coefficient": 0.4, **PLAIN}
PRELOAD, INTERVAL = 2000.0, (345.0, 360.0)


@pytest.fixture(scope="module")
def model():
    return bd.reference_model("bladed_disk", 9)


@pytest.fixture(scope="module")
def problem(model):
    return Problem(Settings(model, bd.Excitation("tip"), **SETTINGS))


def test_a_study_has_a_problem_and_settings(model, problem):
    study = plain_study(model, bd.Excitation("tip"), **SETTINGS)
    assert study.settings is study.problem.settings
    ours, theirs = (
        study.frequency_response(PRELOAD, INTERVAL),
        frequency_response(problem, PRELOAD, INTERVAL),
    )
    assert np.array_equal(ours.unknowns, theirs.unknowns)


def test_other_harmonics(problem):
    three = problem.replace(harmonics=3)
    assert three.harmonic_numbers == (1, 2, 3) and problem.harmonic_numbers == (1,)
    assert three.n_unknowns > problem.n_unknowns and len(three.response_rows) == 4


@pytest.mark.parametrize(
    "setting",
    [
        {"friction_coefficient": 0.2},
        {"blade_modes": 4},
        {"bias": False},
        {"contact_stiffness_factor": 0.5},
    ],
)
def test_other_settings_are_those_of_a_new_problem(model, problem, setting):
    ours = problem.replace(**setting)
    theirs = Problem(Settings(model, bd.Excitation("tip"), **{**SETTINGS, **setting}))
    assert ours.record() == theirs.record() != problem.record()
    u = np.random.default_rng(2).normal(size=theirs.n_unknowns) * 1e-6
    assert np.array_equal(*(p.system(PRELOAD).evaluate(u, 2e3)[0] for p in (ours, theirs)))


def test_settings_that_are_varied_keep_the_type(model, problem):
    study = plain_study(model, bd.Excitation("tip"), **SETTINGS)
    assert type(vary(study, {"excitation.amplitude": 2.0})) is bd.Study
    assert type(vary(problem, {"friction_coefficient": 0.1})) is Problem


@pytest.mark.parametrize("motions", [("TX",), ("RX", "RY", "RZ"), ("TZ", "TX")])
def test_motions_across_the_load_carry_none(problem, motions):
    """Of a load along Y there is rounding along X, some 1e-16 of it, which is no preload."""
    across = problem.replace(rigid_modes=motions)
    with pytest.raises(
        bd.SettingError,
        match=r"preload: expected 0, since .* \['damper'\] along the load .*, found 100 N",
    ):
        across.check_preload(100.0)
    assert (
        across.check_preload(0.0) == 0.0 and problem.replace(rigid_modes=("TX", "TY")).carries_load
    )


def test_residual_modes_that_change_come_with_a_remedy(problem):
    """A run-up of a deck with residual modes failed without one; it is computed with unit tractions."""
    basis = problem.bases[1]
    with pytest.raises(
        bd.SettingError, match=r'give a shorter one, or contact_stiffness="unit_traction"$'
    ):
        aligned(replace(basis, coordinates=basis.coordinates[:-1]), basis)


def test_the_same_problem_with_given_parts_has_sizes_and_warnings_of_its_own(problem):
    assert problem.sizes is problem.sizes
    other = problem.given(static_states=problem.static_states)
    assert other.sizes.problem is other and other.sizes.told is not problem.sizes.told
