"""Amplitudes in time beside an optimal curve, of a wedge between an oscillator and the ground."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bdamper as bd
from bdamper.response.verification import energy_shares
from bdamper.time_domain import time_response as in_time
from bdamper.util.formatting import peak_text


def wedge(harmonics=1, mass=0.1):
    """Of 100 Hz without the damper, which is pressed against faces of 45 degrees."""
    c, k = np.sqrt(0.5), (200.0 * np.pi) ** 2
    stiffness = {"kt": 0.8e7, "kn": 1e7, "mu": 0.3}
    faces = [
        bd.Contact({1: -c, 0: c, 2: c}, {1: c, 0: -c, 2: c}, **stiffness),
        bd.Contact({1: c, 2: c}, {1: -c, 2: c}, **stiffness),
    ]
    return bd.lumped([1.0, mass, mass], [2e-3 * np.sqrt(k), 0.0, 0.0], [k, 0.0, 0.0], contacts=faces, forces={0: 1.0},
                     load_per_preload={2: 1.0}, harmonics=harmonics)  # fmt: skip


def test_energies_of_a_period_are_shares_of_what_is_supplied():
    """Work less all losses is the error of the steps; losses below zero supply energy."""
    supplied, shares = energy_shares((10.0, 6.0, 3.0, 0.5))
    assert supplied == 10.0
    np.testing.assert_allclose(shares, [0.6, 0.3, 0.05, 0.05], rtol=1e-12)
    # contacts alone supply energy, the excitation takes some
    supplied, shares = energy_shares((-2.0, 3.0, -8.0, 1.0))
    assert supplied == 8.0
    np.testing.assert_allclose(shares, np.array([3.0, -8.0, 1.0, 2.0]) / 8.0, rtol=1e-12)


@pytest.fixture(scope="module")
def found():
    study = wedge()
    return study, study.optimal_curve((40.0, 60.0, 90.0), frequency=(300.0, 380.0), check=False)


@pytest.mark.slow
def test_what_is_kept_is_that_of_the_curve_at_the_preload(found, tmp_path):
    study, curve = found
    out = study.with_time_response(study.with_time_response(curve, [90.0]), [60.0])
    assert [k.preload for k in out.time_response] == [60.0, 90.0]
    own = study.time_response(study.frequency_response(60.0, (300.0, 380.0)))
    there = out.time_response[0]
    plain = {"cost": own.cost, "jump_frequency": 0.0}  # NaN, as the motion does not fall
    assert (
        replace(there, **plain) == replace(own, **plain)
        and there.model_hash == curve.model_hash
        and there.settings
    )
    assert there.status == "complete" and there._headline() in out.summary()
    tracked = [
        study.frequency_response(k.preload, curve.settings["frequency"]).cost
        for k in out.time_response
    ]
    for count in ("evaluations", "factorisations", "iterations"):
        parts = [curve.cost, *tracked, *(k.cost for k in out.time_response)]
        assert (
            getattr(out.cost, count)
            == sum(getattr(part, count) for part in parts)
            > getattr(curve.cost, count)
        )
    out.save(tmp_path / "curve.h5")
    own.save(tmp_path / "kept.h5")
    for read in (bd.load(tmp_path / "curve.h5").time_response[0], bd.load(tmp_path / "kept.h5")):
        assert replace(read, **plain) == replace(own, **plain) and read.made_with == own.made_with


def test_an_interruption_keeps_the_curve_and_says_so(found, monkeypatch):
    study, curve = found

    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(in_time, "time_response", stopped)
    out = study.with_time_response(curve, [60.0, 90.0])
    assert [(k.preload, k.status) for k in out.time_response] == [
        (60.0, "interrupted"),
        (90.0, "interrupted"),
    ]
    assert np.isnan(out.time_response[0].mean)
    assert "interrupted before a motion was known" in " ".join(str(out).split())
    monkeypatch.undo()
    known = study.with_time_response(curve, [60.0])
    monkeypatch.setattr(in_time, "time_response", stopped)
    assert study.with_time_response(known, [60.0]).time_response == known.time_response
    with pytest.raises(bd.SettingError, match=r"preload: expected .*, found 60\.0"):
        study.with_time_response(curve, 60.0)


@pytest.mark.slow
def test_the_number_of_threads_changes_no_digit(found):
    study, curve = found
    results = []
    for number in (1, 3):
        with bd.set_workers(number):
            results.append(study.with_time_response(curve, [60.0, 90.0]))
    alone, together = results
    for response, other in zip(alone.time_response, together.time_response):
        # not a number where the motion does not fall
        own = {"cost": None, "jump_frequency": 0.0}
        assert replace(response, **own) == replace(other, **own)
        assert list(response.answers) == list(other.answers)
        assert response.cost.evaluations == other.cost.evaluations
    assert alone.cost.evaluations == together.cost.evaluations


def test_a_peak_of_another_study_is_refused(found):
    study, _ = found
    peak = study.peak(60.0, frequency=(300.0, 380.0))
    with pytest.raises(
        bd.SettingError, match="result: expected a peak at a preload, found 'not found"
    ):
        study.time_response(replace(peak, status="not found", reason="nothing"))
    for other in (wedge(harmonics=3), wedge(mass=0.2)):
        with pytest.raises(
            bd.SettingError, match="result: expected the highest peak of this study at its preload"
        ):
            other.time_response(peak)


def test_preloads_that_rattle_are_told_once(found):
    """As one range, not again among the preloads with a warning."""
    told = "not found: no steady periodic response up to 60 N: the damper rattles"
    gone = replace(found[1], lowest_steady_preload=60.0, status=(told, told, "complete"))
    assert told in gone.summary() and gone.warnings.count(told) == 1


def test_another_model_is_refused(found):
    with pytest.raises(bd.SettingError, match="curve: expected an optimal curve of this study"):
        wedge(mass=0.2).with_time_response(found[1], [50.0])


def test_the_band_without_a_steady_response_is_drawn(found):
    _, curve = found
    gone = np.where(curve.preload <= 60.0, np.nan, curve.amplitude)
    left, _ = replace(curve, amplitude=gone, lowest_steady_preload=60.0).plot().axes
    labels = left.get_legend_handles_labels()[1]
    assert "no steady periodic response up to 60 N" in labels
    assert not any(label.startswith("no value") for label in labels)
    plt.close(left.figure)


@pytest.mark.nightly
@pytest.mark.slow
def test_no_steady_amplitude_where_the_shipped_disk_shows_the_sign():
    """At 42 N the reason says so and the amplitude in time never rests; at 59 N it says nothing and the motion settles."""
    study = bd.Study(
        bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, friction_coefficient=0.4, harmonics=3,
        contact_stiffness="unit_traction", blade_modes=10,
    )  # fmt: skip
    low, high = (study.frequency_response(preload, (270.0, 370.0)) for preload in (42.0, 59.0))
    assert "no steady periodic response is expected" in low.reason
    assert "no steady" not in high.reason
    for curve, rests in ((low, False), (high, True)):
        last = study.motion_in_time(
            curve, frequency=curve.peak.frequency, periods=600, steps_per_period=512
        )
        last = last.amplitude[-150:]
        assert (np.ptp(last) < 0.02 * last.mean()) == rests


def test_steps_and_curve_are_those_of_the_search(found, monkeypatch):
    study, asked = found[0], []

    class Search(in_time.SteadySearch):
        def run(self):
            asked.append((self.balance.amplitude[self.balance.top], self.steps))
            raise in_time.IntegrationFailed("asked")

    monkeypatch.setattr(in_time, "SteadySearch", Search)
    curve, peak = (
        study.frequency_response(60.0, (300.0, 380.0)),
        study.peak(60.0, frequency=(300.0, 380.0)),
    )
    for result in (curve, curve.peak, peak):
        assert (
            study.time_response(result, steps_per_period=512, starts=2).status_text
            == "not found: asked"
        )
    # an integration that fails is tried again with four times the steps
    tried = [(pytest.approx(peak.amplitude, rel=1e-4), steps) for steps in (512, 2048)]
    assert asked == 3 * tried
    refused = "result: expected the highest peak of this study at its preload"
    with pytest.raises(bd.SettingError, match=f"{refused}, found 'a peak of another model'"):
        study.time_response(replace(peak, model_hash="another"))
    on_curve = peak_text(curve.peak.amplitude, curve.peak.frequency, 6)
    for off in (0.99, 1.01):
        named = f"{refused}, {on_curve} on its response curve, found .*; pass the response curve"
        with pytest.raises(bd.SettingError, match=named):
            study.time_response(replace(peak, amplitude=off * peak.amplitude))


@pytest.mark.slow
def test_what_cannot_be_integrated_says_why_beside_what_can(found, monkeypatch):
    """By rising preload; without preloads at the optimum."""
    study, curve = found
    own = in_time.time_response
    at_optimum = study.frequency_response(curve.optimum.preload, curve.settings["frequency"])
    expected = study.time_response(at_optimum).mean

    def failing(problem, tracked, seconds=None, progress=None):
        if tracked.preload == 70.0:
            raise bd.SettingError("no structure in time")
        return own(problem, tracked, progress=progress)

    monkeypatch.setattr(in_time, "time_response", failing)
    out = study.with_time_response(curve, [80.0, 70.0])
    known = [(k.preload, k.status_text) for k in out.time_response]
    assert known == [(70.0, "not found: no structure in time"), (80.0, "complete")]
    assert np.isnan(out.time_response[0].mean) and out.time_response[1].mean > 0.0
    best = study.with_time_response(curve).time_response[0]
    assert best.preload == curve.optimum.preload and best.balance == pytest.approx(
        curve.optimum.amplitude, rel=1e-9
    )
    assert best.mean == pytest.approx(expected, rel=1e-9)
