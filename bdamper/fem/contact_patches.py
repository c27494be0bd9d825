r"""Contact points as averages over patches of two faces, with matching or different meshes.

Each patch is one contact point.  Displacement and force of patch i with area :math:`A_i` are

.. math:: B_i = \frac{1}{A_i}\int_{A_i} N\,dA, \qquad u_i = B_i u, \qquad
          f = \textstyle\sum_i B_i^T F_i .

A force is thus distributed uniformly over its patch and does work on the mean displacement.  With
mesh refinement, receptances between single nodes diverge, while receptances between patches
converge.

Facets of both bodies are projected onto the plane of the face and intersected with each other and
with the patch (Sutherland-Hodgman).  Each intersection lies in one facet of either body.  It is
divided into triangles with seven integration points for the shape functions of both facets, so both
bodies are averaged over the same area.  The map from the reference square or triangle to the plane
uses the corners of a facet; Newton iteration inverts it.  The weights of a patch are normalised to
the sum 1, so that the mean of a rigid motion is exact up to rounding.

A mesh with m lines of nodes along a direction can represent m independent patch means in this
direction.  With more patches, there are combinations of forces for which the mesh has no
flexibility; they make contact springs too stiff.  The number of patches is therefore limited by the
coarser mesh (:func:`resolved_grid`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fem.surface import Facets, area_vectors, corner_count, require
from bdamper.util import quantities, validation


def _seven_points() -> tuple[NDArray, NDArray]:
    """Return barycentric coordinates (7, 3) and weights (7,) of a rule on a triangle.

    The weights have the sum 1.  The rule is exact for polynomials of degree 5.
    """
    root = np.sqrt(15.0)
    near = (6.0 - root) / 21.0
    far = (6.0 + root) / 21.0
    middle = np.full((1, 3), 1.0 / 3.0)
    near_corners = np.full((3, 3), near) + (1.0 - 3.0 * near) * np.eye(3)
    far_corners = np.full((3, 3), far) + (1.0 - 3.0 * far) * np.eye(3)
    coordinates = np.concatenate([middle, near_corners, far_corners])
    weights = [0.225, (155.0 - root) / 1200.0, (155.0 + root) / 1200.0]
    return coordinates, np.repeat(weights, (1, 3, 3))


_BARYCENTRIC, _WEIGHTS = _seven_points()

SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
"""Corners of the reference square of a facet."""

SIDES = np.array([[0, -1], [0, 1], [1, 0], [-1, 0]], float)
"""Directions of the sides of a rectangle counter-clockwise: left, right, bottom, top."""

SMALL_CELL = 0.02
"""Covered fraction of a grid cell below which the covered part is added to the neighbouring
patch."""


@dataclass(frozen=True)
class Patches:
    """Rectangular patches in planes, all of one interface.

    Parameters
    ----------
    centre : (n, 3) float, m
    frame : (n, 3, 3) float
        Rows t1, t2, n.
    size : (n, 2) float, m
        Edges along t1 and t2.
    """

    centre: NDArray
    frame: NDArray
    size: NDArray

    def __post_init__(self) -> None:
        validation.check_attributes(self, quantities.in_lists, "centre", "size", unit="m")

    @property
    def area(self) -> NDArray:
        """Areas (n,), m2."""
        return self.size.prod(axis=1)

    def turned(self, rotation: NDArray) -> Patches:
        """Return the patches after a rotation (3, 3)."""
        return Patches(self.centre @ rotation.T, self.frame @ rotation.T, self.size)


class MeshLines(NamedTuple):
    """Numbers of node lines of a face along t1 and t2, and number of its nodes."""

    along_1: int
    along_2: int
    nodes: int


@dataclass(frozen=True)
class PatchMeans:
    """Means over patches on the face of one body, or on the common area of two faces.

    Parameters
    ----------
    area : (n,) float, m2
    frame : (n, 3, 3) float
        Rows t1, t2, n.
    points_a, points_b : (n, 3) float, m
        Mean positions on each body; b is None without a second body.
    matrix_a, matrix_b : (3 n, 3 n_nodes) sparse
        Matrices from nodal displacements to patch means along t1, t2, n.
    grid : (int, int)
        Numbers of rows of a grid along t1 and t2; (0, 0) if the patches are not a grid.
    lines : tuple of MeshLines
        Lines of nodes of face a, and of face b if there is one, in the common area of a grid.
    """

    area: NDArray
    frame: NDArray
    points_a: NDArray
    points_b: NDArray | None
    matrix_a: sp.csr_matrix
    matrix_b: sp.csr_matrix | None
    grid: tuple[int, int] = (0, 0)
    lines: tuple[MeshLines, ...] = ()

    @property
    def distance(self) -> NDArray:
        """Mean normal distance (n,) of the two faces, m; zero without a second face."""
        if self.points_b is None:
            return np.zeros(len(self.area))
        return np.einsum("ij,ij->i", self.frame[:, 2], self.points_b - self.points_a)


def patch_grid(points: int | tuple[int, int], length: float, width: float) -> tuple[int, int]:
    """Return the number of patches along the two edges of a face.

    A single number is factorised.  If possible, both edges have at least three patches; then the
    patches are as close to squares as possible.
    """
    if not isinstance(points, (int, np.integer)):
        return int(points[0]), int(points[1])
    require(points >= 1, f"points must be at least 1, not {points}")
    # nine points are always three by three, although longer patches may be closer to squares
    root = round(np.sqrt(points))
    if root * root == points:
        return root, root

    def penalty(n_along: int) -> tuple[bool, float, int]:
        n_across = points // n_along
        has_few = min(n_along, n_across) < 3
        slenderness = abs(np.log(length / n_along / (width / n_across)))
        return has_few, slenderness, n_along

    factors = [n for n in range(1, points + 1) if points % n == 0]
    n_along = min(factors, key=penalty)
    return n_along, points // n_along


def resolved_grid(
    points: int | tuple[int, int], length: float, width: float, lines: Sequence[MeshLines]
) -> tuple[int, int]:
    """Return the numbers of patches along the two edges of a face that its meshes resolve.

    Two numbers do not change, nor does a single number whose grid the meshes resolve.  Otherwise
    the result is the grid with the most patches, not more than this number, and as close to squares
    as possible; three rows along t1 are allowed on any mesh.

    Parameters
    ----------
    points : int or (int, int)
    length, width : float, m
    lines : sequence of MeshLines
        Lines of nodes of the face of each body.
    """
    given = patch_grid(points, length, width)
    if not isinstance(points, (int, np.integer)):
        return given
    # a damper with fewer rows rolls on its faces
    most_along = max(3, min(face.along_1 for face in lines))
    most_across = min(face.along_2 for face in lines)
    # eight-node facets have no node in the middle
    most = min(points, *(face.nodes for face in lines))
    if given[0] <= most_along and given[1] <= most_across and points <= most:
        return given

    # tuples are compared part by part: first by the number of patches, then False before True,
    # then by the shape of a patch
    def penalty(grid: tuple[int, int]) -> tuple[int, bool, float]:
        n_along, n_across = grid
        n_patches = n_along * n_across
        has_few_rows = min(grid) < 3
        slenderness = abs(np.log(length / n_along / (width / n_across)))
        return -n_patches, has_few_rows, slenderness

    grids = [
        (n_along, n_across)
        for n_along in range(min(3, most), most_along + 1)
        for n_across in range(1, most_across + 1)
        if n_along * n_across <= most
    ]
    return min(grids, key=penalty)


def mean_frame(facets: Facets, nodes: NDArray) -> NDArray:
    """Return the contact axes t1, t2, n of a face as rows (3, 3).

    The normal n is the mean outward normal, and t2 points in the negative Z direction.  If the
    normal is along the axis of rotation, t1 is the direction of motion of the centre in a rotation
    toward +X.

    Raises
    ------
    ValueError
        If the normals of the facets have no common side.
    """
    vectors = area_vectors(facets, nodes)
    total = vectors.sum(axis=0)
    area = np.linalg.norm(vectors, axis=1).sum()
    expected = "expected one face, with all facets seen from outside counter-clockwise"
    require(
        np.linalg.norm(total) > 0.5 * area,
        f"the normals of its facets do not all point to the same side: {expected}",
    )
    n = total / np.linalg.norm(total)
    axial = np.array([0.0, 0.0, 1.0])
    # the part of -Z in the plane of the face
    t2 = n * n[2] - axial
    if np.linalg.norm(t2) > 0.1:
        t2 /= np.linalg.norm(t2)
        return np.array([np.cross(t2, n), t2, n])
    # the normal is along the axis of rotation
    centre = nodes[facets.nodes].mean(axis=0)
    angle = np.arctan2(centre[0], centre[1])
    t1 = np.array([np.cos(angle), -np.sin(angle), 0.0])
    t1 -= n * (n @ t1)
    t1 /= np.linalg.norm(t1)
    return np.array([t1, np.cross(n, t1), n])


# --------------------------------------------------------------------------------------------------
# Shape functions


def serendipity(xi: NDArray) -> NDArray:
    """Return the shape functions (m, 8) of the quadrilateral with midpoints of its edges.

    The corners are in the order of ``SQUARE``.
    """
    a = xi[:, :1]
    b = xi[:, 1:]
    corner_a = SQUARE[:, 0]
    corner_b = SQUARE[:, 1]
    corners = 0.25 * (1 + a * corner_a) * (1 + b * corner_b) * (a * corner_a + b * corner_b - 1)
    bottom = 0.5 * (1 - a**2) * (1 - b)
    right = 0.5 * (1 + a) * (1 - b**2)
    top = 0.5 * (1 - a**2) * (1 + b)
    left = 0.5 * (1 - a) * (1 - b**2)
    return np.hstack([corners, bottom, right, top, left])


def _bilinear(xi: NDArray) -> NDArray:
    """Return the shape functions (m, 4) of the corners of the quadrilateral."""
    a = xi[:, :1]
    b = xi[:, 1:]
    return 0.25 * (1 + a * SQUARE[:, 0]) * (1 + b * SQUARE[:, 1])


def shape_functions(xi: NDArray, n_nodes: int) -> NDArray:
    """Return the shape functions (m, n_nodes) of a facet with 3, 4, 6 or 8 nodes.

    ``xi`` are points of the square (m, 2), or barycentric coordinates (m, 3) of the triangle.
    """
    if n_nodes == 4:
        return _bilinear(xi)
    if n_nodes == 8:
        return serendipity(xi)
    if n_nodes == 3:
        return xi
    corners = xi * (2 * xi - 1)
    edges = 4 * xi * np.roll(xi, -1, axis=1)
    return np.hstack([corners, edges])


def inverse_map(corner: NDArray, x: NDArray) -> NDArray:
    """Return the coordinates on the reference facet of points ``x`` (m, 2) in a facet.

    Parameters
    ----------
    corner : (3 | 4, 2) float
        Corners of the facet.
    x : (m, 2) float

    Returns
    -------
    (m, 3) or (m, 2) float
        Barycentric coordinates of a triangle, or coordinates from -1 to 1 of a quadrilateral.
    """
    if len(corner) == 3:
        edges = np.stack([corner[1] - corner[0], corner[2] - corner[0]], axis=1)
        along_edges = np.linalg.solve(edges, (x - corner[0]).T).T
        return np.column_stack([1.0 - along_edges.sum(axis=1), along_edges])
    # Newton's method for both coordinates of all points, with Cramer's rule for the two unknowns
    xi = np.zeros_like(x)
    for _ in range(20):
        # derivatives (m, 2) of the position by the first and by the second coordinate
        d_xi = 0.25 * SQUARE[:, 0] * (1 + xi[:, 1:] * SQUARE[:, 1]) @ corner
        d_eta = 0.25 * SQUARE[:, 1] * (1 + xi[:, :1] * SQUARE[:, 0]) @ corner
        residual = x - _bilinear(xi) @ corner
        determinant = d_xi[:, 0] * d_eta[:, 1] - d_xi[:, 1] * d_eta[:, 0]
        along_xi = residual[:, 0] * d_eta[:, 1] - residual[:, 1] * d_eta[:, 0]
        along_eta = d_xi[:, 0] * residual[:, 1] - d_xi[:, 1] * residual[:, 0]
        step = np.stack([along_xi / determinant, along_eta / determinant], axis=-1)
        xi += step
        if np.abs(step).max() < 1e-14:
            break
    return xi


# --------------------------------------------------------------------------------------------------
# Polygons


def _cut(polygon: NDArray, inside: NDArray) -> NDArray:
    """Return the part (m, 2) of a convex polygon on one side of a line.

    ``inside`` are the distances of its corners from the line, positive on the side that stays.
    """
    if inside.min() >= 0.0:
        return polygon
    corners = []
    for k in range(len(polygon)):
        before = polygon[k - 1]
        corner = polygon[k]
        distance_before = inside[k - 1]
        distance = inside[k]
        # the line cuts the edge between both corners
        if distance_before * distance < 0.0:
            edge = corner - before
            corners.append(before + edge * distance_before / (distance_before - distance))
        if distance >= 0.0:
            corners.append(corner)
    return np.array(corners) if len(corners) >= 3 else np.empty((0, 2))


def rectangle(low: NDArray, high: NDArray) -> NDArray:
    """Return points (4, 2) on the sides ``SIDES`` of the rectangle from ``low`` (2,) to ``high``
    (2,)."""
    return np.array([low, high, low, high])


def clip_to_polygon(polygon: NDArray, window: NDArray, sides: NDArray | None = None) -> NDArray:
    """Return the part (m, 2) of a convex polygon inside a convex, counter-clockwise ``window``
    (k, 2).

    ``sides`` (k, 2) are the directions from its corners, by default to the next corners.
    """
    if sides is None:
        sides = np.roll(window, -1, axis=0) - window
    for corner, side in zip(window, sides):
        if len(polygon) == 0:
            return polygon
        x = polygon[:, 0] - corner[0]
        y = polygon[:, 1] - corner[1]
        # positive on the left of the side
        polygon = _cut(polygon, side[0] * y - side[1] * x)
    return polygon


def overlaps(
    polygons: Sequence[NDArray], windows: Sequence[NDArray], sides: NDArray | None = None
) -> Iterator[tuple[int, int, NDArray]]:
    """Intersect convex polygons with windows.

    Iterate over both numbers and the intersection (m, 2) of each overlap.  For the parameters see
    :func:`clip_to_polygon`.
    """
    low = np.array([np.min(window, axis=0) for window in windows]).reshape(-1, 2)
    high = np.array([np.max(window, axis=0) for window in windows]).reshape(-1, 2)
    for k, polygon in enumerate(polygons):
        # windows whose bounding boxes overlap that of the polygon
        begins_before_end = low < polygon.max(axis=0)
        ends_after_begin = high > polygon.min(axis=0)
        near = np.all(begins_before_end & ends_after_begin, axis=1)
        for m in np.flatnonzero(near).tolist():
            part = clip_to_polygon(polygon, windows[m], sides)
            if len(part) >= 3:
                yield k, m, part


def polygon_area(polygon: NDArray) -> float:
    """Return the signed area of a polygon (m, 2)."""
    x = polygon[:, 0]
    y = polygon[:, 1]
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _quadrature(polygon: NDArray) -> tuple[NDArray, NDArray]:
    """Return points (m, 2) and weights (m,) of quadrature on a convex polygon (n, 2).

    The sum of the weights is its area.
    """
    # a fan of n - 2 triangles from the first corner: (n - 2, 3, 2)
    first = np.broadcast_to(polygon[0], polygon[2:].shape)
    triangles = np.stack([first, polygon[1:-1], polygon[2:]], axis=1)
    side_1 = triangles[:, 1] - triangles[:, 0]
    side_2 = triangles[:, 2] - triangles[:, 0]
    area = 0.5 * np.abs(side_1[:, 0] * side_2[:, 1] - side_1[:, 1] * side_2[:, 0])
    points = (_BARYCENTRIC @ triangles).reshape(-1, 2)
    return points, np.outer(area, _WEIGHTS).ravel()


# --------------------------------------------------------------------------------------------------
# Patches over faces


class _Flat(NamedTuple):
    """Facets of one body projected onto a plane, with nodes and convex, counter-clockwise
    corners."""

    nodes: list[NDArray]
    corner: list[NDArray]


def _flatten(facets: Facets, nodes: NDArray, origin: NDArray, frame: NDArray, what: str) -> _Flat:
    """Project facets onto a plane and reverse clockwise ones.

    Raises
    ------
    ValueError
        If a facet is folded.
    """
    flat = _Flat([], [])
    for row in facets.each():
        n = corner_count(len(row))
        corners = (nodes[row[:n]] - origin) @ frame[:2].T
        if polygon_area(corners) < 0.0:
            row = Facets((row[None],)).flipped().groups[0][0]
            corners = (nodes[row[:n]] - origin) @ frame[:2].T
        ahead = np.roll(corners, -1, axis=0) - corners
        behind = corners - np.roll(corners, 1, axis=0)
        bend = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
        is_convex = bend.min() >= -1e-6 * bend.max()
        if not (polygon_area(corners) > 0.0 and is_convex):
            middle = nodes[row[:n]].mean(axis=0)
            raise ValueError(f"a facet of {what} at {middle} m is folded or seen edge-on")
        flat.nodes.append(row)
        flat.corner.append(corners)
    return flat


class _Piece(NamedTuple):
    """Part of a facet of face a, or of its intersection with a facet of face b.

    Parameters
    ----------
    polygon : (m, 2) float
    a, b : int
        Numbers of the facets; b is -1 without a second face.
    """

    polygon: NDArray
    a: int
    b: int


def _pieces(flat_a: _Flat, flat_b: _Flat | None) -> list[_Piece]:
    """Return the intersections of the facets of both faces."""
    if flat_b is None:
        return [_Piece(corner, k, -1) for k, corner in enumerate(flat_a.corner)]
    return [_Piece(part, k, m) for k, m, part in overlaps(flat_a.corner, flat_b.corner)]


def _lines(
    pieces: Sequence[_Piece], flat: _Flat, side: Literal["a", "b"], extent: NDArray
) -> MeshLines:
    """Return the mean numbers of lines of nodes of one face in the common area of both.

    Parameters
    ----------
    pieces : sequence of _Piece
        Common area.
    flat : _Flat
        Facets of this face.
    side : {"a", "b"}
        Face that ``flat`` is.
    extent : (2,) float, m
        Lengths of the common area along t1 and t2.
    """
    area_of_facet: dict[int, float] = {}
    for piece in pieces:
        facet = piece.a if side == "a" else piece.b
        area_of_facet[facet] = area_of_facet.get(facet, 0.0) + polygon_area(piece.polygon)
    # distances (2,) between the lines of nodes along t1 and t2 for each facet
    spacing = []
    for facet in area_of_facet:
        corner = flat.corner[facet]
        has_midpoints = len(flat.nodes[facet]) > len(corner)
        spacing.append(np.ptp(corner, axis=0) / (2.0 if has_midpoints else 1.0))
    # a coarse part of the mesh counts by its area, which contains a share of the equal patches
    mean_spacing = np.average(spacing, axis=0, weights=list(area_of_facet.values()))
    n_intervals = np.maximum(np.rint(extent / mean_spacing), 1.0)
    # all nodes of a facet count, even if the area covers only a part of it
    nodes = np.unique(np.concatenate([flat.nodes[facet] for facet in area_of_facet]))
    return MeshLines(
        along_1=int(n_intervals[0]) + 1, along_2=int(n_intervals[1]) + 1, nodes=len(nodes)
    )


def _cells(
    pieces: Sequence[_Piece], windows: Sequence[NDArray], above: float = -np.inf
) -> list[list[_Piece]]:
    """Return the parts of the pieces in each rectangle with an area larger than ``above`` (m2)."""
    cells: list[list[_Piece]] = [[] for _ in windows]
    polygons = [piece.polygon for piece in pieces]
    for piece_number, window_number, part in overlaps(polygons, windows, SIDES):
        if polygon_area(part) > above:
            cells[window_number].append(pieces[piece_number]._replace(polygon=part))
    return cells


class _Entries(NamedTuple):
    """Integrals of the shape functions of a facet over a piece of a cell.

    Parameters
    ----------
    cell, node : (m,) int
    integral : (m,) float, m2
    """

    cell: NDArray
    node: NDArray
    integral: NDArray


def _means(
    cells: list[list[_Piece]],
    frames: NDArray,
    flats: tuple[_Flat, _Flat | None],
    bodies: tuple[NDArray, NDArray | None],
) -> PatchMeans:
    """Integrate the shape functions of both bodies over the pieces of each cell.

    Parameters
    ----------
    cells : list of n lists of pieces
    frames : (n, 3, 3) float
        Axes t1, t2, n of each cell as rows.
    flats, bodies
        Projected facets, and nodes (n_nodes, 3), of bodies a and b; None without body b.
    """
    n = len(cells)
    area = np.zeros(n)
    entries_a: list[_Entries] = []
    entries_b: list[_Entries] = []
    flat_a, flat_b = flats

    def integrals(i: int, flat: _Flat, facet: int, points: NDArray, weights: NDArray) -> _Entries:
        """Integrate the shape functions of a facet over a piece of cell i."""
        facet_nodes = flat.nodes[facet]
        xi = inverse_map(flat.corner[facet], points)
        values = weights @ shape_functions(xi, len(facet_nodes))
        return _Entries(np.full(len(facet_nodes), i), facet_nodes, values)

    for i, pieces in enumerate(cells):
        for piece in pieces:
            points, weights = _quadrature(piece.polygon)
            area[i] += weights.sum()
            entries_a.append(integrals(i, flat_a, piece.a, points, weights))
            if flat_b is not None:
                entries_b.append(integrals(i, flat_b, piece.b, points, weights))
    turn_rows = sp.block_diag(list(frames), format="csr")

    def on_body(entries: list[_Entries], nodes: NDArray) -> tuple[NDArray, sp.csr_matrix]:
        """Return the mean positions (n, 3), and the matrix (3 n, 3 n_nodes) of mean motion along
        the axes of the cells."""
        rows = np.concatenate([entry.cell for entry in entries])
        columns = np.concatenate([entry.node for entry in entries])
        values = np.concatenate([entry.integral for entry in entries])
        integral = sp.csr_matrix((values, (rows, columns)), shape=(n, len(nodes)))
        # weights of the sum 1 leave a rigid motion unchanged
        mean = sp.diags(1.0 / (integral @ np.ones(len(nodes)))) @ integral
        matrix = (turn_rows @ sp.kron(mean, sp.identity(3), format="csr")).tocsr()
        return mean @ nodes, matrix

    nodes_a, nodes_b = bodies
    points_a, matrix_a = on_body(entries_a, nodes_a)
    points_b = None
    matrix_b = None
    if nodes_b is not None:
        points_b, matrix_b = on_body(entries_b, nodes_b)
    return PatchMeans(area, frames, points_a, points_b, matrix_a, matrix_b)


def patches_on_rectangles(
    patches: Patches, nodes: NDArray, facets: Facets, what: str = "the surface of the body"
) -> PatchMeans:
    """Compute means over rectangles on the surface of one body.

    Parameters
    ----------
    patches : Patches
        Patches in one plane, with one frame.
    nodes : (n_nodes, 3) float, m
    facets : Facets
        Part of the surface that contains the patches; facets outside the plane have no effect.
    what : str
        Name of the surface in messages.

    Returns
    -------
    PatchMeans

    Raises
    ------
    ValueError
        If the surface does not cover a patch.
    """
    origin = patches.centre[0]
    frame = patches.frame[0]
    in_plane_axes = frame[:2]
    normal = frame[2]
    height = np.abs((nodes - origin) @ normal)
    in_plane = height < 1e-7 * float(np.ptp(nodes, axis=0).max())
    groups = []
    for group, corners in zip(facets.groups, facets.corners):
        flat_group = group[in_plane[corners].all(axis=1)]
        if len(flat_group):
            groups.append(flat_group)
    flat = _flatten(Facets(tuple(groups)), nodes, origin, frame, what)
    windows = []
    for centre, size in zip(patches.centre, patches.size):
        middle = (centre - origin) @ in_plane_axes.T
        windows.append(rectangle(middle - 0.5 * size, middle + 0.5 * size))
    # without a second face, each facet is a piece
    cells = _cells(_pieces(flat, None), windows)
    for i, (cell, area) in enumerate(zip(cells, patches.area)):
        covered = sum(polygon_area(piece.polygon) for piece in cell)
        require(
            abs(covered - area) <= 1e-6 * area,
            f"patch {i} at {patches.centre[i]} m has an area of {area:.6g} m2, "
            f"but {what} covers {covered:.6g} m2 of it",
        )
    return _means(cells, np.array(patches.frame), (flat, None), (nodes, None))


def patches_on_faces(
    points: int | tuple[int, int],
    nodes_a: NDArray,
    facets_a: Facets,
    nodes_b: NDArray | None = None,
    facets_b: Facets | None = None,
    frame: NDArray | None = None,
    what: tuple[str, str] = ("face a", "face b"),
) -> PatchMeans:
    """Compute means over a grid of patches on a face, or on the common area of two faces.

    Parameters
    ----------
    points : int or (int, int)
        Largest total number of patches (:func:`resolved_grid`), or numbers along t1 and t2.
    nodes_a, nodes_b : (n_nodes, 3) float, m
        Nodes of both bodies in the contact position.
    facets_a, facets_b : Facets
    frame : (3, 3) float, optional
        Rows t1, t2, n; by default `mean_frame` of face a.
    what : (str, str)
        Names of the faces in messages.

    Returns
    -------
    PatchMeans

    Raises
    ------
    ValueError
        If a face is folded, or the faces do not overlap.
    """
    if frame is None:
        frame = mean_frame(facets_a, nodes_a)
    origin = nodes_a[facets_a.nodes].mean(axis=0)
    flat_a = _flatten(facets_a, nodes_a, origin, frame, what[0])
    flat_b = None
    if nodes_b is not None and facets_b is not None:
        flat_b = _flatten(facets_b, nodes_b, origin, frame, what[1])
    pieces = [piece for piece in _pieces(flat_a, flat_b) if polygon_area(piece.polygon) > 0.0]
    require(pieces, f"{what[0]} and {what[1]} have no area in common")
    common_area = sum(polygon_area(piece.polygon) for piece in pieces)
    # rectangle around the common area
    low = np.min([piece.polygon.min(axis=0) for piece in pieces], axis=0)
    high = np.max([piece.polygon.max(axis=0) for piece in pieces], axis=0)
    extent = high - low
    lines = [_lines(pieces, flat_a, "a", extent)]
    if flat_b is not None:
        lines.append(_lines(pieces, flat_b, "b", extent))
    length, width = extent.tolist()
    n_1, n_2 = resolved_grid(points, length, width, lines)
    require(min(n_1, n_2) >= 1, f"points must be at least 1 along both edges, not ({n_1}, {n_2})")
    edges_1 = np.linspace(low[0], high[0], n_1 + 1)
    edges_2 = np.linspace(low[1], high[1], n_2 + 1)
    corners = np.stack(np.meshgrid(edges_1, edges_2, indexing="ij"), axis=-1)
    windows = [rectangle(corners[i, j], corners[i + 1, j + 1]) for i, j in np.ndindex(n_1, n_2)]
    # without slivers that rounding leaves along the edges of a cell
    cells = _cells(pieces, windows, above=1e-13 * common_area)
    full_cell = float(extent.prod()) / len(windows)
    cells = _without_small(cells, full_cell, n_2)
    frames = np.broadcast_to(frame, (len(cells), 3, 3)).copy()
    bodies = (nodes_a, nodes_b if flat_b is not None else None)
    means = _means(cells, frames, (flat_a, flat_b), bodies)
    return replace(means, grid=(n_1, n_2), lines=tuple(lines))


def _without_small(cells: list[list[_Piece]], full: float, n_2: int) -> list[list[_Piece]]:
    """Return the cells of a grid, with almost uncovered cells merged with the nearest other cells.

    Empty cells are dropped.  ``full`` is the area of a whole cell (m2), and ``n_2`` the number of
    cells along t2, which follow each other in ``cells``.
    """
    area = np.array([sum(polygon_area(piece.polygon) for piece in cell) for cell in cells])
    large = np.flatnonzero(area > SMALL_CELL * full)
    if len(large) == 0:
        large = np.array([int(area.argmax())])
    # row and column of each cell in the grid: (n_cells, 2)
    place = np.stack(np.divmod(np.arange(len(cells)), n_2), axis=1)
    small_cells = np.setdiff1d(np.flatnonzero(area > 0.0), large)
    for small in small_cells:
        steps_apart = np.abs(place[large] - place[small]).sum(axis=1)
        nearest = large[steps_apart.argmin()]
        cells[nearest].extend(cells[small])
    return [cells[k] for k in large]
