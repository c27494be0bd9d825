"""Stress over a cycle, Haigh diagram, margins over a quantity, and the critical location on the body."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from bdamper.fatigue.criteria import von_mises
from bdamper.fatigue.cycle import StressCycle
from bdamper.fatigue.margin import MarginCurve, Margins
from bdamper.fatigue.material import LINES
from bdamper.model.model import Model
from bdamper.model.stress import COMPONENTS
from bdamper.plot.axes import MARKERS, PAPER, STYLES, colours, drawing, legend_beside, save_figure
from bdamper.plot.model3d import plot_surfaces
from bdamper.util import validate
from bdamper.util.plotting import draws
from bdamper.util.tables import label as label_of

MEGA = 1e-6


@draws(StressCycle)
def plot_stress(cycle: StressCycle, point: int | None = None, ax: Axes | None = None) -> Axes:
    """The components of the stress and its von Mises value over the cycle.

    Parameters
    ----------
    cycle : StressCycle
    point : int, optional
        The critical one by default.
    ax : matplotlib axes, optional
    """
    i = cycle.critical if point is None else validate.whole("point", point, least=0, most=len(cycle) - 1)
    theta = np.linspace(0.0, 2.0 * np.pi, 721)
    stress = MEGA * cycle.over_cycle(theta)[i]
    with drawing(ax, title=f"{cycle.names[i]}, {cycle.frequency:.5g} Hz, {cycle.preload:g} N", legend=7.5) as axes:
        large = np.abs(stress).max(axis=1) > 0.02 * np.abs(stress).max()
        for name, values, dashes, colour, shown in zip(COMPONENTS, stress, STYLES, colours(6), large):
            if shown:
                axes.plot(np.degrees(theta), values, color=colour, linestyle=dashes, label=rf"$\sigma_{{{name}}}$")
        axes.plot(np.degrees(theta), von_mises(stress.T), color="black", linewidth=2.2, label="von Mises")
        axes.set_xlim(0.0, 360.0)
        axes.set_xticks(np.arange(0, 361, 60))
        axes.set(xlabel="Angle of the excitation (degrees)", ylabel="Stress (MPa)")
    return axes


@draws(Margins)
def plot_haigh(margins: Margins, ax: Axes | None = None) -> Axes:
    """Haigh diagram: amplitude over mean of every point, with the lines of the material.

    The line of the margin is drawn in full, the others broken; points that margins leave out are hollow.
    """
    material, i = margins.material, margins.critical
    title = f"margin {margins.least:.3g} at {margins.names[i]}"
    with drawing(ax, title=title, legend=7.5) as axes:
        right = material.ultimate_strength
        low = min(0.0, 1.1 * float(margins.mean.min()))
        mean = np.linspace(low, right, 400)
        for line, colour, dashes in zip(LINES, ("black", "0.35", "0.6"), STYLES[1:]):
            chosen = line == margins.rule.line and margins.rule.criterion != "findley"
            style: dict[str, Any] = {"color": colour, "linestyle": dashes}
            if chosen:
                style = {"color": "black", "linewidth": 1.8}
            axes.plot(MEGA * mean, MEGA * material.allowed(mean, line), label=line.capitalize(), **style)
        yields = np.array([0.0, material.yield_strength])
        axes.plot(MEGA * yields, MEGA * yields[::-1], color="0.75", linewidth=2.5, label="yield in the first cycle")
        seen = margins.counted
        axes.plot(MEGA * margins.mean[seen], MEGA * margins.amplitude[seen], "o", color="0.3", markersize=4, label="points")
        if not seen.all():
            style = {"color": "0.3", "markerfacecolor": "none", "markersize": 4}
            axes.plot(MEGA * margins.mean[~seen], MEGA * margins.amplitude[~seen], "o", label="next to contact", **style)
        at = MEGA * margins.mean[i], MEGA * margins.amplitude[i]
        axes.plot(*at, "*", color="#c0392b", markeredgecolor="black", markersize=13, label="critical")
        top = max(material.endurance_limit, float(margins.amplitude.max()))
        axes.set_ylim(0.0, 1.15 * MEGA * top)
        axes.set_xlim(MEGA * low, 1.02 * MEGA * right)
        axes.set(xlabel=label_of(Margins, "mean", "MPa"), ylabel=label_of(Margins, "amplitude", "MPa"))
    return axes


@draws(MarginCurve)
def plot_margin(
    curve: MarginCurve, ax: Axes | None = None, *, label: str = "", response: bool | None = None
) -> Axes:
    """The margin over frequency, preload, speed or another quantity; 1 is the limit.

    Parameters
    ----------
    curve : MarginCurve
    ax : matplotlib axes, optional
        Several curves in the same axes differ by lightness, line and marker.
    label : str
        Name of the curve in the legend.
    response : bool, optional
        Draw also the amplitude of the response, on an axis at the right; by default where there are no axes given.
    """
    with_response = ax is None if response is None else response
    with drawing(ax) as axes:
        k = sum(line.get_gid() == "margin" for line in axes.lines)
        few = len(curve) <= 60
        (line,) = axes.plot(
            curve.values, curve.margin, color=colours(6)[k % 6], linestyle=STYLES[k % len(STYLES)],
            marker=MARKERS[k % len(MARKERS)] if few else None, markersize=4, label=label or "margin",
        )  # fmt: skip
        line.set_gid("margin")
        if np.isfinite(curve.best_value):
            best = curve.best_value, curve.best_margin
            axes.plot(*best, "*", color="#c0392b", markeredgecolor="black", markersize=12, label="best margin")
        if curve.in_time:
            preload, least = zip(*((m.preload, m.least) for m in curve.in_time))
            axes.plot(preload, least, "D", color="tab:green", markerfacecolor="w", label="of what a blade keeps in time")
        if k == 0:
            axes.axhline(1.0, color="0.4", linewidth=1.0)
            axes.set_xlabel(f"{curve.over.capitalize()} ({curve.unit})")
            axes.set_ylabel(label_of(MarginCurve, "margin"))
        if curve.over == "preload":
            axes.set_xscale("log")
        known = curve.margin[np.isfinite(curve.margin)]
        if k == 0 and len(known) and known.max() > 20.0 * known.min():
            axes.set_yscale("log")
        if with_response:
            other = axes.twinx()
            other.plot(curve.values, curve.response, color="0.55", linestyle=STYLES[1], label="response")
            other.set_ylabel("Amplitude of the response, dash-dotted (m)")
            other.set_ylim(bottom=0.0)
            other.grid(False)
        if label or np.isfinite(curve.best_value):
            legend_beside(axes)
    return axes


@draws(Margins, "plot_critical")
def plot_critical(margins: Margins, model: Model, path: Any = None) -> Any:
    """The points on the surface of their body in 3-D: lighter where the factor is larger, a star at the critical one.

    Parameters
    ----------
    margins : Margins
    model : Model
        With the surface of the body.
    path : path-like, optional
        Where to write the picture.
    """
    names = {name.rsplit(" ", 1)[0] for name in margins.names}
    bodies = sorted({model.stress[name].body for name in names if name in model.stress})
    meshes = [model.meshes[body] for body in bodies if body in model.meshes]
    validate.require(meshes, "model", f"the surface of {bodies or 'the body of the points'}", "none")
    surfaces = [(mesh.points, mesh.quads, ("#d0d0d0", 0.25)) for mesh in meshes]
    i = margins.critical
    title = f"margin {margins.least:.3g} at {margins.names[i]}"
    axes = plot_surfaces(surfaces, title=title)
    at = 1e3 * margins.points[:, [2, 0, 1]]
    seen = margins.counted & (np.arange(len(margins)) != i)
    with plt.rc_context(PAPER):
        shown = axes.scatter(
            *at[seen].T, c=np.log10(np.maximum(margins.factor[seen], 1e-3)), cmap="gray", vmin=0.0, vmax=1.5, s=22,
            edgecolors="black", depthshade=False,
        )  # fmt: skip
        axes.scatter(*at[i : i + 1].T, c="#c0392b", marker="*", s=170, edgecolors="black", depthshade=False)
        shown.set_zorder(10)
    if path is not None:
        save_figure(axes, path)
    return axes
