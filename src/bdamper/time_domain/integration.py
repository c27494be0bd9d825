"""Time integration of the equations of motion (paper, Eq. (12)), as a check that is independent of the harmonic balance.

All sectors of the disk are included, each with its own contacts and sliders.  Their motion is a superposition of nodal
diameters ``d``, one family for each nodal diameter in use, with complex coordinates ``eta_d(t)``:

    x_k(t) = shift + sum_d Re[G_d eta_d(t) exp(i k d 2 pi/N)],
    eta_d'' + 2 zeta Omega eta_d' + Omega^2 eta_d + (c_d/N) sum_k G_d^H exp(-i k d 2 pi/N) F_k(t) = E_d(t),

``c_d = 2``, and 1 with real coordinates for ``d = 0`` and ``d = N/2``.  No travelling wave is assumed, no Fourier series
cut off.  The contact law is applied from one instant to the next: ``N = max(n0 + kn v, 0)``, the slider is clipped to
``u -+ mu N/kt`` and moves with ``u`` where the contact is open.  Under the coupled laws the friction force is drawn back
radially to the disk of radius ``mu N``; under those of constant load a given load takes the place of ``N`` there, and the
normal spring is two-sided; bonded points keep their slider.

A step is implicit: generalised alpha, with the contact forces of all sectors at its end from one Newton's method
(``csrc/bd_time_loop.c``).  So its length follows the motion and not the stiffest contact: :data:`STEPS` a period.  Its
error is of second order.  The start is the harmonic-balance solution, so what is measured is where the motion goes from
there.  The nodal diameters are those of the study's harmonics, or all that the model carries (:func:`every_diameter`).
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
from bdamper.contact.laws import AFT, LAW_BONDED, LAW_CUBIC
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
"""Steps a period.  Twice as many change the mean amplitude of motions that beat by up to 1 %; with half of them beats are
missing or steps fail."""
TOLERANCE = 1e-4
"""Residual of the contact forces, relative to them; a tenth of the cost more or less for each factor of ten."""
RADIUS = 0.8
"""Spectral radius of a step at infinite frequency.  From 0.8 on unresolved contacts of residual modes gain energy."""
RADIUS_WITHOUT_MASS = 0.5
"""That of structures with coordinates without mass: never a gain, for 0.02 to 0.1 % of the energy a period."""
MOST_SECTORS = 33
"""Sectors up to which all nodal diameters are marched, beyond that those of the study's and of :data:`MOST_HARMONIC`."""
MOST_HARMONIC = 6
MOST_PERIODS = 100
"""Periods of a given motion within which sliders must settle: two, but many under the coupled laws."""


class MarchFailed(BdamperError):
    """The contact forces of a step were not found, not even in short parts of it."""


class Motion(NamedTuple):
    """State at the start of a period.

    Parameters
    ----------
    q, v : (2 n_coordinates,) float
        Real and imaginary parts of the coordinates of all nodal diameters, and their velocities.
    w : (n_sectors, n_points, 2) float, m
        Sliders; behind them what points with laws of their own remember.
    a : (2 n_coordinates,) float, optional
        Accelerations of the method of integration; without them they, and the coordinates without inertia, follow from the
        rest.
    """

    q: NDArray
    v: NDArray
    w: NDArray
    a: NDArray | None = None


class Trajectory(NamedTuple):
    """Where a march has come to.

    Parameters
    ----------
    motion : Motion
    harmonics : (n_periods, n_blades, n_harmonics + 1) complex, m
        Amplitudes of the responses of all blades in each whole period; the first column is the mean.
    energy : (n_periods, 4) float, J
        In each whole period, of all sectors: work of the excitation, loss in damping, work on the contacts, and rise of
        kinetic and strain energy.  What is missing in their balance is the loss of the method of integration.
    trace : (n_steps, 2 n_coordinates) float
        Coordinates at the start of each step, if they were asked for; their responses are those of ``Ring.rows``.
    first : int
        Step of the period at which the motion stands.
    """

    motion: Motion
    harmonics: NDArray
    energy: NDArray
    trace: NDArray
    first: int


class Ring:
    """All sectors with their contacts: the equations of motion in time.

    Parameters
    ----------
    system : Equations[Sector]
        Each harmonic described by the modes of its own nodal diameter.
    n_blades, engine_order : int
    wide : Equations[Sector], optional
        With more harmonics, those of all nodal diameters that are to be marched.
    wide_order : int, optional
        Engine order of these harmonics; by default the same.  With a divisor of it the ring is larger: that of the
        sectors which this order tells apart.
    radius : float, optional
        Spectral radius of a step at infinite frequency, 1 for none of its damping; :data:`RADIUS` by default, and
        :data:`RADIUS_WITHOUT_MASS` where coordinates have no mass.

    Attributes
    ----------
    rows : (n_blades, 2 n_coordinates) float
        Responses of all blades by the coordinates.

    Raises
    ------
    SettingError
        If the settings describe something else than a structure in time: one basis for harmonics of several nodal
        diameters.
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
        self.step = n_blades // self.n  # nodal diameters of the whole wheel by those on self.n sectors
        self.wave = engine_order // self.step if engine_order else 0  # nodal diameter on self.n sectors
        self.families: dict[int, int] = {}  # signed nodal diameter on self.n sectors -> harmonic that describes it
        self._turns: dict[int, NDArray] = {}  # harmonic -> its coordinates in those of its family
        for l, basis in enumerate(self.wide.structure.bases):
            if len(basis.omega2):
                d = (l * (across // self.step if across else 0)) % self.n
                if self.families.keys().isdisjoint((d, (self.n - d) % self.n)):
                    self.families[d] = l
        own = self.wide if across == engine_order else system
        for l, basis in enumerate(own.structure.bases):
            if len(basis.omega2):
                same, reversed_ = self._family(l)
                self._turns[l] = _turn(self.wide.structure.bases[same], basis, conjugate=reversed_)
        used = {l: b.nodal_diameter for l, b in enumerate(system.structure.bases) if len(b.omega2)}
        if self.n > 1 and len(set(used.values())) == 1 and system.n_harmonics > 0:
            orders = [l * engine_order for l in used]
            diameters = {min(order % n_blades, -order % n_blades) for order in orders}
            if len(diameters) > 1:
                raise SettingError(
                    "verify: expected fundamental_modes_only=False, found one basis for several nodal diameters"
                )
        k = np.arange(self.n)
        self.blocks = []  # (harmonic, slice of coordinates, phases, factor)
        start = 0
        for d, l in self.families.items():
            m = len(self.wide.structure.bases[l].omega2)
            factor = 1.0 if d == 0 or 2 * d == self.n else 2.0
            self.blocks.append((l, slice(start, start + m), np.exp(2j * np.pi * k * d / self.n), factor))
            start += m
        self.n_coordinates = start
        self.real = np.concatenate([np.full(s.stop - s.start, factor == 1.0) for _, s, _, factor in self.blocks])
        bases = [self.wide.structure.bases[l] for l, *_ in self.blocks]
        self.stiffness, self.mass, damping = (
            np.concatenate([np.asarray(getattr(b, name)) for b in bases]) for name in ("omega2", "mass", "damping")
        )
        heavy = self.mass > 0.0
        weight = np.where(heavy, self.mass, 1.0)
        self.omega2 = np.where(heavy, self.stiffness / weight, 0.0)
        self.damping = np.where(heavy, damping / weight, 0.0)
        self.least_damping = float(self.damping[self.omega2 > 0.0].min(initial=np.inf))
        """Full bandwidth (rad/s) of the least damped mode; infinite if no mode has stiffness of its own."""
        self.radius = radius if radius is not None else RADIUS if heavy.all() else RADIUS_WITHOUT_MASS
        self.rows = self._rows() if rows is None else rows
        self.core = self._core()
        self.effort = np.zeros(2, int)
        """Steps in which contact forces were solved for, and evaluations for them."""

    def _core(self) -> _core.Ring:
        """What marches: modes, points, excitation and response in arrays."""
        bases = [self.wide.structure.bases[l] for l, *_ in self.blocks]
        orders, force = self.forcing()
        points = {name: self.wide.structure.arrays[name] for name in ("kt", "kn", "mu", "n0", "load", "shift", "law")}
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
        """Each harmonic, negative if its wave travels backwards, and its amplitudes (n_coordinates,) complex."""
        where = {l: s for l, s, *_ in self.blocks}
        for harmonic, basis in enumerate(self.system.structure.bases):
            if len(basis.omega2):
                l, reversed_ = self._family(harmonic)
                out, a = np.zeros(self.n_coordinates, complex), self.system.layout.amplitudes(np.asarray(u), harmonic)
                out[where[l]] = self._turns[harmonic] @ (a.conj() if reversed_ else a)
                yield -harmonic if reversed_ else harmonic, out

    def forcing(self) -> tuple[NDArray, NDArray]:
        """Harmonics (n,) of the excitation, and the factors (n, 2, 2 n_coordinates) of their cosines and sines."""
        orders, factors = [], []
        for harmonic, a in self._harmonics(self.system.structure.force):
            e = np.array([a, -1j * a if harmonic < 0 else 1j * a])
            e[:, self.real] = e[:, self.real].real
            if e.any():
                orders.append(abs(harmonic))
                factors.append(np.concatenate([e.real, e.imag], axis=1))
        return np.array(orders, np.intc), np.array(factors).reshape(len(orders), 2, 2 * self.n_coordinates)

    def _family(self, harmonic: int) -> tuple[int, bool]:
        """Harmonic whose modes describe this one, and whether it travels in the opposite direction."""
        d = (harmonic * self.wave) % self.n
        if d in self.families:
            return self.families[d], False
        return self.families[(self.n - d) % self.n], True

    def state(self, u: NDArray, omega: float, t: float) -> tuple[NDArray, NDArray]:
        """Coordinates and velocities (2 n_coordinates,) of a harmonic-balance solution at one instant."""
        q, v = np.zeros((2, self.n_coordinates), complex)
        for harmonic, a in self._harmonics(u):
            turned = a * np.exp(1j * harmonic * omega * t)
            q += turned
            v += 1j * harmonic * omega * turned
        q[self.real], v[self.real] = q[self.real].real, v[self.real].real
        return np.concatenate([q.real, q.imag]), np.concatenate([v.real, v.imag])

    def start(self, u: NDArray, omega: float, n_steps: int) -> Motion:
        """The motion of a harmonic-balance solution at t = 0, with the sliders that it leads to."""
        return Motion(*self.state(u, omega, 0.0), self.initial_slider(u, omega, n_steps))

    def initial_slider(self, u: NDArray, omega: float, n_steps: int) -> NDArray:
        """Sliders at t = 0 of the solution: its motion marched over periods from the given ones until they settle."""
        points = self.system.structure.points
        kept = points.slider if points.memory is None else np.hstack([points.slider, points.memory])
        w = np.tile(kept, (self.n, 1, 1)).astype(float)
        x, _, _ = self.system.contact(np.asarray(u))
        size = max(2.0 * float(np.abs(x[:, :2, 1:]).sum(axis=2).max(initial=0.0)), 1e-300)
        q = np.array([self.state(u, omega, k * TWO_PI / omega / n_steps)[0] for k in range(n_steps)])
        for _ in range(MOST_PERIODS):
            before = w.copy()
            self.core.follow(q, w)
            scale = np.maximum(np.abs(w[..., 2:]).max(axis=(0, 1)), 1e-300)  # states of own laws have units of their own
            moved = np.abs(w - before)
            if moved[..., :2].max(initial=0.0) <= 1e-9 * size and (moved[..., 2:] <= 1e-9 * scale).all():
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
        """March a state over whole periods of the excitation or any number of steps.

        The steps are equal in the angle of the excitation; that of the first is ``2 pi first/n_steps``.

        Parameters
        ----------
        motion : Motion
        omega : float, rad/s
        n_steps : int
            Steps per period.
        periods : int
        steps : int, optional
            In place of periods.
        first : int
        omega_end : float, rad/s, optional
            The frequency goes there linearly in time: a sweep.
        trace : bool
            Keep the coordinates at the start of each step.

        Raises
        ------
        MarchFailed
            If the contact forces of a step are not found, not even when it is halved six times.
        """
        count = n_steps * periods if steps is None else steps
        started = time.thread_time()
        given = (*motion[:3], np.zeros_like(motion.q) if motion.a is None else motion.a)
        q, v, w, a = (np.array(x[None], float, order="C") for x in given)  # the core takes several states
        harmonics = np.zeros((1, count // n_steps, len(self.rows), self.system.n_harmonics + 1), complex)
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
            raise MarchFailed(
                f"the march fails near {omega / TWO_PI:.6g} Hz: contact forces are not found in a step of 1/{n_steps} of a "
                "period, nor in parts of it; raise steps_per_period"
            )
        trace_ = np.zeros((0, q.shape[1])) if path is None else path[0]
        return Trajectory(Motion(q[0], v[0], w[0], a[0]), harmonics[0], energy[0], trace_, (first + count) % n_steps)

    def energy(self, motion: Motion) -> float:
        """Kinetic and strain energy of a motion (J), with the most that its contacts can hold in their springs.

        Infinite with contact laws of users, which may hold any.
        """
        points, n, a = self.system.structure.points, self.n_coordinates, self.wide.structure.arrays
        if points.own is not None:
            return float("inf")
        z, x = motion.q[:n] + 1j * motion.q[n:], np.tile(np.asarray(a["shift"]), (self.n, 1, 1))
        for l, s, phases, _ in self.blocks:
            x += np.tensordot(phases, np.asarray(self.wide.structure.bases[l].G) @ z[s], 0).real
        share = np.concatenate([np.full(s.stop - s.start, 0.5 * self.n / factor) for _, s, _, factor in self.blocks])
        modes = (np.tile(k * share, 2) @ y**2 for k, y in ((self.mass, motion.v), (self.stiffness, motion.q)))
        force = a["n0"] + a["kn"] * x[..., 2]
        pressed = force**2 / np.where(a["kn"] > 0.0, a["kn"], np.inf)
        limit = a["mu"] * np.maximum(np.abs(force), a["load"])
        reach = np.where(self.held, np.inf, limit[..., None] / np.where(a["kt"] > 0.0, a["kt"], np.inf))
        stretched = np.minimum(np.abs(x[..., :2] - motion.w[..., :2]), reach)
        stretched = np.where((a["law"] == LAW_CUBIC)[:, None], x[..., :2] ** 2 / np.sqrt(2.0), stretched)
        return float(sum(modes) + 0.5 * ((a["kt"] * stretched**2).sum() + pressed.sum()))

    @property
    def nodal_diameters(self) -> tuple[int, ...]:
        """Nodal diameters included in the march."""
        return tuple(sorted({self.wide.structure.bases[l].nodal_diameter for l in self.families.values()}))

    def _rows(self) -> NDArray:
        out = np.zeros((self.n, 2 * self.n_coordinates))
        for l, s, phases, _ in self.blocks:
            r = phases[:, None] * np.asarray(self.wide.response_rows[l], complex)
            out[:, s] = r.real
            out[:, s.start + self.n_coordinates : s.stop + self.n_coordinates] = -r.imag
        return out

    def departure(self, response: NDArray) -> NDArray:
        """(n_periods,) part of the responses (n_periods, n_blades) outside the wave of the excitation, relative to all."""
        size = np.abs(np.fft.fft(response, axis=1)) ** 2
        away = 1.0 - size[:, self.wave % self.n] / np.maximum(size.sum(axis=1), 1e-300)
        return np.sqrt(np.maximum(away, 0.0))

    def tractions(self, motion: Motion) -> dict[str, NDArray]:
        """Sliders (n_sectors, n_points, 2) of the motion without traction, and at the limit of friction either way."""
        ends = []
        for far in (1e6, -1e6):
            w = motion.w.copy()
            w[:, :, :2] = np.where(self.held, w[:, :, :2], far)
            self.core.follow(motion.q[None], w)
            ends.append(w)
        middle = 0.5 * (ends[0] + ends[1])
        return {"no traction": middle, "limit of friction": ends[0], "limit of friction backward": ends[1]}

    def waves(self, response: NDArray) -> NDArray:
        """Travelling waves that make up the responses of all blades, by their discrete Fourier transform.

        Parameters
        ----------
        response : (n_periods, n_blades) complex, m

        Returns
        -------
        (n_blades, 2) float
            Nodal diameter on the whole wheel, negative if the wave travels against that of the excitation, and amplitude
            (m), the root mean square over the periods; the largest first.
        """
        amplitude = np.sqrt((np.abs(np.fft.fft(response, axis=1) / self.n) ** 2).mean(axis=0))
        d = np.arange(self.n)
        signed = self.step * np.where(2 * d > self.n, d - self.n, d)
        backward = 2 * (self.wave % self.n) > self.n
        return np.column_stack([-signed if backward else signed, amplitude])[np.argsort(-amplitude)]

    def seeded(self, motion: Motion, share: float, seed: int) -> Motion:
        """The motion with a disturbance of each nodal diameter: a symmetric motion parts from rounding alone.

        Parameters
        ----------
        motion : Motion
        share : float
            Size of each of the two waves of a nodal diameter, relative to the wave that is excited.
        seed : int
            Of their phases.
        """
        if self.n == 1:
            return motion
        n, rng, out = self.n_coordinates, np.random.default_rng(seed), []
        excited = next(s for l, s, *_ in self.blocks if l == self._family(1)[0])
        turns = share * np.exp(2j * np.pi * rng.random((len(self.blocks), 2)))
        for x in (motion.q, motion.v):
            z = x[:n] + 1j * x[n:]
            own = z[excited].copy()
            for (_, s, *_), (forward, backward) in zip(self.blocks, turns):
                m = min(len(own), s.stop - s.start)
                z[s.start : s.start + m] += (forward * own + backward * own.conj())[:m]
            z[self.real] = z[self.real].real
            out.append(np.concatenate([z.real, z.imag]))
        return Motion(out[0], out[1], motion.w)


def _turn(family: HarmonicBasis, basis: HarmonicBasis, conjugate: bool) -> NDArray:
    """(m, n) coordinates of a family by those of a harmonic of the same nodal diameter, conjugated if it travels backwards.

    Residual modes of the two are turned against each other and span the same flexibility; all others are the same.
    """
    if family is basis:
        return np.eye(len(basis.omega2))
    to, own = (np.asarray(b.G).reshape(-1, len(b.omega2)) for b in (family, basis))
    own = own.conj() if conjugate else own
    left, right = (np.array([c.body == RESIDUAL for c in b.coordinates], bool) for b in (family, basis))
    left, right = (x if x.any() else np.zeros(len(b.omega2), bool) for x, b in ((left, family), (right, basis)))
    if (~left).sum() != (~right).sum() or not np.allclose(
        to[:, ~left], own[:, ~right], rtol=1e-12, atol=1e-12 * np.abs(to).max(initial=0.0)
    ):
        raise SettingError("verify: expected each harmonic to have the modes of its own nodal diameter")
    out = np.zeros((to.shape[1], own.shape[1]), complex)
    out[np.flatnonzero(~left), np.flatnonzero(~right)] = 1.0
    if left.any() and right.any():
        out[np.ix_(left, right)] = np.linalg.lstsq(to[:, left], own[:, right], rcond=None)[0]
    return out


def every_diameter(problem: Problem) -> Problem:
    """The problem with harmonics of all nodal diameters of its sectors, as far as the model carries them.

    Beyond :data:`MOST_SECTORS` sectors it is those of harmonics up to :data:`MOST_HARMONIC`, besides the study's own.
    """
    order, blades = int(problem.engine_order), problem.model.n_blades
    n, own = (blades // gcd(blades, order) if order else 1), set(problem.harmonic_numbers)
    more = set(range(1, (n // 2 if n <= MOST_SECTORS else MOST_HARMONIC) + 1)) - own
    if problem.settings.fundamental_modes_only or not more:
        return problem

    contact_forces = "event_driven" if isinstance(problem.settings.contact_forces, str) else AFT(8 * max(own | more) + 128)

    def carried(harmonics: set[int]) -> Problem | None:
        try:
            with quiet():  # about methods that replace residual modes
                wide = problem.replace(harmonics=tuple(sorted(harmonics)), contact_forces=contact_forces)
                _ = wide.bases
                return wide if wide.contact.note == problem.contact.note else None
        except BdamperError:
            return None

    whole = carried(own | more)
    return whole or carried(own | {l for l in more if carried(own | {l})}) or problem


def ring_of(problem: Problem, preload: float, blades: int | None = None) -> Ring:
    """All sectors of a problem at a preload (N), with every nodal diameter that the model carries.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    blades : int, optional
        Of the ring; by default as many as the engine order tells apart.

    Raises
    ------
    SettingError
        If the ring does not repeat on the wheel or under the excitation, or the model lacks its nodal diameters.
    """
    N, order, system = problem.model.n_blades, int(problem.engine_order), problem.system(preload)
    least = N // gcd(N, order) if order else 1
    if blades is None or blades == least:
        wide = every_diameter(problem)
        return Ring(system, N, order, wide=system if wide is problem else wide.system(preload))
    if not order or N % blades or blades % least:
        sizes = [n for n in range(least, N + 1, least) if N % n == 0]
        expected = f"one of {sizes}, rings that repeat on {N} blades at engine order {order}"
        raise validation.invalid("blades", expected, blades)
    across = N // blades
    contact_forces = "event_driven" if isinstance(problem.settings.contact_forces, str) else AFT(8 * blades + 128)
    wide = problem.replace(engine_order=across, harmonics=tuple(range(1, blades // 2 + 1)), contact_forces=contact_forces)
    contact, others = problem.contact, wide.contact.residual  # point springs are those of the problem's own first harmonic
    if contact.residual is not None and others is not None:
        others = replace(others, flexibility=contact.residual.flexibility, _bases={})
    wide = wide.given(contact=replace(contact, residual=others))
    return Ring(system, N, order, wide=wide.system(preload), wide_order=across)
