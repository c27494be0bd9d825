"""Beside an optimal curve: marches in time of a wedge between an oscillator and the ground, slow sweeps of a disk."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bdamper as bd
from bdamper.peaks import marched
from tests.plain import plain_study


def wedge(harmonics=1, mass=0.1):
    """Of 100 Hz without the damper, which is pressed against faces of 45 degrees."""
    c, k = np.sqrt(0.5), (200.0 * np.pi) ** 2
    stiffness = {"kt": 0.8e7, "kn": 1e7, "mu": 0.3}
    faces = [
        bd.Contact({1: -c, 0: c, 2: c}, {1: c, 0: -c, 2: c}, **stiffness),
        bd.Contact({1: c, 2: c}, {1: -c, 2: c}, **stiffness),
    ]
    return bd.lumped([1.0, mass, mass], [2e-3 * np.sqrt(k), 0.0, 0.0], [k, 0.0, 0.0], contacts=faces, forces={0: 1.0},
                     loads={2: 1.0}, harmonics=harmonics)  # fmt: skip


@pytest.fixture(scope="module")
def found():
    study = wedge()
    return study, study.optimal_curve((40.0, 60.0, 90.0), frequency=(300.0, 380.0), check=False)


def test_what_is_kept_is_that_of_the_curve_at_the_preload(found, tmp_path):
    study, curve = found
    out = study.with_kept(study.with_kept(curve, [90.0]), [60.0])
    assert [k.preload for k in out.kept] == [60.0, 90.0]
    own = study.kept(study.track(60.0, (300.0, 380.0)))
    there = out.kept[0]
    plain = {"cost": own.cost, "fall": 0.0}  # NaN, as nothing had to be marched
    assert replace(there, **plain) == replace(own, **plain) and there.model_hash == curve.model_hash and there.settings
    assert there.status == "complete" and there.bottom_line() in out.details()
    out.save(tmp_path / "curve.h5")
    own.save(tmp_path / "kept.h5")
    for read in (bd.load(tmp_path / "curve.h5").kept[0], bd.load(tmp_path / "kept.h5")):
        assert replace(read, **plain) == replace(own, **plain) and read.made_with == own.made_with


def test_an_interruption_of_the_march_keeps_the_curve_and_says_so(found, monkeypatch):
    study, curve = found

    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(marched.in_time, "kept", stopped)
    out = study.with_kept(curve, [60.0, 90.0])
    assert [(k.preload, k.status) for k in out.kept] == [(60.0, "interrupted"), (90.0, "interrupted")]
    assert np.isnan(out.kept[0].mean)
    said = "At 60 N it is not known what a blade keeps, so nothing confirms the peak of the harmonic balance: interrupted."
    assert said in out.bottom_line()
    monkeypatch.undo()
    known = study.with_kept(curve, [60.0])
    monkeypatch.setattr(marched.in_time, "kept", stopped)
    assert study.with_kept(known, [60.0]).kept == known.kept
    with pytest.raises(bd.SettingError, match=r"preload: expected .*, found 60\.0"):
        study.with_kept(curve, 60.0)


def test_a_peak_keeps_what_its_curve_keeps(found, monkeypatch):
    study, _ = found
    monkeypatch.setattr(marched.in_time, "kept", lambda problem, curve, **_: curve.peak)
    peak = study.peak(60.0, frequency=(300.0, 380.0))
    assert study.kept(peak).amplitude == pytest.approx(peak.amplitude, rel=1e-4)
    with pytest.raises(bd.SettingError, match="result: expected a peak at a preload, found 'not found"):
        study.kept(replace(peak, status="not found: nothing"))
    for other in (wedge(harmonics=3), wedge(mass=0.2)):
        with pytest.raises(bd.SettingError, match="result: expected the highest peak of this study at its preload"):
            other.kept(peak)
    finer = study.peak(60.0, frequency=(300.0, 380.0), tolerance=1e-3)
    assert len(finer.settings["harmonics"]) > 1 and finer.amplitude < 0.99 * peak.amplitude
    assert study.kept(finer).amplitude == pytest.approx(finer.amplitude, rel=1e-4)


def test_preloads_that_rattle_are_told_once(found):
    """As one range, not again among the preloads with a warning."""
    told = "not found: no steady periodic response below 60 N: the damper rattles"
    gone = replace(found[1], no_steady_below=60.0, status=(told, told, "complete"))
    assert gone.details().count(told) == 1 and "with a warning" not in gone.details()


@pytest.mark.parametrize("method", ["with_kept", "with_sweeps"])
def test_another_model_is_refused(found, method):
    with pytest.raises(bd.SettingError, match="curve: expected an optimal curve of this study"):
        getattr(wedge(mass=0.2), method)(found[1], [50.0])


def test_sweeps_up_and_down_meet_what_they_meet_on_the_tracking_curve(tmp_path):
    """Between the folds two solutions are stable: upward the lower one is kept, downward the one with the peak."""
    model, tip = bd.reference_model(contact_points=9), bd.Excitation("tip", direction="tangential", amplitude=1.0)
    study = plain_study(model, tip, engine_order=5, friction_coefficient=0.4)
    curve = study.optimal_curve((140.0, 220.0, 240.0), frequency=(300.0, 345.0), check=False)
    out = study.with_sweeps(study.with_sweeps(curve, [140.0]))
    assert [s.preload for s in out.swept] == sorted({140.0, 220.0, 240.0, curve.optimum.preload})
    for there in out.swept:
        tracked = study.track(there.preload, (300.0, 345.0))
        for way, found in (("up", there.up), ("down", there.down)):
            assert found == pytest.approx(tracked.sweep(way).amplitude.max(), rel=1e-9)
        assert there.up < 0.9 * there.down == pytest.approx(0.9 * tracked.peak.amplitude, rel=1e-6)
        assert f"slow sweeps at {there}" in out.details()
    least = next(s for s in out.swept if s.preload == curve.optimum.preload)
    assert least.down == pytest.approx(curve.optimum.amplitude, rel=1e-6)
    out.save(tmp_path / "curve.h5")
    assert bd.load(tmp_path / "curve.h5").swept == out.swept
    assert {"highest of a sweep up", "highest of a sweep down"} <= set(out.plot()[0].get_legend_handles_labels()[1])


def test_sweeps_go_by_judged_stability_where_the_study_has_it(monkeypatch):
    study = replace(wedge(), stability=True)
    curve = study.optimal_curve((60.0, 90.0), frequency=(300.0, 380.0), check=False)
    below = lambda problem, tracked: replace(tracked, stable=tracked.frequency < 330.0)  # noqa: E731
    monkeypatch.setattr(marched, "with_stability", below)
    assert study.with_sweeps(curve, [90.0]).swept[0].up_frequency < 330.0


def test_the_band_without_a_steady_response_is_drawn(found):
    _, curve = found
    gone = np.where(curve.preload <= 60.0, np.nan, curve.amplitude)
    left, _ = replace(curve, amplitude=gone, no_steady_below=60.0).plot()
    labels = left.get_legend_handles_labels()[1]
    assert "no steady periodic response below 60 N" in labels
    assert not any(label.startswith("no value") for label in labels)
    plt.close(left.figure)


@pytest.mark.slow
def test_no_steady_amplitude_where_the_shipped_disk_shows_the_sign():
    """At 42 N the reason says so and the marched amplitude never rests; at 59 N it says nothing and the march settles."""
    study = bd.Study(
        bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, friction_coefficient=0.4, harmonics=3,
        contact_stiffness="unit_traction", blade_modes=10,
    )  # fmt: skip
    low, high = (study.track(preload, (270.0, 370.0)) for preload in (42.0, 59.0))
    assert "no steady periodic response is expected" in low.reason
    assert "no steady" not in high.reason
    for curve, rests in ((low, False), (high, True)):
        last = study.settle(curve, curve.peak.frequency, periods=600).amplitude[-150:]
        assert (np.ptp(last) < 0.02 * last.mean()) == rests
