"""A mistuned wheel with friction against the whole annulus put together from finite elements, reduced to the same space.

Matrices and the motion of contact points of the annulus are made in one global frame (`tests.annulus`); the study's contact
law and the dampers' rigid motions are shared.
"""

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

import bdamper as bd
from bdamper.continuation.path import ContinuationOptions
from bdamper.continuation.track import find_start
from bdamper.util.cost import CostMeter
from bdamper.wheel.newton import correct
from bdamper.wheel.wheel import Wheel
from tests.annulus import Annulus, small_sector, small_wheel

N, H, ORDER, PRELOAD = 8, 3, 1, 100.0
DEVIATION = 0.02 * np.random.default_rng(2).normal(size=N)
ZETA = 2e-3


@pytest.fixture(scope="module")
def annulus():
    return Annulus(small_sector(N, disk=0.3))


@pytest.fixture(scope="module")
def wheel(annulus):
    model = small_wheel(annulus.fe)
    study = bd.Study(
        model, bd.Excitation("tip", amplitude=1.0, phase=0.4), engine_order=ORDER, friction_coefficient=0.3, harmonics=H,
        blade_modes=20, contact_stiffness=1e7, damping_ratio=ZETA,
    )  # fmt: skip
    return Wheel(study, DEVIATION)


class Ring:
    """Residual of all sectors with dense matrices of the projected annulus."""

    def __init__(self, annulus, wheel, system, deviation):
        self.K, self.M = annulus.projected(deviation)
        tuned_k, tuned_m = annulus.projected()
        # damping of the modes of the tuned annulus, a ratio for all: M sqrt(M^-1 K) in its modes
        values, modes = np.linalg.eigh(np.linalg.solve(L := np.linalg.cholesky(tuned_m), np.linalg.solve(L, tuned_k).T))
        modes = L @ modes
        self.C = (modes * (2.0 * ZETA * np.sqrt(values))) @ modes.T
        self.n, self.system, self.place = wheel.structure.n, system, np.argsort(wheel.structure.order)
        coupling = wheel.tuned().coupling
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
        motion[..., 0] += self.system.shift
        F = self.system.contact.forces(motion.reshape(-1, *motion.shape[2:]), False)[0].reshape(motion.shape)
        out = np.einsum("spcj,spcl->lj", self.G, F) - self.all_coordinates(self.system.force)
        u = x[:, :blades]
        out[:, :blades] += u @ self.K
        for l in range(1, H + 1):
            c, s, w = 2 * l - 1, 2 * l, l * omega
            out[[c, s], :blades] -= w**2 * (u[[c, s]] @ self.M)
            out[c, :blades] += w * (u[s] @ self.C)
            out[s, :blades] -= w * (u[c] @ self.C)
            out[[c, s], blades:] -= w**2 * x[[c, s], blades:]
        return out


@pytest.mark.slow
def test_a_mistuned_wheel_solves_the_equations_of_the_annulus(annulus, wheel):
    system, mean = wheel.system(PRELOAD)
    ring = Ring(annulus, wheel, system, DEVIATION)
    friction = wheel.tuned().friction > 0.0

    def slip_and_separation(X):
        shares = system.forces(X)[1][:, friction]
        return 0.5 * shares[..., [1, 3]].sum(axis=-1).mean(), ((shares[..., 4] > 0.02) & (shares[..., 4] < 0.98)).mean()

    omega = 2.0 * np.pi * 290.0
    # any motion, with much slip and separation
    X = 2e-6 * np.random.default_rng(1).normal(size=system.shape)
    X[:, 0] += mean
    X[system.still] = 0.0
    assert min(slip_and_separation(X)) > 0.1
    exact, own = ring.residual(X, omega), ring.all_coordinates(system.residual(X, omega))
    np.testing.assert_allclose(own, exact, rtol=0, atol=1e-11 * np.abs(exact).max())
    # a solution, from the wave of the tuned wheel
    y, _ = find_start(wheel.tuned(), PRELOAD, omega, ContinuationOptions(tolerance=1e-10), CostMeter(0.0))
    found = correct(system, wheel.structure.wave(y[:-1]), omega, most=40, line_search=True, tolerance=1e-10)
    assert found.converged
    assert min(slip_and_separation(found.X)) > 0.1
    amplitude = np.abs(wheel.response(found.X)[:, 1])
    assert amplitude.max() > 1.5 * amplitude.min()
    r = ring.residual(found.X, omega)
    assert np.abs(r[1:]).max() < 1e-7 * np.abs(system.force[:, 1:]).max()
    assert np.abs(r[0]).max() < 1e-7 * np.abs(system.force[:, 0]).max()


@pytest.mark.slow
def test_a_tuned_wheel_has_the_wave_of_its_study(wheel):
    tuned = wheel.with_(mistuning=None)
    system, _ = tuned.system(PRELOAD)
    omega = 2.0 * np.pi * 290.0
    y, _ = find_start(tuned.tuned(), PRELOAD, omega, ContinuationOptions(tolerance=1e-11), CostMeter(0.0))
    assert system.size(system.residual(tuned.structure.wave(y[:-1]), omega)) < 1e-7
