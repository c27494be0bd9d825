"""Decks of the meshes of bdamper.fem for CalculiX, an independent finite element program.

The decks contain the same nodes, elements (C3D20, with a different local node order) and clamped
nodes, and the two sector faces tied by cyclic symmetry. Frequencies do not depend on the direction
of the travelling wave, so they can be compared without any convention.  CalculiX lists each
frequency of a cyclic model twice, for the real and the imaginary part.
"""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bdamper.fem.generated_models import SectorFE
from bdamper.fem.meshes import Discretisation, Geometry, local_order, turn


def numbers_of(nodes: NDArray) -> str:
    """Return numbers counted from one, sixteen on each line."""
    text = [str(n + 1) for n in nodes]
    return "\n".join(", ".join(text[i : i + 16]) for i in range(0, len(text), 16))


def deck_of(body: Discretisation) -> str:
    """Return the nodes, elements and material of a body as text."""
    elements = body.elements[:, local_order()] + 1
    # The map from scikit-fem's cube may be a reflection, which CalculiX refuses; then turn the elements over.
    corner = body.nodes[elements[0, :8] - 1]
    if np.linalg.det([corner[1] - corner[0], corner[3] - corner[0], corner[4] - corner[0]]) < 0.0:
        elements = elements[
            :, [4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8, 9, 10, 11, 16, 17, 18, 19]
        ]
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
    fe: SectorFE,
    nodal_diameter: int,
    n_modes: int,
    omega: float = 0.0,
) -> str:
    """Return the input file for ``n_modes`` different frequencies of one nodal diameter, each of
    which occurs twice.

    If a rotor speed ``omega`` (rad/s) is given, a static step with the centrifugal load precedes
    the frequency step, which is then a perturbation step with stress stiffening and spin softening.
    """
    # A degree of freedom of a clamped node must not be tied as well.
    left, right = (
        np.setdiff1d(nodes, fe.clamped) for nodes in (fe.faces.independent, fe.faces.dependent)
    )
    return "\n".join(
        [
            deck_of(fe.blade),
            "*NSET, NSET=CLAMPED",
            numbers_of(fe.clamped),
            "*NSET, NSET=LEFT",
            numbers_of(left),
            "*NSET, NSET=RIGHT",
            numbers_of(right),
            "*BOUNDARY",
            "CLAMPED, 1, 3",
            "*SURFACE, NAME=SLEFT, TYPE=NODE",
            "LEFT,",
            "*SURFACE, NAME=SRIGHT, TYPE=NODE",
            "RIGHT,",
            "*TIE, NAME=CYCLE, CYCLIC SYMMETRY, POSITION TOLERANCE=1e-6",
            "SLEFT, SRIGHT",
            f"*CYCLIC SYMMETRY MODEL, N={fe.geometry.n_blades}, NGRAPH=1, TIE=CYCLE",
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
    body: Discretisation, sets: Mapping[str, NDArray], clamped: str | None = None
) -> str:
    """Return the input file with which CalculiX writes its stiffness and mass matrices (``.sti``,
    ``.mas`` and ``.dof``).

    Parameters
    ----------
    body : Discretisation
    sets : mapping of name to (n,) int
        Node sets that are written to the file.
    clamped : str, optional
        Set of fixed nodes, which have no rows in the matrices.
    """
    lines = [deck_of(body)]
    for name, nodes in sets.items():
        lines += [f"*NSET, NSET={name}", numbers_of(nodes)]
    if clamped is not None:
        lines += ["*BOUNDARY", f"{clamped}, 1, 3"]
    return "\n".join([*lines, "*STEP", "*FREQUENCY, SOLVER=MATRIXSTORAGE", "6,", "*END STEP", ""])


def _on_face_plane(nodes: NDArray, g: Geometry, side: str) -> NDArray:
    """Nodes (n,), given in the axes of blade 0, in the plane of the damper's left or right face."""
    own = nodes @ turn(-0.5 * g.pitch).T
    sign = 1.0 if side == "right" else -1.0
    normal = np.array([sign * np.cos(g.face_angle), np.sin(g.face_angle)])
    ridge = np.array([sign * 0.5 * g.ridge_width, g.ridge_radius])
    return np.flatnonzero(np.abs((own[:, :2] - ridge) @ normal) < 1e-9)


def blade_sets(fe: SectorFE) -> dict[str, NDArray]:
    """Return the node sets of the sector: BORE (clamped), LOW and HIGH (sector faces toward -X and
    +X), and the two platform undersides. RIGHT_UNDERSIDE touches the damper of this sector, and
    LEFT_UNDERSIDE the damper of the previous sector.
    """
    ahead = fe.blade.nodes @ turn(fe.geometry.pitch).T
    return {
        "BORE": fe.clamped,
        "LOW": fe.faces.independent,
        "HIGH": fe.faces.dependent,
        "RIGHT_UNDERSIDE": _on_face_plane(fe.blade.nodes, fe.geometry, "left"),
        "LEFT_UNDERSIDE": _on_face_plane(ahead, fe.geometry, "right"),
    }


def damper_sets(fe: SectorFE) -> dict[str, NDArray]:
    """Return the node sets of the damper: its contact faces LEFT and RIGHT, and its end faces FRONT
    (+Z) and BACK.
    """
    nodes, half = fe.damper.body.nodes, 0.5 * fe.geometry.face_width
    return {
        "LEFT": _on_face_plane(nodes, fe.geometry, "left"),
        "RIGHT": _on_face_plane(nodes, fe.geometry, "right"),
        "FRONT": np.flatnonzero(nodes[:, 2] > half - 1e-9),
        "BACK": np.flatnonzero(nodes[:, 2] < -half + 1e-9),
    }


def run_job(text: str, folder: Path, job: str) -> str:
    """Write ``job.inp`` in ``folder``, run CalculiX on it and return what it printed.

    Raises
    ------
    RuntimeError
        If CalculiX fails; the message ends with the last lines of its output.
    """
    (folder / f"{job}.inp").write_text(text)
    done = subprocess.run(
        ["ccx", "-i", job], cwd=folder, capture_output=True, text=True, timeout=600.0, check=False
    )
    if done.returncode:
        raise RuntimeError(f"CalculiX failed on {job}.inp:\n{done.stdout[-1500:]}")
    return done.stdout
