r"""Frequencies of a cyclic sector with a free body bonded to it, of the full finite element model.

The mean displacements of sector and free body over each patch are made equal by multipliers :math:`\lambda`.  With
their averaging matrices :math:`G_b` (on the independent degrees of freedom of the sector) and :math:`-G_d`, the
shift-and-invert step about zero solves, for given :math:`f_b, f_d`,

.. math:: u_b = K_b^{-1}(f_b - G_b^H\lambda),\quad u_d = \Psi\eta + R_e(f_d + G_d^T\lambda),\quad
          G_b u_b = G_d u_d,\quad \Psi^T(f_d + G_d^T\lambda) = 0,

that is, one small dense system in :math:`(\lambda, \eta)` with the receptances of both bodies:

.. math:: \begin{bmatrix} R_b + R_d & G_d\Psi\\ \Psi^T G_d^T & 0\end{bmatrix}
          \begin{bmatrix}\lambda\\ \eta\end{bmatrix} =
          \begin{bmatrix} G_b K_b^{-1} f_b - G_d R_e f_d\\ -\Psi^T f_d\end{bmatrix}.

No stiffness is added and no mode is left out: a reduced model with bonded contact must approach these frequencies.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.generated_models import SectorFE, averaging_matrix, wedge_patches
from bdamper.fem.lowest_modes import lowest_modes
from bdamper.fem.reduced_bodies import FreeBody
from bdamper.fem.sector_faces import sector_phase


def bonded_frequencies(
    sector: CyclicSector,
    damper: FreeBody,
    sector_rows: sp.spmatrix,
    damper_rows: sp.spmatrix,
    n_modes: int = 5,
) -> NDArray:
    """Frequencies (n_modes,), Hz, of the travelling wave of the sector's nodal diameter.

    Parameters
    ----------
    sector : CyclicSector
    damper : FreeBody
    sector_rows, damper_rows : (n, 3 n_nodes) sparse
        From nodal displacements to the means that are made equal; those of a neighbouring sector carry its phase.
    n_modes : int
    """
    dtype = sector.stiffness.dtype
    g_blade = (sector_rows @ sector.transformation).tocsr()
    g_damper = damper_rows.tocsr()
    blade_columns = sector.solver.solve(g_blade.conj().T.toarray())
    damper_columns = damper.elastic_response(g_damper.T.toarray())
    rigid = g_damper @ damper.rigid
    n_b, n_lambda = g_blade.shape[1], len(rigid)
    system = np.zeros((n_lambda + 6, n_lambda + 6), dtype)
    system[:n_lambda, :n_lambda] = g_blade @ blade_columns + g_damper @ damper_columns
    system[:n_lambda, n_lambda:] = rigid
    system[n_lambda:, :n_lambda] = rigid.T
    # The two blocks of unknowns differ by many orders of magnitude; equal units keep the factorisation accurate.
    unit = np.full(n_lambda + 6, 1.0 / np.sqrt(np.abs(np.diag(system)[:n_lambda]).mean()))
    unit[n_lambda:] = 1.0 / (unit[0] * np.abs(rigid).max())
    factor = scipy.linalg.lu_factor(system * unit[:, None] * unit)

    def solve(load: NDArray) -> NDArray:
        f_b, f_d = load[:n_b], load[n_b:]
        u_d = damper.elastic_response(f_d)
        u_b = sector.solver.solve(f_b)
        right_side = np.concatenate([g_blade @ u_b - g_damper @ u_d, -(damper.rigid.T @ f_d)])
        solution = unit[:, None] * scipy.linalg.lu_solve(factor, unit[:, None] * right_side)
        multiplier, eta = solution[:n_lambda], solution[n_lambda:]
        u_b = u_b - blade_columns @ multiplier
        u_d = u_d + damper_columns @ multiplier + damper.rigid @ eta
        return np.concatenate([u_b, u_d])

    stiffness = sp.block_diag([sector.stiffness, damper.body.stiffness], format="csr").astype(dtype)
    mass = sp.block_diag([sector.mass, damper.body.mass], format="csr").astype(dtype)
    omega2, _ = lowest_modes(stiffness, mass, solve, n_modes)
    return np.sqrt(omega2) / (2.0 * np.pi)


def reference_frequencies(
    fe: SectorFE, nodal_diameter: int, points: int | tuple[int, int] = 48, n_modes: int = 5
) -> NDArray:
    """Frequencies (n_modes,), Hz, of the reference disk with the damper bonded at patches."""
    left, right = (wedge_patches(fe.geometry, side, points) for side in ("left", "right"))
    phase = sector_phase(fe.geometry.n_blades, nodal_diameter)
    phases = np.concatenate([np.ones(3 * len(left.size)), np.full(3 * len(right.size), phase)])
    blade_rows = sp.diags(phases) @ fe.blade_contact(left, right)
    damper_rows = averaging_matrix(fe.damper.body, left, right)
    return bonded_frequencies(
        fe.cyclic(nodal_diameter), fe.damper, blade_rows, damper_rows, n_modes
    )
