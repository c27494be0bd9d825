"""Time integration of the equations of motion (paper, Eq. (12)), as a check that is independent of the harmonic balance.

All sectors of the disk are included, each with its contacts and sliders.  Their motion is a superposition of nodal
diameters ``d`` with complex coordinates ``eta_d(t)``:

    x_k(t) = shift + sum_d Re[G_d eta_d(t) exp(i k d 2 pi/N)],
    eta_d'' + 2 zeta Omega eta_d' + Omega^2 eta_d + (c_d/N) sum_k G_d^H exp(-i k d 2 pi/N) F_k(t) = E_d(t),

``c_d = 2``, or 1 with real coordinates for ``d = 0`` and ``d = N/2``.  There is no assumption of a travelling wave and no
truncated Fourier series.  The contact law is applied from one instant to the next: ``N = max(n0 + kn v, 0)``; the slider is
clipped to ``u -+ mu N/kt`` and moves with ``u`` in separation.  Coupled laws project the friction force radially onto the
disk of radius ``mu N``.  Laws of constant load replace ``N`` by a given load, with a two-sided normal spring.  Bonded
points have a fixed slider.

The time step is implicit (generalised alpha), with the contact forces of all sectors at its end from one Newton iteration
(``csrc/time/generalised_alpha.c``).  Its length is set by the motion, not by the stiffest contact: :data:`STEPS` per
period.  The error is of second order.  The integration starts at a harmonic-balance solution.  The nodal diameters are
the nodal diameters of the study's harmonics, or all that the model contains (:func:`every_diameter`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from math import gcd
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper import _core
from bdamper.contact.laws import AFT, LAW_BONDED, LAW_COUPLED, LAW_CUBIC, LAW_NORMAL, LAW_SEPARABLE
from bdamper.contact.residual_flexibility import RESIDUAL
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import Sector
from bdamper.model.kinematics import HarmonicBasis
from bdamper.response.continuation import TWO_PI
from bdamper.util import validation
from bdamper.util.errors import BdamperError, SettingError, quiet
from bdamper.util.progress import Cost

STEPS = 256
"""Default time steps per period.

With shorter steps the mean amplitude of motions that beat rises by up to 2 % with 512, and by 3 % with 1,024 steps.  Some
beats that 1,024 steps show are damped with 512.
"""
TOLERANCE = 1e-3
"""Relative residual of the contact forces.

With 1e-4 the default search of an amplitude takes 1.2 to 1.35 times as long; its ranges differ by less than 0.1 um on the
turbine blade at and above its optimum.
"""
RADIUS = 0.3
"""Spectral radius of a time step at infinite frequency.

A step averages the contact forces of its two ends.  Modes that the steps do not resolve then gain energy at stiff contacts
with gaps and friction: with 0.7, and with 0.5, up to 4e7 times the work of the excitation on sectors of other meshes.
With 0.3 the energy of such a sector balances to 0.05 %, and the steps lose 0.2 % of it on the turbine blade.
"""
RADIUS_WITHOUT_MASS = 0.3
"""Spectral radius with massless coordinates."""
QUASISTATIC = 10.0
"""Natural frequency over that of the excitation from which a mode follows the forces on it without resonance."""
MOST_SECTORS = 33
"""Largest number of sectors for which all nodal diameters are integrated by default.

With more sectors they are the nodal diameters of the harmonics up to :data:`MOST_HARMONIC` and of the study's harmonics.
"""
MOST_HARMONIC = 6
MOST_PERIODS = 100
"""Largest number of periods of a given motion until sliders are periodic: two, but many under the coupled laws."""


class IntegrationFailed(BdamperError):
    """The contact forces of a time step were not found, even in short parts of it, or the energy does not balance."""


class EnergyGained(IntegrationFailed):
    """The energy of the motion does not balance, because the time steps are too long for the contacts."""


class Motion(NamedTuple):
    """State at the start of a period.

    Parameters
    ----------
    q, v : (2 n_coordinates,) float
        Real and imaginary parts of the coordinates of all nodal diameters, and their velocities.
    w : (n_sectors, n_points, 2) float, m
        Sliders, followed by the state variables of user-defined laws.
    a : (2 n_coordinates,) float, optional
        Accelerations of the integration method.  Without them they, and massless coordinates, follow from the other
        variables.
    """

    q: NDArray
    v: NDArray
    w: NDArray
    a: NDArray | None = None


class Trajectory(NamedTuple):
    """Result of a time integration.

    Parameters
    ----------
    motion : Motion
        Final state.
    harmonics : (n_periods, n_blades, n_harmonics + 1) complex, m
        Response amplitudes of all blades in each complete period; the first column is the mean.
    energy : (n_periods, 4) float, J
        Energies of all sectors in each complete period: work of the excitation, loss in damping, work on the contacts, and
        rise of kinetic and strain energy.  The remainder of their balance is the numerical loss.
    trace : (n_steps, 2 n_coordinates) float
        Coordinates at the start of each time step, if requested; ``Ring.rows`` gives their responses.
    first : int
        Time step within the period at which the integration ended.
    """

    motion: Motion
    harmonics: NDArray
    energy: NDArray
    trace: NDArray
    first: int


class Ring:
    """Equations of motion of all sectors with their contacts.

    Parameters
    ----------
    system : Equations[Sector]
        Each harmonic has the modes of its nodal diameter.
    n_blades, engine_order : int
    wide : Equations[Sector], optional
        Equations with more harmonics, for all nodal diameters to integrate.
    radius : float, optional
        Spectral radius of a time step at infinite frequency, 1 for no numerical damping.  Default: :data:`RADIUS`, or
        :data:`RADIUS_WITHOUT_MASS` with massless coordinates.
    wide_order : int, optional
        Engine order of ``wide``; the same by default.  A divisor of it gives a larger ring, whose sectors this order
        distinguishes.
    rows : (n_blades, 2 n_coordinates) float, optional
        Rows that give the responses of all blades.

    Attributes
    ----------
    rows : (n_blades, 2 n_coordinates) float
        Rows whose products with the coordinates are the responses of all blades.

    Raises
    ------
    SettingError
        If one basis describes harmonics of several nodal diameters, which is no structure in time.
    """

    def __init__(
        self,
        system: Equations[Sector],
        n_blades: int,
        engine_order: int,
        wide: Equations[Sector] | None = None,
        radius: float | None = None,
        wide_order: int | None = None,
        rows: NDArray | None = None,
    ) -> None:
        bonded = np.asarray(system.structure.points.law)[:, None] == LAW_BONDED
        self.held = np.broadcast_to(bonded, (system.n_points, 2))
        self.system, self.wide = system, wide or system
        self.cost = Cost()
        across = engine_order if wide_order is None else wide_order
        self.n = n_blades // gcd(n_blades, across) if across else 1
        self.step = (
            n_blades // self.n
        )  # ratio of nodal diameters of the disk to nodal diameters of self.n sectors
        self.wave = (
            engine_order // self.step if engine_order else 0
        )  # nodal diameter on self.n sectors
        self.families: dict[
            int, int
        ] = {}  # signed nodal diameter on self.n sectors -> harmonic that describes it
        self._turns: dict[
            int, NDArray
        ] = {}  # harmonic -> matrix from its coordinates to the coordinates of its family
        for l, basis in enumerate(self.wide.structure.bases):
            if len(basis.omega2):
                d = (l * (across // self.step if across else 0)) % self.n
                if self.families.keys().isdisjoint((d, (self.n - d) % self.n)):
                    self.families[d] = l
        excited = self.wide if across == engine_order else system
        for l, basis in enumerate(excited.structure.bases):
            if len(basis.omega2):
                same, reversed_ = self._family(l)
                self._turns[l] = _turn(self.wide.structure.bases[same], basis, conjugate=reversed_)
        used = {l: b.nodal_diameter for l, b in enumerate(system.structure.bases) if len(b.omega2)}
        if self.n > 1 and len(set(used.values())) == 1 and system.n_harmonics > 0:
            orders = [l * engine_order for l in used]
            diameters = {min(order % n_blades, -order % n_blades) for order in orders}
            if len(diameters) > 1:
                raise SettingError(
                    "time integration: expected fundamental_modes_only=False, found one basis for several nodal diameters"
                )
        k = np.arange(self.n)
        self.blocks = []  # (harmonic, slice of coordinates, phases, factor)
        start = 0
        for d, l in self.families.items():
            m = len(self.wide.structure.bases[l].omega2)
            factor = 1.0 if d == 0 or 2 * d == self.n else 2.0
            self.blocks.append(
                (l, slice(start, start + m), np.exp(2j * np.pi * k * d / self.n), factor)
            )
            start += m
        self.n_coordinates = start
        self.real = np.concatenate(
            [np.full(s.stop - s.start, factor == 1.0) for _, s, _, factor in self.blocks]
        )
        bases = [self.wide.structure.bases[l] for l, *_ in self.blocks]
        self.stiffness, self.mass, damping = (
            np.concatenate([np.asarray(getattr(b, name)) for b in bases])
            for name in ("omega2", "mass", "damping")
        )
        heavy = self.mass > 0.0
        weight = np.where(heavy, self.mass, 1.0)
        self.omega2 = np.where(heavy, self.stiffness / weight, 0.0)
        self.damping = np.where(heavy, damping / weight, 0.0)
        self.least_damping = float(self.damping[self.omega2 > 0.0].min(initial=np.inf))
        """Full bandwidth (rad/s) of the least damped mode; infinite if no mode has stiffness."""
        self.radius = (
            radius if radius is not None else RADIUS if heavy.all() else RADIUS_WITHOUT_MASS
        )
        self.rows = self._rows() if rows is None else rows
        self.core = self._core()
        self.effort = np.zeros(2, int)
        """Time steps with a solution for contact forces, and evaluations for them."""

    def _core(self) -> _core.Ring:
        """Return the core object with modes, points, excitation and response."""
        bases = [self.wide.structure.bases[l] for l, *_ in self.blocks]
        orders, force = self.forcing()
        points = {
            name: self.wide.structure.arrays[name]
            for name in ("kt", "kn", "mu", "n0", "load", "shift", "law")
        }
        return _core.Ring(
            self.n,
            np.array([len(b.omega2) for b in bases], np.intc),
            np.array(list(self.families), np.intc),
            self.stiffness,
            self.mass,
            np.concatenate([b.damping for b in bases]),
            np.concatenate([np.ascontiguousarray(b.G, complex).ravel() for b in bases]),
            held=np.ascontiguousarray(self.held, np.intc),
            order=orders,
            force=force,
            row=self.rows,
            own=self.system.structure.own,
            **points,
        )

    def _harmonics(self, u: NDArray) -> Iterator[tuple[int, NDArray]]:
        """Yield each harmonic, negative for a backward wave, and its amplitudes (n_coordinates,) complex."""
        where = {l: s for l, s, *_ in self.blocks}
        for harmonic, basis in enumerate(self.system.structure.bases):
            if len(basis.omega2):
                l, reversed_ = self._family(harmonic)
                out, a = (
                    np.zeros(self.n_coordinates, complex),
                    self.system.layout.amplitudes(np.asarray(u), harmonic),
                )
                out[where[l]] = self._turns[harmonic] @ (a.conj() if reversed_ else a)
                yield -harmonic if reversed_ else harmonic, out

    def forcing(self) -> tuple[NDArray, NDArray]:
        """Return the harmonics (n,) of the excitation, and the factors (n, 2, 2 n_coordinates) of their cosines and
        sines.
        """
        orders, factors = [], []
        for harmonic, a in self._harmonics(self.system.structure.force):
            e = np.array([a, -1j * a if harmonic < 0 else 1j * a])
            e[:, self.real] = e[:, self.real].real
            if e.any():
                orders.append(abs(harmonic))
                factors.append(np.concatenate([e.real, e.imag], axis=1))
        return np.array(orders, np.intc), np.array(factors).reshape(
            len(orders), 2, 2 * self.n_coordinates
        )

    def _family(self, harmonic: int) -> tuple[int, bool]:
        """Return the harmonic whose modes describe this one, and whether it travels in the opposite direction."""
        d = (harmonic * self.wave) % self.n
        if d in self.families:
            return self.families[d], False
        return self.families[(self.n - d) % self.n], True

    def state(self, u: NDArray, omega: float, t: float) -> tuple[NDArray, NDArray]:
        """Return coordinates and velocities (2 n_coordinates,) of a harmonic-balance solution at one instant."""
        q, v = np.zeros((2, self.n_coordinates), complex)
        for harmonic, a in self._harmonics(u):
            turned = a * np.exp(1j * harmonic * omega * t)
            q += turned
            v += 1j * harmonic * omega * turned
        q[self.real], v[self.real] = q[self.real].real, v[self.real].real
        return np.concatenate([q.real, q.imag]), np.concatenate([v.real, v.imag])

    def start(self, u: NDArray, omega: float, n_steps: int) -> Motion:
        """Return the motion of a harmonic-balance solution at t = 0, with its sliders."""
        return Motion(*self.state(u, omega, 0.0), self.initial_slider(u, omega, n_steps))

    def initial_slider(self, u: NDArray, omega: float, n_steps: int) -> NDArray:
        """Return the sliders of a solution at t = 0, from its motion over periods until they are periodic."""
        points = self.system.structure.points
        initial = (
            points.slider if points.memory is None else np.hstack([points.slider, points.memory])
        )
        w = np.tile(initial, (self.n, 1, 1)).astype(float)
        x, _, _ = self.system.contact(np.asarray(u))
        size = max(2.0 * float(np.abs(x[:, :2, 1:]).sum(axis=2).max(initial=0.0)), 1e-300)
        q = np.array(
            [self.state(u, omega, k * TWO_PI / omega / n_steps)[0] for k in range(n_steps)]
        )
        for _ in range(MOST_PERIODS):
            before = w.copy()
            self.core.follow(q, w)
            scale = np.maximum(np.abs(w[..., 2:]).max(axis=(0, 1)), 1e-300)  # user-defined units
            moved = np.abs(w - before)
            if (
                moved[..., :2].max(initial=0.0) <= 1e-9 * size
                and (moved[..., 2:] <= 1e-9 * scale).all()
            ):
                break
        self.core.follow(q[:1], w)
        return w

    def integrate(
        self,
        motion: Motion,
        omega: float,
        n_steps: int,
        periods: int = 1,
        *,
        steps: int | None = None,
        first: int = 0,
        omega_end: float | None = None,
        trace: bool = False,
        tolerance: float = TOLERANCE,
    ) -> Trajectory:
        """Integrate a state over complete periods of the excitation, or over a number of time steps.

        The time steps are equal in the angle of the excitation; the first begins at ``2 pi first/n_steps``.

        Parameters
        ----------
        motion : Motion
        omega : float, rad/s
        n_steps : int
            Time steps per period.
        periods : int
        steps : int, optional
            Number of time steps, instead of periods.
        first : int
            Number of the first time step within its period.
        omega_end : float, rad/s, optional
            Final frequency, reached linearly in time.
        trace : bool
            Whether to store the coordinates at the start of each time step.
        tolerance : float
            Relative residual of the contact forces.

        Returns
        -------
        Trajectory

        Raises
        ------
        IntegrationFailed
            If the contact forces of a time step are not found, even after six bisections.
        """
        count = n_steps * periods if steps is None else steps
        started = time.thread_time()
        given = (*motion[:3], np.zeros_like(motion.q) if motion.a is None else motion.a)
        q, v, w, a = (
            np.array(x[None], float, order="C") for x in given
        )  # the core takes several states
        harmonics = np.zeros(
            (1, count // n_steps, len(self.rows), self.system.n_harmonics + 1), complex
        )
        energy = np.zeros((1, count // n_steps, 4))
        path = np.zeros((1, count, q.shape[1])) if trace else None
        status, *effort = self.core.integrate(
            q, v, a, w, count, n_steps, omega, omega if omega_end is None else omega_end, self.radius, tolerance,
            motion.a is None, harmonics, path, first, energy,
        )  # fmt: skip
        self.effort = self.effort + effort
        cost = self.cost
        self.cost = replace(
            cost,
            time_integration=cost.time_integration + time.thread_time() - started,
            evaluations=cost.evaluations + count + 1,
        )
        if status:
            raise IntegrationFailed(
                f"the time integration fails near {omega / TWO_PI:.6g} Hz: contact forces are not found in a time step of "
                f"1/{n_steps} of a period, nor in parts of it; raise steps_per_period"
            )
        trace_ = np.zeros((0, q.shape[1])) if path is None else path[0]
        return Trajectory(
            Motion(q[0], v[0], w[0], a[0]),
            harmonics[0],
            energy[0],
            trace_,
            (first + count) % n_steps,
        )

    def energy(self, motion: Motion) -> float:
        """Return kinetic and strain energy of a motion (J), with the energy stored in its contact springs.

        It is infinite for user-defined contact laws, whose energy is unknown.
        """
        share = np.concatenate(
            [np.full(s.stop - s.start, 0.5 * self.n / factor) for _, s, _, factor in self.blocks]
        )
        modes = (
            np.tile(k * share, 2) @ y**2
            for k, y in ((self.mass, motion.v), (self.stiffness, motion.q))
        )
        return float(sum(modes) + self.contact_energy(motion))

    def contact_energy(self, motion: Motion) -> float:
        """Return the energy (J) stored in the contact springs of all sectors; infinite for user-defined contact laws."""
        points, n, a = self.system.structure.points, self.n_coordinates, self.wide.structure.arrays
        if points.own is not None:
            return float("inf")
        z, x = motion.q[:n] + 1j * motion.q[n:], np.tile(np.asarray(a["shift"]), (self.n, 1, 1))
        for l, s, phases, _ in self.blocks:
            x += np.tensordot(phases, np.asarray(self.wide.structure.bases[l].G) @ z[s], 0).real
        force = a["n0"] + a["kn"] * x[..., 2]
        # an open point of a law with separation carries no force and stores nothing; the other laws have a spring that
        # carries tension as well
        separates = np.isin(a["law"], (LAW_SEPARABLE, LAW_NORMAL, LAW_COUPLED))
        normal_force = np.where(separates, np.maximum(force, 0.0), force)
        pressed = normal_force**2 / np.where(a["kn"] > 0.0, a["kn"], np.inf)
        limit = a["mu"] * np.maximum(np.abs(normal_force), a["load"])
        reach = np.where(
            self.held, np.inf, limit[..., None] / np.where(a["kt"] > 0.0, a["kt"], np.inf)
        )
        stretched = np.minimum(np.abs(x[..., :2] - motion.w[..., :2]), reach)
        stretched = np.where(
            (a["law"] == LAW_CUBIC)[:, None], x[..., :2] ** 2 / np.sqrt(2.0), stretched
        )
        return float(0.5 * ((a["kt"] * stretched**2).sum() + pressed.sum()))

    def vibration_energy(self, motion: Motion, omega: float) -> float:
        """Return the energy (J) of the vibration at ``omega`` (rad/s), without the strain energy of the loads at rest.

        In a harmonic motion velocities and accelerations give the same energy at every instant.
        """
        share = np.concatenate(
            [np.full(s.stop - s.start, 0.5 * self.n / factor) for _, s, _, factor in self.blocks]
        )
        acceleration = np.zeros_like(motion.v) if motion.a is None else motion.a
        return float(np.tile(self.mass * share, 2) @ (motion.v**2 + (acceleration / omega) ** 2))

    def amplitude_bound(self, omega: float) -> float:
        """Return a bound (m) of the first harmonic of a steady response, the root mean square over the blades.

        Contacts take energy from a steady motion, so that damping takes at most the work of the excitation.  In
        coordinates p scaled with the square roots of the damping constants, force f and response row r, damping takes
        pi omega |p|^2 and the excitation gives at most pi |f| |p|; hence |p| <= |f|/omega and |r p| <= |r| |f|/omega.
        For one mode at its resonance this is the response without contacts.  Modes above :data:`QUASISTATIC` times the
        frequency follow the contact forces and add at most a few per cent, so they do not count.  The bound is infinite if
        the response contains a mode without damping, under other orders of the excitation than the first, and for
        user-defined laws.
        """
        orders, factors = self.forcing()
        if self.system.structure.points.own is not None or set(orders) - {0} != {1}:
            return float("inf")
        n, damping = self.n_coordinates, self.damping * np.where(self.mass > 0.0, self.mass, 1.0)
        vibrates = (self.mass > 0.0) & (self.omega2 <= (QUASISTATIC * omega) ** 2)
        cosine = factors[list(orders).index(1), 0]
        force = vibrates * np.abs(cosine[:n] + 1j * cosine[n:])
        response = vibrates * np.abs(self.rows[:, :n] - 1j * self.rows[:, n:])

        def scaled(x: NDArray) -> NDArray:
            undamped = np.where(x > 0.0, np.inf, 0.0)
            return np.where(
                damping > 0.0, x / np.sqrt(np.where(damping > 0.0, damping, 1.0)), undamped
            )

        # equal blades respond most to a force in one wave; the wave with the least damping bounds all of them
        waves = [np.linalg.norm(scaled(response)[:, s], axis=1).max() for _, s, *_ in self.blocks]
        return float(max(waves) * np.linalg.norm(scaled(force)) / omega)

    @property
    def nodal_diameters(self) -> tuple[int, ...]:
        """Nodal diameters of the time integration."""
        return tuple(
            sorted({self.wide.structure.bases[l].nodal_diameter for l in self.families.values()})
        )

    def _rows(self) -> NDArray:
        out = np.zeros((self.n, 2 * self.n_coordinates))
        for l, s, phases, _ in self.blocks:
            r = phases[:, None] * np.asarray(self.wide.response_rows[l], complex)
            out[:, s] = r.real
            out[:, s.start + self.n_coordinates : s.stop + self.n_coordinates] = -r.imag
        return out

    def departure(self, response: NDArray) -> NDArray:
        """Return the fraction (n_periods,) of the responses (n_periods, n_blades) in other waves than the excited wave."""
        size = np.abs(np.fft.fft(response, axis=1)) ** 2
        away = 1.0 - size[:, self.wave % self.n] / np.maximum(size.sum(axis=1), 1e-300)
        return np.sqrt(np.maximum(away, 0.0))

    def tractions(self, motion: Motion) -> dict[str, NDArray]:
        """Return sliders (n_sectors, n_points, 2) of the motion without traction, and at the friction limit in both
        directions.
        """
        ends = []
        for far in (1e6, -1e6):
            w = motion.w.copy()
            w[:, :, :2] = np.where(self.held, w[:, :, :2], far)
            self.core.follow(motion.q[None], w)
            ends.append(w)
        middle = 0.5 * (ends[0] + ends[1])
        return {
            "no traction": middle,
            "limit of friction": ends[0],
            "limit of friction backward": ends[1],
        }

    def waves(self, response: NDArray) -> NDArray:
        """Decompose the responses of all blades into travelling waves, by discrete Fourier transform.

        Parameters
        ----------
        response : (n_periods, n_blades) complex, m

        Returns
        -------
        (n_blades, 2) float
            Nodal diameter of the disk, negative against the direction of the excitation, and amplitude (m), the root
            mean square over the periods; in descending order of amplitude.
        """
        amplitude = np.sqrt((np.abs(np.fft.fft(response, axis=1) / self.n) ** 2).mean(axis=0))
        d = np.arange(self.n)
        signed = self.step * np.where(2 * d > self.n, d - self.n, d)
        backward = 2 * (self.wave % self.n) > self.n
        return np.column_stack([-signed if backward else signed, amplitude])[np.argsort(-amplitude)]

    def seeded(self, motion: Motion, share: float, seed: int) -> Motion:
        """Return the motion with a disturbance of each nodal diameter; otherwise only rounding breaks the symmetry.

        Parameters
        ----------
        motion : Motion
        share : float
            Amplitude of each of the two waves of a nodal diameter, relative to the excited wave.
        seed : int
            Seed of their phases.
        """
        if self.n == 1:
            return motion
        n, rng, out = self.n_coordinates, np.random.default_rng(seed), []
        excited = next(s for l, s, *_ in self.blocks if l == self._family(1)[0])
        turns = share * np.exp(2j * np.pi * rng.random((len(self.blocks), 2)))
        for x in (motion.q, motion.v):
            z = x[:n] + 1j * x[n:]
            wave = z[excited].copy()
            for (_, s, *_), (forward, backward) in zip(self.blocks, turns):
                m = min(len(wave), s.stop - s.start)
                z[s.start : s.start + m] += (forward * wave + backward * wave.conj())[:m]
            z[self.real] = z[self.real].real
            out.append(np.concatenate([z.real, z.imag]))
        return Motion(out[0], out[1], motion.w)


def _turn(family: HarmonicBasis, basis: HarmonicBasis, conjugate: bool) -> NDArray:
    """Return the matrix (m, n) from the coordinates of a harmonic to the coordinates of a family of its nodal diameter.

    The nodal diameters may also be conjugate to each other (``conjugate``).

    Residual modes of the two are rotated against each other and span the same flexibility; all other modes are equal.
    """
    if family is basis:
        return np.eye(len(basis.omega2))
    to, modes = (np.asarray(b.G).reshape(-1, len(b.omega2)) for b in (family, basis))
    modes = modes.conj() if conjugate else modes
    left, right = (
        np.array([c.body == RESIDUAL for c in b.coordinates], bool) for b in (family, basis)
    )
    left, right = (
        x if x.any() else np.zeros(len(b.omega2), bool) for x, b in ((left, family), (right, basis))
    )
    if (~left).sum() != (~right).sum() or not np.allclose(
        to[:, ~left], modes[:, ~right], rtol=1e-12, atol=1e-12 * np.abs(to).max(initial=0.0)
    ):
        raise SettingError(
            "time integration: expected the modes of one nodal diameter in a harmonic, found others"
        )
    out = np.zeros((to.shape[1], modes.shape[1]), complex)
    out[np.flatnonzero(~left), np.flatnonzero(~right)] = 1.0
    if left.any() and right.any():
        out[np.ix_(left, right)] = np.linalg.lstsq(to[:, left], modes[:, right], rcond=None)[0]
    return out


def transfer(source: Ring, motion: Motion, target: Ring) -> Motion:
    """Return a motion in the coordinates of another structure with the same contact points.

    Modes that the source does not have are at rest, and also the residual modes, which differ between structures.
    """
    n, m = source.n_coordinates, target.n_coordinates
    blocks = {d: (l, s) for d, (l, s, *_) in zip(source.families, source.blocks)}
    out = []
    for x in (motion.q, motion.v):
        z, y = x[:n] + 1j * x[n:], np.zeros(m, complex)
        for d, (l, s, *_) in zip(target.families, target.blocks):
            if d not in blocks:
                continue
            harmonic, known = blocks[d]
            column = {
                (c.body, c.index): i
                for i, c in enumerate(source.wide.structure.bases[harmonic].coordinates)
            }
            for i, c in enumerate(target.wide.structure.bases[l].coordinates):
                if c.body != RESIDUAL and (k := column.get((c.body, c.index))) is not None:
                    y[s.start + i] = z[known.start + k]
        out.append(np.concatenate([y.real, y.imag]))
    return Motion(out[0], out[1], motion.w)


def every_diameter(problem: Problem) -> Problem:
    """Return the problem with harmonics of all nodal diameters of its sectors that the model contains.

    With more than :data:`MOST_SECTORS` sectors it has the harmonics of the study and all harmonics up to
    :data:`MOST_HARMONIC`.
    """
    order, blades = int(problem.engine_order), problem.model.n_blades
    n, base = (blades // gcd(blades, order) if order else 1), set(problem.harmonic_numbers)
    more = set(range(1, (n // 2 if n <= MOST_SECTORS else MOST_HARMONIC) + 1)) - base
    if problem.settings.fundamental_modes_only or not more:
        return problem

    contact_forces = (
        "event_driven"
        if isinstance(problem.settings.contact_forces, str)
        else AFT(8 * max(base | more) + 128)
    )

    def carried(harmonics: set[int]) -> Problem | None:
        try:
            with quiet():  # about methods that replace residual modes
                wide = problem.replace(
                    harmonics=tuple(sorted(harmonics)), contact_forces=contact_forces
                )
                _ = wide.bases
                return wide if wide.contact.note == problem.contact.note else None
        except BdamperError:
            return None

    whole = carried(base | more)
    return whole or carried(base | {l for l in more if carried(base | {l})}) or problem


def ring_of(problem: Problem, preload: float, blades: int | None = None) -> Ring:
    """Return the equations of motion of all sectors at a preload (N), with every nodal diameter of the model.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    blades : int, optional
        Number of blades of the ring; by default the smallest number after which the excitation repeats.

    Raises
    ------
    SettingError
        If the number of blades of the disk is not a multiple of ``blades``, if ``blades`` is not a multiple of the period
        of the excitation, or if the model lacks nodal diameters of the ring.
    """
    N, order, system = problem.model.n_blades, int(problem.engine_order), problem.system(preload)
    least = N // gcd(N, order) if order else 1
    if blades is None or blades == least:
        wide = every_diameter(problem)
        return Ring(system, N, order, wide=system if wide is problem else wide.system(preload))
    if not order or N % blades or blades % least:
        sizes = [n for n in range(least, N + 1, least) if N % n == 0]
        raise validation.invalid(
            "blades",
            f"one of {sizes}, rings that repeat on {N} blades at engine order {order}",
            blades,
        )
    across = N // blades
    contact_forces = (
        "event_driven"
        if isinstance(problem.settings.contact_forces, str)
        else AFT(8 * blades + 128)
    )
    wide = problem.replace(
        engine_order=across,
        harmonics=tuple(range(1, blades // 2 + 1)),
        contact_forces=contact_forces,
    )
    contact, others = (
        problem.contact,
        wide.contact.residual,
    )  # with the point springs of the study's first harmonic
    if contact.residual is not None and others is not None:
        others = replace(others, flexibility=contact.residual.flexibility, _bases={})
    wide = wide.given(contact=replace(contact, residual=others))
    return Ring(system, N, order, wide=wide.system(preload), wide_order=across)
