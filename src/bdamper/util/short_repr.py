"""Short texts of objects that hold arrays: what a console or a notebook shows of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

from bdamper.util.formatting import cut

T = TypeVar("T", bound=type)


def brief(cls: T) -> T:
    """Class decorator: the representation of a dataclass is its ``str``, or its items with arrays by their shapes alone."""
    prints_itself = any("__str__" in base.__dict__ for base in cls.__mro__[:-1])
    cls.__repr__ = cls.__str__ if prints_itself else _as_items  # type: ignore[assignment]
    return cls


def _as_items(self: Any) -> str:
    shown = [f for f in fields(self) if f.repr]
    return f"{type(self).__name__}({', '.join(f'{f.name}={short(getattr(self, f.name))}' for f in shown)})"


def plain(value: object) -> str:
    """A text as it is, anything else by :func:`short`."""
    return value if isinstance(value, str) else short(value)


def short(value: Any) -> str:
    """One item: an array by its shape, a mapping by its names, a longer sequence by its length."""
    if isinstance(value, np.ndarray):
        return repr(value.item()) if value.ndim == 0 else f"<{' x '.join(map(str, value.shape))} {value.dtype}>"
    longest = 60  # characters of one item
    if isinstance(value, Mapping):
        text = "{" + ", ".join(f"{key!r}: {short(item)}" for key, item in value.items()) + "}"
        return text if len(text) <= longest else f"<{len(value)} by name: {cut(', '.join(map(str, value)), longest)}>"
    if isinstance(value, (list, tuple)):
        text = ("[{}]" if isinstance(value, list) else "({})").format(", ".join(short(item) for item in value))
        return text if len(text) <= longest else f"<{len(value)} items>"
    if is_dataclass(value) and not isinstance(value, type):
        text = repr(value)
        return text if len(text) <= longest and "\n" not in text else f"{type(value).__name__}(...)"
    return cut(repr(value), longest) if not isinstance(value, (int, float, complex, np.generic)) else repr(value)
