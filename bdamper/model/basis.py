"""Modes of one body at one nodal diameter; :mod:`bdamper.model.model` states the conventions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from numpy.typing import NDArray

from bdamper.util.repr import brief


@brief
@dataclass(frozen=True)
class ModalBasis:
    """Modes of one body at one nodal diameter.

    Parameters
    ----------
    omega2 : (n_modes,) float, rad2/s2
        Squared natural frequencies, ascending; exactly zero for the rigid-body modes of a free body.
    damping_ratio : (n_modes,) float
        Modal damping ratios; zero for rigid-body modes.
    contact_modes : (n_points, 3, n_modes) complex or float, kg^-1/2
        Mass-normalised modes at the contact points of all ports of the body, in the order of ``Body.ports``,
        components along t1, t2, n.
    locations : mapping of name to (3, n_modes) array, kg^-1/2
        The modes at the named locations on this body, components along X, Y, Z.
    flexibility : (3 n_points, 3 n_points) complex or float, m/N, optional
        Hermitian static receptance of the full finite element model between the contact points, patch-averaged
        force to patch-averaged displacement; for a free body, that of the elastic deformation with inertia relief
        (orthogonal to the rigid-body modes in the mass matrix).
    drag : (n_modes,) float, 1/s, optional
        Viscous damping besides that of the damping ratios: of modes without stiffness, or beyond critical damping.
    """

    omega2: NDArray
    damping_ratio: NDArray
    contact_modes: NDArray
    locations: Mapping[str, NDArray] = field(default_factory=dict)
    flexibility: NDArray | None = None
    drag: NDArray | None = None

    @property
    def n_modes(self) -> int:
        return len(self.omega2)

    def conjugate(self) -> ModalBasis:
        """The basis of the wave ``N - d``, if this is that of ``d``."""
        return replace(
            self,
            contact_modes=self.contact_modes.conj(),
            locations={name: modes.conj() for name, modes in self.locations.items()},
            flexibility=None if self.flexibility is None else self.flexibility.conj(),
        )
