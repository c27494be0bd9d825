"""The nonlinear mode of one mass with an elastic friction element, in closed form and exactly, without the package."""

from __future__ import annotations

import numpy as np
from scipy.optimize import fsolve

MASS, DAMPING, STIFFNESS, CONTACT, LIMIT = 1.0, 0.02, 1.0, 1.0, 1.0


def closed_form(amplitude):
    """Frequency (rad/s) and damping ratio with one harmonic."""
    x, d = amplitude, LIMIT / CONTACT
    if x <= d:
        omega = np.sqrt((STIFFNESS + CONTACT) / MASS)
        return omega, DAMPING / (2.0 * MASS * omega)
    t = np.arccos(1.0 - 2.0 * d / x)
    square = (STIFFNESS + CONTACT / np.pi * (t - 0.5 * np.sin(2.0 * t))) / MASS
    friction = 2.0 * LIMIT * (x - d) / (np.pi * MASS * square * x**2)
    return np.sqrt(square), DAMPING / (2.0 * MASS * np.sqrt(square)) + friction


def exact(amplitude):
    """The same for the exact motion: half a period is two exponentials, one while it sticks and one while it slips.

    Unknown are the largest displacement, half the period, the damping that is balanced, and the end of sticking; known is
    the amplitude of the first harmonic.
    """
    nodes, weights = np.polynomial.legendre.leggauss(40)

    def part(x, v, k, force, damping, t):
        """Displacement and velocity after times t of m x'' + damping x' + k x = force."""
        rest, roots = force / k, np.roots([MASS, damping, k])
        c = np.linalg.solve([[1.0, 1.0], roots], [x - rest, v])
        wave = c * np.exp(np.outer(t, roots))
        return np.stack([rest + wave.sum(axis=1).real, (wave * roots).sum(axis=1).real], axis=1)

    def residual(unknown):
        top, half, xi, end = unknown
        damping = DAMPING - MASS * xi
        stick = (top, 0.0, STIFFNESS + CONTACT, CONTACT * top - LIMIT, damping)
        at_end = part(*stick, end)[0]
        slip = (*at_end, STIFFNESS, LIMIT, damping)
        last = part(*slip, half - end)[0]
        pieces = []
        for a, b, motion in ((0.0, end, stick), (end, half, slip)):
            t = 0.5 * (b - a) * (nodes + 1.0)
            wave = np.exp(-1j * np.pi * (a + t) / half)
            pieces.append((0.5 * (b - a) * weights * wave) @ part(*motion, t)[:, 0])
        first = abs(2.0 / half * sum(pieces))
        return [at_end[0] - top + 2.0 * LIMIT / CONTACT, last[0] + top, last[1], first - amplitude]

    omega, zeta = closed_form(amplitude)
    end = np.arccos(1.0 - 2.0 * LIMIT / CONTACT / amplitude) / omega
    found, _, ok, text = fsolve(
        residual, [amplitude, np.pi / omega, 2.0 * omega * zeta, end], xtol=1e-13, full_output=True
    )
    assert ok == 1 or np.abs(residual(found)).max() < 1e-11, text
    return np.pi / found[1], found[2] * found[1] / (2.0 * np.pi)


def integrated(matrices, contacts, load, omega, x, v, slider, periods, swing=0.0):
    """(periods,) first harmonic of the first freedom: Runge-Kutta with friction sliders, 120 steps in a period.

    Given are M, C and K, and contacts as rows of sliding and closing with kt, kn, mu and a constant normal load.  ``load``
    is static, ``swing`` that of a cosine.
    """
    (mass, damping, stiffness), (slide, close, kt, kn, mu, constant) = matrices, contacts
    steps, seen = 120, []
    h = 2.0 * np.pi / omega / steps

    def rate(x, v, t):
        n = np.maximum(constant + kn * (close @ x), 0.0)
        friction = np.clip(kt * (slide @ x - w), -mu * n, mu * n)
        return v, (
            load
            + swing * np.cos(omega * t)
            - damping * v
            - stiffness @ x
            - slide.T @ friction
            - close.T @ n
        ) / mass

    w = slider
    for t in h * np.arange(periods * steps):
        a = rate(x, v, t)
        b = rate(x + 0.5 * h * a[0], v + 0.5 * h * a[1], t + 0.5 * h)
        c = rate(x + 0.5 * h * b[0], v + 0.5 * h * b[1], t + 0.5 * h)
        d = rate(x + h * c[0], v + h * c[1], t + h)
        x, v = (y + h / 6.0 * (p + 2.0 * (q + r) + s) for y, p, q, r, s in zip((x, v), a, b, c, d))
        limit = mu * np.maximum(constant + kn * (close @ x), 0.0) / kt
        w = np.clip(w, slide @ x - limit, slide @ x + limit)
        seen.append(x[0])
    wave = np.exp(-2j * np.pi * np.arange(steps) / steps)
    return np.abs(np.array(seen).reshape(periods, steps) @ wave) * 2.0 / steps
