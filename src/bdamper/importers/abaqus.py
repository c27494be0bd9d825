r"""CalculiX and Abaqus: mesh and sets of an input file or of results, stored matrices, modes of a cyclic analysis.

In CalculiX, ``*FREQUENCY, SOLVER=MATRIXSTORAGE`` writes the upper triangles of stiffness and mass (``.sti`` and ``.mas``
with row, column, value).  The file ``.dof`` lists the free components of their rows as ``node.component``.  If the deck
has ties of cyclic symmetry, ``CYCMPC=INACTIVE`` excludes them from the matrices.

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
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fem.surface import FACES, N_CORNER, oriented_facet
from bdamper.importers.arrays import as_integers, read_dofs, triangle_to_full
from bdamper.importers.deck_keywords import adds_to_matrices
from bdamper.importers.fe_body import (
    LARGEST_COUNT,
    ElementKind,
    FEBody,
    Included,
    Lines,
    data_lines,
    mesh_body,
    modes_by_diameter,
    parsing,
    read_body,
    reader,
)
from bdamper.model.fields import check, check_all
from bdamper.util.errors import mismatch
from bdamper.util.storage import FilePath

_SOLIDS = {"C3D4": 4, "C3D10": 10, "C3D6": 6, "C3D15": 15, "C3D8": 8, "C3D20": 20}
_FRD_SOLIDS = {1: 8, 2: 6, 3: 4, 4: 20, 5: 15, 6: 10}


# -----------------------------------------------------------------------------------------------------------
# Input file


def _plain(text: str) -> str:
    """Return a keyword or parameter name in capitals without blanks, since both programs ignore case and blanks."""
    return "".join(text.upper().split())


Rows = list[tuple[int, list[str]]]
"""Numbers of data lines, and their words between commas."""


class _Deck:
    """Parser of an input file: blocks of a keyword with parameters, followed by data lines."""

    def __init__(self, source: Path) -> None:
        self.source = source
        self.nodes: dict[int, list[float]] = {}
        self.element_of: dict[int, list[int]] = {}
        self.type_of: dict[int, str] = {}
        self.sections: dict[str, str] = {}
        self.elastic: dict[str, tuple[float, float]] = {}
        self.material = ""
        self.node_sets: dict[str, list[int]] = {}
        self.element_sets: dict[str, list[int]] = {}
        self.surfaces: dict[str, list[list[str]]] = {}
        self.node_surfaces: dict[str, list[str]] = {}
        self.notes: list[str] = []
        self.included = Included()

    def read(self, source: Path, depth: int = 0) -> None:
        """Read a file and the files that it includes."""
        for at, keyword, parameters, rows in self._blocks(source.read_text(encoding="utf-8", errors="replace")):
            item = f"{source}: {keyword} in line {at}"
            if adds_to_matrices(keyword, parameters, item):
                self.notes.append(f"{keyword} of the deck is not read: its stiffness or mass must be in the matrices")
            elif keyword == "*INCLUDE":
                self.read(self.included.path(parameters.get("INPUT", ""), source, depth, item), depth + 1)
            else:
                self._block(keyword, parameters, rows, item)

    @staticmethod
    def _blocks(deck: str) -> Iterator[tuple[int, str, dict[str, str], Rows]]:
        """Iterate over line number, keyword, parameters and data lines of each block."""
        block = None
        for number, text in data_lines(deck, "**"):
            words = [word.strip() for word in text.split(",")]
            if text.startswith("*"):
                if block:
                    yield block
                pairs = (word.partition("=")[::2] for word in words[1:] if word)
                parameters = {_plain(key): value.strip().strip('"') for key, value in pairs}
                block = number, _plain(words[0]), parameters, Rows()
            elif block:
                block[-1].append((number, words))
        if block:
            yield block

    def _block(self, keyword: str, parameters: dict[str, str], rows: Rows, item: str) -> None:
        if keyword == "*NODE":
            self._nodes(parameters, rows)
        elif keyword == "*ELEMENT":
            self._elements(parameters, rows, item)
        elif keyword in ("*NSET", "*ELSET"):
            sets = self.node_sets if keyword == "*NSET" else self.element_sets
            self._set(sets, parameters.get(keyword[1:], ""), "GENERATE" in parameters, rows, item)
        elif keyword == "*SURFACE":
            name, kind = parameters.get("NAME", "").upper(), parameters.get("TYPE", "ELEMENT").upper()
            check(kind in ("NODE", "ELEMENT"), item, "TYPE=NODE or TYPE=ELEMENT", f"TYPE={kind}")
            if kind == "NODE":
                self.node_surfaces[name] = [words[0] for _, words in rows]
            else:
                good = all(len(words) > 1 for _, words in rows)
                check(good, item, "an element or set and the label of a face in every line", "another line")
                self.surfaces[name] = [words[:2] for _, words in rows]
        elif keyword == "*MATERIAL":
            self.material = parameters.get("NAME", "").upper()
        elif keyword == "*ELASTIC" and rows and parameters.get("TYPE", "ISO").upper().startswith("ISO"):
            with self._parsing(rows[0], "Young's modulus, Poisson's ratio"):
                young, poisson = map(float, rows[0][1][:2])  # of the lowest temperature
                self.elastic[self.material] = young, poisson
        elif keyword == "*SOLIDSECTION":
            self.sections[parameters.get("ELSET", "").upper()] = parameters.get("MATERIAL", "").upper()

    def _parsing(self, row: tuple[int, list[str]], expected: str) -> AbstractContextManager[None]:
        return parsing(f"{self.source}: line {row[0]}", expected, ", ".join(row[1]))

    def _integers(self, rows: Rows) -> list[int]:
        numbers: list[int] = []
        for row in rows:
            with self._parsing(row, "whole numbers"):
                numbers += [int(word) for word in row[1] if word]
        return numbers

    def _kinds(self) -> list[ElementKind]:
        elastic = {
            element: self.elastic.get(material, ())
            for name, material in self.sections.items()
            for element in self.element_sets.get(name, ())
        }
        return [ElementKind(self.type_of[element], *elastic.get(element, ())) for element in self.element_of]

    def _nodes(self, parameters: dict[str, str], rows: Rows) -> None:
        added = []
        for row in rows:
            with self._parsing(row, "a node number and its position"):
                number, *position = row[1]
                if not position or len([word for word in row[1] if word]) > 4:
                    raise ValueError
                added.append(int(number))
                # As in CalculiX, the last definition of a node is used.
                self.nodes[added[-1]] = [float(word or 0.0) for word in [*position, "", ""][:3]]
        if parameters.get("NSET"):
            self.node_sets.setdefault(parameters["NSET"].upper(), []).extend(added)

    def _elements(self, parameters: dict[str, str], rows: Rows, item: str) -> None:
        kind = parameters.get("TYPE", "").upper()
        plain = kind.rstrip("RIHM")
        n = _SOLIDS.get(plain)
        if n is None:
            self.notes.append(f"elements of type {kind or '(none)'} are not read: solid elements only")
            return
        words = self._integers(rows)
        expected = f"1 + {n} numbers for each element of type {kind}"
        check(len(words) % (n + 1) == 0, item, expected, f"{len(words)} numbers")
        for k in range(0, len(words), n + 1):
            self.element_of[words[k]] = words[k + 1 : k + n + 1]
            self.type_of[words[k]] = plain + next((letter for letter in "RI" if letter in kind[len(plain) :]), "")
        if parameters.get("ELSET"):
            self.element_sets.setdefault(parameters["ELSET"].upper(), []).extend(words[:: n + 1])

    def _set(self, sets: dict[str, list[int]], name: str, generate: bool, rows: Rows, item: str) -> None:
        check(bool(name), item, "a name of the set", "none")
        members = sets.setdefault(name.upper(), [])
        for row in rows:
            if generate:
                first, *more = self._integers([row]) or [0]
                last, step = [*more, 1][:2] if more else (0, 0)
                with self._parsing(row, "first, last and step"):
                    if not (step > 0 and 0 <= (last - first) // step <= LARGEST_COUNT // 100):
                        raise ValueError
                members.extend(range(first, last + 1, step))
                continue
            for word in filter(None, row[1]):
                if word.lstrip("+-").isdigit():
                    members += self._integers([(row[0], [word])])
                else:
                    expected = f"a number or a set out of {sorted(sets)}"
                    check(word.upper() in sets, f"{self.source}: line {row[0]}", expected, f"'{word[:30]}'")
                    members.extend(sets[word.upper()])

    def body(self) -> FEBody:
        """Return the body of the deck, without matrices."""
        sets = {name: np.unique(np.array(m, dtype=np.int64)) for name, m in self.node_sets.items() if m}
        for name, members in self.node_surfaces.items():
            known = [sets[m.upper()] for m in members if m.upper() in sets]
            if known:
                sets.setdefault(name, np.unique(np.concatenate(known)))
        body = mesh_body(
            str(self.source), "*NODE with at least one node", list(self.nodes), list(self.nodes.values()),
            self.element_of.values(), self._kinds(), node_sets=sets, notes=tuple(dict.fromkeys(self.notes)),
        )  # fmt: skip
        return replace(body, face_sets=self._face_sets(body.numbers, body.nodes))

    def _face_sets(self, numbers: NDArray, nodes: NDArray) -> dict[str, tuple[NDArray, ...]]:
        index = {number: k for k, number in enumerate(numbers.tolist())}
        out = {}
        for name, pairs in self.surfaces.items():
            item = f"{self.source}: *SURFACE, NAME={name}"
            facets: dict[int, list[NDArray]] = {}
            for who, label in pairs:
                known = who.isdigit() or who.upper() in self.element_sets
                check(known, item, f"an element or a set out of {sorted(self.element_sets)}", f"'{who[:30]}'")
                members = [int(who)] if who.isdigit() else self.element_sets[who.upper()]
                for element in members:
                    check(element in self.element_of, item, "solid elements of this deck", f"element {element}")
                    connected = self.element_of[element]
                    faces = FACES[N_CORNER[len(connected)]]
                    labels = [f"S{k}" for k in range(1, len(faces) + 1)]
                    check(label.upper() in labels, item, f"faces S1 to {labels[-1]}", f"'{label[:30]}'")
                    missing = [n for n in connected if n not in index]
                    check(not missing, item, "elements with existing nodes", f"nodes {missing}")
                    rows = np.array([index[n] for n in connected])
                    facet = oriented_facet(rows[list(faces[labels.index(label.upper())])], rows, nodes)
                    facets.setdefault(len(facet), []).append(numbers[facet])
            if facets:
                out[name] = tuple(np.array(f) for f in facets.values())
        return out


@reader("an input file of CalculiX", ".inp")
def read_inp(path: Path) -> FEBody:
    """Read nodes, solid elements, node sets and surfaces of an input file of CalculiX or Abaqus.

    The names of sets are in capitals.  Elastic constants of isotropic materials are read; steps and loads are ignored.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has a keyword that could change the mesh.
    """
    deck = _Deck(path)
    deck.read(path)
    return deck.body()


# -----------------------------------------------------------------------------------------------------------
# Matrices


@reader("lines of row, column, value")
def _triplets(path: Path, n: int) -> sp.csr_matrix:
    """Read a symmetric matrix (n, n) from lines of row, column, value."""
    table = np.loadtxt(path, ndmin=2, encoding="ascii", comments=None)
    check(table.shape[1] == 3, str(path), "three numbers a line", f"{table.shape[1]}")
    row, column = (as_integers(table[:, k], f"{path}: column {k + 1}") - 1 for k in (0, 1))
    low, high = table[:, :2].min(initial=n), table[:, :2].max(initial=0)
    good, expected = low >= 1 and high <= n, f"rows and columns 1 to {n}, as many as lines of the .dof file"
    check(good and len(table), str(path), expected, f"{low:g} to {high:g}")
    check_all(np.isfinite(table[:, 2]), table[:, 2], "finite numbers", str(path))
    return triangle_to_full(row, column, table[:, 2], n)


def _condensed(
    stiffness: sp.csr_matrix, mass: sp.csr_matrix, internal: NDArray, body: FEBody
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Condense the internal degrees of freedom of elements C3D8I.

    An element has nine of them (amplitudes of its incompatible modes), for which CalculiX adds three nodes.
    """
    n = sum(9 * len(e) for e, kind in zip(body.elements, body.element_kinds) if kind.name == "C3D8I")
    found = int(internal.sum())
    check(found == n, f"{body.source}: elements C3D8I", f"{n} rows of their internal nodes in the matrices", found)
    outer, inner = np.flatnonzero(~internal), np.flatnonzero(internal)
    blocks = stiffness[inner][:, inner].tobsr(blocksize=(9, 9))
    good, item = len(blocks.data) == n // 9, f"{body.source}: elements C3D8I"
    check(good, item, "one block of nine rows for each", len(blocks.data))
    inverse = sp.bsr_matrix((np.linalg.inv(blocks.data), blocks.indices, blocks.indptr)).tocsr()
    shapes = sp.vstack([sp.identity(len(outer)), -inverse @ stiffness[inner][:, outer]], format="csr")
    order = np.concatenate([outer, inner])
    k, m = ((shapes.T @ matrix[order][:, order] @ shapes).tocsr() for matrix in (stiffness, mass))
    return (0.5 * (k + k.T)).tocsr(), (0.5 * (m + m.T)).tocsr()


def read_calculix(job: FilePath, mesh: FilePath | None = None, modes: FilePath | tuple[FilePath, ...] = ()) -> FEBody:
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
    deck, results, table, *matrices = (base.with_name(base.name + end) for end in (".inp", ".frd", ".dof", ".sti", ".mas"))
    mesh = mesh or (results if results.is_file() and not deck.is_file() else deck)
    body = read_inp(mesh) if Path(mesh).suffix == "" else read_body(mesh)
    dofs = read_dofs(table)
    stiffness, mass = (_triplets(path, len(dofs)) for path in matrices)
    internal = ~np.isin(dofs[:, 0], body.numbers)
    if internal.any() and any(kind.name == "C3D8I" for kind in body.element_kinds):
        stiffness, mass = _condensed(stiffness, mass, internal, body)
        dofs = dofs[~internal]
    # CalculiX integrates wedges at two points.
    kinds = body.element_kinds or tuple(ElementKind(f"C3D{elements.shape[1]}") for elements in body.elements)
    kinds = tuple(replace(kind, name="C3D6R") if kind.name == "C3D6" else kind for kind in kinds)
    files = (modes,) if isinstance(modes, str | os.PathLike) else modes
    compared, source = tuple(mode for path in files for mode in read_frd(path).modes), f"{base} (.sti, .mas, .dof), {mesh}"
    return replace(
        body, stiffness=stiffness, mass=mass, dofs=dofs, modes=compared, source=source, element_kinds=kinds
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
                raise mismatch(str(source), "text (*NODE FILE, not the binary form)", "bytes that are no text")
        lines = Lines(source, "ascii")
        self.source, self.lines = str(lines.source), lines
        self.numbers: NDArray = np.empty(0, np.int64)
        self.nodes: NDArray = np.empty((0, 3))
        self.elements: list[list[int]] = []
        # by the name of the result: (nodal diameter, number, frequency in Hz), node numbers, values
        self.results: dict[str, list[tuple[tuple[int, int, float], NDArray, NDArray]]] = {"DISP": []}
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
                values.append([float(line[start + 12 * k : start + 12 * k + 12]) for k in range(n_values)])
        out = np.array(values, float).reshape(-1, n_values)
        self.lines.require(np.isfinite(out).all(), "finite values in the block above", out[~np.isfinite(out)][:1])
        return np.array(numbers, np.int64), out

    def _element_block(self) -> None:
        while not (line := self.lines.take("the end of a block (-3)")).startswith(" -3"):
            words = line[3:].split()
            self.lines.require(line.startswith(" -1") and len(words) >= 2, "an element (-1)", f"'{line[:40]}'")
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
        modes = modes_by_diameter(((d, hertz, 1.0, nodes, shape) for (d, _, hertz), nodes, shape in shapes), self.source)
        return mesh_body(self.source, "a block of nodes (2C)", self.numbers, self.nodes, self.elements, modes=modes)

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
        elif blocks and blocks[-1][0][:2] == (diameter, mode):  # the imaginary part follows the real one
            key, numbers, real = blocks[-1]
            nodes, values = self._rows(head, n_values)
            check(np.array_equal(numbers, nodes), f"{self.source}: mode {mode}", f"nodes {numbers} in both parts", nodes)
            blocks[-1] = (key, numbers, real + 1j * values)
