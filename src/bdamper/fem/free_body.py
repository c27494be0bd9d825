r"""The free body: rigid-body modes, elastic modes, and the elastic receptance with inertia relief.

The displacement of a free body is a rigid-body motion and an elastic deformation (paper, Eqs (5) to (7)).  Rigid modes
are three translations and three rotations about the centre of gravity, made orthonormal in the mass matrix:
:math:`\Psi^T M \Psi = I`.  A load on a free body accelerates it; what remains after the inertia forces of that rigid
motion are subtracted is self-equilibrated,

.. math:: P^T f, \qquad P = I - \Psi\Psi^T M,

and deforms the body.  Six constraints that only remove the rigid motion take no reaction under it, so with
the stiffness matrix :math:`K_c` of the constrained body the elastic displacement orthogonal to the rigid
modes is

.. math:: u_e = P K_c^{-1} P^T f ,

whatever the choice of the constraints.  Its expansion in elastic modes is :math:`\sum \phi\phi^T/\omega^2`.

Under rotation the body force per mass is :math:`\Omega^2 (x, y, 0)` from the axis; it is scaled to a
resultant of 1 N along the radial direction of the damper.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.sparse.linalg import SuperLU

from bdamper.fem.cyclic_symmetry import factorise, lowest_modes
from bdamper.fem.fe_matrices import Structure, check, hermitian
from bdamper.model.rigid_motions import fix_phase, rigid_motions


def isostatic_dofs(nodes: NDArray, corner: int = 0) -> NDArray:
    """Six degrees of freedom whose removal leaves no rigid motion: 3 + 2 + 1 at three nodes far apart.

    Parameters
    ----------
    nodes : (n, 3) float, m
    corner : int
        The first node; another one gives another, equally valid choice.
    """
    a = corner
    b = int(np.argmax(np.linalg.norm(nodes - nodes[a], axis=1)))
    direction = (nodes[b] - nodes[a]) / np.linalg.norm(nodes[b] - nodes[a])
    off = (nodes - nodes[a]) - np.outer((nodes - nodes[a]) @ direction, direction)
    c = int(np.argmax(np.linalg.norm(off, axis=1)))
    candidates = np.concatenate([3 * a + np.arange(3), 3 * b + np.arange(3), 3 * c + np.arange(3)])
    motion = rigid_motions(nodes, nodes[a], np.eye(3))[candidates]
    motion[:, 3:] /= np.linalg.norm(nodes[b] - nodes[a])
    # six independent rows, each the one least explained by those before
    chosen = qr(motion.T, mode="r", pivoting=True)[1][:6]
    return np.sort(candidates[chosen])


S = TypeVar("S", bound=Structure)


@dataclass
class FreeBody(Generic[S]):
    """A free body at its place.

    Parameters
    ----------
    body : Structure
    axes : (3, 3) float
        Rows: the directions of the rigid translations and rotations.
    constrained : (6,) int, optional
        Degrees of freedom held in the auxiliary problem.
    """

    body: S
    axes: NDArray
    constrained: NDArray | None = None
    _modes: tuple[NDArray, NDArray] | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        body, mass = self.body, self.body.mass
        if self.constrained is None:
            self.constrained = isostatic_dofs(body.nodes)
        unit = np.tile(np.eye(3), (len(body.nodes), 1))
        self.total_mass = float(unit[:, 0] @ (mass @ unit[:, 0]))
        self.centre: NDArray = np.array([unit[:, k] @ (mass @ body.nodes.ravel()) for k in range(3)]) / self.total_mass
        rotation = rigid_motions(body.nodes, self.centre, np.eye(3))[:, 3:]
        self.inertia: NDArray = rotation.T @ (mass @ rotation)
        motion = rigid_motions(body.nodes, self.centre, self.axes)
        # Twice, so that rounding in the first does not remain.
        for _ in range(2):
            lower = np.linalg.cholesky(motion.T @ (mass @ motion))
            motion = np.linalg.solve(lower, motion.T).T
        self.rigid: NDArray = motion
        self._rigid_momentum: NDArray = mass @ motion
        self._kept = np.setdiff1d(np.arange(body.n_dof), self.constrained)

    @cached_property
    def solver(self) -> SuperLU:
        """Factorisation of the stiffness matrix of the constrained body."""
        return factorise(self.body.stiffness[self._kept][:, self._kept])

    def remove_rigid(self, displacement: NDArray) -> NDArray:
        """``P u``: the part (3 n_nodes, ...) orthogonal to the rigid modes in the mass matrix."""
        return displacement - self.rigid @ (self._rigid_momentum.T @ displacement)

    def elastic_response(self, load: NDArray) -> NDArray:
        """Elastic displacement (3 n_nodes, ...) under ``load`` (3 n_nodes, ...) with inertia relief."""
        load = load - self._rigid_momentum @ (self.rigid.T @ load)
        out = np.zeros_like(load)
        out[self._kept] = self.solver.solve(np.ascontiguousarray(load[self._kept]))
        return self.remove_rigid(out)

    def modes(self, n_modes: int) -> tuple[NDArray, NDArray]:
        """Six rigid modes, then elastic ones, ``n_modes`` in all: omega2 (n_modes,) and shapes (3 n_nodes, n_modes)."""
        check(n_modes >= 6, f"a free body has six rigid modes; n_modes = {n_modes}")
        n = n_modes - 6
        if n and (self._modes is None or len(self._modes[0]) < n):
            omega2, shapes = lowest_modes(self.body.stiffness, self.body.mass, self.elastic_response, n)
            self._modes = omega2, fix_phase(self.remove_rigid(shapes), self.body.mass)
        if self._modes is None:
            return np.zeros(6), self.rigid
        return np.append(np.zeros(6), self._modes[0][:n]), np.hstack([self.rigid, self._modes[1][:, :n]])

    def receptance(self, contact: sp.spmatrix) -> NDArray:
        """Elastic receptance (n, n) between the rows of ``contact`` (n, 3 n_nodes), m/N."""
        return hermitian(contact @ self.elastic_response(contact.T.toarray()))

    def centrifugal_load(self, radial: NDArray) -> NDArray:
        """Nodal forces (3 n_nodes,) of rotation about Z with a resultant of 1 N along ``radial`` (3,)."""
        force = self.body.body_force(self.body.nodes * [1.0, 1.0, 0.0])
        return (force / (force.sum(axis=0) @ radial)).ravel()
