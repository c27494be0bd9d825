"""Some sixty answers by name: what each asks, and the numbers that tell whether another one came out.

A scene is a function without arguments that returns ``(values, counts)``: values that have to stay the same to 1e-9
(amplitudes at maxima, frequencies of folds and other stationary numbers), and counts of work for the record.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

import bdamper as bd
from bdamper.mistuning import Mistuning
from tests.mistuning.lumped import lumped_study
from tests.models import ground_model, shroud_model, wedge_model
from tests.plain import plain_study
from tests.turning import turning_disk

Answer = tuple[dict[str, Any], dict[str, int]]
SCENES: dict[str, Callable[[], Answer]] = {}
SLOW: set[str] = set()


@cache
def disk(name: str, points: int) -> Any:
    return bd.reference_model(name, points)


@cache
def study(model: str, plain: bool = True, **settings: Any) -> Any:
    """A study on a shipped or a small made-up model."""
    made = {
        "bladed 9": lambda: (disk("bladed_disk", 9), bd.Excitation("tip"), 5),
        "bladed 24": lambda: (disk("bladed_disk", 24), bd.Excitation("tip"), 5),
        "paper 9": lambda: (disk("paper_disk", 9), bd.Excitation("tip"), 5),
        "ground": lambda: (disk("blade_to_ground", 24), bd.Excitation("tip"), 0),
        "wedge": lambda: (wedge_model(0), bd.Excitation("tip"), 2),
        "shroud": lambda: (shroud_model(0), bd.Excitation("tip"), 2),
        "clamped": lambda: (ground_model(0), bd.Excitation("tip"), 0),
    }[model]()
    settings = {"friction_coefficient": 0.4} | settings
    return plain_study(*made, **settings) if plain else bd.Study(*made, **settings)


def scene(name: str, slow: bool = False) -> Callable[[Callable[[], Answer]], Callable[[], Answer]]:
    def keep(function: Callable[[], Answer]) -> Callable[[], Answer]:
        SCENES[name] = function
        if slow:
            SLOW.add(name)
        return function

    return keep


def curve(of: Any, preload: float, frequency: tuple[float, float], **settings: Any) -> Answer:
    """Maxima and folds of a response curve, with how it was found."""
    found = of.frequency_response(preload, frequency, **settings)
    kinds = np.array(found.point_kind)
    values = {
        "status": found.status,
        "maxima": found.amplitude[kinds == "maximum"].tolist(),
        "maxima at": np.round(found.frequency[kinds == "maximum"], 6).tolist(),
        "folds": found.frequency[kinds == "fold"].tolist(),
        "highest": found.peak.amplitude,
        "drift": int((kinds == "drift").sum()),
        "branches": int(found.branch.max()) + 1,
    }
    return values, {
        "points": len(found),
        "evaluations": found.cost.evaluations,
        "factorisations": found.cost.factorisations,
    }


BAND = (270.0, 370.0)
for preload in (60.0, 200.0, 2000.0):
    for harmonics in (1, 3):
        scene(
            f"curve bladed 9, unit tractions, H={harmonics}, {preload:g} N", slow=preload == 200.0
        )(lambda p=preload, h=harmonics: curve(study("bladed 9", harmonics=h), p, BAND))
for preload in (125.0, 500.0, 2000.0):
    scene(f"curve bladed 9, residual modes, H=3, {preload:g} N", slow=preload == 500.0)(
        lambda p=preload: curve(study("bladed 9", plain=False, harmonics=3), p, BAND)
    )
for preload in (800.0, 2000.0):
    scene(f"curve bladed 24, residual modes, H=1, {preload:g} N")(
        lambda p=preload: curve(study("bladed 24", plain=False, harmonics=1), p, BAND)
    )
    scene(f"curve paper 9, unit tractions, H=3, {preload:g} N")(
        lambda p=preload: curve(
            study("paper 9", harmonics=3, fundamental_modes_only=True), p, (250.0, 400.0)
        )
    )
for preload in (30.0, 300.0):
    scene(f"curve wedge, H=3, {preload:g} N")(
        lambda p=preload: curve(study("wedge", harmonics=3), p, (900.0, 1600.0))
    )
    scene(f"curve wedge sampled, H=3, {preload:g} N")(
        lambda p=preload: curve(
            study("wedge", harmonics=3, contact_forces=bd.AFT(128)), p, (900.0, 1600.0)
        )
    )
scene("curve wedge without bias, H=1, 100 N")(
    lambda: curve(study("wedge", bias=False), 100.0, (900.0, 1600.0))
)
scene("curve wedge, two harmonics, 100 N")(
    lambda: curve(study("wedge", harmonics=(1, 3)), 100.0, (900.0, 1600.0))
)
scene("curve shroud, H=3")(lambda: curve(study("shroud", harmonics=3), 0.0, (250.0, 420.0)))
scene("curve wedge, coupled friction, H=1, 100 N")(
    lambda: curve(
        study("wedge", friction_law="coupled", contact_forces=bd.AFT(128, interpolate=False)),
        100.0,
        (900.0, 1600.0),
    )
)


def peak(of: Any, preload: float) -> Answer:
    """The highest peak at one preload."""
    found = of.peak(preload)
    return {"amplitude": found.amplitude, "frequency": round(found.frequency, 6)}, {
        "iterations": found.cost.iterations
    }


for preload in (50.0, 125.0, 500.0, 2000.0):
    scene(f"peak bladed 9, unit tractions, H=3, {preload:g} N", slow=preload in (125.0, 500.0))(
        lambda p=preload: peak(study("bladed 9", harmonics=3), p)
    )
for preload in (125.0, 500.0, 2000.0):
    scene(f"peak bladed 9, residual modes, H=3, {preload:g} N", slow=preload == 500.0)(
        lambda p=preload: peak(study("bladed 9", plain=False, harmonics=3), p)
    )
    scene(f"peak wedge, H=3, {preload:g} N")(lambda p=preload: peak(study("wedge", harmonics=3), p))


def optimum(of: Any, preload: tuple[float, float], n: int) -> Answer:
    """An optimal curve: values at the preloads asked, and the optimum."""
    found = of.optimal_curve(
        preload, n, **({"check": False} if "check" in of.optimal_curve.__doc__ else {})
    )
    values = {
        "amplitude": found.amplitude[found.requested].tolist(),
        "optimum": found.optimum.amplitude,
        "optimum at": float(f"{found.optimum.preload:.3g}"),
    }
    return values, {"iterations": found.cost.iterations, "evaluations": found.cost.evaluations}


scene("optimum bladed 9, unit tractions, H=1", slow=True)(
    lambda: optimum(study("bladed 9"), (50.0, 5000.0), 12)
)
scene("optimum bladed 9, unit tractions, H=3, mu 0.2")(
    lambda: optimum(study("bladed 9", harmonics=3, friction_coefficient=0.2), (100.0, 5000.0), 8)
)
scene("optimum bladed 9, residual modes, H=1", slow=True)(
    lambda: optimum(study("bladed 9", plain=False, harmonics=1), (50.0, 5000.0), 8)
)
scene("optimum wedge, H=1")(lambda: optimum(study("wedge"), (10.0, 3000.0), 10))


def static(of: Any, preload: float) -> Answer:
    """Forces of a static state."""
    state = of.static(preload)
    return {
        "normal": state.force[:, 2].tolist(),
        "tangential": np.abs(state.force[:, :2]).sum(axis=0).tolist(),
    }, {"iterations": state.iterations}


for preload in (1.0, 100.0, 2000.0):
    scene(f"static bladed 9, {preload:g} N")(lambda p=preload: static(study("bladed 9"), p))
    scene(f"static bladed 9, residual modes, {preload:g} N")(
        lambda p=preload: static(study("bladed 9", plain=False, harmonics=3), p)
    )
    scene(f"static wedge, {preload:g} N")(lambda p=preload: static(study("wedge"), p))


@cache
def turning() -> Any:
    return plain_study(
        turning_disk((0, 5)), bd.Excitation("tip", amplitude=20.0), 5, friction_coefficient=0.3
    )


@scene("run-up")
def run_up() -> Answer:
    found = turning().run_up((420.0, 465.0))
    top = found.peak
    return {"peak": top.amplitude, "peak at": round(float(found.speed[found.peak_index]), 5)}, {
        "points": len(found)
    }


@scene("crossings")
def resonance_crossings() -> Answer:
    found = turning().resonance_crossings((400.0, 500.0), [5], damper_mass_factor=(0.8, 1.2))
    amplitude, speed = (found.array(name).ravel() for name in ("amplitude", "speed"))
    return {"amplitude": amplitude.tolist(), "speed": np.round(speed, 5).tolist()}, {}


def wheel(preload: float, deviations: tuple[float, ...]) -> Answer:
    """The highest blade of a lumped wheel of six, with what holds its dampers."""
    loaded = lumped_study(6, n_c=2, r=2).replace(excitation=bd.Excitation("tip", amplitude=100.0))
    found = bd.BladedDisk(loaded, Mistuning(np.array(deviations))).peak(preload)
    return {"amplitude": found.amplitude, "blade": int(found.blade)}, {}


for preload in (300.0, 3000.0):
    scene(f"wheel, lumped, {preload:g} N")(
        lambda p=preload: wheel(p, (0.01, -0.01, 0.0, 0.005, 0.02, -0.015))
    )
