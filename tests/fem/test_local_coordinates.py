"""The local basis of a wheel against the whole annulus put together from finite elements, and against its frequencies."""

import numpy as np
import pytest
from scipy.linalg import eigh

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem import BladePart, Geometry, LocalSizes, SectorFE, Wanted, local_basis
from bdamper.fem.generated_models import wedge_patches
from bdamper.model.modal_basis import rigid_motions
from bdamper.model.validation import check_model
from tests.annulus import Annulus, dampers_between, small_sector, small_wheel, wheel_matrices

DEVIATION = np.random.default_rng(0).standard_normal(8)


def wanted(contact, **locations):
    return Wanted((), contact, locations, 1, 0.002)


@pytest.fixture(scope="module")
def annulus():
    return Annulus(small_sector(6, disk=0.05))


@pytest.fixture(scope="module")
def model(annulus):
    model = small_wheel(annulus.fe)
    check_model(model)
    return model


@pytest.mark.slow
def test_local_matrices_are_the_projection_of_the_whole_annulus(annulus, model):
    local, deviation = model.bodies["blade"].local, 0.05 * DEVIATION[:6]
    assert local.n == 40
    for exact, found in zip(annulus.projected(deviation), wheel_matrices(local, 6, deviation)):
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-11 * np.abs(exact).max())
    rows = np.concatenate([annulus.contact_rows(n) @ annulus.basis for n in range(6)])
    own = np.kron(np.eye(6), local.contact_modes.reshape(-1, local.n))
    np.testing.assert_allclose(rows, own, rtol=0, atol=1e-12 * np.abs(own).max())


def test_a_rigid_motion_of_the_root_carries_the_blade_without_strain(annulus):
    part, nodes = annulus.part, annulus.fe.blade.nodes
    motion = rigid_motions(nodes, nodes[part.nodes].mean(axis=0), np.eye(3))
    carried = part.carried(motion[part.root_dofs])
    own = np.concatenate([part.own_dofs, part.root_dofs])
    np.testing.assert_allclose(
        carried[own], motion[own], rtol=0, atol=1e-8
    )  # rounding of the factorisation
    bent = part.carried(np.sign(np.sin(np.arange(1.0, len(part.root_dofs) + 1)))[:, None])
    strain = np.diag(carried.T @ (part.stiffness @ carried))
    assert strain.max() < 1e-10 * np.diag(bent.T @ (part.stiffness @ bent)).max()


def frequency_errors(annulus, local, deviation, stuck=None, n=None):
    """Relative errors of the lowest n frequencies of the wheel against those of the annulus."""
    n = n or annulus.N
    k, m = annulus.matrices(deviation)
    own_k, own_m = wheel_matrices(local, annulus.N, deviation)
    if stuck is not None:
        k = (k + stuck).tocsc()
        own_k = own_k + annulus.basis.T @ (stuck @ annulus.basis)
    found = np.sqrt(eigh(own_k, own_m, eigvals_only=True)[:n]) / (2 * np.pi)
    return found / annulus.frequencies(k, m, n) - 1.0


@pytest.mark.slow
def test_frequencies_of_a_mistuned_wheel_are_those_of_the_annulus(annulus, model):
    """Family 1 of a soft disk, free, standard deviation 5 %: 9e-6."""
    error = frequency_errors(annulus, model.bodies["blade"].local, 0.05 * DEVIATION[:6])
    assert error.min() > -1e-9
    assert error.max() < 2e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n_blades", "disk", "first", "six"),
    [
        (5, 1.0, 6e-7, 2.2e-3),
        (6, 0.05, 4e-5, 3.5e-3),
        (7, 0.3, 4e-5, 3.7e-3),
        (8, 0.05, 1e-4, 2.3e-3),
    ],
)
def test_errors_do_not_grow_with_mistuning(n_blades, disk, first, six):
    """Free and stuck, standard deviations of 0, 1 and 5 %: family 1 of 5, 6, 7 and 8 blades is off by at most
    0.00005, 0.003, 0.003 and 0.009 %, the lowest 6 N frequencies by 0.21, 0.33, 0.35 and 0.22 %.
    """
    annulus = Annulus(small_sector(n_blades, disk))
    model = small_wheel(annulus.fe)
    local = model.bodies["blade"].local
    rigid = (
        model.bodies["damper"]
        .bases[0]
        .contact_modes[: len(local.contact_modes), :, :6]
        .reshape(-1, 6)
    )
    for stuck in (None, annulus.stuck(rigid, 2e7)):
        worst = {}
        for size in (0.0, 0.01, 0.05):
            error = frequency_errors(
                annulus, local, size * DEVIATION[:n_blades], stuck, 6 * n_blades
            )
            assert error.min() > -1e-9
            assert error[:n_blades].max() < first
            worst[size] = error.max()
        assert max(worst.values()) < min(1.25 * worst[0.0] + 2e-5, six)


@pytest.mark.slow
def test_frequencies_of_65_blades():
    """Largest errors over all nodal diameters of families 1 to 6: 0.0002 0.001 0.002 0.14 0.09 0.014 %."""
    fe = SectorFE(Geometry())
    faces = [wedge_patches(fe.geometry, side, 9) for side in ("left", "right")]
    dampers = dampers_between(*faces)
    local = local_basis(
        fe.blade_part(), fe.cyclic, wanted(fe.blade_contact(*faces)), dampers, LocalSizes(), "blade"
    )
    limits = 1e-2 * np.array([3e-4, 2e-3, 3e-3, 0.15, 0.1, 0.02])
    for d in (0, 1, 2, 7, 19, 32):
        error = np.sqrt(local.nodal_diameter(d).omega2[:6] / fe.cyclic(d).modes(6)[0]) - 1.0
        assert error.min() > -1e-9
        assert np.all(error < limits), d


@pytest.mark.slow
def test_without_the_blades_own_matrix_only_the_strain_of_the_root_is_missing(annulus, model):
    """Tuned wheels are the same; blades clamped at their roots are; deviations of 5 % move family 1 by 0.05 % less."""
    part, exact = annulus.part, model.bodies["blade"].local
    bare = BladePart(part.body, part.nodes, part.fixed)
    local = local_basis(
        bare, annulus.fe.cyclic, wanted(annulus.contact), annulus.dampers, LocalSizes(), "blade"
    )
    for d in (0, 1, 3):
        np.testing.assert_allclose(local.modes(d)[0], exact.modes(d)[0], rtol=1e-9)
    np.testing.assert_allclose(local.omega2, exact.omega2, rtol=1e-9)
    deviation = 0.05 * DEVIATION[:6]
    omega2 = [eigh(*wheel_matrices(b, 6, deviation), eigvals_only=True)[:6] for b in (local, exact)]
    assert 1e-5 < np.abs(np.sqrt(omega2[0] / omega2[1]) - 1.0).max() < 6e-4


def test_a_blade_that_does_not_fit_is_refused(annulus):
    part, body = annulus.part, annulus.part.body
    with pytest.raises(ValueError, match="without a root node that connects it"):
        BladePart(body, np.arange(len(body.nodes)), part.fixed)
    disk = np.setdiff1d(np.arange(len(body.nodes)), part.nodes)
    sizes = LocalSizes(4, 4, 4)
    own = BladePart(body, disk, part.fixed)
    with pytest.raises(ValueError, match="contact points that are not on the blade"):
        local_basis(own, annulus.fe.cyclic, wanted(annulus.contact), annulus.dampers, sizes, "disk")
    with pytest.raises(ValueError, match="location 'rim', which is not on the blade"):
        local_basis(
            part,
            annulus.fe.cyclic,
            wanted(annulus.contact, rim=int(disk[0])),
            annulus.dampers,
            sizes,
            "blade",
        )
    wide = np.union1d(part.nodes, annulus.fe.faces.independent[:2])
    own = BladePart(body, wide, part.fixed)
    with pytest.raises(ValueError, match="lies on a sector face"):
        local_basis(
            own, annulus.fe.cyclic, wanted(annulus.contact), annulus.dampers, sizes, "blade"
        )
