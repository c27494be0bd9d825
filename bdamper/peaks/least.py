"""The preload at which the highest resonance peak is least, and whether whole tracking curves agree.

The highest peak over the preload is the envelope of all branches of peaks (:mod:`bdamper.peaks.envelope`).  Its least
value (:func:`least_peak`) is a root of the adjoint sensitivity where the envelope is smooth there, the point of equal
height where two peaks cross, or the place of the jump where a higher peak vanishes, found to a relative 1e-7.

Branches that are not known cannot be followed.  So the whole tracking curve is taken where the least value is
(:func:`verified_optimum`): a higher peak on it joins the known ones, is followed to both sides, and the search goes on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bdamper.peaks.branch import Branch
from bdamper.peaks.envelope import SAME_PRELOAD, PeakEnvelope
from bdamper.peaks.follower import LOST, PeakFollower
from bdamper.peaks.newton import Peak, same_peak
from bdamper.peaks.optimal_curve import INTERRUPTED, NOT_COMPARED, NOT_VERIFIED, OptimumPoint
from bdamper.peaks.sensitivity import amplitude_sensitivity
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.rootfind import find_root

OPTIMUM_TOLERANCE = 1e-7
"""Relative, on the preload of the optimum."""
FLAT = 1e-6
"""Relative range of the resonance amplitude over all preloads below which the curve has no optimum."""
NEAR = 0.95
"""Branches below this share of the highest peak at both ends of a bracket are evaluated only once, at the optimum found.
With all of them always evaluated three curves of the shipped disk (9 points, one harmonic) keep their optimum, for up to
1.6 % more evaluations."""
ROUNDS = 8
"""Times that a least value is compared with a whole curve at most; they were enough for all of 24 curves of the shipped
disk (9 points, one harmonic, 3 and 30 preloads)."""
CORNER_STEP = 1e-4
"""Relative step in the preload with which a peak at a corner of its curve is followed to learn its slope: the difference is
off by the square of it, and by the error of the amplitudes over it."""
NARROW = 0.02
"""Relative, on the preload, to which the place of a least value has to be known to be called verified; at a slope of one
the amplitude there changes by as much."""
BESIDE = 1e-3
"""Relative distance from a jump at which a curve is taken, on the side where the higher peak is gone: far beyond the 1e-7
to which the place is known, and at a slope of one a change of the amplitude by half of AGREES."""
LOWER = 0.05
"""Relative, by which the tangents of peaks have to lead below the least value known for the search to go on there: the
tolerance by which a ladder calls an optimum converged.  24 curves of the shipped disk (9 points, one harmonic) keep their
optimum, with 30 preloads for 1.2 % more evaluations, with 3 for 11 %. With 0.002 one of three harmonics among folds takes
ten times as long for an optimum that is 0.7 % lower."""
BETWEEN = 12
"""Preloads that are added at most where the least value may lie between two others; 24 curves of the shipped disk took two
at most."""
AGREES = 2e-3
"""Relative difference of amplitudes up to which a curve agrees with the least value: twice what lies between it and a curve
taken BESIDE a jump at a slope of one."""


class _Unknown(ArithmeticError):
    """The search for the least value meets a preload where the highest peak is not known."""

    def __init__(self, preload: float, why: str) -> None:
        super().__init__(why)
        self.preload = preload


class _Place(NamedTuple):
    """Highest peak at one preload: ln(preload), number of the branch, the peak and d ln(amplitude)/d ln(preload)."""

    x: float
    branch: int
    peak: Peak
    slope: float


class _Minimum:
    """The search for the least value of the envelope."""

    def __init__(self, known: PeakEnvelope) -> None:
        self.known = known
        self.options = replace(known.options, position_tolerance=min(known.options.position_tolerance, 1e-8))
        self.cache: dict[float, list[tuple[int, Peak]]] = {}

    def at(self, x: float, every: bool = False) -> _Place:
        """Highest peak at a preload of exp(x) newtons, with ``every`` also of branches that are low at both neighbours."""
        p = float(np.exp(x))
        if every or x not in self.cache:
            grid = np.log(self.known.preload)
            k = int(np.clip(np.searchsorted(grid, x), 1, len(grid) - 1))
            places = next(((i,) for i in (k - 1, k) if abs(grid[i] - x) < 1e-13), (k - 1, k))
            found = []
            for branch in self.known.branches:
                if any(self.known.isolated(branch, i) for i in places):
                    continue
                near = [branch.peaks[i] for i in places if i in branch.peaks]
                near += [q for list_ in self.cache.values() for number, q in list_ if number == branch.number]
                if not near or not (every or self.is_high(branch, places)):
                    continue
                near.sort(key=lambda q: -abs(np.log(q.parameter) - x))
                exact = abs(np.log(near[-1].parameter) - x) < 1e-13
                peak = near[-1] if exact else self.followed(near, p)
                if peak is not None and self.known.within(peak):
                    found.append((branch.number, peak))
            if not found:
                raise _Unknown(p, f"no peak could be followed to {p:.8g} N")
            self.cache[x] = sorted(found, key=lambda item: -item[1].amplitude)
        number, peak = self.cache[x][0]
        return _Place(x, number, peak, self.slope(peak, p))

    def slope(self, peak: Peak, p: float) -> float:
        """d ln(amplitude)/d ln(preload): of a peak at a corner of its curve, which has no adjoint, by differences."""
        if not peak.corner:
            return amplitude_sensitivity(peak, self.known.family, p, self.options) * p / peak.amplitude
        beside = [self.followed([peak], p * float(np.exp(h))) for h in (-CORNER_STEP, CORNER_STEP)]
        if beside[0] is None or beside[1] is None:
            raise _Unknown(p, f"the peak at {p:.8g} N lies at a corner of the curve and could not be followed")
        return float(np.log(beside[1].amplitude / beside[0].amplitude)) / (2.0 * CORNER_STEP)

    def is_high(self, branch: Branch, places: tuple[int, ...]) -> bool:
        """Whether a branch comes near the highest peak at one of two neighbouring preloads."""
        for k in places:
            top = self.known.highest(k)
            if k in branch.peaks and top is not None and branch.peaks[k].amplitude >= NEAR * top[1].amplitude:
                return True
        return False

    def followed(self, near: list[Peak], p: float) -> Peak | None:
        """The peak of a branch at a preload, followed from the nearest ones known; None if it does not get there."""
        distinct = {q.parameter: q for q in near}
        follower = PeakFollower(self.known.family, list(distinct.values())[-3:], self.options, self.known.limits)
        peak = follower.go(p)
        self.known.meter.iterations += follower.iterations
        return peak

    def continues(self, near: _Place, far: _Place) -> bool:
        """Whether two places have the same peak on top, which branches of different scans may both hold."""
        there = self.cache[far.x]
        return any(number == near.branch and same_peak(peak, far.peak) for number, peak in there)

    def between(self, near: _Place, far: _Place) -> OptimumPoint:
        """Least value of the envelope between two places: it falls from ``near`` toward ``far``, which is not lower."""
        sense = np.sign(far.x - near.x)
        start, length = near.x, abs(far.x - near.x)

        def slope(t: float) -> float:
            nonlocal near, far
            place = self.at(start + sense * t)
            falls = place.slope * sense < 0.0 and place.peak.amplitude <= near.peak.amplitude * (1.0 + 1e-12)
            if falls:
                near = place
            else:
                far = place
            return -abs(place.slope) if falls else abs(place.slope)

        ends = (0.0, -abs(near.slope)), (length, abs(far.slope))
        root = find_root(slope, *ends, OPTIMUM_TOLERANCE)
        meeting = far.slope * sense >= 0.0  # the envelope also falls from far toward near
        kind = "jump" if not meeting else ("smooth" if self.continues(near, far) else "crossing")
        best = near
        if kind == "smooth":
            best = min(near, far, key=lambda place: abs(place.slope))
        elif far.peak.amplitude < near.peak.amplitude:
            best = far
        if kind != "jump" and self.at(best.x, every=True).peak.amplitude > best.peak.amplitude * (1.0 + 1e-9):
            raise _Unknown(best.peak.parameter, "another peak is higher there")
        return OptimumPoint(best.peak.parameter, best.peak.amplitude, best.peak.frequency, kind, root.step)


def least_peak(known: PeakEnvelope) -> OptimumPoint:
    """The preload at which the highest peak is least.

    Parameters
    ----------
    known : PeakEnvelope
        Peaks at all its preloads.

    Raises
    ------
    BdamperError
        If no peak is known at any preload.
    """
    return _least(known)[0]


def _least(known: PeakEnvelope) -> tuple[OptimumPoint, float]:
    """The least value known, and the preload (N) at which a whole curve would tell whether there is a higher peak."""
    n = len(known.preload)
    values = [known.value(k) for k in range(n)]
    height = np.array([item[1].amplitude if item else np.inf for item in values])
    found = height[np.isfinite(height)]
    if not len(found):
        if any(known.highest(k) for k in range(n)):
            return OptimumPoint(np.nan, np.nan, np.nan, "none", np.inf, f"{NOT_VERIFIED}no preload has a value"), np.nan
        low, high = known.frequency
        endings = ", ".join(dict.fromkeys(there.ending for there in known.scanned.values())) or "not made"
        raise BdamperError(
            f"no peak found at any of {n} preloads from {known.preload[0]:g} to {known.preload[-1]:g} N "
            f"between {low:.6g} and {high:.6g} Hz; scans over frequency: {endings}"
        )
    k = int(np.argmin(height))
    best = values[k][1]  # type: ignore[index]
    if len(found) > 1 and found.max() <= (1.0 + FLAT) * found.min():
        return OptimumPoint(np.nan, best.amplitude, best.frequency, "flat", np.inf, "the preload does not matter"), np.nan
    x = np.log(known.preload)
    at_grid = OptimumPoint(best.parameter, best.amplitude, best.frequency, "end", 0.0)
    search = _Minimum(known)
    try:
        near = search.at(float(x[k]))
        side = -1 if near.slope > 0.0 else 1
        if not 0 <= k + side < n:
            return at_grid, best.parameter
        width = float(abs(x[k + side] - x[k]))
        if not np.isfinite(height[k + side]):
            what = "no steady response is expected" if k + side < known.first else "no value is known"
            why = f"{NOT_VERIFIED}the amplitude falls toward {known.preload[k + side]:.6g} N, where {what}"
            return replace(at_grid, uncertainty=width, status=why), best.parameter
        far = search.at(float(x[k + side]))
        if known.isolated(known.branches[far.branch], k):  # it parts from the curve that a sweep follows, somewhere between
            if width <= NARROW:
                return replace(at_grid, kind="jump", uncertainty=width), best.parameter
            middle = float(np.exp(0.5 * (near.x + far.x)))
            raise _Unknown(middle, f"a higher peak parts from the curve of sweeps near {middle:.6g} N")
        out = search.between(near, far)
        return out, out.preload * (1.0 - side * BESIDE if out.kind == "jump" else 1.0)
    except (*LOST, SettingError) as error:
        width = float(np.max(np.abs(np.diff(x[max(k - 1, 0) : k + 2]))))
        place = error.preload if isinstance(error, _Unknown) else best.parameter
        if abs(np.log(place / best.parameter)) < SAME_PRELOAD:  # a curve there is known, or will be: look beside it
            if k in (0, n - 1) and n > 1 and np.isfinite(height[1 if k == 0 else n - 2]):
                return at_grid, best.parameter
            beside = max((j for j in (k - 1, k + 1) if 0 <= j < n), key=lambda j: abs(x[j] - x[k]))
            place = float(np.exp(0.5 * (x[k] + x[beside])))
        return replace(at_grid, kind="unknown", uncertainty=width, status=f"{NOT_VERIFIED}{error}"), place


def least_so_far(known: PeakEnvelope) -> OptimumPoint:
    """The least value known at any preload when the search was interrupted."""
    values = {k: item[1] for k in range(len(known.preload)) if (item := known.value(k)) is not None}
    if not values:
        return OptimumPoint(np.nan, np.nan, np.nan, "none", np.inf, INTERRUPTED)
    k = min(values, key=lambda i: values[i].amplitude)
    near = known.preload[max(k - 1, 0) : k + 2] if known.finished else known.preload
    width = float(np.log(near[-1] / near[0]))
    return OptimumPoint(values[k].parameter, values[k].amplitude, values[k].frequency, "unknown", width, INTERRUPTED)


def verified_optimum(known: PeakEnvelope) -> OptimumPoint:
    """The preload of the least value, compared with whole tracking curves, and with what else may lie between preloads.

    Raises
    ------
    BdamperError
        As :func:`least_peak`.
    """
    found = _compared(known)
    slopes: dict[tuple[float, float], float] = {}
    for _ in range(BETWEEN):
        between = _could_be_lower_between(known, found, slopes) if found.verified else None
        if between is None:
            return found
        n_branches = len(known.branches)
        k = known.insert(float(np.sqrt(between[0] * between[1])))
        known.find_all()
        value = known.value(k)
        if len(known.branches) > n_branches or value is None or value[1].amplitude < found.amplitude:
            found = _compared(known)
    between = _could_be_lower_between(known, found, slopes) if found.verified else None
    if between is None:
        return found
    why = f"the highest peak could be lower between {between[0]:.6g} and {between[1]:.6g} N"
    return replace(found, status=f"{NOT_VERIFIED}{why}")


def _could_be_lower_between(
    known: PeakEnvelope, found: OptimumPoint, slopes: dict[tuple[float, float], float]
) -> tuple[float, float] | None:
    """Neighbouring preloads (N) between which the tangents of peaks lead to the least value below the optimum, if any do.

    A peak that is known at both is as low as its two tangents meet; one that is known at one of them alone may go on along
    its tangent up to the other.  ``slopes`` keeps d ln(amplitude)/d ln(preload) of peaks by preload and frequency.
    """
    x, search = np.log(known.preload), _Minimum(known)

    def slope(peak: Peak) -> float:
        key = peak.parameter, peak.frequency
        if key not in slopes:
            try:
                slopes[key] = search.slope(peak, peak.parameter)
            except (*LOST, SettingError):  # at a corner, or not to be computed: nothing is concluded from it
                slopes[key] = 0.0
        return slopes[key]

    def least(a: Peak, b: Peak, width: float, through: bool) -> float:
        """ln(amplitude) between two peaks."""
        p, q = np.log(a.amplitude), np.log(b.amplitude)
        fall, rise = -min(slope(a), 0.0), max(slope(b), 0.0)
        if not through:
            return float(min(p - fall * width, q - rise * width))
        if fall * width <= p - q or rise * width <= q - p:  # one of them does not lead below the other
            return float(min(p, q))
        return float((rise * p + fall * q - fall * rise * width) / (fall + rise))

    lowest, where = np.log((1.0 - LOWER) * found.amplitude), None
    for k, width in enumerate(np.diff(x)):
        low, high = (known.value(j) for j in (k, k + 1))
        beside_jump = found.kind == "jump" and x[k] < np.log(found.preload) < x[k + 1]
        if low is None or high is None or width <= NARROW or beside_jump:
            continue
        through = [(b.peaks[k], b.peaks[k + 1]) for b in known.branches if k in b.peaks and k + 1 in b.peaks and
                   (b is low[0] or b is high[0])]  # fmt: skip
        if not through and known.goes_on(k):
            through = [(low[1], high[1])]
        value = max(least(*pair, width, True) for pair in through) if through else least(low[1], high[1], width, False)
        if value < lowest:
            lowest, where = value, (float(known.preload[k]), float(known.preload[k + 1]))
    return where


def _compared(known: PeakEnvelope) -> OptimumPoint:
    """The least value beside the lowest preload, compared with whole tracking curves."""
    found, place = _least(known)
    for _ in range(ROUNDS):
        if not np.isfinite(found.preload):
            return found
        known.tell(f"verification at {place:.4g} N")
        before, k = found, known.insert(place)
        if not _whole(known, k):
            known.scan(k, whole=found.uncertainty <= NARROW or known.scan_at(k) is not None)
            known.find_all()
        found, place = _least(known)
        same = abs(np.log(found.preload / before.preload)) < SAME_PRELOAD
        if same and abs(found.amplitude / before.amplitude - 1.0) <= AGREES and _whole(known, known.insert(place)):
            again = next((k for k in _could_be_lower(known, found) if not _whole(known, k)), None)
            if again is None:
                return _judged(known, found)
            known.scan(again, whole=True)
            known.find_all()
            found, place = _least(known)
    return replace(found, status=f"{NOT_VERIFIED}whole tracking curves still changed it {ROUNDS} times")


def _whole(known: PeakEnvelope, k: int) -> bool:
    """Whether the whole tracking curve was taken at a preload."""
    there = known.scan_at(k)
    return there is not None and there.whole


def _could_be_lower(known: PeakEnvelope, found: OptimumPoint) -> list[int]:
    """Preloads without a value of which nothing known says that they are higher than the optimum."""
    least = (1.0 - AGREES) * found.amplitude
    unknown = (k for k in range(known.first, len(known.preload)) if known.value(k) is None)
    return [k for k in unknown if not known.lower_bound(k) >= least]


def _judged(known: PeakEnvelope, found: OptimumPoint) -> OptimumPoint:
    """The status of an optimum with which the tracking curve there agrees."""
    if found.uncertainty > NARROW:
        why = f"{NOT_VERIFIED}a whole tracking curve agrees, but the search did not end"
        return replace(found, status=why) if found.status == NOT_COMPARED else found
    lower = _could_be_lower(known, found)
    if lower:
        why = f"{len(lower)} preloads without a value could be lower, first {known.preload[lower[0]]:.6g} N"
        return replace(found, status=f"{NOT_VERIFIED}{why}")
    return replace(found, status="verified")
