"""What a blade keeps at one preload, by the walk of ``study.time_response``, beside balances with more modes or patterns.

``python -m benchmarks kept`` computes what ``results/kept.json`` does not have yet and prints two tables: the blade on the
ground, of a single sector, and the turbine blade at preloads at which its blades vibrate alike.
``python -m benchmarks.bench_kept NAME ...`` computes single ones, ``show`` none.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import bdamper as bd

RESULTS = Path(__file__).parent / "results" / "kept.json"
GROUND = {f"blade on the ground, {modes} modes": modes for modes in (3, 6, 7, 10)}
"""Blade modes, without the inertia of those that are left out up to nine."""
TYPICAL = {f"typical blade, {preload:g} N, {n} patterns": (n, preload) for preload in (103.6, 518.0) for n in (6, 12, 24)}
"""Residual patterns, at the optimum of the typical blade and at five times that preload."""


def record(time_response: Any) -> dict[str, Any]:
    return {
        "mean": 1e6 * time_response.mean, "lowest": 1e6 * time_response.lowest, "highest": 1e6 * time_response.highest,
        "frequency": time_response.frequency,
        "fall": time_response.fall, "balance": 1e6 * time_response.balance, "periods": time_response.periods,
        "status": time_response.status, "processor": time_response.cost.processor,
    }  # fmt: skip


def on_the_ground(name: str) -> dict[str, Any]:
    """What the blade on the ground keeps at 800 N, and its peaks with more and more harmonics."""
    modes, model = GROUND[name], bd.reference_model("blade_to_ground")
    z = model.interfaces["platform"].points[:, 2]
    share = 1.0 + 1.1 * z / np.abs(z).max()
    loads = {"platform": 800.0 * share / share[share > 0.0].sum()}
    tip, plain = bd.Excitation("tip", direction="tangential"), bd.ResidualModes(inertia=modes == 10)
    free = bd.Study(model, tip, friction_coefficient=0.4, blade_modes=modes, contact_stiffness=plain)
    held = free.replace(constant_loads=loads)
    curves = {n: held.replace(harmonics=n).frequency_response(0.0, (260.0, 400.0)) for n in (3, 5, 7, 9, 13)}
    tops = {str(n): 1e6 * float(curve.amplitude.max()) for n, curve in curves.items()}
    return {**record(held.time_response(curves[3])), "tops": tops}


def on_the_typical_blade(name: str) -> dict[str, Any]:
    """Peak and what is kept of it with so many residual patterns."""
    patterns, preload = TYPICAL[name]
    given = {"friction_coefficient": 0.3, "contact_stiffness": bd.ResidualModes(patterns)}
    of = bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, **given)
    of.problem.system(preload)
    begin = time.process_time()
    curve = of.frequency_response(preload, (600.0, 720.0))
    return {"curve": time.process_time() - begin, **record(of.time_response(curve))}


def motion(r: dict[str, Any]) -> str:
    """What is kept, in a cell of a table."""
    return f"{r['mean']:.1f} ({r['lowest']:.1f} to {r['highest']:.1f}) at {r['frequency']:.1f} Hz"


def main() -> None:
    """Compute what is missing, and print the tables."""
    known = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    asked = sys.argv[1:] if sys.argv[0].endswith("bench_kept.py") else []
    jobs = dict.fromkeys(GROUND, on_the_ground) | dict.fromkeys(TYPICAL, on_the_typical_blade)
    for name, function in jobs.items():
        if name not in known and (not asked or name in asked):
            begin = time.process_time()
            known[name] = {**function(name), "seconds": round(time.process_time() - begin, 1)}
            RESULTS.write_text(json.dumps(known, indent=1) + "\n")
            print(name, known[name], flush=True)
    print("\n| typical blade | peak of the balance (\u00b5m) | kept | time of a curve (s) |\n|---|---|---|---|")
    for name in TYPICAL:
        if r := known.get(name):
            print(f"| {name} | {r['balance']:.1f} | {motion(r)} | {r['curve']:.1f} |")
    print("\n| blade modes | 3 harmonics (mm) | 5 | 7 | 9 | 13 | in time | jumps at |\n" + "|---" * 8 + "|")
    for name in GROUND:
        if r := known.get(name):
            tops = " | ".join(f"{top / 1e3:.2f}" for top in r["tops"].values())
            print(f"| {GROUND[name]} | {tops} | {r['mean'] / 1e3:.2f} | {r['fall']:.1f} Hz |")


if __name__ == "__main__":
    main()
