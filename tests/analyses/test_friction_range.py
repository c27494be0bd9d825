"""Factors on the friction coefficients at which the amplitude at a preload doubles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy

import bdamper as bd
from bdamper.analyses import robust_optimum
from bdamper.analyses.friction_range import find_range, tolerates_friction
from bdamper.response.optimum_checks import checks
from bdamper.response.verification import FrictionPeak, FrictionRange
from bdamper.util.formatting import amount
from tests.each import each
from tests.printed import said
from tests.response.test_verdict import drawn_masses
from tests.util.test_disk import BAND, pressed

STUDY = pressed()
MU = STUDY.settings.friction_coefficient
NAME = "Friction range"


def peaks_of(amplitude):
    """Return a function of the factor that gives peaks of 1 m times ``amplitude(factor)``, and the factors it was asked."""
    asked = []

    def peak_with(factor):
        asked.append(factor)
        size = amplitude(factor)
        return size if isinstance(size, FrictionPeak) else FrictionPeak(factor, 10.0, size)

    return peak_with, asked


def power_law(below, above):
    """Return an amplitude that doubles exactly with the factors ``below`` and ``above``."""
    return lambda f: f ** (np.log(2.0) / np.log(below if f < 1.0 else above))


@each(
    ("below", "above"),
    [(0.69, 1.45), (0.68, 1.33), (0.8, 1.2), (0.95, 1.05), (0.64, 1.31), (0.75, 2.2)],
)
def test_the_factors_enclose_the_exact_ones(below, above):
    """Factors beyond 1/1.5 and 1.5 are not searched."""
    peak_with, asked = peaks_of(power_law(below, above))
    found = find_range(peak_with)
    low, high = found.limits
    assert low.near == (below > 1.0 / 1.5) and high.near == (above < 1.5)
    if low.near:
        assert low.outside <= below <= low.inside <= 1.15 * low.outside
    else:
        assert low.inside == 1.0 / 1.5 and np.isnan(low.outside)
    if high.near:
        assert high.inside <= above <= high.outside <= 1.15 * high.inside
    else:
        assert high.inside == 1.5 and np.isnan(high.outside)
    # the law is a straight line in the logarithms
    expected = [below if low.near else np.nan, above if high.near else np.nan]
    np.testing.assert_allclose(found.doubles, expected, rtol=1e-12)
    factors = " and ".join(f"{factor:.2g}" for factor in expected if factor > 0.0)
    assert found.text.startswith(f"the amplitude doubles at {factors} times the friction")
    assert 5 <= len(asked) <= 7 and len(set(asked)) == len(asked)
    assert all(1.0 / 1.5 <= factor <= 1.5 for factor in asked)


def test_a_cliff_between_two_factors():
    """0.7 times the friction has 1.43 times the amplitude, 0.69 times doubles it, half of it has 12 times."""
    known = [0.5, 0.69, 0.7, 1.0, 4.0], [12.0, 2.0, 1.43, 1.0, 1.5]
    found = find_range(peaks_of(lambda f: float(np.interp(f, *known)))[0])
    low, high = found.limits
    assert low.outside < 0.69 < low.inside <= 0.7 and np.isnan(high.outside) and high.inside == 1.5
    # nearly as high as the cliff is close
    assert low.outside < found.doubles[0] <= 0.7 and np.isnan(found.doubles[1])
    factor = f"{low.factor:.2g}"
    assert (
        found.text
        == f"the amplitude doubles at {factor} times the friction, but not up to 1.5 times"
    )


def test_a_tolerant_preload_needs_five_peaks():
    """The study's own friction and the four factors that decide the check."""
    peak_with, asked = peaks_of(power_law(0.5, 3.0))
    assert find_range(peak_with).text == (
        "the amplitude does not double from 0.67 to 1.5 times the friction"
    )
    assert sorted(asked) == [1.0 / 1.5, 0.7, 1.0, 1.3, 1.5]


def test_no_steady_response_is_high_and_an_unknown_one_is_not():
    """An infinite amplitude and a lower bound of twice the amplitude count; nothing follows from an unknown peak."""
    ends = {"rattles": (np.inf, "not found", "no steady periodic response: why", np.nan),
            "bound": (np.nan, "incomplete", "why", 2.5), "unknown": (np.nan, "incomplete", "why", 0.5)}  # fmt: skip
    for kind, (size, *end) in ends.items():

        def amplitude(f, end=(size, *end)):
            return FrictionPeak(f, 10.0, *end) if f < 0.69 else 1.0

        found = find_range(peaks_of(amplitude)[0])
        assert found.limits[0].outside == pytest.approx(1.0 / 1.5) and found.limits[0].known == (
            kind != "unknown"
        )
        # without an amplitude at 0.67 times the friction there is nothing to interpolate
        assert np.isnan(found.limits[0].factor)
        expected = (
            "the amplitude doubles at 0.67 to 0.7 times the friction, but not up to 1.5 times"
        )
        assert (found.text == expected) == (kind != "unknown")
        np.testing.assert_equal(found.doubles[0], np.nan if kind == "unknown" else 0.7)
    assert (
        found.text
        == "the amplitude does not double from 0.7 to 1.5 times the friction; unknown at 0.67 times"
    )
    assert find_range(peaks_of(lambda f: np.nan)[0]).limits is None


def test_lower_bounds_of_earlier_files():
    """They were amplitudes with the status incomplete."""
    peak = FrictionPeak(0.7, 10.0, 2.0, "incomplete", "why")
    assert np.isnan(peak.amplitude) and peak.lower_bound == 2.0 and "at least 2 m" in str(peak)
    assert FrictionPeak(0.7, 10.0, np.inf, "not found", "why").size_text == "not steady"


def jenkins_peak(limit):
    """Peak of one mass m = k = kt = 1, c = 0.02, F = 1 by the closed form of one harmonic (tests/anchors, A1)."""

    def force(amplitude, omega):
        """Squared force that the amplitude takes."""
        theta = np.arccos(1.0 - 2.0 * limit / amplitude)
        elastic = (theta - np.sin(2.0 * theta) / 2.0) / np.pi
        friction = 4.0 * limit / (np.pi * amplitude) * (1.0 - limit / amplitude)
        in_phase = (1.0 + elastic - omega**2) * amplitude
        return in_phase**2 + (0.02 * omega * amplitude + friction * amplitude) ** 2

    def lacking(amplitude):
        """Least squared force over the frequency, less the given one."""
        least = scipy.optimize.minimize_scalar(
            lambda omega: force(amplitude, omega), bounds=(0.9, 1.5), options={"xatol": 1e-10}
        )
        return least.fun - 1.0

    # the amplitude at which the mass slips in full, and one without friction
    return scipy.optimize.brentq(lacking, 1.001 * limit, 49.0)


@pytest.mark.slow
def test_one_mass_with_a_jenkins_element():
    """The factors solve the closed form of the peak, whose values are known (1.5: 2.91810452)."""
    assert jenkins_peak(1.5) == pytest.approx(2.91810452, rel=1e-7)
    limit = 1.0
    study = bd.lumped(
        1.0, 0.02, 1.0, contacts=[bd.Contact(0, kt=1.0, mu=0.3, preload=limit / 0.3)], forces={0: 1.0},
        harmonics=1,
    )  # fmt: skip
    band = (0.14, 0.24)
    found = find_range(
        lambda f: FrictionPeak(
            f, 0.0, study.replace(friction_factor=f).peak(0.0, band, progress=False).amplitude
        )
    )
    twice = 2.0 * jenkins_peak(limit)
    factor = scipy.optimize.brentq(lambda f: jenkins_peak(f * limit) - twice, 0.6, 0.9)
    assert found.doubles[0] == pytest.approx(factor, rel=0.005) and np.isnan(found.doubles[1])


@pytest.mark.slow
def test_the_factors_belong_to_twice_the_amplitude_of_a_damper():
    """At 0.15 N it doubles with less friction, at 0.42 N with more."""
    for preload in (0.15, 0.42):

        def peak_with(factor, preload=preload):
            peak = STUDY.replace(friction_factor=factor).peak(preload, BAND, progress=False)
            return FrictionPeak(factor, preload, peak.amplitude, peak.status, peak.reason)

        sides_of_twice_the_amplitude(STUDY, preload, BAND, find_range(peak_with))


@pytest.mark.slow
def test_the_factors_lie_where_dense_peaks_double():
    """A mass pressed on another one, drawn by a seed: peaks at factors of one per cent on either side."""
    study, _ = drawn_masses(6)
    # near its best preload
    preload = 0.154
    band = tuple(study.peak(preload, progress=False).settings["frequency"])

    def amplitude(factor):
        peak = study.replace(friction_factor=factor).peak(preload, band, progress=False)
        assert peak.ok
        return peak.amplitude

    found = find_range(lambda factor: FrictionPeak(factor, preload, amplitude(factor)))
    twice = 2.0 * amplitude(1.0)
    # steps of one per cent, outward
    factors = np.geomspace(1.2, 1.5, 23)
    for printed, outward in zip(found.doubles, (1.0 / factors, factors)):
        assert amplitude(outward[0]) < twice
        outer = next(factor for factor in outward[1:] if amplitude(factor) > twice)
        # the amplitude is not quite straight within the bracket of the search
        assert printed == pytest.approx(outer, rel=0.02)


def sides_of_twice_the_amplitude(study, preload, band, found):
    """Check that peaks with 1 to 3 % less and more friction are below and above twice the amplitude."""

    def amplitude(factor):
        peak = study.replace(friction_factor=factor).peak(preload, band, progress=False)
        assert peak.ok
        return peak.amplitude

    twice = 2.0 * amplitude(1.0)
    limits = [limit for limit in found.limits if np.isfinite(limit.factor)]
    assert limits
    for limit in limits:
        # toward the friction of the study, and away from it
        nearer, farther = (limit.factor**power for power in (0.98, 1.02))
        assert amplitude(nearer) < twice < amplitude(farther), limit


@pytest.fixture(scope="module")
def curve():
    return STUDY.optimal_curve((0.5, 5.0), 6, frequency=BAND, check=False)


def with_range(curve, amplitude, remedy=np.nan):
    p = curve.recommended_preload
    known = {f: FrictionPeak(f, p, amplitude(f)) for f in (1.0, 0.7, 1.3)}
    found = replace(find_range(lambda f: FrictionPeak(f, p, amplitude(f))), remedy=remedy)
    return replace(curve, other_friction=tuple(known.values()), friction_range=found)


@each(
    ("below", "above", "colour"),
    [(0.6, 1.6, "green"), (0.68, 1.6, "red"), (0.6, 1.45, "red"), (0.2, 5.0, "green")],
)  # fmt: skip
def test_the_check(curve, below, above, colour):
    """It fails if the amplitude doubles within a factor of 1.5, also if 0.7 and 1.3 times the friction are harmless."""
    judged = with_range(curve, power_law(below, above))
    (check,) = [c for c in checks(judged) if c.name == NAME]
    assert (check.colour, check.found) == (colour, judged.friction_range.text)
    assert (check.failure in judged._headline()) == (colour == "red")
    (row,) = [row for row in judged._statement().checks if row.name == NAME]
    assert row == (
        NAME,
        {"red": "FAIL", "amber": "uncertain", "green": "pass"}[colour],
        check.found,
    )
    if colour == "red":
        remedied = said(with_range(curve, power_law(below, above), remedy=3.0))
        assert "choose 3 N, where the amplitude does not double with 0.67 and 1.5 times" in remedied


def test_unknown_within_the_spread_is_amber(curve):
    judged = with_range(curve, lambda f: np.nan if f < 0.69 else 1.0)
    (check,) = [c for c in checks(judged) if c.name == NAME]
    assert check.colour == "amber" and "unknown at 0.67 times" in said(judged)
    assert NAME not in [c.name for c in checks(replace(judged, friction_range=None))]


def test_the_remedy_is_the_nearest_tolerant_preload(monkeypatch):
    """Amplitude and friction of a given law: it doubles below a product of 1 N, from 2 N on it is flat."""
    curve = STUDY.optimal_curve([1.0, 1.2, 1.4, 1.6, 1.9, 2.5], frequency=BAND, check=False)
    limit = 1.0

    class Law(robust_optimum.SteadyPeak):
        def __call__(self, problem, preload):
            size = 1.0 if problem.settings.friction_coefficient / MU * preload >= limit else 9.0
            ending = {"search_status": "complete", "search_reason": ""}
            return {"amplitude": size, "known": True, "cost": curve.cost, **ending}

    monkeypatch.setattr(robust_optimum, "SteadyPeak", Law)
    flat = replace(
        curve,
        amplitude=np.ones(len(curve)),
        optimum=replace(curve.optimum, preload=1.2, kind="smooth"),
    )
    found = robust_optimum.with_other_friction(STUDY.problem, flat)
    nearest = min(p for p in curve.preload if p >= 1.5 * limit)
    assert found.friction_range.limits[0].near and found.friction_range.remedy == nearest
    assert f"choose {amount(nearest, 'N')}" in said(found)
    easy = robust_optimum.with_other_friction(
        STUDY.problem, replace(flat, optimum=replace(flat.optimum, preload=1.9))
    )
    assert not easy.friction_range.limits[0].near and np.isnan(easy.friction_range.remedy)


@pytest.mark.slow
def test_it_is_stored(curve, tmp_path):
    found = robust_optimum.with_other_friction(STUDY.problem, curve)
    assert isinstance(found.friction_range, FrictionRange) and found.friction_range.seconds > 0.0
    found.save(tmp_path / "found.h5")
    stored = bd.load(tmp_path / "found.h5").friction_range
    assert stored.peaks == found.friction_range.peaks and stored.text == found.friction_range.text


def test_both_ends_of_the_spread_are_tolerated():
    assert tolerates_friction(peaks_of(power_law(0.6, 1.6))[0])
    assert not tolerates_friction(peaks_of(power_law(0.7, 1.6))[0])
    assert not tolerates_friction(peaks_of(power_law(0.6, 1.4))[0])
    assert not tolerates_friction(peaks_of(lambda f: np.nan)[0])


@pytest.mark.slow
def test_peaks_at_ten_factors():
    """The typical blade: peaks at ten other factors lie on the right side of twice the amplitude."""
    study = bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip", direction="tangential"), engine_order=5,
                     friction_coefficient=0.3, harmonics=1)  # fmt: skip
    curve = study.optimal_curve((30.0, 1000.0), 12, frequency=(600.0, 720.0), check=False)
    found = robust_optimum.with_other_friction(study.problem, curve)
    low, high = found.friction_range.limits
    for factor in (0.3, 0.45, 0.5, 0.65, 0.8, 0.9, 1.2, 1.45, 2.0, 3.2):
        peak = study.replace(friction_factor=factor).peak(curve.recommended_preload, (600.0, 720.0))
        ratio = peak.amplitude / found.other_friction[0].amplitude
        assert peak.ok
        if low.inside <= factor <= high.inside:
            assert ratio <= 2.0
        elif factor <= low.outside or factor >= high.outside:
            assert ratio > 2.0
    sides_of_twice_the_amplitude(
        study, curve.recommended_preload, (600.0, 720.0), found.friction_range
    )
