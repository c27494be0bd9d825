r"""CalculiX and Abaqus: mesh and sets of an input file or of results, stored matrices, modes of a
cyclic analysis.

In CalculiX, ``*FREQUENCY, SOLVER=MATRIXSTORAGE`` writes the upper triangles of stiffness and mass
(``.sti`` and ``.mas`` with row, column, value).  The file ``.dof`` lists the free components of
their rows as ``node.component``.  If the deck has ties of cyclic symmetry, ``CYCMPC=INACTIVE``
excludes them from the matrices.

In Abaqus, ``*MATRIX OUTPUT`` writes lines of node, component, node, component and value.  The nodes
are labels, or, for an assembly of several instances, numbers or labels with the name of their
instance.

In a cyclic ``.frd`` file each mode has the blocks DISP and DISPI: real and imaginary part of a
travelling wave of either direction, with a modal mass of one over the sector.  Its positions have
six digits, so that the mesh of the input file is preferable.

References
----------
G. Dhondt, *CalculiX CrunchiX User's Manual*, "Input deck format" and \*FREQUENCY.
K. Wittig, *CalculiX GraphiX User's Manual*, "Result format" (.frd).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.importers.arrays import (
    as_integers,
    entries_by_node,
    number_table,
    read_dofs,
    reordered,
    triangle_to_full,
)
from bdamper.importers.fe_body import (
    BOUNDS,
    ElementKind,
    FEBody,
    Lines,
    Modes,
    data_lines,
    mesh_body,
    modes_by_diameter,
    parsing,
    read_body,
    reader,
)
from bdamper.importers.input_file import Deck
from bdamper.util.errors import check, mismatch
from bdamper.util.records import check_all
from bdamper.util.storage import FilePath

_FRD_SOLIDS = {1: 8, 2: 6, 3: 4, 4: 20, 5: 15, 6: 10}


# --------------------------------------------------------------------------------------------------
# Input file


@reader("an input file of CalculiX", ".inp")
def read_inp(
    path: Path, instance: str | None = None, include_folder: FilePath | None = None
) -> FEBody:
    """Read nodes, solid elements, node sets and surfaces of an input file of CalculiX or Abaqus.

    The names of sets are in capitals, and the sets of a part are named ``INSTANCE.SET``.  If only
    one instance is read, its nodes have the numbers of the part, and its sets are also known by the
    names in the part.  Nodes of several instances are numbered 1, 2, ... in the order of the
    instances and of the labels.  Elastic constants of isotropic materials are read; steps and loads
    are ignored.

    Parameters
    ----------
    path : path-like
    instance : str, optional
        Instance to read; by default all.
    include_folder : path-like, optional
        Further folder from which files may be included.  Files in the folder of the including file
        and below are always permitted.

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has a keyword that could change the mesh.
    """
    return Deck(path, include_folder).body(instance)


@reader("an input file of CalculiX or Abaqus")
def _deck(path: Path, include_folder: FilePath | None = None) -> Deck:
    return Deck(path, include_folder)


# --------------------------------------------------------------------------------------------------
# Matrices


@reader("lines of row, column, value")
def _triplets(path: Path, n: int) -> sp.csr_matrix:
    """Read a symmetric matrix (n, n) from lines of row, column, value."""
    table = np.loadtxt(path, ndmin=2, encoding="ascii", comments=None)
    check(table.shape[1] == 3, str(path), "three numbers a line", f"{table.shape[1]}")
    # the file counts from 1
    row = as_integers(table[:, 0], f"{path}: column 1") - 1
    column = as_integers(table[:, 1], f"{path}: column 2") - 1
    value = table[:, 2]
    lowest = table[:, :2].min(initial=n)
    highest = table[:, :2].max(initial=0)
    within = lowest >= 1 and highest <= n
    expected = f"rows and columns 1 to {n}, as many as lines of the .dof file"
    check(within and len(table), str(path), expected, f"{lowest:g} to {highest:g}")
    check_all(np.isfinite(value), value, "finite numbers", str(path))
    return triangle_to_full(row, column, value, n)


def _condensed(
    stiffness: sp.csr_matrix, mass: sp.csr_matrix, internal: NDArray, body: FEBody
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Condense the internal degrees of freedom of elements C3D8I.

    An element has nine of them (amplitudes of its incompatible modes), for which CalculiX adds
    three nodes.
    """
    item = f"{body.source}: elements C3D8I"
    n_elements = 0
    for elements, kind in zip(body.elements, body.element_kinds):
        if kind.name == "C3D8I":
            n_elements += len(elements)
    n_internal = int(internal.sum())
    expected = f"{9 * n_elements} rows of their internal nodes in the matrices"
    check(n_internal == 9 * n_elements, item, expected, n_internal)
    outer = np.flatnonzero(~internal)
    inner = np.flatnonzero(internal)
    # the internal rows of an element are coupled with each other only
    blocks = stiffness[inner][:, inner].tobsr(blocksize=(9, 9))
    n_blocks = len(blocks.data)
    check(n_blocks == n_elements, item, "one block of nine rows for each", n_blocks)
    inverse = sp.bsr_matrix((np.linalg.inv(blocks.data), blocks.indices, blocks.indptr)).tocsr()
    # displacements of all rows for a displacement of one outer row
    inner_shapes = -inverse @ stiffness[inner][:, outer]
    shapes = sp.vstack([sp.identity(len(outer)), inner_shapes], format="csr")
    order = np.concatenate([outer, inner])
    condensed_stiffness = (shapes.T @ stiffness[order][:, order] @ shapes).tocsr()
    condensed_mass = (shapes.T @ mass[order][:, order] @ shapes).tocsr()
    # the products are symmetric except for rounding
    return (
        (0.5 * (condensed_stiffness + condensed_stiffness.T)).tocsr(),
        (0.5 * (condensed_mass + condensed_mass.T)).tocsr(),
    )


def read_calculix(
    job: FilePath,
    mesh: FilePath | None = None,
    modes: FilePath | tuple[FilePath, ...] = (),
    include_folder: FilePath | None = None,
) -> FEBody:
    """Read a body from a run with ``*FREQUENCY, SOLVER=MATRIXSTORAGE``.

    Parameters
    ----------
    job : path-like
        Name of the job, with or without file extension; ``job.sti``, ``job.mas`` and ``job.dof``
        are read.
    mesh : path-like, optional
        File with nodes and elements for :func:`read_body`; by default ``job.inp``, or ``job.frd``
        if it does not exist.
    modes : path-like or tuple of path-like
        Result files (.frd) of modal analyses to compare with.
    include_folder : path-like, optional
        Further folder from which files may be included.  Files in the folder of the including file
        and below are always permitted.

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If a file does not exist or is damaged, or the matrices do not belong to the mesh.
    """
    base = Path(job)
    if base.suffix.lower() in (".inp", ".sti", ".mas", ".dof", ".frd"):
        base = base.with_suffix("")
    if not mesh:
        mesh = base.with_name(base.name + ".inp")
        results = base.with_name(base.name + ".frd")
        if results.is_file() and not mesh.is_file():
            mesh = results
    is_deck = Path(mesh).suffix.lower() in ("", ".inp")
    deck = _deck(mesh, include_folder) if is_deck else None
    body = deck.body() if deck else read_body(mesh)
    dofs = read_dofs(base.with_name(base.name + ".dof"))
    if deck:
        deck.check_transforms(dofs)
    stiffness = _triplets(base.with_name(base.name + ".sti"), len(dofs))
    mass = _triplets(base.with_name(base.name + ".mas"), len(dofs))
    internal = ~np.isin(dofs[:, 0], body.numbers)
    if internal.any() and any(kind.name == "C3D8I" for kind in body.element_kinds):
        stiffness, mass = _condensed(stiffness, mass, internal, body)
        dofs = dofs[~internal]
    result_files = (modes,) if isinstance(modes, str | os.PathLike) else modes
    modes_of_files: list[Modes] = []
    for path in result_files:
        modes_of_files += read_frd(path).modes
    return replace(
        body,
        stiffness=stiffness,
        mass=mass,
        dofs=dofs,
        modes=tuple(modes_of_files),
        source=f"{base} (.sti, .mas, .dof), {mesh}",
        element_kinds=_as_integrated(body),
    )


def _as_integrated(body: FEBody) -> tuple[ElementKind, ...]:
    """Return the kinds of the elements; CalculiX integrates wedges at two points."""
    kinds = body.element_kinds
    if not kinds:
        kinds = tuple(ElementKind(f"C3D{elements.shape[1]}") for elements in body.elements)
    return tuple(replace(kind, name="C3D6R") if kind.name == "C3D6" else kind for kind in kinds)


@reader("Abaqus matrix text of rows node, component, node, component, value")
def _labelled(path: Path, deck: Deck) -> tuple[sp.csr_matrix, NDArray]:
    """Read a matrix whose nodes are internal numbers or labels such as ``instance.label``.

    Returns
    -------
    matrix : (n, n) sparse
    dofs : (n, 2) int
        Code of the node and component of each row.
    """
    # a line of the file has the label and the component of a row, those of a column, and a value;
    # a label without a node of the deck has the code None
    code_of: dict[Any, int | None] = {}
    if _has_numbers(path):
        table = number_table(path, 5)
        labels = as_integers(table[:, [0, 2]], str(path))
        code_of_number = {number: code for code, number in deck.numbers().items()}
        for label in np.unique(labels).tolist():
            code_of[label] = code_of_number.get(label)
    else:
        words = []
        for number, line in data_lines(path.read_text(encoding="ascii"), "*"):
            row = [word.strip().replace('"', "") for word in line.split(",")]
            check(len(row) == 5, f"{path}: line {number}", "five values", len(row))
            words.append(row)
        labels = np.array([[row[0], row[2]] for row in words])
        for label in np.unique(labels).tolist():
            code = deck.code(label)
            code_of[label] = code if code in deck.model.nodes else None
        # zeros replace the labels, so that both forms have the same columns
        table = np.array([["0", row[1], "0", *row[3:]] for row in words], float)
    _check_labels(code_of, deck, path)
    distinct, inverse = np.unique(labels, return_inverse=True)
    code_of_distinct = np.array([code_of[label] for label in distinct.tolist()], np.int64)
    codes = code_of_distinct[inverse].reshape(-1, 2)
    components = as_integers(table[:, [1, 3]], str(path))
    return entries_by_node(np.stack([codes, components], axis=2), table[:, 4], path)


def _has_numbers(path: Path) -> bool:
    """Return whether the first line of data begins with a number instead of a label."""
    with open(path, encoding="ascii") as file:
        for line in file:
            if line.strip() and not line.startswith("*"):
                return line.split(",")[0].strip().lstrip("-").isdigit()
    return True


def _check_labels(code_of: Mapping[Any, int | None], deck: Deck, path: Path) -> None:
    """Raise ModelError if a label of a matrix has no code, hence no node in the deck."""
    unknown = [label for label, code in code_of.items() if code is None]
    # Abaqus gives negative numbers to the nodes that it adds
    internal = [label for label in unknown if str(label).startswith("-")]
    if internal:
        cure = (
            "*MATRIX GENERATE, STIFFNESS, MASS, PUBLIC NODES without contact and constraints "
            "writes only those of the deck"
        )
        raise mismatch(str(path), f"nodes of the deck ({cure})", f"internal node {internal[0]}")
    if unknown:
        cure = (
            "a job with noPartsInputFile=ON, or one for each instance, "
            "writes the labels of its deck"
        )
        raise mismatch(str(path), f"nodes of {deck.source} ({cure})", f"node {unknown[0]}")


def read_abaqus(
    job: FilePath, instance: str | None = None, include_folder: FilePath | None = None
) -> FEBody:
    """Read a body from a job with ``*MATRIX GENERATE`` and ``*MATRIX OUTPUT``, in the formats
    MATRIX INPUT or LABELS.

    Parameters
    ----------
    job : path-like
        Name of the job, with or without file extension; ``job.inp`` and the only ``job_STIF*.mtx``
        and ``job_MASS*.mtx`` are read.
    instance : str, optional
        Instance to read, which must not be coupled to others; by default all.  See :func:`read_inp`
        for the numbers of its nodes and the names of its sets.
    include_folder : path-like, optional
        Further folder from which files may be included.  Files in the folder of the including file
        and below are always permitted.

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If a file does not exist or is damaged, or the nodes of the matrices are not those of the
        deck.
    """
    path = Path(job)
    if path.suffix.lower() in ("", ".inp", ".mtx"):
        path = path.with_suffix(".inp")
    else:
        path = Path(f"{job}.inp")
    deck = _deck(path, include_folder)
    for transform in deck.model.transforms:
        expected = "a job without *TRANSFORM, which turns the axes of the rows of its matrices"
        raise mismatch(transform.item, expected, f"one for {transform.node_set}")
    body = deck.body(instance)
    number_of_code = deck.numbers(instance.upper() if instance else None)
    stiffness_file = _only_matrix_file(path, "STIF")
    stiffness, dofs = _matrix_of_nodes(stiffness_file, deck, number_of_code, instance)
    mass_file = _only_matrix_file(path, "MASS")
    mass, mass_dofs = _matrix_of_nodes(mass_file, deck, number_of_code, instance)
    _check_numbering(stiffness, dofs, body, str(stiffness_file))
    return replace(
        body,
        stiffness=stiffness,
        mass=reordered(mass, mass_dofs, dofs, str(mass_file)),
        dofs=dofs,
        source=f"{stiffness_file}, {mass_file.name}, {path.name}",
    )


def _only_matrix_file(deck_path: Path, kind: str) -> Path:
    """Return the only file of *MATRIX OUTPUT, STIF or MASS, of a job."""
    files = sorted(deck_path.parent.glob(f"{deck_path.stem}_{kind}*.mtx"))
    if not files:
        raise FileNotFoundError(
            f"there is no file '{deck_path.stem}_{kind}1.mtx' of *MATRIX OUTPUT, {kind} "
            f"at '{deck_path}'"
        )
    expected = f"one file {deck_path.stem}_{kind}*.mtx"
    check(len(files) == 1, str(deck_path), expected, ", ".join(file.name for file in files))
    return files[0]


def _matrix_of_nodes(
    file: Path, deck: Deck, number_of_code: Mapping[int, int], instance: str | None
) -> tuple[sp.csr_matrix, NDArray]:
    """Read the part of a matrix that belongs to the nodes with a number.

    Returns
    -------
    matrix : (n, n) sparse
    dofs : (n, 2) int
        Node number and component of each row.
    """
    matrix, coded_dofs = _labelled(file, deck)
    # Abaqus holds a component by a large number on the diagonal; the message has the first one
    first_held = coded_dofs[matrix.diagonal() > 1e30][:1]
    expected = "a job without *BOUNDARY (Sector.fixed fixes nodes)"
    check(not len(first_held), str(file), expected, f"held: {first_held}")
    wanted = np.isin(coded_dofs[:, 0], list(number_of_code))
    n_coupled = matrix[wanted][:, ~wanted].nnz
    expected = f"instance {instance} without contact or ties"
    check(n_coupled == 0, str(file), expected, f"{n_coupled} entries that couple it to others")
    dofs = [[number_of_code[code], component] for code, component in coded_dofs[wanted].tolist()]
    return matrix[wanted][:, wanted], np.array(dofs)


def _check_numbering(matrix: sp.csr_matrix, dofs: NDArray, body: FEBody, item: str) -> None:
    """Raise ModelError unless most of the coupled nodes of a matrix belong to the same element."""
    if not body.elements:
        return
    ascending = np.sort(body.numbers)
    n_nodes = len(ascending)
    missing = np.setdiff1d(np.concatenate([nodes.ravel() for nodes in body.elements]), ascending)
    found = f"nodes {missing[:3].tolist()}"
    check(not len(missing), body.source, "elements with existing nodes", found)

    # pairs of nodes that share an element
    row, column = [], []
    n_elements = 0
    for nodes in body.elements:
        n_of_kind, n_nodes_of_element = nodes.shape
        numbers = n_elements + np.arange(n_of_kind)
        row.append(np.repeat(numbers, n_nodes_of_element))
        column.append(np.searchsorted(ascending, nodes).ravel())
        n_elements += n_of_kind
    # an entry for each element and each of its nodes
    places = (np.concatenate(row), np.concatenate(column))
    touching = sp.csr_matrix((np.ones(len(places[0])), places), shape=(n_elements, n_nodes))
    n_shared_elements = touching.T @ touching  # (n_nodes, n_nodes)

    # pairs of nodes that the matrix couples
    entries = matrix.tocoo()
    node_of_row = np.searchsorted(ascending, dofs[:, 0])
    pairs = node_of_row[np.stack([entries.row, entries.col])]
    coupled = sp.csr_matrix((np.ones(len(pairs[0])), pairs), shape=(n_nodes, n_nodes))
    coupled.setdiag(0.0)
    coupled.eliminate_zeros()

    n_apart = coupled.nnz - coupled.multiply(n_shared_elements > 0).nnz
    cure = "use *MATRIX OUTPUT, FORMAT=LABELS or one job for each instance"
    expected = "coupled nodes that share an element of the deck"
    found = f"{n_apart} of {coupled.nnz} pairs that do not share an element; {cure}"
    check(n_apart <= BOUNDS.odd_ones * coupled.nnz, item, expected, found)


# --------------------------------------------------------------------------------------------------
# Results


@reader("a result file of CalculiX in text form (.frd)", ".frd")
def read_frd(path: Path) -> FEBody:
    """Read nodes, solid elements and modes of a result file in text form.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    FEBody
        Body without matrices.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is binary or damaged.
    """
    return _Frd(path).body()


@reader("a result file of CalculiX in text form (.frd)")
def read_frd_stress(path: Path) -> list[tuple[NDArray, NDArray]]:
    """Read the nodal stress of a result file in text form (``*EL FILE`` with ``S``).

    Parameters
    ----------
    path : path-like

    Returns
    -------
    list of (numbers, stress)
        Node numbers (n,) and stress (n, 6) of each step or mode, with the components xx, yy, zz,
        xy, yz, xz in the unit of the file.  The stress is complex if the file has an imaginary
        part.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has no stress at the nodes of its mesh.
    """
    file = _Frd(path, stress=True)
    file.body()
    blocks = file.results["STRESS"]
    check(len(blocks) > 0, str(path), "blocks of stress (STRESS)", "none")
    for k, block in enumerate(blocks):
        numbers = block.numbers
        once = len(np.unique(numbers)) == len(numbers)
        check(
            once and np.isin(numbers, file.numbers).all(),
            f"{path}: stress {k + 1}",
            "nodes of the mesh, each once",
            numbers,
        )
    return [(block.numbers, block.values) for block in blocks]


@dataclass(frozen=True)
class _Result:
    """Values at nodes of one step or mode.

    Parameters
    ----------
    diameter, mode : int
        Nodal diameter, and number of the mode.
    frequency : float, Hz
    numbers : (n,) int
        Node numbers.
    values : (n, 3 or 6) float or complex
    """

    diameter: int
    mode: int
    frequency: float
    numbers: NDArray
    values: NDArray


class _Frd:
    """Parser of a result file in text form."""

    def __init__(self, source: Path, stress: bool = False) -> None:
        with open(source, "rb") as raw:
            binary = b"\x00" in raw.read(100_000)
        if binary:
            expected = "text (*NODE FILE, not the binary form)"
            raise mismatch(str(source), expected, "bytes that are not text")
        self.lines = Lines(source, "ascii")
        self.source = str(self.lines.source)
        self.numbers: NDArray = np.empty(0, np.int64)
        self.nodes: NDArray = np.empty((0, 3))
        self.elements: list[list[int]] = []
        # by the name of the result
        self.results: dict[str, list[_Result]] = {"DISP": []}
        if stress:
            self.results["STRESS"] = []

    def _rows(self, head: str, n_values: int) -> tuple[NDArray, NDArray]:
        """Read node numbers and values up to the end of a block with the line ``head``."""
        numbers, values = [], []
        # the last character of the head defines the width of the node number: 5 or 10 columns
        end_of_number = 8 if head.rstrip().endswith("0") else 13
        starts = range(end_of_number, end_of_number + 12 * n_values, 12)
        while True:
            line = self.lines.take("the end of a block (-3)")
            if line.startswith(" -3"):
                break
            self.lines.require(line.startswith(" -1"), "a line of values (-1)", f"'{line[:40]}'")
            with parsing(self.lines.item, f"a node number and {n_values} values", line):
                numbers.append(int(line[3:end_of_number]))
                values.append([float(line[start : start + 12]) for start in starts])
        table = np.array(values, float).reshape(-1, n_values)
        finite = np.isfinite(table)
        self.lines.require(finite.all(), "finite values in the block above", table[~finite][:1])
        return np.array(numbers, np.int64), table

    def _element_block(self) -> None:
        while True:
            line = self.lines.take("the end of a block (-3)")
            if line.startswith(" -3"):
                break
            words = line[3:].split()
            begins_element = line.startswith(" -1") and len(words) >= 2
            self.lines.require(begins_element, "an element (-1)", f"'{line[:40]}'")
            nodes: list[int] = []
            n_nodes = _FRD_SOLIDS.get(int(words[1]))
            while self.lines.follows(" -2"):
                text = self.lines.take("nodes")[3:].rstrip()
                nodes += [int(text[start : start + 10]) for start in range(0, len(text), 10)]
            # elements other than solids are skipped
            if n_nodes is None:
                continue
            self.lines.require(len(nodes) == n_nodes, f"{n_nodes} nodes of an element", len(nodes))
            self.elements.append(nodes)

    def body(self) -> FEBody:
        diameter, mode = 0, 0
        for line in self.lines:
            key = line[:10].strip()
            if key.startswith("2C"):
                self.numbers, self.nodes = self._rows(line, 3)
            elif key.startswith("3C"):
                self._element_block()
            elif key.startswith("1PHID"):
                diameter = max(int(line[10:].split()[0]), 0)  # -1 without cyclic symmetry
            elif key.startswith("1PMODE"):
                mode = int(line[10:].split()[0])
            elif key.startswith("100C"):
                self._result(line, diameter, mode)
        listed = []
        for shape in self.results["DISP"]:
            # the modal mass is one over the sector
            modal_mass = 1.0
            listed.append(
                (shape.diameter, shape.frequency, modal_mass, shape.numbers, shape.values)
            )
        return mesh_body(
            self.source,
            "a block of nodes (2C)",
            self.numbers,
            self.nodes,
            self.elements,
            modes=modes_by_diameter(listed, self.source),
        )

    def _result(self, head: str, diameter: int, mode: int) -> None:
        """Read a block of displacements or stress, and skip blocks of other results.

        The imaginary part of a complex result follows in another block.  It is added to the real
        part of the same mode.
        """
        with parsing(self.lines.item, "a frequency in columns 13 to 24", head):
            frequency = float(head[12:24])
        name = ""
        while self.lines.follows(" -4", " -5"):
            line = self.lines.take("the header of a result")
            if line.startswith(" -4"):
                name = line[5:13].strip()
        kind = name.removesuffix("I")
        if kind not in self.results:
            return
        blocks = self.results[kind]
        n_values = 6 if kind == "STRESS" else 3
        if not name.endswith("I"):
            numbers, values = self._rows(head, n_values)
            blocks.append(_Result(diameter, mode, frequency, numbers, values))
            return
        # an imaginary part without a real part of the same mode before it is skipped
        if not blocks:
            return
        real = blocks[-1]
        if (real.diameter, real.mode) != (diameter, mode):
            return
        numbers, values = self._rows(head, n_values)
        same = np.array_equal(real.numbers, numbers)
        expected = f"nodes {real.numbers} in both parts"
        check(same, f"{self.source}: mode {mode}", expected, numbers)
        blocks[-1] = replace(real, values=real.values + 1j * values)
