r"""Cut faces of a sector, and the motion of one face as a function of the other.

With the rotation R by one pitch, the phase :math:`\varphi = 2\pi d/N` of nodal diameter d and the
side :math:`s = \pm 1` of the dependent face (+1 toward +X),

.. math:: u_{dep} = e^{i s \varphi} R^s\, W u_{ind} .

Row i of W has a single entry 1 if node i of the dependent face is the image of a node of the
independent face.  If the meshes differ, the row contains the shape functions of the facet of the
independent face at node i.  The finer face is dependent, since each of its nodes is then
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
from bdamper.fem.surface import Facets, check, corner_count, facets_on_nodes
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
        return np.conj(phase) if self.side < 0 else phase, turn(
            self.side * 2.0 * np.pi / self.n_sectors
        )

    def among(self, known: NDArray) -> SectorFaces:
        """Keep the dependent nodes that are ``known`` (n_nodes,) bool and determined by known
        independent nodes."""
        unknown = abs(self.weights) @ (~known[self.independent]).astype(float) > 0.0
        rows = known[self.dependent] & ~unknown
        return replace(self, dependent=self.dependent[rows], weights=self.weights[rows])

    def images(self, held: NDArray) -> NDArray:
        """Return the mask (n_nodes,) of the nodes ``held`` and of their images on the other
        face."""
        out, size = held.copy(), abs(self.weights)
        out[self.dependent] |= (size > 1e-4) @ (~held[self.independent]).astype(
            float
        ) == 0.0  # positions are rounded
        out[self.independent] |= (size > 0.5).T @ held[self.dependent].astype(
            float
        ) > 0.0  # the nearest one
        return out


def no_faces() -> SectorFaces:
    """Return the empty faces of an acyclic structure."""
    nothing = np.empty(0, int)
    return SectorFaces(1, nothing, nothing, sp.csr_matrix((0, 0)))


def sector_phase(n_sectors: int, nodal_diameter: int) -> complex:
    """Return ``exp(2 pi i d/N)``, the phase factor to the next sector; real for d = 0 and d =
    N/2."""
    if 2 * nodal_diameter % n_sectors == 0:
        return -1.0 if nodal_diameter % n_sectors else 1.0
    return np.exp(2j * np.pi * nodal_diameter / n_sectors)


def match_faces(
    nodes: NDArray,
    left: NDArray,
    right: NDArray,
    n_sectors: int,
    tolerance: float = 1e-8,
    angle: float | None = None,
) -> SectorFaces:
    """Pair the nodes of two sector faces with equal meshes: a rotation by one pitch maps the nodes
    ``left`` onto ``right``.

    A mesh with another angle (rad) between its faces is paired by a rotation by ``angle``.

    Raises
    ------
    ValueError
        If the faces do not match node by node within ``tolerance`` (m).
    """
    check(
        len(left) and len(right),
        f"sector faces with {len(left)} and {len(right)} nodes: none may be empty",
    )
    pitch = 2.0 * np.pi / n_sectors if angle is None else angle
    distance, index = cKDTree(nodes[right]).query(nodes[left] @ turn(pitch).T)
    if len(left) != len(right) or distance.max() > tolerance or len(np.unique(index)) != len(index):
        found = f"{len(left)} and {len(right)} nodes, largest distance {distance.max():.3g} m"
        raise ValueError(f"sector faces do not match under rotation by {pitch:.6g} rad: {found}")
    on_axis = left == right[index]
    independent, image = left[~on_axis], right[index][~on_axis]
    weights = sp.identity(len(independent), format="csr")
    return SectorFaces(
        n_sectors, independent, image, weights, 1, float(distance.max()), left[on_axis]
    )


def tie_faces(
    nodes: NDArray,
    surface: Facets,
    left: NDArray,
    right: NDArray,
    n_sectors: int,
    angle: float | None = None,
) -> SectorFaces:
    """Tie the two faces of a sector with different meshes: the finer face follows the coarser one
    by interpolation.

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
    side = 1 if len(right) >= len(left) else -1
    independent, dependent = (left, right) if side > 0 else (right, left)
    axis = np.intersect1d(left, right)
    dependent = np.setdiff1d(dependent, axis)
    facets = facets_on_nodes(surface, independent)
    check(
        len(facets), "meshes that differ, and no face of an element on the nodes of the coarser one"
    )
    target = (
        nodes[dependent] @ turn(-side * (2.0 * np.pi / n_sectors if angle is None else angle)).T
    )
    weights, distance = interpolation(nodes, facets, target)
    corners = facets.nodes
    return SectorFaces(
        n_sectors,
        corners,
        dependent,
        weights[:, corners].tocsr(),
        side,
        float(distance.max()),
        axis,
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
    near = np.atleast_2d(
        cKDTree(centres).query(points, k=min(6, len(rows)))[1].reshape(len(points), -1)
    )
    distance, best = np.full(len(points), np.inf), [(np.empty(0, int), np.empty(0))] * len(points)
    for k in np.unique(near):
        row, nearby = rows[k], np.flatnonzero((near == k).any(axis=1))
        corner = nodes[row[: corner_count(len(row))]]
        across = np.linalg.svd(corner - corner.mean(axis=0))[2][:2].T
        aim = points[nearby] @ across
        for _ in range(20):  # iterate: the first map uses corners alone, without curved edges
            at = inverse_map(corner @ across, aim)
            miss = points[nearby] @ across - shape_functions(at, len(row)) @ (nodes[row] @ across)
            aim += np.clip(miss, -size[k], size[k])
            if np.abs(miss).max() < 1e-12 * size[k]:
                break
        at = np.clip(at, SQUARE.min(), SQUARE.max())
        if len(corner) == 3:
            at = np.maximum(at, 0.0) / np.maximum(at, 0.0).sum(axis=1, keepdims=True)
        values = shape_functions(at, len(row))
        away = np.linalg.norm(values @ nodes[row] - points[nearby], axis=1)
        for i, d, value in zip(nearby.tolist(), away.tolist(), values):
            if d < distance[i]:
                distance[i], best[i] = d, (row, value)
    pointer = np.cumsum([0, *(len(row) for row, _ in best)])
    columns, data = (np.concatenate(part) for part in zip(*best))
    weights = sp.csr_matrix((data, columns, pointer), shape=(len(points), len(nodes)))
    weights.eliminate_zeros()
    return weights, distance


def find_faces(
    nodes: NDArray, surface: Facets, n_sectors: int | None, tolerance: float
) -> SectorFaces | None:
    """Find the cut faces of a sector by geometry: nodes mapped onto other nodes by one rotation.

    Rotations by ``2 pi/N`` are tried for N = 2, 3, ..., since a rotation below one pitch may also
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
    for n in range(2, MOST_SECTORS + 1) if n_sectors is None else (n_sectors,):
        distance, index = tree.query(
            nodes[outer] @ turn(2.0 * np.pi / n).T, distance_upper_bound=tolerance
        )
        on = np.isfinite(distance)
        left, right = outer[on], outer[index[on]]
        whole = all(len(facets_on_nodes(surface, face)) for face in (left, right))
        if whole and len(np.union1d(left, right)) > len(left):  # more than nodes on the axis
            return match_faces(nodes, left, right, n, tolerance)
    return None
