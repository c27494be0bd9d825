"""Curves over frequency, preload and time, in the style that :mod:`bdamper.plot.axes` describes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.continuation.rattle import NO_STEADY
from bdamper.effects.compare_laws import LawComparison
from bdamper.effects.hysteresis import Dissipation
from bdamper.effects.microslip import Microslip
from bdamper.io.measured import Fit, Measured, Measurement, goodness_of_fit
from bdamper.peaks.optimal_curve import NEAR_BEST, OptimalCurve
from bdamper.plot.axes import DASHED, LIMITS, STYLES, colours, drawing, legend_beside, limit_line, runs, stacked
from bdamper.stability.steady_state import SettledResponse
from bdamper.stability.time_sweep import TimeSweep
from bdamper.stability.verification import Verification
from bdamper.util import validate
from bdamper.util.kept import Kept
from bdamper.util.plotting import draws
from bdamper.util.tables import label as label_of
from bdamper.util.text import amount, percent

AT_EDGE = 1e-6
"""Relative distance in frequency within which a point lies at the edge of a part."""
MOST_NAMED = 5
"""Curves that a legend names; more have a colour bar."""
SWEEPS: dict[str, dict[str, Any]] = {
    "up": {"color": "tab:red", "linewidth": 3.0, "alpha": 0.35},
    "down": {"color": "tab:blue", "linewidth": 3.0, "alpha": 0.35},
}
"""Lines of slow sweeps, laid over their curve."""
KEPT: dict[str, Any] = {
    "fmt": "D", "color": "tab:green", "markersize": 4.0, "markerfacecolor": "w", "capsize": 3.0, "linewidth": 1.2,
    "label": "a blade keeps in time, and range",
}  # fmt: skip
"""Point and bar of what a blade keeps."""
ALIKE = 0.9
"""Ratio from which both limits are one line."""
TAKES_OVER = "another peak takes over in between"
SHOWN = ("amplitude", "shift")
"""Quantities of an optimal curve."""
FREQUENCY, AMPLITUDE, PRELOAD = (label_of(Dissipation, name) for name in ("frequency", "amplitude", "preload"))


def amplitude_label(*results: Curve | OptimalCurve) -> str:
    """Label of an axis that says where the amplitude is, "Tip amplitude (m)", where all results have the same place."""
    seen = [r.settings["response"]["location"] for r in results if "response" in r.settings]
    known = len(seen) == len(results) > 0 and all(place == seen[0] for place in seen)
    return f"{seen[0].replace('_', ' ').capitalize()} amplitude (m)" if known else AMPLITUDE


def unstable_points(curve: Curve) -> NDArray:
    """(n,) bool: from the stability analysis where there is one, else where the curve runs back in frequency."""
    return curve.backward if curve.stable is None else ~np.asarray(curve.stable, bool)


def _draw_tracking(ax: Axes, curve: Curve, colour: Any, label: str | None) -> None:
    f, a = curve.frequency, curve.amplitude
    unstable = unstable_points(curve)
    for b in np.unique(curve.branch):
        where = np.flatnonzero(curve.branch == b)
        for first, last in runs(unstable[where]):
            part = where[first : last + 2]  # joined to the next stretch
            if unstable[part[0]]:  # a pale line below, so that a stretch shorter than a dash is no gap
                ax.plot(f[part], a[part], color=colour, alpha=0.3)
            ax.plot(f[part], a[part], color=colour, linestyle=DASHED if unstable[part[0]] else "-")
    if len(curve):  # filled: a peak, open: only the highest point
        face = "w" if _only_highest(curve) else colour
        ax.plot(curve.peak.frequency, curve.peak.amplitude, "o", color=colour, markersize=5.0, markerfacecolor=face)
    ax.plot([], [], color=colour, label=label)


def _only_highest(curve: Curve) -> bool:
    """Whether the highest point lies at the end of what was followed, so that there may be a higher one."""
    f = curve.peak.frequency
    return curve.peak_at_end or any(part.low - AT_EDGE * f <= f <= part.high + AT_EDGE * f for part in curve.left_out)


def plot_curves(
    curves: Sequence[Curve],
    ax: Axes | None = None,
    *,
    labels: Sequence[str] | None = None,
    title: str = "",
    sweeps: bool = False,
) -> Axes:
    """Amplitude over frequency for several curves in one picture.

    Parameters
    ----------
    curves : sequence of Curve
        Tracking curves and, as thin grey lines, the free and stuck limits.
    ax : matplotlib axes, optional
    labels : sequence of str, optional
        One for each tracking curve; the preload by default.
    title : str
    sweeps : bool
        Draw what slow sweeps of frequency up and down show (:meth:`bdamper.continuation.curve.Curve.sweep`).

    Returns
    -------
    matplotlib axes
    """
    validate.that(isinstance(curves, Iterable), "curves", "a sequence of Curve (plot_curve draws one)", curves)
    curves = tuple(curves)
    tracking = [c for c in curves if validate.instance("curves", c, Curve).kind == "tracking"]
    if labels is not None and (isinstance(labels, str) or len(labels) != len(tracking)):
        raise validate.unfit("labels", f"{len(tracking)} texts, one for each tracking curve", labels)
    with drawing(ax, title=title) as ax:
        for curve in curves:
            if curve.kind != "tracking" and len(curve):
                limit_line(ax, curve.kind, curve.frequency, curve.amplitude, curve.peak.frequency)
        gaps: list[Any] = []
        many = labels is None and len(tracking) > MOST_NAMED
        for i, (curve, colour) in enumerate(zip(tracking, colours(len(tracking)))):
            named = labels[i] if labels is not None else f"preload {amount(curve.preload, 'N')}"
            _draw_tracking(ax, curve, colour, None if many else named)
            for sweep in (curve.sweep(direction) for direction in SWEEPS if sweeps):
                ax.plot(sweep.frequency, sweep.amplitude, **SWEEPS[sweep.direction])
            for part in curve.left_out:
                name = "" if gaps else "not followed"
                gaps.append(ax.axvspan(part.low, part.high, color=colour, alpha=0.25, linewidth=0.6, label=name))
        if any(unstable_points(c).any() for c in tracking):
            ax.plot([], [], color="k", linestyle=DASHED, label="unstable")
        for direction, style in SWEEPS.items() if sweeps else ():
            ax.plot([], [], **style, label=f"sweep {direction}")
        if any(len(c) and _only_highest(c) for c in tracking):
            ax.plot([], [], "o", color="k", markersize=5.0, markerfacecolor="w", markeredgewidth=0.6,
                    label="highest point that was followed")  # fmt: skip
        ax.set(xlabel=FREQUENCY, ylabel=amplitude_label(*curves), yscale="log")
        if many:
            preloads = [curve.preload for curve in tracking]
            bar = plt.cm.ScalarMappable(LogNorm(min(preloads), max(preloads)), ListedColormap(colours(256)))
            ax.figure.colorbar(bar, ax=ax, label=PRELOAD)
        legend_beside(ax)
    return ax


@draws(Curve)
def plot_curve(curve: Curve, ax: Axes | None = None, **style: Any) -> Axes:
    """Amplitude over frequency for one curve; ``style`` as for :func:`plot_curves`."""
    return plot_curves([curve], ax, **style)


@draws(LawComparison)
def plot_laws(comparison: LawComparison, ax: Axes | None = None, **style: Any) -> Axes:
    """Curves under several friction laws in one picture; ``style`` as for :func:`plot_curves`."""
    return plot_curves(comparison.curves, ax, labels=comparison.laws, **style)


@draws(Measurement)
def plot_measurement(measurement: Measurement, ax: Axes | None = None, scale: float | None = None, **style: Any) -> Axes:
    """Lay a measured response over curves, in metres.

    Parameters
    ----------
    measurement : Measurement
    ax : Axes, optional
        Those of the curves; the legend they have takes up the measured points.
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
    with drawing(ax) as axes:
        axes.plot(measurement.frequency, factor * measurement.amplitude, **{**look, "label": measurement.name, **style})
        if ax is None:
            axes.set(xlabel=FREQUENCY, ylabel=AMPLITUDE)
        legend_beside(axes)
    return axes


@draws(OptimalCurve)
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
    most a fifth above it.  Where there is no value the picture is hatched; an open triangle there is a lower bound.  Bars
    are the ranges of amplitude that the ladder of harmonics has found; squares with bars mean and range of marches in
    time; triangles what slow sweeps of frequency up and down meet.
    """
    if ax is None:
        both = stacked(5.0, (2.0, 1.0))
        for one, name in zip(both, ("amplitude", "shift")):
            plot_optimal(result, one, quantity=name, title=title if one is both[0] else "")
        both[0].set_xlabel("")
        return both
    preload, values, goes_on = _with_optimum(result, validate.choice("quantity", quantity, SHOWN))
    with drawing(ax, title=title, legend=7.0) as ax:
        ax.set(xscale="log", xlabel=PRELOAD)
        for first, last in runs(np.cumsum(~goes_on)):
            part = slice(first, last + 1)
            ax.plot(preload[part], values[part], ".-", color="0.1", markersize=4.0)
        for n, k in enumerate(np.flatnonzero(~goes_on[1:])):  # where another peak becomes the highest, or one was lost
            label = "" if n or quantity == "shift" else TAKES_OVER
            ax.plot(preload[k : k + 2], values[k : k + 2], ":", color="0.1", linewidth=0.8, label=label)
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


def _with_optimum(result: OptimalCurve, quantity: str) -> tuple[NDArray, NDArray, NDArray]:
    """Preloads, values and whether they go on from the one before, the optimum among them."""
    o, values, best = result.optimum, result.amplitude, result.optimum.amplitude
    if quantity == "shift":
        values, best = result.shift_percent, 100.0 * (o.frequency / result.free.frequency - 1.0)
    k = int(np.searchsorted(result.preload, o.preload))
    if not 0 < k < len(result):
        return result.preload, values, result.goes_on
    return np.insert(result.preload, k, o.preload), np.insert(values, k, best), np.insert(result.goes_on, k, True)


def _mark_checks(ax: Axes, result: OptimalCurve) -> None:
    """What slow sweeps, marches in time and more harmonics have found at some preloads."""
    if result.swept:
        preload, up, _, down, _ = np.array([s[:5] for s in result.swept]).T
        ax.vlines(preload, np.fmin(up, down), np.fmax(up, down), color="0.5", linewidth=0.8)
        ax.plot(preload, up, "k^", markersize=3.5, markerfacecolor="w", label="highest of a sweep up")
        ax.plot(preload, down, "kv", markersize=3.5, markerfacecolor="0.6", label="highest of a sweep down")
    if seen := [k for k in result.kept if np.isfinite(k.mean)]:
        preload, mean, low, high = np.array([(k.preload, k.mean, k.lowest, k.highest) for k in seen]).T
        ax.errorbar(preload, mean, [mean - low, high - mean], **KEPT)
    if k := result.least_kept:
        ax.plot(k.preload, k.mean, "D", color="tab:green", markersize=4.0, label=f"least kept, {amount(k.preload, 'N')}")
    if result.ladder is not None and result.ladder.ranges:
        preload, low, high = np.array(result.ladder.ranges).T
        ax.errorbar(preload, low, [0.0 * low, high - low], fmt="none", ecolor="0.35", elinewidth=1.0, capsize=2.5,
                    label="range with more harmonics")  # fmt: skip


def _mark_optimum(ax: Axes, result: OptimalCurve) -> None:
    """Star and label at the optimum, and the range of preloads that are nearly as good."""
    o = result.optimum
    if not np.isfinite(o.preload):
        ax.plot([], [], linestyle="none", label="flat: no optimum" if o.kind == "flat" else "no optimum")
        return
    ends = {"end": "least at the end of the range", "edge": "least where steady responses end"}
    what = {**ends, "jump": "optimum at a jump"}.get(o.kind, "optimum")
    what = what if o.verified else (what if o.kind in ends else "least value") + ", not verified"
    ax.plot(o.preload, o.amplitude, "*", color="tab:red", markersize=10.0, markerfacecolor="tab:red" if o.verified else "w",
            label=f"{what}, {amount(o.preload, 'N')}")  # fmt: skip
    left = o.preload**4 < result.preload[0] ** 3 * result.preload[-1]  # in the first quarter: no room to the left
    ax.annotate(f"{amount(o.preload, 'N')}: {amount(o.amplitude, 'm')}", (o.preload, o.amplitude), xytext=(0, -9), va="top",
                textcoords="offset points", ha="left" if left else "center", fontsize=8.0, color="tab:red")  # fmt: skip
    low, high = result.preloads_within(NEAR_BEST * o.amplitude)
    ax.axvspan(low, high, color="tab:red", alpha=0.1, linewidth=0.0, label=f"at most {percent(NEAR_BEST - 1.0)} more")
    ax.margins(y=0.15)  # for the label


def _mark_gaps(ax: Axes, result: OptimalCurve) -> None:
    """Hatch the preloads without a value, up to halfway to their neighbours, and mark what is known there from below."""
    x, missing = np.log(result.preload), ~np.isfinite(result.amplitude)
    if not missing.any():
        return
    edges = np.exp(np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]]))
    kind = np.where(missing, np.where(np.isnan(result.lower_bound), 1, 2), 0)
    kind[missing & (result.preload <= result.no_steady_below)] = 3
    looks = {1: ("////", "no value: no peak found"), 2: ("....", "no value: curve not followed to its ends"),
             3: ("xxxx", f"{NO_STEADY} below {amount(result.no_steady_below, 'N')}")}  # fmt: skip
    for first, last in runs(kind):
        if not missing[first]:
            continue
        hatch, reason = looks[int(kind[first])]
        label = reason if first == np.argmax(kind == kind[first]) else None
        look: dict[str, Any] = {"facecolor": "none", "edgecolor": "0.75", "linewidth": 0.0, "zorder": 0}
        ax.axvspan(edges[first], edges[last + 1], hatch=hatch, label=label, **look)
    if np.isfinite(result.lower_bound).any():
        look = {"color": "0.4", "markersize": 4.0, "markerfacecolor": "w"}
        ax.plot(result.preload, result.lower_bound, "^", label="lower bound", **look)


def plot_over_measurement(
    curves: Mapping[str, OptimalCurve],
    measured: Measured | None = None,
    *,
    quantity: str = "amplitude",
    ax: Axes | None = None,
) -> tuple[Axes, Fit | None]:
    """Normalised optimal or frequency-shift curves with measured points, as in Figs 21 and 22 of the paper.

    Loads are divided by the optimum load, amplitudes by that of the free resonance, measured ones by that of the measured
    reference (:mod:`bdamper.io.measured`).  Measured loads are divided by the predicted optimum load, so that an error of
    the optimum shows.

    Parameters
    ----------
    curves : mapping of name to OptimalCurve
        The fit is that of the first.
    measured : Measured, optional
        Load in newtons, frequency in hertz, amplitude in any unit.
    quantity : {"amplitude", "shift"}
    ax : matplotlib axes, optional

    Returns
    -------
    matplotlib axes, and the goodness of fit (None without measured points)
    """
    validate.choice("quantity", quantity, ("amplitude", "shift"))
    if not isinstance(curves, Mapping) or not curves:
        raise validate.unfit("curves", "a mapping of one or more names to optimal curves", curves)
    for name, curve in curves.items():
        validate.instance(f"curve '{name}'", curve, OptimalCurve)
        validate.require(np.isfinite(curve.optimum.preload), "curves", "some with an optimum", f"'{name}': {curve.optimum}")
    fit = None
    with drawing(ax, legend=8.0) as ax:
        for k, (name, curve) in enumerate(curves.items()):
            load = curve.preload / curve.optimum.preload
            value = curve.amplitude / curve.free.amplitude if quantity == "amplitude" else curve.shift_percent
            stuck = curve.stuck.amplitude / curve.free.amplitude if quantity == "amplitude" else curve.stuck_shift_percent
            colour = ("0.1", "0.1", colours(3)[1], "0.6")[k % 4]
            ax.plot(load, value, linestyle=STYLES[k % 4], color=colour, label=name)
            ax.plot(load[-1] * 1.15, stuck, marker=8, color=colour, markersize=6.0, linestyle="none", clip_on=False)
        ax.plot([], [], marker=8, color="0.1", markersize=6.0, linestyle="none", label="stuck")
        if measured is not None:
            fit = _lay_measured(ax, next(iter(curves.values())), measured, quantity)
            ax.set_title(str(fit), fontsize=8.0)
        ax.set(xscale="log", xlabel="Load over optimum load")
        if quantity == "amplitude":
            ax.set(yscale="log", ylabel=amplitude_label(*curves.values()).removesuffix(" (m)") + ", over free")
        else:
            ax.set_ylabel("Frequency shift (%)")
    return ax, fit


def _lay_measured(ax: Axes, curve: OptimalCurve, measured: Measured, quantity: str) -> Fit:
    """Draw measured points over a normalised curve; how well they agree."""
    if quantity == "amplitude":
        load, value = measured.normalised("amplitude")
        shown, predicted = value, curve.amplitude / curve.free.amplitude
    else:  # the fit is that of frequencies: shifts start at zero
        load, value = measured.normalised("frequency")
        shown, predicted = 100.0 * (value - 1.0), 1.0 + curve.shift_percent / 100.0
    load = load / curve.optimum.preload
    ax.plot(load, shown, "s", color="0.1", markersize=4.0, markerfacecolor="w", label="measured")
    return goodness_of_fit(curve.preload / curve.optimum.preload, predicted, load, value)


@draws(Microslip)
def plot_microslip(microslip: Microslip, ax: Axes | None = None) -> Axes:
    """Force over displacement of first loading."""
    with drawing(ax) as ax:
        ax.plot(microslip.displacement, microslip.force, "o-", color="0.1")
        ax.set(xlabel="Displacement (m)", ylabel="Force (N)")
    return ax


@draws(Verification)
def plot_verification(verification: Verification, ax: Axes | None = None) -> Axes:
    """One settled period in time beside the harmonic-balance solution."""
    periods = verification.frequency * verification.time
    dark, light = colours(2)
    within = f"{verification.verdict} within {100.0 * verification.tolerance:g} %"
    with drawing(ax, title=f"{verification.frequency:.6g} Hz: {within}", legend=7.0) as ax:
        label = f"time integration, {verification.periods} periods"
        ax.plot(periods, verification.response, color=light, linewidth=2.4, label=label)
        ax.plot(periods, verification.expected_response, "-.", color=dark, label="harmonic balance")
        ax.set(xlabel="Time (periods)", ylabel="Response (m)")
    return ax


@draws(SettledResponse)
def plot_settled(settled: SettledResponse, ax: Axes | None = None) -> Axes:
    """Amplitude of each period of a marched response, with mean and range of the half that counts."""
    with drawing(ax, title=f"{settled.frequency:.6g} Hz, preload {amount(settled.preload, 'N')}", legend=7.0) as ax:
        n = len(settled.amplitude)
        half = [n // 2, n - 1]
        ax.fill_between(half, *settled.range, color="0.85", label="range")
        ax.plot(np.arange(n), settled.amplitude, color="0.2", linewidth=0.9, label="each period")
        ax.plot(half, [settled.mean] * 2, color="k", linewidth=2.0, label="mean")
        ax.set(xlabel="Period of the excitation", ylabel=AMPLITUDE)
    return ax


@draws(SettledResponse, "mark")
def mark_settled(settled: SettledResponse, ax: Axes) -> Axes:
    """Mean and range of a marched response as a point with a bar over response curves; one entry for all in the legend."""
    label = "time integration, mean and range"
    known = label in ax.get_legend_handles_labels()[1]
    low, high = settled.range
    bar = [[settled.mean - low], [high - settled.mean]]
    with drawing(ax, legend=7.0):
        ax.errorbar(settled.frequency, settled.mean, yerr=bar, fmt="s", color="k", markersize=3.0, markerfacecolor="w",
                    capsize=2.0, linewidth=0.8, label=None if known else label)  # fmt: skip
    return ax


@draws(Kept, "mark")
def mark_kept(kept: Kept, ax: Axes) -> Axes:
    """Mean and range of what a blade keeps as a point with a bar over response curves."""
    bar = [[kept.mean - kept.lowest], [kept.highest - kept.mean]]
    with drawing(ax, legend=7.0):
        ax.errorbar(kept.frequency, kept.mean, yerr=bar, **KEPT)
    return ax


@draws(TimeSweep)
def plot_time_sweep(sweep: TimeSweep, ax: Axes | None = None, *, label: str | None = None, **style: Any) -> Axes:
    """Amplitude over frequency of a sweep in time; ``ax`` may be those of tracking curves, ``style`` is for the line."""
    over, way = ax is not None, "up" if sweep.up else "down"
    title = "" if over else f"{abs(sweep.rate):.3g} Hz/s, preload {amount(sweep.preload, 'N')}"
    with drawing(ax, title=title, legend=7.0) as ax:
        line = {"color": "k" if sweep.up else "0.5", "linewidth": 0.9} | style
        ax.plot(sweep.frequency, sweep.amplitude, label=label or f"sweep {way}, marched in time", **line)
        if not over:
            ax.set(xlabel=FREQUENCY, ylabel=AMPLITUDE)
    return ax
