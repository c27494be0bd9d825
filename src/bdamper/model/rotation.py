r"""Models over rotor speed: stiffness and residual flexibility per squared speed, and the model at one speed.

In the rotating frame, without Coriolis forces, a body that turns at :math:`\Omega` has

.. math:: K(\Omega) = K_0 + \Omega^2 B, \qquad B = \Phi^H (K_\sigma - M_s) \Phi

on its own modes :math:`\Phi` (mass-normalised at the speed :math:`\Omega_r`), with the geometric stiffness :math:`K_\sigma`
of the centrifugal stress per squared speed and the mass :math:`M_s` in the plane of rotation (spin softening).  What these
modes leave out of the static receptance changes with speed too,

.. math:: R(\Omega) = R_{res,0} + \Omega^2 R_{res,2} + \Phi K(\Omega)^{-1} \Phi^H,

and the sum is positive semidefinite beside the modes, as it is at one speed.  The total receptance of one speed beside the
frequencies of another would leave too much in it, and make contacts too soft.

At a speed the small problem :math:`K(\Omega) v = \omega^2 v` gives the modes :math:`\Phi v`.  Each replaces the
mode that it resembles most, not the one with its rank in frequency, with the phase that makes its part of that mode real
and positive: so damping ratios and mode numbers stay with their shapes where frequencies cross.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment

from bdamper.model.fields import Data
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.formatting import short_repr

MODAL: Any = ("n_modes", "n_modes"), "field"
FLEXIBLE: Any = ("n_forces", "n_forces"), "field"
NotNegative = Annotated[float, Data(limits=validation.Limits(least=0.0))]


@short_repr
@dataclass(frozen=True)
class SpeedBasis:
    """How the stiffness and the residual flexibility of one modal basis change with rotor speed.

    Parameters
    ----------
    omega_ref : float, rad/s
        Speed of the basis: ``stiffness0 + omega_ref^2 stiffness2`` is the diagonal matrix of its ``omega2``.
    stiffness0 : (n_modes, n_modes) complex or float, rad2/s2
        Hermitian, on the modes of the basis: stiffness at standstill.
    stiffness2 : (n_modes, n_modes) complex or float
        Hermitian: geometric stiffness less the mass of spin softening, per squared speed.
    residual0, residual2 : (3 n_points, 3 n_points) complex or float, m/N and m s2/N, optional
        Hermitian: flexibility beside these modes at standstill, and its change per squared speed.  Without them the basis
        has no flexibility at other speeds.
    coriolis : (n_modes, n_modes) complex or float, optional
        Skew-Hermitian ``Phi^H S Phi`` with the Coriolis matrix ``2 Omega S``; for :meth:`coriolis_size` alone.
    checked_at, error : float, optional
        Speed (rad/s) at which frequencies were compared with those of the full model, and the largest relative difference.
    source : str
    """

    omega_ref: NotNegative
    stiffness0: Annotated[NDArray, Data("rad2/s2", *MODAL, matrix="Hermitian", derived=True)]
    stiffness2: Annotated[NDArray, Data("1", *MODAL, matrix="Hermitian")]
    residual0: Annotated[NDArray, Data("m/N", *FLEXIBLE, matrix="Hermitian")] | None = None
    residual2: Annotated[NDArray, Data("m s2/N", *FLEXIBLE, matrix="Hermitian")] | None = None
    coriolis: Annotated[NDArray, Data("1", *MODAL, matrix="skew-Hermitian")] | None = None
    checked_at: NotNegative | None = None
    error: NotNegative | None = None
    source: str = ""

    def stiffness(self, omega: float) -> NDArray:
        """(n_modes, n_modes) stiffness at a speed (rad/s)."""
        matrix: NDArray = self.stiffness0 + omega**2 * self.stiffness2
        return matrix

    def residual(self, omega: float) -> NDArray | None:
        """(3 n_points, 3 n_points) residual flexibility at a speed (rad/s), m/N; None if it is not known."""
        if self.residual0 is None or self.residual2 is None:
            return None
        matrix: NDArray = self.residual0 + omega**2 * self.residual2
        return matrix

    def modes(self, omega: float) -> tuple[NDArray, NDArray]:
        """Modes at a speed (rad/s), in the order and with the phases of the basis.

        Returns
        -------
        omega2 : (n_modes,) float
        shapes : (n_modes, n_modes) unitary
            Column ``i`` is the mode with most of mode ``i`` of the basis.

        Raises
        ------
        SettingError
            If the structure is not stable at this speed.
        """
        omega2, shapes = eigh(self.stiffness(omega))
        found = f"a negative squared frequency at {omega:.6g} rad/s"
        validation.check(not omega2[0] < -1e-12 * omega2[-1], "rotor speed", "a stable structure", found)
        own = linear_sum_assignment(-(np.abs(shapes) ** 2))[1]
        omega2, shapes = np.maximum(omega2[own], 0.0), shapes[:, own]
        along = np.diag(shapes)
        return omega2, shapes * np.where(along == 0.0, 1.0, along.conj() / np.maximum(np.abs(along), np.finfo(float).tiny))

    def conjugate(self) -> SpeedBasis:
        """Conjugate basis (nodal diameter ``N - d``)."""
        arrays: dict[str, Any] = {name: part.conj() for name, part in vars(self).items() if isinstance(part, np.ndarray)}
        return replace(self, **arrays)

    def turned(self, omega: float, shapes: NDArray) -> SpeedBasis:
        """On the modes (n_modes, n_modes) of another speed, combinations of those of the basis."""
        modal = {name: getattr(self, name) for name in ("stiffness0", "stiffness2", "coriolis")}
        turned: dict[str, Any] = {name: shapes.conj().T @ part @ shapes for name, part in modal.items() if part is not None}
        return replace(self, omega_ref=omega, **turned)

    def coriolis_size(self, omega: float, omega2: NDArray) -> tuple[NDArray, NDArray]:
        """Estimated effect of the neglected Coriolis forces on the modes at a speed (rad/s).

        Parameters
        ----------
        omega : float
        omega2 : (n_modes,) float
            Squared frequencies at that speed, on whose modes this basis stands.

        Returns
        -------
        shift : (n_modes,) float
            Relative change of each frequency, ``Omega |S_ii| / omega_i``.
        mixing : (n_modes,) float
            Largest share of another mode, ``Omega |S_ij| / |omega_i - omega_j|``.

        Raises
        ------
        SettingError
            If the basis has no Coriolis matrix.
        """
        if self.coriolis is None:
            raise SettingError("coriolis_size: expected a basis with its Coriolis matrix, found none")
        size, frequency = omega * np.abs(self.coriolis), np.sqrt(omega2)
        apart = np.abs(frequency[:, None] - frequency)
        np.fill_diagonal(apart, np.inf)
        return np.diag(size) / frequency, (size / np.maximum(apart, np.finfo(float).tiny)).max(axis=1, initial=0.0)


@short_repr
@dataclass(frozen=True)
class SpinStatic:
    """Static displacement of a body by its own rotation, without contact, per squared speed: nodal diameter 0.

    Parameters
    ----------
    contact : (n_points, 3) float, m s2
        At the contact points of all ports of the body, in the order of ``Body.ports``, along t1, t2, n.
    locations : mapping of name to (3,) array, m s2
        At the named locations on this body, along X, Y, Z.
    theory : {"linear", "stiffened"}
        Of the structure at standstill, or with the stiffness at the speed ``omega`` (rad/s).
    omega : float
    """

    contact: Annotated[NDArray, Data("m s2", ("n_points", 3), file="contact/*")]
    locations: Annotated[Mapping[str, NDArray], Data("m s2", (3,))] = field(default_factory=dict)
    theory: Literal["linear", "stiffened"] = "linear"
    omega: NotNegative = 0.0
