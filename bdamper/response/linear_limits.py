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
from bdamper.harmonic_balance.sector import NEAREST, around
from bdamper.response.branches import UNBOUNDED, LeftOut
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util import validation
from bdamper.util.errors import COMPLETE, INCOMPLETE
from bdamper.util.progress import CostMeter, one_thread

# ---- linear response curves ----


@one_thread
def free(problem: Problem, frequency: tuple[float, float]) -> ResponseCurve:
    """See :meth:`bdamper.Study.free`."""
    return _linear(problem.at(0.0), "free", frequency, None)


@one_thread
def stuck(
    problem: Problem, frequency: tuple[float, float], preload: float | None = None
) -> ResponseCurve:
    """See :meth:`bdamper.Study.stuck`."""
    if preload is None:
        speed = problem.settings.speed
        preload = 1.0 if speed is None else preload_at(problem, speed)
    case = problem.at(preload if problem.carries_load else 0.0)
    return _linear(case, "stuck", frequency, case.stuck_springs(touching=True))


def _linear(
    case: LoadCase, kind: str, frequency: tuple[float, float], springs: NDArray | None
) -> ResponseCurve:
    """Compute the linear response over an interval (Hz).

    Springs (n_points, 3) in N/m replace the contact.
    """
    watch = CostMeter()
    low, high = (2.0 * np.pi * f for f in validation.interval("frequency", frequency))
    check_interval(case, frequency)
    problem, system = case.problem, case.equations
    linear, omega = system.structure.linear, np.linspace(low, high, 201)
    unbounded = []
    for w, width, _ in linear.resonances((springs,), *around(low, high)):
        at, amplitude = linear.maximum(system.response_rows[1], springs, w, width)
        if np.isinf(amplitude):
            unbounded.append(w)
            omega = np.concatenate(
                [omega, w * (1.0 + np.outer((-1.0, 1.0), np.geomspace(NEAREST, 1e-2, 40)).ravel())]
            )
        else:
            # equal steps of phase around each resonance
            omega = np.concatenate([omega, w + width * np.tan(np.linspace(-1.56, 1.56, 161)), [at]])
    infinite = [w / (2.0 * np.pi) for w in unbounded if low < w < high]
    left_out = tuple(
        LeftOut(f * (1.0 - NEAREST), f * (1.0 + NEAREST), f"{UNBOUNDED}: no damping")
        for f in infinite
    )
    for w in unbounded:
        omega = omega[np.abs(omega - w) >= 0.5 * NEAREST * w]
    omega = np.unique(omega[(omega >= low) & (omega <= high)])

    def height(w: float) -> float:
        return float(abs(linear.response(w, springs) @ system.response_rows[1]))

    tops = [
        w
        for w in _maxima(height, omega)
        if all(abs(w - pole) >= 2.0 * NEAREST * pole for pole in unbounded)
    ]
    omega = np.unique(np.concatenate([omega, tops]))
    n = len(omega)
    u, error, largest = np.zeros((n, system.n_unknowns)), np.zeros(n), 1e-300
    for l in problem.settings.excited:
        force, (cosine, sine) = (
            system.layout.amplitudes(system.structure.force, l),
            system.layout.slices(l),
        )
        q = np.array([linear.response(w, springs, l) for w in omega])
        u[:, cosine], u[:, sine] = q.real, -q.imag
        wrong = [np.abs(linear.matrix(w, springs, l) @ a - force).max() for w, a in zip(omega, q)]
        error, largest = np.maximum(error, wrong), max(largest, float(np.abs(force).max()))
    return ResponseCurve(
        kind=kind,
        frequency=omega / (2.0 * np.pi),
        harmonics=system.response(u),
        unknowns=u,
        residual=error / largest,
        shares=np.tile(_shares(problem, springs), (n, 1)),
        backward=np.zeros(n, bool),
        rank_deficiency=np.zeros(n, int),
        branch=np.zeros(n, int),
        point_kind=tuple("maximum" if w in tops else "regular" for w in omega.tolist()),
        preload=case.preload,
        status=INCOMPLETE if left_out else COMPLETE,
        reason=", ".join(["linear", *(part.at_middle for part in left_out)]),
        missing_ranges=left_out,
        cost=watch.read(),
        **problem.recorded(),
    )


def _shares(problem: Problem, springs: NDArray | None) -> NDArray:
    """Return the fractions (3,) in stick, slip and separation of points with friction or a bond."""
    held = np.zeros((len(problem.friction), 3)) if springs is None else springs
    counted = problem.friction_points & ((problem.friction > 0.0) | problem.bonded_points)
    stick = float((held[counted] > 0.0).any(axis=1).mean()) if counted.any() else 0.0
    return np.array([stick, 0.0, float(counted.any()) - stick])


def _maxima(height: Callable[[float], float], omega: NDArray) -> list[float]:
    """Return the frequencies (rad/s) of the maxima within an ascending sample of frequencies."""
    a = np.array([height(w) for w in omega])
    flat, within = 1e-9, np.pad(a, 1)  # smaller relative dips between two maxima are rounding
    found, out = scipy.signal.find_peaks(within, prominence=flat * within)[0] - 1, []
    for i in found[(found > 0) & (found < len(a) - 1)].tolist():
        ends = (float(omega[i - 1]), float(omega[i + 1]))
        exact = {"xatol": 1e-9 * ends[1]}
        best = scipy.optimize.minimize_scalar(
            lambda w: -height(w), bounds=ends, method="bounded", options=exact
        )
        out.append(float(best.x) if -best.fun > a[i] else float(omega[i]))
    return out


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
    sector = case.problem.at(0.0).sector
    basis = sector.bases[1]
    modes_alone = np.array([c.is_mode for c in basis.coordinates], bool)
    elastic = np.sort(basis.omega2[(basis.omega2 > 0.0) & (basis.mass == 1.0) & modes_alone])
    if np.any(sector.springs):
        elastic = sector.linear.modes(None)[0] ** 2
    validation.check(1 <= modes <= len(elastic), "mode", f"1 to {len(elastic)}", modes)
    free = np.sqrt(elastic[:modes])
    poles = list(sector.linear.modes(case.stuck_springs(touching=True))[0])
    stuck = []
    for w in free:
        poles = [p for p in poles if p >= w * (1.0 - 1e-9)]
        stuck.append(poles.pop(0) if poles else w)
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
    free, stuck = (float(f[-1]) for f in free_and_stuck(case, mode))
    margin = beyond(free, stuck)
    return max(0.1 * free, free - margin), stuck + margin


def beyond(free: float, stuck: float) -> float:
    """Return the margin of an interval beyond the free and the stuck resonance of a mode."""
    return 0.1 * free + 0.3 * (stuck - free)


def linear_peak(case: LoadCase, frequency: tuple[float, float], *, stuck: bool) -> Limit:
    """Return the highest resonance of the free or stuck structure in an interval (Hz), or NaN.

    The stuck resonance is also NaN at a preload without a static state.
    """
    if stuck and not case.static.converged:
        return Limit(np.nan, np.nan)
    sector = (case if stuck else case.problem.at(0.0)).sector
    springs = case.stuck_springs(touching=True) if stuck else None
    low, high = (2.0 * np.pi * f for f in frequency)
    poles = sector.linear.resonances((springs,), *around(low, high))
    tops = [
        sector.linear.maximum(sector.response_rows[1], springs, w, width) for w, width, _ in poles
    ]
    within = [top for top in tops if low <= top[0] <= high]
    omega, amplitude = max(within, key=lambda top: top[1], default=(np.nan, np.nan))
    return Limit(omega / (2.0 * np.pi), amplitude)


def peak_interval(
    case: LoadCase, frequency: tuple[float, float] | None, mode: int = 1
) -> tuple[float, float]:
    """Return the given interval (Hz), or the interval around the resonances of a mode."""
    mode = validation.integer("mode", mode, least=1)
    if frequency is None:
        return resonance_interval(case, mode)
    return validation.interval("frequency", frequency)
