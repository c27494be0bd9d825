"""The preload of least resonance amplitude: least value of the envelope of all branches of peaks.

It is found to a relative 1e-7: a root of the adjoint sensitivity where the envelope is smooth there, the point of equal
height where two peaks cross, or the place of the jump where a higher peak vanishes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bdamper.peaks.follower import PeakFollower
from bdamper.peaks.newton import Peak
from bdamper.peaks.optimal_curve import OptimumPoint
from bdamper.peaks.peak_set import Branch, PeakSet
from bdamper.peaks.sensitivity import amplitude_sensitivity
from bdamper.util.errors import BdamperError, SettingError, StaticError

OPTIMUM_TOLERANCE = 1e-7
FLAT = 1e-6
"""Relative range of the resonance amplitude over all preloads below which the curve has no optimum."""
NEAR = 0.95
"""Branches below this share of the highest peak at both ends of a bracket are looked at only once, at the optimum found."""


class LeastEnvelope:
    """The search for the least value of the envelope.

    Parameters
    ----------
    known : PeakSet
        Peaks at all preloads.
    """

    def __init__(self, known: PeakSet) -> None:
        self.known = known
        self.options = replace(known.options, position_tolerance=min(known.options.position_tolerance, 1e-8))
        self.cache: dict[float, list[tuple[int, Peak]]] = {}

    def envelope(self, x: float, every: bool = False) -> tuple[int, Peak, float]:
        """Highest peak at exp(x): its branch, the peak and d ln(amplitude)/dx."""
        p = float(np.exp(x))
        cache = self.cache
        if every or x not in cache:
            grid = np.log(self.known.preload)
            k = int(np.clip(np.searchsorted(grid, x), 1, len(grid) - 1))
            places = next(((i,) for i in (k - 1, k) if abs(grid[i] - x) < 1e-13), (k - 1, k))
            found = []
            for branch in self.known.branches:
                if branch.detached.intersection(places):
                    continue
                near = [branch.peaks[i] for i in places if i in branch.peaks]
                near += [q for list_ in cache.values() for number, q in list_ if number == branch.number]
                if not near or not (every or self._is_high(branch, places)):
                    continue
                near.sort(key=lambda q: -abs(np.log(q.parameter) - x))
                exact = [q for q in near if abs(np.log(q.parameter) - x) < 1e-13]
                peak = exact[-1] if exact else self._reach(near, p)
                if peak is not None and self.known.within(peak):
                    found.append((branch.number, peak))
            if not found:
                raise ArithmeticError(f"no peak found at {p:.8g} N")
            cache[x] = sorted(found, key=lambda item: -item[1].amplitude)
        number, peak = cache[x][0]
        return number, peak, amplitude_sensitivity(peak, self.known.family, p, self.options) * p / peak.amplitude

    def _is_high(self, branch: Branch, places: tuple[int, ...]) -> bool:
        """Whether a branch comes near the highest peak at one of two neighbouring preloads."""
        for k in places:
            top = self.known.leader(k)
            if k in branch.peaks and top is not None and branch.peaks[k].amplitude >= NEAR * top[1].amplitude:
                return True
        return False

    def _reach(self, near: list[Peak], p: float) -> Peak | None:
        distinct = {q.parameter: q for q in near}
        follower = PeakFollower(self.known.family, list(distinct.values())[-3:], self.options, self.known.limits)
        peak = follower.go(p)
        self.known.meter.iterations += follower.iterations
        return peak

    def point(self) -> OptimumPoint:
        n = len(self.known.preload)
        leaders = [self.known.leader(k) for k in range(n)]
        height = np.array([item[1].amplitude if item else np.inf for item in leaders])
        found = height[np.isfinite(height)]
        if not len(found):
            low, high = self.known.frequency
            endings = ", ".join(dict.fromkeys(self.known.scanned.values())) or "not made"
            raise BdamperError(
                f"no peak found at any of {n} preloads from {self.known.preload[0]:g} to {self.known.preload[-1]:g} N "
                f"between {low:.6g} and {high:.6g} Hz; scans over frequency: {endings}"
            )
        k = int(np.argmin(height))
        best = leaders[k][1]  # type: ignore[index]
        if len(found) > 1 and found.max() <= (1.0 + FLAT) * found.min():
            return OptimumPoint(np.nan, best.amplitude, best.frequency, "flat", np.inf, "the preload does not matter")
        x = np.log(self.known.preload)
        try:
            near = (float(x[k]), *self.envelope(float(x[k])))
            side = -1 if near[3] > 0.0 else 1
            if not 0 <= k + side < n:
                return OptimumPoint(best.parameter, best.amplitude, best.frequency, "end", 0.0)
            if not np.isfinite(height[k + side]):
                width = float(abs(x[k + side] - x[k]))
                why = f"the amplitude falls toward {self.known.preload[k + side]:.6g} N, where no peak was found"
                return OptimumPoint(best.parameter, best.amplitude, best.frequency, "end", width, why)
            far = (float(x[k + side]), *self.envelope(float(x[k + side])))
            return self._narrow(near, far)
        except (ArithmeticError, SettingError, StaticError) as error:
            width = float(np.max(np.abs(np.diff(x))))
            return OptimumPoint(best.parameter, best.amplitude, best.frequency, "smooth", width, str(error))

    def _narrow(self, near: Any, far: Any) -> OptimumPoint:
        """Least envelope between two places: it falls from ``near`` toward ``far``, and is not lower at ``far``."""
        sense = np.sign(far[0] - near[0])
        slow, width = 0, abs(far[0] - near[0])
        last = near
        weight = [1.0, 1.0]  # Illinois factors on the slopes
        kind, uncertainty = "smooth", width
        for _ in range(80):
            length = abs(far[0] - near[0])
            meeting = far[3] * sense > 0.0  # the envelope also falls from far toward near
            same = near[1] == far[1]
            kind = "smooth" if same and meeting else ("crossing" if meeting else "jump")
            if length <= OPTIMUM_TOLERANCE:
                uncertainty = length
                break
            t = 0.5
            if slow < 2 and meeting:
                if same:
                    a, b = weight[0] * near[3], weight[1] * far[3]
                    t = a / (a - b)
                else:
                    rise = np.log(far[2].amplitude / near[2].amplitude)
                    t = (rise - far[3] * (far[0] - near[0])) / ((near[3] - far[3]) * (far[0] - near[0]))
                if not 0.0 < t < 1.0:
                    t = 0.5
                # step a little beyond so that both ends close in
                if not same:
                    t = min(max(t, 1e-9), 1.0 - 1e-9)
            x = near[0] + t * (far[0] - near[0])
            trial = (x, *self.envelope(x))
            step = abs(x - last[0])
            last = trial
            if trial[3] == 0.0 or (same and meeting and step <= OPTIMUM_TOLERANCE):
                near, uncertainty = trial, step
                break
            falls_to_far = trial[3] * sense < 0.0
            if falls_to_far and trial[2].amplitude <= near[2].amplitude * (1.0 + 1e-12):
                if abs(near[0] - x) < 0.5 * length:
                    weight[1] *= 0.5
                near = trial
                weight[0] = 1.0
            else:
                if abs(far[0] - x) < 0.5 * length:
                    weight[0] *= 0.5
                far = trial
                weight[1] = 1.0
            now = abs(far[0] - near[0])
            slow = 0 if now <= 0.5 * width else slow + 1
            if now <= 0.5 * width or slow > 3:
                width, slow = now, 0
        if kind != "smooth" and far[2].amplitude < near[2].amplitude:
            near = far
        peak = near[2]
        if self.envelope(near[0], every=True)[1].amplitude > peak.amplitude * (1.0 + 1e-9) and kind != "jump":
            raise ArithmeticError("another peak is higher there")
        ok = "converged" if uncertainty <= 10.0 * OPTIMUM_TOLERANCE else "bracket not narrowed further"
        return OptimumPoint(peak.parameter, peak.amplitude, peak.frequency, kind, float(uncertainty), ok)
