"""Plots of sweeps, uncertainty, effects, convergence, fits, nonlinear modes and flutter.

:func:`draw_table` plots one column of a result over another one, with labels and units from their
annotated types (:mod:`bdamper.util.tables`).
"""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from bdamper.analyses.accuracy import COMBINED, AccuracyCost
from bdamper.analyses.effect_significance import EffectSignificance
from bdamper.analyses.fit_result import Fitted
from bdamper.analyses.flutter import Flutter
from bdamper.analyses.loop_fit import FittedLoop
from bdamper.analyses.nonlinear_mode import NonlinearMode
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
    legend_beside,
    looks,
    lost,
    name_point,
    note,
    once,
    picture,
    plain_number,
    runs,
    wrapped,
)
from bdamper.response.sensitivity import Sensitivities
from bdamper.response.verification import Convergence
from bdamper.util.errors import SettingError
from bdamper.util.formatting import UNITS, amount, peak_text, percent, spaced
from bdamper.util.records import row_of
from bdamper.util.tables import FEW_ROWS, Tabular, axis_label, quantities

# ---- Design studies ----

HATCHES = ("", "//", "..", "xx", "\\\\")
MAIN = ("amplitude", "optimum_amplitude")
"""Quantities of a sweep that are plotted by default."""
_WORDS = {"amplitude": "resonance amplitude", "frequency": "resonance frequency", "stick": "share of stick",
          "slip": "share of slip", "open": "share of separation"}  # fmt: skip


def _with_unit(name: str) -> str:
    """Return the axis label of a setting or a quantity of a sweep."""
    words = _WORDS.get(name, spaced(name))
    return words[:1].upper() + words[1:] + (f" ({UNITS[name]})" if name in UNITS else "")


@picture(SweepResult)
def plot_sweep(result: SweepResult, quantity: str | None = None, ax: Axes = NEW) -> None:
    """Plot a quantity over the last setting of a sweep, with a line for each other combination.

    Points without a value are crosses at the lower edge, in the colour of their line.

    Parameters
    ----------
    result : SweepResult
    quantity : str, optional
        By default the amplitude, the amplitude of the optimum, or the first quantity of the sweep.
    """
    quantity = quantity or next(
        (q for q in (*MAIN, *result.quantities) if q in result.quantities), MAIN[0]
    )
    values = result.array(quantity)
    if values.ndim != len(result.shape) or values.dtype.kind != "f":
        raise SettingError(
            f"quantity must have one number for each point, '{quantity}' has the shape {values.shape}"
        )
    name, last = result.names[-1], result.shape[-1]
    x = result.points[name][:last].tolist()
    numeric = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in x)
    across = np.array(x if numeric else [str(value) for value in x])
    rows = values.reshape(-1, last)
    for k, row, look in zip(range(0, len(result), last), rows, looks(len(rows))):
        others = row_of(result.points, k)
        ax.plot(
            across,
            row,
            **look,
            label=as_words({key: others[key] for key in result.names[:-1]}) or None,
        )
        lost(ax, across[~np.isfinite(row)], look["color"], "no value")
    if numeric and min(x) > 0.0 and max(x) > 20.0 * min(x):
        ax.set_xscale("log")
    ax.set(xlabel=_with_unit(name), ylabel=_with_unit(quantity))


@picture(OptimalCurveUncertainty)
def plot_optimal_curve_uncertainty(
    result: OptimalCurveUncertainty, ax: Axes = NEW, *, quantity: str = "amplitude"
) -> None:
    """Plot percentile bands of optimal curves over the preload.

    Preloads at which too many draws lack a peak are crosses at the lower edge.

    Parameters
    ----------
    result : OptimalCurveUncertainty
    quantity : {"amplitude", "frequency"}
    """
    bands = {q: result.percentile(q, quantity) for q in (5.0, 25.0, 50.0, 75.0, 95.0)}
    bands = {q: np.where(np.isfinite(values), values, np.nan) for q, values in bands.items()}
    for low, high, shade in ((5.0, 95.0, "0.85"), (25.0, 75.0, "0.7")):
        ax.fill_between(
            result.preload,
            bands[low],
            bands[high],
            color=shade,
            linewidth=0.0,
            label=f"{low:g} to {high:g} %",
        )
    ax.plot(result.preload, bands[50.0], color="0.1", label="median")
    lost(ax, result.preload[np.isnan(bands[95.0])], "0.4", "95 %: no value")
    scale = "log" if quantity == "amplitude" else "linear"
    ax.set(xscale="log", yscale=scale, xlabel=_with_unit("preload"), ylabel=_with_unit(quantity))


@picture(EffectSignificance, size=(COLUMN, 3.2), legend=None)
def plot_effect_significance(advice: EffectSignificance, ax: Axes = NEW) -> None:
    """Plot the change of a peak without each effect as bars.

    Changes of amplitude and frequency are in per cent, on a scale that is linear within the
    tolerance and logarithmic beyond.  The tolerance is a grey band.  Names of effects that may be
    left out together are grey.  Thin lines show the uncertainty of estimates; an unknown change has
    no bar.
    """
    effects = advice.effects[::-1]
    rows, tolerance = np.arange(len(effects)), 100.0 * advice.tolerance
    uncertainty = np.array(
        [100.0 * e.uncertainty if e.source == "estimated" else 0.0 for e in effects]
    )
    handles: list[Any] = []
    for name, offset, colour in zip(("amplitude", "frequency"), (0.2, -0.2), colours(2)):
        change = 100.0 * np.nan_to_num(
            np.array([getattr(e, f"{name}_change") for e in effects], float)
        )
        look = {"facecolor": colour, "edgecolor": "k", "linewidth": 0.4, "label": name}
        handles.append(ax.barh(rows + offset, change, 0.38, **look))
        ax.hlines(
            rows + offset, change - uncertainty, change + uncertainty, color="k", linewidth=0.6
        )
    handles.append(
        ax.axvspan(
            -tolerance, tolerance, color="0.9", zorder=0, label=f"tolerance, {tolerance:g} %"
        )
    )
    ax.set_xscale("symlog", linthresh=tolerance)
    numbers = [
        n for n in (10.0, 100.0, 1000.0) if 4.0 * tolerance < n < np.abs(ax.get_xlim()).max()
    ]
    ax.set_xticks(
        [*(-n for n in reversed(numbers)), -tolerance, 0.0, tolerance, *numbers], minor=False
    )
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: plain_number(value)))
    ax.set_yticks(rows, [e.name for e in effects])
    for y, e, text in zip(rows, effects, ax.get_yticklabels()):
        text.set_color("k" if e.significant else "0.55")
        if e.source == "unknown":
            ax.text(0.1 * tolerance, float(y), "unknown", va="center", fontsize=SMALL)
    ax.axvline(0.0, color="k", linewidth=0.6)
    for significant, name in (
        (True, "black names: needed"),
        (False, "grey: may be left\nout together"),
    ):
        handles += [Patch(alpha=0.0, label=name)] * any(
            e.significant == significant for e in effects
        )
    title = f"preload {amount(advice.preload, 'N')}, {amount(advice.frequency, 'Hz')}"
    ax.set(xlabel="Change of the peak without the effect (%)", title=title)
    legend_beside(ax, handles=handles)


@picture(Sensitivities, size=(COLUMN, 3.0))
def plot_sensitivities(found: Sensitivities, ax: Axes = NEW) -> None:
    """Plot the changes of a peak for one per cent of each parameter as bars, sorted by size.

    Each bar has its number with a sign; an unknown change has no bar.
    """
    changes = {name: 100.0 * np.array(pair) for name, pair in found.changes().items()}
    names = sorted(changes, key=lambda name: np.nan_to_num(abs(changes[name][0]), nan=-1.0))
    rows, known = np.arange(len(names)), np.array([changes[name] for name in names]).reshape(-1, 2)
    for k, (quantity, offset, colour) in enumerate(
        zip(("amplitude", "frequency"), (0.2, -0.2), colours(2))
    ):
        look = {"facecolor": colour, "edgecolor": "k", "linewidth": 0.4, "label": quantity}
        bars = ax.barh(rows + offset, np.nan_to_num(known[:, k]), 0.38, **look)
        texts = [
            f"{x:+.2g}".replace("-", MINUS) if np.isfinite(x) else "unknown" for x in known[:, k]
        ]
        ax.bar_label(bars, texts, padding=2.0, fontsize=SMALL)
    ax.axvline(0.0, color="k", linewidth=0.6)
    ax.margins(x=0.25)
    ax.set_yticks(rows, [wrapped(spaced(name), 18) for name in names])
    ax.set(
        xlabel="Change of the peak (% for +1 %)", title=peak_text(found.amplitude, found.frequency)
    )


@picture(Convergence)
def plot_convergence(convergence: Convergence, ax: Axes = NEW) -> None:
    """Plot the amplitude of a peak over the number of harmonics.

    The filled point is the result, the grey band the range of the settled peaks.  Ticks at the
    upper edge mark harmonics near a mode of the structure with stuck contacts.
    """
    harmonics, amplitude = np.array([(p.harmonics, p.amplitude) for p in convergence.peaks]).T
    low, high = convergence.range
    if low < high:
        ax.axhspan(
            low, high, color="0.9", zorder=0, label=f"{amount(low, 'm')} to {amount(high, 'm')}"
        )
    more = "more harmonics" if len(convergence.peaks) > 1 else None
    ax.plot(
        harmonics, amplitude, "o-", color="0.2", markersize=5.0, markerfacecolor="w", label=more
    )
    ax.plot(harmonics[0], amplitude[0], "o", color="k", markersize=6.0, label="result")
    near = [m.harmonic for m in convergence.internal_resonances if m.harmonic <= harmonics[-1]]
    if near:
        ax.plot(
            near,
            [0.985] * len(near),
            "|",
            color="k",
            transform=ax.get_xaxis_transform(),
            label="near a stuck mode",
        )
    ax.set(xlabel="Highest harmonic", ylabel="Resonance amplitude (m)", xticks=harmonics)
    if len(convergence.peaks) == 1:
        note(ax, convergence._headline(), 0.05)
    state = "converged" if convergence.converged else "not converged"
    ax.set_title(
        f"preload {amount(convergence.preload, 'N')}, {state} to {percent(convergence.tolerance)}"
    )
    ax.margins(y=0.25)


@picture(AccuracyCost, size=(COLUMN, 3.4))
def plot_accuracy(result: AccuracyCost, ax: Axes = NEW, *, of: str = "peak") -> None:
    """Plot the error over processor time for different settings.

    The error of a run is its difference from the reference (the most detailed settings) plus the
    estimated error of the reference.  Runs that differ from the reference in one setting are
    labelled with its value.  An open square is a forecast: settings that were not computed and are
    expected to meet the tolerance.  Crosses at the upper edge are runs of unknown error, triangles
    at the lower edge runs without an error.

    Parameters
    ----------
    result : AccuracyCost
    of : str
        Quantity whose error is plotted.
    """
    best, names, richest = result.recommended, result.varied, result.richest
    points = {
        name: {"color": look["color"], "marker": look["marker"]}
        for name, look in zip(names, looks(len(names)))
    }
    points[COMBINED] = {"color": "k", "marker": "*", "markersize": 9.0}
    none = 1e-12  # relative error below which there is none
    within, line = percent(result.tolerance), dict[str, Any](color="0.4", linewidth=0.9)
    for r in result.runs:
        k = names.index(r.part) if r.part in names else -1
        name = f"{spaced(r.part)} alone, reference {richest.values[k]}" if k >= 0 else r.part
        look = (
            {"color": "k", "marker": "D"} if r is richest else points.get(r.part, points[COMBINED])
        )
        ax.plot(
            [], [], linestyle="none", label=once(ax, "reference" if r is richest else name), **look
        )
        coordinates, y = ax.transData, 100.0 * result.error(r)
        if not result.error(r) > none:
            known, coordinates = bool(np.isfinite(result.error(r))), ax.get_xaxis_transform()
            y, look = 0.03 if known else 0.95, {**look, "marker": "v" if known else "x"}
        ax.plot(r.seconds, y, transform=coordinates, **look)
        if k >= 0:
            name_point(
                ax, r.values[k].removesuffix(" samples"), (r.seconds, y), xycoords=coordinates
            )
        if r is best and result.reached:
            values = "\n".join(f"{spaced(name)} {value}" for name, value in zip(names, best.values))
            ax.plot(r.seconds, y, "ok", transform=coordinates, markerfacecolor="none", markersize=12.0,
                    label=f"fastest within {within}:\n{values}")  # fmt: skip
    if result.forecast is not None:
        settings = result.forecast.settings.replace(", ", "\n")
        ax.plot(result.forecast.seconds, 100.0 * result.forecast.error, "sk", markerfacecolor="none",
                label=f"forecast:\n{settings}")  # fmt: skip
    ax.axhline(100.0 * result.tolerance, label=f"tolerance, {within}", **line)
    ax.set(xscale="log", yscale="log", xlabel="Processor time (s)", ylabel=f"Error of the {of} (%)")
    others = ", ".join(spaced(name) for name in names)
    verdict = f"within {within}: {_saving(result)}" if result.reached else f"{within} not reached"
    ax.set_title(
        f"{others[:1].upper()}{others[1:]}, preload {amount(result.preload, 'N')}\n{verdict}"
    )
    ax.margins(x=0.12, y=0.12)  # for the names


def _saving(result: AccuracyCost) -> str:
    """Return how much faster the recommended settings are."""
    if result.recommended is result.richest:
        return "none is faster"
    ratio = result.richest.seconds / (result.recommended.seconds or np.nan)
    return f"{ratio:.2g} times faster than the reference"


# ---- Columns of a result ----

LOGARITHMIC = ("N", "m", "J")
"""Units with a logarithmic axis, if values are positive and the ratio of the largest to the
smallest exceeds five.
"""


def draw_table(
    ax: Axes, table: Tabular, x: str, y: str, *, rows: Any = slice(None), **style: Any
) -> None:
    """Plot a field or property of a result over another one.

    Existing axis labels are not changed.  Lines do not connect branches.  A known value between two
    unknown ones is a point.  Ratios are in per cent.

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
    values = {
        name: (100.0 if name.endswith("ratio") else 1.0) * np.array(getattr(table, name), float)
        for name in (x, y)
    }
    branch = np.broadcast_to(getattr(table, "branch", 0), values[x].shape)[rows]
    across, up = broken(branch, *(column[rows] for column in values.values()))
    look = {
        "color": "0.1",
        "marker": "o" if len(across) <= FEW_ROWS else "",
        "markersize": 3.5,
        **style,
    }
    ax.plot(across, up, **look)
    known = np.pad(np.isfinite(across + up), 1)
    single = known[1:-1] & ~known[:-2] & ~known[2:]
    if single.any() and not look["marker"]:
        ax.plot(across[single], up[single], ".", color=look["color"])
    kind: Any = type(table)
    for name, axis, scale in ((x, ax.xaxis, ax.set_xscale), (y, ax.yaxis, ax.set_yscale)):
        if not axis.get_label_text():
            axis.set_label_text(axis_label(kind, name, "%" if name.endswith("ratio") else ""))
        mark = quantities(kind).get(name)
        least, most = np.nanmin(values[name], initial=np.inf), np.nanmax(values[name], initial=0.0)
        if mark is not None and mark.unit in LOGARITHMIC and most > 5.0 * least > 0.0:
            scale("log")


# ---- Fits ----


@picture(Fitted, size=(2.0 * COLUMN, 4.2), rows=2)
def plot_fit(result: Fitted, ax: NDArray = NEW) -> None:
    """Plot measured and computed amplitudes, and below them the residuals in units of the noise.

    If the model is right, 95 % of the residuals lie in the grey band from -2 to 2.

    Parameters
    ----------
    result : Fitted
    """
    above, below = ax
    for t, (look, name) in enumerate(zip(looks(len(result.tests)), result.tests)):
        rows = np.flatnonzero(result.test == t)
        rows = rows[np.argsort(result.place[rows])]
        points = look | {"linestyle": "none", "markersize": 4.0, "markerfacecolor": "w"}
        above.plot(
            result.place[rows],
            np.abs(result.model[rows]),
            **look | {"marker": ""},
            label=f"model, {name}",
        )
        above.plot(
            result.place[rows], np.abs(result.measured[rows]), **points, label=f"measured, {name}"
        )
        below.plot(result.place[rows], result.residual[rows, 0], **points)
    below.axhspan(
        -2.0, 2.0, color="0.9", zorder=0, label="95 % of the residuals if the model is right"
    )
    above.set(yscale="log", ylabel="Response amplitude (m)")
    below.set(xlabel="Frequency (Hz)", ylabel="Residual / noise")


@picture(Fitted, "information", size=(COLUMN, 2.0))
def plot_information(result: Fitted, ax: Axes = NEW) -> None:
    """Plot the share of each test in the information about each parameter.

    Parameters
    ----------
    result : Fitted
    """
    rows, shares = np.arange(len(result.names))[::-1], 100.0 * result.information.T
    bars = zip(
        result.tests,
        shares,
        np.cumsum(shares, axis=0) - shares,
        colours(len(shares)),
        cycle(HATCHES),
    )
    for name, share, left, colour, hatch in bars:
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
    """Plot a measured loop of force over displacement with the fitted loop of the sliders.

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
    """Plot frequency and damping ratio of a nonlinear mode over the response amplitude.

    Circles are folds of the amplitude.  Lines are dashed where the motion no longer resembles the
    mode.

    Parameters
    ----------
    mode : NonlinearMode
    style
        Line options of matplotlib's ``plot``.
    """
    folds: dict[str, Any] = {
        "linestyle": "",
        "marker": "o",
        "color": "k",
        "markersize": 3.0,
        "markerfacecolor": "w",
    }
    for axes, name in zip(ax, ("frequency", "damping_ratio")):
        for first, last in runs(mode.correlation < 0.5):
            line = {
                "color": "0.1",
                "marker": "",
                "linestyle": DASHED if mode.correlation[first] < 0.5 else "-",
                **style,
            }
            draw_table(
                axes, mode, "amplitude", name, rows=slice(first, last + 2), **line
            )  # joined to the next stretch
        draw_table(axes, mode, "amplitude", name, rows=mode.folds, **folds)
    ax[0].set(xlabel="", title=f"mode {mode.mode}, preload {amount(mode.preload, 'N')}")


@picture(Flutter)
def plot_flutter(flutter: Flutter, ax: Axes = NEW) -> None:
    """Plot limit cycles over the preload: filled if stable, open if unstable.

    Crosses at the lower edge mark preloads where the state at rest is unstable.
    """
    diameters, cycle, stable = (
        np.unique(flutter.nodal_diameter),
        flutter.amplitude > 0.0,
        flutter.stable,
    )
    for d, look in zip(diameters, looks(len(diameters))):
        at_d = flutter.nodal_diameter == d
        for part, face, name in (
            (cycle & stable, look["color"], "stable"),
            (cycle & ~stable, "w", "unstable"),
        ):
            if not (at_d & part).any():
                continue
            look |= {
                "linestyle": "",
                "markerfacecolor": face,
                "label": f"{name}, nodal diameter {d}",
            }
            draw_table(ax, flutter, "preload", "amplitude", rows=at_d & part, **look)
        lost(ax, flutter.preload[at_d & ~cycle & ~stable], look["color"], "unstable at rest", 4.0)
    if not cycle.any():
        note(ax, flutter._headline())
    ax.set(
        yscale="log",
        xscale="log" if 0.0 < flutter.preload.min() < flutter.preload.max() else "linear",
    )
    ax.set(xlabel=axis_label(Flutter, "preload"), ylabel="Amplitude of the limit cycle (m)")
