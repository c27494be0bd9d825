"""The data of a finite element body that a reduction needs: nodes, stiffness and mass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray


def check(good: object, wrong: str) -> None:
    """Raise a ValueError that says what is wrong, to which an importer adds of which body."""
    if not good:
        raise ValueError(wrong)


def hermitian(matrix: NDArray) -> NDArray:
    """The Hermitian part of a matrix, or of each of several (..., n, n)."""
    return 0.5 * (matrix + matrix.conj().swapaxes(-1, -2))


@dataclass(frozen=True)
class Structure:
    """Nodes and matrices; the displacements of node ``a`` are the rows ``3 a``, ``3 a + 1``, ``3 a + 2``.

    Parameters
    ----------
    nodes : (n_nodes, 3) float, m
    stiffness, mass : (3 n_nodes, 3 n_nodes) sparse, N/m and kg
    """

    nodes: NDArray
    stiffness: sp.csr_matrix
    mass: sp.csr_matrix

    @property
    def n_dof(self) -> int:
        return 3 * len(self.nodes)

    def dofs(self, nodes: NDArray) -> NDArray:
        """Degrees of freedom (3 n,) of nodes (n,), grouped by node."""
        return (3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel()

    def nearest_node(self, position: NDArray) -> int:
        """The node closest to ``position`` (3,)."""
        return int(np.argmin(np.linalg.norm(self.nodes - position, axis=1)))

    def body_force(self, density: NDArray) -> NDArray:
        """Consistent nodal forces (n_nodes, 3) of a force per mass given at the nodes (n_nodes, 3), N.

        The field is interpolated with the shape functions, exactly so if it is linear in the coordinates.
        """
        return (self.mass @ np.asarray(density, float).ravel()).reshape(-1, 3)
