"""Printed statement of a result: verdict, quantities with remarks, checks, and open points."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from bdamper.util.formatting import listed, same_digits, table_lines

WIDTH = 88
"""Characters of a printed line, which a terminal, an e-mail, and a manual hold."""
NOT_COVERED = "Not covered"
"""Beginning of the last remark: the effects that the result does not contain."""
NEXT = "Next"
"""Name of the row with calls to make."""
_PASS, _UNCERTAIN, _FAIL, _NOT_RUN = "pass", "uncertain", "FAIL", "not run"
"""Outcomes of a check.  The finding of a check that was not run is the call that runs it."""
_OTHER_OUTCOMES = {_UNCERTAIN: "uncertain", _FAIL: "failed"}


class Row(NamedTuple):
    """Quantity with its value and a remark; a row with a further remark has neither name nor value."""

    name: str
    value: str
    remark: str = ""


@dataclass(frozen=True)
class Statement:
    """Printed form of a result.

    A check that was not run becomes a call to make.

    Parameters
    ----------
    verdict : sequence of str
        The answer and its subject, or every reason why there is no answer.
    rows : sequence of Row
    checks : sequence of Row
        Name, outcome and finding of each check.
    remarks : sequence of str
        Sentences after the tables: doubts, a remedy, effects that are not covered.
    table : sequence of sequence of str
        Header and rows of values that belong together, for example one row for each study; printed
        between rows and checks.
    times : sequence of str
        Time that each check took, or would take if it was not run; "" if unknown.  Without times
        there is no column.
    further : sequence of str
        Calls to make, in addition to checks that were not run: "what: call".
    details : sequence of Row
        Quantities and findings for reference, at the end.
    """

    verdict: Sequence[str]
    rows: Sequence[Row] = ()
    checks: Sequence[Row] = ()
    remarks: Sequence[str] = ()
    table: Sequence[Sequence[str]] = ()
    times: Sequence[str] = ()
    further: Sequence[str] = ()
    details: Sequence[Row] = ()

    @property
    def _even_table(self) -> Sequence[Sequence[str]]:
        """The table with equally many digits in each column."""
        if len(self.table) < 2:
            return self.table
        head, *rows = self.table
        return [head, *zip(*(same_digits(column) for column in zip(*rows)))]

    def with_texts(self, change: Callable[[str], str]) -> Statement:
        """Return the statement with each of its texts changed."""
        return Statement(
            [change(text) for text in self.verdict],
            [Row(*map(change, row)) for row in self.rows],
            [Row(*map(change, row)) for row in self.checks],
            [change(text) for text in self.remarks],
            [[change(cell) for cell in cells] for cells in self.table],
            self.times,
            [change(text) for text in self.further],
            [Row(*map(change, row)) for row in self.details],
        )

    def with_next(self, text: str) -> Statement:
        """Return the statement with a further call to make, which is printed under "Next"."""
        return replace(self, further=[*self.further, text])

    def contains(self, text: str) -> bool:
        """Return whether a remark is or begins with a text."""
        return any(remark.lower().startswith(text.lower()) for remark in self.remarks)

    @property
    def text(self) -> str:
        """Lines of at most :data:`WIDTH` characters, with one line for the checks that passed."""
        shown = self._shown_checks
        closing = self._closing_rows
        # all names have the same column
        names = [row.name for row in (*self.rows, *shown, *closing)]
        width = max(map(len, names), default=0) + 2
        parts = [
            _paragraphs(self.verdict),
            _table(self.rows, width),
            _columns(self._even_table),
            [*_paragraphs(self._counted_checks), *_table(shown, width)],
            _paragraphs(self._sentences),
            _table(closing, width),
            _table(self.details),
        ]
        return _joined(parts)

    @property
    def full_text(self) -> str:
        """The same with a row for each check below a header."""
        parts = [
            _paragraphs(self.verdict),
            _table(self.rows),
            _columns(self._even_table),
            _last_wrapped(self._check_table),
            _paragraphs(self._sentences),
            _table(self._not_covered_rows),
            _table(self.details),
        ]
        return _joined(parts)

    @property
    def _check_table(self) -> list[tuple[str, ...]]:
        """Checks below their header, with their times if one has a time; empty without checks."""
        if not self.checks:
            return []
        rows: list[tuple[str, ...]] = [("Check", "Result", "Finding"), *self.checks]
        if not any(self.times):
            return rows
        times = ["Time", *self.times]
        return [
            (name, result, taken, finding) for (name, result, finding), taken in zip(rows, times)
        ]

    @property
    def _shown_checks(self) -> list[Row]:
        """Checks with a row: all that did not pass, and one that passed alone."""
        left_out = {_NOT_RUN, _PASS} if self._counted_checks else {_NOT_RUN}
        shown = []
        for check, taken in self._timed_checks:
            if check.value not in left_out:
                remark = f"{check.remark} ({taken})" if taken else check.remark
                shown.append(check._replace(remark=remark))
        return shown

    @property
    def _timed_checks(self) -> list[tuple[Row, str]]:
        """Each check with the time that it took, "" if that is unknown."""
        return list(zip(self.checks, self.times or [""] * len(self.checks), strict=True))

    @property
    def _counted_checks(self) -> list[str]:
        """The numbers of checks that passed, with their times, are uncertain, or failed.

        Empty unless several passed.
        """
        outcomes = [check.value for check in self.checks]
        n_passed = outcomes.count(_PASS)
        if n_passed < 2:
            return []
        times = []
        for check, taken in self._timed_checks:
            if taken and check.value == _PASS:
                times.append(f"{_in_sentence(check.name)} {taken}")
        parts = [f"{n_passed} checks passed" + (f" ({', '.join(times)})" if times else "")]
        for outcome, word in _OTHER_OUTCOMES.items():
            n = outcomes.count(outcome)
            if n:
                parts.append(f"{n} {word}")
        return [", ".join(parts)]

    @property
    def _sentences(self) -> list[str]:
        """Remarks without the effects that are not covered."""
        return [remark for remark in self.remarks if not remark.startswith(NOT_COVERED)]

    @property
    def _not_covered_rows(self) -> list[Row]:
        """Row of the effects that are not covered; empty without such a remark."""
        found = [remark for remark in self.remarks if remark.startswith(NOT_COVERED)]
        return [Row(NOT_COVERED, text.removeprefix(NOT_COVERED).lstrip(": ")) for text in found]

    @property
    def _closing_rows(self) -> list[Row]:
        """Effects that are not covered, and calls to make, first of checks that were not run."""
        rows = self._not_covered_rows
        # one call may run several checks
        names_of_call: dict[str, list[str]] = {}
        time_of_call: dict[str, str] = {}
        for check, expected in self._timed_checks:
            if check.value == _NOT_RUN:
                names_of_call.setdefault(check.remark, []).append(_in_sentence(check.name))
                time_of_call[check.remark] = expected or time_of_call.get(check.remark, "")
        calls = []
        for call, names in names_of_call.items():
            together = ", by one call" if len(names) > 1 else ""
            expected = time_of_call[call]
            price = f", {expected}" if expected else ""
            calls.append(f"{listed(names)}{together}{price}: {call}")
        for i, call in enumerate([*calls, *self.further]):
            rows.append(Row("" if i else NEXT, call))
        return rows

    @property
    def html(self) -> str:
        """The same as paragraphs and tables of a notebook."""
        parts = [f"<p><b>{html.escape(text)}</b></p>" for text in self.verdict]
        parts += [_html_table(table) for table in (self.rows, self._even_table) if table]
        parts += [f"<p>{html.escape(text)}</p>" for text in self._counted_checks]
        if self._shown_checks:
            parts.append(_html_table(self._shown_checks))
        parts += [f"<p>{html.escape(text)}</p>" for text in self._sentences]
        if self._closing_rows:
            parts.append(_html_table(self._closing_rows))
        if self.details:
            parts.append(_html_table(self.details))
        return "".join(parts)


class Checks(tuple[Row, ...]):
    """Checks of a result: name, outcome, and finding of each; ``print`` shows one on each line."""

    __slots__ = ()

    def __str__(self) -> str:
        return "\n".join(_table(self)) if self else "no checks"


# replaces the space between a number and its unit: no line breaks there
_NO_BREAK = "\0"


def _wrapped(text: str, width: int = WIDTH, indent: str = "  ") -> list[str]:
    """Return the lines of a text, without a break between a number and its unit."""
    words = text.split(" ")
    kept = words[0]
    for before, word in zip(words, words[1:]):
        is_short = len(word.rstrip(",;:.")) <= 3 or word == "rad/s"
        is_unit = before[-1:].isdigit() and is_short
        kept += (_NO_BREAK if is_unit else " ") + word
    lines = textwrap.wrap(kept, width, subsequent_indent=indent, break_long_words=False)
    return [line.replace(_NO_BREAK, " ") for line in lines]


def _paragraphs(texts: Sequence[str]) -> list[str]:
    """Return the lines of several texts."""
    return [line for text in texts for line in _wrapped(text)]


def _columns(table: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table; long texts in its last column are wrapped there."""
    # a column without texts below its head is empty
    columns = [column for column in zip(*table) if any(column[1:])]
    widths = [max(map(len, column)) + 2 for column in columns]
    width_left = WIDTH - sum(widths[:-1])
    fits = not widths or widths[-1] - 2 <= width_left
    if not fits and len(table) == 2 and width_left < 25:
        # a single record: its columns become rows
        return _table([Row(head, text) for head, text in columns])
    # in a narrow column, texts would have many lines
    if fits or width_left < 25:
        return table_lines(table, width=WIDTH)
    lines = []
    for *cells, text in zip(*columns):
        start = "".join(f"{cell:<{width}}" for cell, width in zip(cells, widths))
        lines += _beside(start, _wrapped(text, width_left, indent=""))
    return lines


def _beside(start: str, texts: Sequence[str]) -> list[str]:
    """Return the texts as lines, the first after ``start`` and the others indented by its width."""
    if not texts:
        return [start]
    first, *further = texts
    return [start + first, *(" " * len(start) + text for text in further)]


def _joined(parts: Sequence[Sequence[str]]) -> str:
    """Return the parts with lines, separated by empty lines."""
    return "\n\n".join("\n".join(lines) for lines in parts if lines)


def _in_sentence(name: str) -> str:
    """Return a name as it stands within a sentence."""
    return f"{name[:1].lower()}{name[1:]}"


def _table(rows: Sequence[Row], name_width: int = 0) -> list[str]:
    """Return the lines of rows; the name has at least ``name_width`` characters."""
    name_width = max([name_width, *(len(row.name) + 2 for row in rows)])
    # a value without a remark may be a long text
    value_width = max((len(row.value) + 2 for row in rows if row.remark), default=0)
    return [line for row in rows for line in _lines(row, (name_width, value_width))]


def _lines(row: Row, widths: Sequence[int]) -> list[str]:
    """Return the lines of a row, with the value or the remark wrapped in its column."""
    name = f"{row.name:<{widths[0]}}"
    if not row.remark:
        value = _wrapped(row.value, max(WIDTH - len(name), 30), indent="")
        return [line.rstrip() for line in _beside(name, value)]
    start = f"{name}{row.value:<{widths[1]}}"
    remark = _wrapped(row.remark, max(WIDTH - len(start), 30), indent="")
    return [line.rstrip() for line in _beside(start, remark)]


def _last_wrapped(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of rows, with the last text of each wrapped in its column."""
    columns = [*zip(*rows)][:-1]
    widths = [max(map(len, column)) + 2 for column in columns]
    lines = []
    for *texts, last in rows:
        start = "".join(f"{text:<{width}}" for text, width in zip(texts, widths))
        remark = _wrapped(last, max(WIDTH - len(start), 30), indent="")
        lines += [line.rstrip() for line in _beside(start, remark)]
    return lines


def _html_table(rows: Sequence[Sequence[str]]) -> str:
    cell = '<td style="text-align:left">{}</td>'
    lines = [f"<tr>{''.join(cell.format(html.escape(text)) for text in row)}</tr>" for row in rows]
    return f"<table>{''.join(lines)}</table>"
