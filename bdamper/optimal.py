"""Optimal curve and frequency-shift curve: the resonance peak over the preload, from free to stuck.

The peak is followed down from the highest preload (:mod:`bdamper.peaks`), where the contact is nearly stuck and the
response nearly linear.  Several peaks can exist at one preload, and a followed one need not stay the highest.  So the
curve is scanned, by following the whole response over frequency, at both ends of the range and wherever the highest peak
vanishes on its way to the next preload or another peak turns up higher; every peak that a scan finds is followed both
ways.  The optimal curve is the highest of all peaks known at each preload, and events (peaks that vanish, jumps, scans) are
kept in the result.

The optimum, the preload of least resonance amplitude, is found to a relative 1e-7: a root of the adjoint sensitivity where
the curve is smooth there, the point of equal height where two peaks cross, or the place of the jump where a higher peak
vanishes.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from bdamper.continuation import ContinuationOptions, PathPoint
from bdamper.errors import BdamperError, SettingError
from bdamper.peaks import (
    Family,
    Peak,
    PeakFollower,
    PeakOptions,
    PeakSensitivity,
    coarse_options,
    refine_maxima,
    same_peak,
    sensitivities,
)
from bdamper.resultfile import reading
from bdamper.system import Cost, CostMeter, HarmonicSystem
from bdamper.vary import FACTORS, vary

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from bdamper.study import Study

SIGNIFICANT = 0.5
"""Peaks below this share of the highest one at the same preload are not followed."""
FOLLOWED = 4
"""Peaks of one scan that are followed at most, the highest ones."""
OPTIMUM_TOLERANCE = 1e-7
PARAMETERS = (
    "preload", "friction_coefficient", "contact_stiffness_factor", "excitation.amplitude", "damper_mass_factor",
    "damping_factor",
)  # fmt: skip


@dataclass(frozen=True)
class Limit:
    """Linear resonance without contact ("free") or with all closed points stuck.

    Parameters
    ----------
    frequency : float, Hz
    amplitude : float, m
    """

    frequency: float
    amplitude: float


@dataclass(frozen=True)
class OptimumPoint:
    """Preload of the least resonance amplitude.

    Parameters
    ----------
    preload : float, N
    amplitude : float, m
    frequency : float, Hz
    kind : {"smooth", "crossing", "jump", "end"}
        Zero derivative; two peaks of equal height; the end of a higher peak, with the least amplitude as the limit from
        the side on which it is gone; or the end of the range of preloads.
    uncertainty : float
        Relative, of the preload.
    status : str
        "converged", or why the preload is known no better than ``uncertainty``.
    """

    preload: float
    amplitude: float
    frequency: float
    kind: str
    uncertainty: float
    status: str = "converged"


@dataclass(frozen=True)
class OptimalCurve:
    """Resonance over preload.

    Parameters
    ----------
    preload : (n,) float, N
    amplitude : (n,) float, m
        Of the highest peak; NaN where none was found.
    frequency : (n,) float, Hz
    shares : (n, 3) float
        Stick, slip and open at the peak, mean over the friction points and the cycle.
    residual : (n,) float
    rank_deficiency : (n,) int
    branch : (n,) int
        Number of the branch of peaks, -1 where there is none.
    unknowns : (n, n_unknowns) float
    status : tuple of str
        "followed"; "scanned" if the whole response over frequency was followed at this preload too; "scan incomplete ..."
        if that failed, so that there may be a higher peak; or what went wrong.
    peak_preload, peak_amplitude, peak_frequency : (m,) float
        All peaks found, also those that are not the highest.
    peak_branch : (m,) int
    peak_detached : (m,) bool
        Not on the response curve that a sweep of frequency follows, where that is known; such a peak does not count for
        the optimal curve.
    branch_end : tuple of str
        How each branch ended, downward and upward.
    free, stuck : Limit
    optimum : OptimumPoint
    events : tuple of str
        Jumps, peaks that vanish, scans.
    cost : Cost
    settings : mapping
    model_hash : str
    """

    preload: NDArray
    amplitude: NDArray
    frequency: NDArray
    shares: NDArray
    residual: NDArray
    rank_deficiency: NDArray
    branch: NDArray
    unknowns: NDArray
    status: tuple[str, ...]
    peak_preload: NDArray
    peak_amplitude: NDArray
    peak_frequency: NDArray
    peak_branch: NDArray
    peak_detached: NDArray
    branch_end: tuple[str, ...]
    free: Limit
    stuck: Limit
    optimum: OptimumPoint
    events: tuple[str, ...]
    cost: Cost
    settings: dict[str, Any] = field(default_factory=dict)
    model_hash: str = ""

    def __len__(self) -> int:
        return len(self.preload)

    @property
    def complete(self) -> bool:
        """Whether there is a converged peak at every preload."""
        return bool(np.isfinite(self.amplitude).all())

    @property
    def shift_percent(self) -> NDArray:
        """(n,) float: frequency relative to that of the free resonance, in percent."""
        return 100.0 * (self.frequency / self.free.frequency - 1.0)

    @property
    def stuck_shift_percent(self) -> float:
        """Shift of the stuck limit."""
        return 100.0 * (self.stuck.frequency / self.free.frequency - 1.0)

    @property
    def ratio(self) -> float:
        """Amplitude of the stuck limit over that of the optimum."""
        return self.stuck.amplitude / self.optimum.amplitude

    def __str__(self) -> str:
        o = self.optimum
        bad = int(np.count_nonzero(~np.isfinite(self.amplitude)))
        jumps = sum("jump" in event for event in self.events)
        lines = [
            f"optimal curve, {self.preload[0]:g} to {self.preload[-1]:g} N: {len(self)} points"
            + (f", {bad} without a peak" if bad else ""),
            f"  optimum {o.amplitude:.6g} m at {o.preload:.7g} N, {o.frequency:.6g} Hz ({o.kind})",
            f"  free {self.free.amplitude:.6g} m at {self.free.frequency:.6g} Hz, stuck {self.stuck.amplitude:.6g} m at "
            f"{self.stuck.frequency:.6g} Hz: ratio {self.ratio:.3g}, shift {self.stuck_shift_percent:.3g} %",
            f"  {len(self.branch_end)} branches of peaks, {jumps} jumps; {self.cost.seconds:.3f} s, "
            f"{self.cost.iterations} iterations",
        ]
        return "\n".join(lines)

    def plot(self, ax: Axes | None = None, **style: Any) -> Any:
        """Draw both curves as in Figs 8 and 9 of the paper; see :func:`bdamper.plotting.plot_optimal`."""
        from bdamper.plotting import plot_optimal

        return plot_optimal(self, ax=ax, **style)

    def save(self, path: str | FilePath) -> None:
        """Write the result to an HDF5 file."""
        with h5py.File(path, "w") as file:
            file.attrs["format"] = "bdamper-optimal"
            file.attrs["version"] = 1
            for name in _ARRAYS:
                file.create_dataset(name, data=getattr(self, name))
            for name in ("free", "stuck", "optimum", "cost"):
                file.attrs[name] = json.dumps(asdict(getattr(self, name)))
            for name in ("status", "branch_end", "events", "settings"):
                file.attrs[name] = json.dumps(getattr(self, name))
            file.attrs["model_hash"] = self.model_hash


_ARRAYS = (
    "preload", "amplitude", "frequency", "shares", "residual", "rank_deficiency", "branch", "unknowns", "peak_preload",
    "peak_amplitude", "peak_frequency", "peak_branch", "peak_detached",
)  # fmt: skip


def load_optimal_curve(path: str | FilePath) -> OptimalCurve:
    """Read what :meth:`OptimalCurve.save` wrote.

    Raises
    ------
    BdamperError
        If the file is not such a file.
    """
    with reading(path, "bdamper-optimal", "a result written by OptimalCurve.save") as file:
        arrays: dict[str, Any] = {name: file[name][()] for name in _ARRAYS}
        text = {name: json.loads(file.attrs[name]) for name in ("status", "branch_end", "events", "settings")}
        return OptimalCurve(
            **arrays,
            status=tuple(text["status"]),
            branch_end=tuple(text["branch_end"]),
            events=tuple(text["events"]),
            settings=text["settings"],
            free=Limit(**json.loads(file.attrs["free"])),
            stuck=Limit(**json.loads(file.attrs["stuck"])),
            optimum=OptimumPoint(**json.loads(file.attrs["optimum"])),
            cost=Cost(**json.loads(file.attrs["cost"])),
            model_hash=str(file.attrs["model_hash"]),
        )


# ---- frequency interval and peaks at one preload ----


def resonance_interval(study: Study, mode: int = 1) -> tuple[float, float]:
    """Frequency interval (Hz) that spans the free and the stuck resonance of one mode of the constrained bodies.

    Parameters
    ----------
    study : Study
    mode : int
        1 for the lowest.

    Raises
    ------
    SettingError
        If there is no such mode.
    """
    system = study.system(0.0)
    basis = system.bases[1]
    elastic = np.sort(basis.omega2[(basis.omega2 > 0.0) & (basis.mass == 1.0)])
    if not 1 <= mode <= len(elastic):
        raise SettingError(f"mode: expected 1 to {len(elastic)}, found {mode}")
    free = np.sqrt(elastic[mode - 1]) / (2.0 * np.pi)
    springs = study._stuck_springs(study.static(1.0 if np.any(study._load[0]) else 0.0))
    poles = system.linear_modes(springs)[0] / (2.0 * np.pi)
    above = poles[poles >= free * (1.0 - 1e-9)]
    stuck = float(above[0]) if len(above) else free
    margin = 0.1 * free + 0.3 * (stuck - free)
    return max(0.1 * free, free - margin), stuck + margin


def linear_peak(study: Study, frequency: tuple[float, float], preload: float, *, stuck: bool) -> Limit:
    """The highest resonance of the free or of the stuck structure in an interval (Hz), NaN if there is none."""
    system = study.system(preload)
    springs = study._stuck_springs(study.static(preload)) if stuck else None
    poles, vectors = system.linear_modes(springs)
    basis = system.bases[1]
    loss = 0.5 * (np.abs(vectors) ** 2).T @ basis.damping
    matrix = system.linear_matrix(0.0, springs)
    c, s = system.slices(1)
    force = system.force[c] - 1j * system.force[s]

    def negative(w: float) -> float:
        Z = matrix + np.diag(1j * w * basis.damping - w**2 * basis.mass)
        return -abs(np.linalg.solve(Z, force) @ system.response_rows[1])

    best = Limit(np.nan, np.nan)
    low, high = (2.0 * np.pi * f for f in frequency)
    for w, width in zip(poles, loss):
        if not low < w < high:
            continue
        half = 3.0 * max(float(width), 1e-9 * float(w))
        found = minimize_scalar(
            negative, bounds=(w - half, w + half), method="bounded", options={"xatol": 1e-9 * w, "maxiter": 200}
        )
        if not best.amplitude >= -found.fun:
            best = Limit(float(found.x / (2.0 * np.pi)), float(-found.fun))
    return best


def peaks_at(
    study: Study,
    preload: float,
    frequency: tuple[float, float],
    *,
    options: PeakOptions | None = None,
    continuation: ContinuationOptions | None = None,
    meter: CostMeter | None = None,
) -> tuple[tuple[Peak, ...], str]:
    """All peaks on the response curve at one preload, highest first, and how the curve ended.

    Parameters
    ----------
    study : Study
    preload : float, N
    frequency : (low, high), Hz
    options : PeakOptions
    continuation : ContinuationOptions
        Of the scan; coarse by default, since peaks are refined afterwards.
    """
    continuation = continuation or coarse_options()
    curve = study.track(preload, frequency, options=continuation)
    system = study.system(preload)
    if meter is not None:
        meter.add(curve.cost)
        meter.watch(system)
    peaks = refine_maxima(system, _maxima(system, curve), options=options, parameter=preload)
    return peaks, "complete" if curve.complete else f"{curve.status} ({curve.reason})"


def _maxima(system: HarmonicSystem, curve: Any) -> list[Any]:
    """Points marked as maxima, with the direction of the curve from the neighbouring points."""
    out = []
    for i, kind in enumerate(curve.point_kind):
        if kind != "maximum":
            continue
        y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
        j, k = max(i - 1, 0), min(i + 1, len(curve) - 1)
        chord = np.append(
            curve.unknowns[k] - curve.unknowns[j], 2.0 * np.pi * (curve.frequency[k] - curve.frequency[j])
        )
        n = system.n_mean
        scale = np.ones(len(y))
        scale[:n] = max(float(np.linalg.norm(y[:n])), float(np.linalg.norm(y[n:-1])))
        scale[n:-1] = float(np.linalg.norm(y[n:-1]))
        scale[-1] = max(abs(float(chord[-1])), 1e-6 * y[-1])
        chord = chord / scale
        chord[:n] = 0.0
        size = float(np.linalg.norm(chord))
        if not size > 0.0:
            continue
        out.append(
            PathPoint(y, chord / size, scale, curve.shares[i], float(curve.residual[i]), 0, int(curve.rank_deficiency[i]),
                      "maximum")
        )  # fmt: skip
    return out


# ---- the curve ----


@dataclass
class _Branch:
    """Peaks of one branch by index of the preload."""

    number: int
    peaks: dict[int, Peak]
    detached: set[int] = field(default_factory=set)
    down: str = ""
    up: str = ""


class _Builder:
    """State of one run."""

    def __init__(
        self, study: Study, preload: NDArray, frequency: tuple[float, float], options: PeakOptions, meter: CostMeter
    ) -> None:
        self.study = study
        self.preload = preload
        self.frequency = frequency
        self.limits = (0.5 * frequency[0], 1.5 * frequency[1])
        self.options = options
        self.meter = meter
        self.branches: list[_Branch] = []
        self.scanned: dict[int, str] = {}
        self.events: list[str] = []
        self.systems: dict[float, HarmonicSystem] = {}

    def family(self, preload: float) -> HarmonicSystem:
        system = self.systems.get(preload)
        if system is None:
            system = self.study.system(preload)
            self.meter.watch(system)
            if len(self.systems) > 8:
                self.systems.pop(next(iter(self.systems)))
            self.systems[preload] = system
        return system

    def at(self, k: int) -> list[tuple[_Branch, Peak]]:
        """Peaks known at a preload, highest first."""
        found = [(b, b.peaks[k]) for b in self.branches if k in b.peaks]
        return sorted(found, key=lambda item: -item[1].amplitude)

    def leader(self, k: int) -> tuple[_Branch, Peak] | None:
        """The highest peak that is not known to be detached from the curve that a sweep of frequency follows."""
        return next(((b, q) for b, q in self.at(k) if k not in b.detached), None)

    def scan(self, k: int) -> None:
        if k in self.scanned:
            return
        p = float(self.preload[k])
        peaks, ending = peaks_at(self.study, p, self.frequency, options=self.options, meter=self.meter)
        self.scanned[k] = ending
        known = self.at(k)
        new = [q for q in peaks if not any(same_peak(q, other) for _, other in known)]
        if ending == "complete":
            for b, q in known:
                if not any(same_peak(q, other) for other in peaks):
                    b.detached.add(k)
                    self.events.append(
                        f"{p:.6g} N: peak of branch {b.number}, {q.amplitude:.6g} m at {q.frequency:.6g} Hz, is detached "
                        "from the response curve that a sweep follows"
                    )
        self.events.append(
            f"{p:.6g} N: scan over frequency ({ending}) found {len(peaks)} peaks, {len(new)} of them new"
        )
        top = max([q.amplitude for q in peaks], default=0.0)
        for q in new[:FOLLOWED]:
            if q.amplitude < SIGNIFICANT * top:
                continue
            branch = _Branch(len(self.branches), {k: q})
            self.branches.append(branch)
            self.pursue(branch, k, -1)
            self.pursue(branch, k, +1)

    def pursue(self, branch: _Branch, k: int, step: int) -> None:
        """Follow a branch from preload to preload until it ends or meets another one."""
        history = [branch.peaks[i] for i in range(k - 3 * step, k + step, step) if i in branch.peaks]
        follower = PeakFollower(self.family, history, self.options, self.limits)
        ended = ""
        low = 0
        while True:
            k += step
            if not 0 <= k < len(self.preload):
                break
            peak = follower.go(float(self.preload[k]))
            if peak is None:
                at = follower.known[-1]
                ended = f"{follower.status} at {at.parameter:.6g} N, {at.frequency:.6g} Hz ({follower.reason})"
                self.events.append(f"peak branch {branch.number} {ended}")
                break
            met = next((b for b, q in self.at(k) if b is not branch and same_peak(q, peak)), None)
            if met is not None:
                ended = f"joins branch {met.number} at {self.preload[k]:.6g} N"
                break
            branch.peaks[k] = peak
            highest = self.leader(k)
            top = highest[1].amplitude if highest is not None else peak.amplitude
            low = low + 1 if peak.amplitude < SIGNIFICANT * top else 0
            if low >= 3:
                ended = "no longer significant"
                break
        self.meter.iterations += follower.iterations
        if step < 0:
            branch.down = ended
        else:
            branch.up = ended

    def run(self, checks: int) -> None:
        n = len(self.preload)
        first = [n - 1, 0]
        first += [int(i) for i in np.round(np.linspace(0, n - 1, checks + 2))[1:-1]]
        for k in first:
            self.scan(k)
        for _ in range(2 * n):
            todo = self.suspicious()
            if todo is None:
                break
            self.scan(todo)
        for k in range(n - 1):
            a, b = self.leader(k), self.leader(k + 1)
            if a is None or b is None or a[0] is b[0]:
                continue
            smooth = k + 1 in a[0].peaks and k in b[0].peaks
            what = "another peak becomes the highest" if smooth else "jump to another peak"
            self.events.append(
                f"between {self.preload[k]:.6g} and {self.preload[k + 1]:.6g} N: {what}, from {a[1].amplitude:.6g} m at "
                f"{a[1].frequency:.6g} Hz to {b[1].amplitude:.6g} m at {b[1].frequency:.6g} Hz"
            )

    def suspicious(self) -> int | None:
        """An index that needs a scan: without any peak, or where the highest peak has not come from its neighbour."""
        for k in range(len(self.preload)):
            if self.leader(k) is None and k not in self.scanned:
                return k
        for k in range(len(self.preload) - 1):
            a, b = self.leader(k), self.leader(k + 1)
            for i, j, item in ((k, k + 1, a), (k + 1, k, b)):
                if item is not None and j in item[0].detached and i not in self.scanned:
                    return i
            if a is None or b is None or a[0] is b[0]:
                continue
            if k + 1 not in a[0].peaks and k + 1 not in self.scanned:
                return k + 1
            if k not in b[0].peaks and k not in self.scanned:
                return k
        return None

    # ---- optimum ----

    def envelope(self, x: float, cache: dict[float, list[tuple[int, Peak]]]) -> tuple[int, Peak, float]:
        """Highest peak at exp(x): its branch, the peak and d ln(amplitude)/dx."""
        p = float(np.exp(x))
        if x not in cache:
            grid = np.log(self.preload)
            k = int(np.clip(np.searchsorted(grid, x), 1, len(grid) - 1))
            found = []
            for branch in self.branches:
                if branch.detached.intersection((k - 1, k)):
                    continue
                near = [branch.peaks[i] for i in (k - 1, k) if i in branch.peaks]
                near += [q for list_ in cache.values() for number, q in list_ if number == branch.number]
                if not near:
                    continue
                near.sort(key=lambda q: -abs(np.log(q.parameter) - x))
                exact = [q for q in near if abs(np.log(q.parameter) - x) < 1e-13]
                peak = exact[-1] if exact else self._reach(near, p)
                if peak is not None:
                    found.append((branch.number, peak))
            if not found:
                raise ArithmeticError(f"no peak found at {p:.8g} N")
            cache[x] = sorted(found, key=lambda item: -item[1].amplitude)
        number, peak = cache[x][0]
        s = sensitivities(peak, {"preload": (self.family, p)}, self.options)["preload"]
        return number, peak, s.amplitude * p / peak.amplitude

    def _reach(self, near: list[Peak], p: float) -> Peak | None:
        distinct = {q.parameter: q for q in near}
        follower = PeakFollower(self.family, list(distinct.values())[-3:], self.options, self.limits)
        peak = follower.go(p)
        self.meter.iterations += follower.iterations
        return peak

    def optimum(self) -> OptimumPoint:
        n = len(self.preload)
        leaders = [self.leader(k) for k in range(n)]
        height = np.array([item[1].amplitude if item else np.inf for item in leaders])
        if not np.isfinite(height).any():
            return OptimumPoint(np.nan, np.nan, np.nan, "end", np.inf, "no peak at any preload")
        k = int(np.argmin(height))
        best = leaders[k][1]  # type: ignore[index]
        x = np.log(self.preload)
        cache: dict[float, list[tuple[int, Peak]]] = {}
        try:
            near = (float(x[k]), *self.envelope(float(x[k]), cache))
            side = -1 if near[3] > 0.0 else 1
            if not 0 <= k + side < n or not np.isfinite(height[k + side]):
                return OptimumPoint(best.parameter, best.amplitude, best.frequency, "end", 0.0)
            far = (float(x[k + side]), *self.envelope(float(x[k + side]), cache))
            return self._narrow(near, far, cache)
        except (ArithmeticError, SettingError) as error:
            width = float(np.max(np.abs(np.diff(x))))
            return OptimumPoint(best.parameter, best.amplitude, best.frequency, "smooth", width, str(error))

    def _narrow(self, near: Any, far: Any, cache: dict[float, list[tuple[int, Peak]]]) -> OptimumPoint:
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
            trial = (x, *self.envelope(x, cache))
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
        ok = "converged" if uncertainty <= 10.0 * OPTIMUM_TOLERANCE else "bracket not narrowed further"
        return OptimumPoint(peak.parameter, peak.amplitude, peak.frequency, kind, float(uncertainty), ok)


def optimal_curve(
    study: Study,
    preload: tuple[float, float] | Sequence[float] | NDArray = (10.0, 25e3),
    n: int = 50,
    *,
    frequency: tuple[float, float] | None = None,
    mode: int = 1,
    checks: int = 0,
    options: PeakOptions | None = None,
) -> OptimalCurve:
    """Resonance amplitude and frequency over the preload, and the preload of least amplitude.

    Parameters
    ----------
    study : Study
    preload : (low, high) or sequence of more than two values, N
        Two values: ``n`` preloads between them, equal ratios apart.
    n : int
    frequency : (low, high), Hz, optional
        Where to look for peaks; around the free and the stuck resonance of ``mode`` by default.
    mode : int
        Mode of the constrained bodies, 1 for the lowest.
    checks : int
        Preloads, besides the ends of the range, at which the whole response is followed to look for higher peaks in any
        case.
    options : PeakOptions

    Returns
    -------
    OptimalCurve
    """
    start = time.perf_counter()
    values = _preloads(preload, n)
    if not np.any(study._load[0]):
        raise SettingError("optimal_curve: expected a model with a body that carries a load, found none")
    meter = CostMeter(start)
    if frequency is None:
        frequency = resonance_interval(study, mode)
    free = linear_peak(study, frequency, float(values[-1]), stuck=False)
    stuck = linear_peak(study, frequency, float(values[-1]), stuck=True)
    builder = _Builder(study, values, frequency, options or PeakOptions(), meter)
    builder.run(int(checks))
    optimum = builder.optimum()
    n_unknowns = study.system(float(values[0])).n_unknowns
    leaders = [builder.leader(k) for k in range(len(values))]

    def column(get: Any, fill: Any) -> NDArray:
        return np.array([get(item) if item is not None else fill for item in leaders])

    every = [(b.number, q) for b in builder.branches for _, q in sorted(b.peaks.items())]
    status = []
    for k, item in enumerate(leaders):
        if item is None:
            status.append(f"no peak found, scan over frequency {builder.scanned.get(k, 'not made')}")
        else:
            ending = builder.scanned.get(k)
            status.append("followed" if ending is None else ("scanned" if ending == "complete" else f"scan {ending}"))
    return OptimalCurve(
        preload=values,
        amplitude=column(lambda item: item[1].amplitude, np.nan),
        frequency=column(lambda item: item[1].frequency, np.nan),
        shares=column(lambda item: item[1].shares, np.full(3, np.nan)),
        residual=column(lambda item: item[1].residual, np.nan),
        rank_deficiency=column(lambda item: item[1].rank_deficiency, 0),
        branch=column(lambda item: item[0].number, -1),
        unknowns=column(lambda item: item[1].y[:-1], np.full(n_unknowns, np.nan)),
        status=tuple(status),
        peak_preload=np.array([q.parameter for _, q in every]),
        peak_amplitude=np.array([q.amplitude for _, q in every]),
        peak_frequency=np.array([q.frequency for _, q in every]),
        peak_branch=np.array([number for number, _ in every], int),
        peak_detached=np.array([k in b.detached for b in builder.branches for k in sorted(b.peaks)], bool),
        branch_end=tuple(f"down: {b.down or 'end of range'}; up: {b.up or 'end of range'}" for b in builder.branches),
        free=free,
        stuck=stuck,
        optimum=optimum,
        events=tuple(builder.events),
        cost=meter.read(time.perf_counter()),
        settings=study._settings(None) | {"frequency": [float(f) for f in frequency]},
        model_hash=study.model.hash,
    )


def _preloads(preload: Any, n: int) -> NDArray:
    values = np.asarray(preload, float)
    if values.ndim != 1 or len(values) < 2 or not np.isfinite(values).all() or np.any(values <= 0.0):
        raise SettingError(f"preload: expected (low, high) or a longer sequence of numbers > 0, found {preload!r}")
    if np.any(np.diff(values) <= 0.0):
        raise SettingError(f"preload: expected increasing values, found {preload!r}")
    if len(values) > 2:
        return values
    if int(n) != n or n < 2:
        raise SettingError(f"n: expected a whole number >= 2, found {n!r}")
    return np.geomspace(values[0], values[1], int(n))


# ---- single peaks and their sensitivities ----


def highest_peak(
    study: Study,
    preload: float,
    frequency: tuple[float, float] | None = None,
    *,
    mode: int = 1,
    options: PeakOptions | None = None,
) -> Peak:
    """The highest peak at one preload.

    Raises
    ------
    BdamperError
        If no peak was found in the interval.
    """
    preload = study._check_preload(preload)
    frequency = frequency or resonance_interval(study, mode)
    meter = CostMeter(time.perf_counter())
    peaks, ending = peaks_at(study, preload, frequency, options=options, meter=meter)
    if not peaks:
        raise BdamperError(
            f"no peak found at {preload:g} N between {frequency[0]:.6g} and {frequency[1]:.6g} Hz; the response curve "
            f"ended as: {ending}"
        )
    cost = meter.read(time.perf_counter())
    iterations = cost.iterations + sum(p.iterations for p in peaks)
    return replace(peaks[0], cost=replace(cost, iterations=iterations), scan=ending)


def peak_sensitivities(
    study: Study, peak: Peak, parameters: Sequence[str] = PARAMETERS, *, options: PeakOptions | None = None
) -> dict[str, PeakSensitivity]:
    """Derivatives of a peak's amplitude and frequency with respect to the preload and to settings.

    Parameters
    ----------
    study : Study
    peak : Peak
        Of this study, at ``peak.parameter`` newtons of preload.
    parameters : sequence of str
        "preload" or any setting with a number (see :mod:`bdamper.vary`); factors are taken at 1.
    options : PeakOptions
    """
    families: dict[str, tuple[Family, float]] = {}
    preload = peak.parameter
    for name in parameters:
        if name == "preload":
            if preload > 0.0:
                families[name] = (study.system, preload)
            continue
        if name == "damper_mass_factor" and not any(b.kind == "free" for b in study.model.bodies.values()):
            continue
        families[name] = (setting_family(study, name, preload), setting_value(study, name))
    return sensitivities(peak, families, options)


def setting_value(study: Study, name: str) -> float:
    """Present value of a numeric setting, 1 for a factor."""
    if name in FACTORS:
        return 1.0
    value: Any = study
    for part in name.split("."):
        value = getattr(value, part if part != "response" else "_response")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SettingError(f"{name}: expected a setting that is one number, found {value!r}")
    return float(value)


def setting_family(study: Study, name: str, preload: float) -> Family:
    """The equations at one preload as a function of one numeric setting."""

    def family(value: float) -> HarmonicSystem:
        return vary(study, {name: value}).system(preload)

    return family


__all__ = [
    "Limit",
    "OptimalCurve",
    "OptimumPoint",
    "highest_peak",
    "load_optimal_curve",
    "optimal_curve",
    "peak_sensitivities",
    "peaks_at",
    "resonance_interval",
    "setting_family",
    "setting_value",
]
