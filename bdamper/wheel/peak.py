"""The highest peak of a wheel: a coarse sweep over the band of its blades, and climbs at several blades and frequencies.

The worst blade's peak is not that of the tuned wheel followed into mistuning, which loses it too often.  The sweep covers
the frequencies at which any wave of the tuned wheel, with the contacts as stiff as at the tuned peak, resonates, widened by
the deviations of the blades; its points, a share of the width of the tuned peak apart, satisfy the equations loosely, and
the mean of dampers is held by springs (:mod:`bdamper.wheel.solution`).  From the highest of its maxima, of different blades
or at different frequencies, Newton's method climbs to the peaks of single blades, which are smooth where the envelope is
not.  The highest of them is then followed to weaker springs, and to free dampers if it gets there.
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
from bdamper.wheel.solution import SPRINGS, Solver
from bdamper.wheel.system import PLAIN, Ease, WheelSystem
from bdamper.wheel.track import TOLERANCE, TWO_PI, cost_of, size_of

PLACE = 3e-4
"""Place of a peak along the curve, relative to the vibration: its amplitude is off by some 1e-7 then."""
FAR = 1.5
"""Ratio to the frequency of the tuned peak beyond which a wave of another nodal diameter counts as of another family."""


HELD = Ease(springs=SPRINGS)
WEAKER = (1e-1, 1e-2, 0.0)
"""Springs on the mean of dampers with which the highest peak is looked for one after the other."""


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
    climbs: int = 3
    loose: float = 0.05
    least: int = 30
    most: int = 300

    def __post_init__(self) -> None:
        validate.fields(self, validate.number, "spacing", "loose", above=0.0, most=10.0)
        validate.fields(self, validate.whole, "climbs", "least", "most", least=1)


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
        ``status`` is "converged" if a peak was found with dampers free, and the sweep has solutions at all frequencies but
        single ones.  It is "lower bound" if the sweep has none at two and more in a row, which ``reason`` names; "held" if
        the peak was found only with springs on the mean of dampers, ``springs`` of their stiffness when stuck; and "not
        found", the amplitude NaN, if no climb converges.  Which peak is the highest is decided with dampers held.
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
    n = int(np.clip(np.ceil((high - low) / (options.spacing * width)) + 1, options.least, options.most))
    points = TWO_PI * np.linspace(low, high, n)
    swept, missing = _sweep(system, mean, points, options.loose)
    gap = _gap(points, missing)
    climbs: list[tuple[float, float, float]] = []
    best: Corrected | None = None
    height, blade, springs = np.nan, -1, 0.0
    queue = _candidates(wheel, swept, options.climbs)
    while queue:
        X, omega, k = queue.pop(0)
        found = climb(wheel, system, X, omega, k, TWO_PI * width, HELD)
        if found is None:
            continue
        heights = np.abs(wheel.response(found.X)[:, 1])
        climbs.append((float(k), found.omega / TWO_PI, float(heights[k])))
        if best is None or heights.max() > height:
            best, height, blade = found, float(heights.max()), int(np.argmax(heights))
            if blade != k:  # the peak of whichever blade is highest there
                queue.insert(0, (found.X, found.omega, blade))
    if best is not None:
        best, springs = _freed(wheel, system, best, blade, TWO_PI * width)
        heights = np.abs(wheel.response(best.X)[:, 1])
        height, blade = float(heights.max()), int(np.argmax(heights))
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
        status=_status(best, springs, gap),
        reason=_reason(springs, gap, f"{len(climbs)} peaks climbed from {len(swept)} of {n} points"),
        residual=np.nan if best is None else best.residual,
        springs=springs,
        deviation=wheel.mistuning.deviation.reshape(wheel.n_blades, -1),
        unknowns=np.zeros(system.shape) if best is None else best.X,
        cost=cost_of(system, watch, before),
        settings=wheel.settings(),
        model_hash=wheel.study.model.hash,
    )


def _status(best: Corrected | None, springs: float, gap: tuple[float, float] | None) -> str:
    if best is None:
        return "not found"
    return "lower bound" if gap else "held" if springs else "converged"


def _sweep(system: WheelSystem, mean: NDArray, omega: NDArray, loose: float) -> tuple[list[tuple[NDArray, float]], NDArray]:
    """Loose solutions with dampers held, ascending, each from the one before; and the frequencies (rad/s) without any.

    Newton's first step from a solution nearby is that of the linear wheel with the contacts as they are there, which is
    what resonances between both frequencies need; extrapolation would pass over them.
    """
    X = np.zeros(system.shape)
    X[:, 0] = mean
    X[system.still] = 0.0
    solver, out, missing = Solver(system, HELD), [], []
    for w in omega:
        found = solver.at(w, X, 1e-6, loose)
        if found is None:
            missing.append(w)
            continue
        X = found.X
        out.append((X, float(w)))
    return out, np.array(missing)


def _gap(omega: NDArray, missing: NDArray) -> tuple[float, float] | None:
    """Ends of the longest part of a band with two and more frequencies in a row that have no solution."""
    lost = np.concatenate([[False], np.isin(omega, missing), [False]])
    begin, end = np.flatnonzero(lost[1:] & ~lost[:-1]), np.flatnonzero(~lost[1:] & lost[:-1])
    if not len(begin) or (end - begin).max() < 2:
        return None
    k = int(np.argmax(end - begin))
    return float(omega[begin[k]]), float(omega[end[k] - 1])


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


def _reason(springs: float, gap: tuple[float, float] | None, found: str) -> str:
    parts = [found]
    if springs:
        parts.append(f"the mean of dampers held by springs of {springs:.2g} of their stuck stiffness")
    if gap is not None:
        parts.append(f"no solution found between {gap[0] / TWO_PI:.6g} and {gap[1] / TWO_PI:.6g} Hz")
    return "; ".join(parts)


def _freed(wheel: Any, system: WheelSystem, held: Corrected, blade: int, width: float) -> tuple[Corrected, float]:
    """The same peak with the weakest springs on the mean of dampers with which it is found, and those springs."""
    best, left = held, HELD.springs
    for springs in WEAKER:
        found = _of_highest(wheel, system, best, blade, width, Ease(springs=springs))
        if found is None:
            break
        best, left, blade = found, springs, _highest(wheel, found)
    return best, left


def _of_highest(
    wheel: Any, system: WheelSystem, start: Corrected, blade: int, width: float, ease: Ease
) -> Corrected | None:
    """A peak near a solution whose blade is the highest there, or None: where another one is, it is climbed next."""
    for _ in range(wheel.n_blades):
        found = climb(wheel, system, start.X, start.omega, blade, width, ease)
        if found is None or _highest(wheel, found) == blade:
            return found
        start, blade = found, _highest(wheel, found)
    return None


def _highest(wheel: Any, at: Corrected) -> int:
    return int(np.argmax(np.abs(wheel.response(at.X)[:, 1])))


def climb(
    wheel: Any, system: WheelSystem, X: NDArray, omega: float, blade: int, width: float, ease: Ease = PLAIN, most: int = 60
) -> Corrected | None:
    """Maximum of one blade's amplitude along the curve near a point: secant on its slope; None if it was not found.

    A step is at most twice the last one that Newton's method could take, which saves 40 % of the longest climbs (65 blades,
    500 N).

    Parameters
    ----------
    X, omega : a loose solution
    blade : int
    width : float, rad/s
        First step at most.
    ease : Ease
    most : int
        Steps.
    """
    row = np.zeros(system.shape[2])
    row[: wheel.structure.n] = wheel.response_row
    place = correct(system, X, omega, ease=ease, tolerance=1e-6, most=25, line_search=True)
    if not place.converged:
        return None

    def amplitude(at: Corrected) -> float:
        return float(abs(at.X[blade, 1] @ row - 1j * (at.X[blade, 2] @ row)))

    wanted, best, h, before, cap, reach, normal = np.inf, place, 0.0, np.nan, 0.5, 0.5, None
    for _ in range(most):
        tangent = _tangent(place, normal)
        if tangent is None:
            return None
        unit = size_of(place.X)
        length = np.sqrt(size_of(tangent[0]) ** 2 / unit**2 + (tangent[1] / width) ** 2)
        tangent = tangent[0] / length, tangent[1] / length
        a, da = (Y[blade, 1] @ row - 1j * (Y[blade, 2] @ row) for Y in (place.X, tangent[0]))
        slope = float((np.conj(a) * da).real / abs(a) ** 2)
        if slope * before < 0.0:  # the slope may jump where a contact changes its state: halved at the least
            cap = 0.5 * abs(h)
        curvature = (slope - before) / h if h and slope != before else -8.0
        h = float(np.clip(-slope / curvature if curvature < 0.0 else 0.4 * np.sign(slope), -cap, cap))
        wanted = abs(h)
        h = float(np.clip(h, -reach, reach))
        tried = abs(h)
        if wanted < PLACE:
            break
        normal, new = _plane(tangent, unit, width), None
        while abs(h) > 0.1 * PLACE:
            guess = place.X + h * tangent[0]
            guess[:, 0] = place.X[:, 0]
            new = correct(
                system, guess, place.omega + h * tangent[1], normal, ease=ease, tolerance=1e-6, most=6,
                inverse=place.inverse, longest=size_of(place.X),
            )  # fmt: skip
            if new.converged:
                break
            h *= 0.4
        if new is None or not new.converged:
            break
        before, place = slope, new
        reach = 2.0 * tried if abs(h) == tried else abs(h)
        best = place if amplitude(place) > amplitude(best) else best
    done = correct(system, best.X, best.omega, ease=ease, tolerance=TOLERANCE, most=25, line_search=True)
    at_top = wanted < 10.0 * PLACE or cap < 10.0 * PLACE
    return done if done.converged and at_top else None


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
