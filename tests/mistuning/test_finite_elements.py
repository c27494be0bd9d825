"""Mistuned wheels with friction against whole annuli put together from finite elements, reduced to the same space.

Matrices and the motion of contact points of the annulus are made in one global frame (`tests.annulus`); the study's contact
law and the dampers' rigid motions are shared.
"""

from functools import cache

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

import bdamper as bd
from bdamper import fem
from bdamper.fem import LocalSizes
from bdamper.mistuning import DamperVariation, Mistuning
from bdamper.mistuning.bladed_disk import BladedDisk
from bdamper.response.events import ContinuationOptions
from bdamper.util.progress import CostMeter
from tests.annulus import Annulus, small_sector, small_wheel
from tests.following import find_start
from tests.mistuning.lumped import size, solution
from tests.mistuning.lumped import wave as wave_of
from tests.mistuning.test_symmetry import assert_same, turned

PRELOAD, ZETA = 100.0, 2e-3

AT = {5: (0.3, 3.0, 345.0), 6: (0.1, 10.0, 345.0), 7: (0.3, 10.0, 345.0), 8: (0.3, 3.0, 270.0)}
"""Friction coefficient, amplitude (N) and frequency (Hz) of wheels of so many blades where dampers slip and lift."""


@cache
def annulus(n_blades):
    return Annulus(small_sector(n_blades, disk=0.3))


def wheel_of(n_blades, harmonics, engine_order=1):
    """A wheel whose blades differ by 2 %."""
    friction, amplitude, _ = AT[n_blades]
    study = bd.Study(
        small_wheel(annulus(n_blades).fe), bd.Excitation("tip", amplitude=amplitude, phase=0.4), engine_order,
        friction_coefficient=friction, harmonics=harmonics, blade_modes=20, contact_stiffness=3e7, damping_ratio=ZETA,
    )  # fmt: skip
    return BladedDisk(study, Mistuning(0.02 * np.random.default_rng(2).normal(size=n_blades)))


def slip_and_separation(wheel, system, X):
    """Share of the cycle in slip, and of friction points that open and close."""
    shares = system.contact(system.structure.flat(X))[2].reshape(len(X), -1, 5)[:, wheel.structure.tuned.friction > 0.0]
    return 0.5 * shares[..., [1, 3]].sum(axis=-1).mean(), ((shares[..., 4] > 0.02) & (shares[..., 4] < 0.98)).mean()


def solved(wheel, frequency):
    """A solution from the wave of the tuned wheel, and the equations."""
    system = wheel.system(PRELOAD)
    omega = 2.0 * np.pi * frequency
    y, _ = find_start(wheel.structure.tuned, PRELOAD, omega, ContinuationOptions(tolerance=1e-10), CostMeter())
    found = solution(system, omega, system.structure.flat(wave_of(wheel.structure, y[:-1])))
    assert found.status == 0
    X = system.structure.array(found.y[:-1])
    assert min(slip_and_separation(wheel, system, X)) > 0.1
    return X, system


class Ring:
    """Residual of all sectors with dense matrices of the projected annulus."""

    def __init__(self, annulus, wheel, system):
        deviation, N = wheel.mistuning.deviation, annulus.N
        self.K, self.M = annulus.projected(deviation)
        tuned_k, tuned_m = annulus.projected()
        # damping of the modes of the tuned annulus, a ratio for all: M sqrt(M^-1 K) in its modes
        values, modes = np.linalg.eigh(np.linalg.solve(L := np.linalg.cholesky(tuned_m), np.linalg.solve(L, tuned_k).T))
        modes = L @ modes
        self.C = (modes * (2.0 * ZETA * np.sqrt(values))) @ modes.T
        self.n, self.system, self.place = wheel.structure.n, system, np.argsort(wheel.structure.order)
        coupling = wheel.structure.tuned.coupling
        damper = coupling.model.bodies["damper"]
        half = annulus.contact.shape[0] // 2
        n_damper = wheel.structure.n_damper
        blades, own = N * self.n, []
        for s in range(N):
            face = np.zeros((coupling.n_points, 3, blades + N * n_damper))
            sides = {"left": annulus.contact_rows(s)[:half], "right": annulus.contact_rows((s + 1) % N)[half:]}
            for name in coupling.interfaces:
                rows = coupling.rows(name)
                if name in sides:
                    face[rows, :, :blades] = (sides[name] @ annulus.basis).reshape(-1, 3, blades)
                shapes = damper.bases[0].contact_modes[coupling.model.port_slice("damper", (name, "a"))]
                columns = slice(blades + s * n_damper, blades + (s + 1) * n_damper)
                face[rows, :, columns] = -shapes[..., coupling.modes["damper"]].real
            face[:, 2] *= -1.0  # closing
            own.append(face)
        self.G = np.array(own)

    def all_coordinates(self, X):
        """(n_coefficients, n_all): blades of all sectors in the order of the local basis, then dampers."""
        return np.concatenate(
            [X[..., self.place].transpose(1, 0, 2).reshape(X.shape[1], -1),
             X[..., self.n :].transpose(1, 0, 2).reshape(X.shape[1], -1)], axis=1,
        )  # fmt: skip

    def residual(self, X, omega):
        x = self.all_coordinates(X)
        blades = len(self.K)
        motion = np.einsum("spcj,lj->spcl", self.G, x)
        scene = self.system.structure
        own, F, _ = (part.reshape(motion.shape[:2] + part.shape[1:]) for part in self.system.contact(scene.flat(X)))
        motion[..., 0] += scene.points.shift.reshape(motion.shape[:3])
        np.testing.assert_allclose(own, motion, rtol=0, atol=1e-9 * np.abs(motion).max())
        out = np.einsum("spcj,spcl->lj", self.G, F) - self.all_coordinates(scene.array(scene.force))
        u = x[:, :blades]
        out[:, :blades] += u @ self.K
        for l in range(1, len(x) // 2 + 1):
            c, s, w = 2 * l - 1, 2 * l, l * omega
            out[[c, s], :blades] -= w**2 * (u[[c, s]] @ self.M)
            out[c, :blades] += w * (u[s] @ self.C)
            out[s, :blades] -= w * (u[c] @ self.C)
            out[[c, s], blades:] -= w**2 * x[[c, s], blades:]
        return out

    def of_sectors(self, r):
        """The residual as the wheel has it, sector by sector."""
        N, blades, out = len(self.G), len(self.K), np.empty(self.system.structure.shape)
        out[..., self.place] = r[:, :blades].reshape(len(r), N, -1).transpose(1, 0, 2)
        out[..., self.n :] = r[:, blades:].reshape(len(r), N, -1).transpose(1, 0, 2)
        return out


@pytest.mark.slow
@pytest.mark.parametrize("n_blades", AT)
def test_a_mistuned_wheel_solves_the_equations_of_the_annulus(n_blades):
    """Friction and separation, three harmonics: the annulus' equations at any motion, and their own solution."""
    wheel = wheel_of(n_blades, 3)
    frequency = AT[n_blades][2]
    found, system = solved(wheel, frequency)
    ring, omega = Ring(annulus(n_blades), wheel, system), 2.0 * np.pi * frequency
    random = np.random.default_rng(1).normal(size=system.structure.shape)
    X = found + 0.3 * np.abs(found).max(axis=(0, 2), keepdims=True) * random
    assert min(slip_and_separation(wheel, system, X)) > 0.1
    own = system.structure.array(system.residual(np.append(system.structure.flat(X), omega)))
    exact = ring.residual(X, omega)
    np.testing.assert_allclose(ring.all_coordinates(own), exact, rtol=0, atol=1e-9 * np.abs(exact).max())
    amplitude = np.abs(system.structure.responses(system.structure.flat(found))[:, 1])
    assert amplitude.max() > 1.5 * amplitude.min()
    # the annulus' equations solved by themselves, from a motion that is off by a ten-thousandth
    X = (1.0 + 1e-4 * np.sin(np.arange(found.size)).reshape(found.shape)) * found
    for _ in range(30):
        r = system.structure.flat(ring.of_sectors(ring.residual(X, omega)))
        if size(system, r) < 1e-11:
            break
        y = np.append(system.structure.flat(X), omega)
        step = system.solve_linear(y, np.eye(len(y))[-1], np.ones(len(y)), -np.append(r, 0.0)[None])[0]
        X = X + system.structure.array(step[:-1])
    assert size(system, r) < 1e-11
    assert_same(X, found, 1e-7)


@pytest.mark.slow
def test_a_tuned_wheel_has_the_wave_of_its_study():
    wheel = wheel_of(8, 3).replace(mistuning=None)
    system = wheel.system(PRELOAD)
    omega = 2.0 * np.pi * AT[8][2]
    y, _ = find_start(wheel.structure.tuned, PRELOAD, omega, ContinuationOptions(tolerance=1e-11), CostMeter())
    wave = system.structure.flat(wave_of(wheel.structure, y[:-1]))
    assert size(system, system.residual(np.append(wave, omega))) < 1e-7


def test_directions_of_a_wheel_of_finite_elements():
    """A pattern turned by a blade turns the answer; blades that are twisted have no mirror plane."""
    frequency = 330.0
    forward = wheel_of(5, 1)
    pattern, backward = forward.mistuning, wheel_of(5, 1, engine_order=4)
    found, system = solved(forward, frequency)
    other, _ = solved(forward.replace(mistuning=np.roll(pattern.deviation, 1, axis=0)), frequency)
    assert_same(other, turned(found), 1e-7)
    height = np.abs(system.structure.responses(system.structure.flat(found))[:, 1])
    for mistuning, places in ((pattern.deviation[-np.arange(5)], -np.arange(5)), (pattern, np.arange(5))):
        back, system = solved(backward.replace(mistuning=mistuning), frequency)
        ratio = np.abs(system.structure.responses(system.structure.flat(back))[:, 1])[places] / height
        assert np.abs(ratio - 1.0).max() > 1e-3


@pytest.mark.slow
def test_a_disk_of_six_blades_whose_dampers_differ():
    """What is built passes the checks of a model, and the state of its dampers is proportional to the load."""
    model = fem.bladed_disk(points=4, engine_order=2, fe=fem.SectorFE(fem.Geometry(n_blades=6)), wheel=LocalSizes())
    study = bd.Study(model, bd.Excitation("tip"), 2, friction_coefficient=0.4, harmonics=1)
    dampers = DamperVariation.random(6, mass=0.05, friction_coefficient=0.1, missing=[3], seed=1)
    wheel = BladedDisk(study, dampers=dampers)
    one, ten = wheel.state(1000.0), wheel.state(1e4)
    np.testing.assert_allclose(ten.force, 10.0 * one.force, atol=1e-7 * np.abs(ten.force).max())
    assert one.force[[2, 4]].any(axis=(1, 2)).all() and not one.force[3].any()
