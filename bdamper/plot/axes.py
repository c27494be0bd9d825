"""Axes, colours and files: what all pictures share.

Curves are told apart by lightness (dark to light with rising preload) and by sparse markers, so that they stay legible in
grey.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
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


def newtons(value: float) -> str:
    """A force in a legend."""
    return f"{value / 1000.0:g} kN" if 1000.0 <= value < 1e6 else f"{value:g} N"


def length(*values: NDArray) -> tuple[float, str]:
    """Factor from metres to the unit that suits the largest of some lengths, and that unit."""
    largest = max(float(np.nanmax(np.abs(v), initial=0.0)) for v in values)
    return (1e6, "µm") if largest < 1e-3 else (1e3, "mm") if largest < 1.0 else (1.0, "m")


def few_ticks(ax: Axes) -> None:
    """Plain numbers at 1, 2 and 5 on a logarithmic horizontal axis of less than two decades, decades alone beyond."""
    low, high = ax.get_xlim()
    if high < 100.0 * low:
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
