r"""CalculiX and Abaqus: mesh and sets of an input file or of results, stored matrices, modes of a cyclic analysis.

In CalculiX, ``*FREQUENCY, SOLVER=MATRIXSTORAGE`` writes the upper triangles of stiffness and mass (``.sti`` and ``.mas``
with row, column, value).  The file ``.dof`` lists the free components of their rows as ``node.component``.  If the deck
has ties of cyclic symmetry, ``CYCMPC=INACTIVE`` excludes them from the matrices.

In Abaqus, ``*MATRIX OUTPUT`` writes lines of node, component, node, component and value.  The nodes are labels, or, for an
assembly of several instances, numbers or labels with the name of their instance.

In a cyclic ``.frd`` file each mode has the blocks DISP and DISPI: real and imaginary part of a travelling wave of either
direction, with a modal mass of one over the sector.  Its positions have six digits, so that the mesh of the input file is
preferable.

References
----------
G. Dhondt, *CalculiX CrunchiX User's Manual*, "Input deck format" and \*FREQUENCY.
K. Wittig, *CalculiX GraphiX User's Manual*, "Result format" (.frd).
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

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


# -----------------------------------------------------------------------------------------------------------
# Input file


@reader("an input file of CalculiX", ".inp")
def read_inp(path: Path, instance: str | None = None) -> FEBody:
    """Read nodes, solid elements, node sets and surfaces of an input file of CalculiX or Abaqus.

    The names of sets are in capitals, and the sets of a part are named ``INSTANCE.SET``.  If only one instance is read, its
    nodes have the numbers of the part, and its sets are also known by the names in the part.  Nodes of several instances
    are numbered 1, 2, ... in the order of the instances and of the labels.  Elastic constants of isotropic materials are
    read; steps and loads are ignored.

    Parameters
    ----------
    path : path-like
    instance : str, optional
        Instance to read; by default all.

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has a keyword that could change the mesh.
    """
    return Deck(path).body(instance)


@reader("an input file of Abaqus")
def _deck(path: Path) -> Deck:
    return Deck(path)


# -----------------------------------------------------------------------------------------------------------
# Matrices


@reader("lines of row, column, value")
def _triplets(path: Path, n: int) -> sp.csr_matrix:
    """Read a symmetric matrix (n, n) from lines of row, column, value."""
    table = np.loadtxt(path, ndmin=2, encoding="ascii", comments=None)
    check(table.shape[1] == 3, str(path), "three numbers a line", f"{table.shape[1]}")
    row, column = (as_integers(table[:, k], f"{path}: column {k + 1}") - 1 for k in (0, 1))
    low, high = table[:, :2].min(initial=n), table[:, :2].max(initial=0)
    good, expected = (
        low >= 1 and high <= n,
        f"rows and columns 1 to {n}, as many as lines of the .dof file",
    )
    check(good and len(table), str(path), expected, f"{low:g} to {high:g}")
    check_all(np.isfinite(table[:, 2]), table[:, 2], "finite numbers", str(path))
    return triangle_to_full(row, column, table[:, 2], n)


def _condensed(
    stiffness: sp.csr_matrix, mass: sp.csr_matrix, internal: NDArray, body: FEBody
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Condense the internal degrees of freedom of elements C3D8I.

    An element has nine of them (amplitudes of its incompatible modes), for which CalculiX adds three nodes.
    """
    n = sum(
        9 * len(e) for e, kind in zip(body.elements, body.element_kinds) if kind.name == "C3D8I"
    )
    found = int(internal.sum())
    check(
        found == n,
        f"{body.source}: elements C3D8I",
        f"{n} rows of their internal nodes in the matrices",
        found,
    )
    outer, inner = np.flatnonzero(~internal), np.flatnonzero(internal)
    blocks = stiffness[inner][:, inner].tobsr(blocksize=(9, 9))
    good, item = len(blocks.data) == n // 9, f"{body.source}: elements C3D8I"
    check(good, item, "one block of nine rows for each", len(blocks.data))
    inverse = sp.bsr_matrix((np.linalg.inv(blocks.data), blocks.indices, blocks.indptr)).tocsr()
    shapes = sp.vstack(
        [sp.identity(len(outer)), -inverse @ stiffness[inner][:, outer]], format="csr"
    )
    order = np.concatenate([outer, inner])
    k, m = ((shapes.T @ matrix[order][:, order] @ shapes).tocsr() for matrix in (stiffness, mass))
    return (0.5 * (k + k.T)).tocsr(), (0.5 * (m + m.T)).tocsr()


def read_calculix(
    job: FilePath, mesh: FilePath | None = None, modes: FilePath | tuple[FilePath, ...] = ()
) -> FEBody:
    """Read a body from a run with ``*FREQUENCY, SOLVER=MATRIXSTORAGE``.

    Parameters
    ----------
    job : path-like
        Name of the job, with or without ending; ``job.sti``, ``job.mas`` and ``job.dof`` are read.
    mesh : path-like, optional
        File with nodes and elements for :func:`read_body`; by default ``job.inp``, or ``job.frd`` if it does
        not exist.
    modes : path-like or tuple of path-like
        Result files (.frd) of modal analyses to compare with.

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
    deck, results, table, *matrices = (
        base.with_name(base.name + end) for end in (".inp", ".frd", ".dof", ".sti", ".mas")
    )
    mesh = mesh or (results if results.is_file() and not deck.is_file() else deck)
    body = read_inp(mesh) if Path(mesh).suffix == "" else read_body(mesh)
    dofs = read_dofs(table)
    stiffness, mass = (_triplets(path, len(dofs)) for path in matrices)
    internal = ~np.isin(dofs[:, 0], body.numbers)
    if internal.any() and any(kind.name == "C3D8I" for kind in body.element_kinds):
        stiffness, mass = _condensed(stiffness, mass, internal, body)
        dofs = dofs[~internal]
    # CalculiX integrates wedges at two points.
    kinds = body.element_kinds or tuple(
        ElementKind(f"C3D{elements.shape[1]}") for elements in body.elements
    )
    kinds = tuple(replace(kind, name="C3D6R") if kind.name == "C3D6" else kind for kind in kinds)
    files = (modes,) if isinstance(modes, str | os.PathLike) else modes
    compared, source = (
        tuple(mode for path in files for mode in read_frd(path).modes),
        f"{base} (.sti, .mas, .dof), {mesh}",
    )
    return replace(
        body,
        stiffness=stiffness,
        mass=mass,
        dofs=dofs,
        modes=compared,
        source=source,
        element_kinds=kinds,
    )


@reader("Abaqus matrix text of rows node, component, node, component, value")
def _labelled(path: Path, deck: Deck) -> tuple[sp.csr_matrix, NDArray]:
    """Read a matrix whose nodes are internal numbers or labels such as ``instance.label``.

    Returns
    -------
    matrix : (n, n) sparse
    dofs : (n, 2) int
        Code of the node and component of each row.
    """
    with open(path, encoding="ascii") as file:
        first = next((line for line in file if line.strip() and not line.startswith("*")), "0")
    if first.split(",")[0].strip().lstrip("-").isdigit():
        table = number_table(path, 5)
        own = {number: code for code, number in deck.numbers().items()}
        labels = as_integers(table[:, [0, 2]], str(path))
        names = {label: own.get(label) for label in np.unique(labels).tolist()}
    else:
        lines = data_lines(path.read_text(encoding="ascii"), "*")
        words = [[word.strip().replace('"', "") for word in line.split(",")] for _, line in lines]
        for (k, _), row in zip(lines, words):
            check(len(row) == 5, f"{path}: line {k}", "five values", len(row))
        labels = np.array([[row[0], row[2]] for row in words])
        names = {label: deck.code(label) for label in np.unique(labels).tolist()}
        names = {label: code if code in deck.model.nodes else None for label, code in names.items()}
        table = np.array([["0", row[1], "0", *row[3:]] for row in words], float)
    unknown = [label for label, code in names.items() if code is None]
    internal = [label for label in unknown if str(label).startswith("-")]
    cure = "*MATRIX GENERATE, STIFFNESS, MASS, PUBLIC NODES without contact and constraints writes those of the deck alone"
    check(
        not internal,
        str(path),
        f"nodes of the deck ({cure})",
        f"internal node {(internal or [0])[0]}",
    )
    cure = "a job with noPartsInputFile=ON, or one for each instance, writes the labels of its deck"
    check(not unknown, str(path), f"nodes of {deck.source} ({cure})", f"node {(unknown or [0])[0]}")
    known, inverse = np.unique(labels, return_inverse=True)
    codes = np.array([names[label] for label in known.tolist()], np.int64)[inverse].reshape(-1, 2)
    components = as_integers(table[:, [1, 3]], str(path))
    return entries_by_node(np.stack([codes, components], axis=2), table[:, 4], path)


def read_abaqus(job: FilePath, instance: str | None = None) -> FEBody:
    """Read a body from a job with ``*MATRIX GENERATE`` and ``*MATRIX OUTPUT``, in the formats MATRIX INPUT or LABELS.

    Parameters
    ----------
    job : path-like
        Name of the job, with or without ending; ``job.inp`` and the only ``job_STIF*.mtx`` and ``job_MASS*.mtx`` are read.
    instance : str, optional
        Instance to read, which must not be coupled to others; by default all.  See :func:`read_inp` for the numbers of its
        nodes and the names of its sets.

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If a file does not exist or is damaged, or the nodes of the matrices are not those of the deck.
    """
    path = (
        Path(job).with_suffix(".inp")
        if Path(job).suffix.lower() in ("", ".inp", ".mtx")
        else Path(f"{job}.inp")
    )
    deck = _deck(path)
    body = deck.body(instance)
    number, matrices = deck.numbers(instance.upper() if instance else None), []
    for kind in ("STIF", "MASS"):
        found = sorted(path.parent.glob(f"{path.stem}_{kind}*.mtx"))
        if not found:
            raise FileNotFoundError(
                f"there is no file '{path.stem}_{kind}1.mtx' of *MATRIX OUTPUT, {kind} at '{path}'"
            )
        check(
            len(found) == 1,
            str(path),
            f"one file {path.stem}_{kind}*.mtx",
            ", ".join(file.name for file in found),
        )
        matrix, dofs = _labelled(found[0], deck)
        held = dofs[matrix.diagonal() > 1e30][:1]
        check(
            not len(held),
            str(found[0]),
            "a job without *BOUNDARY (Sector.fixed holds nodes)",
            f"held: {held}",
        )
        own = np.isin(dofs[:, 0], list(number))
        coupled = matrix[own][:, ~own].nnz
        check(
            coupled == 0,
            str(found[0]),
            f"instance {instance} without contact or ties",
            f"{coupled} entries with others",
        )
        table = np.array([[number[code], component] for code, component in dofs[own].tolist()])
        matrices.append((matrix[own][:, own], table, found[0]))
    (stiffness, table, file), (mass, others, second) = matrices
    _check_numbering(stiffness, table, body, str(file))
    mass = reordered(mass, others, table, str(second))
    return replace(
        body,
        stiffness=stiffness,
        mass=mass,
        dofs=table,
        source=f"{file}, {second.name}, {path.name}",
    )


def _check_numbering(matrix: sp.csr_matrix, dofs: NDArray, body: FEBody, item: str) -> None:
    """Raise ModelError unless most of the coupled nodes of a matrix belong to the same element."""
    if not body.elements:
        return
    order = np.sort(body.numbers)
    count = len(order)
    missing = np.setdiff1d(np.concatenate([nodes.ravel() for nodes in body.elements]), order)
    check(
        not len(missing),
        body.source,
        "elements with existing nodes",
        f"nodes {missing[:3].tolist()}",
    )
    elements = [np.searchsorted(order, nodes) for nodes in body.elements]
    row = np.repeat(
        np.arange(sum(map(len, elements))), [nodes.shape[1] for nodes in elements for _ in nodes]
    )
    column = np.concatenate([nodes.ravel() for nodes in elements])
    touching = sp.csr_matrix((np.ones(len(row)), (row, column)), shape=(row[-1] + 1, count))
    entries = matrix.tocoo()
    pairs = np.searchsorted(order, dofs[:, 0])[np.stack([entries.row, entries.col])]
    joined = sp.csr_matrix((np.ones(len(pairs[0])), pairs), shape=(count, count))
    joined.setdiag(0.0)
    joined.eliminate_zeros()
    together = touching.T @ touching
    alone = joined.nnz - joined.multiply(together > 0).nnz
    cure = "*MATRIX OUTPUT, FORMAT=LABELS or one job for each instance names them"
    expected = f"coupled nodes that share an element of the deck ({cure})"
    check(
        alone <= BOUNDS.odd_ones * joined.nnz,
        item,
        expected,
        f"{alone} of {joined.nnz} pairs that share none",
    )


# -----------------------------------------------------------------------------------------------------------
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
        Node numbers (n,) and stress (n, 6) of each step or mode, with the components xx, yy, zz, xy, yz, xz in the unit of
        the file.  The stress is complex if the file has an imaginary part.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has no stress at the nodes of its mesh.
    """
    file = _Frd(path, stress=True)
    file.body()
    stress = [(numbers, values) for _, numbers, values in file.results["STRESS"]]
    check(len(stress) > 0, str(path), "blocks of stress (STRESS)", "none")
    for k, (numbers, _) in enumerate(stress):
        good = len(np.unique(numbers)) == len(numbers) and np.isin(numbers, file.numbers).all()
        check(good, f"{path}: stress {k + 1}", "nodes of the mesh, each once", numbers)
    return stress


class _Frd:
    """Parser of a result file in text form."""

    def __init__(self, source: Path, stress: bool = False) -> None:
        with open(source, "rb") as raw:
            if b"\x00" in raw.read(100_000):
                raise mismatch(
                    str(source), "text (*NODE FILE, not the binary form)", "bytes that are no text"
                )
        lines = Lines(source, "ascii")
        self.source, self.lines = str(lines.source), lines
        self.numbers: NDArray = np.empty(0, np.int64)
        self.nodes: NDArray = np.empty((0, 3))
        self.elements: list[list[int]] = []
        # by the name of the result: (nodal diameter, number, frequency in Hz), node numbers, values
        self.results: dict[str, list[tuple[tuple[int, int, float], NDArray, NDArray]]] = {
            "DISP": []
        }
        if stress:
            self.results["STRESS"] = []

    def _rows(self, head: str, n_values: int) -> tuple[NDArray, NDArray]:
        """Read node numbers and values up to the end of a block; the last character of its head defines the format."""
        numbers, values = [], []
        start = 8 if head.rstrip().endswith("0") else 13
        while not (line := self.lines.take("the end of a block (-3)")).startswith(" -3"):
            self.lines.require(line.startswith(" -1"), "a line of values (-1)", f"'{line[:40]}'")
            with parsing(self.lines.item, f"a node number and {n_values} values", line):
                numbers.append(int(line[3:start]))
                values.append(
                    [float(line[start + 12 * k : start + 12 * k + 12]) for k in range(n_values)]
                )
        out = np.array(values, float).reshape(-1, n_values)
        self.lines.require(
            np.isfinite(out).all(), "finite values in the block above", out[~np.isfinite(out)][:1]
        )
        return np.array(numbers, np.int64), out

    def _element_block(self) -> None:
        while not (line := self.lines.take("the end of a block (-3)")).startswith(" -3"):
            words = line[3:].split()
            self.lines.require(
                line.startswith(" -1") and len(words) >= 2, "an element (-1)", f"'{line[:40]}'"
            )
            n = _FRD_SOLIDS.get(int(words[1]))
            nodes: list[int] = []
            while self.lines.follows(" -2"):
                text = self.lines.take("nodes")[3:].rstrip()
                nodes += [int(text[k : k + 10]) for k in range(0, len(text), 10)]
            self.lines.require(n in (None, len(nodes)), f"{n} nodes of an element", len(nodes))
            if n is not None:
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
        shapes = self.results["DISP"]
        modes = modes_by_diameter(
            ((d, hertz, 1.0, nodes, shape) for (d, _, hertz), nodes, shape in shapes), self.source
        )
        return mesh_body(
            self.source,
            "a block of nodes (2C)",
            self.numbers,
            self.nodes,
            self.elements,
            modes=modes,
        )

    def _result(self, head: str, diameter: int, mode: int) -> None:
        with parsing(self.lines.item, "a frequency in columns 13 to 24", head):
            frequency = float(head[12:24])
        name = ""
        while self.lines.follows(" -4", " -5"):
            line = self.lines.take("the head of a result")
            if line.startswith(" -4"):
                name = line[5:13].strip()
        kind, imaginary = name.removesuffix("I"), name.endswith("I")
        if kind not in self.results:
            return
        blocks, n_values = self.results[kind], {"DISP": 3, "STRESS": 6}[kind]
        if not imaginary:
            blocks.append(((diameter, mode, frequency), *self._rows(head, n_values)))
        elif blocks and blocks[-1][0][:2] == (
            diameter,
            mode,
        ):  # the imaginary part follows the real one
            key, numbers, real = blocks[-1]
            nodes, values = self._rows(head, n_values)
            check(
                np.array_equal(numbers, nodes),
                f"{self.source}: mode {mode}",
                f"nodes {numbers} in both parts",
                nodes,
            )
            blocks[-1] = (key, numbers, real + 1j * values)
