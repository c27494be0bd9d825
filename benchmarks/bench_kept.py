"""Amplitude in time of the blade on the ground beside peaks with more modes and harmonics.

``python -m benchmarks kept`` computes the missing entries of ``results/kept.json`` and prints the table of in-time.md.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

import bdamper as bd

RESULTS = Path(__file__).parent / "results" / "kept.json"
MODES = (3, 6, 7, 10)
"""Blade modes of the response curve; fewer than ten without the inertia of those that are left out."""


def on_the_ground(modes: int) -> dict[str, Any]:
    """Peaks with more and more harmonics at 800 N, and the amplitude in time from the curve with three harmonics."""
    model = bd.reference_model("blade_to_ground")
    z = model.interfaces["platform"].points[:, 2]
    share = 1.0 + 1.1 * z / np.abs(z).max()
    loads = {"platform": 800.0 * share / share[share > 0.0].sum()}
    tip, plain = bd.Excitation("tip", direction="tangential"), bd.ResidualModes(inertia=modes == 10)
    free = bd.Study(
        model, tip, friction_coefficient=0.4, blade_modes=modes, contact_stiffness=plain
    )
    held = free.replace(constant_loads=loads)
    curves = {
        n: held.replace(harmonics=n).frequency_response(0.0, (260.0, 400.0))
        for n in (3, 5, 7, 9, 13)
    }
    found = held.time_response(curves[3])
    sizes = {
        "mean": found.mean,
        "lowest": found.lowest,
        "highest": found.highest,
        "balance": found.balance,
    }
    return {
        **{name: 1e6 * size for name, size in sizes.items()}, "frequency": found.frequency, "fall": found.jump_frequency,
        "structure": found.structure, "periods": found.periods, "status": found.status, "processor": found.cost.processor,
        "peaks": {str(n): 1e6 * float(curve.amplitude.max()) for n, curve in curves.items()},
    }  # fmt: skip


def main() -> None:
    """Compute what is missing, and print the table."""
    known = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for modes in MODES:
        if str(modes) not in known:
            begin = time.process_time()
            known[str(modes)] = {
                **on_the_ground(modes),
                "seconds": round(time.process_time() - begin, 1),
            }
            RESULTS.write_text(json.dumps(known, indent=1) + "\n")
    print(
        "\n| blade modes | 3 harmonics (mm) | 5 | 7 | 9 | 13 | in time | jumps at |\n"
        + "|---" * 8
        + "|"
    )
    for modes in MODES:
        r = known[str(modes)]
        peaks = " | ".join(f"{peak / 1e3:.2f}" for peak in r["peaks"].values())
        span = f"{r['mean'] / 1e3:.2f} ({r['lowest'] / 1e3:.2f} to {r['highest'] / 1e3:.2f})"
        print(f"| {modes} | {peaks} | {span} | {r['fall']:.1f} Hz |")


if __name__ == "__main__":
    main()
