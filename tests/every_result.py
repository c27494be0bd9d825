"""A result of every kind by the name of what gives it: of two masses with a contact, of small disks, or of arrays."""

from dataclasses import replace
from functools import cache
from importlib.resources import files

import numpy as np

import bdamper as bd
from bdamper.analyses.accuracy import accuracy_cost
from bdamper.analyses.campbell import Campbell
from bdamper.analyses.fit_result import Fitted
from bdamper.fatigue import AISI_1050, MarginCurve
from bdamper.fatigue.margin import LeastMargin
from bdamper.fatigue.stress_cycle import StressCycle
from bdamper.mistuning import BladedDisk, DamperVariation, DiskPeakOptions, Mistuning
from tests.analyses.test_loop import NORMAL, REACH, loop
from tests.mistuning.lumped import lumped_study
from tests.util.test_disk import BAND, pressed

FRICTION = {"friction_coefficient": [0.3, 0.4]}
VARIANTS = {"now": pressed(), "smooth": {"friction_coefficient": 0.2}}


def costs(study):
    found = accuracy_cost(study, 2.0, BAND, vary={"harmonics": (1, 3)})
    runs = tuple(replace(run, seconds=1.0 + k) for k, run in enumerate(found.runs))
    sources = tuple(
        replace(error, seconds=2.0) if error.seconds > 0.0 else error for error in found.sources
    )
    return replace(found, runs=runs, sources=sources)


def refinement(study):
    found = study.refine(result("peak"), tolerance=2e-3)
    steps = tuple(replace(step, seconds=1.0 + k) for k, step in enumerate(found.steps))
    return replace(found, steps=steps)


def fitted_loop():
    displacement, force = loop(0.6, 3.0 * REACH)
    noise = np.random.default_rng(0).standard_normal(len(force))
    return bd.fit_loop(displacement, force + noise, normal=NORMAL)


def stress():
    coefficients = (
        1e6 * np.array([50.0, 40.0])[:, None, None] * np.ones((2, 6, 2)) * [4.0, 1.0 + 0.5j]
    )
    return StressCycle(
        coefficients=coefficients, points=np.eye(3)[:2], names=("root 1", "root 2"), counted=np.ones(2, bool),
        spread=np.full(2, np.nan), frequency=350.0, preload=1e3, speed=440.0, settings={}, model_hash="",
    )  # fmt: skip


def margin_curve(margins):
    row = np.array([margins.factor, 0.5 * margins.factor])
    return MarginCurve(
        over="preload", unit="N", values=np.array([1e3, 2e3]), margin=row.min(axis=1), response=np.array([1e-4, 2e-4]),
        names=margins.names, critical=row.argmin(axis=1), amplitude=row, mean=row, factor=row, frequency=350.0 + row[0],
        preload=np.array([1e3, 2e3]), speed=row[0], material=AISI_1050, rule=margins.rule, settings={}, model_hash="",
    )  # fmt: skip


def campbell():
    speed = np.array([300.0, 400.0, 500.0])
    return Campbell(
        speed=speed, nodal_diameter=np.array([5]), free=np.full((1, 3, 1), 330.0), stuck=np.full((1, 3, 1), 350.0),
        n_blades=65, engine_order=np.array([5]), settings={}, model_hash="",
    )  # fmt: skip


def fitted():
    belongs = {
        "harmonics": (1,),
        "blade_modes": 10,
        "contact_points": None,
        "contact_stiffness": "unit_traction",
    }
    return Fitted(
        names=("friction_coefficient",), values=np.array([0.3]), low=np.array([0.28]), high=np.array([0.33]),
        deviation=np.array([0.04]), left_out=np.array([np.nan]), information=np.ones((1, 1)), tests=("first",), noise=0.01,
        place=np.array([349.0, 350.0]), measured=np.array([1e-4, 2e-4j]), model=np.array([1.1e-4, 2.1e-4j]),
        residual=np.array([[1.0, -2.0], [0.5, 3.0]]), test=np.zeros(2, int), settings=belongs, model_hash="",
    )  # fmt: skip


RESULTS = {
    "frequency_response": lambda s: s.frequency_response(2.0, BAND),
    "free": lambda s: s.free(BAND),
    "frequency_response of a flank": lambda s: s.frequency_response(2.0, (0.1, 0.15)),
    "peak": lambda s: s.peak(2.0, BAND),
    "static": lambda s: s.static(2.0),
    "optimal_curve": lambda s: s.optimal_curve((0.5, 5.0), 6, frequency=BAND, check=False),
    "hysteresis": lambda s: s.hysteresis(result("frequency_response")),
    "dissipation": lambda s: s.dissipation(result("frequency_response")),
    "time_response": lambda s: s.time_response(result("peak")),
    "motion_in_time": lambda s: s.motion_in_time(
        result("frequency_response"), periods=2, steps_per_period=256
    ),
    "harmonic_convergence": lambda s: s.harmonic_convergence(result("peak"), harmonics=(3, 5)),
    "estimate_errors": lambda s: s.estimate_errors(result("frequency_response")),
    "refine": refinement,
    "effect_significance": lambda s: s.effect_significance(2.0, BAND),
    "accuracy_cost": costs,
    "compare": lambda s: bd.compare(VARIANTS, lambda one: one.frequency_response(2.0, BAND)),
    "sweep": lambda s: replace(
        bd.sweep(s, {"preload": [1.0, 2.0]}, frequency=BAND), seconds=np.ones(2)
    ),
    "optimal_curve_uncertainty": lambda s: bd.optimal_curve_uncertainty(
        s, FRICTION, (0.5, 4.0), 3, frequency=BAND
    ),
    "robust_optimum": lambda s: bd.robust_optimum(
        s, FRICTION, (0.5, 4.0), n=5, tolerance=0.5, frequency=BAND
    ),
    "nonlinear_mode": lambda s: s.nonlinear_mode(2.0, 1, (1e-3, 10.0)),
    "excitation_curve": lambda s: s.excitation_curve(2.0, (0.5, 2.0), 3, frequency=BAND),
    "flutter": lambda s: s.flutter(2.0, -0.01, amplitude=(1e-3, 10.0)),
    "fit_loop": lambda s: fitted_loop(),
    "mistuning": lambda s: Mistuning.random(6, 0.02, seed=1),
    "dampers": lambda s: DamperVariation.of(6, missing=[2], mass=1.1),
    "peak of a disk": lambda s: BladedDisk(lumped_study(), result("mistuning")).peak(
        300.0, options=DiskPeakOptions(climbs=2, least=20)
    ),
    "mistuned_sample": lambda s: bd.load(files("bdamper") / "data" / "wheels.h5"),
    "audit": lambda s: result("mistuned_sample").audit(),
    "best_preload": lambda s: result("mistuned_sample").best_preload(),
    "tail": lambda s: result("mistuned_sample").tail(),
    "stress": lambda s: stress(),
    "margins": lambda s: LeastMargin(AISI_1050).of_cycle(result("stress")),
    "margin_curve": lambda s: margin_curve(result("margins")),
    "campbell": lambda s: campbell(),
    "fit": lambda s: fitted(),
}

WITHOUT_TABLE = (
    "time_response", "harmonic_convergence", "estimate_errors", "robust_optimum", "fit_loop", "dampers", "peak of a disk",
    "audit", "best_preload", "tail",
)  # fmt: skip
"""Results that are not a table with a picture and a file."""


@cache
def result(name):
    return RESULTS[name](VARIANTS["now"])
