"""The response over frequency and preload as a map, from the whole curves of an optimal curve."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from bdamper.plot.axes import NEW, OPTIMUM, highest_on, picture
from bdamper.plot.curves import FREQUENCY, PRELOAD
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.util import validation


@picture(OptimalCurve, "map")
def plot_response_map(result: OptimalCurve, ax: Axes = NEW) -> None:
    """Highest response over frequency and preload, the ridge of the optimal curve, and where there are several responses.

    Hatched is where the response curve leads over a frequency more than once, so that several solutions exist there.

    Parameters
    ----------
    result : OptimalCurve
        With its curves, which files of versions before 0.6 do not have.
    """
    curves = [curve for curve in result.curves if len(curve)]
    validation.require(len(curves) >= 2, "result", "an optimal curve with two or more curves", len(curves))
    low, high = result.settings["frequency"]
    # frequencies at which each curve is read: the map of a column is then narrower than a pixel of a printed page
    columns = 400
    frequency = np.linspace(low, high, columns)
    read = [highest_on(frequency, curve.frequency, curve.amplitude[:, None], curve.branch) for curve in curves]
    height, count = np.array([best[:, 0] for best, _ in read]), np.array([often for _, often in read])
    preload = np.array([curve.preload for curve in curves])
    shown = ax.pcolormesh(frequency, preload, height, shading="nearest", norm="log", rasterized=True)
    ax.figure.colorbar(shown, ax=ax, label="Amplitude (m)")
    if (count > 1).any():
        ax.contourf(frequency, preload, (count > 1).astype(float), levels=[0.5, 1.5], colors="none", hatches=["////"])
        ax.fill([], [], facecolor="none", edgecolor="0.3", hatch="////", label="several solutions")
    ax.plot(result.frequency, result.preload, color=OPTIMUM, label="highest")
    if np.isfinite(result.optimum.preload):
        look: dict[str, Any] = {"color": OPTIMUM, "markeredgecolor": "w", "markersize": 11.0, "linestyle": "none"}
        ax.plot(result.optimum.frequency, result.optimum.preload, marker="*", label="optimum", **look)
    ax.set(yscale="log", xlabel=FREQUENCY, ylabel=PRELOAD)
