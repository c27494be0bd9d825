"""The wheel: a study of all blades and dampers at once.

The highest blade of a wheel over the preload, as a sweep.

Response curve of a wheel: its branches over frequency, followed as those of a sector are.

Steady-state amplitude in time of a wheel: all blades and dampers integrated as one structure.

The march is that of a sector (:mod:`bdamper.time_domain.integration`), of which the whole wheel is a single one: its
coordinates are the modes of blades and disk with all deviations, and the coordinates of all dampers.  It starts at the peak
itself, with dampers free, and what counts as staying is what does for a sector
(:mod:`bdamper.time_domain.steady_amplitude`).  Damping is that of each mode of the wheel by itself: what couples them is
at most 2.1 % of it for lumped blades with deviations of 5 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from math import tau
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.analyses.sweep import SweepResult, sweep
from bdamper.harmonic_balance.equations import OK, Fixed
from bdamper.harmonic_balance.sector import Sector
from bdamper.mistuning.peak import WheelPeak, WheelPeakOptions, peak
from bdamper.mistuning.wheel_equations import WheelSystem
from bdamper.mistuning.wheel_problem import WheelProblem
from bdamper.model.kinematics import HarmonicBasis
from bdamper.response.branches import Coverage, ending, evaluation_budget, in_order
from bdamper.response.continuation import TWO_PI
from bdamper.response.events import ContinuationOptions
from bdamper.response.response_curve import as_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import TimeResponse
from bdamper.time_domain.integration import STEPS, MarchFailed, Ring
from bdamper.time_domain.march import March
from bdamper.time_domain.steady_amplitude import RULES, stay
from bdamper.util import validation
from bdamper.util.errors import NOT_FOUND, BdamperError, SettingError, with_reason
from bdamper.util.formatting import amount, short_repr
from bdamper.util.progress import CostMeter, one_thread

# ---- The highest blade of a wheel over the preload, as a sweep ----


OF_PEAKS = "amplitude", "frequency", "blade", "residual", "springs", "error"
"""What sweeps and samples keep of a peak."""


def answers(found: WheelPeak) -> dict[str, Any]:
    """A peak with free or held dampers as the answers at a point of a sweep.

    Raises
    ------
    BdamperError
        If it is none, or a lower bound alone.
    """
    if not found.found:
        raise BdamperError(f"{found.status}: {found.reason}")
    return {name: getattr(found, name) for name in OF_PEAKS} | {"cost": found.cost}


def _highest(_: Any, preload: Any, *, wheel: WheelProblem, options: WheelPeakOptions | None) -> dict[str, Any]:
    """The highest peak of a wheel, as a question of a sweep."""
    found = peak(wheel, preload, options=options)
    return answers(found) | {"tuned_amplitude": found.tuned_amplitude}


@validation.check_arguments
def optimal_curve(
    wheel: WheelProblem,
    preloads: Sequence[float],
    *,
    options: WheelPeakOptions | None = None,
    executor: Executor | None = None,
    progress: bool = False,
) -> SweepResult:
    """Highest amplitude of any blade at each of several preloads, every one searched for anew.

    Parameters
    ----------
    wheel : BladedDisk
    preloads : sequence of float, N
    options : WheelPeakOptions
    executor, progress
        As in :func:`bdamper.sweep`.

    Returns
    -------
    SweepResult
        Over the preload, with amplitude, frequency and number of the highest blade, the springs that hold dampers, the
        error of the amplitude that they leave (:class:`~bdamper.mistuning.peak.WheelPeak`), and the tuned amplitude.
    """
    values = validation.numbers("preloads", preloads, above=0.0, unit="N")
    task = partial(_highest, wheel=wheel, options=options)
    found = sweep(wheel.study, {"preload": values}, task, executor=executor, progress=progress)
    return replace(found, **wheel.record())


# ---- Response curve of a wheel ----


def first_point(system: WheelSystem, omega: float) -> NDArray | None:
    """A solution at one frequency (rad/s) from the static state, or by way of dampers held by springs, or None."""
    # springs on the mean of dampers with which a first point is looked for, each solution from the one before
    easing = (1.0, 0.1, 0.01, 0.0)
    for way in (easing[-1:], easing):
        y = np.append(system.structure.at_rest, omega)
        for held in way:
            eased = system.structure.held(held) if held else system
            c = eased.solve(y, Fixed(), eased.structure.units_about(y, omega), 1e-9, 60, 2)
            y = c.y
        if c.status == OK:
            return np.asarray(y)
    return None


@validation.check_arguments
@one_thread
def frequency_response(
    wheel: WheelProblem,
    preload: float,
    frequency: tuple[float, float],
    *,
    options: ContinuationOptions | None = None,
) -> ResponseCurve:
    """Response of all blades over a frequency interval at one preload.

    Parameters
    ----------
    wheel : BladedDisk
    preload : float, N
    frequency : (low, high), Hz
    options : ContinuationOptions

    Returns
    -------
    ResponseCurve
        Of the highest blade, with the response of all in ``blades`` and without unknowns: from one end, and from the other
        where that branch does not lead through; outside of the interval, where a branch may turn and come back; and from
        solutions within what is left.
    """
    low, high = (TWO_PI * f for f in validation.interval("frequency", frequency))
    options = validation.instance("options", options or ContinuationOptions(locate=False), ContinuationOptions)
    whole = wheel.system(preload)
    budget = options.budget or evaluation_budget(whole)
    options = replace(options, budget=budget)
    search = Coverage(whole.within(budget), (low, high), options, CostMeter())
    search.meter.watch(search.system)

    def find_start(omega: float) -> NDArray | None:
        found = first_point(whole, omega)
        search.note(omega, "no solution from the static state" if found is None else "from the static state")
        return found

    search.cover(find_start)
    status, reason, left_out = ending(search.pieces, low, high)
    blades = np.array([whole.structure.responses(p.y[:-1]) for p, _ in in_order(search.pieces)])
    blades = blades.reshape(-1, wheel.n_blades, whole.n_harmonics + 1)
    ended = status, reason, (*left_out, *search.lost)
    curve = as_curve(wheel.structure.tuned, search, ended, kind="tracking", preload=float(preload), blades=blades)
    return replace(curve, harmonics=highest_blade(blades), unknowns=np.zeros((len(curve), 0)), **wheel.record())


def highest_blade(blades: NDArray) -> NDArray:
    """(n, n_harmonics + 1) response of the highest blade at each point, of those of all blades."""
    return np.asarray(blades[np.arange(len(blades)), np.abs(blades[..., 1]).argmax(axis=1)])


# ---- Steady-state amplitude in time of a wheel ----


class OneStructure:
    """A wheel as one structure in time.

    Parameters
    ----------
    system : WheelSystem
    blade : int
        Whose motion is the response.
    """

    def __init__(self, system: WheelSystem, blade: int) -> None:
        scene, s = system.structure, system.structure.structure
        N, n_coef, size = scene.shape
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
        rows = np.einsum("i,bik->bk", scene.response_row, self.modes[:, :n])
        force = self._taken(scene.force, self.modes)
        one = Sector([basis] * (n_coef // 2 + 1), scene.points, force, [rows[blade]] * (n_coef // 2 + 1))
        self.ring = Ring(one.equations, 1, 0, rows=np.hstack([rows, np.zeros_like(rows)]))

    def _taken(self, u: NDArray, rows: NDArray) -> NDArray:
        """Coefficients (n_blades, n_coefficients, n_sector) times rows (n_blades, n_sector, n_modes), as unknowns."""
        return np.asarray(np.tensordot(self.system.structure.array(u).transpose(1, 0, 2), rows, 2).ravel())

    def start(self, u: NDArray) -> NDArray:
        """Unknowns of the one structure from those of the wheel."""
        return self._taken(u, self.inverse)


@validation.check_arguments
@one_thread
def time_response(wheel: WheelProblem, peak: WheelPeak, *, steps_per_period: int | None = None) -> TimeResponse:
    """Steady-state amplitude of the highest blade in time, of all blades from the peak.  Ctrl-C leaves no result.

    Parameters
    ----------
    wheel : BladedDisk
    peak : WheelPeak
        Of this wheel; its dampers are free in time, also where springs have held them.
    steps_per_period : int, optional
        256 by default; a motion that stays is marched again with twice as many.

    Returns
    -------
    TimeResponse
        "not found" where the motion leaves the peak: the amplitudes are NaN, the status says where
        it comes to, and ``blades`` has those of all.  Also where the march fails: then ``blades`` is NaN.

    Raises
    ------
    SettingError
        If the wheel has more than thirteen blades, or the peak is of another wheel or not found.
    """
    watch, system = CostMeter(), wheel.system(validation.instance("peak", peak, WheelPeak).preload)
    # of a wheel that is marched: what a period takes grows with the third power of them (docs/measured.md, "Peaks of
    # unequal wheels")
    most_blades = 13
    if wheel.n_blades > most_blades:
        raise SettingError(
            f"kept: expected a wheel of at most {most_blades} blades, some five minutes of the processor that grow with "
            f"the third power of their number, found {wheel.n_blades}"
        )
    if not np.isfinite(peak.amplitude):
        raise SettingError(f"kept: expected a peak that was found, found {peak.status!r}")
    settings, model_hash = wheel.record()["settings"], wheel.study.model.hash
    if (peak.unknowns.shape, peak.model_hash, peak.settings) != (system.structure.shape, model_hash, settings):
        raise SettingError("kept: expected a peak of this wheel on whole blades")
    one = OneStructure(system, peak.blade)
    steps, limit = STEPS if steps_per_period is None else steps_per_period, RULES.drop * peak.amplitude
    none = TimeResponse(
        *(np.nan,) * 3, peak.frequency, peak.preload, peak.amplitude, settings=settings, model_hash=model_hash,
        blade=peak.blade, blades=np.full((1, wheel.n_blades), np.nan),
    )  # fmt: skip
    try:
        march = March(one.ring, tau * peak.frequency, one.start(system.structure.flat(peak.unknowns)), steps, peak.blade)
        place, periods = stay(march, peak.amplitude, limit), len(march.harmonics)
        if place.stays:
            march = March(one.ring, march.omega, place.motion._replace(a=None), 2 * steps, peak.blade)
            place = stay(march, peak.amplitude, limit, long=True)
            periods += len(march.harmonics)
        if not place.stays:  # a visit ends as soon as the motion falls: to where?
            march.run(len(march.harmonics) + 2 * RULES.window)
            periods += 2 * RULES.window
    except MarchFailed as error:
        return replace(none, status=with_reason(NOT_FOUND, error), cost=watch.read(one.ring.cost))
    blades = np.abs(march.blades[-2 * RULES.window :])
    found = replace(none, periods=periods, blades=blades, cost=watch.read(one.ring.cost))
    if place.stays:
        mean, lowest, highest = place.mean, float(place.amplitude.min()), float(place.amplitude.max())
        return replace(found, mean=mean, lowest=lowest, highest=highest)
    comes = f"blade {peak.blade} comes to {amount(float(blades[:, peak.blade].mean()), 'm')} in time"
    return replace(found, status=with_reason(NOT_FOUND, f"{comes} where the balance has {amount(peak.amplitude, 'm')}"))


# ---- The wheel ----


@validation.check_arguments
@short_repr
@dataclass(frozen=True, eq=False)
class BladedDisk(WheelProblem):
    """All blades and dampers of a wheel at once, blades mistuned and dampers different.

    Laws, their evaluation and the preload are those of the study.  Blades and disk are described by the local basis of the
    model (``bdamper.model.modal_basis.LocalBasis``); where the study's contact stiffness is a method, attachments carry the
    flexibility of the contacts, and points have the stiffness of what the basis leaves out (:func:`tuned_problem`).

    Parameters
    ----------
    study : Study
        Of one sector; its engine order, excitation and response are those of the wheel.
    mistuning : Mistuning or array, optional
        Frequency deviations of the blades clamped at their roots; none by default.
    dampers : DamperVariation, optional
        How dampers differ; all alike by default.

    Raises
    ------
    SettingError, ModelError
        If a setting does not fit a wheel, or the model has no local basis.
    """

    frequency_response = frequency_response
    peak = peak
    time_response = time_response
    optimal_curve = optimal_curve
