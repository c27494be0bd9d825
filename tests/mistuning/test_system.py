"""Equations of a whole wheel: what the elimination leaves out, the tuned limit, static states, missing dampers."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.equations import Fixed
from bdamper.mistuning import DamperVariation
from bdamper.mistuning.bladed_disk import BladedDisk
from bdamper.mistuning.disk_equations import of_blade
from bdamper.mistuning.disk_problem import disk_system
from bdamper.mistuning.peak_search import family_shapes, reduced_state
from bdamper.response.events import ContinuationOptions
from bdamper.util.progress import CostMeter
from tests.following import find_start
from tests.mistuning.lumped import lumped_study, size, solution
from tests.mistuning.lumped import wave as wave_of
from tests.mistuning.test_symmetry import PATTERN, study

PRELOAD = 300.0


def wheel(n_blades=6, harmonics=2, amplitude=100.0, **options):
    study = lumped_study(n_blades, 1, harmonics=harmonics, n_c=2, r=2, **options)
    return BladedDisk(study.replace(excitation=bd.Excitation("tip", amplitude=amplitude)))


@pytest.mark.parametrize(
    ("n_blades", "harmonics", "options"),
    [(3, 1, {}), (4, 2, {"n_att": 2}), (7, (1, 3), {"bias": False})],
)
@pytest.mark.parametrize("n_kept", [1, 8])
def test_bordered_equations_of_a_wheel_are_those_of_dense_algebra(
    n_blades, harmonics, options, n_kept
):
    """With more or less of the disk's coupling left to iterations; orders and missing dampers of all kinds."""
    rng = np.random.default_rng(3)
    w = wheel(n_blades, harmonics, **options).replace(mistuning=0.03 * rng.normal(size=n_blades))
    far = 0.01 * np.cos(4.0 * np.pi * np.arange(n_blades) / n_blades)[:, None, None] * np.eye(2)
    w = BladedDisk(
        w.study,
        w.mistuning,
        _structure=replace(w.structure, disk_mass=w.structure.disk_mass + far, n_kept=n_kept),
    )
    for dampers in (None, DamperVariation.random(n_blades, mass=0.1, missing=[1], seed=1)):
        system = w.replace(dampers=dampers).system(PRELOAD).structure.held(1e-3)
        u = system.structure.at_rest + 1e-6 * rng.normal(size=system.n_unknowns)
        y, row = np.append(u, 2.0 * np.pi * 180.0), rng.normal(size=len(u) + 1)
        scale = system.structure.units_about(y, 10.0)
        _, J, C = system.evaluate_at(y)
        B = np.vstack([np.column_stack([J, C]) * scale, row])
        right = rng.normal(size=(2, len(y)))
        for transposed in (False, True):
            found = right.copy()
            status, _, rank, orientation = system.core.bordered(y, row, scale, found, transposed)
            expected = np.linalg.solve(B.T if transposed else B, right.T).T
            assert np.abs(found - expected).max() < 1e-8 * np.abs(expected).max()
            assert (status, rank, orientation) == (0, len(y), np.linalg.slogdet(B)[0])


def test_springs_pull_the_mean_of_dampers_to_their_place_at_rest():
    system = wheel(5, 1).system(PRELOAD)
    rng, n = np.random.default_rng(4), system.structure.structure.n
    y = np.append(system.structure.at_rest + 1e-6 * rng.normal(size=system.n_unknowns), 900.0)
    pulled = system.structure.array(system.structure.held(0.1).residual(y) - system.residual(y))
    off = system.structure.array(y[:-1] - system.structure.at_rest)[:, 0, n:]
    springs = 0.1 * system.structure.stuck
    np.testing.assert_allclose(
        pulled[:, 0, n:], springs * off, rtol=1e-6, atol=1e-9 * np.abs(pulled).max()
    )
    assert np.abs(pulled[:, 1:]).max() < 1e-9 * np.abs(pulled).max() > 0.0
    assert not pulled[..., :n].any()


@pytest.mark.slow
def test_a_part_of_a_step_is_taken_where_the_whole_leads_further_away():
    """Near a peak Newton's method with whole steps fails, and so it does with those that reduce the residual."""
    system = BladedDisk(study(), PATTERN).system(PRELOAD).structure.held(0.1)
    found = dict.fromkeys((0, 1, 2), 0)
    for f in np.linspace(200.0, 500.0, 16):
        y = np.append(system.structure.at_rest, 2.0 * np.pi * f)
        for line_search in found:
            c = system.correct_at(
                y[:-1], y[-1], system.structure.units_about(y, 1.0), 1e-9, 60, line_search
            )
            found[line_search] += c.status == 0
    # 15 or 16, by the rounding of the processor
    assert max(found[0], found[1]) < 14 < found[2], found


def test_steps_that_lead_to_and_fro_end_early_where_a_rough_point_is_enough():
    """With dampers free Newton's method finds no solution from that at rest at some frequencies, and one at others.

    At 300 and 340 Hz rounding decides whether it does.
    """
    system = BladedDisk(study(), PATTERN).system(300.0)
    for f, found in ((240.0, True), (400.0, True), (310.0, False), (320.0, False), (330.0, False)):
        y = np.append(system.structure.at_rest, 2.0 * np.pi * f)
        scale = system.structure.units_about(y, 1.0)
        whole, early = (
            system.solve(y, Fixed(), scale, 1e-9, 25, 2, rough=rough) for rough in (0.0, 1e-2)
        )
        assert (whole.status == 0) == (early.status == 0) == found
        assert (
            early.iterations == whole.iterations
            if found
            else early.iterations < 13 < whole.iterations == 25
        )


def test_newton_ends_where_it_may():
    system = wheel(6, 1).system(PRELOAD)
    y = np.append(system.structure.at_rest, 2.0 * np.pi * 190.0)
    scale, row = system.structure.units_about(y, 1.0), np.eye(len(y))[-1]

    def ended(**options):
        at, tangent = y.copy(), np.zeros(len(y))
        c = system.core.solve(at, tangent, scale, 1e-11, 40, 2, 0.0, row=row, **options)
        assert c.status == 0 and np.linalg.norm(tangent) == pytest.approx(1.0)
        assert c.residual == pytest.approx(size(system, system.residual(at)), rel=1e-12, abs=1e-15)
        return c

    whole, loose, rough = ended(), ended(loose=1e9), ended(loose=1e9, rough=1e-4)
    assert whole.residual <= 1e-11 < rough.residual < 1e-4 < loose.residual
    assert loose.iterations < rough.iterations < whole.iterations


@pytest.mark.parametrize("harmonics", [1, 3])
def test_a_tuned_wheel_has_the_waves_of_the_study(harmonics):
    w = wheel(6, harmonics)
    tuned = w.structure.tuned
    system, omega = w.system(PRELOAD), 2.0 * np.pi * 200.0
    y, _ = find_start(tuned, PRELOAD, omega, ContinuationOptions(tolerance=1e-11), CostMeter())
    wave = system.structure.flat(wave_of(w.structure, y[:-1]))
    assert size(system, system.residual(np.append(wave, omega))) < 1e-10
    found = solution(system, omega)
    assert found.status == 0
    assert 0.1 < system.contact(wave)[2][:, 1].mean() < 0.9
    assert np.abs(found.y[:-1] - wave).max() < 1e-7 * np.abs(wave).max()
    rows = tuned.system(PRELOAD).response(y[:-1])
    np.testing.assert_allclose(
        system.structure.responses(wave)[0], rows, rtol=1e-9, atol=1e-12 * np.abs(rows).max()
    )
    for blade in (0, 4):
        own = system.structure.responses(found.y[:-1])[blade, 1]
        assert of_blade(system, blade).rows.value(found.y) == pytest.approx(own)


def test_the_static_state_of_dampers_that_are_alike_is_that_of_the_study():
    w = wheel(5, 1)
    ones = np.ones(5)
    alike = DamperVariation(ones, ones, ones, 0.0 * ones, np.zeros(5, bool))
    system, other = w.system(PRELOAD), w.replace(dampers=alike).system(PRELOAD)
    assert (
        np.abs(other.structure.at_rest - system.structure.at_rest).max()
        < 1e-8 * np.abs(system.structure.at_rest).max()
    )
    slip = np.abs(system.structure.points.slider - other.structure.points.slider)
    assert slip.max() < 1e-8 * np.abs(system.structure.points.slider).max()


def test_a_missing_damper_leaves_its_place_empty():
    rng = np.random.default_rng(5)
    gone = np.arange(6) == 2
    mass, mu, stiffness, gap = rng.random((4, 6))
    dampers = DamperVariation(
        1.0 + 0.2 * mass, 1.0 + 0.1 * mu, 1.0 - 0.2 * stiffness, 1e-7 * gap, gone
    )
    w = wheel(6, 1).replace(dampers=dampers, mistuning=0.01 * rng.normal(size=6))
    system = w.system(PRELOAD)
    found = solution(system, 2.0 * np.pi * 190.0)
    assert found.status == 0
    n, X = w.structure.n, system.structure.array(found.y[:-1])
    F = system.contact(found.y[:-1])[1].reshape(6, -1, 3, 3)
    assert not X[2, :, n:].any() and not F[2].any()
    assert F[[1, 3]].any(axis=(1, 2, 3)).all()
    balance = F[..., 0].reshape(6, -1) @ w.structure.rows[..., n:].reshape(-1, 6)
    load = system.structure.array(system.structure.force)[:, 0, n:]
    assert np.abs(balance - load).max() < 1e-8 * np.abs(load).max()
    assert load[0].max() > 0.0 and load[2].max() == 0.0


def hard_disk():
    return bd.Study(
        bd.reference_model("bladed_disk", contact_points=9), bd.Excitation("tip"), 5, friction_coefficient=0.4, harmonics=1,
        contact_stiffness="unit_traction",
    )  # fmt: skip


@pytest.mark.slow
def test_dampers_of_the_hard_disk_that_differ_are_in_equilibrium():
    """From contacts that just touch Newton's method does not arrive there, however small the load."""
    dampers = DamperVariation.random(65, mass=0.05, friction_coefficient=0.1, seed=1)
    w = BladedDisk(hard_disk(), dampers=dampers)
    state, n = w.state(2000.0), w.structure.n
    balance = state.force.reshape(65, -1) @ w.structure.rows[..., n:].reshape(
        -1, state.load.shape[1] - n
    )
    np.testing.assert_allclose(
        balance, state.load[:, n:], atol=1e-8 * np.abs(state.load[:, n:]).max()
    )
    pressed, rubbed = state.force[..., 2], np.abs(state.force[..., :2]).max(axis=-1)
    assert (
        pressed.min() >= 0.0 and (rubbed <= state.points.mu.reshape(65, -1) * pressed + 1e-9).all()
    )
    np.testing.assert_allclose(
        state.load[:, n:].max(axis=1) / state.load[:, n:].max(), dampers.mass / dampers.mass.max()
    )


def test_a_wheel_whose_blades_move_in_as_many_other_shapes_is_the_same():
    """Residuals of the reduced wheel are those of the whole one on its shapes; with fewer shapes they are as well."""
    rng = np.random.default_rng(6)
    w = wheel(5, 1).replace(mistuning=0.03 * rng.normal(size=5))
    whole, state, n = w.system(PRELOAD), w.state(PRELOAD), w.structure.n
    for m in (n, n - 1):
        shapes = rng.normal(size=(n, m))
        row = w.response_row @ shapes
        excitation = np.hstack([w.excitation[:, :n] @ shapes, w.excitation[:, n:]])
        system = disk_system(
            w.structure.reduced(shapes), reduced_state(w.structure, state, shapes), excitation, row
        )
        b = 1e-6 * rng.normal(size=system.structure.shape)
        b[:, 0, m:] += state.mean[:, n:]
        X = np.concatenate([b[..., :m] @ shapes.T, b[..., m:]], axis=2)
        X[:, 0, :n] += state.mean[:, :n]
        omega = 900.0
        r = whole.structure.array(whole.residual(np.append(whole.structure.flat(X), omega)))
        expected = np.concatenate([r[..., :n] @ shapes, r[..., n:]], axis=2)
        found = system.structure.array(system.residual(np.append(system.structure.flat(b), omega)))
        for part in (slice(0, m), slice(m, None)):
            np.testing.assert_allclose(
                found[..., part], expected[..., part], rtol=0, atol=1e-9 * np.abs(r).max()
            )
        moved = whole.structure.responses(whole.structure.flat(X))[:, 1]
        np.testing.assert_allclose(
            system.structure.responses(system.structure.flat(b))[:, 1], moved, rtol=1e-9
        )


@pytest.mark.parametrize(("harmonics", "n_kept"), [(1, 1), (3, 8)])
def test_the_elimination_keeps_what_contacts_bend_most_where_there_are_harmonics(harmonics, n_kept):
    """The last shapes of a blade are the most important ones: without them the stuck frequency is further off."""
    s = wheel(6, harmonics, n_att=14).structure
    shapes = family_shapes(s, 2.0 * np.pi * 200.0)
    assert s.reduced(shapes).n_kept == n_kept

    def stuck(s):
        return s.wave(1, s.tuned.point_stiffness)[0][0]

    last, first = (stuck(s.reduced(shapes[:, at])) for at in (np.arange(5, 13), np.r_[0:7, 12]))
    assert stuck(s) < last < first


def test_a_travelling_wave_is_a_mode_of_the_ring_with_springs():
    """By the forces on all blades and dampers, for each direction of travel."""
    s = wheel(5, 1).structure
    springs, n, root = s.tuned.point_stiffness, s.n, slice(s.n - s.n_root, s.n)
    for d in range(5):
        squares, phi, motion = s.wave(d, springs)
        turned = np.exp(2j * np.pi * d * np.arange(5) / 5)[:, None]
        for k in (0, 1, 2):
            z = turned * phi[:, k]
            parts = z.real, z.imag
            contact = sum(
                f * s.gathered(springs * s.motion(part)) for f, part in zip((1.0, 1j), parts)
            )
            elastic = sum(f * s.elastic_forces(part[:, :n]) for f, part in zip((1.0, 1j), parts))
            force = contact + np.hstack([elastic, s.damper_stiffness * z[:, n:]])
            inertia = np.hstack([z[:, :n] @ s.mass.T, s.damper_mass.mean(axis=0) * z[:, n:]])
            inertia[:, root] += z[:, root] @ s.disk_mass[d].T
            inertia *= squares[k]
            np.testing.assert_allclose(force, inertia, rtol=0.0, atol=1e-9 * np.abs(inertia).max())
            here = s.motion(z.real)[0] + 1j * s.motion(z.imag)[0]
            np.testing.assert_allclose(
                motion[:, k], here.ravel(), rtol=0.0, atol=1e-12 * np.abs(motion).max()
            )
