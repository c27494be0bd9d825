"""Nonlinear modes and limit cycles: frequency and damping over amplitude."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from bdamper.modes.flutter import Flutter
from bdamper.modes.result import NonlinearMode
from bdamper.plot.axes import DASHED, colours, drawing, given_axes, lost, stacked
from bdamper.util.plotting import draws
from bdamper.util.tables import label
from bdamper.util.text import amount


@draws(NonlinearMode)
def plot_nonlinear_mode(mode: NonlinearMode, ax: tuple[Axes, Axes] | None = None, *, title: str = "", **style: Any) -> Any:
    """Frequency and damping of a nonlinear mode over the amplitude of the response.

    Parameters
    ----------
    mode : NonlinearMode
    ax : two matplotlib axes, optional
        For frequency and damping.
    title : str
    style
        Of the lines, as matplotlib's ``plot`` takes it.

    Returns
    -------
    two matplotlib axes
        Circles are folds, where the amplitude turns; lines are dashed where the motion is no longer that of the mode.
    """
    upper, lower = stacked() if ax is None else given_axes(ax, 2, "a nonlinear mode")
    with drawing(upper, title=title or f"mode {mode.mode}, preload {amount(mode.preload, 'N')}"):
        for axes, values in ((upper, mode.frequency), (lower, 100.0 * mode.damping_ratio)):
            for b in np.unique(mode.branch):
                own, foreign = mode.branch == b, mode.correlation < 0.5
                for part, line in ((own & ~foreign, "-"), (own & foreign, DASHED)):
                    look: dict[str, Any] = {"color": "C0", "linestyle": line, **style}
                    axes.plot(mode.amplitude, np.where(part, values, np.nan), **look)
            axes.plot(mode.amplitude[mode.folds], values[mode.folds], "ok", markersize=3.0, markerfacecolor="w")
        upper.set(ylabel=label(NonlinearMode, "frequency"), xscale="log")
        lower.set(ylabel="Modal damping ratio (%)", xlabel="Amplitude of the response (m)")
    return upper, lower


@draws(Flutter)
def plot_flutter(flutter: Flutter, ax: Axes | None = None, *, title: str = "") -> Axes:
    """Limit cycles over the preload: filled where they are stable, open where starts beyond them grow.

    Parameters
    ----------
    flutter : Flutter
    ax : matplotlib axes, optional
    title : str

    Returns
    -------
    matplotlib axes
        Crosses at the lower edge: rest is unstable there.
    """
    diameters = np.unique(flutter.nodal_diameter)
    with drawing(ax, title=title, legend=7.0) as ax:
        for d, colour in zip(diameters, colours(len(diameters))):
            own, cycle, stable = flutter.nodal_diameter == d, flutter.amplitude > 0.0, flutter.stable
            for part, face, what in ((cycle & stable, colour, "stable"), (cycle & ~stable, "w", "unstable")):
                ax.plot(flutter.preload[own & part], flutter.amplitude[own & part], "o", color=colour, markerfacecolor=face,
                        markersize=4.0, label=f"{what}, nodal diameter {d}")  # fmt: skip
            lost(ax, flutter.preload[own & ~cycle & ~stable], colour, "rest unstable", 4.0)
        ax.set(xlabel=label(Flutter, "preload"), ylabel=label(Flutter, "amplitude"), yscale="log")
        if flutter.preload.min() > 0.0:
            ax.set_xscale("log")
    return ax
