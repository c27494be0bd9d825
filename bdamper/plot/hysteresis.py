"""Cycles of the contacts: loops of force over displacement, histories, and the energy that is lost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from bdamper.effects.hysteresis import AXES, WHOLE, Dissipation, Hysteresis
from bdamper.plot.axes import MARKERS, STYLES, colours, drawing, given_axes, runs, stacked
from bdamper.plot.contact import plot_faces
from bdamper.util import validate
from bdamper.util.plotting import draws
from bdamper.util.tables import label
from bdamper.util.text import amount

SMALLEST = 1e-4
"""Energy that is shown, relative to the largest."""
NAMES = {"t1": "in the face along t1", "t2": "in the face along t2", "n": "normal to the face"}
OF_WHOLE = {"xlabel": "Motion of the response (m)", "ylabel": "All contact forces as one force there (N)"}
"""Labels of the loop of all contacts."""


def _name(result: Hysteresis, where: int | str) -> str:
    """A contact point as a face and the number within it, a face by its name."""
    if isinstance(where, str):
        return f"{where} face" if where != WHOLE else "all contacts"
    face = result.interface[where]
    return f"{face} face, point {where - int(result.rows(face)[0]) + 1}"


@draws(Hysteresis)
def plot_hysteresis(
    result: Hysteresis,
    where: int | str | Sequence[int | str] = WHOLE,
    ax: Axes | None = None,
    *,
    direction: str = "t1",
    title: str = "",
) -> Axes:
    """Loops of force over displacement.

    Parameters
    ----------
    result : Hysteresis
    where : int, str or sequence of these
        Contact points by index, faces by name, or "whole": the force at the response location that does the work of all
        contacts, over the response.
    ax : matplotlib axes, optional
    direction : {"t1", "t2", "n"}
        Of points and faces.
    title : str

    Returns
    -------
    matplotlib axes
    """
    places = [where] if isinstance(where, (int, np.integer, str)) else list(where)
    if not places or (WHOLE in places and len(places) > 1):
        raise validate.unfit("where", f'contact points and faces, or "{WHOLE}" alone', where)
    loops = [result.loop(place, direction) for place in places]
    whole = places == [WHOLE]
    lost: dict[Any, float] = {WHOLE: result.lost, **result.by_interface, **dict(enumerate(result.energy))}
    title = title or f"Friction over a cycle at {result.frequency:.4g} Hz, preload {amount(result.preload, 'N')}"
    with drawing(ax, title=title, legend=7.0 if len(places) > 1 else None) as ax:
        for i, ((x, f), colour, place) in enumerate(zip(loops, colours(len(loops)), places)):
            name = _name(result, place)
            if direction != "n" or whole:
                name += f",\nloses {amount(lost[place], 'J')} a cycle{'' if whole else ' in all directions'}"
            ax.plot(x, f, linestyle=STYLES[i % len(STYLES)], color=colour, label=name)
        of = f"{NAMES[direction]}{'' if len(places) > 1 else f', {_name(result, places[0])}'}"
        ax.set(**OF_WHOLE if whole else {"xlabel": f"Motion {of} (m)", "ylabel": f"Force {of} (N)"})
    return ax


@draws(Hysteresis, "history")
def plot_history(result: Hysteresis, where: int, *, title: str = "") -> NDArray:
    """Forces, vibration and gap of one contact point over a cycle.

    Parameters
    ----------
    result : Hysteresis
    where : int
        Index of the point.
    title : str

    Returns
    -------
    array of two matplotlib axes
    """
    i = validate.whole("where, index of a contact point", where, 0, len(result.points) - 1)
    time = result.theta / (2.0 * np.pi)
    top, bottom = stacked(4.4)
    title = title or f"{_name(result, i)}, {result.frequency:.5g} Hz, preload {amount(result.preload, 'N')}"
    shades = colours(3)
    with drawing(bottom, legend=7.0), drawing(top, title=title, legend=7.0):
        for k, (name, style) in enumerate(zip(AXES, STYLES)):
            top.plot(time, result.force[i, k], linestyle=style, color=shades[k], label=NAMES[name])
            if name != "n":
                bottom.plot(time, result.loop(i, name)[0], linestyle=style, color=shades[k], label=NAMES[name])
        if result.gap[i].max() > 0.0:
            bottom.plot(time, result.gap[i], linestyle=STYLES[2], color=shades[2], label="gap")
        top.set(ylabel="Contact force (N)", xlim=(0.0, 1.0))
        bottom.set(ylabel="Motion and gap (m)", xlabel="Time (periods)")
    return np.array([top, bottom])


@draws(Hysteresis, "energy")
def plot_energy(result: Hysteresis) -> NDArray:
    """Energy that is lost in a cycle for each area, over the faces that lose any."""
    density = np.maximum(result.energy, 0.0) / result.area
    least = 1e-9 * float(density.max(initial=0.0))
    names = [name for name in result.interfaces if (density[result.rows(name)] > least).any()]
    validate.require(names, "energy", "contact points that lose some", "none: nothing slips")
    rows = [result.rows(name) for name in names]
    places = [(f"{name} face", result.points[r], result.frame[r]) for name, r in zip(names, rows)]
    return plot_faces(places, [density[r] for r in rows], [""], "Energy lost per cycle (J/m$^2$)", 1.0)


@draws(Dissipation)
def plot_dissipation(
    result: Dissipation,
    quantity: str = "equivalent",
    ax: Axes | tuple[Axes, Axes] | None = None,
    *,
    over: str = "amplitude",
    title: str = "",
) -> Axes | NDArray:
    """What the contacts do to the vibration, over its amplitude.

    Parameters
    ----------
    result : Dissipation
    quantity : {"equivalent", "energy"}
        Equivalent stiffness and damping ratio, or where the work of the excitation goes in a cycle.
    ax : matplotlib axes, optional
        Two for "equivalent", one below the other.
    over : {"amplitude", "frequency", "preload"}
    title : str

    Returns
    -------
    matplotlib axes, an array of two for "equivalent"
    """
    validate.choice("quantity", quantity, ("equivalent", "energy"))
    x = getattr(result, validate.choice("over", over, ("amplitude", "frequency", "preload")))
    parts = [slice(first, last + 1) for first, last in runs(result.branch)]
    scale = "log" if x.min() > 0.0 and x.max() > 5.0 * x.min() else "linear"

    def line(axes: Axes, values: Any, colour: Any, name: str = "", marker: str = "", style: str = "-") -> None:
        for n, part in enumerate(parts):
            alone = "." if part.stop == part.start + 1 else marker
            axes.plot(x[part], values[part], style, color=colour, marker=alone, markersize=3.5,
                      markevery=max(1, len(x) // 12), label=name if n == 0 else None)  # fmt: skip

    if quantity == "equivalent":
        upper, lower = stacked() if ax is None else given_axes(ax, 2, "'equivalent'")
        with drawing(upper, title=title), drawing(lower):
            line(upper, result.stiffness, "0.1")
            line(lower, 100.0 * result.damping_ratio, "0.1")
            upper.set(xscale=scale, ylabel=label(Dissipation, "stiffness"))
            lower.set(xscale=scale, xlabel=label(Dissipation, over), ylabel=label(Dissipation, "damping_ratio", "%"))
        return np.array([upper, lower])
    with drawing(None if ax is None else given_axes(ax, 1, "'energy'")[0], title=title, legend=7.0) as axes:
        faces = {name: e for name, e in result.by_interface.items() if (e > 1e-9 * result.lost.max()).any()}
        line(axes, result.excitation, "0.7", "work of the excitation")
        for (name, e), colour, marker in zip(faces.items(), colours(len(faces)), MARKERS * len(faces)):
            line(axes, e, colour, f"friction of the {name} face", marker)
        line(axes, result.damping, "0.35", "damping of the modes", style="-.")
        axes.set(xlabel=label(Dissipation, over), xscale=scale, yscale="log")
        axes.set(ylabel="Energy in a cycle (J)", ylim=(SMALLEST * result.excitation.max(), None))
    return axes
