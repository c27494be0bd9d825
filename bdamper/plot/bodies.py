"""Plots of bodies, modes and contact points in space, and export to VTU files for ParaView.

The export uses meshio (extra ``bdamper[viz]``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, cast

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.patches import Patch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_boundary import accepts_study
from bdamper.importers.build import BuiltModel
from bdamper.model.structure import Model, SurfaceMesh
from bdamper.plot.axes import (
    OPTIMUM,
    SMALL,
    STYLE,
    finish,
    legend_columns,
    legend_entries,
    looks,
    new_axes,
)
from bdamper.plot.motion import VIEW, sectors_shown, surface_motion
from bdamper.util import validation
from bdamper.util.display import register_plot
from bdamper.util.errors import SettingError, import_extra
from bdamper.util.formatting import amount
from bdamper.util.storage import file_errors

# ---- Export ----


def shown_shapes(
    model: Model, body: str | None, nodal_diameter: int | None, purpose: str
) -> tuple[str, int]:
    """Return the body and the nodal diameter of the shapes to show, by default the first ones."""
    bodies = [name for name, mesh in model.meshes.items() if mesh.modes]
    if not bodies:
        raise SettingError(
            f"{purpose}: needs mode shapes on the mesh of a body, and the model has none"
        )
    body = bodies[0] if body is None else body
    if body not in bodies:
        expected = f"a body with mode shapes on its mesh out of {bodies}"
        raise SettingError(f"{purpose}: expected {expected}, found {body!r}")
    modes = model.meshes[body].modes
    diameter = next(iter(modes)) if nodal_diameter is None else nodal_diameter
    expected = f"a nodal diameter out of {sorted(modes)}"
    validation.check(diameter in modes, purpose, expected, diameter)
    return body, diameter


def export_modes(
    model: Model,
    path: str | PathLike[str],
    body: str | None = None,
    nodal_diameter: int | None = None,
) -> Path:
    """Write the mode shapes on the surface of a body, real and imaginary part of each mode.

    Parameters
    ----------
    model : Model
    path : path-like
        Name of the file, with the extension ``.vtu``.
    body : str, optional
        By default the first body with mode shapes.
    nodal_diameter : int, optional
        By default the first nodal diameter with mode shapes.

    Returns
    -------
    Path

    Raises
    ------
    SettingError
        If the model has no such shapes.
    """
    body, diameter = shown_shapes(model, body, nodal_diameter, "export of modes")
    mesh = model.meshes[body]
    frequency = np.sqrt(model.bodies[body].bases[diameter].omega2) / (2.0 * np.pi)
    shapes = np.moveaxis(mesh.modes[diameter], 2, 0)
    fields = {}
    for number, (f, shape) in enumerate(zip(frequency, shapes), 1):
        fields[f"mode {number}, {amount(f, 'Hz')}, {{}}"] = shape
    return _write(path, mesh.points, mesh.quads, fields)


def _write(
    path: str | PathLike[str], points: NDArray, quads: NDArray, fields: dict[str, NDArray]
) -> Path:
    """Write vector fields on a surface; "real" or "imaginary" replaces ``{}`` in a name."""
    meshio = import_extra("meshio", "export to VTU", "viz")
    data = {}
    for name, field in fields.items():
        data[name.format("real")] = np.ascontiguousarray(field.real)
        if np.iscomplexobj(field):
            data[name.format("imaginary")] = np.ascontiguousarray(field.imag)
    with file_errors(path):
        meshio.Mesh(points, [("quad", quads)], point_data=data).write(path)
    return Path(path)


@accepts_study
def export_response(
    problem: Problem, unknowns: NDArray, folder: str | PathLike[str], name: str = "response"
) -> list[Path]:
    """Write the mean and the complex vibration of every body with a surface.

    The mean is omitted if the mesh has no mode shapes of nodal diameter 0.

    Parameters
    ----------
    problem : Problem
    unknowns : (n_unknowns,) float
        A solution, for example ``curve.peak.y[:-1]``.
    folder : path-like
    name : str
        Files are called ``<name>_<body>.vtu``.

    Returns
    -------
    list of Path

    Raises
    ------
    SettingError
        If the model has no surface, or no mode shapes at the nodal diameter of the excitation.
    """
    if not problem.model.meshes:
        raise SettingError("export of a response: needs the mesh of a body, and the model has none")
    files = []
    for body, motion in surface_motion(problem, unknowns).items():
        fields = {}
        if np.isfinite(motion.mean).all():
            fields["mean displacement, m"] = motion.mean
        fields["vibration, {}, m"] = motion.amplitude
        quads = problem.model.meshes[body].quads
        file = Path(folder) / f"{name}_{body}.vtu"
        files.append(_write(file, motion.points, quads, fields))
    return files


# ---- Plots ----

Surface = tuple[NDArray, NDArray, Any]
"""Points (n, 3) in m, quadrilaterals (m, 4), and a colour (with or without opacity) or a value (n,)
for each point.
"""


def plot_surfaces(surfaces: Sequence[Surface], ax: Axes | None = None, *, title: str = "") -> Axes:
    """Plot surfaces of quadrilaterals in an oblique view from the front, with a length scale.

    Faces of all surfaces are drawn from the farthest to the nearest, so that they hide the ones
    behind them.

    Parameters
    ----------
    surfaces : sequence of Surface
    ax : matplotlib axes, optional
        The surfaces cover everything that earlier calls have drawn in these axes.
    title : str
    """
    largest_values = [float(np.max(v)) for _, _, v in surfaces if isinstance(v, np.ndarray)]
    largest = max(largest_values, default=1.0) or 1.0
    corners = []
    shades = []
    for points, quads, colour in surfaces:
        corners_of_faces = seen(points)[quads]
        corners.append(corners_of_faces)
        if isinstance(colour, np.ndarray):
            value = colour[quads].mean(axis=1)
            shades.append(plt.get_cmap("viridis")(value / largest))
        else:
            shades.append(_shaded(corners_of_faces, colour))
    corner = np.concatenate(corners)
    shade = np.concatenate(shades)
    # the third direction is toward the viewer
    farthest_first = np.argsort(corner[..., 2].mean(axis=1))
    is_new = ax is None
    with plt.rc_context(STYLE):
        ax = new_axes(height=3.2) if ax is None else ax
        look: dict[str, Any] = {"edgecolors": "0.35", "linewidths": 0.15, "rasterized": True}
        faces = PolyCollection(
            list(corner[farthest_first, :, :2]), facecolors=shade[farthest_first], **look
        )
        ax.add_collection(faces)
        if is_new:
            ax.autoscale_view()
            ax.set(aspect="equal", title=title)
            ax.set_axis_off()
            _scale(ax)
    return ax


def _shaded(corners: NDArray, colour: Any) -> NDArray:
    """Return the colours (n, 4) of faces with corners (n, 4, 3) in the view, lit from above."""
    # the normal is perpendicular to both diagonals
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    size = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    light = 0.7 + 0.3 * np.abs(normal @ [-0.3, 0.8, 0.5]) / size
    opacity = np.ones(len(light))
    return np.asarray(to_rgba(colour) * np.column_stack([light, light, light, opacity]))


TINT = {"constrained": "#dde4ea", "free": "#e8b563", "ring": "#e8b563", "ground": "#cccccc"}
"""Colours of the kinds of bodies."""


def seen(points: Any) -> NDArray:
    """Return points (n, 3) in the view directions right, up and toward the viewer, in mm."""
    return 1e3 * np.asarray(points, float) @ VIEW.T


def _scale(ax: Axes) -> None:
    """Draw a length scale and the coordinate directions below a plot in mm."""
    left, right = ax.get_xlim()
    low, high = ax.get_ylim()
    size = max(right - left, high - low)
    # the largest round length up to 0.3 of the size
    decade = 10.0 ** np.floor(np.log10(0.3 * size))
    length = decade * max(m for m in (1, 2, 5) if m * decade <= 0.3 * size)
    y = low - 0.06 * size
    ax.plot([left, left + length], [y, y], color="k", linewidth=1.5, solid_capstyle="butt")
    ax.annotate(
        f"{length:g} mm",
        (left, y),
        xytext=(0, -3),
        textcoords="offset points",
        va="top",
        fontsize=SMALL,
    )
    origin = (left + length + 0.15 * size, y)
    for name, direction in zip("XYZ", VIEW[:2].T):
        ax.annotate(
            name,
            origin,
            xytext=20.0 * direction,
            textcoords="offset points",
            arrowprops={"arrowstyle": "-", "shrinkB": 0.0},
            ha="center",
            va="center",
            fontsize=SMALL,
            annotation_clip=False,
        )


FACES, CLAMP = "#a9c4df", "#2e6b2e"
"""Colours of the sector faces and of clamped nodes."""


@register_plot(Model)
def plot_model(model: Model) -> Axes:
    """Plot the bodies at rest, the points of their stress, and an enlarged view of their contact
    points.

    Free bodies are drawn in front, because the other bodies would hide them.
    """
    return _plot_model(model, {})


def _plot_model(model: Model, node_sets: Mapping[str, NDArray]) -> Axes:
    """Plot a model with clamp and sector faces, if ``node_sets`` has the positions (n, 3) of them."""
    fixed: list[Surface] = []
    free: list[Surface] = []
    handles = {}
    for name, _, rotation in sectors_shown(model):
        mesh = model.meshes[name]
        colour = TINT[model.bodies[name].kind]
        points = mesh.points @ rotation.T
        handles[name] = _patch(colour, name)
        if model.bodies[name].is_free:
            free.append((points, mesh.quads, colour))
            continue
        on_sector_face = np.zeros(len(mesh.quads), bool)
        if name == "blade" and "sector faces" in node_sets:
            on_sector_face = faces_between(mesh, node_sets["sector faces"])
            fixed.append((points, mesh.quads[on_sector_face], FACES))
            handles["sector faces"] = _patch(FACES, "sector faces")
        fixed.append((points, mesh.quads[~on_sector_face], colour))
    surfaces = [*fixed, *free]
    validation.check(surfaces, "plot of a model", "at least one body with a mesh", "none")

    nodes = np.concatenate([seen(points)[:, :2] for points, _, _ in surfaces])
    contacts = [seen(face.points)[:, :2] for face in model.interfaces.values()]
    framed = np.concatenate(contacts or [nodes])
    low = np.min(framed, axis=0)
    high = np.max(framed, axis=0)
    extent = (high - low).max()
    # contacts in a small part of the picture have further axes
    is_enlarged = bool(contacts) and extent < 0.35 * np.ptp(nodes, axis=0).max()
    if is_enlarged:
        axes = np.ravel(new_axes(height=3.2, columns=2, width_ratios=(1.0, 1.4)))
    else:
        axes = np.ravel(new_axes(height=3.2, columns=1, width_ratios=None))
    with plt.rc_context(STYLE):
        for ax in axes:
            plot_surfaces(surfaces, ax=ax)
            if fixed and free:
                plot_surfaces(free, ax=ax)
            ax.autoscale_view()
            ax.set(aspect="equal")
            ax.set_axis_off()
        _scale(axes[0])
        # points, since the view from above hides the bore
        if "clamp" in node_sets:
            x, y, _ = seen(node_sets["clamp"]).T
            axes[0].plot(x, y, "^", color=CLAMP, markersize=1.8, label="clamp")
        for name, stress in model.stress.items():
            x, y, _ = seen(stress.points).T
            axes[0].plot(x, y, "x", color=OPTIMUM, markersize=2.5, label=f"stress {name}")
        of_contacts = axes[-1]
        for points, look, name in zip(contacts, looks(len(contacts)), model.interfaces):
            of_contacts.plot(*points.T, **{**look, "linestyle": ""}, label=f"contact {name}")
        if is_enlarged:
            x, y = 0.5 * (low + high)
            half = 0.65 * extent
            of_contacts.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
            of_contacts.set_title("contacts, enlarged")
        figure = axes[0].figure
        marks, _ = legend_entries(axes)
        entries = [*handles.values(), *marks]
        labels = [str(entry.get_label()) for entry in entries]
        figure.legend(
            handles=entries,
            loc="outside lower center",
            ncols=min(3, legend_columns(figure, SMALL, labels)),
            fontsize=SMALL,
        )
        finish(figure)
        for line, points in zip(of_contacts.lines[-len(contacts) :], contacts):
            line.set_markersize(_size_between(of_contacts, points))
    return cast(Axes, axes[0])


def _patch(colour: str, label: str) -> Patch:
    return Patch(facecolor=colour, edgecolor="0.35", linewidth=0.5, label=label)


def faces_between(mesh: SurfaceMesh, nodes: NDArray) -> NDArray:
    """Return the mask (n_quads,) of the faces of a mesh whose corners are all among nodes (n, 3)."""
    distance, _ = cKDTree(nodes).query(mesh.points)
    is_marked = distance < 1e-6 * np.ptp(mesh.points, axis=0).max()
    return np.asarray(is_marked[mesh.quads].all(axis=1))


def _size_between(ax: Axes, points: NDArray) -> float:
    """Return the size of markers (points of print) that lets one see the body between them.

    ``points`` (n, 2) are the places of the markers in the axes.
    """
    places = np.unique(np.round(ax.transData.transform(points), 3), axis=0)
    if len(places) < 2:
        return LARGEST_MARKER
    distance, _ = cKDTree(places).query(places, k=2)
    gap = 72.0 / ax.figure.dpi * float(np.median(distance[:, 1]))
    return float(np.clip(0.5 * gap, SMALLEST_MARKER, LARGEST_MARKER))


SMALLEST_MARKER, LARGEST_MARKER = 1.2, 3.5
"""Sizes of the marks of contact points (points of print)."""


@register_plot(Model, "plot_mode")
def plot_mode(
    model: Model, mode: int = 1, *, body: str | None = None, nodal_diameter: int | None = None
) -> Axes:
    """Plot a mode of a constrained body: deformed shape, coloured by the amplitude.

    Parameters
    ----------
    model : Model
    mode : int
        Number of the mode, from 1.
    body : str, optional
        By default the first body with mode shapes.
    nodal_diameter : int, optional
        By default the first nodal diameter with mode shapes.

    Returns
    -------
    matplotlib axes

    Notes
    -----
    The largest displacement is drawn as a twelfth of the size of the body.
    """
    body, diameter = shown_shapes(model, body, nodal_diameter, "plot of a mode")
    mesh = model.meshes[body]
    mode = validation.integer("mode", mode, least=1, most=mesh.modes[diameter].shape[2])
    shape = mesh.modes[diameter][..., mode - 1]
    amplitude = np.linalg.norm(np.abs(shape), axis=1)
    size = float(np.ptp(mesh.points, axis=0).max())
    scale = size / 12.0 / float(np.abs(shape).max())
    surfaces = []
    for name, sector, rotation in sectors_shown(model):
        if name == body:
            phase = np.exp(2j * np.pi * diameter * sector / model.n_blades)
            deformed = mesh.points + scale * (shape * phase).real
            surfaces.append((deformed @ rotation.T, mesh.quads, amplitude))
    omega = float(np.sqrt(model.bodies[body].bases[diameter].omega2[mode - 1]))
    frequency = omega / (2.0 * np.pi)
    title = f"mode {mode}, nodal diameter {diameter}: {amount(frequency, 'Hz')}"
    return plot_surfaces(surfaces, title=title)


@register_plot(BuiltModel)
def plot_import_report(report: BuiltModel) -> Axes:
    """Plot the bodies, contact points and stress of the model, with clamp and sector faces."""
    return _plot_model(report.model, report.node_sets)
