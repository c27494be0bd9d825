"""Parts of a problem, made when they are first asked for and kept beside its settings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar, overload

T = TypeVar("T")


class part(Generic[T]):
    """A property that is made once and stands in ``parts`` of its problem, from which other problems may be given it."""

    def __init__(self, make: Callable[[Any], T]) -> None:
        self.make, self.name, self.__doc__ = make, make.__name__, make.__doc__

    @overload
    def __get__(self, problem: None, owner: type) -> Self: ...
    @overload
    def __get__(self, problem: Any, owner: type) -> T: ...
    def __get__(self, problem: Any, owner: type) -> Self | T:
        if problem is None:
            return self
        if self.name not in problem.parts:
            problem.parts[self.name] = self.make(problem)
        found: T = problem.parts[self.name]
        return found
