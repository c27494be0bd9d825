"""Faces of elements and patches over them, without any finite element library: closed forms for areas and means."""

import numpy as np
import pytest

from bdamper.fem.contact_patches import (
    MeshLines,
    Patches,
    mean_frame,
    patches_on_faces,
    patches_on_rectangles,
    resolved_grid,
)
from bdamper.fem.surface import (
    Facets,
    area_vectors,
    boundary_facets,
    enclosed_volume,
    facets_on_nodes,
)

HEX = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
WEDGE = HEX[[0, 1, 3, 4, 5, 7]]
TET = HEX[[0, 1, 3, 4]]
FACES = {
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
    6: ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    4: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
}


def second_order(corners, rng):
    """An element with nodes between its corners, in any order."""
    edges = np.array(FACES[len(corners)])
    middle = 0.5 * (corners[edges[:, 0]] + corners[edges[:, 1]])
    order = rng.permutation(len(middle))
    return np.concatenate([corners, middle[order]])


@pytest.mark.parametrize(
    ("corners", "volume"), [(HEX, 1.0), (WEDGE, 0.5), (TET, 1 / 6)], ids=["hex", "wedge", "tet"]
)
@pytest.mark.parametrize("order", [1, 2])
def test_surface_of_one_element(corners, volume, order):
    rng = np.random.default_rng(order)
    nodes = corners if order == 1 else second_order(corners, rng)
    turned = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    nodes = nodes @ (turned * np.linalg.det(turned)).T + [3.0, -1.0, 2.0]
    facets = boundary_facets([np.arange(len(nodes))[None]], nodes)
    assert len(facets) == {8: 6, 6: 5, 4: 4}[len(corners)]
    assert enclosed_volume(facets, nodes) == pytest.approx(volume)
    np.testing.assert_allclose(
        area_vectors(facets, nodes).sum(axis=0), 0.0, atol=1e-12
    )  # closed, all outward
    for row in facets.each():
        n = {3: 3, 4: 4, 6: 3, 8: 4}[len(row)]
        if len(row) > n:
            np.testing.assert_allclose(
                nodes[row[n:]], 0.5 * (nodes[row[:n]] + nodes[np.roll(row[:n], -1)]), atol=1e-12
            )
    flipped = facets.flipped()
    np.testing.assert_allclose(
        area_vectors(flipped, nodes), -area_vectors(facets, nodes), atol=1e-12
    )


def test_mirrored_and_collapsed_elements():
    mirrored = HEX * [1.0, 1.0, -1.0]
    assert enclosed_volume(
        boundary_facets([np.arange(8)[None]], mirrored), mirrored
    ) == pytest.approx(1.0)
    wedge = np.array([[0, 1, 3, 3, 4, 5, 7, 7]])  # a hexahedron with two edges shrunk to points
    facets = boundary_facets([wedge], HEX)
    assert sorted(g.shape[1] for g in facets.groups) == [3, 4]
    assert enclosed_volume(facets, HEX) == pytest.approx(0.5)


def test_inner_faces_are_left_out():
    nodes = np.concatenate([HEX, HEX[[1, 2, 5, 6]] + [1.0, 0.0, 0.0]])
    elements = np.array([[0, 1, 2, 3, 4, 5, 6, 7], [1, 8, 9, 2, 5, 10, 11, 6]])
    facets = boundary_facets([elements], nodes)
    assert len(facets) == 10
    assert enclosed_volume(facets, nodes) == pytest.approx(2.0)
    top = facets_on_nodes(facets, np.flatnonzero(nodes[:, 2] > 0.5))
    assert len(top) == 2
    np.testing.assert_allclose(area_vectors(top, nodes), [[0, 0, 1], [0, 0, 1]])


def test_elements_that_are_none():
    with pytest.raises(ValueError, match="not 7"):
        boundary_facets([np.arange(7)[None]], HEX)
    nodes = second_order(HEX, np.random.default_rng(0))
    nodes[12] += 5.0
    with pytest.raises(ValueError, match="no midside node between two corners of the face"):
        boundary_facets([np.arange(20)[None]], nodes)


# ---- patches ----


def plate(n, kind, x=(0.0, 2.0), y=(0.0, 1.0)):
    """A plane face at z = 0, seen from above, of n x n squares or pairs of triangles, of first or second order."""
    xs, ys = np.linspace(*x, 2 * n + 1), np.linspace(*y, 2 * n + 1)
    nodes = np.array([[a, b, 0.0] for b in ys for a in xs])

    def at(i, j):
        return i + (2 * n + 1) * j

    rows = []
    for i in range(0, 2 * n, 2):
        for j in range(0, 2 * n, 2):
            corner = [at(i, j), at(i + 2, j), at(i + 2, j + 2), at(i, j + 2)]
            middle = [at(i + 1, j), at(i + 2, j + 1), at(i + 1, j + 2), at(i, j + 1)]
            centre = at(i + 1, j + 1)
            if kind == 4:
                rows.append(corner)
            elif kind == 8:
                rows.append(corner + middle)
            elif kind == 3:
                rows += [[corner[0], corner[1], corner[2]], [corner[0], corner[2], corner[3]]]
            else:
                rows.append([corner[0], corner[1], corner[2], middle[0], middle[1], centre])
                rows.append([corner[0], corner[2], corner[3], centre, middle[2], middle[3]])
    return nodes, Facets((np.array(rows),))


@pytest.mark.parametrize("kind", [3, 4, 6, 8])
def test_means_of_polynomials(kind):
    """Linear fields are averaged exactly by every element, quadratic ones by those of second order."""
    nodes, facets = plate(3, kind)
    means = patches_on_faces((4, 5), nodes, facets, frame=np.eye(3))
    np.testing.assert_allclose(means.area, 2.0 / 20, rtol=1e-12)
    scalar = means.matrix_a[2::3, 2::3]  # the normal is Z
    x, y = nodes[:, 0], nodes[:, 1]
    linear = 1 + 2 * means.points_a[:, 0] - 3 * means.points_a[:, 1]
    np.testing.assert_allclose(scalar @ (1 + 2 * x - 3 * y), linear, atol=1e-13)
    exact = means.points_a[:, 0] ** 2 + 0.5**2 / 12
    error = np.abs(scalar @ x**2 - exact).max()
    assert error < 1e-12 if kind > 4 else error > 1e-4


@pytest.mark.parametrize(("a", "b"), [(4, 8), (8, 3), (6, 4), (3, 6)])
def test_two_meshes_see_the_same_patches(a, b):
    """Overlap of two plates: the same points, areas and linear means on both sides, in what they have in common."""
    nodes_a, facets_a = plate(3, a)
    nodes_b, facets_b = plate(4, b, x=(0.3, 2.5), y=(-0.2, 0.9))
    nodes_b = nodes_b + [0.0, 0.0, 0.01]
    means = patches_on_faces(12, nodes_a, facets_a, nodes_b, facets_b.flipped())
    assert means.area.sum() == pytest.approx(1.7 * 0.9, rel=1e-12)
    np.testing.assert_allclose(means.points_a[:, :2], means.points_b[:, :2], atol=1e-12)
    np.testing.assert_allclose(means.distance, 0.01, atol=1e-12)
    rigid = np.cross([0.3, -0.2, 0.5], nodes_a)
    other = np.cross([0.3, -0.2, 0.5], nodes_b - [0.0, 0.0, 0.01])
    np.testing.assert_allclose(
        means.matrix_a @ rigid.ravel(), means.matrix_b @ other.ravel(), atol=1e-12
    )


def test_corners_that_a_face_hardly_covers_join_their_neighbours():
    """A triangle under a grid: every bit of it belongs to some patch, and no patch is tiny."""
    nodes = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    means = patches_on_faces((7, 7), nodes, Facets((np.array([[0, 1, 2]]),)), frame=np.eye(3))
    assert means.area.sum() == pytest.approx(0.5)
    assert means.area.min() > 0.02 / 49
    assert len(means.area) == 28  # 21 whole cells and 7 halves on the slope


def test_faces_that_cannot_be_used():
    nodes, facets = plate(2, 4)
    with pytest.raises(ValueError, match="no area in common"):
        patches_on_faces(4, nodes, facets, nodes + [5.0, 0.0, 0.0], facets)
    with pytest.raises(ValueError, match="at least 1"):
        patches_on_faces(0, nodes, facets)
    both = Facets((np.concatenate([facets.groups[0], facets.flipped().groups[0]]),))
    with pytest.raises(ValueError, match="do not all point to the same side"):
        mean_frame(both, nodes)
    bow = Facets((facets.groups[0][:, [0, 2, 1, 3]],))
    with pytest.raises(ValueError, match=r"folded|one side"):
        patches_on_faces(4, nodes, bow, frame=np.eye(3))
    outside = Patches(np.array([[2.0, 0.5, 0.0]]), np.eye(3)[None], np.array([[0.5, 0.5]]))
    with pytest.raises(ValueError, match=r"patch 0 .* covers 0.125 m2"):
        patches_on_rectangles(outside, nodes, facets)


def test_axes_of_a_face():
    """n outward, t2 against the axis; for an end face t1 follows a rotation toward +X."""
    nodes, facets = plate(1, 4)
    turned = nodes @ np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0.0]])  # normal Y now
    np.testing.assert_allclose(
        mean_frame(facets, turned), [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-14
    )
    end = nodes + [-1.0, 5.0, 1.0]  # above the centre, on +Y
    np.testing.assert_allclose(
        mean_frame(facets, end), np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]]), atol=0.1
    )
    frame = mean_frame(facets, end)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(frame) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("kind", "n", "points", "grid"),
    [
        # n + 1 lines of nodes along each edge, 2 n + 1 with nodes in the middle of edges
        (4, 2, 24, (3, 3)), (3, 2, 24, (3, 3)), (4, 4, 24, (5, 4)), (6, 2, 24, (5, 4)), (8, 3, 24, (6, 4)),
        # 20 and 8 nodes: a combination of 24 and 9 points would have no flexibility
        (8, 1, 9, (3, 2)), (8, 1, 24, (3, 2)),
        # three rows along t1 on any mesh, and not more points than given
        (4, 1, 24, (3, 1)), (4, 1, 4, (2, 2)), (4, 1, 2, (2, 1)), (4, 9, 24, (6, 4)), (4, 1, (4, 5), (4, 5)),
    ],
)  # fmt: skip
def test_points_follow_the_mesh(kind, n, points, grid):
    nodes, facets = plate(n, kind)
    means = patches_on_faces(points, nodes, facets, frame=np.eye(3))
    assert means.grid == grid
    if points != (4, 5) and (kind, n, points) != (4, 1, 24):
        # the means of every grid that a mesh resolves are independent
        means_of_normal = means.matrix_a[2::3, 2::3].toarray()
        assert np.linalg.matrix_rank(means_of_normal) == len(means.area)


def test_points_follow_the_coarser_mesh_of_two():
    """Four of six by six squares lie in the common area, and two of three by three."""
    nodes_a, facets_a = plate(6, 4, x=(0.0, 3.0), y=(0.0, 3.0))
    nodes_b, facets_b = plate(3, 4, x=(1.0, 4.0), y=(1.0, 4.0))
    means = patches_on_faces(24, nodes_a, facets_a, nodes_b, facets_b.flipped(), np.eye(3))
    assert [face[:2] for face in means.lines] == [(5, 5), (3, 3)]
    assert means.grid == (3, 3)
    # in each direction on its own
    fine, along, across = MeshLines(9, 9, 81), MeshLines(3, 9, 27), MeshLines(9, 3, 27)
    for second, grid in ((along, (3, 8)), (across, (8, 3))):
        assert resolved_grid(24, 1.0, 1.0, (fine, second)) == grid
        assert resolved_grid(24, 1.0, 1.0, (second, fine)) == grid
