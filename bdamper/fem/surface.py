"""Finite element bodies: nodes and matrices, and the faces of elements on their surface.

A facet lists its corners counter-clockwise seen from outside.  In second-order elements the midside
node between corners ``c`` and ``c + 1`` follows for each ``c``.  The number of nodes (3, 4, 6 or 8)
thus identifies the type.

All programs use the same order of the corners of tetrahedra, wedges and hexahedra, but different
orders of midside nodes. Positions identify midside nodes.  The sense of rotation of a facet follows
from the position of its element.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

# ---- Nodes and matrices ----


def require(good: object, wrong: str) -> None:
    """Raise ValueError with the text ``wrong`` unless ``good``.

    Importers add the name of the body.
    """
    if not good:
        raise ValueError(wrong)


def hermitian(matrix: NDArray) -> NDArray:
    """Return the Hermitian part of one or several matrices (..., n, n)."""
    return 0.5 * (matrix + matrix.conj().swapaxes(-1, -2))


@dataclass(frozen=True)
class Structure:
    """Nodes and matrices of a body.

    Node ``a`` has the degrees of freedom ``3 a``, ``3 a + 1``, ``3 a + 2``.

    Parameters
    ----------
    nodes : (n_nodes, 3) float, m
    stiffness, mass : (3 n_nodes, 3 n_nodes) sparse, N/m and kg
    """

    nodes: NDArray
    stiffness: sp.csr_matrix
    mass: sp.csr_matrix

    @property
    def n_dof(self) -> int:
        return 3 * len(self.nodes)

    def dofs(self, nodes: NDArray) -> NDArray:
        """Return the degrees of freedom (3 n,) of nodes (n,), grouped by node."""
        return (3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel()

    def nearest_node(self, position: NDArray) -> int:
        """Return the node closest to ``position`` (3,)."""
        return int(np.argmin(np.linalg.norm(self.nodes - position, axis=1)))

    def body_force(self, density: NDArray) -> NDArray:
        """Return consistent nodal forces (n_nodes, 3), N.

        ``density`` (n_nodes, 3) is the force per mass at the nodes.  Shape functions interpolate
        the force, which is exact if it is linear in the coordinates.
        """
        force = self.mass @ np.asarray(density, float).ravel()
        return force.reshape(-1, 3)


# ---- Faces of elements ----


N_CORNER = {4: 4, 10: 4, 6: 6, 15: 6, 8: 8, 20: 8}
"""Number of corners of an element by its number of nodes."""

FACES = {
    4: ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
    6: ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    8: ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
"""Corners of the faces S1, S2, ... of elements in CalculiX and Abaqus, in order."""
LEAST_COSINE = 0.1
"""Smallest cosine of the angle between two corner normals of a face.  A cube with the corners of
one face shifted by one position has 0, the most distorted element of the reference sector 0.67.
"""


def twisted(corners: NDArray, nodes: NDArray) -> NDArray:
    """Return whether the corners of hexahedra or wedges are in an unusual order.

    In an unusual order, some face intersects itself or is bent by a right angle, so the normals at
    its corners point to different sides.  Both senses of rotation are usual.

    Parameters
    ----------
    corners : (n, 6 | 8) int
        May contain repeated corners (collapsed elements).
    nodes : (n_nodes, 3) float

    Returns
    -------
    (n,) bool
    """
    quadrilaterals = np.array([face for face in FACES[corners.shape[1]] if len(face) == 4])
    x = nodes[corners][:, quadrilaterals]  # (n, faces, 4, 3)

    # normal at each corner from the edges to the next and to the previous corner
    to_next = np.roll(x, -1, axis=2) - x
    to_previous = np.roll(x, 1, axis=2) - x
    normal = np.cross(to_next, to_previous)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)

    # a collapsed corner has no normal
    size = np.ptp(x, axis=(1, 2)).max(axis=1)
    has_normal = length > 1e-9 * size[:, None, None, None] ** 2
    unit = np.where(has_normal, normal / np.maximum(length, 1e-300), np.nan)
    # between the normals of corners i and j of face f of element e; a comparison with NaN is False
    cosine = np.einsum("efic,efjc->efij", unit, unit)
    return np.asarray((cosine < LEAST_COSINE).any(axis=(1, 2, 3)))


@dataclass(frozen=True)
class Facets:
    """Faces of elements, grouped by number of nodes.

    Parameters
    ----------
    groups : tuple of (n, 3 | 4 | 6 | 8) int arrays
        Corners counter-clockwise seen from outside, then midside nodes.
    """

    groups: tuple[NDArray, ...]

    def __len__(self) -> int:
        return sum(len(g) for g in self.groups)

    @property
    def nodes(self) -> NDArray:
        """All nodes (n,), ascending without repetition."""
        if not self.groups:
            return np.empty(0, int)
        return np.unique(np.concatenate([group.ravel() for group in self.groups]))

    def each(self) -> list[NDArray]:
        """Return the facets one by one, each as the array of its nodes."""
        return [row for group in self.groups for row in group]

    @property
    def corners(self) -> list[NDArray]:
        """Return the corners (n, 3 | 4) of the facets of each group."""
        return [group[:, : corner_count(group.shape[1])] for group in self.groups]

    def flipped(self) -> Facets:
        """Return the facets with the opposite normal."""
        return Facets(tuple(_reverse(g) for g in self.groups))


def corner_count(n_nodes: int) -> int:
    """Return the number of corners of a facet with 3, 4, 6 or 8 nodes."""
    return {3: 3, 4: 4, 6: 3, 8: 4}[n_nodes]


def _reverse(group: NDArray) -> NDArray:
    n = corner_count(group.shape[1])
    first = group[:, :1]
    other_corners = group[:, 1:n]
    midside = group[:, n:]
    # the first corner stays, so the edge after it becomes the last one
    return np.hstack([first, other_corners[:, ::-1], midside[:, ::-1]])


def area_vectors(facets: Facets, nodes: NDArray) -> NDArray:
    """Return area times outward normal (n, 3) of each facet, m2, by its corners."""
    if not facets.groups:
        return np.zeros((0, 3))
    vectors = []
    for corners in facets.corners:
        x = nodes[corners]
        # a triangle is half the parallelogram of two edges, a quadrilateral half that of its
        # diagonals
        if x.shape[1] == 3:
            side_a = x[:, 1] - x[:, 0]
            side_b = x[:, 2] - x[:, 0]
        else:
            side_a = x[:, 2] - x[:, 0]
            side_b = x[:, 3] - x[:, 1]
        vectors.append(0.5 * np.cross(side_a, side_b))
    return np.concatenate(vectors)


def enclosed_volume(facets: Facets, nodes: NDArray) -> float:
    """Return the volume (m3) of a closed surface by the divergence theorem."""
    volume = 0.0
    for corners in facets.corners:
        x = nodes[corners]
        # triangles of the first corner with two adjacent others, each a tetrahedron with the origin
        for k in range(1, x.shape[1] - 1):
            normal = np.cross(x[:, k], x[:, k + 1])
            volume += float(np.einsum("ij,ij->", x[:, 0], normal)) / 6.0
    return volume


def boundary_facets(elements: Sequence[NDArray], nodes: NDArray) -> Facets:
    """Return the outer faces of solid elements.

    Parameters
    ----------
    elements : sequence of (n, 4 | 6 | 8 | 10 | 15 | 20) int arrays
        Node indices, corners in the usual order first; may contain repeated corners
        (collapsed elements).
    nodes : (n_nodes, 3) float, m

    Raises
    ------
    ValueError
        If the number of nodes of an element is invalid, or a midside node is missing.
    """
    # faces with the same corners belong to adjacent elements
    by_corners: dict[frozenset[int], list[tuple[NDArray, NDArray]]] = {}
    for group in elements:
        n_node = group.shape[1]
        require(n_node in N_CORNER, f"solid elements have {sorted(N_CORNER)} nodes, not {n_node}")
        n_corner = N_CORNER[n_node]
        for face in FACES[n_corner]:
            for element, corner in zip(group, group[:, face]):
                key = frozenset(corner.tolist())
                # a face of a collapsed element may be an edge
                if len(key) >= 3:
                    by_corners.setdefault(key, []).append((corner, element))

    # a face of a single element is on the surface
    facets: dict[int, list[NDArray]] = {}
    for users in by_corners.values():
        if len(users) > 1:
            continue
        corner, element = users[0]
        facet = oriented_facet(corner, element, nodes)
        facets.setdefault(len(facet), []).append(facet)
    return Facets(tuple(np.array(facets[n]) for n in sorted(facets)))


def oriented_facet(corner: NDArray, element: NDArray, nodes: NDArray) -> NDArray:
    """Return one facet of an element with outward normal and midside nodes.

    Repeated corners of collapsed elements are omitted.

    Parameters
    ----------
    corner : (3 | 4,) int
        Corners of the facet in either sense of rotation.
    element : (4 | 6 | 8 | 10 | 15 | 20,) int
    nodes : (n_nodes, 3) float
    """
    differs_from_previous = np.r_[True, corner[1:] != corner[:-1]]
    unique = corner[differs_from_previous]
    if len(unique) > 3 and unique[0] == unique[-1]:
        unique = unique[:-1]
    n_corner = N_CORNER[len(element)]
    centre_of_element = nodes[np.unique(element[:n_corner])].mean(axis=0)
    x = nodes[unique]
    if len(x) == 3:
        normal = np.cross(x[1] - x[0], x[2] - x[0])
    else:
        # the product of the diagonals
        normal = np.cross(x[2] - x[0], x[3] - x[1])
    outward = x.mean(axis=0) - centre_of_element
    if normal @ outward < 0.0:
        unique = unique[::-1]
        x = x[::-1]
    if len(element) == n_corner:
        return unique

    # the midside node of an edge is the one nearest to its middle
    midside = np.unique(element[n_corner:])
    x_next = np.roll(x, -1, axis=0)
    middle = 0.5 * (x + x_next)
    length = np.linalg.norm(x_next - x, axis=1)
    to_midside = nodes[midside][None] - middle[:, None]  # (edge, midside node, 3)
    distance = np.linalg.norm(to_midside, axis=2)
    nearest = distance.argmin(axis=1)
    too_far = np.any(distance.min(axis=1) > 0.3 * length)
    shared = len(np.unique(nearest)) < len(nearest)
    if too_far or shared:
        raise ValueError(
            "second-order element: no midside node between two corners of the face at "
            f"{x.mean(axis=0)} m; the corners are in the wrong order, or the node is missing"
        )
    return np.concatenate([unique, midside[nearest]])


def facets_on_nodes(boundary: Facets, wanted: NDArray) -> Facets:
    """Return the facets of a surface with all corners among the nodes ``wanted`` (n,)."""
    wanted = np.asarray(wanted)
    groups = []
    for group, corners in zip(boundary.groups, boundary.corners):
        on = np.isin(corners, wanted).all(axis=1)
        if on.any():
            groups.append(group[on])
    return Facets(tuple(groups))
