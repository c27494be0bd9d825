"""The highest peak of a wheel: a coarse sweep over the band of its blades, and climbs at several blades and frequencies.

The worst blade's peak is not that of the tuned wheel followed into mistuning, which loses it too often.  The sweep covers
the frequencies at which any wave of the tuned wheel, with the contacts as stiff as at the tuned peak, resonates, widened by
the deviations of the blades; its points, a share of the width of the tuned peak apart, satisfy the equations loosely, and
the mean of dampers is held by springs (:mod:`bdamper.wheel.solution`).  From the highest of its maxima, of different blades
or at different frequencies, Newton's method climbs to the peaks of single blades, which are smooth where the envelope is
not.  These are followed to weaker springs, always the one that may be the highest next, until that one has free dampers or
is found no further.

**What the springs change.**  On wheels of 13 blades of the shipped disk (2 % deviation, 300 N to 2 kN, 34 peaks that were
followed to the end) the amplitude with springs of 0.1, 0.01 and 0.001 is off that with free dampers by 3, 1.5 and 0.5 % in
the median and by 18, 12 and 5 % at most; which blade is the highest changes with the springs in 3 of 12 wheels.  What
``WheelPeak.error`` promises from these covers the changes of 41, 42 and 40 of 42, 42 and 41 peaks of 12 other wheels.
With free dampers the highest peak is found on 13 of 14 of these wheels at 1 and 2 kN and on 3 of 7 at 500 N, on others with
springs of 0.01 and less; on four wheels of 65 blades on all at 2 kN, with 0.003 to 0.03 at 500 N.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from math import tau

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.util import status, validate
from bdamper.util.blas import one_thread
from bdamper.wheel.newton import TOLERANCE, Corrected, Plane, correct, plane_across, size_of, solved
from bdamper.wheel.results import WheelPeak
from bdamper.wheel.solution import SPRINGS, solution
from bdamper.wheel.system import PLAIN, Ease, Inverse, WheelSystem
from bdamper.wheel.track import cost_of
from bdamper.wheel.wheel_problem import WheelProblem

GAIN, EXACT = 1e-5, 1e-8
"""By how much, relatively, an amplitude may still rise where a climb ends: on the way, and at the highest peak."""
NEAR, ROUGH = 2e-3, 1e-2
"""Newton step, relative to the vibration, and residual with which the first place of a climb is content.  With residuals of
any size dampers that are nearly free are still on their way."""
SHARE = 0.05
"""Of a climb's step: Newton step with which the place ahead is content.  On 12 wheels of 13 blades 0.02 takes as many
factorisations, 0.2 a quarter more, with a peak lost."""
LEAST = 3e-5
"""Shortest step of a climb, relative to the vibration."""
FAR = 1.5
"""Ratio to the frequency of the tuned peak beyond which a wave of another nodal diameter counts as of another family."""


HELD = Ease(springs=SPRINGS)
WEAKER = (1e-1, 1e-2, 1e-3, 0.0)
"""Springs on the mean of dampers with which peaks are looked for one after the other."""
ERROR = (0.0, 0.06), (2e-3, 0.13), (2e-2, 0.2)
"""Largest change of an amplitude between springs above the first number and free dampers (module's docstring); what weaker
springs have changed already says little of what comes, but no less is promised."""
NEARLY = 0.9
"""With 13 blades of the shipped disk, 500 N, two blades are 0.3 % apart at a point of the sweep, and the second has
the highest peak, 2.5 % above that of the first."""
RISE = 0.06
"""By how much any peak may rise when it is freed.  On the 12 other wheels of the module's docstring the highest is that
after freeing all four peaks; without this one of them is 1.7 % too low."""


@dataclass(frozen=True, eq=False)
class _Climbed:
    """A peak of the blade that is the highest there, with ever weaker springs.

    Parameters
    ----------
    at : Corrected
    plane : (normal, normal_omega)
        Across the curve.
    blade : int
    springs, heights : tuple of float, - and m
        Springs with which it was found, and its amplitudes.
    last : bool
        No peak was found with weaker springs.
    """

    at: Corrected
    plane: Plane
    blade: int
    springs: tuple[float, ...]
    heights: tuple[float, ...]
    last: bool = False

    @property
    def height(self) -> float:
        return self.heights[-1]

    @property
    def final(self) -> bool:
        return self.last or not self.springs[-1]

    @property
    def range(self) -> float:
        """Range of its amplitudes, relative to the last one."""
        return (max(self.heights) - min(self.heights)) / self.height

    @property
    def error(self) -> float:
        """Bound of how far its amplitude is from that with free dampers, relative, as far as is known (``ERROR``)."""
        springs = self.springs[-1]
        return max(self.range, *(error for least, error in ERROR if springs > least)) if springs else 0.0

    @property
    def highest(self) -> float:
        """What its amplitude with free dampers may be."""
        return self.height * (1.0 + self.error)


@dataclass(frozen=True)
class WheelPeakOptions:
    """Settings of the search for the highest peak.

    Parameters
    ----------
    spacing : float
        Of the points of the sweep, relative to the width of the tuned peak at half its power.
    climbs : int
        Peaks that are climbed.
    loose : float
        Length of a Newton step, relative to the vibration, with which the sweep is content.
    least, most : int
        Points of the sweep.
    """

    spacing: float = 1.0
    climbs: int = 4
    loose: float = 0.05
    least: int = 30
    most: int = 300

    def __post_init__(self) -> None:
        validate.fields(self, validate.number, "spacing", "loose", above=0.0, most=10.0)
        validate.fields(self, validate.whole, "climbs", "least", "most", least=1)


def band(wheel: WheelProblem, preload: float) -> tuple[float, float, float]:
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
    return low / tau, high / tau, width / tau


@one_thread
def peak(
    wheel: WheelProblem,
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
        ``status`` is "complete" if a peak was found with dampers free, and the sweep has solutions at all frequencies but
        single ones.  It is "incomplete" if the sweep has none at two and more in a row, which ``reason`` names; "held" if
        the peak was found only with springs on the mean of dampers, ``springs`` of their stiffness when stuck; and "not
        found", the amplitude NaN, if no climb converges.  Peaks beyond the band do not count.
    """
    watch = time.perf_counter(), time.process_time()
    options = options or WheelPeakOptions()
    if frequency is not None:
        frequency = validate.interval("frequency", frequency)
    system, mean = wheel.system(preload)
    before = system.evaluations, system.factorisations, system.iterations
    tuned = wheel.tuned_peak(preload)
    low, high, width = band(wheel, preload)
    low, high = frequency or (low, high)
    n = int(np.clip(np.ceil((high - low) / (options.spacing * width)) + 1, options.least, options.most))
    points = tau * np.linspace(low, high, n)
    swept = _sweep(system, mean, points, options.loose)
    gap = _gap(points, swept)
    climbs = _Climbs(wheel, system, tau * width, (float(points[0]), float(points[-1])))
    peaks = climbs.held(_candidates(wheel, swept, options.climbs))
    held = np.array([(c.blade, c.at.omega / tau, c.height) for c in peaks]).reshape(-1, 3)
    peaks = climbs.exact(climbs.freed(peaks))
    top = max(peaks, key=lambda peak: peak.height, default=None)
    best, springs = (None, 0.0) if top is None else (top.at, top.springs[-1])
    met = [found for found in swept if found is not None]
    empty = np.zeros((wheel.n_blades, 0))
    return WheelPeak(
        preload=float(preload),
        frequency=np.nan if best is None else best.omega / tau,
        amplitude=np.nan if top is None else top.height,
        blade=-1 if top is None else top.blade,
        tuned_frequency=tuned.frequency,
        tuned_amplitude=tuned.amplitude,
        response=empty if best is None else wheel.response(best.X),
        shares=empty if best is None else wheel.damper_shares(best.at.shares),
        climbs=np.column_stack([held, np.array([(c.springs[-1], c.height) for c in peaks]).reshape(-1, 2)]),
        sweep_frequency=np.array([found.omega for found in met]) / tau,
        sweep_amplitude=np.array([np.abs(wheel.response(found.X)[:, 1]) for found in met]).reshape(-1, wheel.n_blades),
        status=_status(top, gap, springs),
        reason=_reason(top, gap, f"{len(peaks)} peaks climbed from {len(met)} of {n} points"),
        residual=np.nan if best is None else best.residual,
        springs=springs,
        error=np.nan if top is None else max([top.error, *(c.highest / top.height - 1.0 for c in peaks if c.last)]),
        interval=(low, high),
        deviation=wheel.mistuning.deviation.reshape(wheel.n_blades, -1),
        unknowns=np.zeros(system.shape) if best is None else best.X,
        cost=cost_of(system, watch, before),
        settings=wheel.settings(),
        model_hash=wheel.study.model.hash,
    )


def _status(top: _Climbed | None, gap: tuple[float, float] | None, springs: float) -> str:
    if top is None:
        return status.NOT_FOUND
    return status.INCOMPLETE if gap else status.HELD if springs else status.COMPLETE


def _sweep(system: WheelSystem, mean: NDArray, omega: NDArray, loose: float) -> list[Corrected | None]:
    """Loose solutions with dampers held at every frequency (rad/s), ascending, each from the one before, or None.

    Newton's first step from a solution nearby is that of the linear wheel with the contacts as they are there, which is
    what resonances between both frequencies need; extrapolation would pass over them.
    """
    X = np.zeros(system.shape)
    X[:, 0] = mean
    X[system.still] = 0.0
    out: list[Corrected | None] = []
    for w in omega:
        found = solution(system, X, float(w), HELD, 1e-6, loose)
        X = X if found is None else found.X
        out.append(found)
    return out


def _gap(omega: NDArray, swept: list[Corrected | None]) -> tuple[float, float] | None:
    """Ends of the longest part of a band with two and more frequencies in a row that have no solution."""
    lost = np.array([False, *(found is None for found in swept), False])
    begin, end = np.flatnonzero(lost[1:] & ~lost[:-1]), np.flatnonzero(~lost[1:] & lost[:-1])
    if not len(begin) or (end - begin).max() < 2:
        return None
    k = int(np.argmax(end - begin))
    return float(omega[begin[k]]), float(omega[end[k] - 1])


def _candidates(wheel: WheelProblem, swept: list[Corrected | None], n: int) -> list[tuple[Corrected, int]]:
    """Highest local maxima of single blades on the sweep, of different blades or frequencies; ends of gaps count, too.

    Another blade at the same frequency counts only if it is nearly as high (``NEARLY``).
    """
    none = np.full(wheel.n_blades, -np.inf)
    height = np.array([none if found is None else np.abs(wheel.response(found.X)[:, 1]) for found in swept])
    padded = np.pad(height, ((1, 1), (0, 0)), constant_values=-np.inf)
    maxima = np.argwhere((height >= padded[:-2]) & (height >= padded[2:]) & np.isfinite(height))
    out: list[tuple[Corrected, int]] = []
    taken: list[tuple[int, int]] = []
    for i, k in maxima[np.argsort(-height[tuple(maxima.T)])]:
        found = swept[i]
        if found is None or any(
            abs(i - j) <= 1 and (k == other or height[i, k] < NEARLY * height[j, other]) for j, other in taken
        ):
            continue
        taken.append((i, k))
        out.append((found, int(k)))
        if len(out) == n:
            break
    return out


def _reason(top: _Climbed | None, gap: tuple[float, float] | None, found: str) -> str:
    parts = [found]
    if top is not None and top.springs[-1]:
        parts.append(
            f"the mean of dampers held by springs of {top.springs[-1]:.2g} of their stuck stiffness, which change the "
            f"amplitude by some {100.0 * top.error:.2g} %"
        )
    if gap is not None:
        parts.append(f"no solution found between {gap[0] / tau:.6g} and {gap[1] / tau:.6g} Hz")
    return "; ".join(parts)


@dataclass(frozen=True, eq=False)
class _Climbs:
    """Climbs of one search.

    Parameters
    ----------
    wheel : Wheel
    system : WheelSystem
    width : float, rad/s
        Of the tuned peak.
    band : (low, high), rad/s
        Peaks beyond it do not count.
    """

    wheel: WheelProblem
    system: WheelSystem
    width: float
    band: tuple[float, float]

    def held(self, candidates: list[tuple[Corrected, int]]) -> list[_Climbed]:
        """Different peaks with dampers held."""
        out: list[_Climbed] = []
        for start, k in candidates:
            found = self._of_highest(start, k, HELD)
            if found is not None and not any(
                found.blade == c.blade and abs(found.at.omega - c.at.omega) < 0.05 * self.width for c in out
            ):
                out.append(found)
        return out

    def freed(self, peaks: list[_Climbed]) -> list[_Climbed]:
        """Peaks followed to weaker springs as far as needed: until none that may still rise above the highest is left.

        A peak may rise by as much as freeing has changed any other of the wheel, or by ``RISE``.
        """
        out = list(peaks)
        while out:
            rise = 1.0 + max(RISE, *(peak.range for peak in out))
            top = max(peak.height for peak in out)
            left = [i for i, peak in enumerate(out) if not peak.final and peak.height * rise >= top]
            if not left:
                break
            i = max(left, key=lambda i: out[i].height)
            out[i] = self._weakened(out[i])
        return out

    def exact(self, peaks: list[_Climbed]) -> list[_Climbed]:
        """The same peaks, with the highest, and what may be the highest, climbed to the top (``EXACT``)."""
        top, out = max((peak.height for peak in peaks), default=0.0), list(peaks)
        for i, peak in enumerate(peaks):
            if peak.height > (1.0 - 1e-3) * top:
                found = self._of_highest(peak.at, peak.blade, Ease(springs=peak.springs[-1]), None, EXACT)
                if found is not None and found.height >= peak.height:
                    heights = (*peak.heights[:-1], found.height)
                    out[i] = replace(peak, at=found.at, plane=found.plane, blade=found.blade, heights=heights)
        return out

    def _weakened(self, peak: _Climbed) -> _Climbed:
        """The same peak with the next springs, or with those on the way to them."""
        before = peak.springs[-1]
        target = next(springs for springs in WEAKER if springs < 0.99 * before)
        nearer = before * np.sqrt(WEAKER[1] / WEAKER[0])  # half of a step on the way
        for springs in (target, nearer) if nearer > max(1.01 * target, 0.2 * WEAKER[2]) else (target,):
            found = self._of_highest(peak.at, peak.blade, Ease(springs=springs), peak.plane)
            if found is not None:
                return replace(found, springs=(*peak.springs, springs), heights=(*peak.heights, found.height))
        return replace(peak, last=True)

    def _of_highest(
        self, start: Corrected, blade: int, ease: Ease, plane: Plane | None = None, gain: float = GAIN
    ) -> _Climbed | None:
        """A peak near a solution whose blade is the highest there, or None: where another one is, it is climbed next."""
        for _ in range(self.wheel.n_blades):
            found = climb(self.wheel, self.system, start.X, start.omega, blade, self.width, ease, gain, plane)
            if found is None or not self.band[0] <= found[0].omega <= self.band[1]:
                return None
            start, across = found
            highest, height = self._highest(start)
            if highest == blade:
                return _Climbed(start, across, blade, (ease.springs,), (height,))
            blade, plane = highest, None
        return None

    def _highest(self, at: Corrected) -> tuple[int, float]:
        heights = np.abs(self.wheel.response(at.X)[:, 1])
        return int(np.argmax(heights)), float(heights.max())


def climb(
    wheel: WheelProblem,
    system: WheelSystem,
    X: NDArray,
    omega: float,
    blade: int,
    width: float,
    ease: Ease = PLAIN,
    gain: float = GAIN,
    plane: Plane | None = None,
    most: int = 60,
) -> tuple[Corrected, Plane] | None:
    """Maximum of one blade's amplitude along the curve near a point, and the plane across it; None if it was not found.

    Or a place where another blade is higher than this one will be: on 65 blades (500 N, seed 1) 910 factorisations a peak
    in place of 1,544, and a higher one.

    Secant on the slope of the amplitude.  Places on the way are content with little: one factorisation serves the last
    correction of a place and its slope.  The last one is a solution, and its slope is its own.

    Parameters
    ----------
    X, omega : a loose solution
    blade : int
    width : float, rad/s
        Unit of the frequency along the curve.
    ease : Ease
    gain : float
        By how much the amplitude may still rise, relatively.
    plane : (normal, normal_omega), optional
        In which the first solution lies (:func:`~bdamper.wheel.newton.correct`); it has the frequency given without.  On
        13 blades, 500 N, planes across the curve lead peaks to weaker springs where that frequency has no solution.
    most : int
        Steps.
    """
    row = np.zeros(system.shape[2])
    row[: wheel.structure.n] = wheel.response_row
    place = correct(
        system, X, omega, plane=plane, ease=ease, tolerance=1e-6, most=25, line_search=True, content=NEAR, rough=ROUGH,
        longest=0.5 * size_of(X), free=6,
    )  # fmt: skip
    h, before, bent, bracket, reach, normal, known = 0.0, 0.0, 1.0, np.inf, 0.5, None, False
    for _ in range(most):
        if not place.converged:
            return None
        exact = place.residual <= TOLERANCE
        inverse = place.at.inverse() if exact or place.inverse is None else place.inverse
        tangent = _tangent(place, inverse, normal, width)
        if tangent is None:
            return None
        a, da = (Y[blade, 1] @ row - 1j * (Y[blade, 2] @ row) for Y in (place.X, tangent[0]))
        slope = float((np.conj(a) * da).real / abs(a) ** 2)
        if h:
            known, bent = True, (before - slope) / h
            if slope * before < 0.0:  # the slope may jump where a contact changes its state: halved at the least
                bracket = 0.5 * abs(h)
        furthest = min(bracket, 0.5)
        step = float(np.clip(slope / bent if bent > 0.0 else slope * np.inf, -furthest, furthest)) if slope else 0.0
        rest = 0.5 * abs(slope * step) if known else 5.0 * slope**2  # curves are bent by 0.1 to 10
        top = (bent > 0.0 or bracket < 0.5) and (rest < gain or abs(step) < LEAST)
        normal = plane_across(tangent, place.X, width, system)
        highest = float(np.abs(wheel.response(place.X)[:, 1]).max())
        if (top and exact) or (known and bent > 0.0 and abs(a) * (1.0 + 4.0 * rest) < 0.98 * highest):
            return place, normal
        if top:
            h, place = 0.0, _settled(place, inverse, normal, ease)
        else:
            before, tried = slope, float(np.clip(step, -reach, reach))
            h, place = _ahead(place, tangent, normal, tried, ease, gain < GAIN)
            reach = 3.0 * abs(h) if h == tried and place.iterations <= 2 else 1.5 * abs(h)
    return None


def _ahead(
    place: Corrected, tangent: tuple[NDArray, float], normal: Plane, h: float, ease: Ease, exact: bool
) -> tuple[float, Corrected]:
    """Distance and place ahead along the curve, nearer where none is found, which may not be converged."""
    first = abs(h)
    while True:
        guess = place.X + h * tangent[0]
        guess[:, 0] = place.X[:, 0]
        new = correct(
            place.at.system, guess, place.omega + h * tangent[1], normal, ease=ease, line_search=True, rough=ROUGH,
            tolerance=TOLERANCE if exact else 1e-6, most=12 if exact else 6, longest=size_of(place.X),
            content=0.0 if exact else SHARE * abs(h),
        )  # fmt: skip
        if new.converged or abs(h) < max(LEAST, 0.05 * first):
            return h, new
        h *= 0.3


def _settled(place: Corrected, inverse: Inverse, normal: Plane, ease: Ease) -> Corrected:
    """The solution at a place that is near it."""
    for shorten, most in ((False, 12), (True, 25)):
        new = correct(
            place.at.system, place.X, place.omega, normal, ease=ease, tolerance=TOLERANCE, most=most, line_search=shorten,
            inverse=None if shorten else inverse, longest=0.1 * size_of(place.X),
        )  # fmt: skip
        if new.converged:
            break
    return new


def _tangent(place: Corrected, inverse: Inverse, normal: Plane | None, width: float) -> tuple[NDArray, float] | None:
    """Direction of the curve, of length one in scaled unknowns, along the normal of the last plane or up in frequency."""
    plane = (np.zeros_like(place.X[..., place.at.system.constants.root]), 1.0) if normal is None else normal
    dX, d_omega, _ = solved(inverse.at, inverse, plane, 1e-4, (np.zeros_like(place.X), 1.0))
    length = float(np.sqrt(size_of(dX) ** 2 / size_of(place.X) ** 2 + (d_omega / width) ** 2))
    return (dX / length, d_omega / length) if np.isfinite(length) and np.isfinite(dX).all() else None
