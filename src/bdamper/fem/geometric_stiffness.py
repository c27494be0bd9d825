r"""Geometric stiffness of 20-node hexahedra under centrifugal load.

With the stress :math:`\sigma` of a displacement :math:`u_s` and the gradients :math:`g_a` of the shape functions,

.. math:: K_{\sigma, ai,bj} = \delta_{ij} \int g_a \cdot \sigma\, g_b\,dV ,

integrated with the 27 points of the stiffness matrix.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from skfem import Basis, ElementHexS2

from bdamper.fem.assembly import Discretisation
from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.element_stress import lame_constants
from bdamper.fem.rotation import spin_displacement, spin_softening


def geometric_stiffness(body: Discretisation, displacement: NDArray) -> sp.csr_matrix:
    """Symmetric matrix (3 n_nodes, 3 n_nodes) of the stress by a displacement (3 n_nodes,), linear in it."""
    basis = Basis(body.mesh, ElementHexS2(), intorder=5)
    gradient = np.stack([b[0].grad for b in basis.basis])  # (20, 3, n_elements, n_points)
    moved = displacement.reshape(-1, 3)[body.elements]  # (n_elements, 20, 3)
    slope = np.einsum("eai,ajep->ijep", moved, gradient, optimize=True)
    strain = 0.5 * (slope + slope.swapaxes(0, 1))
    lame, shear = lame_constants(body.material.youngs_modulus, body.material.poisson_ratio)
    stress = 2.0 * shear * strain + lame * np.einsum("iiep->ep", strain) * np.eye(3)[:, :, None, None]
    pulled = np.einsum("ijep,bjep->biep", stress * basis.dx, gradient, optimize=True)
    scalar = np.einsum("aiep,biep->eab", gradient, pulled, optimize=True)
    rows, columns = np.repeat(body.elements, 20, axis=1).ravel(), np.tile(body.elements, (1, 20)).ravel()
    matrix = sp.coo_matrix((scalar.ravel(), (rows, columns)), shape=(len(body.nodes),) * 2)
    matrix = 0.5 * (matrix + matrix.T)
    return sp.kron(matrix, sp.identity(3), format="csr")


def stiffness_per_squared_speed(body: Discretisation, standstill: CyclicSector) -> sp.csr_matrix:
    """Geometric stiffness less spin softening (3 n_nodes, 3 n_nodes), kg, of a sector with ``body``.

    Parameters
    ----------
    body : Discretisation
    standstill : CyclicSector
        Of nodal diameter 0, with the stiffness of standstill: it gives the centrifugal stress.
    """
    return (geometric_stiffness(body, spin_displacement(standstill)) - spin_softening(body)).tocsr()
