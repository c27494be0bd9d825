"""Matrices and tables from plain files: NumPy, MATLAB, Matrix Market, Abaqus coordinate text, CSV.

Real matrices from MATLAB files of version 5 to 7.2.

The package has a reader of its own, since the common one crashes on damaged files.  After a header of 128 bytes come data
elements: a type and a length (eight bytes, or four for data of at most four bytes), then the data, padded to eight bytes.
An element of type 15 holds others, compressed by zlib; one of type 14 is an array: flags with its class, dimensions,
name, then numbers by columns, or rows, column pointers and numbers of a sparse one.

Real matrices from Matrix Market files.

The package has a reader of its own, since the common one crashes on damaged files.  The first line names object, format,
field and symmetry; comments start with ``%``; then come the sizes, then one entry a line, or the numbers by columns.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fem.surface import N_CORNER
from bdamper.importers.fe_body import (
    BODIES,
    LARGEST_COUNT,
    FEBody,
    by_kind,
    check_count,
    data_lines,
    parsing,
    read_body,
    reader,
)
from bdamper.model.fields import check, check_all
from bdamper.util.errors import mismatch
from bdamper.util.storage import MOST_BYTES, FilePath

# ---- Real matrices from MATLAB files of version 5 to 7 ----


_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_ARRAY, _COMPRESSED = 14, 15
_SPARSE, _NUMERIC = 5, range(6, 16)
_COMPLEX = 0x08


def read_mat(source: Path) -> dict[str, NDArray | sp.spmatrix]:
    """All real two-dimensional matrices of a file, by name; other variables are skipped.

    Raises
    ------
    ModelError
    """
    data = source.read_bytes()
    if len(data) < 128 or data[126:128] not in (b"IM", b"MI"):
        found = "version 7.3, an HDF5 file" if data[:4] == b"\x89HDF" or b"MATLAB 7.3" in data[:128] else "no such header"
        raise mismatch(str(source), "a MATLAB file of version 5 to 7.2 (save -v7)", found)
    order = "<" if data[126:128] == b"IM" else ">"
    if struct.unpack_from(order + "H", data, 124)[0] != 0x0100:
        raise mismatch(str(source), "a MATLAB file of version 5 to 7.2 (save -v7)", "another version")
    out: dict[str, NDArray | sp.spmatrix] = {}
    room = MOST_BYTES
    for kind, content in _elements(data[128:], order, str(source)):
        if kind == _COMPRESSED:
            stream = zlib.decompressobj()
            head = stream.decompress(content, 8)  # type and length
            length = int.from_bytes(head[4:], "little" if order == "<" else "big")
            room -= check_count(length, f"{source}: compressed variable", "bytes, with those before it,", 0, room)
            inner = head + stream.decompress(stream.unconsumed_tail, length + 1)
            for part, array in _elements(inner, order, str(source)):
                if part == _ARRAY:
                    _array(array, order, str(source), out)
        elif kind == _ARRAY:
            _array(content, order, str(source), out)
    return out


def _elements(data: bytes, order: str, item: str) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at + 8 <= len(data):
        kind, length = struct.unpack_from(order + "II", data, at)
        if kind >> 16:  # a small element: length and type share the first word, the data are in the second
            length, kind, start, step = kind >> 16, kind & 0xFFFF, at + 4, 8
            check(length <= 4, item, "small elements of at most four bytes", length)
        else:
            start = at + 8
            step = 8 + (length if kind == _COMPRESSED else (length + 7) // 8 * 8)
        check(start + length <= len(data), item, f"{length} bytes of data", f"{len(data) - start}: damaged or truncated")
        yield kind, data[start : start + length]
        at += step


def _numbers(part: tuple[int, bytes], order: str, item: str) -> NDArray:
    kind, content = part
    check(kind in _TYPES, item, "numbers", f"data of type {kind}")
    dtype = np.dtype(order + _TYPES[kind])
    check(not len(content) % dtype.itemsize, item, f"numbers of {dtype.itemsize} bytes", f"{len(content)} bytes")
    return np.frombuffer(content, dtype)


def _array(content: bytes, order: str, item: str, out: dict[str, NDArray | sp.spmatrix]) -> None:
    parts = _elements(content, order, item)
    head = [next(parts, None) for _ in range(3)]
    if any(part is None for part in head):
        return
    flags = _numbers(head[0], order, item)  # type: ignore[arg-type]
    size = _numbers(head[1], order, item)  # type: ignore[arg-type]
    name = head[2][1].decode("ascii", errors="replace")  # type: ignore[index]
    item = f"{item}: {name!r}"
    kind = int(flags[0]) & 0xFF if len(flags) else 0
    if len(flags) == 0 or int(flags[0]) >> 8 & _COMPLEX or len(size) != 2 or not (kind == _SPARSE or kind in _NUMERIC):
        return
    rows, columns = (check_count(int(n), item, "a size") for n in size)
    rest = [_numbers(part, order, item) for part in parts]
    if kind != _SPARSE:
        check(len(rest) == 1 and len(rest[0]) == rows * columns, item, f"{rows} x {columns} numbers", sum(map(len, rest)))
        out[name] = rest[0].reshape(columns, rows).T.astype(float)
        return
    if len(rest) != 3 or len(rest[1]) != columns + 1:
        raise mismatch(item, f"rows, {columns + 1} pointers and numbers of a sparse matrix", f"{[len(r) for r in rest]}")
    row, pointer, value = rest[0].astype(np.int64), rest[1].astype(np.int64), rest[2].astype(float)
    count = int(pointer[-1])
    steps = np.diff(pointer)
    good = pointer[0] == 0 and np.all(steps >= 0) and 0 <= count <= min(len(row), len(value), LARGEST_COUNT)
    check(good, item, "ascending column pointers within the numbers", f"up to {count} of {len(value)}")
    row, value = row[:count], value[:count]
    low, high = row.min(initial=0), row.max(initial=0)
    check(low >= 0 and high < max(rows, 1), item, f"rows 0 to {rows - 1}", f"{low} to {high}")
    out[name] = sp.coo_matrix((value, (row, np.repeat(np.arange(columns), steps))), shape=(rows, columns))


# ---- Real matrices from Matrix Market files ----


def read_market(source: Path) -> sp.coo_matrix | NDArray:
    """The matrix of a file; of a symmetric one, both triangles.

    Raises
    ------
    ModelError
    """
    text, item = source.read_text(encoding="latin-1"), str(source)
    first = text.partition("\n")[0]
    words = first.lower().split()
    if len(words) != 5 or words[:2] != ["%%matrixmarket", "matrix"] or words[2] not in ("coordinate", "array"):
        raise mismatch(f"{item}: line 1", "%%MatrixMarket matrix coordinate|array <field> <symmetry>", first[:60])
    check(words[3] in ("real", "integer", "double"), f"{item}: line 1", "a real matrix", words[3])
    check(words[4] in ("general", "symmetric"), f"{item}: line 1", "a general or symmetric matrix", words[4])
    content = data_lines(text, "%")
    check(bool(content), item, "a line of sizes", "the end of the file")
    (number, head), *body = content
    coordinate, symmetric = words[2] == "coordinate", words[4] == "symmetric"
    with parsing(f"{item}: line {number}", "the sizes of the matrix", head):
        sizes = [int(w) for w in head.split()]
        if len(sizes) != (3 if coordinate else 2):
            raise ValueError
    rows, columns = (check_count(n, f"{item}: size line", "a size") for n in sizes[:2])
    good = not symmetric or rows == columns
    check(good, f"{item}: size line", "as many rows as columns of a symmetric matrix", f"{rows}, {columns}")
    n_values = rows * (rows + 1) // 2 if symmetric else rows * columns
    count = sizes[2] if coordinate else n_values
    check(count == len(body), f"{item}: size line", f"{len(body)} entries, as many as lines follow", count)
    width = 3 if coordinate else 1
    words = " ".join(line for _, line in body).split()
    good = len(words) == width * count
    check(good, item, f"{width} numbers in every line after the sizes", f"{len(words)} in {count} lines")
    try:
        table = np.array(words, dtype=float).reshape(count, width)
    except ValueError as error:  # the text of which ends with the first word that is no number
        raise mismatch(item, "numbers after the sizes", str(error).rpartition(": ")[2]) from None
    if not coordinate:
        if not symmetric:
            return table.reshape(columns, rows).T
        out = np.zeros((rows, rows))
        out.T[np.triu_indices(rows)] = table[:, 0]
        return out + np.tril(out, -1).T
    index = table[:, :2]
    whole = np.isfinite(index).all() and np.all(index == np.floor(index))
    if count and not (whole and index.min() >= 1 and np.all(index.max(axis=0) <= (rows, columns))):
        raise mismatch(item, f"rows 1 to {rows} and columns 1 to {columns}", f"{index.min():g} to {index.max():g}")
    row, column = index.astype(np.int64).T - 1
    value = table[:, 2]
    if symmetric:
        off = row != column
        row, column = np.concatenate([row, column[off]]), np.concatenate([column, row[off]])
        value = np.concatenate([value, value[off]])
    return sp.coo_matrix((value, (row, column)), shape=(rows, columns))


# ---- Matrices and tables from plain files ----


COMMENTS = ("#", "*", "%")
"""How lines start that are no numbers."""


@reader("a matrix as .npz, .npy, .mat or .mtx", library=True)
def read_matrix(path: Path, name: str | None = None) -> sp.csr_matrix:
    """A square matrix from a file, the kind of which follows from its ending.

    Parameters
    ----------
    path : path-like
        ``.npz`` (scipy.sparse.save_npz, or arrays), ``.npy``, ``.mat``, ``.mtx`` (Matrix Market, or Abaqus coordinate
        text: lines of row, column, value or of node, dof, node, dof, value).
    name : str, optional
        Of the array, in files with several.

    Returns
    -------
    (n, n) sparse, float
        For Abaqus text with nodes see :func:`read_abaqus_matrix`, which also returns the table of them.
    """
    kind = path.suffix.lower()
    check(kind in _MATRICES, str(path), "the ending .npz, .npy, .mat or .mtx", f"'{kind}'")
    return square_matrix(_MATRICES[kind](path, name), str(path))


def _from_npz(source: Path, name: str | None) -> sp.spmatrix | NDArray:
    with np.load(source, allow_pickle=False) as archive:
        _check_bytes(sum(member.file_size for member in archive.zip.infolist()), source)
        names = list(archive)
        if name is None and {"format", "shape", "data"} <= set(names):
            shape = archive["shape"]
            for count in np.atleast_1d(shape).tolist():
                check_count(count, f"{source}: shape", "a count")
            return sp.load_npz(source)
        return archive[_chosen(names, name, source)]


def _from_npy(source: Path, name: str | None) -> NDArray:
    _check_bytes(source.stat().st_size, source)
    return np.asarray(np.load(source, allow_pickle=False))


def _check_bytes(count: int, source: Path) -> None:
    """Refuse arrays that would take too much memory before they are read."""
    check_count(count, f"{source}: arrays", "a size, bytes,", 1, MOST_BYTES)


def _from_mat(source: Path, name: str | None) -> sp.spmatrix | NDArray:
    content = read_mat(source)
    return content[_chosen(list(content), name, source)]


def _from_text(source: Path, name: str | None) -> sp.spmatrix | NDArray:
    return read_market(source) if _is_market(source) else read_abaqus_matrix(source)[0]


def _chosen(names: list[str], name: str | None, source: Path) -> str:
    """The name that was asked for, or the only one there is."""
    if name is None and len(names) == 1:
        return names[0]
    wanted = "the name of an array" if name is None else f"an array '{name}' of real numbers"
    check(name in names, str(source), wanted, f"the arrays {names}")
    return str(name)


@reader("a matrix as .mtx")
def _is_market(source: Path) -> bool:
    with open(source, "rb") as file:
        return file.read(14).lower() == b"%%matrixmarket"


_MATRICES: dict[str, Callable[[Path, str | None], sp.spmatrix | NDArray]] = {
    ".npz": _from_npz,
    ".npy": _from_npy,
    ".mat": _from_mat,
    ".mtx": _from_text,
    ".mm": _from_text,
}
"""What reads a matrix, by the ending of the name."""


def square_matrix(matrix: sp.spmatrix | NDArray, item: str) -> sp.csr_matrix:
    """A square matrix of finite real numbers with indices in range, or an error that names ``item``."""
    matrix = matrix if sp.issparse(matrix) else np.asarray(matrix)
    good = matrix.dtype.kind in "fiu" and matrix.ndim == 2
    check(good, item, "a real matrix", f"an array {matrix.shape} of {matrix.dtype}")
    check(matrix.shape[0] == matrix.shape[1] > 0, item, "a square matrix", f"shape {matrix.shape}")
    if hasattr(matrix, "check_format"):
        matrix.check_format(full_check=True)
    out = sp.coo_matrix(matrix)
    wrong = np.flatnonzero(~np.isfinite(out.data))
    if len(wrong):
        k = wrong[0]
        found = f"{out.data[k]} in row {out.row[k] + 1}, column {out.col[k] + 1} and {len(wrong)} such in all"
        raise mismatch(item, "finite numbers", found)
    return out.astype(float).tocsr()


def number_rows(source: Path, *columns: int, mixed: bool = False, separators: str = ",;") -> list[list[float]]:
    """Numbers of a text file, separated by commas or blanks, one row a line.

    Parameters
    ----------
    source : Path
    *columns : int
        How many numbers a row may have.
    mixed : bool
        Whether rows may differ in their number.
    separators : str
        Letters that count as blanks.
    """
    rows: list[list[float]] = []
    for k, line in data_lines(source.read_text(errors="replace"), COMMENTS):
        own = line.partition("#")[0]
        words = own.translate(str.maketrans(separators + "Dd", " " * len(separators) + "EE")).split()
        try:
            row = [float(word) for word in words]
        except ValueError:
            if not rows and not any(re.match(r"[-+.]*\d", word) for word in words):  # a line of column names
                continue
            raise mismatch(f"{source}: line {k}", "numbers", line[:60]) from None
        if len(row) not in columns or not (mixed or len(row) == len((rows or [row])[0])):
            wanted = len(rows[0]) if rows and not mixed else " or ".join(map(str, columns))
            raise mismatch(f"{source}: line {k}", f"{wanted} numbers", f"{len(row)}")
        rows.append(row)
    check(bool(rows), str(source), "at least one line of numbers", "none")
    return rows


def number_table(source: Path, *columns: int, **options: Any) -> NDArray:
    """Rows of as many finite numbers each; parameters as of :func:`number_rows`."""
    table = np.array(number_rows(source, *columns, **options))
    check_all(np.isfinite(table), table, "finite numbers", str(source))
    return table


def as_integers(values: NDArray, item: str) -> NDArray:
    """Whole numbers from a table of floats."""
    if len(values) and (np.any(values != np.round(values)) or np.abs(values).max() > 2**53):
        raise mismatch(item, "whole numbers", values[np.argmax(values != np.round(values))])
    return values.astype(np.int64)


@reader("Abaqus coordinate text")
def read_abaqus_matrix(path: Path) -> tuple[sp.csr_matrix, NDArray | None]:
    """Matrix from Abaqus coordinate text.

    Lines of ``row, column, value`` (``FORMAT=COORDINATE``), or of ``node, dof, node, dof, value``
    (``FORMAT=MATRIX INPUT``).  Where only one triangle is in the file, the other is its mirror image.

    Returns
    -------
    matrix : (n, n) sparse
    dofs : (n, 2) int or None
        Node and component of each row.
    """
    table, dofs = number_table(path, 3, 5), None
    if table.shape[1] == 3:
        row, column = (as_integers(table[:, k], f"{path}: column {k + 1}") - 1 for k in (0, 1))
    else:
        pairs = as_integers(table[:, :4].ravel(), str(path)).reshape(-1, 2)
        dofs, inverse = np.unique(pairs, axis=0, return_inverse=True)
        row, column = np.asarray(inverse).reshape(-1, 2).T
    n = int(max(row.max(), column.max())) + 1
    if min(row.min(), column.min()) < 0 or n > 10 * len(row) or n > LARGEST_COUNT:
        raise mismatch(str(path), "rows and columns counted from 1, all of them used", f"{n} from {len(row)} entries")
    return triangle_to_full(row, column, table[:, -1], n), dofs


def triangle_to_full(row: NDArray, column: NDArray, value: NDArray, n: int) -> sp.csr_matrix:
    """Matrix (n, n) from entries; if all are on one side of the diagonal, with their mirror images."""
    matrix = sp.coo_matrix((value, (row, column)), shape=(n, n)).tocsr()
    if np.all(row <= column) or np.all(row >= column):
        matrix = (matrix + matrix.T - sp.diags(matrix.diagonal())).tocsr()
    return matrix


@reader("CSV with the columns number, x, y, z")
def read_nodes(path: Path) -> tuple[NDArray, NDArray]:
    """Node numbers (n,) and positions (n, 3) from CSV with the columns number, x, y, z."""
    table = number_table(path, 4)
    return as_integers(table[:, 0], f"{path}: column 1"), table[:, 1:]


@reader("CSV with the columns node, component")
def read_dofs(path: Path) -> NDArray:
    """Node number and component (1, 2, 3) of each matrix row, (n, 2), from CSV or from text like ``12.3``."""
    table = number_table(path, 2, separators=",;.")
    return as_integers(table.ravel(), str(path)).reshape(-1, 2)


@reader("CSV of node numbers")
def read_set(path: Path) -> NDArray:
    """Node numbers (n,) from CSV with any number of them a line, or faces (n, 3 | 4 | 6 | 8), one a line.

    A file with a single number a line is a set of nodes; one with a fixed count of 3, 4, 6 or 8 a line holds faces.
    """
    table = number_table(path, 1, 3, 4, 6, 8)
    whole: Any = as_integers(table.ravel(), str(path)).reshape(table.shape)
    return whole[:, 0] if whole.shape[1] == 1 else whole


@reader("CSV of the node numbers of solid elements")
def read_elements(path: Path) -> tuple[NDArray, ...]:
    """Solid elements from CSV: the node numbers of one element a line (4, 6, 8, 10, 15 or 20), corners first.

    Hexahedra: four corners in turn around one face, then the four opposite ones in the same turn.
    """
    rows = number_rows(path, *N_CORNER, mixed=True)
    return tuple(by_kind(as_integers(np.array(row), str(path)) for row in rows)["elements"])


def read_arrays(
    stiffness: FilePath | sp.spmatrix,
    mass: FilePath | sp.spmatrix,
    nodes: FilePath | NDArray | tuple[NDArray, NDArray] | FEBody,
    dofs: FilePath | NDArray | None = None,
    sets: dict[str, FilePath | NDArray] | None = None,
    elements: FilePath | NDArray | tuple[NDArray, ...] = (),
    source: str = "",
) -> FEBody:
    """A body from matrices, a node table, a dof table and sets, each given as arrays or as a file.

    Parameters
    ----------
    stiffness, mass : path-like or sparse matrix
        See :func:`read_matrix`.
    nodes : path-like, (n, 3) array, (numbers, positions) or FEBody
        See :func:`read_nodes`; positions alone are numbered from 0; or a mesh, as a body or a file that :func:`read_body`
        reads, with its elements and sets.
    dofs : path-like or (n_eq, 2) int, optional
        See :func:`read_dofs`; by default three rows a node, or the table in Abaqus text with nodes.
    sets : mapping of name to path-like or array, optional
        One-dimensional: node numbers; two-dimensional: faces of elements.
    elements : path-like, int array or tuple of these
        See :func:`read_elements` and :class:`FEBody`.
    source : str
        What messages call the body; the file of the stiffness by default.
    """
    what = source or "the given arrays"
    k, k_dofs = _with_table(stiffness, f"{what}: stiffness matrix")
    m, m_dofs = _with_table(mass, f"{what}: mass matrix")
    if dofs is None and k_dofs is not None and m_dofs is not None:
        m = _reordered(m, m_dofs, k_dofs, str(mass))
    dofs = k_dofs if dofs is None else np.asarray(_loaded(dofs, read_dofs))
    if isinstance(nodes, str | os.PathLike) and Path(nodes).suffix.lower() in BODIES:
        nodes = read_body(nodes)
    if isinstance(nodes, FEBody):
        mesh = nodes
    else:
        table = (np.arange(len(nodes)), nodes) if isinstance(nodes, np.ndarray) else nodes
        numbers, positions = _loaded(table, read_nodes)
        mesh = FEBody(np.asarray(numbers), np.asarray(positions, float))
    loaded = {name: np.asarray(_loaded(given, read_set)) for name, given in (sets or {}).items()}
    node_sets = {name: values for name, values in loaded.items() if values.ndim == 1}
    face_sets = {name: (values,) for name, values in loaded.items() if values.ndim != 1}
    own = _loaded((elements,) if isinstance(elements, np.ndarray) else elements, read_elements)
    source = source or (str(stiffness) if isinstance(stiffness, str | os.PathLike) else what)
    return replace(
        mesh, stiffness=k, mass=m, dofs=dofs, source=source, elements=own or mesh.elements,
        element_kinds=() if own else mesh.element_kinds, node_sets={**mesh.node_sets, **node_sets},
        face_sets={**mesh.face_sets, **face_sets},
    )  # fmt: skip


def _loaded(given: Any, read: Callable[[FilePath], Any]) -> Any:
    """The content of a file; what is no path is taken as it is."""
    return read(given) if isinstance(given, str | os.PathLike) else given


def _with_table(given: FilePath | sp.spmatrix, item: str) -> tuple[sp.csr_matrix, NDArray | None]:
    """A matrix, given or from a file, and the table of its rows where it is Abaqus text."""
    if not isinstance(given, str | os.PathLike):
        return square_matrix(given, item), None
    path = Path(given)
    if path.suffix.lower() == ".mtx" and path.is_file() and not _is_market(path):
        return read_abaqus_matrix(path)
    return read_matrix(path), None


def _reordered(matrix: sp.csr_matrix, own: NDArray, wanted: NDArray, item: str) -> sp.csr_matrix:
    """The matrix with rows in the order of another table of nodes and components."""
    index = {tuple(pair): k for k, pair in enumerate(wanted.tolist())}
    pairs = [tuple(pair) for pair in own.tolist()]
    unknown = sorted(set(pairs) - set(index))
    check(not unknown, item, "nodes and components of the stiffness matrix", f"also {unknown[:3]}")
    place, entries = np.array([index[pair] for pair in pairs]), matrix.tocoo()
    return sp.csr_matrix((entries.data, (place[entries.row], place[entries.col])), shape=(len(wanted), len(wanted)))
