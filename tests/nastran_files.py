"""Files of Nastran, written after its manual for tests of the readers."""

import struct

import numpy as np
import scipy.sparse as sp

WORDS = {1: 1, 2: 2, 3: 2, 4: 4}
"""Words of one value of each type: single, double, complex single, complex double."""


def strings(column):
    """First row, from 1, and values of each run of entries that are not zero."""
    filled = np.flatnonzero(column)
    runs = np.split(filled, np.flatnonzero(np.diff(filled) > 1) + 1)
    return [(run[0] + 1, column[run[0] : run[-1] + 1]) for run in runs if len(run)]


def write_op4(path, matrices, binary=False, form="dense", kind=2, order="<", numbers=3, width=23):
    """Matrices by name, in a form: "dense", "small" or "wide" strings."""
    text, content = [], b""
    for name, matrix in matrices.items():
        matrix = sp.csc_matrix(matrix)
        n_rows, n_columns = matrix.shape
        sizes = (n_columns, -n_rows if form == "wide" else n_rows, 2, kind)
        text.append(
            "".join(f"{n:8d}" for n in sizes) + f"{name:8s}1P,{numbers}E{width}.{width - 7}"
        )
        content += record(struct.pack(f"{order}4i", *sizes) + f"{name:8s}".encode(), order)
        for j in range(n_columns):
            column = matrix[:, [j]].toarray().ravel()
            found = strings(column)
            if form == "dense" and found:
                first, last = found[0][0], found[-1][0] + len(found[-1][1])
                found = [(first, column[first - 1 : last - 1])]
            if not found:
                continue
            lines, data = [], b""
            for row, values in found:
                n_words = WORDS[kind] * len(values)
                head = {"dense": (), "wide": (n_words + 1, row)}.get(
                    form, (row + 65536 * (n_words + 1),)
                )
                if head:
                    lines.append("".join(f"{n:12d}" for n in head))
                data += struct.pack(f"{order}{len(head)}i", *head) + packed(values, kind, order)
                lines += number_lines(values, kind, numbers, width)
            first_row = found[0][0] if form == "dense" else 0
            text.append(f"{j + 1:8d}{first_row:8d}{len(data) // 4:8d}")
            text += lines
            head = struct.pack(f"{order}3i", j + 1, first_row, len(data) // 4)
            content += record(head + data, order)
        text += [f"{n_columns + 1:8d}{1:8d}{1:8d}", f"{1.0:{width}.{width - 7}E}"]
        end = struct.pack(f"{order}3i", n_columns + 1, 1, WORDS[kind])
        content += record(end + packed(np.ones(1), kind, order), order)
    if binary:
        path.write_bytes(content)
    else:
        path.write_text("\n".join([*text, ""]))


def packed(values, kind, order):
    return (
        np.asarray(values)
        .astype(f"{order}{ {1: 'f4', 2: 'f8', 3: 'c8', 4: 'c16'}[kind] }")
        .tobytes()
    )


def number_lines(values, kind, per_line, width):
    parts = np.asarray(values)
    if kind > 2:
        parts = np.column_stack([parts.real, parts.imag]).ravel()
    words = [f"{value:{width}.{width - 7}E}" for value in parts]
    return ["".join(words[k : k + per_line]) for k in range(0, len(words), per_line)]


def record(data, order):
    """A Fortran record."""
    length = struct.pack(f"{order}i", len(data))
    return length + data + length


def marker(number, order):
    return record(struct.pack(f"{order}i", number), order)


def part(number, data, order):
    """Part of a table: its number, a flag, and its words in two records."""
    half = 4 * (len(data) // 8)
    chunks = [chunk for chunk in (data[:half], data[half:]) if chunk]
    begin = marker(-number, order) + marker(1, order) + marker(0, order)
    return begin + b"".join(marker(len(c) // 4, order) + record(c, order) for c in chunks)


def table(name, parts, order):
    start = marker(2, order) + record(f"{name:8s}".encode(), order)
    start += marker(-1, order) + marker(7, order) + record(bytes(28), order)
    end = marker(-len(parts) - 2, order) + marker(1, order) + marker(0, order) + marker(0, order)
    return start + b"".join(part(k, data, order) for k, data in enumerate(parts, 2)) + end


def identity(code, subcase, mode, eigenvalue, n_words, order):
    """Identifying part of 146 words: real eigenvalues, result, subcase, mode, words of a point."""
    words = [21, code, 0, subcase, mode]
    rest = [0, 0, 1, n_words]
    head = struct.pack(f"{order}5i", *words) + struct.pack(f"{order}f", eigenvalue)
    return head + struct.pack(f"{order}4i", *rest) + bytes(4 * 40) + b" " * 4 * 96


def write_op2(path, numbers, shapes, hertz, masses, order="<", subcase=1, types=None):
    """Eigenvectors: shapes (n, 3, m) of grid points, and eigenvalues with modal masses."""
    dates = marker(3, order) + record(bytes(12), order)
    label = marker(7, order) + record(b"NASTRAN FORT TAPE ID CODE - ", order)
    version = marker(2, order) + record(b"XXXXXXXX", order)
    content = dates + label + version + marker(-1, order) + marker(0, order)
    rigidities = (2 * np.pi * np.asarray(hertz)) ** 2
    rows = b""
    for k, value in enumerate(rigidities):
        rows += struct.pack(f"{order}2i", k + 1, k + 1)
        rows += struct.pack(f"{order}5f", value, value**0.5, hertz[k], masses[k], masses[k] * value)
    # the last part of a table of eigenvalues holds all of them
    heads = bytes(28), identity(6, subcase, 0, 0.0, 7, order)
    content += table("LAMA", [*heads, rows], order)
    parts = [bytes(28)]
    types = np.ones(len(numbers), int) if types is None else types
    for k, value in enumerate(rigidities):
        parts.append(identity(7, subcase, k + 1, value, 8, order))
        points = b""
        for number, kind, x in zip(numbers, types, shapes[:, :, k]):
            points += struct.pack(f"{order}2i6f", 10 * number + 1, kind, *x, 0.5, 0.6, 0.7)
        parts.append(points)
    content += table("OUGV1", parts, order)
    path.write_bytes(content + marker(0, order))
