"""Crossings against rotor speed: three masses of the damper by eight engine orders, with nine and with 24 contact points.

Eight orders of the first mode of the shipped disk, whose excitation is a fixed share of the preload, three harmonics.
Processor time of one process; the crossings are independent, so that two cores take half of it.
"""

from __future__ import annotations

import time

import bdamper as bd
from bdamper.model.kinematics import centrifugal_load
from bdamper.model.structure import Model

ORDERS = tuple(range(3, 11))
MASSES = (0.7, 1.0, 1.4)
SPEEDS = (170.0, 1020.0)
SHARE = 400.0
"""Preload of the damper of nominal mass over the excitation."""


def over_speed(points: int) -> Model:
    """The shipped disk if it has speed-dependent bases at all nodal diameters that are needed; otherwise made coarsely."""
    shipped = bd.reference_model("bladed_disk", points)
    waves = {order * l % shipped.n_blades for order in ORDERS for l in (1, 2, 3)}
    diameters = {min(d, shipped.n_blades - d) for d in waves}
    if diameters <= shipped.bodies["blade"].bases.keys() and not shipped.neglected_over_speed():
        return shipped
    from bdamper.fem.generated_models import bladed_disk

    return bladed_disk(
        points, "coarse", n_modes=20, nodal_diameters=tuple(sorted(diameters)), rotation=SPEEDS[-1]
    )


def table(points: int, masses: tuple[float, ...] = MASSES) -> None:
    """Print the table of crossings and its processor time."""
    model = over_speed(points)
    arm = centrifugal_load(model)
    study = bd.Study(model, bd.Excitation("tip"), 5, friction_coefficient=0.3)

    def excitation(omega: float, engine_order: int) -> float:
        return arm * omega**2 / SHARE

    start = time.process_time()
    found = study.resonance_crossings(
        SPEEDS, ORDERS, damper_mass_factor=masses, excitation=excitation
    )
    spent = time.process_time() - start
    print(
        f"{points} points: {len(found)} crossings, {spent:.1f} s of the processor, half of it on two cores\n\n{found}\n"
    )


def main() -> None:
    """Both models, the larger one with the nominal mass alone."""
    table(9)
    table(24, (1.0,))
