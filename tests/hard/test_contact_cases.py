"""Hard cases 5, 11 and 20 of one contact point, and memory of large systems; tests/core and tests/anchors have others."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import bdamper as bd
from tests import oracle
from tests.contact.test_laws import COUPLED, SAMPLED, evaluate
from tests.oscillators import oscillator


def test_case_5_newton_converges_at_the_onset():
    """A mass whose amplitude is exactly that at which its contact begins to slip."""
    kt, n0, mu = 1.0, 2.0, 0.5
    limit = mu * n0 / kt
    for off in (-1e-12, 0.0, 1e-12):
        omega, stiffness, damping = 0.5, 1.0, 0.1
        force = abs(stiffness + kt - omega**2 + 1j * damping * omega) * (limit + off)
        system = oscillator(
            1.0, damping, [[stiffness]], [[1.0], [0.0], [0.0]], [force], [1.0], 3, kt=kt, kn=0.0, mu=mu, n0=n0
        )
        scale = np.ones(system.n_unknowns + 1)
        result = system.correct_at(np.zeros(system.n_unknowns), omega, scale, 1e-10, 20)
        assert result.status == 0
        assert abs(system.response(result.y[:-1])[1]) == pytest.approx(limit, abs=1e-9)


@pytest.mark.parametrize("limit", [0.9, 0.99, 0.999])
def test_case_11_the_ellipse_settles(limit):
    """Half a turn of the ellipse reverses the settled force, from wherever the slider starts; thousands of periods of
    plain time integration lead to the same."""
    x = np.zeros((3, 3))
    x[0, 1], x[1, 2] = 1.0, 0.5
    results = [evaluate(x, [1.0, 1.0], 0.0, 1.0, limit, w, COUPLED, SAMPLED, 64)[0] for w in ([0, 0], [0.3, -0.2])]
    np.testing.assert_allclose(results[0], results[1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(results[0][:2, 0], 0.0, atol=1e-10)
    fine = evaluate(x, [1.0, 1.0], 0.0, 1.0, limit, [0, 0], COUPLED, SAMPLED, 1024)[0]
    coarse_steps, fine_steps = (oracle.settled_under_constant_load(x, limit, n) for n in (512, 1024))
    expected = 2 * fine_steps - coarse_steps  # of first order in the step
    start = np.zeros((1, 2))
    two = oracle.coupled(x[None, :2], np.ones(1), np.ones(1), lambda t: np.full((1, len(t)), limit), start, 1024, 2)[0]
    error = np.abs(fine[:2] - expected).max()
    assert error < 1e-5
    assert np.abs(two - expected).max() > 30 * error, "two periods would have done"


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
s = _core.Sector(np.full(H + 1, M, np.intc), np.ones(M * (H + 1)), np.ones(M * (H + 1)), np.ones(M * (H + 1)), G,
                 np.ones((P, 2)), one, 0.5 * one, one, np.zeros((P, 2)), np.zeros(P, np.intc), np.zeros((P, 3)), np.ones(n))
r, J = np.empty(n), np.empty((n, n))
assert s.evaluate(np.append(rng.normal(size=n), 1.0), r, J) == 0
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""
    root = Path(bd.__file__).parents[1]
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    assert int(out.stdout) < 1 << 20  # kB
