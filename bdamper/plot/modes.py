"""Nonlinear modes and limit cycles: frequency and damping over amplitude."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from bdamper.modes.result import NonlinearMode
from bdamper.plot.axes import DASHED, PAPER, few_ticks
from bdamper.util.plotting import draws
from bdamper.util.tables import label
from bdamper.util.text import length


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
    unit, name = length(mode.amplitude)
    with plt.rc_context(PAPER):
        upper, lower = plt.subplots(2, 1, sharex=True, figsize=(5.2, 4.6))[1] if ax is None else ax
        for axes, values in ((upper, mode.frequency), (lower, 100.0 * mode.damping_ratio)):
            for b in np.unique(mode.branch):
                own, foreign = mode.branch == b, mode.correlation < 0.5
                for part, line in ((own & ~foreign, "-"), (own & foreign, DASHED)):
                    axes.plot(
                        unit * mode.amplitude, np.where(part, values, np.nan), **{"color": "C0", "linestyle": line, **style}
                    )
            axes.plot(
                unit * mode.amplitude[mode.folds], values[mode.folds], "o", color="k", markersize=3.0, markerfacecolor="w"
            )
        upper.set(ylabel=label(NonlinearMode, "frequency"), title=title or f"mode {mode.mode} at {mode.preload:g} N")
        lower.set(ylabel="Modal damping ratio (%)", xlabel=f"Amplitude of the response ({name})", xscale="log")
        few_ticks(lower)
    return upper, lower
