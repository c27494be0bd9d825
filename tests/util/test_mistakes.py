"""The typical mistakes of users: each draws one clear line with the thing, what was expected and what was found."""

import warnings

import numpy as np
import pytest

import bdamper as bd
from bdamper.fatigue.criteria import AISI_1050, Material
from bdamper.fatigue.margin import MarginCurve
from bdamper.harmonic_balance.parameters import vary
from bdamper.importers.build import build_model
from bdamper.importers.contact_faces import ContactFaces
from bdamper.mistuning import DiskPeakOptions, Mistuning
from bdamper.util.errors import PlausibilityWarning
from tests.each import each
from tests.plain import plain_study

F = (270.0, 380.0)
TIP = bd.Excitation("tip")
ONE = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model("bladed_disk")
    return plain_study(model, TIP, engine_order=5, friction_coefficient=0.4)


def lumped(**given):
    usual = {"mass": 1.0, "damping": 0.1, "stiffness": 1.0, "contacts": [ONE], "forces": {0: 1.0}}
    return bd.lumped(**usual | given)


def empty_margins():
    nothing, none = np.zeros(0), np.zeros((0, 1))
    return MarginCurve("preload", "N", nothing, nothing, nothing, ("a",), np.zeros(0, int), none, none, none,
                       nothing, nothing, nothing, AISI_1050, None)  # fmt: skip


REFUSED = {
    # what a study is made of
    "the path of a model for the model": (lambda s: bd.Study("disk.h5", TIP, 5), "model: .*found str"),
    "nothing that excites": (lambda s: bd.Study(s.model), "Study: .*'excitation'"),
    "a place for an excitation": (lambda s: bd.Study(s.model, "tip", 5), "excitation: .*found 'tip'"),
    "no engine order": (lambda s: bd.Study(s.model, TIP), "engine_order: .*65 sectors, found none"),
    "an engine order without modes": (lambda s: bd.Study(s.model, TIP, 21), "needs nodal diameter 23, the model has"),
    "a place that is not there": (lambda s: s.replace(excitation=bd.Excitation("tpi")), "found 'tpi'; did you mean tip"),
    "no direction at all": (lambda s: bd.Excitation("tip", (0, 0, 0)), r"direction: .*found \(0, 0, 0\)"),
    "more modes than there are": (lambda s: s.replace(blade_modes=500), "blade_modes: .*found 500"),
    "friction of a face that is not there": (lambda s: s.replace(friction_coefficient={"lft": 0.3}), "did you mean left"),
    "an equation that the paper has not": (lambda s: s.replace(contact_stiffness="eq7"), "contact_stiffness: .*'eq7'"),
    "damping of a damper that is not there": (lambda s: lumped(damper_drag=1.0), "damper_drag: .*no free body, found 1"),
    "a gap for no face": (lambda s: s.replace(gap={"lft": 1e-6}), r"gap: .*found \['lft'\]"),
    "a speed without a model of it": (lambda s: s.replace(speed=400.0), "speed: .*study.at_speed"),
    # names
    "misspelt setting": (lambda s: bd.Study(s.model, TIP, 5, friction_coeficient=0.3), "mean friction_coefficient"),
    "part of a name": (lambda s: s.replace(friction=0.3), "no argument 'friction'; did you mean friction_coefficient"),
    "misspelt part of a setting": (lambda s: bd.sweep(s, {"excitation.amplitud": [1.0]}), "mean excitation.amplitude"),
    "misspelt argument of a sweep": (lambda s: bd.sweep(s, {"preload": [1.0]}, excutor=None), "mean executor"),
    "misspelt matrix": (lambda s: lumped(contact=[]), "lumped: .*no argument 'contact'; did you mean contacts"),
    "an import without contacts": (lambda s: build_model(None), "build_model: .*'contacts'"),
    "misspelt argument of a question": (
        lambda s: s.frequency_response(9.0, F, progres=True),
        "frequency_response: .*did you mean progress",
    ),
    "a word of no relation": (lambda s: s.peak(9.0, F, wheel=1), "peak: .*no argument 'wheel'; the arguments are preload"),
    "misspelt model": (lambda s: bd.reference_model("blade_disk"), "found 'blade_disk'; did you mean bladed_disk"),
    "misspelt condition": (lambda s: s.at_speed(400.0, temperatur={}), "did you mean temperature"),
    "misspelt option of the search": (lambda s: DiskPeakOptions(climb=3), "DiskPeakOptions: .*did you mean climbs"),
    "a sample without a preload": (lambda s: bd.mistuned_sample(s, 0.02), "mistuned_sample: .*'preload'"),
    # questions
    "a preload where nothing is loaded": (
        lambda s: lumped().frequency_response(5.0, (0.1, 0.3)),
        "preload: expected 0, .*found 5 N",
    ),
    "preloads the wrong way": (lambda s: s.optimal_curve((2e4, 20.0)), "preload"),
    "margin without material": (lambda s: s.optimal_curve((20.0, 2e4), 3, quantity="margin"), "material: .*found None"),
    "a sweep over nothing": (lambda s: bd.sweep(s, {}), "over: .*found {}"),
    "a sweep without a preload": (lambda s: bd.sweep(s, {"friction_coefficient": [0.3]}), "preload: .*found neither"),
    "both units of speed": (lambda s: s.at_speed(400.0, rpm=4000.0), "rotor speed: .*found both"),
    "no speed": (lambda s: s.campbell(engine_orders=[5]), "rotor speed: .*rpm=, found none"),
    "no engine order of a crossing": (lambda s: s.resonance_crossings((100.0, 900.0)), "engine_orders: .*found none"),
    "no preload at rest": (lambda s: s.preload, "preload: .*study.at_speed"),
    # masses, wheels, materials, files
    "a massless freedom": (lambda s: lumped(mass=[1.0, 0.0], damping=0.0, stiffness=[1.0, 1.0]), "mass: .*definite"),
    "matrices of two sizes": (lambda s: lumped(stiffness=[1.0, 1.0]), r"stiffness: .*\(1, 1\).*found shape \(2,\)"),
    "a force on a freedom that is not there": (lambda s: lumped(forces={3: 1.0}), "forces: .*from 0 to 0.*found 3"),
    "a contact without stiffness": (lambda s: bd.Contact(0, mu=0.3, preload=1.0), "contact: .*kt > 0.*found"),
    "blades of another wheel": (lambda s: bd.BladedDisk(s, np.zeros(60)), "mistuning: expected 65 blades.*found 60"),
    "a mistuning as a text": (lambda s: Mistuning("1 %"), "mistuning: .*deviations above -1, found '1 %'"),
    "yield above rupture": (lambda s: Material(3e8, 5e8, 9e8), "yield_strength: .*found 9e"),
    "a curve of margins without a value": (lambda s: empty_margins().least, "no margin found at any of 0 values"),
    "a file that is not there": (lambda s: bd.load_model("nowhere.h5"), "there is no model file 'nowhere.h5'"),
    "a contact named twice": (
        lambda s: build_model(None, contacts=[ContactFaces("a", "x", "y"), None]),
        "blade: expected an FEBody.*found None",
    ),
}


@each("mistake", REFUSED)
def test_a_mistake_is_refused_in_one_clear_line(study, mistake):
    ask, words = REFUSED[mistake]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises((bd.BdamperError, FileNotFoundError), match=words) as caught:
            ask(study)
    text = str(caught.value)
    assert "\n" not in text and len(text) < 700
    assert ("expected" in text and "found" in text) or " argument" in text or text.startswith(
        ("no margin found", "there is no model file", "body ")
    )


def failing(ask):
    with pytest.raises(bd.BdamperError, match=r"expected .*, found"):
        ask()


DOUBTED = {
    "rpm for rad/s": (lambda s: s.at_speed(4500), r"rotor speed: .* 1292 rad/s.*found 4500: revolutions .* rpm=4500"),
    "rpm of a diagram": (lambda s: s.campbell((2000, 5000, 7000), modes=1), r"found 7000: rev.* rpm=\(2000, 5"),
    "rpm of a run-up": (lambda s: failing(lambda: s.run_up((7000, 9500))), "rotor speed: .*found 9500: revolutions"),
    "a mass in grams": (lambda s: vary(s, {"damper_mass_factor": 1e3}), "mass of 'damper': .*found 69 kg: grams susp"),
    "strength in MPa": (lambda s: Material(300.0, 1200.0, 900.0), "ultimate_strength: .*found 1200 Pa: where 1 MPa is"),
    "rad/s for Hz": (lambda s: s.free((1700.0, 2200.0)), r"frequency: .*found \(1700, 2200\) .*radians per second susp"),
}


@each("mistake", DOUBTED)
def test_an_unlikely_unit_is_named(study, mistake):
    ask, words = DOUBTED[mistake]
    with pytest.warns(PlausibilityWarning, match=words) as caught:
        ask(study)
    doubts = {(str(w.message), w.filename) for w in caught if issubclass(w.category, PlausibilityWarning)}
    assert len(doubts) == len({text.partition(":")[0] for text, _ in doubts}), "one for each, which Python shows once"
    assert all("\n" not in text and place == __file__ for text, place in doubts)


def test_speeds_in_revolutions_per_minute(study):
    turn = np.pi / 30.0
    with warnings.catch_warnings():
        warnings.simplefilter("error", PlausibilityWarning)
        assert study.at_speed(rpm=4000.0).settings.speed == pytest.approx(4000.0 * turn)
        low, high = 1000.0 * turn, 1500.0 * turn
        assert study.campbell(rpm=(1000.0, 1200.0, 1500.0), modes=1).speed[[0, -1]] == pytest.approx([low, high])
        assert study.resonance_crossings(rpm=(1000.0, 1500.0), engine_orders=[5]).values[0]["kind"] == "none"
        with pytest.raises(bd.BdamperError, match=r"engine order 5 between 104\.72 and 157\.08 rad/s"):
            study.run_up(rpm=(1000.0, 1500.0))
