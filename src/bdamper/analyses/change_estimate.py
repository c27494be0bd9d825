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

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import OK, Equations, norm2
from bdamper.harmonic_balance.problem import Problem
from bdamper.response.peak import amplitude_and_phase


class Change(NamedTuple):
    """Relative change that another study makes to a peak.

    Parameters
    ----------
    amplitude, frequency : float
        NaN if they are not known.
    uncertainty : float
        What the change may miss: 0 if it was computed, the defect of an estimate, infinite if nothing is known.
    how : str
        How it was found, or why not.
    """

    amplitude: float
    frequency: float
    uncertainty: float = 0.0
    how: str = ""

    @property
    def known(self) -> bool:
        """Whether it was found."""
        return bool(np.isfinite(self.amplitude))

    @property
    def size(self) -> float:
        """Largest relative change, with what it may miss; infinite if not known."""
        size = max(abs(self.amplitude), abs(self.frequency)) + self.uncertainty
        return float(size) if np.isfinite(size) else np.inf


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
            at, to = _common(a.structure.bases[0].coordinates, b.structure.bases[0].coordinates)
            out[to] += y[at] - before[at]
    for l in range(1, min(a.n_harmonics, b.n_harmonics) + 1):
        at, to = _common(a.structure.bases[l].coordinates, b.structure.bases[l].coordinates)
        for from_part, to_part in zip(a.layout.slices(l), b.layout.slices(l)):
            out[to_part.start + to] = y[from_part.start + at]
    return out


@lru_cache(maxsize=256)
def _common(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[NDArray, NDArray]:
    place = {c: i for i, c in enumerate(b)}
    pairs = [(i, place[c]) for i, c in enumerate(a) if c in place]
    return np.array([i for i, _ in pairs], int), np.array([j for _, j in pairs], int)


def estimate_change(system: Equations, y: NDArray) -> Change:
    """Change of the peak from the point ``y`` to the solutions of a system that ``y`` does not solve.

    It is unknown where the equations of the system are not finite.

    Parameters
    ----------
    system : Equations
    y : (n_unknowns + 1,) float
        A peak of another system, embedded.
    """
    n, unknown = system.n_unknowns, Change(np.nan, np.nan, np.inf, "no estimate")
    if system.core.evaluate(np.ascontiguousarray(y), r := np.empty(n)) != OK:
        return unknown
    grow, turn, amplitude = amplitude_and_phase(system, y[:-1])
    scale = np.full(n + 1, max(norm2(y[system.n_mean : -1]), 1e-300))
    scale[n] = y[-1]
    border = np.append(turn, 0.0) * scale
    border /= max(norm2(border), 1e-300)
    weights = np.zeros((2, n + 1))  # d ln(amplitude) and d ln(frequency)
    weights[0, :n], weights[1, n] = grow / max(amplitude, 1e-300) * scale[:n], 1.0
    try:  # a mean position that nothing holds stays where it is
        dual = system.solve_linear(y, border, scale, weights, transposed=True)[:, :n]
        step = system.solve_linear(y, border, scale, np.append(-r, 0.0)[None])[0]
    except FloatingPointError:
        return unknown
    change = -(dual @ r)
    new = y + step * scale
    again = np.empty(n)
    if not new[-1] > 0.0 or system.core.evaluate(new, again) != OK:
        return unknown
    missed = dual @ again
    return Change(float(change[0]), float(change[1]), float(np.abs(missed).max()), "estimated")
