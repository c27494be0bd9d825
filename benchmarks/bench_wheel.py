"""Processor time of a mistuned wheel of 65 blades with 9 contact points a face: a response curve, and its highest peak.

``python -m benchmarks wheel``; each line says how far the curve came, since it ends after so many points or seconds.
"""

from __future__ import annotations

import time

import numpy as np

import bdamper as bd
from bdamper.response.events import ContinuationOptions

PRELOAD, DEVIATION, POINTS = 2000.0, 0.02, 40


def main() -> None:
    """Print one line for each number of harmonics and each question."""
    pattern = DEVIATION * np.random.default_rng(1).normal(size=65)
    for harmonics in (1, 3):
        study = bd.Study(
            bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, harmonics=harmonics
        )
        wheel = bd.BladedDisk(study, mistuning=pattern)
        top = wheel.tuned_peak(PRELOAD)
        interval = (0.88 * top.frequency, 1.05 * top.frequency)
        started = time.process_time()
        few = ContinuationOptions(locate=False, max_points=POINTS, budget=20 * POINTS)
        curve = wheel.frequency_response(PRELOAD, interval, options=few)
        spent = time.process_time() - started
        print(
            f"H = {harmonics}: {len(curve)} points in {spent:.1f} s, {1e3 * spent / max(len(curve), 1):.0f} ms each "
            f"({curve.status}: {curve.reason}); {curve.cost.factorisations} factorisations",
            flush=True,
        )
    study = study.replace(harmonics=1)
    wheel = bd.BladedDisk(study, mistuning=pattern)
    started = time.process_time()
    peak = wheel.peak(PRELOAD)
    print(f"peak, H = 1: {time.process_time() - started:.1f} s\n{peak}")


if __name__ == "__main__":
    main()
