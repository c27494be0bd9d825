r"""Inside of a sector, factorised once for all nodal diameters.

The phase condition of a travelling wave ties the faces of a sector to each other, and only them.
The inside is real and common to all nodal diameters.  With degrees of freedom i of the inside and f
of the faces,

.. math:: W = -K_{ii}^{-1} K_{if}, \qquad S = K_{ff} + K_{fi} W,

W has the static shapes of the faces, and the Schur complement S their stiffness.  With the matrix
:math:`T_f` of the phase condition on the faces, a nodal diameter only adds the small Hermitian
matrix :math:`T_f^H S\, T_f` (:class:`CondensedSolver`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cholesky, eigh, eigvalsh, lu_factor, lu_solve

from bdamper.fem.factorisation import Factors, factorise
from bdamper.fem.lowest_modes import lowest_modes
from bdamper.fem.sector_faces import SectorFaces
from bdamper.fem.surface import Structure, hermitian
from bdamper.util.progress import Report, no_report

STORED = 500e6
"""Largest size (bytes) of static shapes of the faces that are stored.  Larger ones are computed
again each time."""

COLUMNS = 64
"""Right-hand sides that are solved together, for memory."""


class SectorInside:
    """Inside of a sector with fixed faces, factorised once for all nodal diameters.

    Parameters
    ----------
    body : Structure
    faces : SectorFaces
    fixed : (n_nodes, 3) bool
        Fixed components.
    report : Report
        Receives the progress of long passes, also of the nodal diameters.

    Attributes
    ----------
    inner, face : (n_inner,), (n_face,) int
        Free degrees of freedom of the inside and of the faces.
    """

    def __init__(
        self, body: Structure, faces: SectorFaces, fixed: NDArray, report: Report = no_report
    ) -> None:
        self.body = body
        self.report = report
        moving = ~fixed.ravel()
        on_faces = np.zeros(body.n_dof, bool)
        on_faces[body.dofs(faces.nodes)] = True
        self.face: NDArray = np.flatnonzero(moving & on_faces)
        self.inner: NDArray = np.flatnonzero(moving & ~on_faces)
        self._held: tuple[NDArray, NDArray] | None = None
        self._momentum_of_held: NDArray = np.zeros((len(self.face), 0))

    @cached_property
    def stiffness(self) -> sp.csr_matrix:
        """Stiffness (n_inner, n_inner) of the inside with fixed faces."""
        return self.body.stiffness[self.inner][:, self.inner]

    @cached_property
    def mass(self) -> sp.csr_matrix:
        """Mass (n_inner, n_inner) of the inside with fixed faces."""
        return self.body.mass[self.inner][:, self.inner]

    @cached_property
    def factors(self) -> Factors:
        """Factorisation of the stiffness of the inside with fixed faces."""
        self.report("factorisation", 0, 1)
        factors = factorise(self.stiffness)
        self.report("factorisation", 1, 1)
        return factors

    @cached_property
    def coupling(self) -> sp.csc_matrix:
        """Stiffness (n_inner, n_face) between inside and faces."""
        return self.body.stiffness[self.inner][:, self.face].tocsc()

    def _blocks_of_faces(self, name: str) -> Iterator[slice]:
        """Iterate over the degrees of freedom of the faces in blocks, a pass that is reported."""
        return reported_blocks(len(self.face), name, self.report)

    @cached_property
    def _condensed(self) -> tuple[NDArray, NDArray | None]:
        """Stiffness of the faces, and their static shapes W unless they are too large."""
        stiffness = self.body.stiffness[self.face][:, self.face].toarray()
        factors = self.factors
        shapes = None
        if 8 * len(self.inner) * len(self.face) <= STORED:
            shapes = np.empty((len(self.inner), len(self.face)))
        for columns in self._blocks_of_faces("static shapes of the faces"):
            shape = -factors.solve(self.coupling[:, columns].toarray())
            stiffness[:, columns] += self.coupling.T @ shape
            if shapes is not None:
                shapes[:, columns] = shape
        return hermitian(stiffness), shapes

    @property
    def face_stiffness(self) -> NDArray:
        """Stiffness (n_face, n_face) of the faces with a free inside, the Schur complement."""
        return self._condensed[0]

    def static_shape(self, motion: NDArray) -> NDArray:
        """Return the displacement (n_inner, n) of the inside for a motion (n_face, n) of the
        faces."""
        shapes = self._condensed[1]
        if shapes is None:
            return -self.factors.solve(self.coupling @ motion)
        # the shapes are real: a product with a complex matrix would convert all of them
        if np.iscomplexobj(motion):
            return np.asarray(shapes @ motion.real + 1j * (shapes @ motion.imag))
        return np.asarray(shapes @ motion)

    def force_on_faces(self, force: NDArray) -> NDArray:
        """Return the forces (n_face, n) on the faces that do the same work on their static shapes
        as ``force`` (n_inner, n) on the inside."""
        shapes = self._condensed[1]
        if shapes is None:
            return np.asarray(-self.coupling.T @ self.factors.solve(force))
        return np.asarray(shapes.T @ force)

    @cached_property
    def face_mass(self) -> NDArray:
        """Mass (n_face, n_face) of the static shapes of the faces."""
        of_face = self.body.mass[self.face].tocsc()
        mass = of_face[:, self.face].toarray()
        to_face = of_face[:, self.inner]
        unit_motions = np.eye(len(self.face))
        # the shapes themselves come first
        _ = self._condensed
        for columns in self._blocks_of_faces("mass of the static shapes"):
            unit = unit_motions[:, columns]
            shape = self.static_shape(unit)
            momentum = self.mass @ shape + to_face.T @ unit
            mass[:, columns] += to_face @ shape
            mass[:, columns] += self.force_on_faces(momentum)
        return np.asarray(hermitian(mass))

    def held_modes(self, n_modes: int) -> tuple[NDArray, NDArray]:
        """Return squared frequencies (n_modes,) and modes (n_inner, n_modes) with fixed faces."""
        if self._held is None or len(self._held[0]) < n_modes:
            self._held = lowest_modes(
                self.stiffness, self.mass, self.factors.solve, n_modes, report=self.report
            )
            self._momentum_of_held = np.zeros((len(self.face), 0))
        omega2, shapes = self._held
        return omega2[:n_modes], shapes[:, :n_modes]

    def held_momentum(self, n_modes: int) -> NDArray:
        """Return the momentum (n_face, n_modes) of the modes with fixed faces on the static shapes
        of the faces.
        """
        _, held = self.held_modes(n_modes)
        n_held = held.shape[1]
        if self._momentum_of_held.shape[1] < n_held:
            momentum = self.body.mass[self.face][:, self.inner] @ held
            name = "mass of modes with held faces"
            for columns in reported_blocks(n_held, name, self.report):
                momentum[:, columns] += self.force_on_faces(self.mass @ held[:, columns])
            self._momentum_of_held = momentum
        return self._momentum_of_held[:, :n_held]

    def modes(self, transformation: sp.csr_matrix, n_modes: int) -> tuple[NDArray, NDArray]:
        """Compute approximate lowest modes of a nodal diameter without its own eigenproblem.

        The shapes are combinations of static shapes of the faces and of ``4 * n_modes`` modes of
        the inside with fixed faces.

        Parameters
        ----------
        transformation : (3 n_nodes, n_independent) sparse
            Matrix of the phase condition.
        n_modes : int

        Returns
        -------
        omega2 : (n_modes,) float, rad2/s2
        shapes : (3 n_nodes, n_modes) float or complex, kg^-1/2
        """
        of_held, held = self.held_modes(4 * n_modes)
        tie, _ = face_ties(self, transformation)
        adjoint = tie.conj().T
        n_held = len(of_held)
        size = n_held + tie.shape[1]

        # of the inside: held modes are orthonormal, and have no strain energy with static shapes
        stiffness = np.zeros((size, size), tie.dtype)
        mass = np.zeros((size, size), tie.dtype)
        stiffness[:n_held, :n_held] = np.diag(of_held)
        mass[:n_held, :n_held] = np.eye(n_held)
        # of the faces
        stiffness[n_held:, n_held:] = adjoint @ (self.face_stiffness @ tie)
        mass[n_held:, n_held:] = adjoint @ (self.face_mass @ tie)
        # between both
        mass[n_held:, :n_held] = adjoint @ self.held_momentum(4 * n_modes)
        mass[:n_held, n_held:] = mass[n_held:, :n_held].conj().T

        last = min(n_modes, size) - 1
        omega2, combination = eigh(hermitian(stiffness), hermitian(mass), subset_by_index=(0, last))
        motion = tie @ combination[n_held:]
        shapes = np.zeros((self.body.n_dof, len(omega2)), combination.dtype)
        shapes[self.face] = motion
        shapes[self.inner] = held @ combination[:n_held] + self.static_shape(motion)
        return omega2, shapes


def reported_blocks(n_columns: int, name: str, report: Report) -> Iterator[slice]:
    """Iterate over columns in blocks of :data:`COLUMNS`; report the finished blocks of the pass."""
    starts = range(0, n_columns, COLUMNS)
    for k, start in enumerate(starts):
        report(name, k, len(starts))
        yield slice(start, start + COLUMNS)
    report(name, len(starts), len(starts))


def face_ties(inside: SectorInside, transformation: sp.csr_matrix) -> tuple[sp.csr_matrix, NDArray]:
    """Return the phase condition (n_face, n_outer) on the faces and the independent degrees of
    freedom (n_outer,) that it has."""
    tie = transformation[inside.face]
    outer = np.unique(tie.indices)
    return tie[:, outer], outer


class CondensedSolver:
    """Solver of one nodal diameter, with the factorisation of the inside that all of them share.

    Parameters
    ----------
    inside : SectorInside
    transformation : (3 n_nodes, n_independent) sparse
        Matrix of the phase condition; it leaves the inside alone.
    """

    def __init__(self, inside: SectorInside, transformation: sp.csr_matrix) -> None:
        self.inside = inside
        # each degree of freedom of the inside is independent
        self._inner = transformation[inside.inner].indices
        self._tie, self._outer = face_ties(inside, transformation)
        self._adjoint = self._tie.conj().T.tocsr()
        self._stiffness = hermitian(self._adjoint @ (inside.face_stiffness @ self._tie))

    @cached_property
    def _factors(self) -> tuple[NDArray, NDArray]:
        # the stiffness of a rotating sector may be indefinite
        return lu_factor(self._stiffness)

    @property
    def pivots(self) -> NDArray:
        """Pivots (n_independent,); they have the signs of the eigenvalues if those of the inside
        have them."""
        if len(self._outer) == 0:
            return self.inside.factors.pivots
        try:
            of_faces = np.diag(cholesky(self._stiffness)).real ** 2
        except LinAlgError:
            of_faces = eigvalsh(self._stiffness)
        return np.append(self.inside.factors.pivots, of_faces)

    def solve(self, force: NDArray) -> NDArray:
        """Return the displacements (n_independent, ...) under forces (n_independent, ...)."""
        columns = force.reshape(len(force), -1)
        inner = self.inside.factors.solve(columns[self._inner])
        outer = columns[self._outer]
        if len(outer):
            reaction = self._adjoint @ (self.inside.coupling.T @ inner)
            outer = lu_solve(self._factors, outer - reaction)
            inner = inner + self.inside.static_shape(self._tie @ outer)
        displacement = np.empty(columns.shape, np.result_type(inner, outer))
        displacement[self._outer] = outer
        displacement[self._inner] = inner
        return displacement.reshape(force.shape)
