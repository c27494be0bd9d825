"""Time integration with exact events of a structure with one real basis, to measure multipliers by differences.

Between two events the equations are linear with constant coefficients.  Sliders, the harmonics of the excitation and a
constant are states beside displacement and velocity, so one matrix exponential carries all of it over a step, exactly; an
event within a step is bracketed by bisection.  Nothing is linearised about a motion: a disturbed motion meets its own
events.  Rates of the slider: 0 while it sticks, that of ``u -+ mu N/kt`` in slip, that of ``u`` while the contact is open.
"""

import numpy as np
from scipy.linalg import expm

STICK, PLUS, MINUS, OPEN = range(4)
TOLERANCE = 1e-11


class EventIntegrator:
    """One structure under its excitation at one frequency; ``z`` holds q, q', the sliders, cos and sin of harmonics, 1."""

    def __init__(self, system, omega, n_steps=1024):
        p, basis = system.structure.points, system.structure.bases[0]
        self.system, self.omega, self.h, self.n_steps = (
            system,
            omega,
            2 * np.pi / omega / n_steps,
            n_steps,
        )
        self.n, G = len(basis.omega2), np.asarray(basis.G).real
        self.pairs = [
            (i, d)
            for i in range(system.n_points)
            for d in range(2)
            if p.mu[i] > 0 and p.kt[i, d] > 0
        ]
        n, m = self.n, len(self.pairs)
        force = system.structure.force
        self.orders = [
            l
            for l in range(1, system.n_harmonics + 1)
            if any(force[s].any() for s in system.layout.slices(l))
        ]
        k = len(self.orders)
        self.m, self.size = m, 2 * n + m + 2 * k + 1
        self.load = np.zeros((system.n_points, self.size))  # normal load of a closed contact
        self.load[:, :n], self.load[:, -1] = p.kn[:, None] * G[:, 2], p.n0 + p.kn * p.shift[:, 2]
        self.u, self.lo, self.hi = (np.zeros((m, self.size)) for _ in range(3))
        for j, (i, d) in enumerate(self.pairs):
            self.u[j, :n], self.u[j, -1] = G[i, d], p.shift[i, d]
            reach = p.mu[i] / p.kt[i, d] * self.load[i]
            self.lo[j], self.hi[j] = self.u[j] - reach, self.u[j] + reach
        A = np.zeros((self.size, self.size))
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n, :n] = -np.diag(basis.omega2)
        A[n : 2 * n, n : 2 * n] = -np.diag(basis.damping)
        A[n : 2 * n, -1] = system.structure.force[:n]
        for c, l in zip(range(2 * n + m, self.size, 2), self.orders):
            for column, rows in zip((c, c + 1), system.layout.slices(l)):
                A[n : 2 * n, column] = system.structure.force[rows]
            A[c, c + 1], A[c + 1, c] = -l * omega, l * omega
        self.free, self.G, self.steps = A, G, {}

    def rate(self, row):
        """Row of the time derivative of a combination of displacements."""
        out = np.zeros(self.size)
        out[self.n : 2 * self.n] = row[: self.n]
        return out

    def matrix(self, closed, states):
        A, p, n = self.free.copy(), self.system.structure.points, self.n
        for i in np.flatnonzero(closed):
            A[n : 2 * n] -= np.outer(self.G[i, 2], self.load[i])
        for j, (i, d) in enumerate(self.pairs):
            slider = 2 * n + j
            force = {PLUS: p.mu[i] * self.load[i], MINUS: -p.mu[i] * self.load[i]}.get(
                states[j], np.zeros(self.size)
            )
            if states[j] == STICK:
                force = p.kt[i, d] * self.u[j]
                force[slider] -= p.kt[i, d]
            else:
                A[slider] = self.rate({PLUS: self.lo, MINUS: self.hi, OPEN: self.u}[states[j]][j])
            A[n : 2 * n] -= np.outer(self.G[i, d], force)
        return A

    def violated(self, z, closed, states):
        """Points whose contact changes, and directions whose friction does."""
        load, w = self.load @ z, z[2 * self.n : 2 * self.n + self.m]
        small = TOLERANCE * (np.abs(self.load) @ np.abs(z) + 1e-300)
        points = np.where(closed, load < -small, load > small)
        scale = TOLERANCE * (np.abs(self.u) @ np.abs(z) + np.abs(w) + 1e-300)
        speed = TOLERANCE * self.omega * 10 * (np.abs(self.u) @ np.abs(z) + 1e-300)
        up, down = self.lo @ z - w > scale, w - self.hi @ z > scale
        falls = np.array([self.rate(r) @ z for r in self.lo]) < -speed
        rises = np.array([self.rate(r) @ z for r in self.hi]) > speed
        states = np.array(states)
        return points, ((states == STICK) & (up | down)) | ((states == PLUS) & falls) | (
            (states == MINUS) & rises
        )

    def changed(self, z, closed, states):
        """Contact and friction after what is violated has changed."""
        points, directions = self.violated(z, closed, states)
        closed, states = np.where(points, ~closed, closed), list(states)
        for j, (i, _) in enumerate(self.pairs):
            if points[i] and not closed[i]:
                states[j] = OPEN
            elif points[i]:  # closing: it sticks if the bounds draw apart around the slider
                lo, hi = self.rate(self.lo[j]) @ z, self.rate(self.hi[j]) @ z
                states[j] = PLUS if lo > 0 else MINUS if hi < 0 else STICK
            elif directions[j]:
                w = z[2 * self.n + j]
                above = self.lo[j] @ z - w > w - self.hi[j] @ z
                states[j] = (PLUS if above else MINUS) if states[j] == STICK else STICK
        return closed, states

    def start(self, u, states, sliders):
        """State at angle 0 of a harmonic-balance solution, with the sliders of its sticking directions."""
        q, v = np.zeros(self.n), np.zeros(self.n)
        for l in range(self.system.n_harmonics + 1):
            a = self.system.layout.amplitudes(u, l)
            q, v = q + a.real, v + (1j * l * self.omega * a).real
        z = np.concatenate([q, v, sliders, np.tile([1.0, 0.0], len(self.orders)), [1.0]])
        return self.slaved(z, states)

    def slaved(self, z, states):
        """The same with the sliders of all other directions where they must be."""
        z = z.copy()
        for j, state in enumerate(states):
            if state != STICK:
                z[2 * self.n + j] = {PLUS: self.lo, MINUS: self.hi, OPEN: self.u}[state][j] @ z
        return z

    def period(self, z, closed, states):
        """State, contact and friction after one period, and the number of events."""
        events = 0
        for k in range(self.n_steps):
            left = self.h
            while left > 0.0:
                key = (bytes(closed), tuple(states))
                if key not in self.steps:
                    A = self.matrix(closed, states)
                    self.steps[key] = A, expm(A * self.h)
                A, whole = self.steps[key]
                end = (whole if left == self.h else expm(A * left)) @ z
                if not any(v.any() for v in self.violated(end, closed, states)):
                    z, left = end, 0.0
                    continue
                a, b = 0.0, left
                while b - a > 1e-14 * self.h * self.n_steps:
                    middle = 0.5 * (a + b)
                    hit = any(v.any() for v in self.violated(expm(A * middle) @ z, closed, states))
                    a, b = (a, middle) if hit else (middle, b)
                z = expm(A * b) @ z
                closed, states = self.changed(z, closed, states)
                z, left, events = self.slaved(z, states), left - b, events + 1
                assert events < 10_000, "events without end"
            theta = 2 * np.pi * (k + 1) / self.n_steps * np.array(self.orders)
            z[2 * self.n + self.m : -1] = np.ravel([np.cos(theta), np.sin(theta)], order="F")
        return z, closed, states, events

    def multipliers(self, z, closed, states, sliders, difference=1e-6):
        """By central differences in displacement, velocity and the sliders listed; sizes, largest first."""
        n = self.n
        index = np.concatenate([np.arange(2 * n), 2 * n + np.array(sliders, int)]).astype(int)
        size = np.abs(z[:n]).max() * np.repeat(
            [1.0, self.omega, np.abs(self.G).max()], [n, n, len(sliders)]
        )
        columns = []
        for c, step in zip(index, difference * size):
            ends = []
            for sign in (1.0, -1.0):
                moved = z.copy()
                moved[c] += sign * step
                ends.append(
                    self.period(self.slaved(moved, states), closed.copy(), list(states))[0][index]
                )
            columns.append((ends[0] - ends[1]) / (2 * step))
        values = np.linalg.eigvals(np.array(columns).T)
        return values[np.argsort(-np.abs(values))]
