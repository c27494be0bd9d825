"""Import of one sector from its matrices, with stress and disk: time and peak memory.

``python -m benchmarks.bench_import`` imports all meshes but "large".  ``python -m
benchmarks.bench_import large`` takes minutes and several GB.  It imports the sector with SuperLU, and
again with PARDISO if pypardiso (extra ``bdamper[large]``) is installed; ``--solver`` chooses one of
them.  Each import has a process of its own, one thread, and the peak memory of that process.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
import time
from collections.abc import Callable

import numpy as np

from bdamper.fem import factorisation
from bdamper.fem.generated_models import SectorFE
from bdamper.fem.meshes import MeshDensity
from bdamper.model.structure import Model
from benchmarks.measuring import in_own_process, peak_memory
from tests.fe_bodies import FIRST_NUMBER, blade_and_damper, contacts
from tests.imports import build

DENSITIES = {
    "smallest": MeshDensity(2, 1, 1, 2, 1, 1, 1, 3, 2, 1, 1, 4),
    "small": MeshDensity(2, 2, 1, 4, 2, 2, 1, 6, 3, 1, 2, 6),
    "middle": MeshDensity(2, 2, 1, 6, 3, 3, 2, 9, 3, 1, 2, 6),
    "medium": MeshDensity(2, 2, 1, 8, 4, 4, 2, 13, 3, 1, 2, 6),
    "large": MeshDensity(4, 5, 3, 16, 9, 10, 4, 30, 3, 1, 2, 6),
}
"""Meshes of 1,320, 3,744, 7,686, 12,120 and 101,160 equations."""
QUICK = tuple(mesh for mesh in DENSITIES if mesh != "large")
SOLVERS = ("superlu", "pardiso")


def count_equations(fe: SectorFE) -> int:
    """Return the number of equations of a sector without clamped nodes and without the second face."""
    removed = np.union1d(fe.faces.dependent, fe.clamped)
    return 3 * (len(fe.blade.nodes) - len(removed))


def import_sector(fe: SectorFE) -> Callable[[], Model]:
    """Return the import of a sector as a function; its matrices and sets exist before."""
    blade, damper = blade_and_damper(fe)
    highest = int(fe.blade.nodes[:, 1].argmax())
    stress_nodes = FIRST_NUMBER + fe.blade_part().nodes

    def run() -> Model:
        return build(
            blade,
            damper,
            n_blades=65,
            faces=("LOW", "HIGH"),
            fixed="BORE",
            check_units=False,
            n_modes=40,
            n_damper_modes=8,
            engine_order=5,
            harmonics=3,
            contacts=contacts(9),
            elasticity=(2.1e11, 0.3),
            stress={"blade": stress_nodes},
            blade_nodes="BLADE",
            locations={"tip": highest + FIRST_NUMBER},
        ).model

    return run


def measure(mesh: str, solver: str) -> dict[str, object]:
    """Import the sector of a mesh in this process.

    The result has the size of the sector, seconds, peak memory (MB), and the frequencies (Hz) of
    each nodal diameter, to compare versions.
    """
    if solver == "superlu":
        # no mesh is large enough for PARDISO
        factorisation.LARGE = sys.maxsize
    fe = SectorFE(density=DENSITIES[mesh])
    run = import_sector(fe)
    wall = time.perf_counter()
    processor = time.process_time()
    model = run()
    wall = time.perf_counter() - wall
    processor = time.process_time() - processor

    bases = model.bodies["blade"].bases
    frequencies = {d: np.sqrt(basis.omega2) / (2.0 * np.pi) for d, basis in bases.items()}
    return {
        "mesh": mesh,
        "solver": solver,
        "equations": count_equations(fe),
        "wall": wall,
        "processor": processor,
        "memory": peak_memory(),
        "frequencies": {d: hertz.tolist() for d, hertz in frequencies.items()},
    }


def solvers(mesh: str, requested: str | None) -> tuple[str, ...]:
    """Return the solvers of a mesh, or the requested one: below 30,000 equations only SuperLU."""
    has_pardiso = importlib.util.find_spec("pypardiso") is not None
    if requested == "pardiso" and not has_pardiso:
        sys.exit("PARDISO needs the extra bdamper[large]")
    if requested == "pardiso" and mesh != "large":
        sys.exit("only the mesh 'large' has enough equations for PARDISO")
    if requested:
        return (requested,)
    return SOLVERS if has_pardiso and mesh == "large" else SOLVERS[:1]


def main() -> None:
    """Print a table of the meshes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_import", description=__doc__)
    parser.add_argument("mesh", nargs="?", choices=DENSITIES, help="by default all but 'large'")
    parser.add_argument("--solver", choices=SOLVERS, help="by default all that apply")
    parser.add_argument("--json", action="store_true", help="import in this process, print JSON")
    given = parser.parse_args()
    if given.json:
        print(json.dumps(measure(given.mesh, given.solver)))
        return
    print("mesh      solver    equations   wall (s)   processor (s)   peak memory (MB)")
    for mesh in [given.mesh] if given.mesh else QUICK:
        for solver in solvers(mesh, given.solver):
            arguments = (mesh, "--solver", solver, "--json")
            row = in_own_process("benchmarks.bench_import", *arguments)
            print(
                f"{mesh:<9} {solver:<8} {row['equations']:>10,} {row['wall']:>10.1f} "
                f"{row['processor']:>15.1f} {row['memory']:>18,.0f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
