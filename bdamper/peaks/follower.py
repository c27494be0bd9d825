"""Continuation of a resonance peak in any scalar parameter.

A peak is predicted by a polynomial through the latest peaks, at the start by the first one and its sensitivity; of linear,
quadratic and cubic prediction that which was best in the last step is used.  If the peak is not found near its prediction,
the step in the parameter is halved.  A peak that cannot be found at the smallest step has met a minimum and vanished with
it, or the solver lost it: the result says at which value.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.system import norm2
from bdamper.peaks.newton import FAR, Family, Peak, PeakOptions, find_peak, peak_scale, vibration_width
from bdamper.peaks.sensitivity import sensitivities
from bdamper.util.errors import SettingError, StaticError

LOST = (ArithmeticError, np.linalg.LinAlgError, StaticError)
"""What may go wrong at one preload without saying anything about others."""


class PeakFollower:
    """Follows one peak from value to value of a parameter.

    Parameters
    ----------
    family : callable
        The equations at a value of the parameter.
    start : Peak or sequence of Peak
        Converged, with ``parameter`` set; of several, the last is the start and the others serve the prediction.
    options : PeakOptions
    limits : (low, high), Hz
        Frequencies outside of which the peak is no longer wanted.
    """

    def __init__(
        self,
        family: Family,
        start: Peak | Sequence[Peak],
        options: PeakOptions | None = None,
        limits: tuple[float, float] = (0.0, np.inf),
    ) -> None:
        known = [start] if isinstance(start, Peak) else list(start)
        for peak in known:
            if not peak.converged:
                raise SettingError(f"peak to follow: expected a converged one, found status '{peak.status}'")
        self.family = family
        self.options = options or PeakOptions()
        self.limits = limits
        self.known: list[Peak] = known[-4:]
        self.iterations = 0
        self.logarithmic = all(peak.parameter > 0.0 for peak in known)
        self.n_mean = 0
        self.first_slope: NDArray | None = None
        self.errors = np.array([1.0, 1.0, 1.0])
        self.reason = ""
        self.status = "complete"

    def _place(self, value: float) -> float:
        """Logarithm of a value of the parameter if all known ones are positive, otherwise the value."""
        return float(np.log(value)) if self.logarithmic else value

    def _predictions(self, value: float) -> list[NDArray]:
        """Polynomials of first to third order through the latest peaks, as far as there are enough."""
        x = self._place(value)
        known = self.known[-4:]
        xs = [self._place(p.parameter) for p in known]
        if len(known) == 1:
            if self.first_slope is None:
                self.first_slope = self._start_slope(known[0])
            return [known[0].y + (x - xs[0]) * self.first_slope]
        out = []
        stack = np.array([p.y for p in known])
        for order in range(1, len(known)):
            nodes = xs[-order - 1 :]
            weights = [
                math.prod((x - b) / (a - b) for j, b in enumerate(nodes) if j != i) for i, a in enumerate(nodes)
            ]  # fmt: skip
            out.append(np.array(weights) @ stack[-order - 1 :])
        return out

    def _curvature(self, value: float) -> float:
        """Curvature predicted by equal ratios for equal steps, in the units of the latest peak."""
        last = self.known[-1]
        if not last.curvature < 0.0:
            return -1.0
        before = self.known[-2] if len(self.known) > 1 else last
        step = self._place(last.parameter) - self._place(before.parameter)
        if not before.curvature < 0.0 or step == 0.0:
            return last.curvature
        part = (self._place(value) - self._place(last.parameter)) / step
        size = norm2(before.tangent * before.scale / last.scale)
        ratio = last.curvature / before.curvature * size**2
        return last.curvature * min(max(ratio**part, 0.3), 3.0)

    def _start_slope(self, peak: Peak) -> NDArray:
        """Derivative of the unknowns with respect to the place of the parameter."""
        if peak.corner:
            return np.zeros_like(peak.y)
        factor = peak.parameter if self.logarithmic else 1.0
        try:
            found = sensitivities(peak, {"parameter": (self.family, peak.parameter)}, self.options)["parameter"]
        except LOST:
            return np.zeros_like(peak.y)
        return found.y * factor

    def _attempt(self, value: float, drift: bool, thorough: bool) -> Peak | None:
        try:
            return self._found(value, drift, thorough)
        except LOST as error:
            self.reason = str(error) if isinstance(error, StaticError) else f"{type(error).__name__}: {error}"
            return None

    def _found(self, value: float, drift: bool, thorough: bool) -> Peak | None:
        last = self.known[-1]
        predictions, system = self._predictions(value), self.family(value)
        order = int(np.argmin(self.errors[: len(predictions)]))
        guess = predictions[order]
        if not guess[-1] > 0.0:
            self.reason = "frequency not positive"
            return None
        self.n_mean = system.n_mean
        width = vibration_width(last.y, last.tangent, last.scale, system.n_mean)
        scale = peak_scale(system, guess, width)
        tangent = last.tangent * last.scale / scale
        size = norm2(tangent)
        curvature = self._curvature(value) / size**2
        peak = find_peak(
            system, guess, tangent=tangent / size, scale=scale, curvature=curvature, options=self.options,
            parameter=value, drift=drift, reach=1.5 * self.options.max_distance,
            thorough=thorough or last.corner,
        )  # fmt: skip
        self.iterations += peak.iterations
        if not peak.converged:
            self.reason = peak.status.partition(": ")[2]
            return None
        n = system.n_mean

        def distance(y: NDArray) -> float:
            return norm2((peak.y - y)[n:-1] / scale[n:-1])

        if distance(guess) > self.options.max_distance:
            self.reason = FAR
            return None
        if len(self.known) > 1:
            errors = [distance(p) for p in predictions]
            self.errors[: len(errors)] = errors
            self.errors[len(errors) :] = errors[-1]
        return peak

    def _remember(self, peak: Peak) -> None:
        last, n = self.known[-1], len(peak.y) - 1
        mean = (peak.y - last.y)[: self.n_mean]
        if len(self.known) > 1 and norm2(mean) > 0.5 * norm2(peak.y[self.n_mean : n]):
            # the mean position has jumped: those before it do not predict those that follow
            before = [replace(p, y=np.concatenate([p.y[: self.n_mean] * 0.0 + peak.y[: self.n_mean], p.y[self.n_mean :]]))
                      for p in self.known]  # fmt: skip
            self.known = before
        self.known = [*(p for p in self.known[-4:] if p.parameter != peak.parameter), peak]

    def go(self, value: float) -> Peak | None:
        """The peak at a value of the parameter, in smaller steps if need be; None if it does not get there."""
        step = 1.0  # of the whole way
        start, end = self._place(self.known[-1].parameter), self._place(value)
        if start == end:
            return self.known[-1]
        done, successes = 0.0, 1
        smallest = 0.5**self.options.max_halvings
        drift = True  # guesses of the mean position are costly: they are tried once after each success
        while done < 1.0:
            now = min(1.0, done + step)
            at = start + now * (end - start)
            last = step <= 2.0 * smallest
            guess = last and drift
            at = value if now == 1.0 else (float(np.exp(at)) if self.logarithmic else at)
            # a search along the curve is costly: it is left out while the step can still be halved
            peak = self._attempt(at, guess, step == 1.0 or guess or step < 2.0 * smallest)
            if peak is None:
                drift = drift and not guess
                step *= 0.5
                successes = 0
                if step < smallest:
                    self.status = "vanished"
                    return None
                continue
            self._remember(peak)
            if not self.limits[0] <= peak.frequency <= self.limits[1]:
                self.status, self.reason = "left the interval", f"at {peak.frequency:.6g} Hz"
                return None
            done = now
            drift = True
            successes += 1
            if successes > 1:
                step *= 2.0
        return self.known[-1]
