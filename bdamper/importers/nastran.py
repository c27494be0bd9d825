"""Nastran: bulk data, matrices of OP4 files or DMIG cards, modes of OP2 files, parsed by pyNastran.

The package pyNastran (extra ``bdamper[nastran]``) is needed.  OP4 matrices KNN and MNN contain six rows for each grid point
in ascending order of the numbers, but none for the dependent components of RBE2, RBE3 and MPC.  Empty rows (rotations of
solid elements, fixed components) are dropped.

A dependent grid point without solid elements and rows is omitted.  The dependent grid points of an RBE2 whose independent
grid point is held (SPC, SPC1) are held themselves.  Any other tie of solid elements is an error, since the unknowns of a
body are the displacements of its nodes.

References
----------
MSC, *Nastran Quick Reference Guide* (bulk data, DMIG, OUTPUT4).
S. Doyle et al., *pyNastran*, documentation of the packages bdf, op2 and op4.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from io import StringIO
from itertools import chain, repeat
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.importers.arrays import square_matrix, triangle_to_full
from bdamper.importers.deck_keywords import (
    BDF_HARMLESS,
    BDF_IN_MATRICES,
    BDF_READ,
    BDF_TIES,
    CURE,
    refuse,
)
from bdamper.importers.fe_body import (
    ElementKind,
    FEBody,
    Included,
    Modes,
    check_count,
    mesh_body,
    reader,
    rotate_to_file,
)
from bdamper.util.errors import check, import_extra, mismatch
from bdamper.util.storage import FilePath

_EXTRA = "reading a file of Nastran", "nastran"
_SOLIDS = {"CTETRA": 4, "CPENTA": 6, "CHEXA": 8}


class _Tied(NamedTuple):
    """Effect of constraints on the matrices.

    Parameters
    ----------
    rows : (n, 2) int
        Grid point and component of each row of KNN.
    held : set of int
        Held independent grid points.
    spare : set of int
        Dependent and held grid points without solid elements.
    """

    rows: NDArray
    held: set[int]
    spare: set[int]


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
    try:
        content = op4(debug=False).read_op4(str(path))
    except MemoryError:
        raise
    except (
        Exception,
        SystemExit,
    ) as error:  # pyNastran raises almost anything, with texts of many lines
        found = f"another or damaged one ({type(error).__name__})"
        raise mismatch(str(path), "an OP4 file that pyNastran can read", found) from error
    out = {}
    for name, value in content.items():
        data = getattr(value, "data", value[1] if isinstance(value, tuple) else value)
        if data is not None and len(data.shape) == 2 and data.shape[0] == data.shape[1]:
            stored = sp.coo_matrix(data)
            full = triangle_to_full(stored.row, stored.col, stored.data, data.shape[0])
            out[name] = square_matrix(full, f"{path}: {name}")
    check(
        bool(out),
        str(path),
        "a square matrix",
        {k: getattr(v, "shape", None) for k, v in content.items()},
    )
    return out


def _check_op4_sizes(source: Any) -> None:
    """Check the sizes at the head of a text file, before pyNastran allocates arrays for them."""
    with open(source, "rb") as file:
        text = file.read(16).decode("ascii", errors="replace")
    if text.replace("-", " ").replace(" ", "").isdigit():
        for count in (text[:8], text[8:]):
            check_count(
                abs(int(count)),
                f"{source}: head",
                "a size of a matrix",
                1,
                max(1000, os.stat(source).st_size),
            )


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
    return _bulk(path)[0]


@reader("a bulk data file of Nastran", library=True)
def _bulk(path: Path) -> tuple[FEBody, _Tied]:
    """Read a bulk data file and the effect of its constraints."""
    bdf = import_extra("pyNastran.bdf.bdf", *_EXTRA).BDF
    model, lines = bdf(debug=None), _with_included(path, Included())
    text = "\n".join(line for *_, line in lines)
    whole = re.search(r"^\s*CEND\b", text, re.MULTILINE | re.IGNORECASE)
    # bulk data without case control may or may not have the lines BEGIN BULK and ENDDATA
    begin = r"^\s*BEGIN\s+BULK.*$"
    cards = (
        text if whole else re.split(begin, text, maxsplit=1, flags=re.MULTILINE | re.IGNORECASE)[-1]
    )
    model.read_bdf(StringIO(cards), punch=not whole, xref=False)
    for name in model.card_count:
        if name not in BDF_READ | BDF_HARMLESS | BDF_IN_MATRICES | BDF_TIES:
            item, found = _line_of(name, lines, path)
            refuse(found, item, sorted(BDF_READ))
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
    sets = {
        f"SET{key}": np.array(sorted(s.ids), np.int64)
        for key, s in model.sets.items()
        if hasattr(s, "ids") and s.ids
    }
    others = {name: count for name, count in model.card_count.items() if name in BDF_IN_MATRICES}
    notes = [
        f"cards {name} ({count}) are not read: they must be in the matrices"
        for name, count in others.items()
    ]
    solid, dependent, held = (
        {n for element in elements for n in element},
        set[tuple[int, int]](),
        set[int](),
    )
    for card, independent, components in _ties(model):
        dependent |= components
        if solid.isdisjoint(grid for grid, _ in components):
            notes.append(
                f"{card} ties grid points without solid elements: it must be in the matrices"
            )
            continue
        item, found = _line_of(card, lines, path)
        expected = f"a mesh without constraints, or RBE2 to a grid point that SPC1 holds in 123456 ({CURE})"
        check(independent in _held(model), item, expected, found)
        held.add(independent)
        notes.append(f"{card} holds its dependent grid points: {independent} is held")
    rows = np.array(
        [(n, c) for n in sorted(model.nodes) for c in range(1, 7) if (n, c) not in dependent],
        np.int64,
    )
    tied = _Tied(rows, held, held.union(grid for grid, _ in dependent) - solid)
    body = mesh_body(
        str(path),
        "grid points (GRID)",
        numbers,
        nodes,
        elements,
        kinds,
        node_sets=sets,
        notes=tuple(notes),
    )
    axes = _displacement_axes(model, body.numbers, body.nodes)
    return _with_dmig(replace(body, node_axes=axes), model, tied, str(path)), tied


def _ties(model: Any) -> Iterator[tuple[str, int, set[tuple[int, int]]]]:
    """Iterate over RBE2, RBE3 and MPC: beginning of the card, independent grid point of RBE2 or 0, dependent components."""
    for rigid in model.rigid_elements.values():
        if rigid.type == "RBE2":
            yield (
                f"RBE2 {rigid.eid}",
                rigid.gn,
                {(grid, int(c)) for grid in rigid.Gmi for c in rigid.cm},
            )
        else:
            pairs = zip(rigid.Gmi, rigid.Cmi) if rigid.Gmi else [(rigid.refgrid, rigid.refc)]
            yield (
                f"RBE3 {rigid.eid}",
                0,
                {(grid, int(c)) for grid, components in pairs for c in str(components)},
            )
    for mpc in chain.from_iterable(model.mpcs.values()):
        grid = mpc.nodes[0]
        yield f"MPC {mpc.conid} {grid}", 0, {(grid, int(mpc.components[0]))}


def _held(model: Any) -> set[int]:
    """Return the grid points that the only set of SPC and SPC1, or their GRID, holds in all six components."""
    held = {number: set(str(point.ps)) for number, point in model.nodes.items()}
    for card in chain.from_iterable(model.spcs.values() if len(model.spcs) == 1 else ()):
        components = (
            card.components if isinstance(card.components, list) else repeat(card.components)
        )
        for grid, text in zip(card.nodes, components):
            held.setdefault(grid, set()).update(str(text))
    return {number for number, components in held.items() if components >= set("123456")}


def _with_included(source: Path, included: Included, depth: int = 0) -> list[tuple[Path, int, str]]:
    """Return file, number and text of each line of a file, with included files inserted."""
    lines, text = [], source.read_text(encoding="latin-1")
    for number, line in enumerate(text.splitlines(), 1):
        named = re.match(r"\s*INCLUDE\b\s*(.*)", line, re.IGNORECASE)
        if named is None:
            lines.append((source, number, line))
            continue
        item, name = (
            f"{source}: INCLUDE in line {number}",
            re.fullmatch(r"'([^']+)'|\"([^\"]+)\"|(\S+)", named[1].strip()),
        )
        check(name, item, "the name of a file in one line", f"'{named[1].strip()[:60]}'")
        assert name is not None
        lines += _with_included(
            included.path(name[name.lastindex or 0], source, depth, item), included, depth + 1
        )
    return lines


def _line_of(card: str, lines: list[tuple[Path, int, str]], source: Path) -> tuple[str, str]:
    """Return file, name and line of a card for a message, and its text, from the beginning of the card."""
    name = card.split()[0]
    pattern = re.compile(
        r"\s*" + r"[*,\s]+".join(map(re.escape, card.split())) + r"\b", re.IGNORECASE
    )
    found = (
        (f"{file}: {name} in line {number}", line.strip()[:40])
        for file, number, line in lines
        if pattern.match(line)
    )
    return next(found, (f"{source}: {name}", card))


def _kind(model: Any, pid: int, n_nodes: int) -> ElementKind:
    """Return type and material (MAT1) of an element from its section (PSOLID)."""
    material = model.materials.get(getattr(model.properties.get(pid), "mid", None))
    weight = model.params["WTMASS"].values[0] if "WTMASS" in model.params else 1.0
    density = weight * getattr(material, "rho", 0.0) or None  # a blank field is 0
    return ElementKind(
        f"C3D{n_nodes}", getattr(material, "e", None), getattr(material, "nu", None), density
    )


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
            check(
                length > 0.0,
                f"GRID {number}",
                "a position off the axis of its cylindrical system",
                "a position on it",
            )
            r = radial / length
            axes = np.array([r, np.cross([0.0, 0.0, 1.0], r), [0.0, 0.0, 1.0]]) @ axes
        elif system.type not in ("CORD1R", "CORD2R"):
            raise mismatch(
                f"GRID {number}", "rectangular or cylindrical axes of displacement", system.type
            )
        out[number] = axes
    return out


def _with_dmig(body: FEBody, model: Any, tied: _Tied, source: str) -> FEBody:
    """Add stiffness and mass of DMIG cards if the file has both, and a note on any other matrices."""
    pair = next(
        (pair for pair in (("KAAX", "MAAX"), ("K2GG", "M2GG")) if set(pair) <= set(model.dmig)), ()
    )
    unused = sorted(set(model.dmig) - set(pair))
    if unused:
        body = replace(
            body, notes=(*body.notes, f"matrices {', '.join(unused)} (DMIG) are not used")
        )
    if not pair:
        return body
    tables = []
    for name in pair:
        matrix, rows, columns = model.dmig[name].get_matrix(is_sparse=True, apply_symmetry=True)
        row_dofs, column_dofs = (
            np.array([dof[k] for k in range(len(dof))], np.int64) for dof in (rows, columns)
        )
        tables.append((row_dofs, column_dofs, sp.coo_matrix(matrix)))
    pairs = [dof for *both, _ in tables for dof in both]
    dofs, index = np.unique(np.concatenate(pairs), axis=0, return_inverse=True)
    places = np.split(np.ravel(index), np.cumsum([len(table) for table in pairs])[:-1])
    matrices = []
    for (*_, matrix), row, column in zip(tables, places[::2], places[1::2]):
        full = triangle_to_full(row[matrix.row], column[matrix.col], matrix.data.real, len(dofs))
        matrices.append(square_matrix(full, source))
    return _without_empty(replace(body, stiffness=matrices[0], mass=matrices[1], dofs=dofs), tied)


def _without_empty(body: FEBody, tied: _Tied) -> FEBody:
    """Drop the rows that are empty in both matrices or held, and the spare grid points without rows."""
    assert body.stiffness is not None and body.mass is not None and body.dofs is not None
    used = (
        np.asarray(abs(body.stiffness).sum(axis=1)).ravel()
        + np.asarray(abs(body.mass).sum(axis=1)).ravel()
        > 0.0
    )
    keep = np.flatnonzero(used & ~np.isin(body.dofs[:, 0], list(tied.held)))
    dropped = len(used) - len(keep)
    notes = (*body.notes, f"{dropped} held or empty rows dropped") if dropped else body.notes
    stiffness, mass = (matrix[keep][:, keep] for matrix in (body.stiffness, body.mass))
    dofs = body.dofs[keep]
    kept = ~np.isin(body.numbers, list(tied.spare.difference(dofs[:, 0].tolist())))
    numbers, nodes = body.numbers[kept], body.nodes[kept]
    return replace(
        body, numbers=numbers, nodes=nodes, stiffness=stiffness, mass=mass, dofs=dofs, notes=notes
    )


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
        OP4 files with six rows for each grid point, but none for dependent components.  One file may contain both matrices.
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
    body, tied = _bulk(bulk)
    if stiffness is not None:
        found, rows = [], len(tied.rows)
        for path, name in zip((stiffness, mass or stiffness), names):
            content = read_op4(path)
            check(
                name in content, str(path), f"a matrix '{name}'", f"the matrices {sorted(content)}"
            )
            wanted = f"{rows} rows: six for each grid point but the dependent components of RBE2, RBE3, MPC"
            check(content[name].shape[0] == rows, str(path), wanted, content[name].shape[0])
            found.append(content[name])
        given = {
            "stiffness": found[0],
            "mass": found[1],
            "dofs": tied.rows,
            "source": f"{stiffness}, {bulk}",
        }
        body = _without_empty(replace(body, **given), tied)
    return replace(body, modes=modes)


@reader("an OP2 file with real eigenvectors", library=True)
def read_op2(
    path: Path,
    nodal_diameter: int = 0,
    subcase: int | None = None,
    axes: Mapping[int, NDArray] | None = None,
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
    cases = {
        (key[0] if isinstance(key, tuple) else key): value
        for key, value in model.eigenvectors.items()
    }
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
