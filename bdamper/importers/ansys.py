"""Ansys MAPDL: matrices of a ``.full`` file, mesh and components of a ``.cdb`` archive, modes of a
``.rst`` file.

Binary files consist of records: the number of 32-bit words, a word of flags, the words, and their
number again.  The highest byte of the flags has a bit for integers (0x80, otherwise floating point)
and one for short numbers (0x40: 16-bit integers or single precision).  Other bits mark three
compressed forms: zlib (0x20), windows of non-zero values (0x10), and one bit per non-zero value
(0x08).  Pointers count words from the start of the file or of a data set.  The first record is the
standard header, the second the header of the kind of file.

Only the records that an import needs are read.  Each length is checked against the size of the
file, so that a damaged file causes an error.

A ``.full`` file has rows for fixed components.  They contain a one on the diagonal only and are
dropped.

A cyclic analysis writes real shapes of the base sector, two for each travelling wave.
:mod:`bdamper.fem.cyclic_symmetry` finds their pairing and direction.  Their modal mass is one over
base and duplicate sector, which equals the modal mass of ``a + i b`` of a pair over one sector.

References
----------
Ansys, *Programmer's Reference*, "Format of Binary Data Files", with the include files
``fdfull.inc`` and ``fdresu.inc``.
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
from bdamper.util.errors import check, check_sentence, mismatch
from bdamper.util.records import check_all
from bdamper.util.storage import FilePath

_INTEGERS, _SHORT, _ZLIB, _WINDOWS, _BITS = 0x80, 0x40, 0x20, 0x10, 0x08
_DTYPES = {0x80: "<i4", 0xC0: "<i2", 0x00: "<f8", 0x40: "<f4"}  # by the first two bits
_HEADER = 103  # word at which the second record starts
_FULL, _RESULT = 4, 12
_KINDS = {_FULL: "matrices (.full)", _RESULT: "results (.rst)"}
_MODAL = 2  # number of a modal analysis
_COMBINE = "combine the files of a distributed run: /AUX2, then COMBINE,"
_ONE_STAGE = "solve a sector of each stage separately, with CYCLIC"

_SOLIDS = {"45": 8, "185": 8, "95": 20, "186": 20, "90": 20, "92": 10, "187": 10, "285": 4}


# --------------------------------------------------------------------------------------------------
# Records


class _Binary:
    """Records of a binary file in memory."""

    def __init__(self, source: Path, kind: int) -> None:
        self.source = source
        self.data = source.read_bytes()
        head = self.record(0, "standard header")
        is_header = len(head) >= 2 and head.dtype.kind == "i"
        check(is_header, str(source), "a binary file of Ansys", "a different header")
        number = int(head[0])
        expected = f"a file of {_KINDS[kind]}: number {kind}"
        found = f"{number}, {_KINDS.get(number, 'a different kind')}"
        check(number == kind, str(source), expected, found)

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
        n_words = len(self.data) // 4
        start = 4 * int(word)
        # a record has at least its length, its flags and its length again
        within = 0 <= start <= len(self.data) - 12
        expected = f"a record within {n_words} words"
        check(within, where, expected, "a pointer beyond its end: truncated")
        size, flags = struct.unpack_from("<iI", self.data, start)
        end = start + 8 + 4 * size
        within = size >= 0 and end + 4 <= len(self.data)
        found = f"a length of {size} words: damaged or truncated"
        check(within, where, "a record that ends within the file", found)
        size_again = struct.unpack_from("<i", self.data, end)[0]
        expected = f"the length {size} again at its end"
        check(size_again == size, where, expected, f"{size_again}: damaged")
        kind = flags >> 24
        dtype = np.dtype(_DTYPES[kind & (_INTEGERS | _SHORT)])
        expected = "a record without zlib compression (/FCOMP,FULL,0 or /FCOMP,RST,0)"
        check(not kind & _ZLIB, where, expected, "one with it")
        raw = self.data[start + 8 : end]
        if kind & _BITS:
            values = self._bits(raw, dtype, where)
        elif kind & _WINDOWS:
            values = self._windows(raw, dtype, where)
        else:
            # an odd number of short values leaves half a word
            n_values = len(raw) // dtype.itemsize
            values = np.frombuffer(raw[: n_values * dtype.itemsize], dtype)
        return values, word + size + 3

    @staticmethod
    def _head(raw: bytes, where: str) -> tuple[int, int]:
        """Return the number of values of a compressed record, and the word that follows it."""
        check(len(raw) >= 8, where, "the header of a compressed record", "less than two words")
        size, second = struct.unpack_from("<ii", raw, 0)
        return check_count(size, where, "a length", largest=100_000_000), second

    def _bits(self, raw: bytes, dtype: np.dtype, where: str) -> NDArray:
        """Decompress at most 32 values; a value is 0 unless its bit is set."""
        size, bits = self._head(raw, where)
        check(size <= 32, where, "at most 32 values in a record compressed by bits", size)
        nonzero = np.array([(bits >> k) & 1 for k in range(size)], bool)
        count = int(nonzero.sum())
        check(8 + count * dtype.itemsize <= len(raw), where, f"{count} values", "fewer: damaged")
        values = np.zeros(size, dtype)
        values[nonzero] = np.frombuffer(raw, dtype, count, 8)
        return values

    def _windows(self, raw: bytes, dtype: np.dtype, where: str) -> NDArray:
        """Decompress windows of a sparse record.

        A positive index precedes a single value.  Any other index (with its sign reversed) precedes
        a length and a run of this length, or one repeated value if the length is negative.
        """
        size, n_windows = self._head(raw, where)
        values = np.zeros(size, dtype)
        position = 8
        for _ in range(n_windows):
            expected = f"{n_windows} windows"
            check(position + 8 <= len(raw), where, expected, "the end of the record")
            index, length = struct.unpack_from("<ii", raw, position)
            if index > 0:
                position += 4
                length = 1
            else:
                position += 8
            first = abs(index)
            n_stored = 1 if length < 0 else length
            length = abs(length)
            within_record = position + n_stored * dtype.itemsize <= len(raw)
            within = first + length <= size and within_record
            check(within, where, f"windows within {size} values", f"one of {length} from {first}")
            values[first : first + length] = np.frombuffer(raw, dtype, n_stored, position)
            # a single short value occupies a whole word
            if n_stored == 1:
                position += max(dtype.itemsize, 4)
            else:
                position += n_stored * dtype.itemsize
        return values


def _long(low: int, high: int) -> int:
    """Return a position in the file from its two words."""
    return (int(high) << 32) + (int(low) & 0xFFFFFFFF)


class _Header:
    """Record of integers with positions from 1, as in the include files of Ansys; absent positions
    are 0.
    """

    def __init__(self, file: _Binary, word: int, name: str) -> None:
        self.item = f"{file.source}: {name}"
        self.values = file.record(word, name)
        self.largest = len(file.data)
        check(self.values.dtype.kind == "i", self.item, "whole numbers", str(self.values.dtype))

    def count(self, position: int, what: str, smallest: int = 1) -> int:
        """Return a count that the size of the file limits."""
        return check_count(self[position], self.item, what, smallest, self.largest)

    def pointer(self, low: int, high: int) -> int:
        """Return a position in the file from the positions of its two words."""
        return _long(self[low], self[high])

    def __getitem__(self, position: int) -> int:
        if position > len(self.values):
            return 0
        return int(self.values[position - 1])


# --------------------------------------------------------------------------------------------------
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
        If the file does not exist or is damaged, or has unsymmetric or lumped matrices, constraint
        equations, or rotations.
    """
    file = _Binary(path, _FULL)
    # the include file fdfull of Ansys gives the positions in the header
    head = _Header(file, _HEADER, "header")
    item = head.item
    assembly = head[1]
    is_unsymmetric = head[14]
    has_lumped_mass = head[11]
    n_constraint_equations = head[21]
    check(assembly == -4, item, "a symbolically assembled matrix (-4)", assembly)
    check(not is_unsymmetric, item, "symmetric matrices", "unsymmetric ones")
    check(not has_lumped_mass, item, "a consistent mass matrix (LUMPM,OFF)", "a lumped one")
    expected = "no constraint equations (CE, CP, CERIG, RBE3) in the matrices"
    check(not n_constraint_equations, item, expected, f"{n_constraint_equations} of them")
    n_eq = head.count(2, "a number of equations")
    n_nodes = head.count(33, "a number of nodes")
    n_eq_of_model = head[62]  # 0 in files of older releases
    expected = f"all {n_eq_of_model} equations of the model ({_COMBINE}FULL)"
    check(n_eq_of_model <= n_eq, item, expected, n_eq)

    # a 64-bit position takes two words of the header
    at_dofs = head.pointer(36, 37)
    at_stiffness = head.pointer(19, 20)
    at_mass = head.pointer(27, 28)
    _, dof_names, node_numbers = file.run(_HEADER, 3, "header, degrees of freedom and nodes")
    counts, constraint = file.run(at_dofs, 2, "degrees of freedom of each node")
    dofs = _full_dofs(path, dof_names, node_numbers, counts, n_nodes, n_eq)
    item = f"{path}: table of fixed components"
    check(len(constraint) >= n_eq, item, f"{n_eq} entries", len(constraint))
    stiffness = _full_matrix(file, at_stiffness, n_eq, "stiffness")
    mass = _full_matrix(file, at_mass, n_eq, "mass")

    # the table has a negative number for each fixed component
    free = np.flatnonzero(constraint[:n_eq] >= 0)
    # components without stiffness are dropped like fixed ones
    free = free[stiffness.diagonal()[free] != 0.0]
    check(len(free) > 0, str(path), "free components", "none")
    # components 1, 2 and 3 are displacements, higher ones rotations and others
    highest = dofs[free, 1].max()
    item = f"{path}: degrees of freedom"
    check(highest <= 3, item, "UX, UY, UZ only", f"number {highest}")
    return FullMatrices(
        stiffness=stiffness[free][:, free].tocsr(),
        mass=mass[free][:, free].tocsr(),
        dofs=dofs[free],
        dropped=n_eq - len(free),
        nodes=np.unique(dofs[:, 0]),
    )


def _full_dofs(
    source: Path, dof_names: NDArray, numbers: NDArray, counts: NDArray, n_nodes: int, n_eq: int
) -> NDArray:
    """Return node number and component (n_eq, 2) of each equation.

    Parameters
    ----------
    dof_names : (n_components,) int
        Components of a node in the order of its equations: 1, 2, 3 for UX, UY, UZ.
    numbers, counts : (n_nodes or more,) int
        Number and count of equations of each node.
    """
    expected = f"{n_nodes} entries, one for each node"
    for what, table in (("node numbers", numbers), ("degrees of freedom of each node", counts)):
        check(len(table) >= n_nodes, f"{source}: table of {what}", expected, len(table))
    numbers = numbers[:n_nodes].astype(np.int64)
    counts = counts[:n_nodes].astype(np.int64)
    in_range = counts.min() >= 0 and counts.max() <= len(dof_names)
    check(
        in_range and counts.sum() == n_eq,
        f"{source}: degrees of freedom of each node",
        f"{n_eq} in all",
        int(counts.sum()),
    )
    # the equations of a node follow each other: node and place within the node of each equation
    node_of_equation = np.repeat(numbers, counts)
    first_of_node = np.cumsum(counts) - counts
    place_in_node = np.arange(n_eq) - np.repeat(first_of_node, counts)
    components = dof_names.astype(np.int64)[place_in_node]
    return np.column_stack([node_of_equation, components])


def _full_matrix(file: _Binary, word: int, n_eq: int, name: str) -> sp.csr_matrix:
    """Read one triangle, stored by rows as a record of columns and a record of values.

    ``word`` is the position of the first record in the file.
    """
    item = f"{file.source}: {name} matrix"
    check(word > 0, item, "a matrix", "none in the file")
    rows, columns, values = [], [], []
    records = file.run(word, 2 * n_eq, f"{name} matrix")
    for row in range(n_eq):
        # columns are counted from 1
        columns_of_row = next(records)
        values_of_row = next(records)
        where = f"{item}, row {row + 1}"
        right_types = columns_of_row.dtype.kind == "i" and values_of_row.dtype.kind == "f"
        n_columns = len(columns_of_row)
        n_values = len(values_of_row)
        expected = "records of columns and values of the same length"
        found = f"{n_columns} and {n_values}"
        check(right_types and n_columns == n_values, where, expected, found)
        lowest = columns_of_row.min(initial=1)
        highest = columns_of_row.max(initial=1)
        within = lowest >= 1 and highest <= n_eq
        check(within, where, f"columns 1 to {n_eq}", f"{lowest} to {highest}")
        rows.append(np.full(n_columns, row))
        columns.append(columns_of_row.astype(np.int64) - 1)
        values.append(values_of_row.astype(float))
    row_of_entry = np.concatenate(rows)
    column_of_entry = np.concatenate(columns)
    entries = np.concatenate(values)
    check_all(np.isfinite(entries), entries, "finite numbers", item)
    # the file may have either triangle; the upper one is wanted
    upper_row = np.minimum(row_of_entry, column_of_entry)
    upper_column = np.maximum(row_of_entry, column_of_entry)
    return triangle_to_full(upper_row, upper_column, entries, n_eq)


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
    body = read_cdb(archive)
    matrices = read_full(full)
    no_node = np.zeros(0, np.int64)
    node_lists = [no_node, *(elements.ravel() for elements in body.elements)]
    nodes_of_solids = np.unique(np.concatenate(node_lists))
    _check_contains(archive, body.numbers, full, matrices.nodes)
    _check_contains(full, matrices.nodes, archive, nodes_of_solids)
    modes = read_rst(results).modes if results is not None else ()
    note = f"{matrices.dropped} rows of fixed components dropped from {full}"
    return replace(
        body,
        stiffness=matrices.stiffness,
        mass=matrices.mass,
        dofs=matrices.dofs,
        modes=modes,
        source=f"{full}, {archive}",
        notes=(*body.notes, note),
    )


def _check_contains(file: FilePath, nodes: NDArray, other: FilePath, required: NDArray) -> None:
    """Raise ModelError unless the nodes of a file include the required nodes of another file."""
    missing = np.setdiff1d(required, nodes)
    listed = ", ".join(map(str, missing[:5]))
    if len(missing) > 5:
        listed += ", ..."
    expected = f"the nodes of {other}, from the same model"
    found = f"{len(missing)} of {len(required)} missing: {listed}"
    check(not len(missing), str(file), expected, found)


# --------------------------------------------------------------------------------------------------
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
        self.lines = lines
        self.source = str(lines.source)
        self.numbers: list[int] = []
        self.positions: list[list[float]] = []
        self.angles: list[list[float]] = []
        self.types: dict[int, str] = {}
        self.current_type = 0
        self.elements: list[list[int]] = []
        self.owners: list[tuple[str, int]] = []  # element type and material number
        self.constants: dict[str, dict[int, float]] = {}
        self.sets: dict[str, NDArray] = {}
        self.skipped: Counter[str] = Counter()
        self.passed_over: Counter[str] = Counter()

    def _integers(self, what: str, fields: list[tuple[bool, slice]]) -> list[int]:
        """Return the whole numbers of the next line; a blank field before a number is 0."""
        text = self.lines.take(what).rstrip()
        filled = [text[columns] for _, columns in fields if columns.start < len(text)]
        expected = "whole numbers in the columns of the format of the block"
        with parsing(self.lines.item, expected, text):
            return [int(word) if word.strip() else 0 for word in filled]

    def _fields(self, block: str) -> list[tuple[bool, slice]]:
        """Parse a Fortran format such as (1i7,2i9,6e21.13e3) or (3i9,2(3e21.13)).

        Returns
        -------
        list of (bool, slice)
            Whether a field contains an integer, and its columns.  Columns of text and skipped
            columns are not returned.
        """
        text = _without_card_number(self.lines.take(f"the format of {block}"))
        item = self.lines.item
        expected = "a format like (3i9,6e21.13e3)"
        found = f"'{text[:40]}'"
        fields: list[tuple[bool, slice]] = []
        start = 0
        for word in _without_groups(text, item).split(","):
            parts = _FORMAT.fullmatch("".join(word.lower().split()))
            if parts is None:
                raise mismatch(item, expected, found)
            count, letter, width = parts.groups("1")
            size = check_count(int(width), item, "a width of fields", smallest=1, largest=100)
            repetitions = check_count(
                int(count), item, "a repetition of fields", smallest=1, largest=100
            )
            for _ in range(repetitions):
                if letter not in ("a", "x"):
                    fields.append((letter == "i", slice(start, start + size)))
                start += size
        self.lines.require(bool(fields), expected, found)
        return fields

    def body(self) -> FEBody:
        self._leave_out_iges()
        for line in self.lines:
            for command in _commands(_without_card_number(line)):
                self._read(command)
        node_axes = {}
        for number, angles in zip(self.numbers, self.angles):
            if any(angles):
                node_axes[number] = _node_axes(np.array(angles))
        notes = [
            f"{count} elements of type {name} are not solids and are not read"
            for name, count in self.skipped.items()
        ]
        if self.passed_over:
            names = ", ".join(self.passed_over)
            notes.append(f"commands of the archive that are not read: {names}")
        return mesh_body(
            self.source,
            "a block of nodes (NBLOCK)",
            self.numbers,
            self.positions,
            self.elements,
            map(self._kind, self.owners, self.elements),
            node_sets=self.sets,
            node_axes=node_axes,
            notes=tuple(notes),
        )

    def _leave_out_iges(self) -> None:
        """Skip the geometry in IGES form with which an archive of the solid model begins."""
        if not self.lines.follows_match(_IGES_START):
            return
        line = ""
        while not line.upper().startswith(":CDWRITE"):
            line = self.lines.take("the line :CDWRITE after the geometry (IGES)")

    def _read(self, command: str) -> None:
        """Read a command with the block that follows it."""
        words = [word.strip() for word in command.split(",")]
        key = words[0].split(" ")[0].upper()
        if key == "NBLOCK":
            self._nodes()
        elif key == "EBLOCK":
            if len(words) >= 3 and words[2].upper() == "SOLID":
                self._elements()
            else:
                self._other_elements(command, words)
        elif key == "CMBLOCK" and len(words) >= 4:
            self._component(words)
        elif key == "ET" and len(words) >= 3 and words[1].isdigit():
            # ET, number, name
            number, name = words[1:3]
            self.types[int(number)] = name.upper().removeprefix("SOLID")
        elif key == "TYPE" and len(words) >= 2 and words[1].isdigit():
            self.current_type = int(words[1])
        elif key == "ETBLOCK":
            self._types()
        elif key == "MPDATA" and len(words) >= 7 and words[4].isdigit():
            # MPDATA, release, count, property, material, first place, value, ...
            constant, material, _, value = words[3:7]
            by_material = self.constants.setdefault(constant.upper(), {})
            # keep the first of several values over temperature
            by_material.setdefault(int(material), float(value))
        elif not _ends_block(words):
            self._pass_over(key, words, command)

    def _pass_over(self, key: str, words: list[str], command: str) -> None:
        """Keep the name of a command for the note.

        Raises
        ------
        ModelError
            If the command changes the mesh or a set of nodes.
        """
        numbers_of_a_block = not re.match(r"[*/~]?[A-Z_]", key)
        if numbers_of_a_block or _ASSIGNMENT.match(command):
            return
        incomplete = key in ("ET", "CMBLOCK")
        names_nodes = key == "CM" and (len(words) < 3 or words[2].upper().startswith("NODE"))
        # an archive begins with NUMOFF, which has no effect before there are nodes
        renumbers = key.startswith("NUMO") and bool(self.numbers)
        if changes_mesh(key) or incomplete or names_nodes or renumbers:
            refuse(command.strip()[:40], self.lines.item, CDB_READ)
        self.passed_over[key] += 1

    def _types(self) -> None:
        """Read numbers and names of element types."""
        fields = self._fields("ETBLOCK")
        while True:
            words = self._integers("the end of ETBLOCK (-1)", fields)
            if words[:1] == [-1]:
                return
            self.lines.require(len(words) >= 2, "number and name of an element type", words)
            self.types[words[0]] = str(words[1])

    def _kind(self, owner: tuple[str, int], nodes: list[int]) -> ElementKind:
        """Return type and material of an element from its element type and material number."""
        type_name, material = owner
        name = f"C3D{len(nodes)}"
        # SOLID186 has reduced integration
        if type_name == "186" and len(nodes) == 20:
            name += "R"
        poisson_ratio = self.constants.get("PRXY", {}) | self.constants.get("NUXY", {})
        return ElementKind(
            name,
            self.constants.get("EX", {}).get(material),
            poisson_ratio.get(material),
            self.constants.get("DENS", {}).get(material),
        )

    def _nodes(self) -> None:
        """Read a block of nodes: number, position and angles of the axes of each."""
        (is_whole, number_columns), *fields = self._fields("NBLOCK")
        self.lines.require(
            is_whole, "a format that begins with a whole number", "a different format"
        )
        real_columns = [columns for is_integer, columns in fields if not is_integer]
        left_justified = False
        while True:
            line = self.lines.take("the end of NBLOCK (-1)")
            words = [word.strip() for word in _without_card_number(line).split(",")]
            if line.startswith("-1") or not line.strip() or _ends_block(words):
                break
            with parsing(self.lines.item, "a node", line):
                number = int(line[number_columns])
                values = []
                for columns in real_columns:
                    if line[columns].strip():
                        left_justified |= _is_left_justified(line, columns)
                        # a card number has no decimal point
                        is_real = "." in line[columns]
                        if not (left_justified and is_real):
                            self._check_whole(line, columns)
                        values.append(_real(line[columns]))
            if number < 0:
                break
            good = len(values) <= 6 and np.isfinite(values).all()
            self.lines.require(good, "at most six finite numbers", f"'{line[:60]}'")
            # numbers of 0 at the end of a line are left out
            values += [0.0] * (6 - len(values))
            self.numbers.append(number)
            self.positions.append(values[:3])
            self.angles.append(values[3:])

    def _check_whole(self, line: str, columns: slice) -> None:
        """Raise ModelError if a line of a block ends within a field.

        A number ends in the last column of its field.  A shorter field is a card number in columns
        73 to 80, or the rest of a damaged line.
        """
        whole = len(line.rstrip()) >= columns.stop
        expected = f"a number that ends in column {columns.stop}, or a line without card numbers"
        self.lines.require(whole, expected, f"'{line[columns].strip()}' at the end of the line")

    def _elements(self) -> None:
        """Read a block of elements; elements other than solids are counted and skipped."""
        fields = self._fields("EBLOCK")
        while True:
            words = self._integers("the end of EBLOCK (-1)", fields)
            if words[:1] == [-1]:
                return
            complete = len(words) >= 12
            self.lines.require(complete, "an element of an EBLOCK in SOLID format", words)
            # eleven numbers, among them these, and then the nodes
            material, kind, n_nodes = words[0], words[1], words[8]
            nodes = words[11:]
            # further nodes are on the next lines
            while len(nodes) < n_nodes:
                nodes += self._integers("the nodes of an element", fields)
            name = self.types.get(kind, "")
            # without a name of the type the number of nodes decides
            n_of_type = _SOLIDS.get(name, 0) if name else n_nodes
            if n_of_type not in (4, 8, 10, 20):
                self.skipped[name or f"{n_nodes} nodes"] += 1
                continue
            expected = f"{n_nodes} nodes of an element"
            self.lines.require(not any(nodes[n_nodes:]), expected, f"{len(nodes)} numbers")
            nodes = nodes[:n_nodes]
            without_some_mid_side_nodes = 0 in nodes or n_nodes != n_of_type
            if without_some_mid_side_nodes:
                nodes = nodes[: N_CORNER[n_of_type]]
            self.elements.append(_without_repeats(nodes))
            self.owners.append((name, material))

    def _other_elements(self, command: str, words: list[str]) -> None:
        """Count the elements of a block without the key SOLID and skip them.

        Workbench writes surface and contact elements so: element, section, real constants,
        material, coordinate system, and at most ten nodes.  The command TYPE names their type;
        without it the type has the number of the section.

        Raises
        ------
        ModelError
            If the elements are solids or their type is not known.
        """
        fields = self._fields("EBLOCK")
        expected = "EBLOCK with the key SOLID, or of a known type of other elements"
        n_nodes = int(words[1]) if len(words) > 1 and words[1].isdigit() else 0
        in_one_line = 0 < n_nodes <= 10
        self.lines.require(in_one_line, expected, f"'{command.strip()}'")
        while True:
            numbers = self._integers("the end of EBLOCK (-1)", fields)
            if numbers[:1] == [-1]:
                return
            complete = 5 < len(numbers) <= 5 + n_nodes
            self.lines.require(complete, f"an element of at most {n_nodes} nodes", numbers)
            name = self.types.get(self.current_type or numbers[1], "")
            is_other = bool(name) and name not in _SOLIDS
            self.lines.require(is_other, expected, f"'{command.strip()}' of type '{name}'")
            self.skipped[name] += 1

    def _component(self, words: list[str]) -> None:
        """Read a component; a component of nodes becomes a set.

        The command is CMBLOCK, name, kind, number of items.
        """
        name, kind = words[1].strip(), words[2].strip().upper()
        item = self.lines.item
        with parsing(item, "a number of items in CMBLOCK", words[3]):
            # digits at the beginning; a comment may follow them
            count = int(re.findall(r"^\d+", words[3].strip())[0])
        n_items = check_count(count, item, "a number of items", smallest=0, largest=50_000_000)
        if not n_items and not self.lines.follows("("):
            return
        fields = self._fields("CMBLOCK")
        items: list[int] = []
        expected = f"{n_items} items of component '{name}'"
        while len(items) < n_items:
            more = self._integers(expected, fields)
            self.lines.require(bool(more), expected, len(items))
            items += more

        # a negative number ends a range that begins with the previous number: 3, -7 is 3 to 7
        members = [np.zeros(0, np.int64)]
        previous = 0
        for number in items[:n_items]:
            ends_range = number < 0
            in_order = 0 < previous <= -number <= previous + 50_000_000
            check(not ends_range or in_order, item, f"ranges in component '{name}'", number)
            first = previous + 1 if ends_range else number
            members.append(np.arange(first, abs(number) + 1))
            previous = abs(number)
        if kind.startswith("NODE") and n_items:
            self.sets[name] = np.concatenate(members)


# the letter of the section and a number in columns 73 to 80
_IGES_START = re.compile(r".{72}S {0,6}\d+\s*$")
# repetition, letter and width of an edit descriptor; Fortran ignores the scale 1p if it reads
# numbers with an exponent
_FORMAT = re.compile(r"(?:1p)?(\d+)?(x(?!\d)|(?:i|e[sn]?|d|f|g|a)(?=\d))(\d+)?(?:\.\d+(?:e\d+)?)?")
_GROUP = re.compile(r"(\d*)\s*\(([^()]*)\)")
DEEPEST_GROUP = 10
"""Largest number of groups in brackets within a format."""
_EXPONENT_ALONE = re.compile(r"([\d.])([+-]\d+)$")
_TEXT = re.compile(r"\s*(/COM|/TIT|/STI|C\*\*\*)", re.IGNORECASE)
_QUOTED_OR_COMMENT = re.compile(r"'[^']*'|!.*")
_ASSIGNMENT = re.compile(r"\s*\w+(\([^)]*\))?\s*=")


def _is_left_justified(line: str, columns: slice) -> bool:
    """Return whether a number begins at the left of its field and leaves its last column blank,
    with further numbers behind it.

    The first column may be blank in place of the sign.
    """
    field = line[columns]
    ends_before = field[-1] == " " and len(line.rstrip()) > columns.stop
    return ends_before and field[:2].strip() != ""


def _without_groups(text: str, item: str) -> str:
    """Return the edit descriptors of a format, with repeated groups in brackets written out."""
    inner = re.fullmatch(r"\s*\((.*)\)\s*", text)
    descriptors = inner.group(1) if inner else text.strip().strip("()")
    for _ in range(DEEPEST_GROUP):
        group = _GROUP.search(descriptors)
        if group is None:
            break
        count = check_count(
            int(group.group(1) or 1), item, "a repetition of fields", smallest=1, largest=100
        )
        repeated = ",".join([group.group(2)] * count)
        descriptors = f"{descriptors[: group.start()]}{repeated}{descriptors[group.end() :]}"
    return descriptors


def _without_card_number(line: str) -> str:
    """Return a command or format without the number of a card in columns 73 to 80."""
    card = line.rstrip()
    is_numbered = len(card) == 80 and card[72:].strip().isdigit() and card[71] == " "
    return card[:72] if is_numbered else line


def _real(text: str) -> float:
    """Return a number in a form of Fortran: with E or D, or without letter before an exponent of
    three digits.
    """
    plain = text.strip().upper().replace("D", "E")
    return float(_EXPONENT_ALONE.sub(r"\1E\2", plain))


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
    """Return the distinct nodes of a wedge or tetrahedron that is stored as a hexahedron.

    Other elements are unchanged.
    """
    if len(nodes) not in (8, 20):
        return nodes
    corners = set(nodes[:8])
    # places of the distinct corners of a wedge and of a tetrahedron
    places = {6: (0, 1, 2, 4, 5, 6), 4: (0, 1, 2, 4)}.get(len(corners))
    if places is None:
        return nodes
    distinct_corners = [nodes[place] for place in places]
    if set(distinct_corners) != corners:
        return nodes
    mid_side = [node for node in dict.fromkeys(nodes[8:]) if node not in distinct_corners]
    distinct = distinct_corners + mid_side
    return distinct if len(distinct) in N_CORNER else nodes


def _node_axes(angles: NDArray) -> NDArray:
    """Return the axes of a node as rows (3, 3) from three angles (degrees).

    They are rotated about Z, the new X and the new Y.
    """
    return Rotation.from_euler("ZXY", angles, degrees=True).as_matrix().T


# --------------------------------------------------------------------------------------------------
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
        Body without matrices.  Its modes are standing waves of the base sector in the axes of the
        file, two for each travelling wave of a nodal diameter between 0 and N/2.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has no modal analysis with displacements UX, UY,
        UZ.
    """
    file = _Binary(path, _RESULT)
    # the include file fdresu of Ansys gives the positions in the header
    head = _Header(file, _HEADER, "header")
    kind_of_analysis = head[8]
    expected = f"a modal analysis: number {_MODAL}"
    check(kind_of_analysis == _MODAL, head.item, expected, kind_of_analysis)
    n_nodes = head.count(3, "a number of nodes")
    n_sets = head.count(9, "a number of result sets")
    # 0 in files of releases without distributed solution
    n_nodes_of_model = head[49] or n_nodes
    if n_nodes_of_model != n_nodes:
        expected = f"all {n_nodes_of_model} nodes of the model ({_COMBINE}RST)"
        raise mismatch(head.item, expected, n_nodes)
    # the index has the low words of all positions, then the high words
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
    modal_mass = 1.0
    result_sets = []
    for d, hertz, shape in zip(diameter.tolist(), frequency.tolist(), shapes):
        result_sets.append((d, hertz, modal_mass, numbers, shape))
    modes = modes_by_diameter(result_sets, str(path))
    notes = (f"{n_sectors} sectors",) if n_sectors > 1 else ()
    return replace(body, modes=modes, notes=notes)


def _rst_diameters(file: _Binary, head: _Header, n_sets: int) -> tuple[int, NDArray]:
    """Return the number of sectors and the nodal diameter of each result set."""
    geometry = _Header(file, head.pointer(16, 47), "geometry header")
    n_stages = geometry[54]
    one_stage = f"sectors of one stage ({_ONE_STAGE})"
    check(n_stages <= 1, head.item, one_stage, f"a multistage result with {n_stages} stages")
    n_sectors = head[21]
    at_diameters = head.pointer(17, 44)
    has_diameters = at_diameters > 0
    diameter = np.zeros(n_sets, int)
    if has_diameters:
        harmonic_indices = file.record(at_diameters, "harmonic indices")[:n_sets]
        # the sign does not change the nodal diameter
        diameter = np.abs(harmonic_indices.astype(int))
    if n_sectors > 1:
        missing = f"the nodal diameters of the disk with {n_sectors} sectors are missing"
        check_sentence(has_diameters, head.item, missing)
    else:
        # each stage of a multistage model has its own number of sectors
        several = f"harmonic indices up to {diameter.max(initial=0)} without a number of sectors"
        check(not diameter.any(), head.item, one_stage, several)
    return n_sectors, diameter


def _rst_mesh(file: _Binary, word: int) -> tuple[FEBody, dict[int, NDArray]]:
    """Return nodes and solid elements, and the axes of nodes with rotated axes."""
    head = _Header(file, word, "geometry header")
    n_nodes = head.count(4, "a number of nodes")
    n_elements = head.count(5, "a number of elements", 0)
    # number, position and angles of each node
    table = np.empty((n_nodes, 7))
    at_nodes = head.pointer(27, 28) or head[9]  # one word in files of older releases
    for k, row in enumerate(file.run(at_nodes, n_nodes, "nodes")):
        if len(row) < 7 or row.dtype.kind != "f" or not np.isfinite(row[:7]).all():
            item = f"{file.source}: nodes, record {k + 1}"
            raise mismatch(item, "seven finite numbers", len(row))
        table[k] = row[:7]
    numbers = table[:, 0].astype(np.int64)
    positions = table[:, 1:4]
    angles = table[:, 4:7]
    elements = _rst_elements(file, head, n_elements, numbers) if n_elements else []
    body = mesh_body(str(file.source), "nodes", numbers, positions, elements)
    axes = {}
    for node in np.flatnonzero(angles.any(axis=1)):
        axes[int(numbers[node])] = _node_axes(angles[node])
    return body, axes


def _rst_elements(file: _Binary, head: _Header, n_elements: int, numbers: NDArray) -> list[NDArray]:
    """Return the node numbers of each solid element whose nodes are all among ``numbers``."""
    start = head.pointer(29, 30) or head[11]  # one word in files of older releases
    words = file.record(start, "index of elements")
    if len(words) >= 2 * n_elements:
        # positions of 64 bits
        words = np.ascontiguousarray(words).astype("<i4").view("<i8")
    elements = []
    for k in range(n_elements):
        item = f"{file.source}: index of elements"
        check(k < len(words), item, f"{n_elements} entries", len(words))
        record = file.record(start + int(words[k]), f"element {k + 1}")
        # ten numbers on type and material come first
        nodes = record[10:].astype(np.int64)
        if len(nodes) in (8, 10, 20) and np.isin(nodes, numbers).all():
            elements.append(np.array(_without_repeats(nodes.tolist())))
    return elements


def _rst_shape(
    file: _Binary, word: int, numbers: NDArray, axes: dict[int, NDArray], k: int
) -> NDArray:
    """Return the displacements (n_nodes, 3) of a result set in the axes of the file."""
    head = _Header(file, word, f"result set {k + 1}")
    item = head.item
    n_nodes = head.count(3, "a number of nodes")
    # degrees of freedom of a node, whose numbers follow, and further values that are not read
    n_dofs = head[20]
    n_further = head[98]
    per_node = check_count(
        n_dofs + n_further, item, "a number of values of each node", smallest=3, largest=64
    )
    dofs = [head[21 + j] for j in range(n_dofs)] if 0 < n_dofs <= 30 else []
    check(dofs[:3] == [1, 2, 3], item, "displacements UX, UY, UZ", f"degrees of freedom {dofs}")
    # relative to the record of the result set; one word in files of older releases
    start = word + (head.pointer(105, 106) or head[11])
    values = file.record(start, f"displacements of result set {k + 1}").astype(float)
    if len(values) < n_nodes * per_node or n_nodes != len(numbers):
        expected = f"{per_node} values of each of {len(numbers)} nodes"
        raise mismatch(item, expected, f"{len(values)} values")
    shape = values[: n_nodes * per_node].reshape(n_nodes, per_node)[:, :3].copy()
    shape[shape == 2.0**100] = 0.0  # the number that Ansys writes for "no value"
    check_all(np.isfinite(shape), shape, "finite displacements", item)
    rotate_to_file(shape, numbers, axes)
    return shape
