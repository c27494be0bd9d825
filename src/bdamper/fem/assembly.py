r"""Stiffness and mass matrices and body-force loads of 20-node hexahedra.

With the shape functions :math:`N_a`, gradients :math:`g_a = \nabla N_a` and the Lamé constants,

.. math:: K_{ai,bj} = \int \lambda g_{ai} g_{bj} + \mu g_{aj} g_{bi} + \mu \delta_{ij}\, g_a\cdot g_b\,dV,
          \qquad M_{ai,bj} = \delta_{ij} \int \rho N_a N_b\,dV,

integrated with 3 x 3 x 3 Gauss points.  Shape functions, the map and the numbering come from scikit-fem's
scalar element; the three components of node ``a`` are the degrees of freedom ``3 a``, ``3 a + 1``, ``3 a +
2``.  Nodes are the corners of the mesh first, in its order, then the midpoints of its edges, in its order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from skfem import Basis, ElementHexS2, MeshHex

from bdamper.fem.contact_patches import SQUARE
from bdamper.fem.element_faces import Facets, boundary_facets
from bdamper.fem.element_stress import lame_constants
from bdamper.fem.fe_matrices import Structure
from bdamper.fem.geometry import Material


def local_order() -> NDArray:
    """Numbers in scikit-fem of the 20 local nodes in the order of CalculiX and Abaqus."""
    ours = 2.0 * ElementHexS2().doflocs - 1.0
    middles = 0.5 * (SQUARE + np.roll(SQUARE, -1, axis=0))
    layers = ((SQUARE, -1.0), (SQUARE, 1.0), (middles, -1.0), (middles, 1.0), (SQUARE, 0.0))  # on the cube [-1, 1]^3
    theirs = np.concatenate([np.column_stack([xy, np.full(4, z)]) for xy, z in layers])
    return np.abs(theirs[:, None] - ours[None]).max(axis=2).argmin(axis=1)


@dataclass(frozen=True)
class Discretisation(Structure):
    """A meshed body with its matrices.

    Parameters
    ----------
    mesh : MeshHex
    elements : (n_elements, 20) int
        Nodes of each element in scikit-fem's local order.
    material : Material
    """

    mesh: MeshHex
    elements: NDArray
    material: Material

    @cached_property
    def surface(self) -> Facets:
        """All outer faces."""
        return boundary_facets((self.elements[:, local_order()],), self.nodes)


def discretise(mesh: MeshHex, material: Material) -> Discretisation:
    """Assemble stiffness and mass of ``mesh``."""
    basis = Basis(mesh, ElementHexS2(), intorder=5)
    gradient = np.stack([b[0].grad for b in basis.basis], axis=1)  # (3, 20, n_elements, n_points)
    value = np.stack([np.broadcast_to(b[0], basis.dx.shape) for b in basis.basis])  # (20, n_elements, n_points)
    lame, shear = lame_constants(material.youngs_modulus, material.poisson_ratio)

    weighted = (gradient * basis.dx).transpose(2, 0, 1, 3).reshape(mesh.t.shape[1], 60, -1)
    plain = gradient.transpose(2, 0, 1, 3).reshape(mesh.t.shape[1], 60, -1)
    h = (weighted @ plain.transpose(0, 2, 1)).reshape(-1, 3, 20, 3, 20)  # int g_ai g_bj
    k = lame * h + shear * h.transpose(0, 3, 2, 1, 4)
    trace = shear * np.einsum("eiaib->eab", h)
    v = value.transpose(1, 0, 2)
    m = material.density * (v * basis.dx[:, None]) @ v.transpose(0, 2, 1)
    for i in range(3):
        k[:, i, :, i, :] += trace
    k = k.transpose(0, 2, 1, 4, 3)  # node, component, node, component

    elements = basis.element_dofs.T
    n_nodes = basis.N
    dof = (3 * elements[:, :, None] + np.arange(3)).reshape(len(elements), 60)
    stiffness = sp.coo_matrix(
        (k.ravel(), (np.repeat(dof, 60, axis=1).ravel(), np.tile(dof, (1, 60)).ravel())), shape=(3 * n_nodes,) * 2
    ).tocsr()
    scalar = sp.coo_matrix(
        (m.ravel(), (np.repeat(elements, 20, axis=1).ravel(), np.tile(elements, (1, 20)).ravel())), shape=(n_nodes,) * 2
    )
    mass = sp.kron(scalar, sp.identity(3), format="csr")
    # Rounding leaves a trace of asymmetry, which the Hermitian solvers would only carry along.
    stiffness = (0.5 * (stiffness + stiffness.T)).tocsr()
    return Discretisation(basis.doflocs.T.copy(), stiffness, mass, mesh=mesh, elements=elements, material=material)
