"""Whether an optimum is as low as a scan of whole curves finds it, on random studies whose optimum lies within the range.

``python -m benchmarks.bench_optimum results.jsonl [--seconds 120]`` goes on with the studies (60, seeded) that the file
does not hold, until the processor time is used up, appends a line for each, and prints a summary.

A study is of the shipped bladed disk, with 9 or 24 contact points a face, unit tractions or residual modes, 1 or 3
harmonics (1 with 24 points), one of the modes 1 to 4, an excitation along the circumference or the axis, and a friction
coefficient of 0.2 to 0.6.  Whole curves at falling preloads tell roughly where the least value is; the range goes from a
twentieth of that preload to forty times it.  There are an optimal curve of 30 preloads and 60 whole curves in it.  The
optimum passes if its amplitude is at most 1 % above the least value of those curves that are complete and do not rattle.
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
from bdamper.response.highest_peak import AtPreload
from bdamper.response.linear_limits import peak_interval
from bdamper.response.optimal_curve import (
    BUDGET,
    MAX_RATTLING,
    at_preload,
    optimal_curve,
    rattling_below,
)

STUDIES = 60
ABOVE = 0.01
"""Relative, by which an optimum may lie above the least of the scan."""


@lru_cache
def _model(points: int) -> bd.Model:
    return bd.reference_model("bladed_disk", points)


def draw(number: int) -> tuple[bd.Study, int, str]:
    """The study of a number, its mode, and both in words."""
    rng = np.random.default_rng([36, number])
    points = int(rng.choice([9, 9, 9, 24]))
    harmonics = int(rng.choice([1, 1, 3])) if points == 9 else 1
    method, mode = str(rng.choice(["unit_traction", "residual_modes"])), int(rng.integers(1, 5))
    direction, friction = str(rng.choice(["tangential", "axial"])), float(rng.uniform(0.2, 0.6))
    study = bd.Study(
        _model(points), bd.Excitation("tip", direction), 5, friction_coefficient=friction, harmonics=harmonics,
        contact_stiffness=method, blade_modes=5 if method == "residual_modes" else 10,
    )  # fmt: skip
    return (
        study,
        mode,
        f"{points} points, {method}, H = {harmonics}, mode {mode}, {direction}, mu {friction:.2f}",
    )


def search_status(
    study: bd.Study, preloads: np.ndarray, frequency: tuple[float, float], rises: float
) -> dict[float, AtPreload]:
    """Whole curves at falling preloads, until two in a row rattle, or are higher than the least by a ratio."""
    there: dict[float, AtPreload] = {}
    row = 0
    for p in preloads[::-1]:
        at = there[float(p)] = at_preload(study.problem, float(p), frequency, None, BUDGET)
        higher = at.value > min(a.value for a in there.values()) + np.log(rises)
        row = row + 1 if at.rattles or higher else 0
        if row == MAX_RATTLING:
            break
    return there


def run(number: int) -> dict[str, Any]:
    """The optimum of one study beside the scan."""
    study, mode, text = draw(number)
    frequency = peak_interval(study.problem.at(1.0), None, mode)
    rough = {
        p: a
        for p, a in search_status(study, np.geomspace(2.0, 25e3, 12), frequency, 1.001).items()
        if not a.rattles
    }
    low, high = (ratio * min(rough, key=lambda p: rough[p].value) for ratio in (0.05, 40.0))
    begin = time.process_time()
    curve = optimal_curve(study.problem, np.geomspace(low, high, 30), mode=mode)
    middle = time.process_time()
    there = search_status(study, np.geomspace(low, high, 60), frequency, np.inf)
    edge = max(rattling_below(there), curve.lowest_steady_preload)
    values = {
        p: a.top.peak.amplitude
        for p, a in there.items()
        if a.top is not None and a.known and p > edge
    }
    return {"number": number, "text": text, "amplitude": curve.optimum.amplitude, "preload": curve.optimum.preload,
            "kind": curve.optimum.kind, "status": curve.optimum.status, "least": min(values.values(), default=np.nan),
            "at": min(values, key=lambda p: values[p], default=np.nan), "low": low, "high": high,
            "seconds": middle - begin, "search_status": time.process_time() - middle,
            "curves": len(curve.curves)}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("--seconds", type=float, default=120.0)
    given = parser.parse_args()
    done = (
        [json.loads(line) for line in given.results.read_text().splitlines()]
        if given.results.exists()
        else []
    )
    known = {item["number"] for item in done}
    with given.results.open("a") as file:
        for number in (n for n in range(STUDIES) if n not in known):
            if time.process_time() > given.seconds:
                break
            done.append(run(number))
            file.write(json.dumps(done[-1]) + "\n")
            file.flush()
    above = [item["amplitude"] / item["least"] - 1.0 for item in done]
    for item, part in zip(done, above):
        mark = "" if part <= ABOVE else "  <-- above"
        print(f"{item['number']:3d} {100 * part:+7.2f} %  {item['preload']:.4g} N, {item['kind']}, {item['status']}, "
              f"{item['curves']} curves, {item['seconds']:.1f} s ({item['text']}){mark}")  # fmt: skip
    within = sum(part <= ABOVE for part in above)
    print(
        f"{within} of {len(done)} optima at most 1 % above the scan, worst {100 * max(above, default=np.nan):.2f} %"
    )


if __name__ == "__main__":
    main()
