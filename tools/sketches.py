"""Sketches of the manual: ``python tools/sketches.py`` draws them into docs/images."""

import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Arc, Polygon, Rectangle

from bdamper.importers import example_decks, read_calculix
from bdamper.plot.axes import STYLE, save_figure
from bdamper.plot.bodies import plot_surfaces, seen

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
BOTH = {"arrowstyle": "<|-|>", "color": "tab:blue", "linewidth": 1.4}
ARROW = {"arrowstyle": "-|>", "color": "tab:red", "linewidth": 1.4}


def empty(width, height):
    axes = plt.subplots(figsize=(width, height))[1]
    axes.set_aspect("equal")
    axes.axis("off")
    return axes


def damper():
    """A wedge damper between two platforms."""
    ax = empty(5.6, 3.4)
    a = np.radians(35.0)
    half, top = 0.35, 1.4
    foot = half + top * np.tan(a)
    ax.add_patch(
        Polygon(
            [(-foot, 0.0), (foot, 0.0), (half, top), (-half, top)],
            facecolor="0.85",
            edgecolor="0.2",
        )
    )
    for side in (-1.0, 1.0):
        face = [
            (side * foot, 0.0),
            (side * half, top),
            (side * (half + 0.1), top + 0.45),
            (side * 3.0, top + 0.45),
        ]
        ax.add_patch(
            Polygon(
                [*face, (side * 3.0, 0.9), (side * (foot + 0.12), -0.1)],
                facecolor="0.95",
                edgecolor="0.2",
            )
        )
        ax.text(side * 2.3, 1.35, "platform", ha="center", fontsize=9.0)
        middle = np.array([side * 0.5 * (foot + half), 0.5 * top])
        normal = np.array([-side * np.cos(a), -np.sin(a)])
        ax.annotate("", middle + 0.75 * normal, middle, arrowprops=ARROW)
        along = np.array([-side * np.sin(a), np.cos(a)])
        ax.annotate("", middle + 0.45 * along, middle - 0.45 * along, arrowprops=BOTH)
        ax.text(side * 0.62, 0.2, "$N$", color="tab:red", fontsize=11.0, ha="center")
        ax.text(side * 1.33, 0.6, r"$\mu N$", color="tab:blue", fontsize=11.0, ha="center")
    ax.text(0.0, 0.75, "damper", ha="center", fontsize=9.0)
    ax.annotate("", (0.0, 1.25), (0.0, 0.95), arrowprops={**ARROW, "color": "k"})
    ax.text(0.0, 0.42, r"$m r \Omega^2$", ha="center", fontsize=10.0)
    ax.plot([foot, foot], [0.0, -0.9], "--", color="0.4", linewidth=0.9)
    ax.plot([foot, foot + 0.9 * np.tan(a)], [0.0, -0.9], color="0.4", linewidth=0.9)
    ax.add_patch(
        Arc((foot, 0.0), 1.3, 1.3, theta1=-90.0, theta2=-90.0 + np.degrees(a), color="0.4")
    )
    ax.text(foot + 0.24, -0.86, "$a$", fontsize=11.0, ha="center")
    ax.annotate(
        "radial",
        (-2.9, 0.6),
        (-2.9, -0.8),
        ha="center",
        fontsize=8.5,
        arrowprops={**ARROW, "color": "k"},
    )
    ax.set(xlim=(-3.3, 3.3), ylim=(-1.0, 2.0))
    return ax


def spring(ax, start, end, turns=6, width=0.1):
    start, end = np.asarray(start), np.asarray(end)
    along = (end - start) / np.linalg.norm(end - start)
    t = np.linspace(0.0, 1.0, 2 * turns + 1)
    off = width * np.where(np.arange(len(t)) % 2 == 0, -1.0, 1.0) * ((t > 0.05) & (t < 0.95))
    ax.plot(
        *(start[:, None] + np.outer(end - start, t) + np.outer([-along[1], along[0]], off)),
        color="k",
        linewidth=1.1,
    )


def point():
    """One contact point: two tangential springs with sliders, one normal spring."""
    ax = empty(5.6, 2.6)
    ax.add_patch(Rectangle((-2.6, -0.35), 5.2, 0.35, facecolor="0.85", edgecolor="0.2"))
    ax.text(2.5, -0.2, "face of the damper", ha="right", va="center", fontsize=8.5)
    ax.add_patch(Rectangle((-0.9, 1.1), 1.8, 0.4, facecolor="0.95", edgecolor="0.2"))
    ax.text(0.0, 1.3, "point of the platform", ha="center", va="center", fontsize=8.5)
    spring(ax, (0.0, 0.0), (0.0, 1.1))
    ax.text(0.16, 0.45, "$k_n$: normal force $N$,\nopen where $N$ would pull", fontsize=8.5)
    ax.add_patch(Rectangle((-2.4, 0.0), 0.5, 0.28, facecolor="tab:blue", edgecolor="0.2"))
    ax.plot([-2.5, -1.8], [0.0, 0.0], color="k", linewidth=2.0)
    ax.plot([-0.8, -0.8], [1.1, 0.14], color="k", linewidth=2.0)
    spring(ax, (-1.9, 0.14), (-0.8, 0.14))
    ax.text(-1.35, 0.38, "$k_{t1}$, $k_{t2}$", fontsize=9.0, ha="center")
    ax.text(-2.5, -0.2, r"slider: $|T| \leq \mu N$", va="center", color="tab:blue", fontsize=8.5)
    ax.set(xlim=(-2.8, 2.8), ylim=(-0.5, 1.7))
    return ax


def states():
    """Displacement, normal force and friction of one point over a cycle, with its states."""
    with plt.rc_context(STYLE):
        axes = plt.subplots(2, 1, sharex=True, figsize=(5.6, 3.4))[1]
    theta = np.linspace(0.0, 2.0 * np.pi, 2001)
    move, normal = np.cos(theta), np.maximum(0.55 + 0.75 * np.cos(theta - 0.6), 0.0)
    friction, slider, kind = np.zeros_like(theta), 0.0, np.zeros(len(theta), int)
    for turn in range(2):  # the second turn is the settled one
        for i, (u, n) in enumerate(zip(move, normal)):
            trial, limit = 1.2 * (u - slider), 0.5 * n
            friction[i] = np.clip(trial, -limit, limit)
            slider = u - friction[i] / 1.2
            kind[i] = 2 if n == 0.0 else int(abs(trial) > limit)
    for ax in axes:
        for state, colour in enumerate(("0.88", "#f6c78f", "#ffffff")):
            ax.fill_between(
                theta / (2.0 * np.pi),
                0.0,
                1.0,
                where=kind == state,
                color=colour,
                linewidth=0.0,
                transform=ax.get_xaxis_transform(),
            )
        ax.set(yticks=[])
        ax.grid(False)
    axes[0].plot(theta / (2.0 * np.pi), normal, color="tab:red")
    axes[0].set(ylabel="Normal force", xlim=(0.0, 1.0))
    for at, name in ((0.12, "stick"), (0.355, "slip"), (0.6, "open"), (0.84, "slip")):
        axes[0].text(
            at,
            1.0,
            name,
            transform=axes[0].get_xaxis_transform(),
            ha="center",
            va="bottom",
            fontsize=8.5,
        )
    axes[1].axhline(0.0, color="0.4", linewidth=0.6)
    for sign, name in ((1.0, r"$\mu N$"), (-1.0, r"$-\mu N$")):
        axes[1].plot(
            theta / (2.0 * np.pi), 0.5 * sign * normal, color="0.4", linewidth=0.8, linestyle="-."
        )
        axes[1].text(0.3, 0.5 * sign, name, color="0.2", fontsize=9.0, va="center")
    axes[1].plot(theta / (2.0 * np.pi), friction, color="tab:blue")
    axes[1].set(ylabel="Friction force", xlabel="Time (periods)")
    return axes[0]


def folds():
    """A response curve with two folds."""
    with plt.rc_context(STYLE):
        ax = plt.subplots(figsize=(5.6, 3.0))[1]
    a = np.linspace(0.05, 1.0, 4000)
    w = 1.0 - 0.28 * a**2
    gap = np.sqrt(np.maximum((0.1 / a) ** 2 - 0.1**2, 0.0))
    low, high = w - 0.8 * gap, w + 0.8 * gap
    f, height = np.concatenate([low, high[::-1]]), np.concatenate([a, a[::-1]])
    back = np.gradient(f) < 0.0
    for part in np.split(np.arange(len(f)), np.flatnonzero(np.diff(back)) + 1):
        ax.plot(
            f[part], height[part], color="0.1", linestyle=(0, (3, 1.5)) if back[part[0]] else "-"
        )
    turn = np.flatnonzero(np.diff(back))
    ax.plot(f[turn], height[turn], "o", color="tab:red")
    for i, (dx, text) in zip(
        turn, ((8, "fold: a sweep up\njumps here"), (-8, "fold: a sweep down\njumps here"))
    ):
        ax.annotate(
            text,
            (f[i], height[i]),
            xytext=(dx, -8),
            textcoords="offset points",
            fontsize=8.0,
            color="tab:red",
            va="center",
            ha="left" if dx > 0 else "right",
        )
    ax.plot([], [], color="0.1", label="stable")
    ax.plot([], [], color="0.1", linestyle=(0, (3, 1.5)), label="unstable")
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8.0)
    ax.set(xlabel="Frequency", ylabel="Amplitude", xticks=[], yticks=[], xlim=(0.4, 1.3))
    return ax


HEXAHEDRON = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
"""Corners of the faces of an element."""
SECTOR_SETS = {
    "LOW": "tab:blue",
    "HIGH": "tab:cyan",
    "BORE": "0.4",
    "LEFT_UNDERSIDE": "tab:red",
    "RIGHT_UNDERSIDE": "tab:orange",
}
DAMPER_SETS = {
    "LEFT": "tab:orange",
    "RIGHT": "tab:red",
    "FRONT": "tab:green",
    "BACK": "tab:olive",
}
"""Colours of the sets; faces that touch have the same colour."""
POINT_SETS = {"FILLET": [], "tip: node 117": [117]}


def outer_faces(body):
    """Return the node numbers (n, 4) of the faces that belong to one element only."""
    faces = np.concatenate([np.asarray(body.elements[0])[:, face] for face in HEXAHEDRON])
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return faces[first[count == 1]]


def rotated(points, turned, tilted):
    """Return points turned about the radial direction and then tilted backward (degrees)."""
    c, s = np.cos(np.radians(turned)), np.sin(np.radians(turned))
    points = points @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    c, s = np.cos(np.radians(tilted)), np.sin(np.radians(tilted))
    return points @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def show_sets(ax, body, colours, turned, tilted, named):
    """Draw a body of the deck in one view; named: the sets whose names are written."""
    row = {int(number): k for k, number in enumerate(body.numbers)}
    faces = np.vectorize(row.get)(outer_faces(body))
    # axes of the model: Z is the axis of rotation, X of the deck; Y is radial
    x, y, z = 1e-3 * body.nodes.T
    points = rotated(np.column_stack([-z, y, x]), turned, tilted)
    plain = np.ones(len(faces), bool)
    surfaces = []
    for name, colour in colours.items():
        members = {row[int(n)] for n in body.node_sets[name]}
        inside = np.array([members.issuperset(face.tolist()) for face in faces])
        plain &= ~inside
        surfaces.append((points, faces[inside], colour))
    plot_surfaces([(points, faces[plain], "#dde4ea"), *surfaces], ax)
    ax.autoscale_view()
    ax.set(aspect="equal")
    ax.set_axis_off()
    places = {name: seen(points[quads.ravel()]) for name, (_, quads, _) in zip(colours, surfaces)}
    for name, nodes in POINT_SETS.items():
        if name in named:
            numbers = body.node_sets.get(name, nodes)
            places[name] = seen(points[[row[int(n)] for n in numbers]])
            ax.plot(places[name][:, 0], places[name][:, 1], "k.", markersize=4.0)
    left, right = ax.get_xlim()
    for name in named:
        at = places[name][:, :2].mean(axis=0)
        on_right = at[0] > 0.5 * (left + right) or name in POINT_SETS
        ax.annotate(
            name,
            at,
            xytext=(right if on_right else left, at[1]),
            fontsize=7.5,
            ha="left" if on_right else "right",
            va="center",
            arrowprops={"arrowstyle": "-", "linewidth": 0.7},
        )


def sets():
    """Node sets of the CalculiX example from both sides."""
    with tempfile.TemporaryDirectory() as folder:
        example_decks("calculix", folder)
        sector = read_calculix(Path(folder) / "sector")
        strip = read_calculix(Path(folder) / "damper")
    figure = plt.figure(figsize=(9.0, 3.6), layout="none")
    views = [
        (sector, SECTOR_SETS, 0.0, 45.0, [*POINT_SETS, "LEFT_UNDERSIDE", "LOW", "BORE"], 0.12),
        (sector, SECTOR_SETS, 180.0, 45.0, ["RIGHT_UNDERSIDE", "HIGH"], 0.4),
        (strip, DAMPER_SETS, 0.0, 0.0, ["LEFT", "FRONT"], 0.62),
        (strip, DAMPER_SETS, 180.0, 0.0, ["RIGHT", "BACK"], 0.83),
    ]
    for body, colours, turned, tilted, named, left in views:
        height = 0.9 if body is sector else 0.45
        bottom = 0.05 if body is sector else 0.25
        ax = figure.add_axes((left, bottom, 0.2 if body is sector else 0.12, height))
        show_sets(ax, body, colours, turned, tilted, named)
    figure.text(0.27, 0.95, "sector.inp, from below", ha="center", fontsize=8.5)
    figure.text(0.79, 0.95, "damper.inp, larger", ha="center", fontsize=8.5)
    return ax


if __name__ == "__main__":
    for draw in (damper, point, states, folds, sets):
        with plt.rc_context(STYLE):
            save_figure(draw(), IMAGES / f"sketch_{draw.__name__}.png", dpi=150)
