"""Matrices of OP4 files of Nastran (OUTPUT4): text or binary, dense or sparse.

A file is a sequence of matrices.  Each matrix has a head (columns, rows, form, type, name), its
columns that are not zero, and a column behind the last one that ends it.  The head of a column is
its number, the row of its first value, and a number of words.  If this row is 0 the column is
sparse: it consists of strings of values in consecutive rows.  The head of a string is

* the number of words plus one, and the row, if the number of rows is negative or above 65,535,
* otherwise one integer, the row + 65,536 times the number of words plus one.

Binary files consist of Fortran records with integers of four bytes.  Real values of single
precision have one word, and of double precision two words.  The two parts of a complex value have
the words of two real values.

References
----------
MSC, *Nastran Quick Reference Guide* and *DMAP Programmer's Guide*, OUTPUT4.
"""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.importers.arrays import square_matrix, triangle_to_full
from bdamper.importers.fe_body import check_count, reader
from bdamper.util.errors import check, mismatch

_WORDS_OF_TYPE = {1: 1, 2: 2, 3: 2, 4: 4}
_COMPLEX_TYPES = (3, 4)
_MOST_SMALL_ROWS = 65535
_STRING_UNIT = 65536
_HEAD_BYTES, _LONG_HEAD_BYTES = 24, 48
_TEXT_HEAD = re.compile(r"\s*(\d+)\s+(-?\d+)\s+(\d+)\s+(\d)(.{0,8})\s*(.*)")
_TEXT_FORMAT = re.compile(r".*?[ED](\d+)\.\d+", re.IGNORECASE)


@dataclass
class _Matrix:
    """Matrix while its columns are read."""

    name: str
    n_rows: int
    n_columns: int
    type: int
    wide_strings: bool
    rows: list[NDArray] = field(default_factory=list)
    columns: list[NDArray] = field(default_factory=list)
    values: list[NDArray] = field(default_factory=list)

    @property
    def words_per_value(self) -> int:
        return _WORDS_OF_TYPE[self.type]

    def add(self, item: str, column: int, first_row: int, values: NDArray) -> None:
        """Add values in consecutive rows of a column, both counted from 1."""
        last_row = first_row + len(values) - 1
        inside = first_row >= 1 and last_row <= self.n_rows
        check(inside, item, f"rows from 1 to {self.n_rows}", f"{first_row} to {last_row}")
        self.rows.append(np.arange(first_row - 1, last_row))
        self.columns.append(np.full(len(values), column - 1))
        self.values.append(values)

    def square(self, item: str) -> sp.csr_matrix:
        """Return the whole matrix."""
        check(self.type not in _COMPLEX_TYPES, item, "a real matrix", "a complex one")
        if not self.values:
            return sp.csr_matrix((self.n_rows, self.n_columns))
        rows, columns = np.concatenate(self.rows), np.concatenate(self.columns)
        values = np.concatenate(self.values).astype(float)
        return square_matrix(triangle_to_full(rows, columns, values, self.n_rows), item)


@reader("an OP4 file")
def read_op4(path: Path) -> dict[str, sp.csr_matrix]:
    """Read the square matrices of an OP4 file into a mapping of their names.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    dict of name to (n, n) sparse

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has no square matrix.
    """
    with open(path, "rb") as file:
        start = file.read(4)
    order = _byte_order(start, path)
    found = list(_text_matrices(path) if order is None else _binary_matrices(path, order))
    square = {}
    for matrix in found:
        if matrix.n_rows == matrix.n_columns:
            square[matrix.name] = matrix.square(f"{path}: {matrix.name}")
    shapes = {matrix.name: (matrix.n_rows, matrix.n_columns) for matrix in found}
    check(bool(square), str(path), "a square matrix", shapes or "no matrix")
    return square


def _new_matrix(item: str, sizes: tuple[int, ...], name: str, largest: int) -> _Matrix:
    """Return a matrix without values from the integers of its head."""
    n_columns, n_rows, _, value_type = sizes
    check(value_type in _WORDS_OF_TYPE, item, "a type of values from 1 to 4", value_type)
    for count in (abs(n_rows), n_columns):
        check_count(count, item, "a size of a matrix", 1, largest)
    wide_strings = n_rows < 0 or n_rows > _MOST_SMALL_ROWS
    return _Matrix(name.strip(), abs(n_rows), n_columns, value_type, wide_strings)


def _largest_size(source: Path) -> int:
    # a small file with a large size is damaged
    return max(1000, os.stat(source).st_size)


# ---- Binary files ----


def _byte_order(start: bytes, source: Path) -> str | None:
    """Return the sign of the byte order in ``struct``, or None for a text."""
    for order in "<>":
        length = struct.unpack(f"{order}i", start)[0] if len(start) == 4 else 0
        if length == _HEAD_BYTES:
            return order
        if length == _LONG_HEAD_BYTES:
            advice = "write the matrices with a version of 32-bit integers, or as a text"
            raise mismatch(str(source), f"integers of four bytes ({advice})", "eight bytes")
    return None


def _records(source: Path, order: str) -> Iterator[bytes]:
    """Iterate over the Fortran records of a file."""
    content = source.read_bytes()
    start = 0
    while start < len(content):
        (length,) = struct.unpack_from(f"{order}i", content, start)
        end = start + 4 + length
        complete = length >= 0 and end + 4 <= len(content)
        item = f"{source}: record at byte {start}"
        check(complete, item, f"{length} bytes", f"{len(content) - start - 4}")
        (closing,) = struct.unpack_from(f"{order}i", content, end)
        check(closing == length, item, f"the length {length} after the record", closing)
        yield content[start + 4 : end]
        start = end + 4


def _binary_matrices(source: Path, order: str) -> Iterator[_Matrix]:
    """Iterate over the matrices of a binary file."""
    records = _records(source, order)
    for number, head in enumerate(records, 1):
        item = f"{source}: matrix {number}"
        check(len(head) == _HEAD_BYTES, item, f"a head of {_HEAD_BYTES} bytes", len(head))
        name = head[16:].decode("ascii", errors="replace")
        sizes = struct.unpack(f"{order}4i", head[:16])
        matrix = _new_matrix(item, sizes, name, _largest_size(source))
        item = f"{source}: {matrix.name}"
        for record in records:
            column, first_row, n_words = struct.unpack(f"{order}3i", record[:12])
            if column > matrix.n_columns:
                break
            check(column >= 1, item, f"a column from 1 to {matrix.n_columns}", column)
            data = record[12:]
            check(4 * n_words == len(data), item, f"{n_words} words", f"{len(data)} bytes")
            if first_row > 0:
                values = _binary_values(data, matrix, order)
                matrix.add(item, column, first_row, values)
            else:
                _add_binary_strings(item, matrix, column, data, order)
        else:
            raise mismatch(item, "a column that ends the matrix", "the end of the file")
        yield matrix


def _binary_values(data: bytes, matrix: _Matrix, order: str) -> NDArray:
    code = {1: "f4", 2: "f8", 3: "c8", 4: "c16"}[matrix.type]
    return np.frombuffer(data, f"{order}{code}")


def _add_binary_strings(item: str, matrix: _Matrix, column: int, data: bytes, order: str) -> None:
    """Add the strings of a sparse column."""
    start = 0
    while start < len(data):
        if matrix.wide_strings:
            length, row = struct.unpack_from(f"{order}2i", data, start)
            start += 8
        else:
            (both,) = struct.unpack_from(f"{order}i", data, start)
            length, row = divmod(both, _STRING_UNIT)
            start += 4
        end = start + 4 * (length - 1)
        complete = length > 1 and end <= len(data)
        check(complete, item, f"a string within column {column}", f"{length - 1} words")
        matrix.add(item, column, row, _binary_values(data[start:end], matrix, order))
        start = end


# ---- Text files ----


class _TextLines:
    """Lines of a text, with one line of preview."""

    def __init__(self, source: Path) -> None:
        self.source = source
        self._lines = source.read_text(encoding="latin-1").splitlines()
        self.number = 0

    @property
    def item(self) -> str:
        return f"{self.source}: line {self.number}"

    def preview(self) -> str:
        return self._lines[self.number] if self.number < len(self._lines) else ""

    def take(self) -> str:
        check(self.number < len(self._lines), str(self.source), "another line", "the end")
        self.number += 1
        return self._lines[self.number - 1]

    def integers(self, count: int) -> list[int]:
        """Return the integers of the next line."""
        line = self.take()
        words = line.split()
        good = len(words) == count and all(re.fullmatch(r"-?\d{1,18}", word) for word in words)
        check(good, self.item, f"{count} integers", f"'{line[:60]}'")
        return [int(word) for word in words]

    def values(self, width: int) -> list[float]:
        """Return the numbers of the next lines, up to a line of integers."""
        numbers = []
        while "." in self.preview():
            line = self.take().rstrip()
            for start in range(0, len(line), width):
                word = line[start : start + width].upper().replace("D", "E")
                try:
                    numbers.append(float(word))
                except ValueError:
                    raise mismatch(self.item, "numbers", f"'{line[:60]}'") from None
        return numbers


def _text_matrices(source: Path) -> Iterator[_Matrix]:
    """Iterate over the matrices of a text."""
    lines = _TextLines(source)
    while lines.preview().strip():
        text = lines.take()
        head = _TEXT_HEAD.fullmatch(text)
        expected = "columns, rows, form, type, name and format of a matrix"
        if head is None:
            raise mismatch(lines.item, expected, f"'{text[:60]}'")
        form = _TEXT_FORMAT.match(head[6])
        if form is None:
            raise mismatch(lines.item, "a format such as 1P,3E23.16", f"'{head[6][:60]}'")
        width = check_count(int(form[1]), lines.item, "columns of a number", 1, 100)
        sizes = tuple(int(head[k]) for k in range(1, 5))
        matrix = _new_matrix(lines.item, sizes, head[5], _largest_size(source))
        _read_text_columns(lines, matrix, width)
        yield matrix


def _read_text_columns(lines: _TextLines, matrix: _Matrix, width: int) -> None:
    """Read the columns of a matrix, up to the one that ends it."""
    while True:
        column, first_row, n_words = lines.integers(3)
        if column > matrix.n_columns:
            # a number without meaning
            lines.take()
            return
        check(column >= 1, lines.item, f"a column from 1 to {matrix.n_columns}", column)
        if first_row > 0:
            numbers = lines.values(width)
            values = _text_values(numbers, n_words, matrix, lines.item)
            matrix.add(lines.item, column, first_row, values)
            continue
        # the head of the next column or matrix has three integers or more
        n_integers = 2 if matrix.wide_strings else 1
        while len(lines.preview().split()) == n_integers:
            string = lines.integers(n_integers)
            if matrix.wide_strings:
                length, row = string
            else:
                length, row = divmod(string[0], _STRING_UNIT)
            values = _text_values(lines.values(width), length - 1, matrix, lines.item)
            matrix.add(lines.item, column, row, values)


def _text_values(numbers: list[float], n_words: int, matrix: _Matrix, item: str) -> NDArray:
    """Return the values of a string or a dense column."""
    per_value = 2 if matrix.type in _COMPLEX_TYPES else 1
    n_expected = per_value * n_words // matrix.words_per_value
    # some programs count numbers, not words, in the dense columns of a text
    good = len(numbers) in (n_expected, n_words)
    check(good, item, f"{n_expected} numbers of {n_words} words", len(numbers))
    values = np.array(numbers)
    if per_value == 2:
        check(len(values) % 2 == 0, item, "pairs of real and imaginary parts", len(values))
        return values[::2] + 1j * values[1::2]
    return values
