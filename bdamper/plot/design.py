"""Design studies, and what settings change: sweeps, samples, advice, accuracy over time."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import FuncFormatter

from bdamper.accuracy.ladders import COMBINED, AccuracyCost
from bdamper.design.sweep import SweepResult
from bdamper.design.uncertainty import UncertainCurve
from bdamper.effects.advice import Advice
from bdamper.plot.axes import MARKERS, STYLES, colours, drawing, legend_beside, lost, plain_number
from bdamper.util.errors import SettingError
from bdamper.util.ladder import Ladder
from bdamper.util.plotting import draws
from bdamper.util.text import UNITS, amount, percent, spaced

LEFT_OUT = "0.55"
"""Colour of the name of an effect that may be left out."""
MAIN = ("amplitude", "optimum_amplitude")
"""Answers of a sweep that are drawn unless others are asked for."""
EQUAL = 1e-12
"""Relative difference below which two answers are the same."""
_WORDS = {"amplitude": "resonance amplitude", "frequency": "resonance frequency", "stick": "share of stick",
          "slip": "share of slip", "open": "share of separation"}  # fmt: skip


def _with_unit(name: str) -> str:
    """Label of an axis for a setting or an answer of a sweep."""
    words = _WORDS.get(name, spaced(name))
    return words[:1].upper() + words[1:] + (f" ({UNITS[name]})" if name in UNITS else "")


def _named_value(name: str, value: Any) -> str:
    """A setting with its value and unit, for a legend."""
    number = f"{value:.4g}" if isinstance(value, float) else f"{value}"
    return f"{spaced(name)} {number}" + (f" {UNITS[name]}" if name in UNITS else "")


@draws(SweepResult)
def plot_sweep(result: SweepResult, quantity: str | None = None, ax: Axes | None = None) -> Axes:
    """One answer of a sweep over its last setting, a line for each combination of the others.

    Parameters
    ----------
    result : SweepResult
    quantity : str, optional
        By default the amplitude, that of the optimum, or else the first answer.
    ax : matplotlib axes, optional

    Returns
    -------
    matplotlib axes
        Points without a value are crosses at the lower edge, in the colour of their line.
    """
    quantity = quantity or next((q for q in (*MAIN, *result.quantities) if q in result.quantities), MAIN[0])
    values = result.array(quantity)
    if values.ndim != len(result.shape) or values.dtype.kind != "f":
        raise SettingError(f"quantity: expected one number for each point, found '{quantity}' of shape {values.shape}")
    name, last = result.names[-1], result.shape[-1]
    x = [point[name] for point in result.points[:last]]
    numeric = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in x)
    rows = values.reshape(-1, last)
    places = x if numeric else [str(value) for value in x]
    none = ~np.isfinite(rows)
    with drawing(ax, legend=7.0 if len(result.shape) > 1 or none.any() else None) as ax:
        for i, (row, colour) in enumerate(zip(rows, colours(len(rows)))):
            others = result.points[i * last]
            label = ", ".join(_named_value(key, others[key]) for key in result.names[:-1])
            ax.plot(places, row, color=colour, marker=MARKERS[i % len(MARKERS)], markersize=3.0, label=label or None)
            if none[i].any():
                lost(ax, [place for place, gone in zip(places, none[i]) if gone], colour)
        if none.any():
            ax.plot([], [], "x", color="0.4", markersize=5.0, label="no value")
        if numeric and min(x) > 0.0 and max(x) > 20.0 * min(x):
            ax.set_xscale("log")
        ax.set(xlabel=_with_unit(name), ylabel=_with_unit(quantity))
    return ax


@draws(UncertainCurve)
def plot_uncertain(
    result: UncertainCurve,
    ax: Axes | None = None,
    *,
    quantity: str = "amplitude",
) -> Axes:
    """Percentile bands of optimal curves over the preload.

    Parameters
    ----------
    result : UncertainCurve
    ax : matplotlib axes, optional
    quantity : {"amplitude", "frequency"}

    Returns
    -------
    matplotlib axes
    """
    with drawing(ax, legend=7.0) as ax:
        for low, high, shade in ((5.0, 95.0, 0.85), (25.0, 75.0, 0.7)):
            edge = result.percentile([low, high], quantity)
            ax.fill_between(result.preload, *edge, color=str(shade), linewidth=0.0, label=f"{low:g} to {high:g} %")
        ax.plot(result.preload, result.percentile(50.0, quantity), color="0.1", label="median")
        scale = "log" if quantity == "amplitude" else "linear"
        ax.set(xscale="log", yscale=scale, xlabel=_with_unit("preload"), ylabel=_with_unit(quantity))
    return ax


@draws(Advice)
def plot_advice(advice: Advice, ax: Axes | None = None, *, title: str = "") -> Axes:
    """Bars of the changes that leaving out single effects makes to a peak.

    Parameters
    ----------
    advice : Advice
    ax : matplotlib axes, optional
    title : str

    Returns
    -------
    matplotlib axes
        Changes of amplitude and frequency in percent, on a scale that is linear within the tolerance and logarithmic
        beyond; names of effects that may be left out together are grey, the tolerance is a grey band, thin lines show what
        an estimate may miss, and a change that is not known is no bar.
    """
    effects = advice.effects[::-1]
    place = np.arange(len(effects))
    tolerance = 100.0 * advice.tolerance
    dark, light = colours(2)
    with drawing(ax, title=title or f"preload {amount(advice.preload, 'N')}, {amount(advice.frequency, 'Hz')}") as ax:
        ax.axvspan(-tolerance, tolerance, color="0.9", zorder=0)
        handles: list[Any] = []
        for values, offset, colour, label in (
            ([e.amplitude_change for e in effects], 0.2, dark, "amplitude"),
            ([e.frequency_change for e in effects], -0.2, light, "frequency"),
        ):
            change = 100.0 * np.nan_to_num(np.array(values, float))
            ax.barh(place + offset, change, height=0.38, facecolor=colour, edgecolor="k", linewidth=0.4)
            missed = np.array([100.0 * e.uncertainty if e.source == "estimated" else 0.0 for e in effects])
            ax.hlines(place + offset, change - missed, change + missed, color="k", linewidth=0.6)
            handles.append(Patch(facecolor=colour, edgecolor="k", linewidth=0.4, label=label))
        ax.set_xscale("symlog", linthresh=tolerance)
        most = np.abs(ax.get_xlim()).max()
        numbers = [tolerance, *(n for n in (10.0, 100.0, 1000.0) if 1.5 * tolerance < n < most)]
        ax.set_xticks([*(-n for n in reversed(numbers)), 0.0, *numbers], minor=False)
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: plain_number(value)))
        ax.set_yticks(place, [e.name for e in effects])
        for y, e, name in zip(place, effects, ax.get_yticklabels()):
            name.set_color("k" if e.called_for else LEFT_OUT)
            if e.source == "unknown":
                ax.text(0.1 * tolerance, float(y), "not known", va="center", fontsize=7.0)
        ax.axvline(0.0, color="k", linewidth=0.6)
        handles.append(Patch(facecolor="0.9", linewidth=0.0, label=f"tolerance, {tolerance:g} %"))
        needed, other = (any(e.called_for == one for e in effects) for one in (True, False))
        handles += [Patch(alpha=0.0, label="black names: needed")] * needed
        handles += [Patch(alpha=0.0, label="grey: all together\nmay be left out")] * other
        ax.set_xlabel("Change of the peak without the effect (%)")
        legend_beside(ax, handles=handles)
    return ax


@draws(Ladder)
def plot_ladder(ladder: Ladder, ax: Axes | None = None, *, title: str = "") -> Axes:
    """Amplitude over the number of harmonics, each point with the processor time that it has taken.

    Parameters
    ----------
    ladder : Ladder
    ax : matplotlib axes, optional
    title : str

    Returns
    -------
    matplotlib axes
        The range of the rungs that are compared is a grey band, the answer a filled point, the tolerance around the richest
        rung dotted; a rung that is not known is a cross at the lower edge.
    """
    known = [r for r in ladder.rungs if r.known]
    low, high = ladder.range
    state = "converged" if ladder.converged else "not converged"
    title = title or f"preload {amount(ladder.preload, 'N')}, {state} to {percent(ladder.tolerance)}"
    with drawing(ax, title=title, legend=7.0) as ax:
        ax.axhspan(low, high, color="0.88", zorder=0, label=f"{amount(low, 'm')} to {amount(high, 'm')}")
        if known:
            edges = [known[-1].amplitude * (1.0 + sign * ladder.tolerance) for sign in (-1.0, 1.0)]
            ax.axhline(edges[0], color="0.4", linewidth=0.8, linestyle=":", label="tolerance around the last")
            ax.axhline(edges[1], color="0.4", linewidth=0.8, linestyle=":")
            ax.plot([r.harmonics for r in known], [r.amplitude for r in known], "-", color="0.6", linewidth=0.8)
        for r in ladder.rungs:
            own = r.harmonics == ladder.answer
            across = "data" if r.known else ax.get_xaxis_transform()
            place = (r.harmonics, r.amplitude if r.known else 0.03)
            face = "k" if own else "w"
            ax.plot(*place, "o" if r.known else "x", color="k", markersize=5.0, markerfacecolor=face,
                    transform=ax.transData if r.known else across, label="answer" if own and r.known else None)  # fmt: skip
            time = f"{r.seconds:.2g} s" if r.seconds else ""
            ax.annotate(
                time + ("" if r.known else " (not known)"), place, xycoords=across, textcoords="offset points",
                xytext=(0, 6), ha="center", fontsize=7.0,
            )  # fmt: skip
        ax.set_xticks([r.harmonics for r in ladder.rungs])
        ax.set(xlabel="Harmonics (beside the points: processor time)", ylabel="Resonance amplitude (m)")
        ax.margins(x=0.2, y=0.25)  # for the times
    return ax


@draws(AccuracyCost)
def plot_accuracy(result: AccuracyCost, ax: Axes | None = None, *, title: str = "", of: str = "peak") -> Axes:
    """Error over time of settings, one at a time below the richest and combined.

    Parameters
    ----------
    result : AccuracyCost
    ax : Axes, optional
    title : str
    of : str
        What the error is of.

    Returns
    -------
    matplotlib axes
        A point for each run, with its value where it is poorer than the reference, the richest, in one setting alone.  The
        time of the reference is a vertical line, since its error is not known; what is not known is a cross at the upper
        edge, what is equal to the reference a triangle at the lower edge.
    """
    best, names = result.recommended, result.varied
    others = ", ".join(spaced(name) for name in names)
    ratio, within = result.richest.seconds / (best.seconds or np.nan), percent(result.tolerance)
    found = "none is faster" if best is result.richest else f"{ratio:.2g} times faster than the reference"
    title = title or f"{others[:1].upper()}{others[1:]}, preload {amount(result.preload, 'N')}\nwithin {within}: {found}"
    handles: dict[str, Any] = {}
    with drawing(ax, size=(5.2, 4.2), title=title) as ax:
        shades = colours(len(names))
        for r in result.runs[1:]:
            k = names.index(r.part) if r.part in names else -1
            look: dict[str, Any] = {"color": shades[k] if k >= 0 else "k", "linestyle": "none"}
            look["markersize"] = 9.0 if r.part == COMBINED else 5.0
            marker = MARKERS[k] if k >= 0 else "*" if r.part == COMBINED else "P"
            handles.setdefault(
                f"{spaced(r.part)} alone, reference {result.richest.values[k]}" if k >= 0 else r.part,
                Line2D([], [], marker=marker, **look),
            )
            place, y = ax.transData, 100.0 * r.error
            if not r.error > EQUAL:
                known = np.isfinite(r.error)
                place, y, marker = ax.get_xaxis_transform(), 0.03 if known else 0.95, "v" if known else "x"
            ax.plot(r.seconds, y, marker, transform=place, **look)
            text = r.values[k].removesuffix(" samples") if k >= 0 else ""
            ax.annotate(text, (r.seconds, y), xycoords=place, textcoords="offset points", xytext=(5, 3), fontsize=6.5,
                        path_effects=[Stroke(linewidth=2.0, foreground="w"), Normal()])  # fmt: skip
            if r is best:
                ring: dict[str, Any] = {"color": "k", "markerfacecolor": "none", "linestyle": "none", "markersize": 12.0}
                ax.plot(r.seconds, y, "o", transform=place, **ring)
                values = "\n".join(f"{spaced(name)} {value}" for name, value in zip(names, r.values))
                handles[f"fastest within {within}:\n{values}"] = Line2D([], [], marker="o", **ring)
        line: dict[str, Any] = {"color": "0.4", "linewidth": 0.9}
        handles["time of the reference"] = ax.axvline(result.richest.seconds, linestyle="-.", **line)
        if result.uncertainty > EQUAL:
            name = f"uncertainty of the reference, {percent(result.uncertainty)}"
            handles[name] = ax.axhline(100.0 * result.uncertainty, linestyle=STYLES[2], **line)
        handles[f"tolerance, {within}"] = ax.axhline(100.0 * result.tolerance, **line)
        ax.set(xscale="log", yscale="log", xlabel="Processor time (s)", ylabel=f"Error of the {of} (%)")
        ax.margins(x=0.12, y=0.12)  # for the names
        ax.legend(handles.values(), handles.keys(), fontsize=7.0, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    return ax
