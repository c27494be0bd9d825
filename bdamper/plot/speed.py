"""Pictures over rotor speed: Campbell and interference diagrams, crossings, run-up.

Speeds are in revolutions per minute here, as machines show them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from bdamper.plot.axes import MARKERS, STYLES, colours, drawing
from bdamper.problem.at_speed import RPM
from bdamper.speed.campbell import Campbell
from bdamper.speed.crossings import Crossings, SpeedLine
from bdamper.speed.run_up import RunUp
from bdamper.util import validate
from bdamper.util.errors import SettingError
from bdamper.util.plotting import draws

SPEED = "Rotor speed (rpm)"


@draws(Campbell)
def plot_campbell(
    campbell: Campbell, ax: Axes | None = None, *, title: str = ""
) -> Axes:
    """Campbell diagram: free and stuck frequencies over speed, lines of engine orders, damped crossings.

    Parameters
    ----------
    campbell : Campbell
    ax : matplotlib axes, optional
    title : str

    Returns
    -------
    matplotlib axes
        Free modes are thin and solid, stuck ones dash-dotted; damped crossings are filled, those of free modes open circles
        and of stuck ones crosses.
    """
    orders = [int(o) for o in campbell.engine_order]
    diameters = sorted({campbell.met_by(o) for o in orders}) or campbell.nodal_diameter.tolist()
    known = [d for d in diameters if d in campbell.nodal_diameter]
    rpm, top = campbell.rpm, float(np.nanmax(campbell.stuck[[campbell.row(d) for d in known]]))
    with drawing(ax, size=(5.6, 4.2), title=title, legend=7.0) as ax:
        for d, colour in zip(known, colours(len(known))):
            k = campbell.row(d)
            label = f"free, nodal diameter {d}" if len(known) < 4 else "free" if d == known[0] else None
            ax.plot(rpm, campbell.free[k], "-", color=colour, linewidth=0.8, label=_first(label, campbell.free[k]))
            text = "stuck" if d == known[0] else None
            look: dict[str, Any] = {"linestyle": STYLES[1], "color": colour, "linewidth": 0.8}
            ax.plot(rpm, campbell.stuck[k], **look, label=_first(text, campbell.stuck[k]))
        _orders(ax, orders, campbell.speed, 1.05 * top)
        for row in range(len(campbell.order)):
            for speeds, marker in ((campbell.order_free, "o"), (campbell.order_stuck, "x")):
                place = speeds[row] * RPM, campbell.order[row] * speeds[row] / (2.0 * np.pi)
                if campbell.order[row] in orders:
                    ax.plot(*place, marker, color="0.35", markersize=3.5, markerfacecolor="w", zorder=3)
        _damped(ax, campbell, orders)
        ax.set(xlabel=SPEED, ylabel="Frequency (Hz)", xlim=(rpm[0], rpm[-1]), ylim=(0.0, 1.05 * top))
    return ax


def _first(label: str | None, lines: NDArray) -> Any:
    """A label for the first of several lines drawn together."""
    return [label, *[None] * (lines.shape[1] - 1)]


def _orders(ax: Axes, orders: list[int], speed: NDArray, top: float) -> None:
    """Lines of engine orders, each with its number where it leaves the picture."""
    for order in orders:
        end = min(float(speed[-1]), 2.0 * np.pi * top / order)
        ax.plot(np.array([0.0, end]) * RPM, [0.0, order * end / (2.0 * np.pi)], color="0.6", linewidth=0.7, zorder=1)
        place = (0.985 * end * RPM, 0.985 * order * end / (2.0 * np.pi))
        ax.annotate(f"EO {order}", place, fontsize=6.5, color="0.3", ha="right", va="bottom")


def _damped(ax: Axes, campbell: Campbell, orders: list[int]) -> None:
    """Damped crossings, by mass of the damper."""
    masses = sorted({float(f) for found in campbell.damped for f in found.mass_factor})
    shades = dict(zip(masses, colours(len(masses))))
    for found in campbell.damped:
        for i in np.flatnonzero(np.isin(found.engine_order, orders)):
            factor = float(found.mass_factor[i])
            label = f"damped, {1e3 * found.mass[i]:.3g} g"
            known = label in ax.get_legend_handles_labels()[1]
            marker = MARKERS[masses.index(factor) % len(MARKERS)]
            ax.plot(found.rpm[i], found.frequency[i], marker, color=shades[factor], markeredgecolor="k", markersize=5.0,
                    zorder=4, linestyle="none", label=None if known else label)  # fmt: skip


@draws(Campbell, "plot_safe")
def plot_safe(campbell: Campbell, speed: float | None = None, ax: Axes | None = None, *, title: str = "") -> Axes:
    """Interference (SAFE) diagram: modes over nodal diameter at one speed, with the line of the excitation.

    Parameters
    ----------
    campbell : Campbell
    speed : float, rad/s, optional
        The nearest of those that the diagram has; the highest by default.
    ax : matplotlib axes, optional
    title : str

    Returns
    -------
    matplotlib axes
        The excitation has the frequency ``EO Omega/(2 pi)`` at the nodal diameter that an order EO meets: a line that is
        folded back at half the number of blades.  A resonance is where a mode lies on it.
    """
    i = len(campbell.speed) - 1 if speed is None else int(np.argmin(np.abs(campbell.speed - speed)))
    omega, half = float(campbell.speed[i]), campbell.n_blades // 2
    d, free, stuck = campbell.nodal_diameter, campbell.free[:, i], campbell.stuck[:, i]
    top = 1.1 * float(np.nanmax(stuck))
    with drawing(ax, title=title or f"{omega * RPM:.0f} rpm", legend=7.0) as ax:
        most = max(int(2.0 * np.pi * top / omega), 1)
        orders = np.arange(most + 1)
        places = np.array([campbell.met_by(int(o)) for o in orders])
        ax.plot(places, orders * omega / (2.0 * np.pi), "-", color="0.6", linewidth=0.8, label="excitation", zorder=1)
        for order in campbell.engine_order.tolist():
            place = campbell.met_by(order), order * omega / (2.0 * np.pi)
            if place[1] <= top:
                ax.plot(*place, "s", color="0.6", markersize=3.0)
                ax.annotate(f" {order}", place, fontsize=6.5, color="0.3", va="top")
        for m, colour in enumerate(colours(free.shape[1])):
            ax.plot(d, free[:, m], marker=MARKERS[m % len(MARKERS)], markersize=4.0, color=colour, linewidth=0.6,
                    label=f"mode {m + 1}, free")  # fmt: skip
            ax.plot(d, stuck[:, m], marker=MARKERS[m % len(MARKERS)], markersize=4.0, color=colour, markerfacecolor="w",
                    linestyle=STYLES[1], linewidth=0.6, label="stuck" if m == 0 else None)  # fmt: skip
        ax.set(xlabel="Nodal diameter", ylabel="Frequency (Hz)", xlim=(-0.5, min(half, d.max() + 5) + 0.5), ylim=(0.0, top))
    return ax


@draws(Crossings)
def plot_crossings(
    found: Crossings,
    ax: Axes | None = None,
    *,
    quantity: str = "amplitude",
    title: str = "",
) -> Axes:
    """Amplitude or margin at the crossings over speed, a colour and marker for each mass of the damper.

    Parameters
    ----------
    found : Crossings
    ax : matplotlib axes, optional
    quantity : {"amplitude", "margin"}
    title : str

    Returns
    -------
    matplotlib axes
        Each crossing with its engine order; thin lines are the responses along the lines of the orders.
    """
    validate.choice("quantity", quantity, ("amplitude", "margin"))
    value = np.asarray(getattr(found, quantity))
    if quantity == "margin" and not np.isfinite(value).any():
        raise SettingError("quantity: expected crossings with a margin, found none; ask for it (margin=...)")
    masses = np.unique(found.mass_factor)
    with drawing(ax, title=title, legend=7.0) as ax:
        for j, (factor, colour) in enumerate(zip(masses, colours(len(masses)))):
            rows = np.flatnonzero(found.mass_factor == factor)
            rows = rows[np.argsort(found.speed[rows])]
            for i in rows:
                line: SpeedLine = found.lines[i]
                height = getattr(line, quantity)
                some = np.isfinite(height)
                ax.plot(line.speed[some] * RPM, height[some], color=colour, linewidth=0.5, alpha=0.6)
            ax.plot(found.rpm[rows], value[rows], marker=MARKERS[j % len(MARKERS)], markersize=5.0, color=colour,
                    linestyle="none", label=f"damper {1e3 * found.mass[rows[0]]:.3g} g")  # fmt: skip
            if j == len(masses) - 1:
                for i in rows[found.found[rows]]:
                    ax.annotate(f"EO {found.engine_order[i]}", (found.rpm[i], value[i]), fontsize=6.5, color="0.3",
                                textcoords="offset points", xytext=(4, 4))  # fmt: skip
        if quantity == "margin":
            ax.axhline(1.0, color="k", linewidth=0.8, linestyle="-")
        label = "Resonance amplitude (m)" if quantity == "amplitude" else "Margin against fatigue"
        ax.set(xlabel=SPEED, ylabel=label, yscale="log")
    return ax


@draws(RunUp)
def plot_run_up(result: RunUp, ax: Axes | None = None, *, title: str = "") -> Axes:
    """Amplitude over speed along the line of an engine order.

    Parameters
    ----------
    result : RunUp
    ax : matplotlib axes, optional
    title : str

    Returns
    -------
    matplotlib axes
        The highest point is a filled circle, the peak at fixed speed beside it an open square.
    """
    with drawing(ax, title=title or f"engine order {result.engine_order}", legend=7.0) as ax:
        ax.plot(result.rpm, result.amplitude, color="k", linewidth=1.0, label="run-up")
        ax.plot(result.peak_speed * RPM, result.peak_amplitude, "o", color="k", markersize=5.0, label="highest")
        ax.plot(result.fixed_speed * RPM, result.fixed_speed_amplitude, "s", color="0.4", markerfacecolor="none",
                markersize=7.0, label="peak at fixed speed", linestyle="none")  # fmt: skip
        ax.set(xlabel=SPEED, ylabel="Amplitude (m)")
    return ax
