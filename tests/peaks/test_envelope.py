"""The preload of least resonance amplitude, and what is told of peaks, with peaks given in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest

from bdamper.peaks import least as search
from bdamper.peaks.envelope import Branch, PeakEnvelope
from bdamper.peaks.least import least_peak
from bdamper.peaks.newton import Peak, PeakOptions, drifted
from bdamper.peaks.scan import Scan
from bdamper.util.cost import CostMeter


def peak(preload, amplitude, frequency=100.0):
    return Peak(
        preload, frequency, amplitude, np.array([amplitude, 2.0 * np.pi * frequency]), np.array([1.0, 0.0]), np.ones(2),
        0.0, -1.0, np.array([1.0, 0.0, 0.0]), 0.0, 1, 1, 0, False, "converged",
    )  # fmt: skip


def known(branches, preload, apart=1.0):
    """All peaks of branches whose ln(amplitude) is a function of ln(preload), with frequencies so many Hz apart."""
    out = PeakEnvelope(None, preload, (50.0, 150.0), PeakOptions(), CostMeter(0.0))
    for number, height in enumerate(branches):
        peaks = {k: peak(p, np.exp(height(np.log(p))), 100.0 + apart * number) for k, p in enumerate(preload)}
        out.branches.append(Branch(number, peaks))
    out.scanned = {0: "complete", len(preload) - 1: "complete"}
    return out


def least(branches, preload, monkeypatch, apart=1.0):
    """The optimum, with peaks between the preloads and sensitivities by the closed form."""

    def of(q):
        return branches[round((q.frequency - 100.0) / apart)]

    def reach(self, near, p):
        return peak(p, np.exp(of(near[0])(np.log(p))), near[0].frequency)

    def sensitivity(q, family, p, options):
        x, h = np.log(p), 1e-6
        return (of(q)(x + h) - of(q)(x - h)) / (2.0 * h) * q.amplitude / p

    monkeypatch.setattr(search._Minimum, "followed", reach)
    monkeypatch.setattr(search, "amplitude_sensitivity", sensitivity)
    return least_peak(known(branches, preload, apart))


def valley(x):
    """Least at x = 0.4."""
    return 0.5 * (x - 0.4) ** 2


def hill(x, share=0.0):
    """Higher than the valley between 0 and 1, lower than a share of it at both."""
    return 0.2 * np.sin(np.pi * x) + share


GRID = np.exp(np.arange(-3.0, 5.0))


def test_least_value_of_one_branch(monkeypatch):
    found = least([valley], GRID, monkeypatch)
    assert found.kind == "smooth"
    assert found.uncertainty < 1e-6
    assert found.preload == pytest.approx(np.exp(0.4), rel=1e-6)


def test_branches_of_two_scans_may_hold_the_same_peaks(monkeypatch):
    """Rounding decides which of them is called the highest; the optimum stays a smooth one."""
    sides = iter([0.0, 1e-12] * 1000)
    found = least([valley, lambda x: valley(x) + next(sides)], GRID, monkeypatch, apart=1e-5)
    assert found.kind == "smooth"
    assert found.uncertainty < 1e-6
    assert found.preload == pytest.approx(np.exp(0.4), rel=1e-6)


def test_no_optimum_where_another_peak_is_higher(monkeypatch):
    """A branch that is low at the preloads on both sides is looked at only where the optimum was found."""
    found = least([valley, lambda x: hill(x, -0.11)], GRID, monkeypatch)
    assert found.status == "not verified: another peak is higher there"
    assert found.uncertainty == pytest.approx(1.0)


def test_branches_near_the_highest_peak_take_part(monkeypatch):
    """3 % lower than the other at the preload on the left, and higher from there on: the optimum is where they cross."""
    branches = [valley, lambda x: hill(x, 0.05)]
    gap = valley(0.0) - branches[1](0.0)
    assert 0.0 < gap < -np.log(0.95)
    assert branches[1](1.0) < valley(1.0)
    found = least(branches, GRID, monkeypatch)
    assert found.kind == "crossing"
    assert found.uncertainty < 1e-6
    x = np.log(found.preload)
    assert abs(branches[1](x) - valley(x)) < 1e-6


def test_a_peak_off_the_curve_that_a_sweep_follows_is_isolated():
    """Two peaks are known, a complete scan passes one of them: the other is not the one that a sweep meets."""
    peaks = known([lambda x: 1.0 + 0.0 * x, lambda x: 0.0 * x], np.array([1.0, 2.0, 3.0]))
    peaks.scanned = {}
    curve, isolated = peaks.branches[1], peaks.branches[0]
    there = curve.peaks[1]
    peaks.systems = {float(p): SimpleNamespace(n_mean=0) for p in peaks.preload}
    peaks.problem = SimpleNamespace(static=lambda preload: SimpleNamespace(converged=True))

    points = np.array([[0.5, 600.0], there.y, [0.5, 660.0]])
    peaks.look = lambda k, preload, whole: Scan((there,), "complete", points)
    assert peaks.highest(1)[0] is isolated
    peaks.scan(1)
    assert isolated.isolated == {1}
    assert curve.isolated == set()
    assert peaks.highest(1)[0] is curve
    assert peaks.highest(0)[0] is isolated  # was not looked at there
    assert any("peak of branch 0" in event and "is not connected" in event for event in peaks.events)
    # from there the neighbours ask for a look of their own
    assert peaks.suspicious() == 0
    # an incomplete scan tells nothing
    peaks.look = lambda k, preload, whole: Scan((there,), "stalled", points)
    peaks.scan(0)
    assert 0 not in isolated.isolated


def test_guesses_of_a_mean_position_that_nothing_holds():
    """Not displaced along the direction of least stiffness, and displaced either way until the first open point touches."""
    weak, strong = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    K = 1e-3 * np.outer(weak, weak) + 7.0 * np.outer(strong, strong)
    J = np.zeros((4, 4))
    J[:2, :2], J[2:, 2:] = K, np.eye(2)
    rates, closing = np.array([1.0, -2.0, 0.5, 1.0]), np.array([-3.0, -1.0, -9.0, 0.5])

    def touch(u, direction):
        return closing, rates * np.sign(direction @ weak)

    system = SimpleNamespace(n_mean=2, evaluate=lambda u, omega: (None, J, None), closing=touch)
    y = np.array([5.0, 1.0, 0.2, 0.3, 7.0])
    scale = np.full(5, 2.0)
    found = drifted(system, y, scale)
    assert len(found) == 3
    for guess in found:
        np.testing.assert_array_equal(guess[2:], y[2:])
        assert (guess - y)[:2] @ strong == pytest.approx(0.0, abs=1e-12)
    along = [float((guess - y)[:2] @ weak) for guess in found]
    assert found[0][:2] @ weak == pytest.approx(0.0, abs=1e-12)
    assert sorted(along[1:]) == pytest.approx([-0.5 * 1.001, 3.0 * 1.001])
    assert drifted(SimpleNamespace(n_mean=0), y, scale) == []
