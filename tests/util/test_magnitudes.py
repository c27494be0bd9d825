"""Mistaken sizes: each draws a warning that names value, range and likely mistake, or is refused, and none is answered."""

import re
import warnings

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.parameters import vary
from bdamper.harmonic_balance.rotor_speed import Conditions
from bdamper.importers import Measurement, Units, read_response
from bdamper.mistuning import DamperVariation, Mistuning
from bdamper.util.errors import PlausibilityWarning
from tests.each import each
from tests.plain import plain_study

TIP, F = bd.Excitation("tip"), (270.0, 380.0)
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
    "a gap in millimetres": (lambda s: s.replace(gap={"left": 0.5}), "gap of 'left': plausible .*, found 0.5 m; .*milli"),
    "loads in newtons": (
        lambda s: s.replace(load_per_preload={"damper": 500.0}),
        "load_per_preload of 'damper': .* found 500 newtons .*; .*newtons"),
    "friction in per cent": (lambda s: s.replace(friction_coefficient=30.0), "0.05 to 1.5, or 0, found 30; .*per cent"),
    "friction of a face in per cent": (
        lambda s: s.replace(friction_coefficient={"left": 40.0, "right": 0.4}), "friction_coefficient: .* 40; .*per cent"),
    "damping in per cent": (
        lambda s: s.replace(damping_ratio=0.2), "damping_ratio: plausible at most 0.1 .* 0.2 .* per cent"),
    "stiffness in N/mm": (lambda s: s.replace(contact_stiffness=1e4), "contact_stiffness: .* found 1e.04 N/m; .*N/mm"),
    "N/mm3 for N/m3": (lambda s: s.replace(contact_stiffness=bd.PerArea(1e5)), "contact_stiffness of PerArea: .*; .*N/mm"),
    "a history in newtons": (lambda s: s.replace(load_history=(1500.0, 1.0)), "load_history: .* found 1500; .*newtons"),
    "a flow of 0.4": (lambda s: s.replace(aerodynamic_damping=0.4), "aerodynamic_damping of 5: .* found 0.4 of critical"),
    "a flow elsewhere": (
        lambda s: s.replace(aerodynamic_damping={7: 1e-3}), r"diameters \[5\] of the study, found at \[7\] alone"),
    "friction that a law has itself": (
        lambda s: s.replace(friction_law=LAW, friction_coefficient=0.6),
        "friction_coefficient.*no effect on .left., .right., because a ContactLaw"),
    "no engine order": (lambda s: s.replace(engine_order=0), "engine_order: plausible 1 to 32, found 0; .*a force that"),
    "a force in MN": (lambda s: s.replace(excitation=bd.Excitation("tip", amplitude=1e6)),
        "amplitude of 'tip': .* 1e.06 N"),
    "a second force in MN": (
        lambda s: s.replace(excitation=TIP + bd.Excitation("platform", amplitude=1e9)), "of 'platform': .* 1e.09 N"),
    "degrees for radians": (lambda s: bd.Excitation("tip", phase=90), "excitation phase: .*deg2rad.*, found 90"),
    "degrees in a sweep": (
        lambda s: bd.sweep(s, {"excitation.phase": [45.0]}, preload=9.0), "excitation.phase: .* found 45 rad; .*degrees"),
    # variations
    "a damper without mass": (lambda s: vary(s, {"damper_inertia_factor": 0}), "damper_inertia_factor: .* > 0.*, found 0"),
    "a mass in grams": (
        lambda s: vary(s, {"damper_inertia_factor": 1e3}), "mass of 'damper': .* by the size of its faces, .*; .*grams"),
    "masses of crossings in grams": (
        lambda s: s.resonance_crossings((200.0, 700.0), [5], damper_mass_factor=(20.0,)),
        "damper_mass_factor: plausible 0.05 to 10 .*; .*grams"),
    "a mass factor of one damper in grams": (
        lambda s: bd.sweep(s, {"damper_mass_factor.damper": [69.0]}, preload=9.0),
        "damper_mass_factor of 'damper': .* 69; .*grams"),
    "a compared setting in per cent": (
        lambda s: bd.compare({"a": s, "b": {"friction_coefficient": 30.0}}, lambda x: x.frequency_response(9.0, F)),
        "found 30; .*per"),
    "a sample in per cent": (
        lambda s: bd.optimal_curve_uncertainty(s, {"friction_coefficient": [20.0, 30.0]}, (10.0, 1e3)),
        "friction_coeff.* found 30"),
    "a search in per cent": (
        lambda s: bd.fit(s, [], {"friction_coefficient": (10.0, 60.0)}), "friction_coefficient: .* found 60; .*per cent"),
    "a share as a percentile": (
        lambda s: bd.robust_optimum(s, {"friction_coefficient": [0.3]}, percentile=0.95), "percentile: .*; .*a fraction"),
    # questions
    "a preload in kN": (lambda s: s.frequency_response(0.2, F),
        "preload: plausible 1 to 1e.06 N, .* found 0.2 N; .*kN"),
    "preloads of a sweep in kN": (lambda s: bd.sweep(s, {"preload": [0.1, 0.2]}), "preload: .* found 0.1 to 0.2 N; .*kN"),
    "the optimum of half a load": (
        lambda s: s.replace(constant_loads={"damper": 100.0}).optimal_curve((10.0, 1e3), 3),
        "constant_loads: plausible none on a body that carries the preload, found 100 N on 'damper'"),
    "rpm of a stress": (lambda s: s.stress(None, speed=15000.0), "speed: .* found 1.5e.04 rad/s; .*revolutions"),
    "a modulus in GPa": (
        lambda s: s.gauge_stress(None, "root", "axial", elastic=(210.0, 0.3)), "elastic: .* 210 Pa; .*MPa or GPa"),
    "a flow for cycles in per cent": (lambda s: s.flutter(100.0, -0.4), "aerodynamic_damping: .* found .*0.4 of critical"),
    "cycles in millimetres": (lambda s: s.flutter(100.0, -1e-3, amplitude=(1e-3, 5.0)), "amplitude: .* found 5 m; .*milli"),
    "friction over speed in per cent": (lambda s: s.at_speed(400.0, friction={300.0: 30.0, 500.0: 40.0}), "friction.* 30"),
    # wheels
    "mistuning in per cent": (
        lambda s: bd.mistuned_sample(s, 0.9, 20.0), "standard_deviation: .* 0.9 of the freq.*; .*per cent"),
    "variation in per cent": (
        lambda s: bd.mistuned_sample(s, 0.02, 20.0, dampers={"mass": 5.0}), "mass: .* found 5; .*per cent"),
}  # fmt: skip
ALONE = {
    "deviations in per cent": (
        lambda: Mistuning([2.0, 1.0, 0.5]), "deviation: .* found 2 of the frequency; .*per cent or Hz"),
    "masses in grams": (
        lambda: DamperVariation.of(3, mass=20.0), "mass: .* times the mass of the damper, found 20 .*; .*grams"),
    "drawn masses in per cent": (lambda: DamperVariation.random(3, mass=3.0), "mass: .* found 3; .*per cent"),
    "a mass in grams": (lambda: lumped(mass=1e9), "mass: plausible 1e-09 to 1e.07 kg, found 1e.09 kg; .*grams"),
    "a force in MN": (lambda: lumped(forces={0: 1e9}), "forces of 0: .* found 1e.09 N; .*mN"),
    "loads of masses in newtons": (lambda: lumped(load_per_preload={0: 500.0}),
        "load_per_preload of 0: .* found 500 newtons per newton"),
    "a contact in MN/m": (lambda: bd.Contact(0, kt=1e15, mu=0.3, preload=1.0), "kt: plausible .*, found 1e.15 N/m"),
    "a law in GN/m": (lambda: bd.ContactLaw.jenkins([5e15], 10.0), "stiffness: .* found 5e.15 N/m"),
    "an angle in degrees": (
        lambda: bd.face_gap(bd.reference_model("bladed_disk").interfaces["left"], angle=0.5),
        "angle: .* 0.1 rad, found 0.5"),
    "coefficients in per cent": (lambda: bd.influence_coefficients({0: 0.8j}, 12), "given of 0: .* 0.8 of critical"),
    "a loop in micrometres": (lambda: bd.fit_loop(*loop(20.0, 50.0), normal=100.0), "displacement: .* found 20 m; .*milli"),
    "a preload of a test in kN": (
        lambda: bd.MeasuredResponse(Measurement("a", np.ones(1), np.ones(1)), preload=2e-4),
        "preload: .* found 0.0002 N; .*MN"),
    "units the wrong way round": (lambda: Units(1000.0, 1.0), "length: .* found 1000 m; .*the inverse"),
    "steps in Hz": (lambda: bd.ContinuationOptions(max_step=5.0), "max_step: .* found 5; .*Hz"),
    "conditions in per cent": (lambda: Conditions(friction={300.0: 30.0}), "friction of 300.0: .* found 30; .*per cent"),
}  # fmt: skip


def told(ask):
    """The first warning of a mistaken size, or the error, without what a computation would take."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", PlausibilityWarning)
        with pytest.raises((PlausibilityWarning, bd.BdamperError)) as caught:
            ask()
    return str(caught.value)


def check(text, words):
    stated = "(plausible|expected) .*, found |has no effect|already carries"
    assert "\n" not in text and re.search(stated, text)
    assert re.search(words, text), text


@each("mistake", OF_STUDIES)
def test_a_mistaken_size_of_a_study_is_told(study, mistake):
    ask, words = OF_STUDIES[mistake]
    check(told(lambda: ask(study)), words)


@each("mistake", ALONE)
def test_a_mistaken_size_is_told(mistake):
    ask, words = ALONE[mistake]
    check(told(ask), words)
