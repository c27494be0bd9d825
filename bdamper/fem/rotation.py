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
represent the modes at another speed if rotation stiffens part of the blade.  If the matrices of
further speeds are given, the static shapes of the basis contain their modes as well, and the
frequencies are exact at these speeds.  The residual flexibility is then interpolated between its
values at the given speeds: the derivative made that of a thin shrouded blade negative from 200 of
1,000 rad/s on.

With matrices at a middle speed :math:`\Omega_m` the stiffness has another term, as the geometric
stiffness of large deflections does:

.. math:: K(\Omega) = K_0 + (\Omega^2 - \Omega_0^2) B + (\Omega^2 - \Omega_0^2)(\Omega^2 - \Omega_1^2) Q .
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.surface import Structure, hermitian, require
from bdamper.model.modal_basis import ModalBasis

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
        Second speed, at which frequencies and flexibility of the full matrices are computed, at the
        cost of one factorisation.
    middle : float, rad/s, optional
        Third speed, between both.
    bend : (3 n_nodes, 3 n_nodes) sparse, kg s2, optional
        Symmetric matrix Q of the module, with which the stiffness at the third speed is exact.
    source : str
    """

    per_squared_speed: sp.csr_matrix
    omega_ref: float = 0.0
    check_at: float | None = None
    middle: float | None = None
    bend: sp.csr_matrix | None = None
    source: str = ""

    def stiffening(self, omega: float) -> sp.csr_matrix:
        """Return the change (3 n_nodes, 3 n_nodes) of the stiffness from ``omega_ref`` to a speed."""
        from_first = omega**2 - self.omega_ref**2
        change = from_first * self.per_squared_speed
        if self.bend is not None and self.check_at is not None:
            change = change + from_first * (omega**2 - self.check_at**2) * self.bend
        return change

    def at_speed(self, sector: CyclicSector, omega: float) -> CyclicSector:
        """Return a sector that is valid at ``omega_ref`` with the stiffness at another speed.

        ``omega`` is in rad/s.
        """
        stiffness = sector.body.stiffness + self.stiffening(omega)
        # another stiffness has its own inside
        return replace(sector, body=replace(sector.body, stiffness=stiffness), inside=None)

    @property
    def other_speeds(self) -> tuple[float, ...]:
        """Speeds (rad/s) in addition to ``omega_ref`` at which the full matrices are known."""
        return tuple(omega for omega in (self.middle, self.check_at) if omega is not None)

    def at_other_speeds(self, sector: CyclicSector) -> list[CyclicSector]:
        """Return the sector at each of the :attr:`other_speeds`."""
        return [self.at_speed(sector, omega) for omega in self.other_speeds]

    def basis(
        self,
        basis: ModalBasis,
        sector: CyclicSector,
        shapes: NDArray,
        contact: sp.spmatrix,
        others: Sequence[CyclicSector] = (),
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
        others : sequence of CyclicSector
            Sector at the other speeds (:meth:`at_other_speeds`).
        """
        # coefficients of the squared speed and its square
        linear = hermitian(shapes.conj().T @ (self.per_squared_speed @ shapes))
        quadratic = None
        if self.bend is not None and self.check_at is not None:
            quadratic = hermitian(shapes.conj().T @ (self.bend @ shapes))
            linear = linear - (self.omega_ref**2 + self.check_at**2) * quadratic
        modal_coriolis = shapes.conj().T @ (coriolis_matrix(sector.body) @ shapes)
        skew = 0.5 * (modal_coriolis - modal_coriolis.conj().T)
        stiffness = {"stiffness4": quadratic, "coriolis": skew, "source": self.source}

        if not others:
            slope = self._residual_slope(basis, sector, shapes, contact)
            return basis.with_speed(linear, slope, self.omega_ref, **stiffness)

        flexibilities = [other.receptance(contact) for other in others]
        without_residual = basis.with_speed(linear, None, self.omega_ref, **stiffness)
        speeds = np.array([self.omega_ref, *self.other_speeds])
        residuals = []
        for omega, flexibility in zip(speeds, [basis.flexibility, *flexibilities]):
            of_modes = modal_flexibility(without_residual, omega)
            residuals.append(hermitian(flexibility - of_modes))
        slopes = [
            (after - before) / interval
            for before, after, interval in zip(residuals, residuals[1:], np.diff(speeds**2))
        ]
        above = slopes[1] - slopes[0] if len(slopes) > 1 else None
        complete = basis.with_speed(
            linear,
            slopes[0],
            self.omega_ref,
            middle=self.middle,
            residual_above=above,
            **stiffness,
        )

        # the model that analyses use, against the matrices
        errors = [frequency_error(complete, sector, self.omega_ref)]
        flexibility_errors = []
        for omega, other, exact in zip(self.other_speeds, others, flexibilities):
            errors.append(frequency_error(complete, other, omega))
            flexibility_errors.append(flexibility_error(complete, exact, omega))
        assert complete.speed is not None
        speed = replace(
            complete.speed,
            checked_at=self.other_speeds[-1],
            error=max(errors),
            flexibility_error=max(flexibility_errors),
        )
        return replace(complete, speed=speed)

    def _residual_slope(
        self, basis: ModalBasis, sector: CyclicSector, shapes: NDArray, contact: sp.spmatrix
    ) -> NDArray:
        """Return the derivative of the residual flexibility with respect to the squared speed.

        The modes contribute with a positive sign, and the static shapes with a negative sign.
        """
        modal_stiffness = hermitian(shapes.conj().T @ (self.per_squared_speed @ shapes))
        static = sector.transformation @ sector.contact_response(contact)
        modal = contact @ shapes / basis.omega2
        of_modes = modal @ modal_stiffness @ modal.conj().T
        of_all = static.conj().T @ (self.per_squared_speed @ static)
        return hermitian(of_modes - of_all)


def modal_flexibility(basis: ModalBasis, omega: float) -> NDArray:
    """Return the static flexibility (3 n_points, 3 n_points) of the modes at a speed (rad/s)."""
    assert basis.speed is not None
    omega2, shapes = basis.speed.modes(omega)
    contact = (basis.contact_modes @ shapes).reshape(-1, len(omega2))
    return np.asarray((contact / omega2) @ contact.conj().T)


def flexibility_error(basis: ModalBasis, exact: NDArray, omega: float) -> float:
    """Return the largest error of the flexibility of a basis at a speed (rad/s).

    It is relative to the flexibilities of both components, in units of the ``exact`` matrix
    (3 n_points, 3 n_points).
    """
    at_speed, _ = basis.at_speed(omega)
    size = np.sqrt(np.diag(exact).real)
    difference = np.abs(at_speed.flexibility - exact)
    return float((difference / size / size[:, None]).max(initial=0.0))


def frequency_error(basis: ModalBasis, sector: CyclicSector, omega: float) -> float:
    """Return the largest relative error of the ten lowest frequencies of a basis at a speed.

    Parameters
    ----------
    basis : ModalBasis
    sector : CyclicSector
        Full matrices at this speed.
    omega : float, rad/s
    """
    exact_squares, _ = sector.modes(min(10, basis.n_natural))
    at_speed, _ = basis.at_speed(omega)
    reduced_squares = np.sort(at_speed.omega2)[: len(exact_squares)]
    error = np.abs(np.sqrt(reduced_squares / exact_squares) - 1.0)
    return float(error.max())
