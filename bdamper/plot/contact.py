"""Plots of contacts: states, maps of faces, hysteresis loops, histories and dissipated energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
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
from bdamper.harmonic_balance.checks import check_result
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_boundary import StudyLike, problem_of
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
from bdamper.response.followed_peak import highest_peak
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
        names = []
        for row, point in enumerate(points):
            for start, end, state in status.parts[point][direction]:
                # a second bar a period earlier, because a part may end in the next period
                left = np.array([start, start - period]) / period
                ax.barh(
                    row,
                    (end - start) / period,
                    left=left,
                    height=0.62,
                    color=STATUS_COLOURS[state],
                    **EDGE,
                )
            face = status.interface[point]
            names.append(f"{face} {point - status.rows(face)[0] + 1}")
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
    """Return coordinates of contact points and their spacings, in mm from the face centre.

    The first coordinate is along t1 (outward), the second one along Z.
    """
    t1, t2, _ = frame
    centre = points.mean(axis=0)
    centred = points - centre
    # reverse t1 if it points inward, and t2 if it points against Z
    radial = centre * [1.0, 1.0, 0.0]
    outward = 1.0 if t1 @ radial >= 0.0 else -1.0
    along_axis = -1.0 if t2[2] < 0.0 else 1.0
    x = 1e3 * outward * centred @ t1
    y = 1e3 * along_axis * centred @ t2
    dx = _spacing(x)
    dy = _spacing(y)
    # the points of a single row are squares
    known = dx or dy or 1.0
    return x, y, dx or known, dy or known


THINNEST = 6.0
"""Largest ratio of the sides of a face that is drawn to scale."""


def _spacing(values: NDArray) -> float:
    """Return the mean spacing of rows of points, which may be uneven; 0 for a single row."""
    steps = np.diff(np.unique(np.round(values, 6)))
    if not len(steps):
        return 0.0
    n_steps_between_rows = (steps > 0.5 * steps.max()).sum()
    return float(np.ptp(values) / n_steps_between_rows)


def _face_axes(ax: Axes, x: NDArray, y: NDArray, dx: float, dy: float) -> None:
    """Set the limits and labels of the map of a face."""
    ax.set(
        xlim=(y.min() - 0.6 * dy, y.max() + 0.6 * dy),
        ylim=(x.min() - 0.6 * dx, x.max() + 0.6 * dx),
    )
    ax.set(xlabel="Along the axis (mm)", ylabel="Outward (mm)")
    width = np.ptp(ax.get_xlim())
    height = np.ptp(ax.get_ylim())
    # a strip true to scale would be too thin for its points and numbers
    is_strip = max(width, height) > THINNEST * min(width, height)
    ax.set_aspect("auto" if is_strip else "equal")
    is_wide = width > 1.5 * height
    ax.xaxis.set_major_locator(MaxNLocator(3 if is_wide else 1))
    # in a low map the numbers would overlap
    ax.yaxis.set_major_locator(MaxNLocator(2 if is_wide else 4))
    ax.grid(False)


def tiles(share: NDArray, x: NDArray, y: NDArray, dx: float, dy: float) -> tuple[NDArray, ...]:
    """Return the edges (left, right, low, high) and the states of the tiles of a status map.

    The rectangle of each point is divided into three tiles according to its fractions (n, 3) of
    stick, slip and separation.  All results are arrays (3 n,).  The y coordinate is the horizontal
    one.
    """
    # (n, 4), from 0 to 1
    cumulative = np.pad(np.cumsum(share, axis=1), ((0, 0), (1, 0)))
    edges = y[:, None] + 0.9 * dy * (cumulative - 0.5)
    left = edges[:, :-1].ravel()
    right = edges[:, 1:].ravel()
    low = np.repeat(x - 0.45 * dx, 3)
    high = low + 0.9 * dx
    state = np.tile(np.arange(3), len(x))
    return left, right, low, high, state


@picture(size=(COLUMN, 1.8), legend=None)
def plot_status_map(
    status: ContactStatus, model: Model, interface: str, ax: Axes = NEW, *, direction: int = 0
) -> None:
    """Plot a map of a contact face, in which each point is divided into its fractions of stick,
    slip and separation.

    Parameters
    ----------
    status : ContactStatus
    model : Model
    interface : str
    direction : {0, 1}
    """
    faces = [name for name in model.interfaces if name in status.interface]
    validation.choice("interface", interface, faces)
    direction = validation.integer("direction", direction, 0, 1)
    _draw_map(ax, status, interface, model.interfaces[interface].frame[0], direction)
    _status_legend(ax)


def _draw_map(
    ax: Axes, status: ContactStatus, interface: str, frame: NDArray, direction: int
) -> None:
    """Draw the points of a face as rectangles, coloured by their shares of the states.

    ``direction`` is 0 for t1 and 1 for t2, and ``frame`` (3, 3) has the axes of the face.
    """
    rows = status.rows(interface)
    x, y, dx, dy = face_coordinates(status.points[rows], frame)
    left, right, low, high, state = tiles(status.share[rows, direction], x, y, dx, dy)
    colour = [STATUS_COLOURS[k] for k in state]
    ax.barh(
        low,
        width=right - left,
        height=high - low,
        left=left,
        align="edge",
        color=colour,
        rasterized=True,
    )
    # the outline of each point
    width = np.full(len(x), 0.9 * dy)
    ax.barh(
        x, width=width, height=0.9 * dx, left=y - 0.45 * dy, fill=False, **EDGE, rasterized=True
    )
    _face_axes(ax, x, y, dx, dy)


@register_plot(InContact, "plot_contacts")
def plot_contacts(
    result: InContact,
    study: StudyLike | Problem | None = None,
    point: int | None = None,
    *,
    direction: int = 0,
) -> NDArray:
    """Plot the states of every contact face: a map of their fractions of the cycle, and their time
    histories.

    Parameters
    ----------
    result : Peak, ResponseCurve, OptimalCurve, NonlinearMode or PreloadState
    study : Study, optional
        Study of the result; it can be omitted only for a static state.
    point : int, optional
        Index of the solution of a curve or mode.  By default the peak of a response curve or the
        highest amplitude of a mode; an optimal curve has the peak at its optimum.
    direction : {0, 1}
        Tangential direction t1 or t2.
    """
    direction = validation.integer("direction", direction, 0, 1)
    if isinstance(result, PreloadState):
        states = _states_at_rest(result)
    else:
        states = _states_of_vibration(result, study, point)
    status = states.status
    # faces that are open all the time have a picture only if no face touches
    always_open: list[str] = []
    touching: list[str] = []
    for name in states.frames:
        share_open = status.share[status.rows(name), direction, 2]
        if (share_open < 1.0).any():
            touching.append(name)
        else:
            always_open.append(name)
    shown = touching or always_open
    with plt.rc_context(STYLE):
        axes = new_axes(
            COLUMN,
            0.95 * len(shown) + 0.7,
            len(shown),
            1 if isinstance(result, PreloadState) else 2,
            squeeze=False,
            sharex=False,
        )
        for (left, *over_time), name in zip(axes, shown):
            _draw_map(left, status, name, states.frames[name], direction)
            left.set_aspect("auto")
            left.set_title(f"{name} face")
            for right in over_time:
                _draw_states_over_time(right, status, name, direction)
        plt.setp(axes[:-1], xlabel="")
        title = states.title
        if touching and always_open:
            title += f"; always open: {', '.join(always_open)}"
        figure = axes[0, 0].figure
        figure.suptitle(title, fontsize=plt.rcParams["axes.titlesize"])
        figure.legend(handles=_state_patches(), loc="outside lower center", ncols=3, fontsize=SMALL)
        finish(figure)
    return axes.ravel()


def _draw_states_over_time(ax: Axes, status: ContactStatus, interface: str, direction: int) -> None:
    """Plot the percentages of the points of a face in each state over the period."""
    period = 2.0 * np.pi
    time = (np.arange(360) + 0.5) / 360.0  # in periods
    n_points = np.zeros((3, len(time)))
    for row in status.rows(interface):
        for start, end, state in status.parts[row][direction]:
            since_start = (time - start / period) % 1.0
            n_points[state] += since_start < (end - start) / period
    percentage = 100.0 * n_points / n_points.sum(axis=0)
    ax.stackplot(time, percentage, colors=STATUS_COLOURS, rasterized=True)
    ax.set(xlim=(0.0, 1.0), ylim=(0.0, 100.0), ylabel="Points (%)", xlabel="Time (periods)")


@dataclass(frozen=True)
class _States:
    """Contact states of a solution, the axes (3, 3) of each face, and a title."""

    status: ContactStatus
    frames: dict[str, NDArray]
    title: str


def _states_at_rest(state: PreloadState) -> _States:
    if state.points is None or state.frame is None:
        raise BdamperError(
            "plot_contacts: this static state has no contact faces; compute it with study.static"
        )
    # the state of each point is constant over the period
    parts = []
    for directions in state.status:
        parts.append(tuple(((0.0, 2.0 * np.pi, PLAIN[code]),) for code in directions))
    status = ContactStatus(state.points, state.interface, tuple(parts))
    frames = {name: state.frame[status.rows(name)[0]] for name in dict.fromkeys(state.interface)}
    return _States(status, frames, f"at rest under {amount(state.load, 'N')}")


def _states_of_vibration(
    result: Any, study: StudyLike | Problem | None, point: int | None
) -> _States:
    has_study = study is not None
    missing = "give the study of the result, result.plot_contacts(study)"
    validation.check_sentence(has_study, "plot_contacts", missing)
    problem = problem_of(cast(Any, study))
    check_result(problem, result)
    if isinstance(result, OptimalCurve):
        result = highest_peak(problem, result.optimum.preload, result.settings.get("frequency"))
    if isinstance(result, ResponseCurve):
        check_curve(problem, result, "plot_contacts")
    if isinstance(result, Peak):
        check_peak(problem, result, "plot_contacts")
        unknowns = result.y[:-1]
        preload = result.parameter
        frequency = result.frequency
    else:
        if point is not None:
            row = validation.integer("point", point, 0, len(result) - 1)
        elif isinstance(result, ResponseCurve):
            row = result.peak_index
        else:
            row = int(np.argmax(result.amplitude))
        unknowns = result.unknowns[row]
        preload = result.preload
        frequency = result.frequency[row]
    status = contact_status(problem, unknowns, preload)
    faces = problem.coupling.model.interfaces
    frames = {name: faces[name].frame[0] for name in dict.fromkeys(status.interface)}
    title = f"{amount(float(frequency), 'Hz')}, preload {amount(preload, 'N')}"
    return _States(status, frames, title)


def plot_faces(
    faces: list[tuple[str, NDArray, NDArray]],
    values: list[NDArray],
    label: str,
    titles: Sequence[str] = ("",),
) -> NDArray:
    """Plot values on faces as coloured patches, with a colour bar for each title.

    Each face has a column.  Without several titles the faces are in two columns.
    """
    n_faces = len(faces)
    columns = n_faces if len(titles) > 1 else min(n_faces, 2)
    rows_of_title = -(-n_faces // columns)  # rounded up
    rows = len(titles) * rows_of_title
    height = 0.85 * rows + 0.4 + 0.4 * len(titles)
    with plt.rc_context(STYLE):
        axes = new_axes(COLUMN, height, rows, columns, squeeze=False, sharex=False)
        for row, (title, places) in enumerate(zip(titles, axes.reshape(len(titles), -1))):
            values_of_title = values[row * n_faces : (row + 1) * n_faces]
            low, high = _colour_limits(values_of_title)
            for ax in places[n_faces:]:
                ax.set_axis_off()
            for ax, (name, points, frame), value in zip(places, faces, values_of_title):
                patches = _draw_patches(ax, points, frame[0], value)
                patches.set_clim(low, high)
                ax.set_title(f"{name}, {title}" if title else name)
            places[0].figure.colorbar(
                patches, ax=places.tolist(), label=label, location="bottom", shrink=0.8, aspect=30.0
            )
        plt.setp(axes[:-1], xlabel="")
        plt.setp(axes[:, 1:], ylabel="")
        finish(axes[0, 0].figure)
    return axes.ravel()


def _colour_limits(values: list[NDArray]) -> tuple[float, float]:
    """Return the smallest and the largest value, apart if all values are equal up to rounding."""
    together = np.concatenate(values)
    low = float(np.nanmin(together))
    high = float(np.nanmax(together))
    if high - low > 1e-9 * abs(high):
        return low, high
    return low, low + (abs(low) or 1e-6)


def _draw_patches(ax: Axes, points: NDArray, frame: NDArray, values: NDArray) -> PolyCollection:
    """Draw a coloured rectangle for each point of a face."""
    x, y, dx, dy = face_coordinates(points, frame)
    # y is horizontal and x vertical
    centres = np.stack([y, x], axis=1)[:, None]
    half_sides = 0.48 * np.array([(-dy, -dx), (dy, -dx), (dy, dx), (-dy, dx)])
    corners = centres + half_sides  # (n, 4, 2)
    patches = PolyCollection(list(corners), cmap="viridis", edgecolor="0.4", linewidth=0.3)
    patches.set_array(np.ma.masked_invalid(values))
    ax.add_collection(patches)
    _face_axes(ax, x, y, dx, dy)
    return patches


@picture(Peak, size=(COLUMN, 1.3), legend=None)
def plot_peak(peak: Peak, ax: Axes = NEW) -> None:
    """Plot the fractions of stick, slip and separation over the cycle of a peak."""
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
    pressure = state.pressure
    points = state.points
    frame = state.frame
    friction = state.friction
    if pressure is None or points is None or frame is None or friction is None:
        raise BdamperError(
            "plot: this static state has no contact faces; compute it with study.static"
        )
    validation.choice("quantity", quantity, ("pressure", "gap", "friction"))
    is_closed = state.force[:, 2] > 0.0
    if quantity == "pressure":
        values = np.where(is_closed, pressure, np.nan)
        label = label_of(PreloadState, "pressure")
    elif quantity == "gap":
        values = np.maximum(-state.closing, 0.0)
        label = "Gap (m)"
    else:
        values = np.where(is_closed, _used_friction(state.force, friction), np.nan)
        label = "Friction force / limit"
    if not np.isfinite(values).any():
        values = np.zeros(len(values))
    names = np.array(state.interface)
    # faces without friction have a picture only if no face has friction
    shown = names[friction > 0.0] if friction.any() else names
    rows_of_face = {str(name): names == name for name in shown}
    faces = [(name, points[rows], frame[rows]) for name, rows in rows_of_face.items()]
    return plot_faces(faces, [values[rows] for rows in rows_of_face.values()], label)


def _used_friction(force: NDArray, friction: NDArray) -> NDArray:
    """Return the larger friction component of each point relative to its slip limit.

    The ratio is 0 if the limit is 0.
    """
    limit = (friction * force[:, 2])[:, None]
    unused = np.zeros((len(force), 2))
    used = np.divide(np.abs(force[:, :2]), limit, out=unused, where=limit > 0.0)
    return used.max(axis=1)


# ---- Cycles ----

NAMES = {"t1": "in the face along t1", "t2": "in the face along t2", "n": "normal to the face"}
OF_WHOLE = {"xlabel": "Response (m)", "ylabel": "Equivalent force of all contacts (N)"}
"""Axis labels of the loop of all contacts."""


def _name(result: Hysteresis, where: int | str) -> str:
    """Return the name of a contact point (face and number within it) or of a face."""
    if where == WHOLE:
        return "all contacts"
    if isinstance(where, str):
        return f"{where} face"
    face = result.interface[where]
    first = int(result.rows(face)[0])
    return f"{face} face, point {where - first + 1}"


@picture(Hysteresis, "loops")
def plot_loops(
    result: Hysteresis,
    where: int | str | Sequence[int | str] = WHOLE,
    ax: Axes = NEW,
    *,
    direction: str = "t1",
) -> None:
    """Plot hysteresis loops of force against displacement.

    Parameters
    ----------
    result : Hysteresis
    where : int, str or sequence of these
        Indices of contact points, names of faces, or "whole".  "whole" is the loop of all contacts:
        the force at the response location that does the same work, against the response.
    direction : {"t1", "t2", "n"}
        Direction of points and faces.
    """
    places = [where] if isinstance(where, (int, np.integer, str)) else list(where)
    if not places or (WHOLE in places and len(places) > 1):
        raise validation.invalid("where", f'contact points and faces, or only "{WHOLE}"', where)
    of_whole = places == [WHOLE]
    energy: dict[Any, float] = {WHOLE: result.lost}
    energy |= result.by_interface
    energy |= dict(enumerate(result.energy))
    for place, look in zip(places, looks(len(places))):
        label = _name(result, place)
        # friction does no work along the normal
        if of_whole:
            label += f",\n{amount(energy[place], 'J')} per cycle"
        elif direction != "n":
            label += f",\n{amount(energy[place], 'J')} per cycle in all directions"
        ax.plot(*result.loop(place, direction), **{**look, "marker": "", "label": label})
    if of_whole:
        ax.set(**OF_WHOLE)
    else:
        where_text = NAMES[direction]
        if len(places) == 1:
            where_text += f", {_name(result, places[0])}"
        ax.set(xlabel=f"Motion {where_text} (m)", ylabel=f"Force {where_text} (N)")
    preload = amount(result.preload, "N")
    ax.set_title(f"Friction over a cycle at {amount(result.frequency, 'Hz')}, preload {preload}")


@picture(Hysteresis, "history", size=(COLUMN, 3.3), rows=2)
def plot_history(result: Hysteresis, where: int, ax: NDArray = NEW) -> None:
    """Plot the forces, vibration and gap of one contact point over a cycle, in two axes.

    Parameters
    ----------
    result : Hysteresis
    where : int
        Index of the point.
    """
    row = validation.integer("where, index of a contact point", where, 0, len(result.points) - 1)
    time = result.theta / (2.0 * np.pi)
    forces, motions = ax
    # one look for each direction, the last one for the gap
    lines = [{**look, "marker": ""} for look in looks(len(AXES) + 1)]
    for k, name in enumerate(AXES):
        forces.plot(time, result.force[row, k], **lines[k], label=NAMES[name])
        # along the normal, the axes show the gap
        if name != "n":
            motion, _ = result.loop(row, name)
            motions.plot(time, motion, **lines[k], label=NAMES[name])
    if result.gap[row].max() > 0.0:
        motions.plot(time, result.gap[row], **lines[-1], label="gap")
    forces.set(ylabel="Contact force (N)", xlim=(0.0, 1.0))
    preload = amount(result.preload, "N")
    forces.set_title(f"{_name(result, row)}, {amount(result.frequency, 'Hz')}, preload {preload}")
    motions.set(ylabel="Motion and gap (m)", xlabel="Time (periods)")


@register_plot(Hysteresis, "energy")
def plot_energy(result: Hysteresis) -> NDArray:
    """Plot the energy dissipated per cycle and unit area on the faces that dissipate energy."""
    density = np.maximum(result.energy, 0.0) / result.area
    least = 1e-9 * float(density.max(initial=0.0))
    faces = []
    values = []
    for name in result.interfaces:
        rows = result.rows(name)
        if (density[rows] > least).any():
            faces.append((f"{name} face", result.points[rows], result.frame[rows]))
            values.append(density[rows])
    if not faces:
        raise SettingError("energy: no contact point dissipates energy, since nothing slips")
    return plot_faces(faces, values, "Energy per cycle (J/m$^2$)")


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
    validation.check(
        np.ndim(result.damping_ratio) == 1,
        "dissipation",
        "a result of several solutions, study.dissipation(curve)",
        "one solution",
    )
    stiffness, damping, energy = ax
    draw_table(stiffness, result, over, "stiffness")
    stiffness.set_xlabel("")
    draw_table(damping, result, over, "damping_ratio")
    damping.set_xlabel("")
    energy.set(ylabel="Energy per cycle (J)", yscale="log")
    draw_table(
        energy, result, over, "excitation", color="0.7", marker="", label="work of the excitation"
    )
    least = 1e-9 * result.lost.max()
    lost_by_face = {
        name: lost for name, lost in result.by_interface.items() if (lost > least).any()
    }
    for (name, lost), look in zip(lost_by_face.items(), looks(len(lost_by_face))):
        look |= {
            "markevery": max(1, len(lost) // 12),
            "linestyle": "-",
            "label": f"friction of the {name} face",
        }
        # drawn as a column of the same table
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
    if result.single:
        return plot_loops(result, *arguments, **options)
    return plot_dissipation(result, *arguments, **options)
