r"""Rotor speed: stiffness and residual flexibility per squared speed, and the modes at one speed.

In the rotating frame, without Coriolis forces, the stiffness of a body at the speed :math:`\Omega` is

.. math:: K(\Omega) = K_0 + \Omega^2 B, \qquad B = \Phi^H (K_\sigma - M_s) \Phi

in its modal coordinates (modes :math:`\Phi`, mass-normalised, at the speed :math:`\Omega_r`).  :math:`K_\sigma` is the
geometric stiffness of the centrifugal stress per squared speed, and :math:`M_s` the mass in the plane of rotation (spin
softening).  The residual flexibility also depends on speed.  The static receptance is

.. math:: R(\Omega) = R_{res,0} + \Omega^2 R_{res,2} + \Phi K(\Omega)^{-1} \Phi^H,

so that the residual part is positive semi-definite at every speed.  A receptance of one speed with frequencies of another
would overestimate it and make contacts too soft.

The eigenproblem :math:`K(\Omega) v = \omega^2 v` gives the modes :math:`\Phi v` at a speed.  Modes are assigned by
similarity of shape, not by order of frequency, and have the phase that makes the projection on the assigned mode real and
positive.  Damping ratios and mode numbers thus follow the shapes if frequencies cross.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np
import scipy  # scipy.optimize loads on first use; it takes a tenth of a second
from numpy.typing import NDArray
from scipy.linalg import eigh

from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.formatting import short_repr
from bdamper.util.records import Data, Record

MODAL: Any = ("n_modes", "n_modes"), "field"
FLEXIBLE: Any = ("n_forces", "n_forces"), "field"
NotNegative = Annotated[float, Data(limits=validation.Limits(least=0.0))]


@short_repr
@dataclass(frozen=True)
class SpeedBasis(Record):
    """Change of stiffness and residual flexibility of one modal basis with rotor speed.

    Parameters
    ----------
    omega_ref : float, rad/s
        Speed of the basis: ``stiffness0 + omega_ref^2 stiffness2`` is the diagonal matrix of its ``omega2``.
    stiffness0 : (n_modes, n_modes) complex or float, rad2/s2
        Hermitian modal stiffness at standstill.
    stiffness2 : (n_modes, n_modes) complex or float
        Hermitian; geometric stiffness minus mass of spin softening, per squared speed.
    residual0, residual2 : (3 n_points, 3 n_points) complex or float, m/N and m s2/N, optional
        Hermitian; residual flexibility at standstill and its change per squared speed.  Without them the basis has no
        flexibility at other speeds.
    coriolis : (n_modes, n_modes) complex or float, optional
        Skew-Hermitian ``Phi^H S Phi`` with the Coriolis matrix ``2 Omega S``, only for :meth:`coriolis_size`.
    checked_at, error : float, optional
        Speed (rad/s) of a comparison with the frequencies of the full model, and the largest relative difference.
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
        """Return the modal stiffness (n_modes, n_modes) at a speed (rad/s)."""
        matrix: NDArray = self.stiffness0 + omega**2 * self.stiffness2
        return matrix

    def residual(self, omega: float) -> NDArray | None:
        """Return the residual flexibility (3 n_points, 3 n_points), m/N, at a speed (rad/s); None if unknown."""
        if self.residual0 is None or self.residual2 is None:
            return None
        matrix: NDArray = self.residual0 + omega**2 * self.residual2
        return matrix

    def modes(self, omega: float) -> tuple[NDArray, NDArray]:
        """Compute the modes at a speed (rad/s), in the order and with the phases of the basis.

        Returns
        -------
        omega2 : (n_modes,) float
        shapes : (n_modes, n_modes) unitary
            Column ``i`` is the mode most similar to mode ``i`` of the basis.

        Raises
        ------
        SettingError
            If the structure is unstable at this speed.
        """
        omega2, shapes = eigh(self.stiffness(omega))
        found = f"a negative squared frequency at {omega:.6g} rad/s"
        validation.check(not omega2[0] < -1e-12 * omega2[-1], "rotor speed", "a stable structure", found)
        order = scipy.optimize.linear_sum_assignment(-(np.abs(shapes) ** 2))[1]
        omega2, shapes = np.maximum(omega2[order], 0.0), shapes[:, order]
        overlap = np.diag(shapes)
        size = np.maximum(np.abs(overlap), np.finfo(float).tiny)
        return omega2, shapes * np.where(overlap == 0.0, 1.0, overlap.conj() / size)

    def conjugate(self) -> SpeedBasis:
        """Return the complex conjugate basis (nodal diameter ``N - d``)."""
        arrays: dict[str, Any] = {name: part.conj() for name, part in vars(self).items() if isinstance(part, np.ndarray)}
        return replace(self, **arrays)

    def turned(self, omega: float, shapes: NDArray) -> SpeedBasis:
        """Transform to the modes ``shapes`` (n_modes, n_modes) of another speed, combinations of the modes of the basis."""
        modal = {name: getattr(self, name) for name in ("stiffness0", "stiffness2", "coriolis")}
        turned: dict[str, Any] = {name: shapes.conj().T @ part @ shapes for name, part in modal.items() if part is not None}
        return replace(self, omega_ref=omega, **turned)

    def coriolis_size(self, omega: float, omega2: NDArray) -> tuple[NDArray, NDArray]:
        """Estimate the effect of the neglected Coriolis forces on the modes at a speed (rad/s).

        Parameters
        ----------
        omega : float
        omega2 : (n_modes,) float
            Squared frequencies at that speed, for the modes of this basis.

        Returns
        -------
        shift : (n_modes,) float
            Relative change of each frequency, ``Omega |S_ii| / omega_i``.
        mixing : (n_modes,) float
            Largest contribution of another mode, ``Omega |S_ij| / |omega_i - omega_j|``.

        Raises
        ------
        SettingError
            If the basis has no Coriolis matrix.
        """
        if self.coriolis is None:
            raise SettingError("coriolis_size: expected a basis with a Coriolis matrix, found none")
        size, frequency = omega * np.abs(self.coriolis), np.sqrt(omega2)
        difference = np.abs(frequency[:, None] - frequency)
        np.fill_diagonal(difference, np.inf)
        return np.diag(size) / frequency, (size / np.maximum(difference, np.finfo(float).tiny)).max(axis=1, initial=0.0)


@short_repr
@dataclass(frozen=True)
class SpinStatic(Record):
    """Static displacement of a body due to its rotation without contact, per squared speed, at nodal diameter 0.

    Parameters
    ----------
    contact : (n_points, 3) float, m s2
        At the contact points of all ports, in the order of ``Body.ports``, along t1, t2, n.
    locations : mapping of name to (3,) array, m s2
        At the named locations on this body, along X, Y, Z.
    theory : {"linear", "stiffened"}
        Stiffness of the structure at standstill, or at the speed ``omega`` (rad/s).
    omega : float
    """

    contact: Annotated[NDArray, Data("m s2", ("n_points", 3))]
    locations: Annotated[Mapping[str, NDArray], Data("m s2", (3,))] = field(default_factory=dict)
    theory: Literal["linear", "stiffened"] = "linear"
    omega: NotNegative = 0.0
