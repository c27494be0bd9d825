r"""Bodies in SI units and in the axes of a model, and the report that collects the results of an
import's checks.

The axes of the model are Z, the axis of rotation, Y, the direction to the blade, and X = Y x Z.
Let them be the rows of Q, in the axes of the file.  Let :math:`x_0` be a point on the axis of
rotation and s the unit of length in metres.  Then

.. math:: x' = s\, Q (x - x_0), \qquad K' = T K T^T

where T is block-diagonal with the block Q at every node.  At a node with its axes A (rows) the
block is :math:`Q A^T`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
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
from bdamper.util.errors import ModelError, check, check_sentence, mismatch, warn
from bdamper.util.progress import Steps

FaceSet = str | NDArray | tuple[NDArray, ...]


@dataclass(frozen=True)
class CyclicStructure:
    """Cyclic structure and the nodal diameters of its model.

    Parameters
    ----------
    faces : SectorFaces
        Nodes of the sector faces.
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
        Whether a failed comparison with another program is an error instead of a warning.
    steps : Steps
        Steps of the work, to show progress.
    checks : list of str
        Passed checks with their numerical results.
    missing : list of str
        Quantities that the model lacks, each with a remedy or a consequence.
    failed : list of str
        Failed comparisons with another program.
    shifts : list of float
        Relative rises of the lowest frequencies by bonded faces; empty if unknown.
    """

    strict: bool = False
    steps: Steps = field(default_factory=Steps)
    checks: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    shifts: list[float] = field(default_factory=list)

    @contextmanager
    def comparison(self) -> Iterator[None]:
        """Turn a ModelError of the block into a warning and an entry of ``failed``, unless
        ``strict``.
        """
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
        If the node numbers are not unique integers, or the positions are not finite or have the
        wrong shape.
    """

    name: str
    raw: FEBody
    placement: Placement
    report: ImportReport = field(default_factory=ImportReport)

    def __post_init__(self) -> None:
        numbers = np.asarray(self.raw.numbers)
        nodes = np.asarray(self.raw.nodes, float)
        good = numbers.ndim == 1 and nodes.shape == (len(numbers), 3) and len(numbers) > 0
        found = f"{numbers.shape}, {nodes.shape}"
        self.require(good, "nodes", "numbers (n,) and positions (n, 3)", found)
        self.require(numbers.dtype.kind in "iu", "nodes", "whole node numbers", numbers.dtype)
        bounded = np.abs(nodes) < 1e100  # squares of larger numbers overflow
        self.require(bounded.all(), "nodes", "finite positions", nodes[~bounded][:1])
        unique, count = np.unique(numbers, return_counts=True)
        found = f"{unique[count.argmax()]} {count.max()} times"
        self.require(count.max() == 1, "nodes", "each node number once", found)

    @property
    def where(self) -> str:
        """Name and source of the body, for messages."""
        return f"{self.name} ({self.raw.source})"

    @cached_property
    def nodes(self) -> NDArray:
        """Positions (n_nodes, 3) of the nodes, m."""
        from_axis = self.raw.nodes - self.placement.origin
        return self.placement.units.length * from_axis @ self.placement.rotation.T

    def passed(self, text: str) -> None:
        """Add a passed check to the report."""
        self.report.checks.append(text)

    def error(self, item: str, expected: str, found: object) -> ModelError:
        """Return the ModelError for an unexpected value of a quantity of this body."""
        return mismatch(f"{self.where}: {item}", expected, found)

    def require(self, good: object, item: str, expected: str, found: object) -> None:
        """Raise a ModelError for a quantity of this body unless ``good``."""
        check(good, f"{self.where}: {item}", expected, found)

    def require_sentence(self, good: object, item: str, sentence: str) -> None:
        """Raise a ModelError with a plain sentence on a quantity of this body unless ``good``."""
        check_sentence(good, f"{self.where}: {item}", sentence)

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
        """Indices of the nodes in ascending order of their numbers."""
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
        numbers = np.asarray(numbers)
        ascending = np.asarray(self.raw.numbers)[self._order]
        is_integer = numbers.dtype.kind in "iu"
        self.require(is_integer, item, "whole node numbers", f"numbers of type {numbers.dtype}")
        rank = np.minimum(np.searchsorted(ascending, numbers), len(ascending) - 1)
        unknown = numbers[ascending[rank] != numbers]
        if len(unknown):
            raise self.error(item, "numbers of existing nodes", unknown[0])
        return self._order[rank]

    def node_set(self, nodes: NodeSet, item: str) -> NDArray:
        """Return the node indices of a set from its name or from node numbers, ascending."""
        if not isinstance(nodes, str):
            numbers = np.asarray(nodes)
            is_text = numbers.dtype.kind == "U"
            self.require(
                not is_text,
                item,
                "the name of one set or node numbers",
                f"several names {nodes}",
            )
            good = numbers.ndim == 1 and len(numbers) != 0
            self.require(good, item, "a list of node numbers", f"an array of shape {numbers.shape}")
            return np.unique(self.index(numbers, item))
        if nodes in self.raw.node_sets:
            return np.unique(self.index(self.raw.node_sets[nodes], f"node set '{nodes}'"))
        if nodes in self.raw.face_sets:
            return self.faces(nodes, item).nodes
        names = sorted({*self.raw.node_sets, *self.raw.face_sets})
        raise self.error(item, f"one of the sets {names}", f"'{nodes}'")

    @cached_property
    def elements(self) -> tuple[NDArray, ...]:
        """Node indices of the solid elements, an array for each type."""
        return tuple(self.index(nodes, "elements") for nodes in self.raw.elements)

    @cached_property
    def kinds(self) -> tuple[ElementKind, ...]:
        """Type and material of each array of :attr:`elements`."""
        kinds = self.raw.element_kinds
        if not kinds:
            kinds = tuple(ElementKind(f"C3D{nodes.shape[1]}") for nodes in self.elements)
        n = len(self.elements)
        self.require(len(kinds) == n, "element_kinds", f"one for each of {n} arrays", len(kinds))
        return kinds

    @cached_property
    def used(self) -> NDArray:
        """Indices of the nodes that belong to elements, or of all nodes if the body has no
        elements.
        """
        if not self.elements:
            return np.arange(len(self.nodes))
        return np.unique(np.concatenate([nodes.ravel() for nodes in self.elements]))

    @cached_property
    def boundary(self) -> Facets:
        """Outer faces of the solid elements."""
        with self.refusing("elements", "solid elements"):
            return boundary_facets(self.elements, self.nodes)

    def faces(self, faces: FaceSet, item: str) -> Facets:
        """Return facets from the name of a set, from faces by their node numbers, or from nodes on
        element faces.

        Parameters
        ----------
        faces : str, (n,) int, (n, 3 | 4 | 6 | 8) int, or tuple of such two-dimensional arrays
        item : str
            Name of the faces in messages.

        Raises
        ------
        ModelError
            If a set or node does not exist, or the nodes do not contain all nodes of any element
            face.
        """
        groups: tuple[NDArray, ...]
        if isinstance(faces, str) and faces in self.raw.face_sets:
            groups = tuple(self.raw.face_sets[faces])
        elif isinstance(faces, tuple):
            groups = tuple(np.asarray(group) for group in faces)
        elif not isinstance(faces, str) and np.ndim(faces) == 2:
            groups = (np.asarray(faces),)
        else:
            return self._faces_on(self.node_set(faces, item), item)
        for group in groups:
            good = group.ndim == 2 and group.shape[1] in (3, 4, 6, 8) and len(group) > 0
            self.require(good, item, "faces (n, 3 | 4 | 6 | 8)", f"shape {group.shape}")
        return Facets(tuple(self.index(group, item) for group in groups))

    def _faces_on(self, nodes: NDArray, item: str) -> Facets:
        """Return the outer faces of elements whose nodes are all among ``nodes`` (indices)."""
        expected = "faces, or a set of nodes of a body with elements"
        self.require(bool(self.elements), item, expected, "only nodes")
        facets = facets_on_nodes(self.boundary, nodes)
        expected = "nodes that include all nodes of at least one element face"
        self.require(len(facets) > 0, item, expected, "none")
        return facets

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
            If there is no such node, or the position is off the body by more than a tenth of its
            size.
        """
        if isinstance(location, int | np.integer) and not isinstance(location, bool):
            return int(self.index(np.array([location]), item)[0])
        in_file = validation.numbers(f"{item}, a node number or a position", location, 3)
        from_axis = in_file - self.placement.origin
        position = self.placement.units.length * self.placement.rotation @ from_axis
        distance = np.linalg.norm(self.nodes - position, axis=1)
        nearest = int(distance.argmin())
        off = distance[nearest]
        found = f"{off:.4g} m from the nearest node"
        self.require(off <= 0.1 * self.size, item, "a position on the body", found)
        self.passed(
            f"{item}: node {self.raw.numbers[nearest]}, {off:.2g} m from the given position"
        )
        return nearest

    def damper_axes(self, centre: NDArray) -> NDArray:
        """Return the tangential, radial and axial direction as rows (3, 3), at the centre of mass
        (3,) of a free body.

        Raises
        ------
        ModelError
            If the centre lies on the axis of rotation.
        """
        outward = centre * [1.0, 1.0, 0.0]
        distance = np.linalg.norm(outward)
        off_axis = distance >= 1e-6 * max(self.size, 1e-300)
        self.require(off_axis, "centre of mass", "a point off the axis of rotation", f"{centre} m")
        radial = outward / distance
        axial = [0.0, 0.0, 1.0]
        return np.array([np.cross(radial, axial), radial, axial])

    def check_repeated(self) -> None:
        """Raise ModelError if two nodes of elements coincide, which usually means that a mesh was
        not merged.
        """
        used = self.used
        limit = BOUNDS.same_place * max(self.size, 1e-30)
        pairs = cKDTree(self.nodes[used]).query_pairs(limit, output_type="ndarray")
        if len(pairs):
            a, b = self.raw.numbers[used[pairs[0]]]
            found = (
                f"nodes {a} and {b} at the same position, one of {len(pairs)} such pairs; "
                "merge the mesh"
            )
            raise self.error("nodes", "each position once", found)

    # ---- matrices ----

    @property
    def has_matrices(self) -> bool:
        """Whether the file has both stiffness and mass."""
        return self.raw.stiffness is not None and self.raw.mass is not None

    @property
    def faster(self) -> PreparedBody | None:
        """Same body at the higher of two rotor speeds, with a separate report, or None for a single
        speed.
        """
        if self.raw.faster is None:
            return None
        return PreparedBody(self.name, self.raw.faster, self.placement)

    @property
    def between(self) -> PreparedBody | None:
        """Same body at a rotor speed between both, with a separate report, or None."""
        if self.raw.between is None:
            return None
        return PreparedBody(self.name, self.raw.between, self.placement)

    @cached_property
    def _table(self) -> tuple[NDArray, NDArray]:
        """Index (n_eq,) of each equation in the full matrices, and the mask (n_nodes, 3) of
        components without one.
        """
        assert self.raw.stiffness is not None
        n_eq = self.raw.stiffness.shape[0]
        n = len(self.nodes)
        if self.raw.dofs is None:
            expected = f"{3 * n} rows for {n} nodes, or a table of nodes and components"
            self.require(n_eq == 3 * n, "stiffness", expected, f"{n_eq} rows but no table")
            return np.arange(3 * n), np.zeros((n, 3), bool)
        item = "table of nodes and components"
        dofs = np.asarray(self.raw.dofs)
        good = dofs.shape == (n_eq, 2) and dofs.dtype.kind in "iu"
        found = f"{dofs.dtype} array of shape {dofs.shape}"
        self.require(good, item, f"an integer array of shape ({n_eq}, 2)", found)
        others = dofs[(dofs[:, 1] < 1) | (dofs[:, 1] > 3)]
        if len(others):
            node, component = others[0]
            found = f"component {component} of node {node}"
            raise self.error(item, "displacements only (components 1, 2, 3)", found)
        rows = 3 * self.index(dofs[:, 0], item) + dofs[:, 1] - 1
        distinct, count = np.unique(rows, return_counts=True)
        node, component = divmod(int(distinct[count.argmax()]), 3)
        found = f"node {self.raw.numbers[node]}, component {component + 1} repeated"
        self.require(len(distinct) == n_eq, item, "each pair once", found)
        absent = np.ones(3 * n, bool)
        absent[rows] = False
        return rows, absent.reshape(n, 3)

    @cached_property
    def structure(self) -> Structure:
        """Nodes and full matrices, with empty rows for components without an equation."""
        return Structure(self.nodes, self._expanded("stiffness"), self._expanded("mass"))

    def _expanded(self, key: str) -> sp.csr_matrix:
        """Return stiffness or mass with three rows for each node, in SI units and model axes."""
        item = f"{self.where}: {key} matrix"
        rows, _ = self._table
        n_eq = len(rows)
        matrix = sp.csr_matrix(getattr(self.raw, key))
        check(matrix.shape == (n_eq, n_eq), item, f"shape ({n_eq}, {n_eq})", matrix.shape)
        matrix = square_matrix(matrix, item)
        scale = float(abs(matrix).max())
        check(scale != 0.0, item, "numbers other than 0", "none")
        difference = abs(matrix - matrix.T).tocoo()
        if difference.nnz and difference.data.max() > BOUNDS.symmetry * scale:
            worst = int(difference.data.argmax())
            row, column = int(difference.row[worst]), int(difference.col[worst])
            found = (
                f"{matrix[row, column]:.9g} in row {row + 1}, column {column + 1} "
                f"and {matrix[column, row]:.9g} in the transposed position"
            )
            raise mismatch(item, "a symmetric matrix (both triangles)", found)
        diagonal = matrix.diagonal()
        lowest = int(diagonal.argmin())
        found = f"{diagonal[lowest]:.6g} in row {lowest + 1}"
        check(diagonal[lowest] >= 0.0, item, "a diagonal without negative numbers", found)
        n = 3 * len(self.nodes)
        place = sp.csr_matrix((np.ones(n_eq), (rows, np.arange(n_eq))), shape=(n, n_eq))
        full = (place @ (0.5 * (matrix + matrix.T)) @ place.T).tocsr()
        turning = self._turning
        if turning is not None:
            full = turning @ full @ turning.T
            # symmetric except for rounding
            full = 0.5 * (full + full.T)
        return (self.placement.units.mass * full).tocsr()

    @cached_property
    def _turning(self) -> sp.csr_matrix | None:
        """Matrix T of the module's docstring, or None for the identity."""
        to_model = self.placement.rotation
        is_identity = np.allclose(to_model, np.eye(3), rtol=0.0, atol=1e-12)
        if is_identity and not self.raw.node_axes:
            return None
        n = len(self.nodes)
        blocks = np.broadcast_to(to_model, (n, 3, 3)).copy()
        for number, node_axes in self.raw.node_axes.items():
            axes = np.asarray(node_axes, float)
            good = axes.shape == (3, 3) and np.abs(axes @ axes.T - np.eye(3)).max() <= BOUNDS.axes
            expected = "three rows at right angles, of length 1"
            self.require(good, f"axes of node {number}", expected, axes.tolist())
            blocks[self.index(np.array([number]), "axes of nodes")] = to_model @ axes.T
        block_diagonal = (blocks, np.arange(n), np.arange(n + 1))
        return sp.bsr_matrix(block_diagonal, shape=(3 * n, 3 * n)).tocsr()

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
        # A node without any equation (such as a node of another body) counts as fixed in all
        # components.
        partly = absent.any(axis=1) & ~absent.all(axis=1)
        to_model = np.abs(self.placement.rotation)
        parallel = bool(np.all((to_model < 1e-9) | (to_model > 1 - 1e-9)))
        with_axes = np.isin(self.raw.numbers, np.array(list(self.raw.node_axes), int))
        in_rotated_axes = self.raw.numbers[partly & (with_axes | (not parallel))]
        if len(in_rotated_axes):
            expected = (
                "all three components or none fixed, "
                "or axes of the file along the axes of the model"
            )
            found = "some components fixed in rotated axes"
            raise self.error(f"node {in_rotated_axes[0]}", expected, found)
        mask = absent.copy()
        if partly.any():
            mask = absent @ (to_model > 0.5).T
        if held is not None:
            mask[held] = True
        return mask

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
        n_modes = shapes.shape[2]
        on_all_nodes = np.full((len(self.nodes), 3, n_modes), np.nan, shapes.dtype)
        of_body = np.isin(numbers, self.raw.numbers)
        self.require(of_body.any(), item, "nodes of this body", "none of them")
        rows = self.index(numbers[of_body], item)
        on_all_nodes[rows] = np.einsum("ij,njm->nim", self.placement.rotation, shapes[of_body])
        return on_all_nodes.reshape(-1, n_modes)
