"""Which effects a scene calls for: every change against the peak of a study that lacks the effect."""

import re
from dataclasses import fields, replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses import effect_significance as module
from bdamper.analyses import error_estimates
from bdamper.analyses.effect_significance import EffectRow, fullest, parts
from bdamper.harmonic_balance.effects import ASSUMED, Effects
from bdamper.harmonic_balance.settings import Settings
from bdamper.response.highest_peak import found_at
from bdamper.response.richer_peak import Change, RicherPeaks
from tests import models
from tests.plain import plain_study

INTERVAL = (720.0, 880.0)
PRELOAD = 40.0
TOLERANCE = 0.03


@pytest.fixture(scope="module")
def full():
    model = models.wedge_model(1, n_points=6, harmonics=5)
    return plain_study(
        model,
        bd.Excitation("tip"),
        engine_order=2,
        friction_coefficient=0.4,
        harmonics=3,
        damper_modes=1,
        blade_modes=4,
    )


@pytest.fixture(scope="module")
def advice(full):
    return full.effect_significance(
        PRELOAD, INTERVAL, against=Effects.of(full), tolerance=TOLERANCE
    )


def changes(study, effects, advice):
    """Relative change of the peak from that of an advice to that of a study with other effects."""
    a, other = advice, study.replace(**effects)
    b = other.peak(PRELOAD, INTERVAL)
    # an end of the interval may be higher than the maximum, which is compared
    if not b.ok:
        b = found_at(other.problem, PRELOAD, INTERVAL).top.peak
    return b.amplitude / a.amplitude - 1.0, b.frequency / a.frequency - 1.0


@pytest.mark.slow
def test_every_effect_that_is_on_has_a_row(full, advice):
    assert {e.name for e in advice.effects} == set(parts(full.problem, Effects.of(full)))
    assert all(e.on for e in advice.effects)
    assert {
        "bias",
        "separation",
        "harmonics beyond 1",
        "rotation X",
        "translation Z",
        "constraint planes",
    } <= {e.name for e in advice.effects}
    assert "translation Y" not in {e.name for e in advice.effects}  # the preload acts along it
    sizes = [e.size for e in advice.effects]
    assert sizes == sorted(sizes, reverse=True)


@pytest.mark.slow
def test_changes_are_those_of_the_study_without_the_effect(full, advice):
    known = [e for e in advice.effects if e.source != "unknown"]
    assert {e.source for e in known} == {"estimated", "computed"} and len(known) >= 10
    for e in known:
        true = changes(full, Effects.of(full).without(e.name), advice)
        within = 1e-9 if e.source == "computed" else 0.1 * TOLERANCE
        assert e.source == "computed" or e.size <= TOLERANCE
        assert e.amplitude_change == pytest.approx(true[0], abs=within), e
        assert e.frequency_change == pytest.approx(true[1], abs=within), e


@pytest.mark.slow
def test_work_is_that_of_the_equations_without_the_effect(full, advice):
    whole = full.problem.system(PRELOAD).work[:3].sum()
    for e in advice.effects:
        system = full.replace(**Effects.of(full).without(e.name)).problem.system(PRELOAD)
        assert e.work == pytest.approx(system.work[:3].sum() / whole)
    assert advice["harmonics beyond 1"].work < 0.4 < advice["rotation X"].work < 1.0


@pytest.mark.slow
def test_what_is_left_out_changes_no_more_than_the_tolerance(full, advice):
    assert advice.negligible
    lean = full.replace(**advice.significant)
    assert isinstance(lean, bd.Study) and Effects.of(lean) == advice.significant
    assert lean.problem.system(PRELOAD).n_unknowns < full.problem.system(PRELOAD).n_unknowns
    true = changes(full, advice.significant, advice)
    assert (advice.amplitude_change, advice.frequency_change) == pytest.approx(true, abs=1e-9)
    assert max(map(abs, true)) <= TOLERANCE
    for e in advice.effects:
        assert e.significant == (advice.significant.without(e.name) != advice.significant), e
        assert e.significant or e.size <= TOLERANCE


@pytest.mark.slow
def test_effects_that_the_study_lacks_are_judged_against_what_the_model_can_do(full, advice):
    cheap = full.replace(harmonics=1, rigid_modes=("TX", "TY", "TZ", "RX"), separation=False)
    other = cheap.effect_significance(
        PRELOAD, INTERVAL, against=Effects.of(full), tolerance=TOLERANCE
    )
    off = {e.name for e in other.effects if not e.on}
    assert off == {"harmonics beyond 1", "rotation Y", "rotation Z", "separation"}
    assert {e.name: e.size for e in other.effects} == pytest.approx(
        {e.name: e.size for e in advice.effects}
    )
    assert {e.verdict for e in other.effects if not e.on} <= {"switch on", "stays off"}
    assert any(e.verdict == "switch on" for e in other.effects)
    true = changes(full, other.significant, other)
    assert max(map(abs, true)) <= TOLERANCE
    assert re.search(r" off +switch on\n", other.summary())


DEFAULT = Effects({f.name: f.default for f in fields(Settings) if f.name in ASSUMED})


def rows(*given):
    return [
        EffectRow(name, on, change, 0.0, 0.0, "computed", work) for name, on, change, work in given
    ]


class Reference:
    """Stands for the reference: the joint change of each set of effects is given."""

    def __init__(self, effects, joint):
        self.effects, self.joint, self.problem, self.asked = effects, joint, self, []

    def replace(self, **effects):
        return effects

    def computed(self, effects):
        self.asked.append(effects)
        return Change(amplitude=self.joint(effects), frequency=0.0, uncertainty=0.0)


def test_effects_that_save_most_are_left_out_within_the_sum():
    given = rows(
        ("rotation X", True, 0.006, 0.9),
        ("bias", True, -0.006, 0.8),
        ("constraint planes", True, 0.004, 0.85),
    )
    found, change = module._chosen(Reference(DEFAULT, lambda e: 0.0), given, 0.01)
    assert {e.name for e in found if not e.significant} == {
        "bias",
        "constraint planes",
    } and change == (0.0, 0.0)
    assert (
        next(e for e in found if e.name == "rotation X").reason
        == "the sum of all changes would exceed the tolerance"
    )


def test_what_saves_nothing_stays_on_and_what_is_off_may_stay_off():
    given = rows(("separation", True, 0.001, 1.2), ("bias", False, 0.001, 1.0))
    found, _ = module._chosen(Reference(DEFAULT, lambda e: 0.0), given, 0.01)
    assert [e.verdict for e in found] == ["keep", "stays off"] and found[
        0
    ].reason == "omitting it saves no time"


def test_effects_that_change_more_together_are_taken_back():
    """Small one by one, but not with the one that changes most, then not found at all with another."""
    effects = DEFAULT

    def joint(e):
        if not e["bias"]:
            return 0.02
        if not e["constraint_planes"]:
            raise bd.BdamperError("no peak")
        return 0.004

    given = rows(
        ("bias", True, 0.003, 0.8),
        ("constraint planes", True, 0.002, 0.9),
        ("rotation X", True, 0.001, 0.9),
    )
    reference = Reference(effects, joint)
    found, change = module._chosen(reference, given, 0.01)
    assert [e.significant for e in found] == [True, True, False] and change == (0.004, 0.0)
    assert found[0].reason == found[1].reason == "the change is larger together with other effects"
    assert reference.asked == [
        effects.without("bias").without("constraint planes").without("rotation X"),
        effects.without("constraint planes").without("rotation X"),
        effects.without("rotation X"),
    ]


@pytest.mark.slow
def test_an_effect_without_which_no_peak_or_no_whole_curve_is_found_is_called_for(
    full, monkeypatch
):
    def none(problem, *scene, **named):
        if not problem.settings.separation:
            raise bd.BdamperError("no peak there")
        curve = frequency_response(problem, *scene, **named)
        return (
            curve
            if problem.settings.constraint_planes
            else replace(curve, status="incomplete", reason="lost")
        )

    frequency_response = error_estimates.frequency_response
    monkeypatch.setattr(error_estimates, "frequency_response", none)
    lost = RicherPeaks(Change(how="lost"))
    monkeypatch.setattr(error_estimates, "richer_peaks", lambda *_: lost)
    monkeypatch.setattr(module, "estimate_change", lambda system, y: Change(np.nan, np.nan, np.inf))
    reference = module._Reference(full.problem, Effects.of(full), PRELOAD, INTERVAL)
    row = reference.row("separation", Effects.of(full), TOLERANCE)
    assert (row.source, row.verdict, row.size) == ("unknown", "keep", np.inf)
    assert row.reason == "no complete response curve: no peak there"
    partial = reference.row("constraint planes", Effects.of(full), TOLERANCE)
    assert (
        partial.source == "unknown"
        and partial.reason == "no complete response curve: incomplete: lost"
    )
    assert reference.row("rotation X", Effects.of(full), TOLERANCE).source == "computed"


def test_a_peak_that_changes_little_needs_no_whole_curve(full, monkeypatch):
    def none(*_, **__):
        raise bd.BdamperError("no curve asked for")

    reference = module._Reference(full.problem, Effects.of(full), PRELOAD, INTERVAL)
    monkeypatch.setattr(error_estimates, "frequency_response", none)
    monkeypatch.setattr(module, "estimate_change", lambda system, y: Change(np.nan, np.nan, np.inf))
    small = reference.row("harmonics beyond 1", Effects.of(full), TOLERANCE)
    assert small.source == "computed" and small.frequency_change == pytest.approx(0.00393, rel=1e-3)
    lost = RicherPeaks(Change(how="lost"))
    monkeypatch.setattr(error_estimates, "richer_peaks", lambda *_: lost)
    assert reference.row("harmonics beyond 1", Effects.of(full), TOLERANCE).source == "unknown"


def test_effects_that_cancel_by_chance_are_not_left_out_together():
    """Without variable normal load there is no separation either, which alone changes much."""
    given = rows(("separation", True, 0.2, 1.0), ("variable normal load", True, 0.001, 0.9))
    found, _ = module._chosen(Reference(DEFAULT, lambda e: 0.001), given, 0.01)
    assert [e.significant for e in found] == [True, True]
    assert found[1].reason == "contains separation"


@pytest.mark.slow
def test_a_corner_is_compared_by_whole_curves_alone(full, monkeypatch):
    """Where the damper drifts the amplitude is not stationary along the curve, as the estimate needs it."""
    reference = module._Reference(full.problem, Effects.of(full), PRELOAD, INTERVAL)
    kinds = list(reference.curve.point_kind)
    assert reference.row("rotation X", Effects.of(full), 0.5).source == "estimated"
    kinds[reference.curve.peak_index] = "drift"
    reference.curve = replace(reference.curve, point_kind=tuple(kinds))
    assert reference.row("rotation X", Effects.of(full), 0.5).source == "computed"


def test_the_reference_is_what_the_model_has(full):
    rich = fullest(full.problem)
    expected = {
        "harmonics": 3,
        "damper_modes": 2,
        "blade_modes": 4,
        "friction_law": "uncoupled",
        "bias": True,
    }
    assert rich == rich | expected and not rich["fundamental_modes_only"]
    bare = full.replace(rigid_modes=("TX", "TY", "TZ"), bias=False, harmonics=(1, 7))
    assert fullest(bare.problem) == fullest(bare.problem) | {
        "harmonics": (1, 2, 3, 7),
        "rigid_modes": bd.RIGID_NAMES,
    }


def test_a_harmonic_with_a_force_of_its_own_stays(full):
    several = full.replace(
        excitation=bd.Excitation("tip") + bd.Excitation("tip", amplitude=0.2, engine_order=4)
    )
    names = parts(several.problem, Effects.of(several))
    assert "harmonics beyond 1" not in names and "harmonics beyond 1" in parts(
        full.problem, Effects.of(full)
    )
    for name in names:
        assert several.replace(**Effects.of(several).without(name)).settings.excited.keys() == {
            1,
            2,
        }


def test_no_peak_no_advice(full):
    with pytest.raises(bd.BdamperError, match="no peak"):
        full.effect_significance(PRELOAD, (5.0, 6.0), against=Effects.of(full))


def test_only_the_axial_planes_hold_the_damper_along_the_axis(full):
    """Friction aside: the faces of the wedge hold it in all other directions."""
    effects = Effects.of(full)
    held = module.free_motions(full.problem, PRELOAD)
    freed = {
        name
        for name in parts(full.problem, effects)
        if module.free_motions(full.replace(**effects.without(name)).problem, PRELOAD) > held
    }
    assert held == 0
    assert freed == {"constraint planes"}
    # without this motion the planes hold nothing
    fixed = full.replace(**effects.without("translation Z"))
    assert module.free_motions(fixed.replace(constraint_planes=False).problem, PRELOAD) == 0


@pytest.mark.slow
def test_an_effect_that_holds_the_damper_is_judged_by_the_complete_curve_without_it():
    """Without its planes the damper of the blade drifts away near the peak, although the peak itself hardly changes."""
    study = bd.Study(
        bd.reference_model("turbine_blade"), bd.Excitation("tip"), engine_order=5, friction_coefficient=0.3
    )  # fmt: skip
    preload, interval = 104.0, (600.0, 740.0)
    effects = module.fullest(study.problem)
    study = study.replace(**effects)
    row = module._Reference(study.problem, effects, preload, interval).row(
        "constraint planes", effects, 0.01
    )
    without = study.replace(constraint_planes=False).frequency_response(preload, interval)
    assert not without.complete
    low, high = without.gap
    assert low < 661.0 < high
    assert (row.source, row.verdict) == ("unknown", "keep")
    assert row.reason.startswith("no complete response curve: incomplete: no solution found from")
