"""The change of a peak from one study to another, without computing the other peak.

A converged solution ``y = (u, omega)`` of one system is embedded in another one, richer or leaner: modes and harmonics that
both have keep their amplitudes, others are at rest or left out, and the mean keeps its distance from the static state.
There the residual ``R`` of the other system is not zero.  At a peak of the response the amplitude ``A`` is stationary along
the curve, so it does not matter at which point of the other curve it is compared; the phase of the response is held, which
follows a resonance that moves:

    B = [ J  R_omega ; grad(phase)  0 ],      B^T lambda = (grad A, 0),      B^T mu = (0, 1),
    dA = -lambda . R,                          domega = -mu . R.

One Jacobian of the other system and one factorisation give both.  ``R`` a second time, at ``y - B^-1 R``, tells how far
the linear estimate holds: what the same weights make of it is the *defect*, the part of the change that it has missed.

An estimate with its defect is an order of magnitude, to tell the small from what has to be computed.  On a test
rig (five harmonics, without separation) the estimated change of amplitude is +5.6 %, its defect 3.7 % and the true
change +1.3 %.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from bdamper.harmonic_balance.system import OK, HarmonicSystem
from bdamper.peaks.newton import amplitude_and_phase
from bdamper.problem.problem import Problem
from bdamper.util.repr import brief


@brief
@dataclass(frozen=True)
class Estimate:
    """Change that another system makes to a peak.

    Parameters
    ----------
    amplitude, frequency : float
        Relative change of the peak; NaN where the other equations are not finite.
    defect : float
        Relative change of amplitude or frequency that the estimate misses, as far as a second residual tells.
    y : (n_unknowns + 1,) float
        The embedded point after one Newton step: a guess for the solution of the other system.
    """

    amplitude: float
    frequency: float
    defect: float
    y: NDArray

    @property
    def size(self) -> float:
        """Largest relative change, the defect included."""
        size = max(abs(self.amplitude), abs(self.frequency)) + self.defect
        return size if np.isfinite(size) else np.inf


def embed(old: Problem, new: Problem, preload: float, y: NDArray) -> NDArray:
    """A point of one study as a point of a study with other effects.

    Modes that both have keep their amplitudes, others are at rest; the mean keeps its distance from the static state.

    Parameters
    ----------
    old, new : Problem
    preload : float, N
    y : (n_unknowns + 1,) float
        Of the old study.

    Returns
    -------
    (n_unknowns + 1,) float
    """
    a, b = old.system(preload), new.system(preload)
    out = np.zeros(b.n_unknowns + 1)
    out[-1] = y[-1]
    if b.n_mean:
        before, after = old.static(preload).q, new.static(preload).q
        out[: b.n_mean] = after
        if a.n_mean:
            at, to = _common(a.bases[0].coordinates, b.bases[0].coordinates)
            out[to] += y[at] - before[at]
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

    It is unknown where the equations of the system are not finite.

    Parameters
    ----------
    system : HarmonicSystem
    y : (n_unknowns + 1,) float
        A peak of another system, embedded.
    residual : (n_unknowns,) float, optional
        Of equations that differ from those of the system a little, at ``y``; the system's own by default.
    """
    n, unknown = system.n_unknowns, Estimate(np.nan, np.nan, np.inf, y)
    try:
        r, J, r_omega = system.evaluate(y[:-1], y[-1])
    except FloatingPointError:
        return unknown
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
    if not new[-1] > 0.0 or system.core.evaluate(new, again) != OK:
        return unknown
    missed = (np.append(again, 0.0) * rows) @ dual
    return Estimate(float(change[0]), float(change[1]), float(np.abs(missed).max()), new)
