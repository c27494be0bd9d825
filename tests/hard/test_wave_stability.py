"""Exponents of disturbances of travelling waves: closed forms, the full annulus with its multipliers, time integration."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.response.events import ContinuationOptions
from bdamper.time_domain.floquet import NEUTRAL, monodromy, multipliers
from bdamper.time_domain.integration import Ring
from bdamper.time_domain.wave_exponents import WaveDisturbances, _pencil
from bdamper.util.progress import CostMeter
from tests.following import find_start
from tests.hard.test_case_04_17_folds_and_peaks import STUCK, followed, two_oscillators
from tests.models import wedge_model
from tests.physics import test_full_annulus as annulus
from tests.plain import plain_study


def study(harmonics, stiffness=1e5):
    """Eight sectors under engine order 2; on soft contact an oscillating disturbance grows near 350 Hz."""
    model = wedge_model(0, n_blades=8, engine_order=2, n_points=4, n_blade_modes=2, harmonics=3, n_damper_modes=0)
    return plain_study(
        model,
        engine_order=2,
        harmonics=harmonics,
        contact_stiffness=stiffness,
        friction_coefficient=0.3,
        damping_ratio=0.01,
        excitation=bd.Excitation("tip", "tangential", 20.0),
    )


@pytest.fixture(scope="module")
def curve():
    return study(3).with_stability(study(3).frequency_response(400.0, (345.0, 350.0)))


def test_at_exponent_zero_stands_the_jacobian(curve):
    """In complex coefficients; at a state where no slider rests at the end of its interval."""
    s = study(3).problem.system(400.0)
    rng = np.random.default_rng(0)
    u = curve.unknowns[0] * (1.0 + 0.3 * rng.normal(size=s.n_unknowns))
    u[s.n_mean :] *= 40.0
    _, _, shares = s.contact(u)
    assert (shares[:8, [1, 3]] > 0.01).all()
    assert (shares[:8, 4] > 0.0).any()
    _, J, _ = s.evaluate(u, 2000.0)

    def exponential(v):
        parts = [s.layout.amplitudes(v, abs(l)) * (1.0 if l == 0 else 0.5) for l in range(-3, 4)]
        return np.concatenate([p.conj() if l < 3 else p for l, p in enumerate(parts)])

    D = WaveDisturbances(s, u, 2000.0).matrix(np.zeros(1))[0]
    for _ in range(5):
        du = rng.normal(size=len(u))
        expected = exponential(J @ du)
        np.testing.assert_allclose(D @ exponential(du), expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def nearest_root(d, root):
    """Newton's method on the determinant."""
    h = 1e-4 * d.omega
    for _ in range(30):
        D = d.matrix(np.array([root, root + h]))
        step = 1.0 / np.trace(np.linalg.solve(D[0], D[1] - D[0])) * h
        root -= step * min(1.0, 0.05 * d.omega / abs(step))
        if abs(step) < 1e-10 * d.omega:
            break
    return root


def test_multipliers_along_the_events_are_roots():
    """Two oscillators with stick, slip and separation, no wave: the memory of sliders away from exponent zero."""
    distance = {}
    for harmonics in (7, 15):
        system = two_oscillators(harmonics)
        points = [p for p in followed(system, 1.0, 2.42, STUCK).points if p.shares[0] < 0.45][::12]
        assert len(points) >= 2
        distance[harmonics] = 0.0
        for p in points:
            d = WaveDisturbances(system, p.y[:-1], p.y[-1])
            period = 2 * np.pi / p.y[-1]
            for value in multipliers(system, p.y[:-1], p.y[-1])[:2]:
                root = nearest_root(d, np.log(value + 0j) / period)
                distance[harmonics] = max(distance[harmonics], abs(np.exp(root * period) - value))
    assert distance[15] < 5e-3
    assert distance[15] < distance[7]


def test_the_turn_of_the_phase_counts_growing_exponents(curve):
    """Constant coefficients, where the exponents are eigenvalues: random contact, dampings of both signs."""
    s, omega = study(3).problem.system(400.0), 2000.0
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(6):
        d = WaveDisturbances(s, curve.unknowns[0], omega)
        n = len(d.l)
        d._length = np.zeros(0)
        A = rng.normal(size=(n, n)) + 1j * rng.normal(size=(n, n))
        # coefficients of a real matrix: those of -l are conjugates
        size = np.array([(d.l == l).sum() for l in (-3, -2, -1, 0, 1, 2, 3)])
        ends = np.cumsum(size)
        flip = np.concatenate([np.arange(e - k, e) for e, k in zip(ends, size)][::-1])
        A = 0.5 * (A + A[np.ix_(flip, flip)].conj())
        d.steady = d.steady + 2e5 * A
        d.damping = d.damping + 20.0 * rng.uniform(-0.2, 3.0)
        # the truth from the eigenvalues of the whole, exact without memory; estimates are spoiled
        shift = 1j * d.l * omega
        whole = d.steady + np.diag(d.stiffness + shift * d.damping + shift**2 * d.mass)
        exact = _pencil(whole, d.damping + 2.0 * shift * d.mass, d.mass)
        first = d.estimates
        d.estimates = lambda first=first: first() + 0.04 * omega * np.sin(7.0 * np.abs(first()) / omega)
        band = 2.5 * omega
        count = d.growing(NEUTRAL * omega, band)
        assert count == ((exact.real > NEUTRAL * omega) & (np.abs(exact.imag) < band)).sum()
        seen.add(count)
    assert len(seen) > 1


def test_an_oscillating_disturbance_is_found_where_the_determinant_sees_none(curve):
    s = study(3).problem.system(400.0)
    assert not curve.stable[-1]
    assert "oscillating or not, up to 4 times the frequency" in curve.stability_note
    _, J, _ = s.evaluate(curve.unknowns[-1], 2 * np.pi * curve.frequency[-1])
    assert np.linalg.slogdet(J)[0] > 0


@pytest.mark.slow
def test_that_disturbance_grows_in_time(curve):
    """All sectors marched from a disturbed wave: the rate of growth is that of the exponent."""
    s = study(3).problem.system(400.0)
    u, omega = curve.unknowns[-1], 2 * np.pi * curve.frequency[-1]
    disturbed = WaveDisturbances(s, u, omega)
    assert disturbed.growing(NEUTRAL * omega, 4 * omega) == 2
    near = [nearest_root(disturbed, root) for root in disturbed.estimates() if abs(root.imag) < 4 * omega]
    grows = np.exp(2 * np.pi / omega * max(root.real for root in near if abs(root.imag) < 4 * omega))
    ring = Ring(s, 8, 2)
    n = 256
    motion = ring.integrate(ring.start(u, omega, n), omega, n, 160).motion  # what decays has decayed
    sizes = []
    for _ in range(2):
        marched = ring.integrate(motion, omega, n, 60, trace=True)
        motion, every = marched.motion, marched.trace.reshape(60, n, -1)
        away = np.abs(np.diff(every, axis=0)).max(axis=(1, 2))
        sizes.append(away[-20:].max())
    assert 1.0 < grows < 1.1
    np.testing.assert_allclose((sizes[1] / sizes[0]) ** (1 / 60), grows, atol=5e-3)


def solution_of_the_annulus(frequency):
    structure = annulus.Structure()
    one_sector = annulus.make_study(structure, 3, amplitude=300.0)
    omega = 2 * np.pi * frequency
    options = ContinuationOptions(tolerance=1e-10)
    y, _ = find_start(one_sector.problem, annulus.PRELOAD, omega, options, CostMeter())
    one = one_sector.problem.system(annulus.PRELOAD)
    whole, wave, n = annulus.annulus_system(structure, one_sector, 3)
    values = np.linalg.eigvals(monodromy(whole, annulus.spread(one, y[:-1], wave, n), omega))
    return one_sector, one, y[:-1], omega, values[np.argsort(-np.abs(values))]


@pytest.mark.slow
def test_exponents_of_the_wave_are_multipliers_of_the_annulus():
    """Eight sectors as one structure with its own modes, all sliders and events; slip and separation.

    Sum over harmonics of the disturbance converges to the exact multipliers of the annulus.
    """
    one_sector, one, u, omega, values = solution_of_the_annulus(800.0)
    shares = one.contact(u)[2][one.structure.points.mu > 0]
    assert shares[:, [1, 3]].mean() > 0.2
    assert shares[:, 4].max() > 0.0
    period = 2 * np.pi / omega
    distance, problem = {}, one_sector.problem
    N, order = problem.model.n_blades, int(problem.engine_order)
    waves = replace(problem.coupling, engine_order=1)
    for highest in (4, 10):
        bases = [problem.damped(waves.basis(l * order % N), l * order or None) for l in range(highest + 1)]
        d = WaveDisturbances(one, u, omega, bases)
        found = []
        for value in values[:8:2]:
            nearest = np.inf
            for turn in range(-3, 4):
                root = nearest_root(d, np.log(value + 0j) / period + 1j * turn * omega)
                nearest = min(nearest, abs(np.exp(root * period) - value))
            found.append(nearest)
        distance[highest] = np.array(found)
    assert distance[10].max() < 3e-2
    assert distance[10].mean() < 0.2 * distance[4].mean()


@pytest.mark.slow
@pytest.mark.parametrize(("frequency", "stable"), [(800.0, True), (1000.0, False)])
def test_the_verdict_is_that_of_the_annulus(frequency, stable):
    _, one, u, omega, values = solution_of_the_annulus(frequency)
    assert (np.abs(values) <= 1.0 + NEUTRAL).all() == stable
    count = WaveDisturbances(one, u, omega).growing(NEUTRAL * omega / (2 * np.pi), 5 * omega)
    assert (count == 0) == stable
