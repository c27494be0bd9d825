"""Response curves of the reference model: points, seconds, and the share outside the C core."""

from __future__ import annotations

import statistics

import bdamper as bd
from benchmarks import PLAIN

REPEATS = 5


def main() -> None:
    """Print a table of times (median of repeats)."""
    print("## Response curves, mode 1 of the reference bladed disk, 250 to 400 Hz\n")
    print(
        "| contact points on a face | harmonics | preload | points of the curve | seconds | outside the C core |"
    )
    print("|---|---|---|---|---|---|")
    for points in (9, 24, 48):
        model = bd.reference_model("bladed_disk", points)
        for harmonics in (1, 3, 5):
            study = bd.Study(
                model,
                engine_order=5,
                friction_coefficient=0.4,
                excitation=bd.Excitation("tip"),
                **(PLAIN | {"harmonics": harmonics}),
            )
            for preload in (200.0, 2000.0):
                study.frequency_response(preload, (250.0, 400.0))
                curves = [study.frequency_response(preload, (250.0, 400.0)) for _ in range(REPEATS)]
                seconds = statistics.median(c.cost.seconds for c in curves)
                outside = statistics.median(c.cost.python / c.cost.processor for c in curves)
                print(
                    f"| {points} | {harmonics} | {preload:g} N | {len(curves[0])} | {seconds:.3f} | {100 * outside:.0f} % |"
                )
    print()


if __name__ == "__main__":
    main()
