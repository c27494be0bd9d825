"""Runs of CalculiX on bodies without symmetry, and the frequencies that it lists."""

import re

import numpy as np
from scipy.sparse.linalg import splu

from bdamper.importers.abaqus import read_frd_stress
from examples.calculix.decks import deck_of, numbers_of, run_job


def free_input(body, n_modes):
    """Input file for a free body; ``n_modes`` counts the six rigid ones."""
    return "\n".join([deck_of(body), "*STEP", "*FREQUENCY", f"{n_modes},", "*END STEP", ""])


def clamped_input(body, clamped, n_modes):
    """Input file for a body that is held at some of its nodes (n,), without symmetry."""
    held = ["*NSET, NSET=CLAMPED", numbers_of(clamped), "*BOUNDARY", "CLAMPED, 1, 3"]
    return "\n".join([deck_of(body), *held, "*STEP", "*FREQUENCY", f"{n_modes},", "*END STEP", ""])


def read_frequencies(path):
    """Frequencies, Hz, from the eigenvalue table of a ``.dat`` file; squares below zero count as zero."""
    values = []
    for line in path.read_text().splitlines():
        # Mode, eigenvalue, then rad/s and cycles/s; with a nodal diameter the row starts with one more
        # integer.
        match = re.match(r"\s*(?:\d+\s+)?\d+((?:\s+[-+]?\d\.\d+E[-+]\d+){4})\s*$", line)
        if match:
            values.append(float(match.group(1).split()[0]))
        elif values and "P A R T I C I P A T I O N" in line:
            break
    return np.sqrt(np.maximum(values, 0.0)) / (2.0 * np.pi)


def run(text, folder):
    """Run CalculiX on an input text in ``folder`` and return the frequencies, Hz, in its order.

    Raises
    ------
    RuntimeError
        If it fails or lists no frequency; the message ends with its last lines of output.
    """
    output = run_job(text, folder, "job")
    frequencies = (
        read_frequencies(folder / "job.dat") if (folder / "job.dat").exists() else np.empty(0)
    )
    if not len(frequencies):
        raise RuntimeError(f"CalculiX gave no frequencies:\n{output[-1500:]}")
    return frequencies


def centrifugal_stress(fe, rows, nodes, folder, speed=300.0):
    """(n, 6) nodal stress (Pa) of rows (6 n, dofs) at nodes (n,) and of CalculiX, under rotation (rad/s).

    The sector is held at the bore; its cut faces are free.
    """
    held = ["*NSET, NSET=CLAMPED", numbers_of(fe.clamped), "*BOUNDARY", "CLAMPED, 1, 3"]
    load = ["*STEP", "*STATIC", "*DLOAD", f"BODY, CENTRIF, {speed**2:.12e}, 0., 0., 0., 0., 0., 1."]
    run_job(
        "\n".join(
            [deck_of(fe.blade), *held, *load, "*NODE FILE", "U", "*EL FILE", "S", "*END STEP", ""]
        ),
        folder,
        "job",
    )
    numbers, theirs = read_frd_stress(folder / "job.frd")[0]
    body = fe.blade
    free = np.setdiff1d(np.arange(body.n_dof), body.dofs(fe.clamped))
    force = body.body_force(speed**2 * body.nodes * [1.0, 1.0, 0.0]).ravel()
    u = np.zeros(body.n_dof)
    u[free] = splu(body.stiffness[np.ix_(free, free)].tocsc()).solve(force[free])
    return (rows @ u).reshape(-1, 6), theirs[np.searchsorted(numbers, nodes + 1)]
