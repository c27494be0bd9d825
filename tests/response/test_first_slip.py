"""Excitation of first slip against closed forms and against harmonic balance."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.response import first_slip
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


# ---- a locked shroud whose response curve has gaps ----

STIFF = 1e10
"""Stiffness (N/m) of a contact between two masses that move together by millimetres."""
TOGETHER = (10.0, 25.0)
LOADS = [PRELOAD, 1.5 * PRELOAD, 2.0 * PRELOAD]


def two_masses(force, stiffness=STIFF):
    """Two masses that one stiff contact joins; rounding of its force exceeds 1e-9 of the excitation."""
    return bd.lumped(
        [1.0, 1.0, 1.0], [2.0, 2.0, 6.0], [1.0e4, 1.0e4, 5.0e3], forces={0: force}, response=0,
        contacts=[bd.Contact((0, 1), 2, kt=stiffness, kn=KN, mu=MU)], harmonics=1,
        load_per_preload={2: 1.0},
    )  # fmt: skip


def limit_of_two():
    """Excitation of first slip: half of it passes the contact, which bears mu N of the preload."""
    return 2.0 * MU * NORMAL


def motion_together(force):
    """Amplitude and frequency of both masses, F/(c w_d) at the resonance of their sum."""
    stiffness, damping, mass = 2.0e4, 4.0, 2.0
    decay = damping / (2.0 * mass)
    damped = np.sqrt(stiffness / mass - decay**2)
    peak = np.sqrt(stiffness / mass - 2.0 * decay**2)
    return force / (damping * damped), peak / (2.0 * np.pi)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.3, 0.95])
def test_every_answer_about_a_locked_shroud_is_that_of_stuck_contacts(share, tmp_path):
    """Peak, curve and optimal curve agree, with new studies, and in one study in another order."""
    force = share * limit_of_two()
    amplitude, frequency = motion_together(force)
    assert two_masses(force).first_slip(PRELOAD, TOGETHER).factor == pytest.approx(1.0 / share)
    together = two_masses(force)
    optimal = together.optimal_curve(LOADS, frequency=TOGETHER, check=False)
    for study in (two_masses(force), together):
        peak = study.peak(PRELOAD, TOGETHER)
        assert peak.ok and not peak.corner and not peak.search_reason
        assert peak.amplitude == pytest.approx(amplitude, rel=1e-7)
        assert peak.frequency == pytest.approx(frequency, rel=1e-6)
        np.testing.assert_allclose(peak.shares, [1.0, 0.0, 0.0], atol=1e-12)
    for study in (two_masses(force), together):
        curve = study.frequency_response(PRELOAD, TOGETHER)
        assert curve.complete and curve.gap is None
        assert curve.peak.amplitude == pytest.approx(amplitude, rel=1e-7)
    np.testing.assert_allclose(optimal.amplitude, amplitude, rtol=1e-7)
    for result in (peak, curve):
        text = " ".join(str(result).split())
        assert f"first slip at {1.0 / share:.3g} times the excitation" in text
        result.save(tmp_path / "locked.h5")
        assert str(bd.load(tmp_path / "locked.h5")) == str(result)
    assert "20 N to 40 N a shroud is locked" in " ".join(str(optimal).split())


def test_above_first_slip_nothing_is_locked():
    force = 1.05 * limit_of_two()
    study = two_masses(force)
    curve = study.frequency_response(PRELOAD, TOGETHER)
    assert not any("locked" in note for note in curve.notes)


@pytest.mark.filterwarnings("ignore:kt. plausible")
def test_a_stiffness_that_leaves_no_digits_is_not_locked():
    study = two_masses(0.3 * limit_of_two(), stiffness=1e14)
    peak = study.peak(PRELOAD, TOGETHER)
    assert not peak.ok and study.problem.at(PRELOAD).residual is None


def test_the_locked_state_has_the_friction_that_holds_a_point_apart():
    """From it harmonic balance is linear beyond the excitation at which the point would touch."""
    force = 2.0 * 0.98 * beside_a_stop(2.0).first_slip(PRELOAD, BAND).factor
    study = beside_a_stop(force)
    found = study.first_slip(PRELOAD, BAND)
    assert found.touching < 1.0 < found.factor
    locked = first_slip.residual_state(study.problem.at(PRELOAD), BAND)
    friction = (MU * NORMAL - KT * GAP) / (1.0 + KT / SPRINGS[0])
    assert locked.state.force[0, 0] == pytest.approx(friction, rel=1e-8)
    assert locked.state.closing[1] == pytest.approx(-GAP - friction / SPRINGS[0], rel=1e-8)
    assert study.peak(PRELOAD, BAND).amplitude < 0.99 * found.amplitude
    most = study.replace(residual_forces="most")
    assert most.peak(PRELOAD, BAND).amplitude == pytest.approx(found.amplitude, rel=1e-8)
    # first slip belongs to the static state
    assert most.first_slip(PRELOAD, BAND) == found


@pytest.mark.slow
def test_the_locked_state_of_a_shroud_vibrates_without_slip():
    """Harmonic balance from this state is linear, and friction stays below its limit at rest."""
    study = bd.Study(
        bd.reference_model("shrouded_blade"), bd.Excitation("tip", "axial", 0.1), engine_order=4,
        harmonics=1, friction_coefficient=0.3, constant_loads={"shroud": 500.0},
        load_per_preload={"front": 1.0, "rear": 0.6},
    )  # fmt: skip
    found = study.first_slip(300.0)
    share = 0.95 * found.factor
    band = (0.99 * found.frequency, 1.01 * found.frequency)
    study = study.replace(excitation=bd.Excitation("tip", "axial", 0.1 * share))
    locked = first_slip.residual_state(study.problem.at(300.0), band)
    limit = 0.3 * locked.state.force[:, 2]
    assert np.all(np.abs(locked.state.force[:, :2]) <= limit[:, None] + 1e-6 * limit.max())
    peak = study.peak(300.0, band, errors=False)
    assert peak.ok and peak.shares[1] == 0.0
    assert peak.amplitude == pytest.approx(share * found.amplitude, rel=1e-7)


@pytest.mark.slow
def test_a_shroud_below_first_slip_is_locked_also_where_a_curve_from_rest_is_complete():
    """The static state leaves less friction to the vibration; its peak is 3 % lower."""
    excitation = bd.Excitation("tip", "axial", 0.1)
    study = bd.Study(
        bd.reference_model("shrouded_blade"), excitation, engine_order=4, harmonics=1,
        constant_loads={"shroud": 500.0}, load_per_preload={"front": 1.0, "rear": 0.6},
    )  # fmt: skip
    found = study.first_slip(300.0)
    share = 0.9 * found.factor
    study = study.replace(excitation=replace(excitation, amplitude=share * excitation.amplitude))
    band = (0.99 * found.frequency, 1.01 * found.frequency)
    wide = (0.9 * found.frequency, 1.2 * found.frequency)
    for interval in (band, wide, band):
        peak = study.peak(300.0, interval)
        assert peak.ok and peak.shares[1] == 0.0
        assert peak.amplitude == pytest.approx(share * found.amplitude, rel=1e-7)
        # with more harmonics it is locked as well
        of_harmonics = next(source for source in peak.errors if source.source == "harmonics")
        assert of_harmonics.amplitude == pytest.approx(0.0, abs=1e-6)
    # neighbouring studies start from their own residual forces: the locked peak is linear
    rate = study.peak_sensitivities(peak, ("excitation.amplitude",))
    force = study.settings.excitation.amplitude
    assert rate["excitation.amplitude"].amplitude == pytest.approx(peak.amplitude / force, rel=1e-6)
    # above first slip from the same forces; they still limit slip to less than it has from rest
    above = study.replace(excitation=replace(excitation, amplitude=1.2 * found.force))
    peak = above.peak(300.0, band, errors=False)
    assert peak.ok and peak.shares[1] > 0.0
    assert 0.95 < peak.amplitude / (1.2 * found.amplitude_at_first_slip) < 1.0
    assert "slip last, at 0.833 times the excitation" in " ".join(str(peak).split())
    far_above = study.replace(excitation=replace(excitation, amplitude=12.0 * found.force))
    assert first_slip.residual_state(far_above.problem.at(300.0), band) is None


def test_a_stored_peak_of_a_locked_joint_belongs_to_a_new_study():
    """The study knows the friction forces without having computed the peak, but not a moved mean."""
    peak = two_masses(0.3 * limit_of_two()).peak(PRELOAD, TOGETHER)
    force = 0.3 * limit_of_two()
    rates = two_masses(force).peak_sensitivities(peak, ("excitation.amplitude",))
    rate = rates["excitation.amplitude"].amplitude
    assert rate == pytest.approx(peak.amplitude / force, rel=1e-6)
    moved = peak.y.copy()
    moved[0] += 1e-5
    with pytest.raises(SettingError, match="expected a result of this study"):
        two_masses(force).peak_sensitivities(replace(peak, y=moved))


def test_answers_about_a_locked_joint_do_not_depend_on_earlier_ones():
    """A curve beside the resonance is the same before and after the peak, and from another start."""
    force = 0.3 * limit_of_two()
    beside = (18.0, 25.0)
    asked_before = two_masses(force)
    before = asked_before.frequency_response(PRELOAD, beside)
    peaks = [study.peak(PRELOAD, TOGETHER) for study in (asked_before, two_masses(force))]
    after = asked_before.frequency_response(PRELOAD, beside)
    assert before.notes == after.notes
    np.testing.assert_array_equal(before.unknowns, after.unknowns)
    assert peaks[0].amplitude == peaks[1].amplitude
    np.testing.assert_array_equal(peaks[0].y, peaks[1].y)
    text = str(asked_before.replace(residual_forces="rest").peak(PRELOAD, TOGETHER))
    assert 'study.replace(residual_forces="most")' in " ".join(text.split())


@pytest.mark.slow
def test_time_integration_keeps_a_locked_shroud():
    """It settles at the amplitude of stuck contacts."""
    force = 0.5 * limit_of_two()
    amplitude, _ = motion_together(force)
    study = two_masses(force)
    found = study.time_response(study.peak(PRELOAD, TOGETHER), seconds=30.0)
    assert found.ok, found.status_text
    assert found.mean == pytest.approx(amplitude, rel=0.02)


# ---- a response location that hardly moves ----


def shrouded(model, place):
    return bd.Study(
        model, bd.Excitation("tip", "axial"), response=bd.Response(place, "axial"), engine_order=4,
        harmonics=1, constant_loads={"shroud": 500.0}, load_per_preload={"front": 1.0, "rear": 0.6},
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "still"), [(130.0, True), (80.0, False)])
def test_a_response_location_that_hardly_moves_is_named_with_one_that_moves(ratio, still, recwarn):
    """A location of the blade that moves ``ratio`` times as far as the tip."""
    model = bd.reference_model("shrouded_blade")
    blade = model.bodies["blade"]
    bases = {
        diameter: replace(
            basis, locations={**basis.locations, "mid": ratio * basis.locations["tip"]}
        )
        for diameter, basis in blade.bases.items()
    }
    locations = {**model.locations, "mid": replace(model.locations["tip"], name="mid")}
    model = replace(
        model, bodies={**model.bodies, "blade": replace(blade, bases=bases)}, locations=locations
    )
    found = shrouded(model, "tip").first_slip(300.0)
    texts = [str(warning.message) for warning in recwarn if "response" in str(warning.message)]
    assert len(texts) == still
    if still:
        moves = f"'mid', axial, with {1e3 * ratio * found.amplitude:.3g} mm"
        assert moves in texts[0] and "found 'tip', axial, with" in texts[0]
    shrouded(model, "mid").first_slip(300.0)
    assert len([warning for warning in recwarn if "response" in str(warning.message)]) == still
