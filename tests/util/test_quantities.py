"""Quantities of pint: each number with a unit is the plain number in the unit that its documentation names."""

import inspect
import re

import numpy as np
import pint
import pytest

import bdamper as bd
from bdamper.contact.laws import ContactLaw
from bdamper.contact.stiffness import PerArea
from bdamper.fatigue.criteria import Material
from bdamper.fem.contact_patches import Patches
from bdamper.harmonic_balance.settings import Settings
from bdamper.importers import (
    ContactFaces,
    FEBody,
    MassProperties,
    MeasuredMode,
    Measurement,
    Modes,
    Placement,
    Sector,
)
from bdamper.util import quantities, validation
from tests.each import each
from tests.plain import plain_study
from tests.turning import turning_disk
from tests.util.numeric import doors, numeric
from tests.util.test_plausible_table import own_name

Q = pint.UnitRegistry().Quantity
PER_HERTZ = {
    "Hz": 1.0,
    "kHz": 1e-3,
    "turn/s": 1.0,
    "rpm": 60.0,
    "rad/s": 2.0 * np.pi,
    "degree/s": 360.0,
    "turn/min": 60.0,
}
"""Number that each unit has for 1 Hz."""
BAND = (330.0, 360.0)


@pytest.fixture(scope="module")
def study():
    return plain_study(
        turning_disk((0, 5)), bd.Excitation("tip", amplitude=20.0), 5, friction_coefficient=0.3
    )


@pytest.mark.slow
@each("unit", PER_HERTZ)
def test_frequencies_are_converted_through_turns(study, unit):
    asked = tuple(Q(PER_HERTZ[unit] * end, unit) for end in BAND)
    for band in (asked, list(asked), Q(PER_HERTZ[unit] * np.array(BAND), unit)):
        np.testing.assert_allclose(study.free(band).frequency[[0, -1]], BAND, rtol=1e-12)
    assert validation.interval("frequency", asked) == pytest.approx(BAND, rel=1e-12)
    assert bd.PeakTask(Q(0.2, "kN"), asked).frequency == pytest.approx(BAND, rel=1e-12)


def test_a_frequency_per_second_is_in_hertz(study):
    asked = tuple(Q(end, "1/s") for end in BAND)
    np.testing.assert_allclose(study.free(asked).frequency[[0, -1]], BAND, rtol=1e-12)


@pytest.mark.slow
@each("unit", PER_HERTZ)
def test_speeds_are_converted_through_turns(study, unit):
    """70 turns per second are 439.8 rad/s."""
    speed = Q(70.0 * PER_HERTZ[unit], unit)
    expected = 2.0 * np.pi * 70.0
    for found in (study.at_speed(speed), study.at_speed(rpm=speed)):
        assert found.settings.speed == pytest.approx(expected, rel=1e-12)
    speeds = (speed, 1.1 * speed)
    assert study.campbell(speeds, (5,)).speed[[0, -1]] == pytest.approx(
        [expected, 1.1 * expected], rel=1e-12
    )
    assert validation.number("speed", speed, unit="rad/s") == pytest.approx(expected, rel=1e-12)


def test_what_may_count_turns_or_radians_is_refused(study):
    with pytest.raises(bd.SettingError, match=r"^omega: expected rad/s, found 400\.0 / second$"):
        study.at_speed(Q(400.0, "1/s"))
    with pytest.raises(
        bd.SettingError, match=r"^friction_coefficient: expected a plain number, found 20 degree$"
    ):
        study.replace(friction_coefficient=Q(20, "degree"))
    with pytest.raises(bd.SettingError, match=r"^preload: expected N, found 3 kilohertz$"):
        study.peak(Q(3, "kHz"))
    with pytest.raises(
        bd.SettingError, match=r"^mode: expected a plain number, found 3 kilohertz$"
    ):
        study.peak(200.0, mode=Q(3, "kHz"))


SETTINGS = {
    "contact_stiffness": (Q(40.0, "kN/mm"), 4e7),
    "gap": (
        {"left": Q(5.0, "um"), "right": Q([0.002] * 9, "mm")},
        {"left": 5e-6, "right": np.full(9, 2e-6)},
    ),
    "constant_loads": ({"damper": Q(0.5, "kN")}, {"damper": 500.0}),
    "damper_drag": ({"damper": Q(0.02, "N/(mm/s)")}, {"damper": 20.0}),
    "damping_ratio": (Q(0.2, "percent"), 0.002),
    "residual_slip_std": (Q(0.1, "um"), 1e-7),
}


@each("name", SETTINGS)
def test_settings_are_converted(study, name):
    given, expected = SETTINGS[name]
    found = getattr(study.replace(**{name: given}).settings, name)
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        found, expected = (np.hstack([item[key] for key in expected]) for item in (found, expected))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_parts_of_settings_are_converted():
    assert bd.Excitation("tip", amplitude=Q(0.02, "kN"), phase=Q(90.0, "degree")) == bd.Excitation(
        "tip", amplitude=20.0, phase=0.5 * np.pi
    )
    assert PerArea(Q(2.0, "N/mm**3")).stiffness == pytest.approx(2e9)
    given, expected = (
        ContactLaw.jenkins([Q(20.0, "kN/m")], [Q(5e-3, "kN")]),
        ContactLaw.jenkins([2e4], [5.0]),
    )
    np.testing.assert_allclose(given.parameters, expected.parameters, rtol=1e-12)
    steel = Material(Q(300.0, "MPa"), Q(900.0, "MPa"), Q(0.8, "GPa"))
    assert (steel.endurance_limit, steel.ultimate_strength, steel.yield_strength) == pytest.approx(
        (3e8, 9e8, 8e8)
    )


def test_a_lumped_model_is_converted():
    """An oscillator of 2 kg on 80 N/mm has sqrt(8e4 / 2) / 2 pi = 31.83 Hz."""
    contact = bd.Contact(tangential=0, kt=Q(10.0, "N/mm"), mu=0.3, preload=Q(1e-2, "kN"))
    made = bd.lumped(
        Q(2000.0, "g"),
        Q(2.0, "N s/m"),
        Q(80.0, "N/mm"),
        contacts=[contact],
        forces={0: Q(500.0, "mN")},
    )
    assert made.settings.excitation.amplitude == 0.5
    free = made.free((Q(25.0, "Hz"), Q(40.0, "Hz"))).peak
    assert free.frequency == pytest.approx(np.sqrt(4e4 - 0.5) / (2.0 * np.pi), rel=1e-3)


def test_varied_values_are_converted(study):
    values = {
        "preload": [Q(0.2, "kN"), Q(400.0, "N")],
        "excitation.amplitude": Q([0.01, 0.02], "kN"),
    }
    with pytest.warns(bd.PlausibilityWarning, match="centrifugal load of the damper at 439.8"):
        found = bd.sweep(
            study, values | {"speed": [Q(70.0, "Hz")]}, lambda s, preload: {"seen": preload}
        ).points
    assert np.unique(found["preload"]).tolist() == [200.0, 400.0]
    assert np.unique(found["excitation.amplitude"]).tolist() == [10.0, 20.0]
    np.testing.assert_allclose(found["speed"], 140.0 * np.pi, rtol=1e-12)
    designs = {
        "now": study,
        "harder": {"excitation.amplitude": Q(0.03, "kN"), "gap": {"left": Q(1.0, "um")}},
    }
    seen = []
    bd.compare(designs, lambda s: seen.append(s) or s.free(BAND))
    assert seen[1].excitation.amplitude == 30.0 and seen[1].settings.gap["left"] == pytest.approx(
        1e-6
    )
    assert (
        study.replace(speed=None, **{"excitation.amplitude": Q(0.03, "kN")}).excitation.amplitude
        == 30.0
    )


SI = ("N", "m", "rad", "rad/s", "Hz", "Hz/s", "Pa", "kg", "N/m", "N/m3", "kg/m3", "N s/m")
DOORS = doors()
PLAIN = {"ContactFaces", "Patches", "Mistuning.from_csv", "Mistuning.from_frequencies"}
"""Functions with plain numbers, and classes of an import, which convert on their own."""


def documented():
    """Numbers whose documentation names a unit: function, parameter, unit."""
    for name, door in DOORS.items():
        text = inspect.getdoc(Settings if door is bd.Study else door) or ""
        for parameter in numeric(door):
            line = re.search(rf"^(?:\w+, )*{parameter}(?:, \w+)* : (.*)$", text, re.M)
            units = [word for word in re.split(r", | or ", line[1]) if word in SI] if line else []
            if len(units) == 1 and parameter != "rpm":
                yield name, parameter, units[0]


DOCUMENTED = [item for item in documented() if item[0] not in PLAIN]


def test_most_numbers_have_a_documented_unit():
    assert len(DOCUMENTED) > 60


@each(("name", "parameter", "unit"), DOCUMENTED)
def test_the_unit_of_a_quantity_is_the_documented_one(name, parameter, unit):
    assert quantities.unit_of(own_name(name), parameter) == unit
    door = DOORS[name]
    called = (
        Settings.__init__ if door is bd.Study else door.__init__ if isinstance(door, type) else door
    )
    assert hasattr(called, "doubts"), f"decorate {name} with validation.check_arguments"


def test_data_of_an_import_convert_quantities():
    face = ContactFaces("root", "a", "b", stiffness=(Q(2.0, "N/um"), 3e6, Q(4.0, "kN/mm")))
    np.testing.assert_allclose(face.stiffness, (2e6, 3e6, 4e6), rtol=1e-12)
    whole = ContactFaces("root", "a", "b", stiffness=Q(np.ones((24, 3)), "N/um"))
    np.testing.assert_allclose(whole.stiffness, np.full((24, 3), 1e6), rtol=1e-12)
    patches = Patches(Q(np.ones((1, 3)), "mm"), np.eye(3)[None], Q(np.ones((1, 2)), "cm"))
    np.testing.assert_allclose(patches.centre, np.full((1, 3), 1e-3), rtol=1e-12)
    np.testing.assert_allclose(patches.area, [1e-4], rtol=1e-12)
    body = FEBody(np.arange(2), np.zeros((2, 3)), rotor_speed=Q(600.0, "rpm"))
    assert body.rotor_speed == pytest.approx(20.0 * np.pi, rel=1e-12)
    modes = Modes(0, Q(np.array([1.0]), "kHz"), np.arange(2), np.zeros((2, 3, 1)))
    np.testing.assert_allclose(modes.frequency, [1000.0], rtol=1e-12)


def test_measurements_convert_quantities():
    mode = MeasuredMode(
        Q(np.array([1.0, 2.0]), "um"),
        Q(np.array([6e4, 12e4]), "rpm"),
        Q(np.array([1.0, 2.0]), "percent"),
        preload=Q(0.1, "kN"),
    )
    np.testing.assert_allclose(mode.amplitude, [1e-6, 2e-6], rtol=1e-12)
    np.testing.assert_allclose(mode.frequency, [1000.0, 2000.0], rtol=1e-12)
    np.testing.assert_allclose(mode.damping_ratio, [0.01, 0.02], rtol=1e-12)
    assert mode.preload == pytest.approx(100.0, rel=1e-12)
    swept = Measurement(
        "tip", Q(np.array([1.0]), "kHz"), np.ones(1), force=Q(np.array([5.0]), "mN")
    )
    np.testing.assert_allclose(swept.frequency, [1000.0], rtol=1e-12)
    np.testing.assert_allclose(swept.force, [0.005], rtol=1e-12)


@each(
    "make",
    [
        lambda: ContactFaces("root", "a", "b", gap=Q(1.0, "um")),
        lambda: Placement(origin=Q([0.0, 1.0, 0.0], "mm")),
        lambda: Sector(elasticity=(Q(210.0, "GPa"), 0.3)),
        lambda: MassProperties(Q(1.0, "g"), np.zeros(3), np.eye(3)),
        lambda: Measurement("tip", np.ones(1), Q(np.ones(1), "mm")),
    ],
)
def test_numbers_in_the_units_of_a_file_refuse_quantities(make):
    with pytest.raises(bd.SettingError, match="expected a plain number"):
        make()
