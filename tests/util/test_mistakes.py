"""The typical mistakes of users: each draws one clear line with the thing, what was expected and what was found."""

import re
import warnings
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

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


class As(NamedTuple):
    """Bad value, and how the message shows it."""

    value: Any
    found: str


REFUSED = {
    # parts of a study
    "the path of a model for the model": (
        lambda s: bd.Study("disk.h5", TIP, 5),
        "model: expected a Model, found str",
    ),
    "nothing that excites": (
        lambda s: bd.Study(s.model),
        "Study: missing a required argument: 'excitation'; the required arguments are model, "
        "excitation",
    ),
    "a place for an excitation": (
        lambda s: bd.Study(s.model, "tip", 5),
        "excitation: expected an Excitation, found 'tip'",
    ),
    "no engine order": (
        lambda s: bd.Study(s.model, TIP),
        "engine_order: give the engine order of the excitation, because the model has 65 sectors",
    ),
    "an engine order without modes": (
        lambda s: bd.Study(s.model, TIP, 21),
        "body 'blade': harmonic 2 of engine order 21 needs nodal diameter 23, the model has "
        "[0, 3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 15, 16, 18, 20, 21, 24, 25, 27, 30]; set "
        "engine_order, or use fewer harmonics, or fundamental_modes_only=True to use the "
        "modes of the first harmonic for all",
    ),
    "a place that is not there": (
        lambda s: s.replace(excitation=bd.Excitation("tpi")),
        "excitation location: expected one of ('damper', 'platform', 'tip'), found 'tpi'; "
        "did you mean tip?",
    ),
    "no direction at all": (
        lambda s: bd.Excitation("tip", (0, 0, 0)),
        "excitation direction: expected 3 finite numbers, not all zero, found (0, 0, 0)",
    ),
    "more modes than there are": (
        lambda s: s.replace(blade_modes=500),
        "blade_modes: expected a whole number from 1 to 40, found 500",
    ),
    "friction of a face that is not there": (
        lambda s: s.replace(friction_coefficient={"lft": 0.3}),
        "friction_coefficient: expected interfaces out of ['left', 'right', 'front', "
        "'back'], found ['lft']; did you mean left?",
    ),
    "an equation that the paper has not": (
        lambda s: s.replace(contact_stiffness="eq7"),
        "contact_stiffness: expected one of ('residual_modes', 'unit_traction', "
        "'cigeroglu2009', 'model'), one number in N/m, PerArea(...), ResidualModes(...) or a "
        "mapping of interface names to values, found 'eq7'",
    ),
    "damping of a damper that is not there": (
        lambda s: lumped(damper_drag=1.0),
        "damper_drag: expected 0, since the model has no free body, found 1.0",
    ),
    "a gap for no face": (
        lambda s: s.replace(gap={"lft": 1e-6}),
        "gap: expected interfaces out of ['left', 'right', 'front', 'back'], found ['lft']; "
        "did you mean left?",
    ),
    "a speed without a model of it": (
        lambda s: s.replace(speed=400.0),
        "speed: expected a model at 400 rad/s, as study.at_speed makes it, found one at 0 "
        "(stress stiffening and spin softening by squared speed)",
    ),
    # names
    "misspelt setting": (
        lambda s: bd.Study(s.model, TIP, 5, friction_coeficient=0.3),
        "Study: there is no argument 'friction_coeficient'; did you mean friction_coefficient?",
    ),
    "part of a name": (
        lambda s: s.replace(friction=0.3),
        "Study: there is no argument 'friction'; did you mean friction_coefficient or "
        "friction_law or friction_coefficient.left?",
    ),
    "argument of a method": (
        lambda s: bd.Study(s.model, TIP, 5, mode=2),
        "Study: there is no argument 'mode'; it is an argument of methods, for example "
        "study.peak(preload, mode=2)",
    ),
    "argument of a method as a setting": (
        lambda s: s.replace(frequency=F),
        "Study: there is no argument 'frequency'; it is an argument of methods, for example "
        "study.peak(preload, (low, high))",
    ),
    "misspelt part of a setting": (
        lambda s: bd.sweep(s, {"excitation.amplitud": [1.0]}),
        "setting to vary: expected one of 56 names, found 'excitation.amplitud'; did you "
        "mean excitation.amplitude?",
    ),
    "misspelt argument of a sweep": (
        lambda s: bd.sweep(s, {"preload": [1.0]}, excutor=None),
        "sweep: there is no argument 'excutor'; did you mean executor?",
    ),
    "misspelt matrix": (
        lambda s: lumped(contact=[]),
        "lumped: there is no argument 'contact'; did you mean contacts or contact_stiffness "
        "or contact_forces?",
    ),
    "an import without contacts": (
        lambda s: build_model(None),
        "build_model: missing a required argument: 'contacts'; the required arguments are "
        "blade, contacts",
    ),
    "misspelt argument of a question": (
        lambda s: s.frequency_response(9.0, F, progres=True),
        "Study.frequency_response: there is no argument 'progres'; did you mean progress?",
    ),
    "a word of no relation": (
        lambda s: s.peak(9.0, F, wheel=1),
        "Study.peak: there is no argument 'wheel'; the arguments are preload, frequency, "
        "mode, options, errors, progress",
    ),
    "misspelt model": (
        lambda s: bd.reference_model("blade_disk"),
        "reference model: expected one of ('blade_to_ground', 'bladed_disk', 'paper_disk', "
        "'shrouded_blade', 'test_rig', 'turbine_blade'), found 'blade_disk'; did you mean "
        "bladed_disk?",
    ),
    "misspelt condition": (
        lambda s: s.at_speed(400.0, temperatur={}),
        "at_speed: there is no argument 'temperatur'; did you mean temperature?",
    ),
    "misspelt option of the search": (
        lambda s: DiskPeakOptions(climb=3),
        "DiskPeakOptions: there is no argument 'climb'; did you mean climbs?",
    ),
    "a sample without a preload": (
        lambda s: bd.mistuned_sample(s, 0.02),
        "mistuned_sample: missing a required argument: 'preload'; the required arguments are "
        "study, standard_deviation, preload",
    ),
    # questions
    "a preload where nothing is loaded": (
        lambda s: lumped().frequency_response(5.0, (0.1, 0.3)),
        "preload: expected 0, since no body of the model carries a load, found 5 N",
    ),
    "preloads the wrong way": (
        lambda s: s.optimal_curve((2e4, 20.0)),
        "preload: expected (low, high) or a longer sequence of increasing values, found "
        "(20000.0, 20.0)",
    ),
    "two numbers instead of a pair": (
        lambda s: s.optimal_curve(30, 1000),
        "preload: expected (low, high) or a longer sequence of increasing values, for example "
        "optimal_curve((30, 1000)), found 30",
    ),
    "margin without material": (
        lambda s: s.optimal_curve((20.0, 2e4), 3, quantity="margin"),
        "material: expected a Material, since quantity is the margin, found None",
    ),
    "a sweep over nothing": (
        lambda s: bd.sweep(s, {}),
        "over: expected a mapping of setting to values, found {}",
    ),
    "a sweep without a preload": (
        lambda s: bd.sweep(s, {"friction_coefficient": [0.3]}),
        'preload: expected a number, or "preload" among the settings of the sweep, found neither',
    ),
    "both units of speed": (
        lambda s: s.at_speed(400.0, rpm=4000.0),
        "rotor speed: expected a value in rad/s or rpm=, found both",
    ),
    "no speed": (
        lambda s: s.campbell(engine_orders=[5]),
        "rotor speed: expected a value in rad/s or rpm=, found none",
    ),
    "no engine order of a crossing": (
        lambda s: s.resonance_crossings((100.0, 900.0)),
        "engine_orders: give at least one engine order",
    ),
    "no preload at rest": (
        lambda s: s.preload,
        "preload: this study has no rotor speed; use study.at_speed(omega).preload",
    ),
    # masses, wheels, materials, files
    "a massless freedom": (
        lambda s: lumped(mass=[1.0, 0.0], damping=0.0, stiffness=[1.0, 1.0]),
        "mass: expected a positive definite matrix with eigenvalues above 1e-09 of its "
        "largest entry, 1 kg, found an eigenvalue of 0 kg",
    ),
    "matrices of two sizes": (
        lambda s: lumped(stiffness=[1.0, 1.0]),
        "stiffness: expected finite numbers, a diagonal or a matrix (1, 1) as the mass, "
        "found shape (2,)",
    ),
    "a matrix that is not symmetric": (
        lambda s: lumped(mass=[1.0, 1.0], damping=0.0, stiffness=[[2.0, 1.0], [0.0, 2.0]]),
        "stiffness: expected a symmetric matrix, found a difference of 1",
    ),
    "a force on a freedom that is not there": (
        lambda s: lumped(forces={3: 1.0}),
        "forces: expected a whole number from 0 to 0, found 3",
    ),
    "a contact without stiffness": (
        lambda s: bd.Contact(0, mu=0.3, preload=1.0),
        "contact: expected tangential, kt > 0 and mu > 0 together, found tangential=0, kt=0, "
        "mu=0.3",
    ),
    "blades of another wheel": (
        lambda s: bd.BladedDisk(s, np.zeros(60)),
        "mistuning: expected 65 blades, as in the model, found 60",
    ),
    "a mistuning as a text": (
        lambda s: Mistuning("1 %"),
        "mistuning: expected (n_blades,) or (n_blades, n_modes) finite frequency deviations "
        "above -1, found '1 %'",
    ),
    "yield above rupture": (
        lambda s: Material(3e8, 5e8, 9e8),
        "yield_strength: expected at most the ultimate strength, 5e+08 Pa, found 9e+08",
    ),
    "a curve of margins without a value": (
        lambda s: empty_margins().least,
        "no margin found at any of 0 values of preload",
    ),
    "a file that is not there": (
        lambda s: bd.load_model("nowhere.h5"),
        "there is no model file 'nowhere.h5'",
    ),
    "a folder for a file": (
        lambda s: bd.load("."),
        ".: expected a file written by bdamper, found a folder",
    ),
    "a folder that is not there": (
        lambda s: s.save("nowhere/x.h5"),
        f"nowhere/x.h5: expected an existing folder, found no '{Path.cwd()}/nowhere'",
    ),
    "an unknown ending": (
        lambda s: read_body("blade.xyz"),
        "blade.xyz: expected a file name with one of the extensions ['.bdf', '.cdb', '.dat', '.frd', "
        "'.inp', '.nas', '.rst'], found '.xyz'",
    ),
    "no path": (
        lambda s: bd.save_model(s.model),
        "save_model: missing a required argument: 'path'; the required arguments are model, path",
    ),
    "masses that turn": (
        lambda s: lumped().at_speed(400.0),
        "rotor speed: expected a model with a loaded body, speed-dependent modes or displacement "
        "due to rotation, or conditions, found a model in which nothing depends on speed",
    ),
    "a disk of masses": (
        lambda s: bd.BladedDisk(lumped()),
        "a bladed disk needs a local basis of blade and disk, and no body of the model has "
        "one; create it with bladed_disk(wheel=LocalSizes()) of bdamper.fem, or with "
        "build_model(sector=Sector(blade_nodes=...))",
    ),
    "a stress of masses": (
        lambda s: lumped().stress(None),
        "stress: expected a model with stress sets, found none (docs/speed.md explains how "
        "to add them)",
    ),
    "no force": (
        lambda s: s.replace(excitation=bd.Excitation("tip", amplitude=0.0)).peak(9.0, F),
        "excitation: expected a force that works on the modes of harmonic 1, with modal "
        "forces from 1e-100 to 1e+100, found 0 N at 'tip', tangential",
    ),
    "a peak of nothing": (
        lambda s: s.peak(),
        "Study.peak: missing a required argument: 'preload'; the required argument is preload",
    ),
    "a motion of nothing": (
        lambda s: s.motion_in_time(),
        "motion_in_time: missing a required argument: 'curve'; the required argument is curve",
    ),
    "misspelt history": (
        lambda s: s.static(9.0, histroy=(1.0,)),
        "static: there is no argument 'histroy'; did you mean history?",
    ),
    "a crossing of no diameter": (
        lambda s: s.resonance_crossings((300.0, 600.0), [99]),
        "body 'blade': harmonic 1 of engine order 99 needs nodal diameter 31, the model has "
        "[0, 3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 15, 16, 18, 20, 21, 24, 25, 27, 30]; set "
        "engine_order, or use fewer harmonics, or fundamental_modes_only=True to use the "
        "modes of the first harmonic for all",
    ),
    "a sweep of texts": (
        lambda s: bd.sweep(s, {"friction_coefficient": ["a"]}, preload=9.0),
        "friction_coefficient: expected a finite number >= 0, found 'a'",
    ),
    "a study to differ from": (lambda s: s.diff(3), "other: expected a study or a result, found 3"),
    "radii the wrong way": (
        lambda s: Geometry(bore_radius=0.5),
        "radii: expected bore_radius < rim_radius < ridge_radius, found (0.5, 0.4, 0.4415)",
    ),
    "a contact named twice": (
        lambda s: build_model(None, contacts=[ContactFaces("a", "x", "y"), None]),
        "blade: expected an FEBody, as read_arrays returns it, found None",
    ),
}


VALUES = {
    "replace": (
        lambda s: s.replace,
        {
            "friction_coefficient": {
                "friction_coefficient: expected a finite number >= 0": [
                    "0.3",
                    NAN,
                    [0.3, 0.3],
                    True,
                    -0.3,
                ],
            },
            "contact_stiffness": {
                "contact_stiffness: expected a finite number >= 0 N/m": [-1e7, NAN],
                (
                    "contact_stiffness: expected one of ('residual_modes', 'unit_traction', "
                    "'cigeroglu2009', 'model'), one number in N/m, PerArea(...), "
                    "ResidualModes(...) or a mapping of interface names to values"
                ): [[1e7] * 4],
            },
            "damping_ratio": {
                "damping_ratio: expected a finite number >= 0 and < 1": [-0.01, 1.0, "2 %"],
            },
            "damper_drag": {
                "damper_drag: expected a finite number >= 0 N s/m": [-1.0],
            },
            "engine_order": {
                "engine_order: expected a whole number >= 0": [5.5, [5], -5, "5"],
            },
            "harmonics": {
                (
                    "harmonics: expected a whole number from 1 to 64, or such numbers with 1 "
                    "among them"
                ): [0, -3, "3", (1, 1, 3), (3, 5), 200],
            },
            "blade_modes": {
                "blade_modes: expected a whole number >= 1": [0, 5.5],
            },
            "damper_modes": {
                "damper_modes: expected 0 to 10 (body 'damper')": [99],
            },
            "rigid_modes": {
                (
                    "rigid_modes: expected a sequence of ('TX', 'TY', 'TZ', 'RX', 'RY', 'RZ'), "
                    "each at most once"
                ): ["TX"],
                "rigid_modes: expected one of ('TX', 'TY', 'TZ', 'RX', 'RY', 'RZ')": [
                    As(("TXX",), "'TXX'; did you mean TX?")
                ],
            },
            "contact_points": {
                "contact_points: expected a whole number >= 1": [0],
                (
                    "contact_points: expected at most 9, the number of points on a friction face "
                    "of the model, or None for all of them"
                ): [100],
            },
            "gap": {
                (
                    "gap: expected a mapping of interfaces out of ['left', 'right', 'front', "
                    "'back'] to values"
                ): [1e-5],
                "gap of 'left': expected one or 9 finite numbers": [
                    As({"left": [0.0] * 3}, "[0.0, 0.0, 0.0]")
                ],
            },
            "load_history": {
                (
                    "load_history, load factors: expected a sequence of one or more finite "
                    "numbers >= 0"
                ): [(), (-1.0,)],
            },
            "bias": {
                "bias: expected True or False": ["no"],
            },
            "separation": {
                "separation: expected True or False": [1],
            },
            "residual_slip_std": {
                "residual_slip_std: expected a finite number >= 0 m": [-1e-6],
            },
            "load_per_preload": {
                (
                    "load_per_preload: expected a mapping of names of loaded bodies, or of "
                    "friction interfaces between constrained bodies, out of ['damper'] to values"
                ): [2.0],
                "load_per_preload of 'damper': expected a finite number >= 0": [
                    As({"damper": -1.0}, "-1.0")
                ],
                (
                    "load_per_preload: expected names of loaded bodies, or of friction "
                    "interfaces between constrained bodies, out of ['damper']"
                ): [As({"dampr": 1.0}, "['dampr']; did you mean damper?")],
            },
            "constant_loads": {
                (
                    "constant_loads: expected names of loaded bodies, or of friction interfaces "
                    "between constrained bodies, out of ['damper']"
                ): [As({"blade": 1.0}, "['blade']")],
            },
            "response": {
                "response: expected a Response": ["tip"],
            },
            "friction_law": {
                (
                    "friction_law: expected one of ('uncoupled', 'coupled', 'bonded'), a "
                    "ContactLaw or a mapping of interface names to these"
                ): [3, "coulomb"],
            },
        },
    ),
    "Excitation": (
        lambda s: partial(bd.Excitation, "tip"),
        {
            "direction": {
                "excitation direction: expected 3 finite numbers": [(1, 0), (NAN, 0, 1), 1],
                (
                    "excitation direction: expected one of ('tangential', 'radial', 'axial') or "
                    "three numbers"
                ): ["up"],
            },
            "amplitude": {
                "excitation amplitude: expected a finite number >= 0 N": [NAN, 1j, "1 N", -1.0],
            },
            "phase": {
                "excitation phase: expected a phase in radians from -2 pi to 2 pi": [
                    As(90.0, "90.0; possibly given in degrees: use np.deg2rad(90)")
                ],
                "excitation phase: expected a finite number": [NAN],
            },
            "engine_order": {
                "excitation engine_order: expected a whole number >= 0": ["5"],
            },
            "beside": {
                "excitation beside: expected a sequence of Excitation": [3],
            },
        },
    ),
    "peak": (
        lambda s: partial(s.peak, preload=9.0),
        {
            "preload": {
                "preload: expected a finite number >= 0 N": [
                    NAN,
                    np.inf,
                    [1.0, 2.0],
                    None,
                    "2 kN",
                    -1.0,
                    F,
                ],
            },
            "frequency": {
                "frequency: expected (low, high) in Hz with 0 < low < high": [
                    F[::-1],
                    (1.0, 2.0, 3.0),
                    "270-380",
                    (0.0, 300.0),
                    (NAN, 300.0),
                    As({270.0, 380.0}, "a set"),
                    300.0,
                ],
            },
            "mode": {
                "mode: expected a whole number >= 1": [0, 1.5, "1"],
                "mode: expected 1 to 10 (283.08, 688.9, 1125.4, ... Hz without contact)": [99],
            },
            "options": {
                "options: expected a PeakOptions": [
                    As(bd.ContinuationOptions(), "a ContinuationOptions"),
                    {"tolerance": 1e-9},
                ],
            },
        },
    ),
    "frequency_response": (
        lambda s: partial(s.frequency_response, 9.0, F),
        {
            "stability": {
                "stability: expected True or False": ["yes"],
            },
            "progress": {
                "progress: expected True or False": [1],
            },
        },
    ),
    "optimal_curve": (
        lambda s: partial(s.optimal_curve, (20.0, 2e4), n=3),
        {
            "n": {
                "n: expected a whole number >= 2": [1, -3, 2.5],
            },
            "check": {
                "check: expected one of ('time', 'harmonics', 'neighbours', 'range', False)": [
                    "yes"
                ],
            },
            "quantity": {
                "quantity: expected one of ('amplitude', 'margin')": ["stress"],
            },
            "executor": {
                (
                    "executor: expected an executor with a method submit, such as those of "
                    "concurrent.futures"
                ): [4],
            },
        },
    ),
    "nonlinear_mode": (
        lambda s: partial(s.nonlinear_mode, 9.0, 1),
        {
            "amplitude": {
                "amplitude: expected (low, high) in m with 0 < low < high": [
                    (1e-4, 1e-6),
                    (-1e-6, 1e-6),
                ],
            },
        },
    ),
    "flutter": (
        lambda s: partial(s.flutter, 9.0),
        {
            "aerodynamic_damping": {
                "aerodynamic_damping at nodal diameter 5: expected a finite number": ["-0.01", NAN],
            },
        },
    ),
    "frequency_sweep": (
        lambda s: partial(s.frequency_sweep, 9.0, F),
        {
            "rate": {
                "rate: expected a finite number > 0 Hz/s": [-1.0],
            },
        },
    ),
    "margin": (
        lambda s: partial(s.margin, None, AISI_1050),
        {
            "criterion": {
                "criterion: expected one of ('von_mises', 'findley')": [
                    As("mises", "'mises'; did you mean von_mises?")
                ],
            },
            "line": {
                "line: expected one of ('goodman', 'gerber', 'soderberg', 'table')": [
                    As("goodmann", "'goodmann'; did you mean goodman?")
                ],
            },
            "on": {
                "on: expected one of ('amplitude', 'both')": [1],
            },
        },
    ),
    "crossings": (
        lambda s: partial(s.resonance_crossings, (300.0, 600.0), [5]),
        {
            "mode": {
                "mode: expected 1 to 10 (283.08, 688.9, 1125.4, ... Hz without contact)": [77],
            },
            "damper_mass_factor": {
                "damper_mass_factor: expected a sequence of one or more finite numbers > 0": [
                    [0.0]
                ],
            },
            "margin": {
                "margin: expected a LeastMargin": [As(AISI_1050, "a Material")],
            },
        },
    ),
    "sweep": (
        lambda s: partial(bd.sweep, s, {"preload": [9.0]}),
        {
            "mode": {
                "mode: expected 1 to 10 (283.08, 688.9, 1125.4, ... Hz without contact)": [77],
            },
            "evaluate": {
                "evaluate: expected PeakTask(...), OptimalTask(...) or a function": ["peak"],
            },
            "combine": {
                'combine: expected "product" or "zip"': ["all"],
            },
            "executor": {
                (
                    "executor: expected an executor with a method submit, such as those of "
                    "concurrent.futures"
                ): ["threads"],
            },
        },
    ),
    "compare": (
        lambda s: partial(bd.compare, {"a": s}),
        {
            "question": {
                "question: expected a function of a study": [None, 3],
            },
        },
    ),
    "fit": (
        lambda s: partial(bd.fit, s, vary={"friction_coefficient": (0.1, 0.5)}),
        {
            "data": {
                "data: expected one test or more": [As([], "none")],
                (
                    "data: expected a MeasuredResponse, a Measured, a MeasuredMode or a sequence "
                    "of these"
                ): [3],
                "data: expected a MeasuredResponse or a Measured or a MeasuredMode": [As([3], "3")],
            },
        },
    ),
    "lumped": (
        lambda s: lumped,
        {
            "mass": {
                "mass: expected a number, a diagonal or a matrix": ["1"],
                (
                    "mass: expected a positive definite matrix with eigenvalues above 1e-09 of "
                    "its largest entry, 1 kg"
                ): [As(-1.0, "an eigenvalue of -1 kg")],
                (
                    "mass: expected a positive definite matrix with eigenvalues above 1e-09 of "
                    "its largest entry, 0 kg"
                ): [As(0.0, "an eigenvalue of 0 kg")],
                "mass: expected finite numbers": [NAN],
            },
            "stiffness": {
                ("stiffness: expected finite numbers, a diagonal or a matrix (1, 1) as the mass"): [
                    As([[2.0, 1.0], [1.0, 2.0]], "shape (2, 2)")
                ],
                "stiffness: expected a positive semidefinite matrix": [
                    As(-1.0, "a mode of -1 rad2/s2")
                ],
            },
            "forces": {
                "forces: expected a force on at least one degree of freedom": [As({}, "none")],
                "forces: expected a mapping of degrees of freedom to numbers in N": ["1 N"],
            },
            "contacts": {
                "contacts: expected a sequence of Contact": [As(ONE, "a Contact")],
                "contacts: expected a Contact": [As([3], "3")],
            },
        },
    ),
    "Contact": (
        lambda s: partial(bd.Contact, 0, kt=1.0),
        {
            "mu": {
                "mu: expected a finite number >= 0": [-1.0, "0.3"],
            },
            "gap": {
                "gap: expected a finite number >= 0 m": [NAN],
            },
        },
    ),
    "ContinuationOptions": (
        lambda s: bd.ContinuationOptions,
        {
            "budget": {
                "budget: expected a whole number >= 1": [-1],
            },
            "step": {
                "step: expected a finite number > 0": [0.0],
            },
            "tolerance": {
                "tolerance: expected a number between 0 and 0.01": [1.0],
            },
        },
    ),
    "Material": (
        lambda s: partial(Material, ultimate_strength=9e8, yield_strength=8e8),
        {
            "endurance_limit": {
                "endurance_limit: expected a finite number > 0": ["300 MPa", NAN, -1.0],
                "endurance_limit: expected at most the ultimate strength, 9e+08 Pa": [
                    As(1e9, "1e+09")
                ],
            },
        },
    ),
    "ElasticMaterial": (
        lambda s: ElasticMaterial,
        {
            "youngs_modulus": {
                "youngs_modulus: expected a finite number > 0": ["210 GPa", -1.0],
            },
            "poisson_ratio": {
                "poisson_ratio: expected a finite number >= 0 and < 0.5": [30.0, 0.5],
            },
            "density": {
                "density: expected a finite number > 0": [0.0],
            },
        },
    ),
    "Geometry": (
        lambda s: Geometry,
        {
            "face_angle": {
                "face_angle: expected a number between 0 and 1.5708 rad": [60.0],
            },
            "n_blades": {
                "n_blades: expected a whole number >= 1": [2.5],
            },
            "twist": {
                "twist: expected a finite number >= -1.5708 and <= 1.5708 rad": [30.0],
            },
            "bore_radius": {
                "bore_radius: expected a finite number > 0": [-1.0],
            },
        },
    ),
    "face_gap": (
        lambda s: partial(bd.face_gap, s.model.interfaces["left"]),
        {
            "angle": {
                "misfit angle: expected a finite number >= -0.1 and <= 0.1 rad": [1.0],
            },
            "interface": {},
        },
    ),
    "Mistuning": (
        lambda s: partial(Mistuning.random, 65, 0.01),
        {
            "seed": {
                "seed: expected a whole number >= 0": ["a"],
            },
        },
    ),
    "DamperVariation": (
        lambda s: partial(DamperVariation.of, 65),
        {
            "missing": {
                "missing: expected a whole number from 0 to 64": [As([99], "99")],
                "missing: expected a sequence of whole numbers": ["2"],
            },
            "mass": {
                "mass: expected 65 finite numbers > 0": [As(-1.0, "-1.0 at index 0"), [1.0] * 3],
            },
        },
    ),
    "load": (
        lambda s: bd.load,
        {
            "path": {
                "path: expected the path of a file": [3, None],
            },
        },
    ),
    "save": (
        lambda s: s.save,
        {
            "path": {
                "path: expected the path of a file": [3],
            },
        },
    ),
}
"""Bad values by function, argument and message up to the value found."""


def cases_of_values():
    """Return a mistake and its whole message for each bad value."""
    cases = {}
    for function, (make, arguments) in VALUES.items():
        for name, messages in arguments.items():
            bad = [(beginning, x) for beginning, values in messages.items() for x in values]
            for k, (beginning, value) in enumerate(bad):
                shown = value if isinstance(value, As) else As(value, repr(value))
                cases[f"{function} {name} {k}"] = (
                    lambda s, make=make, name=name, value=shown.value: make(s)(**{name: value}),
                    f"{beginning}, found {shown.found}",
                )
    return cases


REFUSED |= cases_of_values()
WITHOUT_FOUND = {
    "engine_order: give the engine order of",
    "engine_orders: give at least one",
    "preload: this study has no rotor speed; use ",
    "no margin found at any of ",
    "there is no model file ",
    "body 'blade': harmonic ",
    "a bladed disk needs ",
}
"""Beginnings of messages on a value that is missing or not in the model."""


@each("mistake", REFUSED)
def test_a_mistake_is_refused_in_one_clear_line(study, mistake):
    ask, message = REFUSED[mistake]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises((bd.BdamperError, FileNotFoundError)) as caught:
            ask(study)
    assert str(caught.value) == message


@each("mistake", REFUSED)
def test_a_message_names_thing_expected_and_found(mistake):
    message = REFUSED[mistake][1]
    assert "\n" not in message and len(message) < 700
    if any(message.startswith(beginning) for beginning in WITHOUT_FOUND):
        return
    unknown = r"[\w.]+: there is no argument '\w+'; (did you mean|the arguments are|it is an argument of) "
    missing = r"[\w.]+: missing a required argument: '\w+'; the required arguments? (is|are) "
    assert re.match(r"[^:]+: expected .+, found .+", message) or re.match(
        f"{unknown}|{missing}", message
    )


def failing(ask):
    with pytest.raises(bd.BdamperError) as caught:
        ask()
    assert str(caught.value) == (
        "run-up: mode 1 has no maximum: engine order 5 crosses mode 1 at 7146.8 rpm with free contacts "
        "and at 10467 rpm with stuck contacts; give a range wider than 66845 to 90718 rpm"
    )


DOUBTED = {
    "rpm for rad/s": (
        lambda s: s.at_speed(4500),
        "rotor speed: plausible at most 1292 rad/s, 800 m/s at a radius of 0.619 m, found "
        "4500; possibly given in revolutions per minute; use rpm=4500",
    ),
    "rpm of a diagram": (
        lambda s: s.campbell((2000, 5000, 7000), modes=1),
        "rotor speed: plausible at most 1292 rad/s, 800 m/s at a radius of 0.619 m, found "
        "7000; possibly given in revolutions per minute; use rpm=(2000, 5000, 7000)",
    ),
    "rpm of a run-up": (
        lambda s: failing(lambda: s.run_up((7000, 9500))),
        "rotor speed: plausible at most 1292 rad/s, 800 m/s at a radius of 0.619 m, found "
        "9500; possibly given in revolutions per minute; use rpm=(7000, 9500)",
    ),
    "a mass in grams": (
        lambda s: vary(s, {"damper_inertia_factor": 1e3}),
        "mass of 'damper': plausible 0.00039 to 0.78 kg, by the size of its faces, found 69 "
        "kg; possibly given in grams",
    ),
    "strength in MPa": (
        lambda s: Material(300.0, 1200.0, 900.0),
        [
            (
                "endurance_limit: plausible 1e+06 to 1e+10 Pa, found 300 Pa; possibly given in "
                "MPa; 1 MPa is 1e6 Pa"
            ),
            (
                "ultimate_strength: plausible 1e+06 to 1e+10 Pa, found 1200 Pa; possibly given "
                "in MPa; 1 MPa is 1e6 Pa"
            ),
            (
                "yield_strength: plausible 1e+06 to 1e+10 Pa, found 900 Pa; possibly given in "
                "MPa; 1 MPa is 1e6 Pa"
            ),
        ],
    ),
    "strength converted twice": (
        lambda s: Material(3e8, 9e14, 8e8),
        "ultimate_strength: plausible 1e+06 to 1e+10 Pa, found 9e+14 Pa; possibly converted "
        "from MPa to Pa twice",
    ),
    "30 for 0.3": (
        lambda s: s.replace(friction_coefficient=30.0),
        "friction_coefficient: plausible 0.05 to 1.5, or 0, found 30; possibly given in per cent",
    ),
    "30 for 0.3 of a contact": (
        lambda s: bd.Contact(0, kt=1.0, mu=30.0, preload=1.0),
        "mu: plausible 0.0001 to 5, found 30; possibly given in per cent",
    ),
    "N/mm": (
        lambda s: s.replace(contact_stiffness=2e4),
        "contact_stiffness: plausible 2.6e+06 to 2.6e+10 N/m, mean of the contact points, 0.01 "
        "to 100 times the stiffness of the bodies there, found 2e+04 N/m; possibly given in N/mm or "
        "per area",
    ),
    "damping of 30 %": (
        lambda s: s.replace(damping_ratio=0.3),
        "damping_ratio: plausible at most 0.1 of critical damping, found 0.3 of critical "
        "damping; possibly given in per cent",
    ),
    "a number of vanes": (
        lambda s: s.replace(engine_order=60),
        "engine_order: plausible 1 to 32, found 60; possibly given in rad/s or Hz, or a "
        "number of vanes, which excites a different nodal diameter",
    ),
    "newtons of a history": (
        lambda s: s.replace(load_history=(2000.0, 1.0)),
        "load_history: plausible 0.001 to 10, found 2000; possibly given in newtons; factors "
        "on the preload are expected",
    ),
    "newtons of a share": (
        lambda s: s.replace(load_per_preload={"damper": 2e3}),
        "load_per_preload of 'damper': plausible 0.001 to 100 newtons per newton of preload, "
        "found 2000 newtons per newton of preload; possibly given in newtons; fractions are "
        "expected",
    ),
    "flow of another diameter": (
        lambda s: s.replace(aerodynamic_damping={30: 0.01}),
        "aerodynamic_damping: plausible values at the nodal diameters of the study, [5], "
        "found values at [30] only",
    ),
    "giganewtons": (
        lambda s: s.replace(excitation=bd.Excitation("tip", amplitude=1e9)),
        "excitation amplitude of 'tip': plausible 1e-06 to 2.6e+03 N, up to the force that "
        "deflects the structure by 10 % of its extent, found 1e+09 N; possibly given in mN "
        "or N/m2",
    ),
    "a preload of 0": (
        lambda s: s.frequency_response(0.0, (300.0, 301.0)),
        "preload: plausible above 0 N, found 0: no contact has a normal force, as in study.free",
    ),
    "a preload in kN": (
        lambda s: s.frequency_response(
            2e-3, (300.0, 301.0), options=bd.ContinuationOptions(budget=20)
        ),
        "preload: plausible 1 to 1e+06 N, 1 to 1e+06 times the excitation amplitude, found "
        "0.002 N; possibly given in kN, or the damper leaves its seat",
    ),
    "no resonance": (
        lambda s: s.frequency_response(2e3, (1.0, 2.0)),
        "frequency: plausible an interval in Hz around a resonance, such as 283.08 Hz, found "
        "(1, 2), far from every resonance; possibly given in kHz, or a wrong digit",
    ),
    "kHz": (
        lambda s: s.peak(2e3, (0.27, 0.38)),
        "frequency: plausible an interval in Hz around a resonance, such as 283.08 Hz, found "
        "(0.27, 0.38), far from every resonance; possibly given in kHz, or a wrong digit",
    ),
    "masses without a resonance": (
        lambda s: lumped().free((10.0, 20.0)),
        "frequency: plausible an interval in Hz around a resonance, such as 0.15915 Hz, "
        "found (10, 20), far from every resonance; possibly given in kHz, or a wrong digit",
    ),
    "millimetres of a mode": (
        lambda s: s.nonlinear_mode(2e3, 1, (1e-6, 1e3)),
        "amplitude: plausible 1e-15 to 0.19 m, the extent of the model, found 1000 m; "
        "possibly given in millimetres or micrometres",
    ),
    "modulus in GPa": (
        lambda s: ElasticMaterial(210.0),
        "youngs_modulus: plausible 1e+08 to 2e+12 Pa, found 210 Pa; possibly given in MPa or GPa",
    ),
    "density in g/cm3": (
        lambda s: ElasticMaterial(2.1e11, 0.3, 7.85),
        "density: plausible 500 to 30000 kg/m3, found 7.85 kg/m3; possibly given in g/cm3 or t/mm3",
    ),
    "millimetres of a disk": (
        lambda s: Geometry(rim_radius=400.0, ridge_radius=441.5),
        [
            (
                "ridge_radius: plausible 1e-06 to 5 m, found 441.5 m; possibly given in "
                "millimetres or micrometres"
            ),
            (
                "rim_radius: plausible 1e-06 to 5 m, found 400 m; possibly given in millimetres "
                "or micrometres"
            ),
        ],
    ),
    "modulus of a sector in GPa": (
        lambda s: Sector(65, elasticity=(210.0, 0.3)),
        "elasticity: plausible 1000 to 2e+12 Pa or N/mm2, found 210 Pa or N/mm2; possibly "
        "given in GPa",
    ),
    "units of an import": (
        lambda s: Units(1000.0),
        "length: plausible 1e-06 to 1 m, found 1000 m; possibly the inverse; the factor is "
        "1e-3 for millimetres",
    ),
    "crowning in micrometres": (
        lambda s: bd.face_gap(s.model.interfaces["left"], crowning=20.0),
        "crowning: plausible -0.002 to 0.002 m, found 20 m; possibly given in millimetres or "
        "micrometres",
    ),
    "grams of a damper": (
        lambda s: DamperVariation.of(65, mass=69.0),
        "mass: plausible 0.2 to 5 times the mass of the damper, found 69 times the mass of "
        "the damper; possibly given in grams",
    ),
    "Hz of a deviation": (
        lambda s: Mistuning(np.full(65, 5.0)),
        "deviation: plausible -0.5 to 0.5 of the frequency, found 5 of the frequency; "
        "possibly given in per cent or Hz",
    ),
    "rad/s for Hz": (
        lambda s: s.free((1700.0, 2200.0)),
        "frequency: plausible an interval in Hz around resonances of the model, such as "
        "283.08 Hz, found (1700, 2200) with a response 3e+03 times weaker; divided by 2 pi, "
        "it contains resonances: possibly given in radians per second",
    ),
}


@pytest.mark.slow
@each("mistake", DOUBTED)
def test_an_unlikely_unit_is_named(study, mistake):
    ask, messages = DOUBTED[mistake]
    with pytest.warns(PlausibilityWarning) as caught:
        ask(study)
    doubts = {
        (str(w.message), w.filename) for w in caught if issubclass(w.category, PlausibilityWarning)
    }
    expected = [messages] if isinstance(messages, str) else messages
    assert doubts == {(message, __file__) for message in expected}
    for message in expected:
        assert re.match(r"[^:]+: plausible .+, found .+", message)


NAMES = {
    "study": (
        lambda s: s.frequncy_response,
        "Study has no attribute 'frequncy_response'; did you mean frequency_response?",
    ),
    "settings": (lambda s: s.settings.frequenzy, "Settings has no attribute 'frequenzy'"),
    "options": (
        lambda s: bd.PeakOptions().tolerence,
        "PeakOptions has no attribute 'tolerence'; did you mean tolerance?",
    ),
    "model": (lambda s: s.model.blades, "Model has no attribute 'blades'; did you mean n_blades?"),
    "package": (lambda s: bd.swep, "bdamper has no attribute 'swep'; did you mean sweep?"),
}


@each("of", NAMES)
def test_a_misspelt_attribute_is_answered(study, of):
    ask, message = NAMES[of]
    with pytest.raises(AttributeError) as caught:
        ask(study)
    assert str(caught.value) == message


NO_LINE = "expected at least one line of numbers, found none"
NO_TABLE = "expected a header and rows of numbers, found an empty file"
FILES = {
    "x.h5": (bd.load, "expected a file written by bdamper, found an empty file"),
    "model.h5": (bd.load_model, "expected a readable HDF5 file, found an empty file"),
    "study.h5": (bd.load_study, "expected a study or a result, found an empty file"),
    "x.inp": (read_body, "expected *NODE with at least one node, found none"),
    "x.cdb": (read_body, "expected a block of nodes (NBLOCK), found none"),
    "x.frd": (read_body, "expected a block of nodes (2C), found none"),
    "x.mtx": (read_matrix, NO_LINE),
    "x.txt": (read_nodes, NO_LINE),
    "x.csv": (read_response, NO_TABLE),
    "mode.csv": (read_mode, NO_TABLE),
    "ring.csv": (read_ring_down, NO_TABLE),
}
"""Function that reads a file, and its message on an empty file."""


@each("name", FILES)
def test_missing_and_empty_files_are_named(tmp_path, name):
    path = tmp_path / name
    read, contradiction = FILES[name]
    kind = "model file" if name == "model.h5" else "file"
    with pytest.raises(FileNotFoundError) as caught:
        read(path)
    assert str(caught.value) == f"there is no {kind} '{path}'"
    path.write_bytes(b"")
    with pytest.raises(bd.BdamperError) as caught:
        read(path)
    assert str(caught.value) == f"{path}: {contradiction}"


def test_results_of_another_study_and_curves_without_their_peak(study):
    curve, other = (
        study.frequency_response(2000.0, (340.0, 350.0)),
        study.replace(friction_coefficient=0.3),
    )
    points = ", ".join(f"'blade point {k}'" for k in range(1, 11))
    for ask, message in (
        (
            lambda: other.hysteresis(curve),
            "curve: expected a result of this study, found a free or stuck response, or a result "
            "computed with different settings (residual 0.06)",
        ),
        (
            lambda: study.hysteresis(curve, index=10**6),
            "index of a point: expected a whole number from -17 to 16, found 1000000",
        ),
        (
            lambda: study.response_at(curve, "tpi"),
            "location: expected one of ('damper', 'platform', 'tip'), found 'tpi'; did you mean tip?",
        ),
        (
            lambda: study.time_response(curve),
            "curve: expected a curve with a peak, found its highest amplitude at its end, 120.929 µm "
            "at 350 Hz",
        ),
        (
            lambda: study.stress(curve, sets="rot"),
            "stress set: expected one of ('blade',), found 'rot'",
        ),
        (
            lambda: study.gauge_stress(curve, "rot 1", "radial"),
            f"gauge: expected one of ({points}), found 'rot 1'",
        ),
    ):
        with pytest.raises(bd.SettingError) as caught:
            ask()
        assert str(caught.value) == message
    at_end = (
        "result: plausible a response curve with its peak inside the interval, found the highest "
        "response at its end, 121 µm at 350 Hz"
    )
    outside = "frequency: plausible 340 to 350 Hz, within the curve, found 360"
    motion = partial(study.motion_in_time, frequency=360.0, periods=16)
    margin = partial(study.margin, material=AISI_1050)
    for ask, message in ((study.stress, at_end), (margin, at_end), (motion, outside)):
        with pytest.warns(PlausibilityWarning) as caught:
            ask(curve)
        assert {str(w.message) for w in caught} == {message}


def test_at_least_150_mistakes_are_listed():
    assert len(REFUSED) + len(DOUBTED) + len(NAMES) + 2 * len(FILES) >= 150


@pytest.mark.slow
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
        with pytest.raises(bd.BdamperError) as caught:
            study.run_up(rpm=(1000.0, 1500.0))
        assert str(caught.value) == (
            "run-up: mode 1 has no maximum: engine order 5 crosses mode 1 at 3662.5 rpm with free contacts "
            "and at 4713.6 rpm with stuck contacts; give a range wider than 1000 to 1500 rpm"
        )
