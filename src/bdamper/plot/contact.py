"""Contact faces: what their points do over a period and what they carry.

Cycles of the contacts: loops of force over displacement, histories, and the energy that is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bdamper.analyses.hysteresis import AXES, WHOLE, Hysteresis
from bdamper.contact.static_state import PreloadState
from bdamper.model.structure import Model
from bdamper.plot.axes import NEW, STYLE, drawing, fit_units, legend_beside, looks, picture
from bdamper.plot.motion import STATES, ContactStatus
from bdamper.plot.studies import draw_table
from bdamper.response.peak import Peak
from bdamper.util import validation
from bdamper.util.display import register_plot
from bdamper.util.errors import BdamperError
from bdamper.util.formatting import amount
from bdamper.util.tables import axis_label as label_of

# ---- Contact faces ----


STATUS_COLOURS = ("#262626", "#e6862a", "#cfe3ee")
"""Dark, middle and light: told apart in grey as well."""
EDGE: dict[str, Any] = {"edgecolor": "0.2", "linewidth": 0.4}


def plot_status_bars(
    status: ContactStatus, points: Sequence[int], ax: Axes | None = None, *, direction: int = 0, title: str = ""
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
    points = validation.integers("points", points, most=len(status.parts) - 1)
    direction = validation.integer("direction", direction, 0, 1)
    period = 2.0 * np.pi
    with drawing(ax, size=(5.2, 0.9 + 0.32 * len(points)), title=title) as ax:
        for row, point in enumerate(points):
            for start, end, state in status.parts[point][direction]:
                left = np.array([start, start - period]) / period  # the last part may pass the end of the period
                ax.barh(row, (end - start) / period, left=left, height=0.62, color=STATUS_COLOURS[state], **EDGE)
        names = [f"{status.interface[p]} {p - status.rows(status.interface[p])[0] + 1}" for p in points]
        ax.set_yticks(range(len(points)), names)
        ax.invert_yaxis()
        ax.set(xlim=(0.0, 1.0), xlabel="Time (periods)")
        ax.grid(False)
        _status_legend(ax)
    return ax


def _status_legend(ax: Axes) -> None:
    handles = [Patch(facecolor=c, label=n, **EDGE) for c, n in zip(STATUS_COLOURS, STATES)]
    legend_beside(ax, handles=handles)


def face_coordinates(points: NDArray, frame: NDArray) -> tuple[NDArray, NDArray, float, float]:
    """Places (n,) of contact points outward along t1 and along Z, from the centre of their face (mm), and the spacing."""
    centred = points - points.mean(axis=0)
    outward = 1.0 if frame[0] @ (points.mean(axis=0) * [1.0, 1.0, 0.0]) >= 0.0 else -1.0
    x, y = 1e3 * outward * centred @ frame[0], 1e3 * np.sign(frame[1, 2] or 1.0) * centred @ frame[1]

    def step(values: NDArray) -> float:
        apart = np.diff(np.unique(np.round(values, 6)))
        return float(np.ptp(values) / (apart > 0.5 * apart.max()).sum()) if len(apart) else 1.0  # of rows that waver

    return x, y, step(x), step(y)


def _face_axes(ax: Axes, x: NDArray, y: NDArray, dx: float, dy: float) -> None:
    """Limits and labels of the map of a face."""
    ax.set(xlim=(y.min() - 0.6 * dy, y.max() + 0.6 * dy), ylim=(x.min() - 0.6 * dx, x.max() + 0.6 * dx))
    ax.set(aspect="equal", xlabel="Along the axis (mm)", ylabel="Outward (mm)")
    ax.grid(False)


def tiles(share: NDArray, x: NDArray, y: NDArray, dx: float, dy: float) -> tuple[NDArray, ...]:
    """Ends along both axes and states of patches at contact points, each divided by its shares (n, 3)."""
    left = y[:, None] + 0.9 * dy * (np.pad(np.cumsum(share, axis=1), ((0, 0), (1, 0))) - 0.5)
    low = np.repeat(x - 0.45 * dx, 3)
    return left[:, :-1].ravel(), left[:, 1:].ravel(), low, low + 0.9 * dx, np.tile(np.arange(3), len(x))


@picture(size=(5.2, 2.4), legend=None)
def plot_status_map(status: ContactStatus, model: Model, interface: str, ax: Axes = NEW, *, direction: int = 0) -> None:
    """Map of a contact face: each point is divided by the shares of the period that it sticks, slips and is open.

    Parameters
    ----------
    status : ContactStatus
    model : Model
    interface : str
    direction : {0, 1}
    """
    validation.choice("interface", interface, [name for name in model.interfaces if name in status.interface])
    direction = validation.integer("direction", direction, 0, 1)
    face = model.interfaces[interface]
    x, y, dx, dy = face_coordinates(face.points, face.frame[0])
    left, right, low, high, state = tiles(status.share[status.rows(interface), direction], x, y, dx, dy)
    ax.barh(low, right - left, high - low, left, align="edge", color=[STATUS_COLOURS[k] for k in state])
    ax.barh(x, np.full(len(x), 0.9 * dy), 0.9 * dx, y - 0.45 * dy, fill=False, **EDGE)
    _face_axes(ax, x, y, dx, dy)
    _status_legend(ax)


def plot_faces(
    places: list[tuple[str, NDArray, NDArray]], values: list[NDArray], label: str, titles: Sequence[str] = ("",)
) -> NDArray:
    """Values over several faces as coloured patches, one row for each title, one column for each face."""
    n = len(places)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(len(titles), n, figsize=(3.4 * n, 1.7 * len(titles) + 0.3), squeeze=False)
        for row, title in enumerate(titles):
            block = values[row * n : (row + 1) * n]
            low, high = (float(f(np.concatenate(block))) for f in (np.nanmin, np.nanmax))
            high = high if high - low > 1e-9 * abs(high) else low + (abs(low) or 1e-6)  # rounding is no difference
            for ax, (name, points, frame), value in zip(axes[row], places, block):
                x, y, dx, dy = face_coordinates(points, frame[0])
                corners = np.stack([y, x], axis=1)[:, None] + 0.48 * np.array([(-dy, -dx), (dy, -dx), (dy, dx), (-dy, dx)])
                shown = PolyCollection(list(corners), cmap="viridis", edgecolor="0.4", linewidth=0.3)
                shown.set(array=np.ma.masked_invalid(value), clim=(low, high))
                ax.add_collection(shown)
                _face_axes(ax, x, y, dx, dy)
                ax.set_title(f"{name}, {title}" if title else name, fontsize=8.0)
            figure.colorbar(shown, ax=axes[row].tolist(), label=label, shrink=0.9)
        plt.setp(axes[:-1], xlabel="")
        plt.setp(axes[:, 1:], ylabel="")
        for each in figure.axes:
            fit_units(each)
    return axes.ravel()


@picture(Peak, size=(5.6, 1.5), legend=None)
def plot_peak(peak: Peak, ax: Axes = NEW) -> None:
    """Shares of the cycle that contacts stick, slip and are open at the peak."""
    shares = 100.0 * peak.shares
    ax.barh(["contacts"] * 3, shares, left=np.cumsum(shares) - shares, color=STATUS_COLOURS, **EDGE)
    ax.set(xlabel="Share of the cycle (%)", xlim=(0.0, 100.0), title=peak._headline())
    _status_legend(ax)


@register_plot(PreloadState)
def plot_static(state: PreloadState, quantity: str = "pressure") -> NDArray:
    """Pressure, gap or use of the friction limit over the friction faces at rest; open points stay white.

    Parameters
    ----------
    state : PreloadState
        From a study; files of version 0.6 and before do not have the faces.
    quantity : {"pressure", "gap", "friction"}
    """
    pressure, points, frame, friction = state.pressure, state.points, state.frame, state.friction
    if pressure is None or points is None or frame is None or friction is None:
        raise BdamperError("plot: expected a static state with its faces, as study.static gives it, found none")
    normal = state.force[:, 2]
    closed, reach = normal > 0.0, (friction * normal)[:, None]
    used = np.divide(np.abs(state.force[:, :2]), reach, out=np.zeros((len(normal), 2)), where=reach > 0.0).max(axis=1)
    choices = {
        "pressure": (np.where(closed, pressure, np.nan), label_of(PreloadState, "pressure")),
        "gap": (np.maximum(-state.closing, 0.0), "Gap (m)"),
        "friction": (np.where(closed, used, np.nan), "Friction force / limit"),
    }
    value, label = choices[validation.choice("quantity", quantity, choices)]
    value = value if np.isfinite(value).any() else np.zeros(len(value))
    names = np.array(state.interface)
    faces = dict.fromkeys(names[friction > 0.0] if friction.any() else names)
    own = [names == name for name in faces]
    places = [(str(name), points[rows], frame[rows]) for name, rows in zip(faces, own)]
    return plot_faces(places, [value[rows] for rows in own], label)


# ---- Cycles of the contacts ----


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
        raise validation.invalid("where", f'contact points and faces, or "{WHOLE}" alone', where)
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
    i = validation.integer("where, index of a contact point", where, 0, len(result.points) - 1)
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


@register_plot(Hysteresis, "energy")
def plot_energy(result: Hysteresis) -> NDArray:
    """Energy that is lost in a cycle for each area, over the faces that lose any."""
    density = np.maximum(result.energy, 0.0) / result.area
    least = 1e-9 * float(density.max(initial=0.0))
    names = [name for name in result.interfaces if (density[result.rows(name)] > least).any()]
    validation.check(names, "energy", "contact points that lose some", "none: nothing slips")
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


@register_plot(Hysteresis)
def plot_hysteresis(result: Hysteresis, *arguments: Any, **options: Any) -> Any:
    """Loops of a single solution (:func:`plot_loops`), stiffness and damping of several (:func:`plot_dissipation`)."""
    return (plot_loops if result.single else plot_dissipation)(result, *arguments, **options)
