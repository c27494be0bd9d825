"""Warnings of what a user should know before trusting an answer, shown at the line of the user that caused them."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from bdamper.util.errors import shortened

_OURS = ("bdamper", "dataclasses", "functools", "contextlib")
_BETWEEN = ("dataclasses", "functools", "contextlib", "bdamper.harmonic_balance.study_dispatch", "bdamper.util.validation")
"""Modules of decorators and of copies of dataclasses."""


class BdamperWarning(UserWarning):
    """Warning about the reliability of a result."""


class PlausibilityWarning(BdamperWarning):
    """A value is possible, so it is used, but it lies outside of what machines have: a mistaken unit or digit?"""


def implausible(item: str, plausible: str, found: str) -> None:
    """Warn in one line: the item, the plausible range, and what was found."""
    say(f"{item}: plausible {plausible}, found {shortened(found)}", PlausibilityWarning)


_quiet: ContextVar[bool] = ContextVar("_quiet", default=False)


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress warnings of this package on this thread; ``warnings.catch_warnings`` acts on all threads."""
    before = _quiet.set(True)
    try:
        yield
    finally:
        _quiet.reset(before)


def asked_by_user() -> bool:
    """Whether the function that asks this was called from outside of the package, decorators aside."""
    own = inspect.currentframe()
    frame = own and own.f_back and own.f_back.f_back
    while frame is not None and (module := str(frame.f_globals.get("__name__"))).startswith(_BETWEEN):
        frame = frame.f_back
    return frame is not None and (
        not module.startswith("bdamper.") or module.startswith(("bdamper.__main__", "bdamper.plot.explorer"))
    )


def say(text: str, category: type[BdamperWarning] = BdamperWarning) -> None:
    """Warn at the line of the user, unless :func:`quiet` suppresses it."""
    if _quiet.get():
        return
    level, frame = 1, inspect.currentframe()
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] in _OURS:
        level, frame = level + 1, frame.f_back
    warnings.warn(text, category, stacklevel=level)
