"""Time integration of the equations whose periodic solutions the harmonic balance approximates, as an independent check.

All sectors of the disk are included, each with its own contacts and sliders.  Their motion is a superposition of nodal
diameters ``d``, one family for each nodal diameter in use, with complex coordinates ``eta_d(t)``:

    x_k(t) = shift + sum_d Re[G_d eta_d(t) exp(i k d 2 pi/N)],
    eta_d'' + 2 zeta Omega eta_d' + Omega^2 eta_d + (c_d/N) sum_k G_d^H exp(-i k d 2 pi/N) F_k(t) = E_d(t),

``c_d = 2``, and 1 with real coordinates for ``d = 0`` and ``d = N/2``.  No travelling wave is assumed, no Fourier series
cut off.  The contact law is applied from one instant to the next: ``N = max(n0 + kn v, 0)``, the slider is clipped to
``u -+ mu N/kt`` and moves with ``u`` where the contact is open.  Under the coupled laws the friction force is drawn back
radially to the disk of radius ``mu N``; under those of constant load a given load takes the place of ``N`` there, and the
normal spring is two-sided; bonded points keep their slider.

Coordinates without inertia (residual modes) follow the contact condition, which is solved at every instant; those with
very little count as such (``QUICK``).

Central differences (velocity Verlet), whose error is of second order in the step; the step follows from the stiffest
contact.  The start is the harmonic-balance solution, so what is measured is where the motion goes from there.
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
from bdamper.contact.laws import LAW_BONDED, LAW_CUBIC
from bdamper.contact.residual_modes import RESIDUAL
from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.model.coupling import HarmonicBasis
from bdamper.stability.disturbances import TWO_PI
from bdamper.util import validate
from bdamper.util.cost import Cost
from bdamper.util.errors import SettingError

ACCURACY = 0.5
"""Step times the highest frequency of the closed contacts (2 is the limit of stability).  A fifth of it moves the amplitude
of periodic motions by 0.0003 of it, their largest multiplier by up to 0.005, and that of chatter by 7 %."""
QUICK = 200.0
"""Coordinates whose own frequency is so many times that of the excitation count as without mass: of what they move by,
the third harmonic is off by 2e-4, and ten periods of a disk end 1e-4 from those with mass, in steps 1.6 to 2.6 times as
long."""
MOST_PERIODS = 100
"""Periods of a given motion within which sliders must settle: two, but many under the coupled laws."""


class Motion(NamedTuple):
    """State at the start of a period.

    Parameters
    ----------
    q, v : (2 n_coordinates,) float
        Real and imaginary parts of the coordinates of all nodal diameters, and their velocities.
    w : (n_sectors, n_points, 2) float, m
        Sliders.
    """

    q: NDArray
    v: NDArray
    w: NDArray


class Marched(NamedTuple):
    """Where a march has come to.

    Parameters
    ----------
    motion : Motion
    harmonics : (n_periods, n_harmonics + 1) complex, m
        Amplitudes of the response in each whole period; the first column is the mean.
    trace : (n_steps, 2 n_coordinates) float
        Coordinates at the start of each step, if they were asked for; their response is that of ``Ring.response_row``.
    first : int
        Step of the period at which the motion stands.
    """

    motion: Motion
    harmonics: NDArray
    trace: NDArray
    first: int


class Ring:
    """All sectors with their contacts: the equations of motion in time.

    Parameters
    ----------
    system : HarmonicSystem
        Each harmonic described by the modes of its own nodal diameter.
    n_blades, engine_order : int
    held : (n_points, 2) bool, optional
        Sliders that stay where they are, besides those of bonded points: linear springs.
    like : (n_unknowns,) float, optional
        A solution, in which cubic springs are as stiff as they are counted.
    quick : float, rad/s
        Coordinates whose own frequency is higher count as without mass.

    Raises
    ------
    SettingError
        If the settings describe something else than a structure in time: one basis for harmonics of several nodal
        diameters, or residual modes that differ between harmonics of one nodal diameter.
    """

    def __init__(
        self,
        system: HarmonicSystem,
        n_blades: int,
        engine_order: int,
        held: NDArray | None = None,
        like: NDArray | None = None,
        quick: float = np.inf,
    ) -> None:
        arrays = system.arrays
        self.cubic = np.asarray(system.points.law) == LAW_CUBIC
        self.springs = np.concatenate([arrays["kt"], arrays["kn"][:, None]], axis=1)
        self.springs[self.cubic] = 0.0
        if like is not None and self.cubic.any():  # their largest stiffness in the cycle
            reach = np.abs(system.contact(like)[0][self.cubic, :2]).sum(axis=2)
            self.springs[self.cubic, :2] = 3.0 * arrays["kt"][self.cubic] * reach**2
        bonded = np.asarray(system.points.law)[:, None] == LAW_BONDED
        self.held = np.broadcast_to(bonded if held is None else bonded | held, (system.n_points, 2))
        self.system = system
        self.cost = Cost()
        self.n = n_blades // gcd(n_blades, engine_order) if engine_order else 1
        self.wave = engine_order // gcd(n_blades, engine_order) if engine_order else 0  # nodal diameter on self.n sectors
        self.families: dict[int, int] = {}  # signed nodal diameter on self.n sectors -> harmonic that describes it
        for l, basis in enumerate(system.bases):
            if not len(basis.omega2):
                continue
            d = (l * self.wave) % self.n
            same = self.families.get(d, self.families.get((self.n - d) % self.n))
            if same is None:
                self.families[d] = l
            elif not _same_basis(system.bases[same], basis, conjugate=d not in self.families):
                raise SettingError(_two_sets(system.bases[same], basis, same, l))
        if self.n > 1 and len({b.nodal_diameter for b in system.bases if len(b.omega2)}) == 1 and system.n_harmonics > 0:
            orders = [l * engine_order for l, basis in enumerate(system.bases) if len(basis.omega2)]
            diameters = {min(order % n_blades, -order % n_blades) for order in orders}
            if len(diameters) > 1:
                raise SettingError("verify: expected single_basis=False, found one basis for several nodal diameters")
        k = np.arange(self.n)
        self.blocks = []  # (harmonic, slice of coordinates, phases, factor)
        start = 0
        for d, l in self.families.items():
            m = len(system.bases[l].omega2)
            factor = 1.0 if d == 0 or 2 * d == self.n else 2.0
            self.blocks.append((l, slice(start, start + m), np.exp(2j * np.pi * k * d / self.n), factor))
            start += m
        self.n_coordinates = start
        self.real = np.concatenate([np.full(s.stop - s.start, factor == 1.0) for _, s, _, factor in self.blocks])
        self.stiffness = np.concatenate([system.bases[l].omega2 for l, *_ in self.blocks])
        mass = np.concatenate([system.bases[l].mass for l, *_ in self.blocks])
        self.mass = np.where(mass > self.stiffness / quick**2, mass, 0.0)
        heavy = self.mass > 0.0
        weight = np.where(heavy, self.mass, 1.0)
        self.omega2 = np.where(heavy, self.stiffness / weight, 0.0)
        self.damping = np.where(heavy, np.concatenate([system.bases[l].damping for l, *_ in self.blocks]) / weight, 0.0)
        self.least_damping = float(self.damping[self.omega2 > 0.0].min(initial=np.inf))
        """Full bandwidth (rad/s) of the least damped mode; infinite if no mode has stiffness of its own."""
        self.core = self._core()
        self.effort = np.zeros(3, int)
        """Instants at which coordinates without mass were solved for, evaluations for them, instants at which in vain."""

    def _core(self) -> _core.Ring:
        """What marches: modes, points, excitation and response in arrays."""
        bases = [self.system.bases[l] for l, *_ in self.blocks]
        orders, force = self.forcing()
        points = {name: self.system.arrays[name] for name in ("kt", "kn", "mu", "n0", "load", "shift", "law")}
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
            row=self.response_row(),
            **points,
        )

    def _harmonics(self, u: NDArray) -> Iterator[tuple[int, NDArray]]:
        """Each harmonic, negative if its wave travels backwards, and its amplitudes (n_coordinates,) complex."""
        where = {l: s for l, s, *_ in self.blocks}
        for harmonic, basis in enumerate(self.system.bases):
            if len(basis.omega2):
                l, reversed_ = self._family(harmonic)
                out, a = np.zeros(self.n_coordinates, complex), self.system.amplitudes(np.asarray(u), harmonic)
                out[where[l]] = a.conj() if reversed_ else a
                yield -harmonic if reversed_ else harmonic, out

    def forcing(self) -> tuple[NDArray, NDArray]:
        """Harmonics (n,) of the excitation, and the factors (n, 2, 2 n_coordinates) of their cosines and sines."""
        orders, factors = [], []
        for harmonic, a in self._harmonics(self.system.force):
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

    def highest_frequency(self) -> float:
        """rad/s, with every contact closed and stuck; the nodal diameters are then independent of each other."""
        highest = 0.0
        for l, s, *_ in self.blocks:
            G = np.asarray(self.system.bases[l].G).reshape(-1, s.stop - s.start)
            G = G.real if self.real[s].any() else G
            stiffness = np.diag(self.stiffness[s]) + (G.conj().T * self.springs.ravel()) @ G
            heavy = self.mass[s] > 0.0
            own, between = stiffness[np.ix_(heavy, heavy)], stiffness[np.ix_(~heavy, heavy)]
            given = own - between.conj().T @ np.linalg.solve(stiffness[np.ix_(~heavy, ~heavy)], between)
            values = np.linalg.eigvals(given / self.mass[s][heavy, None])
            highest = max(highest, float(np.abs(values).max(initial=0.0)))
        return float(np.sqrt(highest))

    def steps_for(self, omega: float, accuracy: float = 0.1) -> int:
        """Steps per period, so that ``step * highest frequency`` stays below ``accuracy`` (2 is the limit of stability)."""
        return int(np.ceil(TWO_PI / omega * self.highest_frequency() / accuracy / 64.0)) * 64

    def initial_slider(self, u: NDArray, omega: float, n_steps: int) -> NDArray:
        """Sliders at t = 0 of the solution: its motion marched over periods from the given ones until they settle."""
        w = np.tile(self.system.points.slider, (self.n, 1, 1)).astype(float)
        x, _, _ = self.system.contact(np.asarray(u))
        size = max(2.0 * float(np.abs(x[:, :2, 1:]).sum(axis=2).max(initial=0.0)), 1e-300)
        q = np.array([self.state(u, omega, k * TWO_PI / omega / n_steps)[0] for k in range(n_steps)])
        for _ in range(MOST_PERIODS):
            before = w.copy()
            self.core.follow(q, w)
            if np.abs(w - before).max(initial=0.0) <= 1e-9 * size:
                break
        self.core.follow(q[:1], w)
        return w

    def march(
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
    ) -> Marched:
        """March a state, or several, over whole periods of the excitation or any number of steps.

        The steps are equal in the angle of the excitation; that of the first is ``2 pi first/n_steps``.

        Parameters
        ----------
        motion : Motion
            Its arrays may have one dimension more in front, for several states that are marched one after the other.
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
        """
        count = n_steps * periods if steps is None else steps
        started = time.perf_counter()
        batch = motion.q.ndim > 1
        q, v, w = (np.array(x if batch else x[None], float, order="C") for x in motion)
        harmonics = np.zeros((len(q), count // n_steps, self.system.n_harmonics + 1), complex)
        path = np.zeros((len(q), count, q.shape[1])) if trace else None
        effort = self.core.march(
            q, v, w, count, n_steps, omega, omega if omega_end is None else omega_end, harmonics, path, first
        )
        self.effort = self.effort + effort
        cost = self.cost
        self.cost = replace(
            cost, contact=cost.contact + time.perf_counter() - started, evaluations=cost.evaluations + len(q) * (count + 1)
        )
        out = (q, v, w, harmonics, np.zeros((len(q), 0, q.shape[1])) if path is None else path)
        q, v, w, harmonics, path = out if batch else (x[0] for x in out)
        return Marched(Motion(q, v, w), harmonics, path, (first + count) % n_steps)

    @property
    def unsolved(self) -> str:
        """At how many instants so far the contact condition was not met; "" if at none."""
        solved, _, failed = self.effort
        return f"the contact condition was not met at {failed} of {solved} instants" if failed else ""

    def response_row(self) -> NDArray:
        """(2 n_coordinates,) row of the response on the reference sector."""
        out = np.zeros(2 * self.n_coordinates)
        for l, s, _, _ in self.blocks:
            r = np.asarray(self.system.response_rows[l], complex)
            out[s] = r.real
            out[s.start + self.n_coordinates : s.stop + self.n_coordinates] = -r.imag
        return out


def _two_sets(a: HarmonicBasis, b: HarmonicBasis, first: int, second: int) -> str:
    """What is wrong where two harmonics of one nodal diameter have different modes."""
    if RESIDUAL in {c.body for c in a.coordinates + b.coordinates}:
        return (
            f"contact_stiffness: expected other than residual modes to integrate in time, as the harmonics {first} and "
            f"{second} share a nodal diameter and each has residual modes of its own; found residual modes"
        )
    return "verify: expected each harmonic to have the modes of its own nodal diameter"


def _same_basis(a: HarmonicBasis, b: HarmonicBasis, conjugate: bool) -> bool:
    """Whether two harmonics have the same modes at the contact points, those of the second conjugated if asked for."""
    Ga, Gb = np.asarray(a.G), np.asarray(b.G)
    if Ga.shape != Gb.shape:
        return False
    Gb = Gb.conj() if conjugate else Gb
    return bool(np.allclose(Ga, Gb, rtol=1e-12, atol=1e-12 * np.abs(Ga).max(initial=0.0)))


def ring_and_steps(
    system: HarmonicSystem, omega: float, n_blades: int, engine_order: int, steps: int | None = None,
    like: NDArray | None = None, accuracy: float = ACCURACY,
) -> tuple[Ring, int]:  # fmt: skip
    """What is marched, and the steps per period: those given, or such that step times highest frequency is ``accuracy``.

    Cubic springs are as stiff as in the solution ``like``, if one is given.

    Raises
    ------
    SettingError
        If the steps that are given are too few for a stable march.
    """
    ring = Ring(system, n_blades, engine_order, like=like, quick=QUICK * omega)
    n = max(256, ring.steps_for(omega, accuracy))
    if steps is not None:
        n = validate.whole("steps_per_period", steps, least=1)
    if n * omega / TWO_PI < 0.5 * ring.highest_frequency():
        raise SettingError(f"steps_per_period: expected at least {ring.steps_for(omega, 1.0)} for stability, found {n}")
    return ring, n
