"""What a study has where the user chooses nothing: residual modes, three harmonics; what stands in where they cannot be."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.util.errors import BdamperWarning
from tests.models import wedge_model


@pytest.fixture(scope="module")
def disk():
    return bd.reference_model()


def study(model, **settings):
    return bd.Study(
        model, bd.Excitation("tip"), **({"engine_order": 5, "friction_coefficient": 0.4} | settings)
    )


def without_flexibility(model, *diameters):
    """The model with static flexibility of the blade at none of these nodal diameters."""
    blade = model.bodies["blade"]
    bases = {
        d: replace(b, flexibility=None) if d in diameters else b for d, b in blade.bases.items()
    }
    return replace(model, bodies=model.bodies | {"blade": replace(blade, bases=bases)})


def test_first_answer_has_residual_modes_and_three_harmonics(disk):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        default = study(disk)
        chosen = study(disk, contact_stiffness="residual_modes", harmonics=3, blade_modes=10)
        assert default.problem.record() == chosen.problem.record()
        curve = default.frequency_response(2000.0, (345.0, 375.0))
    # 40 blade modes: 0.335 mm with 24 points (docs/evidence/measured.md); unit tractions with one harmonic: 0.475 mm
    assert curve.peak.amplitude == pytest.approx(0.335e-3, rel=0.1)
    assert (
        default.problem.record()["contact_stiffness"] and "instead" not in default.stiffness_report
    )
    assert default.problem.n_unknowns == 22 * 7


def test_static_contact_area_comes_out_of_the_preload_analysis(disk):
    """Unit tractions press every point; the true flexibility leaves half of the points open at 500 N."""
    closed = {
        method: float(
            (study(disk, contact_stiffness=method).static(500.0).force[:18, 2] > 0.0).mean()
        )
        for method in ("unit_traction", None)
    }
    assert closed["unit_traction"] == 1.0
    assert 0.4 < closed[None] < 0.6


def test_settings_of_the_paper_by_name(disk):
    paper = study(disk, **bd.CIGEROGLU_2009)
    assert paper.problem.record() == study(disk).replace(**bd.CIGEROGLU_2009).problem.record()
    record = paper.problem.record()
    assert (record["contact_stiffness"], record["harmonics"], record["fundamental_modes_only"]) == (
        "cigeroglu2009",
        [1],
        True,
    )
    assert paper.frequency_response(2000.0, (345.0, 375.0)).complete


@pytest.mark.slow
def test_a_model_without_the_flexibility_says_what_stands_in(disk):
    model = without_flexibility(disk, 15)
    fallen = study(model)
    with pytest.warns(
        BdamperWarning, match=r'"unit_traction" instead of residual modes .*nodal diameter 15'
    ) as said:
        report = fallen.stiffness_report
    settings = fallen.problem.record()
    assert len(said) == 1
    assert (
        "instead of residual modes" in report and settings["contact_stiffness"] == "unit_traction"
    )
    plain = study(model, contact_stiffness="unit_traction")
    assert np.array_equal(fallen.problem.point_stiffness, plain.problem.point_stiffness)
    # two harmonics do not need that nodal diameter
    assert fallen.replace(harmonics=2).problem.stiffness_method == "residual_modes"
    with pytest.warns(BdamperWarning):
        assert (
            study(model, harmonics=2).replace(harmonics=3).problem.stiffness_method
            == "unit_traction"
        )
    with pytest.raises(bd.ModelError, match="nodal diameter 15"):
        _ = study(model, contact_stiffness="residual_modes").problem.bases


def test_stiffness_that_the_model_carries_stands_in():
    model = wedge_model(1)
    bare = without_flexibility(model, *model.bodies["blade"].bases)
    assert set(bare.contact) == set(bare.interfaces)
    with pytest.warns(BdamperWarning, match='"model" instead'):
        assert (
            study(bare, engine_order=2, harmonics=1).problem.record()["contact_stiffness"]
            == "model"
        )
    nothing = study(replace(bare, contact={}), engine_order=2, harmonics=1)
    with pytest.raises(bd.ModelError, match="set contact_stiffness to numbers"):
        _ = nothing.problem.contact
