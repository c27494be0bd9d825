"""Printed summaries, notebook output, figures and comparisons of results.

Results do not depend on matplotlib.  Each drawing function of :mod:`bdamper.plot` registers itself
here by the type that it draws.  When the first figure is drawn,
the modules in the entry points for pictures are imported (pyproject.toml).
"""

from __future__ import annotations

import base64
import html
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache, wraps
from importlib import metadata
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar, cast

import numpy as np

from bdamper.util import validation
from bdamper.util.errors import (
    COMPLETE,
    FAILED,
    BdamperError,
    WithRowStatus,
    WithStatus,
    not_run_lines,
    with_reason,
)
from bdamper.util.formatting import (
    UNITS,
    aligned,
    amount,
    counted,
    percent,
    sentence,
    short_repr,
    spaced,
    table_lines,
    text_of,
)
from bdamper.util.progress import Cost
from bdamper.util.records import names_of
from bdamper.util.statement import Checks, Statement
from bdamper.util.tables import EXTREMES, FEW_ROWS, Quantity, Tabular, is_strain, quantities

# ---- Summaries and figures ----


Drawing = TypeVar("Drawing", bound=Callable[..., Any])

_DRAWINGS: dict[tuple[type, str], Callable[..., Any]] = {}


def register_plot(shown: type, picture: str = "plot") -> Callable[[Drawing], Drawing]:
    """Decorate a function that draws objects of a type.

    Parameters
    ----------
    shown : type
        Type of the first argument.
    picture : str
        Method of the object that calls the function.
    """

    def enter(function: Drawing) -> Drawing:
        @wraps(function)
        def drawing(subject: Any, *arguments: Any, **options: Any) -> Any:
            return function(
                validation.instance(function.__name__, subject, shown), *arguments, **options
            )

        _DRAWINGS[shown, picture] = drawing
        return cast(Drawing, drawing)

    return enter


@cache
def _load_pictures() -> None:
    """Import the modules with pictures, which entry points name so that no lower module imports :mod:`bdamper.plot`."""
    modules = metadata.entry_points(group="bdamper_pictures")
    if not modules:
        raise BdamperError(
            "the installed bdamper does not name its pictures; install it again with 'pip install .'"
        )
    for module in modules:
        module.load()


def draw(shown: Any, picture: str, *arguments: Any, **options: Any) -> Any:
    """Draw an object with the function registered for its type or for a base class.

    Raises
    ------
    TypeError
        If no function is registered for this type and picture.
    """
    _load_pictures()
    for kind in type(shown).__mro__:
        if (kind, picture) in _DRAWINGS:
            return _DRAWINGS[kind, picture](shown, *arguments, **options)
    raise TypeError(f"there is no picture '{picture}' of {type(shown).__name__}")


class Fact(NamedTuple):
    """Row of a summary: name, number or text, and unit."""

    name: str
    value: float | int | str
    unit: str = ""

    @property
    def known(self) -> bool:
        """Whether the value is neither NaN nor an empty text, nor the status "complete", which needs no line."""
        return str(self.value) not in ("", "nan", COMPLETE)

    @property
    def text(self) -> str:
        """Value with three digits and its unit."""
        return self.to_digits(3)

    def to_digits(self, digits: int) -> str:
        """Return the value with the given number of digits and its unit."""
        if isinstance(self.value, float):
            return amount(self.value, self.unit, digits)
        return f"{self.value} {self.unit}".rstrip()


SUMMARY_CALL = re.compile(r"\b\w+\.summary\(\)")
"""Call in a printed result that returns all of its values."""
SHOWN_ROWS = 8
"""Rows of a table that ``print`` shows; ``summary()`` shows all."""


class Summarised:
    """Mixin of results that print a summary.

    The text begins with :meth:`_headline`, followed by a few lines from :meth:`_facts` or
    :meth:`summary`.  A notebook shows the same lines, a figure, and the complete summary in a
    collapsed section.
    """

    _summary_fields: tuple[str, ...] = ()
    _called: ClassVar[str] = "result"
    """Name of the object in the calls that it prints."""
    _states_all: ClassVar[bool] = False
    """Whether the statement contains all values, so that ``print`` need not mention ``summary``."""

    def _headline(self) -> str:
        """Return the main result in one line: the verdict of the statement."""
        statement = self._printed_statement()
        return "" if statement is None else "; ".join(statement.verdict)

    def _statement(self) -> Statement | None:
        """Return the printed statement; None prints headline and values."""
        return None

    @property
    def _all_values(self) -> str:
        """Call to make after a printed result that does not contain all of its values."""
        return f"all values: {self._called}.summary()"

    def _facts(self) -> tuple[Fact, ...]:
        """Return the most important values: the fields of ``_summary_fields``, in order."""
        shown = [name for name in self._summary_fields if name not in self._unprinted()]
        return tuple(fact for name in shown for fact in self._facts_of_field(name, several=True))

    def _unprinted(self) -> tuple[str, ...]:
        """Return the names of fields that are not printed as values."""
        return "cost", "made_with"

    def _facts_of_field(self, name: str, several: bool = False) -> Iterator[Fact]:
        """Yield the rows for a field or property; a name with dots selects an attribute of it.

        Arrays and None give no row, unless ``several``.
        """
        mark = quantities(cast(Any, type(self))).get(name, Quantity())
        *path, last = name.split(".")
        owner: Any = self
        for part in path:
            owner = getattr(owner, part, None)
        value: Any = getattr(owner, last, None)
        if last.endswith("status") and isinstance(value, str):
            value = with_reason(value, getattr(owner, _reason_of(last), ""))
        if mark.parts and np.ndim(value) == 1:
            # fractions of the cycle, in per cent
            percents = [round(100.0 * float(share), 1) for share in value]
            return (Fact(part, share, "%") for part, share in zip(mark.parts, percents))
        unit = mark.unit or UNITS.get(last, "")
        return _facts_of(spaced(mark.name or name), value, unit, several=several)

    def summary(self) -> str:
        """Return all values of the result as text.

        It contains the headline, single values, a short table, notes, warnings and the cost.
        """
        if not self._headline():
            return str(self)
        values = [(fact.name, fact.to_digits(6)) for fact in self._all_facts()]
        table = table_lines(self._rows(), "  ")
        texts = self._remark_lines()
        statement = self._printed_statement()
        if statement is None:
            first = self._headline()
        else:
            # the whole table of a tabular result follows below
            shown = replace(statement, table=()) if table else statement
            first = f"{shown.full_text}\n"
            texts = [text for text in texts if not statement.contains(text)]
        lines = [first, *aligned(values, "  "), *table, *texts, self._cost_text()]
        return self._in_unit_of_response("\n".join(line for line in lines if line))

    def _all_facts(self) -> list[Fact]:
        """Return the most important values, then the other fields."""
        facts = [fact for fact in self._facts() if fact.known]
        printed = {"model hash", *(fact.name for fact in facts)}
        all_fields = fields(cast(Any, self))
        # a reason is printed with its status
        reasons = {_reason_of(field.name) for field in all_fields}
        for field in all_fields:
            name = field.name
            has_default = isinstance(field.default, int | float | str)
            is_default = has_default and getattr(self, name) == field.default
            if name in self._unprinted() or name in reasons or (is_default and name != "status"):
                continue
            for fact in self._facts_of_field(name):
                if fact.known and fact.name not in printed:
                    facts.append(fact)
        return facts

    def _remark_lines(self) -> list[str]:
        """Return the first remarks, the number of the others, and the rows that were lost."""
        remarks = self._remarks()
        lines = remarks[:FEW_ROWS]
        if len(remarks) > FEW_ROWS:
            lines.append(counted(len(remarks) - FEW_ROWS, "further remark"))
        if isinstance(self, WithRowStatus):
            lines += not_run_lines(self.status, self.reason, "parts")
            reasons = [
                reason for status, reason in zip(self.status, self.reason) if status == FAILED
            ]
            # each reason once, in the order of the rows
            for reason in dict.fromkeys(reasons):
                lines.append(with_reason(FAILED, reason))
        return lines

    def _cost_text(self) -> str:
        """Return the cost as text, added up over all parts."""
        cost = getattr(self, "cost", "")
        # a structured array with the cost of each part
        if isinstance(cost, np.ndarray):
            totals = {name: sum(cost[name].tolist()) for name in names_of(cost)}
            cost = Cost(**totals)
        return str(cost or "").strip()

    def _remarks(self) -> list[str]:
        """Return the different notes and warnings, which the complete summary prints."""
        remarks = [*getattr(self, "notes", ()), *getattr(self, "warnings", ())]
        return [remark for remark in dict.fromkeys(remarks) if remark]

    def _in_unit_of_response(self, text: str) -> str:
        """Return a text whose lengths are strains if the response of the result is one: m/m."""
        if not is_strain(self):
            return text
        return re.sub(r"(?<=[\d)] )([pnµm]?m)(?![\w/])", r"\1/m", text)

    def _printed_statement(self) -> Statement | None:
        statement = self._statement()
        return None if statement is None else statement.with_texts(self._in_unit_of_response)

    def __str__(self) -> str:
        statement = self._printed_statement()
        if statement is not None and self._states_all:
            return statement.text
        if statement is not None:
            return statement.with_next(self._all_values).text
        headline = self._in_unit_of_response(self._headline())
        # a null character, at which no line is broken, holds a number and its unit together
        with_nulls = re.sub(r"(\d) (?=(?:\S{1,2}|[kMG]Pa|rad/s)\b)", "\\1\0", headline)
        first = textwrap.fill(with_nulls, width=100).replace("\0", " ")

        # single values have rows of a name and a text, a tabular result has more columns
        rows = [row for row in self._table() if row]
        is_tabular = bool(rows) and len(rows[0]) > 2
        # the header of a table and the first rows
        n_shown = SHOWN_ROWS + 1
        last = sentence(self._all_values)
        if len(rows) > n_shown:
            last = f"{counted(len(rows) - n_shown, 'further row')}; {last}"
        lines = table_lines(rows[:n_shown]) if is_tabular else aligned(rows[:n_shown])
        if not lines:
            _, *after_headline = self.summary().split("\n")
            # without the line of the cost
            lines = [line for line in after_headline if " of the processor: " not in line]
            lines = lines[:n_shown]
        shown = [*lines, last]
        rest = "\n".join(f"  {line.removeprefix('  ')}" for line in shown)
        return f"{first}\n{self._in_unit_of_response(rest)}"

    def _few_rows(self) -> tuple[list[tuple[str, ...]], list[str]]:
        """Return the header and the first rows, and a remark that counts the others."""
        return self._first_rows(self._rows())

    def _first_rows(self, rows: list[tuple[str, ...]]) -> tuple[list[tuple[str, ...]], list[str]]:
        """Return the header and the first rows of a table, and a remark that counts the others."""
        shown = rows[: SHOWN_ROWS + 1]
        remarks = []
        # a long table is reduced to the extremes of its columns
        if rows and rows[0][1:] == EXTREMES:
            remarks.append("Smallest and largest values belong to different points")
        elif len(shown) < len(rows):
            n_further = counted(len(rows) - len(shown), "further row")
            remarks.append(f"{n_further} in {self._called}.summary()")
        return shown, remarks

    def _rows(self) -> list[tuple[str, ...]]:
        """Return the header and rows of the table of a tabular result; otherwise an empty list."""
        return self.as_rows() if isinstance(self, Tabular) else []

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Answer a misspelt attribute, or one of another result."""
            raise validation.UnknownAttribute(self, name, _owners)

    def _table(self) -> list[tuple[str, ...]]:
        """Return the header, which may be empty, and the rows of the short output."""
        facts = [(fact.name, fact.text) for fact in self._facts() if fact.known]
        return [(), *facts] if facts else self._rows() or [()]

    def _shown(self) -> Any:
        """Return the object to draw; None for no figure."""
        return None

    def _repr_html_(self) -> str:
        headline = html.escape(self._headline())
        head, *rows = self._table()
        table = _html_table(head, rows) if rows else ""
        statement = self._printed_statement()
        if statement is not None:
            text = statement.html
        elif headline:
            text = f"<p><b>{headline}</b></p>{table}"
        else:
            text = table or f"<pre>{html.escape(str(self))}</pre>"

        details = ""
        if statement is not None or headline:
            summary = html.escape(self.summary())
            details = f"<details><summary>details</summary><pre>{summary}</pre></details>"
        return f"<div>{text}{self._html_picture()}{details}</div>"

    def _html_picture(self) -> str:
        """Return the picture of a notebook; "" if the text says why there is nothing to draw."""
        shown = self._shown()
        if shown is None:
            return ""
        try:
            image = draw(shown, "image")
        except BdamperError:
            return ""
        source = base64.b64encode(image).decode()
        return f'<img src="data:image/png;base64,{source}">' if image else ""


def _reason_of(status: str) -> str:
    """Return the name of the field with the reason for a status: "reason", "search_reason"."""
    return f"{status.removesuffix('status')}reason" if status.endswith("status") else ""


def in_unit_of_response(shown: Summarised, statement: Statement) -> Statement:
    """Return a printed statement in the unit of the response.

    If the response is a strain, all lengths are converted to strains.
    """
    return statement.with_texts(shown._in_unit_of_response)


def _owners(name: str) -> str:
    """Return "; A and B have it" for an attribute of other results; an empty text if none has it."""
    owners = {}
    for kind in _kinds(Summarised):
        # a class with several result classes as bases occurs several times
        if name in dir(kind) or name in getattr(kind, "__dataclass_fields__", ()):
            owners[kind.__name__] = kind
    if not owners:
        return ""
    first_three = list(owners)[:3]
    verb = "has" if len(owners) == 1 else "have"
    return f"; {' and '.join(first_three)} {verb} it"


def _kinds(of: type[Any]) -> Iterator[type[Any]]:
    """Yield all subclasses, direct and indirect."""
    for kind in of.__subclasses__():
        yield kind
        yield from _kinds(kind)


def _has_own_text(value: object) -> bool:
    """Return whether a dataclass has its own text; the text of Python lists its fields.

    A table of the fields is no such text.
    """
    has_text = is_dataclass(value) and type(value).__str__ is not object.__str__
    return has_text and not getattr(value, "prints_fields", False)


def _facts_of(label: str, value: Any, unit: str, several: bool) -> Iterator[Fact]:
    """Yield rows for a value: one for a single value, one for each field of a small record.

    With ``several``, arrays give their length, and mappings and sequences a row for each item.
    Other values, such as None, give no row.
    """
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, int | float | str):
        yield Fact(label, plain, unit)
    elif isinstance(value, Summarised):
        # another result has a headline; a row without text is not printed
        yield Fact(label, value._headline() if several else "")
    elif _has_own_text(value):
        yield Fact(label, str(value))
    elif is_dataclass(value) or hasattr(value, "_fields"):
        # the names of a named tuple, or of a dataclass
        names = getattr(value, "_fields", None) or [field.name for field in fields(value)]
        for name in names:
            item = getattr(value, name)
            # nested records and arrays are left out
            if isinstance(item, int | float | str):
                yield Fact(f"{label} {spaced(name)}", item, UNITS.get(name, ""))
    elif several and isinstance(value, np.ndarray):
        yield Fact(label, len(value))
    elif several and isinstance(value, Mapping):
        for key, item in value.items():
            yield Fact(f"{label} {key}", item, unit)
    elif several and isinstance(value, tuple | list):
        yield from _facts_of_items(label, value)


def _facts_of_items(label: str, items: Sequence[Any]) -> Iterator[Fact]:
    """Yield a numbered row for each item; whole numbers, or a single item, have one row."""
    texts = [item._headline() if isinstance(item, Summarised) else str(item) for item in items]
    if all(isinstance(item, int) for item in items):
        yield Fact(label, ", ".join(texts))
    elif len(texts) == 1:
        yield Fact(label, texts[0])
    else:
        for i, text in enumerate(texts, 1):
            yield Fact(f"{label} {i}", text)


def _html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in HTML; the header may be empty."""

    def line(texts: Sequence[str], tag: str) -> str:
        """Return a row with cells of a tag: th in the header, td below."""
        cells = [f'<{tag} style="text-align:left">{html.escape(text)}</{tag}>' for text in texts]
        return f"<tr>{''.join(cells)}</tr>"

    lines = [line(head, "th")] if head else []
    lines += [line(row, "td") for row in rows]
    return f"<table>{''.join(lines)}</table>"


class Plottable(Summarised):
    """Mixin of objects with a figure."""

    def plot(self, path: str | PathLike[str] | None = None, **options: Any) -> Any:
        """Draw the object with the function of :mod:`bdamper.plot` that the docstring of its class names.

        Parameters
        ----------
        path : path-like, optional
            File for the figure, for example "curve.png", "curve.pdf" or "curve.svg".
        options
            Options of that function, for example ``ax=`` for existing axes or the figure of another
            result.

        Returns
        -------
        matplotlib.figure.Figure
            Figure with its axes.
        """
        return draw(self, "figure", "plot", path, **options)

    def _shown(self) -> Any:
        return self


class InContact(Plottable):
    """Mixin of solutions with contact states."""

    def plot_contacts(
        self, study: object = None, path: str | PathLike[str] | None = None, **options: Any
    ) -> Any:
        """Draw the state of every contact face over the cycle (:func:`bdamper.plot.plot_contacts`).

        Parameters
        ----------
        study : Study, optional
            Study of the result; it can be omitted only for a static state.
        path : path-like, optional
            File for the figure.
        options
            Options of that function, for example ``point=`` for another solution of a curve.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return draw(self, "figure", "plot_contacts", path, study, **options)


# ---- Comparison of studies and results ----


MISSING = "not there"


@short_repr
@dataclass(frozen=True)
class Differences(Summarised):
    """Differences between two studies or results.

    Parameters
    ----------
    settings : tuple of (name, first, second)
        Settings that differ; nested settings have names with dots ("excitation.amplitude").
    outcomes : tuple of (first, second)
        Values (``bdamper.util.display.Fact``) that differ in their six printed digits.
    kinds : tuple of two str
        Types of the compared objects.
    """

    settings: tuple[tuple[str, Any, Any], ...]
    outcomes: tuple[tuple[Fact, Fact], ...]
    kinds: tuple[str, str]

    def __bool__(self) -> bool:
        return bool(self.settings or self.outcomes)

    def _statement(self) -> Statement:
        compared = " and ".join(self.kinds)
        n_differences = len(self.settings) + len(self.outcomes)
        table, remarks = self._few_rows()
        verdict = f"{sentence(counted(n_differences, 'difference'))}: {compared}"
        return Statement([verdict], remarks=remarks, table=table)

    def _rows(self) -> list[tuple[str, ...]]:
        if not self:
            return []
        rows: list[tuple[str, ...]] = [("", "first", "second", "change")]
        for name, first, second in self.settings:
            rows.append((name, text_of(first), text_of(second), _change(first, second)))
        for a, b in self.outcomes:
            rows.append((a.name, a.to_digits(6), b.to_digits(6), _change(a.value, b.value)))
        return rows


def _change(first: Any, second: Any) -> str:
    """Return the relative change of a number, or "" if there is none."""
    for value in (first, second):
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not np.isfinite(value):
            return ""
    return percent(second / first - 1.0, sign=True) if first else ""


class Comparable(Summarised):
    """Base class of studies and results, which can be compared."""

    def diff(self, other: Any) -> Differences:
        """Compare the settings, the model and the values with another study or result.

        Parameters
        ----------
        other : Study, ResponseCurve, OptimalCurve, ...
            Object to compare with. Settings are always compared, and values only if both objects
            have the same type.

        Returns
        -------
        Differences
            Its printed form has one line for each difference, with the change from this object to
            the other. Its truth value is False if nothing differs.

        Raises
        ------
        SettingError
            If the other object is neither a study nor a result.
        """
        if not isinstance(other, Comparable):
            raise validation.invalid("other", "a study or a result", other)
        own = self._asked()
        others = other._asked()
        outcomes = []
        if type(self) is type(other):
            other_facts = {fact.name: fact for fact in other._outcomes()}
            for fact in self._outcomes():
                other_fact = other_facts.get(fact.name)
                if other_fact is not None and fact.to_digits(6) != other_fact.to_digits(6):
                    outcomes.append((fact, other_fact))
        else:
            # results of different types also contain the arguments of their analyses
            common = own.keys() & others.keys()
            own = {name: value for name, value in own.items() if name in common}
            others = {name: value for name, value in others.items() if name in common}

        first = _flat(own)
        second = _flat(others)
        settings = []
        # each name once, in the order of the first object
        for name in dict.fromkeys([*first, *second]):
            before = first.get(name, MISSING)
            after = second.get(name, MISSING)
            if before != after:
                settings.append((name, before, after))
        kinds = (type(self).__name__, type(other).__name__)
        return Differences(tuple(settings), tuple(outcomes), kinds)

    def _outcomes(self) -> tuple[Fact, ...]:
        return self._facts()

    def _asked(self) -> dict[str, Any]:
        """Return the settings and, if the result has one, the model hash."""
        digest = getattr(self, "model_hash", "")
        return ({"model": digest} if digest else {}) | getattr(self, "settings", {})


def _flat(settings: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return nested settings as one mapping, with dots in the names."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{before}{name}.")
        else:
            flat[f"{before}{name}"] = value
    return flat


class WithChecks(Summarised):
    """Mixin of results whose statement has checks."""

    @property
    def checks(self) -> Checks:
        """All checks of the printed result with their findings; ``print`` counts those that passed."""
        statement = self._printed_statement()
        return Checks() if statement is None else Checks(statement.checks)


class Result(WithStatus, WithChecks, Comparable):
    """Base class of results: they print themselves, can be compared, and have ``ok``."""
