"""Printed statement of a result: verdict, quantities with remarks, checks, and open points."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from bdamper.util.formatting import table_lines

WIDTH = 88
"""Characters of a printed line, which a terminal, an e-mail, and a manual hold."""
NOT_COVERED = "Not covered"
"""Beginning of the last remark: the effects that the result does not contain."""


class Row(NamedTuple):
    """Quantity with its value and a remark; a row with a further remark has neither name nor value."""

    name: str
    value: str
    remark: str = ""


@dataclass(frozen=True)
class Statement:
    """Printed form of a result.

    The checks have a header.

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
        Time that each check took, "" if it has none of its own.  Without times there is no column.
    """

    verdict: Sequence[str]
    rows: Sequence[Row] = ()
    checks: Sequence[Row] = ()
    remarks: Sequence[str] = ()
    table: Sequence[Sequence[str]] = ()
    times: Sequence[str] = ()

    def with_texts(self, change: Callable[[str], str]) -> Statement:
        """Return the statement with each of its texts changed."""
        return Statement(
            [change(text) for text in self.verdict],
            [Row(*map(change, row)) for row in self.rows],
            [Row(*map(change, row)) for row in self.checks],
            [change(text) for text in self.remarks],
            [[change(cell) for cell in cells] for cells in self.table],
            self.times,
        )

    def with_remark(self, text: str) -> Statement:
        """Return the statement with a further remark before the effects that are not covered."""
        covered = [remark for remark in self.remarks if not remark.startswith(NOT_COVERED)]
        not_covered = [remark for remark in self.remarks if remark.startswith(NOT_COVERED)]
        return replace(self, remarks=[*covered, text, *not_covered])

    def contains(self, text: str) -> bool:
        """Return whether a remark is or begins with a text."""
        return any(remark.lower().startswith(text.lower()) for remark in self.remarks)

    @property
    def text(self) -> str:
        """Lines of at most :data:`WIDTH` characters."""
        parts = [
            _paragraphs(self.verdict),
            _table(self.rows),
            _columns(self.table),
            _table(self._check_table),
            _paragraphs(self.remarks),
        ]
        return "\n\n".join("\n".join(lines) for lines in parts if lines)

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
    def html(self) -> str:
        """The same as paragraphs and tables of a notebook."""
        verdict = "<br>".join(html.escape(text) for text in self.verdict)
        tables = [
            _html_table(table) for table in (self.rows, self.table, self._check_table) if table
        ]
        remarks = [f"<p>{html.escape(text)}</p>" for text in self.remarks]
        return f"<p><b>{verdict}</b></p>{''.join(tables)}{''.join(remarks)}"


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


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
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
