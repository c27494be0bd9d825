"""Excitation of first slip against closed forms and against harmonic balance."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.util.errors import SettingError

MU, PRELOAD, KT, KN = 0.3, 20.0, 3.0e4, 2.0e4
SPRINGS, DAMPING = np.array([1.0e4, 5.0e3]), np.array([4.0, 6.0])
NORMAL = PRELOAD * KN / (SPRINGS[1] + KN)
"""Normal force: the spring of the mass carries a part of the preload."""
BAND = (20.0, 50.0)


def rubbing(forces, **settings):
    """A mass of 1 kg that moves along a face and across it."""
    return bd.lumped(
        [1.0, 1.0], DAMPING, SPRINGS, contacts=[bd.Contact(0, 1, kt=KT, kn=KN, mu=MU)],
        forces=forces, load_per_preload={1: 1.0}, response=0, harmonics=1, **settings,
    )  # fmt: skip


def test_a_constant_normal_force():
    """The stuck resonance reaches F/(c w_d), and slip begins if its spring force is mu N."""
    found = rubbing({0: 2.0}).first_slip(PRELOAD, BAND)
    damped = np.sqrt(SPRINGS[0] + KT - (0.5 * DAMPING[0]) ** 2)
    largest = 2.0 / (DAMPING[0] * damped)
    assert found.amplitude == pytest.approx(largest, rel=1e-9)
    assert found.factor == pytest.approx(MU * NORMAL / (KT * largest), rel=1e-8)
    assert found.force == pytest.approx(2.0 * found.factor) and not found.opens
    assert found.limiting == {"contact 1": pytest.approx(1.0)}
    assert found.amplitude_at_first_slip == pytest.approx(MU * NORMAL / KT, rel=1e-8)


@pytest.mark.parametrize("across", [0.5, 2.0j, -1.0 - 1.5j])
def test_a_normal_force_that_varies(across):
    """The mean friction lies between both limits: slip begins at C+ + C- = 2 mu N of the spring forces."""
    forces = np.array([2.0, across])
    found = rubbing({0: forces[0], 1: forces[1]}).first_slip(PRELOAD, BAND)
    omega = 2.0 * np.pi * found.frequency
    stiffness = SPRINGS + [KT, KN]
    motion = forces / (stiffness - omega**2 + 1j * omega * DAMPING)
    # a force on the second degree of freedom closes the contact
    friction, normal = KT * motion[0], KN * motion[1]
    both = abs(friction - MU * normal) + abs(friction + MU * normal)
    slip, opening = 2.0 * MU * NORMAL / both, NORMAL / abs(normal)
    assert found.factor == pytest.approx(min(slip, opening), rel=1e-8)


@pytest.mark.parametrize("across", [0.0, 2.0j])
def test_harmonic_balance_is_linear_below_first_slip(across):
    study = rubbing({0: 2.0, 1: across})
    factor = study.first_slip(PRELOAD, BAND).factor
    for share, sticks in ((0.98, True), (1.05, False)):
        load = {0: 2.0 * share * factor, 1: across * share * factor}
        peak = rubbing(load).peak(PRELOAD, BAND)
        linear = rubbing(load).first_slip(PRELOAD, BAND).amplitude
        assert peak.ok
        if sticks:
            assert peak.amplitude == pytest.approx(linear, rel=1e-8)
        else:
            assert peak.amplitude < 0.999 * linear


def test_the_print_names_margin_and_face():
    text = str(rubbing({0: 0.1}).first_slip(PRELOAD, BAND))
    assert text.startswith("Locked below") and "contact 1" in text and "not sufficient" in text
    assert str(rubbing({0: 50.0}).first_slip(PRELOAD, BAND)).startswith("Slips above")
    unlimited = replace(rubbing({0: 0.1}).first_slip(PRELOAD, BAND), factor=np.inf)
    assert "under any excitation" in str(unlimited)


def test_a_study_without_separation_is_refused():
    with pytest.raises(SettingError, match="first_slip: expected contacts with separation"):
        rubbing({0: 1.0}, separation=False).first_slip(PRELOAD, BAND)


@pytest.mark.slow
def test_coupled_friction_slips_before_friction_along_both_axes():
    """The polygon lies within the circle, and the circle within the square of friction along both axes."""
    factors = [
        bd.Study(
            bd.reference_model("shrouded_blade"),
            bd.Excitation("tip"),
            engine_order=4,
            harmonics=1,
            friction_coefficient=0.3,
            friction_law=law,
            constant_loads={"shroud": 500.0},
        )
        .first_slip()
        .factor
        for law in ("uncoupled", "coupled")
    ]
    along_axes, coupled = factors
    assert np.cos(np.pi / 16) / np.sqrt(2.0) * along_axes <= coupled <= along_axes * (1.0 + 1e-9)
