"""Matrices and tables from plain files: NumPy, MATLAB, Abaqus coordinate text and CSV.

MATLAB files of version 5 to 7.2 are read by this module, since the reader of SciPy crashes on damaged files.  After a
header of 128 bytes a file consists of data elements.  Each has a type and a length in eight bytes (four bytes for at most
four bytes of data), then the data, padded to eight bytes.  Type 15 contains other elements, compressed by zlib.  Type 14 is
an array: flags with its class, dimensions, name, then the numbers by columns.  A sparse array has row indices, column
pointers and numbers instead.

References
----------
MathWorks, *MAT-File Format*, version 5 (MATLAB documentation).
Dassault Systèmes, *Abaqus Analysis User's Guide*, "Generating matrices" (formats COORDINATE and MATRIX INPUT).
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import h5py
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
    read_body,
    reader,
)
from bdamper.util import validation
from bdamper.util.errors import check, mismatch
from bdamper.util.records import check_all
from bdamper.util.storage import MOST_BYTES, FilePath

# ---- MATLAB files of version 5 to 7.2 ----


_TYPES = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
_ARRAY, _COMPRESSED = 14, 15
_SPARSE, _NUMERIC = 5, range(6, 16)
_COMPLEX = 0x08


def read_mat(source: Path) -> dict[str, NDArray | sp.spmatrix]:
    """Read the real two-dimensional matrices of a MATLAB file, by name; skip other variables.

    Raises
    ------
    ModelError
        If the file has another version or is damaged.
    """
    if h5py.is_hdf5(source):
        return _read_mat_73(source)
    data = source.read_bytes()
    if len(data) < 128 or data[126:128] not in (b"IM", b"MI"):
        raise mismatch(str(source), "a MATLAB file of version 5 to 7.3", "no such header")
    order = "<" if data[126:128] == b"IM" else ">"
    if struct.unpack_from(order + "H", data, 124)[0] != 0x0100:
        raise mismatch(str(source), "a MATLAB file of version 5 to 7.3", "another version")
    out: dict[str, NDArray | sp.spmatrix] = {}
    room = MOST_BYTES
    for kind, content in _elements(data[128:], order, str(source)):
        if kind == _COMPRESSED:
            stream = zlib.decompressobj()
            head = stream.decompress(content, 8)  # type and length
            length = int.from_bytes(head[4:], "little" if order == "<" else "big")
            room -= check_count(
                length, f"{source}: compressed variable", "bytes, with those before it,", 0, room
            )
            inner = head + stream.decompress(stream.unconsumed_tail, length + 1)
            for part, array in _elements(inner, order, str(source)):
                if part == _ARRAY:
                    _array(array, order, str(source), out)
        elif kind == _ARRAY:
            _array(content, order, str(source), out)
    return out


def _read_mat_73(source: Path) -> dict[str, NDArray | sp.spmatrix]:
    """Read the real matrices of a MATLAB file of version 7.3, which is an HDF5 file; rows are its last dimension."""
    out, room = dict[str, NDArray | sp.spmatrix](), MOST_BYTES
    with h5py.File(source, "r") as file:
        for name in file:
            if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                continue
            item, found = f"{source}: {name!r}", file[name]
            rows = found.attrs.get("MATLAB_sparse")
            parts = [found] if rows is None else [found.get(key) for key in ("data", "ir", "jc")]
            if not all(
                isinstance(part, h5py.Dataset) and part.dtype.kind in "fiub" for part in parts
            ):
                continue
            room -= check_count(
                sum(part.nbytes for part in parts), item, "bytes, with those before it,", 0, room
            )
            arrays = [part[()] for part in parts]
            if rows is None:
                if arrays[0].ndim == 2:
                    out[name] = arrays[0].T.astype(float)
                continue
            shape = check_count(int(rows), item, "a size"), len(arrays[2]) - 1
            value, row, pointer = (
                arrays[0].astype(float),
                *(array.astype(np.int64) for array in arrays[1:]),
            )
            out[name] = sp.csc_matrix(
                (value, row, pointer), shape=shape
            )  # checked by square_matrix
    return out


def _elements(data: bytes, order: str, item: str) -> Iterator[tuple[int, bytes]]:
    """Iterate over type and content of data elements."""
    at = 0
    while at + 8 <= len(data):
        kind, length = struct.unpack_from(order + "II", data, at)
        if kind >> 16:  # small element: length and type in the first word, data in the second
            length, kind, start, step = kind >> 16, kind & 0xFFFF, at + 4, 8
            check(length <= 4, item, "small elements of at most four bytes", length)
        else:
            start = at + 8
            step = 8 + (length if kind == _COMPRESSED else (length + 7) // 8 * 8)
        check(
            start + length <= len(data),
            item,
            f"{length} bytes of data",
            f"{len(data) - start}: damaged or truncated",
        )
        yield kind, data[start : start + length]
        at += step


def _numbers(part: tuple[int, bytes], order: str, item: str) -> NDArray:
    kind, content = part
    check(kind in _TYPES, item, "numbers", f"data of type {kind}")
    dtype = np.dtype(order + _TYPES[kind])
    check(
        not len(content) % dtype.itemsize,
        item,
        f"numbers of {dtype.itemsize} bytes",
        f"{len(content)} bytes",
    )
    return np.frombuffer(content, dtype)


def _array(content: bytes, order: str, item: str, out: dict[str, NDArray | sp.spmatrix]) -> None:
    """Add a real two-dimensional array to ``out``; skip arrays of other kinds."""
    parts = _elements(content, order, item)
    head = [next(parts, None) for _ in range(3)]
    if any(part is None for part in head):
        return
    flags = _numbers(head[0], order, item)  # type: ignore[arg-type]
    size = _numbers(head[1], order, item)  # type: ignore[arg-type]
    name = head[2][1].decode("ascii", errors="replace")  # type: ignore[index]
    item = f"{item}: {name!r}"
    kind = int(flags[0]) & 0xFF if len(flags) else 0
    if (
        len(flags) == 0
        or int(flags[0]) >> 8 & _COMPLEX
        or len(size) != 2
        or not (kind == _SPARSE or kind in _NUMERIC)
    ):
        return
    rows, columns = (check_count(int(n), item, "a size") for n in size)
    rest = [_numbers(part, order, item) for part in parts]
    if kind != _SPARSE:
        check(
            len(rest) == 1 and len(rest[0]) == rows * columns,
            item,
            f"{rows} x {columns} numbers",
            sum(map(len, rest)),
        )
        out[name] = rest[0].reshape(columns, rows).T.astype(float)
        return
    good = len(rest) == 3 and len(rest[1]) > 0
    check(good, item, "rows, pointers and numbers of a sparse matrix", [len(part) for part in rest])
    row, pointer, value = rest[0].astype(np.int64), rest[1].astype(np.int64), rest[2].astype(float)
    count = max(int(pointer[-1]), 0)  # the arrays may be longer
    out[name] = sp.csc_matrix(
        (value[:count], row[:count], pointer), shape=(rows, columns)
    )  # checked by square_matrix


# ---- Matrices and tables from plain files ----


COMMENTS = ("#", "*", "%")
"""Beginnings of comment lines."""


@reader("a matrix as .npz, .npy, .mat or .mtx", library=True)
def read_matrix(path: Path, name: str | None = None) -> sp.csr_matrix:
    """Read a square matrix from a file, by the ending of its name.

    Parameters
    ----------
    path : path-like
        ``.npz`` of scipy.sparse.save_npz or of arrays, ``.npy``, ``.mat``, or ``.mtx`` (Abaqus coordinate text).
    name : str, optional
        Name of the array in a file with several arrays.

    Returns
    -------
    (n, n) sparse, float
        :func:`read_abaqus_matrix` returns the table of nodes and components in addition.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist or has no such square matrix of finite real numbers.
    """
    kind = path.suffix.lower()
    check(
        kind in (".npz", ".npy", ".mat", ".mtx"),
        str(path),
        "the ending .npz, .npy, .mat or .mtx",
        f"'{kind}'",
    )
    if kind == ".mtx":
        matrix = read_abaqus_matrix(path)[0]
    elif kind == ".mat":
        matrix = _chosen(read_mat(path), name, path)
    elif kind == ".npy":
        _check_bytes(path.stat().st_size, path)
        matrix = np.load(path, allow_pickle=False)
    else:
        matrix = _from_npz(path, name)
    return square_matrix(matrix, str(path))


def _from_npz(source: Path, name: str | None) -> sp.spmatrix | NDArray:
    with np.load(source, allow_pickle=False) as archive:
        _check_bytes(sum(member.file_size for member in archive.zip.infolist()), source)
        if name is None and {"format", "shape", "data"} <= set(archive):
            for count in np.atleast_1d(archive["shape"]).tolist():
                check_count(count, f"{source}: shape", "a count")
            return sp.load_npz(source)
        return _chosen(archive, name, source)


def _check_bytes(count: int, source: Path) -> None:
    """Raise ModelError if arrays need too much memory, before they are read."""
    check_count(count, f"{source}: arrays", "a size, bytes,", 1, MOST_BYTES)


def _chosen(arrays: Mapping[str, Any], name: str | None, source: Path) -> Any:
    wanted, names = (
        "the name of an array" if name is None else f"an array '{name}' of real numbers",
        list(arrays),
    )
    if name is None and len(names) == 1:
        (name,) = names
    check(name in names, str(source), wanted, f"the arrays {names}")
    return arrays[str(name)]


def square_matrix(matrix: sp.spmatrix | NDArray, item: str) -> sp.csr_matrix:
    """Return a matrix in CSR format; raise ModelError unless it is square, real and finite with valid indices."""
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
        found = f"{out.data[k]} in row {out.row[k] + 1}, column {out.col[k] + 1}, one of {len(wrong)} wrong values"
        raise mismatch(item, "finite numbers", found)
    return out.astype(float).tocsr()


def number_rows(
    source: Path, *columns: int, mixed: bool = False, separators: str = ",;"
) -> list[list[float]]:
    """Read rows of numbers from a text file, separated by commas or blanks.

    A first line of column names and lines that start with a comment sign are skipped.

    Parameters
    ----------
    source : Path
    *columns : int
        Permitted numbers of columns.
    mixed : bool
        Whether rows may differ in length.
    separators : str
        Characters that are treated as blanks.

    Raises
    ------
    ModelError
        If a row is not numeric or has another length; the message names the line.
    """
    rows: list[list[float]] = []
    for k, line in data_lines(source.read_text(errors="replace"), COMMENTS):
        words = (
            line.partition("#")[0]
            .translate(str.maketrans(separators + "Dd", " " * len(separators) + "EE"))
            .split()
        )
        try:
            row = [float(word) for word in words]
        except ValueError:
            if not rows and not any(
                re.match(r"[-+.]*\d", word) for word in words
            ):  # line of column names
                continue
            raise mismatch(f"{source}: line {k}", "numbers", line[:60]) from None
        if len(row) not in columns or not (mixed or len(row) == len((rows or [row])[0])):
            wanted = len(rows[0]) if rows and not mixed else " or ".join(map(str, columns))
            raise mismatch(f"{source}: line {k}", f"{wanted} numbers", f"{len(row)}")
        rows.append(row)
    check(bool(rows), str(source), "at least one line of numbers", "none")
    return rows


def number_table(source: Path, *columns: int, **options: Any) -> NDArray:
    """Read a table of finite numbers; parameters as for :func:`number_rows`."""
    table = np.empty((0, 0))
    with (
        suppress(ValueError),
        open(source, encoding="ascii") as file,
    ):  # plain tables, in a tenth of the time
        lines = (line for line in file if line.strip() and not line.startswith(COMMENTS))
        if not options and (first := next(lines, "")):
            table = np.loadtxt(chain([first], lines), delimiter=",", comments=None, ndmin=2)
    if table.shape[1] not in columns:
        table = np.array(number_rows(source, *columns, **options))
    check_all(np.isfinite(table), table, "finite numbers", str(source))
    return table


def as_integers(values: NDArray, item: str) -> NDArray:
    """Convert an array of floats to integers; raise ModelError if a number is not an integer."""
    for wrong in values[(values != np.round(values)) | (np.abs(values) > 2**53)][:1]:
        raise mismatch(item, "whole numbers", wrong)
    return values.astype(np.int64)


@reader("Abaqus coordinate text")
def read_abaqus_matrix(path: Path) -> tuple[sp.csr_matrix, NDArray | None]:
    """Read a matrix from Abaqus coordinate text.

    The lines contain ``row, column, value`` (``FORMAT=COORDINATE``) or ``node, dof, node, dof, value``
    (``FORMAT=MATRIX INPUT``).  If the file contains one triangle only, the matrix is symmetric.

    Returns
    -------
    matrix : (n, n) sparse
    dofs : (n, 2) int or None
        Node number and component of each row, if the file has them.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist or is damaged.
    """
    market = path.read_bytes()[:14].lower() == b"%%matrixmarket"
    check(
        not market,
        str(path),
        "Abaqus coordinate text",
        "a Matrix Market file; pass the matrix of scipy.io.mmread",
    )
    table = number_table(path, 3, 5)
    if table.shape[1] == 5:
        return entries_by_node(
            as_integers(table[:, :4], str(path)).reshape(-1, 2, 2), table[:, 4], path
        )
    row, column = (as_integers(table[:, k], f"{path}: column {k + 1}") - 1 for k in (0, 1))
    n = int(max(row.max(), column.max())) + 1
    if min(row.min(), column.min()) < 0 or n > 10 * len(row) or n > LARGEST_COUNT:
        raise mismatch(
            str(path),
            "rows and columns counted from 1, all of them used",
            f"{n} from {len(row)} entries",
        )
    return triangle_to_full(row, column, table[:, -1], n), None


def entries_by_node(pairs: NDArray, value: NDArray, path: Path) -> tuple[sp.csr_matrix, NDArray]:
    """Return a matrix from node and component of the rows and columns (n, 2, 2) of its entries (n,), and its table."""
    internal = pairs[pairs[:, :, 0] < 0][:1]
    cure = "a job without contact and constraints, with *MATRIX GENERATE, PUBLIC NODES"
    check(
        not len(internal),
        str(path),
        f"nodes of the mesh: {cure}",
        f"internal nodes {internal[:, 0].tolist()}",
    )
    (nodes, node), (components, component) = (
        np.unique(pairs[:, :, k], return_inverse=True) for k in (0, 1)
    )
    keys, inverse = np.unique(
        node * len(components) + component, return_inverse=True
    )  # faster than np.unique of rows
    dofs = np.column_stack([nodes[keys // len(components)], components[keys % len(components)]])
    row, column = inverse.reshape(-1, 2).T
    check(len(dofs) <= 10 * len(row), str(path), "entries of every row", len(row))
    return triangle_to_full(row, column, value, len(dofs)), dofs


def triangle_to_full(row: NDArray, column: NDArray, value: NDArray, n: int) -> sp.csr_matrix:
    """Return a matrix (n, n) from its entries; if all are in one triangle, mirror them at the diagonal."""
    matrix = sp.coo_matrix((value, (row, column)), shape=(n, n)).tocsr()
    if np.all(row <= column) or np.all(row >= column):
        matrix = (matrix + matrix.T - sp.diags(matrix.diagonal())).tocsr()
    return matrix


@reader("CSV with the columns number, x, y, z")
def read_nodes(path: Path) -> tuple[NDArray, NDArray]:
    """Read a table of nodes from CSV with the columns number, x, y, z.

    Returns
    -------
    numbers : (n,) int
    positions : (n, 3) float

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, or a line does not contain an integer and three numbers.
    """
    table = number_table(path, 4)
    return as_integers(table[:, 0], f"{path}: column 1"), table[:, 1:]


@reader("CSV with the columns node, component")
def read_dofs(path: Path) -> NDArray:
    """Read node number and component (1, 2, 3) of each equation from CSV, or from lines such as ``12.3``.

    Returns
    -------
    (n_eq, 2) int

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, or a line does not contain two integers.
    """
    return as_integers(number_table(path, 2, separators=",;."), str(path))


@reader("CSV of node numbers")
def read_set(path: Path) -> NDArray:
    """Read node numbers or faces from CSV.

    Returns
    -------
    (n,) int or (n, 3 | 4 | 6 | 8) int
        Node numbers from a file with one number per line; otherwise the node numbers of one face per line.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, or its lines do not all contain the same number of integers, 1, 3, 4, 6 or 8.
    """
    whole: Any = as_integers(number_table(path, 1, 3, 4, 6, 8), str(path))
    return whole[:, 0] if whole.shape[1] == 1 else whole


@reader("CSV of the node numbers of solid elements")
def read_elements(path: Path) -> tuple[NDArray, ...]:
    """Read solid elements from CSV, with the node numbers of one element (4, 6, 8, 10, 15 or 20) per line.

    The corners are first, in the order of :class:`FEBody`.

    Returns
    -------
    tuple of (n, n_nodes) int arrays
        One for each number of nodes.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, or a line does not contain 4, 6, 8, 10, 15 or 20 integers.
    """
    rows = number_rows(path, *N_CORNER, mixed=True)
    return tuple(by_kind(as_integers(np.array(row), str(path)) for row in rows)["elements"])


@validation.check_arguments
def read_arrays(
    stiffness: FilePath | sp.spmatrix,
    mass: FilePath | sp.spmatrix,
    nodes: FilePath | NDArray | tuple[NDArray, NDArray] | FEBody,
    dofs: FilePath | NDArray | None = None,
    sets: dict[str, FilePath | NDArray] | None = None,
    elements: FilePath | NDArray | tuple[NDArray, ...] = (),
    source: str = "",
) -> FEBody:
    """Make a body from matrices, nodes, a table of equations, sets and elements, given as arrays or as files.

    Parameters
    ----------
    stiffness, mass : path-like or (n_eq, n_eq) sparse
        Matrices, or files for :func:`read_matrix`.
    nodes : path-like, (n, 3) array, (numbers, positions) or FEBody
        File for :func:`read_nodes`, positions of nodes numbered from 0, numbers and positions, or a mesh.  A mesh is an
        FEBody or a file for :func:`read_body`; its elements and sets are used.
    dofs : path-like or (n_eq, 2) int, optional
        Node number and component of each equation, or a file for :func:`read_dofs`.  By default the table in Abaqus text,
        or three equations per node.
    sets : mapping of name to path-like or array, optional
        Node numbers (one-dimensional) or faces of elements (two-dimensional), or files for :func:`read_set`.
    elements : path-like, int array or tuple of int arrays
        Elements as in :class:`FEBody`, or a file for :func:`read_elements`.
    source : str
        Name of the body in messages; by default the file of the stiffness.

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If a file does not exist or is damaged, or the two matrices have different equations.
    """
    label = source or "the given arrays"
    k, k_dofs = _with_table(stiffness, f"{label}: stiffness matrix")
    m, m_dofs = _with_table(mass, f"{label}: mass matrix")
    if dofs is None and k_dofs is not None and m_dofs is not None:
        m = reordered(m, m_dofs, k_dofs, str(mass))
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
    solids = _loaded((elements,) if isinstance(elements, np.ndarray) else elements, read_elements)
    source = source or (str(stiffness) if isinstance(stiffness, str | os.PathLike) else label)
    return replace(
        mesh, stiffness=k, mass=m, dofs=dofs, source=source, elements=solids or mesh.elements,
        element_kinds=() if solids else mesh.element_kinds, node_sets={**mesh.node_sets, **node_sets},
        face_sets={**mesh.face_sets, **face_sets},
    )  # fmt: skip


def _loaded(values: Any, read: Callable[[FilePath], Any]) -> Any:
    return read(values) if isinstance(values, str | os.PathLike) else values


def _with_table(matrix: FilePath | sp.spmatrix, item: str) -> tuple[sp.csr_matrix, NDArray | None]:
    if not isinstance(matrix, str | os.PathLike):
        return square_matrix(matrix, item), None
    path = Path(matrix)
    if path.suffix.lower() == ".mtx":
        return read_abaqus_matrix(path)
    return read_matrix(path), None


def reordered(matrix: sp.csr_matrix, dofs: NDArray, order: NDArray, item: str) -> sp.csr_matrix:
    """Return the matrix with its rows in the order of another table of nodes and components."""
    index = {tuple(pair): k for k, pair in enumerate(order.tolist())}
    pairs = [tuple(pair) for pair in dofs.tolist()]
    unknown = sorted(set(pairs) - set(index))
    check(not unknown, item, "nodes and components of the stiffness matrix", f"also {unknown[:3]}")
    row, entries = np.array([index[pair] for pair in pairs]), matrix.tocoo()
    return sp.csr_matrix(
        (entries.data, (row[entries.row], row[entries.col])), shape=(len(order), len(order))
    )
