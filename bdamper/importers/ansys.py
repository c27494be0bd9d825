"""Ansys MAPDL: matrices of a ``.full`` file, mesh and components of a ``.cdb`` archive, modes of a ``.rst`` file.

Binary files consist of records: the number of 32-bit words, a word of flags, the words, and their number again.  The
highest byte of the flags has a bit for integers (0x80, otherwise floating point) and one for short numbers (0x40: 16-bit
integers or single precision).  Other bits mark three compressed forms: zlib (0x20), windows of non-zero values
(0x10), and one bit per non-zero value (0x08).  Pointers count words from the start of the file or of a data set.  The
first record is the standard header, the second the header of the kind of file.

Only the records that an import needs are read.  Each length is checked against the size of the file, so that a damaged
file causes an error.

A ``.full`` file has rows for fixed components.  They contain a one on the diagonal only and are dropped.

A cyclic analysis writes real shapes of the base sector, two for each travelling wave.
:mod:`bdamper.fem.cyclic_symmetry` finds their pairing and direction.  Their modal mass is one over base and duplicate
sector, which equals the modal mass of ``a + i b`` of a pair over one sector.

References
----------
Ansys, *Programmer's Reference*, "Format of Binary Data Files", with the include files ``fdfull.inc`` and ``fdresu.inc``.
Ansys, *Command Reference*, commands CDWRITE, NBLOCK, EBLOCK and CMBLOCK.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bdamper.fem.surface import N_CORNER
from bdamper.importers.arrays import triangle_to_full
from bdamper.importers.deck_keywords import CDB_READ, changes_mesh, refuse
from bdamper.importers.fe_body import (
    ElementKind,
    FEBody,
    Lines,
    check_count,
    mesh_body,
    modes_by_diameter,
    parsing,
    reader,
    rotate_to_file,
)
from bdamper.util.errors import check, mismatch
from bdamper.util.records import check_all
from bdamper.util.storage import FilePath

_INTEGERS, _SHORT, _ZLIB, _WINDOWS, _BITS = 0x80, 0x40, 0x20, 0x10, 0x08
_HEADER = 103  # word at which the second record starts
_FULL, _RESULT = 4, 12
_KINDS = {_FULL: "matrices (.full)", _RESULT: "results (.rst)"}
_MODAL = 2  # number of a modal analysis
_COMBINE = "combine the files of a distributed run: /AUX2, then COMBINE,"
_ONE_STAGE = "solve a sector of each stage alone, with CYCLIC"

_SOLIDS = {"45": 8, "185": 8, "95": 20, "186": 20, "90": 20, "92": 10, "187": 10, "285": 4}


# -----------------------------------------------------------------------------------------------------------
# Records


class _Binary:
    """Records of a binary file in memory."""

    def __init__(self, source: Path, kind: int) -> None:
        self.source = source
        self.data = source.read_bytes()
        head = self.record(0, "standard header")
        check(
            len(head) >= 2 and head.dtype.kind == "i",
            str(source),
            "a binary file of Ansys",
            "another beginning",
        )
        found = _KINDS.get(int(head[0]), "another kind")
        check(
            int(head[0]) == kind,
            str(source),
            f"a file of {_KINDS[kind]}: number {kind}",
            f"{int(head[0])}, {found}",
        )

    def record(self, word: int, item: str) -> NDArray:
        """Return the numbers of the record at a word of the file."""
        return self._record(word, item)[0]

    def run(self, word: int, count: int, item: str) -> Iterator[NDArray]:
        """Iterate over ``count`` successive records."""
        for k in range(count):
            values, word = self._record(word, f"{item}, record {k + 1} of {count}")
            yield values

    def _record(self, word: int, item: str) -> tuple[NDArray, int]:
        where = f"{self.source}: {item} at word {word}"
        start = 4 * int(word)
        within, words = 0 <= start <= len(self.data) - 12, len(self.data) // 4
        check(
            within, where, f"a record within {words} words", "a pointer beyond its end: truncated"
        )
        size, flags = struct.unpack_from("<iI", self.data, start)
        end = start + 8 + 4 * size
        within, found = (
            size >= 0 and end + 4 <= len(self.data),
            f"a length of {size} words: damaged or truncated",
        )
        check(within, where, "a record that ends within the file", found)
        again = struct.unpack_from("<i", self.data, end)[0]
        check(again == size, where, f"the length {size} again at its end", f"{again}: damaged")
        kind = flags >> 24
        dtype = np.dtype(
            {0x80: "<i4", 0xC0: "<i2", 0x00: "<f8", 0x40: "<f4"}[kind & (_INTEGERS | _SHORT)]
        )
        check(
            not kind & _ZLIB,
            where,
            "a record without zlib compression (/FCOMP,FULL,0 or /FCOMP,RST,0)",
            "one with it",
        )
        raw = self.data[start + 8 : end]
        if kind & _BITS:
            values = self._bits(raw, dtype, where)
        elif kind & _WINDOWS:
            values = self._windows(raw, dtype, where)
        else:
            values = np.frombuffer(raw[: len(raw) // dtype.itemsize * dtype.itemsize], dtype)
        return values, word + size + 3

    @staticmethod
    def _head(raw: bytes, where: str) -> tuple[int, int]:
        check(len(raw) >= 8, where, "the head of a compressed record", "less than two words")
        size, second = struct.unpack_from("<ii", raw, 0)
        return check_count(size, where, "a length", largest=100_000_000), second

    def _bits(self, raw: bytes, dtype: np.dtype, where: str) -> NDArray:
        """Decompress at most 32 values.  The bit of a value is set if the value follows; otherwise the value is 0."""
        size, code = self._head(raw, where)
        check(size <= 32, where, "at most 32 values in a record compressed by bits", size)
        nonzero = np.array([(code >> k) & 1 for k in range(size)], bool)
        count = int(nonzero.sum())
        check(8 + count * dtype.itemsize <= len(raw), where, f"{count} values", "fewer: damaged")
        out = np.zeros(size, dtype)
        out[nonzero] = np.frombuffer(raw, dtype, count, 8)
        return out

    def _windows(self, raw: bytes, dtype: np.dtype, where: str) -> NDArray:
        """Decompress windows of a sparse record.

        A positive index precedes a single value.  Any other index (with its sign reversed) precedes a length and a run of
        this length, or one repeated value if the length is negative.
        """
        size, count = self._head(raw, where)
        step = max(dtype.itemsize, 4)
        out = np.zeros(size, dtype)
        at = 8
        for _ in range(count):
            check(at + 8 <= len(raw), where, f"{count} windows", "the end of the record")
            index, length = struct.unpack_from("<ii", raw, at)
            if index > 0:
                length = 1
            at += 4 if index > 0 else 8
            taken = 1 if length < 0 else length
            first, length = abs(index), abs(length)
            stored = step if taken == 1 else taken * dtype.itemsize
            within = first + length <= size and at + taken * dtype.itemsize <= len(raw)
            check(within, where, f"windows within {size} values", f"one of {length} from {first}")
            out[first : first + length] = np.frombuffer(raw, dtype, taken, at)
            at += stored
        return out


def _long(low: int, high: int) -> int:
    """Return a position in the file from its two words."""
    return (int(high) << 32) + (int(low) & 0xFFFFFFFF)


class _Header:
    """Record of integers with positions from 1, as in the include files of Ansys; absent positions are 0."""

    def __init__(self, file: _Binary, word: int, name: str) -> None:
        self.item = f"{file.source}: {name}"
        self.values, self.largest = file.record(word, name), len(file.data)
        check(self.values.dtype.kind == "i", self.item, "whole numbers", str(self.values.dtype))

    def count(self, position: int, what: str, smallest: int = 1) -> int:
        """Return a count that the size of the file limits."""
        return check_count(self[position], self.item, what, smallest, self.largest)

    def pointer(self, low: int, high: int) -> int:
        return _long(self[low], self[high])

    def __getitem__(self, position: int) -> int:
        return int(self.values[position - 1]) if position <= len(self.values) else 0


# -----------------------------------------------------------------------------------------------------------
# Matrices


class FullMatrices(NamedTuple):
    """Matrices of a ``.full`` file.

    Parameters
    ----------
    stiffness, mass : (n_eq, n_eq) sparse
        Both triangles, for the free components only.
    dofs : (n_eq, 2) int
        Node number and component (1, 2, 3) of each row.
    dropped : int
        Number of dropped rows of fixed components.
    nodes : (n_nodes,) int
        Numbers of all nodes, including fixed ones.
    """

    stiffness: sp.csr_matrix
    mass: sp.csr_matrix
    dofs: NDArray
    dropped: int
    nodes: NDArray


@reader("a matrix file of Ansys (.full)")
def read_full(path: Path) -> FullMatrices:
    """Read stiffness and mass of a ``.full`` file, without the rows of fixed components.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    FullMatrices

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist or is damaged, or has unsymmetric or lumped matrices, constraint equations, or rotations.
    """
    file = _Binary(path, _FULL)
    head = _Header(file, _HEADER, "header")
    for refused, expected, found in (
        (head[1] != -4, "a symbolically assembled matrix (-4)", head[1]),
        (head[14], "symmetric matrices", "unsymmetric ones"),
        (head[11], "a consistent mass matrix (LUMPM,OFF)", "a lumped one"),
        (
            head[21],
            "no constraint equations (CE, CP, CERIG, RBE3) in the matrices",
            f"{head[21]} of them",
        ),
    ):
        check(not refused, head.item, expected, found)
    n_eq, n_nodes = head.count(2, "a number of equations"), head.count(33, "a number of nodes")
    n_eq_of_model = head[62]  # 0 in files of older releases
    check(
        n_eq_of_model <= n_eq,
        head.item,
        f"all {n_eq_of_model} equations of the model ({_COMBINE}FULL)",
        n_eq,
    )
    _, dof_names, node_numbers = file.run(_HEADER, 3, "header, degrees of freedom and nodes")
    counts, constraint = file.run(head.pointer(36, 37), 2, "degrees of freedom of each node")
    dofs = _full_dofs(path, dof_names, node_numbers, counts, n_nodes, n_eq)
    check(
        len(constraint) >= n_eq,
        f"{path}: table of fixed components",
        f"{n_eq} entries",
        len(constraint),
    )
    pointers = {"stiffness": head.pointer(19, 20), "mass": head.pointer(27, 28)}
    matrices = [_full_matrix(file, word, n_eq, name) for name, word in pointers.items()]
    keep = np.flatnonzero(constraint[:n_eq] >= 0)
    empty = matrices[0].diagonal()[keep] == 0.0
    keep = keep[~empty]
    check(len(keep) > 0, str(path), "free components", "none")
    kept = [m[keep][:, keep].tocsr() for m in matrices]
    highest = dofs[keep, 1].max()
    check(highest <= 3, f"{path}: degrees of freedom", "UX, UY, UZ only", f"number {highest}")
    return FullMatrices(kept[0], kept[1], dofs[keep], n_eq - len(keep), np.unique(dofs[:, 0]))


def _full_dofs(
    source: Path, dof_names: NDArray, numbers: NDArray, counts: NDArray, n_nodes: int, n_eq: int
) -> NDArray:
    """Return node number and component (n_eq, 2) of each equation."""
    for what, table in (("node numbers", numbers), ("degrees of freedom of each node", counts)):
        check(
            len(table) >= n_nodes,
            f"{source}: table of {what}",
            f"{n_nodes} entries, one for each node",
            len(table),
        )
    numbers, counts = numbers[:n_nodes].astype(np.int64), counts[:n_nodes].astype(np.int64)
    good = counts.min() >= 0 and counts.max() <= len(dof_names) and counts.sum() == n_eq
    check(good, f"{source}: degrees of freedom of each node", f"{n_eq} in all", int(counts.sum()))
    first = np.repeat(np.cumsum(counts) - counts, counts)
    within_node = np.arange(n_eq) - first
    return np.column_stack([np.repeat(numbers, counts), dof_names.astype(np.int64)[within_node]])


def _full_matrix(file: _Binary, word: int, n_eq: int, name: str) -> sp.csr_matrix:
    """Read one triangle, stored by rows as a record of columns and a record of values."""
    item = f"{name} matrix"
    check(word > 0, f"{file.source}: {item}", "a matrix", "none in the file")
    rows, columns, values = [], [], []
    records = file.run(word, 2 * n_eq, item)
    for row in range(n_eq):
        column, value = next(records), next(records)
        where = f"{file.source}: {item}, row {row + 1}"
        good = column.dtype.kind == "i" and value.dtype.kind == "f" and len(column) == len(value)
        check(
            good,
            where,
            "records of columns and values of the same length",
            f"{len(column)} and {len(value)}",
        )
        low, high = column.min(initial=1), column.max(initial=1)
        check(low >= 1 and high <= n_eq, where, f"columns 1 to {n_eq}", f"{low} to {high}")
        rows.append(np.full(len(column), row))
        columns.append(column.astype(np.int64) - 1)
        values.append(value.astype(float))
    i, j, entries = np.concatenate(rows), np.concatenate(columns), np.concatenate(values)
    check_all(np.isfinite(entries), entries, "finite numbers", f"{file.source}: {item}")
    return triangle_to_full(np.minimum(i, j), np.maximum(i, j), entries, n_eq)


def read_ansys(full: FilePath, archive: FilePath, results: FilePath | None = None) -> FEBody:
    """Read a body from its matrices, its archive, and optionally the modes of a cyclic analysis.

    Parameters
    ----------
    full : path-like
        ``.full`` file of the sector without cyclic symmetry, or of the damper.
    archive : path-like
        ``.cdb`` file of the same model (CDWRITE,DB), with its mesh and components.
    results : path-like, optional
        ``.rst`` file with modes to compare with.

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If a file does not exist or is damaged, or matrices and archive do not have the same nodes.
    """
    body, found = read_cdb(archive), read_full(full)
    solid = np.unique(np.concatenate([np.zeros(0, np.int64), *(e.ravel() for e in body.elements)]))
    for file, nodes, others, other in (
        (archive, body.numbers, found.nodes, full),
        (full, found.nodes, solid, archive),
    ):
        missing = np.setdiff1d(others, nodes)
        some = ", ".join(map(str, missing[:5])) + ", ..." * (len(missing) > 5)
        wanted = f"the nodes of {other}, from the same model"
        check(
            not len(missing), str(file), wanted, f"{len(missing)} of {len(others)} missing: {some}"
        )
    modes = read_rst(results).modes if results is not None else ()
    notes = (*body.notes, f"{found.dropped} rows of fixed components dropped from {full}")
    matrices = {"stiffness": found.stiffness, "mass": found.mass, "dofs": found.dofs}
    return replace(body, **matrices, modes=modes, source=f"{full}, {archive}", notes=notes)


# -----------------------------------------------------------------------------------------------------------
# Archive


@reader("an archive of Ansys (.cdb)", ".cdb")
def read_cdb(path: Path) -> FEBody:
    """Read nodes, solid elements and components of nodes from an archive (CDWRITE).

    Parameters
    ----------
    path : path-like

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has a command that could change the mesh.
    """
    return _Archive(Lines(path, "latin-1")).body()


class _Archive:
    """Parser of an archive."""

    def __init__(self, lines: Lines) -> None:
        self.source, self.lines = str(lines.source), lines
        self.numbers: list[int] = []
        self.positions: list[list[float]] = []
        self.angles: list[list[float]] = []
        self.types: dict[int, str] = {}
        self.elements: list[list[int]] = []
        self.owners: list[tuple[str, int]] = []  # element type and material number
        self.constants: dict[str, dict[int, float]] = {}
        self.sets: dict[str, NDArray] = {}
        self.skipped: Counter[str] = Counter()
        self.passed_over: Counter[str] = Counter()

    def _integers(self, what: str, fields: list[tuple[bool, slice]]) -> list[int]:
        text = self.lines.take(what)
        with parsing(
            self.lines.item, "whole numbers in the columns of the format of the block", text
        ):
            return [int(text[columns]) for _, columns in fields if text[columns].strip()]

    def _fields(self, block: str) -> list[tuple[bool, slice]]:
        """Parse a Fortran format such as (1i7,2i9,6e21.13e3).

        Returns
        -------
        list of (bool, slice)
            Whether a field contains an integer, and its columns.
        """
        text = self.lines.take(f"the format of {block}")
        fields: list[tuple[bool, slice]] = []
        for count, letter, width in re.findall(r"(\d*)([iedfg])(\d+)", text.lower()):
            size = check_count(int(width), self.lines.item, "a width of fields", 1, 100)
            for _ in range(
                check_count(int(count or 1), self.lines.item, "a repetition of fields", 1, 100)
            ):
                start = fields[-1][1].stop if fields else 0
                fields.append((letter == "i", slice(start, start + size)))
        self.lines.require(bool(fields), "a format like (3i9,6e21.13e3)", f"'{text[:40]}'")
        return fields

    def body(self) -> FEBody:
        self._leave_out_iges()
        for line in self.lines:
            for command in _commands(line):
                self._read(command)
        axes = {n: _node_axes(np.array(a)) for n, a in zip(self.numbers, self.angles) if any(a)}
        kinds = map(self._kind, self.owners, self.elements)
        notes = [
            f"{count} elements of type {name} are not solids and are not read"
            for name, count in self.skipped.items()
        ]
        if self.passed_over:
            notes.append(
                f"commands of the archive that are not read: {', '.join(self.passed_over)}"
            )
        return mesh_body(
            self.source, "a block of nodes (NBLOCK)", self.numbers, self.positions, self.elements, kinds,
            node_sets=self.sets, node_axes=axes, notes=tuple(notes),
        )  # fmt: skip

    def _leave_out_iges(self) -> None:
        """Advance to the commands behind geometry in IGES form, with which an archive of the solid model begins."""
        if not self.lines.follows_match(_IGES_START):
            return
        while (
            not self.lines.take("the line :CDWRITE behind the geometry (IGES)")
            .upper()
            .startswith(":CDWRITE")
        ):
            pass

    def _read(self, command: str) -> None:
        words = [w.strip() for w in command.split(",")]
        key = words[0].split(" ")[0].upper()
        if key == "NBLOCK":
            self._nodes()
        elif key == "EBLOCK":
            self._elements("SOLID" in (w.upper() for w in words))
        elif key == "CMBLOCK" and len(words) >= 4:
            self._component(words)
        elif key == "ET" and len(words) >= 3 and words[1].isdigit():
            self.types[int(words[1])] = words[2].upper().removeprefix("SOLID")
        elif key == "ETBLOCK":
            self._types()
        elif key == "MPDATA" and len(words) >= 7 and words[4].isdigit():
            self.constants.setdefault(words[3].upper(), {}).setdefault(
                int(words[4]), float(words[6])
            )
        elif not _ends_block(words):
            self._pass_over(key, words, command)

    def _pass_over(self, key: str, words: list[str], command: str) -> None:
        """Keep the name of a command for the note; raise ModelError if it changes the mesh or a set of nodes."""
        numbers_of_a_block = not re.match(r"[*/~]?[A-Z_]", key)
        if numbers_of_a_block or _ASSIGNMENT.match(command):
            return
        incomplete = key in ("ET", "CMBLOCK")
        names_nodes = key == "CM" and (len(words) < 3 or words[2].upper().startswith("NODE"))
        renumbers = key.startswith("NUMO") and bool(
            self.numbers
        )  # NUMOFF; an archive begins with it
        if changes_mesh(key) or incomplete or names_nodes or renumbers:
            refuse(command.strip()[:40], self.lines.item, CDB_READ)
        self.passed_over[key] += 1

    def _types(self) -> None:
        """Read numbers and names of element types."""
        fields = self._fields("ETBLOCK")
        while (words := self._integers("the end of ETBLOCK (-1)", fields))[:1] != [-1]:
            self.lines.require(len(words) >= 2, "number and name of an element type", words)
            self.types[words[0]] = str(words[1])

    def _kind(self, owner: tuple[str, int], nodes: list[int]) -> ElementKind:
        name, material = owner
        poisson = self.constants.get("PRXY", {}) | self.constants.get("NUXY", {})
        plain = f"C3D{len(nodes)}" + ("R" if name == "186" and len(nodes) == 20 else "")
        young, density = (self.constants.get(key, {}).get(material) for key in ("EX", "DENS"))
        return ElementKind(plain, young, poisson.get(material), density)

    def _nodes(self) -> None:
        (whole, first), *fields = self._fields("NBLOCK")
        self.lines.require(whole, "a format that begins with a whole number", "another one")
        reals = [columns for is_whole, columns in fields if not is_whole]
        while True:
            line = self.lines.take("the end of NBLOCK (-1)")
            words = [w.strip() for w in line.split(",")]
            if line.startswith("-1") or not line.strip() or _ends_block(words):
                break
            with parsing(self.lines.item, "a node", line):
                number = int(line[first])
                values = [
                    float(line[columns].replace("D", "E"))
                    for columns in reals
                    if line[columns].strip()
                ]
            if number < 0:
                break
            good = len(values) <= 6 and np.isfinite(values).all()
            self.lines.require(good, "at most six finite numbers", f"'{line[:60]}'")
            values += [0.0] * (6 - len(values))
            self.numbers.append(number)
            self.positions.append(values[:3])
            self.angles.append(values[3:])

    def _elements(self, solid: bool) -> None:
        fields = self._fields("EBLOCK")
        while (words := self._integers("the end of EBLOCK (-1)", fields))[:1] != [-1]:
            self.lines.require(
                solid and len(words) >= 12, "an element of a block of SOLID form", words
            )
            kind, count, nodes = words[1], words[8], words[11:]
            while len(nodes) < count:
                nodes += self._integers("the nodes of an element", fields)
            name = self.types.get(kind, "")
            known = _SOLIDS.get(name, count if not name else 0)
            if known not in (4, 8, 10, 20) or len(nodes) != count:
                self.skipped[name or f"{count} nodes"] += 1
                continue
            if 0 in nodes or count != known:  # without some mid-side nodes
                nodes = nodes[: N_CORNER[known]]
            self.elements.append(_without_repeats(nodes))
            self.owners.append((name, words[0]))

    def _component(self, words: list[str]) -> None:
        name, kind = words[1].strip(), words[2].strip().upper()
        item = self.lines.item
        with parsing(item, "a number of items in CMBLOCK", words[3]):
            count = int(re.findall(r"^\d+", words[3].strip())[0])
        total = check_count(count, item, "a number of items", 0, 50_000_000)
        fields = self._fields("CMBLOCK")
        found: list[int] = []
        wanted = f"{total} items of component '{name}'"
        while len(found) < total:
            more = self._integers(wanted, fields)
            self.lines.require(bool(more), wanted, len(found))
            found += more
        members, last = [np.zeros(0, np.int64)], 0
        for number in found[:total]:  # a negative number ends a range
            good = number >= 0 or 0 < last <= -number <= last + 50_000_000
            check(good, item, f"ranges in component '{name}'", number)
            members.append(np.arange(last + 1 if number < 0 else number, abs(number) + 1))
            last = abs(number)
        if kind.startswith("NODE") and total:
            self.sets[name] = np.concatenate(members)


_IGES_START = re.compile(
    r".{72}S {0,6}\d+\s*$"
)  # the letter of the section and a number in columns 73 to 80
_TEXT = re.compile(r"\s*(/COM|/TIT|/STI|C\*\*\*)", re.IGNORECASE)
_QUOTED_OR_COMMENT = re.compile(r"'[^']*'|!.*")
_ASSIGNMENT = re.compile(r"\s*\w+(\([^)]*\))?\s*=")


def _commands(line: str) -> list[str]:
    """Return the commands of a line, which $ separates; a title or comment is none."""
    if _TEXT.match(line):
        return []
    # a quoted text may hold $ or !
    plain = _QUOTED_OR_COMMENT.sub(lambda found: "''" if found[0].startswith("'") else "", line)
    return plain.split("$")


def _ends_block(words: list[str]) -> bool:
    """Return whether a command such as N,R5.3,LOC,-1 or EN,R5.5,ATTR,-1 ends a block."""
    last = {"N": "LOC", "EN": "ATTR"}.get(words[0].upper())
    return len(words) >= 4 and words[2].upper() == last and words[3] == "-1" and not any(words[4:])


def _without_repeats(nodes: list[int]) -> list[int]:
    """Return the distinct nodes of a wedge or tetrahedron that is stored as a hexahedron; other elements are unchanged."""
    corners = (
        {6: (0, 1, 2, 4, 5, 6), 4: (0, 1, 2, 4)}.get(len(set(nodes[:8])))
        if len(nodes) in (8, 20)
        else None
    )
    distinct = [nodes[k] for k in corners or ()]
    out = distinct + [n for n in dict.fromkeys(nodes[8:]) if n not in distinct]
    return out if len(out) in N_CORNER and set(distinct) == set(nodes[:8]) else nodes


def _node_axes(angles: NDArray) -> NDArray:
    """Return the axes of a node as rows (3, 3), rotated about Z, the new X and the new Y by three angles (degrees)."""
    return Rotation.from_euler("ZXY", angles, degrees=True).as_matrix().T


# -----------------------------------------------------------------------------------------------------------
# Results


@reader("a result file of Ansys (.rst)", ".rst")
def read_rst(path: Path) -> FEBody:
    """Read nodes, solid elements and modes of a modal analysis, cyclic or not.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    FEBody
        Body without matrices.  Its modes are standing waves of the base sector in the axes of the file, two for each
        travelling wave of a nodal diameter between 0 and N/2.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has no modal analysis with displacements UX, UY, UZ.
    """
    file = _Binary(path, _RESULT)
    head = _Header(file, _HEADER, "header")
    check(head[8] == _MODAL, head.item, f"a modal analysis: number {_MODAL}", head[8])
    n_nodes, n_sets = head.count(3, "a number of nodes"), head.count(9, "a number of result sets")
    # 0 in files of releases without distributed solution
    n_nodes_of_model = head[49] or n_nodes
    if n_nodes_of_model != n_nodes:
        raise mismatch(
            head.item, f"all {n_nodes_of_model} nodes of the model ({_COMBINE}RST)", n_nodes
        )
    room = head.count(4, "room for result sets", n_sets)
    index = file.record(head.pointer(11, 41), "index of result sets")
    if len(index) < 2 * room or index.dtype.kind != "i":
        raise mismatch(f"{path}: index of result sets", f"{2 * room} whole numbers", len(index))
    words = [_long(index[k], index[room + k]) for k in range(n_sets)]
    frequency = file.record(head.pointer(12, 42), "frequencies")[:n_sets].astype(float)
    numbers = file.record(head.pointer(15, 46), "node numbers")[:n_nodes].astype(np.int64)
    n_sectors, diameter = _rst_diameters(file, head, n_sets)
    if min(len(frequency), len(diameter)) < n_sets or len(numbers) < n_nodes:
        raise mismatch(str(path), f"{n_sets} result sets of {n_nodes} nodes", "shorter tables")
    body, axes = _rst_mesh(file, head.pointer(16, 47))
    shapes = [_rst_shape(file, word, numbers, axes, k) for k, word in enumerate(words)]
    each = zip(diameter.tolist(), frequency.tolist(), shapes)
    modes = modes_by_diameter(
        ((d, hertz, 1.0, numbers, shape) for d, hertz, shape in each), str(path)
    )
    notes = (f"{n_sectors} sectors",) if n_sectors > 1 else ()
    return replace(body, modes=modes, notes=notes)


def _rst_diameters(file: _Binary, head: _Header, n_sets: int) -> tuple[int, NDArray]:
    """Return the number of sectors and the nodal diameter of each result set."""
    n_stages = _Header(file, head.pointer(16, 47), "geometry header")[54]
    check(
        n_stages <= 1,
        head.item,
        f"sectors of one stage ({_ONE_STAGE})",
        f"a multistage result with {n_stages} stages",
    )
    n_sectors, pointer = head[21], head.pointer(17, 44)
    diameter = np.zeros(n_sets, int)
    if pointer > 0:
        diameter = np.abs(file.record(pointer, "harmonic indices")[:n_sets].astype(int))
    if n_sectors > 1:
        check(
            pointer > 0,
            head.item,
            f"the nodal diameters of a disk with {n_sectors} sectors",
            "none",
        )
    else:
        # each stage of a multistage model has its own number of sectors
        several = f"harmonic indices up to {diameter.max(initial=0)} without a number of sectors"
        check(not diameter.any(), head.item, f"sectors of one stage ({_ONE_STAGE})", several)
    return n_sectors, diameter


def _rst_mesh(file: _Binary, word: int) -> tuple[FEBody, dict[int, NDArray]]:
    """Return nodes and solid elements, and the axes of nodes with rotated axes."""
    head = _Header(file, word, "geometry header")
    n_nodes, n_elements = (
        head.count(4, "a number of nodes"),
        head.count(5, "a number of elements", 0),
    )
    table = np.empty((n_nodes, 7))
    for k, row in enumerate(file.run(head.pointer(27, 28) or head[9], n_nodes, "nodes")):
        if len(row) < 7 or row.dtype.kind != "f" or not np.isfinite(row[:7]).all():
            raise mismatch(
                f"{file.source}: nodes, record {k + 1}", "seven finite numbers", len(row)
            )
        table[k] = row[:7]
    numbers = table[:, 0].astype(np.int64)
    elements = []
    if n_elements:
        start = head.pointer(29, 30) or head[11]
        offsets = file.record(start, "index of elements")
        words = (
            np.ascontiguousarray(offsets).astype("<i4").view("<i8")
            if len(offsets) >= 2 * n_elements
            else offsets
        )
        for k in range(n_elements):
            check(
                k < len(words),
                f"{file.source}: index of elements",
                f"{n_elements} entries",
                len(words),
            )
            element = file.record(start + int(words[k]), f"element {k + 1}")[10:].astype(np.int64)
            if len(element) in (8, 10, 20) and np.isin(element, numbers).all():
                elements.append(np.array(_without_repeats(element.tolist())))
    body = mesh_body(str(file.source), "nodes", numbers, table[:, 1:4], elements)
    return body, {int(row[0]): _node_axes(row[4:7]) for row in table if row[4:7].any()}


def _rst_shape(
    file: _Binary, word: int, numbers: NDArray, axes: dict[int, NDArray], k: int
) -> NDArray:
    """Return the displacements (n_nodes, 3) of a result set in the axes of the file."""
    head = _Header(file, word, f"result set {k + 1}")
    item, n = head.item, head.count(3, "a number of nodes")
    per_node = check_count(head[20] + head[98], item, "a number of values of each node", 3, 64)
    names = [head[21 + j] for j in range(head[20])] if 0 < head[20] <= 30 else []
    check(names[:3] == [1, 2, 3], item, "displacements UX, UY, UZ", f"degrees of freedom {names}")
    values = file.record(
        word + (head.pointer(105, 106) or head[11]), f"displacements of result set {k + 1}"
    ).astype(float)
    if len(values) < n * per_node or n != len(numbers):
        raise mismatch(
            item, f"{per_node} values of each of {len(numbers)} nodes", f"{len(values)} values"
        )
    out = values[: n * per_node].reshape(n, per_node)[:, :3].copy()
    out[out == 2.0**100] = 0.0  # number of Ansys for "no value"
    check_all(np.isfinite(out), out, "finite displacements", item)
    rotate_to_file(out, numbers, axes)
    return out
