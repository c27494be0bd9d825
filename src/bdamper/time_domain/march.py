"""One march in time, and one verdict on what comes of it.

A :class:`March` starts from a state, the motion of a harmonic-balance solution or the end of another march, and goes on in
whole turns of the excitation.  Each turn ``k`` has response amplitudes of its own,

    X_l(k) = 2/T int_kT^(k+1)T x(t) exp(-i l omega t) dt        (half of that for l = 0),

and all that is said of a motion in time is said of these, by one set of bounds (:data:`BOUNDS`):

* :func:`judged`: whether the motion keeps to an amplitude (*agrees*) or leaves it (*does not agree*: it falls to another
  level, grows, or beats), or whether that needs more turns (*undecided*);
* :func:`to_come`: what the slowest transient still adds to the mean;
* :func:`repeats_after`: whether the motion is periodic, subharmonic, or irregular.

After every 16 periods :func:`judged` looks whether one of these holds:

* **Left.**  Farther than twice the tolerance in each of the last 32 periods, and the last 16 no nearer than the 16 before:
  the motion does not agree.
* **Settled.**  The mean of 16 periods has changed by less than 1 % within 80 periods, and no faster in their second half
  than in the first.  It agrees if the mean of these 80 is within the tolerance, and nine periods of ten within twice that;
  what the slowest mode may still add must not change the answer.
* **Wanders.**  Farther than that in the last 80 periods, and both the largest distance and the range are larger than the
  slowest mode leaves of those in the 80 before: it does not agree.

The march itself is that of ``bdamper.time_domain.integration.Ring``, the only place that knows its kernel.  Friction and
closed contacts give no more energy than their springs hold, so the energy of a motion is at most what it began with and
was given by the excitation.  Steps that are too long for the contacts break this: the march ends where a motion has more
than :attr:`Bounds.gain` times as much.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.time_domain.integration import STEPS, MarchFailed, Motion, Ring
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.progress import LongWork, progress_counter, raise_if_stopped

AGREES, DIFFERS, UNDECIDED = "agrees", "does not agree", "undecided"


@dataclass(frozen=True)
class Bounds:
    """What every verdict on a motion in time goes by; 50 points (docs/measured.md, *Labels in time and long marches*) are
    judged as marches of up to 960 periods end.

    Parameters
    ----------
    tolerance : float
        Largest relative distance of the amplitude in time from that of a solution that it keeps.
    look : int
        Periods between two looks, and those over which a mean is taken.
    settled : int
        Periods over which a settled amplitude changes by less than ``drift``.
    drift : float
        Relative change of a mean, had or to come, below which it has settled.
    repeats : float
        Relative change over a period below which a motion repeats: 1e-4 to 3e-4 for periodic ones between folds.
    most_repeated : int
        Largest number of periods after which a repetition is looked for.
    most : int
        Periods of a march that nothing decides; the 50 points take at most 336.
    steps : int
        Of a period: with 256 chatter in slip is damped away, and a motion that falls to 0.855 of a solution keeps to it;
        512 leave 0.89 of it, 1,024 leave 0.860.
    gain : float
        Energy of a motion, relative to what it can have, from which on its steps have failed.
    """

    tolerance: float = 0.05
    look: int = 16
    settled: int = 80
    drift: float = 0.01
    repeats: float = 1e-3
    most_repeated: int = 4
    most: int = 1000
    steps: int = 1024
    gain: float = 4.0


BOUNDS = Bounds()


class March:
    """A structure marched in time, turn by turn of the excitation.

    Parameters
    ----------
    ring : Ring
    omega : float, rad/s
    start : (n_unknowns,) float or Motion
        A harmonic-balance solution, of whatever frequency, or where another march has ended.
    steps : int, optional
        Per period; :data:`~bdamper.time_domain.integration.STEPS` by default.
    blade : int, optional
        Whose amplitude is asked for; by default that of which the mean over the second half of the periods is highest.

    Attributes
    ----------
    motion : Motion
        Where it has come to.
    harmonics : list of (n_blades, n_harmonics + 1) complex, m
        Response amplitudes of all blades in each turn; the first is the mean.
    energy : list of (4,) float, J
        Of each turn (:class:`~bdamper.time_domain.integration.TimeResponse`).
    memory : float
        Periods in which a transient of the least damped mode falls to 1/e; of free bodies contacts take energy alone.

    Raises
    ------
    SettingError
        If the motion to start from is one of another structure, or there are too few steps.
    """

    def __init__(
        self, ring: Ring, omega: float, start: NDArray | Motion, steps: int | None = None, blade: int | None = None
    ) -> None:
        self.steps = STEPS if steps is None else validation.integer("steps_per_period", steps, least=16)
        self.ring, self.omega, self._blade = ring, omega, blade
        if isinstance(start, Motion):
            own = ring.system.structure.points.own
            width = 2 if own is None else 2 + own.width
            shapes = (2 * ring.n_coordinates,), (ring.n, ring.system.n_points, width)
            if (start.q.shape, start.w.shape) != shapes:
                raise SettingError(
                    f"start: expected a motion of this study, {shapes[0]} coordinates and {shapes[1]} sliders, found "
                    f"{start.q.shape} and {start.w.shape}"
                )
        self.motion = start if isinstance(start, Motion) else ring.start(start, omega, self.steps)
        self.harmonics: list[NDArray] = []
        self.energy: list[NDArray] = []
        self.memory = float(omega / (np.pi * max(ring.least_damping, 1e-9 * omega)))
        self._held = self._given = ring.energy(self.motion)

    @property
    def blades(self) -> NDArray:
        """(n_periods, n_blades) complex: harmonic of the excitation of all blades, m."""
        return np.array(self.harmonics)[:, :, 1]

    @property
    def response(self) -> NDArray:
        """(n_periods, n_harmonics + 1) complex response of that blade, m, with the phases of the first blade."""
        turn = 2.0 * np.pi * self.blade * self.ring.wave / self.ring.n
        own = np.array(self.harmonics)[:, self.blade]
        return np.asarray(own * np.exp(-1j * turn * np.arange(own.shape[1])))

    @property
    def blade(self) -> int:
        """The blade whose amplitude is asked for, or the highest."""
        if self._blade is not None:
            return self._blade
        return int(np.abs(second_half(self.blades)).mean(axis=0).argmax())

    @property
    def amplitude(self) -> NDArray:
        """(n_periods,) amplitude of the harmonic of the excitation of that blade, m."""
        return np.abs(self.response[:, 1])

    def turn(self, turns: int = 1, ends: tuple[float, float] | None = None) -> None:
        """March some turns; the frequency goes linearly in time from one end (rad/s) to the other, if they are given.

        Raises
        ------
        MarchFailed
            If the contact forces of a step are not found, or the motion has more energy than it can have.
        """
        raise_if_stopped()
        begin, end = ends or (self.omega, None)
        marched = self.ring.integrate(self.motion, begin, self.steps, turns, omega_end=end)
        self.motion = marched.motion
        self.harmonics.extend(marched.harmonics)
        self.energy.extend(marched.energy)
        for work, damping, _, rise in marched.energy:
            self._held, self._given = self._held + rise, self._given + abs(work) + abs(damping)
            if not self._held <= BOUNDS.gain * self._given:
                raise MarchFailed(
                    f"the march gains energy near {begin / (2.0 * np.pi):.6g} Hz, an error of its steps: raise "
                    f"steps_per_period, {self.steps} now"
                )

    def run(self, periods: int, progress: bool = False, decided: Callable[[], bool] | None = None) -> bool:
        """March until that many periods are there, or it is decided at one of the looks.

        Returns
        -------
        bool
            Whether Ctrl-C has ended it.
        """
        with LongWork() as work, progress_counter(progress, periods, 0, "marching", "period") as count:
            while len(self.harmonics) < periods:
                self.turn()
                count()
                if decided is not None and len(self.harmonics) % BOUNDS.look == 0 and decided():
                    break
        return work.interrupted

    def sweep(self, ends: tuple[float, float], turns: int, count: Callable[[], Any]) -> None:
        """March turns over which the square of the frequency goes linearly in the angle between two ends (rad/s)."""
        square = np.linspace(ends[0] ** 2, ends[1] ** 2, turns + 1)
        for first in range(0, turns, BOUNDS.look):
            last = min(first + BOUNDS.look, turns)
            self.turn(last - first, (float(np.sqrt(square[first])), float(np.sqrt(square[last]))))
            for _ in range(last - first):
                count()


def judged(amplitude: NDArray, expected: float, tolerance: float, memory: float) -> tuple[str, str]:
    """Verdict and reason from the amplitudes (n_periods,) marched so far; "undecided" asks for more of them.

    Parameters
    ----------
    amplitude : (n_periods,) float, m
    expected : float, m
    tolerance : float
    memory : float
        Periods in which a transient of the least damped mode falls to 1/e.
    """
    look, span = BOUNDS.look, BOUNDS.settled
    off = amplitude / max(expected, 1e-300) - 1.0
    n = len(off)
    last = float(off[-look:].mean())
    if n < 3 * look:
        return UNDECIDED, f"{100.0 * last:+.2g} % in the mean of {min(n, look)} periods; at least {3 * look} decide"
    away = np.abs(off[-2 * look :])
    if (away > 2.0 * tolerance).all() and abs(last) >= abs(float(off[-2 * look : -look].mean())):
        return DIFFERS, f"{100.0 * last:+.2g} %, and no way back within {look} periods"
    if n < span + look:
        return UNDECIDED, f"{100.0 * last:+.2g} % so far; {span + look} periods show whether it has settled"
    then, between, now = (float(off[n - k - look : n - k].mean()) for k in (span, span // 2, 0))
    drift = (now - then) / max(1.0 + then, 1e-300)
    grows = abs(now - between) > max(1.2 * abs(between - then), 0.1 * BOUNDS.drift)
    recent, earlier = off[-span:], off[-2 * span : -span]
    stays = float(np.quantile(np.abs(recent), 0.9)) <= 2.0 * tolerance
    within = abs(float(recent.mean())) <= tolerance
    spread = f"{100.0 * recent.min():+.2g} to {100.0 * recent.max():+.2g} %"
    settled = abs(drift) < BOUNDS.drift and not grows
    if settled and (not stays or within == (abs(last + to_come(amplitude, memory)) <= tolerance)):
        shown = f", {spread}" if np.ptp(recent) > BOUNDS.drift else ""
        text = f"{100.0 * float(recent.mean()):+.2g} % in the mean of {span} periods{shown}"
        return AGREES if stays and within else DIFFERS, text
    sizes, before = (np.array([np.abs(x).max(), np.ptp(x)]) for x in (recent, earlier))
    if n >= 2 * span and not stays and (sizes > min(1.0, 1.1 * np.exp(-span / memory)) * before).all():
        return DIFFERS, f"wanders, {spread} within {span} periods"
    return UNDECIDED, (
        f"{100.0 * last:+.2g} %, changed by {100.0 * drift:+.2g} % within {span} periods; a transient takes "
        f"{memory:.3g} periods to fall to 1/e"
    )


def second_half(x: NDArray) -> NDArray:
    """Of the periods: those from which means and ranges are taken."""
    return x[len(x) // 2 :]


def to_come(amplitude: NDArray, memory: float) -> float:
    """Relative change of the mean that is still to come.

    The means of the last two quarters differ by a transient that falls to 1/e in so many periods: one that falls by a
    factor p from one quarter to the next still changes the mean by p/(1 - p) of the difference.
    """
    before, last = np.array_split(second_half(amplitude), 2)
    change = float((last.mean() - before.mean()) / max(float(last.mean()), 1e-300))
    left = np.exp(-len(last) / memory)
    return change * left / (1.0 - left)


def repeats_after(harmonics: NDArray) -> int | None:
    """Least number of periods after which the amplitudes (n_periods, n_harmonics + 1) repeat, over the last quarter."""
    x = harmonics[:, 1:]
    last = np.arange(len(x) - max(1, len(x) // 4), len(x))
    size = max(float(np.linalg.norm(x[last], axis=1).max()), 1e-300)
    for n in range(1, BOUNDS.most_repeated + 1):
        if last[0] >= n and np.linalg.norm(x[last] - x[last - n], axis=1).max() <= BOUNDS.repeats * size:
            return n
    return None
