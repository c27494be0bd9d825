"""Number of contact points, and what each of them does over a period (Figs 15 and 16 of the paper).

Tracking curves with 9, 24 and 48 points on each face, which are 3 x 3, 4 x 6 and 4 x 12 along the slope and along the
axis.

* 24 and 48 points are closer to each other: holds (0.3 % with the settings of the paper, 6 % converged), for they have the
  same four rows along the slope, and in mode 1 the damper turns about the axis.  Points along the axis hardly matter.
* 9 points underestimate the amplitude: does not hold but for the stuck damper.  At 100 and 200 N their three rows
  overestimate it by half and by a fifth, converged as well.
* More points capture several solutions better: does not hold in the number of folds, which is largest with 9 points.
* At 100 N the number of points does not converge: 2, 3, 4 and 5 rows give 0.22, 0.20, 0.15 and 0.07 mm.  The faces are open
  for nine tenths of the period, and the damper touches with its edges in turn; how far the last row stands from the edge
  decides about its lever.  From 200 N on four rows are within 1 % of five.
* Partial slip on both faces, with other states at other points: holds.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
from paper_disk import MODES, stored, study

import bdamper as bd
from bdamper.continuation.curve import Curve
from bdamper.plot import animate_damper, plot_curves, plot_status_bars, plot_status_map, save_figure
from bdamper.plot.axes import PAPER
from bdamper.plot.motion import ContactStatus, contact_status

PRELOADS = (100.0, 200.0, 1000.0, 25000.0)
POINTS = (9, 24, 48)
STATUS_PRELOAD = 5000.0
SAMPLE = (0, 3, 12, 21)
"""Points of each face whose periods are drawn: at the ridge, at one end and in the middle, and further down the slope."""


@dataclass(frozen=True)
class Points:
    """Tracking curves by number of points, a list over the preloads, and those converged at the lowest of them; status and
    curve at 5 kN with 24 points.
    """

    curves: dict[int, list[Curve]]
    converged: dict[int, Curve]
    status: ContactStatus
    curve: Curve


def plot_points(curves: dict[int, list[Curve]], converged: dict[int, Curve], path: Path) -> None:
    """Curves of all numbers of points at each preload with the settings of the paper, and converged at the lowest one."""
    panels = [(f"{p:g} N, settings of the paper", [curves[n][k] for n in POINTS]) for k, p in enumerate(PRELOADS)]
    panels.insert(1, (f"{PRELOADS[0]:g} N, converged", [converged[n] for n in POINTS]))
    labels = [f"{n} x {n} points" for n in POINTS]
    with plt.rc_context(PAPER):
        figure, axes = plt.subplots(2, 3, figsize=(9.0, 5.6), sharex=True)
    places = axes.flat
    for ax, (title, found) in zip(places, panels):
        print(f"{title:34}" + "".join(f"{1e3 * c.peak.amplitude:>11.4f} mm{c.peak.frequency:>9.2f} Hz" for c in found))
        plot_curves(found, ax, labels=labels, title=title)
        ax.get_legend().remove()
        ax.set_xlabel("Frequency (Hz)" if ax in axes[1] else "")
        if ax not in axes[:, 0]:
            ax.set_ylabel("")
    axes[0, 1].set_ylim(axes[0, 0].get_ylim())
    handles, names = axes[0, 0].get_legend_handles_labels()
    axes[1, 2].set_axis_off()
    axes[1, 2].legend(handles, names, loc="center", fontsize=8.0)
    axes[0, 2].set_xlabel("Frequency (Hz)")
    axes[0, 2].tick_params(labelbottom=True)
    save_figure(figure, path)


def plot_status(asked: bd.Study, preload: float, name: str, figures: Path) -> tuple[ContactStatus, Curve]:
    """Bars of sample points and maps of both faces at the resonance."""
    curve = asked.track(preload, MODES[1].band)
    status = contact_status(asked, curve.unknowns[curve.peak.index], preload)
    chosen = [status.rows(side)[k] for side in ("left", "right") for k in SAMPLE]
    title = f"{preload:g} N, {curve.peak.frequency:.1f} Hz, {name}"
    file = name.split()[-1]
    save_figure(plot_status_bars(status, chosen, title=title), figures / f"fig16_status_bars_{file}.png")
    with plt.rc_context(PAPER):
        figure, axes = plt.subplots(2, 1, figsize=(5.6, 4.6))
    for ax, side in zip(axes, ("left", "right")):
        plot_status_map(status, asked.model, side, ax, title=f"{side} face, shares of the period ({title})")
    axes[0].set_xlabel("")
    save_figure(figure, figures / f"fig16_status_maps_{file}.png")
    both = [*status.rows("left"), *status.rows("right")]
    stick, slip, opened = status.share[both].mean(axis=(0, 1))
    print(f"at {title}: stick {stick:.3f}, slip {slip:.3f}, open {opened:.3f}")
    return status, curve


def main(figures: Path = Path("figures"), frames: int = 36) -> Points:
    """Compute and draw the figures and the animation."""
    figures.mkdir(parents=True, exist_ok=True)
    asked = {n: study(1, n, **bd.PAPER) for n in POINTS}
    curves = {n: [asked[n].track(p, MODES[1].band) for p in PRELOADS] for n in POINTS}
    lowest = f"{PRELOADS[0]:g}N"
    converged = {n: stored(f"mode_1_{lowest}" if n == 24 else f"points_{n}_{lowest}") for n in POINTS}
    print(f"{'':34}" + "".join(f"{f'{n} x {n} points':>25}" for n in POINTS))
    plot_points(curves, converged, figures / "fig15_contact_points.png")
    status, curve = plot_status(asked[24], STATUS_PRELOAD, "settings of the paper", figures)
    plot_status(study(1), STATUS_PRELOAD, "converged", figures)
    solution = curve.unknowns[curve.peak.index]
    scale = animate_damper(asked[24], solution, STATUS_PRELOAD, figures / "fig16_damper.gif", frames=frames)
    print(f"animation magnified {scale:.0f} times")
    return Points(curves, converged, status, curve)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    main(parser.parse_args().figures)
