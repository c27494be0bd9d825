"""Modes of one body at one nodal diameter; :mod:`bdamper.model.structure` states the conventions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.model.fields import DAMPING, Data
from bdamper.model.rotation import SpeedBasis
from bdamper.util.short_repr import brief
from bdamper.util.validation import Limits


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
    speed : SpeedBasis, optional
        How stiffness and flexibility change with rotor speed.
    static_shapes : int, optional
        How many of the last modes are none, but static shapes of forces at the locations, orthogonal to all modes and to
        each other: the flexibility of the locations beside the modes (:mod:`bdamper.model.residual_vectors`).
    """

    omega2: Annotated[NDArray, Data("rad2/s2", ("n_modes",))]
    damping_ratio: Annotated[NDArray, Data("1", ("n_modes",), limits=DAMPING)]
    contact_modes: Annotated[NDArray, Data("kg^-1/2", ("n_points", 3, "n_modes"), "field", "modes/*")]
    locations: Annotated[Mapping[str, NDArray], Data("kg^-1/2", (3, "n_modes"), "field")] = field(default_factory=dict)
    flexibility: Annotated[NDArray, Data("m/N", ("n_forces", "n_forces"), "field", matrix="Hermitian")] | None = None
    drag: Annotated[NDArray, Data("1/s", ("n_modes",), limits=Limits(least=0.0))] | None = None
    speed: SpeedBasis | None = None
    static_shapes: Annotated[int, Data(limits=Limits(least=0))] | None = None

    @property
    def n_modes(self) -> int:
        """Modes and static shapes."""
        return len(self.omega2)

    @property
    def n_natural(self) -> int:
        """Modes without the static shapes behind them."""
        return len(self.omega2) - (self.static_shapes or 0)

    def conjugate(self) -> ModalBasis:
        """Conjugate basis (nodal diameter ``N - d``)."""
        return replace(
            self,
            contact_modes=self.contact_modes.conj(),
            locations={name: modes.conj() for name, modes in self.locations.items()},
            flexibility=None if self.flexibility is None else self.flexibility.conj(),
            speed=None if self.speed is None else self.speed.conjugate(),
        )

    def with_speed(
        self, stiffness2: NDArray, residual2: NDArray | None = None, omega_ref: float = 0.0, **rest: Any
    ) -> ModalBasis:
        """The basis, which belongs to the speed ``omega_ref``, with data over speed; those of standstill follow from it.

        Parameters as in :class:`~bdamper.model.rotation.SpeedBasis`.
        """
        residual0 = None
        if residual2 is not None and self.flexibility is not None:
            shapes = self.contact_modes.reshape(len(self.flexibility), -1)
            residual0 = self.flexibility - (shapes / self.omega2) @ shapes.conj().T - omega_ref**2 * residual2
        stiffness0 = np.diag(self.omega2).astype(stiffness2.dtype) - omega_ref**2 * stiffness2
        return replace(self, speed=SpeedBasis(omega_ref, stiffness0, stiffness2, residual0, residual2, **rest))

    def at_speed(self, omega: float) -> tuple[ModalBasis, NDArray]:
        """The basis at a rotor speed (rad/s), in the order of this one.

        Returns
        -------
        basis : ModalBasis
        shapes : (n_modes, n_modes)
            Its modes as combinations of those of this basis.
        """
        speed = self.speed
        if speed is None or omega == speed.omega_ref:
            return self, np.eye(self.n_modes)
        omega2, shapes = speed.modes(omega)
        contact = self.contact_modes @ shapes
        flexibility = speed.residual(omega)
        if flexibility is not None:
            flat = contact.reshape(len(flexibility), -1)
            flexibility = flexibility + (flat / omega2) @ flat.conj().T
            flexibility = 0.5 * (flexibility + flexibility.conj().T)
        locations = {name: modes @ shapes for name, modes in self.locations.items()}
        damping, turned = self.damping_ratio, speed.turned(omega, shapes)
        static = self.static_shapes
        made = ModalBasis(omega2, damping, contact, locations, flexibility, speed=turned, static_shapes=static)
        return made, shapes
