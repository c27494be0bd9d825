"""Linear response curves: without any contact, or with every closed point stuck.

The response is sampled in equal steps of phase around each resonance, and its maxima are searched for.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy  # scipy.signal is loaded where it is used
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from bdamper.harmonic_balance.linear_limits import NEAREST, around
from bdamper.harmonic_balance.plausibility import check_interval
from bdamper.harmonic_balance.problem import Problem, stuck_springs
from bdamper.response.curve import ResponseCurve
from bdamper.util import validation
from bdamper.util.cost import CostMeter
from bdamper.util.threading import one_thread


@one_thread
def free(problem: Problem, frequency: tuple[float, float]) -> ResponseCurve:
    """Response without any contact: the limit of no preload.

    Parameters
    ----------
    frequency : (low, high), Hz
    """
    return _linear(problem, "free", 0.0, frequency, None)


@one_thread
def stuck(problem: Problem, frequency: tuple[float, float], preload: float = 1.0) -> ResponseCurve:
    """Response with every point stuck that the preload closes: the limit of high preload.

    Parameters
    ----------
    frequency : (low, high), Hz
    preload : float, N
        Decides which points are closed; without gaps its size does not matter.  An interface that touches but carries
        nothing counts as stuck where it touches, with a warning.
    """
    if not problem.carries_load:
        preload = 0.0
    springs = stuck_springs(problem, problem.equilibrium(preload), touching=True)
    return _linear(problem, "stuck", preload, frequency, springs)


def _linear(
    problem: Problem, kind: str, preload: float, frequency: tuple[float, float], springs: NDArray | None
) -> ResponseCurve:
    """The linear response over an interval (Hz), with springs of shape (n_points, 3) in N/m in place of the contact."""
    watch = CostMeter()
    low, high = (2.0 * np.pi * f for f in validation.interval("frequency", frequency))
    check_interval(problem, frequency, preload)
    system = problem.system(preload)
    linear, omega = system.structure.linear, np.linspace(low, high, 201)
    unbounded = []
    for w, width, _ in linear.resonances((springs,), *around(low, high)):
        at, amplitude = linear.maximum(system.response_rows[1], springs, w, width)
        if np.isinf(amplitude):
            unbounded.append(w)
            omega = np.concatenate([omega, w * (1.0 + np.outer((-1.0, 1.0), np.geomspace(NEAREST, 1e-2, 40)).ravel())])
        else:
            # equal steps of phase around each resonance
            omega = np.concatenate([omega, w + width * np.tan(np.linspace(-1.56, 1.56, 161)), [at]])
    infinite = [w / (2.0 * np.pi) for w in unbounded if low < w < high]
    for w in unbounded:
        omega = omega[np.abs(omega - w) >= 0.5 * NEAREST * w]
    omega = np.unique(omega[(omega >= low) & (omega <= high)])

    def height(w: float) -> float:
        return float(abs(linear.response(w, springs) @ system.response_rows[1]))

    tops = [w for w in _maxima(height, omega) if all(abs(w - pole) >= 2.0 * NEAREST * pole for pole in unbounded)]
    omega = np.unique(np.concatenate([omega, tops]))
    n = len(omega)
    u, error, largest = np.zeros((n, system.n_unknowns)), np.zeros(n), 1e-300
    for l in problem.settings.excited:
        force, (cosine, sine) = system.layout.amplitudes(system.structure.force, l), system.layout.slices(l)
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
        preload=preload,
        status="complete",
        reason="linear" + "".join(f", unbounded at {f:.6g} Hz: no damping" for f in infinite),
        cost=watch.read(),
        **problem.recorded(),
    )


def _shares(problem: Problem, springs: NDArray | None) -> NDArray:
    """(3,) stick, slip and open: points with friction or a bond that springs hold, and those without any."""
    held = np.zeros((len(problem.friction), 3)) if springs is None else springs
    counted = problem.friction_points & ((problem.friction > 0.0) | problem.bonded_points)
    stick = float((held[counted] > 0.0).any(axis=1).mean()) if counted.any() else 0.0
    return np.array([stick, 0.0, float(counted.any()) - stick])


def _maxima(height: Callable[[float], float], omega: NDArray) -> list[float]:
    """Places (rad/s) of the maxima within the ends of an ascending sample of frequencies."""
    a = np.array([height(w) for w in omega])
    flat, within = 1e-9, np.pad(a, 1)  # dips between two maxima below this share of the lower one are rounding
    found, out = scipy.signal.find_peaks(within, prominence=flat * within)[0] - 1, []
    for i in found[(found > 0) & (found < len(a) - 1)].tolist():
        ends = (float(omega[i - 1]), float(omega[i + 1]))
        best = minimize_scalar(lambda w: -height(w), bounds=ends, method="bounded", options={"xatol": 1e-9 * ends[1]})
        out.append(float(best.x) if -best.fun > a[i] else float(omega[i]))
    return out
