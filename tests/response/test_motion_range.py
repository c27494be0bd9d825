"""Half of the range of a motion where other harmonics than the first matter (superharmonic resonances)."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.response.motion_range import half_range
from bdamper.response.verification import TimeResponse
from tests.printed import said

DAMPING, STIFFNESS, SLIP = 0.01, 0.25, 0.2
"""Of an oscillator with mass, stiffness and excitation 1 and a Jenkins element."""
INTERVAL = (0.33 / (2.0 * np.pi), 0.40 / (2.0 * np.pi))
"""Around a third of the natural frequency, Hz."""


@pytest.fixture(scope="module")
def oscillator():
    contact = bd.Contact(0, kt=STIFFNESS, mu=1.0, preload=SLIP)
    return bd.lumped(1.0, DAMPING, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=9)


@pytest.fixture(scope="module")
def peak(oscillator):
    return oscillator.peak(0.0, INTERVAL)


def integrated(omega, periods=150, steps=1000):
    """Return amplitude of the first harmonic and half of the range, of an explicit integration of the oscillator."""
    h = 2.0 * np.pi / omega / steps
    forces = np.cos(2.0 * np.pi * np.arange(steps) / steps)
    x, v, friction = 0.0, 0.0, 0.0
    motion = np.empty(steps)
    for _ in range(periods):
        for i, force in enumerate(forces.tolist()):
            v += h * (force - DAMPING * v - x - friction)
            x += h * v
            friction = min(max(friction + STIFFNESS * h * v, -SLIP), SLIP)
            motion[i] = x
    first = 2.0 * abs(np.mean(motion * np.exp(-2j * np.pi * np.arange(steps) / steps)))
    return first, 0.5 * (motion.max() - motion.min())


def test_a_peak_gives_half_of_the_range_of_the_motion_in_time(peak):
    first, half = integrated(2.0 * np.pi * peak.frequency)
    assert half > 1.4 * first
    assert peak.amplitude == pytest.approx(first, rel=2e-2)
    assert peak.half_range == pytest.approx(half, rel=3e-2)


@pytest.mark.parametrize("name", ["peak", "curve", "time"])
def test_results_name_it_beside_the_first_harmonic(oscillator, peak, name):
    curve = oscillator.frequency_response(0.0, INTERVAL)
    result = {"peak": peak, "curve": curve}.get(name) or oscillator.time_response(curve)
    assert result.half_range == pytest.approx(peak.half_range, rel=2e-2)
    text = said(result)
    assert f"Half peak to peak {result.half_range:.2f} m all harmonics" in text
    if name != "time":
        assert "in the first harmonic" in str(result).split("\n")[0]


@pytest.mark.slow
def test_an_optimal_curve_names_it():
    """A soft contact bears the preload; its closing changes little, so the preload is the normal load."""
    contact = bd.Contact(0, {1: 1.0}, kt=STIFFNESS, kn=1.0, mu=1.0)
    study = bd.lumped(
        [1.0, 1.0], [DAMPING, 1.0], [1.0, 100.0], contacts=[contact], forces={0: 1.0}, harmonics=9,
        load_per_preload={1: 1.0},
    )  # fmt: skip
    # the other mass carries 99 % of the preload, so its spring is 100 times stiffer than the contact
    loads = 101.0 * np.array([0.1, 0.15, 0.2])
    curve = study.optimal_curve(loads, frequency=INTERVAL, check=False)
    half = [study.peak(float(load), INTERVAL).half_range for load in curve.preload]
    assert curve.half_range == pytest.approx(half, rel=1e-6)
    best = curve.optimum
    assert best.half_range > 1.1 * best.amplitude
    assert (
        f"half the peak-to-peak motion is by harmonic balance {best.half_range:.2f} m"
        in " ".join(str(curve).split())
    )
    # the stored curves have one harmonic
    assert all(np.isnan(c.half_range) for c in curve.curves)


def test_one_harmonic_has_no_other_range():
    contact = bd.Contact(0, kt=STIFFNESS, mu=1.0, preload=SLIP)
    study = bd.lumped(1.0, 0.1, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=1)
    peak = study.peak(0.0, (0.1, 0.3))
    assert peak.half_range == pytest.approx(peak.amplitude, rel=1e-7)
    assert "range" not in str(peak) and "first harmonic" not in str(peak)


def test_a_time_response_near_the_first_harmonic_does_not_name_it():
    response = TimeResponse(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, half_range=1.05)
    assert "peak to peak" not in said(response)
    assert "Half peak to peak 1.2 m" in said(replace(response, half_range=1.2))


@pytest.mark.parametrize("third", [0.02, 0.3, 2.0, -0.3, -2.0])
@pytest.mark.parametrize("shift", [0.0, 0.01, 1.0])
def test_half_of_the_range_of_two_harmonics(third, shift):
    """x = cos t + a cos 3t = c + a (4 c^3 - 3 c) has its extrema at c = 1 or where 1 - 3 a + 12 a c^2 = 0."""
    c = np.array([1.0, np.sqrt(np.clip((3.0 * third - 1.0) / (12.0 * third), 0.0, 1.0))])
    exact = np.abs(c + third * (4.0 * c**3 - 3.0 * c)).max()
    harmonics = np.array([5.0, 1.0, 0.0, third]) * np.exp(1j * shift * np.arange(4))
    assert half_range(harmonics) == pytest.approx(exact, rel=1e-5)
    assert half_range(np.array([harmonics, 2.0 * harmonics])) == pytest.approx(
        [exact, 2.0 * exact], rel=1e-5
    )
