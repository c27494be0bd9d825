"""The highest peak of a wheel: a coarse sweep over the band of its blades, and climbs at several blades and frequencies.

The worst blade's peak is not that of the tuned wheel followed into mistuning, which loses it too often.  The sweep covers
the frequencies at which any wave of the tuned wheel, with the contacts as stiff as at the tuned peak, resonates, widened by
the deviations of the blades; its points, a share of the width of the tuned peak apart, satisfy the equations loosely.  From
the highest of its maxima, of different blades or at different frequencies, Newton's method climbs to the peaks of single
blades, which are smooth where the envelope is not.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.wheel.newton import Corrected, correct, solved
from bdamper.wheel.results import WheelPeak
from bdamper.wheel.system import WheelSystem
from bdamper.wheel.track import TOLERANCE, TWO_PI, Path, cost_of, follow, start

FAR = 1.5
"""Ratio to the frequency of the tuned peak beyond which a wave of another nodal diameter counts as of another family."""


@dataclass(frozen=True)
class WheelPeakOptions:
    """Settings of the search for the highest peak.

    Parameters
    ----------
    step : float
        Largest step of the sweep, relative to the vibration of the whole wheel.
    climbs : int
        Peaks that are climbed.
    loose : float
        Residual with which the sweep is content.
    most : int
        Points of the sweep.
    """

    step: float = 0.3
    climbs: int = 3
    loose: float = 1e-2
    most: int = 600

    def __post_init__(self) -> None:
        validate.fields(self, validate.number, "step", "loose", above=0.0, most=1.0)
        validate.fields(self, validate.whole, "climbs", "most", least=1)


def band(wheel: Any, preload: float) -> tuple[float, float, float]:
    """Frequencies (Hz) between which blades may have peaks, and the width of the tuned peak at half its power.

    Every contact point is replaced by the spring and the damper that do what it does in the first harmonic at the tuned
    peak.
    """
    tuned, s = wheel.tuned(), wheel.structure
    top = wheel.tuned_peak(preload)
    system = tuned.system(preload)
    X, F, _ = system.contact(top.y[:-1])
    x, f = X[..., 1] - 1j * X[..., 2], F[..., 1] - 1j * F[..., 2]
    complex_stiffness = np.where(np.abs(x) > 0.0, f / np.where(np.abs(x) > 0.0, x, 1.0), 0.0)
    springs, loss = np.maximum(complex_stiffness.real, 0.0), np.maximum(complex_stiffness.imag, 0.0)
    omega = float(top.y[-1])
    N, n = s.n_blades, s.n
    e = int(tuned.engine_order) % N
    reference, found = None, {}
    for d in [e if 2 * e <= N else N - e, *range(N // 2 + 1)]:
        G = s.rows.astype(complex)
        G[..., :n] *= np.exp(2j * np.pi * d * s.sector / N)[:, None, None]
        G = G.reshape(-1, s.n_sector)
        K = scipy.linalg.block_diag(s.local.stiffness(d), np.diag(s.damper_stiffness)).astype(complex)
        M = scipy.linalg.block_diag(s.local.mass(d), np.diag(s.damper_mass.mean(axis=0)))
        K += G.conj().T @ (springs.ravel()[:, None] * G)
        squares, phi = scipy.linalg.eigh(K, M)
        own = phi[: s.local.n_cantilever]
        if reference is None:
            k = int(np.argmin(np.abs(squares - omega**2)))
            reference = own[:, k]
            motion = G @ phi[:, k]
            friction = float((loss.ravel() * np.abs(motion) ** 2).sum())
            viscous = float((phi[:n, k].conj() @ s.damping[d] @ phi[:n, k]).real) * omega
            width = (friction + viscous) / omega
        near = np.flatnonzero((squares > (omega / FAR) ** 2) & (squares < (omega * FAR) ** 2))
        if len(near):
            alike = np.abs(reference.conj() @ own[:, near]) / np.linalg.norm(own[:, near], axis=0)
            found[d] = float(np.sqrt(squares[near[int(np.argmax(alike))]]))
    deviation = wheel.mistuning.deviation
    low = min(omega, *found.values()) * (1.0 + min(0.0, float(deviation.min()))) - 2.0 * width
    high = max(omega, *found.values()) * (1.0 + max(0.0, float(deviation.max()))) + 2.0 * width
    return low / TWO_PI, high / TWO_PI, width / TWO_PI


@one_thread
def peak(
    wheel: Any,
    preload: float,
    frequency: tuple[float, float] | None = None,
    *,
    options: WheelPeakOptions | None = None,
) -> WheelPeak:
    """Highest amplitude of any blade at a preload.

    Parameters
    ----------
    wheel : Wheel
    preload : float, N
    frequency : (low, high), Hz, optional
        Of the sweep; :func:`band` by default.
    options : WheelPeakOptions

    Returns
    -------
    WheelPeak
        ``status`` is "converged" if the highest of all climbs is; the amplitude is NaN if none is.
    """
    watch = time.perf_counter(), time.process_time()
    options = options or WheelPeakOptions()
    if frequency is not None:
        frequency = validate.interval("frequency", frequency)
    system, mean = wheel.system(preload)
    before = system.evaluations, system.factorisations, system.iterations
    top = wheel.tuned_peak(preload)
    low, high, width = band(wheel, preload)
    low, high = frequency or (low, high)
    swept = _sweep(system, mean, (TWO_PI * low, TWO_PI * high), options)
    climbs: list[tuple[float, float, float]] = []
    best: Corrected | None = None
    height, blade, why = np.nan, -1, "no solution found on the sweep"
    for X, omega, k in _candidates(wheel, swept, options.climbs):
        found, amplitude = climb(wheel, system, X, omega, k, TWO_PI * width)
        why = "no climb converged" if best is None else why
        if found is None:
            continue
        climbs.append((float(k), found.omega / TWO_PI, amplitude))
        # whichever blade is highest there
        heights = np.abs(wheel.response(found.X)[:, 1])
        if best is None or heights.max() > height:
            best, height, blade = found, float(heights.max()), int(np.argmax(heights))
    if best is not None and climbs[int(np.argmax([c[2] for c in climbs]))][0] != blade:
        again, amplitude = climb(wheel, system, best.X, best.omega, blade, TWO_PI * width)
        if again is not None and amplitude >= height:
            best, height = again, amplitude
            climbs.append((float(blade), best.omega / TWO_PI, amplitude))
    empty = np.zeros((wheel.n_blades, 0))
    return WheelPeak(
        preload=float(preload),
        frequency=np.nan if best is None else best.omega / TWO_PI,
        amplitude=height,
        blade=blade,
        tuned_frequency=top.frequency,
        tuned_amplitude=top.amplitude,
        response=empty if best is None else wheel.response(best.X),
        shares=empty if best is None else wheel.damper_shares(best.at.shares),
        climbs=np.array(climbs).reshape(-1, 3),
        sweep_frequency=np.array([w for _, w in swept]) / TWO_PI,
        sweep_amplitude=np.array([np.abs(wheel.response(X)[:, 1]) for X, _ in swept]).reshape(-1, wheel.n_blades),
        status="not found" if best is None else "converged",
        reason=why if best is None else f"highest of {len(climbs)} climbs from {len(swept)} points",
        residual=np.nan if best is None else best.residual,
        deviation=wheel.mistuning.deviation.reshape(wheel.n_blades, -1),
        unknowns=np.zeros(system.shape) if best is None else best.X,
        cost=cost_of(system, watch, before),
        settings=wheel.settings(),
        model_hash=wheel.study.model.hash,
    )


def _sweep(
    system: WheelSystem, mean: NDArray, limits: tuple[float, float], options: WheelPeakOptions
) -> list[tuple[NDArray, float]]:
    """Loose solutions along the curve, from the lower end, and from the upper one where that does not lead through."""
    out: list[tuple[NDArray, float]] = []
    for up in (True, False):
        first = start(system, mean, limits[0 if up else 1])
        if first is None:
            continue
        out.append((first.X, first.omega))
        path = Path(system, limits)
        path.set_off(first, up)
        status, _ = follow(
            path, lambda found, kind: out.append((found.X, found.omega)), up, options.most, options.step, options.loose
        )
        if status == "complete":
            break
    return sorted(out, key=lambda point: point[1])


def _candidates(wheel: Any, swept: list[tuple[NDArray, float]], n: int) -> list[tuple[NDArray, float, int]]:
    """Highest local maxima of single blades on the sweep, one for each frequency or blade."""
    if not swept:
        return []
    height = np.array([np.abs(wheel.response(X)[:, 1]) for X, _ in swept])
    padded = np.pad(height, ((1, 1), (0, 0)), constant_values=-np.inf)
    maxima = np.argwhere((height >= padded[:-2]) & (height >= padded[2:]))
    maxima = maxima[np.argsort(-height[tuple(maxima.T)])]
    out: list[tuple[NDArray, float, int]] = []
    taken: list[tuple[int, int]] = []
    for i, k in maxima:
        if any(abs(i - j) <= 1 for j, _ in taken):
            continue
        taken.append((i, k))
        out.append((swept[i][0], swept[i][1], int(k)))
        if len(out) == n:
            break
    return out


def climb(
    wheel: Any, system: WheelSystem, X: NDArray, omega: float, blade: int, width: float, most: int = 25
) -> tuple[Corrected | None, float]:
    """Maximum of one blade's amplitude along the curve near a point: secant on its slope; None if it was not found.

    Parameters
    ----------
    X, omega : a loose solution
    blade : int
    width : float, rad/s
        First step at most.
    """
    row = np.zeros(system.shape[2])
    row[: wheel.structure.n] = wheel.response_row
    place = correct(system, X, omega, tolerance=1e-6, most=15, line_search=True)
    if not place.converged:
        return None, np.nan
    h, slope_before, normal = 0.0, np.nan, None
    for _ in range(most):
        tangent = _tangent(place, normal)
        if tangent is None:
            return None, np.nan
        unit = float(np.sqrt((place.X[:, 1:] ** 2).sum()))
        unit_omega = width
        length = np.sqrt((tangent[0][:, 1:] ** 2).sum() / unit**2 + (tangent[1] / unit_omega) ** 2)
        tangent = tangent[0] / length, tangent[1] / length
        a, da = (Y[blade, 1] @ row - 1j * (Y[blade, 2] @ row) for Y in (place.X, tangent[0]))
        slope = float((np.conj(a) * da).real / abs(a) ** 2)
        if h and np.isfinite(slope_before) and slope != slope_before:
            curvature = (slope - slope_before) / h
        else:
            curvature = -8.0
        h_new = float(np.clip(-slope / curvature, -0.5, 0.5)) if curvature < 0.0 else 0.4 * np.sign(slope)
        if abs(h_new) < 1e-4 and slope_before == slope_before:
            done = correct(
                system, place.X + h_new * tangent[0], place.omega + h_new * tangent[1], _plane(tangent, unit, unit_omega),
                tolerance=TOLERANCE, most=10, inverse=place.inverse,
            )  # fmt: skip
            if done.converged:
                return done, float(abs(done.X[blade, 1] @ row - 1j * (done.X[blade, 2] @ row)))
            return None, np.nan
        normal = _plane(tangent, unit, unit_omega)
        new = None
        while abs(h_new) > 1e-7:
            new = correct(
                system, place.X + h_new * tangent[0], place.omega + h_new * tangent[1], normal, tolerance=1e-6, most=6,
                inverse=place.inverse,
            )  # fmt: skip
            if new.converged:
                break
            h_new *= 0.4
        if new is None or not new.converged:
            return None, np.nan
        h, slope_before, place = h_new, slope, new
    return None, np.nan


def _plane(tangent: tuple[NDArray, float], unit: float, unit_omega: float) -> tuple[NDArray, float]:
    """Normal of the plane at right angles to a tangent in scaled unknowns, the mean left out."""
    normal = tangent[0] / unit**2
    normal[:, 0] = 0.0
    return normal, tangent[1] / unit_omega**2


def _tangent(place: Corrected, normal: tuple[NDArray, float] | None) -> tuple[NDArray, float] | None:
    """Direction of the curve, along the normal of the last plane or up in frequency."""
    inverse = place.inverse or place.at.inverse()
    plane = (np.zeros_like(place.X), 1.0) if normal is None else normal
    dX, d_omega, _ = solved(place.at, inverse, plane, 1e-6, (np.zeros_like(place.X), 1.0))
    return (dX, d_omega) if np.isfinite(d_omega) and np.isfinite(dX).all() else None
