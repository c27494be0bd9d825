"""A result of every kind, by the name of what gives it, from a bladed disk with nine contact points."""

from functools import cache
from importlib.resources import files

import bdamper as bd
from bdamper.fatigue.criteria import Material
from bdamper.mistuning import Mistuning
from tests.fatigue.test_margins import with_stress
from tests.plain import plain_study

STEEL = Material(endurance_limit=300e6, ultimate_strength=900e6, yield_strength=800e6)
WHEELS = files("bdamper") / "data" / "wheels.h5"
BAND = (330.0, 365.0)


def bladed_disk():
    model = with_stress(bd.reference_model("bladed_disk", contact_points=9))
    return plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)


def turbine():
    model = bd.reference_model("turbine_blade", contact_points=9)
    return bd.Study(model, bd.Excitation("tip", amplitude=10.0), 5, friction_coefficient=0.3, harmonics=1)


def response_curve(study):
    return study.frequency_response(2000.0, BAND, stability=True)


RESULTS = {
    "frequency_response": lambda s, c: c,
    "free": lambda s, c: s.free(BAND),
    "peak": lambda s, c: s.peak(2000.0, BAND),
    "optimal_curve": lambda s, c: s.optimal_curve((500.0, 4e3), 4, frequency=BAND, check=False),
    "static": lambda s, c: s.static(500.0),
    "hysteresis": lambda s, c: s.hysteresis(c),
    "dissipation": lambda s, c: s.dissipation(c),
    "motion_in_time": lambda s, c: s.motion_in_time(c, periods=2, steps_per_period=512),
    "effect_significance": lambda s, c: s.effect_significance(2000.0, BAND),
    "compare": lambda s, c: bd.compare(
        {"now": s, "smooth": {"friction_coefficient": 0.2}}, lambda one: one.frequency_response(2000.0, BAND)
    ),
    "sweep": lambda s, c: bd.sweep(s, {"preload": [1e3, 2e3]}, frequency=BAND),
    "optimal_curve_uncertainty": lambda s, c: bd.optimal_curve_uncertainty(
        s, {"friction_coefficient": [0.3, 0.4]}, (1e3, 4e3), 2, frequency=BAND
    ),
    "microslip": lambda s, c: bd.microslip(s, 500.0, [20.0, 40.0]),
    "mistuning": lambda s, c: bd.BladedDisk(s, Mistuning.random(65, 0.01, seed=1)).mistuning,
    "campbell": lambda s, c: turbine().campbell((350.0, 600.0, 850.0), (5,), modes=1),
    "nonlinear_mode": lambda s, c: s.nonlinear_mode(2000.0, 1, (1e-6, 1e-4)),
    "stress": lambda s, c: s.stress(s.peak(2000.0, BAND)),
    "margins": lambda s, c: s.margin(s.peak(2000.0, BAND), STEEL),
    "margin_curve": lambda s, c: s.margin(c, STEEL),
    "mistuned_sample": lambda s, c: bd.load(WHEELS),
}
"""From the study and its response curve at 2,000 N."""


@cache
def result(name):
    study = bladed_disk()
    curve = response_curve(study) if name == "frequency_response" else result("frequency_response")
    return RESULTS[name](study, curve)
