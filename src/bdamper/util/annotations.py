"""Annotated types of fields: the type itself, whether it may be None, and what it is marked with.

``Annotated[float, mark]`` and ``Annotated[float, mark] | None`` carry the same mark.
"""

from __future__ import annotations

from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, NamedTuple, TypeVar, Union, cast, get_args, get_origin, get_type_hints

T = TypeVar("T")


class Declared(NamedTuple):
    """A type without its marks and without None.

    Parameters
    ----------
    kind : type
    optional : bool
        Whether None is allowed.
    marks : tuple
        Outermost last.
    """

    kind: Any
    optional: bool = False
    marks: tuple[Any, ...] = ()

    def mark(self, kind: type[T]) -> T | None:
        """The outermost mark of a class; None if there is none."""
        return next((mark for mark in reversed(self.marks) if isinstance(mark, kind)), None)


def declared(hint: object) -> Declared:
    """Declaration in a type hint."""
    if get_origin(hint) is Annotated:
        inner, *marks = get_args(hint)
        return declared(inner)._replace(marks=(*declared(inner).marks, *marks))
    kinds = [kind for kind in get_args(hint) if kind is not NoneType]
    if get_origin(hint) not in (Union, UnionType) or len(kinds) == len(get_args(hint)):
        return Declared(hint)
    return declared(kinds[0])._replace(optional=True) if len(kinds) == 1 else Declared(hint, True)


@cache
def declarations(of: object) -> dict[str, Declared]:
    """Declarations in the type hints of a class or function, by field or parameter."""
    return {name: declared(hint) for name, hint in get_type_hints(cast(Any, of), include_extras=True).items()}
