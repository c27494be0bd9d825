"""Whole wheels: deviations and amplitudes of the blades, envelopes, statistics of many wheels."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from bdamper.plot.axes import colours, drawing
from bdamper.util.plotting import draws
from bdamper.wheel.mistuning import Mistuning


@draws(Mistuning)
def plot_mistuning(mistuning: Mistuning, ax: Axes | None = None, *, title: str = "") -> Axes:
    """Bars of the frequency deviation of every blade, side by side where its modes differ.

    Parameters
    ----------
    mistuning : Mistuning
    ax : matplotlib axes, optional
    title : str

    Returns
    -------
    matplotlib axes
    """
    values = 100.0 * mistuning.deviation.reshape(mistuning.n_blades, -1)
    n = values.shape[1]
    with drawing(ax, title=title, legend=7.0 if n > 1 else None) as ax:
        for k, (column, colour) in enumerate(zip(values.T, colours(n))):
            place = np.arange(mistuning.n_blades) + (k - 0.5 * (n - 1)) * 0.8 / n
            ax.bar(place, column, width=0.8 / n, color=colour, edgecolor="k", linewidth=0.3, label=f"mode {k + 1}")
        ax.axhline(0.0, color="k", linewidth=0.6)
        ax.set(xlabel="Blade", ylabel="Frequency deviation, clamped (%)")
    return ax
