r"""Rotating bodies: static displacement, and change of modes and flexibility with rotor speed.

In the rotating frame, with E = diag(1, 1, 0) at every node, the mass in the plane of rotation is
:math:`M_s = M E`, and

.. math:: K(\Omega) = K_0 + \Omega^2 B, \qquad B = K_\sigma - M_s, \qquad K_0 u_s = M_s x

with the geometric stiffness :math:`K_\sigma` of the stress of the static displacement
:math:`\Omega^2 u_s` at nodal diameter 0, the same for all nodal diameters.  Stiffness is linear in
the squared speed.  The difference of two stiffness matrices at different speeds, from any program,
thus gives B.  In modal coordinates at one speed it is :math:`\Phi^H B \Phi`.  The residual
flexibility of these modes,

.. math:: R_{res}(\Omega) = P K(\Omega)^{-1} P^H - P \Phi\, [\Phi^H K(\Omega) \Phi]^{-1} \Phi^H P^H ,

is positive semi-definite if both terms use the modes of the same speed.  Its derivative with
respect to the squared speed follows from the static solutions :math:`X = K^{-1} P^H` of the
flexibility:

.. math:: \frac{dR_{res}}{d\Omega^2} = - X^H B X + P \Phi\, \omega^{-2}\, \Phi^H B \Phi\, \omega^{-2} \Phi^H P^H .

On the shipped disk at 600 rad/s the error of this linearisation is 5e-4 of the residual flexibility
with 40 modes (2e-3 with ten), and 4e-7 (3e-5) of the frequencies.  The modes at one speed cannot
represent the modes at another speed if rotation stiffens part of the blade.  If the matrices of a
second speed are given, the static shapes of the basis contain its modes as well, and the
frequencies are exact at both speeds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import eigh

from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.surface import Structure, hermitian, require
from bdamper.model.modal_basis import ModalBasis, SpeedBasis

IN_PLANE = np.diag([1.0, 1.0, 0.0])
_ACROSS = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # e_z x


def _of_nodes(structure: Structure, matrix: NDArray) -> sp.csr_matrix:
    return sp.kron(sp.identity(len(structure.nodes)), matrix, format="csr")


def centrifugal_force(structure: Structure) -> NDArray:
    """Return the nodal forces (3 n_nodes,) of rotation about Z per squared speed, kg m."""
    return structure.body_force(structure.nodes @ IN_PLANE).ravel()


def spin_softening(structure: Structure) -> sp.csr_matrix:
    """Return the mass in the plane of rotation (3 n_nodes, 3 n_nodes), kg.

    It is the decrease of stiffness per squared speed.
    """
    plane = _of_nodes(structure, IN_PLANE)
    return (plane @ structure.mass @ plane).tocsr()


def coriolis_matrix(structure: Structure) -> sp.csr_matrix:
    """Return the skew-symmetric matrix S (3 n_nodes, 3 n_nodes), kg.

    Coriolis forces are ``-2 Omega S du/dt``.
    """
    matrix = structure.mass @ _of_nodes(structure, _ACROSS)
    # the product is skew-symmetric but for rounding
    skew = 0.5 * (matrix - matrix.T)
    return skew.tocsr()


def spin_displacement(sector: CyclicSector) -> NDArray:
    """Return the static displacement (3 n_nodes,) due to rotation per squared speed, m s2.

    The sector has no contact.

    Parameters
    ----------
    sector : CyclicSector
        At nodal diameter 0, with the stiffness at standstill (linear theory) or at the speed
        (stiffened blades).
    """
    require(
        sector.nodal_diameter == 0,
        f"the displacement due to rotation has nodal diameter 0, not {sector.nodal_diameter}",
    )
    force = centrifugal_force(sector.body)
    independent = sector.static_response(force[:, None])
    displacement = sector.transformation @ independent
    return np.asarray(displacement)[:, 0]


@dataclass(frozen=True)
class Rotation:
    """Change of the stiffness of a body with rotor speed.

    Parameters
    ----------
    per_squared_speed : (3 n_nodes, 3 n_nodes) sparse, kg
        Symmetric: geometric stiffness minus spin softening.
    omega_ref : float, rad/s
        Speed at which the stiffness of the body is valid.
    check_at : float, rad/s, optional
        Second speed at which the frequencies of the full matrices are computed, at the cost of one
        factorisation.
    source : str
    """

    per_squared_speed: sp.csr_matrix
    omega_ref: float = 0.0
    check_at: float | None = None
    source: str = ""

    def at_speed(self, sector: CyclicSector, omega: float) -> CyclicSector:
        """Return a sector that is valid at ``omega_ref`` with the stiffness at another speed.

        ``omega`` is in rad/s.
        """
        change = (omega**2 - self.omega_ref**2) * self.per_squared_speed
        stiffness = sector.body.stiffness + change
        # another stiffness has its own inside
        return replace(sector, body=replace(sector.body, stiffness=stiffness), inside=None)

    def at_second_speed(self, sector: CyclicSector) -> CyclicSector | None:
        """Return the sector at the second speed, or None without one."""
        return None if self.check_at is None else self.at_speed(sector, self.check_at)

    def basis(
        self,
        basis: ModalBasis,
        sector: CyclicSector,
        shapes: NDArray,
        contact: sp.spmatrix,
        faster: CyclicSector | None = None,
    ) -> ModalBasis:
        """Add the speed dependence to the basis of a sector.

        Parameters
        ----------
        basis : ModalBasis
            Modes of ``sector`` and its flexibility.
        sector : CyclicSector
            Sector with the stiffness at the speed ``omega_ref``.
        shapes : (3 n_nodes, n_modes)
            Modes of the basis on all nodes.
        contact : (3 n_points, 3 n_nodes) sparse
            Matrix from nodal displacements to contact points.
        faster : CyclicSector, optional
            Sector at the second speed (:meth:`at_second_speed`), for a comparison of frequencies.
        """
        modal_stiffness = hermitian(shapes.conj().T @ (self.per_squared_speed @ shapes))

        # change of the residual flexibility: that of the modes less that of all static shapes
        static = sector.transformation @ sector.contact_response(contact)
        modal = contact @ shapes / basis.omega2
        of_modes = modal @ modal_stiffness @ modal.conj().T
        of_all = static.conj().T @ (self.per_squared_speed @ static)
        residual = hermitian(of_modes - of_all)
        with_speed = basis.with_speed(modal_stiffness, residual, self.omega_ref, source=self.source)
        assert with_speed.speed is not None

        modal_coriolis = shapes.conj().T @ (coriolis_matrix(sector.body) @ shapes)
        skew = 0.5 * (modal_coriolis - modal_coriolis.conj().T)
        speed = replace(with_speed.speed, coriolis=skew)
        if faster is not None and self.check_at is not None:
            errors = [
                frequency_error(speed, sector, self.omega_ref, basis.n_natural),
                frequency_error(speed, faster, self.check_at, basis.n_natural),
            ]
            speed = replace(speed, checked_at=self.check_at, error=max(errors))
        return replace(with_speed, speed=speed)


def frequency_error(basis: SpeedBasis, sector: CyclicSector, omega: float, n_natural: int) -> float:
    """Return the largest relative error of the ten lowest frequencies of a basis at a speed.

    Parameters
    ----------
    basis : SpeedBasis
    sector : CyclicSector
        Full matrices at this speed.
    omega : float, rad/s
    n_natural : int
        Number of modes of the basis without its static shapes.
    """
    exact_squares, _ = sector.modes(min(10, n_natural))
    reduced_squares = eigh(basis.stiffness(omega), eigvals_only=True)[: len(exact_squares)]
    error = np.abs(np.sqrt(reduced_squares / exact_squares) - 1.0)
    return float(error.max())
