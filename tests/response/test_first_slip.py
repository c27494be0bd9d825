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
    assert found.force == pytest.approx(2.0 * found.factor) and found.touching == np.inf
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


GAP = 1e-4


def beside_a_stop(force):
    """The rubbing mass, whose tangential motion closes a gap (m) to a stop."""
    return bd.lumped(
        [1.0, 1.0], DAMPING, SPRINGS, forces={0: force}, load_per_preload={1: 1.0}, response=0,
        contacts=[bd.Contact(0, 1, kt=KT, kn=KN, mu=MU), bd.Contact(normal=0, kn=KN, gap=GAP)],
        harmonics=1,
    )  # fmt: skip


def test_a_point_that_is_open_at_rest_stays_open():
    """Mean friction T moves the mass away from the stop, by T over its spring, and leaves mu N - T."""
    found = beside_a_stop(2.0).first_slip(PRELOAD, BAND)
    damped = np.sqrt(SPRINGS[0] + KT - (0.5 * DAMPING[0]) ** 2)
    assert found.amplitude == pytest.approx(2.0 / (DAMPING[0] * damped), rel=1e-9)
    assert found.touching * found.amplitude == pytest.approx(GAP, rel=1e-8)
    friction = (MU * NORMAL - KT * GAP) / (1.0 + KT / SPRINGS[0])
    both = GAP + friction / SPRINGS[0]
    assert found.amplitude_at_first_slip == pytest.approx(both, rel=1e-8)
    (row,) = (line for line in str(found).splitlines() if line.startswith("Touching"))
    assert f"{2e3 * found.touching:.3g} mN" in row


@pytest.mark.parametrize(("share", "linear"), [(0.98, True), (1.05, False)])
def test_harmonic_balance_is_linear_until_an_open_point_touches(share, linear):
    """It begins at the static state, without mean friction."""
    force = 2.0 * share * beside_a_stop(2.0).first_slip(PRELOAD, BAND).touching
    study = beside_a_stop(force)
    expected = study.first_slip(PRELOAD, BAND).amplitude
    peak = study.peak(PRELOAD, BAND)
    assert peak.ok and (abs(peak.amplitude / expected - 1.0) < 1e-8) == linear


def test_a_face_that_is_twisted_open_keeps_its_closed_points():
    """A moment opens one of two points; harmonic balance follows the resonance of the other one."""
    lever, spring = 0.1, 4.0e4
    ends = [{1: 1.0, 2: lever}, {1: 1.0, 2: -lever}]
    study = bd.lumped(
        [1.0, 1.0, 0.01], [4.0, 6.0, 1.0], [1.0e4, 5.0e3, 20.0], forces={0: 0.2}, response=0,
        contacts=[bd.Contact(0, end, kt=KT, kn=spring, mu=MU) for end in ends],
        load_per_preload={1: 1.0, 2: 1.5 * lever}, harmonics=1,
    )  # fmt: skip
    band = (20.0, 60.0)
    assert study.static(PRELOAD).friction_state == ("stick", "open")
    found = study.first_slip(PRELOAD, band)
    one = np.sqrt(SPRINGS[0] + KT) / (2.0 * np.pi)
    assert found.frequency == pytest.approx(one, rel=1e-3) and found.locked
    peak = study.peak(PRELOAD, band)
    assert peak.amplitude == pytest.approx(found.amplitude, rel=1e-7)


def test_the_print_names_margin_and_face():
    text = str(rubbing({0: 0.1}).first_slip(PRELOAD, BAND))
    assert text.startswith("Locked below") and "contact 1" in text and "not sufficient" in text
    assert str(rubbing({0: 50.0}).first_slip(PRELOAD, BAND)).startswith("Slips above")
    unlimited = replace(rubbing({0: 0.1}).first_slip(PRELOAD, BAND), factor=np.inf)
    assert "under any excitation" in str(unlimited)
    one_point = replace(unlimited, closed={"shroud": (1, 9)})
    assert "1 of 9" in str(one_point) and "points of shroud at rest" in str(one_point)


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
