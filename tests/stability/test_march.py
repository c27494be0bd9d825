"""The march in time of the core beside the plain one, and what is exact about it."""

import signal
from dataclasses import replace

import numpy as np
import pytest

from bdamper.contact.laws import (
    LAW_BONDED,
    LAW_CONSTANT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_CUBIC,
    LAW_NORMAL,
    LAW_SEPARABLE,
    Sampled,
)
from bdamper.contact.points import PointArrays
from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.model.coupling import HarmonicBasis
from bdamper.stability.time_integration import QUICK, Motion, Ring, ring_and_steps
from tests.stability import plain_march

LAWS = LAW_SEPARABLE, LAW_NORMAL, LAW_CONSTANT, LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_BONDED, LAW_CUBIC, LAW_SEPARABLE
ALL_SECTORS = {"n_blades": 6, "engine_order": 1}  # families of 0, 1, 2, and 3 = 6/2


def structure(seed=0, n_points=11, n_modes=(3, 9, 2, 4), laws=LAWS, size=1.0, damping=0.02, light=0):
    """Random modes on every nodal diameter; eleven points under all laws, some of them open at rest."""
    rng = np.random.default_rng(seed)
    bases = []
    for l, m in enumerate(n_modes):
        G = 0.4 * (rng.standard_normal((n_points, 3, m)) + 1j * (l > 0) * rng.standard_normal((n_points, 3, m)))
        omega2 = rng.uniform(0.5, 8.0, m)
        mass = rng.uniform(0.5, 2.0, m)
        mass[1 : 1 + light] = 0.0
        bases.append(HarmonicBasis((), omega2, np.full(m, damping), G, l, mass))
    law = np.resize(laws, n_points).astype(np.intc)
    kt = rng.uniform(0.5, 2.0, (n_points, 2))
    kt[-1, 1] = 0.0
    cubic = law == LAW_CUBIC
    points = PointArrays(
        kt=kt,
        kn=np.where(cubic, 0.0, rng.uniform(0.5, 2.0, n_points)),
        mu=rng.uniform(0.2, 0.6, n_points),
        n0=np.where(cubic, 0.0, rng.uniform(-0.5, 1.5, n_points)),
        slider=0.3 * rng.standard_normal((n_points, 2)) * (law[:, None] != LAW_CUBIC),
        law=law,
        shift=0.2 * rng.standard_normal((n_points, 3)),
        load=rng.uniform(-0.2, 1.0, n_points),
    )
    n = n_modes[0] + 2 * sum(n_modes[1:])
    force = size * rng.standard_normal(n)
    rows = [rng.standard_normal(m) + 1j * (l > 0) * rng.standard_normal(m) for l, m in enumerate(n_modes)]
    return HarmonicSystem(bases, points, force, rows, Sampled(64))


def state(ring, seed=1, size=1.0):
    rng = np.random.default_rng(seed)
    q, v = size * rng.standard_normal((2, 2, ring.n_coordinates))
    q[1, ring.real] = v[1, ring.real] = 0.0
    return Motion(q.ravel(), v.ravel(), np.tile(ring.system.points.slider, (ring.n, 1, 1)))


def close(found, expected, tolerance=1e-10):
    for a, b in zip(found, expected):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=tolerance * np.abs(b).max())


@pytest.mark.parametrize("sectors", [6, 9, 1])
def test_all_laws_beside_the_plain_march(sectors):
    system = structure(n_modes=(3, 9, 2, 4) if sectors > 1 else (3, 3))
    if sectors == 1:
        bases = [system.bases[0]] * 2
        system = HarmonicSystem(bases, system.points, system.force, system.response_rows, Sampled(64))
    ring = Ring(system, sectors, int(sectors > 1),
                held=np.arange(22).reshape(11, 2) % 7 == 0)  # fmt: skip
    assert ring.n == sectors and ring.real.sum() == {6: 7, 9: 3, 1: 3}[sectors]
    start = state(ring)
    expected, trace = plain_march.march(ring, start, 1.3, 300, 450, first=120)
    found = ring.march(start, 1.3, 300, steps=450, first=120, trace=True)
    close(found.motion, expected)
    np.testing.assert_allclose(found.trace, trace, rtol=0.0, atol=1e-10 * np.abs(trace).max())
    assert found.first == 270 and found.harmonics.shape == (1, ring.system.n_harmonics + 1)


@pytest.mark.parametrize(("laws", "light"), [(LAWS[:3], 2), (LAWS[:-2], 1)])
def test_coordinates_without_mass_beside_the_plain_march(laws, light):
    """Those of the plain one are found by chord iterations; points stick, slip, open and close."""
    ring = Ring(structure(laws=laws, light=light), **ALL_SECTORS)
    assert (ring.mass == 0.0).sum() > 3
    start = state(ring)
    expected, trace = plain_march.march(ring, start, 1.3, 120, 60)
    found = ring.march(start, 1.3, 120, steps=60, trace=True)
    close(found.motion, expected)
    np.testing.assert_allclose(found.trace[1:], trace[1:], rtol=0.0, atol=1e-10 * np.abs(trace).max())
    solved, evaluations, failed = ring.effort
    assert (solved, failed) == (61, 0) and evaluations < 6 * solved


@pytest.mark.parametrize("light", [0, 2])
def test_a_march_does_not_depend_on_what_was_marched_before(light):
    """A motion so large that it overflows, another one, and one in parts: the same march is the same to the last bit."""
    system = structure(laws=LAWS[:3] if light else LAWS, light=light)
    ring = Ring(system, **ALL_SECTORS)
    start = state(ring)
    expected = ring.march(start, 1.3, 120, steps=130, trace=True)
    assert np.isfinite(expected.motion.q).all()
    huge = Motion(1e307 * start.q, 1e307 * start.v, start.w)
    assert not np.isfinite(ring.march(huge, 1.3, 120).motion.q).all()
    for again in (ring, Ring(system, **ALL_SECTORS)):
        found = again.march(start, 1.3, 120, steps=130, trace=True)
        close((*found.motion, found.harmonics, found.trace), (*expected.motion, expected.harmonics, expected.trace), 0.0)
        again.march(state(ring, 3, 4.0), 0.7, 60)
    w = start.w.copy()
    ring.core.follow(expected.trace, w)
    ring.march(state(ring, 3, 4.0), 0.7, 60)
    after = start.w.copy()
    ring.core.follow(expected.trace, after)
    np.testing.assert_array_equal(after, w)
    first = ring.march(start, 1.3, 120, steps=50)
    close(ring.march(first.motion, 1.3, 120, steps=80, first=50).motion, expected.motion, 1e-9)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_a_state_is_finite(which):
    ring = Ring(structure(), **ALL_SECTORS)
    given = [np.array(x) for x in state(ring)]
    given[which].flat[3] = np.nan
    with pytest.raises(ValueError, match=f"^{'qvw'[which]}: expected finite numbers, found nan at flat index 3"):
        ring.march(Motion(*given), 1.3, 120)
    if which != 1:
        with pytest.raises(ValueError, match=f"^{'qvw'[which]}: expected finite numbers, found nan at flat index 3"):
            ring.core.follow(given[0][None], given[2])


def test_a_sweep_beside_the_plain_march():
    ring = Ring(structure(), **ALL_SECTORS)
    start = state(ring)
    expected, _ = plain_march.march(ring, start, 1.3, 200, 600, omega_end=1.6)
    close(ring.march(start, 1.3, 200, 3, omega_end=1.6).motion, expected)


def test_a_long_sweep_is_that_of_its_periods():
    """The core looks for an interruption after some thousand steps: none of them is lost, and no period."""
    ring = Ring(structure(laws=[LAW_BONDED]), **ALL_SECTORS)
    whole = ring.march(state(ring), 1.3, 500, 20, omega_end=1.6, trace=True)
    squares = np.linspace(1.3**2, 1.6**2, 21)
    motion = state(ring)
    for k in range(20):
        part = ring.march(motion, np.sqrt(squares[k]), 500, omega_end=np.sqrt(squares[k + 1]), trace=True)
        motion = part.motion
        np.testing.assert_allclose(part.harmonics[0], whole.harmonics[k], atol=1e-10 * np.abs(whole.harmonics).max())
        np.testing.assert_allclose(part.trace, whole.trace[500 * k : 500 * (k + 1)], atol=1e-10 * np.abs(whole.trace).max())
    close(motion, whole.motion)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timer that interrupts")
def test_an_interruption_ends_a_long_march():
    ring = Ring(structure(), **ALL_SECTORS)
    alarm = signal.signal(signal.SIGALRM, lambda *_: (_ for _ in ()).throw(KeyboardInterrupt()))
    signal.setitimer(signal.ITIMER_REAL, 0.1)
    try:
        with pytest.raises(KeyboardInterrupt):
            ring.march(state(ring), 1.3, 1000, 100_000)  # some hundred seconds
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, alarm)


def test_pieces_and_batches_are_the_same_march():
    ring = Ring(structure(), **ALL_SECTORS)
    first, other = state(ring), state(ring, 2)
    whole = ring.march(first, 1.3, 240, 2)
    both = ring.march(Motion(*(np.array(pair) for pair in zip(other, first))), 1.3, 240, 2)
    for a, b in zip(whole.motion, both.motion):
        np.testing.assert_array_equal(a, b[1])
    np.testing.assert_array_equal(whole.harmonics, both.harmonics[1])
    motion, step = first, 0
    for _ in range(12):
        motion, _, _, step = ring.march(motion, 1.3, 240, steps=40, first=step)
    assert step == 0
    close(motion, whole.motion, 1e-12)


@pytest.mark.parametrize(("sectors", "order"), [(3, 1), (3, 2), (4, 1)])
def test_a_solution_is_the_same_wave_in_every_sector(sectors, order):
    """Harmonics 2 or 3 travel backwards in the modes of harmonic 1: the state, and the excitation of all harmonics."""
    own = structure(n_modes=(3, 4, 2, 4))
    mean, first, second, _ = own.bases
    back = replace(first, G=first.G.conj(), drag=0.0)
    half = replace(second, G=second.G.real.copy())
    bases = [mean, first, back, replace(mean)] if sectors == 3 else [mean, first, half, back]
    rows = own.response_rows
    rows = [rows[0], rows[1], rows[1].conj(), rows[0]] if sectors == 3 else [rows[0], rows[1], rows[2].real, rows[1].conj()]
    rng = np.random.default_rng(5)
    n = len(mean.omega2) + 2 * sum(len(b.omega2) for b in bases[1:])
    system = HarmonicSystem(bases, own.points, rng.standard_normal(n), rows, Sampled(64))
    ring, u, omega = Ring(system, sectors, order), rng.standard_normal(n), 1.3
    A, _ = plain_march.matrices(ring)
    X = system.contact(u)[0]
    amplitudes = np.concatenate([X[:, :, :1], X[:, :, 1::2] - 1j * X[:, :, 2::2]], axis=2)
    for t in (0.0, 0.4):
        q, v = ring.state(u, omega, t)
        turn = np.exp(1j * np.arange(4) * (omega * t + 2.0 * np.pi * order / sectors * np.arange(sectors)[:, None]))
        expected = np.einsum("pdl,kl->kpd", amplitudes, turn).real
        np.testing.assert_allclose((A @ q).reshape(expected.shape) + system.points.shift, expected, atol=1e-12)
        speed = np.einsum("pdl,kl->kpd", 1j * omega * np.arange(4) * amplitudes, turn).real
        np.testing.assert_allclose((A @ v).reshape(expected.shape), speed, atol=1e-12)
        np.testing.assert_allclose(ring.response_row() @ q, (system.response(u[None])[0] @ turn[0]).real, atol=1e-12)
    # the excitation is the state of a system that answers with its force
    orders, factors = ring.forcing()
    like = ring.state(system.force, 1.0, 0.7)[0]
    angle = 0.7 * orders
    np.testing.assert_allclose(np.cos(angle) @ factors[:, 0] + np.sin(angle) @ factors[:, 1], like, atol=1e-12)


def test_harmonics_are_those_of_the_samples():
    ring = Ring(structure(), **ALL_SECTORS)
    found = ring.march(state(ring), 1.3, 250, 2, trace=True)
    response = (found.trace @ ring.response_row()).reshape(2, 250)
    angle = 2.0 * np.pi * np.arange(250) / 250
    for l in range(4):
        expected = (1.0 if l == 0 else 2.0) * (response @ np.exp(-1j * l * angle)) / 250
        np.testing.assert_allclose(found.harmonics[:, l], expected, atol=1e-12)


def test_error_of_second_order():
    """Smooth motion (cubic springs): half the step, a quarter of the difference."""
    ring = Ring(structure(laws=[LAW_CUBIC, LAW_BONDED]), **ALL_SECTORS)
    start = state(ring, size=0.3)
    ends = [ring.march(start, 1.3, n, omega_end=1.5).motion.q for n in (400, 800, 1600)]
    assert 3.9 < np.linalg.norm(ends[1] - ends[0]) / np.linalg.norm(ends[2] - ends[1]) < 4.1


def test_energy_is_kept_without_friction_and_damping():
    """Bonded points, no excitation: what a step of central differences keeps exactly stays within rounding."""
    system = structure(laws=[LAW_BONDED], size=0.0, damping=0.0)
    system = HarmonicSystem(system.bases, replace(system.points, shift=np.zeros((11, 3)), slider=np.zeros((11, 2)),
                            n0=np.zeros(11)), system.force, system.response_rows, Sampled(64))  # fmt: skip
    ring = Ring(system, **ALL_SECTORS)
    A, B = plain_march.matrices(ring)
    springs = np.tile(np.column_stack([system.points.kt, system.points.kn]).ravel(), ring.n)
    weight = np.tile(ring.mass / np.where(ring.real, 1.0, 2.0), 2)  # a complex coordinate counts half
    stiffness = weight[:, None] * (np.diag(np.tile(ring.omega2, 2)) + B @ (springs[:, None] * A))
    h = 2.0 * np.pi / 1.3 / 400

    def energy(motion):
        before = motion.v - 0.5 * h * np.linalg.solve(np.diag(weight), stiffness @ motion.q)  # velocity half a step later
        q = motion.q + h * before
        return before @ (weight * before) + motion.q @ stiffness @ q

    start = state(ring)
    assert energy(ring.march(start, 1.3, 400, 20).motion) == pytest.approx(energy(start), rel=1e-11)


@pytest.mark.parametrize("light", [0, 2])
def test_highest_frequency_is_that_of_the_dense_matrix(light):
    """Coordinates without mass give way to the others."""
    system = structure(light=light)
    ring = Ring(system, **ALL_SECTORS)
    A, B = plain_march.matrices(ring)
    dense = np.diag(np.tile(ring.omega2, 2)) + B @ (np.tile(ring.springs.ravel(), ring.n)[:, None] * A)
    dense += np.diag(np.tile(np.where(ring.mass > 0.0, 0.0, ring.stiffness), 2))
    heavy, yielding = np.tile(ring.mass > 0.0, 2), np.concatenate([ring.mass == 0.0, (ring.mass == 0.0) & ~ring.real])
    back = np.linalg.solve(dense[np.ix_(yielding, yielding)], dense[np.ix_(yielding, heavy)])
    dense = dense[np.ix_(heavy, heavy)] - dense[np.ix_(heavy, yielding)] @ back
    assert ring.highest_frequency() ** 2 == pytest.approx(np.abs(np.linalg.eigvals(dense)).max(), rel=1e-10)


def test_cubic_springs_are_as_stiff_as_at_the_largest_motion():
    system = structure(laws=[LAW_CUBIC])
    u = np.random.default_rng(2).standard_normal(len(system.force))
    springs = Ring(system, **ALL_SECTORS, like=u).springs[:, :2]
    size = np.abs(system.contact(u)[0][:, :2]).sum(axis=2)
    np.testing.assert_allclose(springs, 3.0 * system.points.kt * size**2, rtol=1e-14)


def test_coordinates_far_above_the_excitation_count_as_without_mass():
    system = structure()
    own = np.sqrt(np.concatenate([b.omega2 / b.mass for b in system.bases]))
    middle = np.sort(own)[9:11].mean()
    ring, _ = ring_and_steps(system, middle / QUICK, *ALL_SECTORS.values())
    np.testing.assert_array_equal(ring.mass == 0.0, own > middle)


def test_sliders_after_a_given_motion():
    ring = Ring(structure(), **ALL_SECTORS)
    q = np.array([state(ring, seed).q for seed in range(20)])
    A, _ = plain_march.matrices(ring)
    w = expected = state(ring).w
    for now in q:
        x = (A @ now).reshape(ring.n, -1, 3) + ring.system.points.shift
        _, expected = plain_march.force(ring, x, expected)
    w = w.copy()
    ring.core.follow(q, w)
    slides = ring.system.points.law != LAW_CUBIC
    np.testing.assert_allclose(w[:, slides], expected[:, slides], atol=1e-12)
