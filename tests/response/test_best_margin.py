"""The preload of the largest margin, refined between those of an optimal curve."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses import accuracy, robust_optimum
from bdamper.fatigue import AISI_1050
from bdamper.fatigue.margin import LeastMargin
from bdamper.response import optimal_curve
from bdamper.response.verification import FrictionPeak, TimeResponse
from bdamper.time_domain import time_response
from bdamper.util.errors import SettingError
from bdamper.util.formatting import amount
from tests.fatigue.test_margins import with_stress
from tests.printed import said


@pytest.fixture(scope="module")
def study():
    model = with_stress(bd.reference_model("bladed_disk", 9))
    # the margin has one maximum over the preload; with the vectors of partial contact it has two at one harmonic
    return bd.Study(
        model,
        bd.Excitation("tip", "tangential", 2.0),
        5,
        blade_modes=5,
        harmonics=1,
        contact_stiffness=bd.ResidualModes(partial_contact=False),
    )


@pytest.fixture(scope="module")
def curve(study):
    return study.optimal_curve((40.0, 400.0), 6, check=False, quantity="margin", material=AISI_1050)


@pytest.mark.slow
def test_the_best_is_no_less_than_at_every_preload_and_near_a_fresh_peak(study, curve, tmp_path):
    (margins,) = curve.margins
    assert margins.over == "preload" and len(margins) == len(curve)
    assert margins.best_margin >= np.nanmax(margins.margin)
    fresh = study.peak(margins.best_value)
    assert study.margin(fresh, AISI_1050).least == pytest.approx(margins.best_margin, rel=1e-6)
    asked = LeastMargin(AISI_1050)(study.problem, fresh.y[:-1], fresh.y[-1], margins.best_value)
    assert asked == pytest.approx(margins.best_margin, rel=1e-6)
    assert margins._headline() in curve.summary()
    curve.save(tmp_path / "curve.h5")
    assert str(bd.load(tmp_path / "curve.h5").margins[0]) == str(margins)


@pytest.mark.slow
def test_what_a_blade_keeps_has_a_margin_of_its_own(study, curve, tmp_path):
    """The largest period is a fifth above the balance at one preload, and not known at another."""
    p, top = curve.optimum.preload, curve.optimum.amplitude
    known = TimeResponse(
        1.1 * top,
        top,
        1.15 * top,
        curve.optimum.frequency,
        p,
        top,
        highest_period=1.2 * top,
        periods=9,
    )
    others = (
        TimeResponse(*(np.nan,) * 4, 300.0, top),
        replace(known, preload=200.0),
    )  # time responses that belong to no peak of the curve
    found = study.best_margin(replace(curve, time_response=(known, *others)), AISI_1050)
    two = replace(
        curve, time_response=(known, replace(known, preload=1.35 * p, highest_period=1.3 * top))
    )
    ax = two.plot().axes[0]
    # error bars of harmonic balance have no marker of their own
    in_time = next(bars for bars in ax.containers if bars.lines[0] is not None)
    middle, _, (bars,) = in_time.lines
    assert bars.get_segments()[0][1, 1] / middle.get_ydata()[0] == pytest.approx(1.2 / 1.1), (
        "up to the highest period"
    )
    (text,) = (t.get_text() for t in ax.texts if "time integration" in t.get_text())
    assert f"time integration: up to {amount(1.2 * top, 'm')}" in " ".join(text.split())
    (one,) = found.in_time
    assert one.preload == p and one.least == pytest.approx(
        study.margin(study.peak(p), AISI_1050).least / 1.2, rel=1e-6
    )
    highest = amount(1.2 * top, "m")  # a single period, above the mean
    scaled = f"vibration scaled by 1.2: the largest amplitude by time integration is {highest}"
    text = f"Time integration {one.least:.3g} at {amount(p, 'N')}; {scaled}"
    assert text in said(found)
    assert "time integration, highest blade" in found.plot().axes[0].get_legend_handles_labels()[1]
    plt.close("all")
    found.save(tmp_path / "margins.h5")
    assert bd.load(tmp_path / "margins.h5").in_time[0].least == one.least
    assert curve.margins[0].in_time == ()
    assert found.margin[found.least] > 1.0 and "Fatigue FAIL" not in said(found)
    weak = replace(found, in_time=(replace(one, factor=0.9 / one.least * one.factor),))
    assert weak._headline().startswith("Not for design: ") and "Fatigue FAIL" in said(weak)


@pytest.mark.slow
def test_the_margin_is_asked_for_after_the_time_integration(study, curve, monkeypatch):
    """Not where it was interrupted: then there is an end of it."""
    monkeypatch.setattr(optimal_curve, "optimal_curve", lambda *_, **__: replace(curve, margins=()))
    asked = SimpleNamespace(best_status="complete")
    monkeypatch.setattr(robust_optimum, "best_margin", lambda problem, curve, material: asked)
    for status, ended, margins in (
        ("complete", "complete", 1),
        ("complete", "interrupted", 0),
        ("interrupted", "", 0),
    ):
        other = (FrictionPeak(1.0, 90.0, np.nan, ended),) * bool(ended)
        monkeypatch.setattr(
            robust_optimum,
            "with_other_friction",
            lambda s, c, *_, other=other: replace(c, other_friction=other),
        )
        kept = TimeResponse(*(np.nan,) * 4, 90.0, 1e-6, status=status)
        monkeypatch.setattr(
            time_response,
            "with_time_response",
            lambda s, c, *_, known=kept, **__: replace(c, time_response=(known,)),
        )
        found = study.optimal_curve((40.0, 400.0), 6, quantity="margin", material=AISI_1050)
        assert found.time_response == (kept,) and found.margins == (asked,) * margins
        assert found.other_friction == other
        assert found.interrupted == (not margins)


@pytest.mark.slow
def test_ctrl_c_in_the_margins_keeps_what_was_computed(study, curve, monkeypatch, tmp_path):
    """Before those of the curve are known the curve alone, later their largest."""

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(optimal_curve, "optimal_curve", lambda *_, **__: replace(curve, margins=()))
    ask = {"check": False, "quantity": "margin", "material": AISI_1050}
    monkeypatch.setattr(LeastMargin, "__call__", stop)
    (found,) = study.optimal_curve((40.0, 400.0), 6, **ask).margins
    np.testing.assert_array_equal(found.margin, curve.margins[0].margin)
    assert (found.best_margin, found.best_status) == (np.nanmax(found.margin), "interrupted")
    monkeypatch.setattr(LeastMargin, "along", stop)
    stopped = study.optimal_curve((40.0, 400.0), 6, **ask)
    assert stopped.margins == () and stopped.interrupted and not curve.interrupted
    stopped.save(tmp_path / "stopped.h5")
    assert bd.load(tmp_path / "stopped.h5").interrupted


@pytest.mark.slow
def test_ctrl_c_in_a_peak_with_other_friction_is_an_interruption(study, curve, monkeypatch):
    """In the middle of the check, before the margins."""
    monkeypatch.setattr(optimal_curve, "optimal_curve", lambda *_, **__: replace(curve, margins=()))
    monkeypatch.setattr(accuracy, "with_convergence", lambda problem, curve, *_: curve)
    asked = []

    def peaks(*_, **__):
        asked.append(1)
        raise KeyboardInterrupt

    monkeypatch.setattr(robust_optimum.SteadyPeak, "__call__", peaks)
    found = study.optimal_curve((40.0, 400.0), 6, quantity="margin", material=AISI_1050)
    assert asked and found.interrupted and found.margins == ()
    # the peak with the friction of the study is that of the curve
    asked_for = [peak for peak in found.other_friction if peak.factor != 1.0]
    assert len(asked_for) == 2 and {peak.status for peak in asked_for} == {"interrupted"}


@pytest.mark.slow
def test_the_largest_margin_may_lie_beside_preloads_without_a_value(study, curve):
    arrays = (
        "preload",
        "amplitude",
        "frequency",
        "shares",
        "residual",
        "unknowns",
        "lower_bound",
        "goes_on",
        "requested",
    )
    asked = replace(curve, **{name: getattr(curve, name)[curve.requested] for name in arrays})
    asked = replace(asked, status=("complete",) * len(asked), kind=("peak",) * len(asked))
    gone = asked.preload < 1.5 * curve.optimum.preload
    part = replace(asked, amplitude=np.where(gone, np.nan, asked.amplitude),
                   unknowns=np.where(gone[:, None], np.nan, asked.unknowns))  # fmt: skip
    found, whole = study.best_margin(part, AISI_1050), curve.margins[0]
    assert 0 < gone.sum() < len(asked) - 1 and found.best_margin > 1.2 * np.nanmax(found.margin)
    assert found.best_margin > (1.0 - robust_optimum.AGREES) * whole.best_margin
    fresh = study.margin(study.peak(found.best_value), AISI_1050).least
    assert found.best_margin == pytest.approx(fresh, rel=1e-6), found.best_status


@pytest.mark.slow
def test_the_whole_tracking_curve_is_asked(study, curve, monkeypatch):
    """Whether its least margin counts as that of the peak is a matter of the tolerance."""
    agrees = study.best_margin(curve, AISI_1050)
    along = study.margin(
        study.frequency_response(agrees.best_value, tuple(curve.settings["frequency"])), AISI_1050
    )
    least, share = (
        float(along.margin[along.least]),
        1.0 - along.margin[along.least] / agrees.best_margin,
    )
    monkeypatch.setattr(robust_optimum, "AGREES", share + 1e-6)
    assert study.best_margin(curve, AISI_1050).best_status == "complete"
    monkeypatch.setattr(robust_optimum, "AGREES", share - 1e-6)
    at_least = amount(float(along.frequency[along.least]), "Hz")
    where = f"on the response curve there the margin is {least:.4g} at {at_least}"
    assert study.best_margin(curve, AISI_1050).best_reason.endswith(where)


@pytest.mark.slow
def test_a_margin_needs_a_material_and_stress(study):
    with pytest.raises(SettingError, match="material"):
        study.optimal_curve((40.0, 400.0), 6, quantity="margin")
    with pytest.raises(SettingError, match="quantity"):
        study.optimal_curve((40.0, 400.0), 6, quantity="life", material=AISI_1050)
    bare = study.replace(model=replace(study.model, stress={}))
    with pytest.raises(SettingError, match="stress sets"):
        bare.optimal_curve((40.0, 400.0), 6, quantity="margin", material=AISI_1050)


@pytest.mark.nightly
@pytest.mark.slow
def test_over_speed_the_lighter_damper_has_the_larger_margin():
    """The lowest preloads have no steady response, and a detached branch 30 times higher reaches to 533 N.

    The peaks below its end are lower bounds, so that the largest margin lies at the first preload beyond it.
    """
    # the detached branch and its end are those of the force vectors of bonded faces alone
    at = bd.Study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip", amplitude=20.0), 5, harmonics=1,
                  friction_coefficient=0.3,
                  contact_stiffness=bd.ResidualModes(partial_contact=False)).at_speed(480.0)  # fmt: skip
    curve = at.optimal_curve((350.0, 600.0), 5, check=False, quantity="margin", material=AISI_1050)
    assert curve.optimum.kind == "unknown" and np.isfinite(curve.amplitude).sum() == 3
    below = curve.preload < curve.optimum.preload
    assert not np.isfinite(curve.amplitude[below]).any()
    (margins,) = curve.margins
    assert margins.best_value == curve.optimum.preload
    assert margins.best_margin == pytest.approx(np.nanmax(margins.margin), rel=1e-12)
    assert margins.best_status == "complete"
    assert margins.best_reason == "next to preloads without an amplitude"
