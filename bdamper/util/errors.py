"""Errors that a user can cause and can mend: messages name the item, what was expected, what was found."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar


class BdamperError(Exception):
    """Base class of all errors raised on purpose by this package."""


class ModelError(BdamperError, ValueError):
    """A model, or a model file, contradicts itself or the conventions."""


class SettingError(BdamperError, ValueError):
    """A setting of a study is out of range or does not fit the model."""


class StaticError(BdamperError):
    """No static state was found under a load, so there is nothing to vibrate about."""


_LONGEST_FOUND = 300
P = ParamSpec("P")
T = TypeVar("T")


def removed(**successors: str) -> Callable[[type[T]], type[T]]:
    """Class decorator: attributes that are gone, each with what stands for it in the error that asking for it raises."""

    def decorate(cls: type[T]) -> type[T]:
        def missing(self: Any, name: str) -> Any:
            if name in successors:
                raise AttributeError(f"{cls.__name__}.{name} has gone with version 0.2: use {successors[name]}")
            raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")

        cls.__getattr__ = missing  # type: ignore[attr-defined]
        return cls

    return decorate


def renamed(**successors: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Decorator of a function: arguments under a name that they had before are accepted with a DeprecationWarning."""

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        @wraps(function)
        def call(*args: P.args, **keywords: P.kwargs) -> T:
            for old in successors.keys() & keywords.keys():
                warnings.warn(f"{old}= is now {successors[old]}=", DeprecationWarning, stacklevel=2)
                keywords[successors[old]] = keywords.pop(old)
            return function(*args, **keywords)

        return call

    return decorate


def mismatch(item: str, expected: str, found: object) -> ModelError:
    """An error of one line: the item, what was expected of it and what was found instead."""
    return ModelError(f"{item}: expected {expected}, found {shortened(found)}")


def shortened(found: object) -> str:
    """What was found, in one line that is not too long."""
    text = " ".join(str(found).split())
    return text if len(text) <= _LONGEST_FOUND else text[: _LONGEST_FOUND - 3] + "..."
