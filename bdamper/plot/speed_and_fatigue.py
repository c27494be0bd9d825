"""Plots over rotor speed (Campbell, interference, crossings) and of fatigue (stress, margins).

Speeds are in revolutions per minute.
"""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from bdamper.analyses.campbell import Campbell
from bdamper.analyses.crossings import Crossings
from bdamper.fatigue.criteria import LINES, von_mises
from bdamper.fatigue.margin import MarginCurve, Margins
from bdamper.fatigue.stress_cycle import StressCycle
from bdamper.harmonic_balance.parameters import MASS
from bdamper.harmonic_balance.rotor_speed import RPM
from bdamper.model.structure import COMPONENTS, Model
from bdamper.plot.axes import (
    COLUMN,
    IN_TIME,
    NEW,
    OPTIMUM,
    STYLE,
    STYLES,
    colours,
    looks,
    name_point,
    note,
    once,
    picture,
)
from bdamper.plot.bodies import plot_surfaces, seen
from bdamper.plot.studies import draw_table
from bdamper.util import validation
from bdamper.util.display import register_plot
from bdamper.util.errors import SettingError
from bdamper.util.formatting import amount
from bdamper.util.tables import axis_label as label_of

# ---- Rotor speed ----

SPEED = "Rotor speed (rpm)"


@picture(Campbell, size=(COLUMN, 3.2))
def plot_campbell(campbell: Campbell, ax: Axes = NEW) -> None:
    """Plot a Campbell diagram: frequencies over speed, engine order lines, and crossings.

    Free modes are solid, stuck ones dash-dotted; the free ones have their numbers.  Crossings with
    damping are filled and have their amplitude, crossings with free modes are open circles and have
    their speed, with stuck modes crosses.
    """
    orders = [int(o) for o in campbell.engine_order]
    diameters = sorted({campbell.met_by(o) for o in orders}) or campbell.nodal_diameter.tolist()
    known = [d for d in diameters if d in campbell.nodal_diameter]
    shown = np.array([campbell.row(d) for d in known], int)
    heights = np.nan_to_num([campbell.free[shown], campbell.stuck[shown]])
    rpm, top = campbell.speed * RPM, 1.05 * float(heights.max(initial=1.0))
    for d, colour in zip(known, colours(len(known))):
        k, name = campbell.row(d), f"free, nodal diameter {d}" if len(known) < 4 else "free"
        for label, lines, style in (
            (name, campbell.free[k], "-"),
            ("stuck", campbell.stuck[k], STYLES[1]),
        ):
            drawn = ax.plot(rpm, lines, linestyle=style, color=colour, linewidth=0.8)
            drawn[0].set_label(once(ax, label))
            for m in np.flatnonzero(np.isfinite(lines[0]) & (style == "-")):
                name_point(ax, f"mode {m + 1}", (rpm[0], lines[0, m]), color=colour)
    for order in orders:
        end = min(float(campbell.speed[-1]), 2.0 * np.pi * top / order)
        x, y = end * RPM, order * end / (2.0 * np.pi)
        ax.plot([0.0, x], [0.0, y], color="0.6", linewidth=0.7, zorder=1)
        name_point(ax, f"EO {order}", (x, y))
    met, _, *both = campbell.met.T
    for speeds, marker in zip(both, "ox"):
        frequency = met * speeds / (2.0 * np.pi)
        ax.plot(
            speeds * RPM,
            frequency,
            marker,
            color="0.35",
            markersize=3.5,
            markerfacecolor="w",
            zorder=3,
        )
        for x, y in zip(speeds * RPM, frequency):
            if marker == "o" and np.isfinite(x):
                name_point(ax, f"{x:.0f} rpm", (x, y))
    damped = [pair for result in campbell.damped for pair in zip(result.points, result.values)]
    masses = sorted({point[MASS] for point, _ in damped})
    for point, value in damped:
        if np.isfinite(value["speed"]) and point["engine_order"] in orders:
            look = looks(len(masses))[masses.index(point[MASS])]
            look |= {"markersize": 5.0, "markeredgecolor": "k", "linestyle": "none", "zorder": 4}
            look["label"] = once(ax, f"damped, {1e3 * value['mass']:.3g} g")
            ax.plot(value["speed"] * RPM, value["frequency"], **look)
            name_point(
                ax, amount(value["amplitude"], "m"), (value["speed"] * RPM, value["frequency"])
            )
    if orders and known and not np.isfinite(np.array(both)).any():
        met_at = 60.0 * campbell.free[campbell.row(known[0]), -1, 0] / orders[0]
        near = (
            f" Order {orders[0]} may cross mode 1 near {met_at:.0f} rpm."
            if np.isfinite(met_at)
            else ""
        )
        note(ax, campbell._headline() + near, 0.05)
    ax.set(xlabel=SPEED, ylabel="Frequency (Hz)", xlim=(rpm[0], rpm[-1]), ylim=(0.0, top))


@picture(Campbell, "plot_safe")
def plot_safe(campbell: Campbell, speed: float | None = None, ax: Axes = NEW) -> None:
    """Plot an interference (SAFE) diagram: modes over nodal diameter and the excitation line.

    An engine order EO has the frequency ``EO Omega/(2 pi)`` at the nodal diameter that it excites:
    a line folded back at half the number of blades.  Resonances are modes on this line.

    Parameters
    ----------
    campbell : Campbell
    speed : float, rad/s, optional
        The nearest speed of the diagram is used; the highest by default.
    """
    i = len(campbell.speed) - 1 if speed is None else int(np.argmin(np.abs(campbell.speed - speed)))
    omega, half, d = float(campbell.speed[i]), campbell.n_blades // 2, campbell.nodal_diameter
    free, stuck = campbell.free[:, i], campbell.stuck[:, i]
    top = 1.1 * float(np.nanmax(stuck))
    orders = np.arange(max(int(2.0 * np.pi * top / omega), 1) + 1)
    folded = np.array([campbell.met_by(int(o)) for o in orders])
    ax.plot(
        folded,
        orders * omega / (2.0 * np.pi),
        "-",
        color="0.6",
        linewidth=0.8,
        label="excitation",
        zorder=1,
    )
    for order in campbell.engine_order.tolist():
        position = campbell.met_by(order), order * omega / (2.0 * np.pi)
        if position[1] <= top:
            ax.plot(*position, "s", color="k", markersize=7.0, markerfacecolor="none", zorder=4)
            name_point(ax, f"EO {order}", position)
    for m, look in enumerate(looks(free.shape[1])):
        look |= {"markersize": 4.0, "linewidth": 0.6}
        ax.plot(d, free[:, m], **{**look, "linestyle": "-"}, label=f"mode {m + 1}, free")
        ax.plot(
            d,
            stuck[:, m],
            **{**look, "linestyle": STYLES[1]},
            markerfacecolor="w",
            label=once(ax, "stuck"),
        )
    ax.set(
        xlabel="Nodal diameter",
        ylabel="Frequency (Hz)",
        xlim=(-0.5, min(half, d.max() + 5) + 0.5),
        ylim=(0.0, top),
    )
    ax.set_title(f"{omega * RPM:.0f} rpm")


@picture(Crossings)
def plot_crossings(found: Crossings, ax: Axes = NEW, *, quantity: str = "amplitude") -> None:
    """Plot amplitude or margin at crossings over speed, with a look for each damper mass.

    Parameters
    ----------
    found : Crossings
        Result of :meth:`bdamper.Study.resonance_crossings`.
    quantity : {"amplitude", "margin"}
    """
    validation.choice("quantity", quantity, ("amplitude", "margin"))
    value, speed, mass = (found.array(name) for name in (quantity, "speed", "mass"))
    if quantity == "margin" and not np.isfinite(value).any():
        raise SettingError("quantity: these crossings have no margin; compute them with margin=...")
    for omega, height, masses, look in zip(speed, value, mass, looks(len(value))):
        if np.isfinite(masses).any():
            look |= {
                "linestyle": "",
                "markersize": 5.0,
                "label": f"damper {1e3 * np.nanmax(masses):.3g} g",
            }
            ax.plot(omega * RPM, height, **look)
    ax.plot(
        speed * RPM, value, color="0.7", linewidth=0.6, zorder=1
    )  # joins the masses of one engine order
    for point, omega, height in zip(found.points, speed[-1], value[-1]):
        if np.isfinite(omega):
            name_point(ax, f"EO {point['engine_order']}", (omega * RPM, height))
    ax.margins(x=0.1)
    if quantity == "margin":
        ax.axhline(1.0, color="k", linewidth=0.8, linestyle="-")
    label = "Resonance amplitude (m)" if quantity == "amplitude" else "Margin against fatigue"
    ax.set(xlabel=SPEED, ylabel=label, yscale="log")


# ---- Fatigue ----

MEGA = 1e-6


def _star(ax: Axes, x: float, y: float, name: str) -> None:
    """Mark the point that determines the margin."""
    ax.plot(x, y, "*", color=OPTIMUM, markeredgecolor="black", markersize=9.0, label=once(ax, name))


@picture(StressCycle)
def plot_stress(cycle: StressCycle, point: int | None = None, ax: Axes = NEW) -> None:
    """Plot the stress components and the von Mises stress over a cycle.

    Parameters
    ----------
    cycle : StressCycle
    point : int, optional
        The critical point by default.
    """
    i = (
        cycle.critical
        if point is None
        else validation.integer("point", point, least=0, most=len(cycle) - 1)
    )
    theta = np.linspace(0.0, 2.0 * np.pi, 721)
    stress = MEGA * cycle.over_cycle(theta)[i]
    large = np.abs(stress).max(axis=1) > 0.02 * np.abs(stress).max()
    for name, values, look, plotted in zip(COMPONENTS, stress, looks(6), large):
        if plotted:
            ax.plot(
                np.degrees(theta),
                values,
                **look,
                markevery=90,
                zorder=3,
                label=rf"$\sigma_{{{name}}}$",
            )
    ax.plot(np.degrees(theta), von_mises(stress.T), color="0.75", linewidth=3.0, label="von Mises")
    title = f"{cycle.names[i]}, {cycle.frequency:.5g} Hz, preload {amount(cycle.preload, 'N')}"
    ax.set(
        xlabel="Angle of the excitation (degrees)",
        ylabel="Stress (MPa)",
        title=title,
        xlim=(0.0, 360.0),
    )
    ax.set_xticks(np.arange(0, 361, 60))


@picture(Margins)
def plot_haigh(margins: Margins, ax: Axes = NEW) -> None:
    """Plot a Haigh diagram: stress amplitude over mean stress, with the lines of the material.

    The line that defines the margin is thick, the others are broken.  Points excluded from the
    margin are hollow.
    """
    material, i, counted = margins.material, margins.critical, margins.counted
    right, low = material.ultimate_strength, min(0.0, 1.1 * float(margins.mean.min()))
    mean = np.linspace(low, right, 400)
    for line, colour, dashes in zip(LINES, ("black", "0.35", "0.6"), STYLES[1:]):
        style: dict[str, Any] = {"color": colour, "linestyle": dashes}
        if line == margins.rule.line and margins.rule.criterion != "findley":
            style = {"color": "black", "linewidth": 1.8}
        ax.plot(MEGA * mean, MEGA * material.allowed(mean, line), label=line.capitalize(), **style)
    yields = MEGA * np.array([0.0, material.yield_strength])
    ax.plot(yields, yields[::-1], color="0.75", linewidth=2.5, label="yield in the first cycle")
    points = MEGA * np.array([margins.mean, margins.amplitude])
    ax.plot(*points[:, counted], "o", color="0.3", markersize=4, label="points")
    if not counted.all():
        ax.plot(
            *points[:, ~counted],
            "o",
            color="0.3",
            markerfacecolor="none",
            markersize=4,
            label="next to contact",
        )
    _star(ax, points[0, i], points[1, i], "critical")
    name_point(
        ax,
        f"{margins.names[i]}: {points[0, i]:.3g} ± {points[1, i]:.3g} MPa",
        (points[0, i], points[1, i]),
    )
    top = MEGA * max(material.endurance_limit, float(margins.amplitude.max()))
    ax.set(xlabel=label_of(Margins, "mean", "MPa"), ylabel=label_of(Margins, "amplitude", "MPa"), ylim=(0.0, 1.15 * top),
           xlim=(MEGA * low, 1.02 * max(MEGA * right, float(points[0].max()))),
           title=f"margin {margins.least:.3g} at {margins.names[i]}")  # fmt: skip
    for drawn in ax.lines:
        drawn.set_clip_on(drawn.get_linestyle() != "None")  # marks on an axis are whole


@picture(MarginCurve)
def plot_margin(curve: MarginCurve, ax: Axes = NEW, *, label: str = "margin") -> None:
    """Plot the margin over frequency, preload or speed, with the amplitude on a second axis.

    Parameters
    ----------
    curve : MarginCurve
    ax : matplotlib axes, optional
        Several curves in the same axes differ by lightness, line and marker; only the first has its
        amplitude.
    label : str
        Name of the curve in the legend.
    """
    drawn = sum(line.get_gid() == "margin" for line in ax.lines)
    ax.set(
        xlabel=f"{curve.over.capitalize()} ({curve.unit})",
        xscale="log" if curve.over == "preload" else "linear",
    )
    draw_table(ax, curve, "values", "margin", gid="margin", label=label, **looks(6)[drawn % 6])
    if not np.isfinite(curve.margin).any():
        note(ax, curve._headline())
    known = curve.margin[np.isfinite(curve.margin)]
    if len(known) and known.max() > 20.0 * known.min():
        ax.set_yscale("log")
    if np.isfinite(curve.best_value):
        _star(ax, curve.best_value, curve.best_margin, "best margin")
        name_point(ax, f"{curve.best_margin:.3g} at {amount(curve.best_value, curve.unit)}",
                   (curve.best_value, curve.best_margin), color=OPTIMUM)  # fmt: skip
        ax.margins(y=0.15)
    if curve.in_time:
        preload, least = zip(*((m.preload, m.least) for m in curve.in_time))
        ax.plot(
            preload, least, "D", color=IN_TIME, markerfacecolor="w", label="highest blade in time"
        )
    if not drawn:
        ax.axhline(1.0, color="0.4", linewidth=1.0, label="limit")
        right = ax.twinx()
        right.plot(
            curve.values, curve.response, color="0.55", linestyle=STYLES[1], label="response"
        )
        right.set(ylabel="Response amplitude, dash-dotted (m)", ylim=(0.0, None))
        right.grid(False)


@register_plot(Margins, "plot_critical")
def plot_critical(margins: Margins, model: Model) -> Axes:
    """Plot the stress points on the surface of their body: the lighter, the larger the safety factor; a star at the
    critical one.

    Parameters
    ----------
    margins : Margins
    model : Model
        Model with the surface of the body.
    """
    names = {name.rsplit(" ", 2)[0] for name in margins.names}
    bodies = sorted({model.stress[name].body for name in names if name in model.stress})
    meshes = [model.meshes[body] for body in bodies if body in model.meshes]
    validation.check(meshes, "model", f"a mesh of {bodies or 'the body of the points'}", "none")
    i = margins.critical
    title = f"margin {margins.least:.3g} at {margins.names[i]}"
    axes = plot_surfaces([(mesh.points, mesh.quads, "#e4e4e4") for mesh in meshes], title=title)
    x, y, _ = seen(margins.points).T
    counted = margins.counted & (np.arange(len(margins)) != i)
    factor = np.log10(np.maximum(margins.factor[counted], 1e-3))
    look: dict[str, Any] = {
        "cmap": "gray",
        "vmin": 0.0,
        "vmax": 1.5,
        "s": 14,
        "zorder": 10,
        "edgecolors": "black",
    }
    with plt.rc_context(STYLE):
        dots = axes.scatter(x[counted], y[counted], c=factor, **look)
        axes.scatter(x[i], y[i], c=OPTIMUM, marker="*", s=90, zorder=11, edgecolors="black")
        bar = axes.figure.colorbar(dots, ax=axes, label="Factor of safety", shrink=0.6)
        bar.set_ticks([0.0, 0.5, 1.0, 1.5], labels=["1", "3", "10", "30"])
    return axes
