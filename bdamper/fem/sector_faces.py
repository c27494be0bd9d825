r"""Cut faces of a sector, and the motion of one face as a function of the other.

With the rotation R by one pitch, the phase :math:`\varphi = 2\pi d/N` of nodal diameter d and the
side :math:`s = \pm 1` of the dependent face (+1 toward +X),

.. math:: u_{dep} = e^{i s \varphi} R^s\, W u_{ind} .

Row i of W has a single entry 1 if node i of the dependent face is the image of a node of the
independent face.  If the meshes differ, the row contains the shape functions of the facet of the
independent face at node i.  The finer face is dependent, because each of its nodes is then
constrained.  Nodes on the axis of rotation are images of themselves, with the condition
:math:`u = e^{i \varphi} R\, u`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bdamper.fem.contact_patches import SQUARE, inverse_map, shape_functions
from bdamper.fem.surface import Facets, corner_count, facets_on_nodes, require
from bdamper.model.structure import turn

MOST_SECTORS = 1000
"""Largest number of sectors that :func:`find_faces` tries."""


@dataclass(frozen=True)
class SectorFaces:
    """Cut faces of a sector.

    Parameters
    ----------
    n_sectors : int
    independent, dependent : (k,), (m,) int
        Nodes; empty for an acyclic structure.
    weights : (m, k) sparse
        W.
    side : {1, -1}
        1 if the dependent face is toward +X.
    distance : float, m
        Largest distance of a dependent node from the independent face.
    axis : (n,) int
        Nodes on the axis of rotation; ``dependent`` does not contain them.
    """

    n_sectors: int
    independent: NDArray
    dependent: NDArray
    weights: sp.csr_matrix
    side: int = 1
    distance: float = 0.0
    axis: NDArray = field(default_factory=lambda: np.empty(0, int))

    @property
    def nodes(self) -> NDArray:
        """Nodes of both faces without repetition."""
        return np.unique(np.concatenate([self.independent, self.dependent, self.axis]))

    @property
    def matching(self) -> bool:
        """Whether each node of one face is the image of a node of the other face."""
        return self.weights.nnz == len(self.dependent) == len(self.independent)

    def tie(self, nodal_diameter: int) -> tuple[complex, NDArray]:
        """Return phase factor and rotation (3, 3) from the independent to the dependent face."""
        phase = sector_phase(self.n_sectors, nodal_diameter)
        if self.side < 0:
            phase = np.conj(phase)
        rotation = turn(self.side * 2.0 * np.pi / self.n_sectors)
        return phase, rotation

    def among(self, known: NDArray) -> SectorFaces:
        """Return the faces with fewer dependent nodes.

        A dependent node remains if it and all independent nodes that determine it are ``known``,
        (n_nodes,) bool.
        """
        unknown_independent = (~known[self.independent]).astype(float)
        depends_on_unknown = abs(self.weights) @ unknown_independent > 0.0
        kept = known[self.dependent] & ~depends_on_unknown
        return replace(self, dependent=self.dependent[kept], weights=self.weights[kept])

    def images(self, held: NDArray) -> NDArray:
        """Return the mask (n_nodes,) of the nodes ``held`` and of their images."""
        weight = abs(self.weights)
        held_or_image = held.copy()
        # a dependent node is an image if all nodes that carry it are held; smaller weights are
        # rounding of the positions
        carries = weight > 1e-4
        n_free_carriers = carries @ (~held[self.independent]).astype(float)
        held_or_image[self.dependent] |= n_free_carriers == 0.0
        # an independent node is an image if the dependent node nearest to it is held
        nearest = weight > 0.5
        n_held_images = nearest.T @ held[self.dependent].astype(float)
        held_or_image[self.independent] |= n_held_images > 0.0
        return held_or_image


def no_faces() -> SectorFaces:
    """Return the empty faces of an acyclic structure."""
    nothing = np.empty(0, int)
    return SectorFaces(1, nothing, nothing, sp.csr_matrix((0, 0)))


def sector_phase(n_sectors: int, nodal_diameter: int) -> complex:
    """Return ``exp(2 pi i d/N)``, the phase factor to the next sector.

    It is real for d = 0 and d = N/2.
    """
    if nodal_diameter % n_sectors == 0:
        return 1.0
    if 2 * nodal_diameter % n_sectors == 0:
        return -1.0
    return np.exp(2j * np.pi * nodal_diameter / n_sectors)


def match_faces(
    nodes: NDArray,
    left: NDArray,
    right: NDArray,
    n_sectors: int,
    tolerance: float = 1e-8,
    angle: float | None = None,
) -> SectorFaces:
    """Pair the nodes of two sector faces with equal meshes.

    A rotation by one pitch maps the nodes ``left`` onto ``right``.  A mesh with a different angle
    (rad) between its faces is paired by a rotation by ``angle``.

    Raises
    ------
    ValueError
        If the faces do not match node by node within ``tolerance`` (m).
    """
    require(
        len(left) and len(right),
        f"sector faces: expected nodes on both, found {len(left)} and {len(right)}",
    )
    pitch = 2.0 * np.pi / n_sectors if angle is None else angle
    distance, index = cKDTree(nodes[right]).query(nodes[left] @ turn(pitch).T)
    one_to_one = len(left) == len(right) and len(np.unique(index)) == len(index)
    if not one_to_one or distance.max() > tolerance:
        found = f"{len(left)} and {len(right)} nodes, largest distance {distance.max():.3g} m"
        raise ValueError(f"sector faces do not match under rotation by {pitch:.6g} rad: {found}")
    image = right[index]
    on_axis = left == image
    independent = left[~on_axis]
    return SectorFaces(
        n_sectors=n_sectors,
        independent=independent,
        dependent=image[~on_axis],
        weights=sp.identity(len(independent), format="csr"),
        side=1,
        distance=float(distance.max()),
        axis=left[on_axis],
    )


def tie_faces(
    nodes: NDArray,
    surface: Facets,
    left: NDArray,
    right: NDArray,
    n_sectors: int,
    angle: float | None = None,
) -> SectorFaces:
    """Tie the two faces of a sector with different meshes.

    The finer face follows the coarser one by interpolation.

    Parameters
    ----------
    nodes : (n_nodes, 3) float, m
    surface : Facets
        Outer faces of the elements.
    left, right : (k,), (m,) int
        Nodes of the faces toward -X and toward +X.
    n_sectors : int
    angle : float, rad, optional
        Angle between the faces of the mesh, if other than one pitch.

    Returns
    -------
    SectorFaces
        ``distance`` is the largest distance of a node from the interpolated face.

    Raises
    ------
    ValueError
        If the nodes of the coarser face contain no element face.
    """
    if len(right) >= len(left):
        side = 1
        independent = left
        dependent = right
    else:
        side = -1
        independent = right
        dependent = left
    axis = np.intersect1d(left, right)
    dependent = np.setdiff1d(dependent, axis)
    facets = facets_on_nodes(surface, independent)
    require(
        len(facets),
        "different meshes, and no element face whose nodes all lie on the coarser sector face",
    )
    if angle is None:
        angle = 2.0 * np.pi / n_sectors
    rotated_back = nodes[dependent] @ turn(-side * angle).T
    weights, distance = interpolation(nodes, facets, rotated_back)
    # nodes of the coarser face outside of all its facets carry nothing
    carriers = facets.nodes
    return SectorFaces(
        n_sectors=n_sectors,
        independent=carriers,
        dependent=dependent,
        weights=weights[:, carriers].tocsr(),
        side=side,
        distance=float(distance.max()),
        axis=axis,
    )


def interpolation(nodes: NDArray, facets: Facets, points: NDArray) -> tuple[sp.csr_matrix, NDArray]:
    """Interpolate between the nodes of facets at the positions closest to given points.

    Parameters
    ----------
    nodes : (n_nodes, 3) float, m
    facets : Facets
    points : (n, 3) float, m

    Returns
    -------
    weights : (n, n_nodes) sparse
        Each row has the sum 1.
    distance : (n,) float, m
        Distance between points and interpolated positions.  Outside of all facets it may be too
        large, by some tens of per cent at most.
    """
    rows = facets.each()
    centres = np.array([nodes[row].mean(axis=0) for row in rows])
    size = np.array([np.ptp(nodes[row], axis=0).max() for row in rows])
    # the facet of a point is one of the six whose centres are nearest to it
    _, near = cKDTree(centres).query(points, k=min(6, len(rows)))
    near = near.reshape(len(points), -1)

    distance = np.full(len(points), np.inf)
    best_nodes = [np.empty(0, int)] * len(points)
    best_weights = [np.empty(0)] * len(points)
    for k in np.unique(near):
        row = rows[k]
        nearby = np.flatnonzero((near == k).any(axis=1))
        values = _closest_on_facet(nodes[row], size[k], points[nearby])
        away = np.linalg.norm(values @ nodes[row] - points[nearby], axis=1)
        for i, distance_to_facet, weights_on_facet in zip(nearby.tolist(), away.tolist(), values):
            if distance_to_facet < distance[i]:
                distance[i] = distance_to_facet
                best_nodes[i] = row
                best_weights[i] = weights_on_facet

    pointer = np.cumsum([0, *(len(row) for row in best_nodes)])
    columns = np.concatenate(best_nodes)
    data = np.concatenate(best_weights)
    weights = sp.csr_matrix((data, columns, pointer), shape=(len(points), len(nodes)))
    weights.eliminate_zeros()
    return weights, distance


def _closest_on_facet(facet: NDArray, size: float, points: NDArray) -> NDArray:
    """Return shape functions (n, n_nodes) at the positions on a facet closest to points (n, 3).

    ``facet`` (n_nodes, 3) are the positions of its nodes, ``size`` is its largest extent (m).
    """
    n_nodes = len(facet)
    n_corners = corner_count(n_nodes)
    corner = facet[:n_corners]
    # the first two principal axes of the corners lie along the facet
    _, _, principal_axes = np.linalg.svd(corner - corner.mean(axis=0))
    plane = principal_axes[:2].T
    corner_in_plane = corner @ plane
    facet_in_plane = facet @ plane
    points_in_plane = points @ plane

    # The inverse map assumes straight edges.  On a facet with curved edges it misses the points, so
    # its targets are moved by the miss until the shape functions reach the points.
    target = points_in_plane.copy()
    for _ in range(20):
        reference = inverse_map(corner_in_plane, target)
        position = shape_functions(reference, n_nodes) @ facet_in_plane
        miss = points_in_plane - position
        target += np.clip(miss, -size, size)
        if np.abs(miss).max() < 1e-12 * size:
            break
    return shape_functions(_moved_inside(reference, n_corners), n_nodes)


def _moved_inside(reference: NDArray, n_corners: int) -> NDArray:
    """Return coordinates on the reference facet, moved to its edge if they lie outside.

    They are points of the square (n, 2), or barycentric coordinates (n, 3) of the triangle.
    """
    limited = np.clip(reference, SQUARE.min(), SQUARE.max())
    if n_corners == 4:
        return limited
    # barycentric coordinates are not negative and have the sum 1
    positive = np.maximum(limited, 0.0)
    return positive / positive.sum(axis=1, keepdims=True)


def find_faces(
    nodes: NDArray, surface: Facets, n_sectors: int | None, tolerance: float
) -> SectorFaces | None:
    """Find the cut faces of a sector by geometry: nodes mapped onto other nodes by one rotation.

    Rotations by ``2 pi/N`` are tried for N = 2, 3, ..., because a rotation below one pitch may also
    map a regular mesh onto itself.

    Parameters
    ----------
    nodes, surface
        See :func:`tie_faces`.
    n_sectors : int, optional
        Only this number is tried; any if omitted.
    tolerance : float, m

    Returns
    -------
    SectorFaces or None
        None if no rotation maps an element face onto another element face.
    """
    outer = surface.nodes
    tree = cKDTree(nodes[outer])
    candidates = range(2, MOST_SECTORS + 1) if n_sectors is None else (n_sectors,)
    for n in candidates:
        rotated = nodes[outer] @ turn(2.0 * np.pi / n).T
        distance, index = tree.query(rotated, distance_upper_bound=tolerance)
        has_image = np.isfinite(distance)
        left = outer[has_image]
        right = outer[index[has_image]]
        n_facets_left = len(facets_on_nodes(surface, left))
        n_facets_right = len(facets_on_nodes(surface, right))
        # nodes on the axis are their own images
        only_axis = len(np.union1d(left, right)) == len(left)
        if n_facets_left and n_facets_right and not only_axis:
            return match_faces(nodes, left, right, n, tolerance)
    return None
