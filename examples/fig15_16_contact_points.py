"""How many contact points are needed, and what each of them does (Figs 15 and 16 of the paper).

Fig. 15: tracking curves with 9, 24 and 48 points on each face at four preloads.  The paper finds that 9 underestimate the
amplitude and that 24 and 48 are close.  On the reference model 9 and 24 points agree within 0.2 % from 100 N on, while 48
stand apart: the faces are divided into 3 x 3, 3 x 8 and 4 x 12 patches, and in mode 1 the damper turns about the axis of
rotation, so that the faces open along the slope.  What counts is the number of rows along the slope, 3, 3 and 4, not the
number of points.  With four rows the amplitude is the higher one at 200 N and 1 kN (by 2.5 and 1.4 %), as the paper says;
at 100 N, where the faces are open for nine tenths of the period, it is lower by 13 %.

Fig. 16: the state of contact points over the period at the resonance under 5 kN, as space-time bars and as a map of each
face: the row next to the ridge opens, the middle one slips on the left, the others stick.  Partial slip is the rule, and it
depends on the place.

The animation shows the damper's motion with the state of its contacts.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt

import bdamper as bd
from bdamper.plot import animate_damper, plot_curves, plot_status_bars, plot_status_map, save_figure
from bdamper.plot.motion import contact_status

PRELOADS = (100.0, 200.0, 1000.0, 25000.0)
BAND = (270.0, 380.0)
STATUS_PRELOAD = 5000.0


def main(
    figures: Path = Path("figures"),
    preloads: tuple[float, ...] = PRELOADS,
    contact_points: tuple[int, ...] = (9, 24, 48),
    frames: int = 36,
) -> dict[str, Any]:
    """Compute and draw the figures and the animation.

    Returns
    -------
    dict
        ``curves`` (by number of points, a list over the preloads), ``status`` and ``curve`` at 5 kN with 24 points.
    """
    figures.mkdir(parents=True, exist_ok=True)
    studies = {
        n: bd.Study(
            bd.reference_model("bladed_disk", contact_points=n),
            engine_order=5,
            friction_coefficient=0.4,
            excitation=bd.Excitation("tip", direction="tangential", amplitude=1.0),
            contact_stiffness="unit_traction",
            blade_modes=10,
            harmonics=1,
        )
        for n in {*contact_points, 24}
    }
    curves = {n: [studies[n].track(p, BAND) for p in preloads] for n in contact_points}
    print(f"{'preload':>10}" + "".join(f"{f'{n} x {n} points':>26}" for n in contact_points))
    for k, preload in enumerate(preloads):
        peaks = [curves[n][k].peak for n in contact_points]
        print(f"{preload:>8.0f} N" + "".join(f"{1e3 * p.amplitude:>11.4f} mm{p.frequency:>9.2f} Hz" for p in peaks))
    figure, axes = plt.subplots(2, 2, figsize=(8.0, 6.0), layout="constrained")
    for k, (ax, preload) in enumerate(zip(axes.flat, preloads)):
        labels = [f"{n} x {n}" for n in contact_points]
        plot_curves([curves[n][k] for n in contact_points], ax, labels=labels, title=f"{preload:g} N")
    save_figure(figure, figures / "fig15_contact_points.png")

    study = studies[24]
    curve = study.track(STATUS_PRELOAD, BAND)
    solution = curve.unknowns[curve.peak.index]
    status = contact_status(study, solution, STATUS_PRELOAD)
    chosen = [status.rows(side)[k] for side in ("left", "right") for k in (0, 7, 11, 20)]
    title = f"{STATUS_PRELOAD:g} N, {curve.peak.frequency:.1f} Hz"
    save_figure(plot_status_bars(status, chosen, title=title), figures / "fig16_status_bars.png")
    figure, axes = plt.subplots(2, 1, figsize=(5.6, 4.2), layout="constrained")
    for ax, side in zip(axes, ("left", "right")):
        plot_status_map(status, study.model, side, ax, title=f"{side} face, shares of the period ({title})")
    save_figure(figure, figures / "fig16_status_maps.png")
    scale = animate_damper(study, solution, STATUS_PRELOAD, figures / "fig16_damper.gif", frames=frames)
    share = status.share[[*status.rows("left"), *status.rows("right")]].mean(axis=(0, 1))
    print(
        f"at {title}: stick {share[0]:.3f}, slip {share[1]:.3f}, open {share[2]:.3f}; animation magnified {scale:.0f} times"
    )
    return {"curves": curves, "status": status, "curve": curve}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    main(parser.parse_args().figures)
