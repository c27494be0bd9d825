"""Percentiles, shares and tails: their intervals cover what they say, and fits find the distribution drawn from."""

import numpy as np
import pytest
from scipy.stats import weibull_max

import bdamper as bd
from bdamper.wheel.statistics import percentile, share, weibull_tail


def test_intervals_of_percentiles_cover():
    rng = np.random.default_rng(0)
    true = -np.log(1.0 - 0.9)
    found = [percentile(row, 90.0) for row in rng.exponential(size=(2000, 60))]
    covered = np.mean([low <= true <= high for low, _, high in found])
    assert 0.945 < covered < 0.99
    assert abs(np.median([one.value for one in found]) - true) < 0.03 * true


def test_what_a_sample_does_not_bound_is_open():
    found = percentile(np.arange(50.0), 99.0)
    assert found.high == np.inf and "not bounded by the sample" in str(found)
    assert np.isfinite(percentile(np.arange(1000.0), 99.0).high)
    assert np.isnan(percentile(np.array([np.nan]), 50.0).value)


def test_intervals_of_shares():
    """The rule of three, and the interval of 3 in 50 by Clopper and Pearson."""
    assert share(0, 50).low == 0.0 and np.isclose(share(0, 50).high, 1.0 - 0.025 ** (1 / 50))
    assert np.allclose(share(3, 50), [0.01255, 0.06, 0.16548], atol=1e-5)


def test_the_tail_of_a_weibull_distribution_is_found():
    values = weibull_max.rvs(3.0, 2.5, 0.8, size=4000, random_state=3)
    found = weibull_tail(values)
    assert np.isclose(found.percentile(99.0), weibull_max.ppf(0.99, 3.0, 2.5, 0.8), rtol=0.01)
    assert np.isclose(found.percentile(99.99), weibull_max.ppf(0.9999, 3.0, 2.5, 0.8), rtol=0.03)
    assert found.distance < 0.02 and found.n_tail == 2000
    # what lies below the tail does not bend it
    bent = np.where(values < np.median(values), values - 5.0, values)
    assert np.isclose(weibull_tail(bent).bound, found.bound)
    with pytest.raises(bd.SettingError, match="one of the tail, above 50"):
        found.percentile(40.0)
    with pytest.raises(bd.SettingError, match="at least 10 different values in the tail, found 5 of 10"):
        weibull_tail(np.arange(10.0))
