"""Estimated errors and settings chosen by tolerance on many drawn cases.

Two draws each; the numbers of cases follow BDAMPER_HARD (at most 200 and 50 of each draw), only a sample by default.
"""

import os

import numpy as np
import pytest

from tests.accuracy_cases import compare, try_tolerance

FULL = int(os.environ.get("BDAMPER_HARD", "0"))


def cases(of, first, wanted):
    """The first cases from a number on that have something to compare."""
    out = []
    for number in range(first, first + 4 * wanted):
        found = of(number)
        if found is not None:
            out.append(found)
        if len(out) == wanted:
            break
    return out


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 1000])
def test_effectivity_of_estimates(first):
    wanted = min(FULL, 200) or 8
    found = cases(compare, first, wanted)
    assert len(found) == wanted
    e = np.array([c.effectivity for c in found])
    good = (e > 0.3) & (e < 3.0)
    assert good.mean() >= 0.95 if FULL else good.sum() >= len(e) - 1, [c for c, g in zip(found, good) if not g]
    assert all(c.effectivity >= 0.1 for c in found if c.folded)


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 500])
def test_tolerance_is_met_at_little_cost(first):
    wanted = min(FULL, 50) or 5
    found = cases(try_tolerance, first, wanted)
    assert len(found) == wanted
    met = np.array([t.error <= t.tolerance for t in found])
    cheap = np.array([t.ratio <= 3.0 for t in found])
    for good in (met, cheap):
        assert good.mean() >= 0.95 if FULL else good.sum() >= len(good) - 1, [t for t, g in zip(found, good) if not g]
