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
from bdamper.stability.time_integration import Motion, Ring
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
        if a.ndim == 3 and a.shape[2] == 2:  # sliders; that of the last direction, without a spring, is of no account
            a, b = (x[:, :-1] for x in (a, b))
        np.testing.assert_allclose(a, b, rtol=0.0, atol=tolerance * np.abs(b).max(initial=0.0))


@pytest.mark.parametrize("sectors", [6, 9, 1])
@pytest.mark.parametrize("laws", [LAWS[:4], LAWS[4:]])
@pytest.mark.parametrize("light", [0, 2])
def test_steps_beside_a_dense_newton(sectors, laws, light):
    """All laws, held sliders, coordinates with and without mass; points stick, slip, open and close."""
    if light and LAW_CUBIC in laws:
        laws = LAWS[3:5]
    system = structure(n_points=5, n_modes=(3, 9, 2, 4) if sectors > 1 else (3, 3), laws=laws, light=light)
    if sectors == 1:
        bases = [system.bases[0]] * 2
        system = HarmonicSystem(bases, system.points, system.force, system.response_rows, Sampled(64))
    ring = Ring(system, sectors, int(sectors > 1), held=np.arange(10).reshape(5, 2) % 7 == 0)
    assert ring.n == sectors and ring.real.sum() == {6: 7, 9: 3, 1: 3}[sectors]
    start = state(ring)
    expected, trace = plain_march.implicit(ring, start, 1.3, 60, 40, ring.radius, first=50)
    found = ring.march(start, 1.3, 60, steps=40, first=50, trace=True, tolerance=1e-12)
    close(found.motion, expected, 1e-8)
    np.testing.assert_allclose(found.trace[1:], trace[1:], rtol=0.0, atol=1e-8 * np.abs(trace).max())
    assert found.first == 30 and found.harmonics.shape == (0, ring.system.n_harmonics + 1)
    solved, evaluations, failed = ring.effort
    assert solved == 40 + (light > 0) and failed == 0 and evaluations < 16 * solved
    # from where it has come to it goes on as it was, accelerations included
    later, _ = plain_march.implicit(ring, expected, 1.3, 60, 5, ring.radius, first=30)
    close(ring.march(found.motion, 1.3, 60, steps=5, first=30, tolerance=1e-12).motion, later, 1e-8)


@pytest.mark.parametrize("light", [0, 2])
def test_it_is_the_explicit_march_in_many_small_steps(light):
    """Twice the steps, a quarter of the difference from central differences in 1,200 steps."""
    ring = Ring(structure(n_points=5, laws=LAWS[:3], light=light), **ALL_SECTORS)
    start = state(ring, size=0.3)
    expected, _ = plain_march.march(ring, start[:3], 1.3, 1200, 200)
    off = [np.linalg.norm(ring.march(start, 1.3, n, steps=n // 6).motion.q - expected.q) for n in (60, 240)]
    assert off[0] < 0.02 * np.linalg.norm(expected.q) and off[1] < 0.2 * off[0]


@pytest.mark.parametrize("light", [0, 2])
def test_patterns_that_are_left_out_change_little(light):
    """Eleven points have 33 rows, of which up to 24 patterns are kept: forces are found with these and act on all."""
    ring = Ring(structure(laws=LAWS[:3], light=light), **ALL_SECTORS)
    start = state(ring)
    expected, _ = plain_march.implicit(ring, start, 1.3, 120, 30, ring.radius)
    close(ring.march(start, 1.3, 120, steps=30, tolerance=1e-10).motion[:2], expected[:2], 2e-3)


@pytest.mark.parametrize("light", [0, 2])
def test_a_march_does_not_depend_on_what_was_marched_before(light):
    """A motion so large that it overflows, and another one: the same march is the same to the last bit."""
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


@pytest.mark.parametrize("which", [0, 1, 2])
def test_a_state_is_finite(which):
    ring = Ring(structure(), **ALL_SECTORS)
    given = [np.array(x) for x in state(ring)]
    given[which].flat[3] = np.nan
    with pytest.raises(ValueError, match=f"^{'qvw'[which]}: expected finite numbers, found nan at flat index 3"):
        ring.march(Motion(*given[:3]), 1.3, 120)
    if which != 1:
        with pytest.raises(ValueError, match=f"^{'qvw'[which]}: expected finite numbers, found nan at flat index 3"):
            ring.core.follow(given[0][None], given[2])


def test_a_sweep_beside_the_plain_march():
    ring = Ring(structure(laws=LAWS[:3]), **ALL_SECTORS)
    start = state(ring, size=0.3)
    expected, _ = plain_march.march(ring, start[:3], 1.3, 2000, 2000, omega_end=1.6)
    close(ring.march(start, 1.3, 500, omega_end=1.6).motion[:2], expected[:2], 3e-3)


def test_a_long_sweep_is_that_of_its_periods():
    """The core looks for an interruption after some thousand steps: none of them is lost, and no period."""
    ring = Ring(structure(laws=[LAW_BONDED]), **ALL_SECTORS)
    whole = ring.march(state(ring), 1.3, 500, 20, omega_end=1.6, trace=True, tolerance=1e-11)
    squares = np.linspace(1.3**2, 1.6**2, 21)
    motion = state(ring)
    for k in range(20):
        ends = np.sqrt(squares[k]), np.sqrt(squares[k + 1])
        part = ring.march(motion, ends[0], 500, omega_end=ends[1], trace=True, tolerance=1e-11)
        motion = part.motion
        np.testing.assert_allclose(part.harmonics[0], whole.harmonics[k], atol=1e-4 * np.abs(whole.harmonics).max())
        np.testing.assert_allclose(part.trace, whole.trace[500 * k : 500 * (k + 1)], atol=1e-4 * np.abs(whole.trace).max())
    close(motion, whole.motion, 1e-3)


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
    both = ring.march(Motion(*(np.array(pair) for pair in zip(other[:3], first[:3]))), 1.3, 240, 2)
    for a, b in zip(whole.motion, both.motion):
        np.testing.assert_array_equal(a, b[1])
    np.testing.assert_array_equal(whole.harmonics, both.harmonics[1])
    ring = Ring(structure(n_points=5), **ALL_SECTORS)
    whole, motion, step = ring.march(state(ring), 1.3, 240, 2, tolerance=1e-12), state(ring), 0
    for _ in range(12):
        motion, _, _, step = ring.march(motion, 1.3, 240, steps=40, first=step, tolerance=1e-12)
    assert step == 0
    close(motion, whole.motion, 1e-8)


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


def bonded_ring(radius, light=0):
    """Nothing is damped or excited, every contact is a spring; the ring, and its energy."""
    system = structure(laws=[LAW_BONDED], size=0.0, damping=0.0, light=light)
    system = HarmonicSystem(system.bases, replace(system.points, shift=np.zeros((11, 3)), slider=np.zeros((11, 2)),
                            n0=np.zeros(11)), system.force, system.response_rows, Sampled(64))  # fmt: skip
    ring = Ring(system, **ALL_SECTORS, radius=radius)
    A, _ = plain_march.matrices(ring)
    springs = np.tile(np.column_stack([system.points.kt, system.points.kn]).ravel(), ring.n)
    weight = np.tile(1.0 / np.where(ring.real, 1.0, 2.0), 2)  # a complex coordinate counts half
    mass, own = weight * np.tile(ring.mass, 2), weight * np.tile(ring.stiffness, 2)
    stretched = np.sqrt(springs / ring.n)[:, None] * A
    return ring, lambda m: m.v @ (mass * m.v) + m.q @ (own * m.q) + np.sum((stretched @ m.q) ** 2)


def test_energy_is_kept_by_a_radius_of_one_and_lost_by_less():
    """What the linear step keeps without damping of its own, and what is lost at that of the usual radius."""
    ring, energy = bonded_ring(1.0)
    before = energy(state(ring))
    assert energy(ring.march(state(ring), 1.3, 256, 20, tolerance=1e-11).motion) == pytest.approx(before, rel=2e-3)
    for radius in (0.8, 0.5):
        ring, energy = bonded_ring(radius)
        assert 0.97 * before < energy(ring.march(state(ring), 1.3, 256, 20).motion) < before


@pytest.mark.parametrize(("friction", "left"), [(0.0, 0.7), (0.02, 0.002)])
def test_what_bounces_gains_no_energy(friction, left):
    """Unilateral contacts, residual coordinates, neither damping nor excitation: the steps take a few percent."""
    system = structure(laws=[LAW_SEPARABLE], size=0.0, damping=0.0, light=2)
    points = replace(system.points, kt=50.0 * (friction > 0.0) * system.points.kt, n0=-15.0 * system.points.kn,
                     shift=np.zeros((11, 3)), kn=50.0 * system.points.kn, slider=np.zeros((11, 2)),
                     mu=np.full(11, friction))  # fmt: skip
    system = HarmonicSystem(system.bases, points, system.force, system.response_rows, Sampled(64))
    ring = Ring(system, **ALL_SECTORS)
    A, _ = plain_march.matrices(ring)
    weight = np.tile(1.0 / np.where(ring.real, 1.0, 2.0), 2)

    def energy(m):
        x = (A @ m.q).reshape(ring.n, -1, 3)
        pushed, pulled = np.maximum(x[:, :, 2] - 0.3, 0.0), x[:, :, :2] - m.w
        kept = m.v @ (weight * np.tile(ring.mass, 2) * m.v) + m.q @ (weight * np.tile(ring.stiffness, 2) * m.q)
        return kept + (np.sum(points.kn * pushed**2) + np.sum(points.kt * pulled**2)) / ring.n

    motion = ring.march(state(ring), 1.3, 256, steps=1).motion
    levels = [energy(motion)]
    for _ in range(10):
        motion = ring.march(motion, 1.3, 256).motion
        levels.append(energy(motion))
    assert max(np.diff(levels)) < 1e-3 * levels[0] and left * levels[0] < levels[-1] < levels[0]


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
