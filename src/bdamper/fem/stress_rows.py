r"""Stress sets of a sector: rows of its modes, contact forces and centrifugal load at chosen nodes.

.. math:: S = C B \Phi, \qquad A = C B\,(K^{-1} P^H - \Phi \Omega^{-2} \Phi^H P^H),
          \qquad \sigma_1 = C B\,u_s,\quad K u_s = M E_s x,\ E_s = \mathrm{diag}(1, 1, 0).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fem.contact_patches import Patches
from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.element_stress import Solids, element_rows, node_average, von_mises_size
from bdamper.fem.rotation import spin_displacement
from bdamper.model.stress_recovery import StressSet


def near_patches(points: NDArray, *faces: Patches) -> NDArray:
    """(n,) bool: points that lie on a patch or nearer to one than the mean length of its edges."""
    near = np.zeros(len(points), bool)
    for face in faces:
        local = np.einsum("pij,npj->npi", face.frame, points[:, None] - face.centre)
        beyond = np.maximum(np.abs(local[..., :2]) - 0.5 * face.size, 0.0)
        distance = np.sqrt((beyond**2).sum(axis=-1) + local[..., 2] ** 2)
        near |= (distance <= np.sqrt(face.area)).any(axis=1)
    return near


class StressRows:
    """Collects the stress of all vectors that a body carries, one nodal diameter after the other, in single precision.

    Parameters
    ----------
    name : str
    solids : sequence of Solids
    positions : (n_nodes, 3) float, m
    nodes : (n,) int
        Away from the cut faces of the sector, where the neighbour's elements would belong to the average.
    near_contact : (n,) bool, optional

    Raises
    ------
    ValueError
        As in :func:`bdamper.fem.element_stress.element_rows`.
    """

    def __init__(
        self, name: str, solids: Sequence[Solids], positions: NDArray, nodes: NDArray, near_contact: NDArray | None = None
    ) -> None:
        self.name, self.nodes, self.points = name, nodes, positions[nodes]
        self._near = near_contact
        self._pairs, self._owner = element_rows(solids, positions, nodes)
        self._rows = node_average(self._owner, len(nodes)) @ self._pairs
        self._modes: dict[int, NDArray] = {}
        self._contact: dict[int, NDArray] = {}
        self._static: NDArray | None = None
        self._spread: NDArray | None = None

    def add(self, sector: CyclicSector, contact: sp.spmatrix, omega2: NDArray, shapes: NDArray) -> None:
        """The vectors of one nodal diameter; 0 brings the centrifugal load.

        ``contact`` (3 n_points, 3 n_nodes) leads from nodal displacements to the contact points of all ports; ``omega2``
        (n,) and ``shapes`` (3 n_nodes, n) are those of the body's basis.
        """
        d = sector.nodal_diameter
        S = self._rows @ shapes
        unit = self._rows @ (sector.transformation @ sector.contact_response(contact))
        A = unit - (S / omega2) @ (contact @ shapes).conj().T
        self._modes[d], self._contact[d] = self._kept(S), self._kept(A)
        if d == 0:
            self._static = (self._rows @ spin_displacement(sector).real).reshape(-1, 6)
        if (d and len(self._modes) <= 2) or self._spread is None:
            mean = (self._rows @ shapes[:, 0]).reshape(-1, 6)
            apart = von_mises_size((self._pairs @ shapes[:, 0]).reshape(-1, 6) - mean[self._owner])
            spread = np.zeros(len(self.nodes))
            np.maximum.at(spread, self._owner, apart)
            self._spread = spread / von_mises_size(mean)

    @staticmethod
    def _kept(rows: NDArray) -> NDArray:
        out = rows.reshape(-1, 6, rows.shape[1])
        single = np.complex64 if np.iscomplexobj(out) else np.float32
        return out.astype(single).astype(out.dtype)

    def set(self, body: str, source: str) -> StressSet:
        """The stress set of a body of that name."""
        return StressSet(
            name=self.name, body=body, points=self.points, modes=self._modes, contact=self._contact, static=self._static,
            spread=self._spread, near_contact=self._near, source=source,
        )  # fmt: skip
