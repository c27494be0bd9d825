r"""Input files of CalculiX and Abaqus: nodes, solid elements, sets, surfaces and elastic constants.

A file is flat, or an assembly of instances of parts.  An instance is a copy of the nodes, elements
and sets of its part, translated by t and then rotated by the matrix R about a point a:

.. math:: x' = a + R (x + t - a)

Nodes of different instances may have the same label.  Internally a node or an element has the code
``label + 2^30 k`` in instance k = 0, 1, ...; the codes of a flat file are the labels.

References
----------
G. Dhondt, *CalculiX CrunchiX User's Manual*, "Input deck format".
Dassault Systèmes, *Abaqus Keywords Reference Guide*, \*INSTANCE, \*SYSTEM, \*NODE, \*NGEN, \*NFILL
and \*ELGEN.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.fem.surface import FACES, N_CORNER, oriented_facet
from bdamper.importers.deck_keywords import Effect, effect_on_mesh
from bdamper.importers.fe_body import (
    LARGEST_COUNT,
    ElementKind,
    FEBody,
    Included,
    data_lines,
    mesh_body,
    parsing,
)
from bdamper.util.errors import check, check_sentence, mismatch
from bdamper.util.storage import FilePath

_SOLIDS = {"C3D4": 4, "C3D10": 10, "C3D6": 6, "C3D15": 15, "C3D8": 8, "C3D20": 20}
_BITS = 30
T = TypeVar("T")


def _plain(text: str) -> str:
    """Return a keyword or parameter name in capitals without blanks, because both programs ignore
    case and blanks.
    """
    return "".join(text.upper().split())


Rows = list[tuple[int, list[str]]]
"""Numbers of data lines, and their words between commas."""


@dataclass(frozen=True)
class _Transform:
    """Set of nodes with rotated axes (``*TRANSFORM``), and file and line for messages."""

    node_set: str
    item: str


@dataclass
class _Scope:
    """Content of a flat file, an assembly, a part or an instance, in which names are unique."""

    nodes: dict[int, NDArray] = field(default_factory=dict)
    element_of: dict[int, list[int]] = field(default_factory=dict)
    type_of: dict[int, str] = field(default_factory=dict)
    # nodes of the elements that are not solids, which only sets and surfaces name
    others: dict[int, list[int]] = field(default_factory=dict)
    sections: dict[str, str] = field(default_factory=dict)
    node_sets: dict[str, list[int]] = field(default_factory=dict)
    element_sets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, list[list[str]]] = field(default_factory=dict)
    node_surfaces: dict[str, list[str]] = field(default_factory=dict)
    transforms: list[_Transform] = field(default_factory=list)
    origin: NDArray = field(default_factory=lambda: np.zeros(3))
    axes: NDArray = field(default_factory=lambda: np.eye(3))


@dataclass
class _Block:
    """Keyword of a file with its parameters, and the data lines that follow."""

    line: int
    keyword: str
    parameters: dict[str, str]
    rows: Rows


class Deck:
    """Parser of an input file: blocks of a keyword with parameters, followed by data lines.

    Parameters
    ----------
    source : Path
    include_folder : path-like, optional
        Further folder from which files may be included.
    """

    def __init__(self, source: Path, include_folder: FilePath | None = None) -> None:
        self.source = source
        # the scope receives nodes, elements and sets: the model, or an open part or instance
        self.model = _Scope()
        self.scope = self.model
        self.parts: dict[str, _Scope] = {}
        self.instances: dict[str, int] = {}
        self.instance = ""
        self.motion = np.eye(3), np.zeros(3)
        self.materials: dict[str, dict[str, float]] = {}
        self.material = ""
        self.notes: list[str] = []
        # names of keywords, in their order
        self.passed_over: dict[str, None] = {}
        self.included = Included(include_folder)
        self._read(source)
        if self.passed_over:
            names = ", ".join(self.passed_over)
            self.notes.append(f"keywords of the deck that are not read: {names}")
        is_closed = self.scope is self.model
        check(is_closed, str(source), "*END PART or *END INSTANCE", "the end of the file")

    def _read(self, source: Path, depth: int = 0) -> None:
        """Read a file and the files that it includes."""
        text = source.read_text(encoding="utf-8", errors="replace")
        for block in self._blocks(text):
            item = f"{source}: {block.keyword} in line {block.line}"
            effect = effect_on_mesh(block.keyword, block.parameters, item)
            if effect is Effect.IN_MATRICES:
                self.notes.append(
                    f"{block.keyword} of the deck is not read: "
                    "its stiffness or mass must be in the matrices"
                )
            elif effect is Effect.UNKNOWN:
                self.passed_over[block.keyword] = None
            elif block.keyword == "*INCLUDE":
                name = block.parameters.get("INPUT", "")
                self._read(self.included.path(name, source, depth, item), depth + 1)
            else:
                self._block(block.keyword, block.parameters, block.rows, item)

    @staticmethod
    def _blocks(deck: str) -> Iterator[_Block]:
        """Iterate over the blocks of a file."""
        block = None
        keyword_line_continues = False
        for number, text in data_lines(deck, "**"):
            if block and keyword_line_continues:
                block.parameters.update(_parameters(text.split(",")))
                keyword_line_continues = text.endswith(",")
            elif text.startswith("*"):
                if block:
                    yield block
                keyword, *words = text.split(",")
                block = _Block(number, _plain(keyword), _parameters(words), [])
                keyword_line_continues = text.endswith(",")
            elif block:
                words = [word.strip() for word in text.replace('"', "").split(",")]
                block.rows.append((number, words))
        if block:
            yield block

    def _block(self, keyword: str, parameters: dict[str, str], rows: Rows, item: str) -> None:
        """Read the block of a keyword."""
        name = parameters.get("NAME", "").upper()
        if keyword == "*NODE":
            self._nodes(parameters, rows, item)
        elif keyword == "*ELEMENT":
            self._elements(parameters, rows, item)
        elif keyword in ("*NGEN", "*NFILL"):
            self._generate_nodes(keyword, parameters, rows)
        elif keyword == "*ELGEN":
            self._generate_elements(parameters, rows)
        elif keyword == "*SYSTEM":
            self._system(rows)
        elif keyword in ("*NSET", "*ELSET"):
            self._set(keyword, parameters, rows, item)
        elif keyword == "*SURFACE":
            self._surface(name, parameters, rows, item)
        elif keyword == "*TRANSFORM":
            node_set = parameters.get("NSET", "").upper()
            check(node_set in self.scope.node_sets, item, "NSET= with a set of the deck", node_set)
            self.scope.transforms.append(_Transform(node_set, item))
        elif keyword == "*PART":
            outside = bool(self.model.nodes) and not self.instances
            check(
                not outside,
                item,
                "either all nodes in parts or none",
                "nodes before the first part",
            )
            self.scope = self.parts[name] = _Scope()
        elif keyword == "*INSTANCE":
            self._begin_instance(name, parameters, rows, item)
        elif keyword in ("*ENDPART", "*ENDINSTANCE"):
            if self.instance:
                self._place()
            self.instance = ""
            self.scope = self.model
        elif keyword == "*MATERIAL":
            self.material = name
        elif keyword == "*ELASTIC" and rows:
            isotropic = parameters.get("TYPE", "ISO").upper().startswith("ISO")
            if isotropic:
                with self._parsing(rows[0], "Young's modulus, Poisson's ratio"):
                    young, poisson = map(float, rows[0][1][:2])  # of the lowest temperature
                    self._constants.update(youngs_modulus=young, poisson_ratio=poisson)
        elif keyword == "*DENSITY" and rows:
            with self._parsing(rows[0], "a density"):
                self._constants["density"] = float(rows[0][1][0])
        elif keyword == "*SOLIDSECTION":
            element_set = parameters.get("ELSET", "").upper()
            self.scope.sections[element_set] = parameters.get("MATERIAL", "").upper()

    def _surface(self, name: str, parameters: dict[str, str], rows: Rows, item: str) -> None:
        """Read a surface: nodes, or faces of elements or of sets of elements."""
        kind = parameters.get("TYPE", "ELEMENT").upper()
        check(kind in ("NODE", "ELEMENT"), item, "TYPE=NODE or TYPE=ELEMENT", f"TYPE={kind}")
        if kind == "NODE":
            self.scope.node_surfaces[name] = [words[0] for _, words in rows]
            return
        complete = all(len(words) > 1 for _, words in rows)
        expected = "an element or set and the label of a face in every line"
        check(complete, item, expected, "a different line")
        self.scope.surfaces[name] = [words[:2] for _, words in rows]

    def _begin_instance(self, name: str, parameters: dict[str, str], rows: Rows, item: str) -> None:
        """Begin an instance with a copy of its part, to which the deck may add nodes and sets."""
        part = parameters.get("PART", "").upper()
        check(part in self.parts, item, f"PART= out of {sorted(self.parts)}", f"'{part}'")
        is_new = name not in self.instances
        check(is_new, item, "a name that no other instance has", f"'{name}'")
        self.instance = name
        self.scope = deepcopy(self.parts[part])
        self.motion = self._motion(rows)
        # *SYSTEM of the part does not act on the instance
        self.scope.origin = _Scope().origin
        self.scope.axes = _Scope().axes

    # ---- Words of data lines ----

    @property
    def _constants(self) -> dict[str, float]:
        """Constants of the material that the deck defines at present."""
        return self.materials.setdefault(self.material, {})

    def _parsing(self, row: tuple[int, list[str]], expected: str) -> AbstractContextManager[None]:
        return parsing(f"{self.source}: line {row[0]}", expected, ", ".join(row[1]))

    def _integers(self, rows: Rows) -> list[int]:
        numbers: list[int] = []
        for row in rows:
            with self._parsing(row, "whole numbers"):
                numbers += [int(word) for word in row[1] if word]
        return numbers

    def _numbers(self, row: tuple[int, list[str]], *counts: int) -> NDArray:
        """Return the numbers of a line, as many as one of the counts; a blank word is 0."""
        words = row[1]
        with self._parsing(row, f"{' or '.join(map(str, counts))} numbers"):
            values = [float(word or 0.0) for word in words]
            # blank words at the end of a line are no numbers
            while len(values) not in counts and not words[len(values) - 1]:
                del values[-1]
            if len(values) not in counts or not np.isfinite(values).all():
                raise ValueError
        return np.array(values)

    def code(self, word: str) -> int | None:
        """Return the code of a node or element from its label, with ``instance.`` before it in an
        assembly.
        """
        instance, _, label = word.upper().rpartition(".")
        if not label.isdigit():
            return None
        if not instance:
            return int(label)
        if instance not in self.instances:
            return None
        return int(label) + (self.instances[instance] << _BITS)

    def _members(
        self,
        word: str,
        sets: dict[str, list[int]],
        item: str,
        prefix: str = "",
        what: str = "a number",
    ) -> list[int]:
        """Return the codes of the members of a set, or of one node or element."""
        name = prefix + word.upper()
        code = self.code(name)
        if code is None and name not in sets:
            raise mismatch(item, f"{what} or one of the sets {sorted(sets)}", f"'{word[:30]}'")
        return sets[name] if code is None else [code]

    # ---- Nodes and elements ----

    def _nodes(self, parameters: dict[str, str], rows: Rows, item: str) -> None:
        """Read nodes, in the coordinates of the last *SYSTEM."""
        outside = self.scope is self.model and bool(self.parts)
        expected = "nodes of parts: delete the reference points of the assembly"
        check(not outside, item, expected, "nodes outside of a part")
        system = parameters.get("SYSTEM", "R").upper()
        expected = "SYSTEM=R or SYSTEM=C (rectangular, cylindrical)"
        check(system in ("R", "C"), item, expected, f"SYSTEM={system}")
        added = []
        for row in rows:
            with self._parsing(row, "a node number and its position"):
                _, words = row
                number, *position = words
                n_words = len([word for word in words if word])
                if not position or n_words > 4:
                    raise ValueError
                node = int(number)
                added.append(node)
                # coordinates that are left out are 0
                coordinates = [*position, "", ""][:3]
                x = np.array([float(word or 0.0) for word in coordinates])
                if system == "C":
                    radius, degrees, _ = x
                    angle = np.radians(degrees)
                    x[:2] = radius * np.array([np.cos(angle), np.sin(angle)])
                # As in CalculiX, the last definition of a node is used.
                self.scope.nodes[node] = self.scope.origin + x @ self.scope.axes
        self._extend(self.scope.node_sets, parameters.get("NSET", ""), added)

    @staticmethod
    def _extend(sets: dict[str, list[int]], name: str, members: list[int]) -> None:
        if name:
            sets.setdefault(name.upper(), []).extend(members)

    def _system(self, rows: Rows) -> None:
        """Set the origin and the axes (rows) of the nodes that follow."""
        first = self._numbers(rows[0], 3, 6) if rows else np.zeros(3)
        origin = first[:3]
        self.scope.origin = origin
        self.scope.axes = np.eye(3)
        if len(first) != 6:
            return
        # the second point lies on the x axis, the third one in the x-y plane
        x = first[3:] - origin
        if len(rows) > 1:
            z = np.cross(x, self._numbers(rows[1], 3) - origin)
        else:
            z = np.array([0.0, 0.0, 1.0])
            x[2] = 0.0
        with self._parsing(rows[-1], "three points that are not on one line"):
            if not (np.linalg.norm(x) and np.linalg.norm(z)):
                raise ValueError
        x = x / np.linalg.norm(x)
        z = z / np.linalg.norm(z)
        self.scope.axes = np.array([x, np.cross(z, x), z])

    def _generate_nodes(self, keyword: str, parameters: dict[str, str], rows: Rows) -> None:
        """Add nodes at equal distances between two nodes (NGEN), or between the nodes of two sets
        (NFILL).
        """
        nodes = self.scope.nodes
        added: list[int] = []
        expected = f"{keyword} between two nodes or ascending sets of nodes, then whole numbers"
        for row in rows:
            with self._parsing(row, expected):
                first, last = row[1][:2]
                integers = [int(word) for word in row[1][2:] if word]
                if keyword == "*NGEN":
                    # the step between the node numbers may be omitted
                    (step,) = integers or [1]
                    start, end = int(first), int(last)
                    n_intervals, rest = divmod(end - start, step)
                    if rest:
                        raise ValueError
                    pairs = [(start, end)]
                else:
                    # the number of intervals, and the step between node numbers, by default 1
                    n_intervals, step = [*integers, 1][:2]
                    first_set = self.scope.node_sets[first.upper()]
                    last_set = self.scope.node_sets[last.upper()]
                    for members in (first_set, last_set):
                        if members != sorted(set(members)):
                            raise ValueError
                    pairs = list(zip(first_set, last_set, strict=True))
                if not 1 <= n_intervals <= LARGEST_COUNT // 100:
                    raise ValueError
                for node_a, node_b in pairs:
                    position = nodes[node_a]
                    distance = nodes[node_b] - position
                    between = range(node_a + step, node_a + n_intervals * step, step)
                    for k, number in enumerate(between, 1):
                        nodes[number] = position + k / n_intervals * distance
                    added += [node_a, *between, node_b]
        self._extend(self.scope.node_sets, parameters.get("NSET", ""), added)

    def _elements(self, parameters: dict[str, str], rows: Rows, item: str) -> None:
        """Read elements; elements other than solids are noted and skipped."""
        type_name = parameters.get("TYPE", "").upper()
        # R: reduced integration, I: incompatible modes, H: hybrid, M: modified
        plain = type_name.rstrip("RIHM")
        n_nodes = _SOLIDS.get(plain)
        if n_nodes is None:
            self.notes.append(
                f"elements of type {type_name or '(none)'} are not read: solid elements only"
            )
            self._other_elements(parameters.get("ELSET", ""), rows)
            return
        letter = ""
        for candidate in ("R", "I"):
            if not letter and candidate in type_name[len(plain) :]:
                letter = candidate
        numbers = self._integers(rows)
        expected = f"1 + {n_nodes} numbers for each element of type {type_name}"
        check(len(numbers) % (n_nodes + 1) == 0, item, expected, f"{len(numbers)} numbers")
        for start in range(0, len(numbers), n_nodes + 1):
            element, *nodes = numbers[start : start + n_nodes + 1]
            self.scope.element_of[element] = nodes
            self.scope.type_of[element] = plain + letter
            self.scope.others.pop(element, None)
        added = numbers[:: n_nodes + 1]
        self._extend(self.scope.element_sets, parameters.get("ELSET", ""), added)

    def _other_elements(self, element_set: str, rows: Rows) -> None:
        """Keep the nodes of elements other than solids, for sets that name these elements."""
        added: list[int] = []
        # the numbers of an assembly are codes of its first instance
        in_assembly = self.scope is self.model and bool(self.parts)
        continued = False
        for _, words in rows:
            codes = [] if in_assembly else [self.code(word) for word in words if word]
            known = [code for code in codes if code is not None]
            if continued and added:
                self.scope.others[added[-1]] += known
            elif known:
                added.append(known[0])
                self.scope.others[known[0]] = known[1:]
            # after a comma at its end a line is continued by the next line
            continued = not words[-1]
        if element_set:
            self._extend(self.scope.element_sets, element_set, added)

    def _generate_elements(self, parameters: dict[str, str], rows: Rows) -> None:
        """Copy elements along rows and layers, with increments of node and element numbers."""
        scope = self.scope
        added = []
        expected = (
            "*ELGEN of an element, with number, node and element increment of rows and layers"
        )
        for row in rows:
            with self._parsing(row, expected):
                first, *integers = self._integers([row])
                # number, node increment and element increment in each of three directions
                defaults = [1, 1, 1, 1, 0, 1, 1, 0, 1]
                integers += defaults[len(integers) :]
                if len(integers) != 9:
                    raise ValueError
                counts = integers[0::3]
                node_steps = integers[1::3]
                element_steps = integers[2::3]
                if min(counts) < 1 or np.prod(counts, dtype=float) > LARGEST_COUNT // 100:
                    raise ValueError
                for index in np.ndindex(*counts):
                    number = first + int(np.dot(index, element_steps))
                    shift = int(np.dot(index, node_steps))
                    added.append(number)
                    if first in scope.others:
                        scope.others[number] = [node + shift for node in scope.others[first]]
                        continue
                    scope.element_of[number] = [node + shift for node in scope.element_of[first]]
                    scope.type_of[number] = scope.type_of[first]
        self._extend(scope.element_sets, parameters.get("ELSET", ""), added)

    # ---- Sets ----

    def _set(self, keyword: str, parameters: dict[str, str], rows: Rows, item: str) -> None:
        """Read a set of nodes or elements; a set that exists is extended."""
        sets = self.scope.node_sets if keyword == "*NSET" else self.scope.element_sets
        name = parameters.get(keyword[1:], "")
        check(bool(name), item, "a name of the set", "none")
        prefix = ""
        shift = 0
        instance = parameters.get("INSTANCE", "").upper()
        if instance:
            expected = f"INSTANCE= out of {sorted(self.instances)}"
            check(instance in self.instances, item, expected, f"'{instance}'")
            prefix = f"{instance}."
            shift = self.instances[instance] << _BITS
        members = sets.setdefault(name.upper(), [])
        if keyword == "*NSET" and "ELSET" in parameters:
            of_elements = parameters["ELSET"]
            for element in self._members(of_elements, self.scope.element_sets, item, prefix):
                members += self._nodes_of(element)
        for row in rows:
            if "GENERATE" in parameters:
                members.extend(self._generated(row, shift))
                continue
            row_item = f"{self.source}: line {row[0]}"
            for word in row[1]:
                if word:
                    members += self._members(word.lstrip("+"), sets, row_item, prefix)

    def _nodes_of(self, element: int) -> list[int]:
        """Return the codes of the nodes of an element, of none if it does not exist."""
        if element in self.scope.element_of:
            return self.scope.element_of[element]
        return self.scope.others.get(element, [])

    def _generated(self, row: tuple[int, list[str]], shift: int) -> range:
        """Return the codes of a line of GENERATE: first, last and step, which is 1 by default."""
        numbers = self._integers([row])
        with self._parsing(row, "first, last and step"):
            if len(numbers) < 2:
                raise ValueError
            first, last, step = [*numbers, 1][:3]
            if step <= 0 or not 0 <= (last - first) // step <= LARGEST_COUNT // 100:
                raise ValueError
        return range(shift + first, shift + last + 1, step)

    # ---- Instances ----

    def _motion(self, rows: Rows) -> tuple[NDArray, NDArray]:
        """Return the rotation R (3, 3) and the displacement b (3,) of an instance, x' = R x + b."""
        shift = self._numbers(rows[0], 3) if rows else np.zeros(3)
        if len(rows) < 2:
            return np.eye(3), shift
        # two points on the axis of rotation, and an angle in degrees
        values = self._numbers(rows[1], 7)
        origin = values[:3]
        axis = values[3:6] - origin
        angle = np.radians(values[6])
        with self._parsing(rows[1], "two different points on the axis and an angle"):
            if len(rows) > 2 or not np.linalg.norm(axis):
                raise ValueError
        x, y, z = axis / np.linalg.norm(axis)
        # formula of Rodrigues
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        rotation = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
        return rotation, origin + rotation @ (shift - origin)

    def _place(self) -> None:
        """Add the instance to the model, with its name before the names of its sets."""
        name, instance, model = self.instance, self.scope, self.model
        largest = max([*instance.nodes, *instance.element_of, *instance.others], default=0)
        item = f"{self.source}: instance {name}"
        check(largest < 1 << _BITS, item, f"labels below {1 << _BITS}", largest)
        self.instances[name] = len(self.instances)
        shift = self.instances[name] << _BITS
        rotation, displacement = self.motion
        for label, position in instance.nodes.items():
            model.nodes[shift + label] = rotation @ position + displacement
        for label, nodes in instance.element_of.items():
            model.element_of[shift + label] = [shift + node for node in nodes]
        for label, type_name in instance.type_of.items():
            model.type_of[shift + label] = type_name
        for label, nodes in instance.others.items():
            model.others[shift + label] = [shift + node for node in nodes]
        for transform in instance.transforms:
            placed = replace(transform, node_set=f"{name}.{transform.node_set}")
            model.transforms.append(placed)
        for key, material in instance.sections.items():
            model.sections[f"{name}.{key}"] = material
        for key, members in instance.node_sets.items():
            model.node_sets[f"{name}.{key}"] = [shift + label for label in members]
        for key, members in instance.element_sets.items():
            model.element_sets[f"{name}.{key}"] = [shift + label for label in members]
        for key, faces in instance.surfaces.items():
            model.surfaces[f"{name}.{key}"] = [[f"{name}.{who}", face] for who, face in faces]
        for key, words in instance.node_surfaces.items():
            model.node_surfaces[f"{name}.{key}"] = [f"{name}.{word}" for word in words]

    # ---- Body ----

    def _only(self, instance: str) -> None:
        """Omit the other instances, and repeat the sets of this one without its name."""
        model = self.model
        wanted = self.instances[instance]
        elements = {}
        for element, nodes in model.element_of.items():
            if element >> _BITS == wanted:
                elements[element] = nodes
        model.element_of = elements
        for sets in (model.node_sets, model.element_sets):
            for name, members in sets.items():
                sets[name] = [code for code in members if code >> _BITS == wanted]
        _also_without(f"{instance}.", model.node_sets)
        _also_without(f"{instance}.", model.surfaces)
        _also_without(f"{instance}.", model.node_surfaces)
        surfaces = {}
        for name, faces in model.surfaces.items():
            kept = []
            for who, face in faces:
                code = self.code(who)
                # a set of elements has no code; its other members are already left out
                if not code or code >> _BITS == wanted:
                    kept.append([who, face])
            if kept:
                surfaces[name] = kept
        model.surfaces = surfaces

    def numbers(self, instance: str | None = None) -> dict[int, int]:
        """Return the node number of each code: the label, or with several instances 1, 2, ... in
        their order.

        Parameters
        ----------
        instance : str, optional
            Instance whose nodes are returned, with their labels.
        """
        if len(self.instances) < 2:
            return {code: code for code in self.model.nodes}
        if instance is None:
            return {code: k for k, code in enumerate(sorted(self.model.nodes), 1)}
        k = self.instances[instance]
        return {code: code - (k << _BITS) for code in self.model.nodes if code >> _BITS == k}

    def check_transforms(self, dofs: NDArray) -> None:
        """Raise ModelError if a node with rotated axes (``*TRANSFORM``) is fixed in some components
        only.

        Parameters
        ----------
        dofs : (n, 2) int
            Node number and component of each row of the matrices.
        """
        number_of_code = self.numbers()
        for transform in self.model.transforms:
            codes = self.model.node_sets[transform.node_set]
            of_set = np.unique([number_of_code[code] for code in codes if code in number_of_code])
            rows = dofs[np.isin(dofs[:, 0], of_set)]
            free, n_components = np.unique(rows[:, 0], return_counts=True)
            partly = free[n_components < 3]
            expected = (
                f"nodes of {transform.node_set} fixed in all three components or in none, because "
                "the axes are not read"
            )
            found = f"node {partly[:1]} fixed in some components"
            check(not len(partly), transform.item, expected, found)

    def body(self, instance: str | None = None) -> FEBody:
        """Return the body of the deck, or of one of its instances, without matrices."""
        wanted = self._wanted_instance(instance)
        self._note_transforms()
        number_of_code = self.numbers(wanted)
        if wanted is None:
            self._note_instances(number_of_code)
        else:
            self._only(wanted)
        node_sets = self._node_sets(number_of_code)
        if len(self.instances) > 1:
            self._check_nodes_of_parts(number_of_code)
        model = self.model
        elements = [
            [number_of_code.get(code, code) for code in nodes]
            for nodes in model.element_of.values()
        ]
        body = mesh_body(
            str(self.source),
            "*NODE with at least one node",
            list(number_of_code.values()),
            [model.nodes[code] for code in number_of_code],
            elements,
            self._kinds(),
            node_sets=node_sets,
        )
        face_sets = self._face_sets(body.nodes, number_of_code)
        # several blocks of one keyword give the same note
        notes = tuple(dict.fromkeys(self.notes))
        return replace(body, face_sets=face_sets, notes=notes)

    def _wanted_instance(self, instance: str | None) -> str | None:
        """Return the name of the instance to read, or None for the whole deck."""
        if instance is not None:
            name = instance.upper()
            expected = f"an instance out of {sorted(self.instances)}"
            check(name in self.instances, str(self.source), expected, f"'{instance}'")
            return name
        if len(self.instances) == 1:
            (only,) = self.instances
            return only
        return None

    def _note_transforms(self) -> None:
        """Add a note for each set of nodes with rotated axes."""
        for transform in self.model.transforms:
            self.notes.append(
                f"*TRANSFORM of {transform.node_set}: only supports of all three components "
                "are known without its axes, which are not read"
            )

    def _node_sets(self, number_of_code: dict[int, int]) -> dict[str, NDArray]:
        """Return the node numbers of each set that is not empty."""
        node_sets = {}
        for name, codes in self._sets_of_nodes().items():
            if len(self.instances) > 1:
                # a label that a part lacks is the number of another node of the assembly
                codes = [code for code in codes if code in number_of_code]
            if codes:
                numbers = [number_of_code.get(code, code) for code in codes]
                node_sets[name] = np.unique(np.array(numbers, np.int64))
        return node_sets

    def _note_instances(self, number_of_code: dict[int, int]) -> None:
        """Add a note with the node numbers of each instance."""
        for name, k in self.instances.items():
            numbers = [number for code, number in number_of_code.items() if code >> _BITS == k]
            if numbers:
                self.notes.append(
                    f"instance {name}: nodes {min(numbers)} to {max(numbers)}, "
                    "in the order of their labels"
                )

    def _sets_of_nodes(self) -> dict[str, list[int]]:
        """Return the codes of the nodes of each set and node surface, without repetitions."""
        sets = {}
        for name, members in self.model.node_sets.items():
            if members:
                sets[name] = list(dict.fromkeys(members))
        for name, words in self.model.node_surfaces.items():
            item = f"{self.source}: *SURFACE, NAME={name}"
            members = []
            for word in words:
                members += self._members(word, self.model.node_sets, item, what="a node")
            sets.setdefault(name, members)
        return sets

    def _kinds(self) -> list[ElementKind]:
        """Return type and material of each element."""
        constants_of_element = {}
        for name, material in self.model.sections.items():
            constants = self.materials.get(material, {})
            for element in self.model.element_sets.get(name, ()):
                constants_of_element[element] = constants
        kinds = []
        for element in self.model.element_of:
            constants = constants_of_element.get(element, {})
            kinds.append(ElementKind(self.model.type_of[element], **constants))
        return kinds

    def _check_nodes_of_parts(self, number_of_code: dict[int, int]) -> None:
        """Raise ModelError if an element has a node that its part does not define."""
        label = (1 << _BITS) - 1
        for element, nodes in self.model.element_of.items():
            absent = [code & label for code in nodes if code not in number_of_code]
            item = f"{self.source}: element {element & label}"
            found = f"node {absent[:1]}, which is not defined"
            check(not absent, item, "nodes of its part", found)

    def _face_sets(
        self, nodes: NDArray, number_of_code: dict[int, int]
    ) -> dict[str, tuple[NDArray, ...]]:
        """Return the node numbers of the faces of each surface, grouped by the number of nodes."""
        row_of_code = {code: row for row, code in enumerate(number_of_code)}
        numbers = np.array(list(number_of_code.values()))
        face_sets = {}
        for name, pairs in self.model.surfaces.items():
            item = f"{self.source}: *SURFACE, NAME={name}"
            facets: dict[int, list[NDArray]] = {}
            n_left_out = 0
            for who, face in pairs:
                for element in self._members(who, self.model.element_sets, item, what="an element"):
                    if element in self.model.others:
                        n_left_out += 1
                        continue
                    facet = self._facet(element, face, row_of_code, nodes, item)
                    facets.setdefault(len(facet), []).append(numbers[facet])
            if n_left_out:
                self.notes.append(
                    f"*SURFACE {name}: {n_left_out} faces of elements that are not read are omitted"
                )
            if facets:
                face_sets[name] = tuple(np.array(group) for group in facets.values())
        return face_sets

    def _facet(
        self, element: int, face: str, row_of_code: dict[int, int], nodes: NDArray, item: str
    ) -> NDArray:
        """Return the rows in ``nodes`` of the nodes of a face of an element, S1, S2 and so on."""
        exists = element in self.model.element_of
        check_sentence(exists, item, f"element {element} is not a solid element of this deck")
        codes = self.model.element_of[element]
        faces = FACES[N_CORNER[len(codes)]]
        labels = [f"S{k}" for k in range(1, len(faces) + 1)]
        label = face.upper()
        check(label in labels, item, f"faces S1 to {labels[-1]}", f"'{face[:30]}'")
        missing = [code for code in codes if code not in row_of_code]
        check(not missing, item, "elements with existing nodes", f"nodes {missing}")
        rows = np.array([row_of_code[code] for code in codes])
        corners = list(faces[labels.index(label)])
        return oriented_facet(rows[corners], rows, nodes)


def _also_without(prefix: str, named: dict[str, T]) -> None:
    """Add each name that starts with a prefix without it, unless this name exists."""
    for name in [name for name in named if name.startswith(prefix)]:
        named.setdefault(name.removeprefix(prefix), named[name])


def _parameters(words: list[str]) -> dict[str, str]:
    """Return the parameters of a keyword line by name, in capitals without blanks."""
    parameters = {}
    for word in words:
        if word.strip():
            name, _, value = word.partition("=")
            parameters[_plain(name)] = value.strip().strip('"')
    return parameters
