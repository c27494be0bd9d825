"""Tracking curves of the first two blade modes over preload (Figs 6 and 7 of the paper).

A disk of 65 blades with a wedge damper between each two is driven by engine order 5 at the trailing-edge corner of the
tip: with 1 N in the tangential direction for mode 1, with 12 N in the radial direction for mode 2, as in the paper.  (The
middle of the tip lies on the line that does not move radially in mode 2.)  Every curve is followed through its folds;
unstable parts are dashed.  On the right stands what the converged method says of the same body.

* Mode 1 has several solutions at one frequency, an unstable one between two stable ones, where the faces separate: holds,
  with the settings of the paper and converged.
* Mode 2 has none: holds from 250 N on, near the optimum, in both.  At 50 and 120 N, a fifth and a half of it, there are
  folds.
* With the preload the resonance moves to higher frequencies, and the amplitude falls to an optimum and rises to that of the
  stuck damper: holds.  Where in between the optimum lies, and how deep, is another matter: see Figs 8 and 9.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from paper_disk import MODES, plot_beside, stored, study

import bdamper as bd
from bdamper.continuation.curve import Curve
from bdamper.plot import save_figure

PRELOADS = {1: (50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0), 2: (50.0, 120.0, 250.0, 500.0, 1000.0, 2000.0)}
NAMES = {1: "Mode 1, 1 N tangential", 2: "Mode 2, 12 N radial"}


@dataclass(frozen=True)
class Tracking:
    """Curves of one mode at each preload, and the two limits with the settings of the paper."""

    limits: list[Curve]
    paper: list[Curve]
    converged: list[Curve]


def print_curves(name: str, curves: list[Curve]) -> None:
    """A line of a table for each curve."""
    print(f"{name:30}{'preload':>10}{'peak':>13}{'at':>11}{'folds':>7}{'open at the peak':>18}  status")
    for c in curves:
        peak = c.peak
        print(
            f"{'':30}{c.preload:>8.0f} N{1e3 * peak.amplitude:>10.5f} mm{peak.frequency:>8.2f} Hz{len(c.folds):>7}"
            f"{100 * c.shares[peak.index, 2]:>16.0f} %  {c.status}"
        )


def main(figures: Path = Path("figures")) -> dict[int, Tracking]:
    """Compute and draw both figures; returns the curves of each mode."""
    figures.mkdir(parents=True, exist_ok=True)
    out = {}
    for mode, preloads in PRELOADS.items():
        asked, band = study(mode, **bd.PAPER), MODES[mode].band
        limits = [asked.free(band), asked.stuck(band)]
        paper = [asked.track(preload, band, stability=True) for preload in preloads]
        converged = [stored(f"mode_{mode}_{preload:g}N") for preload in preloads]
        print_curves(f"mode {mode}, settings of the paper", paper)
        print_curves(f"mode {mode}, converged", converged)
        rich = study(mode)
        figure = plot_beside([*limits, *paper], [rich.free(band), rich.stuck(band), *converged], NAMES[mode])
        save_figure(figure, figures / f"fig0{5 + mode}_tracking_mode_{mode}.png")
        out[mode] = Tracking(limits, paper, converged)
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    main(parser.parse_args().figures)
