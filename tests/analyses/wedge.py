"""The planar wedge between two masses of N. N. Balaji and E. Ferhatoglu, "Vibration response variability in friction-damped
systems": its parameters, restated from the text of their programs (https://github.com/Nidish96/nonuniq), and a program of
its nonlinear modes in plain NumPy that has nothing but the law of a contact in common with the package's oracle.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

import bdamper as bd
from tests import oracle

MASS = np.array([1.0, 1.0, 1.0, 1.0, 0.1, 0.1])
DAMPING = np.array([20.0, 20.0, 20.0, 20.0, 0.0, 0.0])
STIFFNESS, LOAD, ANGLE = 3e5, 120.0, np.deg2rad(30.0)
"""N/m of springs to the ground, between the directions of a mass, and of the contacts; N on the wedge."""


def stiffness():
    """x and y of the first mass, of the second, and of the wedge."""
    K = np.diag([STIFFNESS] * 4 + [0.0, 0.0])
    for k, (i, j) in ((7e5, (0, 2)), (7e5, (1, 3)), (3e5, (0, 1)), (3e5, (2, 3)), (3e5, (4, 5))):
        K[np.ix_([i, j], [i, j])] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return K


def rows():
    """(2, 2, 6) sliding and closing of both contacts."""
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    left, right = np.array([[c, s], [-s, c]]), np.array([[c, -s], [s, c]])
    nothing = np.zeros((2, 2))
    return np.array([np.hstack([-left, nothing, left]), np.hstack([nothing, -right, right])])


def study(mu, harmonics):
    contacts = [
        bd.Contact(
            *({i: x for i, x in enumerate(row) if x} for row in one),
            kt=STIFFNESS,
            kn=STIFFNESS,
            mu=mu,
        )
        for one in rows()
    ]
    return bd.lumped(
        MASS,
        DAMPING,
        stiffness(),
        contacts=contacts,
        forces={0: 1.0},
        load_per_preload={5: 1.0},
        harmonics=harmonics,
    )


class Program:
    """Nonlinear modes of the wedge in physical coordinates: exact law, derivatives by differences, steps of arclength.

    A point ``z`` has the coefficients (6, 2 H + 1) of the six motions, the vibration over the amplitude of the first, then
    frequency (in units of 1000 rad/s), damping ratio and the logarithm of that amplitude.
    """

    def __init__(self, mu, harmonics):
        self.mu, self.n_coef, self.K, self.G = mu, 2 * harmonics + 1, stiffness(), rows()
        self.l = np.repeat(np.arange(1, harmonics + 1), 2)
        self.slider = np.zeros(2)
        q = np.zeros(6)
        for part in np.linspace(0.1, 1.0, 10):  # the load grows, the sliders move on
            q = self.rest(q, part * LOAD)
            u, limit = self.G[:, 0] @ q, mu * np.maximum(self.G[:, 1] @ q, 0.0)
            self.slider = np.clip(self.slider, u - limit, u + limit)
        self.q = q

    def rest(self, q, load):
        def residual(q):
            u, v = (self.G @ q).T
            n = STIFFNESS * np.maximum(v, 0.0)
            t = np.clip(STIFFNESS * (u - self.slider), -self.mu * n, self.mu * n)
            return (
                self.K @ q
                + np.einsum("pdi,pd->i", self.G, np.stack([t, n], axis=1))
                - load * np.eye(6)[5]
            )

        for _ in range(60):
            r = residual(q)
            J = np.array(
                [(residual(q + 1e-9 * e) - residual(q - 1e-9 * e)) / 2e-9 for e in np.eye(6)]
            ).T
            q = q - np.linalg.lstsq(J, r, rcond=1e-12)[0]
        assert np.abs(residual(q)).max() < 1e-9 * LOAD
        return q

    def motion(self, z):
        """(S, 6, 2 H + 1) coefficients of points (S, n)."""
        x = z[:, :-3].reshape(len(z), 6, self.n_coef).copy()
        x[:, :, 1:] *= np.exp(z[:, -1])[:, None, None]
        return x

    def residuals(self, z):
        x, omega, a = self.motion(z), 1e3 * z[:, -3], np.exp(z[:, -1])
        seen = np.einsum("pdi,sim->spdm", self.G, x)
        both = np.stack([seen[:, :, 0], np.zeros_like(seen[:, :, 0]), seen[:, :, 1]], axis=2)
        k, w = np.full((2, 2), STIFFNESS), np.stack([self.slider, np.zeros(2)], axis=1)
        force = oracle.contacts(both, k, k[:, 0], np.full(2, self.mu), np.zeros(2), w)
        r = np.einsum("ij,sjm->sim", self.K, x) + np.einsum(
            "pdi,spdm->sim", self.G, force[:, :, [0, 2]]
        )
        r[:, 5, 0] -= LOAD
        speed = omega[:, None] * self.l
        r[:, :, 1:] -= MASS[:, None] * (speed**2)[:, None, :] * x[:, :, 1:]
        losses = DAMPING[:, None] - (2.0 * omega * z[:, -2])[:, None, None] * MASS[:, None]
        turned = np.stack([x[:, :, 2::2], -x[:, :, 1::2]], axis=3).reshape(
            *x.shape[:2], -1
        )  # i q: cosines get the sines
        r[:, :, 1:] += losses * speed[:, None, :] * turned
        r[:, :, 1:] /= a[:, None, None]
        out = np.hstack([r[:, :, 0] / LOAD, r[:, :, 1:].reshape(len(z), -1) / STIFFNESS])
        return np.hstack([out, z[:, [1]] - 1.0, z[:, [2]]])

    def newton(self, z, row, most=7):
        """To the equations in the plane through z normal to the row (n,), with the tangent; None where it fails."""
        h, start, length = 1e-8 * self.units(z), z, np.inf
        for _ in range(most):
            ends = self.residuals(np.concatenate([z[None], z + np.diag(h)]))
            B = np.vstack([(ends[1:] - ends[0]).T, row * h])  # by steps h
            if not (np.isfinite(B).all() and np.linalg.cond(B) < 1e15):
                return None
            both = np.linalg.solve(
                B, np.array([-np.append(ends[0], row @ (z - start)), np.eye(len(z))[-1]]).T
            )
            z, before, length = (
                z + h * both[:, 0],
                length,
                np.abs(h * both[:, 0] / self.units(z)).max(),
            )
            if length < 1e-10:
                return z, h * both[:, 1]
            if length > max(0.5 * before, 1e-7) and before < np.inf:
                return None
        return None

    def units(self, z):
        size = np.full(len(z), 1.0)
        size[:-3].reshape(6, -1)[:, 0] = 1e-3
        size[-2] = 0.1
        return size

    def stuck(self, number):
        """Frequency (rad/s) and shape of a mode of stuck contact, from 0."""
        K = self.K + STIFFNESS * np.einsum("pdi,pdj->ij", self.G, self.G)
        square, shapes = scipy.linalg.eigh(K, np.diag(MASS))
        return np.sqrt(square[number]), shapes[:, number]

    def start(self, omega, shape, amplitude):
        """The linear mode, a guess."""
        x = np.zeros((6, self.n_coef))
        x[:, 0], x[:, 1] = self.q, shape / shape[0]
        return np.concatenate([x.ravel(), [1e-3 * omega, 0.01, np.log(amplitude)]])

    def branch(self, z, high, most_step=2.0):
        """(m, n) points from a guess up to an amplitude."""
        end = np.eye(len(z))[-1]
        z, t = self.newton(z, end, 20)
        size = self.units(z)
        points, step, t = [z], 0.05, t / np.linalg.norm(t / size)
        while points[-1][-1] < np.log(high) and len(points) < 1000:
            assert step > 1e-9, "no step leads on"
            guess, row = points[-1] + step * t, t / size**2
            found = self.newton(guess, row)
            if found is not None:
                new, tangent = found
                tangent *= np.sign(tangent @ row) / np.linalg.norm(tangent / size)
                cosine = (tangent / size) @ (t / size)
                near = np.linalg.norm((new - guess) / size) < 0.5 * step
                if near and (cosine > 0.8 or step < 1e-4):
                    points.append(new)
                    t, step = tangent, min(most_step, 2.0 * step)
                    continue
            step *= 0.5
        return np.array(points)

    def forced(self, omega, force):
        """(6, 2 H + 1) motion under a force on the first mass along x, from the linear response."""
        K = self.K + STIFFNESS * np.einsum("pdi,pdj->ij", self.G, self.G)
        linear = np.linalg.solve(
            K - omega**2 * np.diag(MASS) + 1j * omega * np.diag(DAMPING), force * np.eye(6)[0]
        )
        x = np.zeros((6, self.n_coef))
        x[:, 0], x[:, 1], x[:, 2] = self.q, linear.real, -linear.imag
        x, h = x.ravel(), 1e-11

        def residual(x):
            rest = np.broadcast_to([1e-3 * omega, 0.0, 0.0], (len(x), 3))
            r = self.residuals(np.hstack([x, rest]))[:, :-2]
            r[:, 6] -= force / STIFFNESS
            return r

        for _ in range(30):
            ends = residual(np.concatenate([x[None], x + h * np.eye(len(x))]))
            x = x - np.linalg.lstsq((ends[1:] - ends[0]).T / h, ends[0], rcond=1e-12)[0]
            if np.abs(ends[0]).max() < 1e-12:
                return x.reshape(6, -1)
        raise AssertionError("no periodic response")
