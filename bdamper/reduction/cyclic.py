r"""One sector of a cyclic structure at one nodal diameter (cyclic symmetry: paper, Eq. (17)).

A travelling wave of nodal diameter d has :math:`u^{(k+1)} = R\,u^{(k)} e^{i\varphi}`, :math:`\varphi = 2\pi
d/N`, with R the rotation that carries sector k onto sector k+1 (see :func:`bdamper.model.model.turn`).  The right
face of sector 0 is the left face of sector 1, so with :math:`x_R = R x_L`

.. math:: u(x_R) = e^{i\varphi} R\, u(x_L).

Collected in a matrix T from the independent degrees of freedom to all of the sector, this gives the Hermitian
problem :math:`(T^H K T - \omega^2 T^H M T)\,q = 0` of one sector; :math:`u = T q` with :math:`u^H M u = 1`.
The matrices are real for d = 0 and d = N/2.  A single factorisation of :math:`T^H K T` serves both the modes
(shift and invert about zero) and the static receptances.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse.linalg import LinearOperator, SuperLU, eigsh, splu
from scipy.spatial import cKDTree

from bdamper.model.model import turn
from bdamper.reduction.structure import Structure, check


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


def match_faces(nodes: NDArray, left: NDArray, right: NDArray, pitch: float, tolerance: float = 1e-8) -> NDArray:
    """The nodes of ``right`` in the order in which rotation by one pitch carries ``left`` onto them.

    Raises
    ------
    ValueError
        If the faces do not match node by node within ``tolerance`` (m).
    """
    check(len(left) and len(right), f"sector faces with {len(left)} and {len(right)} nodes: none may be empty")
    target = nodes[left] @ turn(pitch).T
    distance, index = cKDTree(nodes[right]).query(target)
    if len(left) != len(right) or distance.max() > tolerance or len(np.unique(index)) != len(index):
        found = f"{len(left)} and {len(right)} nodes, largest distance {distance.max():.3g} m"
        raise ValueError(f"sector faces do not match under rotation by {pitch:.6g} rad: {found}")
    return right[index]


def sector_phase(n_sectors: int, nodal_diameter: int) -> complex:
    """Factor ``exp(2 pi i d/N)`` from one sector to the next; +1 or -1, hence real, for d = 0 and d = N/2."""
    if 2 * nodal_diameter % n_sectors == 0:
        return -1.0 if nodal_diameter % n_sectors else 1.0
    return np.exp(2j * np.pi * nodal_diameter / n_sectors)


def cyclic_transformation(
    n_nodes: int, left: NDArray, right: NDArray, clamped: NDArray, n_sectors: int, nodal_diameter: int
) -> sp.csr_matrix:
    """Matrix T (3 n_nodes, n_independent) of the module's docstring; ``right[m]`` is ``left[m]``'s image.

    ``clamped`` are nodes (n,), or a mask (n_nodes, 3) of fixed components.  On the faces a rotation about Z mixes
    X and Y, so there both or neither of them must be fixed, and alike on both faces.

    Raises
    ------
    ValueError
        If the fixed components of the faces do not allow the phase condition.
    """
    dependent = np.zeros(n_nodes, bool)
    dependent[right] = True
    clamped = np.asarray(clamped)
    fixed = np.zeros((n_nodes, 3), bool)
    if clamped.dtype == bool and clamped.shape == (n_nodes, 3):
        fixed = clamped
    else:
        fixed[clamped] = True
    check((fixed[left] == fixed[right]).all(), "a clamped node of one sector face has a free image on the other")
    wrong = "a node of a sector face is fixed in one of the directions X and Y that a rotation mixes"
    check(n_sectors == 1 or (fixed[left, 0] == fixed[left, 1]).all(), wrong)
    free = np.flatnonzero(~dependent & ~fixed.all(axis=1))
    column = np.full(n_nodes, -1)
    column[free] = np.arange(len(free))

    phase = sector_phase(n_sectors, nodal_diameter)
    keep = column[left] >= 0
    rows, columns = np.concatenate([free, right[keep]]), np.concatenate([column[free], column[left[keep]]])
    blocks = np.repeat([np.eye(3), phase * turn(2.0 * np.pi / n_sectors)], [len(free), keep.sum()], axis=0)
    order = np.argsort(rows, kind="stable")
    pointer = np.searchsorted(rows[order], np.arange(n_nodes + 1))
    t = sp.bsr_matrix((blocks[order], columns[order], pointer), shape=(3 * n_nodes, 3 * len(free))).tocsr()
    loose = ~fixed[free].ravel()
    return t if loose.all() else t[:, np.flatnonzero(loose)]


def fix_phase(vectors: NDArray, mass: sp.spmatrix, partial: bool = False) -> NDArray:
    """Give each column a definite phase: ``u^T M u`` real and positive, the largest component positive.

    With ``partial`` the vectors may be unknown (NaN) in some rows, which decide nothing.

    The first makes the mode as real as it can be, and unlike a rule on one component it cannot jump when two
    components are about equally large; the second decides the remaining sign.
    """
    known = np.nan_to_num(vectors) if partial else vectors
    if np.iscomplexobj(vectors):
        square = np.einsum("ij,ij->j", known, mass @ known)
        turn_back = np.exp(-0.5j * np.angle(square))
        vectors, known = vectors * turn_back, known * turn_back
    # In a symmetric body several components are equally large up to rounding: take the first of them.
    size = np.abs(known)
    first = (size > (1.0 - 1e-6) * size.max(axis=0)).argmax(axis=0)
    largest = np.take_along_axis(known, first[None], axis=0)[0]
    return vectors * np.where(largest.real < 0.0, -1.0, 1.0)


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
        k, m = stiffness.toarray(), mass.toarray()
        omega2, v = eigh(0.5 * (k + k.conj().T), 0.5 * (m + m.conj().T))
        lowest = np.flatnonzero(omega2 > 1e-12 * np.abs(omega2).max())[:n_modes]  # without rigid motions
        return omega2[lowest], v[:, lowest]
    inverse = LinearOperator((n, n), matvec=solve, dtype=mass.dtype)
    # A fixed start makes the result reproducible.
    start = np.random.default_rng(0).standard_normal(n).astype(mass.dtype)
    _, v = eigsh(stiffness, n_modes, M=mass, sigma=0.0, OPinv=inverse, v0=start, ncv=min(n, 2 * n_modes + 20))
    # The complex Lanczos vectors come from a general Arnoldi process, which does not keep them orthogonal in
    # the mass matrix; one Rayleigh-Ritz step does.
    k, m = v.conj().T @ (stiffness @ v), v.conj().T @ (mass @ v)
    omega2, combination = eigh(0.5 * (k + k.conj().T), 0.5 * (m + m.conj().T))
    return omega2, v @ combination


@dataclass
class CyclicSector:
    """One sector at one nodal diameter: reduced matrices, factorisation and modes, made once when needed.

    Parameters
    ----------
    body : Structure
    left, right, clamped : int arrays
        Matched nodes of the two sector faces (empty for one sector), and the clamped nodes or components
        (see :func:`cyclic_transformation`).
    n_sectors, nodal_diameter : int
    """

    body: Structure
    left: NDArray
    right: NDArray
    clamped: NDArray
    n_sectors: int
    nodal_diameter: int
    _lu: SuperLU | None = field(default=None, repr=False)
    _modes: tuple[NDArray, NDArray] | None = field(default=None, repr=False)
    _contact: tuple[sp.spmatrix, NDArray] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self.transformation = cyclic_transformation(
            len(self.body.nodes), self.left, self.right, self.clamped, self.n_sectors, self.nodal_diameter
        )
        adjoint = self.transformation.conj().T
        self.stiffness = (adjoint @ self.body.stiffness @ self.transformation).tocsr()
        self.mass = (adjoint @ self.body.mass @ self.transformation).tocsr()

    @property
    def solver(self) -> SuperLU:
        """Factorisation of the reduced stiffness matrix."""
        if self._lu is None:
            self._lu = factorise(self.stiffness)
        return self._lu

    def forget_factors(self) -> None:
        """Free the memory of the factorisation; it is made again when needed.  Modes stay."""
        self._lu = None

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
        flexibility = reduced @ self.contact_response(contact)
        return 0.5 * (flexibility + flexibility.conj().T)
