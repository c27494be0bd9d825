"""Linear algebra on one thread while a curve is solved.

Matrices of some ten to some hundred rows are factorised thousands of times: threads of a BLAS then wait for each other
longer than they compute, on a busy machine many times longer.  What runs in parallel are curves
(:mod:`bdamper.analyses.sweep`). The limit holds in all threads of the process while the one that has set it first is at
work, and is taken back then.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock

from threadpoolctl import ThreadpoolController

_held = Lock()


@cache
def _controller() -> ThreadpoolController:
    """Of the libraries that are loaded; the search for them takes a millisecond."""
    return ThreadpoolController()


@contextmanager
def single_thread() -> Iterator[None]:
    """A context with one thread for linear algebra, unless another one holds it already."""
    if not _held.acquire(blocking=False):
        yield
        return
    try:
        with _controller().limit(limits=1, user_api="blas"):
            yield
    finally:
        _held.release()


one_thread = single_thread()
"""Decorator of a function that has one thread for linear algebra."""
