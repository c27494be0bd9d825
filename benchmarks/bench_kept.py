"""What a blade keeps at one preload, by the walk of ``study.kept``: the shipped disk, and drawn scenes beside slow sweeps.

``python -m benchmarks kept`` computes what ``results/kept.json`` does not have yet and prints two tables: the cases of
``docs/measured.md`` at the default step and at half of it, and scenes that are drawn before any of them is marched (seed
:data:`SEED`), each beside a sweep of ``study.sweep_in_time`` down or up along the same branch, from far.
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
from bdamper.stability.kept import Levels
from bdamper.stability.march import March
from bdamper.stability.time_integration import ring_of
from benchmarks.bench_hard_curves import study as hard_study

RESULTS = Path(__file__).parent / "results" / "kept.json"
SEED, SCENES = 38, 20
BAND = {5: (285.0, 380.0), 10: (285.0, 380.0), 13: (285.0, 380.0)}
CASES = {
    "residual modes, mu 0.4, 103.5 N": ("residual_modes", 0.4, 103.5, 55.0),
    "residual modes, mu 0.4, 125 N": ("residual_modes", 0.4, 125.0, 58.0),
    "residual modes, mu 0.4, 500 N": ("residual_modes", 0.4, 500.0, 155.0),
    "unit tractions, mu 0.4, 125 N": ("unit_traction", 0.4, 125.0, 97.0),
    "unit tractions, mu 0.4, 500 N": ("unit_traction", 0.4, 500.0, 151.0),
    "residual modes, mu 0.23, 78.6 N": ("residual_modes", 0.23, 78.6, 29.0),
}
"""Contact stiffness, friction coefficient, preload (N), and the mean (\u00b5m) that an independent march has kept."""


SLOWLY = {
    "unit tractions, mu 0.4, 500 N, slow sweep": ("unit tractions, mu 0.4, 500 N", (339.0, 350.0), 1.5),
    "residual modes, mu 0.23, 78.6 N, slow sweep": ("residual modes, mu 0.23, 78.6 N", (310.0, 326.0), 3.0),
}
"""Case, frequencies and rate (Hz/s) of slow sweeps of the two cases that differ from the independent march."""
STARTED = {
    f"unit tractions, mu 0.4, 500 N, from the balance/{n}": ("unit tractions, mu 0.4, 500 N", 342.4, n) for n in (512, 1664)
}
"""Case, frequency and steps a period of motions that start from the harmonic balance."""
AGAIN = {f"unit tractions, mu 0.4, 125 N, again {k}": ("unit tractions, mu 0.4, 125 N", k) for k in range(1, 5)}
CELLS = {f"{preload:g} N, {points} points": (points, preload) for preload in (20.0, 50.0) for points in (9, 24, 48)}
"""Of ``bench_hard_curves``: three harmonics, unit tractions, the lowest preloads, where the damper nearly flies."""
GROUND = {f"blade on the ground, {modes} modes": modes for modes in (3, 6, 7, 10)}
"""Blade modes, without the inertia of those that are left out up to nine."""
TYPICAL = {f"typical blade, {preload:g} N, {n} patterns": (n, preload) for preload in (103.6, 518.0) for n in (6, 12, 24)}
"""Residual patterns, at the optimum of the typical blade and at five times that preload."""


def study(stiffness: str, friction: float, engine_order: int = 5) -> bd.Study:
    return bd.Study(
        bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), engine_order, friction_coefficient=friction,
        contact_stiffness=stiffness,
    )  # fmt: skip


def scenes() -> dict[str, tuple[str, float, int, float]]:
    """Contact stiffness, friction coefficient, engine order and preload (N) of the scenes, by name."""
    rng, out = np.random.default_rng(SEED), {}
    for k in range(SCENES):
        stiffness, order = ("residual_modes", "unit_traction")[int(rng.integers(2))], (5, 10)[int(rng.integers(2))]
        friction = round(float(rng.uniform(0.1, 0.6)), 2)
        preload = round(float(60.0 / np.sqrt(friction) * np.exp(rng.uniform(0.0, np.log(8.0)))), 1)
        out[f"scene {k}"] = stiffness, friction, order, preload
    return out


def walked(name: str, steps: int) -> dict[str, Any]:
    """A case at so many steps a period."""
    stiffness, friction, preload, expected = CASES[name]
    of = study(stiffness, friction)
    curve = of.track(preload, BAND[5])
    return {**record(of.kept(curve, steps_per_period=steps)), "expected": expected}


def record(kept: Any) -> dict[str, Any]:
    return {
        "mean": 1e6 * kept.mean, "lowest": 1e6 * kept.lowest, "highest": 1e6 * kept.highest, "frequency": kept.frequency,
        "fall": kept.fall, "balance": 1e6 * kept.balance, "direction": kept.direction, "periods": kept.periods,
        "status": kept.status, "processor": kept.cost.processor,
    }  # fmt: skip


def slowly(name: str) -> dict[str, Any]:
    """A case in a slow sweep down, in steps of half the length: means and ranges (\u00b5m) of each half hertz."""
    case, ends, rate = SLOWLY[name]
    stiffness, friction, preload, _ = CASES[case]
    of = study(stiffness, friction)
    start = of.track(preload, BAND[5])
    sweep = of.sweep_in_time(preload, ends, up=False, rate=rate, check=False, start=start, steps_per_period=512)
    means = np.convolve(sweep.amplitude, np.ones(80) / 80, "valid")
    k, out = int(means.argmax()), {}
    for f in np.arange(ends[0], ends[1] + 0.1, 0.5):
        there = 1e6 * sweep.amplitude[np.abs(sweep.frequency - f) < 0.25]
        out[f"{f:.1f}"] = [float(there.mean()), float(there.min()), float(there.max())]
    return {"highest": 1e6 * float(means[k]), "at": float(sweep.frequency[k + 40]), "means": out}


def from_the_balance(name: str) -> dict[str, Any]:
    """Means and ranges (\u00b5m) of each 80 periods at one frequency, from the solution with three harmonics."""
    case, frequency, steps = STARTED[name]
    stiffness, friction, preload, _ = CASES[case]
    of = study(stiffness, friction)
    levels = Levels(of.track(preload, BAND[5]))
    march = March(ring_of(of, preload), 2.0 * np.pi * frequency, levels.start(frequency), steps)
    march.run(480)
    means = [[float(a.mean()), float(a.min()), float(a.max())] for a in 1e6 * march.amplitude.reshape(-1, 80)]
    return {"balance": 1e6 * float(levels.at(frequency)[0]), "means": means}


def again(name: str) -> dict[str, Any]:
    """A case at a preload that differs by so little that rounding alone decides."""
    case, k = AGAIN[name]
    stiffness, friction, preload, _ = CASES[case]
    of = study(stiffness, friction)
    return record(of.kept(of.track(preload * (1.0 + 1e-7 * k), BAND[5])))


def beside_a_sweep(name: str) -> dict[str, Any]:
    """What is kept in a scene, and the highest mean of 80 periods in a slow sweep from far along the same way.

    The sweep begins at the highest solution at its first frequency, where the march settles first.
    """
    stiffness, friction, order, preload = scenes()[name]
    of = study(stiffness, friction, order)
    curve = of.track(preload, BAND[order])
    found = of.kept(curve)
    out = {"scene": [stiffness, friction, order, preload], **record(found)}
    if not found.marched or not np.isfinite(found.mean):
        return out
    tip, away = found.frequency, 8.0
    ends = (tip - away, tip + away / 2.0) if found.direction == "up" else (tip - away / 2.0, tip + away)
    sweep = of.sweep_in_time(preload, ends, up=found.direction == "up", rate=4.0, check=False, start=curve)
    window = 80
    means = np.convolve(sweep.amplitude, np.ones(window) / window, "valid")
    k = int(means.argmax())
    return {**out, "sweep": 1e6 * float(means[k]), "sweep_at": float(sweep.frequency[k + window // 2]),
            "sweep_processor": sweep.cost.processor}  # fmt: skip


def in_a_cell(name: str) -> dict[str, Any]:
    """What is kept in one of the cells of ``bench_hard_curves`` where dampers nearly fly."""
    points, preload = CELLS[name]
    of = hard_study(points, 3, "on")
    curve = of.track(preload, (250.0, 400.0))
    return {**record(of.kept(curve)), "curve": f"{curve.status}, {len(curve.folds)} folds"}


def on_the_ground(name: str) -> dict[str, Any]:
    """What the blade on the ground keeps at 800 N, and its peaks with more and more harmonics."""
    modes, model = GROUND[name], bd.reference_model("blade_to_ground")
    z = model.interfaces["platform"].points[:, 2]
    share = 1.0 + 1.1 * z / np.abs(z).max()
    loads = {"platform": 800.0 * share / share[share > 0.0].sum()}
    tip, plain = bd.Excitation("tip", direction="tangential"), bd.ResidualModes(inertia=modes == 10)
    free = bd.Study(model, tip, friction_coefficient=0.4, blade_modes=modes, contact_stiffness=plain)
    held = bd.prescribe_preload(free, loads)
    curves = {n: held.with_(harmonics=n).track(0.0, (260.0, 400.0)) for n in (3, 5, 7, 9, 13)}
    tops = {str(n): 1e6 * float(curve.amplitude.max()) for n, curve in curves.items()}
    return {**record(held.kept(curves[3])), "tops": tops}


def on_the_typical_blade(name: str) -> dict[str, Any]:
    """Peak and what is kept of it with so many residual patterns."""
    patterns, preload = TYPICAL[name]
    given = {"friction_coefficient": 0.3, "contact_stiffness": bd.ResidualModes(patterns)}
    of = bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, **given)
    of.system(preload)
    begin = time.process_time()
    curve = of.track(preload, (600.0, 720.0))
    return {"curve": time.process_time() - begin, **record(of.kept(curve))}


def motion(r: dict[str, Any]) -> str:
    """What is kept, in a cell of a table."""
    return f"{r['mean']:.1f} ({r['lowest']:.1f} to {r['highest']:.1f}) at {r['frequency']:.1f} Hz"


def main() -> None:
    """Compute what is missing, and print the tables."""
    known = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    asked = sys.argv[1:] if sys.argv[0].endswith("bench_kept.py") else []
    jobs = {f"{name}/{steps}": (walked, name, steps) for steps in (256, 512) for name in CASES}
    jobs |= {name: (on_the_ground, name) for name in GROUND} | {name: (in_a_cell, name) for name in CELLS}
    jobs |= {name: (on_the_typical_blade, name) for name in TYPICAL}
    for function, named in ((slowly, SLOWLY), (from_the_balance, STARTED), (again, AGAIN)):
        jobs |= {name: (function, name) for name in named}
    jobs |= {name: (beside_a_sweep, name) for name in scenes()}
    for name, (function, *arguments) in jobs.items():
        if name not in known and (not asked or name in asked):
            begin = time.process_time()
            known[name] = {**function(*arguments), "seconds": round(time.process_time() - begin, 1)}
            RESULTS.write_text(json.dumps(known, indent=1) + "\n")
            print(name, known[name], flush=True)
    print("| preload | peak of the balance (\u00b5m) | kept, 256 steps | at half the step | independent march |")
    print("|---|---|---|---|---|")
    for name in CASES:
        both = [known.get(f"{name}/{steps}") for steps in (256, 512)]
        cells = [f"{r['mean']:.1f} ({r['lowest']:.0f} to {r['highest']:.0f}) at {r['frequency']:.1f} Hz, "
                 f"{r['processor']:.0f} s" if r else "" for r in both]  # fmt: skip
        if both[0]:
            print(f"| {name} | {both[0]['balance']:.1f} | {' | '.join(cells)} | {both[0]['expected']:g} |")
    print("\n| cell | curve | peak of the balance (\u00b5m) | kept | of it |\n|---|---|---|---|---|")
    for name in CELLS:
        if r := known.get(name):
            print(f"| {name} | {r['curve']} | {r['balance']:.1f} | {motion(r)} | {r['status']} |")
    for name in filter(known.get, SLOWLY):
        r = known[name]
        print(f"\n{name}: highest mean of 80 periods {r['highest']:.1f} at {r['at']:.1f} Hz")
        print(", ".join(f"{f} Hz {mean:.1f} ({low:.0f} to {high:.0f})" for f, (mean, low, high) in r["means"].items()))
    for name in filter(known.get, STARTED):
        print(f"\n{name}:", ", ".join(f"{mean:.1f} ({low:.0f} to {high:.0f})" for mean, low, high in known[name]["means"]))
    for name in filter(known.get, AGAIN):
        print(f"\n{name}: {known[name]['mean']:.1f}, falls at {known[name]['fall']:.1f} Hz")
    print("\n| typical blade | peak of the balance (\u00b5m) | kept | time of a curve (s) |\n|---|---|---|---|")
    for name in TYPICAL:
        if r := known.get(name):
            print(f"| {name} | {r['balance']:.1f} | {motion(r)} | {r['curve']:.1f} |")
    print("\n| blade modes | 3 harmonics (mm) | 5 | 7 | 9 | 13 | kept | falls at |\n" + "|---" * 8 + "|")
    for name in GROUND:
        if r := known.get(name):
            tops = " | ".join(f"{top / 1e3:.2f}" for top in r["tops"].values())
            print(f"| {GROUND[name]} | {tops} | {r['mean'] / 1e3:.2f} | {r['fall']:.1f} Hz |")
    print("\n| scene | peak of the balance (\u00b5m) | kept | slow sweep | difference |\n|---|---|---|---|---|")
    for name in scenes():
        r = known.get(name, {})
        if "sweep" in r:
            off = 100.0 * (r["mean"] / r["sweep"] - 1.0)
            print(f"| {', '.join(map(str, r['scene']))} | {r['balance']:.1f} | {r['mean']:.1f} ({r['lowest']:.0f} to "
                  f"{r['highest']:.0f}) | {r['sweep']:.1f} | {off:+.1f} % |")  # fmt: skip
        elif r:
            print(f"| {', '.join(map(str, r['scene']))} | {r['balance']:.1f} | {r['mean']:.1f} | not marched | |")


if __name__ == "__main__":
    main()
