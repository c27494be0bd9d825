"""The typical mistakes of users: each draws one clear line with the thing, what was expected and what was found."""

import re
import warnings
from functools import partial

import numpy as np
import pytest

import bdamper as bd
from bdamper.fatigue.criteria import AISI_1050, Material
from bdamper.fatigue.margin import MarginCurve
from bdamper.fem import ElasticMaterial, Geometry
from bdamper.harmonic_balance.parameters import vary
from bdamper.importers import (
    Sector,
    Units,
    read_body,
    read_matrix,
    read_mode,
    read_nodes,
    read_response,
    read_ring_down,
)
from bdamper.importers.build import build_model
from bdamper.importers.contact_faces import ContactFaces
from bdamper.mistuning import DamperVariation, DiskPeakOptions, Mistuning
from bdamper.util.errors import PlausibilityWarning
from tests.each import each
from tests.plain import plain_study

F = (270.0, 380.0)
TIP = bd.Excitation("tip")
ONE = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
NAN = np.nan


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
    # parts of a study
    "the path of a model for the model": (
        lambda s: bd.Study("disk.h5", TIP, 5),
        "model: .*found str",
    ),
    "nothing that excites": (lambda s: bd.Study(s.model), "Study: .*'excitation'"),
    "a place for an excitation": (
        lambda s: bd.Study(s.model, "tip", 5),
        "excitation: .*found 'tip'",
    ),
    "no engine order": (lambda s: bd.Study(s.model, TIP), "engine_order: give .*65 sectors"),
    "an engine order without modes": (
        lambda s: bd.Study(s.model, TIP, 21),
        "needs nodal diameter 23, the model has",
    ),
    "a place that is not there": (
        lambda s: s.replace(excitation=bd.Excitation("tpi")),
        "found 'tpi'; did you mean tip",
    ),
    "no direction at all": (
        lambda s: bd.Excitation("tip", (0, 0, 0)),
        r"direction: .*found \(0, 0, 0\)",
    ),
    "more modes than there are": (lambda s: s.replace(blade_modes=500), "blade_modes: .*found 500"),
    "friction of a face that is not there": (
        lambda s: s.replace(friction_coefficient={"lft": 0.3}),
        "did you mean left",
    ),
    "an equation that the paper has not": (
        lambda s: s.replace(contact_stiffness="eq7"),
        "contact_stiffness: .*'eq7'",
    ),
    "damping of a damper that is not there": (
        lambda s: lumped(damper_drag=1.0),
        "damper_drag: .*no free body, found 1",
    ),
    "a gap for no face": (lambda s: s.replace(gap={"lft": 1e-6}), r"gap: .*found \['lft'\]"),
    "a speed without a model of it": (lambda s: s.replace(speed=400.0), "speed: .*study.at_speed"),
    # names
    "misspelt setting": (
        lambda s: bd.Study(s.model, TIP, 5, friction_coeficient=0.3),
        "mean friction_coefficient",
    ),
    "part of a name": (
        lambda s: s.replace(friction=0.3),
        "no argument 'friction'; did you mean friction_coefficient",
    ),
    "misspelt part of a setting": (
        lambda s: bd.sweep(s, {"excitation.amplitud": [1.0]}),
        "mean excitation.amplitude",
    ),
    "misspelt argument of a sweep": (
        lambda s: bd.sweep(s, {"preload": [1.0]}, excutor=None),
        "mean executor",
    ),
    "misspelt matrix": (
        lambda s: lumped(contact=[]),
        "lumped: .*no argument 'contact'; did you mean contacts",
    ),
    "an import without contacts": (lambda s: build_model(None), "build_model: .*'contacts'"),
    "misspelt argument of a question": (
        lambda s: s.frequency_response(9.0, F, progres=True),
        "frequency_response: .*did you mean progress",
    ),
    "a word of no relation": (
        lambda s: s.peak(9.0, F, wheel=1),
        "peak: .*no argument 'wheel'; the arguments are preload",
    ),
    "misspelt model": (
        lambda s: bd.reference_model("blade_disk"),
        "found 'blade_disk'; did you mean bladed_disk",
    ),
    "misspelt condition": (lambda s: s.at_speed(400.0, temperatur={}), "did you mean temperature"),
    "misspelt option of the search": (
        lambda s: DiskPeakOptions(climb=3),
        "DiskPeakOptions: .*did you mean climbs",
    ),
    "a sample without a preload": (
        lambda s: bd.mistuned_sample(s, 0.02),
        "mistuned_sample: .*'preload'",
    ),
    # questions
    "a preload where nothing is loaded": (
        lambda s: lumped().frequency_response(5.0, (0.1, 0.3)),
        "preload: expected 0, .*found 5 N",
    ),
    "preloads the wrong way": (lambda s: s.optimal_curve((2e4, 20.0)), "preload"),
    "margin without material": (
        lambda s: s.optimal_curve((20.0, 2e4), 3, quantity="margin"),
        "material: .*found None",
    ),
    "a sweep over nothing": (lambda s: bd.sweep(s, {}), "over: .*found {}"),
    "a sweep without a preload": (
        lambda s: bd.sweep(s, {"friction_coefficient": [0.3]}),
        "preload: .*found neither",
    ),
    "both units of speed": (lambda s: s.at_speed(400.0, rpm=4000.0), "rotor speed: .*found both"),
    "no speed": (lambda s: s.campbell(engine_orders=[5]), "rotor speed: .*rpm=, found none"),
    "no engine order of a crossing": (
        lambda s: s.resonance_crossings((100.0, 900.0)),
        "engine_orders: give at least one",
    ),
    "no preload at rest": (lambda s: s.preload, "preload: .*study.at_speed"),
    # masses, wheels, materials, files
    "a massless freedom": (
        lambda s: lumped(mass=[1.0, 0.0], damping=0.0, stiffness=[1.0, 1.0]),
        "mass: .*definite",
    ),
    "matrices of two sizes": (
        lambda s: lumped(stiffness=[1.0, 1.0]),
        r"stiffness: .*\(1, 1\).*found shape \(2,\)",
    ),
    "a force on a freedom that is not there": (
        lambda s: lumped(forces={3: 1.0}),
        "forces: .*from 0 to 0.*found 3",
    ),
    "a contact without stiffness": (
        lambda s: bd.Contact(0, mu=0.3, preload=1.0),
        "contact: .*kt > 0.*found",
    ),
    "blades of another wheel": (
        lambda s: bd.BladedDisk(s, np.zeros(60)),
        "mistuning: expected 65 blades.*found 60",
    ),
    "a mistuning as a text": (
        lambda s: Mistuning("1 %"),
        "mistuning: .*deviations above -1, found '1 %'",
    ),
    "yield above rupture": (lambda s: Material(3e8, 5e8, 9e8), "yield_strength: .*found 9e"),
    "a curve of margins without a value": (
        lambda s: empty_margins().least,
        "no margin found at any of 0 values",
    ),
    "a file that is not there": (
        lambda s: bd.load_model("nowhere.h5"),
        "there is no model file 'nowhere.h5'",
    ),
    "a folder for a file": (
        lambda s: bd.load("."),
        "expected a file written by bdamper, found a folder",
    ),
    "a folder that is not there": (
        lambda s: s.save("nowhere/x.h5"),
        "expected a folder that exists, found",
    ),
    "an unknown ending": (
        lambda s: read_body("blade.xyz"),
        "expected a name that ends in .*found '.xyz'",
    ),
    "no path": (
        lambda s: bd.save_model(s.model),
        "save_model: missing a required argument: 'path'",
    ),
    "masses that turn": (
        lambda s: lumped().at_speed(400.0),
        "rotor speed: .*a model in which nothing depends on speed",
    ),
    "a disk of masses": (lambda s: bd.BladedDisk(lumped()), "a bladed disk needs a local basis"),
    "a stress of masses": (
        lambda s: lumped().stress(None),
        "stress: expected a model with stress sets, found none",
    ),
    "no force": (
        lambda s: s.replace(excitation=bd.Excitation("tip", amplitude=0.0)).peak(9.0, F),
        "excitation: .*found 0 N at 'tip'",
    ),
    "a peak of nothing": (
        lambda s: s.peak(),
        "peak: missing a required argument: 'preload'; .* are preload$",
    ),
    "a motion of nothing": (lambda s: s.motion_in_time(), "motion_in_time: missing .* are curve$"),
    "misspelt history": (lambda s: s.static(9.0, histroy=(1.0,)), "static: .*did you mean history"),
    "a crossing of no diameter": (
        lambda s: s.resonance_crossings((300.0, 600.0), [99]),
        "needs nodal diameter 31",
    ),
    "a sweep of texts": (
        lambda s: bd.sweep(s, {"friction_coefficient": ["a"]}, preload=9.0),
        "coefficient: .*found 'a'",
    ),
    "a study to differ from": (lambda s: s.diff(3), "other: expected a study or a result, found 3"),
    "radii the wrong way": (lambda s: Geometry(bore_radius=0.5), "radii: .*found"),
    "a contact named twice": (
        lambda s: build_model(None, contacts=[ContactFaces("a", "x", "y"), None]),
        "blade: expected an FEBody.*found None",
    ),
}


VALUES = {
    "replace": (lambda s: s.replace, {
        "friction_coefficient": ["0.3", NAN, [0.3, 0.3], True, -0.3],
        "contact_stiffness": [-1e7, NAN, [1e7] * 4], "damping_ratio": [-0.01, 1.0, "2 %"], "damper_drag": [-1.0],
        "engine_order": [5.5, [5], -5, "5"], "harmonics": [0, -3, "3", (1, 1, 3), (3, 5), 200], "blade_modes": [0, 5.5],
        "damper_modes": [99], "rigid_modes": ["TX", ("TXX",)], "contact_points": [0, 100],
        "gap": [1e-5, {"left": [0.0] * 3}],
        "load_history": [(), (-1.0,)], "bias": ["no"], "separation": [1], "residual_slip_std": [-1e-6],
        "load_per_preload": [2.0, {"damper": -1.0}, {"dampr": 1.0}], "constant_loads": [{"blade": 1.0}],
        "response": ["tip"], "friction_law": [3, "coulomb"],
    }),
    "Excitation": (lambda s: partial(bd.Excitation, "tip"), {
        "direction": [(1, 0), (NAN, 0, 1), "up", 1], "amplitude": [NAN, 1j, "1 N", -1.0], "phase": [90.0, NAN],
        "engine_order": ["5"], "beside": [3],
    }),
    "peak": (lambda s: partial(s.peak, preload=9.0), {
        "preload": [NAN, np.inf, [1.0, 2.0], None, "2 kN", -1.0, F],
        "frequency": [F[::-1], (1.0, 2.0, 3.0), "270-380", (0.0, 300.0), (NAN, 300.0), {270.0, 380.0}, 300.0],
        "mode": [0, 99, 1.5, "1"], "options": [bd.ContinuationOptions(), {"tolerance": 1e-9}],
    }),
    "frequency_response": (lambda s: partial(s.frequency_response, 9.0, F), {"stability": ["yes"], "progress": [1]}),
    "optimal_curve": (lambda s: partial(s.optimal_curve, (20.0, 2e4), n=3), {
        "n": [1, -3, 2.5], "check": ["yes"], "quantity": ["stress"], "executor": [4],
    }),
    "nonlinear_mode": (lambda s: partial(s.nonlinear_mode, 9.0, 1), {"amplitude": [(1e-4, 1e-6), (-1e-6, 1e-6)]}),
    "flutter": (lambda s: partial(s.flutter, 9.0), {"aerodynamic_damping": ["-0.01", NAN]}),
    "frequency_sweep": (lambda s: partial(s.frequency_sweep, 9.0, F), {"rate": [-1.0]}),
    "margin": (lambda s: partial(s.margin, None, AISI_1050), {"criterion": ["mises"], "line": ["goodmann"], "on": [1]}),
    "crossings": (lambda s: partial(s.resonance_crossings, (300.0, 600.0), [5]), {
        "mode": [77], "damper_mass_factor": [[0.0]], "margin": [AISI_1050],
    }),
    "sweep": (lambda s: partial(bd.sweep, s, {"preload": [9.0]}), {
        "mode": [77], "evaluate": ["peak"], "combine": ["all"], "executor": ["threads"],
    }),
    "compare": (lambda s: partial(bd.compare, {"a": s}), {"question": [None, 3]}),
    "fit": (lambda s: partial(bd.fit, s, vary={"friction_coefficient": (0.1, 0.5)}), {"data": [[], 3, [3]]}),
    "lumped": (lambda s: lumped, {
        "mass": ["1", -1.0, 0.0, NAN], "stiffness": [[[2.0, 1.0], [0.0, 2.0]], -1.0], "forces": [{}, "1 N"],
        "contacts": [ONE, [3]],
    }),
    "Contact": (lambda s: partial(bd.Contact, 0, kt=1.0), {"mu": [-1.0, "0.3"], "gap": [NAN]}),
    "ContinuationOptions": (lambda s: bd.ContinuationOptions, {"budget": [-1], "step": [0.0], "tolerance": [1.0]}),
    "Material": (lambda s: partial(Material, ultimate_strength=9e8, yield_strength=8e8), {
        "endurance_limit": ["300 MPa", NAN, -1.0, 1e9],
    }),
    "ElasticMaterial": (lambda s: ElasticMaterial, {
        "youngs_modulus": ["210 GPa", -1.0], "poisson_ratio": [30.0, 0.5], "density": [0.0],
    }),
    "Geometry": (lambda s: Geometry, {"face_angle": [60.0], "n_blades": [2.5], "twist": [30.0], "bore_radius": [-1.0]}),
    "face_gap": (lambda s: partial(bd.face_gap, s.model.interfaces["left"]), {"angle": [1.0], "interface": []}),
    "Mistuning": (lambda s: partial(Mistuning.random, 65, 0.01), {"seed": ["a"]}),
    "DamperVariation": (lambda s: partial(DamperVariation.of, 65), {"missing": [[99], "2"], "mass": [-1.0, [1.0] * 3]}),
    "load": (lambda s: bd.load, {"path": [3, None]}),
    "save": (lambda s: s.save, {"path": [3]}),
}  # fmt: skip
"""Bad values of arguments, by the function that takes them."""
REFUSED |= {
    f"{of} {name} {k}": (
        lambda s, make=make, name=name, value=value: make(s)(**{name: value}),
        f"{name}.*found ",
    )
    for of, (make, values) in VALUES.items()
    for name, bad in values.items()
    for k, value in enumerate(bad)
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
    assert (
        ("expected" in text and "found" in text)
        or " argument" in text
        or text.startswith(
            ("no margin found", "there is no model file", "body ", "a bladed disk needs")
        )
        # a plain sentence on a value that is missing, forbidden or combined
        or re.search(
            r"\b(give|needs?|missing|not allowed|cannot|has no|have no|must|belongs? to|lacks?)\b",
            text,
        )
    )


def failing(ask):
    with pytest.raises(bd.BdamperError, match=r"expected .*, found|: mode 1 has no"):
        ask()


DOUBTED = {
    "rpm for rad/s": (
        lambda s: s.at_speed(4500),
        r"rotor speed: .* 1292 rad/s.*found 4500; possibly given in revolutions .* rpm=4500",
    ),
    "rpm of a diagram": (
        lambda s: s.campbell((2000, 5000, 7000), modes=1),
        r"found 7000; .*rev.* rpm=\(2000, 5",
    ),
    "rpm of a run-up": (
        lambda s: failing(lambda: s.run_up((7000, 9500))),
        "rotor speed: .*found 9500; possibly given in revolutions",
    ),
    "a mass in grams": (
        lambda s: vary(s, {"damper_inertia_factor": 1e3}),
        "mass of 'damper': .*found 69 kg; possibly given in grams",
    ),
    "strength in MPa": (
        lambda s: Material(300.0, 1200.0, 900.0),
        "ultimate_strength: .*found 1200 Pa; .*1 MPa is",
    ),
    "strength converted twice": (
        lambda s: Material(3e8, 9e14, 8e8),
        "ultimate_strength: .*found 9e.14 Pa; possibly converted from MPa to Pa twice",
    ),
    "30 for 0.3": (
        lambda s: s.replace(friction_coefficient=30.0),
        "friction_coefficient: .*found 30; possibly given in per cent",
    ),
    "30 for 0.3 of a contact": (
        lambda s: bd.Contact(0, kt=1.0, mu=30.0, preload=1.0),
        "mu: .*found 30; possibly given in per cent",
    ),
    "N/mm": (
        lambda s: s.replace(contact_stiffness=2e4),
        "contact_stiffness: .*found 2e.04 N/m; possibly given in N/mm",
    ),
    "damping of 30 %": (
        lambda s: s.replace(damping_ratio=0.3),
        "damping_ratio: .*found 0.3 .*possibly given in per cent",
    ),
    "a number of vanes": (
        lambda s: s.replace(engine_order=60),
        "engine_order: plausible 1 to 32, found 60; .*vanes",
    ),
    "newtons of a history": (
        lambda s: s.replace(load_history=(2000.0, 1.0)),
        "load_history: .*possibly given in newtons",
    ),
    "newtons of a share": (
        lambda s: s.replace(load_per_preload={"damper": 2e3}),
        "load_per_preload .*newtons",
    ),
    "flow of another diameter": (
        lambda s: s.replace(aerodynamic_damping={30: 0.01}),
        "aerodynamic_damping: .*found at",
    ),
    "giganewtons": (
        lambda s: s.replace(excitation=bd.Excitation("tip", amplitude=1e9)),
        "amplitude of 'tip': .*1e.09",
    ),
    "a preload of 0": (
        lambda s: s.frequency_response(0.0, (300.0, 301.0)),
        "preload: plausible above 0 N, found 0",
    ),
    "a preload in kN": (
        lambda s: s.frequency_response(
            2e-3, (300.0, 301.0), options=bd.ContinuationOptions(budget=20)
        ),
        "preload: .*found 0.002 N; possibly given in kN",
    ),
    "no resonance": (
        lambda s: s.frequency_response(2e3, (1.0, 2.0)),
        r"frequency: .*, such as .* found \(1, 2\), far",
    ),
    "kHz": (
        lambda s: s.peak(2e3, (0.27, 0.38)),
        r"frequency: .*found \(0.27, 0.38\), far from .* kHz",
    ),
    "masses without a resonance": (
        lambda s: lumped().free((10.0, 20.0)),
        r"frequency: .*found \(10, 20\), far from every",
    ),
    "millimetres of a mode": (
        lambda s: s.nonlinear_mode(2e3, 1, (1e-6, 1e3)),
        "amplitude: .*found 1000 m; .*millim",
    ),
    "modulus in GPa": (
        lambda s: ElasticMaterial(210.0),
        "youngs_modulus: .*found 210 Pa; possibly given in MPa or GPa",
    ),
    "density in g/cm3": (
        lambda s: ElasticMaterial(2.1e11, 0.3, 7.85),
        "density: .*found 7.85 kg/m3; .*g/cm3 or t/mm3",
    ),
    "millimetres of a disk": (
        lambda s: Geometry(rim_radius=400.0, ridge_radius=441.5),
        "_radius: .*millimetres or",
    ),
    "modulus of a sector in GPa": (
        lambda s: Sector(65, elasticity=(210.0, 0.3)),
        "elasticity: .*possibly given in GPa",
    ),
    "units of an import": (
        lambda s: Units(1000.0),
        "length: .*found 1000 m; possibly the inverse",
    ),
    "crowning in micrometres": (
        lambda s: bd.face_gap(s.model.interfaces["left"], crowning=20.0),
        "crowning: .*found 20 m; possibly given in millimetres or microm",
    ),
    "grams of a damper": (
        lambda s: DamperVariation.of(65, mass=69.0),
        "mass: .*found 69 .*possibly given in grams",
    ),
    "Hz of a deviation": (
        lambda s: Mistuning(np.full(65, 5.0)),
        "deviation: .*found 5 .*Hz",
    ),
    "rad/s for Hz": (
        lambda s: s.free((1700.0, 2200.0)),
        r"frequency: .*found \(1700, 2200\) .*radians per second",
    ),
}


@each("mistake", DOUBTED)
def test_an_unlikely_unit_is_named(study, mistake):
    ask, words = DOUBTED[mistake]
    with pytest.warns(PlausibilityWarning, match=words) as caught:
        ask(study)
    doubts = {
        (str(w.message), w.filename) for w in caught if issubclass(w.category, PlausibilityWarning)
    }
    assert len(doubts) == len({text.partition(":")[0] for text, _ in doubts}), (
        "one for each, which Python shows once"
    )
    assert all("\n" not in text and place == __file__ for text, place in doubts)


NAMES = {
    "study": (
        lambda s: s.frequncy_response,
        "Study has no attribute 'frequncy_response'; did you mean frequency_resp",
    ),
    "settings": (lambda s: s.settings.frequenzy, "Settings has no attribute 'frequenzy'$"),
    "options": (
        lambda s: bd.PeakOptions().tolerence,
        "PeakOptions has no attribute 'tolerence'; did you mean tolerance",
    ),
    "model": (lambda s: s.model.blades, "Model has no attribute 'blades'; did you mean n_blades"),
    "package": (lambda s: bd.swep, "bdamper has no attribute 'swep'; did you mean sweep"),
}


@each("of", NAMES)
def test_a_misspelt_attribute_is_answered(study, of):
    ask, words = NAMES[of]
    with pytest.raises(AttributeError, match=words):
        ask(study)


FILES = {
    "x.h5": bd.load, "model.h5": bd.load_model, "study.h5": bd.load_study, "x.inp": read_body, "x.cdb": read_body,
    "x.frd": read_body, "x.mtx": read_matrix, "x.txt": read_nodes, "x.csv": read_response, "mode.csv": read_mode,
    "ring.csv": read_ring_down,
}  # fmt: skip


@each("name", FILES)
def test_missing_and_empty_files_are_named(tmp_path, name):
    path = tmp_path / name
    with pytest.raises(FileNotFoundError, match=rf"there is no (model )?file '.*{name}'"):
        FILES[name](path)
    path.write_bytes(b"")
    with pytest.raises(bd.BdamperError, match=rf"{name}.*: expected .*, found ") as caught:
        FILES[name](path)
    assert "\n" not in str(caught.value)


def test_results_of_another_study_and_curves_without_their_peak(study):
    curve, other = (
        study.frequency_response(2000.0, (340.0, 350.0)),
        study.replace(friction_coefficient=0.3),
    )
    for ask, words in (
        (
            lambda: other.hysteresis(curve),
            "curve: expected a result of this study, found .*different settings",
        ),
        (lambda: study.hysteresis(curve, index=10**6), "index of a point: .*found 1000000"),
        (lambda: study.response_at(curve, "tpi"), "found 'tpi'; did you mean tip"),
        (
            lambda: study.time_response(curve),
            "expected a curve with a peak, found its highest amplitude at its end",
        ),
        (lambda: study.stress(curve, sets="rot"), "stress set: .*found 'rot'"),
        (lambda: study.gauge_stress(curve, "rot 1", "radial"), "gauge: .*found 'rot 1'"),
    ):
        with pytest.raises(bd.SettingError, match=words):
            ask()
    for ask in (study.stress, partial(study.margin, material=AISI_1050)):
        with pytest.warns(
            PlausibilityWarning,
            match="result: .*peak inside .*, found the highest response at its end",
        ):
            ask(curve)
    with pytest.warns(
        PlausibilityWarning, match="frequency: plausible 340 to 350 Hz, within the curve, found 360"
    ):
        study.motion_in_time(curve, frequency=360.0, periods=16)


def test_at_least_150_mistakes_are_listed():
    assert len(REFUSED) + len(DOUBTED) + len(NAMES) + 2 * len(FILES) >= 150


def test_speeds_in_revolutions_per_minute(study):
    turn = np.pi / 30.0
    with warnings.catch_warnings():
        warnings.simplefilter("error", PlausibilityWarning)
        assert study.at_speed(rpm=4000.0).settings.speed == pytest.approx(4000.0 * turn)
        low, high = 1000.0 * turn, 1500.0 * turn
        assert study.campbell(rpm=(1000.0, 1200.0, 1500.0), modes=1).speed[
            [0, -1]
        ] == pytest.approx([low, high])
        assert (
            study.resonance_crossings(rpm=(1000.0, 1500.0), engine_orders=[5]).values[0]["kind"]
            == "none"
        )
        with pytest.raises(
            bd.BdamperError, match=r"mode 1 has no maximum: .* wider than 1000 to 1500 rpm"
        ):
            study.run_up(rpm=(1000.0, 1500.0))
