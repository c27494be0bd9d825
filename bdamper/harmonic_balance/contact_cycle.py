r"""Contact motion, contact force and energy over one cycle of a solution.

With the motion ``x`` of a contact point and its force ``f`` as complex amplitudes of each harmonic, the work of a cycle is

.. math:: \oint f\,dx = \pi \sum_l l\,\mathrm{Im}(f_l \bar x_l).

It has no truncation error, because the motion contains only the harmonics of the solution.  Friction dissipates this
energy; the normal springs return theirs.  Multiplying Eq. (16) of the paper by the velocities gives the energy balance

.. math::
    \pi \sum_l l\,\mathrm{Im}(e_l^T \bar q_l)
    = \pi \sum_l l^2 \omega\, \bar q_l^T C q_l + \sum_\text{points} \oint f\,dx

of work of the excitation, modal damping and contacts, all for one sector.

The histories of the friction force follow from the contact law, event by event.  A sum of its harmonics would overshoot at
the transitions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import (
    LAW_BONDED,
    LAW_CONSTANT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_CUBIC,
    LAW_USER,
)
from bdamper.contact.preload_state import OPEN, SLIP_MINUS, SLIP_PLUS, STICK
from bdamper.contact.residual_flexibility import RESIDUAL
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.sector import Sector, segments

MOST_PERIODS = 100
"""Largest number of periods until the sliders of a coupled law are periodic under a given motion."""


def energies(
    system: Equations[Sector], u: NDArray, omega: float, contacts: NDArray | None = None
) -> dict[str, Any]:
    """Compute the work of the excitation and the losses of one sector in one cycle, J.

    Parameters
    ----------
    system : Equations[Sector]
    u : (n_unknowns,) float
        Solution.
    omega : float, rad/s
    contacts : (n_points,) bool, optional
        Points that enter the equivalent stiffness, if others are springs of the bodies.  All by default.

    Returns
    -------
    "contact" : (n_points,) float
        Energy dissipated at each contact point of the equations.
    "damping", "excitation" : float
        Energy dissipated by modal damping; work of the excitation.
    "kinetic" : float
        Largest kinetic energy, if all modes and harmonics were in phase.
    "stiffness" : complex, N/m
        Equivalent complex stiffness of the contacts at the response location.  A force there does the work of all contact
        forces on the fundamental harmonic (:func:`bodily_motion`); this force over the response is the stiffness.  The real
        part is an equivalent spring, the imaginary part omega times an equivalent viscous damper.  NaN at zero response.
    """
    X, F, _ = system.contact(u)
    counted = np.ones(system.n_points, bool) if contacts is None else contacts
    l = np.arange(1, system.n_harmonics + 1)
    x, f = (a[..., 1::2] - 1j * a[..., 2::2] for a in (X, F))
    damping = excitation = kinetic = 0.0
    for n in range(1, system.n_harmonics + 1):
        q, e = (system.layout.amplitudes(a, n) for a in (u, system.structure.force))
        basis = system.structure.bases[n]
        excitation += np.pi * n * float((e * q.conj()).imag.sum())
        damping += np.pi * n**2 * omega * float(basis.damping @ np.abs(q) ** 2)
        kinetic += 0.5 * (n * omega) ** 2 * float(basis.mass @ np.abs(q) ** 2)
    first = float(np.abs(system.layout.amplitudes(u, 1) @ system.response_rows[1]))
    work = complex((bodily_motion(system, u).conj() * f[..., 0])[counted].sum())
    return {
        "contact": np.pi * (l * (f * x.conj()).imag).sum(axis=(1, 2)),
        "damping": damping,
        "excitation": excitation,
        "kinetic": kinetic,
        "stiffness": work / first**2 if first > 0.0 else complex(np.nan, np.nan),
    }


def bodily_motion(system: Equations[Sector], u: NDArray) -> NDArray:
    """Return the fundamental harmonic (n_points, 3) of the relative motion from the modes of the bodies, complex, m.

    Residual modes are left out: they are the local elasticity in series with the contact elements.
    """
    basis = system.structure.bases[1]
    of_bodies = np.array([coordinate.body != RESIDUAL for coordinate in basis.coordinates])
    return np.asarray(basis.G[..., of_bodies] @ system.layout.amplitudes(u, 1)[of_bodies])


def at_angles(coefficients: NDArray, theta: NDArray) -> NDArray:
    """Evaluate trigonometric polynomials (..., n_coef) at angles: mean, then cosine and sine of each harmonic."""
    l = np.arange(1, coefficients.shape[-1] // 2 + 1)
    wave = np.stack([np.cos(np.outer(l, theta)), np.sin(np.outer(l, theta))], axis=1).reshape(
        2 * len(l), len(theta)
    )
    return np.asarray(coefficients[..., :1] + coefficients[..., 1:] @ wave)


def histories(system: Equations[Sector], u: NDArray, theta: NDArray) -> tuple[NDArray, NDArray]:
    """Compute relative motion (m) and force (N) at all contact points of the equations over a cycle.

    Parameters
    ----------
    system : Equations[Sector]
    u : (n_unknowns,) float
        Solution.
    theta : (n_theta,) float, rad
        Phase angles of the excitation from 0 to 2 pi, ascending.  Coupled laws are integrated from one to the next.

    Returns
    -------
    motion, force : (n_points, 3, n_theta) float, m and N
        Along the two friction axes and the normal; approach and pressure are positive.
    """
    coefficients, forces, share = system.contact(u)
    p = system.structure.arrays
    X, F = at_angles(coefficients, theta), np.zeros((system.n_points, 3, len(theta)))
    two_sided = np.isin(p["law"], (LAW_CONSTANT, LAW_COUPLED_CONSTANT, LAW_BONDED))
    normal = p["n0"][:, None] + p["kn"][:, None] * X[:, 2]
    F[:, 2] = np.where(two_sided[:, None], normal, np.maximum(normal, 0.0))
    coupled = np.isin(p["law"], (LAW_COUPLED, LAW_COUPLED_CONSTANT))
    for i in np.flatnonzero(~coupled & (p["law"] != LAW_USER)).tolist():
        F[i, :2] = _uncoupled(p, i, coefficients[i], forces[i], theta)
    # a point in permanent stick has a range of admissible sliders: use the slider of the equations
    stuck = coupled & (share[:, 0] > 1.0 - 1e-9)
    F[stuck, :2] = at_angles(forces[stuck, :2], theta)
    if (slides := coupled & ~stuck).any():
        F[slides, :2] = _coupled(
            {k: p[k][slides] for k in ("kt", "mu", "w", "law", "load")}, X[slides], F[slides, 2]
        )
    if system.structure.points.own is not None:
        _integrate_user_laws(system, X, F)
    return X, F


def _integrate_user_laws(system: Equations[Sector], X: NDArray, F: NDArray) -> None:
    """Integrate user-defined contact laws over the cycle until their state variables are periodic."""
    laws, memory = system.structure.points.own, system.structure.points.memory
    assert laws is not None and memory is not None
    for _ in range(MOST_PERIODS):
        before = memory
        for k in range(X.shape[2]):
            forces, _, memory = laws.step(X[..., k], memory)
            F[laws.held, :, k] = forces[laws.held]
        if (np.abs(memory - before) <= 1e-9 * np.abs(memory).max(axis=0)).all():
            break


def _uncoupled(p: dict[str, Any], i: int, x: NDArray, f: NDArray, theta: NDArray) -> NDArray:
    """Return the friction forces (2, n_theta) of one point with independent sliders, exact at every angle.

    Between a slip-to-stick event (or a closing) and the next event the slider ``w`` is fixed and the force is ``kt (u -
    w)``. Slip has the force ``+-mu N``; at its end the slider is at ``w = u -+ mu N/kt``.
    """
    law, kt, load = int(p["law"][i]), p["kt"][i], float(p["load"][i])
    if law == LAW_BONDED:
        return at_angles(f[:2], theta)
    if law == LAW_CUBIC:
        return np.asarray(kt[:, None] * at_angles(x[:2], theta) ** 3)
    kn, mu, n0 = (float(p[name][i]) for name in ("kn", "mu", "n0"))

    def limit(angles: NDArray) -> NDArray:
        if law == LAW_CONSTANT:
            return np.full(len(angles), mu * max(load, 0.0))
        return mu * np.maximum(n0 + kn * at_angles(x[2], angles), 0.0)

    out = np.zeros((2, len(theta)))
    # the exact events, even if the equations were solved with sampled contact forces
    for d, parts in enumerate(segments(x, kt, kn, mu, n0, p["w"][i], law, "event_driven", load)):
        if kt[d] == 0.0 or not parts:  # no friction
            continue
        first = next((k for k, part in enumerate(parts) if part[2] != STICK), None)
        if first is None:
            out[d] = at_angles(f[d], theta)
            continue
        w = np.nan  # slider at the beginning of the segment
        for start, end, state in parts[first:] + parts[:first]:
            within = (theta - start) % (2.0 * np.pi) <= end - start
            if state == STICK:
                out[d, within] = kt[d] * (at_angles(x[d], theta[within]) - w)
            else:
                sense, last = {SLIP_PLUS: 1.0, SLIP_MINUS: -1.0, OPEN: 0.0}[state], np.array([end])
                out[d, within] = sense * limit(theta[within])
                w = float((at_angles(x[d], last) - sense * limit(last) / kt[d])[0])
    return out


def _coupled(p: dict[str, Any], X: NDArray, normal: NDArray) -> NDArray:
    """Return the friction forces (n, 2, n_theta) of coupled sliders, integrated over the cycle until they are periodic."""
    load = np.where(
        (p["law"] == LAW_COUPLED_CONSTANT)[:, None], np.maximum(p["load"], 0.0)[:, None], normal
    )
    reach, w, kt = p["mu"][:, None] * load, p["w"].copy(), p["kt"]
    out = np.zeros((len(w), 2, X.shape[2]))
    size = max(float(np.ptp(X[:, :2], axis=2).max(initial=0.0)), 1e-300)
    for _ in range(MOST_PERIODS):
        before = w
        for k in range(X.shape[2]):
            u = X[:, :2, k]
            pull = kt * (u - w)
            length = np.linalg.norm(pull, axis=1)
            share = np.where(
                length > reach[:, k], reach[:, k] / np.where(length > 0.0, length, 1.0), 1.0
            )
            w = u - share[:, None] * (u - w)
            out[..., k] = kt * (u - w)
        if np.abs(w - before).max() <= 1e-9 * size:
            break
    return out
