"""What each effect costs and what it changes, and whether the advice on effects holds.

Without arguments: the shipped bladed disk with one effect off at a time.  With ``--scenes 60``: random scenes (seed 21)
of the shipped disk with nine points a face, the test rig and the blade on the ground, each at low, middle and high preload,
with a tolerance of 1, 2 or 5 %.  The peak with just the effects called for is compared with the highest point of the curves
with all effects on, followed from below and from above.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

import bdamper as bd
from bdamper.analyses.sweep import Comparison

MODELS = {"bladed_disk": 9, "test_rig": 24, "blade_to_ground": 24}
"""Points on each face."""
EVERYTHING = {"harmonics": 5, "damper_modes": 2}
OFF = {
    "none: everything on": {},
    "further harmonics": {"harmonics": 1},
    "even harmonics": {"harmonics": (1, 3, 5)},
    "bias": {"bias": False},
    "separation": {"separation": False},
    "variable normal load": {"variable_normal_load": False},
    "the same, and even harmonics, bias": {
        "variable_normal_load": False,
        "harmonics": (1, 3, 5),
        "bias": False,
    },
    "rotation X": {"rigid_modes": ("TX", "TY", "TZ", "RY", "RZ")},
    "rotation Y": {"rigid_modes": ("TX", "TY", "TZ", "RX", "RZ")},
    "rotation Z": {"rigid_modes": ("TX", "TY", "TZ", "RX", "RY")},
    "all rotation": {"rigid_modes": ("TX", "TY", "TZ")},
    "translation X": {"rigid_modes": ("TY", "TZ", "RX", "RY", "RZ")},
    "translation Z": {"rigid_modes": ("TX", "TY", "RX", "RY", "RZ")},
    "elastic damper modes": {"damper_modes": 0},
    "harmonic nodal diameters": {"fundamental_modes_only": True},
    "constraint planes": {"constraint_planes": False},
    "contact points beyond 9": {"contact_points": 9},
    "blade modes beyond 5": {"blade_modes": 5},
}
SCENES = (
    ("mode 1", bd.Excitation("tip"), (250.0, 400.0), (500.0, 2000.0)),
    ("mode 2", bd.Excitation("tip", "axial"), (560.0, 760.0), (500.0,)),
)


LEVELS = {"low": (400.0, 1500.0), "middle": (1500.0, 8000.0), "high": (8000.0, 60000.0)}
"""Preload, or sum of the normal loads on the ground, N."""
SEED = 21


@dataclass(frozen=True)
class Scene:
    """One study with all effects on, and where its highest peak is looked for."""

    name: str
    study: bd.Study
    preload: float
    interval: tuple[float, float]
    tolerance: float


def scenes(n: int) -> Iterator[Scene]:
    """Random scenes: models and levels of preload in turn, the rest by chance."""
    draw = np.random.default_rng(SEED)
    models = {name: bd.reference_model(name, points) for name, points in MODELS.items()}
    for i in range(n):
        name, level = list(models)[i % 3], list(LEVELS)[i // 3 % 3]
        load = float(np.exp(draw.uniform(*np.log(LEVELS[level]))))
        friction, tolerance = float(draw.uniform(0.2, 0.6)), float(draw.choice([0.01, 0.02, 0.05]))
        disk = name == "bladed_disk"
        direction = str(draw.choice(["tangential", "axial"])) if disk else "tangential"
        order = int(draw.choice([5] if direction == "axial" else [5, 10, 15])) if disk else 0
        ground = name == "blade_to_ground"
        study = bd.Study(
            models[name], bd.Excitation("tip", direction), order, friction_coefficient=friction,
            contact_stiffness="unit_traction",
            harmonics=5, damper_modes=0 if ground else 2,
        )  # fmt: skip
        if ground:
            z = models[name].interfaces["platform"].points[:, 2]
            share = 1.0 + 1.1 * z / np.abs(z).max()
            study = study.replace(
                constant_loads={"platform": load * share / share[share > 0.0].sum()}
            )
        interval = (560.0, 760.0) if direction == "axial" else (250.0, 400.0)
        text = f"{i}: {name}, {level}, {load:.0f} N, engine order {order}, {direction}, mu {friction:.2f}"
        yield Scene(text, study, 0.0 if ground else load, interval, tolerance)


def right(scene: Scene, check: Comparison) -> bool:
    """Whether the peak with the effects called for is that of the curves with all effects on, within the tolerance."""
    return max(map(abs, changes(check))) <= scene.tolerance


def changes(check: Comparison) -> tuple[float, float]:
    """Relative changes of amplitude and frequency of the peak."""
    top, lean = (curve.peak for curve in check.curves)
    return lean.amplitude / top.amplitude - 1.0, lean.frequency / top.frequency - 1.0


def agreement(n: int) -> None:
    """Print a line for each scene, then the share within the tolerance and the median of times saved."""
    within, gains, costs = [], [], []
    for scene in scenes(n):
        begin = time.process_time()
        try:
            advice = scene.study.effect_significance(
                scene.preload,
                scene.interval,
                against=bd.Effects.of(scene.study),
                tolerance=scene.tolerance,
            )
        except bd.BdamperError as error:
            print(f"{scene.name}: no peak ({error})")
            continue
        seconds = time.process_time() - begin
        sets = {"all": advice.reference, "called for": advice.significant}
        both = {name: scene.study.replace(**effects) for name, effects in sets.items()}
        check = bd.compare(
            both,
            partial(bd.Study.frequency_response, preload=scene.preload, frequency=scene.interval),
        )
        within.append(right(scene, check))
        whole, lean = (curve.cost for curve in check.curves)
        costs.append(seconds / whole.seconds)
        work, speedup = (
            whole.evaluations / (lean.evaluations * advice.work),
            whole.seconds / lean.seconds,
        )
        if advice.missing_ranges:
            gains.append((speedup, work))
        amplitude, frequency = changes(check)
        print(
            f"{scene.name}, {100 * scene.tolerance:g} %: {len(advice.missing_ranges)} left out, "
            f"{100 * amplitude:+.2f} % {100 * frequency:+.2f} %"
            f"{'' if within[-1] else ' WRONG'}, {speedup:.1f} times as fast, advice {costs[-1]:.0f} peaks, "
            f"{seconds:.1f} s",
            flush=True,
        )
    speed, work = np.median(gains, axis=0)
    print(
        f"\n{sum(within)} of {len(within)} scenes within the tolerance; effects can be left out in {len(gains)}, where the "
        f"peak takes 1/{speed:.1f} of the time and 1/{work:.1f} of the operations in the median; the advice takes the time "
        f"of {np.median(costs):.0f} peaks in the median"
    )


def table() -> None:
    """Print a table for each mode and preload."""
    model = bd.reference_model("bladed_disk", 24)
    print(
        "## Effects: the reference bladed disk, 24 points a face, engine order 5, one effect off at a time\n"
    )
    for name, excitation, interval, preloads in SCENES:
        for preload in preloads:
            print(f"### {name}, {preload:g} N\n")
            print(
                "| off | unknowns | contact elements | evaluations | time | peak amplitude | peak frequency |"
            )
            print("|---|---|---|---|---|---|---|")
            whole = None
            for off, effects in OFF.items():
                study = bd.Study(
                    model,
                    excitation,
                    5,
                    friction_coefficient=0.4,
                    contact_stiffness="unit_traction",
                )
                study = study.replace(**EVERYTHING | effects)
                system = study.problem.system(preload)
                begin = time.process_time()
                curve = study.frequency_response(preload, interval)
                seconds = time.process_time() - begin
                peak = curve.peak
                if whole is None:
                    whole = (seconds, peak.amplitude, peak.frequency)
                    result = f"{seconds:.3f} s | {peak.amplitude:.4g} m | {peak.frequency:.2f} Hz"
                else:
                    result = (
                        f"x {seconds / whole[0]:.2f} | {100 * (peak.amplitude / whole[1] - 1):+.1f} % | "
                        f"{100 * (peak.frequency / whole[2] - 1):+.2f} %"
                    )
                note = "" if curve.complete else f" ({curve.status})"
                print(
                    f"| {off}{note} | {system.n_unknowns} | {system.n_points} | {curve.cost.evaluations} | {result} |"
                )
            print()


def main(n: int = 0) -> None:
    """Print the table of effects, or with a number of scenes what the advice is worth on them."""
    if n:
        agreement(n)
    else:
        table()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--scenes", type=int, default=0, help="how many random scenes the advice is checked on"
    )
    main(parser.parse_args().scenes)
