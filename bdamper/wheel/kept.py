"""Whether a blade of a wheel keeps its peak: all blades and dampers marched in time as one structure.

The march is that of a sector (:mod:`bdamper.stability.time_integration`), of which the whole wheel is a single one: its
coordinates are the modes of blades and disk with all deviations, and the coordinates of all dampers.  It starts at the peak
itself, with dampers free, and what counts as staying is what does for a sector (:mod:`bdamper.stability.kept`).  Damping is
that of each mode of the wheel by itself: what couples them is at most 2.1 % of it for lumped blades with deviations of 5 %.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import tau

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.model.coupling import HarmonicBasis
from bdamper.stability.kept import RULES, stay
from bdamper.stability.march import March
from bdamper.stability.time_integration import STEPS, Ring
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Stopwatch
from bdamper.util.errors import SettingError
from bdamper.util.kept import Kept
from bdamper.util.plotting import Fact, Plottable
from bdamper.util.repr import brief
from bdamper.util.status import COMPLETE, NOT_FOUND, because
from bdamper.util.text import amount
from bdamper.wheel.results import WheelPeak
from bdamper.wheel.system import WheelSystem
from bdamper.wheel.wheel_problem import WheelProblem

MOST_BLADES = 13
"""Of a wheel that is marched: what a period takes grows with the third power of them (docs/measured.md, "Peaks of unequal
wheels")."""


@brief
@dataclass(frozen=True)
class WheelKept(Kept, Plottable, kind="bdamper-wheel-kept"):
    """What the highest blade of a wheel keeps of its peak.

    ``plot`` draws bars over the blades (:func:`bdamper.plot.plot_wheel_kept`).

    Parameters
    ----------
    blade : int
        That of the peak, whose amplitudes ``mean``, ``lowest`` and ``highest`` are.
    blades : (n_periods, n_blades) float, m
        Amplitudes of all blades in periods behind the last of these.
    """

    blade: int = -1
    blades: NDArray = field(default_factory=lambda: np.zeros((0, 0)))

    def facts(self) -> tuple[Fact, ...]:
        """Which blade it is, and what it keeps."""
        return (Fact("blade", self.blade), *super().facts())


class OneStructure:
    """A wheel as one structure in time.

    Parameters
    ----------
    system : WheelSystem
    blade : int
        Whose motion is the response.
    """

    def __init__(self, system: WheelSystem, blade: int) -> None:
        s, N, (_, n_coef, size) = system.structure, system.shape[0], system.shape
        n, nd, every = s.n, s.n_damper, np.arange(N)

        def whole(own: NDArray | float, waves: NDArray) -> NDArray:
            out, first = np.zeros((N, n, N, n)), n - waves.shape[1]
            out[:, first:, :, first:] = np.fft.ifft(waves, axis=0).real[(every[:, None] - every) % N].transpose(0, 2, 1, 3)
            out[every, :, every] += own
            return out.reshape(N * n, N * n)

        mass = whole(s.mass, s.disk_mass)
        squares, phi = scipy.linalg.eigh(whole(s.stiffness, s.disk_stiffness), mass)
        damping = np.einsum("ik,ik->k", phi, whole(0.0, s.damping) @ phi)
        self.system, self.modes = system, np.zeros((N, size, N * size))
        self.modes[:, :n, : N * n] = phi.reshape(N, n, -1)
        self.modes[:, n:, N * n :] = np.eye(N * nd).reshape(N, nd, -1)
        self.inverse = self.modes.copy()
        self.inverse[:, :n, : N * n] = (mass @ phi).reshape(N, n, -1)
        motion = np.stack([s.motion(x) for x in self.modes.transpose(2, 0, 1)], axis=-1)
        basis = HarmonicBasis(
            (), np.append(squares, np.tile(s.damper_stiffness, N)), np.zeros(N * size), motion.reshape(-1, 3, N * size), 0,
            np.append(np.ones(N * n), s.damper_mass), np.append(damping, np.tile(s.damper_damping, N)),
        )  # fmt: skip
        self.rows = np.einsum("i,bik->bk", system.response_row, self.modes[:, :n])
        force = self._taken(system.force, self.modes)
        one = HarmonicSystem([basis] * (n_coef // 2 + 1), system.points, force, [self.rows[blade]] * (n_coef // 2 + 1))
        self.ring = Ring(one, 1, 0)

    def _taken(self, u: NDArray, rows: NDArray) -> NDArray:
        """Coefficients (n_blades, n_coefficients, n_sector) times rows (n_blades, n_sector, n_modes), as unknowns."""
        return np.asarray(np.tensordot(self.system.array(u).transpose(1, 0, 2), rows, 2).ravel())

    def start(self, u: NDArray) -> NDArray:
        """Unknowns of the one structure from those of the wheel."""
        return self._taken(u, self.inverse)

    def amplitudes(self, march: March, periods: int) -> NDArray:
        """(periods, n_blades) amplitudes of all blades while a march goes on."""
        turn, out, motion = 2.0 / march.steps * np.exp(-1j * tau * np.arange(march.steps) / march.steps), [], march.motion
        for _ in range(periods):
            done = self.ring.march(motion, march.omega, march.steps, trace=True)
            motion = done.motion
            out.append(np.abs(turn @ done.trace[:, : self.ring.n_coordinates] @ self.rows.T))
        return np.array(out)


@one_thread
def kept(wheel: WheelProblem, peak: WheelPeak, *, steps_per_period: int | None = None) -> WheelKept:
    """Whether the highest blade keeps its peak, by a march of all blades that starts there.  Ctrl-C leaves no result.

    Parameters
    ----------
    wheel : Wheel
    peak : WheelPeak
        Of this wheel; its dampers are free in time, also where springs have held them.
    steps_per_period : int, optional
        256 by default; a motion that stays is marched again with twice as many.

    Returns
    -------
    WheelKept
        "not found" where the blade falls, to another level or none, or grows, or where contact forces were not found in a
        step: the amplitudes are NaN, the status says where it comes to, and ``blades`` has those of all.

    Raises
    ------
    SettingError
        If the wheel has more than thirteen blades, or the peak is of another wheel or not found.
    """
    watch, system = Stopwatch(), wheel.system(validate.instance("peak", peak, WheelPeak).preload)
    if wheel.n_blades > MOST_BLADES:
        raise SettingError(
            f"kept: expected a wheel of at most {MOST_BLADES} blades, some five minutes of the processor that grow with "
            f"the third power of their number, found {wheel.n_blades}"
        )
    if not np.isfinite(peak.amplitude):
        raise SettingError(f"kept: expected a peak that was found, found {peak.status!r}")
    settings, model_hash = wheel.record()["settings"], wheel.study.model.hash
    if (peak.unknowns.shape, peak.model_hash, peak.settings) != (system.shape, model_hash, settings):
        raise SettingError("kept: expected a peak of this wheel on whole blades")
    one = OneStructure(system, peak.blade)
    steps, limit = STEPS if steps_per_period is None else steps_per_period, RULES.drop * peak.amplitude
    march = March(one.ring, tau * peak.frequency, one.start(system.flat(peak.unknowns)), steps)
    place, periods = stay(march, peak.amplitude, limit), len(march.harmonics)
    if place.stays:
        march = March(one.ring, march.omega, place.motion._replace(a=None), 2 * steps)
        place = stay(march, peak.amplitude, limit, long=True)
        periods += len(march.harmonics)
    blades = one.amplitudes(march, RULES.window)
    comes = f"blade {peak.blade} comes to {amount(float(blades[:, peak.blade].mean()), 'm')} in time"
    why = one.ring.unsolved or ("" if place.stays else f"{comes} where the balance has {amount(peak.amplitude, 'm')}")
    amplitudes = place.mean, float(place.amplitude.min()), float(place.amplitude.max())
    return WheelKept(
        *((np.nan,) * 3 if why else amplitudes), peak.frequency, peak.preload, peak.amplitude, periods=periods,
        status=because(NOT_FOUND, why) if why else COMPLETE, settings=settings, model_hash=model_hash, blade=peak.blade,
        blades=blades, cost=replace(one.ring.cost, **watch.read()),
    )  # fmt: skip
