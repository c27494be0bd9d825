"""Time integration in plain NumPy: one dense matrix from all coordinates to all points of all sectors, and back.

``time_response`` is explicit (central differences), in as many steps as the stiffest contact needs; ``implicit`` takes the
steps of the core, with the contact forces from a dense Newton method.
"""

import numpy as np

from bdamper.contact.laws import (
    LAW_BONDED,
    LAW_CONSTANT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_CUBIC,
    LAW_NORMAL,
)
from bdamper.time_domain.integration import Motion


def matrices(ring):
    """A (n_sectors n_points 3, 2 n_coordinates) and B: x = A q, and the force over the modal mass (if there is any) B F."""
    n_rows = 3 * ring.system.n_points
    out = np.zeros((ring.n * n_rows, ring.n_coordinates), complex)
    factors = np.zeros(ring.n_coordinates)
    for l, s, phases, factor in ring.blocks:
        G = np.asarray(ring.wide.structure.bases[l].G).reshape(n_rows, -1)
        out[:, s] = (phases[:, None, None] * G).reshape(ring.n * n_rows, -1)
        factors[s] = factor
    back = (factors / np.where(ring.mass > 0.0, ring.mass, 1.0))[:, None] / ring.n * out.conj().T
    B = np.vstack([back.real, back.imag])
    B[ring.n_coordinates :][ring.real] = 0.0
    return np.hstack([out.real, -out.imag]), B


def force(ring, x, w):
    """Contact force and slider after the law was applied, for motion x (n_sectors, n_points, 3) and slider w before."""
    p = ring.system.structure.points
    kt, law = p.kt, np.asarray(p.law)
    mu = np.where(law == LAW_NORMAL, 0.0, p.mu)
    constant = (law == LAW_CONSTANT) | (law == LAW_COUPLED_CONSTANT)
    normal = p.n0 + p.kn * x[:, :, 2]
    normal = np.where(constant | (law == LAW_BONDED), normal, np.maximum(normal, 0.0))
    reach = mu * np.where(constant, np.maximum(p.n0 if p.load is None else p.load, 0.0), normal)
    u = x[:, :, :2]
    limit = np.where(kt > 0.0, reach[:, :, None] / np.where(kt > 0.0, kt, 1.0), 0.0)
    moved = np.clip(w, u - limit, u + limit)
    size = np.sqrt(((kt * (u - w)) ** 2).sum(axis=2))
    share = np.where(size > reach, reach / np.where(size > 0.0, size, 1.0), 1.0)
    coupled = ((law == LAW_COUPLED) | (law == LAW_COUPLED_CONSTANT))[:, None]
    moved = np.where(coupled & (kt > 0.0), u - share[:, :, None] * (u - w), moved)
    w = np.where(ring.held, w, moved)
    F = np.concatenate([kt * (u - w), normal[:, :, None]], axis=2)
    cubic = law == LAW_CUBIC
    F[:, cubic, :2] = kt[cubic] * u[:, cubic] ** 3
    return F, w


def integrate(ring, motion, omega, n_steps, steps, first=0, omega_end=None):
    """Motion after so many steps, and the coordinates at the start of each."""
    A, B = matrices(ring)
    orders, factors = ring.forcing()
    q, v, w = motion
    mass, omega2, damping, stiffness = (
        np.tile(x, 2) for x in (ring.mass, ring.omega2, ring.damping, ring.stiffness)
    )
    light = (mass == 0.0) & (
        np.abs(B).sum(axis=1) > 0.0
    )  # imaginary parts of real coordinates are none
    springs = np.tile(
        np.column_stack([ring.system.structure.points.kt, ring.system.structure.points.kn]).ravel(),
        ring.n,
    )
    closed = np.diag(stiffness[light]) + B[light] @ (springs[:, None] * A[:, light])

    def excitation(k):
        angle = 2.0 * np.pi * (k % n_steps) / n_steps * orders
        return (np.cos(angle) @ factors[:, 0] + np.sin(angle) @ factors[:, 1]) / np.where(
            mass > 0.0, mass, 1.0
        )

    def contact(k, q, w):
        """Modal force, coordinates, of which those without mass are found by chord iterations, and sliders."""
        for _ in range(20000):
            x = (A @ q).reshape(ring.n, -1, 3) + ring.system.structure.points.shift
            F, moved = force(ring, x, w)
            pressed = B @ F.ravel()
            missing = (stiffness * q + pressed - excitation(k))[light]
            if np.abs(missing).max(initial=0.0) <= 1e-13 * np.abs(pressed).max():
                return np.where(mass > 0.0, pressed, 0.0), q, moved
            q = q.copy()
            q[light] -= np.linalg.solve(closed, missing)
        raise AssertionError("no convergence")

    square = np.linspace(omega**2, (omega if omega_end is None else omega_end) ** 2, steps + 1)
    pressed, q, w = contact(first, q, w)
    a = np.where(mass > 0.0, excitation(first), 0.0) - omega2 * q - damping * v - pressed
    trace = []
    for k in range(steps):
        h = 4.0 * np.pi / n_steps / (np.sqrt(square[k]) + np.sqrt(square[k + 1]))
        trace.append(q)
        half, s_before = v + 0.5 * h * a, q[light]
        q = q + h * half
        pressed, q, w = contact(first + k + 1, q, w)
        rest = np.where(mass > 0.0, excitation(first + k + 1), 0.0) - omega2 * q - pressed
        v = (half + 0.5 * h * rest) / (1.0 + 0.5 * h * damping)
        v[light] = (q[light] - s_before) / h
        a = rest - damping * v
    return Motion(q, v, w), np.array(trace)


def derivative(ring, x, w):
    """Dense derivative of all contact forces by all motions, by differences to the side where a law has a corner."""
    n, small = x.size, 1e-7
    out = np.zeros((n, n))
    for d in range(3):
        moved = x.copy()
        moved[:, :, d] += small
        by = (force(ring, moved, w)[0] - force(ring, x, w)[0]) / small
        for e in range(3):
            rows, columns = (np.arange(n).reshape(x.shape)[:, :, i].ravel() for i in (e, d))
            out[rows, columns] = by[:, :, e].ravel()
    return out


def implicit(ring, motion, omega, n_steps, steps, radius=0.8, first=0):
    """Motion after so many steps of the generalised alpha method, and the coordinates at the start of each."""
    A, B = matrices(ring)
    orders, factors = ring.forcing()
    q, v, w, a = motion[:4]
    m, c, K = (np.tile(x, 2) for x in (ring.mass, ring.damping * ring.mass, ring.stiffness))
    heavy = m > 0.0
    B = np.where(heavy, m, 1.0)[:, None] * B  # forces, and not over the mass
    K = np.where(np.abs(A).sum(axis=0) > 0.0, K, 1.0)
    am, af = (2.0 * radius - 1.0) / (radius + 1.0), radius / (radius + 1.0)
    gamma, b = 0.5 - am + af, 0.25 * (1.0 - am + af) ** 2
    h = 2.0 * np.pi / omega / n_steps

    def excitation(k):
        angle = 2.0 * np.pi * (k % n_steps) / n_steps * orders
        return np.cos(angle) @ factors[:, 0] + np.sin(angle) @ factors[:, 1]

    def contact(free, beta, w):
        """Modal forces g = B F(A (free - beta g)): Newton's method, halved where it does not help."""

        def off(g):
            x = (A @ (free - beta * g)).reshape(ring.n, -1, 3) + ring.system.structure.points.shift
            F, moved = force(ring, x, w)
            return B @ F.ravel() - g, x, moved

        g = np.zeros(len(free))
        for _ in range(200):
            missing, x, moved = off(g)
            if np.abs(missing).max() <= 1e-12 * np.abs(g).max():
                return g, moved
            by = np.linalg.solve(np.eye(len(g)) + B @ derivative(ring, x, w) @ (A * beta), missing)
            share = next(
                (
                    s
                    for s in (1.0, 0.5, 0.25, 0.1)
                    if np.linalg.norm(off(g + s * by)[0]) < np.linalg.norm(missing)
                ),
                0.05,
            )
            g = g + share * by
        raise AssertionError("no convergence")

    if a is None:
        q = np.where(heavy, q, excitation(first) / K)
        beta = np.where(heavy, 0.0, 1.0 / K)
        g, w = contact(q, beta, w)
        q = q - beta * g
        a = np.where(heavy, excitation(first) - c * v - K * q - g, 0.0) / np.where(heavy, m, 1.0)
    else:
        g, w = contact(q, np.zeros(len(q)), w)
    late = 1.0 - af
    inertia = m * (1.0 - am) + late * (c * gamma * h + K * b * h * h)
    ease = np.where(heavy, late / inertia, 0.0)
    beta = np.where(heavy, b * h * h * ease, 1.0 / K)
    trace = []
    for k in range(first, first + steps):
        trace.append(q)
        e, e_next = excitation(k), excitation(k + 1)
        rest = late * e_next + af * (e - g) - m * am * a - c * (v + late * h * (1.0 - gamma) * a)
        rest = rest - K * (q + late * (h * v + h * h * (0.5 - b) * a))
        faster = ease / late * rest
        free = np.where(heavy, q + h * v + h * h * ((0.5 - b) * a + b * faster), e_next / K)
        g, w = contact(free, beta, w)
        faster, end = faster - ease * g, free - beta * g
        v = np.where(heavy, v + h * ((1.0 - gamma) * a + gamma * faster), (end - q) / h)
        q, a = end, faster
    return Motion(q, v, w, a), np.array(trace)
