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

Central differences (velocity Verlet), whose error is of second order in the step; the step follows from the stiffest
contact.  The start is the harmonic-balance solution, so what is measured is where the motion goes from there.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from math import gcd
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED, LAW_CONSTANT, LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_CUBIC, LAW_NORMAL
from bdamper.continuation.curve import Curve
from bdamper.continuation.track import check_curve
from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.model.coupling import HarmonicBasis
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, Stopwatch
from bdamper.util.errors import SettingError
from bdamper.util.plotting import Plottable
from bdamper.util.progress import LongWork, each
from bdamper.util.repr import brief
from bdamper.util.tables import Column, Tabular

TWO_PI = 2.0 * np.pi
MOST_PERIODS = 100
"""Periods of a given motion within which sliders must settle; those of the coupled laws need many."""


@brief
@dataclass(frozen=True)
class Verification(Plottable, Tabular):
    """Settled time response beside a harmonic-balance solution.

    ``plot`` draws the last period in time and the harmonic-balance solution (:func:`bdamper.plot.plot_verification`).

    Parameters
    ----------
    frequency : float, Hz
    expected, settled : (n_harmonics + 1,) complex, m
        Response amplitudes of the solution, and of the last period in time.
    time, response : (n,) float, s and m
        The last period of the response.
    periods, steps_per_period, sectors : int
    drift : float
        Change of the response over the last period, relative to its size: zero once the motion has settled.
    cost : Cost
        Seconds for contact forces, and for the modal sums and products; an evaluation is one of all sectors.
    interrupted : bool
        Whether Ctrl-C has ended the march before all periods that were asked for.
    """

    frequency: float
    expected: NDArray
    settled: NDArray
    time: NDArray
    response: NDArray
    periods: int
    steps_per_period: int
    sectors: int
    drift: float
    cost: Cost
    interrupted: bool = False

    def columns(self) -> dict[str, Column]:
        """The last period in time, and the harmonic-balance solution at the same instants."""
        turns = np.exp(2j * np.pi * self.frequency * np.outer(self.time, np.arange(len(self.expected))))
        response, expected = Column(self.response, "m"), Column((turns @ self.expected).real, "m")
        return {"time": Column(self.time, "s"), "response": response, "expected": expected}

    @property
    def seconds(self) -> float:
        """Wall-clock time in all."""
        return self.cost.seconds

    @property
    def distance(self) -> float:
        """Distance of the vibration (all harmonics of the response besides the mean), relative to its size."""
        size = float(np.linalg.norm(self.expected[1:]))
        return float(np.linalg.norm((self.settled - self.expected)[1:])) / max(size, 1e-300)

    def __str__(self) -> str:
        ended = ", interrupted by the user" if self.interrupted else ""
        return (
            f"time integration at {self.frequency:.6g} Hz{ended}: distance {self.distance:.2e} from harmonic balance "
            f"(|X1| {abs(self.settled[1]):.6g} m, expected {abs(self.expected[1]):.6g} m); {self.periods} periods of "
            f"{self.steps_per_period} steps, {self.sectors} sectors, drift {self.drift:.1e} a period\n  {self.cost}"
        )


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


class Ring:
    """All sectors with their contacts: the equations of motion in time.

    Parameters
    ----------
    system : HarmonicSystem
        Each harmonic described by the modes of its own nodal diameter.
    n_blades, engine_order : int
    held : (n_points, 2) bool, optional
        Sliders that stay where they are, besides those of bonded points: linear springs.

    Raises
    ------
    SettingError
        If the settings describe something else than a structure in time: one basis for harmonics of several nodal
        diameters, coordinates without inertia.
    """

    def __init__(
        self,
        system: HarmonicSystem,
        n_blades: int,
        engine_order: int,
        held: NDArray | None = None,
        like: NDArray | None = None,
    ) -> None:
        arrays = system.arrays
        self.cubic = np.asarray(system.points.law) == LAW_CUBIC
        self.springs = np.concatenate([arrays["kt"], arrays["kn"][:, None]], axis=1)
        self.springs[self.cubic] = 0.0
        if like is not None and self.cubic.any():  # their largest stiffness in the cycle
            reach = np.abs(system.contact(like)[0][self.cubic, :2]).sum(axis=2)
            self.springs[self.cubic, :2] = 3.0 * arrays["kt"][self.cubic] * reach**2
        bonded = np.asarray(system.points.law)[:, None] == LAW_BONDED
        self.held = bonded if held is None else bonded | held
        if (np.asarray(arrays["mass"]) <= 0.0).any():
            raise SettingError("verify: expected inertia in every coordinate, found coordinates without")
        self.system = system
        self.cost = Cost()
        self.coupled = bool(np.isin(arrays["law"], (LAW_COUPLED, LAW_COUPLED_CONSTANT)).any())
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
                raise SettingError("verify: expected each harmonic to have the modes of its own nodal diameter")
        if self.n > 1 and len({b.nodal_diameter for b in system.bases if len(b.omega2)}) == 1 and system.n_harmonics > 0:
            orders = [l * engine_order for l in range(len(system.bases))]
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
        self.real = np.concatenate(
            [np.full(s.stop - s.start, factor == 1.0) for _, s, _, factor in self.blocks]
        )
        mass = np.concatenate([system.bases[l].mass for l, *_ in self.blocks])
        self.mass = np.tile(mass, 2)
        self.omega2 = np.concatenate([system.bases[l].omega2 for l, *_ in self.blocks]) / mass
        self.damping = np.concatenate([system.bases[l].damping for l, *_ in self.blocks]) / mass
        # one matrix from all coordinates to all points of all sectors, and back
        n_rows = 3 * system.n_points
        out = np.zeros((self.n * n_rows, start), complex)
        for l, s, phases, _ in self.blocks:
            G = np.asarray(system.bases[l].G).reshape(n_rows, -1)
            out[:, s] = (phases[:, None, None] * G).reshape(self.n * n_rows, -1)
        factors = np.concatenate([np.full(s.stop - s.start, f) for _, s, _, f in self.blocks])
        # real arithmetic: x = A [Re eta; Im eta], modal force = B F
        self.A = np.ascontiguousarray(np.hstack([out.real, -out.imag]))
        scaled = (factors / mass)[:, None] / self.n * out.conj().T
        self.B = np.ascontiguousarray(np.vstack([scaled.real, scaled.imag]))
        self.B[start:][self.real] = 0.0

    def forcing(self, omega: float, t: float) -> NDArray:
        """(2 n_coordinates,) real and imaginary modal excitation over the modal mass."""
        out = np.zeros(2 * self.n_coordinates)
        for l, s, _, _ in self.blocks:
            for harmonic in range(self.system.n_harmonics + 1):
                if self._family(harmonic)[0] != l or not len(self.system.bases[harmonic].omega2):
                    continue
                e = self.system.amplitudes(self.system.force, harmonic) * np.exp(1j * harmonic * omega * t)
                e = e.conj() if self._family(harmonic)[1] else e
                out[s] += e.real
                out[s.start + self.n_coordinates : s.stop + self.n_coordinates] += e.imag
        out[self.n_coordinates :][self.real] = 0.0
        return out / self.mass

    def _family(self, harmonic: int) -> tuple[int, bool]:
        """Harmonic whose modes describe this one, and whether it travels in the opposite direction."""
        d = (harmonic * self.wave) % self.n
        if d in self.families:
            return self.families[d], False
        return self.families[(self.n - d) % self.n], True

    def state(self, u: NDArray, omega: float, t: float) -> tuple[NDArray, NDArray]:
        """Coordinates and velocities (2 n_coordinates,) of a harmonic-balance solution at one instant."""
        q = np.zeros(self.n_coordinates, complex)
        v = np.zeros(self.n_coordinates, complex)
        where = {l: s for l, s, _, _ in self.blocks}
        for harmonic in range(self.system.n_harmonics + 1):
            if not len(self.system.bases[harmonic].omega2):
                continue
            l, reversed_ = self._family(harmonic)
            a = self.system.amplitudes(np.asarray(u), harmonic) * np.exp(1j * harmonic * omega * t)
            b = 1j * harmonic * omega * a
            q[where[l]] += a.conj() if reversed_ else a
            v[where[l]] += b.conj() if reversed_ else b
        q[self.real], v[self.real] = q[self.real].real, v[self.real].real
        return np.concatenate([q.real, q.imag]), np.concatenate([v.real, v.imag])

    def start(self, u: NDArray, omega: float, n_steps: int) -> Motion:
        """The motion of a harmonic-balance solution at t = 0, with the sliders that it leads to."""
        return Motion(*self.state(u, omega, 0.0), self.initial_slider(u, omega, n_steps))

    def contact(self, q: NDArray, w: NDArray) -> tuple[NDArray, NDArray]:
        """Modal contact force (2 n_coordinates, ...) and slider at coordinates q, timed."""
        begin = time.perf_counter()
        x = self.motion(q)
        moved = time.perf_counter()
        F, w = self.force(x, w)
        pressed = time.perf_counter()
        modal = self.B @ F.reshape(-1, *q.shape[1:])
        cost = self.cost
        self.cost = replace(
            cost,
            contact=cost.contact + pressed - moved,
            assembly=cost.assembly + moved - begin + time.perf_counter() - pressed,
            evaluations=cost.evaluations + 1,
        )
        return modal, w

    def motion(self, q: NDArray) -> NDArray:
        """(n_sectors, n_points, 3, ...) relative motion."""
        x = (self.A @ q).reshape(self.n, self.system.n_points, 3, *q.shape[1:])
        shift = self.system.points.shift
        return x + shift.reshape(shift.shape + (1,) * (q.ndim - 1))

    def force(self, x: NDArray, w: NDArray) -> tuple[NDArray, NDArray]:
        """Contact force and slider after the law was applied, for motion x and slider w before."""
        p = self.system.points
        extra = (1,) * (x.ndim - 3)
        kt, kn = p.kt.reshape(p.kt.shape + extra), p.kn.reshape(p.kn.shape + extra)
        n0, law = p.n0.reshape(p.n0.shape + extra), np.asarray(p.law).reshape(p.kn.shape + extra)
        mu = np.where(law == LAW_NORMAL, 0.0, p.mu.reshape(p.mu.shape + extra))
        constant = (law == LAW_CONSTANT) | (law == LAW_COUPLED_CONSTANT)
        normal = n0 + kn * x[:, :, 2]
        normal = np.where(constant | (law == LAW_BONDED), normal, np.maximum(normal, 0.0))
        load = p.n0 if p.load is None else p.load
        reach = mu * np.where(constant, np.maximum(load, 0.0).reshape(p.n0.shape + extra), normal)
        u = x[:, :, :2]
        limit = np.where(kt > 0.0, reach[:, :, None] / np.where(kt > 0.0, kt, 1.0), 0.0)
        moved = np.clip(w, u - limit, u + limit)
        if self.coupled:
            pull = kt * (u - w)
            size = np.sqrt((pull**2).sum(axis=2))
            share = np.where(size > reach, reach / np.where(size > 0.0, size, 1.0), 1.0)
            coupled = ((law == LAW_COUPLED) | (law == LAW_COUPLED_CONSTANT))[:, None]
            moved = np.where(coupled & (kt > 0.0), u - share[:, :, None] * (u - w), moved)
        w = np.where(self.held.reshape(self.held.shape + extra), w, moved)
        F = np.concatenate([kt * (u - w), normal[:, :, None]], axis=2)
        F[:, self.cubic, :2] = kt[self.cubic] * u[:, self.cubic] ** 3
        return F, w

    def highest_frequency(self) -> float:
        """rad/s, with every contact closed and stuck."""
        k = np.tile(self.springs.ravel(), self.n)
        stiffness = np.diag(np.tile(self.omega2, 2)) + self.B @ (k[:, None] * self.A)
        return float(np.sqrt(np.abs(np.linalg.eigvals(stiffness)).max()))

    def steps_for(self, omega: float, accuracy: float = 0.1) -> int:
        """Steps per period, so that ``step * highest frequency`` stays below ``accuracy`` (2 is the limit of stability)."""
        return int(np.ceil(TWO_PI / omega * self.highest_frequency() / accuracy / 64.0)) * 64

    def initial_slider(self, u: NDArray, omega: float, n_steps: int) -> NDArray:
        """Sliders at t = 0 of the solution: its motion marched over periods from the given ones until they settle."""
        p = self.system.points
        w = np.tile(p.slider, (self.n, 1, 1)).astype(float)
        times = np.arange(n_steps) * (TWO_PI / omega / n_steps)
        x = [self.motion(self.state(u, omega, t)[0]) for t in times]
        size = max(float(np.abs(np.ptp(np.array(x)[:, :, :, :2], axis=0)).max()), 1e-300)
        for _ in range(MOST_PERIODS if self.coupled else 2):
            before = w
            for now in x:
                _, w = self.force(now, w)
            if np.abs(w - before).max() <= 1e-9 * size:
                break
        _, w = self.force(x[0], w)
        return w

    def march(
        self, q: NDArray, v: NDArray, w: NDArray, omega: float, n_steps: int, n_periods: int, row: NDArray | None = None
    ) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Integrate whole periods; q, v (2 n_coordinates, ...), w (n_sectors, n_points, 2, ...).

        Returns
        -------
        q, v, w at the end, and the response ``row @ q`` at every step (empty without a row).
        """
        h = TWO_PI / omega / n_steps
        column = (slice(None),) + (None,) * (q.ndim - 1)
        forcing = np.array([self.forcing(omega, k * h) for k in range(n_steps)])
        omega2 = np.tile(self.omega2, 2)[column]
        damping = np.tile(self.damping, 2)[column]
        pressed, w = self.contact(q, w)
        a = forcing[0][column] - omega2 * q - damping * v - pressed
        response = []
        for k in range(n_steps * n_periods):
            if row is not None:
                response.append(row @ q)
            half = v + 0.5 * h * a
            q = q + h * half
            pressed, w = self.contact(q, w)
            rest = forcing[(k + 1) % n_steps][column] - omega2 * q - pressed
            v = (half + 0.5 * h * rest) / (1.0 + 0.5 * h * damping)
            a = rest - damping * v
        return q, v, w, np.array(response)

    def response_row(self) -> NDArray:
        """(2 n_coordinates,) row of the response on the reference sector."""
        out = np.zeros(2 * self.n_coordinates)
        for l, s, _, _ in self.blocks:
            r = np.asarray(self.system.response_rows[l], complex)
            out[s] = r.real
            out[s.start + self.n_coordinates : s.stop + self.n_coordinates] = -r.imag
        return out


def _same_basis(a: HarmonicBasis, b: HarmonicBasis, conjugate: bool) -> bool:
    """Whether two harmonics have the same modes at the contact points, those of the second conjugated if asked for."""
    Ga, Gb = np.asarray(a.G), np.asarray(b.G)
    if Ga.shape != Gb.shape:
        return False
    Gb = Gb.conj() if conjugate else Gb
    return bool(np.allclose(Ga, Gb, rtol=1e-12, atol=1e-12 * np.abs(Ga).max(initial=0.0)))


def amplitudes_of(response: NDArray, n_harmonics: int) -> NDArray:
    """(n_harmonics + 1,) complex amplitudes of one period, sampled at equal steps from its start."""
    n = len(response)
    out = 2.0 / n * np.exp(-1j * np.outer(np.arange(n_harmonics + 1), TWO_PI * np.arange(n) / n)) @ response
    out[0] *= 0.5
    return np.asarray(out)


def ring_and_steps(
    system: HarmonicSystem,
    omega: float,
    n_blades: int,
    engine_order: int,
    steps: int | None,
    accuracy: float,
    like: NDArray | None = None,
) -> tuple[Ring, int]:
    """What is marched, and the steps per period: those given, or such that step times highest frequency is ``accuracy``.

    Cubic springs are as stiff as in the solution ``like``, if one is given.

    Raises
    ------
    SettingError
        If the steps that are given are too few for a stable march.
    """
    ring = Ring(system, n_blades, engine_order, like=like)
    n = max(256, ring.steps_for(omega, accuracy))
    if steps is not None:
        n = validate.whole("steps_per_period", steps, least=1)
    if n * omega / TWO_PI < 0.5 * ring.highest_frequency():
        raise SettingError(f"steps_per_period: expected at least {ring.steps_for(omega, 1.0)} for stability, found {n}")
    return ring, n


def verify_solution(
    system: HarmonicSystem,
    u: NDArray,
    omega: float,
    n_blades: int,
    engine_order: int,
    *,
    periods: int = 100,
    steps_per_period: int | None = None,
    progress: bool = False,
) -> Verification:
    """March from a harmonic-balance solution and compare the last period with it.

    Parameters
    ----------
    system : HarmonicSystem
    u : (n_unknowns,) float
    omega : float, rad/s
    n_blades, engine_order : int
    periods : int
    steps_per_period : int, optional
        By default such that the step resolves the stiffest contact.
    progress : bool
        Show a bar of the periods.

    Returns
    -------
    Verification
        After Ctrl-C that of the periods marched by then.
    """
    periods = validate.whole("periods", periods, least=1)
    watch = Stopwatch()
    ring, n = ring_and_steps(system, omega, n_blades, engine_order, steps_per_period, 0.1, u)
    motion = ring.start(u, omega, n)
    row = ring.response_row()
    marched = 0
    with LongWork() as work:
        for marched, _ in enumerate(each(range(periods - 1), progress, "marching", "period")):
            *state, _ = ring.march(*motion, omega, n, 1)
            motion = Motion(*state)
        marched = periods - 1
    if work.interrupted and not marched:
        raise KeyboardInterrupt
    *state, response = ring.march(*motion, omega, n, 1, row)
    expected = np.asarray(system.response(np.asarray(u)[None])[0])
    size = max(float(np.abs(response).max()), 1e-300)
    return Verification(
        frequency=omega / TWO_PI,
        expected=expected,
        settled=amplitudes_of(response, system.n_harmonics),
        time=TWO_PI / omega * np.arange(n) / n,
        response=response,
        periods=marched + 1,
        steps_per_period=n,
        sectors=ring.n,
        drift=float(abs(row @ (state[0] - motion.q))) / size,
        cost=replace(ring.cost, **watch.read()),
        interrupted=work.interrupted,
    )


@one_thread
def verify(
    problem: Problem,
    curve: Curve,
    index: int | None = None,
    *,
    periods: int = 100,
    steps_per_period: int | None = None,
    progress: bool = False,
) -> Verification:
    """March in time from a point of a tracking curve and compare where the motion settles.

    All sectors take part, each with its own contacts; no Fourier series is cut off, no travelling wave assumed
    (:mod:`bdamper.stability.time_integration`).  A period takes some ten thousand steps: seconds on a reference bladed
    disk, so that the default of 100 takes minutes.

    Parameters
    ----------
    problem : Problem
    curve : Curve
        Tracked with this problem.
    index : int, optional
        Of the point; the largest response by default.
    periods : int
        Periods of the excitation to march.
    steps_per_period : int, optional
        By default what the stiffest contact asks for.
    progress : bool
        Show a bar of the periods, with the time left.

    Returns
    -------
    Verification
        After Ctrl-C that of the periods marched by then.
    """
    problem = problem.matching(validate.instance("curve", curve, Curve, "a tracking curve").settings)
    check_curve(problem, curve)
    i = curve.peak.index if index is None else validate.whole("index of a point", index, -len(curve), len(curve) - 1)
    return verify_solution(
        problem.system(curve.preload),
        curve.unknowns[i],
        2.0 * np.pi * float(curve.frequency[i]),
        problem.model.n_blades,
        int(problem.engine_order),
        periods=periods,
        steps_per_period=steps_per_period,
        progress=progress,
    )
