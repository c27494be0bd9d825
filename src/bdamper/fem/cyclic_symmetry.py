r"""One sector of a cyclic structure at one nodal diameter (cyclic symmetry: paper, Eq. (17)).

A travelling wave of nodal diameter d has :math:`u^{(k+1)} = R\,u^{(k)} e^{i\varphi}`, :math:`\varphi = 2\pi
d/N`, with R the rotation that carries sector k onto sector k+1 (see :func:`bdamper.model.structure.turn`).  The right
face of sector 0 is the left face of sector 1, so with :math:`x_R = R x_L`

.. math:: u(x_R) = e^{i\varphi} R\, u(x_L),

by interpolation where their meshes differ (:mod:`bdamper.fem.sector_faces`).  Collected in a matrix T from the
independent degrees of freedom to all of the sector, this gives the Hermitian
problem :math:`(T^H K T - \omega^2 T^H M T)\,q = 0` of one sector; :math:`u = T q` with :math:`u^H M u = 1`.
The matrices are real for d = 0 and d = N/2.  A single factorisation of :math:`T^H K T` serves both the modes
(shift and invert about zero) and the static receptances.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import eigh, null_space
from scipy.sparse.linalg import LinearOperator, SuperLU, eigsh, splu

from bdamper.fem.fe_matrices import Structure, check, hermitian
from bdamper.fem.sector_faces import SectorFaces
from bdamper.model.rigid_motions import fix_phase


def factorise(matrix: sp.spmatrix) -> SuperLU:
    """Sparse factorisation of a positive definite Hermitian matrix.

    Raises
    ------
    ValueError
        If its diagonal is not positive; SuperLU crashes on an empty row in its symmetric mode.
    """
    diagonal = matrix.diagonal().real
    if not (np.isfinite(matrix.data).all() and len(diagonal) and diagonal.min() > 0.0):
        raise ValueError("a positive definite matrix has finite entries and a positive diagonal, and this one has not")
    return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def cyclic_transformation(n_nodes: int, faces: SectorFaces, clamped: NDArray, nodal_diameter: int) -> sp.csr_matrix:
    """Matrix T (3 n_nodes, n_independent) of the module's docstring.

    ``clamped`` are nodes (n,), or a mask (n_nodes, 3) of fixed components.  On the faces a rotation about Z mixes
    X and Y, so there both or neither of them must be fixed.

    Raises
    ------
    ValueError
        If the fixed components of the faces do not allow the phase condition.
    """
    clamped = np.asarray(clamped)
    fixed = np.zeros((n_nodes, 3), bool)
    if clamped.dtype == bool and clamped.shape == (n_nodes, 3):
        fixed = clamped
    else:
        fixed[clamped] = True
    left, right = faces.independent, faces.dependent
    if faces.matching:
        images = (faces.weights @ fixed[left].astype(float)) > 0.5
        check((images == fixed[right]).all(), "a clamped node of one sector face has a free image on the other")
    wrong = "a node of a sector face is fixed in one of the directions X and Y that a rotation mixes"
    check(faces.n_sectors == 1 or (fixed[faces.nodes, 0] == fixed[faces.nodes, 1]).all(), wrong)
    own, axis = np.ones(n_nodes, bool), faces.axis[~fixed[faces.axis].any(axis=1)]
    own[right] = False
    phase, rotation = faces.tie(nodal_diameter)
    entries = faces.weights.tocoo()
    tied = sp.csr_matrix((entries.data, (right[entries.row], left[entries.col])), shape=(n_nodes, n_nodes))
    t = sp.kron(sp.diags(own.astype(float)), np.eye(3)) + sp.kron(tied, phase * rotation)
    t = (sp.diags((~fixed.ravel()).astype(float)) @ t.tocsr()).tocsc()
    own[faces.axis] = False
    columns = [t[:, np.flatnonzero((own[:, None] & ~fixed).ravel())]]
    if len(axis):
        free = null_space(np.eye(3) - phase * rotation)
        columns.append(t @ sp.kron(sp.identity(n_nodes, format="csc")[:, axis], free))
    t = sp.hstack(columns).tocsr()
    t.eliminate_zeros()
    return t.tocsr()


def lowest_modes(
    stiffness: sp.spmatrix, mass: sp.spmatrix, solve: Callable[[NDArray], NDArray], n_modes: int
) -> tuple[NDArray, NDArray]:
    """Lowest modes of ``stiffness x = omega2 mass x``; ``solve`` is the action of the inverse stiffness.

    Returns
    -------
    omega2 : (n_modes,) float, ascending
    shapes : (n, n_modes)
        Mass-normalised.
    """
    n = mass.shape[0]
    if n <= 2 * n_modes + 20:  # too small for a Krylov space
        omega2, v = eigh(hermitian(stiffness.toarray()), hermitian(mass.toarray()))
        lowest = np.flatnonzero(omega2 > 1e-12 * np.abs(omega2).max())[:n_modes]  # without rigid motions
        return omega2[lowest], v[:, lowest]
    inverse = LinearOperator((n, n), matvec=solve, dtype=mass.dtype)
    # A fixed start makes the result reproducible.
    start = np.random.default_rng(0).standard_normal(n).astype(mass.dtype)
    _, v = eigsh(stiffness, n_modes, M=mass, sigma=0.0, OPinv=inverse, v0=start, ncv=min(n, 2 * n_modes + 20))
    # The complex Lanczos vectors come from a general Arnoldi process, which does not keep them orthogonal in
    # the mass matrix; one Rayleigh-Ritz step does.
    omega2, combination = eigh(*(hermitian(v.conj().T @ (matrix @ v)) for matrix in (stiffness, mass)))
    return omega2, v @ combination


@dataclass
class CyclicSector:
    """One sector at one nodal diameter: reduced matrices, factorisation and modes, made once when needed.

    Parameters
    ----------
    body : Structure
    faces : SectorFaces
        Of one sector, or :func:`bdamper.fem.sector_faces.no_faces`.
    clamped : int array or mask
        Clamped nodes or components (see :func:`cyclic_transformation`).
    nodal_diameter : int
    """

    body: Structure
    faces: SectorFaces
    clamped: NDArray
    nodal_diameter: int
    _modes: tuple[NDArray, NDArray] | None = field(default=None, init=False, repr=False)
    _contact: tuple[sp.spmatrix, NDArray] | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        self.transformation = cyclic_transformation(len(self.body.nodes), self.faces, self.clamped, self.nodal_diameter)
        adjoint = self.transformation.conj().T
        self.stiffness = (adjoint @ self.body.stiffness @ self.transformation).tocsr()
        self.mass = (adjoint @ self.body.mass @ self.transformation).tocsr()

    @cached_property
    def solver(self) -> SuperLU:
        """Factorisation of the reduced stiffness matrix."""
        return factorise(self.stiffness)

    def forget_factors(self) -> None:
        """Free the memory of the factorisation; it is made again when needed.  Modes stay."""
        if "solver" in vars(self):
            del self.solver

    def modes(self, n_modes: int) -> tuple[NDArray, NDArray]:
        """Lowest modes.

        Returns
        -------
        omega2 : (n_modes,) float, rad2/s2
        shapes : (3 n_nodes, n_modes) float or complex, kg^-1/2
            Of all nodes of the sector.
        """
        if self._modes is None or len(self._modes[0]) < n_modes:
            omega2, reduced = lowest_modes(self.stiffness, self.mass, self.solver.solve, n_modes)
            self._modes = omega2, fix_phase(self.transformation @ reduced, self.body.mass)
        return self._modes[0][:n_modes], self._modes[1][:, :n_modes]

    def static_response(self, load: sp.spmatrix | NDArray) -> NDArray:
        """Displacements (n_independent, n) under loads ``load`` (3 n_nodes, n) on all nodes of the sector."""
        reduced = self.transformation.conj().T @ load
        reduced = reduced.toarray() if sp.issparse(reduced) else np.asarray(reduced)
        return self.solver.solve(np.ascontiguousarray(reduced.astype(self.stiffness.dtype)))

    def contact_response(self, contact: sp.spmatrix) -> NDArray:
        """Displacements (n_independent, n) by unit forces on the rows of ``contact`` (n, 3 n_nodes), kept."""
        if self._contact is None or self._contact[0] is not contact:
            self._contact = contact, self.static_response(contact.T)
        return self._contact[1]

    def receptance(self, contact: sp.spmatrix) -> NDArray:
        """Static receptance (n, n) between the rows of ``contact`` (n, 3 n_nodes), m/N."""
        reduced = contact @ self.transformation
        return hermitian(reduced @ self.contact_response(contact))
