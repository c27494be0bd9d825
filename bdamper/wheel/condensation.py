r"""Coordinates of the blades that no contact moves, condensed out of the Jacobian of a wheel.

The coordinates of a blade but for the root shapes that are kept are combined into c, which move the contact points, and z,
which hardly do.  With the singular values :math:`\sigma` of the motion of the points, weighted by the roots of the contact
stiffness, by coordinates of unit strain energy, a combination feels the contacts :math:`\sigma^2` times as stiff as the
blade; c are those with :math:`\sigma^2` above ``FELT``, and the modes of the others that a harmonic may excite (``REACH``).
Of the harmonic :math:`l` with :math:`w = l\omega`, b the c and
the kept root shapes together, and z the modes of each blade with all b at rest (poles :math:`\Lambda`, mass one),

.. math:: z = W b + (\Lambda - w^2)^{-1} r_z, \qquad W = -(\Lambda - w^2)^{-1} (K_{zb} - w^2 M_{zb}),

leaves the stiffness :math:`K_{bb} - w^2 M_{bb} + (K_{zb} - w^2 M_{zb})^T W`, the damping that of the motion (W b, b), and
the forces :math:`r_b + W^T r_z`.  What this leaves out, contacts of z and its own damping but for the first order in the
matrices, changes Newton steps and not solutions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

FELT = 0.01
"""Contact stiffness that a combination of coordinates feels, relative to that of the blade, from which on it is kept.  On
the shipped disk (65 blades, nine points a face, one harmonic) 18 of 32 combinations remain, and steps are off by 0.1 % in
the median and 0.5 % at most; with 0.1 15, 0.6 % and 3 %."""
REACH = 2.0
"""Ratio to the highest harmonic up to which modes of z are kept.  With 1 steps of that disk are off by 8 % at most;
without, with 22 combinations that feel the contacts most, by 30 %, and with three harmonics by more than their length."""


@dataclass(frozen=True, eq=False)
class Condensation:
    """Matrices of all blades in the coordinates z and b.

    Parameters
    ----------
    contact : (n_within, n_contact) float
        Coordinates within the blade by c.
    rest : (n_blades, n_within, n_rest) float
        The same by z.
    rows : (n_points, 3, n_left + n_damper) float
        Motion of the points by b and the coordinates of the damper.
    poles : (n_blades, n_rest) float
    stiffness, to_stiffness : (n_blades, n_left, n_left), (n_blades, n_rest, n_left) float
        Of b, and what couples z to b.
    mass, to_mass, damping, to_damping, own_damping : float
        The same; damping of z itself besides, (n_blades, n_rest, n_rest).
    """

    contact: NDArray
    rest: NDArray
    rows: NDArray
    poles: NDArray
    stiffness: NDArray
    to_stiffness: NDArray
    mass: NDArray
    to_mass: NDArray
    damping: NDArray
    to_damping: NDArray
    own_damping: NDArray

    @classmethod
    def of(
        cls,
        stiffness: NDArray,
        nominal: NDArray,
        mass: NDArray,
        damping: NDArray,
        rows: NDArray,
        weight: NDArray,
        kept: int,
        fastest: float,
    ) -> Self:
        """Condensation of blades with these matrices.

        Parameters
        ----------
        stiffness, nominal, mass, damping : (n_blades, n, n), (n, n), (n, n), (n, n) float
        rows : (n_points, 3, n + n_damper) float
        weight : (n_points, 3) float, N/m
            Stiffness of the contacts.
        kept : int
            Of the coordinates, the last.
        fastest : float, rad/s
            Highest harmonic.
        """
        n = len(mass)
        inside = slice(0, n - kept)
        root = np.linalg.cholesky(nominal[inside, inside])  # coordinates of unit energy: root^T x
        seen = np.sqrt(weight)[..., None] * rows[..., inside]
        seen = scipy.linalg.solve_triangular(root, seen.reshape(-1, n - kept).T, lower=True).T
        _, size, V = np.linalg.svd(np.concatenate([seen, np.zeros((n - kept, n - kept))]), full_matrices=False)
        T = scipy.linalg.solve_triangular(root, V.T, lower=True, trans="T")
        m = int((size**2 > FELT).sum())
        c, z = T[:, :m], T[:, m:]
        squares, modes = _modes(nominal[inside, inside], mass[inside, inside], z)
        slow = int((squares < (REACH * fastest) ** 2).sum())
        c, z = np.concatenate([c, z @ modes[:, :slow]], axis=1), z @ modes[:, slow:]
        B = scipy.linalg.block_diag(c, np.eye(kept))
        nz = z.shape[1]
        poles, modes = np.empty((len(stiffness), nz)), np.empty((len(stiffness), nz, nz))
        for k, K in enumerate(stiffness):
            poles[k], modes[k] = _modes(K[inside, inside], mass[inside, inside], z)
        rest = z @ modes
        turned = rest.transpose(0, 2, 1)
        return cls(
            contact=c,
            rest=rest,
            rows=np.concatenate([rows[..., :n] @ B, rows[..., n:]], axis=2),
            poles=poles,
            stiffness=B.T @ stiffness @ B,
            to_stiffness=turned @ stiffness[:, inside] @ B,
            mass=B.T @ mass @ B,
            to_mass=turned @ mass[inside] @ B,
            damping=B.T @ damping @ B,
            to_damping=turned @ damping[inside] @ B,
            own_damping=turned @ damping[inside, inside] @ rest,
        )

    def at(self, omega: float, n_harmonics: int, lost: float) -> Condensed:
        """At a frequency (rad/s), with damping of ``lost`` (1/s) times the mass besides."""
        to_damping, own_damping = (
            self.to_damping + lost * self.to_mass,
            self.own_damping + lost * np.eye(self.poles.shape[1]),
        )
        parts = []
        for w in omega * np.arange(n_harmonics + 1):
            to, flexibility = self.to_stiffness - w**2 * self.to_mass, 1.0 / (self.poles - w**2)
            W = -flexibility[..., None] * to
            back = W.transpose(0, 2, 1)
            both = back @ (to_damping + 0.5 * own_damping @ W)
            C = self.damping + lost * self.mass + both + both.transpose(0, 2, 1)
            K = self.stiffness - w**2 * self.mass + to.transpose(0, 2, 1) @ W
            parts.append((K, w * C, W, flexibility))
        return Condensed(self, *(np.array(part) for part in zip(*parts, strict=True)))


def _modes(stiffness: NDArray, mass: NDArray, z: NDArray) -> tuple[NDArray, NDArray]:
    """Poles and modes in the coordinates z."""
    if not z.shape[1]:
        return np.zeros(0), np.zeros((0, 0))
    poles, modes = scipy.linalg.eigh(z.T @ stiffness @ z, z.T @ mass @ z)
    return poles, modes


@dataclass(frozen=True, eq=False)
class Condensed:
    """Condensed matrices at a frequency, for the mean and every harmonic.

    Parameters
    ----------
    of : Condensation
    stiffness, damping : (n_harmonics + 1, n_blades, n_left, n_left) float
        Stiffness less inertia; damping times the frequency of the harmonic.
    follow : (n_harmonics + 1, n_blades, n_rest, n_left) float
        W.
    flexibility : (n_harmonics + 1, n_blades, n_rest) float
    """

    of: Condensation
    stiffness: NDArray
    damping: NDArray
    follow: NDArray
    flexibility: NDArray

    def forces(self, r: NDArray) -> tuple[NDArray, NDArray]:
        """Forces on b and on z of those on the coordinates of the blades, (n_blades, n_coefficients, ...)."""
        n = len(self.of.contact)
        on_z = r[..., :n] @ self.of.rest
        on_b = np.concatenate([r[..., :n] @ self.of.contact, r[..., n:]], axis=2)
        for l, W in enumerate(self.follow):
            on_b[:, pair(l)] += on_z[:, pair(l)] @ W
        return on_b, on_z

    def motion(self, b: NDArray, on_z: NDArray) -> NDArray:
        """(n_blades, n_coefficients, n) coordinates of the blades."""
        z = np.empty_like(on_z)
        for l, W in enumerate(self.follow):
            z[:, pair(l)] = on_z[:, pair(l)] * self.flexibility[l][:, None] + b[:, pair(l)] @ W.transpose(0, 2, 1)
        m = self.of.contact.shape[1]
        return np.concatenate([b[..., :m] @ self.of.contact.T + z @ self.of.rest.transpose(0, 2, 1), b[..., m:]], axis=2)


def pair(harmonic: int) -> slice:
    """Coefficients of a harmonic."""
    return slice(2 * harmonic - 1, 2 * harmonic + 1) if harmonic else slice(0, 1)
