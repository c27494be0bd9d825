"""Model for the paper's figures, with the settings of the paper and with converged settings.

The paper uses the stiffness equations (4) and (10), ten blade modes, six rigid-body modes of the
damper and one harmonic. "Converged" means three harmonics, each with the modes of its own nodal
diameter, and residual modes for the flexibility that the ten blade modes omit. ``studies.md`` shows
the effect of each of these steps and of more harmonics (6 % from 300 N upward, a fifth at 135 N),
and that neither is converged in the number of contact points at low load.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import bdamper as bd
from bdamper.plot import plot_curves, plot_optimal
from bdamper.plot.axes import STYLE
from bdamper.plot.motion import rigid_motion
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.response_curve_result import ResponseCurve

STORED = Path(__file__).parent / "converged"
FIGURES = Path(__file__).parents[1] / "figures"
FRICTION = 0.46
DAMPING_RATIO = 0.0021


@dataclass(frozen=True)
class Mode:
    """Excitation of a mode at the trailing-edge corner of the tip, frequency interval of its
    resonances (Hz), preloads of its response curves, and interval of its optimal curve (N).
    """

    direction: str
    force: float
    band: tuple[float, float]
    preloads: tuple[float, ...]
    interval: tuple[float, float]

    @property
    def name(self) -> str:
        """Return the name of the excited mode."""
        return f"{self.force:g} N {self.direction}"


MODES = {
    1: Mode(
        "tangential",
        1.0,
        (245.0, 330.0),
        (50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0),
        (50.0, 25e3),
    ),
    2: Mode(
        "radial", 12.0, (442.0, 490.0), (50.0, 120.0, 250.0, 500.0, 1000.0, 2000.0), (50.0, 25e3)
    ),
    3: Mode("tangential", 1.0, (1150.0, 1600.0), (50.0, 100.0, 200.0, 500.0, 2000.0), (50.0, 10e3)),
    7: Mode("axial", 1.0, (3060.0, 3180.0), (20.0, 50.0, 100.0, 200.0, 500.0), (10.0, 5e3)),
}
TRANSLATIONS = ("TX", "TY", "TZ")
ROTATION_PRELOADS = (100.0, 200.0, 1000.0, 10000.0)
MOTION_PRELOADS = tuple(float(p) for p in np.geomspace(50.0, 25e3, 21))
POINTS, POINTS_PRELOADS = (9, 24, 48), (100.0, 200.0, 1000.0, 25000.0)
RIG_LOADS, RIG_BAND = (25.0, 1.5e5), (240.0, 380.0)
RIG_PLAIN = {"contact_stiffness": "unit_traction", "harmonics": 1}
CONVERGED = {"contact_stiffness": bd.ResidualModes(partial_contact=False)}
"""Residual modes of the stored curves, which ``studies.md`` uses for comparison: force vectors of
bonded faces only.
"""


def study(
    mode: int, contact_points: int = 24, model: bd.Model | None = None, **settings: Any
) -> bd.Study:
    """Return the study of the disk excited in a mode, with settings that differ from the defaults
    if given (``**bd.CIGEROGLU_2009``).
    """
    driven = MODES[mode]
    settings = CONVERGED | settings
    # the paper drives mode 2 radially, although the corner of the tip moves little in this direction
    warnings.filterwarnings("ignore", "excitation direction: .* radial", bd.PlausibilityWarning)
    return bd.Study(
        model or bd.reference_model("paper_disk", contact_points),
        bd.Excitation("tip_trailing_edge", direction=driven.direction, amplitude=driven.force),
        engine_order=5,
        friction_coefficient=FRICTION,
        **settings,
    )


def rig_study(**settings: Any) -> bd.Study:
    """Return the study of the test rig, excited by 1 N in the tangential direction at the tip."""
    settings = CONVERGED | settings
    return bd.Study(
        bd.reference_model("test_rig"), bd.Excitation("tip"), friction_coefficient=0.4, **settings
    )


def stored(name: str) -> Any:
    """Load a converged result that ``python examples/make_converged.py`` has computed."""
    return bd.load(STORED / f"{name}.h5")


def keep(target: Axes | Figure, name: str) -> None:
    """Write a figure to the folder ``figures``, and leave it open for the gallery."""
    FIGURES.mkdir(exist_ok=True)
    figure = np.ravel(np.asarray(target, object))[0].get_figure()
    with plt.rc_context(STYLE):
        figure.savefig(FIGURES / f"{name}.png")
    figure.set_layout_engine("none")  # the gallery has it as it was written


def motion_over_preload(asked: bd.Study, preloads: Sequence[float]) -> dict[str, np.ndarray]:
    """Compute the rigid-body motion of the damper at the resonance of mode 1 for each preload.

    Returns
    -------
    dict
        ``preload`` (n,), ``bias`` and ``vibratory`` (n, 6) in m and rad, ``modal_bias`` and ``modal_vibratory`` (n, 6).
    """
    columns: dict[str, list[np.ndarray]] = {
        "bias": [],
        "vibratory": [],
        "modal_bias": [],
        "modal_vibratory": [],
    }
    for preload in preloads:
        curve = asked.frequency_response(preload, MODES[1].band)
        motion = rigid_motion(asked, curve.peak.y[:-1])
        modal = np.abs(motion.modal_vibratory[0])
        for name, value in zip(columns, (motion.bias, motion.amplitude, motion.modal_bias, modal)):
            columns[name].append(value)
    return {
        "preload": np.array(preloads),
        **{name: np.array(rows) for name, rows in columns.items()},
    }


def print_curves(name: str, curves: list[ResponseCurve]) -> None:
    """Print one line of a table for each curve."""
    print(f"{name}\n{'preload':>10}{'peak':>13}{'at':>12}{'folds':>7}{'open at the peak':>18}")
    for c in curves:
        peak, opened = c.peak, 100 * c.peak.shares[2]
        status = "" if c.complete else f"  {c.status}"
        print(
            f"{c.preload:>8.0f} N{1e3 * peak.amplitude:>10.5f} mm{peak.frequency:>9.2f} Hz{len(c.folds):>7}"
            f"{opened:>16.0f} %{status}"
        )


def plot_beside(
    paper: Sequence[ResponseCurve], converged: Sequence[ResponseCurve], title: str
) -> Figure:
    """Plot the curves with the settings of the paper on the left and the converged curves on the
    right, with the same axes.
    """
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, 2, figsize=(8.0, 4.2), sharex=True, sharey=True)
        for ax, curves, name in zip(
            axes, (paper, converged), ("settings of the paper", "converged")
        ):
            plot_curves(curves, ax, title=f"{title}, {name}")
            ax.get_legend().remove()
        axes[1].set_ylabel("")
        figure.legend(
            *axes[0].get_legend_handles_labels(), ncols=5, fontsize=8.0, loc="outside lower center"
        )
    return figure


def plot_optimal_beside(paper: OptimalCurve, converged: OptimalCurve, title: str) -> Figure:
    """Plot amplitude above frequency shift, with the settings of the paper on the left and
    converged on the right, on the same axes.
    """
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(
            2, 2, figsize=(8.2, 5.4), sharex=True, sharey="row", height_ratios=(2.0, 1.0)
        )
        common = {}
        for column, curve, name in zip(
            axes.T, (paper, converged), ("settings of the paper", "converged")
        ):
            plot_optimal(curve, column[0], title=f"{title}, {name}")
            plot_optimal(curve, column[1], quantity="shift")
            common |= dict(zip(*column[0].get_legend_handles_labels()[::-1]))
            column[0].get_legend().remove()
            column[0].set_xlabel("")
        axes[0, 0].set_xlim(0.9 * paper.preload[0], 1.1 * paper.preload[-1])
        for ax in axes[:, 1]:
            ax.set_ylabel("")
        common = {
            name: handle
            for name, handle in common.items()
            if not name.startswith(("optimum", "least"))
        }
        figure.legend(
            common.values(), common.keys(), ncols=4, fontsize=8.0, loc="outside lower center"
        )
    return figure
