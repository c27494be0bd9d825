"""Percentiles, shares and tails: their intervals cover what they say, and fits find the distribution drawn from."""

import numpy as np
import pytest
from scipy.stats import weibull_max

import bdamper as bd
from bdamper.mistuning.sample import BestPreload
from bdamper.mistuning.statistics import Interval, percentile, share, weibull_tail
from tests.printed import said


@pytest.mark.slow
def test_intervals_of_percentiles_cover():
    rng = np.random.default_rng(0)
    true = -np.log(1.0 - 0.9)
    found = [percentile(row, 90.0) for row in rng.exponential(size=(2000, 60))]
    covered = np.mean([low <= true <= high for low, _, high in found])
    assert 0.945 < covered < 0.99
    assert abs(np.median([one.value for one in found]) - true) < 0.03 * true


@pytest.mark.slow
def test_intervals_hold_wherever_unknown_values_lie():
    """A twentieth of the values is not known, always the highest or always the lowest: what a failing search may do."""
    rng = np.random.default_rng(1)
    for kept in (slice(0, 190), slice(10, 200)):
        covered = []
        for row in np.sort(rng.exponential(size=(500, 200)), axis=1):
            unknown = np.full(200, np.nan)
            unknown[kept] = row[kept]
            low, _, high = percentile(rng.permutation(unknown), 80.0)
            covered.append(low <= -np.log(0.2) <= high)
        assert np.mean(covered) > 0.95
    known = np.arange(100.0)
    assert percentile(known, 50.0)[::2] == (39.0, 60.0)
    assert percentile(np.append(known[:80], np.full(20, np.nan)), 50.0)[::2] == (19.0, 60.0)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.slow
def test_intervals_hold_wherever_values_lie_within_their_errors(side):
    """What is found is off by its error, all of it to one side: the interval of what is found alone covers nothing."""
    rng = np.random.default_rng(2)
    true, covered = -np.log(1.0 - 0.9), []
    for row in rng.exponential(size=(500, 200)):
        error = rng.uniform(0.3, 0.5, 200)
        found = row / (1.0 + side * error)
        covered.append(
            [
                low <= true <= high
                for low, _, high in (percentile(found, 90.0, e) for e in (error, 0.0))
            ]
        )
    with_errors, without = np.mean(covered, axis=0)
    assert 0.945 < with_errors < 0.99 and without < 0.6
    assert percentile(found, 90.0, error).value == percentile(found, 90.0).value
    unknown = np.where(
        np.arange(200) < 15, np.nan, error
    )  # errors that are not known leave the interval open
    assert percentile(found, 95.0, unknown).high == np.inf and np.isfinite(
        percentile(found, 95.0, error).high
    )


@pytest.mark.slow
def test_intervals_hold_for_values_that_are_only_too_low():
    """Missed peaks are higher than what was found: the lower end needs no error, and is exact."""
    rng = np.random.default_rng(3)
    true, covered = -np.log(1.0 - 0.9), []
    for row in rng.exponential(size=(500, 200)):
        error = np.where(rng.random(200) < 0.3, 0.2, 0.0)
        found = row / (1.0 + error * rng.random(200))
        low, _, high = percentile(found, 90.0, 0.2, lower_error=0.0)
        covered.append(low <= true <= high)
        assert low == percentile(found, 90.0).low and high == percentile(found, 90.0, 0.2).high
    assert np.mean(covered) > 0.945


def test_what_a_sample_does_not_bound_is_open():
    found = percentile(np.arange(50.0), 99.0)
    assert found.high == np.inf and "(at least " in str(found)
    assert np.isfinite(percentile(np.arange(1000.0), 99.0).high)
    assert np.isnan(percentile(np.array([np.nan]), 50.0).value)


def test_intervals_of_shares():
    """The rule of three, and the interval of 3 in 50 by Clopper and Pearson."""
    assert share(0, 50).low == 0.0 and np.isclose(share(0, 50).high, 1.0 - 0.025 ** (1 / 50))
    assert np.allclose(share(3, 50), [0.01255, 0.06, 0.16548], atol=1e-5)


@pytest.mark.slow
def test_a_tail_at_the_quantiles_of_a_weibull_distribution_is_that_distribution():
    """At the least shape, 1, bound and scale have a closed form: the highest value, and its distance to the mean."""
    values = weibull_max.ppf((np.arange(3000) + 0.5) / 3000, 3.0, 2.5, 0.8)
    for tail in (1.0, 0.5):
        found = weibull_tail(values, tail)
        assert (
            np.allclose([found.shape, found.bound, found.scale], [3.0, 2.5, 0.8], rtol=0.02)
            and found.distance < 1e-3
        )
    sharp = weibull_max.ppf((np.arange(3000) + 0.5) / 3000, 1.0, 2.5, 0.8)
    found = weibull_tail(sharp, 1.0)
    assert 1.0 < found.shape < 1.01 and np.isclose(found.bound, sharp.max(), rtol=1e-3)
    assert np.isclose(found.scale, found.bound - sharp.mean(), rtol=5e-3)


def test_the_tail_of_a_weibull_distribution_is_found():
    values = weibull_max.rvs(3.0, 2.5, 0.8, size=4000, random_state=3)
    found = weibull_tail(values)
    assert np.isclose(found.percentile(99.0), weibull_max.ppf(0.99, 3.0, 2.5, 0.8), rtol=0.01)
    assert np.isclose(found.percentile(99.99), weibull_max.ppf(0.9999, 3.0, 2.5, 0.8), rtol=0.03)
    assert found.distance < 0.02 and found.n_tail == 2000
    # at the likeliest scale s^k is a mean of (b - x)^k, in which all below the tail count as at its end
    tail, k, b = np.sort(values)[2000:], found.shape, found.bound
    power = (((b - tail) ** k).sum() + 2000 * (b - found.threshold) ** k) / 2000
    assert np.isclose(found.scale**k, power, rtol=1e-10)

    # and shape and bound leave the likelihood flat
    def likelihood(k, b, s):
        return weibull_max.logpdf(tail, k, b, s).sum() + 2000 * weibull_max.logcdf(
            found.threshold, k, b, s
        )

    top = likelihood(k, b, found.scale)
    for change in np.eye(3) * 1e-3:
        pair = [
            likelihood(*(np.array([k, b, found.scale]) * (1.0 + sign * change)))
            for sign in (-1.0, 1.0)
        ]
        assert max(pair) < top and abs(pair[1] - pair[0]) < 0.02 * abs(sum(pair) - 2.0 * top)
    # values below the tail do not change the fit
    bent = np.where(values < np.median(values), values - 5.0, values)
    assert np.isclose(weibull_tail(bent).bound, found.bound)
    with pytest.raises(
        bd.SettingError, match="percentile 40 lies below the fitted tail; give one of at least 50"
    ):
        found.percentile(40.0)
    with pytest.raises(
        bd.SettingError, match="at least 10 different values in the tail, found 5 of 10"
    ):
        weibull_tail(np.arange(10.0))


def test_every_number_of_a_best_preload_has_its_unit():
    assert Interval(np.nan, np.nan, np.nan).to_text("m") == "not known"
    best = BestPreload(
        90.0,
        0.03,
        1230.0,
        Interval(7.1e-4, 7.5e-4, np.inf),
        987.6,
        1543.0,
        "interior",
        950.0,
        6.9e-4,
        40,
    )
    preload = "Best preload for the 90th percentile 1.23 kN (987.6 N to 1.543 kN): 40 bladed disks"
    assert said(best).strip().startswith(preload)
    amplitude = "Amplitude 750 µm 90th percentile of the disks; 95 % confidence: at least 710 µm"
    assert f"{amplitude}, no upper limit" in said(best)
    assert "Tuned disk 690 µm lowest of the same preloads, at 950 N" in said(best)
