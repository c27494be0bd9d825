"""Plots of bodies, modes and contact points in space, and export to VTU files for ParaView.

The export uses meshio (extra ``bdamper[viz]``).
"""

from __future__ import annotations

from collections.abc import Sequence
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

from bdamper.harmonic_balance.checks import asked
from bdamper.harmonic_balance.problem import Problem
from bdamper.importers.build import BuiltModel
from bdamper.model.structure import Model
from bdamper.plot.axes import SMALL, STYLE, finish, looks, new_axes
from bdamper.plot.motion import VIEW, sectors_shown, surface_motion
from bdamper.util import validation
from bdamper.util.display import register_plot
from bdamper.util.errors import SettingError, import_extra
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
        raise SettingError(
            f"{purpose}: expected a body with mode shapes on its mesh out of {bodies}, found {body!r}"
        )
    modes = model.meshes[body].modes
    d = next(iter(modes)) if nodal_diameter is None else nodal_diameter
    validation.check(d in modes, purpose, f"a nodal diameter out of {sorted(modes)}", d)
    return body, d


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
        Name of the file, with the ending ``.vtu``.
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
    body, d = shown_shapes(model, body, nodal_diameter, "export of modes")
    mesh = model.meshes[body]
    frequency = np.sqrt(model.bodies[body].bases[d].omega2) / (2.0 * np.pi)
    shapes = zip(frequency, np.moveaxis(mesh.modes[d], 2, 0))
    fields = {f"mode {k}, {f:.2f} Hz, {{}}": shape for k, (f, shape) in enumerate(shapes, 1)}
    return _write(path, mesh.points, mesh.quads, fields)


def _write(
    path: str | PathLike[str], points: NDArray, quads: NDArray, fields: dict[str, NDArray]
) -> Path:
    """Write vector fields on a surface; "real" or "imaginary" replaces ``{}`` in a name."""
    meshio = import_extra("meshio", "export to VTU", "viz")
    data = {
        name.format(part): np.ascontiguousarray(getattr(field, part[:4]))
        for name, field in fields.items()
        for part in ("real", "imaginary")[: 1 + np.iscomplexobj(field)]
    }
    with file_errors(path):
        meshio.Mesh(points, [("quad", quads)], point_data=data).write(path)
    return Path(path)


@asked
def export_response(
    problem: Problem, unknowns: NDArray, folder: str | PathLike[str], name: str = "response"
) -> list[Path]:
    """Write the mean and the complex vibration of every body with a surface.

    The mean is left out if the mesh has no mode shapes of nodal diameter 0.

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
    out = []
    for body, motion in surface_motion(problem, unknowns).items():
        mean = {"mean displacement, m": motion.mean} if np.isfinite(motion.mean).all() else {}
        fields, quads = (
            mean | {"vibration, {}, m": motion.amplitude},
            problem.model.meshes[body].quads,
        )
        out.append(_write(Path(folder) / f"{name}_{body}.vtu", motion.points, quads, fields))
    return out


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
    top = (
        max((float(np.max(v)) for _, _, v in surfaces if isinstance(v, np.ndarray)), default=1.0)
        or 1.0
    )
    corners, shades = [], []
    for points, quads, colour in surfaces:
        corners.append(seen(points)[quads])
        if isinstance(colour, np.ndarray):
            shades.append(plt.get_cmap("viridis")(colour[quads].mean(axis=1) / top))
            continue
        normal = np.cross(
            corners[-1][:, 2] - corners[-1][:, 0], corners[-1][:, 3] - corners[-1][:, 1]
        )
        light = 0.7 + 0.3 * np.abs(normal @ [-0.3, 0.8, 0.5]) / np.maximum(
            np.linalg.norm(normal, axis=1), 1e-300
        )
        shades.append(to_rgba(colour) * np.column_stack([light, light, light, np.ones(len(light))]))
    corner, shade = np.concatenate(corners), np.concatenate(shades)
    order = np.argsort(corner[..., 2].mean(axis=1))
    new = ax is None
    with plt.rc_context(STYLE):
        ax = new_axes(height=3.2) if ax is None else ax
        look = {"edgecolors": "0.35", "linewidths": 0.15}
        ax.add_collection(
            PolyCollection(
                list(corner[order, :, :2]),
                facecolors=shade[order],
                rasterized=True,
                **look,  # type: ignore[arg-type]
            )
        )
        if new:
            ax.autoscale_view()
            ax.set(aspect="equal", title=title)
            ax.set_axis_off()
            _scale(ax)
    return ax


TINT = {"constrained": "#dde4ea", "free": "#e8b563", "ground": "#cccccc"}
"""Colours of the kinds of bodies."""


def seen(points: Any) -> NDArray:
    """Return points (n, 3) in the view directions right, up and toward the viewer, in mm."""
    return 1e3 * np.asarray(points, float) @ VIEW.T


def _scale(ax: Axes) -> None:
    """Draw a length scale and the coordinate directions below a plot in mm."""
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    size = max(right - left, high - low)
    decade = 10.0 ** np.floor(np.log10(0.3 * size))
    length, y = decade * max(m for m in (1, 2, 5) if m * decade <= 0.3 * size), low - 0.06 * size
    ax.plot([left, left + length], [y, y], color="k", linewidth=1.5, solid_capstyle="butt")
    ax.annotate(
        f"{length:g} mm",
        (left, y),
        xytext=(0, -3),
        textcoords="offset points",
        va="top",
        fontsize=SMALL,
    )
    for name, direction in zip("XYZ", VIEW[:2].T):
        look: dict[str, Any] = {
            "ha": "center",
            "va": "center",
            "fontsize": SMALL,
            "annotation_clip": False,
        }
        ax.annotate(name, (left + length + 0.15 * size, y), xytext=20.0 * direction, textcoords="offset points",
                    arrowprops={"arrowstyle": "-", "shrinkB": 0.0}, **look)  # fmt: skip


@register_plot(Model)
def plot_model(model: Model) -> Axes:
    """Plot the bodies at rest, and next to them their contact points enlarged.

    Free bodies are drawn over the others, which would hide them.
    """
    kinds: dict[bool, list[Surface]] = {False: [], True: []}
    named = {}
    for name, _, rotation in sectors_shown(model):
        mesh, kind = model.meshes[name], model.bodies[name].kind
        kinds[kind == "free"].append((mesh.points @ rotation.T, mesh.quads, TINT[kind]))
        named[name] = Patch(facecolor=TINT[kind], edgecolor="0.35", linewidth=0.5, label=name)
    validation.check(
        kinds[False] or kinds[True], "plot of a model", "at least one body with a mesh", "none"
    )
    points = [seen(face.points)[:, :2] for face in model.interfaces.values()]
    corners = np.concatenate([seen(surface[0])[:, :2] for surface in (*kinds[False], *kinds[True])])
    low, high = (f(np.concatenate(points or [corners]), axis=0) for f in (np.min, np.max))
    near = bool(points) and (high - low).max() < 0.35 * np.ptp(corners, axis=0).max()
    both = np.ravel(
        new_axes(height=3.2, columns=2 if near else 1, width_ratios=(1.0, 1.4) if near else None)
    )
    with plt.rc_context(STYLE):
        for ax in both:
            plot_surfaces([*kinds[False], *kinds[True]], ax=ax)
            if kinds[False] and kinds[True]:
                plot_surfaces(kinds[True], ax=ax)
            ax.autoscale_view()
            ax.set(aspect="equal")
            ax.set_axis_off()
        _scale(both[0])
        for face, look, name in zip(points, looks(len(points)), model.interfaces):
            both[-1].plot(*face.T, **{**look, "linestyle": ""}, label=f"contact {name}")
        if near:
            middle, half = 0.5 * (low + high), 0.65 * (high - low).max()
            both[-1].set(
                xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half)
            )
            both[-1].set_title("contacts, enlarged")
        figure = both[0].figure
        handles = [*named.values(), *both[-1].get_legend_handles_labels()[0]]
        figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=SMALL)
        finish(figure)
    return cast(Axes, both[0])


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
    body, d = shown_shapes(model, body, nodal_diameter, "plot of a mode")
    mesh = model.meshes[body]
    mode = validation.integer("mode", mode, least=1, most=mesh.modes[d].shape[2])
    shape = mesh.modes[d][..., mode - 1]
    scale = float(np.ptp(mesh.points, axis=0).max()) / 12.0 / float(np.abs(shape).max())
    surfaces = []
    for name, sector, rotation in sectors_shown(model):
        if name == body:
            wave = np.exp(2j * np.pi * d * sector / model.n_blades)
            deformed = mesh.points + scale * (shape * wave).real
            surfaces.append(
                (deformed @ rotation.T, mesh.quads, np.linalg.norm(np.abs(shape), axis=1))
            )
    frequency = float(np.sqrt(model.bodies[body].bases[d].omega2[mode - 1])) / (2.0 * np.pi)
    return plot_surfaces(surfaces, title=f"mode {mode}, nodal diameter {d}: {frequency:.1f} Hz")


@register_plot(BuiltModel)
def plot_import_report(report: BuiltModel) -> Axes:
    """Plot the bodies and contact points of the model (:func:`plot_model`)."""
    return plot_model(report.model)
