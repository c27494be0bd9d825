"""Amplitudes in time at the optimum of an optimal curve and beside it: fields, prints, files, neighbours."""

from dataclasses import replace
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bdamper as bd
from bdamper.response import optimum_statement
from bdamper.response.optimum_checks import checks
from bdamper.response.verification import (
    Convergence,
    FrictionPeak,
    FrictionRange,
    HarmonicPeak,
    TimeResponse,
)
from bdamper.time_domain import time_response as in_time
from bdamper.util.formatting import amount, percent, span
from bdamper.util.progress import Cost
from tests.analyses.test_friction_range import jenkins_peak
from tests.plain import plain_study
from tests.printed import row, said, value

DESIGN = "Design amplitude"


@pytest.fixture(scope="module")
def study():
    return plain_study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5)


@pytest.fixture(scope="module")
def curve(study):
    return study.optimal_curve((1000.0, 5000.0), 3, frequency=(280.0, 370.0), check=False)


def keeps(problem, tracked, seconds=None, progress=None):
    """In place of the time integration: nine tenths of the peak, more at lower preloads."""
    top, p = tracked.peak.amplitude, tracked.preload
    mean = 0.9 * top * (1.0 + 1e-6 * (5000.0 - p))
    return TimeResponse(mean, 0.95 * mean, 1.1 * mean, tracked.peak.frequency, p, top, 1.1 * mean, 1.0, periods=480,
                        diameters=(0, 5), half_range=mean)  # fmt: skip


@pytest.mark.parametrize(("share", "status", "factors"), [
    (0.9, "complete", [1.0]), (1.15, "complete", [1.0]), (0.78, "complete", [1.0, 1.35]), (1.22, "complete", [1.0, 1.35]),
    (0.9, "incomplete", [1.0, 1.35]), (np.nan, "not found", [1.0, 1.35]),
])  # fmt: skip
def test_a_second_preload_follows_if_the_first_does_not_confirm_the_optimum(
    study, curve, monkeypatch, share, status, factors
):
    """A difference of more than 20 % from harmonic balance fails the check at the optimum."""

    def response(problem, tracked, seconds=None, progress=None):
        kept = keeps(problem, tracked)
        return replace(kept, mean=share * kept.balance, status=status)

    monkeypatch.setattr(in_time, "time_response", response)
    best = curve.optimum.preload
    found = study.with_time_response(curve)
    expected = [factor * best for factor in factors]
    assert [k.preload for k in found.time_response] == pytest.approx(expected)
    asked = study.with_time_response(curve, [1.35 * best, best])
    assert [k.preload for k in asked.time_response] == pytest.approx([best, 1.35 * best])


def test_the_headline_names_a_drop_beside_the_optimum(curve):
    """A peak of 30 times the lowest amplitude at 0.94 of its preload, known or followed as a lower bound."""
    best = replace(curve.optimum, kind="smooth")
    curve = replace(curve, optimum=best)
    n = len(curve)
    preload = best.preload * np.linspace(0.94, 1.2, n)
    smooth = best.amplitude * (1.0 + 0.1 * np.arange(n) / n)
    jump = smooth.copy()
    jump[0] = 30.0 * best.amplitude
    unknown = np.full(n, np.nan)
    incomplete = np.where(np.arange(n) == 0, np.nan, jump)
    bound = np.where(np.arange(n) == 0, jump, np.nan)
    place = f"at {amount(0.94 * best.preload, 'N')} {amount(30.0 * best.amplitude, 'm')}"
    for amplitude, lower_bound in ((jump, unknown), (incomplete, bound)):
        found = replace(curve, preload=preload, amplitude=amplitude, lower_bound=lower_bound)
        assert f"; {place}, 30 times as high" in said(found)
    # a smooth rise, and a jump that even 1.5 times less friction does not reach
    calm = replace(curve, preload=preload, amplitude=smooth, lower_bound=unknown)
    away = replace(
        curve, preload=preload * [0.6, *np.ones(n - 1)], amplitude=jump, lower_bound=unknown
    )
    for other in (calm, away):
        assert "times as high" not in said(other)


@pytest.mark.slow
def test_the_headline_names_a_cliff_of_the_closed_form():
    """Friction below pi/4 of the force does not limit one mass: far from it only damping does.

    The load closes a gap against a spring of 8 N before it presses on the contact, 0.25 N for each
    newton of the load: 0.70 times the best load has 0.32 times the best friction.
    """
    contact = bd.Contact(0, 1, kt=1.0, kn=1.0, mu=0.5, gap=8.0)
    loads = {"forces": {0: 1.0}, "load_per_preload": {1: 1.0}}
    study = bd.lumped(
        [1.0, 1.0], [0.02, 0.02], [1.0, 1.0], contacts=[contact], harmonics=1, **loads
    )

    def preload_of(limit):
        """Load (N) at which the friction force is at most ``limit``: kn / (k + kn) of it above k times the gap."""
        return 8.0 + 4.0 * limit

    limits = np.array([0.25, 0.5, 1.2, 1.57, 2.0, 3.0])
    found = study.optimal_curve(preload_of(limits), frequency=(0.12, 0.3), check=False)
    best = found.optimum
    right = {limit: jenkins_peak(limit) for limit in limits}
    for limit, amplitude in right.items():
        (row,) = np.flatnonzero(found.preload == preload_of(limit))
        assert found.amplitude[row] == pytest.approx(amplitude, rel=1e-8)
    lowest = jenkins_peak(0.25 * (best.preload - 8.0))
    assert best.amplitude == pytest.approx(lowest, rel=1e-8) and lowest < min(right.values())
    # 9 N lies outside of the spread of friction coefficients
    cliff = right[0.5]
    assert (
        f"; at 10 N {amount(cliff, 'm')}, {cliff / lowest:.2g} times as high: engine order"
        in said(found)
    )


@pytest.mark.slow
def test_by_default_it_is_computed_at_the_optimum(study, curve, monkeypatch, tmp_path):
    monkeypatch.setattr(in_time, "time_response", keeps)
    found = study.optimal_curve((1000.0, 5000.0), 3, frequency=(280.0, 370.0))
    (one,) = found.time_response
    best = found.recommended_preload
    assert [(k.factor, k.preload) for k in found.other_friction] == [
        (1.0, best),
        (0.7, best),
        (1.3, best),
    ]
    assert found.convergence.preload == one.preload == curve.optimum.preload
    assert one.balance == pytest.approx(curve.optimum.amplitude, rel=1e-3)
    # the optimum is at the end of the range
    assert found.failures and value(found, "Time integration") and not value(found, DESIGN)
    # and one harmonic is too few for a design
    few = [failure for failure in found.failures if failure.startswith("more harmonics")]
    assert len(few) == 1 and few[0].endswith("not converged with 1")
    smooth = replace(found.optimum, kind="smooth", status="complete")
    inside = replace(found, optimum=smooth, convergence=None)
    # the integration is below the harmonic balance, and other friction coefficients are above it
    least = one
    tried = [least.largest, least.balance, *(k.amplitude for k in found.other_friction)]
    assert not inside.failures and inside.design_amplitude == max(tried) > least.largest
    assert row(inside, DESIGN)[1:] == (
        amount(max(tried), "m"),
        "largest of all checks, with 1.3 times the friction",
    )
    found.save(tmp_path / "optimal.h5")
    assert bd.load(tmp_path / "optimal.h5").time_response == found.time_response
    ax = found.plot().axes[0]
    assert "time integration, highest blade: mean, range" in ax.get_legend_handles_labels()[1]
    plt.close("all")


@pytest.mark.slow
def test_the_checks_without_time_integration_and_its_budget(study, monkeypatch):
    """ "harmonics" has all other checks; the time of one integration is passed on."""
    budgets = []

    def response(problem, tracked, seconds=None, progress=None):
        budgets.append(seconds)
        return keeps(problem, tracked)

    monkeypatch.setattr(in_time, "time_response", response)
    asked = {"frequency": (280.0, 370.0), "errors": False}
    by_harmonics = study.optimal_curve((1000.0, 5000.0), 3, check="harmonics", **asked)
    assert not budgets and not by_harmonics.time_response
    assert by_harmonics.convergence is not None and by_harmonics.other_friction
    assert "with_time_response(curve)" in said(by_harmonics)
    study.optimal_curve((1000.0, 5000.0), 3, seconds=12.0, **asked)
    assert set(budgets) == {12.0}
    with pytest.raises(bd.SettingError, match="seconds: expected"):
        study.optimal_curve((1000.0, 5000.0), 3, seconds=0.0, **asked)
    with pytest.raises(bd.SettingError, match="seconds: expected"):
        study.with_time_response(by_harmonics, seconds=0.0)


@pytest.mark.slow
def test_neighbours_on_request(study, curve, monkeypatch):
    monkeypatch.setattr(in_time, "time_response", keeps)
    found = study.optimal_curve((1000.0, 5000.0), 3, frequency=(280.0, 370.0), check="neighbours")
    best = curve.optimum.preload
    np.testing.assert_allclose(
        [k.preload for k in found.time_response], [best / 1.35, best, best * 1.35]
    )
    text, least = said(found), found.optimum_in_time
    tops = [max(k.highest, k.highest_period) for k in found.time_response]
    assert max(least.highest, least.highest_period) == min(tops) and least in found.time_response
    assert value(found, "Preload") == amount(least.preload, "N")
    assert value(found, "Time integration") == span(least.lowest, min(tops), "m")
    assert ("preloads were not integrated" in text) == (least.preload != best)
    assert ("optimum in time", least._headline()) in [fact[:2] for fact in found._facts()]
    assert "lowest by time integration" in found.plot().axes[0].get_legend_handles_labels()[1]
    plt.close("all")
    low, middle, high = found.time_response
    half = replace(middle, highest=0.5 * low.highest, highest_period=0.5 * low.highest)
    lower = replace(found, time_response=(low, half, high))
    assert lower.optimum_in_time.preload == best and "not integrated" not in said(lower)
    beats = replace(half, highest_period=2.0 * max(k.highest_period for k in (low, high)))
    assert replace(found, time_response=(low, beats, high)).optimum_in_time is not beats
    lone = replace(
        found, time_response=(low, replace(middle, mean=np.nan), replace(high, mean=np.nan))
    )
    assert lone.optimum_in_time is None and value(lone, "Preload") == amount(best, "N")
    wide = replace(half, status="incomplete", reason="not settled")
    doubtful = replace(found, time_response=(low, wide, high))
    verdict = doubtful._statement().verdict
    *failures, best_known = verdict
    assert failures == [f"Not for design: {failure}" for failure in doubtful.failures]
    assert best_known.startswith(f"Lowest amplitude at {amount(best, 'N')}")
    assert any(line.endswith("is incomplete: not settled") for line in verdict)
    assert value(doubtful, "Time integration") == span(wide.lowest, wide.largest, "m")
    assert np.isnan(doubtful.design_amplitude) and not value(doubtful, DESIGN)
    stopped = replace(found, time_response=(low, replace(wide, status="interrupted"), high))
    assert stopped.optimum_in_time in (low, high)


@pytest.mark.slow
def test_the_ends_of_the_range_on_request(study, monkeypatch, tmp_path):
    """In time the amplitude rises with the distance from the optimum, by another amount than by harmonic balance."""

    def rises(problem, tracked, seconds=None, progress=None):
        mean = 1e-4 * (1.0 + 0.5 * abs(np.log(tracked.preload / rises.best)))
        values = (
            mean,
            0.9 * mean,
            1.1 * mean,
            tracked.peak.frequency,
            tracked.preload,
            tracked.peak.amplitude,
        )
        return TimeResponse(
            *values, 1.1 * mean, 1.0, periods=480, diameters=(0, 5), half_range=mean
        )

    asked = (25.0, 100.0), 5
    plain = study.optimal_curve(*asked, frequency=(280.0, 370.0), check=False)
    rises.best = plain.optimum.preload
    monkeypatch.setattr(in_time, "time_response", rises)
    found = study.optimal_curve(*asked, frequency=(280.0, 370.0), check="range")
    low, high = found.near_best
    assert low < rises.best < high
    assert (
        found.near_best == plain.near_best == plain.preloads_within(1.2 * plain.optimum.amplitude)
    )
    expected = sorted([low, rises.best, 1.35 * rises.best, high])
    np.testing.assert_allclose([k.preload for k in found.time_response], expected, rtol=1e-12)
    assert [k.preload for k in found.range_in_time] == [low, high]
    more = [0.5 * abs(np.log(p / rises.best)) for p in (low, high)]
    ends = " and ".join(f"{percent(x)} at {amount(p, 'N')}" for x, p in zip(more, (low, high)))
    assert (
        "",
        "",
        f"by time integration, higher than the minimum by {ends}",
    ) in found._statement().rows
    (light,) = [check for check in checks(found) if check.name == "Ends of the range"]
    assert light.colour == ("green" if max(more) <= 0.2 else "amber") and ends in light.found
    found.save(tmp_path / "optimal.h5")
    assert bd.load(tmp_path / "optimal.h5").range_in_time == found.range_in_time
    lost = [
        replace(k, mean=np.nan, status="not found", reason="why") if k.preload == high else k
        for k in found.time_response
    ]
    unknown = replace(found, time_response=tuple(lost))
    (light,) = [check for check in checks(unknown) if check.name == "Ends of the range"]
    assert light.rule.endswith("amber above or if unknown")
    assert light.colour == "amber" and f"and unknown at {amount(high, 'N')}" in light.found
    others = [k for k in found.time_response if k.preload != low]
    assert not replace(found, time_response=tuple(others)).range_in_time
    assert not plain.range_in_time and "higher than the minimum" not in said(plain)


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (2.0, 3.0, "2 to 3 N"),
        (1.0, 3.0, "up to 3 N, searched from 1 N"),
        (2.0, 9.0, "from 2 N, searched up to 9 N"),
        (1.0, 9.0, "all preloads of the search, 1 to 9 N"),
    ],
)
def test_a_range_names_the_ends_of_the_search_that_cut_it_off(low, high, text):
    curve = SimpleNamespace(preload=np.array([1.0, 4.0, 9.0]))
    assert optimum_statement._range_text(curve, low, high) == text


@pytest.mark.slow
def test_the_range_is_named_a_result_of_harmonic_balance(curve, tmp_path):
    assert (
        ": at most 20 % above the lowest amplitude, by harmonic balance"
        in row(curve, "Preload").remark
    )
    labels = curve.plot().axes[0].get_legend_handles_labels()[1]
    assert "within 20 % of the optimum (harmonic balance)" in labels
    plt.close("all")
    page = curve.report(tmp_path / "review.html").read_text()
    assert "at most a fifth higher than its minimum, by harmonic balance: " in page


def test_what_cannot_be_integrated_says_why(study, curve):
    """One basis for several nodal diameters is no structure in time."""
    shared = study.replace(fundamental_modes_only=True, harmonics=2)
    found, *_ = in_time.with_time_response(
        shared.problem, replace(curve, time_response=(), model_hash=shared.model.hash)
    ).time_response
    assert (
        found.status_text.startswith("not found: ")
        and "fundamental_modes_only" in found.reason
        and np.isnan(found.mean)
    )
    with pytest.raises(bd.SettingError, match=r"^check: expected .*, found 'sometimes'"):
        study.optimal_curve((1000.0, 5000.0), 3, check="sometimes")


def test_the_bottom_line_says_what_is_open(study, curve):
    best = curve.optimum
    known = TimeResponse(
        9e-6,
        8e-6,
        1e-5,
        300.0,
        best.preload,
        1e-5,
        periods=9,
        status="incomplete",
        reason="some steps failed",
    )
    assert "is incomplete: some steps failed" in replace(curve, time_response=(known,))._headline()
    none = TimeResponse(
        *(np.nan,) * 4, best.preload, 1e-5, status="not found", reason="no motion stays"
    )
    without = replace(curve, time_response=(none,))
    assert "is not found: no motion stays" in without._headline()
    assert "do not use this amplitude for stresses" in row(without, "Harmonic balance").remark
    assert "Not covered time integration, " in said(without)


def checked(curve, **changes):
    """Return the curve with passed checks, each with another amplitude; ``changes`` replace checks."""
    best = curve.optimum
    size, preload = best.amplitude, best.preload
    response = TimeResponse(
        *(k * size for k in (0.97, 0.96, 0.98)), best.frequency, preload, size, 0.99 * size
    )
    peaks = tuple(
        HarmonicPeak(h, k * size, best.frequency) for h, k in ((3, 1.0), (5, 1.02), (7, 1.01))
    )
    passed = {
        "optimum": replace(best, kind="smooth", status="complete"),
        "time_response": (response,),
        "convergence": Convergence(preload, 0.05, peaks),
        "other_friction": tuple(
            FrictionPeak(k, preload, a * size) for k, a in ((1.0, 1.0), (0.7, 1.1), (1.3, 1.05))
        ),
    }
    return replace(curve, **passed | changes)


def test_the_design_amplitude_is_the_largest_of_all_checks(curve):
    size, passed = curve.optimum.amplitude, checked(curve)
    (response,) = passed.time_response
    assert not passed.failures and passed.design_amplitude == pytest.approx(1.1 * size, rel=1e-14)
    largest = "largest of all checks"
    assert row(passed, DESIGN) == (
        DESIGN,
        amount(1.1 * size, "m"),
        f"{largest}, with 0.7 times the friction",
    )
    single = replace(passed, time_response=(replace(response, highest_period=1.2 * size),))
    assert single.design_amplitude == pytest.approx(1.2 * size, rel=1e-14)
    assert row(single, DESIGN).remark == f"{largest}, by time integration"
    alone = replace(passed, other_friction=())
    assert alone.design_amplitude == pytest.approx(1.02 * size, rel=1e-14)
    assert row(alone, DESIGN).remark == f"{largest}, with more harmonics"
    only = replace(alone, convergence=None)
    assert only.design_amplitude == size
    assert row(only, DESIGN).remark == f"{largest}, by harmonic balance"
    elsewhere = replace(
        passed,
        other_friction=tuple(replace(k, preload=2.0 * k.preload) for k in passed.other_friction),
    )
    assert elsewhere.design_amplitude == alone.design_amplitude, "other preloads do not count"


def test_each_check_states_its_time(curve):
    """The time of several integrations is added; a check that was not run has none."""
    passed = checked(curve)
    (response,) = passed.time_response
    both = tuple(replace(response, cost=Cost(seconds=seconds)) for seconds in (20.0, 4.0))
    timed = replace(
        passed,
        time_response=both,
        convergence=replace(passed.convergence, cost=Cost(seconds=3.0)),
        friction_range=FrictionRange(passed.other_friction, seconds=0.5),
    )
    statement = timed._statement()
    times = dict(zip((row.name for row in statement.checks), statement.times, strict=True))
    assert {name: time for name, time in times.items() if time} == {
        "Time integration": "24 s",
        "More harmonics": "3 s",
        "Other friction coefficients": "500 ms",
    }
    assert "time integration 24 s" in str(timed)
    assert all(time.startswith("about ") for time in curve._statement().times if time)


def test_without_a_known_amplitude_of_all_checks_there_is_no_design_amplitude(curve):
    passed = checked(curve)
    (response,) = passed.time_response
    first, less, more = passed.other_friction
    for unknown in (
        replace(less, amplitude=np.nan, status="not found", reason="why"),
        replace(less, status="incomplete", reason="why"),
    ):
        doubtful = replace(passed, other_friction=(first, unknown, more))
        assert np.isnan(doubtful.design_amplitude)
        reason = "the peak with 0.7 times the friction is not complete"
        assert row(doubtful, DESIGN) == (DESIGN, "unknown", reason)
    for change in (
        {"other_friction": (first, replace(less, amplitude=3.0 * first.amplitude), more)},
        {"time_response": (replace(response, status="incomplete", reason="not settled"),)},
        {"time_response": (replace(response, balance=1.5 * response.balance),)},
    ):
        failed = replace(passed, **change)
        assert failed.failures and np.isnan(failed.design_amplitude)
        assert failed._headline().startswith("Not for design: ")
        assert "esign amplitude" not in str(failed)
        assert value(failed, "Time integration")
    without = replace(passed, time_response=())
    assert (
        np.isnan(without.design_amplitude)
        and "do not use this amplitude for stresses" in row(without, "Harmonic balance").remark
    )
