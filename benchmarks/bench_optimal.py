"""Optimal curve against maxima of full response curves: ratios within one run.

Reference model, one harmonic, 24 contact points a face, 50 preloads.
"""

from __future__ import annotations

import time

import bdamper as bd
from benchmarks import PLAIN


def optimal_against_tracking(
    study: bd.Study, preload: tuple[float, float], frequency: tuple[float, float]
) -> float:
    """Prints and returns the processor time of the optimal curve over that of the response curves (all single-threaded)."""
    start, cpu = time.perf_counter(), time.process_time()
    result = study.optimal_curve(preload, 50, frequency=frequency, check=False)
    fast, fast_cpu = time.perf_counter() - start, time.process_time() - cpu
    start, cpu = time.perf_counter(), time.process_time()
    curves = [study.frequency_response(p, frequency) for p in result.preload[result.requested]]
    slow, slow_cpu = time.perf_counter() - start, time.process_time() - cpu
    complete = [i for i, c in enumerate(curves) if c.complete]
    amplitude = result.amplitude[result.requested]
    error = max(abs(amplitude[i] / curves[i].peak.amplitude - 1.0) for i in complete)
    print(
        f"50 preloads {preload[0]:g} to {preload[1]:g} N: optimal curve {fast:.3f} s, response curves {slow:.3f} s, "
        f"ratio {fast / slow:.3f}, of processor time {fast_cpu / slow_cpu:.3f}; largest difference of the "
        f"amplitude {error:.1e} over {len(complete)} complete curves"
    )
    return fast_cpu / slow_cpu


def main() -> None:
    study = bd.Study(
        bd.reference_model(contact_points=24), bd.Excitation("tip"), 5, friction_coefficient=0.3, **PLAIN
    )  # fmt: skip
    study.frequency_response(1000.0, (340.0, 360.0))
    optimal_against_tracking(study, (100.0, 25e3), (250.0, 400.0))
    optimal_against_tracking(study, (10.0, 25e3), (250.0, 400.0))


if __name__ == "__main__":
    main()
