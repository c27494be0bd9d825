"""Matrices and tables from plain files: NumPy, MATLAB, Abaqus coordinate text and CSV.

MATLAB files of version 5 to 7.2 are read by this module, because the reader of SciPy crashes on
damaged files.  After a header of 128 bytes a file consists of data elements.  Each has a type and a
length in eight bytes (four bytes for at most four bytes of data), then the data, padded to eight
bytes.  Type 15 contains other elements, compressed by zlib.  Type 14 is an array: flags with its
class, dimensions, name, then the numbers by columns.  A sparse array has row indices, column
pointers and numbers instead.

References
----------
MathWorks, *MAT-File Format*, version 5 (MATLAB documentation).
Dassault Systèmes, *Abaqus Analysis User's Guide*, "Generating matrices" (formats COORDINATE and
MATRIX INPUT).
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import chain, islice
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
        If the file has a different version or is damaged.
    """
    if h5py.is_hdf5(source):
        return _read_mat_73(source)
    data = source.read_bytes()
    if len(data) < 128 or data[126:128] not in (b"IM", b"MI"):
        raise mismatch(str(source), "a MATLAB file of version 5 to 7.3", "no such header")
    order = "<" if data[126:128] == b"IM" else ">"
    version = struct.unpack_from(order + "H", data, 124)[0]
    if version != 0x0100:
        raise mismatch(str(source), "a MATLAB file of version 5 to 7.3", "a different version")
    matrices: dict[str, NDArray | sp.spmatrix] = {}
    room = MOST_BYTES
    for kind, content in _elements(data[128:], order, str(source)):
        if kind == _ARRAY:
            _add_array(matrices, content, order, str(source))
        if kind != _COMPRESSED:
            continue
        # the length before the content tells how much memory it needs
        stream = zlib.decompressobj()
        type_and_length = stream.decompress(content, 8)
        length = int.from_bytes(type_and_length[4:], "little" if order == "<" else "big")
        item = f"{source}: compressed variable"
        room -= check_count(length, item, "bytes, with those before it,", 0, room)
        inner = type_and_length + stream.decompress(stream.unconsumed_tail, length + 1)
        for inner_kind, array in _elements(inner, order, str(source)):
            if inner_kind == _ARRAY:
                _add_array(matrices, array, order, str(source))
    return matrices


def _read_mat_73(source: Path) -> dict[str, NDArray | sp.spmatrix]:
    """Read the real matrices of a MATLAB file of version 7.3, which is an HDF5 file."""
    matrices: dict[str, NDArray | sp.spmatrix] = {}
    room = MOST_BYTES
    with h5py.File(source, "r") as file:
        for name in file:
            # a link may lead to another file
            if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                continue
            item = f"{source}: {name!r}"
            variable = file[name]
            n_rows = variable.attrs.get("MATLAB_sparse")
            if n_rows is None:
                parts = [variable]
            else:
                parts = [variable.get(key) for key in ("data", "ir", "jc")]
            if not all(map(_is_real, parts)):
                continue
            size = sum(part.nbytes for part in parts)
            room -= check_count(size, item, "bytes, with those before it,", 0, room)
            arrays = [part[()] for part in parts]
            if n_rows is not None:
                value = arrays[0].astype(float)
                row = arrays[1].astype(np.int64)
                pointer = arrays[2].astype(np.int64)
                shape = check_count(int(n_rows), item, "a size"), len(pointer) - 1
                # square_matrix checks the indices
                matrices[name] = sp.csc_matrix((value, row, pointer), shape=shape)
            elif arrays[0].ndim == 2:
                # rows are the last dimension
                matrices[name] = arrays[0].T.astype(float)
    return matrices


def _is_real(part: Any) -> bool:
    return isinstance(part, h5py.Dataset) and part.dtype.kind in "fiub"


def _elements(data: bytes, order: str, item: str) -> Iterator[tuple[int, bytes]]:
    """Iterate over type and content of data elements."""
    position = 0
    while position + 8 <= len(data):
        kind, length = struct.unpack_from(order + "II", data, position)
        is_small = kind >> 16 > 0
        if is_small:
            # length and type share the first word, and the data are the second
            length, kind = kind >> 16, kind & 0xFFFF
            start = position + 4
            step = 8
            check(length <= 4, item, "small elements of at most four bytes", length)
        else:
            start = position + 8
            padded = length if kind == _COMPRESSED else (length + 7) // 8 * 8
            step = 8 + padded
        found = f"{len(data) - start}: damaged or truncated"
        check(start + length <= len(data), item, f"{length} bytes of data", found)
        yield kind, data[start : start + length]
        position += step


def _numbers(part: tuple[int, bytes], order: str, item: str) -> NDArray:
    """Return the numbers of a data element."""
    kind, content = part
    check(kind in _TYPES, item, "numbers", f"data of type {kind}")
    dtype = np.dtype(order + _TYPES[kind])
    whole = len(content) % dtype.itemsize == 0
    check(whole, item, f"numbers of {dtype.itemsize} bytes", f"{len(content)} bytes")
    return np.frombuffer(content, dtype)


def _add_array(
    matrices: dict[str, NDArray | sp.spmatrix], content: bytes, order: str, item: str
) -> None:
    """Add a real two-dimensional array to ``matrices``; skip arrays of other kinds."""
    parts = _elements(content, order, item)
    head = list(islice(parts, 3))
    if len(head) < 3:
        return
    flags = _numbers(head[0], order, item)
    size = _numbers(head[1], order, item)
    name = head[2][1].decode("ascii", errors="replace")
    item = f"{item}: {name!r}"
    if len(flags) == 0 or len(size) != 2:
        return
    # the lowest byte is the class of the array, the next one contains the flags
    kind = int(flags[0]) & 0xFF
    is_complex = int(flags[0]) >> 8 & _COMPLEX
    if is_complex or not (kind == _SPARSE or kind in _NUMERIC):
        return
    n_rows = check_count(int(size[0]), item, "a size")
    n_columns = check_count(int(size[1]), item, "a size")
    # the elements after the head
    numbers = [_numbers(part, order, item) for part in parts]
    if kind != _SPARSE:
        expected = f"{n_rows} x {n_columns} numbers"
        complete = len(numbers) == 1 and len(numbers[0]) == n_rows * n_columns
        check(complete, item, expected, sum(map(len, numbers)))
        # stored by columns
        matrices[name] = numbers[0].reshape(n_columns, n_rows).T.astype(float)
        return
    complete = len(numbers) == 3 and len(numbers[1]) > 0
    expected = "rows, pointers and numbers of a sparse matrix"
    check(complete, item, expected, [len(part) for part in numbers])
    stored_row, stored_pointer, stored_value = numbers
    row = stored_row.astype(np.int64)
    pointer = stored_pointer.astype(np.int64)
    value = stored_value.astype(float)
    n_entries = max(int(pointer[-1]), 0)  # the arrays may be longer
    entries = (value[:n_entries], row[:n_entries], pointer)
    # square_matrix checks the indices
    matrices[name] = sp.csc_matrix(entries, shape=(n_rows, n_columns))


# ---- Matrices and tables from plain files ----


COMMENTS = ("#", "*", "%")
"""Beginnings of comment lines."""


@reader("a matrix as .npz, .npy, .mat or .mtx", library=True)
def read_matrix(path: Path, name: str | None = None) -> sp.csr_matrix:
    """Read a square matrix from a file, whose type follows from its extension.

    Parameters
    ----------
    path : path-like
        ``.npz`` of scipy.sparse.save_npz or of arrays, ``.npy``, ``.mat``, or ``.mtx`` (Abaqus
        coordinate text).
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
    known = kind in (".npz", ".npy", ".mat", ".mtx")
    check(known, str(path), "the extension .npz, .npy, .mat or .mtx", f"'{kind}'")
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
    """Return the sparse matrix of a file of SciPy, or one of the arrays of a file of NumPy."""
    with np.load(source, allow_pickle=False) as archive:
        size = sum(member.file_size for member in archive.zip.infolist())
        _check_bytes(size, source)
        is_sparse = {"format", "shape", "data"} <= set(archive)
        if name is not None or not is_sparse:
            return _chosen(archive, name, source)
        for count in np.atleast_1d(archive["shape"]).tolist():
            check_count(count, f"{source}: shape", "a count")
        return sp.load_npz(source)


def _check_bytes(count: int, source: Path) -> None:
    """Raise ModelError if arrays need too much memory, before they are read."""
    check_count(count, f"{source}: arrays", "a size, bytes,", 1, MOST_BYTES)


def _chosen(arrays: Mapping[str, Any], name: str | None, source: Path) -> Any:
    """Return the array of a name; without a name, the only array."""
    names = list(arrays)
    expected = f"an array '{name}' of real numbers"
    if name is None:
        expected = "the name of an array"
        if len(names) == 1:
            name = names[0]
    check(name in names, str(source), expected, f"the arrays {names}")
    return arrays[str(name)]


def square_matrix(matrix: sp.spmatrix | NDArray, item: str) -> sp.csr_matrix:
    """Return a matrix in CSR format.

    Raises
    ------
    ModelError
        If it is not square, real and finite, or an index is not valid.
    """
    matrix = matrix if sp.issparse(matrix) else np.asarray(matrix)
    real = matrix.dtype.kind in "fiu" and matrix.ndim == 2
    check(real, item, "a real matrix", f"an array {matrix.shape} of {matrix.dtype}")
    square = matrix.shape[0] == matrix.shape[1] > 0
    check(square, item, "a square matrix", f"shape {matrix.shape}")
    if hasattr(matrix, "check_format"):
        matrix.check_format(full_check=True)
    entries = sp.coo_matrix(matrix)
    wrong = np.flatnonzero(~np.isfinite(entries.data))
    if len(wrong):
        first = wrong[0]
        place = f"row {entries.row[first] + 1}, column {entries.col[first] + 1}"
        found = f"{entries.data[first]} in {place}, one of {len(wrong)} wrong values"
        raise mismatch(item, "finite numbers", found)
    return entries.astype(float).tocsr()


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
        If a row is not numeric or has a different length; the message gives the line.
    """
    rows: list[list[float]] = []
    # exponents of Fortran begin with D
    translation = str.maketrans(separators + "Dd", " " * len(separators) + "EE")
    for line_number, line in data_lines(source.read_text(errors="replace"), COMMENTS):
        item = f"{source}: line {line_number}"
        words = line.partition("#")[0].translate(translation).split()
        try:
            row = [float(word) for word in words]
        except ValueError:
            has_numbers = any(re.match(r"[-+.]*\d", word) for word in words)
            if not rows and not has_numbers:
                continue  # column names
            raise mismatch(item, "numbers", line[:60]) from None
        if rows and not mixed:
            expected = f"{len(rows[0])} numbers"
            good = len(row) == len(rows[0])
        else:
            expected = f"{' or '.join(map(str, columns))} numbers"
            good = len(row) in columns
        if not good:
            raise mismatch(item, expected, f"{len(row)}")
        rows.append(row)
    check(bool(rows), str(source), "at least one line of numbers", "none")
    return rows


def number_table(source: Path, *columns: int, separators: str | None = None) -> NDArray:
    """Read a table of finite numbers; parameters as for :func:`number_rows`."""
    if separators is not None:
        table = np.array(number_rows(source, *columns, separators=separators))
    else:
        table = _plain_table(source)
        if table.shape[1] not in columns:
            table = np.array(number_rows(source, *columns))
    check_all(np.isfinite(table), table, "finite numbers", str(source))
    return table


def _plain_table(source: Path) -> NDArray:
    """Return a table of numbers between commas, read in a tenth of the time of other forms.

    A file of another form, or without numbers, gives an empty array (0, 0).
    """
    with suppress(ValueError), open(source, encoding="ascii") as file:
        lines = (line for line in file if line.strip() and not line.startswith(COMMENTS))
        first = next(lines, "")
        if first:
            return np.loadtxt(chain([first], lines), delimiter=",", comments=None, ndmin=2)
    return np.empty((0, 0))


def as_integers(values: NDArray, item: str) -> NDArray:
    """Convert an array of floats to integers; raise ModelError if a number is not an integer."""
    # beyond 2^53 not every integer is a float
    wrong = values[(values != np.round(values)) | (np.abs(values) > 2**53)]
    if len(wrong):
        raise mismatch(item, "whole numbers", wrong[0])
    return values.astype(np.int64)


@reader("Abaqus coordinate text")
def read_abaqus_matrix(path: Path) -> tuple[sp.csr_matrix, NDArray | None]:
    """Read a matrix from Abaqus coordinate text.

    The lines contain ``row, column, value`` (``FORMAT=COORDINATE``) or ``node, dof, node, dof,
    value`` (``FORMAT=MATRIX INPUT``).  If the file contains one triangle only, the matrix is
    symmetric.

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
    is_matrix_market = path.read_bytes()[:14].lower() == b"%%matrixmarket"
    found = "a Matrix Market file; pass the matrix of scipy.io.mmread"
    check(not is_matrix_market, str(path), "Abaqus coordinate text", found)
    table = number_table(path, 3, 5)
    if table.shape[1] == 5:
        pairs = as_integers(table[:, :4], str(path)).reshape(-1, 2, 2)
        return entries_by_node(pairs, table[:, 4], path)
    row = as_integers(table[:, 0], f"{path}: column 1") - 1
    column = as_integers(table[:, 1], f"{path}: column 2") - 1
    n = int(max(row.max(), column.max())) + 1
    # each row needs an entry; a row number far above the number of entries is a mistake
    if min(row.min(), column.min()) < 0 or n > 10 * len(row) or n > LARGEST_COUNT:
        expected = "rows and columns counted from 1, all of them used"
        raise mismatch(str(path), expected, f"{n} from {len(row)} entries")
    return triangle_to_full(row, column, table[:, -1], n), None


def entries_by_node(pairs: NDArray, value: NDArray, path: Path) -> tuple[sp.csr_matrix, NDArray]:
    """Return a matrix and the table of its rows from entries with node and component.

    Parameters
    ----------
    pairs : (n, 2, 2) int
        Node and component of the row and of the column of each entry.
    value : (n,) float
    path : Path
        File, for messages.

    Returns
    -------
    matrix : (n_eq, n_eq) sparse
    dofs : (n_eq, 2) int
    """
    node_of_entry = pairs[:, :, 0]
    component_of_entry = pairs[:, :, 1]
    # nodes that Abaqus adds have negative numbers; the message has the first one
    first_internal = node_of_entry[node_of_entry < 0][:1].tolist()
    cure = "a job without contact and constraints, with *MATRIX GENERATE, PUBLIC NODES"
    found = f"internal nodes {first_internal}"
    check(not first_internal, str(path), f"nodes of the mesh: {cure}", found)
    nodes, node_index = np.unique(node_of_entry, return_inverse=True)
    components, component_index = np.unique(component_of_entry, return_inverse=True)
    # a single number for each pair of node and component is faster than np.unique of rows
    key_of_entry = node_index * len(components) + component_index
    keys, equation = np.unique(key_of_entry, return_inverse=True)
    node_of_key = nodes[keys // len(components)]
    component_of_key = components[keys % len(components)]
    dofs = np.column_stack([node_of_key, component_of_key])
    row, column = equation.reshape(-1, 2).T
    check(len(dofs) <= 10 * len(row), str(path), "entries of every row", len(row))
    return triangle_to_full(row, column, value, len(dofs)), dofs


def triangle_to_full(row: NDArray, column: NDArray, value: NDArray, n: int) -> sp.csr_matrix:
    """Return a matrix (n, n) from its entries, or from the entries of one of its triangles."""
    matrix = sp.coo_matrix((value, (row, column)), shape=(n, n)).tocsr()
    is_triangle = np.all(row <= column) or np.all(row >= column)
    if not is_triangle:
        return matrix
    return (matrix + matrix.T - sp.diags(matrix.diagonal())).tocsr()


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
    """Read node number and component (1, 2, 3) of each equation from CSV, or from lines such as
    ``12.3``.

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
        Node numbers from a file with one number per line; otherwise the node numbers of one face
        per line.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, or its lines do not all contain the same number of integers, 1,
        3, 4, 6 or 8.
    """
    table: Any = as_integers(number_table(path, 1, 3, 4, 6, 8), str(path))
    if table.shape[1] == 1:
        return table[:, 0]
    return table


@reader("CSV of the node numbers of solid elements")
def read_elements(path: Path) -> tuple[NDArray, ...]:
    """Read solid elements from CSV, with the node numbers of one element (4, 6, 8, 10, 15 or 20)
    per line.

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
    elements = [as_integers(np.array(row), str(path)) for row in rows]
    return tuple(by_kind(elements)["elements"])


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
    """Make a body from matrices, nodes, a table of equations, sets and elements, given as arrays or
    as files.

    Parameters
    ----------
    stiffness, mass : path-like or (n_eq, n_eq) sparse
        Matrices, or files for :func:`read_matrix`.
    nodes : path-like, (n, 3) array, (numbers, positions) or FEBody
        File for :func:`read_nodes`, positions of nodes numbered from 0, numbers and positions, or a
        mesh.  A mesh is an FEBody or a file for :func:`read_body`; its elements and sets are used.
    dofs : path-like or (n_eq, 2) int, optional
        Node number and component of each equation, or a file for :func:`read_dofs`.  By default the
        table in Abaqus text, or three equations per node.
    sets : mapping of name to path-like or array, optional
        Node numbers (one-dimensional) or faces of elements (two-dimensional), or files for
        :func:`read_set`.
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
    if dofs is None:
        dofs = k_dofs
    else:
        dofs = np.asarray(_loaded(dofs, read_dofs))
    mesh = _mesh(nodes)
    node_sets, face_sets = dict(mesh.node_sets), dict(mesh.face_sets)
    for name, members in (sets or {}).items():
        values = np.asarray(_loaded(members, read_set))
        if values.ndim == 1:
            node_sets[name] = values
        else:
            face_sets[name] = (values,)
    if isinstance(elements, np.ndarray):
        elements = (elements,)
    solids = _loaded(elements, read_elements)
    if not source:
        source = str(stiffness) if isinstance(stiffness, str | os.PathLike) else label
    return replace(
        mesh,
        stiffness=k,
        mass=m,
        dofs=dofs,
        source=source,
        elements=solids or mesh.elements,
        element_kinds=() if solids else mesh.element_kinds,
        node_sets=node_sets,
        face_sets=face_sets,
    )


def _mesh(nodes: FilePath | NDArray | tuple[NDArray, NDArray] | FEBody) -> FEBody:
    """Return the nodes of ``read_arrays`` as a body, with the elements and sets of a mesh."""
    if isinstance(nodes, str | os.PathLike) and Path(nodes).suffix.lower() in BODIES:
        nodes = read_body(nodes)
    if isinstance(nodes, FEBody):
        return nodes
    if isinstance(nodes, np.ndarray):
        numbers, positions = np.arange(len(nodes)), nodes
    else:
        numbers, positions = _loaded(nodes, read_nodes)
    return FEBody(np.asarray(numbers), np.asarray(positions, float))


def _loaded(values: Any, read: Callable[[FilePath], Any]) -> Any:
    """Return arrays, read from their file if ``values`` is a path."""
    return read(values) if isinstance(values, str | os.PathLike) else values


def _with_table(matrix: FilePath | sp.spmatrix, item: str) -> tuple[sp.csr_matrix, NDArray | None]:
    """Return a matrix, and the table of nodes and components if its file has one."""
    if not isinstance(matrix, str | os.PathLike):
        return square_matrix(matrix, item), None
    path = Path(matrix)
    if path.suffix.lower() == ".mtx":
        return read_abaqus_matrix(path)
    return read_matrix(path), None


def reordered(matrix: sp.csr_matrix, dofs: NDArray, order: NDArray, item: str) -> sp.csr_matrix:
    """Return the matrix with its rows in the order of another table of nodes and components."""
    row_of_pair = {tuple(pair): row for row, pair in enumerate(order.tolist())}
    pairs = [tuple(pair) for pair in dofs.tolist()]
    unknown = sorted(set(pairs) - set(row_of_pair))
    check(not unknown, item, "nodes and components of the stiffness matrix", f"also {unknown[:3]}")
    new_row = np.array([row_of_pair[pair] for pair in pairs])
    entries = matrix.tocoo()
    places = (new_row[entries.row], new_row[entries.col])
    return sp.csr_matrix((entries.data, places), shape=(len(order), len(order)))
