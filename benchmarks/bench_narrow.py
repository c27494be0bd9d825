"""Whether a response curve over a narrow band shows the resonance that a wide one shows, on random bands.

``python -m benchmarks.bench_narrow [first last]`` runs the bands of these numbers (0 to 99 by default), prints a line for
each and a table, and, where all of them ran, writes ``benchmarks/results/narrow.json``.

A scene is the bladed disk with nine or 24 contact points a face, that of the paper or the test rig, all as shipped, with
unit tractions or residual modes, one or three harmonics, mode 1 (two of three) or 3, a friction coefficient of 0.2 to 0.6
and a preload of 50 to 5000 N per newton of excitation, equally distributed in its logarithm; its number is the seed.  The
wide curve spans the free and the stuck resonance.  The band is 2 to 50 % of it in width and contains its highest peak,
anywhere within.

A band agrees if the highest value of its curve is within 1 % of that of the wide one.  A narrow curve may also show a
higher one: then the wide curve has missed a branch, which is counted apart.
"""

from __future__ import annotations

import argparse
import json
import time
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import bdamper as bd
from bdamper.response.linear_limits import resonance_interval

BANDS = 100
BODIES = ("bladed_disk", 9), ("bladed_disk", 24), ("paper_disk", 24), ("test_rig", 24)
TOLERANCE = 0.01
RESULTS = Path(__file__).with_name("results") / "narrow.json"


@lru_cache
def _model(name: str, points: int) -> bd.Model:
    return bd.reference_model(name, points)


def draw(number: int) -> tuple[bd.Study, float, tuple[float, float], np.random.Generator, str]:
    """Study, preload (N), wide interval (Hz), generator for the band, and the scene in words."""
    rng = np.random.default_rng([23, number])
    name, points = BODIES[int(rng.choice(len(BODIES), p=(0.4, 0.1, 0.3, 0.2)))]
    harmonics, method = (
        int(rng.choice([1, 3])),
        str(rng.choice(["unit_traction", "residual_modes"])),
    )
    mode, friction = int(rng.choice([1, 1, 3])), float(rng.uniform(0.2, 0.6))
    preload = float(np.exp(rng.uniform(np.log(50.0), np.log(5000.0))))
    study = bd.Study(
        _model(name, points), bd.Excitation("tip", "tangential"), 1 if name == "test_rig" else 5,
        friction_coefficient=friction, harmonics=harmonics, contact_stiffness=method,
        blade_modes=5 if method == "residual_modes" else 10,
    )  # fmt: skip
    text = f"{name} {points}, {method}, H = {harmonics}, mode {mode}, mu {friction:.2f}, {preload:.0f} N"
    return study, preload, resonance_interval(study.problem.at(1.0), mode), rng, text


def run(number: int) -> dict[str, Any]:
    """The wide and the narrow curve of a number."""
    study, preload, (low, high), rng, text = draw(number)
    study.static(preload)
    begin = time.process_time()
    wide = study.frequency_response(preload, (low, high))
    middle = time.process_time()
    part, place = np.exp(rng.uniform(np.log(0.02), np.log(0.5))), rng.uniform(0.02, 0.98)
    bottom = wide.peak.frequency - place * part * (high - low)
    band = max(low, bottom), min(high, bottom + part * (high - low))
    narrow = study.frequency_response(preload, band)
    end = time.process_time()
    ratio = narrow.amplitude.max(initial=0.0) / wide.peak.amplitude
    told = any("outside" in part.why for part in narrow.missing_ranges)
    return {
        "number": number, "scene": text, "wide": [round(f, 3) for f in (low, high)], "band": [float(f) for f in band],
        "folds": len(wide.folds), "status": [wide.status, narrow.status], "told": told, "ratio": round(float(ratio), 6),
        "evaluations": [wide.cost.evaluations, narrow.cost.evaluations],
        "seconds": [round(middle - begin, 3), round(end - middle, 3)],
    }  # fmt: skip


def table(results: list[dict[str, Any]]) -> str:
    """Summary in Markdown."""
    lines = [
        "| bands | wide curve | agree within 1 % | higher | lower | of these in `missing_ranges` | evaluations, median |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, own in (
        ("all", results),
        ("with folds", [r for r in results if r["folds"]]),
        ("without folds", [r for r in results if not r["folds"]]),
    ):
        ratio = np.array([r["ratio"] for r in own])
        counts = [
            int(n.sum())
            for n in (
                abs(ratio - 1.0) <= TOLERANCE,
                ratio > 1.0 + TOLERANCE,
                ratio < 1.0 - TOLERANCE,
            )
        ]
        told = sum(r["told"] for r in own if r["ratio"] < 1.0 - TOLERANCE)
        spent = np.median([r["evaluations"][1] for r in own]) if own else 0
        lines.append(
            f"| {len(own)} | {name} | {counts[0]} | {counts[1]} | {counts[2]} | {told} | {spent:.0f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_narrow", description=__doc__)
    parser.add_argument(
        "numbers", nargs="*", type=int, default=[0, BANDS - 1], help="first and last band"
    )
    first, last = parser.parse_args().numbers
    results = []
    for number in range(first, last + 1):
        r = run(number)
        results.append(r)
        low, high = r["band"]
        print(
            f"{number}: {r['scene']}, {low:.1f} to {high:.1f} of {r['wide'][0]:.0f} to {r['wide'][1]:.0f} Hz: ratio "
            f"{r['ratio']:.4f}, {r['folds']} folds, {'/'.join(r['status'])}, evaluations {r['evaluations']}, "
            f"{r['seconds'][0]:.2f} and {r['seconds'][1]:.2f} s",
            flush=True,
        )
    print(table(results))
    if (first, last) == (0, BANDS - 1):
        lines = ",\n".join(json.dumps(r) for r in results)
        RESULTS.write_text(
            f'{{"command": "python -m benchmarks.bench_narrow", "bands": [\n{lines}\n]}}\n'
        )


if __name__ == "__main__":
    main()
