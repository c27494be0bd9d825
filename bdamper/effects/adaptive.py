"""The highest peak with no more effects than it calls for.

The settings of the study are the answer that counts; what they would cost is spared where the indicator
(:mod:`bdamper.effects.indicator`) shows that it does not matter:

1. a rough tracking curve with one harmonic, everything else as in the study;
2. every maximum that comes near the highest is refined;
3. the highest is embedded in the full study.  The change that the full study would make is a sum over its equations,
   ``dA = -sum lambda_i R_i``: the harmonics whose equations make it up are switched on (and the elastic modes of the
   damper where they are off, if the equations that are on already have a part in it); all that there are where the
   estimate cannot be relied on.  The peak is found anew from the Newton step that the estimate comes with, and the
   question is put again, until the estimated rest is below half of the tolerance or nothing is left to switch on.  Where
   the richer peak is not as high as the estimate has it, its curve may have other maxima close by: if the full response is
   expected to be higher at a point of the first curve, it is followed to both sides, over folds, as long as it stays near
   the top, and the farther down the more the peak falls short;
4. so are the other maxima that the full study could raise above the peak found.  Points of the first curve near its top are
   asked as well: where the full response should be higher it is solved for and followed up to its maximum; where the
   estimate cannot be relied on, the curve through the peak found is followed to both sides, unless reliable ones all have
   the full response below it; to sides where it may be nearly as high the curve is followed for a little at least, as one
   maximum with few harmonics may be several with more.  Between those points a harmonic that is off may resonate in a
   narrow interval: near linear modes the full response is solved for as well, where estimates do not exclude it;
5. at the far end of the interval a solution is looked for from nothing.

If a peak cannot be carried over (what it leads to being so far away that it is another one counts as well), or if the first
curve has a summit which is no peak, the search starts anew with three harmonics on a curve followed from above, which may
have other branches; its paths are short, as long ones would spare little.  What is lost below the best peak that is known
is left at that.  A rough curve with everything on is followed if this fails too, if the first curve has no maximum or does
not reach through the interval (three harmonics show no more then, or not for less), or from the far end if there is another
solution than that in which the curve arrives; and another one from the other side if what was lost has more, even at least,
than all that the first one has.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.system import OK, HarmonicSystem
from bdamper.continuation.curve import passing, uninterrupted
from bdamper.continuation.follower import ContinuationOptions, PathPoint
from bdamper.continuation.start import first_point
from bdamper.continuation.track import track_curve
from bdamper.effects.indicator import Estimate, as_located, change_or_unknown, embed_between, highest_peaks
from bdamper.effects.rivals import (
    NEAR,
    Place,
    amplitude_of,
    near_top,
    place_at,
    place_of_peak,
    place_on_curve,
    summits,
    superharmonic_points,
)
from bdamper.peaks.carryover import AROUND, BOTH_WAYS, LOOSE, ROUGH, STAYS_UP, carried_over, higher_nearby, solutions_near
from bdamper.peaks.newton import Peak, find_peak, peak_scale, same_peak
from bdamper.problem.effects import Effects
from bdamper.util.cost import Cost, CostMeter
from bdamper.util.errors import SettingError
from bdamper.util.repr import brief

if TYPE_CHECKING:
    from bdamper.continuation.curve import Curve
    from bdamper.study import Study

MARGIN = 0.5
"""Share of the tolerance that an accepted estimate may use up."""
SURPRISE = 0.03
"""Relative difference between a change and its estimate beyond which there may be another maximum close by."""
RELIED_ON = 0.3
"""Relative size of an estimate up to which its Newton step is used."""
ANOTHER = 0.5, 0.05
"""Relative changes of amplitude and frequency beyond which it is another peak."""
APART = 0.01
"""Relative difference of vibration from which on two solutions at one frequency are two responses."""
ASKED = (0.7, 0.9)
"""Shares of the highest amplitude from which on points of a curve are asked for their full response."""
MOST_ASKED = 7
"""As many of the points above each share."""
SHORT = replace(ROUGH, max_points=300)
"""How a curve with three harmonics is followed: a path that is longer spares little against all harmonics."""
MOST_UNSOLVED = 2
"""Points beside a resonance without a full response after which no others are asked."""
CLOSE_BY = 0.9
"""Share of the amplitude of the best peak down to which the curve through it is followed at least."""
MOST_AROUND = 100
"""Points of the curve through a peak to each side."""
FOLLOWED = (AROUND, None)
"""How a curve is followed with everything on: roughly, and with the usual steps if it does not get through or is highest
where no peak was found."""


RESPONSES = {
    "stuck": "all contacts stick: the response is linear",
    "one seen": "no other response was seen; this excludes neither a detached one nor a narrow resonance of a harmonic",
    "several": "several responses coexist, and the highest peak may be another one:",
}
"""What an adaptive peak says of other responses."""


class On(NamedTuple):
    """Which of the effects that may be left out are on."""

    harmonics: tuple[int, ...]
    damper_modes: int

    def __str__(self) -> str:
        modes = f", {self.damper_modes} elastic modes" if self.damper_modes else ""
        return f"harmonics {' '.join(map(str, self.harmonics))}{modes}"


@dataclass(frozen=True)
class Remaining:
    """What the full study makes of one effect in an adaptive peak.

    Parameters
    ----------
    effect : str
    state : {"as in the study", "partly on", "off"}
        The latter two for what the study has on and the peak does not need.
    setting : str
        With which the peak was computed.
    amplitude, frequency : float
        Estimated relative change if it were as in the study; 0 where it is.
    """

    effect: str
    state: str
    setting: str
    amplitude: float
    frequency: float


class Coexisting(NamedTuple):
    """Where a search has met more than one response.

    Parameters
    ----------
    low, high : float, Hz
    kind : {"folds", "walk", "apart", "left out", "not followed"}
        A curve turns back there; the mean position may take many values; there is a solution that is not on the curve; a
        part of a curve was left out; the rest of a curve was not followed.
    text : str
    """

    low: float
    high: float
    kind: str
    text: str

    def __str__(self) -> str:
        where = f"{self.low:.6g} Hz" if self.high == self.low else f"{self.low:.6g} to {self.high:.6g} Hz"
        return f"{where}: {self.text}"


@brief
@dataclass(frozen=True)
class AdaptivePeak:
    """The highest peak of a study that was found, with no more effects than it calls for.

    The errors are those of this peak.  That no other is higher they do not tell: see ``responses``.

    Parameters
    ----------
    preload : float, N
    frequency, amplitude : float, Hz, m
    effects : Effects
        Those that were on in the end.
    y : (n_unknowns + 1,) float
        The converged solution under these effects.
    amplitude_error, frequency_error : float
        Estimated relative change that the full study would still make; 0 if all is on.
    error_bound : float
        Size of the remaining change, defect of the estimate included.
    tolerance : float
    residual : float
    status, reason : str
        "converged", or what is wrong.
    log : tuple of str
        What was switched on, and why.
    remaining : tuple of Remaining
        Each effect of the study: on or off, and the estimated change that is left.
    cost : Cost
    responses : {"stuck", "one seen", "several"}
        All contact points stick throughout on the curves that were followed, so the response is linear; or they do not, but
        the curves are single-valued and complete, and no other response was seen, which excludes neither a detached one nor
        a narrow resonance of a higher harmonic between the points; or several responses coexist, and a peak that was not
        met may be higher.
    coexisting : tuple of Coexisting
        Where several were met.
    """

    preload: float
    frequency: float
    amplitude: float
    effects: Effects
    y: NDArray
    amplitude_error: float
    frequency_error: float
    error_bound: float
    tolerance: float
    residual: float
    status: str
    reason: str
    log: tuple[str, ...] = ()
    remaining: tuple[Remaining, ...] = ()
    cost: Cost = field(default_factory=Cost, compare=False)
    responses: str = "one seen"
    coexisting: tuple[Coexisting, ...] = ()

    @property
    def seconds(self) -> float:
        """Wall-clock time in all."""
        return self.cost.seconds

    @property
    def converged(self) -> bool:
        return self.status == "converged"

    def __str__(self) -> str:
        if not self.converged:
            return f"no peak: {self.status} ({self.reason})"
        lines = [
            f"peak {self.amplitude:.6g} m at {self.frequency:.6g} Hz, preload {self.preload:g} N, harmonics "
            f"{' '.join(map(str, self.effects.harmonic_numbers))}; everything on would change it by about "
            f"{100 * self.amplitude_error:+.2g} % and {100 * self.frequency_error:+.2g} % (tolerance "
            f"{100 * self.tolerance:g} %)"
        ]
        for r in self.remaining:
            rest = f", the rest would change it by {100 * r.amplitude:+.2g} % and {100 * r.frequency:+.2g} %"
            left = "" if r.state == "as in the study" else rest
            lines.append(f"  {r.effect}: {r.setting} ({r.state}{left})")
        lines.append(f"  {RESPONSES[self.responses]}")
        lines += [f"    {part}" for part in self.coexisting]
        lines.append(f"  {self.cost}")
        return "\n".join(lines)


def plain_peak(study: Study, found: AdaptivePeak) -> tuple[Study, Peak]:
    """The study with what was on in an adaptive peak, and this as a peak of it.

    Raises
    ------
    SettingError
        If it is not converged, or not one of the study.
    """
    if not found.converged:
        raise SettingError(f"peak: expected a converged one, found status '{found.status}'")
    used = study.with_effects(found.effects)
    system = used.system(found.preload)
    if len(found.y) != system.n_unknowns + 1:
        raise SettingError(
            f"peak: expected one of this study with {system.n_unknowns} unknowns, found {len(found.y) - 1}"
        )
    error = float(np.abs(system.evaluate(found.y[:-1], float(found.y[-1]))[0] * system.row_scale).max())
    if error > max(1e-6, 100.0 * found.residual):
        raise SettingError(f"peak: expected one of this study, found one with other settings (residual {error:.2g})")
    peak = replace(find_peak(system, found.y, parameter=found.preload), cost=found.cost)
    if not (peak.converged and abs(peak.amplitude / found.amplitude - 1.0) < SURPRISE):  # a corner, not a maximum
        peak = replace(
            peak, y=found.y, frequency=found.frequency, amplitude=found.amplitude, residual=found.residual, corner=True,
            status="converged",
        )  # fmt: skip
    return used, peak


@dataclass(frozen=True)
class _Found:
    """A peak, what was on, and what the full study would change (None: nothing is left out)."""

    peak: Peak
    on: On
    estimate: Estimate | None


class LostError(Exception):
    """What the full study makes of a peak or of a curve could not be told.

    Parameters
    ----------
    reason : str
    place : Place, optional
        Where the full response was lost.
    """

    def __init__(self, reason: str, place: Place | None = None) -> None:
        super().__init__(reason)
        self.place = place

    @property
    def amplitude(self) -> float:
        """Which the full response that was lost has at least, m; 0 if nothing is known."""
        return 0.0 if self.place is None else self.place.least


class LostPeakError(LostError):
    """A maximum that is there with little on was not found, or not with more on."""


class Search:
    """Peaks of a study, and of the same with less on."""

    def __init__(self, study: Study, preload: float, frequency: tuple[float, float], tolerance: float) -> None:
        self.study = study
        self.own = Effects.of(study)
        self.everything = On(self.own.harmonic_numbers, self.own.damper_modes)
        self.preload = preload
        self.frequency = frequency
        self.tolerance = tolerance
        self.meter = CostMeter(time.perf_counter())
        self.log: list[str] = []
        self.best: _Found | None = None
        self.walked: tuple[Peak, float] | None = None
        self.stuck = True
        self.coexisting: list[Coexisting] = []
        self.first: tuple[Curve, On] | None = None  # curve, if it is complete: those with more on go by it
        self.no_guess_at: float | None = None  # end (rad/s) where there is another response than the first curve has
        self.variants: dict[On, tuple[Study, HarmonicSystem]] = {}
        self.least = On((1,), self.own.damper_modes)

    def rigid_if_enough(self) -> On:
        """One harmonic, without elastic modes of the damper if the linear stuck resonances do not tell them apart.

        This takes a static state of its own, which may cost as much as a peak: it pays for curves only.
        """
        rigid = On((1,), 0)
        with_all = self.stuck_resonances(self.everything)
        if self.everything.damper_modes and len(with_all):
            without = self.stuck_resonances(rigid)
            same = len(with_all) == len(without) and np.abs(without / with_all - 1.0).max() <= 0.1 * self.tolerance
            return rigid if same else On((1,), self.everything.damper_modes)
        return On((1,), self.everything.damper_modes)

    def stuck_resonances(self, on: On) -> NDArray:
        """Linear resonances of the stuck contact within the interval, rad/s."""
        study, system = self.variant(on)
        state = study.static(self.preload)
        if not state.converged:
            return np.zeros(0)
        omega, _ = system.linear_modes(study._stuck_springs(state))
        low, high = (2.0 * np.pi * f for f in self.frequency)
        return np.sort(omega[(omega > low) & (omega < high)])

    def variant(self, on: On) -> tuple[Study, HarmonicSystem]:
        if on not in self.variants:
            study = self.study
            if on != self.everything:
                study = study.with_effects(replace(self.own, harmonics=on.harmonics, damper_modes=on.damper_modes))
            system = study.system(self.preload)
            self.meter.watch(system)
            self.variants[on] = study, system
        return self.variants[on]

    def moved(self, y: NDArray, on: On, to: On) -> NDArray:
        """A point with some effects on as a point with others on."""
        (a, before), (b, after) = self.variant(on), self.variant(to)
        return embed_between(a, b, before, after, self.preload, y)

    def tracked(
        self, on: On, options: ContinuationOptions | None = None, from_high: bool = False
    ) -> tuple[Curve, list[Peak]]:
        """A curve and its peaks that come near the highest, the highest first."""
        study, system = self.variant(on)
        if study is not self.study:  # takes as long as a short curve, and is for notes that are not read here
            study.__dict__.setdefault("self_locking", ())
        curve = uninterrupted(
            track_curve(
                study, self.preload, self.frequency, from_high=from_high, options=options or ContinuationOptions(),
                progress=False, ratios=(), guesses=lambda omega: self.guesses(omega, on),
            )
        )  # fmt: skip
        self.meter.add(curve.cost)
        self.notice(curve, on)
        peaks = highest_peaks(system, curve, options=LOOSE) if len(curve) else []
        top = f"{peaks[0].amplitude:.4g} m at {peaks[0].frequency:.5g} Hz" if peaks else "none"
        side = " from above" if from_high else ""
        self.log.append(f"curve{side} with {on}: {curve.status}, {len(curve)} points, peak {top}")
        return curve, peaks

    def guesses(self, omega: float, on: On) -> list[NDArray]:
        """Of solutions with some effects on, from the first curve."""
        if self.first is None or (self.no_guess_at is not None and abs(omega / self.no_guess_at - 1.0) < 1e-9):
            return []
        curve, off = self.first
        low, high = (2.0 * np.pi * f for f in (curve.frequency.min(), curve.frequency.max()))
        at = min(max(omega, low), high)  # the curve may end a little before the interval, if only by rounding
        return [self.moved(np.append(u, omega), off, on)[:-1] for u in passing(curve, at)]

    def notice(self, curve: Curve, on: On) -> None:
        """Notes where a curve has met more than one response."""
        what = f"on the curve with {on}"
        if len(curve):
            self.stuck &= float(curve.shares[:, 0].min()) == 1.0
        for branch in np.unique(curve.branch):
            at = np.flatnonzero(curve.branch == branch)
            self.notice_path(curve.frequency[at], [curve.point_kind[i] for i in at], what)
        self.coexisting += [Coexisting(p.low, p.high, "left out", f"{p.why} {what}") for p in curve.left_out]
        if not curve.complete:
            self.coexisting.append(Coexisting(*self.frequency, "not followed", f"{curve.status} ({curve.reason}) {what}"))

    def notice_path(self, frequency: NDArray, kinds: list[str], what: str) -> None:
        """The same of a path."""
        for kind, at in (("folds", turns(frequency)), ("walk", [i for i, k in enumerate(kinds) if k == "walk"])):
            if len(at):
                f = frequency[at]
                turned = f"the frequency turns back {what} ({len(at)})"
                text = turned if kind == "folds" else f"nothing determines the mean position {what}"
                self.coexisting.append(Coexisting(float(f.min()), float(f.max()), kind, text))

    def another_response(self, curve: Curve, on: On, from_high: bool) -> bool:
        """Whether there is another response at the far end of the interval than the one in which a curve arrives.

        It is looked for from nothing, or from the first point of an earlier curve that set off there with less on.
        """
        end = self.frequency[0 if from_high else 1]
        at = np.abs(curve.frequency - end) < 1e-9 * end
        if self.stuck or not np.any(at) or (from_high and self.first is None):
            return False
        study, system = self.variant(on)
        y: NDArray | None
        if not from_high:
            state = study.static(self.preload)
            springs = study._stuck_springs(state)
            y, _, _ = first_point(system, state, springs, 2.0 * np.pi * end, ROUGH, self.meter)
        else:
            assert self.first is not None
            first, off = self.first
            start = self.moved(point_at(first, end), off, on)
            c = system.correct_at(start[:-1], start[-1], peak_scale(system, start, start[-1]), 1e-6, 25, True)
            y = c.y if c.status == OK else None
        if y is None:
            return False
        apart = np.linalg.norm((curve.unknowns[at] - y[:-1])[:, system.n_mean :], axis=1).min()
        if apart <= APART * np.linalg.norm(y[system.n_mean : -1]):
            return False
        self.coexisting.append(Coexisting(end, end, "apart", f"there is a response apart from the curve with {on}"))
        self.log.append(str(self.coexisting[-1]))
        return True

    def higher_nearby(self, peak: Peak, on: On, share: float = STAYS_UP, ways: Sequence[bool] = BOTH_WAYS) -> Peak:
        """:func:`higher_nearby`, with a note of what the curve through the peak meets."""

        def note(points: list[PathPoint]) -> None:
            self.stuck &= all(float(p.shares[0]) == 1.0 for p in points)
            frequency = np.array([p.y[-1] for p in points]) / (2.0 * np.pi)
            self.notice_path(frequency, [p.kind for p in points], f"on the curve through the peak with {on}")

        return higher_nearby(self.variant(on)[1], peak, share, MOST_AROUND, note, ways)

    def estimate(self, y: NDArray, on: On) -> Estimate:
        """What the full study would change in a point."""
        return change_or_unknown(self.variant(self.everything)[1], self.moved(y, on, self.everything))

    def called_for(self, estimate: Estimate, on: On) -> On:
        """What to have on: what is, and what makes up the estimated change."""
        if not estimate.size < RELIED_ON or estimate.reliability(self.tolerance) == "must be on":
            return self.everything
        modes = on.damper_modes
        if modes < self.everything.damper_modes and self.of_elastic_modes(estimate, on) > 0.25 * self.tolerance:
            modes = self.everything.damper_modes
        share = np.abs(estimate.shares)
        off = sorted((l for l in self.everything.harmonics if l not in on.harmonics), key=lambda l: share[l])
        rest = 0.0
        leave: list[int] = []
        for l in off if modes != on.damper_modes else off[:-1]:  # at least one thing more
            rest += float(share[l])
            if not rest < 0.25 * self.tolerance:
                break
            leave.append(l)
        return On(tuple(l for l in self.everything.harmonics if l not in leave), modes)

    def of_elastic_modes(self, estimate: Estimate, on: On) -> float:
        """Part of an estimated change that comes from the equations that are on already, because of the elastic modes."""
        at = [0, *on.harmonics]
        return max(abs(float(estimate.shares[at].sum())), abs(float(estimate.frequency_shares[at].sum())))

    def lift(self, peak: Peak, on: On, expected: float = np.inf) -> _Found:
        """The peak with as much on as it calls for.

        Where it surprises, the curve through it is followed unless it is above the ``expected`` full response elsewhere.
        """
        while True:
            estimate = None if on == self.everything else self.estimate(peak.y, on)
            if estimate is None or estimate.size <= MARGIN * self.tolerance:
                return _Found(peak, on, estimate)
            wanted = self.called_for(estimate, on)
            self.log.append(
                f"{peak.frequency:.5g} Hz: estimated change {100 * estimate.amplitude:+.2g} %, "
                f"{100 * estimate.frequency:+.2g} %, may miss {100 * estimate.defect:.2g} %: {wanted}"
            )
            system = self.variant(wanted)[1]
            start = self.moved(peak.y, on, wanted)
            guesses = [self.moved(estimate.y, self.everything, wanted)] if estimate.size < RELIED_ON else []
            found = carried_over(system, [*guesses, start], start, peak.scale[-1], quick=True)
            if found is None and estimate.size < RELIED_ON:
                found = self.climbed(peak, on, wanted)
            surprise = found is not None and not found.amplitude / peak.amplitude - 1.0 >= estimate.amplitude - SURPRISE
            if found is not None and surprise and found.amplitude < expected:
                short = found.amplitude / peak.amplitude / (1.0 + estimate.amplitude) if estimate.size < RELIED_ON else 1.0
                share = max(short * STAYS_UP, NEAR)
                found = self.higher_nearby(found, wanted, share)
                self.walked = found, share
            if found is None or another(found, peak):
                lost = Place(peak.y, peak.frequency, peak.amplitude, estimate)
                raise LostPeakError(f"{peak.frequency:.5g} Hz: the peak is not found with {wanted}", lost)
            peak, on = found, wanted

    def climbed(self, peak: Peak, on: On, wanted: On) -> Peak | None:
        """The peak with the wanted harmonics by way of fewer."""
        few, many = len(on.harmonics), len(wanted.harmonics)
        way = [wanted._replace(harmonics=wanted.harmonics[:n]) for n in range(few + 1, many, max(1, (many - few) // 2))]
        for step in [*way, wanted]:
            start = self.moved(peak.y, on, step)
            found = carried_over(self.variant(step)[1], [start], start, peak.scale[-1], quick=True)
            if found is not None:
                peak, on = found, step
            elif step == wanted:
                return None
        return peak

    def highest(self, curve: Curve, peaks: list[Peak], on: On) -> None:
        """Finds the highest peak of the full study that a curve with less on leads to."""

        def ask(y: NDArray) -> Estimate:
            return self.estimate(y, on)

        hidden = self._hidden_summit(curve, peaks)
        if hidden is not None:
            summit = place_on_curve(curve, hidden, ask)
            self._lose(LostPeakError(f"{summit.frequency:.5g} Hz: a summit of the curve with {on} that is no peak", summit))
        at = {i for share in ASKED for i in _spread(near_top(curve, peaks[0].amplitude, share), MOST_ASKED)}
        places = [place_on_curve(curve, i, ask) for i in sorted(at)]
        elsewhere = surely(places) / (1.0 - self.tolerance)
        for peak in peaks:
            if self.best is None or not place_of_peak(peak, ask).most <= self.best.peak.amplitude:
                try:
                    self._take(self.lift(peak, on, elsewhere))
                except LostError as lost:
                    self._lose(lost)
        if self.best is None:
            raise LostError(f"the peaks that the curve with {on} leads to lie outside the interval")
        rich = self.variant(self.everything)[1]
        places = [p for p in places if p.amplitude >= ASKED[0] * self.best.peak.amplitude]
        unknown = not places  # the peak is far higher than the curve that led to it
        for place in places:
            limit = self.best.peak.amplitude * (1.0 + self.tolerance)
            if not place.estimate.size < RELIED_ON:
                unknown |= bool(self.coexisting) and place.amplitude >= STAYS_UP * self.best.peak.amplitude
            elif place.expected > limit:
                start = self.moved(place.y, on, self.everything)
                found = next(solutions_near(rich, [place.estimate.y], start, peaks[0].scale[-1], quick=True), None)
                height = 0.0 if found is None else amplitude_of(rich, found.y)
                if found is None or place.expected > (1.0 + SURPRISE) * height:
                    unknown = True
                if found is not None and height > limit:
                    peak = find_peak(rich, found.y, options=LOOSE, walk=False)
                    where = f"{place.frequency:.5g} Hz: the full response is higher"
                    if not peak.converged:
                        raise LostError(f"{where}, but no peak is found")
                    self._take(_Found(peak, self.everything, None), where)
        unknown |= self._take_superharmonics(curve, on)
        sure = surely(places)
        if unknown and (not sure or sure > (1.0 - self.tolerance) * self.best.peak.amplitude):
            self.walk()
        else:
            self.walk(CLOSE_BY, self._ways_near_top(places))

    def _ways_near_top(self, places: Sequence[Place]) -> list[bool]:
        """To which sides of the best peak (True: up) the full response may be nearly as high, at another frequency."""
        assert self.best is not None
        top = self.best.peak
        off = {p.frequency / top.frequency - 1.0 for p in places if p.most > CLOSE_BY * top.amplitude}
        return [up for up in BOTH_WAYS if any((d if up else -d) > 0.5 * self.tolerance for d in off)]

    def _lose(self, lost: LostError) -> None:
        """Raises what was lost, unless it is below the best peak, as it is and at least in the full study."""
        place = lost.place
        if self.best is None or place is None or max(place.amplitude, place.least) > self.best.peak.amplitude:
            raise lost
        self.log.append(f"{lost}; there is a higher one")
        text = f"what becomes of {place.amplitude:.4g} m is not known"
        self.coexisting.append(Coexisting(place.frequency, place.frequency, "not followed", text))

    def _take_superharmonics(self, curve: Curve, on: On) -> bool:
        """Takes what is higher in narrow resonances of the harmonics that are off; whether there was anything."""
        assert self.best is not None
        (study, rich), cheap = self.variant(self.everything), self.variant(on)[1]
        springs = (study._stuck_springs(study.static(self.preload)), None)
        before = self.best

        def moved(y: NDArray) -> NDArray:
            return self.moved(y, on, self.everything)

        def ask(y: NDArray) -> Estimate:
            return self.estimate(y, on)

        for points in superharmonic_points(curve, cheap, rich, springs, moved, before.peak.amplitude):
            limit = self.best.peak.amplitude * (1.0 + self.tolerance)
            places = [place_at(cheap, y, ask) for y in points]
            if all(p.estimate.size < RELIED_ON and p.most <= limit for p in places):
                continue
            top, height = None, NEAR * self.best.peak.amplitude
            heights: list[float] = []
            at = float(self.best.peak.y[-1])
            for start in map(moved, sorted(points, key=lambda y: abs(float(y[-1]) - at))):
                c = rich.correct_at(start[:-1], start[-1], peak_scale(rich, start, start[-1]), 1e-6, 25, True)
                heights.append(amplitude_of(rich, c.y) if c.status == OK else 0.0)
                if heights[-1] > height:
                    top, height = c.y, heights[-1]
                if heights.count(0.0) == MOST_UNSOLVED:
                    break
            if len(heights) > 1 and all(near > far > 0.0 for near, far in pairwise(heights)):
                continue  # the flank of the best peak
            if top is not None:
                peak = find_peak(rich, top, options=LOOSE, walk=False)
                if peak.converged and peak.amplitude > limit:
                    where = f"{top[-1] / (2.0 * np.pi):.5g} Hz: a higher harmonic resonates"
                    self._take(_Found(peak, self.everything, None), where)
        return self.best is not before

    def walk(self, share: float = STAYS_UP, ways: Sequence[bool] = BOTH_WAYS) -> None:
        """Follows the curve through the best peak, unless that has been done, and takes what is higher."""
        assert self.best is not None
        peak, on = self.best.peak, self.best.on
        if self.walked is not None and self.walked[1] <= share and same_peak(peak, self.walked[0], 1e-4):
            return
        higher = self.higher_nearby(peak, on, share, ways)
        if len(ways) == len(BOTH_WAYS):
            self.walked = higher, share
        if higher is not peak:
            self._take(self.lift(higher, on), "the full response is higher nearby")

    def _hidden_summit(self, curve: Curve, peaks: list[Peak]) -> int | None:
        """The highest summit of a curve, if it is above its peaks and none itself."""
        top = max(summits(curve), key=lambda i: float(curve.amplitude[i]), default=None)
        highest = peaks[0].amplitude if peaks else 0.0
        return None if top is None or curve.amplitude[top] <= (1.0 + self.tolerance) * highest else top

    def _take_summit(self, curve: Curve, peaks: list[Peak]) -> None:
        """Takes a hidden summit of the full response: a corner is as high as the response gets there."""
        i = self._hidden_summit(curve, peaks)
        if i is not None:
            y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
            peak = find_peak(self.variant(self.everything)[1], y, options=LOOSE, walk=False)
            corner = as_located(peak, y, float(curve.amplitude[i]), float(curve.residual[i]))
            self._take(_Found(corner, self.everything, None), "a corner at which the mean position moves")

    def _take(self, found: _Found, why: str = "") -> None:
        """Takes a peak if it is higher; of two that differ by less than the tolerance it takes the full study to tell."""
        if not self.frequency[0] < found.peak.frequency < self.frequency[1]:
            return
        if self.best is not None and level(found.peak, self.best.peak, self.tolerance):
            found, self.best = self.in_full(found), self.in_full(self.best)
        if self.best is None or found.peak.amplitude > self.best.peak.amplitude:
            self.best = found
            if why:
                self.log.append(f"{why}: peak {found.peak.amplitude:.4g} m at {found.peak.frequency:.5g} Hz")

    def in_full(self, found: _Found) -> _Found:
        """A peak with everything on, unless it is not found."""
        if found.on == self.everything:
            return found
        start = self.moved(found.peak.y, found.on, self.everything)
        peak = carried_over(self.variant(self.everything)[1], [start], start, found.peak.scale[-1], quick=True)
        return found if peak is None or another(peak, found.peak) else _Found(peak, self.everything, None)

    def run(self) -> Curve:
        """Finds the highest peak; the curve that was followed last."""
        more = self.least._replace(harmonics=self.everything.harmonics[:3])
        missing = 0.0
        apart = False
        for on, from_high, how in ((self.least, False, ROUGH), (more, True, SHORT)):
            if on == self.everything:
                break
            curve, peaks = self.tracked(on, how, from_high)
            if self.first is None and curve.complete:
                self.first = curve, on
            try:
                if not curve.complete:
                    raise LostError(f"what the curve with {on} has not reached may be higher")
                if peaks:
                    self.highest(curve, peaks, on)
                elif self.best is None or curve.amplitude.max() > self.best.peak.amplitude:
                    raise LostError(f"the curve with {on} has no maximum inside the interval")
                if not self.another_response(curve, on, from_high):
                    return curve
                apart = not from_high
                if apart:
                    self.no_guess_at = 2.0 * np.pi * self.frequency[1]
                break
            except LostError as lost:
                self.log.append(str(lost))
                missing = max(missing, lost.amplitude)
                if not isinstance(lost, LostPeakError):  # three harmonics would show no more
                    break
        for from_high in (apart, not apart):
            for options in FOLLOWED:
                curve, peaks = self.tracked(self.everything, options, from_high)
                for peak in peaks:
                    self._take(_Found(peak, self.everything, None))
                self._take_summit(curve, peaks)
                found = 0.0 if self.best is None else self.best.peak.amplitude
                if curve.complete and curve.amplitude.max() <= (1.0 + self.tolerance) * found:
                    break
            if self.best is not None and self.best.peak.amplitude >= missing:
                break
        return curve


def surely(places: Sequence[Place]) -> float:
    """Full response by estimates that can be relied on, half of what they may miss taken off, m; 0 without any."""
    sure = (p.expected * (1.0 - 0.5 * p.estimate.size) for p in places if p.estimate.size < RELIED_ON)
    return max(sure, default=0.0)


def point_at(curve: Curve, frequency: float) -> NDArray:
    """(n_unknowns + 1,) the point of a curve that is closest to a frequency (Hz)."""
    i = int(np.argmin(np.abs(curve.frequency - frequency)))
    return np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])


def level(a: Peak, b: Peak, tolerance: float) -> bool:
    """Whether two peaks at different frequencies differ by less than a tolerance in amplitude."""
    return abs(a.amplitude / b.amplitude - 1.0) < tolerance < abs(a.frequency / b.frequency - 1.0)


def another(found: Peak, peak: Peak) -> bool:
    """Whether a peak is so far from the one that led to it that it is not the same."""
    amplitude, frequency = found.amplitude / peak.amplitude - 1.0, found.frequency / peak.frequency - 1.0
    return abs(amplitude) > ANOTHER[0] or abs(frequency) > ANOTHER[1]


def _spread(indices: NDArray, most: int) -> list[int]:
    """As many of the indices, spread evenly over them."""
    if not len(indices):
        return []
    return [int(i) for i in indices[np.unique(np.linspace(0, len(indices) - 1, most).astype(int))]]


def turns(frequency: NDArray) -> list[int]:
    """Points of a path at which it turns back in frequency."""
    step = np.diff(frequency)
    moving = np.flatnonzero(step)
    return [int(j + 1) for j, k in zip(moving, moving[1:]) if step[j] * step[k] < 0.0]

def adaptive_peak(
    study: Study, preload: float, frequency: tuple[float, float], *, tolerance: float = 0.01
) -> AdaptivePeak:
    """The highest peak of a study to a tolerance, with only the harmonics and elastic damper modes that it calls for.

    Parameters
    ----------
    study : Study
        With everything on that is to be taken into account.
    preload : float, N
    frequency : (low, high), Hz
    tolerance : float
        On amplitude and frequency, relative.

    Returns
    -------
    AdaptivePeak
    """
    check_tolerance(tolerance)
    search = Search(study, float(preload), frequency, tolerance)
    curve = search.run()
    best = search.best
    coexisting = tuple(dict.fromkeys(search.coexisting))
    responses = "several" if coexisting else "stuck" if search.stuck else "one seen"
    if best is None:
        reason = "the response has no maximum inside the interval" if len(curve) else curve.reason
        nothing = np.zeros(0)
        return AdaptivePeak(
            float(preload), np.nan, np.nan, search.own, nothing, np.nan, np.nan, np.nan, tolerance, np.nan, "no peak",
            f"{reason} ({curve.status}: {curve.reason})", tuple(search.log), (),
            search.meter.read(time.perf_counter()), responses, coexisting,
        )  # fmt: skip
    peak, e = best.peak, best.estimate
    change = (0.0, 0.0, 0.0) if e is None else (e.amplitude, e.frequency, e.size)
    return AdaptivePeak(
        float(preload), peak.frequency, peak.amplitude, Effects.of(search.variant(best.on)[0]), peak.y, *change,
        tolerance, peak.residual, "converged", "", tuple(search.log), remaining(search, best),
        search.meter.read(time.perf_counter()), responses, coexisting,
    )  # fmt: skip


def remaining(search: Search, found: _Found) -> tuple[Remaining, ...]:
    """Each effect of the study, whether it was on, and the estimated change that is left."""
    e, on, everything = found.estimate, found.on, search.everything
    left: dict[str, tuple[str, str, list[int]]] = {}
    if e is not None and on.harmonics != everything.harmonics:
        state = "off" if on.harmonics == (1,) else "partly on"
        off = [l for l in everything.harmonics if l not in on.harmonics]
        left["harmonics"] = state, " ".join(map(str, on.harmonics)), off
    if e is not None and on.damper_modes != everything.damper_modes:
        left["damper modes"] = "off", str(on.damper_modes), [0, *on.harmonics]
    rows = []
    for name, setting in search.own.settings_text():
        if e is not None and name in left:
            state, setting, at = left[name]
            change = float(e.shares[at].sum()), float(e.frequency_shares[at].sum())
            rows.append(Remaining(name, state, setting, *change))
        else:
            rows.append(Remaining(name, "as in the study", setting, 0.0, 0.0))
    return tuple(rows)


def check_tolerance(tolerance: float) -> None:
    if not 0.0 < tolerance < 1.0:
        raise SettingError(f"tolerance: expected between 0 and 1, found {tolerance}")
