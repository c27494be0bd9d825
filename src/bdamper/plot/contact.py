"""Contact faces: what their points do over a period and what they carry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bdamper.contact.static_state import PreloadState
from bdamper.model.structure import Model
from bdamper.plot.axes import NEW, STYLE, drawing, fit_units, legend_beside, picture
from bdamper.plot.motion import STATES, ContactStatus
from bdamper.response.peak import Peak
from bdamper.util import validation
from bdamper.util.display import draws
from bdamper.util.errors import BdamperError
from bdamper.util.tables import label as label_of

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
    points = validation.wholes("points", points, most=len(status.parts) - 1)
    direction = validation.whole("direction", direction, 0, 1)
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
    direction = validation.whole("direction", direction, 0, 1)
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


@draws(PreloadState)
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
