"""Nastran: bulk data, matrices of OP4 files or DMIG cards, modes of OP2 files, parsed by pyNastran.

The package pyNastran (extra ``bdamper[nastran]``) is needed.  OP4 matrices KNN and MNN contain six
rows for each grid point in ascending order of the numbers, but none for the dependent components of
RBE2, RBE3 and MPC.  Empty rows (rotations of solid elements, fixed components) are dropped.

A dependent grid point without solid elements and rows is omitted.  The dependent grid points of an
RBE2 whose independent grid point is fixed (SPC, SPC1) are fixed themselves.  Any other tie of solid
elements is an error, because the unknowns of a body are the displacements of its nodes.

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
from itertools import chain
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
    """Read the square matrices of an OP4 file into a mapping of their names.

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
    except (Exception, SystemExit) as error:
        # pyNastran raises almost anything, with texts of many lines
        found = f"a different or damaged file ({type(error).__name__})"
        raise mismatch(str(path), "an OP4 file that pyNastran can read", found) from error
    matrices = {}
    for name, value in content.items():
        # a matrix, a tuple with a matrix or an object with one, depending on the release
        unpacked = value[1] if isinstance(value, tuple) else value
        data = getattr(value, "data", unpacked)
        if data is None or len(data.shape) != 2 or data.shape[0] != data.shape[1]:
            continue
        stored = sp.coo_matrix(data)
        full = triangle_to_full(stored.row, stored.col, stored.data, data.shape[0])
        matrices[name] = square_matrix(full, f"{path}: {name}")
    shapes = {name: getattr(value, "shape", None) for name, value in content.items()}
    check(bool(matrices), str(path), "a square matrix", shapes)
    return matrices


def _check_op4_sizes(source: Any) -> None:
    """Check the sizes at the head of a text file, before pyNastran allocates arrays for them."""
    with open(source, "rb") as file:
        text = file.read(16).decode("ascii", errors="replace")
    # a binary file begins otherwise
    if not text.replace("-", " ").replace(" ", "").isdigit():
        return
    largest = max(1000, os.stat(source).st_size)
    for count in (text[:8], text[8:]):
        check_count(abs(int(count)), f"{source}: head", "a size of a matrix", 1, largest)


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
    model, lines = _parsed(path)
    for name in model.card_count:
        if name not in BDF_READ | BDF_HARMLESS | BDF_IN_MATRICES | BDF_TIES:
            item, card = _line_of(name, lines, path)
            refuse(card, item, sorted(BDF_READ))
    numbers, nodes = model.get_xyz_in_coord_no_xref(cid=0) if model.nodes else ((), ())
    elements, kinds = _solid_elements(model)
    sets = {}
    for key, node_set in model.sets.items():
        if hasattr(node_set, "ids") and node_set.ids:
            sets[f"SET{key}"] = np.array(sorted(node_set.ids), np.int64)
    notes = [
        f"cards {name} ({count}) are not read: the matrices must contain them"
        for name, count in model.card_count.items()
        if name in BDF_IN_MATRICES
    ]
    solid = {grid for element in elements for grid in element}
    tied = _tied(model, solid, lines, path, notes)
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


def _parsed(path: Path) -> tuple[Any, list[_Line]]:
    """Return the model of pyNastran, and the lines of the file and its included files."""
    bdf = import_extra("pyNastran.bdf.bdf", *_EXTRA).BDF
    model = bdf(debug=None)
    lines = _with_included(path, Included())
    cards = "\n".join(line.text for line in lines)
    has_case_control = re.search(r"^\s*CEND\b", cards, re.MULTILINE | re.IGNORECASE)
    if not has_case_control:
        # such bulk data may or may not have the lines BEGIN BULK and ENDDATA
        begin = r"^\s*BEGIN\s+BULK.*$"
        cards = re.split(begin, cards, maxsplit=1, flags=re.MULTILINE | re.IGNORECASE)[-1]
    model.read_bdf(StringIO(cards), punch=not has_case_control, xref=False)
    return model, lines


def _solid_elements(model: Any) -> tuple[list[list[int]], list[ElementKind]]:
    """Return grid points and kind of each solid element."""
    elements, kinds = [], []
    for element in model.elements.values():
        n_corners = _SOLIDS.get(element.type)
        if n_corners is None:
            continue
        n_quadratic = {4: 10, 6: 15, 8: 20}[n_corners]
        grids = [grid for grid in element.nodes if grid not in (None, 0)]
        # without some mid-side nodes an element has its corners only
        if len(grids) not in (n_corners, n_quadratic):
            grids = grids[:n_corners]
        elements.append(grids)
        kinds.append(_kind(model, element.pid, len(grids)))
    return elements, kinds


def _tied(model: Any, solid: set[int], lines: list[_Line], path: Path, notes: list[str]) -> _Tied:
    """Return the effect of constraints, and add notes on it.

    Raises
    ------
    ModelError
        If grid points of solid elements are tied to a grid point that is not held.
    """
    dependent: set[tuple[int, int]] = set()
    held: set[int] = set()
    for tie in _ties(model):
        dependent |= tie.dependent
        if solid.isdisjoint(grid for grid, _ in tie.dependent):
            notes.append(
                f"{tie.card} ties grid points without solid elements: it must be in the matrices"
            )
            continue
        item, card = _line_of(tie.card, lines, path)
        expected = (
            "a mesh without constraints, or RBE2 to a grid point that SPC1 fixes in 123456 "
            f"({CURE})"
        )
        check(tie.independent in _held(model), item, expected, card)
        held.add(tie.independent)
        notes.append(
            f"{tie.card} fixes its dependent grid points, because {tie.independent} is fixed"
        )
    rows = []
    for grid in sorted(model.nodes):
        for component in range(1, 7):
            if (grid, component) not in dependent:
                rows.append((grid, component))
    spare = held.union(grid for grid, _ in dependent) - solid
    return _Tied(np.array(rows, np.int64), held, spare)


class _Tie(NamedTuple):
    """Card that ties components of grid points.

    Parameters
    ----------
    card : str
        Beginning of the card.
    independent : int
        Independent grid point of RBE2; 0 for other cards.
    dependent : set of (int, int)
        Grid point and component of each dependent displacement.
    """

    card: str
    independent: int
    dependent: set[tuple[int, int]]


def _ties(model: Any) -> Iterator[_Tie]:
    """Iterate over RBE2, RBE3 and MPC."""
    for rigid in model.rigid_elements.values():
        dependent: set[tuple[int, int]] = set()
        if rigid.type == "RBE2":
            # all dependent grid points have the same components, such as "123"
            for grid in rigid.Gmi:
                dependent.update((grid, int(component)) for component in rigid.cm)
            yield _Tie(f"RBE2 {rigid.eid}", rigid.gn, dependent)
            continue
        # the reference point of RBE3 is dependent, unless the card names other components
        points = [(rigid.refgrid, rigid.refc)]
        if rigid.Gmi:
            points = list(zip(rigid.Gmi, rigid.Cmi))
        for grid, components in points:
            dependent.update((grid, int(component)) for component in str(components))
        yield _Tie(f"RBE3 {rigid.eid}", 0, dependent)
    for mpc in chain.from_iterable(model.mpcs.values()):
        # the first grid point and component of an equation depend on the others
        grid = mpc.nodes[0]
        yield _Tie(f"MPC {mpc.conid} {grid}", 0, {(grid, int(mpc.components[0]))})


def _held(model: Any) -> set[int]:
    """Return the grid points that are held in all six components.

    They are held by their GRID, or by the set of SPC and SPC1 if there is only one.
    """
    components_of = {grid: set(str(point.ps)) for grid, point in model.nodes.items()}
    cards = chain.from_iterable(model.spcs.values()) if len(model.spcs) == 1 else ()
    for card in cards:
        if isinstance(card.components, list):
            components = card.components
        else:
            components = [card.components] * len(card.nodes)
        for grid, text in zip(card.nodes, components):
            components_of.setdefault(grid, set()).update(str(text))
    return {grid for grid, components in components_of.items() if components >= set("123456")}


class _Line(NamedTuple):
    """Line of a file."""

    file: Path
    number: int
    text: str


def _with_included(source: Path, included: Included, depth: int = 0) -> list[_Line]:
    """Return the lines of a file, with included files inserted."""
    lines = []
    text = source.read_text(encoding="latin-1")
    for number, line in enumerate(text.splitlines(), 1):
        include = re.match(r"\s*INCLUDE\b\s*(.*)", line, re.IGNORECASE)
        if include is None:
            lines.append(_Line(source, number, line))
            continue
        item = f"{source}: INCLUDE in line {number}"
        written = include[1].strip()
        # in quotation marks of either kind, or without
        name = re.fullmatch(r"'([^']+)'|\"([^\"]+)\"|(\S+)", written)
        check(name, item, "the name of a file in one line", f"'{written[:60]}'")
        assert name is not None
        path = included.path(name[name.lastindex or 0], source, depth, item)
        lines += _with_included(path, included, depth + 1)
    return lines


def _line_of(card: str, lines: list[_Line], source: Path) -> tuple[str, str]:
    """Return the place of a card for a message, and its text, from the beginning of the card."""
    words = card.split()
    # fields are separated by commas or blanks, and an asterisk may follow the name
    fields = r"[*,\s]+".join(map(re.escape, words))
    pattern = re.compile(r"\s*" + fields + r"\b", re.IGNORECASE)
    for line in lines:
        if pattern.match(line.text):
            return f"{line.file}: {words[0]} in line {line.number}", line.text.strip()[:40]
    return f"{source}: {words[0]}", card


def _kind(model: Any, pid: int, n_nodes: int) -> ElementKind:
    """Return type and material (MAT1) of an element from its section (PSOLID)."""
    section = model.properties.get(pid)
    material = model.materials.get(getattr(section, "mid", None))
    mass_factor = model.params["WTMASS"].values[0] if "WTMASS" in model.params else 1.0
    # a blank field is 0
    density = mass_factor * getattr(material, "rho", 0.0) or None
    young, poisson = getattr(material, "e", None), getattr(material, "nu", None)
    return ElementKind(f"C3D{n_nodes}", young, poisson, density)


def _displacement_axes(model: Any, numbers: NDArray, nodes: NDArray) -> dict[int, NDArray]:
    """Return the axes of displacement of grid points with a rectangular or cylindrical coordinate
    system.
    """
    axes_of = {}
    for number, position in zip(numbers.tolist(), nodes):
        item = f"GRID {number}"
        key = model.nodes[number].Cd()
        if key == 0:
            continue
        system = model.coords[key]
        system.setup_no_xref(model)
        axes = np.array(system.beta(), float)
        if system.type in ("CORD1C", "CORD2C"):
            origin = np.asarray(system.origin, float)
            radial = axes @ (position - origin) * [1.0, 1.0, 0.0]
            radius = np.linalg.norm(radial)
            expected = "a position off the axis of its cylindrical system"
            check(radius > 0.0, item, expected, "a position on it")
            r = radial / radius
            z = [0.0, 0.0, 1.0]
            axes = np.array([r, np.cross(z, r), z]) @ axes
        elif system.type not in ("CORD1R", "CORD2R"):
            expected = "rectangular or cylindrical axes of displacement"
            raise mismatch(item, expected, system.type)
        axes_of[number] = axes
    return axes_of


def _with_dmig(body: FEBody, model: Any, tied: _Tied, source: str) -> FEBody:
    """Add stiffness and mass of DMIG cards if the file has both, and a note on other matrices."""
    pair: tuple[str, ...] = ()
    if "KAAX" in model.dmig and "MAAX" in model.dmig:
        pair = ("KAAX", "MAAX")
    elif "K2GG" in model.dmig and "M2GG" in model.dmig:
        pair = ("K2GG", "M2GG")
    unused = sorted(set(model.dmig) - set(pair))
    if unused:
        note = f"matrices {', '.join(unused)} (DMIG) are not used"
        body = replace(body, notes=(*body.notes, note))
    if not pair:
        return body
    entries = [_dmig_entries(model.dmig[name]) for name in pair]
    pairs = np.concatenate([dofs for matrix in entries for dofs in (matrix.rows, matrix.columns)])
    # the same table of equations for both matrices
    table, index = np.unique(pairs, axis=0, return_inverse=True)
    index = np.ravel(index)
    matrices = []
    start = 0
    for matrix in entries:
        middle = start + len(matrix.rows)
        end = middle + len(matrix.columns)
        row = index[start:middle][matrix.values.row]
        column = index[middle:end][matrix.values.col]
        full = triangle_to_full(row, column, matrix.values.data.real, len(table))
        matrices.append(square_matrix(full, source))
        start = end
    with_matrices = replace(body, stiffness=matrices[0], mass=matrices[1], dofs=table)
    return _without_empty(with_matrices, tied)


class _Dmig(NamedTuple):
    """Matrix of DMIG cards.

    Parameters
    ----------
    rows, columns : (n, 2) int
        Grid point and component of each row and column of ``values``.
    values : sparse
    """

    rows: NDArray
    columns: NDArray
    values: sp.coo_matrix


def _dmig_entries(card: Any) -> _Dmig:
    matrix, rows, columns = card.get_matrix(is_sparse=True, apply_symmetry=True)
    return _Dmig(
        np.array([rows[k] for k in range(len(rows))], np.int64),
        np.array([columns[k] for k in range(len(columns))], np.int64),
        sp.coo_matrix(matrix),
    )


def _without_empty(body: FEBody, tied: _Tied) -> FEBody:
    """Drop the rows that are empty in both matrices or held, and the spare grid points without
    rows.
    """
    assert body.stiffness is not None and body.mass is not None and body.dofs is not None
    stiffness_sum = np.asarray(abs(body.stiffness).sum(axis=1)).ravel()
    mass_sum = np.asarray(abs(body.mass).sum(axis=1)).ravel()
    used = stiffness_sum + mass_sum > 0.0
    held = np.isin(body.dofs[:, 0], list(tied.held))
    keep = np.flatnonzero(used & ~held)
    notes = body.notes
    n_dropped = len(used) - len(keep)
    if n_dropped:
        notes = (*notes, f"{n_dropped} fixed or empty rows dropped")
    dofs = body.dofs[keep]
    without_rows = tied.spare.difference(dofs[:, 0].tolist())
    kept = ~np.isin(body.numbers, list(without_rows))
    return replace(
        body,
        numbers=body.numbers[kept],
        nodes=body.nodes[kept],
        stiffness=body.stiffness[keep][:, keep],
        mass=body.mass[keep][:, keep],
        dofs=dofs,
        notes=notes,
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
        OP4 files with six rows for each grid point, but none for dependent components.  One file
        may contain both matrices.
    names : (str, str)
        Names of the matrices in these files.  KNN and MNN include multipoint constraints, KGG and
        MGG do not.
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
    if stiffness is None:
        return replace(body, modes=modes)
    matrices = []
    n_rows = len(tied.rows)
    for path, name in zip((stiffness, mass or stiffness), names):
        content = read_op4(path)
        found = f"the matrices {sorted(content)}"
        check(name in content, str(path), f"a matrix '{name}'", found)
        expected = (
            f"{n_rows} rows: six for each grid point, without the dependent components of RBE2, "
            "RBE3, MPC"
        )
        check(content[name].shape[0] == n_rows, str(path), expected, content[name].shape[0])
        matrices.append(content[name])
    with_matrices = replace(
        body,
        stiffness=matrices[0],
        mass=matrices[1],
        dofs=tied.rows,
        source=f"{stiffness}, {bulk}",
    )
    return replace(_without_empty(with_matrices, tied), modes=modes)


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
        ``FEBody.node_axes`` of the bulk data, because displacements are in the axes of each grid
        point.

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
    vectors_of_subcase = {}
    for key, vectors in model.eigenvectors.items():
        number = key[0] if isinstance(key, tuple) else key
        vectors_of_subcase[number] = vectors
    subcases = sorted(vectors_of_subcase)
    if subcase is None:
        subcase = subcases[0]
    check(subcase in subcases, str(path), f"a subcase out of {subcases}", subcase)
    vectors = vectors_of_subcase[subcase]
    # other rows belong to scalar points
    is_grid = vectors.node_gridtype[:, 1] == 1
    displacements = np.asarray(vectors.data)[:, is_grid, :3]
    shapes = np.moveaxis(displacements, 0, 2).astype(float)
    numbers = vectors.node_gridtype[is_grid, 0].astype(np.int64)
    rotate_to_file(shapes, numbers, axes or {})
    frequency = np.asarray(vectors.mode_cycles, float)
    modal_mass = None
    for table in model.eigenvalues.values():
        generalised = np.asarray(getattr(table, "generalized_mass", np.empty(0)), float)
        if len(generalised) == len(frequency) and np.all(generalised > 0.0):
            modal_mass = generalised
    return Modes(nodal_diameter, frequency, numbers, shapes, modal_mass, str(path))
