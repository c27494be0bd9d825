"""How often the choice of harmonics for a tolerance converges, and how often its claim holds, on random ordinary scenes.

``python -m benchmarks.tolerance_scenes [first last]`` runs the scenes of these numbers (0 to 199 by default) and prints one
line each and a summary; ``make accuracy`` writes the summary into docs/accuracy.md.

A scene is the shipped bladed disk with nine contact points a face (two of three scenes) or the test rig with 24, with unit
tractions, one of the modes 1 to 4, an excitation along the circumference or the axis, a friction coefficient of 0.2 to 0.6,
a preload of 60 to 25,000 N per newton of excitation and a tolerance of 1 %, 2 % or 5 %.  Its number is the seed.

A claim holds if the highest point of the curve agrees with that of the curve with nine harmonics to the tolerance.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

import bdamper as bd
from bdamper.accuracy.tolerance import Rung
from bdamper.peaks.scan import resonance_interval

SCENES = 200
REFERENCE = 9
"""Harmonics of the curve that claims are checked against."""


@dataclass(frozen=True)
class Scene:
    """One scene: a study with one harmonic, and the curve that is asked of it."""

    number: int
    study: bd.Study
    preload: float
    interval: tuple[float, float]
    tolerance: float
    text: str


@dataclass(frozen=True)
class Outcome:
    """What the rule says of a scene, and whether that holds.

    Parameters
    ----------
    converged : bool
        What the rule claims.
    error : float
        Against nine harmonics; NaN if their curve is incomplete.
    """

    scene: Scene
    converged: bool
    error: float
    rungs: tuple[Rung, ...]
    seconds: float
    note: str

    @property
    def holds(self) -> bool:
        return bool(self.error <= self.scene.tolerance)


@lru_cache
def _model(name: str) -> bd.Model:
    return bd.reference_model(name, 9 if name == "bladed_disk" else 24)


def draw(number: int) -> Scene:
    """The scene of a number."""
    rng = np.random.default_rng([21, number])
    name = str(rng.choice(["bladed_disk", "bladed_disk", "test_rig"]))
    mode, direction = int(rng.integers(1, 5)), str(rng.choice(["tangential", "axial"]))
    friction, preload = float(rng.uniform(0.2, 0.6)), float(np.exp(rng.uniform(np.log(60.0), np.log(25e3))))
    tolerance = float(rng.choice([0.01, 0.02, 0.05]))
    order = 5 if name == "bladed_disk" else 1
    study = bd.Study(_model(name), bd.Excitation("tip", direction), order, friction_coefficient=friction)
    text = f"{name}, mode {mode}, {direction}, mu {friction:.2f}, {preload:.4g} N, {100.0 * tolerance:g} %"
    return Scene(number, study, preload, resonance_interval(study, mode), tolerance, text)


def run(scene: Scene) -> Outcome:
    """The rule on a scene, and the curve with nine harmonics if it is not among those that the rule has computed."""
    begin = time.process_time()
    curve = scene.study.track(scene.preload, scene.interval, tolerance=scene.tolerance)
    seconds = time.process_time() - begin
    chosen = curve.settings["chosen"]
    rungs = tuple(Rung(**r) for r in chosen["rungs"])
    reference = next((r for r in rungs if r.harmonics == REFERENCE), None)
    if reference is None:
        full = scene.study.with_(harmonics=REFERENCE).track(scene.preload, scene.interval)
        reference = Rung(REFERENCE, *((full.peak.amplitude, full.peak.frequency) if full.complete else ()))
    own = next(r for r in rungs if r.harmonics == chosen["harmonics"][-1])
    error = own.difference(reference) if np.isfinite(reference.amplitude) and not reference.incomplete else np.nan
    return Outcome(scene, chosen["converged"], error, rungs, seconds, chosen["note"])


def table(first: int = 0, last: int = SCENES - 1) -> str:
    """Runs scenes and returns a summary in Markdown."""
    outcomes = []
    for number in range(first, last + 1):
        o = run(draw(number))
        outcomes.append(o)
        print(f"{number}: {o.scene.text}: {o.note}; against nine harmonics {o.error:.2g}; {o.seconds:.2f} s", flush=True)
    claims = [o for o in outcomes if o.converged]
    checked = [o for o in claims if np.isfinite(o.error)]
    lines = [
        f"Of {len(outcomes)} scenes {len(claims)} converged; of {len(checked)} claims that could be checked "
        f"{sum(o.holds for o in checked)} hold against nine harmonics.",
        "",
        "| harmonics of the result | converged | hold | seconds, median |",
        "|---|---|---|---|",
    ]
    for n in sorted({o.rungs[-1].harmonics for o in outcomes}):
        own = [o for o in outcomes if o.rungs[-1].harmonics == n]
        good = [o for o in own if o.converged]
        middle = float(np.median([o.seconds for o in own]))
        lines.append(f"| {n} | {len(good)} of {len(own)} | {sum(o.holds for o in good)} | {middle:.2g} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("numbers", nargs="*", type=int, default=[0, SCENES - 1], help="first and last scene")
    print(table(*parser.parse_args().numbers))


if __name__ == "__main__":
    main()
