"""Tracking, optimal and frequency-shift curves of the third and the seventh blade mode (Figs 10 and 11 of the paper).

Mode 3 of the reference model, 1125 Hz, is the second bending mode in the plane of rotation and is excited at the tip in the
tangential direction; mode 7, 4336 Hz, moves the tip in the axial direction.  The paper gives no numbers for these modes.

Both behave like the lower ones: the amplitude falls with the preload to an optimum and rises to that of the stuck damper,
and the resonance moves to the stuck frequency.  Mode 3 opens the faces and has folds, like mode 1.  Mode 7 has none, like
mode 2; at its optimum the resonance lies below that of the free blade, because the damper moves with the platform and
adds more mass than stiffness there.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import bdamper as bd
from bdamper.continuation.curve import Curve
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.plot import plot_curves, plot_optimal, save_figure

MODES = {
    3: ("tangential", (1050.0, 1550.0), (20.0, 50.0, 100.0, 200.0, 500.0, 2000.0), (15.0, 25e3)),
    7: ("axial", (4200.0, 4450.0), (50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0), (30.0, 8e3)),
}


@dataclass(frozen=True)
class HigherMode:
    """Curves of one mode."""

    tracking: list[Curve]
    optimal: OptimalCurve


def main(figures: Path = Path("figures"), n: int = 40) -> dict[int, HigherMode]:
    """Compute and draw the figures; returns tracking and optimal curves of modes 3 and 7."""
    figures.mkdir(parents=True, exist_ok=True)
    study = bd.Study(
        bd.reference_model("bladed_disk", contact_points=24),
        engine_order=5,
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip", direction="tangential", amplitude=1.0),
        contact_stiffness="unit_traction",
        blade_modes=10,
        harmonics=1,
    )
    out = {}
    for mode, (direction, band, preloads, interval) in MODES.items():
        driven = replace(study, excitation=bd.Excitation("tip", direction=direction, amplitude=1.0))
        curves = [driven.free(band), driven.stuck(band), *(driven.track(p, band, stability=True) for p in preloads)]
        optimal = driven.optimal_curve(interval, n, frequency=band, check=False)
        out[mode] = HigherMode(curves, optimal)
        print(f"mode {mode}: folds {[len(c.folds) for c in curves[2:]]} at {[int(p) for p in preloads]} N")
        print(optimal)
        name = f"Mode {mode}, {direction} force of 1 N"
        save_figure(plot_curves(curves, title=name), figures / f"fig10_tracking_mode_{mode}.png")
        save_figure(plot_optimal(optimal, title=name)[0], figures / f"fig11_optimal_mode_{mode}.png")
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    main(parser.parse_args().figures)
