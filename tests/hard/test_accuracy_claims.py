"""Estimated errors and settings chosen by tolerance on many drawn cases.

The number of cases follows BDAMPER_HARD (at most 200); only a sample by default.
"""

import os

import numpy as np
import pytest

from tests.accuracy_cases import compare, try_tolerance

FULL = int(os.environ.get("BDAMPER_HARD", "0"))


def cases(of, wanted):
    """The first cases that have something to compare."""
    out = []
    for number in range(200, 200 + 4 * wanted):
        found = of(number)
        if found is not None:
            out.append(found)
        if len(out) == wanted:
            break
    return out


@pytest.mark.slow
def test_effectivity_of_estimates():
    found = cases(compare, min(FULL, 200) or 12)
    e = np.array([c.effectivity for c in found])
    assert len(e) >= min(FULL, 200) // 2
    good = (e > 0.3) & (e < 3.0)
    assert good.mean() >= 0.95 if FULL else good.sum() >= len(e) - 1, [c for c, g in zip(found, good) if not g]
    assert all(c.effectivity >= 0.1 for c in found if c.folded)


@pytest.mark.slow
def test_tolerance_is_met():
    found = cases(try_tolerance, min(FULL, 100) or 8)
    met = np.array([t.error <= t.tolerance for t in found])
    assert met.mean() >= 0.95 if FULL else met.sum() >= len(met) - 1, [t for t, m in zip(found, met) if not m]
