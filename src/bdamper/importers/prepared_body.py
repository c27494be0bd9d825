r"""From the numbers of another program to a body in SI units and in the axes of a model, with checks.

Positions become :math:`x' = s Q (x - x_0)` with the rows of Q the axes X, Y, Z of a model (Z the axis of rotation, Y the
blade, X = Y x Z) in the axes of the file and s the unit of length; matrices become :math:`Q_n K Q_n^T` with a block of
``Q`` for each node (times the axes of the node, if it has axes of its own).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Annotated, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bdamper.fem.reduced_bodies import PICTURED_MODES
from bdamper.fem.sector_faces import SectorFaces
from bdamper.fem.surface import Facets, Structure, boundary_facets, facets_on_nodes
from bdamper.importers.arrays import square_matrix
from bdamper.importers.fe_body import BOUNDS, UNITS, FEBody, Units, parsing
from bdamper.model.fields import check
from bdamper.util import validation
from bdamper.util.errors import ModelError, mismatch, warn

FaceSet = str | NDArray | tuple[NDArray, ...]
NodeSet = str | NDArray | list[int]


def _units(name: str, given: object) -> Units:
    """Units, or a system of them by its name."""
    return given if isinstance(given, Units) else UNITS[validation.choice(f"{name} (or Units(...))", given, sorted(UNITS))]


Direction = Annotated[Any, partial(validation.numbers, n=3)]


@dataclass(frozen=True)
class Placement:
    """Axes and units of the finite element model.

    Parameters
    ----------
    axis : (3,) float
        Axis of rotation, in the axes of the file.
    radial : (3,) float
        Direction from the axis to the blade of the sector.
    origin : (3,) float
        A point on the axis.
    units : str or Units

    Raises
    ------
    SettingError
        If axis and radial are no directions at right angles, or the units are not known.
    """

    axis: Direction
    radial: Direction
    origin: Direction
    units: Annotated[Any, _units]

    def __post_init__(self) -> None:
        validation.check_fields(self)
        lengths = np.linalg.norm(self.axis) * np.linalg.norm(self.radial)
        good = lengths > 0.0 and abs(self.axis @ self.radial) <= BOUNDS.axes * lengths
        found = f"{self.axis.tolist()} and {self.radial.tolist()}"
        validation.check(good, "axis and radial", "two directions at right angles", found)

    @cached_property
    def rotation(self) -> NDArray:
        """(3, 3) rows X, Y, Z."""
        z, y = (direction / np.linalg.norm(direction) for direction in (self.axis, self.radial))
        return np.array([np.cross(y, z), y, z])


@dataclass(frozen=True)
class Ring:
    """The cyclic structure: how one sector repeats, and which waves of it are wanted.

    Parameters
    ----------
    faces : SectorFaces
    diameters : tuple of int
        Nodal diameters.
    pictured : tuple of int
        Those whose shapes are kept for pictures: shapes of the surface make up most of a file.
    """

    faces: SectorFaces
    diameters: tuple[int, ...]
    pictured: tuple[int, ...]


@dataclass
class PreparedBody:
    """A body in SI units and in the axes of the model.

    Parameters
    ----------
    name : str
        Its name in the model and in messages.
    given : FEBody
    place : Placement
    checks : list of str
        Checks that the body has passed; grows while the model is built.
    missing : list of str
        Quantities that the body does not provide, and what to do about it; grows likewise.
    pictures : dict of nodal diameter to (n_nodes, 3, n_modes)
        The first shapes of a model's modes, for pictures; where the body has elements and the shapes all nodes.
    expected : mapping of nodal diameter to frequencies (Hz)
        Of another program.
    strict : bool
        Whether a comparison that fails ends the build; otherwise it warns.
    failed : list of str
        Comparisons that failed; grows likewise.
    step : function of a text
        Told each step of the work as it begins.
    """

    name: str
    given: FEBody
    place: Placement
    checks: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    pictures: dict[int, NDArray] = field(default_factory=dict)
    expected: Mapping[int, Sequence[float]] = field(default_factory=dict)
    strict: bool = False
    failed: list[str] = field(default_factory=list)
    step: Callable[[str], None] = lambda text: None

    def __post_init__(self) -> None:
        g = self.given
        self.where = f"{self.name} ({g.source})"
        numbers, nodes = np.asarray(g.numbers), np.asarray(g.nodes, float)
        good = numbers.ndim == 1 and nodes.shape == (len(numbers), 3) and len(numbers) > 0
        self.require(good, "nodes", "numbers (n,) and positions (n, 3)", f"{numbers.shape}, {nodes.shape}")
        self.require(numbers.dtype.kind in "iu", "nodes", "whole node numbers", numbers.dtype)
        self.require(np.isfinite(nodes).all(), "nodes", "finite positions", nodes[~np.isfinite(nodes)][:1])
        unique, count = np.unique(numbers, return_counts=True)
        self.require(count.max() == 1, "nodes", "each node number once", f"{unique[count.argmax()]} {count.max()} times")
        self.nodes: NDArray = self.place.units.length * (nodes - self.place.origin) @ self.place.rotation.T
        self._sorted = np.argsort(numbers, kind="stable")
        self._ascending = numbers[self._sorted]

    def keep_pictures(self, nodal_diameter: int, shapes: NDArray) -> None:
        """Keep the first modes of a model (3 n_nodes, n_modes) for pictures."""
        if self.elements:
            kept = shapes.reshape(-1, 3, shapes.shape[1])[..., : PICTURED_MODES].copy()
            if np.isfinite(kept[self.used]).all():
                self.pictures[nodal_diameter] = kept

    def error(self, item: str, expected: str, found: object) -> ModelError:
        """The error for something about this body that does not fit."""
        return mismatch(f"{self.where}: {item}", expected, found)

    def require(self, good: object, item: str, expected: str, found: object) -> None:
        """Raise ModelError unless ``good``."""
        check(good, f"{self.where}: {item}", expected, found)

    def refusing(self, item: str, expected: str) -> AbstractContextManager[None]:
        """Turn what SciPy or the reduction raises in the block into the error for something that does not fit."""
        return parsing(f"{self.where}: {item}", expected)

    @contextmanager
    def compared(self) -> Iterator[None]:
        """A comparison with what others found, which need not end the build where it fails."""
        try:
            yield
        except ModelError as error:
            if self.strict:
                raise
            self.failed.append(str(error))
            warn(f"{error} (strict=True refuses)")

    # ---- numbers, sets and faces ----

    @property
    def size(self) -> float:
        """Largest extent, m."""
        return float(np.ptp(self.nodes, axis=0).max())

    def index(self, numbers: NDArray, item: str) -> NDArray:
        """Indices of nodes by their numbers, any shape.

        Raises
        ------
        ModelError
            If there is no node of such a number.
        """
        numbers = np.asarray(numbers)
        self.require(numbers.dtype.kind in "iu", item, "whole node numbers", f"numbers of type {numbers.dtype}")
        place = np.minimum(np.searchsorted(self._ascending, numbers), len(self._ascending) - 1)
        for missing in numbers[self._ascending[place] != numbers][:1]:
            raise self.error(item, "numbers of existing nodes", missing)
        return self._sorted[place]

    def node_set(self, given: NodeSet, item: str) -> NDArray:
        """Node indices of a set by name or by numbers."""
        if isinstance(given, str):
            if given in self.given.node_sets:
                return np.unique(self.index(self.given.node_sets[given], f"node set '{given}'"))
            if given in self.given.face_sets:
                return self.faces(given, item).nodes
            known = sorted({*self.given.node_sets, *self.given.face_sets})
            raise self.error(item, f"a set out of {known}", f"'{given}'")
        array = np.asarray(given)
        self.require(array.dtype.kind != "U", item, "the name of one set, or node numbers", f"{given}")
        self.require(array.ndim == 1 and len(array) != 0, item, "node numbers (n,)", f"shape {array.shape}")
        return np.unique(self.index(array, item))

    @cached_property
    def elements(self) -> tuple[NDArray, ...]:
        """Node indices of the solid elements."""
        return tuple(self.index(e, "elements") for e in self.given.elements)

    @cached_property
    def used(self) -> NDArray:
        """Indices of the nodes of the elements; of all nodes without elements."""
        if not self.elements:
            return np.arange(len(self.nodes))
        return np.unique(np.concatenate([e.ravel() for e in self.elements]))

    @cached_property
    def boundary(self) -> Facets:
        """Outer faces of the solid elements."""
        with self.refusing("elements", "solid elements"):
            return boundary_facets(self.elements, self.nodes)

    def faces(self, given: FaceSet, item: str) -> Facets:
        """Facets by the name of a set, by node numbers of faces, or by a set of nodes with the elements behind it."""
        if isinstance(given, str) and given in self.given.face_sets:
            groups: tuple[NDArray, ...] = tuple(self.given.face_sets[given])
        elif isinstance(given, tuple):
            groups = tuple(np.asarray(g) for g in given)
        elif not isinstance(given, str) and np.ndim(given) == 2:
            groups = (np.asarray(given),)
        else:
            nodes = self.node_set(given, item)
            self.require(bool(self.elements), item, "faces, or elements besides the set of nodes", "nodes alone")
            found = facets_on_nodes(self.boundary, nodes)
            self.require(len(found) > 0, item, "nodes that hold at least one whole face of an element", "none")
            return found
        for group in groups:
            good = group.ndim == 2 and group.shape[1] in (3, 4, 6, 8) and len(group) > 0
            self.require(good, item, "faces (n, 3 | 4 | 6 | 8)", f"shape {group.shape}")
        return Facets(tuple(self.index(g, item) for g in groups))

    def node(self, given: object, item: str) -> int:
        """Index of one node by its number, or the one nearest to a position in the axes and units of the file."""
        if isinstance(given, int | np.integer) and not isinstance(given, bool):
            return int(self.index(np.array([given]), item)[0])
        position = validation.numbers(f"{item}, a node number or a position", given, 3) - self.place.origin
        position = self.place.units.length * self.place.rotation @ position
        distance = np.linalg.norm(self.nodes - position, axis=1)
        found = f"{distance.min():.4g} m from the nearest node"
        self.require(distance.min() <= 0.1 * self.size, item, "a position on the body", found)
        nearest = int(distance.argmin())
        self.checks.append(f"{item}: node {self.given.numbers[nearest]}, {distance[nearest]:.2g} m from the position given")
        return nearest

    def damper_axes(self, centre: NDArray) -> NDArray:
        """(3, 3) rows: tangential, radial and axial direction at the centre of mass (3,) of a free body.

        Raises
        ------
        ModelError
            If the centre lies on the axis of rotation.
        """
        outward = centre * [1.0, 1.0, 0.0]
        distance = np.linalg.norm(outward)
        good = distance >= 1e-6 * max(self.size, 1e-300)
        self.require(good, "centre of mass", "a place off the axis of rotation", f"{centre} m")
        radial = outward / distance
        return np.array([np.cross(radial, [0.0, 0.0, 1.0]), radial, [0.0, 0.0, 1.0]])

    def check_repeated(self) -> None:
        """Refuse nodes at the same place: they are usually a mesh that was not merged."""
        used = self.used
        pairs = cKDTree(self.nodes[used]).query_pairs(BOUNDS.same_place * max(self.size, 1e-30), output_type="ndarray")
        for a, b in self.given.numbers[used[pairs[:1]]]:
            found = f"nodes {a} and {b} at one place and {len(pairs)} such pairs in all"
            raise self.error("nodes", "each place once", found)

    # ---- matrices ----

    @property
    def has_matrices(self) -> bool:
        return self.given.stiffness is not None and self.given.mass is not None

    @property
    def faster(self) -> PreparedBody | None:
        """The same body at a higher rotor speed, if there is one."""
        return None if self.given.faster is None else PreparedBody(self.name, self.given.faster, self.place)

    @cached_property
    def _table(self) -> tuple[NDArray, NDArray]:
        """Rows (n_eq,) of the full matrices, and the mask (n_nodes, 3) of components without a row."""
        assert self.given.stiffness is not None
        n_eq = self.given.stiffness.shape[0]
        n = len(self.nodes)
        if self.given.dofs is None:
            expected = f"{3 * n} rows for {n} nodes, or a table of nodes and components"
            self.require(n_eq == 3 * n, "stiffness", expected, f"{n_eq} rows and no table")
            return np.arange(3 * n), np.zeros((n, 3), bool)
        item, dofs = "table of nodes and components", np.asarray(self.given.dofs)
        good = dofs.shape == (n_eq, 2) and dofs.dtype.kind in "iu"
        self.require(good, item, f"whole numbers ({n_eq}, 2)", f"{dofs.shape}")
        for node, component in dofs[(dofs[:, 1] < 1) | (dofs[:, 1] > 3)][:1]:
            raise self.error(item, "displacements only (components 1, 2, 3)", f"component {component} of node {node}")
        rows = 3 * self.index(dofs[:, 0], item) + dofs[:, 1] - 1
        values, count = np.unique(rows, return_counts=True)
        node, component = divmod(int(values[count.argmax()]), 3)
        found = f"node {self.given.numbers[node]}, component {component + 1} repeated"
        self.require(len(values) == n_eq, item, "each pair once", found)
        absent = np.ones(3 * n, bool)
        absent[rows] = False
        return rows, absent.reshape(n, 3)

    @cached_property
    def structure(self) -> Structure:
        """Nodes and full matrices; components without a row have empty rows."""
        return Structure(self.nodes, self._expanded("stiffness"), self._expanded("mass"))

    def _expanded(self, key: str) -> sp.csr_matrix:
        item, (rows, _) = f"{self.where}: {key} matrix", self._table
        matrix, n_eq = sp.csr_matrix(getattr(self.given, key)), len(rows)
        check(matrix.shape == (n_eq, n_eq), item, f"shape ({n_eq}, {n_eq})", matrix.shape)
        matrix = square_matrix(matrix, item)
        scale = float(abs(matrix).max())
        check(scale != 0.0, item, "numbers other than 0", "none")
        difference = abs(matrix - matrix.T).tocoo()
        if difference.nnz and difference.data.max() > BOUNDS.symmetry * scale:
            k = int(difference.data.argmax())
            r, c = int(difference.row[k]), int(difference.col[k])
            found = f"{matrix[r, c]:.9g} in row {r + 1}, column {c + 1} and {matrix[c, r]:.9g} in its mirror place"
            raise mismatch(item, "a symmetric matrix (both triangles)", found)
        diagonal = matrix.diagonal()
        k = int(diagonal.argmin())
        check(diagonal[k] >= 0.0, item, "a diagonal without negative numbers", f"{diagonal[k]:.6g} in row {k + 1}")
        n = 3 * len(self.nodes)
        pick = sp.csr_matrix((np.ones(n_eq), (rows, np.arange(n_eq))), shape=(n, n_eq))
        full = (pick @ (0.5 * (matrix + matrix.T)) @ pick.T).tocsr()
        if (turned := self._turning) is not None:
            full = turned @ full @ turned.T
            full = 0.5 * (full + full.T)
        return (self.place.units.mass * full).tocsr()

    @cached_property
    def _turning(self) -> sp.csr_matrix | None:
        """Block-diagonal rotation from the components of the file to those of the model; None if they are the same."""
        q = self.place.rotation
        if np.allclose(q, np.eye(3), rtol=0.0, atol=1e-12) and not self.given.node_axes:
            return None
        blocks = np.broadcast_to(q, (len(self.nodes), 3, 3)).copy()
        for number, axes in self.given.node_axes.items():
            axes = np.asarray(axes, float)
            good = axes.shape == (3, 3) and np.abs(axes @ axes.T - np.eye(3)).max() <= BOUNDS.axes
            self.require(good, f"axes of node {number}", "three rows at right angles, of length 1", axes.tolist())
            blocks[self.index(np.array([number]), "axes of nodes")] = q @ axes.T
        n = len(blocks)
        return sp.bsr_matrix((blocks, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n)).tocsr()

    def fixed(self, held: NDArray | None) -> NDArray:
        """Mask (n_nodes, 3) of the fixed components, in the axes of the model; ``held`` are node indices."""
        absent = self._table[1].copy()
        # Nodes without any row (of another body, of a plane of reference) count as fixed.
        partly = absent.any(axis=1) & ~absent.all(axis=1)
        q = np.abs(self.place.rotation)
        plain = bool(np.all((q < 1e-9) | (q > 1 - 1e-9)))
        own = np.isin(self.given.numbers, np.array(list(self.given.node_axes), int))
        for number in self.given.numbers[partly & (own | (not plain))][:1]:
            expected = "all three components or none fixed, or axes of the file along those of the model"
            raise self.error(f"node {number}", expected, "some fixed in axes that are turned")
        out = absent @ (q > 0.5).T if partly.any() else absent
        if held is not None:
            out[held] = True
        return out

    def shapes(self, numbers: NDArray, shapes: NDArray, item: str) -> NDArray:
        """Mode shapes of a file (n, 3, m) as rows of all nodes (3 n_nodes, m), NaN where the file has none."""
        out = np.full((len(self.nodes), 3, shapes.shape[2]), np.nan, shapes.dtype)
        known = np.isin(numbers, self.given.numbers)
        self.require(known.any(), item, "nodes of this body", "none of them")
        rows = self.index(numbers[known], item)
        out[rows] = np.einsum("ij,njm->nim", self.place.rotation, shapes[known])
        return out.reshape(-1, shapes.shape[2])
