"""Real matrices from MATLAB files of version 5 to 7.2.

The package has a reader of its own, since the common one crashes on damaged files.  After a header of 128 bytes come data
elements: a type and a length (eight bytes, or four for data of at most four bytes), then the data, padded to eight bytes.
An element of type 15 holds others, compressed by zlib; one of type 14 is an array: flags with its class, dimensions,
name, then numbers by columns, or rows, column pointers and numbers of a sparse one.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.importers.reader_registry import LARGEST_COUNT, check_count
from bdamper.model.fields import require
from bdamper.util.errors import mismatch
from bdamper.util.storage import MOST_BYTES

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
            require(length <= 4, item, "small elements of at most four bytes", length)
        else:
            start = at + 8
            step = 8 + (length if kind == _COMPRESSED else (length + 7) // 8 * 8)
        require(start + length <= len(data), item, f"{length} bytes of data", f"{len(data) - start}: damaged or truncated")
        yield kind, data[start : start + length]
        at += step


def _numbers(part: tuple[int, bytes], order: str, item: str) -> NDArray:
    kind, content = part
    require(kind in _TYPES, item, "numbers", f"data of type {kind}")
    dtype = np.dtype(order + _TYPES[kind])
    require(not len(content) % dtype.itemsize, item, f"numbers of {dtype.itemsize} bytes", f"{len(content)} bytes")
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
        require(len(rest) == 1 and len(rest[0]) == rows * columns, item, f"{rows} x {columns} numbers", sum(map(len, rest)))
        out[name] = rest[0].reshape(columns, rows).T.astype(float)
        return
    if len(rest) != 3 or len(rest[1]) != columns + 1:
        raise mismatch(item, f"rows, {columns + 1} pointers and numbers of a sparse matrix", f"{[len(r) for r in rest]}")
    row, pointer, value = rest[0].astype(np.int64), rest[1].astype(np.int64), rest[2].astype(float)
    count = int(pointer[-1])
    steps = np.diff(pointer)
    good = pointer[0] == 0 and np.all(steps >= 0) and 0 <= count <= min(len(row), len(value), LARGEST_COUNT)
    require(good, item, "ascending column pointers within the numbers", f"up to {count} of {len(value)}")
    row, value = row[:count], value[:count]
    low, high = row.min(initial=0), row.max(initial=0)
    require(low >= 0 and high < max(rows, 1), item, f"rows 0 to {rows - 1}", f"{low} to {high}")
    out[name] = sp.coo_matrix((value, (row, np.repeat(np.arange(columns), steps))), shape=(rows, columns))
