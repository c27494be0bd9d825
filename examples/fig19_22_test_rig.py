"""A test rig with one blade and two dampers: frequency shift and normalised optimal curve (Figs 19 to 22 of the paper).

One test blade stands between two dummy blades without airfoil; two wedge dampers are pulled against the platforms by equal
loads.  The three blades are one acyclic structure, so the interblade phase angle is zero.

* The frequency rises and the amplitude passes a minimum: holds.
* Complete locking is not reached and microslip remains at high load: holds.  At a hundred times the optimum load, where
  every point of a bladed disk sticks, the rig still slips.  In the disk the neighbour moves along with a small phase, here
  it stands still, so the damper bears the whole motion of the blade.
* A prediction with more blade modes, for which the contact stiffness is computed anew, is close: holds from 10 to 20 modes
  (less than 1 %) and does not hold beyond: with 40 the optimum is a third lower.  Agreement of two was no convergence.

The measured points of the paper are in figures only and not available as numbers; none are shown here.  With a file of
your own points (``--measured points.csv``, columns ``load`` in newtons, ``frequency`` in hertz and ``amplitude``) the
figures show them over the prediction, and the goodness of fit is printed.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import bdamper as bd
from bdamper.io.measured import Fit, load_measured
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.plot import plot_over_measurement, save_figure
from bdamper.plot.axes import PAPER

BAND = (240.0, 380.0)
LOADS = (25.0, 1.5e5)


@dataclass(frozen=True)
class RigResult:
    """Optimal curves of the rig by number of blade modes, and of the bladed disk; fits to measured points, if any."""

    rig: dict[int, OptimalCurve]
    disk: OptimalCurve
    fits: dict[str, Fit]


def plot_rig(model: bd.Model, path: Path) -> None:
    """Fig. 19: the blades, the dampers and their loads, seen along the axis."""
    with plt.rc_context(PAPER):
        figure, ax = plt.subplots(figsize=(5.6, 4.4))
        platform = 1e3 * model.locations["platform"].position[1]
        for body, mesh in model.meshes.items():
            depth = mesh.points[mesh.quads, 2]
            front = mesh.quads[(np.ptp(depth, axis=1) < 1e-4) & (depth.mean(axis=1) > 0.0)]
            front = front[1e3 * mesh.points[front, 1].max(axis=1) < platform + 1.0]  # without the airfoil
            shade = "0.72" if body.startswith("damper") else "0.88"
            for quad in front:
                ax.fill(*1e3 * mesh.points[quad, :2].T, facecolor=shade, edgecolor="0.5", linewidth=0.3)
        for name, body in model.bodies.items():
            if body.load is not None:
                place, along = 1e3 * body.centre[:2], body.load.direction[:2]
                ax.annotate("", place + 28.0 * along, place, arrowprops={"arrowstyle": "-|>", "linewidth": 1.4})
                side = -1.0 if name.endswith("left") else 1.0
                where = place + 30.0 * along + [side * 2.0, 0.0]
                ax.text(*where, "load of\nthe damper", ha="center", va="bottom", fontsize=7.5)
        for x, text in ((0.0, "test blade\n(airfoil above)"), (-42.0, "dummy"), (42.0, "dummy")):
            ax.text(x, platform + 2.0, text, ha="center", va="bottom", fontsize=7.5)
        ax.set(aspect="equal", xlabel="X (mm)", ylabel="Y (mm)", ylim=(platform - 60.0, platform + 36.0))
        ax.grid(False)
    save_figure(figure, path)


def at_normalised_load(curve: OptimalCurve, load: float) -> tuple[float, float]:
    """Amplitude over the stuck amplitude, and the share that slips, at a multiple of the optimum load."""
    k = int(np.argmin(np.abs(np.log(curve.preload / curve.optimum.preload / load))))
    return float(curve.amplitude[k] / curve.stuck.amplitude), float(curve.shares[k, 1])


def main(figures: Path = Path("figures"), measured: Path | None = None, n: int = 60) -> RigResult:
    """Compute and draw the figures, with measured points if there are any."""
    figures.mkdir(parents=True, exist_ok=True)
    excitation = bd.Excitation("tip", direction="tangential", amplitude=1.0)
    model = bd.reference_model("test_rig")
    study = bd.Study(
        model,
        friction_coefficient=0.4,
        excitation=excitation,
        contact_stiffness="unit_traction",
        blade_modes=10,
        harmonics=1,
    )
    wheel = bd.Study(
        bd.reference_model("bladed_disk", contact_points=24),
        engine_order=5,
        friction_coefficient=0.4,
        excitation=excitation,
        contact_stiffness="unit_traction",
        blade_modes=10,
        harmonics=1,
    )
    rig = {
        modes: replace(study, blade_modes=modes).optimal_curve(LOADS, n, frequency=BAND, check=False)
        for modes in (10, 20, 40)
    }
    disk = wheel.optimal_curve((60.0, 1.5e5), n, frequency=(270.0, 380.0), check=False)
    curves = {f"{modes} modes": curve for modes, curve in rig.items()} | {"bladed disk": disk}
    for name, curve in curves.items():
        ratio, slip = at_normalised_load(curve, 100.0)
        print(
            f"{name:14} optimum {1e3 * curve.optimum.amplitude:.4f} mm at {curve.optimum.preload:6.1f} N, shift "
            f"{curve.stuck_shift_percent:.1f} %; at 100 times that load: {ratio:.2f} of the stuck amplitude, "
            f"slip {100 * slip:.1f} %"
        )
    points = None if measured is None else load_measured(measured)
    shift, fit_shift = plot_over_measurement(curves, points, quantity="shift")
    optimal, fit_amplitude = plot_over_measurement(curves, points, quantity="amplitude")
    save_figure(shift, figures / "fig21_frequency_shift.png")
    save_figure(optimal, figures / "fig22_normalised_optimal_curve.png")
    plot_rig(model, figures / "fig19_test_rig.png")
    model.plot(figures / "fig20_test_rig.png", backend="matplotlib")
    fits = {name: fit for name, fit in (("shift", fit_shift), ("amplitude", fit_amplitude)) if fit is not None}
    for name, fit in fits.items():
        print(f"{name}: {fit}")
    return RigResult(rig, disk, fits)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    parser.add_argument("--measured", type=Path, help="CSV file with the columns load, frequency, amplitude")
    arguments = parser.parse_args()
    main(arguments.figures, arguments.measured)
