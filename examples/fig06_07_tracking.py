"""Tracking curves of the first two blade modes over preload (Figs 6 and 7 of the paper).

A disk of 65 blades with a wedge damper between each two is driven by engine order 5, with 1 N on every blade: at the tip in
the tangential direction for mode 1, in the axial direction for mode 2, which bends out of the plane of rotation in the
reference model.  Every curve is followed through its folds and judged for stability; unstable parts are dashed.

The paper sees several solutions at one frequency in mode 1, where the damper turns about the axis of rotation and its faces
lift off, and none in mode 2.  The reference model shows folds in mode 1 at every preload up to 5 kN.  In mode 2 it shows
none from 200 N on; below about 100 N it does, and the last column says why: the faces are open for most of the period there
as well.  Folds go with separation, in both modes.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import bdamper as bd
from bdamper.continuation.curve import Curve
from bdamper.plot import plot_curves, save_figure

PRELOADS_1 = (50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0)
PRELOADS_2 = (50.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0)
BAND_1, BAND_2 = (270.0, 370.0), (670.0, 730.0)


def tracking(study: bd.Study, preloads: tuple[float, ...], band: tuple[float, float], name: str) -> list[Curve]:
    """The two limits and a curve for each preload, with a line of a table for each."""
    curves = [study.free(band), study.stuck(band)]
    curves += [study.track(preload=p, frequency=band, stability=True) for p in preloads]
    print(f"{name:8}{'preload':>10}{'peak':>13}{'at':>11}{'folds':>7}{'open at the peak':>18}  status")
    for curve in curves:
        peak = curve.peak
        label = f"{curve.preload:.0f} N" if curve.kind == "tracking" else curve.kind
        share = f"{100 * curve.shares[peak.index, 2]:.0f} %" if curve.kind == "tracking" else ""
        print(
            f"{'':8}{label:>10}{1e3 * peak.amplitude:>10.4f} mm{peak.frequency:>8.2f} Hz{len(curve.folds):>7}{share:>18}"
            f"  {curve.status}"
        )
    return curves


def main(
    figures: Path = Path("figures"),
    preloads_1: tuple[float, ...] = PRELOADS_1,
    preloads_2: tuple[float, ...] = PRELOADS_2,
) -> dict[str, list[Curve]]:
    """Compute and draw both figures; returns the curves of each mode, the free and the stuck limit first."""
    figures.mkdir(parents=True, exist_ok=True)
    tangential = bd.Study(
        bd.reference_model("bladed_disk", contact_points=24),
        engine_order=5,
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip", direction="tangential", amplitude=1.0),
        contact_stiffness="unit_traction",
        blade_modes=10,
        harmonics=1,
    )
    axial = replace(tangential, excitation=bd.Excitation("tip", direction="axial", amplitude=1.0))
    out = {
        "mode 1": tracking(tangential, preloads_1, BAND_1, "mode 1"),
        "mode 2": tracking(axial, preloads_2, BAND_2, "mode 2"),
    }
    save_figure(plot_curves(out["mode 1"], title="Mode 1, tangential force of 1 N"), figures / "fig06_tracking_mode_1.png")
    save_figure(plot_curves(out["mode 2"], title="Mode 2, axial force of 1 N"), figures / "fig07_tracking_mode_2.png")
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    main(parser.parse_args().figures)
