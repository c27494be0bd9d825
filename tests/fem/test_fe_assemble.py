"""Stiffness, mass and body forces against exact integrals and scikit-fem's own elasticity form."""

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from skfem import Basis, ElementHexS2, ElementVector
from skfem.models.elasticity import lame_parameters, linear_elasticity

from bdamper.fem.meshes import (
    ElasticMaterial,
    Geometry,
    MeshDensity,
    damper_mesh,
    discretise,
    sector_mesh,
)
from bdamper.model.modal_basis import rigid_motions


@pytest.fixture(scope="module")
def sector():
    return discretise(sector_mesh(Geometry(), MeshDensity.preset("coarse")), ElasticMaterial())


def test_rigid_motion_has_no_energy(sector):
    motion = rigid_motions(sector.nodes, np.zeros(3), np.eye(3))
    scale = np.abs(sector.stiffness).max() * np.abs(motion).max(axis=0)
    assert np.all(np.abs(sector.stiffness @ motion).max(axis=0) < 1e-12 * scale)


def test_patch_test(sector):
    """A linear displacement has the energy of its constant strain, on elements of any shape."""
    material = sector.material
    a = np.random.default_rng(1).standard_normal((3, 3))
    strain = 0.5 * (a + a.T)
    lame, shear = lame_parameters(material.youngs_modulus, material.poisson_ratio)
    density = lame * np.trace(strain) ** 2 + 2 * shear * np.sum(strain**2)
    volume = Basis(sector.mesh, ElementHexS2(), intorder=5).dx.sum()
    u = (sector.nodes @ a.T).ravel()
    assert u @ (sector.stiffness @ u) == pytest.approx(density * volume, rel=1e-11)


def test_mass_and_its_moments(sector):
    basis = Basis(sector.mesh, ElementHexS2(), intorder=5)
    rho = sector.material.density
    for axis in range(3):
        unit = np.zeros((len(sector.nodes), 3))
        unit[:, axis] = 1.0
        assert unit.ravel() @ (sector.mass @ unit.ravel()) == pytest.approx(
            rho * basis.dx.sum(), rel=1e-12
        )
    force = sector.body_force(sector.nodes)
    x = np.asarray(basis.global_coordinates())
    np.testing.assert_allclose(
        force.sum(axis=0), rho * (x * basis.dx).sum(axis=(1, 2)), rtol=1e-11, atol=1e-12
    )


def test_against_the_elasticity_form_of_scikit_fem():
    mesh = damper_mesh(Geometry(), MeshDensity(2, 1, 1, 2, 1, 1, 1, 1, 1, 1, 1, 2))
    material = ElasticMaterial()
    ours = discretise(mesh, material)
    basis = Basis(mesh, ElementVector(ElementHexS2()), intorder=5)
    theirs = linear_elasticity(
        *lame_parameters(material.youngs_modulus, material.poisson_ratio)
    ).assemble(basis)
    # A smooth displacement in either numbering: theirs carries the component of each degree of freedom.
    rng = np.random.default_rng(2)
    component = np.empty(basis.N, int)
    component[basis.element_dofs] = (np.arange(60) % 3)[:, None]
    field = rng.standard_normal((3, 3))
    values = [np.sin(100 * x @ field) for x in (ours.nodes, basis.doflocs.T)]
    u, v = values[0].ravel(), values[1][np.arange(basis.N), component]
    assert u @ (ours.stiffness @ u) == pytest.approx(v @ (theirs @ v), rel=1e-11)
