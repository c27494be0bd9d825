"""The highest peak with no more effects than it calls for.

The settings of the study are the answer that counts; what they would cost is spared where the indicator
(:mod:`bdamper.indicator`) shows that it does not matter:

1. a coarse tracking curve with one harmonic, everything else as in the study;
2. every maximum that comes near the highest is refined;
3. each is embedded in the full study.  The change that the full study would make is a sum over its harmonics,
   ``dA = -sum_l lambda_l . R_l``: the harmonics that make it up are switched on, the peak is found anew from the Newton
   step that the estimate comes with, and the question is put again;
   Where that is not where the estimate would have it, the richer curve may have other maxima close by: it is followed
   to both sides of the peak;
4. the peak is accepted once the estimated rest is below half of the tolerance, or nothing is left to switch on.

If a peak cannot be carried over, if several maxima compete and one harmonic is not enough, or if the coarse curve does
not reach through the interval, a curve is followed with everything on, and not coarsely.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation import ContinuationOptions
from bdamper.effects import Effects
from bdamper.errors import SettingError
from bdamper.indicator import TRUSTED, Estimate, amplitude_and_phase, embed_between, estimate_change, highest_peaks
from bdamper.peaks import Peak, PeakOptions, coarse_options, find_peak, peak_scale
from bdamper.system import OK, Cost, HarmonicSystem

if TYPE_CHECKING:
    from bdamper.response import Curve
    from bdamper.study import Study

MARGIN = 0.5
"""Share of the tolerance that an accepted estimate may use up."""
SURPRISE = 0.05
"""Relative difference between a change and its estimate beyond which there may be another maximum close by."""
ANOTHER = 0.5
"""Relative change of amplitude beyond which it is another peak."""
LOOSE = PeakOptions(tolerance=1e-8, position_tolerance=1e-3)


@dataclass(frozen=True)
class AdaptivePeak:
    """The highest peak of a study, found with no more effects than it calls for.

    Parameters
    ----------
    preload : float, N
    frequency, amplitude : float, Hz, m
    effects : Effects
        Those that were on in the end.
    y : (n_unknowns + 1,) float
        The converged solution under these effects.
    amplitude_error, frequency_error : float
        Estimated relative change that the full study would still make; 0 if all is on.
    error_bound : float
        Size of the remaining change, defect of the estimate included.
    tolerance : float
    residual : float
    status, reason : str
        "converged", or what is wrong.
    log : tuple of str
        What was switched on, and why.
    seconds : float
    """

    preload: float
    frequency: float
    amplitude: float
    effects: Effects
    y: NDArray
    amplitude_error: float
    frequency_error: float
    error_bound: float
    tolerance: float
    residual: float
    status: str
    reason: str
    log: tuple[str, ...] = ()
    seconds: float = field(default=0.0, compare=False)

    @property
    def converged(self) -> bool:
        return self.status == "converged"

    def __str__(self) -> str:
        if not self.converged:
            return f"no peak: {self.status} ({self.reason})"
        return (
            f"peak {self.amplitude:.6g} m at {self.frequency:.6g} Hz, preload {self.preload:g} N, harmonics "
            f"{' '.join(map(str, self.effects.harmonic_numbers))}; everything on would change it by about "
            f"{100 * self.amplitude_error:+.2g} % and {100 * self.frequency_error:+.2g} % (tolerance "
            f"{100 * self.tolerance:g} %)"
        )


@dataclass
class _Candidate:
    """A peak under some effects, with the estimate of what the full study would change."""

    peak: Peak
    study: Study
    estimate: Estimate | None  # None: nothing is left out


class _Search:
    def __init__(self, study: Study, preload: float, frequency: tuple[float, float], tolerance: float) -> None:
        self.study = study
        self.own = Effects.of(study)
        self.preload = preload
        self.frequency = frequency
        self.tolerance = tolerance
        self.log: list[str] = []
        self.curve: Curve
        self.variants: dict[tuple[int, ...], tuple[Study, HarmonicSystem]] = {}

    def variant(self, harmonics: tuple[int, ...]) -> tuple[Study, HarmonicSystem]:
        if harmonics not in self.variants:
            study = self.study
            if harmonics != self.own.harmonic_numbers:
                study = study.with_effects(replace(self.own, harmonics=harmonics))
            self.variants[harmonics] = study, study.system(self.preload)
        return self.variants[harmonics]

    def tracked(self, harmonics: tuple[int, ...], coarse: bool = True) -> tuple[list[Peak], str]:
        study, system = self.variant(harmonics)
        curve = study.track(self.preload, self.frequency, options=coarse_options() if coarse else None)
        if coarse and not curve.complete:
            curve = study.track(self.preload, self.frequency)
        self.curve = curve
        peaks = highest_peaks(system, curve, options=LOOSE)
        top = f"{peaks[0].amplitude:.4g} m at {peaks[0].frequency:.5g} Hz" if peaks else "none"
        self.log.append(f"curve with harmonics {_names(harmonics)}: {curve.status}, {len(curve)} points, peak {top}")
        if peaks:
            return peaks, ""
        if len(curve):
            return [], f"the response has no maximum inside the interval ({curve.status}: {curve.reason})"
        return [], curve.reason

    def missing(self, peak: Peak, harmonics: tuple[int, ...]) -> Estimate | None:
        """What the full study would change, None if nothing is missing."""
        if harmonics == self.own.harmonic_numbers:
            return None
        study, system = self.variant(harmonics)
        full, rich = self.variant(self.own.harmonic_numbers)
        y = embed_between(study, full, system, rich, self.preload, peak.y)
        return estimate_change(rich, y)

    def called_for(self, estimate: Estimate, on: tuple[int, ...]) -> tuple[int, ...]:
        """Harmonics to have on: those that are, and those that make up the estimated change."""
        share = np.abs(estimate.shares)
        off = sorted((l for l in self.own.harmonic_numbers if l not in on), key=lambda l: share[l])
        rest = 0.0
        leave: list[int] = []
        for l in off[:-1]:  # at least one more
            rest += float(share[l])
            if not rest < 0.25 * self.tolerance:
                break
            leave.append(l)
        return tuple(l for l in self.own.harmonic_numbers if l not in leave)

    def lift(self, peak: Peak, harmonics: tuple[int, ...]) -> tuple[Peak, tuple[int, ...], Estimate | None]:
        """The peak with as many harmonics as it calls for."""
        while True:
            estimate = self.missing(peak, harmonics)
            if estimate is None or estimate.size <= MARGIN * self.tolerance:
                return peak, harmonics, estimate
            wanted = self.own.harmonic_numbers
            if np.isfinite(estimate.size) and estimate.size < 0.3:
                wanted = self.called_for(estimate, harmonics)
            self.log.append(
                f"{peak.frequency:.5g} Hz: estimated change {100 * estimate.amplitude:+.2g} %, "
                f"{100 * estimate.frequency:+.2g} %, may miss {100 * estimate.defect:.2g} %: harmonics {_names(wanted)}"
            )
            full, rich = self.variant(self.own.harmonic_numbers)
            old, before = self.variant(harmonics)
            study, system = self.variant(wanted)
            start = embed_between(old, study, before, system, self.preload, peak.y)
            guesses = [embed_between(full, study, rich, system, self.preload, estimate.y)] if estimate.size < 0.3 else []
            found = carried_over(system, [*guesses, start], start, peak.scale[-1])
            if found is None:
                found = self.climbed(peak, harmonics, wanted)
            if found is not None and abs(found.amplitude / peak.amplitude - 1.0 - estimate.amplitude) > SURPRISE:
                found = higher_nearby(system, found)
            if found is None or abs(found.amplitude / peak.amplitude - 1.0) > ANOTHER:
                raise _Lost(f"{peak.frequency:.5g} Hz: the peak is not found with harmonics {_names(wanted)}")
            peak, harmonics = found, wanted

    def climbed(self, peak: Peak, harmonics: tuple[int, ...], wanted: tuple[int, ...]) -> Peak | None:
        """The peak with the wanted harmonics by way of fewer."""
        old, before = self.variant(harmonics)
        way = [wanted[:n] for n in range(len(harmonics) + 1, len(wanted), max(1, (len(wanted) - len(harmonics)) // 2))]
        for on in [*way, wanted]:
            study, system = self.variant(on)
            start = embed_between(old, study, before, system, self.preload, peak.y)
            found = carried_over(system, [start], start, peak.scale[-1], quick=True)
            if found is None:
                if on == wanted:
                    return None
                continue
            peak, old, before = found, study, system
        return peak


def carried_over(
    system: HarmonicSystem, guesses: list[NDArray], start: NDArray, width: float, quick: bool = False
) -> Peak | None:
    """The peak of a system near that of a simpler one, ``start``.

    Newton is tried at the phase of the simpler peak, which follows a resonance that moves, from each guess and then with
    line search; then, unless ``quick``, at its frequency.
    """
    _, normal, _ = amplitude_and_phase(system, start[:-1])
    scale = peak_scale(system, start, width)
    phase = np.append(normal, 0.0) * scale
    phase /= np.linalg.norm(phase)
    fixed = np.zeros(len(start))
    fixed[-1] = 1.0
    tries = [(guess, phase, False) for guess in guesses]
    tries += [(start, phase, True)] if quick else [(start, phase, True), (start, fixed, False), (start, fixed, True)]
    for guess, plane, search in tries:
        c = system.correct(guess, plane, scale, 1e-6, 25 if search else LOOSE.max_iterations, search)
        if c.status == OK and _near(c.y, start, scale):
            peak = find_peak(system, c.y, options=LOOSE, walk=False)
            if peak.converged:
                return peak
    return None


def higher_nearby(system: HarmonicSystem, peak: Peak, share: float = 0.93) -> Peak:
    """The highest of the maxima that follow each other without a dip below a share of it."""
    best = peak
    for sense in (1.0, -1.0):
        y, tangent, step = peak.y, sense * peak.tangent, 0.25
        row = system.response_rows[1]
        for _ in range(14):
            c = system.correct(y + step * tangent * peak.scale, tangent, peak.scale, 1e-6, LOOSE.max_iterations)
            moved = (c.y - y) / peak.scale
            if c.status != OK or np.linalg.norm(moved - step * tangent) > 0.6 * step or float(c.tangent @ tangent) < 0.0:
                step *= 0.5
                if step < 0.03:
                    break
                continue
            y, tangent = c.y, c.tangent
            amplitude = float(abs(system.amplitudes(y[:-1], 1) @ row))
            if amplitude < share * best.amplitude:
                break
            if amplitude > best.amplitude:
                higher = find_peak(system, y, tangent=tangent, scale=peak.scale, options=LOOSE, walk=False)
                if higher.converged and higher.amplitude > best.amplitude:
                    best = higher
            step = min(0.4, 1.5 * step)
    return best


def _near(y: NDArray, start: NDArray, scale: NDArray) -> bool:
    return abs(y[-1] / start[-1] - 1.0) < 0.2 and float(np.linalg.norm((y - start)[:-1] / scale[:-1])) < 2.0


class _Lost(Exception):
    """A peak could not be followed into a richer study."""


def adaptive_peak(
    study: Study, preload: float, frequency: tuple[float, float], *, tolerance: float = 0.01
) -> AdaptivePeak:
    """The highest peak of a study to a tolerance, with only the harmonics that it calls for.

    Parameters
    ----------
    study : Study
        With everything on that is to be taken into account.
    preload : float, N
    frequency : (low, high), Hz
    tolerance : float
        On amplitude and frequency, relative.

    Returns
    -------
    AdaptivePeak
    """
    _check_tolerance(tolerance)
    begin = time.perf_counter()
    search = _Search(study, float(preload), frequency, tolerance)
    best: tuple[Peak, tuple[int, ...], Estimate | None] | None = None
    peaks, reason = search.tracked((1,))
    if not search.curve.complete:
        peaks = []  # what it has not reached may be higher
    try:
        for peak in peaks:
            lifted = search.lift(peak, (1,))
            if best is None or lifted[0].amplitude > best[0].amplitude:
                best = lifted
    except _Lost as lost:
        search.log.append(str(lost))
        best = None
    everything = search.own.harmonic_numbers
    several = len(peaks) > 1 and best is not None and best[1] != (1,)
    if everything != (1,) and (best is None or several):
        peaks, reason = search.tracked(everything, coarse=not peaks and search.curve.complete)
        if peaks and (best is None or peaks[0].amplitude > best[0].amplitude):
            best = peaks[0], everything, None
    seconds = time.perf_counter() - begin
    if best is None:
        nothing = np.zeros(0)
        return AdaptivePeak(
            float(preload), np.nan, np.nan, search.own, nothing, np.nan, np.nan, np.nan, tolerance, np.nan, "no peak",
            reason, tuple(search.log), seconds,
        )  # fmt: skip
    peak, harmonics, estimate = best
    change = (0.0, 0.0, 0.0) if estimate is None else (estimate.amplitude, estimate.frequency, estimate.size)
    return AdaptivePeak(
        float(preload), peak.frequency, peak.amplitude, Effects.of(search.variant(harmonics)[0]), peak.y, *change,
        tolerance, peak.residual, "converged", "", tuple(search.log), seconds,
    )  # fmt: skip


def _check_tolerance(tolerance: float) -> None:
    if not 0.0 < tolerance < 1.0:
        raise SettingError(f"tolerance: expected between 0 and 1, found {tolerance}")


def _names(harmonics: tuple[int, ...]) -> str:
    return " ".join(map(str, harmonics))


# ---- curves ----


def adaptive_curve(
    study: Study,
    preload: float,
    frequency: tuple[float, float],
    *,
    tolerance: float = 0.01,
    options: ContinuationOptions | None = None,
) -> Curve:
    """A tracking curve with one harmonic where that is enough, and with those called for elsewhere.

    Parameters
    ----------
    study : Study
        With everything on that is to be taken into account.
    preload : float, N
    frequency : (low, high), Hz
    tolerance : float
        On amplitude and frequency at the same phase of the response, relative, at every point.
    options : ContinuationOptions

    Returns
    -------
    Curve
        In the unknowns of the full study, zero where a harmonic is off.  ``settings["adaptive"]`` holds the intervals with
        their harmonics and the largest estimated error that remains.  Branches are the pieces that were followed in one
        go; where one ends and the next begins they differ by less than the tolerance.
    """
    _check_tolerance(tolerance)
    begin = time.perf_counter()
    search = _Search(study, float(preload), frequency, tolerance)
    everything = search.own.harmonic_numbers
    cheap, _ = search.variant((1,))
    curve = cheap.track(preload, frequency, options=options)
    if not curve.complete or everything == (1,):
        whole = study.track(preload, frequency, options=options)
        return _noted(whole, tolerance, [(*frequency, everything)], 0.0, curve, begin)
    at, estimates = _sampled_estimates(search, curve, (1,))
    windows = _windows(curve, at, estimates, search, frequency)
    pieces: list[Curve] = []
    used: list[tuple[float, float, tuple[int, ...]]] = []
    rest = 0.0
    for low, high, harmonics in windows:
        for wanted in dict.fromkeys((harmonics, everything)):
            piece = search.variant(wanted)[0].track(preload, (low, high), options=options)
            _, left = _sampled_estimates(search, piece, wanted)
            error = max((e.size for e in left), default=0.0)
            if wanted == everything or (piece.complete and error <= tolerance):
                break
        pieces.append(_widened(search, piece, wanted))
        used.append((low, high, wanted))
        rest = max(rest, error)
    outside = np.ones(len(curve), bool)
    for low, high, _ in windows:
        outside &= (curve.frequency < low) | (curve.frequency > high)
    calm = [e.size for i, e in zip(at, estimates) if outside[i]]
    rest = max(rest, max(calm, default=0.0))
    base = _widened(search, curve, (1,))
    return _noted(_joined(base, outside, pieces), tolerance, used, rest, curve, begin)


def _sampled_estimates(search: _Search, curve: Curve, on: tuple[int, ...]) -> tuple[list[int], list[Estimate]]:
    """Estimates at every few points of a curve and at its maxima and folds; none where nothing is left out."""
    if on == search.own.harmonic_numbers:
        return [], []
    study, system = search.variant(on)
    full, rich = search.variant(search.own.harmonic_numbers)
    at = [i for i in range(len(curve)) if i % 3 == 0 or curve.point_kind[i] in ("maximum", "fold") or i == len(curve) - 1]
    out = []
    for i in at:
        y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
        out.append(estimate_change(rich, embed_between(study, full, system, rich, search.preload, y)))
    return at, out


def _windows(
    curve: Curve, at: list[int], estimates: list[Estimate], search: _Search, frequency: tuple[float, float]
) -> list[tuple[float, float, tuple[int, ...]]]:
    """Frequency intervals in which more than one harmonic is called for, and which."""
    spans: list[tuple[float, float, tuple[int, ...]]] = []
    everything = search.own.harmonic_numbers
    for k, e in enumerate(estimates):
        if e.size <= MARGIN * search.tolerance:
            continue
        first, last = at[max(k - 1, 0)], at[min(k + 1, len(at) - 1)]
        f = curve.frequency[first : last + 1]
        wanted = search.called_for(e, (1,)) if e.size < TRUSTED else everything
        spans.append((float(f.min()), float(f.max()), wanted))
    spans.sort()
    close = 0.03 * (frequency[1] - frequency[0])
    out: list[tuple[float, float, tuple[int, ...]]] = []
    for low, high, wanted in spans:
        if out and low <= out[-1][1] + close:
            union = tuple(sorted({*out[-1][2], *wanted}))
            out[-1] = (out[-1][0], max(out[-1][1], high), union)
        else:
            out.append((low, high, wanted))
    return [(low, high, wanted) for low, high, wanted in out if high > low]


def _widened(search: _Search, curve: Curve, on: tuple[int, ...]) -> Curve:
    """The curve in the unknowns of the full study."""
    if on == search.own.harmonic_numbers:
        return curve
    study, system = search.variant(on)
    full, rich = search.variant(search.own.harmonic_numbers)
    unknowns = np.zeros((len(curve), rich.n_unknowns))
    for i in range(len(curve)):
        y = np.append(curve.unknowns[i], 0.0)
        unknowns[i] = embed_between(study, full, system, rich, search.preload, y)[:-1]
    return replace(curve, unknowns=unknowns, harmonics=rich.response(unknowns))


def _joined(base: Curve, outside: NDArray, pieces: list[Curve]) -> Curve:
    """Points of the base curve outside of the windows, and the pieces, each followed in one go a branch of its own."""
    parts: list[tuple[Curve, NDArray]] = []
    # runs of the base curve between windows
    cuts = np.flatnonzero(np.diff(outside.astype(int))) + 1
    for run in np.split(np.arange(len(base)), cuts):
        if len(run) and outside[run[0]]:
            parts.append((base, run))
    parts += [(piece, np.arange(len(piece))) for piece in pieces if len(piece)]
    parts.sort(key=lambda p: float(p[0].frequency[p[1]].min()))
    branch: list[NDArray] = []
    for curve, index in parts:
        own = curve.branch[index]
        branch.append(own - own.min() + (branch[-1].max() + 1 if branch else 0))

    names = ("frequency", "harmonics", "unknowns", "residual", "shares", "backward", "rank_deficiency")
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(curve, name)[index] for curve, index in parts]) for name in names
    }
    stable = [None if curve.stable is None else curve.stable[index] for curve, index in parts]
    judged = [s for s in stable if s is not None]
    arrays["stable"] = np.concatenate(judged) if judged and len(judged) == len(stable) else None
    bad = [piece for piece in pieces if not piece.complete]
    return replace(
        base,
        **arrays,
        branch=np.concatenate(branch),
        point_kind=tuple(curve.point_kind[i] for curve, index in parts for i in index),
        status="incomplete" if bad else base.status,
        reason="; ".join(piece.reason for piece in bad) if bad else base.reason,
        start_log=tuple(line for curve in [base, *pieces] for line in curve.start_log),
        notes=tuple(dict.fromkeys(line for curve in [base, *pieces] for line in curve.notes)),
        cost=_summed([base.cost, *(piece.cost for piece in pieces)]),
        settings={**(pieces[0] if pieces else base).settings},
    )


def _summed(costs: list[Cost]) -> Cost:
    return Cost(*(sum(getattr(c, f.name) for c in costs) for f in fields(Cost)))


def _noted(
    curve: Curve,
    tolerance: float,
    windows: list[tuple[float, float, tuple[int, ...]]],
    error: float,
    first: Curve,
    begin: float,
) -> Curve:
    note = {
        "tolerance": tolerance,
        "intervals": [{"from": low, "to": high, "harmonics": list(on)} for low, high, on in windows],
        "estimated_error": error,
        "points_with_one_harmonic": len(first),
    }
    cost = replace(curve.cost, seconds=time.perf_counter() - begin)
    return replace(curve, settings={**curve.settings, "adaptive": note}, cost=cost)
