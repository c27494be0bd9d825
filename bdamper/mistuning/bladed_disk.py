"""Analyses of a mistuned bladed disk: peaks at several preloads, response curves, and steady-state
amplitudes by time integration.

Response curves are computed by the same continuation as for one sector; the result has the response
of all blades.

**Time integration** uses the method of one sector (:mod:`bdamper.time_domain.integration`), with
the disk as a single sector.  Its coordinates are the mistuned modes of blades and disk, and the
coordinates of all dampers.  It starts at the peak, with free dampers.  The criteria of a steady
amplitude are the same as for a sector (:mod:`bdamper.time_domain.steady_amplitude`).  Damping is
modal; the neglected coupling between modes is at most 2.1 % of the damping for lumped blades with
deviations of 5 %.
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
from bdamper.harmonic_balance.checks import check_contacts
from bdamper.harmonic_balance.equations import OK, Fixed
from bdamper.harmonic_balance.sector import SectorData
from bdamper.harmonic_balance.study_boundary import problem_of
from bdamper.mistuning.disk_equations import DiskSystem
from bdamper.mistuning.disk_problem import DiskProblem
from bdamper.mistuning.peak import DiskPeak, DiskPeakOptions, peak
from bdamper.model.kinematics import HarmonicBasis
from bdamper.response.branches import Coverage, ending, evaluation_budget, in_order
from bdamper.response.continuation import TWO_PI
from bdamper.response.events import ContinuationOptions
from bdamper.response.response_curve import as_curve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import TimeResponse
from bdamper.time_domain.integration import STEPS, AllSectors, IntegrationFailed
from bdamper.time_domain.time_response import error_range
from bdamper.time_domain.transient import CRITERIA, SteadyPoint, Transient, settle, step_error
from bdamper.util import validation
from bdamper.util.errors import (
    COMPLETE,
    INCOMPLETE,
    NOT_FOUND,
    BdamperError,
    SettingError,
)
from bdamper.util.formatting import amount
from bdamper.util.progress import CostMeter, one_thread

# ---- Peaks against preload ----

OF_PEAKS = "amplitude", "frequency", "blade", "residual", "springs", "error", "lower_error"
"""Quantities of a peak in sweeps and samples."""


def answers(peak: DiskPeak) -> dict[str, Any]:
    """Return the quantities of a peak, complete or with held dampers, as a point of a sweep.

    Raises
    ------
    BdamperError
        If no peak was found, or only a lower bound.
    """
    if not peak.found:
        raise BdamperError(peak.status_text)
    return {name: getattr(peak, name) for name in OF_PEAKS} | {"cost": peak.cost}


def _highest(
    _: Any, preload: Any, *, disk: DiskProblem, options: DiskPeakOptions | None
) -> dict[str, Any]:
    """Return the quantities of the highest peak at a point of a preload sweep."""
    highest = peak(disk, preload, options=options)
    return answers(highest) | {"tuned_amplitude": highest.tuned_amplitude}


@validation.check_arguments
def optimal_curve(
    disk: DiskProblem,
    preloads: Sequence[float],
    *,
    options: DiskPeakOptions | None = None,
    executor: Executor | None = None,
    progress: bool | None = None,
) -> SweepResult:
    """Compute the highest amplitude of any blade at each preload by independent searches.

    Parameters
    ----------
    disk : BladedDisk
    preloads : sequence of float, N
    options : DiskPeakOptions
    executor, progress
        See :func:`bdamper.sweep`.

    Returns
    -------
    SweepResult
        At each preload: amplitude, frequency and number of the blade with the largest amplitude,
        auxiliary support springs of the dampers, errors of the amplitude
        (:class:`~bdamper.mistuning.peak.DiskPeak`), and tuned amplitude.
    """
    check_contacts(problem_of(disk.study), "optimal_curve")
    values = validation.numbers("preloads", preloads, above=0.0, unit="N")
    task = partial(_highest, disk=disk, options=options)
    result = sweep(disk.study, {"preload": values}, task, executor=executor, progress=progress)
    return replace(result, **disk.record())


# ---- Response curve ----


def first_point(system: DiskSystem, omega: float) -> NDArray | None:
    """Solve at one frequency (rad/s) from the static state, or with successively weaker holding
    springs.

    Return None if both fail.
    """
    # support springs relative to the stuck stiffness; each solution is the guess of the next
    free = (0.0,)
    weaker = (1.0, 0.1, 0.01, 0.0)
    for sequence in (free, weaker):
        y = np.append(system.structure.at_rest, omega)
        for springs in sequence:
            held = system.structure.held(springs) if springs else system
            scale = held.structure.units_about(y, omega)
            solution = held.solve(
                y, Fixed(), scale, tolerance=1e-9, max_iterations=60, line_search=2
            )
            y = solution.y
        # the last solution has free dampers
        if solution.status == OK:
            return np.asarray(y)
    return None


@validation.check_arguments
@one_thread
def frequency_response(
    disk: DiskProblem,
    preload: float,
    frequency: tuple[float, float],
    *,
    options: ContinuationOptions | None = None,
) -> ResponseCurve:
    """Compute the response of all blades over a frequency interval at one preload.

    Parameters
    ----------
    disk : BladedDisk
    preload : float, N
    frequency : (low, high), Hz
    options : ContinuationOptions

    Returns
    -------
    ResponseCurve
        Curve of the blade with the largest amplitude, with the response of all blades in ``blades``
        and without the unknowns of harmonic balance.  It consists of the branch from one end, the
        branch from the other end if the first does not reach it, and branches from solutions in the
        remaining gaps.  Branches may leave the interval and return.
    """
    first, last = validation.interval("frequency", frequency)
    low = TWO_PI * first
    high = TWO_PI * last
    options = validation.instance(
        "options", options or ContinuationOptions(locate=False), ContinuationOptions
    )
    whole = disk.system(preload)
    budget = options.budget or evaluation_budget(whole)
    options = replace(options, budget=budget)
    search = Coverage(whole.within(budget), (low, high), options, CostMeter())
    search.meter.watch(search.system)

    def find_start(omega: float) -> NDArray | None:
        point = first_point(whole, omega)
        if point is None:
            search.note(omega, "no solution from the static state")
        else:
            search.note(omega, "from the static state")
        return point

    search.cover(find_start)
    end = ending(search.pieces, low, high)
    end = replace(end, missing_ranges=(*end.missing_ranges, *search.lost))
    points = [point for point, _ in in_order(search.pieces)]
    blades = np.array([whole.structure.responses(point.y[:-1]) for point in points])
    # an empty array needs its shape
    blades = blades.reshape(-1, disk.n_blades, whole.n_harmonics + 1)
    curve = as_curve(
        disk.structure.tuned, search, end, kind="response", preload=float(preload), blades=blades
    )
    return replace(
        curve, harmonics=highest_blade(blades), unknowns=np.zeros((len(curve), 0)), **disk.record()
    )


def highest_blade(blades: NDArray) -> NDArray:
    """Return the response (n, n_harmonics + 1) of the highest blade at each point.

    ``blades`` (n, n_blades, n_harmonics + 1) contains the responses of all blades.
    """
    first_harmonic = np.abs(blades[..., 1])
    highest = first_harmonic.argmax(axis=1)
    return np.asarray(blades[np.arange(len(blades)), highest])


# ---- Time integration ----


class OneStructure:
    """A bladed disk as one structure for time integration.

    Parameters
    ----------
    system : DiskSystem
    blade : int
        Blade whose motion is the response.
    """

    def __init__(self, system: DiskSystem, blade: int) -> None:
        equations = system.structure
        matrices = equations.structure
        n_blades, n_coef, n_sector = equations.shape
        n_blade = matrices.n
        n_damper = matrices.n_damper

        # modes of all blades and the disk, with modal damping
        mass = _all_sectors(matrices.mass, matrices.disk_mass)
        stiffness = _all_sectors(matrices.stiffness, matrices.disk_stiffness)
        squares, phi = scipy.linalg.eigh(stiffness, mass)
        damping_matrix = _all_sectors(np.zeros_like(matrices.mass), matrices.damping)
        damping = np.einsum("ik,ik->k", phi, damping_matrix @ phi)

        # the unknowns are the coordinates of these modes, then those of all dampers; motion
        # (n_blades, n_sector) of each of them, with the blade before the damper of a sector
        n_modes = n_blades * n_blade
        n_unknowns = n_blades * n_sector
        unit_dampers = np.eye(n_blades * n_damper).reshape(n_blades, n_damper, -1)
        self.system = system
        self.modes = np.zeros((n_blades, n_sector, n_unknowns))
        self.modes[:, :n_blade, :n_modes] = phi.reshape(n_blades, n_blade, -1)
        self.modes[:, n_blade:, n_modes:] = unit_dampers
        # (mass phi)^T is the inverse of the mass-normalised modes
        self.inverse = self.modes.copy()
        self.inverse[:, :n_blade, :n_modes] = (mass @ phi).reshape(n_blades, n_blade, -1)

        of_unknowns = self.modes.transpose(2, 0, 1)
        motion = np.stack([matrices.motion(x) for x in of_unknowns], axis=-1)
        basis = HarmonicBasis(
            coordinates=(),
            omega2=np.append(squares, np.tile(matrices.damper_stiffness, n_blades)),
            damping_ratio=np.zeros(n_unknowns),
            G=motion.reshape(-1, 3, n_unknowns),
            nodal_diameter=0,
            mass=np.append(np.ones(n_modes), matrices.damper_mass),
            drag=np.append(damping, np.tile(matrices.damper_damping, n_blades)),
        )
        # response of each blade to the unknowns, (n_blades, n_unknowns)
        rows = np.einsum("i,bik->bk", equations.response_row, self.modes[:, :n_blade])
        force = self._projected(equations.force, self.modes)
        # the same modes and the same response in the mean and in all harmonics
        n_bases = n_coef // 2 + 1
        one = SectorData([basis] * n_bases, equations.points, force, [rows[blade]] * n_bases)
        # the coordinates are real, so that their imaginary parts do not respond
        rows_of_both_parts = np.hstack([rows, np.zeros_like(rows)])
        self.sectors = AllSectors(
            one.equations, n_blades=1, engine_order=0, rows=rows_of_both_parts
        )

    def _projected(self, u: NDArray, rows: NDArray) -> NDArray:
        """Return unknowns from unknowns of the disk and rows (n_blades, n_sector, n_modes)."""
        # (n_coefficients, n_blades, n_sector), summed over blades and their coordinates
        by_coefficient = self.system.structure.array(u).transpose(1, 0, 2)
        return np.asarray(np.tensordot(by_coefficient, rows, axes=2).ravel())

    def start(self, u: NDArray) -> NDArray:
        """Return the unknowns of this structure for unknowns ``u`` of the bladed disk."""
        return self._projected(u, self.inverse)


def _all_sectors(of_blade: NDArray, waves: NDArray) -> NDArray:
    """Return the matrix of all blades (N n, N n).

    ``of_blade`` (N, n, n) are the matrices of the blades, or (n, n) if they are equal; ``waves``
    (N, r, r) couples the last r coordinates of all blades in each travelling wave.
    """
    N = len(waves)
    n = of_blade.shape[-1]
    first = n - waves.shape[1]
    sectors = np.arange(N)
    distance = (sectors[:, None] - sectors) % N
    # the coupling of two sectors, (N, N, r, r), depends on their distance alone
    coupling = np.fft.ifft(waves, axis=0).real[distance]
    matrix = np.zeros((N, n, N, n))  # blade and coordinate, twice
    matrix[:, first:, :, first:] = coupling.transpose(0, 2, 1, 3)
    # the blocks on the diagonal
    matrix[sectors, :, sectors] += of_blade
    return matrix.reshape(N * n, N * n)


@validation.check_arguments
@one_thread
def time_response(
    disk: DiskProblem, peak: DiskPeak, *, steps_per_period: int | None = None
) -> TimeResponse:
    """Compute the largest steady-state blade amplitude by time integration of all blades from the
    peak.

    After Ctrl-C there is no result.

    Parameters
    ----------
    disk : BladedDisk
    peak : DiskPeak
        Peak of this disk.  Its dampers are free in the time integration, even if springs supported
        them in the search.
    steps_per_period : int, optional
        256 by default; a steady motion is integrated again with twice this number.  If the energy
        does not balance, the number is multiplied by four.

    Returns
    -------
    TimeResponse
        If the motion leaves the peak, the status is "not found" with the final amplitude, the
        amplitudes are NaN, and ``blades`` has the motion of all blades.  If the integration fails,
        ``blades`` is NaN as well.

    Raises
    ------
    SettingError
        If the disk has more than thirteen blades, or the peak was not found or belongs to another
        disk.
    """
    check_contacts(problem_of(disk.study), "time_response")
    meter = CostMeter()
    peak = validation.instance("peak", peak, DiskPeak)
    system = disk.system(peak.preload)
    # the time of a period grows with the third power of the number of blades
    # (docs/evidence/measured-disks.md, "Peaks of mistuned disks")
    most_blades = 13
    if disk.n_blades > most_blades:
        raise SettingError(
            f"time_response: a bladed disk may have at most {most_blades} blades, found "
            f"{disk.n_blades}; {most_blades} take some five minutes of processor time, which grows "
            "with the third power of their number"
        )
    if not np.isfinite(peak.amplitude):
        raise SettingError(
            "time_response: expected a peak with an amplitude, found one with the status "
            f"{peak.status!r}"
        )
    settings = disk.record()["settings"]
    model_hash = disk.study.model.hash
    is_of_disk = (
        peak.unknowns.shape == system.structure.shape
        and peak.model_hash == model_hash
        and peak.settings == settings
    )
    if not is_of_disk:
        raise SettingError(
            "time_response: expected a peak of this bladed disk, found a peak of another bladed "
            "disk"
        )
    steps = STEPS if steps_per_period is None else steps_per_period
    not_found = TimeResponse(
        mean=np.nan,
        lowest=np.nan,
        highest=np.nan,
        frequency=peak.frequency,
        preload=peak.preload,
        balance=peak.amplitude,
        settings=settings,
        model_hash=model_hash,
        blade=peak.blade,
        blades=np.full((1, disk.n_blades), np.nan),
    )

    one = OneStructure(system, peak.blade)
    ring = one.sectors
    omega = tau * peak.frequency
    start = one.start(system.structure.flat(peak.unknowns))
    window = 2 * CRITERIA.window
    periods = 0
    failure = ""
    # shorter steps resolve the contacts better, so a motion with a wrong energy begins again
    for n_steps in (steps, 4 * steps):
        try:
            coarse, steady, integrated = _settle_twice(ring, omega, start, n_steps, peak.amplitude)
        except IntegrationFailed as error:
            failure = str(error)
            continue
        periods += integrated
        failure = step_error(coarse.transient) or step_error(steady.transient)
        if not failure:
            break
    if failure:
        return replace(
            not_found,
            periods=periods,
            status=NOT_FOUND,
            reason=failure,
            cost=meter.read(ring.cost),
        )

    blades = np.abs(steady.transient.blades[-window:])
    result = replace(
        not_found,
        blade=steady.transient.blade,
        periods=periods,
        blades=blades,
        cost=meter.read(ring.cost),
    )
    if not steady.stays:
        in_time = amount(float(blades[:, result.blade].mean()), "m")
        balance = amount(peak.amplitude, "m")
        text = (
            f"the largest amplitude is {in_time} by time integration, {balance} by harmonic balance"
        )
        return replace(result, status=NOT_FOUND, reason=text)
    answers = {f"{n_steps} steps": coarse.mean, f"{2 * n_steps} steps": steady.mean}
    lowest, highest, doubt = error_range(answers, (coarse, steady))
    return replace(
        result,
        mean=steady.mean,
        lowest=lowest,
        highest=highest,
        highest_period=float(steady.amplitude.max()),
        answers=answers,
        status=INCOMPLETE if doubt else COMPLETE,
        reason=doubt,
    )


def _settle_twice(
    ring: AllSectors, omega: float, start: NDArray, steps: int, expected: float
) -> tuple[SteadyPoint, SteadyPoint, int]:
    """Return the motion with ``steps`` time steps, that with twice the number, and all periods.

    If the motion does not stay near the amplitude ``expected`` (m), it continues to its final
    amplitude.
    """
    window = 2 * CRITERIA.window
    coarse = settle(Transient(ring, omega, start, steps), expected)
    steady = coarse
    periods = len(coarse.transient.harmonics)
    if coarse.stays:
        # the accelerations of the method belong to its time steps, which are half as long now
        motion = coarse.transient.motion._replace(a=None)
        steady = settle(Transient(ring, omega, motion, 2 * steps), expected)
        periods += len(steady.transient.harmonics)
    # the integration stops where the motion falls; the amplitude is the mean of the last window,
    # which must not contain periods from before the fall
    if not steady.stays:
        steady.transient.advance(window)
        periods += window
    return coarse, steady, periods


# ---- Bladed disk ----


@validation.check_arguments
@dataclass(frozen=True, eq=False, repr=False)
class BladedDisk(DiskProblem):
    """All blades and dampers of a mistuned bladed disk.

    Contact laws, their evaluation and the preload follow from the study.  Blades and disk are
    described by the local basis of the model (``bdamper.model.modal_basis.LocalBasis``).  If the
    contact stiffness of the study is computed by a method, attachment modes contain the flexibility
    of the contacts, and the points have the stiffness of the remaining flexibility
    (``tuned_problem``).

    Parameters
    ----------
    study : Study
        Study of one sector, with engine order, excitation and response.
    mistuning : Mistuning or array, optional
        Deviations of the natural frequencies of the blades clamped at their roots; none by default.
    dampers : DamperVariation, optional
        Differences between the dampers; identical dampers by default.

    Raises
    ------
    SettingError, ModelError
        If a setting is invalid for a bladed disk, or the model has no local basis.
    """

    frequency_response = frequency_response
    peak = peak
    time_response = time_response
    optimal_curve = optimal_curve
