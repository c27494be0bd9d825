"""What an object shows of itself: a picture, and in a notebook a small table beside it.

How an object finds the function that draws it: a registry by type, filled by :mod:`bdamper.plot`.

Results know nothing of pictures.  The drawing functions enter themselves here when :mod:`bdamper.plot` is loaded, which
happens at the first picture, so that matplotlib is loaded no earlier.  This is the only import that goes upward.

What differs between two studies or results: settings, model, and what they come to.
"""

from __future__ import annotations

import base64
import html
import importlib
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields, is_dataclass
from functools import reduce, wraps
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from bdamper.util import validation
from bdamper.util.errors import FAILED, BdamperError, SettingError, not_run_lines, status_word
from bdamper.util.formatting import UNITS, aligned, amount, percent, short_repr, spaced, text_of
from bdamper.util.progress import Cost
from bdamper.util.tables import FEW_ROWS, Quantity, Tabular, quantities

# ---- What an object shows of itself ----


Drawing = TypeVar("Drawing", bound=Callable[..., Any])

_DRAWINGS: dict[tuple[type, str], Callable[..., Any]] = {}


def register_plot(shown: type, picture: str = "plot") -> Callable[[Drawing], Drawing]:
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
            return function(validation.instance(function.__name__, given, shown), *arguments, **options)

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


class Fact(NamedTuple):
    """One line of a table: a name, a number or a text, and its unit."""

    name: str
    value: float | int | str
    unit: str = ""

    @property
    def known(self) -> bool:
        """Whether there is something to show: a number that is not NaN, or a text."""
        return str(self.value) not in ("", "nan")

    @property
    def text(self) -> str:
        """Value with its unit, in three digits."""
        return self.to_digits(3)

    def to_digits(self, digits: int) -> str:
        """Value with its unit, in so many digits where it is a number."""
        value = self.value
        return amount(value, self.unit, digits) if isinstance(value, float) else f"{value} {self.unit}".rstrip()


class Summarised:
    """A result that tells what matters first; a mixin.

    What is printed begins with :meth:`_headline` and goes on with a few lines, of :meth:`_facts` or of :meth:`summary`,
    which has everything; a notebook shows the same with a picture, and the details folded away.
    """

    _summary_fields: tuple[str, ...] = ()

    def _headline(self) -> str:
        """Summary in one or two sentences."""
        return ""

    def _facts(self) -> tuple[Fact, ...]:
        """The few things to know besides, in order: what is named in ``_summary_fields``."""
        return tuple(fact for name in self._summary_fields for fact in self._facts_of_field(name, several=True))

    def _facts_of_field(self, name: str, several: bool = False) -> Iterator[Fact]:
        """What there is to say of a field or property, or with dots of a part of it; nothing of arrays and None."""
        mark = quantities(cast(Any, type(self))).get(name, Quantity())
        value = reduce(lambda whole, part: getattr(whole, part, None), name.split("."), cast(Any, self))
        if mark.parts and np.ndim(value) == 1:
            return (Fact(part, round(100.0 * float(x), 1), "%") for part, x in zip(mark.parts, value))
        unit = mark.unit or UNITS.get(name.rpartition(".")[2], "")
        return _facts_of(spaced(mark.name or name), value, unit, several=several)

    def summary(self) -> str:
        """Everything that there is to say, in lines: facts, single values, a short table, notes, warnings and cost."""
        if not self._headline():
            return str(self)
        facts = [fact for fact in self._facts() if fact.known]
        names = {"model hash", *(fact.name for fact in facts)}
        plain = int | float | str  # of these a field that has its default says nothing
        own = (
            f.name
            for f in fields(cast(Any, self))
            if f.name not in ("cost", "made_with")
            and not (isinstance(f.default, plain) and getattr(self, f.name) == f.default and f.name != "status")
        )
        single = [fact for name in own for fact in self._facts_of_field(name)]
        facts += [fact for fact in single if fact.known and fact.name not in names]
        texts = list(dict.fromkeys(text for name in ("notes", "warnings") for text in getattr(self, name, ()) if text))
        texts = texts[:FEW_ROWS] + [f"{len(texts) - FEW_ROWS} more notes and warnings"] * (len(texts) > FEW_ROWS)
        status, cost = getattr(self, "status", ""), getattr(self, "cost", "")
        if isinstance(status, tuple):
            texts += not_run_lines(status, "parts") + [s for s in dict.fromkeys(status) if status_word(s) == FAILED]
        table = aligned(self._rows(), "  ")
        if isinstance(cost, tuple) and cost:  # of each part
            cost = Cost(*map(sum, zip(*map(astuple, cost))))
        texts += [str(cost or "").strip()]
        lines = [self._headline(), *aligned([(fact.name, fact.to_digits(6)) for fact in facts], "  "), *table, *texts]
        return "\n".join(line for line in lines if line)

    def __str__(self) -> str:
        rows = [row for row in self._table() if row]
        lines = aligned(rows) if rows else [t for t in self.summary().split("\n")[1:] if " of the processor: " not in t]
        sentences = re.sub(r"(\d) (?=\S{1,2}\b)", "\\1\0", self._headline())  # a number stays with its unit
        first = textwrap.fill(sentences, width=100).replace("\0", " ").split("\n")
        shown = lines[:9] + ["summary() has the rest"]
        return "\n".join([*first, *(f"  {line.removeprefix('  ')}" for line in shown)])

    def _rows(self) -> list[tuple[str, ...]]:
        """Head and rows of the table of a result that is one."""
        return self.as_rows() if isinstance(self, Tabular) else []

    def _table(self) -> list[tuple[str, ...]]:
        """Head, which may be empty, and rows of what is shown first: the facts, or the table where there are none."""
        facts = [(fact.name, fact.text) for fact in self._facts() if fact.known]
        return [(), *facts] if facts else self._rows() or [()]

    def _shown(self) -> Any:
        """What the picture is of; None for no picture."""
        return None

    def _repr_html_(self) -> str:
        head, *rows = self._table()
        text = _html_table(head, rows) if rows else "" if self._headline() else f"<pre>{html.escape(str(self))}</pre>"
        shown = self._shown()
        try:
            image = b"" if shown is None else draw(shown, "image")
        except BdamperError:  # there is nothing to draw, as the text says
            image = b""
        source = base64.b64encode(image).decode()
        picture = f'<img src="data:image/png;base64,{source}">' if image else ""
        first = f"<p><b>{html.escape(self._headline())}</b></p>" if self._headline() else ""
        rest = f"<details><summary>details</summary><pre>{html.escape(self.summary())}</pre></details>" if first else ""
        return f"<div>{first}{text}{picture}{rest}</div>"


def _facts_of(label: str, value: Any, unit: str, several: bool) -> Iterator[Fact]:
    """A value as facts: a single one, those of a small record, or one for each of several where these are asked for."""
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, int | float | str):
        yield Fact(label, plain, unit)
    elif isinstance(value, Summarised):
        yield Fact(label, value._headline() if several else "")
    elif is_dataclass(value) and type(value).__str__ is not object.__str__:
        yield Fact(label, str(value))
    elif is_dataclass(value) or hasattr(value, "_fields"):
        for name in getattr(value, "_fields", None) or [f.name for f in fields(value)]:
            if isinstance(item := getattr(value, name), int | float | str):
                yield Fact(f"{label} {spaced(name)}", item, UNITS.get(name, ""))
    elif several and isinstance(value, np.ndarray):
        yield Fact(label, len(value))
    elif several and isinstance(value, Mapping):
        yield from (Fact(f"{label} {key}", item, unit) for key, item in value.items())
    elif several and isinstance(value, tuple | list):
        texts = [item._headline() if isinstance(item, Summarised) else str(item) for item in value]
        texts = [", ".join(texts)] if all(isinstance(item, int) for item in value) else texts
        yield from (Fact(f"{label} {i}" if len(texts) > 1 else label, text) for i, text in enumerate(texts, 1))


def _html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    def line(cells: Sequence[str], kind: str) -> str:
        return "<tr>" + "".join(f'<{kind} style="text-align:left">{html.escape(c)}</{kind}>' for c in cells) + "</tr>"

    return "<table>" + (line(head, "th") if head else "") + "".join(line(row, "td") for row in rows) + "</table>"


class Plottable(Summarised):
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

    def _shown(self) -> Any:
        return self


# ---- What differs between two studies or results ----


MISSING = "not there"


@short_repr
@dataclass(frozen=True)
class Differences(Summarised):
    """Differences between two studies or results.

    Parameters
    ----------
    settings : tuple of (name, first, second)
        Settings that differ, those within others by their whole name ("excitation.amplitude").
    outcomes : tuple of (first, second)
        What both results say of the same quantity, as ``bdamper.util.display.Fact``, where it differs in the six
        digits that are printed.
    kinds : tuple of two str
        What was compared.
    """

    settings: tuple[tuple[str, Any, Any], ...]
    outcomes: tuple[tuple[Fact, Fact], ...]
    kinds: tuple[str, str]

    def __bool__(self) -> bool:
        return bool(self.settings or self.outcomes)

    def _headline(self) -> str:
        return f"{' and '.join(self.kinds)}{' differ:' if self else ': no difference'}"

    def _rows(self) -> list[tuple[str, ...]]:
        rows = [(name, text_of(a), text_of(b), _change(a, b)) for name, a, b in self.settings]
        rows += [(a.name, a.to_digits(6), b.to_digits(6), _change(a.value, b.value)) for a, b in self.outcomes]
        return [("", "first", "second", "change"), *rows] if rows else []


def _change(a: Any, b: Any) -> str:
    numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in (a, b))
    return percent(b / a - 1.0, True) if numbers and a and np.isfinite([a, b]).all() else ""


class Comparable(Summarised):
    """A study or a result that can be compared with another one; a mixin."""

    def compare(self, other: Any) -> Differences:
        """Differences between this and another study or result: settings, model and values.

        Parameters
        ----------
        other : Study, ResponseCurve, OptimalCurve, ...
            What two of different kinds come to is not compared, but their settings are.

        Returns
        -------
        Differences
            Prints a line for each; the change is from this to the other.  False if there is none.

        Raises
        ------
        SettingError
            If the other is neither.
        """
        if not isinstance(other, Comparable):
            raise SettingError(f"other: expected a study or a result to compare with, found a {type(other).__name__}")
        same = type(self) is type(other)
        own, others = (one._asked() for one in (self, other))
        # results of different kinds have settings of their own beside those of the study
        names = own.keys() | others.keys() if same else own.keys() & others.keys()
        first, second = (_flat({k: v for k, v in one.items() if k in names}) for one in (own, others))
        settings = tuple(
            (name, first.get(name, MISSING), second.get(name, MISSING))
            for name in dict.fromkeys([*first, *second])
            if first.get(name, MISSING) != second.get(name, MISSING)
        )
        outcomes: tuple[tuple[Fact, Fact], ...] = ()
        if same:
            there = {fact.name: fact for fact in other._outcomes()}
            both = [(fact, there[fact.name]) for fact in self._outcomes() if fact.name in there]
            outcomes = tuple((a, b) for a, b in both if a.to_digits(6) != b.to_digits(6))
        return Differences(settings, outcomes, (type(self).__name__, type(other).__name__))

    def _outcomes(self) -> tuple[Fact, ...]:
        return self._facts()

    def _asked(self) -> dict[str, Any]:
        """Model, except where no problem was asked, and settings."""
        digest = getattr(self, "model_hash", "")
        return ({"model": digest} if digest else {}) | getattr(self, "settings", {})


def _flat(settings: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Settings within settings by names with dots."""
    out: dict[str, Any] = {}
    for name, value in settings.items():
        out |= _flat(value, f"{before}{name}.") if isinstance(value, Mapping) else {f"{before}{name}": value}
    return out
