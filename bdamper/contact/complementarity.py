r"""Contact states of a load step as a linear complementarity problem.

If every contact is bonded by its springs, equilibrium is linear.  Two kinds of forces correct it: the
force :math:`\nu \ge 0` by which a normal spring would pull, at open points, and the forces
:math:`\gamma_\pm \ge 0` by which slip relaxes a tangential spring.  With these unknowns,

.. math:: 0 \le \nu \perp N \ge 0, \qquad 0 \le \gamma_\pm \perp \mu N \mp T \ge 0,

and N and T are linear in the unknowns (Klarbring, Ing. Arch. 56, 1986).  Lemke's method solves such
a problem by a finite number of pivots, unlike the Newton iteration, which may cycle, and unlike
iterations on convex problems, which may alternate.  It may also end without a solution.  Then
another direction of its path is tried.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy
from numpy.typing import NDArray

from bdamper.contact.friction_step import Springs
from bdamper.contact.preload_state import OPEN, SLIP_MINUS, SLIP_PLUS, STICK

MOST_PATHS = 8
"""Largest number of directions of Lemke's path."""
SPREAD = 3.0
"""Largest ratio of the entries of a direction, after the first, which has equal ones."""
PERTURBED = 1e-9
"""Change of the forces at rest relative to the largest one, which separates equal ratios."""
SMALLEST_PIVOT = 1e-9
"""Entry of a column that counts as zero; the matrix has no unit and entries of about 1."""
MOST_PIVOTS = 20
"""Largest number of pivots for each unknown."""


def possible_states(
    system: Springs, force: NDArray, shift: NDArray, slider: NDArray
) -> Iterator[NDArray]:
    """Yield states (n_points, 2) in which the points may be after a load step.

    Parameters
    ----------
    system : Springs
        Without compiled laws and cubic springs.
    force : (n_modes,) float
        Modal load.
    shift : (n_points, 3) float, m
        Motion of the points without modes.
    slider : (n_points, 2) float, m
        Sliders before the step.
    """
    n_points, _, n_modes = system.G.shape
    springs = np.concatenate([system.kt, system.kn[:, None]], axis=1)
    # rows and springs of both tangential directions of each point, then of the normals
    G = np.concatenate([system.G[:, :2].reshape(-1, n_modes), system.G[:, 2]])
    k = np.concatenate([springs[:, :2].ravel(), springs[:, 2]])
    at_rest = k * np.concatenate([(shift[:, :2] - slider).ravel(), shift[:, 2]])
    at_rest[2 * n_points :] += system.n0

    stuck = np.diag(system.stiffness) + G.T @ (k[:, None] * G)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(stuck), 1e-300))
    try:
        factors = scipy.linalg.cho_factor(stuck * scale[:, None] * scale)
    except np.linalg.LinAlgError:
        # the springs of all points do not hold the structure
        return
    q = scale * scipy.linalg.cho_solve(factors, scale * (force - G.T @ at_rest))
    # spring forces with bonded contacts, and their decrease by unit relaxing forces
    bonded_force = at_rest + k * (G @ q)
    of_relaxing = scale[:, None] * scipy.linalg.cho_solve(factors, scale[:, None] * G.T)
    decrease = np.eye(len(k)) - k[:, None] * (G @ of_relaxing)

    free = np.logical_not(np.broadcast_to(system.bonded, n_points))
    presses = np.flatnonzero(free & (system.kn > 0.0))
    rubs = np.flatnonzero((free & (system.kn > 0.0))[:, None] & (system.kt > 0.0))
    normal = 2 * n_points + presses
    # normal and tangential forces in terms of the unknowns nu, gamma+ and gamma-
    of_normal = decrease[np.ix_(normal, normal)]
    by_slip = decrease[np.ix_(normal, rubs)]
    N = np.hstack([of_normal, -by_slip, by_slip])
    by_opening = decrease[np.ix_(rubs, normal)]
    of_slip = decrease[np.ix_(rubs, rubs)]
    T = np.hstack([by_opening, -of_slip, of_slip])
    # friction limit of each tangential direction
    point = np.searchsorted(presses, rubs // 2)
    mu = system.mu[rubs // 2]
    limit = mu[:, None] * N[point]
    limit_at_rest = mu * bonded_force[normal][point]
    M = np.vstack([N, limit - T, limit + T])
    b = np.concatenate(
        [
            bonded_force[normal],
            limit_at_rest - bonded_force[rubs],
            limit_at_rest + bonded_force[rubs],
        ]
    )
    size = float(np.abs(b).max(initial=0.0))
    if size == 0.0:
        return

    random = np.random.default_rng(0)
    for attempt in range(MOST_PATHS):
        direction = np.ones(len(b))
        if attempt > 0:
            direction = SPREAD ** random.random(len(b))
        perturbed = b / size + PERTURBED * random.random(len(b))
        acts = solution_basis(M, perturbed, direction)
        if acts is None:
            continue
        opens, slips_forward, slips_backward = np.split(
            acts, [len(presses), len(presses) + len(rubs)]
        )
        status = np.full((n_points, 2), STICK)
        flat = status.reshape(-1)
        flat[rubs[slips_forward]] = SLIP_PLUS
        flat[rubs[slips_backward]] = SLIP_MINUS
        status[presses[opens]] = OPEN
        yield status


def solution_basis(M: NDArray, b: NDArray, direction: NDArray) -> NDArray | None:
    """Return which unknowns (n,) of a linear complementarity problem are positive, by Lemke's method.

    The problem is ``w = M z + b``, ``0 <= w`` complementary to ``z >= 0``.

    Parameters
    ----------
    M : (n, n) float
    b : (n,) float
    direction : (n,) float
        Positive direction in which the artificial unknown adds to ``w``.

    Returns
    -------
    (n,) bool or None
        None if the path ends at infinity, or after too many pivots.
    """
    n = len(b)
    if b.min(initial=0.0) >= 0.0:
        return np.zeros(n, bool)
    # columns: w, z, the artificial unknown, and the right side
    tableau = np.hstack([np.eye(n), -M, -direction[:, None], b[:, None]])
    artificial = 2 * n
    basis = np.arange(n)
    row = int(np.argmin(b / direction))
    entering = artificial
    for _ in range(MOST_PIVOTS * n):
        leaving = int(basis[row])
        _pivot(tableau, row, entering)
        basis[row] = entering
        if leaving == artificial:
            is_basic = np.zeros(2 * n + 1, bool)
            is_basic[basis] = True
            return is_basic[n : 2 * n]
        # the complement of the unknown that has become zero
        entering = leaving + n if leaving < n else leaving - n
        column = tableau[:, entering]
        rows = np.flatnonzero(column > SMALLEST_PIVOT)
        if not len(rows):
            return None
        ratio = tableau[rows, -1] / column[rows]
        row = int(rows[np.argmin(ratio)])
    return None


def _pivot(tableau: NDArray, row: int, column: int) -> None:
    """Make a column the unit vector of a row, in place."""
    tableau[row] /= tableau[row, column]
    factor = tableau[:, column].copy()
    factor[row] = 0.0
    # rows without the unknown do not change
    changed = np.flatnonzero(factor)
    tableau[changed] -= factor[changed, None] * tableau[row]
