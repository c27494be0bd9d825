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


def test_mean_and_range_are_those_of_a_march_from_the_highest_solution(found, tmp_path):
    study, curve = found
    out = study.with_marched(study.with_marched(curve, [90.0], periods=20), [50.0], periods=20)
    assert [m.preload for m in out.marched] == [50.0, 90.0]
    tracked = study.track(50.0, (300.0, 380.0))
    settled = study.settle(tracked, tracked.peak.frequency, periods=20)
    there = out.marched[0]
    assert there.frequency == pytest.approx(tracked.peak.frequency)
    assert there[2:] == (pytest.approx(settled.mean), *map(pytest.approx, settled.range), settled.status)
    assert there.low < there.mean < there.high
    assert there.spread == pytest.approx((there.high - there.low) / there.mean)
    assert f"marched at {there}" in out.details()
    out.save(tmp_path / "curve.h5")
    assert bd.load(tmp_path / "curve.h5").marched == out.marched


def test_preloads_that_rattle_are_marched_by_default(found):
    study, curve = found
    with pytest.raises(bd.SettingError, match="preload: expected some in N"):
        study.with_marched(curve)
    low = replace(curve, no_steady_below=60.0)
    assert [m.preload for m in study.with_marched(low, periods=16).marched] == [40.0, 60.0]


def test_preloads_that_rattle_are_told_once(found):
    """As one range, not again among the preloads with a warning."""
    told = "not found: no steady periodic response below 60 N: the damper rattles"
    gone = replace(found[1], no_steady_below=60.0, status=(told, told, "complete"))
    assert gone.details().count(told) == 1 and "with a warning" not in gone.details()


@pytest.mark.parametrize("method", ["with_marched", "with_sweeps"])
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


def test_the_band_and_the_marches_are_drawn(found):
    study, curve = found
    gone = np.where(curve.preload <= 60.0, np.nan, curve.amplitude)
    marched = study.with_marched(curve, [50.0], periods=16).marched
    left, _ = replace(curve, amplitude=gone, no_steady_below=60.0, marched=marched).plot()
    labels = left.get_legend_handles_labels()[1]
    assert {"no steady periodic response below 60 N", "time integration, mean and range"} <= set(labels)
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
