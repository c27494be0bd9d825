"""Harmonics chosen for a tolerance: which answers are compared, what is claimed, and what the result says."""

import re
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.accuracy import tolerance
from bdamper.accuracy.tolerance import Rung
from bdamper.util.errors import BdamperError, SettingError
from tests import models

PLACE = 5000.0, (320.0, 365.0)


@pytest.fixture(scope="module")
def study():
    return bd.Study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, harmonics=2)


def peaks(study, *numbers):
    return [study.with_(harmonics=n).track(*PLACE).peak for n in numbers]


def test_curves_are_compared_until_two_in_a_row_agree(study):
    """One and three harmonics differ by 5 % here, three and five by less than 1 %."""
    curve = study.track(*PLACE, tolerance=0.02)
    chosen = curve.settings["chosen"]
    one, three, five = peaks(study, 1, 3, 5)
    assert [r["harmonics"] for r in chosen["rungs"]] == [1, 3, 5]
    assert [r["amplitude"] for r in chosen["rungs"]] == pytest.approx([p.amplitude for p in (one, three, five)], rel=1e-9)
    assert abs(one.amplitude / three.amplitude - 1.0) > 0.02 > abs(three.amplitude / five.amplitude - 1.0)
    assert chosen["harmonics"] == curve.settings["harmonics"] == [1, 2, 3, 4, 5]
    assert curve.peak.amplitude == pytest.approx(five.amplitude, rel=1e-9)
    assert chosen["converged"]
    assert chosen["change"] == pytest.approx(abs(five.amplitude / three.amplitude - 1.0), rel=1e-6)
    assert re.search(r"converged to 2 %: 3 and 5 harmonics differ by 0\.\d+ %", str(curve))
    whole = sum(study.with_(harmonics=n).track(*PLACE).cost.work for n in (1, 3, 5))
    assert curve.cost.work == pytest.approx(whole, rel=1e-9)


def test_loose_tolerance_needs_fewer(study):
    curve = study.track(*PLACE, tolerance=0.2)
    assert curve.settings["harmonics"] == [1, 2, 3]
    assert curve.settings["chosen"]["converged"]


def test_not_converged_says_the_last_change(study, monkeypatch):
    monkeypatch.setattr(tolerance, "HARMONICS", (1, 3))
    curve = study.track(*PLACE, tolerance=0.001)
    chosen = curve.settings["chosen"]
    one, three = peaks(study, 1, 3)
    assert not chosen["converged"] and chosen["change"] == pytest.approx(1.0 - three.amplitude / one.amplitude, rel=1e-6)
    assert curve.complete and curve.settings["harmonics"] == [1, 2, 3]
    assert "not converged to 0.1 %: 1 and 3 harmonics differ by" in str(curve)


def test_missing_nodal_diameters_end_the_comparison():
    model = models.wedge_model(0, n_blades=24, engine_order=2, harmonics=3)
    study = bd.Study(model, bd.Excitation("tip"), 2)
    for most, numbers in ((3, [1, 3]), (1, [1])):
        own = study if most == 3 else bd.Study(
            models.wedge_model(0, n_blades=24, engine_order=2, harmonics=1), bd.Excitation("tip"), 2
        )  # fmt: skip
        chosen = own.track(5.0, (200.0, 450.0), tolerance=1e-9).settings["chosen"]
        assert [r["harmonics"] for r in chosen["rungs"]] == numbers
        assert not chosen["converged"]
        assert f"no more than {most} are possible" in chosen["note"] and "nodal diameter" in chosen["note"]
    assert "one harmonic cannot be compared with more" in chosen["note"] and np.isnan(chosen["change"])


def test_evaluation_of_the_study_stays_and_limits_the_harmonics(study):
    sampled = replace(study, evaluation=bd.Sampled(24), harmonics=1)
    curve = sampled.track(*PLACE, tolerance=1e-6)
    chosen = curve.settings["chosen"]
    assert curve.settings["evaluation"] == {"n_time": 24, "interpolate": True}
    assert [r["harmonics"] for r in chosen["rungs"]] == [1, 3, 5]
    assert "no more than 5 are possible (evaluation: " in chosen["note"]
    assert sampled.of(curve).harmonic_numbers == (1, 2, 3, 4, 5)


def answers(study, monkeypatch, statuses):
    """Curves as they are, but with the status given for each number of harmonics."""
    track = tolerance.track

    def with_status(problem, *arguments, **options):
        curve = track(problem, *arguments, **options)
        status = statuses.get(problem.harmonic_numbers[-1], "complete")
        return replace(curve, status=status, reason="as told")

    monkeypatch.setattr(tolerance, "track", with_status)
    return study.track(*PLACE, tolerance=0.02)


def test_incomplete_curves_agree_with_nothing(study, monkeypatch):
    monkeypatch.setattr(tolerance, "HARMONICS", (1, 3, 5))
    curve = answers(study, monkeypatch, {5: "incomplete"})
    assert curve.complete and curve.settings["harmonics"] == [1, 2, 3]
    chosen = curve.settings["chosen"]
    assert not chosen["converged"] and np.isnan(chosen["change"])
    assert chosen["note"] == "not converged to 2 %: no whole answer with 5 harmonics (incomplete: as told)"
    curve = answers(study, monkeypatch, {1: "incomplete", 3: "incomplete", 5: "incomplete"})
    assert curve.status == "incomplete" and curve.settings["harmonics"] == [1, 2, 3, 4, 5]


def test_interrupted_curve_is_returned_at_once(study, monkeypatch):
    curve = answers(study, monkeypatch, {3: "interrupted"})
    assert curve.status == "interrupted" and curve.settings["harmonics"] == [1, 2, 3]
    assert [r["harmonics"] for r in curve.settings["chosen"]["rungs"]] == [1, 3]
    assert study.of(curve).harmonic_numbers == (1, 2, 3)


def test_peak_to_a_tolerance(study):
    peak = study.peak(*PLACE, tolerance=0.02)
    assert study.of(peak).harmonic_numbers == (1, 2, 3, 4, 5)
    assert peak.amplitude == pytest.approx(study.track(*PLACE, tolerance=0.02).peak.amplitude, rel=1e-6)
    assert "converged to 2 %: 3 and 5 harmonics differ by" in str(peak)
    assert peak.cost.work > study.with_(harmonics=5).peak(*PLACE).cost.work
    errors = study.estimate_errors(peak, PLACE[0], sources=["solver"])
    assert errors["solver"].size < 1e-8
    with pytest.raises(BdamperError, match="no peak found"):
        study.peak(PLACE[0], (100.0, 150.0), tolerance=0.02)


def test_optimal_curve_to_a_tolerance(study):
    place = {"preload": (1000.0, 5000.0), "n": 3, "frequency": (280.0, 370.0)}
    curve = study.optimal_curve(**place, tolerance=0.5)
    chosen = curve.settings["chosen"]
    one, three = (study.with_(harmonics=n).optimal_curve(**place).optimum for n in (1, 3))
    assert [r["place"] for r in chosen["rungs"]] == pytest.approx([one.preload, three.preload], rel=1e-9)
    assert curve.optimum == three
    change = max(abs(three.amplitude / one.amplitude - 1.0), abs(three.preload / one.preload - 1.0))
    assert chosen["change"] == pytest.approx(change, rel=1e-6)
    assert "harmonics differ by" in str(curve)


def test_result_is_kept_in_a_file(study, tmp_path):
    curve = study.track(*PLACE, tolerance=0.2)
    curve.save(tmp_path / "curve.h5")
    assert bd.load(tmp_path / "curve.h5").settings["chosen"] == curve.settings["chosen"]


def test_stability_is_judged_once_chosen(study):
    curve = study.track(*PLACE, tolerance=0.2, stability=True)
    assert curve.stable is not None and len(curve.stable) == len(curve)


def test_what_is_refused(study):
    for wrong in (-1.0, 0.0, 1.0, "small"):
        for ask in (study.track, study.peak):
            with pytest.raises(SettingError, match="tolerance"):
                ask(*PLACE, tolerance=wrong)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (Rung(1, 1.0, 100.0), Rung(3, 1.1, 100.0), 1.0 / 11.0),
        (Rung(1, 1.0, 100.0), Rung(3, 1.0, 80.0), 0.25),
        (Rung(1, 1.0, np.nan), Rung(3, 1.25, np.nan), 0.2),
        (Rung(1, 1.0, np.nan), Rung(3, 1.0, 100.0), np.inf),
        (Rung(1, 1.0, 100.0, incomplete="so"), Rung(3, 1.0, 100.0), np.inf),
    ],
)
def test_difference_of_two_answers(a, b, expected):
    assert a.difference(b) == pytest.approx(expected)
