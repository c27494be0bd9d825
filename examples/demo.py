"""Tracking curves of the reference bladed disk: first two blade modes, several preloads, all branches.

Mode 1 is excited at the blade tip in the tangential direction, mode 2 (bending out of the plane of rotation) in the axial
direction.  A third figure leaves out the rotation of the damper.  Prints a table and writes figures.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import bdamper as bd
from bdamper.continuation.curve import Curve
from bdamper.plot import plot_curves, save_figure

PRELOADS = (100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0)
PRELOADS_MODE_2 = (200.0, 500.0, 1000.0, 2000.0, 5000.0)
HEAD = f"{'':14}{'preload':>9}{'peak':>12}{'at':>10}{'folds':>7}{'points':>8}{'evaluations':>13}{'seconds':>9}  status"


def run(study: bd.Study, name: str, frequency: tuple[float, float], preloads: tuple[float, ...]) -> list[Curve]:
    """Curves at all preloads and the two limits, one line of the table each."""
    curves = [study.free(frequency), study.stuck(frequency)]
    curves += [study.track(preload=p, frequency=frequency) for p in preloads]
    for curve in curves:
        peak, cost = curve.peak, curve.cost
        preload = f"{curve.preload:.0f} N" if curve.kind == "tracking" else curve.kind
        print(
            f"{name:14}{preload:>9}{peak.amplitude * 1e3:>9.4f} mm{peak.frequency:>7.2f} Hz{len(curve.folds):>7}"
            f"{len(curve):>8}{cost.evaluations:>13}{cost.seconds:>9.3f}  {curve.status}"
        )
    return curves


def main(figures: Path = Path("figures")) -> dict[str, list[Curve]]:
    """Run the demonstration; returns the curves of each part."""
    figures.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    model = bd.reference_model("bladed_disk", contact_points=24)
    study = bd.Study(
        model,
        engine_order=5,
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip", direction="tangential", amplitude=1.0),
    )
    for line in study.stiffness_report:
        print(line)
    print(HEAD)
    axial = replace(study, excitation=bd.Excitation("tip", direction="axial", amplitude=1.0))
    no_rotation = replace(study, rigid_modes=("TX", "TY", "TZ"))
    out = {
        "mode 1": run(study, "mode 1", (270.0, 370.0), PRELOADS),
        "mode 2": run(axial, "mode 2", (670.0, 730.0), PRELOADS_MODE_2),
        "no rotation": run(no_rotation, "no rotation", (270.0, 390.0), PRELOADS),
    }
    titles = {
        "mode 1": "Mode 1, tangential force of 1 N at the tip",
        "mode 2": "Mode 2, axial force of 1 N at the tip",
        "no rotation": "Mode 1, damper that only translates",
    }
    for name, curves in out.items():
        path = figures / f"tracking_{name.replace(' ', '_')}.png"
        save_figure(plot_curves(curves, title=titles[name]), path)
        print(f"wrote {path}")
    folds = {name: sum(len(c.folds) for c in curves) for name, curves in out.items()}
    print(f"folds: mode 1 {folds['mode 1']}, mode 2 {folds['mode 2']}, mode 1 without rotation {folds['no rotation']}")
    print(f"{time.perf_counter() - started:.1f} s in all")
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    main(parser.parse_args().figures)
