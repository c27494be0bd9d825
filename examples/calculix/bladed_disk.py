"""A bladed disk with wedge dampers, from CalculiX to a response curve.

Three decks are written: the sector with its free faces and the damper, whose matrices CalculiX
stores (``*FREQUENCY, SOLVER=MATRIXSTORAGE``), and the sector with cyclic symmetry, whose modes of
nodal diameter 5 serve as a check.  A model is built from their results and saved with its report,
and its response curve is computed.

    python examples/calculix/bladed_disk.py [folder]

This requires the program ``ccx`` and the extra ``bdamper[fe]``, which generates the meshes and is not
needed for your own decks.
"""

from __future__ import annotations

import sys
from pathlib import Path

import decks

from bdamper import Excitation, Study
from bdamper.fem import MeshDensity, SectorFE
from bdamper.fem.generated_models import end_patches
from bdamper.importers import BuiltModel, ContactFaces, Reduction, Sector, build_model
from bdamper.importers.abaqus import read_calculix
from bdamper.response.response_curve_result import ResponseCurve

ENGINE_ORDER = 5


def write_and_run(folder: Path, fe: SectorFE) -> None:
    """Write the decks and run CalculiX on each of them."""
    blade, damper = decks.blade_sets(fe), decks.damper_sets(fe)
    decks.run_job(decks.matrix_input(fe.blade, blade, clamped="BORE"), folder, "sector")
    decks.run_job(decks.matrix_input(fe.damper.body, damper), folder, "damper")
    cyclic = decks.sector_input(fe, ENGINE_ORDER, 5)
    decks.run_job(cyclic, folder, "sector_cyclic")


def import_model(folder: Path, fe: SectorFE, points: int = 9, n_modes: int = 20) -> BuiltModel:
    """Return the model with the same contact points as the reference model."""
    g = fe.geometry
    tip = [g.camber / 3.0, g.ridge_radius + g.platform_edge_thickness + g.airfoil_height, 0.0]
    return build_model(
        read_calculix(folder / "sector", modes=folder / "sector_cyclic.frd"),
        read_calculix(folder / "damper"),
        sector=Sector(g.n_blades, ("LOW", "HIGH")),
        reduction=Reduction(engine_order=ENGINE_ORDER, harmonics=3, n_modes=n_modes),
        contacts=[
            ContactFaces("left", "LEFT", "RIGHT_UNDERSIDE", points=points),
            ContactFaces("right", "RIGHT", "LEFT_UNDERSIDE", points=points),
            *(
                ContactFaces(
                    name,
                    name.upper(),
                    body_b="ground",
                    kind="constraint",
                    gap=g.end_gap,
                    patches=end_patches(g, name),
                )
                for name in ("front", "back")
            ),
        ],
        locations={"tip": tip},
    )


def tracking_curve(built: BuiltModel) -> ResponseCurve:
    """Compute the response of the first bending mode under 1 N at the tip and 200 N on the damper."""
    study = Study(
        built.model,
        Excitation("tip", amplitude=1.0),
        engine_order=ENGINE_ORDER,
        friction_coefficient=0.3,
        contact_stiffness="unit_traction",
        blade_modes=10,
        harmonics=1,
    )
    return study.frequency_response(preload=200.0, frequency=(250.0, 400.0))


def main(folder: Path) -> tuple[BuiltModel, ResponseCurve]:
    """Run all steps in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    fe = SectorFE(density=MeshDensity.preset("coarse"))
    write_and_run(folder, fe)
    built = import_model(folder, fe)
    built.save(folder / "bladed_disk.h5")
    curve = tracking_curve(built)
    print(built)
    print(curve)
    return built, curve


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("calculix_run"))
