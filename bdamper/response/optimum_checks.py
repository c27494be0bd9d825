"""Checks of the optimum of an optimal curve.

Each check rates one possible weakness of the optimum: green if it passes, amber if it is uncertain,
red if it fails, and white if it was not run.  A failed check has a remedy.
:mod:`bdamper.response.optimum_statement` prints them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bdamper.harmonic_balance.effects import harmonic_numbers
from bdamper.response.expected_time import (
    BY_HARMONIC_BALANCE,
    expected_text,
    seconds_in_time,
    seconds_of_evaluation,
)
from bdamper.response.peak_error import error_text
from bdamper.response.verification import FRICTION_SPREAD, MUCH, TimeResponse
from bdamper.util.errors import COMPLETE, INTERRUPTED
from bdamper.util.formatting import amount, percent

OptimalCurve = Any
"""Optimal curve; its module imports this one."""
EDGE = "at the lowest preload with a steady response"
"""Place of an optimum below which no response is steady."""
NEAR_BEST = 1.2
"""Amplitude over the optimum that defines the printed range of acceptable preloads."""
GOOD, FAIR = 0.05, 0.2
"""Largest relative differences of a green and of an amber check."""
ERRORS = "Estimated error"
"""Name of the check of the errors by harmonics and residual modes."""
SAFE = 1.5
"""Smallest fatigue margin of a green check."""


class Check(NamedTuple):
    """One check of an optimum.

    Parameters
    ----------
    colour : {"green", "amber", "red", "white"}
        Passed, uncertain, failed, not run.
    name : str
        Subject.
    found : str
        Result, or the call that runs the check.
    rule : str
        Meaning of the colours.
    failure, remedy : str
        Texts for a failed check; the remedy also helps if the check is uncertain.
    limits : str
        Values up to which the check passes, and above which it fails.
    seconds : float
        Elapsed time of the check; the expected processor time of a check that was not run; NaN if
        it is part of the curves or unknown.
    """

    colour: str
    name: str
    found: str
    rule: str
    failure: str = ""
    remedy: str = ""
    limits: str = ""
    seconds: float = float("nan")

    @property
    def finding(self) -> str:
        """Result of the check; with limits and remedy if it is uncertain, with the limits if it failed."""
        parts = [self.found]
        if self.colour in ("amber", "red") and self.limits:
            parts.append(self.limits)
        if self.colour == "amber" and self.remedy:
            parts.append(self.remedy)
        return "; ".join(parts)

    def taking(self, seconds: float, expected: float) -> Check:
        """Return the check with its elapsed time (s), or the expected one if it was not run."""
        return self._replace(seconds=expected if self.colour == "white" else seconds)

    @property
    def price(self) -> str:
        """Elapsed or expected time as text; "" if unknown."""
        if not self.seconds > 0.0:
            return ""
        if self.colour == "white":
            return expected_text(self.seconds)
        return amount(self.seconds, "s", 2)


class Expected(NamedTuple):
    """Expected processor time (s) of the time integration, and of the curves with all checks; NaN
    if unknown.
    """

    in_time: float = float("nan")
    all_checks: float = float("nan")


def _expected(curve: OptimalCurve) -> Expected:
    """Return the expected time of the checks, from the time of the response curves."""
    if not np.isfinite(curve.optimum.preload):
        return Expected()
    costs = [response.cost for response in curve.curves]
    evaluation = seconds_of_evaluation(costs)
    open_share = float(curve.shares[_row_of_optimum(curve), 2])
    in_time = seconds_in_time(evaluation, open_share, curve.settings)
    again = sum(cost.processor for cost in costs if cost is not None)
    return Expected(in_time, again + in_time + BY_HARMONIC_BALANCE * evaluation)


def with_checks(curve: OptimalCurve) -> str:
    """Return the call that repeats a curve with all checks of its optimum."""
    preloads = curve.preload[curve.requested]
    n = len(preloads)
    asked = f"({preloads[0]:.6g}, {preloads[-1]:.6g}), {n}" if n > 1 else f"[{preloads[0]:.6g}]"
    return f'study.optimal_curve({asked}{_interval(curve)}, check="time")'


def robust_call(curve: OptimalCurve) -> str:
    """Return the call that finds the preload with the lowest amplitude for all factors on friction
    that were tried, in a range from the optimum upwards.
    """
    low, high = curve.near_best
    factors = sorted(peak.factor for peak in curve.other_friction)
    samples = f'{{"friction_factor": [{", ".join(f"{factor:g}" for factor in factors)}]}}'
    # less friction acts like less preload, so that the result lies above the range
    limits = f"({low:.3g}, {5.0 * high:.3g})"
    return f"bd.robust_optimum(study, {samples}, {limits}, percentile=100{_interval(curve)})"


def _interval(curve: OptimalCurve) -> str:
    """Return the frequency interval of the peaks as an argument."""
    interval = curve.settings.get("frequency")
    if interval is None:
        return ""
    low, high = interval
    return f", frequency=({low:.5g}, {high:.5g})"


def graded(value: float, good: float, fair: float) -> str:
    """Return green up to ``good``, amber up to ``fair``, and red above."""
    if value <= good:
        return "green"
    if value <= fair:
        return "amber"
    return "red"


CHANGE_LIMITS = f"passes up to {percent(GOOD)}, fails above {percent(FAIR)}"
"""Limits of a check of a relative difference."""
ESTIMATE_LIMITS = f"passes up to {percent(GOOD)}, uncertain above"
"""Limits of a check by an estimate, which alone refutes nothing."""
ONE_HARMONIC_LIMITS = "one harmonic alone is not enough"
"""Limits of an estimate from one harmonic."""


def checks(curve: OptimalCurve) -> list[Check]:
    """Rate an optimal curve by its checks.

    Green means passed, amber uncertain, red failed, and white not computed.
    """
    expected = _expected(curve)
    return [
        _model(curve),
        _within_range(curve),
        _verified(curve),
        _value_everywhere(curve),
        _in_time(curve).taking(_seconds_in_time(curve), expected.in_time),
        _more_harmonics(curve).taking(_seconds_of_harmonics(curve), expected.all_checks),
        _other_friction(curve).taking(_seconds_of_friction(curve), expected.all_checks),
        *_friction_range(curve),
        *_ends_of_range(curve),
        *_fatigue_margins(curve),
        _errors_by_source(curve),
    ]


def failed(curve: OptimalCurve) -> list[Check]:
    """Return the failed checks; none if the preload does not matter."""
    if curve.optimum.kind == "flat":
        return []
    return [check for check in checks(curve) if check.colour == "red"]


def _model(curve: OptimalCurve) -> Check:
    """Report dampers that roll only because they have few rows of contact points."""
    name = "Damper rolling"
    rule = (
        "red if a damper rolls only because it has too few rows of contact points, white if unknown"
    )
    doubts = curve.model_doubts
    if doubts is None:
        return Check("white", name, "study.optimal_curve(...)", rule)
    if not doubts:
        return Check("green", name, "the faces have enough rows of contact points", rule)
    found = "; ".join(doubts)
    failure = f"{found}; amplitudes may be wrong by several times"
    return Check("red", name, found, rule, failure, "use more rows of contact points along t1")


def _within_range(curve: OptimalCurve) -> Check:
    """Report an optimum at an end of the range of preloads, or of the steady responses."""
    kind = curve.optimum.kind
    end = end_text(curve)
    return Check(
        colour="red" if end else "green",
        name="Optimum within the range",
        found=end or "inside",
        rule="red at an end of the range of preloads",
        failure=f"the amplitude is lowest {end}",
        remedy=_beyond(curve) if kind == "end" else "add damping to the damper",
    )


def end_text(curve: OptimalCurve) -> str:
    """Return in words at which end of the range the optimum lies; "" inside."""
    kind = curve.optimum.kind
    if kind == "edge":
        return EDGE
    if kind != "end":
        return ""
    preload = amount(curve.optimum.preload, "N")
    if _next_unknown(curve):
        return f"at {preload}, next to a preload without a value; a lower amplitude may lie there"
    end, side = ("upper", "above") if _at_upper_end(curve) else ("lower", "below")
    return f"at the {end} end of the range, {preload}; a lower amplitude may lie {side} it"


def _next_unknown(curve: OptimalCurve) -> bool:
    """Return whether the amplitude at a preload next to the optimum is unknown."""
    row = _row_of_optimum(curve)
    known = np.isfinite(curve.amplitude)
    # the optimum and the preloads next to it
    neighbours = slice(max(row - 1, 0), row + 2)
    return not known[neighbours].all()


def _at_upper_end(curve: OptimalCurve) -> bool:
    """Return whether the optimum is the last of several preloads."""
    row = _row_of_optimum(curve)
    return row > 0 and row == len(curve) - 1


def _beyond(curve: OptimalCurve) -> str:
    """Return the remedy for an optimum at an end: a wider range, or a value at the next preload."""
    if _next_unknown(curve):
        return (
            "find a value at the next preload first, with other contact_points or "
            'contact_stiffness="unit_traction"'
        )
    side = "above" if _at_upper_end(curve) else "below"
    return f"include preloads {side} {amount(curve.optimum.preload, 'N')}"


def _verified(curve: OptimalCurve) -> Check:
    """Report an optimum below which a value may exist, or whose preload is uncertain."""
    best = curve.optimum
    if not best.ok:
        colour = "red"
    elif GOOD < best.uncertainty < np.inf:
        colour = "amber"
    else:
        colour = "green"
    found = f"{best.status_text}, {best.known_to}" if best.known_to else best.status_text
    interrupted = INTERRUPTED in best.status_text
    return Check(
        colour=colour,
        name="Search for the optimum",
        found=found,
        rule="red if a lower value may exist at another preload, amber above "
        f"{percent(GOOD)} of uncertainty",
        failure=f"the search for the optimum is {best.status_text}",
        remedy="run it to its end" if interrupted else "compute other preloads near it",
    )


def _value_everywhere(curve: OptimalCurve) -> Check:
    """Report preloads without a value, also where the damper rattles."""
    # the damper rattles up to this preload; 0 if it does not
    edge = curve.lowest_steady_preload
    known = np.isfinite(curve.amplitude)
    found = f"{known.sum()} of {len(curve)}"
    if edge:
        found += f", no steady response up to {amount(edge, 'N')}"
    return Check(
        colour="green" if known.all() else "amber",
        name="A value at every preload",
        found=found,
        rule="amber if the response at a preload is incomplete, or none is steady",
    )


def _in_time(curve: OptimalCurve) -> Check:
    """Compare harmonic balance and time integration nearest to the recommended preload."""
    rule = (
        f"green below {percent(GOOD)} of difference, amber below {percent(FAIR)}, red above, "
        "amber if interrupted with a motion, white if not run"
    )
    name = "Time integration"
    nearest = curve.recommended_response
    if nearest is None:
        return Check("white", name, "study.with_time_response(curve)", rule)
    if nearest.status == INTERRUPTED:
        return _interrupted_in_time(nearest, name, rule)
    if not known_in_time(nearest) or not nearest.ok:
        failure = f"time integration at {amount(nearest.preload, 'N')} is {nearest.status_text}"
        remedy = "integrate at other preloads, study.with_time_response(curve, preloads)"
        return Check("red", name, nearest.status_text, rule, failure, remedy)
    remedy = "add harmonics and blade modes until both agree, or choose another preload"
    change = nearest.mean / nearest.balance - 1.0
    balance = amount(nearest.balance, "m")
    found = f"{nearest.text}, {changed_by(change)} than the {balance} by harmonic balance"
    failure = f"harmonic balance and time integration differ by {abs(100.0 * change):.0f} %"
    colour = graded(abs(change), GOOD, FAIR)
    return Check(colour, name, found, rule, failure, remedy, CHANGE_LIMITS)


def changed_by(change: float) -> str:
    """Return a relative change in words: "6.2 % lower"."""
    return f"{percent(abs(change))} {'lower' if change < 0.0 else 'higher'}"


def _seconds_in_time(curve: OptimalCurve) -> float:
    """Return the time (s) of the time integrations at all preloads; NaN without any."""
    if not curve.time_response:
        return float("nan")
    return float(sum(response.cost.seconds for response in curve.time_response))


def _interrupted_in_time(response: TimeResponse, name: str, rule: str) -> Check:
    """Report the motions before an interruption, which neither confirm nor refute a peak."""
    if np.isnan(response.mean):
        found = "interrupted before a motion was known, study.with_time_response(curve)"
        return Check("white", name, found, rule)
    found = (
        f"interrupted; so far {amount(response.mean, 'm')}, "
        f"by harmonic balance {amount(response.balance, 'm')}"
    )
    return Check("amber", name, found, rule)


def _more_harmonics(curve: OptimalCurve) -> Check:
    """Compare the peaks with more harmonics."""
    convergence = curve.convergence
    rule = (
        f"green if two larger numbers agree, amber below {percent(FAIR)} of difference, red above, "
        "white if not run"
    )
    if convergence is None:
        return _two_more_harmonics(curve)
    first, *others = convergence.peaks
    if convergence.status == INTERRUPTED and not others:
        return Check("white", "More harmonics", f"interrupted, {with_checks(curve)}", rule)
    if convergence.ok:
        colour = "green"
    else:
        # relative to the peak with the harmonics of the study
        changes = [abs(peak.amplitude / first.amplitude - 1.0) for peak in others]
        # without convergence only peaks that do not change at all are green
        colour = graded(max(changes, default=np.inf), good=0.0, fair=FAIR)
    remedy = "rely on the amplitude by time integration"
    # from the first of these peaks on, the amplitude no longer changes
    settled = convergence.settled
    is_settled = len(settled) > 1 and convergence.status == COMPLETE
    if is_settled and settled[0].harmonics > first.harmonics:
        remedy = convergence.settings_text(settled[0])
    failure = f"more harmonics may be needed, {convergence.verdict}"
    return Check(colour, "More harmonics", convergence.note, rule, failure, remedy, CHANGE_LIMITS)


def _seconds_of_harmonics(curve: OptimalCurve) -> float:
    """Return the time (s) of the peaks with more harmonics; NaN if not run."""
    return float("nan") if curve.convergence is None else curve.convergence.cost.seconds


def _two_more_harmonics(curve: OptimalCurve) -> Check:
    """Rate the error by two more harmonics at the optimum.

    One harmonic alone is never enough for a green check.
    """
    name = "More harmonics"
    rule = (
        f"green below {percent(GOOD)} of difference with two more, amber above, if unknown, and "
        "with one harmonic; white if not run"
    )
    changes = curve.harmonic_change
    if changes is None or not np.isfinite(curve.optimum.preload):
        colour = "amber" if _one_harmonic(curve) else "white"
        call = with_checks(curve)
        return Check(colour, name, f"one harmonic; {call}" if _one_harmonic(curve) else call, rule)
    change = float(changes[_row_of_optimum(curve)])
    highest = max(_harmonics(curve))
    has_no_gap = len(_harmonics(curve)) == highest
    more = f"{highest + 2} harmonics" if has_no_gap else f"harmonics up to {highest + 2}"
    if np.isnan(change):
        found = f"no peak with {more} near this one"
    else:
        changed = amount((1.0 + change) * curve.optimum.amplitude, "m")
        found = f"{changed} with {more}, {changed_by(change)}"
    limits = ONE_HARMONIC_LIMITS if _one_harmonic(curve) else ESTIMATE_LIMITS
    is_small = abs(change) <= GOOD and not _one_harmonic(curve)
    remedy = f"study.replace(harmonics={highest + 2})"
    return Check("green" if is_small else "amber", name, found, rule, remedy=remedy, limits=limits)


def _row_of_optimum(curve: OptimalCurve) -> int:
    """Return the row of the preload of the optimum."""
    return int(np.abs(curve.preload - curve.optimum.preload).argmin())


def _harmonics(curve: OptimalCurve) -> tuple[int, ...]:
    """Return the harmonics of the curve without the mean."""
    return harmonic_numbers(curve.settings["harmonics"])


def _one_harmonic(curve: OptimalCurve) -> bool:
    """Return whether the curve was computed with the first harmonic alone."""
    return len(_harmonics(curve)) == 1


def _other_friction(curve: OptimalCurve) -> Check:
    """Compare the peaks at the recommended preload with lower and higher friction coefficients."""
    name = "Other friction coefficients"
    rule = (
        f"green up to {NEAR_BEST:g} times the amplitude, red above {MUCH:g} times, white if not run"
    )
    if not friction_tried(curve):
        return Check("white", name, _not_checked(curve), rule)
    nominal, *changed = curve.other_friction
    ratio = np.array([peak.amplitude for peak in changed]) / nominal.amplitude
    all_complete = all(peak.ok for peak in curve.other_friction)
    if any(peak.compared_with(nominal) == "high" for peak in changed):
        colour = "red"
    elif all_complete and np.all(ratio <= NEAR_BEST):
        colour = "green"
    else:
        colour = "amber"
    sizes = " and ".join(peak.size_text for peak in changed)
    factors = " and ".join(f"{peak.factor:g}" for peak in changed)
    found = f"{sizes} with {factors} times the friction, by harmonic balance"
    failure = f"at {amount(nominal.preload, 'N')} the amplitude is {found}"
    limits = f"passes up to {NEAR_BEST:g} times the amplitude, fails above {MUCH:g} times"
    return Check(colour, name, found, rule, failure, _friction_remedy(curve), limits)


def _friction_range(curve: OptimalCurve) -> list[Check]:
    """Rate the factors on friction at which the amplitude at the recommended preload doubles.

    They are computed together with the peaks with other friction coefficients.
    """
    friction_range = curve.friction_range
    limits = None if friction_range is None else friction_range.limits
    if friction_range is None or limits is None or not friction_tried(curve):
        return []
    name = "Friction range"
    rule = f"red within a factor of {FRICTION_SPREAD:g}, amber if unknown there"
    # factors within the spread at which the amplitude doubles, or at which it is unknown
    near = [limit for limit in limits if limit.near]
    if any(limit.known for limit in near):
        colour = "red"
    elif near:
        colour = "amber"
    else:
        colour = "green"
    found = friction_range.text
    failure = f"at {amount(curve.other_friction[0].preload, 'N')} {found}"
    return [Check(colour, name, found, rule, failure, _friction_remedy(curve))]


def _seconds_of_friction(curve: OptimalCurve) -> float:
    """Return the time (s) of all peaks with other friction; NaN if not run."""
    friction_range = curve.friction_range
    return float("nan") if friction_range is None else friction_range.seconds


def _not_checked(curve: OptimalCurve) -> str:
    """Return the call that checks the recommended preload."""
    if not curve.other_friction:
        return with_checks(curve)
    computed = amount(curve.other_friction[0].preload, "N")
    return f"{with_checks(curve)}, so far run at {computed} only"


def _friction_remedy(curve: OptimalCurve) -> str:
    """Return the remedy if the amplitude doubles with another friction coefficient."""
    friction_range = curve.friction_range
    # its remedy is a preload (N), NaN or 0 if none is known
    if friction_range is None or not friction_range.remedy > 0.0:
        return f"choose a preload for these friction coefficients: {robust_call(curve)}"
    factors = f"{1.0 / FRICTION_SPREAD:.2g} and {FRICTION_SPREAD:g} times the friction"
    return (
        f"choose {amount(friction_range.remedy, 'N')}, where the amplitude does not double with "
        f"{factors}, or {robust_call(curve)}"
    )


def friction_tried(curve: OptimalCurve) -> bool:
    """Return whether different friction coefficients were tried at the recommended preload."""
    if not curve.other_friction:
        return False
    nominal = curve.other_friction[0]
    return bool(np.isclose(nominal.preload, curve.recommended_preload))


def _ends_of_range(curve: OptimalCurve) -> list[Check]:
    """Compare the amplitude in time at the ends of the printed range with its minimum."""
    if not curve.range_in_time:
        return []
    # False if one is unknown
    within = all(rise <= NEAR_BEST for rise in _rises_in_time(curve))
    colour = "green" if within else "amber"
    rule = (
        f"green up to {NEAR_BEST:g} times the lowest amplitude by time integration, amber above or "
        "if unknown"
    )
    return [Check(colour, "Ends of the range", range_in_time_text(curve), rule)]


def range_in_time_text(curve: OptimalCurve) -> str:
    """Return in words by how much time integration gives higher amplitudes at the ends."""
    texts = []
    for rise, end in zip(_rises_in_time(curve), curve.range_in_time):
        texts.append(f"{percent(rise - 1.0)} at {amount(end.preload, 'N')}")
    return f"by time integration, higher than the minimum by {' and '.join(texts)}"


def _rises_in_time(curve: OptimalCurve) -> list[float]:
    """Return the largest amplitude in time at both ends of the range over the least one.

    NaN means unknown.
    """
    lowest = curve.optimum_in_time
    rises = []
    for end in curve.range_in_time:
        if lowest is None or not known_in_time(end):
            rises.append(np.nan)
        else:
            rises.append(end.largest / lowest.largest)
    return rises


def _fatigue_margins(curve: OptimalCurve) -> list[Check]:
    """Rate the margins against fatigue at the preload nearest to the recommended preload."""
    rated = []
    for margins in curve.margins:
        row = int(np.abs(margins.preload - curve.recommended_preload).argmin())
        least = float(margins.margin[row])
        found = f"{least:.3g} at {amount(margins.preload[row], 'N')}"
        rated.append(
            Check(
                # a margin is better the larger it is, and 1 is the limit
                colour=graded(-least, good=-SAFE, fair=-1.0),
                name="Fatigue safety factor",
                found=found,
                rule=f"red below 1, amber below {SAFE:g}",
                failure=f"the fatigue safety factor is {found}",
                remedy="reduce the excitation or the stress",
                limits=f"passes from {SAFE:g}, fails below 1",
            )
        )
    return rated


def _errors_by_source(curve: OptimalCurve) -> Check:
    """Name the estimate of errors by source, which the curve does not contain, and its price."""
    text = error_summary(curve)
    if text:
        error = curve.error[_row_of_optimum(curve)]
        rule = f"green below {percent(GOOD)} at the optimum, amber above or if unknown"
        colour = "green" if error <= GOOD else "amber"
        remedy = estimate_call(curve)
        return Check(colour, ERRORS, text, rule, remedy=remedy, limits=ESTIMATE_LIMITS)
    return Check("white", ERRORS, estimate_call(curve), "white if errors=False left them out")


def estimate_call(curve: OptimalCurve) -> str:
    """Return the call that estimates the errors by all sources at the recommended preload."""
    preload = _rounded(curve.recommended_preload, 3)
    return f"study.estimate_errors(study.peak({preload}))"


def error_summary(curve: OptimalCurve) -> str:
    """Return the error at the optimum, the largest one, and the number of unknown ones in words; ""
    without estimates.
    """
    if curve.harmonic_change is None and curve.vector_change is None:
        return ""
    optimum = curve.optimum.preload
    texts = [f"at {amount(optimum, 'N')} {error_text(curve.errors_at(optimum))}"]
    errors = curve.error
    has_value = np.isfinite(curve.amplitude)
    if np.isfinite(errors).any():
        largest = int(np.nanargmax(errors))
        if largest != _row_of_optimum(curve):
            preload = amount(float(curve.preload[largest]), "N")
            texts.append(f"largest {percent(float(errors[largest]))} at {preload}")
    n_unknown = int(np.sum(np.isnan(errors) & has_value))
    if n_unknown:
        texts.append(f"unknown at {n_unknown} of {int(has_value.sum())} preloads")
    return "; ".join(texts)


def _rounded(value: float, digits: int) -> str:
    """Return a number with the given number of significant digits."""
    return f"{float(f'{value:.{digits}g}'):g}"


def checked_amplitudes(curve: OptimalCurve) -> dict[str, float]:
    """Return the upper amplitude (m) of each check by its name; nothing without time integration.

    NaN means unknown.  The amplitude with another friction coefficient is unknown if its peak is
    not complete: the peak may be higher.
    """
    response = curve.recommended_response
    if response is None or not known_in_time(response):
        return {}
    amplitudes = {"by time integration": response.largest, "by harmonic balance": response.balance}
    convergence = curve.convergence
    if convergence is not None and len(convergence.peaks) > 1:
        _, highest = convergence.range
        amplitudes["with more harmonics"] = highest
    if friction_tried(curve):
        # the first one has the coefficients of the study
        _, *changed = curve.other_friction
        for peak in changed:
            amplitude = peak.amplitude if peak.ok else np.nan
            amplitudes[f"with {peak.factor:g} times the friction"] = amplitude
    return amplitudes


def known_in_time(response: TimeResponse) -> bool:
    """Return whether a time integration gives a range of the amplitude, even if it is wide."""
    return bool(np.isfinite(response.mean)) and response.status != INTERRUPTED
