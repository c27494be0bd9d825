"""Plots of contacts: states, maps of faces, hysteresis loops, histories and dissipated energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from bdamper.analyses.hysteresis import AXES, WHOLE, Hysteresis
from bdamper.contact.preload_state import PreloadState
from bdamper.harmonic_balance.checks import Asking, check_result, problem_of
from bdamper.harmonic_balance.problem import Problem
from bdamper.model.structure import Model
from bdamper.plot.axes import (
    COLUMN,
    NEW,
    SMALL,
    STYLE,
    drawing,
    finish,
    legend_beside,
    looks,
    new_axes,
    picture,
)
from bdamper.plot.motion import PLAIN, STATES, ContactStatus, contact_status
from bdamper.plot.studies import draw_table
from bdamper.response.highest_peak import highest_peak
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak, check_peak
from bdamper.response.response_curve import check_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util import validation
from bdamper.util.display import InContact, register_plot
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.formatting import amount
from bdamper.util.tables import axis_label as label_of

# ---- Contact faces ----

STATUS_COLOURS = ("#262626", "#e6862a", "#cfe3ee")
"""Colours of stick, slip and separation: dark, medium and light, distinct in grey print."""
EDGE: dict[str, Any] = {"edgecolor": "0.2", "linewidth": 0.4}


def plot_status_bars(
    status: ContactStatus,
    points: Sequence[int],
    ax: Axes | None = None,
    *,
    direction: int = 0,
    title: str = "",
) -> Axes:
    """Plot the state of contact points over one period as bars, as in Fig. 16 of the paper.

    Parameters
    ----------
    status : ContactStatus
    points : sequence of int
        Indices of contact points, from top to bottom.
    ax : matplotlib axes, optional
    direction : {0, 1}
        Tangential direction t1 or t2.
    title : str
    """
    points = validation.integers("points", points, most=len(status.parts) - 1)
    direction = validation.integer("direction", direction, 0, 1)
    period = 2.0 * np.pi
    with drawing(ax, size=(COLUMN, 0.8 + 0.22 * len(points)), title=title) as ax:
        for row, point in enumerate(points):
            for start, end, state in status.parts[point][direction]:
                left = (
                    np.array([start, start - period]) / period
                )  # a part may continue past the end of the period
                ax.barh(
                    row,
                    (end - start) / period,
                    left=left,
                    height=0.62,
                    color=STATUS_COLOURS[state],
                    **EDGE,
                )
        names = [
            f"{status.interface[p]} {p - status.rows(status.interface[p])[0] + 1}" for p in points
        ]
        ax.set_yticks(range(len(points)), names)
        ax.invert_yaxis()
        ax.set(xlim=(0.0, 1.0), xlabel="Time (periods)")
        ax.grid(False)
        _status_legend(ax)
    return ax


def _status_legend(ax: Axes) -> None:
    legend_beside(ax, handles=_state_patches())


def _state_patches() -> list[Patch]:
    return [Patch(facecolor=c, label=n, **EDGE) for c, n in zip(STATUS_COLOURS, STATES)]


def face_coordinates(points: NDArray, frame: NDArray) -> tuple[NDArray, NDArray, float, float]:
    """Return the coordinates of contact points along t1 (outward) and Z from the face centre in mm, and the point
    spacings."""
    centred = points - points.mean(axis=0)
    outward = 1.0 if frame[0] @ (points.mean(axis=0) * [1.0, 1.0, 0.0]) >= 0.0 else -1.0
    x, y = (
        1e3 * outward * centred @ frame[0],
        1e3 * np.sign(frame[1, 2] or 1.0) * centred @ frame[1],
    )

    def spacing(values: NDArray) -> float:
        steps = np.diff(np.unique(np.round(values, 6)))
        return (
            float(np.ptp(values) / (steps > 0.5 * steps.max()).sum()) if len(steps) else 1.0
        )  # rows may be uneven

    return x, y, spacing(x), spacing(y)


def _face_axes(ax: Axes, x: NDArray, y: NDArray, dx: float, dy: float) -> None:
    """Set the limits and labels of the map of a face."""
    ax.set(
        xlim=(y.min() - 0.6 * dy, y.max() + 0.6 * dy), ylim=(x.min() - 0.6 * dx, x.max() + 0.6 * dx)
    )
    ax.set(aspect="equal", xlabel="Along the axis (mm)", ylabel="Outward (mm)")
    ax.xaxis.set_major_locator(
        MaxNLocator(3 if np.ptp(ax.get_xlim()) > 1.5 * np.ptp(ax.get_ylim()) else 1)
    )
    ax.grid(False)


def tiles(share: NDArray, x: NDArray, y: NDArray, dx: float, dy: float) -> tuple[NDArray, ...]:
    """Return the edges and states of the tiles of a status map.

    Each point has a rectangle, divided by its shares (n, 3) of stick, slip and separation.
    """
    left = y[:, None] + 0.9 * dy * (np.pad(np.cumsum(share, axis=1), ((0, 0), (1, 0))) - 0.5)
    low = np.repeat(x - 0.45 * dx, 3)
    return (
        left[:, :-1].ravel(),
        left[:, 1:].ravel(),
        low,
        low + 0.9 * dx,
        np.tile(np.arange(3), len(x)),
    )


@picture(size=(COLUMN, 1.8), legend=None)
def plot_status_map(
    status: ContactStatus, model: Model, interface: str, ax: Axes = NEW, *, direction: int = 0
) -> None:
    """Plot a map of a contact face, each point divided by its shares of stick, slip and separation.

    Parameters
    ----------
    status : ContactStatus
    model : Model
    interface : str
    direction : {0, 1}
    """
    validation.choice(
        "interface", interface, [name for name in model.interfaces if name in status.interface]
    )
    _draw_map(
        ax,
        status,
        interface,
        model.interfaces[interface].frame[0],
        validation.integer("direction", direction, 0, 1),
    )
    _status_legend(ax)


def _draw_map(
    ax: Axes, status: ContactStatus, interface: str, frame: NDArray, direction: int
) -> None:
    x, y, dx, dy = face_coordinates(status.points[status.rows(interface)], frame)
    left, right, low, high, state = tiles(
        status.share[status.rows(interface), direction], x, y, dx, dy
    )
    colour = [STATUS_COLOURS[k] for k in state]
    ax.barh(low, right - left, high - low, left, align="edge", color=colour, rasterized=True)
    ax.barh(
        x, np.full(len(x), 0.9 * dy), 0.9 * dx, y - 0.45 * dy, fill=False, **EDGE, rasterized=True
    )
    _face_axes(ax, x, y, dx, dy)


@register_plot(InContact, "plot_contacts")
def plot_contacts(
    result: InContact,
    study: Asking | Problem | None = None,
    point: int | None = None,
    *,
    direction: int = 0,
) -> NDArray:
    """Plot the state of every contact face: a map of shares of the cycle, and the states over time.

    Parameters
    ----------
    result : Peak, ResponseCurve, OptimalCurve, NonlinearMode or PreloadState
    study : Study, optional
        Study of the result; only a static state needs none.
    point : int, optional
        Index of the solution of a curve or mode.  By default the peak of a response curve or the
        highest amplitude of a mode; an optimal curve has the peak at its optimum.
    direction : {0, 1}
        Tangential direction t1 or t2.
    """
    direction = validation.integer("direction", direction, 0, 1)
    status, frames, title = _states(result, study, point)
    time = (np.arange(360) + 0.5) / 360.0  # in periods
    with plt.rc_context(STYLE):
        touching = [
            name for name in frames if (status.share[status.rows(name), direction, 2] < 1.0).any()
        ]
        shown = touching or list(frames)
        columns = 1 if isinstance(result, PreloadState) else 2
        axes = new_axes(
            COLUMN, 0.95 * len(shown) + 0.7, len(shown), columns, squeeze=False, sharex=False
        )
        figure = axes[0, 0].figure
        for (left, *others), name in zip(axes, shown):
            _draw_map(left, status, name, frames[name], direction)
            left.set_aspect("auto")
            left.set_title(f"{name} face")
            shares = np.zeros((3, len(time)))
            for row in status.rows(name):
                for start, end, state in status.parts[row][direction]:
                    shares[state] += (time - start / (2.0 * np.pi)) % 1.0 < (end - start) / (
                        2.0 * np.pi
                    )
            for right in others:
                right.stackplot(
                    time,
                    100.0 * shares / shares.sum(axis=0),
                    colors=STATUS_COLOURS,
                    rasterized=True,
                )
                right.set(
                    xlim=(0.0, 1.0), ylim=(0.0, 100.0), ylabel="Points (%)", xlabel="Time (periods)"
                )
        plt.setp(axes[:-1], xlabel="")
        away = [name for name in frames if name not in shown]
        title += f"; always open: {', '.join(away)}" * bool(away)
        figure.suptitle(title, fontsize=plt.rcParams["axes.titlesize"])
        figure.legend(handles=_state_patches(), loc="outside lower center", ncols=3, fontsize=SMALL)
        finish(figure)
    return axes.ravel()


def _states(
    result: Any, study: Asking | Problem | None, point: int | None
) -> tuple[ContactStatus, dict[str, NDArray], str]:  # fmt: skip
    """Return the contact states of a solution, the axes of each face, and a title."""
    if isinstance(result, PreloadState):
        if result.points is None or result.frame is None:
            raise BdamperError(
                "plot_contacts: this static state has no contact faces; compute it with study.static"
            )
        whole = tuple(tuple(((0.0, 2.0 * np.pi, PLAIN[k]),) for k in row) for row in result.status)
        status = ContactStatus(result.points, result.interface, whole)
        frames = {
            name: result.frame[status.rows(name)[0]] for name in dict.fromkeys(result.interface)
        }
        return status, frames, f"at rest under {amount(result.load, 'N')}"
    validation.check(
        study is not None,
        "plot_contacts",
        "the study of the result, result.plot_contacts(study)",
        "none",
    )
    problem = problem_of(cast(Any, study))
    check_result(problem, result)
    if isinstance(result, OptimalCurve):
        result = highest_peak(problem, result.optimum.preload, result.settings.get("frequency"))
    if isinstance(result, ResponseCurve):
        check_curve(problem, result, "plot_contacts")
    if isinstance(result, Peak):
        check_peak(problem, result, "plot_contacts")
        solution, preload, frequency = result.y[:-1], result.parameter, result.frequency
    else:
        i = (
            result.peak_index
            if isinstance(result, ResponseCurve)
            else int(np.argmax(result.amplitude))
        )
        i = i if point is None else validation.integer("point", point, 0, len(result) - 1)
        solution, preload, frequency = result.unknowns[i], result.preload, result.frequency[i]
    status = contact_status(problem, solution, preload)
    faces = problem.coupling.model.interfaces
    title = f"{amount(float(frequency), 'Hz')}, preload {amount(preload, 'N')}"
    return status, {name: faces[name].frame[0] for name in dict.fromkeys(status.interface)}, title


def plot_faces(
    faces: list[tuple[str, NDArray, NDArray]],
    values: list[NDArray],
    label: str,
    titles: Sequence[str] = ("",),
) -> NDArray:
    """Plot values on faces as coloured patches: a colour bar for each title, a column for each face.

    Without several titles the faces are in two columns.
    """
    n = len(faces)
    columns = n if len(titles) > 1 else min(n, 2)
    rows = len(titles) * -(-n // columns)
    with plt.rc_context(STYLE):
        axes = new_axes(
            COLUMN,
            0.85 * rows + 0.4 + 0.4 * len(titles),
            rows,
            columns,
            squeeze=False,
            sharex=False,
        )
        for row, (title, places) in enumerate(zip(titles, axes.reshape(len(titles), -1))):
            block = values[row * n : (row + 1) * n]
            low, high = (float(f(np.concatenate(block))) for f in (np.nanmin, np.nanmax))
            high = (
                high if high - low > 1e-9 * abs(high) else low + (abs(low) or 1e-6)
            )  # equal up to rounding
            for ax in places[n:]:
                ax.set_axis_off()
            for ax, (name, points, frame), value in zip(places, faces, block):
                x, y, dx, dy = face_coordinates(points, frame[0])
                corners = np.stack([y, x], axis=1)[:, None] + 0.48 * np.array(
                    [(-dy, -dx), (dy, -dx), (dy, dx), (-dy, dx)]
                )
                patches = PolyCollection(
                    list(corners), cmap="viridis", edgecolor="0.4", linewidth=0.3
                )
                patches.set(array=np.ma.masked_invalid(value), clim=(low, high))
                ax.add_collection(patches)
                _face_axes(ax, x, y, dx, dy)
                ax.set_title(f"{name}, {title}" if title else name)
            places[0].figure.colorbar(
                patches, ax=places.tolist(), label=label, location="bottom", shrink=0.8, aspect=30.0
            )
        plt.setp(axes[:-1], xlabel="")
        plt.setp(axes[:, 1:], ylabel="")
        finish(axes[0, 0].figure)
    return axes.ravel()


@picture(Peak, size=(COLUMN, 1.3), legend=None)
def plot_peak(peak: Peak, ax: Axes = NEW) -> None:
    """Plot the shares of stick, slip and separation over the cycle of a peak."""
    shares = 100.0 * peak.shares
    ax.barh(["contacts"] * 3, shares, left=np.cumsum(shares) - shares, color=STATUS_COLOURS, **EDGE)
    ax.set(xlabel="Share of the cycle (%)", xlim=(0.0, 100.0), title=peak._headline())
    _status_legend(ax)


@register_plot(PreloadState)
def plot_static(state: PreloadState, quantity: str = "pressure") -> NDArray:
    """Plot pressure, gap or utilisation of the friction limit on the friction faces at rest.

    Open points are white.

    Parameters
    ----------
    state : PreloadState
        A result of a study.
    quantity : {"pressure", "gap", "friction"}
    """
    pressure, points, frame, friction = state.pressure, state.points, state.frame, state.friction
    if pressure is None or points is None or frame is None or friction is None:
        raise BdamperError(
            "plot: this static state has no contact faces; compute it with study.static"
        )
    normal = state.force[:, 2]
    closed, limit = normal > 0.0, (friction * normal)[:, None]
    used = np.divide(
        np.abs(state.force[:, :2]), limit, out=np.zeros((len(normal), 2)), where=limit > 0.0
    ).max(axis=1)
    choices = {
        "pressure": (np.where(closed, pressure, np.nan), label_of(PreloadState, "pressure")),
        "gap": (np.maximum(-state.closing, 0.0), "Gap (m)"),
        "friction": (np.where(closed, used, np.nan), "Friction force / limit"),
    }
    value, label = choices[validation.choice("quantity", quantity, choices)]
    value = value if np.isfinite(value).any() else np.zeros(len(value))
    names = np.array(state.interface)
    by_face = {
        str(name): names == name for name in (names[friction > 0.0] if friction.any() else names)
    }
    faces = [(name, points[rows], frame[rows]) for name, rows in by_face.items()]
    return plot_faces(faces, [value[rows] for rows in by_face.values()], label)


# ---- Cycles ----

NAMES = {"t1": "in the face along t1", "t2": "in the face along t2", "n": "normal to the face"}
OF_WHOLE = {"xlabel": "Response (m)", "ylabel": "Equivalent force of all contacts (N)"}
"""Axis labels of the loop of all contacts."""


def _name(result: Hysteresis, where: int | str) -> str:
    """Return the name of a contact point (face and number within it) or of a face."""
    if isinstance(where, str):
        return f"{where} face" if where != WHOLE else "all contacts"
    face = result.interface[where]
    return f"{face} face, point {where - int(result.rows(face)[0]) + 1}"


@picture(Hysteresis, "loops")
def plot_loops(
    result: Hysteresis,
    where: int | str | Sequence[int | str] = WHOLE,
    ax: Axes = NEW,
    *,
    direction: str = "t1",
) -> None:
    """Plot hysteresis loops of force over displacement.

    Parameters
    ----------
    result : Hysteresis
    where : int, str or sequence of these
        Indices of contact points, names of faces, or "whole".  "whole" is the loop of all contacts:
        the force at the response location that does the same work, over the response.
    direction : {"t1", "t2", "n"}
        Direction of points and faces.
    """
    places = [where] if isinstance(where, (int, np.integer, str)) else list(where)
    if not places or (WHOLE in places and len(places) > 1):
        raise validation.invalid("where", f'contact points and faces, or "{WHOLE}" alone', where)
    whole = places == [WHOLE]
    energy: dict[Any, float] = {
        WHOLE: result.lost,
        **result.by_interface,
        **dict(enumerate(result.energy)),
    }
    for place, look in zip(places, looks(len(places))):
        name = _name(result, place)
        if direction != "n" or whole:
            name += (
                f",\n{amount(energy[place], 'J')} per cycle{'' if whole else ' in all directions'}"
            )
        ax.plot(*result.loop(place, direction), **{**look, "marker": "", "label": name})
    where_text = f"{NAMES[direction]}{'' if len(places) > 1 else f', {_name(result, places[0])}'}"
    ax.set(
        **OF_WHOLE
        if whole
        else {"xlabel": f"Motion {where_text} (m)", "ylabel": f"Force {where_text} (N)"}
    )
    ax.set_title(
        f"Friction over a cycle at {result.frequency:.4g} Hz, preload {amount(result.preload, 'N')}"
    )


@picture(Hysteresis, "history", size=(COLUMN, 3.3), rows=2)
def plot_history(result: Hysteresis, where: int, ax: NDArray = NEW) -> None:
    """Plot the forces, vibration and gap of one contact point over a cycle, in two axes.

    Parameters
    ----------
    result : Hysteresis
    where : int
        Index of the point.
    """
    i = validation.integer("where, index of a contact point", where, 0, len(result.points) - 1)
    time = result.theta / (2.0 * np.pi)
    for k, (name, look) in enumerate(zip(AXES, looks(4))):
        look["marker"] = ""
        ax[0].plot(time, result.force[i, k], **look, label=NAMES[name])
        if name != "n":
            ax[1].plot(time, result.loop(i, name)[0], **look, label=NAMES[name])
        elif result.gap[i].max() > 0.0:
            ax[1].plot(time, result.gap[i], **looks(4)[3] | {"marker": ""}, label="gap")
    ax[0].set(ylabel="Contact force (N)", xlim=(0.0, 1.0))
    ax[0].set_title(
        f"{_name(result, i)}, {result.frequency:.5g} Hz, preload {amount(result.preload, 'N')}"
    )
    ax[1].set(ylabel="Motion and gap (m)", xlabel="Time (periods)")


@register_plot(Hysteresis, "energy")
def plot_energy(result: Hysteresis) -> NDArray:
    """Plot the energy dissipated per cycle and area on the faces with dissipation."""
    density = np.maximum(result.energy, 0.0) / result.area
    least = 1e-9 * float(density.max(initial=0.0))
    names = [name for name in result.interfaces if (density[result.rows(name)] > least).any()]
    if not names:
        raise SettingError("energy: no contact point dissipates energy, since nothing slips")
    rows = [result.rows(name) for name in names]
    faces = [(f"{name} face", result.points[r], result.frame[r]) for name, r in zip(names, rows)]
    return plot_faces(faces, [density[r] for r in rows], "Energy per cycle (J/m$^2$)")


@picture(Hysteresis, "dissipation", size=(COLUMN, 4.8), rows=3)
def plot_dissipation(result: Hysteresis, ax: NDArray = NEW, *, over: str = "amplitude") -> None:
    """Plot equivalent stiffness and damping ratio of the contacts, and the energy balance.

    Parameters
    ----------
    result : Hysteresis
        Hysteresis of several solutions.
    ax : three matplotlib axes, optional
    over : {"amplitude", "frequency", "preload"}
    """
    validation.choice("over", over, ("amplitude", "frequency", "preload"))
    for axes, name in zip(ax, ("stiffness", "damping_ratio")):
        draw_table(axes, result, over, name)
        axes.set_xlabel("")
    energy = ax[2]
    energy.set(ylabel="Energy per cycle (J)", yscale="log")
    draw_table(
        energy, result, over, "excitation", color="0.7", marker="", label="work of the excitation"
    )
    faces = {
        name: e for name, e in result.by_interface.items() if (e > 1e-9 * result.lost.max()).any()
    }
    for (name, lost), look in zip(faces.items(), looks(len(faces))):
        look |= {
            "markevery": max(1, len(lost) // 12),
            "linestyle": "-",
            "label": f"friction of the {name} face",
        }
        draw_table(energy, replace(result, excitation=lost), over, "excitation", **look)
    draw_table(
        energy,
        result,
        over,
        "damping",
        color="0.35",
        linestyle="-.",
        marker="",
        label="damping of the modes",
    )
    energy.set_ylim(1e-4 * result.excitation.max(), None)


@register_plot(Hysteresis)
def plot_hysteresis(result: Hysteresis, *arguments: Any, **options: Any) -> Any:
    """Plot the loops of one solution, or the dissipation of several.

    See :func:`plot_loops` and :func:`plot_dissipation`.
    """
    return (plot_loops if result.single else plot_dissipation)(result, *arguments, **options)
