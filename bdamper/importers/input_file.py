r"""Input files of CalculiX and Abaqus: nodes, solid elements, sets, surfaces and elastic constants.

A file is flat, or an assembly of instances of parts.  An instance is a copy of the nodes, elements and sets of its part,
translated by t and then rotated by the matrix R about a point a:

.. math:: x' = a + R (x + t - a)

Nodes of different instances may have the same label.  Internally a node or an element has the code
``label + 2^30 k`` in instance k = 0, 1, ...; the codes of a flat file are the labels.

References
----------
G. Dhondt, *CalculiX CrunchiX User's Manual*, "Input deck format".
Dassault Systèmes, *Abaqus Keywords Reference Guide*, \*INSTANCE, \*SYSTEM, \*NODE, \*NGEN, \*NFILL and \*ELGEN.
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
from bdamper.importers.deck_keywords import adds_to_matrices
from bdamper.importers.fe_body import (
    LARGEST_COUNT,
    ElementKind,
    FEBody,
    Included,
    data_lines,
    mesh_body,
    parsing,
)
from bdamper.util.errors import check, mismatch

_SOLIDS = {"C3D4": 4, "C3D10": 10, "C3D6": 6, "C3D15": 15, "C3D8": 8, "C3D20": 20}
_BITS = 30
T = TypeVar("T")


def _plain(text: str) -> str:
    """Return a keyword or parameter name in capitals without blanks, since both programs ignore case and blanks."""
    return "".join(text.upper().split())


Rows = list[tuple[int, list[str]]]
"""Numbers of data lines, and their words between commas."""


@dataclass
class _Scope:
    """Content of a flat file, an assembly, a part or an instance, in which names are unique."""

    nodes: dict[int, NDArray] = field(default_factory=dict)
    element_of: dict[int, list[int]] = field(default_factory=dict)
    type_of: dict[int, str] = field(default_factory=dict)
    sections: dict[str, str] = field(default_factory=dict)
    node_sets: dict[str, list[int]] = field(default_factory=dict)
    element_sets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, list[list[str]]] = field(default_factory=dict)
    node_surfaces: dict[str, list[str]] = field(default_factory=dict)
    origin: NDArray = field(default_factory=lambda: np.zeros(3))
    axes: NDArray = field(default_factory=lambda: np.eye(3))


class Deck:
    """Parser of an input file: blocks of a keyword with parameters, followed by data lines.

    Parameters
    ----------
    source : Path
    """

    def __init__(self, source: Path) -> None:
        self.source = source
        self.model = self.scope = _Scope()
        self.parts: dict[str, _Scope] = {}
        self.instances: dict[str, int] = {}
        self.instance = ""
        self.motion = np.eye(3), np.zeros(3)
        self.materials: dict[str, dict[str, float]] = {}
        self.material = ""
        self.notes: list[str] = []
        self.included = Included()
        self._read(source)
        check(
            self.scope is self.model,
            str(source),
            "*END PART or *END INSTANCE",
            "the end of the file",
        )

    def _read(self, source: Path, depth: int = 0) -> None:
        """Read a file and the files that it includes."""
        for at, keyword, parameters, rows in self._blocks(
            source.read_text(encoding="utf-8", errors="replace")
        ):
            item = f"{source}: {keyword} in line {at}"
            if adds_to_matrices(keyword, parameters, item):
                self.notes.append(
                    f"{keyword} of the deck is not read: its stiffness or mass must be in the matrices"
                )
            elif keyword == "*INCLUDE":
                self._read(
                    self.included.path(parameters.get("INPUT", ""), source, depth, item), depth + 1
                )
            else:
                self._block(keyword, parameters, rows, item)

    @staticmethod
    def _blocks(deck: str) -> Iterator[tuple[int, str, dict[str, str], Rows]]:
        """Iterate over line number, keyword, parameters and data lines of each block."""
        block, head = None, ""
        for number, text in data_lines(deck, "**"):
            if head.endswith(",") and block:  # the keyword line continues
                head = text
                block[2].update(_parameters(text.split(",")))
            elif text.startswith("*"):
                if block:
                    yield block
                head, words = text, text.split(",")
                block = number, _plain(words[0]), _parameters(words[1:]), Rows()
            elif block:
                head = ""
                block[-1].append(
                    (number, [word.strip() for word in text.replace('"', "").split(",")])
                )
        if block:
            yield block

    def _block(self, keyword: str, parameters: dict[str, str], rows: Rows, item: str) -> None:
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
            kind = parameters.get("TYPE", "ELEMENT").upper()
            check(kind in ("NODE", "ELEMENT"), item, "TYPE=NODE or TYPE=ELEMENT", f"TYPE={kind}")
            if kind == "NODE":
                self.scope.node_surfaces[name] = [words[0] for _, words in rows]
            else:
                good = all(len(words) > 1 for _, words in rows)
                check(
                    good,
                    item,
                    "an element or set and the label of a face in every line",
                    "another line",
                )
                self.scope.surfaces[name] = [words[:2] for _, words in rows]
        elif keyword == "*PART":
            outside = bool(self.model.nodes) and not self.instances
            check(not outside, item, "all nodes in parts or none", "nodes before the first part")
            self.scope = self.parts[name] = _Scope()
        elif keyword == "*INSTANCE":
            part = parameters.get("PART", "").upper()
            check(part in self.parts, item, f"PART= out of {sorted(self.parts)}", f"'{part}'")
            check(
                name not in self.instances, item, "a name that no other instance has", f"'{name}'"
            )
            self.instance, self.scope, self.motion = (
                name,
                deepcopy(self.parts[part]),
                self._motion(rows),
            )
            self.scope.origin, self.scope.axes = _Scope().origin, _Scope().axes
        elif keyword in ("*ENDPART", "*ENDINSTANCE"):
            if self.instance:
                self._place()
            self.instance, self.scope = "", self.model
        elif keyword == "*MATERIAL":
            self.material = name
        elif (
            keyword == "*ELASTIC"
            and rows
            and parameters.get("TYPE", "ISO").upper().startswith("ISO")
        ):
            with self._parsing(rows[0], "Young's modulus, Poisson's ratio"):
                young, poisson = map(float, rows[0][1][:2])  # of the lowest temperature
                self._constants.update(youngs_modulus=young, poisson_ratio=poisson)
        elif keyword == "*DENSITY" and rows:
            with self._parsing(rows[0], "a density"):
                self._constants["density"] = float(rows[0][1][0])
        elif keyword == "*SOLIDSECTION":
            self.scope.sections[parameters.get("ELSET", "").upper()] = parameters.get(
                "MATERIAL", ""
            ).upper()

    # ---- Words of data lines ----

    @property
    def _constants(self) -> dict[str, float]:
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
        with self._parsing(row, f"{' or '.join(map(str, counts))} numbers"):
            values = [float(word or 0.0) for word in row[1]]
            while (
                len(values) not in counts and not row[1][len(values) - 1]
            ):  # blank words at the end of a line
                del values[-1]
            if len(values) not in counts or not np.isfinite(values).all():
                raise ValueError
        return np.array(values)

    def code(self, word: str) -> int | None:
        """Return the code of a node or element from its label, with ``instance.`` before it in an assembly."""
        instance, _, label = word.upper().rpartition(".")
        if not label.isdigit() or (instance and instance not in self.instances):
            return None
        return int(label) + (self.instances[instance] << _BITS if instance else 0)

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
            raise mismatch(item, f"{what} or a set out of {sorted(sets)}", f"'{word[:30]}'")
        return sets[name] if code is None else [code]

    # ---- Nodes and elements ----

    def _nodes(self, parameters: dict[str, str], rows: Rows, item: str) -> None:
        cure = "nodes of parts: delete the reference points of the assembly"
        check(self.scope is not self.model or not self.parts, item, cure, "nodes outside of a part")
        system = parameters.get("SYSTEM", "R").upper()
        check(
            system in ("R", "C"),
            item,
            "SYSTEM=R or SYSTEM=C (rectangular, cylindrical)",
            f"SYSTEM={system}",
        )
        added = []
        for row in rows:
            with self._parsing(row, "a node number and its position"):
                number, *position = row[1]
                if not position or len([word for word in row[1] if word]) > 4:
                    raise ValueError
                added.append(int(number))
                x = np.array([float(word or 0.0) for word in [*position, "", ""][:3]])
                if system == "C":
                    x[:2] = x[0] * np.array([np.cos(np.radians(x[1])), np.sin(np.radians(x[1]))])
                # As in CalculiX, the last definition of a node is used.
                self.scope.nodes[added[-1]] = self.scope.origin + x @ self.scope.axes
        self._extend(self.scope.node_sets, parameters.get("NSET", ""), added)

    @staticmethod
    def _extend(sets: dict[str, list[int]], name: str, members: list[int]) -> None:
        if name:
            sets.setdefault(name.upper(), []).extend(members)

    def _system(self, rows: Rows) -> None:
        """Set the origin and the axes (rows) of the nodes that follow."""
        first = self._numbers(rows[0], 3, 6) if rows else np.zeros(3)
        self.scope.origin, self.scope.axes = first[:3], np.eye(3)
        if len(first) == 6:
            x, z = first[3:] - first[:3], np.array([0.0, 0.0, 1.0])
            if len(rows) > 1:
                z = np.cross(x, self._numbers(rows[1], 3) - first[:3])
            else:
                x[2] = 0.0
            with self._parsing(rows[-1], "three points that are not on one line"):
                if not (np.linalg.norm(x) and np.linalg.norm(z)):
                    raise ValueError
            x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
            self.scope.axes = np.array([x, np.cross(z, x), z])

    def _generate_nodes(self, keyword: str, parameters: dict[str, str], rows: Rows) -> None:
        """Add nodes at equal distances between two nodes (NGEN), or between the nodes of two sets (NFILL)."""
        nodes, added = self.scope.nodes, list[int]()
        for row in rows:
            with self._parsing(
                row, f"{keyword} between two nodes or ascending sets of nodes, then whole numbers"
            ):
                first, last = row[1][:2]
                more = [int(word) for word in row[1][2:] if word]
                if keyword == "*NGEN":
                    (step,) = more or [1]
                    pairs = [(int(first), int(last))]
                    n, rest = divmod(pairs[0][1] - pairs[0][0], step)
                else:
                    n, step = [*more, 1][:2]
                    ends = [self.scope.node_sets[name.upper()] for name in (first, last)]
                    pairs = list(zip(*ends, strict=True))
                    rest = any(members != sorted(set(members)) for members in ends)
                if rest or not 1 <= n <= LARGEST_COUNT // 100:
                    raise ValueError
                for a, b in pairs:
                    start, way = nodes[a], nodes[b] - nodes[a]
                    between = range(a + step, a + n * step, step)
                    nodes |= {number: start + k / n * way for k, number in enumerate(between, 1)}
                    added += [a, *between, b]
        self._extend(self.scope.node_sets, parameters.get("NSET", ""), added)

    def _elements(self, parameters: dict[str, str], rows: Rows, item: str) -> None:
        kind = parameters.get("TYPE", "").upper()
        plain = kind.rstrip("RIHM")
        n = _SOLIDS.get(plain)
        if n is None:
            self.notes.append(
                f"elements of type {kind or '(none)'} are not read: solid elements only"
            )
            return
        words = self._integers(rows)
        expected = f"1 + {n} numbers for each element of type {kind}"
        check(len(words) % (n + 1) == 0, item, expected, f"{len(words)} numbers")
        for k in range(0, len(words), n + 1):
            self.scope.element_of[words[k]] = words[k + 1 : k + n + 1]
            letter = next((letter for letter in "RI" if letter in kind[len(plain) :]), "")
            self.scope.type_of[words[k]] = plain + letter
        self._extend(self.scope.element_sets, parameters.get("ELSET", ""), words[:: n + 1])

    def _generate_elements(self, parameters: dict[str, str], rows: Rows) -> None:
        """Copy elements along rows and layers, with increments of node and element numbers."""
        added, scope = [], self.scope
        for row in rows:
            with self._parsing(
                row,
                "*ELGEN of an element, with number, node and element increment of rows and layers",
            ):
                first, *more = self._integers([row])
                more += [1, 1, 1, 1, 0, 1, 1, 0, 1][len(more) :]
                counts, shifts, steps = more[0::3], more[1::3], more[2::3]
                if (
                    len(more) != 9
                    or min(counts) < 1
                    or np.prod(counts, dtype=float) > LARGEST_COUNT // 100
                ):
                    raise ValueError
                for index in np.ndindex(*counts):
                    number = first + int(np.dot(index, steps))
                    moved = int(np.dot(index, shifts))
                    scope.element_of[number] = [node + moved for node in scope.element_of[first]]
                    scope.type_of[number] = scope.type_of[first]
                    added.append(number)
        self._extend(scope.element_sets, parameters.get("ELSET", ""), added)

    # ---- Sets ----

    def _set(self, keyword: str, parameters: dict[str, str], rows: Rows, item: str) -> None:
        sets = self.scope.node_sets if keyword == "*NSET" else self.scope.element_sets
        name, prefix = parameters.get(keyword[1:], ""), ""
        check(bool(name), item, "a name of the set", "none")
        if instance := parameters.get("INSTANCE", "").upper():
            check(
                instance in self.instances,
                item,
                f"INSTANCE= out of {sorted(self.instances)}",
                f"'{instance}'",
            )
            prefix = f"{instance}."
        members = sets.setdefault(name.upper(), [])
        if keyword == "*NSET" and "ELSET" in parameters:
            for element in self._members(
                parameters["ELSET"], self.scope.element_sets, item, prefix
            ):
                members += self.scope.element_of.get(element, [])
        for row in rows:
            if "GENERATE" in parameters:
                first, *more = self._integers([row]) or [0]
                last, step = [*more, 1][:2] if more else (0, 0)
                with self._parsing(row, "first, last and step"):
                    if not (step > 0 and 0 <= (last - first) // step <= LARGEST_COUNT // 100):
                        raise ValueError
                shift = self.instances[instance] << _BITS if instance else 0
                members.extend(range(shift + first, shift + last + 1, step))
                continue
            for word in filter(None, row[1]):
                members += self._members(
                    word.lstrip("+"), sets, f"{self.source}: line {row[0]}", prefix
                )

    # ---- Instances ----

    def _motion(self, rows: Rows) -> tuple[NDArray, NDArray]:
        """Return the rotation R (3, 3) and the displacement b (3,) of an instance, x' = R x + b."""
        shift = self._numbers(rows[0], 3) if rows else np.zeros(3)
        if len(rows) < 2:
            return np.eye(3), shift
        values = self._numbers(rows[1], 7)
        a, axis, angle = values[:3], values[3:6] - values[:3], np.radians(values[6])
        with self._parsing(rows[1], "two different points on the axis and an angle"):
            if len(rows) > 2 or not np.linalg.norm(axis):
                raise ValueError
        x, y, z = axis / np.linalg.norm(axis)
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        rotation = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
        return rotation, a + rotation @ (shift - a)

    def _place(self) -> None:
        """Add the instance to the model, with its name before the names of its sets."""
        name, own, model = self.instance, self.scope, self.model
        largest = max([*own.nodes, *own.element_of], default=0)
        check(
            largest < 1 << _BITS,
            f"{self.source}: instance {name}",
            f"labels below {1 << _BITS}",
            largest,
        )
        self.instances[name] = len(self.instances)
        shift, (rotation, moved) = self.instances[name] << _BITS, self.motion
        model.nodes |= {shift + k: rotation @ x + moved for k, x in own.nodes.items()}
        model.element_of |= {
            shift + k: [shift + n for n in nodes] for k, nodes in own.element_of.items()
        }
        model.type_of |= {shift + k: kind for k, kind in own.type_of.items()}
        model.sections |= {f"{name}.{key}": material for key, material in own.sections.items()}
        for sets, theirs in (
            (model.node_sets, own.node_sets),
            (model.element_sets, own.element_sets),
        ):
            sets |= {
                f"{name}.{key}": [shift + k for k in members] for key, members in theirs.items()
            }
        for key, faces in own.surfaces.items():
            model.surfaces[f"{name}.{key}"] = [[f"{name}.{who}", label] for who, label in faces]
        for key, words in own.node_surfaces.items():
            model.node_surfaces[f"{name}.{key}"] = [f"{name}.{word}" for word in words]

    # ---- Body ----

    def _only(self, instance: str) -> None:
        """Omit the other instances, and repeat the sets of this one without its name."""
        model, k = self.model, self.instances[instance]
        model.element_of = {e: nodes for e, nodes in model.element_of.items() if e >> _BITS == k}
        for sets in (model.node_sets, model.element_sets):
            sets |= {
                name: [code for code in members if code >> _BITS == k]
                for name, members in sets.items()
            }
        _also_without(f"{instance}.", model.node_sets)
        _also_without(f"{instance}.", model.surfaces)
        _also_without(f"{instance}.", model.node_surfaces)
        model.surfaces = {
            name: kept
            for name, faces in model.surfaces.items()
            if (
                kept := [
                    [who, label]
                    for who, label in faces
                    if (self.code(who) or k << _BITS) >> _BITS == k
                ]
            )
        }

    def numbers(self, instance: str | None = None) -> dict[int, int]:
        """Return the node number of each code: the label, or with several instances 1, 2, ... in their order.

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

    def body(self, instance: str | None = None) -> FEBody:
        """Return the body of the deck, or of one of its instances, without matrices."""
        if instance is not None:
            expected = f"an instance out of {sorted(self.instances)}"
            check(instance.upper() in self.instances, str(self.source), expected, f"'{instance}'")
            instance = instance.upper()
        elif len(self.instances) == 1:
            (instance,) = self.instances
        model, number, notes = self.model, self.numbers(instance), self.notes
        if instance is None:
            for name, k in self.instances.items():
                own = [n for code, n in number.items() if code >> _BITS == k]
                if own:
                    notes.append(
                        f"instance {name}: nodes {min(own)} to {max(own)}, in the order of their labels"
                    )
        else:
            self._only(instance)
        sets = {
            name: list(dict.fromkeys(members))
            for name, members in model.node_sets.items()
            if members
        }
        for name, words in model.node_surfaces.items():
            item = f"{self.source}: *SURFACE, NAME={name}"
            members = [
                code
                for word in words
                for code in self._members(word, model.node_sets, item, what="a node")
            ]
            sets.setdefault(name, members)
        constants = {
            element: self.materials.get(material, {})
            for name, material in model.sections.items()
            for element in model.element_sets.get(name, ())
        }
        kinds = [
            ElementKind(model.type_of[element], **constants.get(element, {}))
            for element in model.element_of
        ]
        if (
            len(self.instances) > 1
        ):  # a label that a part lacks is the number of another node of the assembly
            sets = {
                name: [code for code in members if code in number] for name, members in sets.items()
            }
            for element, nodes in model.element_of.items():
                absent = [code & ((1 << _BITS) - 1) for code in nodes if code not in number]
                where = f"{self.source}: element {element & ((1 << _BITS) - 1)}"
                check(
                    not absent,
                    where,
                    "nodes of its part",
                    f"node {absent[:1]}, which is not defined",
                )
        node_sets = {
            name: np.unique(np.array([number.get(code, code) for code in members], np.int64))
            for name, members in sets.items()
            if members
        }
        body = mesh_body(
            str(self.source), "*NODE with at least one node", list(number.values()), [model.nodes[code] for code in number],
            [[number.get(code, code) for code in nodes] for nodes in model.element_of.values()], kinds,
            node_sets=node_sets, notes=tuple(dict.fromkeys(notes)),
        )  # fmt: skip
        return replace(body, face_sets=self._face_sets(body.nodes, number))

    def _face_sets(self, nodes: NDArray, number: dict[int, int]) -> dict[str, tuple[NDArray, ...]]:
        index, numbers = {code: k for k, code in enumerate(number)}, np.array(list(number.values()))
        model, out = self.model, {}
        for name, pairs in model.surfaces.items():
            item = f"{self.source}: *SURFACE, NAME={name}"
            facets: dict[int, list[NDArray]] = {}
            for who, label in pairs:
                for element in self._members(who, model.element_sets, item, what="an element"):
                    check(
                        element in model.element_of,
                        item,
                        "solid elements of this deck",
                        f"element {element}",
                    )
                    connected = model.element_of[element]
                    faces = FACES[N_CORNER[len(connected)]]
                    labels = [f"S{k}" for k in range(1, len(faces) + 1)]
                    check(
                        label.upper() in labels,
                        item,
                        f"faces S1 to {labels[-1]}",
                        f"'{label[:30]}'",
                    )
                    missing = [n for n in connected if n not in index]
                    check(not missing, item, "elements with existing nodes", f"nodes {missing}")
                    rows = np.array([index[n] for n in connected])
                    facet = oriented_facet(
                        rows[list(faces[labels.index(label.upper())])], rows, nodes
                    )
                    facets.setdefault(len(facet), []).append(numbers[facet])
            if facets:
                out[name] = tuple(np.array(f) for f in facets.values())
        return out


def _also_without(prefix: str, named: dict[str, T]) -> None:
    """Add each name that starts with a prefix without it, unless this name exists."""
    for name in [name for name in named if name.startswith(prefix)]:
        named.setdefault(name.removeprefix(prefix), named[name])


def _parameters(words: list[str]) -> dict[str, str]:
    pairs = (word.partition("=")[::2] for word in words if word.strip())
    return {_plain(key): value.strip().strip('"') for key, value in pairs}
