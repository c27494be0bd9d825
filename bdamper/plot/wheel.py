"""Plots of mistuned bladed disks: deviations and amplitudes of blades, statistics of samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.ticker import MaxNLocator
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
    once,
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
    blades = np.arange(mistuning.n_blades)
    deviation = 100.0 * mistuning.deviation.reshape(mistuning.n_blades, -1)
    n_modes = deviation.shape[1]
    # the bars of one blade share 0.8 of the distance between blades
    width = 0.8 / n_modes
    for k, (of_mode, colour) in enumerate(zip(deviation.T, colours(n_modes))):
        offset = (k - 0.5 * (n_modes - 1)) * 0.8 / n_modes
        ax.bar(
            blades + offset,
            of_mode,
            width,
            color=colour,
            edgecolor="k",
            linewidth=0.3,
            label=f"mode {k + 1}" if n_modes > 1 else None,
        )
    ax.axhline(0.0, color="k", linewidth=0.6)
    ax.set(xlabel="Blade", ylabel="Frequency deviation (%)")


@picture()
def plot_wheel_map(curve: ResponseCurve, ax: Axes = NEW) -> None:
    """Plot a map of the amplitude of every blade against frequency.

    If there are several solutions at a frequency, the one with the largest blade amplitude is
    shown.  A circle marks the highest point.

    Parameters
    ----------
    curve : ResponseCurve
        Result of ``BladedDisk.frequency_response``.
    """
    response = validation.instance("curve", curve, ResponseCurve).blades
    if response is None:
        raise validation.invalid("curve", "a result of BladedDisk.frequency_response", curve)
    of_blades = np.abs(response[..., 1])
    frequency = np.linspace(curve.frequency.min(), curve.frequency.max(), 400)
    amplitude, _ = highest_on(frequency, curve.frequency, of_blades, curve.branch)
    ax.grid(False)
    image = ax.pcolormesh(
        frequency,
        np.arange(of_blades.shape[1]),
        amplitude.T,
        cmap=FROM_WHITE,
        vmin=0.0,
        rasterized=True,
        shading="nearest",
    )
    highest_blade = int(of_blades[curve.peak_index].argmax())
    # a white circle on a wider black one is visible on every colour
    for width, colour in ((2.4, "k"), (1.0, "w")):
        ax.plot(
            curve.peak.frequency,
            highest_blade,
            "o",
            color=colour,
            markeredgewidth=width,
            markersize=7.0,
            markerfacecolor="none",
            clip_on=False,
        )
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
    few = 8
    if len(numbers) <= few:
        ax.set_xticks(numbers)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set(xlabel="Blade", ylabel="Amplitude (m)")


@picture(DiskPeak)
def plot_wheel_peak(peak: DiskPeak, ax: Axes = NEW) -> None:
    """Plot the amplitudes of all blades at the highest peak as bars.

    The blade with the largest amplitude is drawn dark, and the tuned peak as a line.  If the peak
    is incomplete, the title gives the reason.
    """
    if not np.isfinite(peak.amplitude):
        note(ax, peak._headline(), empty=True)
        return
    _bars(ax, peak.amplitudes, peak.blade)
    ax.axhline(peak.tuned_amplitude, color="k", linewidth=1.0, label="tuned peak")
    bound = "" if peak.ok else "at least "
    ax.set_title(_of_peak(peak, f"amplification factor {bound}{peak.amplification:.3f}"))


def _of_peak(peak: DiskPeak, result: str) -> str:
    """Return a title: preload, frequency, a result, and a warning if a peak has not converged."""
    if peak.ok:
        warning = ""
    elif peak.springs:
        warning = ", dampers held"
    else:
        warning = f", {peak.status}: {peak.reason}"
    return f"preload {amount(peak.preload, 'N')}, {amount(peak.frequency, 'Hz')}, {result}{warning}"


@picture(TimeResponse)
def plot_blades(found: TimeResponse, ax: Axes = NEW) -> None:
    """Plot mean amplitudes of all blades from time integration as bars with ranges.

    The blade with the largest amplitude is drawn dark.  Its bar shows the range that the result
    prints, over all integrations; the other bars show the range over their periods.  A line marks
    the harmonic-balance peak.
    """
    if not found.blades.size:
        raise BdamperError(
            f"plot: this result contains no motion of blades by time integration ({found.status_text})"
        )
    mean = found.blades.mean(axis=0)
    below = mean - found.blades.min(axis=0)
    above = found.blades.max(axis=0) - mean
    if np.isfinite(found.mean):
        below[found.blade] = max(mean[found.blade] - found.lowest, 0.0)
        above[found.blade] = max(found.largest - mean[found.blade], 0.0)
    _bars(ax, mean, found.blade, yerr=[below, above], capsize=2.0, ecolor="0.4")
    ax.axhline(found.balance, color="k", linewidth=1.0, label="harmonic balance")
    warning = "" if found.mean > 0.0 else ", no steady state near the peak"
    title = f"preload {amount(found.preload, 'N')}, {amount(found.frequency, 'Hz')}{warning}"
    ax.set(ylabel="Amplitude by time integration, mean and range (m)", title=title)


@picture(MotionInTime)
def plot_periods(found: MotionInTime, ax: Axes = NEW) -> None:
    """Plot the amplitude of each period of a motion, with mean and range of the second half."""
    n_periods = len(found.period)
    second_half = [n_periods // 2, n_periods - 1]
    ax.fill_between(second_half, found.lowest, found.highest, color="0.85", label="range")
    draw_table(
        ax, found, "period", "amplitude", color="0.2", linewidth=0.9, marker="", label="each period"
    )
    ax.plot(second_half, [found.mean, found.mean], color="k", linewidth=2.0, label="mean")
    if np.isfinite(found.balance):
        ax.axhline(
            found.balance, color="k", linestyle="-.", linewidth=1.0, label="harmonic balance"
        )
    verdict = f": {found.verdict}" if found.verdict else ""
    title = f"{amount(found.frequency, 'Hz')}, preload {amount(found.preload, 'N')}{verdict}"
    ax.set(xlabel="Period of the excitation", title=title)


@picture(DiskPeak, "plot_wheel", size=(COLUMN, 2.9))
def plot_wheel(peak: DiskPeak, model: Model, ax: Axes = NEW) -> None:
    """Plot the bladed disk from the front, with darker blades for larger amplitudes.

    The number of the blade with the largest amplitude is bold.

    Parameters
    ----------
    peak : DiskPeak
    model : Model
        Model with a blade surface with mode shapes; the first one distributes the amplitude over
        each blade.
    """
    n_blades = model.n_blades
    if len(peak.amplitudes) != n_blades:
        found = f"{len(peak.response)} blades"
        raise BdamperError(
            f"plot of a bladed disk: needs a peak of {n_blades} blades, found {found}"
        )
    ax.set_axis_off()
    if not np.isfinite(peak.amplitude):
        note(ax, peak._headline())
        return
    body, diameter = shown_shapes(model, None, None, "plot of a bladed disk")
    mesh = model.meshes[body]
    rotations = [turn(2.0 * np.pi * k / n_blades) for k in range(n_blades)]
    corners = np.concatenate([(mesh.points @ rotation.T)[mesh.quads] for rotation in rotations])
    farthest_first = np.argsort(corners[..., 2].mean(axis=1))
    patches = PolyCollection(
        list(corners[farthest_first, :, :2]),
        cmap=FROM_WHITE,
        edgecolors="0.75",
        linewidths=0.1,
        rasterized=True,
    )
    # the first mode distributes the amplitude of a blade over its faces
    at_nodes = np.linalg.norm(np.abs(mesh.modes[diameter][..., 0]), axis=1)
    shape = at_nodes[mesh.quads].mean(axis=1)
    amplitude = np.outer(peak.amplitudes, shape / shape.max()).ravel()
    patches.set_array(amplitude[farthest_first])
    patches.set_clim(0.0, peak.amplitude)
    ax.add_collection(patches)
    # far enough for the numbers to lie beyond the tips
    radius = 1.11 * np.linalg.norm(mesh.points[:, :2], axis=1).max()
    for blade in _numbered_blades(n_blades, peak.blade):
        x, y = radius * (rotations[blade] @ [0.0, 1.0, 0.0])[:2]
        ax.text(
            x,
            y,
            str(blade),
            ha="center",
            va="center",
            fontsize=SMALL,
            weight="bold" if blade == peak.blade else "normal",
            clip_on=False,
        )
    ax.set(aspect="equal", xlim=(-radius, radius), ylim=(-radius, radius))
    ax.set_title(_of_peak(peak, f"blade {peak.blade} highest, {amount(peak.amplitude, 'm')}"))
    ax.figure.colorbar(patches, ax=ax, label="Amplitude (m)", shrink=0.8)


def _numbered_blades(n_blades: int, highest: int) -> set[int]:
    """Return the highest blade and every tenth blade whose number does not touch another one."""
    # largest difference at which two numbers touch; a number is a fortieth of the circle wide
    apart = int(np.ceil(n_blades / 40))
    near_highest = {(highest + k) % n_blades for k in range(-apart, apart + 1)}
    tenth = set(range(0, n_blades - apart, 10))
    return (tenth - near_highest) | {highest}


def _title(sample: MistunedSample, i: int, n: int) -> str:
    """Return a title with the number of disks and their standard deviation."""
    percent = 100.0 * sample.standard_deviation[i]
    return f"{n} bladed disks, standard deviation of blade frequencies {percent:g} %"


@picture(MistunedSample, size=(COLUMN, 3.0))
def plot_sample(
    sample: MistunedSample,
    over: str | None = None,
    ax: Axes = NEW,
    *,
    quantity: str = "amplification",
    standard_deviation: float | None = None,
    percentiles: Sequence[float] = PERCENTILES,
) -> None:
    """Plot percentiles of the largest blade amplitude against mistuning or preload.

    Against the standard deviation, each preload has its own colour.

    Bands are 95 % confidence intervals with the errors of the peaks, for the last percentile if
    there are several colours.  Their edges have the line style of the percentile.  They end where
    the sample does not bound them.  Against the preload, stars mark the smallest value of each
    line.

    Parameters
    ----------
    sample : MistunedSample
    over : {"standard_deviation", "preload"}, optional
        By default the preload if the sample has one standard deviation.
    quantity : {"amplification", "amplitude"}
        Amplification factor, or resonance amplitude together with the tuned amplitude.
    standard_deviation : float, optional
        For a plot against the preload; by default, the last value of the sample.
    percentiles : sequence of float
        Up to six.
    """
    has_one_deviation = len(sample.standard_deviation) == 1
    over = over or ("preload" if has_one_deviation else "standard_deviation")
    over_preload = validation.choice("over", over, ("standard_deviation", "preload")) == "preload"
    validation.choice("quantity", quantity, ("amplification", "amplitude"))
    is_factor = quantity == "amplification"
    i, _ = sample.cell(standard_deviation, None)
    order = np.argsort(sample.preload)
    preload = sample.preload[order]
    # (percentiles, lower end and value and upper end, standard deviations, preloads)
    values = np.array([sample.percentile(q, quantity)[..., order] for q in percentiles])
    if over_preload:
        x = preload
        lines = values[:, :, [i]]
        names = [""]
    else:
        x = 100.0 * sample.standard_deviation
        lines = values.swapaxes(2, 3)
        names = [amount(p, "N") for p in preload.tolist()]
    for k, (name, look) in enumerate(zip(names, looks(len(names)))):
        colour = look["color"]
        for q, (low, value, high), style in zip(percentiles, lines[:, :, k], STYLES):
            ax.plot(x, value, **{**look, "linestyle": style})
            if over_preload or q == percentiles[-1]:
                _confidence_band(ax, x, low, high, colour, style)
            if over_preload:
                best = int(np.argmin(value))
                ax.plot(
                    x[best],
                    value[best],
                    "*",
                    color=colour,
                    markersize=9.0,
                    label=once(ax, "lowest of each line"),
                )
        ax.plot([], [], **{**look, "linestyle": ""}, label=name or None)
    for q, dashes in zip(percentiles, STYLES):
        ax.plot([], [], color="0.3", linestyle=dashes, label=f"{q:g} % of disks are below")
    if sample.held:
        ax.plot([], [], " ", label=f"{100.0 * sample.held:.0f} % of peaks: dampers held by springs")
    if over_preload:
        tuned = sample.tuned_amplitude[order]
        relative = tuned / (tuned if is_factor else 1.0)
        limit_line(ax, "tuned disk", x, relative, x[len(x) // 2])
        ax.set(xlabel=axis_label(MistunedSample, "preload"), xscale="log")
        ax.set_title(_title(sample, i, len(sample)))
    else:
        ax.set(xlabel="Standard deviation of blade frequencies (%)", xscale="linear")
        ax.set_title(f"{len(sample)} bladed disks")
    if is_factor:
        ax.set(ylabel=_FACTOR, yscale="linear")
    else:
        ax.set(ylabel=axis_label(MistunedSample, "amplitude"), yscale="log")


def _confidence_band(
    ax: Axes, x: NDArray, low: NDArray, high: NDArray, colour: Any, style: Any
) -> None:
    """Shade a confidence interval where the sample bounds it; edges have the style of the line."""
    known = np.isfinite(low) & np.isfinite(high)
    if not known.any():
        return
    label = once(ax, "95 % confidence interval, with errors of peaks")
    ax.fill_between(x, low, high, where=known, color=colour, alpha=0.15, linewidth=0.0, label=label)
    for edge in (low, high):
        bounded = np.where(known, edge, np.nan)
        ax.plot(x, bounded, color=colour, alpha=0.6, linestyle=style, linewidth=0.6)


@picture(MistunedSample, "plot_tail")
def plot_sample_tail(
    sample: MistunedSample,
    standard_deviation: float | None = None,
    preload: float | None = None,
    ax: Axes = NEW,
    *,
    tail: float = 0.5,
) -> None:
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
    factor = sample.amplification[:, i, j]
    factor = factor[np.isfinite(factor)]
    n_disks = len(factor)
    fit = sample.tail(float(sample.standard_deviation[i]), float(sample.preload[j]), tail)
    _, edges, _ = ax.hist(
        factor, bins="doane", color="0.8", edgecolor="0.4", linewidth=0.6, label="bladed disks"
    )
    # up to the factor that two disks of the sample exceed
    fitted = np.linspace(fit.threshold, fit.percentile(100.0 - 2.0 / n_disks), 2000)
    disks_per_bar = n_disks * (edges[1] - edges[0])
    density = np.gradient(fit.cdf(fitted), fitted)
    bound = f"bound {fit.bound:.3g}" if fit.bound < 2.0 * fitted[-1] else "no finite bound"
    ax.plot(fitted, disks_per_bar * density, color="k", label=f"Weibull tail, {bound}")
    low, value, high = sample.percentile(95.0)[:, i, j]
    ax.axvline(value, color="0.45", linewidth=1.0, label=f"95 % of disks are below {value:.3g}")
    ax.axvspan(
        max(low, factor.min()),
        high if np.isfinite(high) else fitted[-1],
        color="k",
        alpha=0.1,
        linewidth=0.0,
        label="its 95 % confidence interval, with errors of peaks",
    )
    ax.locator_params(axis="y", integer=True)
    ax.set(xlabel=_FACTOR, ylabel="Number of bladed disks")
    ax.set_title(f"{_title(sample, i, n_disks)}, {amount(float(sample.preload[j]), 'N')}")
