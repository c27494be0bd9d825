"""The methods of contact stiffness beside each other, on one problem (paper, Eqs 1 to 11)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdamper.contact.stiffness import METHODS, StiffnessComparison, literal_negative
from bdamper.problem.problem import Problem
from bdamper.util import validate


def compare_stiffness(problem: Problem, n_frequencies: int = 5) -> StiffnessComparison:
    """All methods of contact stiffness side by side: values, fallbacks, frequencies with the contact bonded.

    Parameters
    ----------
    problem : Problem
    n_frequencies : int
        How many of the lowest.
    """
    validate.whole("n_frequencies", n_frequencies, least=1)
    names = problem.coupling.friction_faces
    faces = {name: problem.coupling.model.interfaces[name] for name in names}
    stiffness, frequencies = {}, {}
    for method in METHODS:
        other = replace(problem, contact_stiffness=method)
        stiffness[method] = {name: other.stiffness[name] for name in names}
        bonded = other.point_stiffness * other.friction_points[:, None]
        frequencies[method] = other.system(0.0).linear_modes(bonded)[0][:n_frequencies] / (2.0 * np.pi)
    return StiffnessComparison(
        names,
        {name: face.points for name, face in faces.items()},
        {name: face.frame for name, face in faces.items()},
        {name: face.area for name, face in faces.items()},
        stiffness,
        literal_negative(problem.coupling, problem.friction),
        frequencies,
    )
