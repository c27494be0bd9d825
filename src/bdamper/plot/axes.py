"""Axes, colours and files: what all pictures share.

The style stands in ``style.mplstyle``.  A line is solid where the response is stable, dashed where it is unstable, dotted
where it jumps; the limits without contact and with all contacts stuck are thin grey lines that bear their names; a red
star is the optimum, a green diamond with a bar the mean and range of an amplitude in time.  Colours
go from dark to light with rising preload, so that they stay apart in grey and for the colour-blind.  What is drawn is in
metres and newtons; the numbers on the axes are in the unit that fits (:func:`fit_units`).
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
"""The style of this room, for ``plt.rc_context``."""
OPTIMUM = "#c0392b"
"""Colour of the optimum and of what is least or highest among several."""
IN_TIME = "#1a7a3e"
"""Colour of amplitudes in time, which are diamonds with bars."""
STYLES = ("-", "-.", (0, (6, 1, 1, 1, 1, 1)), (0, (10, 2)), (0, (1, 0.6)), (0, (3, 1, 1, 1)))
"""Lines that are told apart in grey; dashes and dots alone have their meaning."""
DASHED = (0, (3, 1.5))
"""Line of what is unstable."""
SUBS = {12.0: (1.0, 1.5, 2.0, 3.0, 5.0, 7.0), 100.0: (1.0, 2.0, 5.0), 1e4: (1.0, 3.0), np.inf: (1.0,)}
"""Multiples of powers of ten that are ticks of a logarithmic axis, by the largest ratio of its ends."""
NEW: Any = None
"""The axes of a picture that is drawn into new ones."""
LIMITS: dict[str, dict[str, Any]] = {
    "free": {"color": "0.6", "linewidth": 1.0},
    "stuck": {"color": "0.45", "linewidth": 1.0},
}
"""Lines of the limits without contact and with all contacts stuck; that of the tuned wheel is like the latter."""


def new_axes(width: float = 5.6, height: float = 3.6, rows: int = 1, **options: Any) -> Any:
    """Empty axes in the style of this room (size in inches), or several below each other over the same quantity."""
    with plt.rc_context(STYLE):
        return plt.subplots(rows, 1, figsize=(width, height), sharex=True, **options)[1]


@contextmanager
def drawing(
    ax: Axes | Sequence[Axes] | NDArray | None = None, *, size: tuple[float, float] = (5.6, 3.6), title: str = "",
    legend: float | None = None, rows: int = 1,
) -> Iterator[Any]:  # fmt: skip
    """Axes to draw into in the style of this room, which get their title, units and legend in the end.

    Parameters
    ----------
    ax : matplotlib axes, or as many as there are rows, optional
        New ones of the given ``size`` in inches otherwise.
    title : str
    legend : float, optional
        Size of its letters; no legend otherwise.
    rows : int
        Axes below each other.
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
    """Decorator: a function that draws into axes ``ax`` draws a type of result, into new axes where none are given.

    The function takes ``title`` as well, and returns the axes.  Parameters of the decorator are those of
    :func:`bdamper.util.display.register_plot` and of :func:`drawing`.
    """

    def enter(function: Callable[..., None]) -> Callable[..., Any]:
        own = inspect.signature(function)

        @wraps(function)
        def drawn(*arguments: Any, title: str = "", **options: Any) -> Any:
            bound = own.bind(*arguments, **options)
            with drawing(bound.arguments.get("ax"), size=size, title=title, legend=legend, rows=rows) as axes:
                bound.arguments["ax"] = axes
                function(*bound.args, **bound.kwargs)
            return axes

        return drawn if shown is object else register_plot(shown, kind)(drawn)

    return enter


def legend_beside(ax: Axes, size: float = 7.0, handles: Sequence[Any] = ()) -> None:
    """A legend where no curve is: below the axes, in as many columns as fit.

    Parameters
    ----------
    ax : matplotlib axes
    size : float
        Of its letters.
    handles : sequence of matplotlib artists
        By default all that are labelled.
    """
    given = (handles, [h.get_label() for h in handles]) if handles else ax.get_legend_handles_labels()
    if not given[0]:
        return
    longest = max(len(line) for name in given[1] for line in str(name).split("\n"))
    wide = 0.55 * size * (longest + 8) * ax.figure.dpi / 72.0
    columns = max(1, min(len(given[0]), int(ax.bbox.width / wide)))
    room = 0.45 if ax.get_xlabel() else 0.25  # inches for the numbers and the label of the axis
    below = ax.transAxes + ScaledTranslation(0.0, -room, ax.figure.dpi_scale_trans)
    ax.legend(*given, fontsize=size, ncols=columns, loc="upper center", bbox_to_anchor=(0.5, 0.0), bbox_transform=below)


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
            prefix = unit_prefix(float(np.sqrt(low * high)) if log else float(high), base)
            scale = PREFIXES[prefix]
            axis.label.set_gid(base)  # the unit of what is drawn, for the next time
            axis.set_label_text(f"{name} ({prefix.strip()}{base})")
        if log:
            axis.set_major_locator(logarithmic(low, high))
            axis.set_minor_formatter(NullFormatter())
        if log or scale != 1.0:
            axis.set_major_formatter(FuncFormatter(lambda value, _, scale=scale: plain_number(value / scale)))


def logarithmic(low: float, high: float) -> Locator:
    """Few and round ticks of a logarithmic axis with these ends."""
    if high <= 2.0 * low:
        return MaxNLocator(5)
    return LogLocator(subs=next(subs for ratio, subs in SUBS.items() if high <= ratio * low))


def ticks_within(low: float, high: float) -> list[float]:
    """Ticks of a logarithmic axis, as numbers."""
    return [float(x) for x in logarithmic(low, high).tick_values(low, high) if low <= x <= high]


def plain_number(value: float) -> str:
    """A number of an axis with six digits, no power of ten and the sign of printed text."""
    return np.format_float_positional(float(f"{value:.6g}"), trim="-").replace("-", MINUS)


def save_figure(target: Axes | Figure | Sequence[Axes] | NDArray, path: Any, **options: Any) -> None:
    """Write a figure, or that of some axes, to a file, and close it; ``options`` as matplotlib's ``savefig`` takes them."""
    first = np.ravel(np.asarray(target, object))[0]
    figure = first if isinstance(first, Figure) else first.figure
    with file_errors(path), plt.rc_context(STYLE):
        figure.savefig(path, **options)
    plt.close(figure)


@register_plot(Plottable, "image")
def image_of(shown: Plottable, **options: Any) -> bytes:
    """The picture of an object as a file, a PNG for a notebook unless the options of ``savefig`` say otherwise."""
    file = io.BytesIO()
    save_figure(draw(shown, "plot"), file, **{"format": "png", "dpi": 100, **options})
    return file.getvalue()


def colours(n: int) -> NDArray:
    """(n, 4) colours of monotone lightness, the last still dark enough on white paper."""
    return plt.get_cmap("viridis")(np.linspace(0.0, 0.7, max(n, 1)))


def looks(n: int) -> list[dict[str, Any]]:
    """Colour, line and marker of each of n curves, told apart in grey."""
    return [
        {"color": colour, "linestyle": STYLES[i % len(STYLES)], "marker": MARKERS[i % len(MARKERS)], "markersize": 3.5}
        for i, colour in enumerate(colours(n))
    ]


def runs(values: NDArray) -> list[tuple[int, int]]:
    """Stretches (first, last) of equal value."""
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(values.astype(int))) + 1, [len(values)]])
    return [(int(a), int(b) - 1) for a, b in pairwise(cuts) if b > a]


def highest_on(grid: NDArray, x: NDArray, y: NDArray, branch: NDArray) -> tuple[NDArray, NDArray]:
    """Values (n_grid, m) of curves y (n, m) over x at a grid, NaN where there are none, and how often x leads over each.

    Of several points over one place of the grid the one with the highest value counts.
    """
    best, count = np.full((len(grid), y.shape[1]), np.nan), np.zeros(len(grid), int)
    for i in np.flatnonzero((np.diff(branch) == 0) & (np.diff(x) != 0.0)):
        low, high = sorted(x[i : i + 2])
        on = (grid >= low) & (grid <= high)
        share = (grid[on, None] - x[i]) / (x[i + 1] - x[i])
        values = y[i] + share * (y[i + 1] - y[i])
        higher = ~(values.max(axis=1) <= best[on].max(axis=1))  # also where nothing is known yet
        best[on] = np.where(higher[:, None], values, best[on])
        count += on & (grid < high)
    return best, count


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


def once(ax: Axes, name: str) -> str | None:
    """A name for the legend, unless it is there."""
    return None if name in ax.get_legend_handles_labels()[1] else name


def lost(ax: Axes, places: Sequence[float | str] | NDArray, colour: str | NDArray, name: str, size: float = 5.0) -> None:
    """Crosses at the lower edge, where there is no value."""
    if len(places):
        height, across = np.full(np.shape(places), 0.03), ax.get_xaxis_transform()
        ax.plot(places, height, "x", color=colour, markersize=size, transform=across, label=once(ax, name))
