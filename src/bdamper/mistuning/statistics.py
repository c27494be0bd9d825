"""Statistics of a sample of wheels: percentiles and shares with confidence intervals, and the tail of a distribution.

Intervals of percentiles are those of order statistics, which assume nothing of the distribution: of n independent values
the number below the percentile is binomial, so that two of the sorted values enclose it with at least 95 %.  Values with
errors of their own are sorted at the lower ends of these for the lower one, at the upper ends for the upper one.  Where the
sample is too small for an upper end, the interval is open.  Intervals of shares are those of Clopper and Pearson
(Biometrika 26, 1934), which cover with at least their confidence.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy  # scipy.stats is loaded where it is used: half a second
from numpy.typing import NDArray

from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.formatting import amount, short_repr


class Interval(NamedTuple):
    """An estimate between the ends of its confidence interval; ends are infinite where the sample does not bound it."""

    low: float
    value: float
    high: float

    def __str__(self) -> str:
        return self.to_text("")

    def to_text(self, unit: str) -> str:
        """Value and ends in four digits, each with the unit."""
        low, high = (amount(x, unit, 4) if np.isfinite(x) else "not bounded by the sample" for x in (self.low, self.high))
        return f"{amount(self.value, unit, 4)} ({low} to {high})"


def percentile(values: NDArray, q: float, error: NDArray | float = 0.0) -> Interval:
    """A percentile of the distribution that independent values are drawn from.

    Parameters
    ----------
    values : (n,) float
        NaN where it is not known: those may lie anywhere, and the interval holds wherever they do.
    q : float
        Between 0 and 100.
    error : (n,) float, optional
        Relative error of each value, either way; the interval holds wherever within it the value lies.

    Returns
    -------
    Interval
        The value is the median-unbiased estimate of those that are known, within the sample; NaN without values.
    """
    q = validation.number("percentile", q, above=0.0, below=100.0) / 100.0
    known = values[np.isfinite(values)]
    if not len(known):
        return Interval(np.nan, np.nan, np.nan)

    def bounds(side: float) -> Any:
        """Interval where all values lie at the same end of their errors, and those not known beyond all others."""
        moved = values * (1.0 + side * error)
        return scipy.stats.quantile_test(np.where(np.isnan(moved), side * np.inf, moved), p=q).confidence_interval(0.95)

    low, high = bounds(-1.0).low, bounds(1.0).high
    value = float(np.quantile(known, q, method="median_unbiased"))
    return Interval(-np.inf if np.isnan(low) else float(low), value, np.inf if np.isnan(high) else float(high))


def share(count: int, n: int) -> Interval:
    """A probability of which ``count`` of ``n`` independent trials came true, with the interval of Clopper and Pearson."""
    if n == 0:
        return Interval(0.0, np.nan, 1.0)
    low, high = scipy.stats.binomtest(count, n).proportion_ci(0.95)
    return Interval(float(low), count / n, float(high))


@short_repr
@dataclass(frozen=True)
class WeibullTail:
    r"""A Weibull distribution of maxima, bounded above, fitted to the upper values of a sample.

    .. math:: F(x) = \exp\left(-\left(\frac{b - x}{s}\right)^k\right), \quad x \le b .

    The highest of many blades whose amplitudes are bounded tends to it (reviewed by Castanier and Pierre, J. Propulsion and
    Power 22, 2006).  Values below the threshold count by their number alone, so that the body of the distribution does not
    bend its tail.

    Parameters
    ----------
    shape, bound, scale : float
        k, b and s by maximum likelihood; k above 1, since below the likelihood has no maximum.
    threshold : float
        Lowest value that the fit has seen.
    n, n_tail : int
        Values in all, and from the threshold on.
    distance : float
        Largest distance between the distribution and the empirical one from the threshold on.
    """

    shape: float
    bound: float
    scale: float
    threshold: float
    n: int
    n_tail: int
    distance: float

    def cdf(self, x: NDArray | float) -> NDArray:
        """Probability of a value of at most ``x``."""
        return np.asarray(scipy.stats.weibull_max.cdf(x, self.shape, self.bound, self.scale))

    def percentile(self, q: float) -> float:
        """A percentile of the fit, within the tail or beyond the sample.

        Raises
        ------
        SettingError
            Below the threshold, of which the fit knows nothing.
        """
        q = validation.number("percentile", q, above=0.0, below=100.0) / 100.0
        if q < 1.0 - self.n_tail / self.n:
            raise SettingError(f"percentile: expected one of the tail, above {100.0 * (1.0 - self.n_tail / self.n):g}")
        return float(scipy.stats.weibull_max.ppf(q, self.shape, self.bound, self.scale))

    def __str__(self) -> str:
        return (
            f"Weibull tail from {self.threshold:.4g} on ({self.n_tail} of {self.n} values): shape {self.shape:.3g}, bound "
            f"{self.bound:.4g}, largest distance from the empirical distribution {self.distance:.2g}"
        )


def weibull_tail(values: NDArray, tail: float = 0.5) -> WeibullTail:
    """Fit of the upper values of a sample.

    Parameters
    ----------
    values : (n,) float
        Those that are not known (NaN) are left out.
    tail : float
        Share of the values that count as the tail.

    Raises
    ------
    SettingError
        If the tail has fewer than ten different values.
    """
    tail = validation.number("tail", tail, above=0.0, most=1.0)
    known = np.sort(values[np.isfinite(values)])
    n = len(known)
    probability = (np.arange(n) + 0.5) / max(n, 1)
    x = known[n - round(tail * n) :]
    fewest_in_tail = 10  # values that a fit of three parameters needs at least
    if len(np.unique(x)) < fewest_in_tail:
        expected = f"at least {fewest_in_tail} different values in the tail"
        raise SettingError(f"tail: expected {expected}, found {len(np.unique(x))} of {n}")
    below, low, top = n - len(x), x[0], x[-1]
    unit, law = top - low, scipy.stats.weibull_max

    def parameters(p: NDArray) -> tuple[float, float, float]:
        """Shape, bound, and the scale that is most likely with them, in closed form."""
        k, b = 1.0 + float(np.exp(p[0])), top + unit * float(np.exp(p[1]))
        farthest = b - low  # of the tail; powers relative to it
        power = np.sum(((b - x) / farthest) ** k) + below
        return k, b, farthest * float((power / len(x)) ** (1.0 / k))

    def misfit(p: NDArray) -> float:
        if np.abs(p).max() > 12.0:  # there is nothing more to tell
            return np.inf
        k, b, s = parameters(p)
        return -float(law.logpdf(x, k, b, s).sum() + below * law.logcdf(low, k, b, s))

    starts = [np.array([np.log(k), np.log(0.3 * k)]) for k in (1.0, 3.0, 7.0)]
    fine = {"maxiter": 4000, "xatol": 1e-6, "fatol": 1e-8}
    found = [scipy.optimize.minimize(misfit, p, method="Nelder-Mead", options=fine) for p in starts]
    k, b, s = parameters(min(found, key=lambda one: one.fun).x)
    distance = np.abs(law.cdf(x, k, b, s) - probability[below:]).max()
    return WeibullTail(k, b, s, float(low), n, len(x), float(distance))
