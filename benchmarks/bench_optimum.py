"""Whether an optimum is as low as a scan of whole curves finds it, on random studies of the shipped bladed disk.

``python -m benchmarks.bench_optimum results.jsonl [--seconds 120]`` goes on with the studies of
:mod:`benchmarks.optimal_scenes` (60, seeded) that the file does not hold, until the processor time is used up, appends a
line for each, and prints a summary.  Each study has an optimal curve of 30 preloads from 30 N to 25 kN, and 60 whole curves
between the same ends.  The optimum passes if its amplitude is at most 1 % above the least value of those that are complete
and do not rattle.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from bdamper.peaks.at_preload import at_preload
from bdamper.peaks.optimal import BUDGET, optimal_curve, rattling_below
from benchmarks.optimal_scenes import PRELOADS, STUDIES, draw

SCAN = np.geomspace(PRELOADS[0], PRELOADS[-1], 60)
ABOVE = 0.01
"""Relative, by which an optimum may lie above the least of the scan."""


def run(number: int) -> dict[str, Any]:
    """The optimum of one study beside the scan."""
    study, mode, text = draw(number)
    begin = time.process_time()
    curve = optimal_curve(study, PRELOADS, mode=mode)
    middle = time.process_time()
    low, high = curve.settings["frequency"]
    there = {float(p): at_preload(study, float(p), (low, high), None, BUDGET) for p in SCAN}
    edge = max(rattling_below(there), curve.no_steady_below)
    values = [t.top.peak.amplitude for p, t in there.items() if t.top is not None and t.known and p > edge]
    return {"number": number, "text": text, "amplitude": curve.optimum.amplitude, "preload": curve.optimum.preload,
            "kind": curve.optimum.kind, "status": curve.optimum.status, "least": min(values, default=np.nan),
            "seconds": middle - begin, "scan": time.process_time() - middle, "curves": len(curve.curves)}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("--seconds", type=float, default=120.0)
    given = parser.parse_args()
    done = [json.loads(line) for line in given.results.read_text().splitlines()] if given.results.exists() else []
    known = {item["number"] for item in done}
    with given.results.open("a") as file:
        for number in (n for n in range(STUDIES) if n not in known):
            if time.process_time() > given.seconds:
                break
            done.append(run(number))
            file.write(json.dumps(done[-1]) + "\n")
            file.flush()
    worst = 0.0
    for item in done:
        above = item["amplitude"] / item["least"] - 1.0
        worst = max(worst, above)
        mark = "" if above <= ABOVE else "  <-- above"
        print(f"{item['number']:3d} {100 * above:+7.2f} %  {item['kind']}, {item['status']}, {item['curves']} curves, "
              f"{item['seconds']:.1f} s ({item['text']}){mark}")  # fmt: skip
    print(f"{len(done)} of {STUDIES} studies, worst {100 * worst:.2f} % above the scan")


if __name__ == "__main__":
    main()
