"""Statistics of a sample of bladed disks: percentiles and probabilities with confidence intervals,
and the tail.

Intervals of percentiles are distribution-free: of n independent values the number below the
percentile is binomial, so two order statistics enclose it with at least 95 %.  If values have
errors, the lower end of the interval uses their lower bounds, the upper end their upper bounds.
The interval is open if the sample is too small for an upper end.  Intervals of probabilities are
Clopper-Pearson intervals (Biometrika 26, 1934), whose coverage is at least the nominal coverage.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy  # scipy.stats is imported on first use, because it takes half a second
from numpy.typing import NDArray

from bdamper.util import validation
from bdamper.util.display import Summarised
from bdamper.util.errors import SettingError
from bdamper.util.formatting import amount, short_repr
from bdamper.util.statement import Row, Statement


class Interval(NamedTuple):
    """Estimate with its confidence interval; an end is infinite if the sample does not bound it."""

    low: float
    value: float
    high: float

    def __str__(self) -> str:
        return self.to_text("")

    def to_text(self, unit: str) -> str:
        """Return the value and the ends with four digits and the unit."""
        if np.isnan(self.value):
            return "not known"
        return f"{amount(self.value, unit, 4)} ({self.ends_text(unit)})"

    def ends_text(self, unit: str, digits: int = 4) -> str:
        """Return the ends with some digits and the unit."""
        low = amount(self.low, unit, digits)
        high = amount(self.high, unit, digits)
        has_low = np.isfinite(self.low)
        has_high = np.isfinite(self.high)
        if has_low and has_high:
            return f"{low} to {high}"
        if has_low:
            return f"at least {low}, no upper limit"
        if has_high:
            return f"at most {high}, no lower limit"
        return "no limits"


def percentile(
    values: NDArray,
    q: float,
    error: NDArray | float = 0.0,
    lower_error: NDArray | float | None = None,
) -> Interval:
    """Estimate a percentile of the distribution of independent values.

    Parameters
    ----------
    values : (n,) float
        NaN for unknown values.  The interval is valid for any values of these.
    q : float
        Percentage, between 0 and 100.
    error : (n,) float, optional
        How much higher each value may be (relative).  The interval covers all values within their
        errors.
    lower_error : (n,) float, optional
        How much lower each value may be (relative); by default as much as higher.

    Returns
    -------
    Interval
        The value is the median-unbiased estimate from the known values, within the sample; NaN
        without known values.
    """
    probability = validation.number("percentile", q, above=0.0, below=100.0) / 100.0
    known = values[np.isfinite(values)]
    if not len(known):
        return Interval(low=np.nan, value=np.nan, high=np.nan)

    def interval(moved: NDArray, unknown: float) -> Any:
        """Return the interval of values with errors, of which unknown ones are at ``unknown``."""
        moved = np.where(np.isnan(moved), unknown, moved)
        return scipy.stats.quantile_test(moved, p=probability).confidence_interval(0.95)

    if lower_error is None:
        lower_error = error
    low = float(interval(values * (1.0 - lower_error), -np.inf).low)
    high = float(interval(values * (1.0 + error), np.inf).high)
    # a sample that is too small does not bound the percentile
    if np.isnan(low):
        low = -np.inf
    if np.isnan(high):
        high = np.inf
    value = float(np.quantile(known, probability, method="median_unbiased"))
    return Interval(low=low, value=value, high=high)


def share(count: int, n: int) -> Interval:
    """Estimate a probability from ``count`` successes in ``n`` independent trials, with the
    Clopper-Pearson interval."""
    if n == 0:
        return Interval(low=0.0, value=np.nan, high=1.0)
    low, high = scipy.stats.binomtest(count, n).proportion_ci(0.95)
    return Interval(low=float(low), value=count / n, high=float(high))


@short_repr
@dataclass(frozen=True)
class WeibullTail(Summarised):
    r"""Weibull distribution of maxima with an upper bound, fitted to the upper amplification factors
    of a sample.

    .. math:: F(x) = \exp\left(-\left(\frac{b - x}{s}\right)^k\right), \quad x \le b .

    It is the limit distribution of the highest of many bounded blade amplitudes (reviewed by
    Castanier and Pierre, J. Propulsion and Power 22, 2006).  Only the number of values below the
    threshold enters, so that the body of the distribution does not distort the tail.

    Parameters
    ----------
    shape, bound, scale : float
        k, b and s by maximum likelihood; k is above 1, because below 1 the likelihood has no
        maximum.
    threshold : float
        Lowest value in the fit.
    n, n_tail : int
        Number of all values, and number of values at or above the threshold.
    distance : float
        Largest distance from the empirical distribution at or above the threshold.
    """

    shape: float
    bound: float
    scale: float
    threshold: float
    n: int
    n_tail: int
    distance: float

    def cdf(self, x: NDArray | float) -> NDArray:
        """Return the probability of a value of at most ``x``."""
        return np.asarray(scipy.stats.weibull_max.cdf(x, self.shape, self.bound, self.scale))

    def percentile(self, q: float) -> float:
        """Return a percentile of the fit, within the tail or beyond the sample.

        Raises
        ------
        SettingError
            If the percentile lies below the threshold.
        """
        probability = validation.number("percentile", q, above=0.0, below=100.0) / 100.0
        lowest = 1.0 - self.n_tail / self.n
        if probability < lowest:
            raise SettingError(
                f"percentile {100.0 * probability:g} lies below the fitted tail; give one of at "
                f"least {100.0 * lowest:g}"
            )
        law = scipy.stats.weibull_max
        return float(law.ppf(probability, self.shape, self.bound, self.scale))

    _states_all = True

    def _statement(self) -> Statement:
        limit = f"Estimated upper limit of the amplification {self.bound:.4g}"
        values = f"the highest {self.n_tail} of {self.n} disks, from {self.threshold:.4g} on"
        return Statement(
            [f"{limit}: three-parameter Weibull fit to {values}"],
            [
                Row("Shape", f"{self.shape:.3g}", "of the distance below the limit"),
                Row("Scale", f"{self.scale:.4g}", "of the distance below the limit"),
                Row(
                    "Kolmogorov-Smirnov distance",
                    f"{self.distance:.2g}",
                    "of fit and sample, in the tail",
                ),
            ],
            remarks=["Not covered: confidence interval of the limit, lower values"],
        )


def weibull_tail(values: NDArray, tail: float = 0.5) -> WeibullTail:
    """Fit a Weibull distribution to the upper values of a sample.

    Parameters
    ----------
    values : (n,) float
        NaN for unknown values, which are omitted.
    tail : float
        Fraction of the values in the tail.

    Raises
    ------
    SettingError
        If the tail has fewer than ten different values.
    """
    tail = validation.number("tail", tail, above=0.0, most=1.0)
    known = np.sort(values[np.isfinite(values)])
    n = len(known)
    # probabilities (n,) of the sorted values in the empirical distribution
    probability = (np.arange(n) + 0.5) / max(n, 1)
    x = known[n - round(tail * n) :]
    least_values = 10  # for a fit of three parameters
    if len(np.unique(x)) < least_values:
        expected = f"at least {least_values} different values in the tail"
        raise SettingError(f"tail: expected {expected}, found {len(np.unique(x))} of {n}")
    n_below = n - len(x)
    threshold = x[0]
    highest = x[-1]
    unit = highest - threshold
    law = scipy.stats.weibull_max

    def parameters(p: NDArray) -> tuple[float, float, float]:
        """Return the shape, the bound, and the most likely scale for them (in closed form).

        ``p`` (2,) are the logarithms of the shape above 1, and of the bound above the highest
        value.
        """
        log_shape, log_bound = p
        shape = 1.0 + float(np.exp(log_shape))
        bound = highest + unit * float(np.exp(log_bound))
        # powers of values relative to the width of the tail do not overflow
        width = bound - threshold
        power = np.sum(((bound - x) / width) ** shape) + n_below
        scale = width * float((power / len(x)) ** (1.0 / shape))
        return shape, bound, scale

    def negative_log_likelihood(p: NDArray) -> float:
        if np.abs(p).max() > 12.0:  # beyond these limits the likelihood does not change
            return np.inf
        shape, bound, scale = parameters(p)
        of_tail = law.logpdf(x, shape, bound, scale).sum()
        # the other values are known to lie below the threshold
        of_others = n_below * law.logcdf(threshold, shape, bound, scale)
        return -float(of_tail + of_others)

    options = {"maxiter": 4000, "xatol": 1e-6, "fatol": 1e-8}
    fits = []
    for k in (1.0, 3.0, 7.0):
        start = np.array([np.log(k), np.log(0.3 * k)])
        fit = scipy.optimize.minimize(
            negative_log_likelihood, start, method="Nelder-Mead", options=options
        )
        fits.append(fit)
    best = min(fits, key=lambda fit: fit.fun)
    shape, bound, scale = parameters(best.x)
    distance = np.abs(law.cdf(x, shape, bound, scale) - probability[n_below:]).max()
    return WeibullTail(
        shape=shape,
        bound=bound,
        scale=scale,
        threshold=float(threshold),
        n=n,
        n_tail=len(x),
        distance=float(distance),
    )
