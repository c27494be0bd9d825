"""The tie of sector faces: interpolation where meshes differ, images of held nodes, nodes on the axis, faces found."""

import numpy as np
import pytest
import scipy.sparse as sp

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.cyclic_symmetry import cyclic_transformation
from bdamper.fem.meshes import local_order, turn
from bdamper.fem.sector_faces import find_faces, interpolation, match_faces, tie_faces
from bdamper.fem.surface import Facets, boundary_facets
from bdamper.model.modal_basis import rigid_motions
from tests.fem.test_cyclic import N, sector_and_faces


@pytest.fixture(scope="module")
def sector():
    """Nodes of the two faces besides the body and its surface."""
    body, left, right = sector_and_faces()
    return body, boundary_facets((body.elements[:, local_order()],), body.nodes), left, right


FACETS = {
    3: [[0, 0], [2, 0], [0, 1]],
    4: [[0, 0], [2, 0], [2.5, 1.5], [0, 1]],
    6: [[0, 0], [2, 0], [0, 1], [1, 0], [1, 0.5], [0, 0.5]],
    8: [[0, 0], [2, 0], [2, 1], [0, 1], [1, 0], [2, 0.5], [1, 1], [0, 0.5]],
}


@pytest.mark.parametrize("n", FACETS)
def test_interpolation_reproduces_the_fields_of_the_facet(n):
    """Linear fields on every facet, quadratic ones on those of second order with straight edges; nearest points outside."""
    tilt = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0][:2]
    flat = np.array(FACETS[n], float)
    facets, points = (
        Facets((np.arange(n)[None],)),
        np.array([[0.3, 0.2], [0.9, 0.1], [0.1, 0.6], [0.0, 0.0]]),
    )
    weights, distance = interpolation(flat @ tilt, facets, points @ tilt)
    np.testing.assert_allclose(distance, 0.0, atol=1e-12)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(weights @ flat, points, atol=1e-12)
    if n in (6, 8):
        square = [values[:, 0] ** 2 + values.prod(axis=1) for values in (flat, points)]
        np.testing.assert_allclose(weights @ square[0], square[1], atol=1e-12)
    _, away = interpolation(
        flat @ tilt, facets, np.array([[-0.25, 0.5]]) @ tilt + 0.1 * np.cross(*tilt)
    )
    assert 1.0 - 1e-9 < away[0] / np.hypot(0.25, 0.1) < 1.2


def test_faces_that_match_are_tied_node_by_node(sector):
    """Interpolation and matching agree; so do faces that are found, with their number of sectors."""
    body, surface, left, right = sector
    matched = match_faces(body.nodes, left, right, N)
    for faces in (
        tie_faces(body.nodes, surface, left, right, N),
        find_faces(body.nodes, surface, None, 1e-9),
    ):
        assert faces.n_sectors == N and faces.distance < 1e-12
        ties = (
            sp.csr_matrix(
                (w.data, (f.dependent[w.row], f.independent[w.col])), shape=(len(body.nodes),) * 2
            )
            for f in (matched, faces)
            for w in [f.weights.tocoo()]
        )
        one, other = ties
        assert abs(one - other).max() < 1e-12
    assert find_faces(body.nodes, surface, N + 1, 1e-9) is None


@pytest.mark.parametrize("side", [-1, 1])
def test_part_of_a_face_is_not_found_as_a_sector_face(side):
    """A rotation carries the corners of a face onto four nodes that are no face there, but the rim of four triangles."""
    square = np.array([[0.0, r, z] for r, z in ((1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0))])
    middle = square.mean(axis=0)
    whole, split = (
        square @ turn(side * np.pi / N).T,
        np.vstack([square, middle]) @ turn(-side * np.pi / N).T,
    )
    nodes = np.vstack([whole, split])
    fan = np.array([[4 + k, 4 + (k + 1) % 4, 8] for k in range(4)])
    assert find_faces(nodes, Facets((fan, np.arange(4)[None])), N, 1e-9) is None
    assert find_faces(nodes, Facets((fan, np.arange(4)[None])), None, 1e-9) is None
    both = find_faces(nodes, Facets((fan, np.arange(4)[None], np.arange(4, 8)[None])), N, 1e-9)
    assert both is not None and both.n_sectors == N and sorted(both.nodes) == list(range(8))


@pytest.mark.parametrize("dependent", [True, False])
def test_rigid_motions_cost_no_force_where_meshes_differ(sector, dependent):
    """The nodes between corners of one face are moved along its edges: the tie keeps linear fields."""
    body, surface, left, right = sector
    nodes, moved = body.nodes.copy(), right if dependent else left
    inner = moved[np.abs(np.hypot(*nodes[moved, :2].T) - 0.75) < 1e-6]
    nodes[inner, :2] *= 0.9
    faces = tie_faces(nodes, surface, left, right, N)
    assert faces.distance < 1e-12 and not faces.matching
    motion = rigid_motions(nodes, np.zeros(3), np.eye(3))[
        :, [2, 5]
    ]  # along and about the axis: nodal diameter 0
    t = cyclic_transformation(len(nodes), faces, np.empty(0, int), 0)
    own = np.setdiff1d(np.arange(len(nodes)), faces.dependent)
    np.testing.assert_allclose(t @ motion[body.dofs(own)], motion, atol=1e-12)


def test_images_of_held_nodes_are_held(sector):
    body, _, left, right = sector
    faces = match_faces(body.nodes, left, right, N)
    for pair in ((faces.independent, faces.dependent), (faces.dependent, faces.independent)):
        held = np.zeros(len(body.nodes), bool)
        held[pair[0][:3]] = True
        np.testing.assert_array_equal(
            np.flatnonzero(faces.images(held)), np.sort(np.concatenate([p[:3] for p in pair]))
        )


@pytest.mark.parametrize(("d", "free"), [(0, 1), (1, 1), (2, 0), (3, 0)])
def test_nodes_on_the_axis_move_as_the_wave_lets_them(d, free):
    """Along the axis for nodal diameter 0, in circles for 1, not at all for others."""
    nodes = np.array(
        [[0.0, 0.0, 0.0], *(np.array([0.0, 1.0, 0.0]) @ turn(a).T for a in (-np.pi / N, np.pi / N))]
    )
    faces = match_faces(nodes, np.array([0, 1]), np.array([0, 2]), N)
    assert faces.axis.tolist() == [0] and faces.dependent.tolist() == [2]
    t = cyclic_transformation(3, faces, np.empty(0, int), d).toarray()
    assert t.shape == (9, 3 + free)
    u = t[:3, 3:]
    np.testing.assert_allclose(
        np.exp(2j * np.pi * d / N) * turn(2.0 * np.pi / N) @ u, u, atol=1e-12
    )
