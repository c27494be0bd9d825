"""Figures: the only module that imports matplotlib.

Curves are told apart by lightness (dark to light with rising preload) and by sparse markers, so that they stay legible in
grey; unstable parts are dashed.  The limits without contact and with all contacts stuck are thin grey lines.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from numpy.typing import NDArray

from bdamper.accuracy.ladders import AccuracyCost
from bdamper.contact.stiffness import StiffnessComparison
from bdamper.contact.wedge import ContactMap
from bdamper.continuation.curve import Curve
from bdamper.design.sweep import SweepResult
from bdamper.design.uncertainty import UncertainCurve
from bdamper.effects.advice import Advice
from bdamper.effects.compare_laws import LawComparison
from bdamper.effects.microslip import Microslip
from bdamper.io.import_report import ImportReport
from bdamper.io.measured import Fit, Measured, Measurement, goodness_of_fit
from bdamper.model.model import Model
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.stability.steady_state import SettledResponse
from bdamper.stability.time_integration import Verification
from bdamper.util import validate
from bdamper.util.errors import SettingError
from bdamper.util.plotting import draws

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
        # filled: a peak, open: only the highest point
        ax.plot(peak.frequency, peak.amplitude, marker=marker, markersize=5.0, color=colour, markeredgecolor="k",
                markeredgewidth=0.6, linestyle="none", markerfacecolor="w" if curve.peak_at_end else colour)
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
    tracking = [c for c in curves if validate.instance("curves", c, Curve).kind == "tracking"]
    if labels is not None and (isinstance(labels, str) or len(labels) != len(tracking)):
        raise validate.unfit("labels", f"{len(tracking)} texts, one for each tracking curve", labels)
    with plt.rc_context(PAPER):
        if ax is None:
            ax = new_axes()
        for curve in curves:
            if curve.kind == "tracking":
                continue
            style = "-." if curve.kind == "free" else ":"
            ax.plot(curve.frequency, curve.amplitude, color="0.35", linewidth=0.9, linestyle=style, label=curve.kind)
        for i, (curve, colour) in enumerate(zip(tracking, colours(len(tracking)))):
            label = labels[i] if labels is not None else _engineering(curve.preload)
            _draw_tracking(ax, curve, colour, MARKERS[i % len(MARKERS)], label)
            for part in curve.left_out:
                ax.axvspan(part.low, part.high, color=colour, alpha=0.25, linewidth=0.6)
        if any(unstable_points(c).any() for c in tracking):
            ax.plot([], [], color="k", linestyle=(0, (3, 1.5)), label="unstable")
        if any(len(c) and c.peak_at_end for c in tracking):
            ax.plot([], [], "o", color="k", markersize=5.0, markerfacecolor="w", markeredgewidth=0.6,
                    label="highest at the end of the interval")
        if any(c.left_out for c in tracking):
            ax.fill([], [], color="0.5", alpha=0.25, label="not followed")
        if logarithmic:
            ax.set_yscale("log")
        ax.set_xlabel("Frequency (Hz)")
        ax.set_ylabel("Response amplitude (m)")
        if title:
            ax.set_title(title, fontsize=9.0)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(ncols=2, fontsize=7.0)
    return ax


@draws(Curve)
def plot_curve(curve: Curve, ax: Axes | None = None, **style: Any) -> Axes:
    """Amplitude over frequency for one curve; ``style`` as for :func:`plot_curves`."""
    return plot_curves([curve], ax, **style)


@draws(LawComparison)
def plot_laws(comparison: LawComparison, ax: Axes | None = None, **style: Any) -> Axes:
    """Curves under several friction laws in one picture; ``style`` as for :func:`plot_curves`."""
    return plot_curves(comparison.curves, ax, labels=comparison.laws, **style)


@draws(Microslip)
def plot_microslip(microslip: Microslip) -> Figure:
    """Force over displacement of first loading."""
    ax = new_axes()
    ax.plot(1e6 * microslip.displacement, microslip.force, "o-")
    ax.set_xlabel("Displacement (µm)")
    ax.set_ylabel("Force (N)")
    return ax.figure  # type: ignore[return-value]


@draws(Measurement)
def plot_measurement(
    measurement: Measurement, ax: Axes | None = None, scale: float | None = None, **style: Any
) -> Axes:
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
    with plt.rc_context(PAPER):
        axes = new_axes() if ax is None else ax
        look = {"linestyle": "none", "marker": "o", "markersize": 3.0, "markerfacecolor": "none", "color": "0.3"}
        axes.plot(measurement.frequency, factor * measurement.amplitude, **{**look, "label": measurement.name, **style})
        if ax is None:
            axes.set_xlabel("Frequency (Hz)")
            axes.set_ylabel("Response amplitude (m)")
        axes.legend(ncols=2, fontsize=7.0)
    return axes


@draws(ImportReport)
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
            right.add_collection3d(Line3DCollection(1e3 * mesh.points[edges], colors=["0.6", "0.2"][k % 2], linewidths=0.4))
        points = [1e3 * face.points for face in report.model.interfaces.values()]
        for k, (name, face) in enumerate(report.model.interfaces.items()):
            right.scatter(*(1e3 * face.points).T, s=6, color=colours(max(len(points), 2))[k], label=name, depthshade=False)
        shown = [1e3 * mesh.points for mesh in report.model.meshes.values()] or points
        if shown:
            low, high = np.concatenate(shown).min(axis=0), np.concatenate(shown).max(axis=0)
            right.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
            right.set_box_aspect(np.maximum(high - low, 1e-3 * np.ptp([low, high])))
        right.set(xlabel="X (mm)", ylabel="Y (mm)", zlabel="Z (mm)")
        right.legend(loc="upper left", bbox_to_anchor=(0.9, 1.0), fontsize=7.0)
        _room_for_ticks(right)
    return figure


@draws(OptimalCurve)
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
            if others.any():
                ax.plot(result.peak_preload[others], result.peak_amplitude[others], ".", color="0.65", markersize=2.5,
                        label="other peaks")
        for first, last in _unbroken(result.branch):
            part = slice(first, last + 1)
            alone = "." if first == last else None
            ax.plot(result.preload[part], result.amplitude[part], "-", color=dark, marker=alone)
            right.plot(result.preload[part], result.shift_percent[part], "--", color=light, marker=alone)
        ax.plot([], [], "-", color=dark, label="amplitude")
        ax.plot([], [], "--", color=light, label="frequency shift")
        o = result.optimum
        if np.isfinite(o.preload):
            what = {"end": "least at the end of the range", "jump": "optimum at a jump"}.get(o.kind, "optimum")
            ax.plot(o.preload, o.amplitude, "o", color=dark, markersize=4.5, markerfacecolor="w",
                    label=f"{what}, {_engineering(float(f'{o.preload:.3g}'))}")
        elif o.kind == "flat":
            ax.plot([], [], linestyle="none", label="flat: no optimum")
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


_UNITS = {
    "preload": "N", "amplitude": "m", "frequency": "Hz", "optimum_preload": "N", "optimum_amplitude": "m",
    "optimum_frequency": "Hz", "free_amplitude": "m", "free_frequency": "Hz", "stuck_amplitude": "m",
    "stuck_frequency": "Hz", "excitation.amplitude": "N", "excitation.phase": "rad", "major_frequency": "Hz",
}  # fmt: skip
"""Units of settings and answers of a sweep; what is not listed is a plain number or a name."""
_WORDS = {"amplitude": "resonance amplitude", "frequency": "resonance frequency", "stick": "share of stick",
          "slip": "share of slip", "open": "share of separation"}  # fmt: skip


def _with_unit(name: str) -> str:
    """Label of an axis for a setting or an answer of a sweep."""
    words = _WORDS.get(name, name.replace("_", " ").replace(".", " "))
    return words[:1].upper() + words[1:] + (f" ({_UNITS[name]})" if name in _UNITS else "")


def _named_value(name: str, value: Any) -> str:
    """A setting with its value and unit, for a legend."""
    number = f"{value:.4g}" if isinstance(value, float) else f"{value}"
    words = name.replace("_", " ").replace(".", " ")
    return f"{words} {number}" + (f" {_UNITS[name]}" if name in _UNITS else "")


@draws(SweepResult)
def plot_sweep(result: SweepResult, quantity: str = "amplitude", ax: Axes | None = None) -> Axes:
    """One answer of a sweep over its last setting, a line for each combination of the others.

    Parameters
    ----------
    result : SweepResult
    quantity : str
    ax : matplotlib axes, optional

    Returns
    -------
    matplotlib axes
    """
    values = result.array(quantity)
    if values.ndim != len(result.shape) or values.dtype.kind != "f":
        raise SettingError(f"quantity: expected one number for each point, found '{quantity}' of shape {values.shape}")
    with plt.rc_context(PAPER):
        if ax is None:
            ax = new_axes()
        name = result.names[-1]
        last = result.shape[-1]
        points = result.points[:last]
        x = [point[name] for point in points]
        numeric = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in x)
        rows = values.reshape(-1, last)
        for i, (row, colour) in enumerate(zip(rows, colours(len(rows)))):
            others = result.points[i * last]
            label = ", ".join(_named_value(key, others[key]) for key in result.names[:-1])
            ax.plot(x if numeric else [str(value) for value in x], row, color=colour,
                    marker=MARKERS[i % len(MARKERS)], markersize=3.0, label=label or None)
        if numeric and min(x) > 0.0 and max(x) > 20.0 * min(x):
            ax.set_xscale("log")
        ax.set_xlabel(_with_unit(name))
        ax.set_ylabel(_with_unit(quantity))
        if len(result.shape) > 1:
            ax.legend(fontsize=7.0)
    return ax


@draws(UncertainCurve)
def plot_uncertain(
    result: UncertainCurve,
    ax: Axes | None = None,
    *,
    quantity: str = "amplitude",
    bands: Sequence[tuple[float, float]] = ((5.0, 95.0), (25.0, 75.0)),
) -> Axes:
    """Percentile bands of optimal curves over the preload.

    Parameters
    ----------
    result : UncertainCurve
    ax : matplotlib axes, optional
    quantity : {"amplitude", "frequency"}
    bands : sequence of (low, high)
        Percentiles, the widest band first.

    Returns
    -------
    matplotlib axes
    """
    with plt.rc_context(PAPER):
        if ax is None:
            ax = new_axes()
        shades = np.linspace(0.85, 0.7, max(len(bands), 1))
        for (low, high), shade in zip(bands, shades):
            edge = result.percentile([low, high], quantity)
            ax.fill_between(result.preload, edge[0], edge[1], color=str(shade), linewidth=0.0,
                            label=f"{low:g} to {high:g} %")
        ax.plot(result.preload, result.percentile(50.0, quantity), color="0.1", label="median")
        ax.set_xscale("log")
        if quantity == "amplitude":
            ax.set_yscale("log")
        ax.set_xlabel("Preload (N)")
        ax.set_ylabel("Resonance amplitude (m)" if quantity == "amplitude" else "Resonance frequency (Hz)")
        ax.legend(fontsize=7.0)
    return ax


# ---- contact status ----

STATUS_NAMES = ("stick", "slip", "open")
STATUS_COLOURS = ("0.15", "#e6862a", "#cfe3ee")
"""Dark, middle and light: told apart in grey as well."""


def plot_status_bars(
    status: Any, points: Sequence[int], ax: Axes | None = None, *, direction: int = 0, title: str = ""
) -> Axes:
    """Space-time bars: the state of chosen contact points over one period, as in Fig. 16 of the paper.

    Parameters
    ----------
    status : ContactStatus
    points : sequence of int
        Indices of contact points, drawn from top to bottom.
    ax : matplotlib axes, optional
    direction : {0, 1}
        Tangential direction t1 or t2.
    title : str
    """
    points = validate.wholes("points", points, most=len(status.parts) - 1)
    direction = validate.whole("direction", direction, 0, 1)
    with plt.rc_context(PAPER):
        if ax is None:
            ax = new_axes(5.2, 0.9 + 0.32 * len(points))
        for row, point in enumerate(points):
            for start, end, state in status.parts[point][direction]:
                for shift in (0.0, -2.0 * np.pi):  # the last part may pass the end of the period
                    a, b = max(start + shift, 0.0), min(end + shift, 2.0 * np.pi)
                    if b > a:
                        ax.barh(
                            row,
                            (b - a) / (2.0 * np.pi),
                            left=a / (2.0 * np.pi),
                            height=0.62,
                            linewidth=0.4,
                            color=STATUS_COLOURS[state],
                            edgecolor="0.2",
                        )
        ax.set_yticks(
            range(len(points)), [f"{status.interface[p]} {p - status.rows(status.interface[p])[0] + 1}" for p in points]
        )
        ax.invert_yaxis()
        ax.set_xlim(0.0, 1.0)
        ax.set_xlabel("Time (periods)")
        ax.grid(False)
        if title:
            ax.set_title(title, fontsize=9.0)
        _status_legend(ax)
    return ax


def _status_legend(ax: Axes) -> None:
    handles = [Patch(facecolor=c, edgecolor="0.2", linewidth=0.4, label=n) for c, n in zip(STATUS_COLOURS, STATUS_NAMES)]
    ax.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=7.0)


def _face_coordinates(points: NDArray, frame: NDArray) -> tuple[NDArray, NDArray, float, float]:
    """Places (n,) of contact points outward along t1 and along Z, from the centre of their face (mm), and the spacing."""
    centred = points - points.mean(axis=0)
    outward = 1.0 if frame[0] @ (points.mean(axis=0) * [1.0, 1.0, 0.0]) >= 0.0 else -1.0
    x, y = 1e3 * outward * centred @ frame[0], 1e3 * np.sign(frame[1, 2] or 1.0) * centred @ frame[1]

    def step(values: NDArray) -> float:
        apart = np.diff(np.unique(np.round(values, 6)))
        return float(apart.min()) if len(apart) else 1.0

    return x, y, step(x), step(y)


def plot_status_map(
    status: Any,
    model: Any,
    interface: str,
    ax: Axes | None = None,
    *,
    instant: int | None = None,
    direction: int = 0,
    title: str = "",
) -> Axes:
    """Map of a contact face: what every point does over the period (bars by share), or at one instant.

    Parameters
    ----------
    status : ContactStatus
    model : Model
    interface : str
    ax : matplotlib axes, optional
    instant : int, optional
        Index into ``status.theta``; without it each point is divided by the shares of the period that it sticks, slips
        and is open.
    direction : {0, 1}
    title : str
    """
    validate.choice("interface", interface, [name for name in model.interfaces if name in status.interface])
    direction = validate.whole("direction", direction, 0, 1)
    if instant is not None:
        instant = validate.whole("instant", instant, -len(status.theta), len(status.theta) - 1)
    with plt.rc_context(PAPER):
        if ax is None:
            ax = new_axes(5.2, 2.4)
        face, rows = model.interfaces[interface], status.rows(interface)
        x, y, dx, dy = _face_coordinates(face.points, face.frame[0])
        share = status.share
        for i, row in enumerate(rows):
            left, bottom, width, height = y[i] - 0.45 * dy, x[i] - 0.45 * dx, 0.9 * dy, 0.9 * dx
            if instant is not None:
                ax.add_patch(
                    Rectangle(
                        (left, bottom),
                        width,
                        height,
                        facecolor=STATUS_COLOURS[status.state[row, direction, instant]],
                        edgecolor="0.2",
                        linewidth=0.4,
                    )
                )
                continue
            for state in range(3):
                part = width * share[row, direction, state]
                ax.add_patch(Rectangle((left, bottom), part, height, facecolor=STATUS_COLOURS[state], linewidth=0.0))
                left += part
            ax.add_patch(Rectangle((y[i] - 0.45 * dy, bottom), width, height, fill=False, edgecolor="0.2", linewidth=0.4))
        ax.set_xlim(y.min() - 0.6 * dy, y.max() + 0.6 * dy)
        ax.set_ylim(x.min() - 0.6 * dx, x.max() + 0.6 * dx)
        ax.set_aspect("equal")
        ax.set_xlabel("Along the axis (mm)")
        ax.set_ylabel("Outward (mm)")
        ax.grid(False)
        if title:
            ax.set_title(title, fontsize=9.0)
        _status_legend(ax)
    return ax


def _plot_faces(
    places: list[tuple[str, NDArray, NDArray]], values: list[NDArray], titles: list[str], label: str, unit: float
) -> Figure:
    """Values over several faces as coloured patches, one row for each kind, one column for each face."""
    n_rows, n_faces = len(values) // len(places), len(places)
    with plt.rc_context(PAPER):
        figure, axes = plt.subplots(n_rows, n_faces, figsize=(3.4 * n_faces, 1.7 * n_rows + 0.3), squeeze=False)
        for row in range(n_rows):
            block = values[row * n_faces : (row + 1) * n_faces]
            low, high = (float(f(np.concatenate(block) / unit)) for f in (np.nanmin, np.nanmax))
            norm = Normalize(low, high if high > low else low + 1.0)
            for column, ((name, points, frame), value) in enumerate(zip(places, block)):
                ax = axes[row, column]
                x, y, dx, dy = _face_coordinates(points, frame[0])
                for i, v in enumerate(value / unit):
                    colour = plt.get_cmap("viridis")(norm(v)) if np.isfinite(v) else (1.0, 1.0, 1.0, 1.0)
                    corner = (y[i] - 0.48 * dy, x[i] - 0.48 * dx)
                    ax.add_patch(Rectangle(corner, 0.96 * dy, 0.96 * dx, facecolor=colour, edgecolor="0.4", linewidth=0.3))
                ax.set_xlim(y.min() - 0.6 * dy, y.max() + 0.6 * dy)
                ax.set_ylim(x.min() - 0.6 * dx, x.max() + 0.6 * dx)
                ax.set_aspect("equal")
                ax.grid(False)
                ax.set_title(f"{name}, {titles[row]}" if titles[row] else name, fontsize=8.0)
                if row == n_rows - 1:
                    ax.set_xlabel("Along the axis (mm)")
                if column == 0:
                    ax.set_ylabel("Outward (mm)")
            figure.colorbar(plt.cm.ScalarMappable(norm, "viridis"), ax=axes[row].tolist(), label=label, shrink=0.9)
    return figure


@draws(ContactMap)
def plot_contact_map(contact: ContactMap, quantity: str = "pressure") -> Figure:
    """Pressure, gap or use of the friction limit over the friction faces; open points stay white.

    Parameters
    ----------
    contact : ContactMap
    quantity : {"pressure", "gap", "friction"}
    """
    choices = {
        "pressure": (np.where(contact.force[:, 2] > 0.0, contact.pressure, np.nan), "Pressure (MPa)", 1e6),
        "gap": (contact.distance, "Gap (um)", 1e-6),
        "friction": (
            np.where(contact.force[:, 2] > 0.0, contact.utilisation.max(axis=1), np.nan),
            "Friction force / limit",
            1.0,
        ),
    }
    if quantity not in choices:
        raise SettingError(f"quantity: expected one of {tuple(choices)}, found '{quantity}'")
    value, label, unit = choices[quantity]
    faces = [i for i in range(len(contact.interfaces)) if contact.friction[contact.owner == i].any()]
    faces = faces or list(range(len(contact.interfaces)))
    places = [(contact.interfaces[i], contact.points[contact.owner == i], contact.frame[contact.owner == i]) for i in faces]
    values = [value[contact.owner == i] for i in faces]
    if not np.isfinite(np.concatenate(values)).any():
        values = [np.zeros(len(v)) for v in values]
    return _plot_faces(places, values, [""], label, unit)


@draws(StiffnessComparison)
def plot_stiffness(comparison: StiffnessComparison, method: str = "eq4") -> Figure:
    """Contact stiffness per area over the faces, for t1, t2 and n; points of the fallback rule stay white."""
    if method not in comparison.stiffness:
        raise SettingError(f"method: expected one of {tuple(comparison.stiffness)}, found '{method}'")
    places = [(name, comparison.points[name], comparison.frame[name]) for name in comparison.interfaces]
    values = []
    for axis in range(3):
        for name in comparison.interfaces:
            contact = comparison.stiffness[method][name]
            value = contact.stiffness[:, axis] / comparison.area[name]
            if contact.fallback is not None and not contact.fallback[:, axis].all():
                value = np.where(contact.fallback[:, axis], np.nan, value)
            values.append(value)
    return _plot_faces(places, values, ["t1", "t2", "n"], "N/mm$^3$", 1e9)


def animate_damper(
    problem: Any,
    unknowns: NDArray,
    preload: float,
    path: Any,
    *,
    body: str | None = None,
    frames: int = 36,
    scale: float | None = None,
) -> float:
    """Write an animation (GIF) of the cross-section of a damper between its platforms, with the state of its contacts.

    The damper moves with its vibration; its mean displacement is left out.  Each contact point has a dot on the damper and
    one on the platform, which is drawn as a line through its dots.  They move against each other as the bodies do: along
    the face with the vibration, away from it by the gap where the point is open, all magnified alike.  Points in contact
    stay on the face, the little by which contact springs are pressed together is not drawn.

    Parameters
    ----------
    problem : Problem
    unknowns : (n_unknowns,) float
        Solution, for example ``curve.unknowns[curve.peak.index]``.
    preload : float, N
    path : path-like
        Ends with ``.gif``.
    body : str, optional
        The only free body by default.
    frames : int
        Pictures of one period.
    scale : float, optional
        Magnification of displacements; by default such that the largest is a tenth of the damper's height.

    Returns
    -------
    float
        The magnification.
    """
    from matplotlib.animation import PillowWriter

    figure, draw, scale = damper_picture(problem, unknowns, preload, body=body, frames=frames, scale=scale)
    with plt.rc_context({**PAPER, "figure.constrained_layout.use": False}):
        writer = PillowWriter(fps=12)
        with writer.saving(figure, path, dpi=90):
            for k in range(frames):
                draw(k)
                writer.grab_frame()
        plt.close(figure)
    return scale


def damper_picture(
    problem: Any,
    unknowns: NDArray,
    preload: float,
    *,
    body: str | None = None,
    frames: int = 36,
    scale: float | None = None,
) -> tuple[Figure, Callable[[int], dict[str, tuple[NDArray, NDArray]]], float]:
    """The picture that :func:`animate_damper` animates.

    Parameters
    ----------
    As for :func:`animate_damper`.

    Returns
    -------
    Figure
    callable
        Draws the instant ``k`` out of ``frames``; returns the places (n, 2) in mm of the dots on damper and platform, by
        interface.
    float
        The magnification.
    """
    from scipy.spatial import ConvexHull

    from bdamper.plot.motion import contact_status, relative_motion, rigid_displacement, rigid_motion

    frames = validate.whole("frames", frames, least=1)
    if scale is not None:
        scale = validate.number("scale", scale, above=0.0)
    model = problem.coupling.model  # with united contact points, if the study asks for that
    name = rigid_motion(problem, unknowns, body).body
    if name not in problem.model.meshes:
        have = list(problem.model.meshes)
        raise SettingError(f"animation: expected a mesh of '{name}' in the model, found meshes of {have}")
    part, mesh = problem.model.bodies[name], problem.model.meshes[name]
    status = contact_status(problem, unknowns, preload, frames)
    along, distance = relative_motion(problem, unknowns, preload, status.theta)
    y_axis = np.array([0.0, 1.0, 0.0]) if part.load is None else part.load.direction
    x_axis = np.cross(y_axis, [0.0, 0.0, 1.0])
    plane = np.stack([x_axis, y_axis], axis=1)
    wave = np.exp(1j * status.theta)

    def flat(place: NDArray) -> NDArray:
        return 1e3 * (place - part.centre) @ plane

    def moving(points: NDArray) -> NDArray:
        """(n_theta, n, 3) displacement of points of the damper."""
        return (rigid_displacement(problem, unknowns, name, points)[1] * wave[:, None, None]).real

    front = np.flatnonzero(mesh.points[:, 2] > mesh.points[:, 2].max() - 1e-9)
    outline = mesh.points[front[ConvexHull(flat(mesh.points[front])).vertices]]
    sides = {port: 1.0 if side == "a" else -1.0 for port, side in part.ports if model.interfaces[port].kind == "friction"}
    own = {port: moving(model.interfaces[port].points) for port in sides}
    other = {}
    for port, sign in sides.items():
        rows, frame = status.rows(port), model.interfaces[port].frame
        gap = np.maximum(distance[rows], 0.0)
        off = np.concatenate([along[rows], gap[:, None]], axis=1)  # (n, 3, n_theta) along t1, t2, n
        other[port] = own[port] + sign * np.einsum("pit,pix->tpx", off, frame)
    body_motion = moving(outline)
    height = float(np.ptp(flat(mesh.points)[:, 1]))
    largest = 1e3 * max(float(np.abs(d).max()) for d in (body_motion, *own.values(), *other.values()))
    if scale is None:
        scale = 0.1 * height / max(largest, 1e-300)
    factor = float(scale)
    with plt.rc_context({**PAPER, "figure.constrained_layout.use": False}):
        figure, (ax, *maps) = plt.subplots(
            1, 1 + len(sides), figsize=(3.0 + 1.7 * len(sides), 3.2), width_ratios=[2.4] + [1.0] * len(sides)
        )
        figure.subplots_adjust(left=0.08, right=0.99, bottom=0.16, top=0.84, wspace=0.35)
        head = "contact points: dark stick, orange slip, light open; lines: platforms"
        figure.text(0.5, 0.965, head, ha="center", va="top", fontsize=8.0)
        rest = flat(outline)
        ax.fill(*rest.T, facecolor="none", edgecolor="0.6", linewidth=0.8, linestyle=":")
        (shape,) = ax.fill(*rest.T, facecolor="0.85", edgecolor="0.2", linewidth=0.9)
        look = {"edgecolors": "0.2", "linewidths": 0.4, "zorder": 3}
        dots, lines = {}, {}
        for port in sides:
            places = flat(model.interfaces[port].points)
            (lines[port],) = ax.plot([], [], color="0.2", linewidth=1.6)
            dots[port] = ax.scatter(*places.T, s=14, **look), ax.scatter(*places.T, s=14, marker="s", **look)
        margin = 0.12 * height + factor * largest
        every = np.concatenate([rest, *(flat(model.interfaces[port].points) for port in sides)])
        ax.set_aspect("equal")
        ax.set_xlim(every[:, 0].min() - margin, every[:, 0].max() + margin)
        ax.set_ylim(every[:, 1].min() - margin, every[:, 1].max() + margin)
        ax.set_xlabel("X (mm)")
        ax.set_ylabel("Y (mm)")
        for panel, port in zip(maps, sides):
            plot_status_map(status, model, port, panel, instant=0, title=port)
            panel.set_aspect("auto")
            panel.get_legend().remove()
            panel.set_xlabel("Axis (mm)")
            panel.set_ylabel("Outward (mm)" if panel is maps[0] else "")

    def draw(k: int) -> dict[str, tuple[NDArray, NDArray]]:
        shape.set_xy(flat(outline + factor * body_motion[k]))
        ax.set_title(f"vibration x {factor:.0f}, phase {360 * k // frames} deg", fontsize=8.0)
        shown = {}
        for panel, port in zip(maps, sides):
            points = model.interfaces[port].points
            here, there = flat(points + factor * own[port][k]), flat(points + factor * other[port][k])
            colour = [STATUS_COLOURS[s] for s in status.state[status.rows(port), 0, k]]
            for dot, places in zip(dots[port], (here, there)):
                dot.set_offsets(places)
                dot.set_facecolor(colour)
            lines[port].set_data(*_line_through(there).T)
            for patch, one in zip(panel.patches, colour):
                patch.set_facecolor(one)
            shown[port] = here, there
        return shown

    return figure, draw, factor


def _line_through(places: NDArray) -> NDArray:
    """(2, 2) ends of the straight line nearest to points of a plane, a fifth longer than they are on either side."""
    centre = places.mean(axis=0)
    direction = np.linalg.svd(places - centre)[2][0]
    reach = 0.7 * float(np.ptp((places - centre) @ direction))
    return centre + np.outer([-reach, reach], direction)


# ---- structures in 3-D ----


def _parts_to_show(model: Any) -> list[tuple[str, int]]:
    """Bodies with a surface and the sectors in which the interfaces show them."""
    places = {(face.body_a, face.sector_a) for face in model.interfaces.values()}
    places |= {(face.body_b, face.sector_b) for face in model.interfaces.values()}
    return sorted(place for place in places if place[0] in model.meshes)


def _sector_turn(model: Any, sector: int) -> NDArray:
    angle = 2.0 * np.pi * sector / model.n_blades
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def plot_surfaces(
    surfaces: Sequence[tuple[NDArray, NDArray, Any]],
    points: NDArray | None = None,
    path: Any = None,
    *,
    backend: str | None = None,
    title: str = "",
) -> Any:
    """Draw surfaces of quadrilaterals in 3-D.

    Parameters
    ----------
    surfaces : sequence of (points (n, 3), quads (m, 4), colour)
        The colour is a matplotlib colour, alone or with its opacity, or a value for each point (n,).
    points : (k, 3) float, optional
        Marked by dots.
    path : path-like, optional
        Where to write a picture; nothing is shown then.
    backend : {"pyvista", "matplotlib"}, optional
        pyvista (extra ``bdamper[viz]``) if it is installed.
    title : str

    Returns
    -------
    pyvista.Plotter or matplotlib axes
    """
    if backend is None:
        from importlib.util import find_spec

        backend = "pyvista" if find_spec("pyvista") else "matplotlib"
    draw = {"pyvista": _surfaces_pyvista, "matplotlib": _surfaces_matplotlib}.get(backend)
    if draw is None:
        raise SettingError(f'backend: expected "pyvista" or "matplotlib", found {backend!r}')
    return draw(surfaces, points, path, title)


def _surfaces_pyvista(
    surfaces: Sequence[tuple[NDArray, NDArray, Any]], points: NDArray | None, path: Any, title: str
) -> Any:
    import pyvista

    plotter: Any = pyvista.Plotter(off_screen=path is not None, window_size=[1000, 1200])
    plotter.set_background("white")
    top = max((float(np.max(v)) for _, _, v in surfaces if isinstance(v, np.ndarray)), default=1.0)
    for place, quads, colour in surfaces:
        faces = np.hstack([np.full((len(quads), 1), 4), quads]).ravel()
        mesh = pyvista.PolyData(np.asarray(place, float), faces)
        if isinstance(colour, np.ndarray):
            mesh["amplitude"] = colour
            plotter.add_mesh(
                mesh,
                scalars="amplitude",
                cmap="viridis",
                clim=[0.0, top],
                show_edges=False,
                scalar_bar_args={"title": "amplitude", "color": "black"},
            )
        else:
            colour, opacity = colour if isinstance(colour, tuple) else (colour, 1.0)
            plotter.add_mesh(mesh, color=colour, opacity=opacity, show_edges=True, edge_color="#808080", line_width=0.5)
    if points is not None and len(points):
        plotter.add_points(np.asarray(points, float), color="#c0392b", point_size=7, render_points_as_spheres=True)
    if title:
        plotter.add_text(title, font_size=10, color="black")
    plotter.view_vector((0.9, 0.35, 0.9), viewup=(0.0, 1.0, 0.0))
    plotter.camera.zoom(1.05)
    if path is not None:
        plotter.screenshot(str(path))
    return plotter


def _surfaces_matplotlib(
    surfaces: Sequence[tuple[NDArray, NDArray, Any]], points: NDArray | None, path: Any, title: str
) -> Any:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    # the picture's axes are (Z, X, Y): Y up
    with plt.rc_context({**PAPER, "figure.constrained_layout.use": False}):
        figure = plt.figure(figsize=(4.2, 5.0))
        ax: Any = figure.add_axes((0.0, 0.16, 1.0, 0.79), projection="3d")
        top = max((float(np.max(v)) for _, _, v in surfaces if isinstance(v, np.ndarray)), default=1.0) or 1.0
        for place, quads, colour in surfaces:
            corner = 1e3 * np.asarray(place, float)[:, [2, 0, 1]][quads]
            if isinstance(colour, np.ndarray):
                face = plt.get_cmap("viridis")(colour[quads].mean(axis=1) / top)
            else:
                face = colour
            ax.add_collection3d(Poly3DCollection(corner, facecolors=face, edgecolors="0.4", linewidths=0.15, clip_on=False))
        if points is not None and len(points):
            ax.scatter(*(1e3 * np.asarray(points, float)[:, [2, 0, 1]].T), s=4.0, c="#c0392b", depthshade=False)
        every = 1e3 * np.concatenate([np.asarray(p, float)[:, [2, 0, 1]] for p, _, _ in surfaces])
        low, high = every.min(axis=0), every.max(axis=0)
        for setter, a, b in zip((ax.set_xlim, ax.set_ylim, ax.set_zlim), low, high):
            setter(a, b)
        ax.set_box_aspect(high - low)
        ax.set_xlabel("Z (mm)")
        ax.set_ylabel("X (mm)")
        ax.set_zlabel("Y (mm)")
        ax.view_init(elev=18.0, azim=-40.0)
        if title:
            ax.set_title(title, fontsize=9.0)
        _room_for_ticks(ax)
        if path is not None:
            save_figure(figure, path)
    return ax


def _room_for_ticks(ax: Any) -> None:
    """On the axes of a 3-D picture no more ticks than have room, and labels clear of them."""
    ax.tick_params(labelsize=6.5, pad=1.0)
    ax.tick_params(axis="z", pad=6.0)
    axes = (ax.xaxis, ax.yaxis, ax.zaxis)
    for axis in axes:
        axis.label.set_size(8.0)
    crowded = list(axes)
    for n in (5, 4, 3, 2, 1):
        for axis in crowded:
            axis.set_major_locator(MaxNLocator(n, min_n_ticks=1))
        ax.figure.draw_without_rendering()
        boxes = {axis: [t.get_window_extent().padded(2.0) for t in _tick_texts(axis)] for axis in axes}
        crowded = [axis for axis in axes if _overlap(boxes[axis])]
        for i, axis in enumerate(axes):
            if any(a.overlaps(b) for a in boxes[axis] for other in axes[:i] for b in boxes[other]):
                crowded.append(axis)
        if not crowded:
            break
    ticks = [t for axis in axes for t in _tick_texts(axis)]
    for i, axis in enumerate(axes):
        others = [*ticks, *(o.label for o in axes[:i])]
        for _ in range(12):
            box = axis.label.get_window_extent()
            if not any(box.overlaps(t.get_window_extent()) for t in others):
                break
            axis.labelpad += 3.0
            ax.figure.draw_without_rendering()


def _tick_texts(axis: Any) -> list[Any]:
    """Labels of the ticks of an axis that are drawn."""
    low, high = sorted(axis.get_view_interval())
    return [t.label1 for t in axis.get_major_ticks() if low <= t.get_loc() <= high and t.label1.get_text()]


def _overlap(boxes: list[Any]) -> bool:
    return any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


@draws(Model)
def plot_model(model: Any, path: Any = None, *, backend: str | None = None) -> Any:
    """Bodies at rest and contact points in 3-D; see `plot_surfaces`."""
    tint = {
        "constrained": ("#b9c6d2", 0.35),
        "free": ("#e8b563", 1.0),
        "ground": ("#cccccc", 1.0),
    }  # blades are transparent
    surfaces = [
        (model.meshes[name].points @ _sector_turn(model, sector).T, model.meshes[name].quads, tint[model.bodies[name].kind])
        for name, sector in _parts_to_show(model)
    ]
    if not surfaces:
        raise SettingError("plot of a model: expected at least one body with a mesh, found none")
    points = np.concatenate([face.points for face in model.interfaces.values()])
    return plot_surfaces(surfaces, points, path, backend=backend)


@draws(Model, "plot_mode")
def plot_mode(
    model: Any,
    mode: int = 1,
    path: Any = None,
    *,
    body: str | None = None,
    nodal_diameter: int | None = None,
    phase: float = 0.0,
    scale: float | None = None,
    backend: str | None = None,
) -> Any:
    """A mode of a constrained body in 3-D: deformed, coloured by the size of its amplitude.

    Parameters
    ----------
    model : Model
    mode : int
        From 1.
    path : path-like, optional
    body, nodal_diameter : optional
        The first that carry shapes.
    phase : float, rad
    scale : float, optional
        Magnification; by default the largest displacement is a twelfth of the body's size.
    backend : {"pyvista", "matplotlib"}, optional
    """
    mode = validate.whole("mode (the path is the third argument)", mode, least=1)
    carriers = [name for name, mesh in model.meshes.items() if mesh.modes]
    body = carriers[0] if body is None and carriers else body
    if body not in carriers:
        raise SettingError(f"plot of a mode: expected a body with mode shapes out of {carriers}, found {body!r}")
    mesh = model.meshes[body]
    d = next(iter(mesh.modes)) if nodal_diameter is None else nodal_diameter
    shapes = mesh.modes.get(d)
    if shapes is None or not 1 <= mode <= shapes.shape[2]:
        have = {key: value.shape[2] for key, value in mesh.modes.items()}
        raise SettingError(
            f"plot of a mode: expected one of the modes that the mesh carries, by nodal diameter {have}, "
            f"found mode {mode} of nodal diameter {d}"
        )
    shape = shapes[..., mode - 1]
    if scale is None:
        scale = float(np.ptp(mesh.points, axis=0).max()) / 12.0 / float(np.abs(shape).max())
    surfaces = []
    for name, sector in _parts_to_show(model):
        if name == body:
            turn = _sector_turn(model, sector)
            wave = np.exp(1j * (phase + 2.0 * np.pi * d * sector / model.n_blades))
            moved = mesh.points + scale * (shape * wave).real
            surfaces.append((moved @ turn.T, mesh.quads, np.linalg.norm(np.abs(shape), axis=1)))
    frequency = float(np.sqrt(model.bodies[body].bases[d].omega2[mode - 1])) / (2.0 * np.pi)
    return plot_surfaces(
        surfaces, None, path, backend=backend, title=f"mode {mode}, nodal diameter {d}: {frequency:.1f} Hz"
    )


def plot_rigid_motion(preload: NDArray, modal: NDArray, axes: Any, physical: NDArray, *, title: str = "") -> Any:
    """Rigid-body motion of a damper over preload: modal coefficients, metres and radians (Figs 12 and 13 of the paper).

    Parameters
    ----------
    preload : (n,) float, N
    modal, physical : (n, 6) float
        Sizes of the modal coefficients (kg^1/2 m), and of translations (m) and rotations (rad).
    axes : three matplotlib axes
    title : str
    """
    names = ("X translation", "Y translation", "Z translation", "X rotation", "Y rotation", "Z rotation")
    panels = (
        (modal, range(6), "Modal coefficient (kg$^{1/2}$ m)", 1.0),
        (physical, range(3), "Translation (µm)", 1e6),
        (physical, range(3, 6), "Rotation (mrad)", 1e3),
    )
    grey = colours(3)
    with plt.rc_context(PAPER):
        for ax, (values, columns, label, unit) in zip(axes, panels):
            for k in columns:
                ax.loglog(
                    preload,
                    unit * np.maximum(values[:, k], 1e-300),
                    color=grey[k % 3],
                    linestyle="-" if k < 3 else "--",
                    marker=MARKERS[k],
                    markersize=3.2,
                    markevery=2,
                    label=names[k],
                )
            shown = unit * values[:, list(columns)]
            top = float(shown.max())
            ax.set_ylim(max(float(shown[shown > 0.0].min()), 1e-5 * top) / 2.0, 2.0 * top)
            ax.set_xlabel("Preload (N)")
            ax.set_ylabel(label)
            ax.grid(True, color="0.9")
        handles, labels = axes[0].get_legend_handles_labels()
        axes[0].figure.legend(handles, labels, ncols=6, fontsize=7.0, loc="outside lower center")
        axes[1].set_title(title, fontsize=9.0)
    return axes


def plot_points_3d(model: Any, path: Any, values: NDArray, *, label: str = "") -> None:
    """Bodies as a wire picture and a value at each friction point, seen along the axis and on the face.

    Parameters
    ----------
    model : Model
    path : path-like
    values : (n_points,) float
        Of the first interface.
    label : str
        Of the colour bar.
    """
    face = next(iter(model.interfaces.values()))
    with plt.rc_context(PAPER):
        figure, (ax, on_face) = plt.subplots(1, 2, figsize=(7.0, 3.4), width_ratios=[1.0, 1.4])
        for name, sector in _parts_to_show(model):
            mesh = model.meshes[name]
            corner = 1e3 * (mesh.points @ _sector_turn(model, sector).T)
            front = mesh.quads[corner[mesh.quads, 2].min(axis=1) > corner[:, 2].max() - 1.0]
            for quad in front:
                ax.fill(*corner[quad, :2].T, facecolor="0.9", edgecolor="0.6", linewidth=0.3)
        points = 1e3 * face.points
        near = 12.0
        ax.plot(points[:, 0], points[:, 1], "k.", markersize=3.0)
        tangent = face.frame[0, 0]
        ends = 1e3 * face.points.mean(axis=0) + np.outer([-9.0, 9.0], tangent) + 0.4 * face.frame[0, 2]
        ax.plot(ends[:, 0], ends[:, 1], color="k", linewidth=1.6)
        ax.annotate("ground", ends[0, :2], textcoords="offset points", xytext=(4, -10), fontsize=8.0)
        ax.set_xlim(points[:, 0].min() - near - 8.0, points[:, 0].max() + near)
        ax.set_ylim(points[:, 1].min() - near - 4.0, points[:, 1].max() + near)
        ax.set_aspect("equal")
        ax.set_xlabel("X (mm)")
        ax.set_ylabel("Y (mm)")
        x, y, _, _ = _face_coordinates(face.points, face.frame[0])
        size = float(np.abs(values).max())
        dots = on_face.scatter(
            y, x, c=values, s=90.0, cmap="cividis", vmin=-0.1 * size, vmax=size, edgecolors="0.2", linewidths=0.5
        )
        closed = values > 0.0
        on_face.scatter(y[~closed], x[~closed], marker="x", s=30.0, c="w")
        on_face.set_xlabel("Along the axis (mm)")
        on_face.set_ylabel("Outward (mm)")
        on_face.set_aspect("equal")
        on_face.set_title("crosses: a gap at rest", fontsize=8.0)
        figure.colorbar(dots, ax=on_face, orientation="horizontal", label=label)
    save_figure(figure, path)


@draws(Verification)
def plot_verification(verification: Verification, ax: Axes | None = None) -> Axes:
    """One settled period in time beside the harmonic-balance solution."""
    ax = ax or new_axes()
    theta = 2.0 * np.pi * verification.frequency * verification.time
    l = np.arange(len(verification.expected))
    expected = (np.exp(1j * np.outer(theta, l)) @ verification.expected).real
    ax.plot(theta / (2.0 * np.pi), 1e6 * verification.response, label=f"time integration, {verification.periods} periods")
    ax.plot(theta / (2.0 * np.pi), 1e6 * expected, "--", label="harmonic balance")
    ax.set(xlabel="time, periods", ylabel="response, um", title=f"{verification.frequency:.6g} Hz")
    ax.legend()
    return ax


@draws(SettledResponse)
def plot_settled(settled: SettledResponse, ax: Axes | None = None) -> Axes:
    """Amplitude of each period of a marched response, with mean and range of the half that counts."""
    with plt.rc_context(PAPER):
        ax = new_axes() if ax is None else ax
        n = len(settled.amplitude)
        low, high = settled.range
        ax.fill_between([n // 2, n - 1], low, high, color="0.85", label="range")
        ax.plot(np.arange(n), settled.amplitude, color="0.2", linewidth=0.9, label="each period")
        ax.plot([n // 2, n - 1], [settled.mean] * 2, color="k", linestyle=(0, (3, 1.5)), label="mean")
        ax.set(xlabel="Period of the excitation", ylabel="Response amplitude (m)")
        ax.set_title(f"{settled.frequency:.6g} Hz, preload {_engineering(settled.preload)}", fontsize=9.0)
        ax.legend(fontsize=7.0)
    return ax


@draws(SettledResponse, "mark")
def mark_settled(settled: SettledResponse, ax: Axes) -> Axes:
    """Mean and range of a marched response as a point with a bar over response curves; one entry for all in the legend."""
    label = "time integration, mean and range"
    with plt.rc_context(PAPER):
        known = label in ax.get_legend_handles_labels()[1]
        low, high = settled.range
        bar = [[settled.mean - low], [high - settled.mean]]
        ax.errorbar(settled.frequency, settled.mean, yerr=bar, fmt="s", color="k", markersize=3.0, markerfacecolor="w",
                    capsize=2.0, linewidth=0.8, label=None if known else label)  # fmt: skip
        ax.legend(fontsize=7.0)
    return ax


@draws(Advice)
def plot_advice(advice: Advice, ax: Axes | None = None, *, title: str = "") -> Axes:
    """Bars of the changes that effects would make to a peak, if they were switched on.

    Parameters
    ----------
    advice : Advice
    ax : matplotlib axes, optional
    title : str

    Returns
    -------
    matplotlib axes
        Estimated changes of amplitude and frequency in percent, on a scale that is linear within the tolerance and
        logarithmic beyond; effects that must be on are hatched, the tolerance is a grey band.
    """
    with plt.rc_context(PAPER):
        if ax is None:
            ax = new_axes()
        effects = advice.effects[::-1]
        place = np.arange(len(effects))
        tolerance = 100.0 * advice.tolerance
        ax.axvspan(-tolerance, tolerance, color="0.9", zorder=0)
        dark, light = colours(2)
        handles: list[Any] = []
        for values, offset, colour, label in (
            ([e.amplitude_change for e in effects], 0.2, dark, "amplitude"),
            ([e.frequency_change for e in effects], -0.2, light, "frequency"),
        ):
            change = 100.0 * np.nan_to_num(np.array(values, float))
            bars = ax.barh(place + offset, change, height=0.38, facecolor=colour, edgecolor="k", linewidth=0.4)
            for bar, e in zip(bars, effects):
                if e.reliability == "must be on":
                    bar.set(hatch="////", edgecolor="0.65" if offset > 0.0 else "0.25")
            handles.append(Patch(facecolor=colour, edgecolor="k", linewidth=0.4, label=label))
        ax.set_xscale("symlog", linthresh=tolerance)
        ax.set_yticks(place, [e.name for e in effects])
        ax.axvline(0.0, color="k", linewidth=0.6)
        if any(e.reliability == "must be on" for e in effects):
            handles.append(Patch(facecolor="w", edgecolor="0.25", linewidth=0.4, hatch="////", label="must be on"))
        handles.append(Patch(facecolor="0.9", linewidth=0.0, label=f"tolerance, {tolerance:g} %"))
        ax.set_xlabel("Estimated change of the peak (%)")
        ax.set_title(title or f"{advice.preload:g} N, {advice.frequency:.4g} Hz", fontsize=9.0)
        ax.legend(handles=handles, fontsize=7.0)
    return ax


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
        if not np.isfinite(curve.optimum.preload):
            raise SettingError(f"curves: expected some with an optimum, found '{name}': {curve.optimum}")
    styles = ("-", "--", ":", "-.")
    fit = None
    with plt.rc_context(PAPER):
        if ax is None:
            ax = new_axes()
        for k, (name, curve) in enumerate(curves.items()):
            load = curve.preload / curve.optimum.preload
            value = curve.amplitude / curve.free.amplitude if quantity == "amplitude" else curve.shift_percent
            stuck = curve.stuck.amplitude / curve.free.amplitude if quantity == "amplitude" else curve.stuck_shift_percent
            colour = ("0.1", "0.1", colours(3)[1], "0.6")[k % 4]
            ax.plot(load, value, styles[k % 4], color=colour, label=name)
            ax.plot(load[-1] * 1.15, stuck, marker=8, color=colour, markersize=6.0, linestyle="none", clip_on=False)
        ax.plot([], [], marker=8, color="0.1", markersize=6.0, linestyle="none", label="stuck")
        if measured is not None:
            first = next(iter(curves.values()))
            prediction = first.preload / first.optimum.preload
            if quantity == "amplitude":
                load, value = measured.normalised("amplitude")
                shown, predicted = value, first.amplitude / first.free.amplitude
            else:  # the fit is that of frequencies: shifts start at zero
                load, value = measured.normalised("frequency")
                shown, predicted = 100.0 * (value - 1.0), 1.0 + first.shift_percent / 100.0
            load = load / first.optimum.preload
            ax.plot(load, shown, "s", color="0.1", markersize=4.0, markerfacecolor="w", label="measured")
            fit = goodness_of_fit(prediction, predicted, load, value)
            ax.set_title(str(fit), fontsize=8.0)
        ax.set_xscale("log")
        ax.set_xlabel("Load over optimum load")
        if quantity == "amplitude":
            ax.set_yscale("log")
            ax.set_ylabel("Amplitude over free amplitude")
        else:
            ax.set_ylabel("Frequency shift (%)")
        ax.legend()
    return ax, fit


@draws(AccuracyCost)
def plot_accuracy(result: AccuracyCost, ax: Axes | None = None, ladders: Sequence[str] | None = None) -> Axes:
    """Error over time of ladders of settings, with the Pareto front of each.

    Parameters
    ----------
    result : AccuracyCost
    ax : Axes, optional
    ladders : sequence of str, optional
        All by default; points of one that stands alone are named.
    """
    ax = ax or new_axes()
    names = list(ladders or result.ladders)
    floors = False
    for i, (name, colour) in enumerate(zip(names, colours(len(names)))):
        rungs = [r for r in result.ladder(name) if np.isfinite(r.error)]
        floor = max(result.reference(name).error, 1e-12) if np.isfinite(result.reference(name).error) else 1e-12
        time = np.array([1e3 * r.seconds for r in rungs])
        error = np.array([max(r.error, 0.3 * floor) for r in rungs])
        front = sorted((t, e) for t, e, r in zip(time, error, rungs) if r.pareto)
        ax.plot(time, error, MARKERS[i % len(MARKERS)], color=colour, markersize=4.5, label=name.replace("_", " "))
        if front:
            ax.step(*zip(*front), where="post", color=colour, linewidth=1.0)
        if floor > 1e-11:
            ax.axhline(floor, color=colour, linewidth=0.9, linestyle=":")
            floors = True
        if len(names) == 1:
            for r, t, e in zip(rungs, time, error):
                ax.annotate(r.name, (t, e), textcoords="offset points", xytext=(4, 3), fontsize=6.5)
    ax.axhline(result.tolerance, color="0.5", linewidth=0.8, linestyle="--", label=f"tolerance, {result.tolerance:g}")
    if floors:
        ax.plot([], [], color="0.2", linewidth=0.9, linestyle=":", label="error of the reference itself")
    ax.set(xscale="log", yscale="log", xlabel="Time (ms)", ylabel="Error of the peak, relative")
    if len(names) == 1:
        ax.margins(x=0.15)  # for the names
    few_ticks(ax)
    ax.legend(fontsize=7.0, frameon=False)
    return ax


def few_ticks(ax: Axes) -> None:
    """Plain numbers at 1, 2 and 5 on a logarithmic horizontal axis of less than two decades, decades alone beyond."""
    low, high = ax.get_xlim()
    if high < 100.0 * low:
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
