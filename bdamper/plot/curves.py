"""Plots of response curves, optimal curves, response maps, measurements and amplitudes in time.

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
from bdamper.response.headline import NEAR_BEST
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.response_curve_result import NO_STEADY, ResponseCurve, unstable_points
from bdamper.response.sensitivity import CurveSensitivity, band
from bdamper.response.verification import TimeResponse
from bdamper.time_domain.frequency_sweep import TimeSweep
from bdamper.util import validation
from bdamper.util.display import register_plot
from bdamper.util.formatting import amount, counted, percent, spaced
from bdamper.util.tables import axis_label as label_of

# ---- Response and optimal curves ----

ALIKE = 0.9
"""Ratio of the two limits above which one line represents both."""
SHOWN = ("amplitude", "shift")
"""Quantities of the plots of an optimal curve."""
FREQUENCY, AMPLITUDE, PRELOAD = (
    label_of(Hysteresis, name) for name in ("frequency", "amplitude", "preload")
)


def amplitude_label(*results: ResponseCurve | OptimalCurve) -> str:
    """Return the axis label of the amplitude, with the response location that all results share."""
    locations = {
        r.settings["response"]["location"] if "response" in r.settings else None for r in results
    }
    location = locations.pop() if len(locations) == 1 else None
    return (
        AMPLITUDE
        if location is None
        else f"{location.replace('_', ' ').capitalize()} amplitude (m)"
    )


def _draw_tracking(
    ax: Axes, curve: ResponseCurve, look: Mapping[str, Any], label: str | None
) -> None:
    colour = look["color"]
    f, a = curve.frequency if curve.speed is None else curve.speed * RPM, curve.amplitude
    unstable = unstable_points(curve)
    if curve.blades is not None:
        ax.plot(*broken(curve.branch, f, np.abs(curve.blades[..., 1])), color="0.75", linewidth=0.5)
    for b in np.unique(curve.branch):
        where = np.flatnonzero(curve.branch == b)
        for first, last in runs(unstable[where]):
            part = where[first : last + 2]  # connected to the next stretch
            if unstable[
                part[0]
            ]:  # a pale line below, so that a stretch shorter than a dash remains visible
                ax.plot(f[part], a[part], color=colour, alpha=0.3)
            ax.plot(f[part], a[part], **{**look, "linestyle": DASHED if unstable[part[0]] else "-"})
    if len(curve):  # filled at a peak, open at the end of a computed part
        bound = bool(curve.may_be_higher)
        face = "w" if bound or _only_highest(curve) else colour
        mark, name = look["marker"] or "o", once(ax, "lower bound") if bound else None
        ax.plot(
            f[curve.peak_index],
            curve.peak.amplitude,
            mark,
            color=colour,
            markersize=5.0,
            markerfacecolor=face,
            label=name,
        )
    ax.plot([], [], **{**look, "linestyle": "-"}, label=label)


def _only_highest(curve: ResponseCurve) -> bool:
    """Return whether the highest point ends a computed part, so that a higher one may exist."""
    f = curve.peak.frequency
    edge = 1e-6 * f  # largest distance of a point at the edge of a part
    return curve.peak_at_end or any(
        part.low - edge <= f <= part.high + edge for part in curve.missing_ranges
    )


@picture()
def plot_curves(
    curves: Sequence[ResponseCurve], ax: Axes = NEW, *, labels: Sequence[str] | None = None
) -> None:
    """Plot the amplitude of several curves over frequency, or of run-ups over speed.

    Parameters
    ----------
    curves : sequence of ResponseCurve
        Response curves, with free and stuck limits as thin grey lines; or run-ups alone.
    labels : sequence of str, optional
        One label for each response curve; the preload by default.
    """
    validation.check_value(
        isinstance(curves, Iterable),
        "curves",
        "a sequence of ResponseCurve (plot_curve draws one)",
        curves,
    )
    curves = tuple(curves)
    tracking = [
        c for c in curves if validation.instance("curves", c, ResponseCurve).kind not in LIMITS
    ]
    if labels is not None and (isinstance(labels, str) or len(labels) != len(tracking)):
        raise validation.invalid(
            "labels", f"{len(tracking)} texts, one for each response curve", labels
        )
    for curve in curves:
        if curve.kind in LIMITS and len(curve):
            limit_line(ax, curve.kind, curve.frequency, curve.amplitude, curve.peak.frequency)
    most_in_legend = 5  # more curves have a colour bar
    many = labels is None and len(tracking) > most_in_legend
    plain = many or len(tracking) == 1
    for i, (curve, look) in enumerate(zip(tracking, looks(len(tracking)))):
        look |= {"marker": "", "markevery": 0.1} if plain else {"markevery": (0.03 * i, 0.15)}
        preload = f"preload {amount(curve.preload, 'N')}"
        default = (
            preload if curve.speed is None else f"engine order {curve.settings['engine_order']}"
        )
        _draw_tracking(ax, curve, look, None if many else default if labels is None else labels[i])
        for part in curve.missing_ranges:
            ax.axvspan(
                part.low,
                part.high,
                color=look["color"],
                alpha=0.25,
                linewidth=0.6,
                label=once(ax, "not computed"),
            )
    labels_of = (label for c in tracking for label in c.labels[unstable_points(c)])
    dashed = {label.partition(" with")[0] or "unstable" for label in labels_of}
    if dashed:
        ax.plot([], [], color="k", linestyle=DASHED, label=" or ".join(sorted(dashed)))
    if any(len(c) and _only_highest(c) for c in tracking):
        ax.plot([], [], "o", color="k", markersize=5.0, markerfacecolor="w", markeredgewidth=0.6,
                label="highest computed point")  # fmt: skip
    over = FREQUENCY if all(curve.speed is None for curve in curves) else SPEED
    ax.set(xlabel=over, ylabel=amplitude_label(*curves), yscale="log")
    if not any(map(len, curves)):
        note(ax, " ".join(curve._headline() for curve in curves))
    if many:
        preloads = [curve.preload for curve in tracking]
        bar = plt.cm.ScalarMappable(
            LogNorm(min(preloads), max(preloads)), ListedColormap(colours(256))
        )
        ax.figure.colorbar(bar, ax=ax, label=PRELOAD)


@register_plot(ResponseCurve)
def plot_curve(
    curve: ResponseCurve,
    ax: Axes | None = None,
    *,
    limits: Sequence[ResponseCurve] = (),
    **options: Any,
) -> Axes:
    """Plot the amplitude over frequency of a curve, or over speed of a run-up.

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
    for b in np.unique(curve.branch):
        known = (curve.branch == b) & np.isfinite(frequency).all(axis=1)
        f, a = frequency[known], amplitude[known]
        edge = [np.concatenate([x[:, 0], x[::-1, 1]]) for x in (f, a)]
        ax.fill(
            *edge,
            color="0.8",
            linewidth=0.0,
            label=once(ax, f"two standard deviations of\n{names}"),
        )
    plot_curves([curve], ax)


@picture(Measurement)
def plot_measurement(
    measurement: Measurement, ax: Axes = NEW, scale: float | None = None, **style: Any
) -> None:
    """Plot a measured response in metres, usually over computed curves.

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
    size = (
        np.abs(measurement.displacement) if scale is None else float(scale) * measurement.amplitude
    )
    look = {
        "linestyle": "none",
        "marker": "o",
        "markersize": 3.0,
        "markerfacecolor": "none",
        "color": "0.3",
    }
    ax.plot(measurement.frequency, size, **{**look, "label": measurement.name, **style})
    if not ax.get_ylabel():
        ax.set(xlabel=FREQUENCY, ylabel=AMPLITUDE)


@register_plot(OptimalCurve)
def plot_optimal(
    result: OptimalCurve, ax: Axes | None = None, *, quantity: str = "amplitude", title: str = ""
) -> Axes | NDArray:
    """Plot resonance amplitude and frequency shift over the preload (Figs 8 and 9 of the paper).

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
    Dotted lines connect different resonances.  A filled star is a verified optimum, an open star
    the least known value. By harmonic balance the amplitude of the shaded preloads is at most a
    fifth higher.  Hatched preloads have no value; open triangles there are lower bounds.  A bar at
    the optimum is the range of its peak with more harmonics.  Diamonds with bars are means and
    ranges in time.  Triangles to the left and to the right are clearly higher amplitudes with lower
    and higher friction coefficients.
    """
    shown = SHOWN if ax is None else (validation.choice("quantity", quantity, SHOWN),)
    given = new_axes(height=3.5, rows=2, height_ratios=(1.8, 1.0)) if ax is None else ax
    with drawing(given, title=title, legend=SMALL, rows=len(shown)) as axes:
        for each, name in zip(np.ravel(axes), shown):
            _draw_optimal(each, result, name)
        np.ravel(axes)[-1].set_xlabel(PRELOAD)
    return cast(Axes | NDArray, axes)


def _draw_optimal(ax: Axes, result: OptimalCurve, quantity: str) -> None:
    """Plot amplitude or frequency shift over the preload in one axes."""
    preload, values, goes_on = with_optimum(result, quantity)
    ax.set(xscale="log", ylabel="Frequency shift (%)")
    for first, last in runs(np.cumsum(~goes_on)):
        part = slice(first, last + 1)
        ax.plot(preload[part], values[part], ".-", color="0.1", markersize=4.0)
    for k in np.flatnonzero(
        ~goes_on[1:]
    ):  # another resonance becomes the highest, or one was not found
        ax.plot(preload[k : k + 2], values[k : k + 2], ":", color="0.1", linewidth=0.8)
    if quantity == "shift":
        if not np.isfinite(values).any():
            note(ax, "no frequency shift: no peak or no free resonance is known", empty=True)
        return
    levels = {name: getattr(result, name).amplitude for name in LIMITS}
    if min(levels.values()) > ALIKE * max(levels.values()):
        levels = {"free or stuck": max(levels.values())}
    for name, level in levels.items():
        at = result.preload[-2 if name == "free" else max(1, len(result) // 6)]
        limit_line(ax, name, result.preload, np.full(len(result), level), at)
    _mark_gaps(ax, result)
    _mark_checks(ax, result)
    _mark_optimum(ax, result)
    ax.set(yscale="log", ylabel=amplitude_label(result))


def with_optimum(
    result: OptimalCurve, quantity: str = "amplitude"
) -> tuple[NDArray, NDArray, NDArray]:
    """Return preloads and values, and whether each continues the branch of the previous point.

    Files of version 0.10 and older do not have the optimum in their table; it is inserted.
    """
    o, values, best = result.optimum, result.amplitude, result.optimum.amplitude
    if quantity == "shift":
        values, best = result.shift_percent, 100.0 * (o.frequency / result.free.frequency - 1.0)
    k = int(np.searchsorted(result.preload, o.preload))
    if not 0 < k < len(result) or o.preload in result.preload:
        return result.preload, values, result.goes_on
    return (
        np.insert(result.preload, k, o.preload),
        np.insert(values, k, best),
        np.insert(result.goes_on, k, True),
    )


def _mark_checks(ax: Axes, result: OptimalCurve) -> None:
    """Mark results of time integration, of other friction coefficients and of more harmonics."""
    for response in result.time_response:
        if np.isfinite(response.mean):
            mark_time_response(response, ax, response.preload)
    if k := result.optimum_in_time:
        ax.plot(
            k.preload, k.mean, "D", color=IN_TIME, markersize=4.5, zorder=6.0, label="least in time"
        )
    for marker, peak in zip("<>", result.other_friction[1:]):
        name = f"{peak.factor:g} times the friction"
        visible = NEAR_BEST * result.other_friction[0].amplitude < peak.amplitude < np.inf
        if visible:  # others would lie on the star
            ax.plot(peak.preload, peak.amplitude, marker, color="0.35", markersize=4.5, label=name)
    if result.convergence is not None and len(result.convergence.peaks) > 1:
        low, high = result.convergence.range
        ax.errorbar(result.convergence.preload, low, [[0.0], [high - low]], fmt="none", ecolor="0.35", elinewidth=1.0,
                    capsize=2.5, label="range with more harmonics")  # fmt: skip


def _mark_optimum(ax: Axes, result: OptimalCurve) -> None:
    """Mark the optimum with a star and a label, and shade the preloads that are nearly as good."""
    o = result.optimum
    if not np.isfinite(o.preload):
        note(ax, result._headline())
        return
    ends = {
        "end": "least at the end of the range",
        "edge": "least at the limit of steady responses",
    }
    name = {**ends, "jump": "optimum at a jump"}.get(o.kind, "optimum")
    name = name if o.verified else (name if o.kind in ends else "least value") + ", not verified"
    fill = OPTIMUM if o.verified else "w"
    ax.plot(
        o.preload, o.amplitude, "*", color=OPTIMUM, markersize=9.0, markerfacecolor=fill, zorder=7.0
    )
    within = f"at most {percent(NEAR_BEST - 1.0)} higher by harmonic balance"
    ax.axvspan(*result.near_best, color=OPTIMUM, alpha=0.1, linewidth=0.0, label=within)
    ax.margins(y=0.25)  # for the name
    lines = [f"{name}: {amount(o.preload, 'N')}, {amount(o.amplitude, 'm')}"]
    if k := result.optimum_in_time:
        lines.append(f"in time: {amount(k.preload, 'N')}, {amount(k.largest, 'm')}")
    lines += [f"not for design: {counted(len(result.failures), 'check')} failed"] * bool(
        result.failures
    )
    name_point(
        ax, "\n".join(wrapped(line, 32) for line in lines), (o.preload, o.amplitude), color=OPTIMUM
    )


def _mark_gaps(ax: Axes, result: OptimalCurve) -> None:
    """Hatch preloads without a value, halfway to their neighbours, and mark lower bounds."""
    x, missing = np.log(result.preload), ~np.isfinite(result.amplitude)
    if not missing.any():
        return
    edges = np.exp(np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]]))
    kind = np.where(missing, np.where(np.isnan(result.lower_bound), 1, 2), 0)
    kind[missing & (result.preload <= result.lowest_steady_preload)] = 3
    reasons = {1: ("////", "no value: no peak found"), 2: ("....", "no value: curve incomplete"),
               3: ("xxxx", f"{NO_STEADY} up to {amount(result.lowest_steady_preload, 'N')}")}  # fmt: skip
    for first, last in runs(kind):
        if missing[first]:
            hatch, reason = reasons[int(kind[first])]
            look: dict[str, Any] = {
                "facecolor": "none",
                "edgecolor": "0.75",
                "linewidth": 0.0,
                "zorder": 0,
            }
            ax.axvspan(edges[first], edges[last + 1], hatch=hatch, label=once(ax, reason), **look)
    if np.isfinite(result.lower_bound).any():
        look = {"color": "0.4", "markersize": 4.0, "markerfacecolor": "w"}
        ax.plot(result.preload, result.lower_bound, "^", label="lower bound", **look)


@picture(TimeResponse, "mark")
def mark_time_response(time_response: TimeResponse, ax: Axes, x: float | None = None) -> None:
    """Mark mean and range of the highest blade in time by a bar, by default at its frequency."""
    mean, name = time_response.mean, "highest blade in time, and range"
    ends = [[mean - time_response.lowest], [time_response.largest - mean]]
    ax.errorbar(time_response.frequency if x is None else x, mean, ends, fmt="D", color=IN_TIME, markerfacecolor="w",
                markersize=4.5, capsize=3.0, linewidth=1.2, zorder=5.0, label=once(ax, name))  # fmt: skip


@picture(TimeSweep)
def plot_frequency_sweep(
    sweep: TimeSweep, ax: Axes = NEW, *, label: str = "", **style: Any
) -> None:
    """Plot the amplitude over frequency of a sweep in time, also over response curves.

    ``style`` are line options.
    """
    if not ax.has_data():
        ax.set_title(f"{abs(sweep.rate):.3g} Hz/s, preload {amount(sweep.preload, 'N')}")
    look = {
        "marker": "^" if sweep.up else "v",
        "markevery": 0.12,
        "markersize": 3.0,
        "markerfacecolor": "w",
    }
    line = {"color": IN_TIME, "linewidth": 0.7, **look, **style}
    label = label or f"sweep {'up' if sweep.up else 'down'} in time"
    draw_table(ax, sweep, "frequency", "amplitude", label=label, **line)


# ---- Response map ----


@picture(OptimalCurve, "map")
def plot_response_map(result: OptimalCurve, ax: Axes = NEW) -> None:
    """Plot a map of the highest response over frequency and preload, with the optimal curve.

    Hatched regions have several solutions: the response curve passes a frequency more than once.

    Parameters
    ----------
    result : OptimalCurve
        Optimal curve with its response curves.
    """
    curves = [curve for curve in result.curves if len(curve)]
    validation.check(
        len(curves) >= 2, "result", "an optimal curve with two or more curves", len(curves)
    )
    low, high = result.settings["frequency"]
    columns = 400  # so that a column of the map is narrower than a pixel of a printed page
    frequency = np.linspace(low, high, columns)
    values, counts = zip(
        *(highest_on(frequency, c.frequency, c.amplitude[:, None], c.branch) for c in curves)
    )
    height, count = np.array(values)[..., 0], np.array(counts)
    preload = np.array([curve.preload for curve in curves])
    image = ax.pcolormesh(
        frequency, preload, height, shading="nearest", norm="log", rasterized=True
    )
    ax.figure.colorbar(image, ax=ax, label="Amplitude (m)")
    if (count > 1).any():
        ax.contourf(
            frequency,
            preload,
            (count > 1).astype(float),
            levels=[0.5, 1.5],
            colors="none",
            hatches=["////"],
        )
        ax.fill([], [], facecolor="none", edgecolor="0.3", hatch="////", label="several solutions")
    ax.plot(result.frequency, result.preload, color="k", linewidth=2.4)
    ax.plot(result.frequency, result.preload, color="w", linewidth=1.0)
    ax.plot([], [], color="k", label="highest")
    if np.isfinite(result.optimum.preload):
        look: dict[str, Any] = {
            "color": OPTIMUM,
            "markeredgecolor": "w",
            "markersize": 11.0,
            "linestyle": "none",
        }
        ax.plot(
            result.optimum.frequency, result.optimum.preload, marker="*", label="optimum", **look
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
    results: Mapping[str, Any], quantity: str | None = None, ax: Axes = NEW, *, measured: Sequence[Measurement] = ()
) -> None:  # fmt: skip
    """Plot several results of one type on the same axes.

    Stars mark optima, filled if verified by complete response curves.  Lines are interrupted at
    points without a value.

    Parameters
    ----------
    results : mapping of name to result
        Response curves over frequency, optimal curves over preload, dissipation over amplitude, or
        loops of all contacts over the response.
    quantity : str, optional
        "amplitude" or "shift" (of frequency) of optimal curves, "damping_ratio" or "stiffness" of
        dissipation.
    measured : sequence of Measurement
        Measurements to plot over response curves.
    """
    validation.check_value(
        isinstance(results, Mapping) and results,
        "results",
        "a mapping of one or more names to results",
        results,
    )
    kind = next(
        (kind for kind in OF if all(isinstance(result, kind) for result in results.values())), None
    )
    if kind is None:
        kinds = "response curves, optimal curves or hysteresis, all of one kind"
        raise validation.invalid(
            "results", kinds, [type(result).__name__ for result in results.values()]
        )
    x, quantities = OF[kind]
    quantity = validation.choice("quantity", quantity or quantities[0], quantities)
    if isinstance(measured, Measurement) or (measured and kind is not ResponseCurve):
        raise validation.invalid(
            "measured", "a sequence of Measurement, over response curves", measured
        )
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
        known = np.flatnonzero(np.isfinite(getattr(result, y)))
        draw_table(
            ax,
            result,
            x,
            y,
            **look,
            markevery=known[:: max(1, len(known) // 8)].tolist(),
            label=name,
        )
        ax.set_xscale("log")
        if kind is OptimalCurve and quantity == "amplitude":
            ax.set_yscale("log")
            o = result.optimum
            face, mark = (
                (look["color"], "optimum") if o.verified else ("w", "least value, not verified")
            )
            if np.isfinite(o.preload):
                ax.plot(o.preload, o.amplitude, "*", color=look["color"], markersize=8.0, markerfacecolor=face,
                        label=once(ax, mark))  # fmt: skip


@register_plot(Comparison)
def plot_comparison(comparison: Comparison, *arguments: Any, **options: Any) -> Axes:
    """Plot all results of a comparison on the same axes (:func:`plot_together`)."""
    return cast(Axes, plot_together(comparison.results, *arguments, **options))
