"""Results of response curves.

The response at the chosen location and direction is ``x(t) = x_0 + Re sum_l X_l exp(i l omega t)``.
``amplitude`` is ``|X_1|``, the harmonic of the excitation; ``peak_to_peak`` includes all harmonics.

A part of the curve between two folds on which the frequency decreases is unstable by the sign of
det J (``backward``); ``unstable`` contains the points that a stability analysis found unstable, if
available.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.rotor_speed import RPM
from bdamper.harmonic_balance.subject import about, not_covered
from bdamper.response.branches import NO_DIGITS, NO_SOLUTION, UNBOUNDED, LeftOut
from bdamper.response.motion_range import exceeds, half_range
from bdamper.response.peak import (
    AT_END,
    IN_TIME,
    RESONANCES,
    Peak,
    contact_rows,
    first_harmonic_text,
    half_range_rows,
    prices,
    unchecked,
)
from bdamper.util.display import Fact, InContact, Result
from bdamper.util.errors import INCOMPLETE, INTERRUPTED, BdamperError, Ending
from bdamper.util.formatting import amount, counted, peak_text, sentence, short_repr, span
from bdamper.util.progress import Cost
from bdamper.util.statement import Row, Statement
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

NO_STEADY = "no steady periodic response"
"""Reason at preloads at which the damper rattles."""
HIGHEST_POINT = {
    "response": RESONANCES[""],
    "free": RESONANCES["free"],
    "stuck": RESONANCES["stuck"],
    "run-up": "Highest response",
}
"""Name of the highest point by the kind of a curve."""
LOCKED = "is self-locking: its static normal load is not unique"
"""Note on a body that friction alone can hold between its faces."""
STICKS = (
    "locked: no contact needs to slip, first slip at {:.3g} times the excitation; other residual "
    'forces give less, those at rest with study.replace(residual_forces="rest"), and a vibration '
    "that starts in another way may slip"
)
"""Note on a curve that starts at the locked state of a shroud."""
SLIPS = (
    "starts from the residual friction forces with which contacts slip last, at {:.3g} times the "
    "excitation; other residual forces may give more or less, those at rest with "
    'study.replace(residual_forces="rest")'
)
"""Note on a curve above first slip that starts from the same residual forces as a locked shroud."""
CONTACT_CHANGES = "the vibration changes the contact at its highest point: it {}"
"""Note on a vibration that opens or closes points of a shroud."""


@short_repr
@dataclass(frozen=True)
class ResponseCurve(
    Result,
    InContact,
    FrequencySeries,
    Tabular,
    Recorded,
    Storable,
    kind="bdamper-curve",
):
    """Response curve; every point is a converged solution.

    ``plot`` draws the amplitude against frequency, with backward branches dashed
    (:func:`bdamper.plot.plot_curve`).

    Parameters
    ----------
    kind : {"response", "free", "stuck", "run-up"}
        "run-up": along an engine order line, with the rotor speed proportional to the frequency.
    frequency : (n,) float, Hz
    harmonics : (n, n_harmonics + 1) complex, m
        Response amplitudes; the first column is the mean.
    unknowns : (n, n_unknowns) float
        Modal coordinates (kg^1/2 m): mean, then cosine and sine amplitudes of each harmonic.  Empty
        for a run-up.
    residual : (n,) float
        Residual of the equations, relative to the excitation and the static load.
    shares : (n, 3) float
        Fractions of the cycle in stick, slip and separation, mean over the friction points.
    backward : (n,) bool
        Whether the frequency decreases along the curve, as in the unstable part between two folds.
    rank_deficiency : (n,) int
        Number of undetermined mean positions, for which the solution has minimum norm.
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
        Omissions ``(low, high, why)``, Hz: frequencies without solution, tangles of folds,
        incomplete paths, an unbounded resonance.  The gaps of a complete curve are narrower than a
        thousandth of the interval.
    settings : mapping
    model_hash : str
    start_log : tuple of str
        Attempts to find first points.
    notes : tuple of str
        Further observations: drifting or undetermined mean positions.
    unstable : (n,) bool or None
        Whether a small disturbance is known to grow; ``labels`` shows which other points are known
        to be stable (:mod:`bdamper.time_domain.floquet`).
    stability_note : str
        Criterion, disturbances considered, and the cost.
    in_time : (n,) float or None
        Mean amplitude by time integration of the motion that starts at a point, relative to the
        point; NaN if unknown (:mod:`bdamper.time_domain.floquet`).
    closed : tuple of int
        Closed branches.  No frequency sweep leads to them, and they do not count for ``peak``.
    speed : (n,) float, rad/s, or None
        Rotor speed of a run-up.
    blades : (n, n_blades, n_harmonics + 1) complex, m, or None
        Response of every blade of a bladed disk in its local axes; ``harmonics`` is the response of
        the blade with the largest amplitude.
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
    # without a default, unlike that of the base class
    status: str = field()
    reason: str = field()
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
    _called = "curve"
    _summary_fields = (
        "preload",
        "kind",
        "status",
        "peak.status",
        "peak.amplitude",
        "peak.frequency",
        "at_peak",
        "unstable_count",
        "stability_note",
        "turning_points",
        "missing_ranges",
    )

    @property
    def phase(self) -> Radians:
        """Phase (n,) of the first harmonic, rad."""
        return np.angle(self.harmonics[:, 1])

    @property
    def peak_to_peak(self) -> Metres:
        """Difference (n,) in m between the highest and lowest response in a period.

        All harmonics are included.
        """
        return 2.0 * half_range(self.harmonics)

    @property
    def self_locking(self) -> tuple[str, ...]:
        """Notes on bodies that friction alone can hold between their faces."""
        return tuple(note for note in self.notes if LOCKED in note)

    @property
    def sticks(self) -> tuple[str, ...]:
        """Note on a curve that starts at the locked state of a shroud, if it does."""
        return self._notes_like(STICKS)

    @property
    def residual_forces(self) -> tuple[str, ...]:
        """Note on a curve of a shroud that starts from residual friction forces."""
        return (*self.sticks, *self._notes_like(SLIPS))

    @property
    def contact_changes(self) -> tuple[str, ...]:
        """Note on a vibration that opens or closes points of a shroud, if it does."""
        return self._notes_like(CONTACT_CHANGES)

    def _notes_like(self, text: str) -> tuple[str, ...]:
        """Return the notes that begin as a text before its first value."""
        begins, _, _ = text.partition("{")
        return tuple(note for note in self.notes if note.startswith(begins))

    @property
    def half_range(self) -> float:
        """Largest half of the peak-to-peak response (m); closed and separate branches do not count.

        NaN for the curves that an optimal curve stores, which have the first harmonic only.
        """
        if self.kind == "response" and not self.unknowns.shape[1]:
            return float("nan")
        if self.without_amplitude is not None:
            return self.without_amplitude.amplitude
        return 0.5 * float(self.peak_to_peak[self._counted].max(initial=0.0))

    @property
    def folds(self) -> NDArray:
        """Indices (k,) of the turning points in frequency, in the order of the path."""
        return np.flatnonzero([kind == "fold" for kind in self.point_kind])

    def point_text(self, i: int, kind: str) -> str:
        """Return the kind of a point, such as "fold", with amplitude, frequency and index."""
        return f"{kind}: {peak_text(self.amplitude[i], self.frequency[i], 6)} (point {i})"

    @property
    def turning_points(self) -> tuple[str, ...]:
        """Descriptions of the folds and of the highest points of other branches.

        These branches are :attr:`detached` or :attr:`separate`.
        """
        folds = [self.point_text(i, "fold") for i in self.folds]
        detached = [self.point_text(i, "detached") for i in self.detached]
        separate = [self.point_text(i, "separate") for i in self.separate]
        return (*folds, *detached, *separate)

    @property
    def gap(self) -> tuple[float, float] | None:
        """Widest gap of the interval, Hz; None without a gap."""
        gaps = [(part.low, part.high) for part in self.missing_ranges if part.why == NO_SOLUTION]
        return max(gaps, key=lambda gap: gap[1] - gap[0], default=None)

    @property
    def without_amplitude(self) -> LeftOut | None:
        """Part with a resonance that is unbounded or has no significant digits; otherwise None."""
        for part in self.missing_ranges:
            if part.why.startswith((UNBOUNDED, NO_DIGITS)):
                return part
        return None

    def _jump(self, fold: int, reached: NDArray) -> tuple[float, float]:
        """Return the size (m) and the frequency (Hz) of the jump at a fold.

        The size is the difference from the nearest other amplitude at the frequency of the fold,
        and 0 if there is no other solution.
        """
        frequency = float(self.frequency[fold])
        # segments that do not end at the fold
        segments = np.arange(len(self) - 1)
        away = np.abs(segments - fold + 0.5) > 1.0
        joined = away & (np.diff(self.branch) == 0) & reached[1:]
        _, met = crossed(self.frequency, self.amplitude, frequency, joined)
        size = float(min(np.abs(met - self.amplitude[fold]), default=0.0))
        return size, frequency

    def _tops(self, numbers: Iterable[int]) -> NDArray:
        """Return the index of the largest response of each branch with a given number."""
        tops = []
        for number in numbers:
            points = np.flatnonzero(self.branch == number)
            tops.append(points[np.argmax(self.amplitude[points])])
        return np.array(tops, int)

    @property
    def detached(self) -> NDArray:
        """Indices (k,) of the highest points of closed branches, which are ignored for the peak."""
        return self._tops(self.closed)

    @property
    def separate(self) -> NDArray:
        """Indices (k,) of the highest points of branches that enter and leave at the same end.

        They do not count for the peak if another branch connects both ends: a slow sweep
        within the interval stays on that branch.  A sweep from beyond the end may follow the
        separate branch; a wider interval shows it.
        """
        # relative difference of the frequencies of one end
        same_end = 1e-6
        any_through = False
        returning: list[int] = []
        for number in np.unique(self.branch):
            points = np.flatnonzero(self.branch == number)
            first, last = points[0], points[-1]
            if self.point_kind[first] != "end" or self.point_kind[last] != "end":
                continue
            ends = self.frequency[first], self.frequency[last]
            if np.isclose(*ends, rtol=same_end, atol=0.0):
                returning.append(int(number))
            else:
                any_through = True
        if not any_through:
            return self._tops([])
        return self._tops(returning)

    @property
    def apart(self) -> NDArray:
        """Whether each point (n,) is ignored for the peak: on a closed or a separate branch."""
        return np.isin(self.branch, (*self.closed, *self.branch[self.separate]))

    def higher(self, amplitude: float) -> str:
        """Describe the separate branches that are higher than an amplitude (m); "" if there are
        none.
        """
        texts = []
        for i in self.separate:
            if not self.amplitude[i] > amplitude:
                continue
            of_branch = self.frequency[self.branch == self.branch[i]]
            end = amount(of_branch[0], "Hz")
            peak = peak_text(self.amplitude[i], self.frequency[i], 4)
            texts.append(
                f"higher on a separate branch that enters and leaves at {end}: {peak}, widen the "
                "interval"
            )
        return "; ".join(texts)

    @property
    def may_be_higher(self) -> str:
        """Reason why the largest response is only a lower bound of the resonance, or ""."""
        if not len(self) or self.kind not in ("response", "run-up"):
            return ""
        if not self.complete:
            return f"{self.status}, {self.reason}"
        return self.higher(float(self.amplitude[self.peak_index]))

    @property
    def without_steady(self) -> bool:
        """Whether the curve is incomplete because no steady periodic response is expected."""
        return not self.complete and self.reason.startswith(NO_STEADY)

    @property
    def out_of_reach(self) -> NDArray:
        """Whether each point is on a closed branch, or on a separate branch above the peak, (n,)."""
        separate = self.separate
        above = separate[self.amplitude[separate] > self.amplitude[self.peak_index]]
        return np.isin(self.branch, (*self.closed, *self.branch[above]))

    @property
    def _counted(self) -> NDArray:
        """Whether each point (n,) counts for the peak; all count if there is no other branch."""
        apart = self.apart
        return np.ones(len(self), bool) if apart.all() else ~apart

    @property
    def peak_index(self) -> int:
        """Index of the point of largest response; closed and separate branches do not count."""
        if not len(self):
            raise BdamperError(f"the curve has no points ({self.status_text})")
        return int(np.argmax(np.where(self._counted, self.amplitude, -1.0)))

    @property
    def peak(self) -> Peak:
        """Point of largest response, even if it is not a maximum (``peak_at_end``).

        Closed and separate branches do not count.

        It is the point ``peak_index`` of the curve, without further computation.  A maximum is
        exact to ``ContinuationOptions.locate_tolerance``.  The amplitude of an unbounded resonance
        is infinite, and NaN if it cannot be resolved.  The curve does not store its tangent, which
        is zero here; the analyses that need the tangent first correct the point by Newton's method
        (``bdamper.response.peak.with_tangent``).
        """
        i = self.peak_index
        frequency = float(self.frequency[i])
        y = np.append(self.unknowns[i], 2.0 * np.pi * frequency)
        lowest = min([*self.frequency, *(part.low for part in self.missing_ranges)])
        highest = max([*self.frequency, *(part.high for part in self.missing_ranges)])
        settings = self.settings | {"frequency": [float(lowest), float(highest)]}
        if self.is_limit:
            settings |= {"limit": self.kind}
        if self.complete:
            search = Ending()
        elif self.status == INCOMPLETE:
            search = Ending(INCOMPLETE, self.reason)
        else:
            search = Ending(INCOMPLETE, self.status_text)
        amplitude = float(self.amplitude[i])
        end = search
        if self.without_amplitude is not None:
            amplitude = self.without_amplitude.amplitude
            end = Ending(INCOMPLETE, self.without_amplitude.at_middle)
        elif self.peak_at_end:
            end = Ending(INCOMPLETE, AT_END)
        return Peak(
            parameter=self.preload,
            frequency=frequency,
            amplitude=amplitude,
            y=y,
            tangent=np.zeros(len(y)),
            scale=np.ones(len(y)),
            slope=np.nan,
            curvature=np.nan,
            shares=self.shares[i],
            residual=float(self.residual[i]),
            iterations=0,
            trials=0,
            rank_deficiency=int(self.rank_deficiency[i]),
            corner=self.point_kind[i] != "maximum",
            status=end.status,
            reason=end.reason,
            search_status=search.status,
            search_reason=search.reason,
            settings=settings,
            model_hash=self.model_hash,
            half_range=self.half_range,
        )

    @property
    def is_limit(self) -> bool:
        """Whether this is the linear response without contact or with stuck contacts."""
        return self.kind in ("free", "stuck")

    @property
    def peak_at_end(self) -> bool:
        """Whether the largest response lies at an end of the curve or at a gap, so that it is not a
        maximum.
        """
        i = self.peak_index
        if self.kind in ("response", "run-up") and self.point_kind[i] in ("maximum", "fold"):
            return False
        ends = [self.frequency.min(), self.frequency.max()]
        for part in self.missing_ranges:
            if part.why == NO_SOLUTION:
                ends += [part.low, part.high]
        return bool(np.isclose(self.frequency[i], ends, rtol=1e-6, atol=0.0).any())

    @property
    def labels(self) -> NDArray:
        """Stability of each point, or "" if unknown.

        It is "stable" or "unstable" by time integration, "stable according to N harmonics" or
        "unstable" by Floquet multipliers, and "unstable (det J < 0) with N harmonics" or "undecided
        (det J >= 0) with N harmonics" by the sign of the determinant.
        """
        if self.unstable is None:
            return np.full(len(self), "", object)
        n = len(self.settings.get("harmonics", range(1, self.harmonics.shape[1])))
        harmonics = f"{n} harmonic" if n == 1 else f"{n} harmonics"
        if "sign of det J: " in self.stability_note:
            stays = f"undecided (det J >= 0) with {harmonics}"
            leaves = f"unstable (det J < 0) with {harmonics}"
        else:
            stays = f"stable according to {harmonics}"
            leaves = "unstable"
        by_equations = np.where(self.unstable, leaves, stays)
        if self.in_time is None:
            return by_equations
        by_integration = np.where(self.unstable, "unstable", "stable")
        return np.where(np.isfinite(self.in_time), by_integration, by_equations)

    @property
    def unstable_count(self) -> int | None:
        """Number of unstable points; None if not examined."""
        if self.unstable is None:
            return None
        return int(np.sum(self.unstable))

    @property
    def at_peak(self) -> dict[str, float]:
        """Fractions of the cycle in stick, slip and separation at the peak, in per cent."""
        per_cent = np.round(100.0 * self.shares[self.peak_index], 1).tolist()
        shares = zip(("stick", "slip", "open"), per_cent)
        return {f"{name} (%)": share for name, share in shares if np.isfinite(share)}

    def _facts(self) -> tuple[Fact, ...]:
        """Return the most important values, with half of the range if it differs from the amplitude.

        A curve without points has none.
        """
        if not len(self):
            return ()
        facts = super()._facts()
        if exceeds(self.half_range, self.amplitude[self.peak_index]):
            return (*facts, Fact("half of the range", self.half_range, "m"))
        return facts

    def _unprinted(self) -> tuple[str, ...]:
        """Return the names of fields that are not printed."""
        names = super()._unprinted()
        # the preload of a limit only closes contact points
        return (*names, "preload") if self.is_limit else names

    def _statement(self) -> Statement:
        if not len(self):
            return Statement([f"No point of this curve was found: {self.reason}"])
        if self.without_amplitude is not None:
            linear = f"{self.kind} " if self.is_limit else ""
            return Statement([f"No amplitude of the {linear}resonance: {self._without_reason}"])
        remarks = []
        higher = self.higher(float(self.amplitude[self.peak_index]))
        if higher:
            remarks.append(f"The response is {higher}")
        about_joints = (*self.residual_forces, *self.contact_changes)
        remarks += [sentence(note) for note in (*self.self_locking, *about_joints)]
        if self.without_steady:
            remarks.append(f"The curve is {self.status}: {self.reason}")
            remarks.append("Remedy: study.time_response(curve), the highest steady amplitude")
        elif not self.complete:
            remarks.append(f"The curve is {self.status}: {self.reason}; there may be a higher peak")
        checks = []
        if self.blades is not None:
            effects = ["time integration", "more blade modes"]
            remarks.append(not_covered(self.settings, effects, equal_blades=False))
        elif not self.is_limit and not self.peak_at_end:
            checks = self._check_rows()
            remarks.append(not_covered(self.settings, ["more blade modes"]))
        if self.peak_at_end and self._end_of_interval:
            remarks.append(f"Remedy: {self._end_of_interval[1]}")
        times = prices(checks, self.cost, float(self.shares[self.peak_index, 2]), self.settings)
        return Statement([self._verdict()], self._quantity_rows(), checks, remarks, times=times)

    @property
    def _end_of_interval(self) -> tuple[str, str] | None:
        """End of the frequency interval with the highest point, and the remedy; None at a gap."""
        highest = self.frequency[self.peak_index]
        if np.isclose(highest, self.frequency.max(), rtol=1e-6, atol=0.0):
            return "upper", f"include frequencies above {amount(float(highest), 'Hz')}"
        if np.isclose(highest, self.frequency.min(), rtol=1e-6, atol=0.0):
            return "lower", f"include frequencies below {amount(float(highest), 'Hz')}"
        return None

    @property
    def _without_reason(self) -> str:
        part = self.without_amplitude
        return "" if part is None else part.at_middle

    def _verdict(self) -> str:
        """Return the highest point with preload or rotor speed, engine order and excitation."""
        i = self.peak_index
        peak = peak_text(self.amplitude[i], self.frequency[i])
        peak += first_harmonic_text(self.half_range, float(self.amplitude[i]))
        if self.peak_at_end:
            kind = "No peak; highest point"
            end = self._end_of_interval
            peak += f", at the {end[0]} end of the curve" if end else ", at a gap of the curve"
        elif self.without_steady:
            kind = "No steady periodic response expected; highest solution"
        elif self.may_be_higher:
            kind = "Lower bound of the resonance peak"
        else:
            kind = HIGHEST_POINT[self.kind]
        place = []
        if self.speed is not None:
            place.append(amount(float(self.speed[i]) * RPM, "rpm", 5))
        if self.blades is not None:
            place.append(f"blade {np.argmax(np.abs(self.blades[i, :, 1]))}")
        preload = self.preload if self.kind == "response" else np.nan
        return f"{kind} {peak}{about(self.settings, preload, *place)}"

    def _quantity_rows(self) -> list[Row]:
        """Return the computed range, the state at the highest point, and jumps of a slow sweep."""
        i = self.peak_index
        interval = span(float(self.frequency.min()), float(self.frequency.max()), "Hz")
        rows = [Row("Frequency", interval, counted(len(self), "point"))]
        rows += half_range_rows(self.half_range, float(self.amplitude[i]))
        if not self.is_limit:
            rows += contact_rows(
                self.shares[i], "the highest point" if self.peak_at_end else "the peak"
            )
        if self.unstable is not None and self.unstable_count is not None:
            label = str(self.labels[i])
            of_all = f"{self.unstable_count} of {counted(len(self), 'point')} unstable"
            rows.append(Row("Stability", label, of_all))
        reached = ~self.out_of_reach
        jumps = [self._jump(fold, reached) for fold in self.folds if reached[fold]]
        size, frequency = max(jumps, default=(0.0, 0.0))
        # smaller jumps are invisible in a plot
        if size > 0.01 * self.amplitude[i]:
            place = f"largest jump of a slow sweep, at {amount(frequency, 'Hz')}"
            rows.append(Row("Jump", amount(size, "m"), place))
        return rows

    def _check_rows(self) -> list[Row]:
        """Return the checks of the highest point, with the result of a stability analysis."""
        i = self.peak_index
        if self.kind == "run-up":
            return [Row(IN_TIME, "not run", "study.at_speed, then time_response")]
        preload = self.preload if self.kind == "response" else np.nan
        rows = unchecked("curve", preload)
        rows.append(Row("Estimated error", "not run", "study.estimate_errors(curve)"))
        if self.in_time is not None and np.isfinite(self.in_time[i]):
            rows[0] = Row(IN_TIME, str(self.labels[i]), "motion that starts at this point")
        return rows


def unstable_points(curve: ResponseCurve) -> NDArray:
    """Return the unstable points (n,): by a stability analysis, or by a decreasing frequency."""
    if curve.unstable is None:
        return np.asarray(curve.backward, bool)
    return np.asarray(curve.unstable, bool)


def crossed(x: NDArray, height: NDArray, at: float, joined: NDArray) -> tuple[NDArray, NDArray]:
    """Find the intersections of a curve with the line ``x = at``.

    Return the index of the first point of each segment that crosses the line, and the interpolated
    heights.  Only segments with ``joined`` belong to the curve.
    """
    difference = x - at
    changes_sign = (difference[:-1] * difference[1:] <= 0.0) & (difference[:-1] != difference[1:])
    before = np.flatnonzero(changes_sign & joined)
    after = before + 1
    share = difference[before] / (difference[before] - difference[after])
    return before, height[before] + share * (height[after] - height[before])


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
