"""Cycles of the contacts: loops of force over displacement, histories, and the energy that is lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from bdamper.analyses.hysteresis import AXES, WHOLE, Hysteresis
from bdamper.plot.axes import NEW, legend_beside, looks, picture
from bdamper.plot.column_plot import draw_table
from bdamper.plot.contact import plot_faces
from bdamper.util import validation
from bdamper.util.display import draws
from bdamper.util.formatting import amount

NAMES = {"t1": "in the face along t1", "t2": "in the face along t2", "n": "normal to the face"}
OF_WHOLE = {"xlabel": "Motion of the response (m)", "ylabel": "All contact forces as one force there (N)"}
"""Labels of the loop of all contacts."""


def _name(result: Hysteresis, where: int | str) -> str:
    """A contact point as a face and the number within it, a face by its name."""
    if isinstance(where, str):
        return f"{where} face" if where != WHOLE else "all contacts"
    face = result.interface[where]
    return f"{face} face, point {where - int(result.rows(face)[0]) + 1}"


@picture(Hysteresis, "loops", legend=None)
def plot_loops(
    result: Hysteresis, where: int | str | Sequence[int | str] = WHOLE, ax: Axes = NEW, *, direction: str = "t1"
) -> None:
    """Loops of force over displacement.

    Parameters
    ----------
    result : Hysteresis
    where : int, str or sequence of these
        Contact points by index, faces by name, or "whole": the force at the response location that does the work of all
        contacts, over the response.
    direction : {"t1", "t2", "n"}
        Of points and faces.
    """
    places = [where] if isinstance(where, (int, np.integer, str)) else list(where)
    if not places or (WHOLE in places and len(places) > 1):
        raise validation.unfit("where", f'contact points and faces, or "{WHOLE}" alone', where)
    whole = places == [WHOLE]
    lost: dict[Any, float] = {WHOLE: result.lost, **result.by_interface, **dict(enumerate(result.energy))}
    for place, look in zip(places, looks(len(places))):
        name = _name(result, place)
        if direction != "n" or whole:
            name += f",\nloses {amount(lost[place], 'J')} a cycle{'' if whole else ' in all directions'}"
        ax.plot(*result.loop(place, direction), **{**look, "marker": "", "label": name})
    if len(places) > 1:
        legend_beside(ax)
    of = f"{NAMES[direction]}{'' if len(places) > 1 else f', {_name(result, places[0])}'}"
    ax.set(**OF_WHOLE if whole else {"xlabel": f"Motion {of} (m)", "ylabel": f"Force {of} (N)"})
    ax.set_title(f"Friction over a cycle at {result.frequency:.4g} Hz, preload {amount(result.preload, 'N')}")


@picture(Hysteresis, "history", size=(5.6, 4.4), rows=2)
def plot_history(result: Hysteresis, where: int, ax: NDArray = NEW) -> None:
    """Forces, vibration and gap of one contact point over a cycle, in two axes.

    Parameters
    ----------
    result : Hysteresis
    where : int
        Index of the point.
    """
    i = validation.whole("where, index of a contact point", where, 0, len(result.points) - 1)
    time = result.theta / (2.0 * np.pi)
    for k, (name, look) in enumerate(zip(AXES, looks(3))):
        look["marker"] = ""
        ax[0].plot(time, result.force[i, k], **look, label=NAMES[name])
        if name != "n":
            ax[1].plot(time, result.loop(i, name)[0], **look, label=NAMES[name])
        elif result.gap[i].max() > 0.0:
            ax[1].plot(time, result.gap[i], **look, label="gap")
    ax[0].set(ylabel="Contact force (N)", xlim=(0.0, 1.0))
    ax[0].set_title(f"{_name(result, i)}, {result.frequency:.5g} Hz, preload {amount(result.preload, 'N')}")
    ax[1].set(ylabel="Motion and gap (m)", xlabel="Time (periods)")


@draws(Hysteresis, "energy")
def plot_energy(result: Hysteresis) -> NDArray:
    """Energy that is lost in a cycle for each area, over the faces that lose any."""
    density = np.maximum(result.energy, 0.0) / result.area
    least = 1e-9 * float(density.max(initial=0.0))
    names = [name for name in result.interfaces if (density[result.rows(name)] > least).any()]
    validation.require(names, "energy", "contact points that lose some", "none: nothing slips")
    rows = [result.rows(name) for name in names]
    places = [(f"{name} face", result.points[r], result.frame[r]) for name, r in zip(names, rows)]
    return plot_faces(places, [density[r] for r in rows], "Energy lost per cycle (J/m$^2$)")


@picture(Hysteresis, "dissipation", size=(5.6, 7.8), rows=3)
def plot_dissipation(result: Hysteresis, ax: NDArray = NEW, *, over: str = "amplitude") -> None:
    """Equivalent stiffness and damping ratio of the contacts, and below them where the work of the excitation goes.

    Parameters
    ----------
    result : Hysteresis
        Of several solutions.
    ax : three matplotlib axes, optional
    over : {"amplitude", "frequency", "preload"}
    """
    validation.choice("over", over, ("amplitude", "frequency", "preload"))
    for one, name in zip(ax, ("stiffness", "damping_ratio")):
        draw_table(one, result, over, name)
        one.set_xlabel("")
    energy = ax[2]
    energy.set(ylabel="Energy in a cycle (J)", yscale="log")
    draw_table(energy, result, over, "excitation", color="0.7", marker="", label="work of the excitation")
    faces = {name: e for name, e in result.by_interface.items() if (e > 1e-9 * result.lost.max()).any()}
    for (name, lost), look in zip(faces.items(), looks(len(faces))):
        look |= {"markevery": max(1, len(lost) // 12), "linestyle": "-", "label": f"friction of the {name} face"}
        draw_table(energy, replace(result, excitation=lost), over, "excitation", **look)
    draw_table(energy, result, over, "damping", color="0.35", linestyle="-.", marker="", label="damping of the modes")
    smallest = 1e-4  # energy that is shown, relative to the largest
    energy.set_ylim(smallest * result.excitation.max(), None)


@draws(Hysteresis)
def plot_hysteresis(result: Hysteresis, *arguments: Any, **options: Any) -> Any:
    """Loops of a single solution (:func:`plot_loops`), stiffness and damping of several (:func:`plot_dissipation`)."""
    return (plot_loops if result.single else plot_dissipation)(result, *arguments, **options)
