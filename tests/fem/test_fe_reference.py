"""The reference model: conventions of the ports, receptances, and the full model with a bonded damper."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.generated_models import averaging_matrix, bladed_disk, end_patches, wedge_patches
from bdamper.fem.meshes import turn
from bdamper.fem.reduced_bodies import needed_nodal_diameters
from bdamper.model.validation import check_model
from tools.bonded import reference_frequencies


@pytest.fixture(scope="module")
def model(fe):
    return bladed_disk(9, n_modes=12, nodal_diameters=(1, 5), fe=fe)


@pytest.mark.slow
def test_model_passes_its_checks(model):
    check_model(model)
    assert set(model.bodies["blade"].bases) == {0, 1, 5}
    assert model.contact == {}


@pytest.mark.slow
def test_needed_nodal_diameters():
    assert needed_nodal_diameters(65, 5, 7) == (0, 5, 10, 15, 20, 25, 30)
    assert needed_nodal_diameters(65, 5, 13)[-1] == 30
    assert needed_nodal_diameters(1, 3, 7) == (0,)


@pytest.mark.slow
def test_rotation_of_everything_opens_no_contact(fe):
    rotation = [
        (np.cross([0.0, 0.0, 1.0], n)).ravel() for n in (fe.blade.nodes, fe.damper.body.nodes)
    ]
    left, right = (wedge_patches(fe.geometry, side, 24) for side in ("left", "right"))
    damper = averaging_matrix(fe.damper.body, left, right) @ rotation[1]
    np.testing.assert_allclose(fe.blade_contact(left, right) @ rotation[0], damper, atol=1e-14)


@pytest.mark.slow
def test_patches_stand_at_the_contact_points(fe, model):
    """Mean positions of the patches along the contact axes, which do not change where points and axes turn together."""
    left, right = (wedge_patches(fe.geometry, side, 9) for side in ("left", "right"))
    front, back = (end_patches(fe.geometry, side) for side in ("front", "back"))
    of_blade = (fe.blade, fe.blade_contact(left, right), ("left", "right"))
    on_damper = averaging_matrix(fe.damper.body, left, right, front, back)
    of_damper = (fe.damper.body, on_damper, ("left", "right", "front", "back"))
    for body, contact, names in (of_blade, of_damper):
        faces = [model.interfaces[name] for name in names]
        expected = np.concatenate([np.einsum("pij,pj->pi", f.frame, f.points) for f in faces])
        np.testing.assert_allclose(
            (contact @ body.nodes.ravel()).reshape(-1, 3), expected, atol=1e-10
        )


@pytest.mark.slow
def test_flexibility_is_hermitian_and_more_than_its_modes(model):
    for body in ("blade", "damper"):
        for basis in model.bodies[body].bases.values():
            f = basis.flexibility
            assert np.array_equal(f, f.conj().T)
            elastic = basis.omega2 > 0.0
            phi = basis.contact_modes.reshape(len(f), -1)[:, elastic]
            rest = np.linalg.eigvalsh(f - (phi / basis.omega2[elastic]) @ phi.conj().T)
            assert rest[0] > 0.0


@pytest.mark.slow
def test_points_frames_and_gaps(model, fe):
    left, right = model.interfaces["left"], model.interfaces["right"]
    half = turn(-0.5 * fe.geometry.pitch)
    # In the damper's axes the two faces are mirror images.
    np.testing.assert_allclose(left.points @ half.T * [-1, 1, 1], right.points @ half.T, atol=1e-14)
    # On the slope: up toward +X on the left face, down toward +X on the right one; both outward.
    assert np.all(left.frame[:, 0, 1] > 0)
    assert np.all(right.frame[:, 0, 1] < 0)
    assert np.all(left.frame[:, 2, 1] > 0)
    assert np.all(right.frame[:, 2, 1] > 0)
    for name in ("front", "back"):
        face = model.interfaces[name]
        assert face.kind == "constraint"
        assert face.body_b == "ground"
        assert np.all(face.gap == fe.geometry.end_gap)


@pytest.mark.slow
def test_load_of_the_damper(model):
    load = model.bodies["damper"].load
    assert np.linalg.norm(load.direction) == pytest.approx(1.0, abs=1e-14)
    mass = model.bodies["damper"].mass
    np.testing.assert_allclose(load.generalised[:6], [0, mass**-0.5, 0, 0, 0, 0], atol=1e-10)


@pytest.mark.slow
def test_another_grid_uses_the_same_modes(model, fe):
    other = bladed_disk((2, 3), n_modes=12, nodal_diameters=(5,), fe=fe)
    assert np.array_equal(
        other.bodies["blade"].bases[5].omega2, model.bodies["blade"].bases[5].omega2
    )
    assert other.interfaces["left"].n_points == 6


@pytest.mark.slow
def test_surface_quadrilaterals_run_around_their_faces(model):
    for mesh in model.meshes.values():
        p = mesh.points[mesh.quads]
        first = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        second = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 0])
        assert np.all(np.einsum("ij,ij->i", first, second) > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("d", [pytest.param(0, marks=pytest.mark.slow), 5])
def test_bonded_frequencies_against_a_penalty(fe, d):
    """Very stiff springs between the patch means approach the bonded frequencies from below."""
    bonded = reference_frequencies(fe, d, 9, 4)
    left, right = (wedge_patches(fe.geometry, side, 9) for side in ("left", "right"))
    phase = np.exp(2j * np.pi * d / fe.geometry.n_blades)
    sector, damper = fe.cyclic(d), fe.damper.body
    blade = (
        sp.diags(np.repeat([1.0, phase], 27))
        @ fe.blade_contact(left, right)
        @ sector.transformation
    )
    body = averaging_matrix(damper, left, right)
    g = sp.hstack([blade, -body])
    stiffness, mass = (
        sp.block_diag([a, b], format="csc").astype(complex)
        for a, b in ((sector.stiffness, damper.stiffness), (sector.mass, damper.mass))
    )
    error = []
    for penalty in (1e10, 1e11):
        k = (stiffness + penalty * g.conj().T @ g).tocsc()
        omega2 = np.sort(eigsh(k, 4, M=mass, sigma=0.0, return_eigenvectors=False).real)
        error.append(bonded / (np.sqrt(omega2) / (2 * np.pi)) - 1.0)
    assert np.all(error[0] > error[1])
    assert np.all(error[1] > -1e-9)
    # The error falls as one over the penalty.
    np.testing.assert_allclose(error[0] / error[1], 10.0, rtol=0.2)


@pytest.mark.slow
def test_bonded_damper_stiffens_the_first_mode(fe, model):
    free = np.sqrt(model.bodies["blade"].bases[5].omega2[0]) / (2 * np.pi)
    assert 280.0 < free < 290.0
    assert 340.0 < reference_frequencies(fe, 5, 24, 1)[0] < 370.0
