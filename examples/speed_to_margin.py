r"""From rotor speed to fatigue margin: dampers of three masses over the speed range of a bladed disk.

Campbell diagram with damped crossings, and the margin against fatigue over speed for each mass of the damper, as a design
review would use them.  Preload, frequencies, contact and mean stress are those of the speed of each crossing; the margin is
that of Goodman on the amplitude, at the points of the blade away from its contact faces, for a material like a steel.

    python examples/speed_to_margin.py --harmonics 3

The sector is meshed and reduced first, some seconds for each nodal diameter.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt

import bdamper as bd
from bdamper.fatigue.margin import LeastMargin
from bdamper.fatigue.material import Material
from bdamper.fe.reference import bladed_disk
from bdamper.plot import plot_campbell, plot_crossings, save_figure
from bdamper.speed.crossings import Crossings

ORDERS, MASSES, SPEEDS = (4, 5, 6), (0.5, 1.0, 2.0), (200.0, 720.0)
"""Engine orders, factors on the mass of the damper, and the range of speeds (rad/s)."""
BLADES = 65
STEEL = Material(300e6, 900e6, 800e6, name="a steel", source="round figures; take those of your part")


def study(harmonics: int = 3) -> bd.Study:
    """The reference disk over speed with stress at the root and the platform of its blade, 20 N at the tip."""
    waves = {order * l % BLADES for order in ORDERS for l in range(1, harmonics + 1)}
    diameters = tuple(sorted(min(d, BLADES - d) for d in waves))
    model = bladed_disk(9, "coarse", n_modes=20, nodal_diameters=diameters, rotation=SPEEDS[1], stress=True)
    return bd.Study(model, bd.Excitation("tip", amplitude=20.0), 5, friction_coefficient=0.3, harmonics=harmonics)


def review(asked: bd.Study, found: Crossings) -> plt.Figure:
    """Campbell diagram with damped crossings beside margin over speed."""
    campbell = asked.campbell(SPEEDS, ORDERS, modes=1, damped=found)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 4.2), layout="constrained")
    plot_campbell(campbell, left)
    left.set_ylim(200.0, 520.0)
    plot_crossings(found, right, quantity="margin")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--harmonics", type=int, default=3)
    parser.add_argument("--folder", type=Path, default=Path())
    given = parser.parse_args()
    asked = study(given.harmonics)
    found = asked.crossings(SPEEDS, ORDERS, damper_mass=MASSES, margin=LeastMargin(STEEL), progress=True)
    print(found)
    found.save(given.folder / "speed_to_margin.h5")
    save_figure(review(asked, found), given.folder / "speed_to_margin.png")


if __name__ == "__main__":
    main()
