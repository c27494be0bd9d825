"""Cyclic reduction against full rings that know nothing of it: frequencies and the sense of the wave."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")


from bdamper.fem import sector_inside
from bdamper.fem.cyclic_symmetry import CyclicSector, cyclic_transformation
from bdamper.fem.meshes import ElasticMaterial, discretise, join_blocks, turn
from bdamper.fem.sector_faces import match_faces

N = 6


def ring_block(k: int, n_sectors: int = N) -> list:
    """A hub segment with a leaning, swept lug: no symmetry plane, so the two senses of a wave differ."""
    half = np.pi / n_sectors
    angle = np.array([-half, -0.3 * half, 0.3 * half, half])
    z = np.array([-0.1, 0.15])
    hub = np.empty((4, 2, 2, 3))
    for j, radius in enumerate((0.5, 1.0)):
        hub[:, j, :, 0] = (radius * np.sin(angle))[:, None]
        hub[:, j, :, 1] = (radius * np.cos(angle))[:, None]
    hub[..., 2] = z
    lug = np.empty((2, 2, 2, 3))
    lug[:, 0] = hub[1:3, 1]
    lug[:, 1] = hub[1:3, 1] + [0.25, 0.6, 0.2]
    return [block @ np.linalg.matrix_power(turn(2 * half), k).T for block in (hub, lug)]


def clamped_nodes(body) -> np.ndarray:
    return np.flatnonzero(np.hypot(body.nodes[:, 0], body.nodes[:, 1]) < 0.5 + 1e-9)


@pytest.fixture(scope="module")
def ring():
    body = discretise(join_blocks([b for k in range(N) for b in ring_block(k)]), ElasticMaterial())
    fixed = np.zeros(len(body.nodes), bool)
    fixed[clamped_nodes(body)] = True
    return body, np.flatnonzero(np.repeat(~fixed, 3))


def sector_and_faces():
    """One sector, and the nodes of its faces toward -X and +X."""
    body = discretise(join_blocks(ring_block(0)), ElasticMaterial())
    angle = np.arctan2(body.nodes[:, 0], body.nodes[:, 1])
    on = np.hypot(body.nodes[:, 0], body.nodes[:, 1]) < 1.0 + 1e-9
    return body, *(
        np.flatnonzero(on & (np.abs(angle - side * np.pi / N) < 1e-9)) for side in (-1, 1)
    )


@pytest.fixture(scope="module")
def sector():
    body, left, right = sector_and_faces()
    return body, match_faces(body.nodes, left, right, N), clamped_nodes(body)


@pytest.mark.slow
def test_full_ring_has_the_same_frequencies(ring, sector):
    body, free = ring
    full = scipy.linalg.eigh(
        body.stiffness[free][:, free].toarray(),
        body.mass[free][:, free].toarray(),
        eigvals_only=True,
    )
    waves = []
    for d in range(N):
        s = CyclicSector(*sector, d)
        waves.append(scipy.linalg.eigh(s.stiffness.toarray(), s.mass.toarray(), eigvals_only=True))
    np.testing.assert_allclose(np.sort(np.concatenate(waves)), full, rtol=1e-8)


@pytest.mark.parametrize("d", range(N // 2 + 1))
def test_travelling_wave_solves_the_full_ring(ring, sector, d):
    """u(k+1) = R u(k) exp(+2 pi i d/N); with the other sign it must not, unless the wave stands."""
    body, free = ring
    s = CyclicSector(*sector, d)
    omega2, shapes = s.modes(4)
    assert np.isrealobj(shapes) == (d in (0, N // 2))

    def residual(sign: int) -> float:
        u = np.full((len(body.nodes), 3, 4), np.nan, complex)
        for k in range(N):
            turned = np.linalg.matrix_power(turn(2 * np.pi / N), k)
            place = s.body.nodes @ turned.T
            node = np.array([body.nearest_node(x) for x in place])
            wave = np.einsum("ij,njm->nim", turned, shapes.reshape(-1, 3, 4)) * np.exp(
                sign * 2j * np.pi * k * d / N
            )
            u[node] = wave
        u = u.reshape(-1, 4)
        assert np.all(np.isfinite(u))
        force = body.stiffness @ u
        return np.abs((force - body.mass @ u * omega2)[free]).max() / np.abs(force).max()

    assert residual(+1) < 1e-8
    if 0 < d < N // 2:
        assert residual(-1) > 1e-2


def test_modes_are_normalised_over_one_sector_with_a_definite_phase(sector):
    body = sector[0]
    for d in (0, 1):
        omega2, u = CyclicSector(*sector, d).modes(6)
        np.testing.assert_allclose(u.conj().T @ (body.mass @ u), np.eye(6), atol=1e-10)
        square = np.einsum("im,im->m", u, body.mass @ u)
        assert np.all(np.abs(square.imag) < 1e-9)
        assert np.all(square.real > 0.0)
        assert np.all(np.diff(omega2) > 0.0)


@pytest.mark.parametrize("n_modes", [0, 6])
@pytest.mark.parametrize("columns", [64, 3])
def test_receptance_is_hermitian_and_the_sum_over_all_modes(sector, monkeypatch, columns, n_modes):
    """Four right-hand sides in one block or in two, of the whole or of what modes leave."""
    monkeypatch.setattr(sector_inside, "COLUMNS", columns)
    s = CyclicSector(*sector, 2)
    if n_modes:
        s.modes(n_modes)
    contact = np.zeros((4, s.body.n_dof))
    contact[np.arange(4), 3 * s.body.nearest_node([0.2, 1.6, 0.3]) + np.array([0, 1, 2, -3])] = 1.0
    flexibility = s.receptance(sp.csr_matrix(contact))
    np.testing.assert_allclose(flexibility, flexibility.conj().T, rtol=0, atol=0)
    omega2, q = scipy.linalg.eigh(s.stiffness.toarray(), s.mass.toarray())
    phi = contact @ s.transformation @ q
    np.testing.assert_allclose(
        (phi / omega2) @ phi.conj().T, flexibility, atol=1e-10 * np.abs(flexibility).max()
    )


def test_x_or_y_alone_fixed_on_a_face_is_refused(sector):
    body, faces, _ = sector
    fixed = np.zeros((len(body.nodes), 3), bool)
    fixed[[faces.independent[0], faces.dependent[0]], 0] = True
    with pytest.raises(ValueError, match="fixed in only one of the directions X and Y"):
        cyclic_transformation(len(body.nodes), faces, fixed, 1)


def slender_sector():
    """A hub with a needle of 24 elements: its compliance is 2,000 times the flexibility that ten modes leave."""
    hub = ring_block(0)[0]
    top = hub[1:3, 1]
    middle = top.mean(axis=(0, 1))
    thin = middle + 0.02 * (top - middle)
    n, height = 24, 0.6
    needle = []
    for k in range(n):
        block = np.empty((2, 2, 2, 3))
        block[:, 0] = (top if k == 0 else thin) + [0.0, height * k / n, 0.0]
        block[:, 1] = thin + [0.0, height * (k + 1) / n, 0.0]
        needle.append(block)
    body = discretise(join_blocks([hub, *needle]), ElasticMaterial())
    angle = np.arctan2(body.nodes[:, 0], body.nodes[:, 1])
    on = np.hypot(body.nodes[:, 0], body.nodes[:, 1]) < 1.0 + 1e-9
    left, right = (
        np.flatnonzero(on & (np.abs(angle - side * np.pi / N) < 1e-9)) for side in (-1, 1)
    )
    return body, match_faces(body.nodes, left, right, N), clamped_nodes(body)


@pytest.mark.slow
def test_residual_flexibility_of_a_slender_blade_keeps_its_digits():
    """Against the sum over all other modes of the dense eigenproblem; the difference of two solutions loses five digits."""
    body, faces, clamped = slender_sector()
    sector = CyclicSector(body, faces, clamped, 2)
    tip = np.argsort(body.nodes[:, 1])[-8:]
    components = (3 * tip[:, None] + np.arange(3)).ravel()
    contact = sp.identity(3 * len(body.nodes), format="csr")[components]
    n_modes = 10
    omega2, shapes = sector.modes(n_modes)
    at_tip = contact @ shapes
    residual = sector.receptance(contact) - (at_tip / omega2) @ at_tip.conj().T

    all_omega2, all_shapes = scipy.linalg.eigh(sector.stiffness.toarray(), sector.mass.toarray())
    left_out = (contact @ sector.transformation) @ all_shapes[:, n_modes:]
    expected = (left_out / all_omega2[n_modes:]) @ left_out.conj().T
    np.testing.assert_allclose(residual, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())
