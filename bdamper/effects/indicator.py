"""What an effect that is left out would change, without simulating it.

A converged solution ``y = (u, omega)`` of a cheap system is embedded in a richer one: further harmonics, modes and
motions at rest, the mean displaced as far from the static state as before.  There the richer residual ``R`` is not zero.
At a peak of the response the amplitude ``A`` is stationary along the curve, so it does not matter at which point of the
richer curve it is compared; the phase of the response is held, which follows a resonance that moves:

    B = [ J  R_omega ; grad(phase)  0 ],      B^T lambda = (grad A, 0),      B^T mu = (0, 1),
    dA = -lambda . R,                          domega = -mu . R.

One Jacobian of the richer system and one factorisation give both, whatever the number of quantities.  ``R`` a second time,
at ``y - B^-1 R``, tells how far the linear estimate can be trusted: what the same weights make of it is the *defect*, the
part of the change that the estimate has missed.

A change is *small* if estimate and defect stay below the tolerance; if the estimate is beyond 15 %, or misses more than
half of itself, or the richer equations are singular there, its size is not to be trusted: what makes it *must be on*.  In
between it is *significant*.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from bdamper.balance.system import OK, HarmonicSystem
from bdamper.continuation.curve import Curve
from bdamper.peaks.newton import Peak, PeakOptions, find_peak, same_peak
from bdamper.problem.problem import Problem
from bdamper.util.repr import brief

TRUSTED = 0.15
"""Relative change up to which the size of an estimate can be relied on."""


@brief
@dataclass(frozen=True)
class Estimate:
    """Change that a richer system makes to a peak.

    Parameters
    ----------
    amplitude, frequency : float
        Relative change of the peak; NaN where the richer equations are singular.
    defect : float
        Relative change of amplitude or frequency that the estimate misses, as far as a second residual tells.
    y : (n_unknowns + 1,) float
        The embedded point after one Newton step: a guess for the richer solution.
    shares, frequency_shares : (n_harmonics + 1,) float
        Parts of the relative change of amplitude and of frequency that come from the equations of each harmonic, the mean
        first.
    """

    amplitude: float
    frequency: float
    defect: float
    y: NDArray
    shares: NDArray
    frequency_shares: NDArray

    @property
    def size(self) -> float:
        """Largest relative change, the defect included."""
        size = max(abs(self.amplitude), abs(self.frequency)) + self.defect
        return size if np.isfinite(size) else np.inf

    def reliability(self, tolerance: float) -> str:
        """ "small", "significant" or "must be on"."""
        change = max(abs(self.amplitude), abs(self.frequency))
        if not np.isfinite(self.size):
            return "must be on"
        if self.size <= tolerance:
            return "small"
        return "must be on" if change > TRUSTED or self.defect > 0.5 * change else "significant"


def embed(cheap: Problem, rich: Problem, preload: float, y: NDArray) -> NDArray:
    """A point of one study as a point of a study with other effects.

    Modes that both have keep their amplitudes, others are at rest; the mean keeps its distance from the static state.

    Parameters
    ----------
    cheap, rich : Study
    preload : float, N
    y : (n_unknowns + 1,) float
        Of the cheap study.

    Returns
    -------
    (n_unknowns + 1,) float
    """
    a, b = cheap.system(preload), rich.system(preload)
    return embed_between(cheap, rich, a, b, preload, y)


def embed_between(
    cheap: Problem, rich: Problem, a: HarmonicSystem, b: HarmonicSystem, preload: float, y: NDArray
) -> NDArray:
    """The same for systems that exist already."""
    out = np.zeros(b.n_unknowns + 1)
    out[-1] = y[-1]
    if b.n_mean:
        old, new = cheap.static(preload).q, rich.static(preload).q
        out[: b.n_mean] = new
        if a.n_mean:
            at, to = _common(a.bases[0].coordinates, b.bases[0].coordinates)
            out[to] += y[at] - old[at]
    for l in range(1, min(a.n_harmonics, b.n_harmonics) + 1):
        at, to = _common(a.bases[l].coordinates, b.bases[l].coordinates)
        for from_part, to_part in zip(a.slices(l), b.slices(l)):
            out[to_part.start + to] = y[from_part.start + at]
    return out


@lru_cache(maxsize=256)
def _common(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[NDArray, NDArray]:
    place = {c: i for i, c in enumerate(b)}
    pairs = [(i, place[c]) for i, c in enumerate(a) if c in place]
    return np.array([i for i, _ in pairs], int), np.array([j for _, j in pairs], int)


def estimate_change(system: HarmonicSystem, y: NDArray, residual: NDArray | None = None) -> Estimate:
    """Change of the peak from the point ``y`` to the solutions of a system that ``y`` does not solve.

    Parameters
    ----------
    system : HarmonicSystem
    y : (n_unknowns + 1,) float
        A peak of a simpler system, embedded.
    residual : (n_unknowns,) float, optional
        Of equations that differ from those of the system a little, at ``y``; the system's own by default.
    """
    n = system.n_unknowns
    r, J, r_omega = system.evaluate(y[:-1], y[-1])
    r = r if residual is None else residual
    grow, turn, amplitude = amplitude_and_phase(system, y[:-1])
    B = np.zeros((n + 1, n + 1))
    B[:n, :n], B[:n, n], B[n, :n] = J, r_omega, turn
    columns = np.ones(n + 1)
    columns[:n] = max(float(np.linalg.norm(y[system.n_mean : -1])), 1e-300)
    columns[n] = y[-1]
    B *= columns
    rows = 1.0 / np.maximum(np.abs(B).max(axis=1), 1e-300)
    B *= rows[:, None]
    weights = np.zeros((n + 1, 2))
    weights[:n, 0] = grow / max(amplitude, 1e-300) * columns[:n]
    weights[n, 1] = 1.0
    right = np.append(r, 0.0) * rows
    getrf, getrs, gecon = get_lapack_funcs(("getrf", "getrs", "gecon"), (B,))
    factors, pivots, info = getrf(B)
    if info == 0 and gecon(factors, np.abs(B).sum(axis=0).max())[0] > 1e-14:
        dual = getrs(factors, pivots, weights, trans=1)[0]
        step = getrs(factors, pivots, -right)[0]
    else:  # a mean position that nothing holds stays where it is
        dual = np.linalg.lstsq(B.T, weights, rcond=1e-13)[0]
        step = np.linalg.lstsq(B, -right, rcond=1e-13)[0]
    change = -(right @ dual)
    new = y + step * columns
    again = np.empty(n)
    if not new[-1] > 0.0 or system.core.evaluate(np.ascontiguousarray(new[:-1]), float(new[-1]), again) != OK:
        return unknown_change(system, y)
    missed = (np.append(again, 0.0) * rows) @ dual
    parts = -right[:, None] * dual
    shares = np.array([sum(parts[p].sum(axis=0) for p in system.slices(l)) for l in range(system.n_harmonics + 1)])
    return Estimate(float(change[0]), float(change[1]), float(np.abs(missed).max()), new, shares[:, 0], shares[:, 1])


def unknown_change(system: HarmonicSystem, y: NDArray) -> Estimate:
    """The estimate where there is none."""
    nothing = np.full(system.n_harmonics + 1, np.nan)
    return Estimate(np.nan, np.nan, np.inf, y, nothing, nothing)


def change_or_unknown(system: HarmonicSystem, y: NDArray) -> Estimate:
    """:func:`estimate_change`, unknown where the equations of the system are not finite."""
    try:
        return estimate_change(system, y)
    except FloatingPointError:
        return unknown_change(system, y)


def amplitude_and_phase(system: HarmonicSystem, u: NDArray) -> tuple[NDArray, NDArray, float]:
    """Gradients (n_unknowns,) of the amplitude and of amplitude times phase of the response, and the amplitude."""
    row = system.response_rows[1]
    x = system.amplitudes(u, 1) @ row
    amplitude = float(abs(x))
    z = np.conj(x) * row / max(amplitude, 1e-300)
    c, s = system.slices(1)
    grow, turn = np.zeros(len(u)), np.zeros(len(u))
    grow[c], grow[s] = z.real, z.imag
    turn[c], turn[s] = z.imag, -z.real
    return grow, turn, amplitude


# ---- peaks of a curve ----


def highest_peaks(
    system: HarmonicSystem, curve: Curve, share: float = 0.6, options: PeakOptions | None = None
) -> list[Peak]:
    """Refined maxima of a curve that come near the highest, the highest first.

    Parameters
    ----------
    system : HarmonicSystem
        The one that the curve was followed with.
    curve : Curve
    share : float
        Of the highest: lower maxima are left out.
    options : PeakOptions
    """
    a = curve.amplitude
    peaks: list[Peak] = []
    for i in range(1, len(curve) - 1):
        same_branch = curve.branch[i - 1] == curve.branch[i] == curve.branch[i + 1]
        if not (same_branch and a[i] > a[i - 1] and a[i] >= a[i + 1] and a[i] >= share * a.max()):
            continue
        y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
        peak = find_peak(system, y, options=options)
        if not peak.converged and "maximum" in curve.point_kind[i - 1 : i + 2]:  # a fold beside it may be higher by a hair
            peak = as_located(peak, y, float(a[i]), float(curve.residual[i]))
        if peak.converged and not any(same_peak(peak, p, 1e-3) for p in peaks):
            peaks.append(peak)
    return sorted(peaks, key=lambda p: -p.amplitude)


def as_located(peak: Peak, y: NDArray, amplitude: float, residual: float) -> Peak:
    """The peak that a search did not find to the last digit, as it was located on a curve."""
    return replace(
        peak, y=y, frequency=float(y[-1] / (2.0 * np.pi)), amplitude=amplitude, residual=residual, status="converged"
    )
