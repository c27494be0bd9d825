"""Which effects a scene calls for: findings of Cigeroglu, An and Menq (2009), section 4, on the shipped models."""

import pytest

import bdamper as bd
from bdamper.analyses.error_estimates import estimate_change
from bdamper.harmonic_balance.effects import Effects
from bdamper.response.richer_peak import embed
from tests.plain import plain_study

INTERVAL = (250.0, 400.0)


@pytest.fixture(scope="module")
def disk():
    model = bd.reference_model("bladed_disk", 9)
    study = plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)
    return study.replace(harmonics=5)


def compared(study, advice):
    """Curves with all effects of the reference and with those called for, computed anew."""
    both = {
        "all": study.replace(**advice.reference),
        "called for": study.replace(**advice.significant),
    }
    return bd.compare(both, lambda s: s.frequency_response(advice.preload, advice.interval))


@pytest.mark.slow
def test_at_high_preload_one_harmonic_is_enough(disk):
    advice = disk.effect_significance(50e3, INTERVAL, against=Effects.of(disk))
    assert {"harmonics beyond 1", "bias", "constraint planes"} <= set(advice.negligible)
    assert advice["rotation Z"].significant
    both = compared(disk, advice)
    assert abs(both.change("called for")) <= advice.tolerance
    assert disk.replace(**advice.significant).settings.harmonics == 1
    whole, lean = both.curves
    assert abs(lean.peak.frequency / whole.peak.frequency - 1.0) <= advice.tolerance
    assert advice.work < 0.2 and lean.cost.evaluations < 1.5 * whole.cost.evaluations


@pytest.mark.slow
def test_at_low_preload_a_study_without_rotation_and_further_harmonics_is_told_so(disk):
    """The paper's Fig. 14: without rotation the amplitude is underestimated and the frequency shift overestimated."""
    cheap = disk.replace(harmonics=1, rigid_modes=("TX", "TY", "TZ"))
    advice = cheap.effect_significance(500.0, INTERVAL, against=Effects.of(disk), tolerance=0.05)
    assert {"rotation Z", "harmonics beyond 1"} <= {
        e.name for e in advice.effects if e.verdict == "switch on"
    }
    turn = advice["rotation Z"]
    assert turn.amplitude_change < -0.2 and turn.frequency_change > 0.05
    assert abs(turn.amplitude_change) > abs(advice["harmonics beyond 1"].amplitude_change) > 0.1
    assert advice["separation"].significant and advice["separation"].amplitude_change > 0.2
    assert abs(compared(disk, advice).change("called for")) <= advice.tolerance


@pytest.mark.slow
def test_an_estimate_that_is_far_off_says_so():
    """Separation in the test rig at 500 N: off by more than a percent, and no smaller a miss is claimed."""
    rig = plain_study(
        bd.reference_model("test_rig"),
        bd.Excitation("tip"),
        0,
        friction_coefficient=0.4,
        harmonics=3,
    )
    peak = rig.peak(500.0)
    leaner = rig.replace(**Effects.of(rig).without("separation"))
    e = estimate_change(
        leaner.problem.system(500.0), embed(rig.problem, leaner.problem, 500.0, peak.y)
    )
    true = leaner.peak(500.0).amplitude / peak.amplitude - 1.0
    assert abs(e.amplitude - true) > 0.01 and e.uncertainty > 0.01


def test_effects_may_be_some_of_all():
    effects = Effects({"variable_normal_load": False})
    assert dict(effects) == {
        "variable_normal_load": False,
        "separation": False,
    } and "separation" in str(effects)
    with pytest.raises(
        bd.SettingError, match=r"effects: expected names out of .* found \['prestress'\]"
    ):
        Effects({"prestress": True})
