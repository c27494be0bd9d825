"""Time integration of the equations of motion (paper, Eq. (12)), as a check that is independent of
the harmonic balance.

All sectors of the disk are included, each with its contacts and sliders.  Their motion is a
superposition of nodal diameters ``d`` with complex coordinates ``eta_d(t)``::

    x_k(t) = shift + sum_d Re[G_d eta_d(t) exp(i k d 2 pi/N)],
    eta_d'' + 2 zeta Omega eta_d' + Omega^2 eta_d
        + (c_d/N) sum_k G_d^H exp(-i k d 2 pi/N) F_k(t) = E_d(t),

``c_d = 2``, or 1 with real coordinates for ``d = 0`` and ``d = N/2``.  There is no assumption of a
travelling wave and no truncated Fourier series.  The contact law is applied from one instant to the
next: ``N = max(n0 + kn v, 0)``; the slider is clipped to ``u -+ mu N/kt`` and moves with ``u`` in
separation.  Coupled laws project the friction force radially onto the disk of radius ``mu N``.
Laws of constant load replace ``N`` by a given load, with a two-sided normal spring.  Bonded points
have a fixed slider.

The time step is implicit (generalised alpha); one Newton iteration gives the contact forces of all
sectors at its end (``csrc/time/generalised_alpha.c``).  There are :data:`STEPS` steps per period,
because the motion limits their length, not the stiffest contact.  The method is of second order.
The integration starts at a harmonic-balance solution.  It includes the nodal diameters of the
study's harmonics, or all that the model contains (:func:`every_diameter`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from math import gcd
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper import _core
from bdamper.contact.laws import AFT, LAW_BONDED, LAW_COUPLED, LAW_CUBIC, LAW_NORMAL, LAW_SEPARABLE
from bdamper.contact.residual_flexibility import RESIDUAL
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import SectorData
from bdamper.model.kinematics import HarmonicBasis
from bdamper.response.continuation import TWO_PI
from bdamper.util import validation
from bdamper.util.errors import BdamperError, SettingError, quiet
from bdamper.util.progress import Cost

STEPS = 256
"""Default time steps per period.

With shorter steps the mean amplitude of motions that beat rises by up to 2 % with 512, and by 3 %
with 1,024 steps.  Some beats that 1,024 steps show are damped with 512.
"""
TOLERANCE = 1e-3
"""Relative residual of the contact forces.

With 1e-4 the default search of an amplitude takes 1.2 to 1.35 times as long; its ranges differ by
less than 0.1 um on the turbine blade at and above its optimum.
"""
RADIUS = 0.3
"""Spectral radius of a time step at infinite frequency.

A step averages the contact forces of its two ends.  Modes that the steps do not resolve then gain
energy at stiff contacts with gaps and friction: with 0.7, and with 0.5, up to 4e7 times the work of
the excitation on sectors of other meshes.  With 0.3 the energy of such a sector balances to 0.05 %,
and the steps lose 0.2 % of it on the turbine blade.
"""
RADIUS_WITHOUT_MASS = 0.3
"""Spectral radius with massless coordinates."""
QUASISTATIC = 10.0
"""Natural frequency over that of the excitation from which a mode follows the forces on it without
resonance.
"""
MOST_SECTORS = 33
"""Largest number of sectors for which all nodal diameters are integrated by default.

With more sectors they are the nodal diameters of the harmonics up to :data:`MOST_HARMONIC` and of
the study's harmonics.
"""
MOST_HARMONIC = 6
MOST_PERIODS = 100
"""Largest number of periods of a given motion until sliders are periodic: two, but many under the
coupled laws.
"""


class IntegrationFailed(BdamperError):
    """The contact forces of a time step were not found, even after dividing the step, or the energy
    does not balance.
    """


class EnergyGained(IntegrationFailed):
    """The energy does not balance, because the time steps are too long for the contacts."""


class TimeSpent(BdamperError):
    """The processor time that an integration may take has been used."""


TIME_SPENT = 8
"""Status of the core if the processor time has been used."""


class TimeLimit:
    """Limit of the processor time (s) of the integrations of one result and of their equations, on
    all threads.

    Parameters
    ----------
    seconds : float, s
        Maximum total time.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self._left = seconds
        self._counting = Lock()

    def left(self) -> float:
        """Return the remaining seconds.

        Raises
        ------
        TimeSpent
            If there are none.
        """
        if self._left <= 0.0:
            raise TimeSpent(f"the {self.seconds:g} s of processor time have been used")
        return self._left

    def take(self, seconds: float) -> None:
        """Subtract used seconds."""
        with self._counting:
            self._left -= seconds

    @contextmanager
    def counted(self) -> Iterator[None]:
        """Subtract the processor time that this thread spends in the ``with`` block."""
        started = time.thread_time()
        try:
            yield
        finally:
            self.take(time.thread_time() - started)

    @property
    def remedy(self) -> str:
        """Advice to a user if the time has been used."""
        return f"raise seconds, {self.seconds:g} now"


class Motion(NamedTuple):
    """State at the start of a period.

    Parameters
    ----------
    q, v : (2 n_coordinates,) float
        Real and imaginary parts of the coordinates of all nodal diameters, and their velocities.
    w : (n_sectors, n_points, 2) float, m
        Sliders, followed by the state variables of user-defined laws.
    a : (2 n_coordinates,) float, optional
        Accelerations of the integration method.  Without them they, and massless coordinates,
        follow from the other variables.
    states : (n_steps, n_sectors, n_points) int8, optional
        Contact states in each time step of the last period; -1 if unknown.  The next period expects
        them to return, which saves evaluations of the contact forces.
    """

    q: NDArray
    v: NDArray
    w: NDArray
    a: NDArray | None = None
    states: NDArray | None = None


class Trajectory(NamedTuple):
    """Result of a time integration.

    Parameters
    ----------
    motion : Motion
        Final state.
    harmonics : (n_periods, n_blades, n_harmonics + 1) complex, m
        Response amplitudes of all blades in each complete period; the first column is the mean.
    energy : (n_periods, 4) float, J
        Energies of all sectors in each complete period: work of the excitation, loss in damping,
        work on the contacts, and rise of kinetic and strain energy.  The remainder of their balance
        is the numerical loss.
    trace : (n_steps, 2 n_coordinates) float
        Coordinates at the start of each time step, if requested; ``AllSectors.rows`` gives their
        responses.
    first : int
        Time step within the period at which the integration ended.
    """

    motion: Motion
    harmonics: NDArray
    energy: NDArray
    trace: NDArray
    first: int


class Block(NamedTuple):
    """Coordinates of one nodal diameter.

    Parameters
    ----------
    harmonic : int
        Harmonic whose modes describe the nodal diameter.
    part : slice
        Its coordinates within those of all sectors.
    phases : (n_sectors,) complex
        Phases of its wave at the sectors.
    factor : float
        ``c_d``: 2, or 1 if the coordinates are real.
    """

    harmonic: int
    part: slice
    phases: NDArray
    factor: float


class AllSectors:
    """Equations of motion of all sectors with their contacts.

    Parameters
    ----------
    system : Equations[SectorData]
        Each harmonic has the modes of its nodal diameter.
    n_blades, engine_order : int
    wide : Equations[SectorData], optional
        Equations with more harmonics, for all nodal diameters to integrate.
    radius : float, optional
        Spectral radius of a time step at infinite frequency, 1 for no numerical damping.  Default:
        :data:`RADIUS`, or :data:`RADIUS_WITHOUT_MASS` with massless coordinates.
    wide_order : int, optional
        Engine order of ``wide``; the same by default.  A divisor of it gives more sectors, which
        this order distinguishes.
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
        system: Equations[SectorData],
        n_blades: int,
        engine_order: int,
        wide: Equations[SectorData] | None = None,
        radius: float | None = None,
        wide_order: int | None = None,
        rows: NDArray | None = None,
    ) -> None:
        self.system = system
        self.wide = system if wide is None else wide
        bonded = np.asarray(system.structure.points.law)[:, None] == LAW_BONDED
        self.held = np.broadcast_to(bonded, (system.n_points, 2))
        self.cost = Cost()
        # processor time of the integrations; unlimited if None
        self.limit: TimeLimit | None = None
        # time steps with a solution for contact forces, and evaluations for them
        self.effort = np.zeros(2, int)

        order_of_wide = engine_order if wide_order is None else wide_order
        # number of sectors after which the motion repeats; one for engine order 0
        self.n = n_blades // gcd(n_blades, order_of_wide) if order_of_wide else 1
        # ratio of nodal diameters of the disk to nodal diameters of self.n sectors
        self.step = n_blades // self.n
        # nodal diameters of the excited wave and of the first harmonic of wide on self.n sectors
        self.wave = engine_order // self.step
        wave_of_wide = order_of_wide // self.step

        # signed nodal diameter on self.n sectors -> harmonic that describes it
        self.families = self._find_families(wave_of_wide)
        excited = self.wide if order_of_wide == engine_order else system
        # harmonic -> matrix from its coordinates to the coordinates of its family
        self._turns = self._find_turns(excited)
        self._check_diameters(n_blades, engine_order)

        self.blocks = self._find_blocks()
        self.n_coordinates = self.blocks[-1].part.stop
        # (n_coordinates,) bool
        self.real = self._on_coordinates([block.factor == 1.0 for block in self.blocks])

        bases = self._bases
        self.stiffness = np.concatenate([np.asarray(basis.omega2) for basis in bases])
        self.mass = np.concatenate([np.asarray(basis.mass) for basis in bases])
        damping = np.concatenate([np.asarray(basis.damping) for basis in bases])
        heavy = self.mass > 0.0
        mass_or_one = np.where(heavy, self.mass, 1.0)
        self.omega2 = np.where(heavy, self.stiffness / mass_or_one, 0.0)
        self.damping = np.where(heavy, damping / mass_or_one, 0.0)
        # full bandwidth (rad/s) of the least damped mode; infinite if no mode has stiffness
        self.least_damping = float(self.damping[self.omega2 > 0.0].min(initial=np.inf))

        if radius is None:
            radius = RADIUS if heavy.all() else RADIUS_WITHOUT_MASS
        self.radius = radius
        self.rows = self._rows() if rows is None else rows
        self.core = self._core()

    def _find_families(self, wave_of_first: int) -> dict[int, int]:
        """Return the harmonic that describes each nodal diameter.

        ``wave_of_first`` is the nodal diameter of the first harmonic of ``wide``.
        """
        families: dict[int, int] = {}
        for harmonic, basis in enumerate(self.wide.structure.bases):
            if not len(basis.omega2):
                continue
            d = (harmonic * wave_of_first) % self.n
            # the coordinates of a nodal diameter contain waves in both directions
            backward = (self.n - d) % self.n
            if d not in families and backward not in families:
                families[d] = harmonic
        return families

    def _on_coordinates(self, values: Sequence[float]) -> NDArray:
        """Return a value of each block at each of its coordinates, (n_coordinates,)."""
        sizes = [block.part.stop - block.part.start for block in self.blocks]
        return np.repeat(np.array(values), sizes)

    def _find_turns(self, excited: Equations[SectorData]) -> dict[int, NDArray]:
        """Return the matrix of each harmonic from its coordinates to its family's coordinates."""
        turns = {}
        for harmonic, basis in enumerate(excited.structure.bases):
            if len(basis.omega2):
                family, backward = self._family(harmonic)
                of_family = self.wide.structure.bases[family]
                turns[harmonic] = _turn(of_family, basis, conjugate=backward)
        return turns

    def _check_diameters(self, n_blades: int, engine_order: int) -> None:
        """Refuse one basis for harmonics of several nodal diameters."""
        bases = self.system.structure.bases
        active = [harmonic for harmonic, basis in enumerate(bases) if len(basis.omega2)]
        described = {bases[harmonic].nodal_diameter for harmonic in active}
        if self.n == 1 or self.system.n_harmonics == 0 or len(described) != 1:
            return
        # nodal diameters of waves in either direction
        excited = set()
        for harmonic in active:
            order = harmonic * engine_order
            excited.add(min(order % n_blades, -order % n_blades))
        if len(excited) > 1:
            raise SettingError(
                "time integration: expected fundamental_modes_only=False, "
                "found one basis for several nodal diameters"
            )

    def _find_blocks(self) -> list[Block]:
        """Return the blocks of all nodal diameters in the order of their coordinates."""
        sectors = np.arange(self.n)
        blocks = []
        start = 0
        for d, harmonic in self.families.items():
            end = start + len(self.wide.structure.bases[harmonic].omega2)
            phases = np.exp(2j * np.pi * sectors * d / self.n)
            # a wave that does not travel has real coordinates
            factor = 1.0 if d == 0 or 2 * d == self.n else 2.0
            blocks.append(Block(harmonic, slice(start, end), phases, factor))
            start = end
        return blocks

    @property
    def _bases(self) -> list[HarmonicBasis]:
        """Modes of the nodal diameters, one basis for each block."""
        return [self.wide.structure.bases[block.harmonic] for block in self.blocks]

    def _core(self) -> _core.TimeIntegration:
        """Return the core object with modes, points, excitation and response."""
        bases = self._bases
        orders, force = self.forcing()
        arrays = self.wide.structure.arrays
        return _core.TimeIntegration(
            self.n,
            np.array([len(basis.omega2) for basis in bases], np.intc),
            np.array(list(self.families), np.intc),
            self.stiffness,
            self.mass,
            np.concatenate([basis.damping for basis in bases]),
            np.concatenate([np.ascontiguousarray(basis.G, complex).ravel() for basis in bases]),
            kt=arrays["kt"],
            kn=arrays["kn"],
            mu=arrays["mu"],
            n0=arrays["n0"],
            load=arrays["load"],
            shift=arrays["shift"],
            law=arrays["law"],
            held=np.ascontiguousarray(self.held, np.intc),
            order=orders,
            force=force,
            row=self.rows,
            own=self.system.structure.own,
        )

    def _harmonics(self, u: NDArray) -> Iterator[tuple[int, NDArray]]:
        """Yield each harmonic and its amplitudes (n_coordinates,) complex.

        The harmonic is negative for a backward wave.
        """
        part_of = {block.harmonic: block.part for block in self.blocks}
        for harmonic, basis in enumerate(self.system.structure.bases):
            if not len(basis.omega2):
                continue
            family, backward = self._family(harmonic)
            amplitudes = self.system.layout.amplitudes(np.asarray(u), harmonic)
            if backward:
                amplitudes = amplitudes.conj()
            out = np.zeros(self.n_coordinates, complex)
            out[part_of[family]] = self._turns[harmonic] @ amplitudes
            yield -harmonic if backward else harmonic, out

    def forcing(self) -> tuple[NDArray, NDArray]:
        """Return the excitation as factors of cosines and sines.

        Returns
        -------
        orders : (n,) int
            Harmonics of the excitation.
        factors : (n, 2, 2 n_coordinates) float
            Factors of their cosines and sines.
        """
        orders = []
        factors = []
        for harmonic, amplitudes in self._harmonics(self.system.structure.force):
            # a exp(i l t) = a cos(l t) + i a sin(l t), with the opposite sine backward
            sine = -1j * amplitudes if harmonic < 0 else 1j * amplitudes
            cosine_and_sine = np.array([amplitudes, sine])  # (2, n_coordinates)
            real_part = cosine_and_sine[:, self.real].real
            cosine_and_sine[:, self.real] = real_part
            if cosine_and_sine.any():
                orders.append(abs(harmonic))
                parts = [cosine_and_sine.real, cosine_and_sine.imag]
                factors.append(np.concatenate(parts, axis=1))
        shape = len(orders), 2, 2 * self.n_coordinates
        return np.array(orders, np.intc), np.array(factors).reshape(shape)

    def _family(self, harmonic: int) -> tuple[int, bool]:
        """Return the harmonic whose modes describe this one, and whether it travels backward."""
        d = (harmonic * self.wave) % self.n
        if d in self.families:
            return self.families[d], False
        opposite = (self.n - d) % self.n
        return self.families[opposite], True

    def state(self, u: NDArray, omega: float, t: float) -> tuple[NDArray, NDArray]:
        """Return coordinates and velocities of a harmonic-balance solution at one instant.

        Both have the shape (2 n_coordinates,).
        """
        q = np.zeros(self.n_coordinates, complex)
        v = np.zeros(self.n_coordinates, complex)
        for harmonic, amplitudes in self._harmonics(u):
            turned = amplitudes * np.exp(1j * harmonic * omega * t)
            q += turned
            v += 1j * harmonic * omega * turned
        q[self.real] = q[self.real].real
        v[self.real] = v[self.real].real
        return _as_real(q), _as_real(v)

    def start(self, u: NDArray, omega: float, n_steps: int) -> Motion:
        """Return the motion of a harmonic-balance solution at t = 0, with its sliders."""
        q, v = self.state(u, omega, 0.0)
        return Motion(q, v, self.initial_slider(u, omega, n_steps))

    def initial_slider(self, u: NDArray, omega: float, n_steps: int) -> NDArray:
        """Return the sliders of a solution at t = 0.

        They follow the motion of the solution over periods until they are periodic.
        """
        points = self.system.structure.points
        initial = points.slider
        if points.memory is not None:
            initial = np.hstack([points.slider, points.memory])
        # in all sectors, (n_sectors, n_points, 2 + number of state variables)
        w = np.tile(initial, (self.n, 1, 1)).astype(float)

        # a bound of the largest tangential motion: the sum over all harmonics
        motion, _, _ = self.system.contact(np.asarray(u))  # (n_points, 3, 2 H + 1)
        amplitude = float(np.abs(motion[:, :2, 1:]).sum(axis=2).max(initial=0.0))
        peak_to_peak = max(2.0 * amplitude, 1e-300)
        # motion over one period, (n_steps, 2 n_coordinates)
        instants = [step * TWO_PI / omega / n_steps for step in range(n_steps)]
        states = [self.state(u, omega, instant) for instant in instants]
        q = np.array([coordinates for coordinates, _ in states])
        for _ in range(MOST_PERIODS):
            before = w.copy()
            self.core.follow(q, w)
            change = np.abs(w - before)
            sliders_repeat = change[..., :2].max(initial=0.0) <= 1e-9 * peak_to_peak
            # each state variable of a user-defined law has its own unit
            size = np.maximum(np.abs(w[..., 2:]).max(axis=(0, 1)), 1e-300)
            variables_repeat = (change[..., 2:] <= 1e-9 * size).all()
            if sliders_repeat and variables_repeat:
                break
        # from the end of the last period to the start of the next
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
        """Integrate a state over complete periods of the excitation, or a number of time steps.

        The time steps are equal in the angle of the excitation; the first begins at ``2 pi
        first/n_steps``.

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
            Final frequency, reached linearly with time.
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
        TimeSpent
            If the processor time of :attr:`limit` is spent.
        """
        seconds = 0.0 if self.limit is None else self.limit.left()
        count = n_steps * periods if steps is None else steps
        complete_periods = count // n_steps
        # the core takes several states, and integrates copies in place
        q = np.array(motion.q[None], float, order="C")
        v = np.array(motion.v[None], float, order="C")
        w = np.array(motion.w[None], float, order="C")
        a = np.zeros_like(q) if motion.a is None else np.array(motion.a[None], float, order="C")
        n_columns = self.system.n_harmonics + 1
        harmonics = np.zeros((1, complete_periods, len(self.rows), n_columns), complex)
        energy = np.zeros((1, complete_periods, 4))
        path = np.zeros((1, count, q.shape[1])) if trace else None
        states = np.full((1, n_steps, self.n, self.system.n_points), -1, np.int8)
        # those of steps of another length do not count
        if motion.states is not None and motion.states.shape == states.shape[1:]:
            states[0] = motion.states

        started = time.thread_time()
        status, *effort = self.core.integrate(
            q,
            v,
            a,
            w,
            count,
            n_steps,
            omega,
            omega if omega_end is None else omega_end,
            self.radius,
            tolerance,
            motion.a is None,
            harmonics,
            path,
            first,
            energy,
            seconds,
            states,
        )
        taken = time.thread_time() - started
        self.effort = self.effort + effort
        self.cost = replace(
            self.cost,
            time_integration=self.cost.time_integration + taken,
            evaluations=self.cost.evaluations + count + 1,
        )
        if self.limit is not None:
            self.limit.take(taken)
            if status == TIME_SPENT:
                # raises, because at least these seconds were taken
                self.limit.left()
        if status:
            raise IntegrationFailed(
                f"the time integration fails near {omega / TWO_PI:.6g} Hz: contact forces are not "
                f"found in a time step of 1/{n_steps} of a period, nor in parts of it; "
                "raise steps_per_period"
            )
        return Trajectory(
            motion=Motion(q[0], v[0], w[0], a[0], states[0]),
            harmonics=harmonics[0],
            energy=energy[0],
            trace=np.zeros((0, q.shape[1])) if path is None else path[0],
            first=(first + count) % n_steps,
        )

    @property
    def _energy_share(self) -> NDArray:
        """Half the number of sectors over ``c_d``, for each complex coordinate.

        Times mass and squared velocity it is the kinetic energy of all sectors.
        """
        return self._on_coordinates([0.5 * self.n / block.factor for block in self.blocks])

    def energy(self, motion: Motion) -> float:
        """Return kinetic and strain energy of a motion (J), and the energy in its contact springs.

        It is infinite for user-defined contact laws, whose energy is unknown.
        """
        share = self._energy_share
        kinetic = np.tile(self.mass * share, 2) @ motion.v**2
        strain = np.tile(self.stiffness * share, 2) @ motion.q**2
        return float(kinetic + strain + self.contact_energy(motion))

    def contact_energy(self, motion: Motion) -> float:
        """Return the energy (J) stored in the contact springs of all sectors.

        It is infinite for user-defined contact laws.
        """
        if self.system.structure.points.own is not None:
            return float("inf")
        arrays = self.wide.structure.arrays
        kt = arrays["kt"]  # (n_points, 2)
        kn = arrays["kn"]  # (n_points,)
        law = arrays["law"]
        z = _as_complex(motion.q)
        # displacements (n_sectors, n_points, 3) of all points
        x = np.tile(np.asarray(arrays["shift"]), (self.n, 1, 1))
        for basis, block in zip(self._bases, self.blocks):
            # complex amplitude (n_points, 3) of the wave in the first sector; every other sector has
            # its phase
            of_first_sector = np.asarray(basis.G) @ z[block.part]
            x += np.tensordot(block.phases, of_first_sector, axes=0).real
        tangential = x[..., :2]
        normal = x[..., 2]

        # an open point of a law with separation carries no force and stores nothing; the other laws
        # have a spring that carries tension as well
        force = arrays["n0"] + kn * normal
        separates = np.isin(law, (LAW_SEPARABLE, LAW_NORMAL, LAW_COUPLED))
        normal_force = np.where(separates, np.maximum(force, 0.0), force)
        # twice the energy of each normal spring; 0 without stiffness
        pressed = normal_force**2 / np.where(kn > 0.0, kn, np.inf)

        # friction limits the stretch of the tangential springs, but not at bonded points
        limit = arrays["mu"] * np.maximum(np.abs(normal_force), arrays["load"])
        stretch_at_limit = limit[..., None] / np.where(kt > 0.0, kt, np.inf)
        longest = np.where(self.held, np.inf, stretch_at_limit)
        sliders = motion.w[..., :2]
        stretched = np.minimum(np.abs(tangential - sliders), longest)
        # a cubic spring k u^3 stores k u^4/4, as a linear one with the stretch u^2/sqrt(2)
        cubic = (law == LAW_CUBIC)[:, None]
        stretched = np.where(cubic, tangential**2 / np.sqrt(2.0), stretched)
        return float(0.5 * ((kt * stretched**2).sum() + pressed.sum()))

    def vibration_energy(self, motion: Motion, omega: float) -> float:
        """Return the energy (J) of the vibration at ``omega`` (rad/s).

        It excludes the strain energy of the loads at rest.  In a harmonic motion velocities and
        accelerations give the same energy at every instant.
        """
        acceleration = np.zeros_like(motion.v) if motion.a is None else motion.a
        squared_velocity = motion.v**2 + (acceleration / omega) ** 2
        return float(np.tile(self.mass * self._energy_share, 2) @ squared_velocity)

    def amplitude_bound(self, omega: float) -> float:
        """Return a bound (m) of the first harmonic of a steady response.

        The bound holds for its root mean square over the blades.

        Contacts take energy from a steady motion, so that damping takes at most the work of the
        excitation.  In coordinates p scaled with the square roots of the damping constants, force f
        and response row r, damping takes pi omega |p|^2 and the excitation gives at most pi |f|
        |p|; hence |p| <= |f|/omega and |r p| <= |r| |f|/omega.  For one mode at its resonance this
        is the response without contacts.  Modes above :data:`QUASISTATIC` times the frequency
        follow the contact forces and add at most a few per cent, so they do not count.  The bound
        is infinite if the response contains a mode without damping, under other orders of the
        excitation than the first, and for user-defined laws.
        """
        orders, factors = self.forcing()
        if self.system.structure.points.own is not None or set(orders) - {0} != {1}:
            return float("inf")
        n = self.n_coordinates
        damping = self.damping * np.where(self.mass > 0.0, self.mass, 1.0)
        vibrates = (self.mass > 0.0) & (self.omega2 <= (QUASISTATIC * omega) ** 2)
        # factors of the cosine and of the sine of the first order
        cosine, sine = factors[list(orders).index(1)]
        squared = np.abs(_as_complex(cosine)) ** 2 + np.abs(_as_complex(sine)) ** 2
        # a real coordinate has one amplitude for both; in a wave each of the two has this amplitude
        force = vibrates * np.sqrt(np.where(self.real, squared, 0.5 * squared))
        # rows of real and imaginary parts as complex ones, (n_blades, n_coordinates): the response
        # is Re[r z]
        complex_rows = self.rows[:, :n] - 1j * self.rows[:, n:]
        response = vibrates * np.abs(complex_rows)

        # identical blades respond most to a force in one wave; the wave with the least damping bounds
        # all of them
        scaled_force = _over_root(force, damping)
        scaled_response = _over_root(response, damping)  # (n_blades, n_coordinates)
        of_waves = []
        for block in self.blocks:
            of_blades = np.linalg.norm(scaled_response[:, block.part], axis=1)
            of_waves.append(of_blades.max())
        return float(max(of_waves) * np.linalg.norm(scaled_force) / omega)

    @property
    def nodal_diameters(self) -> tuple[int, ...]:
        """Nodal diameters of the time integration."""
        return tuple(sorted({basis.nodal_diameter for basis in self._bases}))

    def _rows(self) -> NDArray:
        """Return the rows of the responses of all blades, (n_sectors, 2 n_coordinates)."""
        n = self.n_coordinates
        rows = np.zeros((self.n, 2 * n))
        for harmonic, part, phases, _ in self.blocks:
            response = phases[:, None] * np.asarray(self.wide.response_rows[harmonic], complex)
            # Re[r z] = Re r Re z - Im r Im z
            rows[:, part] = response.real
            rows[:, n + part.start : n + part.stop] = -response.imag
        return rows

    def departure(self, response: NDArray) -> NDArray:
        """Return the fraction (n_periods,) of responses in other waves than the excited wave.

        ``response`` has the shape (n_periods, n_blades).
        """
        squared = np.abs(np.fft.fft(response, axis=1)) ** 2
        excited = squared[:, self.wave % self.n]
        away = 1.0 - excited / np.maximum(squared.sum(axis=1), 1e-300)
        return np.sqrt(np.maximum(away, 0.0))

    def tractions(self, motion: Motion) -> dict[str, NDArray]:
        """Return sliders (n_sectors, n_points, 2) of the motion under different tractions."""
        at_limit = []
        for far in (1e6, -1e6):  # m
            w = motion.w.copy()
            w[:, :, :2] = np.where(self.held, w[:, :, :2], far)
            # the motion draws the slider from far away to the limit
            self.core.follow(motion.q[None], w)
            at_limit.append(w)
        forward, backward = at_limit
        return {
            "no traction": 0.5 * (forward + backward),
            "limit of friction": forward,
            "limit of friction backward": backward,
        }

    def waves(self, response: NDArray) -> NDArray:
        """Decompose the responses of all blades into waves, by discrete Fourier transform.

        Parameters
        ----------
        response : (n_periods, n_blades) complex, m

        Returns
        -------
        (n_blades, 2) float
            Nodal diameter of the disk, negative against the direction of the excitation, and
            amplitude (m), the root mean square over the periods; in descending order of amplitude.
        """
        of_waves = np.abs(np.fft.fft(response, axis=1) / self.n)
        amplitude = np.sqrt((of_waves**2).mean(axis=0))
        d = np.arange(self.n)
        signed = self.step * np.where(2 * d > self.n, d - self.n, d)
        # the excited wave has a positive sign
        if 2 * (self.wave % self.n) > self.n:
            signed = -signed
        descending = np.argsort(-amplitude)
        return np.column_stack([signed, amplitude])[descending]

    def seeded(self, motion: Motion, share: float, seed: int) -> Motion:
        """Return the motion, perturbed in each nodal diameter.

        Without perturbations, only rounding errors would break the symmetry.

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
        rng = np.random.default_rng(seed)
        # complex factors of the forward and the backward wave of each nodal diameter
        factors = share * np.exp(2j * np.pi * rng.random((len(self.blocks), 2)))
        family, _ = self._family(1)
        excited = next(block.part for block in self.blocks if block.harmonic == family)

        def disturbed(x: NDArray) -> NDArray:
            """Return coordinates with a copy of the excited wave in every nodal diameter."""
            z = _as_complex(x)
            wave = z[excited].copy()
            for block, (forward, backward) in zip(self.blocks, factors):
                disturbance = forward * wave + backward * wave.conj()
                # nodal diameters may have different numbers of modes
                begin = block.part.start
                n_common = min(len(wave), block.part.stop - begin)
                z[begin : begin + n_common] += disturbance[:n_common]
            z[self.real] = z[self.real].real
            return _as_real(z)

        return Motion(disturbed(motion.q), disturbed(motion.v), motion.w)


def _as_complex(x: NDArray) -> NDArray:
    """Return complex coordinates from their real and imaginary parts."""
    n = len(x) // 2
    return x[:n] + 1j * x[n:]


def _as_real(z: NDArray) -> NDArray:
    """Return the real parts of complex coordinates, then the imaginary parts."""
    return np.concatenate([z.real, z.imag])


def _over_root(x: NDArray, damping: NDArray) -> NDArray:
    """Return x over the root of the damping; infinite without damping, but 0 for x = 0."""
    undamped = np.where(x > 0.0, np.inf, 0.0)
    root = np.sqrt(np.where(damping > 0.0, damping, 1.0))
    return np.where(damping > 0.0, x / root, undamped)


def _turn(family: HarmonicBasis, basis: HarmonicBasis, conjugate: bool) -> NDArray:
    """Return the matrix (m, n) from coordinates of a harmonic to coordinates of its family.

    Both describe the same nodal diameter, or with ``conjugate`` nodal diameters that are conjugate
    to each other.  Residual modes of the two are rotated against each other and span the same
    flexibility; all other modes are equal.
    """
    if family is basis:
        return np.eye(len(basis.omega2))
    family_modes = np.asarray(family.G).reshape(-1, len(family.omega2))
    modes = np.asarray(basis.G).reshape(-1, len(basis.omega2))
    if conjugate:
        modes = modes.conj()

    # masks of the residual modes; all others are equal in both
    family_residual = _residual(family)
    residual = _residual(basis)
    family_others = family_modes[:, ~family_residual]
    others = modes[:, ~residual]
    rounding = 1e-12 * np.abs(family_modes).max(initial=0.0)
    equal = family_others.shape == others.shape and np.allclose(
        family_others, others, rtol=1e-12, atol=rounding
    )
    if not equal:
        raise SettingError(
            "time integration: the modes of a harmonic must belong to one nodal diameter"
        )
    turn = np.zeros((family_modes.shape[1], modes.shape[1]), complex)
    turn[np.flatnonzero(~family_residual), np.flatnonzero(~residual)] = 1.0
    if family_residual.any() and residual.any():
        rotation, *_ = np.linalg.lstsq(
            family_modes[:, family_residual], modes[:, residual], rcond=None
        )
        turn[np.ix_(family_residual, residual)] = rotation
    return turn


def _residual(basis: HarmonicBasis) -> NDArray:
    """Return which modes (n_modes,) are residual modes; none if the basis names no coordinates."""
    if not basis.coordinates:
        return np.zeros(len(basis.omega2), bool)
    return np.array([coordinate.body == RESIDUAL for coordinate in basis.coordinates], bool)


def extended(source: AllSectors, u: NDArray, target: AllSectors) -> NDArray:
    """Return a harmonic-balance solution in a structure with other modes and the same points.

    Modes of both structures keep their amplitudes.  With the contact force ``F_l`` of the solution
    in harmonic l, the other modes of the target and its residual modes have the quasi-static
    amplitudes

        q_l = (E_l - G_l^H F_l)/Omega^2.

    At rest instead, they would leave stiff contacts penetrated or apart: on an imported sector the
    first period then lost 37 times the work of the excitation, and 1.1 times with this start.

    Parameters
    ----------
    source, target : AllSectors
    u : (n_unknowns,) float
        Unknowns of the source.
    """
    if source is target:
        return u
    layout = source.system.layout
    layout_of_target = target.system.layout
    _, force, _ = source.system.contact(np.asarray(u))  # (n_points, 3, 2 H + 1)
    out = np.zeros(layout_of_target.n_unknowns)
    for harmonic, basis in enumerate(target.system.structure.bases):
        if not len(basis.omega2):
            continue
        of_points = force[:, :, 0].astype(complex)
        if harmonic:
            of_points = force[:, :, 2 * harmonic - 1] - 1j * force[:, :, 2 * harmonic]
        load = layout_of_target.amplitudes(np.asarray(target.system.structure.force), harmonic)
        contact_force = np.einsum("pdj,pd->j", np.asarray(basis.G).conj(), of_points)
        has_stiffness = np.asarray(basis.omega2) > 0.0
        stiffness = np.where(has_stiffness, basis.omega2, np.inf)
        q = (load - contact_force) / stiffness

        of_source = source.system.structure.bases[harmonic]
        in_target, in_source = _common_modes(of_source, basis)
        q[in_target] = layout.amplitudes(np.asarray(u), harmonic)[in_source]
        cosine, sine = layout_of_target.slices(harmonic)
        out[cosine] = q.real
        if harmonic:
            out[sine] = -q.imag
    return out


def _common_modes(source: HarmonicBasis, target: HarmonicBasis) -> tuple[list[int], list[int]]:
    """Return the indices of the modes of both, in the target and in the source.

    Residual modes are left out, because they differ between structures.
    """
    # body and number identify a mode
    place_in_source = {}
    for place, mode in enumerate(source.coordinates):
        place_in_source[mode.body, mode.index] = place
    in_target: list[int] = []
    in_source: list[int] = []
    for place, mode in enumerate(target.coordinates):
        name = (mode.body, mode.index)
        if mode.body != RESIDUAL and name in place_in_source:
            in_target.append(place)
            in_source.append(place_in_source[name])
    return in_target, in_source


def transfer(source: AllSectors, motion: Motion, target: AllSectors) -> Motion:
    """Return a motion in the coordinates of another structure with the same contact points.

    Modes that the source does not have are at rest, and so are the residual modes, because they
    differ between structures.
    """
    source_blocks = dict(zip(source.families, source.blocks))  # by nodal diameter
    # indices of the coordinates of the same modes in both
    in_target: list[int] = []
    in_source: list[int] = []
    for diameter, target_block in zip(target.families, target.blocks):
        if diameter not in source_blocks:
            continue
        source_block = source_blocks[diameter]
        of_target, of_source = _common_modes(
            source.wide.structure.bases[source_block.harmonic],
            target.wide.structure.bases[target_block.harmonic],
        )
        in_target += [target_block.part.start + place for place in of_target]
        in_source += [source_block.part.start + place for place in of_source]

    def transferred(x: NDArray) -> NDArray:
        """Return coordinates or velocities (2 n_coordinates,) of the target."""
        z = np.zeros(target.n_coordinates, complex)
        z[in_target] = _as_complex(x)[in_source]
        return _as_real(z)

    return Motion(transferred(motion.q), transferred(motion.v), motion.w)


def every_diameter(problem: Problem) -> Problem:
    """Return the problem with harmonics of all nodal diameters that the model contains.

    With more than :data:`MOST_SECTORS` sectors it has the harmonics of the study and all harmonics
    up to :data:`MOST_HARMONIC`.
    """
    order = int(problem.engine_order)
    n_blades = problem.model.n_blades
    # number of sectors after which the excitation repeats; one for order 0
    n_sectors = n_blades // gcd(n_blades, order) if order else 1
    # as many harmonics as these sectors have nodal diameters
    highest = n_sectors // 2 if n_sectors <= MOST_SECTORS else MOST_HARMONIC
    present = set(problem.harmonic_numbers)
    missing = set(range(1, highest + 1)) - present
    if problem.settings.fundamental_modes_only or not missing:
        return problem

    contact_forces = _sampling(problem, max(present | missing))

    def with_harmonics(harmonics: set[int]) -> Problem | None:
        """Return the problem with these harmonics, or None if the model lacks the modes."""
        try:
            # without the warning about methods that replace residual modes
            with quiet():
                wide = problem.replace(
                    harmonics=tuple(sorted(harmonics)), contact_forces=contact_forces
                )
                _ = wide.bases
                same_method = wide.contact.note == problem.contact.note
        except BdamperError:
            return None
        return wide if same_method else None

    whole = with_harmonics(present | missing)
    if whole is not None:
        return whole
    # only those nodal diameters that the model contains
    contained = {harmonic for harmonic in missing if with_harmonics(present | {harmonic})}
    partial = with_harmonics(present | contained)
    return problem if partial is None else partial


def _sampling(problem: Problem, highest: int) -> str | AFT:
    """Return the evaluation of contact forces for harmonics up to ``highest``."""
    if isinstance(problem.settings.contact_forces, str):
        return "event_driven"
    return AFT(8 * highest + 128)


def all_sectors(
    problem: Problem, preload: float, blades: int | None = None, limit: TimeLimit | None = None
) -> AllSectors:
    """Return the equations of motion of all sectors at a preload (N).

    They include every nodal diameter of the model.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    blades : int, optional
        Number of blades; by default the smallest number after which the excitation
        repeats.
    limit : TimeLimit, optional
        Processor time of the integrations.

    Raises
    ------
    SettingError
        If the number of blades of the disk is not a multiple of ``blades``, if ``blades`` is not a
        multiple of the period of the excitation, if the model lacks nodal diameters of these
        sectors, or if the response is absolute.
    """
    if limit is None:
        return _without_time_limit(problem, preload, blades)
    with limit.counted():
        sectors = _without_time_limit(problem, preload, blades)
    sectors.limit = limit
    return sectors


def _without_time_limit(problem: Problem, preload: float, blades: int | None) -> AllSectors:
    """See :func:`all_sectors`."""
    is_relative = not problem.settings.response_location.absolute
    expected = "a response relative to the base"
    found = "an absolute one; integrate study.replace(response=bd.Response(location, direction))"
    validation.check(is_relative, "time integration", expected, found)
    n_blades = problem.model.n_blades
    order = int(problem.engine_order)
    system = problem.system(preload)
    # smallest number after which the excitation repeats; one for order 0
    least = n_blades // gcd(n_blades, order) if order else 1
    if blades is None or blades == least:
        same_order = every_diameter(problem)
        wide = system if same_order is problem else same_order.system(preload)
        return AllSectors(system, n_blades, order, wide=wide)
    if not order or n_blades % blades or blades % least:
        sizes = [n for n in range(least, n_blades + 1, least) if n_blades % n == 0]
        raise validation.invalid(
            "blades",
            f"one of {sizes}, rings that repeat on {n_blades} blades at engine order {order}",
            blades,
        )

    # an engine order that distinguishes all sectors of the larger disk
    distinguishing = n_blades // blades
    larger = problem.replace(
        engine_order=distinguishing,
        harmonics=tuple(range(1, blades // 2 + 1)),
        contact_forces=_sampling(problem, blades),
    )
    # the study's first harmonic determines the point springs
    contact = problem.contact
    residual = larger.contact.residual
    if contact.residual is not None and residual is not None:
        residual = replace(residual, flexibility=contact.residual.flexibility, _bases={})
    larger = larger.given(contact=replace(contact, residual=residual))
    return AllSectors(
        system, n_blades, order, wide=larger.system(preload), wide_order=distinguishing
    )
