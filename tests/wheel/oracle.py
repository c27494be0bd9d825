"""Plain NumPy counterpart of the elimination of a wheel (csrc/bd_wheel.c), all sectors batched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.many_points import PAIRS
from bdamper.wheel.system import Linearised, WheelSystem


@dataclass(frozen=True)
class Ring:
    """Factors of a ring of at least three sectors.

    Parameters
    ----------
    inverse : (N, s, s) float
        Of the diagonal block of every sector when its turn comes.
    lower, last : (N - 1, s, s) float
        Coupling of the next sector, and of the last one, to each.
    onward, fill : (N - 1, s, s) float
        Inverse times the coupling to the next sector, and to the last one.
    """

    inverse: NDArray
    lower: NDArray
    last: NDArray
    onward: NDArray
    fill: NDArray

    @classmethod
    def of(cls, lower: NDArray, diagonal: NDArray, upper: NDArray) -> Self:
        """Factors of the blocks L, D, U (N, s, s) of the module's docstring."""
        N, s, _ = diagonal.shape
        inverse, D = np.empty_like(diagonal), diagonal[0]
        V, W, end = upper[N - 1], lower[0], diagonal[N - 1]
        rows, last = np.zeros((N - 1, s, s)), np.empty((N - 1, s, s))
        onward, fill = np.zeros((N - 1, s, s)), np.empty((N - 1, s, s))
        for n in range(N - 1):
            if n == N - 2:
                V, W = V + lower[N - 1], W + upper[N - 2]
            inverse[n], last[n] = np.linalg.inv(D), V
            fill[n] = inverse[n] @ W
            end = end - V @ fill[n]
            if n < N - 2:
                onward[n], rows[n] = inverse[n] @ upper[n], lower[n + 1]
                D = diagonal[n + 1] - rows[n] @ onward[n]
                V, W = -V @ onward[n], -rows[n] @ fill[n]
        inverse[N - 1] = np.linalg.inv(end)
        return cls(inverse, rows, last, onward, fill)

    def solve(self, b: NDArray) -> NDArray:
        """x (N, s) of the right-hand sides b (N, s)."""
        N = len(self.inverse)
        x = b.copy()
        for n in range(N - 1):
            x[n] = self.inverse[n] @ x[n]
            if n < N - 2:
                x[n + 1] -= self.lower[n] @ x[n]
            x[N - 1] -= self.last[n] @ x[n]
        x[N - 1] = self.inverse[N - 1] @ x[N - 1]
        for n in range(N - 2, -1, -1):
            x[n] -= self.fill[n] @ x[N - 1]
            if n < N - 2:
                x[n] -= self.onward[n] @ x[n + 1]
        return x


@dataclass(frozen=True, eq=False)
class Inverse:
    """Approximate inverse of a Jacobian (module's docstring).

    Parameters
    ----------
    system : WheelSystem
    own : (n_blades, e, e) float
        Inverse of the blocks of the blade coordinates that are eliminated first.
    back : (n_blades, e, q) float
        That times their coupling to root shapes, own damper and damper of the sector before.
    rows : (n_blades, q, e) float
        Coupling of these to the eliminated coordinates.
    ring : Ring
    """

    system: WheelSystem
    own: NDArray
    back: NDArray
    rows: NDArray
    ring: Ring

    @classmethod
    def of(cls, at: Linearised) -> Inverse:
        """Factors at a point."""
        system = at.system
        first, before = _sector_blocks(at)
        N, nc, ns = system.shape
        n, k = system.structure.n, system.constants.kept
        e, nd = n - k, ns - n
        ia, iy = slice(e, n), slice(n, ns)

        def flat(block: NDArray) -> NDArray:
            return block.reshape(N, nc * block.shape[2], -1)

        own = np.linalg.inv(flat(first[:, :, :e, :, :e]))
        columns = [flat(b) for b in (first[:, :, :e, :, ia], first[:, :, :e, :, iy], before[:, :, :e, :, iy])]
        rows = [flat(b) for b in (first[:, :, ia, :, :e], first[:, :, iy, :, :e], before[:, :, iy, :, :e])]
        row, back = np.concatenate(rows, axis=1), own @ np.concatenate(columns, axis=2)
        S = -row @ back
        a, y, p = slice(0, nc * k), slice(nc * k, nc * (k + nd)), slice(nc * (k + nd), nc * (k + 2 * nd))
        ay = slice(0, nc * (k + nd))
        S[:, a, a] += flat(first[:, :, ia, :, ia])
        S[:, a, y] += flat(first[:, :, ia, :, iy])
        S[:, y, a] += flat(first[:, :, iy, :, ia])
        S[:, y, y] += flat(first[:, :, iy, :, iy])
        S[:, a, p] += flat(before[:, :, ia, :, iy])
        S[:, p, a] += flat(before[:, :, iy, :, ia])
        diagonal, lower, upper = S[:, ay, ay].copy(), np.zeros_like(S[:, ay, ay]), np.zeros_like(S[:, ay, ay])
        diagonal[:, y, y] += np.roll(S[:, p, p], -1, axis=0)
        lower[:, :, y] = S[:, ay, p]
        upper[:, y, :] = np.roll(S[:, p, ay], -1, axis=0)
        neighbour = _neighbour(system, at.omega)
        lower[:, a, a] += neighbour
        upper[:, a, a] += neighbour.T
        return cls(system, own, back, row, Ring.of(lower, diagonal, upper))

    def __call__(self, r: NDArray) -> NDArray:
        """Approximate solution (n_blades, n_coefficients, n_sector) of the Jacobian for a right-hand side."""
        system = self.system
        N, nc, ns = system.shape
        n, k = system.structure.n, system.constants.kept
        e = n - k
        t = np.matmul(self.own, r[..., :e].reshape(N, -1, 1))[..., 0]
        left = np.matmul(self.rows, t[..., None])[..., 0]
        ring = np.concatenate([r[..., e:n].reshape(N, -1), r[..., n:].reshape(N, -1)], axis=1)
        size = ring.shape[1]
        ring -= left[:, :size]
        ring[:, nc * k :] -= np.roll(left[:, size:], -1, axis=0)
        x = self.ring.solve(ring)
        y = x[:, nc * k :]
        t -= np.matmul(self.back, np.concatenate([x, np.roll(y, 1, axis=0)], axis=1)[..., None])[..., 0]
        out = np.empty(system.shape)
        out[..., :e] = t.reshape(N, nc, e)
        out[..., e:n] = x[:, : nc * k].reshape(N, nc, k)
        out[..., n:] = y.reshape(N, nc, ns - n)
        return out


def _sector_blocks(at: Linearised) -> tuple[NDArray, NDArray]:
    """Jacobian of each sector's own blade and damper, and of its blade with the damper before: (N, nc, ns, nc, ns)."""
    system, s = at.system, at.system.structure
    N, nc, ns = system.shape
    n = s.n
    outer = [
        np.stack([np.einsum("pi,pj->pij", s.rows[g, a], s.rows[g, b]) for a, b in PAIRS], axis=1).reshape(-1, ns**2)
        for g in system.constants.groups
    ]

    def summed(which: int) -> NDArray:
        T = at.tangents[:, system.constants.groups[which]].reshape(N, -1, nc * nc)
        return (T.transpose(0, 2, 1) @ outer[which]).reshape(N, nc, nc, ns, ns).transpose(0, 1, 3, 2, 4)

    first, right = summed(0).copy(), summed(1)
    first[:, :, n:, :, n:] += right[:, :, n:, :, n:]
    before = np.roll(right, 1, axis=0)
    first[:, :, :n, :, :n] += before[:, :, :n, :, :n]
    disk_k, disk_m, damping, _, _ = system.constants.kernel
    r = s.local.n_interface
    stiffness, mass = s.stiffness.copy(), s.mass.copy()
    stiffness[:, n - r :, n - r :] += disk_k
    mass[n - r :, n - r :] += disk_m
    y = np.arange(n, ns)
    for c, l in enumerate(system.order):
        w = l * at.omega
        first[:, c, :n, c, :n] += stiffness - w**2 * mass
        first[:, c, y, c, y] += s.damper_stiffness - w**2 * s.damper_mass
        if l == 0:
            first[:, c, y, c, y] += at.springs
        elif c % 2:
            own, damper = w * (damping + at.lost * mass), w * (s.damper_damping + at.lost * s.damper_mass)
            first[:, c, :n, c + 1, :n] += own
            first[:, c + 1, :n, c, :n] -= own
            first[:, c, y, c + 1, y] += damper
            first[:, c + 1, y, c, y] -= damper
    if system.still.any():
        flat = first.reshape(N, nc * ns, nc * ns)
        sector, place = np.nonzero(system.still.reshape(N, -1))
        flat[sector, place] = 0.0
        flat[sector, :, place] = 0.0
        flat[sector, place, place] = 1.0
        first = flat.reshape(first.shape)
    return first, before


def _neighbour(system: WheelSystem, omega: float) -> NDArray:
    """Coupling of the kept root shapes to those of the sector before, all coefficients."""
    *_, stiffness, mass = system.constants.kernel
    k, nc = system.constants.kept, system.shape[1]
    out = np.zeros((nc, k, nc, k))
    for c, l in enumerate(system.order):
        if system.constants.active[c]:
            out[c, :, c] = (stiffness - (l * omega) ** 2 * mass)[-k:, -k:]
    return out.reshape(nc * k, nc * k)
