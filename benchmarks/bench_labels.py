"""Labels of stability beside the motion in time of all blades: twenty scenes, five points on each response curve.

``python -m benchmarks.bench_labels [first last]`` draws each scene from its number before anything is computed: the turbine
blade (even numbers, engine order 5 or 10) or the hard disk (odd ones, engine order 5) with nine contact points, unit
tractions and three harmonics, a friction coefficient of 0.2 to 0.6 and a preload of 20 to 400 N per newton.  Five points
are drawn from those with at least half the amplitude of the peak.

The truth is an integration of all blades and all nodal diameters from the point, with waves of 1 % of each nodal diameter,
over 120 or 200 periods of 256 steps: the point is kept if all blades have its amplitude in the mean of the last 40 periods,
to 5 % (and to 10 %, which counts less of what three harmonics cut off).

``python -m benchmarks.bench_labels coupled`` asks the same of twenty test rigs under coupled friction, whose labels are
signs of det J alone: up to four points each, the peak among them, against ``study.motion_in_time`` over at most 600
periods.
"""

from __future__ import annotations

import sys
from math import tau

import numpy as np

import bdamper as bd
from bdamper.time_domain.integration import AllSectors, IntegrationFailed, all_sectors
from bdamper.time_domain.time_response import disturbed
from bdamper.time_domain.transient import CRITERIA, outside
from benchmarks import PLAIN
from tests.models import acyclic_model

SEED, POINTS = 20261123, 5
BANDS = {"turbine_blade": (600.0, 720.0), "bladed_disk": (250.0, 380.0)}


def random(number: int) -> tuple[bd.Study, str, float, np.random.Generator]:
    """Study, model and preload (N) of a number, and what draws its points."""
    rng = np.random.default_rng([SEED, number])
    name = "bladed_disk" if number % 2 else "turbine_blade"
    order = 5 if number % 2 else int(rng.choice([5, 10]))
    friction, preload = (
        float(rng.uniform(0.2, 0.6)),
        float(np.exp(rng.uniform(np.log(20.0), np.log(400.0)))),
    )
    excitation = bd.Excitation("tip") if number % 2 else bd.Excitation("tip", "tangential", 1.0)
    given = PLAIN | {"harmonics": 3, "friction_coefficient": friction}
    made = bd.Study(bd.reference_model(name, 9), excitation, order, **given)
    return made, name, preload, rng


def truth(
    ring: AllSectors, u: np.ndarray, omega: float, expected: float
) -> tuple[float, float, int]:
    """Lowest and highest mean of the blades over the point's amplitude, and periods; NaN if an integration fails."""
    transient = disturbed(ring, u, omega)
    try:
        for periods in (120, 200):
            transient.run(periods)
            before, last = (
                np.abs(x).mean(axis=0) / expected
                for x in (transient.blades[-80:-40], transient.blades[-40:])
            )
            if (
                np.abs(last - before).max() < 0.01
                and outside(transient, CRITERIA.window)[0] < CRITERIA.rise
            ):
                break
    except IntegrationFailed:
        return np.nan, np.nan, 0
    return float(last.min()), float(last.max()), periods


def main(first: int = 0, last: int = 20) -> None:
    right, of = {0.05: 0, 0.1: 0}, 0
    for number in range(first, last):
        made, name, preload, rng = random(number)
        curve, ring = (
            made.frequency_response(preload, BANDS[name], stability=True),
            all_sectors(made.problem, preload),
        )
        near_peak = np.flatnonzero(curve.amplitude > 0.5 * curve.amplitude.max())
        for i in np.sort(rng.choice(near_peak, POINTS, replace=False)):
            low, high, periods = truth(
                ring, curve.unknowns[i], tau * curve.frequency[i], float(curve.amplitude[i])
            )
            print(
                f"{number} {name} {curve.frequency[i]:.2f} Hz {curve.labels[i]}, blades {low:.3f} to {high:.3f} of the "
                f"point after {periods} periods",
                flush=True,
            )
            of += periods > 0
            for share in right:
                right[share] += (max(abs(low - 1.0), abs(high - 1.0)) <= share) != curve.unstable[i]
    for share, n in right.items():
        print(f"sign of det J: right at {n} of {of} points, kept to {share:.0%}")


def coupled(scenes: int = 20) -> None:
    """Test rigs with a wedge under coupled friction, one, three or five harmonics, in gross slip or little of it."""
    rng, said = np.random.default_rng(20261125), {}
    for scene in range(scenes):
        preload, friction = 10.0 ** rng.uniform(0.7, 2.7), rng.uniform(0.15, 0.6)
        force, stiffness = 10.0 ** rng.uniform(1.0, 2.3), 10.0 ** rng.uniform(5.5, 6.8)
        law = {
            "harmonics": int(rng.choice([1, 3, 5])),
            "variable_normal_load": bool(rng.random() < 0.75),
        }
        places = rng.random(3)
        contact = {
            "contact_stiffness": stiffness,
            "friction_coefficient": friction,
            "friction_law": "coupled",
        }
        given = PLAIN | law | contact | {"contact_forces": bd.AFT(128), "damping_ratio": 0.01}
        rig = acyclic_model(1, n_points=4, n_blade_modes=2)
        made = bd.Study(rig, bd.Excitation("tip", "tangential", force), 0, **given)
        curve = made.with_stability(made.frequency_response(preload, (150.0, 500.0)))
        high = np.flatnonzero(curve.amplitude >= 0.3 * curve.amplitude.max())
        for i in sorted({curve.peak_index, *high[(places * len(high)).astype(int)]}):
            key = (
                curve.labels[i].partition(" with")[0],
                made.motion_in_time(curve, int(i), periods=600).verdict,
            )
            said[key] = said.get(key, 0) + 1
            print(
                f"{scene} {law} {preload:.3g} N, {curve.frequency[i]:.2f} Hz: {', in time '.join(key)}",
                flush=True,
            )
    print(said)


if __name__ == "__main__":
    coupled() if sys.argv[1:] == ["coupled"] else main(*map(int, sys.argv[1:]))
