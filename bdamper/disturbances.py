"""Disturbances of a travelling wave: exponents of the linearised equations with the memory of sliders.

In the frame that runs with the wave every sector has the same contact coefficients, so a disturbance of the ring is

    dx_k(t) = Re sum_l q_l exp((lambda + i l omega) t + i k (d + l EO) 2 pi/N),

harmonic ``l`` in the nodal diameter ``d + l EO``.  Those with ``d = 0`` live in the nodal diameters of the wave itself,
whose modes the harmonic balance has: with ``l = -H..H`` nothing else is needed.  All others need the modes of their own
nodal diameters.  The exponents of either are the roots of

    det D(lambda) = 0,    D = diag[(s_l^2 M + s_l C + K)_l] + G^H B(lambda) G,    s_l = lambda + i l omega.

``B`` holds the Fourier coefficients of the linearised contact over the cycle: stick ``kt (du - dw)``, slip ``+-mu kn dv``,
contact ``kn dv``.  A slider that was set at the angle ``a`` and sticks until ``b`` remembers the disturbance then,

    dw = (du + f dv)(a),    f = -+mu kn/kt after slip in the positive (negative) sense, -u'/v' after a closing,

which in coefficients is of rank one and depends on the exponent, with ``z = lambda/omega + i l``:

    dT_l = -kt exp(-i l a) (1 - exp(-z (b - a)))/(2 pi z) sum_m exp(i m a) (du_m + f dv_m).

The sum over ``l`` is cut off at the harmonics of the motion, as harmonic balance itself is.
``D(0)`` is the Jacobian of the harmonic balance in complex coefficients.

**Number of growing disturbances.**  ``det D`` is analytic, so by the argument principle the turn of its phase around a
region counts the roots in it: those to the right of a line parallel to the imaginary axis, up to a highest frequency.  The
phase is taken relative to the product of ``lambda - lambda_r`` over estimates of all roots, which is smooth where the
estimates are good; the way is refined wherever it is not, so the count does not depend on them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.coupling import HarmonicBasis
from bdamper.system import (
    LAW_BONDED,
    LAW_CONSTANT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    HarmonicSystem,
    segments,
)

TWO_PI = 2.0 * np.pi
STICK, SLIP_PLUS, SLIP_MINUS, OPEN = range(4)
PHASE, LEVEL = 0.8, 0.9
"""Largest change of phase (rad) and of the logarithm of the size from one place on the line to the next."""
MOST_PLACES = 20_000
NEWTON_STEPS = 3
CHUNK = 64


class WaveDisturbances:
    """The matrix D of one solution.

    Parameters
    ----------
    system : HarmonicSystem
        Without coupled friction.
    u : (n_unknowns,) float
    omega : float, rad/s
    bases : mapping of l to HarmonicBasis, optional
        Modes of the nodal diameters ``d + l EO``; by default those of the wave itself, ``d = 0``.
    """

    def __init__(
        self, system: HarmonicSystem, u: NDArray, omega: float, bases: Mapping[int, HarmonicBasis] | None = None
    ) -> None:
        if np.isin(system.arrays["law"], (LAW_COUPLED, LAW_COUPLED_CONSTANT)).any():
            raise ValueError("coupled friction has no event sequence")
        self.omega = omega
        self.mirrored = bases is None  # exponents come with their conjugates
        if bases is None:
            own = system.bases
            bases = {l: own[abs(l)] for l in range(1 - len(own), len(own)) if len(own[abs(l)].omega2)}
            shapes = [basis.G if l >= 0 else basis.G.conj() for l, basis in bases.items()]
        else:
            shapes = [basis.G for basis in bases.values()]
        G = np.concatenate(shapes, axis=2)  # (n_points, 3, n)
        self.l = np.repeat(np.array(list(bases), float), [len(b.omega2) for b in bases.values()])
        self.mass, self.damping, self.stiffness = (
            np.concatenate([getattr(b, name) for b in bases.values()]) for name in ("mass", "damping", "omega2")
        )
        x, _, _ = system.contact(np.asarray(u))
        n = len(self.l)
        self.steady = np.zeros((n, n), complex)
        rows, columns, length = [], [], []
        p = system.points
        load = p.n0 if p.load is None else p.load
        orders = self.l
        distinct, self._place = np.unique(orders, return_inverse=True)
        self._distinct = distinct
        difference = distinct[:, None] - distinct
        expand = np.ix_(self._place, self._place)

        def part(parts: list[tuple[float, float]]) -> NDArray:
            return np.asarray(_part(parts, difference)[expand])

        for i in range(system.n_points):
            law = int(p.law[i])
            closed, directions = _cycle(system, x[i], i, float(load[i]))
            self.steady += p.kn[i] * part(closed) * np.outer(G[i, 2].conj(), G[i, 2])
            for d, parts in enumerate(directions):
                kt = float(p.kt[i, d])
                if kt <= 0.0 or not parts:
                    continue
                g = G[i, d]
                reach = 0.0 if law == LAW_CONSTANT else float(p.mu[i] * p.kn[i])
                stick = [(a, b) for a, b, state in parts if state == STICK]
                self.steady += kt * part(stick) * np.outer(g.conj(), g)
                for sense, sign in ((SLIP_PLUS, 1.0), (SLIP_MINUS, -1.0)):
                    slip = [(a, b) for a, b, state in parts if state == sense]
                    if slip and reach > 0.0:
                        self.steady += sign * reach * part(slip) * np.outer(g.conj(), G[i, 2])
                if len(parts) == 1:
                    continue  # one state all through: nothing is set
                for k, (a, b, state) in enumerate(parts):
                    if state != STICK:
                        continue
                    factor = {SLIP_PLUS: -reach / kt, SLIP_MINUS: reach / kt}.get(parts[k - 1][2])
                    if factor is None:
                        slope = _slope(x[i], a)
                        factor = -slope[d] / slope[2] if slope[2] != 0.0 else 0.0
                    rows.append(kt * g.conj() * np.exp(-1j * orders * a) / TWO_PI)
                    columns.append((g + factor * G[i, 2]) * np.exp(1j * orders * a))
                    length.append(b - a)
        self._rows = np.array(rows).reshape(-1, n).T
        self._columns = np.array(columns).reshape(-1, n)
        self._length = np.array(length)

    def matrix(self, exponent: NDArray) -> NDArray:
        """(k, n, n) complex D at the exponents (k,), rad/s."""
        exponent = np.atleast_1d(np.asarray(exponent, complex))
        s = exponent[:, None] + 1j * self.l * self.omega
        out = np.broadcast_to(self.steady, (len(s), *self.steady.shape)).copy()
        k = np.arange(len(self.l))
        out[:, k, k] += self.stiffness + s * self.damping + s**2 * self.mass
        if self._length.size:
            z = (exponent[:, None, None] / self.omega + 1j * self._distinct[:, None]) * self._length
            small = np.abs(z) < 1e-8
            held = np.where(small, 1.0 - 0.5 * z, -np.expm1(-z) / np.where(small, 1.0, z)) * self._length
            out -= (self._rows * held[:, self._place]) @ self._columns
        return out

    def estimates(self, band: float) -> NDArray:
        """Roots of D with the memory that sliders have of slow disturbances, and without one for fast disturbances.

        Those within the band (rad/s) are improved.
        """
        near, n = 0.5 * self.omega, 2 * int((self.mass > 0.0).sum())
        slow, fast = self._pencil(self.matrix(np.zeros(1))[0]), self._pencil(None)
        chosen = np.concatenate([slow[np.abs(slow.imag) <= near], fast[np.abs(fast.imag) > near]])
        if not self.mirrored:
            chosen = self._improved(chosen, band)[:n]
            return np.append(chosen, np.full(n - len(chosen), -self.omega))
        upper = self._improved(chosen[chosen.imag > 1e-9 * self.omega], band)
        level = chosen[np.abs(chosen.imag) <= 1e-9 * self.omega].real
        # as many as there are roots, and their own mirror image
        upper = upper[: n // 2]
        rest = n - 2 * len(upper)
        level = np.append(level, np.full(rest, -self.omega))[:rest]
        return np.concatenate([upper, upper.conj(), level])

    def _improved(self, roots: NDArray, band: float) -> NDArray:
        """Roots after some steps of Newton's method on the determinant, none of them long."""
        h, furthest = 1e-4 * self.omega, 0.1 * self.omega
        roots = roots[np.argsort(np.abs(roots.imag))]
        near = roots[np.abs(roots.imag) < band + self.omega]
        far, roots = roots[len(near) :], near
        for _ in range(NEWTON_STEPS):
            for start in range(0, len(roots), CHUNK):
                part = slice(start, start + CHUNK)
                D, ahead = self.matrix(roots[part]), self.matrix(roots[part] + h)
                try:
                    rate = np.trace(np.linalg.solve(D, ahead - D), axis1=1, axis2=2) / h
                except np.linalg.LinAlgError:
                    continue
                step = np.where(rate != 0.0, 1.0 / np.where(rate == 0.0, 1.0, rate), 0.0)
                step *= np.minimum(1.0, furthest / np.maximum(np.abs(step), 1e-300))
                roots[part] = roots[part] - step
        return np.concatenate([roots, far])

    def _pencil(self, at_zero: NDArray | None) -> NDArray:
        n, s = len(self.l), 1j * self.l * self.omega
        K = self.steady + np.diag(self.stiffness + s * self.damping + s**2 * self.mass) if at_zero is None else at_zero
        C = np.diag(self.damping + 2.0 * s * self.mass)
        eye, zero = np.eye(n), np.zeros((n, n))
        heavy = self.mass > 0.0
        if heavy.all():
            inverse = 1.0 / self.mass[:, None]
            A = np.block([[zero, eye], [-inverse * K, -inverse * C]])
            return np.asarray(np.linalg.eigvals(A))
        values = scipy.linalg.eigvals(np.block([[zero, eye], [-K, -C]]), scipy.linalg.block_diag(eye, np.diag(self.mass)))
        values = values[np.isfinite(values)]
        return np.asarray(values[np.argsort(np.abs(values))][: 2 * int(heavy.sum())])

    def growing(self, rate: float, band: float) -> tuple[int, NDArray]:
        """Number of exponents with a real part above ``rate`` and an imaginary part within ``+-band``, and estimates.

        Raises
        ------
        FloatingPointError
            If the phase cannot be followed.
        """
        roots = self.estimates(band)
        far = 3.0 * float(np.abs(roots).max(initial=0.0)) + 10.0 * band
        # along the line, away to the right and back; mirrored, the lower half of the way gives the same turn
        across = rate + np.geomspace(self.omega / 8.0, far, 24)
        inside = roots.imag[(np.abs(roots.imag) < band)]
        line = np.unique(np.concatenate([np.arange(-band, band, self.omega / 8.0), inside, -inside, [0.0, band]]))
        back = np.append(across[::-1], rate) - 1j * band
        way = np.concatenate([rate + 1j * line, across + 1j * band, across[-1:], back])
        if self.mirrored:
            way = way[int(np.searchsorted(line, 0.0)) : len(line) + 25]
        value = self._relative(way, roots)
        while True:
            change, width = np.diff(value), np.abs(np.diff(way))
            rough = (np.abs(_wrapped(change.imag)) > PHASE) | (np.abs(change.real) > LEVEL)
            # intervals grow by no more than a factor, so that none hides what its neighbours begin to show
            rough[1:] |= width[1:] > 3.0 * width[:-1]
            rough[:-1] |= width[:-1] > 3.0 * width[1:]
            away = way[:-1].real > rate + 0.5 * self.omega
            rough[away] = np.abs(_wrapped(change.imag[away])) > PHASE
            rough &= width > 1e-13 * self.omega
            if not rough.any():
                break
            if len(way) > MOST_PLACES:
                raise FloatingPointError("the phase of the determinant cannot be followed")
            new = 0.5 * (way[:-1] + way[1:])[rough]
            at = np.flatnonzero(rough) + 1
            way, value = np.insert(way, at, new), np.insert(value, at, self._relative(new, roots))
        turn = float(_wrapped(np.diff(value.imag)).sum()) / (np.pi if self.mirrored else TWO_PI)
        if abs(turn - round(turn)) > 0.05:
            raise FloatingPointError("the phase of the determinant does not come to a whole number of turns")
        return int(((roots.real > rate) & (np.abs(roots.imag) < band)).sum()) - round(turn), roots

    def _relative(self, exponent: NDArray, roots: NDArray) -> NDArray:
        """(k,) complex logarithm of det D over the product of the distances to the estimates."""
        out = np.empty(len(exponent), complex)
        for start in range(0, len(exponent), CHUNK):
            part = slice(start, start + CHUNK)
            sign, size = np.linalg.slogdet(self.matrix(exponent[part]))
            distance = exponent[part, None] - roots
            reference = np.log(np.where(distance == 0.0, 1e-300, distance)).sum(axis=1)
            out[part] = size + 1j * np.angle(sign) - reference
        return out


def _wrapped(phase: NDArray) -> NDArray:
    return (phase + np.pi) % TWO_PI - np.pi


def _part(parts: list[tuple[float, float]], difference: NDArray) -> NDArray:
    """Coefficients of the indicator of parts of the cycle: 1/2 pi int exp(-i difference theta)."""
    same = difference == 0.0
    out = np.zeros(difference.shape, complex)
    for a, b in parts:
        wave = (np.exp(-1j * difference * b) - np.exp(-1j * difference * a)) / np.where(same, 1.0, -1j * difference)
        out += np.where(same, b - a, wave)
    return out / TWO_PI


def _slope(x: NDArray, theta: float) -> NDArray:
    l = np.arange(1, x.shape[-1] // 2 + 1)
    b = np.zeros(x.shape[-1])
    b[1::2], b[2::2] = -l * np.sin(l * theta), l * np.cos(l * theta)
    return np.asarray(x @ b)


def _cycle(
    system: HarmonicSystem, x: NDArray, i: int, load: float
) -> tuple[list[tuple[float, float]], list[list[tuple[float, float, int]]]]:
    """Parts in contact, and for both directions the parts of the cycle with neighbours of one state united."""
    p = system.points
    law = int(p.law[i])
    whole = [(0.0, TWO_PI)]
    if law == LAW_BONDED:
        return whole, [[(0.0, TWO_PI, STICK)]] * 2
    kn, n0 = float(p.kn[i]), float(p.n0[i])
    # the normal contact: what is open to a slider next to no friction
    probe = segments(x, np.full(2, kn), kn, 1e-12, n0, np.zeros(2))[0] if law != LAW_CONSTANT else []
    closed = whole if law == LAW_CONSTANT else [(a, b) for a, b, state in probe if state != OPEN]
    if law != LAW_CONSTANT and not probe:
        closed = []
    parts: list[list[tuple[float, float, int]]] = [[], []]
    if p.mu[i] > 0.0:
        found = segments(x, p.kt[i], kn, float(p.mu[i]), n0, p.slider[i], law, "exact", load)
        parts = [_united(list(f)) for f in found]
    return closed, parts


def _united(parts: list[tuple[float, float, int]]) -> list[tuple[float, float, int]]:
    out: list[tuple[float, float, int]] = []
    for a, b, state in parts:
        if b <= a:
            continue
        if out and out[-1][2] == state:
            out[-1] = (out[-1][0], b, state)
        else:
            out.append((a, b, state))
    if len(out) > 1 and out[0][2] == out[-1][2]:
        a, b, state = out.pop()
        out[0] = (a - TWO_PI, out[0][1], state)
    return out
