"""What a wheel must keep: turned patterns, the tuned curve, the solution of the whole annulus as one system."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

import bdamper as bd
from bdamper.harmonic_balance.sector import SectorData
from bdamper.mistuning import BladedDisk, DamperVariation, Mistuning
from bdamper.model.kinematics import HarmonicBasis
from tests.mistuning.lumped import lumped_study, solution

PRELOAD, N = 300.0, 6
PATTERN = Mistuning(0.03 * np.random.default_rng(4).normal(size=N))


def study(engine_order=1, harmonics=1, **options):
    return lumped_study(N, engine_order, harmonics=harmonics, n_c=2, r=2, **options).replace(
        excitation=bd.Excitation("tip", amplitude=100.0)
    )


def solved(wheel, omega=2.0 * np.pi * 190.0, tolerance=1e-12):
    system = wheel.system(PRELOAD)
    found = solution(system, omega, tolerance=tolerance)
    assert found.status == 0
    assert 0.05 < system.contact(found.y[:-1])[2][..., 1].mean() < 0.9
    return system.structure.array(found.y[:-1]), system


def heights(system, X):
    return np.abs(system.structure.responses(system.structure.flat(X))[:, 1])


def taken(dampers, order):
    """The same dampers at other places."""
    names = ("mass", "friction_coefficient", "contact_stiffness", "gap", "missing")
    return DamperVariation(**{name: getattr(dampers, name)[order] for name in names})


def turned(X, blades=1, engine_order=1):
    """The answer that belongs to a pattern turned by some blades: sectors moved on, the wave with them."""
    out = np.roll(X, blades, axis=0)
    for l in range(1, X.shape[1] // 2 + 1):
        z = (out[:, 2 * l - 1] - 1j * out[:, 2 * l]) * np.exp(
            2j * np.pi * engine_order * l * blades / len(X)
        )
        out[:, 2 * l - 1], out[:, 2 * l] = z.real, -z.imag
    return out


def assert_same(found, expected, tolerance):
    """Equal means and equal vibrations, each beside its own largest entry."""
    for part in (slice(0, 1), slice(1, None)):
        assert (
            np.abs(found[:, part] - expected[:, part]).max()
            < tolerance * np.abs(expected[:, part]).max()
        )


def test_a_pattern_turned_by_one_blade_turns_the_answer():
    dampers = DamperVariation.of(N, mass=1.0 + 0.1 * np.arange(N), missing=[3])
    base = BladedDisk(study(harmonics=2), mistuning=PATTERN, dampers=dampers)
    X, _ = solved(base)
    other, _ = solved(
        base.replace(
            mistuning=np.roll(PATTERN.deviation, 1), dampers=taken(dampers, np.arange(N) - 1)
        )
    )
    assert_same(other, turned(X), 1e-12)


def test_dampers_of_another_mass_keep_it_on_other_blades():
    heavy, light = DamperVariation.of(N, mass=1.2), DamperVariation.of(N, mass=0.9)
    wheel = BladedDisk(study(), dampers=heavy)
    one = wheel.structure.damper_mass / 1.2
    changes = ({"mistuning": PATTERN}, 1.2), ({"dampers": light}, 0.9), ({"dampers": None}, 1.0)
    for other, factor in ((wheel.replace(**change), factor) for change, factor in changes):
        np.testing.assert_allclose(other.structure.damper_mass, factor * one, rtol=1e-14)


def test_the_tuned_wheel_tracks_the_curve_of_the_study():
    wheel = BladedDisk(study(harmonics=2))
    curve = wheel.frequency_response(2000.0, (150.0, 215.0))
    assert curve.complete, curve.reason
    tuned = wheel.tuned()
    whole = tuned.frequency_response(2000.0, (150.0, 215.0))
    system = tuned.problem.system(2000.0)
    assert np.ptp(np.abs(curve.blades[..., 1]), axis=1).max() < 1e-7 * curve.amplitude.max()
    near = np.abs(curve.frequency[:, None] - whole.frequency).argmin(axis=1)
    for i in range(0, len(curve), 5):
        found = system.correct_at(
            whole.unknowns[near[i]],
            2.0 * np.pi * curve.frequency[i],
            np.full(system.n_unknowns + 1, 1e-6),
            1e-11,
            30,
            True,
        )
        assert found.status == 0
        assert abs(abs(system.response(found.y[:-1])[1]) / curve.amplitude[i] - 1.0) < 1e-7


def test_bad_input_is_refused_at_once():
    with pytest.raises(
        bd.SettingError, match="mistuning: expected 6 blades, as in the model, found 5"
    ):
        BladedDisk(study(), mistuning=np.zeros(5))
    with pytest.raises(bd.SettingError, match="separation"):
        BladedDisk(study().replace(separation=False))
    bare = study().model
    blade = replace(bare.bodies["blade"], local=None)
    with pytest.raises(bd.ModelError, match="local basis"):
        BladedDisk(study().replace(model=replace(bare, bodies={**bare.bodies, "blade": blade})))


def test_the_whole_annulus_as_one_system_has_the_same_solution():
    """All sectors in one real modal basis of the mistuned annulus, by the equations of a study of one sector."""
    wheel = BladedDisk(study(harmonics=3, zeta=0.0), mistuning=PATTERN)
    X, system = solved(wheel, tolerance=1e-11)
    s, omega = wheel.structure, 2.0 * np.pi * 190.0
    n, ns, nd, r = s.n, s.n_sector, s.n_damper, s.local.n_interface
    turn = np.exp(2j * np.pi * np.outer(np.arange(N), np.arange(N)) / N) / N
    K, M = np.zeros((2, N, n, N, n))
    for k in range(N):
        for j in range(N):
            for whole, disk in ((K, s.disk_stiffness), (M, s.disk_mass)):
                kernel = np.einsum("d,dij->ij", turn[(k - j) % N], disk)
                assert np.abs(kernel.imag).max() < 1e-9 * np.abs(disk).max()
                whole[k, n - r :, j, n - r :] += kernel.real
        K[k, :, k] += s.stiffness[k]
        M[k, :, k] += s.mass
    omega2, V = scipy.linalg.eigh(K.reshape(N * n, -1), M.reshape(N * n, -1))
    G = np.zeros((N, len(s.sector), 3, N * ns))
    for k in range(N):
        for p, shift in enumerate(s.sector):
            j = (k + shift) % N
            G[k, p, :, : N * n] += s.rows[p, :, :n] @ V[j * n : (j + 1) * n]
            G[k, p, :, N * n + k * nd : N * n + (k + 1) * nd] = s.rows[p, :, n:]
    stiffness = np.concatenate([omega2, np.tile(s.damper_stiffness, N)])
    zero = np.zeros(N * ns)
    basis = HarmonicBasis(
        (), stiffness, zero, G.reshape(-1, 3, N * ns).astype(complex), 0, np.ones(N * ns)
    )

    def modal(force):
        return np.concatenate([V.T @ force[:, :n].ravel(), force[:, n:].ravel()])

    def coordinates(x):
        return np.concatenate([V.T @ M.reshape(N * n, -1) @ x[:, :n].ravel(), x[:, n:].ravel()])

    forces = system.structure.array(system.structure.force)
    force = np.concatenate([modal(forces[:, c]) for c in range(7)])
    whole = SectorData(
        [basis] * 4, system.structure.points, force, [np.zeros(N * ns)] * 4, "event_driven"
    ).equations
    u = np.concatenate([coordinates(X[:, c]) for c in range(7)])
    residual = whole.evaluate(u, omega)[0]
    assert np.abs(residual).max() < 1e-9 * np.abs(force).max()
    scale = np.full(len(u) + 1, np.abs(u).max())
    found = whole.correct_at(u * (1.0 + 1e-4), omega, scale, 1e-11, 30, True)
    assert found.status == 0
    assert np.abs(found.y[:-1] - u).max() < 1e-7 * np.abs(u).max()


def test_a_curve_passes_where_dampers_come_free_along_the_axis():
    """At 397.9 Hz the mean axial force of the fully slipping dampers vanishes, and they move on; only vibration counts."""
    base = lumped_study(8, 1, harmonics=1, n_c=2, r=2).replace(
        excitation=bd.Excitation("tip", amplitude=40.0)
    )
    wheel = BladedDisk(base)
    curve = wheel.frequency_response(PRELOAD, (390.0, 405.0))
    assert curve.complete, curve.reason
    tuned = wheel.tuned().frequency_response(PRELOAD, (390.0, 405.0))
    assert any("drifts" in note for note in tuned.notes)
    assert curve.amplitude[-1] == pytest.approx(tuned.amplitude[-1], rel=1e-6)
