"""Amplitudes in time at the optimum of an optimal curve and beside it: fields, prints, files, neighbours."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bdamper as bd
from bdamper.response.verification import TimeResponse
from bdamper.time_domain import time_response as in_time
from bdamper.util.formatting import amount
from tests.plain import plain_study


@pytest.fixture(scope="module")
def study():
    return plain_study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5)


@pytest.fixture(scope="module")
def curve(study):
    return study.optimal_curve((1000.0, 5000.0), 3, frequency=(280.0, 370.0), check=False)


def keeps(problem, tracked, progress=None):
    """In place of the time integration: nine tenths of the peak, more at lower preloads."""
    top, p = tracked.peak.amplitude, tracked.preload
    mean = 0.9 * top * (1.0 + 1e-6 * (5000.0 - p))
    return TimeResponse(mean, 0.95 * mean, 1.1 * mean, tracked.peak.frequency, p, top, 1.1 * mean, 1.0, periods=480,
                        diameters=(0, 5))  # fmt: skip


def test_by_default_it_is_computed_at_the_optimum_and_above(study, curve, monkeypatch, tmp_path):
    monkeypatch.setattr(in_time, "time_response", keeps)
    found = study.optimal_curve((1000.0, 5000.0), 3, frequency=(280.0, 370.0))
    one, above = found.time_response
    assert above.preload == pytest.approx(1.35 * one.preload)
    best = found.optimum_in_time.preload
    assert [(k.factor, k.preload) for k in found.other_friction] == [(1.0, best), (0.7, best), (1.3, best)]
    assert found.convergence.preload == one.preload == curve.optimum.preload
    assert one.balance == pytest.approx(curve.optimum.amplitude, rel=1e-3)
    assert f"Amplitude for the stress: {amount(one.highest_period, 'm')}; in time " in found._headline()
    found.save(tmp_path / "optimal.h5")
    assert bd.load(tmp_path / "optimal.h5").time_response == found.time_response
    ax = found.plot().axes[0]
    assert "highest blade in time, and range" in ax.get_legend_handles_labels()[1]
    plt.close("all")


def test_neighbours_on_request(study, curve, monkeypatch):
    monkeypatch.setattr(in_time, "time_response", keeps)
    found = study.optimal_curve((1000.0, 5000.0), 3, frequency=(280.0, 370.0), check="neighbours")
    best = curve.optimum.preload
    np.testing.assert_allclose([k.preload for k in found.time_response], [best / 1.35, best, best * 1.35])
    said, least = found._headline(), found.optimum_in_time
    tops = [max(k.highest, k.highest_period) for k in found.time_response]
    assert max(least.highest, least.highest_period) == min(tops) and least in found.time_response
    at, most = amount(least.preload, "N"), amount(min(tops), "m")
    assert f"Preload: {at}" in said and f"Amplitude for the stress: {most}" in said
    assert ("preloads were not integrated" in said) == (least.preload != best)
    assert ("optimum in time", least._headline()) in [fact[:2] for fact in found._facts()]
    assert "least in time" in found.plot().axes[0].get_legend_handles_labels()[1]
    plt.close("all")
    low, middle, high = found.time_response
    half = replace(middle, highest=0.5 * low.highest, highest_period=0.5 * low.highest)
    lower = replace(found, time_response=(low, half, high))
    assert lower.optimum_in_time.preload == best and "not integrated" not in lower._headline()
    beats = replace(half, highest_period=2.0 * max(k.highest_period for k in (low, high)))
    assert replace(found, time_response=(low, beats, high)).optimum_in_time is not beats
    lone = replace(found, time_response=(low, replace(middle, mean=np.nan), replace(high, mean=np.nan)))
    assert lone.optimum_in_time is None and f"Preload: {amount(best, 'N')}" in lone._headline()
    wide = replace(half, status="incomplete: not settled")
    doubtful = replace(found, time_response=(low, wide, high))
    said = doubtful._headline()
    assert doubtful.failures and said.startswith(f"Not for design: {'; '.join(doubtful.failures)}. ")
    assert "is incomplete: not settled. " in said and f"for the stress: {amount(wide.highest_period, 'm')}" in said
    stopped = replace(found, time_response=(low, replace(wide, status="interrupted"), high))
    assert stopped.optimum_in_time in (low, high)


def test_what_cannot_be_integrated_says_why(study, curve):
    """One basis for several nodal diameters is no structure in time."""
    shared = study.replace(fundamental_modes_only=True, harmonics=2)
    found, _ = in_time.with_time_response(
        shared.problem, replace(curve, time_response=(), model_hash=shared.model.hash)
    ).time_response
    assert found.status.startswith("not found: ") and "fundamental_modes_only" in found.status and np.isnan(found.mean)
    with pytest.raises(bd.SettingError, match=r"^check: expected .*, found 'harmonics'"):
        study.optimal_curve((1000.0, 5000.0), 3, check="harmonics")


def test_the_bottom_line_says_what_is_open(study, curve):
    best = curve.optimum
    known = TimeResponse(9e-6, 8e-6, 1e-5, 300.0, best.preload, 1e-5, periods=9, status="incomplete: some steps failed")
    assert "is incomplete: some steps failed. " in replace(curve, time_response=(known,))._headline()
    none = TimeResponse(*(np.nan,) * 4, best.preload, 1e-5, status="not found: no motion stays")
    said = replace(curve, time_response=(none,))._headline()
    assert "is not found: no motion stays. " in said and "by harmonic balance alone" in said
    assert "Not covered: motion in time, " in said
