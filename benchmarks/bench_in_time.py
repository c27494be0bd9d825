"""Labels of ``with_stability(in_time=True)`` against long integrations of 50 points that are drawn before any of them.

Three preloads, one and three harmonics, on the shipped disk with nine contact points, unit tractions and ten blade modes.
Half of the points lie within 2 % of a peak or fold; two are those at 351.1 and 352.8 Hz on the upper branch at 2 kN with
one harmonic.  The integrations have 512 steps a period, other phases of the disturbances, and last until the mean changes
by less than 1 % from 80 periods to the next, at least 240 and at most 960 periods; the motion stays if the mean over the
last 80 (of half the periods, where the drift never ends) is within 5 % of that of the point.  Beside it stands the verdict
of ``study.motion_in_time``.
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np

import bdamper as bd
from bdamper.time_domain.integration import STEPS, all_sectors
from bdamper.time_domain.transient import CRITERIA, Transient

SEED, POINTS = 20261121, 50
BANDS = {200.0: (290.0, 345.0), 500.0: (310.0, 355.0), 2000.0: (340.0, 365.0)}
KNOWN = (351.1, 352.8)
STORED = Path(__file__).parent / "results" / "in_time.json"
WINDOW, FEWEST, MOST, DRIFT = 80, 3, 12, 0.01


def study(harmonics: int) -> bd.Study:
    return bd.Study(
        bd.reference_model("bladed_disk", 9),
        bd.Excitation("tip", direction="tangential", amplitude=1.0),
        engine_order=5,
        friction_coefficient=0.4,
        contact_stiffness="unit_traction",
        blade_modes=10,
        harmonics=harmonics,
    )


def random(curves: dict[tuple[float, int], bd.ResponseCurve]) -> list[tuple[float, int, int]]:
    """Preload, harmonics and index of each point."""
    rng = np.random.default_rng(SEED)
    out = []
    first = curves[2000.0, 1]
    for frequency in KNOWN:
        upper = np.flatnonzero(first.amplitude > 0.9 * first.amplitude.max())
        out.append((2000.0, 1, int(upper[np.abs(first.frequency[upper] - frequency).argmin()])))
    keys = list(curves)
    while len(out) < POINTS:
        key = keys[len(out) % len(keys)]
        curve = curves[key]
        marks = np.append(curve.frequency[curve.folds], curve.peak.frequency)
        distance = np.abs(curve.frequency[:, None] / marks - 1.0).min(axis=1)
        near = (len(out) // len(keys)) % 2 == 0
        place = (*key, int(rng.choice(np.flatnonzero((distance < 0.02) == near))))
        if place not in out:
            out.append(place)
    return out


def long_integration(made: bd.Study, curve: bd.ResponseCurve, i: int) -> tuple[bool, float, int]:
    """Whether the motion stays, its mean amplitude over that of the point, and the integrated periods."""
    omega, u = 2.0 * np.pi * float(curve.frequency[i]), curve.unknowns[i]
    ring = all_sectors(made.problem, curve.preload)
    transient = Transient(
        ring,
        omega,
        ring.seeded(ring.start(u, omega, 2 * STEPS), CRITERIA.seed, SEED + i),
        2 * STEPS,
    )
    ratios: list[float] = []
    while len(ratios) < MOST:
        transient.run(len(transient.harmonics) + WINDOW)
        ratios.append(float(transient.amplitude[-WINDOW:].mean() / curve.amplitude[i]))
        if len(ratios) >= FEWEST and abs(ratios[-1] - ratios[-2]) < DRIFT * ratios[-1]:
            break
    else:
        ratios.append(float(np.mean(ratios[MOST // 2 :])))
    return abs(ratios[-1] - 1.0) <= CRITERIA.tolerance, ratios[-1], WINDOW * min(len(ratios), MOST)


def main() -> None:
    studies = {h: study(h) for h in (1, 3)}
    curves = {
        (p, h): studies[h].frequency_response(p, band) for p, band in BANDS.items() for h in studies
    }
    places = random(curves)
    table, seconds = [], {}
    for (preload, h), curve in curves.items():
        watch = time.process_time()
        curve = studies[h].with_stability(curve, in_time=True)
        seconds[f"{preload:g} N, {h}"] = round(time.process_time() - watch, 1)
        print(curve.stability_note, flush=True)
        for p, n, i in places:
            if (p, n) != (preload, h):
                continue
            watch = time.process_time()
            stays, ratio, periods = long_integration(studies[h], curve, i)
            row = {
                "preload": preload, "harmonics": h, "frequency": round(float(curve.frequency[i]), 3),
                "amplitude": float(curve.amplitude[i]), "label": str(curve.labels[i]),
                "ratio": round(float(curve.in_time[i]), 4), "long": "stays" if stays else "leaves",
                "long ratio": round(ratio, 4), "periods": periods, "seconds": round(time.process_time() - watch, 1),
            }  # fmt: skip
            watch = time.process_time()
            quick = studies[h].motion_in_time(curve, i)
            row |= {"verdict": quick.verdict, "verdict periods": len(quick.period)}
            row |= {"verdict seconds": round(time.process_time() - watch, 2)}
            table.append(row)
            print(row, flush=True)
        STORED.write_text(
            json.dumps({"seed": SEED, "seconds of labels": seconds, "points": table}, indent=1)
            + "\n"
        )
    decided = [row for row in table if row["label"] in ("stable", "unstable")]
    agree = sum((row["label"] == "stable") == (row["long"] == "stays") for row in decided)
    left = len(table) - len(decided)
    same = sum(
        row["verdict"] == ("agrees" if row["long"] == "stays" else "does not agree")
        for row in table
    )
    print(f"the verdict is that of the long integration at {same} of {len(table)} points")
    print(
        f"{len(table)} points, {left} undecided, {agree} of {len(decided)} labels agree with the long integration"
    )


if __name__ == "__main__":
    main()
