r"""Linear test of residual modes: shift of the first mode by bonded parts of the faces.

The contact points of a part are bonded and the others free.  With the flexibility :math:`R` that
residual modes represent, and its rows :math:`S` of the part, the stiffness of the modes is
:math:`\Omega^2 + G_S^H R_{SS}^{-1} G_S`.  All residual modes give the reference of the shift of
mode 1, and the shift of the next modes.  Only eigenvalue problems are solved.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.contact.residual_flexibility import (
    RESOLVED_HIGHER,
    ResidualModes,
    ResidualSet,
    force_patterns,
    parts_of_faces,
)
from bdamper.model.kinematics import Coupling, HarmonicBasis, retained_modes
from bdamper.model.structure import Model

WHOLE = "whole faces"
WHOLE_LIMIT, PART_LIMIT = 0.05, 0.15
"""Largest relative errors of the shift by whole faces, and by parts of them."""
SMALL_SHIFT = 0.005
"""Relative shift of mode 1 by bonded faces below which dampers have little effect."""
LEAST_SHIFT = 1e-6
"""Relative shift of mode 1 by a part below which an error of it would be rounding."""
RIGID = 1e-6
"""Relative squared frequency below which a motion of a body is rigid."""
GROUND = 1.0
"""Stiffness against rigid motions, s^-2: a frequency of 0.16 Hz."""
DEFAULT_MODES = 10
"""Blade modes of a study by default."""
SHOWN_SHIFTS = 6
"""Lowest modes whose shift by bonded faces is computed: a damper acts on those that it shifts."""
FRICTION = 0.3
"""The vectors depend only on where friction is possible, and no friction is known at import."""


@dataclass(frozen=True)
class PartialContact:
    """Shift of the lowest modes by bonded faces, and errors of the shift of mode 1 by parts.

    Parameters
    ----------
    shifts : tuple of float
        Relative shift of the lowest frequencies by the whole faces, in ascending order of the
        frequencies.
    errors : mapping of str to float
        Relative error of the shift for the whole faces and each part that shifts mode 1; positive
        if too stiff.
    """

    shifts: tuple[float, ...]
    errors: Mapping[str, float]

    @property
    def shift(self) -> float:
        """Relative shift of mode 1 by the whole faces."""
        return self.shifts[0]

    @property
    def worst_part(self) -> str:
        """Part with the largest error; the whole faces if no part shifts mode 1."""
        parts = [name for name in self.errors if name != WHOLE]
        return max(parts, key=lambda name: abs(self.errors[name]), default=WHOLE)

    @property
    def largest_error(self) -> float:
        """Largest error, relative to its limit."""
        whole, part = self.errors[WHOLE], self.errors[self.worst_part]
        return max(abs(whole) / WHOLE_LIMIT, abs(part) / PART_LIMIT)

    @property
    def accurate(self) -> bool:
        """Whether the errors are within the limits."""
        return self.largest_error <= 1.0


def bonded_parts(coupling: Coupling) -> dict[str, NDArray]:
    """Return the rows of the contact points of the whole faces, of four thirds and of a corner."""
    thirds = parts_of_faces(coupling)
    named = {f"{name} third": rows for name, rows in thirds.items()}
    corner = np.intersect1d(thirds["outer"], thirds["front"])
    parts = {WHOLE: coupling.friction_rows, **named, "outer front corner": corner}
    # patches of a given shape may leave a corner empty
    return {name: rows for name, rows in parts.items() if len(rows)}


def partial_contact(coupling: Coupling, options: ResidualModes) -> PartialContact:
    """Compare the shifts with the reference, all residual modes.

    Raises
    ------
    ModelError
        If the model lacks a flexibility, or it is not positive semi-definite.
    """
    active, represented = _represented(coupling, options)
    _, complete = _represented(coupling, ResidualModes("all"))

    basis = coupling.basis(1)
    elastic = basis.omega2 > RIGID * basis.omega2.max()
    free = np.sqrt(np.sort(basis.omega2[elastic]))
    # row of each component (n_points, 3) in stacked vectors
    row_of_component = np.arange(3 * coupling.n_points).reshape(-1, 3)
    shifts: tuple[float, ...] = (0.0,)
    errors = {}
    for part, points in bonded_parts(coupling).items():
        rows = row_of_component[points][active[points]]
        bonded = _bonded(basis, complete, rows)
        if part == WHOLE:
            relative = bonded[:SHOWN_SHIFTS] / free[:SHOWN_SHIFTS] - 1.0
            shifts = tuple(relative.tolist())
        # shift of mode 1 (rad/s); small shifts have no meaningful error
        exact_shift = bonded[0] - free[0]
        if exact_shift > LEAST_SHIFT * free[0]:
            shift = _bonded(basis, represented, rows)[0] - free[0]
            errors[part] = float(shift / exact_shift - 1.0)
    return PartialContact(shifts, errors)


def _represented(coupling: Coupling, options: ResidualModes) -> tuple[NDArray, NDArray]:
    """Return the possible force components (n_points, 3) bool, and the flexibility (3 n_points,
    3 n_points) that residual modes represent.
    """
    friction = np.full(coupling.n_points, FRICTION)
    residual = ResidualSet.make(coupling, friction, options)
    modes = residual.basis(1)
    columns = modes.G.reshape(3 * coupling.n_points, -1)
    diagonal = np.diag(residual.flexibility.ravel())
    return residual.active, diagonal + (columns / modes.omega2) @ columns.conj().T


def _bonded(basis: HarmonicBasis, flexibility: NDArray, rows: NDArray) -> NDArray:
    """Return the frequencies (rad/s), ascending, with rows bonded and rigid bodies without mass."""
    of_rows = flexibility[np.ix_(rows, rows)]
    # F F^H is the stiffness of the contact, so the structure has K + G^H F F^H G
    F = force_patterns(of_rows, "flexibility of a part", RESOLVED_HIGHER)
    motion_of_rows = basis.G.reshape(-1, basis.n_modes)[rows]
    in_patterns = F.conj().T @ motion_of_rows
    stiffness = np.diag(basis.omega2) + in_patterns.conj().T @ in_patterns
    rigid = basis.omega2 <= RIGID * basis.omega2.max()
    # a part may leave motions of a rigid body free
    stiffness[rigid, rigid] += GROUND
    mass = np.diag(np.where(rigid, 0.0, 1.0))
    # the eigenvalues of M x = mu K x are 1 / omega^2, and 0 for coordinates without mass
    mu = scipy.linalg.eigh(mass, stiffness, eigvals_only=True)
    # descending, so that frequencies ascend; one for each coordinate with mass
    n_elastic = int((~rigid).sum())
    largest_first = mu[::-1]
    return np.asarray(largest_first[:n_elastic] ** -0.5)


def coupling_of_default(model: Model, nodal_diameter: int) -> Coupling | None:
    """Return the coupling of a study with default settings at a nodal diameter.

    It is None for a model without friction faces, or if a body lacks the nodal diameter or its
    flexibility.
    """
    in_contact = [body for body in model.bodies.values() if body.kind != "ground" and body.ports]
    for body in in_contact:
        # a free body has the same modes at all nodal diameters
        diameters = (0,) if body.kind == "free" else (0, nodal_diameter)
        for diameter in diameters:
            if diameter not in body.bases or body.bases[diameter].flexibility is None:
                return None
    n_modes = DEFAULT_MODES
    for body in model.bodies.values():
        if body.kind == "constrained":
            n_modes = min([n_modes, *(basis.n_natural for basis in body.bases.values())])
    # free bodies are rigid
    modes = retained_modes(model, n_modes, dict.fromkeys(model.bodies, 0))
    coupling = Coupling(model, tuple(model.interfaces), modes, nodal_diameter)
    return coupling if coupling.friction_faces else None
