"""Plots of mistuned bladed disks: deviations and amplitudes of blades, statistics of samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap
from numpy.typing import NDArray

from bdamper.mistuning.mistuning import Mistuning
from bdamper.mistuning.peak import DiskPeak
from bdamper.mistuning.sample import MistunedSample
from bdamper.model.structure import Model, turn
from bdamper.plot.axes import (
    COLUMN,
    NEW,
    SMALL,
    STYLES,
    colours,
    highest_on,
    limit_line,
    looks,
    note,
    picture,
)
from bdamper.plot.bodies import shown_shapes
from bdamper.plot.studies import draw_table
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import MotionInTime, TimeResponse
from bdamper.util import validation
from bdamper.util.errors import BdamperError
from bdamper.util.formatting import amount
from bdamper.util.tables import axis_label

PERCENTILES = (50.0, 95.0)
_FACTOR = "Amplification of the highest blade"
FROM_WHITE = LinearSegmentedColormap.from_list(
    "from white", ["#ffffff", "#8cc5e3", "#2a6f97", "#012a4a"]
)
"""Colours of amplitudes, white at 0."""


@picture(Mistuning)
def plot_mistuning(mistuning: Mistuning, ax: Axes = NEW) -> None:
    """Plot the frequency deviation of every blade as bars, with adjacent bars for several modes."""
    values = 100.0 * mistuning.deviation.reshape(mistuning.n_blades, -1)
    n = values.shape[1]
    for k, (column, colour) in enumerate(zip(values.T, colours(n))):
        look = {
            "color": colour,
            "edgecolor": "k",
            "linewidth": 0.3,
            "label": f"mode {k + 1}" if n > 1 else None,
        }
        ax.bar(
            np.arange(mistuning.n_blades) + (k - 0.5 * (n - 1)) * 0.8 / n, column, 0.8 / n, **look
        )
    ax.axhline(0.0, color="k", linewidth=0.6)
    ax.set(xlabel="Blade", ylabel="Frequency deviation (%)")


@picture()
def plot_wheel_map(curve: ResponseCurve, ax: Axes = NEW) -> None:
    """Plot a map of the amplitude of every blade over frequency.

    If there are several solutions at a frequency, the one with the highest blade is shown.  A
    circle marks the highest point.

    Parameters
    ----------
    curve : ResponseCurve
        Result of ``BladedDisk.frequency_response``.
    """
    response = validation.instance("curve", curve, ResponseCurve).blades
    if response is None:
        raise validation.invalid("curve", "a result of BladedDisk.frequency_response", curve)
    top, blades = curve.peak, np.abs(response[..., 1])
    frequency = np.linspace(curve.frequency.min(), curve.frequency.max(), 400)
    amplitude, _ = highest_on(frequency, curve.frequency, blades, curve.branch)
    ax.grid(False)
    look: dict[str, Any] = {
        "cmap": FROM_WHITE,
        "vmin": 0.0,
        "rasterized": True,
        "shading": "nearest",
    }
    image = ax.pcolormesh(frequency, np.arange(blades.shape[1]), amplitude.T, **look)
    circle: dict[str, Any] = {"markersize": 7.0, "markerfacecolor": "none", "clip_on": False}
    highest = int(blades[curve.peak_index].argmax())
    for width, colour in ((2.4, "k"), (1.0, "w")):
        ax.plot(top.frequency, highest, "o", color=colour, markeredgewidth=width, **circle)
    ax.figure.colorbar(image, ax=ax, label="Amplitude (m)")
    ax.set(
        xlabel=axis_label(ResponseCurve, "frequency"),
        ylabel="Blade",
        title=f"preload {amount(curve.preload, 'N')}",
    )


def _bars(ax: Axes, heights: NDArray, blade: int, **look: Any) -> None:
    """Plot a bar for each blade, with one blade dark."""
    numbers = np.arange(len(heights))
    ax.bar(
        numbers,
        heights,
        color=np.where(numbers == blade, "0.15", "0.65"),
        edgecolor="k",
        linewidth=0.3,
        **look,
    )
    ax.set(xlabel="Blade", ylabel="Amplitude (m)")


@picture(DiskPeak)
def plot_wheel_peak(peak: DiskPeak, ax: Axes = NEW) -> None:
    """Plot the amplitudes of all blades at the highest peak as bars, with the highest blade dark and the tuned peak as a
    line.

    The title has the reason if the peak is incomplete.
    """
    if not np.isfinite(peak.amplitude):
        note(ax, peak._headline(), empty=True)
        return
    _bars(ax, peak.amplitudes, peak.blade)
    ax.axhline(peak.tuned_amplitude, color="k", linewidth=1.0, label="tuned peak")
    ax.set_title(
        _of_peak(
            peak,
            f"amplification factor {'' if peak.converged else 'at least '}{peak.amplification:.3f}",
        )
    )


def _of_peak(peak: DiskPeak, result: str) -> str:
    """Return a title: preload, frequency, a result, and a warning if a peak has not converged."""
    warning = (
        ""
        if peak.converged
        else ", dampers held"
        if peak.springs
        else f", {peak.status}: {peak.reason}"
    )
    return f"preload {amount(peak.preload, 'N')}, {peak.frequency:.5g} Hz, {result}{warning}"


@picture(TimeResponse)
def plot_blades(found: TimeResponse, ax: Axes = NEW) -> None:
    """Plot mean amplitudes of all blades in time as bars with ranges, the highest blade dark.

    A line is the peak of the harmonic balance.
    """
    if not found.blades.size:
        raise BdamperError(f"plot: this result has no motion of blades in time ({found.status})")
    mean = found.blades.mean(axis=0)
    ends = [mean - found.blades.min(axis=0), found.blades.max(axis=0) - mean]
    _bars(ax, mean, found.blade, yerr=ends, capsize=2.0, ecolor="0.4")
    ax.axhline(found.balance, color="k", linewidth=1.0, label="harmonic balance")
    warning = "" if found.mean > 0.0 else ", no steady state near the peak"
    title = f"preload {amount(found.preload, 'N')}, {found.frequency:.5g} Hz{warning}"
    ax.set(ylabel="Amplitude in time, mean and range (m)", title=title)


@picture(MotionInTime)
def plot_periods(found: MotionInTime, ax: Axes = NEW) -> None:
    """Plot the amplitude of each period of a motion, with mean and range of the second half."""
    half = [len(found.period) // 2, len(found.period) - 1]
    ax.fill_between(half, found.lowest, found.highest, color="0.85", label="range")
    draw_table(
        ax, found, "period", "amplitude", color="0.2", linewidth=0.9, marker="", label="each period"
    )
    ax.plot(half, [found.mean] * 2, color="k", linewidth=2.0, label="mean")
    if np.isfinite(found.balance):
        ax.axhline(
            found.balance, color="k", linestyle="-.", linewidth=1.0, label="harmonic balance"
        )
    verdict = f": {found.verdict}" if found.verdict else ""
    title = f"{found.frequency:.6g} Hz, preload {amount(found.preload, 'N')}{verdict}"
    ax.set(xlabel="Period of the excitation", title=title)


@picture(DiskPeak, "plot_wheel", size=(COLUMN, 2.9))
def plot_wheel(peak: DiskPeak, model: Model, ax: Axes = NEW) -> None:
    """Plot the bladed disk from the front, with darker blades for larger amplitudes.

    The number of the highest blade is bold.

    Parameters
    ----------
    peak : DiskPeak
    model : Model
        Model with a blade surface with mode shapes; the first one distributes the amplitude over
        each blade.
    """
    if len(peak.amplitudes) != model.n_blades:
        found = f"{len(peak.response)} blades"
        raise BdamperError(
            f"plot of a bladed disk: needs a peak of {model.n_blades} blades, found {found}"
        )
    ax.set_axis_off()
    if not np.isfinite(peak.amplitude):
        note(ax, peak._headline())
        return
    body, d = shown_shapes(model, None, None, "plot of a bladed disk")
    mesh = model.meshes[body]
    shape = np.linalg.norm(np.abs(mesh.modes[d][..., 0]), axis=1)[mesh.quads].mean(axis=1)
    turns = [turn(2.0 * np.pi * k / model.n_blades) for k in range(model.n_blades)]
    faces = np.concatenate([(mesh.points @ t.T)[mesh.quads] for t in turns])
    order = np.argsort(faces[..., 2].mean(axis=1))
    patches = PolyCollection(
        list(faces[order, :, :2]),
        cmap=FROM_WHITE,
        edgecolors="0.75",
        linewidths=0.1,
        rasterized=True,
    )
    patches.set_array(np.outer(peak.amplitudes, shape / shape.max()).ravel()[order])
    patches.set_clim(0.0, peak.amplitude)
    ax.add_collection(patches)
    radius = 1.07 * np.linalg.norm(mesh.points[:, :2], axis=1).max()
    apart = min(
        5, model.n_blades // 10 + 1
    )  # smallest difference of the numbers written next to each other
    near = {(peak.blade + k) % model.n_blades for k in range(-apart, apart + 1)}
    for k in {*range(0, model.n_blades - apart, 10)} - near | {peak.blade}:
        x, y = radius * (turns[k] @ [0.0, 1.0, 0.0])[:2]
        weight = "bold" if k == peak.blade else "normal"
        ax.text(
            x, y, str(k), ha="center", va="center", fontsize=SMALL, weight=weight, clip_on=False
        )
    ax.set(aspect="equal", xlim=(-radius, radius), ylim=(-radius, radius))
    ax.set_title(_of_peak(peak, f"blade {peak.blade} highest, {amount(peak.amplitude, 'm')}"))
    ax.figure.colorbar(patches, ax=ax, label="Amplitude (m)", shrink=0.8)


def _title(sample: MistunedSample, i: int, n: int) -> str:
    """Return a title with the number of disks and their standard deviation."""
    return f"{n} bladed disks, standard deviation of blade frequencies {100.0 * sample.standard_deviation[i]:g} %"


@picture(MistunedSample)
def plot_sample(
    sample: MistunedSample, over: str | None = None, ax: Axes = NEW, *, quantity: str = "amplification",
    standard_deviation: float | None = None, percentiles: Sequence[float] = PERCENTILES,
) -> None:  # fmt: skip
    """Plot percentiles of the highest blade over the deviation of mistuning or the preload.

    Over the standard deviation each preload has a colour.

    Bands are 95 % confidence intervals with the errors of the peaks, for the last percentile if
    there are several colours. They end where the sample does not bound them.  Over the preload,
    stars mark the smallest value of each line.

    Parameters
    ----------
    sample : MistunedSample
    over : {"standard_deviation", "preload"}, optional
        By default the preload if the sample has one standard deviation.
    quantity : {"amplification", "amplitude"}
        Amplification factor, or resonance amplitude together with the tuned amplitude.
    standard_deviation : float, optional
        For a plot over the preload; the last one by default.
    percentiles : sequence of float
        Up to six.
    """
    over = over or ("preload" if len(sample.standard_deviation) == 1 else "standard_deviation")
    preloads = validation.choice("over", over, ("standard_deviation", "preload")) == "preload"
    relative = (
        validation.choice("quantity", quantity, ("amplification", "amplitude")) == "amplification"
    )
    i, _ = sample.cell(standard_deviation, None)
    order = np.argsort(sample.preload)
    values = np.array([sample.percentile(q, quantity)[..., order] for q in percentiles])
    preload = sample.preload[order]
    x, lines, names = (
        100.0 * sample.standard_deviation,
        values.swapaxes(2, 3),
        [amount(p, "N") for p in preload.tolist()],
    )
    if preloads:
        x, lines, names = preload, values[:, :, [i]], [""]
    for k, (name, look) in enumerate(zip(names, looks(len(names)))):
        for q, (low, value, high), style in zip(percentiles, lines[:, :, k], STYLES):
            ax.plot(x, value, **{**look, "linestyle": style})
            if preloads or q == percentiles[-1]:
                known = np.isfinite(low) & np.isfinite(high)
                ax.fill_between(
                    x, low, high, where=known, color=look["color"], alpha=0.15, linewidth=0.0
                )
            if preloads:
                best = int(np.argmin(value))
                ax.plot(x[best], value[best], "*", color=look["color"], markersize=9.0)
        ax.plot([], [], **{**look, "linestyle": ""}, label=name or None)
    for q, dashes in zip(percentiles, STYLES):
        ax.plot([], [], color="0.3", linestyle=dashes, label=f"{q:g} % of disks are below")
    if sample.held:
        ax.plot([], [], " ", label=f"dampers held: {100.0 * sample.held:.0f} % of peaks")
    if preloads:
        tuned = sample.tuned_amplitude[order] / (sample.tuned_amplitude[order] if relative else 1.0)
        limit_line(ax, "tuned disk", x, tuned, x[len(x) // 2])
    across = (
        axis_label(MistunedSample, "preload")
        if preloads
        else "Standard deviation of blade frequencies (%)"
    )
    ax.set(xlabel=across, ylabel=_FACTOR if relative else axis_label(MistunedSample, "amplitude"))
    ax.set(xscale="log" if preloads else "linear", yscale="linear" if relative else "log")
    ax.set_title(_title(sample, i, len(sample)) if preloads else f"{len(sample)} bladed disks")


@picture(MistunedSample, "plot_tail")
def plot_sample_tail(
    sample: MistunedSample, standard_deviation: float | None = None, preload: float | None = None, ax: Axes = NEW,
    *, tail: float = 0.5,
) -> None:  # fmt: skip
    """Plot a histogram of the amplification factors of one cell, with the Weibull fit of its tail.

    The 95th percentile has its confidence interval with the errors of the peaks, drawn to the edge
    if the sample does not bound it.

    Parameters
    ----------
    sample : MistunedSample
    standard_deviation, preload : float, optional
        Cell of the sample; by default the last standard deviation and the last preload.
    tail : float
        Fraction of the disks in the fit.
    """
    i, j = sample.cell(standard_deviation, preload)
    x = sample.amplification[:, i, j]
    x = x[np.isfinite(x)]
    fit = sample.tail(float(sample.standard_deviation[i]), float(sample.preload[j]), tail)
    _, edges, _ = ax.hist(
        x, bins="doane", color="0.8", edgecolor="0.4", linewidth=0.6, label="bladed disks"
    )
    tail_x = np.linspace(fit.threshold, fit.percentile(100.0 - 2.0 / len(x)), 2000)
    per_bar = len(x) * (edges[1] - edges[0])
    bound = f"bound {fit.bound:.3g}" if fit.bound < 2.0 * tail_x[-1] else "no finite bound"
    ax.plot(
        tail_x,
        per_bar * np.gradient(fit.cdf(tail_x), tail_x),
        color="k",
        label=f"Weibull tail, {bound}",
    )
    low, value, high = sample.percentile(95.0)[:, i, j]
    ax.axvline(value, color="0.45", linewidth=1.0, label=f"95 % of disks are below {value:.3g}")
    ends = max(low, x.min()), high if np.isfinite(high) else tail_x[-1]
    ax.axvspan(*ends, color="k", alpha=0.1, linewidth=0.0, label="its 95 % interval, with errors")
    ax.locator_params(axis="y", integer=True)
    ax.set(xlabel=_FACTOR, ylabel="Number of bladed disks")
    ax.set_title(f"{_title(sample, i, len(x))}, {amount(float(sample.preload[j]), 'N')}")
