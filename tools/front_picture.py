"""Front picture: a vibrating disk, and the power that each contact point of a damper dissipates.

``python -m tools.front_picture`` computes the peak of the typical blade at its best preload, and
draws docs/images/front.png (README) and docs/images/front.gif (manual, one period of vibration).
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

import bdamper as bd
from bdamper.analyses.hysteresis import Hysteresis
from bdamper.model.structure import Model, turn
from bdamper.plot.axes import STYLE
from bdamper.plot.motion import SurfaceMotion, surface_motion
from bdamper.util.formatting import amount

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
PRELOAD = 104.0
"""Best preload of the typical blade at 1 N (N)."""
SHOWN = range(-4, 5)
"""Sectors in the picture."""
LARGEST = 8e-3
"""Largest displacement in the picture (m)."""
FRAMES = 12
"""Pictures of one period."""
COLOURS = "magma_r"
"""Colours of the power, from light to dark, also in grey print."""
FROM_FRONT = np.array([[1.0, 0.0, 0.0], [0.0, 0.96, -0.28], [0.0, 0.28, 0.96]])
FROM_OUTSIDE = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, -0.866], [0.0, 0.866, 0.5]])
"""Rows: directions to the right, up and toward the viewer."""


def faces(points: NDArray, quads: NDArray, view: NDArray) -> NDArray:
    """Return the corners of the faces (n_faces, 4, 3) as seen by the viewer."""
    return (points @ view.T)[quads]


def draw_faces(ax: Axes, corners: NDArray, colour: str) -> None:
    """Draw faces from the farthest to the nearest, lighter if they turn to the viewer."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    normal = np.cross(first, second)
    toward = np.abs(normal[:, 2]) / np.maximum(np.linalg.norm(normal, axis=1), 1e-30)
    base = np.array(matplotlib.colors.to_rgb(colour))
    shade = np.clip(np.outer(0.55 + 0.45 * toward, base), 0.0, 1.0)
    order = np.argsort(corners[..., 2].mean(axis=1))
    ax.add_collection(
        PolyCollection(
            list(corners[order, :, :2]),
            facecolors=shade[order],
            edgecolors="none",
            antialiaseds=False,
        )
    )


def draw_disk(
    ax: Axes, model: Model, motions: dict[str, SurfaceMotion], order: int, phase: float
) -> None:
    """Draw the sectors with their vibration at a phase (rad), enlarged."""
    factor = LARGEST / max(np.abs(motion.amplitude).max() for motion in motions.values())
    pitch = 2.0 * np.pi / model.n_blades
    blades, dampers = [], []
    for sector in SHOWN:
        # the excitation runs around the disk
        wave = np.exp(1j * (phase + order * sector * pitch))
        rotation = turn(sector * pitch).T
        for body, motion in motions.items():
            displaced = motion.points + factor * np.real(motion.amplitude * wave)
            corners = faces(displaced @ rotation, model.meshes[body].quads, FROM_FRONT)
            (blades if body == "blade" else dampers).append(corners)
    draw_faces(ax, np.concatenate(blades), "#b9c6d2")
    draw_faces(ax, np.concatenate(dampers), "#c0392b")
    ax.autoscale_view()


def draw_power(ax: Axes, model: Model, cycle: Hysteresis) -> PolyCollection:
    """Draw a damper from outside, its contact points coloured by their power (W)."""
    mesh = model.meshes["damper"]
    draw_faces(ax, faces(mesh.points, mesh.quads, FROM_OUTSIDE), "#dde3e8")
    chosen = np.isin(cycle.interface, ("left", "right"))
    power = cycle.energy[chosen] * cycle.frequency
    rectangles = []
    for name in ("left", "right"):
        at = np.asarray(cycle.interface) == name
        points, axes = cycle.points[at], cycle.frame[at]
        for point, (first, second, _) in zip(points, axes):
            # distances of the points along both directions are the sizes of a patch
            sizes = []
            for direction in (first, second):
                steps = np.unique(np.round((points - points[0]) @ direction, 7))
                sizes.append(np.diff(steps).min() * 0.92)
            along, across = 0.5 * sizes[0] * first, 0.5 * sizes[1] * second
            corners = [point - along - across, point + along - across]
            corners += [point + along + across, point - along + across]
            rectangles.append(np.array(corners) @ FROM_OUTSIDE.T)
    patches = PolyCollection(
        [corners[:, :2] for corners in rectangles], cmap=COLOURS, edgecolors="0.3", linewidths=0.4
    )
    patches.set_array(power)
    patches.set_clim(0.0, power.max())
    ax.add_collection(patches)
    ax.autoscale_view()
    return patches


def main() -> None:
    """Compute the response, and draw the still and the loop."""
    model = bd.reference_model("turbine_blade")
    tip = bd.Excitation("tip", direction="tangential", amplitude=1.0)
    study = bd.Study(model, tip, engine_order=5, friction_coefficient=0.3)
    peak = study.peak(PRELOAD)
    motions = surface_motion(study, peak.y[:-1])
    cycle = study.hysteresis(peak)
    with plt.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.3), dpi=200)
        disk, damper = figure.subplots(1, 2, width_ratios=(2.1, 1.0))
        patches = draw_power(damper, model, cycle)
        bar = figure.colorbar(patches, ax=damper, orientation="horizontal", pad=0.02, shrink=0.9)
        bar.set_label("Power of each contact point (mW)")
        bar.formatter = lambda value, _: f"{1e3 * value:g}"
        bar.update_ticks()
        damper.set_title("One damper, from outside")
        for ax in (disk, damper):
            ax.set(aspect="equal")
            ax.set_axis_off()
        title = (
            f"Blades at {amount(peak.amplitude, 'm')}, {amount(peak.frequency, 'Hz')}, "
            f"dampers (red) under {PRELOAD:g} N"
        )

        def draw(frame: int) -> None:
            for artist in list(disk.collections):
                artist.remove()
            draw_disk(disk, model, motions, 5, 2.0 * np.pi * frame / FRAMES)
            disk.set_title(title)
            disk.set(xlim=(-0.165, 0.165), ylim=(0.175, 0.41))

        draw(0)
        figure.savefig(IMAGES / "front.png")
        loop = FuncAnimation(figure, draw, frames=FRAMES)
        loop.save(IMAGES / "front.gif", writer=PillowWriter(fps=8), dpi=75)


if __name__ == "__main__":
    main()
