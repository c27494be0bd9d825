"""Hard cases 5, 11 and 20 of one contact point, and memory of large systems; tests/core and tests/anchors have others."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import bdamper as bd
from tests import oracle
from tests.contact.test_laws import COUPLED, EXACT, SAMPLED, SEPARABLE, evaluate, random_state
from tests.following import slider_interval
from tests.oscillators import oscillator


def single(A, B, phi, n0, mu=0.5, kt=1.0, kn=1.0, **kw):
    """u = A sin(theta), v = B sin(theta + phi)."""
    x = np.zeros((3, 3))
    x[0, 2] = A
    x[2, 1:] = B * np.sin(phi), B * np.cos(phi)
    return evaluate(
        x,
        [kt, kt],
        kn,
        mu,
        n0,
        [0.0, 0.0],
        kw.get("law", SEPARABLE),
        kw.get("contact_forces", EXACT),
    )


@pytest.mark.parametrize("phi", [0.3, 1.1, 2.5])
def test_case_5_exactly_at_the_onset_of_slip(phi):
    """C+ + C- = nu, give or take rounding: the force is that of sticking, and Newton ends at such a state."""
    A, r = 1.0, 0.5 * 0.6
    plus, minus = abs(A - r * np.exp(1j * phi)), abs(A + r * np.exp(1j * phi))
    for off in (-1e-12, 0.0, 1e-12):
        nu = plus + minus + off
        n0 = nu / (2 * 0.5)
        force, tangent, shares, _ = single(A, 0.6, phi, n0)
        # the slider starts at zero and may be carried to the middle of an empty interval: a constant
        np.testing.assert_allclose(force[0, 1:], [0.0, A], rtol=0, atol=1e-6)
        assert np.isfinite(tangent).all()
        assert shares[1] < 1e-4


def test_case_5_newton_converges_at_the_onset():
    """A mass whose amplitude is exactly that at which its contact begins to slip."""
    kt, n0, mu = 1.0, 2.0, 0.5
    limit = mu * n0 / kt
    for off in (-1e-12, 0.0, 1e-12):
        omega, stiffness, damping = 0.5, 1.0, 0.1
        force = abs(stiffness + kt - omega**2 + 1j * damping * omega) * (limit + off)
        system = oscillator(
            1.0,
            damping,
            [[stiffness]],
            [[1.0], [0.0], [0.0]],
            [force],
            [1.0],
            3,
            kt=kt,
            kn=0.0,
            mu=mu,
            n0=n0,
        )
        scale = np.ones(system.n_unknowns + 1)
        result = system.correct_at(np.zeros(system.n_unknowns), omega, scale, 1e-10, 20)
        assert result.status == 0
        assert abs(system.response(result.y[:-1])[1]) == pytest.approx(limit, abs=1e-9)


def test_case_6_one_bound_does_not_move():
    """A = r', phi = 0: lo is constant."""
    for evaluation in (EXACT, SAMPLED):
        for sign in (1.0, -1.0):
            force, tangent, shares, _ = single(0.5, sign * 1.0, 0.0, 0.9, contact_forces=evaluation)
            assert np.isfinite(force).all()
            assert np.isfinite(tangent).all()
            assert shares[0] + shares[1] + shares[4] == pytest.approx(1.0)
    exact = single(0.5, 1.0, 0.0, 0.9)[0]
    near = single(0.5 + 1e-9, 1.0, 0.0, 0.9)[0]
    np.testing.assert_allclose(exact, near, rtol=0, atol=1e-6)


@pytest.mark.parametrize("harmonics", [1, 3])
def test_case_7_a_very_short_contact(harmonics):
    """In contact for a thousandth of the period: caught exactly, bounded by the depth if sampled."""
    x = np.zeros((3, 2 * harmonics + 1))
    x[0, 2] = 1.0
    x[2, 1] = 1.0
    depth = 1 - np.cos(np.pi / 1000)
    point = ([2.0, 2.0], 3.0, 0.5, 3.0 * (depth - 1.0), [0.0, 0.0])
    force, _, shares, _ = evaluate(x, *point, SEPARABLE, EXACT)
    assert 1 - shares[4] == pytest.approx(1e-3, rel=1e-6)
    expected = oracle.contact(x, np.array(point[0]), *point[1:4], np.array(point[4]))
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-14)
    assert force[2, 0] > 0
    sampled = evaluate(x, *point, SEPARABLE, SAMPLED)[0]
    assert np.abs(sampled - force).max() <= 2 * 3.0 * depth


@pytest.mark.parametrize("contact_forces", [EXACT, SAMPLED])
def test_case_8_grazing(contact_forces):
    for n0 in (1.0, np.nextafter(1.0, 0), np.nextafter(1.0, 2), -1.0):
        force, tangent, _, _ = single(0.3, 1.0, 0.4, n0, contact_forces=contact_forces)
        assert np.isfinite(force).all()
        assert np.isfinite(tangent).all()


@pytest.mark.parametrize("law", [SEPARABLE, COUPLED])
def test_case_9_neither_load_nor_motion(law):
    x = np.zeros((3, 5))
    x[0, 1] = 1.0
    for evaluation in (EXACT, SAMPLED) if law == SEPARABLE else (SAMPLED,):
        force, tangent, shares, _ = evaluate(x, [1.0, 1.0], 1.0, 0.5, 0.0, [0, 0], law, evaluation)
        assert not force.any()
        assert not tangent.any()
        assert shares[4] == 1.0


def test_case_10_stuck_with_a_biased_slider():
    """The static slider is kept; the interval of residual traction is that of the bounds."""
    n0, mu, kt = 4.0, 0.5, 2.0
    system = oscillator(
        1.0,
        0.05,
        [[1.0]],
        [[1.0], [0.0], [0.0]],
        [0.1],
        [1.0],
        1,
        kt=kt,
        kn=0.0,
        mu=mu,
        n0=n0,
        mean=True,
    )
    u = np.zeros(system.n_unknowns)
    u[1] = 0.2
    interval = slider_interval(system, u)
    np.testing.assert_allclose(
        interval[0, 0], [0.2 - mu * n0 / kt, -0.2 + mu * n0 / kt], atol=1e-12
    )
    assert np.isnan(interval[0, 1]).all()  # no stiffness, no friction in the other direction
    x = np.zeros((3, 3))
    x[0, 1] = 0.2
    force = evaluate(x, [kt, kt], 0.0, mu, n0, [0.7, 0.0], SEPARABLE, EXACT)[0]
    np.testing.assert_allclose(force[0], [-1.4, 0.4, 0.0], atol=1e-14)


@pytest.mark.parametrize("limit", [0.9, 0.99, 0.999])
def test_case_11_the_ellipse_settles(limit):
    """Half a turn of the ellipse reverses the settled force, from wherever the slider starts; thousands of periods of
    plain time integration lead to the same."""
    x = np.zeros((3, 3))
    x[0, 1], x[1, 2] = 1.0, 0.5
    results = [
        evaluate(x, [1.0, 1.0], 0.0, 1.0, limit, w, COUPLED, SAMPLED, 64)[0]
        for w in ([0, 0], [0.3, -0.2])
    ]
    np.testing.assert_allclose(results[0], results[1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(results[0][:2, 0], 0.0, atol=1e-10)
    fine = evaluate(x, [1.0, 1.0], 0.0, 1.0, limit, [0, 0], COUPLED, SAMPLED, 1024)[0]
    coarse_steps, fine_steps = (
        oracle.settled_under_constant_load(x, limit, n) for n in (512, 1024)
    )
    expected = 2 * fine_steps - coarse_steps  # the error is of first order in the step
    start = np.zeros((1, 2))
    two = oracle.coupled(
        x[None, :2], np.ones(1), np.ones(1), lambda t: np.full((1, len(t)), limit), start, 1024, 2
    )[0]
    error = np.abs(fine[:2] - expected).max()
    assert error < 1e-5
    assert np.abs(two - expected).max() > 30 * error, "two periods would have done"


@pytest.mark.parametrize("harmonics", [1, 3])
def test_case_12_shifted_motion(harmonics):
    rng = np.random.default_rng(12)
    for _ in range(50):
        x, p = random_state(rng, harmonics)
        force = evaluate(x, **p, law=SEPARABLE, contact_forces=EXACT)[0]
        delta = rng.uniform(0, 2 * np.pi)
        shifted = evaluate(oracle.shift(x, delta), **p, law=SEPARABLE, contact_forces=EXACT)[0]
        np.testing.assert_allclose(
            shifted, oracle.shift(force, delta), rtol=0, atol=3e-13 * (1 + np.abs(force).max())
        )


def test_case_18_rigid_contact_converges():
    """kt to infinity: the force of the Jenkins element becomes that of dry friction, 4 mu N/pi against the velocity."""
    x = np.zeros((3, 3))
    x[0, 1] = 1.0
    error = []
    for kt in (1e3, 1e5, 1e7):
        force, tangent, _, _ = evaluate(x, [kt, kt], 0.0, 0.5, 2.0, [0, 0], SEPARABLE, EXACT)
        error.append(np.abs(force[0] - [0.0, 0.0, -4 / np.pi]).max())
        assert np.isfinite(tangent).all()
    assert error[0] > 0
    # the in-phase part vanishes like the square root of the compliance
    assert np.log10(error[0] / error[2]) / 4 == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("contact_forces", [EXACT, SAMPLED])
def test_case_19_no_friction_and_much_friction(contact_forces):
    rng = np.random.default_rng(19)
    for _ in range(20):
        x, p = random_state(rng, 2)
        force, tangent, _, _ = evaluate(
            x, **{**p, "mu": 0.0}, law=SEPARABLE, contact_forces=contact_forces
        )
        assert not force[:2].any()
        assert not tangent[:2].any()
        force, tangent, _, _ = evaluate(
            x, **{**p, "mu": 2.0}, law=SEPARABLE, contact_forces=contact_forces
        )
        assert np.isfinite(force).all()
        assert np.isfinite(tangent).all()


def test_case_20_very_stiff_normal_contact():
    """kn a million times the modal stiffness: the residual converges and the conditioning is reported."""
    system = oscillator(
        1.0, 0.05, np.diag([1.0, 1.3]), [[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]], [0.5, 0.3], [1.0, 0.0], 3,
        kt=1.0, kn=1e6, mu=0.4, n0=0.35,
    )  # fmt: skip
    scale = np.ones(system.n_unknowns + 1)
    result = system.correct_at(np.zeros(system.n_unknowns), 0.8, scale, 1e-9, 200, True)
    assert result.status == 0
    assert result.residual < 1e-9


@pytest.mark.slow
def test_memory_of_ten_thousand_points_at_five_harmonics():
    """Within 1 GiB, arrays handed over included (the interpreter with NumPy takes some 50 MB of it).

    Not by getrusage, which counts what the process had that started this one.
    """
    if not Path("/proc/self/status").exists():
        pytest.skip("the most memory that a process has had is read from /proc/self/status")
    code = """
import numpy as np
from bdamper import _core
P, M, H = 10000, 16, 5
n = M * (2 * H + 1)
rng = np.random.default_rng(0)
G = np.empty(P * 3 * M * (H + 1), complex); G.real = rng.normal(size=len(G)); G.imag = 0.0
one = np.ones(P)
s = _core.SectorEquations(np.full(H + 1, M, np.intc), np.ones(M * (H + 1)), np.ones(M * (H + 1)), np.ones(M * (H + 1)), G,
                 np.ones((P, 2)), one, 0.5 * one, one, np.zeros((P, 2)), np.zeros(P, np.intc), np.zeros((P, 3)), np.ones(n))
r, J = np.empty(n), np.empty((n, n))
assert s.evaluate(np.append(rng.normal(size=n), 1.0), r, J) == 0
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""
    root = Path(bd.__file__).parents[1]
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root
    )
    assert int(out.stdout) < 1 << 20  # kB
