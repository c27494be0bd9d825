"""Design studies, and what settings change: sweeps, samples, advice, accuracy over time.

Columns of a result over another column, with labels and units by their annotated types (:mod:`bdamper.util.tables`).

Fits of measured responses and loops.

Nonlinear modes and limit cycles: frequency and damping over amplitude.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from bdamper.analyses.accuracy import COMBINED, AccuracyCost
from bdamper.analyses.effect_significance import EffectSignificance
from bdamper.analyses.fit import Fitted
from bdamper.analyses.flutter import Flutter
from bdamper.analyses.loop_fit import FittedLoop
from bdamper.analyses.nonlinear_mode import NonlinearMode
from bdamper.analyses.robust_optimum import OptimalCurveUncertainty
from bdamper.analyses.sweep import SweepResult, as_words
from bdamper.plot.axes import DASHED, MARKERS, NEW, colours, legend_beside, looks, lost, once, picture, plain_number, runs
from bdamper.response.verification import Convergence
from bdamper.util.errors import SettingError
from bdamper.util.formatting import UNITS, amount, percent, spaced
from bdamper.util.tables import FEW_ROWS, Tabular, axis_label, quantities

# ---- Design studies, and what settings change ----


MAIN = ("amplitude", "optimum_amplitude")
"""Answers of a sweep that are drawn unless others are asked for."""
_WORDS = {"amplitude": "resonance amplitude", "frequency": "resonance frequency", "stick": "share of stick",
          "slip": "share of slip", "open": "share of separation"}  # fmt: skip


def _with_unit(name: str) -> str:
    """Label of an axis for a setting or an answer of a sweep."""
    words = _WORDS.get(name, spaced(name))
    return words[:1].upper() + words[1:] + (f" ({UNITS[name]})" if name in UNITS else "")


@picture(SweepResult)
def plot_sweep(result: SweepResult, quantity: str | None = None, ax: Axes = NEW) -> None:
    """One answer of a sweep over its last setting, a line for each combination of the others.

    Points without a value are crosses at the lower edge, in the colour of their line.

    Parameters
    ----------
    result : SweepResult
    quantity : str, optional
        By default the amplitude, that of the optimum, or else the first answer.
    """
    quantity = quantity or next((q for q in (*MAIN, *result.quantities) if q in result.quantities), MAIN[0])
    values = result.array(quantity)
    if values.ndim != len(result.shape) or values.dtype.kind != "f":
        raise SettingError(f"quantity: expected one number for each point, found '{quantity}' of shape {values.shape}")
    name, last = result.names[-1], result.shape[-1]
    x = [point[name] for point in result.points[:last]]
    numeric = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in x)
    places = np.array(x if numeric else [str(value) for value in x])
    rows = values.reshape(-1, last)
    for others, row, look in zip(result.points[::last], rows, looks(len(rows))):
        ax.plot(places, row, **look, label=as_words({key: others[key] for key in result.names[:-1]}) or None)
        lost(ax, places[~np.isfinite(row)], look["color"], "no value")
    if numeric and min(x) > 0.0 and max(x) > 20.0 * min(x):
        ax.set_xscale("log")
    ax.set(xlabel=_with_unit(name), ylabel=_with_unit(quantity))


@picture(OptimalCurveUncertainty)
def plot_optimal_curve_uncertainty(result: OptimalCurveUncertainty, ax: Axes = NEW, *, quantity: str = "amplitude") -> None:
    """Percentile bands of optimal curves over the preload.

    Parameters
    ----------
    result : OptimalCurveUncertainty
    quantity : {"amplitude", "frequency"}
    """
    for low, high, shade in ((5.0, 95.0, "0.85"), (25.0, 75.0, "0.7")):
        edges = result.percentile([low, high], quantity)
        ax.fill_between(result.preload, *edges, color=shade, linewidth=0.0, label=f"{low:g} to {high:g} %")
    ax.plot(result.preload, result.percentile(50.0, quantity), color="0.1", label="median")
    scale = "log" if quantity == "amplitude" else "linear"
    ax.set(xscale="log", yscale=scale, xlabel=_with_unit("preload"), ylabel=_with_unit(quantity))


@picture(EffectSignificance, legend=None)
def plot_effect_significance(advice: EffectSignificance, ax: Axes = NEW) -> None:
    """Bars of the changes that leaving out single effects makes to a peak.

    Changes of amplitude and frequency in per cent, on a scale that is linear within the tolerance and logarithmic beyond;
    names of effects that may be left out together are grey, the tolerance is a grey band, thin lines show what an estimate
    may miss, and a change that is not known is no bar.
    """
    effects = advice.effects[::-1]
    place, tolerance = np.arange(len(effects)), 100.0 * advice.tolerance
    missed = np.array([100.0 * e.uncertainty if e.source == "estimated" else 0.0 for e in effects])
    handles: list[Any] = []
    for name, offset, colour in zip(("amplitude", "frequency"), (0.2, -0.2), colours(2)):
        change = 100.0 * np.nan_to_num(np.array([getattr(e, f"{name}_change") for e in effects], float))
        look = {"facecolor": colour, "edgecolor": "k", "linewidth": 0.4, "label": name}
        handles.append(ax.barh(place + offset, change, 0.38, **look))
        ax.hlines(place + offset, change - missed, change + missed, color="k", linewidth=0.6)
    handles.append(ax.axvspan(-tolerance, tolerance, color="0.9", zorder=0, label=f"tolerance, {tolerance:g} %"))
    ax.set_xscale("symlog", linthresh=tolerance)
    numbers = [n for n in (10.0, 100.0, 1000.0) if 1.5 * tolerance < n < np.abs(ax.get_xlim()).max()]
    ax.set_xticks([*(-n for n in reversed(numbers)), -tolerance, 0.0, tolerance, *numbers], minor=False)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: plain_number(value)))
    ax.set_yticks(place, [e.name for e in effects])
    left_out = "0.55"  # colour of the name of an effect that may be left out
    for y, e, text in zip(place, effects, ax.get_yticklabels()):
        text.set_color("k" if e.significant else left_out)
        if e.source == "unknown":
            ax.text(0.1 * tolerance, float(y), "not known", va="center", fontsize=7.0)
    ax.axvline(0.0, color="k", linewidth=0.6)
    for significant, said in ((True, "black names: needed"), (False, "grey: all together\nmay be left out")):
        handles += [Patch(alpha=0.0, label=said)] * any(e.significant == significant for e in effects)
    title = f"preload {amount(advice.preload, 'N')}, {amount(advice.frequency, 'Hz')}"
    ax.set(xlabel="Change of the peak without the effect (%)", title=title)
    legend_beside(ax, handles=handles)


@picture(Convergence)
def plot_convergence(convergence: Convergence, ax: Axes = NEW) -> None:
    """Amplitude of a peak over the number of harmonics.

    The answer is a filled point, the range of the settled peaks a grey band.  Ticks at the upper edge mark harmonics that
    are near a mode of the structure with stuck contacts.
    """
    harmonics, amplitude = np.array([(p.harmonics, p.amplitude) for p in convergence.peaks]).T
    low, high = convergence.range
    ax.axhspan(low, high, color="0.9", zorder=0, label=f"{amount(low, 'm')} to {amount(high, 'm')}")
    ax.plot(harmonics, amplitude, "o-", color="0.2", markersize=5.0, markerfacecolor="w", label="amplitude")
    ax.plot(harmonics[0], amplitude[0], "o", color="k", markersize=6.0, label="answer")
    met = [m.harmonic for m in convergence.internal_resonances if m.harmonic <= harmonics[-1]]
    if met:
        ax.plot(met, [0.985] * len(met), "|", color="k", transform=ax.get_xaxis_transform(), label="near a stuck mode")
    ax.set(xlabel="Highest harmonic", ylabel="Resonance amplitude (m)", xticks=harmonics)
    state = "converged" if convergence.converged else "not converged"
    ax.set_title(f"preload {amount(convergence.preload, 'N')}, {state} to {percent(convergence.tolerance)}")
    ax.margins(y=0.25)


@picture(AccuracyCost, size=(5.2, 4.2), legend=None)
def plot_accuracy(result: AccuracyCost, ax: Axes = NEW, *, of: str = "peak") -> None:
    """Error over time of settings, one at a time below the richest and combined.

    A point for each run, with its value where it is poorer than the reference, the richest, in one setting alone.  The
    time of the reference is a vertical line, since its error is not known; what is not known is a cross at the upper edge,
    what is equal to the reference a triangle at the lower edge.

    Parameters
    ----------
    result : AccuracyCost
    of : str
        What the error is of.
    """
    best, names, richest = result.recommended, result.varied, result.richest
    points = {name: {"color": look["color"], "marker": look["marker"]} for name, look in zip(names, looks(len(names)))}
    points[COMBINED] = {"color": "k", "marker": "*", "markersize": 9.0}
    equal = 1e-12  # relative difference below which two answers are the same
    within, line = percent(result.tolerance), dict[str, Any](color="0.4", linewidth=0.9)
    for r in result.runs[1:]:
        k = names.index(r.part) if r.part in names else -1
        name = f"{spaced(r.part)} alone, reference {richest.values[k]}" if k >= 0 else r.part
        look = points.get(r.part, points[COMBINED])
        ax.plot([], [], linestyle="none", label=once(ax, name), **look)
        place, y = ax.transData, 100.0 * r.error
        if not r.error > equal:
            known = bool(np.isfinite(r.error))
            place, y, look = ax.get_xaxis_transform(), 0.03 if known else 0.95, {**look, "marker": "v" if known else "x"}
        ax.plot(r.seconds, y, transform=place, **look)
        if k >= 0:
            ax.annotate(r.values[k].removesuffix(" samples"), (r.seconds, y), xycoords=place, xytext=(5, 3),
                        textcoords="offset points", fontsize=6.5)  # fmt: skip
        if r is best:
            values = "\n".join(f"{spaced(name)} {value}" for name, value in zip(names, best.values))
            ax.plot(r.seconds, y, "ok", transform=place, markerfacecolor="none", markersize=12.0,
                    label=f"fastest within {within}:\n{values}")  # fmt: skip
    ax.axvline(richest.seconds, linestyle="-.", label="time of the reference", **line)
    ax.axhline(100.0 * result.tolerance, label=f"tolerance, {within}", **line)
    ratio, others = richest.seconds / (best.seconds or np.nan), ", ".join(spaced(name) for name in names)
    found = "none is faster" if best is richest else f"{ratio:.2g} times faster than the reference"
    title = f"{others[:1].upper()}{others[1:]}, preload {amount(result.preload, 'N')}\nwithin {within}: {found}"
    ax.set(xscale="log", yscale="log", xlabel="Processor time (s)", ylabel=f"Error of the {of} (%)", title=title)
    ax.margins(x=0.12, y=0.12)  # for the names
    ax.legend(fontsize=7.0, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)


# ---- Columns of a result over another column, with labels and units by their annotated types ( ----


LOGARITHMIC = ("N", "m", "J")
"""Units of which axes are logarithmic where the values are positive and the largest is more than five times the least."""


def draw_table(ax: Axes, table: Tabular, x: str, y: str, *, rows: Any = slice(None), **style: Any) -> None:
    """Draw a field or property of a result over another one.

    Axes that have labels keep them.  No line leads from one branch to another, and a value between two that are not known
    is a point.  A ratio is shown in per cent.

    Parameters
    ----------
    ax : matplotlib axes
    table : Tabular
    x, y : str
    rows : index
        Of those that are drawn.
    style
        Of the line, as matplotlib's ``plot`` takes it.
    """
    values = {name: (100.0 if name.endswith("ratio") else 1.0) * np.array(getattr(table, name), float) for name in (x, y)}
    branch = np.broadcast_to(getattr(table, "branch", 0), values[x].shape)[rows]
    apart = np.flatnonzero(np.diff(branch)) + 1
    across, up = (np.insert(column[rows], apart, np.nan) for column in values.values())
    look = {"color": "0.1", "marker": "o" if len(across) <= FEW_ROWS else "", "markersize": 3.5, **style}
    ax.plot(across, up, **look)
    known = np.isfinite(across + up)
    beside = np.concatenate([[False], known, [False]])
    alone = known & ~beside[:-2] & ~beside[2:]
    if alone.any() and not look["marker"]:
        ax.plot(across[alone], up[alone], ".", color=look["color"])
    kind: Any = type(table)
    for name, axis, scale in ((x, ax.xaxis, ax.set_xscale), (y, ax.yaxis, ax.set_yscale)):
        if not axis.get_label_text():
            axis.set_label_text(axis_label(kind, name, "%" if name.endswith("ratio") else ""))
        mark = quantities(kind).get(name)
        least, most = np.nanmin(values[name], initial=np.inf), np.nanmax(values[name], initial=0.0)
        if mark is not None and mark.unit in LOGARITHMIC and most > 5.0 * least > 0.0:
            scale("log")


# ---- Fits of measured responses and loops ----


@picture(Fitted, size=(6.0, 5.2), rows=2)
def plot_fit(result: Fitted, ax: NDArray = NEW) -> None:
    """Measured amplitudes with those of the model, and below them the residuals in units of the noise.

    Grey between -2 and 2 in the lower picture: where 95 % of the points lie if the model is right.

    Parameters
    ----------
    result : Fitted
    """
    above, below = ax
    for t, (colour, name) in enumerate(zip(colours(len(result.tests)), result.tests)):
        rows = np.flatnonzero(result.test == t)
        rows = rows[np.argsort(result.place[rows])]
        marker = MARKERS[t % len(MARKERS)]
        look = {"linestyle": "none", "marker": marker, "markersize": 3.0, "color": colour}
        above.plot(result.place[rows], np.abs(result.measured[rows]), markerfacecolor="none", **look, label=name)
        above.plot(result.place[rows], np.abs(result.model[rows]), color=colour)
        below.plot(result.place[rows], result.residual[rows, 0], **look)
    below.axhspan(-2.0, 2.0, color="0.9", zorder=0)
    above.plot([], [], color="k", label="model")
    above.set(yscale="log", ylabel="Response amplitude (m)")
    below.set(xlabel="Frequency (Hz)", ylabel="Residual of the amplitude\nover the noise")


@picture(Fitted, "information", size=(5.6, 3.2))
def plot_information(result: Fitted, ax: Axes = NEW) -> None:
    """Shares of the tests in the information about each parameter.

    Parameters
    ----------
    result : Fitted
    """
    place, left = np.arange(len(result.names))[::-1], np.zeros(len(result.names))
    hatches = ("", "//", "..", "xx", "\\\\")
    for t, (colour, name) in enumerate(zip(colours(len(result.tests)), result.tests)):
        share = 100.0 * result.information[:, t]
        look = {"facecolor": colour, "edgecolor": "w", "linewidth": 0.5, "hatch": hatches[t % len(hatches)]}
        ax.barh(place, share, left=left, label=name, **look)
        left = left + share
    ax.set_yticks(place, [spaced(name) for name in result.names])
    ax.set(xlabel="Share of what is known of the parameter (%)", xlim=(0.0, 100.0))


@picture(FittedLoop, size=(4.4, 3.6))
def plot_loop(result: FittedLoop, ax: Axes = NEW) -> None:
    """Measured force over displacement with the loop of the sliders that was found.

    Parameters
    ----------
    result : FittedLoop
    """
    ax.plot(result.displacement, result.force, "o", color="0.3", markersize=3.0, markerfacecolor="none", label="measured")
    ax.plot(result.displacement, result.model, color="k", label=f"{result.sliders} sliders")
    ax.set(xlabel="Displacement (m)", ylabel="Force (N)")


# ---- Nonlinear modes and limit cycles ----


@picture(NonlinearMode, size=(5.6, 4.8), rows=2)
def plot_nonlinear_mode(mode: NonlinearMode, ax: NDArray = NEW, **style: Any) -> None:
    """Frequency and damping of a nonlinear mode over the amplitude of the response, in two axes.

    Circles are folds, where the amplitude turns; lines are dashed where the motion is no longer that of the mode.

    Parameters
    ----------
    mode : NonlinearMode
    style
        Of the lines, as matplotlib's ``plot`` takes it.
    """
    folds: dict[str, Any] = {"linestyle": "", "marker": "o", "color": "k", "markersize": 3.0, "markerfacecolor": "w"}
    for axes, name in zip(ax, ("frequency", "damping_ratio")):
        for first, last in runs(mode.correlation < 0.5):
            line = {"color": "C0", "marker": "", "linestyle": DASHED if mode.correlation[first] < 0.5 else "-", **style}
            draw_table(axes, mode, "amplitude", name, rows=slice(first, last + 2), **line)  # joined to the next stretch
        draw_table(axes, mode, "amplitude", name, rows=mode.folds, **folds)
    ax[0].set(xlabel="", title=f"mode {mode.mode}, preload {amount(mode.preload, 'N')}")


@picture(Flutter)
def plot_flutter(flutter: Flutter, ax: Axes = NEW) -> None:
    """Limit cycles over the preload: filled where they are stable, open where starts beyond them grow.

    Crosses at the lower edge: rest is unstable there.
    """
    diameters, cycle, stable = np.unique(flutter.nodal_diameter), flutter.amplitude > 0.0, flutter.stable
    for d, look in zip(diameters, looks(len(diameters))):
        own = flutter.nodal_diameter == d
        for part, face, what in ((cycle & stable, look["color"], "stable"), (cycle & ~stable, "w", "unstable")):
            look |= {"linestyle": "", "markerfacecolor": face, "label": f"{what}, nodal diameter {d}"}
            draw_table(ax, flutter, "preload", "amplitude", rows=own & part, **look)
        lost(ax, flutter.preload[own & ~cycle & ~stable], look["color"], "rest unstable", 4.0)
    ax.set(yscale="log", xscale="log" if flutter.preload.min() > 0.0 else "linear")
