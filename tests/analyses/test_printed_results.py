"""The whole printed text of every kind of result; ``python -m tests.analyses.test_printed_results`` writes it."""

import re
from dataclasses import replace
from pathlib import Path

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

TEXTS = Path(__file__).parents[1] / "golden" / "printed.txt"
FRICTION = {"friction_coefficient": [0.3, 0.4]}


def of_study():
    """Results of two masses with a contact."""
    s = pressed()
    curve, peak = s.frequency_response(2.0, BAND), s.peak(2.0, BAND)
    variants = {"now": s, "smooth": {"friction_coefficient": 0.2}}
    yield from (curve, s.free(BAND), s.frequency_response(2.0, (0.1, 0.15)), peak, s.static(2.0))
    yield s.optimal_curve((0.5, 5.0), 6, frequency=BAND, check=False)
    yield from (s.hysteresis(curve), s.dissipation(curve), s.time_response(peak))
    yield s.motion_in_time(curve, periods=2, steps_per_period=256)
    yield from (s.harmonic_convergence(peak, harmonics=(3, 5)), s.estimate_errors(curve), s.effect_significance(2.0, BAND))
    cost = accuracy_cost(s, 2.0, BAND, vary={"harmonics": (1, 3)})
    yield replace(cost, runs=tuple(replace(run, seconds=1.0 + k) for k, run in enumerate(cost.runs)))
    yield bd.compare(variants, lambda one: one.frequency_response(2.0, BAND))
    yield replace(bd.sweep(s, {"preload": [1.0, 2.0]}, frequency=BAND), seconds=np.ones(2))
    yield bd.optimal_curve_uncertainty(s, FRICTION, (0.5, 4.0), 3, frequency=BAND)
    yield bd.robust_optimum(s, FRICTION, (0.5, 4.0), n=5, tolerance=0.5, frequency=BAND)
    yield from (s.nonlinear_mode(2.0, 1, (1e-3, 10.0)), s.flutter(2.0, -0.01, amplitude=(1e-3, 10.0)))
    displacement, force = loop(0.6, 3.0 * REACH)
    noise = np.random.default_rng(0).standard_normal(len(force))
    yield bd.fit_loop(displacement, force + noise, normal=NORMAL)


def of_disks():
    """Results of mistuned bladed disks."""
    mistuning = Mistuning.random(6, 0.02, seed=1)
    yield from (mistuning, DamperVariation.of(6, missing=[2], mass=1.1))
    yield BladedDisk(lumped_study(), mistuning).peak(300.0, options=DiskPeakOptions(climbs=2, least=20))
    sample = bd.load(Path(bd.__file__).parent / "data/wheels.h5")
    yield from (sample, sample.audit(), sample.best_preload(), sample.tail())


def of_arrays():
    """Results whose models are large, from arrays."""
    coefficients = 1e6 * np.array([50.0, 40.0])[:, None, None] * np.ones((2, 6, 2)) * [4.0, 1.0 + 0.5j]
    at_points = {
        "points": np.eye(3)[:2], "names": ("root 1", "root 2"), "counted": np.ones(2, bool), "spread": np.full(2, np.nan),
        "frequency": 350.0, "preload": 1e3, "speed": 440.0, "settings": {}, "model_hash": "",
    }  # fmt: skip
    cycle = StressCycle(coefficients=coefficients, **at_points)
    margins = LeastMargin(AISI_1050).of_cycle(cycle)
    yield from (cycle, margins)
    row = np.array([margins.factor, 0.5 * margins.factor])
    yield MarginCurve(
        over="preload", unit="N", values=np.array([1e3, 2e3]), margin=row.min(axis=1), response=np.array([1e-4, 2e-4]),
        names=margins.names, critical=row.argmin(axis=1), amplitude=row, mean=row, factor=row, frequency=350.0 + row[0],
        preload=np.array([1e3, 2e3]), speed=row[0], material=AISI_1050, rule=margins.rule, settings={}, model_hash="",
    )  # fmt: skip
    speed = np.array([300.0, 400.0, 500.0])
    yield Campbell(
        speed=speed, nodal_diameter=np.array([5]), free=np.full((1, 3, 1), 330.0), stuck=np.full((1, 3, 1), 350.0),
        n_blades=65, engine_order=np.array([5]), settings={}, model_hash="",
    )  # fmt: skip
    belongs = {"harmonics": (1,), "blade_modes": 10, "contact_points": None, "contact_stiffness": "unit_traction"}
    yield Fitted(
        names=("friction_coefficient",), values=np.array([0.3]), low=np.array([0.28]), high=np.array([0.33]),
        deviation=np.array([0.04]), left_out=np.array([np.nan]), information=np.ones((1, 1)), tests=("first",), noise=0.01,
        place=np.array([349.0, 350.0]), measured=np.array([1e-4, 2e-4j]), model=np.array([1.1e-4, 2.1e-4j]),
        residual=np.array([[1.0, -2.0], [0.5, 3.0]]), test=np.zeros(2, int), settings=belongs, model_hash="",
    )  # fmt: skip


def printed():
    """Return all texts, without times and rounding errors, which vary."""
    results = [*of_study(), *of_disks(), *of_arrays()]
    text = "\n\n".join(f"[{type(result).__name__}]\n{result}" for result in results) + "\n"
    for varies, shown in ((r"[-+]?\d[\d.]*e-\d+|[-+]0(?= )", "0"), (r"(?<=  )\d[\d.]* m?s(?= )", "time"), (r" {2,}", "  ")):
        text = re.sub(varies, shown, text)
    return text


def test_every_kind_of_result_prints_what_it_printed():
    assert printed() == TEXTS.read_text(encoding="utf-8")


if __name__ == "__main__":
    TEXTS.write_text(printed(), encoding="utf-8")
