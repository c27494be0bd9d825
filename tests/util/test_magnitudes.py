"""Mistaken sizes: each draws a warning that names value, range and likely mistake, or is refused, and none is answered."""

import re
import warnings

import numpy as np
import pytest

import bdamper as bd
from bdamper.fatigue import HaighTable, Material
from bdamper.fatigue.margin import LeastMargin
from bdamper.harmonic_balance.parameters import vary
from bdamper.harmonic_balance.rotor_speed import Conditions
from bdamper.importers import Measurement, Units, read_response
from bdamper.mistuning import DamperVariation, Mistuning
from bdamper.util.errors import PlausibilityWarning
from tests.each import each
from tests.plain import plain_study

TIP, F = bd.Excitation("tip"), (270.0, 380.0)
STEEL = Material(4e8, 1e9, 9e8, haigh=HaighTable((4e8,), (0.0,), (20.0,), (0.5,)))
DATA = Measurement("rig", np.array([100.0, 101.0, 102.0]), np.array([1e-5, 2e-5, 1e-5]))
LAW = bd.ContactLaw.jenkins([5e6], 10.0, 0.3, kn=1e7)


@pytest.fixture(scope="module")
def study():
    return plain_study(
        bd.reference_model("bladed_disk"), TIP, engine_order=5, friction_coefficient=0.4
    )


def lumped(**given):
    contact = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
    usual = {
        "mass": 1.0,
        "damping": 0.1,
        "stiffness": 1.0,
        "contacts": [contact],
        "forces": {0: 1.0},
    }
    return bd.lumped(**usual | given)


def loop(x, force):
    turn = np.linspace(0.0, 2.0 * np.pi, 40)
    return x * np.cos(turn), force * np.sin(turn)


def read(folder, text):
    path = folder / "rig.csv"
    path.write_text(text)
    return read_response(path)


OF_STUDIES = {
    # settings
    "a load history in newtons": (
        lambda s: s.static(20.0, history=(2000.0, 1.0)),
        "history: plausible 0.001 to 10, found 2000; possibly given in newtons; factors on the "
        "preload are expected",
    ),
    "a gap in millimetres": (
        lambda s: s.replace(gap={"left": 0.5}),
        "gap of 'left': plausible -0.0038 to 0.0038 m, -2 % to 2 % of the extent of the "
        "model, found 0.5 m; possibly given in millimetres or micrometres",
    ),
    "loads in newtons": (
        lambda s: s.replace(load_per_preload={"damper": 500.0}),
        "load_per_preload of 'damper': plausible 0.001 to 100 newtons per newton of preload, "
        "found 500 newtons per newton of preload; possibly given in newtons; fractions are "
        "expected",
    ),
    "friction in per cent": (
        lambda s: s.replace(friction_coefficient=30.0),
        "friction_coefficient: plausible 0.05 to 1.5, or 0, found 30; possibly given in per cent",
    ),
    "friction of a face in per cent": (
        lambda s: s.replace(friction_coefficient={"left": 40.0, "right": 0.4}),
        "friction_coefficient of 'left': plausible 0.05 to 1.5, or 0, found 40; possibly given in "
        "per cent",
    ),
    "damping in per cent": (
        lambda s: s.replace(damping_ratio=0.2),
        "damping_ratio: plausible at most 0.1 of critical damping, found 0.2 of critical "
        "damping; possibly given in per cent",
    ),
    "stiffness in N/mm": (
        lambda s: s.replace(contact_stiffness=1e4),
        "contact_stiffness: plausible 2.6e+06 to 2.6e+10 N/m, mean of the contact points, 0.01 "
        "to 100 times the stiffness of the bodies there, found 1e+04 N/m; possibly given in N/mm or "
        "per area",
    ),
    "N/mm3 for N/m3": (
        lambda s: s.replace(contact_stiffness=bd.PerArea(1e5)),
        "contact_stiffness of PerArea: plausible 2.6e+06 to 2.6e+10 N/m, mean of the "
        "contact points, 0.01 to 100 times the stiffness of the bodies there, found 4.8 N/m; possibly given in "
        "N/mm or per area",
    ),
    "a history in newtons": (
        lambda s: s.replace(load_history=(1500.0, 1.0)),
        "load_history: plausible 0.001 to 10, found 1500; possibly given in newtons; factors "
        "on the preload are expected",
    ),
    "a flow of 0.4": (
        lambda s: s.replace(aerodynamic_damping=0.4),
        "aerodynamic_damping at 5: plausible at most 0.1 of critical damping, found 0.4 of "
        "critical damping; possibly given in per cent",
    ),
    "a flow elsewhere": (
        lambda s: s.replace(aerodynamic_damping={7: 1e-3}),
        "aerodynamic_damping: plausible values at the nodal diameters of the study, [5], "
        "found values at [7] only",
    ),
    "friction that a law has itself": (
        lambda s: s.replace(friction_law=LAW, friction_coefficient=0.6),
        "friction_coefficient has no effect on 'left', 'right', because a ContactLaw has its "
        "own parameters; set the friction there",
    ),
    "no engine order": (
        lambda s: s.replace(engine_order=0),
        "engine_order: plausible 1 to 32, found 0; a force that does not vary as the wheel "
        "turns and excites nothing",
    ),
    "a force in MN": (
        lambda s: s.replace(excitation=bd.Excitation("tip", amplitude=1e6)),
        "excitation amplitude of 'tip': plausible 1e-06 to 2.6e+03 N, up to the force that "
        "deflects the structure by 10 % of its extent, found 1e+06 N; possibly given in mN "
        "or N/m2",
    ),
    "a second force in MN": (
        lambda s: s.replace(excitation=TIP + bd.Excitation("platform", amplitude=1e9)),
        "excitation amplitude of 'platform': plausible 1e-06 to 3.4e+05 N, up to the force "
        "that deflects the structure by 10 % of its extent, found 1e+09 N; possibly given in "
        "mN or N/m2",
    ),
    "degrees for radians": (
        lambda s: bd.Excitation("tip", phase=90),
        "excitation phase: expected a phase in radians from -2 pi to 2 pi, found 90; "
        "possibly given in degrees: use np.deg2rad(90)",
    ),
    "degrees in a sweep": (
        lambda s: bd.sweep(s, {"excitation.phase": [45.0]}, preload=9.0),
        "excitation.phase: plausible -6.28319 to 6.28319 rad, found 45 rad; possibly given "
        "in degrees",
    ),
    # variations
    "a damper without mass": (
        lambda s: vary(s, {"damper_inertia_factor": 0}),
        "damper_inertia_factor: expected a finite number > 0, found 0",
    ),
    "a mass in grams": (
        lambda s: vary(s, {"damper_inertia_factor": 1e3}),
        "mass of 'damper': plausible 0.00039 to 0.78 kg, by the size of its faces, found 69 "
        "kg; possibly given in grams",
    ),
    "masses of crossings in grams": (
        lambda s: s.resonance_crossings((200.0, 700.0), [5], damper_mass_factor=(20.0,)),
        "damper_mass_factor: plausible 0.05 to 10 times the mass of the damper, found 20 "
        "times the mass of the damper; possibly given in grams; factors are expected",
    ),
    "a mass factor of one damper in grams": (
        lambda s: bd.sweep(s, {"damper_mass_factor.damper": [69.0]}, preload=9.0),
        "damper_mass_factor of 'damper': plausible 0.02 to 15, found 69; possibly given in grams",
    ),
    "a compared setting in per cent": (
        lambda s: bd.compare(
            {"a": s, "b": {"friction_coefficient": 30.0}}, lambda x: x.frequency_response(9.0, F)
        ),
        "friction_coefficient: plausible 0.05 to 1.5, or 0, found 30; possibly given in per cent",
    ),
    "a sample in per cent": (
        lambda s: bd.optimal_curve_uncertainty(
            s, {"friction_coefficient": [20.0, 30.0]}, (10.0, 1e3)
        ),
        "friction_coefficient: plausible 0.05 to 1.5, or 0, found 30; possibly given in per cent",
    ),
    "a search in per cent": (
        lambda s: bd.fit(s, [], {"friction_coefficient": (10.0, 60.0)}),
        "friction_coefficient: plausible 0.05 to 1.5, or 0, found 60; possibly given in per cent",
    ),
    "a share as a percentile": (
        lambda s: bd.robust_optimum(s, {"friction_coefficient": [0.3]}, percentile=0.95),
        "percentile: plausible 50 to 100 %, found 0.95 %; possibly a fraction; write 95 for 95 %",
    ),
    # questions
    "a preload in kN": (
        lambda s: s.frequency_response(0.2, F),
        "preload: plausible 1 to 1e+06 N, 1 to 1e+06 times the excitation amplitude, found "
        "0.2 N; possibly given in kN, or the damper leaves its seat",
    ),
    "preloads of a sweep in kN": (
        lambda s: bd.sweep(s, {"preload": [0.1, 0.2]}),
        "preload: plausible 1 to 1e+06 N, 1 to 1e+06 times the excitation amplitude, found "
        "0.1 to 0.2 N; possibly given in kN, or the damper leaves its seat",
    ),
    "the optimum of half a load": (
        lambda s: s.replace(constant_loads={"damper": 100.0}).optimal_curve((10.0, 1e3), 3),
        "constant_loads: plausible none on a body that carries the preload, found 100 N on "
        "'damper'; the optimal preload is in addition to it",
    ),
    "rpm of a stress": (
        lambda s: s.stress(None, speed=15000.0),
        "speed: plausible 0.1 to 12000 rad/s, found 1.5e+04 rad/s; possibly given in "
        "revolutions per minute",
    ),
    "a modulus in GPa": (
        lambda s: s.gauge_stress(None, "root", "axial", elastic=(210.0, 0.3)),
        "elastic: plausible 1e+08 to 2e+12 Pa, found 210 Pa; possibly given in MPa or GPa",
    ),
    "a flow for cycles in per cent": (
        lambda s: s.flutter(100.0, -0.4),
        "aerodynamic_damping: plausible at most 0.1 of critical damping, found 0.4 of "
        "critical damping; possibly given in per cent",
    ),
    "cycles in millimetres": (
        lambda s: s.flutter(100.0, -1e-3, amplitude=(1e-3, 5.0)),
        "amplitude: plausible 1e-15 to 0.19 m, the extent of the model, found 5 m; possibly "
        "given in millimetres or micrometres",
    ),
    "friction over speed in per cent": (
        lambda s: s.at_speed(400.0, friction={300.0: 30.0, 500.0: 40.0}),
        "friction at 300: plausible 0.05 to 1.5, found 30; possibly given in per cent",
    ),
    # wheels
    "mistuning in per cent": (
        lambda s: bd.mistuned_sample(s, 0.9, 20.0),
        "standard_deviation: plausible 1e-06 to 0.2 of the frequency, found 0.9 of the "
        "frequency; possibly given in per cent",
    ),
    "variation in per cent": (
        lambda s: bd.mistuned_sample(s, 0.02, 20.0, dampers={"mass": 5.0}),
        "mass: plausible 1e-06 to 0.5 of the mean, found 5 of the mean; possibly given in per cent",
    ),
}
ALONE = {
    "an acceleration in mm/s2": (
        lambda: bd.MeasuredResponse(DATA, base_acceleration=9806.65),
        "base_acceleration: plausible 0.0001 to 1000 m/s2, found 9807 m/s2; possibly given in mm/s2",
    ),
    "an acceleration of masses in um/s2": (
        lambda: lumped(forces=None, base=9.8e6),
        "base: plausible 1e-09 to 1e+06 m/s2, found 9.8e+06 m/s2; possibly given in mm/s2",
    ),
    "a modulus of the response in GPa": (
        lambda: bd.Response("root", "axial", elastic=(210.0, 0.3)),
        "elastic: plausible 1e+08 to 2e+12 Pa, found 210 Pa; possibly given in MPa or GPa",
    ),
    "a Haigh table in Pa labelled MPa": (
        lambda: HaighTable.from_csv(
            {
                "amplitude (MPa)": [4e8],
                "mean (MPa)": [0.0],
                "temperature (C)": [20.0],
                "probability": [0.5],
            }
        ),
        "amplitude: plausible 1e+06 to 1e+10 Pa, found 4e+14 Pa; possibly converted from MPa to Pa twice",
    ),
    "mean stresses in MPa labelled Pa": (
        lambda: HaighTable((4e8, 3e8), (0.0, 400.0), (20.0, 20.0), (0.5, 0.5)),
        "mean: plausible 1e+06 to 1e+10 Pa, found 400 Pa; possibly given in MPa; 1 MPa is 1e6 Pa",
    ),
    "temperatures in °C labelled K": (
        lambda: HaighTable.from_csv(
            {
                "amplitude (MPa)": [400.0],
                "mean (MPa)": [0.0],
                "temperature (K)": [20.0],
                "probability": [0.5],
            }
        ),
        "temperature: plausible -200 to 1500 °C, found -253.1 °C; possibly °C labelled as K",
    ),
    "probabilities of failure": (
        lambda: HaighTable((4e8,), (0.0,), (20.0,), (0.001,)),
        "probability: plausible 0.05 to 1, found 0.001; possibly the probability of failure",
    ),
    "temperatures of points in K": (
        lambda: LeastMargin(STEEL, line="table", temperature={"root": 1800.0}),
        "temperature of 'root': plausible -200 to 1500 °C, found 1800 °C; possibly given in K",
    ),
    "deviations in per cent": (
        lambda: Mistuning([2.0, 1.0, 0.5]),
        "deviation: plausible -0.5 to 0.5 of the frequency, found 2 of the frequency; "
        "possibly given in per cent or Hz",
    ),
    "masses in grams": (
        lambda: DamperVariation.of(3, mass=20.0),
        "mass: plausible 0.2 to 5 times the mass of the damper, found 20 times the mass of "
        "the damper; possibly given in grams",
    ),
    "drawn masses in per cent": (
        lambda: DamperVariation.random(3, mass=3.0),
        "mass: plausible 1e-06 to 0.5 of the mean, found 3 of the mean; possibly given in per cent",
    ),
    "a mass in grams": (
        lambda: lumped(mass=1e9),
        "mass: plausible 1e-09 to 1e+07 kg, found 1e+09 kg; possibly given in grams",
    ),
    "a force in MN": (
        lambda: lumped(forces={0: 1e9}),
        "forces at 0: plausible 1e-09 to 1e+07 N, found 1e+09 N; possibly given in mN",
    ),
    "loads of masses in newtons": (
        lambda: lumped(load_per_preload={0: 500.0}),
        "load_per_preload at 0: plausible 0.001 to 100 newtons per newton of preload, found "
        "500 newtons per newton of preload; possibly given in newtons; fractions are expected",
    ),
    "a contact in MN/m": (
        lambda: bd.Contact(0, kt=1e15, mu=0.3, preload=1.0),
        "kt: plausible at most 1e+13 N/m, found 1e+15 N/m; possibly given in N/mm or GN/m",
    ),
    "a law in GN/m": (
        lambda: bd.ContactLaw.jenkins([5e15], 10.0),
        "stiffness: plausible at most 1e+13 N/m, found 5e+15 N/m; possibly given in N/mm or GN/m",
    ),
    "an angle in degrees": (
        lambda: bd.face_gap(bd.reference_model("bladed_disk").interfaces["left"], angle=0.5),
        "misfit angle: expected a finite number >= -0.1 and <= 0.1 rad, found 0.5",
    ),
    "coefficients in per cent": (
        lambda: bd.influence_coefficients({0: 0.8j}, 12),
        "given at 0: plausible at most 0.3 of critical damping, found 0.8 of critical "
        "damping; possibly given in per cent",
    ),
    "a loop in micrometres": (
        lambda: bd.fit_loop(*loop(20.0, 50.0), normal=100.0),
        "displacement: plausible 1e-09 to 0.01 m, found 20 m; possibly given in millimetres "
        "or micrometres",
    ),
    "a preload of a test in MN": (
        lambda: bd.MeasuredResponse(Measurement("a", np.ones(1), np.ones(1)), preload=2e-4),
        "preload: plausible 0.001 to 1e+08 N, found 0.0002 N; possibly given in MN",
    ),
    "units the wrong way round": (
        lambda: Units(1000.0, 1.0),
        "length: plausible 1e-06 to 1 m, found 1000 m; possibly the inverse; the factor is "
        "1e-3 for millimetres",
    ),
    "steps in Hz": (
        lambda: bd.ContinuationOptions(max_step=5.0),
        "max_step: plausible 0.0001 to 2, found 5; possibly given in Hz; a fraction of the "
        "vibration is expected",
    ),
    "conditions in per cent": (
        lambda: Conditions(friction={300.0: 30.0}),
        "friction at 300: plausible 0.05 to 1.5, found 30; possibly given in per cent",
    ),
}


def told(ask):
    """Return the first warning of a mistaken size, or the error, except estimates of computing time."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", PlausibilityWarning)
        with pytest.raises((PlausibilityWarning, bd.BdamperError)) as caught:
            ask()
    return str(caught.value)


@each("mistake", OF_STUDIES)
def test_a_mistaken_size_of_a_study_is_told(study, mistake):
    ask, message = OF_STUDIES[mistake]
    assert told(lambda: ask(study)) == message


@each("mistake", ALONE)
def test_a_mistaken_size_is_told(mistake):
    ask, message = ALONE[mistake]
    assert told(ask) == message


@each("mistake", OF_STUDIES | ALONE)
def test_a_message_names_value_range_and_mistake(mistake):
    message = (OF_STUDIES | ALONE)[mistake][1]
    # a misused value is named with its remedy, and a forbidden one with its limits
    named = r"[^:]+: (plausible .+, found .+|expected .+, found .+)"
    assert "\n" not in message
    assert re.fullmatch(named, message) or " has no effect on " in message
