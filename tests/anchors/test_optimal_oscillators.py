"""Optimal curves of one mass with a friction element of constant normal load: closed forms with one harmonic.

A2: the loop of the Jenkins element is bounded by elementary functions, so with one harmonic frequency and amplitude satisfy
one scalar equation; its peaks over the slip limit were computed with two independent programs.  A3: macroslip damper in
parallel with a spring; ``S_opt``, ``A_min`` and, without viscous damping, ``A(S)`` in closed form.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq, fsolve, minimize_scalar

from bdamper.harmonic_balance.equations import Plane
from bdamper.response.continuation import follow
from bdamper.response.optimal_curve import smooth_minimum
from bdamper.response.peak import Peak, coarse_options, find_peak
from bdamper.response.scalar_search import Sample, find_minimum
from bdamper.response.sensitivity import amplitude_sensitivity, sensitivities
from tests.following import follow_peak
from tests.oscillators import oscillator

# slip limit: (peak, frequency)
A2 = {
    0.25: (34.18529221, 1.00038341),
    0.5: (18.94337543, 1.00334229),
    0.75: (7.10120741, 1.02713978),
    0.9: (4.32226418, 1.07175587),
    1.25: (3.00325630, 1.17940652),
    1.5: (2.91810452, 1.23088592),
    2.0: (3.12941550, 1.29318256),
    4.0: (4.82129281, 1.37310977),
}


def jenkins(limit, *, c=0.02, k=1.0, kd=1.0, force=1.0, m=1.0, n_harm=1):
    """Slip limit ``limit``: friction coefficient times a constant normal load of 1."""
    return oscillator(
        m, c, k, [[1], [0], [0]], [force], [1.0], n_harm, kt=kd, kn=0.0, mu=limit, n0=1.0, mean=False
    )  # fmt: skip


def first_peak(system, limits, value) -> Peak:
    omega = limits[0]
    start = np.append(system.structure.linear.response(omega, np.ones((1, 3))), omega)
    guess = np.zeros(system.n_unknowns + 1)
    guess[0], guess[1], guess[-1] = start[0].real, -start[0].imag, omega
    path = follow(system, guess, limits, options=coarse_options())
    assert path.status == "complete"
    (top,) = (p for p in path.points if p.kind == "maximum")
    found = find_peak(system, top.y, parameter=value)
    assert found.ok
    return found


def optimum(family, start, values):
    """The least value of the one peak that is followed through ascending slip limits."""
    peaks = follow_peak(family, start, values).peaks
    assert len(peaks) == len(values)
    there = {float(np.log(q.parameter)): q for q in peaks}

    def place(x):
        q = there[x]
        return Sample(
            x,
            np.log(q.amplitude),
            amplitude_sensitivity(q, family, q.parameter) * q.parameter / q.amplitude,
        )

    def ask(places):
        for x in places:
            near = min(there.values(), key=lambda q: abs(np.log(q.parameter) - x))
            there[x] = follow_peak(family, near, [np.exp(x)]).peaks[0]
        return [place(x) for x in places]

    def settle(a, b, x):
        return smooth_minimum(family, [there[a.x], there[b.x]], a, b)

    places, best = find_minimum([place(x) for x in there], ask, settle)
    return replace(there[places[best.index].x], status=best.kind)


def independent_peak(limit, force=1.0, c=0.02):
    """The X up to which the closed form has a frequency: the least over omega of its left side equals the right side."""

    def excess(X):
        theta = np.arccos(1 - 2 * limit / X)
        ka = (theta - np.sin(2 * theta) / 2) / np.pi
        kb = 4 * limit / (np.pi * X) * (1 - limit / X)
        w = np.sqrt(1 + ka)
        for _ in range(20):  # d/dw [(1 + ka - w^2)^2 + (c w + kb)^2] = 0
            slope = -4 * w * (1 + ka - w**2) + 2 * c * (c * w + kb)
            w -= slope / (-4 * (1 + ka - w**2) + 8 * w**2 + 2 * c**2)
        return (1 + ka - w**2) ** 2 + (c * w + kb) ** 2 - (force / X) ** 2

    return brentq(excess, 1.2 * limit, 60.0, xtol=1e-13)


@pytest.fixture(scope="module")
def branch():
    values = sorted(A2, reverse=True)
    return follow_peak(jenkins, first_peak(jenkins(4.0), (0.7, 1.8), 4.0), values)


class TestJenkins:
    """A2."""

    @pytest.mark.parametrize("limit", A2)
    def test_peaks_over_the_slip_limit(self, branch, limit):
        peak = next(p for p in branch.peaks if p.parameter == limit)
        amplitude, frequency = A2[limit]
        assert peak.ok
        assert peak.amplitude == pytest.approx(amplitude, abs=1e-8)
        assert 2 * np.pi * peak.frequency == pytest.approx(frequency, abs=1e-8)

    def test_against_a_scalar_solver(self, branch):
        for limit in (0.9, 1.25, 2.0):
            peak = next(p for p in branch.peaks if p.parameter == limit)
            assert peak.amplitude == pytest.approx(independent_peak(limit), rel=1e-9)

    def test_slope_vanishes_at_peaks_and_they_are_maxima(self, branch):
        for peak in branch.peaks:
            assert abs(peak.slope / peak.curvature) < 1e-7
            assert peak.curvature < 0.0
            system = jenkins(peak.parameter)
            for s in (-1e-3, 1e-3):
                c = system.solve(
                    peak.y + s * peak.tangent * peak.scale,
                    Plane(peak.tangent),
                    peak.scale,
                    1e-12,
                    20,
                )
                assert abs(system.response(c.y[:-1])[1]) < peak.amplitude

    def test_optimum(self, branch):
        start = next(p for p in branch.peaks if p.parameter == 1.5)
        found = optimum(jenkins, start, [1.25, 1.5, 2.0])
        assert found.status == "smooth"
        assert found.parameter == pytest.approx(1.470413, abs=1e-6)
        assert found.amplitude == pytest.approx(2.91702888, abs=1e-8)
        assert 2 * np.pi * found.frequency == pytest.approx(1.22572299, abs=1e-8)

    def test_bracket_without_a_minimum_is_named_so(self, branch):
        start = next(p for p in branch.peaks if p.parameter == 4.0)
        found = optimum(jenkins, start, [2.0, 4.0])
        assert found.status == "end"
        assert found.parameter == 2.0

    @pytest.mark.parametrize("name", ["limit", "c", "kd", "force", "m"])
    def test_sensitivities_against_differences(self, branch, name):
        value = {"limit": 1.25, "c": 0.02, "kd": 1.0, "force": 1.0, "m": 1.0}[name]

        def family(x):
            return jenkins(**({"limit": 1.25} | {name: x}))

        start = next(p for p in branch.peaks if p.parameter == 1.25)
        found = sensitivities(start, {name: (family, value)})[name]
        h = 1e-4 * value
        at = Peak(**(start.__dict__ | {"parameter": value}))
        high, low = (follow_peak(family, at, [value + s]).peaks[0] for s in (h, -h))
        assert found.amplitude == pytest.approx(
            (high.amplitude - low.amplitude) / (2 * h), rel=1e-5
        )
        assert found.frequency == pytest.approx(
            (high.frequency - low.frequency) / (2 * h), rel=1e-5
        )
        assert abs(found.amplitude) > 1e-3

    def test_more_harmonics(self, branch):
        """A1, 31 harmonics, F = 1: 3.536132 at 1.10864."""
        system = jenkins(1.0, n_harm=31)
        one = follow_peak(
            jenkins, next(p for p in branch.peaks if p.parameter == 0.9), [1.0]
        ).peaks[0]
        from bdamper.response.peak import find_peak

        guess = np.concatenate([one.y[:2], np.zeros(system.n_unknowns - 2), one.y[-1:]])
        peak = find_peak(system, guess)
        assert peak.ok
        assert peak.amplitude == pytest.approx(3.536132, abs=1e-6)
        assert 2 * np.pi * peak.frequency == pytest.approx(1.10864, abs=1e-5)


class TestMacroslip:
    """A3: m = k = F = 1, kd = 0.2, the damper element in parallel with the spring."""

    kd = 0.2

    def family(self, c, n_harm=1):
        return lambda limit: jenkins(limit, c=c, kd=self.kd, n_harm=n_harm)

    def least(self, c):
        family = self.family(c)
        near = (np.pi / 2) / (1 + np.pi * c * 1.05 / self.kd)
        start = first_peak(family(3.0), (0.8, 1.4), 3.0)
        start = follow_peak(family, start, [2.2, 1.8, 1.2 * near]).peaks[-1]
        found = optimum(family, start, [0.9 * near, 1.15 * near])
        assert found.status == "smooth"
        return found

    def exact(self, c):
        """Slip limit, amplitude and frequency of the least peak of the closed form: three equations in three unknowns."""

        def equations(x):
            S, X, w = x
            r = 2 * S / (self.kd * X)
            theta = np.arccos(1 - r)
            ka = self.kd / np.pi * (theta - np.sin(2 * theta) / 2)
            kb = 4 * S / (np.pi * X) * (1 - S / (self.kd * X))
            ka_S = self.kd / np.pi * 2 * np.sin(theta) ** 2 / np.sin(theta) * 2 / (self.kd * X)
            kb_S = 4 / (np.pi * X) * (1 - 2 * S / (self.kd * X))
            A, B = 1 + ka - w**2, c * w + kb
            return A**2 + B**2 - 1 / X**2, A * ka_S + B * kb_S, -2 * w * A + c * B

        near = [(np.pi / 2) / (1 + np.pi * c / self.kd), np.pi / (self.kd + np.pi * c), 1.0488]
        root = fsolve(equations, near, xtol=1e-14)
        assert np.abs(equations(root)).max() < 1e-12
        return root

    @pytest.mark.parametrize("c", [1e-2, 2e-3])
    def test_optimum(self, c):
        """The least peak of the equations with one harmonic, solved by Newton from the closed form of the loop."""
        found, (S, X, w) = self.least(c), self.exact(c)
        assert found.parameter == pytest.approx(S, rel=1e-6)
        assert found.amplitude == pytest.approx(X, rel=1e-8)
        assert 2 * np.pi * found.frequency == pytest.approx(w, rel=1e-6)

    def test_closed_form_of_the_optimum(self):
        """S_opt = (pi F/2)/(1 + pi c w/kd), A_min = pi F/(kd + pi c w), w^2 = (k + kd/2)/m.

        They leave out that the phase at the peak is not exactly 90 degrees: S_opt holds to first order in c, A_min and w
        to second order.
        """
        w = np.sqrt(1 + self.kd / 2)
        errors = []
        for c in (4e-3, 2e-3, 1e-3):
            found = self.least(c)
            errors.append([
                found.parameter / ((np.pi / 2) / (1 + np.pi * c * w / self.kd)) - 1,
                found.amplitude / (np.pi / (self.kd + np.pi * c * w)) - 1,
            ])  # fmt: skip
            if c == 2e-3:
                assert found.amplitude == pytest.approx(15.206906, rel=1e-6)
                assert found.parameter == pytest.approx(1.520691, rel=c)
                assert 2 * np.pi * found.frequency == pytest.approx(1.048809, rel=c)
        rate = np.log2(np.abs(errors[0]) / np.abs(errors[2])) / 2
        assert rate == pytest.approx([1.0, 2.0], abs=0.1)

    def test_amplitude_over_slip_limit_without_damping(self):
        """A(S) = 4 S^2 / (kd (4 S - pi F)) for S > pi F/4, to 1e-8."""
        family = self.family(1e-14)
        start = first_peak(self.family(0.01)(1.5), (0.8, 1.4), 0.01)
        start = follow_peak(
            lambda c: jenkins(1.5, c=c, kd=self.kd), start, [0.001, 1e-4, 1e-5, 1e-6, 1e-14]
        ).peaks[-1]
        assert start.ok
        start = Peak(**(start.__dict__ | {"parameter": 1.5}))
        for values in ([1.3, 1.1, 1.0, 0.9], [1.7, 2.0, 3.0, 5.0]):
            branch = follow_peak(family, start, values)
            assert branch.status == "complete"
            for peak in branch.peaks:
                S = peak.parameter
                assert peak.amplitude == pytest.approx(
                    4 * S**2 / (self.kd * (4 * S - np.pi)), rel=1e-8
                )

    def test_seven_harmonics(self):
        """S = 1.2: 16.2792; 1.5: 15.2076; 1.8: 15.5854; 2.2: 16.8010."""
        family = self.family(0.002, 7)
        start = first_peak(family(2.2), (0.9, 1.2), 2.2)
        branch = follow_peak(family, start, [2.2, 1.8, 1.5, 1.2])
        assert [p.amplitude for p in branch.peaks] == pytest.approx(
            [16.8010, 15.5854, 15.2076, 16.2792], abs=6e-5
        )


def test_least_peak_agrees_with_a_search_on_values(branch):
    """The root of the adjoint sensitivity is where direct evaluation has its minimum."""
    start = next(p for p in branch.peaks if p.parameter == 1.5)
    found = optimum(jenkins, start, [1.25, 1.5, 2.0])
    direct = minimize_scalar(
        lambda S: follow_peak(jenkins, start, [S]).peaks[0].amplitude, bounds=(1.25, 2.0), method="bounded",
        options={"xatol": 1e-6},
    )  # fmt: skip
    assert found.amplitude <= direct.fun * (1 + 1e-12)
    assert found.parameter == pytest.approx(direct.x, rel=1e-4)
