"""Checks of arguments.

Each check takes the name of the argument first.  It returns the value in the form used by the
package, or raises a :class:`~bdamper.util.errors.SettingError` "name: expected ..., found ...".
Texts and booleans are not accepted as numbers, nor numbers as booleans.

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
from functools import cache, partial, wraps
from numbers import Real
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
    """Type of a field without its annotations and without None.

    Parameters
    ----------
    kind : type
    optional : bool
        Whether None is allowed.
    marks : tuple
        Metadata of the annotated type, the outermost last.
    """

    kind: Any
    optional: bool = False
    marks: tuple[Any, ...] = ()

    def mark(self, kind: type[T]) -> T | None:
        """Return the outermost metadata of a class, or None."""
        for mark in reversed(self.marks):
            if isinstance(mark, kind):
                return mark
        return None


def declared(hint: object) -> Declared:
    """Separate a type hint into type, metadata and optionality."""
    if get_origin(hint) is Annotated:
        inner, *marks = get_args(hint)
        annotated = declared(inner)
        return annotated._replace(marks=(*annotated.marks, *marks))
    is_union = get_origin(hint) in (Union, UnionType)
    kinds = [kind for kind in get_args(hint) if kind is not NoneType]
    optional = is_union and len(kinds) < len(get_args(hint))
    if not optional:
        return Declared(hint)
    if len(kinds) == 1:
        return declared(kinds[0])._replace(optional=True)
    # a union of several types keeps its None
    return Declared(hint, optional=True)


@cache
def declarations(of: object) -> dict[str, Declared]:
    """Return the declaration of each field of a class or parameter of a function from its type
    hint.
    """
    hints = get_type_hints(cast(Any, of), include_extras=True)
    return {name: declared(hint) for name, hint in hints.items()}


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


def check_sentence(good: object, name: str, sentence: str) -> None:
    """Raise a SettingError "name: sentence" unless a condition holds.

    A sentence is suitable for a value that is missing, not allowed or cannot be combined.
    """
    if not good:
        raise SettingError(f"{name}: {sentence}")


def _shown(value: Any) -> str:
    """Return the text of a value for errors."""
    if isinstance(value, np.generic):
        value = value.item()
    # the text of a result is long
    if isinstance(value, list | tuple) and value and all(is_dataclass(item) for item in value):
        return f"a {type(value).__name__} of {len(value)} {type(value[0]).__name__}"
    if value is None or isinstance(value, str | bytes | Real | complex | list | tuple | dict):
        return repr(value)
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}" if value.size > 6 else repr(value.tolist())
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return with_article(type(value).__name__)


def with_article(name: str) -> str:
    """Return the name of a type with its article."""
    article = "an" if name[0] in "aeioAEIOU" else "a"
    return f"{article} {name}"


def _plain_number(value: Any) -> float | None:
    """Return a finite real number; None for any other value."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if not isinstance(value, Real) or isinstance(value, bool | np.bool_):
        return None
    try:
        converted = float(value)
    except (OverflowError, ValueError):
        return None
    return converted if np.isfinite(converted) else None


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
        within: Any = True
        if self.above is not None:
            within = within & (values > self.above)
        if self.least is not None:
            within = within & (values >= self.least)
        if self.below is not None:
            within = within & (values < self.below)
        if self.most is not None:
            within = within & (values <= self.most)
        return within

    def __call__(self, name: str, value: object) -> float:
        """Check and return a finite number within the bounds."""
        return number(name, value, **asdict(self))

    def __str__(self) -> str:
        if self.above is not None and self.below is not None:
            text = f"between {self.above:g} and {self.below:g}"
        else:
            bounds = [(">", self.above), (">=", self.least), ("<", self.below), ("<=", self.most)]
            text = " and ".join(f"{sign} {bound:g}" for sign, bound in bounds if bound is not None)
        if not text and self.unit:
            text = "in"
        return f"{text} {self.unit}".strip()


def number(name: str, value: Any, **limits: Any) -> float:
    """Check and return a finite number within :class:`Limits`."""
    within = Limits(**limits)
    if quantities.is_quantity(value):
        value = quantities.in_unit(name, value, within.unit)
    converted = _plain_number(value)
    if converted is None or not within.hold(converted):
        is_bounded = within.above is not None and within.below is not None
        kind = "a number" if is_bounded else "a finite number"
        raise invalid(name, f"{kind} {within}".strip(), value)
    return converted


def integer(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """Check and return an integer from ``least`` to ``most``."""
    converted = _plain_number(value)
    whole = None
    if converted is not None and converted == int(converted):
        whole = int(converted)
    if whole is None or whole < least or (most is not None and whole > most):
        bounds = f">= {least}" if most is None else f"from {least} to {most}"
        raise invalid(name, f"a whole number {bounds}", value)
    return whole


def flag(name: str, value: Any) -> bool:
    """Check and return True or False."""
    check_value(isinstance(value, bool | np.bool_), name, "True or False", value)
    return bool(value)


def suggest_name(found: object, choices: Iterable[str]) -> str:
    """Return "; did you mean ...?" for a misspelt or shortened name.

    It proposes up to three choices that contain the name, or the most similar one; the text is
    empty if there is none.
    """
    if not isinstance(found, str):
        return ""
    public = [choice for choice in choices if not choice.startswith("_")]
    similar: list[str] = []
    if len(found) > 2:
        similar = [choice for choice in public if found in choice]
    if not similar:
        similar = get_close_matches(found, public, 1)
    if not similar:
        return ""
    return f"; did you mean {' or '.join(similar[:3])}?"


ARGUMENTS_OF_METHODS = {
    "mode": "study.peak(preload, mode=2)",
    "frequency": "study.peak(preload, (low, high))",
    "preload": "study.peak(preload)",
    "errors": "study.peak(preload, errors=False)",
    "check": "study.optimal_curve(preloads, check=False)",
    "rpm": "study.at_speed(rpm=9000)",
}
"""Example of a method with each argument that is often given to the study instead."""


def hint_of_setting(word: str, names: Iterable[str]) -> str:
    """Return where an argument belongs that is no setting of a study, or similar settings."""
    if word in ARGUMENTS_OF_METHODS:
        return f"; it is an argument of methods, for example {ARGUMENTS_OF_METHODS[word]}"
    return suggest_name(word, names)


def choice(name: str, value: Any, choices: Iterable[str]) -> str:
    """Check and return one of several names."""
    choices = tuple(choices)
    if isinstance(value, str) and value in choices:
        return value
    similar = suggest_name(value, choices)
    expected = f"one of {choices}"
    if similar and len(choices) > 8:
        expected = f"one of {len(choices)} names"
    raise SettingError(f"{invalid(name, expected, value)}{similar}")


OWNERS = ("self", "cls", "problem", "disk")
"""First parameters of functions that are methods of a study or of a bladed disk."""


def check_arguments(called: T, also: Iterable[str] = (), name: str = "", warns: bool = True) -> T:
    """Decorate a function or class so that it checks its keywords and warns about implausible
    values.

    An unknown keyword raises an error that proposes a similar one.  Only the outermost of nested
    calls warns, which is the user's; see :mod:`bdamper.util.plausible_ranges` for the ranges.

    Parameters
    ----------
    called : function or class
    also : iterable of str
        Further keywords that the function accepts.
    name : str
        Name in errors; by default the name of the function or class.
    warns : bool
        Whether to warn about implausible values.
    """
    if isinstance(called, type):
        called.__init__ = check_arguments(called.__init__, also, name, warns)  # type: ignore[misc]
        return called
    function: Callable[..., Any] = called  # type: ignore[assignment]
    signature = inspect.signature(function)
    parameters = signature.parameters
    name = name or function.__qualname__.removesuffix(".__init__")
    accepted = [*parameters, *also]
    takes_any = not also and any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    required = [
        word
        for word, p in parameters.items()
        if word not in OWNERS and p.default is p.empty and p.kind != p.VAR_KEYWORD
    ]

    arguments_are = "arguments are" if len(required) > 1 else "argument is"

    @wraps(function)
    def checked(*arguments: Any, **keywords: Any) -> Any:
        if not takes_any:
            _check_keywords(name, keywords, accepted)
        try:
            bound = signature.bind(*arguments, **keywords)
        except TypeError as error:
            raise SettingError(
                f"{name}: {error}; the required {arguments_are} {', '.join(required)}"
            ) from None
        _convert(name, bound)
        # the warnings fill in defaults, which the function has itself
        arguments = bound.args
        keywords = bound.kwargs
        with inside_package() as enclosing:
            # the outermost call is the user's, and the others repeat its arguments
            if warns and enclosing == 0:
                _doubt(name, bound)
            try:
                return function(*arguments, **keywords)
            except MemoryError as error:
                if enclosing or isinstance(error, BdamperError):
                    raise
                raise too_little_memory(name, error) from error

    checked.doubts = name  # type: ignore[attr-defined]
    return checked  # type: ignore[return-value]


def _check_keywords(name: str, keywords: Mapping[str, Any], accepted: Sequence[str]) -> None:
    """Raise SettingError for a keyword that a function does not accept."""
    for word in keywords.keys() - set(accepted):
        find = hint_of_setting if name == "Study" else suggest_name
        hint = find(word, accepted)
        if not hint:
            shown = [word for word in accepted if word not in OWNERS and word[0] != "_"]
            hint = f"; the arguments are {', '.join(shown)}"
        raise SettingError(f"{name}: there is no argument '{word}'{hint}")


def _convert(name: str, bound: inspect.BoundArguments) -> None:
    """Replace arguments that are quantities by numbers in the expected unit."""
    for word, value in bound.arguments.items():
        if bound.signature.parameters[word].kind is inspect.Parameter.VAR_KEYWORD:
            converted: Any = {
                keyword: quantities.plain(name, keyword, argument)
                for keyword, argument in value.items()
            }
        elif quantities.is_quantity(value) and quantities.unit_of(name, word) is None:
            converted = quantities.in_unit(word, value, "")
        else:
            converted = quantities.plain(name, word, value)
        bound.arguments[word] = converted


def _doubt(name: str, bound: inspect.BoundArguments) -> None:
    """Warn about implausible arguments.

    A first argument that is a study or problem provides the sizes.  If it is a function in place of
    a study, names in mappings are parameters of that function.
    """
    bound.apply_defaults()
    first = next(iter(bound.args), None)
    function = None
    if callable(first) and not isinstance(first, type):
        # a function of the user has no ranges, and an empty name
        function = getattr(first, "doubts", "")
    problem = getattr(first, "problem", first)
    sizes = getattr(problem, "sizes", None)
    for parameter, value in bound.arguments.items():
        kind = bound.signature.parameters[parameter].kind
        named = value if kind is inspect.Parameter.VAR_KEYWORD else {parameter: value}
        for keyword, argument in named.items():
            plausible_ranges.check(name, keyword, argument, sizes, function=function)


def names(name: str, value: Any, choices: Iterable[str], least: int = 0) -> tuple[str, ...]:
    """Check a sequence of different names, and return it as a tuple."""
    choices = tuple(choices)
    is_sequence = isinstance(value, Iterable) and not isinstance(value, str | bytes)
    chosen = tuple(choice(name, item, choices) for item in value) if is_sequence else ()
    are_different = len(chosen) == len(set(chosen))
    amount = f"at least {least}" if least else "a sequence"
    expected = f"{amount} of {choices}, each at most once"
    check_value(is_sequence and are_different and len(chosen) >= least, name, expected, value)
    return chosen


def instance(name: str, value: T, kind: type | tuple[type, ...], words: str = "") -> T:
    """Check and return an object of one of the given classes.

    ``words`` describes the classes in the error.
    """
    if isinstance(value, kind):
        return value
    kinds = kind if isinstance(kind, tuple) else (kind,)
    class_names = [with_article(k.__name__) for k in kinds]
    raise invalid(name, words or " or ".join(class_names), value)


def mapping(name: str, value: Any, keys: Iterable[str], words: str) -> Mapping[str, Any]:
    """Check and return a mapping whose keys are among ``keys``.

    ``words`` describes the keys in the error.
    """
    keys = tuple(keys)
    accepted = f"{words} out of {list(keys)}"
    check_value(isinstance(value, Mapping), name, f"a mapping of {accepted} to values", value)
    unknown = [key for key in value if key not in keys]
    if unknown:
        error = invalid(name, accepted, unknown)
        raise SettingError(f"{error}{suggest_name(unknown[0], keys)}")
    return value


def each(check: Callable[[str, Any], Any]) -> Callable[[str, Any], Any]:
    """Extend a check of one value to mappings, whose values are checked one by one."""

    def checked(name: str, value: Any) -> Any:
        if not isinstance(value, Mapping):
            return check(name, value)
        return {key: check(f"{name} of '{key}'", item) for key, item in value.items()}

    return checked


def numbers(name: str, value: Any, n: int | None = None, **limits: Any) -> NDArray:
    """Check and return finite numbers (n,) within :class:`Limits`.

    If ``n`` is None, at least one number is required.
    """
    within = Limits(**limits)
    value = quantities.in_lists(name, value, within.unit)
    converted = _plain_numbers(value)
    is_counted = len(converted) == n if n is not None else len(converted) > 0
    if is_counted and all(item is not None and within.hold(item) for item in converted):
        return np.array(converted)
    count = "a sequence of one or more" if n is None else str(n)
    expected = f"{count} finite numbers {within}".strip()
    if is_counted and len(converted) > 6:
        wrong = next(i for i, x in enumerate(converted) if x is None or not within.hold(x))
        items = value.tolist() if isinstance(value, np.ndarray) else value
        found = one_line(_shown(items[wrong]))
        raise SettingError(f"{name}: expected {expected}, found {found} at index {wrong}")
    raise invalid(name, expected, value)


def _plain_numbers(value: Any) -> list[float | None]:
    """Return the items of a sequence as numbers, with None for items that are not finite numbers.

    Return [None] if the value is not a sequence.
    """
    is_sequence = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes)
    if not is_sequence or np.ndim(value) == 0:
        return [None]
    return [_plain_number(item) for item in value]


def integers(name: str, value: Any, least: int = 0, most: int | None = None) -> tuple[int, ...]:
    """Check different integers from ``least`` to ``most``, and return them as a tuple."""
    is_sequence = isinstance(value, Iterable) and not isinstance(value, str | bytes)
    check_value(is_sequence, name, "a sequence of whole numbers", value)
    converted = tuple(integer(name, item, least, most) for item in value)
    are_different = len(set(converted)) == len(converted)
    check_value(are_different, name, "whole numbers, each at most once", value)
    return converted


def interval(name: str, value: Any, unit: str = "Hz") -> tuple[float, float]:
    """Check an interval with 0 < low < high, and return its ends."""
    value = quantities.in_lists(name, value, unit)
    ends = value.tolist() if isinstance(value, np.ndarray) else value
    low = high = None
    if isinstance(ends, Sequence) and len(ends) == 2:
        low = _plain_number(ends[0])
        high = _plain_number(ends[1])
    if low is None or high is None or not 0.0 < low < high:
        raise invalid(name, f"(low, high) in {unit} with 0 < low < high", value)
    return low, high


def check_attributes(
    record: Any, check: Callable[..., Any], *attributes: str, prefix: str = "", **limits: Any
) -> None:
    """Check attributes of a frozen dataclass and store the converted values."""
    for name in attributes:
        converted = check(f"{prefix}{name}", getattr(record, name), **limits)
        object.__setattr__(record, name, converted)


def check_fields(record: object, prefix: str = "") -> None:
    """Check the fields of a frozen dataclass by their annotated types (see :class:`Checked`).

    Errors name a field with ``prefix`` before its name.
    """
    cls: Callable[..., Any] = type(record)
    for name, check in _checks(cls).items():
        check_attributes(record, check, name, prefix=prefix)


class UnknownAttribute(AttributeError):
    """Error of an attribute that an object lacks.

    Its text names similar attributes.  It is composed when it is printed, because ``hasattr`` drops
    the error.

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
        hint = ""
        if not self.attribute.startswith("_"):
            attributes = [*dir(kind), *getattr(kind, "__dataclass_fields__", ())]
            hint = suggest_name(self.attribute, attributes) or self.elsewhere(self.attribute)
        return f"{kind.__name__} has no attribute '{self.attribute}'{hint}"


class Answering:
    """Mixin of dataclasses that answers a misspelt attribute."""

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            raise UnknownAttribute(self, name)


class Checked(Answering):
    """Mixin of frozen dataclasses that checks the fields by their annotated types.

    A function in an annotation, ``Annotated[T, function]``, receives name and value of the field and
    returns the converted value.  Without such a function, a field of type ``bool`` must be True or
    False, and a ``Literal`` one of its values.  Other fields, and None in an optional field, are not
    checked.
    """

    def __post_init__(self) -> None:
        check_fields(self)


@cache
def _checks(cls: Callable[..., Any]) -> dict[str, Callable[[str, Any], Any]]:
    """Return a mapping of field names to the checks of a class."""
    checks: dict[str, Callable[[str, Any], Any]] = {}
    for name, field in declarations(cls).items():
        check = _check_of(field)
        if check is not None:
            checks[name] = partial(_check_unless_none, check) if field.optional else check
    return checks


def _check_of(field: Declared) -> Callable[[str, Any], Any] | None:
    """Return the check of a field, or None: its outermost annotation that is a function, or its type."""
    for mark in reversed(field.marks):
        if callable(mark):
            return cast(Callable[[str, Any], Any], mark)
    if field.kind is bool:
        return flag
    if get_origin(field.kind) is Literal:
        return partial(choice, choices=get_args(field.kind))
    return None


def _check_unless_none(check: Callable[[str, Any], Any], name: str, value: Any) -> Any:
    return None if value is None else check(name, value)


Positive = Annotated[float, Limits(above=0.0)]
NotNegative = Annotated[float, Limits(least=0.0)]
Share = Annotated[float, Limits(least=0.0, below=1.0)]
Force = Annotated[float, Limits(least=0.0, unit="N")]
Length = Annotated[float, Limits(least=0.0, unit="m")]
Speed = Annotated[float, Limits(above=0.0, unit="rad/s")]
Natural = Annotated[int, integer]
Count = Annotated[int, partial(integer, least=1)]
Interval = Annotated[tuple[float, float], interval]
