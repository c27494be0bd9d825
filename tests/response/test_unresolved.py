"""Resonances without an amplitude: unbounded (Caughey 1960), or sharper than double precision resolves."""

import numpy as np
import pytest

from bdamper.analyses.sweep import sweep
from bdamper.lumped_masses import Contact, lumped
from bdamper.response.peak import LOOSEST
from bdamper.response.resolution import frequency_rounding
from tests.printed import said

SLIP = 1.0
LIMIT = 4.0 * SLIP / np.pi
"""Excitation (N) above which a Jenkins element cannot bound an undamped oscillator."""
INTERVAL = (0.05, 0.5)


def oscillator(force, damping_ratio=0.0, stiffness=1.0, **settings):
    contact = Contact(0, kt=stiffness, mu=1.0, preload=SLIP)
    return lumped(1.0, 2.0 * damping_ratio, 1.0, contacts=[contact], forces={0: force}, **settings)


@pytest.mark.slow
@pytest.mark.parametrize("excess", [1.005, 1.1, 1.26, 5.0])
@pytest.mark.parametrize("interval", [None, INTERVAL])
def test_above_the_limit_of_friction_the_response_is_unbounded(excess, interval):
    study = oscillator(excess * LIMIT, harmonics=7)
    peak = study.peak(0.0, interval)
    assert peak.amplitude == np.inf
    assert np.isnan(peak.lower_bound)
    assert peak.status_text.startswith("incomplete: unbounded at 0.15915 Hz")
    assert "unbounded at 0.15915 Hz" in " ".join(str(peak).split())
    curve = study.frequency_response(0.0, INTERVAL)
    assert not curve.complete
    assert curve.peak.amplitude == np.inf
    assert "unbounded at 0.15915 Hz" in str(curve).split("\n")[0]
    # no absurdly large amplitude is printed
    assert "e+0" not in str(curve)


def test_peak_and_sweep_call_an_unbounded_response_by_one_word():
    study = oscillator(1.1 * LIMIT, harmonics=1)
    reason = "unbounded at 0.15915 Hz: no damping, and the excitation exceeds the friction"
    assert study.peak(0.0, INTERVAL)._headline().startswith(f"Response {reason}")
    found = sweep(study, {"preload": [0.0]}, frequency=INTERVAL)
    assert found._headline() == f"1 point over preload, 1 unbounded: {reason}"
    assert said(found).count(reason) == 1, "the table does not repeat it"


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_below_the_limit_the_friction_bounds_the_response(share):
    """At the peak of one harmonic the work of the excitation is that of the friction, pi F A = 4 S (A - S/k)."""
    peak = oscillator(share * LIMIT, harmonics=1).peak(0.0, INTERVAL)
    assert peak.status == "complete"
    assert peak.amplitude == pytest.approx(SLIP / (1.0 - share), rel=1e-6)


def test_with_damping_the_same_excitation_has_a_bounded_response():
    """At large amplitudes pi F A = 4 S (A - S/k) + 2 pi zeta A^2."""
    force, ratio = 1.26 * LIMIT, 1e-5
    root = np.roots([2.0 * np.pi * ratio, 4.0 * SLIP - np.pi * force, -4.0 * SLIP**2]).max()
    peak = oscillator(force, ratio, harmonics=1).peak(0.0, INTERVAL)
    assert peak.status == "complete"
    assert peak.amplitude == pytest.approx(root, rel=1e-5)


@pytest.mark.parametrize("kind", ["free", "stuck"])
def test_linear_response_without_damping_has_no_amplitude(kind):
    curve = getattr(oscillator(1.0, harmonics=1), kind)(INTERVAL)
    # the stuck contact doubles the stiffness
    resonance = (1.0 if kind == "free" else np.sqrt(2.0)) / (2.0 * np.pi)
    part = curve.without_amplitude
    assert part.low < resonance < part.high
    assert curve.status == "incomplete"
    assert curve.peak.amplitude == np.inf
    first = str(curve).split("\n")[0]
    assert first.startswith(
        f"No amplitude of the {kind} resonance: unbounded at {resonance:.5g} Hz"
    )


@pytest.mark.parametrize("ratio", [3e-8, 4e-9])
def test_a_resonance_sharper_than_the_rounding_of_its_frequency_has_no_digits(ratio):
    """Its amplitude depends on the order of sums in the BLAS."""
    peak = oscillator(1.6, ratio, harmonics=7).peak(0.0, INTERVAL)
    assert peak.status_text.startswith("incomplete: no significant digits remain at 0.15915 Hz")
    assert np.isnan(peak.amplitude)
    assert np.isnan(peak.lower_bound)


@pytest.mark.parametrize("stiffness", [1.0, 1e10])
def test_rounding_of_the_frequency_is_that_of_the_quality_factor_and_not_of_stiff_contacts(
    stiffness,
):
    """Near a stuck resonance of quality Q the inertia force is Q times the excitation, with the square of the frequency."""
    quality = 5e3
    resonance = np.sqrt(1.0 + stiffness)
    contact = Contact(0, kt=stiffness, mu=1.0, preload=1e6)
    study = lumped(1.0, resonance / quality, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=1)
    peak = study.peak(0.0, (0.9 * resonance / (2.0 * np.pi), 1.1 * resonance / (2.0 * np.pi)))
    assert peak.status == "complete"
    found = frequency_rounding(study.problem.system(0.0), peak.y)
    assert found == pytest.approx(2.0 * quality * np.finfo(float).eps, rel=1e-2)
    assert found < LOOSEST
