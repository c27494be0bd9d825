"""Error estimates of a peak by source: what richer settings would change, found without a new analysis.

For each source the converged peak is embedded in a richer study and the change of amplitude and frequency follows from one
Newton step there (:func:`bdamper.effects.indicator.estimate_change`); where that step cannot be trusted (a large change,
or a second residual that contradicts it) Newton goes on to the end in the richer study; if that leads nowhere, the peak is
found anew, with one harmonic if harmonics are not in question.  A curve that is highest at an end of its interval is
compared at this frequency, to which more harmonics are carried a few at a time; where that changes by more than 30 % or
leads nowhere, another resonance may have come into the interval, and the highest points of two curves with one harmonic
are compared (not if harmonics are in question).

``harmonics``
    As many more as there are, at least eight; where the model lacks a nodal diameter the modes of the fundamental stand in.
``evaluation``
    Samples against exact events.  Exact events against dense samples: there the sampling error itself, some 1e-6, is the
    most that missed events can hide behind.
``contact points``
    United patches against the patches of the model.  For the patches of the model themselves the change to half as many
    is taken, with the sign turned: an error that falls with the number of points or faster is not larger.
``modes``
    All modes of the model.  Where there are no more, the change to half as many is taken, times one third: with residual
    flexibility modes converge with the fourth power of the frequency of the first one left out.
``residual flexibility``
    Contact stiffness by a diagonal rule against residual modes, which carry all of it for the stuck modes.
``solver``
    The residual that is left, and the place of the peak between points of a curve.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.system import OK, HarmonicSystem
from bdamper.contact.laws import Sampled
from bdamper.continuation.curve import Curve
from bdamper.continuation.track import check_curve, track
from bdamper.effects.indicator import embed_between, estimate_change
from bdamper.model.model import Model
from bdamper.peaks.carryover import carried_over, higher_nearby
from bdamper.peaks.newton import Peak, find_peak, peak_scale
from bdamper.peaks.optimal import highest_peak
from bdamper.problem.effects import MAX_HARMONIC, Effects, harmonic_numbers
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.estimates import ErrorEstimates, SourceError

SOURCES = ("harmonics", "evaluation", "contact points", "modes", "residual flexibility", "solver")
TRUSTED = 0.01
"""Relative change up to which one Newton step is enough if nothing contradicts it."""
POINTS_FACTOR = 1.0
"""Error of n contact points over the change to n/2 of them."""
ANOTHER = 0.3
"""Relative change at an end of the interval beyond which the highest point of a richer curve may be elsewhere."""
MODES_FACTOR = 1.0 / 3.0
"""Error of n modes over the change to n/2 of them."""


@dataclass(frozen=True)
class Richer:
    """A study that differs from another in one source of error.

    Parameters
    ----------
    problem : Problem
    factor : float
        What the change is to be multiplied by: 1 for a richer study, negative for a poorer one.
    text : str
    """

    problem: Problem
    factor: float
    text: str


@one_thread
def estimate_errors(
    problem: Problem,
    result: Curve | Peak,
    preload: float | None = None,
    *,
    sources: Sequence[str] = SOURCES,
) -> ErrorEstimates:
    """Estimated errors of a peak by source.

    Parameters
    ----------
    problem : Problem
        That the result was computed with.
    result : Curve or Peak
        Of a tracking curve the highest peak is taken.
    preload : float, N, optional
        For a peak that does not carry it as its parameter.
    sources : sequence of str
        Out of :data:`SOURCES`.

    Returns
    -------
    ErrorEstimates

    Raises
    ------
    SettingError
        If the result is not one of this study, or not converged.
    """
    sources = validate.names("sources", sources, SOURCES)
    validate.instance("result", result, (Curve, Peak), "a Curve or a Peak of this study")
    begin = time.perf_counter()
    end_of: tuple[float, float] | None = None
    problem = problem.matching(result.settings)
    if isinstance(result, Curve):
        check_curve(problem, result)
        top = result.peak
        if result.point_kind[top.index] == "end":
            end_of = float(result.frequency.min()), float(result.frequency.max())
        preload = result.preload
        y = np.append(result.unknowns[top.index], 2.0 * np.pi * top.frequency)
        peak = find_peak(problem.system(preload), y)
        amplitude, frequency = top.amplitude, top.frequency
        near = abs(peak.amplitude / amplitude - 1.0) < 0.05 and abs(peak.frequency / frequency - 1.0) < 0.02
        many = isinstance(problem.evaluation, Sampled)  # samples make many small peaks
        if not (peak.converged and near) or end_of or many:
            peak = replace(peak, y=y, frequency=frequency, amplitude=amplitude, residual=float(result.residual[top.index]),
                           status="converged")  # fmt: skip
    else:
        if not result.converged:
            raise SettingError(f"peak: expected a converged one, found status '{result.status}'")
        preload = result.parameter if preload is None else problem.check_preload(preload)
        if not np.isfinite(preload):
            raise SettingError("preload: expected a number, since the peak carries none, found nothing")
        if len(result.y) != problem.system(preload).n_unknowns + 1:
            raise SettingError(
                f"peak: expected one of this study with {problem.system(preload).n_unknowns} unknowns, found "
                f"{len(result.y) - 1}"
            )
        peak, amplitude, frequency = result, result.amplitude, result.frequency
    location = peak.amplitude / amplitude - 1.0, peak.frequency / frequency - 1.0
    items = [_of_source(problem, source, preload, peak, end_of, location) for source in sources]
    found = tuple(item for item in items if item is not None)
    return ErrorEstimates(preload, frequency, amplitude, found, time.perf_counter() - begin)


def _of_source(
    problem: Problem,
    source: str,
    preload: float,
    peak: Peak,
    end_of: tuple[float, float] | None,
    location: tuple[float, float],
) -> SourceError | None:
    begin = time.perf_counter()

    def result(amplitude: float, frequency: float, uncertainty: float, text: str) -> SourceError:
        return SourceError(source, float(amplitude), float(frequency), uncertainty, text, time.perf_counter() - begin)

    if source == "solver":
        e = estimate_change(problem.system(preload), peak.y)
        text = f"residual {peak.residual:.1e}" + (", place of the peak on the curve" if any(location) else "")
        return result(e.amplitude + location[0], e.frequency + location[1], 0.0, text)
    if source == "evaluation" and not isinstance(problem.evaluation, Sampled):
        amplitude, frequency, n = _missed_events(problem, preload, peak.y)
        return result(amplitude, frequency, 0.0, f"exact events against {n} samples, whose own error this may be")
    try:
        richer = richer_study(problem, source)
        if richer is None:
            return None
        if end_of:
            amplitude, frequency, uncertainty, how = change_at_end(problem, richer.problem, preload, peak, end_of)
        else:
            amplitude, frequency, uncertainty, how = change_of_peak(problem, richer.problem, preload, peak)
    except BdamperError as error:
        return result(np.nan, np.nan, np.inf, str(error))
    f = richer.factor
    return result(f * amplitude, f * frequency, abs(f) * uncertainty, f"{richer.text}; {how}")


def change_of_peak(
    problem: Problem, richer: Problem, preload: float, peak: Peak, *, solve: bool = True
) -> tuple[float, float, float, str]:
    """Relative change of amplitude and frequency from one study to another, how much it may miss, and how it was found.

    Parameters
    ----------
    study, richer : Study
    preload : float, N
    peak : Peak
        Of the first study.
    solve : bool
        Go on with Newton where one step cannot be trusted.
    """
    if not richer.static(preload).converged:
        return np.nan, np.nan, np.inf, f"no static state: {richer.static(preload).note}"
    a, b = problem.system(preload), richer.system(preload)
    y = embed_between(problem, richer, a, b, preload, peak.y)
    try:
        e = estimate_change(b, y)
    except FloatingPointError:
        return np.nan, np.nan, np.inf, "not finite"
    change = max(abs(e.amplitude), abs(e.frequency))
    stationary = not isinstance(problem.evaluation, Sampled)  # samples put corners into a curve, and its top on one of them
    trusted = np.isfinite(e.size) and change <= TRUSTED and e.defect <= 0.1 * change and stationary
    if trusted or not solve or e.size < 1e-9:
        return e.amplitude, e.frequency, e.defect, "one Newton step"
    guesses = [e.y] if np.isfinite(e.size) and e.size < 0.3 else []
    found = carried_over(b, [*guesses, y], y, peak.scale[-1])
    if found is not None:
        found = higher_nearby(b, found)
        return found.amplitude / peak.amplitude - 1.0, found.frequency / peak.frequency - 1.0, 0.0, "solved"
    moved = _stuck_resonance(richer, preload, peak.frequency) / _stuck_resonance(problem, preload, peak.frequency)
    around = (0.9 * min(1.0, moved) * peak.frequency, 1.1 * max(1.0, moved) * peak.frequency)
    try:
        if richer.harmonic_numbers != problem.harmonic_numbers or problem.harmonic_numbers == (1,):
            before, how = (peak.amplitude, peak.frequency), "found anew"
            after = _highest(richer, preload, around)
        else:
            before, after = (_highest(s, preload, around) for s in _with_one_harmonic(problem, richer))
            how = "peaks with one harmonic compared"
    except BdamperError as error:
        return np.nan, np.nan, np.inf, f"no peak found: {error}"
    return after[0] / before[0] - 1.0, after[1] / before[1] - 1.0, 0.0, how


def change_at_end(
    problem: Problem, richer: Problem, preload: float, peak: Peak, interval: tuple[float, float]
) -> tuple[float, float, float, str]:
    """The same where a curve is highest at an end of its interval (Hz)."""
    same = richer.harmonic_numbers == problem.harmonic_numbers
    way = [richer]
    if not same:
        top, own = richer.harmonic_numbers[-1], problem.harmonic_numbers[-1]
        way = [with_stand_ins(problem, n) for n in range(own + 2, top, 2)] + way
    y: NDArray | None = peak.y
    before, a = problem, problem.system(preload)
    for after in way:
        if y is None or not after.static(preload).converged:
            continue
        b = after.system(preload)
        y = _at_frequency(b, embed_between(before, after, a, b, preload, y))
        before, a = after, b
    if y is not None:
        change = float(abs(a.response(y[:-1])[1])) / peak.amplitude - 1.0
        if abs(change) <= ANOTHER or not same:
            return change, 0.0, 0.0, "solved at the end of the interval"
    if not same:
        return np.nan, np.nan, np.inf, "no solution found at the end of the interval"
    tops = []
    for s in _with_one_harmonic(problem, richer):
        curve = track(s, preload, interval)
        if not curve.complete:
            return np.nan, np.nan, np.inf, f"no whole curve with one harmonic: {curve.reason}"
        tops.append((curve.peak.amplitude, curve.peak.frequency))
    return tops[1][0] / tops[0][0] - 1.0, tops[1][1] / tops[0][1] - 1.0, 0.0, "curves with one harmonic compared"


def _at_frequency(system: HarmonicSystem, y: NDArray) -> NDArray | None:
    """A solution near a point, at its frequency."""
    scale = peak_scale(system, y, y[-1])
    for search in (False, True):
        c = system.correct_at(y[:-1], float(y[-1]), scale, 1e-9, 60 if search else 20, search)
        if c.status == OK:
            return c.y
    return None


def _with_one_harmonic(*studies: Problem) -> list[Problem]:
    return [s.with_effects(replace(Effects.of(s), harmonics=1)) for s in studies]


def _highest(problem: Problem, preload: float, around: tuple[float, float]) -> tuple[float, float]:
    """Amplitude and frequency of the highest peak, or of the highest point of the curve where that is no maximum."""
    try:
        peak = highest_peak(problem, preload, around)
        return peak.amplitude, peak.frequency
    except BdamperError:
        curve = track(problem, preload, around)
        if not curve.complete or curve.point_kind[curve.peak.index] == "end":
            raise
        return curve.peak.amplitude, curve.peak.frequency


def _stuck_resonance(problem: Problem, preload: float, frequency: float) -> float:
    """Frequency in Hz of the largest stuck resonance within a third of a frequency, or this itself."""
    system, springs = problem.system(preload), problem.stuck_springs(problem.static(preload))
    row = problem.response_rows[1]
    poles = [w for w in system.linear_modes(springs)[0] if 0.67 < w / (2.0 * np.pi * frequency) < 1.5]
    best = max(poles, key=lambda w: abs(system.linear_response(w, springs) @ row), default=2.0 * np.pi * frequency)
    return float(best) / (2.0 * np.pi)


def _missed_events(problem: Problem, preload: float, y: NDArray) -> tuple[float, float, int]:
    """Change towards the limit of many samples, extrapolated from two numbers of them."""
    exact = problem.system(preload)
    n = 512 * max(2, exact.n_harmonics)
    r = [np.empty(exact.n_unknowns), np.empty(exact.n_unknowns)]
    for samples, out in zip((n, 2 * n), r):
        dense = replace(problem, evaluation=Sampled(samples))
        dense._states.update(problem._states)
        dense.system(preload).core.evaluate(np.ascontiguousarray(y[:-1]), float(y[-1]), out)
    e = estimate_change(exact, y, (4.0 * r[1] - r[0]) / 3.0)
    return e.amplitude, e.frequency, 2 * n


# ---- richer studies ----


def richer_study(problem: Problem, source: str) -> Richer | None:
    """A study that is richer in one respect, or poorer where there is nothing richer; None if there is neither."""
    return {
        "harmonics": _more_harmonics,
        "evaluation": _exact_events,
        "contact points": _more_points,
        "modes": _more_modes,
        "residual flexibility": _residual_modes,
    }[source](problem)


def missing_harmonics(problem: Problem, top: int) -> list[int]:
    """Harmonics up to the top one for which the model has no modes."""
    out = []
    for l in range(2, top + 1):
        d, _ = problem.model.folded_nodal_diameter(problem.engine_order * (1 if problem.single_basis else l))
        if any(body.kind == "constrained" and d not in body.bases for body in problem.model.bodies.values()):
            out.append(l)
    return out


def with_stand_ins(problem: Problem, harmonics: int | tuple[int, ...]) -> Problem:
    """The study with harmonics for which modes of the fundamental's nodal diameter stand in where the model has none."""
    lacking = missing_harmonics(problem, harmonic_numbers(harmonics)[-1])
    if not lacking:
        return problem.with_effects(replace(Effects.of(problem), harmonics=harmonics))
    return replace(problem, model=_model_with_stand_ins(problem, lacking), harmonics=harmonics)


def _model_with_stand_ins(problem: Problem, harmonics: list[int]) -> Model:
    model = problem.model
    own, _ = model.folded_nodal_diameter(problem.engine_order)
    bodies = {}
    for name, body in model.bodies.items():
        bases = dict(body.bases)
        if body.kind == "constrained":
            for l in harmonics:
                bases.setdefault(model.folded_nodal_diameter(problem.engine_order * l)[0], bases[own])
        bodies[name] = replace(body, bases=bases)
    out = replace(model, bodies=bodies)
    object.__setattr__(out, "_checked", True)
    return out


def _more_harmonics(problem: Problem) -> Richer:
    own = problem.harmonic_numbers
    top = min(own[-1] + max(8, own[-1]), MAX_HARMONIC)
    lacking = missing_harmonics(problem, top)
    text = f"harmonics 1 to {top}"
    if lacking:
        text += f", with the modes of the first for {lacking[0]} and more"
    return Richer(with_stand_ins(problem, top), 1.0, text)


def _exact_events(problem: Problem) -> Richer | None:
    if not isinstance(problem.evaluation, Sampled):
        return None
    finer = finer_evaluation(problem, problem.harmonic_numbers[-1])
    if finer.evaluation == "exact":
        return Richer(finer, 1.0, "exact events")
    dense = Sampled(4 * problem.evaluation.n_time)
    return Richer(replace(problem, evaluation=dense), 1.0, f"{dense.n_time} samples")


def finer_evaluation(problem: Problem, harmonics: int) -> Problem:
    """The study with exact events; with coupled friction, which has none, with 32 samples for each harmonic at least."""
    if not isinstance(problem.evaluation, Sampled):
        return problem
    try:
        return replace(problem, evaluation="exact")
    except SettingError:
        return replace(problem, evaluation=Sampled(max(problem.evaluation.n_time, 128, 32 * harmonics)))


def points_on_a_face(problem: Problem) -> int:
    """Largest number of contact points on a friction face of the model."""
    return max((f.n_points for f in problem.model.interfaces.values() if f.kind == "friction"), default=0)


def _more_points(problem: Problem) -> Richer | None:
    full = points_on_a_face(problem)
    if problem.contact_points is not None and problem.contact_points < full:
        return Richer(replace(problem, contact_points=None), 1.0, f"{full} contact points on a face")
    if full < 2:
        return None
    half = full // 2
    return Richer(
        replace(problem, contact_points=half), -POINTS_FACTOR, f"from {half} contact points on a face to those of the model"
    )


def _more_modes(problem: Problem) -> Richer | None:
    bodies = problem.model.bodies.values()
    blade = [min(b.n_modes for b in body.bases.values()) for body in bodies if body.kind == "constrained"]
    damper = [body.bases[0].n_modes - 6 for body in bodies if body.kind == "free"]
    most = max(blade, default=0)
    elastic = max(min(damper, default=0), problem.damper_modes)
    if most > problem.blade_modes:
        text = f"{most} modes" + (f", {elastic} elastic modes of the damper" if damper else "")
        return Richer(replace(problem, blade_modes=most, damper_modes=elastic), 1.0, text)
    own = min(problem.blade_modes, most)
    if own < 2:
        return None
    return Richer(
        replace(problem, blade_modes=own // 2), -MODES_FACTOR, f"from {own // 2} to {own} modes, all that the model has"
    )


def _residual_modes(problem: Problem) -> Richer | None:
    if problem.contact_stiffness not in ("unit_traction", "eq4"):
        return None
    return Richer(replace(problem, contact_stiffness="residual_modes"), 1.0, "residual modes")


@one_thread
def with_errors(problem: Problem, curve: Curve, *, sources: Sequence[str] = SOURCES) -> Curve:
    """The same tracking curve with estimated errors of its highest peak, which it prints and saves."""
    validate.instance("curve", curve, Curve)
    return replace(curve, error_estimates=estimate_errors(problem, curve, sources=sources))
