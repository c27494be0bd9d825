"""Statuses: one set of words for what became of an answer.

A status is one of these words, with its reason after a colon where there is no field for it.  How a path ended that was
followed (:class:`bdamper.response.continuation_options.Path`) and whether a test agrees have words of their own; what they
mean for an answer is one of these.

=================  =====================================================================================
"complete"         The answer to what was asked.
"incomplete"       A lower bound, or a part: there may be a higher one, or more of it, where the result says.
"held"             The answer of equations that were eased, with an estimate of the error.
"not found"        None, with the reason; numbers are NaN.
"interrupted"      Ctrl-C has ended the work: what was known by then.
"failed"           The work has ended with an error, which is the reason.
"not run"          The work was cut before its turn came.
=================  =====================================================================================
"""

from __future__ import annotations

from collections.abc import Sequence

COMPLETE, INCOMPLETE, HELD, NOT_FOUND = "complete", "incomplete", "held", "not found"
INTERRUPTED, FAILED, NOT_RUN = "interrupted", "failed", "not run"

WORDS = (COMPLETE, INCOMPLETE, HELD, NOT_FOUND, INTERRUPTED, FAILED, NOT_RUN)


def word(status: str) -> str:
    """The word of a status, without its reason."""
    return status.partition(":")[0]


def because(what: str, reason: object = "") -> str:
    """A status with its reason."""
    return f"{what}: {reason}" if str(reason) else what


def all_complete(statuses: Sequence[str]) -> bool:
    """Whether every one is "complete"."""
    return all(status == COMPLETE for status in statuses)


def left_undone(statuses: Sequence[str], what: str) -> list[str]:
    """One line of how many there are that were not run, with the reason of the first; none where all were."""
    left = [status for status in statuses if word(status) == NOT_RUN]
    return [f"  interrupted: {len(left)} of {len(statuses)} {what} were {left[0]}"] if left else []
