"""Errors that a user can cause and can mend: messages name the item, what was expected, what was found.

Warnings of what a user should know before trusting an answer, shown at the line of the user that caused them.

Statuses: one set of words for what became of an answer.

A status is one of these words, with its reason after a colon where there is no field for it.  How a path ended that was
followed (:class:`bdamper.response.events.Path`) and whether a test agrees have words of their own; what they
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

import importlib
import inspect
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from bdamper.util.formatting import truncate

# ---- Errors that a user can cause and can mend ----


class BdamperError(Exception):
    """Base class of all errors raised on purpose by this package."""


class ModelError(BdamperError, ValueError):
    """A model, or a model file, contradicts itself or the conventions."""


class SettingError(BdamperError, ValueError):
    """A setting of a study is out of range or does not fit the model."""


class StaticError(BdamperError):
    """No static state was found under a load, so there is nothing to vibrate about."""


def mismatch(item: str, expected: str, found: object) -> ModelError:
    """An error of one line: the item, what was expected of it and what was found instead."""
    return ModelError(f"{item}: expected {' '.join(expected.split())}, found {one_line(found)}")  # arrays may wrap


def one_line(found: object) -> str:
    """Text of a value in one line of at most 300 characters."""
    return truncate(" ".join(str(found).split()), 300)


def import_extra(module: str, asked: str, extra: str) -> Any:
    """A module of an extra, or the error that names it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise BdamperError(f"{asked} needs {module.partition('.')[0]}: install the extra bdamper[{extra}]") from error


# ---- Warnings of what a user should know before trusting an answer, shown at the line of the us ----


_OURS = ("bdamper", "dataclasses", "functools", "contextlib")
_BETWEEN = ("dataclasses", "functools", "contextlib", "bdamper.harmonic_balance.result_checks", "bdamper.util.validation")
"""Modules of decorators and of copies of dataclasses."""


class BdamperWarning(UserWarning):
    """Warning about the reliability of a result."""


class PlausibilityWarning(BdamperWarning):
    """A value is possible, so it is used, but it lies outside of what machines have: a mistaken unit or digit?"""


def warn_implausible(item: str, plausible: str, found: str) -> None:
    """Warn in one line: the item, the plausible range, and what was found."""
    warn(f"{item}: plausible {plausible}, found {one_line(found)}", PlausibilityWarning)


_quiet: ContextVar[bool] = ContextVar("_quiet", default=False)


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress warnings of this package on this thread; ``warnings.catch_warnings`` acts on all threads."""
    before = _quiet.set(True)
    try:
        yield
    finally:
        _quiet.reset(before)


def called_by_user() -> bool:
    """Whether the function that asks this was called from outside of the package, decorators aside."""
    own = inspect.currentframe()
    frame = own and own.f_back and own.f_back.f_back
    while frame is not None and (module := str(frame.f_globals.get("__name__"))).startswith(_BETWEEN):
        frame = frame.f_back
    return frame is not None and (
        not module.startswith("bdamper.") or module.startswith(("bdamper.__main__", "bdamper.plot.explorer"))
    )


def warn(text: str, category: type[BdamperWarning] = BdamperWarning) -> None:
    """Warn at the line of the user, unless :func:`quiet` suppresses it."""
    if _quiet.get():
        return
    level, frame = 1, inspect.currentframe()
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] in _OURS:
        level, frame = level + 1, frame.f_back
    warnings.warn(text, category, stacklevel=level)


# ---- Statuses ----


COMPLETE, INCOMPLETE, HELD, NOT_FOUND = "complete", "incomplete", "held", "not found"
INTERRUPTED, FAILED, NOT_RUN = "interrupted", "failed", "not run"

STATUSES = (COMPLETE, INCOMPLETE, HELD, NOT_FOUND, INTERRUPTED, FAILED, NOT_RUN)


def status_word(status: str) -> str:
    """The word of a status, without its reason."""
    return status.partition(":")[0]


def with_reason(what: str, reason: object = "") -> str:
    """A status with its reason."""
    return f"{what}: {reason}" if str(reason) else what


def all_complete(statuses: Sequence[str]) -> bool:
    """Whether every one is "complete"."""
    return all(status == COMPLETE for status in statuses)


def not_run_lines(statuses: Sequence[str], what: str) -> list[str]:
    """One line of how many there are that were not run, with the reason of the first; none where all were."""
    left = [status for status in statuses if status_word(status) == NOT_RUN]
    return [f"  interrupted: {len(left)} of {len(statuses)} {what} were {left[0]}"] if left else []
