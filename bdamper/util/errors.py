"""Errors, warnings and statuses.

A status is one of the words below; its reason is another text (:class:`WithStatus`).

* "complete": the result contains everything that was requested.
* "incomplete": the result is partial or a lower bound; there may be further solutions or a higher
  amplitude.
* "held": the equations were relaxed; the result contains an estimate of the error.
* "not found": there is no solution, for the given reason; numbers are NaN.
* "interrupted": Ctrl-C ended the computation; the result contains everything computed so far.
* "failed": an error ended the computation; the reason is its message.
* "not run": the computation ended before this part began.

The end of a followed path has a status of its type (:class:`bdamper.response.events.Path`).
"""

from __future__ import annotations

import importlib
import inspect
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING, Any

from bdamper.util.formatting import truncate

# ---- Errors ----


class BdamperError(Exception):
    """Base class of all errors that this package raises on purpose."""


class ModelError(BdamperError, ValueError):
    """Model or model file that is inconsistent or violates the conventions."""


class SettingError(BdamperError, ValueError):
    """Setting that is out of range or does not fit the model."""


class TooLittleMemory(BdamperError, MemoryError):
    """Computation that needs more memory than is available."""


class StaticError(BdamperError):
    """No static equilibrium was found under a load."""


FAILURES_AT_ONE_PRELOAD = (BdamperError, ArithmeticError, ValueError, MemoryError)
"""Errors of a computation that fails at one preload, for example by overflow; they do not end a
search over preloads.

ValueError is what SciPy raises for matrices with infinite entries; LinAlgError and SettingError are
ValueErrors too.
"""


def mismatch(item: str, expected: str, found: object) -> ModelError:
    """Return a ModelError "item: expected ..., found ..." in one line."""
    # the text of an array can contain line breaks
    return ModelError(f"{item}: expected {' '.join(expected.split())}, found {one_line(found)}")


def too_little_memory(item: str, error: Exception) -> TooLittleMemory:
    """Return the error for an item that needs more memory; MemoryError itself often has no text."""
    found = f" ({one_line(error)})" if str(error) else ""
    remedy = "close other programs or reduce the model"
    return TooLittleMemory(f"{item}: expected enough memory, found too little{found}; {remedy}")


def check(good: object, item: str, expected: str, found: object) -> None:
    """Raise the error of :func:`mismatch` unless a condition holds."""
    if not good:
        raise mismatch(item, expected, found)


def check_sentence(good: object, item: str, sentence: str) -> None:
    """Raise a ModelError "item: sentence" unless a condition holds.

    A sentence is suitable for data that are missing, not allowed or cannot be combined.
    """
    if not good:
        raise ModelError(f"{item}: {one_line(sentence)}")


def one_line(found: object) -> str:
    """Return the text of a value in one line of at most 300 characters."""
    return truncate(" ".join(str(found).split()), 300)


def import_extra(module: str, asked: str, extra: str) -> Any:
    """Import a module of an optional dependency.

    Parameters
    ----------
    module : str
    asked : str
        Function that needs the module, for the error.
    extra : str
        Name of the extra of bdamper that installs it.

    Raises
    ------
    BdamperError
        If the module is not installed; the error gives the extra.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        remedy = f"install the extra bdamper[{extra}]"
        raise BdamperError(f"{asked} needs {package}: {remedy}") from error


# ---- Warnings ----


_OURS = ("bdamper", "dataclasses", "functools", "contextlib")


class BdamperWarning(UserWarning):
    """Warning about the reliability of a result."""


class PlausibilityWarning(BdamperWarning):
    """Warning about an allowed value outside the range of real machines."""


def warn_implausible(item: str, plausible: str, found: str) -> None:
    """Warn in one line about an implausible value: item, plausible range and value."""
    warn(f"{item}: plausible {plausible}, found {one_line(found)}", PlausibilityWarning)


_quiet: ContextVar[bool] = ContextVar("_quiet", default=False)


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress warnings of this package on the current thread.

    ``warnings.catch_warnings`` acts on all threads.
    """
    before = _quiet.set(True)
    try:
        yield
    finally:
        _quiet.reset(before)


# Number of checked functions of the package that are running on this thread.
_depth: ContextVar[int] = ContextVar("_depth", default=0)


@contextmanager
def inside_package() -> Iterator[int]:
    """Mark a block of code as run by the package.

    Yield the number of enclosing marks, 0 for a call by the user.
    """
    enclosing = _depth.get()
    token = _depth.set(enclosing + 1)
    try:
        yield enclosing
    finally:
        _depth.reset(token)


@contextmanager
def inside_user_code() -> Iterator[None]:
    """Mark a user-defined function that the package runs; its calls count as calls by the user."""
    token = _depth.set(0)
    try:
        yield
    finally:
        _depth.reset(token)


def called_by_user() -> bool:
    """Return whether no checked function other than the calling one is running."""
    return _depth.get() <= 1


def warn(text: str, category: type[BdamperWarning] = BdamperWarning) -> None:
    """Warn with the line of the user's code as the location, unless :func:`quiet` suppresses the
    warning.
    """
    if _quiet.get():
        return
    level = 1
    frame = inspect.currentframe()
    while frame is not None and _is_ours(frame):
        level += 1
        frame = frame.f_back
    warnings.warn(text, category, stacklevel=level)


def _is_ours(frame: FrameType) -> bool:
    """Return whether a frame runs code of this package or of a module that wraps its functions."""
    module: str = frame.f_globals.get("__name__", "")
    return module.split(".")[0] in _OURS


# ---- Statuses ----


COMPLETE = "complete"
INCOMPLETE = "incomplete"
HELD = "held"
NOT_FOUND = "not found"
INTERRUPTED = "interrupted"
FAILED = "failed"
NOT_RUN = "not run"

STATUSES = (COMPLETE, INCOMPLETE, HELD, NOT_FOUND, INTERRUPTED, FAILED, NOT_RUN)


def with_reason(status: str, reason: object = "") -> str:
    """Return a status and its reason as one text to print; without a reason, the status itself."""
    return f"{status}: {reason}" if str(reason) else status


class WithStatus:
    """Mixin of dataclasses with a status, one of :data:`STATUSES`, and the reason for it.

    The status is "complete" unless the class has fields or properties of these names.
    """

    if TYPE_CHECKING:
        # read-only, so that a class may have fields or properties

        @property
        def status(self) -> str: ...
        @property
        def reason(self) -> str: ...

    else:
        status = COMPLETE
        reason = ""

    @property
    def ok(self) -> bool:
        """Whether the status is "complete"."""
        return self.status == COMPLETE

    @property
    def status_text(self) -> str:
        """Status, followed by a colon and the reason if there is one."""
        return with_reason(self.status, self.reason)


class WithRowStatus:
    """Mixin of dataclasses whose rows have a status, one of :data:`STATUSES`, and a reason for it.

    Without ``reason``, no row has one.
    """

    status: tuple[str, ...]
    reason: tuple[str, ...]

    def __post_init__(self) -> None:
        if not self.reason:
            object.__setattr__(self, "reason", ("",) * len(self.status))

    @property
    def status_text(self) -> tuple[str, ...]:
        """Status of each row, followed by a colon and the reason if there is one."""
        return tuple(map(with_reason, self.status, self.reason))


def separated(text: str) -> tuple[str, str]:
    """Separate a joined text into status and reason; files of earlier versions contain such texts."""
    status, _, reason = text.partition(": ")
    return status, reason


@dataclass(frozen=True)
class Ending(WithStatus):
    """Status with which a computation ended, and the reason for it.

    Parameters
    ----------
    status : str
        One of :data:`STATUSES`.
    reason : str
        "" if there is none.
    """

    status: str = COMPLETE
    reason: str = ""


def all_complete(statuses: Sequence[str]) -> bool:
    """Return whether every status is "complete"."""
    return all(status == COMPLETE for status in statuses)


def not_run_lines(statuses: Sequence[str], reasons: Sequence[str], what: str) -> list[str]:
    """Return a line with the number of parts that were not run and the first reason.

    The list is empty if all parts ran.
    """
    if NOT_RUN not in statuses:
        return []
    first = with_reason(NOT_RUN, reasons[statuses.index(NOT_RUN)])
    n_not_run = sum(status == NOT_RUN for status in statuses)
    return [f"  interrupted: {n_not_run} of {len(statuses)} {what} were {first}"]
