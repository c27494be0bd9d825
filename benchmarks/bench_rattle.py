"""Where a damper rattles: the sign of harmonic balance beside time integration.

``python -m benchmarks rattle`` makes ``benchmarks/results/rattle.json`` and prints what it holds.

* Optimal curves of the shipped disk (9 points, three harmonics, engine order 5, friction coefficient 0.4, 1 N) with
  unit tractions and with residual modes: the band without a steady response, with motions in time at three preloads in it
  and, with unit tractions, at one above.
* Scenes: the shipped disk with unit tractions, mode, direction of the excitation, friction coefficient and harmonics
  drawn with a stored seed, and lumped wedges between a mass and the ground.  At each preload a response curve is
  followed, which shows the sign or not, and the motion is integrated from its highest solution.  The response *moves* if
  the amplitudes of the periods spread over more than 2 % of their mean in the second half of them.  An alarm is false if
  the response does not move, a miss is a response that moves without the sign.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import bdamper as bd
from bdamper.response.events import ContinuationOptions
from bdamper.response.linear_limits import resonance_interval
from bdamper.response.optimal_curve import BUDGET
from bdamper.response.response_curve import NO_STEADY
from benchmarks import PLAIN

RESULTS = Path(__file__).parent / "results" / "rattle.json"
MOVES = 0.02
"""Spread of the amplitudes, relative to their mean, from which on a response moves."""
PERIODS = 250
SCENES = 8
ABOVE = 1.4
"""Preload over that of the band at which a steady response is looked for."""
BAND_PERIODS = {"unit tractions": 600, "residual modes": 150}
"""A damper without damping of its own goes on chattering for some hundred periods where it settles in the end."""


def bands(*names: str) -> Iterator[dict[str, Any]]:
    """The band without a steady response of two optimal curves, and motions in it and above."""
    disk = bd.reference_model("bladed_disk", 9)
    stiffness: dict[str, dict[str, Any]] = {
        "unit tractions": PLAIN | {"harmonics": 3},
        "residual modes": {"harmonics": 3},
    }
    for name in names or stiffness:
        settings = stiffness[name]
        study = bd.Study(disk, bd.Excitation("tip"), 5, friction_coefficient=0.4, **settings)
        begin = time.process_time()
        curve = study.optimal_curve(check=False)
        middle = time.process_time()
        steady = curve.requested & (curve.preload > curve.lowest_steady_preload)
        study.optimal_curve(curve.preload[steady], check=False)
        alone = time.process_time() - middle
        low = curve.preload[curve.preload <= curve.lowest_steady_preload]
        above = [ABOVE * curve.lowest_steady_preload] if name == "unit tractions" else []
        values = [
            motion_at(study, curve, p, BAND_PERIODS[name])
            for p in (*low[[0, len(low) // 2, -1]], *above)
        ]
        yield {"study": name, "below": curve.lowest_steady_preload, "seconds": middle - begin, "seconds_above": alone,
               "optimum": str(curve.optimum), "in time": values}  # fmt: skip


def motion_at(
    study: bd.Study, curve: bd.OptimalCurve, preload: float, periods: int
) -> dict[str, Any]:
    """Mean and range of a motion from the highest solution at a preload, at its frequency."""
    frequency = curve.settings["frequency"]
    tracked = study.frequency_response(
        float(preload), frequency, options=ContinuationOptions(budget=BUDGET)
    )
    frequency = float(tracked.frequency[np.argmax(tracked.amplitude)])
    found = study.motion_in_time(tracked, frequency=frequency, periods=periods)
    low, high = found.lowest, found.highest
    return {"preload": float(preload), "frequency": found.frequency, "mean": found.mean, "low": low, "high": high,
            "status": found.status}  # fmt: skip


def wedge(mass: float, harmonics: int) -> bd.Study:
    """A damper between an oscillator of 100 Hz and the ground, pressed against faces of 45 degrees."""
    c = np.sqrt(0.5)
    stiffness = {"kt": 0.8e7, "kn": 1e7, "mu": 0.3}
    faces = [
        bd.Contact({1: -c, 0: c, 2: c}, {1: c, 0: -c, 2: c}, **stiffness),
        bd.Contact({1: c, 2: c}, {1: -c, 2: c}, **stiffness),
    ]
    k = (200.0 * np.pi) ** 2
    return bd.lumped([1.0, mass, mass], [2e-3 * np.sqrt(k), 0.0, 0.0], [k, 0.0, 0.0], contacts=faces, forces={0: 1.0},
                     load_per_preload={2: 1.0}, harmonics=harmonics)  # fmt: skip


def scenes() -> Iterator[tuple[str, bd.Study, int]]:
    """Name, study and mode."""
    rng, disk = np.random.default_rng(5), bd.reference_model("bladed_disk", 9)
    for _ in range(SCENES):
        harmonics, mode = int(rng.choice([1, 3])), int(rng.integers(1, 5))
        direction, friction = str(rng.choice(["tangential", "axial"])), float(rng.uniform(0.2, 0.6))
        study = bd.Study(
            disk,
            bd.Excitation("tip", direction),
            5,
            friction_coefficient=friction,
            **PLAIN | {"harmonics": harmonics},
        )
        yield f"mode {mode}, {direction}, mu {friction:.2f}, H = {harmonics}", study, mode
    for harmonics in (1, 3):
        for mass in (0.02, 0.1):
            yield f"lumped wedge of {mass:g} kg, H = {harmonics}", wedge(mass, harmonics), 1


def signs() -> Iterator[dict[str, Any]]:
    """The sign at seven preloads of every scene, and how far the amplitudes in time spread."""
    for name, study, mode in scenes():
        frequency = resonance_interval(study.problem.at(1.0), mode)
        for preload in np.geomspace(4.0, 200.0, 7):
            curve = study.frequency_response(
                float(preload), frequency, options=ContinuationOptions(budget=BUDGET)
            )
            top = int(np.argmax(curve.amplitude))
            motion = study.motion_in_time(
                curve, frequency=float(curve.frequency[top]), periods=PERIODS
            )
            low, high = motion.lowest, motion.highest
            yield {"scene": name, "preload": float(preload), "sign": NO_STEADY in curve.reason,
                   "spread": (high - low) / motion.mean,
                   "time_response": motion.mean / float(curve.amplitude[top])}  # fmt: skip


def counts(found: list[dict[str, Any]]) -> str:
    """False alarms and misses."""
    alarms = [s for s in found if s["sign"]]
    false = sum(s["spread"] <= MOVES for s in alarms)
    quiet = [s for s in found if not s["sign"]]
    missed = [s for s in quiet if s["spread"] > MOVES]
    high = sum(s["time_response"] > 0.5 for s in missed)
    return (
        f"{len(found)} curves of {len({s['scene'] for s in found})} scenes: {len(alarms)} show the sign, {false} of them "
        f"with a steady response; of the other {len(quiet)} the response moves in {len(missed)}, in {high} of these at "
        "more than half of the amplitude of harmonic balance"
    )


def main() -> None:
    kept = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for name, make in (("bands", bands), ("signs", signs)):
        if name not in kept:
            kept[name] = list(make())
            RESULTS.write_text(json.dumps(kept, indent=0))
    for band in kept["bands"]:
        print(f"{band['study']}: {NO_STEADY} below {band['below']:.4g} N; {band['seconds']:.1f} s of processor time, "
              f"the curve above alone {band['seconds_above']:.1f} s; {band['optimum']}")  # fmt: skip
        for m in band["in time"]:
            spread = 100.0 * (m["high"] - m["low"]) / m["mean"]
            print(f"  {m['preload']:.4g} N, {m['frequency']:.5g} Hz: {m['mean']:.4g} m, {m['low']:.4g} to "
                  f"{m['high']:.4g} m, spread {spread:.2g} %")  # fmt: skip
    print(counts(kept["signs"]))


if __name__ == "__main__":
    main()
