"""How often the ladder of harmonics to a tolerance converges, and how often its claim holds, on random ordinary scenes.

``python -m benchmarks.tolerance_scenes [first last]`` runs the scenes of these numbers (0 to 199 by default) and prints one
line each and a summary; ``make accuracy`` writes the summary into docs/measured.md.

A scene is the shipped bladed disk with nine contact points a face (two of three scenes) or the test rig with 24, with unit
tractions, one of the modes 1 to 4, an excitation along the circumference or the axis, a friction coefficient of 0.2 to 0.6,
a preload of 60 to 25,000 N per newton of excitation and a tolerance of 1 %, 2 % or 5 %.  Its number is the seed.

A claim holds if the highest point of the curve agrees with that of the curve with thirteen harmonics to the tolerance; a
range, where the ladder says "not converged", if it contains that amplitude.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

import bdamper as bd
from bdamper.peaks.interval import resonance_interval
from bdamper.util.ladder import Ladder, Rung
from benchmarks import PLAIN

SCENES = 200
REFERENCE = 13
"""Harmonics of the curve that claims are checked against, two more than the ladder has from one harmonic on."""


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
    """What the ladder of a scene says, and whether that holds against the reference (NaN if its curve is incomplete)."""

    scene: Scene
    ladder: Ladder
    reference: Rung
    seconds: float

    @property
    def error(self) -> float:
        """Of the answer, relative to the reference; the larger of amplitude and frequency."""
        own = next(r for r in self.ladder.rungs if r.harmonics == self.ladder.answer)
        return max(abs(own.amplitude / self.reference.amplitude - 1.0), abs(own.frequency / self.reference.frequency - 1.0))

    @property
    def holds(self) -> bool:
        if self.ladder.converged:
            return bool(self.error <= self.scene.tolerance)
        low, high = self.ladder.range
        return bool(low <= self.reference.amplitude <= high)


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
    study = bd.Study(_model(name), bd.Excitation("tip", direction), order, friction_coefficient=friction, **PLAIN)
    text = f"{name}, mode {mode}, {direction}, mu {friction:.2f}, {preload:.4g} N, {100.0 * tolerance:g} %"
    return Scene(number, study, preload, resonance_interval(study, mode), tolerance, text)


def run(scene: Scene) -> Outcome:
    """The ladder of a scene, and the curve with thirteen harmonics."""
    begin = time.process_time()
    curve = scene.study.track(scene.preload, scene.interval, tolerance=scene.tolerance)
    seconds = time.process_time() - begin
    full = scene.study.with_(harmonics=REFERENCE).track(scene.preload, scene.interval)
    top = (full.peak.amplitude, full.peak.frequency) if full.complete else ()
    return Outcome(scene, curve.ladder, Rung(REFERENCE, scene.preload, *top), seconds)


def table(first: int = 0, last: int = SCENES - 1) -> str:
    """Runs scenes and returns a summary in Markdown."""
    outcomes = []
    for number in range(first, last + 1):
        o = run(draw(number))
        outcomes.append(o)
        against = f"against {REFERENCE} harmonics {o.error:.2g}" if o.reference.known else "reference incomplete"
        print(f"{number}: {o.scene.text}: {o.ladder.note}; {against}; {o.seconds:.2f} s", flush=True)
    checked = [o for o in outcomes if o.reference.known]
    claims, ranges = ([o for o in checked if o.ladder.converged is c] for c in (True, False))
    lines = [
        f"Of {len(outcomes)} scenes {sum(o.ladder.converged for o in outcomes)} converged; of {len(claims)} claims that "
        f"could be checked {sum(o.holds for o in claims)} hold against {REFERENCE} harmonics, of {len(ranges)} ranges "
        f"{sum(o.holds for o in ranges)} contain it.",
        "",
        "| harmonics of the result | converged | hold | seconds, median |",
        "|---|---|---|---|",
    ]
    for n in sorted({o.ladder.answer for o in checked}):
        own = [o for o in checked if o.ladder.answer == n]
        good = [o for o in own if o.ladder.converged]
        middle = float(np.median([o.seconds for o in own]))
        lines.append(f"| {n} | {len(good)} of {len(own)} | {sum(o.holds for o in good)} | {middle:.2g} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("numbers", nargs="*", type=int, default=[0, SCENES - 1], help="first and last scene")
    print(table(*parser.parse_args().numbers))


if __name__ == "__main__":
    main()
