"""A8: a lumped bladed disk of 24 sectors without contact.

Each sector is a chain ground - 6e5 - disk (1.2 kg) - 1e6 - blade root (0.35 kg) - 2e6 - blade tip (0.25 kg), the disk
tied to its neighbours by 5e7 N/m.  (The published numbers fix this order: with the two blade springs exchanged they come
out differently.)  Frequencies confirmed by two independent programs.
"""

import numpy as np
import pytest

from bdamper.model.kinematics import Coupling
from bdamper.model.structure import Body, Interface, Location, ModalBasis, Model

N = 24
MASS = np.array([1.2, 0.35, 0.25])
GROUND, BLADE, TIE = 6e5, (1e6, 2e6), 5e7
HERTZ = {
    0: (88.26374399, 249.31165161, 619.34330474),
    1: (169.3441295, 335.56537939, 619.82021678),
    2: (189.3018526, 555.31017863, 626.2025859),
    12: (195.67605066, 617.32579659, 2062.97567761),
}


def own_stiffness():
    a, b = BLADE
    return np.array([[GROUND + a, -a, 0.0], [-a, a + b, -b], [0.0, -b, b]])


def wave_modes(d):
    """Squared frequencies and modes of one nodal diameter, mass-normalised over a sector."""
    K = own_stiffness()
    K[0, 0] += TIE * (2 - 2 * np.cos(2 * np.pi * d / N))
    root = np.sqrt(MASS)
    omega2, modes = np.linalg.eigh(K / np.outer(root, root))
    return omega2, modes / root[:, None]


def whole_disk():
    """Mass and stiffness of all 72 degrees of freedom."""
    K = np.zeros((3 * N, 3 * N))
    for k in range(N):
        K[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += own_stiffness()
        i, j = 3 * k, 3 * ((k + 1) % N)
        K[i, i] += TIE
        K[j, j] += TIE
        K[i, j] -= TIE
        K[j, i] -= TIE
    return np.tile(MASS, N), K


def disk_model():
    """The blade tips touch those of the next sector, all motion along t1."""
    frame = np.eye(3)[None]
    face = Interface(
        "tip", "friction", "blade", 0, "blade", 1, np.zeros((1, 3)), np.ones(1), frame, np.zeros(1)
    )
    bases = {}
    for d in range(N // 2 + 1):
        omega2, modes = wave_modes(d)
        contact = np.zeros((2, 3, 3))
        contact[:, 0] = modes[2]
        place = np.zeros((3, 3))
        place[0] = modes[2]
        bases[d] = ModalBasis(omega2, np.zeros(3), contact, {"tip": place})
    blade = Body("blade", "constrained", (("tip", "a"), ("tip", "b")), bases)
    return Model(N, {"blade": blade}, {"tip": face}, {"tip": Location("tip", "blade", np.zeros(3))})


@pytest.mark.parametrize("d", HERTZ)
def test_frequencies_of_a_sector(d):
    omega2, _ = wave_modes(d)
    np.testing.assert_allclose(np.sqrt(omega2) / (2 * np.pi), HERTZ[d], rtol=0, atol=6e-9)


def test_frequencies_of_the_whole_disk():
    """Every nodal diameter but 0 and N/2 twice."""
    mass, K = whole_disk()
    root = np.sqrt(mass)
    found = np.sqrt(np.linalg.eigvalsh(K / np.outer(root, root))) / (2 * np.pi)
    expected = np.sort(np.concatenate([np.sqrt(wave_modes(d)[0]) / (2 * np.pi) for d in range(N)]))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("engine_order", [1, 2, 12, 23, 25])
def test_each_harmonic_meets_its_nodal_diameter(engine_order):
    coupling = Coupling(disk_model(), ("tip",), {"blade": np.arange(3)}, engine_order)
    mass, K = whole_disk()
    for harmonic in range(4):
        basis = coupling.basis(harmonic)
        wave = harmonic * engine_order % N
        assert basis.nodal_diameter == min(wave, N - wave)
        if basis.nodal_diameter in HERTZ:
            hertz = np.sqrt(basis.omega2) / (2 * np.pi)
            np.testing.assert_allclose(hertz, HERTZ[basis.nodal_diameter], rtol=0, atol=6e-9)
        # the wave exp(i k 2 pi wave/N) with these modes is an eigenvector of the whole disk, and its relative motion at
        # the tip is that of neighbours in this wave
        modes = wave_modes(basis.nodal_diameter)[1]
        phase = np.exp(2j * np.pi * wave * np.arange(N) / N)
        for j in range(3):
            x = np.kron(phase, modes[:, j])
            np.testing.assert_allclose(
                K @ x, basis.omega2[j] * mass * x, rtol=0, atol=1e-5 * np.abs(K @ x).max() + 1e-3
            )
            assert basis.G[0, 0, j] == pytest.approx(x[5] - x[2], abs=1e-12)
