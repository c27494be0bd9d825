"""Resonance amplitude over the excitation: closed form of the Jenkins element, scaling, picture."""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import bdamper as bd
from bdamper.analyses import excitation_curve as module
from bdamper.util.errors import SettingError
from tests.each import each

C, K, KT, LIMIT = 0.02, 1.0, 1.0, 1.0


def jenkins():
    contact = bd.Contact(0, kt=KT, mu=1.0, preload=LIMIT)
    return bd.lumped(1.0, C, K, contacts=[contact], forces={0: 1.0}, harmonics=1)


@cache
def curve_of_jenkins():
    return jenkins().excitation_curve(0.0, (0.05, 3.0), 5)


def describing_function(a):
    """Real and imaginary stiffness of the first harmonic of a Jenkins element at amplitude a."""
    if a <= LIMIT / KT:
        return KT, 0.0
    angle = np.arccos(1.0 - 2.0 * LIMIT / (KT * a))
    real = KT / np.pi * (angle - 0.5 * np.sin(2.0 * angle))
    return real, 4.0 * LIMIT * (a - LIMIT / KT) / (np.pi * a**2)


def least_force(a):
    """Least excitation over all frequencies with which the amplitude is a, and its omega."""
    real, imaginary = describing_function(a)
    resonance = np.sqrt(K + real)
    found = minimize_scalar(
        lambda w: a * np.hypot(K + real - w**2, C * w + imaginary),
        bounds=(0.5 * resonance, 1.2 * resonance),
        method="bounded",
        options={"xatol": 1e-12},
    )
    return found.fun, found.x


@pytest.mark.slow
def test_curve_of_a_jenkins_element():
    """The peak under a force F has the amplitude whose least force over all frequencies is F."""
    curve = curve_of_jenkins()
    assert curve.ok and not curve.scaled and curve.requested.sum() == 5
    for i, a in enumerate(curve.amplitude):
        force, w = least_force(a)
        assert force == pytest.approx(curve.excitation[i], rel=1e-8)
        assert 2.0 * np.pi * curve.frequency[i] == pytest.approx(w, rel=1e-7)
        _, imaginary = describing_function(a)
        by_contact, loss = np.pi * imaginary * a**2, np.pi * (imaginary + C * w) * a**2
        assert curve.by_contacts[i] == pytest.approx(by_contact, rel=1e-8, abs=1e-12)
        assert curve.dissipated[i] == pytest.approx(loss, rel=1e-6)
        kinetic = 0.5 * (w * a) ** 2
        assert curve.damping_ratio[i] == pytest.approx(loss / (4.0 * np.pi * kinetic), rel=1e-6)
    # the search finds the excitation with the least amplitude per excitation
    amplitudes = np.geomspace(1.01, 40.0, 4000)
    forces = np.array([least_force(a)[0] for a in amplitudes])
    best = forces[np.argmin(amplitudes / forces)]
    assert curve.best == pytest.approx(best, rel=0.02)


def pressed():
    """A slider whose normal load is that of the preload: nothing but the ratio matters."""
    contact = bd.Contact(0, 1, kt=1.0, kn=1.0, mu=0.5)
    return bd.lumped(
        [1.0, 0.1],
        [0.02, 0.02],
        [1.0, 0.1],
        contacts=[contact],
        forces={0: 1.5},
        load_per_preload={1: 1.0},
        harmonics=3,
    )


@pytest.mark.slow
def test_curve_that_follows_from_an_optimal_curve(monkeypatch):
    study, band = pressed(), (0.1, 0.3)
    optimal = study.optimal_curve((1.0, 8.0), 4, frequency=band, check=False)

    def unexpected(*_, **__):
        raise AssertionError("a solution is computed")

    with monkeypatch.context() as without_solutions:
        without_solutions.setattr(module, "at_preload", unexpected)
        without_solutions.setattr(module, "optimal_curve", unexpected)
        # 1.5 N with 8 to 1 N are 0.375 to 3 N with 2 N
        curve = study.excitation_curve(2.0, (0.375, 3.0), 4, scaled_from=optimal)
    assert curve.scaled and len(curve.excitation) == len(optimal.preload)
    assert curve.requested.sum() == 4
    for i in (0, len(curve.excitation) // 2, -1):
        force = bd.Excitation("x0", amplitude=float(curve.excitation[i]))
        other = study.replace(excitation=force)
        peak = other.peak(2.0, band)
        assert curve.amplitude[i] == pytest.approx(peak.amplitude, rel=1e-6)
        assert curve.frequency[i] == pytest.approx(peak.frequency, rel=1e-6)
        losses = other.dissipation(peak)
        assert curve.by_contacts[i] == pytest.approx(losses.lost, rel=1e-5)
    alone = study.excitation_curve(2.0, (0.375, 3.0), 4, frequency=band)
    np.testing.assert_allclose(alone.amplitude, curve.amplitude, rtol=1e-7)


@pytest.mark.slow
def test_a_curve_with_constant_loads_does_not_scale():
    optimal = pressed().optimal_curve((1.0, 4.0), 3, frequency=(0.1, 0.3), check=False)
    with pytest.raises(SettingError, match="scaled_from: expected a study in which only the ratio"):
        jenkins().excitation_curve(0.0, (0.05, 3.0), 3, scaled_from=optimal)


@each("excitation", [(3.0, 1.0), (0.0, 1.0), (1.0,)])
def test_wrong_excitations_are_named(excitation):
    with pytest.raises(SettingError, match="excitation: expected"):
        jenkins().excitation_curve(0.0, excitation)


@pytest.mark.slow
def test_picture_with_measured_points():
    curve = curve_of_jenkins()
    upper, lower = curve.plot(measured=([0.6, 1.8], [1.7, 30.0])).axes
    computed, measured = upper.lines
    np.testing.assert_array_equal(computed.get_ydata(), curve.amplitude)
    np.testing.assert_array_equal(measured.get_xdata(), [0.6, 1.8])
    # label and ticks are in one unit
    lower.figure.canvas.draw()
    ticks = {
        round(x, 6): text.get_text() for x, text in zip(lower.get_xticks(), lower.get_xticklabels())
    }
    assert lower.get_xlabel() == "Excitation amplitude (mN)" and ticks[1.0] == "1000"
    with pytest.raises(SettingError, match="measured: expected two lists of one length"):
        curve.plot(measured=([0.6], [1.7, 30.0]))
