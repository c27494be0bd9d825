r"""Contact motion, contact force and energy over one cycle of a solution.

With the motion ``x`` of a contact point and its force ``f`` as complex amplitudes of each harmonic,
the work per cycle is

.. math:: \oint f\,dx = \pi \sum_l l\,\mathrm{Im}(f_l \bar x_l).

It has no truncation error, because the motion contains only the harmonics of the solution.
Friction dissipates this energy; the normal springs return theirs.  Multiplying Eq. (16) of the
paper by the velocities gives the energy balance

.. math::
    \pi \sum_l l\,\mathrm{Im}(e_l^T \bar q_l)
    = \pi \sum_l l^2 \omega\, \bar q_l^T C q_l + \sum_\text{points} \oint f\,dx

of work of the excitation, modal damping and contacts, all for one sector.

The histories of the friction force follow from the contact law, event by event.  A sum of its
harmonics would overshoot at the transitions.
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
from bdamper.harmonic_balance.sector import SectorData, segments

MOST_PERIODS = 100
"""Largest number of periods until the sliders of a coupled law are periodic under a given
motion."""


def energies(
    system: Equations[SectorData], u: NDArray, omega: float, contacts: NDArray | None = None
) -> dict[str, Any]:
    """Compute the work of the excitation and the losses of one sector in one cycle, J.

    Parameters
    ----------
    system : Equations[SectorData]
    u : (n_unknowns,) float
        Solution.
    omega : float, rad/s
    contacts : (n_points,) bool, optional
        Points that enter the equivalent stiffness, if others are springs of the bodies.  All by
        default.

    Returns
    -------
    "contact" : (n_points,) float
        Energy dissipated at each contact point of the equations.
    "damping", "excitation" : float
        Energy dissipated by modal damping; work of the excitation.
    "kinetic" : float
        Largest kinetic energy, if all modes and harmonics were in phase.
    "stiffness" : complex, N/m
        Equivalent complex stiffness of the contacts at the response location.  A force there does
        the work of all contact forces on the fundamental harmonic (:func:`bodily_motion`); this
        force over the response is the stiffness.  The real part is an equivalent spring, the
        imaginary part omega times an equivalent viscous damper.  NaN at zero response.
    """
    layout = system.layout
    damping = 0.0
    excitation = 0.0
    kinetic = 0.0
    # modal amplitudes of motion and excitation, Re[q exp(i l omega t)] in harmonic l: a force f does
    # the work pi l Im(f conj q) in a period of the fundamental
    for harmonic in range(1, system.n_harmonics + 1):
        q = layout.amplitudes(u, harmonic)
        squared_amplitude = np.abs(q) ** 2
        force = layout.amplitudes(system.structure.force, harmonic)
        basis = system.structure.bases[harmonic]
        excitation += np.pi * harmonic * float((force * q.conj()).imag.sum())
        damping += np.pi * harmonic**2 * omega * float(basis.damping @ squared_amplitude)
        kinetic += 0.5 * (harmonic * omega) ** 2 * float(basis.mass @ squared_amplitude)

    # coefficients: mean, then cosine and sine of each harmonic; complex amplitudes of motion and
    # force (n_points, 3, n_harmonics)
    X, F, _ = system.contact(u)
    x = X[..., 1::2] - 1j * X[..., 2::2]
    f = F[..., 1::2] - 1j * F[..., 2::2]
    harmonics = np.arange(1, system.n_harmonics + 1)
    # sum over directions and harmonics
    contact = np.pi * (harmonics * (f * x.conj()).imag).sum(axis=(1, 2))

    # the equivalent stiffness does the same work on the response as the contacts
    counted = np.ones(system.n_points, bool) if contacts is None else contacts
    first_harmonic_force = f[..., 0]
    work_at_points = bodily_motion(system, u).conj() * first_harmonic_force
    work = complex(work_at_points[counted].sum())
    response = float(np.abs(layout.amplitudes(u, harmonic=1) @ system.response_rows[1]))
    stiffness = complex(np.nan, np.nan)
    if response > 0.0:
        stiffness = work / response**2
    return {
        "contact": contact,
        "damping": damping,
        "excitation": excitation,
        "kinetic": kinetic,
        "stiffness": stiffness,
    }


def bodily_motion(system: Equations[SectorData], u: NDArray) -> NDArray:
    """Return the fundamental harmonic (n_points, 3) of the relative motion from the modes of the
    bodies, complex, m.

    Residual modes are omitted, because they are the local elasticity in series with the contact
    elements.
    """
    basis = system.structure.bases[1]
    of_bodies = np.array([coordinate.body != RESIDUAL for coordinate in basis.coordinates])
    return np.asarray(basis.G[..., of_bodies] @ system.layout.amplitudes(u, harmonic=1)[of_bodies])


def at_angles(coefficients: NDArray, theta: NDArray) -> NDArray:
    """Evaluate trigonometric polynomials (..., n_coef) at angles: mean, then cosine and sine of
    each harmonic."""
    harmonics = np.arange(1, coefficients.shape[-1] // 2 + 1)
    phase = np.outer(harmonics, theta)
    # cosine and sine of a harmonic are adjacent, as in the coefficients
    waves = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    waves = waves.reshape(2 * len(harmonics), len(theta))
    return np.asarray(coefficients[..., :1] + coefficients[..., 1:] @ waves)


def histories(system: Equations[SectorData], u: NDArray, theta: NDArray) -> tuple[NDArray, NDArray]:
    """Compute relative motion (m) and force (N) at all contact points of the equations over a
    cycle.

    Parameters
    ----------
    system : Equations[SectorData]
    u : (n_unknowns,) float
        Solution.
    theta : (n_theta,) float, rad
        Phase angles of the excitation from 0 to 2 pi, ascending.  Coupled laws are integrated from
        one to the next.

    Returns
    -------
    motion, force : (n_points, 3, n_theta) float, m and N
        Along the two friction axes and the normal; approach and pressure are positive.
    """
    coefficients, forces, share = system.contact(u)
    arrays = system.structure.arrays
    law = arrays["law"]
    X = at_angles(coefficients, theta)
    F = np.zeros((system.n_points, 3, len(theta)))

    # bonded points and points of constant load have two-sided normal springs, others may open
    two_sided = np.isin(law, (LAW_CONSTANT, LAW_COUPLED_CONSTANT, LAW_BONDED))
    # (n_points, n_theta)
    normal = arrays["n0"][:, None] + arrays["kn"][:, None] * X[:, 2]
    F[:, 2] = np.where(two_sided[:, None], normal, np.maximum(normal, 0.0))

    coupled = np.isin(law, (LAW_COUPLED, LAW_COUPLED_CONSTANT))
    uncoupled = ~coupled & (law != LAW_USER)
    for i in np.flatnonzero(uncoupled).tolist():
        F[i, :2] = _uncoupled(arrays, i, coefficients[i], forces[i], theta)

    # a point in permanent stick has a range of admissible sliders: use the slider of the equations;
    # the first state is stick
    stuck = coupled & (share[:, 0] > 1.0 - 1e-9)
    F[stuck, :2] = at_angles(forces[stuck, :2], theta)
    slides = coupled & ~stuck
    if slides.any():
        of_sliding = {name: arrays[name][slides] for name in ("kt", "mu", "w", "law", "load")}
        F[slides, :2] = _coupled(of_sliding, X[slides], F[slides, 2])
    if system.structure.points.own is not None:
        _integrate_user_laws(system, X, F)
    return X, F


def _integrate_user_laws(system: Equations[SectorData], X: NDArray, F: NDArray) -> None:
    """Integrate user-defined contact laws over the cycle until their state variables are periodic.

    ``X`` (n_points, 3, n_theta) is the motion.  The forces are written into ``F`` of the same
    shape, at the points with such a law.
    """
    laws = system.structure.points.own
    memory = system.structure.points.memory
    assert laws is not None and memory is not None
    _, _, n_theta = X.shape
    for _ in range(MOST_PERIODS):
        before = memory
        for k in range(n_theta):
            forces, _, memory = laws.step(X[..., k], memory)
            F[laws.compiled, :, k] = forces[laws.compiled]
        # relative to the largest value of each stored number over the points
        change = np.abs(memory - before)
        if (change <= 1e-9 * np.abs(memory).max(axis=0)).all():
            break


def _uncoupled(arrays: dict[str, Any], i: int, x: NDArray, f: NDArray, theta: NDArray) -> NDArray:
    """Return the friction forces (2, n_theta) of one point with independent sliders, exact at every
    angle.

    Between a slip-to-stick event (or a closing) and the next event the slider ``w`` is fixed and
    the force is ``kt (u - w)``. Slip has the force ``+-mu N``; at its end the slider is at ``w = u
    -+ mu N/kt``.
    """
    law = int(arrays["law"][i])
    kt = arrays["kt"][i]
    if law == LAW_BONDED:
        return at_angles(f[:2], theta)
    if law == LAW_CUBIC:
        return np.asarray(kt[:, None] * at_angles(x[:2], theta) ** 3)
    kn = float(arrays["kn"][i])
    mu = float(arrays["mu"][i])
    n0 = float(arrays["n0"][i])
    load = float(arrays["load"][i])
    slider = arrays["w"][i]

    def limit(angles: NDArray) -> NDArray:
        """Return the friction limit at angles, N."""
        if law == LAW_CONSTANT:
            return np.full(len(angles), mu * max(load, 0.0))
        return mu * np.maximum(n0 + kn * at_angles(x[2], angles), 0.0)

    friction = np.zeros((2, len(theta)))
    # the exact events, even if the equations were solved with sampled contact forces
    by_direction = segments(x, kt, kn, mu, n0, slider, law, "event_driven", load)
    sense_of = {SLIP_PLUS: 1.0, SLIP_MINUS: -1.0, OPEN: 0.0}
    for d, parts in enumerate(by_direction):
        # no friction
        if kt[d] == 0.0 or not parts:
            continue
        moves = [k for k, (_, _, state) in enumerate(parts) if state != STICK]
        # permanent stick
        if not moves:
            friction[d] = at_angles(f[d], theta)
            continue
        # begin with a segment that slips or opens, because its end determines the slider of the
        # next stick
        first = moves[0]
        slider_in_stick = np.nan
        for start, end, state in parts[first:] + parts[:first]:
            # segments may end beyond 2 pi
            within = (theta - start) % (2.0 * np.pi) <= end - start
            if state == STICK:
                u = at_angles(x[d], theta[within])
                friction[d, within] = kt[d] * (u - slider_in_stick)
                continue
            sense = sense_of[state]
            friction[d, within] = sense * limit(theta[within])
            (u_end,) = at_angles(x[d], np.array([end]))
            (limit_end,) = limit(np.array([end]))
            slider_in_stick = float(u_end - sense * limit_end / kt[d])
    return friction


def _coupled(arrays: dict[str, Any], X: NDArray, normal: NDArray) -> NDArray:
    """Return the friction forces (n, 2, n_theta) of coupled sliders, integrated over the cycle
    until they are periodic.

    ``X`` (n, 3, n_theta) is the motion and ``normal`` (n, n_theta) the normal force.
    """
    constant = arrays["law"] == LAW_COUPLED_CONSTANT
    constant_load = np.maximum(arrays["load"], 0.0)
    # (n, n_theta)
    load = np.where(constant[:, None], constant_load[:, None], normal)
    limit = arrays["mu"][:, None] * load
    kt = arrays["kt"]
    w = arrays["w"].copy()
    n_theta = X.shape[2]
    friction = np.zeros((len(w), 2, n_theta))
    largest_motion = max(float(np.ptp(X[:, :2], axis=2).max(initial=0.0)), 1e-300)
    for _ in range(MOST_PERIODS):
        before = w
        for k in range(n_theta):
            # tangential motion (n, 2), and the size of the spring force without slip
            u = X[:, :2, k]
            trial_force = np.linalg.norm(kt * (u - w), axis=1)
            # beyond the limit the slider follows until the force equals the limit
            divisor = np.where(trial_force > 0.0, trial_force, 1.0)
            slips = trial_force > limit[:, k]
            remaining_stretch = np.where(slips, limit[:, k] / divisor, 1.0)
            w = u - remaining_stretch[:, None] * (u - w)
            friction[..., k] = kt * (u - w)
        if np.abs(w - before).max() <= 1e-9 * largest_motion:
            break
    return friction
