"""One factorisation of the inside of a sector for all nodal diameters."""

import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_matrix, diags, identity, kron
from scipy.sparse.linalg import LinearOperator, eigsh, splu

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem import factorisation, sector_inside
from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.factorisation import factorise
from bdamper.fem.generated_models import SectorFE
from bdamper.fem.lowest_modes import lowest_modes
from bdamper.fem.meshes import MeshDensity
from bdamper.fem.sector_faces import no_faces
from bdamper.util.errors import BdamperWarning

SMALL = MeshDensity(2, 1, 1, 2, 1, 1, 1, 3, 3, 1, 2, 6)
DIAMETERS = [0, 3, 32]
ROUNDING = 5e-9
"""Of squared frequencies: the terms of the strain energy are up to 1e7 times their sum."""


@pytest.fixture(scope="module")
def fe():
    return SectorFE(density=SMALL)


def extended(matrix):
    """A matrix in the longest floating-point type of the machine, where it is longer."""
    return matrix.astype(np.clongdouble if np.iscomplexobj(matrix) else np.longdouble)


def exact_omega2(sector, shapes):
    """Rayleigh quotients of reduced shapes without the rounding of the strain energy."""
    shapes = extended(shapes)
    strain = np.einsum("ij,ij->j", shapes.conj(), extended(sector.stiffness) @ shapes)
    kinetic = np.einsum("ij,ij->j", shapes.conj(), extended(sector.mass) @ shapes)
    return (strain.real / kinetic.real).astype(float)


@pytest.mark.slow
@pytest.mark.parametrize("d", DIAMETERS)
def test_the_solver_inverts_the_stiffness_of_a_nodal_diameter(fe, d):
    sector = fe.cyclic(d)
    force = np.random.default_rng(d).standard_normal((sector.stiffness.shape[0], 3))
    expected = splu(sector.stiffness.tocsc()).solve(force.astype(sector.stiffness.dtype))
    found = sector.solver.solve(force)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * scale)
    one = sector.solver.solve(force[:, 0])
    np.testing.assert_allclose(one, found[:, 0], rtol=0.0, atol=1e-12 * scale)


@pytest.mark.slow
@pytest.mark.parametrize("d", DIAMETERS)
def test_shapes_are_as_accurate_as_from_a_factorisation_of_the_nodal_diameter(fe, d):
    """What remains of a difference in the frequencies is rounding of the strain energy.

    The frequencies of two solutions differ by up to 1e-9 in double precision.  In extended precision
    their shapes have the same frequencies, which therefore are those of the matrices.
    """
    sector = fe.cyclic(d)
    omega2, _ = sector.modes(20)
    exact = exact_omega2(sector, sector._reduced_shapes[:, :20])
    factors = splu(sector.stiffness.tocsc())
    n, dtype = sector.mass.shape[0], sector.mass.dtype
    flexibility = LinearOperator((n, n), lambda x: factors.solve(x.astype(dtype)), dtype=dtype)
    _, shapes = eigsh(
        sector.stiffness, 20, M=sector.mass, sigma=0.0, v0=np.ones(n), OPinv=flexibility
    )
    reference = np.sort(exact_omega2(sector, shapes))
    if np.finfo(np.longdouble).eps < 1e-18:
        np.testing.assert_allclose(exact, reference, rtol=1e-11)
    np.testing.assert_allclose(omega2, reference, rtol=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("d", DIAMETERS)
def test_modes_of_the_inside_give_upper_bounds_close_to_the_modes(fe, d):
    exact, shapes = fe.cyclic(d).modes(12)
    sector = CyclicSector(fe.blade, fe.faces, fe.clamped, d, fe.cyclic(0).inside)
    near, near_shapes = sector.approximate_modes(12)
    assert np.all(near >= exact * (1.0 - 1e-8))
    np.testing.assert_allclose(np.sqrt(near), np.sqrt(exact), rtol=3e-3)
    overlap = np.abs(np.sum(near_shapes.conj() * (fe.blade.mass @ shapes), axis=0))
    assert overlap[0] == pytest.approx(1.0, abs=1e-6)
    own, _ = sector.modes(12)
    assert np.array_equal(sector.approximate_modes(12)[0], own), "modes that exist are used"


@pytest.mark.slow
def test_static_shapes_that_are_not_stored_give_the_same(fe, monkeypatch):
    stored = CyclicSector(fe.blade, fe.faces, fe.clamped, 3)
    again = CyclicSector(fe.blade, fe.faces, fe.clamped, 3)
    near = stored.approximate_modes(10)[0]
    exact = stored.modes(10)[0]
    expected = stored.inside.face_mass
    force = np.random.default_rng(4).standard_normal((len(stored.inside.inner), 2))
    of_faces = stored.inside.force_on_faces(force)

    # shapes are computed when they are needed first
    monkeypatch.setattr(sector_inside, "STORED", 0.0)
    np.testing.assert_allclose(again.approximate_modes(10)[0], near, rtol=ROUNDING)
    np.testing.assert_allclose(again.modes(10)[0], exact, rtol=ROUNDING)
    found = again.inside.face_mass
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
    scale = np.abs(of_faces).max()
    found = again.inside.force_on_faces(force)
    np.testing.assert_allclose(found, of_faces, rtol=0.0, atol=1e-9 * scale)


def test_a_body_without_faces_is_its_inside(fe):
    body = CyclicSector(fe.blade, no_faces(), fe.clamped, 0)
    force = np.random.default_rng(1).standard_normal(body.stiffness.shape[0])
    expected = splu(body.stiffness.tocsc()).solve(force)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(body.solver.solve(force), expected, rtol=0.0, atol=1e-8 * scale)
    assert len(body.solver.pivots) == len(force) and np.all(body.solver.pivots > 0.0)


def test_pivots_show_an_indefinite_stiffness(fe):
    """By Sylvester's law the inside and the condensed faces have the negative eigenvalues of both."""
    sector = fe.cyclic(3)
    lowest = sector.modes(2)[0]
    held = sector.inside.held_modes(1)[0][0]
    # with held faces a structure is stiffer: between both only the stiffness of the faces is negative
    assert held > lowest[0] * (1.0 + 1e-6)
    of_faces = 0.5 * (lowest[0] + held)
    for shift, n_negative in ((0.5 * lowest[0], 0), (of_faces, 1), (lowest.mean(), 1)):
        softer = replace(fe.blade, stiffness=fe.blade.stiffness - shift * fe.blade.mass)
        pivots = CyclicSector(softer, fe.faces, fe.clamped, 3).solver.pivots
        assert (pivots < 0.0).sum() == n_negative


def test_a_complex_factorisation_solves_real_and_complex_forces():
    rng = np.random.default_rng(2)
    factor = rng.standard_normal((6, 6)) + 1j * rng.standard_normal((6, 6))
    dense = factor @ factor.conj().T + 6.0 * np.eye(6)
    force = rng.standard_normal((6, 2))
    for load in (force, force[:, 0], 1j * force):
        found = factorise(csr_matrix(dense)).solve(load)
        np.testing.assert_allclose(found, np.linalg.solve(dense, load), rtol=1e-12)
    real = dense.real
    for load in (force, force[:, 0], force + 2j * force[::-1]):
        found = factorise(csr_matrix(real)).solve(load)
        np.testing.assert_allclose(found, np.linalg.solve(real, load), rtol=1e-12)


def test_lowest_modes_of_a_chain_with_double_frequencies():
    """Two equal chains of springs between walls: omega2 = 4 sin2(pi k / (2 n + 2))."""
    n, n_modes = 200, 9
    chain = np.diag(np.full(n, 2.0)) - np.eye(n, k=1) - np.eye(n, k=-1)
    stiffness = csr_matrix(np.kron(np.eye(2), chain))
    mass = csr_matrix(np.eye(2 * n))
    omega2, shapes = lowest_modes(stiffness, mass, factorise(stiffness).solve, n_modes)
    k = np.repeat(np.arange(1, 6), 2)[:n_modes]
    expected = 4.0 * np.sin(np.pi * k / (2 * n + 2)) ** 2
    np.testing.assert_allclose(omega2, expected, rtol=1e-11)
    np.testing.assert_allclose(shapes.T @ shapes, np.eye(n_modes), atol=1e-12)


# ---- large matrices ----


@pytest.fixture
def grid():
    """Stiffness of a grid of 20 x 20 springs to its neighbours and the ground."""
    line = diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(20, 20))
    one = identity(20)
    return csr_matrix(kron(line, one) + kron(one, line) + 0.1 * identity(400))


def test_without_the_extra_a_line_says_what_to_install(grid, monkeypatch):
    monkeypatch.setitem(sys.modules, "pypardiso", None)  # its import fails
    force = np.random.default_rng(3).standard_normal((400, 2))
    monkeypatch.setattr(factorisation, "LARGE", 399)
    expected = r"400 equations .* install the extra bdamper\[large\]"
    with pytest.warns(BdamperWarning, match=expected) as caught:
        factors = factorise(grid)
    assert len(caught) == 1
    np.testing.assert_allclose(grid @ factors.solve(force), force, atol=1e-12)
    # no word about a smaller matrix
    monkeypatch.setattr(factorisation, "LARGE", 400)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert isinstance(factorise(grid), factorisation.SuperLUFactors)


class TestPardiso:
    @pytest.fixture(autouse=True)
    def every_matrix_is_large(self, monkeypatch):
        pytest.importorskip("pypardiso", reason="pypardiso is not installed (extra bdamper[large])")
        monkeypatch.setattr(factorisation, "LARGE", 0)

    def test_solutions_and_pivots_are_those_of_the_matrix(self, grid):
        factors = factorise(grid)
        assert isinstance(factors, factorisation.PardisoFactors)
        force = np.random.default_rng(3).standard_normal((400, 2))
        for load in (force, force[:, 0], force + 1j * force[::-1]):
            expected = np.linalg.solve(grid.toarray(), load)
            np.testing.assert_allclose(factors.solve(load), expected, rtol=1e-9, atol=1e-12)
        # the determinant is the product of the pivots
        _, log_determinant = np.linalg.slogdet(grid.toarray())
        assert np.log(factors.pivots).sum() == pytest.approx(log_determinant, rel=1e-12)

    def test_several_factorisations_live_beside_each_other(self, grid):
        first, second = factorise(grid), factorise(2.0 * grid)
        force = np.ones(400)
        displacement = first.solve(force)
        np.testing.assert_allclose(second.solve(force), 0.5 * displacement, rtol=1e-9)
        del second
        np.testing.assert_allclose(first.solve(force), displacement, rtol=1e-12)

    def test_it_computes_on_one_thread_and_leaves_the_number_of_threads(self, grid, monkeypatch):
        from pypardiso import PyPardisoSolver

        library = PyPardisoSolver().libmkl
        before = library.MKL_Get_Max_Threads()
        library.MKL_Set_Num_Threads(2)
        seen = []
        call = PyPardisoSolver._call_pardiso

        def counted(self, *matrices):
            seen.append(library.MKL_Get_Max_Threads())
            return call(self, *matrices)

        monkeypatch.setattr(PyPardisoSolver, "_call_pardiso", counted)
        try:
            factorise(grid).solve(np.ones(400))
            after = library.MKL_Get_Max_Threads()
        finally:
            library.MKL_Set_Num_Threads(before)
        # factorisation and solution; others release memory
        assert seen[:2] == [1, 1]
        assert after == 2

    def test_an_indefinite_matrix_goes_to_superlu(self, grid):
        eigenvalues = np.linalg.eigvalsh(grid.toarray())
        shifted = csr_matrix(grid - eigenvalues[:2].mean() * identity(400))
        factors = factorise(shifted)
        assert isinstance(factors, factorisation.SuperLUFactors)
        force = np.ones(400)
        np.testing.assert_allclose(shifted @ factors.solve(force), force, atol=1e-9)

    @pytest.mark.parametrize("d", DIAMETERS)
    def test_a_sector_has_the_same_modes_and_receptances(self, fe, d):
        found = CyclicSector(fe.blade, fe.faces, fe.clamped, d)
        assert isinstance(found.inside.factors, factorisation.PardisoFactors)
        found.modes(12)
        expected = fe.cyclic(d)
        expected.modes(12)
        if np.finfo(np.longdouble).eps < 1e-18:
            exact = [exact_omega2(s, s._reduced_shapes[:, :12]) for s in (found, expected)]
            np.testing.assert_allclose(exact[0], exact[1], rtol=1e-9)
        tip = csr_matrix(([1.0], ([0], [3 * fe.blade.nodes[:, 1].argmax()])), (1, fe.blade.n_dof))
        assert found.receptance(tip) == pytest.approx(expected.receptance(tip), rel=1e-8)
