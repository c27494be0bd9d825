"""Figures: the only module that imports matplotlib.

Curves are told apart by lightness (dark to light with rising preload) and by sparse markers, so that they stay legible in
grey; unstable parts are dashed.  The limits without contact and with all contacts stuck are thin grey lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from numpy.typing import NDArray

from bdamper.io.import_report import ImportReport
from bdamper.optimal import OptimalCurve
from bdamper.response import Curve

MARKERS = "osD^v<>pP*hX"
PAPER: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.grid": True,
    "grid.color": "0.9",
    "axes.axisbelow": True,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "figure.constrained_layout.use": True,
    "savefig.dpi": 200,
}
"""Settings of a figure that fits one column of a paper."""


def new_axes(width: float = 5.2, height: float = 3.6) -> Axes:
    """Empty axes in the style of this module (size in inches)."""
    with plt.rc_context(PAPER):
        return plt.subplots(figsize=(width, height))[1]


def save_figure(target: Axes | Figure, path: Any) -> None:
    """Write a figure to a file, and close it."""
    figure = target if isinstance(target, Figure) else target.figure
    with plt.rc_context(PAPER):
        figure.savefig(path)  # type: ignore[union-attr]
    plt.close(figure)  # type: ignore[arg-type]


def colours(n: int) -> NDArray:
    """(n, 4) colours of monotone lightness."""
    return plt.get_cmap("viridis")(np.linspace(0.0, 0.85, max(n, 1)))


def runs(flag: NDArray) -> list[tuple[int, int, bool]]:
    """Stretches (first, last, value) of equal value, each joined to the next at a common point."""
    if not len(flag):
        return []
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(flag.astype(int))) + 1, [len(flag)]])
    return [(int(a), min(int(b), len(flag) - 1), bool(flag[a])) for a, b in pairwise(cuts)]


def unstable_points(curve: Curve) -> NDArray:
    """(n,) bool: from the stability analysis where there is one, else where the curve runs back in frequency."""
    stable = getattr(curve, "stable", None)
    return curve.backward if stable is None else ~np.asarray(stable, bool)


def _engineering(value: float) -> str:
    if value >= 1000.0 and value < 1e6:
        return f"{value / 1000.0:g} kN"
    return f"{value:g} N"


def _draw_tracking(ax: Axes, curve: Curve, colour: Any, marker: str, label: str) -> None:
    f, a = curve.frequency, curve.amplitude
    unstable = unstable_points(curve)
    for b in np.unique(curve.branch):
        where = np.flatnonzero(curve.branch == b)
        for first, last, dashed in runs(unstable[where]):
            part = where[first : last + 1]
            ax.plot(f[part], a[part], color=colour, linestyle=(0, (3, 1.5)) if dashed else "-")
    if len(curve):
        peak = curve.peak
        every = max(1, len(curve) // 12)
        ax.plot(f[::every], a[::every], linestyle="none", marker=marker, markersize=2.6, color=colour)
        ax.plot(peak.frequency, peak.amplitude, marker=marker, markersize=5.0, color=colour, markeredgecolor="k",
                markeredgewidth=0.6, linestyle="none")
    ax.plot([], [], color=colour, marker=marker, markersize=3.5, label=label)


def plot_curves(
    curves: Sequence[Curve],
    ax: Axes | None = None,
    *,
    labels: Sequence[str] | None = None,
    logarithmic: bool = True,
    title: str = "",
) -> Axes:
    """Amplitude over frequency for several curves in one picture.

    Parameters
    ----------
    curves : sequence of Curve
        Tracking curves and, as thin grey lines, the free and stuck limits.
    ax : matplotlib axes, optional
    labels : sequence of str, optional
        One for each tracking curve; the preload by default.
    logarithmic : bool
        Scale of the amplitude.
    title : str

    Returns
    -------
    matplotlib axes
    """
    with plt.rc_context(PAPER):
        if ax is None:
            ax = new_axes()
        tracking = [c for c in curves if c.kind == "tracking"]
        for curve in curves:
            if curve.kind == "tracking":
                continue
            style = "-." if curve.kind == "free" else ":"
            ax.plot(curve.frequency, curve.amplitude, color="0.35", linewidth=0.9, linestyle=style, label=curve.kind)
        for i, (curve, colour) in enumerate(zip(tracking, colours(len(tracking)))):
            label = labels[i] if labels is not None else _engineering(curve.preload)
            _draw_tracking(ax, curve, colour, MARKERS[i % len(MARKERS)], label)
        if any(unstable_points(c).any() for c in tracking):
            ax.plot([], [], color="k", linestyle=(0, (3, 1.5)), label="unstable")
        if logarithmic:
            ax.set_yscale("log")
        ax.set_xlabel("Frequency (Hz)")
        ax.set_ylabel("Response amplitude (m)")
        if title:
            ax.set_title(title, fontsize=9.0)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(ncols=2, fontsize=7.0)
    return ax


def plot_import_report(report: ImportReport) -> Figure:
    """Frequencies over nodal diameter beside the bodies with their contact points.

    Parameters
    ----------
    report : ImportReport

    Returns
    -------
    Figure
    """
    with plt.rc_context(PAPER):
        figure = plt.figure(figsize=(9.0, 4.2))
        left, right = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="3d")
        diameters = np.array(sorted(report.frequencies))
        n = min((len(report.frequencies[d]) for d in diameters), default=0)
        for mode in range(min(n, 8)):
            values = [report.frequencies[d][mode] for d in diameters]
            left.plot(diameters, values, marker=MARKERS[mode % len(MARKERS)], color=colours(8)[mode], markersize=4)
        left.set(xlabel="nodal diameter", ylabel="frequency, Hz", ylim=(0.0, None))
        left.set_title("sector", fontsize=9)
        for k, mesh in enumerate(report.model.meshes.values()):
            edges = np.concatenate([mesh.quads[:, [i, (i + 1) % 4]] for i in range(4)])
            edges = np.unique(np.sort(edges, axis=1), axis=0)
            edges = edges[edges[:, 0] != edges[:, 1]]
            right.add_collection3d(Line3DCollection(mesh.points[edges], colors=["0.6", "0.2"][k % 2], linewidths=0.4))
        points = [face.points for face in report.model.interfaces.values()]
        for k, (name, face) in enumerate(report.model.interfaces.items()):
            right.scatter(*face.points.T, s=6, color=colours(max(len(points), 2))[k], label=name, depthshade=False)
        shown = [mesh.points for mesh in report.model.meshes.values()] or points
        if shown:
            low, high = np.concatenate(shown).min(axis=0), np.concatenate(shown).max(axis=0)
            right.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
            right.set_box_aspect(np.maximum(high - low, 1e-3 * np.ptp([low, high])))
        right.set(xlabel="X", ylabel="Y", zlabel="Z")
        right.tick_params(labelsize=6)
        right.legend(loc="upper right")
    return figure


def plot_optimal(
    result: OptimalCurve, ax: Axes | None = None, *, title: str = "", coexisting: bool = True
) -> tuple[Axes, Axes]:
    """Resonance amplitude and frequency shift over the preload, as in Figs 8 and 9 of the paper.

    Parameters
    ----------
    result : OptimalCurve
    ax : matplotlib axes, optional
        Of the amplitude; the shift gets a second axis on its right.
    title : str
    coexisting : bool
        Mark the peaks that are not the highest, too.

    Returns
    -------
    two matplotlib axes
        Of the amplitude and of the frequency shift.
    """
    dark, light = "0.1", plt.get_cmap("viridis")(0.45)
    with plt.rc_context(PAPER):
        if ax is None:
            ax = new_axes()
        right = ax.twinx()
        right.grid(False)
        ax.axhline(result.free.amplitude, color="0.35", linewidth=0.9, linestyle="-.", label="free")
        ax.axhline(result.stuck.amplitude, color="0.35", linewidth=0.9, linestyle=":", label="stuck")
        if coexisting:
            others = ~np.isin(result.peak_amplitude, result.amplitude)
            ax.plot(result.peak_preload[others], result.peak_amplitude[others], ".", color="0.65", markersize=2.5,
                    label="other peaks")
        for first, last in _unbroken(result.branch):
            part = slice(first, last + 1)
            ax.plot(result.preload[part], result.amplitude[part], "-", color=dark)
            right.plot(result.preload[part], result.shift_percent[part], "--", color=light)
        ax.plot([], [], "-", color=dark, label="amplitude")
        ax.plot([], [], "--", color=light, label="frequency shift")
        o = result.optimum
        if np.isfinite(o.preload):
            ax.plot(o.preload, o.amplitude, "o", color=dark, markersize=4.5, markerfacecolor="w",
                    label=f"optimum, {_engineering(float(f'{o.preload:.3g}'))}")
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_xlabel("Preload (N)")
        ax.set_ylabel("Resonance amplitude (m)")
        right.set_ylabel("Frequency shift (%)")
        if title:
            ax.set_title(title, fontsize=9.0)
        ax.legend(fontsize=7.0, loc="best")
    return ax, right


def _unbroken(branch: NDArray) -> list[tuple[int, int]]:
    """Stretches (first, last) of points on one and the same branch."""
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(branch)) + 1, [len(branch)]])
    return [(int(a), int(b) - 1) for a, b in pairwise(cuts)]
