"""One against several harmonics: a blade that rubs on the ground (Figs 17 and 18 of the paper).

The blade touches a rigid ground with the right underside of its platform.  Normal loads at rest are prescribed, falling
linearly along the axis, with a gap at the last row of points; they are scaled to six sums, as in the paper.

* Where surfaces separate and several solutions exist one harmonic is not enough: holds.  At 400 N and 2 kN, with folds,
  five harmonics change the resonance by 4 and 16 %.  (Five are not the last word there: up to thirteen do not converge,
  since one superharmonic resonance after the other enters.)
* At high load the two agree: holds.  At 4 kN, where the fold is about to vanish, they differ by 0.3 %, and where no point
  that is closed at rest opens within the period, by nothing.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

import bdamper as bd
from bdamper.continuation.curve import Curve
from bdamper.plot import colours, save_figure
from bdamper.plot.axes import MARKERS, PAPER
from bdamper.plot.contact import face_coordinates
from bdamper.plot.curves import amplitude_label
from bdamper.plot.motion import contact_status

LOADS = (400.0, 2000.0, 4000.0, 10000.0, 20000.0, 40000.0)
BAND = (260.0, 400.0)
HARMONICS = 5


@dataclass(frozen=True)
class Case:
    """Curves with one and with several harmonics under one sum of normal loads (N)."""

    load: float
    single: Curve
    multiple: Curve
    separates: bool

    @property
    def difference(self) -> float:
        """Largest relative difference of amplitude and frequency at resonance."""
        a, b = self.single.peak, self.multiple.peak
        return max(abs(b.amplitude / a.amplitude - 1.0), abs(b.frequency / a.frequency - 1.0))


def distribution(model: bd.Model) -> np.ndarray:
    """(n_points,) share of the load at each point: linear along the axis, negative (a gap) at the last row."""
    z = model.interfaces["platform"].points[:, 2]
    share = 1.0 + 1.1 * z / np.abs(z).max()
    return share / share[share > 0.0].sum()


def plot_contact_points(model: bd.Model, share: np.ndarray, path: Path) -> None:
    """Fig. 17: the blade on the ground, seen along the axis, and the share of the load at each contact point."""
    face = model.interfaces["platform"]
    with plt.rc_context(PAPER):
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
            corner = (y[i] - 0.45 * dy, x[i] - 0.45 * dx)
            on_face.add_patch(Rectangle(corner, 0.9 * dy, 0.9 * dx, edgecolor="0.3", linewidth=0.5, **look))
        on_face.set(aspect="equal", xlabel="Along the axis (mm)", ylabel="Outward (mm)",
                    xlim=(y.min() - dy, y.max() + dy), ylim=(x.min() - dx, x.max() + dx))  # fmt: skip
        on_face.grid(False)
        gap = Patch(facecolor="w", edgecolor="0.3", hatch="xxxx", label="a gap at rest")
        on_face.legend(handles=[gap], loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize=7.5)
        scale = plt.cm.ScalarMappable(plt.Normalize(0.0, size), "cividis")
        figure.colorbar(scale, ax=on_face, orientation="horizontal", label="Share of the normal load (%)")
    save_figure(figure, path)


def plot_cases(cases: list[Case], limits: list[Curve], harmonics: int, path: Path) -> None:
    """Fig. 18: the load is told by colour and marker, the number of harmonics by the line."""
    with plt.rc_context(PAPER):
        figure, ax = plt.subplots(figsize=(5.6, 4.4))
        for curve, style in zip(limits, ("-.", ":")):
            ax.semilogy(curve.frequency, curve.amplitude, color="0.35", linewidth=0.9, linestyle=style)
        grey = {"color": "0.35", "linewidth": 0.9}
        handles = [Line2D([], [], **grey, linestyle=s, label=n) for s, n in (("-.", "free"), (":", "stuck"))]
        for case, shade, marker in zip(cases, colours(len(cases)), MARKERS):
            for curve, style in ((case.single, "--"), (case.multiple, "-")):
                ax.semilogy(curve.frequency, curve.amplitude, color=shade, linestyle=style)
                ax.plot(curve.peak.frequency, curve.peak.amplitude, marker, color=shade, markersize=5.0,
                        markerfacecolor=shade if style == "-" else "w")  # fmt: skip
            handles.append(Line2D([], [], color=shade, marker=marker, label=f"{case.load / 1000.0:g} kN"))
        handles.append(Line2D([], [], color="k", linestyle="--", marker="o", markerfacecolor="w", label="one harmonic"))
        handles.append(Line2D([], [], color="k", marker="o", label=f"{harmonics} harmonics"))
        ax.set(xlabel="Frequency (Hz)", ylabel=amplitude_label(cases[0].single))
        figure.legend(handles=handles, ncols=5, fontsize=7.5, loc="outside lower center")
    save_figure(figure, path)


def main(figures: Path = Path("figures"), loads: tuple[float, ...] = LOADS, harmonics: int = HARMONICS) -> list[Case]:
    """Compute and draw the figures; returns the curves of each load."""
    figures.mkdir(parents=True, exist_ok=True)
    model = bd.reference_model("blade_to_ground")
    study = bd.Study(
        model,
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip", direction="tangential", amplitude=1.0),
        contact_stiffness="unit_traction",
        blade_modes=10,
        harmonics=1,
    )
    share = distribution(model)
    cases = []
    print(f"{'load':>9}{'one harmonic':>24}{f'{harmonics} harmonics':>26}   folds   separates  difference")
    for load in loads:
        single = bd.prescribe_preload(study, {"platform": load * share})
        multiple = replace(single, harmonics=harmonics)
        curves = [s.track(preload=0.0, frequency=BAND) for s in (single, multiple)]
        state = contact_status(single, curves[0].unknowns[curves[0].peak.index], 0.0)
        opens = bool((state.share[share > 0.0, 0, 2] > 0.0).any())
        case = Case(load, curves[0], curves[1], opens)
        cases.append(case)
        a, b = case.single.peak, case.multiple.peak
        print(
            f"{load:>7.0f} N{1e3 * a.amplitude:>11.4f} mm{a.frequency:>8.2f} Hz{1e3 * b.amplitude:>11.4f} mm"
            f"{b.frequency:>9.2f} Hz{len(case.single.folds):>5} /{len(case.multiple.folds):>2}"
            f"{opens!s:>10}{case.difference:>12.1e}"
        )
    limits = [study.free(BAND), bd.prescribe_preload(study, {"platform": share}).stuck(BAND)]
    plot_contact_points(model, share, figures / "fig17_blade_to_ground.png")
    plot_cases(cases, limits, harmonics, figures / "fig18_blade_to_ground.png")
    return cases


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    main(parser.parse_args().figures)
