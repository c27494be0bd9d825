"""Checks of arguments.

Each check takes the name of the argument first.  It returns the value in the form used by the package, or raises a
:class:`~bdamper.util.errors.SettingError` "name: expected ..., found ...".  Texts and booleans are not accepted as numbers,
nor numbers as booleans.

Dataclasses declare the checks of their fields in the annotated types (:class:`Checked`)::

    class Options(Checked):
        step: Positive
        tolerance: Annotated[float, Limits(above=0.0, below=1e-2)]
        patience: Annotated[int, partial(integer, least=2)]
        scale: Literal["linear", "logarithmic"]
        budget: Count | None
        locate: bool

``Annotated[float, mark]`` and ``Annotated[float, mark] | None`` have the same mark.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from difflib import get_close_matches
from functools import cache, partial, reduce, wraps
from numbers import Real
from operator import and_, ge, gt, le, lt
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    NamedTuple,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from numpy.typing import NDArray

from bdamper.util import plausible_ranges, quantities
from bdamper.util.errors import (
    BdamperError,
    SettingError,
    inside_package,
    one_line,
    too_little_memory,
)

# ---- Annotated types of fields ----


T = TypeVar("T")


class Declared(NamedTuple):
    """Type of a field without its marks and without None.

    Parameters
    ----------
    kind : type
    optional : bool
        Whether None is allowed.
    marks : tuple
        Marks of the annotated type, the outermost last.
    """

    kind: Any
    optional: bool = False
    marks: tuple[Any, ...] = ()

    def mark(self, kind: type[T]) -> T | None:
        """Return the outermost mark of a class, or None."""
        return next((mark for mark in reversed(self.marks) if isinstance(mark, kind)), None)


def declared(hint: object) -> Declared:
    """Separate a type hint into type, marks and optionality."""
    if get_origin(hint) is Annotated:
        inner, *marks = get_args(hint)
        return declared(inner)._replace(marks=(*declared(inner).marks, *marks))
    kinds = [kind for kind in get_args(hint) if kind is not NoneType]
    if get_origin(hint) not in (Union, UnionType) or len(kinds) == len(get_args(hint)):
        return Declared(hint)
    return declared(kinds[0])._replace(optional=True) if len(kinds) == 1 else Declared(hint, True)


@cache
def declarations(of: object) -> dict[str, Declared]:
    """Return type, marks and optionality of each field of a class or parameter of a function, from its type hints."""
    return {
        name: declared(hint)
        for name, hint in get_type_hints(cast(Any, of), include_extras=True).items()
    }


# ---- Checks of arguments ----


def invalid(name: str, expected: str, found: Any) -> SettingError:
    """Return the error for an invalid value.

    The error shows numbers, texts and lists of them; it shows other objects by their type.
    """
    return SettingError(f"{name}: expected {expected}, found {one_line(_shown(found))}")


def check_value(good: object, name: str, expected: str, value: object) -> None:
    """Raise the error of :func:`invalid` unless a condition holds."""
    if not good:
        raise invalid(name, expected, value)


def check(good: object, name: str, expected: str, found: object) -> None:
    """Raise a SettingError unless a condition holds; ``found`` describes the value in words."""
    if not good:
        raise SettingError(f"{name}: expected {expected}, found {one_line(found)}")


def _shown(value: Any) -> str:
    if isinstance(value, np.generic):
        value = value.item()
    # the text of a result is long
    if isinstance(value, list | tuple) and value and all(is_dataclass(item) for item in value):
        return f"a {type(value).__name__} of {len(value)} {type(value[0]).__name__}"
    if value is None or isinstance(value, str | bytes | Real | complex | list | tuple | dict):
        return repr(value)
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}" if value.size > 6 else repr(value.tolist())
    return (
        f"the class {value.__name__}"
        if isinstance(value, type)
        else with_article(type(value).__name__)
    )


def with_article(name: str) -> str:
    """Return the name of a type with its article."""
    return f"{'an' if name[0] in 'aeioAEIOU' else 'a'} {name}"


def _plain_number(value: Any) -> float | None:
    """Return a finite real number; None for any other value."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if not isinstance(value, Real) or isinstance(value, bool | np.bool_):
        return None
    try:
        out = float(value)
    except (OverflowError, ValueError):
        return None
    return out if np.isfinite(out) else None


@dataclass(frozen=True)
class Limits:
    """Bounds of a number: above < x < below, least <= x <= most.

    ``str`` gives the text for errors, with the unit.
    """

    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None
    unit: str = ""

    def hold(self, values: float | NDArray) -> Any:
        """Return whether a number, or each number of an array, is within the bounds."""
        limits = ((gt, self.above), (ge, self.least), (lt, self.below), (le, self.most))
        return reduce(
            and_, (holds(values, limit) for holds, limit in limits if limit is not None), True
        )

    def __call__(self, name: str, value: object) -> float:
        """Check and return a finite number within the bounds."""
        return number(name, value, **asdict(self))

    def __str__(self) -> str:
        given = [(">", self.above), (">=", self.least), ("<", self.below), ("<=", self.most)]
        text = " and ".join(f"{sign} {limit:g}" for sign, limit in given if limit is not None)
        if self.above is not None and self.below is not None:
            text = f"between {self.above:g} and {self.below:g}"
        return f"{text} {self.unit}".strip() if text or not self.unit else f"in {self.unit}"


def number(name: str, value: Any, **limits: Any) -> float:
    """Check and return a finite number within :class:`Limits`."""
    within = Limits(**limits)
    if quantities.is_quantity(value):
        value = quantities.in_unit(name, value, within.unit)
    out = _plain_number(value)
    if out is None or not within.hold(out):
        kind = (
            "a number"
            if within.above is not None and within.below is not None
            else "a finite number"
        )
        raise invalid(name, f"{kind} {within}".strip(), value)
    return out


def integer(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """Check and return an integer from ``least`` to ``most``."""
    out = _plain_number(value)
    if out is None or out != int(out) or out < least or (most is not None and out > most):
        raise invalid(
            name,
            f"a whole number {f'>= {least}' if most is None else f'from {least} to {most}'}",
            value,
        )
    return int(out)


def flag(name: str, value: Any) -> bool:
    """Check and return True or False."""
    check_value(isinstance(value, bool | np.bool_), name, "True or False", value)
    return bool(value)


def suggest_name(found: object, choices: Iterable[str]) -> str:
    """Return "; did you mean ...?" for a misspelt or shortened name.

    It proposes up to three choices that contain the name, or the most similar one; the text is empty if there is none.
    """
    if not isinstance(found, str):
        return ""
    known = [c for c in choices if not c.startswith("_")]
    near = [c for c in known if len(found) > 2 and found in c] or get_close_matches(found, known, 1)
    return f"; did you mean {' or '.join(near[:3])}?" if near else ""


def choice(name: str, value: Any, choices: Iterable[str]) -> str:
    """Check and return one of several names."""
    choices = tuple(choices)
    if not isinstance(value, str) or value not in choices:
        near = suggest_name(value, choices)
        expected = (
            f"one of {len(choices)} names" if near and len(choices) > 8 else f"one of {choices}"
        )
        raise SettingError(f"{invalid(name, expected, value)}{near}")
    return value


OWNERS = ("self", "cls", "problem", "disk")
"""First parameters of functions that are methods of a study or of a bladed disk."""


def check_arguments(called: T, also: Iterable[str] = (), name: str = "", warns: bool = True) -> T:
    """Decorate a function or class so that it checks its keywords and warns of implausible values.

    An unknown keyword raises an error that proposes a similar one.  Only the outermost of nested calls warns, which is the
    user's; see :mod:`bdamper.util.plausible_ranges` for the ranges.

    Parameters
    ----------
    called : function or class
    also : iterable of str
        Further keywords that the function accepts.
    name : str
        Name in errors; by default the name of the function or class.
    warns : bool
        Whether to warn of implausible values.
    """
    if isinstance(called, type):
        called.__init__ = check_arguments(called.__init__, also, name, warns)  # type: ignore[misc]
        return called
    function: Callable[..., Any] = called  # type: ignore[assignment]
    signature = inspect.signature(function)
    takes_any = not also and any(p.kind is p.VAR_KEYWORD for p in signature.parameters.values())
    name, known = (
        name or function.__qualname__.removesuffix(".__init__"),
        [*signature.parameters, *also],
    )
    needed = [
        n
        for n, p in signature.parameters.items()
        if n not in OWNERS and p.default is p.empty and p.kind != p.VAR_KEYWORD
    ]

    @wraps(function)
    def checked(*given: Any, **keywords: Any) -> Any:
        for word in () if takes_any else keywords.keys() - set(known):
            shown = ", ".join(k for k in known if k not in OWNERS and k[0] != "_")
            near = suggest_name(word, known) or f"; the arguments are {shown}"
            raise SettingError(f"{name}: there is no argument '{word}'{near}")
        try:
            bound = signature.bind(*given, **keywords)
        except TypeError as error:
            raise SettingError(
                f"{name}: {error}; the required arguments are {', '.join(needed)}"
            ) from None
        _convert(name, bound)
        given, keywords = bound.args, bound.kwargs
        with inside_package() as enclosing:
            # the outermost call is the user's, and the others repeat its arguments
            if warns and enclosing == 0:
                _doubt(name, bound)
            try:
                return function(*given, **keywords)
            except MemoryError as error:
                if enclosing or isinstance(error, BdamperError):
                    raise
                raise too_little_memory(name, error) from error

    checked.doubts = name  # type: ignore[attr-defined]
    return checked  # type: ignore[return-value]


def _convert(name: str, bound: inspect.BoundArguments) -> None:
    """Replace arguments that are quantities by numbers in the expected unit."""
    for word, value in bound.arguments.items():
        if bound.signature.parameters[word].kind is inspect.Parameter.VAR_KEYWORD:
            bound.arguments[word] = {k: quantities.plain(name, k, v) for k, v in value.items()}
        elif quantities.is_quantity(value) and quantities.unit_of(name, word) is None:
            bound.arguments[word] = quantities.in_unit(word, value, "")
        else:
            bound.arguments[word] = quantities.plain(name, word, value)


def _doubt(name: str, bound: inspect.BoundArguments) -> None:
    """Warn of implausible arguments.

    A first argument that is a study or problem provides the sizes.  If it is a function in place of a study, names in
    mappings are parameters of that function.
    """
    bound.apply_defaults()
    first = next(iter(bound.args), None)
    function = (
        getattr(first, "doubts", "") if callable(first) and not isinstance(first, type) else None
    )
    sizes = getattr(getattr(first, "problem", first), "sizes", None)
    for parameter, value in bound.arguments.items():
        further = bound.signature.parameters[parameter].kind is inspect.Parameter.VAR_KEYWORD
        for keyword, argument in value.items() if further else [(parameter, value)]:
            plausible_ranges.check(name, keyword, argument, sizes, function=function)


def names(name: str, value: Any, choices: Iterable[str], least: int = 0) -> tuple[str, ...]:
    """Check a sequence of different names, and return it as a tuple."""
    choices = tuple(choices)
    several = isinstance(value, Iterable) and not isinstance(value, str | bytes)
    given = tuple(choice(name, item, choices) for item in value) if several else ()
    good = several and least <= len(given) == len(set(given))
    check_value(
        good,
        name,
        f"{f'at least {least}' if least else 'a sequence'} of {choices}, each at most once",
        value,
    )
    return given


def instance(name: str, value: T, kind: type | tuple[type, ...], words: str = "") -> T:
    """Check and return an object of one of the given classes; ``words`` describes the classes in the error."""
    if not isinstance(value, kind):
        kinds = kind if isinstance(kind, tuple) else (kind,)
        named = [with_article(k.__name__) for k in kinds]
        raise invalid(name, words or " or ".join(named), value)
    return value


def mapping(name: str, value: Any, keys: Iterable[str], words: str) -> Mapping[str, Any]:
    """Check and return a mapping whose keys are among ``keys``; ``words`` describes the keys in the error."""
    keys = tuple(keys)
    check_value(
        isinstance(value, Mapping),
        name,
        f"a mapping of {words} out of {list(keys)} to values",
        value,
    )
    unknown = [key for key in value if key not in keys]
    if unknown:
        raise SettingError(
            f"{invalid(name, f'{words} out of {list(keys)}', unknown)}{suggest_name(unknown[0], keys)}"
        )
    return value


def each(check: Callable[[str, Any], Any]) -> Callable[[str, Any], Any]:
    """Extend a check of one value to mappings, whose values are checked one by one."""

    def checked(name: str, value: Any) -> Any:
        if not isinstance(value, Mapping):
            return check(name, value)
        return {key: check(f"{name} of '{key}'", item) for key, item in value.items()}

    return checked


def numbers(name: str, value: Any, n: int | None = None, **limits: Any) -> NDArray:
    """Check and return finite numbers (n,) within :class:`Limits`; at least one number if ``n`` is None."""
    out, within = None, Limits(**limits)
    value = quantities.in_lists(name, value, within.unit)
    if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes):
        given = [_plain_number(v) for v in value] if np.ndim(value) != 0 else [None]
        good = [g for g in given if g is not None and within.hold(g)]
        if len(good) == len(given) and (len(good) == n if n is not None else good):
            out = np.array(good)
    if out is None:
        count = "a sequence of one or more" if n is None else str(n)
        raise invalid(name, f"{count} finite numbers {within}".strip(), value)
    return out


def integers(name: str, value: Any, least: int = 0, most: int | None = None) -> tuple[int, ...]:
    """Check a sequence of different integers from ``least`` to ``most``, and return it as a tuple."""
    sequence = isinstance(value, Iterable) and not isinstance(value, str | bytes)
    check_value(sequence, name, "a sequence of whole numbers", value)
    given = tuple(integer(name, item, least, most) for item in value)
    check_value(len(set(given)) == len(given), name, "whole numbers, each at most once", value)
    return given


def interval(name: str, value: Any, unit: str = "Hz") -> tuple[float, float]:
    """Check an interval with 0 < low < high, and return its ends."""
    value = quantities.in_lists(name, value, unit)
    given = value.tolist() if isinstance(value, np.ndarray) else value
    ends = (
        [_plain_number(end) for end in given]
        if isinstance(given, Sequence) and len(given) == 2
        else [None, None]
    )
    low, high = ends
    if low is None or high is None or not 0.0 < low < high:
        raise invalid(name, f"(low, high) in {unit} with 0 < low < high", value)
    return low, high


def check_attributes(
    record: Any, check: Callable[..., Any], *attributes: str, prefix: str = "", **limits: Any
) -> None:
    """Check attributes of a frozen dataclass and store the converted values."""
    for name in attributes:
        object.__setattr__(record, name, check(f"{prefix}{name}", getattr(record, name), **limits))


def check_fields(record: object, prefix: str = "") -> None:
    """Check the fields of a frozen dataclass by their annotated types (see :class:`Checked`).

    Errors name a field with ``prefix`` before its name.
    """
    cls: Callable[..., Any] = type(record)
    for name, check in _checks(cls).items():
        check_attributes(record, check, name, prefix=prefix)


class UnknownAttribute(AttributeError):
    """Error of an attribute that an object lacks.

    Its text names similar attributes.  It is composed when it is printed, because ``hasattr`` drops the error.

    Parameters
    ----------
    owner : object
    name : str
    elsewhere : callable, optional
        Returns a text for a name without similar attributes of the owner.
    """

    def __init__(
        self, owner: object, name: str, elsewhere: Callable[[str], str] = lambda name: ""
    ) -> None:
        super().__init__(name=name, obj=owner)
        self.attribute = name
        self.elsewhere = elsewhere

    def __str__(self) -> str:
        kind = type(self.obj)
        near = ""
        if not self.attribute.startswith("_"):
            own = [*dir(kind), *getattr(kind, "__dataclass_fields__", ())]
            near = suggest_name(self.attribute, own) or self.elsewhere(self.attribute)
        return f"{kind.__name__} has no attribute '{self.attribute}'{near}"


class Answering:
    """Mixin of dataclasses that answers a misspelt attribute."""

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            raise UnknownAttribute(self, name)


class Checked(Answering):
    """Mixin of frozen dataclasses that checks the fields by their annotated types when an object is made.

    A mark that is a function of name and value checks a field and returns the converted value.  Without such a mark,
    ``bool`` accepts True and False, and ``Literal`` one of its values.  Other fields, and None in an optional field, are
    not checked.
    """

    def __post_init__(self) -> None:
        check_fields(self)


@cache
def _checks(cls: Callable[..., Any]) -> dict[str, Callable[[str, Any], Any]]:
    """Return the check of each field of a class, by name."""
    found = {name: (_check_of(field), field.optional) for name, field in declarations(cls).items()}
    return {
        name: partial(_given, check, optional)
        for name, (check, optional) in found.items()
        if check is not None
    }


def _check_of(field: Declared) -> Callable[[str, Any], Any] | None:
    plain: Callable[[str, Any], Any] | None = flag if field.kind is bool else None
    if get_origin(field.kind) is Literal:
        plain = partial(choice, choices=get_args(field.kind))
    return next((mark for mark in reversed(field.marks) if callable(mark)), plain)


def _given(check: Callable[[str, Any], Any], optional: bool, name: str, value: Any) -> Any:
    return None if optional and value is None else check(name, value)


Positive = Annotated[float, Limits(above=0.0)]
NotNegative = Annotated[float, Limits(least=0.0)]
Share = Annotated[float, Limits(least=0.0, below=1.0)]
Force = Annotated[float, Limits(least=0.0, unit="N")]
Length = Annotated[float, Limits(least=0.0, unit="m")]
Speed = Annotated[float, Limits(above=0.0, unit="rad/s")]
Natural = Annotated[int, integer]
Count = Annotated[int, partial(integer, least=1)]
Interval = Annotated[tuple[float, float], interval]
