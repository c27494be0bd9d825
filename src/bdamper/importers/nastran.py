"""Nastran: bulk data, matrices of OP4 files or DMIG cards, modes of OP2 files, parsed by pyNastran.

The package pyNastran (extra ``bdamper[nastran]``) is needed.  OP4 matrices KNN and MNN contain six rows for each grid point
without multipoint constraints, in ascending order of the numbers of grid points.  Empty rows (rotations of solid elements,
fixed components) are dropped.  Multipoint constraints and rigid elements are errors: they tie grid points, and the matrices
KGG and MGG of the g-set do not contain them.

References
----------
MSC, *Nastran Quick Reference Guide* (bulk data, DMIG, OUTPUT4).
S. Doyle et al., *pyNastran*, documentation of the packages bdf, op2 and op4.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.importers.arrays import square_matrix, triangle_to_full
from bdamper.importers.deck_keywords import BDF_HARMLESS, BDF_IN_MATRICES, BDF_READ, refuse
from bdamper.importers.fe_body import ElementKind, FEBody, Included, Modes, check_count, mesh_body, reader, rotate_to_file
from bdamper.model.fields import check
from bdamper.util.errors import import_extra, mismatch
from bdamper.util.storage import FilePath

_EXTRA = "reading a file of Nastran", "nastran"
_SOLIDS = {"CTETRA": 4, "CPENTA": 6, "CHEXA": 8}


@reader("an OP4 file", library=True)
def read_op4(path: Path) -> dict[str, sp.csr_matrix]:
    """Read the square matrices of an OP4 file, by name.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    dict of name to (n, n) sparse

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has no square matrix.
    """
    op4 = import_extra("pyNastran.op4.op4", *_EXTRA).OP4
    _check_op4_sizes(path)
    content = op4(debug=False).read_op4(str(path))
    out = {}
    for name, value in content.items():
        data = getattr(value, "data", value[1] if isinstance(value, tuple) else value)
        if data is not None and len(data.shape) == 2 and data.shape[0] == data.shape[1]:
            stored = sp.coo_matrix(data)
            full = triangle_to_full(stored.row, stored.col, stored.data, data.shape[0])
            out[name] = square_matrix(full, f"{path}: {name}")
    check(bool(out), str(path), "a square matrix", {k: getattr(v, "shape", None) for k, v in content.items()})
    return out


def _check_op4_sizes(source: Any) -> None:
    """Check the sizes at the head of a text file, before pyNastran allocates arrays for them."""
    with open(source, "rb") as file:
        text = file.read(16).decode("ascii", errors="replace")
    if text.replace("-", " ").replace(" ", "").isdigit():
        for count in (text[:8], text[8:]):
            check_count(abs(int(count)), f"{source}: head", "a size of a matrix", 1, max(1000, os.stat(source).st_size))


@reader("a bulk data file of Nastran", ".bdf", ".dat", ".nas", library=True)
def read_bdf(path: Path) -> FEBody:
    """Read grid points, solid elements, sets and DMIG matrices KAAX and MAAX of a bulk data file.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has a card that could change the mesh.
    """
    bdf = import_extra("pyNastran.bdf.bdf", *_EXTRA).BDF
    model, text = bdf(debug=None), _with_included(path, Included())
    whole = re.search(r"^\s*CEND\b", text, re.MULTILINE | re.IGNORECASE)
    # bulk data without case control may or may not have the lines BEGIN BULK and ENDDATA
    begin = r"^\s*BEGIN\s+BULK.*$"
    cards = text if whole else re.split(begin, text, maxsplit=1, flags=re.MULTILINE | re.IGNORECASE)[-1]
    model.read_bdf(StringIO(cards), punch=not whole, xref=False)
    _check_cards(model.card_count, text, path)
    numbers, nodes = model.get_xyz_in_coord_no_xref(cid=0) if model.nodes else ((), ())
    elements, kinds = [], []
    for element in model.elements.values():
        corners = _SOLIDS.get(element.type)
        if corners is None:
            continue
        nodes_of_element = [n for n in element.nodes if n not in (None, 0)]
        if len(nodes_of_element) not in (corners, {4: 10, 6: 15, 8: 20}[corners]):
            nodes_of_element = nodes_of_element[:corners]
        elements.append(nodes_of_element)
        kinds.append(_kind(model, element.pid, len(nodes_of_element)))
    sets = {f"SET{key}": np.array(sorted(s.ids), np.int64) for key, s in model.sets.items() if hasattr(s, "ids") and s.ids}
    others = {name: count for name, count in model.card_count.items() if name in BDF_IN_MATRICES}
    notes = tuple(f"cards {name} ({count}) are not read: they must be in the matrices" for name, count in others.items())
    body = mesh_body(
        str(path), "grid points (GRID)", numbers, nodes, elements, kinds, node_sets=sets, notes=notes
    )
    axes = _displacement_axes(model, body.numbers, body.nodes)
    return _with_dmig(replace(body, node_axes=axes), model, str(path))


def _with_included(source: Path, included: Included, depth: int = 0) -> str:
    """Return the text of a file, with included files inserted."""
    lines, text = [], source.read_text(encoding="latin-1")
    for number, line in enumerate(text.splitlines(), 1):
        named = re.match(r"\s*INCLUDE\b\s*(.*)", line, re.IGNORECASE)
        if named is None:
            lines.append(line)
            continue
        item, name = f"{source}: INCLUDE in line {number}", re.fullmatch(r"'([^']+)'|\"([^\"]+)\"|(\S+)", named[1].strip())
        check(name, item, "the name of a file in one line", f"'{named[1].strip()[:60]}'")
        assert name is not None
        lines.append(_with_included(included.path(name[name.lastindex or 0], source, depth, item), included, depth + 1))
    return "\n".join(lines)


def _check_cards(names: Iterable[str], text: str, source: Path) -> None:
    """Raise ModelError for a card that could create, move or tie grid points, elements or sets."""
    for name in names:
        if name not in BDF_READ | BDF_HARMLESS | BDF_IN_MATRICES:
            at = re.search(rf"^\s*{re.escape(name)}\b.*", text, re.MULTILINE | re.IGNORECASE)
            refuse(at[0].strip()[:40] if at else name, f"{source}: {name}", sorted(BDF_READ))


def _kind(model: Any, pid: int, n_nodes: int) -> ElementKind:
    """Return type and material (MAT1) of an element from its section (PSOLID)."""
    material = model.materials.get(getattr(model.properties.get(pid), "mid", None))
    return ElementKind(f"C3D{n_nodes}", getattr(material, "e", None), getattr(material, "nu", None))


def _displacement_axes(model: Any, numbers: NDArray, nodes: NDArray) -> dict[int, NDArray]:
    """Return the axes of displacement of grid points with a rectangular or cylindrical coordinate system."""
    out = {}
    for number, position in zip(numbers.tolist(), nodes):
        key = model.nodes[number].Cd()
        if key == 0:
            continue
        system = model.coords[key]
        system.setup_no_xref(model)
        axes = np.array(system.beta(), float)
        if system.type in ("CORD1C", "CORD2C"):
            radial = axes @ (position - np.asarray(system.origin, float)) * [1.0, 1.0, 0.0]
            length = np.linalg.norm(radial)
            check(length > 0.0, f"GRID {number}", "a position off the axis of its cylindrical system", "a position on it")
            r = radial / length
            axes = np.array([r, np.cross([0.0, 0.0, 1.0], r), [0.0, 0.0, 1.0]]) @ axes
        elif system.type not in ("CORD1R", "CORD2R"):
            raise mismatch(f"GRID {number}", "rectangular or cylindrical axes of displacement", system.type)
        out[number] = axes
    return out


def _with_dmig(body: FEBody, model: Any, source: str) -> FEBody:
    """Add stiffness and mass of DMIG cards if the file has both, and a note on any other matrices."""
    pair = next((pair for pair in (("KAAX", "MAAX"), ("K2GG", "M2GG")) if set(pair) <= set(model.dmig)), ())
    unused = sorted(set(model.dmig) - set(pair))
    if unused:
        body = replace(body, notes=(*body.notes, f"matrices {', '.join(unused)} (DMIG) are not used"))
    if not pair:
        return body
    tables = []
    for name in pair:
        matrix, rows, columns = model.dmig[name].get_matrix(is_sparse=True, apply_symmetry=True)
        row_dofs, column_dofs = (np.array([dof[k] for k in range(len(dof))], np.int64) for dof in (rows, columns))
        tables.append((row_dofs, column_dofs, sp.coo_matrix(matrix)))
    pairs = [dof for *both, _ in tables for dof in both]
    dofs, index = np.unique(np.concatenate(pairs), axis=0, return_inverse=True)
    places = np.split(np.ravel(index), np.cumsum([len(table) for table in pairs])[:-1])
    matrices = []
    for (*_, matrix), row, column in zip(tables, places[::2], places[1::2]):
        full = triangle_to_full(row[matrix.row], column[matrix.col], matrix.data.real, len(dofs))
        matrices.append(square_matrix(full, source))
    return _without_empty(replace(body, stiffness=matrices[0], mass=matrices[1], dofs=dofs))


def _without_empty(body: FEBody) -> FEBody:
    """Drop the rows that are empty in both matrices."""
    assert body.stiffness is not None and body.mass is not None and body.dofs is not None
    used = np.asarray(abs(body.stiffness).sum(axis=1)).ravel() + np.asarray(abs(body.mass).sum(axis=1)).ravel() > 0.0
    keep = np.flatnonzero(used)
    dropped = len(used) - len(keep)
    notes = (*body.notes, f"{dropped} empty rows dropped") if dropped else body.notes
    stiffness, mass = (matrix[keep][:, keep] for matrix in (body.stiffness, body.mass))
    return replace(body, stiffness=stiffness, mass=mass, dofs=body.dofs[keep], notes=notes)


def read_nastran(
    bulk: FilePath,
    stiffness: FilePath | None = None,
    mass: FilePath | None = None,
    names: tuple[str, str] = ("KNN", "MNN"),
    modes: tuple[Modes, ...] = (),
) -> FEBody:
    """Read a body from bulk data and matrices.

    Parameters
    ----------
    bulk : path-like
        Bulk data.  Its DMIG matrices are used if ``stiffness`` is omitted.
    stiffness, mass : path-like, optional
        OP4 files with six rows for each grid point.  One file may contain both matrices.
    names : (str, str)
        Names of the matrices in these files.  KNN and MNN include multipoint constraints, KGG and MGG do not.
    modes : tuple of Modes
        Modes to compare with, see :func:`read_op2`.

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If a file does not exist or is damaged, or has no matrices of these names and sizes.
    """
    body = read_bdf(bulk)
    if stiffness is not None:
        found = []
        rows = 6 * len(body.numbers)
        for path, name in zip((stiffness, mass or stiffness), names):
            content = read_op4(path)
            check(name in content, str(path), f"a matrix '{name}'", f"the matrices {sorted(content)}")
            wanted = f"{rows} rows: six for each of {len(body.numbers)} grid points"
            check(content[name].shape[0] == rows, str(path), wanted, content[name].shape[0])
            found.append(content[name])
        ordered = np.sort(body.numbers)
        dofs = np.column_stack([np.repeat(ordered, 6), np.tile(np.arange(1, 7), len(ordered))])
        body = _without_empty(replace(body, stiffness=found[0], mass=found[1], dofs=dofs, source=f"{stiffness}, {bulk}"))
    return replace(body, modes=modes)


@reader("an OP2 file with real eigenvectors", library=True)
def read_op2(
    path: Path, nodal_diameter: int = 0, subcase: int | None = None, axes: Mapping[int, NDArray] | None = None
) -> Modes:
    """Read real modes from an OP2 file.

    Parameters
    ----------
    path : path-like
    nodal_diameter : int
        Nodal diameter of the modes.  A pair of equal frequencies makes one travelling wave.
    subcase : int, optional
        Subcase of the modes; by default the first one.
    axes : mapping of node number to (3, 3) float, optional
        ``FEBody.node_axes`` of the bulk data, since displacements are in the axes of each grid point.

    Returns
    -------
    Modes

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has no eigenvectors of this subcase.
    """
    op2 = import_extra("pyNastran.op2.op2", *_EXTRA).OP2
    model = op2(debug=None)
    model.read_op2(str(path), build_dataframe=False, skip_undefined_matrices=True)
    check(bool(model.eigenvectors), str(path), "eigenvectors", "none")
    cases = {(key[0] if isinstance(key, tuple) else key): value for key, value in model.eigenvectors.items()}
    if subcase is None:
        subcase = sorted(cases)[0]
    check(subcase in cases, str(path), f"a subcase out of {sorted(cases)}", subcase)
    found = cases[subcase]
    grid = found.node_gridtype[:, 1] == 1
    shapes = np.moveaxis(np.asarray(found.data)[:, grid, :3], 0, 2).astype(float)
    numbers = found.node_gridtype[grid, 0].astype(np.int64)
    rotate_to_file(shapes, numbers, axes or {})
    frequency = np.asarray(found.mode_cycles, float)
    mass = None
    for table in model.eigenvalues.values():
        generalised = np.asarray(getattr(table, "generalized_mass", np.empty(0)), float)
        if len(generalised) == len(frequency) and np.all(generalised > 0.0):
            mass = generalised
    return Modes(nodal_diameter, frequency, numbers, shapes, mass, str(path))
