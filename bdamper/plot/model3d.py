"""Bodies, modes and contact points in space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from numpy.typing import NDArray

from bdamper.io.import_report import ImportReport
from bdamper.model.model import Model, turn
from bdamper.plot.axes import FIXED, MARKERS, PAPER, colours, save_figure
from bdamper.plot.vtu import shown_shapes
from bdamper.util import validate
from bdamper.util.errors import SettingError
from bdamper.util.plotting import draws

Surface = tuple[NDArray, NDArray, Any]
"""Points (n, 3) in m, quadrilaterals (m, 4), and a colour, alone or with its opacity, or a value (n,) for each point."""
MOST_FACES = 100_000
"""Of more quadrilaterals matplotlib draws every second, third ...: so many take 0.9 s."""


def _parts_to_show(model: Model) -> list[tuple[str, int, NDArray]]:
    """Bodies with a surface, the sectors in which the interfaces show them, and the rotations (3, 3) into these."""
    places = {(face.body_a, face.sector_a) for face in model.interfaces.values()}
    places |= {(face.body_b, face.sector_b) for face in model.interfaces.values()}
    shown = sorted(place for place in places if place[0] in model.meshes)
    return [(name, sector, turn(2.0 * np.pi * sector / model.n_blades)) for name, sector in shown]


def plot_surfaces(surfaces: Sequence[Surface], points: NDArray | None = None, path: Any = None, *, title: str = "") -> Any:
    """Draw surfaces of quadrilaterals in 3-D.

    Parameters
    ----------
    surfaces : sequence of Surface
    points : (k, 3) float, optional
        Marked by dots.
    path : path-like, optional
        Where to write a picture.
    title : str

    Returns
    -------
    matplotlib axes
    """
    # the picture's axes are (Z, X, Y): Y up
    with plt.rc_context(FIXED):
        figure = plt.figure(figsize=(4.2, 5.0))
        ax: Any = figure.add_axes((0.0, 0.16, 0.76, 0.79), projection="3d")  # labels stand on the right
        every = 1e3 * np.concatenate([np.asarray(p, float)[:, [2, 0, 1]] for p, _, _ in surfaces])
        low, high = every.min(axis=0), every.max(axis=0)
        _box(ax, low, high, "ZXY")
        ax.set_box_aspect(high - low)
        ax.view_init(elev=18.0, azim=-40.0)
        if title:
            ax.set_title(title, fontsize=9.0)
        _room_for_ticks(ax)  # before there are faces, as it draws many times
        top = max((float(np.max(v)) for _, _, v in surfaces if isinstance(v, np.ndarray)), default=1.0) or 1.0
        step = max(1, -(-sum(len(quads) for _, quads, _ in surfaces) // MOST_FACES))
        for place, every_quad, colour in surfaces:
            quads = every_quad[::step]
            corner = 1e3 * np.asarray(place, float)[:, [2, 0, 1]][quads]
            values = isinstance(colour, np.ndarray)
            face = plt.get_cmap("viridis")(colour[quads].mean(axis=1) / top) if values else colour
            ax.add_collection3d(Poly3DCollection(corner, facecolors=face, edgecolors="0.4", linewidths=0.15, clip_on=False))
        if points is not None and len(points):
            ax.scatter(*(1e3 * np.asarray(points, float)[:, [2, 0, 1]].T), s=7.0, c="k", depthshade=False)
        if path is not None:
            save_figure(figure, path)
    return ax


def _box(ax: Any, low: NDArray, high: NDArray, names: str) -> None:
    """Limits and labels of the axes of a 3-D picture in mm."""
    for name, axis, a, b in zip(names, "xyz", low, high):
        ax.set(**{f"{axis}lim": (a, b), f"{axis}label": f"{name} (mm)"})


def _room_for_ticks(ax: Any) -> None:
    """On the axes of a 3-D picture no more ticks than have room, and labels clear of them."""
    ax.tick_params(labelsize=6.5, pad=1.0)
    ax.tick_params(axis="z", pad=6.0)
    axes = (ax.xaxis, ax.yaxis, ax.zaxis)
    for axis in axes:
        axis.label.set_size(8.0)
    crowded = list(axes)
    for n in (5, 4, 3, 2, 1):
        for axis in crowded:
            axis.set_major_locator(MaxNLocator(n, min_n_ticks=1))
        ax.figure.draw_without_rendering()
        boxes = {axis: [t.get_window_extent().padded(2.0) for t in _tick_texts(axis)] for axis in axes}
        crowded = [axis for axis in axes if _overlap(boxes[axis])]
        for i, axis in enumerate(axes):
            if any(a.overlaps(b) for a in boxes[axis] for other in axes[:i] for b in boxes[other]):
                crowded.append(axis)
        if not crowded:
            break
    ticks = [t for axis in axes for t in _tick_texts(axis)]
    for i, axis in enumerate(axes):
        others = [*ticks, *(o.label for o in axes[:i])]
        for _ in range(12):
            box = axis.label.get_window_extent()
            if not any(box.overlaps(t.get_window_extent()) for t in others):
                break
            axis.labelpad += 3.0
            ax.figure.draw_without_rendering()


def _tick_texts(axis: Any) -> list[Any]:
    """Labels of the ticks of an axis that are drawn."""
    low, high = sorted(axis.get_view_interval())
    return [t.label1 for t in axis.get_major_ticks() if low <= t.get_loc() <= high and t.label1.get_text()]


def _overlap(boxes: list[Any]) -> bool:
    return any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


@draws(Model)
def plot_model(model: Model, path: Any = None) -> Any:
    """Bodies at rest and contact points in 3-D; see `plot_surfaces`."""
    # blades are transparent
    tint = {"constrained": ("#b9c6d2", 0.35), "free": ("#e8b563", 1.0), "ground": ("#cccccc", 1.0)}
    surfaces = [
        (model.meshes[name].points @ turned.T, model.meshes[name].quads, tint[model.bodies[name].kind])
        for name, _, turned in _parts_to_show(model)
    ]
    validate.require(surfaces, "plot of a model", "at least one body with a mesh", "none")
    points = np.concatenate([face.points for face in model.interfaces.values()])
    return plot_surfaces(surfaces, points, path)


@draws(Model, "plot_mode")
def plot_mode(
    model: Model,
    mode: int = 1,
    path: Any = None,
    *,
    body: str | None = None,
    nodal_diameter: int | None = None,
) -> Any:
    """A mode of a constrained body in 3-D: deformed, coloured by the size of its amplitude.

    Parameters
    ----------
    model : Model
    mode : int
        From 1.
    path : path-like, optional
    body, nodal_diameter : optional
        The first that carry shapes.

    Returns
    -------
    matplotlib axes
        The largest displacement is a twelfth of the body's size.
    """
    mode = validate.whole("mode (the path is the third argument)", mode, least=1)
    body, d = shown_shapes(model, body, nodal_diameter, "plot of a mode")
    mesh = model.meshes[body]
    shapes = mesh.modes.get(d)
    if shapes is None or not 1 <= mode <= shapes.shape[2]:
        have = {key: value.shape[2] for key, value in mesh.modes.items()}
        raise SettingError(
            f"plot of a mode: expected one of the modes that the mesh carries, by nodal diameter {have}, "
            f"found mode {mode} of nodal diameter {d}"
        )
    shape = shapes[..., mode - 1]
    scale = float(np.ptp(mesh.points, axis=0).max()) / 12.0 / float(np.abs(shape).max())
    surfaces = []
    for name, sector, turned in _parts_to_show(model):
        if name == body:
            wave = np.exp(2j * np.pi * d * sector / model.n_blades)
            moved = mesh.points + scale * (shape * wave).real
            surfaces.append((moved @ turned.T, mesh.quads, np.linalg.norm(np.abs(shape), axis=1)))
    frequency = float(np.sqrt(model.bodies[body].bases[d].omega2[mode - 1])) / (2.0 * np.pi)
    return plot_surfaces(surfaces, None, path, title=f"mode {mode}, nodal diameter {d}: {frequency:.1f} Hz")


@draws(ImportReport)
def plot_import_report(report: ImportReport) -> Figure:
    """Frequencies over nodal diameter beside the bodies with their contact points.

    Parameters
    ----------
    report : ImportReport

    Returns
    -------
    Figure
    """
    with plt.rc_context(PAPER):
        figure = plt.figure(figsize=(9.0, 4.2))
        left, right = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="3d")
        diameters = np.array(sorted(report.frequencies))
        n = min((len(report.frequencies[d]) for d in diameters), default=0)
        for mode in range(min(n, 8)):
            values = [report.frequencies[d][mode] for d in diameters]
            left.plot(diameters, values, marker=MARKERS[mode % len(MARKERS)], color=colours(8)[mode], markersize=4)
        left.set(xlabel="Nodal diameter", ylabel="Frequency (Hz)", ylim=(0.0, None))
        left.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        left.set_title("sector", fontsize=9.0)
        points = [1e3 * face.points for face in report.model.interfaces.values()]
        for k, (name, face) in enumerate(report.model.interfaces.items()):
            right.scatter(*(1e3 * face.points).T, s=6, color=colours(max(len(points), 2))[k], label=name, depthshade=False)
        shown = [1e3 * mesh.points for mesh in report.model.meshes.values()] or points
        if shown:
            low, high = np.concatenate(shown).min(axis=0), np.concatenate(shown).max(axis=0)
            _box(right, low, high, "XYZ")
            right.set_box_aspect(np.maximum(high - low, 1e-3 * np.ptp([low, high])))
        right.legend(loc="upper left", bbox_to_anchor=(0.9, 1.0), fontsize=7.0)
        _room_for_ticks(right)  # before there are edges, as it draws many times
        for k, mesh in enumerate(report.model.meshes.values()):
            edges = np.concatenate([mesh.quads[:, [i, (i + 1) % 4]] for i in range(4)])
            edges = np.unique(np.sort(edges, axis=1), axis=0)
            edges = edges[edges[:, 0] != edges[:, 1]]
            right.add_collection3d(Line3DCollection(1e3 * mesh.points[edges], colors=["0.6", "0.2"][k % 2], linewidths=0.4))
    return figure
