"""Linear algebra on one thread while a curve is solved.

Matrices of some ten to some hundred rows are factorised thousands of times: threads of a BLAS then wait for each other
longer than they compute, on a busy machine many times longer.  What runs in parallel are curves
(:mod:`bdamper.design.sweep`). The limit holds in all threads of the process while the one that has set it first is at
work, and is taken back then.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
T = TypeVar("T")


@cache
def _controller() -> ThreadpoolController:
    """Of the libraries that are loaded; the search for them takes a millisecond."""
    return ThreadpoolController()


def single_thread() -> AbstractContextManager[Any]:
    """A context with one thread for linear algebra."""
    limit: AbstractContextManager[Any] = _controller().limit(limits=1, user_api="blas")
    return limit


def one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """The function, with one thread for linear algebra."""

    @wraps(function)
    def limited(*args: P.args, **keywords: P.kwargs) -> T:
        with single_thread():
            return function(*args, **keywords)

    return limited
