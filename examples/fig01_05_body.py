"""
The body: contact model, axes, contact stiffness, finite element models and modes (Figs 1 to 5)
================================================================================================

The figures are drawn from the shipped model; only the contact stiffness is computed.
"""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from paper_disk import MODES, keep, study
from scipy.spatial import ConvexHull

import bdamper as bd
from bdamper.model.structure import turn
from bdamper.plot.axes import STYLE
from bdamper.plot.bodies import plot_surfaces, seen
from bdamper.plot.contact import plot_faces

BLADE, DAMPER = "0.88", "0.72"


def front_faces(model: bd.Model, body: str, rotation: np.ndarray) -> list[np.ndarray]:
    """Return the faces (4, 2) of a body that point along the axis, seen from the front, in mm."""
    mesh = model.meshes[body]
    depth = mesh.points[mesh.quads, 2]
    front = mesh.quads[(np.ptp(depth, axis=1) < 1e-4) & (depth.mean(axis=1) > 0.0)]
    return [1e3 * (mesh.points[quad] @ rotation.T)[:, :2] for quad in front]


def draw_section(
    ax: Axes, model: bd.Model, rotation: np.ndarray, sectors: tuple[int, ...] = (0, 1)
) -> None:
    """Draw the blades and the dampers between them, seen along the axis."""
    pitch = 2.0 * np.pi / model.n_blades
    for k in sectors:
        there = rotation @ turn(k * pitch)
        for body, shade in (("blade", BLADE), ("damper", DAMPER)):
            if body == "blade" or k + 1 in sectors:
                for face in front_faces(model, body, there):
                    ax.fill(*face.T, facecolor=shade, edgecolor="0.5", linewidth=0.3)
    ax.set(aspect="equal", xlabel="X (mm)", ylabel="Y (mm)")
    ax.grid(False)


def arrow(
    ax: Axes, start: np.ndarray, direction: np.ndarray, name: str, length: float, **style: Any
) -> None:
    """Draw an axis with its name."""
    end = start + length * direction
    ax.annotate(
        "", end, start, arrowprops={"arrowstyle": "-|>", "linewidth": 1.3, "color": "k", **style}
    )
    ax.text(*(start + 1.32 * length * direction), name, ha="center", va="center", fontsize=8.0)


def spring(
    ax: Axes, start: tuple[float, float], end: tuple[float, float], width: float, coils: int = 5
) -> None:
    """Draw a spring between two points as a zigzag line."""
    a, b = np.array(start), np.array(end)
    along, across = b - a, np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)
    where = np.concatenate(
        [[0.0, 0.15], 0.15 + 0.7 * (np.arange(2 * coils) + 0.5) / (2 * coils), [0.85, 1.0]]
    )
    off = np.concatenate([[0.0, 0.0], width * (-1.0) ** np.arange(2 * coils), [0.0, 0.0]])
    ax.plot(
        *(a[:, None] + along[:, None] * where + across[:, None] * off), color="k", linewidth=1.0
    )


model = bd.reference_model("paper_disk")
rotation = turn(np.pi / model.n_blades).T  # the axes of the damper

# %%
# **Fig. 1.** Contact points on the faces of the damper, and the three springs of a pair, along t1 and t2 in the face and
# along its normal n.

with plt.rc_context(STYLE):
    figure, (ax, pair) = plt.subplots(1, 2, figsize=(7.4, 3.4), width_ratios=[1.5, 1.0])
    draw_section(ax, model, rotation)
    for name in ("left", "right"):
        points = 1e3 * model.interfaces[name].points @ rotation.T
        ax.plot(points[:, 0], points[:, 1], "o", color="k", markersize=3.5)
    centre = 1e3 * rotation @ model.bodies["damper"].centre
    ax.set(xlim=(-22.0, 22.0), ylim=(centre[1] - 14.0, centre[1] + 22.0))
    ax.annotate("blade 0", (-17.0, centre[1] + 13.0), ha="center", fontsize=8.0)
    ax.annotate("blade 1", (17.0, centre[1] + 13.0), ha="center", fontsize=8.0)
    ax.annotate("damper", (0.0, centre[1] - 2.0), ha="center", fontsize=8.0)
    pair.fill([-1.0, 1.0, 1.0, -1.0], [0.9, 0.9, 1.4, 1.4], facecolor=BLADE, edgecolor="0.5")
    pair.fill([-1.0, 1.0, 1.0, -1.0], [-0.9, -0.9, -1.4, -1.4], facecolor=DAMPER, edgecolor="0.5")
    spring(pair, (-0.65, -0.9), (-0.65, 0.9), 0.08)
    pair.text(-0.9, 0.0, "$k_n$", ha="center", va="center")
    for x, y, name in ((-0.05, 0.35, "$k_{t1}$"), (0.6, -0.35, "$k_{t2}$")):
        spring(pair, (x - 0.25, y), (x + 0.25, y), 0.08)
        pair.plot([x - 0.25, x - 0.25], [y, 0.9], "k", linewidth=1.0)
        pair.plot([x + 0.25, x + 0.25], [y, -0.9], "k", linewidth=1.0)
        pair.plot([x + 0.15, x + 0.35], [-0.9, -0.9], "k", linewidth=3.0)
        pair.text(x, y + 0.2, name, ha="center")
    pair.text(0.0, 1.15, "blade", ha="center", va="center", fontsize=8.0)
    pair.text(0.0, -1.15, "damper", ha="center", va="center", fontsize=8.0)
    pair.set(aspect="equal", xlim=(-1.15, 1.15), ylim=(-1.5, 1.5))
    pair.set_axis_off()
    pair.set_title("springs of a pair; thick: sliding", fontsize=8.0)
keep(figure, "fig01_contact_model")

# %%
# **Fig. 2.** Axes of the blade at the axis of rotation and of the damper, which stand half a pitch apart.

pitch = 2.0 * np.pi / model.n_blades
with plt.rc_context(STYLE):
    figure, ax = plt.subplots(figsize=(4.2, 5.6))
    draw_section(ax, model, np.eye(3), (-1, 0, 1))
    mesh = 1e3 * model.meshes["blade"].points
    for k in (-1, 0, 1):  # the airfoils, whose faces do not look along the axis
        airfoil = (
            mesh[mesh[:, 1] > 1e3 * model.locations["platform"].position[1] - 1e-6]
            @ turn(k * pitch).T
        )[:, :2]
        narrow = airfoil[
            np.abs(airfoil @ turn(k * pitch)[:2, 0]) < 14.0
        ]  # without the edges of the platform
        ax.fill(
            *narrow[ConvexHull(narrow).vertices].T, facecolor=BLADE, edgecolor="0.5", linewidth=0.3
        )
    for direction, name in ((np.array([1.0, 0.0]), "X"), (np.array([0.0, 1.0]), "Y")):
        arrow(ax, np.zeros(2), direction, name, 90.0, shrinkA=0.0)
    ax.text(0.0, -18.0, "Z: toward the reader", fontsize=7.0, ha="center", va="top")
    middle, half = 1e3 * model.bodies["damper"].centre[:2], turn(0.5 * pitch)[:2, :2]
    for direction, name in ((half[:, 0], "$X_D$"), (half[:, 1], "$Y_D$")):
        arrow(ax, middle, direction, name, 60.0)
    ax.plot([0.0, middle[0]], [0.0, middle[1]], "k:", linewidth=0.8)
    ax.text(*(0.55 * middle + [8.0, 0.0]), "half a pitch", fontsize=7.0, rotation=0.0)
    ax.set(xlim=(-170.0, 170.0), ylim=(-60.0, mesh[:, 1].max() + 15.0))
keep(figure, "fig02_axes")

# %%
# **Fig. 3.** The faces of the damper, their angles alpha and beta from the radial direction, and their axes.

centre = 1e3 * rotation @ model.bodies["damper"].centre
with plt.rc_context(STYLE):
    figure, (ax, side) = plt.subplots(1, 2, figsize=(7.6, 3.0))
    for face in front_faces(model, "damper", rotation):
        ax.fill(*(face - centre[:2]).T, facecolor=DAMPER, edgecolor="0.5", linewidth=0.3)
    for name, angle in (("left", r"$\alpha$"), ("right", r"$\beta$")):
        interface = model.interfaces[name]
        frame = interface.frame[0] @ rotation.T
        middle = (1e3 * interface.points.mean(axis=0) @ rotation.T - centre)[:2]
        arrow(ax, middle, frame[0, :2], "$t_1$", 5.0)
        arrow(ax, middle, frame[2, :2], "n", 5.0)
        outer = 1.0 if name == "right" else -1.0
        ax.plot([middle[0]] * 2, [middle[1] - 11.0, middle[1] + 9.0], "k:", linewidth=0.7)
        # between the radial direction downward and the slope of the face
        slope = np.arctan2(*(frame[0, :2] * np.sign(-frame[0, 1]))[::-1])
        turns = np.linspace(-0.5 * np.pi, slope, 30)
        ax.plot(
            middle[0] + 3.5 * np.cos(turns), middle[1] + 3.5 * np.sin(turns), "k", linewidth=0.8
        )
        where = 0.5 * (turns[0] + turns[-1])
        ax.text(
            middle[0] + 5.0 * np.cos(where),
            middle[1] + 5.0 * np.sin(where),
            angle,
            ha="center",
            va="center",
        )
        ax.text(middle[0] + outer * 9.0, middle[1] + 7.5, f"{name} face", ha="center", fontsize=8.0)
    ax.set(
        aspect="equal",
        xlabel="$X_D$ (mm)",
        ylabel="$Y_D$ (mm)",
        xlim=(-21.0, 21.0),
        ylim=(-14.0, 14.0),
    )
    mesh = 1e3 * model.meshes["damper"].points @ rotation.T - centre
    corners = mesh[:, [2, 1]]
    low, high = corners.min(axis=0), corners.max(axis=0)
    side.fill(
        [low[0], high[0], high[0], low[0]],
        [low[1], low[1], high[1], high[1]],
        facecolor=DAMPER,
        edgecolor="0.5",
    )
    for name, sign in (("front", 1.0), ("back", -1.0)):
        frame = model.interfaces[name].frame[0] @ rotation.T
        middle = np.array([sign * high[0], 0.0])
        arrow(side, middle, frame[1, [2, 1]], "$t_2$", 4.5)
        arrow(side, middle, frame[2, [2, 1]], "n", 6.0)
        gap = 1e3 * model.interfaces[name].gap[0]
        side.text(middle[0] + sign * 9.0, -9.5, f"{name} face\nstop after\n{gap:.2f} mm",
                  ha="center", va="center", fontsize=7.0)  # fmt: skip
    side.set(
        aspect="equal",
        xlabel="$Z_D$ (mm)",
        ylabel="$Y_D$ (mm)",
        xlim=(-41.0, 41.0),
        ylim=(-17.0, 14.0),
    )
    for one in (ax, side):
        one.grid(False)
keep(figure, "fig03_faces")

# %%
# **Fig. 4.** Blade and damper bonded, each with its residual stiffness; equation (11) puts the two in series.

with plt.rc_context(STYLE):
    figure, ax = plt.subplots(figsize=(4.6, 2.0))
    for x, shade, name in ((-2.6, BLADE, "blade"), (2.0, DAMPER, "damper")):
        ax.fill([x, x + 0.6, x + 0.6, x], [-0.8, -0.8, 0.8, 0.8], facecolor=shade, edgecolor="0.5")
        ax.text(x + 0.3, 0.0, name, rotation=90.0, ha="center", va="center", fontsize=8.0)
    spring(ax, (-2.0, 0.0), (0.0, 0.0), 0.18)
    spring(ax, (0.0, 0.0), (2.0, 0.0), 0.18)
    ax.plot(0.0, 0.0, "ko", markersize=5.0)
    ax.text(-1.0, 0.45, "$K_{cB}$", ha="center")
    ax.text(1.0, 0.45, "$K_{cD}$", ha="center")
    ax.text(
        0.0,
        -0.75,
        "bonded pair:  $K_c^{-1} = K_{cB}^{-1} + K_{cD}^{-1}$",
        ha="center",
        fontsize=8.0,
    )
    ax.set(aspect="equal", xlim=(-2.8, 2.8), ylim=(-1.0, 1.0))
    ax.set_axis_off()
keep(figure, "fig04_bonded")

# %%
# The stiffnesses that equations (4) and (10) give on this body.  White points are open, or their values would be negative
# or implausible, which holds for nine in ten along the axis: there the stiffness under uniform tractions stands in.

problem = study(1, **bd.CIGEROGLU_2009).problem
print(study(1).stiffness_report)
stiffness = {name: problem.stiffness[name] for name in ("left", "right")}
faces = [(name, model.interfaces[name].points, model.interfaces[name].frame) for name in stiffness]
shown = [
    np.where(
        found.fallback[:, axis],
        np.nan,
        1e-9 * found.stiffness[:, axis] / model.interfaces[name].area,
    )
    for axis in range(3)
    for name, found in stiffness.items()
]
keep(plot_faces(faces, shown, "Stiffness (N/mm$^3$)", ("t1", "t2", "n")), "fig04_stiffness")

# %%
# **Fig. 5.** Meshes, with the point of excitation and response at the trailing-edge corner of the tip and with the contact
# points.

blade, damper = model.meshes["blade"], model.meshes["damper"]
corner = model.locations["tip_trailing_edge"].position
ax = plot_surfaces([(blade.points, blade.quads, "#dde4ea")],
                   title="blade; dot: excitation and response")  # fmt: skip
ax.plot(*seen(corner)[:2], "o", color="#c0392b", markersize=5.0, clip_on=False)
keep(ax, "fig05_blade")
points = np.concatenate([model.interfaces[name].points for name in ("left", "right")])
ax = plot_surfaces([(damper.points, damper.quads, "#e8b563")], title="damper; dots: contact points")
ax.plot(*seen(points)[:, :2].T, "k.", markersize=3.0)
keep(ax, "fig05_damper")

# %%
# The modes of Figs 6 to 11.

for mode in MODES:
    keep(model.plot_mode(mode, body="blade"), f"fig05_mode_{mode}")
frequencies = np.sqrt(model.bodies["blade"].bases[5].omega2[:7]) / (2.0 * np.pi)
print("modes of the blade at nodal diameter 5:", ", ".join(f"{f:.1f}" for f in frequencies), "Hz")
