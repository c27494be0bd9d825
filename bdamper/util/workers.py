"""Threads for independent parts of one result.

The C core computes without the interpreter, so that threads use all cores. :func:`on_threads` is
the only place that starts threads for parts of a result: preloads in time, shorter time steps and a
more detailed structure, different friction coefficients.  All of them share the threads of the
outermost call, whose number :func:`set_workers` sets.

The calling thread computes one part after the other, and each idle thread takes the next part that
has not begun.  No part waits for a thread to become free, so that nested parts cannot block each
other, and there are never more busy threads than workers.  The result of a part does not depend on
its thread.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar, copy_context
from dataclasses import dataclass, replace
from typing import Generic, TypeVar, cast

from bdamper.util import validation
from bdamper.util.progress import add_processor_time, processor_time, stopped_by

T = TypeVar("T")

_number: ContextVar[int | None] = ContextVar("_number", default=None)
_threads: ContextVar[ThreadPoolExecutor | None] = ContextVar("_threads", default=None)


def workers() -> int:
    """Return the number of threads for one result, by default the cores that this process may use."""
    number = _number.get()
    if number is not None:
        return number
    # a container or a batch system may allow fewer cores than the machine has
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Workers:
    """Number of workers that is set, and the former one, which the end of a ``with`` block restores."""

    def __init__(self, number: int) -> None:
        self._former = _number.get()
        self._own = number
        _number.set(number)

    def __enter__(self) -> None:
        # the block may begin later than the call
        _number.set(self._own)

    def __exit__(self, *_: object) -> None:
        _number.set(self._former)


def set_workers(number: int) -> AbstractContextManager[None]:
    """Set the number of threads for each result that is computed from now on, or in a ``with`` block.

    By default, a result uses all cores that the process may use, and each point of a sweep on an
    executor uses one core.  The number of threads does not change the results.  It holds for the
    calling thread and the threads that work for it.

    Parameters
    ----------
    number : int
        Number of threads, at least 1.

    Returns
    -------
    context manager
        At the end of its block the former number is restored.

    Examples
    --------
    >>> import bdamper as bd
    >>> with bd.set_workers(1):
    ...     pass  # calls here compute on one core
    >>> _ = bd.set_workers(2)  # all later calls compute on two cores
    """
    return _Workers(validation.integer("number", number, least=1))


@contextmanager
def _shared_threads() -> Iterator[ThreadPoolExecutor | None]:
    """Yield the other threads of the outermost call; None with one worker."""
    threads, others = _threads.get(), workers() - 1
    if others == 0:
        yield None
        return
    if threads is not None:
        yield threads
        return
    with ThreadPoolExecutor(others) as threads:
        before = _threads.set(threads)
        try:
            yield threads
        finally:
            _threads.reset(before)


@dataclass(frozen=True)
class _Outcome(Generic[T]):
    """Result of a part or its error, and the processor time (s) that it took on another thread."""

    result: T | None = None
    error: Exception | None = None
    seconds: float = 0.0


def _computed(part: Callable[[], T]) -> _Outcome[T]:
    try:
        return _Outcome(part())
    except Exception as error:
        return _Outcome(error=error)


def _computed_elsewhere(part: Callable[[], T], stop: threading.Event) -> _Outcome[T]:
    """Compute a part on a thread of the pool, which ``stop`` interrupts."""
    start = processor_time()
    with stopped_by(stop):
        outcome = _computed(part)
    return replace(outcome, seconds=processor_time() - start)


def on_threads(parts: Sequence[Callable[[], T]]) -> list[T]:
    """Compute independent parts of a result on the threads of this process; return their results in order.

    Raises
    ------
    Exception
        The error of the first part that failed, after all parts have ended.
    KeyboardInterrupt
        After Ctrl-C, once the parts that were running have ended early.  A part whose result must
        be kept stores it itself.
    """
    if len(parts) < 2:
        return [part() for part in parts]
    with _shared_threads() as threads:
        # one thread also computes all parts, and a failing part changes no result
        if threads is None:
            outcomes = [_computed(part) for part in parts]
        else:
            outcomes = _outcomes(parts, threads)
    for outcome in outcomes:
        if outcome.error is not None:
            raise outcome.error
    return [cast(T, outcome.result) for outcome in outcomes]


def _outcomes(parts: Sequence[Callable[[], T]], threads: ThreadPoolExecutor) -> list[_Outcome[T]]:
    stop = threading.Event()
    # the threads take the parts in order, and the calling thread has the first one
    futures = [
        threads.submit(copy_context().run, _computed_elsewhere, part, stop) for part in parts[1:]
    ]
    try:
        outcomes = [_computed(parts[0])]
        for part, future in zip(parts[1:], futures):
            has_not_begun = future.cancel()
            outcome = _computed(part) if has_not_begun else future.result()
            add_processor_time(outcome.seconds)
            outcomes.append(outcome)
    except BaseException:
        stop.set()
        for future in futures:
            future.cancel()
        wait(futures)
        raise
    return outcomes
