"""Stability from the motion in time: does a blade that starts at a solution stay there?

Harmonic balance gives a motion of ``H`` harmonics; the motion that the equations have next to it in time
(:mod:`bdamper.stability.time_integration`) has a sequence of stick, slip and separation of its own.  Two ways lead to it.

**Marching.**  The motion is started at the solution with a disturbance of :data:`KICK` in its velocities and marched until
``bdamper.stability.march.judged`` decides.  A damper without damping of its own chatters at many points next to
separated peaks, without any period; what counts there is the amplitude to which this leads, averaged over many periods.

**Shooting.**  In a travelling wave sector ``k`` is where its neighbour ``k + s`` was ``T/N`` before (``s`` times the nodal
diameter of the wave on ``N`` sectors leaves 1 over ``N``).  So a travelling wave is a fixed point of

    P = (turn by s sectors) (march over T/N),    P^N = march over a period T,

which costs ``1/N`` of a period and knows all other disturbances of the ring as well.  Newton's method from the solution
finds the fixed point of ``(q, q', w)``, and the eigenvalues ``mu`` of its Jacobian, by differences, give the multipliers
``mu^N`` of that motion.  Sliders that do not move within a period are no part of the state.  Events fall between steps, so
multipliers are of first order in the step: within 0.01 at the step used.

So growth that is too slow to show in a short march is found: a motion that seems to stay, with a multiplier outside the
unit circle, is marched until a part of the disturbance (:data:`SHARE`) would have grown to twice the tolerance, if that
comes within the longest march.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.stability.march import AGREES, BOUNDS, DIFFERS, UNDECIDED, March
from bdamper.stability.time_integration import STEPS, Motion, Ring
from bdamper.stability.wave import Verdict
from bdamper.util.progress import LongWork, each

KICK = 0.01
"""Disturbance of the velocities, relative to them."""
SHARE = 0.02
"""Part of the disturbance that counts as lying in what grows.  At three points between folds nine of ten random
disturbances have 0.012 to 0.021 or more there, half of them 0.07 or more."""
FEWEST = 3 * BOUNDS.settled
"""Periods of any march; after 160 of them the means of three motions that leave were 0.70, 0.77 and 1.01 of the solution
that come to 0.41, 0.38 and 0.41."""
EXACT = 1e-11
"""Residual of the contact forces in a map of which differences are taken."""
DIFFERENCE = 1e-6
"""Disturbances of differences, relative to the state."""
CLOSED = 1e-7
"""Change of a periodic motion over the map, relative to its size."""


class SectorMap:
    """March over ``T/N`` and turn: its fixed points are travelling waves, or any periodic motion of a single sector.

    Parameters
    ----------
    ring : Ring
    omega : float, rad/s
    steps : int
        Of a period, at least.
    """

    def __init__(self, ring: Ring, omega: float, steps: int = STEPS) -> None:
        self.ring, self.omega, self.part = ring, omega, math.ceil(steps / ring.n)
        self.steps = self.part * ring.n
        self.turn = pow(ring.wave, -1, ring.n) if ring.n > 1 else 0
        diameter = np.concatenate([np.full(s.stop - s.start, d) for d, (_, s, *_) in zip(ring.families, ring.blocks)])
        self._phase = np.exp(-2j * np.pi * diameter * self.turn / ring.n)
        self._kept = np.flatnonzero(np.concatenate([np.ones_like(ring.real), ~ring.real]))
        # motion of contact points by a unit of coordinates, so that sliders count like these
        self._reach = max(float(np.abs(basis.G).max(initial=0.0)) for basis in ring.system.bases)

    def __call__(self, motion: Motion) -> Motion:
        """Of one motion or a batch."""
        q, v, w, _ = self.ring.march(motion, self.omega, self.steps, steps=self.part, tolerance=EXACT).motion
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

    def linearised(self, motion: Motion, moving: NDArray, difference: float = DIFFERENCE) -> tuple[NDArray, NDArray]:
        """Derivative (n, n) of the map at a motion, and the change (n,) of that; other sliders stay out of the state."""
        sliders = np.flatnonzero(np.broadcast_to(moving, motion.w.shape).ravel())
        z = self.pack(motion, sliders)
        return self._derivative(z, difference * np.abs(z).max(), motion, sliders), self._off(z, motion, sliders)

    def periodic(self, start: Motion, moving: NDArray) -> tuple[Motion, NDArray] | None:
        """The periodic motion next to another, and its multipliers (n,) complex over a period, largest first.

        None where Powell's method does not come to one, or where other sliders move in it.

        Parameters
        ----------
        start : Motion
        moving : (n_points, 2) bool
            Sliders that move in the course of a period, those of rest aside.
        """
        sliders = np.flatnonzero(np.broadcast_to(moving, start.w.shape).ravel())
        z = self.pack(start, sliders)
        eye, size = np.eye(len(z)), float(np.abs(z).max())
        solved = root(
            lambda z: self._off(z, start, sliders), z, method="hybr", options={"xtol": CLOSED},
            jac=lambda z: self._derivative(z, DIFFERENCE * size, start, sliders) - eye,
        )  # fmt: skip
        if not np.abs(solved.fun).max() <= CLOSED * size:
            return None
        found, z = self.unpack(solved.x, start, sliders), solved.x
        end = self.ring.march(found, self.omega, self.steps).motion
        if np.abs(self.pack(end, sliders) - z).max() > BOUNDS.repeats * size:
            return None
        J, _ = self.linearised(found, moving)
        live = np.flatnonzero(np.abs(J).max(axis=0) > 0.0)  # a slider that is slipping or open has no memory
        values = np.linalg.eigvals(J[np.ix_(live, live)]) ** self.ring.n
        return found, values[np.argsort(-np.abs(values))]


@dataclass(frozen=True)
class InTime:
    """What is known of one point.

    Parameters
    ----------
    verdict : {"agrees", "does not agree", "undecided"}
    ratio : float
        Amplitude of the motion in time over that of the solution, averaged.
    spread : float
        Standard deviation of the amplitudes of the last periods, relative to that of the solution.
    periods : int
        That were marched, without those of shooting.
    largest : float
        Largest modulus of a multiplier of the periodic motion next to it; NaN where none was looked for or found.
    """

    verdict: str
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
    sector = SectorMap(Ring(system, n_blades, engine_order), omega, BOUNDS.steps)
    expected = float(np.abs(system.response(np.asarray(u)[None])[0, 1]))
    if not expected > 0.0:
        return InTime(UNDECIDED, math.nan, math.nan, 0)
    start = sector.ring.start(u, omega, sector.steps)
    found = marched(sector, disturbed(sector.ring, start, seed), expected)
    if found.verdict != AGREES or found.spread > BOUNDS.repeats:
        return found
    _, _, shares = system.contact(np.asarray(u))
    periodic = sector.periodic(start, shares[:, [0, 2]] < 1.0 - 1e-12)
    if periodic is None:
        return found
    largest = float(np.abs(periodic[1]).max(initial=0.0))
    if largest > 1.0:  # asked only of what grows within a march
        periods = math.ceil(math.log(2.0 * BOUNDS.tolerance / (SHARE * KICK)) / math.log(largest))
        if found.periods < periods <= BOUNDS.most:
            found = marched(sector, disturbed(sector.ring, start, seed), expected, periods)
    return replace(found, largest=largest)


def disturbed(ring: Ring, motion: Motion, seed: int) -> Motion:
    """The motion with random velocities added to all coordinates."""
    kick = np.random.default_rng(seed).standard_normal(motion.v.shape)
    kick[ring.n_coordinates :][ring.real] = 0.0
    return motion._replace(v=motion.v + KICK * np.linalg.norm(motion.v) / np.linalg.norm(kick) * kick)


def marched(sector: SectorMap, start: Motion, expected: float, fewest: int = FEWEST) -> InTime:
    """March until it is clear whether the motion keeps to an amplitude.

    Parameters
    ----------
    sector : SectorMap
    start : Motion
    expected : float, m
        Amplitude of the solution.
    fewest : int
        Periods of the march at least.
    """
    march = March(sector.ring, sector.omega, start, sector.steps)
    if march.until_judged(expected, fewest=fewest):
        raise KeyboardInterrupt
    verdict, _ = march.judged(expected)
    late = march.amplitude[-BOUNDS.settled :] / expected
    return InTime(verdict, float(late.mean()), float(late.std()), len(march.harmonics))


COUNTS = {verdict: i for i, verdict in enumerate((AGREES, DIFFERS, UNDECIDED))}
"""Verdicts as numbers of growing disturbances."""


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
                return Verdict((COUNTS[UNDECIDED],), math.nan)
        found = self.known[i]
        return Verdict((COUNTS[found.verdict],), abs(found.ratio - 1.0) - BOUNDS.tolerance)

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
        out[verdicts != COUNTS[AGREES]] = np.nan
        out[judged] = np.where(verdicts[judged] == COUNTS[UNDECIDED], np.nan, ratio)
        return out
