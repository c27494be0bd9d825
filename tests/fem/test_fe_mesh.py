"""Meshes of the reference sector and its damper: closed, not inverted, in touch where they should be."""

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from skfem import Basis, ElementHexS2

from bdamper.fem.meshes import Geometry, MeshDensity, damper_mesh, sector_mesh, turn


@pytest.mark.parametrize("name", ["coarse", "reference"])
def test_elements_are_not_inverted(name):
    g, n = Geometry(), MeshDensity.preset(name)
    for mesh in (sector_mesh(g, n), damper_mesh(g, n)):
        basis = Basis(mesh, ElementHexS2(), intorder=5)
        jacobian = mesh.mapping().detDF(basis.X)
        assert jacobian.shape[1] == 27
        assert np.all(jacobian * np.sign(jacobian[0, 0]) > 0.0)


def test_surface_is_closed():
    """The mesh conforms: outward areas of the boundary add up to zero, and no crack adds faces inside."""
    g, n = Geometry(), MeshDensity.preset("coarse")
    for mesh in (sector_mesh(g, n), damper_mesh(g, n)):
        facets = mesh.boundary_facets()
        count = np.bincount(mesh.t2f.ravel())
        assert set(np.unique(count)) == {1, 2}
        centre = mesh.p[:, mesh.facets[:, facets]].mean(axis=1)
        # Two boundary faces in one place would be a crack.
        distance = np.linalg.norm(centre[:, :, None] - centre[:, None, :], axis=0) + np.eye(
            len(facets)
        )
        assert distance.min() > 1e-4


def test_volume_of_the_damper():
    g = Geometry()
    mesh = damper_mesh(g, MeshDensity.preset("coarse"))
    s, c = np.sin(g.face_angle) * g.face_length, np.cos(g.face_angle) * g.face_length
    area = (g.ridge_width + 2 * s) * g.damper_body_height + s * c + g.ridge_width * c
    assert Basis(mesh, ElementHexS2(), intorder=5).dx.sum() == pytest.approx(
        area * g.face_width, rel=1e-12
    )


def test_undersides_lie_in_the_planes_of_the_damper():
    """Right underside of blade 0 and, one pitch on, left underside of blade 1 against the two roof planes."""
    g, n = Geometry(), MeshDensity.preset("coarse")
    blade, damper = sector_mesh(g, n).p.T, damper_mesh(g, n).p.T @ turn(-0.5 * g.pitch).T
    for sign, place in (
        (-1.0, blade @ turn(-0.5 * g.pitch).T),
        (1.0, blade @ turn(0.5 * g.pitch).T),
    ):
        normal = np.array([sign * np.cos(g.face_angle), np.sin(g.face_angle), 0.0])
        offset = normal @ [sign * 0.5 * g.ridge_width, g.ridge_radius, 0.0]
        for nodes in (damper, place):
            on = np.abs(nodes @ normal - offset) < 1e-10
            on &= sign * nodes[:, 0] > 0.49 * g.ridge_width
            slope = np.abs(nodes[on, 0]) / np.sin(g.face_angle)
            assert on.sum() >= 21
            assert slope.max() - slope.min() >= g.face_length - 1e-12
        # The blade is all outside of the damper.
        near = (
            (np.abs(place[:, 0]) < 0.012)
            & (place[:, 1] > g.rim_radius + 1e-9)
            & (place[:, 1] < g.ridge_radius)
        )
        near &= np.abs(place[:, 0]) > 0.5 * g.ridge_width - 1e-9
        assert np.all(place[near] @ normal - offset > -1e-10)


def test_platforms_keep_their_clearance():
    g = Geometry()
    blade = sector_mesh(g, MeshDensity.preset("coarse")).p.T
    platform = blade[(blade[:, 1] > 0.43) & (blade[:, 1] < 0.4460)]
    right, left = platform @ turn(-0.5 * g.pitch).T, platform @ turn(0.5 * g.pitch).T
    assert left[:, 0].min() - right[:, 0].max() == pytest.approx(g.platform_clearance, abs=1e-12)


def test_refuses_what_cannot_be():
    with pytest.raises(ValueError, match="coarse"):
        MeshDensity.preset("fine")
    with pytest.raises(ValueError, match="clearance"):
        Geometry(platform_clearance=0.002)
