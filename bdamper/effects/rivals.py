"""Places of a cheap curve at which a richer study may respond higher than at the peak that the cheap one leads to.

Another maximum may become the highest, the top of the same hill may lie elsewhere, and where the response rises beyond the
peak (towards an end of the interval, or while a body walks) it may have a maximum.  So the maxima of the cheap curve that
come near its highest and all its points near the top are embedded in the richer study as well: with the estimate ``e`` of
:mod:`bdamper.effects.indicator` and what it may miss ``d``, the richer response at a place of amplitude ``a`` lies between
``a (1 + e - d)`` and ``a (1 + e + d)``.

* A maximum may overtake the peak if the most it may have is above the least that the peak has.
* A point may if it may have more than the peak is expected to have, by the tolerance.
* Where the cheap response rises beyond the peak, the richer one may have a maximum between two points of which the higher
  need not stay the higher one, or at a summit that is no maximum, if the richer study changes anything there.

A harmonic ``l`` that the cheap study leaves out may resonate at ``1/l`` of a frequency of its own linear modes, stuck or
free, and raise the response in an interval too narrow for the points of the cheap curve.  So cheap solutions are placed
there and within the half-width to both sides, as the contact shifts the resonance, if the forces of the contact excite it:

    q_l = phi phi^H R_l / (i l omega phi^H D phi),      |G_l q_l| compared with |G_1 q_1|.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.system import OK, HarmonicSystem
from bdamper.continuation.curve import Curve, crossings
from bdamper.effects.indicator import Estimate
from bdamper.peaks.newton import Peak, peak_scale

NEAR = 0.7
"""Share of the highest amplitude from which on points of a curve are near its top."""
LEVEL = 1e-6
"""Relative difference of amplitude below which a curve does not rise or fall."""
EXCITED = 0.2
"""Motion of the contact in a superharmonic resonance, relative to that in the first harmonic, from which on it is asked."""
BESIDE = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Where it is asked, in half-widths from the linear resonance."""

Ask = Callable[[NDArray], Estimate]
"""What the richer study makes of a point of the cheap one, from unknowns and frequency (rad/s)."""


@dataclass(frozen=True)
class Place:
    """A point of a cheap curve and what a richer study makes of it.

    Parameters
    ----------
    y : (n_unknowns + 1,) float
        Of the cheap study.
    frequency, amplitude : float, Hz, m
        Of the cheap study.
    estimate : Estimate
    """

    y: NDArray
    frequency: float
    amplitude: float
    estimate: Estimate

    @property
    def expected(self) -> float:
        """Amplitude of the richer response, m; that of the cheap one where nothing is known."""
        return self.amplitude * (1.0 + (self.estimate.amplitude if np.isfinite(self.estimate.amplitude) else 0.0))

    @property
    def most(self) -> float:
        """Amplitude that the richer response may have, m."""
        e = self.estimate
        return self.amplitude * (1.0 + e.amplitude + e.defect) if np.isfinite(e.size) else np.inf

    @property
    def least(self) -> float:
        """Amplitude that it has at least, m."""
        e = self.estimate
        return max(self.amplitude * (1.0 + e.amplitude - e.defect), 0.0) if np.isfinite(e.size) else 0.0


class Rival(NamedTuple):
    """A place that may overtake the highest peak, and by how much the estimate of the peak misses that.

    Parameters
    ----------
    place : Place
    may_miss : float
        Relative change of amplitude or frequency beyond the estimate, if the response there is the most it may be.
    misses : float
        The same as far as it can be expected: as much for a maximum, 0 at a point whose own estimate cannot be relied on.
    """

    place: Place
    may_miss: float
    misses: float


def place_of_peak(peak: Peak, ask: Ask) -> Place:
    return Place(peak.y, peak.frequency, peak.amplitude, ask(peak.y))


def place_on_curve(curve: Curve, index: int, ask: Ask) -> Place:
    y = np.append(curve.unknowns[index], 2.0 * np.pi * curve.frequency[index])
    return Place(y, float(curve.frequency[index]), float(curve.amplitude[index]), ask(y))


def place_at(system: HarmonicSystem, y: NDArray, ask: Ask) -> Place:
    return Place(y, float(y[-1] / (2.0 * np.pi)), amplitude_of(system, y), ask(y))


def amplitude_of(system: HarmonicSystem, y: NDArray) -> float:
    return float(abs(system.amplitudes(y[:-1], 1) @ system.response_rows[1]))


def near_top(curve: Curve, amplitude: float, share: float = NEAR) -> NDArray:
    """Indices of the points of a curve that come near an amplitude or exceed it."""
    return np.flatnonzero(curve.amplitude >= share * amplitude)


class Superharmonic(NamedTuple):
    """A resonance of a higher harmonic at a fraction of the frequency of a linear mode.

    Parameters
    ----------
    harmonic : int
    omega, half_width : float, rad/s
        Of the excitation.
    mode : (n_modes,) complex
        Of unit modal mass.
    """

    harmonic: int
    omega: float
    half_width: float
    mode: NDArray


def superharmonics(
    cheap: HarmonicSystem, rich: HarmonicSystem, springs: Sequence[NDArray | None], low: float, high: float
) -> Iterator[Superharmonic]:
    """Those of the harmonics that only the rich system has, between two frequencies of excitation (rad/s).

    Parameters
    ----------
    cheap, rich : HarmonicSystem
    springs : sequence of (n_points, 3) float, N/m, or None
        In place of the contact of the rich system.
    low, high : float, rad/s
    """
    for l in range(2, rich.n_harmonics + 1):
        if not rich.n_mode[l] or (l <= cheap.n_harmonics and cheap.n_mode[l]):
            continue
        for k in springs:
            frequencies, modes = rich.linear_modes(k, l)
            for omega, mode in zip(frequencies / l, modes.T):
                if low < omega < high:
                    width = 0.5 * float(np.abs(mode) ** 2 @ rich.bases[l].damping) / l
                    yield Superharmonic(l, float(omega), max(width, 1e-9 * float(omega)), mode)


def superharmonic_points(
    curve: Curve,
    cheap: HarmonicSystem,
    rich: HarmonicSystem,
    springs: Sequence[NDArray | None],
    moved: Callable[[NDArray], NDArray],
    top: float,
) -> Iterator[list[NDArray]]:
    """Solutions of the cheap system near the top, those at one superharmonic resonance that the contact excites together.

    Parameters
    ----------
    curve : Curve
        Of the cheap system.
    cheap, rich : HarmonicSystem
    springs : sequence of (n_points, 3) float, N/m, or None
    moved : callable
        A point of the cheap system as a point of the rich one.
    top : float, m

    Yields
    ------
    list of (n_unknowns + 1,) float
    """
    ends = (2.0 * np.pi * float(f) for f in (curve.frequency.min(), curve.frequency.max()))
    asked: list[Superharmonic] = []
    for resonance in superharmonics(cheap, rich, springs, *ends):
        if any(r.harmonic == resonance.harmonic and abs(r.omega - resonance.omega) < r.half_width for r in asked):
            continue  # a mode that the springs do not feel
        asked.append(resonance)
        middle = point_between(curve, resonance.omega)
        if middle is None or amplitude_of(cheap, middle) < NEAR * top or excited(rich, moved(middle), resonance) < EXCITED:
            continue
        points = []
        for beside in BESIDE:
            y = point_between(curve, resonance.omega + beside * resonance.half_width)
            if y is not None:
                scale = peak_scale(cheap, y, resonance.half_width)
                found = cheap.correct_at(y[:-1], y[-1], scale, 1e-6, 10)
                points += [found.y] if found.status == OK else []
        yield points


def point_between(curve: Curve, omega: float) -> NDArray | None:
    """A curve at a frequency (rad/s) by linear interpolation, where several parts of it pass there on the highest."""
    passes = crossings(curve, omega)
    if not passes:
        return None
    i, t = max(passes, key=lambda at: float(curve.amplitude[at[0]] + curve.amplitude[at[0] + 1]))
    return np.append((1.0 - t) * curve.unknowns[i] + t * curve.unknowns[i + 1], omega)


def excited(rich: HarmonicSystem, y: NDArray, resonance: Superharmonic) -> float:
    """Largest motion of a contact point in a superharmonic resonance that the forces at a point excite, relative to that
    in the first harmonic; 0 where the equations are not finite."""
    residual = np.empty(rich.n_unknowns)
    if rich.core.evaluate(np.ascontiguousarray(y[:-1]), float(y[-1]), residual) != OK:
        return 0.0
    l, omega, half_width, mode = resonance
    c, s = rich.slices(l)
    force = float(np.abs(mode.conj() @ (residual[c] - 1j * residual[s])))
    reach: float = np.abs(rich.bases[l].G @ mode).max() * force / (2.0 * l**2 * omega * half_width)
    return reach / max(float(np.abs(rich.bases[1].G @ rich.amplitudes(y[:-1], 1)).max()), 1e-300)


def rivals(
    curve: Curve, peaks: list[Peak], ask: Ask, top: Place, tolerance: float, more: Sequence[Place] = ()
) -> Iterator[Rival]:
    """Places of a curve that may overtake its highest peak in a richer study.

    Parameters
    ----------
    curve : Curve
    peaks : list of Peak
        Of the curve, the highest first.
    ask : callable
    top : Place
        The highest peak.
    tolerance : float
        Relative.
    more : sequence of Place
        Between the points of the curve.
    """
    for peak in peaks[1:]:
        place = place_of_peak(peak, ask)
        if peak.amplitude >= NEAR * top.amplitude and place.most > top.least:
            yield _rival(place, top)
    places = {int(i): place_on_curve(curve, i, ask) for i in near_top(curve, top.amplitude)}
    above = top.amplitude * (1.0 + LEVEL)
    limit = top.expected * (1.0 + tolerance)
    for place in (*places.values(), *more):
        if place.amplitude <= above and place.most > limit:
            sure = place.expected > limit and place.estimate.reliability(tolerance) != "must be on"
            yield _rival(place, top)._replace(misses=_beyond(place, place.expected, top) if sure else 0.0)
    for i, j in pairwise(places):
        a, b = sorted((places[i], places[j]), key=lambda p: p.amplitude)
        follows = j == i + 1 and curve.branch[i] == curve.branch[j]
        if follows and a.amplitude > above and b.amplitude > a.amplitude * (1.0 + LEVEL) and a.most >= b.least:
            yield _rival(a, top)
    for i in summits(curve):
        if i in places and places[i].amplitude > above and places[i].estimate.size > LEVEL:
            yield _rival(places[i], top)


def _rival(place: Place, top: Place) -> Rival:
    miss = _beyond(place, place.most, top)
    return Rival(place, miss, miss)


def _beyond(place: Place, amplitude: float, top: Place) -> float:
    """What the estimate of the peak misses if the response at a place becomes the highest, with an amplitude."""
    moved = place.estimate.frequency if np.isfinite(place.estimate.frequency) else 0.0
    of_amplitude = amplitude / top.amplitude - 1.0 - top.estimate.amplitude
    of_frequency = place.frequency * (1.0 + moved) / top.frequency - 1.0 - top.estimate.frequency
    return max(abs(of_amplitude), abs(of_frequency))


def summits(curve: Curve) -> list[int]:
    """Points of a curve from which it falls to both sides along its branch."""
    a = curve.amplitude
    out = []
    for branch in np.unique(curve.branch):
        at = np.flatnonzero(curve.branch == branch)
        step = np.diff(a[at])
        step[np.abs(step) < LEVEL * a.max()] = 0.0
        moving = np.flatnonzero(step)
        out += [int(at[j + 1]) for j, k in zip(moving, moving[1:]) if step[j] > 0.0 > step[k]]
    return out
