"""Problems with residual modes made anew, in coordinates that can be compared.

Modes of bodies come with the phases of the model's own basis; residual modes have any, and where several have the same
mass, any combination.  Those of one problem are turned onto those of another, each group of equal mass by the unitary
matrix that brings their motions nearest.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdamper.contact.residual_flexibility import RESIDUAL
from bdamper.harmonic_balance.problem import Problem
from bdamper.model.kinematics import HarmonicBasis
from bdamper.util import validation


def aligned(basis: HarmonicBasis, reference: HarmonicBasis) -> HarmonicBasis:
    """The same basis with residual modes turned onto those of another one.

    Raises
    ------
    SettingError
        If the two do not have the same coordinates.
    """
    expected = "a range in which contacts keep their residual modes"
    validation.require(basis.coordinates == reference.coordinates, "residual modes", expected, "one that changes them")
    own = np.array([i for i, c in enumerate(basis.coordinates) if c.body == RESIDUAL], int)
    if not len(own):
        return basis
    mass, G = basis.mass[own], basis.G.copy()
    equal_mass = 1e-6  # relative difference of the modal masses of residual modes up to which they are turned together
    for group in np.split(own, np.flatnonzero(np.diff(mass) > equal_mass * mass.max()) + 1):
        columns, target = (array[..., group].reshape(-1, len(group)) for array in (basis.G, reference.G))
        U, _, V = np.linalg.svd(columns.conj().T @ target)
        G[..., group] = (columns @ (U @ V)).reshape(*G.shape[:2], len(group))
    return replace(basis, G=G)


def like(problem: Problem, reference: Problem) -> Problem:
    """A problem with its unknowns turned onto those of another one."""
    bases = [aligned(b, other) for b, other in zip(problem.bases, reference.bases)]
    return problem.given(bases=bases, **({"static_basis": bases[0]} if bases[0].n_modes else {}))
