"""Statement on an optimal curve, for print, notebooks, report and explorer.

The statement gives the preload, the design amplitude with the values of each method, and the
effects that are not covered. If a check has failed, it begins with the failure and gives a remedy,
and there is no design amplitude.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.subject import (
    excitation_text,
    friction_coefficients,
    has_more_points,
)
from bdamper.model.loads import BASE
from bdamper.response.branches import NO_SOLUTION
from bdamper.response.motion_range import exceeds
from bdamper.response.optimum_checks import (
    GOOD,
    NEAR_BEST,
    Check,
    OptimalCurve,
    checked_amplitudes,
    checks,
    estimate_call,
    failed,
    friction_tried,
    known_in_time,
    range_in_time_text,
)
from bdamper.response.peak_error import error_text
from bdamper.response.response_curve_result import NO_STEADY
from bdamper.response.verification import FRICTION_SPREAD, MUCH
from bdamper.util.errors import COMPLETE
from bdamper.util.formatting import amount, counted, loads_text, peak_text, percent, span
from bdamper.util.statement import Row, Statement

CLEARLY = 1.5
"""Smallest ratio of the slopes on both sides of an optimum at which the statement names the steeper
one."""
MEETS = 0.05
"""Relative difference of two speeds up to which the engine order meets the resonance at the speed of
the study."""
RESULTS = {"green": "pass", "amber": "uncertain", "red": "FAIL", "white": "not run"}
"""Printed result of a check by its colour."""


def statement(curve: OptimalCurve, further: Sequence[Check] = ()) -> Statement:
    """Return the verdict, quantities, checks and remedies of an optimal curve.

    ``further`` are checks of a report.
    """
    best = curve.optimum
    if best.kind == "flat":
        peak = peak_text(best.amplitude, best.frequency)
        locked = _locked(curve)
        remarks = [locked] if locked else []
        return Statement([f"The preload does not matter: {peak}"], remarks=remarks)
    if not np.isfinite(best.preload):
        return Statement([f"No optimum: {best.status_text}{_first_incomplete(curve)}"])
    failures = [*failed(curve), *(check for check in further if check.colour == "red")]
    remedies = "; ".join(dict.fromkeys(check.remedy for check in failures))
    remarks = [_doubts(curve), _locked(curve)]
    if remedies:
        remarks.append(f"Remedy: {remedies}")
    return Statement(
        verdict=[*(f"Not for design: {check.failure}" for check in failures), _answer(curve)],
        rows=[*_preload_rows(curve), *_amplitude_rows(curve, bool(failures))],
        checks=[Row(check.name, RESULTS[check.colour], check.finding) for check in checks(curve)],
        times=[check.price for check in checks(curve)],
        remarks=[text for text in (*remarks, _not_covered(curve)) if text],
        further=_calls(curve),
    )


def _calls(curve: OptimalCurve) -> list[str]:
    """Return the calls to make after time integration at the recommended preload."""
    in_time = curve.recommended_response
    if in_time is None or not known_in_time(in_time):
        return []
    return [
        "time integration at other preloads: study.with_time_response(curve, preloads)",
        f"every source of error: {estimate_call(curve)}",
    ]


def _answer(curve: OptimalCurve) -> str:
    """Return preload and amplitude with their subject: engine order, excitation, friction
    coefficient.
    """
    settings = curve.settings
    subject = []
    if settings.get("engine_order"):
        subject.append(f"engine order {settings['engine_order']}")
    excitation = excitation_text(settings)
    if excitation:
        subject.append(excitation)
    coefficients = friction_coefficients(settings)
    if coefficients.size:
        subject.append(f"friction coefficient {_listed(coefficients)}")
    answer = f"Lowest amplitude at {amount(curve.recommended_preload, 'N')}"
    in_time = curve.recommended_response
    if in_time is None or not known_in_time(in_time):
        answer += f", {amount(curve.optimum.amplitude, 'm')} by harmonic balance alone"
    elif np.isfinite(curve.design_amplitude):
        answer += f", design amplitude {amount(curve.design_amplitude, 'm')}"
    else:
        answer += f", up to {amount(in_time.largest, 'm')} by time integration"
    if not failed(curve):
        answer += _uncertain(curve)
    answer += _drop(curve)
    return f"{answer}: {', '.join(subject)}" if subject else answer


def _drop(curve: OptimalCurve) -> str:
    """Return the preload and the amplitude of a drop next to the optimum, or "".

    Two neighbouring preloads do not distinguish a steep slope from a jump.  Within the spread of
    friction coefficients, which acts like one of the preload, both decide about the design.  An
    amplitude that a search has followed counts as a lower bound.
    """
    best = curve.optimum
    amplitude = np.where(np.isfinite(curve.amplitude), curve.amplitude, curve.lower_bound)
    distance = np.abs(np.log(curve.preload / best.preload))
    near = distance <= np.log(FRICTION_SPREAD)
    highest = best.amplitude
    at = np.nan
    for side in (curve.preload < best.preload, curve.preload > best.preload):
        inner = best.amplitude
        # outward from the optimum
        for i in sorted(np.flatnonzero(side & near), key=lambda i: distance[i]):
            outer = amplitude[i]
            if not np.isfinite(outer):
                continue
            if outer > max(MUCH * inner, highest):
                highest = outer
                at = curve.preload[i]
            inner = outer
    if np.isnan(at):
        return ""
    ratio = highest / best.amplitude
    return f"; at {amount(at, 'N')} {amount(highest, 'm')}, {ratio:.2g} times as high"


def _uncertain(curve: OptimalCurve) -> str:
    """Return the number of checks that neither pass nor fail, or ""."""
    n_uncertain = sum(check.colour == "amber" for check in checks(curve))
    return f", {counted(n_uncertain, 'check')} uncertain" if n_uncertain else ""


def _first_incomplete(curve: OptimalCurve) -> str:
    """Return the status at the lowest preload whose curve is not complete."""
    for preload, status, text in zip(curve.preload, curve.status, curve.status_text):
        if status != COMPLETE:
            return f"; at {amount(preload, 'N')} {text}"
    return ""


def _preload_rows(curve: OptimalCurve) -> list[Row]:
    """Return the recommended preload with the range around it, and further remarks on it."""
    # the recommendation follows time integration, the optimum harmonic balance
    recommended = curve.recommended_preload
    optimum = curve.optimum
    low, high = curve.near_best
    near_best = f"at most {percent(NEAR_BEST - 1.0)} above the lowest amplitude"
    within = f"{_range_text(curve, low, high)}: {near_best}, by harmonic balance"
    steeper = _steeper(curve)
    if steeper:
        within += f"; {steeper}"
    remarks = [within]
    shares = loads_text(curve.settings.get("load_per_preload"))
    if shares:
        remarks.append(f"loads per newton: {shares}")
    if optimum.uncertainty > GOOD and optimum.known_to:
        remarks.append(optimum.known_to)
    if not np.isclose(recommended, optimum.preload):
        remarks.append(
            f"lowest by time integration; by harmonic balance {amount(optimum.preload, 'N')}"
        )
    for remark in (_not_integrated(curve), _of_damper(curve, recommended)):
        if remark:
            remarks.append(remark)
    if curve.range_in_time:
        remarks.append(range_in_time_text(curve))
    first, *others = remarks
    rows = [Row("Preload", amount(recommended, "N"), first)]
    rows += [Row("", "", text) for text in others]
    return rows


def _range_text(curve: OptimalCurve, low: float, high: float) -> str:
    """Return a range of preloads (N), and the ends of the search that cut it off."""
    begins = low <= curve.preload.min()
    ends = high >= curve.preload.max()
    if begins and ends:
        return f"all preloads of the search, {span(low, high, 'N')}"
    if begins:
        return f"up to {amount(high, 'N')}, searched from {amount(low, 'N')}"
    if ends:
        return f"from {amount(low, 'N')}, searched up to {amount(high, 'N')}"
    return span(low, high, "N")


def _steeper(curve: OptimalCurve) -> str:
    """Return the side of the optimum on which the amplitude rises faster; "" if uncertain.

    A lower bound can make a side the steeper one.  It cannot make it the flatter one.
    """
    slope_below, below_certain = _rise(curve, curve.preload < curve.optimum.preload)
    slope_above, above_certain = _rise(curve, curve.preload > curve.optimum.preload)
    if above_certain and slope_below >= CLEARLY * slope_above > 0.0:
        return "steeper below than above"
    if below_certain and slope_above >= CLEARLY * slope_below > 0.0:
        return "steeper above than below"
    return ""


def _rise(curve: OptimalCurve, side: NDArray) -> tuple[float, bool]:
    """Return the largest slope from the optimum on one side, and whether it is certain.

    The slope is d ln(amplitude)/d ln(preload).  Amplitudes up to NEAR_BEST times the optimum are
    disregarded.  Amplitudes of incomplete peaks are lower bounds.  ``side`` (n,) bool tells which
    preloads are on this side.
    """
    known = np.isfinite(curve.amplitude)
    amplitude = np.where(known, curve.amplitude, curve.lower_bound)
    log_rise = np.log(amplitude / curve.optimum.amplitude)
    counts = side & np.isfinite(log_rise) & (log_rise > np.log(NEAR_BEST))
    log_distance = np.log(curve.preload[counts] / curve.optimum.preload)
    slope = np.abs(log_rise[counts] / log_distance)
    return float(slope.max(initial=0.0)), bool(known[side].all())


def _not_integrated(curve: OptimalCurve) -> str:
    """Return the side of the recommended preload without time integration, or ""."""
    if curve.optimum_in_time is None:
        return ""
    recommended = curve.recommended_preload
    # ascending
    integrated = [response.preload for response in curve.time_response if known_in_time(response)]
    if recommended == integrated[0]:
        return "lower preloads were not integrated"
    if recommended == integrated[-1]:
        return "higher preloads were not integrated"
    return ""


def _of_damper(curve: OptimalCurve, preload: float) -> str:
    """Compare a preload with the centrifugal load of the damper at a rotor speed.

    It is the speed of the study, or else the one at which the engine order meets the resonance.  At
    another speed no mass follows from the preload.
    """
    order = curve.settings.get("engine_order", 0)
    # with an excitation of one newton the preload is a ratio; loads per preload concern several
    # bodies
    if _is_one_newton(curve) or curve.settings.get("load_per_preload"):
        return ""
    # the radius is unknown (NaN) without rotation
    if not order or not curve.mass_radius > 0.0:
        return ""
    # rad/s
    at_resonance = 2.0 * np.pi * curve.optimum.frequency / order
    speed = curve.settings.get("speed") or at_resonance
    rotor_speed = amount(30.0 * speed / np.pi, "rpm")
    if abs(at_resonance / speed - 1.0) > MEETS:
        return (
            f"Engine order {order} meets this resonance at "
            f"{amount(30.0 * at_resonance / np.pi, 'rpm')}, not at {rotor_speed}, the speed of the "
            f"study; use study.at_speed({at_resonance:.4g})"
        )
    of_speed = f"where engine order {order} meets this resonance"
    if curve.settings.get("speed"):
        of_speed = "the speed of the study"
    load = curve.mass_radius * speed**2
    return (
        f"The damper has a centrifugal load of {amount(load, 'N')} at {rotor_speed}, {of_speed}; "
        f"the preload requires {preload / load:.2g} times its mass"
    )


def _is_one_newton(curve: OptimalCurve) -> bool:
    """Return whether preloads are those for one newton of excitation, and scale with it."""
    excitation = curve.settings.get("excitation", {})
    return bool(excitation.get("amplitude") == 1.0 and excitation.get("location") != BASE)


def _amplitude_rows(curve: OptimalCurve, any_failed: bool) -> list[Row]:
    """Return the design amplitude, unless a check has failed, and the amplitude by each method."""
    optimum = curve.optimum
    # time response at the recommended preload; None if its amplitude is unknown
    in_time = curve.recommended_response
    if in_time is not None and not known_in_time(in_time):
        in_time = None
    rows = []
    if in_time is not None and not any_failed:
        rows.append(_design_row(curve))
    name = "Harmonic balance"
    remark = amount(optimum.frequency, "Hz")
    if in_time is not None and not np.isclose(in_time.preload, optimum.preload):
        rows.append(Row(name, amount(in_time.balance, "m"), "at this preload"))
        name = ""
        remark += f" at its optimum, {amount(optimum.preload, 'N')}"
    error = error_text(curve.errors_at(optimum.preload))
    if error:
        remark += f"; {error}"
    if in_time is None:
        remark += "; do not use this amplitude for stresses"
    rows.append(Row(name, amount(optimum.amplitude, "m"), remark))
    more = curve.convergence
    if more is not None and len(more.peaks) > 1:
        numbers = f"with {more.peaks[0].harmonics} to {more.peaks[-1].harmonics} harmonics"
        lowest, highest = more.range
        rows.append(Row("", span(lowest, highest, "m"), numbers))
    free = curve.free.amplitude
    if np.isfinite(free):
        ratio = free / optimum.amplitude
        rows.append(
            Row("Without contact", amount(free, "m"), f"{ratio:.3g} times the lowest amplitude")
        )
    if in_time is not None:
        value = span(in_time.lowest, in_time.largest, "m")
        mean = f"mean {amount(in_time.mean, 'm')}, range of all runs"
        remark = f"{amount(in_time.frequency, 'Hz')}, {mean}"
        rows.append(Row("Time integration", value, remark))
        if in_time.blades_differ:
            least, most = in_time.spread
            rows.append(Row("", span(least, most, "m"), "different blades"))
    half_range = _range(curve)
    if half_range:
        rows.append(Row("", "", half_range))
    return rows


def _design_row(curve: OptimalCurve) -> Row:
    """Return the design amplitude with the check that determines it."""
    name = "Design amplitude"
    # by the description of each check
    amplitudes = checked_amplitudes(curve)
    unknown = [check for check, amplitude in amplitudes.items() if np.isnan(amplitude)]
    if unknown:
        return Row(name, "unknown", f"the peak {' and '.join(unknown)} is not complete")
    highest = max(amplitudes, key=lambda check: amplitudes[check])
    remark = f"largest of all checks, {highest}"
    return Row(name, amount(curve.design_amplitude, "m"), remark)


def _range(curve: OptimalCurve) -> str:
    """Return half of the range of motion where other harmonics than the first add to it."""
    best = curve.optimum
    response = curve.recommended_response
    parts = []
    if exceeds(best.half_range, best.amplitude):
        parts.append(f"by harmonic balance {amount(best.half_range, 'm')}")
    if response is not None and exceeds(response.half_range, response.mean):
        parts.append(f"by time integration {amount(response.half_range, 'm')}")
    if not parts:
        return ""
    half_range = ", ".join(parts)
    return f"first harmonic; half the peak-to-peak motion is {half_range}"


def _doubts(curve: OptimalCurve) -> str:
    """Return the doubts of the curve at the optimum: broken paths, and a rattling damper."""
    optimum = curve.optimum.preload
    rattling = False
    broken = []
    for response_curve in curve.curves:
        if not np.isclose(response_curve.preload, optimum, rtol=1e-9, atol=0.0):
            continue
        rattling |= NO_STEADY in response_curve.reason
        # gaps without a solution are narrower than a thousandth of the interval in a complete curve
        broken += [part for part in response_curve.missing_ranges if part.why != NO_SOLUTION]
    doubts = []
    if rattling:
        doubts.append(f"{NO_STEADY} is expected")
    if broken:
        places = " and ".join(amount((part.low + part.high) / 2.0, "Hz") for part in broken[:2])
        doubts.append(
            f"a path of the response curve broke off near {places}, so that a higher branch may be "
            "missing"
        )
    if not doubts:
        return ""
    return f"Doubt at {amount(optimum, 'N')}: {'; '.join(doubts)}."


STICKING = (
    "a shroud is locked: the amplitude is that of contacts that stick (study.first_slip), and a "
    "vibration that starts in another way may slip"
)
"""Remark on preloads whose curves start at the locked state of a shroud."""


def _locked(curve: OptimalCurve) -> str:
    """Return the bodies that friction alone can hold, and the preloads of a locked shroud.

    The forces of both depend on the history.
    """
    # a dictionary keeps each note once and in order
    notes: dict[str, None] = {}
    for response_curve in curve.curves:
        notes |= dict.fromkeys(response_curve.self_locking)
    loads = [response_curve.preload for response_curve in curve.curves if response_curve.sticks]
    if loads:
        notes[f"at {amount(min(loads), 'N')} to {amount(max(loads), 'N')} {STICKING}"] = None
    return " ".join(f"{_capitalised(note)}." for note in notes)


ONE_SPEED = "centrifugal stiffening and spin softening (import the sector at two speeds)"
"""Effects of rotation that a model with the modes of one speed neglects."""


def _not_covered(curve: OptimalCurve) -> str:
    """Return the effects that the amplitude does not contain."""
    effects = []
    response = curve.recommended_response
    if response is None or not known_in_time(response):
        effects += ["time integration", "more blade modes"]
    effects += ["mistuning", "wear"]
    # only where the statement gives a rotor speed
    if curve.neglected and (
        curve.settings.get("speed") or _of_damper(curve, curve.optimum.preload)
    ):
        effects.append(ONE_SPEED)
    if has_more_points(curve.settings):
        effects.append("more contact points")
    coefficients = friction_coefficients(curve.settings)
    if coefficients.size:
        values = _listed(coefficients)
        factors = [peak.factor for peak in curve.other_friction if peak.ok]
        if len(factors) > 1 and friction_tried(curve):
            beyond = f"outside {min(factors):g} to {max(factors):g} times"
        else:
            beyond = "other than"
        effects.append(f"friction coefficients {beyond} {values}")
    return f"Not covered: {', '.join(effects)}"


def _listed(coefficients: NDArray) -> str:
    return ", ".join(f"{coefficient:g}" for coefficient in coefficients)


def _capitalised(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"
