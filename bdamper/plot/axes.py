"""Axes, colours, units and files shared by all plots.

The style is in ``style.mplstyle``.  Conventions of all plots:

* Response lines are solid.  Dashed parts are known to be unstable, and dotted parts are jumps.
* Thin grey lines with names are the limits without contact (free) and with all contacts stuck.
* A plot has the width of a column of a paper, and a frame without data contains a sentence that
  says why.
* A red star is the optimum.  A green diamond with a bar is the mean and range of an amplitude in
  time.
* Colours go from dark to light with increasing preload, distinct in grey print and for colour-blind
  readers.

Data are plotted in SI units; axis labels and numbers use the prefix that fits (:func:`fit_units`).
"""

from __future__ import annotations

import inspect
import io
import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any, cast

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.ticker import (
    AutoLocator,
    FixedLocator,
    FuncFormatter,
    Locator,
    LogLocator,
    MaxNLocator,
    NullFormatter,
)
from matplotlib.transforms import ScaledTranslation, blended_transform_factory
from numpy.typing import NDArray

from bdamper.util import validation
from bdamper.util.display import Plottable, Summarised, draw, register_plot
from bdamper.util.formatting import FITTING, PREFIXES, unit_prefix
from bdamper.util.storage import FilePath, file_errors

MARKERS = "osD^v<>pP*hX"
MINUS = "\N{MINUS SIGN}"
SHEET = Path(__file__).with_name("style.mplstyle")
STYLE: dict[Any, Any] = matplotlib.rc_params_from_file(SHEET, use_default_template=False)
"""Style of the plots, for ``plt.rc_context``."""
OPTIMUM = "#c0392b"
"""Colour of the optimum and of other extreme points."""
IN_TIME = "#1a7a3e"
"""Colour of amplitudes by time integration (diamonds with bars)."""
STYLES = ("-", "-.", (0, (6, 1, 1, 1, 1, 1)), (0, (10, 2)), (0, (1, 0.6)), (0, (3, 1, 1, 1)))
"""Line styles, distinct in grey print; plain dashed and dotted lines have other meanings."""
DASHED = (0, (3, 1.5))
"""Line style of unstable solutions."""
SUBS = {
    12.0: (1.0, 1.5, 2.0, 3.0, 5.0, 7.0),
    100.0: (1.0, 2.0, 5.0),
    1e4: (1.0, 3.0),
    np.inf: (1.0,),
}
"""Multiples of powers of ten at the ticks of a logarithmic axis, by the ratio of its ends."""
COLUMN, SMALL = 3.35, 6.5
"""Width of a plot (inches) and the font size of names within it (points)."""
NEW: Any = None
"""Default of ``ax``: the decorator :func:`picture` replaces it by new axes."""
LIMITS: dict[str, dict[str, Any]] = {
    "free": {"color": "0.6", "linewidth": 1.0},
    "stuck": {"color": "0.45", "linewidth": 1.0},
}
"""Line styles of the free and stuck limits; the line of the tuned disk has the style of "stuck"."""


def broken(branch: NDArray, *columns: NDArray) -> list[NDArray]:
    """Return columns of numbers with a NaN between branches, so that no line connects these."""
    starts = np.flatnonzero(np.diff(branch)) + 1
    return [np.insert(column, starts, np.nan, axis=0) for column in columns]


class Picture(Figure):
    """Figure that a notebook shows only once.

    The inline backend would show it again at the end of the cell.
    """

    def _ipython_display_(self) -> None:
        if "inline" in plt.get_backend():
            plt.close(self)  # shown now, and not again at the end of the cell
        raise NotImplementedError  # displayed like every other figure


def new_axes(
    width: float = COLUMN, height: float = 2.4, rows: int = 1, columns: int = 1, **options: Any
) -> Any:
    """Return empty axes, or an array of them, in a new figure of ``width`` by ``height`` inches.

    Axes in one column share the x axis.
    """
    options = {"sharex": columns == 1, **options}
    size = (width, height)
    with plt.rc_context(STYLE):
        _, axes = plt.subplots(rows, columns, figsize=size, FigureClass=Picture, **options)
    return axes


@contextmanager
def drawing(
    ax: Axes | Figure | Sequence[Axes] | NDArray | None = None,
    *,
    size: tuple[float, float] = (COLUMN, 2.4),
    title: str = "",
    legend: float | None = None,
    rows: int = 1,
    shown: Summarised | None = None,
) -> Iterator[Any]:
    """Provide axes for a plot; set their title, units, legend and names at the end.

    Parameters
    ----------
    ax : matplotlib axes, figure, or array of ``rows`` axes, optional
        New axes of the given ``size`` (inches) by default; the first axes of a figure.
    title : str
    legend : float, optional
        Font size of the legend, which is below the last axes; no legend by default.
    rows : int
        Number of axes below each other.
    shown : Summarised, optional
        Result whose headline fills a frame without data.
    """
    with plt.rc_context(STYLE):
        axes = _axes_of(ax, size, rows)
        figure: Any = axes[0].figure
        # another plot that draws into this figure at present finishes it
        is_outer = not getattr(figure, "unfinished", False)
        figure.unfinished = True
        try:
            yield axes if rows > 1 else axes[0]
        except BaseException:
            if ax is None:
                plt.close(figure)
            raise
        finally:
            figure.unfinished = not is_outer
        if title:
            axes[0].set_title(title)
        if legend is not None and is_outer:
            legend_beside(axes[-1], legend, *legend_entries(axes))
        if shown is not None:
            for one in axes:
                _note_if_empty(one, shown)
        if is_outer:
            finish(figure)


def _axes_of(
    ax: Axes | Figure | Sequence[Axes] | NDArray | None, size: tuple[float, float], rows: int
) -> NDArray:
    """Return the axes to draw into as an array (rows,): given, the first of a figure, or new."""
    chosen: Any = ax
    if ax is None:
        chosen = new_axes(*size, rows)
    elif isinstance(ax, Figure):
        chosen = ax.axes[:rows]
    axes = np.ravel(np.asarray(chosen, object))
    if len(axes) != rows or not all(isinstance(one, Axes) for one in axes):
        expected = f"{('one', 'two', 'three')[rows - 1]} axes"
        raise validation.invalid("ax", expected, [type(one).__name__ for one in axes])
    return axes


def _note_if_empty(ax: Axes, shown: Summarised) -> None:
    """Write the headline of a result into axes without data."""
    has_data = np.isfinite(ax.dataLim.get_points()).all()
    has_note = "note" in [text.get_gid() for text in ax.texts]
    if not has_data and not has_note:
        note(ax, shown._headline(), empty=True)


def finish(figure: Figure) -> None:
    """Fit the units of all axes, break long titles, and place legends and names."""
    for ax in figure.axes:
        fit_units(ax)
    _lay_out(figure)
    # line breaks move the axes, so that every title is broken before the next layout
    broken_in = [_break_texts(ax) for ax in figure.axes]
    broken_in.append(_break_title(figure))
    if any(broken_in):
        _lay_out(figure)
    for ax in figure.axes:
        _move_legend(ax)
    if any(text.get_gid() == "name" for ax in figure.axes for text in ax.texts):
        _lay_out(figure)
        for ax in figure.axes:
            place_names(ax)


def _lay_out(figure: Any) -> None:
    """Compute the places of axes and texts."""
    engine = figure.get_layout_engine()
    if engine is None:
        figure.draw_without_rendering()
    else:
        engine.execute(figure)


def _break_texts(ax: Axes) -> bool:
    """Break a title and labels that do not fit; return whether there is one."""
    width = ax.figure.bbox.width
    middle = 0.5 * (ax.bbox.x0 + ax.bbox.x1)
    # a centred text reaches equally far to both sides; a fiftieth of the figure stays free
    room = 2.0 * min(middle, width - middle) - 0.02 * width
    broken_in = [
        _break_text(ax.title, "width", room),
        _break_text(ax.xaxis.label, "width", room),
        _break_text(ax.yaxis.label, "height", ax.bbox.height),
    ]
    return any(broken_in)


def _break_title(figure: Any) -> bool:
    """Break the title of a figure if it does not fit; return whether this is so."""
    available = 0.98 * figure.bbox.width
    # the title is the only text of a figure
    broken_in = [_break_text(text, "width", available) for text in figure.texts]
    return any(broken_in)


def _break_text(text: Text, direction: str, available: float) -> bool:
    """Break a text into lines if it is longer than ``available`` (pixels); return whether this is so.

    The length of a line is the "width" of the text, or the "height" of an upright text.
    """
    content = text.get_text()
    length = getattr(text.get_window_extent(), direction) / available
    if length <= 1.0 or "\n" in content:
        return False
    n_words = len(content.split())
    for n_lines in range(int(np.ceil(length)), n_words + 1):
        text.set_text(_in_lines(content, n_lines))
        # letters differ in width, and a line may be longer than the mean
        if getattr(text.get_window_extent(), direction) <= available:
            break
    return True


def _in_lines(text: str, n_lines: int) -> str:
    """Break a text into at most ``n_lines`` lines of similar length."""
    # words rarely end at the mean length
    columns = max(len(text) // n_lines + 4, 10)
    while wrapped(text, columns).count("\n") >= n_lines:
        columns += 1
    return wrapped(text, columns)


def picture(
    shown: type = object,
    kind: str = "plot",
    *,
    size: tuple[float, float] = (COLUMN, 2.4),
    legend: float | None = SMALL,
    rows: int = 1,
) -> Callable[[Callable[..., None]], Callable[..., Any]]:
    """Return a decorator that registers a plot function for a type of result and provides its axes.

    The decorated function accepts ``ax`` (new axes if omitted) and ``title``, and returns the
    axes.  For the arguments see :func:`bdamper.util.display.register_plot` and :func:`drawing`.
    """

    def enter(function: Callable[..., None]) -> Callable[..., Any]:
        signature = inspect.signature(function)

        @wraps(function)
        def drawn(*arguments: Any, title: str = "", **options: Any) -> Any:
            bound = signature.bind(*arguments, **options)
            result = bound.args[0]
            subject = result if hasattr(result, "_headline") else None
            with drawing(
                bound.arguments.get("ax"),
                size=size,
                title=title,
                legend=legend,
                rows=rows,
                shown=subject,
            ) as axes:
                bound.arguments["ax"] = axes
                function(*bound.args, **bound.kwargs)
            return axes

        return drawn if shown is object else register_plot(shown, kind)(drawn)

    return enter


# ---- Texts within the axes ----


def legend_entries(axes: Sequence[Axes] | NDArray) -> tuple[list[Any], list[str]]:
    """Return the artists with a label in all axes, and their labels, each label once."""
    handle_of: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels()):
            handle_of.setdefault(label, handle)
    return list(handle_of.values()), list(handle_of)


def legend_beside(
    ax: Axes, size: float = SMALL, handles: Sequence[Any] = (), labels: Sequence[str] = ()
) -> None:
    """Add a legend below the axes, in as many columns as fit.

    Parameters
    ----------
    ax : matplotlib axes
    size : float
        Font size.
    handles, labels : sequence of matplotlib artists, sequence of str
        By default all artists with a label.
    """
    if not handles:
        handles, labels = legend_entries([ax])
    if not handles:
        return
    labels = labels or [str(h.get_label()) for h in handles]
    n_columns = legend_columns(ax.figure, size, labels)
    legend = ax.legend(
        handles, labels, fontsize=size, ncols=n_columns, loc="upper center", columnspacing=1.2
    )
    legend.set_gid("below")
    _move_legend(ax, 0.36)  # about the height of numbers and label


def legend_columns(figure: Any, size: float, labels: Sequence[str]) -> int:
    """Return the number of columns of a legend with this font size that fit into a figure."""
    longest = max(len(line) for label in labels for line in str(label).split("\n"))
    # a character is about 0.55 of the font size wide; a line and its distances, as eight characters
    column_width = 0.55 * size * (longest + 8) * figure.dpi / 72.0
    n_fitting = int(figure.bbox.width / column_width)
    return max(1, min(len(labels), n_fitting))


def _move_legend(ax: Axes, margin: float | None = None) -> None:
    """Move a legend from `legend_beside` below the axes.

    The default of the margin (inches) depends on the size of the numbers and the label.
    """
    legend = ax.get_legend()
    if legend is None or legend.get_gid() != "below":
        return
    if margin is None:
        margin = 0.02
        numbers_and_label = ax.xaxis.get_tightbbox()
        if numbers_and_label is not None:
            margin += max(0.0, ax.bbox.y0 - numbers_and_label.y0) / ax.figure.dpi
    below = ax.transAxes + ScaledTranslation(0.0, -margin, ax.figure.dpi_scale_trans)
    place = ax.get_subplotspec()
    if place is None or place.get_gridspec().ncols == 1:
        # in the middle of the figure
        below = blended_transform_factory(ax.figure.transFigure, below)
    legend.set_bbox_to_anchor((0.5, 0.0), below)


def note(ax: Axes, text: str, height: float = 0.5, *, empty: bool = False) -> None:
    """Write a sentence into a frame, for results that were not found.

    An empty frame has no numbers.
    """
    if empty:
        ax.set(yticks=[])
        shares_x = len(ax.get_shared_x_axes().get_siblings(ax)) > 1
        if not shares_x:
            ax.set(xticks=[])
    ax.text(
        0.5,
        height,
        wrapped(text, 44),
        transform=ax.transAxes,
        bbox={"facecolor": "w", "edgecolor": "0.6"},
        zorder=9.0,
        gid="note",
        fontsize=SMALL,
        ha="center",
        va="center" if height == 0.5 else "bottom",
    )


def wrapped(text: str, columns: int) -> str:
    """Break a text into lines, but not between a number and its unit."""
    no_break = "\xa0"
    joined = re.sub(r"(\d) (?=\S{1,3}\b)", rf"\1{no_break}", text)
    filled = textwrap.fill(joined, max(columns, 10), break_on_hyphens=False)
    return filled.replace(no_break, " ")


def name_point(ax: Axes, text: str, at: tuple[float, float], **style: Any) -> None:
    """Write a name next to a point.

    `place_names` moves it to a free place.  A point that is not known has no name.
    """
    if not np.isfinite(at).all():
        return
    look: dict[str, Any] = {"color": "0.25", **style}
    ax.annotate(
        text,
        at,
        xytext=(0, 3),
        textcoords="offset points",
        gid="name",
        fontsize=SMALL,
        ha="center",
        # a white edge keeps letters readable on lines
        path_effects=[withStroke(linewidth=1.5, foreground="w")],
        arrowprops={
            "arrowstyle": "-",
            "color": "0.6",
            "linewidth": 0.4,
            "shrinkA": 0.0,
            "shrinkB": 3.5,
        },
        **look,
    )


def place_names(ax: Axes) -> None:
    """Move the names of points within the axes, away from lines and from each other."""
    names = [text for text in ax.texts if text.get_gid() == "name"]
    if not names:
        return
    others = [text.get_window_extent() for text in ax.texts if text.get_gid() != "name"]
    drawn = np.concatenate([_on_screen(line) for line in ax.lines] or [np.empty((0, 3))])
    for text in names:
        cheapest = min(
            NAME_PLACES, key=lambda place: _cost_of_place(ax, text, place, others, drawn)
        )
        _move_name(text, cheapest)
        others.append(Text.get_window_extent(text))


NAME_PLACES = [
    (distance, right, up)
    for distance in (3, 8, 14, 22, 34, 50)
    for right, up in ((0, 1), (1, 1), (-1, 1), (1, 0), (-1, 0), (0, -1), (1, -1), (-1, -1))
]
"""Places of a name: distance from its point (points), and its side to the right and upward."""


def _move_name(text: Any, place: tuple[int, int, int]) -> None:
    # right and up are 1, 0 or -1; as an index -1 selects the last word of each tuple
    distance, right, up = place
    text.set(
        position=(distance * right, distance * up),
        ha=("center", "left", "right")[right],
        va=("center", "bottom", "top")[up],
    )


def _cost_of_place(
    ax: Axes, text: Any, place: tuple[int, int, int], others: Sequence[Any], drawn: NDArray
) -> float:
    """Move a name, and return the cost of the place.

    Overlaps, the excess beyond the axes, and the distance increase the cost.

    Parameters
    ----------
    ax : matplotlib axes
    text : matplotlib annotation
    place : tuple of int
        One of :data:`NAME_PLACES`.
    others : sequence of bounding boxes
        Texts that keep their places.
    drawn : (n, 3) float
        Points of lines and markers, with the radius of the marker (pixels).
    """
    _move_name(text, place)
    # the extent of the text alone, without the line to its point
    box = Text.get_window_extent(text).padded(1.0)
    points = drawn[:, :2]
    radius = drawn[:, 2:]
    inside = (points + radius >= box.min) & (points - radius <= box.max)
    beyond_low = np.subtract(ax.bbox.min, box.min)
    beyond_high = np.subtract(box.max, ax.bbox.max)
    outside = np.maximum([beyond_low, beyond_high], 0.0)
    n_overlaps = sum(box.overlaps(other) for other in others)
    # markers count more than lines
    weight = np.where(radius[:, 0] > 0.0, 40.0, 4.0)
    covered = weight[inside.all(axis=1)].sum()
    distance = place[0]
    return float(100.0 * n_overlaps + 10.0 * outside.sum() + covered + 0.5 * distance)


def _on_screen(line: Any) -> NDArray:
    """Return points (n, 3) of a line and its markers: place and radius of the marker in pixels."""
    x, y = line.get_data(orig=False)
    points = line.get_transform().transform(np.column_stack([np.ravel(x), np.ravel(y)]))
    points = points[np.isfinite(points).all(axis=1)]
    radius = 0.0
    if line.get_marker() not in ("", "None", None):
        radius = 0.5 * line.get_markersize() * line.figure.dpi / 72.0
    markers = np.column_stack([points, np.full(len(points), radius)])
    if len(points) < 2 or line.get_linestyle() == "None":
        return markers
    # points along the line, four pixels apart
    steps = np.hypot(*np.diff(points, axis=0).T)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    along = np.arange(0.0, length[-1], 4.0)
    x_along = np.interp(along, length, points[:, 0])
    y_along = np.interp(along, length, points[:, 1])
    return np.concatenate([markers, np.column_stack([x_along, y_along, 0.0 * along])])


# ---- Units and numbers ----


def fit_units(ax: Axes) -> None:
    """Scale the numbers and labels of axes to a fitting unit prefix, such as µm.

    Simplify the ticks of logarithmic axes.
    """
    for axis in (ax.xaxis, ax.yaxis):
        shared = ax.get_shared_x_axes() if axis is ax.xaxis else ax.get_shared_y_axes()
        # the label may be on other axes that share this axis
        if axis.get_label_text() or len(shared.get_siblings(ax)) == 1:
            _fit_unit(ax, axis)


def _fit_unit(ax: Axes, axis: Any) -> None:
    """Scale the numbers and the label of one axis, and simplify its ticks."""
    if axis.get_scale() == "log" and not min(axis.get_view_interval()) > 0.0:
        # nothing drawn has a logarithm
        getattr(ax, f"set_{axis.axis_name}scale")("linear")
    is_log = axis.get_scale() == "log"
    low, high = sorted(np.abs(axis.get_view_interval()))
    name, _, unit = axis.get_label_text().replace("\n", " ").rpartition(" (")
    # an earlier call has stored the unit of the data
    base = axis.label.get_gid() or unit.removesuffix(")")
    scale = 1.0
    if name and base in FITTING:
        size = float(np.sqrt(low * high)) if is_log else float(high)
        prefix = unit_prefix(size, base)
        scale = PREFIXES[prefix]
        axis.label.set_gid(base)
        axis.set_label_text(f"{name} ({prefix.strip()}{base})")
    if isinstance(axis.get_major_locator(), AutoLocator):
        # few ticks, so that long numbers do not touch
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    if is_log and not isinstance(axis.get_major_locator(), FixedLocator):
        axis.set_major_locator(logarithmic(low, high))
    if is_log:
        axis.set_minor_formatter(NullFormatter())
    if is_log or scale != 1.0:
        axis.set_major_formatter(FuncFormatter(lambda value, _: plain_number(value / scale)))


def logarithmic(low: float, high: float) -> Locator:
    """Return a locator of a few round ticks for a logarithmic axis with these limits."""
    if high <= 2.0 * low:
        return MaxNLocator(5)
    subs = next(subs for ratio, subs in SUBS.items() if high <= ratio * low)
    return LogLocator(subs=subs)


def ticks_within(low: float, high: float) -> list[float]:
    """Return the ticks of a logarithmic axis within its limits."""
    ticks = logarithmic(low, high).tick_values(low, high)
    return [float(tick) for tick in ticks if low <= tick <= high]


def plain_number(value: float) -> str:
    """Format a number with six digits, without powers of ten, and with a typographic minus sign."""
    return np.format_float_positional(float(f"{value:.6g}"), trim="-").replace("-", MINUS)


def save_figure(
    target: Axes | Figure | Sequence[Axes] | NDArray, path: FilePath | io.BytesIO, **options: Any
) -> None:
    """Save a figure, or the figure of axes, to a file, and close it.

    ``options`` are passed to ``Figure.savefig``.
    """
    first = np.ravel(np.asarray(target, object))[0]
    figure = first if isinstance(first, Figure) else first.figure
    with file_errors(path), plt.rc_context(STYLE):
        figure.savefig(path, **options)
    plt.close(figure)


@register_plot(Plottable, "figure")
def figure_of(
    shown: Plottable, kind: str, path: FilePath | None = None, *arguments: Any, **options: Any
) -> Figure:
    """Draw an object, and save the figure if there is a path, which also closes its window."""
    if path is not None:
        validation.instance("path", path, (str, PathLike), "the name of a file")
        ending = Path(path).suffix.removeprefix(".")
        validation.choice("file extension", ending, sorted(FigureCanvasBase.filetypes))
    axes = draw(shown, kind, *arguments, **options)
    first = np.ravel(np.asarray(axes, object))[0]
    if path is not None:
        save_figure(first, path)
    return cast(Figure, first.figure)


@register_plot(Plottable, "image")
def image_of(shown: Plottable, kind: str = "plot", *arguments: Any, **options: Any) -> bytes:
    """Return the plot of an object as a file, by default a PNG for notebooks.

    ``options`` are passed to ``Figure.savefig``.
    """
    file = io.BytesIO()
    axes = draw(shown, kind, *arguments)
    save_figure(axes, file, **{"format": "png", "dpi": 160, **options})
    return file.getvalue()


def colours(n: int) -> NDArray:
    """Return n colours (n, 4) of monotone lightness, all dark enough for white paper."""
    return plt.get_cmap("viridis")(np.linspace(0.0, 0.7, max(n, 1)))


def looks(n: int) -> list[dict[str, Any]]:
    """Return colour, line style and marker for each of n curves, distinct in grey print."""
    return [
        {
            "color": colour,
            "linestyle": STYLES[i % len(STYLES)],
            "marker": MARKERS[i % len(MARKERS)],
            "markersize": 3.5,
        }
        for i, colour in enumerate(colours(n))
    ]


def runs(values: NDArray) -> list[tuple[int, int]]:
    """Return the (first, last) indices of all sequences of two or more equal values."""
    changes = np.flatnonzero(np.diff(values.astype(int))) + 1
    starts = np.concatenate([[0], changes, [len(values)]])
    return [(int(start), int(end) - 1) for start, end in pairwise(starts) if end > start]


def highest_on(grid: NDArray, x: NDArray, y: NDArray, branch: NDArray) -> tuple[NDArray, NDArray]:
    """Interpolate curves y (n, m) over x on a grid.

    Return the values (n_grid, m), and how often the curve passes each grid point.

    If the curve passes a grid point more than once, the passage with the highest value is used.
    Values are NaN at grid points that the curve does not pass.
    """
    best = np.full((len(grid), y.shape[1]), np.nan)
    n_passages = np.zeros(len(grid), int)
    same_branch = np.diff(branch) == 0
    moves = np.diff(x) != 0.0
    for i in np.flatnonzero(same_branch & moves):
        low, high = sorted(x[i : i + 2])
        inside = (grid >= low) & (grid <= high)
        share = (grid[inside, None] - x[i]) / (x[i + 1] - x[i])
        values = y[i] + share * (y[i + 1] - y[i])
        # negated, so that a value replaces NaN
        higher = ~(values.max(axis=1) <= best[inside].max(axis=1))
        best[inside] = np.where(higher[:, None], values, best[inside])
        n_passages += inside & (grid < high)
    return best, n_passages


def limit_line(
    ax: Axes, name: str, x: Sequence[float] | NDArray, y: Sequence[float] | NDArray, at: float
) -> None:
    """Draw a limit as a thin line with its name above the known point nearest to ``at``."""
    look = LIMITS.get(name, LIMITS["stuck"])
    ax.plot(x, y, **look)
    distance = np.where(np.isfinite(y), np.abs(np.asarray(x) - at), np.inf)
    if np.isfinite(distance).any():
        nearest = int(np.argmin(distance))
        name_point(ax, name, (x[nearest], y[nearest]), color="0.4")


def once(ax: Axes, name: str) -> str | None:
    """Return the name as a legend label, or None if the legend already has it."""
    _, labels = ax.get_legend_handles_labels()
    return None if name in labels else name


def lost(
    ax: Axes,
    places: Sequence[float | str] | NDArray,
    colour: str | NDArray,
    name: str,
    size: float = 5.0,
) -> None:
    """Draw crosses at the lower edge of the axes, at points without a value."""
    if not len(places):
        return
    ax.plot(
        places,
        np.full(np.shape(places), 0.03),
        "x",
        color=colour,
        markersize=size,
        # data across, a share of the height upward
        transform=ax.get_xaxis_transform(),
        label=once(ax, name),
    )
