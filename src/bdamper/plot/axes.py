"""Axes, colours, units and files shared by all plots.

The style is in ``style.mplstyle``.  Conventions of all plots:

* Response lines are dashed if they are known to be unstable, otherwise solid, and dotted at jumps.
* Thin grey lines with names are the limits without contact (free) and with all contacts stuck.
* A red star is the optimum.  A green diamond with a bar is the mean and range of an amplitude in time.
* Colours go from dark to light with increasing preload, distinct in grey print and for colour-blind readers.

Data are plotted in SI units; axis labels and numbers use the prefix that fits (:func:`fit_units`).
"""

from __future__ import annotations

import inspect
import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, Locator, LogLocator, MaxNLocator, NullFormatter
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

from bdamper.util import validation
from bdamper.util.display import Plottable, draw, register_plot
from bdamper.util.formatting import FITTING, PREFIXES, unit_prefix
from bdamper.util.storage import file_errors

MARKERS = "osD^v<>pP*hX"
MINUS = "\N{MINUS SIGN}"
SHEET = Path(__file__).with_name("style.mplstyle")
STYLE: dict[Any, Any] = matplotlib.rc_params_from_file(SHEET, use_default_template=False)
"""Style of the plots, for ``plt.rc_context``."""
OPTIMUM = "#c0392b"
"""Colour of the optimum and of other extreme points."""
IN_TIME = "#1a7a3e"
"""Colour of amplitudes in time (diamonds with bars)."""
STYLES = ("-", "-.", (0, (6, 1, 1, 1, 1, 1)), (0, (10, 2)), (0, (1, 0.6)), (0, (3, 1, 1, 1)))
"""Line styles that are distinct in grey print; plain dashed and dotted lines have other meanings."""
DASHED = (0, (3, 1.5))
"""Line style of unstable solutions."""
SUBS = {12.0: (1.0, 1.5, 2.0, 3.0, 5.0, 7.0), 100.0: (1.0, 2.0, 5.0), 1e4: (1.0, 3.0), np.inf: (1.0,)}
"""Multiples of powers of ten at the ticks of a logarithmic axis, by the largest ratio of its ends."""
NEW: Any = None
"""Default of ``ax``: the decorator :func:`picture` replaces it by new axes."""
LIMITS: dict[str, dict[str, Any]] = {
    "free": {"color": "0.6", "linewidth": 1.0},
    "stuck": {"color": "0.45", "linewidth": 1.0},
}
"""Line styles of the free and stuck limits; the line of the tuned disk has the style of "stuck"."""


def broken(branch: NDArray, *columns: NDArray) -> list[NDArray]:
    """Return columns of numbers with a NaN between branches, so that no line connects these."""
    return [np.insert(column, np.flatnonzero(np.diff(branch)) + 1, np.nan, axis=0) for column in columns]


def new_axes(width: float = 5.6, height: float = 3.6, rows: int = 1, **options: Any) -> Any:
    """Return empty axes (size in inches), or an array of axes below each other with a common x axis."""
    with plt.rc_context(STYLE):
        return plt.subplots(rows, 1, figsize=(width, height), sharex=True, **options)[1]


@contextmanager
def drawing(
    ax: Axes | Sequence[Axes] | NDArray | None = None, *, size: tuple[float, float] = (5.6, 3.6), title: str = "",
    legend: float | None = None, rows: int = 1,
) -> Iterator[Any]:  # fmt: skip
    """Provide axes for a plot; set their title, units and legend at the end.

    Parameters
    ----------
    ax : matplotlib axes, or an array of ``rows`` axes, optional
        New axes of the given ``size`` (inches) by default.
    title : str
    legend : float, optional
        Font size of the legend; no legend by default.
    rows : int
        Number of axes below each other.
    """
    with plt.rc_context(STYLE):
        axes = np.ravel(np.asarray(new_axes(*size, rows) if ax is None else ax, object))
        if len(axes) != rows or not all(isinstance(each, Axes) for each in axes):
            raise validation.invalid(
                "ax", f"{('one', 'two', 'three')[rows - 1]} axes", [type(each).__name__ for each in axes]
            )
        try:
            yield axes if rows > 1 else axes[0]
        except BaseException:
            if ax is None:
                plt.close(axes[0].figure)
            raise
        if title:
            axes[0].set_title(title)
        if legend is not None:
            for each in axes:
                legend_beside(each, legend)
        for each in axes[0].figure.axes:
            fit_units(each)


def picture(
    shown: type = object, kind: str = "plot", *, size: tuple[float, float] = (5.6, 3.6), legend: float | None = 7.0,
    rows: int = 1,
) -> Callable[[Callable[..., None]], Callable[..., Any]]:  # fmt: skip
    """Return a decorator that registers a plot function for a type of result and provides its axes.

    The decorated function accepts ``ax`` (new axes if omitted) and ``title``, and returns the axes.  For the arguments see
    :func:`bdamper.util.display.register_plot` and :func:`drawing`.
    """

    def enter(function: Callable[..., None]) -> Callable[..., Any]:
        signature = inspect.signature(function)

        @wraps(function)
        def drawn(*arguments: Any, title: str = "", **options: Any) -> Any:
            bound = signature.bind(*arguments, **options)
            with drawing(bound.arguments.get("ax"), size=size, title=title, legend=legend, rows=rows) as axes:
                bound.arguments["ax"] = axes
                function(*bound.args, **bound.kwargs)
            return axes

        return drawn if shown is object else register_plot(shown, kind)(drawn)

    return enter


def legend_beside(ax: Axes, size: float = 7.0, handles: Sequence[Any] = ()) -> None:
    """Add a legend below the axes, in as many columns as fit.

    Parameters
    ----------
    ax : matplotlib axes
    size : float
        Font size.
    handles : sequence of matplotlib artists
        By default all artists with a label.
    """
    entries = (handles, [h.get_label() for h in handles]) if handles else ax.get_legend_handles_labels()
    if not entries[0]:
        return
    longest = max(len(line) for name in entries[1] for line in str(name).split("\n"))
    width = 0.55 * size * (longest + 8) * ax.figure.dpi / 72.0
    columns = max(1, min(len(entries[0]), int(ax.bbox.width / width)))
    margin = 0.45 if ax.get_xlabel() else 0.25  # inches for the numbers and the label of the axis
    below = ax.transAxes + ScaledTranslation(0.0, -margin, ax.figure.dpi_scale_trans)
    ax.legend(*entries, fontsize=size, ncols=columns, loc="upper center", bbox_to_anchor=(0.5, 0.0), bbox_transform=below)


def fit_units(ax: Axes) -> None:
    """Scale the numbers and labels of axes to a fitting unit prefix, such as µm; simplify the ticks of logarithmic axes."""
    for axis in (ax.xaxis, ax.yaxis):
        shared = ax.get_shared_x_axes() if axis is ax.xaxis else ax.get_shared_y_axes()
        if not axis.get_label_text() and len(shared.get_siblings(ax)) > 1:
            continue  # the label is on other axes that share this axis
        log = axis.get_scale() == "log"
        low, high = sorted(np.abs(axis.get_view_interval()))
        name, _, unit = axis.get_label_text().rpartition(" (")
        base, scale = axis.label.get_gid() or unit.removesuffix(")"), 1.0
        if name and base in FITTING:
            prefix = unit_prefix(float(np.sqrt(low * high)) if log else float(high), base)
            scale = PREFIXES[prefix]
            axis.label.set_gid(base)  # the unit of the data, for the next call
            axis.set_label_text(f"{name} ({prefix.strip()}{base})")
        if log:
            axis.set_major_locator(logarithmic(low, high))
            axis.set_minor_formatter(NullFormatter())
        if log or scale != 1.0:
            axis.set_major_formatter(FuncFormatter(lambda value, _, scale=scale: plain_number(value / scale)))


def logarithmic(low: float, high: float) -> Locator:
    """Return a locator of a few round ticks for a logarithmic axis with these limits."""
    if high <= 2.0 * low:
        return MaxNLocator(5)
    return LogLocator(subs=next(subs for ratio, subs in SUBS.items() if high <= ratio * low))


def ticks_within(low: float, high: float) -> list[float]:
    """Return the ticks of a logarithmic axis within its limits."""
    return [float(x) for x in logarithmic(low, high).tick_values(low, high) if low <= x <= high]


def plain_number(value: float) -> str:
    """Format a number with six digits, without powers of ten, and with a typographic minus sign."""
    return np.format_float_positional(float(f"{value:.6g}"), trim="-").replace("-", MINUS)


def save_figure(target: Axes | Figure | Sequence[Axes] | NDArray, path: Any, **options: Any) -> None:
    """Save a figure, or the figure of axes, to a file, and close it; ``options`` are passed to ``Figure.savefig``."""
    first = np.ravel(np.asarray(target, object))[0]
    figure = first if isinstance(first, Figure) else first.figure
    with file_errors(path), plt.rc_context(STYLE):
        figure.savefig(path, **options)
    plt.close(figure)


@register_plot(Plottable, "image")
def image_of(shown: Plottable, **options: Any) -> bytes:
    """Return the plot of an object as a file; a PNG for notebooks unless the options of ``savefig`` differ."""
    file = io.BytesIO()
    save_figure(draw(shown, "plot"), file, **{"format": "png", "dpi": 100, **options})
    return file.getvalue()


def colours(n: int) -> NDArray:
    """Return n colours (n, 4) of monotone lightness, all dark enough for white paper."""
    return plt.get_cmap("viridis")(np.linspace(0.0, 0.7, max(n, 1)))


def looks(n: int) -> list[dict[str, Any]]:
    """Return colour, line style and marker for each of n curves, distinct in grey print."""
    return [
        {"color": colour, "linestyle": STYLES[i % len(STYLES)], "marker": MARKERS[i % len(MARKERS)], "markersize": 3.5}
        for i, colour in enumerate(colours(n))
    ]


def runs(values: NDArray) -> list[tuple[int, int]]:
    """Return the (first, last) indices of all sequences of two or more equal values."""
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(values.astype(int))) + 1, [len(values)]])
    return [(int(a), int(b) - 1) for a, b in pairwise(cuts) if b > a]


def highest_on(grid: NDArray, x: NDArray, y: NDArray, branch: NDArray) -> tuple[NDArray, NDArray]:
    """Interpolate curves y (n, m) over x on a grid; return the values (n_grid, m) and how often the curve passes each grid
    point.

    If the curve passes a grid point more than once, the passage with the highest value is used.  Values are NaN at grid
    points that the curve does not pass.
    """
    best, count = np.full((len(grid), y.shape[1]), np.nan), np.zeros(len(grid), int)
    for i in np.flatnonzero((np.diff(branch) == 0) & (np.diff(x) != 0.0)):
        low, high = sorted(x[i : i + 2])
        inside = (grid >= low) & (grid <= high)
        share = (grid[inside, None] - x[i]) / (x[i + 1] - x[i])
        values = y[i] + share * (y[i + 1] - y[i])
        higher = ~(values.max(axis=1) <= best[inside].max(axis=1))  # also true for NaN
        best[inside] = np.where(higher[:, None], values, best[inside])
        count += inside & (grid < high)
    return best, count


def limit_line(ax: Axes, name: str, x: Sequence[float] | NDArray, y: Sequence[float] | NDArray, at: float) -> None:
    """Draw a limit as a thin line with its name above the known point nearest to ``at``."""
    look = LIMITS.get(name, LIMITS["stuck"])
    ax.plot(x, y, **look)
    distance = np.where(np.isfinite(y), np.abs(np.asarray(x) - at), np.inf)
    if np.isfinite(distance).any():
        k = int(np.argmin(distance))
        side = {0: "left", len(distance) - 1: "right"}.get(k, "center")  # within the axes
        ax.annotate(name, (x[k], y[k]), xytext=(0, 2), textcoords="offset points", ha=side, fontsize=7.0,
                    color=look["color"])  # fmt: skip


def once(ax: Axes, name: str) -> str | None:
    """Return the name as a legend label, or None if the legend already has it."""
    return None if name in ax.get_legend_handles_labels()[1] else name


def lost(ax: Axes, places: Sequence[float | str] | NDArray, colour: str | NDArray, name: str, size: float = 5.0) -> None:
    """Draw crosses at the lower edge of the axes, at points without a value."""
    if len(places):
        height, across = np.full(np.shape(places), 0.03), ax.get_xaxis_transform()
        ax.plot(places, height, "x", color=colour, markersize=size, transform=across, label=once(ax, name))
