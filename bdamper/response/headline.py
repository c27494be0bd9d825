"""Checks of an optimal curve, and the headline that print, explorer, report and command line show.

The headline gives the preload, the design amplitude with the values of each method, and the effects
that are not covered. If a check has failed, it begins with the failure and a remedy, and there is
no design amplitude.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.response.branches import NO_SOLUTION
from bdamper.response.motion_range import exceeds
from bdamper.response.response_curve_result import NO_STEADY
from bdamper.response.verification import FRICTION_SPREAD, MUCH, TimeResponse
from bdamper.util.errors import COMPLETE, INTERRUPTED, status_word
from bdamper.util.formatting import amount, loads_text, peak_text, percent, span

OptimalCurve = Any
"""Optimal curve, whose module imports this one."""
ENDS = {
    "end": "end of the range, the optimum may lie beyond",
    "edge": "lowest preload with a steady response",
}
NEAR_BEST = 1.2
"""Amplitude over the optimum that defines the printed range of acceptable preloads."""
CLEARLY = 1.5
"""Smallest ratio of the slopes on both sides of an optimum at which the headline names the steeper
one."""
GOOD, FAIR = 0.05, 0.2
"""Largest relative differences of a green and of an amber check."""
SAFE = 1.5
"""Smallest fatigue margin of a green check."""


class Check(NamedTuple):
    """Colour, subject, result, rule and, if it failed, failure and remedy of one check."""

    colour: str
    name: str
    found: str
    rule: str
    failure: str = ""
    remedy: str = ""


def graded(value: float, good: float, fair: float) -> str:
    """Return green up to ``good``, amber up to ``fair``, and red above."""
    return "green" if value <= good else "amber" if value <= fair else "red"


def checks(curve: OptimalCurve) -> list[Check]:
    """Rate an optimal curve by its checks.

    Green means passed, amber uncertain, red failed, and white not computed.
    """
    best = curve.optimum
    inside = best.kind not in ENDS
    known, edge = np.isfinite(curve.amplitude), curve.lowest_steady_preload
    missing = bool(np.any(~known & (curve.preload > edge)))
    steady = f", no steady response up to {amount(edge, 'N')}" if edge else ""
    beyond = _beyond(curve)
    out = [
        _model(curve),
        Check("green" if inside else "red", "Optimum within the range", ENDS.get(best.kind, "inside"),
              "red at an end of the range of preloads",
              f"the least amplitude is at the {ENDS.get(best.kind, '')}",
              beyond if best.kind == "end" else "add damping to the damper"),
        Check(_verified(curve), "Optimum verified", ", ".join(filter(None, [best.status, best.known_to])),
              f"red if a lower value may exist at another preload, amber above {percent(GOOD)} of uncertainty",
              f"the search for the optimum is {best.status}",
              "run it to its end" if INTERRUPTED in best.status else "compute other preloads near it"),
        Check("amber" if missing else "green", "A value at every preload", f"{known.sum()} of {len(curve)}{steady}",
              "amber if a curve is incomplete"),
        _in_time(curve),
        _more_harmonics(curve),
        _other_friction(curve),
        _friction_range(curve),
        *_ends_of_range(curve),
    ]  # fmt: skip
    for margins in curve.margins:
        row = int(np.abs(margins.preload - curve.recommended_preload).argmin())
        least, at = float(margins.margin[row]), f"at {amount(margins.preload[row], 'N')}"
        colour = graded(-least, -SAFE, -1.0)
        failure = f"the margin against fatigue is {least:.3g} {at}"
        out.append(
            Check(colour, "Margin against fatigue", f"{least:.3g} {at}", f"red below 1, amber below {SAFE:g}", failure,
                  "reduce the excitation or the stress")
        )  # fmt: skip
    return out


def _verified(curve: OptimalCurve) -> str:
    """Return red if a lower value may exist, amber if the preload is uncertain, or green."""
    best = curve.optimum
    if not best.verified:
        return "red"
    return "amber" if GOOD < best.uncertainty < np.inf else "green"


def _model(curve: OptimalCurve) -> Check:
    """Report dampers that roll only because they have few rows of contact points."""
    name = "Rows of contact points"
    rule = (
        "red if a damper rolls on its contact points but not on its whole faces, white if unknown"
    )
    doubts = curve.model_doubts
    if doubts is None:
        return Check("white", name, "not examined", rule)
    if not doubts:
        return Check("green", name, "no damper rolls on them alone", rule)
    found = "; ".join(doubts)
    failure = f"{found}; amplitudes may be wrong by several times"
    return Check("red", name, found, rule, failure, "use more rows of contact points along t1")


def _beyond(curve: OptimalCurve) -> str:
    """Return the remedy for an optimum at an end: a wider range, or a value at the next preload."""
    row = int(np.abs(curve.preload - curve.optimum.preload).argmin())
    known = np.isfinite(curve.amplitude)
    if not known[max(row - 1, 0) : row + 2].all():
        return 'find a value at the next preload first, with other contact_points or contact_stiffness="unit_traction"'
    side = "above" if row > 0 and row == len(curve) - 1 else "below"
    return f"include preloads {side} {amount(curve.optimum.preload, 'N')}"


def failed(curve: OptimalCurve) -> list[Check]:
    """Return the failed checks; none if the preload does not matter."""
    return [
        check for check in checks(curve) if check.colour == "red" and curve.optimum.kind != "flat"
    ]


def _in_time(curve: OptimalCurve) -> Check:
    """Compare harmonic balance and time integration nearest to the recommended preload."""
    rule = f"green below {percent(GOOD)} of difference, amber below {percent(FAIR)}, red above, white if not run"
    name, nearest = "Harmonic balance against time", curve.recommended_response
    if nearest is None:
        return Check("white", name, "not run", rule)
    if not known_in_time(nearest) or status_word(nearest.status) != COMPLETE:
        failure = f"time integration at {amount(nearest.preload, 'N')} is {nearest.status}"
        remedy = "integrate at other preloads, study.with_time_response(curve, preloads)"
        return Check("red", name, nearest.status, rule, failure, remedy)
    remedy = "add harmonics and blade modes until both agree, or choose another preload"
    found = f"{nearest.text} in time, {amount(nearest.balance, 'm')} by harmonic balance"
    change = nearest.mean / nearest.balance - 1.0
    failure = f"harmonic balance and time integration differ by {abs(100.0 * change):.0f} %"
    return Check(graded(abs(change), GOOD, FAIR), name, found, rule, failure, remedy)


def _more_harmonics(curve: OptimalCurve) -> Check:
    """Compare the peaks with more harmonics."""
    more = curve.convergence
    rule = f"green if two larger numbers agree, amber below {percent(FAIR)} of difference, red above, white if not run"
    if more is None:
        return Check("white", "More harmonics", "not run", rule)
    first, *others = more.peaks
    change = max((abs(p.amplitude / first.amplitude - 1.0) for p in others), default=np.inf)
    enough = (
        more.settled[0].harmonics
        if len(more.settled) > 1 and more.status == COMPLETE
        else first.harmonics
    )
    failure = f"more harmonics may be needed, {more.verdict}"
    colour = "green" if more.converged else graded(change, 0.0, FAIR)
    remedy = (
        f"use harmonics={enough}" if enough > first.harmonics else "rely on the amplitude in time"
    )
    return Check(colour, "More harmonics", more.note, rule, failure, remedy)


def _other_friction(curve: OptimalCurve) -> Check:
    """Compare the peaks at the recommended preload with lower and higher friction coefficients."""
    name = "Other friction coefficients"
    rule = (
        f"green up to {NEAR_BEST:g} times the amplitude, red above {MUCH:g} times, white if not run"
    )
    if not _friction_tried(curve):
        return Check("white", name, f"not run at {amount(curve.recommended_preload, 'N')}", rule)
    own, *others = curve.other_friction
    ratio = np.array([k.amplitude for k in others]) / own.amplitude
    known = all(k.status == COMPLETE for k in curve.other_friction)
    doubled = any(k.compared_with(own) == "high" for k in others)
    colour = "red" if doubled else "green" if known and np.all(ratio <= NEAR_BEST) else "amber"
    heights = " and ".join(k.size_text for k in others)
    found = f"{heights} with {' and '.join(f'{k.factor:g}' for k in others)} times the friction, by harmonic balance"
    failure = f"at {amount(own.preload, 'N')} the amplitude is {found}"
    return Check(colour, name, found, rule, failure, _friction_remedy(curve))


def _friction_range(curve: OptimalCurve) -> Check:
    """Rate the factors on friction at which the amplitude at the recommended preload doubles."""
    name = "Friction at which the amplitude doubles"
    rule = f"red within a factor of {FRICTION_SPREAD:g}, amber if unknown there, white if not run"
    found = curve.friction_range
    if found is None or found.limits is None or not _friction_tried(curve):
        return Check("white", name, f"not run at {amount(curve.recommended_preload, 'N')}", rule)
    near = [limit for limit in found.limits if limit.near]
    colour = "red" if any(limit.known for limit in near) else "amber" if near else "green"
    preload = amount(curve.other_friction[0].preload, "N")
    return Check(
        colour, name, found.text, rule, f"at {preload} {found.text}", _friction_remedy(curve)
    )


def _friction_remedy(curve: OptimalCurve) -> str:
    """Return the remedy if the amplitude doubles with another friction coefficient."""
    found = curve.friction_range
    if found is None or not found.remedy > 0.0:
        return "choose a preload for these friction coefficients, bd.robust_optimum"
    return (
        f"choose {amount(found.remedy, 'N')}, where the amplitude does not double with {1.0 / FRICTION_SPREAD:.2g} and "
        f"{FRICTION_SPREAD:g} times the friction, or bd.robust_optimum"
    )


def _friction_tried(curve: OptimalCurve) -> bool:
    """Return whether other friction coefficients were tried at the recommended preload."""
    tried = curve.other_friction
    return bool(tried) and bool(np.isclose(tried[0].preload, curve.recommended_preload))


def checked_amplitudes(curve: OptimalCurve) -> dict[str, float]:
    """Return the upper amplitude (m) of each check by its name; nothing without time integration.

    NaN means unknown.  The amplitude with another friction coefficient is unknown if its peak is not complete: the peak
    may be higher.
    """
    response = curve.recommended_response
    if response is None or not known_in_time(response):
        return {}
    amplitudes = {"in time": response.largest, "by harmonic balance": response.balance}
    more = curve.convergence
    if more is not None and len(more.peaks) > 1:
        amplitudes["with more harmonics"] = more.range[1]
    if _friction_tried(curve):
        for peak in curve.other_friction[1:]:
            size = peak.amplitude if peak.status == COMPLETE else np.nan
            amplitudes[f"with {peak.factor:g} times the friction"] = size
    return amplitudes


def known_in_time(response: TimeResponse) -> bool:
    """Return whether a time integration gives a range of the amplitude, even if it is wide."""
    return bool(np.isfinite(response.mean)) and response.status != INTERRUPTED


def headline(curve: OptimalCurve, further: Sequence[Check] = ()) -> str:
    """Return the headline of an optimal curve, with failed checks first.

    ``further`` are checks of a report.
    """
    o = curve.optimum
    if not np.isfinite(o.preload):
        gone = [
            f"; at {amount(p, 'N')} {why}"
            for p, why in zip(curve.preload, curve.status)
            if status_word(why) != COMPLETE
        ]
        if o.kind == "flat":
            return f"The preload does not matter: {peak_text(o.amplitude, o.frequency)}."
        return f"No optimum: {o.status}{''.join(gone[:1])}."
    friction = _other_friction(curve)
    red = [*failed(curve), *(check for check in further if check.colour == "red")]
    other = f"Other friction: {friction.found}." if friction.colour in ("green", "amber") else ""
    doubles = _friction_range(curve)
    if doubles.colour in ("green", "amber"):
        other = " ".join(filter(None, [other, f"{doubles.found[0].upper()}{doubles.found[1:]}."]))
    remedies = "; ".join(dict.fromkeys(check.remedy for check in red))
    doubt = f"Not for design: {'; '.join(check.failure for check in red)}. {remedies[:1].upper()}{remedies[1:]}."
    amplitudes = [_preload(curve), _amplitude(curve, bool(red)), _range(curve), other]
    said = [doubt if red else "", *amplitudes, _locked(curve), _doubts(curve), _not_covered(curve)]
    return " ".join(filter(None, said))


def _preload(curve: OptimalCurve) -> str:
    """Return the recommended preload and the range of preloads around the optimum."""
    o, least, best = curve.optimum, curve.optimum_in_time, curve.recommended_preload
    force = curve.settings.get("excitation", {}).get("amplitude", 0.0)
    shares = loads_text(curve.settings.get("load_per_preload"))
    per = (
        " per newton of excitation"
        if force == 1.0
        else f" at {amount(force, 'N')} of excitation"
        if force
        else ""
    )
    where = f"Preload: {amount(best, 'N')}{f' ({shares})' if shares else ''}{per}"
    if o.uncertainty > GOOD and o.known_to:
        where += f" ({o.known_to})"
    if not np.isclose(best, o.preload):
        where += f", least in time (harmonic balance alone: {amount(o.preload, 'N')})"
    known = [k.preload for k in curve.time_response if known_in_time(k)]
    if least is not None and best in (known[0], known[-1]):
        where += f"; {'lower' if best == known[0] else 'higher'} preloads were not integrated"
    within = f"by harmonic balance the amplitude is within {percent(NEAR_BEST - 1.0)} of the minimum from"
    low, high = curve.near_best
    ends = f"; {_range_in_time(curve)}" if curve.range_in_time else ""
    return (
        f"{where}; {within} {span(low, high, 'N')}{_steeper(curve)}{ends}.{_of_damper(curve, best)}"
    )


def _rises_in_time(curve: OptimalCurve) -> list[float]:
    """Return the largest amplitude in time at both ends of the range over the least one.

    NaN means unknown.
    """
    least = curve.optimum_in_time
    if least is None:
        return [np.nan for _ in curve.range_in_time]
    return [
        end.largest / least.largest if known_in_time(end) else np.nan for end in curve.range_in_time
    ]


def _range_in_time(curve: OptimalCurve) -> str:
    """Return in words by how much the amplitude in time is higher at the ends of the range."""
    ends = zip(_rises_in_time(curve), curve.range_in_time)
    rises = [f"{percent(rise - 1.0)} at {amount(end.preload, 'N')}" for rise, end in ends]
    return f"in time it is higher than its minimum by {' and '.join(rises)}"


def _ends_of_range(curve: OptimalCurve) -> list[Check]:
    """Compare the amplitude in time at the ends of the printed range with its minimum."""
    if not curve.range_in_time:
        return []
    rises = _rises_in_time(curve)
    within = all(rise <= NEAR_BEST for rise in rises)  # False if one is unknown
    colour = "green" if within else "amber"
    rule = f"green up to {NEAR_BEST:g} times the least amplitude in time, amber above or if unknown"
    return [Check(colour, "Ends of the range in time", _range_in_time(curve), rule)]


def _of_damper(curve: OptimalCurve, preload: float) -> str:
    """Compare a preload with the centrifugal load of the damper at the resonance."""
    order, speed = curve.settings.get("engine_order", 0), curve.settings.get("speed")
    normalised = (
        curve.settings.get("excitation", {}).get("amplitude") == 1.0
    )  # the preload is one per newton
    if (
        normalised
        or curve.settings.get("load_per_preload")
        or not (order and curve.mass_radius > 0.0)
    ):
        return ""
    speed = speed or 2.0 * np.pi * curve.optimum.frequency / order
    load = curve.mass_radius * speed**2
    at = f"at {amount(30.0 * speed / np.pi, 'rpm')}"
    return f" The damper has {amount(load, 'N')} {at}; the preload needs {preload / load:.2g} times its mass."


def _steeper(curve: OptimalCurve) -> str:
    """Return the side of the optimum on which the amplitude rises faster; "" if uncertain.

    A lower bound can make a side the steeper one.  It cannot make it the flatter one.
    """
    below, below_certain = _rise(curve, curve.preload < curve.optimum.preload)
    above, above_certain = _rise(curve, curve.preload > curve.optimum.preload)
    if above_certain and below >= CLEARLY * above > 0.0:
        return " and rises faster below"
    if below_certain and above >= CLEARLY * below > 0.0:
        return " and rises faster above"
    return ""


def _rise(curve: OptimalCurve, side: NDArray) -> tuple[float, bool]:
    """Return the largest slope from the optimum on one side, and whether it is certain.

    The slope is d ln(amplitude)/d ln(preload).  Amplitudes up to NEAR_BEST times the optimum are
    disregarded.  Amplitudes of incomplete peaks are lower bounds.
    """
    known = np.isfinite(curve.amplitude)
    rise = np.log(np.where(known, curve.amplitude, curve.lower_bound) / curve.optimum.amplitude)
    counted = side & np.isfinite(rise) & (rise > np.log(NEAR_BEST))
    slope = np.abs(rise[counted] / np.log(curve.preload[counted] / curve.optimum.preload))
    return float(slope.max(initial=0.0)), bool(known[side].all())


def _amplitude(curve: OptimalCurve, any_failed: bool) -> str:
    """Return the design amplitude, unless a check has failed, and the amplitudes by each method."""
    o, response = curve.optimum, curve.recommended_response
    free = curve.free.amplitude
    gain = (
        f", {free / o.amplitude:.3g} times below the free blade ({amount(free, 'm')})"
        if np.isfinite(free)
        else ""
    )
    more = (
        curve.convergence
        if curve.convergence is not None and len(curve.convergence.peaks) > 1
        else None
    )
    low, high = more.range if more is not None else (o.amplitude, o.amplitude)
    ends = f" ({span(low, high, 'm')} with more harmonics)" if more is not None else ""
    if response is None or not known_in_time(response):
        highest = max(o.amplitude, high)
        alone = "Amplitude by harmonic balance alone, not for the stress"
        return f"{alone}: {peak_text(highest, o.frequency)}{ends}{gain}."
    at, balance = "", peak_text(o.amplitude, o.frequency)
    if not np.isclose(response.preload, o.preload):
        at = f" at {amount(response.preload, 'N')}"
        balance = f"{amount(response.balance, 'm')} there, at its optimum {balance}"
    least, most = response.spread
    differs = f" Blades do not vibrate alike: {span(least, most, 'm')}." if response.parted else ""
    in_time = span(response.lowest, response.largest, "m")
    return f"{_design(curve, any_failed)} in time{at} {in_time}, by harmonic balance {balance}{ends}{gain}.{differs}"


def _range(curve: OptimalCurve) -> str:
    """Return half of the range of motion where other harmonics than the first add to it."""
    best, response = curve.optimum, curve.recommended_response
    parts = [f"by harmonic balance {amount(best.half_range, 'm')}"] * exceeds(
        best.half_range, best.amplitude
    )
    if response is not None and exceeds(response.half_range, response.mean):
        parts.append(f"in time {amount(response.half_range, 'm')}")
    return (
        f"The amplitudes are of the first harmonic; half of the range of motion is {', '.join(parts)}."
        if parts
        else ""
    )


def _locked(curve: OptimalCurve) -> str:
    """Return the bodies that friction alone can hold: the history of the load decides."""
    notes = dict.fromkeys(note for part in curve.curves for note in part.self_locking)
    return " ".join(f"{note[:1].upper()}{note[1:]}." for note in notes)


def _design(curve: OptimalCurve, any_failed: bool) -> str:
    """Return the design amplitude with the check that gives it, or why there is none."""
    amplitudes = checked_amplitudes(curve)
    if any_failed:
        return "Amplitude"
    unknown = [name for name, size in amplitudes.items() if np.isnan(size)]
    if unknown:
        return f"No design amplitude, it is not known {' and '.join(unknown)};"
    highest = max(amplitudes, key=lambda name: amplitudes[name])
    return f"Design amplitude: {amount(curve.design_amplitude, 'm')} ({highest});"


def _doubts(curve: OptimalCurve) -> str:
    """Return the doubts of the curve at the optimum: broken paths, and a rattling damper."""
    best = curve.optimum.preload
    there = [k for k in curve.curves if np.isclose(k.preload, best, rtol=1e-9, atol=0.0)]
    doubts = []
    if any(NO_STEADY in k.reason for k in there):
        doubts.append(f"{NO_STEADY} is expected")
    # gaps without a solution are narrower than a thousandth of the interval in a complete curve
    broken = [part for k in there for part in k.missing_ranges if part.why != NO_SOLUTION]
    if broken:
        places = " and ".join(f"{(part.low + part.high) / 2.0:.4g} Hz" for part in broken[:2])
        doubts.append(
            f"a path of the response curve broke off near {places}, so that a higher branch may be missing"
        )
    return f"Doubt at {amount(best, 'N')}: {'; '.join(doubts)}." if doubts else ""


def _not_covered(curve: OptimalCurve) -> str:
    """Return the effects that the amplitude does not contain."""
    friction = curve.settings.get("friction_coefficient", 0.0)
    every = np.concatenate(
        [
            np.ravel(mu)
            for mu in (friction.values() if isinstance(friction, Mapping) else [friction])
        ]
    )
    values = ", ".join(f"{mu:g}" for mu in np.unique(every[every > 0.0]))
    ends = [k.factor for k in curve.other_friction if k.status == COMPLETE]
    checked = len(ends) > 1 and _other_friction(curve).colour != "white"
    beyond = f"beyond {min(ends):g} to {max(ends):g} times" if checked else "other than"
    other = [f"friction coefficients {beyond} {values}"] * bool(values)
    response = curve.recommended_response
    in_time = response is not None and known_in_time(response)
    time = [] if in_time else ["motion in time", "more blade modes"]
    stiffness = curve.settings.get("contact_stiffness", "")
    joints = stiffness == "model" or "values" in stiffness  # each point is a joint
    points = ["more contact points"] * (
        not joints or curve.settings.get("contact_points") is not None
    )
    return f"Not covered: {', '.join([*time, 'mistuning', 'wear', *points, *other])}."
