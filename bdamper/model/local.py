r"""Coordinates of one blade on its disk in which a wheel of unequal blades is local.

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

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from bdamper.model.basis import ModalBasis
from bdamper.model.checks import (
    ROUNDING,
    check_all,
    check_array,
    check_hermitian,
    check_type,
    is_positive_definite,
    require,
    shape_text,
)
from bdamper.util.errors import mismatch
from bdamper.util.repr import brief


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
        Shapes at the contact points, as in :class:`~bdamper.model.basis.ModalBasis`.
    locations : mapping of name to (3, n) array, kg^-1/2
    flexibility : (3 n_points, 3 n_points) float, m/N, optional
        Static receptance between the contact points of the full blade clamped at its root.
    """

    region: str
    omega2: NDArray
    damping_ratio: NDArray
    blade_stiffness: NDArray
    blade_mass: NDArray
    disk_stiffness: NDArray
    disk_mass: NDArray
    contact_modes: NDArray
    locations: Mapping[str, NDArray] = field(default_factory=dict)
    flexibility: NDArray | None = None

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
        square = np.einsum("ij,ij->j", phi, self.mass(d).real @ phi)
        phi = phi * np.exp(-0.5j * np.angle(square)) if np.iscomplexobj(phi) else phi
        largest = np.take_along_axis(phi, np.abs(phi).argmax(axis=0)[None], axis=0)[0].real
        return omega2, phi * np.where(largest < 0.0, -1.0, 1.0)

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


def check_local(local: LocalBasis, n_blades: int, n_points: int, locations: Collection[str], item: str) -> None:
    """Check a local basis by itself.

    Parameters
    ----------
    local : LocalBasis
    n_blades, n_points : int
        Of the model, and of all ports of the body.
    locations : collection of str
        On the body.
    item : str
        What messages call it.

    Raises
    ------
    ModelError
        At the first thing that is wrong.
    """
    check_type(local.region, str, f"{item}/@region")
    check_array(local.omega2, (None,), f"{item}/omega2")
    check_array(local.blade_stiffness, (None, None), f"{item}/blade_stiffness")
    n = len(local.blade_stiffness)
    for key in ("blade_stiffness", "blade_mass"):
        check_array(getattr(local, key), (n, n), f"{item}/{key}")
        check_hermitian(getattr(local, key), f"{item}/{key}", "symmetric")
    check_array(local.disk_stiffness, (n_blades // 2 + 1, None, None), f"{item}/disk_stiffness", "field")
    r, m = local.n_interface, local.n_cantilever
    enough = local.n_attachment >= 0 and r > 0 and m > 0
    require(enough, item, "cantilever modes and shapes of the interface, at most n in all", f"{m} and {r} of n = {n}")
    for key in ("disk_stiffness", "disk_mass"):
        check_array(getattr(local, key), (n_blades // 2 + 1, r, r), f"{item}/{key}", "field")
        _check_disk(getattr(local, key), n_blades, f"{item}/{key}")
    check_array(local.damping_ratio, (n,), f"{item}/damping_ratio")
    damped = (local.damping_ratio >= 0) & (local.damping_ratio < 1)
    check_all(damped, local.damping_ratio, "numbers >= 0 and < 1", f"{item}/damping_ratio")
    check_array(local.contact_modes, (n_points, 3, n), f"{item}/modes")
    found = local.locations
    require(set(found) == set(locations), f"{item}/locations", f"{sorted(locations)}", f"{sorted(found)}")
    for name, shapes in found.items():
        check_array(shapes, (3, n), f"{item}/locations/{name}")
    _check_cantilever(local, item)
    for d in range(n_blades // 2 + 1):
        for key in ("stiffness", "mass"):
            matrix = getattr(local, key)(d)
            definite = is_positive_definite(matrix)
            require(definite, f"{item}/disk_{key}", "blade and disk positive definite", f"not at nodal diameter {d}")
    if local.flexibility is not None:
        _check_flexibility(local, 3 * n_points, f"{item}/flexibility")


def _check_disk(disk: NDArray, n_blades: int, item: str) -> None:
    for d, matrix in enumerate(disk):
        check_hermitian(matrix, f"{item} at nodal diameter {d}")
        if 2 * d % n_blades == 0 and np.any(matrix.imag):
            found = f"imaginary parts up to {np.abs(matrix.imag).max():.3g}"
            raise mismatch(f"{item} at nodal diameter {d}", "real numbers", found)


def _check_cantilever(local: LocalBasis, item: str) -> None:
    """Cantilever modes have their own stiffness and none with others; deformation of the root has no negative energy."""
    m = local.n_cantilever
    check_all(local.omega2 > 0, local.omega2, "numbers > 0", f"{item}/omega2")
    expected = np.zeros((m, local.n))
    expected[:, :m] = np.diag(local.omega2)
    size = np.sqrt(np.maximum(np.abs(np.diag(local.blade_stiffness)), local.omega2.min()))
    error = np.abs(local.blade_stiffness[:m] - expected) / np.outer(size[:m], size)
    if not error.max() <= ROUNDING:
        i, j = (int(k) for k in np.unravel_index(error.argmax(), error.shape))
        found = f"{local.blade_stiffness[i, j]:.9g} instead of {expected[i, j]:.9g} at ({i}, {j})"
        raise mismatch(f"{item}/blade_stiffness", "omega2 on the diagonal of cantilever modes, 0 beside", found)
    smallest = np.linalg.eigvalsh(local.blade_stiffness / np.outer(size, size))[0]
    require(smallest >= -ROUNDING, f"{item}/blade_stiffness", "no negative eigenvalue", f"{smallest:.3g} of its size")


def _check_flexibility(local: LocalBasis, n: int, item: str) -> None:
    flexibility = local.flexibility
    check_array(flexibility, (n, n), item)
    assert flexibility is not None
    check_hermitian(flexibility, item, "symmetric")
    rest, size = local.residual_flexibility(), np.linalg.norm(flexibility)
    assert rest is not None
    smallest = np.linalg.eigvalsh(0.5 * (rest + rest.T))[0] if n else 0.0
    allowed = 1e-6 * size
    require(smallest >= -allowed, item, f"shape {shape_text((n, n))} and no less than that of the coordinates", smallest)
