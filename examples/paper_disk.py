"""The body of the paper's figures, with the settings of the paper and with converged ones.

The paper computes with stiffness equations (4) and (10), ten blade modes, six rigid modes of the damper and one harmonic.
"Converged" stands for three harmonics, each with the modes of its own nodal diameter, and residual modes for what the ten
blade modes leave out; ``docs/studies.md`` shows what each of these steps is worth, what more harmonics change (5 %), and
that neither is converged in the number of contact points at low load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

import bdamper as bd
from bdamper.continuation.curve import Curve
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.plot import plot_curves, plot_optimal
from bdamper.plot.axes import PAPER

STORED = Path(__file__).parent / "converged"
FRICTION = 0.46


@dataclass(frozen=True)
class Mode:
    """How a mode is driven at the trailing-edge corner of the tip, and where its resonances lie (Hz)."""

    direction: str
    force: float
    band: tuple[float, float]


MODES = {
    1: Mode("tangential", 1.0, (245.0, 330.0)),
    2: Mode("radial", 12.0, (442.0, 490.0)),
    3: Mode("tangential", 1.0, (1150.0, 1600.0)),
    7: Mode("axial", 1.0, (3060.0, 3180.0)),
}


def study(mode: int, contact_points: int = 24, model: bd.Model | None = None, **settings: Any) -> bd.Study:
    """The disk driven in a mode, with other settings than the defaults if they are named (``**bd.PAPER``)."""
    driven = MODES[mode]
    return bd.Study(
        model or bd.reference_model("paper_disk", contact_points),
        bd.Excitation("tip_trailing_edge", direction=driven.direction, amplitude=driven.force),
        engine_order=5,
        friction_coefficient=FRICTION,
        **settings,
    )


def stored(name: str) -> Any:
    """A converged result, as ``python examples/make_converged.py`` has made it."""
    return bd.load(STORED / f"{name}.h5")


def plot_beside(paper: Sequence[Curve], converged: Sequence[Curve], title: str) -> Figure:
    """Curves with the paper's settings on the left, converged ones on the right, on the same axes."""
    with plt.rc_context(PAPER):
        figure, axes = plt.subplots(1, 2, figsize=(8.0, 3.9), sharex=True, sharey=True)
        for ax, curves, name in zip(axes, (paper, converged), ("settings of the paper", "converged")):
            plot_curves(curves, ax, title=f"{title}, {name}")
            ax.legend(ncols=2, fontsize=6.5, loc="lower left")
        axes[1].set_ylabel("")
    return figure


def plot_optimal_beside(paper: OptimalCurve, converged: OptimalCurve, title: str) -> Figure:
    """Optimal curves with the paper's settings on the left, converged on the right, on the same axes."""
    with plt.rc_context(PAPER):
        figure, axes = plt.subplots(1, 2, figsize=(8.2, 4.2), sharex=True, sharey=True)
        shifts = []
        for ax, curve, name in zip(axes, (paper, converged), ("settings of the paper", "converged")):
            shifts.append(plot_optimal(curve, ax, title=f"{title}, {name}", coexisting=False)[1])
            handles = dict(zip(*ax.get_legend_handles_labels()[::-1]))
            ax.legend(*zip(*[(h, n) for n, h in handles.items() if n.startswith(("optimum", "least"))]), fontsize=7.5,
                      loc="center right")  # fmt: skip
        axes[0].set_xlim(0.9 * paper.preload[0], 1.1 * paper.preload[-1])
        lowest, highest = (f([f(s.get_ylim()) for s in shifts]) for f in (min, max))
        for shift in shifts:
            shift.set_ylim(lowest, highest)
        axes[1].set_ylabel("")
        shifts[0].set_ylabel("")
        shifts[0].set_yticklabels([])
        common = [(handles[n], n) for n in ("free", "stuck", "amplitude", "frequency shift")]
        figure.legend(*zip(*common), ncols=4, fontsize=8.0, loc="outside lower center")
    return figure
