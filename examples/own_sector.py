"""From the decks of your own sector to optimum, margin, crossing and mistuned bladed disk.

python examples/own_sector.py FOLDER        sector.inp and damper.inp in it, and what CalculiX stored of their matrices
"""

import sys
from pathlib import Path

import bdamper as bd
from bdamper.fatigue.criteria import Material
from bdamper.harmonic_balance.rotor_speed import RPM
from bdamper.importers import ContactFaces, Placement, Reduction, Sector, build_model
from bdamper.importers.abaqus import read_calculix
from bdamper.mistuning import Mistuning

STEEL = Material(
    300e6, 900e6, 800e6, name="a steel", source="round figures; take those of your part"
)


def main(folder: Path) -> tuple[bd.Study, bd.BladedDisk, float]:
    """Return the study, the bladed disk, and the preload (N) with the lowest amplitude."""
    built = build_model(
        read_calculix(folder / "sector"), read_calculix(folder / "damper"),
        sector=Sector(36, ("LOW", "HIGH"), blade_nodes="BLADE", stress="FILLET"),
        placement=Placement("mm-t-s", axis=(1, 0, 0)), reduction=Reduction(engine_order=4, n_modes=20),
        contacts=[ContactFaces("left", "LEFT", "RIGHT_UNDERSIDE", points=(3, 4)),
                  ContactFaces("right", "RIGHT", "LEFT_UNDERSIDE", points=(3, 4))],
        locations={"tip": (0.0, 346.6, 0.0)},
    )  # fmt: skip
    print(built)
    study = bd.Study(
        built.model, bd.Excitation("tip"), engine_order=4, friction_coefficient=0.3, harmonics=1
    )
    best = study.optimal_curve((150.0, 300.0), 5, check=False).optimum
    print(best, study.margin(study.peak(best.preload), STEEL, speed=400.0), sep="\n")
    crossings = study.resonance_crossings((1350.0, 1650.0), [4])
    print(crossings, f"at {RPM * crossings.array('speed').item():.0f} rpm", sep="\n")
    wheel = bd.BladedDisk(study, mistuning=Mistuning.random(36, 0.02, seed=1))
    return study, wheel, best.preload


if __name__ == "__main__":
    _, wheel, preload = main(Path(sys.argv[1]))
    print(wheel.peak(preload))
