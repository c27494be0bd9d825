"""Whether the peak of the default study at 500 N is kept in time, refined one setting after the other.

``python -m benchmarks peak_in_time`` computes what is missing in ``benchmarks/results/peak_in_time.json``, prints a table.

The shipped disk with nine contact points a face, engine order 5, friction coefficient 0.4, 1 N at the tip, 500 N: a march
of 240 periods from the highest solution of the tracking curve, at its frequency.  Steps are finer than the default by a
factor, harmonics bring the modes of their nodal diameters along, and damping is that of the damper on its closed contacts.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

import bdamper as bd

RESULTS = Path(__file__).parent / "results" / "peak_in_time.json"
PRELOAD, BAND, PERIODS = 500.0, (310.0, 372.0), 240
CASES: dict[str, tuple[dict[str, Any], int]] = {
    "default": ({}, 1),
    "steps twice as fine": ({}, 2),
    "five harmonics": ({"harmonics": 5}, 1),
    "damping of the damper 0.002": ({"damper_damping_ratio": 0.002}, 1),
    "damping of the damper 0.01": ({"damper_damping_ratio": 0.01}, 1),
    "unit tractions, 40 blade modes": ({"contact_stiffness": "unit_traction", "blade_modes": 40}, 1),
    "unit tractions, 10 blade modes": ({"contact_stiffness": "unit_traction", "blade_modes": 10}, 1),
    "six harmonics": ({"harmonics": 6}, 1),
    "steps four times as fine": ({}, 4),
}


def march(settings: dict[str, Any], finer: int) -> dict[str, Any]:
    """Peak of the curve, and mean and range of the amplitude over the second half of the march."""
    study = bd.Study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, friction_coefficient=0.4, **settings)
    curve = study.track(PRELOAD, BAND)
    frequency = curve.peak.frequency
    steps = study.settle(curve, frequency, periods=16).steps_per_period if finer > 1 else None
    found = study.settle(curve, frequency, periods=PERIODS, steps_per_period=steps and finer * steps)
    half = found.amplitude[PERIODS // 2 :]
    return {
        "complete": curve.complete, "peak": curve.peak.amplitude, "frequency": frequency, "steps": found.steps_per_period,
        "mean": float(half.mean()), "low": float(half.min()), "high": float(half.max()), "status": found.status,
        "start": [float(f"{a:.5g}") for a in found.amplitude[:: PERIODS // 12]],
    }  # fmt: skip


def main() -> None:
    """Compute what is missing, and print a table."""
    kept = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for name, case in CASES.items():
        if name not in kept:
            begin = time.process_time()
            kept[name] = {**march(*case), "seconds": round(time.process_time() - begin, 1)}
            RESULTS.write_text(json.dumps(kept, indent=1) + "\n")
            print(name, kept[name], flush=True)
    print("| | steps a period | peak (µm at Hz) | in time (µm) | difference | time (s) |\n|---|---|---|---|---|---|")
    for name, r in kept.items():
        low, mean, high = (1e6 * np.array([r["low"], r["mean"], r["high"]])).round(1)
        change = 100.0 * (r["mean"] / r["peak"] - 1.0)
        print(f"| {name} | {r['steps']} | {1e6 * r['peak']:.1f} at {r['frequency']:.2f} | {mean} ({low} to {high}) | "
              f"{change:+.1f} % | {r['seconds']:.0f} |")  # fmt: skip


if __name__ == "__main__":
    main()
