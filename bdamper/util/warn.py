"""Warnings of values that are possible but not plausible, shown at the line of the user that gave them."""

from __future__ import annotations

import inspect
import warnings

from bdamper.util.errors import shortened

_OURS = ("bdamper", "dataclasses", "functools", "contextlib")


class PlausibilityWarning(UserWarning):
    """A value is possible, so it is used, but it lies outside of what machines have: a mistaken unit or digit?"""


def implausible(item: str, plausible: str, found: str) -> None:
    """Warn in one line: the item, the plausible range, and what was found."""
    level, frame = 1, inspect.currentframe()
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] in _OURS:
        level, frame = level + 1, frame.f_back
    text = f"{item}: plausible {plausible}, found {shortened(found)}"
    warnings.warn(text, PlausibilityWarning, stacklevel=level)
