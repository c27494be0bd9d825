"""Highest point of a response curve.

Peaks, optimal curves, margins and curves along an engine order line use this point.  It is the
largest maximum of the response over all branches that count: a smooth maximum, a corner, a fold, or
a point at which the mean position drifts.  An end of the interval is not a maximum, because it may
lie on the flank of the next resonance. It counts only if there is no maximum; if an end is higher
than the largest maximum, a note reports it.  Closed branches do not count.  If a branch connects
both ends of the interval, branches that enter and leave at the same end do not count
(``ResponseCurve.apart``); ``ResponseCurve.detached`` and ``ResponseCurve.separate`` list their
highest points.  All other branches count, including incomplete ones.

The points of a curve are converged but may be coarse, so the highest ones are refined: smooth
maxima by the equations of a peak (:func:`bdamper.response.peak.find_peak`), others by a corrector
at the point.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import OK, Equations, Plane
from bdamper.harmonic_balance.problem import LoadCase, Problem
from bdamper.response.continuation import MANY_FOLDS
from bdamper.response.events import ContinuationOptions
from bdamper.response.linear_limits import linear_peak
from bdamper.response.motion_range import half_range
from bdamper.response.peak import (
    AT_END,
    LOOSEST,
    Peak,
    PeakOptions,
    amplitude_at,
    coarse_options,
    find_peak,
    same_peak,
)
from bdamper.response.response_curve import frequency_response, open_at_rest, rattles
from bdamper.response.response_curve_result import NO_STEADY, ResponseCurve, uninterrupted
from bdamper.response.richer_peak import NEARLY_HIGHEST, peak_errors
from bdamper.util import validation
from bdamper.util.errors import INCOMPLETE, NOT_FOUND, BdamperError, Ending
from bdamper.util.formatting import peak_text
from bdamper.util.progress import Cost, CostMeter
from bdamper.util.records import from_json

NEAR = 3e-3
"""Largest relative difference between a maximum and the nearest point of a coarse curve."""
LEVEL = 1e-6
"""Relative change of the amplitude below which neighbouring points are one plateau (only the mean
position moves), and of the frequency at an end of the interval.
"""
REACH = 0.3
"""Largest distance of a maximum from a point of the curve, relative to the vibration: twice a step
of a curve.  Also the largest distance of a peak from the interpolation between two preloads.
"""


HIGHER_AT_END = "higher at an end of the interval"
"""Beginning of the note on an end of the interval that is higher than the highest maximum."""
FOLLOWED = "higher on the peak followed from"
"""Beginning of the note on a peak that exists at the next lower preload and still at this one."""


FAR_BELOW_FREE = 0.01
"""Ratio to the resonance without contact below which a peak of another mode is no answer if the
preload is less than the excitation.  A shroud of a random sector has 0.5 um at 929 Hz in contact,
and 524 um at 149 Hz without.  Its faces close the ring: started from the free motion at 149 Hz,
time integration falls below 1 um within 14 periods.  The limit thus raises a doubt and proves
nothing.
"""
ANOTHER_MODE = 1.5
"""Ratio to the frequency of the free resonance from which a peak belongs to another mode."""


@dataclass(frozen=True)
class Highest:
    """Refined highest point of a curve.

    Parameters
    ----------
    peak : Peak
        ``corner`` unless it is a smooth maximum.
    kind : {"peak", "corner", "drift", "fold", "end"}
        "end" is an end of the interval, not a maximum.
    index : int
        Index of the point of the curve.
    exact : bool
        Whether the position meets the tolerance of the options; False for a corner at which no
        search converged.
    note : str
        Reports an end of the interval or a separate branch that is higher than the highest maximum,
        or a possible resonance of colliding faces.
    """

    peak: Peak
    kind: str
    index: int
    exact: bool = True
    note: str = ""

    @property
    def ending(self) -> Ending:
        """Status: "incomplete" at an end of the interval, or if a higher amplitude is known."""
        if self.kind == "end":
            reason = f"{AT_END}, without a maximum in it"
            if self.note:
                reason = f"{reason}; {self.note}"
            return Ending(INCOMPLETE, reason)
        # a branch or an end that is higher than the highest maximum: the maximum is no answer
        if self.note:
            return Ending(INCOMPLETE, self.note)
        return Ending(self.peak.status, self.peak.reason)


def highest_of_curve(
    system: Equations, curve: ResponseCurve, *, options: PeakOptions | None = None
) -> Highest:
    """Return the highest point of a curve, as defined in the docstring of this module.

    Parameters
    ----------
    system : Equations
        Equations of the curve.
    curve : ResponseCurve
    options : PeakOptions
        Accuracy of the refinement.

    Raises
    ------
    BdamperError
        If no branch that counts has a point.
    """
    refined = _Refined(system, curve, options or PeakOptions())
    amplitude = curve.amplitude
    apart = curve.apart
    tops = _tops(amplitude, curve.point_kind, curve.branch)
    counted = [i for i in tops if not apart[i]]
    if not counted:
        raise BdamperError(
            "no branch of the response curve reaches an end of the frequency interval; widen the "
            "interval"
        )
    # an end of the interval counts only without a maximum
    candidates = [i for i in counted if not refined.at_end(i)]
    if not candidates:
        candidates = counted[:1]
    best = refined.at(candidates[0])
    for i in candidates[1:]:
        # the refined maximum of a coarse point is at most NEAR higher, and all others are lower
        if amplitude[i] * (1.0 + NEAR) < best.peak.amplitude:
            break
        other = refined.at(i)
        if other.peak.amplitude > best.peak.amplitude:
            best = other

    notes = []
    top = counted[0]
    if best.kind != "end" and refined.at_end(top) and amplitude[top] > best.peak.amplitude:
        end = peak_text(amplitude[top], curve.frequency[top], 4)
        notes.append(f"{HIGHER_AT_END}: {end}")
    higher = curve.higher(best.peak.amplitude)
    if higher:
        notes.append(higher)

    # between points of the curve the range may be larger at the refined peak
    range_at_peak = float(half_range(system.response(best.peak.y[:-1])))
    peak = replace(best.peak, half_range=max(curve.half_range, range_at_peak))
    return replace(best, peak=peak, note="; ".join(notes))


def maxima(system: Equations, curve: ResponseCurve, share: float = 0.0) -> tuple[Peak, ...]:
    """Return all distinct maxima of a response curve above a fraction ``share`` of the highest, in
    descending order."""
    refined = _Refined(system, curve, PeakOptions())
    peaks: list[Peak] = []
    for i in _tops(curve.amplitude, curve.point_kind, curve.branch):
        if curve.amplitude[i] < share * curve.amplitude.max():
            break
        top = refined.at(i)
        if top.kind == "end":
            continue
        # two neighbouring points may be refined to one maximum
        if not any(same_peak(top.peak, other) for other in peaks):
            peaks.append(top.peak)
    return tuple(sorted(peaks, key=lambda peak: -peak.amplitude))


def _tops(amplitude: NDArray, kinds: Sequence[str], branch: NDArray) -> list[int]:
    """Return the local maxima of each branch, one of each plateau, in descending order."""
    tops: list[int] = []
    for number in np.unique(branch):
        points = np.flatnonzero(branch == number)
        change = np.abs(np.diff(amplitude[points]))
        level = change <= LEVEL * amplitude[points[1:]]
        # a new plateau begins after each change that is not level; most have one point
        first_of_next = np.flatnonzero(~level) + 1
        plateaus = np.split(points, first_of_next)
        height = [amplitude[plateau].max() for plateau in plateaus]
        # beyond both ends of a branch there is nothing higher
        before = [-np.inf, *height[:-1]]
        after = [*height[1:], -np.inf]
        for i, plateau in enumerate(plateaus):
            if height[i] > before[i] and height[i] > after[i]:
                tops.append(_point_of_plateau(plateau, amplitude, kinds))
    return sorted(tops, key=lambda i: -amplitude[i])


def _point_of_plateau(plateau: NDArray, amplitude: NDArray, kinds: Sequence[str]) -> int:
    """Return the point of a plateau that represents it: a drift, else a maximum, else the
    highest."""
    for kind in ("drift", "maximum"):
        for i in plateau:
            if kinds[i] == kind:
                return int(i)
    return int(plateau[amplitude[plateau].argmax()])


@dataclass(frozen=True)
class _Refined:
    """Refinement of points of one curve; for the parameters see :func:`highest_of_curve`."""

    system: Equations
    curve: ResponseCurve
    options: PeakOptions

    @cached_property
    def y(self) -> NDArray:
        """Points (n, n_unknowns + 1) of the curve: unknowns and frequency in rad/s."""
        return np.column_stack([self.curve.unknowns, 2.0 * np.pi * self.curve.frequency])

    def at_end(self, i: int) -> bool:
        """Return whether point i is at an end of its branch that is also an end of the interval.

        Along a drift several points have the frequency of the end.
        """
        omega = self.y[:, -1]
        branch = self.curve.branch
        points_of_branch = np.flatnonzero(branch == branch[i])
        for end in (points_of_branch[0], points_of_branch[-1]):
            near = LEVEL * omega[end]
            at_lower_end = omega[end] - omega.min() <= near
            at_upper_end = omega.max() - omega[end] <= near
            same_frequency = abs(omega[end] - omega[i]) <= LEVEL * omega[i]
            if (at_lower_end or at_upper_end) and same_frequency:
                return True
        return False

    def at(self, i: int) -> Highest:
        """Return the smooth maximum next to a local maximum of the curve, or the point itself."""
        y = self.y[i]
        points = np.flatnonzero(self.curve.branch == self.curve.branch[i])
        before = max(i - 1, points[0])
        after = min(i + 1, points[-1])
        tangent, scale = self._direction(before, after, y)
        if self.at_end(i):
            at_constant_frequency = np.eye(len(y))[-1]
            point = self._point(y, at_constant_frequency, scale)
            return Highest(point, kind="end", index=i)
        if self.curve.point_kind[i] == "drift":
            point = self._point(y, tangent, scale)
            return Highest(point, kind="drift", index=i)

        # where rounding exceeds the tolerance of the options, the tolerance of curves is still met
        looser = replace(self.options, tolerance=max(self.options.tolerance, LOOSEST))
        for options in (self.options, looser):
            peak = find_peak(
                self.system,
                y,
                tangent=tangent,
                scale=scale,
                options=options,
                parameter=self.curve.preload,
                reach=REACH,
            )
            # a lower maximum belongs to another part of the curve
            reached = peak.amplitude >= (1.0 - LEVEL) * self.curve.amplitude[i]
            if peak.ok and reached and self._within(peak):
                kind = "corner" if peak.corner else "peak"
                return Highest(peak, kind=kind, index=i)

        # no search converged: the point of the curve itself
        kind = "fold" if self.curve.point_kind[i] == "fold" else "corner"
        point = self._point(y, tangent, scale)
        return Highest(point, kind=kind, index=i, exact=False)

    def _within(self, peak: Peak) -> bool:
        """Return whether a peak is between the lowest and the highest frequency of the curve."""
        omega = self.y[:, -1]
        return bool(omega.min() <= peak.y[-1] <= omega.max())

    def _direction(self, before: int, after: int, y: NDArray) -> tuple[NDArray, NDArray]:
        """Return the unit chord between two points of the curve in scaled unknowns, and the units
        at ``y``.

        The chord is along the frequency if both points are the same.
        """
        n_mean = self.system.n_mean
        step = self.y[after] - self.y[before]
        # the last unknown is the frequency
        width = max(abs(float(step[-1])), 1e-6 * y[-1])
        scale = self.system.units(y, width)
        chord = step / scale
        # mean positions may drift along a curve; they give the direction only if nothing else
        # changes
        if np.linalg.norm(chord[n_mean:]) > 0.0:
            chord[:n_mean] = 0.0
        size = float(np.linalg.norm(chord))
        if size > 0.0:
            return chord / size, scale
        along_frequency = np.eye(len(y))[-1]
        return along_frequency, scale

    def _point(self, y: NDArray, normal: NDArray, scale: NDArray) -> Peak:
        """Return a point of the curve as a :class:`Peak` with zero slope and tangent.

        The point is corrected to the tolerance in the plane normal to ``normal``, if the corrector
        converges.
        """
        tolerance = max(self.options.tolerance, LOOSEST)
        corrected = self.system.solve(
            y, Plane(normal), scale, tolerance, self.options.max_iterations
        )
        point = y
        if corrected.status == OK:
            # without the mean positions, which may move far
            moved = ((corrected.y - y) / scale)[self.system.n_mean :]
            if float(np.linalg.norm(moved)) < REACH:
                point = corrected.y
        omega = point[-1]
        return Peak(
            parameter=self.curve.preload,
            frequency=float(omega / (2.0 * np.pi)),
            amplitude=amplitude_at(self.system, point),
            y=point,
            tangent=np.zeros(len(y)),
            scale=scale,
            slope=0.0,
            curvature=-np.inf,
            shares=np.array(corrected.shares),
            residual=corrected.residual,
            iterations=corrected.iterations,
            trials=1,
            rank_deficiency=corrected.rank_deficiency,
            corner=True,
        )


def given_up(curve: ResponseCurve) -> str:
    """Return a note if a path of the curve ended in a tangle of folds, so that its branch may be
    higher; otherwise ""."""
    tangles = [part for part in curve.missing_ranges if part.why.startswith(MANY_FOLDS)]
    if not tangles:
        return ""
    where = " and ".join(f"{part.low:.6g} to {part.high:.6g} Hz" for part in tangles)
    return f"the continuation of a branch was stopped among many folds from {where}"


@dataclass(frozen=True)
class AtPreload:
    """Frequency response at one preload, its highest point, and the verdict on it.

    :attr:`ending` is the only place that decides whether the highest response at a preload is
    known.  Peaks, response curves, sweeps, crossings, optimal curves and time integrations read it.

    Parameters
    ----------
    preload : float, N
    curve : ResponseCurve
        Response curve; it has no unknowns in an optimal curve.
    top : Highest, optional
        Highest point, None if nothing was found.
    slope : float
        d ln(amplitude)/d ln(preload) of the highest point; NaN at a corner or if not computed.
    rattles : str
        Reason why no steady periodic response is expected (:mod:`bdamper.response.response_curve`),
        or "".
    cost : Cost
    """

    preload: float
    curve: ResponseCurve
    top: Highest | None
    slope: float
    rattles: str
    cost: Cost

    @property
    def known(self) -> bool:
        """Whether the highest point is a maximum of a complete curve, and no higher point is known
        or could lie on a branch that was stopped.
        """
        if self.top is None or not self.curve.complete or given_up(self.curve):
            return False
        return self.top.kind != "end" and not self.top.note

    @property
    def followed(self) -> bool:
        """Whether the highest point was followed from a lower preload
        (:mod:`bdamper.response.followed_peak`)."""
        return self.top is not None and self.top.note.startswith(FOLLOWED)

    @property
    def amplitude(self) -> float:
        """Amplitude (m) of the highest point: NaN if nothing was found or no digits remain,
        infinite if unbounded."""
        if self.top is None:
            return np.nan
        # a resonance whose amplitude is unbounded or has no significant digits may exceed the highest point
        without_amplitude = self.curve.without_amplitude
        if without_amplitude is not None:
            return without_amplitude.amplitude
        return self.top.peak.amplitude

    @property
    def lower_bound(self) -> tuple[float, float]:
        """Highest known amplitude (m) if the highest response is unknown, and its frequency (Hz).

        If the verdict names an end of the interval or a separate branch, which have no peak to
        report, the bound is the highest point there.  NaN if nothing was found.
        """
        if self.top is None:
            return np.nan, np.nan
        bound = self.amplitude, self.top.peak.frequency
        curve = self.curve
        if not self.top.note or not len(curve):
            return bound
        for i in (curve.peak_index, *curve.separate):
            if curve.amplitude[i] > bound[0]:
                bound = float(curve.amplitude[i]), float(curve.frequency[i])
        return bound

    @property
    def value(self) -> float:
        """ln(amplitude) of the highest point, infinite if unknown or if the damper rattles."""
        if not self.known or self.rattles:
            return np.inf
        return float(np.log(self.amplitude))

    @property
    def ending(self) -> Ending:
        """Verdict on the highest response, as a status with its reason.

        * "complete": the highest point is known.
        * "not found" with a reason that begins with :data:`NO_STEADY`: the damper rattles.
          Otherwise no solution was found.
        * "incomplete": a higher response is known or possible.  If the response is unbounded, the
          reason begins with :data:`bdamper.response.branches.UNBOUNDED`.
        """
        if self.rattles:
            return Ending(NOT_FOUND, f"{NO_STEADY} is expected at this preload: {self.rattles}")
        if self.top is None or not self.curve.complete:
            status = NOT_FOUND if self.top is None else INCOMPLETE
            # the reason does not repeat a status that the curve has as well
            reason = f"{self.curve.status}: {self.curve.reason}".removeprefix(f"{status}: ")
            return Ending(status, reason)
        of_top = self.top.ending
        if of_top.status == INCOMPLETE:
            return of_top
        tangle = given_up(self.curve)
        if tangle:
            return Ending(INCOMPLETE, f"{tangle}, where the response could be higher")
        return Ending()

    def record(self) -> dict[str, Any]:
        """Return all data as numbers, texts, lists and arrays.

        "index" identifies the preload in a results file, with all digits.
        """
        return {"index": repr(self.preload), **asdict(self)}

    @staticmethod
    def of(record: Mapping[str, Any]) -> AtPreload:
        """Restore a record read from JSON; arrays of an empty curve get their shape back."""
        restored: AtPreload = from_json(AtPreload, record)
        n_points = len(restored.curve)
        curve = replace(
            restored.curve,
            # the unknowns of the points are not stored
            unknowns=np.zeros((n_points, 0)),
            # mean and first harmonic
            harmonics=restored.curve.harmonics.reshape(n_points, 2),
            # stick, slip, separation
            shares=restored.curve.shares.reshape(n_points, 3),
        )
        return replace(restored, curve=curve)


def found_at(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    options: PeakOptions | None = None,
    budget: int | None = None,
    progress: bool = False,
) -> AtPreload:
    """Follow the curve at a preload with coarse steps, and return its highest point.

    The curve is followed again with default settings if it is incomplete, if a path ended in a
    tangle of folds, or if the highest point was not refined, unless a given budget is used up.  Of
    two complete curves the higher one counts: among 107 folds of a disk with 24 points (friction
    0.6, engine order 10, 65.6 N) the coarse one lost a peak 34 % higher.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    frequency : (low, high), Hz
    options : PeakOptions
    budget : int, optional
        Budget of each curve in evaluations.
    progress : bool
        Show a progress bar of each curve.

    Raises
    ------
    InterruptedCurve
        After Ctrl-C.
    """
    meter = CostMeter()
    case = problem.at(preload)
    if case.static.ok:
        meter.watch(case.equations)  # the curves use the same equations
    # complete curve of coarse steps of which a path ended in a tangle of folds
    coarse: tuple[ResponseCurve, Highest] | None = None
    for continuation in (coarse_options(), ContinuationOptions()):
        if budget is not None:
            continuation = replace(continuation, budget=budget)
        curve = uninterrupted(
            frequency_response(problem, preload, frequency, options=continuation, progress=progress)
        )
        meter.count(curve.cost.iterations, curve.cost.failed_steps)
        curve, top = _with_highest(case, curve, options)
        if top is not None:
            meter.count(top.peak.iterations)
        if coarse is not None:
            coarse_curve, coarse_top = coarse
            # a complete curve counts before an incomplete one, and the higher one of two
            fine_amplitude = 0.0
            if curve.complete and top is not None:
                fine_amplitude = top.peak.amplitude
            if coarse_top.peak.amplitude > (1.0 + LEVEL) * fine_amplitude:
                curve = coarse_curve
                top = coarse_top
        # default steps are shorter: with the same budget they would cover less
        spent = budget is not None and curve.cost.evaluations >= budget
        # shorter steps do not make a resonance less sharp
        hopeless = spent or curve.without_amplitude is not None
        exact = curve.complete and top is not None and top.exact
        if hopeless or (exact and not given_up(curve)):
            break
        if exact and top is not None:
            coarse = curve, top
    return _judged(case, curve, top, frequency, meter.read())


def of_curve(
    problem: Problem,
    curve: ResponseCurve,
    frequency: tuple[float, float],
    options: PeakOptions | None = None,
) -> AtPreload:
    """Return the highest point of a response curve that was followed in an interval (Hz)."""
    meter = CostMeter()
    case = problem.at(curve.preload)
    meter.watch(case.equations)
    curve, top = _with_highest(case, curve, options)
    if top is not None:
        meter.count(top.peak.iterations)
    return _judged(case, curve, top, frequency, meter.read())


def _with_highest(
    case: LoadCase, curve: ResponseCurve, options: PeakOptions | None
) -> tuple[ResponseCurve, Highest | None]:
    """Return a curve and its highest point; the curve is incomplete if it has closed branches
    alone.
    """
    if not len(curve):
        return curve, None
    try:
        return curve, highest_of_curve(case.equations, curve, options=options)
    except BdamperError as error:
        # closed branches alone: no sweep over the interval reaches them
        return replace(curve, status=INCOMPLETE, reason=str(error)), None


def _judged(
    case: LoadCase,
    curve: ResponseCurve,
    top: Highest | None,
    frequency: tuple[float, float],
    cost: Cost,
) -> AtPreload:
    """Return the response with all doubts that its curve gives."""
    why_rattling = ""
    if top is not None:
        why_rattling = rattles(curve, open_at_rest(case))
    if top is not None and curve.complete and not top.note:
        note = _resonance_apart(case, frequency, top.peak)
        if note:
            top = replace(top, note=note)
    return AtPreload(
        preload=case.preload, curve=curve, top=top, slope=np.nan, rattles=why_rattling, cost=cost
    )


BUDGET = 8000
"""First budget of a curve in evaluations.

Curves with many folds take some 4,000, with contacts 20 times too stiff up to 10,000.  A curve that
needs more is followed again with the default budget, unless the damper rattles: such curves do not
count.  With the default budget for all curves a search on the reference disk (from 10 N, three
harmonics) takes 23 instead of 11 s, with 24 points 105 instead of 35 s.
"""


def within_budget(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    options: PeakOptions | None = None,
    budget: int | None = None,
) -> AtPreload:
    """Return the highest point of :func:`found_at` with a first budget of evaluations.

    If the budget is used up, the search is repeated with the default budget, unless the damper
    rattles.
    """
    response = found_at(problem, preload, frequency, options=options, budget=budget)
    used_up = budget is not None and response.curve.cost.evaluations >= budget
    if response.known or response.rattles or not used_up:
        return response
    again = found_at(problem, preload, frequency, options=options)
    return replace(again, cost=response.cost + again.cost)


def with_errors(problem: Problem, response: AtPreload, most_steps: int = 1) -> AtPreload:
    """Return the response with the errors of its highest point, if this is a known maximum.

    Parameters
    ----------
    problem : Problem
    response : AtPreload
        Its curve has its unknowns.
    most_steps : int
        See :func:`bdamper.response.richer_peak.peak_errors`.
    """
    top = response.top
    if top is None or not response.known or response.rattles:
        return response
    meter = CostMeter()
    system = problem.system(response.preload)
    meter.watch(system)
    lower = [
        peak
        for peak in maxima(system, response.curve, NEARLY_HIGHEST)
        if not same_peak(peak, top.peak)
    ]
    found = peak_errors(problem, response.preload, (top.peak, *lower), meter, most_steps)
    peak = replace(top.peak, errors=found.errors, harmonic_peaks=found.harmonic_peaks)
    return replace(response, top=replace(top, peak=peak), cost=response.cost + meter.read())


def _resonance_apart(case: LoadCase, frequency: tuple[float, float], peak: Peak) -> str:
    """Return a note if faces that part under the excitation may have a far higher resonance.

    A curve of faces that stay closed may be complete.  Motions with colliding faces are then
    solutions apart from it, which no branch from an end of the interval reaches.
    """
    settings = case.problem.settings
    if not settings.acts_at_location:
        return ""
    force = settings.excitation.amplitude
    stays_closed = case.preload >= force
    if stays_closed or case.preload == 0.0:
        return ""
    free = linear_peak(case, frequency, stuck=False)
    of_another_mode = peak.frequency > ANOTHER_MODE * free.frequency
    far_below = peak.amplitude < FAR_BELOW_FREE * free.amplitude
    if not (of_another_mode and far_below):
        return ""
    return (
        f"the preload is {case.preload / force:.2g} times the excitation, and the response "
        f"without contact reaches {peak_text(free.amplitude, free.frequency)}: faces that collide "
        "may cause a higher resonance on a branch separate from this curve; raise the preload, "
        "or see study.motion_in_time"
    )


def as_peak(problem: Problem, response: AtPreload, frequency: tuple[float, float]) -> Peak:
    """Return the highest point at a preload; its amplitude is NaN if a higher one is possible."""
    settings = problem.record() | {"frequency": list(frequency)}
    # the highest periodic solution of a rattling damper is no bound of its motion
    if response.top is None or response.rattles:
        return _nothing_found(response, settings, problem.model.hash)
    of_search = response.ending
    end = response.top.ending if of_search.ok else of_search
    peak = replace(
        response.top.peak,
        cost=response.cost,
        search_status=of_search.status,
        search_reason=of_search.reason,
        status=end.status,
        reason=end.reason,
        notes=(
            *response.curve.self_locking,
            *response.curve.residual_forces,
            *response.curve.contact_changes,
        ),
        settings=settings,
        model_hash=problem.model.hash,
    )
    if end.ok:
        return peak
    if response.curve.without_amplitude is not None:
        return replace(peak, amplitude=response.amplitude, half_range=response.amplitude)
    # users would take this number for a result in spite of its status
    nan = float("nan")
    bound, bound_frequency = response.lower_bound
    return replace(
        peak, amplitude=nan, half_range=nan, lower_bound=bound, frequency=bound_frequency
    )


def _nothing_found(response: AtPreload, settings: dict[str, Any], model_hash: str) -> Peak:
    """Return a peak without values, whose status says why there is none."""
    none, nothing = float("nan"), np.zeros(0)
    end = response.ending
    return Peak(
        parameter=response.preload,
        frequency=none,
        amplitude=none,
        y=nothing,
        tangent=nothing,
        scale=nothing,
        slope=none,
        curvature=none,
        shares=np.full(3, none),
        residual=none,
        iterations=0,
        trials=0,
        rank_deficiency=0,
        status=end.status,
        reason=end.reason,
        cost=response.cost,
        search_status=end.status,
        search_reason=end.reason,
        settings=settings,
        model_hash=model_hash,
    )


def check_options(options: PeakOptions | None) -> None:
    """Check that the options are PeakOptions or None."""
    if options is not None:
        validation.instance("options", options, PeakOptions)
