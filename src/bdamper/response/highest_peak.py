"""The highest point of a response curve: one definition for peaks, optimal curves, margins and curves along a line.

It is the greatest maximum of the response over the branches that count: at smooth maxima, at corners, at folds, and where
the mean position drifts.  An end of the interval is no maximum, it may be a flank of the next resonance: it counts only
where there is no maximum at all, and is told where it is higher.  Closed branches do not count, and if a branch leads from
end to end of the interval, those that enter and leave at the same end do not (``ResponseCurve.apart``);
``ResponseCurve.detached`` and ``ResponseCurve.separate`` name the highest point of each.  Any other branch counts, also
one whose path broke off.

Points of a curve are converged, but may be coarse.  So the highest ones are refined: smooth maxima by their own equations
(:func:`bdamper.response.peak.find_peak`), others by a corrector at the point itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import OK, Equations, Plane
from bdamper.harmonic_balance.problem import Problem
from bdamper.response.continuation import MANY_FOLDS
from bdamper.response.events import ContinuationOptions
from bdamper.response.peak import (
    AT_END,
    LOOSEST,
    Peak,
    PeakOptions,
    amplitude_at,
    coarse_options,
    find_peak,
    peak_interval,
    same_peak,
)
from bdamper.response.response_curve import frequency_response
from bdamper.response.response_curve_result import ResponseCurve, uninterrupted
from bdamper.util import validation
from bdamper.util.errors import COMPLETE, INCOMPLETE, NOT_FOUND, BdamperError, status_word, with_reason
from bdamper.util.formatting import peak_text
from bdamper.util.progress import Cost, CostMeter, one_thread
from bdamper.util.storage import from_json

NEAR = 3e-3
"""Relative, by which a point may lie below the highest and its maximum above: a curve followed coarsely is off by less."""
LEVEL = 1e-6
"""Relative change of the amplitude up to which points of a curve count as one, the mean position alone moves there; and of
the frequency, at an end of the interval."""
REACH = 0.3
"""Distance, relative to the vibration, within which the maximum of a point is looked for: twice a step of a curve; and that
of a peak between the peaks of two preloads."""


@dataclass(frozen=True)
class Highest:
    """The highest point of a curve, refined.

    Parameters
    ----------
    peak : Peak
        ``corner`` unless it is a smooth maximum.
    kind : {"peak", "corner", "drift", "fold", "end"}
        "end" is an end of the interval, which is no maximum.
    index : int
        Of the point of the curve.
    exact : bool
        Whether the place is known to the tolerance of the options: not that of a corner that no search has ended at.
    note : str
        Where an end of the interval, or a separate branch, is higher than the highest maximum.
    """

    peak: Peak
    kind: str
    index: int
    exact: bool = True
    note: str = ""

    @property
    def status(self) -> str:
        """Status of the peak; "incomplete" with the reason at an end of the interval."""
        if self.kind != "end":
            return self.peak.status
        return with_reason(INCOMPLETE, "; ".join(filter(None, (AT_END, self.note))))


def highest_of_curve(system: Equations, curve: ResponseCurve, *, options: PeakOptions | None = None) -> Highest:
    """The highest point of a curve, as the head of this module defines it.

    Parameters
    ----------
    system : Equations
        Equations that the curve solves.
    curve : ResponseCurve
    options : PeakOptions
        How exactly maxima are refined.

    Raises
    ------
    BdamperError
        If there is no point on a branch that counts.
    """
    search = _Refined(system, curve, options or PeakOptions())
    amplitude, tops = curve.amplitude, _tops(curve.amplitude, curve.point_kind, curve.branch)
    apart = curve.apart
    counted = [i for i in tops if not apart[i]]
    if not counted:
        raise BdamperError("the response curve has no point that is connected with an end of the interval")
    within = [i for i in counted if not search.at_end(i)]
    first, *others = within or counted[:1]
    best = search.at(first)
    for i in others:
        if amplitude[i] * (1.0 + NEAR) < best.peak.amplitude:
            break
        best = max(best, search.at(i), key=lambda found: found.peak.amplitude)
    notes, top = [], counted[0]
    if search.at_end(top) and amplitude[top] > best.peak.amplitude and best.kind != "end":
        notes.append(f"higher at an end of the interval: {peak_text(amplitude[top], curve.frequency[top], 4)}")
    if higher := curve.higher(best.peak.amplitude):
        notes.append(higher)
    return replace(best, note="; ".join(notes))


def maxima(system: Equations, curve: ResponseCurve, share: float = 0.0) -> tuple[Peak, ...]:
    """All maxima of a response curve within its interval from a share of the highest on, each once, the highest first."""
    search = _Refined(system, curve, PeakOptions())
    found: list[Peak] = []
    for i in _tops(curve.amplitude, curve.point_kind, curve.branch):
        if curve.amplitude[i] < share * curve.amplitude.max():
            break
        top = search.at(i)
        if top.kind != "end" and not any(same_peak(top.peak, other) for other in found):
            found.append(top.peak)
    return tuple(sorted(found, key=lambda p: -p.amplitude))


def _tops(amplitude: NDArray, kinds: Sequence[str], branch: NDArray) -> list[int]:
    """Points no lower than those beside them on their branch, one of each plateau, the highest first."""
    out: list[int] = []
    for number in np.unique(branch):
        on = np.flatnonzero(branch == number)
        level = np.abs(np.diff(amplitude[on])) <= LEVEL * amplitude[on[1:]]
        plateaus = np.split(on, np.flatnonzero(~level) + 1)
        height = np.array([-np.inf, *(amplitude[part].max() for part in plateaus), -np.inf])
        for part, top in zip(plateaus, (height[1:-1] > height[:-2]) & (height[1:-1] > height[2:])):
            if top:
                named = (i for kind in ("drift", "maximum") for i in part if kinds[i] == kind)
                out.append(int(next(named, part[amplitude[part].argmax()])))
    return sorted(out, key=lambda i: -amplitude[i])


@dataclass(frozen=True)
class _Refined:
    """Refines points of one curve; parameters are those of :func:`highest_of_curve`."""

    system: Equations
    curve: ResponseCurve
    options: PeakOptions

    @cached_property
    def y(self) -> NDArray:
        """(n, n_unknowns + 1) points of the curve."""
        return np.column_stack([self.curve.unknowns, 2.0 * np.pi * self.curve.frequency])

    def at_end(self, i: int) -> bool:
        """Whether a point is where its branch leaves the interval, or where the mean position drifts there."""
        omega, branch = self.y[:, -1], self.curve.branch
        on = np.flatnonzero(branch == branch[i])[[0, -1]]
        leaves = [j for j in on if omega[j] - omega.min() <= LEVEL * omega[j] or omega.max() - omega[j] <= LEVEL * omega[j]]
        return any(abs(omega[j] - omega[i]) <= LEVEL * omega[i] for j in leaves)

    def at(self, i: int) -> Highest:
        """A top of the curve: the smooth maximum beside it, or the point itself."""
        y, on = self.y[i], np.flatnonzero(self.curve.branch == self.curve.branch[i])
        tangent, scale = self._direction(max(i - 1, on[0]), min(i + 1, on[-1]), y)
        low, high = self.y[:, -1].min(), self.y[:, -1].max()
        if self.at_end(i):
            return Highest(self._point(y, np.eye(len(y))[-1], scale), "end", i)
        if self.curve.point_kind[i] == "drift":
            return Highest(self._point(y, tangent, scale), "drift", i)
        for options in (self.options, replace(self.options, tolerance=max(self.options.tolerance, LOOSEST))):
            found = find_peak(
                self.system, y, tangent=tangent, scale=scale, options=options, parameter=self.curve.preload, reach=REACH
            )  # fmt: skip
            good = found.converged and found.amplitude >= (1.0 - LEVEL) * self.curve.amplitude[i]
            if good and low <= found.y[-1] <= high:
                return Highest(found, "corner" if found.corner else "peak", i)
        kind = "fold" if self.curve.point_kind[i] == "fold" else "corner"
        return Highest(self._point(y, tangent, scale), kind, i, exact=False)

    def _direction(self, before: int, after: int, y: NDArray) -> tuple[NDArray, NDArray]:
        """Direction of the curve in scaled unknowns, of unit length, from two of its points, and the units."""
        chord = self.y[after] - self.y[before]
        scale = self.system.units(y, max(abs(float(chord[-1])), 1e-6 * y[-1]))
        chord = chord / scale
        if np.linalg.norm(chord[self.system.n_mean :]) > 0.0:
            chord[: self.system.n_mean] = 0.0
        size = float(np.linalg.norm(chord))
        return (chord / size, scale) if size > 0.0 else (np.eye(len(y))[-1], scale)

    def _point(self, y: NDArray, normal: NDArray, scale: NDArray) -> Peak:
        """A point of a curve as a peak without slope, corrected to the tolerance where that can be met."""
        c = self.system.solve(y, Plane(normal), scale, max(self.options.tolerance, LOOSEST), self.options.max_iterations)
        good = c.status == OK and float(np.linalg.norm(((c.y - y) / scale)[self.system.n_mean :])) < REACH
        at = c.y if good else y
        nothing, frequency = np.zeros(len(y)), float(at[-1] / (2.0 * np.pi))
        return Peak(
            self.curve.preload, frequency, amplitude_at(self.system, at), at, nothing, scale, 0.0, -np.inf,
            np.array(c.shares), c.residual, c.iterations, 1, c.rank_deficiency, True,
        )  # fmt: skip


def given_up(curve: ResponseCurve) -> str:
    """Where a path of a curve ended among many folds, so that its branch may be higher; empty without such a path."""
    parts = (f"{part.low:.6g} to {part.high:.6g} Hz" for part in curve.missing_ranges if part.why.startswith(MANY_FOLDS))
    where = " and ".join(parts)
    return f"a branch was given up among many folds from {where}" if where else ""


@dataclass(frozen=True)
class AtPreload:
    """The response over frequency at one preload, and its highest point.

    Parameters
    ----------
    preload : float, N
    curve : ResponseCurve
        Of an optimal curve without its unknowns.
    top : Highest, optional
        Its highest point, None where nothing was found.
    slope : float
        d ln(amplitude)/d ln(preload) of that, NaN where it has none, as at a corner, or was not asked for.
    rattles : str
        Why no steady periodic response is expected, if the curve shows the sign (:mod:`bdamper.response.response_curve`).
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
        """Whether no maximum of the branches that were followed is higher; see :func:`given_up`."""
        return self.top is not None and self.curve.complete and self.top.kind != "end"

    @property
    def height(self) -> float:
        """Amplitude (m) of the highest point, NaN where nothing was found."""
        return np.nan if self.top is None else self.top.peak.amplitude

    @property
    def value(self) -> float:
        """ln(amplitude) of the highest point, infinite where that is not known."""
        return float(np.log(self.height)) if self.known else np.inf

    @property
    def status(self) -> str:
        """ "complete", "incomplete" or "not found", with what is to be said of it."""
        if self.top is None or not self.curve.complete:
            own = NOT_FOUND if self.top is None else INCOMPLETE
            return with_reason(own, f"{self.curve.status}: {self.curve.reason}".removeprefix(f"{own}: "))
        if self.top.kind == "end":
            return self.top.status
        return with_reason(COMPLETE, "; ".join(filter(None, (self.top.note, given_up(self.curve)))))

    def record(self) -> dict[str, Any]:
        """All of it in numbers, texts, lists and arrays."""
        return {"index": repr(self.preload), **asdict(self)}

    @staticmethod
    def of(record: Mapping[str, Any]) -> AtPreload:
        """Restore a record read from JSON, in which arrays of a curve without points have no shape."""
        made: AtPreload = from_json(AtPreload, record)
        curve, n = made.curve, len(made.curve)
        harmonics, shares = curve.harmonics.reshape(n, 2), curve.shares.reshape(n, 3)
        return replace(made, curve=replace(curve, unknowns=np.zeros((n, 0)), harmonics=harmonics, shares=shares))


def found_at(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    options: PeakOptions | None = None,
    budget: int | None = None,
) -> AtPreload:
    """The whole curve at a preload, followed coarsely, and its highest point.

    Where the coarse curve is not complete, where one of its paths ended among many folds, or where no search has ended at
    its highest point, it is followed again with the default settings, if it has not used up a given budget.  Of two
    complete curves the higher one counts: among 107 folds of a disk with 24 points (friction 0.6, engine order 10, 65.6 N)
    the coarse one lost a peak 34 % higher.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    frequency : (low, high), Hz
    options : PeakOptions
    budget : int, optional
        Evaluations that each curve may take.

    Raises
    ------
    InterruptedCurve
        On Ctrl-C.
    """
    meter = CostMeter()
    system, before = None, None
    if problem.static(preload).converged:
        system = problem.system(preload)
        meter.watch(system)  # which the curves use as well
    for continuation in (coarse_options(), ContinuationOptions()):
        continuation = continuation if budget is None else replace(continuation, budget=budget)
        curve = uninterrupted(frequency_response(problem, preload, frequency, options=continuation))
        top: Highest | None = None
        meter.count(curve.cost.iterations, curve.cost.failed_steps)
        if len(curve) and system is not None:
            top = highest_of_curve(system, curve, options=options)
            meter.count(top.peak.iterations)
        height = (1.0 + LEVEL) * top.peak.amplitude if curve.complete and top is not None else 0.0
        if before is not None and before[1].peak.amplitude > height:
            curve, top = before
        spent = budget is not None and curve.cost.evaluations >= budget  # closer steps come less far with as many
        if spent or (curve.complete and top is not None and top.exact and not given_up(curve)):
            break
        before = (curve, top) if curve.complete and top is not None and top.exact else None
    return AtPreload(preload, curve, top, np.nan, "", meter.read())


@one_thread
def highest_peak(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float] | None = None,
    *,
    mode: int = 1,
    options: PeakOptions | None = None,
) -> Peak:
    """The highest point of the response at one preload (:mod:`bdamper.response.highest_peak`).

    ``corner`` says that it is no smooth maximum, ``search_status`` whether an end of the interval is higher.  Where the
    interval holds no maximum, the peak is "incomplete": its amplitude is the highest response, at an end, and no resonance.

    Raises
    ------
    BdamperError
        If no response was found in the interval.
    """
    preload = problem.check_preload(preload)
    frequency = peak_interval(problem, frequency, preload, mode)
    check_options(options)
    found = found_at(problem, preload, frequency, options=options)
    if found.top is None:
        raise BdamperError(
            f"no peak found at {preload:g} N between {frequency[0]:.6g} and {frequency[1]:.6g} Hz; the response curve "
            f"ended as: {found.status}"
        )
    settings = problem.record() | {"frequency": list(frequency)}
    status = found.top.status if status_word(found.status) == COMPLETE else found.status
    return replace(
        found.top.peak, cost=found.cost, search_status=found.status, status=status, settings=settings,
        model_hash=problem.model.hash,
    )  # fmt: skip


def check_options(options: PeakOptions | None) -> None:
    """Whether the options of a peak are such, or None."""
    if options is not None:
        validation.instance("options", options, PeakOptions)
