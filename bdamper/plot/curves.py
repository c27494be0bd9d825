"""Plots of response curves, optimal curves, response maps, measurements and time integrations.

:mod:`bdamper.plot.axes` describes the conventions of lines and colours.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from numpy.typing import NDArray

from bdamper.analyses.hysteresis import Hysteresis
from bdamper.analyses.sweep import Comparison
from bdamper.harmonic_balance.rotor_speed import RPM
from bdamper.importers.measurements import Measurement
from bdamper.plot.axes import (
    DASHED,
    IN_TIME,
    LIMITS,
    NEW,
    OPTIMUM,
    SMALL,
    broken,
    colours,
    drawing,
    highest_on,
    limit_line,
    looks,
    name_point,
    new_axes,
    note,
    once,
    picture,
    runs,
    wrapped,
)
from bdamper.plot.contact import OF_WHOLE
from bdamper.plot.speed_and_fatigue import SPEED
from bdamper.plot.studies import draw_table
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.optimum_checks import NEAR_BEST
from bdamper.response.peak_error import NEGLIGIBLE
from bdamper.response.response_curve_result import NO_STEADY, ResponseCurve, unstable_points
from bdamper.response.sensitivity import CurveSensitivity, band
from bdamper.response.verification import TimeResponse
from bdamper.time_domain.frequency_sweep import TimeSweep
from bdamper.util import validation
from bdamper.util.display import register_plot
from bdamper.util.formatting import amount, counted, percent, spaced, text_of
from bdamper.util.tables import axis_label as label_of
from bdamper.util.tables import is_strain

# ---- Response and optimal curves ----

ALIKE = 0.9
"""Ratio of the two limits above which one line represents both."""
MOST_IN_LEGEND = 5
"""Largest number of curves with a legend; more curves have a colour bar."""
SHOWN = ("amplitude", "shift")
"""Quantities of the plots of an optimal curve."""
FREQUENCY = label_of(Hysteresis, "frequency")
AMPLITUDE = label_of(Hysteresis, "amplitude")
PRELOAD = label_of(Hysteresis, "preload")
NO_GAP, NO_PEAK_GAP, INCOMPLETE_GAP, NOT_STEADY_GAP = range(4)
"""Reasons why a preload has no value."""


def amplitude_label(*results: ResponseCurve | OptimalCurve) -> str:
    """Return the axis label of the amplitude, with the response location that all results share."""
    locations = set()
    for result in results:
        response = result.settings.get("response")
        location = None if response is None else text_of(response["location"])
        locations.add((location, is_strain(result)))
    location, of_strain = locations.pop() if len(locations) == 1 else (None, False)
    if location is None:
        return AMPLITUDE
    if of_strain:
        return f"Strain amplitude at {location} (m/m)"
    return f"{location.replace('_', ' ').capitalize()} amplitude (m)"


def _draw_tracking(
    ax: Axes, curve: ResponseCurve, look: Mapping[str, Any], label: str | None
) -> None:
    """Draw a response curve or a run-up, and mark its highest point."""
    colour = look["color"]
    x = curve.frequency if curve.speed is None else curve.speed * RPM
    amplitude = curve.amplitude
    unstable = unstable_points(curve)
    if curve.blades is not None:
        of_blades = np.abs(curve.blades[..., 1])
        ax.plot(*broken(curve.branch, x, of_blades), color="0.75", linewidth=0.5)
    for branch in np.unique(curve.branch):
        rows = np.flatnonzero(curve.branch == branch)
        for first, last in runs(unstable[rows]):
            # connected to the next stretch
            stretch = rows[first : last + 2]
            is_unstable = unstable[stretch[0]]
            if is_unstable:
                # a pale line below, so that a stretch shorter than a dash remains visible
                ax.plot(x[stretch], amplitude[stretch], color=colour, alpha=0.3)
            style = {**look, "linestyle": DASHED if is_unstable else "-"}
            ax.plot(x[stretch], amplitude[stretch], **style)
    if len(curve):
        is_bound = bool(curve.may_be_higher) and not curve.without_steady
        # filled at a peak, open at the end of a computed part, and if no motion stays there
        is_open = is_bound or curve.without_steady or _only_highest(curve)
        ax.plot(
            x[curve.peak_index],
            curve.peak.amplitude,
            look["marker"] or "o",
            color=colour,
            markersize=5.0,
            markerfacecolor="w" if is_open else colour,
            label=once(ax, "lower bound") if is_bound else None,
        )
    ax.plot([], [], **{**look, "linestyle": "-"}, label=label)


def _only_highest(curve: ResponseCurve) -> bool:
    """Return whether the highest point ends a computed part, so that a higher one may exist."""
    if curve.peak_at_end:
        return True
    frequency = curve.peak.frequency
    # largest distance of a point at the edge of a part
    edge = 1e-6 * frequency
    return any(part.low - edge <= frequency <= part.high + edge for part in curve.missing_ranges)


@picture()
def plot_curves(
    curves: Sequence[ResponseCurve], ax: Axes = NEW, *, labels: Sequence[str] | None = None
) -> None:
    """Plot the amplitude of several curves against frequency, or of run-ups against speed.

    Parameters
    ----------
    curves : sequence of ResponseCurve
        Response curves, with free and stuck limits as thin grey lines; or run-ups alone.
    labels : sequence of str, optional
        One label for each response curve; the preload by default.
    """
    expected = "a sequence of ResponseCurve (plot_curve draws one)"
    validation.check_value(isinstance(curves, Iterable), "curves", expected, curves)
    curves = tuple(curves)
    for curve in curves:
        validation.instance("curves", curve, ResponseCurve)
    tracking = [curve for curve in curves if curve.kind not in LIMITS]
    if labels is not None and (isinstance(labels, str) or len(labels) != len(tracking)):
        expected = f"{len(tracking)} texts, one for each response curve"
        raise validation.invalid("labels", expected, labels)
    for curve in curves:
        if curve.kind in LIMITS and len(curve):
            limit_line(ax, curve.kind, curve.frequency, curve.amplitude, curve.peak.frequency)

    has_colour_bar = labels is None and len(tracking) > MOST_IN_LEGEND
    without_markers = has_colour_bar or len(tracking) == 1
    for i, (curve, look) in enumerate(zip(tracking, looks(len(tracking)))):
        if without_markers:
            look |= {"marker": "", "markevery": 0.1}
        else:
            # markers of different curves lie at different places
            look["markevery"] = (0.03 * i, 0.15)
        label = None
        if labels is not None:
            label = labels[i]
        elif not has_colour_bar:
            label = _default_label(curve)
        _draw_tracking(ax, curve, look, label)
        for part in curve.missing_ranges:
            ax.axvspan(
                part.low,
                part.high,
                color=look["color"],
                alpha=0.25,
                linewidth=0.6,
                label=once(ax, "not computed"),
            )

    _explain_marks(ax, tracking)
    over_frequency = all(curve.speed is None for curve in curves)
    ax.set(
        xlabel=FREQUENCY if over_frequency else SPEED,
        ylabel=amplitude_label(*curves),
        yscale="log",
    )
    if not any(len(curve) for curve in curves):
        note(ax, " ".join(curve._headline() for curve in curves))
    if has_colour_bar:
        preloads = [curve.preload for curve in tracking]
        scale = LogNorm(min(preloads), max(preloads))
        bar = plt.cm.ScalarMappable(scale, ListedColormap(colours(256)))
        ax.figure.colorbar(bar, ax=ax, label=PRELOAD)


def _default_label(curve: ResponseCurve) -> str:
    if curve.speed is None:
        return f"preload {amount(curve.preload, 'N')}"
    return f"engine order {curve.settings['engine_order']}"


def _explain_marks(ax: Axes, tracking: Sequence[ResponseCurve]) -> None:
    """Add dashed lines and open points to the legend if a curve has them."""
    kinds = set()
    for curve in tracking:
        for label in curve.labels[unstable_points(curve)]:
            kinds.add(label.partition(" with")[0] or "unstable")
    if kinds:
        ax.plot([], [], color="k", linestyle=DASHED, label=" or ".join(sorted(kinds)))
    if any(len(curve) and _only_highest(curve) for curve in tracking):
        ax.plot(
            [],
            [],
            "o",
            color="k",
            markersize=5.0,
            markerfacecolor="w",
            markeredgewidth=0.6,
            label="highest computed point",
        )


@register_plot(ResponseCurve)
def plot_curve(
    curve: ResponseCurve,
    ax: Axes | None = None,
    *,
    limits: Sequence[ResponseCurve] = (),
    **options: Any,
) -> Axes:
    """Plot the amplitude of a curve against frequency, or that of a run-up against speed.

    Parameters
    ----------
    curve : ResponseCurve
    ax : matplotlib axes, optional
    limits : sequence of ResponseCurve
        Curves to plot as thin grey lines: ``[study.free(interval), study.stuck(interval)]``.
    options
        Options of :func:`plot_curves`.
    """
    return cast(Axes, plot_curves([*limits, curve], ax, **options))


@picture()
def plot_band(
    curve: ResponseCurve,
    found: Mapping[str, CurveSensitivity],
    deviations: Mapping[str, float],
    ax: Axes = NEW,
) -> None:
    """Plot a response curve with a band of two standard deviations, from derivatives along it.

    Parameters
    ----------
    curve : ResponseCurve
    found : mapping of name to CurveSensitivity
        Result of :meth:`bdamper.Study.curve_sensitivities`.
    deviations : mapping of name to float
        Standard deviations of independent parameters.
    """
    _, frequency, amplitude = band(curve, found, deviations)
    names = "\n".join(spaced(name) for name in deviations)
    is_known = np.isfinite(frequency).all(axis=1)
    for branch in np.unique(curve.branch):
        rows = (curve.branch == branch) & is_known
        ax.fill(
            _around(frequency[rows]),
            _around(amplitude[rows]),
            color="0.8",
            linewidth=0.0,
            label=once(ax, f"two standard deviations of\n{names}"),
        )
    plot_curves([curve], ax)


def _around(ends: NDArray) -> NDArray:
    """Return the outline of a band (n, 2): along its first edge, and back along the second one."""
    return np.concatenate([ends[:, 0], ends[::-1, 1]])


@picture(Measurement)
def plot_measurement(
    measurement: Measurement, ax: Axes = NEW, scale: float | None = None, **style: Any
) -> None:
    """Plot a measured response in metres, usually on top of computed curves.

    Parameters
    ----------
    measurement : Measurement
    scale : float, optional
        Factor from the unit of the measurement to metres; by default from its unit.
    style
        Line options of matplotlib's ``plot``.

    Raises
    ------
    SettingError
        If the unit is not a unit of displacement, velocity or acceleration, and no scale is given.
    """
    if scale is None:
        amplitude = np.abs(measurement.displacement)
    else:
        amplitude = float(scale) * measurement.amplitude
    look = {
        "linestyle": "none",
        "marker": "o",
        "markersize": 3.0,
        "markerfacecolor": "none",
        "color": "0.3",
        "label": measurement.name,
        **style,
    }
    ax.plot(measurement.frequency, amplitude, **look)
    if not ax.get_ylabel():
        ax.set(xlabel=FREQUENCY, ylabel=AMPLITUDE)


@register_plot(OptimalCurve)
def plot_optimal(
    result: OptimalCurve, ax: Axes | None = None, *, quantity: str = "amplitude", title: str = ""
) -> Axes | NDArray:
    """Plot resonance amplitude and frequency shift against the preload (Figs 8 and 9 of the paper).

    Parameters
    ----------
    result : OptimalCurve
    ax : matplotlib axes, optional
        Axes for one quantity.  By default both quantities are plotted in new axes, one below the
        other.
    quantity : {"amplitude", "shift"}
    title : str

    Returns
    -------
    matplotlib axes, or an array of two

    Notes
    -----
    Dotted lines mark preloads between which the highest resonance changes.  A filled star marks a
    verified optimum, an open star the lowest value found.  In the shaded range of preloads, the
    harmonic-balance amplitude is at most 20 % above the optimum.  In hatched ranges no value was
    found; open triangles there mark lower bounds.  Thin bars show the errors by harmonics and residual
    modes.  The bar at the optimum shows the range of its
    peak with more harmonics.  Diamonds with bars show means and ranges from time integration; the
    filled diamond is the lowest of them.  Triangles to the left and to the right mark amplitudes
    that are clearly higher with lower and higher friction coefficients.
    """
    if ax is None:
        shown: tuple[str, ...] = SHOWN
        chosen = new_axes(height=3.5, rows=2, height_ratios=(1.8, 1.0))
    else:
        shown = (validation.choice("quantity", quantity, SHOWN),)
        chosen = ax
    with drawing(chosen, title=title, legend=SMALL, rows=len(shown)) as axes:
        for one, name in zip(np.ravel(axes), shown):
            _draw_optimal(one, result, name)
        np.ravel(axes)[-1].set_xlabel(PRELOAD)
    return cast(Axes | NDArray, axes)


def _draw_optimal(ax: Axes, result: OptimalCurve, quantity: str) -> None:
    """Plot amplitude or frequency shift against the preload in one axes."""
    preload, values, goes_on = with_optimum(result, quantity)
    ax.set(xscale="log", ylabel="Frequency shift (%)")
    branch = np.cumsum(~goes_on)
    for first, last in runs(branch):
        part = slice(first, last + 1)
        ax.plot(preload[part], values[part], ".-", color="0.1", markersize=4.0)
    # no dotted line leads to a preload without a value
    both_known = np.isfinite(values[:-1] + values[1:])
    for k in np.flatnonzero(~goes_on[1:] & both_known):
        ax.plot(
            preload[k : k + 2],
            values[k : k + 2],
            ":",
            color="0.1",
            linewidth=0.8,
            label=once(ax, "highest resonance changes"),
        )
    if quantity == "shift":
        if not np.isfinite(values).any():
            note(
                ax, "no frequency shift, because no peak or no free resonance is known", empty=True
            )
        return
    _draw_errors(ax, result)
    _draw_limits(ax, result)
    _mark_gaps(ax, result)
    _mark_checks(ax, result)
    _mark_optimum(ax, result)
    ax.set(yscale="log", ylabel=amplitude_label(result))


def _draw_errors(ax: Axes, result: OptimalCurve) -> None:
    """Draw the known errors of the amplitudes as bars upward and downward, unless negligible."""
    error = result.error
    # smaller ones are not visible; NaN is unknown
    known = error > NEGLIGIBLE
    if not known.any():
        return
    amplitude = result.amplitude[known]
    # a logarithmic axis has no zero
    lower = np.minimum(error[known], 0.99) * amplitude
    upper = error[known] * amplitude
    ax.errorbar(
        result.preload[known],
        amplitude,
        yerr=np.array([lower, upper]),
        fmt="none",
        ecolor="0.55",
        elinewidth=0.8,
        capsize=1.5,
        label="error by harmonics and residual modes",
    )


def _draw_limits(ax: Axes, result: OptimalCurve) -> None:
    """Draw the amplitudes of both limits, as one line if they are nearly equal."""
    levels = {"free": result.free.amplitude, "stuck": result.stuck.amplitude}
    if min(levels.values()) > ALIKE * max(levels.values()):
        levels = {"without contact, or stuck": max(levels.values())}
    for name, level in levels.items():
        # names at different ends of the range
        row = -2 if name == "free" else max(1, len(result) // 6)
        amplitude = np.full(len(result), level)
        limit_line(ax, name, result.preload, amplitude, result.preload[row])


def with_optimum(
    result: OptimalCurve, quantity: str = "amplitude"
) -> tuple[NDArray, NDArray, NDArray]:
    """Return preloads and values, and whether each continues the branch of the previous point.

    Files of version 0.10 and earlier do not have the optimum in their table; it is inserted.
    """
    optimum = result.optimum
    if quantity == "shift":
        values = result.shift_percent
        at_optimum = 100.0 * (optimum.frequency / result.free.frequency - 1.0)
    else:
        values = result.amplitude
        at_optimum = optimum.amplitude
    row = int(np.searchsorted(result.preload, optimum.preload))
    is_within = 0 < row < len(result)
    if not is_within or optimum.preload in result.preload:
        return result.preload, values, result.goes_on
    return (
        np.insert(result.preload, row, optimum.preload),
        np.insert(values, row, at_optimum),
        np.insert(result.goes_on, row, True),
    )


def _mark_checks(ax: Axes, result: OptimalCurve) -> None:
    """Mark results of time integration, of other friction coefficients and of more harmonics."""
    convergence = result.convergence
    has_more_harmonics = convergence is not None and len(convergence.peaks) > 1
    if result.time_response or has_more_harmonics:
        # tells the line from the marks
        ax.plot([], [], ".-", color="0.1", markersize=4.0, label="harmonic balance")
    for response in result.time_response:
        if np.isfinite(response.mean):
            mark_time_response(response, ax, response.preload)
    in_time = result.optimum_in_time
    if in_time:
        # over the star, with a white edge
        ax.plot(
            in_time.preload,
            in_time.mean,
            "D",
            color=IN_TIME,
            markeredgecolor="w",
            markeredgewidth=0.4,
            markersize=3.5,
            zorder=8.0,
            label="lowest by time integration",
        )
    for marker, peak in zip("<>", result.other_friction[1:]):
        nominal = result.other_friction[0]
        # others would lie on the star
        if NEAR_BEST * nominal.amplitude < peak.amplitude < np.inf:
            ax.plot(
                peak.preload,
                peak.amplitude,
                marker,
                color="0.35",
                markersize=4.5,
                label=f"{peak.factor:g} times the friction",
            )
    if convergence is not None and has_more_harmonics:
        low, high = convergence.range
        fewest = convergence.peaks[0].harmonics
        most = convergence.peaks[-1].harmonics
        # caps wider than the star
        ax.errorbar(
            convergence.preload,
            low,
            [[0.0], [high - low]],
            fmt="none",
            ecolor="0.35",
            elinewidth=1.0,
            capsize=7.0,
            label=f"range with {fewest} to {most} harmonics",
        )


def _mark_optimum(ax: Axes, result: OptimalCurve) -> None:
    """Mark the optimum with a star and a label, and shade the preloads that are nearly as good."""
    optimum = result.optimum
    if not np.isfinite(optimum.preload):
        note(ax, result._headline())
        return
    fill = OPTIMUM if optimum.ok else "w"
    ax.plot(
        optimum.preload,
        optimum.amplitude,
        "*",
        color=OPTIMUM,
        markersize=11.0,
        markerfacecolor=fill,
        zorder=7.0,
    )
    within = f"within {percent(NEAR_BEST - 1.0)} of the optimum (harmonic balance)"
    ax.axvspan(*result.near_best, color=OPTIMUM, alpha=0.1, linewidth=0.0, label=within)
    ax.margins(y=0.25)  # for the name
    text = "\n".join(wrapped(line, 38) for line in _lines_of_optimum(result))
    name_point(ax, text, (optimum.preload, optimum.amplitude), color=OPTIMUM)


def _lines_of_optimum(result: OptimalCurve) -> list[str]:
    """Return the name of the optimum with its numbers and failed checks."""
    optimum = result.optimum
    kinds_at_an_end = {
        "end": "lowest at the end of the range",
        "edge": "lowest at the limit of steady responses",
    }
    if optimum.kind in kinds_at_an_end:
        name = kinds_at_an_end[optimum.kind]
    elif not optimum.ok:
        name = "lowest value found"
    elif optimum.kind == "jump":
        name = "optimum at a jump"
    else:
        name = "optimum"
    if not optimum.ok:
        name += ", not verified"
    lines = [f"{name}: {amount(optimum.preload, 'N')}, {amount(optimum.amplitude, 'm')}"]
    in_time = result.optimum_in_time
    if in_time:
        highest = f"up to {amount(in_time.largest, 'm')}"
        # one preload is not written twice
        if in_time.preload != optimum.preload:
            highest = f"{amount(in_time.preload, 'N')}, {highest}"
        lines.append(f"time integration: {highest}")
    if result.failures:
        lines.append(f"not for design: {counted(len(result.failures), 'check')} failed")
    return lines


def _mark_gaps(ax: Axes, result: OptimalCurve) -> None:
    """Hatch preloads without a value, halfway to their neighbours, and mark lower bounds."""
    missing = ~np.isfinite(result.amplitude)
    if not missing.any():
        return
    # on the logarithmic axis, the midpoints between preloads and the ends of the range
    x = np.log(result.preload)
    edges = np.exp(np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]]))
    not_steady = missing & (result.preload <= result.lowest_steady_preload)
    no_peak = missing & np.isnan(result.lower_bound)
    gap = np.where(missing, INCOMPLETE_GAP, NO_GAP)
    gap[no_peak] = NO_PEAK_GAP
    gap[not_steady] = NOT_STEADY_GAP
    hatches = {NO_PEAK_GAP: "////", INCOMPLETE_GAP: "....", NOT_STEADY_GAP: "xxxx"}
    reasons = {
        NO_PEAK_GAP: "no value: no peak found",
        INCOMPLETE_GAP: "no value: curve incomplete",
        NOT_STEADY_GAP: f"{NO_STEADY} up to {amount(result.lowest_steady_preload, 'N')}",
    }
    for first, last in runs(gap):
        if not missing[first]:
            continue
        kind = int(gap[first])
        ax.axvspan(
            edges[first],
            edges[last + 1],
            hatch=hatches[kind],
            label=once(ax, reasons[kind]),
            facecolor="none",
            edgecolor="0.75",
            linewidth=0.0,
            zorder=0,
        )
    if np.isfinite(result.lower_bound).any():
        ax.plot(
            result.preload,
            result.lower_bound,
            "^",
            label="lower bound",
            color="0.4",
            markersize=4.0,
            markerfacecolor="w",
        )


@picture(TimeResponse, "mark")
def mark_time_response(time_response: TimeResponse, ax: Axes, x: float | None = None) -> None:
    """Mark mean and range from time integration with a bar, by default at their frequency."""
    mean = time_response.mean
    below = mean - time_response.lowest
    above = time_response.largest - mean
    ax.errorbar(
        time_response.frequency if x is None else x,
        mean,
        [[below], [above]],
        fmt="D",
        color=IN_TIME,
        markerfacecolor="w",
        markersize=4.5,
        capsize=3.0,
        linewidth=1.2,
        zorder=5.0,
        label=once(ax, "time integration, highest blade: mean, range"),
    )


@picture(TimeSweep)
def plot_frequency_sweep(
    sweep: TimeSweep, ax: Axes = NEW, *, label: str = "", **style: Any
) -> None:
    """Plot the amplitude of a frequency sweep by time integration against frequency.

    The axes may already contain response curves.  ``style`` are line options.
    """
    if not ax.has_data():
        ax.set_title(f"{abs(sweep.rate):.3g} Hz/s, preload {amount(sweep.preload, 'N')}")
    direction = "up" if sweep.up else "down"
    line = {
        "color": IN_TIME,
        "linewidth": 0.7,
        "marker": "^" if sweep.up else "v",
        "markevery": 0.12,
        "markersize": 3.0,
        "markerfacecolor": "w",
        **style,
    }
    label = label or f"sweep {direction} in time"
    draw_table(ax, sweep, "frequency", "amplitude", label=label, **line)


# ---- Response map ----


@picture(OptimalCurve, "map")
def plot_response_map(result: OptimalCurve, ax: Axes = NEW) -> None:
    """Plot a map of the highest response as a function of frequency and preload, with the optimal
    curve.

    Hatched regions have several solutions: the response curve passes a frequency more than once.

    Parameters
    ----------
    result : OptimalCurve
        Optimal curve with its response curves.
    """
    curves = [curve for curve in result.curves if len(curve)]
    expected = "an optimal curve with two or more curves"
    validation.check(len(curves) >= 2, "result", expected, len(curves))
    low, high = result.settings["frequency"]
    n_columns = 400  # so that a column of the map is narrower than a pixel of a printed page
    frequency = np.linspace(low, high, n_columns)
    amplitude = np.empty((len(curves), n_columns))
    n_passages = np.empty((len(curves), n_columns), int)
    for row, curve in enumerate(curves):
        column = curve.amplitude[:, None]
        highest, n_passages[row] = highest_on(frequency, curve.frequency, column, curve.branch)
        amplitude[row] = highest[:, 0]
    preload = np.array([curve.preload for curve in curves])
    image = ax.pcolormesh(
        frequency, preload, amplitude, shading="nearest", norm="log", rasterized=True
    )
    ax.figure.colorbar(image, ax=ax, label="Amplitude (m)")
    has_several = n_passages > 1
    if has_several.any():
        ax.contourf(
            frequency,
            preload,
            has_several.astype(float),
            levels=[0.5, 1.5],
            colors="none",
            hatches=["////"],
        )
        ax.fill([], [], facecolor="none", edgecolor="0.3", hatch="////", label="several solutions")
    # a white line on a wider black one is visible on every colour
    ax.plot(result.frequency, result.preload, color="k", linewidth=2.4)
    ax.plot(result.frequency, result.preload, color="w", linewidth=1.0)
    ax.plot([], [], color="k", label="highest")
    if np.isfinite(result.optimum.preload):
        ax.plot(
            result.optimum.frequency,
            result.optimum.preload,
            marker="*",
            label="optimum",
            color=OPTIMUM,
            markeredgecolor="w",
            markersize=11.0,
            linestyle="none",
        )
    ax.set(yscale="log", xlabel=FREQUENCY, ylabel=PRELOAD)


# ---- Several results on the same axes ----

OF = {
    ResponseCurve: ("frequency", ("amplitude",)),
    OptimalCurve: ("preload", ("amplitude", "shift")),
    Hysteresis: ("amplitude", ("damping_ratio", "stiffness")),
}
"""By type of result: the column of the x axis, and the quantities that can be plotted."""


@picture()
def plot_together(
    results: Mapping[str, Any],
    quantity: str | None = None,
    ax: Axes = NEW,
    *,
    measured: Sequence[Measurement] = (),
) -> None:
    """Plot several results of one type on the same axes.

    Stars mark optima, filled if verified by complete response curves.  Lines are interrupted at
    points without a value.

    Parameters
    ----------
    results : mapping of name to result
        Response curves against frequency, optimal curves against preload, dissipation against
        amplitude, or loops of all contacts against the response.
    quantity : str, optional
        "amplitude" or "shift" (of frequency) of optimal curves, "damping_ratio" or "stiffness" of
        dissipation.
    measured : sequence of Measurement
        Measurements to plot on top of response curves.
    """
    expected = "a mapping of one or more names to results"
    validation.check_value(isinstance(results, Mapping) and results, "results", expected, results)
    kind = _common_kind(results)
    x, quantities = OF[kind]
    quantity = validation.choice("quantity", quantity or quantities[0], quantities)
    if isinstance(measured, Measurement) or (measured and kind is not ResponseCurve):
        expected = "a sequence of Measurement, over response curves"
        raise validation.invalid("measured", expected, measured)
    if kind is ResponseCurve:
        labels = [name for name, curve in results.items() if curve.kind not in LIMITS]
        plot_curves(list(results.values()), ax, labels=labels)
        for measurement in measured:
            plot_measurement(measurement, ax)
        return

    for (name, result), look in zip(results.items(), looks(len(results))):
        if kind is Hysteresis and result.single:
            ax.plot(*result.loop(), **{**look, "marker": ""}, label=name)
            ax.set(**OF_WHOLE)
            continue
        y = "shift_percent" if quantity == "shift" else quantity
        # about eight markers, at known points
        known = np.flatnonzero(np.isfinite(getattr(result, y)))
        markers = known[:: max(1, len(known) // 8)].tolist()
        draw_table(ax, result, x, y, **look, markevery=markers, label=name)
        ax.set_xscale("log")
        if kind is OptimalCurve and quantity == "amplitude":
            ax.set_yscale("log")
            _star_of_optimum(ax, result, look["color"])


def _common_kind(results: Mapping[str, Any]) -> type:
    """Return the type of all results, out of :data:`OF`."""
    for kind in OF:
        if all(isinstance(result, kind) for result in results.values()):
            return kind
    expected = "response curves, optimal curves or hysteresis, all of one kind"
    found = [type(result).__name__ for result in results.values()]
    raise validation.invalid("results", expected, found)


def _star_of_optimum(ax: Axes, result: OptimalCurve, colour: Any) -> None:
    """Mark an optimum, filled if it is verified."""
    optimum = result.optimum
    if not np.isfinite(optimum.preload):
        return
    ax.plot(
        optimum.preload,
        optimum.amplitude,
        "*",
        color=colour,
        markersize=8.0,
        markerfacecolor=colour if optimum.ok else "w",
        label=once(ax, "optimum" if optimum.ok else "lowest value, not verified"),
    )


@register_plot(Comparison)
def plot_comparison(comparison: Comparison, *arguments: Any, **options: Any) -> Axes:
    """Plot all results of a comparison on the same axes (:func:`plot_together`)."""
    return cast(Axes, plot_together(comparison.results, *arguments, **options))
