"""Progress of long work on the terminal or in a notebook, and what an interruption (Ctrl-C) ends."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Event
from typing import Any, TypeVar

T = TypeVar("T")

_stop: ContextVar[tuple[Event, ...]] = ContextVar("_stop", default=())
_passed_on: ContextVar[bool] = ContextVar("_passed_on", default=False)


class LongWork:
    """A context that an interruption ends quietly, so that what there is by then can be returned.

    Parts of the work do not return what they have so far as their answer (:func:`passes_interrupts_on`), and work that is
    itself such a part passes the interruption on.

    Attributes
    ----------
    interrupted : bool
        Whether the work was ended.
    """

    def __init__(self) -> None:
        self.interrupted = False

    def __enter__(self) -> LongWork:
        self.outer = _passed_on.set(True)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> bool:
        _passed_on.reset(self.outer)
        self.interrupted = kind is not None and issubclass(kind, KeyboardInterrupt)
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
    from tqdm.auto import tqdm

    with tqdm(total=total, initial=done, desc=what, unit=unit) as bar:
        yield bar.update


@contextmanager
def stages(what: str, unit: str) -> Iterator[Callable[[str, int, int], None]]:
    """A bar, as a function of the stage that the work has reached, the units done and those that there are so far."""
    from tqdm.auto import tqdm

    with tqdm(desc=what, unit=unit) as bar:

        def report(stage: str, done: int, total: int) -> None:
            bar.total = total
            bar.set_description(f"{what}: {stage}", refresh=False)
            bar.update(done - bar.n)
            bar.refresh()

        yield report


def each(items: Sequence[T], show: bool, what: str, unit: str) -> Iterable[T]:
    """The items, with a bar that counts them if it is to be shown."""
    if not show:
        return items
    from tqdm.auto import tqdm

    bar: Iterable[T] = tqdm(items, desc=what, unit=unit)
    return bar


@contextmanager
def progress_bar(show: bool, low: float, high: float) -> Iterator[Callable[[Any], None] | None]:
    """Progress over the frequency interval, or nothing."""
    if not show:
        yield None
        return
    from tqdm.auto import tqdm

    with tqdm(total=100, unit="%", desc="tracking", bar_format="{l_bar}{bar}| {n:.0f} % [{elapsed}]") as bar:

        def update(point: Any) -> None:
            bar.n = max(0.0, min(100.0, 100.0 * (point.y[-1] - low) / (high - low)))
            bar.refresh()

        yield update
