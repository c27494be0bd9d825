"""The march in time in plain NumPy: one dense matrix from all coordinates to all points of all sectors, and back."""

import numpy as np

from bdamper.contact.laws import LAW_BONDED, LAW_CONSTANT, LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_CUBIC, LAW_NORMAL
from bdamper.stability.time_integration import Motion


def matrices(ring):
    """A (n_sectors n_points 3, 2 n_coordinates) and B: x = A q, and the force over the modal mass (if there is any) B F."""
    n_rows = 3 * ring.system.n_points
    out = np.zeros((ring.n * n_rows, ring.n_coordinates), complex)
    factors = np.zeros(ring.n_coordinates)
    for l, s, phases, factor in ring.blocks:
        G = np.asarray(ring.system.bases[l].G).reshape(n_rows, -1)
        out[:, s] = (phases[:, None, None] * G).reshape(ring.n * n_rows, -1)
        factors[s] = factor
    back = (factors / np.where(ring.mass > 0.0, ring.mass, 1.0))[:, None] / ring.n * out.conj().T
    B = np.vstack([back.real, back.imag])
    B[ring.n_coordinates :][ring.real] = 0.0
    return np.hstack([out.real, -out.imag]), B


def force(ring, x, w):
    """Contact force and slider after the law was applied, for motion x (n_sectors, n_points, 3) and slider w before."""
    p = ring.system.points
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


def march(ring, motion, omega, n_steps, steps, first=0, omega_end=None):
    """Motion after so many steps, and the coordinates at the start of each."""
    A, B = matrices(ring)
    orders, factors = ring.forcing()
    q, v, w = motion
    mass, omega2, damping, stiffness = (np.tile(x, 2) for x in (ring.mass, ring.omega2, ring.damping, ring.stiffness))
    light = (mass == 0.0) & (np.abs(B).sum(axis=1) > 0.0)  # imaginary parts of real coordinates are none
    springs = np.tile(np.column_stack([ring.system.points.kt, ring.system.points.kn]).ravel(), ring.n)
    closed = np.diag(stiffness[light]) + B[light] @ (springs[:, None] * A[:, light])

    def excitation(k):
        angle = 2.0 * np.pi * (k % n_steps) / n_steps * orders
        return (np.cos(angle) @ factors[:, 0] + np.sin(angle) @ factors[:, 1]) / np.where(mass > 0.0, mass, 1.0)

    def contact(k, q, w):
        """Modal force, coordinates, of which those without mass are found by chord iterations, and sliders."""
        for _ in range(20000):
            x = (A @ q).reshape(ring.n, -1, 3) + ring.system.points.shift
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
