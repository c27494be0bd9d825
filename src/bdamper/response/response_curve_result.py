"""Results of response curves, and the linear response curves without contact and in stick.

The response at the chosen location and direction is ``x(t) = x_0 + Re sum_l X_l exp(i l omega t)``.  ``amplitude`` is
``|X_1|``, the harmonic of the excitation; ``peak_to_peak`` includes all harmonics.

A part of the curve between two folds on which the frequency decreases is unstable by the sign of det J (``backward``);
``unstable`` contains the points that a stability analysis found unstable, if available.

Linear curves are sampled at equal steps of phase around each resonance, and their maxima are refined.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from bdamper.harmonic_balance.plausibility import check_interval
from bdamper.harmonic_balance.problem import Problem, stuck_springs
from bdamper.harmonic_balance.sector import NEAREST, around
from bdamper.response.branches import NO_SOLUTION, LeftOut
from bdamper.util import validation
from bdamper.util.display import Comparable, Fact, Plottable
from bdamper.util.errors import INTERRUPTED, BdamperError
from bdamper.util.formatting import amount, peak_text, preload_text, short_repr
from bdamper.util.progress import Cost, CostMeter, one_thread
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import (
    ROW,
    FrequencySeries,
    Hertz,
    Kinds,
    Metres,
    Numbers,
    PerRow,
    Quantity,
    Radians,
    RadiansPerSecond,
    Shares,
    Tabular,
)

# ---- results ----


HIGHEST = "Highest response"
NOT_IN_TIME = "Not checked in time."
"""Text for a highest point without time integration."""


@short_repr
@dataclass(frozen=True)
class Fold:
    """Turning point of a curve: in frequency, or at its largest response.

    Parameters
    ----------
    frequency : float, Hz
    amplitude : float, m
    index : int
        Index of the point in the curve.
    kind : {"fold", "peak", "highest, no peak", "detached", "separate"}
        "highest, no peak" is the largest response at an end of the curve, "detached" on a closed branch, "separate" on a
        branch that enters and leaves at the same end of the interval.
    """

    frequency: float
    amplitude: float
    index: int
    kind: str = "fold"

    def __str__(self) -> str:
        return f"{self.kind}: {peak_text(self.amplitude, self.frequency, 6)} (point {self.index})"


@short_repr
@dataclass(frozen=True)
class ResponseCurve(Plottable, Comparable, FrequencySeries, Tabular, Recorded, Storable, kind="bdamper-curve"):
    """Response curve; every point is a converged solution.

    ``plot`` draws amplitude over frequency, with backward branches dashed (:func:`bdamper.plot.plot_curve`).

    Parameters
    ----------
    kind : {"tracking", "free", "stuck", "run-up"}
        "run-up": along an engine order line, with the rotor speed proportional to the frequency.
    frequency : (n,) float, Hz
    harmonics : (n, n_harmonics + 1) complex, m
        Response amplitudes; the first column is the mean.
    unknowns : (n, n_unknowns) float
        Modal coordinates (kg^1/2 m): mean, then cosine and sine amplitudes of each harmonic.  Empty for a run-up.
    residual : (n,) float
        Relative to the excitation and the static load.
    shares : (n, 3) float
        Fractions of the cycle in stick, slip and separation, mean over the friction points.
    backward : (n,) bool
        Whether the frequency decreases along the curve: between two folds, unstable.
    rank_deficiency : (n,) int
        Number of undetermined mean positions, which have least norm.
    branch : (n,) int
        Number of the branch, from 0; points of one branch are in order.
    point_kind : tuple of str
        "regular", "fold", "maximum", "end" or "drift" for each point.
    preload : float, N
        NaN for a run-up, in which it depends on speed.
    status, reason : str
        "complete", "incomplete", "not found" (no first solution) or "interrupted", and the cause.
    cost : Cost
    missing_ranges : tuple of LeftOut
        Omissions ``(low, high, why)``, Hz: frequencies without solution, tangles of folds, incomplete paths.  The gaps of a
        complete curve are narrower than a thousandth of the interval.
    settings : mapping
    model_hash : str
    start_log : tuple of str
        Attempts to find first points.
    notes : tuple of str
        Further observations: drifting or undetermined mean positions.
    unstable : (n,) bool or None
        Whether a small disturbance is known to grow; ``labels`` tells which other points are known to be stable
        (:mod:`bdamper.time_domain.floquet`).
    stability_note : str
        Criterion, disturbances considered, and the cost.
    in_time : (n,) float or None
        Mean amplitude in time of the motion that starts at a point, relative to the point; NaN if unknown
        (:mod:`bdamper.time_domain.floquet`).
    closed : tuple of int
        Closed branches.  No sweep of frequency leads to them, and they do not count for ``peak``.
    speed : (n,) float, rad/s, or None
        Rotor speed of a run-up.
    blades : (n, n_blades, n_harmonics + 1) complex, m, or None
        Response of every blade of a wheel in its local axes; ``harmonics`` is the response of the highest blade.
    """

    kind: str
    frequency: Hertz
    harmonics: Annotated[NDArray, Quantity("m", dims=(ROW, "harmonic"))]
    unknowns: PerRow
    residual: Numbers
    shares: Shares
    backward: Numbers
    rank_deficiency: PerRow
    branch: Numbers
    point_kind: Kinds
    preload: float
    status: str
    reason: str
    cost: Cost
    missing_ranges: tuple[LeftOut, ...] = ()
    start_log: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    unstable: Numbers | None = None
    stability_note: str = ""
    in_time: Numbers | None = None
    closed: tuple[int, ...] = ()
    speed: RadiansPerSecond | None = None
    blades: Annotated[NDArray, Quantity("m", dims=(ROW, "blade", "harmonic"))] | None = None
    _summary_fields = (
        "preload", "kind", "status", "peak.kind", "peak.amplitude", "peak.frequency", "at_peak", "unstable_count",
        "stability_note", "folds", "missing_ranges", "detached", "separate",
    )  # fmt: skip

    @property
    def phase(self) -> Radians:
        """(n,) float, rad: phase of the first harmonic."""
        return np.angle(self.harmonics[:, 1])

    @property
    def peak_to_peak(self) -> Metres:
        """(n,) float, m: range of the response over a period, with all harmonics."""
        l = np.arange(1, self.harmonics.shape[1])
        theta = np.linspace(0.0, 2.0 * np.pi, 64 * len(l), endpoint=False)
        x = (self.harmonics[:, 1:] @ np.exp(1j * np.outer(l, theta))).real
        return x.max(axis=1) - x.min(axis=1)

    @property
    def folds(self) -> tuple[Fold, ...]:
        """Turning points in frequency, in the order of the path."""
        return tuple(self._turn(i, kind) for i, kind in enumerate(self.point_kind) if kind == "fold")

    def _turn(self, i: int, kind: str) -> Fold:
        return Fold(float(self.frequency[i]), float(self.amplitude[i]), i, kind)

    @property
    def gap(self) -> tuple[float, float] | None:
        """Widest gap of the interval, Hz; None without a gap."""
        gaps = [(part.low, part.high) for part in self.missing_ranges if part.why == NO_SOLUTION]
        return max(gaps, key=lambda gap: gap[1] - gap[0], default=None)

    def _jump(self, fold: Fold, reached: NDArray) -> tuple[float, float]:
        """Return the distance (m) from a fold to the nearest other response at its frequency (0 without), and the
        frequency.
        """
        away = np.abs(np.arange(len(self) - 1) - fold.index + 0.5) > 1.0
        joined = away & (np.diff(self.branch) == 0) & reached[1:]
        _, met = crossed(self.frequency, self.amplitude, fold.frequency, joined)
        return float(min(np.abs(met - fold.amplitude), default=0.0)), fold.frequency

    def _highest(self) -> int:
        if not len(self):
            raise BdamperError(f"the curve has no points ({self.status}: {self.reason})")
        apart = self.apart
        return int(np.argmax(np.where(apart & ~apart.all(), -1.0, self.amplitude)))

    def _tops(self, numbers: Iterable[int], kind: str) -> tuple[Fold, ...]:
        """Return the largest response of each of these branches."""
        on = (np.flatnonzero(self.branch == number) for number in numbers)
        return tuple(self._turn(int(i[np.argmax(self.amplitude[i])]), kind) for i in on)

    @property
    def detached(self) -> tuple[Fold, ...]:
        """Largest response of each closed branch; it does not count for the peak."""
        return self._tops(self.closed, "detached")

    @property
    def separate(self) -> tuple[Fold, ...]:
        """Largest response of each branch that enters and leaves at the same end of the interval.

        It does not count for the peak if another branch connects both ends, because a slow sweep within the interval stays
        on that branch.  A sweep from beyond the end may follow the separate branch; a wider interval shows it.
        """
        same_end = 1e-6  # relative difference of frequencies
        through: list[int] = []
        back: list[int] = []
        for number in np.unique(self.branch):
            i, j = np.flatnonzero(self.branch == number)[[0, -1]]
            if self.point_kind[i] == self.point_kind[j] == "end":
                same = np.isclose(self.frequency[i], self.frequency[j], rtol=same_end, atol=0.0)
                (back if same else through).append(int(number))
        return self._tops(back if through else (), "separate")

    @property
    def apart(self) -> NDArray:
        """(n,) bool: points on closed and separate branches, which do not count for the peak."""
        return np.isin(self.branch, (*self.closed, *(self.branch[top.index] for top in self.separate)))

    def higher(self, amplitude: float) -> str:
        """Return a text on the separate branches that are higher than an amplitude (m), or ""."""
        tops = (top for top in self.separate if top.amplitude > amplitude)
        ends = ((top, self.frequency[self.branch == self.branch[top.index]][0]) for top in tops)
        return "; ".join(
            f"higher on a separate branch that enters and leaves at {amount(end, 'Hz', 4)}: "
            f"{peak_text(top.amplitude, top.frequency, 4)}, widen the interval" for top, end in ends
        )  # fmt: skip

    @property
    def out_of_reach(self) -> NDArray:
        """(n,) bool: points on closed branches, and on separate branches that are higher than the peak."""
        above = (self.branch[top.index] for top in self.separate if top.amplitude > self.peak.amplitude)
        return np.isin(self.branch, (*self.closed, *above))

    @property
    def peak(self) -> Fold:
        """Largest response without closed and separate branches, even if it is no maximum (``peak_at_end``)."""
        return self._turn(self._highest(), "highest, no peak" if self.peak_at_end else "peak")

    @property
    def peak_at_end(self) -> bool:
        """Whether the largest response is at the lowest or highest frequency of the curve and is no maximum."""
        i = self._highest()
        if self.kind in ("tracking", "run-up") and self.point_kind[i] in ("maximum", "fold"):
            return False
        ends = self.frequency.min(), self.frequency.max()
        return bool(np.isclose(self.frequency[i], ends, rtol=1e-6, atol=0.0).any())

    @property
    def labels(self) -> NDArray:
        """(n,) str: "stable" or "unstable" in time; "stable as far as N harmonics tell" or "unstable" by multipliers;
        "unstable (det J < 0) with N harmonics" or "undecided (det J >= 0) with N harmonics"; "" if not examined.
        """
        if self.unstable is None:
            return np.full(len(self), "", object)
        n = len(self.settings.get("harmonics", range(1, self.harmonics.shape[1])))
        stays, leaves = f"stable as far as {n} harmonic{'s' if n > 1 else ''} tell{'s' if n == 1 else ''}", "unstable"
        if "sign of det J: " in self.stability_note:
            signs = "undecided (det J >= 0)", "unstable (det J < 0)"
            stays, leaves = (f"{sign} with {n} harmonic{'s' if n > 1 else ''}" for sign in signs)
        proven = np.isfinite(self.in_time) if self.in_time is not None else np.zeros(len(self), bool)
        in_time = np.where(self.unstable, "unstable", "stable")
        return np.where(proven, in_time, np.where(self.unstable, leaves, stays))

    @property
    def unstable_count(self) -> int | None:
        """Number of unstable points; None if not examined."""
        return None if self.unstable is None else int(np.sum(self.unstable))

    @property
    def at_peak(self) -> dict[str, float]:
        """Fractions of the cycle in stick, slip and separation at the peak, in per cent."""
        shares = zip(("stick", "slip", "open"), np.round(100.0 * self.shares[self.peak.index], 1).tolist())
        return {f"{name} (%)": share for name, share in shares if np.isfinite(share)}

    def _facts(self) -> tuple[Fact, ...]:
        """Return the highest point of the curve and its origin; empty for a curve without points."""
        return super()._facts() if len(self) else ()

    def _headline(self) -> str:
        if not len(self):
            return f"No point of this curve was found: {self.reason}."
        top, low, high = self.peak, float(self.frequency.min()), float(self.frequency.max())
        what = {"tracking": "Resonance", "free": "Free resonance", "stuck": "Stuck resonance"}.get(self.kind, HIGHEST)
        load = f" under {preload_text(self.preload, self.settings)}" if self.kind == "tracking" else ""
        if self.speed is not None:
            speed = float(self.speed[top.index])
            turning = f"{speed * 30.0 / np.pi:.5g} rpm ({speed:.5g} rad/s)"
            load = f" along engine order {self.settings['engine_order']}, at {turning}"
        if self.blades is not None:
            load += f", blade {np.argmax(np.abs(self.blades[top.index, :, 1]))}"
        out = [f"{HIGHEST if self.peak_at_end else what} of {peak_text(top.amplitude, top.frequency)}{load}."]
        if self.peak_at_end:
            out.append(f"It lies at an end of the curve ({amount(low, 'Hz')} to {amount(high, 'Hz')}) and is not a peak.")
        if higher := self.higher(top.amplitude):
            out.append(f"The response is {higher}.")
        if self.kind in ("tracking", "run-up"):
            checked = self.in_time is not None and np.isfinite(self.in_time[top.index])
            out.append(f"In time it is {self.labels[top.index]}." if checked else NOT_IN_TIME)
        reached = ~self.out_of_reach
        size, at = max((self._jump(fold, reached) for fold in self.folds if reached[fold.index]), default=(0.0, 0.0))
        if size > 0.01 * top.amplitude:  # smaller jumps are invisible in a plot
            out.append(f"A slow sweep of frequency jumps by up to {amount(size, 'm')}, at {amount(at, 'Hz')}.")
        if not self.complete:
            out.append(f"The curve is {self.status}, there may be a higher one: {self.reason}.")
        return " ".join(out)


def unstable_points(curve: ResponseCurve) -> NDArray:
    """Return (n,) bool: ``curve.unstable`` if examined, otherwise where the frequency decreases along the curve."""
    return np.asarray(curve.backward if curve.unstable is None else curve.unstable, bool)


def crossed(x: NDArray, height: NDArray, at: float, joined: NDArray) -> tuple[NDArray, NDArray]:
    """Return the joined intervals in which a curve over x crosses an abscissa, by their first point, and the
    interpolated heights.
    """
    f = x - at
    across = np.flatnonzero((f[:-1] * f[1:] <= 0.0) & (f[:-1] != f[1:]) & joined)
    return across, height[across] + f[across] / (f[across] - f[across + 1]) * (height[across + 1] - height[across])


class InterruptedCurve(KeyboardInterrupt):
    """Interruption by Ctrl-C of a curve within another analysis; contains the curve so far."""

    def __init__(self, curve: ResponseCurve) -> None:
        super().__init__(curve.reason)
        self.curve = curve


def uninterrupted(curve: ResponseCurve) -> ResponseCurve:
    """Return the curve if it was not interrupted.

    Raises
    ------
    InterruptedCurve
        If Ctrl-C ended it.
    """
    if curve.status == INTERRUPTED:
        raise InterruptedCurve(curve)
    return curve


# ---- linear response curves ----


@one_thread
def free(problem: Problem, frequency: tuple[float, float]) -> ResponseCurve:
    """Compute the response without contact, the limit of zero preload.

    Parameters
    ----------
    problem : Problem
    frequency : (low, high), Hz

    Returns
    -------
    ResponseCurve
    """
    return _linear(problem, "free", 0.0, frequency, None)


@one_thread
def stuck(problem: Problem, frequency: tuple[float, float], preload: float = 1.0) -> ResponseCurve:
    """Compute the response with all closed points stuck, the limit of high preload.

    Parameters
    ----------
    problem : Problem
    frequency : (low, high), Hz
    preload : float, N
        Preload that closes the points; without gaps its size has no effect.  An interface that touches without a normal
        load counts as stuck, with a warning.

    Returns
    -------
    ResponseCurve
    """
    if not problem.carries_load:
        preload = 0.0
    springs = stuck_springs(problem, problem.equilibrium(preload), touching=True)
    return _linear(problem, "stuck", preload, frequency, springs)


def _linear(
    problem: Problem, kind: str, preload: float, frequency: tuple[float, float], springs: NDArray | None
) -> ResponseCurve:
    """Compute the linear response over an interval (Hz), with springs (n_points, 3) in N/m in place of the contact."""
    watch = CostMeter()
    low, high = (2.0 * np.pi * f for f in validation.interval("frequency", frequency))
    check_interval(problem, frequency, preload)
    system = problem.system(preload)
    linear, omega = system.structure.linear, np.linspace(low, high, 201)
    unbounded = []
    for w, width, _ in linear.resonances((springs,), *around(low, high)):
        at, amplitude = linear.maximum(system.response_rows[1], springs, w, width)
        if np.isinf(amplitude):
            unbounded.append(w)
            omega = np.concatenate([omega, w * (1.0 + np.outer((-1.0, 1.0), np.geomspace(NEAREST, 1e-2, 40)).ravel())])
        else:
            # equal steps of phase around each resonance
            omega = np.concatenate([omega, w + width * np.tan(np.linspace(-1.56, 1.56, 161)), [at]])
    infinite = [w / (2.0 * np.pi) for w in unbounded if low < w < high]
    for w in unbounded:
        omega = omega[np.abs(omega - w) >= 0.5 * NEAREST * w]
    omega = np.unique(omega[(omega >= low) & (omega <= high)])

    def height(w: float) -> float:
        return float(abs(linear.response(w, springs) @ system.response_rows[1]))

    tops = [w for w in _maxima(height, omega) if all(abs(w - pole) >= 2.0 * NEAREST * pole for pole in unbounded)]
    omega = np.unique(np.concatenate([omega, tops]))
    n = len(omega)
    u, error, largest = np.zeros((n, system.n_unknowns)), np.zeros(n), 1e-300
    for l in problem.settings.excited:
        force, (cosine, sine) = system.layout.amplitudes(system.structure.force, l), system.layout.slices(l)
        q = np.array([linear.response(w, springs, l) for w in omega])
        u[:, cosine], u[:, sine] = q.real, -q.imag
        wrong = [np.abs(linear.matrix(w, springs, l) @ a - force).max() for w, a in zip(omega, q)]
        error, largest = np.maximum(error, wrong), max(largest, float(np.abs(force).max()))
    return ResponseCurve(
        kind=kind,
        frequency=omega / (2.0 * np.pi),
        harmonics=system.response(u),
        unknowns=u,
        residual=error / largest,
        shares=np.tile(_shares(problem, springs), (n, 1)),
        backward=np.zeros(n, bool),
        rank_deficiency=np.zeros(n, int),
        branch=np.zeros(n, int),
        point_kind=tuple("maximum" if w in tops else "regular" for w in omega.tolist()),
        preload=preload,
        status="complete",
        reason="linear" + "".join(f", unbounded at {f:.6g} Hz: no damping" for f in infinite),
        cost=watch.read(),
        **problem.recorded(),
    )


def _shares(problem: Problem, springs: NDArray | None) -> NDArray:
    """Return the fractions (3,) in stick, slip and separation of the points with friction or a bond."""
    held = np.zeros((len(problem.friction), 3)) if springs is None else springs
    counted = problem.friction_points & ((problem.friction > 0.0) | problem.bonded_points)
    stick = float((held[counted] > 0.0).any(axis=1).mean()) if counted.any() else 0.0
    return np.array([stick, 0.0, float(counted.any()) - stick])


def _maxima(height: Callable[[float], float], omega: NDArray) -> list[float]:
    """Return the frequencies (rad/s) of the maxima within an ascending sample of frequencies."""
    a = np.array([height(w) for w in omega])
    flat, within = 1e-9, np.pad(a, 1)  # smaller relative dips between two maxima are rounding
    found, out = scipy.signal.find_peaks(within, prominence=flat * within)[0] - 1, []
    for i in found[(found > 0) & (found < len(a) - 1)].tolist():
        ends = (float(omega[i - 1]), float(omega[i + 1]))
        best = minimize_scalar(lambda w: -height(w), bounds=ends, method="bounded", options={"xatol": 1e-9 * ends[1]})
        out.append(float(best.x) if -best.fun > a[i] else float(omega[i]))
    return out
