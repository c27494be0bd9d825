"""A failure at one preload, draw or point leaves the others as they are without it."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses import robust_optimum
from bdamper.response import highest_peak
from bdamper.response import optimal_curve as curves
from bdamper.response.followed_peak import follow_upward
from bdamper.util.errors import StaticError
from tests.util.test_disk import BAND, pressed

FAILURES = [
    bd.BdamperError("the response curve has no point"),
    StaticError("no static state"),
    np.linalg.LinAlgError("singular"),
    FloatingPointError("overflow"),
    ValueError("array must not contain infs or NaNs"),  # raised by SciPy
]
PRELOADS, LOST = [1.0, 2.0, 3.0], 2.0


@pytest.fixture(params=FAILURES, ids=lambda error: type(error).__name__)
def failure(request):
    return request.param


@pytest.fixture(scope="module")
def study():
    return pressed()


def at_second_preload(problem, preload):
    return preload == LOST


def of_second_draw(problem, preload):
    return problem.settings.friction_coefficient == 0.3


def failing(whole, failure, at=at_second_preload):
    """Return a function of a problem and a preload that raises an error at some preloads."""

    def function(problem, preload, *args, **options):
        if at(problem, preload):
            raise failure
        return whole(problem, preload, *args, **options)

    return function


@pytest.mark.slow
@pytest.mark.parametrize("part", ["within_budget", "open_at_rest", "amplitude_sensitivity"])
def test_a_preload_of_an_optimal_curve(study, failure, part, monkeypatch):
    whole = study.optimal_curve(PRELOADS, frequency=BAND, check=False)
    module = highest_peak if part == "open_at_rest" else curves
    original = getattr(module, part)

    def at_rest(case):
        if case.preload == LOST:
            raise failure
        return original(case)

    def slope(peak, family, preload):
        if preload == LOST:
            raise failure
        return original(peak, family, preload)

    stand_in = {
        "within_budget": failing(original, failure),
        "open_at_rest": at_rest,
        "amplitude_sensitivity": slope,
    }[part]
    monkeypatch.setattr(module, part, stand_in)
    found = study.optimal_curve(PRELOADS, frequency=BAND, check=False)
    for preload in (PRELOADS[0], PRELOADS[-1]):
        (mine,), (theirs,) = (np.flatnonzero(curve.preload == preload) for curve in (found, whole))
        assert found.amplitude[mine] == whole.amplitude[theirs]
        assert found.status[mine] == "complete"
    if part != "amplitude_sensitivity":  # the value is known without its slope
        (lost,) = np.flatnonzero(found.preload == LOST)
        reason = found.status_text[lost]
        assert (
            np.isnan(found.amplitude[lost])
            and reason.startswith("not found: ")
            and str(failure) in reason
        )


def test_a_preload_above_a_followed_peak(study, failure, monkeypatch):
    """The path ends below preloads that fail; a single one that it meets it passes with another step."""
    low, high = (study.peak(preload, BAND) for preload in (2.0, 3.0))
    problem = study.problem
    system = type(problem).system
    asked = []

    def fails_from(least, n_failures):
        def stand_in(problem, preload):
            asked.append(preload)
            if preload > least and sum(p > least for p in asked) <= n_failures:
                raise failure
            return system(problem, preload)

        return stand_in

    monkeypatch.setattr(type(problem), "system", fails_from(2.5, np.inf))
    assert follow_upward(problem, low, 3.0) is None
    assert max(asked) > 2.5
    asked.clear()
    monkeypatch.setattr(type(problem), "system", fails_from(2.5, 1))
    found = follow_upward(problem, low, 3.0)
    assert found.amplitude == pytest.approx(high.amplitude, rel=1e-6)


def test_the_preload_that_gives_the_interval(study, monkeypatch):
    """The highest preload has no static state: the one below gives the interval."""
    whole = curves.peak_interval
    lost = StaticError("no static state")
    seen = []

    def interval(case, frequency, mode):
        if case.preload == PRELOADS[-1]:
            raise lost
        seen.append(case.preload)
        return whole(case, BAND, mode)

    monkeypatch.setattr(curves, "peak_interval", interval)
    found = study.optimal_curve(PRELOADS, check=False)
    assert seen[0] == LOST and found.settings["frequency"] == list(BAND)
    assert np.isfinite(found.amplitude[:2]).all()


def test_a_point_of_a_sweep(study, failure, monkeypatch):
    whole = bd.sweep(study, {"preload": PRELOADS}, frequency=BAND)
    module = sys.modules["bdamper.analyses.sweep"]
    monkeypatch.setattr(module, "highest_peak", failing(module.highest_peak, failure))
    found = bd.sweep(study, {"preload": PRELOADS}, frequency=BAND)
    assert found.status_text[1].startswith("failed: ") and str(failure) in found.status_text[1]
    assert np.array_equal(found.array("amplitude")[[0, 2]], whole.array("amplitude")[[0, 2]])


@pytest.mark.slow
def test_a_draw_of_optimal_curves(study, failure, monkeypatch):
    draws = {"friction_coefficient": [0.2, 0.3, 0.4]}
    whole = bd.optimal_curve_uncertainty(study, draws, PRELOADS, frequency=BAND)
    module = sys.modules["bdamper.analyses.sweep"]
    monkeypatch.setattr(
        module, "optimal_curve", failing(module.optimal_curve, failure, of_second_draw)
    )
    found = bd.optimal_curve_uncertainty(study, draws, PRELOADS, frequency=BAND)
    assert found.status_text[1].startswith("not found: ") and str(failure) in found.status_text[1]
    assert (
        np.array_equal(found.amplitude[[0, 2]], whole.amplitude[[0, 2]])
        and np.isnan(found.amplitude[1]).all()
    )


@pytest.mark.slow
def test_a_draw_of_a_robust_optimum(study, failure, monkeypatch):
    """The median of three draws, one of which has no value anywhere, is the highest of the two others."""
    ways = {"preload": (1.0, 3.0), "n": 5, "tolerance": 0.2, "frequency": BAND}
    alone = bd.robust_optimum(study, {"friction_coefficient": [0.2, 0.4]}, percentile=100.0, **ways)
    monkeypatch.setattr(
        robust_optimum, "at_preload", failing(robust_optimum.at_preload, failure, of_second_draw)
    )
    found = bd.robust_optimum(
        study, {"friction_coefficient": [0.2, 0.3, 0.4]}, percentile=50.0, **ways
    )
    assert (found.preload, found.amplitude) == (alone.preload, alone.amplitude)
