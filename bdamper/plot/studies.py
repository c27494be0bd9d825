"""Plots of sweeps, uncertainty, effects, convergence, fits, nonlinear modes and flutter.

:func:`draw_table` plots one column of a result against another, with labels and units from their
annotated types (:mod:`bdamper.util.tables`).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FuncFormatter, NullLocator
from numpy.typing import ArrayLike, NDArray

from bdamper.analyses.accuracy import COMBINED, AccuracyCost, Run
from bdamper.analyses.effect_significance import EffectRow, EffectSignificance
from bdamper.analyses.excitation_curve import ExcitationCurve
from bdamper.analyses.fit_result import Fitted
from bdamper.analyses.flutter import Flutter
from bdamper.analyses.loop_fit import FittedLoop
from bdamper.analyses.nonlinear_mode import NonlinearMode
from bdamper.analyses.refinement import Refinement
from bdamper.analyses.robust_optimum import OptimalCurveUncertainty
from bdamper.analyses.sweep import SweepResult, as_words
from bdamper.plot.axes import (
    COLUMN,
    DASHED,
    MINUS,
    NEW,
    SMALL,
    broken,
    colours,
    drawing,
    legend_beside,
    looks,
    lost,
    name_point,
    note,
    once,
    picture,
    plain_number,
    runs,
    ticks_within,
    wrapped,
)
from bdamper.response.sensitivity import Sensitivities
from bdamper.response.verification import Convergence
from bdamper.util.display import register_plot
from bdamper.util.errors import SettingError
from bdamper.util.formatting import amount, peak_text, percent, spaced, unit_of
from bdamper.util.records import row_of
from bdamper.util.tables import FEW_ROWS, Tabular, axis_label, quantities

# ---- Design studies ----

HATCHES = ("", "//", "..", "xx", "\\\\")
MAIN = ("amplitude", "optimum_amplitude")
"""Quantities of a sweep that are plotted by default."""
OF_SHROUD = ("shroud_force", "static_slip", "first_slip", "locked_amplitude", "amplitude")
"""Quantities of a sweep over the load or speed of a shroud."""
_WORDS = {
    "amplitude": "resonance amplitude",
    "frequency": "resonance frequency",
    "stick": "share of stick",
    "slip": "share of slip",
    "open": "share of separation",
}


def _with_unit(name: str) -> str:
    """Return the axis label of a setting or a quantity of a sweep."""
    words = _WORDS.get(name, spaced(name))
    label = words[:1].upper() + words[1:]
    unit = unit_of(name)
    return f"{label} ({unit})" if unit else label


@register_plot(SweepResult)
def plot_sweep(
    result: SweepResult,
    quantity: str | None = None,
    ax: Axes | NDArray | None = NEW,
    *,
    title: str = "",
) -> Axes | NDArray:
    """Plot a quantity against the last setting of a sweep, or force, slip and peak of a shroud.

    Each combination of the other settings has its own line.  Crosses at the lower edge, in the
    colour of the line, mark points without a value.

    Parameters
    ----------
    result : SweepResult
    quantity : str, optional
        By default the amplitude, the amplitude of the optimum, or the first quantity of the sweep.
        For a sweep with the columns of a shroud (:class:`bdamper.PeakTask`) these are, in three
        axes below each other: normal force and slip at rest; first slip; highest peak and amplitude
        at first slip.
    ax : matplotlib axes, or three of them for a shroud, optional
    title : str

    Returns
    -------
    matplotlib axes, or an array of three
    """
    has_shroud = {*OF_SHROUD} <= {*result.quantities}
    wants_panels = quantity is None and (ax is None or np.size(np.asarray(ax, object)) == 3)
    if has_shroud and wants_panels:
        size = (COLUMN, 5.0)
        with drawing(ax, size=size, title=title, legend=SMALL, rows=3, shown=result) as axes:
            _draw_shroud(result, axes)
            return cast(NDArray, axes)
    with drawing(ax, title=title, legend=SMALL, shown=result) as one:
        _draw_quantity(result, quantity, one)
        return cast(Axes, one)


def _draw_quantity(result: SweepResult, quantity: str | None, ax: Axes) -> None:
    """Plot one quantity, the main one by default, against the last setting."""
    if not quantity:
        candidates = [name for name in (*MAIN, *result.quantities) if name in result.quantities]
        quantity = candidates[0] if candidates else MAIN[0]
    values = result.array(quantity)
    if values.ndim != len(result.shape) or values.dtype.kind != "f":
        found = f"'{quantity}' has the shape {values.shape}"
        raise SettingError(f"quantity must have one number for each point, {found}")
    setting = result.names[-1]
    across, names = _lines_of(result)
    for line, name, look in zip(values.reshape(len(names), -1), names, looks(len(names))):
        ax.plot(across, line, **look, label=name or None)
        lost(ax, across[~np.isfinite(line)], look["color"], "no value")
    _scale_across(ax, across)
    ax.set(xlabel=_with_unit(setting), ylabel=_with_unit(quantity))


def _lines_of(result: SweepResult) -> tuple[NDArray, list[str]]:
    """Return the values of the last setting, and the other settings of each line as text."""
    setting = result.names[-1]
    n_across = result.shape[-1]
    settings = result.points[setting][:n_across].tolist()
    is_numeric = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in settings)
    across = np.array(settings if is_numeric else [str(x) for x in settings])
    names = []
    for k in range(0, len(result), n_across):
        # the points of a line follow each other and share all settings but the last
        point = row_of(result.points, k)
        names.append(as_words({name: point[name] for name in result.names[:-1]}))
    return across, names


def _scale_across(ax: Axes, across: NDArray) -> None:
    """Make the axis of a setting logarithmic if its values span more than a decade."""
    if across.dtype.kind in "fi" and across.min() > 0.0 and across.max() > 20.0 * across.min():
        ax.set_xscale("log")


def _draw_shroud(result: SweepResult, axes: NDArray) -> None:
    """Plot the columns of a shroud: force and slip at rest, first slip, and amplitudes."""
    at_rest, first_slip, amplitudes = axes
    setting = result.names[-1]
    across, names = _lines_of(result)
    label = _with_unit(setting)
    is_gap = setting.startswith("gap.") and across.dtype.kind == "f"
    if is_gap and np.all(across <= 0.0):
        across = -across
        label = "Interference (m)"

    slip_axis = at_rest.twinx()
    slip_axis.grid(False)
    several = len(names) > 1
    columns = {name: result.array(name).reshape(len(names), -1) for name in OF_SHROUD}
    for k, (name, look) in enumerate(zip(names, looks(len(names)))):
        hollow = {**look, "linestyle": DASHED, "markerfacecolor": "w"}
        suffix = f", {name}" if several else ""
        at_rest.plot(across, columns["shroud_force"][k], **look)
        slip_axis.plot(across, columns["static_slip"][k], **hollow)
        first_slip.plot(across, columns["first_slip"][k], **look)
        peak = columns["amplitude"][k]
        amplitudes.plot(across, peak, **look, label=f"highest peak{suffix}")
        at_first_slip = columns["locked_amplitude"][k]
        amplitudes.plot(across, at_first_slip, **hollow, label=f"at first slip{suffix}")
        lost(amplitudes, across[~np.isfinite(peak)], look["color"], "no peak")
    first_slip.axhline(1.0, color="0.45", linewidth=1.0, label="excitation")
    for ax, quantities_drawn in (
        (first_slip, ("first_slip",)),
        (amplitudes, ("amplitude", "locked_amplitude")),
    ):
        drawn = np.concatenate([columns[name].ravel() for name in quantities_drawn])
        positive = drawn[np.isfinite(drawn)]
        if len(positive) and positive.min() > 0.0 and positive.max() > 10.0 * positive.min():
            ax.set_yscale("log")
    at_rest.set(ylabel="Force at rest (N)", ylim=(0.0, None))
    slip_axis.set(ylabel="Slip at rest, dashed (m)", ylim=(0.0, None))
    # an axis of zeros has no scale
    if not np.nan_to_num(columns["static_slip"]).any():
        slip_axis.remove()
    first_slip.set(ylabel="First slip over excitation")
    amplitudes.set(ylabel="Amplitude (m)", xlabel=label)
    _scale_across(amplitudes, across)


FEWEST_DRAWS = 20
"""Number of draws below which the percentiles 5 and 95 are the extremes, and have no band."""


@picture(OptimalCurveUncertainty)
def plot_optimal_curve_uncertainty(
    result: OptimalCurveUncertainty, ax: Axes = NEW, *, quantity: str = "amplitude"
) -> None:
    """Plot percentile bands of optimal curves against the preload; fewer than 20 draws as lines.

    Crosses at the lower edge mark preloads at which too many draws lack a peak.

    Parameters
    ----------
    result : OptimalCurveUncertainty
    quantity : {"amplitude", "frequency"}
    """
    if len(result) < FEWEST_DRAWS:
        for draw in getattr(result, quantity):
            known = np.where(np.isfinite(draw), draw, np.nan)
            ax.plot(result.preload, known, color="0.6", label=once(ax, "single draws"))
    values: dict[float, NDArray] = {}
    for percentile in (5.0, 25.0, 50.0, 75.0, 95.0):
        at_percentile = result.percentile(percentile, quantity)
        values[percentile] = np.where(np.isfinite(at_percentile), at_percentile, np.nan)
    bands = ((5.0, 95.0, "0.85"), (25.0, 75.0, "0.7")) if len(result) >= FEWEST_DRAWS else ()
    for low, high, shade in bands:
        ax.fill_between(
            result.preload,
            values[low],
            values[high],
            color=shade,
            linewidth=0.0,
            label=f"{low:g} to {high:g} %",
        )
    ax.plot(result.preload, values[50.0], color="0.1", label="median")
    lost(ax, result.preload[np.isnan(values[95.0])], "0.4", "95 %: no value")
    scale = "log" if quantity == "amplitude" else "linear"
    ax.set(xscale="log", yscale=scale, xlabel=_with_unit("preload"), ylabel=_with_unit(quantity))


@picture(EffectSignificance, size=(COLUMN, 3.2), legend=None)
def plot_effect_significance(advice: EffectSignificance, ax: Axes = NEW) -> None:
    """Plot the change of a peak without each effect as bars.

    Changes of amplitude and frequency are in per cent, on a scale that is linear within the
    tolerance and logarithmic beyond.  The tolerance is a grey band.  Names of effects that may be
    omitted together are grey.  An asterisk marks effects that are needed although the change without
    them alone is within the tolerance.  Thin lines show the uncertainty of estimates; an unknown change has
    no bar.
    """
    effects = advice.effects[::-1]  # from the bottom of the axes
    rows = np.arange(len(effects))
    tolerance = 100.0 * advice.tolerance
    handles: list[Any] = []
    for name, offset, colour in zip(("amplitude", "frequency"), (0.2, -0.2), colours(2)):
        handles.append(_draw_changes(ax, effects, name, rows + offset, colour))
    band = ax.axvspan(
        -tolerance, tolerance, color="0.9", zorder=0, label=f"tolerance, {tolerance:g} %"
    )
    handles.append(band)
    ax.set_xscale("symlog", linthresh=tolerance)
    ax.set_xticks(_ticks_of_changes(tolerance, *ax.get_xlim()), minor=False)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: plain_number(value)))
    # kept although the change without it alone is small
    with_others = [effect.significant and effect.size <= advice.tolerance for effect in effects]
    names = [f"{e.name}{' *' if small else ''}" for e, small in zip(effects, with_others)]
    ax.set_yticks(rows, names)
    for y, effect, text in zip(rows, effects, ax.get_yticklabels()):
        text.set_color("k" if effect.significant else "0.55")
        if effect.source == "unknown":
            ax.text(0.1 * tolerance, float(y), "unknown", va="center", fontsize=SMALL)
    ax.axvline(0.0, color="k", linewidth=0.6)
    # the colours of the names are explained by texts without a patch
    if any(effect.significant for effect in effects):
        handles.append(Patch(alpha=0.0, label="black names: needed"))
    if any(with_others):
        handles.append(Patch(alpha=0.0, label="*: small alone, needed\nbeside other effects"))
    if not all(effect.significant for effect in effects):
        handles.append(Patch(alpha=0.0, label="grey: may be left\nout together"))
    title = f"preload {amount(advice.preload, 'N')}, {amount(advice.frequency, 'Hz')}"
    ax.set(xlabel="Change of the peak without the effect (%)", title=title)
    legend_beside(ax, handles=handles)


def _ticks_of_changes(tolerance: float, low: float, high: float) -> list[float]:
    """Return the ticks of an axis of changes in per cent from ``low`` to ``high``.

    The axis is linear within the tolerance (per cent), and has powers of ten beyond it.
    """
    powers = [10.0, 100.0, 1000.0, 1e4]
    # numbers nearer to the tolerance would touch its tick
    powers = [number for number in powers if number > 4.0 * tolerance]
    negative = [-number for number in reversed(powers) if -number >= low]
    positive = [number for number in powers if number <= high]
    if len(negative) + len(positive) > MOST_POWERS:
        # every second one, from the largest
        negative = negative[::2]
        positive = positive[::-2][::-1]
    return [*negative, -tolerance, 0.0, tolerance, *positive]


MOST_POWERS = 4
"""Largest number of powers of ten with a tick."""


def _draw_changes(
    ax: Axes, effects: Sequence[EffectRow], name: str, places: NDArray, colour: NDArray
) -> Any:
    """Draw the changes of amplitude or frequency in per cent as bars, with their uncertainties."""
    changes = np.array([getattr(effect, f"{name}_change") for effect in effects], float)
    percent_change = 100.0 * np.nan_to_num(changes)
    uncertainty = np.array(
        [100.0 * e.uncertainty if e.source == "estimated" else 0.0 for e in effects]
    )
    bars = ax.barh(
        places,
        percent_change,
        0.38,
        facecolor=colour,
        edgecolor="k",
        linewidth=0.4,
        label=name,
    )
    ax.hlines(
        places,
        percent_change - uncertainty,
        percent_change + uncertainty,
        color="k",
        linewidth=0.6,
    )
    return bars


@picture(Sensitivities, size=(COLUMN, 3.0))
def plot_sensitivities(found: Sensitivities, ax: Axes = NEW) -> None:
    """Plot the change of a peak for a change of one per cent in each parameter as bars, sorted by
    size.

    Each bar is labelled with its signed value; a change that is NaN has no bar.
    """
    changes = {name: 100.0 * np.array(pair) for name, pair in found.changes().items()}

    def size(name: str) -> float:
        """Return the change of the amplitude; an unknown one comes last, at the bottom."""
        return float(np.nan_to_num(abs(changes[name][0]), nan=-1.0))

    names = sorted(changes, key=size)
    rows = np.arange(len(names))
    of_names = np.array([changes[name] for name in names]).reshape(-1, 2)
    quantities_drawn = zip(("amplitude", "frequency"), of_names.T, (0.2, -0.2), colours(2))
    for quantity, change, offset, colour in quantities_drawn:
        bars = ax.barh(
            rows + offset,
            np.nan_to_num(change),
            0.38,
            facecolor=colour,
            edgecolor="k",
            linewidth=0.4,
            label=quantity,
        )
        texts = [f"{x:+.2g}".replace("-", MINUS) if np.isfinite(x) else "unknown" for x in change]
        ax.bar_label(bars, texts, padding=2.0, fontsize=SMALL)
    ax.axvline(0.0, color="k", linewidth=0.6)
    ax.margins(x=0.25)
    ax.set_yticks(rows, [wrapped(spaced(name), 18) for name in names])
    title = peak_text(found.amplitude, found.frequency)
    ax.set(xlabel="Change of the peak (% for +1 %)", title=title)


@picture(Convergence)
def plot_convergence(convergence: Convergence, ax: Axes = NEW) -> None:
    """Plot the amplitude of a peak against the number of harmonics.

    The filled point is the result, the grey band the range of the settled peaks.  Ticks at the
    upper edge mark harmonics near a mode of the structure with stuck contacts.
    """
    peaks = convergence.peaks
    harmonics = np.array([float(peak.harmonics) for peak in peaks])
    amplitude = np.array([peak.amplitude for peak in peaks])
    low, high = convergence.range
    if low < high:
        label = f"{amount(low, 'm')} to {amount(high, 'm')}"
        ax.axhspan(low, high, color="0.9", zorder=0, label=label)
    ax.plot(
        harmonics,
        amplitude,
        "o-",
        color="0.2",
        markersize=5.0,
        markerfacecolor="w",
        label="more harmonics" if len(peaks) > 1 else None,
    )
    ax.plot(harmonics[0], amplitude[0], "o", color="k", markersize=6.0, label="result")
    near_mode = [
        mode.harmonic for mode in convergence.internal_resonances if mode.harmonic <= harmonics[-1]
    ]
    if near_mode:
        ax.plot(
            near_mode,
            [0.985] * len(near_mode),
            "|",
            color="k",
            transform=ax.get_xaxis_transform(),
            label="near a stuck mode",
        )
    ax.set(xlabel="Highest harmonic", ylabel="Resonance amplitude (m)", xticks=harmonics)
    if len(peaks) == 1:
        note(ax, convergence._headline(), 0.05)
    state = "converged" if convergence.ok else "not converged"
    tolerance = percent(convergence.tolerance)
    ax.set_title(f"preload {amount(convergence.preload, 'N')}, {state} to {tolerance}")
    ax.margins(y=0.25)


@picture(AccuracyCost, size=(COLUMN, 3.4))
def plot_accuracy(result: AccuracyCost, ax: Axes = NEW, *, of: str = "peak") -> None:
    """Plot the error against the processor time for different settings.

    The error of a run is its difference from the reference (the most detailed settings) plus the
    estimated error of the reference.  Runs that differ from the reference in one setting are
    labelled with its value.  An open square is a forecast: settings that were not computed and are
    expected to meet the tolerance.  Crosses at the upper edge are runs of unknown error, and
    triangles at the lower edge are runs with zero error.

    Parameters
    ----------
    result : AccuracyCost
    of : str
        Quantity whose error is plotted.
    """
    names = result.varied
    within = percent(result.tolerance)
    for run in result.runs:
        _draw_run(ax, result, run)
    if result.forecast is not None:
        settings = result.forecast.settings.replace(", ", "\n")
        ax.plot(
            result.forecast.seconds,
            100.0 * result.forecast.error,
            "sk",
            markerfacecolor="none",
            label=f"forecast:\n{settings}",
        )
    tolerance = 100.0 * result.tolerance
    ax.axhline(tolerance, label=f"tolerance, {within}", color="0.4", linewidth=0.9)
    ax.set(xscale="log", yscale="log", xlabel="Processor time (s)", ylabel=f"Error of the {of} (%)")
    varied = ", ".join(spaced(name) for name in names)
    verdict = f"within {within}: {_saving(result)}" if result.reached else f"{within} not reached"
    preload = amount(result.preload, "N")
    ax.set_title(f"{varied[:1].upper()}{varied[1:]}, preload {preload}\n{verdict}")
    ax.margins(x=0.12, y=0.12)  # for the names


LEAST_ERROR = 1e-12
"""Relative error below which a run has none in the plot."""


def _draw_run(ax: Axes, result: AccuracyCost, run: Run) -> None:
    """Draw one run of :func:`plot_accuracy`, with its name and its entry in the legend."""
    names = result.varied
    # whether one setting alone differs from the reference
    is_single = run.part in names
    look = _look_of_run(result, run)
    label = run.part
    if run is result.richest:
        label = "reference"
    elif is_single:
        reference = result.richest.values[names.index(run.part)]
        label = f"{spaced(run.part)} alone, reference {reference}"
    ax.plot([], [], linestyle="none", label=once(ax, label), **look)

    error = result.error(run)
    if error > LEAST_ERROR:
        transform = ax.transData
        height = 100.0 * error
    elif np.isfinite(error):
        # a triangle at the lower edge
        transform = ax.get_xaxis_transform()
        height = 0.03
        look["marker"] = "v"
    else:
        # a cross at the upper edge
        transform = ax.get_xaxis_transform()
        height = 0.95
        look["marker"] = "x"
    ax.plot(run.seconds, height, transform=transform, **look)
    if is_single:
        value = run.values[names.index(run.part)].removesuffix(" samples")
        # the title names a setting that is varied alone
        if len(names) > 1:
            unit = spaced(run.part)
            value = f"{value} {unit.removesuffix('s') if value == '1' else unit}"
        name_point(ax, wrapped(value, 12), (run.seconds, height), xycoords=transform)
    if run is result.recommended and result.reached:
        values = "\n".join(f"{spaced(name)} {value}" for name, value in zip(names, run.values))
        ax.plot(
            run.seconds,
            height,
            "ok",
            transform=transform,
            markerfacecolor="none",
            markersize=12.0,
            label=f"fastest within {percent(result.tolerance)}:\n{values}",
        )


def _look_of_run(result: AccuracyCost, run: Run) -> dict[str, Any]:
    """Return colour and marker of a run: reference, change of one setting, or of several."""
    if run is result.richest:
        return {"color": "k", "marker": "D"}
    if run.part not in result.varied or run.part == COMBINED:
        return {"color": "k", "marker": "*", "markersize": 9.0}
    look = looks(len(result.varied))[result.varied.index(run.part)]
    return {"color": look["color"], "marker": look["marker"]}


def _saving(result: AccuracyCost) -> str:
    """Describe how much faster the recommended settings are than the reference."""
    if result.recommended is result.richest:
        return "no run is faster"
    ratio = result.richest.seconds / (result.recommended.seconds or np.nan)
    return f"{plain_number(float(f'{ratio:.2g}'))} times faster than the reference"


@picture(Refinement, size=(COLUMN, 3.0))
def plot_refinement(result: Refinement, ax: Axes = NEW) -> None:
    """Plot the estimated error of a refinement against time.

    A label names the setting that is more detailed than before.  An open square shows the settings
    or the model that would reach the tolerance, at their estimated time.
    """
    seconds = np.cumsum([step.seconds for step in result.steps])
    error = 100.0 * np.array([step.error for step in result.steps])
    tolerance = percent(result.tolerance)
    ax.plot(seconds, error, "o-k", label="estimated error")
    for time, height, step in zip(seconds, error, result.steps):
        # the first step has the settings of the study
        if step.change:
            name_point(ax, step.change.partition(",")[0], (time, height))
    if np.isfinite(result.needed_seconds):
        ax.plot(
            seconds[-1] + result.needed_seconds,
            100.0 * result.tolerance,
            "sk",
            markerfacecolor="none",
            label=f"needed:\n{wrapped(result.needed, 24)}",
        )
    ax.axhline(
        100.0 * result.tolerance, label=f"tolerance, {tolerance}", color="0.4", linewidth=0.9
    )
    ax.set(xscale="log", yscale="log", xlabel="Time (s)", ylabel="Estimated error (%)")
    verdict = "reached" if result.reached else "not reached"
    ax.set_title(f"Preload {amount(result.preload, 'N')}\n{tolerance} {verdict}")
    # for the names
    ax.margins(x=0.2, y=0.15)


# ---- Columns of a result ----

LOGARITHMIC = ("N", "m", "J")
"""Units with a logarithmic axis, if values are positive and the ratio of the largest to the
smallest exceeds five.
"""


def draw_table(
    ax: Axes, table: Tabular, x: str, y: str, *, rows: Any = slice(None), **style: Any
) -> None:
    """Plot one field or property of a result against another.

    Existing axis labels are not changed.  Lines do not connect branches.  A value with a gap on
    either side is drawn as a point.  Ratios are in per cent.

    Parameters
    ----------
    ax : matplotlib axes
    table : Tabular
    x, y : str
    rows : index
        Rows to plot.
    style
        Line options of matplotlib's ``plot``.
    """
    x_values = _in_per_cent(x) * np.array(getattr(table, x), float)
    y_values = _in_per_cent(y) * np.array(getattr(table, y), float)
    branch = np.broadcast_to(getattr(table, "branch", 0), x_values.shape)[rows]
    across, up = broken(branch, x_values[rows], y_values[rows])
    look = {
        "color": "0.1",
        "marker": "o" if len(across) <= FEW_ROWS else "",
        "markersize": 3.5,
        **style,
    }
    ax.plot(across, up, **look)
    # a line needs two adjacent points; the padding is a gap at both ends
    is_known = np.pad(np.isfinite(across + up), 1)
    known_before = is_known[:-2]
    known_after = is_known[2:]
    is_single = is_known[1:-1] & ~known_before & ~known_after
    if is_single.any() and not look["marker"]:
        ax.plot(across[is_single], up[is_single], ".", color=look["color"])
    _set_label_and_scale(ax.xaxis, table, x, x_values)
    _set_label_and_scale(ax.yaxis, table, y, y_values)


def _in_per_cent(name: str) -> float:
    """Return the factor of a column in a plot: ratios are in per cent."""
    return 100.0 if name.endswith("ratio") else 1.0


def _set_label_and_scale(axis: Any, table: Tabular, name: str, values: NDArray) -> None:
    """Label an axis by a column, unless it has a label, and choose its scale."""
    kind: Any = type(table)
    if not axis.get_label_text():
        axis.set_label_text(axis_label(kind, name, "%" if name.endswith("ratio") else ""))
    mark = quantities(kind).get(name)
    least = np.nanmin(values, initial=np.inf)
    most = np.nanmax(values, initial=0.0)
    if mark is not None and mark.unit in LOGARITHMIC and most > 5.0 * least > 0.0:
        getattr(axis.axes, f"set_{axis.axis_name}scale")("log")


# ---- Fits ----


@picture(Fitted, size=(2.0 * COLUMN, 4.2), rows=2)
def plot_fit(result: Fitted, ax: NDArray = NEW) -> None:
    """Plot measured and computed amplitudes, and below them the residuals in units of the noise.

    If the model is correct, 95 % of the residuals lie in the grey band from -2 to 2.

    Parameters
    ----------
    result : Fitted
    """
    amplitudes, residuals = ax
    common, names = _without_common_part(result.tests)
    for t, (look, name) in enumerate(zip(looks(len(result.tests)), names)):
        rows = np.flatnonzero(result.test == t)
        rows = rows[np.argsort(result.place[rows])]
        frequency = result.place[rows]
        line = {**look, "marker": ""}
        points = {**look, "linestyle": "none", "markersize": 4.0, "markerfacecolor": "w"}
        amplitudes.plot(frequency, np.abs(result.model[rows]), **line)
        measured = np.abs(result.measured[rows])
        amplitudes.plot(frequency, measured, **points)
        residuals.plot(frequency, result.residual[rows, 0], **points)
        # one entry with the line of the model and the mark of the measurement
        both = {**line, "marker": look["marker"], "markersize": 4.0, "markerfacecolor": "w"}
        amplitudes.plot([], [], **both, label=name)
    what = "lines: model, marks: measured"
    amplitudes.plot([], [], linestyle="none", label=f"{common}: {what}" if common else what)
    label = "95 % of the residuals if the model is right"
    residuals.axhspan(-2.0, 2.0, color="0.9", zorder=0, label=label)
    amplitudes.set(yscale="log", ylabel="Response amplitude (m)")
    residuals.set(xlabel="Frequency (Hz)", ylabel="Residual / noise")


def _without_common_part(names: Sequence[str]) -> tuple[str, list[str]]:
    """Return the beginning that several names share, up to a comma, and the rest of each name."""
    beginnings = {name.rpartition(", ")[0] for name in names}
    common = beginnings.pop() if len(names) > 1 and len(beginnings) == 1 else ""
    return common, [name.removeprefix(f"{common}, ") if common else name for name in names]


@picture(Fitted, "information", size=(COLUMN, 2.0))
def plot_information(result: Fitted, ax: Axes = NEW) -> None:
    """Plot the contribution of each test to the information about each parameter.

    Parameters
    ----------
    result : Fitted
    """
    rows = np.arange(len(result.names))[::-1]
    shares = 100.0 * result.information.T
    left_ends = np.cumsum(shares, axis=0) - shares
    tests = zip(result.tests, shares, left_ends, colours(len(shares)), cycle(HATCHES))
    for name, share, left, colour, hatch in tests:
        ax.barh(
            rows,
            share,
            left=left,
            label=name,
            facecolor=colour,
            edgecolor="w",
            linewidth=0.5,
            hatch=hatch,
        )
    ax.set_yticks(rows, [spaced(name) for name in result.names])
    ax.set(xlabel="Share of the information about the parameter (%)", xlim=(0.0, 100.0))


@picture(FittedLoop)
def plot_loop(result: FittedLoop, ax: Axes = NEW) -> None:
    """Plot a measured loop of force against displacement with the fitted loop of the sliders.

    Parameters
    ----------
    result : FittedLoop
    """
    ax.plot(
        result.displacement,
        result.force,
        "o",
        color="0.3",
        markersize=3.0,
        markerfacecolor="none",
        label="measured",
    )
    ax.plot(result.displacement, result.model, color="k", label=f"{result.sliders} sliders")
    ax.set(xlabel="Displacement (m)", ylabel="Force (N)")


# ---- Nonlinear modes and limit cycles ----


@picture(NonlinearMode, size=(COLUMN, 3.4), rows=2)
def plot_nonlinear_mode(mode: NonlinearMode, ax: NDArray = NEW, **style: Any) -> None:
    """Plot frequency and damping ratio of a nonlinear mode against the response amplitude.

    Circles are folds of the amplitude.  Lines are dashed if the motion no longer resembles the mode.

    Parameters
    ----------
    mode : NonlinearMode
    style
        Line options of matplotlib's ``plot``.
    """
    differs = mode.correlation < 0.5
    for axes, name in zip(ax, ("frequency", "damping_ratio")):
        for first, last in runs(differs):
            line = {
                "color": "0.1",
                "marker": "",
                "linestyle": DASHED if differs[first] else "-",
                **style,
            }
            # joined to the next stretch
            stretch = slice(first, last + 2)
            draw_table(axes, mode, "amplitude", name, rows=stretch, **line)
        draw_table(
            axes,
            mode,
            "amplitude",
            name,
            rows=mode.folds,
            linestyle="",
            marker="o",
            color="k",
            markersize=3.0,
            markerfacecolor="w",
        )
    ax[0].set(xlabel="", title=f"mode {mode.mode}, preload {amount(mode.preload, 'N')}")


@picture(ExcitationCurve, size=(COLUMN, 3.4), rows=2)
def plot_excitation_curve(
    curve: ExcitationCurve,
    ax: NDArray = NEW,
    measured: tuple[ArrayLike, ArrayLike] | None = None,
    **style: Any,
) -> None:
    """Plot resonance amplitude and damping ratio against the amplitude of the excitation.

    Parameters
    ----------
    curve : ExcitationCurve
    measured : pair of (n,) float, optional
        Amplitudes of the excitation and measured amplitudes (m) there, drawn as points.
    style
        Line options of matplotlib's ``plot``.
    """
    line = {"color": "0.1", "marker": ".", "label": "computed", **style}
    draw_table(ax[0], curve, "excitation", "amplitude", **line)
    draw_table(ax[1], curve, "excitation", "damping_ratio", **line)
    if measured is not None:
        excitation, amplitude = (np.asarray(values, float) for values in measured)
        if excitation.shape != amplitude.shape or excitation.ndim != 1:
            found = f"{excitation.shape} and {amplitude.shape}"
            raise SettingError(f"measured: expected two lists of one length, found {found}")
        points = {"linestyle": "", "marker": "o", "markerfacecolor": "w", "color": "C3"}
        ax[0].plot(excitation, amplitude, label="measured", **points)
    for axes in ax:
        axes.set(xscale="log")
    ax[0].set(yscale="log", xlabel="", title=f"preload {amount(curve.preload, 'N')}")
    ax[1].set(xlabel=f"Excitation amplitude ({curve.unit})")


@picture(Flutter)
def plot_flutter(flutter: Flutter, ax: Axes = NEW) -> None:
    """Plot limit cycles against the preload, with filled markers if stable and open markers if
    unstable.

    A grey strip below the amplitudes shows the state at rest: a dot if it is stable, a cross if it
    is unstable.
    """
    diameters = np.unique(flutter.nodal_diameter)
    is_cycle = flutter.amplitude > 0.0
    stable = flutter.stable
    for diameter, look in zip(diameters, looks(len(diameters))):
        of_diameter = flutter.nodal_diameter == diameter
        for part, face, name in (
            (is_cycle & stable, look["color"], "stable"),
            (is_cycle & ~stable, "w", "unstable"),
        ):
            rows = of_diameter & part
            if rows.any():
                style = {
                    **look,
                    "linestyle": "",
                    "markerfacecolor": face,
                    "label": f"{name}, nodal diameter {diameter}",
                }
                draw_table(ax, flutter, "preload", "amplitude", rows=rows, **style)
        at_rest = of_diameter & ~is_cycle
        for part, marker, name in ((stable, ".", "stable at rest"), (~stable, "x", LOST)):
            places = flutter.preload[at_rest & part]
            if len(places):
                _mark_rest(ax, places, marker, look["color"], once(ax, name))
    preloads = np.unique(flutter.preload)
    has_several_preloads = len(preloads) > 1 and preloads[0] > 0.0
    ax.set(xscale="log" if has_several_preloads else "linear", xlabel="Preload (N)")
    if len(preloads) == 1:
        ax.set_xticks(preloads)
    if is_cycle.any():
        ax.set(yscale="log", ylabel="Amplitude of the limit cycle (m)")
        amplitudes = flutter.amplitude[is_cycle]
        low, high = 0.7 * amplitudes.min(), 1.3 * amplitudes.max()
        # the strip takes its share of the height
        ax.set_ylim(low * (low / high) ** (STRIP / (1.0 - STRIP)), high)
        # no amplitudes in the strip
        ax.set_yticks(ticks_within(low, high))
        ax.yaxis.set_minor_locator(NullLocator())
    else:
        # without a limit cycle there is no amplitude
        ax.set(yticks=[], ylabel="")
        note(ax, flutter._headline())
    strip = Rectangle((0.0, 0.0), 1.0, STRIP, color="0.92", zorder=0.0, transform=ax.transAxes)
    ax.add_artist(strip)
    side: dict[str, Any] = {"ha": "right", "va": "center", "fontsize": SMALL}
    ax.text(-0.015, 0.5 * STRIP, "at rest", transform=ax.transAxes, **side)


STRIP = 0.1
"""Share of the height of the axes for the state at rest."""
LOST = "unstable at rest"


def _mark_rest(ax: Axes, places: NDArray, marker: str, colour: NDArray, label: str | None) -> None:
    """Mark preloads in the strip of the state at rest."""
    ax.plot(
        places,
        np.full(len(places), 0.5 * STRIP),
        marker,
        color=colour,
        markersize=5.0,
        # data across, a share of the height upward
        transform=ax.get_xaxis_transform(),
        label=label,
    )
