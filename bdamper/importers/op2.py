"""Real modes of OP2 files of Nastran (results of OUTPUT2, ``PARAM,POST,-1``).

The file consists of Fortran records.  A record of one integer m is a marker: a positive m announces
a record of m words, a negative m begins part -m of a table, and 0 ends a table.  A table of
eigenvectors alternates identifying parts (146 words) and data parts of 8 words for each point:
10 times its number plus a code, its type, and six displacements.

References
----------
MSC, *DMAP Programmer's Guide*, data blocks OUG and LAMA.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.importers.fe_body import Modes, reader, rotate_to_file
from bdamper.util.errors import check, mismatch

_WORD = 4
_EIGENVECTORS, _REAL_EIGENVALUES = 7, 2  # codes of a table and of an analysis
_GRID_POINT = 1
_WORDS_OF_POINT, _WORDS_OF_EIGENVALUE = 8, 7
_VECTOR_TABLES = ("OUG", "BOUG", "OPHIG", "BOPHIG")
_EIGENVALUE_TABLES = ("LAMA", "BLAMA")


@dataclass
class _Table:
    """Table of the file: its name, and the bytes of its parts by number."""

    name: str = ""
    parts: dict[int, bytes] = field(default_factory=dict)


class _Vector(NamedTuple):
    """Shape of one mode: frequency (Hz), and numbers and displacements (n, 3) of grid points."""

    frequency: float
    numbers: NDArray
    shape: NDArray


@reader("an OP2 file with real eigenvectors")
def read_op2(
    path: Path,
    nodal_diameter: int = 0,
    subcase: int | None = None,
    axes: Mapping[int, NDArray] | None = None,
) -> Modes:
    """Read real modes from an OP2 file.

    Parameters
    ----------
    path : path-like
    nodal_diameter : int
        Nodal diameter of the modes.  A pair of equal frequencies makes one travelling wave.
    subcase : int, optional
        Subcase of the modes; by default the first one.
    axes : mapping of node number to (3, 3) float, optional
        ``FEBody.node_axes`` of the bulk data, because displacements are in the axes of each grid
        point.

    Returns
    -------
    Modes

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has no eigenvectors of this subcase.
    """
    order = _byte_order(path)
    vectors: dict[int, list[_Vector]] = {}
    masses: dict[int, NDArray] = {}
    for table in _tables(path, order):
        if table.name.startswith(_VECTOR_TABLES):
            _add_vectors(vectors, table, order, f"{path}: {table.name}")
        elif table.name.startswith(_EIGENVALUE_TABLES):
            masses.update(_modal_masses(table, order, f"{path}: {table.name}"))
    check(bool(vectors), str(path), "eigenvectors", "none")
    subcases = sorted(vectors)
    if subcase is None:
        subcase = subcases[0]
    check(subcase in subcases, str(path), f"a subcase out of {subcases}", subcase)
    chosen = vectors[subcase]
    numbers = chosen[0].numbers
    for vector in chosen:
        same = np.array_equal(vector.numbers, numbers)
        check(same, str(path), "the same grid points in every mode", "different ones")
    shapes = np.stack([vector.shape for vector in chosen], axis=2)
    rotate_to_file(shapes, numbers, axes or {})
    frequency = np.array([vector.frequency for vector in chosen])
    modal_mass = masses.get(subcase)
    if modal_mass is not None:
        usable = len(modal_mass) == len(frequency) and np.all(modal_mass > 0.0)
        modal_mass = modal_mass if usable else None
    return Modes(nodal_diameter, frequency, numbers, shapes, modal_mass, str(path))


# ---- Records and tables ----


def _byte_order(source: Path) -> str:
    """Return the sign of the byte order in ``struct``."""
    with open(source, "rb") as file:
        start = file.read(4)
    for order in "<>":
        length = struct.unpack(f"{order}i", start)[0] if len(start) == 4 else 0
        if length == _WORD:
            return order
        if length == 2 * _WORD:
            advice = "write the results with a version of 32-bit integers"
            raise mismatch(str(source), f"integers of four bytes ({advice})", "eight bytes")
    raise mismatch(str(source), "a marker of four bytes at the beginning", f"{start!r}")


class _Records:
    """Fortran records of a file, in turn."""

    def __init__(self, source: Path, order: str) -> None:
        self.source = source
        self._order = order
        self._content = source.read_bytes()
        self._start = 0

    @property
    def at_end(self) -> bool:
        return self._start >= len(self._content)

    def take(self) -> bytes:
        """Return the next record."""
        item = f"{self.source}: record at byte {self._start}"
        (length,) = struct.unpack_from(f"{self._order}i", self._content, self._start)
        begin = self._start + 4
        end = begin + length
        complete = length >= 0 and end + 4 <= len(self._content)
        check(complete, item, f"{length} bytes", f"{len(self._content) - begin}")
        (closing,) = struct.unpack_from(f"{self._order}i", self._content, end)
        check(closing == length, item, f"the length {length} after the record", closing)
        self._start = end + 4
        return self._content[begin:end]

    def take_marker(self) -> int:
        """Return the integer of the next record."""
        item = f"{self.source}: record at byte {self._start}"
        record = self.take()
        check(len(record) == _WORD, item, "a marker of four bytes", f"{len(record)} bytes")
        return int(struct.unpack(f"{self._order}i", record)[0])


def _tables(source: Path, order: str) -> Iterator[_Table]:
    """Iterate over the tables of a file."""
    records = _Records(source, order)
    table = _Table()
    # part 0 is the name, and later parts begin with a flag
    part = 0
    chunks: list[bytes] = []
    while not records.at_end:
        marker = records.take_marker()
        if marker > 0:
            chunk = records.take()
            item = f"{source}: part {part} of table '{table.name}'"
            check(len(chunk) == _WORD * marker, item, f"{marker} words", f"{len(chunk)} bytes")
            chunks.append(chunk)
            continue
        if part == 0:
            table.name = b"".join(chunks).decode("ascii", errors="replace").strip()
        else:
            table.parts[part] = b"".join(chunks[1:])
        part = -marker
        chunks = []
        if marker == 0:
            yield table
            table = _Table()
    yield table


def _pairs(table: _Table) -> Iterator[tuple[bytes, bytes]]:
    """Iterate over the identifying parts of a table, each with the data part that follows."""
    for number in sorted(table.parts):
        # parts 3, 5, ... identify the data of parts 4, 6, ...
        if number >= 3 and number % 2 == 1 and table.parts.get(number + 1):
            yield table.parts[number], table.parts[number + 1]


# ---- Eigenvectors and eigenvalues ----


def _add_vectors(vectors: dict[int, list[_Vector]], table: _Table, order: str, item: str) -> None:
    """Add the real eigenvectors of a table to the subcases."""
    for identity, data in _pairs(table):
        words = struct.unpack_from(f"{order}10i", identity)
        approach, table_code, subcase, n_words = words[0], words[1], words[3], words[9]
        is_vector = table_code % 1000 == _EIGENVECTORS
        if not is_vector or approach // 10 != _REAL_EIGENVALUES:
            continue
        sort_code = table_code // 1000
        check(sort_code not in (2, 3, 5, 6), item, "results in SORT1", "SORT2")
        real = n_words == _WORDS_OF_POINT and len(data) % (_WORD * _WORDS_OF_POINT) == 0
        check(real, item, f"real eigenvectors of {_WORDS_OF_POINT} words", f"{n_words} words")
        (eigenvalue,) = struct.unpack_from(f"{order}f", identity, 5 * _WORD)
        integers = np.frombuffer(data, f"{order}i4").reshape(-1, _WORDS_OF_POINT)
        # other rows belong to scalar points
        is_grid = integers[:, 1] == _GRID_POINT
        values = np.frombuffer(data, f"{order}f4").reshape(-1, _WORDS_OF_POINT)
        # a rigid-body motion has a small eigenvalue of either sign
        frequency = float(np.sqrt(abs(eigenvalue))) / (2.0 * np.pi)
        numbers = integers[is_grid, 0].astype(np.int64) // 10
        shape = values[is_grid, 2:5].astype(float)
        vectors.setdefault(subcase, []).append(_Vector(frequency, numbers, shape))


def _modal_masses(table: _Table, order: str, item: str) -> dict[int, NDArray]:
    """Return the modal masses of each subcase in a table of eigenvalues."""
    masses = {}
    for identity, data in _pairs(table):
        subcase = struct.unpack_from(f"{order}4i", identity)[3]
        complete = len(data) % (_WORD * _WORDS_OF_EIGENVALUE) == 0
        expected = f"{_WORDS_OF_EIGENVALUE} words for each eigenvalue"
        check(complete, item, expected, f"{len(data)} bytes")
        values = np.frombuffer(data, f"{order}f4").reshape(-1, _WORDS_OF_EIGENVALUE)
        # mode, order, eigenvalue, rad/s, Hz, modal mass, modal stiffness
        masses[subcase] = values[:, 5].astype(float)
    return masses
