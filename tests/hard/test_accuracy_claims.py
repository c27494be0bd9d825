"""Estimated errors on many drawn cases.

Three draws, of which the last was used for nothing else; the number of cases follows BDAMPER_HARD (at most 200 of each
draw), only a sample by default.  With BDAMPER_HARD_RESULTS, the name of a folder, results are kept there, so that a run
that was cut off goes on where it was.
"""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from tests.accuracy_cases import compare
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
    known = [c for c in found if np.isfinite(c["estimated"]).all()]
    assert len(known) >= 0.9 * len(found), [c for c in found if c not in known]
    wrong = [c for c in known if not 1.0 / 3.0 < c["effectivity"] < 3.0]
    assert len(wrong) <= 0.05 * len(known), wrong
    assert all(c["effectivity"] >= 0.1 for c in known if c["folded"])
