"""Which response curves are complete within their budget, on mode 1 of the reference bladed disk, 250 to 400 Hz.

Preloads from a damper that nearly flies to one that is stuck, three contact meshes, one to seven harmonics, with and
without rotation of the damper.  A part of it: ``python -m benchmarks.bench_hard_curves --points 24 --harmonics 3 5``;
``--figures FOLDER`` draws each curve, whole and where paths were left in tangles.
"""

from __future__ import annotations

import argparse
import itertools
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt

import bdamper as bd
from bdamper.response.response_curve_result import ResponseCurve

PRELOADS = (20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0, 25000.0)
POINTS = (9, 24, 48)
HARMONICS = (1, 2, 3, 4, 5, 6, 7)
ROTATION = ("on", "off")

Cell = tuple[int, int, str, float]


def study(points: int, harmonics: int, rotation: str) -> bd.Study:
    """The study of one column of the matrix."""
    return bd.Study(
        bd.reference_model("bladed_disk", points),
        engine_order=5,
        contact_stiffness="unit_traction",
        harmonics=harmonics,
        friction_coefficient=0.4,
        rigid_modes=bd.RIGID_NAMES if rotation == "on" else ("TX", "TY", "TZ"),
        excitation=bd.Excitation("tip", "tangential", 1.0),
    )


def draw(curve: ResponseCurve, path: Path) -> None:
    """Figure of a curve: all of it, and the part in which paths were left."""
    figure, (whole, part) = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    curve.plot(ax=whole)
    if curve.missing_ranges:
        low, high = (
            min(left.low for left in curve.missing_ranges),
            max(left.high for left in curve.missing_ranges),
        )
        margin = 0.05 * (high - low)
        there = (curve.frequency > low - margin) & (curve.frequency < high + margin)
        curve.plot(ax=part)
        part.set_xlim(low - margin, high + margin)
        part.set_ylim(0.8 * curve.amplitude[there].min(), 1.2 * curve.amplitude[there].max())
        part.get_legend().remove()
    else:
        part.remove()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def run(cell: Cell, figures: Path | None = None) -> tuple[Cell, bool, str]:
    """One curve: whether it is complete, and its row of the table."""
    points, harmonics, rotation, preload = cell
    started = time.perf_counter()
    curve = study(points, harmonics, rotation).frequency_response(preload, (250.0, 400.0))
    seconds = time.perf_counter() - started
    if figures is not None and len(curve):
        draw(
            curve,
            figures / f"{points}-points-{harmonics}-harmonics-rotation-{rotation}-{preload:g}N.png",
        )
    row = (
        f"| {points} | {harmonics} | {rotation} | {preload:g} N | {curve.status} | {len(curve)} | {len(curve.folds)} | "
        f"{seconds:.2f} | {curve.reason} |"
    )
    return cell, curve.complete, row


def main(arguments: list[str] | None = None) -> None:
    """Print a table of the cells that are asked for; by default a small part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, nargs="+", choices=POINTS, default=[9])
    parser.add_argument("--harmonics", type=int, nargs="+", choices=HARMONICS, default=[1, 3])
    parser.add_argument("--rotation", nargs="+", choices=ROTATION, default=list(ROTATION))
    parser.add_argument("--preload", type=float, nargs="+", default=list(PRELOADS))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--figures", type=Path, help="folder for a figure of each curve")
    asked = parser.parse_args(arguments or [])
    if asked.figures is not None:
        asked.figures.mkdir(parents=True, exist_ok=True)
    cells: list[Cell] = list(
        itertools.product(asked.points, asked.harmonics, asked.rotation, asked.preload)
    )
    print(
        "| contact points on a face | harmonics | rotation | preload | status | points | folds | seconds | reason |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    complete = 0
    with ProcessPoolExecutor(asked.jobs) as pool:
        for _, through, row in pool.map(partial(run, figures=asked.figures), cells):
            complete += through
            print(row, flush=True)
    print(f"\n{complete} of {len(cells)} complete\n")


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
