"""Cards of Nastran bulk data: lines, included files, the three formats, and values of fields.

A card is a name and data fields over one or more lines.  A line has eight fields of eight columns,
four fields of 16 columns if an asterisk marks it, or fields between commas.  Columns 73 to 80, or
the tenth field, may carry a label that the following line of the card repeats.

References
----------
MSC, *Nastran Quick Reference Guide*, "Bulk Data Entries: Format of Bulk Data Entries".
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from bdamper.importers.fe_body import LARGEST_COUNT, Included
from bdamper.util.errors import check, mismatch
from bdamper.util.storage import FilePath

_REAL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[ED]?([+-]?\d+))?", re.IGNORECASE)
_WIDTH, _LARGE_WIDTH, _LABEL_COLUMN, _LAST_COLUMN = 8, 16, 72, 80


@dataclass(frozen=True)
class Card:
    """Card of bulk data.

    Parameters
    ----------
    name : str
        In capitals, without the asterisk of the large format.
    fields : tuple of str
        Data fields after the name, over all lines, without surrounding blanks.
    item : str
        File, name and line, for messages.
    text : str
        Beginning of the first line, for messages.
    """

    name: str
    fields: tuple[str, ...]
    item: str
    text: str

    def word(self, k: int) -> str:
        """Return field ``k`` in capitals, counted from 0 after the name; empty if absent."""
        return self.fields[k].upper() if k < len(self.fields) else ""

    def integer(self, k: int, default: int | None = None) -> int:
        """Return an integer; ``default`` if the field is blank.

        Raises
        ------
        ModelError
            If the field is no integer, or blank without a default.
        """
        word = self.word(k)
        if not word and default is not None:
            return default
        if re.fullmatch(r"[+-]?\d{1,18}", word) is None:
            raise mismatch(self.item, f"an integer in field {k + 2}", f"'{word}'")
        return int(word)

    def real(self, k: int, default: float | None = None) -> float:
        """Return a number; ``default`` if the field is blank.

        The exponent may lack its letter, as in ``2.1+11``.

        Raises
        ------
        ModelError
            If the field is no number, or blank without a default.
        """
        word = self.word(k)
        if not word and default is not None:
            return default
        number = _REAL.fullmatch(word)
        if number is None:
            raise mismatch(self.item, f"a number in field {k + 2}", f"'{word}'")
        return float(f"{number[1]}e{number[2] or 0}")

    def optional_real(self, k: int) -> float | None:
        """Return a number, or None if the field is blank."""
        return self.real(k) if self.word(k) else None

    def integers(self, start: int, end: int | None = None) -> list[int]:
        """Return the integers from field ``start`` to before ``end``, by default the last field.

        Ranges such as ``1 THRU 9 BY 2`` are expanded, and blank fields are skipped.

        Raises
        ------
        ModelError
            If a field is neither an integer nor part of a range.
        """
        places = [k for k in range(len(self.fields))[start:end] if self.word(k)]
        numbers: list[int] = []
        position = 0
        while position < len(places):
            if self.word(places[position]) != "THRU":
                numbers.append(self.integer(places[position]))
                position += 1
                continue
            complete = bool(numbers) and position + 1 < len(places)
            check(complete, self.item, "numbers before and after THRU", "one missing")
            first, last = numbers.pop(), self.integer(places[position + 1])
            position += 2
            step = 1
            if position + 1 < len(places) and self.word(places[position]) == "BY":
                step = self.integer(places[position + 1])
                position += 2
            plausible = step > 0 and 0 <= last - first <= LARGEST_COUNT // 100
            check(plausible, self.item, "an ascending range", f"{first} THRU {last} BY {step}")
            numbers += range(first, last + 1, step)
        return numbers


class _Line(NamedTuple):
    """Line of a file, without its comment."""

    file: Path
    number: int
    text: str


class _Split(NamedTuple):
    """Line divided into fields.

    Parameters
    ----------
    head : str
        First field: a name, or a label or nothing in a line that continues a card.
    data : list of str
        Eight fields, or four in the large format.
    label : str
        Label for the following line.
    """

    head: str
    data: list[str]
    label: str

    @property
    def continues(self) -> bool:
        """Whether the line continues a card."""
        return self.head == "" or self.head.startswith(("+", "*"))


def read_cards(source: Path, include_folder: FilePath | None = None) -> list[Card]:
    """Return the cards of the bulk data section of a file and its included files.

    Parameters
    ----------
    source : Path
    include_folder : path-like, optional
        Further folder from which files may be included.

    Raises
    ------
    ModelError
        If a line belongs to no card, or lines of a card are not in their order.
    """
    lines = _bulk_section(_with_included(source, Included(include_folder)), source)
    groups: list[list[tuple[_Line, _Split]]] = []
    for line in lines:
        split = _split(line)
        if not split.continues:
            groups.append([(line, split)])
            continue
        item = _item(line)
        check(bool(groups), item, "the name of a card", f"'{line.text.strip()[:40]}'")
        expected_label = _plain_label(groups[-1][-1][1].label)
        label = _plain_label(split.head)
        in_order = not label or not expected_label or label == expected_label
        expected = f"the continuation '{expected_label}' of the line before"
        check(in_order, item, expected, f"'{label}'")
        groups[-1].append((line, split))
    return [_card(group) for group in groups]


def _card(group: list[tuple[_Line, _Split]]) -> Card:
    line, first = group[0]
    fields: list[str] = []
    for _, split in group:
        fields += split.data
    while fields and not fields[-1]:
        fields.pop()
    name = first.head.rstrip("*").rstrip().upper()
    text = " ".join(line.text.split())
    return Card(name, tuple(fields), f"{line.file}: {name} in line {line.number}", text[:40])


def _item(line: _Line) -> str:
    return f"{line.file}: line {line.number}"


def _plain_label(label: str) -> str:
    """Return a label without the mark of its format and without blanks."""
    return "".join(label.split()).lstrip("+*")


def _split(line: _Line) -> _Split:
    """Divide a line into fields."""
    text = line.text.expandtabs(_WIDTH)
    if "," in text:
        head, *data = [word.strip() for word in text.split(",")]
        n_data = 4 if "*" in head else 8
        rest = data[n_data:]
        check(not any(rest[1:]), _item(line), f"at most {n_data} fields of data", len(data))
        data = data[:n_data]
        return _Split(head, data + [""] * (n_data - len(data)), rest[0] if rest else "")
    head = text[:_WIDTH].strip()
    width = _LARGE_WIDTH if "*" in head else _WIDTH
    starts = range(_WIDTH, _LABEL_COLUMN, width)
    data = [text[start : start + width].strip() for start in starts]
    return _Split(head, data, text[_LABEL_COLUMN:_LAST_COLUMN].strip())


def _bulk_section(lines: Iterable[_Line], source: Path) -> list[_Line]:
    """Return the lines of bulk data that are not blank, up to ENDDATA."""
    filled = [line for line in lines if line.text.strip()]
    begins = [k for k, line in enumerate(filled) if _starts(line, r"BEGIN\s+BULK\b")]
    has_case_control = any(_starts(line, r"CEND\b") for line in filled)
    # bulk data without a case control section may or may not begin with this line
    expected = "a line BEGIN BULK after CEND"
    check(bool(begins) or not has_case_control, str(source), expected, "none")
    start = begins[0] + 1 if begins else 0
    section = []
    for line in filled[start:]:
        if _starts(line, r"ENDDATA\b"):
            break
        section.append(line)
    return section


def _starts(line: _Line, pattern: str) -> bool:
    return re.match(r"\s*" + pattern, line.text, re.IGNORECASE) is not None


def _with_included(source: Path, included: Included, depth: int = 0) -> Iterator[_Line]:
    """Iterate over the lines of a file, with included files inserted."""
    text = source.read_text(encoding="latin-1")
    for number, full_line in enumerate(text.splitlines(), 1):
        include = re.match(r"\s*INCLUDE\b\s*(.*)", full_line, re.IGNORECASE)
        if include is None:
            yield _Line(source, number, full_line.split("$")[0])
            continue
        item = f"{source}: INCLUDE in line {number}"
        written = include[1].strip()
        # in quotation marks of either kind, or without
        name = re.fullmatch(r"(?:'([^']+)'|\"([^\"]+)\"|([^\s'\"]+))\s*(?:\$.*)?", written)
        check(name, item, "the name of a file in one line", f"'{written[:60]}'")
        assert name is not None
        path = included.path(name[name.lastindex or 0], source, depth, item)
        yield from _with_included(path, included, depth + 1)
