"""Time integration: the core beside plain NumPy, and what is exact about it."""

import re
import signal
import time
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.laws import (
    AFT,
    LAW_BONDED,
    LAW_CONSTANT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_CUBIC,
    LAW_NORMAL,
    LAW_SEPARABLE,
    PointArrays,
)
from bdamper.harmonic_balance.sector import SectorData
from bdamper.model.kinematics import HarmonicBasis
from bdamper.time_domain.integration import (
    AllSectors,
    IntegrationFailed,
    Motion,
    TimeLimit,
    TimeSpent,
    all_sectors,
)
from bdamper.time_domain.transient import Transient
from tests.each import each
from tests.oscillators import oscillator
from tests.time_domain import plain_transient

LAWS = (
    LAW_SEPARABLE,
    LAW_NORMAL,
    LAW_CONSTANT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_BONDED,
    LAW_CUBIC,
    LAW_SEPARABLE,
)
ALL_SECTORS = {"n_blades": 6, "engine_order": 1}  # families of 0, 1, 2, and 3 = 6/2


def structure(
    seed=0, n_points=11, n_modes=(3, 9, 2, 4), laws=LAWS, size=1.0, damping=0.02, light=0
):
    """Random modes on every nodal diameter; eleven points under all laws, some of them open at rest."""
    rng = np.random.default_rng(seed)
    bases = []
    for l, m in enumerate(n_modes):
        G = 0.4 * (
            rng.standard_normal((n_points, 3, m))
            + 1j * (l > 0) * rng.standard_normal((n_points, 3, m))
        )
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
    rows = [
        rng.standard_normal(m) + 1j * (l > 0) * rng.standard_normal(m)
        for l, m in enumerate(n_modes)
    ]
    return SectorData(bases, points, force, rows, AFT(64)).equations


def state(ring, seed=1, size=1.0):
    rng = np.random.default_rng(seed)
    q, v = size * rng.standard_normal((2, 2, ring.n_coordinates))
    q[1, ring.real] = v[1, ring.real] = 0.0
    return Motion(
        q.ravel(), v.ravel(), np.tile(ring.system.structure.points.slider, (ring.n, 1, 1))
    )


def close(found, expected, tolerance=1e-10):
    # without the contact states, which are whole numbers
    for a, b in zip(found[:4], expected[:4]):
        if (
            a.ndim == 3 and a.shape[2] == 2
        ):  # sliders; that of the last direction, without a spring, is of no account
            a, b = (x[:, :-1] for x in (a, b))
        np.testing.assert_allclose(a, b, rtol=0.0, atol=tolerance * np.abs(b).max(initial=0.0))


@pytest.mark.slow
@each("sectors", [6, 9, 1])
@each("laws", [LAWS[:4], LAWS[4:]])
@each("light", [0, 2])
def test_steps_beside_a_dense_newton(sectors, laws, light):
    """All laws, held sliders, coordinates with and without mass; points stick, slip, open and close."""
    if light and LAW_CUBIC in laws:
        laws = LAWS[3:5]
    system = structure(
        n_points=5, n_modes=(3, 9, 2, 4) if sectors > 1 else (3, 3), laws=laws, light=light
    )
    if sectors == 1:
        bases = [system.structure.bases[0]] * 2
        system = replace(system.structure, bases=bases).equations
    ring = AllSectors(system, sectors, int(sectors > 1))
    assert ring.n == sectors and ring.real.sum() == {6: 7, 9: 3, 1: 3}[sectors]
    start = state(ring)
    expected, trace = plain_transient.implicit(ring, start, 1.3, 60, 40, ring.radius, first=50)
    found = ring.integrate(start, 1.3, 60, steps=40, first=50, trace=True, tolerance=1e-12)
    close(found.motion, expected, 1e-8)
    np.testing.assert_allclose(
        found.trace[1:], trace[1:], rtol=0.0, atol=1e-8 * np.abs(trace).max()
    )
    assert found.first == 30 and found.harmonics.shape == (0, ring.n, ring.system.n_harmonics + 1)
    solved, evaluations = ring.effort
    assert solved == 40 + (light > 0) and evaluations < 16 * solved
    # from where it has come to it goes on as it was, accelerations included
    later, _ = plain_transient.implicit(ring, expected, 1.3, 60, 5, ring.radius, first=30)
    close(
        ring.integrate(found.motion, 1.3, 60, steps=5, first=30, tolerance=1e-12).motion,
        later,
        1e-8,
    )


@pytest.mark.slow
@pytest.mark.parametrize("light", [0, 2])
def test_it_is_the_explicit_integration_in_many_small_steps(light):
    """Twice the steps, a quarter of the difference from central differences in 1,200 steps."""
    ring = AllSectors(structure(n_points=5, laws=LAWS[:3], light=light), **ALL_SECTORS)
    start = state(ring, size=0.3)
    expected, _ = plain_transient.integrate(ring, start[:3], 1.3, 1200, 200)
    off = [
        np.linalg.norm(ring.integrate(start, 1.3, n, steps=n // 6).motion.q - expected.q)
        for n in (60, 240)
    ]
    assert off[0] < 0.02 * np.linalg.norm(expected.q) and off[1] < 0.2 * off[0]


@pytest.mark.slow
@pytest.mark.parametrize("light", [0, 2])
def test_patterns_that_are_left_out_change_little(light):
    """Eleven points have 33 rows, of which up to 24 patterns are kept: forces are found with these and act on all."""
    ring = AllSectors(structure(laws=LAWS[:3], light=light), **ALL_SECTORS)
    start = state(ring)
    expected, _ = plain_transient.implicit(ring, start, 1.3, 120, 30, ring.radius)
    close(ring.integrate(start, 1.3, 120, steps=30, tolerance=1e-10).motion[:2], expected[:2], 2e-3)


def stiff(seed, light, factor):
    """Contacts so stiff beside the step that Newton's method does not find the forces of some steps."""
    system = structure(seed, n_points=5, laws=LAWS[:3], light=light)
    own = system.structure
    points = replace(own.points, kt=factor * own.points.kt, kn=factor * own.points.kn)
    # with more numerical damping all steps are solved
    radius = 0.5 if light else 0.7
    return AllSectors(replace(own, points=points).equations, radius=radius, **ALL_SECTORS)


@pytest.mark.parametrize(
    ("light", "factor", "n", "seed", "parts"),
    [(0, 1000.0, 16, 7, 2), (2, 300.0, 12, 16, 2), (0, 3000.0, 10, 17, 4)],
)
def test_a_step_that_is_not_solved_is_halved(light, factor, n, seed, parts):
    """It comes to what as many shorter steps do, those of a dense Newton method, too."""
    ring = stiff(seed, light, factor)
    motion = ring.integrate(state(ring, seed, 3.0), 1.3, n, steps=1).motion
    for first in range(1, 4 * n):
        before = int(ring.effort[0])
        found = ring.integrate(motion, 1.3, n, steps=1, first=first % n).motion
        tried = int(ring.effort[0]) - before
        if tried > 1:
            break
        motion = found
    assert tried == {2: 3, 4: 6}[parts], "one step in vain, or two of half the length"
    shorter = {"n_steps": parts * n, "steps": parts, "first": parts * (first % n)}
    close(found, ring.integrate(motion, 1.3, **shorter).motion, 0.0)
    expected, _ = plain_transient.implicit(
        ring, motion, 1.3, parts * n, parts, ring.radius, first=shorter["first"]
    )
    fine = ring.integrate(motion, 1.3, n, steps=1, first=first % n, tolerance=1e-10).motion
    close(fine[:2], expected[:2], 1e-7)


def test_an_earlier_integration_with_halved_steps_has_no_influence():
    """Patterns of halved steps are kept, but those of another length are not used."""
    alone = stiff(3, 0, 1000.0)
    start = state(alone, 3, 3.0)
    expected = alone.integrate(start, 0.7, 16, steps=64).motion
    assert alone.effort[0] > 64, "no step was halved"

    used = stiff(3, 0, 1000.0)
    used.integrate(start, 0.7 * 1.0005, 16, steps=64)
    assert used.effort[0] > 64
    for found, wanted in zip(used.integrate(start, 0.7, 16, steps=64).motion, expected):
        np.testing.assert_array_equal(found, wanted)


def test_patterns_that_are_rounding_are_left_out():
    """Fifteen rows of stiff contacts have a pattern of the size of rounding.  It had no direction:
    no whole step was solved, and all were halved.
    """
    for seed in range(12):
        ring = stiff(seed, 0, 1000.0)
        ring.integrate(state(ring, seed, 3.0), 0.7, 16, steps=64)
        assert ring.effort[0] < 100


@pytest.mark.slow
def test_stiff_contacts_that_open_and_close_take_whole_steps():
    """Their forces are those of a dense Newton method.

    Of forty starts eleven need a shorter step; eighteen do if the residual alone limits a
    correction, and some forces are then not found to 1e-4.
    """
    for seed in (0, 1, 2, 4, 5):
        ring = stiff(seed, 0, 1000.0)
        start = state(ring, seed, 3.0)
        found = ring.integrate(start, 1.3, 16, steps=16, tolerance=1e-10).motion
        expected, _ = plain_transient.implicit(ring, start, 1.3, 16, 16, ring.radius)
        close(found[:2], expected[:2], 1e-6)

    with_shorter_steps = 0
    for seed in range(40):
        ring = stiff(seed, 0, 1000.0)
        ring.integrate(state(ring, seed, 3.0), 1.3, 16, steps=64, tolerance=1e-10)
        with_shorter_steps += ring.effort[0] > 64
    assert with_shorter_steps <= 14


def test_an_integration_ends_when_its_time_is_spent():
    ring = stiff(8, 0, 300.0)
    ring.limit = TimeLimit(0.05)
    began = time.thread_time()
    with pytest.raises(TimeSpent, match=re.escape("the 0.05 s of processor time have been used")):
        ring.integrate(state(ring, 8), 1.3, 16384, 1000)
    assert time.thread_time() - began < 0.5
    # nothing is left for another integration
    with pytest.raises(TimeSpent):
        ring.integrate(state(ring, 8), 1.3, 64, 1)


@pytest.mark.slow
def test_an_integration_comes_to_an_end_or_fails_by_name():
    """From fifty starts (seed 49), of which some overflowed."""
    ring, done = stiff(8, 2, 300.0), 0
    for seed in np.random.default_rng(49).integers(0, 2**31, 50):
        try:
            found = ring.integrate(state(ring, seed), 1.3, 64, 2, tolerance=1e-4)
        except IntegrationFailed:
            continue
        assert np.isfinite(found.motion.q).all() and np.isfinite(found.harmonics).all()
        done += 1
    assert done > 40 and ring.effort[0] > 129 * 50, "no step was halved"


@pytest.mark.parametrize("columns", [0, 66])
def test_no_harmonics_or_too_many_are_refused(columns):
    ring = AllSectors(structure(), **ALL_SECTORS)
    start = state(ring)
    q, v, w = (np.array(x[None]) for x in start[:3])
    path = {
        "n_step": 4,
        "per_period": 4,
        "omega": 1.0,
        "omega_end": 1.0,
        "radius": 0.8,
        "tolerance": 1e-4,
    }
    with pytest.raises(ValueError, match=f"^harmonic: expected 1 to 65 columns, found {columns}$"):
        ring.core.integrate(
            q, v, np.zeros_like(q), w, **path, harmonic=np.zeros((1, 1, ring.n, columns), complex)
        )


@pytest.mark.nightly
@pytest.mark.slow
def test_integrations_of_the_shipped_blade_come_to_an_end():
    """Every residual pattern, 20 modes of the blade and four of the damper at 256 steps, whose forces were not found in
    some steps; motions from some tenths of a millimetre to some centimetres, fifty starts (seed 49)."""
    given = {"blade_modes": 20, "damper_modes": 4, "contact_stiffness": bd.ResidualModes("all")}
    ring = all_sectors(
        bd.Study(
            bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, 0.54, **given
        ).problem,
        43.7,
    )
    rng, omega = np.random.default_rng(49), 2.0 * np.pi * 665.3
    heavy, w = (
        np.tile(ring.mass > 0.0, 2),
        np.tile(ring.system.structure.points.slider, (ring.n, 1, 1)),
    )
    heavy[ring.n_coordinates :] &= ~ring.real
    for _ in range(50):
        v, q = (
            1e-5
            * omega
            * 10.0 ** rng.uniform(-1.0, 1.0)
            * heavy
            * rng.standard_normal((2, len(heavy)))
        )
        q /= np.sqrt(np.tile(np.maximum(ring.omega2, omega**2), 2))
        try:
            found = ring.integrate(Motion(q, v, w), omega, 256, 20)
        except IntegrationFailed:
            continue
        assert np.isfinite(found.motion.q).all() and np.isfinite(found.harmonics).all()
    assert ring.effort[0] > 50 * 5121, "no step was halved"


@pytest.mark.parametrize("light", [0, 2])
def test_an_integration_does_not_depend_on_the_one_before(light):
    """A motion so large that it overflows, and another one: the same integration is the same to the last bit."""
    system = structure(laws=LAWS[:3] if light else LAWS, light=light)
    ring = AllSectors(system, **ALL_SECTORS)
    start = state(ring)
    expected = ring.integrate(start, 1.3, 120, steps=130, trace=True)
    assert np.isfinite(expected.motion.q).all()
    huge = Motion(1e307 * start.q, 1e307 * start.v, start.w)
    reason = r"near 0.206901 Hz: .* in a time step of 1/120 of a period, nor in parts of it"
    with pytest.raises(IntegrationFailed, match=reason):
        ring.integrate(huge, 1.3, 120)
    for again in (ring, AllSectors(system, **ALL_SECTORS)):
        found = again.integrate(start, 1.3, 120, steps=130, trace=True)
        close(
            (*found.motion, found.harmonics, found.trace),
            (*expected.motion, expected.harmonics, expected.trace),
            0.0,
        )
        again.integrate(state(ring, 3, 4.0), 0.7, 60)
    w = start.w.copy()
    ring.core.follow(expected.trace, w)
    ring.integrate(state(ring, 3, 4.0), 0.7, 60)
    after = start.w.copy()
    ring.core.follow(expected.trace, after)
    np.testing.assert_array_equal(after, w)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_a_state_is_finite(which):
    ring = AllSectors(structure(), **ALL_SECTORS)
    given = [np.array(x) for x in state(ring)]
    given[which].flat[3] = np.nan
    with pytest.raises(
        ValueError, match=f"^{'qvw'[which]}: expected finite numbers, found nan at flat index 3"
    ):
        ring.integrate(Motion(*given[:3]), 1.3, 120)
    if which != 1:
        with pytest.raises(
            ValueError, match=f"^{'qvw'[which]}: expected finite numbers, found nan at flat index 3"
        ):
            ring.core.follow(given[0][None], given[2])


def test_a_sweep_beside_plain_numpy():
    ring = AllSectors(structure(laws=LAWS[:3]), **ALL_SECTORS)
    start = state(ring, size=0.3)
    expected, _ = plain_transient.integrate(ring, start[:3], 1.3, 2000, 2000, omega_end=1.6)
    close(ring.integrate(start, 1.3, 500, omega_end=1.6).motion[:2], expected[:2], 3e-3)


def test_a_long_sweep_is_that_of_its_periods():
    """The core looks for an interruption after some thousand steps: none of them is lost, and no period."""
    ring = AllSectors(structure(laws=[LAW_BONDED]), **ALL_SECTORS)
    whole = ring.integrate(state(ring), 1.3, 500, 20, omega_end=1.6, trace=True, tolerance=1e-11)
    squares = np.linspace(1.3**2, 1.6**2, 21)
    motion = state(ring)
    for k in range(20):
        ends = np.sqrt(squares[k]), np.sqrt(squares[k + 1])
        part = ring.integrate(motion, ends[0], 500, omega_end=ends[1], trace=True, tolerance=1e-11)
        motion = part.motion
        np.testing.assert_allclose(
            part.harmonics[0], whole.harmonics[k], atol=1e-4 * np.abs(whole.harmonics).max()
        )
        np.testing.assert_allclose(
            part.trace, whole.trace[500 * k : 500 * (k + 1)], atol=1e-4 * np.abs(whole.trace).max()
        )
    close(motion, whole.motion, 1e-3)


@each("laws", [LAWS[:3], LAWS[3:5], LAWS[5:]])
def test_expected_states_save_evaluations_and_change_no_motion(laws):
    """Beside a dense Newton solution: with the right states, with wrong ones, and with some unknown."""
    ring = AllSectors(structure(n_points=5, laws=laws), **ALL_SECTORS)
    start = state(ring)
    expected, _ = plain_transient.implicit(ring, start, 1.3, 60, 40, ring.radius, first=50)
    wrong = np.random.default_rng(3).integers(-1, 36, (60, ring.n, 5), np.int8)

    def integrated(states):
        before = ring.effort
        given = start._replace(states=states)
        motion = ring.integrate(given, 1.3, 60, steps=40, first=50, tolerance=1e-12).motion
        close(motion, expected, 1e-8)
        _, evaluations = ring.effort - before
        return evaluations, motion.states

    without, right = integrated(None)
    with_right, again = integrated(right)
    with_wrong, after_wrong = integrated(wrong)
    partly = right.copy()
    partly[:, ::2] = -1
    integrated(partly)
    # the next period of a free motion is another one, so only the steps taken count
    taken = (51 + np.arange(40)) % 60
    np.testing.assert_array_equal(again[taken], right[taken])
    np.testing.assert_array_equal(after_wrong[taken], right[taken])
    assert (np.delete(right, taken, axis=0) == -1).all()
    assert with_right <= without and with_wrong <= 1.2 * without


def test_stored_states_are_those_of_the_motion():
    """Contact, from the coordinates at the end of each step, and friction that is at its limit."""
    ring = AllSectors(structure(n_points=5, laws=LAWS[:1], light=0), **ALL_SECTORS)
    path = ring.integrate(state(ring), 1.3, 60, 2, trace=True, tolerance=1e-12)
    arrays = ring.wide.structure.arrays
    for step in range(60, 120):
        q = path.trace[step]
        z = q[: ring.n_coordinates] + 1j * q[ring.n_coordinates :]
        x = np.tile(np.asarray(arrays["shift"]), (ring.n, 1, 1))
        for basis, block in zip(ring._bases, ring.blocks):
            x += np.tensordot(block.phases, np.asarray(basis.G) @ z[block.part], axes=0).real
        closed = arrays["n0"] + arrays["kn"] * x[..., 2] > 0.0
        # the state at the end of a step is that of the start of the next; step 120 is step 60
        states = path.motion.states[step % 60]
        if step > 60:
            np.testing.assert_array_equal(states % 2 == 1, closed)


def test_states_out_of_range_are_refused():
    ring = AllSectors(structure(n_points=5), **ALL_SECTORS)
    for number in (-2, 36):
        states = np.full((60, ring.n, 5), number, np.int8)
        with pytest.raises(ValueError, match=f"states: expected -1 to 35, found {number}"):
            ring.integrate(state(ring)._replace(states=states), 1.3, 60)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timer that interrupts")
@pytest.mark.timeout(method="thread")  # the alarm is its own
def test_an_interruption_ends_a_long_integration():
    ring = AllSectors(structure(), **ALL_SECTORS)
    alarm = signal.signal(signal.SIGALRM, lambda *_: (_ for _ in ()).throw(KeyboardInterrupt()))
    signal.setitimer(signal.ITIMER_REAL, 0.1)
    try:
        with pytest.raises(KeyboardInterrupt):
            ring.integrate(state(ring), 1.3, 1000, 100_000)  # some hundred seconds
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, alarm)


def test_pieces_are_the_same_integration():
    ring = AllSectors(structure(n_points=5), **ALL_SECTORS)
    whole, motion, step = ring.integrate(state(ring), 1.3, 240, 2, tolerance=1e-12), state(ring), 0
    for _ in range(12):
        motion, *_, step = ring.integrate(motion, 1.3, 240, steps=40, first=step, tolerance=1e-12)
    assert step == 0
    close(motion, whole.motion, 1e-8)


@pytest.mark.parametrize(("sectors", "order"), [(3, 1), (3, 2), (4, 1)])
def test_a_solution_is_the_same_wave_in_every_sector(sectors, order):
    """Harmonics 2 or 3 travel backwards in the modes of harmonic 1: the state, and the excitation of all harmonics."""
    own = structure(n_modes=(3, 4, 2, 4))
    mean, first, second, _ = own.structure.bases
    back = replace(first, G=first.G.conj(), drag=0.0)
    half = replace(second, G=second.G.real.copy())
    bases = [mean, first, back, replace(mean)] if sectors == 3 else [mean, first, half, back]
    rows = own.response_rows
    rows = (
        [rows[0], rows[1], rows[1].conj(), rows[0]]
        if sectors == 3
        else [rows[0], rows[1], rows[2].real, rows[1].conj()]
    )
    rng = np.random.default_rng(5)
    n = len(mean.omega2) + 2 * sum(len(b.omega2) for b in bases[1:])
    system = SectorData(
        bases, own.structure.points, rng.standard_normal(n), rows, AFT(64)
    ).equations
    ring, u, omega = AllSectors(system, sectors, order), rng.standard_normal(n), 1.3
    A, _ = plain_transient.matrices(ring)
    X = system.contact(u)[0]
    amplitudes = np.concatenate([X[:, :, :1], X[:, :, 1::2] - 1j * X[:, :, 2::2]], axis=2)
    for t in (0.0, 0.4):
        q, v = ring.state(u, omega, t)
        turn = np.exp(
            1j
            * np.arange(4)
            * (omega * t + 2.0 * np.pi * order / sectors * np.arange(sectors)[:, None])
        )
        expected = np.einsum("pdl,kl->kpd", amplitudes, turn).real
        np.testing.assert_allclose(
            (A @ q).reshape(expected.shape) + system.structure.points.shift, expected, atol=1e-12
        )
        speed = np.einsum("pdl,kl->kpd", 1j * omega * np.arange(4) * amplitudes, turn).real
        np.testing.assert_allclose((A @ v).reshape(expected.shape), speed, atol=1e-12)
        np.testing.assert_allclose(
            ring.rows[0] @ q, (system.response(u[None])[0] @ turn[0]).real, atol=1e-12
        )
    # the excitation is the state of a system that answers with its force
    orders, factors = ring.forcing()
    like = ring.state(system.structure.force, 1.0, 0.7)[0]
    angle = 0.7 * orders
    np.testing.assert_allclose(
        np.cos(angle) @ factors[:, 0] + np.sin(angle) @ factors[:, 1], like, atol=1e-12
    )


def test_harmonics_are_those_of_the_samples():
    ring = AllSectors(structure(), **ALL_SECTORS)
    found = ring.integrate(state(ring), 1.3, 250, 2, trace=True)
    n, angle = ring.n_coordinates, 2.0 * np.pi * np.arange(250) / 250
    z = found.trace[:, :n] + 1j * found.trace[:, n:]
    for k in range(ring.n):  # each blade by its own sum over the families
        parts = (
            phases[k] * z[:, s] @ np.asarray(ring.system.response_rows[l])
            for l, s, phases, _ in ring.blocks
        )
        response = sum(parts).real.reshape(2, 250)
        for l in range(4):
            expected = (1.0 if l == 0 else 2.0) * (response @ np.exp(-1j * l * angle)) / 250
            np.testing.assert_allclose(found.harmonics[:, k, l], expected, atol=1e-12)


@pytest.mark.parametrize("light", [0, 2])
def test_energies_of_a_period_are_those_of_forces_along_the_way(light):
    """Work of excitation, damping and contacts by forces of the plain law, at all steps of a period."""
    ring = AllSectors(structure(n_points=5, laws=LAWS[:3], light=light), **ALL_SECTORS)
    A, _ = plain_transient.matrices(ring)
    whole = ring.n * np.tile(1.0 / np.where(ring.real, 1.0, 2.0), 2)
    mass, drag, own = (np.tile(x, 2) for x in (ring.mass, ring.mass * ring.damping, ring.stiffness))
    orders, factors = ring.forcing()
    motion = ring.integrate(state(ring), 1.3, 60, steps=1, tolerance=1e-12).motion
    expected, w = np.zeros(4), motion.w

    def there(m, k, w):
        x = (A @ m.q).reshape(ring.n, -1, 3) + ring.system.structure.points.shift
        F, w = plain_transient.force(ring, x, w)
        angle = 2.0 * np.pi * k / 60 * orders
        return (
            np.cos(angle) @ factors[:, 0] + np.sin(angle) @ factors[:, 1],
            F.ravel(),
            x.ravel(),
            w,
        )

    found = ring.integrate(motion, 1.3, 60, first=1, tolerance=1e-12)
    e, F, x, w = there(motion, 1, w)
    for k in range(1, 61):
        end = ring.integrate(motion, 1.3, 60, steps=1, first=k, tolerance=1e-12).motion
        e_end, F_end, x_end, w = there(end, k + 1, w)
        way = end.q - motion.q
        energies = (0.5 * whole * (mass * m.v**2 + own * m.q**2) for m in (end, motion))
        rise = next(energies) - next(energies)
        expected += [
            0.5 * whole * (e + e_end) @ way, 0.5 * whole * drag * (motion.v + end.v) @ way,
            0.5 * (F + F_end) @ (x_end - x), rise.sum(),
        ]  # fmt: skip
        motion, e, F, x = end, e_end, F_end, x_end
    np.testing.assert_allclose(found.energy[0], expected, atol=1e-7 * np.abs(expected).max())


def test_what_is_missing_in_the_energies_is_the_loss_of_the_step():
    """None with a radius of one (the trapezoidal rule); otherwise it falls with the step by at least its second power."""
    missing = {}
    for radius in (1.0, 0.5):
        ring = AllSectors(
            structure(n_points=5, laws=[LAW_CUBIC, LAW_BONDED]), **ALL_SECTORS, radius=radius
        )
        for n in (200, 400, 800):
            energy = ring.integrate(state(ring, size=0.3), 1.3, n, tolerance=1e-12).energy[0]
            missing[radius, n] = (energy[0] - energy[1:].sum()) / np.abs(energy).max()
    assert max(abs(missing[1.0, n]) for n in (200, 400, 800)) < 1e-9
    assert 1e-3 > missing[0.5, 200] > 3.5 * missing[0.5, 400] > 3.5**2 * missing[0.5, 800] > 0.0


def test_waves_of_a_ring():
    """A wave of the excitation (nodal diameter 5 of a wheel of 30), one of 10 against it, and a standing one of 15."""
    ring = AllSectors(structure(), 30, 5)
    k, t = np.arange(6), np.array([0.3, 0.9])[:, None]
    own = 3.0 * np.exp(1j * (t + 2.0 * np.pi * k / 6.0))
    response = own + 0.5 * np.exp(1j * (t - 4.0 * np.pi * k / 6.0)) + 0.25 * (-1.0) ** k
    waves = ring.waves(response)
    np.testing.assert_allclose(waves[:3], [[5.0, 3.0], [-10.0, 0.5], [15.0, 0.25]], atol=1e-12)
    assert waves[3:, 1].max() < 1e-12
    np.testing.assert_allclose(ring.departure(response), np.sqrt(0.3125 / 9.3125))
    assert ring.departure(own).max() < 1e-7


def test_disturbances_have_every_nodal_diameter():
    system = structure(n_modes=(4, 4, 4, 4), light=1)
    ring = AllSectors(system, **ALL_SECTORS)
    u = np.zeros(system.n_unknowns)
    u[4:12] = np.random.default_rng(2).standard_normal(8)  # harmonic 1 alone
    start = ring.start(u, 1.3, 64)
    found, again, other = (ring.seeded(start, 0.01, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(found.q, again.q)
    assert (
        np.abs(found.q - other.q).max() > 0.0
        and np.array_equal(found.w, start.w)
        and found.a is None
    )
    n, own = ring.n_coordinates, np.linalg.norm(start.q)
    for _, s, _, factor in ring.blocks:
        change = (found.q - start.q)[:n][s] + 1j * (found.q - start.q)[n:][s]
        assert 1e-4 * own < np.linalg.norm(change) < 0.03 * own
        assert factor == 2.0 or not change.imag.any()
    one = AllSectors(
        replace(system.structure, bases=[system.structure.bases[0]] * 4).equations, 1, 0
    )
    assert one.seeded(start, 0.01, 0) is start


def test_tractions_to_start_from():
    """None, and the limit of friction either way: forces of the plain law."""
    ring = AllSectors(structure(laws=[LAW_SEPARABLE], n_points=5), **ALL_SECTORS)
    motion, p = state(ring, size=0.2), ring.system.structure.points
    A, _ = plain_transient.matrices(ring)
    x = (A @ motion.q).reshape(ring.n, -1, 3) + p.shift
    normal = np.maximum(p.n0 + p.kn * x[:, :, 2], 0.0)
    for w, share in zip(ring.tractions(motion).values(), (0.0, -1.0, 1.0)):
        F, moved = plain_transient.force(ring, x, w)
        pulled = p.kt > 0.0
        np.testing.assert_allclose(
            F[:, :, :2], share * pulled * (p.mu * normal)[:, :, None], atol=1e-9
        )
        np.testing.assert_allclose(moved[:, pulled], w[:, pulled], atol=1e-9)


@pytest.mark.slow
def test_a_larger_ring_repeats_the_smaller_one():
    """Twelve blades of sixty at engine order 10: the motion of six blades twice, and diameters that these do not have."""
    study = bd.Study(
        bd.reference_model("turbine_blade"),
        bd.Excitation("tip"),
        10,
        0.3,
        contact_stiffness="unit_traction",
    )
    curve = study.frequency_response(100.0, (655.0, 680.0))
    u, omega = curve.peak.y[:-1], 2.0 * np.pi * curve.peak.frequency
    rings = [all_sectors(study.problem, 100.0, blades) for blades in (None, 12)]
    assert [ring.n for ring in rings] == [6, 12]
    assert rings[0].nodal_diameters == (0, 10, 20, 30) and rings[1].nodal_diameters == (
        0,
        5,
        10,
        15,
        20,
        25,
        30,
    )
    small, large = (ring.integrate(ring.start(u, omega, 256), omega, 256, 3) for ring in rings)
    twice = np.tile(small.harmonics, (1, 2, 1))
    np.testing.assert_allclose(large.harmonics, twice, atol=1e-3 * np.abs(twice).max())
    np.testing.assert_allclose(large.energy, 2.0 * small.energy, atol=2e-3 * small.energy.max())
    away = [ring.departure(x.harmonics[:, :, 1]) for ring, x in zip(rings, (small, large))]
    np.testing.assert_allclose(away[1], away[0], atol=1e-4)
    with pytest.raises(
        bd.SettingError,
        match=r"^blades: expected one of \[6, 12, 30, 60\], rings that repeat .*found 5",
    ):
        all_sectors(study.problem, 100.0, 5)
    with pytest.raises(bd.BdamperError, match="nodal diameter"):
        all_sectors(study.problem, 100.0, 60)


def test_error_of_second_order():
    """Smooth motion (cubic springs): half the step, a quarter of the difference."""
    ring = AllSectors(structure(laws=[LAW_CUBIC, LAW_BONDED]), **ALL_SECTORS)
    start = state(ring, size=0.3)
    ends = [ring.integrate(start, 1.3, n, omega_end=1.5).motion.q for n in (400, 800, 1600)]
    assert 3.9 < np.linalg.norm(ends[1] - ends[0]) / np.linalg.norm(ends[2] - ends[1]) < 4.1


def bonded_ring(radius, light=0):
    """Nothing is damped or excited, every contact is a spring; the ring, and its energy."""
    system = structure(laws=[LAW_BONDED], size=0.0, damping=0.0, light=light)
    points = replace(
        system.structure.points, shift=np.zeros((11, 3)), slider=np.zeros((11, 2)), n0=np.zeros(11)
    )
    system = replace(system.structure, points=points).equations
    ring = AllSectors(system, **ALL_SECTORS, radius=radius)
    A, _ = plain_transient.matrices(ring)
    springs = np.tile(
        np.column_stack([system.structure.points.kt, system.structure.points.kn]).ravel(), ring.n
    )
    weight = np.tile(1.0 / np.where(ring.real, 1.0, 2.0), 2)  # a complex coordinate counts half
    mass, own = weight * np.tile(ring.mass, 2), weight * np.tile(ring.stiffness, 2)
    stretched = np.sqrt(springs / ring.n)[:, None] * A
    return ring, lambda m: m.v @ (mass * m.v) + m.q @ (own * m.q) + np.sum((stretched @ m.q) ** 2)


def test_energy_is_kept_by_a_radius_of_one_and_lost_by_less():
    """What the linear step keeps without damping of its own, and what is lost at that of the usual radius."""
    ring, energy = bonded_ring(1.0)
    before = energy(state(ring))
    assert energy(
        ring.integrate(state(ring), 1.3, 256, 20, tolerance=1e-11).motion
    ) == pytest.approx(before, rel=2e-3)
    for radius in (0.8, 0.5):
        ring, energy = bonded_ring(radius)
        assert 0.97 * before < energy(ring.integrate(state(ring), 1.3, 256, 20).motion) < before


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5])
@pytest.mark.parametrize(("friction", "left"), [(0.0, 0.62), (0.02, 0.002)])
def test_what_bounces_gains_no_energy(friction, left, seed):
    """Unilateral contacts, residual coordinates, neither damping nor excitation: the steps take a few percent.

    What is left after ten periods differs from start to start, since the motion is chaotic.
    """
    system = structure(laws=[LAW_SEPARABLE], size=0.0, damping=0.0, light=2)
    own = system.structure.points
    points = replace(
        own, kt=50.0 * (friction > 0.0) * own.kt, n0=-15.0 * own.kn, shift=np.zeros((11, 3)), kn=50.0 * own.kn,
        slider=np.zeros((11, 2)), mu=np.full(11, friction),
    )  # fmt: skip
    system = replace(system.structure, points=points).equations
    ring = AllSectors(system, **ALL_SECTORS)
    A, _ = plain_transient.matrices(ring)
    weight = np.tile(1.0 / np.where(ring.real, 1.0, 2.0), 2)

    def energy(m):
        x = (A @ m.q).reshape(ring.n, -1, 3)
        pushed, pulled = np.maximum(x[:, :, 2] - 0.3, 0.0), x[:, :, :2] - m.w
        kept = m.v @ (weight * np.tile(ring.mass, 2) * m.v) + m.q @ (
            weight * np.tile(ring.stiffness, 2) * m.q
        )
        return kept + (np.sum(points.kn * pushed**2) + np.sum(points.kt * pulled**2)) / ring.n

    motion = ring.integrate(state(ring, seed), 1.3, 256, steps=1).motion
    levels = [energy(motion)]
    for _ in range(10):
        motion = ring.integrate(motion, 1.3, 256).motion
        levels.append(energy(motion))
    assert max(np.diff(levels)) < 1e-3 * levels[0] and left * levels[0] < levels[-1] < levels[0]


def test_sliders_after_a_given_motion():
    ring = AllSectors(structure(), **ALL_SECTORS)
    q = np.array([state(ring, seed).q for seed in range(20)])
    A, _ = plain_transient.matrices(ring)
    w = expected = state(ring).w
    for now in q:
        x = (A @ now).reshape(ring.n, -1, 3) + ring.system.structure.points.shift
        _, expected = plain_transient.force(ring, x, expected)
    w = w.copy()
    ring.core.follow(q, w)
    slides = ring.system.structure.points.law != LAW_CUBIC
    np.testing.assert_allclose(w[:, slides], expected[:, slides], atol=1e-12)


def test_the_energy_of_a_motion_is_conserved_without_losses():
    """Springs in place of contacts, no damping, no excitation: kinetic, strain and contact energy of all sectors."""
    ring = AllSectors(
        structure(laws=(LAW_BONDED,), size=0.0, damping=0.0), **ALL_SECTORS, radius=1.0
    )
    start = state(ring)
    held = ring.energy(start)
    end = ring.integrate(start, 1.0, 4000)
    assert abs(end.energy[0, 3]) > 0.05 * held, "nothing goes to the contacts"
    assert ring.energy(end.motion) == pytest.approx(held, rel=1e-5)
    own = np.tile(ring.stiffness, 2) @ start.q**2 + np.tile(ring.mass, 2) @ start.v**2
    assert held > 0.5 * own


STARTS = {
    "turbine_blade": (5, 374.0, (600.0, 720.0), 2e-4),
    "bladed_disk": (5, 125.0, (285.0, 380.0), 1e-4),
}
"""Engine order, preload (N), interval (Hz) and a usual amplitude (m)."""


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize("number", [20, pytest.param(500, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", STARTS)
def test_random_starts_end_finite_or_fail_by_name(name, number):
    """Four periods of 128 or 256 steps from any motion of all modes and any sliders; some gained 25 decades with 128."""
    order, preload, band, usual = STARTS[name]
    excitation = (
        bd.Excitation("tip", "tangential", 1.0) if name == "turbine_blade" else bd.Excitation("tip")
    )
    given = {"friction_coefficient": 0.55, "contact_stiffness": "unit_traction"}
    ring = all_sectors(
        bd.Study(bd.reference_model(name, 9), excitation, order, **given).problem, preload
    )
    rng, failed, said = np.random.default_rng(20261123), [], "steps_per_period"
    for _ in range(number):
        omega, n = 2.0 * np.pi * rng.uniform(*band), ring.n_coordinates
        q, v = rng.standard_normal((2, 2 * n))
        q[n:][ring.real] = v[n:][ring.real] = 0.0
        q /= np.sqrt(np.maximum(np.tile(ring.omega2, 2), omega**2))
        size = usual * 10.0 ** rng.uniform(-1.0, 1.5) / np.abs(ring.rows @ q).max()
        w = 10.0 * usual * rng.uniform(-1.0, 1.0, (ring.n, ring.system.n_points, 2))
        steps = int(rng.choice([128, 256]))
        transient = Transient(ring, omega, Motion(size * q, size * v, w), steps)
        most = 4.0 * ring.energy(transient.motion)
        try:
            transient.advance(4)
        except IntegrationFailed as error:
            failed.append(steps)
            said = str(error)
            continue
        work = np.abs(np.array(transient.energy)[:, :2]).sum()
        assert (
            0.25 * ring.n * float(np.tile(ring.stiffness, 2) @ transient.motion.q**2)
            < most + 4.0 * work
        )
    assert failed.count(256) <= 0.02 * number and "steps_per_period" in said


def test_energy_of_one_mass_is_its_closed_form():
    """Of a mass with a stretched spring, tangential and normal: m v^2, k x^2, kt u^2, N^2/kn, halved."""
    k = np.array([[1.0, 0.3], [0.3, 2.0]])
    system = oscillator(
        2.0, 0.05, k, [[1, 0], [0, 0], [0, 1]], [0.1, 0.0], [1, 0], 1, kt=0.6, kn=6.0, mu=0.4, n0=3.0
    )  # fmt: skip
    one = AllSectors(system, 1, 0)
    position, velocity = np.array([0.5, 0.2]), np.array([0.7, -0.4])
    acceleration, slider = np.array([0.3, 0.9]), 0.1
    # modes of unit mass; the imaginary parts of the coordinates of one sector are 0
    _, shapes = np.linalg.eigh(k / 2.0)

    def of_modes(x):
        return np.append(np.sqrt(2.0) * shapes.T @ x, np.zeros(2))

    w = np.array([[[slider, 0.0]]])
    motion = Motion(of_modes(position), of_modes(velocity), w, of_modes(acceleration))
    normal_force = 3.0 + 6.0 * position[1]
    springs = 0.6 * (position[0] - slider) ** 2 + normal_force**2 / 6.0
    stored = 2.0 * velocity @ velocity + position @ k @ position + springs
    assert one.energy(motion) == pytest.approx(0.5 * stored, rel=1e-12)
    # with velocity v and acceleration a at omega: m (v^2 + (a/omega)^2)/2
    moving = velocity @ velocity + acceleration @ acceleration / 1.3**2
    assert one.vibration_energy(motion, 1.3) == pytest.approx(0.5 * 2.0 * moving, rel=1e-12)


def test_energy_of_a_period_of_a_sticking_mass_is_its_closed_form():
    """Steady motion a: work pi f |a| sin(phase), damping pi c omega |a|^2; springs keep nothing."""
    mass, damping, stiffness, kt, force, omega = 2.0, 0.3, 1.0, 0.6, 0.1, 1.1
    system = oscillator(
        mass, damping, stiffness, [1.0, 0.0, 0.0], force, [1.0], 1, kt=kt, kn=6.0, mu=0.4, n0=9.0
    )
    amplitude = force / (stiffness + kt - mass * omega**2 + 1j * damping * omega)
    q = np.sqrt(mass) * np.array([amplitude.real, 0.0])
    v = np.sqrt(mass) * np.array([-omega * amplitude.imag, 0.0])
    start = Motion(q, v, np.zeros((1, 1, 2)))
    path = AllSectors(system, 1, 0).integrate(start, omega, 1024, tolerance=1e-12)
    lost = np.pi * damping * omega * abs(amplitude) ** 2
    work = -np.pi * force * amplitude.imag
    np.testing.assert_allclose(work, lost, rtol=1e-12)
    np.testing.assert_allclose(path.energy, [[work, lost, 0.0, 0.0]], rtol=0.0, atol=1e-4 * work)


def test_open_points_store_no_energy():
    """Far apart, the contacts add nothing to the kinetic and strain energy of the modes."""
    ring = stiff(8, 0, 300.0)
    motion = state(ring, 3)
    own = ring.wide.structure
    n_points = len(np.asarray(own.points.law))
    laws = np.resize([LAW_SEPARABLE, LAW_NORMAL, LAW_COUPLED], n_points)
    apart = replace(own.points, n0=np.full(n_points, -1e9), load=np.zeros(n_points), law=laws)
    open_ring = AllSectors(replace(own, points=apart).equations, radius=0.5, **ALL_SECTORS)
    modes = 0.0
    for l, s, _, factor in ring.blocks:
        for x, weight in ((motion.v, ring.mass), (motion.q, ring.stiffness)):
            z = x[: ring.n_coordinates][s] + 1j * x[ring.n_coordinates :][s]
            modes += 0.5 * ring.n / factor * float(weight[s] @ abs(z) ** 2)
    assert open_ring.energy(motion) == pytest.approx(modes, rel=1e-9)
