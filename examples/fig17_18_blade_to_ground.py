"""One against several harmonics: a blade that rubs on the ground (Figs 17 and 18 of the paper).

The blade touches a rigid ground with the right underside of its platform.  Normal loads at rest are prescribed, falling
linearly along the axis, with a gap at the last row of points; they are scaled to six sums in the ratios of the paper.

The paper: where surfaces separate and several solutions exist, one harmonic is not enough; at high preload the two
agree.  So it is here: at 400 N and 2 kN, with folds, more harmonics change the resonance by 4 and 16 %, at 4 kN, where the
fold is about to vanish, by 0.3 %, and where no point that is closed at rest opens within the period, by nothing.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import bdamper as bd
from bdamper.continuation.curve import Curve
from bdamper.plot import plot_curves, save_figure
from bdamper.plot.axes import PAPER
from bdamper.plot.contact import face_coordinates
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
    """The blade with the share of the load at each contact point, seen along the axis and on the face."""
    face = next(iter(model.interfaces.values()))
    with plt.rc_context(PAPER):
        figure, (ax, on_face) = plt.subplots(1, 2, figsize=(7.0, 3.4), width_ratios=[1.0, 1.4])
        for mesh in model.meshes.values():
            corner = 1e3 * mesh.points
            front = mesh.quads[corner[mesh.quads, 2].min(axis=1) > corner[:, 2].max() - 1.0]
            for quad in front:
                ax.fill(*corner[quad, :2].T, facecolor="0.9", edgecolor="0.6", linewidth=0.3)
        points = 1e3 * face.points
        near = 12.0
        ax.plot(points[:, 0], points[:, 1], "k.", markersize=3.0)
        tangent = face.frame[0, 0]
        ends = 1e3 * face.points.mean(axis=0) + np.outer([-9.0, 9.0], tangent) + 0.4 * face.frame[0, 2]
        ax.plot(ends[:, 0], ends[:, 1], color="k", linewidth=1.6)
        ax.annotate("ground", ends[0, :2], textcoords="offset points", xytext=(4, -10), fontsize=8.0)
        ax.set_xlim(points[:, 0].min() - near - 8.0, points[:, 0].max() + near)
        ax.set_ylim(points[:, 1].min() - near - 4.0, points[:, 1].max() + near)
        ax.set(aspect="equal", xlabel="X (mm)", ylabel="Y (mm)")
        x, y, _, _ = face_coordinates(face.points, face.frame[0])
        size = float(np.abs(share).max())
        dots = on_face.scatter(
            y, x, c=share, s=90.0, cmap="cividis", vmin=-0.1 * size, vmax=size, edgecolors="0.2", linewidths=0.5
        )
        closed = share > 0.0
        on_face.scatter(y[~closed], x[~closed], marker="x", s=30.0, c="w")
        on_face.set(aspect="equal", xlabel="Along the axis (mm)", ylabel="Outward (mm)")
        on_face.set_title("crosses: a gap at rest", fontsize=8.0)
        figure.colorbar(dots, ax=on_face, orientation="horizontal", label="Share of the normal load")
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
    stuck = bd.prescribe_preload(study, {"platform": share}).stuck(BAND)
    ax = plot_curves([study.free(BAND), stuck, *(c.single for c in cases)], labels=[f"{c.load:g} N" for c in cases],
                     title=f"Lines: one harmonic; rings: {harmonics} harmonics")  # fmt: skip
    for case in cases:
        ax.plot(case.multiple.frequency[::3], case.multiple.amplitude[::3], "o", markersize=3.4, markerfacecolor="none",
                markeredgecolor="0.25", markeredgewidth=0.5)  # fmt: skip
    save_figure(ax, figures / "fig18_blade_to_ground.png")
    plot_contact_points(model, share, figures / "fig17_blade_to_ground.png")
    return cases


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    main(parser.parse_args().figures)
