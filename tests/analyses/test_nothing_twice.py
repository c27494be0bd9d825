"""The default answer computes no curve, no peak, and no static state twice."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.problem import Problem
from bdamper.response import highest_peak, response_curve
from bdamper.util.formatting import amount
from tests.util.test_disk import BAND, pressed


def name_of(problem):
    """Return the settings and the model of a problem as one text."""
    return json.dumps(problem.record(), sort_keys=True, default=str) + problem.model.hash


@pytest.fixture
def computed(monkeypatch):
    """Counts of the curves, peaks, and static states that are computed, by what they belong to."""
    curves, peaks, states = Counter(), Counter(), Counter()
    search = response_curve._search
    highest = highest_peak.highest_of_curve
    static = Problem.static

    def counted_search(case, frequency, options):
        curves[name_of(case.problem), case.preload, tuple(frequency), options.step] += 1
        return search(case, frequency, options)

    def counted_peak(system, curve, *, options=None):
        settings = json.dumps(dict(curve.settings), sort_keys=True, default=str)
        peaks[settings, curve.model_hash, curve.preload, *curve.frequency[[0, -1]]] += 1
        return highest(system, curve, options=options)

    def counted_static(problem, preload, history=None):
        known = len(problem.static_states)
        state = static(problem, preload, history)
        if len(problem.static_states) > known:
            states[name_of(problem), preload, history] += 1
        return state

    monkeypatch.setattr(response_curve, "_search", counted_search)
    monkeypatch.setattr(highest_peak, "highest_of_curve", counted_peak)
    monkeypatch.setattr(Problem, "static", counted_static)
    return curves, peaks, states


def check_once(computed, optimal):
    """Check that all counts are 1, and that the checks of the optimum have run.

    The curve at the optimum alone is followed with two lengths of the steps.  The search takes long
    ones at all preloads; only its end shows which of them is the optimum.  Time integration starts
    at points of the curve, so that its answers change if it takes those of the long steps: in the
    seventh digit on the turbine blade, where the short steps take 908 evaluations and the
    integration 90,000.  The peak from the long steps is no start for the short ones: a curve comes
    from an end of the interval, and from a start within it other points would follow.
    """
    for counts in computed:
        repeated = {key[1:]: n for key, n in counts.items() if n > 1}
        assert counts and not repeated
    curves, *_ = computed
    with_any_step = Counter(key[:-1] for key in curves)
    twice = [preload for (_, preload, _), n in with_any_step.items() if n > 1]
    assert twice == [optimal.optimum.preload] and max(with_any_step.values()) == 2
    assert optimal.time_response and len(optimal.convergence.peaks) > 1
    assert len(optimal.other_friction) == 3


@pytest.mark.slow
def test_two_masses(computed):
    optimal = pressed().optimal_curve((0.5, 5.0), 4, frequency=BAND)
    check_once(computed, optimal)


@pytest.mark.nightly
@pytest.mark.slow
def test_the_turbine_blade(computed):
    excitation = bd.Excitation("tip", direction="tangential", amplitude=1.0)
    study = bd.Study(
        bd.reference_model("turbine_blade"),
        excitation,
        engine_order=5,
        friction_coefficient=0.3,
    )
    check_once(computed, study.optimal_curve((50.0, 300.0), 4))


def test_the_peak_of_an_optimal_curve_is_that_of_the_search():
    """A search at the preload gives the same values, and a preload without a value has no peak."""
    study = pressed()
    curve = study.optimal_curve((0.5, 5.0), 4, frequency=BAND, check=False)
    preload = float(curve.preload[1])
    known, searched = curve.peak_at(preload), study.peak(preload, BAND)
    assert (known.amplitude, known.frequency) == (searched.amplitude, searched.frequency)
    assert np.allclose(known.y, searched.y, rtol=1e-12, atol=0.0)
    assert known.corner == searched.corner and known.half_range == searched.half_range
    assert curve.peak_at(1.01 * preload) is None


def test_the_peak_of_an_optimal_curve_has_the_error_of_its_amplitude():
    """The true change is that of a complete search with two more harmonics."""
    study = pressed()
    curve = study.optimal_curve((0.5, 5.0), 4, frequency=BAND, check=False)
    preload = float(curve.preload[1])
    peak = curve.peak_at(preload)
    n_harmonics = study.problem.harmonic_numbers[-1] + 2
    richer = study.replace(harmonics=n_harmonics).peak(preload, BAND)
    change = richer.amplitude / peak.amplitude - 1.0
    (error,) = peak.errors
    assert error.source == "harmonics" and error.amplitude == pytest.approx(change, abs=1e-6)
    assert peak.error == pytest.approx(abs(change), abs=1e-6)
    assert f"{amount(richer.amplitude, 'm')} with two more harmonics" in str(peak)
    without = study.optimal_curve((0.5, 5.0), 4, frequency=BAND, check=False, errors=False)
    assert without.peak_at(preload).errors == ()
