"""Axes, colours and files: what all pictures share.

The style stands in ``style.mplstyle``.  A line is solid where the response is stable, dashed where it is unstable, dotted
where it jumps; the limits without contact and with all contacts stuck are thin grey lines that bear their names.  Colours
go from dark to light with rising preload, so that they stay apart in grey and for the colour-blind.  What is drawn is in
metres and newtons; the numbers on the axes are in the unit that fits (:func:`fit_units`).
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from bdamper.util import validate
from bdamper.util.plotting import Plottable, draw, draws
from bdamper.util.tables import label
from bdamper.util.text import FITTING, PREFIXES, fitting

MARKERS = "osD^v<>pP*hX"
MINUS = "\N{MINUS SIGN}"
SHEET = Path(__file__).with_name("style.mplstyle")
PAPER: dict[Any, Any] = matplotlib.rc_params_from_file(SHEET, use_default_template=False)
"""The style of this room, for ``plt.rc_context``."""
FIXED: dict[Any, Any] = {**PAPER, "figure.constrained_layout.use": False}
"""The same for a figure whose axes have their places given."""
STYLES = ("-", "-.", (0, (6, 1, 1, 1, 1, 1)), (0, (10, 2)), (0, (1, 0.6)), (0, (3, 1, 1, 1)))
"""Lines that are told apart in grey; dashes and dots alone have their meaning."""
DASHED = (0, (3, 1.5))
"""Line of what is unstable."""
LIMITS: dict[str, dict[str, Any]] = {
    "free": {"color": "0.6", "linewidth": 1.0},
    "stuck": {"color": "0.45", "linewidth": 1.0},
}
"""Lines of the limits without contact and with all contacts stuck; that of the tuned wheel is like the latter."""


def new_axes(width: float = 5.6, height: float = 3.6) -> Axes:
    """Empty axes in the style of this room (size in inches)."""
    with plt.rc_context(PAPER):
        return plt.subplots(figsize=(width, height))[1]


@contextmanager
def drawing(
    ax: Axes | None = None, *, size: tuple[float, float] = (5.6, 3.6), title: str = "", legend: float | None = None
) -> Iterator[Axes]:
    """Axes to draw into in the style of this room, which get their title, units and legend in the end.

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
            axes.set_title(title)
        if legend is not None:
            legend_beside(axes, legend)
        for each in axes.figure.axes:
            fit_units(each)


def stacked(height: float = 4.8, ratios: tuple[float, float] = (1.0, 1.0)) -> NDArray:
    """Two axes, one below the other, over the same quantity, in the style of this room."""
    with plt.rc_context(PAPER):
        return np.asarray(plt.subplots(2, 1, sharex=True, figsize=(5.6, height), height_ratios=ratios)[1])


def given_axes(ax: Any, count: int, of: str) -> list[Any]:
    """The axes that were given for a picture, or the error where they are not as many as it has."""
    found = np.ravel(np.asarray(ax, object)).tolist()
    if len(found) != count or not all(isinstance(each, Axes) for each in found):
        raise validate.unfit("ax", f"{('one', 'two')[count - 1]} axes for {of}", [type(each).__name__ for each in found])
    return found


def legend_beside(ax: Axes, size: float = 7.0, handles: Sequence[Any] = ()) -> None:
    """A legend where no curve is: to the right of the axes, below those with a second axis at the right.

    Parameters
    ----------
    ax : matplotlib axes
    size : float
        Of its letters.
    handles : sequence of matplotlib artists
        By default all that are labelled.
    """
    twins = [other for other in ax.figure.axes if other is not ax and other.bbox.bounds == ax.bbox.bounds]
    given = (handles, [h.get_label() for h in handles]) if handles else ax.get_legend_handles_labels()
    if not given[0]:
        return
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2), "ncols": 3}
    ax.legend(*given, fontsize=size, **below if twins else {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)})


def fit_units(ax: Axes) -> None:
    """Numbers and labels of axes in the unit that fits, as µm for metres; logarithmic ones get few and plain numbers."""
    for axis in (ax.xaxis, ax.yaxis):
        shared = ax.get_shared_x_axes() if axis is ax.xaxis else ax.get_shared_y_axes()
        if not axis.get_label_text() and len(shared.get_siblings(ax)) > 1:
            continue  # the axes that it shares its numbers with say the unit
        log = axis.get_scale() == "log"
        low, high = sorted(np.abs(axis.get_view_interval()))
        name, _, unit = axis.get_label_text().rpartition(" (")
        base, scale = axis.label.get_gid() or unit.removesuffix(")"), 1.0
        if name and base in FITTING:
            prefix = fitting(float(np.sqrt(low * high)) if log else float(high), base)
            scale = PREFIXES[prefix]
            axis.label.set_gid(base)  # the unit of what is drawn, for the next time
            axis.set_label_text(f"{name} ({prefix.strip()}{base})")
        if log:
            few = (1.0,) if high > 100.0 * low else (1.0, 2.0, 5.0)
            subs = few if high > 12.0 * low else (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
            axis.set_major_locator(LogLocator(subs=subs) if high > 2.0 * low else MaxNLocator(5))
            axis.set_minor_formatter(NullFormatter())
        if log or scale != 1.0:
            axis.set_major_formatter(FuncFormatter(lambda value, _, scale=scale: plain_number(value / scale)))


def plain_number(value: float) -> str:
    """A number of an axis with six digits, no power of ten and the sign of printed text."""
    return np.format_float_positional(float(f"{value:.6g}"), trim="-").replace("-", MINUS)


def save_figure(target: Axes | Figure | Sequence[Axes] | NDArray, path: Any, **options: Any) -> None:
    """Write a figure, or that of some axes, to a file, and close it; ``options`` as matplotlib's ``savefig`` takes them."""
    first = np.ravel(np.asarray(target, object))[0]
    figure = first if isinstance(first, Figure) else first.figure
    with plt.rc_context(PAPER):
        figure.savefig(path, **options)
    plt.close(figure)


@draws(Plottable, "image")
def image_of(shown: Plottable) -> bytes:
    """The picture of an object as a PNG file, for a notebook."""
    file = io.BytesIO()
    save_figure(draw(shown, "plot"), file, format="png", dpi=100)
    return file.getvalue()


def colours(n: int) -> NDArray:
    """(n, 4) colours of monotone lightness, the last still dark enough on white paper."""
    return plt.get_cmap("viridis")(np.linspace(0.0, 0.7, max(n, 1)))


def runs(values: NDArray) -> list[tuple[int, int]]:
    """Stretches (first, last) of equal value."""
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(values.astype(int))) + 1, [len(values)]])
    return [(int(a), int(b) - 1) for a, b in pairwise(cuts) if b > a]


def over_preload(ax: Axes, result: type) -> None:
    """Labels and logarithmic scales of a resonance amplitude over the preload, which are columns of a type of result."""
    ax.set(xscale="log", yscale="log", xlabel=label(result, "preload"), ylabel=label(result, "amplitude"))


def band(ax: Axes, x: NDArray, low: NDArray, high: NDArray, colour: str | NDArray) -> None:
    """What lies between two lines, where both are known."""
    known = np.isfinite(low) & np.isfinite(high)
    ax.fill_between(x, low, high, where=known, color=colour, alpha=0.15, linewidth=0.0)


def limit_line(ax: Axes, name: str, x: Sequence[float] | NDArray, y: Sequence[float] | NDArray, at: float) -> None:
    """A limit, or both, as a thin line that bears its name above the point next to a place, of those that are known."""
    look = LIMITS.get(name, LIMITS["stuck"])
    ax.plot(x, y, **look)
    away = np.where(np.isfinite(y), np.abs(np.asarray(x) - at), np.inf)
    if np.isfinite(away).any():
        k = int(np.argmin(away))
        side = {0: "left", len(away) - 1: "right"}.get(k, "center")  # within the axes
        ax.annotate(name, (x[k], y[k]), xytext=(0, 2), textcoords="offset points", ha=side, fontsize=7.0,
                    color=look["color"])  # fmt: skip


def lost(
    ax: Axes, places: Sequence[float | str] | NDArray, colour: str | NDArray, name: str | None = None, size: float = 5.0
) -> None:
    """Crosses at the lower edge, where there is no value."""
    across = ax.get_xaxis_transform()
    ax.plot(places, np.full(np.shape(places), 0.03), "x", color=colour, markersize=size, transform=across, label=name)
