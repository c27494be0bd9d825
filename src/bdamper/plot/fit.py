"""Fits of measured responses and loops."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from bdamper.analyses.fit import Fitted
from bdamper.analyses.loop_fit import FittedLoop
from bdamper.plot.axes import MARKERS, NEW, colours, picture
from bdamper.util.formatting import spaced


@picture(Fitted, size=(6.0, 5.2), rows=2)
def plot_fit(result: Fitted, ax: NDArray = NEW) -> None:
    """Measured amplitudes with those of the model, and below them the residuals in units of the noise.

    Grey between -2 and 2 in the lower picture: where 95 % of the points lie if the model is right.

    Parameters
    ----------
    result : Fitted
    """
    above, below = ax
    for t, (colour, name) in enumerate(zip(colours(len(result.tests)), result.tests)):
        rows = np.flatnonzero(result.test == t)
        rows = rows[np.argsort(result.place[rows])]
        marker = MARKERS[t % len(MARKERS)]
        look = {"linestyle": "none", "marker": marker, "markersize": 3.0, "color": colour}
        above.plot(result.place[rows], np.abs(result.measured[rows]), markerfacecolor="none", **look, label=name)
        above.plot(result.place[rows], np.abs(result.model[rows]), color=colour)
        below.plot(result.place[rows], result.residual[rows, 0], **look)
    below.axhspan(-2.0, 2.0, color="0.9", zorder=0)
    above.plot([], [], color="k", label="model")
    above.set(yscale="log", ylabel="Response amplitude (m)")
    below.set(xlabel="Frequency (Hz)", ylabel="Residual of the amplitude\nover the noise")


@picture(Fitted, "information", size=(5.6, 3.2))
def plot_information(result: Fitted, ax: Axes = NEW) -> None:
    """Shares of the tests in the information about each parameter.

    Parameters
    ----------
    result : Fitted
    """
    place, left = np.arange(len(result.names))[::-1], np.zeros(len(result.names))
    hatches = ("", "//", "..", "xx", "\\\\")
    for t, (colour, name) in enumerate(zip(colours(len(result.tests)), result.tests)):
        share = 100.0 * result.information[:, t]
        look = {"facecolor": colour, "edgecolor": "w", "linewidth": 0.5, "hatch": hatches[t % len(hatches)]}
        ax.barh(place, share, left=left, label=name, **look)
        left = left + share
    ax.set_yticks(place, [spaced(name) for name in result.names])
    ax.set(xlabel="Share of what is known of the parameter (%)", xlim=(0.0, 100.0))


@picture(FittedLoop, size=(4.4, 3.6))
def plot_loop(result: FittedLoop, ax: Axes = NEW) -> None:
    """Measured force over displacement with the loop of the sliders that was found.

    Parameters
    ----------
    result : FittedLoop
    """
    ax.plot(result.displacement, result.force, "o", color="0.3", markersize=3.0, markerfacecolor="none", label="measured")
    ax.plot(result.displacement, result.model, color="k", label=f"{result.sliders} sliders")
    ax.set(xlabel="Displacement (m)", ylabel="Force (N)")
