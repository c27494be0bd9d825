"""Real matrices from Matrix Market files.

The package has a reader of its own, since the common one crashes on damaged files.  The first line names object, format,
field and symmetry; comments start with ``%``; then come the sizes, then one entry a line, or the numbers by columns.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.importers.reader_registry import check_count, data_lines, parsing
from bdamper.model.fields import require
from bdamper.util.errors import mismatch


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
    require(words[3] in ("real", "integer", "double"), f"{item}: line 1", "a real matrix", words[3])
    require(words[4] in ("general", "symmetric"), f"{item}: line 1", "a general or symmetric matrix", words[4])
    content = data_lines(text, "%")
    require(bool(content), item, "a line of sizes", "the end of the file")
    (number, head), *body = content
    coordinate, symmetric = words[2] == "coordinate", words[4] == "symmetric"
    with parsing(f"{item}: line {number}", "the sizes of the matrix", head):
        sizes = [int(w) for w in head.split()]
        if len(sizes) != (3 if coordinate else 2):
            raise ValueError
    rows, columns = (check_count(n, f"{item}: size line", "a size") for n in sizes[:2])
    good = not symmetric or rows == columns
    require(good, f"{item}: size line", "as many rows as columns of a symmetric matrix", f"{rows}, {columns}")
    n_values = rows * (rows + 1) // 2 if symmetric else rows * columns
    count = sizes[2] if coordinate else n_values
    require(count == len(body), f"{item}: size line", f"{len(body)} entries, as many as lines follow", count)
    width = 3 if coordinate else 1
    words = " ".join(line for _, line in body).split()
    good = len(words) == width * count
    require(good, item, f"{width} numbers in every line after the sizes", f"{len(words)} in {count} lines")
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
