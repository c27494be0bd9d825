"""Scenes in which blades of a tuned wheel do not vibrate alike, and what the march in time says of them.

``python -m benchmarks blades`` prints, in some ten minutes of the processor:

* the hard disk at a friction coefficient of 0.23, engine order 5 and 78.6 N, marched down from 322 to 310 Hz in steps of
  one hertz: amplitudes of all blades at each frequency;
* the answers of ``study.march`` on the turbine blade at 0.496, engine order 10 and 38.5 N with rings of six and of twelve
  blades, and at 0.54, engine order 5 and 43.7 N: first lines, answers, waves and energies.
"""

from __future__ import annotations

import time
from math import tau
from pathlib import Path

import numpy as np

import bdamper as bd
from bdamper.plot import save_figure
from bdamper.stability.kept import RULES, Levels, of_blades
from bdamper.stability.march import March
from bdamper.stability.time_integration import STEPS, ring_of

IMAGE = Path(__file__).parents[1] / "docs" / "images" / "in-time-ring.png"
"""Of the ring of twelve blades at engine order 10."""
BLADE = bd.Excitation("tip", "tangential", 1.0)
DOWN = np.arange(322.0, 309.9, -1.0)
"""Hz."""


def turbine(friction: float, order: int) -> bd.Study:
    return bd.Study(bd.reference_model("turbine_blade"), BLADE, order, friction_coefficient=friction)


def down() -> None:
    """The hard disk downward: all blades at each frequency, from one motion to the next."""
    study = bd.Study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, friction_coefficient=0.23)
    curve = study.track(78.6, (285.0, 380.0))
    ring, begin = ring_of(study.problem, 78.6), time.process_time()
    start = ring.start(Levels(curve).start(DOWN[0]), tau * DOWN[0], STEPS)
    march = March(ring, tau * DOWN[0], ring.seeded(start, RULES.seed, 0))
    march.run(120)
    print(
        "| Hz | amplitudes of all blades, \u00b5m (last 40 periods) | waves, \u00b5m | missing energy |\n|---|---|---|---|"
    )
    for before, f in zip((DOWN[0], *DOWN), DOWN):
        motion, march = march.motion, March(ring, tau * f, march.motion)
        if f < before:
            march.sweep((tau * before, tau * f), RULES.brief, lambda: None)
            motion = march.motion
        march = March(ring, tau * f, motion)
        march.run(80)
        said = of_blades(march, RULES.window)
        blades = ", ".join(f"{1e6 * a:.1f}" for a in said["blades"].mean(axis=0))
        waves = ", ".join(f"{d:.0f}: {1e6 * a:.1f}" for d, a in said["waves"][:3])
        work, *losses = said["energy"]
        print(f"| {f:g} | {blades} | {waves} | {(work - sum(losses)) / work:.2%} |", flush=True)
    print(f"\n{time.process_time() - begin:.0f} s of the processor\n")


def main() -> None:
    down()
    for friction, order, preload, blades in ((0.496, 10, 38.5, 6), (0.496, 10, 38.5, 12), (0.54, 5, 43.7, 12)):
        study = turbine(friction, order)
        found = study.march(study.track(preload, (600.0, 720.0)), blades=blades)
        if (order, blades) == (10, 12):
            save_figure(found.plot().figure, IMAGE)
        print(f"mu {friction:g}, engine order {order}, {preload:g} N, {blades} blades\n\n{found.details()}\n")
        print("blades, \u00b5m: " + ", ".join(f"{1e6 * a:.1f}" for a in found.blades.mean(axis=0)) + "\n", flush=True)


if __name__ == "__main__":
    main()
