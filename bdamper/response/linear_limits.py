"""Linear limits of a study: response without contact and in stick, and the interval of a peak.

Linear curves are sampled at equal steps of phase around each resonance, and their maxima are
refined.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from bdamper.harmonic_balance.checks import check_interval
from bdamper.harmonic_balance.problem import LoadCase, Problem
from bdamper.harmonic_balance.rotor_speed import preload_at
from bdamper.harmonic_balance.sector import NEAREST, Linear, around
from bdamper.model.loads import AXES
from bdamper.response.branches import UNBOUNDED, LeftOut
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util import validation
from bdamper.util.errors import COMPLETE, INCOMPLETE, warn_implausible
from bdamper.util.formatting import amount
from bdamper.util.progress import CostMeter, one_thread

# ---- linear response curves ----


@one_thread
def free(problem: Problem, frequency: tuple[float, float] | None, mode: int = 1) -> ResponseCurve:
    """See :meth:`bdamper.Study.free`."""
    case = _pressed(problem)
    frequency = peak_interval(case, frequency, mode)
    check_interval(case, frequency, with_stuck=False)
    return _linear(problem, "free", 0.0, frequency, None)


@one_thread
def stuck(
    problem: Problem,
    frequency: tuple[float, float] | None,
    preload: float | None = None,
    mode: int = 1,
) -> ResponseCurve:
    """See :meth:`bdamper.Study.stuck`."""
    case = _pressed(problem, preload)
    springs = case.stuck_springs(touching=True)
    frequency = peak_interval(case, frequency, mode)
    check_interval(case, frequency)
    return _linear(problem, "stuck", case.preload, frequency, springs)


def _pressed(problem: Problem, preload: float | None = None) -> LoadCase:
    """Return the problem under a preload (N) that closes the contact points.

    It is the centrifugal load at the rotor speed by default, or 1 N without a speed.
    """
    if preload is None:
        speed = problem.settings.speed
        preload = 1.0 if speed is None else preload_at(problem, speed)
    return problem.at(preload if problem.carries_load else 0.0)


def _linear(
    problem: Problem,
    kind: str,
    preload: float,
    frequency: tuple[float, float],
    springs: NDArray | None,
) -> ResponseCurve:
    """Compute the linear response over an interval (Hz).

    Springs (n_points, 3) in N/m replace the contact; None is no contact.
    """
    meter = CostMeter()
    lowest, highest = validation.interval("frequency", frequency)
    low = 2.0 * np.pi * lowest
    high = 2.0 * np.pi * highest
    linear = problem.linear
    rows = problem.response_rows
    row = rows[1]
    omega, undamped = _sample(linear, row, springs, low, high)
    missing_ranges = []
    for pole in undamped:
        if low < pole < high:
            hertz = pole / (2.0 * np.pi)
            why = f"{UNBOUNDED}: no damping"
            around_pole = LeftOut(hertz * (1.0 - NEAREST), hertz * (1.0 + NEAREST), why)
            missing_ranges.append(around_pole)

    def amplitude_at(omega_trial: float) -> float:
        return float(abs(linear.response(omega_trial, springs) @ row))

    tops = []
    for top in _maxima(amplitude_at, omega):
        # the points next to the pole of an undamped mode are no maxima
        if all(abs(top - pole) >= 2.0 * NEAREST * pole for pole in undamped):
            tops.append(top)
    omega = np.unique(np.concatenate([omega, tops]))
    n = len(omega)
    u = np.zeros((n, problem.n_unknowns))
    harmonics = np.zeros((n, len(rows)), complex)
    # largest residual of all excited harmonics at each frequency
    unbalanced = np.zeros(n)
    largest_force = 1e-300
    for harmonic in problem.settings.excited:
        force = linear.layout.amplitudes(linear.force, harmonic)
        cosine, sine = linear.layout.slices(harmonic)
        # complex modal amplitudes (n, n_modes)
        q = np.array([linear.response(at_point, springs, harmonic) for at_point in omega])
        # Re[q exp(i l omega t)] has the cosine Re q and the sine -Im q
        u[:, cosine] = q.real
        u[:, sine] = -q.imag
        harmonics[:, harmonic] = q @ rows[harmonic]
        for i, at_point in enumerate(omega):
            residual = linear.matrix(at_point, springs, harmonic) @ q[i] - force
            unbalanced[i] = np.maximum(unbalanced[i], np.abs(residual).max())
        largest_force = max(largest_force, float(np.abs(force).max()))
    return ResponseCurve(
        kind=kind,
        frequency=omega / (2.0 * np.pi),
        harmonics=harmonics,
        unknowns=u,
        residual=unbalanced / largest_force,
        shares=np.tile(_shares(problem, springs), (n, 1)),
        backward=np.zeros(n, bool),
        rank_deficiency=np.zeros(n, int),
        branch=np.zeros(n, int),
        point_kind=tuple("maximum" if top in tops else "regular" for top in omega.tolist()),
        preload=preload,
        status=INCOMPLETE if missing_ranges else COMPLETE,
        reason=", ".join(["linear", *(part.at_middle for part in missing_ranges)]),
        missing_ranges=tuple(missing_ranges),
        cost=meter.read(),
        **problem.recorded(),
    )


def _sample(
    linear: Linear, row: NDArray, springs: NDArray | None, low: float, high: float
) -> tuple[NDArray, list[float]]:
    """Return ascending frequencies (rad/s) of an interval, dense around the resonances.

    The second value contains the poles of undamped modes, at which there is no response.
    """
    parts = [np.linspace(low, high, 201)]
    undamped = []
    for pole, width, _ in linear.resonances((springs,), *around(low, high)):
        maximum, amplitude = linear.maximum(row, springs, pole, width)
        if np.isinf(amplitude):
            undamped.append(pole)
            one_side = np.geomspace(NEAREST, 1e-2, 40)
            distances = np.outer((-1.0, 1.0), one_side).ravel()
            parts.append(pole * (1.0 + distances))
        else:
            # equal steps of phase around each resonance
            steps = np.tan(np.linspace(-1.56, 1.56, 161))
            parts.append(np.append(pole + width * steps, maximum))
    omega = np.concatenate(parts)
    for pole in undamped:
        omega = omega[np.abs(omega - pole) >= 0.5 * NEAREST * pole]
    inside = (omega >= low) & (omega <= high)
    return np.unique(omega[inside]), undamped


def _shares(problem: Problem, springs: NDArray | None) -> NDArray:
    """Return the fractions (3,) in stick, slip and separation of points with friction or a bond."""
    counted = problem.friction_points & ((problem.friction > 0.0) | problem.bonded_points)
    if not counted.any():
        return np.zeros(3)
    if springs is None:
        return np.array([0.0, 0.0, 1.0])
    # a stuck point has a spring in at least one direction
    is_stuck = (springs[counted] > 0.0).any(axis=1)
    stick = float(is_stuck.mean())
    return np.array([stick, 0.0, 1.0 - stick])


def _maxima(height: Callable[[float], float], omega: NDArray) -> list[float]:
    """Return the frequencies (rad/s) of the maxima within an ascending sample of frequencies."""
    amplitude = np.array([height(w) for w in omega])
    # On each side of a maximum find_peaks takes the lowest value up to the next higher maximum, or
    # up to the end of the sample if none is higher.  The prominence is the height above the larger
    # of both values.  With a zero beyond each end, a side without a higher maximum has the value
    # 0: the prominence is the depth of the dip towards a higher maximum, or the full height.
    padded = np.pad(amplitude, 1)
    # dips that are smaller relative to the maximum are rounding
    rounding = 1e-9
    least_prominence = rounding * padded
    peaks, _ = scipy.signal.find_peaks(padded, prominence=least_prominence)
    # indices without the padding
    peaks = peaks - 1
    inside = (peaks > 0) & (peaks < len(amplitude) - 1)
    maxima = []
    for i in peaks[inside].tolist():
        low = float(omega[i - 1])
        high = float(omega[i + 1])
        refined = scipy.optimize.minimize_scalar(
            lambda w: -height(w),
            bounds=(low, high),
            method="bounded",
            options={"xatol": 1e-9 * high},
        )
        higher = -refined.fun > amplitude[i]
        maxima.append(float(refined.x) if higher else float(omega[i]))
    return maxima


# ---- interval of a resonance ----


@dataclass(frozen=True)
class Limit:
    """Linear resonance without contact ("free") or with all closed points stuck.

    Parameters
    ----------
    frequency : float, Hz
    amplitude : float, m
    """

    frequency: float
    amplitude: float


def free_and_stuck(case: LoadCase, modes: int) -> tuple[NDArray, NDArray]:
    """Return the first resonances (modes,) of the constrained bodies, free and stuck, Hz.

    The stuck resonance of a mode is the lowest one above its free resonance that belongs to no
    lower mode.

    Raises
    ------
    SettingError
        If the bodies have fewer modes.
    """
    linear = case.problem.linear
    basis = case.problem.bases[1]
    if np.any(linear.springs):
        # springs couple the modes of the bodies
        frequencies, *_ = linear.modes(contact=None)
        omega2 = frequencies**2
    else:
        # without rigid bodies and residual modes
        are_modes = np.array([coordinate.is_mode for coordinate in basis.coordinates], bool)
        elastic = (basis.omega2 > 0.0) & (basis.mass == 1.0) & are_modes
        omega2 = np.sort(basis.omega2[elastic])
    lowest = ", ".join(f"{hertz:.5g}" for hertz in np.sqrt(omega2[:3]) / (2.0 * np.pi))
    more = ", ..." if len(omega2) > 3 else ""
    expected = f"1 to {len(omega2)} ({lowest}{more} Hz without contact)"
    validation.check(1 <= modes <= len(omega2), "mode", expected, modes)
    free = np.sqrt(omega2[:modes])
    stuck_frequencies, *_ = linear.modes(case.stuck_springs(touching=True))
    # ascending resonances that no lower mode has taken
    left = list(stuck_frequencies)
    rounding = 1e-9
    stuck = []
    for omega in free:
        left = [pole for pole in left if pole >= omega * (1.0 - rounding)]
        stuck.append(left.pop(0) if left else omega)
    return free / (2.0 * np.pi), np.array(stuck) / (2.0 * np.pi)


def resonance_interval(case: LoadCase, mode: int = 1) -> tuple[float, float]:
    """Return a frequency interval (Hz) with the free and the stuck resonance of a mode.

    Parameters
    ----------
    case : LoadCase
        Its preload closes the contact points.
    mode : int
        1 for the lowest.

    Raises
    ------
    SettingError
        If there is no such mode.
    StaticError
        If there is no static state at the preload.
    """
    # all modes up to this one
    free_frequencies, stuck_frequencies = free_and_stuck(case, mode)
    free = float(free_frequencies[-1])
    stuck = float(stuck_frequencies[-1])
    margin = beyond(free, stuck)
    low = max(0.1 * free, free - margin)
    return low, stuck + margin


def beyond(free: float, stuck: float) -> float:
    """Return the margin of an interval beyond the free and the stuck resonance of a mode."""
    return 0.1 * free + 0.3 * (stuck - free)


def linear_peak(case: LoadCase, frequency: tuple[float, float], *, stuck: bool) -> Limit:
    """Return the highest resonance of the free or stuck structure in an interval (Hz), or NaN.

    The stuck resonance is also NaN at a preload without a static state.
    """
    if stuck and not case.static.ok:
        return Limit(np.nan, np.nan)
    springs = case.stuck_springs(touching=True) if stuck else None
    linear = case.problem.linear
    row = case.problem.response_rows[1]
    low = 2.0 * np.pi * frequency[0]
    high = 2.0 * np.pi * frequency[1]
    highest = Limit(np.nan, np.nan)
    for pole, width, _ in linear.resonances((springs,), *around(low, high)):
        omega, amplitude = linear.maximum(row, springs, pole, width)
        if not low <= omega <= high:
            continue
        if np.isnan(highest.amplitude) or amplitude > highest.amplitude:
            highest = Limit(omega / (2.0 * np.pi), amplitude)
    return highest


STILL = 0.01
"""Part of the largest motion below which a location hardly moves.  The tip of a locked shroud moves
by 0.02 to 0.5 % of it on two random sectors, and by 1.5 % on an imported stage.
"""


def warn_of_shroud(case: LoadCase, frequency: tuple[float, float]) -> None:
    """Warn of a shroud whose faces would leave each other at rest, and of a response location that
    hardly moves.
    """
    state = case.problem.static(case.preload)
    if state.too_far:
        warn_implausible(
            "constant_loads or gap",
            "an interference with which the faces stay on each other",
            f"{state.too_far} (study.static)",
        )
    _warn_of_still_response(case, frequency)


def _warn_of_still_response(case: LoadCase, frequency: tuple[float, float]) -> None:
    """Warn if the response location of a shrouded blade hardly moves at its stuck resonance.

    The warning names a location of the same body that moves more.
    """
    problem = case.problem
    settings = problem.settings
    response = settings.response_location
    locations = problem.model.locations
    measures_motion = response.elastic is None and str(response.location) in locations
    if not settings.constrained_faces or problem.sizes.lumped or not measures_motion:
        return
    peak = linear_peak(case, frequency, stuck=True)
    if not np.isfinite(peak.amplitude):
        return
    springs = case.stuck_springs(touching=True)
    q = case.sector.linear.response(2.0 * np.pi * peak.frequency, springs)
    body = locations[str(response.location)].body
    largest = 0.0
    where = ""
    for name, place in locations.items():
        if place.kind is not None or place.body != body:
            continue
        motion = np.abs(problem.location_modes(name, harmonic=1) @ q)
        axis = int(motion.argmax())
        if motion[axis] > largest:
            largest = float(motion[axis])
            where = f"'{name}', {AXES[axis]}, with {amount(largest, 'm')}"
    if peak.amplitude < STILL * largest:
        warn_implausible(
            "response",
            f"a place that moves at the stuck resonance, such as {where}",
            f"'{response.location}', {response.direction}, with {amount(peak.amplitude, 'm')}",
        )


def peak_interval(
    case: LoadCase, frequency: tuple[float, float] | None, mode: int = 1
) -> tuple[float, float]:
    """Return the given interval (Hz), or the interval around the resonances of a mode."""
    mode = validation.integer("mode", mode, least=1)
    if frequency is None:
        return resonance_interval(case, mode)
    return validation.interval("frequency", frequency)
