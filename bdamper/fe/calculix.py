"""Input for CalculiX, an independent finite element program.

The same nodes and elements (C3D20, whose local order of nodes differs), clamped nodes, and the two sector
faces tied by cyclic symmetry.  A frequency does not depend on the direction in which the wave is counted, so
it can be compared without any convention.  CalculiX lists each frequency of a cyclic model twice, for the
real and the imaginary part.
"""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from skfem import ElementHexS2

from bdamper.fe.assemble import Discretisation

# C3D20: bottom corners, top corners, bottom middles, top middles, upright middles, on the cube [-1, 1]^3.
_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
_MIDDLES = np.array([[0, -1], [1, 0], [0, 1], [-1, 0]], float)
_C3D20 = np.concatenate(
    [
        np.column_stack([xy, np.full(4, z)])
        for xy, z in ((_CORNERS, -1), (_CORNERS, 1), (_MIDDLES, -1), (_MIDDLES, 1))
    ]
    + [np.column_stack([_CORNERS, np.zeros(4)])]
)


def local_order() -> NDArray:
    """For each of CalculiX's 20 local nodes the number of the same node in scikit-fem."""
    ours = 2.0 * ElementHexS2().doflocs - 1.0
    distance = np.abs(_C3D20[:, None] - ours[None]).max(axis=2)
    return distance.argmin(axis=1)


def _numbers(nodes: NDArray) -> str:
    """Numbers from one on, sixteen to a line."""
    text = [str(n + 1) for n in nodes]
    return "\n".join(", ".join(text[i : i + 16]) for i in range(0, len(text), 16))


def _model(body: Discretisation) -> str:
    elements = body.elements[:, local_order()] + 1
    # The map from scikit-fem's cube may be a reflection, which CalculiX refuses; then turn the elements over.
    corner = body.nodes[elements[0, :8] - 1]
    if np.linalg.det([corner[1] - corner[0], corner[3] - corner[0], corner[4] - corner[0]]) < 0.0:
        elements = elements[:, [4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8, 9, 10, 11, 16, 17, 18, 19]]
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{k + 1}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in enumerate(body.nodes)]
    lines.append("*ELEMENT, TYPE=C3D20, ELSET=BODY")
    for k, e in enumerate(elements.tolist()):
        lines += [f"{k + 1}, " + ", ".join(map(str, e[:12])) + ",", ", ".join(map(str, e[12:]))]
    m = body.material
    lines += [
        "*MATERIAL, NAME=STEEL",
        "*ELASTIC",
        f"{m.youngs_modulus:.12e}, {m.poisson_ratio:.12e}",
        "*DENSITY",
        f"{m.density:.12e}",
        "*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL",
    ]
    return "\n".join(lines)


def sector_input(
    body: Discretisation,
    left: NDArray,
    right: NDArray,
    clamped: NDArray,
    n_sectors: int,
    nodal_diameter: int,
    n_modes: int,
    omega: float = 0.0,
) -> str:
    """Input file for ``n_modes`` different frequencies of one nodal diameter, each of which comes twice.

    With a rotor speed ``omega`` (rad/s) they are those under the stress of a static step with the centrifugal load, which
    brings stress stiffening and spin softening, as a perturbation step does in CalculiX.
    """
    # A degree of freedom of a clamped node must not be tied as well.
    left, right = np.setdiff1d(left, clamped), np.setdiff1d(right, clamped)
    return "\n".join(
        [
            _model(body),
            "*NSET, NSET=CLAMPED",
            _numbers(clamped),
            "*NSET, NSET=LEFT",
            _numbers(left),
            "*NSET, NSET=RIGHT",
            _numbers(right),
            "*BOUNDARY",
            "CLAMPED, 1, 3",
            "*SURFACE, NAME=SLEFT, TYPE=NODE",
            "LEFT,",
            "*SURFACE, NAME=SRIGHT, TYPE=NODE",
            "RIGHT,",
            "*TIE, NAME=CYCLE, CYCLIC SYMMETRY, POSITION TOLERANCE=1e-6",
            "SLEFT, SRIGHT",
            f"*CYCLIC SYMMETRY MODEL, N={n_sectors}, NGRAPH=1, TIE=CYCLE",
            "0., 0., 0., 0., 0., 1.",
            *_steps(omega),
            "*FREQUENCY",
            f"{2 * n_modes},",
            f"*SELECT CYCLIC SYMMETRY MODES, NMIN={nodal_diameter}, NMAX={nodal_diameter}",
            "*NODE FILE",
            "U",
            "*END STEP",
            "",
        ]
    )


def _steps(omega: float) -> list[str]:
    """Head of the frequency step, with the static step of a rotor speed before it."""
    if omega == 0.0:
        return ["*STEP"]
    return [
        "*STEP", "*STATIC", "*DLOAD", f"BODY, CENTRIF, {omega**2:.12e}, 0., 0., 0., 0., 0., 1.", "*END STEP",
        "*STEP, PERTURBATION",
    ]  # fmt: skip


def matrix_input(
    body: Discretisation, sets: Mapping[str, NDArray], clamped: str | None = None, omega: float = 0.0
) -> str:
    """Input file that makes CalculiX write its stiffness and mass matrix (``.sti``, ``.mas`` and ``.dof``).

    Parameters
    ----------
    body : Discretisation
    sets : mapping of name to (n,) int
        Node sets, for the user of the matrices.
    clamped : str, optional
        The set that is held; its nodes have no rows in the matrices.
    omega : float, rad/s
        Rotor speed of the stiffness, for a whole structure: without the ties of a sector the static step before it is not
        that of a disk.
    """
    lines = [_model(body)]
    for name, nodes in sets.items():
        lines += [f"*NSET, NSET={name}", _numbers(nodes)]
    if clamped is not None:
        lines += ["*BOUNDARY", f"{clamped}, 1, 3"]
    return "\n".join([*lines, *_steps(omega), "*FREQUENCY, SOLVER=MATRIXSTORAGE", "6,", "*END STEP", ""])


def run_job(text: str, folder: Path, job: str) -> str:
    """Write ``job.inp`` in ``folder``, run CalculiX on it and return what it printed.

    Raises
    ------
    RuntimeError
        If it fails; the message ends with its last lines of output.
    """
    (folder / f"{job}.inp").write_text(text)
    done = subprocess.run(["ccx", "-i", job], cwd=folder, capture_output=True, text=True, timeout=600.0, check=False)
    if done.returncode:
        raise RuntimeError(f"CalculiX failed on {job}.inp:\n{done.stdout[-1500:]}")
    return done.stdout
