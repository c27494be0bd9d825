"""Response curves: amplitude over frequency with all branches, and where they came from.

The response at the chosen location and direction is ``x(t) = x_0 + Re sum_l X_l exp(i l omega t)``.  ``amplitude`` is
``|X_1|``, the harmonic of the excitation; ``peak_to_peak`` sums up all harmonics.

A point between two folds, where the curve runs back in frequency, is marked as not stable: without further knowledge this
is the plain rule of one fold after another; ``stable``, where it was computed, says what is so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.coverage import NO_SOLUTION, LeftOut
from bdamper.continuation.slow_sweep import SlowSweep, slow_sweep
from bdamper.util.cost import Cost
from bdamper.util.differences import Comparable
from bdamper.util.errors import BdamperError
from bdamper.util.estimates import ErrorEstimates, error_line
from bdamper.util.hdf5 import Recorded, Storable
from bdamper.util.ladder import Ladder
from bdamper.util.plotting import Fact, Plottable
from bdamper.util.repr import brief
from bdamper.util.status import INTERRUPTED, Status
from bdamper.util.tables import ROW, Followed, Hertz, Kinds, Metres, Numbers, Quantity, Radians, Shares, Tabular
from bdamper.util.text import amount, height


@brief
@dataclass(frozen=True)
class Fold:
    """A point of a curve where it turns: in frequency, or at its largest response.

    Parameters
    ----------
    frequency : float, Hz
    amplitude : float, m
    index : int
        Of the point in the curve.
    kind : {"fold", "peak", "highest, no peak", "detached"}
        "highest, no peak" is the largest response at an end of the curve, where it is no maximum, "detached" that of a
        closed branch.
    """

    frequency: float
    amplitude: float
    index: int
    kind: str = "fold"

    def __str__(self) -> str:
        return f"{self.kind}: {height(self.amplitude, self.frequency, 6)} (point {self.index})"


@brief
@dataclass(frozen=True)
class Curve(Plottable, Comparable, Followed, Tabular, Recorded, Storable, kind="bdamper-curve"):
    """A response curve; every point of it is a converged solution.

    ``plot`` draws amplitude over frequency, branches that run backward dashed (:func:`bdamper.plot.plot_curve`).

    Parameters
    ----------
    kind : {"tracking", "free", "stuck"}
    frequency : (n,) float, Hz
    harmonics : (n, n_harmonics + 1) complex, m
        Response amplitudes; the first column is the mean.
    unknowns : (n, n_unknowns) float
        Modal coordinates (kg^1/2 m): mean, then cosine and sine amplitudes of each harmonic.
    residual : (n,) float
        Relative to excitation and static load.
    shares : (n, 3) float
        Stick, slip and open, mean over the friction points and the cycle.
    backward : (n,) bool
        The curve runs back in frequency here: between two folds, unstable.
    rank_deficiency : (n,) int
        Mean positions that nothing determines, held by least norm.
    branch : (n,) int
        Separate branches are numbered from 0; points of one branch follow each other along it.
    point_kind : tuple of str
        "regular", "fold", "maximum", "end" or "drift" for each point.
    preload : float, N
    status, reason : str
        "complete", "incomplete", "not found" where there is no solution to begin with, or "interrupted".
    cost : Cost
    left_out : tuple of LeftOut
        What was not followed: frequencies (Hz) without solution, tangles of folds in which a path was left, paths that
        broke off; each ``(low, high, why)``.  A complete curve has such gaps only below a thousandth of its interval.
    settings : mapping
    model_hash : str
    start_log : tuple of str
        What was tried to find the first point.
    notes : tuple of str
        What the points show besides: where a damper drifts, which mean positions nothing determines.
    stable : (n,) bool or None
        Whether small disturbances die out; see :mod:`bdamper.stability.floquet`.
    stability_note : str
        Which disturbances, and what it cost.
    in_time : (n,) float or None
        Mean amplitude of the motion in time that starts at a point over that of the point, NaN where it is not known
        (:mod:`bdamper.stability.in_time`); where it was asked for.
    error_estimates : ErrorEstimates or None
        Of the highest peak, by source, where they were asked for.
    ladder : Ladder or None
        What more harmonics change of the highest point, where a tolerance was given.
    closed : tuple of int
        Branches that close on themselves: no sweep of frequency leads to them, and their points are no ``peak``.
    """

    kind: str
    frequency: Hertz
    harmonics: Annotated[NDArray, Quantity("m", dims=(ROW, "harmonic"))]
    unknowns: NDArray
    residual: Numbers
    shares: Shares
    backward: Numbers
    rank_deficiency: NDArray
    branch: Numbers
    point_kind: Kinds
    preload: float
    status: Status
    reason: str
    cost: Cost
    left_out: tuple[LeftOut, ...] = ()
    start_log: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    stable: Numbers | None = None
    stability_note: str = ""
    in_time: Numbers | None = None
    error_estimates: ErrorEstimates | None = None
    ladder: Ladder | None = None
    closed: tuple[int, ...] = ()

    @property
    def phase(self) -> Radians:
        """(n,) float: of that harmonic."""
        return np.angle(self.harmonics[:, 1])

    @property
    def peak_to_peak(self) -> Metres:
        """(n,) float, m: range of the response over a period, all harmonics."""
        l = np.arange(1, self.harmonics.shape[1])
        theta = np.linspace(0.0, 2.0 * np.pi, 64 * len(l), endpoint=False)
        x = (self.harmonics[:, 1:] @ np.exp(1j * np.outer(l, theta))).real
        return x.max(axis=1) - x.min(axis=1)

    @property
    def rms(self) -> NDArray:
        """(n,) float, m: root mean square of the vibration over a period, all harmonics, without the mean."""
        return np.sqrt(0.5 * (np.abs(self.harmonics[:, 1:]) ** 2).sum(axis=1))

    @property
    def folds(self) -> tuple[Fold, ...]:
        """Turning points in frequency, in the order of the path."""
        amplitude = self.amplitude
        return tuple(
            Fold(float(self.frequency[i]), float(amplitude[i]), i)
            for i, kind in enumerate(self.point_kind)
            if kind == "fold"
        )

    @property
    def gap(self) -> tuple[float, float] | None:
        """Widest part of the interval without solutions, Hz; None if there is none."""
        gaps = [(part.low, part.high) for part in self.left_out if part.why == NO_SOLUTION]
        return max(gaps, key=lambda gap: gap[1] - gap[0], default=None)

    def sweep(self, direction: str = "up") -> SlowSweep:
        """What a slow sweep of frequency, "up" or "down", shows (:mod:`bdamper.continuation.slow_sweep`).

        Points count as stable by ``stable``, or where that has not been judged by the plain rule of folds.
        """
        judged = self.stable is not None
        stable = np.asarray(self.stable, bool) if judged else ~self.backward
        fold = np.array([kind == "fold" for kind in self.point_kind], bool)
        note = "stable points as judged" if judged else "stable by folds alone"
        return slow_sweep(direction, self.frequency, self.amplitude, self.branch, stable, fold, note)

    def _highest(self) -> int:
        if not len(self):
            raise BdamperError(f"the curve has no points ({self.status}: {self.reason})")
        apart = np.isin(self.branch, self.closed)
        return int(np.argmax(np.where(apart & ~apart.all(), -1.0, self.amplitude)))

    @property
    def detached(self) -> tuple[Fold, ...]:
        """The largest response of each closed branch, which does not count for the peak."""
        on = (np.flatnonzero(self.branch == number) for number in self.closed)
        tops = [int(i[np.argmax(self.amplitude[i])]) for i in on]
        return tuple(Fold(float(self.frequency[i]), float(self.amplitude[i]), i, "detached") for i in tops)

    @property
    def peak(self) -> Fold:
        """The largest response of branches that do not close, also where it is no maximum (``peak_at_end``)."""
        i = self._highest()
        kind = "highest, no peak" if self.peak_at_end else "peak"
        return Fold(float(self.frequency[i]), float(self.amplitude[i]), i, kind)

    @property
    def peak_at_end(self) -> bool:
        """Whether the largest response is that at the lowest or highest frequency of the curve, where it is no maximum."""
        i = self._highest()
        if self.kind == "tracking" and self.point_kind[i] in ("maximum", "fold", "drift"):
            return False
        return bool(self.frequency[i] in (self.frequency.min(), self.frequency.max()))

    @property
    def labels(self) -> NDArray:
        """(n,) str: "stable" in time, "unstable", "stable as far as N harmonics tell", or "det J > 0 with N harmonics"
        where no more than that sign is known; empty where nothing was judged."""
        if self.stable is None:
            return np.full(len(self), "", object)
        n = len(self.settings.get("harmonics", range(1, self.harmonics.shape[1])))
        so_far = f"stable as far as {n} harmonic{'s' if n > 1 else ''} tell{'s' if n == 1 else ''}"
        if "sign of det J: " in self.stability_note:  # as much as falls with few harmonics, too
            so_far = f"det J > 0 with {n} harmonic{'s' if n > 1 else ''}"
        proven = np.isfinite(self.in_time) if self.in_time is not None else np.zeros(len(self), bool)
        return np.where(self.stable, np.where(proven, "stable", so_far), "unstable")

    def facts(self) -> tuple[Fact, ...]:
        """What the curve is of, where it is highest, and how it was found."""
        head = (Fact("preload", self.preload, "N"), Fact(f"{self.kind} curve", f"{self.status}, {len(self)} points"))
        if not len(self):
            return (*head, Fact("reason", self.reason))
        top, ladder = self.peak, self.ladder
        unstable = np.nan if self.stable is None else float(np.mean(~self.stable))
        share = [(name, 100.0 * float(x)) for name, x in zip(("stick", "slip", "open"), self.shares[top.index])]
        return (
            *head,
            Fact("highest amplitude, no peak" if self.peak_at_end else "peak amplitude", top.amplitude, "m"),
            Fact("at the frequency", top.frequency, "Hz"),
            *(Fact(f"{name} there", round(x, 1), "%") for name, x in share if np.isfinite(x)),
            Fact("folds", len(self.folds)),
            *([] if np.isnan(unstable) else [Fact("unstable points", round(100.0 * unstable, 1), "%")]),
            *(Fact("not followed", str(part)) for part in self.left_out),
            *([Fact("error", error_line(self.error_estimates))] if self.error_estimates is not None else []),
            *([] if ladder is None else [Fact("harmonics", ladder.note)]),
        )

    def bottom_line(self) -> str:
        if not len(self):
            return f"No point of this curve was found: {self.reason}."
        top, low, high = self.peak, float(self.frequency.min()), float(self.frequency.max())
        what = {"tracking": "Resonance", "free": "Free resonance", "stuck": "Stuck resonance"}[self.kind]
        load = f" under a preload of {amount(self.preload, 'N')}" if self.kind == "tracking" else ""
        out = [f"{'Highest response' if self.peak_at_end else what} of {height(top.amplitude, top.frequency)}{load}."]
        if self.peak_at_end:
            out.append(f"It lies at an end of the curve ({amount(low, 'Hz')} to {amount(high, 'Hz')}) and is no peak.")
        jumps = [j for way in ("up", "down") for j in self.sweep(way).jumps if j.choices] if self.folds else []
        size, at = max(((abs(j.after - j.before), j.frequency) for j in jumps), default=(0.0, 0.0))
        if size > 0.01 * top.amplitude:  # smaller ones are not seen in a picture
            out.append(f"A slow sweep of frequency jumps by up to {amount(size, 'm')}, at {amount(at, 'Hz')}.")
        if not self.complete:
            out.append(f"The curve is {self.status}, there may be a higher one: {self.reason}.")
        return " ".join(out)

    def details(self) -> str:
        head = f"{self.kind} curve, preload {self.preload:g} N: {len(self)} points, {self.status} ({self.reason})"
        if not len(self):
            return head
        c = self.cost
        top = f"{self.peak.amplitude:.6g} m at {self.peak.frequency:.6g} Hz"
        end = "the end of the interval" if self.complete else "an end of the curve"
        top = f"highest {top}, {end}: no peak" if self.peak_at_end else f"peak {top}"
        lines = [head, f"  {top}, {len(self.folds)} folds, largest residual {self.residual.max():.1e}"]
        if c.evaluations:
            lines.append(f"  {c}")
        if self.stable is not None:
            lines.append(f"  {int((~self.stable).sum())} points unstable ({self.stability_note})")
        lines += [f"  {part}, of a closed branch" for part in self.detached]
        lines += [f"  left out: {part}" for part in self.left_out]
        lines += [f"  {note}" for note in self.notes]
        if self.kind == "tracking":
            lines.append(f"  {error_line(self.error_estimates)}")
        if self.ladder is not None:
            lines += [f"  {line}" for line in self.ladder.details().split("\n")]
        return "\n".join(lines)


class InterruptedCurve(KeyboardInterrupt):
    """Ctrl-C while a curve was followed for something else; the curve so far is kept."""

    def __init__(self, curve: Curve) -> None:
        super().__init__(curve.reason)
        self.curve = curve


def uninterrupted(curve: Curve) -> Curve:
    """The curve; what is made of it must not go on as if it were whole.

    Raises
    ------
    InterruptedCurve
        If Ctrl-C has ended it.
    """
    if curve.status == INTERRUPTED:
        raise InterruptedCurve(curve)
    return curve
