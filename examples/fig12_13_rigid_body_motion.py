"""Rigid-body motion of the damper over preload, mean and vibratory (Figs 12 and 13 of the paper).

The paper plots modal coefficients of mass-normalised rigid-body modes.  They are shown here, and beside them the same in
metres and radians at the damper: a translation divided by the root of its mass, a rotation by the root of its moment of
inertia.  Taken at the resonance of mode 1 for each preload.

Vibration: the coefficients come in the order of the paper at every preload, X translation, Z rotation, Y translation.

Mean: X and Y translation and Z rotation contribute at low load, Y translation takes over at high load, as in the paper.
One thing is different: at low load the mean of the axial (Z) translation is large, up to the clearance of the end faces.
Where every point slips in the axial direction within the period, friction does not hold the mean position any more: the
damper drifts until a front or back face touches.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import bdamper as bd
from bdamper.plot import colours, save_figure
from bdamper.plot.axes import MARKERS, PAPER
from bdamper.plot.motion import rigid_motion

PRELOADS = tuple(float(p) for p in np.geomspace(50.0, 25e3, 19))
BAND = (270.0, 370.0)


def plot_rigid_motion(
    axes: np.ndarray, preload: np.ndarray, modal: np.ndarray, physical: np.ndarray, title: str
) -> None:
    """Modal coefficients, translations and rotations (n, 6) over the preload (n,), in three panels."""
    names = [f"{axis} {kind}" for kind in ("translation", "rotation") for axis in "XYZ"]
    panels = (
        (modal, range(6), "Modal coefficient (kg$^{1/2}$ m)", 1.0),
        (physical, range(3), "Translation (µm)", 1e6),
        (physical, range(3, 6), "Rotation (mrad)", 1e3),
    )
    shades = colours(3)
    with plt.rc_context(PAPER):
        for ax, (values, columns, label, unit) in zip(axes, panels):
            for k in columns:
                ax.loglog(preload, unit * np.maximum(values[:, k], 1e-300), color=shades[k % 3], marker=MARKERS[k],
                          linestyle="-" if k < 3 else "--", markersize=3.2, markevery=2, label=names[k])
            shown = unit * values[:, list(columns)]
            top = float(shown.max())
            ax.set_ylim(max(float(shown[shown > 0.0].min()), 1e-5 * top) / 2.0, 2.0 * top)
            ax.set(xlabel="Preload (N)", ylabel=label)
            ax.grid(True, color="0.9")
        handles, labels = axes[0].get_legend_handles_labels()
        axes[0].figure.legend(handles, labels, ncols=6, fontsize=7.0, loc="outside lower center")
        axes[1].set_title(title, fontsize=9.0)


def main(figures: Path = Path("figures"), preloads: tuple[float, ...] = PRELOADS) -> dict[str, np.ndarray]:
    """Compute and draw the figures.

    Returns
    -------
    dict
        ``preload`` (n,), ``bias`` and ``vibratory`` (n, 6) in m and rad, ``modal_bias`` and ``modal_vibratory`` (n, 6).
    """
    figures.mkdir(parents=True, exist_ok=True)
    study = bd.Study(
        bd.reference_model("bladed_disk", contact_points=24),
        engine_order=5,
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip", direction="tangential", amplitude=1.0),
        contact_stiffness="unit_traction",
        blade_modes=10,
        harmonics=1,
    )
    columns: dict[str, list[np.ndarray]] = {"bias": [], "vibratory": [], "modal_bias": [], "modal_vibratory": []}
    print(
        f"{'preload':>10}{'X (um)':>9}{'Y (um)':>9}{'Z (um)':>9}{'about X, Y, Z (mrad)':>27}  order of modal coefficients"
    )
    for preload in preloads:
        curve = study.track(preload=preload, frequency=BAND)
        motion = rigid_motion(study, curve.unknowns[curve.peak.index])
        modal = np.abs(motion.modal_vibratory[0])
        for name, value in zip(columns, (motion.bias, motion.amplitude, motion.modal_bias, modal)):
            columns[name].append(value)
        order = [bd.RIGID_NAMES[k] for k in np.argsort(-modal)[:3]]
        um, mrad = 1e6 * motion.amplitude[:3], 1e3 * motion.amplitude[3:]
        print(f"{preload:>8.0f} N" + "".join(f"{v:9.3f}" for v in (*um, *mrad)) + "   " + " > ".join(order))
    out = {"preload": np.array(preloads), **{name: np.array(rows) for name, rows in columns.items()}}
    for name, title, file in (
        ("bias", "Mean position at resonance", "fig12_rigid_motion_mean.png"),
        ("vibratory", "Vibration at resonance", "fig13_rigid_motion_vibration.png"),
    ):
        figure, axes = plt.subplots(1, 3, figsize=(9.0, 3.2), layout="constrained")
        plot_rigid_motion(axes, out["preload"], np.abs(out["modal_" + name]), np.abs(out[name]), title)
        save_figure(figure, figures / file)
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    main(parser.parse_args().figures)
