"""How often a peak with more harmonics is said to be converged, and how often that holds, on random ordinary scenes.

``python -m benchmarks.convergence_scenes [first last]`` runs the scenes of these numbers (0 to 199 by default) and prints
one line each and a summary; ``make accuracy`` writes the summary into docs/evidence/measured.md.

A scene is the shipped bladed disk with nine contact points a face (two of three scenes) or the test rig with 24, with unit
tractions, one of the modes 1 to 4, an excitation along the circumference or the axis, a friction coefficient of 0.2 to 0.6,
a preload of 60 to 25,000 N per newton of excitation and a tolerance of 1 %, 2 % or 5 %.  Its number is the seed.

"Converged" and "agrees so far" hold if the peak of a whole curve with thirteen harmonics agrees with the answer to the
tolerance, "not converged" if it does not.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

import bdamper as bd
from bdamper.response.linear_limits import resonance_interval
from bdamper.response.verification import Convergence
from benchmarks import PLAIN

SCENES = 200
REFERENCE = 13
"""Harmonics of the curve that claims are checked against."""
ASKED = (3, 5, 7, 9, 12)


@dataclass(frozen=True)
class Scene:
    """One scene: a study with one harmonic, and the peak that is asked of it."""

    number: int
    study: bd.Study
    preload: float
    interval: tuple[float, float]
    tolerance: float
    text: str


@dataclass(frozen=True)
class Outcome:
    """The peak of a scene with more harmonics, and the highest point of the reference curve, NaN if it is incomplete."""

    scene: Scene
    convergence: Convergence
    reference: float
    seconds: float

    @property
    def holds(self) -> bool:
        """Whether the reference is within the tolerance of the answer, or beyond it where that is not converged."""
        near = (
            abs(self.convergence.peaks[0].amplitude / self.reference - 1.0) <= self.scene.tolerance
        )
        return bool(near == (len(self.convergence.settled) == len(self.convergence.peaks)))


@lru_cache
def _model(name: str) -> bd.Model:
    return bd.reference_model(name, 9 if name == "bladed_disk" else 24)


def draw(number: int) -> Scene:
    """The scene of a number."""
    rng = np.random.default_rng([21, number])
    name = str(rng.choice(["bladed_disk", "bladed_disk", "test_rig"]))
    mode, direction = int(rng.integers(1, 5)), str(rng.choice(["tangential", "axial"]))
    friction, preload = (
        float(rng.uniform(0.2, 0.6)),
        float(np.exp(rng.uniform(np.log(60.0), np.log(25e3)))),
    )
    tolerance = float(rng.choice([0.01, 0.02, 0.05]))
    order = 5 if name == "bladed_disk" else 1
    study = bd.Study(
        _model(name), bd.Excitation("tip", direction), order, friction_coefficient=friction, **PLAIN
    )
    text = f"{name}, mode {mode}, {direction}, mu {friction:.2f}, {preload:.4g} N, {100.0 * tolerance:g} %"
    return Scene(
        number, study, preload, resonance_interval(study.problem.at(1.0), mode), tolerance, text
    )


def run(scene: Scene) -> Outcome:
    """The peak of a scene with one to twelve harmonics, and the whole curve with thirteen."""
    peak = scene.study.peak(scene.preload, scene.interval)
    begin = time.process_time()
    found = scene.study.harmonic_convergence(peak, harmonics=ASKED, tolerance=scene.tolerance)
    seconds = time.process_time() - begin
    full = scene.study.replace(harmonics=REFERENCE).peak(scene.preload, scene.interval)
    whole = full.ok and full.search_status == "complete"
    return Outcome(scene, found, full.amplitude if whole else np.nan, seconds)


def table(first: int = 0, last: int = SCENES - 1) -> str:
    """Runs scenes and returns a summary in Markdown."""
    outcomes, none = [], 0
    for number in range(first, last + 1):
        scene = draw(number)
        try:
            o = run(scene)
        except bd.BdamperError as error:
            none += 1
            print(f"{number}: {scene.text}: no peak ({error})", flush=True)
            continue
        outcomes.append(o)
        print(
            f"{number}: {scene.text}: {o.convergence.note}; reference {o.reference:.4g} m; {o.seconds:.2f} s",
            flush=True,
        )
    checked = [o for o in outcomes if np.isfinite(o.reference)]
    kinds = {
        "converged": [o for o in checked if o.convergence.ok],
        "not converged": [
            o for o in checked if len(o.convergence.settled) < len(o.convergence.peaks)
        ],
        "agrees so far": [
            o
            for o in checked
            if 1 < len(o.convergence.peaks) == len(o.convergence.settled) and not o.convergence.ok
        ],
        "not known": [o for o in checked if len(o.convergence.peaks) == 1],
    }
    lines = [
        f"Of {last - first + 1} scenes (seeds {first} to {last}) {none} have no peak in the interval; the reference of "
        f"{len(outcomes) - len(checked)} is incomplete.",
        "",
        "| the result says | scenes | hold | seconds, median |",
        "|---|---|---|---|",
    ]
    for name, own in kinds.items():
        middle = float(np.median([o.seconds for o in own])) if own else np.nan
        lines.append(f"| {name} | {len(own)} | {sum(o.holds for o in own)} | {middle:.2g} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "numbers", nargs="*", type=int, default=[0, SCENES - 1], help="first and last scene"
    )
    print(table(*parser.parse_args().numbers))


if __name__ == "__main__":
    main()
