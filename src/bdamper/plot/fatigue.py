"""Stress over a cycle, Haigh diagram, margins over a quantity, and the critical location on the body."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from bdamper.fatigue.criteria import von_mises
from bdamper.fatigue.margin import MarginCurve, Margins
from bdamper.fatigue.material import LINES
from bdamper.fatigue.stress_cycle import StressCycle
from bdamper.model.stress_recovery import COMPONENTS
from bdamper.model.structure import Model
from bdamper.plot.axes import IN_TIME, NEW, OPTIMUM, STYLES, looks, once, picture
from bdamper.plot.column_plot import draw_table
from bdamper.plot.model3d import plot_surfaces, seen
from bdamper.util import validation
from bdamper.util.display import draws
from bdamper.util.tables import label as label_of

MEGA = 1e-6


def _star(ax: Axes, x: float, y: float, name: str) -> None:
    """Where the margin is decided."""
    ax.plot(x, y, "*", color=OPTIMUM, markeredgecolor="black", markersize=12.0, label=once(ax, name))


@picture(StressCycle)
def plot_stress(cycle: StressCycle, point: int | None = None, ax: Axes = NEW) -> None:
    """The components of the stress and its von Mises value over the cycle.

    Parameters
    ----------
    cycle : StressCycle
    point : int, optional
        The critical one by default.
    """
    i = cycle.critical if point is None else validation.whole("point", point, least=0, most=len(cycle) - 1)
    theta = np.linspace(0.0, 2.0 * np.pi, 721)
    stress = MEGA * cycle.over_cycle(theta)[i]
    large = np.abs(stress).max(axis=1) > 0.02 * np.abs(stress).max()
    for name, values, look, shown in zip(COMPONENTS, stress, looks(6), large):
        if shown:
            ax.plot(np.degrees(theta), values, **look, markevery=90, label=rf"$\sigma_{{{name}}}$")
    ax.plot(np.degrees(theta), von_mises(stress.T), color="black", linewidth=2.2, label="von Mises")
    title = f"{cycle.names[i]}, {cycle.frequency:.5g} Hz, {cycle.preload:g} N"
    ax.set(xlabel="Angle of the excitation (degrees)", ylabel="Stress (MPa)", title=title, xlim=(0.0, 360.0))
    ax.set_xticks(np.arange(0, 361, 60))


@picture(Margins)
def plot_haigh(margins: Margins, ax: Axes = NEW) -> None:
    """Haigh diagram: amplitude over mean of every point, with the lines of the material.

    The line of the margin is drawn in full, the others broken; points that margins leave out are hollow.
    """
    material, i, seen = margins.material, margins.critical, margins.counted
    right, low = material.ultimate_strength, min(0.0, 1.1 * float(margins.mean.min()))
    mean = np.linspace(low, right, 400)
    for line, colour, dashes in zip(LINES, ("black", "0.35", "0.6"), STYLES[1:]):
        style: dict[str, Any] = {"color": colour, "linestyle": dashes}
        if line == margins.rule.line and margins.rule.criterion != "findley":
            style = {"color": "black", "linewidth": 1.8}
        ax.plot(MEGA * mean, MEGA * material.allowed(mean, line), label=line.capitalize(), **style)
    yields = MEGA * np.array([0.0, material.yield_strength])
    ax.plot(yields, yields[::-1], color="0.75", linewidth=2.5, label="yield in the first cycle")
    at = MEGA * np.array([margins.mean, margins.amplitude])
    ax.plot(*at[:, seen], "o", color="0.3", markersize=4, label="points")
    if not seen.all():
        ax.plot(*at[:, ~seen], "o", color="0.3", markerfacecolor="none", markersize=4, label="next to contact")
    _star(ax, at[0, i], at[1, i], "critical")
    top = MEGA * max(material.endurance_limit, float(margins.amplitude.max()))
    ax.set(xlabel=label_of(Margins, "mean", "MPa"), ylabel=label_of(Margins, "amplitude", "MPa"), ylim=(0.0, 1.15 * top),
           xlim=(MEGA * low, 1.02 * MEGA * right), title=f"margin {margins.least:.3g} at {margins.names[i]}")  # fmt: skip


@picture(MarginCurve)
def plot_margin(curve: MarginCurve, ax: Axes = NEW, *, label: str = "margin") -> None:
    """The margin over frequency, preload, speed or another quantity, 1 is the limit; the amplitude on an axis at the right.

    Parameters
    ----------
    curve : MarginCurve
    ax : matplotlib axes, optional
        Several curves in the same axes differ by lightness, line and marker, and have no amplitudes but those of the first.
    label : str
        Name of the curve in the legend.
    """
    drawn = sum(line.get_gid() == "margin" for line in ax.lines)
    ax.set(xlabel=f"{curve.over.capitalize()} ({curve.unit})", xscale="log" if curve.over == "preload" else "linear")
    draw_table(ax, curve, "values", "margin", gid="margin", label=label, **looks(6)[drawn % 6])
    known = curve.margin[np.isfinite(curve.margin)]
    if len(known) and known.max() > 20.0 * known.min():
        ax.set_yscale("log")
    if np.isfinite(curve.best_value):
        _star(ax, curve.best_value, curve.best_margin, "best margin")
    if curve.in_time:
        preload, least = zip(*((m.preload, m.least) for m in curve.in_time))
        ax.plot(preload, least, "D", color=IN_TIME, markerfacecolor="w", label="of the highest blade in time")
    if not drawn:
        ax.axhline(1.0, color="0.4", linewidth=1.0)
        other = ax.twinx()
        other.plot(curve.values, curve.response, color="0.55", linestyle=STYLES[1], label="response")
        other.set(ylabel="Amplitude of the response, dash-dotted (m)", ylim=(0.0, None))
        other.grid(False)


@draws(Margins, "plot_critical")
def plot_critical(margins: Margins, model: Model) -> Axes:
    """The points on the surface of their body: lighter where the factor is larger, a star at the critical one.

    Parameters
    ----------
    margins : Margins
    model : Model
        With the surface of the body.
    """
    names = {name.rsplit(" ", 1)[0] for name in margins.names}
    bodies = sorted({model.stress[name].body for name in names if name in model.stress})
    meshes = [model.meshes[body] for body in bodies if body in model.meshes]
    validation.require(meshes, "model", f"the surface of {bodies or 'the body of the points'}", "none")
    i = margins.critical
    title = f"margin {margins.least:.3g} at {margins.names[i]}"
    axes = plot_surfaces([(mesh.points, mesh.quads, "#e4e4e4") for mesh in meshes], title=title)
    at = seen(margins.points)[:, :2]
    counted = margins.counted & (np.arange(len(margins)) != i)
    factor = np.log10(np.maximum(margins.factor[counted], 1e-3))
    axes.scatter(
        at[counted, 0], at[counted, 1], c=factor, cmap="gray", vmin=0.0, vmax=1.5, s=22, zorder=10, edgecolors="black"
    )
    axes.scatter(at[i, 0], at[i, 1], c=OPTIMUM, marker="*", s=170, zorder=11, edgecolors="black")
    return axes
