r"""Cyclic symmetry: one sector at one nodal diameter (paper, Eq. 17), and travelling waves from
modes of other programs.

A travelling wave of nodal diameter d is :math:`u^{(k+1)} = R\,u^{(k)} e^{i\varphi}` with
:math:`\varphi = 2\pi d/N` and the rotation R from sector k to sector k+1
(:func:`bdamper.model.structure.turn`).  The right face of sector 0 is the left face of sector 1, so
with :math:`x_R = R x_L`

.. math:: u(x_R) = e^{i\varphi} R\, u(x_L),

by interpolation if the meshes of the faces differ (:mod:`bdamper.fem.sector_faces`).  With the
matrix T from the independent to all degrees of freedom, the Hermitian eigenproblem of one sector is
:math:`(T^H K T - \omega^2 T^H M T)\,q = 0`, :math:`u = T q`, :math:`u^H M u = 1`.  The matrices are
real for d = 0 and d = N/2.  Modes (shift and invert about zero) and static receptances of all nodal
diameters share the factorisation of the inside (:mod:`bdamper.fem.sector_inside`).

The lowest modes of a slender blade are up to 1e5 times softer than the remaining response, which
residual modes describe. In the complete solution, this remainder would be lost in rounding.  It is
therefore computed separately: with modes :math:`\Phi`, frequencies :math:`\Omega` and
:math:`P = 1 - \Phi \Phi^H M`,

.. math:: K^{-1} f = P\,K^{-1} P^H f + \Phi\,\Omega^{-2}\,\Phi^H f .

Programs differ in the sign of the phase, in the numbering of sectors, and in the representation of
waves by real shapes. :func:`travelling_waves` uses the condition above at matching nodes of the
faces to find the waves toward +X.  A complex shape that satisfies it with the opposite phase is
replaced by its conjugate.  Two real shapes a, b of one frequency are combined to :math:`a + c\,b`
by least squares,

.. math:: c = - \frac{\langle \delta b, \delta a\rangle}{\langle \delta b, \delta b\rangle},\qquad
          \delta u = u(x_R) - e^{2\pi i d/N} R\,u(x_L) .

For d = 0 and d = N/2 every shape is real up to a factor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import null_space

from bdamper.fem.lowest_modes import lowest_modes
from bdamper.fem.sector_faces import SectorFaces
from bdamper.fem.sector_inside import CondensedSolver, SectorInside, reported_blocks
from bdamper.fem.surface import Structure, hermitian, require
from bdamper.model.modal_basis import fix_phase
from bdamper.util.progress import Report, no_report

# ---- Cyclic sector ----


def fixed_components(n_nodes: int, clamped: NDArray) -> NDArray:
    """Return the fixed components (n_nodes, 3) bool of clamped nodes (n,) or of such a mask."""
    clamped = np.asarray(clamped)
    if clamped.dtype == bool and clamped.shape == (n_nodes, 3):
        return clamped
    fixed = np.zeros((n_nodes, 3), bool)
    fixed[clamped] = True
    return fixed


def cyclic_transformation(
    n_nodes: int, faces: SectorFaces, clamped: NDArray, nodal_diameter: int
) -> sp.csr_matrix:
    """Return the matrix T (3 n_nodes, n_independent) of the phase condition.

    Parameters
    ----------
    n_nodes : int
    faces : SectorFaces
    clamped : (n,) int or (n_nodes, 3) bool
        Clamped nodes, or fixed components.  A rotation about Z mixes X and Y, so on the faces both
        or neither are fixed.
    nodal_diameter : int

    Raises
    ------
    ValueError
        If the fixed components of the faces contradict the phase condition.
    """
    fixed = fixed_components(n_nodes, clamped)
    left, right = faces.independent, faces.dependent
    if faces.matching:
        images = (faces.weights @ fixed[left].astype(float)) > 0.5
        require(
            (images == fixed[right]).all(),
            "a clamped node of one sector face has a free image on the other",
        )
    fixed_alike = (fixed[faces.nodes, 0] == fixed[faces.nodes, 1]).all()
    require(
        faces.n_sectors == 1 or fixed_alike,
        "a node of a sector face is fixed in only one of the directions X and Y, which a "
        "rotation mixes",
    )
    # displacements of the independent nodes, and of nodes tied to the other face
    independent = np.ones(n_nodes, bool)
    independent[right] = False
    phase, rotation = faces.tie(nodal_diameter)
    weights = faces.weights.tocoo()
    places = (right[weights.row], left[weights.col])
    tied = sp.csr_matrix((weights.data, places), shape=(n_nodes, n_nodes))
    own_motion = sp.kron(sp.diags(independent.astype(float)), np.eye(3))
    t = own_motion + sp.kron(tied, phase * rotation)
    t = (sp.diags((~fixed.ravel()).astype(float)) @ t.tocsr()).tocsc()
    independent[faces.axis] = False
    free_components = (independent[:, None] & ~fixed).ravel()
    columns = [t[:, np.flatnonzero(free_components)]]
    # a node on the axis is its own image, so only some of its motions satisfy the condition
    axis = faces.axis[~fixed[faces.axis].any(axis=1)]
    if len(axis):
        free_motion = null_space(np.eye(3) - phase * rotation)
        axis_nodes = sp.identity(n_nodes, format="csc")[:, axis]
        columns.append(t @ sp.kron(axis_nodes, free_motion))
    t = sp.hstack(columns).tocsr()
    t.eliminate_zeros()
    return t.tocsr()


@dataclass
class CyclicSector:
    """One sector at one nodal diameter: reduced matrices, factorisation and modes, computed on
    demand.

    Parameters
    ----------
    body : Structure
    faces : SectorFaces
        Faces of the sector, or :func:`bdamper.fem.sector_faces.no_faces`.
    clamped : int array or mask
        Clamped nodes or components, see :func:`cyclic_transformation`.
    nodal_diameter : int
    inside : SectorInside, optional
        Factorisation that the sectors of several nodal diameters share; by default its own.
    """

    body: Structure
    faces: SectorFaces
    clamped: NDArray
    nodal_diameter: int
    inside: SectorInside | None = field(default=None, repr=False)
    _modes: tuple[NDArray, NDArray] | None = field(default=None, init=False, repr=False)
    _reduced_shapes: NDArray | None = field(default=None, init=False, repr=False)
    _contact: tuple[sp.spmatrix, NDArray] | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        self.transformation = cyclic_transformation(
            len(self.body.nodes), self.faces, self.clamped, self.nodal_diameter
        )
        if self.inside is None:
            self.inside = sector_inside(self.body, self.faces, self.clamped)
        self._report = self.inside.report

    def _reduced(self, matrix: sp.spmatrix) -> sp.csr_matrix:
        adjoint = self.transformation.conj().T
        return (adjoint @ matrix @ self.transformation).tocsr()

    @cached_property
    def stiffness(self) -> sp.csr_matrix:
        """Reduced stiffness matrix (n_independent, n_independent)."""
        return self._reduced(self.body.stiffness)

    @cached_property
    def mass(self) -> sp.csr_matrix:
        """Reduced mass matrix (n_independent, n_independent)."""
        return self._reduced(self.body.mass)

    @cached_property
    def solver(self) -> CondensedSolver:
        """Solver with the reduced stiffness matrix."""
        assert self.inside is not None
        return CondensedSolver(self.inside, self.transformation)

    def forget_matrices(self) -> None:
        """Free the memory of reduced matrices, solver and contact response, but keep the modes."""
        for name in ("solver", "stiffness", "mass"):
            vars(self).pop(name, None)
        self._contact = None

    def modes(self, n_modes: int) -> tuple[NDArray, NDArray]:
        """Compute the lowest modes.

        Returns
        -------
        omega2 : (n_modes,) float, rad2/s2
        shapes : (3 n_nodes, n_modes) float or complex, kg^-1/2
            Mode shapes on all nodes of the sector.
        """
        if self._modes is None or len(self._modes[0]) < n_modes:
            omega2, reduced = lowest_modes(
                self.stiffness, self.mass, self.solver.solve, n_modes, report=self._report
            )
            self._reduced_shapes = reduced
            self._modes = omega2, fix_phase(self.transformation @ reduced, self.body.mass)
        return self._modes[0][:n_modes], self._modes[1][:, :n_modes]

    def approximate_modes(self, n_modes: int) -> tuple[NDArray, NDArray]:
        """Return the lowest modes, from the modes of the inside unless they have been computed.

        See :meth:`bdamper.fem.sector_inside.SectorInside.modes`.
        """
        if self._modes is not None and len(self._modes[0]) >= n_modes:
            return self.modes(n_modes)
        assert self.inside is not None
        return self.inside.modes(self.transformation, n_modes)

    def static_response(self, load: sp.spmatrix | NDArray) -> NDArray:
        """Return displacements (n_independent, n) under ``load`` (3 n_nodes, n) on all nodes of the
        sector."""
        force = self.transformation.conj().T @ load
        force = force.toarray() if sp.issparse(force) else np.asarray(force)
        displacement = np.empty(force.shape, self.stiffness.dtype)
        # in blocks, because the response without the modes has several arrays of this size
        for columns in reported_blocks(force.shape[1], "static shapes", self._report):
            displacement[:, columns] = self._static_response(force[:, columns])
        return displacement

    def _static_response(self, force: NDArray) -> NDArray:
        """Return displacements (n_independent, n) under forces (n_independent, n)."""
        if self._modes is None or self._reduced_shapes is None:
            return self._solve(force)
        omega2, shapes = self._modes[0], self._reduced_shapes
        modal_force = shapes.conj().T @ force
        rest_of_force = force - self.mass @ (shapes @ modal_force)
        rest = self._without_modes(self._solve(rest_of_force))
        # one step of refinement
        rest += self._without_modes(self._solve(rest_of_force - self.stiffness @ rest))
        return rest + shapes @ (modal_force / omega2[:, None])

    def _solve(self, force: NDArray) -> NDArray:
        """Apply the inverse of the reduced stiffness to forces (n_independent, n)."""
        of_sector = force.astype(self.stiffness.dtype)
        return self.solver.solve(np.ascontiguousarray(of_sector))

    def _without_modes(self, displacement: NDArray) -> NDArray:
        """Return displacements (n_independent, n) without their part in the modes."""
        shapes = self._reduced_shapes
        assert shapes is not None
        return displacement - shapes @ (shapes.conj().T @ (self.mass @ displacement))

    def contact_response(self, contact: sp.spmatrix) -> NDArray:
        """Return displacements (n_independent, n) under unit forces on the rows of ``contact``
        (n, 3 n_nodes); cached."""
        if self._contact is None or self._contact[0] is not contact:
            self._contact = contact, self.static_response(contact.T)
        return self._contact[1]

    def receptance(self, contact: sp.spmatrix) -> NDArray:
        """Return the static receptance (n, n) between the rows of ``contact``
        (n, 3 n_nodes), m/N."""
        reduced = contact @ self.transformation
        return hermitian(reduced @ self.contact_response(contact))


def sector_inside(
    body: Structure, faces: SectorFaces, clamped: NDArray, report: Report = no_report
) -> SectorInside:
    """Return the inside of a sector for all nodal diameters, which reports its long passes.

    ``clamped`` has clamped nodes or components, see :func:`cyclic_transformation`.
    """
    return SectorInside(body, faces, fixed_components(len(body.nodes), clamped), report)


Sectors = Callable[[int], CyclicSector]
"""Sector as a function of the nodal diameter."""


# ---- Travelling waves from modes of other programs ----


PAIR_TOLERANCE, PHASE_TOLERANCE = 1e-4, 1e-3
"""Relative difference of the frequencies of two real shapes of one wave; relative violation of the
phase condition."""


@dataclass(frozen=True)
class Waves:
    """Travelling waves toward +X.

    Parameters
    ----------
    index : (n,) int
        Number of the (first) shape in the file for each wave.
    shapes : (3 n_nodes, n) complex, or float for d = 0 and N/2
        Wave shapes with the normalisation of the file.
    mismatch : (n,) float
        Largest violation of the phase condition, relative to the size on the faces.
    turned : int
        Number of waves in the opposite direction in the file.
    combined : int
        Number of waves from two real shapes.
    """

    index: NDArray
    shapes: NDArray
    mismatch: NDArray
    turned: int
    combined: int


def _difference(shapes: NDArray, faces: SectorFaces, d: int) -> NDArray:
    """Return the violation of the phase condition on the faces, (k, n)."""
    n_shapes = shapes.shape[1]
    u = shapes.reshape(-1, 3, n_shapes)
    phase, rotation = faces.tie(d)
    independent = u[faces.independent].reshape(len(faces.independent), -1)
    interpolated = (faces.weights @ independent).reshape(-1, 3, n_shapes)
    images = phase * np.einsum("ij,njm->nim", rotation, interpolated)
    return np.asarray(u[faces.dependent] - images).reshape(-1, n_shapes)


def travelling_waves(
    frequency: NDArray, shapes: NDArray, faces: SectorFaces, nodal_diameter: int
) -> Waves:
    """Convert shapes of other programs to waves toward +X.

    Parameters
    ----------
    frequency : (m,) float, Hz
    shapes : (3 n_nodes, m) float or complex
        Mode shapes in the axes of the model.
    faces : SectorFaces
    nodal_diameter : int

    Raises
    ------
    ValueError
        If a shape or a pair of shapes is not a wave of this nodal diameter.
    """
    d, n = nodal_diameter, faces.n_sectors
    require(0 <= d <= n // 2, f"nodal diameter {d}: expected 0 to {n // 2} with {n} sectors")
    size = np.linalg.norm(shapes.reshape(-1, 3, len(frequency))[faces.nodes], axis=(0, 1))
    whole = np.linalg.norm(shapes, axis=0)
    # the motion of the faces determines the phase; where they hardly move, a millionth of the motion
    # of all nodes is the scale, so that rounding does not look like a wrong phase
    size = np.maximum(size, 1e-6 * whole)
    if 2 * d % n == 0:
        return _standing(frequency, shapes, faces, d, size)
    if np.iscomplexobj(shapes) and np.abs(shapes.imag).max() > 1e-9 * np.abs(shapes).max():
        return _complex_waves(frequency, shapes, faces, d, size)
    return _combined(frequency, shapes, faces, d, size)


def _complex_waves(
    frequency: NDArray, shapes: NDArray, faces: SectorFaces, d: int, size: NDArray
) -> Waves:
    """Replace shapes that travel the other way by their conjugates."""
    forward_error = np.linalg.norm(_difference(shapes, faces, d), axis=0) / size
    backward_error = np.linalg.norm(_difference(shapes.conj(), faces, d), axis=0) / size
    error = np.minimum(forward_error, backward_error)
    _refuse(error, frequency, d, "mode")
    backward = backward_error < forward_error
    toward_x = np.where(backward, shapes.conj(), shapes)
    return Waves(
        index=np.arange(len(frequency)),
        shapes=toward_x,
        mismatch=error,
        turned=int(backward.sum()),
        combined=0,
    )


def _combined(
    frequency: NDArray, shapes: NDArray, faces: SectorFaces, d: int, size: NDArray
) -> Waves:
    """Combine each pair of real mode shapes with the same frequency into a travelling wave."""
    difference = _difference(shapes, faces, d)
    real = shapes.real
    index: list[int] = []
    waves, errors = [], []
    for k in range(0, len(frequency), 2):
        is_last = k + 1 == len(frequency)
        if is_last and index:
            break  # the partner of the last shape was not written
        if is_last or abs(frequency[k + 1] - frequency[k]) > PAIR_TOLERANCE * frequency[k]:
            raise ValueError(
                f"nodal diameter {d}: the shape of {frequency[k]:.6g} Hz has no partner of the "
                "same frequency, and a single real shape cannot form a travelling wave"
            )
        a, b = difference[:, k], difference[:, k + 1]
        c = -np.vdot(b, a) / max(np.vdot(b, b).real, 1e-300)
        size_of_pair = np.hypot(size[k], abs(c) * size[k + 1])
        errors.append(float(np.linalg.norm(a + c * b) / size_of_pair))
        index.append(k)
        waves.append(real[:, k] + c * real[:, k + 1])
    error = np.array(errors)
    first = np.array(index, int)
    _refuse(error, frequency[first], d, "pair of modes")
    return Waves(
        index=first, shapes=np.array(waves).T, mismatch=error, turned=0, combined=len(index)
    )


def _standing(
    frequency: NDArray, shapes: NDArray, faces: SectorFaces, d: int, size: NDArray
) -> Waves:
    """Remove the common phase of each shape at nodal diameters 0 and N/2, and check the faces."""
    if np.iscomplexobj(shapes):
        square = np.einsum("ij,ij->j", shapes, shapes)
        shapes = shapes * np.exp(-0.5j * np.angle(square))
        size_of_shape = np.maximum(np.linalg.norm(shapes, axis=0), 1e-300)
        imaginary_part = np.linalg.norm(shapes.imag, axis=0) / size_of_shape
        _refuse(imaginary_part, frequency, d, "imaginary part of the mode")
        shapes = shapes.real
    error = np.linalg.norm(_difference(shapes, faces, d), axis=0) / size
    _refuse(error, frequency, d, "mode")
    return Waves(
        index=np.arange(len(frequency)),
        shapes=np.array(shapes),
        mismatch=error,
        turned=0,
        combined=0,
    )


def _refuse(error: NDArray, frequency: NDArray, d: int, what: str) -> None:
    """Raise ValueError if the error of a shape is too large, or NaN."""
    if len(error) == 0 or error.max() <= PHASE_TOLERANCE:
        return
    worst = int(np.argmax(error))
    raise ValueError(
        f"nodal diameter {d}: the {what} at {frequency[worst]:.6g} Hz does not satisfy the phase "
        "condition between the two sector faces for a wave of this nodal diameter, "
        f"in either direction of travel (off by {100.0 * error[worst]:.3g} %)"
    )
