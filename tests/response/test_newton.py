"""Guards of the search for one peak: each test fails without the guard that it is about."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.equations import Plane
from bdamper.response import peak as peak_module
from bdamper.response.peak import FAR, PeakOptions, find_peak, rounding, same_peak
from tests.plain import plain_study

INTERVAL = (250.0, 400.0)


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model(contact_points=9)
    return plain_study(
        model, excitation=bd.Excitation("tip"), engine_order=5, friction_coefficient=0.3
    )


@pytest.fixture(scope="module")
def peak(study):
    return study.peak(1000.0, INTERVAL)


@pytest.fixture(scope="module")
def beside(study, peak):
    """A point of the curve a tenth of the vibration before the peak."""
    guess = peak.y - 0.1 * peak.tangent * peak.scale
    c = study.problem.system(1000.0).solve(guess, Plane(peak.tangent), peak.scale, 1e-10, 20)
    assert c.status == 0
    return c


def test_a_peak_beyond_the_reach_is_refused(study, peak, beside):
    """By Newton's method, and by the search along the curve as well."""
    ways = {"tangent": beside.tangent, "scale": peak.scale, "curvature": peak.curvature}
    assert find_peak(study.problem.system(1000.0), beside.y, reach=0.2, **ways).ok
    assert (
        find_peak(study.problem.system(1000.0), beside.y, reach=0.01, **ways).status_text
        == f"not found: {FAR}"
    )


def test_a_poor_curvature_does_not_lead_far_away(study, peak, beside):
    """Its secant step would be 1e7 times the vibration; steps along the curve are limited."""
    found = find_peak(study.problem.system(1000.0), beside.y, scale=peak.scale, curvature=-1e-9)
    assert found.ok
    assert found.amplitude == pytest.approx(peak.amplitude, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("curvature", [-1.0, 1.0])
def test_the_search_leaves_a_minimum_uphill(curvature):
    """Between the two peaks at 18.94 N the amplitude has a minimum, where the slope vanishes too."""
    study = plain_study(
        bd.reference_model(contact_points=24), bd.Excitation("tip"), 5, friction_coefficient=0.3
    )
    curve = study.frequency_response(18.94, (279.0, 284.0))
    a = curve.amplitude
    i = next(
        i
        for i in range(1, len(a) - 1)
        if a[i] < a[i - 1] and a[i] < a[i + 1] and a[i] > 0.3 * a.max()
    )
    y, after = (np.append(curve.unknowns[k], 2 * np.pi * curve.frequency[k]) for k in (i, i + 1))
    system = study.problem.system(18.94)
    scale = system.units(y, abs(after[-1] - y[-1]))
    found = find_peak(system, y, scale=scale, curvature=curvature)
    assert found.ok
    assert found.curvature < 0.0
    assert found.amplitude > 1.0001 * a[i]


def test_equal_peaks_are_one_and_others_are_told_apart(peak):
    near, other = (replace(peak, frequency=(1.0 + e) * peak.frequency) for e in (1e-7, 1e-3))
    lower = replace(peak, amplitude=(1.0 - 1e-3) * peak.amplitude)
    assert same_peak(peak, near)
    assert not same_peak(peak, other)
    assert not same_peak(peak, lower)


def test_a_converged_peak_has_a_residual_within_the_tolerance(study, peak, beside):
    """Trials along the curve are corrected only as far as they need; the peak itself is corrected at the end."""
    found = find_peak(
        study.problem.system(1000.0),
        beside.y,
        options=PeakOptions(tolerance=1e-12, position_tolerance=1e-2),
    )
    assert found.ok
    assert found.residual <= 1e-12
    assert np.isfinite(found.curvature)


def test_a_residual_that_rounding_keeps_above_the_tolerance_is_accepted():
    """Springs of bonded faces: terms of the residual are so large that 1e-13 of the excitation is out of reach."""
    model = bd.reference_model("bladed_disk", 9)
    settings = {
        "harmonics": 1,
        "blade_modes": 10,
        "damper_modes": 4,
        "friction_law": "bonded",
        "constraint_planes": False,
    }
    bonded = bd.Study(model, bd.Excitation("tip", "tangential", 1.0), 5, **settings)
    strict, usual = bonded.peak(500.0, options=bd.PeakOptions(tolerance=1e-13)), bonded.peak(500.0)
    assert strict.amplitude == pytest.approx(usual.amplitude, rel=1e-9)
    assert 1e-13 < strict.residual <= rounding(bonded.problem.system(500.0), strict.y) < 1e-8


def test_a_residual_above_the_estimate_of_rounding_is_accepted(monkeypatch):
    """The estimate covers one evaluation, and contacts add rounding of their own."""
    model = bd.reference_model("bladed_disk", 9)
    study = plain_study(model, bd.Excitation("tip", amplitude=1.0), 5, friction_coefficient=0.3)
    usual = study.peak(500.0)
    system = study.problem.system(500.0)
    # out of reach, and the estimate says that it is not
    monkeypatch.setattr(peak_module, "rounding", lambda *_: 2e-15)
    found = find_peak(system, usual.y, options=PeakOptions(tolerance=1e-15))
    assert found.ok
    assert found.amplitude == pytest.approx(usual.amplitude, rel=1e-9)
    monkeypatch.setattr(peak_module, "rounding", lambda *_: 1e-17)
    assert not find_peak(system, usual.y, options=PeakOptions(tolerance=1e-15)).ok
