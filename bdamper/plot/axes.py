"""Axes, colours and files: what all pictures share.

Curves are told apart by lightness (dark to light with rising preload) and by sparse markers, so that they stay legible in
grey.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from bdamper.model.model import Model
from bdamper.util.plotting import Plottable, draw, draws
from bdamper.util.tables import label

MARKERS = "osD^v<>pP*hX"
PAPER: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.grid": True,
    "grid.color": "0.9",
    "axes.axisbelow": True,
    "lines.linewidth": 1.2,
    "legend.frameon": True,  # on white, so that what lies below is not taken for a part of it
    "legend.edgecolor": "none",
    "legend.framealpha": 0.85,
    "legend.fontsize": 8.0,
    "figure.constrained_layout.use": True,
    "savefig.dpi": 200,
}
"""Settings of a figure that fits one column of a paper."""
FIXED: dict[Any, Any] = {**PAPER, "figure.constrained_layout.use": False}
"""The same for a figure whose axes have their places given."""
STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)))
"""Lines that are told apart in grey."""
DASHED = (0, (3, 1.5))
"""Line of what is unstable, and of means."""


def new_axes(width: float = 5.2, height: float = 3.6) -> Axes:
    """Empty axes in the style of this room (size in inches)."""
    with plt.rc_context(PAPER):
        return plt.subplots(figsize=(width, height))[1]


@contextmanager
def drawing(
    ax: Axes | None = None, *, size: tuple[float, float] = (5.2, 3.6), title: str = "", legend: float | None = None
) -> Iterator[Axes]:
    """Axes to draw into in the style of this room, which get their title and legend in the end.

    Parameters
    ----------
    ax : matplotlib axes, optional
        New ones of the given ``size`` in inches otherwise.
    title : str
    legend : float, optional
        Size of its letters; no legend otherwise.
    """
    with plt.rc_context(PAPER):
        axes = new_axes(*size) if ax is None else ax
        yield axes
        if title:
            axes.set_title(title, fontsize=9.0)
        if legend is not None:
            axes.legend(fontsize=legend)


def save_figure(target: Axes | Figure | tuple[Axes, ...], path: Any, **options: Any) -> None:
    """Write a figure, or that of some axes, to a file, and close it; ``options`` as matplotlib's ``savefig`` takes them."""
    first = target[0] if isinstance(target, tuple) else target
    figure = first if isinstance(first, Figure) else first.figure
    with plt.rc_context(PAPER):
        figure.savefig(path, **options)  # type: ignore[union-attr]
    plt.close(figure)  # type: ignore[arg-type]


@draws(Plottable, "image")
def image_of(shown: Plottable) -> bytes:
    """The picture of an object as a PNG file, for a notebook."""
    options = {"backend": "matplotlib"} if isinstance(shown, Model) else {}  # whatever else is installed
    file = io.BytesIO()
    save_figure(draw(shown, "plot", **options), file, format="png", dpi=100)
    return file.getvalue()


def colours(n: int) -> NDArray:
    """(n, 4) colours of monotone lightness."""
    return plt.get_cmap("viridis")(np.linspace(0.0, 0.85, max(n, 1)))


def runs(values: NDArray) -> list[tuple[int, int]]:
    """Stretches (first, last) of equal value."""
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(values.astype(int))) + 1, [len(values)]])
    return [(int(a), int(b) - 1) for a, b in pairwise(cuts) if b > a]


def few_ticks(ax: Axes, which: str = "x") -> None:
    """Plain numbers at 1, 2 and 5 on a logarithmic axis of less than two decades, decades alone beyond."""
    axis = {"x": ax.xaxis, "y": ax.yaxis}[which]
    low, high = axis.get_view_interval()
    if high < 100.0 * low:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def over_preload(ax: Axes, result: type) -> None:
    """Labels and logarithmic scales of a resonance amplitude over the preload, which are columns of a type of result."""
    ax.set(xscale="log", yscale="log", xlabel=label(result, "preload"), ylabel=label(result, "amplitude"))
    few_ticks(ax)


def band(ax: Axes, x: NDArray, low: NDArray, high: NDArray, colour: str | NDArray) -> None:
    """What lies between two lines, where both are known."""
    known = np.isfinite(low) & np.isfinite(high)
    ax.fill_between(x, low, high, where=known, color=colour, alpha=0.15, linewidth=0.0)


def lost(
    ax: Axes, places: Sequence[float | str] | NDArray, colour: str | NDArray, name: str | None = None, size: float = 5.0
) -> None:
    """Crosses at the lower edge, where there is no value."""
    across = ax.get_xaxis_transform()
    ax.plot(places, np.full(np.shape(places), 0.03), "x", color=colour, markersize=size, transform=across, label=name)
