"""Whitehead's bound on the amplification of a linear wheel of one family: kept by random wheels, reached by the worst."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.mistuning import BladedDisk, DiskPeakOptions, Mistuning
from bdamper.mistuning.disk_equations import DiskMatrices
from bdamper.model.modal_basis import LocalBasis
from tests.models import wedge_model

OMEGA = 2.0 * np.pi * 200.0
ROOT = 50.0
"""Stiffness of the root, relative to that of the cantilever mode, where the disk is soft."""


def study(n_blades, order, disk, zeta, m=0.95):
    """A wheel whose blades do not touch the dampers; ``disk`` (N/2 + 1,) adds to the stiffness of the roots.

    A root that yields takes ``K m^2 / (ROOT + disk)`` from the stiffness K of a cantilever mode that moves it by a mass m.
    """
    model = wedge_model(0, n_blades=n_blades, engine_order=order, n_points=4, n_damper_modes=0)
    n_points = sum(model.interfaces[name].n_points for name, _ in model.bodies["blade"].ports)
    waves = n_blades // 2 + 1
    local = LocalBasis(
        region="masses",
        omega2=np.array([OMEGA**2]),
        damping_ratio=np.full(2, zeta),
        blade_stiffness=np.diag([OMEGA**2, 0.0]),
        blade_mass=np.array([[1.0, m], [m, 1.0]]),
        disk_stiffness=(OMEGA**2 * (ROOT + np.asarray(disk, float)))
        .reshape(-1, 1, 1)
        .astype(complex),
        disk_mass=np.zeros((waves, 1, 1), complex),
        contact_modes=np.zeros((n_points, 3, 2)),
        locations={"tip": np.array([[1.0, 0.0]] * 3)},
    )
    blade = model.bodies["blade"]
    bases = {d: local.nodal_diameter(d) for d in range(waves)}
    model = replace(
        model, bodies={**model.bodies, "blade": replace(blade, bases=bases, local=local)}
    )
    return bd.Study(
        model,
        bd.Excitation("tip"),
        order,
        harmonics=1,
        contact_stiffness=1e5,
        constraint_planes=True,
        blade_modes=2,
    )


def amplification(structure, order, deviations):
    """(n_wheels,) highest amplitudes over that of the tuned wheel, and where: dense solutions at all resonances."""
    N = structure.n_blades
    f = np.zeros((N, 2), complex)
    f[:, 0] = np.exp(2j * np.pi * order * np.arange(N) / N)
    F = np.exp(2j * np.pi * np.outer(np.arange(N), np.arange(N)) / N) / np.sqrt(N)

    def ring(waves):
        return np.einsum("nd,dij,md->nimj", F, waves, F.conj()).reshape(2 * N, 2 * N)

    disk, mass, damping = (
        np.zeros((N, 2, 2), complex),
        np.zeros((N, 2, 2), complex),
        ring(structure.damping),
    )
    disk[:, 1:, 1:], mass[:] = structure.disk_stiffness, structure.mass
    mass[:, 1:, 1:] += structure.disk_mass
    disk, mass = ring(disk), ring(mass)
    out = []
    for deviation in [np.zeros(N), *deviations]:
        K = disk.copy()
        blades = structure.varied(Mistuning(deviation), np.ones(len(deviation))).stiffness
        for n in range(N):
            K[2 * n : 2 * n + 2, 2 * n : 2 * n + 2] += blades[n]
        own = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, K)).real)
        own = np.sort(own)[:N]  # modes of the blades; modes of the roots lie above
        zeta = structure.local.damping_ratio[0]
        omega = (own[:, None] * (1.0 + zeta * np.linspace(-1.0, 1.0, 5))).ravel()
        Z = K + 1j * omega[:, None, None] * damping - omega[:, None, None] ** 2 * mass
        x = np.linalg.solve(Z, np.broadcast_to(f.reshape(-1, 1), (len(omega), 2 * N, 1)))
        height = np.abs(x[:, ::2, 0]).max(axis=1)
        out.append((height.max(), omega[height.argmax()] / (2.0 * np.pi)))
    top, frequency = np.array(out).T
    return top[1:] / top[0], frequency[1:]


@pytest.mark.slow
def test_random_wheels_keep_the_bound():
    """400 wheels of eight blades: orders, couplings and deviations of all sizes."""
    rng = np.random.default_rng(5)
    bound = (1.0 + np.sqrt(8)) / 2.0
    ratio = []
    for _ in range(20):
        order = int(rng.integers(0, 8))
        disk = 10.0 ** rng.uniform(0.0, 2.5) * (1.0 - np.cos(2.0 * np.pi * np.arange(5) / 8))
        structure = DiskMatrices.of(study(8, order, disk, 1e-3).problem)
        size = 10.0 ** rng.uniform(-3.0, -1.3)
        ratio += amplification(structure, order, size * rng.normal(size=(20, 8)))[0].tolist()
    assert len(ratio) == 400 and max(ratio) < bound
    assert max(ratio) > 0.85 * bound and min(ratio) > 0.9, (
        "the wheels come near the bound, or it says nothing"
    )


@pytest.mark.parametrize("n_blades", [8, pytest.param(24, marks=pytest.mark.slow)])
def test_the_worst_pattern_reaches_the_bound(n_blades):
    """Only nodal diameter 0 is stiff, and one blade is stiffer by just as much; through the search of the wheel as well."""
    zeta, bound = 1e-5, (1.0 + np.sqrt(n_blades)) / 2.0
    disk = np.zeros(n_blades // 2 + 1)
    disk[0] = 1e4
    one = BladedDisk(study(n_blades, 0, disk, zeta, m=0.3))
    soft, stiff = (np.sqrt(one.structure.local.modes(d)[0][0]) for d in (1, 0))

    def pattern(factor):
        out = np.zeros(n_blades)
        out[0] = factor * (stiff / soft - 1.0)
        return out

    factors = np.linspace(0.95, 1.1, 31)
    found, at = amplification(one.structure, 0, [pattern(f) for f in factors])
    assert 0.99 * bound < found.max() < bound
    k = int(np.argmax(found))
    near = at[k] * (1.0 - 20.0 * zeta), at[k] * (1.0 + 25.0 * zeta)
    peak = one.replace(mistuning=pattern(factors[k])).peak(
        300.0, near, options=DiskPeakOptions(least=20, climbs=1)
    )
    assert peak.blade == 0 and 0.99 * bound < peak.amplification < bound
