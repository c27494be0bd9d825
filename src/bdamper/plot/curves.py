"""Curves over frequency, preload and time, in the style that :mod:`bdamper.plot.axes` describes.

The response over frequency and preload as a map, from the whole curves of an optimal curve.

Several results on the same axes: designs, studies, measurements.
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
    colours,
    drawing,
    highest_on,
    limit_line,
    looks,
    new_axes,
    once,
    picture,
    runs,
)
from bdamper.plot.contact import OF_WHOLE
from bdamper.plot.speed_and_fatigue import SPEED
from bdamper.plot.studies import draw_table
from bdamper.response.optimal_curve_result import NEAR_BEST, OptimalCurve
from bdamper.response.response_curve import NO_STEADY
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.sensitivity import CurveSensitivity, band
from bdamper.response.verification import TimeResponse
from bdamper.time_domain.transients import TimeSweep
from bdamper.util import validation
from bdamper.util.display import register_plot
from bdamper.util.formatting import amount, percent, spaced
from bdamper.util.tables import axis_label as label_of

# ---- Curves over frequency, preload and time, in the style that  ----


MARCHED: dict[str, Any] = {
    "fmt": "D", "color": IN_TIME, "markersize": 4.5, "markerfacecolor": "w", "capsize": 3.0, "linewidth": 1.2,
    "zorder": 5.0, "label": "highest blade in time, and range",
}  # fmt: skip
"""Point and bar of a march in time, over the star of the optimum."""
ALIKE = 0.9
"""Ratio from which both limits are one line."""
SHOWN = ("amplitude", "shift")
"""Quantities of an optimal curve."""
FREQUENCY, AMPLITUDE, PRELOAD = (label_of(Hysteresis, name) for name in ("frequency", "amplitude", "preload"))


def amplitude_label(*results: ResponseCurve | OptimalCurve) -> str:
    """Label of an axis that says where the amplitude is, "Tip amplitude (m)", where all results have the same place."""
    seen = [r.settings["response"]["location"] for r in results if "response" in r.settings]
    known = len(seen) == len(results) > 0 and all(place == seen[0] for place in seen)
    return f"{seen[0].replace('_', ' ').capitalize()} amplitude (m)" if known else AMPLITUDE


def unstable_points(curve: ResponseCurve) -> NDArray:
    """(n,) bool: from the stability analysis where there is one, else where the curve runs back in frequency."""
    return curve.backward if curve.stable is None else ~np.asarray(curve.stable, bool)


def _draw_tracking(ax: Axes, curve: ResponseCurve, colour: Any, label: str | None) -> None:
    f, a = curve.frequency if curve.speed is None else curve.speed * RPM, curve.amplitude
    unstable = unstable_points(curve)
    if curve.blades is not None:
        single = np.abs(curve.blades[..., 1])
        for b in np.unique(curve.branch):
            ax.plot(f[curve.branch == b], single[curve.branch == b], color="0.75", linewidth=0.5)
    for b in np.unique(curve.branch):
        where = np.flatnonzero(curve.branch == b)
        for first, last in runs(unstable[where]):
            part = where[first : last + 2]  # joined to the next stretch
            if unstable[part[0]]:  # a pale line below, so that a stretch shorter than a dash is no gap
                ax.plot(f[part], a[part], color=colour, alpha=0.3)
            ax.plot(f[part], a[part], color=colour, linestyle=DASHED if unstable[part[0]] else "-")
    if len(curve):  # filled: a peak, open: only the highest point
        face = "w" if _only_highest(curve) else colour
        ax.plot(f[curve.peak.index], curve.peak.amplitude, "o", color=colour, markersize=5.0, markerfacecolor=face)
    ax.plot([], [], color=colour, label=label)


def _only_highest(curve: ResponseCurve) -> bool:
    """Whether the highest point lies at the end of what was followed, so that there may be a higher one."""
    f = curve.peak.frequency
    at_edge = 1e-6  # relative distance in frequency within which a point lies at the edge of a part
    return curve.peak_at_end or any(part.low - at_edge * f <= f <= part.high + at_edge * f for part in curve.missing_ranges)


@picture()
def plot_curves(curves: Sequence[ResponseCurve], ax: Axes = NEW, *, labels: Sequence[str] | None = None) -> None:
    """Amplitude over frequency for several curves in one picture, over speed for run-ups.

    Parameters
    ----------
    curves : sequence of ResponseCurve
        Response curves and, as thin grey lines, the free and stuck limits; or run-ups alone.
    labels : sequence of str, optional
        One for each response curve; the preload by default.
    """
    expected = "a sequence of ResponseCurve (plot_curve draws one)"
    validation.check_value(isinstance(curves, Iterable), "curves", expected, curves)
    curves = tuple(curves)
    tracking = [c for c in curves if validation.instance("curves", c, ResponseCurve).kind not in LIMITS]
    if labels is not None and (isinstance(labels, str) or len(labels) != len(tracking)):
        raise validation.invalid("labels", f"{len(tracking)} texts, one for each response curve", labels)
    for curve in curves:
        if curve.kind in LIMITS and len(curve):
            limit_line(ax, curve.kind, curve.frequency, curve.amplitude, curve.peak.frequency)
    most_named = 5  # curves that a legend names; more have a colour bar
    many = labels is None and len(tracking) > most_named
    for i, (curve, colour) in enumerate(zip(tracking, colours(len(tracking)))):
        preload = f"preload {amount(curve.preload, 'N')}"
        own = preload if curve.speed is None else f"engine order {curve.settings['engine_order']}"
        named = labels[i] if labels is not None else own
        _draw_tracking(ax, curve, colour, None if many else named)
        for part in curve.missing_ranges:
            ax.axvspan(part.low, part.high, color=colour, alpha=0.25, linewidth=0.6, label=once(ax, "not followed"))
    labels_of = (label for c in tracking for label in c.labels[unstable_points(c)])
    dashed = {label.partition(" with")[0] or "unstable" for label in labels_of}
    if dashed:
        ax.plot([], [], color="k", linestyle=DASHED, label=" or ".join(sorted(dashed)))
    if any(len(c) and _only_highest(c) for c in tracking):
        ax.plot([], [], "o", color="k", markersize=5.0, markerfacecolor="w", markeredgewidth=0.6,
                label="highest point that was followed")  # fmt: skip
    over = FREQUENCY if all(curve.speed is None for curve in curves) else SPEED
    ax.set(xlabel=over, ylabel=amplitude_label(*curves), yscale="log")
    if many:
        preloads = [curve.preload for curve in tracking]
        bar = plt.cm.ScalarMappable(LogNorm(min(preloads), max(preloads)), ListedColormap(colours(256)))
        ax.figure.colorbar(bar, ax=ax, label=PRELOAD)


@register_plot(ResponseCurve)
def plot_curve(curve: ResponseCurve, ax: Axes | None = None, **style: Any) -> Axes:
    """Amplitude over frequency for one curve, over speed for a run-up; ``style`` as for :func:`plot_curves`."""
    return plot_curves([curve], ax, **style)


@picture()
def plot_band(
    curve: ResponseCurve, found: Mapping[str, CurveSensitivity], deviations: Mapping[str, float], ax: Axes = NEW
) -> None:
    """A response curve with a band of two standard deviations to both sides, from derivatives along the curve.

    Parameters
    ----------
    curve : ResponseCurve
    found : mapping of name to CurveSensitivity
        As :meth:`bdamper.Study.curve_sensitivities` returns it.
    deviations : mapping of name to float
        Standard deviations of the parameters that scatter, independently.
    """
    _, frequency, amplitude = band(curve, found, deviations)
    several = "\n".join(spaced(name) for name in deviations)
    for b in np.unique(curve.branch):
        known = (curve.branch == b) & np.isfinite(frequency).all(axis=1)
        f, a = frequency[known], amplitude[known]
        edge = [np.concatenate([x[:, 0], x[::-1, 1]]) for x in (f, a)]
        ax.fill(*edge, color="0.8", linewidth=0.0, label=f"two deviations of\n{several}" if b == curve.branch[0] else None)
    plot_curves([curve], ax)


@picture(Measurement)
def plot_measurement(measurement: Measurement, ax: Axes = NEW, scale: float | None = None, **style: Any) -> None:
    """Lay a measured response over curves, in metres.

    Parameters
    ----------
    measurement : Measurement
    scale : float, optional
        From the unit of the measurement to metres; by default what its unit calls for.
    style
        Passed on to the line.

    Raises
    ------
    SettingError
        If the unit is not one of length and no scale is given.
    """
    factor = measurement.metres if scale is None else float(scale)
    look = {"linestyle": "none", "marker": "o", "markersize": 3.0, "markerfacecolor": "none", "color": "0.3"}
    ax.plot(measurement.frequency, factor * measurement.amplitude, **{**look, "label": measurement.name, **style})
    if not ax.get_ylabel():
        ax.set(xlabel=FREQUENCY, ylabel=AMPLITUDE)


@register_plot(OptimalCurve)
def plot_optimal(
    result: OptimalCurve, ax: Axes | None = None, *, quantity: str = "amplitude", title: str = ""
) -> Axes | NDArray:
    """Resonance amplitude and frequency shift over the preload, as in Figs 8 and 9 of the paper.

    Parameters
    ----------
    result : OptimalCurve
    ax : matplotlib axes, optional
        Of one quantity; both have axes of their own, one below the other, where there are none given.
    quantity : {"amplitude", "shift"}
    title : str

    Returns
    -------
    matplotlib axes, or an array of two

    Notes
    -----
    Lines are dotted from one peak to another that is the highest at the next preload.  A filled star marks an optimum that
    nothing known contradicts, an open one the least value otherwise; shaded are the preloads at which the amplitude is at
    most a fifth above it.  Where there is no value the picture is hatched; an open triangle there is a lower bound.  A bar
    at the optimum is the range of its peak with more harmonics; squares with bars mean and range of marches in
    time.
    """
    if ax is None:
        both: NDArray = new_axes(5.6, 5.0, 2, height_ratios=(2.0, 1.0))
        for one, name in zip(both, SHOWN):
            plot_optimal(result, one, quantity=name)
        both[0].set(xlabel="", title=title)
        return both
    preload, values, goes_on = with_optimum(result, validation.choice("quantity", quantity, SHOWN))
    with drawing(ax, title=title, legend=7.0) as ax:
        ax.set(xscale="log", xlabel=PRELOAD)
        for first, last in runs(np.cumsum(~goes_on)):
            part = slice(first, last + 1)
            ax.plot(preload[part], values[part], ".-", color="0.1", markersize=4.0)
        for k in np.flatnonzero(~goes_on[1:]):  # where another resonance becomes the highest, or one was lost
            ax.plot(preload[k : k + 2], values[k : k + 2], ":", color="0.1", linewidth=0.8)
        if quantity == "shift":
            ax.set_ylabel("Frequency shift (%)")
            return ax
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
    return ax


def with_optimum(result: OptimalCurve, quantity: str = "amplitude") -> tuple[NDArray, NDArray, NDArray]:
    """Preloads, values and whether they go on from the one before, the optimum among them."""
    o, values, best = result.optimum, result.amplitude, result.optimum.amplitude
    if quantity == "shift":
        values, best = result.shift_percent, 100.0 * (o.frequency / result.free.frequency - 1.0)
    k = int(np.searchsorted(result.preload, o.preload))
    if not 0 < k < len(result):
        return result.preload, values, result.goes_on
    return np.insert(result.preload, k, o.preload), np.insert(values, k, best), np.insert(result.goes_on, k, True)


def _mark_checks(ax: Axes, result: OptimalCurve) -> None:
    """What marches in time and more harmonics have found at some preloads."""
    for march in result.time_response:
        if np.isfinite(march.mean):
            _mark_march(ax, march.preload, march)
    if k := result.optimum_in_time:
        ax.plot(k.preload, k.mean, "D", color=IN_TIME, markersize=4.5, zorder=6.0, label="least in time")
    if result.convergence is not None and len(result.convergence.peaks) > 1:
        low, high = result.convergence.range
        ax.errorbar(result.convergence.preload, low, [[0.0], [high - low]], fmt="none", ecolor="0.35", elinewidth=1.0,
                    capsize=2.5, label="range with more harmonics")  # fmt: skip


def _mark_optimum(ax: Axes, result: OptimalCurve) -> None:
    """Star and label at the optimum, and the range of preloads that are nearly as good."""
    o = result.optimum
    if not np.isfinite(o.preload):
        ax.plot([], [], linestyle="none", label="flat: no optimum" if o.kind == "flat" else "no optimum")
        return
    ends = {"end": "least at the end of the range", "edge": "least where steady responses end"}
    what = {**ends, "jump": "optimum at a jump"}.get(o.kind, "optimum")
    what = what if o.verified else (what if o.kind in ends else "least value") + ", not verified"
    ax.plot(o.preload, o.amplitude, "*", color=OPTIMUM, markersize=10.0, markerfacecolor=OPTIMUM if o.verified else "w")
    low, high = result.preloads_within(NEAR_BEST * o.amplitude)
    ax.axvspan(low, high, color=OPTIMUM, alpha=0.1, linewidth=0.0, label=f"at most {percent(NEAR_BEST - 1.0)} more")
    left = o.preload**4 < result.preload[0] ** 3 * result.preload[-1]  # in the first quarter: no room to the left
    text = f"{what} {amount(o.preload, 'N')}, {amount(o.amplitude, 'm')}"
    ax.annotate(text, (o.preload, o.amplitude), xytext=(0, -16), va="top", textcoords="offset points",
                ha="left" if left else "center", fontsize=8.0, color=OPTIMUM)  # fmt: skip
    ax.margins(y=0.25)  # for the label


def _mark_gaps(ax: Axes, result: OptimalCurve) -> None:
    """Hatch the preloads without a value, up to halfway to their neighbours, and mark what is known there from below."""
    x, missing = np.log(result.preload), ~np.isfinite(result.amplitude)
    if not missing.any():
        return
    edges = np.exp(np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]]))
    kind = np.where(missing, np.where(np.isnan(result.lower_bound), 1, 2), 0)
    kind[missing & (result.preload <= result.lowest_steady_preload)] = 3
    reasons = {1: ("////", "no value: no peak found"), 2: ("....", "no value: curve not followed to its ends"),
               3: ("xxxx", f"{NO_STEADY} below {amount(result.lowest_steady_preload, 'N')}")}  # fmt: skip
    for first, last in runs(kind):
        if missing[first]:
            hatch, reason = reasons[int(kind[first])]
            look: dict[str, Any] = {"facecolor": "none", "edgecolor": "0.75", "linewidth": 0.0, "zorder": 0}
            ax.axvspan(edges[first], edges[last + 1], hatch=hatch, label=once(ax, reason), **look)
    if np.isfinite(result.lower_bound).any():
        look = {"color": "0.4", "markersize": 4.0, "markerfacecolor": "w"}
        ax.plot(result.preload, result.lower_bound, "^", label="lower bound", **look)


@picture(TimeResponse, "mark")
def mark_time_response(time_response: TimeResponse, ax: Axes) -> None:
    """Mean and range of the highest blade in time as a point with a bar over response curves."""
    _mark_march(ax, time_response.frequency, time_response)


def _mark_march(ax: Axes, x: float, time_response: TimeResponse) -> None:
    look = {**MARCHED, "label": once(ax, MARCHED["label"])}
    ax.errorbar(
        x,
        time_response.mean,
        [[time_response.mean - time_response.lowest], [time_response.highest - time_response.mean]],
        **look,
    )


@picture(TimeSweep)
def plot_frequency_sweep(sweep: TimeSweep, ax: Axes = NEW, *, label: str = "", **style: Any) -> None:
    """Amplitude over frequency of a sweep in time; ``ax`` may be those of response curves, ``style`` is for the line."""
    if not ax.has_data():
        ax.set_title(f"{abs(sweep.rate):.3g} Hz/s, preload {amount(sweep.preload, 'N')}")
    line = {"color": "k" if sweep.up else "0.5", "linewidth": 0.9, "marker": "", **style}
    label = label or f"sweep {'up' if sweep.up else 'down'}, marched in time"
    draw_table(ax, sweep, "frequency", "amplitude", label=label, **line)


# ---- The response over frequency and preload as a map, from the whole curves of an optimal curv ----


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
    validation.check(len(curves) >= 2, "result", "an optimal curve with two or more curves", len(curves))
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


# ---- Several results on the same axes ----


OF: dict[type, tuple[str, dict[str, str]]] = {
    ResponseCurve: ("frequency", {"amplitude": "amplitude"}),
    OptimalCurve: ("preload", {"amplitude": "amplitude", "shift": "shift_percent"}),
    Hysteresis: ("amplitude", {"damping_ratio": "damping_ratio", "stiffness": "stiffness"}),
}
"""Of each kind of result the column that it is drawn over, and what can be drawn, by the name of its quantity."""
OPTIMA = {True: "optimum", False: "least value, not verified"}


@picture()
def plot_together(
    results: Mapping[str, ResponseCurve] | Mapping[str, OptimalCurve] | Mapping[str, Hysteresis],
    quantity: str | None = None, ax: Axes = NEW, *, measured: Sequence[Measurement] = (),
) -> None:  # fmt: skip
    """Several results of one kind on the same axes.

    Stars mark optima, filled where whole response curves have verified them; lines end where there is no value.

    Parameters
    ----------
    results : mapping of name to result
        Response curves over frequency, optimal curves over preload, dissipation over amplitude, or loops of all contacts
        over the response.
    quantity : str, optional
        "amplitude" or "shift" (of frequency) of optimal curves, "damping_ratio" or "stiffness" of dissipation.
    measured : sequence of Measurement
        Laid over response curves.
    """
    validation.check_value(
        isinstance(results, Mapping) and results, "results", "a mapping of one or more names to results", results
    )
    kind = next((kind for kind in OF if all(isinstance(result, kind) for result in results.values())), None)
    if kind is None:
        found = [type(result).__name__ for result in results.values()]
        kinds = "response curves, optimal curves or hysteresis, all of one kind"
        raise validation.invalid("results", kinds, found)
    x, columns = OF[kind]
    quantity = validation.choice("quantity", quantity or next(iter(columns)), columns)
    if isinstance(measured, Measurement) or (measured and kind is not ResponseCurve):
        raise validation.invalid("measured", "a sequence of Measurement, over response curves", measured)
    if kind is ResponseCurve:
        curves = cast(Mapping[str, ResponseCurve], results)
        plot_curves(list(curves.values()), ax, labels=[name for name, curve in curves.items() if curve.kind not in LIMITS])
        for one in measured:
            plot_measurement(one, ax)
    result: Any
    for (name, result), look in zip(results.items(), looks(len(results))) if kind is not ResponseCurve else ():
        if isinstance(result, Hysteresis) and result.single:
            ax.plot(*result.loop(), **{**look, "marker": ""}, label=name)
            ax.set(**OF_WHOLE)
            continue
        y = columns[quantity]
        known = np.flatnonzero(np.isfinite(getattr(result, y)))
        draw_table(ax, result, x, y, **look, markevery=known[:: max(1, len(known) // 8)].tolist(), label=name)
        ax.set_xscale("log")
        if isinstance(result, OptimalCurve) and quantity == "amplitude":
            ax.set_yscale("log")
            _star(ax, result, look["color"])


def _star(ax: Axes, result: OptimalCurve, colour: Any) -> None:
    """The optimum, if there is one, filled where it is verified, with one name for all in the legend."""
    o = result.optimum
    if np.isfinite(o.preload):
        look = {"color": colour, "markersize": 8.0, "markerfacecolor": colour if o.verified else "w", "linestyle": "none"}
        ax.plot(o.preload, o.amplitude, marker="*", label=once(ax, OPTIMA[o.verified]), **look)


@register_plot(Comparison)
def plot_comparison(comparison: Comparison, *arguments: Any, **options: Any) -> Axes:
    """All results of a comparison on the same axes, as :func:`plot_together` draws them."""
    return cast(Axes, plot_together(comparison.results, *arguments, **options))
