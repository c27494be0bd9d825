"""Pictures over rotor speed: Campbell and interference diagrams, crossings, run-up.

Speeds are in revolutions per minute here, as machines show them.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from bdamper.analyses.campbell import Campbell
from bdamper.analyses.sweep import SweepResult
from bdamper.harmonic_balance.rotor_speed import RPM
from bdamper.plot.axes import NEW, STYLES, colours, looks, once, picture
from bdamper.util import validation
from bdamper.util.errors import SettingError

SPEED = "Rotor speed (rpm)"


@picture(Campbell, size=(5.6, 4.2))
def plot_campbell(campbell: Campbell, ax: Axes = NEW) -> None:
    """Campbell diagram: free and stuck frequencies over speed, lines of engine orders, damped crossings.

    Free modes are thin and solid, stuck ones dash-dotted; damped crossings are filled, those of free modes open circles and
    of stuck ones crosses.
    """
    orders = [int(o) for o in campbell.engine_order]
    diameters = sorted({campbell.met_by(o) for o in orders}) or campbell.nodal_diameter.tolist()
    known = [d for d in diameters if d in campbell.nodal_diameter]
    rpm, top = campbell.speed * RPM, 1.05 * float(np.nanmax(campbell.stuck[[campbell.row(d) for d in known]]))
    for d, colour in zip(known, colours(len(known))):
        k, name = campbell.row(d), f"free, nodal diameter {d}" if len(known) < 4 else "free"
        for label, lines, style in ((name, campbell.free[k], "-"), ("stuck", campbell.stuck[k], STYLES[1])):
            drawn = ax.plot(rpm, lines, linestyle=style, color=colour, linewidth=0.8)
            drawn[0].set_label(once(ax, label))
    _orders(ax, orders, campbell.speed, top)
    order, _, *both = campbell.met.T
    for speeds, marker in zip(both, "ox"):
        place = speeds * RPM, order * speeds / (2.0 * np.pi)
        ax.plot(*place, marker, color="0.35", markersize=3.5, markerfacecolor="w", zorder=3)
    damped = [pair for found in campbell.damped for pair in zip(found.points, found.values)]
    masses = sorted({at["damper_mass"] for at, _ in damped})
    for at, value in damped:
        if value and at["engine_order"] in orders:
            look = looks(len(masses))[masses.index(at["damper_mass"])]
            look |= {"markersize": 5.0, "markeredgecolor": "k", "linestyle": "none", "zorder": 4}
            look["label"] = once(ax, f"damped, {1e3 * value['mass']:.3g} g")
            ax.plot(value["speed"] * RPM, value["frequency"], **look)
    ax.set(xlabel=SPEED, ylabel="Frequency (Hz)", xlim=(rpm[0], rpm[-1]), ylim=(0.0, top))


def _orders(ax: Axes, orders: list[int], speed: NDArray, top: float) -> None:
    """Lines of engine orders, each with its number where it leaves the picture."""
    for order in orders:
        end = min(float(speed[-1]), 2.0 * np.pi * top / order)
        ax.plot(np.array([0.0, end]) * RPM, [0.0, order * end / (2.0 * np.pi)], color="0.6", linewidth=0.7, zorder=1)
        place = (0.985 * end * RPM, 0.985 * order * end / (2.0 * np.pi))
        ax.annotate(f"EO {order}", place, fontsize=6.5, color="0.3", ha="right", va="bottom")


@picture(Campbell, "plot_safe")
def plot_safe(campbell: Campbell, speed: float | None = None, ax: Axes = NEW) -> None:
    """Interference (SAFE) diagram: modes over nodal diameter at one speed, with the line of the excitation.

    The excitation has the frequency ``EO Omega/(2 pi)`` at the nodal diameter that an order EO meets: a line that is folded
    back at half the number of blades.  A resonance is where a mode lies on it.

    Parameters
    ----------
    campbell : Campbell
    speed : float, rad/s, optional
        The nearest of those that the diagram has; the highest by default.
    """
    i = len(campbell.speed) - 1 if speed is None else int(np.argmin(np.abs(campbell.speed - speed)))
    omega, half, d = float(campbell.speed[i]), campbell.n_blades // 2, campbell.nodal_diameter
    free, stuck = campbell.free[:, i], campbell.stuck[:, i]
    top = 1.1 * float(np.nanmax(stuck))
    orders = np.arange(max(int(2.0 * np.pi * top / omega), 1) + 1)
    places = np.array([campbell.met_by(int(o)) for o in orders])
    ax.plot(places, orders * omega / (2.0 * np.pi), "-", color="0.6", linewidth=0.8, label="excitation", zorder=1)
    for order in campbell.engine_order.tolist():
        place = campbell.met_by(order), order * omega / (2.0 * np.pi)
        if place[1] <= top:
            ax.plot(*place, "s", color="0.6", markersize=3.0)
            ax.annotate(f" {order}", place, fontsize=6.5, color="0.3", va="top")
    for m, look in enumerate(looks(free.shape[1])):
        look |= {"markersize": 4.0, "linewidth": 0.6}
        ax.plot(d, free[:, m], **{**look, "linestyle": "-"}, label=f"mode {m + 1}, free")
        ax.plot(d, stuck[:, m], **{**look, "linestyle": STYLES[1]}, markerfacecolor="w", label=once(ax, "stuck"))
    ax.set(xlabel="Nodal diameter", ylabel="Frequency (Hz)", xlim=(-0.5, min(half, d.max() + 5) + 0.5), ylim=(0.0, top))
    ax.set_title(f"{omega * RPM:.0f} rpm")


@picture(SweepResult, "crossings")
def plot_crossings(found: SweepResult, ax: Axes = NEW, *, quantity: str = "amplitude") -> None:
    """Amplitude or margin at the crossings over speed, a colour and marker for each mass of the damper.

    Each crossing has its engine order.

    Parameters
    ----------
    found : SweepResult
        As :meth:`bdamper.Study.crossings` returns it.
    quantity : {"amplitude", "margin"}
    """
    validation.choice("quantity", quantity, ("amplitude", "margin"))
    value, speed, mass = (found.array(name) for name in (quantity, "speed", "mass"))
    if quantity == "margin" and not np.isfinite(value).any():
        raise SettingError("quantity: expected crossings with a margin, found none; ask for it (margin=...)")
    for omega, height, own, look in zip(speed, value, mass, looks(len(value))):
        look |= {"linestyle": "", "markersize": 5.0, "label": f"damper {1e3 * np.nanmax(own):.3g} g"}
        ax.plot(omega * RPM, height, **look)
    for at, omega, height in zip(found.points, speed[-1], value[-1]):
        if np.isfinite(omega):
            ax.annotate(f"EO {at['engine_order']}", (omega * RPM, height), fontsize=6.5, color="0.3",
                        textcoords="offset points", xytext=(4, 4))  # fmt: skip
    if quantity == "margin":
        ax.axhline(1.0, color="k", linewidth=0.8, linestyle="-")
    label = "Resonance amplitude (m)" if quantity == "amplitude" else "Margin against fatigue"
    ax.set(xlabel=SPEED, ylabel=label, yscale="log")
