"""
One against several harmonics: the blade rubs on the ground (Figs 17 and 18)
============================================================================

As in the paper, the blade of the disk alone touches a rigid ground with the right underside of its
platform; it is fixed at the bore and at the cut faces of its segment. The normal loads at rest are
prescribed. They decrease linearly along the axis, with a gap at the last row of points, and are
scaled to six total loads.  Equations (4) and (10) need the preload of a damper, so the contact
stiffness with the settings of the paper is computed from uniform tractions. The example requires
``bdamper[fe]``.
"""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from paper_disk import DAMPING_RATIO, FRICTION, keep, print_curves

import bdamper as bd
from bdamper.fem import blade_to_ground
from bdamper.fem.meshes import paper_geometry
from bdamper.plot import colours
from bdamper.plot.axes import MARKERS, STYLE, STYLES, fit_units
from bdamper.plot.contact import face_coordinates
from bdamper.plot.curves import amplitude_label
from bdamper.plot.motion import contact_status

model = blade_to_ground(geometry=paper_geometry(), damping_ratio=DAMPING_RATIO)
face = model.interfaces["platform"]
along = face.points[:, 2] / np.abs(face.points[:, 2]).max()
share = (1.0 + 1.1 * along) / np.maximum(1.0 + 1.1 * along, 0.0).sum()
"""(n_points,) of the load, negative at the last row: a gap."""

# %%
# **Fig. 17.** The blade on the ground, seen along the axis, and the share of the load at each contact point.

with plt.rc_context(STYLE):
    figure, (ax, on_face) = plt.subplots(1, 2, figsize=(7.4, 3.2), width_ratios=[1.0, 1.6])
    for mesh in model.meshes.values():
        corner = 1e3 * mesh.points
        front = mesh.quads[corner[mesh.quads, 2].min(axis=1) > corner[:, 2].max() - 1.0]
        for quad in front:
            ax.fill(*corner[quad, :2].T, facecolor="0.88", edgecolor="0.6", linewidth=0.3)
    points = 1e3 * face.points
    middle, tangent, normal = points.mean(axis=0), face.frame[0, 0], face.frame[0, 2]
    ends = middle + np.outer([-7.0, 7.0], tangent)
    ground = np.concatenate([ends, ends[::-1] + 2.5 * normal])[:, :2]
    ax.fill(*ground.T, facecolor="w", edgecolor="k", hatch="////", linewidth=0.8)
    ax.plot(points[:, 0], points[:, 1], "k.", markersize=4.0)
    ax.annotate("ground", (middle + 4.5 * normal)[:2], ha="center", va="top", fontsize=8.0)
    ax.set(aspect="equal", xlabel="X (mm)", ylabel="Y (mm)", xlim=middle[0] + np.array([-22.0, 14.0]),
           ylim=middle[1] + np.array([-14.0, 16.0]))  # fmt: skip
    ax.grid(False)
    x, y, dx, dy = face_coordinates(face.points, face.frame[0])
    size = 100.0 * float(share.max())
    for i, value in enumerate(100.0 * share):
        look: dict[str, Any] = {"facecolor": "w", "hatch": "xxxx"}
        if value > 0.0:
            look = {"facecolor": plt.get_cmap("cividis")(value / size)}
        place = (y[i] - 0.45 * dy, x[i] - 0.45 * dx)
        on_face.add_patch(
            Rectangle(place, 0.9 * dy, 0.9 * dx, edgecolor="0.3", linewidth=0.5, **look)
        )
    on_face.set(aspect="equal", xlabel="Along the axis (mm)", ylabel="Outward (mm)",
                xlim=(y.min() - dy, y.max() + dy), ylim=(x.min() - dx, x.max() + dx))  # fmt: skip
    on_face.grid(False)
    gap = Patch(facecolor="w", edgecolor="0.3", hatch="xxxx", label="a gap at rest")
    on_face.legend(handles=[gap], loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize=7.5)
    scale = plt.cm.ScalarMappable(plt.Normalize(0.0, size), "cividis")
    figure.colorbar(
        scale, ax=on_face, orientation="horizontal", label="Share of the normal load (%)"
    )
keep(figure, "fig17_blade_to_ground")

# %%
# **Fig. 18.** One and five harmonics, with uniform tractions and with residual modes, and what five change of the peaks.
#
# * Where surfaces separate and several solutions exist one harmonic is not enough: holds in both.  With folds, at 400 N to
#   4 kN, five harmonics change the resonance by 3 to 18 % (9 to 20 % with residual modes).
# * At high load the two agree: holds in both.  At 10 kN they differ by 2 and 0.6 %, at 40 kN by nothing and 0.2 %.

LOADS, BAND, HARMONICS = (400.0, 2000.0, 4000.0, 10000.0, 20000.0, 40000.0), (245.0, 345.0), (1, 5)
METHODS = {
    "uniform tractions": "unit_traction",
    "residual modes": bd.ResidualModes(partial_contact=False),
}


def differences(single: list, multiple: list) -> list[float]:
    """Return the relative change of the resonance amplitude from one to five harmonics at each
    load.
    """
    return [b.peak.amplitude / a.peak.amplitude - 1.0 for a, b in zip(single, multiple)]


curves: dict[str, list[list]] = {}
opens: dict[str, list[bool]] = {}
with plt.rc_context(STYLE):
    figure, (*axes, changed) = plt.subplots(1, 3, figsize=(9.6, 4.2), width_ratios=[1.2, 1.2, 1.0])
for ax, (name, method), marker in zip(axes, METHODS.items(), "os"):
    driven = bd.Excitation("tip_trailing_edge")
    study = bd.Study(
        model,
        driven,
        friction_coefficient=FRICTION,
        contact_stiffness=method,
        blade_modes=10,
        harmonics=1,
    )
    loaded = [study.replace(constant_loads={"platform": load * share}) for load in LOADS]
    curves[name] = [
        [s.replace(harmonics=h).frequency_response(0.0, BAND) for s in loaded] for h in HARMONICS
    ]
    states = [contact_status(s, c.peak.y[:-1], 0.0) for s, c in zip(loaded, curves[name][0])]
    opens[name] = [bool((state.share[share > 0.0, 0, 2] > 0.0).any()) for state in states]
    for h, found in zip(HARMONICS, curves[name]):
        print_curves(
            f"{name}, harmonics {h}, loads {', '.join(f'{load:g}' for load in LOADS)} N", found
        )
    change = [100.0 * d for d in differences(*curves[name])]
    print("change of the peak:", ", ".join(f"{d:+.2g} %" for d in change))
    changed.semilogx(LOADS, change, color="0.1", linestyle="-" if marker == "o" else "-.", marker=marker, markersize=4.0,
                     markerfacecolor="w", label=name)  # fmt: skip
    grey = {"color": "0.35", "linewidth": 0.9}
    limits = [(study.free(BAND), STYLES[2], "free"), (loaded[-1].stuck(BAND), STYLES[4], "stuck")]
    for curve, style, _ in limits:
        ax.semilogy(curve.frequency, curve.amplitude, **grey, linestyle=style)
    for single, multiple, shade, marker in zip(*curves[name], colours(len(LOADS)), MARKERS):
        for curve, style, fill in ((single, "-.", "w"), (multiple, "-", shade)):
            ax.semilogy(curve.frequency, curve.amplitude, color=shade, linestyle=style)
            ax.plot(
                curve.peak.frequency,
                curve.peak.amplitude,
                marker,
                color=shade,
                markersize=5.0,
                markerfacecolor=fill,
            )
    ax.set_title(name, fontsize=9.0)
    ax.set_xlabel("Frequency (Hz)")
axes[0].set_ylabel(amplitude_label(curve))
axes[1].set(ylim=axes[0].set_ylim(2e-6))
fit_units(axes[0])
axes[1].tick_params(labelleft=False)
changed.set(xlabel="Normal load (N)", ylabel="Change of the peak by five harmonics (%)")
changed.legend(fontsize=7.5, loc="lower right", frameon=False)
handles = [Line2D([], [], **grey, linestyle=style, label=label) for _, style, label in limits]
for load, shade, marker in zip(LOADS, colours(len(LOADS)), MARKERS):
    handles.append(Line2D([], [], color=shade, marker=marker, label=f"{load / 1000.0:g} kN"))
handles.append(
    Line2D([], [], color="k", linestyle="-.", marker="o", markerfacecolor="w", label="one harmonic")
)
handles.append(Line2D([], [], color="k", marker="o", label="five harmonics"))
figure.legend(handles=handles, ncols=5, fontsize=7.5, loc="outside lower center", frameon=False)
keep(figure, "fig18_blade_to_ground")
