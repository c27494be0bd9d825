"""Plots of rotor speed effects (Campbell, interference, crossings) and of fatigue (stress,
margins).

Speeds are in revolutions per minute.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

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
    """Plot a Campbell diagram: natural frequencies against rotor speed, engine order lines, and
    crossings.

    Free modes are solid lines with their numbers, stuck modes dash-dotted lines. Filled circles
    with the amplitude are damped crossings, open circles with the speed are crossings of free
    modes, and crosses are crossings of stuck modes.
    """
    orders = [int(order) for order in campbell.engine_order]
    excited = sorted({campbell.met_by(order) for order in orders})
    diameters = [
        diameter
        for diameter in excited or campbell.nodal_diameter.tolist()
        if diameter in campbell.nodal_diameter
    ]
    rows = np.array([campbell.row(diameter) for diameter in diameters], int)
    frequencies = np.nan_to_num([campbell.free[rows], campbell.stuck[rows]])
    top = 1.05 * float(frequencies.max(initial=1.0))
    for diameter, colour in zip(diameters, colours(len(diameters))):
        # a legend with many nodal diameters would be too long
        name = f"free, nodal diameter {diameter}" if len(diameters) < 4 else "free"
        _draw_modes(ax, campbell, diameter, name, colour)
    for order in orders:
        # the line ends at the highest speed or at the upper edge
        end = min(float(campbell.speed[-1]), 2.0 * np.pi * top / order)
        rpm = end * RPM
        frequency = order * end / (2.0 * np.pi)
        ax.plot([0.0, rpm], [0.0, frequency], color="0.6", linewidth=0.7, zorder=1)
        name_point(ax, f"EO {order}", (rpm, frequency))
    _draw_linear_crossings(ax, campbell)
    _draw_damped_crossings(ax, campbell, orders)
    # a row of met has order, mode, and the speeds of the crossings with free and stuck modes
    crossing_speeds = campbell.met[:, 2:]
    has_crossing = np.isfinite(crossing_speeds).any()
    if orders and diameters and not has_crossing:
        text = campbell._headline()
        # at the highest speed
        frequency_of_mode_1 = campbell.free[campbell.row(diameters[0]), -1, 0]
        rpm_of_crossing = 60.0 * frequency_of_mode_1 / orders[0]
        if np.isfinite(rpm_of_crossing):
            text += f" Order {orders[0]} may cross mode 1 near {rpm_of_crossing:.0f} rpm."
        note(ax, text, 0.05)
    rpm_ends = (campbell.speed[0] * RPM, campbell.speed[-1] * RPM)
    ax.set(xlabel=SPEED, ylabel="Frequency (Hz)", xlim=rpm_ends, ylim=(0.0, top))


def _draw_modes(ax: Axes, campbell: Campbell, diameter: int, name: str, colour: NDArray) -> None:
    """Draw the free and stuck frequencies of a nodal diameter; number the free modes."""
    row = campbell.row(diameter)
    rpm = campbell.speed * RPM
    free = campbell.free[row]
    lines = ax.plot(rpm, free, linestyle="-", color=colour, linewidth=0.8)
    lines[0].set_label(once(ax, name))
    for mode in np.flatnonzero(np.isfinite(free[0])):
        name_point(ax, f"mode {mode + 1}", (rpm[0], free[0, mode]), color=colour)
    lines = ax.plot(rpm, campbell.stuck[row], linestyle=STYLES[1], color=colour, linewidth=0.8)
    lines[0].set_label(once(ax, "stuck"))


def _draw_linear_crossings(ax: Axes, campbell: Campbell) -> None:
    """Mark the crossings with free modes, with their speed, and with stuck modes."""
    order, _, free_speed, stuck_speed = campbell.met.T
    for speed, marker in ((free_speed, "o"), (stuck_speed, "x")):
        rpm = speed * RPM
        frequency = order * speed / (2.0 * np.pi)
        ax.plot(rpm, frequency, marker, color="0.35", markersize=3.5, markerfacecolor="w", zorder=3)
        if speed is not free_speed:
            continue
        for x, y in zip(rpm, frequency):
            if np.isfinite(x):
                name_point(ax, f"{x:.0f} rpm", (x, y))


def _draw_damped_crossings(ax: Axes, campbell: Campbell, orders: Sequence[int]) -> None:
    """Mark the crossings with damping, with a look for each damper mass, and their amplitudes."""
    crossings = []
    for result in campbell.damped:
        crossings += list(zip(result.points, result.values))
    masses = sorted({point[MASS] for point, _ in crossings})
    look_of = dict(zip(masses, looks(len(masses))))
    for point, value in crossings:
        if not np.isfinite(value["speed"]) or point["engine_order"] not in orders:
            continue
        rpm = value["speed"] * RPM
        style = {
            **look_of[point[MASS]],
            "markersize": 5.0,
            "markeredgecolor": "k",
            "linestyle": "none",
            "zorder": 4,
            "label": once(ax, f"damped, {1e3 * value['mass']:.3g} g"),
        }
        ax.plot(rpm, value["frequency"], **style)
        name_point(ax, amount(value["amplitude"], "m"), (rpm, value["frequency"]))


@picture(Campbell, "plot_safe")
def plot_safe(campbell: Campbell, speed: float | None = None, ax: Axes = NEW) -> None:
    """Plot an interference (SAFE) diagram: natural frequencies against nodal diameter, and the
    excitation line.

    An engine order EO has the frequency ``EO Omega/(2 pi)`` at the nodal diameter that it excites:
    a line folded back at half the number of blades.  Resonances are modes on this line.

    Parameters
    ----------
    campbell : Campbell
    speed : float, rad/s, optional
        The nearest speed of the diagram is used; the highest by default.
    """
    i = len(campbell.speed) - 1
    if speed is not None:
        i = int(np.argmin(np.abs(campbell.speed - speed)))
    omega = float(campbell.speed[i])
    diameter = campbell.nodal_diameter
    free = campbell.free[:, i]
    stuck = campbell.stuck[:, i]
    top = 1.1 * float(np.nanmax(stuck))
    highest_order = max(int(2.0 * np.pi * top / omega), 1)
    orders = np.arange(highest_order + 1)
    excited = np.array([campbell.met_by(int(order)) for order in orders])
    ax.plot(
        excited,
        orders * omega / (2.0 * np.pi),
        "-",
        color="0.6",
        linewidth=0.8,
        label="excitation",
        zorder=1,
    )
    for order in campbell.engine_order.tolist():
        frequency = order * omega / (2.0 * np.pi)
        if frequency <= top:
            place = (campbell.met_by(order), frequency)
            ax.plot(*place, "s", color="k", markersize=7.0, markerfacecolor="none", zorder=4)
            name_point(ax, f"EO {order}", place)
    for mode, look in enumerate(looks(free.shape[1])):
        look |= {"markersize": 4.0, "linewidth": 0.6}
        free_look = {**look, "linestyle": "-"}
        stuck_look = {**look, "linestyle": STYLES[1], "markerfacecolor": "w"}
        ax.plot(diameter, free[:, mode], **free_look, label=f"mode {mode + 1}, free")
        ax.plot(diameter, stuck[:, mode], **stuck_look, label=once(ax, "stuck"))
    highest_diameter = campbell.n_blades // 2
    ax.set(
        xlabel="Nodal diameter",
        ylabel="Frequency (Hz)",
        xlim=(-0.5, min(highest_diameter, diameter.max() + 5) + 0.5),
        ylim=(0.0, top),
    )
    ax.set_title(f"{omega * RPM:.0f} rpm")


@picture(Crossings)
def plot_crossings(found: Crossings, ax: Axes = NEW, *, quantity: str = "amplitude") -> None:
    """Plot the amplitude or margin at crossings against speed, with a separate style for each
    damper mass.

    Parameters
    ----------
    found : Crossings
        Result of :meth:`bdamper.Study.resonance_crossings`.
    quantity : {"amplitude", "margin"}
    """
    validation.choice("quantity", quantity, ("amplitude", "margin"))
    # (damper masses, engine orders)
    value = found.array(quantity)
    speed = found.array("speed")
    mass = found.array("mass")
    if quantity == "margin" and not np.isfinite(value).any():
        raise SettingError("quantity: these crossings have no margin; compute them with margin=...")
    for omega, height, masses, look in zip(speed, value, mass, looks(len(value))):
        if np.isfinite(masses).any():
            style = {
                **look,
                "linestyle": "",
                "markersize": 5.0,
                "label": f"damper {1e3 * np.nanmax(masses):.3g} g",
            }
            ax.plot(omega * RPM, height, **style)
    # joins the masses of one engine order
    ax.plot(speed * RPM, value, color="0.7", linewidth=0.6, zorder=1)
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
    if point is None:
        row = cycle.critical
    else:
        row = validation.integer("point", point, least=0, most=len(cycle) - 1)
    theta = np.linspace(0.0, 2.0 * np.pi, 721)
    degrees = np.degrees(theta)
    stress = MEGA * cycle.over_cycle(theta)[row]
    # smaller components are not visible
    is_large = np.abs(stress).max(axis=1) > 0.02 * np.abs(stress).max()
    for name, values, look, is_drawn in zip(COMPONENTS, stress, looks(6), is_large):
        if is_drawn:
            label = rf"$\sigma_{{{name}}}$"
            ax.plot(degrees, values, **look, markevery=90, zorder=3, label=label)
    ax.plot(degrees, von_mises(stress.T), color="0.75", linewidth=3.0, label="von Mises")
    preload = amount(cycle.preload, "N")
    ax.set(
        xlabel="Angle of the excitation (degrees)",
        ylabel="Stress (MPa)",
        title=f"{cycle.names[row]}, {amount(cycle.frequency, 'Hz')}, preload {preload}",
        xlim=(0.0, 360.0),
    )
    ax.set_xticks(np.arange(0, 361, 60))


@picture(Margins)
def plot_haigh(margins: Margins, ax: Axes = NEW) -> None:
    """Plot a Haigh diagram: stress amplitude against mean stress, with the failure lines of the
    material.

    The line that defines the margin is thick, and the others are dashed. Points excluded from the
    margin are hollow.
    """
    material = margins.material
    rule = margins.rule
    left = min(0.0, 1.1 * float(margins.mean.min()))
    right = material.ultimate_strength
    mean = np.linspace(left, right, 400)
    for line, colour, dashes in zip(LINES[:3], ("black", "0.35", "0.6"), STYLES[1:]):
        style: dict[str, Any] = {"color": colour, "linestyle": dashes}
        if line == rule.line and rule.criterion != "findley":
            style = {"color": "black", "linewidth": 1.8}
        ax.plot(MEGA * mean, MEGA * material.allowed(mean, line), label=line.capitalize(), **style)
    if material.haigh is not None:
        width = 1.8 if rule.line == "table" else 0.9
        for temperature in material.haigh.temperatures:
            allowed = MEGA * material.allowed(mean, "table", temperature)
            label = f"table, {temperature:g} °C"
            ax.plot(MEGA * mean, allowed, color="tab:blue", linewidth=width, label=label)
    # amplitude and mean add up to the yield strength
    yields = MEGA * np.array([0.0, material.yield_strength])
    ax.plot(yields, yields[::-1], color="0.75", linewidth=2.5, label="yield in the first cycle")
    counted = margins.counted
    x = MEGA * margins.mean
    y = MEGA * margins.amplitude
    ax.plot(x[counted], y[counted], "o", color="0.3", markersize=4, label="points")
    if not counted.all():
        ax.plot(
            x[~counted],
            y[~counted],
            "o",
            color="0.3",
            markerfacecolor="none",
            markersize=4,
            label="next to contact",
        )
    i = margins.critical
    name = margins.names[i]
    _star(ax, x[i], y[i], "critical")
    name_point(ax, f"{name}: {x[i]:.3g} ± {y[i]:.3g} MPa", (x[i], y[i]))
    top = MEGA * max(material.endurance_limit, float(margins.amplitude.max()))
    ax.set(
        xlabel=label_of(Margins, "mean", "MPa"),
        ylabel=label_of(Margins, "amplitude", "MPa"),
        ylim=(0.0, 1.15 * top),
        xlim=(MEGA * left, 1.02 * max(MEGA * right, float(x.max()))),
        title=f"margin {margins.least:.3g} at {name}",
    )
    # marks on an axis are whole, lines end at the axes
    for drawn in ax.lines:
        drawn.set_clip_on(drawn.get_linestyle() != "None")


@picture(MarginCurve)
def plot_margin(curve: MarginCurve, ax: Axes = NEW, *, label: str = "margin") -> None:
    """Plot the margin against frequency, preload or speed, with the amplitude on a second axis.

    Parameters
    ----------
    curve : MarginCurve
    ax : matplotlib axes, optional
        Several curves in the same axes differ in lightness, line style and marker; the amplitude is
        drawn only for the first curve.
    label : str
        Name of the curve in the legend.
    """
    n_drawn = sum(line.get_gid() == "margin" for line in ax.lines)
    ax.set(
        xlabel=f"{curve.over.capitalize()} ({curve.unit})",
        xscale="log" if curve.over == "preload" else "linear",
    )
    look = looks(6)[n_drawn % 6]
    draw_table(ax, curve, "values", "margin", gid="margin", label=label, **look)
    known = curve.margin[np.isfinite(curve.margin)]
    if not len(known):
        note(ax, curve._headline())
    elif known.max() > 20.0 * known.min():
        ax.set_yscale("log")
    if np.isfinite(curve.best_value):
        best = (curve.best_value, curve.best_margin)
        _star(ax, *best, "best margin")
        text = f"{curve.best_margin:.3g} at {amount(curve.best_value, curve.unit)}"
        name_point(ax, text, best, color=OPTIMUM)
        ax.margins(y=0.15)
    if curve.in_time:
        preload = [margins.preload for margins in curve.in_time]
        least = [margins.least for margins in curve.in_time]
        ax.plot(
            preload,
            least,
            "D",
            color=IN_TIME,
            markerfacecolor="w",
            label="time integration, highest blade",
        )
    if n_drawn > 0:
        return
    ax.axhline(1.0, color="0.4", linewidth=1.0, label="limit")
    right = ax.twinx()
    right.plot(curve.values, curve.response, color="0.55", linestyle=STYLES[1], label="response")
    right.set(ylabel="Response amplitude, dash-dotted (m)", ylim=(0.0, None))
    right.grid(False)


@register_plot(Margins, "plot_critical")
def plot_critical(margins: Margins, model: Model) -> Axes:
    """Plot the stress points on the surface of their body, with a star at the critical one.

    The lighter a point, the larger its safety factor.

    Parameters
    ----------
    margins : Margins
    model : Model
        Model with the surface of the body.
    """
    # the last two words of a name number the point within its stress set
    sets = {name.rsplit(" ", 2)[0] for name in margins.names}
    bodies = sorted({model.stress[name].body for name in sets if name in model.stress})
    meshes = [model.meshes[body] for body in bodies if body in model.meshes]
    validation.check(meshes, "model", f"a mesh of {bodies or 'the body of the points'}", "none")
    i = margins.critical
    title = f"margin {margins.least:.3g} at {margins.names[i]}"
    axes = plot_surfaces([(mesh.points, mesh.quads, "#e4e4e4") for mesh in meshes], title=title)
    x, y, _ = seen(margins.points).T
    is_other = margins.counted & (np.arange(len(margins)) != i)
    factor = np.maximum(margins.factor[is_other], 1e-3)
    with plt.rc_context(STYLE):
        dots = axes.scatter(
            x[is_other],
            y[is_other],
            c=np.log10(factor),
            cmap="gray",
            vmin=0.0,
            vmax=1.5,
            s=14,
            zorder=10,
            edgecolors="black",
        )
        axes.scatter(x[i], y[i], c=OPTIMUM, marker="*", s=90, zorder=11, edgecolors="black")
        bar = axes.figure.colorbar(dots, ax=axes, label="Factor of safety", shrink=0.6)
        bar.set_ticks([0.0, 0.5, 1.0, 1.5], labels=["1", "3", "10", "30"])
    return axes
