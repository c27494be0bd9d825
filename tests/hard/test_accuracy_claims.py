"""Estimated errors and settings chosen by tolerance on many drawn cases.

Three draws each, of which the last was used for nothing else; the numbers of cases follow BDAMPER_HARD (at most 200 of
each draw for estimates, 50 of the first and 100 of the others for tolerances), only a sample by default.  With
BDAMPER_HARD_RESULTS, the name of a folder, results are kept there, so that a run that was cut off goes on where it was;
times are in them too, but nothing here depends on them.
"""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from tests.accuracy_cases import compare, try_tolerance
from tests.effect_cases import found as found_in

FULL = int(os.environ.get("BDAMPER_HARD", "0"))
RESULTS = os.environ.get("BDAMPER_HARD_RESULTS", "")


def effectivity(number):
    """What the estimate of a case is worth; None where there is nothing to compare."""
    c = compare(number)
    if c is None:
        return None
    return {
        "effectivity": c.effectivity, "folded": c.folded, "source": c.source, "text": c.text, "estimated": c.estimated,
        "true": c.true,
    }  # fmt: skip


def tolerance(number):
    """How well a tolerance is met and at what cost; None where there is no peak."""
    t = try_tolerance(number)
    if t is None:
        return None
    return {
        "error": t.error, "tolerance": t.tolerance, "ratio": t.ratio, "time_ratio": t.time_ratio,
        "lasting_ratio": t.lasting_ratio, "chosen": t.chosen, "series": t.series, "lasting": t.lasting, "curves": t.curves,
        "seconds": t.cheapest_seconds,
    }  # fmt: skip


def cases(of, first, wanted):
    """The first cases from a number on that have something to compare."""
    path = Path(RESULTS or ".") / f"{of.__name__}-{first}.jsonl"
    known = {row["number"]: row for row in found_in(str(path))} if RESULTS else {}
    out = []
    for number in range(first, first + 4 * wanted):
        if number not in known:
            known[number] = {"number": number, **(of(number) or {})}
            if RESULTS:
                with path.open("a") as file:
                    file.write(json.dumps(known[number]) + "\n")
        if len(known[number]) > 1:
            out.append(known[number])
        if len(out) == wanted:
            break
    assert len(out) == wanted
    return out


@pytest.mark.slow
@pytest.mark.parametrize(("first", "sample"), [(0, 0), (2000, 2003), (5000, 5003)])
def test_effectivity_of_estimates(first, sample):
    found = cases(effectivity, first if FULL else sample, min(FULL, 200) or 4)
    e = np.array([c["effectivity"] for c in found])
    good = (e > 0.3) & (e < 3.0)
    assert good.mean() >= 0.95 if FULL else good.all(), [c for c, g in zip(found, good) if not g]
    assert all(c["effectivity"] >= 0.1 for c in found if c["folded"])


@pytest.mark.slow
@pytest.mark.parametrize(("first", "most"), [(0, 50), (1000, 100), (8000, 100)])
def test_tolerance_is_met_at_little_cost(first, most):
    """Cost is counted work (:class:`bdamper.util.cost.Cost`), against that of the cheapest series that will do.

    What it is against the cheapest that does so by no coincidence, and in measured time, is printed only.
    """
    found = cases(tolerance, first, min(FULL, most) or 3)
    print(f"tolerance met in {sum(c['error'] <= c['tolerance'] for c in found)} of {len(found)}")
    for name in ("ratio", "lasting_ratio", "time_ratio"):
        values = np.array([c[name] for c in found])
        middle, high = np.percentile(values, [50, 95])
        above = int((values > 3.0).sum())
        print(f"{name}: median {middle:.2f}, 95 % {high:.2f}, largest {values.max():.2f}, above 3 in {above}")
    for good in ([c["error"] <= c["tolerance"] for c in found], [c["ratio"] <= 3.0 for c in found]):
        assert np.mean(good) >= 0.95 if FULL else all(good), [c for c, g in zip(found, good) if not g]
