"""How an object finds the function that draws it: a registry by type, filled by :mod:`bdamper.plot`.

Results know nothing of pictures.  The drawing functions enter themselves here when :mod:`bdamper.plot` is loaded, which
happens at the first picture, so that matplotlib is loaded no earlier.  This is the only import that goes upward.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

from bdamper.util import validate

Drawing = TypeVar("Drawing", bound=Callable[..., Any])

_DRAWINGS: dict[tuple[type, str], Callable[..., Any]] = {}


def draws(shown: type, picture: str = "plot") -> Callable[[Drawing], Drawing]:
    """Decorator: enters a function as the one that draws a kind of picture of a type.

    Parameters
    ----------
    shown : type
        The first argument of the function is an object of this type.
    picture : str
        Name of the method that calls the function.
    """

    def enter(function: Drawing) -> Drawing:
        @wraps(function)
        def drawing(given: Any, *arguments: Any, **options: Any) -> Any:
            return function(validate.instance(function.__name__, given, shown), *arguments, **options)

        _DRAWINGS[shown, picture] = drawing
        return cast(Drawing, drawing)

    return enter


def draw(shown: Any, picture: str, *arguments: Any, **options: Any) -> Any:
    """Draw an object with the function that is entered for its type, or for one that it is derived from.

    Raises
    ------
    TypeError
        If there is no such picture of this type.
    """
    importlib.import_module("bdamper.plot")
    for kind in type(shown).__mro__:
        if (kind, picture) in _DRAWINGS:
            return _DRAWINGS[kind, picture](shown, *arguments, **options)
    raise TypeError(f"there is no picture '{picture}' of {type(shown).__name__}")


class Plottable:
    """An object with a picture of itself."""

    def plot(self, *arguments: Any, **options: Any) -> Any:
        """Draw the object with the function of :mod:`bdamper.plot` that the docstring of its class names.

        Parameters
        ----------
        arguments, options
            Those of that function after the object itself, for example ``ax=`` for axes to draw into.

        Returns
        -------
        matplotlib axes or figure
            What that function returns.
        """
        return draw(self, "plot", *arguments, **options)
