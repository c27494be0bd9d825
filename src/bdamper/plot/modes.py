"""Nonlinear modes and limit cycles: frequency and damping over amplitude."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from bdamper.analyses.flutter import Flutter
from bdamper.analyses.nonlinear_mode_result import NonlinearMode
from bdamper.plot.axes import DASHED, NEW, looks, lost, picture, runs
from bdamper.plot.column_plot import draw_table
from bdamper.util.formatting import amount


@picture(NonlinearMode, size=(5.6, 4.8), rows=2)
def plot_nonlinear_mode(mode: NonlinearMode, ax: NDArray = NEW, **style: Any) -> None:
    """Frequency and damping of a nonlinear mode over the amplitude of the response, in two axes.

    Circles are folds, where the amplitude turns; lines are dashed where the motion is no longer that of the mode.

    Parameters
    ----------
    mode : NonlinearMode
    style
        Of the lines, as matplotlib's ``plot`` takes it.
    """
    folds: dict[str, Any] = {"linestyle": "", "marker": "o", "color": "k", "markersize": 3.0, "markerfacecolor": "w"}
    for axes, name in zip(ax, ("frequency", "damping_ratio")):
        for first, last in runs(mode.correlation < 0.5):
            line = {"color": "C0", "marker": "", "linestyle": DASHED if mode.correlation[first] < 0.5 else "-", **style}
            draw_table(axes, mode, "amplitude", name, rows=slice(first, last + 2), **line)  # joined to the next stretch
        draw_table(axes, mode, "amplitude", name, rows=mode.folds, **folds)
    ax[0].set(xlabel="", title=f"mode {mode.mode}, preload {amount(mode.preload, 'N')}")


@picture(Flutter)
def plot_flutter(flutter: Flutter, ax: Axes = NEW) -> None:
    """Limit cycles over the preload: filled where they are stable, open where starts beyond them grow.

    Crosses at the lower edge: rest is unstable there.
    """
    diameters, cycle, stable = np.unique(flutter.nodal_diameter), flutter.amplitude > 0.0, flutter.stable
    for d, look in zip(diameters, looks(len(diameters))):
        own = flutter.nodal_diameter == d
        for part, face, what in ((cycle & stable, look["color"], "stable"), (cycle & ~stable, "w", "unstable")):
            look |= {"linestyle": "", "markerfacecolor": face, "label": f"{what}, nodal diameter {d}"}
            draw_table(ax, flutter, "preload", "amplitude", rows=own & part, **look)
        lost(ax, flutter.preload[own & ~cycle & ~stable], look["color"], "rest unstable", 4.0)
    ax.set(yscale="log", xscale="log" if flutter.preload.min() > 0.0 else "linear")
