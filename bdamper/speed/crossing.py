"""One crossing: where a resonance lies on the line of an engine order, by a secant on the peak at fixed speed.

With the highest peak ``f*`` at the preload of each speed

    g(Omega) = 2 pi f*(Omega)/EO - Omega = 0

is solved from a scan over frequency near the line.  Plain substitution contracts by ``d ln f*/d ln Omega``, some
0.25 on a bladed disk, so that the secant needs three or four peaks.  A scan over frequency at the crossing says whether the
peak is the highest there; if another is, that one is followed.  Where the highest peak jumps over the line there is no
crossing of it: the answer is then the interval of speeds between scans on both sides.

On the line speed and frequency change together, at a fixed speed the frequency alone.  With ``A = A*(Omega)/sqrt(1 +
x^2)``, ``x = (EO Omega/omega* - 1)/zeta``, the highest point of a slow run-up exceeds the peak at fixed speed by
``(s zeta/(1 - p))^2/2``, with the slopes ``s`` of ln(A*) and ``p`` of ln(omega*) over ln(Omega) and the half bandwidth
``zeta``: the estimate of what the two differ by.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from bdamper.continuation.path import ContinuationOptions
from bdamper.continuation.rattle import NO_STEADY
from bdamper.fatigue.margin import LeastMargin
from bdamper.peaks.follower import PeakFollower
from bdamper.peaks.interval import resonance_interval
from bdamper.peaks.newton import Peak, PeakOptions, same_peak
from bdamper.peaks.scan import scan, scan_from
from bdamper.peaks.sensitivity import NoDerivative, sensitivities
from bdamper.problem.at_speed import Conditions
from bdamper.problem.problem import Problem
from bdamper.problem.variation import vary
from bdamper.speed.family import SpeedFamily, like
from bdamper.util import validate
from bdamper.util.cost import CostMeter
from bdamper.util.errors import SettingError

FOLLOWING = PeakOptions(max_halvings=4)
TOLERANCE = 1e-10
"""Relative, on the speed of a crossing."""
SECANTS, SCANS = 12, 8
"""Most peaks of one secant, and most scans over frequency for one crossing."""
SPAN, ALONG = 0.2, 13
"""The peak is followed so far to both sides of a crossing, relative to its speed, and at so many speeds by default."""
USUAL_SLOPE = 0.25
"""Of ln(frequency) over ln(speed), for the first step of the secant."""
APART = 2e-3
"""Least distance, relative to the speed, of peaks from which others are predicted."""
NEARLY = 0.8
"""Height, relative to the peak at a crossing, from which other maxima there are followed to the line, too: on the shipped
disk (nine scenes, 20 and 60 N) four of 0.94 to 0.99 are 1.2 to 12 % higher there.  A tenth of the time, at most a third."""
BESIDE = 0.05
"""Relative, by which a crossing may lie beyond those of the free and the stuck resonance."""
TWO_PI = 2.0 * np.pi


def _off_line(peak: Peak, engine_order: int) -> float:
    """Speed (rad/s) at which the line of an engine order has the frequency of a peak, less that of the peak."""
    return TWO_PI * peak.frequency / engine_order - peak.parameter


@dataclass
class Search:
    """The search for one crossing, and what was found on the way.

    Parameters
    ----------
    family : SpeedFamily
    speeds : tuple of float, rad/s, ascending
        At which peaks are followed; of two, the range.
    mode : int
    meter : CostMeter
    lost : bool
        Whether a search without a crossing ended early: there may be one.
    """

    family: SpeedFamily[Any]
    speeds: tuple[float, ...]
    mode: int
    meter: CostMeter
    lost: bool = False
    scanned: dict[float, Peak | None] = field(default_factory=dict)
    beside: dict[float, tuple[Peak, ...]] = field(default_factory=dict)
    line: dict[float, Peak] = field(default_factory=dict)
    known: list[Peak] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def order(self) -> int:
        """Engine order."""
        return int(self.family.whole.engine_order)

    def highest(self, omega: float, known: Peak | None = None) -> Peak | None:
        """The highest peak at a speed, by a scan over frequency; None where there is none.

        From a known peak the curve is followed both ways; if that does not lead to both ends, or without a known one, it is
        followed from the ends.
        """
        if omega not in self.scanned:
            problem, preload = self.family.problem(omega), self.family.preload(omega)
            limits = resonance_interval(problem, self.mode)
            found = None
            if known is not None:
                ways: dict[str, Any] = {"preload": preload, "options": FOLLOWING, "meter": self.meter}
                found = scan_from(problem, self.family.system(omega), known.y, limits, **ways)
            if found is None or not found.whole:
                found = scan(problem, preload, limits, meter=self.meter)
            if not found.whole:  # a coarse curve may step over what a fine one locates
                found = scan(problem, preload, limits, continuation=ContinuationOptions(), meter=self.meter)
            if not found.whole:
                above = f"; {found.above}" if found.above is not None else ""
                self.warnings.append(f"scan at {omega:.6g} rad/s {found.ending}{above}")
            if found.whole and not found.peaks:
                self.warnings.append(
                    f"the response at {omega:.6g} rad/s has no maximum between {limits[0]:.5g} and {limits[1]:.5g} Hz: "
                    f"does the excitation move mode {self.mode}, and does the response location?"
                )
            if found.rattles:
                self.warnings.append(f"{NO_STEADY} is expected at {omega:.6g} rad/s: {found.rattles}")
            peaks = tuple(replace(peak, parameter=omega) for peak in found.peaks)
            self.scanned[omega], self.beside[omega] = peaks[0] if peaks else None, peaks[1:]
        return self.scanned[omega]

    def follow(self, start: Peak) -> dict[float, Peak]:
        """A peak at the speeds around its own to which it can be followed, that of its start included.

        Each is predicted from the nearest that are known, those on the way to the start among them.
        """
        here = start.parameter
        line = {here: start}
        wanted = self.speeds if len(self.speeds) > 2 else here * np.linspace(1.0 - SPAN, 1.0 + SPAN, ALONG)
        near = [float(w) for w in np.clip(wanted, self.speeds[0], self.speeds[-1]) if abs(w - here) <= (SPAN + 1e-9) * here]
        for beyond in ([w for w in near if w > here], [w for w in near if w < here][::-1]):
            for omega in beyond:
                follower = PeakFollower(self.family.system, self._nearest(omega), FOLLOWING)
                peak = follower.go(omega)
                self.meter.count(follower.iterations)
                self.known += follower.known
                if peak is None:
                    break
                line[omega] = peak
        return dict(sorted(line.items()))

    def _nearest(self, omega: float) -> list[Peak]:
        """Up to four known peaks that are apart from each other, the nearest to a speed last."""
        out: list[Peak] = []
        for peak in sorted(self.known, key=lambda p: abs(p.parameter - omega)):
            if all(abs(p.parameter - peak.parameter) > APART * omega for p in out):
                out.append(peak)
        return out[3::-1]

    def secant(self, start: Peak, slope: float = USUAL_SLOPE) -> tuple[Peak | None, float]:
        """The peak on the line that is reached from one near it, and its speed; without it the speed that was wanted.

        The first step takes a slope of ln(frequency) over ln(speed).
        """
        follower = PeakFollower(self.family.system, start, FOLLOWING)
        self.known = []  # of this peak
        trials: list[tuple[float, float]] = []
        peak: Peak | None = start
        wanted = start.parameter
        while peak is not None and len(trials) < SECANTS:
            g, omega = _off_line(peak, self.order), peak.parameter
            self.known += follower.known
            if abs(g) <= TOLERANCE * omega:
                self.meter.count(follower.iterations)
                return peak, omega
            trials.append((g, omega))
            # polynomial through the last trials, speed over distance from the line
            points = trials[-4:]
            wanted = float(sum(w * np.prod([b / (b - a) for b, _ in points if b != a]) for a, w in points))
            if len(points) == 1:
                wanted = omega + g / (1.0 - slope)
            if not self.speeds[0] <= wanted <= self.speeds[-1]:
                break
            peak = follower.go(wanted)
        self.meter.count(follower.iterations)
        return None, wanted

    def start(self) -> float | None:
        """Speed at which to begin: in the middle between the crossings of the free and the stuck resonance, None if out of
        range."""
        limits = np.array([self.family.linear(w, self.mode) for w in (self.speeds[0], self.speeds[-1])])
        ends = np.array([self.speeds[0], self.speeds[-1]])
        places = []
        for column in limits.T:  # squared frequencies are all but linear in the squared speed
            slope = float(np.diff(column**2)[0] / np.diff(ends**2)[0])
            square = (column[0] ** 2 - slope * ends[0] ** 2) / max((self.order / TWO_PI) ** 2 - slope, 1e-300)
            places.append(float(np.sqrt(max(square, 0.0))))
        low, high = (1.0 - BESIDE) * min(places), (1.0 + BESIDE) * max(places)
        if high < ends[0] or low > ends[1]:
            return None
        return float(np.clip(0.5 * sum(places), *ends))

    def run(self) -> tuple[Peak | None, tuple[float, float]]:
        """The peak at the crossing and its speed twice; or None and the interval in which the highest peak jumps over the
        line, NaN if it does not meet it."""
        omega = self.start()
        while omega is not None and len(self.scanned) < SCANS:
            self.lost = True
            top = self.highest(omega)
            if top is None:
                break
            found, wanted = self.secant(top)
            if found is None:  # lost on the way, or out of the range
                self.lost = inside = self.speeds[0] <= wanted <= self.speeds[-1]
                omega = wanted if inside and self._new(wanted) else self._halfway()
                continue
            best = self.highest(wanted, found)
            if best is None or same_peak(best, found, 1e-4) or best.amplitude <= found.amplitude:
                self.line = self.follow(found)
                self._warn_of_higher(found)
                return found, (wanted, wanted)
            again, other = self.secant(best)
            omega = other if again is not None and self._new(other) else self._halfway()
        self.line = {w: p for w, p in sorted(self.scanned.items()) if p is not None}
        return None, self._jump()

    def _warn_of_higher(self, found: Peak) -> None:
        """Tell if another maximum of the response at the crossing meets the line at another speed and is higher there."""
        others = [p for p in self.beside[found.parameter] if p.amplitude > NEARLY * found.amplitude]
        for peak in [self.secant(other, 0.0)[0] for other in others]:  # at the end of a plateau it may end beyond the line
            if peak is not None and peak.amplitude > 1.001 * found.amplitude:
                self.warnings.append(
                    f"another maximum of the response is higher on the line, {peak.amplitude:.6g} m at "
                    f"{peak.parameter:.6g} rad/s, which study.run_up() shows"
                )

    def _new(self, omega: float) -> bool:
        """Whether no scan was made at a speed."""
        return all(abs(omega - other) > 1e-4 * omega for other in self.scanned)

    def _halfway(self) -> float | None:
        """Between the scans on both sides of the line; None where there are none, or they are close."""
        low, high = self._jump()
        return 0.5 * (low + high) if high - low > 1e-3 * high else None

    def kind(self, peak: Peak | None, low: float) -> str:
        """What the search has found: a peak, or an interval."""
        if peak is not None:
            return "crossing"
        return "jump" if np.isfinite(low) else "not found" if self.lost else "none"

    def _jump(self) -> tuple[float, float]:
        """Between the scans nearest to where the highest peak changes its side of the line."""
        tops = {w: _off_line(p, self.order) for w, p in self.scanned.items() if p is not None}
        before = max((w for w, g in tops.items() if g > 0.0), default=np.nan)
        after = min((w for w, g in tops.items() if g <= 0.0 and w > before), default=np.nan)
        return (before, after) if np.isfinite(before + after) else (np.nan, np.nan)


def half_bandwidth(peak: Peak) -> float:
    """Half bandwidth of a peak over its frequency, from its curvature."""
    return float(abs(peak.tangent[-1] * peak.scale[-1]) / np.sqrt(max(-peak.curvature, 1e-300)) / peak.y[-1])


def excess(slope: Any, frequency_slope: Any, half_bandwidth: Any) -> Any:
    """Estimate of how much higher than the peak at fixed speed a slow run-up is, relative."""
    return 0.5 * (slope * half_bandwidth / (1.0 - frequency_slope)) ** 2


def derivatives(family: SpeedFamily[Any], peak: Peak) -> dict[str, float]:
    """How a crossing moves with speed and damper mass; empty where the peak has no derivative.

    Along the engine-order line ``dOmega*/dm = f_m/(EO/2 pi - f_Omega)`` and ``dA*/dm = A_m + A_Omega dOmega*/dm``, with the
    derivatives of the peak at fixed speed; the mass of all free bodies scales load and inertia together.

    Returns
    -------
    mapping
        "slope" and "frequency_slope" (of ln(amplitude) and of ln(frequency) over ln(speed) at fixed speeds),
        "amplitude_by_mass" (m per unit of the factor on the mass), "speed_by_mass" (rad/s per unit).
    """
    omega, order = peak.parameter, int(family.whole.engine_order)
    problem, preload = family.problem(omega), family.preload(omega)

    def heavier(factor: float) -> Any:
        return like(vary(problem, {"damper_mass": factor}), problem).system(factor * preload)

    try:
        found = sensitivities(peak, {"speed": (family.system, omega), "mass": (heavier, 1.0)})
    except (NoDerivative, SettingError, ArithmeticError):
        return {}
    s, m = found["speed"], found["mass"]
    moves = m.frequency / (order / TWO_PI - s.frequency)
    return {
        "slope": s.amplitude * omega / peak.amplitude,
        "frequency_slope": s.frequency * omega / peak.frequency,
        "amplitude_by_mass": m.amplitude + s.amplitude * moves,
        "speed_by_mass": moves,
    }


@dataclass(frozen=True)
class CrossingTask:
    """The crossing of a mode with the engine order of a problem, as a question of a sweep.

    Parameters
    ----------
    speeds : tuple of float, rad/s
        At which the peak is followed; of two, the range.
    mode : int
    conditions : Conditions
    margin : LeastMargin, optional
        With it margins against fatigue are found, too.
    named : tuple
        What tells the functions among the conditions from others in files of long work: their values.
    """

    speeds: tuple[float, ...]
    mode: int = 1
    conditions: Conditions = field(default_factory=Conditions)
    margin: LeastMargin | None = None
    named: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        given = validate.numbers("speeds", self.speeds, above=0.0, unit="rad/s")
        if len(given) < 2 or np.any(np.diff(given) <= 0.0):
            raise validate.unfit("speeds", "two or more increasing values", self.speeds)
        object.__setattr__(self, "speeds", tuple(given.tolist()))
        validate.fields(self, validate.whole, "mode", least=1)

    def __call__(self, problem: Problem, preload: float | None) -> dict[str, Any]:
        meter = CostMeter(time.perf_counter())
        family = SpeedFamily(problem, self.conditions)
        search = Search(family, self.speeds, self.mode, meter)
        peak, (low, high) = search.run()
        nan = float("nan")
        line = list(search.line.values())
        out: dict[str, Any] = {
            "kind": search.kind(peak, low), "low": low, "high": high,
            "line_speed": [p.parameter for p in line], "line_frequency": [p.frequency for p in line],
            "line_amplitude": [p.amplitude for p in line],
            "line_margin": [self._margin(family, p) for p in line], "margin": nan,
            "slope": nan, "frequency_slope": nan, "amplitude_by_mass": nan, "speed_by_mass": nan, "half_bandwidth": nan,
        }  # fmt: skip
        if peak is None:
            tops = [p for w, p in search.scanned.items() if p is not None and low <= w <= high]
            top = max(tops, key=lambda p: p.amplitude, default=None)
            place = {"speed": nan, "frequency": nan, "preload": nan, "residual": nan}
            place |= {"amplitude": nan if top is None else top.amplitude, **dict.fromkeys(("stick", "slip", "open"), nan)}
        else:
            place = {
                "speed": peak.parameter, "frequency": peak.frequency, "amplitude": peak.amplitude,
                "preload": family.preload(peak.parameter), "residual": peak.residual,
                **{name: float(x) for name, x in zip(("stick", "slip", "open"), peak.shares)},
            }  # fmt: skip
            out |= {"margin": self._margin(family, peak)}
            out |= {"half_bandwidth": half_bandwidth(peak), **derivatives(family, peak)}
        return out | place | {"warning": "; ".join(search.warnings), "cost": meter.read(time.perf_counter())}

    def _margin(self, family: SpeedFamily[Any], peak: Peak) -> float:
        """Margin of a peak, NaN if none is asked for."""
        if self.margin is None:
            return float("nan")
        omega = peak.parameter
        return self.margin(family.problem(omega), peak.y[:-1], float(peak.y[-1]), family.preload(omega))
