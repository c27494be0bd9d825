r"""Coordinates of one blade on its disk in which a mistuned wheel is local.

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
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from bdamper.model.fields import DAMPING, Data
from bdamper.model.modal_basis import ModalBasis
from bdamper.model.rigid_motions import fix_phase
from bdamper.util.short_repr import brief
from bdamper.util.validation import Limits


@brief
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
