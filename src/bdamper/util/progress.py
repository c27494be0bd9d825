"""Progress of long work on the terminal or in a notebook, and what an interruption (Ctrl-C) ends."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Event
from typing import Any, TypeVar

from bdamper.util.errors import shortened

T = TypeVar("T")

_stop: ContextVar[tuple[Event, ...]] = ContextVar("_stop", default=())
_passed_on: ContextVar[bool] = ContextVar("_passed_on", default=False)


class ExecutorEnded(KeyboardInterrupt):
    """An executor takes no more tasks: this ends the work in the same way as Ctrl-C."""


@contextmanager
def on_executor(refusal: type[Exception] = BrokenExecutor) -> Iterator[None]:
    """Turn errors of an executor that has ended, and its refusal of tasks, into :class:`ExecutorEnded`."""
    try:
        yield
    except (BrokenExecutor, CancelledError, refusal) as error:
        raise ExecutorEnded(shortened(error) or "its tasks were cancelled") from error


class LongWork:
    """A context that an interruption ends quietly, so that what there is by then can be returned.

    Parts of the work do not return what they have so far as their answer (:func:`passes_interrupts_on`), and work that is
    itself such a part passes the interruption on.

    Attributes
    ----------
    interrupted : bool
        Whether the work was ended.
    reason : str
        Why the executor has ended, if it has; empty after Ctrl-C.
    """

    def __init__(self) -> None:
        self.interrupted, self.reason = False, ""

    def __enter__(self) -> LongWork:
        self.outer = _passed_on.set(True)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, *_: object) -> bool:
        _passed_on.reset(self.outer)
        self.interrupted = kind is not None and issubclass(kind, KeyboardInterrupt)
        self.reason = str(error) if isinstance(error, ExecutorEnded) else ""
        return self.interrupted and not passes_interrupts_on()


def passes_interrupts_on() -> bool:
    """Whether the caller is a part of longer work, which an interruption ends (:class:`LongWork`)."""
    return _passed_on.get()


@contextmanager
def ended_by(stop: Event) -> Iterator[None]:
    """A context of a thread whose work another one ends by setting ``stop``, an interruption at the next correction."""
    before = _stop.set((*_stop.get(), stop))
    try:
        yield
    finally:
        _stop.reset(before)


def end_if_asked() -> None:
    """Raises KeyboardInterrupt where another thread has asked for it (:func:`ended_by`)."""
    if any(stop.is_set() for stop in _stop.get()):
        raise KeyboardInterrupt


@contextmanager
def counter(show: bool, total: int, done: int, what: str, unit: str) -> Iterator[Callable[[], Any]]:
    """A function that counts one more, in a bar with the time left if it is to be shown."""
    if not show:
        yield lambda: None
        return
    with _bar(total=total, initial=done, desc=what, unit=unit) as bar:
        yield bar.update


@contextmanager
def stages(what: str, unit: str) -> Iterator[Callable[[str, int, int], None]]:
    """A bar, as a function of the stage that the work has reached, the units done and those that there are so far."""
    with _bar(desc=what, unit=unit) as bar:

        def report(stage: str, done: int, total: int) -> None:
            bar.total = max(total, bar.total or 0)
            bar.set_description(f"{what}: {stage}" if stage else what, refresh=False)
            bar.update(max(done - bar.n, 0))

        yield report


def each(items: Sequence[T], show: bool, what: str, unit: str) -> Iterable[T]:
    """The items, with a bar that counts them if it is to be shown."""
    if not show:
        return items
    bar: Iterable[T] = _bar(items, desc=what, unit=unit)
    return bar


@contextmanager
def progress_bar(show: bool, low: float, high: float) -> Iterator[Callable[[Any], None] | None]:
    """Progress over the frequency interval, or nothing; a path that turns back does not take the bar back."""
    if not show:
        yield None
        return
    with stages("tracking", "%") as report:
        yield lambda point: report("", int(min(100.0, 100.0 * (point.y[-1] - low) / (high - low))), 100)


def _bar(*items: Any, **given: Any) -> Any:
    """A bar; where standard error is no terminal, one line at each tenth of what there is to do."""
    from tqdm.auto import tqdm

    if sys.stderr.isatty() or "ipykernel.kernelapp" in sys.modules:
        return tqdm(*items, **given)

    class Lines(tqdm):  # type: ignore[misc]
        told = 0

        def display(self, msg: str | None = None, pos: int | None = None) -> None:
            tenth = int(10.0 * self.n / self.total + 1e-9) if self.total else 0
            if tenth > self.told:
                self.told = tenth
                self.fp.write(f"{self.desc}{': ' * (not self.desc.endswith(': '))}{10 * tenth} %\n")

    return Lines(*items, **given, mininterval=0.0, miniters=1, leave=False)
