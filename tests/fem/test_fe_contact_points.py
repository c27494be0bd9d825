"""Contact points as patch means: exact for rigid motion and for quadratic fields, whatever the mesh."""

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.contact_patches import patch_grid
from bdamper.fem.generated_models import averaging_matrix, end_patches, face_frame, wedge_patches
from bdamper.fem.meshes import turn
from bdamper.model.modal_basis import rigid_motions
from tests.each import each

GRIDS = [9, 24, 48, 96, (2, 7)]


def bodies(fe, points):
    """(body, patches) of every port of the friction interfaces."""
    g = fe.geometry
    left, right = (wedge_patches(g, side, points) for side in ("left", "right"))
    yield fe.damper.body, left
    yield fe.damper.body, right
    yield fe.blade, left
    yield fe.blade, right.turned(turn(-g.pitch))


@pytest.mark.slow
@pytest.mark.parametrize("points", GRIDS)
def test_rigid_motion_is_averaged_exactly(fe, points):
    for body, patches in bodies(fe, points):
        mean = averaging_matrix(body, patches) @ rigid_motions(body.nodes, np.zeros(3), np.eye(3))
        exact = rigid_motions(patches.centre, np.zeros(3), np.eye(3)).reshape(-1, 3, 6)
        exact = np.einsum("pij,pjk->pik", patches.frame, exact)
        np.testing.assert_allclose(mean.reshape(-1, 3, 6), exact, atol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("points", GRIDS)
def test_quadratic_field_on_the_face_is_averaged_exactly(fe, points):
    """Mean of x^2 over a rectangle of width b about c is c^2 + b^2/12; of x y the product of the means."""
    for body, patches in bodies(fe, points):
        local = body.nodes @ patches.frame[0].T
        centre = patches.centre @ patches.frame[0].T
        b = averaging_matrix(body, patches)
        for field, exact in (
            (local[:, 0] ** 2, centre[:, 0] ** 2 + patches.size[:, 0] ** 2 / 12),
            (local[:, 1] ** 2, centre[:, 1] ** 2 + patches.size[:, 1] ** 2 / 12),
            (local[:, 0] * local[:, 1], centre[:, 0] * centre[:, 1]),
        ):
            u = field[:, None] * patches.frame[0][2]  # along the normal
            mean = (b @ u.ravel()).reshape(-1, 3)
            np.testing.assert_allclose(mean[:, 2], exact, rtol=1e-10, atol=1e-15)
            np.testing.assert_allclose(mean[:, :2], 0.0, atol=1e-13)


def test_end_faces(fe):
    for side, z in (("front", 1.0), ("back", -1.0)):
        patches = end_patches(fe.geometry, side)
        b = averaging_matrix(fe.damper.body, patches)
        np.testing.assert_allclose(
            (b @ fe.damper.body.nodes.ravel()).reshape(-1, 3),
            np.einsum("pij,pj->pi", patches.frame, patches.centre),
            atol=1e-13,
        )
        np.testing.assert_allclose(
            patches.frame[:, 2], np.broadcast_to([0.0, 0.0, z], (4, 3)), atol=1e-15
        )


def test_patches_tile_the_face(fe):
    g = fe.geometry
    whole = averaging_matrix(fe.damper.body, wedge_patches(g, "left", 1)).toarray()
    for points in (9, 24, 96):
        parts = averaging_matrix(fe.damper.body, wedge_patches(g, "left", points)).toarray()
        np.testing.assert_allclose(parts.reshape(points, 3, -1).mean(axis=0), whole, atol=1e-14)
        assert wedge_patches(g, "left", points).area.sum() == pytest.approx(
            g.face_length * g.face_width
        )


def test_frames_are_right_handed_and_point_outward():
    a = np.deg2rad(50.0)
    for name in ("left", "right", "front", "back"):
        frame = face_frame(name, a)
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(frame) == pytest.approx(1.0)
    np.testing.assert_allclose(face_frame("right", a)[2], [np.cos(a), np.sin(a), 0.0])
    np.testing.assert_allclose(face_frame("left", a)[2], [-np.cos(a), np.sin(a), 0.0])


def test_patch_off_the_surface_is_refused(fe):
    patches = wedge_patches(fe.geometry, "left", 9)
    wide = type(patches)(patches.centre, patches.frame, patches.size * 1.5)
    with pytest.raises(ValueError, match=r"patch 0 .* covers"):
        averaging_matrix(fe.damper.body, wide)


@each(
    ("points", "edges", "grid"),
    [
        (24, (12.0, 36.0), (3, 8)), (24, (6.0, 48.0), (3, 8)), (12, (1.0, 20.0), (3, 4)), (9, (1.0, 9.0), (3, 3)),
        (4, (1.0, 3.0), (2, 2)), (10, (1.0, 4.0), (2, 5)), (7, (1.0, 2.0), (1, 7)), ((2, 5), (1.0, 1.0), (2, 5)),
    ],
)  # fmt: skip
def test_a_grid_has_three_rows_on_long_faces_too(points, edges, grid):
    """Patches as close to squares as possible would be two rows of twelve on the second face."""
    assert patch_grid(points, *edges) == grid
