"""Stability from the motion in time: does a blade that starts at a solution stay there?

Harmonic balance gives a motion of ``H`` harmonics; the motion that the equations have next to it in time
(:mod:`bdamper.stability.time_integration`) has a sequence of stick, slip and separation of its own.  Two ways lead to it.

**Marching.**  The motion is started at the solution with a disturbance of :data:`KICK` in its velocities and marched.  A
damper without damping of its own chatters at many points next to separated peaks, without any period; what counts there is
the amplitude to which this leads, averaged over many periods.  The point is stable if that is within :data:`TOLERANCE` of
its own.

**Shooting.**  In a travelling wave sector ``k`` is where its neighbour ``k + s`` was ``T/N`` before (``s`` times the nodal
diameter of the wave on ``N`` sectors leaves 1 over ``N``).  So a travelling wave is a fixed point of

    P = (turn by s sectors) (march over T/N),    P^N = march over a period T,

which costs ``1/N`` of a period and knows all other disturbances of the ring as well.  Newton's method from the solution
finds the fixed point of ``(q, q', w)``, and the eigenvalues ``mu`` of its Jacobian, by differences, give the multipliers
``mu^N`` of that motion.  Sliders that do not move within a period are no part of the state.  Events fall between steps, so
multipliers are of first order in the step: within 0.01 on the shipped disk at the step used.

So growth that is too slow to show in a short march is found: a motion that seems to stay, with a multiplier outside the
unit circle, is marched until a part of the disturbance (:data:`SHARE`) would have grown to twice the tolerance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.stability.time_integration import Motion, Ring
from bdamper.stability.wave import Verdict
from bdamper.util.progress import LongWork, each

TOLERANCE = 0.05
"""Largest relative distance of the amplitude in time from that of a stable solution."""
KICK = 0.01
"""Disturbance of the velocities, relative to them."""
ACCURACY = 0.5
"""Step times the highest frequency of the closed contacts.  A fifth of it moves the amplitude of periodic motions of the
shipped disk by 0.0003 of it, their largest multiplier by up to 0.005, and that of chatter from 3.39 to 3.14."""
NEAR = 0.01
"""Multipliers within this distance of the unit circle are not trusted alone."""
SHARE = 0.02
"""Part of the disturbance that counts as lying in what grows.  At three points between folds of the shipped disk at 2 kN
nine of ten random disturbances have 0.012 to 0.021 or more there, half of them 0.07 or more."""
WINDOW = 40
"""Periods over which amplitudes are averaged at a time."""
FEWEST, MOST = 6, 25
"""Windows of a march."""
OPEN = 1e-3
"""The same over a period, where the other sliders are free; 1e-4 to 3e-4 on the shipped disk."""
ITERATIONS = 6
"""Derivatives of the map on the way to a periodic motion; between them Broyden's method, at a fifth of the price."""
DIFFERENCE = 1e-6
"""Disturbances of differences, relative to the state."""
REGULAR = 1e-3
"""Spread of the amplitudes above which a motion is irregular and has no multipliers to ask for."""
CLOSED = 1e-7
"""Change of a periodic motion over the map, relative to its size."""
STABLE, UNSTABLE, UNDECIDED = range(3)


class SectorMap:
    """March over ``T/N`` and turn: its fixed points are travelling waves, or any periodic motion of a single sector.

    Parameters
    ----------
    system : HarmonicSystem
    omega : float, rad/s
    n_blades, engine_order : int
    like : (n_unknowns,) float
        A solution nearby.
    accuracy : float
        Step times highest frequency.
    """

    def __init__(
        self, system: HarmonicSystem, omega: float, n_blades: int, engine_order: int, like: NDArray,
        accuracy: float = ACCURACY,
    ) -> None:  # fmt: skip
        self.ring = ring = Ring(system, n_blades, engine_order, like=like)
        self.omega = omega
        self.part = math.ceil(max(256, ring.steps_for(omega, accuracy)) / ring.n)
        self.steps = self.part * ring.n
        self.turn = pow(ring.wave, -1, ring.n) if ring.n > 1 else 0
        diameter = np.concatenate([np.full(s.stop - s.start, d) for d, (_, s, *_) in zip(ring.families, ring.blocks)])
        self._phase = np.exp(-2j * np.pi * diameter * self.turn / ring.n)
        self._kept = np.flatnonzero(np.concatenate([np.ones_like(ring.real), ~ring.real]))

    def __call__(self, motion: Motion) -> Motion:
        """Of one motion or a batch."""
        q, v, w = self.ring.march(motion, self.omega, self.steps, steps=self.part).motion
        return Motion(self._turned(q), self._turned(v), np.roll(w, self.turn, axis=-3))

    def _turned(self, x: NDArray) -> NDArray:
        n = self.ring.n_coordinates
        z = (x[..., :n] + 1j * x[..., n:]) * self._phase
        return np.concatenate([z.real, z.imag], axis=-1)

    def amplitude(self, motion: Motion) -> float:
        """Of the fundamental harmonic of the response over one period, m."""
        return float(abs(self.ring.march(motion, self.omega, self.steps).harmonics[0, 1]))

    def pack(self, motion: Motion, sliders: NDArray) -> NDArray:
        """(..., n) state: coordinates, velocities over omega, some of the sliders."""
        w = motion.w.reshape(*motion.w.shape[:-3], -1)[..., sliders] / self._reach
        return np.concatenate([motion.q[..., self._kept], motion.v[..., self._kept] / self.omega, w], axis=-1)

    def unpack(self, state: NDArray, like: Motion, sliders: NDArray) -> Motion:
        """The motion of a state, with the other sliders of another motion."""
        k = len(self._kept)
        q, v = (np.zeros((*state.shape[:-1], like.q.size)) for _ in range(2))
        q[..., self._kept], v[..., self._kept] = state[..., :k], state[..., k : 2 * k] * self.omega
        w = np.tile(like.w.ravel(), (*state.shape[:-1], 1))
        w[..., sliders] = state[..., 2 * k :] * self._reach
        return Motion(q, v, w.reshape(*state.shape[:-1], *like.w.shape))

    def _off(self, state: NDArray, like: Motion, sliders: NDArray) -> NDArray:
        return self.pack(self(self.unpack(state, like, sliders)), sliders) - state

    def _derivative(self, z: NDArray, small: float, like: Motion, sliders: NDArray) -> NDArray:
        """(n, n) of the map at a state, by central differences."""
        moved = small * np.eye(len(z))
        after = self.pack(self(self.unpack(np.vstack([z + moved, z - moved]), like, sliders)), sliders)
        return np.asarray((after[: len(z)] - after[len(z) :]).T / (2.0 * small))

    @property
    def _reach(self) -> float:
        """Motion of contact points by a unit of coordinates, so that sliders count like these."""
        return max(float(np.abs(basis.G).max(initial=0.0)) for basis in self.ring.system.bases)

    def periodic(self, start: Motion, moving: NDArray) -> tuple[Motion, NDArray] | None:
        """The periodic motion next to another, and its multipliers (n,) complex over a period, largest first.

        None where Newton's method does not come to one, or where other sliders move in it.

        Parameters
        ----------
        start : Motion
        moving : (n_points, 2) bool
            Sliders that move in the course of a period, those of rest aside.
        """
        sliders = np.flatnonzero(np.broadcast_to(moving, start.w.shape).ravel())
        z = self.pack(start, sliders)
        eye, size = np.eye(len(z)), float(np.abs(z).max())
        off = self._off(z, start, sliders)
        distances = [float(np.abs(off).max()) / size]
        made = since = 0
        A = eye
        while not distances[-1] <= CLOSED:
            if not distances[-1] < 1.0:
                return None
            if made == 0 or (since > 3 and distances[-1] > 0.3 * distances[-4]):
                if made == ITERATIONS:
                    return None
                try:
                    A = np.linalg.inv(eye - self._derivative(z, DIFFERENCE * size, start, sliders))
                except np.linalg.LinAlgError:
                    return None
                made, since = made + 1, 0
            step = A @ off
            z, before = z + step, off
            off = self._off(z, start, sliders)
            change = A @ (before - off)
            if change @ step != 0.0:
                A = A + np.outer(step - change, step @ A) / (step @ change)  # Broyden's update
            distances.append(float(np.abs(off).max()) / size)
            since += 1
        found = self.unpack(z, start, sliders)
        end = self.ring.march(found, self.omega, self.steps).motion
        if np.abs(self.pack(end, sliders) - z).max() > OPEN * size:
            return None
        J = self._derivative(z, DIFFERENCE * size, start, sliders)
        live = np.flatnonzero(np.abs(J).max(axis=0) > 0.0)  # a slider that is slipping or open has no memory
        values = np.linalg.eigvals(J[np.ix_(live, live)]) ** self.ring.n
        return found, values[np.argsort(-np.abs(values))]


@dataclass(frozen=True)
class InTime:
    """What is known of one point.

    Parameters
    ----------
    verdict : {STABLE, UNSTABLE, UNDECIDED}
    ratio : float
        Amplitude of the motion in time over that of the solution, averaged.
    spread : float
        Standard deviation of the amplitudes of the last periods, relative to that of the solution.
    periods : int
        That were marched, without those of shooting.
    largest : float
        Largest modulus of a multiplier of the periodic motion next to it; NaN where none was looked for or found.
    """

    verdict: int
    ratio: float
    spread: float
    periods: int
    largest: float = math.nan


def judge_in_time(
    system: HarmonicSystem, u: NDArray, omega: float, n_blades: int, engine_order: int, seed: int = 0
) -> InTime:
    """Whether the motion in time stays at a solution.

    Parameters
    ----------
    system : HarmonicSystem
    u : (n_unknowns,) float
        A solution with a response.
    omega : float, rad/s
    n_blades, engine_order : int
    seed : int
        Of the disturbance.
    """
    sector = SectorMap(system, omega, n_blades, engine_order, u)
    expected = float(np.abs(system.response(np.asarray(u)[None])[0, 1]))
    if not expected > 0.0:
        return InTime(UNDECIDED, math.nan, math.nan, 0)
    start = sector.ring.start(u, omega, sector.steps)
    found = marched(sector, disturbed(sector.ring, start, seed), expected)
    if found.verdict != STABLE or found.spread > REGULAR:
        return found
    _, _, shares = system.contact(np.asarray(u))
    periodic = sector.periodic(start, shares[:, [0, 2]] < 1.0 - 1e-12)
    if periodic is None:
        return found
    largest = float(np.abs(periodic[1]).max(initial=0.0))
    if largest > 1.0 + NEAR:
        windows = math.ceil(math.log(2.0 * TOLERANCE / (SHARE * KICK)) / math.log(largest) / WINDOW)
        if windows * WINDOW > found.periods:
            found = marched(sector, disturbed(sector.ring, start, seed), expected, windows)
    return replace(found, largest=largest)


def disturbed(ring: Ring, motion: Motion, seed: int) -> Motion:
    """The motion with random velocities added to all coordinates."""
    kick = np.random.default_rng(seed).standard_normal(motion.v.shape)
    kick[ring.n_coordinates :][ring.real] = 0.0
    return motion._replace(v=motion.v + KICK * np.linalg.norm(motion.v) / np.linalg.norm(kick) * kick)


def marched(sector: SectorMap, motion: Motion, expected: float, fewest: int = FEWEST) -> InTime:
    """March until the mean amplitude is known to be within the tolerance or not.

    It is that of the second half of the windows, uncertain by twice its standard error and the change from the first to the
    second half of these.

    Parameters
    ----------
    sector : SectorMap
    motion : Motion
    expected : float, m
        Amplitude of the solution.
    fewest : int
        Windows before anything counts as stable.
    """
    ratios: list[float] = []
    for n in range(1, MOST + 1):
        found = sector.ring.march(motion, sector.omega, sector.steps, WINDOW)
        motion = found.motion
        if sector.ring.unsolved:
            return InTime(UNDECIDED, math.nan, math.nan, n * WINDOW)
        if not np.isfinite(motion.q).all():
            return InTime(UNSTABLE, math.inf, math.inf, n * WINDOW)
        amplitudes = np.abs(found.harmonics[:, 1]) / expected
        ratios.append(float(amplitudes.mean()))
        if n < 3:
            continue
        late, spread = np.array(ratios[n // 2 :]), float(amplitudes.std())
        if np.abs(np.array(ratios[-3:]) - 1.0).min() > 3.0 * TOLERANCE:
            return InTime(UNSTABLE, ratios[-1], spread, n * WINDOW)
        off, halves = abs(late.mean() - 1.0) - TOLERANCE, np.array_split(late, 2)
        unsure = 2.0 * late.std(ddof=1) / math.sqrt(len(late)) + abs(halves[1].mean() - halves[0].mean())
        if n >= FEWEST and abs(off) > unsure and (off > 0.0 or n >= min(fewest, MOST)):
            return InTime(UNSTABLE if off > 0.0 else STABLE, float(late.mean()), spread, n * WINDOW)
    return InTime(UNDECIDED, float(late.mean()), spread, n * WINDOW)


class InTimeJudge:
    """Verdicts on points of one system for :func:`~bdamper.stability.wave.judged_along`; arguments as for these.

    After Ctrl-C every further point is undecided.

    Raises
    ------
    SettingError
        At once, if the settings describe something else than a structure in time.
    """

    def __init__(
        self, system: HarmonicSystem, unknowns: NDArray, omega: NDArray, n_blades: int, engine_order: int, progress: bool
    ) -> None:
        self.system, self.unknowns, self.omega, self.ring = system, unknowns, omega, (n_blades, engine_order)
        _ = Ring(system, n_blades, engine_order)
        self.known: dict[int, InTime] = {}
        self.interrupted = False
        self._bar = iter(each(range(len(omega)), progress, "motion in time", "point"))

    def __call__(self, i: int) -> Verdict:
        if i not in self.known:
            with LongWork() as work:
                if not self.interrupted:
                    self.known[i] = judge_in_time(self.system, self.unknowns[i], float(self.omega[i]), *self.ring, seed=i)
                    next(self._bar)
            self.interrupted |= work.interrupted
            if self.interrupted:
                return Verdict((UNDECIDED,), math.nan)
        found = self.known[i]
        return Verdict((found.verdict,), abs(found.ratio - 1.0) - TOLERANCE)

    def ratios(self, verdicts: NDArray, branch: NDArray) -> NDArray:
        """(n,) amplitude in time over that of the solution; 1 where nothing slips or opens, by interpolation between stable
        points that were judged, NaN at other points that were not judged and at those that are undecided.
        """
        out = np.ones(len(verdicts))
        judged = np.array(sorted(self.known), int)
        ratio = np.array([self.known[int(i)].ratio for i in judged])
        for b in np.unique(branch):
            own = branch[judged] == b
            inside = np.flatnonzero(branch == b)
            if own.any():
                inside = inside[(inside >= judged[own].min()) & (inside <= judged[own].max())]
                out[inside] = np.interp(inside, judged[own], ratio[own])
        out[verdicts != STABLE] = np.nan
        out[judged] = np.where(verdicts[judged] == UNDECIDED, np.nan, ratio)
        return out
