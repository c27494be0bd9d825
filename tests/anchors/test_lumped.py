"""Published closed forms, by models of a few masses.

* J. H. Griffin, "Friction damping of resonant stresses in gas turbine engine airfoils", J. Eng. Power 102 (1980): one mass
  with an elastic friction element, one harmonic.
* G. Duffing, "Erzwungene Schwingungen bei veraenderlicher Eigenfrequenz" (1918), see A. H. Nayfeh and D. T. Mook,
  "Nonlinear Oscillations" (1979), section 4.1: frequency response of a cubic spring, one harmonic.
  The first example of NLvib (M. Krack and J. Gross, "Harmonic Balance for Nonlinear Vibration Problems", 2019) compares
  its parameters with the same closed form.
* S. W. Shaw and P. J. Holmes, "A periodically forced piecewise linear oscillator", J. Sound Vib. 90 (1983): period of an
  oscillator that meets a spring on one side.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

import bdamper as bd

TWO_PI = 2.0 * np.pi
DUFFING = ["hardening", "softening", "NLvib, example 1"]


def test_griffin():
    """The peak of the elastic friction element over its slip limit, and the limit of the least peak (A2)."""
    for limit, (amplitude, omega) in {0.5: (18.94337543, 1.00334229), 1.5: (2.91810452, 1.23088592)}.items():
        contact = bd.Contact(0, kt=1.0, mu=0.5, preload=2.0 * limit)
        peak = bd.lumped(1.0, 0.02, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=1).peak(0.0, (0.1, 0.3))
        assert peak.amplitude == pytest.approx(amplitude, abs=2e-8)
        assert TWO_PI * peak.frequency == pytest.approx(omega, abs=2e-8)


def test_griffin_optimum():
    """A plate that a load presses: the least peak over the load, slip limit 1.470413 (A2)."""
    contact = bd.Contact(0, 1, kt=1.0, kn=1.0, mu=0.5)
    study = bd.lumped([1.0, 1.0], [0.02, 0.0], [1.0, 0.0], contacts=[contact], forces={0: 1.0}, loads={1: 1.0}, harmonics=1)
    curve = study.optimal_curve((2.0, 4.0), 4, frequency=(0.1, 0.3), check=False)
    assert 0.5 * curve.optimum.preload == pytest.approx(1.470413, rel=1e-5)
    assert curve.optimum.amplitude == pytest.approx(2.91702888, rel=1e-7)


@pytest.mark.parametrize(("k", "c", "F"), [(1.0, 0.1, 0.2), (-0.1, 0.05, 0.06), (0.1, 0.05, 0.18)], ids=DUFFING)
def test_duffing(k, c, F):
    """(1 - w^2 + 3/4 k a^2)^2 + (c w)^2 = (F/a)^2 at every point; two folds, and the peak at the end of its branches."""
    curve = bd.lumped(1.0, c, 1.0, cubic={0: k}, forces={0: F}, harmonics=1).track(0.0, (0.05, 0.35))
    a, w = curve.amplitude, TWO_PI * curve.frequency
    np.testing.assert_allclose(np.hypot(1.0 - w**2 + 0.75 * k * a**2, c * w) * a, F, rtol=1e-7)
    assert curve.complete and len(curve.folds) == 2
    # both branches exist where the frequency equation, quadratic in w^2, has real roots
    top = brentq(lambda a: 1.0 + 0.75 * k * a**2 - 0.25 * c**2 - (F / (a * c)) ** 2, 0.5, 3.0)
    assert curve.peak.amplitude == pytest.approx(top, rel=1e-7)


def test_shaw_and_holmes():
    """Without damping one half of the period has the frequency 1, the other that of mass and both springs, 2."""
    stop = bd.Contact(normal=0, kn=3.0)
    errors = []
    for harmonics in (5, 15):
        study = bd.lumped(1.0, 1e-3, 1.0, contacts=[stop], forces={0: 1e-3}, harmonics=harmonics)
        errors.append(TWO_PI * study.peak(0.0, (0.2, 0.23)).frequency / (4.0 / 3.0) - 1.0)
    assert abs(errors[1]) < 1e-5
    assert abs(errors[1]) < 0.2 * abs(errors[0])
