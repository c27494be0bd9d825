"""What each effect costs and what it changes: the reference bladed disk with one effect off at a time."""

from __future__ import annotations

import time
from dataclasses import replace

import bdamper as bd

EVERYTHING = bd.Effects(harmonics=5, damper_modes=2)
OFF = {
    "none: everything on": EVERYTHING,
    "further harmonics": replace(EVERYTHING, harmonics=1),
    "even harmonics": replace(EVERYTHING, harmonics=(1, 3, 5)),
    "bias": replace(EVERYTHING, bias=False),
    "separation": replace(EVERYTHING, separation=False),
    "variable normal load": replace(EVERYTHING, variable_normal_load=False),
    "the same, and even harmonics, bias": replace(
        EVERYTHING, variable_normal_load=False, harmonics=(1, 3, 5), bias=False
    ),
    "rotation X": replace(EVERYTHING, rotation=("Y", "Z")),
    "rotation Y": replace(EVERYTHING, rotation=("X", "Z")),
    "rotation Z": replace(EVERYTHING, rotation=("X", "Y")),
    "all rotation": replace(EVERYTHING, rotation=()),
    "translation X": replace(EVERYTHING, translation=("Y", "Z")),
    "translation Z": replace(EVERYTHING, translation=("X", "Y")),
    "elastic damper modes": replace(EVERYTHING, damper_modes=0),
    "harmonic nodal diameters": replace(EVERYTHING, harmonic_nodal_diameters=False),
    "constraint planes": replace(EVERYTHING, constraints=False),
    "contact points beyond 9": replace(EVERYTHING, contact_points=9),
    "blade modes beyond 5": replace(EVERYTHING, blade_modes=5),
}
SCENES = (
    ("mode 1", bd.Excitation("tip"), (250.0, 400.0), (500.0, 2000.0)),
    ("mode 2", bd.Excitation("tip", "axial"), (560.0, 760.0), (500.0,)),
)


def main() -> None:
    """Print a table for each mode and preload."""
    model = bd.reference_model("bladed_disk", 24)
    print("## Effects: the reference bladed disk, 24 points a face, engine order 5, one effect off at a time\n")
    for name, excitation, interval, preloads in SCENES:
        for preload in preloads:
            print(f"### {name}, {preload:g} N\n")
            print("| off | unknowns | contact elements | evaluations | time | peak amplitude | peak frequency |")
            print("|---|---|---|---|---|---|---|")
            whole = None
            for off, effects in OFF.items():
                study = bd.Study(model, excitation, engine_order=5, friction_coefficient=0.4, effects=effects)
                system = study.system(preload)
                begin = time.process_time()
                curve = study.track(preload, interval)
                seconds = time.process_time() - begin
                peak = curve.peak
                if whole is None:
                    whole = (seconds, peak.amplitude, peak.frequency)
                    result = f"{seconds:.3f} s | {peak.amplitude:.4g} m | {peak.frequency:.2f} Hz"
                else:
                    result = (
                        f"x {seconds / whole[0]:.2f} | {100 * (peak.amplitude / whole[1] - 1):+.1f} % | "
                        f"{100 * (peak.frequency / whole[2] - 1):+.2f} %"
                    )
                note = "" if curve.complete else f" ({curve.status})"
                print(f"| {off}{note} | {system.n_unknowns} | {system.n_points} | {curve.cost.evaluations} | {result} |")
            print()


if __name__ == "__main__":
    main()
