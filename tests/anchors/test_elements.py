"""Known answers for one contact element.

A5: Fourier coefficients of the hysteresis loop of a Jenkins element under harmonic motion, elementary integrals. Closed
forms of single-harmonic motion with variable normal load: states of Yang, Chu and Menq, "Stick-slip-separation analysis
and non-linear stiffness and damping characterization of friction contacts having variable normal load", J. Sound Vib. 210
(1998).
"""

import numpy as np
import pytest

from tests.cases import MINUS, OPEN, PLAIN, PLUS, STICK, Point, evaluate


@pytest.mark.parametrize(
    ("A", "kt", "S"), [(2.3, 1.7, 0.9), (1.001, 1.0, 1.0), (40.0, 3.0, 0.5), (1.0, 1.0, 0.999)]
)
def test_harmonics_of_a_jenkins_element(A, kt, S):
    """A5: u = A cos(theta) in the first direction, A sin(theta) in the second."""
    n_harm = 31
    T = np.arccos(1 - 2 * S / (kt * A))
    c, s = np.zeros(n_harm + 1), np.zeros(n_harm + 1)
    c[1], s[1] = kt * A / np.pi * (T - np.sin(2 * T) / 2), -kt * A / np.pi * np.sin(T) ** 2
    for n in range(3, n_harm + 1, 2):
        c[n] = (
            kt * A / (n * np.pi) * (np.sin((n - 1) * T) / (n - 1) - np.sin((n + 1) * T) / (n + 1))
        )
        s[n] = (
            kt
            * A
            / (n * np.pi)
            * ((1 - np.cos((n - 1) * T)) / (n - 1) - (1 - np.cos((n + 1) * T)) / (n + 1))
        )
    x = np.zeros((3, 2 * n_harm + 1))
    x[0, 1] = x[1, 2] = A
    result = evaluate(x, Point(np.array([kt, kt]), 0.0, 0.4, S / 0.4, np.zeros(2)))
    tolerance = {"rtol": 0, "atol": 1e-12 * kt * A}
    np.testing.assert_allclose(result.force[0, 1::2], c[1:], **tolerance)
    np.testing.assert_allclose(result.force[0, 2::2], s[1:], **tolerance)
    np.testing.assert_allclose(result.force[:, 0], [0.0, 0.0, S / 0.4], **tolerance)
    # sin(theta) = cos(theta - pi/2): harmonic n turns by n quarter periods
    turned = (c - 1j * s) * np.exp(-0.5j * np.pi * np.arange(n_harm + 1))
    np.testing.assert_allclose(
        result.force[1, 1::2] - 1j * result.force[1, 2::2], turned[1:], **tolerance
    )
    energy = -np.pi * A * result.force[0, 2]
    assert energy == pytest.approx(4 * S * (A - S / kt), rel=1e-9)


def test_sampled_numbers():
    """A6, without interpolated closing."""
    x = np.array(
        [4.29653115, 4.29165565, 2.8307871, 4.17186848, 3.37441948, 0.80543152, 3.55638299]
    )
    y = x * [2, 2, 2, 3, -1, -1, 2]
    n = np.array([-0.2, 0.2, 0.4, 0, -0.03, 1, -1])
    point = Point(np.array([2.0, 2.0]), 2.5, 0.75, 0.0, np.zeros(2))
    expected = np.array(
        [
            (0.033844726028, 0.205041904377, 0.917068629982),
            (0.547492930979, 0.485749637125, 0.236465445992),
            (-0.461991423731, 0.094650085345, 0.467680641947),
            (0.765402735043, 0.410050194543, -0.127513986224),
            (-0.22880570956, -0.641236343267, -0.340088135301),
            (0.24613093599, 0.511180712751, 1.033629500599),
            (0.215420053877, 0.020838641561, -1.031349793406),
        ]
    ).T
    result = evaluate(np.array([x, y, n]), point, PLAIN, 128)
    np.testing.assert_allclose(result.force, expected, rtol=0, atol=6e-13)
    # the exact law is near, but not the same
    exact = evaluate(np.array([x, y, n]), point).force
    assert 1e-6 < np.abs(exact - expected).max() < 2e-2


def angles(parts):
    """Instant at which each state begins, turned into [0, 2 pi)."""
    return {state: start % (2 * np.pi) for start, _, state in parts}


def test_transitions_of_one_harmonic_in_full_contact():
    """u = A sin(theta), v = B sin(theta + phi), n0 >= kn |B|: closed form of every transition."""
    rng = np.random.default_rng(0)
    slipped = stuck = 0
    for _ in range(600):
        A, B, phi = rng.uniform(0.5, 3.0), rng.uniform(-1.0, 1.0), rng.uniform(0, 2 * np.pi)
        kt, kn, mu = rng.uniform(0.5, 3.0), rng.uniform(0.5, 3.0), rng.uniform(0.1, 0.9)
        n0 = kn * abs(B) * rng.uniform(1.0, 3.0)
        r, nu = mu * kn * B / kt, 2 * mu * n0 / kt
        plus, minus = A - r * np.exp(1j * phi), A + r * np.exp(1j * phi)
        cp, pp, cm, pm = abs(plus), np.angle(plus), abs(minus), np.angle(minus)
        x = np.zeros((3, 3))
        x[0, 2] = A
        x[2, 1:] = B * np.sin(phi), B * np.cos(phi)
        result = evaluate(x, Point(np.array([kt, kt]), kn, mu, n0, np.zeros(2)))
        if cp + cm <= nu:
            stuck += 1
            assert result.states[0] == (STICK,)
            continue
        slipped += 1
        found = [(state, start % (2 * np.pi)) for start, _, state in result.parts[0]]
        begin_plus = [t for state, t in found if state == PLUS]
        begin_minus = [t for state, t in found if state == MINUS]
        begin_stick = [t for state, t in found if state == STICK]
        expected_stick = [np.pi / 2 - pp, 3 * np.pi / 2 - pm]
        expected_minus = np.pi - pm - np.arcsin((cp - nu) / cm)
        expected_plus = 2 * np.pi - pp + np.arcsin((nu - cm) / cp)

        def near(values, angle):
            return min(abs((v - angle + np.pi) % (2 * np.pi) - np.pi) for v in values)

        for angle in expected_stick:
            assert near(begin_stick, angle) < 1e-10
        # the onset is ill-conditioned where the slip is about to vanish
        margin = np.sqrt(max(1e-12, cp + cm - nu))
        assert near(begin_minus, expected_minus) < 1e-12 / margin + 1e-12
        assert near(begin_plus, expected_plus) < 1e-12 / margin + 1e-12
        assert OPEN not in [state for state, _ in found]
    assert slipped > 200
    assert stuck > 50


def test_slip_onset_of_one_harmonic_is_exact():
    """C+ + C- = nu ± 1e-12 (hard case 5): slip above, none below, force continuous."""
    A, B, phi, kt, kn, mu = 1.3, 0.4, 0.9, 1.7, 2.1, 0.5
    r = mu * kn * B / kt
    nu = abs(A - r * np.exp(1j * phi)) + abs(A + r * np.exp(1j * phi))
    x = np.zeros((3, 3))
    x[0, 2] = A
    x[2, 1:] = B * np.sin(phi), B * np.cos(phi)
    forces = []
    for delta in (1e-9, -1e-9, 1e-12, -1e-12):
        n0 = (nu + delta) * kt / (2 * mu)
        result = evaluate(x, Point(np.array([kt, kt]), kn, mu, n0, np.zeros(2)))
        if abs(delta) > 1e-10:
            assert (result.shares[1] > 0) == (delta < 0)
        forces.append(result.force[0])
    for force in forces[1:]:
        np.testing.assert_allclose(force[1:], forces[0][1:], rtol=0, atol=1e-8)


def test_a_bound_that_does_not_move():
    """C+ = 0 (hard case 6): A = r', phi = 0; lo is constant and never pushes before hi does."""
    kt, kn, mu, B = 1.0, 2.0, 0.5, 1.0
    x = np.zeros((3, 3))
    x[0, 2], x[2, 2] = mu * kn * B / kt, B
    for n0 in (2.0, 0.9, 0.5, -0.5):
        result = evaluate(x, Point(np.array([kt, kt]), kn, mu, n0, np.zeros(2)))
        assert np.isfinite(result.force).all()
        assert np.isfinite(result.tangent).all()
