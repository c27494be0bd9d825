"""Statuses: one set of words."""

from bdamper.util import errors
from bdamper.util.errors import WORDS, all_complete, because, left_undone, word


def test_words_are_those_of_the_docstring_and_stay_as_they_are():
    assert all(f'"{one}"' in errors.__doc__ for one in WORDS) and len(set(WORDS)) == len(WORDS)


def test_reasons():
    assert because("failed", ValueError("no")) == "failed: no" and because("complete") == "complete"
    assert word("failed: no: none") == "failed"


def test_of_several():
    assert all_complete(("complete", "complete")) and not all_complete(("complete", "incomplete"))
    assert left_undone(("complete", "not run: broken", "not run"), "points") == [
        "  interrupted: 2 of 3 points were not run: broken"
    ]
    assert left_undone(("complete", "failed: not run"), "points") == []
