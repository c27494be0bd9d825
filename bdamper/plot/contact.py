"""Contact faces: what their points do over a period, what they carry, and how stiff they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from bdamper.contact.preload import PreloadState
from bdamper.contact.stiffness import StiffnessComparison
from bdamper.contact.wedge import ContactMap
from bdamper.model.model import Model
from bdamper.peaks.newton import Peak
from bdamper.plot.axes import FIXED, PAPER, drawing
from bdamper.plot.motion import STATES, ContactStatus, contact_status, relative_motion, rigid_displacement, rigid_motion
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.plotting import draws
from bdamper.util.text import amount

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
    points = validate.wholes("points", points, most=len(status.parts) - 1)
    direction = validate.whole("direction", direction, 0, 1)
    period = 2.0 * np.pi
    with drawing(ax, size=(5.2, 0.9 + 0.32 * len(points)), title=title) as ax:
        for row, point in enumerate(points):
            for start, end, state in status.parts[point][direction]:
                for shift in (0.0, -period):  # the last part may pass the end of the period
                    a, b = max(start + shift, 0.0), min(end + shift, period)
                    if b > a:
                        ax.barh(row, (b - a) / period, left=a / period, height=0.62, color=STATUS_COLOURS[state], **EDGE)
        names = [f"{status.interface[p]} {p - status.rows(status.interface[p])[0] + 1}" for p in points]
        ax.set_yticks(range(len(points)), names)
        ax.invert_yaxis()
        ax.set(xlim=(0.0, 1.0), xlabel="Time (periods)")
        ax.grid(False)
        _status_legend(ax)
    return ax


def _status_legend(ax: Axes) -> None:
    handles = [Patch(facecolor=c, label=n, **EDGE) for c, n in zip(STATUS_COLOURS, STATES)]
    ax.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=7.0)


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


def plot_status_map(
    status: ContactStatus,
    model: Model,
    interface: str,
    ax: Axes | None = None,
    *,
    instant: int | None = None,
    direction: int = 0,
    title: str = "",
) -> Axes:
    """Map of a contact face: what every point does over the period (bars by share), or at one instant.

    Parameters
    ----------
    status : ContactStatus
    model : Model
    interface : str
    ax : matplotlib axes, optional
    instant : int, optional
        Index into ``status.theta``; without it each point is divided by the shares of the period that it sticks, slips
        and is open.
    direction : {0, 1}
    title : str
    """
    validate.choice("interface", interface, [name for name in model.interfaces if name in status.interface])
    direction = validate.whole("direction", direction, 0, 1)
    if instant is not None:
        instant = validate.whole("instant", instant, -len(status.theta), len(status.theta) - 1)
    with drawing(ax, size=(5.2, 2.4), title=title) as ax:
        face, rows = model.interfaces[interface], status.rows(interface)
        x, y, dx, dy = face_coordinates(face.points, face.frame[0])
        share = status.share
        for i, row in enumerate(rows):
            left, bottom, width, height = y[i] - 0.45 * dy, x[i] - 0.45 * dx, 0.9 * dy, 0.9 * dx
            if instant is not None:
                colour = STATUS_COLOURS[status.state[row, direction, instant]]
                ax.add_patch(Rectangle((left, bottom), width, height, facecolor=colour, **EDGE))
                continue
            for part, colour in zip(width * share[row, direction], STATUS_COLOURS):
                ax.add_patch(Rectangle((left, bottom), part, height, facecolor=colour, linewidth=0.0))
                left += part
            ax.add_patch(Rectangle((y[i] - 0.45 * dy, bottom), width, height, fill=False, **EDGE))
        _face_axes(ax, x, y, dx, dy)
        _status_legend(ax)
    return ax


def plot_faces(
    places: list[tuple[str, NDArray, NDArray]], values: list[NDArray], titles: list[str], label: str, unit: float
) -> NDArray:
    """Values over several faces as coloured patches, one row for each kind, one column for each face."""
    n_rows, n_faces = len(values) // len(places), len(places)
    with plt.rc_context(PAPER):
        figure, axes = plt.subplots(n_rows, n_faces, figsize=(3.4 * n_faces, 1.7 * n_rows + 0.3), squeeze=False)
        for row in range(n_rows):
            block = values[row * n_faces : (row + 1) * n_faces]
            low, high = (float(f(np.concatenate(block) / unit)) for f in (np.nanmin, np.nanmax))
            norm = Normalize(low, high if high > low else low + 1.0)
            for ax, (name, points, frame), value in zip(axes[row], places, block):
                x, y, dx, dy = face_coordinates(points, frame[0])
                for i, v in enumerate(value / unit):
                    colour = plt.get_cmap("viridis")(norm(v)) if np.isfinite(v) else (1.0, 1.0, 1.0, 1.0)
                    corner = (y[i] - 0.48 * dy, x[i] - 0.48 * dx)
                    ax.add_patch(Rectangle(corner, 0.96 * dy, 0.96 * dx, facecolor=colour, edgecolor="0.4", linewidth=0.3))
                _face_axes(ax, x, y, dx, dy)
                if row < n_rows - 1:
                    ax.set_xlabel("")
                if ax is not axes[row, 0]:
                    ax.set_ylabel("")
                ax.set_title(f"{name}, {titles[row]}" if titles[row] else name, fontsize=8.0)
            figure.colorbar(plt.cm.ScalarMappable(norm, "viridis"), ax=axes[row].tolist(), label=label, shrink=0.9)
    return axes.ravel()


@draws(PreloadState)
def plot_static(state: PreloadState, ax: Axes | None = None) -> Axes:
    """Normal force of every contact point in the static state, in the colour of what it does."""
    with drawing(ax, title=f"preload {amount(state.load, 'N')}") as ax:
        shades = [STATUS_COLOURS[("stick", "slip", "open").index(name)] for name in state.state]
        ax.bar(np.arange(1, len(shades) + 1), state.force[:, 2], color=shades, **EDGE)
        ax.set(xlabel="Contact point", ylabel="Normal force (N)")
        _status_legend(ax)
    return ax


@draws(Peak)
def plot_peak(peak: Peak, ax: Axes | None = None) -> Axes:
    """Shares of the cycle that contacts stick, slip and are open at the peak."""
    with drawing(ax, size=(5.6, 1.5), title=peak.bottom_line()) as ax:
        ax.barh(["contacts"] * 3, 100.0 * peak.shares, left=100.0 * (np.cumsum(peak.shares) - peak.shares),
                color=STATUS_COLOURS, **EDGE)  # fmt: skip
        ax.set(xlabel="Share of the cycle (%)", xlim=(0.0, 100.0))
        _status_legend(ax)
    return ax


@draws(ContactMap)
def plot_contact_map(contact: ContactMap, quantity: str = "pressure") -> NDArray:
    """Pressure, gap or use of the friction limit over the friction faces; open points stay white.

    Parameters
    ----------
    contact : ContactMap
    quantity : {"pressure", "gap", "friction"}
    """
    closed = contact.force[:, 2] > 0.0
    choices = {
        "pressure": (np.where(closed, contact.pressure, np.nan), "Pressure (MPa)", 1e6),
        "gap": (contact.distance, "Gap (µm)", 1e-6),
        "friction": (np.where(closed, contact.utilisation.max(axis=1), np.nan), "Friction force / limit", 1.0),
    }
    validate.choice("quantity", quantity, choices)
    value, label, unit = choices[quantity]
    faces = [i for i in range(len(contact.interfaces)) if contact.friction[contact.owner == i].any()]
    faces = faces or list(range(len(contact.interfaces)))
    places = [(contact.interfaces[i], contact.points[contact.owner == i], contact.frame[contact.owner == i]) for i in faces]
    values = [value[contact.owner == i] for i in faces]
    if not np.isfinite(np.concatenate(values)).any():
        values = [np.zeros(len(v)) for v in values]
    return plot_faces(places, values, [""], label, unit)


@draws(StiffnessComparison)
def plot_stiffness(comparison: StiffnessComparison, method: str = "eq4") -> NDArray:
    """Contact stiffness per area over the faces, for t1, t2 and n; points of the fallback rule stay white."""
    validate.choice("method", method, comparison.stiffness)
    places = [(name, comparison.points[name], comparison.frame[name]) for name in comparison.interfaces]
    values = []
    for axis in range(3):
        for name in comparison.interfaces:
            contact = comparison.stiffness[method][name]
            value = contact.stiffness[:, axis] / comparison.area[name]
            if contact.fallback is not None and not contact.fallback[:, axis].all():
                value = np.where(contact.fallback[:, axis], np.nan, value)
            values.append(value)
    return plot_faces(places, values, ["t1", "t2", "n"], "Stiffness (N/mm$^3$)", 1e9)


# ---- the damper between its platforms ----


def animate_damper(
    problem: Problem,
    unknowns: NDArray,
    preload: float,
    path: Any,
    *,
    body: str | None = None,
    frames: int = 36,
    scale: float | None = None,
) -> float:
    """Write an animation (GIF) of the cross-section of a damper between its platforms, with the state of its contacts.

    The damper moves with its vibration; its mean displacement is left out.  Each contact point has a dot on the damper and
    one on the platform, which is drawn as a line through its dots.  They move against each other as the bodies do: along
    the face with the vibration, away from it by the gap where the point is open, all magnified alike.  Points in contact
    stay on the face, the little by which contact springs are pressed together is not drawn.

    Parameters
    ----------
    problem : Problem
    unknowns : (n_unknowns,) float
        Solution, for example ``curve.unknowns[curve.peak.index]``.
    preload : float, N
    path : path-like
        Ends with ``.gif``.
    body : str, optional
        The only free body by default.
    frames : int
        Pictures of one period.
    scale : float, optional
        Magnification of displacements; by default such that the largest is a tenth of the damper's height.

    Returns
    -------
    float
        The magnification.
    """
    figure, draw, scale = damper_picture(problem, unknowns, preload, body=body, frames=frames, scale=scale)
    with plt.rc_context(FIXED):
        writer = PillowWriter(fps=12)
        with writer.saving(figure, path, dpi=90):
            for k in range(frames):
                draw(k)
                writer.grab_frame()
        plt.close(figure)
    return scale


@dataclass(frozen=True)
class _DamperMotion:
    """A damper and the points of its friction faces over one period, in the plane of the picture.

    Parameters
    ----------
    status : ContactStatus
    outline : (n, 2) float, mm
        Of the front, at rest.
    body : (n_theta, n, 2) float, mm
        Its displacement.
    points : dict of interface to (n_points, 2) float, mm
    damper, platform : dict of interface to (n_theta, n_points, 2) float, mm
        Displacement of the points on either side.
    height, largest : float, mm
        Of the damper, and of the displacements in space.
    """

    status: ContactStatus
    outline: NDArray
    body: NDArray
    points: dict[str, NDArray]
    damper: dict[str, NDArray]
    platform: dict[str, NDArray]
    height: float
    largest: float


def _damper_motion(problem: Problem, unknowns: NDArray, preload: float, body: str | None, frames: int) -> _DamperMotion:
    model = problem.coupling.model  # with united contact points, if the study asks for that
    name = rigid_motion(problem, unknowns, body).body
    have = list(problem.model.meshes)
    validate.require(name in problem.model.meshes, "animation", f"a mesh of '{name}' in the model", f"meshes of {have}")
    part, mesh = problem.model.bodies[name], problem.model.meshes[name]
    status = contact_status(problem, unknowns, preload, frames)
    along, distance = relative_motion(problem, unknowns, preload, status.theta)
    up = np.array([0.0, 1.0, 0.0]) if part.load is None else part.load.direction
    plane = 1e3 * np.stack([np.cross(up, [0.0, 0.0, 1.0]), up], axis=1)
    wave = np.exp(1j * status.theta)

    def flat(place: NDArray) -> NDArray:
        return (place - part.centre) @ plane

    def moving(points: NDArray) -> NDArray:
        """(n_theta, n, 3) displacement of points of the damper."""
        return (rigid_displacement(problem, unknowns, name, points)[1] * wave[:, None, None]).real

    front = np.flatnonzero(mesh.points[:, 2] > mesh.points[:, 2].max() - 1e-9)
    outline = mesh.points[front[ConvexHull(flat(mesh.points[front])).vertices]]
    sides = {port: 1.0 if side == "a" else -1.0 for port, side in part.ports if model.interfaces[port].kind == "friction"}
    own = {port: moving(model.interfaces[port].points) for port in sides}
    other = {}
    for port, sign in sides.items():
        rows, frame = status.rows(port), model.interfaces[port].frame
        gap = np.maximum(distance[rows], 0.0)
        off = np.concatenate([along[rows], gap[:, None]], axis=1)  # (n, 3, n_theta) along t1, t2, n
        other[port] = own[port] + sign * np.einsum("pit,pix->tpx", off, frame)
    whole = moving(outline)
    return _DamperMotion(
        status=status,
        outline=flat(outline),
        body=whole @ plane,
        points={port: flat(model.interfaces[port].points) for port in sides},
        damper={port: move @ plane for port, move in own.items()},
        platform={port: move @ plane for port, move in other.items()},
        height=float(np.ptp(flat(mesh.points)[:, 1])),
        largest=1e3 * max(float(np.abs(d).max()) for d in (whole, *own.values(), *other.values())),
    )


def damper_picture(
    problem: Problem,
    unknowns: NDArray,
    preload: float,
    *,
    body: str | None = None,
    frames: int = 36,
    scale: float | None = None,
) -> tuple[Figure, Callable[[int], dict[str, tuple[NDArray, NDArray]]], float]:
    """The picture that :func:`animate_damper` animates.

    Parameters
    ----------
    As for :func:`animate_damper`.

    Returns
    -------
    Figure
    callable
        Draws the instant ``k`` out of ``frames``; returns the places (n, 2) in mm of the dots on damper and platform, by
        interface.
    float
        The magnification.
    """
    frames = validate.whole("frames", frames, least=1)
    if scale is not None:
        scale = validate.number("scale", scale, above=0.0)
    motion = _damper_motion(problem, unknowns, preload, body, frames)
    factor = 0.1 * motion.height / max(motion.largest, 1e-300) if scale is None else float(scale)
    with plt.rc_context(FIXED):
        figure, (ax, *maps) = plt.subplots(
            1, 1 + len(motion.points), figsize=(3.0 + 1.7 * len(motion.points), 3.2),
            width_ratios=[2.4] + [1.0] * len(motion.points),
        )  # fmt: skip
        figure.subplots_adjust(left=0.08, right=0.99, bottom=0.16, top=0.84, wspace=0.35)
        head = "contact points: dark stick, orange slip, light open; lines: platforms"
        figure.text(0.5, 0.965, head, ha="center", va="top", fontsize=8.0)
        ax.fill(*motion.outline.T, facecolor="none", edgecolor="0.6", linewidth=0.8, linestyle=":")
        (shape,) = ax.fill(*motion.outline.T, facecolor="0.85", edgecolor="0.2", linewidth=0.9)
        look = {"s": 14, "edgecolors": "0.2", "linewidths": 0.4, "zorder": 3}
        dots, lines = {}, {}
        for port, places in motion.points.items():
            (lines[port],) = ax.plot([], [], color="0.2", linewidth=1.6)
            dots[port] = ax.scatter(*places.T, **look), ax.scatter(*places.T, marker="s", **look)
        margin = 0.12 * motion.height + factor * motion.largest
        every = np.concatenate([motion.outline, *motion.points.values()])
        (left, bottom), (right, top) = every.min(axis=0) - margin, every.max(axis=0) + margin
        ax.set(aspect="equal", xlim=(left, right), ylim=(bottom, top), xlabel="X (mm)", ylabel="Y (mm)")
        for panel, port in zip(maps, motion.points):
            plot_status_map(motion.status, problem.coupling.model, port, panel, instant=0, title=port)
            panel.get_legend().remove()
            panel.set(aspect="auto", xlabel="Axis (mm)", ylabel="Outward (mm)" if panel is maps[0] else "")

    def draw(k: int) -> dict[str, tuple[NDArray, NDArray]]:
        shape.set_xy(motion.outline + factor * motion.body[k])
        ax.set_title(f"vibration x {factor:.0f}, phase {360 * k // frames} deg", fontsize=8.0)
        shown = {}
        for panel, (port, points) in zip(maps, motion.points.items()):
            here, there = points + factor * motion.damper[port][k], points + factor * motion.platform[port][k]
            colour = [STATUS_COLOURS[s] for s in motion.status.state[motion.status.rows(port), 0, k]]
            for dot, places in zip(dots[port], (here, there)):
                dot.set_offsets(places)
                dot.set_facecolor(colour)
            lines[port].set_data(*_line_through(there).T)
            for patch, one in zip(panel.patches, colour):
                patch.set_facecolor(one)
            shown[port] = here, there
        return shown

    return figure, draw, factor


def _line_through(places: NDArray) -> NDArray:
    """(2, 2) ends of the straight line nearest to points of a plane, a fifth longer than they are on either side."""
    centre = places.mean(axis=0)
    direction = np.linalg.svd(places - centre)[2][0]
    reach = 0.7 * float(np.ptp((places - centre) @ direction))
    return centre + np.outer([-reach, reach], direction)
