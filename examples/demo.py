"""The damper that a bladed disk should have: the preload of least resonance, verified, and how far more harmonics move it.

Optimal curve of the first mode of the reference bladed disk over the preload and the ladder of harmonics at its optimum,
with tracking curves at a few preloads.  Prints the results and writes ``optimum.png`` and ``tracking_mode_1.png``.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import matplotlib.pyplot as plt

import bdamper as bd
from bdamper.continuation.curve import Curve
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.plot import plot_curves, plot_ladder, plot_optimal, save_figure

BAND = (270.0, 375.0)
FACTORS = (2.0, 5.0, 20.0)
"""Preloads of tracking curves beside that of the optimum, over it."""


def draw(optimal: OptimalCurve, curves: list[Curve], path: Path) -> None:
    """The optimal curve and its ladder on the left, the tracking curves on the right."""
    figure = plt.figure(figsize=(10.0, 7.0), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1.0), height_ratios=(1.9, 1.0))
    amplitude, _ = plot_optimal(optimal, figure.add_subplot(grid[0, 0]), title="Optimal curve", coexisting=False)
    amplitude.legend(fontsize=7.0, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False)
    if optimal.ladder is not None:
        plot_ladder(optimal.ladder, figure.add_subplot(grid[1, 0]))
    plot_curves(curves, figure.add_subplot(grid[:, 1]), title="Tracking curves, 1 N tangential at the tip")
    save_figure(figure, path)


def main(
    figures: Path = Path("figures"), preload: tuple[float, float] = (50.0, 5000.0), n: int = 30
) -> tuple[OptimalCurve, list[Curve]]:
    """Run the demonstration; returns the optimal curve and the tracking curves, the limits first."""
    figures.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    study = bd.Study(
        bd.reference_model("bladed_disk"),
        engine_order=5,
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip", direction="tangential", amplitude=1.0),
    )
    print(study)
    optimal = study.optimal_curve(preload, n)
    print(optimal)
    loads = [float(f"{factor * optimal.optimum.preload:.3g}") for factor in (1.0, *FACTORS)]
    curves = [study.free(BAND), study.stuck(BAND), *(study.track(load, BAND) for load in loads)]
    for curve in curves[2:]:
        print(curve)
    draw(optimal, curves, figures / "optimum.png")
    save_figure(plot_curves(curves, title="Mode 1, tangential force of 1 N at the tip"), figures / "tracking_mode_1.png")
    print(f"wrote optimum.png and tracking_mode_1.png in {figures}; {time.perf_counter() - started:.0f} s in all")
    return optimal, curves


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    main(parser.parse_args().figures)
