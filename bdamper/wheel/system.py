r"""Harmonic balance of a whole wheel: residual, its derivative, and an approximate inverse of that.

Unknowns are an array (n_blades, n_coefficients, n_sector): for every sector the coefficients [mean, c1, s1, c2, s2, ...]
of the coordinates of its blade and its damper (:mod:`bdamper.wheel.structure`).  With :math:`X_l = c_l - i s_l` the
residual is

.. math::
    (K - (l\omega)^2 M + i l \omega C) X_l + P^T F_l - E_l ,

in which the disk and the damping C of the tuned wheel act by a Fourier transform over the sectors and everything else
sector by sector.  Contact forces F and their tangents are those of the study, point by point.

**Linear equations.**  The Jacobian is P + R, but for a hundredth.  P has the couplings of the disk cut to next neighbours,
those of the damping to the own sector, and contacts that move but a part of each blade's coordinates
(:mod:`bdamper.wheel.condensation`): those left are eliminated sector by sector, then the ring of dampers and root shapes
(csrc/bd_wheel.c).  R is the rest of disk and damping between root shapes, a Fourier transform away.  With y the part
of x of the root shapes,

.. math:: (1 + P^{-1} R) \, y = P^{-1} b, \qquad x = P^{-1} (b - R \, y),

is solved iteratively for y alone (GMRES), and the whole, where more than a hundredth is asked for, again for what is left
of b (:func:`bdamper.wheel.newton.solved`).

**Eased equations** (:class:`Ease`) have more damping, :math:`C + \delta\omega M`, and springs that hold the mean of
dampers at its static place.  Their solutions lead to those of the wheel itself (:mod:`bdamper.wheel.solution`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.many_points import PAIRS, Elimination, ManyPoints
from bdamper.wheel.condensation import Condensed, pair
from bdamper.wheel.constants import Constants
from bdamper.wheel.static_points import StaticPoints

NEUTRAL = 1e-8
"""Springs on the mean of a damper's coordinates in the Jacobian, relative to its stiffness when stuck: a damper that slips
fully is free along the axis, and the matrix of its sector singular.  They change steps by as much, not solutions."""


@dataclass(frozen=True)
class Ease:
    """What makes the equations of a wheel easier to solve.

    Parameters
    ----------
    damping : float
        Loss of all masses, relative to their inertia; the width of a resonance, relative to its frequency.
    springs : float
        On the mean of dampers, relative to their stiffness when stuck.
    """

    damping: float = 0.0
    springs: float = 0.0


PLAIN = Ease()


class WheelSystem:
    """Equations of one wheel at one preload.

    Parameters
    ----------
    constants : Constants
    contact : ManyPoints or StaticPoints
        All points of the wheel, sector by sector.
    shift : (n_blades, n_points, 3) float, m
        Part of the relative motion that the coordinates do not carry.
    load : (n_blades, n_sector) float
        Static forces.
    excitation : (n_blades, n_sector) complex
        Forces of the first harmonic.
    force_scale : (2,) float
        Forces of the mean and of the harmonics to which the residual is related.

    Attributes
    ----------
    home : (n_blades, n_damper) float
        Static place of the dampers.
    """

    def __init__(
        self,
        constants: Constants,
        contact: ManyPoints | StaticPoints,
        shift: NDArray,
        load: NDArray,
        excitation: NDArray,
        force_scale: tuple[float, float],
    ) -> None:
        structure = constants.structure
        self.constants = constants
        self.structure = structure
        self.contact = contact
        self.shift = shift
        self.n_harmonics = constants.n_harmonics
        n_coef = 2 * self.n_harmonics + 1
        self.shape = (structure.n_blades, n_coef, structure.n_sector)
        self.force = np.zeros(self.shape)
        self.force[:, 0] = load
        self.force[:, 1], self.force[:, 2] = excitation.real, -excitation.imag
        self.order = np.repeat(np.arange(self.n_harmonics + 1), 2)[1:]
        self.still = np.zeros(self.shape, bool)
        self.still[:, ~constants.active] = True
        self.still[constants.pinned, :, structure.n :] = True
        self.relate(*force_scale)
        self.force[self.still] = 0.0
        self.home = np.zeros((structure.n_blades, structure.n_damper))
        self.evaluations = self.factorisations = self.iterations = 0

    def relate(self, mean: float, harmonics: float) -> None:
        """Forces of the mean and of the harmonics to which the residual is related."""
        self.row_scale = np.full(self.shape, 1.0 / harmonics)
        self.row_scale[:, 0] = 1.0 / mean

    # ---- linear part ----

    def _parts(self, X: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """K x, M x, and C x turned by a quarter period, each without the factor of the frequency."""
        s, n, r = self.structure, self.structure.n, self.structure.local.n_interface
        K, M, C = np.empty_like(X), np.empty_like(X), np.zeros_like(X)
        U = X[..., :n]
        K[..., :n] = U @ s.stiffness.transpose(0, 2, 1)
        M[..., :n] = U @ s.mass.T
        K[..., n:], M[..., n:] = s.damper_stiffness * X[..., n:], s.damper_mass[:, None] * X[..., n:]
        wave = self.waves(U)
        root = wave[..., n - r :]
        for out, disk in ((K, s.disk_stiffness), (M, s.disk_mass)):
            self.add_amplitudes(out[..., n - r : n], np.fft.ifft(root @ disk.transpose(0, 2, 1), axis=0))
        self.add_amplitudes(C[..., :n], 1j * np.fft.ifft(wave @ s.damping.transpose(0, 2, 1), axis=0))
        C[..., n:] = turned(s.damper_damping * X[..., n:])
        C[:, 0] = 0.0
        return K, M, C

    @staticmethod
    def waves(U: NDArray) -> NDArray:
        """(n_blades, n_harmonics + 1, n) complex amplitudes of every nodal diameter."""
        amplitude = np.empty((U.shape[0], U.shape[1] // 2 + 1, U.shape[2]), complex)
        amplitude[:, 0] = U[:, 0]
        amplitude[:, 1:] = U[:, 1::2] - 1j * U[:, 2::2]
        return np.fft.fft(amplitude, axis=0)

    @staticmethod
    def add_amplitudes(out: NDArray, amplitude: NDArray) -> None:
        """Adds complex amplitudes (n_blades, n_harmonics + 1, n) to coefficients."""
        out[:, 0] += amplitude[:, 0].real
        out[:, 1::2] += amplitude[:, 1:].real
        out[:, 2::2] -= amplitude[:, 1:].imag

    def linear(self, X: NDArray, omega: float, damping: float = 0.0) -> NDArray:
        """(K - (l omega)^2 M + i l omega (C + damping omega M)) x."""
        K, M, C = self._parts(X)
        w = (self.order * omega)[:, None]
        return K - w**2 * M + w * (C + damping * omega * turned(M) if damping else C)

    # ---- contact ----

    def motion(self, X: NDArray) -> NDArray:
        """(n_blades, n_points, 3, n_coefficients) relative motion without the constant part."""
        s = self.structure
        x = np.empty((self.shape[0], len(s.sector), 3, self.shape[1]))
        for which, points in enumerate(self.constants.groups):
            z = X if which == 0 else np.concatenate([np.roll(X[..., : s.n], -1, axis=0), X[..., s.n :]], axis=2)
            v = z @ s.rows[points].reshape(-1, self.shape[2]).T
            x[:, points] = v.transpose(0, 2, 1).reshape(self.shape[0], len(points), 3, self.shape[1])
        return x

    def gathered(self, F: NDArray) -> NDArray:
        """Forces at the points (n_blades, n_points, 3, n_coefficients) on the coordinates."""
        s = self.structure
        out = np.zeros(self.shape)
        for which, points in enumerate(self.constants.groups):
            f = F[:, points].reshape(self.shape[0], -1, self.shape[1]).transpose(0, 2, 1)
            z = f @ s.rows[points].reshape(-1, self.shape[2])
            out[..., s.n :] += z[..., s.n :]
            out[..., : s.n] += np.roll(z[..., : s.n], which, axis=0)
        return out

    def forces(self, X: NDArray, tangent: bool = False) -> tuple[NDArray, NDArray, NDArray | None]:
        """Contact forces (n_blades, n_points, 3, n_coefficients), shares (n_blades, n_points, 5), tangents."""
        x = self.motion(X)
        x[..., 0] += self.shift
        F, shares, T = self.contact.forces(x.reshape(-1, *x.shape[2:]), tangent)
        self.evaluations += 1
        active = self.constants.active
        F[..., ~active] = 0.0
        if T is not None:
            T[..., ~active, :] = 0.0
            T[..., ~active] = 0.0
            T = T.reshape(*x.shape[:2], *T.shape[1:])
        return F.reshape(x.shape), shares.reshape(*x.shape[:2], 5), T

    # ---- residual ----

    def residual(self, X: NDArray, omega: float, ease: Ease = PLAIN) -> NDArray:
        """Residual of the equations, eased or as they are."""
        return self._residual(X, self.linear(X, omega, ease.damping), self.forces(X)[0], ease)

    def _residual(self, X: NDArray, linear: NDArray, F: NDArray, ease: Ease) -> NDArray:
        r = linear + self.gathered(F) - self.force
        if ease.springs:
            n = self.structure.n
            r[:, 0, n:] += ease.springs * self.constants.damper_springs * (X[:, 0, n:] - self.home)
        r[self.still] = X[self.still]
        return r

    def linearised(self, X: NDArray, omega: float, ease: Ease = PLAIN, held: float = NEUTRAL) -> Linearised:
        """Residual with its derivatives at a point, the mean of dampers held by springs of so much of their stiffness."""
        K, M, C = self._parts(X)
        l = self.order[:, None]
        F, shares, T = self.forces(X, True)
        assert T is not None
        by_omega = -2.0 * l**2 * omega * M + l * C
        if ease.damping:
            lost = ease.damping * omega * turned(M)
            C, by_omega = C + lost, by_omega + 2.0 * l * lost
        r = self._residual(X, K - (l * omega) ** 2 * M + l * omega * C, F, ease)
        by_omega[self.still] = 0.0
        return Linearised(
            self, omega, r, by_omega, T, shares, (held + ease.springs) * self.constants.damper_springs, ease.damping
        )

    def size(self, r: NDArray) -> float:
        """Largest entry of a residual, relative to excitation and static load."""
        return float(np.abs(r * self.row_scale).max())


def turned(x: NDArray) -> NDArray:
    """Coefficients of i times the amplitudes; none of the mean."""
    out = np.zeros_like(x)
    out[:, 1::2], out[:, 2::2] = x[:, 2::2], -x[:, 1::2]
    return out


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residual and derivatives at a point.

    Parameters
    ----------
    system : WheelSystem
    omega : float, rad/s
    residual, by_omega : (n_blades, n_coefficients, n_sector) float
    tangents : (n_blades, n_points, 7, n_coefficients, n_coefficients) float
    shares : (n_blades, n_points, 5) float
    springs : (n_blades, n_damper) float
        On the mean of dampers.
    damping : float
        Of eased equations.
    """

    system: WheelSystem
    omega: float
    residual: NDArray
    by_omega: NDArray
    tangents: NDArray
    shares: NDArray
    springs: NDArray
    damping: float = 0.0

    @cached_property
    def _dense(self) -> NDArray:
        """(n_blades, n_points, 3 n_coefficients, 3 n_coefficients) tangents."""
        N, P, _, m, _ = self.tangents.shape
        out = np.zeros((N, P, 3, m, 3, m))
        for k, (a, b) in enumerate(PAIRS):
            out[:, :, a, :, b] = self.tangents[:, :, k]
        return out.reshape(N, P, 3 * m, 3 * m)

    def product(self, X: NDArray) -> NDArray:
        """Jacobian times a change of the unknowns."""
        system = self.system
        x = system.motion(X)
        F = np.matmul(self._dense, x.reshape(*x.shape[:2], -1, 1)).reshape(x.shape)
        r = system.gathered(F)
        self._add_linear(X, r)
        r[:, 0, system.structure.n :] += self.springs * X[:, 0, system.structure.n :]
        r[system.still] = X[system.still]
        return r

    @cached_property
    def _waves(self) -> NDArray:
        """(n_blades, n_harmonics + 1, n, n) complex matrices of disk and damping, transposed, of every nodal diameter."""
        s, n, r = self.system.structure, self.system.structure.n, self.system.structure.local.n_interface
        w = self.omega * np.arange(self.system.n_harmonics + 1)[:, None, None]
        out = 1j * w * s.damping[:, None]
        out[..., n - r :, n - r :] += s.disk_stiffness[:, None] - (w**2 - 1j * w * self.lost) * s.disk_mass[:, None]
        return out.transpose(0, 1, 3, 2)

    @property
    def lost(self) -> float:
        """Damping of eased equations, relative to the mass (1/s)."""
        return self.damping * self.omega

    def _add_linear(self, X: NDArray, r: NDArray) -> None:
        """Adds (K - (l omega)^2 M + i l omega (C + lost M)) x, as :meth:`WheelSystem.linear` does."""
        system, s = self.system, self.system.structure
        n, w = s.n, (system.order * self.omega)[:, None]
        U, Y = X[..., :n], X[..., n:]
        inertia = U @ s.mass
        r[..., :n] += U @ s.stiffness.transpose(0, 2, 1) - w**2 * inertia
        r[..., n:] += (s.damper_stiffness - w**2 * s.damper_mass[:, None]) * Y
        r[..., n:] += w * turned((s.damper_damping + self.lost * s.damper_mass[:, None]) * Y)
        if self.damping:
            r[..., :n] += w * self.lost * turned(inertia)
        wave = np.matmul(system.waves(U)[:, :, None], self._waves)[:, :, 0]
        system.add_amplitudes(r[..., :n], np.fft.ifft(wave, axis=0))

    def inverse(self) -> Inverse:
        """The approximate inverse of the Jacobian here; its memory is that of any other made before in this thread.

        Raises
        ------
        FloatingPointError
            If a block of it is singular.
        """
        system, s, k = self.system, self.system.structure, self.system.constants.kept
        system.factorisations += 1
        near_k, near_m = (near[-k:, -k:] for near in system.constants.kernel[3:])
        of, core = system.constants.condensation(self.omega)
        condensed = of.at(self.omega, system.n_harmonics, self.lost)
        w = self.omega * np.arange(system.n_harmonics + 1)
        squares = (w**2)[:, None, None]
        lost = w[:, None, None] * (s.damper_damping + self.lost * s.damper_mass)
        own, following = (np.ascontiguousarray(self.tangents[:, g]) for g in system.constants.groups)
        factored = core.factor(
            own,
            following,
            condensed.stiffness,
            condensed.damping,
            np.stack([s.damper_stiffness - squares * s.damper_mass, lost], axis=2),
            np.ascontiguousarray(self.springs),
            near_k - squares * near_m,
        )
        if not factored:
            raise FloatingPointError("a sector of the wheel has a singular matrix")
        return Inverse(self, condensed, core, factored)


@dataclass(frozen=True, eq=False)
class Inverse:
    """An approximate inverse P of the Jacobian of a system, and what it leaves out (module's docstring).

    It serves until the next one is made in the same thread; the core refuses it afterwards.

    Parameters
    ----------
    at : Linearised
        Where it was made.
    condensed : Condensed
    core : Elimination
        In the C core.
    factored : int
        By which the core knows its factors.
    """

    at: Linearised
    condensed: Condensed
    core: Elimination
    factored: int

    def __call__(self, r: NDArray) -> NDArray:
        """P^-1 r, (n_blades, n_coefficients, n_sector)."""
        system, n = self.at.system, self.at.system.structure.n
        on_b, on_z = self.condensed.forces(r[..., :n])
        on_b = np.concatenate([on_b, r[..., n:]], axis=2)
        x = np.empty_like(on_b)
        self.core.solve(self.factored, on_b, x)
        left = x.shape[2] - system.structure.n_damper
        out = np.concatenate([self.condensed.motion(x[..., :left], on_z), x[..., left:]], axis=2)
        out[system.still] = r[system.still]
        return out

    @cached_property
    def by_omega(self) -> NDArray:
        """P^-1 times the derivative of the residual by the frequency."""
        return self(self.at.by_omega)

    def on_root(self, r: NDArray) -> NDArray:
        """Root shapes' part of P^-1 r, with r on these alone; both (n_blades, n_coefficients, n_root)."""
        system, k = self.at.system, self.at.system.constants.kept
        shapes, flexibility = self._condensed_root
        left, less = shapes.shape[3], r.shape[2] - k
        on_b, out = np.zeros((*r.shape[:2], left + system.structure.n_damper)), np.empty_like(r)
        on_b[..., left - k : left] = r[..., less:]
        for l, Q in enumerate(shapes):
            on_b[:, pair(l), :left] += r[:, pair(l), :less] @ Q
        x = np.empty_like(on_b)
        self.core.solve(self.factored, on_b, x)
        out[..., less:] = x[..., left - k : left]
        for l, (Q, F) in enumerate(zip(shapes, flexibility, strict=True)):
            out[:, pair(l), :less] = x[:, pair(l), :left] @ Q.transpose(0, 2, 1) + r[:, pair(l), :less] @ F
        return out

    @cached_property
    def _condensed_root(self) -> tuple[NDArray, NDArray]:
        """Condensed root shapes by what is left, and their own flexibility, of the mean and every harmonic."""
        of, system = self.condensed.of, self.at.system
        less = slice(system.constants.root.start, system.constants.root.stop - system.constants.kept)
        rest = of.rest[:, less]
        shapes = rest @ self.condensed.follow
        shapes[..., : of.contact.shape[1]] += of.contact[less]
        return shapes, (rest * self.condensed.flexibility[:, :, None]) @ rest.transpose(0, 2, 1)

    @cached_property
    def _far(self) -> NDArray:
        """(n_blades, n_harmonics + 1, n_root, n_root) complex, transposed, of every nodal diameter."""
        stiffness, mass, eased, damping = (m[:, None] for m in self.at.system.constants.far)
        w = self.at.omega * np.arange(self.at.system.n_harmonics + 1)[:, None, None]
        return (stiffness - w**2 * mass + 1j * w * (damping + self.at.lost * eased)).transpose(0, 1, 3, 2)

    def left_out(self, y: NDArray) -> NDArray:
        """R y, on root shapes (n_blades, n_coefficients, n_root)."""
        out = np.zeros_like(y)
        wave = np.matmul(self.at.system.waves(y)[:, :, None], self._far)[:, :, 0]
        self.at.system.add_amplitudes(out, np.fft.ifft(wave, axis=0))
        return out
