"""Small binary files in the form of Ansys, written from arrays."""

from __future__ import annotations

import struct

import numpy as np

MODAL = 2
"""Kind of the analysis of a result file; a static one has 0."""


def record(values, form="plain"):
    """One record; ``form`` may be "plain", "windows" or "bits"."""
    values = np.asarray(values)
    integer = values.dtype.kind == "i"
    data = values.astype("<i4" if integer else "<f8")
    flags = 0x80 if integer else 0x00
    if form == "plain":
        raw = data.tobytes()
    elif form == "bits":
        assert len(data) <= 32
        flags |= 0x08
        code = sum(1 << k for k, v in enumerate(data) if v)
        raw = struct.pack("<iI", len(data), code) + data[data != 0].tobytes()
    else:
        flags |= 0x10
        runs, k = [], 0
        while k < len(data):
            if data[k] == 0:
                k += 1
                continue
            end = k
            while end < len(data) and data[end] != 0:
                end += 1
            runs.append((k, data[k:end]))
            k = end
        raw = struct.pack("<ii", len(data), len(runs))
        for start, run in runs:
            if len(run) == 1 and start > 0:
                raw += struct.pack("<i", start) + run.tobytes()
            elif len(run) > 1 and np.all(run == run[0]):
                raw += struct.pack("<ii", -start, -len(run)) + run[:1].tobytes()
            else:
                raw += struct.pack("<ii", -start, len(run)) + run.tobytes()
    words = len(raw) // 4
    return struct.pack("<iI", words, flags << 24) + raw + struct.pack("<i", words)


class Writer:
    """Records one after another; remembers where each begins."""

    def __init__(self, kind):
        self.data = b""
        head = np.zeros(100, np.int32)
        head[0] = kind
        self.add(head)
        self.header_at = self.add(np.zeros(100, np.int32))
        self.header = np.zeros(100, np.int32)

    def add(self, values, form="plain"):
        at = len(self.data) // 4
        self.data += record(values, form)
        return at

    def save(self, path):
        head = record(self.header)
        start = 4 * self.header_at
        path.write_bytes(self.data[:start] + head + self.data[start + len(head) :])


def write_full(path, stiffness, mass, numbers, fixed=()):
    """A ``.full`` file; ``fixed`` are equations that are written as empty rows."""
    n = stiffness.shape[0]
    file = Writer(4)
    file.add(np.array([1, 2, 3], np.int32))
    file.add(np.asarray(numbers, np.int32))
    places = []
    for matrix in (stiffness, mass):
        matrix = matrix.toarray().copy()
        for k in fixed:
            matrix[k], matrix[:, k] = 0.0, 0.0
            matrix[k, k] = 1.0 if not places else 0.0
        start = None
        for row in range(n):
            columns = np.flatnonzero(matrix[row, : row + 1])
            if row not in columns:
                columns = np.append(columns, row)
            at = file.add((columns + 1).astype(np.int32))
            start = at if start is None else start
            file.add(matrix[row, columns].astype(float), "windows" if row % 3 == 1 else "plain")
        places.append(start)
    constraint = np.zeros(n, np.int32)
    constraint[list(fixed)] = -1
    dof_at = file.add(np.full(len(numbers), 3, np.int32), "windows")
    file.add(constraint)
    header = file.header
    header[[0, 1, 7, 32]] = -4, n, 3, len(numbers)
    header[18], header[26], header[35] = places[0], places[1], dof_at
    file.save(path)


def write_rst(path, numbers, nodes, elements, sets, n_sectors):
    """A ``.rst`` file; ``sets`` are (nodal diameter, frequency, displacements (n_nodes, 3))."""
    file = Writer(12)
    n = len(numbers)
    nodes_at = file.add(np.asarray(numbers, np.int32))
    frequency_at = file.add(np.array([s[1] for s in sets], float))
    index_at = file.add(np.array([s[0] for s in sets], np.int32))
    first = None
    for number, position in zip(numbers, nodes):
        at = file.add(np.array([number, *position, 0.0, 0.0, 0.0]), "bits")
        first = at if first is None else first
    element_at = [
        file.add(np.concatenate([np.ones(10, np.int32), e]).astype(np.int32)) for e in elements
    ]
    table_at = len(file.data) // 4
    offsets = np.array([a - table_at for a in element_at], "<i8").view("<i4")
    assert file.add(offsets) == table_at
    geometry = np.zeros(80, np.int32)
    geometry[[3, 4]] = n, len(elements)
    geometry[26], geometry[28] = first, table_at & 0xFFFFFFFF
    geometry_at = file.add(geometry)
    starts = []
    for _, _, shape in sets:
        head = np.zeros(200, np.int32)
        head[[2, 19]] = n, 3
        head[20:23] = 1, 2, 3
        at = file.add(head)
        starts.append(at)
        values_at = file.add(np.asarray(shape, float).ravel(), "windows")
        head[104] = values_at - at
        raw = record(head)
        file.data = file.data[: 4 * at] + raw + file.data[4 * at + len(raw) :]
    sets_at = file.add(np.concatenate([starts, np.zeros(len(sets), int)]).astype(np.int32))
    header = file.header
    header[[2, 3, 7, 8, 20, 48]] = n, len(sets), MODAL, len(sets), n_sectors, n
    header[10], header[11], header[14], header[15], header[16] = (
        sets_at,
        frequency_at,
        nodes_at,
        geometry_at,
        index_at,
    )
    file.save(path)


EDGES = {
    4: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    5: ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
    6: ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    8: (
        (0, 1),
        (1, 2),
        (2, 3),
        (3, 0),
        (4, 5),
        (5, 6),
        (6, 7),
        (7, 4),
        (0, 4),
        (1, 5),
        (2, 6),
        (3, 7),
    ),
}
_COLLAPSED = {
    4: (0, 1, 2, 2, 3, 3, 3, 3),
    5: (0, 1, 2, 3, 4, 4, 4, 4),
    6: (0, 1, 2, 2, 3, 4, 5, 5),
    8: range(8),
}


def collapsed(element):
    """Eight or twenty nodes of SOLID185 or 186, some of them repeated, for a tetrahedron, pyramid, wedge or hexahedron."""
    n = {10: 4, 13: 5, 15: 6, 20: 8}.get(len(element), len(element))
    at = _COLLAPSED[n]
    between = {frozenset(edge): node for edge, node in zip(EDGES[n], element[n:])}
    pairs = [frozenset((at[a], at[b])) for a, b in EDGES[8]] if between else ()
    return [
        *(element[k] for k in at),
        *(between[pair] if len(pair) == 2 else element[min(pair)] for pair in pairs),
    ]


def write_cdb(path, numbers, nodes, elements, components, head=()):
    """A ``.cdb`` archive of eight- or twenty-node hexahedra, with lines ``head`` of materials."""
    kind = "ET,1,186" if len(elements[0]) == 20 else "ET,1,185"
    lines = ["/PREP7", kind, *head, f"NBLOCK,6,SOLID,{len(numbers)},{len(numbers)}"]
    lines.append("(3i9,6e21.13e3)")
    for number, position in zip(numbers, nodes):
        text = "".join(
            f"{v:.13E}".replace("E+", "E+0").replace("E-", "E-0").rjust(21) for v in position
        )
        lines.append(f"{number:9d}{0:9d}{0:9d}{text}")
    lines += ["N,R5.3,LOC,       -1,", f"EBLOCK,19,SOLID,{len(elements)},{len(elements)}", "(19i9)"]
    for k, element in enumerate(elements):
        first = [1, 1, 1, 1, 0, 0, 0, 0, len(element), 0, k + 1, *element[:8]]
        lines.append("".join(f"{v:9d}" for v in first))
        if len(element) > 8:
            lines.append("".join(f"{v:9d}" for v in element[8:]))
    lines.append(f"{-1:9d}")
    for name, members in components.items():
        packed, k = [], 0
        members = sorted(int(m) for m in members)
        while k < len(members):
            end = k
            while end + 1 < len(members) and members[end + 1] == members[end] + 1:
                end += 1
            packed += [members[k]] if end == k else [members[k], -members[end]]
            k = end + 1
        lines.append(f"CMBLOCK,{name:8s},NODE,{len(packed):8d}  ! users node component definition")
        lines.append("(8i10)")
        lines += ["".join(f"{v:10d}" for v in packed[i : i + 8]) for i in range(0, len(packed), 8)]
    path.write_text("\n".join([*lines, "FINISH", ""]))
