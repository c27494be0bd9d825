"""Disturbances of a travelling wave: exponents of the linearised equations with the memory of sliders.

In the frame of the wave every sector has the same contact coefficients, so a disturbance of the ring is

    dx_k(t) = Re sum_l q_l exp((lambda + i l omega) t + i k (d + l EO) 2 pi/N),

with harmonic ``l`` in the nodal diameter ``d + l EO``.  Disturbances with ``d = 0`` have the nodal diameters of the wave,
whose modes the harmonic balance contains for ``l = -H..H``.  Their exponents are the roots of

    det D(lambda) = 0,    D = diag[(s_l^2 M + s_l C + K)_l] + G^H B(lambda) G,    s_l = lambda + i l omega.

``B`` contains the Fourier coefficients of the linearised contact over the cycle: stick ``kt (du - dw)``, slip ``+-mu kn
dv``, contact ``kn dv``.  A slider set at the angle ``a`` that sticks until ``b`` stores the disturbance at ``a``,

    dw = (du + f dv)(a),

with ``f = -+mu kn/kt`` at a slip-to-stick event after positive (negative) slip, and ``f = -u'/v'`` at a closing.  In
Fourier coefficients the memory has rank one and depends on the exponent, with ``z = lambda/omega + i l``:

    dT_l = -kt exp(-i l a) (1 - exp(-z (b - a)))/(2 pi z) sum_m exp(i m a) (du_m + f dv_m).

The sum over ``l`` ends at the harmonics of the motion, as in harmonic balance.  ``D(0)`` is the Jacobian of the harmonic
balance in complex coefficients.

**Number of growing disturbances.**  ``det D`` is analytic.  By the argument principle the change of its phase around a
region is 2 pi times the number of roots in it.  The region is to the right of a line parallel to the imaginary axis, up to
a highest frequency.  The phase is taken relative to the product of ``lambda - lambda_r`` over estimates of roots away from
the region, which makes it smooth.  Estimates close to the path are left out, because they could hide a root on its other
side.  Any root appears in phase, magnitude or curvature of the determinant along the path, which is refined there.  The
count is therefore independent of the estimates.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED, LAW_CONSTANT, LAW_CUBIC
from bdamper.contact.static_state import OPEN, SLIP_MINUS, SLIP_PLUS, STICK
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.sector import Sector, segments
from bdamper.model.kinematics import HarmonicBasis
from bdamper.response.continuation import TWO_PI

SMOOTH = 0.9
"""Largest change between neighbouring points of phase (rad), logarithm of the magnitude, and its derivative.

With 0.8 and 1.0 36 points of six curves have the same counts, with 3 % more and 3 % fewer points of the path.
"""
MOST_PLACES = 20_000
ACROSS = 16
"""Points on the part of the path away from the line."""
BESIDE = 0.25
"""Estimates within this distance of the region (in omega) are left out."""
CHUNK = 8


class WaveDisturbances:
    """Matrix D of one solution.

    Parameters
    ----------
    system : Equations[Sector]
        Without coupled friction, which has no event sequence.
    u : (n_unknowns,) float
    omega : float, rad/s
    bases : sequence of HarmonicBasis, optional
        Modes of the harmonics, the mean first; those of the motion by default.
    """

    def __init__(
        self, system: Equations[Sector], u: NDArray, omega: float, bases: Sequence[HarmonicBasis] | None = None
    ) -> None:
        self.omega = omega
        modes = system.structure.bases if bases is None else bases
        both = {l: modes[abs(l)] for l in range(1 - len(modes), len(modes)) if len(modes[abs(l)].omega2)}
        G = np.concatenate([basis.G if l >= 0 else basis.G.conj() for l, basis in both.items()], axis=2)  # (points, 3, n)
        self.l = np.repeat(np.array(list(both), float), [len(b.omega2) for b in both.values()])
        self.mass, self.damping, self.stiffness = (
            np.concatenate([getattr(b, name) for b in both.values()]) for name in ("mass", "damping", "omega2")
        )
        x, _, _ = system.contact(np.asarray(u))
        pieces, events = cycles(system, x)
        self._blocks = np.split(np.arange(len(self.l)), np.cumsum([len(b.omega2) for b in both.values()])[:-1])
        self.steady = _steady(pieces, G, list(both), self._blocks)
        point, axis, begin, self._length, factor = events
        kt = system.structure.points.kt[point, axis][:, None]
        g, turn = G[point, axis], np.exp(1j * begin[:, None] * self.l)
        self._rows = np.ascontiguousarray((kt / TWO_PI * g.conj() / turn).T)
        self._columns = (g + factor[:, None] * G[point, 2]) * turn
        self._distinct, self._place = np.unique(self.l, return_inverse=True)

    def matrix(self, exponent: NDArray) -> NDArray:
        """Return D (k, n, n) complex at the exponents (k,), rad/s."""
        exponent = np.atleast_1d(np.asarray(exponent, complex))
        s = exponent[:, None] + 1j * self.l * self.omega
        out = np.broadcast_to(self.steady, (len(s), *self.steady.shape)).copy()
        k = np.arange(len(self.l))
        out[:, k, k] += self.stiffness + s * self.damping + s**2 * self.mass
        if self._length.size:
            weighted = (self._rows * self._held(exponent)).reshape(-1, len(self._length))
            out -= (weighted @ self._columns).reshape(out.shape)
        return out

    def _held(self, exponent: NDArray) -> NDArray:
        """Return (1 - exp(-z L))/z (k, n, events) by order l, with z = lambda/omega + i l and the length L of each stick
        segment.
        """
        x = (exponent[:, None, None] / self.omega + 1j * self._distinct[:, None]) * self._length
        zero = x == 0.0
        held = np.where(zero, 1.0, -np.expm1(-x) / np.where(zero, 1.0, x)) * self._length
        return np.asarray(held[:, self._place])

    def estimates(self) -> NDArray:
        """Return the roots of the blocks of single harmonics without memory, with their conjugates."""
        out = []
        for k in self._blocks:
            block, s = np.ix_(k, k), 1j * self.l[k[0]] * self.omega
            free = np.diag(self.stiffness[k] + s * self.damping[k] + s**2 * self.mass[k])
            out.append(_pencil(self.steady[block] + free, self.damping[k] + 2.0 * s * self.mass[k], self.mass[k]))
        return np.concatenate(out)

    def growing(self, rate: float, band: float) -> int:
        """Return the number of exponents with a real part above ``rate`` and an imaginary part within ``+-band``.

        Parameters
        ----------
        rate, band : float, rad/s

        Raises
        ------
        FloatingPointError
            If the phase cannot be followed.
        """
        roots = self.estimates()
        aside, over = roots.real - rate, np.abs(roots.imag) - band
        distance = np.hypot(np.minimum(aside, 0.0), np.maximum(over, 0.0))
        roots = roots[distance > BESIDE * self.omega + np.maximum(aside, 0.0)]
        far = 3.0 * float(np.abs(roots).max(initial=0.0)) + 10.0 * band
        # along the line, to the right, and back to the real axis; the lower half is symmetric
        line = np.linspace(0.0, band, int(np.ceil(4.0 * band / self.omega)) + 1)
        away = np.geomspace(self.omega / 8.0, far, ACROSS)
        path = np.concatenate([rate + 1j * line, rate + away + 1j * band, [rate + far]])
        value = self._relative(path, roots)
        while True:
            gap = np.diff(path)
            width, change = np.abs(gap), np.diff(value)
            change.imag = _wrapped(change.imag)
            rough = (np.abs(change.imag) > SMOOTH) | (np.abs(change.real) > SMOOTH)
            # the derivative changes if roots without an estimate are within one interval
            slope = change / gap
            ahead, behind = np.append(slope[1:], slope[-1]), np.append(slope[0].conj(), slope[:-1])
            rough |= np.abs(ahead - behind) * width > SMOOTH
            # neighbouring intervals differ by at most a factor of ten, so that a long one hides no root
            rough[1:] |= width[1:] > 10.0 * width[:-1]
            rough[:-1] |= width[:-1] > 10.0 * width[1:]
            rough &= width > 1e-13 * self.omega
            if not rough.any():
                break
            if len(path) > MOST_PLACES:
                raise FloatingPointError("the phase of the determinant cannot be followed")
            new = 0.5 * (path[:-1] + path[1:])[rough]
            at = np.flatnonzero(rough) + 1
            path, value = np.insert(path, at, new), np.insert(value, at, self._relative(new, roots))
        turn = float(_wrapped(np.diff(value.imag)).sum()) / np.pi
        if abs(turn - round(turn)) > 0.05:
            raise FloatingPointError("the phase of the determinant does not change by a whole number of turns")
        return -round(turn)

    def _relative(self, exponent: NDArray, roots: NDArray) -> NDArray:
        """Return the complex logarithm (k,) of det D over the product of the distances to the roots.

        Memory adds roots, but far to the right only the masses determine the growth of the determinant.  Roots at
        ``-omega`` compensate the difference in number.
        """
        rest = 2 * np.count_nonzero(self.mass) - len(roots)
        product = np.log(exponent[:, None] - roots).sum(axis=1) + rest * np.log(exponent + self.omega)
        return np.asarray(self._determinant(exponent) - product)

    def _determinant(self, exponent: NDArray) -> NDArray:
        """Return the complex logarithm (k,) of det D."""
        out = np.empty(len(exponent), complex)
        for start in range(0, len(exponent), CHUNK):
            part = slice(start, start + CHUNK)
            sign, size = np.linalg.slogdet(self.matrix(exponent[part]))
            out[part] = size + 1j * np.angle(sign)
        return out


def rests(system: Equations[Sector], u: NDArray) -> bool:
    """Return whether no slider moves, no contact state changes, and all springs and dampers are passive."""
    a = system.structure.arrays
    if not system.structure.exact or np.isin(a["law"], LAW_CUBIC).any():
        return False
    if min(a["kt"].min(initial=0.0), a["kn"].min(initial=0.0), a["damping"].min(initial=0.0)) < 0.0:
        return False
    _, _, shares = system.contact(np.asarray(u))
    slips = (a["kt"] > 0.0) & (a["mu"] > 0.0)[:, None] & (shares[:, [1, 3]] > 0.0)
    changes = (shares[:, 4] > 0.0) & (shares[:, 4] < 1.0)
    return not (slips.any() or changes.any())


def _pencil(K: NDArray, damping: NDArray, mass: NDArray) -> NDArray:
    """Return the finite eigenvalues of mass s^2 + damping s + K, two for each mass."""
    n, C = len(mass), np.diag(damping)
    eye, zero = np.eye(n), np.zeros((n, n))
    values = scipy.linalg.eigvals(np.block([[zero, eye], [-K, -C]]), scipy.linalg.block_diag(eye, np.diag(mass)))
    values = values[np.isfinite(values)]
    return np.asarray(values[np.argsort(np.abs(values))][: 2 * np.count_nonzero(mass)])


def _wrapped(phase: NDArray) -> NDArray:
    return (phase + np.pi) % TWO_PI - np.pi


NORMAL = 0  # kinds of contact stiffness: kn v v; 1, 2: kt u_d u_d; 3, 4: mu kn u_d v


def _steady(pieces: tuple[NDArray, ...], G: NDArray, orders: list[int], blocks: list[NDArray]) -> NDArray:
    """Return G^H B G (n, n) without memory; B from the Fourier coefficients of each segment of the cycle.

    They are ``1/2 pi int_a^b exp(-i d theta)`` for the differences d of two orders.
    """
    point, kind, a, b, weight = pieces
    n_points, n = G.shape[0], G.shape[2]
    d = np.arange(1, max(orders) - min(orders) + 1)
    wave = np.empty((len(a), len(d) + 1), complex)
    wave[:, 0] = b - a
    wave[:, 1:] = (np.exp(-1j * np.outer(b, d)) - np.exp(-1j * np.outer(a, d))) / (-1j * d)
    wave *= weight[:, None] / TWO_PI
    sums = np.zeros((n_points * 5, len(d) + 1), complex)
    slot = 5 * point + kind
    if len(slot):
        first = np.flatnonzero(np.append(True, np.diff(slot) != 0))
        sums[slot[first]] = np.add.reduceat(wave, first, axis=0)
    sums = sums.reshape(n_points, 5, len(d) + 1)
    out = np.empty((n, n), complex)
    left = np.ascontiguousarray(G.conj().reshape(3 * n_points, n).T)
    for m, columns in zip(orders, blocks):
        g = G[:, :, columns]
        for l, rows in zip(orders, blocks):
            c = sums[:, :, abs(l - m)]
            c = (c if l >= m else c.conj())[:, :, None]  # conjugate symmetry of a real function
            force = np.empty_like(g)
            force[:, 0] = c[:, 1] * g[:, 0] + c[:, 3] * g[:, 2]
            force[:, 1] = c[:, 2] * g[:, 1] + c[:, 4] * g[:, 2]
            force[:, 2] = c[:, 0] * g[:, 2]
            out[np.ix_(rows, columns)] = left[rows] @ force.reshape(3 * n_points, -1)
    return out


def slope_at(x: NDArray, theta: float) -> NDArray:
    """Return the derivatives with respect to the angle of motions x, given as Fourier coefficients."""
    l = np.arange(1, x.shape[-1] // 2 + 1)
    b = np.zeros(x.shape[-1])
    b[1::2], b[2::2] = -l * np.sin(l * theta), l * np.cos(l * theta)
    return np.asarray(x @ b)


def cycles(system: Equations[Sector], x: NDArray) -> tuple[tuple[NDArray, ...], tuple[NDArray, ...]]:
    """Return the contact states over the cycle.

    Returns
    -------
    pieces : point, kind, begin, end, weight (N/m)
        Segments with stiffness, in ascending order of point and kind.
    events : point, axis, begin, length, factor
        Stick segments whose slider is set at their beginning.
    """
    p = system.structure.points
    pieces: list[tuple[int, int, float, float, float]] = []
    events: list[tuple[int, int, float, float, float]] = []
    load = system.structure.arrays["load"]
    for i in range(system.n_points):
        law, mu, kn, n0 = int(p.law[i]), float(p.mu[i]), float(p.kn[i]), float(p.n0[i])
        kt = [float(k) for k in p.kt[i]]
        reach = 0.0 if law == LAW_CONSTANT else mu * kn
        parts: list[list[tuple[float, float, int]]] = [[], []]
        if law == LAW_BONDED:
            parts = [[(0.0, TWO_PI, STICK)]] * 2
        elif mu > 0.0:
            parts = segments(x[i], p.kt[i], kn, mu, n0, p.slider[i], law, "event_driven", float(load[i]))
        if law in (LAW_BONDED, LAW_CONSTANT):
            pieces.append((i, NORMAL, 0.0, TWO_PI, kn))
        else:
            seen = next((parts[d] for d in range(2) if kt[d] > 0.0 and parts[d]), None)
            if seen is None:  # without friction: separation from a slider with negligible friction
                seen = segments(x[i], np.full(2, kn), kn, 1e-12, n0, np.zeros(2))[0] if kn > 0.0 else []
            pieces += [(i, NORMAL, a, b, kn) for a, b, state in seen if state != OPEN]
        parts = [_united(list(f)) for f in parts]
        for d in range(2):
            if kt[d] > 0.0:
                pieces += [(i, 1 + d, a, b, kt[d]) for a, b, state in parts[d] if state == STICK]
        for d in range(2):
            if kt[d] <= 0.0:
                continue
            for k, (a, b, state) in enumerate(parts[d]):
                if state in (SLIP_PLUS, SLIP_MINUS):
                    if reach > 0.0:
                        pieces.append((i, 3 + d, a, b, reach if state == SLIP_PLUS else -reach))
                elif state == STICK and len(parts[d]) > 1:  # permanent stick sets no slider
                    factor = {SLIP_PLUS: -reach / kt[d], SLIP_MINUS: reach / kt[d]}.get(parts[d][k - 1][2])
                    if factor is None:
                        slope = slope_at(x[i], a)
                        factor = -slope[d] / slope[2] if slope[2] != 0.0 else 0.0
                    events.append((i, d, a, b - a, factor))
    return _columns(pieces), _columns(events)


def _columns(rows: list[tuple[int, int, float, float, float]]) -> tuple[NDArray, ...]:
    table = np.array(rows, float).reshape(-1, 5).T
    return (table[0].astype(int), table[1].astype(int), *table[2:])


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
