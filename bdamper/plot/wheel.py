"""Whole wheels: deviations and amplitudes of the blades, envelopes, statistics of many wheels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.model.model import Model, turn
from bdamper.plot.axes import MARKERS, STYLES, band, colours, drawing, limit_line, lost, over_preload
from bdamper.plot.vtu import shown_shapes
from bdamper.util import validate
from bdamper.util.errors import BdamperError
from bdamper.util.plotting import draws
from bdamper.util.status import HELD
from bdamper.util.tables import label
from bdamper.util.text import amount
from bdamper.wheel.kept import WheelKept
from bdamper.wheel.mistuning import Mistuning
from bdamper.wheel.optimal import WheelOptimalCurve
from bdamper.wheel.results import WheelCurve, WheelPeak
from bdamper.wheel.sample_result import MistunedSample

PERCENTILES = (50.0, 95.0)
_FACTOR = "Amplification of the worst blade"


@draws(Mistuning)
def plot_mistuning(mistuning: Mistuning, ax: Axes | None = None, *, title: str = "") -> Axes:
    """Bars of the frequency deviation of every blade, side by side where its modes differ.

    Parameters
    ----------
    mistuning : Mistuning
    ax : matplotlib axes, optional
    title : str

    Returns
    -------
    matplotlib axes
    """
    values = 100.0 * mistuning.deviation.reshape(mistuning.n_blades, -1)
    n = values.shape[1]
    with drawing(ax, title=title, legend=7.0 if n > 1 else None) as ax:
        for k, (column, colour) in enumerate(zip(values.T, colours(n))):
            place = np.arange(mistuning.n_blades) + (k - 0.5 * (n - 1)) * 0.8 / n
            ax.bar(place, column, width=0.8 / n, color=colour, edgecolor="k", linewidth=0.3, label=f"mode {k + 1}")
        ax.axhline(0.0, color="k", linewidth=0.6)
        ax.set(xlabel="Blade", ylabel="Frequency deviation (%)")
    return ax


@draws(WheelCurve)
def plot_wheel_curve(curve: WheelCurve, ax: Axes | None = None, *, tuned: Curve | None = None, title: str = "") -> Axes:
    """Envelope over all blades through the folds, above the curves of the single blades.

    Parameters
    ----------
    curve : WheelCurve
    ax : matplotlib axes, optional
    tuned : Curve, optional
        Of the tuned wheel at the same preload, ``wheel.tuned().track(...)``: a thin line that bears its name.
    title : str

    Returns
    -------
    matplotlib axes
    """
    _, blade = curve.highest
    with drawing(ax, title=title or f"{amount(curve.preload, 'N')}, {curve.response.shape[1]} blades", legend=7.0) as ax:
        apart = np.flatnonzero(np.diff(curve.branch)) + 1  # no line from branch to branch
        frequency, amplitude = np.insert(curve.frequency, apart, np.nan), np.insert(curve.amplitude, apart, np.nan, axis=0)
        lines = ax.plot(frequency, amplitude, color="0.75", linewidth=0.5)
        lines[0].set_label("single blades")
        ax.plot(frequency, amplitude[:, blade], color=colours(3)[1], linewidth=0.9, label=f"blade {blade}")
        ax.plot(frequency, amplitude.max(axis=1), color="k", label="highest blade")
        if len(curve.folds):
            at = curve.folds
            ax.plot(curve.frequency[at], curve.envelope[at], "o", color="k", markersize=3.0, label="fold")
        if tuned is not None and len(tuned):
            limit_line(ax, "tuned", tuned.frequency, tuned.amplitude, tuned.peak.frequency)
        ax.set(xlabel=label(WheelCurve, "frequency"), ylabel="Amplitude (m)")
    return ax


def _on_a_grid(curve: WheelCurve, n: int) -> tuple[NDArray, NDArray]:
    """Frequencies (n,) and the amplitudes there (n, n_blades), of the highest solution where there are several."""
    grid = np.linspace(curve.frequency.min(), curve.frequency.max(), n)
    out = np.full((n, curve.response.shape[1]), np.nan)
    for a, b, low, high in zip(curve.frequency, curve.frequency[1:], curve.amplitude, curve.amplitude[1:]):
        inside = (grid >= min(a, b)) & (grid <= max(a, b))
        share = ((grid[inside] - a) / (b - a))[:, None] if a != b else np.zeros((inside.sum(), 1))
        values = low + share * (high - low)
        higher = ~(values.max(axis=1) <= out[inside].max(axis=1, initial=-np.inf))
        out[inside] = np.where(higher[:, None], values, out[inside])
    return grid, out


@draws(WheelCurve, "plot_map")
def plot_wheel_map(curve: WheelCurve, ax: Axes | None = None, *, title: str = "") -> Axes:
    """Amplitude of every blade over frequency as a map, light where it is high.

    Parameters
    ----------
    curve : WheelCurve
    ax : matplotlib axes, optional
    title : str

    Returns
    -------
    matplotlib axes
        Of several solutions at one frequency the one with the highest blade is shown; a circle marks the highest of all.
    """
    i, blade = curve.highest
    frequency, amplitude = _on_a_grid(curve, 400)
    with drawing(ax, title=title or amount(curve.preload, "N")) as ax:
        ax.grid(False)
        edges = np.arange(amplitude.shape[1] + 1) - 0.5
        step = 0.5 * (frequency[1] - frequency[0])
        across = np.append(frequency - step, frequency[-1] + step)
        image = ax.pcolormesh(across, edges, amplitude.T, cmap="viridis", vmin=0.0, rasterized=True)
        circle: dict[str, Any] = {"markersize": 8.0, "markerfacecolor": "none", "color": "w", "markeredgewidth": 1.5}
        ax.plot(curve.frequency[i], blade, "o", **circle, clip_on=False)
        figure: Any = ax.figure
        figure.colorbar(image, ax=ax, label="Amplitude (m)")
        ax.set(xlabel=label(WheelCurve, "frequency"), ylabel=label(WheelCurve, "blade"))
    return ax


@draws(WheelPeak)
def plot_wheel_peak(peak: WheelPeak, ax: Axes | None = None, *, title: str = "") -> Axes:
    """Bars of the amplitudes of all blades at the highest peak, the tuned peak as a line, the highest blade dark.

    Parameters
    ----------
    peak : WheelPeak
    ax : matplotlib axes, optional
    title : str

    Returns
    -------
    matplotlib axes
    """
    if not peak.found:
        raise BdamperError(f"picture of a peak: expected a converged one, found {peak.status} ({peak.reason})")
    title = title or f"{amount(peak.preload, 'N')}, {peak.frequency:.5g} Hz, amplification factor {peak.amplification:.3f}"
    title += "" if peak.converged else ", dampers held" if peak.springs else f", {peak.status}"
    with drawing(ax, title=title, legend=7.0) as ax:
        shade = np.where(np.arange(len(peak.amplitudes)) == peak.blade, "0.15", "0.65")
        ax.bar(np.arange(len(peak.amplitudes)), peak.amplitudes, color=shade, edgecolor="k", linewidth=0.3)
        ax.axhline(peak.tuned_amplitude, color="k", linewidth=1.0, label="tuned peak")
        ax.set(xlabel="Blade", ylabel="Amplitude (m)")
    return ax


@draws(WheelKept)
def plot_wheel_kept(kept: WheelKept, ax: Axes | None = None, *, title: str = "") -> Axes:
    """Bars of what all blades keep, with the range of the last periods, and the peak of the harmonic balance as a line."""
    title = title or f"Peak of blade {kept.blade}{'' if kept.mean > 0.0 else ' not'} kept, {amount(kept.preload, 'N')}"
    with drawing(ax, title=title, legend=7.0) as ax:
        mean = kept.blades.mean(axis=0)
        shade = np.where(np.arange(len(mean)) == kept.blade, "0.15", "0.65")
        bars = [mean - kept.blades.min(axis=0), kept.blades.max(axis=0) - mean]
        ax.bar(np.arange(len(mean)), mean, yerr=bars, color=shade, edgecolor="k", linewidth=0.3, capsize=2.0, ecolor="0.4")
        ax.axhline(kept.balance, color="k", linewidth=1.0, label="harmonic balance")
        ax.set(xlabel="Blade", ylabel="Amplitude in time, mean and range (m)")
    return ax


@draws(WheelPeak, "plot_wheel")
def plot_wheel(peak: WheelPeak, model: Model, ax: Axes | None = None, *, mode: int = 1, title: str = "") -> Axes:
    """The wheel from the front, blades coloured by their amplitude at the highest peak; the number of the highest is bold.

    Parameters
    ----------
    peak : WheelPeak
    model : Model
        Of the wheel, with a surface of the blade that carries mode shapes.
    ax : matplotlib axes, optional
    mode : int
        Of the tuned wheel, from 1, whose shape spreads the amplitude over each blade.
    title : str

    Returns
    -------
    matplotlib axes
    """
    if not peak.found or len(peak.amplitudes) != model.n_blades:
        found = f"{peak.status}, {len(peak.response)} blades"
        raise BdamperError(f"picture of a wheel: expected a converged peak of {model.n_blades} blades, found {found}")
    body, d = shown_shapes(model, None, None, "picture of a wheel")
    mesh = model.meshes[body]
    mode = validate.whole("mode", mode, least=1, most=mesh.modes[d].shape[2])
    shape = np.linalg.norm(np.abs(mesh.modes[d][..., mode - 1]), axis=1)[mesh.quads].mean(axis=1)
    turns = [turn(2.0 * np.pi * k / model.n_blades) for k in range(model.n_blades)]
    faces = np.concatenate([(mesh.points @ t.T)[mesh.quads] for t in turns])
    front = np.argsort(faces[..., 2].mean(axis=1))
    top = f"blade {peak.blade} highest, {amount(peak.amplitude, 'm')}"
    title = title or f"{amount(peak.preload, 'N')}, {peak.frequency:.5g} Hz, {top}"
    with drawing(ax, size=(5.6, 4.4), title=title) as ax:
        seen = PolyCollection(list(faces[front, :, :2]), cmap="viridis", edgecolors="face", linewidths=0.3, rasterized=True)
        seen.set_array(np.outer(peak.amplitudes, shape / shape.max()).ravel()[front])
        seen.set_clim(0.0, peak.amplitude)
        ax.add_collection(seen)
        reach = 1.07 * np.linalg.norm(mesh.points[:, :2], axis=1).max()
        for k in {*range(0, model.n_blades, 10), peak.blade}:
            x, y = reach * (turns[k] @ [0.0, 1.0, 0.0])[:2]
            weight = "bold" if k == peak.blade else "normal"
            ax.text(x, y, str(k), ha="center", va="center", fontsize=7.0, weight=weight, clip_on=False)
        ax.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach))
        ax.set_axis_off()
        figure: Any = ax.figure
        figure.colorbar(seen, ax=ax, label="Amplitude (m)", shrink=0.8)
    return ax


def _of(sample: MistunedSample, i: int, n: int) -> str:
    return f"{n} wheels, blade frequencies {100.0 * sample.standard_deviation[i]:g} % (standard deviation)"


@draws(MistunedSample)
def plot_sample(
    sample: MistunedSample, ax: Axes | None = None, *, percentiles: Sequence[float] = PERCENTILES, title: str = ""
) -> Axes:
    """Percentiles of the amplification factor over the standard deviation of mistuning, a colour for each preload.

    A sample of one standard deviation is drawn over the preload (:func:`plot_sample_preload`).

    Parameters
    ----------
    sample : MistunedSample
    ax : matplotlib axes, optional
    percentiles : sequence of float
        Up to four, the last one with its confidence interval of 95 %, as far as the sample bounds it.
    title : str

    Returns
    -------
    matplotlib axes
    """
    if len(sample.standard_deviation) == 1:
        return plot_sample_preload(sample, ax=ax, quantity="amplification", percentiles=percentiles, title=title)
    styles = STYLES[3::-1]
    x = 100.0 * sample.standard_deviation
    bands = {q: sample.percentile(q) for q in percentiles[-len(styles) :]}
    with drawing(ax, title=title or f"{len(sample)} wheels", legend=7.0) as ax:
        for j, (preload, colour) in enumerate(zip(sample.preload, colours(len(sample.preload)))):
            for k, (q, (low, value, high)) in enumerate(bands.items()):
                last = k == len(bands) - 1
                marker = MARKERS[j % len(MARKERS)] if last else ""
                line = {"color": colour, "linestyle": styles[k - len(bands)], "marker": marker, "markersize": 4.0}
                ax.plot(x, value[:, j], **line, label=amount(float(preload), "N") if last else None)
                if last:
                    band(ax, x, low[:, j], high[:, j], colour)
        for k, q in enumerate(bands):
            ax.plot([], [], color="0.3", linestyle=styles[k - len(bands)], label=f"{q:g} % of wheels")
        if sample.held:
            ax.plot([], [], " ", label=f"dampers held: {100.0 * sample.held:.0f} % of peaks")
        ax.set(xlabel="Standard deviation of blade frequencies (%)", ylabel=_FACTOR)
    return ax


@draws(MistunedSample, "plot_tail")
def plot_sample_tail(
    sample: MistunedSample,
    standard_deviation: float | None = None,
    preload: float | None = None,
    ax: Axes | None = None,
    *,
    tail: float = 0.5,
    title: str = "",
) -> Axes:
    """Histogram of the amplification factors of one cell, with the Weibull distribution fitted to its tail.

    Parameters
    ----------
    sample : MistunedSample
    standard_deviation, preload : float, optional
        Of the cell; the last ones by default.
    ax : matplotlib axes, optional
    tail : float
        Share of the wheels that the fit sees.
    title : str

    Returns
    -------
    matplotlib axes
        The 95th percentile has its confidence interval, to the edge where the sample does not bound it.
    """
    i, j = sample.cell(standard_deviation, preload)
    x = sample.amplification[:, i, j]
    x = x[np.isfinite(x)]
    fit = sample.tail(float(sample.standard_deviation[i]), float(sample.preload[j]), tail)
    title = title or f"{_of(sample, i, len(x))}, {amount(float(sample.preload[j]), 'N')}"
    with drawing(ax, title=title, legend=7.0) as ax:
        _, edges, _ = ax.hist(x, bins="doane", color="0.8", edgecolor="0.4", linewidth=0.6, label="wheels")
        at = np.linspace(fit.threshold, fit.percentile(100.0 - 2.0 / len(x)), 2000)
        in_a_bar = len(x) * (edges[1] - edges[0])
        bound = f"bound {fit.bound:.3g}" if fit.bound < 2.0 * at[-1] else "bound not seen"
        ax.plot(at, in_a_bar * np.gradient(fit.cdf(at), at), color="k", label=f"Weibull tail, {bound}")
        low, value, high = sample.percentile(95.0)[:, i, j]
        ax.axvline(value, color="0.45", linewidth=1.0, label=f"at most {value:.3g} in 95 % of wheels")
        ax.axvspan(max(low, x.min()), min(high, at[-1]), color="k", alpha=0.1, linewidth=0.0, label="its interval of 95 %")
        ax.locator_params(axis="y", integer=True)
        ax.set(xlabel=_FACTOR, ylabel="Number of wheels")
    return ax


@draws(MistunedSample, "plot_preload")
def plot_sample_preload(
    sample: MistunedSample,
    standard_deviation: float | None = None,
    ax: Axes | None = None,
    *,
    quantity: str = "amplitude",
    percentiles: Sequence[float] = PERCENTILES,
    title: str = "",
) -> Axes:
    """Percentiles of the worst blade's amplitude over the preload, beside the tuned wheel, or of its amplification.

    Parameters
    ----------
    sample : MistunedSample
    standard_deviation : float, optional
        The last one by default.
    ax : matplotlib axes, optional
    quantity : {"amplitude", "amplification"}
    percentiles : sequence of float
        Bands are their intervals of 95 %, and end where the sample does not bound them.
    title : str

    Returns
    -------
    matplotlib axes
        Stars mark the least value of each line among the preloads asked.
    """
    i, _ = sample.cell(standard_deviation, None)
    order = np.argsort(sample.preload)
    x = sample.preload[order]
    with drawing(ax, title=title or _of(sample, i, len(sample)), legend=7.0) as ax:
        for k, (q, colour) in enumerate(zip(percentiles, colours(len(percentiles))[::-1])):
            low, value, high = sample.percentile(q, quantity)[:, i, order]
            ax.plot(x, value, color=colour, marker=MARKERS[k], markersize=3.5, label=f"at most, in {q:g} % of wheels")
            band(ax, x, low, high, colour)
            best = int(np.argmin(value))
            ax.plot(x[best], value[best], "*", color=colour, markersize=9.0, markeredgecolor="k", markeredgewidth=0.4)
        tuned = sample.tuned_amplitude[order] / (1.0 if quantity == "amplitude" else sample.tuned_amplitude[order])
        limit_line(ax, "tuned wheel", x, tuned, x[-1])
        over_preload(ax, MistunedSample)
        if quantity == "amplification":
            ax.set(yscale="linear", ylabel=_FACTOR)
    return ax


@draws(WheelOptimalCurve)
def plot_wheel_optimal(curve: WheelOptimalCurve, ax: Axes | None = None, *, title: str = "") -> Axes:
    """Highest amplitude of any blade over the preload, beside the tuned wheel; stars mark where each is least, or may be.

    Parameters
    ----------
    curve : WheelOptimalCurve
    ax : matplotlib axes, optional
    title : str

    Returns
    -------
    matplotlib axes
        Preloads without a peak are crosses at the lower edge; held peaks are open circles with their error.
    """
    order = np.argsort(curve.preload)
    x, best = curve.preload[order], curve.candidates
    none = ~np.isfinite(curve.amplitude[order])
    with drawing(ax, title=title, legend=7.0) as ax:
        ax.plot(x, curve.amplitude[order], "-o", color="0.1", markersize=3.5, label="highest blade")
        held = np.array([s == HELD for s in curve.status]) & np.isfinite(curve.amplitude)
        if held.any():
            height = curve.amplitude[held]
            style: dict[str, Any] = {"markersize": 5.0, "markerfacecolor": "w", "color": "0.1", "elinewidth": 0.6}
            error = np.minimum(curve.error[held], 0.9) * height
            ax.errorbar(curve.preload[held], height, error, fmt="o", **style, label="held, with error")
        limit_line(ax, "tuned wheel", x, curve.tuned_amplitude[order], x[-1])
        ax.plot(curve.preload[best], curve.amplitude[best], "*", color="0.1", markersize=10.0)
        tuned = int(np.nanargmin(curve.tuned_amplitude))
        ax.plot(curve.preload[tuned], curve.tuned_amplitude[tuned], "*", color="0.4", markersize=10.0)
        if none.any():
            lost(ax, x[none], "0.4", "no peak", 6.0)
        over_preload(ax, WheelOptimalCurve)
    return ax
