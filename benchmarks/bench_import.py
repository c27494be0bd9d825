"""Import of one sector from its matrices, with stress and disk: seconds and peak memory.

Each mesh has a process of its own, whose peak memory is that of its import.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time

import numpy as np

from bdamper.fem.generated_models import SectorFE
from bdamper.fem.meshes import MeshDensity
from tests.fe_bodies import FIRST_NUMBER, blade_and_damper, contacts
from tests.imports import build

DENSITIES = {
    "small": MeshDensity(2, 2, 1, 4, 2, 2, 1, 6, 3, 1, 2, 6),
    "medium": MeshDensity(2, 2, 1, 8, 4, 4, 2, 13, 3, 1, 2, 6),
}
"""Meshes of 3,700 and 12,100 equations."""


def peak_memory() -> float:
    """Return the peak memory (MB) of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def import_sector(mesh: str) -> dict[str, object]:
    """Import the sector of a mesh.

    The result has the size of the sector, seconds, peak memory (MB), and the frequencies (Hz) of
    each nodal diameter, to compare versions.
    """
    fe = SectorFE(density=DENSITIES[mesh])
    blade, damper = blade_and_damper(fe)
    highest = int(fe.blade.nodes[:, 1].argmax())
    wall = time.perf_counter()
    processor = time.process_time()
    model = build(
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
        stress={"blade": FIRST_NUMBER + fe.blade_part().nodes},
        blade_nodes="BLADE",
        locations={"tip": highest + FIRST_NUMBER},
    ).model
    wall = time.perf_counter() - wall
    processor = time.process_time() - processor

    n_free_nodes = len(fe.blade.nodes) - len(fe.faces.dependent) - len(fe.clamped)
    bases = model.bodies["blade"].bases
    frequencies = {d: np.sqrt(basis.omega2) / (2.0 * np.pi) for d, basis in bases.items()}
    return {
        "mesh": mesh,
        "equations": 3 * n_free_nodes,
        "wall": wall,
        "processor": processor,
        "memory": peak_memory(),
        "frequencies": {d: hertz.tolist() for d, hertz in frequencies.items()},
    }


def measured(mesh: str) -> dict[str, object]:
    """Import the sector of a mesh in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.bench_import", mesh]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)


def main() -> None:
    """Print a table of the meshes."""
    print("mesh     equations   wall (s)   processor (s)   peak memory (MB)")
    for mesh in DENSITIES:
        row = measured(mesh)
        print(
            f"{mesh:<8} {row['equations']:>9,} {row['wall']:>10.1f} "
            f"{row['processor']:>15.1f} {row['memory']:>18,.0f}",
            flush=True,
        )


if __name__ == "__main__":
    # progress of the import goes to the error stream
    print(json.dumps(import_sector(sys.argv[1])))
