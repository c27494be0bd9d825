"""A sector and a damper of a user's own: input decks for CalculiX in any units, axes and elements, and their import."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from bdamper.fem import Geometry, MeshDensity, SectorFE
from bdamper.fem.meshes import Discretisation, local_order, turn
from bdamper.importers import ContactFaces, FEBody, read_calculix
from bdamper.importers.abaqus import read_frd_stress
from bdamper.importers.fe_body import UNITS
from examples.calculix.decks import blade_sets, damper_sets, run_job

EDGES = {
    4: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
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
"""Pairs of corners with a node between them, in the order of CalculiX and Abaqus."""
OUTPUT = ["*NODE FILE", "U", "*EL FILE", "S", "*END STEP"]
_HEXAHEDRON = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
_TETRAHEDRA = [(0, a, b, 6) for a, b in ((1, 2), (2, 3), (3, 7), (7, 4), (4, 5), (5, 1))]
_WEDGES = [(0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)]


def n_nodes(kind: str) -> int:
    """Nodes of an element "C3D20R"."""
    return int("".join(letter for letter in kind[3:] if letter.isdigit()))


def of_kind(kind: str, nodes: np.ndarray, hexahedra: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and elements of a type on the corners of hexahedra (n, 8), all split alike."""
    n = n_nodes(kind)
    parts = {4: _TETRAHEDRA, 10: _TETRAHEDRA, 6: _WEDGES, 15: _WEDGES}.get(n)
    corners = hexahedra if parts is None else np.concatenate([hexahedra[:, part] for part in parts])
    if n in (4, 6, 8):
        return nodes, corners
    pairs = np.sort(
        np.stack([corners[:, edge] for edge in EDGES[corners.shape[1]]], axis=1), axis=2
    )
    unique, index = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    between = len(nodes) + index.reshape(len(corners), -1)
    return np.vstack([nodes, nodes[unique].mean(axis=1)]), np.hstack([corners, between])


def deck(
    kind: str,
    nodes: np.ndarray,
    elements: np.ndarray,
    young: float,
    nu: float,
    density: float,
    sets=(),
) -> str:
    """Nodes, elements, material and node sets as text; numbers start at 1."""
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{k}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in enumerate(nodes, 1)]
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET=BODY")
    lines += _element_lines(elements)
    lines += [
        "*MATERIAL, NAME=STEEL",
        "*ELASTIC",
        f"{young:.12e}, {nu}",
        "*DENSITY",
        f"{density:.12e}",
    ]
    lines += ["*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL"]
    for name, members in dict(sets).items():
        lines += [f"*NSET, NSET={name}", *(f"{n + 1}," for n in members)]
    return "\n".join(lines)


def _element_lines(elements: np.ndarray, before: int = 0) -> list[str]:
    lines = []
    for k, element in enumerate((elements + 1).tolist(), before + 1):
        words = [str(k), *map(str, element)]
        lines += [
            ", ".join(words[i : i + 11]) + ("," if len(words) > i + 11 else "")
            for i in range(0, len(words), 11)
        ]
    return lines


def _surface(elements: np.ndarray, nodes: np.ndarray) -> list[str]:
    """Faces of elements (tetrahedra or hexahedra) all of whose corners are among nodes."""
    n_corner = {4: 4, 10: 4}.get(elements.shape[1], 8)
    faces = {4: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))}.get(n_corner, _HEXAHEDRON)
    inside = np.isin(elements[:, :n_corner], nodes)
    return [
        f"{e + 1}, S{k}"
        for k, face in enumerate(faces, 1)
        for e in np.flatnonzero(inside[:, face].all(axis=1))
    ]


@dataclass
class OwnSector:
    """Decks of a sector of :mod:`bdamper.fem` in the units and axes of a file.

    Parameters
    ----------
    kind : str
        Type of all elements.
    units : str
    axis, radial : (3,) float
        In the axes of the file; the damper stands toward ``radial x axis`` of its blade, or with ``flank`` -1 beside it.
    flank : {1, -1}
    between : int
        Sectors further, of where the damper is drawn.
    """

    kind: str = "C3D20R"
    units: str = "mm-t-s"
    axis: tuple[float, ...] = (1.0, 0.0, 0.0)
    radial: tuple[float, ...] = (0.0, 1.0, 0.0)
    flank: int = 1
    density: MeshDensity = field(
        default_factory=lambda: MeshDensity(2, 1, 1, 2, 2, 2, 1, 6, 2, 1, 1, 4)
    )
    geometry: Geometry = field(
        default_factory=lambda: Geometry(
            36,
            bore_radius=0.15,
            rim_radius=0.205,
            ridge_radius=0.2445,
            airfoil_height=0.1,
            twist=0.3,
        )
    )

    @cached_property
    def fe(self) -> SectorFE:
        return SectorFE(self.geometry, self.density)

    @property
    def axes(self) -> np.ndarray:
        """(3, 3) columns: axes of the model in those of the file."""
        return np.array([np.cross(self.radial, self.axis), self.radial, self.axis]).T

    def mesh(self, body: Discretisation, sets: dict[str, np.ndarray], turned: float = 0.0):
        """Nodes in the axes and units of the file, elements, and the sets on them, of a body turned about the axis."""
        corners = body.elements[:, local_order()][:, :8]
        used, compact = np.unique(corners, return_inverse=True)
        corners = compact.reshape(corners.shape)
        nodes, elements = of_kind(self.kind, body.nodes[used], corners)
        planes = {
            name: _with_middles(np.flatnonzero(np.isin(used, members)), elements, len(nodes))
            for name, members in sets.items()
        }
        out = nodes @ turn(turned).T @ self.axes.T / UNITS[self.units].length
        return out, _right_handed(elements, out), planes

    def text(self, name: str) -> tuple[str, dict[str, np.ndarray], np.ndarray]:
        """Deck of "sector" or "damper", its sets and its nodes in the file."""
        u, m = UNITS[self.units], self.fe.material
        if name == "sector":
            sets = blade_sets(self.fe)
            nodes, elements, planes = self.mesh(self.fe.blade, sets)
            height = nodes @ np.array(self.radial) * u.length
            planes["BLADE"] = np.flatnonzero(height > self.geometry.rim_radius - 1e-9)
            planes["BLADE"] = np.setdiff1d(
                planes["BLADE"], np.concatenate([planes["LOW"], planes["HIGH"]])
            )
            root = self.geometry.ridge_radius + self.geometry.platform_edge_thickness
            levels = np.unique(np.round(height[height > root + 1e-3], 6))
            planes["FILLET"] = np.flatnonzero(np.abs(height - levels[0]) < 2e-6)
        else:
            back = 0.0 if self.flank == 1 else -self.geometry.pitch
            nodes, elements, planes = self.mesh(self.fe.damper.body, damper_sets(self.fe), back)
        scale = (
            u.length / u.mass,
            u.length**3 / u.mass,
        )  # stress is mass over length and second squared
        text = deck(
            self.kind,
            nodes,
            elements,
            m.youngs_modulus * scale[0],
            m.poisson_ratio,
            m.density * scale[1],
            planes,
        )
        return text, planes, nodes

    def steps_of_modes(self, nodal_diameter: int, n_modes: int) -> list[str]:
        """A step for modes of one nodal diameter, each of which comes twice, with their stress."""
        select = f"*SELECT CYCLIC SYMMETRY MODES, NMIN={nodal_diameter}, NMAX={nodal_diameter}"
        return ["*STEP", "*FREQUENCY", f"{2 * n_modes},", select, *OUTPUT]

    def cyclic(self, steps: list[str], bonded: bool = False) -> str:
        """The sector with its faces tied, and with its damper bonded to both blades, and steps."""
        text, sets, nodes = self.text("sector")
        elements = self.mesh(self.fe.blade, blade_sets(self.fe))[1]
        lines, first, near = (
            [text, "*BOUNDARY", "BORE, 1, 3"],
            len(nodes),
            1e-3 / UNITS[self.units].length,
        )
        dependent, independent = [np.setdiff1d(sets["HIGH"], sets["BORE"])], ["LOW"]
        if bonded:
            own, solids, faces = self.mesh(self.fe.damper.body, damper_sets(self.fe))
            lines += [
                "*NODE",
                *(
                    f"{k}, {x:.12e}, {y:.12e}, {z:.12e}"
                    for k, (x, y, z) in enumerate(own, first + 1)
                ),
            ]
            lines += [
                f"*ELEMENT, TYPE={self.kind}, ELSET=DAMPER",
                *_element_lines(solids + first, len(elements)),
            ]
            lines += ["*SOLID SECTION, ELSET=DAMPER, MATERIAL=STEEL"]
            lines += [
                "*SURFACE, NAME=LEFT, TYPE=NODE",
                *(f"{n + 1 + first}," for n in faces["LEFT"]),
            ]
            lines += ["*SURFACE, NAME=UNDER", *_surface(elements, sets["RIGHT_UNDERSIDE"])]
            lines += [f"*TIE, NAME=BOND, POSITION TOLERANCE={near:g}, ADJUST=NO", "LEFT, UNDER"]
            dependent.append(faces["RIGHT"] + first)
            independent.append("LEFT_UNDERSIDE")  # underside of the next blade
        lines += [
            "*SURFACE, NAME=DEPENDENT, TYPE=NODE",
            *(f"{n + 1}," for n in np.concatenate(dependent)),
        ]
        lines += [
            "*SURFACE, NAME=INDEPENDENT",
            *(line for name in independent for line in _surface(elements, sets[name])),
        ]
        lines += [
            f"*TIE, NAME=CYCLE, CYCLIC SYMMETRY, POSITION TOLERANCE={near:g}",
            "DEPENDENT, INDEPENDENT",
        ]
        lines += [f"*CYCLIC SYMMETRY MODEL, N={self.geometry.n_blades}, NGRAPH=1, TIE=CYCLE"]
        return "\n".join([*lines, "0., 0., 0., " + ", ".join(map(str, self.axis)), *steps, ""])

    def write_and_run(self, folder: Path) -> None:
        """Both decks with stored matrices, in ``folder``."""
        for name in ("sector", "damper"):
            held = ["*BOUNDARY", "BORE, 1, 3"] if name == "sector" else []
            steps = ["*STEP", "*FREQUENCY, SOLVER=MATRIXSTORAGE", "6,", "*END STEP", ""]
            run_job("\n".join([self.text(name)[0], *held, *steps]), folder, name)

    def read(self, folder: Path) -> tuple[FEBody, FEBody]:
        """Sector and damper."""
        return read_calculix(folder / "sector"), read_calculix(folder / "damper")

    def stress_of(self, path: Path, k: int = 0, name: str = "FILLET") -> np.ndarray:
        """Stress (n, 6), Pa, of step or mode ``k`` of a result file at a set of the sector, in the axes of the model."""
        numbers, stress = read_frd_stress(path)[k]
        found = stress[np.searchsorted(numbers, self.text("sector")[1][name] + 1)]
        full = np.empty((len(found), 3, 3), found.dtype)
        for c, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))):
            full[:, i, j] = full[:, j, i] = found[:, c]
        turned = (
            np.einsum("ai,nab,bj->nij", self.axes, full, self.axes)
            * UNITS[self.units].mass
            / UNITS[self.units].length
        )
        return turned[:, [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]

    @property
    def settings(self) -> dict:
        """Of :func:`bdamper.importers.build_model`, as a user would give them."""
        tip = np.array(
            [0.0, self.geometry.ridge_radius + self.geometry.platform_edge_thickness, 0.0]
        )
        tip[1] += self.geometry.airfoil_height
        return {
            "n_blades": self.geometry.n_blades, "faces": ("LOW", "HIGH"), "units": self.units, "axis": self.axis,
            "radial": self.radial, "locations": {"tip": tuple(self.axes @ tip / UNITS[self.units].length)},
            "contacts": [
                ContactFaces("left", "LEFT", "RIGHT_UNDERSIDE", points=(2, 3)),
                ContactFaces("right", "RIGHT", "LEFT_UNDERSIDE", points=(2, 3)),
            ],
        }  # fmt: skip


def _with_middles(corners: np.ndarray, elements: np.ndarray, n: int) -> np.ndarray:
    """Corner nodes of a face and the nodes between two of them; ``n`` nodes in all."""
    inside = np.zeros(n, bool)
    inside[corners] = True
    n_corner = {10: 4, 15: 6, 20: 8}.get(elements.shape[1])
    if n_corner is not None:
        both = inside[elements[:, np.array(EDGES[n_corner])]].all(axis=2)
        inside[elements[:, n_corner:][both]] = True
    return np.flatnonzero(inside)


def _right_handed(elements: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """The elements, turned over where CalculiX would find a negative volume."""
    n = elements.shape[1]
    corners = {4: 4, 10: 4, 6: 6, 15: 6, 8: 8, 20: 8}[n]
    x = nodes[elements[0]]
    second = {4: (1, 2, 3), 6: (1, 2, 3), 8: (1, 3, 4)}[corners]
    if np.linalg.det([x[k] - x[0] for k in second]) > 0.0:
        return elements
    turned = {4: [0, 2, 1, 3], 6: [0, 2, 1, 3, 5, 4], 8: [0, 3, 2, 1, 4, 7, 6, 5]}[corners]
    if n == corners:
        return elements[:, turned]
    edges = [frozenset(edge) for edge in EDGES[corners]]
    between = [corners + edges.index(frozenset((turned[a], turned[b]))) for a, b in EDGES[corners]]
    return elements[:, [*turned, *between]]
