r"""From rotor speed to fatigue margin: dampers of three masses over the speed range of a bladed disk.

The script draws a Campbell diagram with damped crossings, the fatigue margin against speed for each
damper mass, and margin and tip amplitude against the mass at one speed, as for a design review.
Preload, frequencies, contact and mean stress belong to the respective speed. The margin is the
factor on the amplitude by Goodman, at the points of the blade away from its contact faces, for a
steel-like material. The damper with the largest margin is lighter than the damper with the lowest
amplitude.

    python examples/speed_to_margin.py --harmonics 3
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import matplotlib.pyplot as plt

import bdamper as bd
from bdamper.analyses.sweep import SweepResult
from bdamper.fatigue.criteria import Material
from bdamper.fatigue.margin import LeastMargin
from bdamper.harmonic_balance.rotor_speed import RPM
from bdamper.plot import plot_campbell, plot_crossings, save_figure
from bdamper.response.optimal_curve_result import OptimalCurve

ORDERS, MASSES, SPEEDS = (4, 5, 6), (0.55, 0.8, 1.4), (200.0, 720.0)
"""Engine orders, factors on the damper mass, and range of speeds (rad/s)."""
ONE_SPEED, LOADS = 440.0, (0.28, 0.7)
"""Speed (rad/s) at which margins are shown against the mass, and factors on the preload of the
nominal mass at this speed.
"""
STEEL = Material(
    300e6, 900e6, 800e6, name="a steel", source="round figures; take those of your part"
)


def study(harmonics: int = 3) -> bd.Study:
    """Return the study of the shipped disk, which has speed-dependent data and blade stresses, with
    60 N at the tip.
    """
    model = bd.reference_model("bladed_disk", 9)
    return bd.Study(
        model,
        bd.Excitation("tip", amplitude=60.0),
        5,
        friction_coefficient=0.3,
        harmonics=harmonics,
    )


def over_mass(asked: bd.Study) -> OptimalCurve:
    """Compute the highest peaks and their margins at several preloads at one speed, with the
    inertia of the nominal damper.
    """
    at = asked.at_speed(ONE_SPEED)
    loads = tuple(factor * at.preload for factor in LOADS)
    with warnings.catch_warnings():
        # the optimum belongs to another mass than that of the model, which is the question here
        warnings.simplefilter("ignore", bd.PlausibilityWarning)
        return at.optimal_curve(loads, 20, check=False, quantity="margin", material=STEEL)


def plot_over_mass(curve: OptimalCurve, grams: float, ax: plt.Axes) -> None:
    """Plot margin and tip amplitude against the damper mass, ``grams`` for each newton of preload."""
    (margins,) = curve.margins
    ax.plot(grams * margins.values, margins.margin, "k-", label="margin")
    ax.plot(
        grams * margins.best_value, margins.best_margin, "k*", markersize=11, label="largest margin"
    )
    tip = ax.twinx()
    tip.plot(
        grams * curve.preload,
        1e3 * curve.amplitude,
        color="0.55",
        linestyle="-.",
        label="tip amplitude",
    )
    best = curve.optimum
    tip.plot(
        grams * best.preload,
        1e3 * best.amplitude,
        "o",
        color="0.55",
        markeredgecolor="k",
        label="least amplitude",
    )
    ax.set(xlabel="Damper mass (g)", ylabel="Margin against fatigue", ylim=(0.0, None))
    ax.set_title(
        f"engine order {curve.settings['engine_order']}, {ONE_SPEED * RPM:.0f} rpm", fontsize=8
    )
    tip.set(ylabel="Tip amplitude (mm), dash-dotted", ylim=(0.0, None))
    tip.grid(False)
    both = [handle for axes in (ax, tip) for handle in axes.get_legend_handles_labels()[0]]
    names = [line.get_label() for line in both]
    ax.legend(both, names, fontsize=7.0, loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2)


def review(asked: bd.Study, found: SweepResult, curve: OptimalCurve) -> plt.Figure:
    """Draw the Campbell diagram with damped crossings, the margin against speed, and margin and tip
    amplitude against mass.
    """
    campbell = asked.campbell(SPEEDS, ORDERS, modes=1, damped=found)
    with plt.style.context("bdamper.plot.style"):
        figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13.0, 4.0))
    plot_campbell(campbell, left)
    left.set_ylim(200.0, 520.0)
    plot_crossings(found, middle, quantity="margin")
    plot_over_mass(
        curve, 1e3 * asked.model.bodies["damper"].mass / asked.at_speed(ONE_SPEED).preload, right
    )
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--harmonics", type=int, default=3)
    parser.add_argument("--folder", type=Path, default=Path())
    given = parser.parse_args()
    asked = study(given.harmonics)
    found = asked.resonance_crossings(
        SPEEDS, ORDERS, damper_mass_factor=MASSES, margin=LeastMargin(STEEL), progress=True
    )
    print(found)
    found.save(given.folder / "speed_to_margin.h5")
    curve = over_mass(asked)
    print(curve.margins[0])
    save_figure(review(asked, found, curve), given.folder / "speed_to_margin.png")


if __name__ == "__main__":
    main()
