"""Statuses: one set of words."""

from bdamper.util import errors
from bdamper.util.errors import STATUSES, all_complete, not_run_lines, status_word, with_reason


def test_words_are_those_of_the_docstring_and_stay_as_they_are():
    assert all(f'"{one}"' in errors.__doc__ for one in STATUSES) and len(set(STATUSES)) == len(
        STATUSES
    )


def test_reasons():
    assert (
        with_reason("failed", ValueError("no")) == "failed: no"
        and with_reason("complete") == "complete"
    )
    assert status_word("failed: no: none") == "failed"


def test_of_several():
    assert all_complete(("complete", "complete")) and not all_complete(("complete", "incomplete"))
    assert not_run_lines(("complete", "not run: broken", "not run"), "points") == [
        "  interrupted: 2 of 3 points were not run: broken"
    ]
    assert not_run_lines(("complete", "failed: not run"), "points") == []
