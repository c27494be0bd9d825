"""Known answers for one and two masses with one contact.

A1: one harmonic of the Jenkins element has a closed form (elliptic loop, elementary integrals); converged numbers with 31
harmonics were confirmed by two independent programs.  A7: folds of two coupled oscillators with separation, confirmed by
two independent programs.  A4 (Den Hartog) is in tests/validated.py.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from bdamper.harmonic_balance.equations import OK
from bdamper.response.continuation import follow
from bdamper.response.events import ContinuationOptions
from tests.oscillators import oscillator

FINE = ContinuationOptions(tolerance=1e-12, max_step=0.05, step=0.02, locate_tolerance=1e-10)


def amplitude(system, y):
    return abs(system.response(y[:-1])[1])


def jenkins(force, n_harm):
    return oscillator(
        1.0,
        0.02,
        1.0,
        [[1], [0], [0]],
        [force],
        [1.0],
        n_harm,
        kt=1.0,
        kn=0.0,
        mu=0.5,
        n0=2.0,
        mean=False,
    )


def frequency_response(system, low, high, guess, options=FINE):
    start = np.append(guess, low)
    first = system.correct_at(start[:-1], low, np.ones(len(start)), 1e-12, 80, True)
    assert first.status == OK
    path = follow(system, first.y, (low, high), options=options)
    assert path.status == "complete"
    assert max(p.residual for p in path.points) <= options.tolerance
    return path


class TestJenkinsMass:
    """A1: m = k = kt = 1, c = 0.02, slip limit 1."""

    peaks = {
        0.5: (1.5647077515, 1.29318256),
        1.0: (3.6062644009, 1.10617065),
        2.0: (37.8867508557, 1.00334229),
    }
    converged = {1.0: (3.536132, 1.10864), 2.0: (37.818381, 1.003265)}

    @staticmethod
    def follow(force, n_harm):
        system = jenkins(force, n_harm)
        guess = np.zeros(system.n_unknowns)
        guess[0] = force / (2.0 - 0.64)
        # the interval around the peak; from below, where the response is small and stuck or nearly so
        path = frequency_response(system, 0.8, 1.6, guess)
        top = max(
            (p for p in path.points if p.kind == "maximum"), key=lambda p: amplitude(system, p.y)
        )
        return system, path, top

    @pytest.mark.parametrize("force", peaks)
    def test_peak_of_one_harmonic(self, force):
        system, _, top = self.follow(force, 1)
        expected, frequency = self.peaks[force]
        assert amplitude(system, top.y) == pytest.approx(expected, abs=6e-11)
        assert top.y[-1] == pytest.approx(frequency, abs=6e-9)

    @pytest.mark.parametrize("force", peaks)
    def test_the_whole_curve_of_one_harmonic(self, force):
        """Every point satisfies the closed form."""
        system, path, _ = self.follow(force, 1)
        slipped = 0
        for p in path.points:
            X, w = amplitude(system, p.y), p.y[-1]
            stiffness, loss = 1.0, 0.0
            if X > 1.0:
                slipped += 1
                theta = np.arccos(1 - 2 / X)
                stiffness, loss = (
                    (theta - np.sin(2 * theta) / 2) / np.pi,
                    4 / (np.pi * X) * (1 - 1 / X),
                )
            assert np.hypot(1 + stiffness - w**2, 0.02 * w + loss) * X == pytest.approx(
                force, rel=1e-10
            )
        assert slipped > 10

    @pytest.mark.parametrize("force", converged)
    def test_peak_of_31_harmonics(self, force):
        system, _, top = self.follow(force, 31)
        expected, frequency = self.converged[force]
        # the numbers are of sampled laws, with an error of some 1e-8 of the amplitude; the frequency sits on a flat top
        assert amplitude(system, top.y) == pytest.approx(expected, abs=1e-6)
        assert top.y[-1] == pytest.approx(frequency, abs=1e-5)


class TestTwoFolds:
    """A7: m = 1, c = 0.05, kx = 1, ky = 2, kxy = 0.3, kt = 0.6, kn = 6, mu = 0.4, n0 = 0.35, F = (0.1, 0.12)."""

    folds = {13: (2.441122, 1.962464), 1: (2.435580, 1.934680)}

    @staticmethod
    def system(n_harm):
        return oscillator(
            1.0,
            0.05,
            [[1.0, 0.3], [0.3, 2.0]],
            [[1, 0], [0, 0], [0, 1]],
            [0.1, 0.12],
            [0.0, 1.0],
            n_harm,
            kt=0.6,
            kn=6.0,
            mu=0.4,
            n0=0.35,
        )

    def down(self, n_harm):
        system = self.system(n_harm)
        path = frequency_response(system, 3.4, 3.5, np.zeros(system.n_unknowns))
        down = follow(system, path.points[0].y, (1.6, 3.4), up=False, options=FINE)
        assert down.status == "complete"
        return system, down

    @pytest.mark.parametrize("n_harm", folds)
    def test_folds(self, n_harm):
        _, down = self.down(n_harm)
        found = sorted((p.y[-1] for p in down.points if p.kind == "fold"), reverse=True)
        assert found == pytest.approx(self.folds[n_harm], abs=6e-7)

    def test_peak_of_13_harmonics(self):
        """1.2700 near 1.9660: the value at that frequency; the maximum itself lies a little above it."""
        system, down = self.down(13)
        top = max(down.points, key=lambda p: amplitude(system, p.y))
        assert top.kind == "maximum"
        at = system.correct_at(top.y[:-1], 1.9660, np.ones(len(top.y)), 1e-12, 30)
        assert at.status == OK
        assert amplitude(system, at.y) == pytest.approx(1.2700, abs=6e-5)
        assert amplitude(system, top.y) == pytest.approx(1.2703, abs=6e-5)
        assert top.y[-1] == pytest.approx(1.9660, abs=6e-4)

    def test_peak_of_one_harmonic(self):
        """1.3385, cut off after the fourth place."""
        system, down = self.down(1)
        top = max(down.points, key=lambda p: amplitude(system, p.y))
        assert top.kind == "maximum"
        assert 1.3385 <= amplitude(system, top.y) < 1.3386

    def test_at_a_fold_the_jacobian_is_singular_and_not_elsewhere(self):
        system, down = self.down(1)
        smallest = {}
        for p in down.points:
            _, J, _ = system.evaluate(p.y[:-1], p.y[-1])
            s = np.linalg.svd(J, compute_uv=False)
            smallest.setdefault(p.kind, []).append(s[-1] / s[0])
        assert max(smallest["fold"]) < 1e-6
        assert np.median(smallest["regular"]) > 1e-3

    def test_three_solutions_between_the_folds(self):
        _, down = self.down(13)
        w = np.array([p.y[-1] for p in down.points])
        crossings = [int(np.count_nonzero(np.diff(np.sign(w - at)))) for at in (1.8, 2.1, 2.3, 2.6)]
        assert crossings == [1, 3, 3, 1]


def test_closed_form_of_the_peak_is_reproduced():
    """The numbers of A1 themselves, from the closed form: phase resonance of the linearised loop."""

    def excess(w, X, F):
        theta = np.arccos(1 - 2 / X)
        k, loss = (theta - np.sin(2 * theta) / 2) / np.pi, 4 / (np.pi * X) * (1 - 1 / X)
        return np.hypot(1 + k - w**2, 0.02 * w + loss) * X - F

    for F, (X, w) in TestJenkinsMass.peaks.items():
        assert excess(w, X, F) == pytest.approx(0.0, abs=1e-8)
        # at the peak amplitude the frequency is a double root: just above it there is none
        grid = np.linspace(0.5 * w, 1.5 * w, 4001)
        assert min(excess(g, X * (1 + 1e-6), F) for g in grid) > 0
        assert brentq(
            lambda x: min(excess(g, x, F) for g in grid), 0.9 * X, 1.05 * X
        ) == pytest.approx(X, rel=1e-6)
