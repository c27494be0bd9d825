r"""Modes of one body at one nodal diameter; :mod:`bdamper.model.structure` states the conventions.

Rigid motions of points, and shapes with a definite phase.

Coordinates of one blade on its disk in which a mistuned wheel is local.

Every sector has its own coordinates, in the axes of its own blade: amplitudes of the modes of the blade clamped at its root
(cantilever modes), of static shapes of forces at its contact points (attachments), and of shapes of the root, the interface
of blade and disk.  The first two do not move the root, so that only the last reach the disk, which is given as a wave sees
it: one Hermitian matrix of stiffness and one of mass for each nodal diameter,

.. math:: K(d) = K_B + K_D(d), \quad M(d) = M_B + M_D(d), \quad K_D(N - d) = \overline{K_D(d)} .

A blade whose frequencies, clamped at the root, differ by the factor 1 + eps has the stiffness :math:`(1 + eps)^2 K_B`.

**Damping** is that of the modes of the tuned wheel, a ratio for each mode at every nodal diameter: the same rule as in a
study of one sector, so that both have the same response.  As a matrix it is

.. math:: C(d) = M \Phi\, \mathrm{diag}(2 \zeta \omega)\, \Phi^H M ,

which couples neighbours, though little; it is meant to stay that of the tuned wheel when blades differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import eigh

from bdamper.model.fields import DAMPING, Data
from bdamper.model.rotation import SpeedBasis
from bdamper.util.formatting import short_repr
from bdamper.util.validation import Limits

# ---- Modes of one body at one nodal diameter;  ----


@short_repr
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


# ---- Rigid motions of points, and shapes with a definite phase ----


def rigid_motions(points: NDArray, centre: NDArray, axes: NDArray, turning: NDArray | None = None) -> NDArray:
    """Unit translations along the rows of ``axes`` (3, 3) and rotations about those of ``turning``: (3 n_points, 6).

    Parameters
    ----------
    points : (n_points, 3) float, m
    centre : (3,) float, m
        On the axes of rotation.
    axes, turning : (3, 3) float
        Rotations are about ``axes``, too, by default.
    """
    turned = np.cross((axes if turning is None else turning)[:, None], points - centre).transpose(1, 2, 0)
    return np.ascontiguousarray(np.concatenate([np.broadcast_to(axes.T, turned.shape), turned], axis=2)).reshape(-1, 6)


def fix_phase(vectors: NDArray, mass: NDArray | sp.spmatrix) -> NDArray:
    """Give each column a definite phase: ``u^T M u`` real and positive, the largest component positive.

    Rows in which vectors are unknown (NaN) decide nothing.

    The first makes the mode as real as it can be, and unlike a rule on one component it cannot jump when two
    components are about equally large; the second decides the remaining sign.
    """
    known = np.nan_to_num(vectors)
    if np.iscomplexobj(vectors):
        square = np.einsum("ij,ij->j", known, mass @ known)
        turn_back = np.exp(-0.5j * np.angle(square))
        vectors, known = vectors * turn_back, known * turn_back
    # In a symmetric body several components are equally large up to rounding: take the first of them.
    size = np.abs(known)
    first = (size > (1.0 - 1e-6) * size.max(axis=0)).argmax(axis=0)
    largest = np.take_along_axis(known, first[None], axis=0)[0]
    return vectors * np.where(largest.real < 0.0, -1.0, 1.0)


# ---- Coordinates of one blade on its disk in which a mistuned wheel is local ----


@short_repr
@dataclass(frozen=True)
class LocalBasis:
    """One blade and the disk, in the coordinates of the module's docstring: cantilever modes, attachments, interface.

    Shapes are given in kg^-1/2, so that coordinates are those of mass-normalised modes; n is the number of coordinates,
    ``n_cantilever + n_attachment + n_interface``.

    Parameters
    ----------
    region : str
        What counts as the blade, in words.
    omega2 : (n_cantilever,) float, rad2/s2
        Squared frequencies of the blade clamped at its root.
    damping_ratio : (n,) float
        Of the modes of the tuned wheel, in the order of their frequencies, at every nodal diameter.
    blade_stiffness, blade_mass : (n, n) float, rad2/s2 and 1
    disk_stiffness, disk_mass : (N // 2 + 1, n_interface, n_interface) complex, rad2/s2 and 1
        Hermitian, on the coordinates of the interface; real at nodal diameters 0 and N/2.
    contact_modes : (n_points, 3, n) float, kg^-1/2
        Shapes at the contact points, as in :class:`~bdamper.model.modal_basis.ModalBasis`.
    locations : mapping of name to (3, n) array, kg^-1/2
    flexibility : (3 n_points, 3 n_points) float, m/N, optional
        Static receptance between the contact points of the full blade clamped at its root.
    """

    region: str
    omega2: Annotated[NDArray, Data("rad2/s2", ("n_cantilever",), limits=Limits(above=0.0))]
    damping_ratio: Annotated[NDArray, Data("1", ("n",), limits=DAMPING)]
    blade_stiffness: Annotated[NDArray, Data("rad2/s2", ("n", "n"), matrix="symmetric")]
    blade_mass: Annotated[NDArray, Data("1", ("n", "n"), matrix="symmetric")]
    disk_stiffness: Annotated[NDArray, Data("rad2/s2", ("n_diameters", "n_interface", "n_interface"), "field")]
    disk_mass: Annotated[NDArray, Data("1", ("n_diameters", "n_interface", "n_interface"), "field")]
    contact_modes: Annotated[NDArray, Data("kg^-1/2", ("n_points", 3, "n"), file="modes/*")]
    locations: Annotated[Mapping[str, NDArray], Data("kg^-1/2", (3, "n"))] = field(default_factory=dict)
    flexibility: Annotated[NDArray, Data("m/N", ("n_forces", "n_forces"), matrix="symmetric")] | None = None

    @property
    def n(self) -> int:
        """Number of coordinates of a sector."""
        return len(self.blade_stiffness)

    @property
    def n_cantilever(self) -> int:
        return len(self.omega2)

    @property
    def n_interface(self) -> int:
        return int(self.disk_stiffness.shape[-1])

    @property
    def n_attachment(self) -> int:
        return self.n - self.n_cantilever - self.n_interface

    def stiffness(self, d: int) -> NDArray:
        """K(d), (n, n) Hermitian, real where the disk's is; nodal diameters 0 to N/2."""
        return self._with_disk(self.blade_stiffness, self.disk_stiffness[d])

    def mass(self, d: int) -> NDArray:
        """M(d), (n, n), likewise."""
        return self._with_disk(self.blade_mass, self.disk_mass[d])

    def _with_disk(self, blade: NDArray, disk: NDArray) -> NDArray:
        disk = disk if np.any(disk.imag) else disk.real
        out = blade.astype(disk.dtype)
        out[-self.n_interface :, -self.n_interface :] += disk
        return out

    def modes(self, d: int) -> tuple[NDArray, NDArray]:
        """Squared frequencies (n,) and mass-normalised modes (n, n) of the tuned wheel, with a definite phase."""
        omega2, phi = eigh(self.stiffness(d), self.mass(d))
        return omega2, fix_phase(phi, self.mass(d).real)

    def damping(self, d: int, ratio: NDArray | float | None = None) -> NDArray:
        """C(d), (n, n) Hermitian, of these damping ratios (n,) of the tuned wheel's modes or the basis' own, 1/s."""
        omega2, phi = self.modes(d)
        weighted = self.mass(d) @ phi
        ratio = self.damping_ratio if ratio is None else ratio
        return np.asarray((weighted * (2.0 * ratio * np.sqrt(omega2))) @ weighted.conj().T)

    def residual_flexibility(self) -> NDArray | None:
        """Flexibility (3 n_points, 3 n_points) of the blade that the coordinates leave out, m/N; of each sector alone."""
        if self.flexibility is None:
            return None
        own = self.n - self.n_interface
        shapes = self.contact_modes.reshape(-1, self.n)[:, :own]
        return np.asarray(self.flexibility - shapes @ np.linalg.solve(self.blade_stiffness[:own, :own], shapes.T))

    def nodal_diameter(self, d: int) -> ModalBasis:
        """All n modes of the tuned wheel at a nodal diameter from 0 to N/2."""
        omega2, phi = self.modes(d)
        contact, rest = self.contact_modes @ phi, self.residual_flexibility()
        if rest is not None:
            flat = contact.reshape(-1, self.n)
            rest = rest + (flat / omega2) @ flat.conj().T
        places = {name: shapes @ phi for name, shapes in self.locations.items()}
        return ModalBasis(omega2, self.damping_ratio.copy(), contact, places, rest)
