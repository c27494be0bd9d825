"""Rotating bodies against closed forms, and speed-dependent data against finite element runs at other speeds."""

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from skfem import MeshHex

from bdamper.contact.stiffness import unit_traction
from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.generated_models import SectorFE, bladed_disk, wedge_patches
from bdamper.fem.meshes import (
    ElasticMaterial,
    Geometry,
    MeshDensity,
    discretise,
    geometric_stiffness,
    stiffness_per_squared_speed,
)
from bdamper.fem.rotation import Rotation, coriolis_matrix, spin_displacement
from bdamper.fem.sector_faces import match_faces, no_faces
from bdamper.model.validation import check_model

STEEL = ElasticMaterial(2.1e11, 0.0, 7850.0)


def first_mode(sector, component):
    """Squared frequency of the lowest mode that moves along X, Y or Z (0, 1, 2)."""
    omega2, shapes = sector.modes(4)
    share = [(shapes[k::3] ** 2).sum(axis=0) for k in range(3)]
    return omega2[np.argmax(share, axis=0) == component][0]


def beam(n_elements):
    """Rotating clamped beam, 1 x 0.02 x 0.01 m, that bends in flap along Z and in lag along X; its unit of frequency."""
    mesh = MeshHex.init_tensor(
        np.linspace(-0.01, 0.01, 2),
        np.linspace(0.0, 1.0, n_elements + 1),
        np.linspace(-0.005, 0.005, 2),
    )
    body = discretise(mesh, STEEL)
    held = CyclicSector(body, no_faces(), np.flatnonzero(body.nodes[:, 1] < 1e-9), 0)
    return body, held, np.sqrt(STEEL.youngs_modulus * 0.01**2 / 12.0 / STEEL.density)


@pytest.fixture(scope="module")
def turning():
    body, held, unit = beam(20)
    return body, held, unit, Rotation(stiffness_per_squared_speed(body, held))


@pytest.mark.parametrize(
    ("eta", "expected"), [(0.0, 3.5158), (3.0, 4.7970), (6.0, 7.3600), (12.0, 13.1693)]
)
def test_rotating_beam(turning, eta, expected):
    """First flap mode of a beam clamped at the axis, over eta = Omega sqrt(rho A L^4 / (E I)): published values [1].

    [1] A. D. Wright et al., Vibration modes of centrifugally stiffened beams, J. Appl. Mech. 49 (1982).
    """
    _, held, unit, rotation = turning
    assert np.sqrt(first_mode(rotation.at_speed(held, eta * unit), 2)) / unit == pytest.approx(
        expected, rel=1e-3
    )


def test_lag_and_flap_of_a_square_beam_differ_by_the_spin_softening():
    mesh = MeshHex.init_tensor(
        np.linspace(-0.005, 0.005, 2), np.linspace(0.5, 1.5, 11), np.linspace(-0.005, 0.005, 2)
    )
    body = discretise(mesh, STEEL)
    held = CyclicSector(body, no_faces(), np.flatnonzero(body.nodes[:, 1] < 0.5 + 1e-9), 0)
    omega, rotation = 200.0, Rotation(stiffness_per_squared_speed(body, held))
    faster = rotation.at_speed(held, omega)
    assert first_mode(faster, 0) == pytest.approx(first_mode(faster, 2) - omega**2, rel=1e-3)


def test_geometric_stiffness_resists_no_translation_and_is_linear_in_stress(turning):
    body, held, _, _ = turning
    moved = spin_displacement(held)
    matrix = geometric_stiffness(body, moved)
    size = abs(matrix).max()
    for axis in np.eye(3):
        assert np.abs(matrix @ np.tile(axis, len(body.nodes))).max() < 1e-10 * size
    assert abs(geometric_stiffness(body, 2.5 * moved) - 2.5 * matrix).max() < 1e-12 * size
    assert abs(matrix - matrix.T).max() == 0.0


def test_coriolis_forces_do_no_work(turning):
    body = turning[0]
    matrix = coriolis_matrix(body)
    assert abs(matrix + matrix.T).max() == 0.0
    sideways = np.tile([1.0, 0.0, 0.0], len(body.nodes))
    pushed = (matrix @ sideways).reshape(-1, 3).sum(axis=0)
    assert pushed == pytest.approx([0.0, 1e-2 * 0.02 * 7850.0, 0.0], abs=1e-12)  # S = M (e_z x)


def ring(n_sectors=120, radius=1.0, thickness=0.02, width=0.02):
    half = np.pi / n_sectors
    mesh = MeshHex.init_tensor(
        np.linspace(-half, half, 2),
        radius + thickness * np.array([-0.5, 0.5]),
        np.array([0.0, width]),
    )
    angle, r, z = mesh.p
    body = discretise(MeshHex(np.array([r * np.sin(angle), r * np.cos(angle), z]), mesh.t), STEEL)
    angle = np.arctan2(body.nodes[:, 0], body.nodes[:, 1])
    left, right = (np.flatnonzero(np.abs(angle - side) < 1e-9) for side in (-half, half))
    faces = match_faces(body.nodes, left, right, n_sectors)
    fixed = np.zeros((len(body.nodes), 3), bool)
    fixed[:, 2] = True
    return body, lambda d: CyclicSector(body, faces, fixed, d)


def ring_modes(n, omega, thickness=0.02):
    """In-plane squared frequency of a thin rotating ring of radius 1 with stretching, without Coriolis forces.

    Displacements w radial and v along the ring, w = W cos(n a), v = V sin(n a), hoop stress rho Omega^2 R^2.
    """
    c2, bend = (
        STEEL.youngs_modulus / STEEL.density,
        STEEL.youngs_modulus / STEEL.density * thickness**2 / 12.0,
    )
    stretch = np.array([1.0, n])  # strain of (W, V)
    curve = np.array([n * n - 1.0, 0.0])
    slope = np.array(
        [[n * n + 1.0, 2.0 * n], [2.0 * n, n * n + 1.0]]
    )  # |du/da|^2 of both components
    matrix = (
        c2 * np.outer(stretch, stretch)
        + bend * np.outer(curve, curve)
        + omega**2 * (slope - np.eye(2))
    )
    return np.linalg.eigvalsh(matrix)[0]


def test_rotating_ring():
    body, sector = ring()
    grown = spin_displacement(sector(0)).reshape(-1, 3)
    radius = np.hypot(body.nodes[:, 0], body.nodes[:, 1])
    radial = (grown[:, :2] * body.nodes[:, :2]).sum(axis=1) / radius
    middle = np.abs(radius - 1.0) < 1e-3
    hoop = STEEL.youngs_modulus * (radial / radius)[middle].mean()  # Poisson's ratio is 0
    assert hoop == pytest.approx(STEEL.density, rel=1e-3)  # rho R^2, per squared speed
    rotation = Rotation(stiffness_per_squared_speed(body, sector(0)))
    for n in (2, 4):
        for omega in (0.0, 600.0):
            found = rotation.at_speed(sector(n), omega).modes(1)[0][0]
            assert np.sqrt(found / ring_modes(n, omega)) == pytest.approx(1.0, abs=1e-3), (n, omega)


@pytest.fixture(scope="module")
def fe():
    return SectorFE(Geometry(), MeshDensity(2, 1, 1, 2, 2, 1, 1, 3, 2, 1, 1, 2))


@pytest.fixture(scope="module")
def over_speed(fe):
    return bladed_disk(
        2, n_modes=14, n_damper_modes=6, nodal_diameters=(0, 5), rotation=fe.rotation(600.0), fe=fe
    )


@pytest.mark.slow
@pytest.mark.parametrize("d", [0, 5])
def test_frequencies_at_a_speed_that_the_model_does_not_know(fe, over_speed, d):
    sector = fe.rotation().at_speed(fe.cyclic(d), 450.0)
    exact = sector.modes(6)[0]
    basis = over_speed.at_speed(450.0).bodies["blade"].bases[d]
    assert np.sqrt(np.sort(basis.omega2)[:6] / exact) == pytest.approx(np.ones(6), abs=1e-4)
    at_rest = over_speed.bodies["blade"].bases[d]
    assert at_rest.omega2[0] < 0.9 * exact[0]  # frequency without rotation
    assert at_rest.speed.checked_at == 600.0 and 1e-8 < at_rest.speed.error < 1e-3


@pytest.mark.slow
def test_flexibility_and_contact_stiffness_at_a_speed_that_the_model_does_not_know(fe, over_speed):
    contact = fe.blade_contact(*(wedge_patches(fe.geometry, side, 2) for side in ("left", "right")))
    sector = fe.rotation().at_speed(fe.cyclic(5), 450.0)
    exact, (omega2, shapes) = sector.receptance(contact), sector.modes(10)
    basis = over_speed.bodies["blade"].bases[5]
    faster = over_speed.at_speed(450.0).bodies["blade"].bases[5]
    size = np.linalg.norm(exact)
    assert np.linalg.norm(faster.flexibility - exact) < 1e-4 * size

    def stiffness(flexibility, omega2, modes):
        """Along the normal of the face "left", beside ten modes."""
        rest = flexibility - (modes / omega2) @ modes.conj().T
        return unit_traction(rest[:6, :6], over_speed.interfaces["left"].area).stiffness[:, 2]

    own = faster.omega2[:10], faster.contact_modes.reshape(12, -1)[:, :10]
    expected = stiffness(exact, omega2, contact @ shapes)
    assert stiffness(faster.flexibility, *own) == pytest.approx(expected, rel=0.01)
    stale = stiffness(
        basis.flexibility, *own
    )  # the total flexibility of standstill beside the frequencies of a speed
    assert np.all(stale < 0.97 * expected)
    check_model(over_speed)
    check_model(over_speed.at_speed(450.0))


@pytest.mark.slow
def test_residual_flexibility_stays_positive_and_hardly_changes(over_speed):
    speed = over_speed.bodies["blade"].bases[5].speed
    rest, top = speed.residual(0.0), speed.residual(600.0)
    values = np.linalg.eigvalsh(top)
    assert values[0] > -1e-12 * values[-1]
    assert 1e-3 < np.linalg.norm(top - rest) / np.linalg.norm(rest) < 0.02


@pytest.mark.slow
def test_displacement_by_rotation(fe, over_speed):
    spin = over_speed.bodies["blade"].spin
    assert spin.theory == "linear"
    assert (
        20e-6 < np.abs(spin.contact[:, 2]).max() * 600.0**2 < 200e-6
    )  # far more than a contact gives
    # at nodal diameter 0 both faces of the sector move alike along the radius
    moved = spin_displacement(fe.cyclic(0)).reshape(-1, 3)
    tip = np.argmin(np.linalg.norm(fe.blade.nodes - over_speed.locations["tip"].position, axis=1))
    assert spin.locations["tip"] == pytest.approx(moved[tip], rel=1e-12)
    radial = (moved * fe.blade.nodes)[:, :2].sum(axis=1)
    assert radial[fe.faces.independent].mean() == pytest.approx(
        radial[fe.faces.dependent].mean(), rel=1e-9
    )
