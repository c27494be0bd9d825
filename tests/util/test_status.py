"""Statuses: one set of words, into which those of earlier versions are read."""

import pytest

from bdamper.util import status
from bdamper.util.status import WORDS, Translated, all_complete, because, current, left_undone, word


def test_words_are_those_of_the_docstring_and_stay_as_they_are():
    assert all(f'"{one}"' in status.__doc__ for one in WORDS) and len(set(WORDS)) == len(WORDS)
    assert [current(one) for one in WORDS] == list(WORDS) and set(status.BEFORE.values()) <= set(WORDS)


@pytest.mark.parametrize(
    ("before", "now"),
    [
        ("converged", "complete"),
        ("done", "complete"),
        ("scanned", "complete"),
        ("verified", "complete"),
        ("not verified: another peak is higher there", "incomplete: another peak is higher there"),
        ("lower bound", "incomplete"),
        ("no start", "not found"),
        ("failed: done: 3", "failed: done: 3"),
        ("not run: broken", "not run: broken"),
        ("singular equations: no step", "not found: singular equations: no step"),
    ],
)
def test_words_of_earlier_versions(before, now):
    assert current(before) == now


def test_reasons():
    assert because("failed", ValueError("no")) == "failed: no" and because("complete") == "complete"
    assert word("failed: no: none") == "failed"
    assert current("not asked", "") == "not asked" and current("odd", "incomplete") == "incomplete: odd"


def test_of_several():
    assert Translated().read(("done", "odd")) == ("complete", "not found: odd") and Translated().read("done") == "complete"
    assert all_complete(("complete", "complete")) and not all_complete(("complete", "incomplete"))
    assert left_undone(("complete", "not run: broken", "not run"), "points") == [
        "  interrupted: 2 of 3 points were not run: broken"
    ]
    assert left_undone(("complete", "failed: not run"), "points") == []
