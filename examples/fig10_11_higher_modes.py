"""Tracking, optimal and frequency-shift curves of the third and the seventh blade mode (Figs 10 and 11 of the paper).

Mode 3, 1210 Hz, is the second bending mode in the plane of rotation and is excited at the corner of the tip in the
tangential direction; mode 7, 3131 Hz, is excited in the axial direction.  The paper gives no numbers for these modes.

* The amplitude falls to an optimum and rises to that of the stuck damper, and the resonance moves to the stuck frequency:
  holds.  Mode 3 has folds, like mode 1; mode 7 has none, converged below 100 N only.
* In mode 7 the approximations decide about the sign of the shift: -0.6 % with the settings of the paper, where the damper
  adds mass, +0.4 % converged.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from paper_disk import MODES, plot_beside, stored, study

import bdamper as bd
from bdamper.continuation.curve import Curve
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.plot import plot_optimal, save_figure


@dataclass(frozen=True)
class Case:
    """Preloads of the tracking curves, and the interval of the optimal curve (N)."""

    preloads: tuple[float, ...]
    interval: tuple[float, float]


CASES = {
    3: Case((50.0, 100.0, 200.0, 500.0, 2000.0), (50.0, 10e3)),
    7: Case((20.0, 50.0, 100.0, 200.0, 500.0), (20.0, 5e3)),
}


@dataclass(frozen=True)
class HigherMode:
    """Tracking curves with the settings of the paper and converged, and the optimal curve with those of the paper."""

    paper: list[Curve]
    converged: list[Curve]
    optimal: OptimalCurve


def main(figures: Path = Path("figures"), n: int = 25) -> dict[int, HigherMode]:
    """Compute and draw the figures; returns tracking and optimal curves of modes 3 and 7."""
    figures.mkdir(parents=True, exist_ok=True)
    out = {}
    for mode, case in CASES.items():
        asked, rich, band = study(mode, **bd.PAPER), study(mode), MODES[mode].band
        found = HigherMode(
            [asked.track(p, band, stability=True) for p in case.preloads],
            [stored(f"mode_{mode}_{p:g}N") for p in case.preloads],
            asked.optimal_curve(case.interval, n, frequency=band, check=False),
        )
        out[mode] = found
        name = f"Mode {mode}, 1 N {MODES[mode].direction}"
        limits = [[s.free(band), s.stuck(band)] for s in (asked, rich)]
        figure = plot_beside([*limits[0], *found.paper], [*limits[1], *found.converged], name)
        save_figure(figure, figures / f"fig10_tracking_mode_{mode}.png")
        for which, curves in (("settings of the paper", found.paper), ("converged", found.converged)):
            peaks = ", ".join(f"{c.preload:.0f} N {1e6 * c.peak.amplitude:.3f} um ({len(c.folds)} folds)" for c in curves)
            print(f"mode {mode}, {which}: {peaks}")
        print(found.optimal)
        ax, right = plot_optimal(found.optimal, title=name, coexisting=False)
        peaks = [(c.preload, c.peak.amplitude, 100.0 * (c.peak.frequency / found.optimal.free.frequency - 1.0))
                 for c in found.converged]  # fmt: skip
        preload, amplitude, shift = zip(*peaks)
        ax.plot(preload, amplitude, "o", color="0.1", markerfacecolor="w", label="amplitude, converged")
        right.plot(preload, shift, "s", color="0.5", markerfacecolor="w", markersize=4.5)
        ax.plot([], [], "s", color="0.5", markerfacecolor="w", markersize=4.5, label="frequency shift, converged")
        ax.set_ylim(bottom=0.7 * min(*amplitude, found.optimal.optimum.amplitude))
        ax.legend(fontsize=6.5)
        save_figure(ax, figures / f"fig11_optimal_mode_{mode}.png")
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    main(parser.parse_args().figures)
