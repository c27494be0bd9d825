"""A test rig with one blade and two dampers: frequency shift and normalised optimal curve (Figs 19 to 22 of the paper).

One test blade stands between two dummy blades without airfoil; two wedge dampers are pulled against the platforms by equal
loads.  The three blades are one acyclic structure, so the interblade phase angle is zero.

What the paper says, and what the model shows:

* The frequency rises and the amplitude passes a minimum, as everywhere: amplitude over that of the free blade, load over
  the optimum load.
* Complete locking is not reached and microslip remains at high load.  Here too: at a hundred times the optimum load, where
  every point of the bladed disk sticks, the rig still slips and its amplitude is some 20 % below that of the stuck dampers.
  In the disk the neighbour moves along with a small phase, here it stands still, so the damper bears the whole motion of
  the blade.  Complete locking comes at more than a thousand times the optimum.
* A prediction with more blade modes, for which the contact stiffness is computed anew, is close: 20 modes against 10
  change the optimum by less than 1 % in amplitude and load.

The measured points of the paper are in figures only and not available as numbers; none are shown here.  With a file of
your own points (``--measured points.csv``, columns ``load`` in newtons, ``frequency`` in hertz and ``amplitude``) the
figures show them over the prediction, and the goodness of fit is printed.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import bdamper as bd
from bdamper.io.measured import Fit, load_measured
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.plot import plot_over_measurement, save_figure

BAND = (240.0, 380.0)
LOADS = (25.0, 1.5e5)


@dataclass(frozen=True)
class RigResult:
    """Optimal curves of the rig with 10 and with 20 blade modes and of the bladed disk; fits to measured points, if any."""

    rig: OptimalCurve
    more_modes: OptimalCurve
    disk: OptimalCurve
    fits: dict[str, Fit]


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
    curves = {
        "rig, 10 modes": study.optimal_curve(LOADS, n, frequency=BAND, check=False),
        "rig, 20 modes": replace(study, blade_modes=20).optimal_curve(LOADS, n, frequency=BAND, check=False),
        "bladed disk": wheel.optimal_curve((60.0, 1.5e5), n, frequency=(270.0, 380.0), check=False),
    }
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
    model.plot(figures / "fig20_test_rig.png")
    fits = {name: fit for name, fit in (("shift", fit_shift), ("amplitude", fit_amplitude)) if fit is not None}
    for name, fit in fits.items():
        print(f"{name}: {fit}")
    return RigResult(curves["rig, 10 modes"], curves["rig, 20 modes"], curves["bladed disk"], fits)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    parser.add_argument("--measured", type=Path, help="CSV file with the columns load, frequency, amplitude")
    arguments = parser.parse_args()
    main(arguments.figures, arguments.measured)
