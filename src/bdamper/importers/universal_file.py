"""Universal files (UNV, UFF): nodes (15, 2411), elements (2412), modes (55, 2414), measured functions (58).

pyuff (extra ``bdamper[unv]``) reads them, except for elements: 2412 spreads the nodes of elements of second order over
several lines.  Numbers in these files have single precision as a rule: modes are good to some 1e-6.  They do not
state the nodal diameter of a mode, so the caller gives it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.importers.fe_body import FEBody, Lines, by_kind, modes_by_diameter, parsing, reader
from bdamper.importers.measurements import Measurement
from bdamper.model.fields import check
from bdamper.util.errors import import_extra, mismatch

_LINEAR = {111: 4, 112: 6, 115: 8}
# Elements of second order alternate corners and nodes between them around the bottom, then list the upright nodes between
# corners, then the top like the bottom; the places of the corners are enough, the others follow from their positions.
_QUADRATIC = {118: (10, (0, 2, 4, 9)), 113: (15, (0, 2, 4, 9, 11, 13)), 116: (20, (0, 2, 4, 6, 12, 14, 16, 18))}


def _sets(source: Path, wanted: tuple[int, ...]) -> list[dict[str, Any]]:
    """Data sets of the given kinds, by pyuff."""
    pyuff = import_extra("pyuff", "reading a universal file", "unv")
    file = pyuff.UFF(str(source))
    kinds = [int(k) for k in np.atleast_1d(file.get_set_types()) if np.isfinite(k)]
    out = []
    for k, kind in enumerate(kinds):
        if kind in wanted:
            try:
                data = file.read_sets(k)
            except Exception as error:
                raise mismatch(f"{source}: data set {k + 1} of type {kind}", "a readable data set", error) from error
            if isinstance(data, dict):
                out.append(data)
    return out


@reader("a universal file", ".unv", ".uff", library=True)
def read_unv(path: Path, nodal_diameters: Mapping[int, int] | int = 0) -> FEBody:
    """Nodes, solid elements and modes of a universal file.

    Parameters
    ----------
    path : path-like
    nodal_diameters : int or mapping of mode number to int
        Nodal diameter of the modes; modes that a mapping leaves out are not read.

    Raises
    ------
    FileNotFoundError, ModelError
    """
    numbers: list[NDArray] = []
    positions: list[NDArray] = []
    found = []
    systems, used = set[int](), set[int]()
    for data in _sets(path, (15, 18, 55, 2411, 2414, 2420)):
        if data["type"] in (18, 2420):
            systems |= _turned(data)
        elif data["type"] in (15, 2411):
            used |= {int(k) for key in ("def_cs", "disp_cs") for k in np.atleast_1d(data[key])}
            numbers.append(np.asarray(data["node_nums"], float))
            positions.append(np.column_stack([np.asarray(data[k], float) for k in "xyz"]))
        else:
            mode = _mode(data, f"{path}: data set of type {data['type']}")
            if mode is None:
                continue
            d = nodal_diameters if isinstance(nodal_diameters, int) else nodal_diameters.get(mode[0], -1)
            if d >= 0:
                found.append((d, *mode[1:]))
    check(bool(numbers), str(path), "nodes (data set 15 or 2411)", "none")
    expected = "positions and displacements of nodes in the axes of the file"
    check(not systems & used, str(path), expected, f"nodes in the coordinate systems {sorted(systems & used)}")
    labels = np.concatenate(numbers).astype(np.int64)
    modes = modes_by_diameter(found, str(path))
    return FEBody(labels, np.concatenate(positions), **by_kind(_elements(path)), modes=modes, source=str(path))


def _turned(data: dict[str, Any]) -> set[int]:
    """Labels of coordinate systems (data sets 18 and 2420) that are not the axes of the file."""
    if data["type"] == 18:
        return set(map(int, np.atleast_1d(data["cs_num"])))
    plain = np.vstack([np.eye(3), np.zeros(3)])
    systems = zip(data["CS_sys_labels"], data["CS_types"], data["CS_matrices"])
    return {int(label) for label, kind, matrix in systems if kind != 0 or not np.array_equal(matrix, plain)}


def _mode(data: dict[str, Any], item: str) -> tuple[int, float, float, NDArray, NDArray] | None:
    """Number, frequency (Hz), modal mass (0 if unknown), nodes and shape (n, 3) of a normal or complex mode."""
    if data.get("analysis_type") not in (2, 3, 7):
        return None
    if data["type"] == 55:
        keys = ("r1", "r2", "r3")
        if data["analysis_type"] == 2:
            frequency, mass = float(data["freq"]), float(data["modal_m"])
        else:
            frequency, mass = abs(data["eig"]) / (2.0 * np.pi), 0.0
        number = int(data["mode_n"])
    else:
        if data.get("dataset_location") != 1:
            return None
        keys = ("x", "y", "z")
        data = {**data, **_components(data, item)}
        frequency, mass = float(data["record12_field2"]), float(data["record12_field4"])
        number = int(data["record10_field6"])
    there = [key for key in keys if key in data]
    check(len(there) == 3, item, "three displacements at every node", f"{there}")
    nodes = np.asarray(data["node_nums"]).astype(np.int64)
    shape = np.column_stack([np.asarray(data[key]) for key in keys])
    check(shape.shape == (len(nodes), 3), item, f"values of {len(nodes)} nodes", f"{shape.shape}")
    return number, frequency, mass, nodes, shape


def _components(data: dict[str, Any], item: str) -> dict[str, NDArray]:
    """Displacements x, y, z of data set 2414, real or as pairs of real and imaginary parts."""
    rows = data["data_at_node"]
    check(len({len(row) for row in rows}) == 1, item, "as many values at every node", sorted({len(row) for row in rows}))
    values = np.array(rows, float)
    if int(data["data_type"]) in (5, 6):
        values = values[:, 0::2] + 1j * values[:, 1::2]
    check(values.shape[1] >= 3, item, "three displacements at every node", f"{values.shape[1]}")
    return {key: values[:, k] for k, key in enumerate("xyz")}


def _elements(source: Path) -> Iterator[list[int]]:
    """Nodes of the solid elements of all data sets 2412."""
    lines = Lines(source, "latin-1")
    inside, before = False, ""
    for line in lines:
        text = line.strip()
        if not inside or text == "-1":
            inside = (before, text) == ("-1", "2412")
            before = text
            continue
        with parsing(lines.item, "an element of data set 2412", text):
            head = [int(w) for w in text.split()]
            kind, count = head[1], head[5]
            if kind in (11, 21, 22, 23, 24):
                lines.take("the cross-section of a beam")
            nodes: list[int] = []
            while len(nodes) < count:
                nodes += [int(w) for w in lines.take("the nodes of an element").split()]
        if kind in _LINEAR and len(nodes) == _LINEAR[kind]:
            yield nodes
        elif kind in _QUADRATIC and len(nodes) == _QUADRATIC[kind][0]:
            corners = _QUADRATIC[kind][1]
            between = [n for k, n in enumerate(nodes) if k not in corners]
            yield [nodes[k] for k in corners] + between


@reader("a universal file", library=True)
def read_measurements(path: Path) -> tuple[Measurement, ...]:
    """Functions over frequency (data set 58) of a universal file.

    Raises
    ------
    FileNotFoundError, ModelError
    """
    out: list[Measurement] = []
    for data in _sets(path, (58,)):
        if int(data.get("abscissa_spec_data_type", 18)) != 18:
            continue  # not over frequency
        name = str(data.get("id1", "")).strip() or f"function {len(out) + 1}"
        frequency, response = np.asarray(data["x"], float), np.asarray(data["data"]).astype(complex)
        node, direction = (int(data.get(key, 0)) for key in ("rsp_node", "rsp_dir"))
        unit = str(data.get("ordinate_axis_units_lab", "")).strip().replace("NONE", "")
        out.append(Measurement(name, frequency, response, node, direction, unit, str(path)))
    check(bool(out), str(path), "functions over frequency (data set 58)", "none")
    return tuple(out)
