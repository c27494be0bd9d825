r"""Bodies in SI units and in the axes of a model, and the report that collects the results of an import's checks.

The axes of the model are Z, the axis of rotation, Y, the direction to the blade, and X = Y x Z.  Let them be the rows of
Q, in the axes of the file.  Let :math:`x_0` be a point on the axis of rotation and s the unit of length in metres.  Then

.. math:: x' = s\, Q (x - x_0), \qquad K' = T K T^T

where T is block-diagonal with the block Q at every node.  At a node with its axes A (rows) the block is :math:`Q A^T`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bdamper.fem.sector_faces import SectorFaces
from bdamper.fem.surface import Facets, Structure, boundary_facets, facets_on_nodes
from bdamper.importers.arrays import square_matrix
from bdamper.importers.fe_body import BOUNDS, ElementKind, FEBody, parsing
from bdamper.importers.options import NodeSet, Placement
from bdamper.util import validation
from bdamper.util.errors import ModelError, check, mismatch, warn

FaceSet = str | NDArray | tuple[NDArray, ...]


@dataclass(frozen=True)
class Ring:
    """Cyclic structure and the nodal diameters of its model.

    Parameters
    ----------
    faces : SectorFaces
        Nodes at which the sectors meet.
    diameters : tuple of int
        Nodal diameters of the model.
    pictured : tuple of int
        Nodal diameters with mode shapes for pictures.  These shapes make up most of a model file.
    expected : mapping of nodal diameter to (n,) float
        Natural frequencies (Hz) computed by another program.
    """

    faces: SectorFaces
    diameters: tuple[int, ...]
    pictured: tuple[int, ...]
    expected: Mapping[int, Sequence[float]] = field(default_factory=dict)


@dataclass
class ImportReport:
    """Results of the checks of an import, collected while the model is built.

    Parameters
    ----------
    strict : bool
        Whether a failed comparison with another program raises its error.  Otherwise it warns.
    step : callable
        Called with a text when a step of the work begins.
    checks : list of str
        Passed checks with their numerical results.
    missing : list of str
        Quantities that the model lacks, each with a remedy or a consequence.
    failed : list of str
        Failed comparisons with another program.
    """

    strict: bool = False
    step: Callable[[str], None] = lambda text: None
    checks: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    @contextmanager
    def comparison(self) -> Iterator[None]:
        """Turn a ModelError of the block into a warning and an entry of ``failed``, unless ``strict``."""
        try:
            yield
        except ModelError as error:
            if self.strict:
                raise
            self.failed.append(str(error))
            warn(f"{error} (checks=Checks(strict=True) makes this an error)")


@dataclass(frozen=True)
class PreparedBody:
    """Body of a finite element model in SI units and in the axes of the model.

    Matrices, faces and sets are converted and checked when they are first used.

    Parameters
    ----------
    name : str
        Name of the body in the model and in messages.
    raw : FEBody
        Body in the units, axes and node numbers of its file.
    placement : Placement
        Axes and units of the file.
    report : ImportReport
        Receives the results of the checks.

    Raises
    ------
    ModelError
        If the node numbers are not unique integers, or the positions are not finite or of another shape.
    """

    name: str
    raw: FEBody
    placement: Placement
    report: ImportReport = field(default_factory=ImportReport)

    def __post_init__(self) -> None:
        numbers, nodes = np.asarray(self.raw.numbers), np.asarray(self.raw.nodes, float)
        good = numbers.ndim == 1 and nodes.shape == (len(numbers), 3) and len(numbers) > 0
        self.require(
            good, "nodes", "numbers (n,) and positions (n, 3)", f"{numbers.shape}, {nodes.shape}"
        )
        self.require(numbers.dtype.kind in "iu", "nodes", "whole node numbers", numbers.dtype)
        bounded = np.abs(nodes) < 1e100  # squares of larger numbers overflow
        self.require(bounded.all(), "nodes", "finite positions", nodes[~bounded][:1])
        unique, count = np.unique(numbers, return_counts=True)
        self.require(
            count.max() == 1,
            "nodes",
            "each node number once",
            f"{unique[count.argmax()]} {count.max()} times",
        )

    @property
    def where(self) -> str:
        """Name and source of the body, for messages."""
        return f"{self.name} ({self.raw.source})"

    @cached_property
    def nodes(self) -> NDArray:
        """Positions (n_nodes, 3) of the nodes, m."""
        return (
            self.placement.units.length
            * (self.raw.nodes - self.placement.origin)
            @ self.placement.rotation.T
        )

    def passed(self, text: str) -> None:
        """Add a passed check to the report."""
        self.report.checks.append(text)

    def error(self, item: str, expected: str, found: object) -> ModelError:
        """Return the ModelError for an unexpected value of a quantity of this body."""
        return mismatch(f"{self.where}: {item}", expected, found)

    def require(self, good: object, item: str, expected: str, found: object) -> None:
        """Raise a ModelError for a quantity of this body unless ``good``."""
        check(good, f"{self.where}: {item}", expected, found)

    def refusing(self, item: str, expected: str) -> AbstractContextManager[None]:
        """Convert numerical errors in the block to a ModelError for a quantity of this body."""
        return parsing(f"{self.where}: {item}", expected)

    # ---- numbers, sets and faces ----

    @property
    def size(self) -> float:
        """Largest extent, m."""
        return float(np.ptp(self.nodes, axis=0).max())

    @cached_property
    def _order(self) -> NDArray:
        return np.argsort(self.raw.numbers, kind="stable")

    def index(self, numbers: NDArray, item: str) -> NDArray:
        """Return the indices of nodes from their numbers, in the same shape.

        Parameters
        ----------
        numbers : int array of any shape
        item : str
            Name of the numbers in messages.

        Raises
        ------
        ModelError
            If a number belongs to no node.
        """
        numbers, ascending = np.asarray(numbers), np.asarray(self.raw.numbers)[self._order]
        self.require(
            numbers.dtype.kind in "iu",
            item,
            "whole node numbers",
            f"numbers of type {numbers.dtype}",
        )
        rank = np.minimum(np.searchsorted(ascending, numbers), len(ascending) - 1)
        for unknown in numbers[ascending[rank] != numbers][:1]:
            raise self.error(item, "numbers of existing nodes", unknown)
        return self._order[rank]

    def node_set(self, nodes: NodeSet, item: str) -> NDArray:
        """Return the node indices of a set from its name or from node numbers, ascending."""
        if isinstance(nodes, str):
            if nodes in self.raw.node_sets:
                return np.unique(self.index(self.raw.node_sets[nodes], f"node set '{nodes}'"))
            if nodes in self.raw.face_sets:
                return self.faces(nodes, item).nodes
            known = sorted({*self.raw.node_sets, *self.raw.face_sets})
            raise self.error(item, f"a set out of {known}", f"'{nodes}'")
        numbers = np.asarray(nodes)
        self.require(
            numbers.dtype.kind != "U", item, "the name of one set, or node numbers", f"{nodes}"
        )
        self.require(
            numbers.ndim == 1 and len(numbers) != 0,
            item,
            "node numbers (n,)",
            f"shape {numbers.shape}",
        )
        return np.unique(self.index(numbers, item))

    @cached_property
    def elements(self) -> tuple[NDArray, ...]:
        """Node indices of the solid elements, an array for each type."""
        return tuple(self.index(nodes, "elements") for nodes in self.raw.elements)

    @cached_property
    def kinds(self) -> tuple[ElementKind, ...]:
        """Type and material of each array of :attr:`elements`."""
        kinds = self.raw.element_kinds or tuple(
            ElementKind(f"C3D{e.shape[1]}") for e in self.elements
        )
        n = len(self.elements)
        self.require(len(kinds) == n, "element_kinds", f"one for each of {n} arrays", len(kinds))
        return kinds

    @cached_property
    def used(self) -> NDArray:
        """Indices of the nodes that belong to elements, or of all nodes if the body has no elements."""
        if not self.elements:
            return np.arange(len(self.nodes))
        return np.unique(np.concatenate([nodes.ravel() for nodes in self.elements]))

    @cached_property
    def boundary(self) -> Facets:
        """Outer faces of the solid elements."""
        with self.refusing("elements", "solid elements"):
            return boundary_facets(self.elements, self.nodes)

    def faces(self, faces: FaceSet, item: str) -> Facets:
        """Return facets from the name of a set, from faces by their node numbers, or from nodes on element faces.

        Parameters
        ----------
        faces : str, (n,) int, (n, 3 | 4 | 6 | 8) int, or tuple of such two-dimensional arrays
        item : str
            Name of the faces in messages.

        Raises
        ------
        ModelError
            If a set or node does not exist, or the nodes do not contain all nodes of any element face.
        """
        if isinstance(faces, str) and faces in self.raw.face_sets:
            groups: tuple[NDArray, ...] = tuple(self.raw.face_sets[faces])
        elif isinstance(faces, tuple):
            groups = tuple(np.asarray(group) for group in faces)
        elif not isinstance(faces, str) and np.ndim(faces) == 2:
            groups = (np.asarray(faces),)
        else:
            nodes = self.node_set(faces, item)
            self.require(
                bool(self.elements),
                item,
                "faces, or a set of nodes of a body with elements",
                "nodes alone",
            )
            facets = facets_on_nodes(self.boundary, nodes)
            self.require(
                len(facets) > 0,
                item,
                "nodes that include all nodes of at least one element face",
                "none",
            )
            return facets
        for group in groups:
            good = group.ndim == 2 and group.shape[1] in (3, 4, 6, 8) and len(group) > 0
            self.require(good, item, "faces (n, 3 | 4 | 6 | 8)", f"shape {group.shape}")
        return Facets(tuple(self.index(group, item) for group in groups))

    def node(self, location: object, item: str) -> int:
        """Return the index of a node from its number, or of the node nearest to a position.

        Parameters
        ----------
        location : int or (3,) float
            Node number, or position in the axes and units of the file.
        item : str
            Name of the location in messages.

        Raises
        ------
        ModelError
            If there is no such node, or the position is off the body by more than a tenth of its size.
        """
        if isinstance(location, int | np.integer) and not isinstance(location, bool):
            return int(self.index(np.array([location]), item)[0])
        position = (
            validation.numbers(f"{item}, a node number or a position", location, 3)
            - self.placement.origin
        )
        position = self.placement.units.length * self.placement.rotation @ position
        distance = np.linalg.norm(self.nodes - position, axis=1)
        nearest = int(distance.argmin())
        off = distance[nearest]
        self.require(
            off <= 0.1 * self.size,
            item,
            "a position on the body",
            f"{off:.4g} m from the nearest node",
        )
        self.passed(
            f"{item}: node {self.raw.numbers[nearest]}, {off:.2g} m from the given position"
        )
        return nearest

    def damper_axes(self, centre: NDArray) -> NDArray:
        """Return the tangential, radial and axial direction as rows (3, 3), at the centre of mass (3,) of a free body.

        Raises
        ------
        ModelError
            If the centre lies on the axis of rotation.
        """
        outward = centre * [1.0, 1.0, 0.0]
        distance = np.linalg.norm(outward)
        good = distance >= 1e-6 * max(self.size, 1e-300)
        self.require(good, "centre of mass", "a point off the axis of rotation", f"{centre} m")
        radial = outward / distance
        return np.array([np.cross(radial, [0.0, 0.0, 1.0]), radial, [0.0, 0.0, 1.0]])

    def check_repeated(self) -> None:
        """Raise ModelError if two nodes of elements coincide, which usually means that a mesh was not merged."""
        used = self.used
        pairs = cKDTree(self.nodes[used]).query_pairs(
            BOUNDS.same_place * max(self.size, 1e-30), output_type="ndarray"
        )
        for a, b in self.raw.numbers[used[pairs[:1]]]:
            found = f"nodes {a} and {b} at the same position, one of {len(pairs)} such pairs; merge the mesh"
            raise self.error("nodes", "each position once", found)

    # ---- matrices ----

    @property
    def has_matrices(self) -> bool:
        """Whether the file has both stiffness and mass."""
        return self.raw.stiffness is not None and self.raw.mass is not None

    @property
    def faster(self) -> PreparedBody | None:
        """Same body at the higher of two rotor speeds, with a separate report, or None for a single speed."""
        return (
            None
            if self.raw.faster is None
            else PreparedBody(self.name, self.raw.faster, self.placement)
        )

    @cached_property
    def _table(self) -> tuple[NDArray, NDArray]:
        """Index (n_eq,) of each equation in the full matrices, and the mask (n_nodes, 3) of components without one."""
        assert self.raw.stiffness is not None
        n_eq = self.raw.stiffness.shape[0]
        n = len(self.nodes)
        if self.raw.dofs is None:
            expected = f"{3 * n} rows for {n} nodes, or a table of nodes and components"
            self.require(n_eq == 3 * n, "stiffness", expected, f"{n_eq} rows and no table")
            return np.arange(3 * n), np.zeros((n, 3), bool)
        item, dofs = "table of nodes and components", np.asarray(self.raw.dofs)
        good = dofs.shape == (n_eq, 2) and dofs.dtype.kind in "iu"
        self.require(good, item, f"whole numbers ({n_eq}, 2)", f"{dofs.shape}")
        for node, component in dofs[(dofs[:, 1] < 1) | (dofs[:, 1] > 3)][:1]:
            raise self.error(
                item,
                "displacements only (components 1, 2, 3)",
                f"component {component} of node {node}",
            )
        rows = 3 * self.index(dofs[:, 0], item) + dofs[:, 1] - 1
        values, count = np.unique(rows, return_counts=True)
        node, component = divmod(int(values[count.argmax()]), 3)
        found = f"node {self.raw.numbers[node]}, component {component + 1} repeated"
        self.require(len(values) == n_eq, item, "each pair once", found)
        absent = np.ones(3 * n, bool)
        absent[rows] = False
        return rows, absent.reshape(n, 3)

    @cached_property
    def structure(self) -> Structure:
        """Nodes and full matrices, with empty rows for components without an equation."""
        return Structure(self.nodes, self._expanded("stiffness"), self._expanded("mass"))

    def _expanded(self, key: str) -> sp.csr_matrix:
        item, (rows, _) = f"{self.where}: {key} matrix", self._table
        matrix, n_eq = sp.csr_matrix(getattr(self.raw, key)), len(rows)
        check(matrix.shape == (n_eq, n_eq), item, f"shape ({n_eq}, {n_eq})", matrix.shape)
        matrix = square_matrix(matrix, item)
        scale = float(abs(matrix).max())
        check(scale != 0.0, item, "numbers other than 0", "none")
        difference = abs(matrix - matrix.T).tocoo()
        if difference.nnz and difference.data.max() > BOUNDS.symmetry * scale:
            k = int(difference.data.argmax())
            r, c = int(difference.row[k]), int(difference.col[k])
            found = f"{matrix[r, c]:.9g} in row {r + 1}, column {c + 1} and {matrix[c, r]:.9g} in the transposed position"
            raise mismatch(item, "a symmetric matrix (both triangles)", found)
        diagonal = matrix.diagonal()
        k = int(diagonal.argmin())
        check(
            diagonal[k] >= 0.0,
            item,
            "a diagonal without negative numbers",
            f"{diagonal[k]:.6g} in row {k + 1}",
        )
        n = 3 * len(self.nodes)
        pick = sp.csr_matrix((np.ones(n_eq), (rows, np.arange(n_eq))), shape=(n, n_eq))
        full = (pick @ (0.5 * (matrix + matrix.T)) @ pick.T).tocsr()
        if (turned := self._turning) is not None:
            full = turned @ full @ turned.T
            full = 0.5 * (full + full.T)
        return (self.placement.units.mass * full).tocsr()

    @cached_property
    def _turning(self) -> sp.csr_matrix | None:
        """Matrix T of the module's docstring, or None for the identity."""
        q = self.placement.rotation
        if np.allclose(q, np.eye(3), rtol=0.0, atol=1e-12) and not self.raw.node_axes:
            return None
        blocks = np.broadcast_to(q, (len(self.nodes), 3, 3)).copy()
        for number, axes in self.raw.node_axes.items():
            axes = np.asarray(axes, float)
            good = axes.shape == (3, 3) and np.abs(axes @ axes.T - np.eye(3)).max() <= BOUNDS.axes
            self.require(
                good,
                f"axes of node {number}",
                "three rows at right angles, of length 1",
                axes.tolist(),
            )
            blocks[self.index(np.array([number]), "axes of nodes")] = q @ axes.T
        n = len(blocks)
        return sp.bsr_matrix((blocks, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n)).tocsr()

    def fixed(self, held: NDArray | None) -> NDArray:
        """Return the mask (n_nodes, 3) of the fixed components, in the axes of the model.

        Parameters
        ----------
        held : (n,) int, optional
            Indices of nodes that are fixed in addition to the components without an equation.

        Raises
        ------
        ModelError
            If a node is partly fixed in axes that are not parallel to the axes of the model.
        """
        absent = self._table[1]
        # A node without any equation (such as a node of another body) counts as fixed in all components.
        partly = absent.any(axis=1) & ~absent.all(axis=1)
        q = np.abs(self.placement.rotation)
        parallel = bool(np.all((q < 1e-9) | (q > 1 - 1e-9)))
        with_axes = np.isin(self.raw.numbers, np.array(list(self.raw.node_axes), int))
        for number in self.raw.numbers[partly & (with_axes | (not parallel))][:1]:
            expected = "all three components or none fixed, or axes of the file along the axes of the model"
            raise self.error(f"node {number}", expected, "some components fixed in rotated axes")
        out = absent @ (q > 0.5).T if partly.any() else absent.copy()
        if held is not None:
            out[held] = True
        return out

    def shapes(self, numbers: NDArray, shapes: NDArray, item: str) -> NDArray:
        """Return mode shapes on all nodes in the axes of the model, NaN at nodes without values.

        Parameters
        ----------
        numbers : (n,) int
            Node numbers of the shapes.
        shapes : (n, 3, n_modes)
        item : str
            Name of the shapes in messages.

        Returns
        -------
        (3 n_nodes, n_modes)
        """
        out = np.full((len(self.nodes), 3, shapes.shape[2]), np.nan, shapes.dtype)
        known = np.isin(numbers, self.raw.numbers)
        self.require(known.any(), item, "nodes of this body", "none of them")
        rows = self.index(numbers[known], item)
        out[rows] = np.einsum("ij,njm->nim", self.placement.rotation, shapes[known])
        return out.reshape(-1, shapes.shape[2])
