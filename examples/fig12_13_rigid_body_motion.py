"""Rigid-body motion of the damper over preload, mean and vibratory (Figs 12 and 13 of the paper).

The paper plots modal coefficients of mass-normalised rigid-body modes at the resonance of mode 1, and so does this.

* Vibration, X translation before Z rotation before Y translation at every preload: holds with the settings of the paper
  only, and from 120 N on (below, Y translation comes second).  Converged, X translation comes first at every preload, and
  from 300 N on Y translation comes second.
* Mean at low preload, X and Y translation and Z rotation: holds but for the axial position, in both.  Where every point
  slips in the axial direction within the period friction does not hold the mean position, and the damper drifts by up to
  the clearance of its end faces.
* Mean at high preload, Y translation: holds in both.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from paper_disk import MODES, STORED, study

import bdamper as bd
from bdamper.plot import save_figure
from bdamper.plot.axes import MARKERS, PAPER, colours
from bdamper.plot.motion import rigid_motion

PRELOADS = tuple(float(p) for p in np.geomspace(50.0, 25e3, 21))
NAMES = [f"{axis} {kind}" for kind in ("translation", "rotation") for axis in "XYZ"]


def motion_over_preload(asked: bd.Study, preloads: tuple[float, ...]) -> dict[str, np.ndarray]:
    """Motion at the resonance of mode 1 for each preload.

    Returns
    -------
    dict
        ``preload`` (n,), ``bias`` and ``vibratory`` (n, 6) in m and rad, ``modal_bias`` and ``modal_vibratory`` (n, 6).
    """
    columns: dict[str, list[np.ndarray]] = {"bias": [], "vibratory": [], "modal_bias": [], "modal_vibratory": []}
    for preload in preloads:
        curve = asked.track(preload, MODES[1].band)
        motion = rigid_motion(asked, curve.unknowns[curve.peak.index])
        modal = np.abs(motion.modal_vibratory[0])
        for name, value in zip(columns, (motion.bias, motion.amplitude, motion.modal_bias, modal)):
            columns[name].append(value)
    return {"preload": np.array(preloads), **{name: np.array(rows) for name, rows in columns.items()}}


def print_motion(name: str, motion: dict[str, np.ndarray]) -> None:
    """A line of a table for each preload."""
    print(f"{name}\n{'preload':>10}{'X':>9}{'Y':>9}{'Z (um)':>9}{'about X, Y, Z (mrad)':>27}  order, vibration; mean")
    rows = (motion["preload"], motion["vibratory"], motion["modal_vibratory"], np.abs(motion["modal_bias"]))
    for preload, physical, modal, mean in zip(*rows):
        orders = [" > ".join(bd.RIGID_NAMES[k] for k in np.argsort(-values)[:3]) for values in (modal, mean)]
        numbers = (*1e6 * physical[:3], *1e3 * physical[3:])
        print(f"{preload:>8.0f} N" + "".join(f"{v:9.3f}" for v in numbers) + "   " + "; ".join(orders))


def main(figures: Path = Path("figures"), preloads: tuple[float, ...] = PRELOADS) -> dict[str, dict[str, np.ndarray]]:
    """Compute and draw the figures; returns the motion with the settings of the paper and the converged one."""
    figures.mkdir(parents=True, exist_ok=True)
    with np.load(STORED / "rigid_motion.npz") as file:
        out = {"settings of the paper": motion_over_preload(study(1, **bd.PAPER), preloads), "converged": dict(file)}
    for name, motion in out.items():
        print_motion(name, motion)
    for number, quantity, title in ((12, "bias", "Mean"), (13, "vibratory", "Vibration")):
        with plt.rc_context(PAPER):
            figure, axes = plt.subplots(1, 2, figsize=(8.0, 3.7), sharex=True, sharey=True)
        shown = [np.abs(motion["modal_" + quantity]) for motion in out.values()]
        top = max(float(values.max()) for values in shown)
        for ax, (name, motion), values in zip(axes, out.items(), shown):
            for k, shade in enumerate([*colours(3), *colours(3)]):
                ax.loglog(motion["preload"], np.maximum(values[:, k], 1e-9 * top), color=shade, marker=MARKERS[k],
                          linestyle="-" if k < 3 else "--", markersize=3.2, label=NAMES[k])  # fmt: skip
            ax.set(xlabel="Preload (N)", ylim=(1e-5 * top, 2.0 * top))
            ax.set_title(f"{title}, {name}", fontsize=9.0)
        axes[0].set_ylabel("Modal coefficient of the damper (kg$^{1/2}$ m)")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, ncols=6, fontsize=7.0, loc="outside lower center")
        save_figure(figure, figures / f"fig{number}_rigid_motion_{'mean' if number == 12 else 'vibration'}.png")
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="where to write figures")
    main(parser.parse_args().figures)
